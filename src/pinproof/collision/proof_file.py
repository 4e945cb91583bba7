"""Writes a proof to a file that is complete: curve, joints, bodies, and the evidence for each pair in each interval.

The format is described in docs/certificates.md; :mod:`pinproof.verifier` reads it, and has accepted every file written.
"""

from __future__ import annotations

import gzip
import hashlib
import json
from collections.abc import Sequence
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.bodies import Body
from pinproof.collision.certificate import Certificate
from pinproof.collision.checker import CollisionChecker
from pinproof.collision.evidence import settle
from pinproof.collision.shapes import Mesh
from pinproof.common.files import write_bytes_whole
from pinproof.errors import InputError, NotProvenFree
from pinproof.model import Arm
from pinproof.model.chain import joint_axis
from pinproof.motion import Curve
from pinproof.verifier import FORMAT, VERSION, Proof, Refused, body_digest, verify

__all__ = ["bodies_of", "joints_of", "proof_document", "write_proof"]

Array = npt.NDArray[np.float64]

SUFFIXES = (".json", ".json.gz")

SPARE = 1e-9
"""Metres by which the claimed clearance is below the proven one, for a machine that rounds differently."""


def write_proof(certificate: Certificate, curve: Curve, checker: CollisionChecker, path: str | Path) -> None:
    """Write the proof of a FREE certificate with evidence; see :meth:`Certificate.save`."""
    if not str(path).endswith(SUFFIXES):
        raise InputError(f"{path}: the name of a proof ends in {' or '.join(SUFFIXES)}")
    data = _text(proof_document(certificate, curve, checker)).encode()
    write_bytes_whole(path, gzip.compress(data, mtime=0) if str(path).endswith(".gz") else data)


def proof_document(certificate: Certificate, curve: Curve, checker: CollisionChecker) -> dict[str, Any]:
    """The mapping that a file holds.

    Raises
    ------
    InputError
        If a body of a checked pair has no support function.
    NotProvenFree
        If the verifier cannot confirm the proof.
    """
    _refuse_surfaces(checker)
    knots, control = curve.bezier()
    tube, arm = certificate.tube, checker.arm
    document: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "made_by": f"pinproof {version('pinproof')}",
        "claim": {"status": certificate.status.name, "clearance": None},
        "settings": {
            "margin": checker.margin,
            "margins": _single_margins(checker),
            "joint_tolerance": [] if tube is None else tube.joints.tolist(),
            "obstacle_tolerance": 0.0 if tube is None else tube.obstacles,
        },
        "hashes": {
            "model": hashlib.sha256(arm.robot.urdf.kinematics.encode()).hexdigest(),
            "scene": _scene_hash(checker),
            "curve": certificate.curve,
            "setup": certificate.setup,
        },
        "robot": {"name": arm.robot.name, "base": arm.base, "tcp": arm.tcp, "held": arm.held},
        "curve": {"joint_names": list(curve.joint_names), "knots": knots.tolist(), "control": control.tolist()},
        "joints": joints_of(arm),
        "bodies": bodies_of(checker),
        "notes": list(certificate.notes),
        "excluded": [[*pair.owners, " ".join(pair.reason.split())] for pair in certificate.excluded],
        "intervals": [],
        "pairs": [],
    }
    try:
        proof = Proof(document)
    except Refused as refused:
        raise NotProvenFree(f"the verifier cannot read the proof: {refused}", certificate) from refused
    document["intervals"], document["pairs"] = settle(proof, certificate, checker)
    verdict = verify({**document, "claim": {"status": "FREE", "clearance": -1.0}})
    if not verdict.ok:
        raise NotProvenFree(f"the verifier does not confirm the proof: {verdict}", certificate)
    if np.isfinite(verdict.clearance):
        document["claim"]["clearance"] = min(certificate.clearance, verdict.clearance - SPARE)
    return document


def joints_of(arm: Arm) -> list[dict[str, Any]]:
    """The joints that move with the arm's, followers too, each behind its parent."""
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
    """The bodies of a checker, in its order."""
    arm, sources = checker.arm, _sources(checker)
    rows = []
    for body in checker.bodies:
        joint, place = -1, body.link_from_body
        if body.link is not None:
            frame = arm.model.frames[arm.model.getFrameId(body.link, pin.FrameType.BODY)]
            joint, place = int(frame.parentJoint) - 1, frame.placement * place
        kind = "obstacle" if body.link is None else "link" if body.owner == body.link else "attached"
        geometry = body.source or body.name
        row = {
            "name": body.name,
            "owner": body.owner,
            "kind": kind,
            "geometry": geometry,
            "level": body.level,
            **sources[geometry],
            "joint": joint,
            "placement": _placed(place),
            "shape": _shape(body),
        }
        rows.append({**row, "sha256": body_digest(row)})
    return rows


def _sources(checker: CollisionChecker) -> dict[str, dict[str, str]]:
    """The kind and file of the shape that each geometry was made of, and the hash of its mesh file."""
    found: dict[str, dict[str, str]] = {}
    for geometry in checker.arm.robot.urdf.collisions:
        found[geometry.name] = _source(geometry.kind, None if geometry.mesh is None else geometry.mesh.path)
    for thing in (*checker.attached, *checker.scene.obstacles):
        mesh = thing.shape.path if isinstance(thing.shape, Mesh) else None
        found[thing.name] = _source(type(thing.shape).__name__, mesh)
    return found


def _source(kind: str, mesh: str | Path | None) -> dict[str, str]:
    if mesh is None:
        return {"source": kind}
    file = Path(mesh)
    return {"source": f"{kind} {file.name}", "mesh_sha256": _file_hash(file, file.stat().st_mtime_ns)}


@lru_cache(maxsize=256)
def _file_hash(path: Path, _changed: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _single_margins(checker: CollisionChecker) -> list[list[Any]]:
    """Owner, owner and metres of the pairs with a margin of their own."""
    found: dict[frozenset[str], list[Any]] = {}
    for (i, j), margin in zip(checker.pairs, checker.margins.tolist(), strict=True):
        owners = checker.bodies[i].owner, checker.bodies[j].owner
        if margin != checker.margin:
            found.setdefault(frozenset(owners), [*owners, margin])
    return list(found.values())


def _scene_hash(checker: CollisionChecker) -> str:
    """Of the obstacles' bodies, in order: names, places and numbers."""
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
    """A surface has no support function; a direction separates convex bodies only."""
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
        raise InputError(f"a proof can hold convex bodies only, which {names} are not: use {remedy}")


def _text(document: dict[str, Any]) -> str:
    """JSON with a line for each joint, body and pair, so that people can read it."""

    def line(value: Any) -> str:
        return json.dumps(value, allow_nan=False, separators=(",", ":"), ensure_ascii=False)

    parts = []
    for key, value in document.items():
        rows: Sequence[Any] = value if isinstance(value, list) and value and isinstance(value[0], dict) else ()
        lines = ",\n".join(line(row) for row in rows)
        parts.append(f"{line(key)}: [\n{lines}\n]" if rows else f"{line(key)}: {line(value)}")
    return "{\n" + ",\n".join(parts) + "\n}\n"
