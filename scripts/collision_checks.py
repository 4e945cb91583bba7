"""Measurement of collision checks and certificates, compared with Pinocchio and coal on the same pairs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, islice
from pathlib import Path
from time import perf_counter
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from benchmark_page import fastest, report, seconds
from collision_edges import LARGEST, NEAR, EdgeRow, edge_rows, random_configurations, random_orientation

from pinproof.benchmarks.plan_mbm import find_sets, read_problems
from pinproof.benchmarks.plan_problems import OWN_SCENES, PlanProblem, own_problems, own_reach
from pinproof.benchmarks.tables import BenchmarkTable, provenance
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
        if plan.path is None:
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
