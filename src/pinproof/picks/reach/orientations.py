"""In which orientations of the tool a reach map asks: directions of approach, each with spins about it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.common.validation import require_integer
from pinproof.errors import InputError
from pinproof.spatial import finite

__all__ = ["approach_directions", "tool_orientations"]

Array = npt.NDArray[np.float64]

GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
"""Radians between neighbours on the spiral."""


def approach_directions(axis: npt.ArrayLike = (0.0, 0.0, -1.0), half_angle: float = 0.0, count: int = 1) -> Array:
    """(count, 3) unit vectors spread evenly over the cone of ``half_angle`` (rad) about ``axis`` (3,).

    A Fibonacci spiral: each stands for the same area of the sphere. ``half_angle`` pi is the whole sphere; with a
    count of 1 only the axis is left.

    Raises
    ------
    InputError
        If the axis has no length, the angle is outside [0, pi], or the count is not a whole number above 0.

    References
    ----------
    Swinbank, Purser (2006), "Fibonacci grids: a novel approach to global modelling".
    """
    direction = finite("axis", axis, (3,))
    length = float(np.linalg.norm(direction))
    if length < 1e-9:
        raise InputError("axis has no length")
    if not 0.0 <= half_angle <= np.pi:
        raise InputError(f"half_angle = {half_angle}; it lies in 0 to pi rad")
    require_integer("count", count, 1)
    if count == 1 or half_angle == 0.0:
        return (direction / length)[None]
    index = np.arange(count)
    height = 1.0 - (1.0 - np.cos(half_angle)) * (index + 0.5) / count
    radius, turn = np.sqrt(1.0 - height**2), GOLDEN_ANGLE * index
    around = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)
    return np.asarray(around @ _with_z(direction / length).T)


def tool_orientations(directions: npt.ArrayLike = (0.0, 0.0, -1.0), spins: int = 8) -> Array:
    """(d * spins, 3, 3) ``root_from_tip`` rotations whose z runs along each of the directions (3,) or (d, 3).

    ``spins`` turns about that z, evenly spread over a whole turn; the first has its x as near to the root's x as
    possible (to its y where the direction is along x).

    Raises
    ------
    InputError
        If a direction has no length or the number of spins is not a whole number above 0.
    """
    many = np.atleast_2d(np.asarray(directions, dtype=float))
    many = finite("directions", many, (None, 3))
    lengths = np.linalg.norm(many, axis=1)
    if not (lengths > 1e-9).all():
        raise InputError(f"direction {int(np.flatnonzero(lengths <= 1e-9)[0])} has no length")
    require_integer("spins", spins, 1)
    turns = 2.0 * np.pi * np.arange(spins) / spins
    about_z = np.zeros((spins, 3, 3))
    about_z[:, 0, 0] = about_z[:, 1, 1] = np.cos(turns)
    about_z[:, 1, 0] = np.sin(turns)
    about_z[:, 0, 1] = -about_z[:, 1, 0]
    about_z[:, 2, 2] = 1.0
    frames = np.stack([_with_z(z) for z in many / lengths[:, None]])
    return np.asarray((frames[:, None] @ about_z[None]).reshape(-1, 3, 3))


def _with_z(z: Array) -> Array:
    """A rotation (3, 3) whose third column is the unit vector z (3,)."""
    near = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = near - (near @ z) * z
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)
