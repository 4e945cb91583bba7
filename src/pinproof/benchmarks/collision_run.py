"""A run of the table of collision checks and proofs, in one process."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version
from itertools import chain, islice
from pathlib import Path

from pinproof.benchmarks.collision_edges import EDGE_ROBOTS, EdgeRow, audited_edges
from pinproof.benchmarks.collision_measure import CheckRow, measure_boxes, measure_checks, measure_proofs
from pinproof.benchmarks.collision_table import CollisionTable
from pinproof.benchmarks.plan_mbm import find_sets, read_problems
from pinproof.benchmarks.plan_own import own_problems
from pinproof.benchmarks.plan_problem import PlanProblem
from pinproof.benchmarks.plan_scenes import OWN_SCENES
from pinproof.benchmarks.provenance import provenance
from pinproof.errors import InputError
from pinproof.model import load_robot

__all__ = ["BOXES", "collision_benchmark", "edge_rows"]

ROBOTS = ("ur5", "panda")
"""The arms that are put into our own scenes."""

BOXES = (1, 10, 100, 1000)

GROWTH_ROBOT = "panda"

CONFIGURATIONS = 500
"""At which every check is asked."""


def collision_benchmark(
    robots: Sequence[str] = ROBOTS,
    *,
    mbm: str | Path | None = None,
    problems: int | None = None,
    configurations: int = CONFIGURATIONS,
    boxes: Sequence[int] = BOXES,
    edges: int = 0,
    seed: int = 0,
    on_progress: Callable[[str], None] | None = None,
) -> CollisionTable:
    """Run the table.

    Parameters
    ----------
    robots
        Catalogue names or robot files, which are put into our own scenes.
    mbm
        A folder of MotionBenchMaker problems (:mod:`pinproof.benchmarks.plan_mbm`): in the first scene of each set
        checks are timed, and the paths of all problems are proven.
    problems
        The first so many of each set, and of each of our own scenes; by default all there are, and 5 of our own.
    configurations
        At which each check is asked.
    boxes
        The numbers of boxes among which the cost of a check is followed.
    edges
        Random edges to prove and to look at again, over five robots; none by default, for it takes minutes.
    seed
        Of all that is drawn.
    on_progress
        Called with what is being run.

    Raises
    ------
    InputError
        For an unknown robot, or numbers that are too small.
    FileError
        For a folder or a file of problems that cannot be used.
    """
    if configurations < 1 or edges < 0 or any(count < 1 for count in boxes):
        raise InputError("at least one configuration and one box are needed, and no number is negative")
    tell = on_progress or (lambda _: None)
    origin = provenance(seed)
    sources: dict[str, list[Callable[[], Iterator[PlanProblem]]]] = {}
    for found in [] if mbm is None else find_sets(mbm):
        sources.setdefault("mbm", []).append(lambda found=found: read_problems(found, problems))  # type: ignore[misc]
    for name in robots:
        sources[f"{name}, own scenes"] = [
            lambda name=name, scene=scene: own_problems(name, scene, problems or 5, seed)  # type: ignore[misc]
            for scene in OWN_SCENES
        ]
    checks, proofs = [], []
    for collection, sets in sources.items():
        for read in sets:
            for problem in islice(read(), 1):
                tell(f"checks: {problem.full_set}")
                robot = problem.arm.robot.name
                checks.append(measure_checks(robot, problem.arm, problem.scene, problem.full_set, configurations, seed))
        tell(f"proofs: {collection}")
        row = measure_proofs(collection, chain.from_iterable(read() for read in sets), seed)
        proofs += [] if row is None else [row]
    growth: list[CheckRow] = []
    if boxes:
        tell(f"boxes: {GROWTH_ROBOT}")
        growth = measure_boxes(GROWTH_ROBOT, load_robot(GROWTH_ROBOT).arm(), boxes, configurations, seed)
    settings = {
        "robots": list(robots),
        "mbm": mbm is not None,
        "problems": problems,
        "configurations": configurations,
        "boxes": list(boxes),
        "edges": edges,
        "coal": _version("coal"),
    }
    return CollisionTable(
        settings, tuple(checks), tuple(growth), tuple(proofs), tuple(edge_rows(edges, seed, tell)), origin
    )


def edge_rows(edges: int, seed: int, tell: Callable[[str], None]) -> list[EdgeRow]:
    """So many edges, shared among :data:`EDGE_ROBOTS`."""
    each, more = divmod(edges, len(EDGE_ROBOTS))
    counts = [each + (i < more) for i in range(len(EDGE_ROBOTS))]
    return [audited_edges(robot, count, seed, tell) for robot, count in zip(EDGE_ROBOTS, counts, strict=True) if count]


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
