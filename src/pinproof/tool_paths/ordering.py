"""Several strokes in one motion: their order, directions and start points with the shortest time, certified."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.cell import Precedence, TourProblem
from pinproof.collision import Certificate, CollisionChecker, certify
from pinproof.common.results import Rows, Solution, View
from pinproof.common.structs import described, key
from pinproof.common.validation import require_integer, require_type
from pinproof.errors import InputError
from pinproof.motion import Bounds, Trajectory, least_times
from pinproof.planning import MotionPlan, PlannedMotion, plan
from pinproof.tool_paths.following import follow
from pinproof.tool_paths.pictures import pictured
from pinproof.tool_paths.result import FollowPlan, FollowStatus
from pinproof.tool_paths.strokes import Stroke

# The node before the first and after the last stroke: home, or nothing.
HOME = -1
# Number of times that strokes without a transit are followed from other configurations.
ALTERNATIVES = 2


@described(eq=False)
class FollowedStroke:
    """A stroke at its place in the order."""

    stroke: Stroke = key("the stroke as it is followed: from its start point, in its direction")
    start: int = key("the index of its first pose in the stroke as given; not 0 only if that is closed")
    reverse: bool = key("whether it is followed from its end to its start")
    begin: float = key("when its motion begins, with the approach; NaN if another stroke cannot be followed", "s")
    plan: FollowPlan = key("its motion")


@described(eq=False)
class StrokesPlan(PlannedMotion):
    """A certified motion along several strokes, or why there is none; result of :func:`follow_all`."""

    not_pickled = ("checker",)

    status: FollowStatus = key("FOUND if there is a motion that is proven, else the reason")
    message: str = key("the outcome as text")
    steps: tuple[FollowedStroke, ...] = key(
        "the strokes in the order in which they are followed, or those that can be followed", default=()
    )
    transits: tuple[MotionPlan, ...] = key("the motions between them, and from and to home if it is stated", default=())
    failed: tuple[tuple[str, FollowPlan], ...] = key(
        "the strokes that cannot be followed by any start point and direction, with the reasons", default=()
    )
    trajectory: Solution[Trajectory] = key("the whole motion, if FOUND", default=Solution())
    certificate: Solution[Certificate] = key("the FREE certificate of the motion, if FOUND", default=Solution())
    bound: float = key(
        "lower bound of the time of every order of the motions along strokes that were compared, whatever the transits",
        "s", default=0.0,
    )  # fmt: skip
    variants: int = key("number of start points and directions that were compared", default=0)
    checker: Solution[CollisionChecker] = key("the checker of the certificate", default=Solution())

    @property
    def ok(self) -> bool:
        """Whether a motion was found that is proven."""
        return self.status is FollowStatus.FOUND

    def to_dict(self) -> dict[str, Any]:
        """The order and the figures as plain values for JSON."""
        steps = [
            {"name": own.stroke.name, "start": own.start, "reverse": own.reverse}
            | {"begin": None if math.isnan(own.begin) else own.begin}
            | {"process": own.stroke.process, "plan": own.plan.to_dict()}
            for own in self.steps
        ]
        failed = [{"name": name, "plan": plan.to_dict()} for name, plan in self.failed]
        found = {"ok": self.ok, "status": self.status.name, "message": self.message, "steps": steps, "failed": failed}
        if self.ok:
            found |= {"duration": self.duration, "certificate": self.certificate.to_dict()}
        return found | {"bound": self.bound, "variants": self.variants}

    def _pictured(self) -> tuple[Trajectory | None, dict[str, Any]]:
        content = pictured({**dict(self.failed), **{own.stroke.name: own.plan for own in self.steps}})
        return (self.trajectory, {**content, "certificate": self.certificate}) if self.ok else (None, content)

    def _view(self) -> View:
        rows = [
            [own.stroke.name, own.start, "backwards" if own.reverse else "", own.begin, own.plan.duration]
            for own in self.steps
        ]
        table = Rows(("stroke", "start", "direction", "begin [s]", "time [s]"), rows) if rows else None
        reasons = [f"{name}: {plan.message}" for name, plan in self.failed]
        return View(f"{self.status.name}: {self.message}", [table, reasons], reasons, title=self.message)


def follow_all(
    checker: CollisionChecker,
    strokes: Iterable[Stroke],
    *,
    home: npt.ArrayLike | None = None,
    starts: int = 4,
    transits: int = 60,
    rng: int = 0,
    **options: Any,
) -> StrokesPlan:
    """Follow several strokes in the order, the directions and from the start points with the shortest certified time.

    Every stroke is followed in both directions, if it is reversible, and from several start points, if it is closed.
    The order is chosen by lower bounds of the times of transits; then they are planned, and the certified times replace
    the bounds until the best order consists of certified motions. For up to ten strokes, it is then the optimum over
    these motions. If transits fail, strokes are also followed from other configurations.

    Parameters
    ----------
    checker
        The arm in its scene, with its tool.
    strokes
        The strokes in the base frame of the arm, with different names; see :meth:`ToolJob.placed`.
    home
        (n,) the configuration from which the motion starts and to which it leads; by default, it starts at the approach
        of the first stroke and ends behind the last one.
    starts
        Number of start points of a closed stroke that are compared, evenly along it.
    transits
        Largest number of rounds in which transits are planned.
    rng
        Seed of the search for orders of more than ten strokes, and of plans.
    **options
        Those of :func:`pinproof.follow`, such as ``approach`` and ``cost``.

    Raises
    ------
    InputError
        If there is no stroke, names are not unique, or an option of :func:`pinproof.follow` is wrong.
    """
    require_type("checker", checker, CollisionChecker)
    require_integer("starts", starts, 1)
    require_integer("transits", transits, 1)
    given, arm = tuple(strokes), checker.group
    for index, stroke in enumerate(given):
        require_type(f"strokes[{index}]", stroke, Stroke)
    names = [stroke.name for stroke in given]
    if not given or len(set(names)) < len(names):
        raise InputError("there must be at least one stroke, and their names must differ")
    if own_options := sorted({"start", "avoid"} & options.keys()):
        raise InputError(f"{own_options[0]} is an option of follow only; state home")
    place = None if home is None else arm.limits.snap(arm.configuration(home, "home"))
    # The motion along each stroke, from each start point and in each direction
    choices: list[tuple[int, Stroke, int, bool, FollowPlan]] = []
    failed: list[tuple[str, FollowPlan]] = []
    for job, stroke in enumerate(given):
        at = np.concatenate([[0.0], np.cumsum(stroke.path.lengths)])
        firsts = np.searchsorted(at, np.arange(starts if stroke.closed else 1) * at[-1] / starts) if at[-1] else [0]
        plans = []
        for start in dict.fromkeys(int(k) for k in firsts):
            for reverse in (False, True)[: 1 + stroke.reversible]:
                variant = stroke.variant(start, reverse=reverse)
                plans.append(follow(checker, variant.path, rng=rng, **options))
                if plans[-1].ok:
                    choices.append((job, variant, start, reverse, plans[-1]))
        if not any(each.ok for each in plans):
            failed.append((stroke.name, plans[0]))
    figures: dict[str, Any] = {"checker": checker, "variants": len(choices), "failed": tuple(failed)}
    if failed:
        name, reason = failed[0]
        passable = {job: (variant, start, reverse, made) for job, variant, start, reverse, made in reversed(choices)}
        figures["steps"] = tuple(
            FollowedStroke(variant, start, reverse, math.nan, made)
            for _, (variant, start, reverse, made) in sorted(passable.items())
        )
        more = f"; and {len(failed) - 1} more stroke{'s' * (len(failed) > 2)}" if len(failed) > 1 else ""
        return StrokesPlan(reason.status, f"stroke {name!r}: {reason.message}{more}", **figures)
    # The order by lower bounds, which certified times replace until the best order has none of them left. If no order
    # has all transits, the strokes at those that failed are also followed from other configurations
    bounds, precedence = Bounds.of(arm.limits, arm.joint_names), Precedence(tuple(names))
    known: dict[tuple[int, int], MotionPlan] = {}
    best: tuple[float, tuple[int, ...]] = (np.inf, ())
    for _ in range(ALTERNATIVES + 1):
        first = np.array([own[-1].trajectory.start for own in choices])
        last = np.array([own[-1].trajectory.end for own in choices])
        times = np.zeros((len(choices) + 1, len(choices) + 1))  # the last row and column are those of HOME
        times[:HOME, :HOME] = [least_times(first - q, bounds) for q in last]
        if place is not None:
            times[HOME, :HOME], times[:HOME, HOME] = (least_times(end - place, bounds) for end in (first, last))
        seconds, jobs = np.array([own[-1].duration for own in choices]), np.array([own[0] for own in choices])
        problem = TourProblem(jobs, times[HOME, :HOME], times[:HOME, HOME], seconds, times[:HOME, :HOME], precedence)
        figures |= {"bound": problem.lower_bound(), "variants": len(choices)}  # whatever was planned before
        for arc, own in known.items():
            times[arc] = own.duration if own.ok else np.inf
        for _ in range(transits):
            problem = TourProblem(
                jobs, times[HOME, :HOME], times[:HOME, HOME], seconds, times[:HOME, :HOME], precedence
            )
            tour = problem.solve(rng=rng)
            arcs = _arcs(tour.options, home=place is not None)
            new = [arc for arc in arcs if arc not in known]
            for a, b in new:
                begin, end = place if a == HOME else last[a], place if b == HOME else first[b]
                known[a, b] = plan(checker, begin, end, rng=rng)  # type: ignore[arg-type]  # home is stated for its arcs
                times[a, b] = known[a, b].duration if known[a, b].ok else np.inf  # also that of the problem
            best = min(best, (problem.seconds(tour.options), tour.options))
            if not new:
                break
        if np.isfinite(best[0]):
            break
        count = len(choices)
        for number in sorted({k for arc, own in known.items() if not own.ok for k in arc if k != HOME}):
            job, variant, start, reverse, _ = choices[number]
            begins = [own[-1].trajectory.start for own in choices if (own[0], *own[2:4]) == (job, start, reverse)]
            other = follow(checker, variant.path, avoid=begins, rng=rng, **options)
            if other.ok:
                choices.append((job, variant, start, reverse, other))
        if len(choices) == count:
            break
        # The choices remain in the order of their jobs
        ranked = sorted(range(len(choices)), key=lambda k: choices[k][0])
        moved = {HOME: HOME} | {k: number for number, k in enumerate(ranked)}
        choices = [choices[k] for k in ranked]
        known = {(moved[a], moved[b]): own for (a, b), own in known.items()}
    if not np.isfinite(best[0]):
        why = next(each.message for each in known.values() if not each.ok)
        return StrokesPlan(FollowStatus.NO_TRANSIT, f"no transit between the strokes: {why}", **figures)
    # The whole motion
    parts: list[Trajectory] = []
    steps: list[FollowedStroke] = []
    arcs = _arcs(best[1], home=place is not None)
    for a, b in arcs if place is not None else [(HOME, best[1][0]), *arcs]:
        if (a, b) in known:
            parts.append(known[a, b].trajectory)
        if b != HOME:
            _, variant, start, reverse, made = choices[b]
            steps.append(FollowedStroke(variant, start, reverse, sum(part.duration for part in parts), made))
            parts.append(made.trajectory)
    figures |= {"steps": tuple(steps), "transits": tuple(known[arc] for arc in arcs)}
    whole = Trajectory.join(*[part for part in parts if part.duration > 0.0] or parts[:1])
    certificate = certify(whole, checker)
    if not certificate.free:
        return StrokesPlan(FollowStatus.NOT_PROVEN, certificate.message, certificate=certificate, **figures)
    order = ", ".join(f"{step.stroke.name}{' backwards' if step.reverse else ''}" for step in steps)
    followed = f"{len(steps)} stroke{'s' if len(steps) > 1 else ''}"
    message = f"follows {followed} in {whole.duration:.2f} s: {order}; {certificate.message}"
    return StrokesPlan(FollowStatus.FOUND, message, trajectory=whole, certificate=certificate, **figures)


def _arcs(options: tuple[int, ...], *, home: bool) -> list[tuple[int, int]]:
    """The arcs of a tour, with those from and to home if it is stated."""
    return list(pairwise((HOME, *options, HOME) if home else options))
