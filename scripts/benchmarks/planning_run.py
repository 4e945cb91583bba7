"""The planning benchmark: every method solves the same problems, and each motion is checked independently."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from time import perf_counter_ns
from typing import Any

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
    OWN_ROBOTS,
    OWN_SCENES,
    PlanProblem,
    end_faults,
    find_sets,
    own_problems,
    read_problems,
    select_sets,
)
from benchmarks.tables import (
    Results,
    Row,
    bullet_section,
    installed_versions,
    leave_out,
    log_panel,
    new_figure,
    provenance,
    quantiles,
    row_table,
    version_in,
    wrapped,
)
from pinproof.collision import CollisionChecker
from pinproof.collision.checking.audit import STEP, audit
from pinproof.errors import InputError
from pinproof.motion import Curve
from pinproof.planning import DEFAULT_PLANNER
from pinproof.spatial import Array

KEYS = ("collection", "set_name", "number", "method")
"""What identifies a row of a problem and a method; rows of problems have no method."""

STYLES = ("C0-", "C1--", "C1-", "C3-", "C2-", "C4-", "C5-", "C6-", "C7-")
"""Lines of the methods in the plot."""


def name_of(row: Row) -> str:
    """``"ur5/shelf/3"``."""
    return f"{row.collection}/{row.set_name}/{row.number}"


def total(row: Row) -> float:
    """Milliseconds of all steps."""
    return float(sum(row.ms.values()))


def rows_of(results: Results, part: str, **values: Any) -> list[Row]:
    """The rows with these values, such as a collection, a set or a method."""
    return [row for row in results[part] if all(getattr(row, name) == value for name, value in values.items())]


def methods_of(results: Results) -> tuple[str, ...]:
    """The keys of the methods with rows, ours first."""
    return tuple(dict.fromkeys(row.method for row in results["rows"]))


def figures(results: Results, method: str, **group: Any) -> dict[str, str]:
    """The cells of a method over all problems, a collection or a set by column; empty without any row."""
    rows = rows_of(results, "rows", method=method, **group)
    if not rows:
        return {}

    def known(field: str) -> list[Any]:
        return [value for row in rows if (value := getattr(row, field)) is not None]

    def counted(field: str) -> str:
        return str(sum(known(field))) if known(field) else ""

    times = {"total": [total(row) for row in rows if row.solved]}
    times |= {step: [row.ms[step] for row in rows if row.solved and step in row.ms] for step in STEPS}
    return {
        "method": rows[0].label,
        "solved": f"{sum(row.solved for row in rows)} of {len(rows)}",
        "certified": counted("certified"),
        "unsafe": str(sum(bool(row.faults) for row in rows)),
        **{step: quantiles(values, _milliseconds, (0.5, 0.95, 1.0)) for step, values in times.items()},
        "length": quantiles(known("length"), "{:.2f}"),
        "length ratio": "" if method == OURS else _length_ratio(rows_of(results, "rows", **group), method),
        "duration, s": quantiles(known("duration"), "{:.2f}"),
        "clearance, mm": quantiles(known("clearance"), "{:.2g}", (0.0,), 1e3),
        "rejected edges": counted("rejected_edges"),
    }


def _milliseconds(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"


def _length_ratio(rows: Sequence[Row], method: str) -> str:
    """The median of our lengths over that of a method, on the problems that both solved."""
    ours, theirs = (
        {name_of(row): row.length for row in rows if row.method == key and row.length is not None}
        for key in (OURS, method)
    )
    both = ours.keys() & theirs.keys()
    return f"{np.median([ours[k] for k in both]) / np.median([theirs[k] for k in both]):.3f}" if both else ""


# -- tables and plot ---------------------------------------------------------------------------------------------------


def introduction(results: Results) -> list[str]:
    """What depends on the run: the number of problems, the time of the set-up, and whether motions are repeatable."""
    setup, repeats = (
        quantiles((row.setup_ms for row in results["problems"]), _milliseconds),
        results.settings["repeats"],
    )
    changed = [name_of(row) for row in rows_of(results, "rows", method=OURS) if row.repeatable is False]
    same = (
        f"the same seed gave another motion for {', '.join(changed)}" if changed else "equal seeds gave equal motions"
    )
    runs = f"{repeats} times, of which the fastest counts; {same}" if repeats > 1 else "once"
    other: dict[tuple[str, str], list[Row]] = {}  # rows that were not measured in the run of the provenance
    for row in results["rows"]:
        if (row.commit, row.date) != _origin(results.provenance):
            other.setdefault((row.commit, row.date), []).append(row)
    return wrapped(
        f"{len(results['problems'])} problems, each solved {runs}.",
        f"Building the collision checker, which the times do not include, takes {setup} ms (median).",
        *map(_run_sentence, other.values()),
    )


def _run_sentence(rows: Sequence[Row]) -> str:
    """Which rows were measured in another run, and under which load, where that is known."""
    load = " to ".join(dict.fromkeys(quantiles((row.load for row in rows), "{:.0f}", (0.0, 1.0)).split(" / ")))
    counts = "; ".join(f"{label} ({count})" for label, count in Counter(row.label for row in rows).items())
    return f"Measured with commit {rows[0].commit}, {rows[0].date}{load and f', load average {load}'}: {counts}."


def _origin(provenance: Mapping[str, Any]) -> tuple[str, str]:
    """The commit and the day of a run."""
    return provenance["commit"], provenance["date"][:10]


def plan_tables(results: Results) -> list[str]:
    """A section for each collection with a table for each set."""
    lines: list[str] = []
    for collection in dict.fromkeys(row.collection for row in results["problems"]):
        problems = rows_of(results, "problems", collection=collection)
        sets = tuple(dict.fromkeys(row.set_name for row in problems))
        mesh = sum(bool(row.mesh_faults) for row in problems)
        hull = sum(bool(row.hull_faults) and not row.mesh_faults for row in problems)
        text = (
            f"{len(problems)} problems for {', '.join(dict.fromkeys(row.robot for row in problems))}. Start or goal in "
            f"collision or outside the limits: {mesh}; in collision by the convex hulls only: {hull}."
        )
        lines += [f"## {collection}", "", *wrapped(text), ""]
        if len(sets) > 1:
            lines += ["### all sets", "", *_table(results, collection=collection), ""]
        for name in sets:
            scene = OWN_SCENES.get(name) if collection != COLLECTION else None
            about = [*wrapped((scene.__doc__ or "").strip()), ""] if scene else []
            lines += [f"### {name}", "", *about, *_table(results, collection=collection, set_name=name), ""]
    for title, entries in _lists(results):
        lines += bullet_section(title, (f"{name}: {'; '.join(texts)}" for name, texts in entries.items() if texts))
    return lines[:-1]


def _table(results: Results, **group: Any) -> list[str]:
    rows = [cells for method in methods_of(results) if (cells := figures(results, method, **group))]
    columns = {title: lambda row, title=title: row[title] for title in (rows[0] if rows else {})}
    return row_table(columns, rows) or ["No problem has a free start and goal."]


def _lists(results: Results) -> Iterator[tuple[str, Mapping[str, Sequence[str]]]]:
    """The titles of the lists at the end of the page, and their entries."""
    problems = results["problems"]
    yield "Problems without a free start and goal", {name_of(p): p.mesh_faults for p in problems}
    by_hull = {name_of(p): p.hull_faults for p in problems if not p.mesh_faults}
    yield "Starts and goals in collision by the convex hulls only", by_hull
    yield "Adapted to the robot", {name_of(p): p.notes for p in problems}
    remarks = (remark.partition(": ") for remark in results.settings["remarks"])
    yield "Meshes that are not closed", {link: [text] for link, _, text in remarks}
    by_method = [rows_of(results, "rows", method=method) for method in methods_of(results)]
    for rows in by_method:
        failed = {name_of(row): [row.message] for row in rows if not row.solved or row.certified is False}
        yield f"Not solved or not certified: {rows[0].label}", failed
    for rows in by_method:
        yield f"Unsafe: {rows[0].label}", {name_of(row): row.faults for row in rows}
    # What was left out in one run may have been measured in a later one
    measured = {name for row in results["rows"] for name in (row.method, f"{row.method} on {name_of(row)}")}
    yield "Left out", {name: [reason] for name, reason in results["left_out"].items() if name not in measured}


def time_plot(results: Results) -> Any:
    """The share of problems with a safe motion against the total time, one panel per collection.

    The curve of a method ends below 100 % if problems were not solved or motions are unsafe.
    """
    collections = list(dict.fromkeys(row.collection for row in results["rows"]))
    columns = min(2, len(collections))
    figure, panels = new_figure(-(-len(collections) // columns), columns, width=5.2, height=4.4)
    for panel in panels.flat[len(collections) :]:
        panel.set_axis_off()
    for panel, collection in zip(panels.flat, collections, strict=False):
        by_method = [rows_of(results, "rows", collection=collection, method=m) for m in methods_of(results)]
        for style, rows in zip(STYLES, by_method, strict=False):
            if rows:
                times = np.sort([total(row) for row in rows if row.solved and not row.faults])
                share = 100 * np.arange(1, len(times) + 1) / len(rows)
                label = f"{rows[0].label} ({sum(bool(row.faults) for row in rows)} unsafe)"
                panel.step(times, share, style, where="post", label=label, linewidth=1.6)
        title = f"{collection}: {max(map(len, by_method))} problems"
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
) -> Results:
    """Run the planning benchmark; InputError for unknown sets, planners and robots, FileError for unreadable problems.

    ``robots`` are catalogue names or robot files for our scenes. The problems of the folder ``mbm`` come first, for
    ``robot``, which is by default the URDF beside them or the robot that they name. ``sets`` selects some of all sets:
    ``"ur5/shelf"``, or a part of it such as ``"shelf"``; ``problems`` is the largest number in each. ``planners`` are
    named as for :func:`pinproof.planning.planner_of`, and ``peers`` are all other libraries, none or some, of which
    those that cannot be run are listed with the reason. Of ``repeats`` runs the fastest counts.
    """
    if repeats < 1 or (problems is not None and problems < 1):
        raise InputError(f"problems = {problems} and repeats = {repeats} must be at least 1")
    origin, sources = provenance(seed), _sources(robots, mbm, robot, problems, seed)
    methods = (*map(own_method, planners), *(PEERS if peers is True else peers or ()))
    run = _Run(methods, seed, repeats, _origin(origin))
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
        "peer_versions": installed_versions(m.distribution for m in methods if m.python is None)
        | {m.distribution: version_in(m.python, m.distribution) for m in methods if m.python and m.distribution},
    }
    return Results(settings, origin, {"problems": run.problems, "rows": run.rows, "left_out": run.left_out})


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
    origin: tuple[str, str]
    problems: list[Row] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
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
            row = Row(
                **problem.origin,
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

    def _measure(self, problem: PlanProblem, method: PlanMethod, solve: Solve, meshes: CollisionChecker) -> Row:
        """Run a prepared method; the fastest run counts.

        ``faults`` is what the independent check found. A fault of one of our motions is a wrong verdict, whichever
        planner found it; ``certified`` is None for a planner without certificates.
        """
        answers = [solve(self.seed) for _ in range(self.repeats)]
        best = min(answers, key=lambda answer: sum(answer.ms.values()))
        same = [_equal(a.curve, b.curve) for a, b in pairwise(answers)]
        if best.curve is not None and best.ms.get("plan", 0.0) > 1e3 * TIME_LIMIT:
            best = replace(best, curve=None, message=f"no path within {TIME_LIMIT:g} s of processor time")
        faults = () if best.curve is None else motion_faults(best.curve, problem, meshes)
        return Row(
            **problem.origin,
            method=method.key,
            label=method.label,
            solved=best.curve is not None,
            certified=best.certified,
            faults=faults,
            wrong=[f"{problem.name}: {fault}" for fault in faults if best.certified is not None],
            ms={step: round(ms, 4) for step, ms in best.ms.items()},
            length=None if best.curve is None else round(curve_length(best.curve), 6),
            duration=None if best.duration is None else round(best.duration, 6),
            clearance=None if best.clearance is None else round(best.clearance, 7),
            rejected_edges=best.rejected_edges,
            repeatable=all(same) if same else None,
            commit=self.origin[0],
            date=self.origin[1],
            load=round(os.getloadavg()[0], 1),
            message=best.message,
        )


def _equal(one: Curve | None, other: Curve | None) -> bool:
    """Whether two motions are equal bit by bit."""
    if one is None or other is None:
        return one is other
    return all(np.array_equal(a, b) for a, b in zip(one.bezier(), other.bezier(), strict=True))
