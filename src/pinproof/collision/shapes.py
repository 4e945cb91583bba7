"""Shapes of obstacles and attached objects: values with checked sizes, in metres, each about its own origin."""

from __future__ import annotations

from dataclasses import dataclass, fields

from pinproof.collision.array_shapes import ConvexHull, HeightMap, Mesh, PointCloud
from pinproof.collision.sizes import checked_size

__all__ = [
    "Box",
    "Capsule",
    "Cone",
    "ConvexHull",
    "Cylinder",
    "Ellipsoid",
    "HalfSpace",
    "HeightMap",
    "Mesh",
    "PointCloud",
    "Shape",
    "Sphere",
]


class _Sized:
    """Checks every number of a shape as :func:`~pinproof.collision.sizes.checked_size` does."""

    def __post_init__(self) -> None:
        for field in fields(self):  # type: ignore[arg-type]  # every subclass is a dataclass
            number = checked_size(f"{type(self).__name__}.{field.name}", getattr(self, field.name))
            object.__setattr__(self, field.name, number)


@dataclass(frozen=True)
class Box(_Sized):
    """A box with the full sides x, y, z."""

    x: float
    y: float
    z: float


@dataclass(frozen=True)
class Sphere(_Sized):
    """A sphere."""

    radius: float


@dataclass(frozen=True)
class Cylinder(_Sized):
    """A cylinder about z, ``length`` from end to end."""

    radius: float
    length: float


@dataclass(frozen=True)
class Capsule(_Sized):
    """A cylinder about z, ``length`` long without its two half-sphere caps."""

    radius: float
    length: float


@dataclass(frozen=True)
class Cone(_Sized):
    """A cone about z, its tip at z = ``length`` / 2 and its disc of ``radius`` at z = -``length`` / 2."""

    radius: float
    length: float


@dataclass(frozen=True)
class Ellipsoid(_Sized):
    """An ellipsoid with the semi-axes (half its width) rx, ry, rz along x, y, z."""

    rx: float
    ry: float
    rz: float


@dataclass(frozen=True)
class HalfSpace:
    """Everything below a plane: all points with z <= 0 in its own frame are solid. A floor, a wall, a ceiling."""


Shape = Box | Sphere | Cylinder | Capsule | Cone | Ellipsoid | HalfSpace | ConvexHull | Mesh | PointCloud | HeightMap
