"""Certificates: the verdict over a whole curve with its evidence and assumptions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pinproof.collision.certificates.identity import body_digest, curve_hash
from pinproof.collision.certificates.path_constraints import (
    ConstraintProof,
    ConstraintViolation,
    PathConstraint,
    UndecidedConstraint,
    exact_text,
)
from pinproof.collision.checking.pairs import ExcludedPair
from pinproof.collision.checking.spec import CheckerSpec
from pinproof.collision.geometry.shapes import Obstacle
from pinproof.collision.scenes.scene import Scene
from pinproof.common.results import Shown, View
from pinproof.errors import InputError, NotProvenFree
from pinproof.model import JointGroup
from pinproof.motion import Curve, LimitCheck, LimitViolation, MotionRecord
from pinproof.spatial import Array

if TYPE_CHECKING:
    from pinproof.collision.certificates.proof_file import ProvenMotion
    from pinproof.collision.checking.checker import CollisionChecker
    from pinproof.collision.checking.movers import Mover


EVIDENCE_PAIR, EVIDENCE_DISTANCE = 2, 3
"""Columns of :attr:`Certificate.evidence`."""


class CertificateStatus(Enum):
    """The verdict over a whole curve: FREE, COLLIDING, VIOLATED (a joint limit or a constraint) or UNDECIDED."""

    FREE = "free"
    COLLIDING = "colliding"
    VIOLATED = "violated"
    UNDECIDED = "undecided"


@dataclass(frozen=True, eq=False)
class FirstContact:
    """The first contact on a curve; everything before ``proven_free_until`` is proven collision-free.

    Parameters
    ----------
    time
        The curve's parameter: seconds on a trajectory, waypoint index on a path.
    q
        (n,) the configuration there.
    bodies
        Names of the links, attached objects or obstacles in contact.
    distance
        Signed distance (m) there, at most the margin.
    points
        (2, 3) the nearest points in the robot's root frame.
    penetrating
        True if the bodies overlap, False if their distance is only below the margin.
    proven_free_until
        The parameter up to which the curve is proven collision-free.
    """

    time: float
    q: Array
    bodies: tuple[str, str]
    distance: float
    points: Array
    penetrating: bool
    proven_free_until: float


@dataclass(frozen=True, eq=False)
class UndecidedSpan:
    """A span [start, end] of the parameter in which a pair is neither proven apart nor in contact; distance (m)."""

    start: float
    end: float
    bodies: tuple[str, str]
    distance: float


class ProofLimits(NamedTuple):
    """The settings of a certification, as :func:`certify` documents them."""

    tolerances: tuple[float, ...]
    """Metres: the resolutions that are tried in this order while the verdict is UNDECIDED."""
    max_intervals: int
    joints: Array
    """(n,) rad or m: the tolerance of each joint."""
    obstacles: float
    """The tolerance (m) of obstacles."""
    record: bool

    @property
    def tolerance(self) -> float:
        """The first of the resolutions (m)."""
        return self.tolerances[0]


@dataclass(frozen=True, eq=False)
class MotionTube:
    """Deviations of the joints and the obstacles that a certificate covers.

    Parameters
    ----------
    joints
        (n,) rad or m. The verdict holds for every configuration that differs from one on the curve by no more than this
        in each joint, so for every motion within the tube, with any timing.
    obstacles
        Metres. It holds for displaced, rotated or enlarged obstacles if no point of a surface moves farther than this.
    largest_joints
        rad or m: by how much more all joints could deviate at the same time with the proof still valid (obstacles
        within ``obstacles``). A proven lower bound; close to bodies it is at most 0.05. NaN unless FREE.
    largest_obstacles
        Metres: by how much more all obstacles could be displaced (joints within ``joints``). NaN unless FREE.
    """

    joints: Array
    obstacles: float
    largest_joints: float
    largest_obstacles: float


@dataclass(frozen=True, eq=False)
class Parting:
    """Two bodies that may touch at the start and are proven to separate.

    Parameters
    ----------
    bodies
        The moving body (a link or attached object) and the obstacle.
    normal
        (3,) unit vector in the root frame: up to ``end`` no point of the moving body moves against this direction,
        except for rounding.
    gap
        Gap (m) between the two along ``normal`` at the start; a negative value is an overlap, of 1 mm at most.
    until
        The parameter after which their distance is larger than their margin, until the end of the curve.
    end
        The parameter up to which the body is proven not to approach; after it the ordinary proof applies.
    """

    bodies: tuple[str, str]
    normal: Array
    gap: float
    until: float
    end: float

    def __str__(self) -> str:
        one, other = self.bodies
        along = ", ".join(f"{x:.3g}" for x in self.normal + 0.0)
        gap = round(self.gap * 1e3, 2) + 0.0  # -0.0 becomes 0.0
        return (
            f"{one} may touch {other} until {self.until:.4g} (gap {gap:.2f} mm at the start): it is proven "
            f"not to approach along ({along}) until {self.end:.4g}, and to keep its margin afterwards"
        )


@dataclass(frozen=True, eq=False)
class Certificate(Shown):
    """The verdict over a whole curve, valid between samples too.

    Parameters
    ----------
    status
        FREE: at every point of the tube every checked pair is farther apart than its margin; for a pair of
        ``partings``, after it has separated; every constraint is satisfied, and the curve is within ``limits``.
        COLLIDING: a configuration on the curve was found where a pair is not. VIOLATED: no contact was found, but a
        limit or a constraint is exceeded. UNDECIDED: none of these could be shown at the tolerance.
    margin
        The required distance (m) of all pairs without an individual margin.
    clearance
        Proven lower bound (m) of every distance in the tube, for a pair of ``partings`` after its ``end``; NaN unless
        FREE.
    observed
        The smallest distance (m) that was measured on the curve: an upper bound of the true clearance.
    first_contact, undecided
        The evidence for COLLIDING and for UNDECIDED.
    message
        The verdict as a sentence, with a suggestion where it is not FREE.
    pairs, intervals
        Number of checked pairs of bodies, and of intervals.
    excluded
        The pairs that were not checked, with the reasons.
    tolerance
        Metres: an interval in which bodies move less than this is not bisected further.
    notes
        The assumptions of the verdict, in sentences: meshes replaced by hulls, surfaces without an inside, held joints.
    tube
        The deviations that are covered, and the largest ones for which the proof remains valid.
    evidence
        (K, 7) if recorded: rows of start and end of an interval of the parameter, pair, its proven distance (m) there,
        and a unit vector (3) in the root frame along which the supports of the two bodies are apart at the middle of
        the interval (zeros if bounding balls or boxes are).
    partings
        The pairs that were allowed to touch at the start, each with the proof that it separates.
    backwards
        Whether the proof is of the reversed curve: then ``partings`` refer to that curve, and the pairs may touch at
        the end of this one.
    subject
        The curve and checker of a recorded certificate, for :meth:`save`.
    attached, held, obstacles
        The bodies that move with the tcp, the values (rad or m) of the joints outside the arm by name, and the names of
        the obstacles.
    constraints
        The constraints of the tcp that were requested, each with its proven largest error within ``tube.joints``.
        ``tube.largest_joints`` is about collisions only.
    limits
        The comparison of the curve with the joint limits: which quantities, and what exceeds them. None if it was left
        out, which a note states.
    violation
        The violation of a constraint or of a joint limit that comes first on the curve; None unless VIOLATED, or
        COLLIDING and violated.
    undecided_constraint
        The first span in which a constraint is undecided.
    """

    status: CertificateStatus
    margin: float
    clearance: float
    observed: float
    first_contact: FirstContact | None
    undecided: UndecidedSpan | None
    message: str
    pairs: int
    intervals: int
    excluded: tuple[ExcludedPair, ...]
    tolerance: float
    curve: str
    setup: str
    notes: tuple[str, ...] = ()
    tube: MotionTube | None = None
    evidence: Array | None = None
    partings: tuple[Parting, ...] = ()
    backwards: bool = False
    subject: tuple[Curve, CollisionChecker] | None = field(default=None, repr=False)
    attached: tuple[Obstacle, ...] = ()
    held: Mapping[str, float] = field(default_factory=dict)
    obstacles: tuple[str, ...] = ()
    constraints: tuple[ConstraintProof, ...] = ()
    limits: LimitCheck | None = None
    violation: ConstraintViolation | LimitViolation | None = None
    undecided_constraint: UndecidedConstraint | None = None

    @property
    def free(self) -> bool:
        """Whether the status is FREE."""
        return self.status is CertificateStatus.FREE

    def matches(
        self,
        curve: Curve,
        arm: JointGroup,
        scene: Scene,
        attached: Sequence[Obstacle] = (),
        constraints: Sequence[PathConstraint] = (),
        movers: Sequence[Mover] = (),
    ) -> bool:
        """Whether this certificate was made for exactly this curve, arm, scene, attached objects and movers.

        Each of ``constraints`` must be one of its constraints; it may have more, because it then proves more.
        """
        own = {exact_text(proof.constraint) for proof in self.constraints}
        if not own.issuperset(map(exact_text, constraints)):
            return False
        setup = CheckerSpec(arm, scene, attached=tuple(attached)).setup_hash(movers)
        return self.curve == curve_hash(curve) and self.setup == setup

    def to_dict(self) -> dict[str, Any]:
        """The verdict with its figures, the first contact and what is excluded as plain values for JSON."""

        def parts(found: Any, *names: str) -> dict[str, Any] | None:
            return None if found is None else {name: getattr(found, name) for name in names}

        violation = parts(self.violation, "time", "q")
        if isinstance(self.violation, ConstraintViolation):
            more = parts(self.violation, "error", "satisfied_until") or {}
            violation = {"constraint": str(self.violation.constraint), **(violation or {}), **more}
        elif self.violation is not None:
            limit = parts(self.violation, "joint", "quantity", "value", "limit") or {}
            violation = {**limit, **(violation or {})}
        return {
            "status": self.status.name,
            "message": self.message,
            "margin": self.margin,
            "clearance_proven": self.clearance if self.free else None,
            "clearance_observed": self.observed,
            "first_contact": parts(
                self.first_contact, "time", "q", "bodies", "distance", "points", "proven_free_until"
            ),
            "constraints": [
                {
                    "constraint": str(proof.constraint),
                    "tolerance": proof.constraint.tolerance,
                    "largest_proven": proof.largest if self.free else None,
                    "largest_observed": proof.observed,
                }
                for proof in self.constraints
            ],
            "violation": violation,
            "limits_compared": [] if self.limits is None else list(self.limits.checked),
            "excluded": [[*pair.owners, pair.reason] for pair in self.excluded],
            "notes": list(self.notes),
        }

    def motion_record(self, name: str = "motion", start: float = 0.0, end: float = 0.0) -> MotionRecord:
        """Return the record of this certificate for the file of its motion, from time ``start`` to ``end`` (s)."""
        return MotionRecord(
            name,
            start,
            end,
            self.status.name,
            self.clearance if math.isfinite(self.clearance) else None,
            self.margin,
            self.pairs,
            self.curve,
            self.setup,
            {body.name: body_digest(body) for body in self.attached},
            self.held,
            self.obstacles,
            tuple(exact_text(proof.constraint) for proof in self.constraints),
        )

    def save(self, path: str | Path) -> None:
        """Write the proof to a ``.json`` or ``.json.gz`` file, for ``pinproof.verifier`` to re-check anywhere.

        The format is described in docs/formats/proof.md. The verifier has accepted every file that is written; where
        its bounds are less tight than those of :func:`certify`, intervals are bisected further. The file is written
        atomically.

        Raises
        ------
        InputError
            If nothing was recorded, the verdict is not FREE, the file name has another suffix, or a checked body is not
            convex, so that no separating direction exists.
        NotProvenFree
            If the verifier cannot confirm the proof.
        FileError
            If the file cannot be written.
        """
        from pinproof.collision.certificates.proof_file import write_proof

        if not self.free:
            raise InputError(f"only a FREE certificate is a proof to save; this one is {self.status.name}")
        if self.evidence is None or self.subject is None:
            raise InputError("this certificate has no evidence; create it with certify(..., record=True) to save it")
        try:
            write_proof(proven_motion(self, *self.subject), path)
        except NotProvenFree as error:
            raise NotProvenFree(str(error), self) from error

    def or_raise(self) -> Certificate:
        """Return the certificate if it is FREE.

        Raises
        ------
        NotProvenFree
            With the message of the certificate otherwise.
        """
        if not self.free:
            raise NotProvenFree(self.message, self)
        return self

    def _view(self) -> View:
        excluded = (f"not checked: {' and '.join(pair.owners)} ({pair.reason})" for pair in self.excluded)
        return View(f"{self.status.name}: {self.message}", [[*self.notes, *excluded]], self.notes)

    def __str__(self) -> str:
        return "\n".join((f"{self.status.name}: {self.message}", *(f"note: {note}" for note in self.notes)))


def proven_motion(certificate: Certificate, curve: Curve, checker: CollisionChecker) -> ProvenMotion:
    """Return the parts of a FREE certificate with evidence that a proof file needs."""
    from pinproof.collision.certificates.proof_file import ProvenMotion

    tube, evidence = certificate.tube, certificate.evidence
    return ProvenMotion(
        curve=curve,
        checker=checker,
        evidence=np.empty((0, 7)) if evidence is None else final_evidence(evidence),
        clearance=certificate.clearance,
        joint_tolerance=[] if tube is None else tube.joints.tolist(),
        obstacle_tolerance=0.0 if tube is None else tube.obstacles,
        curve_hash=certificate.curve,
        setup_hash=certificate.setup,
        notes=certificate.notes,
        constraints=certificate.constraints,
        limits=certificate.limits,
    )


def free_sentence(proven: float, pairs: int, excluded: int) -> str:
    """Return the message of a FREE certificate: proven clearance (m), number of checked and of excluded pairs."""
    if not pairs:
        return "collision-free: there is no pair to check" + (f"; {_excluded(excluded)}" if excluded else "")
    between = "the only checked pair" if pairs == 1 else f"all {pairs} checked pairs"
    sentence = f"collision-free: at least {proven_millimetres(proven)} between {between}"
    return f"{sentence}; {_excluded(excluded)}" if excluded else sentence


def _excluded(count: int) -> str:
    return "1 pair is excluded" if count == 1 else f"{count} pairs are excluded"


def final_evidence(evidence: Array) -> Array:
    """Return evidence (K, 7) sorted by pairs and time, without the intervals that were bisected for their pair."""
    rows = evidence[np.lexsort([-evidence[:, 1], evidence[:, 0], evidence[:, EVIDENCE_PAIR]])]
    same_pair = rows[:-1, EVIDENCE_PAIR] == rows[1:, EVIDENCE_PAIR]
    bisected = np.zeros(len(rows), dtype=bool)
    bisected[:-1] = same_pair & (rows[1:, 1] <= rows[:-1, 1])
    return np.asarray(rows[~bisected])


def proven_millimetres(clearance: float) -> str:
    """Return a lower bound as text in mm, rounded down."""
    if clearance == math.inf:
        return "unbounded (no pair is checked)"
    return f"{math.floor(clearance * 1e4) / 10:.1f} mm"
