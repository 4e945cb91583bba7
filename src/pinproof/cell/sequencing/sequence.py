"""The order of the picks of a cell with the shortest certified cycle time.

The order and the grasp and IK branches of each pick are chosen by lower bounds of the motion times: the shortest time
of the slowest joint from rest to rest, without obstacles. The motions are then planned, timed and certified in the
sequence, each in the scene of its moment. Where a motion takes longer than its bound, its certified time replaces the
bound, and the order is improved again until the certified time no longer decreases.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.cell.sequencing.options import Job, PickOption, PickOptions, connected, part_names, resolved
from pinproof.cell.sequencing.precedence import Precedence, geometric_precedence
from pinproof.cell.sequencing.sequence_result import LeftOut, SequenceResult, SequenceStep
from pinproof.cell.sequencing.tour import ROUNDS, SEARCH, Tour, TourProblem
from pinproof.cell.sequencing.transits import (
    LongMotions,
    MotionFailure,
    SequencedPick,
    StepMotions,
    closing_motion,
    scene_after,
)
from pinproof.cell.sequencing.windings import home_of_budgeted, refuse_small_budgets, within_windings, wound
from pinproof.collision import Scene
from pinproof.common.structs import key, struct
from pinproof.common.validation import refuse_repeated, require_number, require_type
from pinproof.errors import InputError, NoAnswer, RunInterrupted
from pinproof.motion import Bounds, Trajectory, least_times
from pinproof.picks import Pick, PickMotion, PickSetup, PickVerdict
from pinproof.spatial import Array
from pinproof.work import Progress, Runner

End = Literal["home", "free"] | npt.ArrayLike


def sequence(
    setup: PickSetup,
    picks: Iterable[Pick],
    *,
    precedence: Iterable[tuple[str, str]] = (),
    start: End = "home",
    end: End = "home",
    grip_dwell: float = 0.0,
    release_dwell: float = 0.0,
    order: Iterable[str] | None = None,
    windings: Mapping[str, float | str] | None = None,
    budget: SequenceBudget | None = None,
    executor: Executor | None = None,
    workers: int | None = None,
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
    order
        A given order of all names, for which only the options are chosen.
    windings
        Budgets of rotation by joint, in rad or as text such as ``"400 deg"``: at every instant, the joint stays within
        its budget of its value at home. Default: those of the picks.
    budget
        The effort of the search.
    executor, workers
        An executor, or the number of local processes; by default, all work is done in this process. The result does not
        depend on them.
    progress
        Called with the name of the work, and the numbers of finished and of all parts of it.

    Returns
    -------
    SequenceResult
        The sequence. Picks that cannot be executed are left out, each with the reason.

    Raises
    ------
    InputError
        If names are not unique, precedence is contradictory, two picks carry the same object, or a budget of rotation
        is too small for a pick.
    UnknownNameError
        If the precedence or the order names a pick that does not exist, or ``windings`` a joint.
    NoAnswer
        If no order was found in which all motions are certified.
    RunInterrupted
        After Ctrl-C (a KeyboardInterrupt); its ``result`` has what was certified before, or is None.
    """
    given = _checked(setup, picks)
    pairs = Precedence.stated((pick.name for pick in given), precedence)
    fixed_order = None
    if order is not None:
        names = list(order)
        fixed_order = tuple(pairs.index(name, "the order") for name in names)
        refuse_repeated("the order", names)
        if missing := [name for name in pairs.names if name not in names]:
            raise InputError(f"the order lacks {', '.join(missing)}; it must name every pick once")
    require_type("budget", budget, SequenceBudget, type(None))
    budget = budget or SequenceBudget()
    setup = replace(setup, budget=replace(setup.budget, motion=budget.motion))
    limited = within_windings(setup, windings)
    rest = partial(require_number, unit="s", minimum=0)
    dwell = rest("grip_dwell", grip_dwell), rest("release_dwell", release_dwell)
    ends = _configuration(limited, start, "start"), _configuration(limited, end, "end")
    with Runner(executor=executor, workers=workers, progress=progress) as runner:
        run = SequenceRun(limited, setup, given, pairs, ends, dwell, budget, runner, fixed_order)
        try:
            run.prepare()
            run.optimise()
        except KeyboardInterrupt:
            result = run.result(interrupted=True)
            count = 0 if result is None else len(result.steps)
            raise RunInterrupted(f"interrupted with {count} certified picks in sequence", result) from None
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


def judge_options(setup: PickSetup, picks: Iterable[Pick], budget: SequenceBudget) -> JudgedPicks:
    """Judge picks, each in the scene without the other parts, and estimate their times without an order."""
    given, limited = _checked(setup, picks), within_windings(setup, None)
    home, none = (setup.home, setup.home), Precedence.stated((pick.name for pick in given), ())
    run = SequenceRun(limited, setup, given, none, home, (0.0, 0.0), budget, Runner())
    run.prepare()
    names, seconds = run.precedence.names, {}
    if run.jobs:
        problem = run.problem()
        # the mean transit to a pick is that from the first option of every pick
        first = [choices[0] for choices in problem.options]
        for name, choices in zip(names, problem.options, strict=True):
            seconds[name] = float((problem.inner[choices] + problem.between[np.ix_(first, choices)].mean(axis=0)).min())
    pairs = tuple((names[a], names[b]) for a, b in run.precedence.reasons)
    return JudgedPicks(tuple(run.jobs), tuple(run.left_out), pairs, seconds)


def _checked(setup: PickSetup, picks: Iterable[Pick]) -> tuple[Pick, ...]:
    require_type("setup", setup, PickSetup)
    setup.shared.refuse_conveyor("the order of picks")
    given = tuple(picks)
    for index, pick in enumerate(given):
        require_type(f"picks[{index}]", pick, Pick)
    refuse_repeated("picks", (pick.name for pick in given))
    if not given:
        raise InputError("there are no picks to put in sequence")
    return given


def _configuration(setup: PickSetup, end: End, what: str) -> Array | None:
    """The configuration (n,) of an end; None if it is free."""
    if isinstance(end, str):
        if end not in ("home", "free"):
            raise InputError(f"{what} = {end!r}; use 'home', 'free' or a configuration")
        return setup.home if end == "home" else None
    arm = setup.checker.arm
    q = arm.limits.snap(arm.configuration(end, what))
    checked = setup.checker.check(q)
    trouble = [*arm.limits.violations(q, arm.joint_names), *([] if checked.free else [str(checked)])]
    if trouble:
        raise InputError(f"{what} is not valid: {'; '.join(trouble)}")
    return q


Moved = frozenset[int]
"""The options of the picks that have moved a part."""

Place = tuple[int, int, Moved]
"""A step of a tour: the option before (or START), its option, and what was moved before it."""

START = -1

CHUNK = 2
"""Number of picks that a worker is sent at a time."""

REPAIRS = 200
"""Largest number of times that another order is tried after motions have failed."""

ORDERS = 60
"""Number of picks in all random orders that are tried before a pick that other parts block is left out."""

UNREACHED = 3
"""Number of failed transits to and from options that are not connected to home after which these are excluded."""

NEW = 5e-3
"""Share of the total time that a tour that was searched again must save against a small change of the present one."""

WORTH = 1e-3
"""Share of the total time that another order must save to be certified."""


@struct(kw_only=True)
class SequenceBudget:
    """The budget of :func:`pinproof.sequence`."""

    options: int = key(
        "largest number of grasps and IK branches that are considered for each pick", default=4, minimum=1
    )
    search: int = key(
        "number of disturbances of the order, after each of which it is improved", default=SEARCH, minimum=0
    )
    bound: int = key(
        "number of times that violated constraints are added to the lower bound", default=ROUNDS, minimum=1
    )
    refinements: int = key(
        "number of times that the order is improved with certified instead of bounded times", default=1, minimum=0
    )
    motion: int = key(
        "number of evaluations by which each transit and each transfer is shortened; with 0, they follow the planned "
        "paths. It replaces that of the budget of the setup",
        default=400,
        minimum=0,
    )


class _ImpossibleError(Exception):
    """No option of a job has motions that can be certified."""

    def __init__(self, reasons: dict[int, str]) -> None:
        super().__init__("; ".join(reasons.values()))
        self.reasons = reasons


@dataclass(eq=False)
class _CertifiedTour:
    """A tour whose motions are certified, at least its first ones."""

    tour: Tour
    verdicts: list[PickVerdict]
    scenes: list[Scene]
    places: list[Place]
    tool_change: float
    closing: PickMotion | None = None

    @property
    def seconds(self) -> float:
        moving = sum(motion.trajectory.duration for verdict in self.verdicts for motion in verdict.motions)
        moving += self.tool_change * sum(verdict.motions[0].name == "return" for verdict in self.verdicts)
        return moving + (0.0 if self.closing is None else self.closing.trajectory.duration)


@dataclass(eq=False)
class SequenceRun:
    """The work on one sequence; it keeps the best result so far."""

    setup: PickSetup
    unlimited: PickSetup
    """The setup without the budgets of rotation, which are limits of the arm of the other one."""
    picks: tuple[Pick, ...]
    given: Precedence
    ends: tuple[Array | None, Array | None]
    dwell: tuple[float, float]
    budget: SequenceBudget
    runner: Runner
    fixed_order: tuple[int, ...] | None = None
    left_out: list[LeftOut] = field(default_factory=list)
    jobs: list[Job] = field(default_factory=list)
    best: _CertifiedTour | None = None
    partial: _CertifiedTour | None = None
    bound: float = float("nan")
    file_order: float = float("nan")
    nearest: float = float("nan")
    options: list[tuple[Job, PickOption]] = field(default_factory=list)
    """All options with their jobs; their indices name them in tours that are certified."""
    numbers: list[int] = field(default_factory=list)
    """The indices of the options of the present problem, whose jobs are not left out."""
    precedence: Precedence = field(default_factory=lambda: Precedence(()))
    required: Precedence = field(default_factory=lambda: Precedence(()))
    """The precedence without the pairs that only failed motions suggest, which must not raise the lower bound."""
    blocked: bool = False
    """Whether a part of another pick blocked a motion."""
    steps: dict[Place, PickVerdict | MotionFailure] = field(default_factory=dict)
    known: dict[tuple[int, ...], dict[str, Trajectory]] = field(default_factory=dict)
    """Trajectories by name: of a transit by the options before and after it, of all others by the option."""
    searched: set[tuple[int, int, str, float]] = field(default_factory=set)
    """Motions that were searched again, with their durations."""

    @property
    def tool_change(self) -> float | None:
        """Seconds of a change of the tool; None if tools are not changed."""
        change = self.setup.shared.tool_change
        return change if isinstance(change, float) and len(self.setup.shared.tools) > 1 else None

    # -- the options --------------------------------------------------------------------------------------------------

    def prepare(self) -> None:
        """Find the options of every pick and the complete precedence, and leave out picks that cannot be executed."""
        setup = self.setup
        ready = tuple(resolved(pick, setup) for pick in self.picks)
        parts = part_names(tuple(grasps[0] for grasps in ready), setup.checker.scene)
        fixed = setup.checker.scene.remove(*(name for name in parts if name in setup.checker.scene.names))
        # the options of every pick, each in the scene without the other parts
        task = PickOptions(setup, fixed, frozenset(parts), self.budget.options)
        self.runner.report("options", 0, len(ready))
        jobs = self.runner.run("options", task, ready, CHUNK)
        # a pick that only a budget of rotation excludes
        windings = setup.shared.windings
        for i, job in enumerate(jobs):
            if windings and not job.options:
                refuse_small_budgets(setup, replace(task, setup=self.unlimited)(i, ready[i : i + 1])[0])
        # the full rotations that a path from the start reaches
        start = setup.home if self.ends[0] is None else self.ends[0]
        jobs = connected(setup, setup.checker.with_scene(fixed), start, jobs)
        self.precedence = self.given.with_pairs(geometric_precedence(setup, jobs, fixed)).checked()
        self.required = self.precedence
        jobs = wound(setup.checker.arm, setup.home, jobs, windings)
        self.jobs, self.options = jobs, [(job, option) for job in jobs for option in job.options]
        # picks without an option are left out
        failed = {}
        for i, job in enumerate(jobs):
            if job.failed is not None:
                stage = job.failed.stages[-1]
                good = "good alone, but it has no lines that can be part of a sequence"
                failed[i] = good if job.failed.ok else f"{stage.stage.value}: {stage.message}"
        self._leave_out(failed)

    def _leave_out(self, failed: dict[int, str]) -> None:
        """Leave out jobs with a reason each, and all that must follow them."""
        before, names, reasons = self.required.predecessors(), self.required.names, self.required.reasons
        out = dict(failed)
        while waiting := [i for i in range(len(names)) if i not in out and before[i] & out.keys()]:
            for i in waiting:
                first = min(before[i] & out.keys())
                out[i] = f"{names[first]} is left out: {reasons[first, i]}"
        self.left_out += [LeftOut(names[i], why) for i, why in out.items()]
        left = [i for i in range(len(names)) if i not in out]
        self.jobs = [self.jobs[i] for i in left]
        self.precedence, self.required = self.precedence.of(left), self.required.of(left)
        remaining = set(self.jobs)
        self.numbers = [number for number, (job, _) in enumerate(self.options) if job in remaining]
        self.partial = None
        # certified transits connect options only while both are part of the problem
        known = {START, *self.numbers}
        self.steps = {(a, b, moved): step for (a, b, moved), step in self.steps.items() if {a, b, *moved} <= known}

    # -- the order ----------------------------------------------------------------------------------------------------

    def problem(self) -> TourProblem:
        """The order as a tour problem, with lower bounds of all times."""
        arm = self.setup.checker.arm
        bounds = Bounds.of(arm.limits, arm.joint_names)
        options = [self.options[number][1] for number in self.numbers]
        entrances = np.array([option.entrance for option in options])
        exits = np.array([option.exit for option in options])
        between = np.array([least_times(entrances - q, bounds) for q in exits])
        if (change := self.tool_change) is not None:
            # Tools are changed at home
            tools = np.array([option.pick.tool for option in options])
            home = self.setup.home
            through = least_times(exits - home, bounds)[:, None] + change + least_times(entrances - home, bounds)
            between = np.where(tools[:, None] == tools, between, through)
        first, last = self.ends
        zeros = np.zeros(len(options))
        return TourProblem(
            np.repeat(np.arange(len(self.jobs)), [len(job.options) for job in self.jobs]),
            zeros if first is None else least_times(entrances - first, bounds),
            zeros if last is None else least_times(exits - last, bounds),
            np.array([option.seconds for option in options]),
            between,
            self.precedence,
        )

    def optimise(self) -> None:
        """Search for the shortest certified sequence; picks without any certified motion are left out."""
        while self.jobs:
            try:
                self._optimise()
                return
            except _ImpossibleError as error:
                self._leave_out(error.reasons)

    def _optimise(self) -> None:
        # the given order of the remaining jobs, or that of the picks
        names = self.precedence.names
        order = tuple(range(len(names)))
        fixed = self.fixed_order is not None
        if self.fixed_order is not None:
            number = {name: k for k, name in enumerate(names)}
            given = (self.given.names[i] for i in self.fixed_order)
            order = tuple(number[name] for name in given if name in number)
            if not self.precedence.allows(order):
                place = {job: k for k, job in enumerate(order)}
                (a, b), why = next(
                    item for item in self.precedence.reasons.items() if place[item[0][0]] > place[item[0][1]]
                )
                raise InputError(f"the order is not possible: {names[a]} must come before {names[b]} ({why})")
        # the best tour by lower bounds, and its certified motions
        problem = self.problem()
        self.runner.report("order", 0, 1)
        self.bound = replace(problem, precedence=self.required).lower_bound(self.budget.bound)
        feasible = problem.in_order(order)
        self.file_order = problem.best_options(feasible).seconds
        self.nearest = problem.nearest_neighbour().seconds
        tour = problem.best_options(feasible) if fixed else problem.solve(feasible, search=self.budget.search)
        self.runner.report("order", 1, 1)
        try:
            problem, self.best = self._certified(problem, tour, fixed)
        except _ImpossibleError as error:
            if fixed or not self.blocked:
                raise
            problem, self.best = self._in_other_order(tour, error)
        # tours with the certified times in place of the bounds
        for _ in range(self.budget.refinements):
            problem = self._with_certified_times(problem, self.best)
            same = Tour(self.best.tour.order, self.best.tour.options, problem.seconds(self.best.tour.options))
            tour = problem.best_options(same.order) if fixed else problem.improved(same)
            if not fixed:  # another tour needs new motions almost everywhere
                new = problem.solve(same.order, search=self.budget.search)
                tour = new if new.seconds < (1 - NEW) * tour.seconds else tour
            if tour.seconds > (1 - WORTH) * self.best.seconds:
                break
            precedence = self.precedence
            try:
                problem, made = self._certified(problem, tour, fixed)
            except (_ImpossibleError, NoAnswer):  # the present tour remains
                self.precedence = precedence
                break
            if made.seconds < self.best.seconds:
                self.best = made
            else:
                self.precedence = precedence

    def _in_other_order(self, tour: Tour, error: _ImpossibleError) -> tuple[TourProblem, _CertifiedTour]:
        """A certified tour in one of several orders; raises the error of the search, with their number, without one.

        In the search, a part that blocks one option adds a precedence, which may exclude the other options; not here.
        """
        self.precedence = self.required
        problem, rng = self.problem(), np.random.default_rng(0)
        # those that failed first and last, then random orders
        failed = [job for job in tour.order if job in error.reasons]
        rest = [job for job in tour.order if job not in error.reasons]
        orders = [(*failed, *rest), (*rest, *failed)]
        orders += [tuple(rng.permutation(problem.count).tolist()) for _ in range(ORDERS // problem.count)]
        tried = dict.fromkeys(map(problem.in_order, orders))
        for order in tried:
            try:
                return self._certified(problem, problem.best_options(order), fixed=True)
            except (_ImpossibleError, NoAnswer):
                continue
        more = f"; no sequence with it was found in {len(tried)} other orders"
        raise _ImpossibleError({job: why + more for job, why in error.reasons.items()})

    def _keep(self, place: Place, step: PickVerdict | MotionFailure) -> None:
        """Keep the result of a step, and its trajectories for other scenes."""
        self.steps[place] = step
        if isinstance(step, MotionFailure):
            return
        previous, option, _ = place
        for motion in step.motions:
            key = (previous, option) if motion.name in ("return", "transit") else (option,)
            self.known.setdefault(key, {})[motion.name] = motion.trajectory

    def _with_certified_times(self, problem: TourProblem, certified: _CertifiedTour) -> TourProblem:
        """The problem with the certified times of a tour in place of their bounds.

        The options that are not in the tour are assumed to exceed their bounds by the mean of those that are.
        """
        start, end, inner, between = (
            array.copy() for array in (problem.start, problem.end, problem.inner, problem.between)
        )
        # the options of the tour take their certified times
        previous = START
        excess = 0.0
        for option, verdict in zip(certified.tour.options, certified.verdicts, strict=True):
            arrive = [motion for motion in verdict.motions if motion.name in ("return", "transit")]
            times = [motion.trajectory.duration for motion in verdict.motions if motion not in arrive]
            arriving = sum(motion.trajectory.duration for motion in arrive)
            arriving += certified.tool_change * (arrive[0].name == "return")
            excess += max(sum(times) - inner[option], 0.0) / len(certified.verdicts)
            inner[option] = max(inner[option], sum(times))
            if previous == START:
                start[option] = max(start[option], arriving)
            else:
                between[previous, option] = max(between[previous, option], arriving)
            previous = option
        if certified.closing is not None:
            end[previous] = max(end[previous], certified.closing.trajectory.duration)
        # the other options exceed their bounds by as much on average
        others = np.ones(len(inner), dtype=bool)
        others[list(certified.tour.options)] = False
        inner[others] += excess
        return replace(problem, start=start, end=end, inner=inner, between=between)

    # -- certified motions --------------------------------------------------------------------------------------------

    def certified_seconds(self, tour: Tour) -> float:
        """Seconds of the certified motions of another tour; where motions fail, other options are used."""
        return self._certified(self.problem(), tour, fixed=True)[1].seconds

    def _certified(self, problem: TourProblem, tour: Tour, fixed: bool) -> tuple[TourProblem, _CertifiedTour]:
        """Certify a tour; motions that fail are excluded, and the tour is changed, with a fixed order its options only.

        NoAnswer if no tour was certified.
        """
        failed = ""
        for _ in range(REPAIRS):
            made, failures = self._run_through(tour)
            if not failures:
                self._shorten(made)
                return problem, made
            for failure, previous, option in failures:
                name = self.precedence.names[problem.job[option]] if option >= 0 else "the end"
                failed = f"{name}: {failure.part}: {failure.reason}"
                problem = self._excluding(problem, None if fixed else tour, failure, previous, option)
            # a job without any possible option is left out
            never = [k for k, choices in enumerate(problem.options) if not np.isfinite(problem.inner[choices]).any()]
            if never:
                why = {int(problem.job[option]): failure for failure, _, option in failures if option >= 0}
                last_failures = {k: why.get(k, failures[-1][0]) for k in never}
                raise _ImpossibleError({k: f"{failure.part}: {failure.reason}" for k, failure in last_failures.items()})
            # the best tour without what failed
            tour = problem.best_options(tour.order if fixed else problem.in_order(tour.order))
            if not fixed:
                tour = problem.improved(tour)
            if not np.isfinite(tour.seconds):
                break
        raise NoAnswer(f"no order was found in which every motion is certified; the last failure is {failed}")

    def _shorten(self, certified: _CertifiedTour) -> None:
        """Search longer for short motions where those of a certified tour exceed their bounds."""
        if not self.setup.budget.motion:
            return
        long: dict[int, list[str]] = {}
        for k, (previous, option, _) in enumerate(certified.places):
            for motion in certified.verdicts[k].motions:
                key = previous, option, motion.name, motion.trajectory.duration
                if key not in self.searched and LongMotions.of(self.setup, motion):
                    long.setdefault(k, []).append(motion.name)
        steps = [(certified.scenes[k], certified.verdicts[k], names) for k, names in long.items()]
        self.runner.report("shorten", 0, len(steps))
        shorter = self.runner.run("shorten", LongMotions(self.setup), steps, CHUNK)
        for k, verdict in zip(long, shorter, strict=True):
            certified.verdicts[k] = verdict
            self._keep(certified.places[k], verdict)
            previous, option, _ = certified.places[k]
            self.searched |= {(previous, option, motion.name, motion.trajectory.duration) for motion in verdict.motions}

    def _run_through(self, tour: Tour) -> tuple[_CertifiedTour, list[tuple[MotionFailure, int, int]]]:
        """Certify the motions of a tour that are not known, and return its beginning without failures, and these."""
        # the steps of the tour, and the scenes before each of them and after the last one
        previous, moved, scenes = START, Moved(), [self.setup.checker.scene]
        places: list[Place] = []
        for number in (self.numbers[k] for k in tour.options):
            places.append((previous, number, moved))
            job, option = self.options[number]
            scenes.append(scene_after(scenes[-1], job, option))
            if job.before is not None or option.after is not None:
                moved |= {number}
            previous = number
        # those that are not known in these scenes
        missing = [k for k, place in enumerate(places) if place not in self.steps]
        steps = []
        for k in missing:
            before, number, _ = places[k]
            job, option = self.options[number]
            q = self.options[before][1].exit if before != START else self.ends[0]
            known = self.known.get((number,), {}) | self.known.get((before, number), {})
            last = None if before == START else self.options[before][1].pick
            if last is not None and (self.tool_change is None or last.tool == option.pick.tool):
                last = None
            step = SequencedPick(
                scenes[k], option.entrance if q is None else q, option, self.jobs.index(job), last, known
            )
            steps.append(step)
        self.runner.report("motions", 0, len(steps))
        try:
            self.runner.run("motions", StepMotions(self.setup), steps, CHUNK)
        finally:  # also after Ctrl-C
            for k, row in self.runner.rows["motions"].items():
                self._keep(places[missing[k]], row)
            verdicts: list[PickVerdict] = []
            for place in places:
                verdict = self.steps.get(place)
                if not isinstance(verdict, PickVerdict):
                    break
                verdicts.append(verdict)
            made = self.partial = _CertifiedTour(tour, verdicts, scenes, places, self.tool_change or 0.0)
        failures = [
            (failure, earlier, option)
            for place, earlier, option in zip(places, (START, *tour.options), tour.options, strict=False)
            if isinstance(failure := self.steps[place], MotionFailure)
        ]
        if self.ends[1] is not None:
            own = self.known.setdefault((previous, START), {})
            final = self.options[previous][1]
            closing = closing_motion(self.setup, scenes[-1], final.exit, self.ends[1], own, final.pick)
            if isinstance(closing, MotionFailure):
                failures.append((closing, tour.options[-1], START))
            else:
                made.closing, own["transit"] = closing, closing.trajectory
        return made, failures

    def _excluding(
        self, problem: TourProblem, tour: Tour | None, failure: MotionFailure, previous: int, option: int
    ) -> TourProblem:
        """The problem with more precedence if a part blocks the motion, else without the failed transit or option.

        Without a tour, the order is given, so that only options are excluded.
        """
        if option == START:
            drop = self._unconnected(previous)
            return _without(problem, "inner", list(drop)) if drop else _without(problem, "end", previous)
        # a part of another job blocks the motion: at its place after that job, and at its first position before it
        job = int(problem.job[option])
        position = {} if tour is None else {job: k for k, job in enumerate(tour.order)}
        for name in failure.bodies if position else ():
            for blocking, owner in enumerate(self.jobs):
                if blocking == job or name not in {place.name for place in owner.places}:
                    continue
                self.blocked = True
                pair = (job, blocking) if position[blocking] < position[job] else (blocking, job)
                more = self.precedence.with_pairs({pair: f"{name} blocks {self.jobs[job].pick.name}"})
                if not more.cycle():
                    self.precedence = more
                    return replace(problem, precedence=more)
                # a part that blocks this option in both orders adds no precedence for the other options
                if pair[::-1] in self.precedence.reasons.keys() - self.required.reasons.keys():
                    kept = {old: why for old, why in self.precedence.reasons.items() if old != pair[::-1]}
                    self.precedence = replace(self.precedence, reasons=kept)
                    problem = replace(problem, precedence=self.precedence)
        # a motion of the pick itself, or a transit, cannot be part of a tour
        drop = {option} if failure.part not in ("return", "transit") else self._unconnected(previous, option)
        if drop:
            return _without(problem, "inner", list(drop))
        if previous == START:
            return _without(problem, "start", option)
        return _without(problem, "between", (previous, option))

    def _unconnected(self, *ends: int) -> set[int]:
        """The options connected to an end of a failed transit, if too many transits between them and others failed.

        Options are connected by certified transits. Those connected to home are never returned.
        """
        near: dict[int, set[int]] = {}
        failed = []
        for (a, b, _), step in self.steps.items():
            if isinstance(step, PickVerdict):
                near.setdefault(a, set()).add(b)
                near.setdefault(b, set()).add(a)
            elif step.part in ("return", "transit"):
                failed.append((a, b))
        for end in ends:
            queue = [START if end == START else self.numbers[end]]
            group = set(queue)
            for option in queue:
                more = near.get(option, set()) - group
                group |= more
                queue += more
            if START not in group and sum((a in group) != (b in group) for a, b in failed) >= UNREACHED:
                return {k for k, number in enumerate(self.numbers) if number in group}
        return set()

    # -- the result ---------------------------------------------------------------------------------------------------

    def result(self, *, interrupted: bool = False) -> SequenceResult:
        """The best result so far."""
        certified = self.best or self.partial
        steps: list[SequenceStep] = []
        now, arm = 0.0, self.setup.checker.arm
        bounds = Bounds.of(arm.limits, arm.joint_names)
        if certified is not None:
            for (_, number, _), verdict, scene in zip(
                certified.places, certified.verdicts, certified.scenes, strict=False
            ):
                pick = self.picks[self.given.names.index(self.options[number][0].pick.name)]
                rests = *self.dwell, self.tool_change or 0.0
                budgeted = home_of_budgeted(self.setup)
                steps.append(SequenceStep(pick, verdict, scene, now, bounds, *rests, budgeted))
                now = steps[-1].end
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


def _without(problem: TourProblem, name: str, where: int | list[int] | tuple[int, int]) -> TourProblem:
    """The problem with infinite seconds at some places of the array ``name``."""
    seconds = getattr(problem, name).copy()
    seconds[where] = np.inf
    return replace(problem, **{name: seconds})
