"""Benchmark of inverse kinematics.

./scripts/benchmark ik ur5 panda --points 10000    prints the table; 30 s per robot
./scripts/benchmark ik --success 100000            prints success rates and batch times on every arm; a minute
./scripts/benchmark ik --scenes FOLDER             collision-free IK in the scenes of MotionBenchMaker problems
./scripts/benchmark ik --docs                      runs the first two and rewrites docs/benchmarks/ik.*

Other libraries that are installed take most of the time.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from benchmarks.ik_methods import OWN_METHODS, Part, select_methods
from benchmarks.ik_run import (
    WARM_UP,
    check_answers,
    ik_benchmark,
    ik_tables,
    latency_plot,
    load_arm,
    percent,
    random_targets,
    timed_batch,
)
from benchmarks.ik_steps import step_plot, step_sizes
from benchmarks.planning_problems import find_sets, read_problems
from benchmarks.tables import (
    Benchmark,
    Blocks,
    NotApplicableError,
    Results,
    Row,
    page_parser,
    provenance,
    quantiles,
    report,
    row_table,
)
from pinproof import Clik, CollisionChecker, load_robot
from pinproof.description import catalogue_names
from pinproof.errors import PinproofError
from pinproof.ik.result import difference
from pinproof.model import Arm
from pinproof.spatial import Array

METHODS = ("clik", "analytic")

REPEATS = 3
"""Batches timed for the success rates; the fastest counts, since other processes can only make one slower."""

SAME_CONFIGURATION = 1e-4
"""Rad or m below which an answer equals the configuration that generated the target. At a singular target, a pose error
of 1e-9, the tolerance of the closed form, corresponds to joint errors of its square root, 3e-5."""


def success_rates(
    robots: Sequence[str] | None = None,
    *,
    samples: int = 100_000,
    methods: Sequence[str] = METHODS,
    limits_pi: bool = True,
    seed: int = 0,
) -> list[Row]:
    """Measure success and batch times (us per target) of many random poses, by default on every arm of the catalogue.

    Methods that do not apply to an arm have no row. ``recovered`` is the share of targets for which the configuration
    that generated them is among the answers (up to full rotations), for a method that returns all branches.
    """
    rows = []
    for name in robots or catalogue_names():
        arm = load_arm(name, limits_pi)
        targets = random_targets(arm, samples, seed)
        for method in select_methods(methods, OWN_METHODS):
            report(f"{name}: {method.label}, {samples} targets")
            try:
                prepared = method.prepare(arm, Part("random", "pose", True))
            except (NotApplicableError, PinproofError):
                continue
            if prepared.solve_batch is None:
                continue
            prepared.solve_batch(targets.poses[:WARM_UP], targets.start)
            runs = [timed_batch(prepared.solve_batch, targets.poses, targets.start) for _ in range(REPEATS)]
            answers, fastest = runs[-1][0], min(nanoseconds for _, nanoseconds in runs)
            checked = check_answers(arm, targets.poses, answers, "pose", method.tolerance)
            rows.append(
                Row(
                    robot=name,
                    method=method.key,
                    label=method.label,
                    samples=samples,
                    success=checked.success,
                    false_positives=checked.false_positives,
                    batch_us=fastest / 1e3 / samples,
                    recovered=_recovered(arm, answers, targets.q) if answers.shape[1] > 1 else None,
                )
            )
    return rows


def _recovered(arm: Arm, answers: Array, q: Array) -> float:
    distance = np.abs(difference(arm, answers, q[:, None])).max(axis=2)
    nearest = np.where(np.isnan(distance), np.inf, distance).min(axis=1)
    return float((nearest <= SAME_CONFIGURATION).mean())


SCENE_POSES, DRAWN = 100, 2_000
"""Poses in each scene, and random configurations of which the first free ones have these poses."""


SCENE_RESTARTS = 200
"""Restarts of a pose; 50, the default, leave 5 of 14,000 poses unsolved."""


def scene_rows(mbm: str | Path, seed: int) -> list[Row]:
    """Collision-free IK: one batch of poses in each scene of MotionBenchMaker problems, and the goals of the problems.

    The poses are those of random free configurations. ``wrong`` has answers outside the limits, off the pose by
    Pinocchio's forward kinematics, or in contact by Pinocchio and coal.
    """
    rows = []
    for found in find_sets(mbm):
        report(found.full_set)
        for problem in read_problems(found):
            arm, checker, wrong = problem.arm, CollisionChecker(problem.arm, problem.scene), []
            rng = np.random.default_rng([seed, problem.number])
            q = rng.uniform(*arm.limits.sampling_range(), (DRAWN, arm.dof))
            poses = arm.forward_kinematics_batch(q[checker.is_free_batch(q)][:SCENE_POSES])
            solver, times = Clik(restarts=SCENE_RESTARTS), []
            for _ in range(REPEATS):
                begin = process_time()
                answer = solver.solve_batch(arm, poses, accept=checker.is_free)
                times.append(1e3 * (process_time() - begin))
            for pose, solution in zip(poses[answer.ok], answer.q[answer.ok], strict=True):
                off = np.abs(arm.forward_kinematics(solution).homogeneous - pose).max()
                if off > POSE_TOLERANCE or not arm.limits.contains(solution) or checker.check(solution).contacts:
                    wrong.append(f"{problem.name}: an answer is off by {off:.1g}, outside the limits or in contact")
            goals = solver.solve_batch(arm, arm.forward_kinematics_batch(problem.goals), accept=checker.is_free)
            counts = {"poses": len(poses), "solved": int(answer.ok.sum()), "goals": int(goals.ok.sum())}
            rows.append(Row(set_name=found.name, number=problem.number, ms=min(times), wrong=wrong, **counts))
    return rows


POSE_TOLERANCE = 2e-6
"""Largest difference of the elements of two poses: 1e-6 m and rad are the tolerances of the solver."""


def scene_table(rows: Sequence[Row]) -> list[str]:
    """A line for each set and one for all."""
    names = {"all": list(rows)} | {
        name: [row for row in rows if row.set_name == name] for name in dict.fromkeys(row.set_name for row in rows)
    }
    columns = {
        "scenes": lambda row: f"{row.name} ({len(row.all)})",
        "poses solved": lambda row: f"{sum(r.solved for r in row.all):,} of {sum(r.poses for r in row.all):,}",
        "ms per 100 poses: mean": lambda row: f"{np.mean([100 * r.ms / r.poses for r in row.all]):.3f}",
        "median / largest": lambda row: quantiles((100 * r.ms / r.poses for r in row.all), "{:.3f}", (0.5, 1.0)),
        "goals solved": lambda row: f"{sum(r.goals for r in row.all)} of {len(row.all)}",
        "wrong": lambda row: str(sum(len(r.wrong) for r in row.all)),
    }
    return row_table(columns, [Row(name=name, all=group) for name, group in names.items()]) if rows else []


DOCS_ROBOTS = ("ur5", "panda", "puma560", "xarm6", "crx10ia")

SAMPLES = 100_000
"""Targets per arm of the success rates in the manual."""


def measure(options: argparse.Namespace) -> Results:
    """Measure the methods, the success rates, or both for the manual; or the scenes."""
    if options.scenes is not None:
        return Results({}, provenance(options.seed), {"scenes": scene_rows(options.scenes, options.seed)})
    common = {"limits_pi": not options.own_limits, "seed": options.seed}
    robots = () if options.success else options.robots or (DOCS_ROBOTS if options.docs else ("ur5",))
    results = ik_benchmark(robots, points=options.points, peers=not options.no_peers, **common, on_progress=report)
    samples = options.success or (SAMPLES if options.docs else 0)
    results.parts["success"] = success_rates(options.robots or None, samples=samples, **common) if samples else []
    return results


def blocks(results: Results) -> Blocks:
    """The tables of the page."""
    columns = {
        "arm": "{.robot}",
        "method": "{.label}",
        "success": lambda row: percent(row.success),
        "false positives": "{.false_positives}",
        "batch mean, us": "{.batch_us:.2f}",
        "recovered": lambda row: percent(row.recovered),
    }
    return {
        "methods": ik_tables(results) if results["rows"] else [],
        "scenes": scene_table(results["scenes"]),
        "success": row_table(columns, results["success"], text_columns=2),
    }


def figures(results: Results) -> dict[str, Any]:
    """The plots of the page: success against time, and the steps near a singularity."""
    plots, steps = {"ik_latency.png": latency_plot(results)}, step_sizes(load_robot(DOCS_ROBOTS[0]).arm())
    return plots if steps is None else {**plots, "ik_steps.png": step_plot(steps, DOCS_ROBOTS[0])}


BENCHMARK = Benchmark("ik", measure, blocks, figures)


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = page_parser(__doc__, "ik")
    parser.add_argument("robots", nargs="*", metavar="ROBOT")
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument("--success", type=int, metavar="SAMPLES", help="success rates only; targets per arm")
    parser.add_argument("--scenes", type=Path, metavar="FOLDER", help="MotionBenchMaker problems: their scenes only")
    parser.add_argument("--no-peers", action="store_true", help="leave out other libraries")
    parser.add_argument("--own-limits", action="store_true", help="keep ranges wider than one full rotation")
    BENCHMARK.run(parser)
