r"""How far the tcp may be off its route anywhere on a joint curve: a bound, from samples and second derivatives.

Between two samples that are h apart, a twice differentiable vector D differs from the straight line through its values
there by at most h^2 / 8 sup |D''|, so |D| is at most the larger of the two values plus that. D is taken as

* the difference of the positions, D = p - p_route, with |D''| <= |p''| + |p_route''|;
* the difference of the orientations as matrices (Frobenius norm), or of one axis; an angle of theta between two
  rotations is a distance of 2 sqrt(2) sin(theta / 2), between two unit vectors one of 2 sin(theta / 2).

For a chain of joints with values theta_k(s), outward k = 1..m, let r_k bound the distance of the tcp from the origin of
joint k (1 in its place for a joint that slides). Then

    |p''| <= sum_k r_k |theta_k''| + sum_k r_k |theta_k'| (|theta_k'| + 2 sum_{i<k} |theta_i'|)
    |w|   <= sum_k |theta_k'|,    |w'| <= sum_k |theta_k''| + sum_{i<k} |theta_i'| |theta_k'|

where the sums over i, and all of w, are over joints that turn: since d p / d theta_k = z_k x (p - o_k) is at most r_k
long, and turning an inner joint i turns it as a whole. With R' = [w] R and R'' = ([w'] + [w]^2) R the Frobenius norm of
R'' is at most sqrt(2) (|w'| + |w|^2), and the second derivative of one axis at most |w'| + |w|^2.

Source of the chain's derivatives: J. Craig, "Introduction to Robotics" (2005), sections 5.6 and 5.7.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from pinproof.model import Arm
from pinproof.motion import CubicPath, bezier
from pinproof.planning.route import Route

__all__ = ["Stray"]

Array = npt.NDArray[np.float64]

REMAINDER = 0.1
"""Share of the deviation allowed that may go to what lies between samples; it says how many are taken."""

FEWEST_SAMPLES, MOST_SAMPLES = 3, 4096
"""Steps between samples on a piece. A piece that would need more is refused: it is to be cut."""

SLIDES, LEADER, MULTIPLIER, OFFSET = 12, 13, 14, 15
"""Columns of :attr:`Arm.packed`, see :mod:`pinproof.kernels.chain`."""


class Stray:
    """Bounds of how far an arm's tcp is off a route.

    Parameters
    ----------
    arm
        The arm.
    asked
        (6,) which coordinates the task asks for. Of the rotation: all, none, or all but one.
    deviation, rotation_deviation
        Metres and radians that are allowed.
    """

    def __init__(self, arm: Arm, asked: Array, deviation: float, rotation_deviation: float) -> None:
        self._arm = arm
        self._allowed = deviation, rotation_deviation
        self._position = bool(asked[:3].any())
        turns = np.flatnonzero(asked[3:] > 0)
        free = np.flatnonzero(asked[3:] == 0)
        self._columns = np.arange(3) if len(turns) == 3 else free if len(turns) == 2 else np.empty(0, dtype=int)
        self._norm = math.sqrt(2.0) if len(turns) == 3 else 1.0

    def bound(self, path: CubicPath, route: Route) -> Array:
        """(k, 2) metres and radians by which the tcp may be off anywhere on each piece.

        Infinite where too many samples were needed to tell. Path and route have the same parameter, and the path's
        knots hold all borders of the route as far as it goes.
        """
        knots, control = path.bezier()
        width = np.diff(knots)
        pull, spin = self._second_derivatives(knots, control, route)
        metres, radians = self._allowed
        chord = 2.0 * self._norm * math.sin(min(radians, math.pi) / 2.0)
        steps = np.zeros(len(width))
        if self._position:
            steps = np.maximum(steps, width * np.sqrt(pull / (8.0 * REMAINDER * metres)))
        if len(self._columns):
            steps = np.maximum(steps, width * np.sqrt(spin / (8.0 * REMAINDER * chord)))
        hopeless = ~(steps <= MOST_SAMPLES)
        counts = np.where(hopeless, FEWEST_SAMPLES, np.clip(np.ceil(steps), FEWEST_SAMPLES, MOST_SAMPLES)).astype(int)
        first = np.concatenate([[0], np.cumsum(counts)])
        piece = np.repeat(np.arange(len(width)), counts)
        inside = (np.arange(first[-1]) - first[:-1][piece]) / counts[piece]
        s = np.minimum(np.append(knots[piece] + width[piece] * inside, knots[-1]), knots[-1])
        seen = np.stack(self._seen(path(s), route.poses(s)), axis=1)
        worst = np.maximum(np.maximum.reduceat(seen[:-1], first[:-1]), seen[first[1:]])
        remainder = (width / counts) ** 2 / 8.0
        off = np.stack([worst[:, 0] + remainder * pull, worst[:, 1] + remainder * spin], axis=1)
        off[:, 1] = 2.0 * np.arcsin(np.minimum(off[:, 1] / (2.0 * self._norm), 1.0))
        off[:, 0] *= self._position
        off[:, 1] *= bool(len(self._columns))
        off[hopeless] = np.inf
        return off

    def _seen(self, q: Array, wanted: Array) -> tuple[Array, Array]:
        """|D| (N,) of position and orientation at configurations q (N, n)."""
        gap = self._arm.forward_kinematics_batch(q)[:, :3] - wanted[:, :3]
        turned = gap[:, :, self._columns]
        return np.linalg.norm(gap[:, :, 3], axis=1), np.sqrt(np.einsum("nij,nij->n", turned, turned))

    def _second_derivatives(self, knots: Array, control: Array, route: Route) -> tuple[Array, Array]:
        """(k,) bounds of |D''| on each piece: of the position, and of the orientation."""
        chain = self._arm.packed
        joints, leader = chain[:-1], chain[:-1, LEADER].astype(int)
        scale, turns = np.abs(joints[:, MULTIPLIER]), joints[:, SLIDES] == 0.0
        first = bezier.derivative(knots, control)
        rate = np.abs(first).max(axis=1)[:, leader] * scale
        second = np.abs(bezier.derivative(knots, first)).max(axis=1)[:, leader] * scale
        turning = rate * turns
        inner = np.cumsum(turning, axis=1) - turning
        lever = self._levers(control)
        pull = (lever * second + lever * rate * (turning + 2.0 * inner)).sum(axis=1)
        spin = turning.sum(axis=1)
        change = (second * turns + turning * inner).sum(axis=1)
        of_route = route.derivatives(knots)
        turned = change + spin**2 + of_route[:, 2] + of_route[:, 1] ** 2
        return pull + of_route[:, 0], self._norm * turned

    def _levers(self, control: Array) -> Array:
        """(m,) how far the tcp is at most from the origin of each joint, 1 for a joint that slides."""
        chain = self._arm.packed
        joints = chain[:-1]
        reached = np.abs(control[:, :, joints[:, LEADER].astype(int)]).max(axis=(0, 1))
        slid = (np.abs(joints[:, MULTIPLIER]) * reached + np.abs(joints[:, OFFSET])) * joints[:, SLIDES]
        links = np.linalg.norm(chain[1:, [3, 7, 11]], axis=1) + np.append(slid[1:], 0.0)
        lever = np.cumsum(links[::-1])[::-1]
        return np.where(joints[:, SLIDES] != 0.0, 1.0, lever)
