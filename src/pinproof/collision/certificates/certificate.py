"""Certificates: the verdict over a whole curve with its evidence and assumptions.

A certificate is for a curve and a setup: the arm, its attached objects, the scene and the movers, see
:class:`pinproof.collision.CheckerSpec`. It states their hashes, notes about the setup, and changes since a motion file.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from pinproof.collision.certificates.path_constraints import (
    ConstraintProof,
    ConstraintViolation,
    PathConstraint,
    UndecidedConstraint,
    exact_text,
)
from pinproof.collision.checking.pairs import ExcludedPair
from pinproof.collision.checking.spec import EXAMINED, CheckerSpec, present_stamp
from pinproof.collision.geometry.bodies import BoxBody, FileStamp
from pinproof.collision.geometry.occupancy import OccupancyGrid
from pinproof.collision.geometry.shapes import Box, Mesh, Obstacle
from pinproof.collision.scene import Scene
from pinproof.common.files import os_errors
from pinproof.common.results import Answer, View
from pinproof.common.structs import described, key
from pinproof.description import GENERATED_BODIES, Calibration
from pinproof.errors import InputError, NotProvenFree
from pinproof.model import JointGroup
from pinproof.motion import Curve, LimitCheck, LimitViolation, MotionRecord
from pinproof.spatial import Array, matrix
from pinproof.verifier import curve_digest

if TYPE_CHECKING:
    from pinproof.collision.checking.checker import CollisionChecker
    from pinproof.collision.checking.movers import Mover

DIGITS = 9
"""Decimals of a pose (metres for positions) that a digest distinguishes: files round rotations."""

HELD_TOLERANCE = 1e-9
"""rad or m: two values of a held joint that differ by less are the same."""

NAMED = 6
"""Number of names that a note lists; more are counted."""


def curve_hash(curve: Curve) -> str:
    """Return a hash of the joints, knots and polynomial pieces of a curve, exact to the last bit."""
    return curve_digest(tuple(curve.joint_names), *curve.bezier())


class Setup(NamedTuple):
    """What a certificate states about the setup of its checker."""

    hash: str
    """The hash of the setup; if a mesh file was changed after the checker read it, it matches no setup."""
    notes: tuple[str, ...]
    """The assumptions of the verdicts, in sentences: replaced meshes, held joints, links that are not checked."""


@dataclass
class _KnownSetup:
    """What is known of the setup of a checker while its mesh files are unchanged: one motion may need many proofs."""

    paths: list[str | None]  # the mesh files of robot, attached objects and obstacles; None for a mesh without a file
    read: list[FileStamp]  # the files when the checker read them
    notes: list[str]
    held: list[str]  # the note on held joints, which is the last one
    files: frozenset[str]  # all of these
    stamps: tuple[FileStamp | None, ...] | None = None  # the present files for which the hash holds
    hash: str = ""


_known: WeakKeyDictionary[CollisionChecker, _KnownSetup] = WeakKeyDictionary()


def setup_of(checker: CollisionChecker) -> Setup:
    """Return the hash of the setup of a checker with its present mesh files, each examined once, and the notes on it.

    Excluded pairs are listed in the attribute ``excluded`` of the checker, each with its reason.
    """
    examined = EXAMINED.get()
    if examined is not None and checker in examined.setups:
        return Setup(*examined.setups[checker])
    known = _known.get(checker)
    if known is None:
        known = _known[checker] = _known_setup(checker)
    now = {path: present_stamp(path) for path in known.files}
    stamps = tuple(None if path is None else now[path] for path in known.paths)
    changed = tuple(file for file in known.read if now[file.path] != file)
    if known.stamps != stamps:
        known.stamps, known.hash = stamps, checker.spec.setup_hash()
    digest = hashlib.sha256(repr((known.hash, changed)).encode()).hexdigest() if changed else known.hash
    files = [Path(file.path).name for file in changed]
    about_files = [f"{_some(files)}: changed after the checker read it; create a new checker"] if files else []
    setup = Setup(digest, tuple(dict.fromkeys((*known.notes, *about_files, *known.held))))
    if examined is not None:
        examined.setups[checker] = setup
    return setup


def _known_setup(checker: CollisionChecker) -> _KnownSetup:
    """Return the mesh files of a checker and the notes on it."""
    arm, notes = checker.group, list(checker.scene.notes)
    # Of boxes, nothing is to be noted.
    bodies = [body for body in checker.bodies if type(body) is not BoxBody]
    objects = [thing for thing in (*checker.attached, *checker.scene.obstacles) if type(thing.shape) is not Box]
    # Bodies and pairs with one remark are listed together.
    by_remark: dict[str, dict[str, None]] = {}
    for body in bodies:
        if body.remark:
            by_remark.setdefault(body.remark, {})[body.owner] = None
    for thing in objects:  # a grid without an occupied cell has no body
        if isinstance(thing.shape, OccupancyGrid):
            by_remark.setdefault(thing.shape.remark, {})[thing.name] = None
    notes += [f"{_some(tuple(owners))}: {remark}" for remark, owners in by_remark.items()]
    how: dict[str, list[str]] = {}
    for pair in checker.finer:
        how.setdefault(f"checked with {pair.by}, because {pair.reason}", []).append(" and ".join(pair.owners))
    notes += [f"{_some(pairs)}: {judged}" for judged, pairs in how.items()]
    # A link that is drawn, but has no collision geometry, is not checked.
    solid = {body.link for body in bodies if body.owner == body.link}
    if not solid:
        notes.append("the robot has no collision geometry, so its links are not checked")
    elif arm.robot.has_generated_bodies:
        notes.append(GENERATED_BODIES)
    elif drawn := [link for link in dict.fromkeys(g.link for g in arm.robot.urdf.visuals) if link not in solid]:
        notes.append(f"{_some(drawn)}: visible, but without collision geometry, so not checked")
    held = [f"{name} = {value:g}" for name, value in arm.held.items()]
    paths: list[str | Path | None] = [each.mesh.path for each in arm.robot.urdf.collisions if each.mesh is not None]
    paths += [each.shape.path for each in objects if isinstance(each.shape, Mesh)]
    named = [None if path is None else os.fspath(path) for path in paths]
    read = list(dict.fromkeys(body.file for body in bodies if body.file is not None))
    files = frozenset(path for path in (*named, *(file.path for file in read)) if path is not None)
    return _KnownSetup(
        named, read, notes, [f"joints outside the arm are held fixed: {_some(held)}"] if held else [], files
    )


def _some(names: Sequence[str]) -> str:
    more = f", ... ({len(names)} in all)" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more


def body_digest(body: Obstacle) -> str:
    """Return a hash of name, shape (a mesh by content) and pose of an attached body; FileError without its file."""
    shape, digest = body.shape, hashlib.sha256()
    if isinstance(shape, Mesh) and shape.path is not None:
        with os_errors(shape.path):
            digest.update(hashlib.sha256(Path(shape.path).read_bytes()).digest())
        digest.update(repr((shape.scale, shape.hull, shape.hollow)).encode())
    else:
        digest.update(repr(shape).encode())
    digest.update(repr(body.name).encode() + (np.round(matrix(body.pose), DIGITS) + 0.0).tobytes())
    return digest.hexdigest()


def missing_since(records: tuple[MotionRecord, ...], checker: CollisionChecker) -> tuple[str, ...]:
    """List, in sentences, which parts of the setup of a certified motion the checker does not have.

    Compared are attached bodies, positions of held joints, calibrations, and the obstacles if the checker has none.
    """
    if not records:
        return ()
    # A motion of several parts has a record of each; they are compared as one if their setups are the same.
    first = records[0]
    if not all(first.same_setup(other) for other in records):
        names = ", ".join(record.name for record in records)
        return (f"its parts ({names}) were certified with different attached bodies, held joints or scenes",)
    found = []
    # Attached bodies are compared by name, and by shape and pose.
    now = {body.name: body for body in checker.attached}
    if absent := [name for name in first.attached if name not in now]:
        found.append(f"it was certified with {_listed(absent)} attached, which is missing now")
    if other := [name for name, known in first.attached.items() if name in now and body_digest(now[name]) != known]:
        found.append(f"{_listed(other)} had another shape or pose on the tcp when it was certified")
    held = checker.group.held
    for name, value in first.held.items():
        if name in held and abs(held[name] - value) > HELD_TOLERANCE:
            found.append(f"it was certified with {name} held at {value:.9g}, now at {held[name]:.9g}")
    own = checker.group.robot.calibrations
    for name, known in first.calibrations.items():
        if known != own.get(name):
            is_now = f"calibrated by {own[name].path}" if name in own else "the nominal one"
            found.append(f"it was certified for the {name} that {known.path} calibrates, but the arm now is {is_now}")
    if first.obstacles and not checker.scene:
        found.append(
            f"it was certified among the obstacles {_listed(first.obstacles)}, but the scene has no obstacles now"
        )
    return tuple(found)


def changes_since(
    records: tuple[MotionRecord, ...],
    checker: CollisionChecker,
    curve: str,
    setup: str,
    constraints: Sequence[PathConstraint] = (),
) -> list[str]:
    """List, in sentences, all differences between the certification recorded with a motion and the present one."""
    found = list(missing_since(records, checker))
    required = set(map(exact_text, constraints))
    lost = dict.fromkeys(text for record in records for text in record.constraints if text not in required)
    found += [f"it was certified with the constraint {text}, which is not required now" for text in lost]
    # Only a motion of one part has one curve, one margin and one setup to compare.
    if len(records) != 1:
        return found
    record = records[0]
    if record.curve != curve:
        found.append("it was changed after it was certified")
    if record.margin > checker.margin:
        found.append(f"it was certified with a margin of {record.margin * 1e3:.9g} mm")
    if not found and record.setup != setup:
        found.append("it was certified with another robot, another scene or more bodies, or their files were moved")
    return found


def _listed(names: tuple[str, ...] | list[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


class CertificateStatus(Enum):
    """The verdict over a whole curve: FREE, COLLIDING, VIOLATED (a joint limit or a constraint) or UNDECIDED."""

    FREE = "free"
    COLLIDING = "colliding"
    VIOLATED = "violated"
    UNDECIDED = "undecided"


@described(eq=False)
class FirstContact:
    """The first contact on a curve; everything before ``proven_free_until`` is proven collision-free."""

    time: float = key("the curve's parameter: seconds on a trajectory, waypoint index on a path")
    q: Array = key("(n,) the configuration there")
    bodies: tuple[str, str] = key("names of the links, attached objects or obstacles in contact")
    distance: float = key("signed distance (m) there, at most the margin")
    points: Array = key("(2, 3) the nearest points in the robot's root frame")
    penetrating: bool = key("True if the bodies overlap, False if their distance is only below the margin")
    proven_free_until: float = key("the parameter up to which the curve is proven collision-free")


@dataclass(frozen=True, eq=False)
class UndecidedSpan:
    """A span [start, end] of the parameter in which a pair is neither proven apart nor in contact; distance (m)."""

    start: float
    end: float
    bodies: tuple[str, str]
    distance: float


class ProofLimits(NamedTuple):
    """The settings of a certification, as :func:`certify` documents them."""

    tolerances: tuple[float, ...]  # metres: the resolutions that are tried while the verdict is UNDECIDED
    max_intervals: int
    joints: Array  # (n,) rad or m: the tolerance of each joint
    obstacles: float  # the tolerance (m) of obstacles
    record: bool

    @property
    def tolerance(self) -> float:
        """The first of the resolutions (m)."""
        return self.tolerances[0]


@described(eq=False)
class MotionTube:
    """Deviations of the joints and the obstacles that a certificate covers."""

    joints: Array = key(
        "(n,) rad or m. The verdict holds for every configuration that differs from one on the curve by no more "
        "than this in each joint, so for every motion within the tube, with any timing"
    )
    obstacles: float = key(
        "it holds for displaced, rotated or enlarged obstacles if no point of a surface moves farther than this", "m"
    )
    largest_joints: float = key(
        "by how much more all joints could deviate at the same time with the proof still valid (obstacles within "
        "``obstacles``). A proven lower bound; close to bodies it is at most 0.05. NaN unless FREE",
        "rad or m",
    )
    largest_obstacles: float = key(
        "by how much more all obstacles could be displaced (joints within ``joints``). NaN unless FREE", "m"
    )


@described(eq=False)
class Parting:
    """Two bodies that may touch at the start and are proven to separate."""

    bodies: tuple[str, str] = key("the moving body (a link or attached object) and the obstacle")
    normal: Array = key(
        "(3,) unit vector in the root frame: up to ``end`` no point of the moving body moves against this "
        "direction, except for rounding"
    )
    gap: float = key("between the two along ``normal`` at the start; negative for an overlap, of 1 mm at most", "m")
    until: float = key("the parameter after which their distance is larger than their margin, to the end of the curve")
    end: float = key(
        "the parameter up to which the body is proven not to approach; after it the ordinary proof applies"
    )
    length: float | None = key(
        "the largest parameter of a path, whose parameters are reported as shares of it; None for seconds", default=None
    )

    def __str__(self) -> str:
        one, other = self.bodies
        until, end = (
            f"t = {at:.4g} s" if self.length is None else f"{100.0 * at / self.length:.3g} % of the path"
            for at in (self.until, self.end)
        )
        along = ", ".join(f"{x:.3g}" for x in self.normal + 0.0)
        gap = round(self.gap * 1e3, 2) + 0.0  # -0.0 becomes 0.0
        return (
            f"{one} may touch {other} until {until} (gap {gap:.2f} mm at the start): it is proven "
            f"not to approach along ({along}) until {end}, and to keep its margin afterwards"
        )


@described(eq=False)
class Certificate(Answer):
    """The verdict over a whole curve, valid between samples too."""

    failure = NotProvenFree

    status: CertificateStatus = key(
        "FREE: at every point of the tube every checked pair is farther apart than its margin; for a pair of "
        "``partings``, after it has separated; every constraint is satisfied, and the curve is within ``limits``. "
        "COLLIDING: a configuration on the curve was found where a pair is not. VIOLATED: no contact was found, but "
        "a limit or a constraint is exceeded. UNDECIDED: none of these could be shown at the tolerance"
    )
    margin: float = key("the required distance of all pairs without an individual margin", "m")
    clearance: float = key(
        "proven lower bound (m) of every distance in the tube, for a pair of ``partings`` after its ``end``; NaN "
        "unless FREE"
    )
    observed: float = key("the smallest distance measured on the curve: an upper bound of the true clearance", "m")
    first_contact: FirstContact | None = key("the evidence for COLLIDING")
    undecided: UndecidedSpan | None = key("the evidence for UNDECIDED")
    message: str = key("the verdict as a sentence, with a suggestion where it is not FREE")
    pairs: int = key("number of checked pairs of bodies")
    intervals: int = key("number of checked intervals")
    excluded: tuple[ExcludedPair, ...] = key("the pairs that were not checked, with the reasons")
    tolerance: float = key("an interval in which bodies move less than this is not bisected further", "m")
    curve: str = key("hash of the curve")
    setup: str = key("hash of the arm, the scene and the attached bodies")
    notes: tuple[str, ...] = key(
        "the assumptions of the verdict, in sentences: meshes replaced by hulls, surfaces without an inside, held "
        "joints",
        default=(),
    )
    tube: MotionTube | None = key(
        "the deviations that are covered, and the largest ones for which the proof remains valid", default=None
    )
    evidence: Array | None = key(
        "(K, 7) if recorded: rows of start and end of an interval of the parameter, pair, its proven distance (m) "
        "there, and a unit vector (3) in the root frame along which the supports of the two bodies are apart at the "
        "middle of the interval (zeros if bounding balls or boxes are)",
        default=None,
    )
    partings: tuple[Parting, ...] = key(
        "the pairs that were allowed to touch at the start, each with the proof that it separates", default=()
    )
    backwards: bool = key(
        "whether the proof is of the reversed curve: then ``partings`` refer to that curve, and the pairs may touch "
        "at the end of this one",
        default=False,
    )
    subject: tuple[Curve, CollisionChecker | str] | None = key(
        "the curve and checker of a recorded certificate, for :meth:`save`. A pickle has the fingerprint of the "
        "checker in its place",
        default=None,
        compare=False,
    )
    attached: tuple[Obstacle, ...] = key("the bodies that move with the tcp", default=())
    held: Mapping[str, float] = key("values of the joints outside the arm", "rad or m", default_factory=dict)
    obstacles: tuple[str, ...] = key("names of the obstacles", default=())
    calibrations: Mapping[str, Calibration] = key(
        "the calibration of each calibrated arm, by the name of its robot", default_factory=dict
    )
    constraints: tuple[ConstraintProof, ...] = key(
        "the constraints of the tcp that were requested, each with its proven largest error within ``tube.joints``. "
        "``tube.largest_joints`` is about collisions only",
        default=(),
    )
    limits: LimitCheck | None = key(
        "the comparison of the curve with the joint limits: which quantities, and what exceeds them. None if it was "
        "left out, which a note states",
        default=None,
    )
    violation: ConstraintViolation | LimitViolation | None = key(
        "the violation of a constraint or of a joint limit that comes first on the curve; None unless VIOLATED, or "
        "COLLIDING and violated",
        default=None,
    )
    undecided_constraint: UndecidedConstraint | None = key(
        "the first span in which a constraint is undecided", default=None
    )

    def __getstate__(self) -> dict[str, Any]:
        if self.subject is None:
            return self.__dict__
        curve, checker = self.subject
        return {**self.__dict__, "subject": (curve, checker if isinstance(checker, str) else checker.fingerprint())}

    def with_checker(self, checker: CollisionChecker) -> Certificate:
        """Return a recorded certificate with its checker, which a pickle leaves out, to save or reuse the proof.

        Raises
        ------
        InputError
            If the certificate is not for the setup, the pairs and the margins of the checker.
        """
        if setup_of(checker).hash != self.setup:
            raise InputError("the certificate is not for the arm, the scene and the attached objects of this checker")
        if self.subject is None:
            return self
        curve, known = self.subject
        if (known if isinstance(known, str) else known.fingerprint()) != checker.fingerprint():
            raise InputError("the certificate is not for the bodies, the pairs and the margins of this checker")
        return replace(self, subject=(curve, checker))

    def recorded(self, purpose: str) -> tuple[Array, Curve, CollisionChecker]:
        """Return the evidence, the curve and the checker; InputError with the ``purpose`` if one is missing."""
        if self.evidence is None or self.subject is None:
            what = f"this certificate has no evidence; create it with certify(..., record=True) to {purpose} it"
            raise InputError(what)
        curve, checker = self.subject
        if isinstance(checker, str):
            what = "a pickle of a certificate leaves out its checker; certificate.with_checker(checker) adds it"
            raise InputError(f"{what}, to {purpose} it")
        return self.evidence, curve, checker

    @property
    def free(self) -> bool:
        """Whether the status is FREE."""
        return self.status is CertificateStatus.FREE

    @property
    def ok(self) -> bool:
        """Whether the status is FREE."""
        return self.free

    @property
    def fails_at(self) -> float:
        """The parameter of the first contact or violation, or where what is undecided begins.

        NaN if FREE, or if only the limits between samples of a function are undecided.
        """
        for event in (self.first_contact, self.violation):
            if event is not None:
                return event.time
        spans = (self.undecided_constraint, self.undecided)
        return next((span.start for span in spans if span is not None), math.nan)

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
            self.calibrations,
        )

    def save(self, path: str | Path) -> None:
        """Write the proof to a ``.json`` or ``.json.gz`` file, for ``pinproof.verifier`` to re-check anywhere.

        The format is described in docs/formats/proof.md. The verifier has accepted every file that is written; where
        its bounds are less tight than those of :func:`certify`, intervals are bisected further. The file is written
        atomically.

        Raises
        ------
        InputError
            If nothing was recorded, the verdict is not FREE, or the file name has another suffix.
        NotProvenFree
            If the verifier cannot confirm the proof.
        FileError
            If the file cannot be written.
        """
        from pinproof.collision.certificates.proof_file import write_proof

        write_proof(self.proof_text, path)

    def proof_text(self) -> str:
        """Return the text of the file that :meth:`save` writes, which raises the same exceptions."""
        from pinproof.collision.certificates.proof_file import proof_text

        if not self.free:
            raise InputError(f"only a FREE certificate is a proof to save; this one is {self.status.name}")
        _, curve, checker = self.recorded("save")
        try:
            return proof_text(self, curve, checker)
        except NotProvenFree as error:
            raise NotProvenFree(str(error), self) from error

    def _view(self) -> View:
        excluded = (f"not checked: {' and '.join(pair.owners)} ({pair.reason})" for pair in self.excluded)
        return View(f"{self.status.name}: {self.message}", [[*self.notes, *excluded]], self.notes)

    def __str__(self) -> str:
        return "\n".join((f"{self.status.name}: {self.message}", *(f"note: {note}" for note in self.notes)))


def free_sentence(proven: float, pairs: int, excluded: int) -> str:
    """Return the message of a FREE certificate: proven clearance (m), number of checked and of excluded pairs."""
    between = "the only checked pair" if pairs == 1 else f"all {pairs} checked pairs"
    sentence = f"at least {proven_millimetres(proven)} between {between}" if pairs else "there is no pair to check"
    more = f"; {excluded} {'pair is' if excluded == 1 else 'pairs are'} excluded" if excluded else ""
    return f"collision-free: {sentence}{more}"


def proven_millimetres(clearance: float) -> str:
    """Return a lower bound as text in mm, rounded down."""
    if clearance == math.inf:
        return "unbounded (no pair is checked)"
    return f"{math.floor(clearance * 1e4) / 10:.1f} mm"
