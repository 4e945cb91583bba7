"""``pinproof check`` and ``pinproof plan``: check a configuration and plan a motion."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Any, Literal

import pinproof as pp
from pinproof.cli.certify import largest_torque, torque_figures, verdict
from pinproof.cli.console import check_output_files, print_result, progress_status, written
from pinproof.cli.options import (
    ChainOptions,
    Configuration,
    ConstraintOptions,
    Html,
    Json,
    RateOptions,
    Robot,
    SceneOptions,
    Seed,
    ToolOptions,
    option,
    parse_configuration,
)
from pinproof.errors import InputError


def check(
    robot: Robot,
    q: Configuration = None,
    *,
    chain: ChainOptions,
    scene_options: SceneOptions,
    tool: ToolOptions,
    as_json: Json = False,
) -> None:
    """Check a configuration for joint limits and collisions.

    Exit code 1 if it violates a limit or collides.

    Example: pinproof check ur5 --q home --scene robots/ur5/scene.yaml
    """
    from pinproof.collision.certificates.identity import notes_of
    from pinproof.collision.checking.checker import overlap_hint

    arm = chain.arm(robot, tool=tool)
    checker = scene_options.checker(arm, tool=tool)
    configuration = arm.limits.snap(parse_configuration(q, arm, "--q"))
    outside = arm.limits.violations(configuration, arm.joint_names)
    result, clearance = checker.check(configuration), checker.clearance(configuration)
    ok = result.free and not outside
    contacts = [{"bodies": c.bodies, "distance": c.distance, "points": c.points.tolist()} for c in result.contacts]
    data = {"ok": ok, "outside_limits": outside, "contacts": contacts, "clearance": clearance}
    pairs = f"clearance {clearance * 1e3:.1f} mm over {len(checker.pairs)} body pairs"
    lines = [*outside, *map(str, result.contacts)]
    lines.append(f"{'free' if ok else 'not free'}: {pairs if checker.pairs else 'no pair of bodies is checked'}")
    notes = filter(None, [*notes_of(checker), overlap_hint(checker, configuration, result)])
    lines += [f"note: {note}" for note in notes]
    data |= {"pairs": len(checker.pairs), "notes": notes_of(checker)}
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

    def found_jerk(self) -> float | Literal["limits"] | None:
        """The jerk limit; ``"limits"`` selects the jerk limits of the arm."""
        if self.jerk is None or self.jerk == "limits":
            return None if self.jerk is None else "limits"
        try:
            return float(self.jerk)
        except ValueError:
            raise InputError(f"--jerk must be a number or the word limits, not {self.jerk!r}") from None


def plan(
    robot: Robot,
    goal: str = option("Goal joint values in rad or m, or home.", MISSING, metavar="VALUES"),
    start: str | None = option("Start joint values in rad or m. Default: home.", None, metavar="VALUES"),
    output: Path | None = option("The motion file to write (.json, .csv).", None, "-o", "--output"),
    *,
    effort: PlanOptions,
    html: Html = None,
    seed: Seed = 0,
    constraint_options: ConstraintOptions,
    rates: RateOptions,
    chain: ChainOptions,
    scene_options: SceneOptions,
    tool: ToolOptions,
    as_json: Json = False,
) -> None:
    """Plan, shorten, time and certify a motion between two configurations.

    Exit code 1 if no collision-free motion is found and proven.

    Example: pinproof plan ur5 --goal "1 -1.2 1.2 -1.57 -1.57 0" --scene robots/ur5/scene.yaml -o motion.json
    """
    check_output_files([output, html], [robot, *scene_options.files, *chain.files, *tool.files])
    jerk = effort.found_jerk()
    search = pp.planning.make_planner(effort.planner)
    arm = chain.arm(robot, tool)
    rate_limits = rates.limits(arm)
    world = scene_options.load()
    checker = scene_options.checker(arm, world, tool)
    ends = (parse_configuration(start, arm, "--start"), parse_configuration(goal, arm, "--goal"))
    kept = constraint_options.constraints(arm, ends[0])
    with progress_status("planning"):
        heavy = rates.torque_limits(arm)
        result = search.plan(checker, *ends, constraints=kept, torque_limits=heavy, rng=seed)
        if not result.ok:
            data = {"ok": False, "status": result.status.name, "message": result.message}
            print_result(data, [result.message], as_json=as_json, ok=False)
            return
        checker = result.checker  # has tighter bodies if an end was in collision only with coarse ones
        simplified = pp.simplify(
            result.path,
            checker,
            rng=seed,
            blend=effort.blend,
            constraints=kept,
            torque_limits=heavy,
            certificate=result.certificate,
        )
        path = simplified.path
        shortest = pp.optimise(
            path,
            checker,
            limits=arm.limits,
            jerk=jerk,
            rate_limits=rate_limits,
            constraints=kept,
            rng=seed,
            budget=effort.optimise,
        )
        trajectory, certificate = shortest.trajectory, shortest.certificate
    torques, torque_notes = rates.peaks(arm, trajectory), rates.notes(arm)
    if output is not None:
        trajectory.save(output, certificate=certificate)
    if html is not None:
        drawn = pp.viewer.PlotLimits(arm.limits, arm.limits.jerk if jerk == "limits" else jerk, rate_limits)
        pp.write_html(html, arm, world, trajectory, certificate=certificate, attached=checker.attached, plot=drawn)
    figures, summary = _figures(simplified, shortest, optimised=effort.optimise > 0)
    data = {"ok": certificate.free, **figures, **torque_figures(torques, torque_notes), **verdict(certificate)}
    lines = [
        summary,
        *largest_torque(torques),
        str(certificate),
        *(f"note: {note}" for note in torque_notes),
        *written(output, html),
    ]
    print_result(data, lines, as_json=as_json, ok=certificate.free)


def _figures(
    simplified: pp.planning.SimplifyResult, shortest: pp.planning.OptimiseResult, *, optimised: bool
) -> tuple[dict[str, Any], str]:
    """The stops, the length and the durations (s) of a planned motion, and the same as a line of text."""
    length = simplified.path.length
    figures = {
        "stops": simplified.stops,
        "length": length,
        "duration_of_path": shortest.duration_before,
        "duration": shortest.duration,
        "lower_bound": shortest.lower_bound,
    }
    stops = f"{simplified.stops} intermediate stop{'' if simplified.stops == 1 else 's'}"
    then = f"; optimised motion {shortest.duration:.2f} s" if optimised else ""
    bound = f"lower bound without obstacles {shortest.lower_bound:.2f} s ({shortest.trajectory.limits_note})"
    return figures, f"path of length {length:.3g} rad, {stops}, {shortest.duration_before:.2f} s{then}, {bound}"
