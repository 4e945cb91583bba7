"""Benchmark of planning.

./scripts/benchmark planning                         our scenes; prints the table
./scripts/benchmark planning --mbm FOLDER            also MotionBenchMaker problems
./scripts/benchmark planning --mbm FOLDER --mplib PYTHON --tesseract PYTHON --docs
                                                     both, with planners in the environments of these Pythons, and
                                                     rewrites docs/benchmarks/planning.*
./scripts/benchmark planning --mbm FOLDER --set mbm/box --only ompl --docs
                                                     measures some rows again and keeps the others
./scripts/benchmark planning --mbm FOLDER --motion --docs   durations of motions to the goal poses

Our scenes take a minute with the other planners that are installed, MotionBenchMaker's problems some minutes. Exit
code 1 if the independent check finds a fault in one of our motions.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.planning_methods import OURS, PEERS, Stopwatch
from benchmarks.planning_problems import OWN_ROBOTS, PlanProblem, find_sets, read_problems, select_sets
from benchmarks.planning_run import KEYS, introduction, motion_faults, plan_benchmark, plan_tables, time_plot, total
from benchmarks.tables import Benchmark, Blocks, Results, Row, page_parser, provenance, quantiles, report, row_table
from benchmarks.worker_peers import mplib_method, tesseract_methods
from pinproof.collision import CollisionChecker
from pinproof.collision.checking.audit import STEP
from pinproof.errors import InputError, TimingError, UnknownNameError
from pinproof.ik import AnalyticIk
from pinproof.model import Arm, JointLimits, Payload, load_robot
from pinproof.motion import RateConstraint, TorqueLimits, Trajectory
from pinproof.planning import DEFAULT_PLANNER, RrtConnect, optimise, shortcut
from pinproof.spatial import SE3, Array, matrix

ACCELERATION, JERK = 15.0, 500.0
"""Limits of every joint in rad/s^2 and rad/s^3: those with which cuRobo publishes its durations."""

LOAD, LOAD_MASS = "3 kg", 3.0
"""The load at the tcp of the second run, in kg, and its name. Its torque limits are those of the robot description."""

IDENTIFIED = "panda"
"""The catalogue robot with masses and inertias identified on the real arm. The URDF of MotionBenchMaker's Panda states
the same 0.1 kg m^2 for each link, twenty times the real inertia of the last ones."""

SAME_POSE = 1e-6
"""Largest difference of the elements of two poses at which two descriptions have the same kinematics."""

PROMISING = 1.3
"""The path is planned to the goals at distances within this factor of the least, measured in time at full speed."""

GRID = 10_000
"""Number of times of each motion at which velocity, acceleration and jerk are compared with their limits."""

LIMIT_ROUNDING = 1e-9
"""Relative excess over a limit that is attributed to rounding."""

STEPS = ("goals", "plan", "optimise")


def pose_goals(checker: CollisionChecker, base_from_tcp: SE3, start: Array) -> Array:
    """(g, n) free IK solutions of a pose: all branches, for an arm of seven joints at many values of one joint."""
    q = AnalyticIk().solve_all_batch(checker.arm, matrix(base_from_tcp)[None], start).q[0]
    q = q[np.isfinite(q).all(axis=1)]
    return q[checker.is_free_batch(q)] if len(q) else q


def motion_benchmark(
    mbm: str | Path,
    *,
    robot: str | None = None,
    sets: Sequence[str] = (),
    problems: int | None = None,
    seed: int = 0,
    on_progress: Callable[[str], None] | None = None,
) -> Results:
    """Measure durations of motions to the goal poses of MotionBenchMaker problems.

    The arguments are as for :func:`benchmarks.planning_run.plan_benchmark`.
    """
    origin, found = provenance(seed), {each.full_set: each for each in find_sets(mbm, robot)}
    rows: list[Row] = []
    for name in select_sets(list(found), tuple(sets)):
        if on_progress is not None:
            on_progress(name)
        for problem in read_problems(found[name], problems):
            checker = CollisionChecker(problem.arm, problem.scene)
            meshes = CollisionChecker(problem.arm, problem.scene, link_meshes="surface")
            for variant, constraints in _variants(problem.arm).items():
                if not rows:  # loads compiled code
                    _solve(problem, checker, meshes, variant, constraints, seed)
                rows.append(_solve(problem, checker, meshes, variant, constraints, seed))
    settings = {
        "sets": list(sets),
        "problems": problems,
        "acceleration": ACCELERATION,
        "jerk": JERK,
        "audit_step": STEP,
        "grid": GRID,
    }
    return Results(settings, origin, {"rows": rows})


def _variants(arm: Arm) -> dict[str, tuple[RateConstraint, ...]]:
    """The loads of a run and their constraints; without torque limits of the robot only one without a load.

    The torques are those of the catalogue's arm with identified inertias, if it has the same joints and kinematics.
    """
    identified = arm
    with suppress(UnknownNameError):
        other, q = load_robot(IDENTIFIED).arm(tcp=arm.tcp), arm.limits.sampling_range()[0]
        if other.joint_names == arm.joint_names:
            difference = matrix(other.forward_kinematics(q)) - matrix(arm.forward_kinematics(q))
            identified = other if np.abs(difference).max() <= SAME_POSE else arm
    try:
        return {"": (), LOAD: (TorqueLimits(identified, Payload(LOAD_MASS), limits=arm.limits.torque),)}
    except InputError:
        return {"": ()}


def _solve(
    problem: PlanProblem,
    checker: CollisionChecker,
    meshes: CollisionChecker,
    variant: str,
    constraints: Sequence[RateConstraint],
    seed: int,
) -> Row:
    """Plan, optimise and check a motion.

    ``goals`` is the number of free IK solutions of the goal pose, and ``excess`` the largest relative excess over a
    limit on the grid, negative within the limits. ``before`` and ``lower_bound`` are durations (s): of the planned path
    with time-optimal timing, and of the fastest motion to one of the goals without obstacles.
    """
    arm, start = problem.arm, problem.start
    limits = replace(arm.limits, acceleration=np.full(arm.dof, ACCELERATION), acceleration_source="of the benchmark")
    watch = Stopwatch()
    unknown = dict.fromkeys(("duration", "excess", "before", "lower_bound"))

    def failed(message: str, goals: int) -> Row:
        row = {"certified": False, "faults": [], "wrong": [], "ms": watch.ms, "message": message, "goals": goals}
        return Row(**problem.origin, variant=variant, **row, **unknown)

    goals = pose_goals(checker, arm.forward_kinematics(problem.goals[0]), start)
    watch.lap("goals")
    if not len(goals):
        return failed("no free IK solution of the goal pose was found", goals=0)
    distances = np.abs(goals - start) / limits.velocity
    nearest = distances.max(axis=1) <= PROMISING * distances.max(axis=1).min()
    plan = RrtConnect().plan(checker, start, goals[nearest], rng=seed)
    if not plan.ok:
        return failed(plan.message, goals=len(goals))
    used = plan.checker or checker
    path = shortcut(plan.path, used, rng=seed)
    watch.lap("plan")
    try:
        result = optimise(path, used, limits=limits, jerk=JERK, goals=goals, rate_limits=constraints, rng=seed)
    except TimingError as error:
        return failed(str(error), goals=len(goals))
    watch.lap("optimise")
    excess = limit_excess(result.trajectory, limits, JERK)
    faults = motion_faults(result.trajectory, replace(problem, goals=goals), meshes)
    if excess > LIMIT_ROUNDING:
        faults = (*faults, f"exceeds a limit by a factor of {1.0 + excess:.12g}")
    return Row(
        **problem.origin,
        variant=variant,
        goals=len(goals),
        certified=result.certificate.free,
        faults=faults,
        wrong=[f"{problem.name}: {fault}" for fault in faults],
        excess=excess,
        duration=round(result.duration, 6),
        before=round(result.duration_before, 6),
        lower_bound=round(result.lower_bound, 6),
        ms={step: round(value, 4) for step, value in watch.ms.items()},
        message="" if result.certificate.free else result.certificate.message,
    )


def limit_excess(trajectory: Trajectory, limits: JointLimits, jerk: float) -> float:
    """The largest relative excess of velocity, acceleration and jerk on a grid of times; negative within the limits."""
    times = np.linspace(0.0, trajectory.duration, GRID)
    rates = (
        trajectory.velocity(times) / limits.velocity,
        trajectory.acceleration(times) / limits.acceleration,
        trajectory.jerk(times) / jerk,
    )
    return max(float(np.abs(rate).max()) for rate in rates) - 1.0


def motion_blocks(results: Results) -> Blocks:
    """A table for each load, with a row for each set."""
    columns = {
        "problems": "{.name}",
        "certified": lambda row: f"{sum(bool(each.certified) for each in row.all)} of {len(row.all)}",
        "unsafe": lambda row: str(sum(bool(each.faults) for each in row.all)),
        "duration, s: median / 98 %": lambda row: quantiles((r.duration for r in row.solved), "{:.3f}", (0.5, 0.98)),
        "before, s": lambda row: quantiles((r.before for r in row.solved), "{:.3f}"),
        "lower bound, s": lambda row: quantiles((r.lower_bound for r in row.solved), "{:.3f}"),
        "ratio": lambda row: quantiles((r.duration / r.lower_bound for r in row.solved), "{:.3f}"),
        "time, ms: median / 95 %": lambda row: quantiles(map(total, row.solved), "{:.1f}", (0.5, 0.95)),
        **{s: lambda row, s=s: quantiles((r.ms[s] for r in row.solved), "{:.1f}") for s in STEPS},
        "largest excess": lambda row: quantiles((r.excess for r in row.solved), "{:.1g}", (1.0,)),
    }
    blocks = {}
    for variant in dict.fromkeys(row.variant for row in results["rows"]):
        rows = [row for row in results["rows"] if row.variant == variant]
        sets = {"all sets": rows} | {
            name: [row for row in rows if row.set_name == name] for name in dict.fromkeys(row.set_name for row in rows)
        }
        groups = [
            Row(name=name, all=group, solved=[row for row in group if row.duration is not None])
            for name, group in sets.items()
        ]
        blocks[f"load {variant}" if variant else "no load"] = row_table(columns, groups)
    return blocks


def plan_blocks(results: Results) -> Blocks:
    """The tables of the planners."""
    return {"introduction": introduction(results), "results": plan_tables(results)}


def arguments_of(options: argparse.Namespace) -> dict[str, Any]:
    """The arguments that both benchmarks have."""
    names = {"robot": "robot", "set": "sets", "problems": "problems", "seed": "seed"}
    return {name: getattr(options, option) for option, name in names.items()} | {"on_progress": report}


def measure(options: argparse.Namespace) -> Results:
    """Measure the planners."""
    peers = () if options.no_peers else PEERS
    peers += tuple(map(mplib_method, options.mplib))
    peers += tuple(method for python in options.tesseract for method in tesseract_methods(python))
    planners = options.planner or (DEFAULT_PLANNER,)
    if options.only:
        known = (OURS, *(peer.key for peer in peers))
        if unknown := set(options.only) - set(known):
            raise SystemExit(f"--only {' '.join(sorted(unknown))}: the methods of this run are {', '.join(known)}")
        peers = tuple(peer for peer in peers if peer.key in options.only)
        planners = planners if OURS in options.only else ()
    more = {"repeats": options.repeats, "peers": peers, "planners": planners}
    return plan_benchmark(options.robots or OWN_ROBOTS, mbm=options.mbm, **more, **arguments_of(options))


def measure_motions(options: argparse.Namespace) -> Results:
    """Measure the durations of motions."""
    if options.mbm is None:
        raise SystemExit("--motion needs --mbm")
    return motion_benchmark(options.mbm, **arguments_of(options))


BENCHMARK = Benchmark("planning", measure, plan_blocks, lambda results: {"planning.png": time_plot(results)}, KEYS)
MOTION = Benchmark("motion", measure_motions, motion_blocks, page="planning")


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = page_parser(__doc__, "planning")
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help="arms in our scenes")
    parser.add_argument("--mbm", type=Path, metavar="FOLDER", help="MotionBenchMaker problems")
    parser.add_argument("--robot", help="the robot of these problems")
    parser.add_argument("--set", action="append", default=[], metavar="NAME", help="only these: shelf, ur5, mbm, ...")
    parser.add_argument("--problems", type=int, metavar="N", help="largest number of problems per set")
    parser.add_argument("--repeats", type=int, default=1, help="runs per problem; the fastest counts")
    parser.add_argument("--planner", action="append", metavar="MODULE:CLASS", help="used instead of ours")
    parser.add_argument("--only", action="append", default=[], metavar="METHOD", help="only these: pinproof, ompl, ...")
    parser.add_argument("--no-peers", action="store_true", help="leave out other planners")
    for name, peer in (("mplib", "MPlib"), ("tesseract", "Tesseract")):
        about = f"a Python with {peer}, to include it"
        parser.add_argument(f"--{name}", action="append", default=[], metavar="PYTHON", help=about)
    parser.add_argument("--motion", action="store_true", help="durations of motions to the goal poses of --mbm")
    (MOTION if "--motion" in sys.argv else BENCHMARK).run(parser)
