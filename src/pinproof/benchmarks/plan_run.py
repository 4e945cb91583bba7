"""A run of the table of planning: every method on the same problems in the same order, in one process."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter_ns

from pinproof.benchmarks.ik_methods import Unsuitable
from pinproof.benchmarks.plan_mbm import find_sets, read_problems
from pinproof.benchmarks.plan_measure import PlanRow, measure
from pinproof.benchmarks.plan_methods import MILLION, OURS, PLANNER, PlanMethod
from pinproof.benchmarks.plan_own import OWN_ROBOTS, own_problems
from pinproof.benchmarks.plan_peers import PEERS
from pinproof.benchmarks.plan_problem import PlanProblem, choose_sets, look_at_ends
from pinproof.benchmarks.plan_scenes import OWN_SCENES
from pinproof.benchmarks.plan_table import PlanTable, ProblemRow
from pinproof.benchmarks.provenance import provenance
from pinproof.collision import CollisionChecker
from pinproof.collision.audit import STEP
from pinproof.errors import InputError

__all__ = ["OWN_PROBLEMS", "plan_benchmark"]

OWN_PROBLEMS = 10
"""Problems that are drawn in each of our own scenes for each robot."""

Problems = Callable[[], Iterator[PlanProblem]]


def plan_benchmark(
    robots: Sequence[str] = OWN_ROBOTS,
    *,
    mbm: str | Path | None = None,
    robot: str | None = None,
    sets: Sequence[str] = (),
    problems: int | None = None,
    peers: bool = True,
    repeats: int = 1,
    seed: int = 0,
    on_progress: Callable[[str], None] | None = None,
) -> PlanTable:
    """Run the table.

    Parameters
    ----------
    robots
        Catalogue names or robot files that are put into our own scenes.
    mbm
        A folder of MotionBenchMaker problems (:mod:`pinproof.benchmarks.plan_mbm`), which are asked first.
    robot
        The robot that these are asked of; by default the one beside them, else the one they name.
    sets
        Only these: ``"ur5/shelf"``, or a part of it such as ``"shelf"`` or ``"mbm"``; by default all.
    problems
        The first so many of each set; by default all there are, and :data:`OWN_PROBLEMS` of our own.
    peers
        Whether peers that happen to be installed join; those that cannot are named with the reason.
    repeats
        How often each problem is asked; the quickest counts, and the answers are compared.
    seed
        Of our own problems, and of every method.
    on_progress
        Called with what is being run.

    Raises
    ------
    InputError
        For fewer than one problem or repeat, an unknown set or robot.
    FileError
        For problems that cannot be read.
    """
    if repeats < 1 or (problems is not None and problems < 1):
        raise InputError(f"problems = {problems} and repeats = {repeats} must be at least 1")
    origin, sources = provenance(seed), _sources(robots, mbm, robot, problems, seed)
    run = _Run((OURS, *(PEERS if peers else ())), seed, repeats)
    for full_set in choose_sets(list(sources), tuple(sets)):
        if on_progress is not None:
            on_progress(full_set)
        run.ask_all(full_set, sources[full_set])
    settings = {
        "robots": list(robots),
        "mbm": mbm is not None,
        "sets": list(sets),
        "problems": problems,
        "repeats": repeats,
        "audit_step": STEP,
        "time_limit_s": PLANNER.time_limit,
        "remarks": sorted(run.remarks),
        "peer_versions": {m.distribution: _version(m) for m in run.methods if m.distribution is not None},
    }
    return PlanTable(settings, tuple(run.problems), tuple(run.rows), run.left_out, origin)


def _sources(
    robots: Sequence[str], mbm: str | Path | None, robot: str | None, most: int | None, seed: int
) -> dict[str, Problems]:
    """Full names of sets, and where their problems come from."""
    found: dict[str, Problems] = {}
    for mbm_set in [] if mbm is None else find_sets(mbm, robot):
        found[mbm_set.full_set] = lambda mbm_set=mbm_set: read_problems(mbm_set, most)  # type: ignore[misc]
    for name in robots:
        label = Path(name).stem
        for scene in OWN_SCENES:
            found[f"{label}/{scene}"] = lambda name=name, scene=scene: own_problems(  # type: ignore[misc]
                name, scene, most or OWN_PROBLEMS, seed
            )
    return found


@dataclass(frozen=True, eq=False)
class _Checkers:
    """A problem's checkers: links as hulls, links as their own meshes, and the time (ms) the first took."""

    hulls: CollisionChecker
    exact: CollisionChecker
    ms: float


class _Run:
    """What has been asked so far."""

    def __init__(self, methods: tuple[PlanMethod, ...], seed: int, repeats: int) -> None:
        self.methods, self._seed, self._repeats = methods, seed, repeats
        self.problems: list[ProblemRow] = []
        self.rows: list[PlanRow] = []
        self.left_out: dict[str, str] = {}
        self.remarks: set[str] = set()

    def ask_all(self, full_set: str, source: Problems) -> None:
        """Ask every method every problem of a set."""
        warm = False
        try:
            for problem in source():
                checkers = self._look_at(problem)
                if checkers is None:
                    continue
                self._ask(problem, checkers, warm_up=not warm)
                warm = True
        except InputError as error:  # no problem was found in this scene
            self.left_out[full_set] = str(error)

    def _look_at(self, problem: PlanProblem) -> _Checkers | None:
        """The checkers of a problem; None where it makes no sense by the exact meshes."""
        began = perf_counter_ns()
        hulls = CollisionChecker(problem.arm, problem.scene)
        took = (perf_counter_ns() - began) / MILLION
        exact = CollisionChecker(problem.arm, problem.scene, link_meshes="surface")
        self.remarks |= {f"{body.owner}: {body.remark}" for body in exact.bodies if body.remark}
        ends = look_at_ends(problem, hulls, exact)
        self.problems.append(
            ProblemRow(
                problem.collection,
                problem.set_name,
                problem.number,
                problem.arm.robot.name,
                ends.hull,
                ends.exact,
                problem.notes,
                round(took, 2),
            )
        )
        return _Checkers(hulls, exact, took) if ends.free else None

    def _ask(self, problem: PlanProblem, checkers: _Checkers, *, warm_up: bool) -> None:
        for method in self.methods:
            if method.key in self.left_out:
                continue
            try:
                ask = method.prepare(problem, checkers.hulls)
                if warm_up:  # what is compiled or loaded at first use is not timed
                    ask(self._seed)
                self.rows.append(measure(problem, method, ask, checkers.exact, seed=self._seed, repeats=self._repeats))
            except ImportError as error:
                self.left_out[method.key] = f"not installed ({error})"
            except Unsuitable as error:
                self.left_out[f"{method.key} on {problem.name}"] = str(error)
            except Exception as error:  # whatever somebody else's library raises must not end the run
                if method.distribution is None:
                    raise
                self.left_out[f"{method.key} on {problem.name}"] = f"{type(error).__name__}: {error}"


def _version(method: PlanMethod) -> str | None:
    try:
        return version(str(method.distribution))
    except PackageNotFoundError:
        return None
