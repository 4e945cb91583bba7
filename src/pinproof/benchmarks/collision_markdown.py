"""The table of collision checks and proofs as Markdown."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from pinproof.benchmarks.collision_edges import SAMPLES, STEP, TOLERANCE, EdgeRow
from pinproof.benchmarks.collision_measure import BLOCK, PROOF_REPEATS, REPEATS, CheckRow, Times
from pinproof.benchmarks.collision_table import CollisionTable

__all__ = ["collision_markdown"]

WIDTH = 120
"""Characters of a line of text."""

SINGLE = ("is_free", "check", "clearance", "batch, 1 thread", "2 threads", "coal", "its tree", "times ours")


def collision_markdown(table: CollisionTable) -> str:
    """The whole table."""
    lines = [*_preamble(table), ""]
    if table.checks:
        lines += ["## Checks", "", *_checks_text(), "", *_checks(table.checks), ""]
    if table.growth:
        lines += ["## More and more boxes", "", *_growth(table), ""]
    if table.proofs:
        lines += ["## Proofs of planned paths", "", *_proofs(table), ""]
    if table.edges:
        lines += ["## Random edges, looked at again", "", *_edges(table.edges), ""]
    return "\n".join(lines).rstrip() + "\n"


def _preamble(table: CollisionTable) -> list[str]:
    origin = table.provenance
    versions = ", ".join(f"{name} {version}" for name, version in origin["versions"].items())
    asked = (
        f"Links as convex hulls, seed {origin['seed']}. Calls are timed in blocks of {BLOCK}, each {REPEATS} times (a "
        f"proof {PROOF_REPEATS} times), of which the quickest counts; so what else runs on the machine counts little. "
        "Single calls are from Python with everything included."
    )
    where = (
        f"{versions}, coal {table.settings['coal']}; {origin['cpu']}, {origin['cores']} cores, load {origin['load']}; "
        f"commit {origin['commit']}; {origin['date']}."
    )
    return [*textwrap.wrap(asked, WIDTH), "", *textwrap.wrap(where, WIDTH)]


def _checks_text() -> list[str]:
    text = (
        "Mean times in us at random configurations within the limits: at those that are free / at those in contact. "
        "Beside ours stands Pinocchio's computeCollisions on coal, which stops at the first contact, with the same "
        "bodies and pairs in the same run: looking at every pair, and letting a tree of boxes choose. The last column "
        "is the quicker of both in units of ours."
    )
    return textwrap.wrap(text, WIDTH)


def _checks(rows: Sequence[CheckRow]) -> list[str]:
    columns = ("robot", "scene", "pairs", "free", *SINGLE)
    lines = [_line(columns), _line(["---"] * 2 + ["--:"] * (len(columns) - 2))]
    for row in rows:
        lines.append(
            _line(
                [
                    row.robot,
                    row.scene,
                    f"{row.pairs:,}",
                    f"{100 * row.free_share:.0f} %",
                    *map(_times, (row.is_free, row.check, row.clearance)),
                    f"{row.batch_us:.2f}",
                    f"{row.batch_threads_us:.2f}",
                    _times(row.coal),
                    _times(row.coal_tree),
                    _ratio(row),
                ]
            )
        )
    asked, other, careless = (
        sum(counts) for counts in zip(*((r.configurations, r.otherwise, r.careless) for r in rows), strict=True)
    )
    text = (
        f"Of {asked:,} configurations coal says otherwise at {other}; at {careless} of these it finds a contact where "
        "is_free says free."
    )
    return [*lines, "", *textwrap.wrap(text, WIDTH)]


def _growth(table: CollisionTable) -> list[str]:
    text = (
        f"The {table.growth[0].robot} among boxes that together always fill as much, so the more of them the smaller. "
        "The cost of a check grows far less than their number: a tree of boxes settles those far away at once. "
        "Times as above; set-up is what the checker of another scene takes."
    )
    columns = ("boxes", "pairs", "free", "is_free", "batch, 1 thread", "coal", "its tree", "times ours", "set-up, ms")
    picture = "![Mean time of a check against the number of boxes](collision.png)"
    lines = [*textwrap.wrap(text, WIDTH), "", picture, "", _line(columns), _line(["--:"] * len(columns))]
    for row in table.growth:
        lines.append(
            _line(
                [
                    row.scene.partition(": ")[2],
                    f"{row.pairs:,}",
                    f"{100 * row.free_share:.0f} %",
                    _times(row.is_free),
                    f"{row.batch_us:.2f}",
                    _times(row.coal),
                    _times(row.coal_tree),
                    _ratio(row),
                    f"{row.set_up_ms:.1f}",
                ]
            )
        )
    return lines


def _proofs(table: CollisionTable) -> list[str]:
    text = (
        "Paths by RrtConnect, shortened by shortcut, certified without a margin. Times in ms, one thread, the checker "
        "made before. No peer proves a path."
    )
    columns = (
        "problems",
        "paths",
        "FREE",
        "UNDECIDED",
        "COLLIDING",
        "waypoints",
        "intervals",
        "median",
        "p95",
        "largest",
    )
    lines = [*textwrap.wrap(text, WIDTH), "", _line(columns), _line(["---"] + ["--:"] * (len(columns) - 1))]
    for row in table.proofs:
        numbers = (row.paths, row.free, row.undecided, row.colliding, round(row.waypoints), round(row.intervals))
        times = (row.median_ms, row.p95_ms, row.largest_ms)
        lines.append(_line([row.problems, *map(str, numbers), *(f"{ms:.2f}" for ms in times)]))
    return lines


def _edges(rows: Sequence[EdgeRow]) -> list[str]:
    text = (
        "Straight edges, short and long, in random scenes of one to eight boxes, balls, cylinders, capsules, cones, "
        "ellipsoids and hulls from 2 mm to 0.3 m, under margins of 0, 3 and 20 mm; each is certified to "
        f"{TOLERANCE:g} m. Every FREE is looked at again by Pinocchio and coal alone: distances at {SAMPLES} places, "
        "which have to be what was proven, and contacts of the exact meshes wherever a joint has moved by "
        f"{STEP:g} rad or m. Every COLLIDING has to name a configuration at which coal finds no more than the margin."
    )
    columns = ("robot", "edges", "FREE", "COLLIDING", "UNDECIDED", "mean, ms", "looked at again", "wrong")
    lines = [*textwrap.wrap(text, WIDTH), "", _line(columns), _line(["---"] + ["--:"] * (len(columns) - 1))]
    total = [0] * 6
    for row in rows:
        counts = [row.edges, row.free, row.colliding, row.undecided, row.looks, len(row.wrong)]
        total = [a + b for a, b in zip(total, counts, strict=True)]
        lines.append(_edge_line(row.robot, counts, f"{row.mean_ms:.2f}"))
    lines.append(_edge_line("all", total, ""))
    share = 100 * total[3] / max(total[0], 1)
    lines += ["", f"UNDECIDED: {share:.3f} %."]
    return lines + [f"- WRONG: {said}" for row in rows for said in row.wrong]


def _edge_line(name: str, counts: Sequence[int], mean: str) -> str:
    edges, free, colliding, undecided, looks, wrong = (f"{count:,}" for count in counts)
    return _line([name, edges, free, colliding, undecided, mean, looks, wrong])


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _times(times: Times) -> str:
    return " / ".join("-" if us is None else f"{us:.1f}" for us in (times.free, times.colliding))


def _ratio(row: CheckRow) -> str:
    """Coal's quicker way in units of ours, for free and colliding configurations."""
    said = []
    for name in ("free", "colliding"):
        ours, plain, tree = (getattr(times, name) for times in (row.is_free, row.coal, row.coal_tree))
        said.append("-" if ours is None else f"{min(plain, tree) / ours:.1f}")
    return " / ".join(said)
