"""Paths in joint space, without timing: straight segments, cubic splines, and segments with rounded corners.

A corner between two straight segments is rounded by one quintic piece. For a corner p with the incoming unit direction
u and the outgoing unit direction v, a rounding of reach d has the control points

    p - d u,  p - (d - h) u,  p - (d - 2 h) u,  p + (d - 2 h) v,  p + (d - h) v,  p + d v

Three of them are on each segment, at a distance h. Hence the curve has the direction of the segment and no second
derivative at both ends, and segment, rounding and segment together are twice differentiable with respect to the
parameter. Over a parameter interval of width 5 h, the speed at the ends is 1, as on the segments. h = c d is chosen
such that the speed in the middle,

    |u + v| (6 / c - 7) / 16,

is 1 as well, so that the parameter is close to the arc length: c = 6 / (7 + 16 / |u + v|), from 0.4 for a straight
line to 0 for a reversal. By symmetry the middle is the point nearest to p, at the distance d |v - u| (16 - 25 c) / 32.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pinproof._core import spline_slopes
from pinproof.common.results import Rows, Shown, View
from pinproof.common.structs import Accepting, described, key
from pinproof.errors import InputError
from pinproof.motion.curve import Bezier, BezierCurve, checked_joint_names, ends_meet, increasing, read_only
from pinproof.spatial import Array, finite

# Maximum degree of a piece: a rounding prescribes position, tangent and zero second derivative at both ends.
MAX_DEGREE = 5
# Relative difference of the derivatives of two adjacent pieces below which they are equal. The effect of rounding on
# short pieces is permitted in addition. A larger difference is a corner.
SAME_TANGENT = 1e-6
# Rounding error of control points in units in the last place.
ROUNDINGS = 16
# Points of the quadrature of the length: relative error 1e-9 for corners up to 90 degrees, 1e-6 for sharper ones.
GAUSS_POINTS = 16

REVERSAL = 0.1
"""Length of the sum of the unit directions into and out of a corner below which it is not rounded: the direction is
reversed to within 6 degrees, and the arm would almost stop in a rounding."""

# Length (rad or m) below which the segment between two roundings is omitted.
MIN_SEGMENT = 1e-12


@described(eq=False, repr=False)
class JointPath(BezierCurve, Shown):
    """Straight segments between waypoints; no timing.

    The parameter is the index of the waypoint as a float: ``path(1.5)`` is the middle between waypoints 1 and 2. A path
    may have a single waypoint, and consecutive waypoints may be equal.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, or joint names are empty or repeated.
    """

    q: Accepting[Array, npt.ArrayLike] = key("(m, n) waypoints, m >= 1, in radians or metres")
    joint_names: Accepting[tuple[str, ...], Iterable[str]] = key("the n joints, in the order of the columns")

    NUMBERS = ("q",)

    def __hash__(self) -> int:
        """Different for most paths, so that caches find one without comparing it with the others."""
        return hash((len(self.q), float(self.q[0].sum()), float(self.q[-1].sum())))

    def __post_init__(self) -> None:
        names = checked_joint_names(self.joint_names)
        waypoints = finite("q", self.q, (None, len(names)))
        if len(waypoints) == 0:
            raise InputError("q has no waypoint; a path requires at least one")
        self._set(q=waypoints, joint_names=names)

    @classmethod
    def join(cls, *parts: JointPath) -> JointPath:
        """Concatenate paths.

        Raises
        ------
        InputError
            If there is no path, or the end of a path is not the start of the next one.
        """
        if not parts:
            raise InputError("JointPath.join requires at least one path")
        rows = [parts[0].q]
        for i, (first, second) in enumerate(pairwise(parts)):
            ends_meet(first, second, f"parts {i} and {i + 1}")
            # Ends that differ by rounding are both kept, so that the image is the union of the parts.
            rows.append(second.q[1:] if np.array_equal(first.end, second.start) else second.q)
        return cls(np.concatenate(rows), parts[0].joint_names)

    def __add__(self, other: JointPath) -> JointPath:
        return JointPath.join(self, other)

    def __len__(self) -> int:
        """The number of waypoints."""
        return len(self.q)

    @cached_property
    def _pieces(self) -> Bezier:
        """One piece per segment."""
        if len(self.q) == 1:
            return Bezier(read_only(np.zeros(2)), read_only(np.stack([self.q, self.q], axis=1)))
        knots, control = np.arange(len(self.q), dtype=float), np.stack([self.q[:-1], self.q[1:]], axis=1)
        return Bezier(read_only(knots), read_only(control))

    @cached_property
    def length(self) -> float:
        """Sum of the segments' Euclidean lengths in joint space (radians and metres have equal weight)."""
        return float(np.linalg.norm(np.diff(self.q, axis=0), axis=1).sum())

    def reversed(self) -> JointPath:
        """The same image from end to start."""
        return JointPath(self.q[::-1], self.joint_names)

    def _view(self) -> View:
        rows = ([number, *q] for number, q in enumerate(self.q))
        head = f"{len(self.q)} waypoints, {len(self.joint_names)} joints, length {self.length:.6g}"
        title = f"Path of {len(self.q)} waypoints, length {self.length:.4g} (rad or m)"
        return View(head, [Rows(("waypoint", *self.joint_names), rows, len(self.q))], title=title)


@described(eq=False, repr=False)
class CubicPath(BezierCurve):
    """A C1 cubic Hermite spline over a path parameter; no timing.

    It represents curves that are smooth in joint space, such as a straight line of the tcp. The arm does not stop at
    its points, in contrast to the corners of a :class:`~pinproof.motion.JointPath`.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, knots do not increase, or joint names are invalid.
    """

    q: Accepting[Array, npt.ArrayLike] = key("(m, n) points on the path, m >= 1, in radians or metres")
    tangents: Accepting[Array, npt.ArrayLike] = key("(m, n) derivatives with respect to the path parameter there")
    knots: Accepting[Array, npt.ArrayLike] = key(
        "(m,) path parameters of the points, strictly increasing, without unit"
    )
    joint_names: Accepting[tuple[str, ...], Iterable[str]] = key("the n joints, in the order of the columns")

    NUMBERS = ("q", "tangents", "knots")

    def __post_init__(self) -> None:
        names = checked_joint_names(self.joint_names)
        points = finite("q", self.q, (None, len(names)))
        if len(points) == 0:
            raise InputError("q has no point; a path requires at least one")
        slopes, parameter = finite("tangents", self.tangents, points.shape), finite("knots", self.knots, (len(points),))
        self._set(q=points, tangents=slopes, knots=increasing(parameter), joint_names=names)

    @classmethod
    def through(cls, q: npt.ArrayLike, joint_names: Iterable[str], knots: npt.ArrayLike | None = None) -> CubicPath:
        """The C2 cubic spline through points (not-a-knot ends; a parabola through 3 points, a line through 2).

        Parameters
        ----------
        q
            (m, n) points.
        joint_names
            The n joints.
        knots
            (m,) path parameters of the points, strictly increasing. By default the chord length: the sum of Euclidean
            distances in joint space up to each point.

        Raises
        ------
        InputError
            As for the constructor; also if consecutive points are equal and ``knots`` is not given.

        Notes
        -----
        C. de Boor, "A Practical Guide to Splines" (2001), chapter IV.
        """
        names = checked_joint_names(joint_names)
        points = finite("q", q, (None, len(names)))
        if knots is None:
            chord = np.linalg.norm(np.diff(points, axis=0), axis=1)
            if not (chord > 0.0).all():
                i = int(np.flatnonzero(chord <= 0.0)[0])
                raise InputError(f"the points {i} and {i + 1} are equal; remove one, or give knots")
            parameter = np.concatenate([[0.0], np.cumsum(chord)])
        else:
            parameter = finite("knots", knots, (len(points),))
        parameter = increasing(parameter)
        if len(points) < 2:
            return cls(points, np.zeros_like(points), parameter[: len(points)], names)
        return cls(points, spline_slopes(parameter, points), parameter, names)

    @cached_property
    def _pieces(self) -> Bezier:
        """One piece between consecutive points."""
        if len(self.q) == 1:
            return Bezier(read_only(np.repeat(self.knots, 2)), read_only(np.stack([self.q] * 4, axis=1)))
        pieces = Bezier.hermite(self.knots, self.q, self.tangents)
        read_only(pieces.control)
        return pieces

    def reversed(self) -> CubicPath:
        """The same image from end to start, over the same domain."""
        first, last = self.domain
        knots = np.concatenate([[first], first + (last - self.knots[-2::-1])]) if len(self.q) > 1 else self.knots
        return CubicPath(self.q[::-1], -self.tangents[::-1], knots, self.joint_names)

    def __repr__(self) -> str:
        return f"CubicPath({len(self.q)} points, {len(self.joint_names)} joints)"


@described(eq=False, repr=False)
class BlendedPath(BezierCurve):
    """Polynomial pieces over a path parameter with a continuous derivative, except at the stops; no timing.

    In results of :meth:`rounded`, the parameter is the arc length on straight segments and close to it in corners.

    Raises
    ------
    InputError
        If a shape or the degree is wrong, a number is not finite, knots do not increase, pieces do not meet, a
        derivative jumps at a knot that is not a corner, a corner is not an inner knot, or joint names are invalid.
    """

    knots: Accepting[Array, npt.ArrayLike] = key(
        "(k+1,) path parameters at the ends of the pieces, strictly increasing. They may be equal only for one piece "
        "of zero width, a path of length 0"
    )
    control: Accepting[Array, npt.ArrayLike] = key(
        "(k, degree+1, n) control points in radians or metres, degree 1 to :data:`MAX_DEGREE`, see "
        ":class:`~pinproof.motion.Bezier`. Each piece begins exactly at the end of the previous one"
    )
    joint_names: Accepting[tuple[str, ...], Iterable[str]] = key("the n joints, in the order of the columns")
    corners: Accepting[tuple[float, ...], Iterable[float]] = key(
        "inner knots at which the arm must stop, increasing. Only there the derivative may jump", default=()
    )

    NUMBERS = ("control", "knots", "corners")

    def __post_init__(self) -> None:
        names = checked_joint_names(self.joint_names)
        points = finite("control", self.control, (None, None, len(names)))
        if len(points) == 0 or not 1 <= points.shape[1] - 1 <= MAX_DEGREE:
            raise InputError(
                f"control must contain at least one piece of degree 1 to {MAX_DEGREE}; its shape is {points.shape}"
            )
        parameter = finite("knots", self.knots, (len(points) + 1,))
        stops = tuple(finite("corners", list(self.corners), (None,)).tolist())
        # A path of length 0 is one piece of zero width. Otherwise knots increase and pieces meet exactly.
        constant = len(points) == 1 and parameter[0] == parameter[1]
        if constant and (points != points[0, 0]).any():
            raise InputError("a piece of zero width must have equal control points; they differ")
        if not constant:
            increasing(parameter)
        gaps = (points[1:, 0] != points[:-1, -1]).any(axis=1)
        if gaps.any():
            i = int(np.flatnonzero(gaps)[0])
            raise InputError(f"the pieces {i} and {i + 1} do not meet: {points[i, -1]} and {points[i + 1, 0]}")
        # The arm stops at corners only, so that the derivative must not jump elsewhere.
        if list(stops) != sorted(set(stops)) or not set(stops) <= set(parameter[1:-1].tolist()):
            raise InputError(f"corners must be inner knots, increasing; they are {stops}")
        if sharp := [t for t in _jumps(Bezier(parameter, points)) if t not in stops]:
            raise InputError(f"the derivative jumps at {sharp[0]}, which is not among the corners {stops}")
        self._set(knots=parameter, control=points, joint_names=names, corners=stops)

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
            and rounding is given by :func:`~pinproof.motion.corner_distance`.

        Raises
        ------
        InputError
            If consecutive waypoints are equal, a reach is negative, two reaches together exceed their segment, or a
            reach is not 0 at a waypoint at which the path reverses its direction.
        """
        q, reach = path.q, finite("reach", reach, (len(path),))
        if (reach < 0).any() or reach[0] != 0 or reach[-1] != 0:
            raise InputError(f"reach = {reach}; it must be 0 or more, and 0 at both ends")
        if len(q) == 1:
            return cls(np.zeros(2), np.repeat(q[:, None], 6, axis=1), path.joint_names)
        steps = np.diff(q, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        if not (lengths > 0).all():
            i = int(np.flatnonzero(lengths <= 0)[0])
            raise InputError(f"the waypoints {i} and {i + 1} are equal; remove one")
        directions = steps / lengths[:, None]
        rest = lengths - reach[:-1] - reach[1:]
        if (rest < -MIN_SEGMENT).any():
            i = int(np.flatnonzero(rest < -MIN_SEGMENT)[0])
            raise InputError(f"the reaches {reach[i]} and {reach[i + 1]} overlap on a segment of length {lengths[i]}")
        # Each segment as far as the roundings at its two ends leave it, followed by the rounding at its last end.
        widths, pieces, here = [], [], q[0]
        for i, towards in enumerate(directions):
            there = q[i + 1] - reach[i + 1] * towards if reach[i + 1] else q[i + 1]
            if rest[i] > MIN_SEGMENT:
                share = np.linspace(0.0, 1.0, 6)[:, None]
                pieces.append(here * (1.0 - share) + there * share)
                widths.append(rest[i])
            elif pieces:
                pieces[-1][-1] = there  # exactly the start of the next piece
            if reach[i + 1]:
                away = directions[i + 1]
                if np.linalg.norm(towards + away) < REVERSAL:
                    raise InputError(f"the path reverses its direction at waypoint {i + 1}; set its reach to 0")
                width, piece = round_corner(q[i + 1], towards, away, reach[i + 1])
                piece[0] = pieces[-1][-1] if pieces else q[0]  # exactly equal
                pieces.append(piece)
                widths.append(width)
                there = piece[-1]
            here = there
        pieces[-1][-1] = q[-1]
        return cls._with_stops(np.concatenate([[0.0], np.cumsum(widths)]), np.array(pieces), path.joint_names)

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
        degree = max(part.degree for part in pieces)
        control = np.concatenate([part.elevated(degree).control for part in pieces])
        width = np.concatenate([np.diff(part.knots) for part in pieces])
        moving = (control != control[:, :1]).any(axis=(1, 2))
        if not moving.any():
            return cls(np.zeros(2), control[:1], parts[0].joint_names)
        control, width = control[moving], width[moving]
        control[1:, 0] = control[:-1, -1]  # replaces ends that agree to rounding by equal ones
        return cls._with_stops(np.concatenate([[0.0], np.cumsum(width)]), control, parts[0].joint_names)

    @classmethod
    def _with_stops(cls, knots: Array, control: Array, joint_names: tuple[str, ...]) -> BlendedPath:
        """The path that stops wherever its derivative jumps."""
        return cls(knots, control, joint_names, _jumps(Bezier(knots, control)))

    @cached_property
    def _pieces(self) -> Bezier:
        return Bezier(self.knots, self.control)

    @cached_property
    def length(self) -> float:
        """Euclidean length in joint space (radians and metres have equal weight), by Gauss-Legendre quadrature."""
        nodes, weights = np.polynomial.legendre.leggauss(GAUSS_POINTS)
        width = np.diff(self.knots)[:, None]
        at = (self.knots[:-1, None] + width * (0.5 + 0.5 * nodes)).ravel()
        speed = np.linalg.norm(self.derivative(1).at(at), axis=1).reshape(len(width), -1)
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


def _jumps(pieces: Bezier) -> list[float]:
    """The inner knots at which the derivative jumps."""
    knots, control = pieces
    if len(control) == 1:
        return []
    slope = pieces.derivative().control
    fastest = np.abs(slope).max(axis=(1, 2))
    rounding = ROUNDINGS * np.spacing(np.abs(control).max()) * pieces.degree / np.diff(knots)
    gap = np.abs(slope[1:, 0] - slope[:-1, -1]).max(axis=1)
    allowed = SAME_TANGENT * np.maximum(fastest[1:], fastest[:-1]) + np.maximum(rounding[1:], rounding[:-1])
    return list(knots[1:-1][gap > allowed].tolist())


# -- the rounding of a corner -----------------------------------------------------------------------------------------


def corner_spacing(into: Array, out: Array) -> Array:
    """(k,) h / d of the rounding of a corner, for unit directions (k, n) into and out of corners."""
    result: Array = 6.0 / (7.0 + 16.0 / np.linalg.norm(into + out, axis=-1))
    return result


def corner_distance(into: Array, out: Array) -> Array:
    """(k,) distance between a corner and its rounding of reach 1, for unit directions (k, n) into and out of it."""
    result: Array = np.linalg.norm(out - into, axis=-1) * (16.0 - 25.0 * corner_spacing(into, out)) / 32.0
    return result


def round_corner(at: Array, into: Array, out: Array, reach: float) -> tuple[float, Array]:
    """The parameter width and the control points (6, n) of the rounding of a corner ``at`` (n,)."""
    h = reach * float(corner_spacing(into, out))
    before, after = reach - h * np.arange(3.0)[:, None], reach - h * np.arange(2.0, -1.0, -1.0)[:, None]
    return 5.0 * h, np.concatenate([at - before * into, at + after * out])
