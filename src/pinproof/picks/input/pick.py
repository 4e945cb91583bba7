"""Picks: grasps with approach and retreat, families of grasps, named frames, grippers, and lists of picks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from pinproof.collision import Obstacle, Scene, Upright
from pinproof.common.display import html_block, html_list, html_table, outline
from pinproof.common.validation import ReadOnlyDict, require_positive, unique_names
from pinproof.description.urdf import moved_by
from pinproof.errors import InputError, PicksError, UnknownNameError
from pinproof.model import Arm, JointGroup, JointLimits, Payload, assemble, load_robot
from pinproof.model.dynamics import checked_payloads
from pinproof.motion import ToolLimits
from pinproof.picks.input.conveyor import Conveyor
from pinproof.picks.input.settings import GripLimits
from pinproof.spatial import SE3, Array, finite, frozen, pose, rigid, rotation_about, translated, unit_vector, xyz_rpy

STEPS = 24
"""Number of tried rotations of a free spin: one every 15 degrees."""

MOST_STEPS = 3600
"""Largest number of rotations in a range, each of which is tried: 0.1 degrees each over a full rotation."""

SHARES = (0.5, 1.0)
"""Fractions of a tolerance at which grasps are tried."""


@dataclass(frozen=True)
class GraspSpin:
    """Rotations (rad) of a grasp about its approach direction.

    Parameters
    ----------
    angles
        The rotations that are tried, in this order.
    sampled
        Whether the angles are samples of a range. If all of them fail, nothing is proven about those between.
    """

    angles: tuple[float, ...] = (0.0,)
    sampled: bool = False

    def __post_init__(self) -> None:
        angles = finite("spin", self.angles, (None,))
        if not len(angles):
            raise InputError("spin has no angle; state at least one or omit spin")
        object.__setattr__(self, "angles", tuple(angles.tolist()))

    @classmethod
    def free(cls, steps: int = STEPS) -> GraspSpin:
        """Any rotation about the approach direction, sampled in ``steps``."""
        outwards = ((k + 1) // 2 * (1 if k % 2 else -1) for k in range(steps))  # 0, 1, -1, 2, -2, ...
        return cls(tuple(2 * np.pi * k / steps for k in outwards), sampled=True)

    @classmethod
    def between(cls, first: float, last: float, steps: int = STEPS) -> GraspSpin:
        """Rotations from ``first`` to ``last``; those with the smallest magnitude are tried first."""
        if not last >= first or not 1 <= steps <= MOST_STEPS:
            raise InputError(
                f"spin from {first} to {last} in {steps} steps; the first angle must not exceed the last and the "
                f"number of steps must be from 1 to {MOST_STEPS}"
            )
        return cls(tuple(sorted(np.linspace(first, last, steps + 1).tolist(), key=abs)), sampled=last > first)


@dataclass(frozen=True)
class GraspTolerance:
    """How far a grasp may be moved along and about the axes of the tip.

    Half of the tolerance and all of it are tried, one axis at a time.

    Parameters
    ----------
    position
        (3,) metres in both directions along x, y, z.
    tilt
        rad in both directions about x and y.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt: float = 0.0

    def __post_init__(self) -> None:
        sides = self.position if isinstance(self.position, Iterable) else (self.position,) * 3
        position = finite("tolerance.position", sides, (3,))
        tilt = float(finite("tolerance.tilt", [self.tilt], (1,))[0])
        if (position < 0).any() or tilt < 0:
            raise InputError(f"tolerance of {position.tolist()} m and {tilt} rad; both must be 0 or more")
        object.__setattr__(self, "position", tuple(position.tolist()))
        object.__setattr__(self, "tilt", tilt)

    def groups(self) -> Iterator[list[tuple[str, SE3]]]:
        """Groups of displacements with increasing size: each as text and as ``nominal_from_moved``."""
        yield [("", SE3.Identity())]
        for share in SHARES:
            group = []
            for axis, side in enumerate(self.position):
                for shift in (share * side, -share * side) if side else ():
                    words = f"{shift * 1e3:+.1f} mm along the tip's {'xyz'[axis]}"
                    group.append((words, pose(xyz=[shift * (axis == k) for k in range(3)])))
            for axis in (0, 1) if self.tilt else ():
                for turn in (share * self.tilt, -share * self.tilt):
                    words = f"tilted by {np.degrees(turn):+.1f} deg about the tip's {'xy'[axis]}"
                    group.append((words, pose(rpy=[turn * (axis == k) for k in range(3)])))
            if group:
                yield group


@dataclass(frozen=True, eq=False)
class Member:
    """One grasp of a family: ``nominal_from_tip``, and a text that states how it differs from the nominal grasp."""

    nominal_from_tip: SE3
    words: str = ""


def family(spin: GraspSpin, tolerance: GraspTolerance, axis: Array) -> Iterator[list[Member]]:
    """The grasps in groups of increasing displacement; the nominal grasp and its rotations are the first group.

    ``axis`` (3,) is the unit vector of the spin axis in the tip frame.
    """
    turns = [(SE3(rotation_about(axis, angle), np.zeros(3)), _spun(angle)) for angle in spin.angles]
    for group in tolerance.groups():
        yield [
            Member(turn * shift, ", ".join(filter(None, [spun, words])))
            for words, shift in group
            for turn, spun in turns
        ]


def _spun(angle: float) -> str:
    return f"spun by {np.degrees(angle):+.0f} deg" if angle else ""


@dataclass(frozen=True, eq=False)
class NamedFrame:
    """``parent_from_frame``, and the name of the parent: any frame in which a pick can be stated."""

    pose: SE3
    frame: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", frozen(rigid("pose of a frame", self.pose)))


def root_from_frame(name: str, frames: Mapping[str, NamedFrame], scene: Scene, arm: Arm) -> SE3:
    """``root_from_frame`` of a named frame; ``""`` is the frame of the robot's root link.

    A name is looked up first in ``frames``, then in the obstacles, then in the links.

    Raises
    ------
    UnknownNameError
        If no frame, obstacle or link has this name.
    InputError
        If the frames form a cycle, or the arm moves the link.
    """
    placement, seen = SE3.Identity(), list[str]()
    while name in frames:
        if name in seen:
            raise InputError(f"the frames {', '.join(seen)} form a cycle")
        seen.append(name)
        placement, name = frames[name].pose * placement, frames[name].frame
    if name in ("", arm.robot.urdf.root):
        return placement
    if name in scene.names:
        return scene[name].pose * placement
    if name not in arm.robot.urdf.links:
        raise UnknownNameError("frame", name, [*frames, *scene.names, *arm.robot.urdf.links])
    if moving := moved_by(arm.robot.urdf, name, (*arm.joint_names, *arm.followers)):
        raise InputError(f"the frame {name!r} is a link that joint {moving} moves; picks need a fixed frame")
    return arm.root_from_base * arm.frame_placement(arm.home, name) * placement


@dataclass(frozen=True, eq=False)
class GripperFingers:
    """Two fingers of a parallel gripper.

    Parameters
    ----------
    bodies
        The two bodies, fully closed; their pose is ``tcp_from_body``.
    opening
        Metres between their faces before the grasp.
    grip
        Metres between their faces on the object.
    axis
        (3,) the opening direction of the first finger in the tcp frame; the second moves in the opposite direction.
    """

    bodies: tuple[Obstacle, Obstacle]
    opening: float
    grip: float
    axis: tuple[float, float, float] = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        if len(self.bodies) != 2:
            raise InputError(f"a gripper has 2 finger bodies, not {len(self.bodies)}")
        opening, grip = finite("opening and grip of the fingers", [self.opening, self.grip], (2,)).tolist()
        if not 0 <= grip <= opening:
            raise InputError(f"the fingers open to {opening} m and grip at {grip} m; required: 0 <= grip <= opening")
        object.__setattr__(self, "axis", unit_vector("axis of the fingers", self.axis))

    def apart(self) -> tuple[Obstacle, Obstacle]:
        """The open fingers, before the grasp."""
        return self._at(self.opening)

    def gripping(self) -> tuple[Obstacle, Obstacle]:
        """The fingers on the object."""
        return self._at(self.grip)

    def _at(self, gap: float) -> tuple[Obstacle, Obstacle]:
        aside = SE3(np.eye(3), gap / 2 * np.array(self.axis))
        first, second = self.bodies
        return replace(first, pose=aside * first.pose), replace(second, pose=aside.inverse() * second.pose)


@dataclass(frozen=True, kw_only=True)
class SuctionCup:
    """The face of a suction cup: a disc centred at the tip, perpendicular to the tip's z axis, along which it faces.

    Parameters
    ----------
    radius
        Metres: the radius of the face.
    gap
        Metres: largest distance of any point of its rim from the surface of the part along the axis, in front of the
        face or behind it. The lip of the cup has to compensate it; 1 mm suits a flat cup, and bellows allow more.
    tilt
        rad: largest angle between the face and the surface at its rim.
    """

    radius: float
    gap: float = 1e-3
    tilt: float = 0.1

    def __post_init__(self) -> None:
        require_positive("radius of the cup", self.radius)
        require_positive("gap of the cup", self.gap)
        require_positive("tilt of the cup", self.tilt, below=np.pi / 2)


Direction = tuple[float, float, float]

TIP, ROOT, OBJECT = "tip", "root", "object"
"""The frame of a direction is the tip or the root link; the pose of a place is that of the tip or the object."""

MOVES = ("approach", "retreat")

LONGEST_MOVE = 20.0
"""Metres: the largest approach or retreat. Larger values are probably stated in millimetres."""


class StraightLines:
    """The straight lines of a pick or a place; ``tip`` is the pose of the tip at the grasp or the release."""

    approach: float
    approach_direction: Direction
    approach_frame: str
    retreat: float
    retreat_direction: Direction
    retreat_frame: str

    def before(self, tip: SE3, share: float = 1.0) -> SE3:
        """The pose of the tip on the approach, from 0 at ``tip`` to 1 at the start of the line."""
        along = self.approach_direction if self.approach_frame == ROOT else tip.rotation @ self.approach_direction
        return translated(tip, -share * self.approach * np.asarray(along))

    def after(self, tip: SE3, share: float = 1.0) -> SE3:
        """The pose of the tip on the retreat, from 0 at ``tip`` to 1 at the end of the line."""
        along = self.retreat_direction if self.retreat_frame == ROOT else tip.rotation @ self.retreat_direction
        return translated(tip, share * self.retreat * np.asarray(along))

    def axis_in(self, tip: SE3) -> Array:
        """(3,) the approach direction in the axes of the tip."""
        direction = np.array(self.approach_direction)
        return direction if self.approach_frame == TIP else np.asarray(tip.rotation.T @ direction)


@dataclass(frozen=True, eq=False)
class PlaceTarget(StraightLines):
    """Where the grasped object is put down.

    Parameters
    ----------
    pose
        ``frame_from_tip`` at the release. For a family of grasps it is the pose of the nominal grasp, so that the final
        pose of the object is the same for every member. With ``pose_of="object"`` it is ``frame_from_object``, the
        final pose of the object itself.
    frame
        As for :class:`Pick`.
    approach, approach_direction, approach_frame
        Length (m) and direction of the straight line to the release, and the frame of the direction.
    retreat, retreat_direction, retreat_frame
        The same for the straight line of the empty tool after the release.
    support
        The obstacle or obstacles that the object is put onto; by default those within 1 mm below it. Stored as a tuple
        of names.
    pose_of
        ``"tip"`` or ``"object"``.
    """

    pose: SE3
    frame: str = ""
    approach: float = 0.1
    approach_direction: Direction = (0.0, 0.0, -1.0)
    approach_frame: str = ROOT
    retreat: float = 0.1
    retreat_direction: Direction = (0.0, 0.0, -1.0)
    retreat_frame: str = TIP
    support: str | Sequence[str] | None = None
    pose_of: str = TIP

    def __post_init__(self) -> None:
        if self.pose_of not in (TIP, OBJECT):
            raise UnknownNameError("pose_of", self.pose_of, (TIP, OBJECT), "place")
        object.__setattr__(self, "pose", frozen(rigid("pose of place", self.pose)))
        object.__setattr__(self, "support", support_names(self.support, "place"))
        for move in MOVES:
            _check_move(self, move, "place")


PARTS = ("transit", "approach", "retreat", "transfer", "place", "leave")
"""The parts of the motion of a pick, in order: ``place`` is the line to the release, ``leave`` the one after it."""

SPEED_READ_ONLY = "the speeds of a pick are read-only; make another pick with dataclasses.replace(pick, speed=...)"


@dataclass(frozen=True, kw_only=True)
class ToolSpeed:
    """Limits of the tcp on a part of a pick; None for no limit. See :class:`pinproof.motion.ToolLimits`.

    Parameters
    ----------
    linear_speed, angular_speed
        In m/s and rad/s.
    linear_acceleration, angular_acceleration
        In m/s^2 and rad/s^2.
    """

    linear_speed: float | None = None
    angular_speed: float | None = None
    linear_acceleration: float | None = None
    angular_acceleration: float | None = None

    def __post_init__(self) -> None:
        stated = {name: value for name, value in vars(self).items() if value is not None}
        for name, value in stated.items():
            require_positive(name, value)
        if not stated:
            raise InputError(f"a speed states none of {', '.join(vars(self))}")

    def limits(self, arm: Arm) -> ToolLimits:
        """The constraint of the timing for an arm."""
        return ToolLimits(arm, **vars(self))


@dataclass(frozen=True, eq=False)
class Pick(StraightLines):
    """One grasp, or a family of them, with its straight approach and retreat.

    Parameters
    ----------
    name
        Unique in its list.
    pose
        ``frame_from_tip``: the target pose of the tool's tip at the grasp.
    approach
        Metres of the straight line along ``approach_direction`` before the grasp; 0 for none.
    retreat
        Metres of the straight line along ``retreat_direction`` after the grasp; 0 for none.
    retreat_direction
        (3,) by default +z of the root frame; it is normalised.
    approach_direction
        (3,) by default the z axis of the tip; it is normalised.
    approach_frame, retreat_frame
        The frames of the directions: ``"tip"`` or ``"root"``.
    frame
        The frame of the pose: ``""`` for the robot's root link, one of :attr:`Picks.frames`, an obstacle, or a link
        that does not move.
    spin
        Equivalent rotations about the approach direction.
    tolerance
        How far the grasp may be moved if the nominal one fails.
    carried
        The grasped object: the name of an obstacle of the scene, or an obstacle whose pose is ``tip_from_object``. It
        moves with the tool after the grasp. If None, the motion after the grasp is judged with the empty tool, and the
        scene does not change.
    support
        The obstacle or obstacles that support the object, which it may touch until it separates from them; by default
        those within 1 mm below it. Stored as a tuple of names.
    place
        Where the object is put down; None to end with the retreat.
    upright
        rad: while the object is carried, the axis of the tip that is vertical at the grasp stays within this angle of
        the vertical; None for any orientation. The transfer is planned under this constraint.
    upright_axis
        (3,) another axis for ``upright``, in the tip frame; it must point up within the angle.
    payload
        The mass of the object, in its own frame (that of its obstacle, or of the shape). The torque limits of the
        joints then apply.
    speed
        Limits of the tcp by part of the motion, the keys of :data:`PARTS`.
    arm
        In a cell of several arms, the arm that executes the pick; by default :func:`pinproof.cell.allocate` chooses it.
    """

    name: str
    pose: SE3
    approach: float = 0.1
    retreat: float = 0.1
    retreat_direction: Direction = (0.0, 0.0, 1.0)
    approach_direction: Direction = (0.0, 0.0, 1.0)
    approach_frame: str = TIP
    retreat_frame: str = ROOT
    frame: str = ""
    spin: GraspSpin = field(default_factory=GraspSpin)
    tolerance: GraspTolerance = field(default_factory=GraspTolerance)
    carried: Obstacle | str | None = None
    support: str | Sequence[str] | None = None
    place: PlaceTarget | None = None
    upright: float | None = None
    upright_axis: Direction | None = None
    payload: Payload | None = None
    speed: Mapping[str, ToolSpeed] = field(default_factory=dict)
    arm: str | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError(f"a pick needs a name, not {self.name!r}")
        if self.arm is not None and (not isinstance(self.arm, str) or not self.arm):
            raise InputError(f"arm of pick {self.name!r} is {self.arm!r}; it must be the name of an arm")
        object.__setattr__(self, "pose", frozen(rigid(f"pose of pick {self.name!r}", self.pose)))
        object.__setattr__(self, "support", support_names(self.support, f"pick {self.name!r}"))
        for move in MOVES:
            _check_move(self, move, f"pick {self.name!r}")
        if self.carried is None and (self.place is not None or self.support is not None):
            raise InputError(f"pick {self.name!r} states a place or a support but no object")
        if self.upright is not None:
            if self.carried is None:
                raise InputError(f"pick {self.name!r} states upright but no object, whose orientation it limits")
            checked = Upright(tolerance=self.upright, axis_in_tcp=self.upright_axis or (0.0, 0.0, 1.0))
            object.__setattr__(self, "upright", checked.tolerance)
            object.__setattr__(self, "upright_axis", None if self.upright_axis is None else checked.axis_in_tcp)
        elif self.upright_axis is not None:
            raise InputError(f"pick {self.name!r} states upright_axis but not upright, the allowed angle")
        if self.payload is not None and (self.carried is None or self.payload.frame is not None):
            reason = "no object" if self.carried is None else "a frame; the payload moves with the object"
            raise InputError(f"pick {self.name!r} states a payload and {reason}")
        for part in self.speed:
            if part not in PARTS:
                raise UnknownNameError("part", part, PARTS, f"the speed of pick {self.name!r}")
        object.__setattr__(self, "speed", ReadOnlyDict(self.speed, SPEED_READ_ONLY))

    def transformed(self, root_from_pick: SE3) -> Pick:
        """Return the pick transformed as by :meth:`Picks.transformed`."""
        place = None if self.place is None else _transformed(self.place, root_from_pick)
        return replace(_transformed(self, root_from_pick), place=place)

    def __repr__(self) -> str:
        x, y, z = self.pose.translation
        frame = f" in {self.frame}" if self.frame else ""
        what = (
            "" if self.object_name is None else f", object {self.object_name}{'' if self.place is None else ', placed'}"
        )
        lines = f"approach {self.approach * 1e3:g} mm, retreat {self.retreat * 1e3:g} mm"
        return f"Pick({self.name!r} at ({x:.4g}, {y:.4g}, {z:.4g}) m{frame}, {lines}{what})"

    def _repr_html_(self) -> str:
        poses: list[tuple[str, Pick | PlaceTarget]] = [("grasp", self)]
        poses += [] if self.place is None else [("place", self.place)]
        rows = [(kind, *xyz_rpy(each.pose), each.frame or "root", each.approach, each.retreat) for kind, each in poses]
        columns = ("pose", "x", "y", "z", "roll", "pitch", "yaw", "frame", "approach", "retreat")
        carries = "" if self.object_name is None else f", object {self.object_name}"
        return html_block(f"Pick {self.name}{carries} (m, rad)", html_table(columns, rows))

    @property
    def object_name(self) -> str | None:
        """The name of the grasped object; None without one."""
        return self.carried.name if isinstance(self.carried, Obstacle) else self.carried

    def approach_pose(self) -> SE3:
        """``frame_from_tip`` at the start of the approach."""
        return self.before(self.pose)

    def retreat_pose(self) -> SE3:
        """``frame_from_tip`` at the end of the retreat."""
        return self.after(self.pose)


_Target = TypeVar("_Target", Pick, PlaceTarget)


def _transformed(target: _Target, placement: SE3) -> _Target:
    directions = {
        f"{move}_direction": tuple((placement.rotation @ getattr(target, f"{move}_direction")).tolist())
        for move in MOVES
        if getattr(target, f"{move}_frame") == ROOT
    }
    pose = target.pose if target.frame else placement * target.pose
    return replace(target, pose=pose, **directions)  # type: ignore[arg-type]  # three numbers each


def support_names(stated: object, of: str = "") -> tuple[str, ...] | None:
    """The names of the obstacles that support an object; None if they are determined automatically.

    Raises
    ------
    InputError
        If the value is not a name or a list of names, or if a name is repeated.
    """
    return None if stated is None else unique_names(f"support of {of}" if of else "support", stated)


def _check_move(thing: Pick | PlaceTarget, move: str, of: str) -> None:
    """Validate an approach or retreat, and normalise its direction."""
    value = float(finite(f"{move} of {of}", [getattr(thing, move)], (1,))[0])
    if not 0 <= value <= LONGEST_MOVE:
        raise InputError(
            f"{move} of {of} is {value:g} m; it must be from 0 to {LONGEST_MOVE:g} (lengths are in metres)"
        )
    direction = unit_vector(f"{move}_direction of {of}", getattr(thing, f"{move}_direction"))
    if getattr(thing, f"{move}_frame") not in (TIP, ROOT):
        raise UnknownNameError(f"{move}_frame", getattr(thing, f"{move}_frame"), (TIP, ROOT), of)
    object.__setattr__(thing, move, value)
    object.__setattr__(thing, f"{move}_direction", direction)


@dataclass(frozen=True)
class PickProblem:
    """A row of a picks file that could not be read; the other rows are judged."""

    row: int
    name: str
    reason: str


@dataclass(frozen=True, eq=False)
class CellRobot:
    """One of the robots of a picks file for several robots.

    Parameters
    ----------
    world_from_base
        The pose of the base link of its arm in the cell.
    settings
        What the file states of the robot, its hand and its home, here or for all robots; without picks.
    """

    world_from_base: SE3
    settings: Picks

    def __post_init__(self) -> None:
        object.__setattr__(self, "world_from_base", frozen(rigid("world_from_base", self.world_from_base)))


@dataclass(frozen=True, eq=False)
class Picks:
    """A list of picks and their shared settings.

    Parameters
    ----------
    picks
        The picks in order; their names are unique.
    problems
        Rows of the file that could not be read.
    tip
        ``tcp_from_tip``: the pose of the tool's tip in the tcp frame.
    tool
        Bodies that move with the tcp; their pose is ``tcp_from_body``.
    fingers
        The two fingers of a parallel gripper, which are open before the grasp and closed on the object after it.
    cup
        The suction cup at the tip, instead of fingers. Its body is one of ``tool``.
    conveyor
        The belt that moves objects of picks.
    gripper
        Links of the robot that may touch the object during and after the approach, as ``tool`` and ``fingers`` may.
    held
        Values (rad or m) of joints outside the arm by name, for :meth:`pinproof.Robot.arm`; for finger joints of the
        robot, the open values.
    grip
        The values of those joints that differ while an object is held, from the grasp to the release. The links that
        they move may touch the object, as ``gripper`` may.
    grip_limits
        The criteria for holding a part.
    optimise
        :attr:`PickBudget.motion`, unless a caller states a budget; None for its default.
    straight
        The share of each approach and retreat, next to the part, that must be a straight line: above 0, at most 1. The
        arm leaves the rest of the line out where a certified motion without a stop is shorter. Where a speed of the
        stage is stated, all of the line is straight.
    frames
        Named frames in which picks can be stated.
    margin
        Smallest allowed distance (m) between any two checked bodies.
    payload
        The masses of the tool, in the tcp frame or that of a link. The torque limits of the joints then apply.
    torque_limits
        Whether the torque limits of the joints apply to picks without any payload too.
    robot, tcp, scene, home
        What the file states, if anything: a robot (name or path), its tcp frame, a scene file, and a home configuration
        by joint name (rad or m).
    srdf, package_dirs, xacro_args, limits
        More that the file may state of the robot: an SRDF file, folders of ROS packages, values for the arguments of a
        xacro file, and a file of joint limits.
    source
        The file they were read from.
    places
        Positions in that file of the keys that name something of the robot, such as ``"tcp"`` and ``"held.finger"``,
        for messages.
    robots
        The robots of a cell by name, if the file is for several. Poses are then stated in the frame ``world``.
    """

    picks: tuple[Pick, ...]
    problems: tuple[PickProblem, ...] = ()
    tip: SE3 = field(default_factory=SE3.Identity)
    tool: tuple[Obstacle, ...] = ()
    fingers: GripperFingers | None = None
    cup: SuctionCup | None = None
    conveyor: Conveyor | None = None
    gripper: tuple[str, ...] = ()
    held: Mapping[str, float] = field(default_factory=dict)
    grip: Mapping[str, float] = field(default_factory=dict)
    grip_limits: GripLimits = field(default_factory=GripLimits)
    optimise: int | None = None
    straight: float = 0.5
    frames: Mapping[str, NamedFrame] = field(default_factory=dict)
    margin: float = 0.0
    payload: tuple[Payload, ...] = ()
    torque_limits: bool = False
    robot: str | None = None
    tcp: str | None = None
    scene: Path | None = None
    home: Mapping[str, float] = field(default_factory=dict)
    srdf: Path | None = None
    package_dirs: tuple[Path, ...] = ()
    xacro_args: Mapping[str, str] = field(default_factory=dict)
    limits: Path | None = None
    source: Path | None = None
    places: Mapping[str, str] = field(default_factory=dict)
    robots: Mapping[str, CellRobot] = field(default_factory=dict)

    def __repr__(self) -> str:
        return outline(f"Picks({self._headline})", map(repr, self.picks), total=len(self.picks))

    def _repr_html_(self) -> str:
        rows = ([each.name, *each.pose.translation, each.frame, each.approach, each.retreat] for each in self.picks)
        columns = ("pick", "x", "y", "z", "frame", "approach", "retreat")
        problems = html_list(f"unreadable: {each.name}: {each.reason}" for each in self.problems)
        return html_block(f"{self._headline} (m)", html_table(columns, rows, total=len(self.picks)), problems)

    @property
    def _headline(self) -> str:
        count = len(self.picks)
        unreadable = f", {len(self.problems)} unreadable" if self.problems else ""
        source = "" if self.source is None else f", from {self.source.name}"
        return f"{count} pick{'' if count == 1 else 's'}{unreadable}{source}"

    def __post_init__(self) -> None:
        for key in ("picks", "problems", "tool", "gripper", "package_dirs"):
            object.__setattr__(self, key, tuple(getattr(self, key)))
        names = Counter(pick.name for pick in self.picks)
        doubled = sorted(name for name, count in names.items() if count > 1)
        if doubled:
            raise InputError(f"the names of picks must be unique; repeated: {', '.join(doubled)}")
        object.__setattr__(self, "tip", frozen(rigid("tip", self.tip)))
        object.__setattr__(self, "payload", checked_payloads(self.payload))
        require_positive("straight", self.straight)
        if self.straight > 1.0:
            raise InputError(f"straight = {self.straight}; it is a share of each line, at most 1")
        if self.cup is not None and (self.fingers is not None or self.grip):
            raise InputError("picks state a cup and fingers; a part is held by one of them")

    def __len__(self) -> int:
        return len(self.picks)

    def __iter__(self) -> Iterator[Pick]:
        return iter(self.picks)

    @property
    def open_tool(self) -> tuple[Obstacle, ...]:
        """The bodies attached to the tcp before the grasp: the tool and the open fingers."""
        return self.tool if self.fingers is None else (*self.tool, *self.fingers.apart())

    def refuse_conveyor(self, what: str) -> None:
        """Raise InputError if the picks have a conveyor, which ``what`` does not support."""
        if self.conveyor is not None:
            raise InputError(f"{what} does not support picks from a conveyor; use validate_picks or pinproof pick")

    def load_arm(self) -> Arm:
        """Load the arm that the file states, with its limits and held joints.

        Raises
        ------
        InputError
            If the file states no robot; also for the reasons of :func:`pinproof.load_robot` and
            :meth:`pinproof.Robot.arm`.
        PicksError
            If a name in the file does not exist: a robot, a xacro argument, a tcp or a held joint.
        """
        if self.robots:
            raise InputError(
                f"{self.source or 'picks'}: is for several robots ({', '.join(self.robots)}), not for a single arm; "
                "use pinproof cell allocate"
            )
        if self.robot is None:
            raise InputError(f"{self.source or 'picks'}: states no robot; add 'robot: ur5' or the path of a robot file")
        try:
            robot = load_robot(
                self.robot, srdf=self.srdf, package_dirs=self.package_dirs, xacro_args=self.xacro_args or None
            )
            limits = None if self.limits is None else JointLimits.load(self.limits)
            return robot.arm(self.tcp, limits=limits, held=self.held)
        except UnknownNameError as error:
            keys = {"robot": "robot", "frame": "tcp"}
            key = keys.get(error.kind) or f"{'held' if error.kind == 'joint' else 'xacro_args'}.{error.name}"
            if self.source is None or key not in self.places:
                raise
            raise PicksError(self.source, str(error), self.places[key]) from error

    def load_cell(self) -> JointGroup:
        """Load the robots that the file states, and assemble them at their poses.

        Raises
        ------
        InputError
            If the file is for one robot; also for the reasons of :func:`pinproof.assemble` and :meth:`load_arm`.
        PicksError
            If a name in the file does not exist.
        """
        if not self.robots:
            raise InputError(
                f"{self.source or 'picks'}: is for one robot; a cell needs the key robots, such as "
                "'robots: {left: {base: {xyz: [-0.5, 0, 0]}}, right: {base: {xyz: [0.5, 0, 0]}}}'"
            )
        return assemble({name: (each.settings.load_arm(), each.world_from_base) for name, each in self.robots.items()})

    def transformed(self, root_from_picks: SE3 | npt.ArrayLike) -> Picks:
        """Return the picks, stated in the frame of a cell, in the frame of a robot that is placed in it.

        Poses that name no frame, named frames without a parent, and directions in the root frame are transformed.
        Poses in the frame of an obstacle follow their obstacle (:meth:`pinproof.Scene.transformed`); those in the frame
        of a robot link are unchanged.

        Parameters
        ----------
        root_from_picks
            The pose of the cell in the root frame of the robot, SE3 or (4, 4).
        """
        placement = rigid("root_from_picks", root_from_picks)
        frames = {
            name: frame if frame.frame else NamedFrame(placement * frame.pose) for name, frame in self.frames.items()
        }
        belt = self.conveyor
        if belt is not None:
            belt = replace(belt, direction=tuple((placement.rotation @ belt.direction).tolist()))
        picks = tuple(pick.transformed(placement) for pick in self.picks)
        return replace(self, picks=picks, frames=frames, conveyor=belt)

    def tcp_target(self, root_from_tip: SE3, root_from_base: SE3) -> SE3:
        """``base_from_tcp`` that places the tip at a pose in the root frame."""
        return root_from_base.actInv(root_from_tip * self.tip.inverse())

    def home_configuration(self, joint_names: Iterable[str], default: npt.NDArray[np.float64]) -> list[float]:
        """The home configuration of the file, or ``default`` (n,) if it states none.

        Raises
        ------
        InputError
            If the file states only some of the joints, or a joint that the arm does not have.
        """
        names = list(joint_names)
        if not self.home:
            return [float(value) for value in default]
        missing, foreign = [n for n in names if n not in self.home], [n for n in self.home if n not in names]
        if missing or foreign:
            what = f"lacks {', '.join(missing)}" if missing else f"names {', '.join(foreign)}"
            raise InputError(f"the home of the picks {what}; the arm's joints are {', '.join(names)}")
        return [float(self.home[name]) for name in names]
