"""Shapes of obstacles and links: values with checked sizes, in metres, centred at their own origin."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from pathlib import Path

from pinproof.errors import InputError

__all__ = ["Box", "Capsule", "Cylinder", "Mesh", "Shape", "Sphere"]

SMALLEST_SIZE = 1e-6
"""Metres. A side below this is refused: coal's hulls break down near 1e-8, and no real thing is thinner."""


LARGEST_SIZE = 1e4
"""Metres. Beyond it a number is a mistake (a unit, a slip), and distances lose the digits that proofs are made of."""


class _Sized:
    """Checks that every number of a shape is finite and not below :data:`SMALLEST_SIZE`; coal takes NaN and -1."""

    def __post_init__(self) -> None:
        for field in fields(self):  # type: ignore[arg-type]  # every subclass is a dataclass
            value = getattr(self, field.name)
            try:
                number = float(value)
            except (TypeError, ValueError):
                raise InputError(f"{type(self).__name__}.{field.name} must be a number, not {value!r}") from None
            if not SMALLEST_SIZE <= number <= LARGEST_SIZE:
                wanted = f"sizes are finite, from {SMALLEST_SIZE:g} to {LARGEST_SIZE:g} m"
                raise InputError(f"{type(self).__name__}.{field.name} = {number:g}; {wanted}")
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
class Mesh:
    """A mesh from a file (STL, OBJ, DAE, PLY, GLB).

    Parameters
    ----------
    path
        The file.
    scale
        One factor, or one each for x, y, z.
    hull
        Collide with its convex hull (solid, the default), or with its exact triangles. An exact mesh is solid where it
        is watertight: being inside counts as contact.
    """

    path: str | Path
    scale: float | tuple[float, float, float] = 1.0
    hull: bool = True

    def __post_init__(self) -> None:
        values = self.scale if isinstance(self.scale, (tuple, list)) else (self.scale,) * 3
        try:
            x, y, z = (float(value) for value in values)
        except (TypeError, ValueError):
            raise InputError(f"Mesh.scale must be one number or three, not {self.scale!r}") from None
        if not all(math.isfinite(v) and v != 0.0 for v in (x, y, z)):
            raise InputError(f"Mesh.scale = {(x, y, z)}; factors are finite and not 0")
        object.__setattr__(self, "scale", (x, y, z))
        object.__setattr__(self, "path", Path(self.path))


Shape = Box | Sphere | Cylinder | Capsule | Mesh
