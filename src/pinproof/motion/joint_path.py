"""A path of straight segments in joint space."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pinproof.common.results import Rows, Shown, View
from pinproof.errors import InputError
from pinproof.motion.curve import BezierCurve, checked_joint_names, ends_meet, read_only
from pinproof.spatial import Array, finite


@dataclass(frozen=True, eq=False, init=False, repr=False)
class JointPath(BezierCurve, Shown):
    """Straight segments between waypoints; no timing.

    The parameter is the index of the waypoint as a float: ``path(1.5)`` is the middle between waypoints 1 and 2. A path
    may have a single waypoint, and consecutive waypoints may be equal.

    Parameters
    ----------
    q
        (m, n) waypoints, m >= 1, in radians or metres.
    joint_names
        The n joints, in the order of the columns.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, or joint names are empty or repeated.
    """

    q: Array
    joint_names: tuple[str, ...]

    NUMBERS = ("q",)

    def __init__(self, q: npt.ArrayLike, joint_names: Iterable[str]) -> None:
        names = checked_joint_names(joint_names)
        waypoints = finite("q", q, (None, len(names)))
        if len(waypoints) == 0:
            raise InputError("q has no waypoint; a path requires at least one")
        object.__setattr__(self, "q", read_only(waypoints))
        object.__setattr__(self, "joint_names", names)

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

    def bezier(self) -> tuple[Array, Array]:
        """Knots (k+1,) and control points (k, 2, n), one piece per segment."""
        return self._pieces

    @cached_property
    def length(self) -> float:
        """Sum of the segments' Euclidean lengths in joint space (radians and metres have equal weight)."""
        return float(np.linalg.norm(np.diff(self.q, axis=0), axis=1).sum())

    def reversed(self) -> JointPath:
        """The same image from end to start."""
        return JointPath(self.q[::-1], self.joint_names)

    @cached_property
    def _pieces(self) -> tuple[Array, Array]:
        if len(self.q) == 1:
            return read_only(np.zeros(2)), read_only(np.stack([self.q, self.q], axis=1))
        return read_only(np.arange(len(self.q), dtype=float)), read_only(np.stack([self.q[:-1], self.q[1:]], axis=1))

    def _view(self) -> View:
        rows = ([number, *q] for number, q in enumerate(self.q))
        head = f"{len(self.q)} waypoints, {len(self.joint_names)} joints, length {self.length:.6g}"
        title = f"Path of {len(self.q)} waypoints, length {self.length:.4g} (rad or m)"
        return View(head, [Rows(("waypoint", *self.joint_names), rows, len(self.q))], title=title)
