"""Planning among obstacles that move with time: paths with waits, found over safe intervals, and certified.

The search runs on a roadmap whose edges are motions from rest to rest within the limits of the joints. At each
configuration of the roadmap the time is divided into safe intervals, in which the arm can rest there. A state of the
search is a configuration with one of its intervals, and only its earliest arrival matters, since the arm can wait. The
roadmap begins with paths that RRT-Connect plans without the movers, and grows by random configurations, near the known
ones and anywhere. Samples steer the search; the complete motion is certified among the movers, and a part that fails
the proof is removed.

Sources: M. Phillips, M. Likhachev (2011), "SIPP: safe interval path planning for dynamic environments", ICRA; M.
Hueppi, L. Bartolomei, R. Mascaro, M. Chli (2022), "T-PRM: temporal probabilistic roadmap for path planning in dynamic
environments", IROS.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from itertools import pairwise, zip_longest
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CollisionChecker, Mover, certify, with_movers
from pinproof.common.results import Solution
from pinproof.common.structs import described, key
from pinproof.common.validation import require_integer, require_positive
from pinproof.description import moved_by
from pinproof.errors import InputError
from pinproof.model import guess_mark
from pinproof.motion import JointPath, Trajectory, least_times, time_parametrise
from pinproof.planning.plan_results import PlanAnswer, PlanResult, PlanStatus
from pinproof.planning.problem import Ends, read_ends, sampling_box
from pinproof.planning.rrt_connect import SEARCH_PAD, RrtConnect
from pinproof.planning.simplification import shortcut
from pinproof.spatial import Array, finite

Flags = npt.NDArray[np.bool_]

# Seconds between the departures that are tried.
STEP = 0.05
# Seconds. By default, a goal that is not reached within this time is not searched.
LONGEST = 120.0
# Largest motion of a joint (rad or m) between two samples of an edge. Samples only steer the search.
MOTION = 0.03
# Number of random configurations after which the search runs again.
BATCH = 40
# Number of nearest configurations to which a new one is connected.
NEIGHBOURS = 8
# Standard deviation (rad or m) of random configurations around configurations of the roadmap.
NEARBY = 0.5
# Number of equal parts of an edge of a planned path, between which the arm may wait.
STOPS = 4
# Number of paths without movers, with different samples, that begin the roadmap.
STATIC_PATHS = 3
# Number of motions that may fail the proof before the search ends.
MOST_PROOFS = 30


@described(eq=False, repr=False)
class TimedPlanResult(PlanAnswer):
    """A certified motion among movers, or the reason of the failure; result of :func:`plan_among_movers`."""

    status: PlanStatus = key("FOUND, or the reason of the failure")
    trajectory: Solution[Trajectory] = key(
        "the motion, from rest to rest, if FOUND; else reading it raises :class:`pinproof.errors.PlanFailed`. Its "
        "time 0 is ``start_time``",
        default=Solution(),
    )
    certificate: Solution[Certificate] = key(
        "the FREE certificate of the motion among :attr:`movers`, if FOUND", default=Solution()
    )
    goal: Solution[int] = key("the index of the goal that was reached, if FOUND", default=Solution())
    message: str = key("the outcome and the remedy as text", default="")
    start_time: float = key("seconds on the clock of the given movers", default=0.0)
    movers: tuple[Mover | Trajectory, ...] = key(
        "the movers as seen from the start, with which :func:`pinproof.certify` and audits check the motion", default=()
    )
    waiting: float = key("total time (s) that the arm waits", default=0.0)
    samples: int = key("number of random configurations", default=0)


def plan_among_movers(
    checker: CollisionChecker,
    start: npt.ArrayLike,
    goals: npt.ArrayLike,
    movers: Sequence[Mover | Trajectory],
    *,
    start_time: float = 0.0,
    window: tuple[float, float] | None = None,
    jerk: npt.ArrayLike | None = None,
    samples: int = 400,
    planner: RrtConnect | None = None,
    rng: int | np.random.Generator = 0,
) -> TimedPlanResult:
    """Plan a motion from ``start`` (n,) to one of ``goals`` (n,) or (g, n) among moving obstacles, with waits.

    The goal that can be reached first is reached as early as the roadmap allows; this is not the earliest time that
    exists. The same ``rng`` gives the same motion.

    Parameters
    ----------
    checker
        Defines the bodies and margins, with the obstacles of the movers in its scene.
    start, goals
        The first configuration and the goals, inside the limits of the joints. The arm rests at both.
    movers
        Moving obstacles and trajectories of other joints, as for :func:`pinproof.certify`.
    start_time
        The time (s) on the clock of the movers at which the arm may start.
    window
        The earliest and the latest time (s), on the clock of the movers, at which the motion ends at a goal. By default
        at any time that the movers cover, up to 120 s after the start.
    jerk
        Limits of jerk, as for :func:`pinproof.time_parametrise`.
    samples
        Largest number of random configurations.
    planner
        Plans the paths without movers.
    rng
        Seed or Generator of the samples.

    Raises
    ------
    InputError
        If there is no mover, a mover does not cover the time from the start to the end of the window, or a number is
        invalid.
    """
    require_integer("samples", samples, 0)
    times = _Times(checker, start, movers, start_time, window)
    ends = read_ends(times.still, start, goals, turns=False)

    def failed(status: PlanStatus, message: str, tried: int = 0) -> TimedPlanResult:
        return TimedPlanResult(status, None, None, None, message, start_time, times.movers, samples=tried)

    if isinstance(ends, PlanResult):
        return failed(ends.status, ends.message)
    if (report := times.checker.check(times.clock.start)).contacts:
        return failed(PlanStatus.START_INVALID, f"the start is invalid at {start_time:.4g} s: {report}")
    search = _Roadmap(times, ends, jerk)
    if (least := search.least_time) > times.last:
        window_end = f"the window ends {times.last:.3g} s after the start"
        return failed(PlanStatus.OUT_OF_BUDGET, f"the joints need at least {least:.3g} s to a goal, and {window_end}")
    generator, plans = np.random.default_rng(rng), planner or RrtConnect()
    rounds = tried = 0
    while True:
        # The roadmap grows by a few paths without the movers, then by random configurations.
        if rounds < STATIC_PATHS:
            plan = plans.plan(times.still, ends.start, ends.goals, rng=generator)
            if not plan.ok and rounds == 0 and plan.status is not PlanStatus.OUT_OF_BUDGET:
                return failed(plan.status, f"without the movers: {plan.message}")
            if plan.ok:
                search.add_path(shortcut(plan.path, times.still, rng=generator).q)
        elif tried >= samples or search.failures > MOST_PROOFS:
            return failed(*search.reason(start_time, tried), tried)
        else:
            tried += search.grow(min(BATCH, samples - tried), generator)
        rounds += 1
        # The motion that ends first is certified; a part that fails the proof is removed, and the search continues.
        while (found := search.earliest()) is not None and search.failures <= MOST_PROOFS:
            row, trajectory, steps = found
            certificate = certify(trajectory, checker, movers=times.movers)
            if certificate.free:
                waiting = sum(step.end - step.start for step in steps if step.edge is None)
                goal = ends.indices[row]
                message = f"reached goal {goal} at {start_time + trajectory.duration:.4g} s"
                message += f"{guess_mark(trajectory.limits_note)}, after waiting {waiting:.3g} s; {certificate.message}"
                return TimedPlanResult(
                    PlanStatus.FOUND, trajectory, certificate, goal, message, start_time, times.movers, waiting, tried
                )
            search.refuse(certificate, steps)


class _Times:
    """The clock of a search, which begins at ``start_time``: which configurations are free at which time."""

    def __init__(
        self,
        checker: CollisionChecker,
        start: npt.ArrayLike,
        movers: Sequence[Mover | Trajectory],
        start_time: float,
        window: tuple[float, float] | None,
    ) -> None:
        require_positive("start_time", start_time, zero=True)
        if isinstance(movers, Mover | Trajectory) or not movers:
            raise InputError("movers must be a list of at least one mover; without a mover, plan with RrtConnect")
        if wrong := [type(mover).__name__ for mover in movers if not isinstance(mover, Mover | Trajectory)]:
            raise InputError(f"a mover is a Mover or a Trajectory of other joints, not {wrong[0]}")
        self.movers = tuple(mover.after(start_time) for mover in movers)
        first, last = self._window(start_time, window)
        # The arm at rest beside the movers: a motion of a larger joint group, of which the movers' columns are used.
        group = checker.group
        resting = Trajectory.at_rest(group.configuration(start, "start"), group.joint_names, last)
        whole = with_movers(resting, checker, self.movers)
        self.clock, self.checker, self.dof = whole.trajectory, whole.checker, group.dof
        last = min(last, self.clock.duration)  # times of trajectories are rounded to nanoseconds
        self.first, self.last = min(first, last), last
        self.grid = np.append(np.arange(0.0, last - STEP / 2, STEP), last)
        self.steering = self.checker.padded(SEARCH_PAD)
        self._at_grid = self.clock(self.grid)[:, self.dof :]
        # The checker without the obstacles that move, and without the links of other joints that move.
        gone = {name for mover in self.movers if isinstance(mover, Mover) for name in mover.obstacles}
        others = {name for mover in self.movers if isinstance(mover, Trajectory) for name in mover.joint_names}
        self.still = checker.with_scene(checker.scene.remove(*gone)) if gone else checker
        if others:
            urdf, bodies = group.robot.urdf, self.still.bodies
            moving = {link for link in urdf.links if moved_by(urdf, link, others)}
            own = [any(bodies[i].link in moving for i in pair) for pair in self.still.pairs]
            self.still = self.still.without_pairs(k for k, moves in enumerate(own) if moves)

    def _window(self, start_time: float, window: tuple[float, float] | None) -> tuple[float, float]:
        """The window in seconds after the start; the end of time that is searched is its end."""
        covered = [mover.trajectory.duration if isinstance(mover, Mover) else mover.duration for mover in self.movers]
        if window is None:
            # A mover that rests at its end covers all later times.
            ends = [
                seconds
                for mover, seconds in zip(self.movers, covered, strict=True)
                if not (isinstance(mover, Mover) and mover.rests)
            ]
            last = min(*ends, LONGEST) if ends else min(LONGEST, max(covered) + LONGEST / 4)
            if not last > 0.0:
                raise InputError(f"the movers end before start_time = {start_time:g} s; give their motion until later")
            return 0.0, last
        first, last = (finite("window", window, (2,)) - start_time).tolist()
        if not (last > 0.0 and first <= last < math.inf):
            raise InputError(
                f"window = {window}; it must be two times in increasing order that end after start_time = "
                f"{start_time:g} s"
            )
        return max(first, 0.0), last

    def free_at(self, q: Array, *, padded: bool = True) -> Flags:
        """(K,) whether q (n,) is free at each time of the grid."""
        rows = np.hstack([np.tile(q, (len(self.grid), 1)), self._at_grid])
        return np.asarray((self.steering if padded else self.checker).is_free_batch(rows))

    def crossings(self, samples: Array, offsets: Array, departures: Array) -> Flags:
        """(D,) whether an edge with the given samples (M, n), at ``offsets`` (s), is free at each departure (s)."""
        at = np.minimum(departures[:, None] + offsets, self.last).ravel()
        rows = np.hstack([np.tile(samples, (len(departures), 1)), self.clock(at)[:, self.dof :]])
        return np.asarray(self.steering.is_free_batch(rows).reshape(len(departures), -1).all(axis=1))


class _Edge:
    """The motion from rest to rest along a straight edge."""

    def __init__(self, motion: Trajectory) -> None:
        self.motion, self.duration = motion, motion.duration
        count = max(2, math.ceil(float(np.abs(motion.end - motion.start).max()) / MOTION) + 1)
        self.offsets = np.linspace(0.0, self.duration, count)
        self.samples = motion(self.offsets)


class _MotionStep(NamedTuple):
    """A part of a motion: an edge between two configurations, or a wait at one of them (``edge`` is None)."""

    start: float
    end: float
    edge: tuple[int, int] | None
    at: int


class _Roadmap:
    """The configurations, edges and safe intervals, and the search for the earliest arrival."""

    def __init__(self, times: _Times, ends: Ends, jerk: npt.ArrayLike | None) -> None:
        self._times, self._jerk, self._steering = times, jerk, times.still.padded(SEARCH_PAD)
        self._group, self._limits = times.still.group, times.still.group.limits
        self.q: list[Array] = []
        self._free: list[Flags] = []
        self._near: list[list[int]] = []
        self._edges: dict[tuple[int, int], _Edge | None] = {}
        self._refused: set[tuple[int, int, int]] = set()
        self._reached: set[int] = set()
        self.failures, self._last_failure = 0, ""
        self._start = self._add(ends.start)
        self._free[self._start][0] = True  # it is free, possibly by less than the pad
        self._goals = [self._add(goal) for goal in ends.goals]
        self._box = sampling_box(self._group, np.vstack([ends.start, ends.goals]))

    # -- growth -------------------------------------------------------------------------------------------------------

    def _add(self, q: Array) -> int:
        for k, known in enumerate(self.q):
            if np.array_equal(known, q):
                return k
        self.q.append(q)
        self._free.append(self._times.free_at(q))
        self._near.append([])
        return len(self.q) - 1

    def _connect(self, a: int, b: int) -> None:
        if a != b and b not in self._near[a]:
            self._near[a].append(b)
            self._near[b].append(a)

    def add_path(self, q: Array) -> None:
        """Add a path (m, n): its waypoints, and stops on each of its edges, which are connected with each other."""
        for first, last in pairwise(q):
            places = [self._add(first + share * (last - first)) for share in np.linspace(0.0, 1.0, STOPS + 1)[:-1]]
            places.append(self._add(last))
            for k, a in enumerate(places):
                for b in places[k + 1 :]:
                    self._connect(a, b)

    def grow(self, count: int, rng: np.random.Generator) -> int:
        """Add up to ``count`` random configurations that are free without the movers; return ``count``."""
        low, high = self._box
        near = np.array(self.q)[rng.integers(len(self.q), size=count)]
        near = np.clip(near + NEARBY * rng.standard_normal(near.shape), low, high)
        drawn = np.where(rng.random((count, 1)) < 0.5, near, low + (high - low) * rng.random(near.shape))
        for q in drawn[self._steering.is_free_batch(drawn)]:
            times = least_times(np.array(self.q) - q, self._limits, full_speed=True)
            nearest = np.argsort(times, kind="stable")[:NEIGHBOURS].tolist()
            new = self._add(q)
            for other in nearest:
                self._connect(new, other)
        return count

    @property
    def least_time(self) -> float:
        """Lower bound (s) of the time from the start to the nearest goal."""
        goals = np.array([self.q[goal] for goal in self._goals])
        return float(least_times(goals - self.q[self._start], self._limits, full_speed=True).min())

    # -- the search ---------------------------------------------------------------------------------------------------

    def _intervals(self, place: int) -> list[tuple[int, int]]:
        """The first and last grid times of the intervals in which the arm can rest at a configuration."""
        edges = np.flatnonzero(np.diff(self._free[place].astype(np.int8), prepend=0, append=0))
        return list(zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True))

    def earliest(self) -> tuple[int, Trajectory, list[_MotionStep]] | None:
        """The goal, motion and parts of the motion that ends first at a goal within the window; None without one."""
        times, grid = self._times, self._times.grid
        goals = np.array([self.q[goal] for goal in self._goals])
        bound = [float(least_times(goals - q, self._limits, full_speed=True).min()) for q in self.q]
        if not self._free[self._start][0]:
            return None
        # A* over configurations with one of their safe intervals; only the earliest arrival in each matters.
        self._reached = set()
        best = {(self._start, 0): 0.0}
        came: dict[tuple[int, int], tuple[tuple[int, int], float]] = {}
        heap = [(bound[self._start], 0.0, self._start, 0)]
        done: set[tuple[int, int]] = set()
        ending: tuple[float, tuple[int, int]] | None = None
        while heap:
            reach, now, place, interval = heapq.heappop(heap)
            if ending is not None and reach >= ending[0]:
                break
            if (place, interval) in done:
                continue
            done.add((place, interval))
            self._reached.add(place)
            until = self._intervals(place)[interval][1]
            if place in self._goals:
                end = max(now, times.first)
                if end <= min(times.last, grid[until] if until < len(grid) - 1 else times.last) and (
                    ending is None or end < ending[0]
                ):
                    ending = end, (place, interval)
            for other in self._near[place]:
                for k, arrival, departure in self._arrivals(place, other, now, until):
                    key = other, k
                    if key not in done and arrival < best.get(key, math.inf):
                        best[key], came[key] = arrival, ((place, interval), departure)
                        heapq.heappush(heap, (max(arrival, times.first) + bound[other], arrival, other, k))
        if ending is None:
            return None
        # Back from the goal to the start: each configuration with its arrival and departure.
        departure, key = ending
        goal, visits = self._goals.index(key[0]), [(key[0], best[key], departure)]
        while key in came:
            key, departure = came[key]
            visits.append((key[0], best[key], departure))
        # Forward as waits and edges.
        names, steps, parts = self._group.joint_names, list[_MotionStep](), list[Trajectory]()
        for (place, arrival, departure), following in zip_longest(visits[::-1], visits[-2::-1]):
            if departure - arrival > STEP * 1e-6:
                quintic = self._jerk is not None
                parts.append(Trajectory.at_rest(self.q[place], names, departure - arrival, quintic=quintic))
                steps.append(_MotionStep(arrival, departure, None, place))
            if following is not None and (edge := self._edges[place, following[0]]) is not None:
                parts.append(edge.motion)
                steps.append(_MotionStep(departure, departure + edge.duration, (place, following[0]), place))
        if not parts:
            return goal, Trajectory.at_rest(self.q[self._start], names), []
        return goal, Trajectory.join(*parts), steps

    def _arrivals(self, a: int, b: int, now: float, until: int) -> list[tuple[int, float, float]]:
        """The intervals of b that can be reached from a after ``now``: with the earliest arrival and its departure."""
        if (a, b) not in self._edges:  # the motion; None if its samples are in contact without the movers
            path = JointPath(np.array([self.q[a], self.q[b]]), self._group.joint_names)
            motion = _Edge(time_parametrise(path, self._limits, jerk=self._jerk))
            self._edges[a, b] = motion if self._steering.is_free_batch(motion.samples[1:-1]).all() else None
        edge = self._edges[a, b]
        if edge is None:
            return []
        grid, found = self._times.grid, []
        first = math.ceil(round(now / STEP, 6))
        for k, (low, high) in enumerate(self._intervals(b)):
            # The arm leaves a while it is safe there, and rests at b within the interval.
            begin = max(first, math.ceil(round((grid[low] - edge.duration) / STEP, 6)))
            end = min(until, math.floor(round((grid[high] - edge.duration) / STEP, 6)))
            # The first departure at which the edge is free, tried in growing groups.
            size = 1
            while begin <= end:
                tried = np.arange(begin, min(begin + size, end + 1))
                free = self._times.crossings(edge.samples, edge.offsets, STEP * tried.astype(float))
                departures = [i for i in tried[free].tolist() if (a, b, i) not in self._refused]
                if departures:
                    found.append((k, departures[0] * STEP + edge.duration, departures[0] * STEP))
                    break
                begin, size = begin + size, 4 * size
        return found

    def refuse(self, certificate: Certificate, steps: Sequence[_MotionStep]) -> None:
        """Remove the part of a motion that is not proven."""
        self.failures, self._last_failure = self.failures + 1, certificate.message
        time = certificate.fails_at
        failed = next((step for step in steps if time <= step.end + STEP * 1e-3), None)
        if failed is None:  # at rest at the goal
            self._free[self._start][0] = False
        elif failed.edge is not None:
            self._refused.add((*failed.edge, round(failed.start / STEP)))
        else:
            self._free[failed.at][min(round(time / STEP), len(self._times.grid) - 1)] = False

    def reason(self, start_time: float, tried: int) -> tuple[PlanStatus, str]:
        """Why no motion was found."""
        times, grid = self._times, self._times.grid
        inside = np.flatnonzero(grid >= times.first)
        if not any(times.free_at(self.q[goal], padded=False)[inside].any() for goal in self._goals):
            span = f"from {start_time + times.first:.4g} s to {start_time + times.last:.4g} s"
            found = self._contacts(self._goals[0], int(inside[0]))
            message = f"no goal is free of the movers {span}; goal 0 at {start_time + grid[inside[0]]:.4g} s: {found}"
            return PlanStatus.GOAL_INVALID, message
        message = f"no goal was reached before {start_time + times.last:.4g} s"
        blocked = np.flatnonzero(~self._free[self._start])
        if len(blocked):
            alone = "" if self._reached - {self._start} else ", and no waiting place is free"
            at, found = start_time + grid[blocked[0]], self._contacts(self._start, int(blocked[0]))
            message += f"; the arm must leave its start before {at:.4g} s ({found}){alone}"
        message += f"; {len(self._reached)} of {len(self.q)} configurations were reached in time"
        if self.failures:
            message += f"; {self.failures} motions failed the proof, the last: {self._last_failure}"
        message += f"; {tried} samples were tried. Try more samples, another rng or a later window"
        return PlanStatus.OUT_OF_BUDGET, message

    def _contacts(self, place: int, index: int) -> str:
        """The contacts of a configuration at a time of the grid."""
        times = self._times
        movers = times.clock(times.grid[index])[times.dof :]
        return str(times.steering.check(np.concatenate([self.q[place], movers])))
