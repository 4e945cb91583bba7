"""Proof files: their keys, their writing, and their comparison with a robot, a scene, constraints and a motion.

The format is described in docs/formats/proof.md. :mod:`pinproof.verifier`, which shares no code with the other packages
and has its own list of fields, has accepted every file that is written.
"""

from __future__ import annotations

import gzip
import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof._core import Shape as CoreShape
from pinproof._core import separating_directions
from pinproof.collision.certificates.path_constraints import (
    ConstraintProof,
    LookAt,
    PathConstraint,
    Upright,
    check_constraints,
)
from pinproof.collision.checking.assembly import on_joint
from pinproof.collision.checking.checker import CollisionChecker
from pinproof.collision.checking.spec import content_hash
from pinproof.collision.geometry.bodies import Body
from pinproof.collision.geometry.shapes import Mesh
from pinproof.common import structs as st
from pinproof.common.files import write_bytes_whole
from pinproof.errors import FileError, InputError, NotProvenFree
from pinproof.model import JointGroup, JointLimits, joint_axis
from pinproof.motion import Curve, LimitCheck, TimedCurve
from pinproof.spatial import SE3, Array
from pinproof.verifier import (
    FORMAT,
    VERSION,
    IntervalBounds,
    Parts,
    Proof,
    ProofVerdict,
    Refused,
    body_digest,
    load,
    verify,
)

HASH = st.simple({"type": "string", "pattern": "^[0-9a-f]{64}$"})
JOINT = st.integer(-1)
VECTOR = st.vector(3, st.PLAIN_NUMBER)
PLACEMENT = st.list_of(st.vector(4, st.PLAIN_NUMBER), 3, 3)

CLAIM = st.Table(
    "claim",
    "What the proof states.",
    st.required("status", st.choice("FREE"), "the status of the certificate"),
    st.required(
        "clearance", st.OPTIONAL_NUMBER, "any two checked bodies are at least this far apart; null without pairs", "m"
    ),
)

SETTINGS = st.Table(
    "settings",
    "The distances and tolerances that the proof includes.",
    st.required("margin", st.NOT_NEGATIVE, "required distance between any two owners", "m"),
    st.required(
        "margins",
        st.list_of(
            st.simple(
                {"type": "array", "prefixItems": [st.TEXT, st.TEXT, st.NOT_NEGATIVE], "minItems": 3, "maxItems": 3}
            )
        ),
        "distances of single pairs: owner, owner, metres",
        "m",
    ),
    st.required("joint_tolerance", st.list_of(st.NOT_NEGATIVE), "deviation of each joint of the curve", "rad or m"),
    st.required("obstacle_tolerance", st.NOT_NEGATIVE, "deviation of obstacles", "m"),
)

HASHES = st.Table(
    "hashes",
    "SHA-256 hashes; only that of the curve is checked.",
    st.Key("model", HASH, "of the kinematics of the URDF as text"),
    st.Key("scene", HASH, "of the obstacles"),
    st.required("curve", HASH, "of the curve, see below; a `Certificate` has the same under `curve`"),
    st.Key("setup", HASH, "of the arm, the scene and the attached bodies"),
    more=True,
)

ARM = st.Table(
    "arm",
    "An arm.",
    st.Key("base", st.ANY_TEXT, "base link of the arm"),
    st.Key("tcp", st.ANY_TEXT, "tcp frame of the arm"),
)

ROBOT = st.Table(
    "robot",
    "The robot, for readers; it is not checked, because the placements contain it.",
    st.Key("name", st.ANY_TEXT, "name of the robot"),
    st.Key("arms", st.mapping_to(ARM), "the arms by name; an arm alone has the name of its tcp"),
    st.Key("held", st.mapping_to(st.PLAIN_NUMBER), "values of the joints outside the arm", "rad or m"),
    more=True,
)

CURVE = st.Table(
    "curve",
    "The motion as a piecewise polynomial in Bernstein form. A single configuration is one piece of no width.",
    st.required("joint_names", st.list_of(st.TEXT, 1), "the n joints"),
    st.required(
        "knots", st.list_of(st.PLAIN_NUMBER, 2), "k + 1 strictly increasing parameters, for a timed motion in seconds"
    ),
    st.required(
        "control",
        st.list_of(st.list_of(st.list_of(st.PLAIN_NUMBER, 1), 1), 1),
        "(k, degree + 1, n) control points of each piece",
        "rad or m",
    ),
)

PROOF_LIMITS = st.Table(
    "proof_limits",
    "The limits that each joint of the curve keeps, except for 1e-6 (rad or m; of rates relative); null for no limit.",
    st.required("lower", st.list_of(st.OPTIONAL_NUMBER), "lower limit of the position", "rad or m"),
    st.required("upper", st.list_of(st.OPTIONAL_NUMBER), "upper limit of the position", "rad or m"),
    st.required("velocity", st.list_of(st.OPTIONAL_NUMBER), "limit of the speed", "rad/s or m/s"),
    st.required("acceleration", st.list_of(st.OPTIONAL_NUMBER), "limit of the acceleration", "rad/s² or m/s²"),
)

PROOF_JOINT = st.Table(
    "joint",
    "A joint that moves with the arm. Its value is multiplier * q[leader] + offset, so a mimic follower has the leader "
    "of the joint that it follows.",
    st.required("name", st.TEXT, "name of the joint"),
    st.required("type", st.choice("revolute", "prismatic"), "type of the joint"),
    st.required("axis", VECTOR, "unit vector in the frame of the joint"),
    st.required("placement", PLACEMENT, "parent_from_joint at the value 0", "m"),
    st.required("parent", JOINT, "index of the parent joint, which is earlier in the list; -1 for the root"),
    st.required("leader", st.COUNT, "index of the joint of the curve that determines the value"),
    st.required("multiplier", st.PLAIN_NUMBER, "factor of the value of the leader"),
    st.required("offset", st.PLAIN_NUMBER, "value at q[leader] = 0", "rad or m"),
)

SHAPE = st.Table(
    "convex_shape",
    "The convex hull of points, each with a flat disc about the body's z, grown by a ball and by an ellipsoid: boxes "
    "and hulls (points), spheres (one point), capsules (two points), cylinders (two discs), cones (a disc and a "
    "point), ellipsoids.",
    st.required("points", st.list_of(VECTOR, 1), "(V, 3) the points", "m"),
    st.required("disc_radii", st.list_of(st.NOT_NEGATIVE, 1), "(V,) radius of the disc of each point", "m"),
    st.required("radius", st.NOT_NEGATIVE, "radius of the ball", "m"),
    st.required("semi_axes", st.vector(3, st.NOT_NEGATIVE), "semi-axes of the ellipsoid", "m"),
)

TRIANGLES = st.Table(
    "triangles",
    "Triangles. Their order is free; the makers of proofs order them so that ranges of them are close together.",
    st.required("vertices", st.list_of(VECTOR, 1), "(V, 3) the corners of triangles", "m"),
    st.required("triangles", st.list_of(st.list_of(st.COUNT, 3, 3), 1), "(F, 3) indices of the three corners of each"),
    st.required(
        "solid",
        st.BOOLEAN,
        "whether the points about which the triangles wind belong to the body; then they must enclose a volume",
    ),
)

PROOF_BODY = st.Table(
    "body",
    "A convex body, or a mesh. All bodies of a geometry on one level represent it: one hull, or several closer ones. A "
    "pair may be proven on any level.",
    st.required("name", st.TEXT, "unique in the file"),
    st.required("owner", st.TEXT, "the link, attached object or obstacle that it is part of"),
    st.required("kind", st.choice("link", "attached", "obstacle"), "kind of the owner"),
    st.required("geometry", st.TEXT, "the geometry that it represents, with the other bodies of this name"),
    st.required("level", st.COUNT, "level of detail, 0 to 2"),
    st.Key("source", st.TEXT, "kind and file of the geometry; not checked"),
    st.Key("mesh_sha256", HASH, "hash of the mesh file; not checked"),
    st.required("joint", JOINT, "index of the joint that moves it; -1 for the root"),
    st.required("placement", PLACEMENT, "joint_from_body", "m"),
    st.required(
        "shape",
        st.any_of(SHAPE, TRIANGLES, st.choice("half_space"), st.NULL),
        "a convex shape; a mesh; `half_space`: everything below the body's z = 0; null: a body that is in no pair",
    ),
    st.required("sha256", HASH, "hash of the numbers of the body, see below"),
)

PAIR = st.Table(
    "pair",
    "The evidence for one pair of bodies: on each interval a direction along which they are apart. A mesh is apart in "
    "parts, each a range of its triangles.",
    st.required("bodies", st.list_of(st.COUNT, 2, 2), "indices of the two bodies, an obstacle second"),
    st.required("intervals", st.list_of(st.COUNT), "indices of intervals, which together cover the curve"),
    st.Key(
        "parts",
        st.list_of(st.list_of(st.COUNT, 2, 4)),
        "with one mesh or two: for each interval the first triangle of the part of each mesh, and the one after its "
        "last; at every parameter of the curve the parts together are all pairs of triangles",
    ),
    st.required(
        "directions",
        st.list_of(VECTOR),
        "a unit vector for each interval, in the frame of the root link, from the first body to the second",
    ),
)

CORNER = st.list_of(st.OPTIONAL_NUMBER, 3, 3)

CONSTRAINT = st.Table(
    "constraint",
    "A constraint of the tcp, which holds on the whole curve. `direction`: the angle between `axis` and `direction`. "
    "`region`: the distance of `point` from a box. `target`: the angle between `axis` and the direction from `origin` "
    "to `point`. Vectors of the tcp are in the frame of the joint that carries it, all others in that of `reference`.",
    st.required("name", st.TEXT, "description for readers"),
    st.required("kind", st.choice("direction", "region", "target"), "kind of the constraint"),
    st.required("joint", JOINT, "index of the joint that carries the tcp; -1 for the root"),
    st.Key("reference", JOINT, "index of the joint that carries the tcp of another arm; -1 for the root", "", -1),
    st.Key("axis", VECTOR, "`direction`, `target`: unit vector of the tcp"),
    st.Key("direction", VECTOR, "`direction`: unit vector in the frame of the reference"),
    st.Key("origin", VECTOR, "`target`: the origin of the tcp", "m"),
    st.Key("point", VECTOR, "`region`: point of the tcp; `target`: point in the frame of the reference", "m"),
    st.Key("placement", PLACEMENT, "`region`: the pose of the box in the frame of the reference", "m"),
    st.Key("low", CORNER, "`region`: lower corner of the box; null for no end", "m"),
    st.Key("high", CORNER, "`region`: upper corner of the box; null for no end", "m"),
    st.required("tolerance", st.NOT_NEGATIVE, "largest allowed error", "rad or m"),
    st.required("largest", st.NOT_NEGATIVE, "claimed largest error, at most `tolerance`", "rad or m"),
    st.required(
        "intervals",
        st.list_of(st.vector(2, st.PLAIN_NUMBER)),
        "start and end of each interval on which it is proven; together they cover the curve",
    ),
)

PROOF = st.Table(
    "proof",
    "A proof that a motion is collision-free. A placement is three rows of four numbers: rotation and translation. "
    "Indices begin at 0.",
    st.required("format", st.choice(FORMAT), "name of the format"),
    st.required("version", st.choice(VERSION), "version of the format"),
    st.Key("made_by", st.ANY_TEXT, "name and version of the program; not checked"),
    st.required("claim", CLAIM, "what the proof states"),
    st.required("settings", SETTINGS, "distances and tolerances"),
    st.required("hashes", HASHES, "hashes of the inputs"),
    st.Key("robot", ROBOT, "the robot, for readers"),
    st.required("curve", CURVE, "the motion"),
    st.required(
        "limits", st.any_of(PROOF_LIMITS, st.NULL), "the joint limits that the motion keeps; null: not compared"
    ),
    st.required("joints", st.list_of(PROOF_JOINT), "the joints that move, each after its parent"),
    st.required("bodies", st.list_of(PROOF_BODY), "the bodies"),
    st.Key("notes", st.list_of(st.ANY_TEXT), "assumptions of the certificate"),
    st.required(
        "excluded", st.list_of(st.list_of(st.TEXT, 3, 3)), "pairs that the proof does not cover: owner, owner, reason"
    ),
    st.required("intervals", st.list_of(st.vector(2, st.PLAIN_NUMBER)), "start and end, in the parameter of the curve"),
    st.required("pairs", st.list_of(PAIR), "the evidence"),
    st.Key("constraints", st.list_of(CONSTRAINT), "constraints of the tcp", "", []),
)


Indices = npt.NDArray[np.int64]

DIGITS = 6
"""Decimals of a direction: for a body of 1 m the error is 1e-6 m at most; intervals that then fail are bisected."""

SAME = 1e-13
"""rad, m and entries of matrices: by how much a number of the proof may differ from the one it is compared with. Proofs
hold for all numbers that differ from theirs by so little, of which the verifier is informed."""

CONFIRMED = 1e-6
"""Metres by which the verifier may show less clearance than the certificate has."""

ROUNDS = 60
"""Maximum number of bisections: an interval then has the resolution of a double."""


EVIDENCE_PAIR, EVIDENCE_DISTANCE = 2, 3
"""Columns of :attr:`Certificate.evidence`."""

SUFFIXES = (".json", ".json.gz")

SPARE = 1e-9
"""rad or m by which the claimed clearance is below the proven one, and the claimed error of a constraint above it, for
a machine that rounds differently."""


def write_proof(text: Callable[[], str], path: str | Path) -> None:
    """Write the text of a proof to a file; see :meth:`pinproof.Certificate.save`, whose module imports this one."""
    if not str(path).endswith(SUFFIXES):
        raise InputError(f"{path}: the name of a proof ends in {' or '.join(SUFFIXES)}")
    data = text().encode()
    write_bytes_whole(path, gzip.compress(data, mtime=0) if str(path).endswith(".gz") else data)


def proof_document(certificate: Any, curve: Curve, checker: CollisionChecker) -> dict[str, Any]:
    """Return the content of a proof file of a FREE certificate with evidence; NotProvenFree if it is not confirmed."""
    (knots, control), arm, tube = curve.bezier(), checker.group, certificate.tube
    margins: dict[frozenset[str], list[Any]] = {}
    for k, margin in enumerate(checker.margins.tolist()):
        if margin != checker.margin:
            owners = checker.owners(k)
            margins.setdefault(frozenset(owners), [*owners, margin])
    scene = hashlib.sha256(b"".join(body.content() for body in checker.bodies if body.link is None))
    document: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "made_by": f"pinproof {version('pinproof')}",
        "claim": {"status": "FREE", "clearance": None},
        "settings": {
            "margin": checker.margin,
            "margins": list(margins.values()),
            "joint_tolerance": [] if tube is None else tube.joints.tolist(),
            "obstacle_tolerance": 0.0 if tube is None else tube.obstacles,
        },
        "hashes": {
            "model": hashlib.sha256(arm.robot.urdf.kinematics.encode()).hexdigest(),
            "scene": scene.hexdigest(),
            "curve": certificate.curve,
            "setup": certificate.setup,
        },
        "robot": {
            "name": arm.robot.name,
            "arms": {name: {"base": base, "tcp": tcp} for name, (base, tcp) in arm.ends.items()},
            "held": dict(arm.held),
        },
        "curve": {"joint_names": list(curve.joint_names), "knots": knots.tolist(), "control": control.tolist()},
        "joints": joints_of(arm),
        "bodies": bodies_of(checker),
        "notes": list(certificate.notes),
        "limits": limits_of(certificate.limits),
        "excluded": [[*pair.owners, " ".join(pair.reason.split())] for pair in checker.excluded],
        "intervals": [],
        "pairs": [],
    }
    # The verifier reads the claim without evidence, which its own bounds then divide into intervals.
    try:
        proof = Proof(document, SAME)
    except Refused as refused:
        raise NotProvenFree(f"the verifier cannot read the proof: {refused}") from refused
    document["intervals"], document["pairs"] = _evidence(proof, certificate, checker)
    if certificate.constraints:
        document["constraints"] = _constraint_evidence(document, checker.group, certificate.constraints)
    verdict = verify({**document, "claim": {"status": "FREE", "clearance": -1.0}}, SAME)
    if not verdict.ok:
        raise NotProvenFree(f"the verifier does not confirm the proof: {verdict}")
    if np.isfinite(verdict.clearance):
        document["claim"]["clearance"] = min(certificate.clearance, verdict.clearance - SPARE)
    return document


class _Claims(NamedTuple):
    """What is to be proven: parts of two bodies are apart on an interval, along a direction."""

    pair: Indices
    """(R,) the pair of bodies."""
    spans: Array
    """(R, 2) start and end of the interval."""
    ranges: Indices
    """(R, 2, 2) the triangles of each body, from the first to the one after the last; a convex body is a single one."""
    u: Array
    """(R, 3) the direction; zeros: not known."""

    def select(self, rows: npt.NDArray[np.bool_]) -> _Claims:
        return _Claims(self.pair[rows], self.spans[rows], self.ranges[rows], self.u[rows])

    @staticmethod
    def join(parts: Sequence[_Claims]) -> _Claims:
        pair, spans, ranges, u = zip(*parts, strict=True)
        return _Claims(np.concatenate(pair), np.concatenate(spans), np.concatenate(ranges), np.concatenate(u))

    def divided(self, size: Array) -> list[_Claims]:
        """Return halves of these claims without directions: of the larger part of a mesh, otherwise of the interval.

        ``size`` (R, 2) is that of each part; below 0, it cannot be divided.
        """
        in_time = size.max(axis=1) < 0.0
        spans, ranges = np.stack([self.spans] * 2), np.stack([self.ranges] * 2)
        spans[:, in_time] = _halves(self.spans[in_time])
        row, side = np.flatnonzero(~in_time), size.argmax(axis=1)[~in_time]
        ranges[0, row, side, 1] = ranges[1, row, side, 0] = self.ranges[row, side].sum(axis=1) // 2
        return [_Claims(self.pair, spans[k], ranges[k], np.zeros_like(self.u)) for k in (0, 1)]


def _evidence(proof: Proof, certificate: Any, checker: CollisionChecker) -> tuple[list[Any], list[Any]]:
    """Return the table of intervals (T, 2) and, for each pair, its bodies, intervals and separating directions.

    A mesh is divided into ranges of its triangles until each is apart along one direction. NotProvenFree if the bounds
    of the verifier do not prove a pair apart on an interval, however small.
    """
    # The evidence of the certificate, and the pairs that no joint moves, for which no direction is known.
    rows, still = final_evidence(certificate.evidence), checker.still_pairs
    bodies = np.array(checker.pairs, dtype=np.int64).reshape(-1, 2)
    pieces = np.array([body.pieces for body in proof.bodies], dtype=np.int64)
    of_mesh = np.array([body.is_mesh for body in proof.bodies], dtype=bool)[bodies]
    pair = np.concatenate([rows[:, EVIDENCE_PAIR].astype(np.int64), still])
    claims = _Claims(
        pair,
        np.concatenate([rows[:, :2], np.tile((proof.curve.low, proof.curve.high), (len(still), 1))]),
        np.stack([np.zeros_like(bodies), pieces[bodies]], axis=2)[pair],
        np.concatenate([np.round(rows[:, 4:], DIGITS), np.zeros((len(still), 3))]),
    )
    need = np.array([proof.required(i, j) for i, j in checker.pairs])
    moved = np.array([proof.tolerance_of(j) for _, j in checker.pairs])
    # The claimed clearance is to be proven too.
    need = np.maximum(need, certificate.clearance - CONFIRMED + moved)
    parts, shapes = Parts(proof.bodies), [body.core_shape for body in checker.bodies]
    done: list[_Claims] = []
    for _ in range(ROUNDS):
        if not len(claims.pair):
            break
        table, at = np.unique(claims.spans, axis=0, return_inverse=True)
        at, both = at.reshape(-1), bodies[claims.pair]
        members = both.copy()
        for side in (0, 1):
            for i in np.unique(both[:, side]).tolist():
                mine = both[:, side] == i
                members[mine, side] = parts.numbers(i, claims.ranges[mine, side])
        bounds = IntervalBounds(proof, table, parts.bodies)
        # Directions that are not known: by the checker's own pairs, and by the shapes of parts of meshes.
        unknown = ~claims.u.any(axis=1)
        meshes = unknown & of_mesh[claims.pair].any(axis=1)
        for k in np.flatnonzero(unknown & ~meshes).tolist():
            measured = checker._placed(bounds.q[at[k]]).measure(int(claims.pair[k]))
            claims.u[k] = np.round(measured.normal, DIGITS)
        # A part of a mesh is the hull of its points
        for part in parts.bodies[len(shapes) - len(proof.bodies) :]:
            box = np.array([part.points.min(axis=0), part.points.max(axis=0)])
            shapes.append(CoreShape.convex(part.points, np.zeros(len(part.points)), 0.0, np.zeros(3), box))
        frames = [bounds.frames(members[meshes, side], at[meshes]).reshape(-1, 16) for side in (0, 1)]
        a, b = ([shapes[i] for i in members[meshes, side].tolist()] for side in (0, 1))
        claims.u[meshes] = np.round(separating_directions(a, b, *frames), DIGITS)
        # Claims whose bound by the verifier exceeds the required distance are done.
        unit = claims.u / np.linalg.norm(claims.u, axis=1, keepdims=True)
        good = bounds.distance(members[:, 0], members[:, 1], at, unit) > need[claims.pair]
        done.append(claims.select(good))
        # What fails with its own direction is divided; the others first get their own direction.
        divisible = claims.ranges[..., 1] - claims.ranges[..., 0] > 1
        size = np.where(divisible, bounds.balls(members), -1.0)
        others = claims.select(~good & ~unknown)
        bad = ~good & unknown
        halves = claims.select(bad).divided(size[bad])
        claims = _Claims.join([others._replace(u=np.zeros_like(others.u)), *halves])
    if len(claims.pair):
        one, other = (checker.bodies[i].name for i in checker.pairs[int(claims.pair[0])])
        raise NotProvenFree(f"the verifier cannot confirm that {one} and {other} are apart at {claims.spans[0, 0]:.6g}")
    if not done:
        return [], []
    # The intervals of each pair, in their order; equal intervals are listed once.
    proven = _Claims.join(done)
    table, at = np.unique(proven.spans, axis=0, return_inverse=True)
    order = np.lexsort([proven.ranges[:, 1, 0], proven.ranges[:, 0, 0], proven.spans[:, 0], proven.pair])
    groups = np.split(order, np.searchsorted(proven.pair[order], np.arange(1, len(checker.pairs))))
    listed = []
    for k, mine in enumerate(groups):
        row: dict[str, Any] = {"bodies": list(checker.pairs[k]), "intervals": at.reshape(-1)[mine].tolist()}
        row["directions"] = proven.u[mine].tolist()
        if of_mesh[k].any():
            row["parts"] = proven.ranges[mine][:, of_mesh[k]].reshape(len(mine), -1).tolist()
        listed.append(row)
    return table.tolist(), listed


def final_evidence(evidence: Array | None) -> Array:
    """Return evidence (K, 7) sorted by pairs and time, without the intervals that were bisected for their pair."""
    if evidence is None:
        return np.empty((0, 7))
    rows = evidence[np.lexsort([-evidence[:, 1], evidence[:, 0], evidence[:, EVIDENCE_PAIR]])]
    same_pair = rows[:-1, EVIDENCE_PAIR] == rows[1:, EVIDENCE_PAIR]
    bisected = np.zeros(len(rows), dtype=bool)
    bisected[:-1] = same_pair & (rows[1:, 1] <= rows[:-1, 1])
    return np.asarray(rows[~bisected])


def _halves(spans: Array) -> tuple[Array, Array]:
    """Return the first and the second halves of intervals (T, 2)."""
    middle = spans.mean(axis=1)
    return np.column_stack([spans[:, 0], middle]), np.column_stack([middle, spans[:, 1]])


def limits_of(check: LimitCheck | None) -> dict[str, list[float | None]] | None:
    """Return the joint limits of a proof for a file; null where none is proven."""
    if check is None:
        return None
    columns = (check.limits.lower, check.limits.upper, check.velocity, check.acceleration)
    rows = [[x if np.isfinite(x) else None for x in column.tolist()] for column in columns]
    return dict(zip(PROOF_LIMITS.names, rows, strict=True))


def constraint_of(group: JointGroup, constraint: PathConstraint) -> dict[str, Any]:
    """Return a constraint for a file: vectors of the tcp in the frame of its joint, others in that of the reference."""
    model, tcp, relative_to = group.model, group.tcp_of(constraint.arm), constraint.relative_to
    base = next(base for base, other in group.ends.values() if other == tcp)
    reference = base if relative_to is None else group.tcp_of(relative_to)
    frame, origin = (model.frames[model.getFrameId(name, pin.FrameType.BODY)] for name in (tcp, reference))
    joint_from_tcp, root_from_base = frame.placement, origin.placement
    row: dict[str, Any] = {"name": str(constraint)}
    row |= {"joint": int(frame.parentJoint) - 1, "reference": int(origin.parentJoint) - 1}
    # The verifier has one kind for each set in which a vector stays.
    if isinstance(constraint, Upright):
        axis, up = np.array(constraint.axis_in_tcp), np.array(constraint.up)
        row["kind"] = "direction"
        row["axis"] = (joint_from_tcp.rotation @ axis).tolist()
        row["direction"] = (root_from_base.rotation @ up).tolist()
    elif isinstance(constraint, LookAt):
        row["kind"] = "target"
        row["axis"] = (joint_from_tcp.rotation @ np.array(constraint.axis_in_tcp)).tolist()
        row["origin"] = joint_from_tcp.translation.tolist()
        row["point"] = root_from_base.act(np.array(constraint.point)).tolist()
    else:
        row["kind"] = "region"
        row["point"] = joint_from_tcp.act(np.array(constraint.point_in_tcp)).tolist()
        row["placement"] = _placed(SE3(root_from_base) * constraint.base_from_region)
        row["low"], row["high"] = (
            [x if np.isfinite(x) else None for x in side] for side in (constraint.low, constraint.high)
        )
    return {**row, "tolerance": constraint.tolerance}


def _constraint_evidence(
    document: dict[str, Any], group: JointGroup, proofs: Sequence[ConstraintProof]
) -> list[dict[str, Any]]:
    """Return the constraints with the intervals on which the verifier proves them; NotProvenFree if it does not."""
    rows = [
        {**constraint_of(group, each.constraint), "largest": each.constraint.tolerance, "intervals": []}
        for each in proofs
    ]
    proof = Proof({**document, "constraints": rows}, SAME)
    for each, row, stated in zip(proofs, rows, proof.constraints, strict=True):
        tolerance = each.constraint.tolerance
        goal = min(each.largest + CONFIRMED, tolerance)
        spans = np.empty((0, 2)) if each.evidence is None else np.asarray(each.evidence)
        done, largest = [], 0.0
        # Intervals with a larger error than the proven one, or the tolerance, are bisected.
        for _ in range(ROUNDS):
            if not len(spans):
                break
            errors = proof.errors_of(stated, spans)
            good = errors <= goal
            done.append(spans[good])
            largest = max(largest, float(errors[good].max(initial=0.0)))
            spans = np.concatenate(_halves(spans[~good]))
        if len(spans):
            raise NotProvenFree(f"the verifier cannot confirm {each.constraint} at {spans[0, 0]:.6g}")
        intervals = np.concatenate(done)
        row["intervals"] = intervals[np.argsort(intervals[:, 0], kind="stable")].tolist()
        row["largest"] = min(largest + SPARE, tolerance)
    return rows


def joints_of(arm: JointGroup) -> list[dict[str, Any]]:
    """Return the joints that move with the arm, mimic followers included, each after its parent."""
    model, rows = arm.model, []
    for k in range(1, model.njoints):
        axis, prismatic = joint_axis(model, k)
        leader = int(np.abs(arm.scale[k - 1]).argmax())
        kind, placed = "prismatic" if prismatic else "revolute", _placed(model.jointPlacements[k])
        value = (leader, float(arm.scale[k - 1, leader]), float(arm.offset[k - 1]))
        joint = (model.names[k], kind, axis.tolist(), placed, int(model.parents[k]) - 1, *value)
        rows.append(dict(zip(PROOF_JOINT.names, joint, strict=True)))
    return rows


def bodies_of(checker: CollisionChecker) -> list[dict[str, Any]]:
    """Return the bodies of a checker in its order."""
    model, things = checker.group.model, (*checker.attached, *checker.scene.obstacles)
    # The kind of each geometry, and its mesh file with the hash of its present content; without one if it is missing.
    files: list[tuple[str, str, str | Path | None]] = [
        (g.name, g.kind, None if g.mesh is None else g.mesh.path) for g in checker.group.robot.urdf.collisions
    ]
    files += [(o.name, type(o.shape).__name__, o.shape.path if isinstance(o.shape, Mesh) else None) for o in things]
    sources = {}
    for name, kind, mesh in files:
        digest = content_hash(mesh)
        stated = {"source": kind if mesh is None else f"{kind} {Path(mesh).name}"}
        sources[name] = stated | ({"mesh_sha256": digest} if digest else {})
    rows = []
    for body in checker.bodies:
        _, joint, place = on_joint(model, body)
        geometry = body.source or body.name
        kind = "obstacle" if body.link is None else "link" if body.owner == body.link else "attached"
        row = {"name": body.name, "owner": body.owner, "kind": kind, "geometry": geometry, "level": body.level}
        row |= sources[geometry]
        row |= {"joint": int(joint) - 1, "placement": _placed(place), "shape": _shape(body)}
        rows.append({**row, "sha256": body_digest(row)})
    return rows


def _shape(body: Body) -> Any:
    if body.is_half_space:
        return "half_space"
    if body.solid is not None:
        ordered = body.core_shape.triangles  # many boxes are no triangles in the core
        corners = ordered if len(ordered) else body.solid.surface
        vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        triangles = index.reshape(-1, 3).tolist()
        return {"vertices": vertices.tolist(), "triangles": triangles, "solid": body.solid.watertight}
    if (s := body.support) is None:
        return None
    parts = (s.points.tolist(), s.disc_radii.tolist(), float(s.radius), s.semi_axes.tolist())
    return dict(zip(SHAPE.names, parts, strict=True))


def _placed(place: pin.SE3) -> list[list[float]]:
    rows: list[list[float]] = np.column_stack([place.rotation, place.translation]).tolist()
    return rows


def proof_text(certificate: Any, curve: Curve, checker: CollisionChecker) -> str:
    """Return the proof as JSON with a line for each joint, body and pair, so that people can read it."""
    document = proof_document(certificate, curve, checker)

    def line(value: Any) -> str:
        return json.dumps(value, allow_nan=False, separators=(",", ":"), ensure_ascii=False)

    parts = []
    for key, value in document.items():
        rows: Sequence[Any] = value if isinstance(value, list) and value and isinstance(value[0], dict) else ()
        lines = ",\n".join(line(row) for row in rows)
        parts.append(f"{line(key)}: [\n{lines}\n]" if rows else f"{line(key)}: {line(value)}")
    return "{\n" + ",\n".join(parts) + "\n}\n"


SHOWN = 5
"""Number of differences that are named; the others are counted."""

JOINT_KEYS = ("name", "type", "parent", "leader", "axis", "placement", "multiplier", "offset")
BODY_KEYS = ("owner", "kind", "geometry", "level", "joint", "placement", "shape", "mesh_sha256")
"""The compared keys of joints and bodies."""


def verify_proof(
    path: str | Path,
    checker: CollisionChecker | None = None,
    curve: Curve | None = None,
    constraints: Sequence[PathConstraint] = (),
) -> ProofVerdict:
    """Re-check a proof file by independent code (:mod:`pinproof.verifier`), and compare it with your robot and motion.

    Parameters
    ----------
    path
        A file that :meth:`Certificate.save` wrote.
    checker
        Your arm, scene and attached objects, with the pairs and margins that you require: the proof must have the same
        joints and bodies (numbers within 1e-13), and prove each of these pairs with its margin or a larger one.
        Obstacles that only the proof has are accepted. Without a checker the robot and scene of the file are trusted.
    curve
        Your motion: the proof must have equal knots, and control points within 1e-13.
    constraints
        The constraints of the tcp that you require, which needs ``checker``: the proof must have each of them (numbers
        within 1e-13) with your tolerance or a smaller one.

    Returns
    -------
    ProofVerdict
        Whether it holds, or the reasons against it; what was compared, and what was not.

    Raises
    ------
    FileError
        If the file cannot be read, or holds no JSON.
    InputError
        If ``curve`` is no curve, or ``constraints`` are given without ``checker``, which defines the tcp.
    """
    if constraints and checker is None:
        raise InputError("constraints are compared in the frame of the tcp; give a checker too")
    try:
        document = load(path)
    except (OSError, ValueError) as error:
        raise FileError(path, f"cannot be read as a proof: {error}") from error
    # The proof by itself.
    verdict = verify(document, 0.0 if checker is None and curve is None else SAME)
    if not verdict.ok:
        return replace(verdict, not_compared=())
    proof = Proof(document)
    reasons: list[str] = []
    compared, not_compared = [], []
    # Robot, scene, limits and constraints, as far as there is a checker to compare with.
    if checker is None:
        not_compared += ["the robot", "the scene", *(["the constraints"] if proof.constraints else [])]
    else:
        reasons += _differences(document, proof, checker)
        compared += ["the robot", "the scene" if checker.scene else "the scene (without obstacles)"]
        if not proof.limits:
            not_compared.append("the joint limits (the proof claims none)")
        elif not reasons:
            timed = isinstance(curve, TimedCurve) or bool(np.isfinite(proof.limits["velocity"][1]).any())
            reasons += _wider_limits(proof, checker.group.limits, timed)
            compared.append("the joint limits" if timed else "the limits of position")
            if not timed and curve is None:
                not_compared.append("the limits of velocity and acceleration (the proof claims none)")
        if constraints:
            for each in check_constraints(constraints):
                mine = constraint_of(checker.group, each)
                keys = [key for key in mine if key not in ("name", "tolerance")]
                rows = [row for row in document.get("constraints", []) if not _different_keys(row, mine, keys)]
                if not any(row["tolerance"] <= each.tolerance for row in rows):
                    stated = f", only with a tolerance of {rows[0]['tolerance']:g} {each.unit}" if rows else ""
                    reasons.append(f"constraints: the proof does not have {each}{stated}")
            compared.append("the constraints")
        elif proof.constraints:
            not_compared.append("the constraints")
        names = {body.name for body in checker.bodies}
        more = [body.name for body in proof.bodies if body.kind != "link" and body.name not in names]
        not_compared += [f"{name} (not in yours)" for name in more]
    # The motion.
    if curve is None:
        not_compared.append("the motion")
    else:
        if not callable(getattr(curve, "bezier", None)):
            raise InputError(f"the curve must be a curve, such as the trajectory of a motion, not {curve!r:.80}")
        reasons += _other_curve(proof, curve)
        compared.append("the motion")
    rest = len(reasons) - SHOWN
    return replace(
        verdict,
        reasons=(*reasons[:SHOWN], *([f"and {rest} more"] if rest > 0 else [])),
        clearance=np.nan if reasons else verdict.clearance,
        compared=tuple(compared),
        not_compared=tuple(not_compared),
    )


def _wider_limits(proof: Proof, limits: JointLimits, timed: bool) -> list[str]:
    """List the joints that the proof allows to exceed your limits: those of position, if timed also known rates."""
    mine = {"position": (limits.lower, limits.upper)}
    # Accelerations that are default values are not required.
    known = np.where(limits.guessed, np.inf, limits.acceleration)
    for quantity, rate in (("velocity", limits.velocity), ("acceleration", known)) if timed else ():
        largest = np.where(np.isnan(rate), np.inf, rate)
        mine[quantity] = (-largest, largest)
    found = []
    for quantity, (low, high) in mine.items():
        least, most = proof.limits[quantity]
        wider = (least < low - SAME) | (most > high + SAME)
        found += [
            f"limits: the proof allows {proof.curve.names[k]} a {quantity} in [{least[k]:g}, {most[k]:g}]; "
            f"your arm allows [{low[k]:g}, {high[k]:g}]"
            for k in np.flatnonzero(wider)
        ]
    return found


def _other_curve(proof: Proof, curve: Curve) -> list[str]:
    knots, control = curve.bezier()
    mine = proof.curve
    if mine.names != tuple(curve.joint_names):
        return [f"curve.joint_names: those of your motion are {', '.join(curve.joint_names)}"]
    if mine.control.shape != control.shape or mine.knots.shape != knots.shape:
        return ["curve.control: your motion has other pieces"]
    off = np.abs(mine.control - control).max(axis=(1, 2))
    k = int(off.argmax())
    if not off[k] <= SAME:
        return [f"curve.control[{k}]: differs by {off[k]:.3g} from your motion"]
    other = np.flatnonzero(mine.knots != knots)
    if len(other):
        k = int(other[0])
        return [f"curve.knots[{k}]: is {mine.knots[k]:.17g}; that of your motion is {knots[k]:.17g}"]
    return []


def _differences(document: dict[str, Any], proof: Proof, checker: CollisionChecker) -> list[str]:
    """List the joints and bodies of the proof that differ from those of the checker, and the pairs that it lacks."""
    found: list[str] = []
    names = checker.group.joint_names
    if proof.curve.names != names:
        return [f"curve.joint_names: those of your arm are {', '.join(names)}"]
    # Joints outside the arm must be held at the same values.
    held = {name: float(value) for name, value in checker.group.held.items()}
    robot = document.get("robot")
    stated_held = robot.get("held", {}) if isinstance(robot, dict) else None
    if (
        not isinstance(stated_held, dict)
        or stated_held.keys() != held.keys()
        or not all(isinstance(stated_held[name], float | int) for name in held)
        or not all(_equal(stated_held[name], value) for name, value in held.items())
    ):
        return [f"robot.held: your robot holds {', '.join(f'{k} = {v:g}' for k, v in held.items()) or 'no joint'}"]
    # The joints that move, in their order.
    joints = joints_of(checker.group)
    if len(joints) != len(proof.joints):
        return [f"joints: the proof has {len(proof.joints)}, your robot {len(joints)} that move"]
    for k, (stated, mine) in enumerate(zip(document["joints"], joints, strict=True)):
        found += [
            f"joints[{k}].{key}: differs from your {mine['name']}" for key in _different_keys(stated, mine, JOINT_KEYS)
        ]
    # Every body of the checker is in the proof; bodies that only the proof has are obstacles.
    rows = {row["name"]: (i, row) for i, row in enumerate(document["bodies"])}
    index: list[int] = []
    for mine in bodies_of(checker):
        i, stated = rows.get(mine["name"], (-1, {}))
        index.append(i)
        if i < 0:
            found.append(f"bodies: your {mine['name']} is missing")
            continue
        found += [
            f"bodies[{i}].{key}: differs from your {mine['name']}" for key in _different_keys(stated, mine, BODY_KEYS)
        ]
    links = {body.name for body in checker.bodies if body.link is not None and body.link == body.owner}
    unknown = [body.name for body in proof.bodies if body.kind == "link" and body.name not in links]
    found += [f"bodies: your robot has no {name}" for name in unknown]
    if found:
        return found
    # Every checked pair is proven with its margin or a larger one.
    proven = {frozenset(proof.members(k)) for k in range(len(proof.pairs))}
    for (i, j), margin in zip(checker.pairs, checker.margins.tolist(), strict=True):
        a, b = index[i], index[j]
        pair = f"{proof.bodies[a].name} and {proof.bodies[b].name}"
        if frozenset((a, b)) not in proven:
            found.append(f"pairs: your checker requires {pair}, which the proof does not have")
        elif not (have := proof.margin_between(a, b)) >= margin:
            found.append(f"settings.margin: {pair} have a margin of {have} m; your checker requires {margin} m")
    return found


def _different_keys(stated: dict[str, Any], mine: dict[str, Any], keys: Iterable[str]) -> list[str]:
    return [key for key in keys if not _equal(stated.get(key), mine.get(key))]


def _equal(a: Any, b: Any) -> bool:
    if isinstance(b, dict):
        return isinstance(a, dict) and all(_equal(a.get(key), b[key]) for key in b)
    if isinstance(b, (str, bool)) or b is None:
        return bool(a == b)
    one, other = np.asarray(a, dtype=float), np.asarray(b, dtype=float)  # null becomes NaN: no end of a side
    return one.shape == other.shape and bool(((np.abs(one - other) <= SAME) | (np.isnan(one) & np.isnan(other))).all())
