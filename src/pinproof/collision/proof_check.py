"""Whether a saved proof holds, and whether it is a proof of a given robot, scene and motion."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.collision.checker import CollisionChecker
from pinproof.collision.proof_file import bodies_of, joints_of
from pinproof.errors import FileError
from pinproof.motion import Curve
from pinproof.verifier import Proof, ProofVerdict, load, verify

__all__ = ["verify_proof"]

SAME = 1e-12
"""rad, m and entries of matrices: by how much a number of the proof may differ from the one it is compared with: a
thousandth of what the verifier allows for rounding, so a proof of either is a proof of both."""

SHOWN = 5
"""Number of differences that are named; the others are counted."""


def verify_proof(path: str | Path, checker: CollisionChecker | None = None, curve: Curve | None = None) -> ProofVerdict:
    """Re-check a proof file by independent code (:mod:`pinproof.verifier`), and compare it with your robot and motion.

    Parameters
    ----------
    path
        A file that :meth:`Certificate.save` wrote.
    checker
        Your arm, scene and attached objects, with the pairs and margins that you require: the proof must have the same
        joints and bodies (numbers within 1e-12), and prove each of these pairs with its margin or a larger one.
        Obstacles that only the proof has are accepted. Without a checker the robot and scene of the file are trusted.
    curve
        Your motion: the proof must have equal knots, and control points within 1e-12.

    Returns
    -------
    ProofVerdict
        Whether it holds, or the reasons against it; what was compared, and what was not.

    Raises
    ------
    FileError
        If the file cannot be read, or holds no JSON.
    """
    try:
        document = load(path)
    except (OSError, ValueError) as error:
        raise FileError(path, f"cannot be read as a proof: {error}") from error
    verdict = verify(document)
    if not verdict.ok:
        return replace(verdict, not_compared=())
    proof = Proof(document)
    reasons: list[str] = []
    compared, not_compared = [], []
    if checker is None:
        not_compared += ["the robot", "the scene"]
    else:
        reasons += _differences(document, proof, checker)
        compared += ["the robot", "the scene"]
        names = {body.name for body in checker.bodies}
        more = [body.name for body in proof.bodies if body.kind != "link" and body.name not in names]
        not_compared += [f"{name} (not in yours)" for name in more]
    if curve is None:
        not_compared.append("the motion")
    else:
        reasons += _other_curve(proof, curve)
        compared.append("the motion")
    return replace(
        verdict,
        reasons=_few(reasons),
        clearance=np.nan if reasons else verdict.clearance,
        compared=tuple(compared),
        not_compared=tuple(not_compared),
    )


def _few(reasons: list[str]) -> tuple[str, ...]:
    rest = len(reasons) - SHOWN
    return (*reasons[:SHOWN], *([f"and {rest} more"] if rest > 0 else []))


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
    """Where the proof's joints and bodies are not the checker's, and which of the checker's pairs it does not prove."""
    found: list[str] = []
    names = checker.arm.joint_names
    if proof.curve.names != names:
        return [f"curve.joint_names: those of your arm are {', '.join(names)}"]
    joints = joints_of(checker.arm)
    if len(joints) != len(proof.joints):
        return [f"joints: the proof has {len(proof.joints)}, your robot {len(joints)} that move"]
    for k, (stated, mine) in enumerate(zip(document["joints"], joints, strict=True)):
        found += [f"joints[{k}].{key}: differs from your {mine['name']}" for key in _unlike(stated, mine, JOINT)]
    rows = {row["name"]: (i, row) for i, row in enumerate(document["bodies"])}
    index: list[int] = []
    for mine in bodies_of(checker):
        i, stated = rows.get(mine["name"], (-1, {}))
        index.append(i)
        if i < 0:
            found.append(f"bodies: your {mine['name']} is missing")
            continue
        found += [f"bodies[{i}].{key}: differs from your {mine['name']}" for key in _unlike(stated, mine, BODY)]
    links = {body.name for body in checker.bodies if body.link is not None and body.link == body.owner}
    unknown = [body.name for body in proof.bodies if body.kind == "link" and body.name not in links]
    found += [f"bodies: your robot has no {name}" for name in unknown]
    if found:
        return found
    proven = {frozenset(proof.members(k)) for k in range(len(proof.pairs))}
    for (i, j), margin in zip(checker.pairs, checker.margins.tolist(), strict=True):
        a, b = index[i], index[j]
        pair = f"{proof.bodies[a].name} and {proof.bodies[b].name}"
        if frozenset((a, b)) not in proven:
            found.append(f"pairs: your checker requires {pair}, which the proof does not have")
        elif not (have := proof.margin_between(a, b)) >= margin:
            found.append(f"settings.margin: {pair} have a margin of {have} m; your checker requires {margin} m")
    return found


JOINT = ("type", "parent", "leader", "axis", "placement", "multiplier", "offset")
BODY = ("owner", "kind", "geometry", "level", "joint", "placement", "shape")


def _unlike(stated: dict[str, Any], mine: dict[str, Any], keys: Iterable[str]) -> list[str]:
    return [key for key in keys if not _alike(stated.get(key), mine[key])]


def _alike(a: Any, b: Any) -> bool:
    if isinstance(b, dict):
        return isinstance(a, dict) and all(_alike(a.get(key), b[key]) for key in b)
    if isinstance(b, (str, bool)) or b is None:
        return bool(a == b)
    one, other = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    return one.shape == other.shape and bool((np.abs(one - other) <= SAME).all())
