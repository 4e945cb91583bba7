"""Picks: grasps with approach and retreat, families of grasps, named frames, grippers, and lists of picks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.collision import Obstacle, Scene
from pinproof.description import Urdf
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import Arm
from pinproof.picks.input.settings import GripLimits
from pinproof.spatial import SE3, finite, frozen, pose, rigid

__all__ = [
    "GraspSpin",
    "GraspTolerance",
    "GripperFingers",
    "Member",
    "NamedFrame",
    "Pick",
    "PickProblem",
    "Picks",
    "PlaceTarget",
    "family",
    "moved",
    "moved_by",
    "root_from_frame",
    "rotation_about",
    "support_names",
]

Array = npt.NDArray[np.float64]

STEPS = 24
"""Turns that are tried of a free spin: every 15 degrees."""

MOST_STEPS = 3600
"""Of a range of turns: a tenth of a degree each of a whole turn. Every one is tried."""

SHARES = (0.5, 1.0)
"""Of a tolerance, where grasps are tried: half way out, then at its end."""


@dataclass(frozen=True)
class GraspSpin:
    """Turns (rad) of a grasp about the direction of its approach.

    Parameters
    ----------
    angles
        Those that are tried, in this order.
    sampled
        Whether they stand for a range of turns: then a "no" to all of them proves nothing about those between.
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
        """Any turn at all."""
        return cls(tuple(sorted((2 * np.pi * k / steps for k in _outwards(steps)), key=abs)), sampled=True)

    @classmethod
    def between(cls, first: float, last: float, steps: int = STEPS) -> GraspSpin:
        """Turns from ``first`` to ``last``, the smallest first."""
        if not last >= first or not 1 <= steps <= MOST_STEPS:
            raise InputError(
                f"spin from {first} to {last} in {steps} steps; the first angle must not exceed the last and the "
                f"number of steps must be from 1 to {MOST_STEPS}"
            )
        return cls(tuple(sorted(np.linspace(first, last, steps + 1).tolist(), key=abs)), sampled=last > first)


@dataclass(frozen=True)
class GraspTolerance:
    """How far a grasp may be moved in the tip's own axes: tried half way and at the end, one axis at a time.

    Parameters
    ----------
    position
        (3,) metres to either side along x, y, z.
    tilt
        rad to either side about x and y.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt: float = 0.0

    def __post_init__(self) -> None:
        sides = np.full(3, self.position) if np.ndim(self.position) == 0 else self.position
        position = finite("tolerance.position", sides, (3,))
        tilt = float(finite("tolerance.tilt", [self.tilt], (1,))[0])
        if (position < 0).any() or tilt < 0:
            raise InputError(f"tolerance of {position.tolist()} m and {tilt} rad; both must be 0 or more")
        object.__setattr__(self, "position", tuple(position.tolist()))
        object.__setattr__(self, "tilt", tilt)

    def rings(self) -> Iterator[list[tuple[str, SE3]]]:
        """What a grasp is moved by, ``nominal_from_moved`` in words and as a transform, ring by ring outwards."""
        yield [("", SE3.Identity())]
        for share in SHARES:
            ring = []
            for axis, side in enumerate(self.position):
                for shift in (share * side, -share * side) if side else ():
                    words = f"{shift * 1e3:+.1f} mm along the tip's {'xyz'[axis]}"
                    ring.append((words, pose(xyz=[shift * (axis == k) for k in range(3)])))
            for axis in (0, 1) if self.tilt else ():
                for turn in (share * self.tilt, -share * self.tilt):
                    words = f"tilted by {np.degrees(turn):+.1f} deg about the tip's {'xy'[axis]}"
                    ring.append((words, pose(rpy=[turn * (axis == k) for k in range(3)])))
            if ring:
                yield ring


@dataclass(frozen=True, eq=False)
class Member:
    """One grasp of a family: ``nominal_from_tip``, and in words how it differs from the nominal one."""

    nominal_from_tip: SE3
    words: str = ""


def family(spin: GraspSpin, tolerance: GraspTolerance, axis: Array) -> Iterator[list[Member]]:
    """The members ring by ring, the nominal grasp and its turns first.

    Parameters
    ----------
    spin, tolerance
        What may differ.
    axis
        (3,) the direction in the tip's frame about which it spins, of length 1.
    """
    for ring in tolerance.rings():
        yield [
            Member(
                SE3(rotation_about(axis, angle), np.zeros(3)) * shift, ", ".join(filter(None, [_spun(angle), words]))
            )
            for words, shift in ring
            for angle in spin.angles
        ]


def _spun(angle: float) -> str:
    return f"spun by {np.degrees(angle):+.0f} deg" if angle else ""


def rotation_about(axis: Array, angle: float) -> Array:
    """The rotation (3, 3) about an axis by an angle (Rodrigues' formula)."""
    if angle == 0.0:
        return np.eye(3)
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)


def _outwards(steps: int) -> list[int]:
    """0, 1, -1, 2, -2, ... as many as ``steps``."""
    return [(k + 1) // 2 * (1 if k % 2 else -1) for k in range(steps)]


@dataclass(frozen=True, eq=False)
class NamedFrame:
    """``parent_from_frame``, and the name of the parent, which may be any that a pick may be given in."""

    pose: SE3
    frame: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", frozen(rigid("pose of a frame", self.pose)))


def root_from_frame(name: str, frames: Mapping[str, NamedFrame], scene: Scene, arm: Arm) -> SE3:
    """Where a named frame is; ``""`` is the frame of the robot's root link itself.

    A frame of ``frames`` goes before an obstacle of its name, and that before a link.

    Raises
    ------
    UnknownNameError
        If nothing is called so.
    InputError
        If frames hang on each other in a circle, or the link is moved by the arm.
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


def moved_by(urdf: Urdf, link: str, joints: Collection[str]) -> str:
    """Which of some joints, or of those that follow one of them, moves a link; empty if none does."""
    while (joint := urdf.parent_joint(link)) is not None:
        if joint.name in joints or (joint.mimic is not None and joint.mimic.leader in joints):
            return joint.name
        link = joint.parent
    return ""


@dataclass(frozen=True, eq=False)
class GripperFingers:
    """Two fingers of a parallel gripper.

    Parameters
    ----------
    bodies
        The two, as they stand when closed on nothing; their pose is ``tcp_from_body``.
    opening
        Metres between their faces before the grasp.
    grip
        Metres between them on the object.
    axis
        (3,) the direction in the tcp's frame that the first one moves along when they open; the other moves against it.
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
        axis = finite("axis of the fingers", self.axis, (3,))
        if (largest := float(np.abs(axis).max())) < 1e-9:
            raise InputError("axis of the fingers is zero")
        axis /= largest  # so that no square overflows
        object.__setattr__(self, "axis", tuple((axis / np.linalg.norm(axis)).tolist()))

    def apart(self) -> tuple[Obstacle, Obstacle]:
        """The bodies before the grasp."""
        return self._at(self.opening)

    def gripping(self) -> tuple[Obstacle, Obstacle]:
        """The bodies on the object."""
        return self._at(self.grip)

    def _at(self, gap: float) -> tuple[Obstacle, Obstacle]:
        aside = SE3(np.eye(3), gap / 2 * np.array(self.axis))
        first, second = self.bodies
        return replace(first, pose=aside * first.pose), replace(second, pose=aside.inverse() * second.pose)


Direction = tuple[float, float, float]

TIP, ROOT = "tip", "root"
"""Whose axes a direction is in: the tool's tip, or the robot's root link."""

WAYS = ("approach", "retreat")

LONGEST_WAY = 20.0
"""Metres of an approach or a retreat; 50 and 100 are millimetres."""


@dataclass(frozen=True, eq=False)
class PlaceTarget:
    """Where what was grasped is put down.

    Parameters
    ----------
    pose
        ``frame_from_tip`` where it is let go; of a family of grasps, that of the nominal one, so that the object comes
        to stand in the same place whichever member holds it.
    frame
        As for :class:`Pick`.
    approach, approach_direction, approach_frame
        Metres and direction of the straight way down to it, and the frame of the direction.
    retreat, retreat_direction, retreat_frame
        The same of the empty tool's way off.
    support
        The obstacle that the object is put onto, or several; by default what lies within 1 mm below it there. Kept as
        a tuple of names.
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

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", frozen(rigid("pose of place", self.pose)))
        object.__setattr__(self, "support", support_names(self.support, "place"))
        for way in WAYS:
            _check_way(self, way, "place")


@dataclass(frozen=True, eq=False)
class Pick:
    """One grasp, or a family of them, with its straight approach and retreat.

    Parameters
    ----------
    name
        Unique in its list.
    pose
        ``frame_from_tip`` at the grasp: where the tip of the tool shall be.
    approach
        Metres that the tip comes along ``approach_direction`` before the grasp; 0 for none.
    retreat
        Metres that the tip leaves along ``retreat_direction`` after the grasp; 0 for none.
    retreat_direction
        (3,) up in the root frame by default. Its length does not matter.
    approach_direction
        (3,) along the tip's own z axis by default.
    approach_frame, retreat_frame
        Whose axes the directions are in: ``"tip"`` or ``"root"``.
    frame
        What the pose is in: ``""``, the frame of the robot's root link; one of :attr:`Picks.frames`; an obstacle; or a
        link that does not move.
    spin
        Turns about the approach's direction that are as good as none.
    tolerance
        How far the grasp may be moved, where the nominal one fails.
    carried
        What is grasped: the name of an obstacle of the scene, or an obstacle of its own whose pose is
        ``tip_from_object``. It is carried from the grasp on. None: the way from the grasp on is judged for the empty
        tool, and whatever stands in the scene stays there.
    support
        The obstacle that the object stands on, or several, which it may touch until it has left them; by default what
        lies within 1 mm below it. Kept as a tuple of names.
    place
        Where it is put; None to end with the retreat.
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

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError(f"a pick needs a name, not {self.name!r}")
        object.__setattr__(self, "pose", frozen(rigid(f"pose of pick {self.name!r}", self.pose)))
        object.__setattr__(self, "support", support_names(self.support, f"pick {self.name!r}"))
        for way in WAYS:
            _check_way(self, way, f"pick {self.name!r}")
        if self.carried is None and (self.place is not None or self.support is not None):
            raise InputError(f"pick {self.name!r} states a place or a support but no object")

    def approach_pose(self) -> SE3:
        """``frame_from_tip`` where the approach begins."""
        return moved(self.pose, -self.approach, self.approach_direction, self.approach_frame)

    def retreat_pose(self) -> SE3:
        """``frame_from_tip`` where the retreat ends."""
        return moved(self.pose, self.retreat, self.retreat_direction, self.retreat_frame)


def moved(pose: SE3, distance: float, direction: Direction, frame: str) -> SE3:
    """The pose, shifted by ``distance`` (m) along a direction of its own axes (``"tip"``) or of those it is in."""
    along = np.array(direction)
    return SE3(pose.rotation, pose.translation + distance * (pose.rotation @ along if frame == TIP else along))


def support_names(stated: object, of: str = "") -> tuple[str, ...] | None:
    """The names of the obstacles that support an object: one name or several; None to find them.

    Raises
    ------
    InputError
        If they are no names, none at all, or one is repeated.
    """
    if stated is None:
        return None
    names = (stated,) if isinstance(stated, str) else tuple(stated) if isinstance(stated, (list, tuple)) else ()
    where = f" of {of}" if of else ""
    if not names or not all(isinstance(name, str) and name for name in names):
        raise InputError(f"support{where} is {stated!r}; it must be the name of an obstacle or a list of names")
    if len(set(names)) < len(names):
        raise InputError(f"support{where} names an obstacle twice: {', '.join(names)}")
    return names


def _check_way(thing: Pick | PlaceTarget, way: str, of: str) -> None:
    """Approach or retreat: a distance, a direction of length 1, and whose axes it is in."""
    value = float(finite(f"{way} of {of}", [getattr(thing, way)], (1,))[0])
    if not 0 <= value <= LONGEST_WAY:
        raise InputError(f"{way} of {of} is {value:g} m; it must be from 0 to {LONGEST_WAY:g} (lengths are in metres)")
    direction = finite(f"{way}_direction of {of}", getattr(thing, f"{way}_direction"), (3,))
    if (largest := float(np.abs(direction).max())) < 1e-9:
        raise InputError(f"{way}_direction of {of} is zero")
    direction /= largest  # so that no square overflows
    if getattr(thing, f"{way}_frame") not in (TIP, ROOT):
        raise UnknownNameError(f"{way}_frame", getattr(thing, f"{way}_frame"), (TIP, ROOT), of)
    object.__setattr__(thing, way, value)
    object.__setattr__(thing, f"{way}_direction", tuple((direction / np.linalg.norm(direction)).tolist()))


@dataclass(frozen=True)
class PickProblem:
    """A row of a picks file that could not be read; the others are judged all the same."""

    row: int
    name: str
    reason: str


@dataclass(frozen=True, eq=False)
class Picks:
    """A list of picks, and what they share.

    Parameters
    ----------
    picks
        The picks, in order; their names differ.
    problems
        Rows of the file that could not be read.
    tip
        ``tcp_from_tip``: where the tool's tip is on the arm's tcp.
    tool
        Bodies that move with the tcp; their pose is ``tcp_from_body``.
    fingers
        Two of the gripper's bodies that stand apart before the grasp and on the object after it.
    gripper
        Links of the robot that may touch what is grasped from the approach on, as ``tool`` and ``fingers`` may.
    held
        Values (rad or m) of joints outside the arm by name, such as those of the robot's own fingers, open: for
        :meth:`pinproof.Robot.arm`.
    grip
        Those of them that stand elsewhere while an object is held, from the grasp to where it is let go. The links that
        they move may touch what is grasped, as ``gripper`` may.
    grip_limits
        What counts as holding a part.
    frames
        Frames by name that picks may be given in.
    margin
        Metres that must stay between any two checked bodies.
    robot, tcp, scene, home
        What the file names, if it does: a robot (name or path), its tcp frame, a scene file, a home configuration by
        joint name (rad or m).
    source
        The file they were read from.
    """

    picks: tuple[Pick, ...]
    problems: tuple[PickProblem, ...] = ()
    tip: SE3 = field(default_factory=SE3.Identity)
    tool: tuple[Obstacle, ...] = ()
    fingers: GripperFingers | None = None
    gripper: tuple[str, ...] = ()
    held: Mapping[str, float] = field(default_factory=dict)
    grip: Mapping[str, float] = field(default_factory=dict)
    grip_limits: GripLimits = field(default_factory=GripLimits)
    frames: Mapping[str, NamedFrame] = field(default_factory=dict)
    margin: float = 0.0
    robot: str | None = None
    tcp: str | None = None
    scene: Path | None = None
    home: Mapping[str, float] = field(default_factory=dict)
    source: Path | None = None

    def __post_init__(self) -> None:
        for key in ("picks", "problems", "tool", "gripper"):
            object.__setattr__(self, key, tuple(getattr(self, key)))
        names = Counter(pick.name for pick in self.picks)
        doubled = sorted(name for name, count in names.items() if count > 1)
        if doubled:
            raise InputError(f"the names of picks must be unique; repeated: {', '.join(doubled)}")
        object.__setattr__(self, "tip", frozen(rigid("tip", self.tip)))

    def __len__(self) -> int:
        return len(self.picks)

    def __iter__(self) -> Iterator[Pick]:
        return iter(self.picks)

    @property
    def open_tool(self) -> tuple[Obstacle, ...]:
        """All that moves with the tcp before the grasp: the tool, and the fingers apart."""
        return self.tool if self.fingers is None else (*self.tool, *self.fingers.apart())

    def tcp_target(self, root_from_tip: SE3, root_from_base: SE3) -> SE3:
        """``base_from_tcp`` that brings the tip to a pose given in the root frame."""
        return root_from_base.actInv(root_from_tip * self.tip.inverse())

    def home_configuration(self, joint_names: Iterable[str], default: npt.NDArray[np.float64]) -> list[float]:
        """The home by joint name where the file gives one, else ``default`` (n,).

        Raises
        ------
        InputError
            If the file gives some of the joints but not this one, or a joint the arm does not have.
        """
        names = list(joint_names)
        if not self.home:
            return [float(value) for value in default]
        missing, foreign = [n for n in names if n not in self.home], [n for n in self.home if n not in names]
        if missing or foreign:
            what = f"lacks {', '.join(missing)}" if missing else f"names {', '.join(foreign)}"
            raise InputError(f"the home of the picks {what}; the arm's joints are {', '.join(names)}")
        return [float(self.home[name]) for name in names]
