"""A pick: where the tool's tip grasps, how it gets there and away; and a list of picks with what they share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.collision import Obstacle
from pinproof.errors import InputError
from pinproof.spatial import SE3, finite, rigid

__all__ = ["Pick", "PickProblem", "Picks"]


@dataclass(frozen=True, eq=False)
class Pick:
    """One grasp, with its straight approach and retreat.

    Parameters
    ----------
    name
        Unique in its list.
    pose
        ``root_from_tip`` at the grasp: where the tip of the tool shall be, in the frame of the robot's root link.
    approach
        Metres that the tip comes along its own z axis before the grasp; 0 for none.
    retreat
        Metres that the tip leaves along ``retreat_direction`` after the grasp; 0 for none.
    retreat_direction
        (3,) in the root frame; up by default. Its length does not matter.
    """

    name: str
    pose: SE3
    approach: float = 0.1
    retreat: float = 0.1
    retreat_direction: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError(f"a pick needs a name, not {self.name!r}")
        object.__setattr__(self, "pose", rigid(f"pose of pick {self.name!r}", self.pose))
        for key in ("approach", "retreat"):
            value = float(finite(f"{key} of pick {self.name!r}", [getattr(self, key)], (1,))[0])
            if value < 0:
                raise InputError(f"{key} of pick {self.name!r} is {value} m; it is 0 or more")
            object.__setattr__(self, key, value)
        direction = finite(f"retreat_direction of pick {self.name!r}", self.retreat_direction, (3,))
        length = float(np.linalg.norm(direction))
        if length < 1e-9:
            raise InputError(f"retreat_direction of pick {self.name!r} has no length")
        object.__setattr__(self, "retreat_direction", tuple((direction / length).tolist()))

    def approach_pose(self) -> SE3:
        """``root_from_tip`` where the approach begins."""
        return SE3(self.pose.rotation, self.pose.translation - self.approach * self.pose.rotation[:, 2])

    def retreat_pose(self) -> SE3:
        """``root_from_tip`` where the retreat ends."""
        return SE3(self.pose.rotation, self.pose.translation + self.retreat * np.array(self.retreat_direction))


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
    margin: float = 0.0
    robot: str | None = None
    tcp: str | None = None
    scene: Path | None = None
    home: Mapping[str, float] = field(default_factory=dict)
    source: Path | None = None

    def __post_init__(self) -> None:
        for key in ("picks", "problems", "tool"):
            object.__setattr__(self, key, tuple(getattr(self, key)))
        names = Counter(pick.name for pick in self.picks)
        doubled = sorted(name for name, count in names.items() if count > 1)
        if doubled:
            raise InputError(f"the names of picks must differ; {', '.join(doubled)} stand more than once")
        object.__setattr__(self, "tip", rigid("tip", self.tip))

    def __len__(self) -> int:
        return len(self.picks)

    def __iter__(self) -> Iterator[Pick]:
        return iter(self.picks)

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
