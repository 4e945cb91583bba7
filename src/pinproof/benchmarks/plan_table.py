"""The table of the planning benchmark: its rows, figures over groups of problems, its Markdown page and its plot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

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
    wrapped,
)

__all__ = [
    "COLUMNS",
    "PlanFigures",
    "PlanRow",
    "PlanTable",
    "ProblemRow",
    "Spread",
    "plan_markdown",
    "write_plan_table",
]

COLUMNS = (
    "method",
    "solved",
    "certified",
    "unsafe",
    "total",
    *STEPS,
    "length",
    "length ratio",
    "duration, s",
    "clearance, mm",
    "rejected edges",
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

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread | None:
        """Return the spread of the values; None without any."""
        return cls(*np.quantile(values, (0.5, 0.95, 1.0)).tolist()) if len(values) else None


@dataclass(frozen=True)
class PlanFigures:
    """The figures of a method over a group of problems whose start and goal are free.

    Parameters
    ----------
    label
        The method.
    problems, solved, certified, unsafe
        Numbers of problems, motions, certified motions (None for a method without certificates), motions with faults.
    ms
        Step, or ``"total"``, to the spread of its milliseconds over the motions.
    length, duration, clearance
        Medians of length (rad, m) and duration (s), and the smallest proven clearance (m).
    length_ratio
        For another library: the median of our lengths over the median of its lengths, on problems that both solved.
    rejected_edges
        Number of edges that failed the proof.
    """

    label: str
    problems: int
    solved: int
    certified: int | None
    unsafe: int
    ms: dict[str, Spread]
    length: float | None
    duration: float | None
    clearance: float | None
    length_ratio: float | None
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
        solved = [row for row in rows if row.solved]
        ms = {step: Spread.of([row.ms[step] for row in solved if step in row.ms]) for step in STEPS}
        ms["total"] = Spread.of([row.total for row in solved])
        certified = [row.certified for row in rows if row.certified is not None]
        rejected = [row.rejected_edges for row in rows if row.rejected_edges is not None]
        return PlanFigures(
            label=rows[0].label,
            problems=len(rows),
            solved=len(solved),
            certified=sum(certified) if certified else None,
            unsafe=sum(bool(row.faults) for row in rows),
            ms={step: spread for step, spread in ms.items() if spread is not None},
            length=_median([row.length for row in solved]),
            duration=_median([row.duration for row in solved]),
            clearance=min((row.clearance for row in solved if row.clearance is not None), default=None),
            length_ratio=None if method == OURS else _length_ratio(group, method),
            rejected_edges=sum(rejected) if rejected else None,
        )


def _length_ratio(rows: Sequence[PlanRow], method: str) -> float | None:
    lengths = {
        key: {row.name: row.length for row in rows if row.method == key and row.length is not None}
        for key in (OURS, method)
    }
    both = set(lengths[OURS]) & set(lengths[method])
    ours, theirs = (_median([lengths[key][name] for name in both]) for key in (OURS, method))
    return ours / theirs if ours is not None and theirs else None


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


# -- Markdown and plot -------------------------------------------------------------------------------------------------


def write_plan_table(table: PlanTable, folder: str | Path) -> list[Path]:
    """Write ``planning.json``, ``planning.md`` and, if there are rows, ``planning.png``.

    Returns the files written. The folder must exist.
    """
    written = table.write(folder, "planning", "# Planning benchmark\n\n" + plan_markdown(table))
    if table.rows:
        written.append(Path(folder) / "planning.png")
        _write_time_plot(table, written[-1])
    return written


def plan_markdown(table: PlanTable) -> str:
    """Return the table as Markdown, without a title."""
    lines = [*_introduction(table), ""]
    for collection in table.collections:
        lines += [f"## {collection}", "", *_about(table, collection), ""]
        sets = table.sets(collection)
        lines += ["### all sets" if len(sets) > 1 else f"### {sets[0]}", "", *_figures(table, collection), ""]
        for name in sets if len(sets) > 1 else ():
            lines += [f"### {name}", "", *_scene(collection, name), *_figures(table, collection, name), ""]
    lines += _start_and_goal_faults(table)
    for method in table.methods:
        rows = [row for row in table.rows if row.method == method]
        failed = (f"{row.name}: {row.message}" for row in rows if not row.solved or row.certified is False)
        lines += bullet_section(f"Not solved or not certified: {rows[0].label}", failed)
    for method in table.methods:
        rows = [row for row in table.rows if row.method == method]
        unsafe = (f"{row.name}: {'; '.join(row.faults)}" for row in rows if row.faults)
        lines += bullet_section(f"Unsafe: {rows[0].label}", unsafe)
    lines += bullet_section("Left out", (f"{name}: {reason}" for name, reason in table.left_out.items()))
    return "\n".join(lines).rstrip() + "\n"


def _introduction(table: PlanTable) -> list[str]:
    settings = table.settings
    setup = Spread.of([problem.setup_ms for problem in table.problems])
    repeats = settings["repeats"]
    runs = "solved once" if repeats == 1 else f"solved {repeats} times, of which the fastest run counts"
    problems = (
        f"{len(table.problems)} problems with seed {table.provenance['seed']}, each {runs}; the time limit of a search "
        f"is {settings['time_limit_s']:g} s. Times are in ms, as median / 95th percentile / maximum over the solved "
        "problems, in one process and one thread. The first problem of each set is solved once before the measurement, "
        "so that times do not include compilation. Times do not include building the collision checker"
        f"{'' if setup is None else f' (median {_milliseconds(setup.median)} ms)'}."
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
    cells = [_cells(each) for each in figures if each is not None]
    return markdown_table(COLUMNS, cells) if cells else ["No problem has a free start and goal."]


def _cells(figures: PlanFigures) -> list[str]:
    return [
        figures.label,
        f"{figures.solved} of {figures.problems}",
        "" if figures.certified is None else str(figures.certified),
        str(figures.unsafe),
        *(_spread(figures.ms.get(step)) for step in ("total", *STEPS)),
        "" if figures.length is None else f"{figures.length:.2f}",
        "" if figures.length_ratio is None else f"{figures.length_ratio:.3f}",
        "" if figures.duration is None else f"{figures.duration:.2f}",
        "" if figures.clearance is None else f"{1e3 * figures.clearance:.2g}",
        "" if figures.rejected_edges is None else str(figures.rejected_edges),
    ]


def _start_and_goal_faults(table: PlanTable) -> list[str]:
    mesh = (f"{p.name}: {'; '.join(p.mesh_faults)}" for p in table.problems if p.mesh_faults)
    hull = (f"{p.name}: {'; '.join(p.hull_faults)}" for p in table.problems if p.hull_faults and not p.mesh_faults)
    notes = (f"{p.name}: {'; '.join(p.notes)}" for p in table.problems if p.notes)
    return (
        bullet_section("Problems without a free start and goal", mesh)
        + bullet_section("Starts and goals in collision by the convex hulls only", hull)
        + bullet_section("Adapted to the robot", notes)
        + bullet_section("Meshes that are not closed", table.settings["remarks"])
    )


def _spread(spread: Spread | None) -> str:
    if spread is None:
        return ""
    return " / ".join(_milliseconds(value) for value in (spread.median, spread.p95, spread.largest))


def _milliseconds(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"


def _write_time_plot(table: PlanTable, path: Path) -> None:
    """Write the share of problems with a safe motion against the total time as PNG, one panel per collection.

    The curve of a method ends below 100 % if problems were not solved or motions are unsafe.
    """
    columns = min(2, len(table.collections))
    figure, panels = new_figure(-(-len(table.collections) // columns), columns, width=5.2, height=4.4)
    for panel in panels.flat[len(table.collections) :]:
        panel.set_axis_off()
    for panel, collection in zip(panels.flat, table.collections, strict=False):
        largest = 0
        for style, method in zip(STYLES, table.methods, strict=False):
            rows = [row for row in table.rows if (row.collection, row.method) == (collection, method)]
            if not rows:
                continue
            largest = max(largest, len(rows))
            times = np.sort([row.total for row in rows if row.safe])
            share = 100 * np.arange(1, len(times) + 1) / len(rows)
            label = f"{rows[0].label} ({sum(bool(row.faults) for row in rows)} unsafe)"
            panel.step(times, share, style, where="post", label=label, linewidth=1.6)
        log_panel(panel, f"{collection}: {largest} problems", "total time, ms", "safe motions, % of problems")
        panel.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.17))
    figure.savefig(path, dpi=110, format="png")
