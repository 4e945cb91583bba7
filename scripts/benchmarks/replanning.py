"""Benchmark of replanning: motions of the Panda in MotionBenchMaker's scenes, on whose path an obstacle appears.

./scripts/benchmark replanning --mbm FOLDER              outcomes, durations and processor times
./scripts/benchmark replanning --mbm FOLDER --runs 0     without processor times
./scripts/benchmark replanning --mbm FOLDER --docs       rewrites docs/benchmarks/replanning.*

It takes a minute. Exit code 1 if a motion exceeds a limit, is not continuous, or is in contact by dense samples.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

import pinproof as pp
from benchmarks.planning_problems import PlanProblem, find_sets, read_problems
from benchmarks.tables import (
    Benchmark,
    Blocks,
    Results,
    Row,
    fastest,
    page_parser,
    provenance,
    quantiles,
    report,
    row_table,
)
from pinproof.motion import Bounds, Steering
from pinproof.planning import Replan, ReplanStatus
from pinproof.planning.replanning import RAMP

VARIANTS = {"no jerk limit": None, "jerk limits": 0.1}
"""The limits of the jerk: None, or the time (s) in which an acceleration reaches its limit."""

NOW, RADII, BESIDE = (0.1, 0.6), (0.04, 0.08), 0.03
"""Shares of the duration at which a ball appears, its radius (m), and the standard deviation of its distance (m) from a
later place of the tool."""

DRAWS = 300
"""Random balls until one blocks the rest of the motion, but not the arm and the end of its motion."""

STEP, AUDIT_STEP, ROUNDING = 2e-4, 0.01, 2e-15
"""Seconds between samples of a motion, rad between samples that coal checks, and rounding error of a position."""


def with_obstacle(
    problem: PlanProblem, motion: pp.MotionPlan, rng: np.random.Generator
) -> tuple[float, pp.Obstacle, float] | None:
    """A time, a ball that then appears on the path of the motion, and the seconds until contact; None without one."""
    running, checker = motion.trajectory, motion.checker
    for _ in range(DRAWS):
        now = float(rng.uniform(*NOW) * running.duration)
        place = checker.arm.forward_kinematics(running(float(rng.uniform(now, running.duration)))).translation
        ball = pp.Sphere(float(rng.uniform(*RADII)))
        appeared = pp.Obstacle("appeared", ball, pp.pose(place + BESIDE * rng.normal(size=3)))
        after = checker.with_scene(problem.scene.add(appeared))
        if after.is_free(running(now)) and after.is_free(running.end):
            contact = pp.certify(running.after(now), after).first_contact
            if contact is not None:
                return now, appeared, contact.time
    return None


def faults_of(running: pp.Trajectory, result: Replan, bounds: Bounds) -> Iterator[str]:
    """What is wrong with a new motion, by differences of positions from before its beginning on, and by coal."""
    if vars(result)["trajectory"] is None:
        yield f"no stop: {result.message}"
        return
    motion, begin = result.trajectory, result.takeover
    # A motion without a jerk limit may jump at its points, so that only its last piece before the new motion counts.
    known = running.times[running.times <= begin + 1e-9][-1 if running.interpolant == "cubic" else 0]
    before = STEP * np.arange(1, min(int((begin - known) / STEP), 40))[::-1]
    q = np.concatenate([running(begin - before), motion(np.arange(0.0, motion.duration, STEP))])
    for order, (name, limit) in enumerate(
        (("velocity", bounds.velocity), ("acceleration", bounds.acceleration), ("jerk", np.asarray(bounds.jerk))), 1
    ):
        rates = np.abs(np.diff(q, order, axis=0)) / STEP**order
        if (rates > (1.0 + 1e-6) * limit + ROUNDING * (2.0 / STEP) ** order).any():
            yield f"the {name} exceeds its limit by a factor of {float((rates / limit).max()):.4g}"
    if (q < bounds.lower - 1e-9).any() or (q > bounds.upper + 1e-9).any():
        yield "a joint leaves its limits"
    if result.proven and not (found := pp.audit(motion, result.checker, step=AUDIT_STEP, measure=False)).clean:
        yield found.message


def measure_case(problem: PlanProblem, variant: str, seed: int, runs: int) -> Row | None:
    """Replan one motion; None without a motion or an obstacle on its path."""
    limits = problem.group.limits
    ramp = VARIANTS[variant]
    jerk = None if ramp is None else limits.acceleration / ramp
    motion = pp.plan(
        pp.CollisionChecker(problem.group, problem.scene), problem.start, problem.goals, jerk=jerk, rng=seed
    )
    case = with_obstacle(problem, motion, np.random.default_rng([seed, problem.number])) if motion.ok else None
    if case is None:
        return None
    now, appeared, contact = case
    running, scene = motion.trajectory, problem.scene.add(appeared)
    settings = {"goals": problem.goals, "jerk": jerk, "rng": seed}
    found: list[Replan] = []

    def replan(checker: pp.CollisionChecker) -> None:
        found[:] = [pp.replan(running, checker, running(now), now, **settings)]

    # Every run has a checker of its own, because a checker remembers what it has computed.
    checkers = [motion.checker.with_scene(scene) for _ in range(max(runs, 1))]
    times = [fastest(lambda c=checker: replan(c), 1) for checker in checkers]
    result = found[0]
    bounds = Bounds.of(limits, problem.group.joint_names, limits.acceleration / RAMP if jerk is None else jerk)
    first = tuple(rate(now).tolist() for rate in (running, running.velocity, running.acceleration))
    stop = Steering(bounds, moving=first).stop(first)
    return Row(
        variant=variant,
        set=problem.set_name,
        number=problem.number,
        status=result.status.name,
        contact=contact,
        stop=None if stop is None else stop.duration,
        remaining=running.duration - now,
        duration=result.trajectory.duration if result.ok else None,
        wait=result.takeover - now,
        cpu=min(times) if runs else None,
        scene=fastest(lambda: motion.checker.with_scene(scene), runs) if runs else None,
        wrong=[f"{problem.set_name} {problem.number}: {fault}" for fault in faults_of(running, result, bounds)],
    )


def table(rows: Sequence[Row], groups: Sequence[tuple[str, Sequence[Row]]]) -> list[str]:
    """One line for each group of rows, and one for all."""

    def count(status: ReplanStatus) -> str:
        return "{0.counts[" + status.name + "]}"

    def summary(name: str, own: Sequence[Row]) -> Row:
        counts = {status.name: sum(row.status == status.name for row in own) for status in ReplanStatus}
        ratios = [row.duration / row.remaining for row in own if row.duration is not None]
        return Row(name=name, rows=own, counts=counts, ratios=ratios)

    columns = {
        "": "{.name}",
        "motions": lambda row: str(len(row.rows)),
        "changed": count(ReplanStatus.CHANGED),
        "with a stop": count(ReplanStatus.CHANGED_WITH_STOP),
        "stop": count(ReplanStatus.STOP),
        "unproven": count(ReplanStatus.UNPROVEN_STOP),
        "duration": lambda row: quantiles(row.ratios, "{:.2f}", (0.5, 0.95)),
        "replan": lambda row: quantiles([each.cpu for each in row.rows], "{:.1f}", (0.5, 0.95, 1.0), 1e3),
        "scene": lambda row: quantiles([each.scene for each in row.rows], "{:.2f}", (0.5, 0.95), 1e3),
        "wrong": lambda row: str(sum(len(each.wrong) for each in row.rows)),
    }
    return row_table(columns, [summary(name, own) for name, own in (*groups, ("all", rows)) if own])


def blocks(results: Results) -> Blocks:
    """The tables of the page."""
    found: dict[str, list[str]] = {}
    for variant in VARIANTS:
        rows = [row for row in results["rows"] if row.variant == variant]
        sets = [(name, [row for row in rows if row.set == name]) for name in dict.fromkeys(row.set for row in rows)]
        found[variant] = table(rows, sets)
    rows = [row for row in results["rows"] if row.stop is not None]
    spans = ((0.0, 0.25), (0.25, 0.5), (0.5, 1.0), (1.0, np.inf))
    found["time to contact"] = table(
        rows,
        [
            (
                f"{low:g} to {high:g}" if np.isfinite(high) else f"above {low:g}",
                [row for row in rows if low <= row.contact / row.stop < high],
            )
            for low, high in spans
        ],
    )
    return found


def measure(options: argparse.Namespace) -> Results:
    """Measure all sets."""
    if options.mbm is None:
        raise SystemExit("--mbm is required")
    settings = {"problems": options.problems, "runs": options.runs}
    results = Results(settings, provenance(options.seed), {"rows": []})
    for each in find_sets(options.mbm):
        for variant in VARIANTS:
            problems = read_problems(each, options.problems)
            rows = [measure_case(problem, variant, options.seed, options.runs) for problem in problems]
            results["rows"].extend(row for row in rows if row is not None)
            report(f"{each.name}, {variant}: {len(rows)} problems")
    return results


BENCHMARK = Benchmark("replanning", measure, blocks)


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = page_parser(__doc__, "replanning")
    parser.add_argument("--mbm", type=Path, metavar="FOLDER", help="MotionBenchMaker problems of the Panda")
    parser.add_argument("--problems", type=int, default=20, metavar="N", help="problems per set")
    parser.add_argument(
        "--runs", type=int, default=3, metavar="N", help="runs of which the fastest counts; 0: not timed"
    )
    BENCHMARK.run(parser)
