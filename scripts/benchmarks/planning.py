"""Benchmark of planning.

./scripts/benchmark planning                         our scenes; prints the table
./scripts/benchmark planning --mbm FOLDER            also MotionBenchMaker problems
./scripts/benchmark planning --mbm FOLDER --mplib PYTHON --docs   both, with MPlib in the environment of that
                                                             Python, and rewrites docs/benchmarks/planning.*
./scripts/benchmark planning --mbm FOLDER --motion --docs   durations of motions to the goal poses
./scripts/benchmark planning --render                rewrites the page and the plot from planning.json

Our scenes take a minute with the other planners that are installed, MotionBenchMaker's problems some minutes. Exit
code 1 if the independent check finds a fault in one of our motions.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import process_time_ns
from typing import ClassVar

import numpy as np

from benchmarks.mplib_peer import mplib_method
from benchmarks.planning_methods import PEERS, Stopwatch
from benchmarks.planning_problems import OWN_ROBOTS, PlanProblem, find_sets, read_problems, select_sets
from benchmarks.planning_run import (
    CheckedRow,
    PlanTable,
    motion_faults,
    plan_benchmark,
    plan_markdown,
    write_plan_table,
)
from benchmarks.tables import (
    FOLDER,
    BenchmarkTable,
    markdown_table,
    page_parser,
    provenance,
    provenance_text,
    quantiles,
    report,
    run,
    wrapped,
)
from pinproof.collision import CollisionChecker
from pinproof.collision.checking.audit import STEP
from pinproof.errors import InputError, TimingError, UnknownNameError
from pinproof.ik import AnalyticIk
from pinproof.model import Arm, JointLimits, Payload, load_robot
from pinproof.motion import TorqueLimits, Trajectory
from pinproof.motion.rate_constraints import RateConstraint
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

PUBLISHED = {"": 1.243, LOAD: 1.304}
"""Median durations in s that cuRobo publishes for its own set of 2,600 problems, which contains other problems too."""

PROMISING = 1.3
"""The path is planned to the goals at distances within this factor of the least, measured in time at full speed."""

GRID = 10_000
"""Number of times of each motion at which velocity, acceleration and jerk are compared with their limits."""

LIMIT_ROUNDING = 1e-9
"""Relative excess over a limit that is attributed to rounding."""

STEPS = ("goals", "plan", "optimise")


@dataclass(frozen=True)
class MotionRow(CheckedRow):
    """The motion for one problem with a load (``variant``), and the CPU times of :data:`STEPS`; None if not solved.

    ``goals`` is the number of free IK solutions of the goal pose, and ``excess`` the largest relative excess over a
    limit on the grid, negative within the limits. ``before`` and ``lower_bound`` are durations (s): of the planned path
    with time-optimal timing, and of the fastest motion to one of the goals without obstacles.
    """

    variant: str
    goals: int
    excess: float | None = None
    before: float | None = None
    lower_bound: float | None = None


@dataclass(frozen=True)
class MotionTable(BenchmarkTable):
    """The motions of a run."""

    rows: tuple[MotionRow, ...]

    topic: ClassVar[str] = "motions"
    row_types: ClassVar[dict[str, type]] = {"rows": MotionRow}

    @property
    def unsafe(self) -> list[MotionRow]:
        """The motions in which the independent check found a fault."""
        return [row for row in self.rows if row.faults]


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
) -> MotionTable:
    """Run the motion benchmark on MotionBenchMaker problems.

    Parameters
    ----------
    mbm, robot, sets, problems, on_progress
        As for :func:`benchmarks.planning_run.plan_benchmark`.
    seed
        Seed of the planner and the optimisation.

    Raises
    ------
    FileError
        If problems cannot be read.
    UnknownNameError
        If there is no set of a name.
    """
    origin, found = provenance(seed), {each.full_set: each for each in find_sets(mbm, robot)}
    rows: list[MotionRow] = []
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
    return MotionTable(settings, origin, tuple(rows))


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
) -> MotionRow:
    arm, start = problem.arm, problem.start
    limits = replace(arm.limits, acceleration=np.full(arm.dof, ACCELERATION), acceleration_source="of the benchmark")
    watch = Stopwatch(process_time_ns)
    failed = partial(MotionRow, *problem.origin, False, (), watch.ms, None, variant=variant)
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
    return MotionRow(
        *problem.origin,
        certified=result.certificate.free,
        faults=faults,
        ms={step: round(value, 4) for step, value in watch.ms.items()},
        duration=round(result.duration, 6),
        message="" if result.certificate.free else result.certificate.message,
        variant=variant,
        goals=len(goals),
        excess=excess,
        before=round(result.duration_before, 6),
        lower_bound=round(result.lower_bound, 6),
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


# -- page ------------------------------------------------------------------------------------------------------------


def motion_markdown(table: MotionTable) -> str:
    """Return the table as Markdown, without a title."""
    lines = [
        "## Durations of motions to a pose",
        "",
        *wrapped(
            "Motions from the start to the pose of the tool at the goal, with accelerations of at most "
            f"{table.settings['acceleration']:g} rad/s^2, jerks of at most {table.settings['jerk']:g} rad/s^3 and the "
            "velocities of the robot. All IK solutions found for the pose are goals. The lower bound is the duration "
            "of the fastest motion to the best free goal without obstacles, and the ratio that of both durations. The "
            "time is that from the problem to the certified trajectory, as CPU time of one core. A motion is unsafe if "
            f"the check on the original meshes, with samples of at most {table.settings['audit_step']:g} rad, finds a "
            f"contact, or if it exceeds a limit by more than a relative {LIMIT_ROUNDING:g} at one of "
            f"{table.settings['grid']:,} times. cuRobo publishes a median of {PUBLISHED['']} s, and of "
            f"{PUBLISHED[LOAD]} s with a load of 3 kg and torque limits, for its set of 2,600 problems. Torques are "
            "those of the identified masses and inertias of the catalogue's panda, because the URDF of "
            "MotionBenchMaker states 0.1 kg m^2 for each link, twenty times the real inertia of the last ones."
        ),
        "",
        provenance_text(table),
        "",
    ]
    for variant in dict.fromkeys(row.variant for row in table.rows):
        rows = [row for row in table.rows if row.variant == variant]
        groups = {"all sets": rows}
        for row in rows:
            groups.setdefault(row.set_name, []).append(row)
        title = f"With a load of {variant} and torque limits" if variant else "Without a load"
        cells = [_figures(*each) for each in groups.items()]
        lines += [f"### {title}", "", *markdown_table(tuple(cells[0]), [tuple(each.values()) for each in cells]), ""]
    return "\n".join(lines).rstrip() + "\n"


def _figures(name: str, rows: Sequence[MotionRow]) -> dict[str, str]:
    """The cells of a group of problems by column."""
    solved = [row for row in rows if row.duration is not None]
    return {
        "problems": name,
        "certified": f"{sum(bool(row.certified) for row in rows)} of {len(rows)}",
        "unsafe": str(sum(bool(row.faults) for row in rows)),
        "duration, s: median / 98 %": " / ".join(
            quantiles((row.duration for row in solved), text, [share])
            for text, share in (("{:.3f}".format, 0.5), ("{:.2f}".format, 0.98))
        ),
        "before, s": quantiles((row.before for row in solved), "{:.3f}".format),
        "lower bound, s": quantiles((row.lower_bound for row in solved), "{:.3f}".format),
        "ratio": quantiles(((row.duration or 0.0) / (row.lower_bound or 1.0) for row in solved), "{:.3f}".format),
        "time, ms: median / 95 %": quantiles((row.total for row in solved), "{:.1f}".format, (0.5, 0.95)),
        **{step: quantiles((row.ms[step] for row in solved), "{:.1f}".format) for step in STEPS},
        "largest excess": quantiles((row.excess for row in solved), "{:.1g}".format, (1.0,)),
    }


STORED, MOTIONS = FOLDER / "planning.json", FOLDER / "motion.json"


def measure(options: argparse.Namespace) -> PlanTable | MotionTable:
    """Return the table of the planners, or that of the durations of motions."""
    common = {"robot": options.robot, "sets": options.set, "problems": options.problems, "seed": options.seed}
    if not options.motion:
        peers = () if options.no_peers else (*PEERS, *map(mplib_method, options.mplib))
        more = {"repeats": options.repeats, "peers": peers, "planners": options.planner or (DEFAULT_PLANNER,)}
        return plan_benchmark(options.robots or OWN_ROBOTS, mbm=options.mbm, **more, **common, on_progress=report)
    if options.mbm is None:
        raise SystemExit("--motion needs --mbm")
    return motion_benchmark(options.mbm, **common, on_progress=report)


def page(table: PlanTable | MotionTable) -> str:
    """Return the part of the page that was measured."""
    return motion_markdown(table) if isinstance(table, MotionTable) else plan_markdown(table)


def write(table: PlanTable | MotionTable, folder: Path) -> None:
    """Write the measured table, and the page of both."""
    if isinstance(table, MotionTable):
        table.save(MOTIONS)
        table = PlanTable.load(STORED)
    motions = motion_markdown(MotionTable.load(MOTIONS)) if MOTIONS.exists() else ""
    write_plan_table(table, folder, sections=motions)


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
    parser.add_argument("--no-peers", action="store_true", help="leave out other planners")
    parser.add_argument(
        "--mplib", action="append", default=[], metavar="PYTHON", help="a Python with MPlib, to include it"
    )
    parser.add_argument("--motion", action="store_true", help="durations of motions to the goal poses of --mbm")
    run(parser, "planning", PlanTable, measure, page, write)
