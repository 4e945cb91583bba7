"""A smooth path in joint space: cubic pieces that meet with equal tangents."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pinproof._core import spline_slopes
from pinproof.errors import InputError
from pinproof.motion import bezier
from pinproof.motion.curve import BezierCurve, checked_joint_names, increasing, read_only
from pinproof.spatial import Array, finite


@dataclass(frozen=True, eq=False, init=False, repr=False)
class CubicPath(BezierCurve):
    """A C1 cubic Hermite spline over a path parameter; no timing.

    It represents curves that are smooth in joint space, such as a straight line of the tcp. The arm does not stop at
    its points, in contrast to the corners of a :class:`~pinproof.motion.JointPath`.

    Parameters
    ----------
    q
        (m, n) points on the path, m >= 1, in radians or metres.
    tangents
        (m, n) derivatives with respect to the path parameter at the points.
    knots
        (m,) path parameters of the points, strictly increasing, without unit.
    joint_names
        The n joints, in the order of the columns.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, knots do not increase, or joint names are invalid.
    """

    q: Array
    tangents: Array
    knots: Array
    joint_names: tuple[str, ...]

    NUMBERS = ("q", "tangents", "knots")

    def __init__(
        self, q: npt.ArrayLike, tangents: npt.ArrayLike, knots: npt.ArrayLike, joint_names: Iterable[str]
    ) -> None:
        names = checked_joint_names(joint_names)
        points = finite("q", q, (None, len(names)))
        if len(points) == 0:
            raise InputError("q has no point; a path requires at least one")
        object.__setattr__(self, "q", read_only(points))
        object.__setattr__(self, "tangents", read_only(finite("tangents", tangents, points.shape)))
        object.__setattr__(self, "knots", read_only(increasing(finite("knots", knots, (len(points),)))))
        object.__setattr__(self, "joint_names", names)

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

    def bezier(self) -> tuple[Array, Array]:
        """Knots (k+1,) and control points (k, 4, n), one piece between consecutive points."""
        return self._pieces

    def reversed(self) -> CubicPath:
        """The same image from end to start, over the same domain."""
        first, last = self.domain
        knots = np.concatenate([[first], first + (last - self.knots[-2::-1])]) if len(self.q) > 1 else self.knots
        return CubicPath(self.q[::-1], -self.tangents[::-1], knots, self.joint_names)

    @cached_property
    def _pieces(self) -> tuple[Array, Array]:
        if len(self.q) == 1:
            return read_only(np.repeat(self.knots, 2)), read_only(np.stack([self.q] * 4, axis=1))
        return self.knots, read_only(bezier.hermite(self.knots, self.q, self.tangents))

    def __repr__(self) -> str:
        return f"CubicPath({len(self.q)} points, {len(self.joint_names)} joints)"
