"""The motion of a joint group as one trajectory for each arm, as controllers need it, and back: one common clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.model import JointGroup
from pinproof.motion.rate_limits import require_joints
from pinproof.motion.trajectory import Trajectory
from pinproof.motion.trajectory_files import NANO, seconds, whole_nanoseconds
from pinproof.spatial import Array

# Largest difference (rad or m) of the combined trajectory from its parts; rounding is smaller.
SAME_CURVE = 1e-9
# Where in each piece the curves are compared. The difference is a polynomial of degree 5 at most, which is bounded by
# 2.2 times the largest value at these Chebyshev nodes.
PLACES = np.cos(np.pi * (np.arange(7) + 0.5) / 7) / 2 + 0.5


def separate(trajectory: Trajectory, group: JointGroup) -> dict[str, Trajectory]:
    """Return the trajectory of each arm of a group by name; all have points at the times of the given trajectory.

    The joints of a cell that :func:`pinproof.assemble` made have the names of their own robots again, without prefix.
    :func:`synchronise` restores the trajectory of the group exactly.

    Raises
    ------
    InputError
        If the trajectory does not move the joints of the group, or two arms share a joint.
    """
    require_joints(group, trajectory)
    _refuse_shared(group)
    record = trajectory.record()
    return {
        name: Trajectory.of_record(record.columns(group.indices(name), own_names(group, name))) for name in group.ends
    }


def own_names(group: JointGroup, arm: str) -> tuple[str, ...]:
    """The joints of an arm with the names in the description of its robot: in a cell, without prefix."""
    names = [group.joint_names[i] for i in group.indices(arm)]
    part = group.robot.part_of(group.ends[arm][0])
    skipped = 0 if part is None else len(part) + 1
    return tuple(name[skipped:] for name in names)


def synchronise(trajectories: Mapping[str, Trajectory], group: JointGroup, *, wait: bool = False) -> Trajectory:
    """Combine the trajectories of all arms of a group, which start at the same time, into one of the group.

    The result has the points in time of all trajectories. Between them it is the same motion up to rounding.

    Parameters
    ----------
    trajectories
        For each arm of the group its trajectory; joints are matched by name, in a cell with or without the prefix.
    group
        The joint group.
    wait
        Whether an arm whose trajectory is shorter rests at its end until the last arm arrives.

    Raises
    ------
    UnknownNameError
        If the group has no arm of a name.
    InputError
        If an arm or a joint is missing, two arms share a joint, the interpolants differ, the durations differ and
        ``wait`` is False, or an arm that would have to wait does not rest at its end.
    """
    _refuse_shared(group)
    for name in trajectories:
        group.indices(name)  # raises for an unknown arm
    if missing := [name for name in group.ends if name not in trajectories]:
        raise InputError(f"there is no trajectory of the arms {', '.join(missing)}; an arm at rest has a single point")
    parts = []
    for name in group.ends:
        given, columns = trajectories[name], group.indices(name)
        own, full = own_names(group, name), tuple(group.joint_names[i] for i in columns)
        names = next((names for names in (own, full) if set(given.joint_names) == set(names)), None)
        if names is None:
            raise InputError(
                f"the trajectory of arm {name!r} has the joints {given.joint_names}; the joints of the arm are {own}"
            )
        order = [given.joint_names.index(joint) for joint in names]
        parts.append(TimedColumns(f"arm {name!r}", given, order, columns))
    return merged(parts, group.joint_names, wait=wait)


class TimedColumns(NamedTuple):
    """A trajectory that moves some joints of a combined one."""

    name: str
    """For messages."""
    trajectory: Trajectory
    order: list[int]
    """The columns of the trajectory."""
    columns: npt.NDArray[np.int64]
    """The joints of the combined trajectory that these columns move."""


def merged(
    parts: Sequence[TimedColumns], joint_names: tuple[str, ...], *, wait: bool = False, duration: float | None = None
) -> Trajectory:
    """Combine trajectories of different joints on a common clock; see :func:`synchronise`.

    The result ends at ``duration`` (s), by default with the last of its parts.
    """
    clocks = [whole_nanoseconds(part.trajectory.times) for part in parts]
    last = max(int(clock[-1]) for clock in clocks) if duration is None else round(duration * NANO)
    for part, clock in zip(parts, clocks, strict=True):
        trajectory = part.trajectory
        if int(clock[-1]) >= last or len(clock) == 1:  # a trajectory with a single point rests
            continue
        if not wait:
            durations = ", ".join(f"{one.name} {one.trajectory.duration:.6g} s" for one in parts)
            raise InputError(f"the trajectories have different durations: {durations}; wait=True lets the others rest")
        if trajectory.velocities[-1].any() or (
            trajectory.accelerations is not None and trajectory.accelerations[-1].any()
        ):
            raise InputError(f"{part.name} moves at the end of its trajectory, so that it cannot wait there")
    quintic = any(part.trajectory.accelerations is not None and len(part.trajectory.times) > 1 for part in parts)
    times = np.unique(np.concatenate([*(clock[clock <= last] for clock in clocks), [0, last]]))
    states = np.zeros((3, len(times), len(joint_names)))  # positions, velocities, accelerations
    for part, clock in zip(parts, clocks, strict=True):
        trajectory, order, columns = part.trajectory, part.order, part.columns
        own = (
            trajectory.acceleration(trajectory.times) if trajectory.accelerations is None else trajectory.accelerations
        )
        at, known = np.searchsorted(clock, times), np.isin(times, clock)
        inside = times <= clock[-1]
        then = seconds(times[inside])
        states[0][np.ix_(~inside, columns)] = trajectory.q[-1, order]
        functions: tuple[Callable[[Array], Array], ...] = (trajectory, trajectory.velocity, trajectory.acceleration)
        for rows, evaluate, points in zip(states, functions, (trajectory.q, trajectory.velocities, own), strict=True):
            rows[np.ix_(inside, columns)] = evaluate(then)[:, order]
            # At its own points a trajectory keeps its own numbers, so that nothing is rounded.
            rows[np.ix_(known, columns)] = points[at[known]][:, order]
    note = "; ".join(dict.fromkeys(part.trajectory.limits_note for part in parts if part.trajectory.limits_note))
    q, velocities, accelerations = states if quintic else (*states[:2], None)
    whole = Trajectory(seconds(times), q, velocities, joint_names, note, accelerations=accelerations)
    # Each part moves its joints as before, which a quintic cannot where the acceleration of a part jumps.
    t = (whole.times[:-1, None] + np.diff(whole.times)[:, None] * PLACES).ravel()
    for part in parts if quintic else ():
        expected = part.trajectory(np.minimum(t, part.trajectory.duration))[:, part.order]
        if np.abs(whole(t)[:, part.columns] - expected).max(initial=0.0) > SAME_CURVE:
            raise InputError(
                f"{part.name} has accelerations that jump, and another trajectory is quintic; time all of them with or "
                "all without a jerk limit"
            )
    return whole


def _refuse_shared(group: JointGroup) -> None:
    if shared := group.shared_joints:
        raise InputError(
            f"the joints {', '.join(shared)} belong to several arms, so that the arms have no trajectories of their "
            "own; save the trajectory of the group"
        )
