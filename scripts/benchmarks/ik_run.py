"""The IK benchmark: every method solves the same targets; each call is timed and each answer is checked.

The check uses Pinocchio's forward kinematics and does not depend on the status that a method reports.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from time import perf_counter_ns
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.ik_methods import (
    OWN_METHODS,
    PARTS,
    PERIOD,
    RESTARTS,
    TOLERANCE,
    IkMethod,
    Part,
    PreparedMethod,
    select_methods,
)
from benchmarks.ik_peers import PEERS
from benchmarks.tables import (
    Columns,
    Results,
    Row,
    installed_versions,
    leave_out,
    log_panel,
    new_figure,
    provenance,
    row_table,
    wrapped,
)
from pinproof.errors import InputError
from pinproof.model import Arm, load_robot
from pinproof.spatial import Array, rigid, twist_size

MARKERS = "osD^vP*X<>ph"


def rows_of(results: Results, robot: str, part: Part) -> list[Row]:
    """The rows of a robot in one part of the table."""
    return [row for row in results["rows"] if _part_of(row) == (robot, part.problem, part.task, part.restarts)]


def _part_of(row: Row) -> tuple[str, str, str, bool]:
    return row.robot, row.problem, row.task, row.restarts


# -- tables and plot ---------------------------------------------------------------------------------------------------


def ik_tables(results: Results) -> list[str]:
    """A section for each robot with a table for each part."""
    lines: list[str] = []
    for robot in results.settings["robots"]:
        lines += [f"## {robot}", "", *_limits(results, robot), ""]
        for part in PARTS:
            if rows := rows_of(results, robot, part):
                columns = {"method": partial(_name, results), **COLUMNS}
                lines += [f"### {robot}: {part}", "", *row_table(columns, rows), ""]
        if reasons := results["left_out"].get(robot):
            lines += ["Left out:", "", *(f"- {name}: {reason}" for name, reason in reasons.items()), ""]
    return lines[:-1]


def _limits(results: Results, robot: str) -> list[str]:
    def bound(value: float | None) -> str:
        return "unbounded" if value is None else f"{value:.4g}"

    chain = results.settings["chains"][robot]
    ranges = [
        f"{name} {bound(low)} to {bound(high)}"
        for name, low, high in zip(chain["joints"], chain["lower"], chain["upper"], strict=True)
    ]
    return wrapped(f"TCP: {chain['tcp']}. Limits (rad, m): {', '.join(ranges)}.")


def percent(value: float | None) -> str:
    """Return a share in percent, with at most three decimals and never rounded up to 100 %; empty for None."""
    if value is None:
        return ""
    return "100 %" if value == 1.0 else f"{min(100 * value, 99.999):.3f}".rstrip("0").rstrip(".") + " %"


def _name(results: Results, row: Row) -> str:
    label = row.label if row.tolerance == TOLERANCE else f"{row.label} (within {row.tolerance:g})"
    return label if row.samples == results.settings["points"] else f"{label} ({row.samples:,} targets)"


def _milliseconds(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}" if value < 100 else f"{value:.0f}"


COLUMNS: Columns = {
    "mean": lambda row: _milliseconds(row.mean_ms),
    "median": lambda row: _milliseconds(row.median_ms),
    "p99.9": lambda row: _milliseconds(row.p999_ms),
    "batch mean": lambda row: _milliseconds(row.batch_ms),
    "success": lambda row: percent(row.success),
    "max position error": "{.position_error:.1e} m",
    "max rotation error": "{.rotation_error:.1e} rad",
    "false positives": "{.false_positives}",
    "largest step": "{.largest_step:.3g}",
    "textbook mean": "{.textbook_ms:g}",
    "textbook success": lambda row: percent(row.textbook_success),
    "relative time": "{.ratio:.3g}",
}
"""The columns after the method: their titles, and the format of a row."""


def latency_plot(results: Results) -> Any:
    """Success against mean time: one row of panels per robot; filled: single calls, hollow: batches.

    Crosses are the figures of the textbook; a dotted line connects them with our figures of the same method.
    """
    styles: dict[str, tuple[str, str]] = {}
    robots = results.settings["robots"]
    figure, panels = new_figure(len(robots), len(PARTS), width=3.4, height=3.0)
    for robot, line in zip(robots, panels, strict=True):
        for part, panel in zip(PARTS, line, strict=True):
            restarts = "" if part.problem == "trajectory" else ", restarts" if part.restarts else ", one seed"
            log_panel(panel, f"{robot}: {part.problem}, {part.task}{restarts}", "mean time, ms", "solved, %")
            for row in rows_of(results, robot, part):
                k = len(styles)
                _plot_row(panel, row, *styles.setdefault(row.label, (f"C{k % 10}", MARKERS[k % len(MARKERS)])))
    first = panels[0][0]
    for label, (colour, marker) in styles.items():
        first.plot([], [], marker, color=colour, label=label)
    first.plot([], [], "x", color="grey", label="textbook")
    first.plot([], [], "o", color="grey", fillstyle="none", label="hollow: batch")
    figure.legend(loc="outside lower center", ncols=6, fontsize=8)
    return figure


def _plot_row(panel: Any, row: Row, colour: str, marker: str) -> None:
    solved = 100 * row.success
    if row.textbook_ms is not None and row.textbook_success is not None:
        textbook = 100 * row.textbook_success
        panel.plot((row.textbook_ms, row.mean_ms), (textbook, solved), ":", color=colour, linewidth=0.8)
        panel.plot(row.textbook_ms, textbook, "x", color=colour)
    if row.batch_ms is not None:
        panel.plot(row.batch_ms, solved, marker, color=colour, fillstyle="none")
    panel.plot(row.mean_ms, solved, marker, color=colour)


Flags = npt.NDArray[np.bool_]

REDUCED_RANGES = "ranges wider than one full rotation reduced to +-pi about their centre"

WARM_UP = 50
"""Calls before the measurement, which load compiled code and fill caches."""

NANOSECONDS_PER_MS = 1e6

CYCLE = 10.0
"""Seconds in which the slowest joint of the trajectory completes one cycle."""

SHARE_OF_RANGE, SHARE_OF_SPEED = 0.45, 0.3
"""Amplitude of the joint motions along the trajectory as a share of the range, and their largest speed as a share of
the velocity limit. A redundant arm may use other joints for the same poses, which needs a reserve of speed."""


# -- targets -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Targets:
    """Reachable targets (N, 4, 4), base_from_target, and what generated them.

    ``q`` (N, n) are the configurations inside the limits that generated the targets, unknown to the methods, and
    ``start`` (n,) is where methods start: the middle of the ranges, or the beginning of the trajectory.
    """

    poses: Array
    q: Array
    start: Array


def with_reduced_ranges(arm: Arm) -> Arm:
    """Return the arm with each finite range wider than 2 pi reduced to +-pi about its centre, as for the UR5."""
    lower, upper = arm.limits.lower.copy(), arm.limits.upper.copy()
    wide = arm.periodic & np.isfinite(upper - lower) & (upper - lower > 2 * np.pi)
    centre = (lower[wide] + upper[wide]) / 2
    lower[wide], upper[wide] = centre - np.pi, centre + np.pi
    return arm.with_limits(replace(arm.limits, lower=lower, upper=upper))


def random_targets(arm: Arm, points: int, seed: int) -> Targets:
    """Return the poses of configurations drawn uniformly within the limits (+-pi for a joint without limits)."""
    lower, upper = arm.limits.sampling_range()
    q = np.random.default_rng(seed).uniform(lower, upper, (points, arm.dof))
    return Targets(arm.forward_kinematics_batch(q), q, (lower + upper) / 2)


def smooth_targets(arm: Arm, points: int, seed: int) -> Targets:
    """Return poses along a smooth curve within the position and velocity limits, :data:`PERIOD` apart.

    Each joint follows a sine about the middle of its range with one to three periods per cycle. The poses may pass
    singularities; the configurations that generated them prove that they can be followed without a jump.
    """
    lower, upper = arm.limits.sampling_range()
    speed = 2 * np.pi * (1.0 + np.arange(arm.dof) % 3) / CYCLE
    largest = np.where(np.isnan(arm.limits.velocity), np.inf, arm.limits.velocity)
    amplitude = np.minimum(SHARE_OF_RANGE * (upper - lower), SHARE_OF_SPEED * largest / speed)
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, arm.dof)
    time = PERIOD * np.arange(points)[:, None]
    q = (lower + upper) / 2 + amplitude * np.sin(speed * time + phase)
    return Targets(arm.forward_kinematics_batch(q), q, q[0].copy())


# -- check of the answers ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class CheckedAnswers:
    """The check of the answers to N targets.

    ``answered`` (N,) states whether the method reports an answer, and ``correct`` (N,) whether all that it reports are
    inside the limits and within the tolerance. ``errors`` (N, 2) are position and rotation error of the worst answer in
    m and rad: infinite if it is not finite, 0 without an answer and for what the task leaves free.
    """

    answered: Flags
    correct: Flags
    errors: Array

    @property
    def success(self) -> float:
        """Share of targets that were solved."""
        return float(self.correct.mean())

    @property
    def false_positives(self) -> int:
        """Number of targets reported as solved whose answers fail the check."""
        return int((self.answered & ~self.correct).sum())


def check_answers(arm: Arm, targets: Array, answers: Array, task: str, tolerance: float) -> CheckedAnswers:
    """Check answers (N, k, n) to targets (N, 4, 4); a row of NaN means no answer.

    ``tolerance`` is in m and rad; ``task`` is ``"pose"`` or ``"position"``. Answers are neither wrapped nor clipped.
    """
    reported: Flags = np.asarray(~np.isnan(answers).all(axis=2))
    inside: Flags = np.asarray(((arm.limits.lower <= answers) & (answers <= arm.limits.upper)).all(axis=2))
    correct = np.ones(reported.shape, dtype=bool)
    errors = np.zeros((*reported.shape, 2))
    for row, column in np.argwhere(reported):
        q = answers[row, column]
        if np.isfinite(q).all():
            errors[row, column] = twist_size(rigid("target", targets[row]), arm.forward_kinematics(q))
        else:
            errors[row, column] = np.inf
        if task == "position":
            errors[row, column, 1] = 0.0
        correct[row, column] = inside[row, column] and bool((errors[row, column] <= tolerance).all())
    answered = np.asarray(reported.any(axis=1))
    return CheckedAnswers(answered, np.asarray(answered & correct.all(axis=1)), errors.max(axis=1, initial=0.0))


# -- measurement -------------------------------------------------------------------------------------------------------


def measured_row(arm: Arm, robot: str, method: IkMethod, part: Part, targets: Targets) -> Row:
    """Return the row of a method in a part to which it applies; times in ms, errors in m and rad.

    ``success`` is the share of targets whose answers pass :func:`check_answers`, the lower one of single calls and of
    one batch; ``false_positives`` are reported as solved and fail. ``largest_step`` is the largest joint motion between
    consecutive answers on the trajectory. ``ratio``, for another library, compares with our method ``compared_with``.

    All calls on random targets start at ``targets.start``; along the trajectory each starts at the last answer.
    """
    poses = targets.poses[: method.max_targets]
    for _ in _solve_each(method.prepare(arm, part), poses[:WARM_UP], targets.start, part):
        pass
    prepared = method.prepare(arm, part)  # again, because a method may keep the state of the last call
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
    errors = np.concatenate([each.errors[each.answered] for each in checked])
    both = single.correct[1:] & single.correct[:-1]  # two consecutive answers are correct
    steps = np.abs(np.diff(answers[:, 0], axis=0)).max(axis=1)[both] if part.problem == "trajectory" else np.empty(0)
    return Row(
        robot=robot,
        method=method.key,
        label=method.label,
        **asdict(part),
        samples=len(poses),
        mean_ms=float(times.mean()),
        median_ms=float(np.median(times)),
        p999_ms=float(np.quantile(times, 0.999, method="higher")),
        batch_ms=batch_ms,
        success=min(each.success for each in checked),
        position_error=_largest(errors[:, 0]),
        rotation_error=_largest(errors[:, 1]) if part.task == "pose" else None,
        false_positives=sum(each.false_positives for each in checked),
        largest_step=_largest(steps),
        tolerance=method.tolerance,
        textbook_ms=textbook_ms,
        textbook_success=textbook_success,
        compared_with=method.compared_with,
        ratio=None,
    )


def _solve_each(prepared: PreparedMethod, poses: Array, start: Array, part: Part) -> Iterator[tuple[int, Array]]:
    """Yield the nanoseconds and the answers (k, n) of each single call."""
    targets = [prepared.convert_target(pose) for pose in poses]
    solve, q0 = prepared.solve, start
    if prepared.reset is not None:
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


def _largest(values: Array) -> float | None:
    return float(values.max()) if len(values) else None


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
) -> Results:
    """Run the IK benchmark on arms of the catalogue or robot files; InputError for unknown methods.

    ``points`` is the number of targets per part, ``methods`` are keys, by default all, and ``peers`` includes other
    libraries, of which those that cannot be run are listed with the reason. ``limits_pi`` reduces ranges wider than one
    full rotation to +-pi about their centre, as for the UR5.
    """
    if points < 1:
        raise InputError(f"points must be at least 1, not {points}")
    selected = select_methods(methods, (*OWN_METHODS, *(PEERS if peers else ())))
    report = on_progress or (lambda _: None)
    rows: list[Row] = []
    left_out: dict[str, dict[str, str]] = {name: {} for name in robots}
    chains: dict[str, Any] = {}
    origin = provenance(seed)
    for name in robots:
        arm = load_arm(name, limits_pi)
        limits = {"lower": _finite(arm.limits.lower), "upper": _finite(arm.limits.upper)}
        chains[name] = {"tcp": arm.tcp, "joints": list(arm.joint_names), **limits}
        targets = {"random": random_targets(arm, points, seed), "trajectory": smooth_targets(arm, points, seed)}
        for method in selected:
            report(f"{name}: {method.label}")
            with leave_out(left_out[name], method.key, own=method.compared_with is None):
                for part in filter(method.applies, PARTS):
                    rows.append(measured_row(arm, name, method, part, targets[part.problem]))
    settings = {
        "robots": list(robots),
        "points": points,
        "peers": peers,
        "limits": REDUCED_RANGES if limits_pi else "as declared",
        "chains": chains,
        "restarts": RESTARTS,
        "tolerance": TOLERANCE,
        "trajectory_period_s": PERIOD,
        "peer_versions": installed_versions(method.distribution for method in selected),
    }
    for row in rows:  # another library in relation to our method for the same part
        for other in rows:
            if _part_of(other) == _part_of(row) and other.method == row.compared_with:
                row.ratio = row.mean_ms / other.mean_ms
    return Results(settings, origin, {"rows": rows, "left_out": left_out})


def load_arm(robot: str, limits_pi: bool) -> Arm:
    """Return an arm of the catalogue or a file, with ranges of at most one full rotation if ``limits_pi``."""
    arm = load_robot(robot).arm()
    return with_reduced_ranges(arm) if limits_pi else arm


def _finite(values: Array) -> list[float | None]:
    """Numbers for JSON: None for a joint without a limit."""
    return [float(value) if np.isfinite(value) else None for value in values]
