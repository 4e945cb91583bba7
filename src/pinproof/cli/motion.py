"""``pinproof check`` and ``plan``: configurations and motions in a scene."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

import pinproof as pp
from pinproof.cli.certify import verdict
from pinproof.cli.console import check_outputs, print_json, say, working
from pinproof.cli.options import (
    Carried,
    Chain,
    Configuration,
    Html,
    Json,
    Robot,
    Seed,
    Surroundings,
    parse_configuration,
)
from pinproof.errors import InputError

__all__ = ["check", "plan"]


def check(
    robot: Robot,
    q: Configuration = None,
    *,
    chain: Chain,
    around: Surroundings,
    carried: Carried,
    as_json: Json = False,
) -> None:
    """Say whether a configuration is inside its limits and free of contact. Exit code 1 if it is not.

    Example: pinproof check ur5 --q home --scene robots/ur5/scene.yaml
    """
    arm = chain.arm(robot, carried=carried)
    checker = around.checker(arm, carried=carried)
    configuration = arm.limits.snap(parse_configuration(q, arm, "--q"))
    outside = arm.limits.violations(configuration, arm.joint_names)
    result, clearance = checker.check(configuration), checker.clearance(configuration)
    ok = result.free and not outside
    if as_json:
        contacts = [{"bodies": c.bodies, "distance": c.distance, "points": c.points.tolist()} for c in result.contacts]
        print_json({"ok": ok, "outside_limits": outside, "contacts": contacts, "clearance": clearance})
    else:
        for line in (*outside, *(str(contact) for contact in result.contacts)):
            say(line)
        say(f"{'free' if ok else 'not free'}: clearance {clearance * 1e3:.1f} mm over {len(checker.pairs)} pairs")
    if not ok:
        raise typer.Exit(1)


def plan(
    robot: Robot,
    goal: Annotated[str, typer.Option(help="Joint values to reach, in rad or m, or home.")],
    start: Annotated[str | None, typer.Option(help="Joint values to start from; by default home.")] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="The motion (.json, .csv).")] = None,
    blend: Annotated[bool, typer.Option(help="Run through rounded corners; without it, stop at each.")] = True,
    html: Html = None,
    seed: Seed = 0,
    limits: Annotated[
        Path | None, typer.Option("--limits", help="Limits of joints, as MoveIt's joint_limits.yaml states them.")
    ] = None,
    jerk: Annotated[
        str | None,
        typer.Option(help="Largest jerk of every joint, in rad/s^3 or m/s^3, or: limits, those of the file."),
    ] = None,
    *,
    chain: Chain,
    around: Surroundings,
    carried: Carried,
    as_json: Json = False,
) -> None:
    """Plan, shorten, round, time and certify a motion between two configurations. Exit code 1 if none is found.

    Example: pinproof plan ur5 --goal "1 -1.2 1.2 -1.57 -1.57 0" --scene robots/ur5/scene.yaml -o motion.json
    """
    check_outputs([output, html], [robot, around.scene, chain.srdf, limits, *carried.files])
    arm = chain.arm(robot, limits, carried)
    world = around.load()
    checker = around.checker(arm, world, carried)
    ends = (parse_configuration(start, arm, "--start"), parse_configuration(goal, arm, "--goal"))
    with working("planning"):
        result = pp.RrtConnect().plan(checker, *ends, rng=seed)
        if result.path is None:
            if as_json:
                print_json({"ok": False, "status": result.status.name, "message": result.message})
            else:
                say(result.message)
            raise typer.Exit(1)
        checker = result.checker or checker  # closer bodies, where an end touched by coarse ones alone
        simplified = pp.simplify(result.path, checker, rng=seed, blend=blend, certificate=result.certificate)
        path = simplified.path
        trajectory = pp.time_parametrise(path, arm.limits, jerk=_jerk(jerk))
        certificate = pp.certify(trajectory, checker)
    written = []
    if output is not None:
        trajectory.save(output, certificate=certificate)
        written.append(output)
    if html is not None:
        pp.write_html(html, arm, world, trajectory, certificate=certificate, attached=checker.attached)
        written.append(html)
    if as_json:
        figures = {"stops": simplified.stops, "length": path.length, "duration": trajectory.duration}
        print_json({"ok": certificate.free, **figures, **verdict(certificate)})
    else:
        stops = f"{simplified.stops} stop{'' if simplified.stops == 1 else 's'} on the way"
        say(f"{path.length:.3g} rad, {stops}, {trajectory.duration:.2f} s ({trajectory.limits_note})")
        say(str(certificate))
        if written:
            say(f"wrote {' and '.join(map(str, written))}")
    if not certificate.free:
        raise typer.Exit(1)


def _jerk(text: str | None) -> float | Literal["limits"] | None:
    if text is None or text == "limits":
        return None if text is None else "limits"
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--jerk is a number or the word limits, not {text!r}") from None
