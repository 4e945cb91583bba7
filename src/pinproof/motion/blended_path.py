"""A path with rounded corners: polynomial pieces with continuous tangents, except at remaining stops."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.motion import bezier, corner
from pinproof.motion.cubic_path import CubicPath
from pinproof.motion.curve import BezierCurve, checked_joint_names, ends_meet, increasing, read_only
from pinproof.motion.joint_path import JointPath
from pinproof.spatial import Array, finite

MAX_DEGREE = 5
"""Maximum degree of a piece: a rounding prescribes position, tangent and zero second derivative at both ends."""

SAME_TANGENT = 1e-6
"""Relative difference of the derivatives of two adjacent pieces below which they are equal. The effect of rounding on
short pieces is permitted in addition. A larger difference is a corner."""

ROUNDINGS = 16
"""Rounding error of control points in units in the last place."""

GAUSS_POINTS = 16
"""Points of the quadrature of the length: relative error 1e-9 for corners up to 90 degrees, 1e-6 for sharper ones."""


@dataclass(frozen=True, eq=False, init=False, repr=False)
class BlendedPath(BezierCurve):
    """Polynomial pieces over a path parameter with a continuous derivative, except at the stops; no timing.

    In results of :meth:`rounded`, the parameter is the arc length on straight segments and close to it in corners.

    Parameters
    ----------
    knots
        (k+1,) path parameters at the ends of the pieces, strictly increasing. They may be equal only for one piece of
        zero width, a path of length 0.
    control
        (k, degree+1, n) control points in radians or metres, degree 1 to :data:`MAX_DEGREE`, see
        :mod:`pinproof.motion.bezier`. Each piece begins exactly at the end of the previous one.
    joint_names
        The n joints, in the order of the columns.
    corners
        Inner knots at which the arm must stop, increasing. Only there the derivative may jump.

    Raises
    ------
    InputError
        If a shape or the degree is wrong, a number is not finite, knots do not increase, pieces do not meet, a
        derivative jumps at a knot that is not a corner, a corner is not an inner knot, or joint names are invalid.
    """

    knots: Array
    control: Array
    joint_names: tuple[str, ...]
    corners: tuple[float, ...] = ()

    NUMBERS = ("control", "knots", "corners")

    def __init__(
        self,
        knots: npt.ArrayLike,
        control: npt.ArrayLike,
        joint_names: Iterable[str],
        corners: Iterable[float] = (),
    ) -> None:
        names = checked_joint_names(joint_names)
        points = finite("control", control, (None, None, len(names)))
        if len(points) == 0 or not 1 <= bezier.degree(points) <= MAX_DEGREE:
            raise InputError(
                f"control must contain at least one piece of degree 1 to {MAX_DEGREE}; its shape is {points.shape}"
            )
        parameter = finite("knots", knots, (len(points) + 1,))
        stops = tuple(finite("corners", list(corners), (None,)).tolist())
        _check_pieces(parameter, points, stops)
        object.__setattr__(self, "knots", read_only(parameter))
        object.__setattr__(self, "control", read_only(points))
        object.__setattr__(self, "joint_names", names)
        object.__setattr__(self, "corners", stops)

    @classmethod
    def rounded(cls, path: JointPath, reach: npt.ArrayLike) -> BlendedPath:
        """Round the corners of a path by quintic pieces, so that it is twice differentiable there.

        Parameters
        ----------
        path
            The path; consecutive waypoints must differ.
        reach
            (m,) distance before and after each waypoint (rad or m, Euclidean) at which its rounding begins and ends. 0
            keeps the corner, and the arm stops there. The first and the last must be 0. The distance between waypoint
            and rounding is given by :func:`pinproof.motion.corner.distance_to_corner`.

        Raises
        ------
        InputError
            If consecutive waypoints are equal, a reach is negative, two reaches together exceed their segment, or a
            reach is not 0 at a waypoint at which the path reverses its direction.
        """
        length = finite("reach", reach, (len(path),))
        knots, control = corner.round_off(path.q, length)
        return cls(knots, control, path.joint_names, knots[1:-1][_jumps(knots, control)].tolist())

    @classmethod
    def join(cls, *parts: JointPath | CubicPath | BlendedPath) -> BlendedPath:
        """Concatenate paths; the scale of the parameters is kept, and the arm stops where the derivatives differ.

        Pieces of length 0 are omitted, unless all pieces have length 0.

        Raises
        ------
        InputError
            If there is no path, or the end of a path is not the start of the next one.
        """
        if not parts:
            raise InputError("BlendedPath.join requires at least one path")
        for i, (first, second) in enumerate(pairwise(parts)):
            ends_meet(first, second, f"parts {i} and {i + 1}")
        pieces = [part.bezier() for part in parts]
        degree = max(bezier.degree(control) for _, control in pieces)
        control = np.concatenate([bezier.elevate(control, degree) for _, control in pieces])
        width = np.concatenate([np.diff(knots) for knots, _ in pieces])
        moving = (control != control[:, :1]).any(axis=(1, 2))
        if not moving.any():
            return cls(np.zeros(2), control[:1], parts[0].joint_names)
        control, width = control[moving], width[moving]
        control[1:, 0] = control[:-1, -1]  # replaces ends that agree to rounding by equal ones
        knots = np.concatenate([[0.0], np.cumsum(width)])
        return cls(knots, control, parts[0].joint_names, knots[1:-1][_jumps(knots, control)].tolist())

    def bezier(self) -> tuple[Array, Array]:
        """Knots (k+1,) and control points (k, degree+1, n)."""
        return self.knots, self.control

    @cached_property
    def length(self) -> float:
        """Euclidean length in joint space (radians and metres have equal weight), by Gauss-Legendre quadrature."""
        nodes, weights = np.polynomial.legendre.leggauss(GAUSS_POINTS)
        width = np.diff(self.knots)[:, None]
        at = (self.knots[:-1, None] + width * (0.5 + 0.5 * nodes)).ravel()
        velocity = bezier.evaluate(self.knots, bezier.derivative(self.knots, self.control), at)
        speed = np.linalg.norm(velocity, axis=1).reshape(len(width), -1)
        return float((0.5 * width * weights * speed).sum())

    def reversed(self) -> BlendedPath:
        """The same image from end to start, over the same domain."""
        first, last = self.domain
        knots = np.concatenate([[first], first + (last - self.knots[-2:0:-1]), [last]])
        inner = dict(zip(self.knots[1:-1].tolist(), knots[-2:0:-1].tolist(), strict=True))
        return BlendedPath(
            knots, self.control[::-1, ::-1], self.joint_names, [inner[stop] for stop in self.corners[::-1]]
        )

    def __len__(self) -> int:
        """The number of pieces."""
        return len(self.control)

    def __repr__(self) -> str:
        stops = f", {len(self.corners)} stops" if self.corners else ""
        return f"BlendedPath({len(self)} pieces, {len(self.joint_names)} joints, length {self.length:.6g}{stops})"


def _check_pieces(knots: Array, control: Array, corners: tuple[float, ...]) -> None:
    constant = len(control) == 1 and knots[0] == knots[1]
    if constant and (control != control[0, 0]).any():
        raise InputError("a piece of zero width must have equal control points; they differ")
    if not constant:
        increasing(knots)
    gaps = (control[1:, 0] != control[:-1, -1]).any(axis=1)
    if gaps.any():
        i = int(np.flatnonzero(gaps)[0])
        raise InputError(f"the pieces {i} and {i + 1} do not meet: {control[i, -1]} and {control[i + 1, 0]}")
    if list(corners) != sorted(set(corners)) or not set(corners) <= set(knots[1:-1].tolist()):
        raise InputError(f"corners must be inner knots, increasing; they are {corners}")
    sharp = [t for t in knots[1:-1][_jumps(knots, control)].tolist() if t not in corners]
    if sharp:
        raise InputError(f"the derivative jumps at {sharp[0]}, which is not among the corners {corners}")


def _jumps(knots: Array, control: Array) -> npt.NDArray[np.bool_]:
    """(k-1,) whether the derivative jumps at each inner knot."""
    if len(control) == 1:
        return np.zeros(0, dtype=bool)
    slope = bezier.derivative(knots, control)
    fastest = np.abs(slope).max(axis=(1, 2))
    rounding = ROUNDINGS * np.spacing(np.abs(control).max()) * bezier.degree(control) / np.diff(knots)
    gap = np.abs(slope[1:, 0] - slope[:-1, -1]).max(axis=1)
    allowed = SAME_TANGENT * np.maximum(fastest[1:], fastest[:-1]) + np.maximum(rounding[1:], rounding[:-1])
    return np.asarray(gap > allowed)
