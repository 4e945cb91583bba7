"""Screening of many picks: grasp families, named frames, and objects that the hand is allowed to touch."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, Obstacle, Scene
from pinproof.common.validation import require_integer
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.picks.batch.screening import ScreenedPoses, Screening, ScreenResult, ScreenStatus, code_of, in_chunks
from pinproof.picks.input.pick import GraspSpin, GraspTolerance, Pick, family
from pinproof.picks.input.picks import PickProblem, Picks
from pinproof.picks.input.sources import PickSource, as_source
from pinproof.picks.judging.configurations import limit_margin
from pinproof.picks.judging.grasp import reach, screen
from pinproof.picks.judging.setup import check_held_joints
from pinproof.picks.judging.task import PickCell, PickTask
from pinproof.spatial import SE3, Array, matrix, rigid, rigid_many

Indices = npt.NDArray[np.int64]

UNREADABLE, CONTACT, FREE = map(code_of, (ScreenStatus.UNREADABLE, ScreenStatus.CONTACT, ScreenStatus.FREE))


@dataclass(frozen=True, eq=False)
class ScreenedPicks:
    """The screening results of some picks: their names, and the result and family index of the best grasp of each."""

    names: tuple[str, ...]
    screened: ScreenedPoses
    member: Indices

    @classmethod
    def joined(cls, parts: Sequence[ScreenedPicks], dof: int) -> ScreenedPicks:
        """The concatenation of any number of parts."""
        some = [cls((), ScreenedPoses.nothing(0, dof), np.empty(0, dtype=np.int64)), *parts]
        return cls(
            tuple(name for part in some for name in part.names),
            ScreenedPoses.joined([part.screened for part in some]),
            np.concatenate([part.member for part in some]),
        )


@dataclass(eq=False)
class _Open:
    """A pick with the grasps that are not screened yet, in groups, and the object that the hand may touch."""

    index: int
    pose: Array
    groups: list[Array]
    object: str | None
    done: int = 0


class GraspScreening:
    """Screens picks of a cell; safe to use from several threads. The arguments are those of :func:`screen_picks`."""

    def __init__(self, cell: PickCell, *, attempts: int, rng: int, clearance: bool) -> None:
        def screening(checker: CollisionChecker) -> Screening:
            return Screening(checker, cell.home, attempts=attempts, rng=rng, clearance=clearance)

        self._cell, self._make, self._screening = cell, screening, screening(cell.checker)
        self._hand = [each for each in cell.hand if each in cell.checker.obstacles_and_links]
        self._before = np.linalg.inv(matrix(cell.arm.root_from_base))
        self._after = np.linalg.inv(matrix(cell.shared.tip))

    @property
    def complete(self) -> bool:
        """Whether all configurations of each grasp are checked."""
        return self._screening.complete

    def poses(self, poses: Array) -> ScreenedPoses:
        """Screen poses ``root_from_tip`` (N, 4, 4)."""
        return self._screening.screen(self._targets(poses))

    def picks(self, part: Iterable[Pick | PickProblem]) -> ScreenedPicks:
        """Screen picks; the grasps of a family are checked group by group until one is free."""
        items = list(part)
        best, member = ScreenedPoses.nothing(len(items), self._cell.arm.dof), np.zeros(len(items), dtype=np.int64)
        left = list(self._readable(items))
        while left:
            # The next group of grasps of every pick that is still open, in one call
            sizes = np.array([len(each.groups[0]) for each in left])
            owner, starts = np.repeat(np.arange(len(left)), sizes), np.cumsum(sizes) - sizes
            poses = np.concatenate([each.pose @ each.groups[0] for each in left])
            screened = self._screen_poses(poses, [each.object for each in left], owner)
            # The best grasp of each pick replaces that of earlier groups if its status is better
            order = np.lexsort((-np.nan_to_num(screened.manipulability), -screened.codes, owner))
            top, index = order[starts], np.array([each.index for each in left])
            better = screened.codes[top] > best.codes[index]
            done = np.array([each.done for each in left])
            member[index[better]] = (done + top - starts)[better]
            best.put(index[better], screened, top[better])
            for each in left:
                each.done += len(each.groups.pop(0))
            left = [each for each in left if best.codes[each.index] != FREE and each.groups]
        return ScreenedPicks(tuple(item.name for item in items), best, member)

    def _targets(self, poses: Array) -> Array:
        return np.ascontiguousarray(self._before @ poses @ self._after)

    def _readable(self, items: Sequence[Pick | PickProblem]) -> Iterator[_Open]:
        for index, item in enumerate(items):
            if isinstance(item, PickProblem):
                continue
            pick, taken = item, None
            if item.frame or item.carried is not None:
                try:
                    task = PickTask(item, self._cell)
                except InputError:
                    continue
                pick, taken = task.pick, task.name if task.from_scene and self._hand else None
            # without a spin the axis does not matter, and a fixed one finds the grasps in the cache
            axis = pick.approach_direction if pick.spin.angles == (0.0,) else tuple(pick.axis_in(pick.pose).tolist())
            yield _Open(index, matrix(pick.pose), list(_groups(pick.spin, pick.tolerance, axis)), taken)

    def _screen_poses(self, poses: Array, objects: Sequence[str | None], owner: Indices) -> ScreenedPoses:
        """Screen poses of the picks ``owner`` (N,), where the hand may touch the object of its pick.

        Contact with the object is first not allowed, which needs no additional checker: a pose that is free then is
        also free with the contact allowed.
        """
        targets = self._targets(poses)
        screened = self._screening.screen(targets)
        again = [(objects[owner[k]], int(k)) for k in np.flatnonzero(screened.codes == CONTACT)]
        with_object = sorted((name, k) for name, k in again if name is not None)
        for name, group in groupby(with_object, key=lambda each: each[0]):
            rows = np.array([k for _, k in group])
            allowed = self._make(self._cell.checker.allowing(*((each, name) for each in self._hand)))
            screened.put(rows, allowed.screen(targets[rows]), np.arange(len(rows)))
        return screened


@lru_cache(maxsize=64)
def _groups(spin: GraspSpin, tolerance: GraspTolerance, axis: tuple[float, float, float]) -> tuple[Array, ...]:
    """``nominal_from_tip`` (m, 4, 4) of each group; the first grasp, which is usually free, is a separate group."""
    first, *rest = (
        np.array([matrix(each.nominal_from_tip) for each in group]) for group in family(spin, tolerance, np.array(axis))
    )
    return tuple(group for group in (first[:1], first[1:], *rest) if len(group))


def screen_picks(
    arm: Arm,
    scene: Scene,
    picks: Picks | PickSource | npt.ArrayLike,
    *,
    tip: SE3 | npt.ArrayLike | None = None,
    tool: Sequence[Obstacle] | None = None,
    margin: float | None = None,
    home: npt.ArrayLike | None = None,
    clearance: bool = False,
    attempts: int = 4,
    rng: int = 0,
    threads: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> ScreenResult:
    """Determine which of many picks or poses are reachable within the limits and free of contact at the grasp.

    This runs only the stages reach, limits, self-collision and grasp of :func:`pinproof.validate_picks`, with the same
    checks, for tens of thousands of picks per second. A pick that is FREE here may still fail on its approach, retreat
    or transit. If the result is ``complete``, a pick that is not FREE does not need a full validation.

    Parameters
    ----------
    arm
        The arm.
    scene
        The obstacles around the arm.
    picks
        Picks, or (N, 4, 4) poses ``root_from_tip``.
    tip, tool, margin
        ``tcp_from_tip``, the bodies attached to the tcp, and the smallest allowed distance (m) between any two bodies.
        The defaults are those of the picks; for poses, the tip is the tcp, there is no tool, and the margin is 0.
    home
        (n,) the configuration near which 2 pi windings are chosen and from which searches start. The default is the
        home of the picks if they define one, otherwise that of the arm.
    clearance
        Whether to also compute the clearance of free configurations, which about doubles the computation time.
    attempts
        Number of start configurations of the search, for arms without closed-form IK.
    rng
        Seed of the searches.
    threads
        Number of threads; it does not affect the result.
    progress
        Called with the number of finished picks and the total number.

    Raises
    ------
    InputError
        If a pose is not a rigid transform, a setting is invalid, or the values of joints outside the arm differ from
        those that the picks require.
    """
    require_integer("threads", threads, 1)
    # The picks, with settings that the arguments override
    source = as_source(picks) if isinstance(picks, (Picks, PickSource)) else _Poses(rigid_many("poses", picks))
    named = source.shared
    named.refuse_conveyor("screening")
    shared = replace(
        named,
        tip=named.tip if tip is None else rigid("tip", tip),
        tool=named.tool if tool is None else tuple(tool),
        margin=named.margin if margin is None else margin,
    )
    # The cell, as for the complete judgement
    check_held_joints(arm, shared)
    home_q = shared.home_configuration(arm.joint_names, arm.home) if home is None else home
    checker = CollisionChecker(arm, scene, margin=shared.margin, attached=shared.open_tool)
    cell = PickCell(checker, shared, arm.limits.snap(arm.configuration(home_q, "home")))
    screening = GraspScreening(cell, attempts=attempts, rng=rng, clearance=clearance)
    total = len(source)

    def share(start: int, stop: int) -> ScreenedPicks:
        if isinstance(source, _Poses):
            return ScreenedPicks((), screening.poses(source.poses[start:stop]), np.zeros(stop - start, dtype=np.int64))
        return screening.picks(source.part(start, stop))

    # All picks in chunks, and figures of those that are free
    found = ScreenedPicks.joined(in_chunks(share, total, threads, progress), arm.dof)
    names = source.names if isinstance(source, _Poses) else found.names
    return _result(names, arm, found, screening.complete, _Reasons(cell, source, rng))


def _result(names: Sequence[str], arm: Arm, found: ScreenedPicks, complete: bool, reasons: _Reasons) -> ScreenResult:
    screened, free = found.screened, found.screened.codes == code_of(ScreenStatus.FREE)
    margins = np.full(len(free), np.nan)
    margins[free] = limit_margin(arm, screened.q[free])
    figures = margins, screened.manipulability, screened.clearance
    return ScreenResult(names, arm.joint_names, screened.codes, screened.q, found.member, *figures, complete, reasons)


class _Poses(PickSource):
    """Poses as picks without approach and retreat."""

    def __init__(self, poses: Array) -> None:
        self.poses, self.shared, self.with_object = poses, Picks(()), frozenset([False])
        self.names = _Numbered(len(poses))

    def __len__(self) -> int:
        return len(self.poses)

    def part(self, start: int, stop: int) -> list[Pick]:
        return [Pick(self.names[i], rigid("pose", self.poses[i]), 0.0, 0.0) for i in range(start, min(stop, len(self)))]

    def digest(self) -> str:
        raise NotImplementedError


class _Numbered(Sequence[str]):
    """``pose_0``, ``pose_1``, ..."""

    def __init__(self, count: int) -> None:
        self._count = count

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index):  # type: ignore[no-untyped-def]  # a name, or a tuple of names for a slice
        places = range(self._count)[index]
        return tuple(f"pose_{i}" for i in places) if isinstance(places, range) else f"pose_{places}"


@dataclass(frozen=True, eq=False)
class _Reasons:
    """Judges a single pick again, to obtain the messages of its stages."""

    cell: PickCell
    source: PickSource
    rng: int

    def __call__(self, index: int) -> str:
        (item,) = self.source.part(index, index + 1)
        if isinstance(item, PickProblem):
            return item.reason
        try:
            task = PickTask(item, self.cell)
        except InputError as error:
            return str(error)
        members = next(task.groups())
        reached = reach(task, members, self.rng)
        stages = (*reached.stages, *(screen(task, members, reached).stages if len(reached.q) else ()))
        return next((stage.message for stage in stages if not stage.ok), "")
