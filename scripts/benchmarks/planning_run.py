"""The planning benchmark: every method solves the same problems, and each motion is checked independently."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path
from time import perf_counter_ns
from typing import Any, ClassVar

import numpy as np

from benchmarks.planning_methods import (
    NANOSECONDS_PER_MS,
    OURS,
    PEERS,
    STEPS,
    TIME_LIMIT,
    PlanMethod,
    Solve,
    own_method,
)
from benchmarks.planning_problems import (
    COLLECTION,
    MARGIN,
    OWN_ROBOTS,
    OWN_SCENES,
    PlanProblem,
    ProblemName,
    end_faults,
    find_sets,
    own_problems,
    read_problems,
    select_sets,
)
from benchmarks.tables import (
    BenchmarkTable,
    bullet_section,
    installed_versions,
    leave_out,
    log_panel,
    markdown_table,
    new_figure,
    provenance,
    provenance_text,
    quantiles,
    save_figure,
    wrapped,
)
from pinproof.collision import CollisionChecker
from pinproof.collision.checking.audit import STEP, audit
from pinproof.errors import InputError
from pinproof.motion import Curve
from pinproof.planning import DEFAULT_PLANNER
from pinproof.spatial import Array

STYLES = ("C0-", "C1--", "C1-", "C3-", "C2-", "C4-")
"""Lines of the methods in the plot."""


@dataclass(frozen=True)
class ProblemRow(ProblemName):
    """A problem, its robot, what is wrong with its start and goals, and how it was adapted to the robot.

    ``hull_faults`` and ``mesh_faults`` are those with the convex hulls of the links, which planners check, and with
    their original meshes; ``setup_ms`` is the time to build the collision checker, which no method's time includes.
    """

    robot: str
    hull_faults: tuple[str, ...]
    mesh_faults: tuple[str, ...]
    notes: tuple[str, ...]
    setup_ms: float


@dataclass(frozen=True)
class CheckedRow(ProblemName):
    """What every benchmark of motions states of the result for a problem.

    ``certified`` states whether the certificate of the motion is FREE; None for a planner without certificates.
    ``faults`` is what the independent check found wrong with the motion, ``ms`` the time of each step, ``duration``
    that of a timed motion in s, and ``message`` the reason why there is no motion or no certificate.
    """

    certified: bool | None
    faults: tuple[str, ...]
    ms: dict[str, float]
    duration: float | None
    message: str

    @property
    def total(self) -> float:
        """Milliseconds of all steps."""
        return sum(self.ms.values())


@dataclass(frozen=True)
class PlanRow(CheckedRow):
    """The fastest run of a method on a problem.

    ``length`` is the Euclidean length in joint space (rad and m count alike). ``repeatable`` states whether every run
    with the same seed returned the same motion; None after a single run. The others are those of the
    :class:`~benchmarks.planning_methods.PlanAnswer`.
    """

    method: str
    label: str
    solved: bool
    length: float | None
    clearance: float | None
    rejected_edges: int | None
    repeatable: bool | None


@dataclass(frozen=True)
class PlanTable(BenchmarkTable):
    """The problems of a run, the rows of every method for those with free ends, and why sets or methods are missing."""

    problems: tuple[ProblemRow, ...]
    rows: tuple[PlanRow, ...]
    left_out: dict[str, str]

    topic: ClassVar[str] = "planning"
    row_types: ClassVar[dict[str, type]] = {"problems": ProblemRow, "rows": PlanRow}

    @property
    def collections(self) -> tuple[str, ...]:
        """``"mbm"``, ``"ur5"``, ..., in the order of the run."""
        return tuple(dict.fromkeys(problem.collection for problem in self.problems))

    @property
    def methods(self) -> tuple[str, ...]:
        """The keys of the methods with rows, ours first."""
        return tuple(dict.fromkeys(row.method for row in self.rows))

    @property
    def unsafe(self) -> tuple[PlanRow, ...]:
        """Our motions with faults, whichever planner found them; expected to be empty."""
        return tuple(row for row in self.rows if row.certified is not None and row.faults)

    def sets(self, collection: str) -> tuple[str, ...]:
        """Return the sets of a collection in the order of the run."""
        return tuple(dict.fromkeys(p.set_name for p in self.problems if p.collection == collection))

    def figures(self, method: str, collection: str | None = None, set_name: str | None = None) -> dict[str, str]:
        """Return the cells of a method over all problems, a collection or a set by column; empty without any row."""
        group = [row for row in self.rows if collection in (None, row.collection) and set_name in (None, row.set_name)]
        rows = [row for row in group if row.method == method]
        if not rows:
            return {}

        def known(field: str) -> list[Any]:
            return [value for row in rows if (value := getattr(row, field)) is not None]

        times = {"total": [row.total for row in rows if row.solved]}
        times |= {step: [row.ms[step] for row in rows if row.solved and step in row.ms] for step in STEPS}
        clearances = [1e3 * clearance for clearance in known("clearance")]
        return {
            "method": rows[0].label,
            "solved": f"{sum(row.solved for row in rows)} of {len(rows)}",
            "certified": str(sum(known("certified"))) if known("certified") else "",
            "unsafe": str(sum(bool(row.faults) for row in rows)),
            **{step: quantiles(values, _milliseconds, (0.5, 0.95, 1.0)) for step, values in times.items()},
            "length": quantiles(known("length"), "{:.2f}".format),
            "length ratio": "" if method == OURS else _length_ratio(group, method),
            "duration, s": quantiles(known("duration"), "{:.2f}".format),
            "clearance, mm": quantiles(clearances, "{:.2g}".format, (0.0,)),
            "rejected edges": str(sum(known("rejected_edges"))) if known("rejected_edges") else "",
        }


def _length_ratio(rows: Sequence[PlanRow], method: str) -> str:
    """The median of our lengths over that of a method, on the problems that both solved."""
    ours, theirs = (
        {row.name: row.length for row in rows if row.method == key and row.length is not None} for key in (OURS, method)
    )
    both = ours.keys() & theirs.keys()
    return f"{np.median([ours[k] for k in both]) / np.median([theirs[k] for k in both]):.3f}" if both else ""


# -- Markdown and plot -------------------------------------------------------------------------------------------------


def write_plan_table(table: PlanTable, folder: str | Path, *, sections: str = "") -> list[Path]:
    """Write ``planning.json``, ``planning.md`` and, if there are rows, ``planning.png``.

    ``sections`` are added at the end of the page. Returns the files written. The folder must exist.
    """
    page = "# Planning benchmark\n\n" + plan_markdown(table) + (f"\n{sections}" if sections else "")
    written = table.write(folder, "planning", page)
    return [*written, save_figure(_time_plot(table), Path(folder) / "planning.png")] if table.rows else written


def plan_markdown(table: PlanTable) -> str:
    """Return the table as Markdown, without a title."""
    lines = [*_introduction(table), ""]
    for collection in table.collections:
        lines += [f"## {collection}", "", *_about(table, collection), ""]
        sets = table.sets(collection)
        lines += ["### all sets" if len(sets) > 1 else f"### {sets[0]}", "", *_figures(table, collection), ""]
        for name in sets if len(sets) > 1 else ():
            lines += [f"### {name}", "", *_scene(collection, name), *_figures(table, collection, name), ""]
    for title, entries in _lists(table):
        lines += bullet_section(title, (f"{name}: {'; '.join(texts)}" for name, texts in entries.items() if texts))
    return "\n".join(lines).rstrip() + "\n"


def _lists(table: PlanTable) -> Iterator[tuple[str, Mapping[str, Sequence[str]]]]:
    """The titles of the lists at the end of the page, and their entries."""
    problems = table.problems
    yield "Problems without a free start and goal", {p.name: p.mesh_faults for p in problems}
    by_hull = {p.name: p.hull_faults for p in problems if not p.mesh_faults}
    yield "Starts and goals in collision by the convex hulls only", by_hull
    yield "Adapted to the robot", {p.name: p.notes for p in problems}
    remarks = (remark.partition(": ") for remark in table.settings["remarks"])
    yield "Meshes that are not closed", {link: [text] for link, _, text in remarks}
    by_method = [[row for row in table.rows if row.method == method] for method in table.methods]
    for rows in by_method:
        failed = {row.name: [row.message] for row in rows if not row.solved or row.certified is False}
        yield f"Not solved or not certified: {rows[0].label}", failed
    for rows in by_method:
        yield f"Unsafe: {rows[0].label}", {row.name: row.faults for row in rows}
    yield "Left out", {name: [reason] for name, reason in table.left_out.items()}


def _introduction(table: PlanTable) -> list[str]:
    settings = table.settings
    setup = quantiles((problem.setup_ms for problem in table.problems), _milliseconds)
    repeats = settings["repeats"]
    runs = "solved once" if repeats == 1 else f"solved {repeats} times, of which the fastest run counts"
    problems = (
        f"{len(table.problems)} problems with seed {table.provenance['seed']}, each {runs}; the time limit of a search "
        f"is {settings['time_limit_s']:g} s. Times are in ms, as median / 95th percentile / maximum over the solved "
        "problems, in one process and one thread. The first problem of each set is solved once before the measurement, "
        "so that times do not include compilation. Times do not include building the collision checker"
        f"{f' (median {setup} ms)' if setup else ''}."
    )
    check = (
        "A motion is unsafe if the independent check finds a collision, a violated limit, or a wrong start or goal. "
        "The check uses coal on the original meshes of the links at samples between which no joint moves by more than "
        f"{settings['audit_step']:g} rad; it does not use the certificate. Our motions are checked as the timed "
        "trajectories that would be saved, and the certificates are of these. Problems whose start or goal collides "
        "by these meshes are not counted, and are listed below."
    )
    columns = (
        "Lengths are medians of the Euclidean length in joint space. The length ratio is the median of our lengths "
        "divided by the median of the other planner's, over the problems that both solved. The clearance is the "
        "smallest proven clearance of all motions. Rejected edges were free at their samples but failed the proof "
        "during planning. Our planner uses the convex hulls of the links, the others use their meshes; all check the "
        "same pairs of links."
    )
    if any(row.method == "ompl" for row in table.rows):
        columns += (
            " OMPL samples edges at its default of 1 % of the extent of the joint space, 0.13 rad for the Panda; finer "
            "samples would find more contacts and take longer."
        )
    changed = [row.name for row in table.rows if row.method == OURS and row.repeatable is False]
    if repeats > 1:
        columns += " The same seed gave the same motion in every run"
        columns += f", except for {', '.join(changed)}." if changed else "."
    return [*wrapped(problems, check, columns), "", *wrapped(provenance_text(table))]


def _about(table: PlanTable, collection: str) -> list[str]:
    problems = [problem for problem in table.problems if problem.collection == collection]
    mesh = sum(bool(problem.mesh_faults) for problem in problems)
    hull = sum(bool(problem.hull_faults) and not problem.mesh_faults for problem in problems)
    robots = ", ".join(dict.fromkeys(problem.robot for problem in problems))
    text = (
        f"{len(problems)} problems for {robots}. Start or goal in collision or outside the limits: {mesh}; in "
        f"collision by the convex hulls only: {hull}."
    )
    if collection != COLLECTION:
        text += (
            " The scenes are generated from the seed and scaled by the reach r of the arm. Starts and goals are IK "
            f"solutions with a clearance of at least {1e3 * MARGIN:g} mm whose straight connection is in collision."
        )
    return wrapped(text)


def _scene(collection: str, name: str) -> list[str]:
    """The description of one of our scenes: the docstring of the function that generates it."""
    if collection == COLLECTION or name not in OWN_SCENES:
        return []
    return [*wrapped((OWN_SCENES[name].__doc__ or "").strip()), ""]


def _figures(table: PlanTable, collection: str, set_name: str | None = None) -> list[str]:
    rows = [cells for method in table.methods if (cells := table.figures(method, collection, set_name))]
    if not rows:
        return ["No problem has a free start and goal."]
    return markdown_table(tuple(rows[0]), [tuple(cells.values()) for cells in rows])


def _milliseconds(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"


def _time_plot(table: PlanTable) -> Any:
    """The share of problems with a safe motion against the total time, one panel per collection.

    The curve of a method ends below 100 % if problems were not solved or motions are unsafe.
    """
    columns = min(2, len(table.collections))
    figure, panels = new_figure(-(-len(table.collections) // columns), columns, width=5.2, height=4.4)
    for panel in panels.flat[len(table.collections) :]:
        panel.set_axis_off()
    for panel, collection in zip(panels.flat, table.collections, strict=False):
        by_method = {m: [r for r in table.rows if (r.collection, r.method) == (collection, m)] for m in table.methods}
        for style, rows in zip(STYLES, by_method.values(), strict=False):
            if rows:
                times = np.sort([row.total for row in rows if row.solved and not row.faults])
                share = 100 * np.arange(1, len(times) + 1) / len(rows)
                label = f"{rows[0].label} ({sum(bool(row.faults) for row in rows)} unsafe)"
                panel.step(times, share, style, where="post", label=label, linewidth=1.6)
        title = f"{collection}: {max(map(len, by_method.values()))} problems"
        log_panel(panel, title, "total time, ms", "safe motions, % of problems")
        panel.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.17))
    return figure


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
        A folder of MotionBenchMaker problems (:mod:`benchmarks.planning_problems`), which come first.
    robot
        The robot of these problems; by default the URDF beside them, otherwise the robot that they name.
    sets
        Only these: ``"ur5/shelf"``, or a part of it such as ``"shelf"`` or ``"mbm"``; by default all.
    problems
        Largest number of problems per set; by default all of MotionBenchMaker, and :data:`OWN_PROBLEMS` of ours.
    planners
        Our planner or others, named as for :func:`pinproof.planning.make_planner`.
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
