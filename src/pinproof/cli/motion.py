"""``pinproof check``, ``plan``, ``certify`` and ``view``: configurations and motions in a scene."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from pinproof.cli.console import print_json, say, working
from pinproof.cli.options import (
    Base,
    Group,
    Json,
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
from pinproof.collision import Certificate, CollisionChecker, certify
from pinproof.model import Arm
from pinproof.motion import Trajectory, time_parametrise
from pinproof.planning import RrtConnect, shortcut
from pinproof.viewer import show, write_html

__all__ = ["certify_motion", "check", "plan", "view"]

ROUNDING = 1e-6
"""Rad or m, and relative for speeds: motions written by others state their limits to about so many digits."""

Configuration = Annotated[str | None, typer.Option(help='Joint values in rad or m: "0 -pi/2 pi/2 ...", or home.')]
Html = Annotated[Path | None, typer.Option("--html", help="Write a page that shows it.")]


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
    html: Html = None,
    seed: Seed = 0,
    tcp: Tcp = None,
    base: Base = None,
    group: Group = None,
    srdf: SrdfFile = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
) -> None:
    """Plan, shorten, time and certify a motion between two configurations. Exit code 1 if none is found.

    Example: pinproof plan ur5 --goal "1 -1.2 1.2 -1.57 -1.57 0" --scene robots/ur5/scene.yaml -o motion.json
    """
    check_outputs([output, html], [robot, scene, srdf])
    arm = load_arm(robot, tcp, base, group, srdf, package_dir)
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
        path = shortcut(result.path, checker, rng=seed)
        trajectory = time_parametrise(path, arm.limits)
        certificate = certify(trajectory, checker)
    written = []
    if output is not None:
        trajectory.save(output)
        written.append(output)
    if html is not None:
        write_html(html, arm, world, trajectory, certificate=certificate)
        written.append(html)
    if as_json:
        figures = {"waypoints": len(path), "length": path.length, "duration": trajectory.duration}
        print_json({"ok": certificate.free, **figures, **_verdict(certificate)})
    else:
        say(f"{len(path)} waypoints, {path.length:.3g} rad, {trajectory.duration:.2f} s ({trajectory.limits_note})")
        say(str(certificate))
        if written:
            say(f"wrote {' and '.join(map(str, written))}")
    if not certificate.free:
        raise typer.Exit(1)


def certify_motion(
    robot: Robot,
    motion: Annotated[Path, typer.Argument(help="A motion (.json, .csv).", metavar="MOTION")],
    scene: SceneFile = None,
    margin: Margin = 0.0,
    html: Html = None,
    tcp: Tcp = None,
    base: Base = None,
    group: Group = None,
    srdf: SrdfFile = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
) -> None:
    """Prove that a motion touches nothing, between its points too. Exit code 1 unless it is FREE and inside the limits.

    Example: pinproof certify ur5 motion.json --scene robots/ur5/scene.yaml
    """
    check_outputs([html], [robot, motion, scene, srdf])
    arm = load_arm(robot, tcp, base, group, srdf, package_dir)
    world = load_scene(scene)
    trajectory = Trajectory.load(motion, arm.joint_names)
    with working("proving"):
        certificate = certify(trajectory, CollisionChecker(arm, world, margin=margin))
    if html is not None:
        write_html(html, arm, world, trajectory, certificate=certificate)
    beyond = _beyond_limits(trajectory, arm)
    if as_json:
        print_json({**_verdict(certificate), "outside_limits": beyond})
    else:
        say(str(certificate))
        for sentence in beyond:
            say(f"outside the limits: {sentence}")
        for pair in certificate.excluded:
            say(f"not checked: {' and '.join(pair.owners)} ({pair.reason})")
    if beyond or not certificate.free:
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


def _beyond_limits(trajectory: Trajectory, arm: Arm) -> list[str]:
    """Where a motion leaves the limits of position and speed, between its points too; rounding is let pass."""
    limits, said = arm.limits, []
    low, high = trajectory.range()
    speeds = trajectory.max_velocity()
    for i, name in enumerate(arm.joint_names):
        if low[i] < limits.lower[i] - ROUNDING or high[i] > limits.upper[i] + ROUNDING:
            said.append(
                f"{name} moves in [{low[i]:.6g}, {high[i]:.6g}], not [{limits.lower[i]:.6g}, {limits.upper[i]:.6g}]"
            )
        if speeds[i] > limits.velocity[i] * (1 + ROUNDING):
            said.append(f"{name} reaches {speeds[i]:.6g} per second, above {limits.velocity[i]:.6g}")
    return said


def _verdict(certificate: Certificate) -> dict[str, Any]:
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
