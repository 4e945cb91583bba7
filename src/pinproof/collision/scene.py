"""What stands around the robot: named obstacles, and the contacts with them that are meant to be."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.shapes import Shape
from pinproof.collision.sizes import LARGEST_SIZE
from pinproof.errors import InputError, UnknownNameError
from pinproof.spatial import frozen, matrix, rigid

__all__ = ["ANYTHING", "Obstacle", "Scene"]

ANYTHING = "*"
"""In an allowed contact: any link, or attached object."""


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A shape somewhere.

    Parameters
    ----------
    name
        Unique in its scene.
    shape
        What it is.
    pose
        ``root_from_obstacle``: where its origin lies in the frame of the robot's root link. SE3 or (4, 4). Copied, and
        read-only afterwards: :meth:`Scene.move` makes a scene in which the obstacle has another pose.
    rgba
        How it is drawn, 0 to 1.
    """

    name: str
    shape: Shape
    pose: pin.SE3 = None
    rgba: tuple[float, float, float, float] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError(f"an obstacle needs a name, not {self.name!r}")
        if not isinstance(self.shape, Shape):
            kinds = ", ".join(kind.__name__ for kind in get_args(Shape))
            raise InputError(f"obstacle {self.name!r} has no shape but {self.shape!r}; use one of {kinds}")
        placement = pin.SE3.Identity() if self.pose is None else rigid(f"pose of obstacle {self.name!r}", self.pose)
        if float(np.abs(placement.translation).max()) > LARGEST_SIZE:
            where = placement.translation.tolist()
            raise InputError(f"obstacle {self.name!r} stands at {where}; places are within {LARGEST_SIZE:g} m")
        object.__setattr__(self, "pose", frozen(placement))


@dataclass(frozen=True, eq=False)
class Scene:
    """An immutable set of obstacles. Obstacles are never checked against each other: cans stand on shelves.

    Parameters
    ----------
    obstacles
        The obstacles; their names differ.
    allowed
        Pairs of (robot link, obstacle) that may touch, such as the base and the table it is bolted to. A certificate
        lists them among what it left out. ``"*"`` as the link stands for all of the robot.
    disabled
        Pairs of robot links that a MoveIt matrix disables. Like an SRDF's pairs without a reason they are checked all
        the same, unless the checker is told to trust them.
    frame
        The name that the poses' frame has where they come from; a checker refuses a robot whose root, or a link that
        stands there for good, has another name. Empty: the root of whatever robot it is used with.
    notes
        What was made of a file that its writer may not expect.
    source
        The file it comes from, for messages.
    """

    obstacles: tuple[Obstacle, ...] = ()
    allowed: tuple[tuple[str, str], ...] = ()
    disabled: tuple[tuple[str, str], ...] = ()
    frame: str = ""
    notes: tuple[str, ...] = ()
    source: Path | None = None

    def __init__(
        self,
        obstacles: Iterable[Obstacle] = (),
        *,
        allowed: Iterable[Sequence[str]] = (),
        disabled: Iterable[Sequence[str]] = (),
        frame: str = "",
        notes: Iterable[str] = (),
        source: str | Path | None = None,
    ) -> None:
        things = tuple(obstacles)
        names = [obstacle.name for obstacle in things]
        doubled = sorted({name for name in names if names.count(name) > 1})
        if doubled:
            raise InputError(f"obstacle names must differ; {', '.join(doubled)} stand more than once")
        pairs = _pairs("allowed", allowed)
        for _, obstacle in pairs:
            if obstacle not in names:
                raise UnknownNameError("obstacle", obstacle, names, "the allowed contacts of the scene")
        object.__setattr__(self, "obstacles", things)
        object.__setattr__(self, "allowed", pairs)
        object.__setattr__(self, "disabled", _pairs("disabled", disabled))
        object.__setattr__(self, "frame", frame)
        object.__setattr__(self, "notes", tuple(notes))
        object.__setattr__(self, "source", None if source is None else Path(source))

    def __getitem__(self, name: str) -> Obstacle:
        for obstacle in self.obstacles:
            if obstacle.name == name:
                return obstacle
        raise UnknownNameError("obstacle", name, self.names, "the scene")

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the obstacles, in order."""
        return tuple(obstacle.name for obstacle in self.obstacles)

    def add(self, *obstacles: Obstacle) -> Scene:
        """A new scene with these obstacles too."""
        return self._with((*self.obstacles, *obstacles))

    def remove(self, *names: str) -> Scene:
        """A new scene without these obstacles, and without the contacts allowed with them."""
        gone = {self[name].name for name in names}
        return self._with(o for o in self.obstacles if o.name not in gone)

    def move(self, name: str, pose: pin.SE3 | npt.ArrayLike) -> Scene:
        """A new scene in which the obstacle stands at ``pose`` (root_from_obstacle, SE3 or (4, 4))."""
        moved = replace(self[name], pose=pose)
        return self._with(moved if o.name == name else o for o in self.obstacles)

    def _with(self, obstacles: Iterable[Obstacle]) -> Scene:
        things = tuple(obstacles)
        gone = set(self.names) - {obstacle.name for obstacle in things}
        allowed = [pair for pair in self.allowed if not gone & set(pair)]
        more = {name: getattr(self, name) for name in ("disabled", "frame", "notes", "source")}
        return Scene(things, allowed=allowed, **more)

    @property
    def where(self) -> str:
        """The scene in a message: by its file, where it has one."""
        return "the scene" if self.source is None else f"the scene {self.source}"

    def is_close(self, other: Scene, tolerance: float = 1e-9) -> bool:
        """Whether both hold the same obstacles, at the same places within ``tolerance`` (metres and matrix entries)."""
        return (
            self.names == other.names
            and (self.allowed, self.disabled, self.frame) == (other.allowed, other.disabled, other.frame)
            and all(
                a.shape == b.shape and bool((abs(matrix(a.pose) - matrix(b.pose)) <= tolerance).all())
                for a, b in zip(self.obstacles, other.obstacles, strict=True)
            )
        )

    @classmethod
    def load(cls, path: str | Path) -> Scene:
        """Read a scene file (YAML) of ours or of MoveIt.

        The keys are described in :mod:`pinproof.collision.scene_file`, what of a MoveIt planning scene is read in
        :mod:`pinproof.collision.moveit_scene`.

        Raises
        ------
        SceneError
            If the file cannot be read or says something that has no meaning; names the obstacle and the key.
        """
        from pinproof.collision.scene_file import read_scene

        return read_scene(path)

    def save(self, path: str | Path) -> None:
        """Write the scene as YAML, whole or not at all.

        Raises
        ------
        SceneError
            For another ending than ``.yaml`` or ``.yml``, or a place that cannot be written to.
        """
        from pinproof.collision.scene_file import write_scene

        write_scene(self, path)


def _pairs(what: str, stated: Iterable[Sequence[str]]) -> tuple[tuple[str, str], ...]:
    pairs = []
    for pair in stated:
        if isinstance(pair, str) or len(pair) != 2 or not all(isinstance(name, str) for name in pair):
            raise InputError(f"{what}: {pair!r} is no pair of names")
        first, second = pair
        if first == second:
            raise InputError(f"{what}: {first!r} stands there twice; a pair is two bodies")
        pairs.append((first, second))
    return tuple(pairs)
