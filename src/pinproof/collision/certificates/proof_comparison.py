"""Re-checks of proof files by the verifier, and their comparison with a robot, a scene, constraints and a motion."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.collision.certificates.path_constraints import PathConstraint, check_constraints
from pinproof.collision.certificates.proof_file import bodies_of, constraint_of, joints_of
from pinproof.collision.checking.checker import CollisionChecker
from pinproof.errors import FileError, InputError
from pinproof.model import Arm, JointLimits
from pinproof.motion import Curve, TimedCurve
from pinproof.verifier import Proof, ProofVerdict, load, verify

SAME = 1e-12
"""rad, m and entries of matrices: by how much a number of the proof may differ from the one it is compared with: a
thousandth of what the verifier allows for rounding, so a proof of either is a proof of both."""

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
        joints and bodies (numbers within 1e-12), and prove each of these pairs with its margin or a larger one.
        Obstacles that only the proof has are accepted. Without a checker the robot and scene of the file are trusted.
    curve
        Your motion: the proof must have equal knots, and control points within 1e-12.
    constraints
        The constraints of the tcp that you require, which needs ``checker``: the proof must have each of them (numbers
        within 1e-12) with your tolerance or a smaller one.

    Returns
    -------
    ProofVerdict
        Whether it holds, or the reasons against it; what was compared, and what was not.

    Raises
    ------
    FileError
        If the file cannot be read, or holds no JSON.
    InputError
        If ``constraints`` are given without ``checker``, which defines the tcp.
    """
    if constraints and checker is None:
        raise InputError("constraints are compared in the frame of the tcp; give a checker too")
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
        not_compared += ["the robot", "the scene", *(["the constraints"] if proof.constraints else [])]
    else:
        reasons += _differences(document, proof, checker)
        compared += ["the robot", "the scene"]
        if not proof.limits:
            not_compared.append("the joint limits (the proof claims none)")
        elif not reasons:
            timed = isinstance(curve, TimedCurve) or bool(np.isfinite(proof.limits["velocity"][1]).any())
            reasons += _wider_limits(proof, checker.group.limits, timed)
            compared.append("the joint limits" if timed else "the limits of position")
            if not timed and curve is None:
                not_compared.append("the limits of velocity and acceleration (the proof claims none)")
        if constraints:
            reasons += _missing_constraints(document, checker.arm, check_constraints(constraints))
            compared.append("the constraints")
        elif proof.constraints:
            not_compared.append("the constraints")
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
        reasons=_first_reasons(reasons),
        clearance=np.nan if reasons else verdict.clearance,
        compared=tuple(compared),
        not_compared=tuple(not_compared),
    )


def _missing_constraints(document: dict[str, Any], arm: Arm, constraints: Sequence[PathConstraint]) -> list[str]:
    """List the required constraints that the proof does not have."""
    found = []
    for each in constraints:
        mine = constraint_of(arm, each)
        keys = [key for key in mine if key not in ("name", "tolerance")]
        rows = [row for row in document.get("constraints", []) if not _different_keys(row, mine, keys)]
        if not any(row["tolerance"] <= each.tolerance for row in rows):
            stated = f", only with a tolerance of {rows[0]['tolerance']:g} {each.unit}" if rows else ""
            found.append(f"constraints: the proof does not have {each}{stated}")
    return found


def _wider_limits(proof: Proof, limits: JointLimits, timed: bool) -> list[str]:
    """List the joints that the proof allows to exceed your limits: those of position, if timed also known rates."""
    mine = {"position": (limits.lower, limits.upper)}
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


def _first_reasons(reasons: list[str]) -> tuple[str, ...]:
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
    """List the joints and bodies of the proof that differ from those of the checker, and the pairs that it lacks."""
    found: list[str] = []
    names = checker.group.joint_names
    if proof.curve.names != names:
        return [f"curve.joint_names: those of your arm are {', '.join(names)}"]
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
    joints = joints_of(checker.group)
    if len(joints) != len(proof.joints):
        return [f"joints: the proof has {len(proof.joints)}, your robot {len(joints)} that move"]
    for k, (stated, mine) in enumerate(zip(document["joints"], joints, strict=True)):
        found += [
            f"joints[{k}].{key}: differs from your {mine['name']}" for key in _different_keys(stated, mine, JOINT_KEYS)
        ]
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
