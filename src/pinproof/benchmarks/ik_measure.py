"""One row of the table: the same targets for every method, each call timed, each answer judged."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter_ns
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.benchmarks.ik_judge import Judged, judge_answers
from pinproof.benchmarks.ik_methods import Asked, IkMethod, Solvers
from pinproof.benchmarks.ik_problems import Targets
from pinproof.model import Arm

__all__ = ["IkRow", "measure"]

Array = npt.NDArray[np.float64]

WARM_UP = 50
"""Calls before the clock counts: compiled code is loaded, caches and seeds are made."""

MILLION = 1e6
"""Nanoseconds in a millisecond."""


@dataclass(frozen=True)
class IkRow:
    """A method's figures for one part of the table; times in ms, errors in m and rad, shares from 0 to 1.

    Parameters
    ----------
    robot, method, label
        Whose figures these are.
    problem, task, restarts
        What was asked.
    samples
        Targets asked, each once: what the quantiles are taken of.
    mean_ms, median_ms, p999_ms
        Of single calls from Python, everything included.
    batch_ms
        Mean a target in one batched call on one thread; None where the method has none.
    success
        The share of targets solved: answers inside the limits and within ``tolerance``, by Pinocchio. The lower one of
        single calls and batch.
    position_error, rotation_error
        The worst of all answers claimed; None where there is none.
    false_yes
        Answers claimed that are none.
    largest_step
        On the trajectory, the most a joint moved between neighbouring answers, in rad or m.
    tolerance
        In m and rad.
    textbook_ms, textbook_success
        The textbook's cell.
    rival, ratio
        Of a peer: the method of ours it is compared with, and its mean in units of that one's.
    """

    robot: str
    method: str
    label: str
    problem: str
    task: str
    restarts: bool
    samples: int
    mean_ms: float
    median_ms: float
    p999_ms: float
    batch_ms: float | None
    success: float
    position_error: float | None
    rotation_error: float | None
    false_yes: int
    largest_step: float | None
    tolerance: float
    textbook_ms: float | None = None
    textbook_success: float | None = None
    rival: str | None = None
    ratio: float | None = None


def measure(arm: Arm, robot: str, method: IkMethod, asked: Asked, targets: Targets) -> IkRow | None:
    """The row of a method, or None where it does not fit what is asked.

    Random targets all start at ``targets.start``; along the trajectory each call starts at the last answer.
    """
    if method.prepare(arm, asked) is None:
        return None
    count = min(len(targets.poses), method.most_points or len(targets.poses))
    poses = targets.poses[:count]
    for _ in _calls(_prepared(method, arm, asked), poses[:WARM_UP], targets.start, asked):
        pass
    solvers = _prepared(method, arm, asked)
    timed = list(_calls(solvers, poses, targets.start, asked))
    times = np.array([nanoseconds for nanoseconds, _ in timed]) / MILLION
    answers = _stacked([answer for _, answer in timed], arm.dof)
    single = judge_answers(arm, poses, answers, asked.task, method.tolerance)
    judged, batch_ms = [single], None
    if solvers.many is not None:
        batch_answers, batch_ms = _batch(solvers.many, poses, targets.start)
        judged.append(judge_answers(arm, poses, batch_answers, asked.task, method.tolerance))
    textbook_ms, textbook_success = method.textbook or (None, None)
    return IkRow(
        robot=robot,
        method=method.key,
        label=method.label,
        problem=asked.problem,
        task=asked.task,
        restarts=asked.restarts,
        samples=count,
        mean_ms=float(times.mean()),
        median_ms=float(np.median(times)),
        p999_ms=float(np.quantile(times, 0.999, method="higher")),
        batch_ms=batch_ms,
        success=min(each.success for each in judged),
        position_error=_worst(judged, "position_error"),
        rotation_error=_worst(judged, "rotation_error") if asked.task == "pose" else None,
        false_yes=sum(each.false_yes for each in judged),
        largest_step=_largest_step(answers, single) if asked.problem == "trajectory" else None,
        tolerance=method.tolerance,
        textbook_ms=textbook_ms,
        textbook_success=textbook_success,
        rival=method.rival,
    )


def _prepared(method: IkMethod, arm: Arm, asked: Asked) -> Solvers:
    """Fresh solvers: one that remembers its last answer does not start with that of the warm-up."""
    solvers = method.prepare(arm, asked)
    if solvers is None:
        raise RuntimeError(f"{method.key} fits {asked} at one call and not at the next")
    return solvers


def _calls(solvers: Solvers, poses: Array, start: Array, asked: Asked) -> Iterator[tuple[int, Array]]:
    """Nanoseconds and answers (k, n) of each single call."""
    made = [solvers.target(pose) for pose in poses]
    one, q0 = solvers.one, start
    solvers.begin(start)
    for target in made:
        begun = perf_counter_ns()
        answer: Any = one(target, q0)
        ended = perf_counter_ns()
        read = np.array(solvers.read(answer), dtype=float)
        if asked.problem == "trajectory" and len(read) and np.isfinite(read[0]).all():
            q0 = read[0]
        yield ended - begun, read


def _batch(many: Any, poses: Array, start: Array) -> tuple[Array, float]:
    many(poses[:WARM_UP], start)
    begun = perf_counter_ns()
    answers = many(poses, start)
    ended = perf_counter_ns()
    return np.asarray(answers, dtype=float), (ended - begun) / MILLION / len(poses)


def _stacked(answers: list[Array], dof: int) -> Array:
    """(N, k, n) from N answers (k, n) of different k, filled up with NaN."""
    stacked = np.full((len(answers), max([1, *map(len, answers)]), dof), np.nan)
    for row, answer in enumerate(answers):
        stacked[row, : len(answer)] = answer
    return stacked


def _worst(judged: list[Judged], name: str) -> float | None:
    errors = np.concatenate([getattr(each, name)[each.answered] for each in judged])
    return float(errors.max()) if len(errors) else None


def _largest_step(answers: Array, judged: Judged) -> float | None:
    first = answers[:, 0]
    both = judged.right[1:] & judged.right[:-1]
    steps = np.abs(np.diff(first, axis=0)).max(axis=1)[both]
    return float(steps.max()) if len(steps) else None
