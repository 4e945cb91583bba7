"""Collision checks by Pinocchio and coal alone, to compare with."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinproof.collision import CollisionChecker
from pinproof.spatial import Array


class PlainCoal:
    """Checks by Pinocchio and coal alone, with the margins of the checker.

    ``broadphase`` uses the dynamic bounding-box tree of coal, instead of checking each pair.
    """

    def __init__(self, checker: CollisionChecker, *, broadphase: bool = False) -> None:
        self._model, self._geometry = checker.group.model, checker.geometry_model
        self._data, self._bodies = self._model.createData(), self._geometry.createData()
        for k, margin in enumerate(checker.margins.tolist()):
            request = self._bodies.collisionRequests[k]
            request.security_margin = margin
            self._bodies.collisionRequests[k] = request
        self._configuration, self._any = checker.group.model_configuration, bool(checker.pairs)
        self._tree = None
        if broadphase:
            self._tree = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(
                self._model, self._geometry, self._bodies
            )

    def configurations(self, many: Array) -> list[Array]:
        """Return configurations (N, n) of the arm in the form of the model, so that timings contain the check only."""
        return [self._configuration(q) for q in many]

    def is_free(self, q: Array) -> bool:
        """Whether no pair is within its margin at a configuration of the model."""
        if self._tree is not None:
            return not pin.computeCollisions(self._model, self._data, self._tree, q, True)
        return not pin.computeCollisions(self._model, self._data, self._geometry, self._bodies, q, True)

    def clearance(self, q: Array) -> float:
        """Return the smallest signed distance (m) over all pairs at a configuration of the model; inf without pairs."""
        if not self._any:
            return np.inf
        nearest = pin.computeDistances(self._model, self._data, self._geometry, self._bodies, q)
        return float(self._bodies.distanceResults[nearest].min_distance)
