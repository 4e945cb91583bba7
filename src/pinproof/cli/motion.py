"""``pinproof check`` and ``pinproof plan``: check a configuration and plan a motion."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Literal

import pinproof as pp
from pinproof.cli.console import check_output_files, print_result, progress_status, written
from pinproof.cli.options import (
    Configuration,
    ConstraintOptions,
    Html,
    Json,
    RateOptions,
    Robot,
    Seed,
    SetupOptions,
    option,
    parse_configuration,
)
from pinproof.errors import InputError


def check(
    robot: Robot,
    q: Configuration = None,
    *,
    setup: SetupOptions,
    as_json: Json = False,
) -> None:
    """Check a configuration for joint limits and collisions.

    Exit code 1 if it violates a limit or collides.

    Example: pinproof check ur5 --q home --scene robots/ur5/scene.yaml
    """
    arm = setup.arm(robot)
    checker = setup.checker(arm)
    configuration = arm.limits.snap(parse_configuration(q, arm, "--q"))
    outside = arm.limits.violations(configuration, arm.joint_names)
    result, clearance = checker.check(configuration), checker.clearance(configuration)
    ok = result.free and not outside
    contacts = [{"bodies": c.bodies, "distance": c.distance, "points": c.points.tolist()} for c in result.contacts]
    data = {"ok": ok, "outside_limits": outside, "contacts": contacts, "clearance": clearance}
    pairs = f"clearance {clearance * 1e3:.1f} mm over {len(checker.pairs)} body pairs"
    lines = [*outside, *map(str, result.contacts)]
    lines.append(f"{'free' if ok else 'not free'}: {pairs if checker.pairs else 'no pair of bodies is checked'}")
    assumptions = pp.collision.notes_of(checker)
    notes = filter(None, [*assumptions, pp.collision.overlap_hint(checker, configuration, result)])
    lines += [f"note: {note}" for note in notes]
    data |= {"pairs": len(checker.pairs), "notes": assumptions}
    print_result(data, lines, as_json=as_json, ok=ok)


@dataclass(frozen=True)
class PlanOptions:
    """How the motion is found."""

    blend: bool = option("Round the corners of the path; with --no-blend the arm stops at each corner.", True)
    planner: str = option(
        "The planner: rrt_connect, or MODULE:CLASS for a class with the methods of pinproof.planning.Planner.",
        "rrt_connect",
        metavar="PLANNER",
    )
    jerk: str | None = option(
        "Jerk limit of every joint in rad/s^3 or m/s^3, or the word limits for the jerk limits in the file of "
        "--limits. Default: no jerk limit.",
        None,
        metavar="NUMBER|limits",
    )
    optimise: int = option(
        "How many changes of the motion are tried to reduce its duration. With 0, the shortened path is only timed.",
        600,
        min=0,
    )


def plan(
    robot: Robot,
    goal: str = option("Goal joint values in rad or m, or home.", MISSING, metavar="VALUES"),
    start: str | None = option("Start joint values in rad or m. Default: home.", None, metavar="VALUES"),
    output: Path | None = option("The motion file to write (.json, .csv).", None, "-o", "--output"),
    *,
    effort: PlanOptions,
    html: Html = None,
    seed: Seed = 0,
    upright: ConstraintOptions,
    rates: RateOptions,
    setup: SetupOptions,
    as_json: Json = False,
) -> None:
    """Plan, shorten, time and certify a motion between two configurations.

    Exit code 1 if no collision-free motion is found and proven.

    Example: pinproof plan ur5 --goal "1 -1.2 1.2 -1.57 -1.57 0" --scene robots/ur5/scene.yaml -o motion.json
    """
    check_output_files([output, html], [robot, *setup.files])
    jerk: float | Literal["limits"] | None = None  # "limits" selects the jerk limits of the arm
    if effort.jerk is not None:
        try:
            jerk = "limits" if effort.jerk == "limits" else float(effort.jerk)
        except ValueError:
            raise InputError(f"--jerk must be a number or the word limits, not {effort.jerk!r}") from None
    # The arm in its scene with its tool, and what the motion must keep to.
    search = pp.planning.make_planner(effort.planner)
    arm = setup.arm(robot)
    limits, torque = rates.limits(arm)
    world = setup.world()
    checker = setup.checker(arm, world)
    ends = (parse_configuration(start, arm, "--start"), parse_configuration(goal, arm, "--goal"))
    constraints = upright.constraints(arm, ends[0])
    # A path is found, then shortened and rounded, then timed and made as short as the limits allow.
    with progress_status("planning"):
        planned = search.plan(checker, *ends, constraints=constraints, torque_limits=torque, rng=seed)
        if not planned.ok:
            data = {"ok": False, "status": planned.status.name, "message": planned.message}
            print_result(data, [planned.message], as_json=as_json, ok=False)
            return
        checker = planned.checker  # has tighter bodies if an end was in collision only with coarse ones
        simplified = pp.simplify(
            planned.path,
            checker,
            rng=seed,
            blend=effort.blend,
            constraints=constraints,
            torque_limits=torque,
            certificate=planned.certificate,
        )
        shortest = pp.optimise(
            simplified.path,
            checker,
            limits=arm.limits,
            jerk=jerk,
            rate_limits=limits,
            constraints=constraints,
            rng=seed,
            budget=effort.optimise,
        )
    # Files before the answer, so that "wrote" is true.
    trajectory, certificate = shortest.trajectory, shortest.certificate
    if output is not None:
        trajectory.save(output, certificate=certificate)
    if html is not None:
        drawn = pp.viewer.PlotLimits(arm.limits, arm.limits.jerk if jerk == "limits" else jerk, limits)
        pp.write_html(html, arm, world, trajectory, certificate=certificate, attached=checker.attached, plot=drawn)

    # The figures of the path, and what the optimisation gained.
    length, stops, before, after = simplified.path.length, simplified.stops, shortest.duration_before, shortest.duration
    figures = {"stops": stops, "length": length, "duration_of_path": before, "duration": after}
    figures["lower_bound"] = shortest.lower_bound
    summary = f"path of length {length:.3g} rad, {stops} intermediate stop{'' if stops == 1 else 's'}, {before:.2f} s"
    summary += f"; optimised motion {after:.2f} s" if effort.optimise else ""
    summary += f", lower bound without obstacles {shortest.lower_bound:.2f} s ({trajectory.limits_note})"
    largest, notes, torques = rates.report(torque, trajectory)
    lines = [summary, *largest, str(certificate), *notes, *written(output, html)]
    data = {"ok": certificate.free, **figures, **torques, **certificate.to_dict()}
    print_result(data, lines, as_json=as_json, ok=certificate.free)
