"""The IK benchmark: every method solves the same targets; each call is timed and each answer is checked.

The check uses Pinocchio's forward kinematics and does not depend on the status that a method reports.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter_ns
from typing import Any, ClassVar

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
    BenchmarkTable,
    installed_versions,
    leave_out,
    log_panel,
    new_figure,
    provenance,
    provenance_text,
    row_table,
    save_figure,
    wrapped,
)
from pinproof.errors import InputError
from pinproof.model import Arm, load_robot
from pinproof.spatial import Array, rigid, twist_size

MARKERS = "osD^vP*X<>ph"


@dataclass(frozen=True)
class IkRow:
    """The figures of a method in one part of the table; times in ms, errors in m and rad, shares from 0 to 1.

    Times are those of single calls from Python; ``batch_ms`` is the mean time per target of one batch on one thread.
    ``success`` is the share of targets whose answers are inside the limits and within ``tolerance`` by Pinocchio's
    forward kinematics, the lower one of single calls and batch. ``position_error`` and ``rotation_error`` are the
    largest of all reported answers; ``false_positives`` counts answers that are reported as solutions and fail this
    check. ``largest_step`` is the largest joint motion (rad or m) between consecutive answers on the trajectory.
    ``ratio``, for another library, is its mean time divided by that of our method ``compared_with``.
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
    false_positives: int
    largest_step: float | None
    tolerance: float
    textbook_ms: float | None = None
    textbook_success: float | None = None
    compared_with: str | None = None
    ratio: float | None = None

    @property
    def robot_and_part(self) -> tuple[str, str, str, bool]:
        """The robot and its part of the table, which identify the targets of the row."""
        return self.robot, self.problem, self.task, self.restarts


@dataclass(frozen=True)
class IkTable(BenchmarkTable):
    """The rows of every robot, part and method, and for each robot why methods could not be run."""

    rows: tuple[IkRow, ...]
    left_out: dict[str, dict[str, str]]

    topic: ClassVar[str] = "inverse kinematics"
    row_types: ClassVar[dict[str, type]] = {"rows": IkRow}

    @property
    def robots(self) -> tuple[str, ...]:
        """The robots in the order of the run."""
        return tuple(self.settings["robots"])

    def part(self, robot: str, part: Part) -> tuple[IkRow, ...]:
        """Return the rows of a robot in one part."""
        return tuple(row for row in self.rows if row.robot_and_part == (robot, part.problem, part.task, part.restarts))


def write_ik_table(table: IkTable, folder: str | Path, *, appendix: str = "") -> list[Path]:
    """Write ``ik.json``, ``ik.md``, which ends with ``appendix``, and ``ik_latency.png``; return these files."""
    written = table.write(folder, "ik", "# Inverse kinematics benchmark\n\n" + ik_markdown(table) + appendix)
    return [*written, save_figure(_latency_plot(table), Path(folder) / "ik_latency.png")]


# -- Markdown ----------------------------------------------------------------------------------------------------------


def ik_markdown(table: IkTable) -> str:
    """Return the table as Markdown, without a title."""
    lines = [*_introduction(table), ""]
    for robot in table.robots:
        lines += [f"## {robot}", "", *_limits(table, robot), ""]
        for part in PARTS:
            rows = table.part(robot, part)
            if rows:
                columns = {"method": partial(_name, table), **COLUMNS}
                lines += [f"### {robot}: {part}", "", *row_table(columns, rows), ""]
        reasons = table.left_out.get(robot, {})
        if reasons:
            lines += ["Left out:", "", *(f"- {name}: {reason}" for name, reason in reasons.items()), ""]
    return "\n".join(lines).rstrip() + "\n"


def _introduction(table: IkTable) -> list[str]:
    settings = table.settings
    targets = (
        f"{settings['points']:,} targets per part, joint limits enforced, {settings['limits']}. Random targets are the "
        "poses of configurations drawn uniformly within the limits; each solve starts from the middle of the joint "
        f"ranges. Methods with restarts may restart up to {settings['restarts']} times."
    )
    check = (
        "A target counts as solved if the answer is inside the limits and within "
        f"{settings['tolerance']:g} m and {settings['tolerance']:g} rad (or the tolerance given in the row) by "
        "Pinocchio's forward kinematics, independent of the status that the method reports. A false positive is "
        "reported as solved but fails this independent check."
    )
    times = (
        "Times are in ms, for single calls from Python including all overhead; the batch mean is the time per target "
        f"of one batch on one thread. p99.9 is the 99.9th percentile of {settings['points']:,} calls (with fewer than "
        "1,000 calls it is the maximum). For other libraries, the relative time is their mean time divided by that of "
        "our method for the same problem."
    )
    textbook = (
        "The textbook columns are figures from the textbook: mean time and success over 10,000 points, position only, "
        "one seed, on an unknown machine."
    )
    return [*wrapped(targets, check, times), "", *wrapped(provenance_text(table), textbook)]


def _limits(table: IkTable, robot: str) -> list[str]:
    def bound(value: float | None) -> str:
        return "unbounded" if value is None else f"{value:.4g}"

    chain = table.settings["chains"][robot]
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


def _name(table: IkTable, row: IkRow) -> str:
    label = row.label if row.tolerance == TOLERANCE else f"{row.label} (within {row.tolerance:g})"
    return label if row.samples == table.settings["points"] else f"{label} ({row.samples:,} targets)"


def _milliseconds(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}" if value < 100 else f"{value:.0f}"


COLUMNS: dict[str, str | Callable[[IkRow], str]] = {
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


# -- plot --------------------------------------------------------------------------------------------------------------


def _latency_plot(table: IkTable) -> Any:
    """Success against mean time: one row of panels per robot; filled: single calls, hollow: batches.

    Crosses are the figures of the textbook; a dotted line connects them with our figures of the same method.
    """
    styles: dict[str, tuple[str, str]] = {}
    figure, panels = new_figure(len(table.robots), len(PARTS), width=3.4, height=3.0)
    for robot, line in zip(table.robots, panels, strict=True):
        for part, panel in zip(PARTS, line, strict=True):
            restarts = "" if part.problem == "trajectory" else ", restarts" if part.restarts else ", one seed"
            log_panel(panel, f"{robot}: {part.problem}, {part.task}{restarts}", "mean time, ms", "solved, %")
            for row in table.part(robot, part):
                k = len(styles)
                _plot_row(panel, row, *styles.setdefault(row.label, (f"C{k % 10}", MARKERS[k % len(MARKERS)])))
    first = panels[0][0]
    for label, (colour, marker) in styles.items():
        first.plot([], [], marker, color=colour, label=label)
    first.plot([], [], "x", color="grey", label="textbook")
    first.plot([], [], "o", color="grey", fillstyle="none", label="hollow: batch")
    figure.legend(loc="outside lower center", ncols=6, fontsize=8)
    return figure


def _plot_row(panel: Any, row: IkRow, colour: str, marker: str) -> None:
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

    Parameters
    ----------
    answered
        (N,) whether the method reports an answer.
    correct
        (N,) whether all answers that it reports are inside the limits and within the tolerance.
    errors
        (N, 2) position and rotation error of the worst answer, in m and rad; infinite if it is not finite, 0 without an
        answer and for what the task leaves free.
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


def measured_row(arm: Arm, robot: str, method: IkMethod, part: Part, targets: Targets) -> IkRow:
    """Return the row of a method in a part to which it applies.

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
    return IkRow(
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
    selected = select_methods(methods, (*OWN_METHODS, *(PEERS if peers else ())))
    report = on_progress or (lambda _: None)
    rows: list[IkRow] = []
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
