"""The motion benchmark: durations of certified motions from a start to the pose of the tool at a goal.

Every IK solution of the pose is a goal. Each motion is checked independently of its certificate: for collisions by the
original meshes, and for limits on a grid of times.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import process_time_ns
from typing import ClassVar

import numpy as np

from pinproof.benchmarks.plan_mbm import find_sets, read_problems
from pinproof.benchmarks.plan_methods import Stopwatch
from pinproof.benchmarks.plan_problems import PlanProblem, select_sets
from pinproof.benchmarks.plan_run import motion_faults
from pinproof.benchmarks.plan_table import CheckedRow
from pinproof.benchmarks.tables import (
    BenchmarkTable,
    markdown_table,
    provenance,
    provenance_text,
    quantiles,
    wrapped,
)
from pinproof.collision import CollisionChecker
from pinproof.collision.checking.audit import STEP
from pinproof.errors import InputError, TimingError, UnknownNameError
from pinproof.ik import AnalyticIk
from pinproof.model import Arm, JointLimits, Payload, load_robot
from pinproof.motion import TorqueLimits, Trajectory
from pinproof.motion.rate_constraints import RateConstraint
from pinproof.planning import RrtConnect, optimise, shortcut
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
        As for :func:`~pinproof.benchmarks.plan_benchmark`.
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
    if plan.path is None:
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
