"""The order of the picks of a cell with the shortest certified cycle time.

The order and the grasp and IK branches of each pick are chosen by lower bounds of the motion times: the shortest time
of the slowest joint from rest to rest, without obstacles. The motions are then planned, timed and certified in the
sequence, each in the scene of its moment. Where a motion takes longer than its bound, its certified time replaces the
bound, and the order is improved again until the certified time no longer decreases.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.cell.blocking import geometric_precedence
from pinproof.cell.options import Job, options_of, part_names, resolved
from pinproof.cell.precedence import Precedence
from pinproof.cell.sequence_result import LeftOut, SequenceResult, SequenceStep
from pinproof.cell.tour import SEARCH, Tour, TourProblem
from pinproof.cell.transits import START, CertifiedMotions, MotionFailure
from pinproof.collision import Scene
from pinproof.common.validation import require_integer
from pinproof.errors import InputError, NoAnswer
from pinproof.motion.limits import Bounds
from pinproof.motion.steering import rest_to_rest_times
from pinproof.picks import Pick, PickMotion, PickSetup, PickVerdict

__all__ = ["JudgedPicks", "SequenceInterrupted", "judge_options", "sequence"]

Array = npt.NDArray[np.float64]
Progress = Callable[[str, int, int], object]
End = Literal["home", "free"] | npt.ArrayLike

OPTIONS = 4
"""Default number of options of each pick."""

REFINEMENTS = 1
"""Default number of times that the order is improved with certified times."""

MOTION = 400
"""Default number of evaluations by which each transit and each transfer is shortened; few motions use all of them."""

REPAIRS = 200
"""Largest number of failed motions after which another order is tried."""

UNREACHED = 3
"""Number of failed transits to an option after which it is excluded, because such options are rarely reached at all."""

WORTH = 1e-3
"""Share of the total time that another order must save to be certified."""


class SequenceInterrupted(KeyboardInterrupt):
    """Ctrl-C during :func:`pinproof.sequence`; ``result`` has what was certified before, or is None."""

    def __init__(self, result: SequenceResult | None) -> None:
        count = 0 if result is None else len(result.steps)
        super().__init__(f"interrupted with {count} certified picks in sequence")
        self.result = result


def sequence(
    setup: PickSetup,
    picks: Iterable[Pick],
    *,
    precedence: Iterable[tuple[str, str]] = (),
    start: End = "home",
    end: End = "home",
    grip_dwell: float = 0.0,
    release_dwell: float = 0.0,
    options: int = OPTIONS,
    search: int = SEARCH,
    refinements: int = REFINEMENTS,
    motion: int = MOTION,
    order: Iterable[str] | None = None,
    progress: Progress | None = None,
) -> SequenceResult:
    """Order picks, and choose the grasp and IK branches of each, so that the certified motions take the shortest time.

    A part that is picked is no longer an obstacle, and a part that is placed becomes one. Between two picks, the arm
    moves from the end of one directly to the approach of the next.

    Parameters
    ----------
    setup
        The arm in its scene before the first pick, with the tool and the shared settings.
    picks
        The picks, with different names. A pick with an object needs a place.
    precedence
        Pairs of names: the first pick is executed before the second. What geometry demands is added: a part is picked
        before the one it rests on, placed after its support, and not where another part blocks it.
    start, end
        ``"home"``, a configuration (n,), or ``"free"``: at the first approach, or after the last pick.
    grip_dwell, release_dwell
        Seconds that the arm rests at each grasp and at each release.
    options
        Largest number of grasps and IK branches that are considered for each pick.
    search
        Number of disturbed tours from which the search for the order starts again.
    refinements
        Number of times that the order is improved with certified instead of bounded times.
    motion
        Number of evaluations by which each transit and each transfer is shortened; with 0, they follow the planned
        paths. It replaces that of the budget of the setup.
    order
        A given order of all names, for which only the options are chosen.
    progress
        Called with the name of the work, and the numbers of finished and of all parts of it.

    Returns
    -------
    SequenceResult
        The sequence. Picks that cannot be executed are left out, each with the reason.

    Raises
    ------
    InputError
        If names are not unique, precedence is contradictory, two picks carry the same object, or OR-Tools is needed and
        not installed.
    UnknownNameError
        If the precedence or the order names a pick that does not exist.
    NoAnswer
        If no order was found in which all motions are certified.
    SequenceInterrupted
        After Ctrl-C (a KeyboardInterrupt); its ``result`` has what was certified before.
    """
    given = _checked(setup, picks)
    stated = Precedence.stated((pick.name for pick in given), precedence)
    fixed_order = None if order is None else _order_of(order, stated)
    require_integer("options", options, 1)
    require_integer("search", search, 0)
    require_integer("refinements", refinements, 0)
    require_integer("motion", motion, 0)
    setup = replace(setup, budget=replace(setup.budget, motion=motion))
    dwell = _dwell("grip_dwell", grip_dwell), _dwell("release_dwell", release_dwell)
    ends = _configuration(setup, start, "start"), _configuration(setup, end, "end")
    run = _Run(setup, given, stated, ends, dwell, progress or (lambda *_: None))
    try:
        run.prepare(options)
        run.optimise(search, refinements, fixed_order)
    except KeyboardInterrupt:
        raise SequenceInterrupted(run.result(interrupted=True)) from None
    return run.result()


class JudgedPicks(NamedTuple):
    """What is known of picks before they are put in sequence; result of :func:`judge_options`."""

    jobs: tuple[Job, ...]
    """The picks that can be executed, with their options."""
    left_out: tuple[LeftOut, ...]
    """The other picks, with the reasons."""
    pairs: tuple[tuple[str, str], ...]
    """Pairs of picks of which geometry demands that the first is executed first."""
    seconds: dict[str, float]
    """For each pick that can be executed, its shortest time with the mean time of a transit to it."""


def judge_options(setup: PickSetup, picks: Iterable[Pick], options: int) -> JudgedPicks:
    """Judge picks, each in the scene without the other parts, and estimate their times without an order."""
    given = _checked(setup, picks)
    stated = Precedence.stated((pick.name for pick in given), ())
    run = _Run(setup, given, stated, (setup.home, setup.home), (0.0, 0.0), lambda *_: None)
    run.prepare(options)
    names, seconds = run.precedence.names, {}
    if run.jobs:
        problem = run.problem()
        first = [choices[0] for choices in problem.options]
        for name, choices in zip(names, problem.options, strict=True):
            seconds[name] = float((problem.inner[choices] + problem.between[np.ix_(first, choices)].mean(axis=0)).min())
    pairs = tuple((names[a], names[b]) for a, b in run.precedence.reasons)
    return JudgedPicks(tuple(run.jobs), tuple(run.left_out), pairs, seconds)


def _checked(setup: PickSetup, picks: Iterable[Pick]) -> tuple[Pick, ...]:
    if not isinstance(setup, PickSetup):
        raise InputError(f"setup is a {type(setup).__name__}; expected pinproof.picks.PickSetup")
    setup.shared.refuse_conveyor("the order of picks")
    given = tuple(picks)
    for index, pick in enumerate(given):
        if not isinstance(pick, Pick):
            raise InputError(f"picks[{index}] is a {type(pick).__name__}; expected pinproof.Pick")
    names = [pick.name for pick in given]
    if doubled := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"the names of picks must be unique; repeated: {', '.join(doubled)}")
    if not given:
        raise InputError("there are no picks to put in sequence")
    return given


def _order_of(order: Iterable[str], stated: Precedence) -> tuple[int, ...]:
    names = list(order)
    for name in names:
        stated.index(name, "the order")
    if len(set(names)) < len(names) or len(names) < len(stated.names):
        missing = [name for name in stated.names if name not in names]
        doubled = sorted({name for name in names if names.count(name) > 1})
        wrong = f"lacks {', '.join(missing)}" if missing else f"repeats {', '.join(doubled)}"
        raise InputError(f"the order {wrong}; it must name every pick once")
    return tuple(stated.index(name, "the order") for name in names)


def _dwell(name: str, value: float) -> float:
    if not (isinstance(value, int | float) and 0 <= value < float("inf")):
        raise InputError(f"{name} = {value!r}; it must be a number of seconds, 0 or more")
    return float(value)


def _configuration(setup: PickSetup, stated: End, what: str) -> Array | None:
    """The configuration (n,) of an end; None if it is free."""
    if isinstance(stated, str):
        if stated not in ("home", "free"):
            raise InputError(f"{what} = {stated!r}; use 'home', 'free' or a configuration")
        return setup.home if stated == "home" else None
    arm = setup.checker.arm
    q = arm.limits.snap(arm.configuration(stated, what))
    checked = setup.checker.check(q)
    trouble = [*arm.limits.violations(q, arm.joint_names), *([] if checked.free else [str(checked)])]
    if trouble:
        raise InputError(f"{what} is not valid: {'; '.join(trouble)}")
    return q


class _ImpossibleError(Exception):
    """No option of a job has motions that can be certified."""

    def __init__(self, job: int, reason: str) -> None:
        super().__init__(reason)
        self.job, self.reason = job, reason


@dataclass(eq=False)
class _Certified:
    """A tour whose motions are certified, at least its first ones."""

    tour: Tour
    verdicts: list[PickVerdict]
    scenes: list[Scene]
    closing: PickMotion | None = None

    @property
    def seconds(self) -> float:
        moving = sum(motion.trajectory.duration for each in self.verdicts for motion in each.motions)
        return moving + (0.0 if self.closing is None else self.closing.trajectory.duration)


@dataclass(eq=False)
class _Run:
    """The work on one sequence; it keeps the best result so far."""

    setup: PickSetup
    picks: tuple[Pick, ...]
    stated: Precedence
    ends: tuple[Array | None, Array | None]
    dwell: tuple[float, float]
    progress: Progress
    left_out: list[LeftOut] = field(default_factory=list)
    jobs: list[Job] = field(default_factory=list)
    best: _Certified | None = None
    partial: _Certified | None = None
    bound: float = float("nan")
    file_order: float = float("nan")
    nearest: float = float("nan")
    numbers: list[tuple[int, int]] = field(default_factory=list)
    precedence: Precedence = field(default_factory=lambda: Precedence(()))
    unreached: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.motions = CertifiedMotions(self.setup)

    # -- the options --------------------------------------------------------------------------------------------------

    def prepare(self, most: int) -> None:
        """Find the options of every pick and the complete precedence, and leave out picks that cannot be executed."""
        setup, count = self.setup, len(self.picks)
        ready = tuple(resolved(pick, setup) for pick in self.picks)
        parts = part_names(ready, setup.checker.scene)
        fixed = setup.checker.scene.remove(*(name for name in parts if name in setup.checker.scene.names))
        jobs: list[Job] = []
        for index, pick in enumerate(ready):
            self.progress("options", index, count)
            jobs.append(options_of(pick, setup, fixed, frozenset(parts), most, index))
        self.progress("options", count, count)
        self.precedence = self.stated.with_pairs(geometric_precedence(setup, jobs, fixed)).checked()
        self.jobs = jobs
        failed = {}
        for i, job in enumerate(jobs):
            if job.failed is not None:
                stage = job.failed.stages[-1]
                failed[i] = f"{stage.stage.value}: {stage.message}"
        self._leave_out(failed)

    def _leave_out(self, failed: dict[int, str]) -> None:
        """Leave out jobs with a reason each, and all that must follow them."""
        before, names, reasons = self.precedence.predecessors(), self.precedence.names, self.precedence.reasons
        out = dict(failed)
        while waiting := [i for i in range(len(names)) if i not in out and before[i] & out.keys()]:
            for i in waiting:
                first = min(before[i] & out.keys())
                out[i] = f"{names[first]} is left out: {reasons[first, i]}"
        self.left_out += [LeftOut(names[i], why) for i, why in out.items()]
        kept = [i for i in range(len(names)) if i not in out]
        new = {old: k for k, old in enumerate(kept)}
        self.jobs = [self.jobs[i] for i in kept]
        self.precedence = Precedence(
            tuple(names[i] for i in kept),
            {(new[a], new[b]): why for (a, b), why in reasons.items() if a in new and b in new},
        )
        self.numbers = [(k, o) for k, job in enumerate(self.jobs) for o in range(len(job.options))]
        self.motions = CertifiedMotions(self.setup)  # known trajectories have the numbers of options
        self.partial = None
        self.unreached = {}

    # -- the order ----------------------------------------------------------------------------------------------------

    def problem(self) -> TourProblem:
        """The order as a tour problem, with lower bounds of all times."""
        arm = self.setup.checker.arm
        bounds = Bounds.of(arm.limits, arm.joint_names)
        options = [self.jobs[k].options[o] for k, o in self.numbers]
        entrances = np.array([option.entrance for option in options])
        exits = np.array([option.exit for option in options])
        between = np.empty((len(options), len(options)))
        for row, q in enumerate(exits):
            between[row] = rest_to_rest_times(entrances - q, bounds).max(axis=1)
        first, last = self.ends
        zeros = np.zeros(len(options))
        return TourProblem(
            np.array([k for k, _ in self.numbers]),
            zeros if first is None else rest_to_rest_times(entrances - first, bounds).max(axis=1),
            zeros if last is None else rest_to_rest_times(exits - last, bounds).max(axis=1),
            np.array([option.seconds for option in options]),
            between,
            self.precedence,
        )

    def optimise(self, search: int, refinements: int, fixed_order: tuple[int, ...] | None) -> None:
        """Search for the shortest certified sequence; picks without any certified motion are left out."""
        while self.jobs:
            try:
                self._optimise(search, refinements, fixed_order)
                return
            except _ImpossibleError as error:
                self._leave_out({error.job: error.reason})

    def _optimise(self, search: int, refinements: int, fixed_order: tuple[int, ...] | None) -> None:
        problem = self.problem()
        names = self.precedence.names
        wanted = tuple(range(len(names)))
        if fixed_order is not None:
            new = {name: k for k, name in enumerate(names)}
            wanted = tuple(new[self.stated.names[i]] for i in fixed_order if self.stated.names[i] in new)
            if not self.precedence.allows(wanted):
                raise InputError(self._violated(wanted))
        self.progress("order", 0, 1)
        self.bound = problem.lower_bound()
        feasible = problem.in_order(wanted)
        self.file_order = problem.best_options(feasible).seconds
        self.nearest = problem.nearest_neighbour().seconds

        def solved(current: TourProblem, first: tuple[int, ...]) -> Tour:
            return current.best_options(first) if fixed_order else current.solve(first, search=search)

        def refined(current: TourProblem, certified: Tour) -> Tour:
            same = Tour(certified.order, certified.options, current.seconds(certified.options))
            return current.best_options(certified.order) if fixed_order else current.improved(same)

        tour = solved(problem, feasible)
        self.progress("order", 1, 1)
        problem, self.best = self._certified(problem, tour, fixed_order is not None)
        self._shorten(self.best)
        for _ in range(refinements):
            problem = self._with_certified_times(problem, self.best)
            tour = refined(problem, self.best.tour)
            if tour.seconds > (1 - WORTH) * self.best.seconds:
                break
            problem, other = self._certified(problem, tour, fixed_order is not None)
            self._shorten(other)
            if other.seconds < self.best.seconds:
                self.best = other

    def _shorten(self, certified: _Certified) -> None:
        """Search longer for short motions where those of a certified tour exceed their bounds."""
        if not self.setup.budget.motion:
            return
        previous = START
        for k, option in enumerate(certified.tour.options):
            self.progress("shorten", k, len(certified.tour.options))
            job = self.jobs[self.numbers[option][0]]
            key = previous, option
            certified.verdicts[k] = self.motions.shorter(certified.scenes[k], job, certified.verdicts[k], key)
            previous = option
        self.progress("shorten", len(certified.tour.options), len(certified.tour.options))

    def _violated(self, order: tuple[int, ...]) -> str:
        place = {job: k for k, job in enumerate(order)}
        names = self.precedence.names
        (a, b), why = next(
            (pair, why) for pair, why in self.precedence.reasons.items() if place[pair[0]] > place[pair[1]]
        )
        return f"the order is not possible: {names[a]} must come before {names[b]} ({why})"

    def _with_certified_times(self, problem: TourProblem, certified: _Certified) -> TourProblem:
        """The problem with the certified times of a tour in place of their bounds.

        The options that are not in the tour are assumed to exceed their bounds by the mean of those that are.
        """
        start, end, inner, between = (
            array.copy() for array in (problem.start, problem.end, problem.inner, problem.between)
        )
        previous = START
        excess = 0.0
        for option, verdict in zip(certified.tour.options, certified.verdicts, strict=True):
            times = [motion.trajectory.duration for motion in verdict.motions if motion.name != "transit"]
            way = sum(motion.trajectory.duration for motion in verdict.motions if motion.name == "transit")
            excess += max(sum(times) - inner[option], 0.0) / len(certified.verdicts)
            inner[option] = max(inner[option], sum(times))
            if previous == START:
                start[option] = max(start[option], way)
            else:
                between[previous, option] = max(between[previous, option], way)
            previous = option
        if certified.closing is not None:
            end[previous] = max(end[previous], certified.closing.trajectory.duration)
        others = np.ones(len(inner), dtype=bool)
        others[list(certified.tour.options)] = False
        inner[others] += excess
        return replace(problem, start=start, end=end, inner=inner, between=between)

    # -- certified motions --------------------------------------------------------------------------------------------

    def _certified(self, problem: TourProblem, tour: Tour, fixed_order: bool) -> tuple[TourProblem, _Certified]:
        """Certify a tour; a motion that fails is excluded, and the tour is changed.

        Raises
        ------
        NoAnswer
            If no tour was certified.
        """
        kept: _Certified | None = None
        failed = ""
        for _ in range(REPAIRS):
            kept, failure, previous, option = self._run_through(tour, kept)
            if failure is None:
                return problem, kept
            self.partial = kept
            name = self.precedence.names[problem.job[option]] if option >= 0 else "the end"
            failed = f"{name}: {failure.part}: {failure.reason}"
            problem = self._excluding(problem, failure, previous, option)
            for job, choices in enumerate(problem.options):
                if not np.isfinite(problem.inner[choices]).any():
                    raise _ImpossibleError(job, f"{failure.part}: {failure.reason}")
            tour = problem.best_options(tour.order if fixed_order else problem.in_order(tour.order))
            if not fixed_order:
                tour = problem.improved(tour)
            if not np.isfinite(tour.seconds):
                break
        raise NoAnswer(f"no order was found in which every motion is certified; the last failure is {failed}")

    def _run_through(self, tour: Tour, kept: _Certified | None) -> tuple[_Certified, MotionFailure | None, int, int]:
        """Certify the motions of a tour in order; the common beginning with a certified one is kept."""
        same = 0
        if kept is not None:
            pairs = zip(tour.options, kept.tour.options[: len(kept.verdicts)], strict=False)
            same = next((k for k, (a, b) in enumerate(pairs) if a != b), min(len(kept.verdicts), len(tour.options)))
        verdicts = [] if kept is None else kept.verdicts[:same]
        scenes = [self.setup.checker.scene] if kept is None else kept.scenes[: same + 1]
        made = _Certified(tour, verdicts, scenes)
        for k in range(same, len(tour.options)):
            self.progress("motions", k, len(tour.options))
            option = tour.options[k]
            job_index, chosen = self.numbers[option]
            job = self.jobs[job_index]
            choice = job.options[chosen]
            previous = tour.options[k - 1] if k else START
            q = self._exit(previous) if k else self.ends[0]
            found = self.motions.pick(
                scenes[-1], choice.entrance if q is None else q, job, choice, previous, option, job_index
            )
            if isinstance(found, MotionFailure):
                return made, found, previous, option
            verdicts.append(found)
            scenes.append(self.motions.scene_after(scenes[-1], job, choice))
            self.partial = made
        last = tour.options[-1]
        if self.ends[1] is not None:
            closing = self.motions.to_end(scenes[-1], self._exit(last), self.ends[1], last)
            if isinstance(closing, MotionFailure):
                return made, closing, last, START
            made.closing = closing
        self.progress("motions", len(tour.options), len(tour.options))
        return made, None, START, START

    def _exit(self, option: int) -> Array:
        job, chosen = self.numbers[option]
        return self.jobs[job].options[chosen].exit

    def _excluding(self, problem: TourProblem, failure: MotionFailure, previous: int, option: int) -> TourProblem:
        """The problem with more precedence if a part blocks the motion, else without the failed transit or option."""
        if option == START:
            end = problem.end.copy()
            end[previous] = np.inf
            return replace(problem, end=end)
        job = int(problem.job[option])
        for name in failure.bodies:
            for other, each in enumerate(self.jobs):
                if other == job or name not in {place.name for place in each.places}:
                    continue
                for pair in ((other, job), (job, other)):
                    if pair in self.precedence.reasons:
                        continue
                    more = self.precedence.with_pairs({pair: f"{name} blocks {self.jobs[job].pick.name}"})
                    if not more.cycle():
                        self.precedence = more
                        return replace(problem, precedence=more)
        self.unreached[option] = self.unreached.get(option, 0) + (failure.part == "transit")
        if failure.part == "transit" and self.unreached[option] < UNREACHED:
            if previous == START:
                start = problem.start.copy()
                start[option] = np.inf
                return replace(problem, start=start)
            between = problem.between.copy()
            between[previous, option] = np.inf
            return replace(problem, between=between)
        inner = problem.inner.copy()
        inner[option] = np.inf
        return replace(problem, inner=inner)

    # -- the result ---------------------------------------------------------------------------------------------------

    def result(self, *, interrupted: bool = False) -> SequenceResult:
        """The best result so far."""
        certified = self.best or self.partial
        steps: list[SequenceStep] = []
        now = 0.0
        for k, verdict in enumerate([] if certified is None else certified.verdicts):
            job_index = int(self.numbers[certified.tour.options[k]][0]) if certified is not None else 0
            step = SequenceStep(
                self.picks[self.stated.names.index(self.precedence.names[job_index])],
                verdict,
                certified.scenes[k] if certified is not None else self.setup.checker.scene,
                now,
                *self.dwell,
            )
            steps.append(step)
            now = step.end
        return SequenceResult(
            self.setup,
            tuple(steps),
            None if certified is None else certified.closing,
            tuple(self.left_out),
            self.precedence,
            self.bound,
            self.file_order,
            self.nearest,
            len(self.jobs),
            interrupted,
        )
