"""Pinocchio's and coal's own answers on the bodies and pairs of a checker, as they come out of the box.

Nothing here is used by a check or a proof: it is what these are compared with, in verdicts and in time.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.checker import CollisionChecker

__all__ = ["PlainCoal"]

Array = npt.NDArray[np.float64]


class PlainCoal:
    """Checks by Pinocchio and coal alone; margins are those of the checker.

    Parameters
    ----------
    checker
        Which arm, bodies, pairs and margins.
    broadphase
        Let coal's dynamic tree of boxes choose the pairs to look at, in place of looking at each.
    """

    def __init__(self, checker: CollisionChecker, *, broadphase: bool = False) -> None:
        self._model, self._geometry = checker.arm.model, checker.geometry_model
        self._data, self._bodies = self._model.createData(), self._geometry.createData()
        for k, margin in enumerate(checker.margins.tolist()):
            request = self._bodies.collisionRequests[k]
            request.security_margin = margin
            self._bodies.collisionRequests[k] = request
        self._configuration, self._any = checker.arm.model_configuration, bool(checker.pairs)
        self._tree = None
        if broadphase:
            self._tree = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(
                self._model, self._geometry, self._bodies
            )

    def configurations(self, many: Array) -> list[Array]:
        """Configurations (N, n) of the arm as the model takes them, so that timing a check times nothing else."""
        return [self._configuration(q) for q in many]

    def is_free(self, q: Array) -> bool:
        """Whether no pair is found to come within its margin at a model's configuration."""
        if self._tree is not None:
            return not pin.computeCollisions(self._model, self._data, self._tree, q, True)
        return not pin.computeCollisions(self._model, self._data, self._geometry, self._bodies, q, True)

    def clearance(self, q: Array) -> float:
        """The smallest signed distance (m) over all pairs at a model's configuration; inf without pairs."""
        if not self._any:
            return np.inf
        nearest = pin.computeDistances(self._model, self._data, self._geometry, self._bodies, q)
        return float(self._bodies.distanceResults[nearest].min_distance)
