"""The order of the picks of a cell with the shortest certified cycle time.

The order and the grasp and IK branches of each pick are chosen by lower bounds of the motion times: the shortest time
of the slowest joint from rest to rest, without obstacles. The motions are then planned, timed and certified in the
sequence, each in the scene of its moment. Where a motion takes longer than its bound, its certified time replaces the
bound, and the order is improved again until the certified time no longer decreases.
"""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import Executor
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.cell.sequencing.options import Job
from pinproof.cell.sequencing.precedence import Precedence
from pinproof.cell.sequencing.sequence_result import LeftOut, SequenceResult
from pinproof.cell.sequencing.sequence_run import SequenceBudget, SequenceRun
from pinproof.errors import InputError, RunInterrupted
from pinproof.picks import Pick, PickSetup
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
        If names are not unique, precedence is contradictory, or two picks carry the same object.
    UnknownNameError
        If the precedence or the order names a pick that does not exist.
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
        missing = [name for name in pairs.names if name not in names]
        doubled = sorted({name for name in names if names.count(name) > 1})
        if missing or doubled:
            wrong = f"lacks {', '.join(missing)}" if missing else f"repeats {', '.join(doubled)}"
            raise InputError(f"the order {wrong}; it must name every pick once")
    budget = budget or SequenceBudget()
    setup = replace(setup, budget=replace(setup.budget, motion=budget.motion))
    dwell = _dwell("grip_dwell", grip_dwell), _dwell("release_dwell", release_dwell)
    ends = _configuration(setup, start, "start"), _configuration(setup, end, "end")
    with Runner(executor=executor, workers=workers, progress=progress) as runner:
        run = SequenceRun(setup, given, pairs, ends, dwell, budget, runner, fixed_order)
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
    given = _checked(setup, picks)
    home, none = (setup.home, setup.home), Precedence.stated((pick.name for pick in given), ())
    run = SequenceRun(setup, given, none, home, (0.0, 0.0), budget, Runner())
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


def _dwell(name: str, value: float) -> float:
    if not (isinstance(value, int | float) and 0 <= value < float("inf")):
        raise InputError(f"{name} = {value!r}; it must be a number of seconds, 0 or more")
    return float(value)


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
