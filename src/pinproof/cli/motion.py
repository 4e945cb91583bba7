"""``pinproof check``, ``plan`` and ``view``: configurations and motions in a scene."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from pinproof.cli.certify import verdict
from pinproof.cli.console import print_json, say, working
from pinproof.cli.options import (
    Base,
    Group,
    Html,
    Json,
    LimitsFile,
    Margin,
    PackageDirs,
    Robot,
    SceneFile,
    Seed,
    SrdfFile,
    Tcp,
    load_arm,
    load_scene,
    parse_configuration,
)
from pinproof.cli.outputs import check_outputs
from pinproof.collision import CollisionChecker, certify
from pinproof.errors import InputError
from pinproof.motion import Trajectory, time_parametrise
from pinproof.planning import RrtConnect, simplify
from pinproof.viewer import show, write_html

__all__ = ["check", "plan", "view"]

Configuration = Annotated[str | None, typer.Option(help='Joint values in rad or m: "0 -pi/2 pi/2 ...", or home.')]


def check(
    robot: Robot,
    q: Configuration = None,
    scene: SceneFile = None,
    margin: Margin = 0.0,
    tcp: Tcp = None,
    base: Base = None,
    group: Group = None,
    srdf: SrdfFile = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
) -> None:
    """Say whether a configuration is inside its limits and free of contact. Exit code 1 if it is not.

    Example: pinproof check ur5 --q home --scene robots/ur5/scene.yaml
    """
    arm = load_arm(robot, tcp, base, group, srdf, package_dir)
    checker = CollisionChecker(arm, load_scene(scene), margin=margin)
    configuration = parse_configuration(q, arm, "--q")
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
    scene: SceneFile = None,
    margin: Margin = 0.0,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="The motion (.json, .csv).")] = None,
    blend: Annotated[bool, typer.Option(help="Run through rounded corners; without it, stop at each.")] = True,
    html: Html = None,
    seed: Seed = 0,
    limits: LimitsFile = None,
    jerk: Annotated[
        str | None,
        typer.Option(help="Largest jerk of every joint, in rad/s^3 or m/s^3, or: limits, those of the file."),
    ] = None,
    tcp: Tcp = None,
    base: Base = None,
    group: Group = None,
    srdf: SrdfFile = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
) -> None:
    """Plan, shorten, round, time and certify a motion between two configurations. Exit code 1 if none is found.

    Example: pinproof plan ur5 --goal "1 -1.2 1.2 -1.57 -1.57 0" --scene robots/ur5/scene.yaml -o motion.json
    """
    check_outputs([output, html], [robot, scene, srdf, limits])
    arm = load_arm(robot, tcp, base, group, srdf, package_dir, limits)
    world = load_scene(scene)
    checker = CollisionChecker(arm, world, margin=margin)
    ends = (parse_configuration(start, arm, "--start"), parse_configuration(goal, arm, "--goal"))
    with working("planning"):
        result = RrtConnect().plan(checker, *ends, rng=seed)
        if result.path is None:
            if as_json:
                print_json({"ok": False, "status": result.status.name, "message": result.message})
            else:
                say(result.message)
            raise typer.Exit(1)
        checker = result.checker or checker  # closer bodies, where an end touched by coarse ones alone
        simplified = simplify(result.path, checker, rng=seed, blend=blend, certificate=result.certificate)
        path = simplified.path
        trajectory = time_parametrise(path, arm.limits, jerk=_jerk(jerk))
        certificate = certify(trajectory, checker)
    written = []
    if output is not None:
        trajectory.save(output)
        written.append(output)
    if html is not None:
        write_html(html, arm, world, trajectory, certificate=certificate)
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


def view(
    robot: Robot,
    q: Configuration = None,
    motion: Annotated[Path | None, typer.Option(help="A motion (.json, .csv) to play.")] = None,
    scene: SceneFile = None,
    html: Html = None,
    port: Annotated[int, typer.Option(help="Port of the live view on 127.0.0.1; 0 takes a free one.", min=0)] = 0,
    browser: Annotated[bool, typer.Option(help="Open the live view in the browser.")] = True,
    tcp: Tcp = None,
    base: Base = None,
    group: Group = None,
    srdf: SrdfFile = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
) -> None:
    """Show a robot, still or in motion: live in the browser (Ctrl-C ends it), or as a page with --html.

    A motion is certified for its caption, with no margin.

    Example: pinproof view ur5 --html ur5.html
    """
    check_outputs([html], [robot, motion, scene, srdf])
    arm = load_arm(robot, tcp, base, group, srdf, package_dir)
    world = load_scene(scene)
    trajectory = None if motion is None else Trajectory.load(motion, arm.joint_names)
    certificate = None if trajectory is None else certify(trajectory, CollisionChecker(arm, world))
    still = parse_configuration(q, arm, "--q") if trajectory is None else None
    if html is not None:
        write_html(html, arm, world, trajectory, certificate=certificate, q=still)
        print_json({"page": str(html)}) if as_json else say(f"wrote {html}")
        return
    with show(arm, world, trajectory, certificate=certificate, q=still, port=port, open_browser=browser) as shown:
        print_json({"url": shown.url}) if as_json else say(f"{shown.url} (Ctrl-C ends it)")
        shown.wait()


def _jerk(text: str | None) -> float | Literal["limits"] | None:
    if text is None or text == "limits":
        return None if text is None else "limits"
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--jerk is a number or the word limits, not {text!r}") from None
