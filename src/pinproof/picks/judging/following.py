"""The motion of a tool that follows a part on a conveyor.

The tool takes up the speed of the belt, approaches the part, tracks it while the gripper closes, lifts it, and comes to
rest. In the frame of the belt the approach and the retreat are the straight lines of the pick. The tool takes up the
speed before the approach, and gives it up after the retreat. Poses are solved at short time steps and joined by a cubic
Hermite curve with the joint velocities of the exact motion of the tool.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pinproof.ik import IkTask, track
from pinproof.motion import CubicPath, Trajectory
from pinproof.motion.limits import RATE_TOLERANCE
from pinproof.picks.input.conveyor import Conveyor
from pinproof.picks.input.pick import Member
from pinproof.picks.judging.task import Task
from pinproof.planning.follow import RouteFollower
from pinproof.planning.route import Route
from pinproof.spatial import SE3

__all__ = ["Following", "follow_belt"]

Array = npt.NDArray[np.float64]

TIME_STEP = 0.01
"""Seconds between solved poses."""

LINE_SPEED = 0.6
"""Mean speed (m/s) of the tool along the lines, relative to the belt, in the first attempt."""

SHORTEST = 0.15
"""Seconds: the shortest duration of a phase in the first attempt."""

SLOWER = 1.3
"""Factor by which the phases take longer in the next attempt."""

ATTEMPTS = 12
"""Number of attempts; in the last one the phases take 18 times as long as in the first one."""

ANY_SPEED = 1e3
"""rad/s or m/s: the limits of the joints are verified on the complete curve."""


@dataclass(frozen=True, eq=False)
class Following:
    """The motion from rest to rest, in three parts with the times (s) of their ends from its start.

    Parameters
    ----------
    approach, tracking, retreat
        From rest until the tool is at the part, while the gripper closes, and until the tool rests with the part.
    before
        Seconds from the start to the begin of the tracking.
    position_deviation, rotation_deviation
        Upper bounds (m, rad) of the deviation of the tcp from its pose on the belt while tracking, at every instant.
    """

    approach: Trajectory
    tracking: Trajectory | None
    retreat: Trajectory
    before: float
    position_deviation: float
    rotation_deviation: float


def follow_belt(task: Task, member: Member, q: Array, belt: Conveyor) -> Following | str:
    """The motion of a tool that is at the grasp with q (n,) when the tracking begins, or why it is not possible.

    Parameters
    ----------
    task
        The pick with all poses at the time at which the tracking begins.
    """
    reason = ""
    for attempt in range(ATTEMPTS):
        phases = _Phases.of(task, member, belt, SLOWER**attempt)
        found = _followed(phases, q)
        if not isinstance(found, str):
            return found
        reason = found
        if phases.ramp + phases.into > belt.duration:
            break
    return reason


@dataclass(frozen=True, eq=False)
class _Phases:
    """The pose of the tip as a function of time; time 0 is the begin of the tracking.

    ``ramp`` is the duration of taking up and of giving up the speed, ``into`` and ``out`` those of the lines.
    """

    task: Task
    grasp: SE3
    belt: Conveyor
    ramp: float
    into: float
    out: float
    approach: Array
    retreat: Array

    @classmethod
    def of(cls, task: Task, member: Member, belt: Conveyor, factor: float) -> _Phases:
        grasp = task.grasp(member)
        approach = task.approach_end(grasp).translation - grasp.translation
        retreat = task.retreat_end(grasp).translation - grasp.translation
        ramp, into, out = (
            _rounded(factor * max(length / LINE_SPEED, SHORTEST))
            for length in (0.0, float(np.linalg.norm(approach)), float(np.linalg.norm(retreat)))
        )
        return cls(task, grasp, belt, ramp, into, out, approach, retreat)

    @property
    def times(self) -> tuple[float, float, float, float]:
        """The start, the begin of the tracking, its end, and the end of the motion."""
        dwell = _rounded(self.belt.dwell)
        return -self.ramp - self.into, 0.0, dwell, dwell + self.out + self.ramp

    def offset(self, t: float) -> tuple[Array, Array]:
        """The displacement (3,) of the tip from the grasp at time 0, and its velocity."""
        start, _, end, last = self.times
        along, speed = np.array(self.belt.direction), self.belt.speed
        begin, leave = start + self.ramp, last - self.ramp  # at the speed of the belt
        if t < begin:
            u = (t - start) / self.ramp
            moved, rate = begin - self.ramp * (0.5 - u**3 + 0.5 * u**4), u * u * (3.0 - 2.0 * u)
        elif t > leave:
            u = (last - t) / self.ramp
            moved, rate = leave + self.ramp * (0.5 - u**3 + 0.5 * u**4), u * u * (3.0 - 2.0 * u)
        else:
            moved, rate = t, 1.0
        down, falling = _smooth(-t / self.into)
        up, rising = _smooth((t - end) / self.out)
        place = speed * moved * along + down * self.approach + up * self.retreat
        velocity = speed * rate * along - falling / self.into * self.approach + rising / self.out * self.retreat
        return place, velocity

    def target(self, offset: Array) -> SE3:
        """``base_from_tcp`` for a displacement (3,) of the tip."""
        return self.task.target(SE3(self.grasp.rotation, self.grasp.translation + offset))


def _smooth(u: float) -> tuple[float, float]:
    """A smooth step from 0 at u = 0 to 1 at u = 1, and its derivative."""
    u = min(max(u, 0.0), 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u * u), 30.0 * u * u * (1.0 - u) ** 2


def _rounded(seconds: float) -> float:
    return round(seconds, 6)


def _followed(phases: _Phases, q: Array) -> Following | str:
    arm = phases.task.arm
    start, begin, end, last = phases.times
    before, after = _solved(phases, begin, start, q), _solved(phases, begin, last, q, through=end)
    if isinstance(before, str):
        return f"while the tool takes up the speed of the belt: {before}"
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
    names, note = arm.joint_names, f"acceleration limits: {arm.limits.acceleration_source}"
    cuts = [int(np.argmin(np.abs(times - cut))) for cut in (begin, end)]
    rows = [slice(None, cuts[0] + 1), slice(cuts[1], None), slice(cuts[0], cuts[1] + 1)]
    parts = [
        Trajectory(times[row] - times[row][0], points[row], velocities[row], names, note)
        for row in rows[: 2 + (end > begin)]
    ]
    if wrong := _violated(phases.task, parts):
        return wrong
    tracking = parts[2] if end > begin else None
    position, turned = (0.0, 0.0) if tracking is None else _deviation(phases, tracking)
    return Following(parts[0], tracking, parts[1], begin - start, position, turned)


def _solved(
    phases: _Phases, first: float, last: float, q: Array, through: float | None = None
) -> tuple[Array, Array] | str:
    """The times and configurations from ``first`` to ``last``, in either direction; q (n,) is that at ``first``."""
    stops = [first, last] if through is None or through == first else [first, through, last]
    spans = [np.linspace(a, b, max(3, int(np.ceil(abs(b - a) / TIME_STEP))) + 1) for a, b in pairwise(stops)]
    times = np.concatenate([spans[0], *(span[1:] for span in spans[1:])])
    targets = [phases.target(phases.offset(t)[0]) for t in times[1:].tolist()]
    solved = track(phases.task.arm, targets, q, dt=1.0, velocity=ANY_SPEED)
    if not solved.ok:
        return solved.message
    return times, np.vstack([q, solved.q])


def _violated(task: Task, parts: list[Trajectory]) -> str:
    """The first limit of the joints that a part exceeds; empty if all are kept."""
    limits, names = task.arm.limits, task.arm.joint_names
    for name, part in zip(("the approach to", "the retreat from", "following"), parts, strict=False):
        for what, most, limit, unit in (
            ("speed", part.max_velocity(), limits.velocity, "rad/s"),
            ("acceleration", part.max_acceleration(), limits.acceleration, "rad/s^2"),
        ):
            joint = int(np.argmax(most / limit))
            if most[joint] > limit[joint] * (1.0 + RATE_TOLERANCE):
                words = f"{most[joint]:.3g} {unit}; its limit is {limit[joint]:.3g}"
                return f"{name} the belt, the {what} of {names[joint]} is {words}"
        low, high = part.range()
        for outside in (low, high):
            if exceeded := limits.violations(outside, names):
                return f"{name} the belt: {exceeded[0]}"
    return ""


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
