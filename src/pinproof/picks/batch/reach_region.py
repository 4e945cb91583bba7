"""The points and the tool orientations of a reach map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.common.validation import require_integer, require_positive
from pinproof.errors import InputError
from pinproof.spatial import Array, finite, unit_vector

GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
"""Radians between consecutive points of the spiral."""


def approach_directions(axis: npt.ArrayLike = (0.0, 0.0, -1.0), half_angle: float = 0.0, count: int = 1) -> Array:
    """(count, 3) unit vectors distributed evenly over the cone of ``half_angle`` (rad) about ``axis`` (3,).

    The vectors lie on a Fibonacci spiral, and each represents the same area of the sphere. A ``half_angle`` of pi
    covers the complete sphere. A ``count`` of 1 gives only the axis.

    Raises
    ------
    InputError
        If the axis is zero, the angle is outside [0, pi], or the count is not a positive integer.

    References
    ----------
    Swinbank, Purser (2006), "Fibonacci grids: a novel approach to global modelling".
    """
    direction = np.array(unit_vector("axis", axis))
    require_positive("half_angle", half_angle, zero=True)
    if half_angle > np.pi:
        raise InputError(f"half_angle = {half_angle}; it must be from 0 to pi rad")
    require_integer("count", count, 1)
    if count == 1 or half_angle == 0.0:
        return direction[None]
    index = np.arange(count)
    height = 1.0 - (1.0 - np.cos(half_angle)) * (index + 0.5) / count
    radius, turn = np.sqrt(1.0 - height**2), GOLDEN_ANGLE * index
    around = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)
    return np.asarray(around @ _with_z(direction).T)


def tool_orientations(directions: npt.ArrayLike = (0.0, 0.0, -1.0), spins: int = 8) -> Array:
    """(d * spins, 3, 3) ``root_from_tip`` rotations whose z axis is along the directions (3,) or (d, 3).

    For each direction there are ``spins`` rotations about it, evenly distributed over 2 pi. The x axis of the first one
    is as close as possible to the x axis of the root (to its y axis if the direction is close to x).

    Raises
    ------
    InputError
        If a direction is zero or the number of spins is not a positive integer.
    """
    # nested lists of different lengths have no dimension; finite() then names the valid shapes
    single = np.ndim(np.asarray(directions, dtype=object)) == 1 and not isinstance(directions, str)
    many = finite("directions", directions, (3,) if single else (None, 3)).reshape(-1, 3)
    lengths = np.linalg.norm(many, axis=1)
    if not (lengths > 1e-9).all():
        raise InputError(f"direction {int(np.flatnonzero(lengths <= 1e-9)[0])} is zero")
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


MOST_POINTS = 5_000_000
"""Largest number of points of a grid; more usually means that the step was given in millimetres."""


@dataclass(frozen=True, eq=False)
class ReachRegion:
    """Points in the frame of the robot's root link.

    Parameters
    ----------
    points
        (N, 3) in metres.
    axes
        The coordinates of a grid along x, y and z, in whose points z varies fastest; None if the points are not a grid.

    Raises
    ------
    InputError
        If there are no points, or a coordinate is not finite.
    """

    points: Array
    axes: tuple[Array, Array, Array] | None = None

    def __post_init__(self) -> None:
        points = finite("points", self.points, (None, 3))
        if not len(points):
            raise InputError("points is empty; a region needs at least one point")
        points.flags.writeable = False
        object.__setattr__(self, "points", points)

    @classmethod
    def box(cls, lower: npt.ArrayLike, upper: npt.ArrayLike, step: float) -> ReachRegion:
        """A grid over the box from ``lower`` to ``upper`` (3,), both included.

        If coordinates of the corners are equal, the grid is a surface, a line or a point. The points are evenly spaced,
        at most ``step`` (m) apart.

        Raises
        ------
        InputError
            If an upper coordinate is below the lower one, the step is not positive, or there are too many points.
        """
        low, high = finite("lower", lower, (3,)), finite("upper", upper, (3,))
        for name, a, b in zip("xyz", low, high, strict=True):
            if b < a:
                raise InputError(f"the region's upper {name} = {b} is below its lower {name} = {a}")
        if not 0.0 < step < np.inf:
            raise InputError(f"step = {step}; it must be a distance in metres above 0")
        # rounding errors must not add a point to a side that is a multiple of the step
        counts = [int(np.ceil((b - a) / step * (1.0 - 1e-12))) + 1 for a, b in zip(low, high, strict=True)]
        if np.prod([float(count) for count in counts]) > MOST_POINTS:
            raise InputError(
                f"a step of {step} m makes {' x '.join(map(str, counts))} points, more than {MOST_POINTS}; "
                "choose a larger step"
            )
        x, y, z = (np.linspace(a, b, count) for a, b, count in zip(low, high, counts, strict=True))
        grid = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
        return cls(grid.reshape(-1, 3), (x, y, z))

    @property
    def shape(self) -> tuple[int, ...]:
        """The numbers of points along x, y and z for a grid; otherwise (N,)."""
        return (len(self.points),) if self.axes is None else tuple(len(axis) for axis in self.axes)

    def equals(self, other: ReachRegion) -> bool:
        """Whether both regions have the same points in the same order."""
        return bool(np.array_equal(self.points, other.points))

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        return f"ReachRegion({' x '.join(map(str, self.shape))} points)"
