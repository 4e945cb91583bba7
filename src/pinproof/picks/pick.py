"""A pick: where the tool's tip grasps, how it gets there and away; and a list of picks with what they share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.collision import Obstacle
from pinproof.errors import InputError, UnknownNameError
from pinproof.picks.family import GraspSpin, GraspTolerance
from pinproof.picks.frames import NamedFrame
from pinproof.picks.gripper import GripperFingers
from pinproof.picks.settings import GripLimits
from pinproof.spatial import SE3, finite, frozen, rigid

__all__ = ["Pick", "PickProblem", "Picks", "PlaceTarget", "moved", "support_names"]

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
            raise InputError(f"pick {self.name!r} has a place or a support, and no object to put or to lift there")

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
        raise InputError(f"support{where} is {stated!r}; it is the name of an obstacle, or a list of names")
    if len(set(names)) < len(names):
        raise InputError(f"support{where} names an obstacle twice: {', '.join(names)}")
    return names


def _check_way(thing: Pick | PlaceTarget, way: str, of: str) -> None:
    """Approach or retreat: a distance, a direction of length 1, and whose axes it is in."""
    value = float(finite(f"{way} of {of}", [getattr(thing, way)], (1,))[0])
    if not 0 <= value <= LONGEST_WAY:
        raise InputError(f"{way} of {of} is {value:g} m; it is from 0 to {LONGEST_WAY:g} (lengths are metres)")
    direction = finite(f"{way}_direction of {of}", getattr(thing, f"{way}_direction"), (3,))
    if (largest := float(np.abs(direction).max())) < 1e-9:
        raise InputError(f"{way}_direction of {of} has no length")
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
            raise InputError(f"the names of picks must differ; {', '.join(doubled)} stand more than once")
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
