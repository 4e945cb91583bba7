r"""How far bodies can move towards each other while the joints stay in a box about a configuration.

Let q be a configuration and let every model joint i stay within delta_i of q_i. Fix body a and walk outward to body b
over the joints between them. Move these joints one after another, the one nearest to a first: moving joint i carries
all that lies beyond it, b and the later axes alike, as one rigid thing, and that thing still has the shape it has at q.
So the points of b move by at most rho_i delta_i, where rho_i is the largest speed of a point of b per unit rate of
joint i, at q: its distance from the axis for a revolute joint, 1 for a prismatic one. Altogether, at every
configuration in the box,

.. math:: d(q') \ge d(q) - \sum_i \rho_i \delta_i .

Fixing b and walking to a is just as good, with rho_i taken over the points of a; the smaller sum is used. Exchanging
the roles joint by joint, or a smallest radius in place of the largest, would be wrong.

The speed of a point x under joint i is \|v_i + w_i x\| with the joint's spatial Jacobian column (v_i, w_i); it is
convex in x, so over a box around b it is largest at a corner.

Sources: F. Schwarzer, M. Saha, J.-C. Latombe (2005), "Adaptive dynamic collision checking for single and multiple
articulated robots in complex environments", IEEE Transactions on Robotics 21(3), section III; S. Quinlan (1994),
"Real-time modification of collision-free paths", PhD thesis, Stanford, chapter 3.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.bodies import boxes
from pinproof.collision.checker import CollisionChecker
from pinproof.collision.placed import Placed

__all__ = ["MotionBounds"]

Array = npt.NDArray[np.float64]

_CORNERS = np.array(np.meshgrid((-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0))).reshape(3, 8).T


class MotionBounds:
    """The bounds of a checker's pairs, all at once.

    B bodies, P pairs, m model joints (followers included), n joints in q.
    """

    def __init__(self, checker: CollisionChecker) -> None:
        model = checker.arm.model
        self._model = model
        self._data = model.createData()
        self._scale, self._offset = checker.arm.scale, checker.arm.offset
        self.a, self.b = (np.array([pair[side] for pair in checker.pairs], dtype=np.int64) for side in (0, 1))
        self._centre, self._half = boxes(checker.bodies)
        self._radius = np.linalg.norm(self._half, axis=1)
        self._corners = self._centre[:, None, :] + _CORNERS * self._half[:, None, :]  # (B, 8, 3)
        # carried[i, k]: joint k + 1 of the model carries body i
        carried = np.zeros((len(checker.bodies), model.nv))
        for body, joint in enumerate(checker.body_joints):
            carried[body, [k - 1 for k in model.supports[int(joint)] if k > 0]] = 1.0
        self._between = np.abs(carried[self.a] - carried[self.b])  # (P, m): joints on exactly one of the two ways
        self.moving = self._between @ np.abs(self._scale) > 0  # (P, n)

    def at(self, q: Array, space: Placed) -> Frame:
        """Everything that depends on q (n,) alone; ``space`` must be placed there."""
        data = self._data
        pin.computeJointJacobians(self._model, data, self._scale @ q + self._offset)
        columns = data.J.reshape(6, -1)  # a single joint's column comes as a flat (6,)
        linear, angular = columns[:3].T, columns[3:].T  # (m, 3) each: spatial, about the root's origin
        placements = [space.placement(i) for i in range(len(self._centre))]
        rotation = np.array([p.rotation for p in placements]).reshape(-1, 3, 3)
        translation = np.array([p.translation for p in placements]).reshape(-1, 3)
        corners = self._corners @ rotation.transpose(0, 2, 1) + translation[:, None, :]
        # |v + w x|, corner by corner and for every joint: with the roles exchanged, also of joints that do not carry it
        w, x = angular[None, None], corners[:, :, None]
        speed = np.empty((*corners.shape[:2], len(linear), 3))
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            speed[..., i] = w[..., j] * x[..., k] - w[..., k] * x[..., j] + linear[:, i]
        rho = np.sqrt(np.einsum("bcmi,bcmi->bcm", speed, speed).max(axis=1))
        return Frame(self, rho, rotation, translation)


class Frame:
    """The bounds at one configuration."""

    def __init__(self, bounds: MotionBounds, rho: Array, rotation: Array, translation: Array) -> None:
        self._bounds, self._rho, self._rotation, self._translation = bounds, rho, rotation, translation

    def approach(self, delta: Array, pairs: npt.NDArray[np.int64]) -> Array:
        """How much nearer (m) each of the given pairs can come while each joint of q stays within delta (n,)."""
        bounds = self._bounds
        moved = self._rho * (np.abs(bounds._scale) @ delta)  # (B, m)
        between = bounds._between[pairs]
        by_b = np.einsum("pm,pm->p", between, moved[bounds.b[pairs]])
        by_a = np.einsum("pm,pm->p", between, moved[bounds.a[pairs]])
        return np.minimum(by_a, by_b)

    def coarse_distance(self, pairs: npt.NDArray[np.int64]) -> Array:
        """A lower bound (m) of the distance of each given pair: the ball about one against the box of the other."""
        bounds = self._bounds
        a, b = bounds.a[pairs], bounds.b[pairs]
        centre = self._translation + np.einsum("bij,bj->bi", self._rotation, bounds._centre)
        return np.maximum(self._ball_to_box(centre, b, a), self._ball_to_box(centre, a, b))

    def _ball_to_box(self, centre: Array, ball: npt.NDArray[np.int64], box: npt.NDArray[np.int64]) -> Array:
        bounds = self._bounds
        offset = np.einsum("pji,pj->pi", self._rotation[box], centre[ball] - centre[box])
        outside = np.maximum(np.abs(offset) - bounds._half[box], 0.0)
        return np.asarray(np.sqrt(np.einsum("pi,pi->p", outside, outside)) - bounds._radius[ball])
