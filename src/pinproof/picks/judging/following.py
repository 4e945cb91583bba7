"""The motion of a tool that follows a part on a conveyor.

The tool takes up the speed of the belt, approaches the part, tracks it while the gripper closes, lifts it, and comes to
rest. In the frame of the belt the approach and the retreat are the straight lines of the pick. The tool takes up the
speed before the approach, and gives it up after the retreat. Poses are solved at short time steps and joined by a cubic
Hermite curve with the joint velocities of the exact motion of the tool.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pinproof.ik import IkTask, track
from pinproof.motion import RATE_TOLERANCE, CubicPath, Trajectory
from pinproof.picks.input.conveyor import Conveyor
from pinproof.picks.input.pick import Member
from pinproof.picks.judging.task import PickTask
from pinproof.planning import Route, RouteFollower
from pinproof.spatial import SE3, Array, translated

TIME_STEP = 0.01
"""Seconds between solved poses."""

LINE_SPEED = 1.0
"""Mean speed (m/s) of the tool along the lines, relative to the belt, in the first attempt."""

SHORTEST = 0.1
"""Seconds: the shortest duration of a phase in the first attempt."""

RESERVE = 1.03
"""Factor by which a phase is made longer than its excess over the limits requires."""

LONGEST = 10.0
"""Seconds: a phase that would take longer is not possible."""

ATTEMPTS = 12
"""Number of attempts to find durations of the phases within the limits."""

ANY_SPEED = 1e3
"""rad/s or m/s: the limits of the joints are verified on the complete curve."""


@dataclass(frozen=True, eq=False)
class Following:
    """The motion from rest to the part, on the belt while the gripper closes, and until the tool rests with the part.

    The tracking begins ``before`` seconds after the start. The deviations (m, rad) are upper bounds, at every instant,
    of the distance of the tcp from its pose on the belt while tracking.
    """

    approach: Trajectory
    tracking: Trajectory | None
    retreat: Trajectory
    before: float
    position_deviation: float
    rotation_deviation: float


def follow_belt(task: PickTask, member: Member, q: Array, belt: Conveyor) -> Following | str:
    """The motion of a tool that is at the grasp with q (n,) when the tracking begins, or why it is not possible.

    ``task`` has all poses at the time at which the tracking begins.
    """
    grasp = task.grasp(member)
    lines = tuple(end.translation - grasp.translation for end in (task.pick.before(grasp), task.pick.after(grasp)))
    into, out = (max(float(np.linalg.norm(line)) / LINE_SPEED, SHORTEST) for line in lines)
    durations = np.array([SHORTEST, into, out, SHORTEST])
    reason = ""
    for _ in range(ATTEMPTS):
        phases = _Phases(task, grasp, belt, *lines, *np.round(durations, 6).tolist())
        found = _followed(phases, q)
        if not isinstance(found, _BeltExcess):
            return found
        reason = found.reason
        durations = durations * found.longer
        if not (durations <= LONGEST).all():
            break
    return reason


class _BeltExcess(NamedTuple):
    """Limits that are exceeded, and the factors (4,) by which the phases must take longer; infinite for no remedy."""

    reason: str
    longer: Array


@dataclass(frozen=True, eq=False)
class _Phases:
    """The pose of the tip as a function of time; time 0 is the start of the tracking.

    ``take_up`` and ``give_up`` are the durations in which the speed of the belt is taken up and given up, ``into`` and
    ``out`` those of the lines, whose displacements are ``approach`` and ``retreat``.
    """

    task: PickTask
    grasp: SE3
    belt: Conveyor
    approach: Array
    retreat: Array
    take_up: float
    into: float
    out: float
    give_up: float

    @property
    def times(self) -> tuple[float, ...]:
        """The ends of the phases: the start, at the speed of the belt, at the part, it is held, lifted, and the end."""
        dwell = round(self.belt.dwell, 6)
        return -self.take_up - self.into, -self.into, 0.0, dwell, dwell + self.out, dwell + self.out + self.give_up

    def offset(self, t: float) -> tuple[Array, Array]:
        """The displacement (3,) of the tip from the grasp at time 0, and its velocity."""
        start, begin, _, end, leave, last = self.times
        along, speed = np.array(self.belt.direction), self.belt.speed
        if t < begin:
            u = (t - start) / self.take_up
            moved, rate = begin - self.take_up * (0.5 - u**3 + 0.5 * u**4), u * u * (3.0 - 2.0 * u)
        elif t > leave:
            u = (last - t) / self.give_up
            moved, rate = leave + self.give_up * (0.5 - u**3 + 0.5 * u**4), u * u * (3.0 - 2.0 * u)
        else:
            moved, rate = t, 1.0
        down, falling = _smooth(-t / self.into)
        up, rising = _smooth((t - end) / self.out)
        place = speed * moved * along + down * self.approach + up * self.retreat
        velocity = speed * rate * along - falling / self.into * self.approach + rising / self.out * self.retreat
        return place, velocity

    def target(self, offset: Array) -> SE3:
        """``base_from_tcp`` for a displacement (3,) of the tip."""
        return self.task.target(translated(self.grasp, offset))


def _smooth(u: float) -> tuple[float, float]:
    """A smooth step from 0 at u = 0 to 1 at u = 1, and its derivative."""
    u = min(max(u, 0.0), 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u * u), 30.0 * u * u * (1.0 - u) ** 2


def _followed(phases: _Phases, q: Array) -> Following | _BeltExcess | str:
    arm, stops = phases.task.arm, phases.times
    before, after = _solved(phases, stops[2::-1], q), _solved(phases, stops[2:], q)
    if isinstance(before, str):
        return f"before the tool is at the part on the belt: {before}"
    if isinstance(after, str):
        return f"while the tool follows the belt: {after}"
    times = np.concatenate([before[0][::-1], after[0][1:]])
    points = np.concatenate([before[1][::-1], after[1][1:]])
    rotation = arm.root_from_base.rotation.T
    velocities = np.array(
        [
            np.linalg.pinv(arm.jacobian(each)) @ np.concatenate([rotation @ phases.offset(t)[1], np.zeros(3)])
            for t, each in zip(times.tolist(), points, strict=True)
        ]
    )
    velocities[[0, -1]] = 0.0
    note = f"acceleration limits: {arm.limits.acceleration_source}"

    def part(first: int, last: int) -> Trajectory:
        rows = slice(*(int(np.argmin(np.abs(times - stops[k]))) + extra for k, extra in ((first, 0), (last, 1))))
        return Trajectory(times[rows] - times[rows][0], points[rows], velocities[rows], arm.joint_names, note)

    tracking = part(2, 3) if stops[3] > stops[2] else None
    pieces = [part(0, 1), part(1, 2), part(3, 4), part(4, 5)]
    if (excess := _excess(phases.task, pieces, tracking)) is not None:
        return excess
    position, turned = (0.0, 0.0) if tracking is None else _deviation(phases, tracking)
    return Following(part(0, 2), tracking, part(3, 5), stops[2] - stops[0], position, turned)


def _solved(phases: _Phases, stops: Sequence[float], q: Array) -> tuple[Array, Array] | str:
    """The times and configurations through the ends of phases, in either direction; q (n,) is at the first one."""
    spans = [np.linspace(a, b, max(3, int(np.ceil(abs(b - a) / TIME_STEP))) + 1) for a, b in pairwise(stops) if a != b]
    times = np.concatenate([spans[0], *(span[1:] for span in spans[1:])])
    targets = [phases.target(phases.offset(t)[0]) for t in times[1:].tolist()]
    solved = track(phases.task.arm, targets, q, dt=1.0, velocity=ANY_SPEED)
    if not solved.ok:
        return solved.message
    return times, np.vstack([q, solved.q])


def _excess(task: PickTask, pieces: Sequence[Trajectory], tracking: Trajectory | None) -> _BeltExcess | None:
    """The limits of the joints that are exceeded; None if all are kept."""
    limits, names = task.arm.limits, task.arm.joint_names
    longer, reason = np.ones(len(pieces)), ""
    for k, part in enumerate([*pieces, *([] if tracking is None else [tracking])]):
        for what, most, limit, power, unit in (
            ("speed", part.max_velocity(), limits.velocity, 1.0, "rad/s"),
            ("acceleration", part.max_acceleration(), limits.acceleration, 0.5, "rad/s^2"),
        ):
            joint = int(np.argmax(most / limit))
            share = float(most[joint] / limit[joint])
            if share <= 1.0 + RATE_TOLERANCE:
                continue
            reason = f"to follow the belt, the {what} of {names[joint]} is {most[joint]:.3g} {unit}"
            reason += f"; its limit is {limit[joint]:.3g} {unit}"
            if k == len(pieces):  # the speed of the belt is given
                return _BeltExcess(reason, np.full(len(pieces), np.inf))
            longer[k] = max(longer[k], RESERVE * share**power)
        for outside in part.range():
            if exceeded := limits.violations(outside, names):
                return _BeltExcess(f"to follow the belt: {exceeded[0]}", np.full(len(pieces), np.inf))
    return _BeltExcess(reason, longer) if reason else None


def _deviation(phases: _Phases, tracking: Trajectory) -> tuple[float, float]:
    """Upper bounds (m, rad) of the deviation from the line at constant speed, at every instant."""
    ends = [phases.target(phases.offset(t)[0]) for t in (0.0, tracking.duration)]
    share = tracking.times / tracking.duration
    path = CubicPath(tracking.q, tracking.velocities * tracking.duration, share, tracking.joint_names)
    follower = RouteFollower(
        arm=phases.task.arm,
        task=IkTask(),
        deviation=1e-3,
        rotation_deviation=1e-2,
        translation_step=0.05,
        rotation_step=0.2,
        max_joint_step=0.3,
    )
    bounds = follower.bound(path, Route.straight(*ends)).max(axis=0)
    return float(bounds[0]), float(bounds[1])
