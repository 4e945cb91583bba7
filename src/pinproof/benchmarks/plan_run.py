"""The planning benchmark: every method solves the same problems, and each motion is checked independently."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path
from time import perf_counter_ns

import numpy as np

from pinproof.benchmarks.plan_mbm import find_sets, read_problems
from pinproof.benchmarks.plan_methods import NANOSECONDS_PER_MS, TIME_LIMIT, PlanMethod, Solve, own_method
from pinproof.benchmarks.plan_peers import PEERS
from pinproof.benchmarks.plan_problems import (
    OWN_ROBOTS,
    OWN_SCENES,
    PlanProblem,
    end_faults,
    own_problems,
    select_sets,
)
from pinproof.benchmarks.plan_table import PlanRow, PlanTable, ProblemRow
from pinproof.benchmarks.tables import installed_versions, leave_out, provenance
from pinproof.collision import CollisionChecker
from pinproof.collision.checking.audit import STEP, audit
from pinproof.errors import InputError
from pinproof.motion import Curve
from pinproof.planning import DEFAULT_PLANNER
from pinproof.spatial import Array

OWN_PROBLEMS = 10
"""Problems that are generated in each of our scenes for each robot."""

ROUNDING = 1e-6
"""Rad or m by which a motion may miss its start and goal or exceed a limit."""

CHORDS = 64
"""Chords that approximate a curved segment: for a segment that turns by a right angle, the error of its length is below
1 in 5,000."""


# -- independent check of a motion -------------------------------------------------------------------------------------


def motion_faults(
    curve: Curve, problem: PlanProblem, mesh_checker: CollisionChecker, *, step: float = STEP
) -> tuple[str, ...]:
    """Return what is wrong with a motion, by dense samples and the original meshes of the links, not its certificate.

    No joint moves by more than ``step`` (rad or m) between samples. A contact names the bodies and where it occurs.
    """
    first, last = curve.domain
    faults = []
    if np.abs(curve(first) - problem.start).max() > ROUNDING:
        faults.append("does not begin at the start")
    if np.abs(curve(last) - problem.goals).max(axis=1).min() > ROUNDING:
        faults.append("does not end at a goal")
    limits = problem.group.limits
    sampled = np.concatenate(_segments(curve))
    excess = np.maximum(limits.lower - sampled, sampled - limits.upper).max(axis=0)
    faults += [
        f"{name} is {value:.2g} outside its limits"
        for name, value in zip(problem.group.joint_names, excess, strict=True)
        if value > ROUNDING
    ]
    result = audit(curve, mesh_checker, step=step, measure=False)
    faults += [
        f"{a} touches {b} at {100 * (t - first) / (last - first or 1.0):.1f} % of the motion"
        for t, (a, b) in result.contacts
    ]
    return tuple(faults)


def curve_length(curve: Curve) -> float:
    """Return the Euclidean length in joint space (rad and m count alike), exact for straight segments."""
    return float(sum(np.linalg.norm(np.diff(points, axis=0), axis=1).sum() for points in _segments(curve)))


def _segments(curve: Curve) -> list[Array]:
    """Samples of each segment; the end points of a straight one."""
    knots, control = curve.bezier()
    straight = control.shape[1] == 2
    return [
        np.asarray(points if straight else curve(np.linspace(a, b, CHORDS + 1)))
        for a, b, points in zip(knots[:-1], knots[1:], control, strict=True)
    ]


# -- runs --------------------------------------------------------------------------------------------------------------


def plan_benchmark(
    robots: Sequence[str] = OWN_ROBOTS,
    *,
    mbm: str | Path | None = None,
    robot: str | None = None,
    sets: Sequence[str] = (),
    problems: int | None = None,
    planners: Sequence[str] = (DEFAULT_PLANNER,),
    peers: bool | Sequence[PlanMethod] = True,
    repeats: int = 1,
    seed: int = 0,
    on_progress: Callable[[str], None] | None = None,
) -> PlanTable:
    """Run the planning benchmark.

    Parameters
    ----------
    robots
        Catalogue names or robot files for our scenes.
    mbm
        A folder of MotionBenchMaker problems (:mod:`pinproof.benchmarks.plan_mbm`), which come first.
    robot
        The robot of these problems; by default the URDF beside them, otherwise the robot that they name.
    sets
        Only these: ``"ur5/shelf"``, or a part of it such as ``"shelf"`` or ``"mbm"``; by default all.
    problems
        Largest number of problems per set; by default all of MotionBenchMaker, and :data:`OWN_PROBLEMS` of ours.
    planners
        Our planners, keys of :data:`pinproof.planning.planners.PLANNERS`.
    peers
        Whether to include planners of other libraries, or which. Those that cannot be run are listed with the reason.
    repeats
        Runs per problem; the fastest counts, and the motions are compared.
    seed
        Seed of our problems and of every method.
    on_progress
        Called with a description of the current step.

    Raises
    ------
    InputError
        If ``problems`` or ``repeats`` is below 1, or for an unknown set, planner or robot.
    FileError
        If problems cannot be read.
    """
    if repeats < 1 or (problems is not None and problems < 1):
        raise InputError(f"problems = {problems} and repeats = {repeats} must be at least 1")
    origin, sources = provenance(seed), _sources(robots, mbm, robot, problems, seed)
    methods = (*map(own_method, planners), *(PEERS if peers is True else peers or ()))
    run = _Run(methods, seed, repeats)
    for full_set in select_sets(list(sources), tuple(sets)):
        if on_progress is not None:
            on_progress(full_set)
        try:
            run.solve_set(sources[full_set]())
        except InputError as error:  # no problem was found in this scene
            run.left_out[full_set] = str(error)
    settings = {
        "robots": list(robots),
        "mbm": mbm is not None,
        "sets": list(sets),
        "problems": problems,
        "repeats": repeats,
        "audit_step": STEP,
        "time_limit_s": TIME_LIMIT,
        "remarks": sorted(run.remarks),
        "peer_versions": installed_versions(method.distribution for method in methods),
    }
    return PlanTable(settings, origin, tuple(run.problems), tuple(run.rows), run.left_out)


def _sources(
    robots: Sequence[str], mbm: str | Path | None, robot: str | None, most: int | None, seed: int
) -> Mapping[str, Callable[[], Iterator[PlanProblem]]]:
    """Full names of the sets, and the sources of their problems."""
    found = [] if mbm is None else find_sets(mbm, robot)
    return {each.full_set: partial(read_problems, each, most) for each in found} | {
        f"{Path(name).stem}/{scene}": partial(own_problems, name, scene, most or OWN_PROBLEMS, seed)
        for name in robots
        for scene in OWN_SCENES
    }


@dataclass(eq=False)
class _Run:
    """The problems and rows of a run so far."""

    methods: tuple[PlanMethod, ...]
    seed: int
    repeats: int
    problems: list[ProblemRow] = field(default_factory=list)
    rows: list[PlanRow] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)
    remarks: set[str] = field(default_factory=set)

    def solve_set(self, problems: Iterable[PlanProblem]) -> None:
        """Solve every problem of a set whose start and goals are free by the meshes with every method."""
        warm = False
        for problem in problems:
            begin = perf_counter_ns()
            hulls = CollisionChecker(problem.group, problem.scene)
            setup_ms = (perf_counter_ns() - begin) / NANOSECONDS_PER_MS
            meshes = CollisionChecker(problem.group, problem.scene, link_meshes="surface")
            self.remarks |= {f"{body.owner}: {body.remark}" for body in meshes.bodies if body.remark}
            row = ProblemRow(
                *problem.origin,
                robot=problem.group.robot.name,
                hull_faults=end_faults(problem, hulls),
                mesh_faults=end_faults(problem, meshes),
                notes=problem.notes,
                setup_ms=round(setup_ms, 2),
            )
            self.problems.append(row)
            if row.mesh_faults:
                continue
            for method in self.methods:
                if method.key in self.left_out:
                    continue
                own = method.distribution is None
                with leave_out(self.left_out, method.key, own=own, where=f" on {problem.name}"):
                    solve = method.prepare(problem, hulls)
                    if not warm:  # loads compiled code
                        solve(self.seed)
                    self.rows.append(self._measure(problem, method, solve, meshes))
            warm = True

    def _measure(self, problem: PlanProblem, method: PlanMethod, solve: Solve, meshes: CollisionChecker) -> PlanRow:
        """Run a prepared method; the fastest run counts."""
        answers = [solve(self.seed) for _ in range(self.repeats)]
        best = min(answers, key=lambda answer: sum(answer.ms.values()))
        same = [_equal(a.curve, b.curve) for a, b in pairwise(answers)]
        return PlanRow(
            *problem.origin,
            method=method.key,
            label=method.label,
            solved=best.curve is not None,
            certified=best.certified,
            faults=() if best.curve is None else motion_faults(best.curve, problem, meshes),
            ms={step: round(ms, 4) for step, ms in best.ms.items()},
            length=None if best.curve is None else round(curve_length(best.curve), 6),
            duration=None if best.duration is None else round(best.duration, 6),
            clearance=None if best.clearance is None else round(best.clearance, 7),
            rejected_edges=best.rejected_edges,
            repeatable=all(same) if same else None,
            message=best.message,
        )


def _equal(one: Curve | None, other: Curve | None) -> bool:
    """Whether two motions are equal bit by bit."""
    if one is None or other is None:
        return one is other
    return all(np.array_equal(a, b) for a, b in zip(one.bezier(), other.bezier(), strict=True))
