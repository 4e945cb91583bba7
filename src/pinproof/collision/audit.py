"""A second look at a motion by other means than the proof: dense samples, exact meshes, coal alone.

It proves nothing; it is there to catch a proof that is wrong. What it uses of a checker is which bodies and pairs there
are. Placements and contacts are Pinocchio's and coal's own.
"""

from __future__ import annotations

from dataclasses import dataclass

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.checker import CollisionChecker
from pinproof.errors import InputError
from pinproof.motion import Curve

__all__ = ["AuditResult", "audit"]

Array = npt.NDArray[np.float64]

STEP = 0.002
"""Rad or m: no joint moves farther than this between two samples."""

INSIDE_EVERY = 250
"""Samples between two looks at whether a body lies wholly inside another: to get there its surface has to cross, which
is seen, so the first look is the one that matters."""

MEASURE_EVERY = 10
"""Samples between two looks at how far apart all bodies are, which takes longer than whether they touch."""


@dataclass(frozen=True, eq=False)
class AuditResult:
    """What dense sampling saw.

    Parameters
    ----------
    samples
        How many configurations were looked at.
    contacts
        For each pair of owners that touched, the parameter of the curve where that was first seen, in that order.
    distance
        The smallest distance (m) seen, at every :data:`MEASURE_EVERY`-th sample; inf if there is no pair, NaN if
        not asked for.
    geometry
        What was sampled: how many bodies as triangles, as hulls, as simple shapes, and how many pairs of them.
    message
        The same in a sentence.
    """

    samples: int
    contacts: tuple[tuple[float, tuple[str, str]], ...]
    distance: float
    geometry: str
    message: str

    @property
    def clean(self) -> bool:
        """Whether no sample touches anything."""
        return not self.contacts


def audit(curve: Curve, checker: CollisionChecker, *, step: float = STEP, measure: bool = True) -> AuditResult:
    """Look for contacts at samples so dense that no joint moves more than ``step`` between them.

    Parameters
    ----------
    curve
        Any curve of the arm's joints.
    checker
        Which bodies and pairs to look at: for a sharper look than the proof's, one with ``link_meshes="mesh"``. Its
        margin is left aside: contact is a distance of 0.
    step
        In rad or m.
    measure
        Whether distances are looked at, too, which takes most of the time.

    Raises
    ------
    InputError
        If the curve's joints are not the arm's, or the step is not above 0.
    """
    if tuple(curve.joint_names) != checker.arm.joint_names:
        raise InputError(f"the curve has the joints {curve.joint_names}, the arm {checker.arm.joint_names}")
    if not step > 0:
        raise InputError(f"step = {step}; it is above 0 (rad or m)")
    arm, model, geometry = checker.arm, checker.arm.model, checker.geometry_model
    data, bodies = model.createData(), geometry.createData()
    # Pinocchio's broadphase leaves far pairs aside, and so is five times as quick; which pairs touch it does not tell.
    # A half-space, whose box is infinite, is kept out of it.
    bounded = all(np.isfinite(body.box).all() for body in checker.bodies)
    far_apart = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(model, geometry, bodies) if bounded else None
    request = coal.CollisionRequest()
    for k in range(len(checker.pairs)):
        bodies.collisionRequests[k] = request
    found: dict[tuple[str, str], float] = {}
    times, distance = _dense(curve, step), np.inf if measure else np.nan
    for number, (t, at) in enumerate(zip(times, curve(times), strict=True)):
        q = arm.model_configuration(at)
        look_inside = number % INSIDE_EVERY == 0
        if far_apart is None or look_inside or pin.computeCollisions(model, data, far_apart, q, True):
            pin.computeCollisions(model, data, geometry, bodies, q, False)
            inside = checker.placed(at) if look_inside else None
            for k, (i, j) in enumerate(checker.pairs):
                touching = bodies.collisionResults[k].isCollision()
                if touching or (inside is not None and inside.one_inside_other(k)):
                    found.setdefault((checker.bodies[i].owner, checker.bodies[j].owner), float(t))
        if measure and number % MEASURE_EVERY == 0 and checker.pairs:
            nearest = pin.computeDistances(model, data, geometry, bodies, q)
            distance = min(distance, float(bodies.distanceResults[nearest].min_distance))
    contacts = tuple((t, pair) for pair, t in sorted(found.items(), key=lambda item: item[1]))
    touching = "; ".join(f"{a} touches {b} at {t:.4g}" for t, (a, b) in contacts)
    what = _geometry(checker)
    free = f"no contact; the smallest distance is {distance * 1e3:.1f} mm" if measure else "no contact"
    message = f"{len(times)} samples, checked with {what}: {touching or free}"
    return AuditResult(len(times), contacts, distance, what, message)


def _geometry(checker: CollisionChecker) -> str:
    kinds = {"triangle meshes": coal.BVHModelBase, "hulls": coal.ConvexBase}
    counts = {name: sum(isinstance(b.geometry, kind) for b in checker.bodies) for name, kind in kinds.items()}
    counts["simple shapes"] = len(checker.bodies) - sum(counts.values())
    told = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
    return f"{told or 'no bodies'} ({len(checker.pairs)} pairs)"


def _dense(curve: Curve, step: float) -> Array:
    """Parameters between which no joint moves more than ``step``: control points bound each piece."""
    knots, control = curve.bezier()
    parts = []
    for start, end, points in zip(knots[:-1], knots[1:], control, strict=True):
        # The derivative of a piece is bounded by degree times the largest step between its control points.
        degree = len(points) - 1
        fastest = degree * float(np.abs(np.diff(points, axis=0)).max(initial=0.0))
        parts.append(np.linspace(start, end, max(2, int(np.ceil(fastest / step)) + 1)))
    return np.unique(np.concatenate(parts))
