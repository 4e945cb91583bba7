"""A path made ready to be timed: pieces, where it must stop, which pieces are straight, and its derivatives."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from pinproof.motion import bezier
from pinproof.motion.curve import Array, Curve
from pinproof.motion.joint_path import JointPath
from pinproof.motion.limits import Bounds

__all__ = ["ON_LINE_TOLERANCE", "Track"]

ON_LINE_TOLERANCE = 1e-13
"""How far (relative to a joint's largest coordinate, at least 1 rad or m) a point may lie off a straight line to count
as on it: a few roundings, so that the image does not change."""

SAME_TANGENT = 1e-6
"""Relative to the faster of two pieces: derivatives that differ by less where they meet are equal; else the motion
stops between them, where the path does not name its corners itself."""

MOST_STEPS_A_PIECE = 64
"""Steps at first; where they do not do, they are cut."""

FEWEST_STEPS = 8
"""Steps at least on the bent pieces together: on a single one, at rest at both ends, nothing would move."""


UNEVEN = 8.0
"""Times what an even speed would make of it: how far curves are off paths that are run through at changing speeds."""


class Track:
    """The pieces of a path over s, a parameter that runs about as the seconds will.

    Attributes
    ----------
    knots
        (k+1,) s at the ends of the pieces.
    straight
        (k,) whether a piece is a straight line run through evenly: s'' moves it as a straight line moves.
    stops
        (k+1,) whether the motion must stop at a knot; its ends are not among them.
    run
        (k,) how many stops lie before a piece.
    coasts
        (k,) whether between the stops around it, or the ends, the path begins and ends with a straight piece.
    """

    def __init__(self, curve: Curve, bounds: Bounds) -> None:
        self.joint_names = curve.joint_names
        if isinstance(curve, JointPath):
            corners = _corners(curve.q)
            knots, control = np.arange(len(corners), dtype=float), np.stack([corners[:-1], corners[1:]], axis=1)
        else:
            knots, control = curve.bezier()
        width, slope = np.diff(knots), np.abs(bezier.derivative(knots, control))
        at_full_speed = float(width @ (slope / bounds.velocity).max(axis=(1, 2)))
        at_full_acceleration = float(width @ (slope / bounds.acceleration).max(axis=(1, 2)))
        scale = (at_full_speed + 2.0 * math.sqrt(at_full_acceleration)) / (knots[-1] - knots[0])
        self.knots = (knots - knots[0]) * scale
        self.control = [control]
        for _ in range(3):
            self.control.append(bezier.derivative(self.knots, self.control[-1]))
        share = np.linspace(0.0, 1.0, bezier.degree(control) + 1)[:, None]
        even = control[:, :1] * (1.0 - share) + control[:, -1:] * share
        near = ON_LINE_TOLERANCE * np.maximum(1.0, np.abs(control).max(axis=(0, 1)))
        self.straight: npt.NDArray[np.bool_] = (np.abs(control - even) <= near).all(axis=(1, 2))
        self.stops = np.zeros(len(knots), dtype=bool)
        if isinstance(curve, JointPath):
            self.stops[1:-1] = True
        elif hasattr(curve, "corners"):
            self.stops[1:-1] = np.isin(knots[1:-1], np.asarray(curve.corners, dtype=float))
        else:
            first = self.control[1]
            gap = np.abs(first[1:, 0] - first[:-1, -1]).max(axis=1)
            fastest = np.abs(first).max(axis=(1, 2))
            self.stops[1:-1] = gap > SAME_TANGENT * np.maximum(fastest[1:], fastest[:-1])

        self.run: npt.NDArray[np.intp] = np.concatenate([[0], np.cumsum(self.stops[1:-1])])
        starts = np.flatnonzero(np.concatenate([[True], self.stops[1:-1]]))
        ends = np.concatenate([starts[1:], [len(control)]])
        self.coasts: npt.NDArray[np.bool_] = np.repeat(self.straight[starts] & self.straight[ends - 1], ends - starts)

    def piece_of(self, s: Array) -> npt.NDArray[np.intp]:
        """(N,) the piece on which s lies; of two that meet there, the one behind."""
        return np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, len(self.straight) - 1)

    def at(self, s: Array, order: int = 0, piece: npt.NDArray[np.intp] | None = None) -> Array:
        """(N, n) the path or its derivative by s; on the pieces told, which are taken at their ends beyond them."""
        piece = self.piece_of(s) if piece is None else piece
        u = ((s - self.knots[piece]) / (self.knots[piece + 1] - self.knots[piece])).clip(0.0, 1.0)
        return bezier.on_pieces(self.control[order], piece, u)

    def curvature(self, s: Array) -> Array:
        """(N, n) the second derivative by s; at a knot the mean of both sides, which are equal on a C2 path."""
        before = np.clip(np.searchsorted(self.knots, s, side="left") - 1, 0, len(self.straight) - 1)
        return 0.5 * (self.at(s, 2) + self.at(s, 2, before))

    def in_steps(self, tolerance: float) -> tuple[Array, npt.NDArray[np.intp]]:
        """A first grid (N+1,) over s, and the piece (N,) each step lies on.

        A straight piece is one step. A bent one gets as many as let cubic Hermite pieces follow it at an even speed:
        they miss a function by h^4 / 384 times its fourth derivative (P. J. Davis, "Interpolation and Approximation",
        1975, section 3.5).
        """
        fourth = np.abs(bezier.derivative(self.knots, self.control[3])).max(axis=(1, 2))
        missed = UNEVEN * fourth * np.diff(self.knots) ** 4 / 384.0
        count = np.ceil((missed / tolerance) ** 0.25).clip(2, MOST_STEPS_A_PIECE).astype(int)
        bent = int(np.count_nonzero(~self.straight))
        count = np.where(self.straight, 1, np.maximum(count, math.ceil(FEWEST_STEPS / max(bent, 1))))
        return cut(self.knots, count), np.repeat(np.arange(len(count)), count)


def cut(grid: Array, parts: npt.NDArray[np.int_]) -> Array:
    """The grid with each step cut into equal parts."""
    begin = np.cumsum(parts) - parts
    share = (np.arange(int(parts.sum())) - np.repeat(begin, parts)) / np.repeat(parts, parts)
    left, right = np.repeat(grid[:-1], parts), np.repeat(grid[1:], parts)
    return np.concatenate([left * (1.0 - share) + right * share, grid[-1:]])


def _corners(q: Array) -> Array:
    """The waypoints where the motion must stop: repeated ones and those on a straight run are left out."""
    moves = np.concatenate([[True], (np.diff(q, axis=0) != 0.0).any(axis=1)])
    q = q[moves]
    corners, first = [0], 0
    while first < len(q) - 1:
        last = first + 1
        while last + 1 < len(q) and _straight(q[first : last + 2]):
            last += 1
        corners.append(last)
        first = last
    return q[corners]


def _straight(q: Array) -> bool:
    """Whether the inner points lie on the segment from the first to the last point, in order."""
    chord = q[-1] - q[0]
    s = (q - q[0]) @ chord / max(float(chord @ chord), np.finfo(float).tiny)
    off = np.abs(q[0] + s[:, None] * chord - q)
    return bool((np.diff(s) > 0.0).all() and (off <= ON_LINE_TOLERANCE * np.maximum(1.0, np.abs(q).max(axis=0))).all())
