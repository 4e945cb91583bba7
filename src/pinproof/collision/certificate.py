"""What a certificate says: FREE, COLLIDING or UNDECIDED, with the evidence."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pinproof.collision.bodies import FileStamp
from pinproof.collision.pairs import ExcludedPair
from pinproof.collision.recorded import body_digest
from pinproof.collision.scene import Obstacle, Scene
from pinproof.collision.shapes import Mesh
from pinproof.errors import InputError, NotProvenFree
from pinproof.model import Arm
from pinproof.motion import Curve, MotionRecord
from pinproof.spatial import matrix
from pinproof.verifier import curve_digest

if TYPE_CHECKING:
    from pinproof.collision.checker import CollisionChecker

__all__ = [
    "Certificate",
    "CertificateStatus",
    "FirstContact",
    "MotionTube",
    "Parting",
    "UndecidedSpan",
    "changed_files",
    "checked_hash",
    "curve_hash",
    "free_sentence",
    "proven_millimetres",
    "setup_hash",
]

Array = npt.NDArray[np.float64]

FILES_KEPT = 1024
"""Mesh files whose hashes are kept, for as long as their time and size stay the same."""

ARMS_KEPT = 8
"""Arms whose hashes are kept: a task has one, or one for each way its fingers stand."""


class CertificateStatus(Enum):
    """The verdict over a whole curve."""

    FREE = "free"
    COLLIDING = "colliding"
    UNDECIDED = "undecided"


@dataclass(frozen=True, eq=False)
class FirstContact:
    """Where a curve first touches; everything before ``proven_free_until`` is proven free.

    Parameters
    ----------
    time
        The curve's parameter: seconds on a trajectory, waypoint index on a path.
    q
        (n,) the configuration there.
    bodies
        Who touches: links, attached objects, obstacles.
    distance
        Signed distance (m) there, at most the margin.
    points
        (2, 3) the nearest points in the robot's root frame.
    penetrating
        True if the bodies overlap, False if they are only nearer than the margin.
    proven_free_until
        The parameter up to which the curve is proven free.
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
    """Where the proof met its tolerance: [start, end] of the parameter, the two bodies, the distance (m) seen."""

    start: float
    end: float
    bodies: tuple[str, str]
    distance: float


@dataclass(frozen=True, eq=False)
class MotionTube:
    """What a curve, and what stands around it, may deviate by.

    Parameters
    ----------
    joints
        (n,) rad or m. The verdict holds for every configuration that differs from one of the curve by no more than this
        in each joint: for whatever motion stays within it, in whatever timing.
    obstacles
        Metres. It holds for obstacles moved, turned or grown, as long as no point of a surface moves farther than this.
    largest_joints
        rad or m: how much more each joint could deviate, all at once, with the proof still true (obstacles within
        ``obstacles``). What is proven, not what is true; close to bodies it is at most 0.05. NaN unless FREE.
    largest_obstacles
        Metres: how much more every obstacle could be moved (joints within ``joints``). NaN unless FREE.
    """

    joints: Array
    obstacles: float
    largest_joints: float
    largest_obstacles: float


@dataclass(frozen=True, eq=False)
class Parting:
    """Two bodies that may touch at the start and were proven to part.

    Parameters
    ----------
    bodies
        What leaves (a link or attached object), and the obstacle it leaves.
    normal
        (3,) the unit vector in the root frame along which it leaves: on the whole span up to ``end`` no point of it
        moves against this direction, by more than rounding in all.
    gap
        Metres between the two along ``normal`` at the start; below 0 they overlap by that much, 1 mm at most.
    until
        The parameter from which on they are farther apart than their margin, to the curve's end.
    end
        The parameter up to which the first is proven not to approach; behind it stands the ordinary proof.
    """

    bodies: tuple[str, str]
    normal: Array
    gap: float
    until: float
    end: float

    def __str__(self) -> str:
        one, other = self.bodies
        along = ", ".join(f"{x:.3g}" for x in self.normal + 0.0)
        return (
            f"{one} may touch {other} until {self.until:.4g} (gap {self.gap * 1e3:+.2f} mm at the start): proven never "
            f"to approach it along ({along}) until {self.end:.4g}, and to keep its margin afterwards"
        )


@dataclass(frozen=True, eq=False)
class Certificate:
    """A verdict over a whole curve, between samples too.

    Parameters
    ----------
    status
        FREE: at every point of the tube every checked pair is farther apart than its margin, a pair of ``partings``
        once it has parted. COLLIDING: a
        configuration on the curve was found where a pair is not. UNDECIDED: neither could be shown at the tolerance.
    margin
        The distance (m) that was asked for, of all pairs without a margin of their own.
    clearance
        Proven lower bound (m) of every distance in the tube, of a pair of ``partings`` behind its ``end``; NaN unless
        FREE.
    observed
        The smallest distance (m) that was measured along the way: an upper bound of the true clearance.
    first_contact, undecided
        The evidence for COLLIDING and UNDECIDED.
    message
        The verdict in a sentence, with what to do.
    pairs, intervals
        How many pairs of bodies were proven, over how many intervals.
    excluded
        The pairs that were not checked, with the reasons.
    tolerance
        Metres: an interval in which bodies move less than this is not cut any further.
    notes
        What the verdict takes for granted, in sentences: what was hulled, what is hollow, what stands still.
    tube
        The deviations that were allowed for, and the largest ones the proof bears.
    evidence
        (K, 7) if it was asked to be recorded, what a proof has to tell: rows of start and end of an interval of the
        parameter, pair, distance (m) proven of it there, a unit vector (3) in the root frame along which the supports
        of the two bodies are apart at the middle (zeros where balls or boxes around them are).
    partings
        The pairs that were allowed to touch at the start, each with the proof that it parts.
    backwards
        Whether it was proven of the same curve run backwards: ``partings`` tell of that, and what may touch does so at
        the curve's end.
    subject
        What it was recorded of, for :meth:`save`.
    attached, held, obstacles
        The bodies that moved with the tcp, the values (rad or m) of the joints outside the arm by name, and the names
        of the obstacles it was made with.
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

    @property
    def free(self) -> bool:
        """Whether the status is FREE."""
        return self.status is CertificateStatus.FREE

    def matches(self, curve: Curve, arm: Arm, scene: Scene, attached: Sequence[Obstacle] = ()) -> bool:
        """Whether this certificate was made for exactly this curve, arm, scene and attached objects."""
        return self.curve == curve_hash(curve) and self.setup == setup_hash(arm, scene, attached)

    def motion_record(self, name: str = "motion", start: float = 0.0, end: float = 0.0) -> MotionRecord:
        """What it was made with, for the file of the motion that it is of, between two times (s) of it."""
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
        )

    def save(self, path: str | Path) -> None:
        """Write the proof to a ``.json`` or ``.json.gz`` file, for ``pinproof.verifier`` to re-check anywhere.

        The format is described in docs/certificates.md. What is written has passed the verifier; where its bounds are
        less tight than those that made the proof, intervals are cut further. The file is written whole or not at all.

        Raises
        ------
        InputError
            If nothing was recorded, the verdict is not FREE, the name has another ending, or a checked body is not
            convex, so that no direction tells how far it is from another.
        NotProvenFree
            If the verifier cannot confirm the proof.
        FileError
            If the file cannot be written.
        """
        from pinproof.collision.proof_file import write_proof

        if not self.free:
            raise InputError(f"only a FREE certificate is a proof to save; this one is {self.status.name}")
        if self.evidence is None or self.subject is None:
            raise InputError("this certificate kept no evidence: make it with certify(..., record=True) to save it")
        write_proof(self, *self.subject, path)

    def or_raise(self) -> Certificate:
        """Return the certificate if it is FREE.

        Raises
        ------
        NotProvenFree
            With the message otherwise.
        """
        if not self.free:
            raise NotProvenFree(self.message, self)
        return self

    def __str__(self) -> str:
        return "\n".join((f"{self.status.name}: {self.message}", *(f"note: {note}" for note in self.notes)))


def curve_hash(curve: Curve) -> str:
    """A hash of a curve's joints, knots and polynomial pieces, to the last bit."""
    return curve_digest(tuple(curve.joint_names), *curve.bezier())


def setup_hash(arm: Arm, scene: Scene, attached: Sequence[Obstacle] = ()) -> str:
    """A hash of an arm (kinematics, held joints, collision geometry), what it carries, and a scene.

    Meshes are part of it by their names and by what their files contain now.
    """
    meshes = [None if geometry.mesh is None else geometry.mesh.path for geometry in arm.robot.urdf.collisions]
    digest = _hash_of(arm, tuple(map(_content_hash, meshes))).copy()
    digest.update(repr(scene.allowed).encode())
    for obstacle in (*attached, None, *scene.obstacles):
        if obstacle is None:  # what is carried ends, what stands around begins
            digest.update(b"scene")
            continue
        digest.update(repr((obstacle.name, obstacle.shape)).encode() + matrix(obstacle.pose).tobytes())
        if isinstance(obstacle.shape, Mesh):
            digest.update(_content_hash(obstacle.shape.path).encode())
    return digest.hexdigest()


def checked_hash(checker: CollisionChecker) -> str:
    """:func:`setup_hash` of what a checker checks.

    Where a mesh file was changed after the checker had read it, this is the hash of no setup.
    """
    digest = setup_hash(checker.arm, checker.scene, checker.attached)
    changed = changed_files(checker)
    return hashlib.sha256(repr((digest, changed)).encode()).hexdigest() if changed else digest


def changed_files(checker: CollisionChecker) -> tuple[FileStamp, ...]:
    """The mesh files that a checker read, and that are no longer as they were then."""
    read = dict.fromkeys(body.file for body in checker.bodies if body.file is not None)
    return tuple(file for file in read if FileStamp.of(file.path) != file)


@lru_cache(maxsize=ARMS_KEPT)
def _hash_of(arm: Arm, meshes: tuple[str, ...]) -> Any:
    digest = hashlib.sha256(repr((arm.robot.urdf.kinematics, arm.base, arm.tcp, arm.joint_names, arm.held)).encode())
    for geometry, content in zip(arm.robot.urdf.collisions, meshes, strict=True):
        mesh = None if geometry.mesh is None else geometry.mesh.uri
        digest.update(repr((geometry.name, geometry.link, geometry.kind, geometry.size, mesh, content)).encode())
        digest.update(np.ascontiguousarray(geometry.origin).tobytes())
    return digest


def _content_hash(path: str | Path | None) -> str:
    """A hash of what a file contains now; empty where there is none."""
    stamp = None if path is None else FileStamp.of(path)
    return "" if stamp is None else _hash_of_file(stamp)


@lru_cache(maxsize=FILES_KEPT)
def _hash_of_file(stamp: FileStamp) -> str:
    return hashlib.sha256(stamp.path.read_bytes()).hexdigest()


def free_sentence(proven: float, seen: float, pairs: int, excluded: int) -> str:
    """What FREE says: the clearance (m) proven and seen, over how many pairs, and how many are not checked."""
    nearest = f", seen {seen * 1e3:.1f} mm" if math.isfinite(seen) else ""
    over = f"clearance proven {proven_millimetres(proven)}{nearest}, over {pairs} pairs"
    if not excluded:
        return f"no contact anywhere: {over}"
    left_out = "1 pair is excluded" if excluded == 1 else f"{excluded} pairs are excluded"
    return f"no contact between the pairs checked: {over}; {left_out}"


def proven_millimetres(clearance: float) -> str:
    """A lower bound in mm, rounded down: no message promises more than was proven."""
    if clearance == math.inf:
        return "unbounded (no pair is checked)"
    return f"{math.floor(clearance * 1e4) / 10:.1f} mm"
