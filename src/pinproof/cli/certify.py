"""``pinproof certify``: prove a motion, save the proof, re-check a saved one, and look a second time by samples."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

import pinproof as pp
from pinproof.cli.complete import robot_names
from pinproof.cli.console import check_outputs, print_json, say, working
from pinproof.cli.options import Carried, Chain, Html, IgnoreRecord, Json, Surroundings, load_motion
from pinproof.errors import InputError
from pinproof.model.limits import distinct

__all__ = ["certify_motion", "verdict"]

ROUNDING = 1e-6
"""Rad or m, and relative for speeds: motions written by others state their limits to about so many digits."""


def certify_motion(
    robot: Annotated[
        str | None,
        typer.Argument(
            help="A catalogue name such as ur5, or a robot file.", metavar="ROBOT", autocompletion=robot_names
        ),
    ] = None,
    motion: Annotated[Path | None, typer.Argument(help="A motion (.json, .csv).", metavar="MOTION")] = None,
    joint_tolerance: Annotated[
        float, typer.Option(help="Prove it for joints that are off by up to this, rad or m.", min=0.0)
    ] = 0.0,
    obstacle_tolerance: Annotated[
        float, typer.Option(help="Prove it for obstacles that are off by up to this, m.", min=0.0)
    ] = 0.0,
    save_proof: Annotated[
        Path | None, typer.Option(help="Write the proof (.json, .json.gz) for others to re-check.")
    ] = None,
    verify: Annotated[
        Path | None,
        typer.Option(
            help="Re-check a saved proof instead, by other code than made it; with ROBOT, --scene and MOTION also that "
            "it is of them."
        ),
    ] = None,
    sample: Annotated[
        bool, typer.Option("--audit", help="Look for contacts a second time: dense samples, exact meshes, coal alone.")
    ] = False,
    audit_step: Annotated[
        float, typer.Option(help="No joint moves farther between two samples, rad or m.", min=1e-6)
    ] = 0.002,
    ignore_record: IgnoreRecord = False,
    html: Html = None,
    *,
    chain: Chain,
    around: Surroundings,
    carried: Carried,
    as_json: Json = False,
) -> None:
    """Prove that a motion touches nothing, between its points too. Exit code 1 unless it is FREE and inside the limits.

    A saved proof is re-checked by the same line with --verify in place of --save-proof, or by --verify alone.

    Example: pinproof certify ur5 motion.json --scene robots/ur5/scene.yaml --save-proof proof.json
    """
    arm = None if robot is None else chain.arm(robot, carried=carried)
    if verify is not None:
        if save_proof is not None or html is not None or sample or joint_tolerance or obstacle_tolerance:
            raise InputError("--verify re-checks a proof: it writes nothing, and the tolerances are those of the proof")
        _verify(verify, arm, motion, around, carried, as_json)
        return
    if arm is None or motion is None:
        raise InputError("what is to be proven? Name ROBOT and MOTION, or a saved proof with --verify")
    check_outputs([html, save_proof], [robot, motion, around.scene, chain.srdf, *carried.files])
    world = around.load()
    checker = around.checker(arm, world, carried)
    trajectory = load_motion(motion, checker, ignore_record)
    with working("proving"):
        certificate = pp.certify(
            trajectory,
            checker,
            joint_tolerance=joint_tolerance,
            obstacle_tolerance=obstacle_tolerance,
            record=save_proof is not None,
        )
    seen = _second_look(trajectory, checker, carried, audit_step) if sample else None
    if html is not None:
        pp.write_html(html, arm, world, trajectory, certificate=certificate, attached=checker.attached)
    if save_proof is not None and certificate.free:
        certificate.save(save_proof)
    beyond = _beyond_limits(trajectory, arm)
    if as_json:
        looked = None if seen is None else {"samples": seen.samples, "distance": seen.distance, "message": seen.message}
        names = [body.name for body in checker.attached]
        print_json({**verdict(certificate), "attached": names, "outside_limits": beyond, "audit": looked})
    else:
        say(str(certificate))
        if checker.attached:
            say(f"attached: {', '.join(body.name for body in checker.attached)}")
        for sentence in beyond:
            say(f"outside the limits: {sentence}")
        for pair in certificate.excluded:
            say(f"not checked: {' and '.join(pair.owners)} ({pair.reason})")
        if seen is not None:
            say(f"audit: {seen.message}")
        if save_proof is not None:
            say(f"wrote {save_proof}" if certificate.free else f"{save_proof} not written: there is no proof")
    if beyond or not certificate.free or (seen is not None and not seen.clean):
        raise typer.Exit(1)


def _verify(
    proof: Path, arm: pp.Arm | None, motion: Path | None, around: Surroundings, carried: Carried, as_json: bool
) -> None:
    if arm is None and (around.scene is not None or around.margin or any(carried.files)):
        raise InputError("--scene, --margin, --tool-of and --attached are of a robot: name ROBOT too")
    checker = None if arm is None else around.checker(arm, carried=carried)
    curve = None if motion is None or arm is None else pp.Trajectory.load(motion, arm.joint_names)
    found: pp.verifier.ProofVerdict = pp.verify_proof(proof, checker, curve)
    if as_json:
        print_json(
            {
                "ok": found.ok,
                "reasons": found.reasons,
                "clearance": found.clearance,
                "margin": found.margin,
                "joint_tolerance": found.joint_tolerance,
                "obstacle_tolerance": found.obstacle_tolerance,
                "pairs": found.pairs,
                "excluded": found.excluded,
                "compared": found.compared,
                "not_compared": found.not_compared,
            }
        )
    else:
        say(str(found))
        for a, b, reason in found.excluded:
            say(f"not checked: {a} and {b} ({reason})")
    if not found.ok:
        raise typer.Exit(1)


def _second_look(
    trajectory: pp.Trajectory, proven: pp.CollisionChecker, carried: Carried, step: float
) -> pp.collision.AuditResult:
    exact = pp.CollisionChecker(
        proven.arm,
        proven.scene,
        link_meshes="mesh",
        attached=proven.attached,
        allowed=carried.attachments.allowed,
    )
    with working("sampling"):
        return pp.audit(trajectory, exact, step=step)


def _beyond_limits(trajectory: pp.Trajectory, arm: pp.Arm) -> list[str]:
    """Where a motion leaves the limits of position and speed, between its points too; rounding is let pass."""
    limits, said = arm.limits, []
    low, high = trajectory.range()
    speeds = trajectory.max_velocity()
    for i, name in enumerate(arm.joint_names):
        if low[i] < limits.lower[i] - ROUNDING or high[i] > limits.upper[i] + ROUNDING:
            a, b, lowest, highest = distinct(low[i], high[i], limits.lower[i], limits.upper[i])
            said.append(f"{name} moves in [{a}, {b}], not [{lowest}, {highest}]")
        if speeds[i] > limits.velocity[i] * (1 + ROUNDING):
            fastest, most = distinct(speeds[i], limits.velocity[i])
            said.append(f"{name} reaches {fastest} per second, above {most}")
    return said


def verdict(certificate: pp.Certificate) -> dict[str, Any]:
    """A certificate for machines."""
    contact = certificate.first_contact
    return {
        "status": certificate.status.name,
        "message": certificate.message,
        "margin": certificate.margin,
        "clearance_proven": certificate.clearance if certificate.free else None,
        "clearance_observed": certificate.observed,
        "first_contact": None
        if contact is None
        else {
            "time": contact.time,
            "q": contact.q.tolist(),
            "bodies": contact.bodies,
            "distance": contact.distance,
            "points": contact.points.tolist(),
            "proven_free_until": contact.proven_free_until,
        },
        "excluded": [[*pair.owners, pair.reason] for pair in certificate.excluded],
        "notes": list(certificate.notes),
    }
