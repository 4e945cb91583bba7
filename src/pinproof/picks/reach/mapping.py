"""Making a reach map: inverse kinematics and the collision check in batches, over all points and orientations."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker
from pinproof.common.validation import require_integer
from pinproof.errors import InputError
from pinproof.picks.reach.reach_map import ReachMap
from pinproof.picks.reach.region import ReachRegion
from pinproof.picks.reach.screening import Screening, ScreenStatus, code_of
from pinproof.spatial import SE3, matrix, rigid, rigid_many

__all__ = ["reach_map"]

Array = npt.NDArray[np.float64]

CHUNK = 4096
"""Poses solved at a time: their answers stay in the processor's cache, and progress can be told."""


def reach_map(
    checker: CollisionChecker,
    region: ReachRegion,
    orientations: npt.ArrayLike,
    *,
    tip: SE3 | npt.ArrayLike | None = None,
    world_from_root: SE3 | npt.ArrayLike | None = None,
    attempts: int = 4,
    rng: int = 0,
    threads: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> ReachMap:
    """Tell at every point of a region, in every orientation, whether it is reachable, whether free, and how well.

    A :func:`pinproof.screen_picks` over a grid. Where the arm has a closed form, of the free branches the most
    manipulable is told of. Arms of seven are swept along a joint, others searched from up to ``attempts`` starts, until
    something free is found.

    Parameters
    ----------
    checker
        The arm in its scene, with its tool attached.
    region
        Where; see :meth:`ReachRegion.box`.
    orientations
        (m, 3, 3) ``root_from_tip`` rotations, as :func:`tool_orientations` makes them.
    tip
        ``tcp_from_tip``: what is put onto the points; by default the tcp itself.
    world_from_root
        Where the robot stands in the frame of the region and the orientations, to compare places for it; the checker's
        scene stays in the robot's root frame. By default they are one.
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
    require_integer("threads", threads, 1)
    frames = _frames(orientations)
    arm = checker.arm
    tcp_from_tip = matrix(rigid("tip", SE3.Identity() if tip is None else tip))
    place = rigid("world_from_root", SE3.Identity() if world_from_root is None else world_from_root)
    before, after = np.linalg.inv(matrix(place * arm.root_from_base)), np.linalg.inv(tcp_from_tip)
    screening = Screening(checker, arm.home, attempts=attempts, rng=rng, why=False, clearance=True)
    points, m = len(region), len(frames)
    total = points * m
    reachable, free = np.zeros(total, dtype=bool), np.zeros(total, dtype=bool)
    figures = np.full((total, 2), np.nan)

    def share(start: int) -> int:
        rows = np.arange(start, min(start + CHUNK, total))
        targets = frames[rows % m]
        targets[:, :3, 3] = region.points[rows // m]
        looked = screening.look(before @ targets @ after)
        free[rows] = looked.codes == code_of(ScreenStatus.FREE)
        reachable[rows] = looked.codes > code_of(ScreenStatus.LIMITS)
        figures[rows] = np.column_stack([looked.manipulability, looked.clearance])
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
        screening.complete,
        _title(checker, tcp_from_tip, place),
    )


def _title(checker: CollisionChecker, tcp_from_tip: Array, place: SE3) -> str:
    """What was looked at, in words."""
    arm, tool = checker.arm, ", ".join(body.name for body in checker.attached)
    tip, stands = tcp_from_tip[:3, 3], place.translation
    words = [f"{arm.robot.name}, {arm.base} to {arm.tcp}", f"{len(checker.scene.obstacles)} obstacles"]
    words += [f"with {tool}"] if tool else []
    words += [f"tip {_metres(tip)} m from the tcp"] if tip.any() else []
    words += [f"the robot at {_metres(stands)} m"] if stands.any() else []
    return ", ".join(words)


def _metres(point: Array) -> str:
    return f"({', '.join(f'{value:.3g}' for value in point)})"


def _frames(orientations: npt.ArrayLike) -> Array:
    """The orientations (m, 4, 4) at the origin, each of them checked."""
    given = np.asarray(orientations, dtype=float)
    if given.ndim != 3 or given.shape[1:] != (3, 3) or not len(given):
        raise InputError(f"orientations must have the shape (m, 3, 3), m >= 1, not {given.shape}")
    frames = np.tile(np.eye(4), (len(given), 1, 1))
    frames[:, :3, :3] = given
    return rigid_many("orientations", frames)
