"""Obstacles that move with time: conveyors, rotary tables, doors, and other arms on their trajectories.

A mover is a joint whose value is a given function of time. Together with the joints of the arm it forms a larger joint
group, and the motion of all of them on a common clock is one trajectory. Hence the certificate of the arm among movers,
over space and time, is the ordinary certificate of that trajectory: the bisection bounds the motion of the arm and of
the movers in the same interval of time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from pinproof.collision.checking.checker import CollisionChecker
from pinproof.collision.geometry.shapes import HalfSpace
from pinproof.common.structs import described, key
from pinproof.description import Axis, JointType, urdf_with_axes
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import JointGroup, JointLimits, Robot, chain_of, held_values
from pinproof.motion import Curve, TimedColumns, Trajectory, merged
from pinproof.spatial import SE3, Array, finite

FARTHEST = 30.0
"""Metres. Longer travel would exceed the allowance for rounding of the distances."""

MoverType = Literal["prismatic", "revolute"]


@described(eq=False)
class Mover:
    """Obstacles that move together along an axis, as a given function of time.

    Raises
    ------
    InputError
        If there is no obstacle, the trajectory has several joints, a number is not finite, or the axis has no length.
    """

    name: str = key("name of the mover, different from those of all joints, links and obstacles")
    obstacles: tuple[str, ...] = key(
        "names of obstacles of the scene. Where the value of the mover is 0, they are at their poses in the scene"
    )
    trajectory: Trajectory = key(
        "the value of the mover (m or rad) as the trajectory of one joint; time 0 is the start of the motion of the arm"
    )
    type: MoverType = key(
        '``"prismatic"``: the obstacles move along the axis; ``"revolute"``: they rotate about it', default="prismatic"
    )
    axis: npt.ArrayLike = key(
        "(3,) direction of the axis in the frame of the root link; it need not be a unit vector",
        default=(1.0, 0.0, 0.0),
    )
    point: npt.ArrayLike = key(
        "(3,) a point (m) on the axis of a revolute mover, in the frame of the root link", default=(0.0, 0.0, 0.0)
    )
    tolerance: float = key(
        "m or rad, 0 or more: a certificate also covers values that differ from the trajectory by no more than this",
        default=0.0,
    )
    rests: bool = key(
        "whether the mover rests at the end of its trajectory if the motion of the arm takes longer", default=False
    )

    def __post_init__(self) -> None:
        names = (self.obstacles,) if isinstance(self.obstacles, str) else tuple(self.obstacles)
        if not isinstance(self.name, str) or not self.name:
            raise InputError(f"a mover needs a name, not {self.name!r}")
        if not names:
            raise InputError(f"mover {self.name!r} moves no obstacle")
        if self.type not in get_args(MoverType):
            raise UnknownNameError("type of mover", self.type, get_args(MoverType), f"mover {self.name!r}")
        if not isinstance(self.trajectory, Trajectory) or len(self.trajectory.joint_names) != 1:
            raise InputError(f"the trajectory of mover {self.name!r} must be a Trajectory of one joint")
        if not 0.0 <= self.tolerance < np.inf:
            raise InputError(f"the tolerance of mover {self.name!r} is {self.tolerance!r}; it must be 0 or more")
        # The axis is a unit vector, and travel is limited because rounding grows with coordinates.
        direction = finite(f"the axis of mover {self.name!r}", self.axis, (3,))
        length = float(np.linalg.norm(direction))
        if not length > 0.0:
            raise InputError(f"the axis of mover {self.name!r} has no direction")
        if self.type == "prismatic" and np.abs(self.trajectory.bezier()[1]).max() > FARTHEST:
            raise InputError(f"mover {self.name!r} travels more than {FARTHEST:g} m")
        point = finite(f"the point of mover {self.name!r}", self.point, (3,))
        constants = {"obstacles": names, "axis": _constant(direction / length), "point": _constant(point)}
        for own, value in constants.items():
            object.__setattr__(self, own, value)

    @classmethod
    def constant(
        cls,
        name: str,
        obstacles: Sequence[str],
        speed: float,
        duration: float,
        *,
        start: float = 0.0,
        type: MoverType = "prismatic",  # noqa: A002  # the name of the field
        axis: npt.ArrayLike = (1.0, 0.0, 0.0),
        point: npt.ArrayLike = (0.0, 0.0, 0.0),
        tolerance: float = 0.0,
    ) -> Mover:
        """Return a mover of constant speed, such as a conveyor or a rotary table.

        Parameters
        ----------
        speed
            m/s or rad/s.
        duration
            Seconds after time 0 until which the motion is given.
        start
            The time (s) at which the obstacles are at their poses in the scene.
        name, obstacles, type, axis, point, tolerance
            As for the class.
        """
        rate, begin, end = finite("speed, start and duration", (speed, start, duration), (3,)).tolist()
        if not end > 0.0:
            raise InputError(f"the duration of mover {name!r} is {duration!r}; it must be above 0 s")
        q = np.array([[-rate * begin], [rate * (end - begin)]])
        trajectory = Trajectory([0.0, end], q, np.full((2, 1), rate), [str(name)])
        return cls(name, tuple(obstacles), trajectory, type, axis, point, tolerance)

    def placements(self, times: Array) -> Array:
        """(N, 4, 4) the transforms that move the obstacles from their poses in the scene, at times (N,) in seconds.

        After the end of its trajectory, the mover is at its last value.
        """
        values = self.trajectory(np.minimum(times, self.trajectory.duration))[:, 0]
        axis, point = np.asarray(self.axis), np.asarray(self.point)
        placed = np.tile(np.eye(4), (len(values), 1, 1))
        if self.type == "prismatic":
            placed[:, :3, 3] = values[:, None] * axis
            return placed
        x, y, z = axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turn = values[:, None, None]
        placed[:, :3, :3] += np.sin(turn) * cross + (1.0 - np.cos(turn)) * cross @ cross
        placed[:, :3, 3] = point - placed[:, :3, :3] @ point
        return placed

    def identity(self) -> str:
        """Everything that a certificate depends on, as text."""
        axis, point = np.asarray(self.axis).tolist(), np.asarray(self.point).tolist()
        return repr(
            (self.name, self.obstacles, self.type, axis, point, self.tolerance, self.rests, self.trajectory.digest())
        )

    def after(self, time: float) -> Mover:
        """Return the mover whose time 0 is ``time`` (s) of this one, for a motion that starts then.

        Raises
        ------
        InputError
            If the time is negative or not finite.
        """
        return replace(self, trajectory=self.trajectory.after(time))


def _constant(array: Array) -> Array:
    array.setflags(write=False)
    return array


class TimedScene(NamedTuple):
    """A motion among movers as the motion of a larger joint group; result of :func:`with_movers`."""

    trajectory: Trajectory
    """The motion of the arm and of the movers."""
    checker: CollisionChecker
    """The checker of the arm and the movers; its scene has only the obstacles at rest."""
    tolerances: Array
    """(N,) the tolerances of the movers (m or rad), 0 for the joints of the arm."""


def with_movers(trajectory: Curve, checker: CollisionChecker, movers: Sequence[Mover | Trajectory]) -> TimedScene:
    """Return the motion of an arm and of movers, and the checker of both.

    Obstacles are not checked against each other, whether they move or not.

    Parameters
    ----------
    trajectory
        The motion of the joints of the checker.
    checker
        The checker of the arm, with the obstacles of the movers in its scene.
    movers
        Movers, and trajectories of other joints of the robot that the checker holds, such as those of another arm of a
        cell.

    Raises
    ------
    UnknownNameError
        If a mover moves an obstacle that the scene does not have.
    InputError
        If the motion is a path without time, a mover or a joint is given twice, a name is in use, or the time range of
        a mover does not cover the motion.
    """
    if not isinstance(trajectory, Trajectory):
        raise InputError(f"a {type(trajectory).__name__} has no timing, which movers require; use time_parametrise")
    group, scene = checker.group, checker.scene
    if trajectory.joint_names != group.joint_names:
        raise InputError(f"the curve has the joints {trajectory.joint_names}, the arm has {group.joint_names}")
    carriers = [mover for mover in movers if isinstance(mover, Mover)]
    others = [mover for mover in movers if not isinstance(mover, Mover)]
    # Each mover needs a name of its own and obstacles that no other moves; a trajectory, joints that the checker holds.
    urdf, moved, names = group.robot.urdf, dict[str, str](), [mover.name for mover in carriers]
    for mover in carriers:
        if names.count(mover.name) > 1:
            raise InputError(f"two movers have the name {mover.name!r}")
        if any(mover.name in taken for taken in (urdf.links, urdf.joints, scene, group.ends)):
            raise InputError(f"mover {mover.name!r} has the name of a link, joint, arm or obstacle; rename it")
        for name in mover.obstacles:
            if name not in scene:
                raise UnknownNameError("obstacle", name, scene, f"mover {mover.name!r}")
            if isinstance(scene[name].shape, HalfSpace):
                raise InputError(f"obstacle {name!r} is a half-space, which mover {mover.name!r} cannot move")
            if name in moved:
                raise InputError(f"obstacle {name!r} is moved by both {moved[name]!r} and {mover.name!r}")
            moved[name] = mover.name
    seen = set(group.joint_names)
    for each in others:
        if not isinstance(each, Trajectory):
            raise InputError(f"a mover is a Mover or a Trajectory of other joints, not {type(each).__name__}")
        for joint in each.joint_names:
            if joint in seen:
                raise InputError(f"joint {joint!r} is moved twice")
            if joint not in group.held or urdf.joints[joint].mimic is not None:
                held = [name for name in group.held if urdf.joints[name].mimic is None]
                raise UnknownNameError("joint", joint, held, "the joints that a trajectory among the movers can move")
            seen.add(joint)
    # A mover has to cover the motion, or to rest where it ends.
    given: list[tuple[str, Trajectory]] = []
    movings = [(f"the trajectory of {', '.join(each.joint_names)}", each, False) for each in others]
    movings += [(f"mover {mover.name!r}", mover.trajectory, mover.rests) for mover in carriers]
    for name, own, rests in movings:
        if own.duration < trajectory.duration and not rests:
            raise InputError(
                f"{name} covers {own.duration:.6g} s; the motion takes {trajectory.duration:.6g} s. Give its motion "
                "until then"
            )
        given.append((name, own))
    # The obstacles of a mover are attached to it, at their poses in its frame.
    whole = _larger_group(group, others, carriers)
    carried = [
        replace(scene[name], pose=SE3(np.eye(3), -np.asarray(mover.point)) * scene[name].pose, arm=mover.name)
        for mover in carriers
        for name in mover.obstacles
    ]
    only = next(iter(group.ends))
    attached = [replace(thing, arm=only) if thing.arm is None else thing for thing in checker.attached]
    kept = [pair for pair in scene.allowed if moved.keys() & pair]  # the scene drops them with the obstacles
    spec = replace(
        checker.spec,
        arm=whole,
        scene=scene.remove(*moved),
        attached=(*attached, *carried),
        allowed=(*checker.spec.allowed, *kept),
    )
    moving = checker.with_spec(spec)
    # The motions of all joints on one clock.
    parts = [TimedColumns("the motion", trajectory, list(range(group.dof)), np.arange(group.dof))]
    first = group.dof
    for name, each in given:
        count = len(each.joint_names)
        parts.append(TimedColumns(name, each, list(range(count)), np.arange(first, first + count)))
        first += count
    tolerances = np.zeros(whole.dof)
    tolerances[whole.dof - len(carriers) :] = [mover.tolerance for mover in carriers]
    return TimedScene(merged(parts, whole.joint_names, wait=True, duration=trajectory.duration), moving, tolerances)


def _larger_group(group: JointGroup, others: Sequence[Trajectory], carriers: Sequence[Mover]) -> JointGroup:
    """Return the group of the arm's joints, then those of other trajectories, then the movers."""
    robot = group.robot
    links = {mover.name: f"mover/{mover.name}" for mover in carriers}
    if carriers:
        # Each mover is a joint of the robot with a link for its obstacles.
        axes = {}
        for mover in carriers:
            control = mover.trajectory.bezier()[1]
            kind: JointType = "prismatic" if mover.type == "prismatic" else "continuous"
            axis, point = np.asarray(mover.axis), np.asarray(mover.point)
            axes[mover.name] = Axis(links[mover.name], kind, axis, point, float(control.min()), float(control.max()))
        robot = Robot(
            urdf_with_axes(robot.urdf, axes),
            robot.srdf,
            robot.default_tcp,
            robot.home,
            robot.default_base,
            robot.declared_arms,
            robot.parts,
            {**robot.movers, **links},
        )
    # The chain has the joints of all trajectories, and the others are held.
    more = [name for each in others for name in each.joint_names]
    chain = chain_of(robot.urdf, (*group.joint_names, *more, *links))
    limits = JointLimits.join([group.limits, chain.limits.select(range(group.dof, len(chain.joint_names)))])
    ends = {**group.ends, **{name: (robot.urdf.root, link) for name, link in links.items()}}
    free = {name: value for name, value in group.held.items() if robot.urdf.joints[name].mimic is None}
    held = {name: value for name, value in free.items() if name not in more}
    return JointGroup(robot, ends, chain, limits, held_values(robot.urdf, chain, held, robot.home))
