"""Benchmark of collision checks and certificates.

./scripts/benchmark collision                        checks and certificates in our scenes; prints the table
./scripts/benchmark collision --mbm FOLDER           also on MotionBenchMaker problems
./scripts/benchmark collision --edges 10000          also certifies random edges and checks every verdict
./scripts/benchmark collision --only-edges 10000     only random edges
./scripts/benchmark collision --mbm FOLDER --edges 10000 --docs    rewrites docs/benchmarks/collision.*

The checks take about two minutes, 10,000 edges some more. Exit code 1 if a verdict on an edge is wrong.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import chain, islice
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.collision_edges import (
    LARGEST,
    NEAR,
    edge_rows,
    edge_table,
    random_configurations,
    random_orientation,
    total_row,
)
from benchmarks.plain_coal import PlainCoal
from benchmarks.planning_problems import OWN_SCENES, PlanProblem, find_sets, own_problems, own_reach, read_problems
from benchmarks.tables import (
    Benchmark,
    Blocks,
    Results,
    Row,
    fastest,
    log_panel,
    new_figure,
    page_parser,
    provenance,
    report,
    row_table,
    seconds,
    wrapped,
)
from pinproof.collision import Box, CertificateStatus, CollisionChecker, Obstacle, Scene, certify
from pinproof.errors import InputError
from pinproof.model import Arm, load_robot
from pinproof.planning import RrtConnect, shortcut

Array = npt.NDArray[np.float64]

ROBOTS = ("ur5", "panda")
"""The arms in our scenes."""

BOX_COUNTS, BOX_ROBOT = (1, 10, 100, 1000), "panda"
"""Numbers of boxes for the scaling of the check time, and the arm among them."""

BOXES_OF_FULL_SIZE = 10
"""Up to this number boxes have the largest size; more boxes are smaller, so that their total volume is constant."""

OWN_PROBLEMS = 5
"""Problems per scene of ours."""

CONFIGURATIONS = 500
"""Random configurations per scene."""

BLOCK, REPEATS = 40, 9
"""Calls are timed in blocks of this size, each several times, and the fastest run counts. A block is short enough that
other processes rarely interrupt it."""

BATCH = 4000
"""Smallest number of configurations in a batch."""

TIME_LIMIT = 4.0
"""Seconds after which no further block starts: slow calls are timed at fewer configurations."""

PROOF_REPEATS = 7
"""Runs of each certificate; the fastest counts."""


def collision_benchmark(
    robots: Sequence[str] = ROBOTS,
    *,
    mbm: str | Path | None = None,
    problems: int | None = None,
    configurations: int = CONFIGURATIONS,
    box_counts: Sequence[int] = BOX_COUNTS,
    edges: int = 0,
    seed: int = 0,
) -> Results:
    """Run the benchmark: checks in the first problem of each set, certificates of the paths of all problems.

    ``problems`` is the largest number of problems per set, by default all of MotionBenchMaker and 5 of ours; ``edges``
    is the number of random edges over five robots.
    """
    if configurations < 1 or edges < 0 or any(count < 1 for count in box_counts):
        raise InputError("configurations and box_counts must be at least 1, edges at least 0")
    origin = provenance(seed)
    sources: dict[str, list[Callable[[], Iterator[PlanProblem]]]] = {}
    for mbm_set in [] if mbm is None else find_sets(mbm):
        sources.setdefault("mbm", []).append(partial(read_problems, mbm_set, problems))
    for name in robots:
        count = problems or OWN_PROBLEMS
        sources[f"{name}, own scenes"] = [partial(own_problems, name, scene, count, seed) for scene in OWN_SCENES]
    checks, proofs = [], []
    for collection, sets in sources.items():
        for read in sets:
            for problem in islice(read(), 1):
                report(f"checks: {problem.full_set}")
                checks.append(measure_checks(problem.arm, problem.scene, problem.full_set, configurations, seed))
        report(f"certificates: {collection}")
        row = measure_proofs(collection, chain.from_iterable(read() for read in sets), seed)
        proofs += [] if row is None else [row]
    growth = []
    for count in box_counts:
        report(f"boxes: {count}")
        arm = load_robot(BOX_ROBOT).arm()
        scene = boxes(count, own_reach(arm), seed)
        growth.append(measure_checks(arm, scene, f"boxes: {count:,}", configurations, seed))
    settings = {
        "robots": list(robots),
        "mbm": mbm is not None,
        "problems": problems,
        "configurations": configurations,
        "boxes": list(box_counts),
        "edges": edges,
    }
    parts = {"checks": checks, "growth": growth, "proofs": proofs, "edges": edge_rows(edges, seed)}
    return Results(settings, origin, parts)


def boxes(count: int, reach: float, seed: int) -> Scene:
    """Return boxes around an arm with this reach (m), whose total volume does not depend on their number."""
    rng = np.random.default_rng([seed, count])
    largest = LARGEST * reach * min(1.0, (BOXES_OF_FULL_SIZE / count) ** (1 / 3))
    obstacles: list[Obstacle] = []
    while len(obstacles) < count:
        position = rng.uniform((-1, -1, 0), (1, 1, 1)) * reach
        if np.hypot(position[0], position[1]) > NEAR * reach:
            sides = (largest * rng.uniform(0.3, 1.0, 3)).tolist()
            obstacles.append(Obstacle(f"box_{len(obstacles)}", Box(*sides), random_orientation(position, rng)))
    return Scene(obstacles)


def measure_checks(arm: Arm, scene: Scene, name: str, count: int, seed: int) -> Row:
    """Time all kinds of checks at random configurations of an arm in a scene.

    Times are means in us over the free configurations and over those in collision. ``coal`` is Pinocchio's
    ``computeCollisions`` until the first contact over all pairs, ``coal_tree`` with a broad phase; ``disagreements``
    are configurations at which it and ``is_free`` disagree, and ``missed_contacts`` those where only coal finds one.
    """
    CollisionChecker(arm, scene)
    begin = perf_counter()
    checker = CollisionChecker(arm, scene)
    setup = perf_counter() - begin
    q = random_configurations(arm, count, np.random.default_rng(seed))
    free = checker.is_free_batch(q)
    plain, tree = PlainCoal(checker), PlainCoal(checker, broadphase=True)
    coal_q = plain.configurations(q)
    coal_free = np.array([[coal.is_free(each) for each in coal_q] for coal in (plain, tree)])
    return Row(
        robot=arm.robot.name,
        scene=name,
        bodies=len(checker.bodies),
        pairs=len(checker.pairs),
        configurations=count,
        free_share=float(free.mean()),
        disagreements=int((coal_free != free).any(axis=0).sum()),
        missed_contacts=int((free & ~coal_free).any(axis=0).sum()),
        setup_ms=1e3 * setup,
        is_free=_times(checker.is_free, list(q), free),
        check=_times(checker.check, list(q), free),
        clearance=_times(checker.clearance, list(q), free),
        batch_us=_batch_us(checker, q, 1),
        batch_threads_us=_batch_us(checker, q, 2),
        coal=_times(plain.is_free, coal_q, free),
        coal_tree=_times(tree.is_free, coal_q, free),
    )


def measure_proofs(name: str, problems: Iterable[PlanProblem], seed: int) -> Row | None:
    """Plan and shorten a path for each problem, and time its certificate; None if no problem was solved."""
    times, certificates, waypoints = [], [], []
    for problem in problems:
        checker = CollisionChecker(problem.arm, problem.scene)
        plan = RrtConnect().plan(checker, problem.start, problem.goals, rng=seed)
        if not plan.ok:
            continue
        path = shortcut(plan.path, checker, rng=seed)
        certificates.append(certify(path, checker))
        waypoints.append(len(path.q))
        times.append(1e3 * fastest(partial(certify, path, checker), PROOF_REPEATS, perf_counter))
    if not times:
        return None
    verdicts = [certificate.status for certificate in certificates]
    return Row(
        problems=name,
        paths=len(times),
        free=verdicts.count(CertificateStatus.FREE),
        undecided=verdicts.count(CertificateStatus.UNDECIDED),
        colliding=verdicts.count(CertificateStatus.COLLIDING),
        waypoints=float(np.median(waypoints)),
        intervals=float(np.median([certificate.intervals for certificate in certificates])),
        median_ms=float(np.median(times)),
        p95_ms=float(np.quantile(times, 0.95)),
        largest_ms=max(times),
    )


def _times(call: Callable[[Any], object], items: Sequence[Any], free: npt.NDArray[np.bool_]) -> dict[str, float | None]:
    """The mean times (us) over the free configurations and over those in collision; None if there are none."""
    parts = {"free": np.flatnonzero(free), "colliding": np.flatnonzero(~free)}
    return {
        kind: _mean_us(call, [items[i] for i in part.tolist()]) if len(part) else None for kind, part in parts.items()
    }


def _mean_us(call: Callable[[Any], object], items: Sequence[Any]) -> float:
    """Mean time (us) of a call over the items, in blocks of which the fastest run counts."""
    call(items[0])  # loads compiled code
    total, done, begin = 0.0, 0, perf_counter()
    for start in range(0, len(items), BLOCK):
        if perf_counter() - begin > TIME_LIMIT:
            break
        block = items[start : start + BLOCK]
        times: list[float] = []
        while not times or (len(times) < REPEATS and sum(times) < TIME_LIMIT / 10):
            times.append(seconds(lambda block=block: [call(item) for item in block], perf_counter))
        total, done = total + min(times), done + len(block)
    return 1e6 * total / done


def _batch_us(checker: CollisionChecker, q: Array, threads: int) -> float:
    """Time per configuration (us) of ``is_free_batch``."""
    q = np.tile(q, (-(-BATCH // len(q)), 1))
    call = partial(checker.is_free_batch, q, threads=threads)
    call()
    return 1e6 * fastest(call, REPEATS, perf_counter) / len(q)


CURVES = (
    ("is_free", "pinproof, is_free", "C0"),
    ("coal", "coal with Pinocchio, all pairs", "C3"),
    ("coal_tree", "coal with Pinocchio, broad phase", "C1"),
)
"""The fields, labels and colours of the curves in the plot."""


def blocks(results: Results) -> Blocks:
    """The tables of the page."""

    def times(name: str) -> Callable[[Row], str]:
        return lambda row: " / ".join("-" if us is None else f"{us:.1f}" for us in getattr(row, name).values())

    def speed_up(row: Row) -> str:
        pairs = [(row.is_free[kind], row.coal[kind], row.coal_tree[kind]) for kind in ("free", "colliding")]
        return " / ".join("-" if ours is None else f"{min(others) / ours:.1f}" for ours, *others in pairs)

    compared = {
        "is_free": times("is_free"),
        "check": times("check"),
        "clearance": times("clearance"),
        "batch, 1 thread": "{.batch_us:.2f}",
        "2 threads": "{.batch_threads_us:.2f}",
        "coal, all pairs": times("coal"),
        "coal, broad phase": times("coal_tree"),
        "speed-up": speed_up,
    }
    common = {"pairs": "{.pairs:,}", "free": lambda row: f"{100 * row.free_share:.0f} %"}
    growth = {
        "boxes": lambda row: row.scene.partition(": ")[2],
        **common,
        **{title: compared[title] for title in compared if title not in ("check", "clearance", "2 threads")},
        "set-up, ms": "{.setup_ms:.1f}",
    }
    proofs = {
        "problems": "{.problems}",
        "paths": "{.paths}",
        "FREE": "{.free}",
        "UNDECIDED": "{.undecided}",
        "COLLIDING": "{.colliding}",
        "median waypoints": "{.waypoints:.0f}",
        "median intervals": "{.intervals:.0f}",
        "median": "{.median_ms:.2f}",
        "p95": "{.p95_ms:.2f}",
        "maximum": "{.largest_ms:.2f}",
    }
    rows, edges = results["checks"], results["edges"]
    agreement = (
        f"is_free and coal disagree at {sum(r.disagreements for r in rows)} of {sum(r.configurations for r in rows):,} "
        f"configurations; at {sum(r.missed_contacts for r in rows)} of these only coal finds a contact."
    )
    total = total_row(edges)
    undecided = f"UNDECIDED: {100 * total.undecided / max(total.edges, 1):.3f} %."
    checks = row_table({"robot": "{.robot}", "scene": "{.scene}", **common, **compared}, rows, text_columns=2)
    return {
        "checks": [*checks, "", *wrapped(agreement)] if rows else [],
        "growth": row_table(growth, results["growth"], text_columns=0),
        "proofs": row_table(proofs, results["proofs"]),
        "edges": [*edge_table("robot", [*edges, total]), "", undecided] if edges else [],
    }


def figures(results: Results) -> dict[str, Any]:
    """The time of a check against the number of boxes."""
    rows = results["growth"]
    figure, ((panel,),) = new_figure(1, 1, width=7.2, height=4.6)
    counts = [int(row.scene.partition(": ")[2].replace(",", "")) for row in rows]
    for name, label, colour in CURVES:
        times = [getattr(row, name) for row in rows]
        panel.plot(counts, [each["free"] for each in times], "o-", color=colour, label=f"{label}: free")
        colliding = [each["colliding"] for each in times]
        panel.plot(counts, colliding, "s--", color=colour, fillstyle="none", label="... in collision")
    first = rows[0].is_free["free"]
    if first is not None:
        panel.plot(counts, [first * count / counts[0] for count in counts], ":", color="grey", label="proportional")
        panel.set_ylim(first / 3, None)
    title = f"{rows[0].robot}: time of a check against the number of boxes"
    log_panel(panel, title, "boxes around the arm", "mean time of a single check, us", percent=False)
    panel.set_yscale("log")
    panel.set_xticks(counts, [f"{count:,}" for count in counts])
    panel.legend(fontsize=8, loc="upper left")
    return {"collision.png": figure}


def measure(options: argparse.Namespace) -> Results:
    """Measure the parts that the options select."""
    if options.only_edges:
        return collision_benchmark((), box_counts=(), edges=options.only_edges, seed=options.seed)
    given = {"mbm": options.mbm, "problems": options.problems, "edges": options.edges, "seed": options.seed}
    return collision_benchmark(options.robots or ROBOTS, **given)


BENCHMARK = Benchmark("collision", measure, blocks, figures)


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = page_parser(__doc__, "collision")
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help="arms in our scenes")
    parser.add_argument("--mbm", type=Path, metavar="FOLDER", help="MotionBenchMaker problems")
    parser.add_argument("--problems", type=int, metavar="N", help="largest number of problems per set")
    parser.add_argument("--edges", type=int, default=0, metavar="N", help="number of random edges to certify and check")
    parser.add_argument("--only-edges", type=int, metavar="N", help="certify and check random edges only")
    BENCHMARK.run(parser)
