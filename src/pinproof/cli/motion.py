"""``pinproof check``, ``plan`` and ``view``: check a configuration, plan a motion, and show either."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pinproof as pp
from pinproof.cli import options
from pinproof.cli.console import (
    check_output_files,
    print_error,
    print_result,
    progress_status,
    until_interrupted,
    written,
)
from pinproof.errors import InputError, MeshError


def check(
    robot: options.Robot, q: options.Configuration = None, *, setup: options.SetupOptions, as_json: options.Json = False
) -> None:
    """Check a configuration for joint limits and collisions.

    Exit code 1 if it violates a limit or collides.

    Example: pinproof check ur5 --q home --scene robots/ur5/scene.yaml
    """
    # Limits and collisions are reported together
    arm = setup.arm(robot)
    checker = setup.checker(arm)
    configuration = arm.limits.snap(options.parse_configuration(q, arm, "--q"))
    outside = arm.limits.violations(configuration, arm.joint_names)
    result, clearance = checker.check(configuration), checker.clearance(configuration)
    ok = result.free and not outside
    contacts = [{"bodies": c.bodies, "distance": c.distance, "points": c.points.tolist()} for c in result.contacts]
    data = {"ok": ok, "outside_limits": outside, "contacts": contacts, "clearance": clearance}
    pairs = f"clearance {clearance * 1e3:.1f} mm over {len(checker.pairs)} body pairs"
    lines = [*outside, *map(str, result.contacts)]
    lines.append(f"{'free' if ok else 'not free'}: {pairs if checker.pairs else 'no pair of bodies is checked'}")
    assumptions = pp.collision.setup_of(checker).notes
    notes = filter(None, [*assumptions, pp.collision.overlap_hint(checker, configuration, result)])
    lines += [f"note: {note}" for note in notes]
    data |= {"pairs": len(checker.pairs), "notes": assumptions}
    print_result(data, lines, as_json=as_json, ok=ok)


@dataclass(frozen=True)
class PlanOptions:
    """How the motion is found."""

    blend: bool = options.option("Round the corners of the path; with --no-blend the arm stops at each corner.", True)
    planner: str = options.option(
        "The planner: rrt_connect, or MODULE:CLASS for a class with the method of pinproof.planning.Planner.",
        "rrt_connect",
        metavar="PLANNER",
    )
    jerk: str | None = options.option(
        "Jerk limit of every joint in rad/s^3 or m/s^3, or the word limits for the jerk limits in the file of "
        "--limits. Default: no jerk limit.",
        None,
        metavar="NUMBER|limits",
    )
    optimise: int = options.option(
        "How many changes of the motion are tried to reduce its duration. With 0, the shortened path is only timed.",
        600,
        min=0,
    )


def plan(
    robot: options.Robot,
    goal: str | None = options.option("Goal joint values in rad or m, or home.", None, metavar="VALUES"),
    xyz: str | None = options.option(
        'Instead of --goal, the position of the tcp, or of the tip of the tool, in metres: "0.4 0.1 0.3".',
        None,
        metavar="POSITION",
    ),
    rpy: str = options.option('Roll, pitch and yaw at --xyz in radians: "pi 0 0".', "0 0 0", metavar="ANGLES"),
    start: str | None = options.option("Start joint values in rad or m. Default: home.", None, metavar="VALUES"),
    output: Path | None = options.option(
        "The motion file to write (.json, .csv), and beside it its proof (.proof.json) for pinproof certify --verify.",
        None,
        "-o",
        "--output",
    ),
    *,
    effort: PlanOptions,
    html: options.Html = None,
    seed: options.Seed = 0,
    upright: options.ConstraintOptions,
    rates: options.RateOptions,
    setup: options.SetupOptions,
    as_json: options.Json = False,
) -> None:
    """Plan a certified motion from a configuration to another one, or to a pose, as short as the limits allow.

    Exit code 1 if no collision-free motion is found and proven; the result states the evidence, and --html shows it.

    Example: pinproof plan ur5 --xyz "0.4 0.1 0.3" --rpy "pi 0 0" --scene robots/ur5/scene.yaml -o motion.json
    """
    if (goal is None) == (xyz is None):
        raise InputError("state the goal either with --goal, as joint values, or with --xyz, as the pose of the tcp")
    check_output_files([output, html], [robot, *setup.files])
    jerk: float | Literal["limits"] | None = None  # "limits" selects the jerk limits of the arm
    if effort.jerk is not None:
        try:
            jerk = "limits" if effort.jerk == "limits" else float(effort.jerk)
        except ValueError:
            raise InputError(f"--jerk must be a number or the word limits, not {effort.jerk!r}") from None
    arm = setup.arm(robot)
    limits, world = rates.limits(arm), setup.world()
    begin = options.parse_configuration(start, arm, "--start")
    end = options.parse_configuration(goal, arm, "--goal") if xyz is None else setup.target(xyz, rpy)
    with progress_status("planning"):
        found = pp.plan(
            setup.checker(arm, world),
            begin,
            end,
            planner=effort.planner,
            blend=effort.blend,
            jerk=jerk,
            rate_limits=limits,
            constraints=upright.constraints(arm, begin),
            rng=seed,
            budget=effort.optimise,
        )
    # Files before the answer, so that "wrote" is true; a motion that is not proven is no motion
    proof = None
    if output is not None and found.ok:
        proof = found.save(output)
    if html is not None:
        found.to_html(html)
    lines = [found.to_text(), *written(output if found.ok else None, proof, html)]
    print_result(found.to_dict(), lines, as_json=as_json, ok=found.ok)


@dataclass(frozen=True)
class PngOptions:
    """Options of the PNG picture."""

    png: Path | None = options.option("Write a picture (PNG). Requires a Chromium-based browser.", None)
    time: float | None = options.option("Time of the motion that --png shows, in seconds.", None)
    size: str = options.option("Size of --png in pixels.", "1280x800", metavar="WIDTHxHEIGHT")


def view(
    robot: options.Robot,
    motion: Path | None = options.argument(
        "A motion file to play (.json, .csv, .yaml or .yml).", None, metavar="MOTION"
    ),
    q: options.Configuration = None,
    branches: bool = options.option("Also show all other IK solutions for the tcp pose of --q, transparent.", False),
    layer: list[str] | None = options.option(
        "A layer to show at first: collision, frames or sweep; can be given several times.", None, metavar="LAYER"
    ),
    html: options.Html = None,
    live: bool | None = options.option(
        "Whether the page of --html computes: what is moved in it is checked for contacts. Default: if that enlarges "
        "it by 1 MB at most.",
        None,
    ),
    port: int = options.option("Port of the live view on 127.0.0.1; 0 selects a free port.", 0, min=0),
    browser: bool = options.option("Open the live view in the browser.", True),
    ignore_record: options.IgnoreRecord = False,
    *,
    png_options: PngOptions,
    setup: options.SetupOptions,
    as_json: options.Json = False,
) -> None:
    """Show a robot or a motion in the browser (Ctrl-C ends it), as an HTML page (--html) or as a picture (--png).

    A motion is certified first, and the page shows the result. With --q, --scene, --tool-of or --attached, the
    configuration is checked for collisions, and contacts are marked.

    Example: pinproof view ur5 --html ur5.html
    """
    check_output_files([html, png_options.png], [robot, motion, *setup.files])
    # Contradictions are refused before anything is loaded
    match = re.fullmatch(r"(\d{1,6})[xX](\d{1,6})", png_options.size.strip())
    if match is None:
        raise InputError(f"--size must be WIDTHxHEIGHT in pixels, such as 1280x800, not {png_options.size!r}")
    size = int(match[1]), int(match[2])
    if png_options.time is not None and png_options.png is None:
        raise InputError("--time needs --png; add --png FILE")
    if motion is not None and (q is not None or branches):
        option = "--branches" if q is None else "--q"
        raise InputError(f"{option} cannot be combined with the motion {motion}; remove one of them")
    arm, world = setup.arm(robot, motion), setup.world()
    content: dict[str, Any] = {"layers": tuple(layer or ()), "attached": setup.attachments.bodies}
    # A motion is certified; a configuration is checked if there is something to collide with.
    if motion is not None:
        content["checker"] = checker = setup.checker(arm, world)
        content["trajectory"] = trajectory = options.load_motion(motion, checker, ignore_record)
        with progress_status("certifying"):
            content["certificate"] = pp.certify(trajectory, checker)
    else:
        content["q"] = configuration = options.parse_configuration(q, arm, "--q")
        options.note_limits(arm, configuration)
        if q is not None or setup.surrounds:
            try:
                content["checker"] = checker = setup.checker(arm, world)
                content["check"] = checker.check(configuration)
            except MeshError as error:
                print_error(f"not checked for contacts: {error}")
        if branches:
            content["ghosts"] = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(configuration)).q
    if html is None and png_options.png is None:
        # Ctrl-C can arrive as soon as the URL is printed, so until_interrupted must be active before.
        with pp.show(arm, world, **content, port=port, open_browser=browser) as shown, until_interrupted():
            print_result({"url": shown.url}, [f"{shown.url} (Ctrl-C ends it)"], as_json=as_json)
            shown.wait()
        return
    with progress_status("writing"):
        if png_options.png is not None:  # first, because it fails without a browser: then no file is written
            pp.write_png(png_options.png, arm, world, **content, time=png_options.time, size=size)
        if html is not None:
            pp.write_html(html, arm, world, **content, live=live)
    files = {kind: str(path) for kind, path in (("page", html), ("picture", png_options.png)) if path is not None}
    print_result(files, written(*files.values()), as_json=as_json)
