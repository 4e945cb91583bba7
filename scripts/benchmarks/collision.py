"""Benchmark of collision checks and certificates.

./scripts/benchmark collision                        checks and certificates in our scenes; prints the table
./scripts/benchmark collision --mbm FOLDER           also on MotionBenchMaker problems
./scripts/benchmark collision --edges 10000          also certifies random edges and checks every verdict
./scripts/benchmark collision --only-edges 10000     only random edges
./scripts/benchmark collision --mbm FOLDER --edges 10000 --docs    rewrites docs/benchmarks/collision.*
./scripts/benchmark collision --render               rewrites the page and the plot from collision.json

The checks take about two minutes, 10,000 edges some more. Exit code 1 if a verdict on an edge is wrong.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, islice
from pathlib import Path
from time import perf_counter
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from benchmarks.collision_edges import (
    AUDIT_STEP,
    LARGEST,
    NEAR,
    SAMPLES,
    TOLERANCE,
    EdgeRow,
    edge_rows,
    edge_table,
    random_configurations,
    random_orientation,
    total_row,
)
from benchmarks.planning_problems import OWN_SCENES, PlanProblem, find_sets, own_problems, own_reach, read_problems
from benchmarks.tables import (
    BenchmarkTable,
    bullet_section,
    fastest,
    log_panel,
    new_figure,
    page_parser,
    provenance,
    provenance_text,
    report,
    row_table,
    run,
    save_figure,
    seconds,
    wrapped,
)
from pinproof.collision import Box, CertificateStatus, CollisionChecker, Obstacle, Scene, certify
from pinproof.collision.checking.coal_checks import PlainCoal
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


@dataclass(frozen=True)
class Times:
    """Mean times (us) over the free configurations and over those in collision; None if there are none."""

    free: float | None
    colliding: float | None

    def __str__(self) -> str:
        return " / ".join("-" if us is None else f"{us:.1f}" for us in (self.free, self.colliding))


@dataclass(frozen=True)
class CheckRow:
    """The figures of one arm in one scene.

    Parameters
    ----------
    robot, scene, bodies, pairs
        The arm, the scene, and the numbers of bodies and of checked pairs.
    configurations, free_share
        Number of random configurations, and the share of free ones.
    disagreements, missed_contacts
        Configurations at which coal and ``is_free`` disagree, and those of them at which only coal finds a contact.
    setup_ms
        Time to build the checker if one of the same arm was built before.
    is_free, check, clearance
        Single calls from Python.
    batch_us, batch_threads_us
        ``is_free_batch`` per configuration on one thread and on two.
    coal, coal_tree
        Pinocchio's ``computeCollisions`` until the first contact, over all pairs and with a broad phase.
    """

    robot: str
    scene: str
    bodies: int
    pairs: int
    configurations: int
    free_share: float
    disagreements: int
    missed_contacts: int
    setup_ms: float
    is_free: Times
    check: Times
    clearance: Times
    batch_us: float
    batch_threads_us: float
    coal: Times
    coal_tree: Times


@dataclass(frozen=True)
class ProofRow:
    """Certificates of planned and shortened paths: number of paths, verdicts, medians, and times (ms)."""

    problems: str
    paths: int
    free: int
    undecided: int
    colliding: int
    waypoints: float
    intervals: float
    median_ms: float
    p95_ms: float
    largest_ms: float


def check_row(**values: Any) -> CheckRow:
    """Return a row from the values in a JSON file."""
    return CheckRow(**{name: Times(**value) if isinstance(value, dict) else value for name, value in values.items()})


@dataclass(frozen=True)
class CollisionTable(BenchmarkTable):
    """Checks in scenes, checks among growing numbers of boxes, certificates of paths, and certificates of edges."""

    checks: tuple[CheckRow, ...]
    growth: tuple[CheckRow, ...]
    proofs: tuple[ProofRow, ...]
    edges: tuple[EdgeRow, ...]

    topic: ClassVar[str] = "collision checks"
    row_types: ClassVar[dict[str, Callable[..., Any]]] = {
        "checks": check_row,
        "growth": check_row,
        "proofs": ProofRow,
        "edges": EdgeRow,
    }

    @property
    def wrong(self) -> tuple[str, ...]:
        """The verdicts on edges that the independent check contradicts."""
        return tuple(error for row in self.edges for error in row.wrong)


def collision_benchmark(
    robots: Sequence[str] = ROBOTS,
    *,
    mbm: str | Path | None = None,
    problems: int | None = None,
    configurations: int = CONFIGURATIONS,
    box_counts: Sequence[int] = BOX_COUNTS,
    edges: int = 0,
    seed: int = 0,
) -> CollisionTable:
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
    verdicts = edge_rows(edges, seed)
    return CollisionTable(settings, origin, tuple(checks), tuple(growth), tuple(proofs), tuple(verdicts))


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


def measure_checks(arm: Arm, scene: Scene, name: str, count: int, seed: int) -> CheckRow:
    """Time all kinds of checks at random configurations of an arm in a scene."""
    CollisionChecker(arm, scene)
    begin = perf_counter()
    checker = CollisionChecker(arm, scene)
    setup = perf_counter() - begin
    q = random_configurations(arm, count, np.random.default_rng(seed))
    free = checker.is_free_batch(q)
    plain, tree = PlainCoal(checker), PlainCoal(checker, broadphase=True)
    coal_q = plain.configurations(q)
    coal_free = np.array([[coal.is_free(each) for each in coal_q] for coal in (plain, tree)])
    return CheckRow(
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


def measure_proofs(name: str, problems: Iterable[PlanProblem], seed: int) -> ProofRow | None:
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
    return ProofRow(
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


def _times(call: Callable[[Any], object], items: Sequence[Any], free: npt.NDArray[np.bool_]) -> Times:
    parts = [[items[i] for i in np.flatnonzero(free == wanted).tolist()] for wanted in (True, False)]
    return Times(*(_mean_us(call, part) if part else None for part in parts))


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


def write_collision_table(table: CollisionTable, folder: str | Path) -> list[Path]:
    """Write ``collision.json``, ``collision.md`` and, if checks among boxes were measured, ``collision.png``."""
    written = table.write(folder, "collision", "# Collision check benchmark\n\n" + collision_markdown(table))
    if table.growth:
        written.append(save_figure(_growth_plot(table), Path(folder) / "collision.png"))
    return written


def collision_markdown(table: CollisionTable) -> str:
    """Return the table as Markdown, without a title."""
    text = (
        f"Links are convex hulls. Calls are timed in blocks of {BLOCK}, each {REPEATS} times (a certificate "
        f"{PROOF_REPEATS} times), and the fastest run counts, which reduces the influence of other processes. Single "
        "calls are from Python including all overhead."
    )
    lines = [*wrapped(text), "", *wrapped(provenance_text(table)), ""]
    if table.checks:
        lines += ["## Checks", "", *_checks(table.checks), ""]
    if table.growth:
        lines += ["## Number of obstacles", "", *_growth(table.growth), ""]
    if table.proofs:
        lines += ["## Certificates of planned paths", "", *_proofs(table), ""]
    if table.edges:
        lines += ["## Certificates of random edges", "", *_edges(table.edges), ""]
    lines += bullet_section("Wrong verdicts", table.wrong)
    return "\n".join(lines).rstrip() + "\n"


def _checks(rows: Sequence[CheckRow]) -> list[str]:
    text = (
        "Mean times in us at random configurations within the limits: free ones / ones in collision. For comparison, "
        "Pinocchio's computeCollisions with coal, which stops at the first contact, was measured in the same run with "
        "the same bodies and pairs: with all pairs, and with a broad phase (a dynamic AABB tree). The speed-up is the "
        "time of the faster of these two divided by that of is_free."
    )
    columns = {
        "robot": "{.robot}",
        "scene": "{.scene}",
        "pairs": "{.pairs:,}",
        "free": _free,
        "is_free": "{.is_free}",
        "check": "{.check}",
        "clearance": "{.clearance}",
        "batch, 1 thread": "{.batch_us:.2f}",
        "2 threads": "{.batch_threads_us:.2f}",
        "coal, all pairs": "{.coal}",
        "coal, broad phase": "{.coal_tree}",
        "speed-up": _speed_up,
    }
    agreement = (
        f"is_free and coal disagree at {sum(r.disagreements for r in rows)} of {sum(r.configurations for r in rows):,} "
        f"configurations; at {sum(r.missed_contacts for r in rows)} of these only coal finds a contact."
    )
    return [*wrapped(text), "", *row_table(columns, rows, text_columns=2), "", *wrapped(agreement)]


def _growth(rows: Sequence[CheckRow]) -> list[str]:
    text = (
        f"The {rows[0].robot} among boxes whose total volume is constant: more boxes are smaller. The time of a check "
        "grows much more slowly than their number, since a bounding volume hierarchy excludes distant boxes. Times as "
        "above; set-up is the time to build the checker of another scene."
    )
    columns = {
        "boxes": lambda row: row.scene.partition(": ")[2],
        "pairs": "{.pairs:,}",
        "free": _free,
        "is_free": "{.is_free}",
        "batch, 1 thread": "{.batch_us:.2f}",
        "coal, all pairs": "{.coal}",
        "coal, broad phase": "{.coal_tree}",
        "speed-up": _speed_up,
        "set-up, ms": "{.setup_ms:.1f}",
    }
    picture = "![Mean time of a check against the number of boxes](collision.png)"
    return [*wrapped(text), "", picture, "", *row_table(columns, rows, text_columns=0)]


def _proofs(table: CollisionTable) -> list[str]:
    text = (
        "Paths planned by RrtConnect and shortened by shortcut, certified with a margin of 0. Times in ms on one "
        "thread, without building the checker. No peer measured here proves a path; [HPP and Drake](../comparison.md) "
        "do."
    )
    columns = {
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
    return [*wrapped(text), "", *row_table(columns, table.proofs)]


def _edges(rows: Sequence[EdgeRow]) -> list[str]:
    text = (
        "Straight edges of different lengths in random scenes of one to eight boxes, spheres, cylinders, capsules, "
        "cones, ellipsoids and convex hulls from 2 mm to 0.3 m, with margins of 0, 3 and 20 mm; the tolerance of the "
        f"certificates is {TOLERANCE:g} m. Every FREE verdict is checked again by Pinocchio and coal only: the "
        f"distances at {SAMPLES} samples must not be below the proven clearance, and the exact meshes must not collide "
        f"at samples at most {AUDIT_STEP:g} rad or m apart. Every COLLIDING verdict must name a configuration at which "
        "coal finds a distance not larger than the margin."
    )
    total = total_row(rows)
    undecided = f"UNDECIDED: {100 * total.undecided / max(total.edges, 1):.3f} %."
    return [*wrapped(text), "", *edge_table("robot", [*rows, total]), "", undecided]


def _free(row: CheckRow) -> str:
    return f"{100 * row.free_share:.0f} %"


def _speed_up(row: CheckRow) -> str:
    """For free and colliding configurations."""
    ratios = []
    for name in ("free", "colliding"):
        ours, plain, tree = (getattr(times, name) for times in (row.is_free, row.coal, row.coal_tree))
        ratios.append("-" if ours is None else f"{min(plain, tree) / ours:.1f}")
    return " / ".join(ratios)


def _growth_plot(table: CollisionTable) -> Any:
    """The time of a check against the number of boxes."""
    figure, ((panel,),) = new_figure(1, 1, width=7.2, height=4.6)
    counts = [int(row.scene.partition(": ")[2].replace(",", "")) for row in table.growth]
    for name, label, colour in CURVES:
        times = [getattr(row, name) for row in table.growth]
        panel.plot(counts, [each.free for each in times], "o-", color=colour, label=f"{label}: free")
        colliding = [each.colliding for each in times]
        panel.plot(counts, colliding, "s--", color=colour, fillstyle="none", label="... in collision")
    first = table.growth[0].is_free.free
    if first is not None:
        panel.plot(counts, [first * count / counts[0] for count in counts], ":", color="grey", label="proportional")
        panel.set_ylim(first / 3, None)
    title = f"{table.growth[0].robot}: time of a check against the number of boxes"
    log_panel(panel, title, "boxes around the arm", "mean time of a single check, us", percent=False)
    panel.set_yscale("log")
    panel.set_xticks(counts, [f"{count:,}" for count in counts])
    panel.legend(fontsize=8, loc="upper left")
    return figure


def measure(options: argparse.Namespace) -> CollisionTable:
    """Return the parts of the table that the options select."""
    if options.only_edges:
        return collision_benchmark((), box_counts=(), edges=options.only_edges, seed=options.seed)
    given = {"mbm": options.mbm, "problems": options.problems, "edges": options.edges, "seed": options.seed}
    return collision_benchmark(options.robots or ROBOTS, **given)


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = page_parser(__doc__, "collision")
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help="arms in our scenes")
    parser.add_argument("--mbm", type=Path, metavar="FOLDER", help="MotionBenchMaker problems")
    parser.add_argument("--problems", type=int, metavar="N", help="largest number of problems per set")
    parser.add_argument("--edges", type=int, default=0, metavar="N", help="number of random edges to certify and check")
    parser.add_argument("--only-edges", type=int, metavar="N", help="certify and check random edges only")
    run(parser, "collision", CollisionTable, measure, collision_markdown, write_collision_table)
