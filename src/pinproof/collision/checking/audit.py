"""Audits a motion by means that are independent of the proof: dense samples, exact meshes, coal alone.

An audit proves nothing; its purpose is to detect a wrong proof. It uses the pairs of a checker, with the triangles of
their meshes instead of hulls. Placements and contacts are computed by Pinocchio and coal.
"""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
import pinocchio as pin

from pinproof.collision.checking.checker import CollisionChecker, require_curve
from pinproof.collision.checking.movers import Mover, with_movers
from pinproof.collision.geometry.bodies import one_inside_other
from pinproof.common.results import Shown, View
from pinproof.common.structs import described, key
from pinproof.errors import InputError
from pinproof.motion import Curve, Trajectory

STEP = 0.002
"""Rad or m: no joint moves farther than this between two samples."""

INSIDE_EVERY = 250
"""Number of samples between two tests whether a body is inside another. To get inside, the surfaces must cross, which
the other samples detect, so the test at the first sample is the important one."""

MEASURE_EVERY = 10
"""Number of samples between two distance queries, which take longer than contact queries."""


@described(eq=False)
class AuditResult(Shown):
    """The result of an audit by dense sampling."""

    samples: int = key("number of checked configurations")
    contacts: tuple[tuple[float, tuple[str, str]], ...] = key(
        "for each pair of owners in contact, the parameter of the curve of the first such sample, in that order"
    )
    distance: float = key(
        "the smallest distance (m) at every :data:`MEASURE_EVERY`-th sample; inf if there is no pair, NaN if not "
        "measured"
    )
    geometry: str = key("number of bodies as triangles, as hulls and as simple shapes, and number of pairs")
    message: str = key("the result as a sentence")

    def _view(self) -> View:
        found = (f"{' and '.join(bodies)} from the parameter {at:.6g}" for at, bodies in self.contacts)
        return View(self.message, [(f"{self.samples:,} samples; {self.geometry}", *found)])

    @property
    def clean(self) -> bool:
        """Whether no sample is in contact."""
        return not self.contacts


def audit(
    curve: Curve,
    checker: CollisionChecker,
    *,
    step: float = STEP,
    measure: bool = True,
    movers: Sequence[Mover | Trajectory] = (),
    exact: bool = True,
) -> AuditResult:
    """Search for contacts at samples so dense that no joint moves more than ``step`` between them.

    Parameters
    ----------
    curve
        Any curve of the arm's joints.
    checker
        Defines the pairs and the joints. Its margin is ignored: a contact is a distance of 0.
    step
        Largest motion of a joint (rad or m) between samples.
    measure
        Whether distances are measured, which takes most of the time.
    movers
        As for :func:`pinproof.certify`; no mover moves more than ``step`` between samples either.
    exact
        Whether meshes are their triangles, see :meth:`pinproof.CollisionChecker.exact`; otherwise the bodies are those
        of the checker.

    Raises
    ------
    InputError
        If the curve's joints are not the arm's, or the step is not positive.
    """
    require_curve(curve, checker)
    if not step > 0:
        raise InputError(f"step = {step}; it must be positive (rad or m)")
    if movers:
        curve, checker, _ = with_movers(curve, checker, movers)
    checker = checker.exact() if exact else checker
    arm, model, geometry = checker.group, checker.group.model, checker._coal_geometry()
    data, bodies = model.createData(), geometry.createData()
    # Pinocchio's broad phase is five times as fast, but does not report which pairs touch. It is not used with a
    # half-space, whose box is infinite.
    bounded = all(np.isfinite(body.box).all() for body in checker.bodies)
    far_apart = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(model, geometry, bodies) if bounded else None
    request = coal.CollisionRequest()
    for k in range(len(checker.pairs)):
        bodies.collisionRequests[k] = request
    found: dict[tuple[str, str], float] = {}
    # Parameters between which no joint moves more than the step: the derivative of a piece is bounded by its degree
    # times the largest step between its control points.
    knots, control = curve.bezier()
    parts = []
    for start, end, points in zip(knots[:-1], knots[1:], control, strict=True):
        fastest = (len(points) - 1) * float(np.abs(np.diff(points, axis=0)).max(initial=0.0))
        parts.append(np.linspace(start, end, max(2, int(np.ceil(fastest / step)) + 1)))
    times, distance = np.unique(np.concatenate(parts)), np.inf if measure else np.nan
    for number, (t, at) in enumerate(zip(times, curve(times), strict=True)):
        q = arm.model_configuration(at)
        look_inside = number % INSIDE_EVERY == 0
        if far_apart is None or look_inside or pin.computeCollisions(model, data, far_apart, q, True):
            pin.computeCollisions(model, data, geometry, bodies, q, False)
            for k, (i, j) in enumerate(checker.pairs):
                one, other, placed = checker.bodies[i], checker.bodies[j], bodies.oMg
                touching = bodies.collisionResults[k].isCollision()
                if touching or (look_inside and one_inside_other(one, placed[i], other, placed[j])):
                    found.setdefault(checker.owners(k), float(t))
        if measure and number % MEASURE_EVERY == 0 and checker.pairs:
            nearest = pin.computeDistances(model, data, geometry, bodies, q)
            distance = min(distance, float(bodies.distanceResults[nearest].min_distance))
    contacts = tuple((t, pair) for pair, t in sorted(found.items(), key=lambda item: item[1]))
    touching = "; ".join(f"{a} touches {b} at {t:.4g}" for t, (a, b) in contacts)
    kinds = {"triangle meshes": coal.BVHModelBase, "hulls": coal.ConvexBase}
    counts = {name: sum(isinstance(b.geometry, kind) for b in checker.bodies) for name, kind in kinds.items()}
    counts["simple shapes"] = len(checker.bodies) - sum(counts.values())
    of_kinds = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
    what = f"{of_kinds or 'no bodies'} ({len(checker.pairs)} pairs)"
    free = f"no contact; the smallest distance is {distance * 1e3:.1f} mm" if measure else "no contact"
    message = f"{len(times)} samples, checked with {what}: {touching or free}"
    return AuditResult(len(times), contacts, distance, what, message)
