"""Making a reach map: inverse kinematics and the collision check in batches, over all points and orientations."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker
from pinproof.errors import InputError
from pinproof.ik import AnalyticIk, Clik
from pinproof.ik.settings import whole
from pinproof.model import Arm
from pinproof.picks.configurations import has_closed_form, manipulability
from pinproof.picks.reach.reach_map import ReachMap
from pinproof.picks.reach.region import Region
from pinproof.spatial import SE3, matrix, rigid, rigid_many

__all__ = ["reach_map"]

Array = npt.NDArray[np.float64]

CHUNK = 4096
"""Poses solved at a time: their answers stay in the processor's cache, and progress can be told."""

RESTARTS = 8
"""Of a search for a pose: enough for all but a few in a thousand, and an eighth of the time that a pose out of reach
would take with the solver's own number."""

FINEST_SPAN = 1e-6
"""Metres: more than a solved pose may be off."""


def reach_map(
    checker: CollisionChecker,
    region: Region,
    orientations: npt.ArrayLike,
    *,
    tip: SE3 | npt.ArrayLike | None = None,
    attempts: int = 4,
    rng: int = 0,
    threads: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> ReachMap:
    """Tell at every point of a region, in every orientation, whether it is reachable, whether free, and how well.

    Where the arm has a closed form, every branch is judged, and of the free ones the most manipulable is told of.
    Other arms are searched, from up to ``attempts`` starts for each pose that is not free yet.

    Parameters
    ----------
    checker
        The arm in its scene, with its tool attached.
    region
        Where; see :meth:`Region.box`.
    orientations
        (m, 3, 3) ``root_from_tip`` rotations, as :func:`tool_orientations` makes them.
    tip
        ``tcp_from_tip``: what is put onto the points; by default the tcp itself.
    attempts
        Starts of the search for arms without a closed form.
    rng
        Seed of the starts.
    threads
        Threads that share the work; the answers do not depend on their number.
    progress
        Called with the number of poses done and of all.

    Raises
    ------
    InputError
        If a shape is wrong, a matrix is no rotation, or a setting makes no sense.
    """
    whole("attempts", attempts, 1)
    whole("threads", threads, 1)
    frames = _frames(orientations)
    arm = checker.arm
    tcp_from_tip = matrix(rigid("tip", SE3.Identity() if tip is None else tip))
    before, after = np.linalg.inv(matrix(arm.root_from_base)), np.linalg.inv(tcp_from_tip)
    solver = _Closed(checker) if has_closed_form(arm) else _Searched(checker, attempts, rng)
    points, m = len(region), len(frames)
    total = points * m
    reachable, free = np.zeros(total, dtype=bool), np.zeros(total, dtype=bool)
    figures = np.full((total, 2), np.nan)

    def share(start: int) -> int:
        rows = np.arange(start, min(start + CHUNK, total))
        targets = frames[rows % m]
        targets[:, :3, 3] = region.points[rows // m]
        answer = solver.judge(before @ targets @ after)
        reachable[rows], free[rows], figures[rows] = answer
        return len(rows)

    done = 0
    with ThreadPoolExecutor(threads) as pool:
        for count in pool.map(share, range(0, total, CHUNK)):
            done += count
            if progress is not None:
                progress(done, total)
    shape = points, m
    return ReachMap(
        region,
        frames[:, :3, :3],
        reachable.reshape(shape),
        free.reshape(shape),
        figures[:, 0].reshape(shape),
        figures[:, 1].reshape(shape),
        solver.complete,
        f"{arm.robot.name}, {arm.base} to {arm.tcp}, {len(checker.scene.obstacles)} obstacles",
    )


def _frames(orientations: npt.ArrayLike) -> Array:
    """The orientations (m, 4, 4) at the origin, each of them checked."""
    given = np.asarray(orientations, dtype=float)
    if given.ndim != 3 or given.shape[1:] != (3, 3) or not len(given):
        raise InputError(f"orientations must have the shape (m, 3, 3), m >= 1, not {given.shape}")
    frames = np.tile(np.eye(4), (len(given), 1, 1))
    frames[:, :3, :3] = given
    return rigid_many("orientations", frames)


class _Judge:
    """What both ways share: the figures of configurations that were found free."""

    complete = False

    def __init__(self, checker: CollisionChecker) -> None:
        self._checker, self._arm = checker, checker.arm

    def judge(self, targets: Array) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_], Array]:
        """Of targets (N, 4, 4) ``base_from_tcp``: reachable (N,), free (N,), manipulability and clearance (N, 2)."""
        raise NotImplementedError


class _Closed(_Judge):
    """Every branch of every target."""

    complete = True

    def judge(self, targets: Array) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_], Array]:
        branches = AnalyticIk().solve_all_batch(self._arm, targets)
        row, column = np.nonzero(np.isfinite(branches.q[:, :, 0]))
        Q = np.ascontiguousarray(branches.q[row, column])
        fine = self._checker.is_free_batch(Q) if len(Q) else np.zeros(0, dtype=bool)
        figures, free = np.full((len(targets), 2), np.nan), np.zeros(len(targets), dtype=bool)
        row, Q = row[fine], Q[fine]
        if len(Q):
            volume = manipulability(self._arm, Q)
            order = np.lexsort((-volume, row))
            first = order[np.unique(row[order], return_index=True)[1]]  # the most manipulable of each target
            free[row[first]] = True
            figures[row[first], 0] = volume[first]
            figures[row[first], 1] = self._checker.clearance_batch(Q[first])
        return branches.ok, free, figures


class _Searched(_Judge):
    """The first free configuration found from several starts."""

    def __init__(self, checker: CollisionChecker, attempts: int, rng: int) -> None:
        super().__init__(checker)
        limits = checker.arm.limits
        low, high = limits.sampling_range()
        others = np.random.default_rng(rng).uniform(low, high, (attempts - 1, checker.arm.dof))
        self._starts, self._rng = np.vstack([checker.arm.home, others]), rng
        self._span = _Span(checker.arm)

    def judge(self, targets: Array) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_], Array]:
        reachable, free = np.zeros(len(targets), dtype=bool), np.zeros(len(targets), dtype=bool)
        figures = np.full((len(targets), 2), np.nan)
        solver, open_rows = Clik(restarts=RESTARTS), np.flatnonzero(self._span.may_reach(targets))
        for attempt, start in enumerate(self._starts):
            found = solver.solve_batch(self._arm, targets[open_rows], start, rng=self._rng + attempt)
            rows, Q = open_rows[found.ok], np.ascontiguousarray(found.q[found.ok])
            reachable[rows] = True
            fine = self._checker.is_free_batch(Q) if len(Q) else np.zeros(0, dtype=bool)
            rows, Q = rows[fine], Q[fine]
            if len(rows):
                free[rows] = True
                figures[rows, 0], figures[rows, 1] = manipulability(self._arm, Q), self._checker.clearance_batch(Q)
            # what the first search did not reach, with all its restarts, another start would hardly reach either
            open_rows = np.flatnonzero(reachable & ~free)
            if not len(open_rows):
                break
        return reachable, free, figures


class _Span:
    """How far an arm stretches: a search for what lies beyond costs all its restarts, this two products.

    A rotation about an axis keeps the points of the axis. So the origin of the first joint is fixed in the base, that
    of the last one in the target, and between them lie the lengths from joint to joint at most.
    """

    def __init__(self, arm: Arm) -> None:
        from pinproof.kernels.chain import LEADER, MULTIPLIER, OFFSET, SLIDES

        chain, limits = arm.packed, arm.limits
        rows, slides = chain[:-1], chain[:-1, SLIDES] != 0.0
        reach = np.maximum(np.abs(limits.lower), np.abs(limits.upper))[rows[:, LEADER].astype(int)]
        travel = np.where(slides, np.abs(rows[:, MULTIPLIER]) * reach + np.abs(rows[:, OFFSET]), 0.0)
        self._longest = np.linalg.norm(rows[1:, [3, 7, 11]], axis=1).sum() + travel.sum()
        self._first = rows[0, [3, 7, 11]]
        tool = np.vstack([chain[-1, :12].reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
        self._last = np.linalg.inv(tool)[:, 3]

    def may_reach(self, targets: Array) -> npt.NDArray[np.bool_]:
        """(N,) whether targets (N, 4, 4) are near enough; those that are not cannot be reached."""
        away = (targets @ self._last)[:, :3] - self._first
        return np.asarray(np.linalg.norm(away, axis=1) <= self._longest + FINEST_SPAN)
