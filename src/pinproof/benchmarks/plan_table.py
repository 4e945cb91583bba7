"""The table of the planning benchmark: its rows, figures over groups of problems, its Markdown page and its plot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from pinproof.benchmarks.plan_mbm import COLLECTION
from pinproof.benchmarks.plan_methods import OURS, STEPS
from pinproof.benchmarks.plan_problems import MARGIN, OWN_SCENES, ProblemName
from pinproof.benchmarks.tables import (
    BenchmarkTable,
    bullet_section,
    log_panel,
    markdown_table,
    new_figure,
    provenance_text,
    quantiles,
    save_figure,
    wrapped,
)

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
    :class:`~pinproof.benchmarks.plan_methods.PlanAnswer`.
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
