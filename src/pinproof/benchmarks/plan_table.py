"""The table of the planning benchmark: its rows, figures over groups of problems, its Markdown page and its plot."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
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
    new_figure,
    provenance_text,
    row_table,
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
class PlanRow(ProblemName):
    """The result of a method on a problem.

    Parameters
    ----------
    method, label
        The method.
    solved
        Whether it returned a motion.
    certified, ms, duration, clearance, rejected_edges, message
        Those of the :class:`~pinproof.benchmarks.plan_methods.PlanAnswer` of the fastest run.
    faults
        What the independent check found wrong with the motion.
    length
        Euclidean length in joint space (rad and m count alike); None if not solved.
    repeatable
        Whether every run with the same seed returned the same motion; None after a single run.
    """

    method: str
    label: str
    solved: bool
    certified: bool | None
    faults: tuple[str, ...]
    ms: dict[str, float]
    length: float | None
    duration: float | None
    clearance: float | None
    rejected_edges: int | None
    repeatable: bool | None
    message: str

    @property
    def total(self) -> float:
        """Milliseconds of all steps."""
        return sum(self.ms.values())

    @property
    def safe(self) -> bool:
        """Whether there is a motion without faults."""
        return self.solved and not self.faults


@dataclass(frozen=True)
class Spread:
    """Median, 95th percentile and largest of some numbers."""

    median: float
    p95: float
    largest: float

    def __str__(self) -> str:
        return " / ".join(_milliseconds(value) for value in (self.median, self.p95, self.largest))


def _spread(values: Sequence[float]) -> Spread | None:
    return Spread(*np.quantile(values, (0.5, 0.95, 1.0)).tolist()) if len(values) else None


@dataclass(frozen=True)
class PlanFigures:
    """The figures of a method over a group of problems whose start and goal are free.

    ``ms`` maps each step and ``"total"`` to the spread of its times in ms. Length (rad, m) and duration (s) are medians
    over the motions, and the clearance (m) is the smallest. The length ratio, for another library, is the median of our
    lengths over the median of its lengths, on problems that both solved. None marks what a method does not have.
    """

    label: str
    problems: int
    solved: int
    certified: int | None
    unsafe: int
    ms: dict[str, Spread]
    length: float | None
    length_ratio: float | None
    duration: float | None
    clearance: float | None
    rejected_edges: int | None


@dataclass(frozen=True)
class PlanTable(BenchmarkTable):
    """The results of one run.

    Parameters
    ----------
    problems
        Every problem that was read or generated.
    rows
        One for each method and problem with free start and goal.
    left_out
        Set or method to the reason why it is missing.
    """

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

    def figures(self, method: str, collection: str | None = None, set_name: str | None = None) -> PlanFigures | None:
        """Return the figures of a method over all problems, a collection, or a set; None without any row."""
        group = [row for row in self.rows if collection in (None, row.collection) and set_name in (None, row.set_name)]
        rows = [row for row in group if row.method == method]
        if not rows:
            return None

        def known(field: str) -> list[Any]:
            return [value for row in rows if (value := getattr(row, field)) is not None]

        times = {step: [row.ms[step] for row in rows if row.solved and step in row.ms] for step in STEPS}
        times["total"] = [row.total for row in rows if row.solved]
        return PlanFigures(
            label=rows[0].label,
            problems=len(rows),
            solved=sum(row.solved for row in rows),
            certified=sum(known("certified")) if known("certified") else None,
            unsafe=sum(bool(row.faults) for row in rows),
            ms={step: spread for step, values in times.items() if (spread := _spread(values)) is not None},
            length=_median(known("length")),
            length_ratio=None if method == OURS else _length_ratio(group, method),
            duration=_median(known("duration")),
            clearance=min(known("clearance"), default=None),
            rejected_edges=sum(known("rejected_edges")) if known("rejected_edges") else None,
        )


def _length_ratio(rows: Sequence[PlanRow], method: str) -> float | None:
    ours, theirs = (
        {row.name: row.length for row in rows if row.method == key and row.length is not None} for key in (OURS, method)
    )
    both = ours.keys() & theirs.keys()
    return float(np.median([ours[k] for k in both]) / np.median([theirs[k] for k in both])) if both else None


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None


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
    setup = _median([problem.setup_ms for problem in table.problems])
    repeats = settings["repeats"]
    runs = "solved once" if repeats == 1 else f"solved {repeats} times, of which the fastest run counts"
    problems = (
        f"{len(table.problems)} problems with seed {table.provenance['seed']}, each {runs}; the time limit of a search "
        f"is {settings['time_limit_s']:g} s. Times are in ms, as median / 95th percentile / maximum over the solved "
        "problems, in one process and one thread. The first problem of each set is solved once before the measurement, "
        "so that times do not include compilation. Times do not include building the collision checker"
        f"{'' if setup is None else f' (median {_milliseconds(setup)} ms)'}."
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
    figures = (table.figures(method, collection, set_name) for method in table.methods)
    rows = [each for each in figures if each is not None]
    return row_table(COLUMNS, rows) if rows else ["No problem has a free start and goal."]


def _milliseconds(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"


def _time(step: str) -> Callable[[PlanFigures], str]:
    return lambda figures: str(figures.ms.get(step, ""))


COLUMNS: dict[str, str | Callable[[PlanFigures], str]] = {
    "method": "{.label}",
    "solved": "{0.solved} of {0.problems}",
    "certified": "{.certified:d}",
    "unsafe": "{.unsafe:d}",
    **{step: _time(step) for step in ("total", *STEPS)},
    "length": "{.length:.2f}",
    "length ratio": "{.length_ratio:.3f}",
    "duration, s": "{.duration:.2f}",
    "clearance, mm": lambda figures: "" if figures.clearance is None else f"{1e3 * figures.clearance:.2g}",
    "rejected edges": "{.rejected_edges:d}",
}
"""The columns: their titles, and the format of the figures of a method."""


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
                times = np.sort([row.total for row in rows if row.safe])
                share = 100 * np.arange(1, len(times) + 1) / len(rows)
                label = f"{rows[0].label} ({sum(bool(row.faults) for row in rows)} unsafe)"
                panel.step(times, share, style, where="post", label=label, linewidth=1.6)
        title = f"{collection}: {max(map(len, by_method.values()))} problems"
        log_panel(panel, title, "total time, ms", "safe motions, % of problems")
        panel.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.17))
    return figure
