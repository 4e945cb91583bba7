"""The motion of a joint group as one trajectory for each arm, as controllers need it, and back: one common clock."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinproof.errors import InputError
from pinproof.model import JointGroup
from pinproof.motion.tool_limits import require_joints
from pinproof.motion.trajectory import Trajectory
from pinproof.motion.trajectory_files import seconds, whole_nanoseconds

__all__ = ["separate", "synchronise"]


def separate(trajectory: Trajectory, group: JointGroup) -> dict[str, Trajectory]:
    """Return the trajectory of each arm of a group, by the name of the arm, all with the points in time of the whole.

    The joints of a cell that :func:`pinproof.assemble` made have the names of their own robots again, without prefix.
    :func:`synchronise` restores the trajectory of the group exactly.

    Raises
    ------
    InputError
        If the joints of the trajectory are not those of the group, or two arms share a joint.
    """
    require_joints(group, trajectory)
    _refuse_shared(group)
    return {name: _columns(trajectory, group, name) for name in group.ends}


def _columns(trajectory: Trajectory, group: JointGroup, arm: str) -> Trajectory:
    index = group.indices(arm)
    return Trajectory(
        trajectory.times,
        trajectory.q[:, index],
        trajectory.velocities[:, index],
        own_names(group, arm),
        trajectory.limits_note,
        accelerations=None if trajectory.accelerations is None else trajectory.accelerations[:, index],
    )


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
    ordered = {name: trajectories[name] for name in group.ends}
    clocks = {name: whole_nanoseconds(each.times) for name, each in ordered.items()}
    kinds = {name: each.interpolant for name, each in ordered.items() if len(each.times) > 1}
    if len(set(kinds.values())) > 1:
        raise InputError(f"the trajectories are of different kinds: {kinds}; time all with or all without a jerk limit")
    last = max(int(clock[-1]) for clock in clocks.values())
    for name, each in ordered.items():
        end = int(clocks[name][-1])
        if end == last or len(each.times) == 1:  # an arm with a single point rests
            continue
        if not wait:
            durations = ", ".join(f"{arm} {one.duration:.6g} s" for arm, one in ordered.items())
            raise InputError(f"the trajectories have different durations: {durations}; wait=True lets the others rest")
        if each.velocities[-1].any() or (each.accelerations is not None and each.accelerations[-1].any()):
            raise InputError(f"arm {name!r} moves at the end of its trajectory, so that it cannot wait there")
    times = np.unique(np.concatenate([*clocks.values(), [0, last]]))
    quintic = "quintic" in kinds.values()
    q, velocities, accelerations = (np.zeros((len(times), group.dof)) for _ in range(3))
    for name, each in ordered.items():
        order, columns = _order(each, group, name), group.indices(name)
        at, known = np.searchsorted(clocks[name], times), np.isin(times, clocks[name])
        inside = times <= clocks[name][-1]
        then = seconds(times[inside])
        q[np.ix_(inside, columns)] = each(then)[:, order]
        q[np.ix_(~inside, columns)] = each.q[-1, order]
        velocities[np.ix_(inside, columns)] = each.velocity(then)[:, order]
        accelerations[np.ix_(inside, columns)] = each.acceleration(then)[:, order]
        # At its own points an arm keeps its own numbers, so that nothing is rounded.
        q[np.ix_(known, columns)] = each.q[at[known]][:, order]
        velocities[np.ix_(known, columns)] = each.velocities[at[known]][:, order]
        if each.accelerations is not None:
            accelerations[np.ix_(known, columns)] = each.accelerations[at[known]][:, order]
    note = "; ".join(dict.fromkeys(each.limits_note for each in ordered.values() if each.limits_note))
    return Trajectory(
        seconds(times), q, velocities, group.joint_names, note, accelerations=accelerations if quintic else None
    )


def _order(trajectory: Trajectory, group: JointGroup, arm: str) -> list[int]:
    """The columns of a trajectory in the order of the joints of an arm."""
    own, full = own_names(group, arm), tuple(group.joint_names[i] for i in group.indices(arm))
    for names in (own, full):
        if set(trajectory.joint_names) == set(names):
            return [trajectory.joint_names.index(name) for name in names]
    raise InputError(
        f"the trajectory of arm {arm!r} has the joints {trajectory.joint_names}; those of the arm are {own}"
    )


def _refuse_shared(group: JointGroup) -> None:
    if shared := group.shared_joints:
        raise InputError(
            f"the joints {', '.join(shared)} belong to several arms, so that the arms have no trajectories of their "
            "own; save the trajectory of the group"
        )
