"""What makes a cell slow: the time of each stage of the work, and of each body in the proofs beside it."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from pinproof.collision import (
    Body,
    CollisionChecker,
    ConvexShape,
    LineSurface,
    Obstacle,
    Scene,
    Shape,
    is_proven_free,
    outer_points,
)
from pinproof.common.results import Rows, Saved, View, Written
from pinproof.common.steps import LOG, SUGGESTIONS
from pinproof.common.structs import ANY_TEXT, key, reported, struct
from pinproof.motion import Curve, JointPath
from pinproof.picks.judging.task import PickTask
from pinproof.picks.judging.verdict import PickStatus
from pinproof.picks.report.report import PickReport
from pinproof.spatial import SE3, Array

SHORT = 0.01
"""Share of the time from which a step on a mesh has a row of its own."""

MOST_MOTIONS, REPEATS = 20, 3
"""Good picks or strokes along whose motions bodies are compared, and repetitions, of which the fastest counts."""

MOST_GROUPS = 40
"""Shapes that are compared one by one, those with the most bodies first; the others are compared together."""

LARGE, CLEAR = 0.1, 2.0
"""Share of the time from which a body has an advice, and its least ratio to the median of all bodies."""


@struct("stage time")
class StageTime:
    """The time of a stage."""

    stage: str = key("name of the stage, or `suggestions` or `other`")
    seconds: float = key("time of the stage in all picks or strokes", "s")
    calls: int = key("number of times that the stage began")


@struct("body time")
class BodyTime:
    """The time of the obstacles of one shape in proofs."""

    name: str = key("the obstacles of one shape, or `robot` for the links and what they hold", kind=ANY_TEXT)
    seconds: float = key("time of proving the motions beside these bodies alone", "s")
    share: float = key("part of the sum over all bodies", minimum=0, maximum=1)
    geometry: str = key("how the body is represented", kind=ANY_TEXT)
    advice: str = key("what would be faster; may be empty", kind=ANY_TEXT)


@struct("profile", version="pinproof/profile/1", first=("summary", "stages", "bodies"), written=True, eq=False)
class WorkProfile(Saved, Written):
    """Where the time was spent; made by :func:`profile_picks`, and by :func:`pinproof.tool_paths.profile_job`."""

    report: Any = key("the report on the picks or strokes", hidden=True)
    stages: tuple[StageTime, ...] = key("the stages, the slowest first")
    bodies: tuple[BodyTime, ...] = key(
        "the bodies, the slowest first: the motions of good picks or strokes, or random motions if none is good, are "
        "proven again beside each body alone"
    )

    @property
    def seconds(self) -> float:
        """The time of all stages (s)."""
        return sum(each.seconds for each in self.stages)

    @reported()
    def summary(self) -> str:
        """One line: the time, and the slowest body."""
        slowest = self.bodies[0]
        return f"{self.seconds:.2f} s; proofs beside {slowest.name}: {slowest.share:.0%}, {slowest.geometry}"

    def _tables(self) -> tuple[Rows, Rows]:
        total = max(self.seconds, 1e-12)
        stages = [(s.stage, f"{s.seconds:.3f}", f"{s.seconds / total:.0%}", str(s.calls)) for s in self.stages]
        bodies = [(b.name, f"{b.seconds * 1e3:.2f}", f"{b.share:.0%}", b.geometry, b.advice) for b in self.bodies]
        return (
            Rows(("stage", "seconds", "share", "calls"), stages, numbers=("seconds", "share", "calls")),
            Rows(("bodies", "ms", "share", "geometry", "advice"), bodies, numbers=("ms", "share")),
        )

    def _view(self) -> View:
        return View(self.summary, self._tables())

    def to_text(self) -> str:
        """The summary and both tables, with aligned columns."""
        return "\n".join([self.summary, *(line for rows in self._tables() for line in ("", *rows.text()))])


def profile_picks(judge: Callable[[], PickReport]) -> WorkProfile:
    """Run a call of :func:`pinproof.validate_picks` in this process, and measure its stages and the bodies of its cell.

    Parameters
    ----------
    judge
        The call, for example ``lambda: pp.validate_picks(arm, scene, picks)``. Workers are not measured.
    """

    def proofs(report: PickReport) -> Proofs | None:
        if report.setup is None:
            return None
        # The tips at the grasps and at the releases, and the picked obstacles
        poses = list[SE3]()
        for verdict in report.verdicts:
            if verdict.status is not PickStatus.UNREADABLE:
                task = PickTask(verdict.pick, report.setup.cell)
                poses += [each.pose for each in (task.pick, task.place) if each is not None]
                poses += [task.scene[str(task.name)].pose] if task.from_scene else []
        points = np.array([pose.translation for pose in poses]).reshape(-1, 3)
        curves = [motion.trajectory for verdict in report.good[:MOST_MOTIONS] for motion in verdict.motions]
        return Proofs(report.setup.checker, curves, report.setup.home, points)

    return profile_work(judge, proofs)


class Proofs(NamedTuple):
    """The motions that are proven again beside each body; without any, random straight ones from ``home`` (n,).

    An obstacle in whose hull one of ``points`` (N, 3) in the root frame is must not be replaced by that hull.
    """

    checker: CollisionChecker
    curves: Sequence[Curve]
    home: Array
    points: Array


def profile_work(work: Callable[[], Any], proofs: Callable[[Any], Proofs | None]) -> WorkProfile:
    """Run work in this process, and measure its steps, and the bodies in proofs of the motions of its report."""
    watch = _Watch()
    level = LOG.level
    LOG.addHandler(watch)
    LOG.setLevel(logging.DEBUG)
    start = time.perf_counter()
    try:
        report = work()
    finally:
        LOG.removeHandler(watch)
        LOG.setLevel(level)
    total = time.perf_counter() - start
    # Short steps on meshes are not worth a row
    shown = [name for name, (seconds, _) in watch.times.items() if seconds > (SHORT * total * (name in watch.large))]
    stages = [StageTime(name, *watch.times[name]) for name in shown]
    stages.append(StageTime("other", max(total - sum(each.seconds for each in stages), 0.0), 1))
    cell = proofs(report)
    bodies = () if cell is None else _body_times(cell)
    return WorkProfile(report, tuple(sorted(stages, key=lambda each: -each.seconds)), bodies)


class _Watch(logging.Handler):
    """Adds up the time of each step without the steps in it."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.times: dict[str, tuple[float, int]] = {}
        self.large: set[str] = set()  # the steps on large inputs
        self._open: list[list[Any]] = []  # name, and the seconds of the steps in it

    def emit(self, record: logging.LogRecord) -> None:
        name, seconds = record.__dict__["step"], record.__dict__["seconds"]
        if seconds is None:
            whole = self._open[-1][0] if self._open and self._open[-1][0] == SUGGESTIONS else None
            self._open.append([whole or name, 0.0])
            return
        name, inner = self._open.pop()
        before, calls = self.times.get(name, (0.0, 0))
        self.times[name] = before + seconds - inner, calls + 1
        self.large |= {name} if record.levelno > logging.DEBUG else set()
        if self._open:
            self._open[-1][1] += seconds


def _body_times(cell: Proofs) -> tuple[BodyTime, ...]:
    """The times of proving the same motions beside the obstacles of each shape alone, and beside none."""
    checker, curves, home, points = cell
    arm = checker.group
    if not curves:
        ends = arm.limits.clip(home + np.random.default_rng(0).uniform(-1.0, 1.0, (MOST_MOTIONS, arm.dof)))
        curves = [JointPath(np.array([home, end]), arm.joint_names) for end in ends]
    bodies: dict[str | None, list[Body]] = {}
    for body in checker.bodies:
        bodies.setdefault(body.owner if body.link is None else None, []).append(body)
    # Obstacles of one shape are compared together, and so are those with the fewest bodies beyond a number
    by_shape: dict[Shape, list[Obstacle]] = {}
    for thing in checker.scene.obstacles:
        by_shape.setdefault(thing.shape, []).append(thing)
    groups = sorted(by_shape.values(), key=lambda group: -sum(_size(b) for o in group for b in bodies[o.name]))
    if len(groups) > MOST_GROUPS:
        groups = [*groups[:MOST_GROUPS], [thing for group in groups[MOST_GROUPS:] for thing in group]]

    # The pairs of links are part of each measurement
    robot = _seconds(checker.with_scene(Scene()), curves)
    beside = (_seconds(checker.with_scene(Scene(tuple(group))), curves) for group in groups)
    times = [robot, *(max(seconds - robot, 0.0) for seconds in beside)]
    total, least = max(sum(times), 1e-12), max(LARGE * sum(times), CLEAR * float(np.median(times)))
    rows = list[BodyTime]()
    for seconds, group in zip(times, [[], *groups], strict=True):
        names = [thing.name for thing in group]
        own = bodies.get(None, []) if not names else [body for name in names for body in bodies[name]]
        name = ", ".join(names[:2]) + (f" and {len(names) - 2} more" if len(names) > 2 else "")
        triangles, convex = sum(_size(body) for body in own if body.is_exact), sum(not body.is_exact for body in own)
        parts = [f"{triangles:,} exact triangles"] if triangles else []
        parts += [f"{convex} convex {'body' if convex == 1 else 'bodies'}"] if convex else []
        # One convex body is faster, if no pick is in it
        advice, divided = "", bool(triangles) or convex > len(group)
        if group and divided and seconds >= least and not any(_is_in_hull(thing, points) for thing in group):
            before = "triangles" if triangles else convex // len(group)
            advice = f"hull: true is 1 convex body instead of {before}, if nothing reaches into the shape"
        rows.append(BodyTime(name or "robot", seconds, seconds / total, " and ".join(parts) or "no body", advice))
    return tuple(sorted(rows, key=lambda row: -row.seconds))


def _seconds(checker: CollisionChecker, curves: Sequence[Curve]) -> float:
    """The least time of proving the curves, up to the first contact."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        for curve in curves:
            is_proven_free(curve, checker)
        times.append(time.perf_counter() - start)
    return min(times)


def _size(body: Body) -> int:
    return int(body.geometry.num_tris) if body.is_exact else 1


def _is_in_hull(thing: Obstacle, points: Array) -> bool:
    """Whether one of the points (N, 3) in the root frame is in the convex hull of an obstacle."""
    hull = LineSurface.of_obstacle(Obstacle("hull", ConvexShape(outer_points(LineSurface.of_obstacle(thing)))))
    into, out, _ = hull.span((points - thing.pose.translation) @ thing.pose.rotation, np.array([0.0, 0.0, 1.0]))
    return bool(((into <= 0) & (out >= 0)).any())
