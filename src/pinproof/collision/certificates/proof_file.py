"""Writing of proof files: the robot, the scene, the curve, and the evidence for each pair in each interval.

The format is described in docs/formats/proof.md. :mod:`pinproof.verifier` has accepted every file that is written.
"""

from __future__ import annotations

import gzip
import hashlib
import json
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.certificates.path_constraints import (
    ConstraintProof,
    LookAt,
    PathConstraint,
    Upright,
)
from pinproof.collision.checking.assembly import on_joint
from pinproof.collision.checking.checker import CollisionChecker
from pinproof.collision.checking.spec import content_hash
from pinproof.collision.geometry.bodies import Body
from pinproof.collision.geometry.shapes import Mesh
from pinproof.common.files import write_bytes_whole
from pinproof.errors import InputError, NotProvenFree
from pinproof.model import Arm, JointGroup, joint_axis
from pinproof.motion import Curve, LimitCheck
from pinproof.spatial import SE3, Array
from pinproof.verifier import FORMAT, VERSION, IntervalBounds, Proof, Refused, body_digest, verify

Indices = npt.NDArray[np.int64]

DIGITS = 6
"""Decimals of a direction: for a body of 1 m the error is 1e-6 m at most; intervals that then fail are bisected."""

CONFIRMED = 1e-6
"""Metres by which the verifier may show less clearance than the certificate has."""

ROUNDS = 60
"""Maximum number of bisections: an interval then has the resolution of a double."""


class ProvenMotion(NamedTuple):
    """A curve that was proven collision-free, and the evidence: the parts of a FREE certificate that a file needs."""

    curve: Curve
    checker: CollisionChecker
    evidence: Array
    """(K, 7) the final evidence; the columns are those of :class:`pinproof.Certificate`."""
    clearance: float
    """The proven lower bound (m) of every distance."""
    joint_tolerance: list[float]
    """The deviation (rad or m) of each joint that the proof allows; empty for none."""
    obstacle_tolerance: float
    """The deviation (m) of obstacles that the proof allows."""
    curve_hash: str
    setup_hash: str
    notes: tuple[str, ...]
    constraints: tuple[ConstraintProof, ...] = ()
    """The proofs of constraints of the tcp, with their evidence."""
    limits: LimitCheck | None = None
    """The joint limits that the curve keeps; None if they were not compared."""


def evidence_of(proof: Proof, proven: ProvenMotion) -> tuple[list[Any], list[Any]]:
    """Return the table of intervals (T, 2) and, for each pair, its bodies, intervals and separating directions.

    Raises NotProvenFree if the bounds of the verifier do not prove a pair apart on an interval, however small.
    """
    checker = proven.checker
    pair, spans, u = _leaves(proven, (proof.curve.low, proof.curve.high))
    bodies = np.array(checker.pairs, dtype=np.int64).reshape(-1, 2)
    need = np.array([proof.required(i, j) for i, j in checker.pairs])
    moved = np.array([proof.tolerance_of(j) for _, j in checker.pairs])
    need = np.maximum(need, proven.clearance - CONFIRMED + moved)
    done: list[tuple[Indices, Array, Array]] = []
    fresh = np.zeros(len(pair), dtype=bool)  # whether the direction was found for this very interval
    for _ in range(ROUNDS):
        if not len(pair):
            break
        table, at = np.unique(spans, axis=0, return_inverse=True)
        at = at.reshape(-1)
        bounds_of_table = IntervalBounds(proof, table)
        unknown = ~u.any(axis=1)
        u[unknown] = _directions(checker, pair[unknown], bounds_of_table.q[at[unknown]])
        fresh |= unknown
        unit = u / np.linalg.norm(u, axis=1, keepdims=True)
        good = bounds_of_table.distance(bodies[pair, 0], bodies[pair, 1], at, unit) > need[pair]
        done.append((pair[good], spans[good], u[good]))
        pair, spans, u, fresh = pair[~good], spans[~good], u[~good], fresh[~good]
        # An interval that fails with its own direction is bisected; the others first get their own direction.
        middle = spans[fresh].mean(axis=1)
        halves = [np.column_stack([spans[fresh, 0], middle]), np.column_stack([middle, spans[fresh, 1]])]
        spans = np.concatenate([spans[~fresh], *halves])
        pair = np.concatenate([pair[~fresh], pair[fresh], pair[fresh]])
        u, fresh = np.zeros((len(pair), 3)), np.zeros(len(pair), dtype=bool)
    if len(pair):
        a, b = (checker.bodies[i].name for i in checker.pairs[int(pair[0])])
        raise NotProvenFree(f"the verifier cannot confirm that {a} and {b} are apart at {spans[0, 0]:.6g}")
    return _document_rows(checker, done)


def _leaves(proven: ProvenMotion, domain: tuple[float, float]) -> tuple[Indices, Array, Array]:
    """Return the evidence of all pairs: pairs (K,), intervals (K, 2) and directions (K, 3), zeros if not known."""
    rows = proven.evidence
    still = proven.checker.still_pairs
    return (
        np.concatenate([rows[:, 2].astype(np.int64), still]),
        np.concatenate([rows[:, :2], np.tile(domain, (len(still), 1))]),
        np.concatenate([np.round(rows[:, 4:], DIGITS), np.zeros((len(still), 3))]),
    )


def _directions(checker: CollisionChecker, pairs: Indices, q: Array) -> Array:
    """Return (K, 3) unit vectors along which pairs (K,) are apart at configurations (K, n)."""
    found = np.empty((len(pairs), 3))
    for row, (pair, configuration) in enumerate(zip(pairs.tolist(), q, strict=True)):
        found[row] = checker.placed(configuration).measure(pair).normal
    return np.round(found, DIGITS)


def _document_rows(checker: CollisionChecker, done: list[tuple[Indices, Array, Array]]) -> tuple[list[Any], list[Any]]:
    if not done:
        return [], []
    pair, spans, u = (np.concatenate(parts) for parts in zip(*done, strict=True))
    table, at = np.unique(spans, axis=0, return_inverse=True)
    order = np.lexsort([spans[:, 0], pair])
    groups = np.split(order, np.searchsorted(pair[order], np.arange(1, len(checker.pairs))))
    rows = [
        {"bodies": list(bodies), "intervals": at.reshape(-1)[mine].tolist(), "directions": u[mine].tolist()}
        for bodies, mine in zip(checker.pairs, groups, strict=True)
    ]
    return table.tolist(), rows


SUFFIXES = (".json", ".json.gz")

SPARE = 1e-9
"""rad or m by which the claimed clearance is below the proven one, and the claimed error of a constraint above it, for
a machine that rounds differently."""


def write_proof(proven: ProvenMotion, path: str | Path) -> None:
    """Write the proof of a motion to a file; see :meth:`pinproof.Certificate.save`."""
    if not str(path).endswith(SUFFIXES):
        raise InputError(f"{path}: the name of a proof ends in {' or '.join(SUFFIXES)}")
    data = _text(proof_document(proven)).encode()
    write_bytes_whole(path, gzip.compress(data, mtime=0) if str(path).endswith(".gz") else data)


def proof_document(proven: ProvenMotion) -> dict[str, Any]:
    """Return the content of a proof file.

    Raises InputError if a body of a checked pair has no support function, NotProvenFree if the verifier does not
    confirm the proof.
    """
    curve, checker = proven.curve, proven.checker
    _refuse_surfaces(checker)
    knots, control = curve.bezier()
    arm = checker.group
    document: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "made_by": f"pinproof {version('pinproof')}",
        "claim": {"status": "FREE", "clearance": None},
        "settings": {
            "margin": checker.margin,
            "margins": _single_margins(checker),
            "joint_tolerance": proven.joint_tolerance,
            "obstacle_tolerance": proven.obstacle_tolerance,
        },
        "hashes": {
            "model": hashlib.sha256(arm.robot.urdf.kinematics.encode()).hexdigest(),
            "scene": _scene_hash(checker),
            "curve": proven.curve_hash,
            "setup": proven.setup_hash,
        },
        "robot": {
            "name": arm.robot.name,
            "arms": {name: {"base": base, "tcp": tcp} for name, (base, tcp) in arm.ends.items()},
            "held": dict(arm.held),
        },
        "curve": {"joint_names": list(curve.joint_names), "knots": knots.tolist(), "control": control.tolist()},
        "joints": joints_of(arm),
        "bodies": bodies_of(checker),
        "notes": list(proven.notes),
        "limits": limits_of(proven.limits),
        "excluded": [[*pair.owners, " ".join(pair.reason.split())] for pair in checker.excluded],
        "intervals": [],
        "pairs": [],
    }
    try:
        proof = Proof(document)
    except Refused as refused:
        raise NotProvenFree(f"the verifier cannot read the proof: {refused}") from refused
    document["intervals"], document["pairs"] = evidence_of(proof, proven)
    if proven.constraints:
        document["constraints"] = _constraint_evidence(document, checker.arm, proven)
    verdict = verify({**document, "claim": {"status": "FREE", "clearance": -1.0}})
    if not verdict.ok:
        raise NotProvenFree(f"the verifier does not confirm the proof: {verdict}")
    if np.isfinite(verdict.clearance):
        document["claim"]["clearance"] = min(proven.clearance, verdict.clearance - SPARE)
    return document


def limits_of(check: LimitCheck | None) -> dict[str, list[float | None]] | None:
    """Return the joint limits of a proof for a file; null where none is proven."""
    if check is None:
        return None
    columns = (check.limits.lower, check.limits.upper, check.velocity, check.acceleration)
    rows = [[x if np.isfinite(x) else None for x in column.tolist()] for column in columns]
    return dict(zip(("lower", "upper", "velocity", "acceleration"), rows, strict=True))


def constraint_of(arm: Arm, constraint: PathConstraint) -> dict[str, Any]:
    """Return a constraint for a file: vectors of the tcp in the frame of its joint, all others in the root frame."""
    frame = arm.model.frames[arm.model.getFrameId(arm.tcp, pin.FrameType.BODY)]
    joint_from_tcp, root_from_base = frame.placement, arm.root_from_base
    row: dict[str, Any] = {"name": str(constraint), "joint": int(frame.parentJoint) - 1}
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


def _constraint_evidence(document: dict[str, Any], arm: Arm, proven: ProvenMotion) -> list[dict[str, Any]]:
    """Return the constraints with the intervals on which the verifier proves them; NotProvenFree if it does not."""
    rows = [
        {**constraint_of(arm, each.constraint), "largest": each.constraint.tolerance, "intervals": []}
        for each in proven.constraints
    ]
    proof = Proof({**document, "constraints": rows})
    for each, row, stated in zip(proven.constraints, rows, proof.constraints, strict=True):
        tolerance = each.constraint.tolerance
        goal = min(each.largest + CONFIRMED, tolerance)
        spans = np.empty((0, 2)) if each.evidence is None else np.asarray(each.evidence)
        done, largest = [], 0.0
        for _ in range(ROUNDS):
            if not len(spans):
                break
            errors = proof.errors_of(stated, spans)
            good = errors <= goal
            done.append(spans[good])
            largest = max(largest, float(errors[good].max(initial=0.0)))
            failed = spans[~good]
            middle = failed.mean(axis=1)
            spans = np.concatenate([np.column_stack([failed[:, 0], middle]), np.column_stack([middle, failed[:, 1]])])
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
        rows.append(
            {
                "name": model.names[k],
                "type": "prismatic" if prismatic else "revolute",
                "axis": axis.tolist(),
                "placement": _placed(model.jointPlacements[k]),
                "parent": int(model.parents[k]) - 1,
                "leader": leader,
                "multiplier": float(arm.scale[k - 1, leader]),
                "offset": float(arm.offset[k - 1]),
            }
        )
    return rows


def bodies_of(checker: CollisionChecker) -> list[dict[str, Any]]:
    """Return the bodies of a checker in its order."""
    model, sources = checker.group.model, _sources(checker)
    rows = []
    for body in checker.bodies:
        _, joint, place = on_joint(model, body)
        kind = "obstacle" if body.link is None else "link" if body.owner == body.link else "attached"
        geometry = body.source or body.name
        row = {
            "name": body.name,
            "owner": body.owner,
            "kind": kind,
            "geometry": geometry,
            "level": body.level,
            **sources[geometry],
            "joint": int(joint) - 1,
            "placement": _placed(place),
            "shape": _shape(body),
        }
        rows.append({**row, "sha256": body_digest(row)})
    return rows


def _sources(checker: CollisionChecker) -> dict[str, dict[str, str]]:
    """Return the kind and the mesh file of the shape of each geometry, with the hash of the file."""
    found: dict[str, dict[str, str]] = {}
    for geometry in checker.group.robot.urdf.collisions:
        found[geometry.name] = _source(geometry.kind, None if geometry.mesh is None else geometry.mesh.path)
    for thing in (*checker.attached, *checker.scene.obstacles):
        mesh = thing.shape.path if isinstance(thing.shape, Mesh) else None
        found[thing.name] = _source(type(thing.shape).__name__, mesh)
    return found


def _source(kind: str, mesh: str | Path | None) -> dict[str, str]:
    if mesh is None:
        return {"source": kind}
    file = Path(mesh)
    digest = content_hash(file)  # empty if the file is missing now
    return {"source": f"{kind} {file.name}", **({"mesh_sha256": digest} if digest else {})}


def _single_margins(checker: CollisionChecker) -> list[list[Any]]:
    """Return owner, owner and margin (m) of the pairs with an individual margin."""
    found: dict[frozenset[str], list[Any]] = {}
    for (i, j), margin in zip(checker.pairs, checker.margins.tolist(), strict=True):
        owners = checker.bodies[i].owner, checker.bodies[j].owner
        if margin != checker.margin:
            found.setdefault(frozenset(owners), [*owners, margin])
    return list(found.values())


def _scene_hash(checker: CollisionChecker) -> str:
    """Return a hash of the bodies of the obstacles in their order."""
    digest = hashlib.sha256()
    for body in checker.bodies:
        if body.link is None:
            digest.update(body.content())
    return digest.hexdigest()


def _shape(body: Body) -> Any:
    if isinstance(body.geometry, coal.Halfspace):
        return "half_space"
    if body.support is None:
        return None
    s = body.support
    return {
        "points": s.points.tolist(),
        "disc_radii": s.disc_radii.tolist(),
        "radius": float(s.radius),
        "semi_axes": s.semi_axes.tolist(),
    }


def _placed(place: pin.SE3) -> list[list[float]]:
    rows: list[list[float]] = np.column_stack([place.rotation, place.translation]).tolist()
    return rows


def _refuse_surfaces(checker: CollisionChecker) -> None:
    """Refuse bodies without a support function, because a direction is evidence for convex bodies only."""
    met = {i for pair in checker.pairs for i in pair}
    surfaces = [b for i, b in enumerate(checker.bodies) if i in met and _shape(b) is None]
    if surfaces:
        links = any(body.link is not None for body in surfaces)
        remedy = (
            'links with link_meshes="decomposed" or "hull", and no finer_at'
            if links
            else "Mesh(hull=True), or boxes in its place"
        )
        names = ", ".join(body.name for body in surfaces)
        raise InputError(f"a proof covers convex bodies only, and {names} are not convex: use {remedy}")


def _text(document: dict[str, Any]) -> str:
    """Return JSON with a line for each joint, body and pair, so that people can read it."""

    def line(value: Any) -> str:
        return json.dumps(value, allow_nan=False, separators=(",", ":"), ensure_ascii=False)

    parts = []
    for key, value in document.items():
        rows: Sequence[Any] = value if isinstance(value, list) and value and isinstance(value[0], dict) else ()
        lines = ",\n".join(line(row) for row in rows)
        parts.append(f"{line(key)}: [\n{lines}\n]" if rows else f"{line(key)}: {line(value)}")
    return "{\n" + ",\n".join(parts) + "\n}\n"
