"""What stands around the robot: named obstacles, and the contacts with them that are meant to be."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.shapes import LARGEST_SIZE, Box, Capsule, Cylinder, Mesh, Shape, Sphere
from pinproof.errors import InputError, UnknownNameError
from pinproof.spatial import matrix, rigid

__all__ = ["Obstacle", "Scene"]


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
        ``root_from_obstacle``: where its origin lies in the frame of the robot's root link. SE3 or (4, 4).
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
        if not isinstance(self.shape, (Box, Sphere, Cylinder, Capsule, Mesh)):
            raise InputError(
                f"obstacle {self.name!r} has no shape but {self.shape!r}; use Box, Sphere, Cylinder, Capsule, Mesh"
            )
        placement = pin.SE3.Identity() if self.pose is None else rigid(f"pose of obstacle {self.name!r}", self.pose)
        if float(np.abs(placement.translation).max()) > LARGEST_SIZE:
            where = placement.translation.tolist()
            raise InputError(f"obstacle {self.name!r} stands at {where}; places are within {LARGEST_SIZE:g} m")
        object.__setattr__(self, "pose", placement)


@dataclass(frozen=True, eq=False)
class Scene:
    """An immutable set of obstacles. Obstacles are never checked against each other: cans stand on shelves.

    Parameters
    ----------
    obstacles
        The obstacles; their names differ.
    allowed
        Pairs of (robot link, obstacle) that may touch, such as the base and the table it is bolted to. A certificate
        lists them among what it left out.
    disabled
        Pairs of robot links that a MoveIt matrix disables. Like an SRDF's pairs without a reason they are checked all
        the same, unless the checker is told to trust them.
    """

    obstacles: tuple[Obstacle, ...] = ()
    allowed: tuple[tuple[str, str], ...] = ()
    disabled: tuple[tuple[str, str], ...] = ()

    def __init__(
        self,
        obstacles: Iterable[Obstacle] = (),
        *,
        allowed: Iterable[Sequence[str]] = (),
        disabled: Iterable[Sequence[str]] = (),
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
        return Scene(things, allowed=allowed, disabled=self.disabled)

    def is_close(self, other: Scene, tolerance: float = 1e-9) -> bool:
        """Whether both hold the same obstacles, at the same places within ``tolerance`` (metres and matrix entries)."""
        return (
            self.names == other.names
            and (self.allowed, self.disabled) == (other.allowed, other.disabled)
            and all(
                a.shape == b.shape and bool((abs(matrix(a.pose) - matrix(b.pose)) <= tolerance).all())
                for a, b in zip(self.obstacles, other.obstacles, strict=True)
            )
        )

    @classmethod
    def load(cls, path: str | Path) -> Scene:
        """Read a scene file (YAML); the keys are described in :mod:`pinproof.collision.scene_file`.

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
