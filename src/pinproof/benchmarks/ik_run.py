"""The IK benchmark: every method solves the same targets; each call is timed and each answer is checked."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from time import perf_counter_ns
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.benchmarks.ik_methods import (
    OWN_METHODS,
    PERIOD,
    RESTARTS,
    TOLERANCE,
    IkMethod,
    Part,
    PreparedMethod,
    select_methods,
)
from pinproof.benchmarks.ik_peers import PEERS
from pinproof.benchmarks.ik_problems import (
    CheckedAnswers,
    Targets,
    check_answers,
    random_targets,
    smooth_targets,
    with_reduced_ranges,
)
from pinproof.benchmarks.ik_table import PARTS, IkRow, IkTable
from pinproof.benchmarks.tables import NotApplicableError, installed_version, leave_out, provenance
from pinproof.errors import InputError
from pinproof.model import Arm, load_robot

__all__ = ["WARM_UP", "ik_benchmark", "load_arm", "measure", "timed_batch"]

Array = npt.NDArray[np.float64]

REDUCED_RANGES = "ranges wider than one full rotation reduced to +-pi about their centre"

WARM_UP = 50
"""Calls before the measurement, which load compiled code and fill caches."""

NANOSECONDS_PER_MS = 1e6


def measure(arm: Arm, robot: str, method: IkMethod, part: Part, targets: Targets) -> IkRow | None:
    """Return the row of a method, or None if the part does not apply to it.

    All calls on random targets start at ``targets.start``; along the trajectory each starts at the last answer.
    """
    poses = targets.poses[: method.max_targets]
    warm_up = method.prepare(arm, part)
    if warm_up is None:
        return None
    for _ in _solve_each(warm_up, poses[:WARM_UP], targets.start, part):
        pass
    prepared = method.prepare(arm, part) or warm_up  # prepared again: methods may keep the state of the last call
    timed = list(_solve_each(prepared, poses, targets.start, part))
    times = np.array([nanoseconds for nanoseconds, _ in timed]) / NANOSECONDS_PER_MS
    answers = _stacked([answer for _, answer in timed], arm.dof)
    single = check_answers(arm, poses, answers, part.task, method.tolerance)
    checked, batch_ms = [single], None
    if prepared.solve_batch is not None:
        prepared.solve_batch(poses[:WARM_UP], targets.start)
        batch_answers, nanoseconds = timed_batch(prepared.solve_batch, poses, targets.start)
        batch_ms = nanoseconds / NANOSECONDS_PER_MS / len(poses)
        checked.append(check_answers(arm, poses, batch_answers, part.task, method.tolerance))
    textbook_ms, textbook_success = method.textbook or (None, None)
    return IkRow(
        robot=robot,
        method=method.key,
        label=method.label,
        problem=part.problem,
        task=part.task,
        restarts=part.restarts,
        samples=len(poses),
        mean_ms=float(times.mean()),
        median_ms=float(np.median(times)),
        p999_ms=float(np.quantile(times, 0.999, method="higher")),
        batch_ms=batch_ms,
        success=min(each.success for each in checked),
        position_error=_largest([each.position_error[each.answered] for each in checked]),
        rotation_error=_largest([each.rotation_error[each.answered] for each in checked])
        if part.task == "pose"
        else None,
        false_positives=sum(each.false_positives for each in checked),
        largest_step=_largest_step(answers, single) if part.problem == "trajectory" else None,
        tolerance=method.tolerance,
        textbook_ms=textbook_ms,
        textbook_success=textbook_success,
        compared_with=method.compared_with,
    )


def _solve_each(prepared: PreparedMethod, poses: Array, start: Array, part: Part) -> Iterator[tuple[int, Array]]:
    """Yield the nanoseconds and the answers (k, n) of each single call."""
    targets = [prepared.convert_target(pose) for pose in poses]
    solve, q0 = prepared.solve, start
    prepared.reset(start)
    for target in targets:
        begin = perf_counter_ns()
        result: Any = solve(target, q0)
        end = perf_counter_ns()
        answers = np.array(prepared.read(result), dtype=float)
        if part.problem == "trajectory" and len(answers) and np.isfinite(answers[0]).all():
            q0 = answers[0]
        yield end - begin, answers


def timed_batch(solve_batch: Callable[[Array, Array], Array], poses: Array, start: Array) -> tuple[Array, int]:
    """Return the answers (N, k, n) and the nanoseconds of one batch."""
    begin = perf_counter_ns()
    answers = solve_batch(poses, start)
    end = perf_counter_ns()
    return np.asarray(answers, dtype=float), end - begin


def _stacked(answers: list[Array], dof: int) -> Array:
    """N answers (k, n) with different k as one array (N, k, n), padded with NaN."""
    stacked = np.full((len(answers), max([1, *map(len, answers)]), dof), np.nan)
    for row, answer in enumerate(answers):
        stacked[row, : len(answer)] = answer
    return stacked


def _largest(arrays: list[Array]) -> float | None:
    values = np.concatenate(arrays)
    return float(values.max()) if len(values) else None


def _largest_step(answers: Array, checked: CheckedAnswers) -> float | None:
    both = checked.correct[1:] & checked.correct[:-1]
    return _largest([np.abs(np.diff(answers[:, 0], axis=0)).max(axis=1)[both]])


# -- runs --------------------------------------------------------------------------------------------------------------


def ik_benchmark(
    robots: Sequence[str] = ("ur5",),
    *,
    points: int = 10_000,
    methods: Sequence[str] | None = None,
    peers: bool = True,
    limits_pi: bool = True,
    seed: int = 0,
    on_progress: Callable[[str], None] | None = None,
) -> IkTable:
    """Run the IK benchmark.

    Parameters
    ----------
    robots
        Catalogue names or robot files.
    points
        Targets per part.
    methods
        Keys of the methods to run, including those of other libraries; by default all.
    peers
        Whether to include other libraries. Those that cannot be run are listed with the reason.
    limits_pi
        Reduce ranges wider than one full rotation to +-pi about their centre, as for the UR5.
    seed
        Seed of the targets.
    on_progress
        Called with a description of the current step.

    Raises
    ------
    InputError
        If ``points`` is below 1, or for an unknown method or robot.
    """
    if points < 1:
        raise InputError(f"points must be at least 1, not {points}")
    selected = select_methods(None if methods is None else tuple(methods), (*OWN_METHODS, *(PEERS if peers else ())))
    report = on_progress or (lambda _: None)
    rows: list[IkRow] = []
    left_out: dict[str, dict[str, str]] = {name: {} for name in robots}
    chains: dict[str, Any] = {}
    origin = provenance(seed)
    for name in robots:
        arm = load_arm(name, limits_pi)
        chains[name] = {
            "tcp": arm.tcp,
            "joints": list(arm.joint_names),
            "lower": _finite(arm.limits.lower),
            "upper": _finite(arm.limits.upper),
        }
        targets = {"random": random_targets(arm, points, seed), "trajectory": smooth_targets(arm, points, seed)}
        for method in selected:
            report(f"{name}: {method.label}")
            before = len(rows)
            with leave_out(left_out[name], method.key, own=method.compared_with is None):
                for part in PARTS:
                    row = measure(arm, name, method, part, targets[part.problem])
                    rows += [] if row is None else [row]
                if len(rows) == before:
                    raise NotApplicableError("applies to no part of this table")
    settings = {
        "robots": list(robots),
        "points": points,
        "peers": peers,
        "limits": REDUCED_RANGES if limits_pi else "as declared",
        "chains": chains,
        "restarts": RESTARTS,
        "tolerance": TOLERANCE,
        "trajectory_period_s": PERIOD,
        "peer_versions": {m.key: installed_version(m.distribution) for m in selected if m.distribution is not None},
    }
    return IkTable(settings, origin, tuple(_with_ratio(row, rows) for row in rows), left_out)


def load_arm(robot: str, limits_pi: bool) -> Arm:
    """Return an arm of the catalogue or a file, with ranges of at most one full rotation if ``limits_pi``."""
    arm = load_robot(robot).arm()
    return with_reduced_ranges(arm) if limits_pi else arm


def _with_ratio(row: IkRow, rows: list[IkRow]) -> IkRow:
    """Return the row of another library with the ratio of its mean time to that of our method."""
    for other in rows:
        if other.robot_and_part == row.robot_and_part and other.method == row.compared_with:
            return replace(row, ratio=row.mean_ms / other.mean_ms)
    return row


def _finite(values: Array) -> list[float | None]:
    """Numbers for JSON: None for a joint without a limit."""
    return [float(value) if np.isfinite(value) else None for value in values]
