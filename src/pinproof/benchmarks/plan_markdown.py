"""The table of planning as Markdown."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable

from pinproof.benchmarks.plan_mbm import COLLECTION
from pinproof.benchmarks.plan_measure import PlanRow
from pinproof.benchmarks.plan_methods import OURS, STEPS
from pinproof.benchmarks.plan_own import MARGIN
from pinproof.benchmarks.plan_scenes import OWN_SCENES
from pinproof.benchmarks.plan_table import PlanFigures, PlanTable, Spread

__all__ = ["COLUMNS", "plan_markdown"]

COLUMNS = (
    "method",
    "solved",
    "certified",
    "unsafe",
    "total",
    *STEPS,
    "length",
    "ours / its",
    "duration, s",
    "clearance, mm",
    "cut edges",
)


WIDTH = 120
"""Characters of a line of text."""


def plan_markdown(table: PlanTable) -> str:
    """The whole table."""
    lines = [*_preamble(table), ""]
    for collection in table.collections:
        lines += [f"## {collection}", "", *_about(table, collection), ""]
        sets = table.sets(collection)
        lines += ["### all sets" if len(sets) > 1 else f"### {sets[0]}", "", *_rows(table, collection), ""]
        for name in sets if len(sets) > 1 else ():
            lines += [f"### {name}", "", *_drawn(collection, name), *_rows(table, collection, name), ""]
    lines += _ends(table) + _unsolved(table) + _faults(table)
    if table.left_out:
        lines += _listed("Left out", (f"{name}: {reason}" for name, reason in table.left_out.items()))
    return "\n".join(lines).rstrip() + "\n"


def _preamble(table: PlanTable) -> list[str]:
    origin, settings = table.provenance, table.settings
    versions = ", ".join(f"{name} {version}" for name, version in origin["versions"].items())
    peers = ", ".join(f"{name} {number}" for name, number in settings["peer_versions"].items() if number is not None)
    repeats = settings["repeats"]
    often = "once" if repeats == 1 else f"{repeats} times, the quickest counts"
    asked = (
        f"{len(table.problems)} problems, seed {origin['seed']}, each asked {often}; a search may take "
        f"{settings['time_limit_s']:g} s. Times are in ms, as median / 95th percentile / largest over the motions "
        "found, in one process and one thread; the first problem of a set is asked once before, so that nothing is "
        f"compiled or loaded while the clock runs. Making a problem's checker ({_setup(table)} ms in the median) is in "
        "no time."
    )
    judged = (
        "Unsafe is what an audit finds that knows of no proof: coal on the links' own meshes at samples between which "
        f"no joint moves more than {settings['audit_step']:g} rad, and whether the motion begins, ends and stays where "
        "it should. Ours is audited as the timed trajectory that would be saved, and the proof is of that. Problems "
        "whose ends touch anything by those meshes are counted nowhere, and named below. Lengths are Euclidean in "
        "joint space, as medians; ours / its is the median of our lengths over that of a peer's, where both found a "
        "motion; clearance is the smallest that is proven of any motion. We plan with the links' hulls, peers with "
        "their meshes, and with the same pairs of links."
    )
    again = [row for row in table.rows if row.method == OURS.key and row.same_again is False]
    same = "" if repeats == 1 else f" The same seed gave the same motion each time{_but(again)}."
    where = (
        f"{versions}{'; peers: ' + peers if peers else ''}; {origin['cpu']}, {origin['cores']} cores, load "
        f"{origin['load']}; commit {origin['commit']}; {origin['date']}."
    )
    return [textwrap.fill(f"{asked} {judged}{same}", WIDTH), "", textwrap.fill(where, WIDTH)]


def _setup(table: PlanTable) -> str:
    spread = Spread.of([problem.setup_ms for problem in table.problems])
    return "" if spread is None else _ms(spread.median)


def _but(rows: list[PlanRow]) -> str:
    return f", but for {', '.join(row.name for row in rows)}" if rows else ""


def _about(table: PlanTable, collection: str) -> list[str]:
    problems = [problem for problem in table.problems if problem.collection == collection]
    touching = sum(bool(problem.exact) for problem in problems)
    hulls = sum(bool(problem.hull) and not problem.exact for problem in problems)
    robots = ", ".join(dict.fromkeys(problem.robot for problem in problems))
    text = (
        f"{len(problems)} problems of {robots}; in {touching} an end touches something or is outside the limits, "
        f"in {hulls} more an end touches by the hulls alone."
    )
    if collection != COLLECTION:
        text += (
            " The scenes are drawn from the seed, sized by the arm's reach r; starts and goals come from inverse "
            f"kinematics, free by {1e3 * MARGIN:g} mm, and the straight way between them touches something."
        )
    return [textwrap.fill(text, WIDTH)]


def _drawn(collection: str, name: str) -> list[str]:
    """What one of our own scenes is, from those who draw it; r is the arm's reach."""
    if collection == COLLECTION or name not in OWN_SCENES:
        return []
    return [textwrap.fill((OWN_SCENES[name].__doc__ or "").strip(), WIDTH), ""]


def _rows(table: PlanTable, collection: str, set_name: str | None = None) -> list[str]:
    found = [table.figures(method, collection, set_name) for method in table.methods]
    cells = [_cells(figures) for figures in found if figures is not None]
    if not cells:
        return ["No problem with free ends."]
    shown = [name for name in COLUMNS if any(cell[name] for cell in cells)]
    return [
        f"| {' | '.join(shown)} |",
        f"|---{'|--:' * (len(shown) - 1)}|",
        *(f"| {' | '.join(cell[name] for name in shown)} |" for cell in cells),
    ]


def _cells(figures: PlanFigures) -> dict[str, str]:
    return {
        "method": figures.label,
        "solved": f"{figures.solved} of {figures.asked}",
        "certified": "" if figures.certified is None else str(figures.certified),
        "unsafe": str(figures.unsafe),
        **{step: _spread(figures.ms.get(step)) for step in ("total", *STEPS)},
        "length": "" if figures.length is None else f"{figures.length:.2f}",
        "ours / its": "" if figures.ours_to_its is None else f"{figures.ours_to_its:.3f}",
        "duration, s": "" if figures.duration is None else f"{figures.duration:.2f}",
        "clearance, mm": "" if figures.clearance is None else f"{1e3 * figures.clearance:.2g}",
        "cut edges": "" if figures.cut is None else str(figures.cut),
    }


def _ends(table: PlanTable) -> list[str]:
    touching = [f"{p.name}: {'; '.join(p.exact)}" for p in table.problems if p.exact]
    hulls = [f"{p.name}: {'; '.join(p.hull)}" for p in table.problems if p.hull and not p.exact]
    changed = [f"{p.name}: {'; '.join(p.notes)}" for p in table.problems if p.notes]
    return (
        _listed("Problems that make no sense: an end touches something", touching)
        + _listed("Ends that touch by the hulls alone", hulls)
        + _listed("Changed to fit the robot", changed)
        + _listed("Meshes that are not closed", table.settings["remarks"])
    )


def _unsolved(table: PlanTable) -> list[str]:
    lines: list[str] = []
    for method in table.methods:
        rows = [row for row in table.rows if row.method == method and (not row.solved or row.certified is False)]
        lines += _listed(
            f"Not solved or not proven: {_label(table, method)}", (f"{row.name}: {row.message}" for row in rows)
        )
    return lines


def _faults(table: PlanTable) -> list[str]:
    lines: list[str] = []
    for method in table.methods:
        rows = [row for row in table.rows if row.method == method and row.faults]
        lines += _listed(f"Unsafe: {_label(table, method)}", (f"{row.name}: {'; '.join(row.faults)}" for row in rows))
    return lines


def _label(table: PlanTable, method: str) -> str:
    return next(row.label for row in table.rows if row.method == method)


def _listed(title: str, entries: Iterable[str]) -> list[str]:
    lines = [f"- {entry}" for entry in entries]
    return [f"## {title}", "", *lines, ""] if lines else []


def _spread(spread: Spread | None) -> str:
    return "" if spread is None else " / ".join(_ms(value) for value in (spread.median, spread.p95, spread.largest))


def _ms(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"
