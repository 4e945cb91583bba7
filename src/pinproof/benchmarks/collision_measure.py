"""Times of checks and proofs, ours beside Pinocchio's and coal's own on the same bodies, pairs and configurations."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.benchmarks.collision_problems import boxes, random_configurations
from pinproof.benchmarks.plan_own import own_reach
from pinproof.benchmarks.plan_problem import PlanProblem
from pinproof.collision import CertificateStatus, CollisionChecker, Scene, certify
from pinproof.collision.coal_checks import PlainCoal
from pinproof.model import Arm
from pinproof.planning import RrtConnect, shortcut

__all__ = ["CheckRow", "ProofRow", "Times", "mean_us", "measure_boxes", "measure_checks", "measure_proofs"]

Array = npt.NDArray[np.float64]

BLOCK, REPEATS = 40, 9
"""Calls are timed in blocks of so many, each so often; the quickest counts. A block is over before a busy machine takes
the core away, so that other people's work is not measured."""

BATCH = 4000
"""Configurations in a batch, at least."""

PATIENCE = 4.0
"""Seconds after which no further block is begun: what is slow is timed at fewer configurations."""

PROOF_REPEATS = 7
"""How often each proof is timed; the quickest counts."""

MICRO, MILLI = 1e6, 1e3


@dataclass(frozen=True)
class Times:
    """Mean times (us) over the configurations that are free, and over those in contact; None where there are none."""

    free: float | None
    colliding: float | None


@dataclass(frozen=True)
class CheckRow:
    """Figures of one arm in one scene.

    Parameters
    ----------
    robot, scene
        Whose, where.
    bodies, pairs
        How many bodies, and pairs of them that are checked.
    configurations, free_share
        Random configurations asked about, and the share of them that is free.
    otherwise, careless
        Configurations at which coal says otherwise, and those of them at which it finds a contact where we do not.
    set_up_ms
        To make the checker where one of the same arm has been made before.
    is_free, check, clearance
        Single calls from Python, everything included.
    batch_us, batch_threads_us
        Of ``is_free_batch``, a configuration, on one thread and on two.
    coal, coal_tree
        Pinocchio's ``computeCollisions`` until the first contact, looking at every pair and at those that a tree of
        boxes chooses.
    coal_distances
        Pinocchio's ``computeDistances``.
    """

    robot: str
    scene: str
    bodies: int
    pairs: int
    configurations: int
    free_share: float
    otherwise: int
    careless: int
    set_up_ms: float
    is_free: Times
    check: Times
    clearance: Times
    batch_us: float
    batch_threads_us: float
    coal: Times
    coal_tree: Times
    coal_distances: Times


@dataclass(frozen=True)
class ProofRow:
    """Proofs of planned and shortened paths: how many there were, their verdicts, and times (ms)."""

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


def measure_checks(robot: str, arm: Arm, scene: Scene, name: str, count: int, seed: int) -> CheckRow:
    """Time every kind of check at ``count`` random configurations of an arm in a scene."""
    CollisionChecker(arm, scene)
    began = perf_counter()
    checker = CollisionChecker(arm, scene)
    set_up = perf_counter() - began
    many = random_configurations(arm, count, np.random.default_rng(seed))
    free = checker.is_free_batch(many)
    plain, tree = PlainCoal(checker), PlainCoal(checker, broadphase=True)
    theirs = plain.configurations(many)
    says_free = np.array([[peer.is_free(q) for q in theirs] for peer in (plain, tree)])
    return CheckRow(
        robot=robot,
        scene=name,
        bodies=len(checker.bodies),
        pairs=len(checker.pairs),
        configurations=count,
        free_share=float(free.mean()),
        otherwise=int((says_free != free).any(axis=0).sum()),
        careless=int((free & ~says_free).any(axis=0).sum()),
        set_up_ms=MILLI * set_up,
        is_free=_times(checker.is_free, list(many), free),
        check=_times(checker.check, list(many), free),
        clearance=_times(checker.clearance, list(many), free),
        batch_us=_batch_us(checker, many, 1),
        batch_threads_us=_batch_us(checker, many, 2),
        coal=_times(plain.is_free, theirs, free),
        coal_tree=_times(tree.is_free, theirs, free),
        coal_distances=_times(plain.clearance, theirs, free),
    )


def measure_boxes(robot: str, arm: Arm, counts: Sequence[int], count: int, seed: int) -> list[CheckRow]:
    """The same among growing numbers of boxes that always fill as much."""
    reach = own_reach(arm)
    return [
        measure_checks(robot, arm, boxes(number, reach, seed), f"boxes: {number:,}", count, seed) for number in counts
    ]


def measure_proofs(name: str, problems: Iterable[PlanProblem], seed: int) -> ProofRow | None:
    """Plan and shorten a path of each problem, and time its proof; None if no problem was solved."""
    times, verdicts, intervals, waypoints = [], [], [], []
    for problem in problems:
        checker = CollisionChecker(problem.arm, problem.scene)
        found = RrtConnect().plan(checker, problem.start, problem.goals, rng=seed)
        if found.path is None:
            continue
        path = shortcut(found.path, checker, rng=seed)
        certificate = certify(path, checker)
        verdicts.append(certificate.status)
        intervals.append(certificate.intervals)
        waypoints.append(len(path.q))
        prove = partial(certify, path, checker)
        times.append(MILLI * min(_once(prove) for _ in range(PROOF_REPEATS)))
    if not times:
        return None
    return ProofRow(
        name,
        len(times),
        verdicts.count(CertificateStatus.FREE),
        verdicts.count(CertificateStatus.UNDECIDED),
        verdicts.count(CertificateStatus.COLLIDING),
        float(np.median(waypoints)),
        float(np.median(intervals)),
        float(np.median(times)),
        float(np.quantile(times, 0.95)),
        max(times),
    )


def mean_us(call: Callable[[Any], object], items: Sequence[Any]) -> float:
    """The mean time (us) of a call over items, in blocks whose quickest run counts."""
    call(items[0])  # compiled code is loaded, workspaces are made
    total, done, began = 0.0, 0, perf_counter()
    for start in range(0, len(items), BLOCK):
        if perf_counter() - began > PATIENCE:
            break
        block = items[start : start + BLOCK]
        times = [_once(partial(_each, call, block))]
        while len(times) < REPEATS and sum(times) < PATIENCE / 10:
            times.append(_once(partial(_each, call, block)))
        total, done = total + min(times), done + len(block)
    return MICRO * total / done


def _times(call: Callable[[Any], object], items: Sequence[Any], free: npt.NDArray[np.bool_]) -> Times:
    """Over the free ones, and over the others."""
    parts = [[items[i] for i in np.flatnonzero(free == wanted).tolist()] for wanted in (True, False)]
    return Times(*(mean_us(call, part) if part else None for part in parts))


def _batch_us(checker: CollisionChecker, many: Array, threads: int) -> float:
    """A configuration of a batch."""
    many = np.tile(many, (-(-BATCH // len(many)), 1))
    ask = partial(checker.is_free_batch, many, threads=threads)
    ask()
    return MICRO * min(_once(ask) for _ in range(REPEATS)) / len(many)


def _each(call: Callable[[Any], object], items: Iterable[Any]) -> None:
    for item in items:
        call(item)


def _once(call: Callable[[], object]) -> float:
    began = perf_counter()
    call()
    return perf_counter() - began
