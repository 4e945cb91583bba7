"""Screening picks rather than poses: families of grasps, named frames, and objects that the hand may touch."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker
from pinproof.errors import InputError
from pinproof.picks.family import GraspSpin, GraspTolerance, family
from pinproof.picks.pick import TIP, Pick, PickProblem
from pinproof.picks.reach.screening import Looked, Screening, ScreenStatus, code_of
from pinproof.picks.stages.cell import Cell
from pinproof.picks.stages.task import Task
from pinproof.spatial import matrix

__all__ = ["GraspScreening", "LookedPicks"]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

UNREADABLE, CONTACT, FREE = map(code_of, (ScreenStatus.UNREADABLE, ScreenStatus.CONTACT, ScreenStatus.FREE))


@dataclass(frozen=True, eq=False)
class LookedPicks:
    """What became of some picks: their names, what became of the best grasp of each, and which of the family it is."""

    names: tuple[str, ...]
    looked: Looked
    member: Indices

    @classmethod
    def joined(cls, parts: Sequence[LookedPicks], dof: int) -> LookedPicks:
        """Parts one behind the other; there may be none."""
        some = [cls((), Looked.nothing(0, dof), np.empty(0, dtype=np.int64)), *parts]
        return cls(
            tuple(name for part in some for name in part.names),
            Looked.joined([part.looked for part in some]),
            np.concatenate([part.member for part in some]),
        )


@dataclass(eq=False)
class _Open:
    """A pick of which some grasps are still to be looked at, ring by ring, and whether the hand may touch an object."""

    index: int
    pose: Array
    rings: list[Array]
    object: str | None
    done: int = 0


class GraspScreening:
    """Looks at picks of a cell; several threads may use it.

    Parameters
    ----------
    cell
        What the picks are judged in.
    attempts, rng, clearance
        As for :class:`~pinproof.picks.reach.screening.Screening`.
    """

    def __init__(self, cell: Cell, *, attempts: int, rng: int, clearance: bool) -> None:
        def screening(checker: CollisionChecker) -> Screening:
            return Screening(checker, cell.home, attempts=attempts, rng=rng, clearance=clearance)

        self._cell, self._make, self._screening = cell, screening, screening(cell.checker)
        self._hand = [each for each in cell.hand if each in cell.checker.obstacles_and_links]
        self._before = np.linalg.inv(matrix(cell.arm.root_from_base))
        self._after = np.linalg.inv(matrix(cell.shared.tip))

    @property
    def complete(self) -> bool:
        """Whether every configuration of a grasp is looked at."""
        return self._screening.complete

    def poses(self, poses: Array) -> Looked:
        """What becomes of ``root_from_tip`` (N, 4, 4)."""
        return self._screening.look(self._targets(poses))

    def picks(self, part: Iterable[Pick | PickProblem]) -> LookedPicks:
        """What becomes of picks; the grasps of a family are looked at ring by ring until one is free."""
        items = list(part)
        best, member = Looked.nothing(len(items), self._cell.arm.dof), np.zeros(len(items), dtype=np.int64)
        left = list(self._readable(items))
        while left:
            sizes = np.array([len(each.rings[0]) for each in left])
            owner, starts = np.repeat(np.arange(len(left)), sizes), np.cumsum(sizes) - sizes
            poses = np.concatenate([each.pose @ each.rings[0] for each in left])
            looked = self._look(poses, [each.object for each in left], owner)
            order = np.lexsort((-np.nan_to_num(looked.manipulability), -looked.codes, owner))
            top, index = order[starts], np.array([each.index for each in left])
            better = looked.codes[top] > best.codes[index]
            done = np.array([each.done for each in left])
            member[index[better]] = (done + top - starts)[better]
            best.put(index[better], looked, top[better])
            for each in left:
                each.done += len(each.rings.pop(0))
            left = [each for each in left if best.codes[each.index] != FREE and each.rings]
        return LookedPicks(tuple(item.name for item in items), best, member)

    def _targets(self, poses: Array) -> Array:
        return np.ascontiguousarray(self._before @ poses @ self._after)

    def _readable(self, items: Sequence[Pick | PickProblem]) -> Iterator[_Open]:
        for index, item in enumerate(items):
            if isinstance(item, PickProblem):
                continue
            pick, taken = item, None
            if item.frame or item.carried is not None:
                try:
                    task = Task(item, self._cell)
                except InputError:
                    continue
                pick, taken = task.pick, task.name if task.from_scene and self._hand else None
            axis = pick.approach_direction
            if pick.approach_frame != TIP and pick.spin.angles != (0.0,):
                axis = tuple((pick.pose.rotation.T @ axis).tolist())
            yield _Open(index, matrix(pick.pose), list(_rings(pick.spin, pick.tolerance, axis)), taken)

    def _look(self, poses: Array, objects: Sequence[str | None], owner: Indices) -> Looked:
        """What becomes of poses, of picks ``owner`` (N,), each with the object of its pick that the hand may touch.

        Without that leave first, which is nothing to make: what is free so is free.
        """
        targets = self._targets(poses)
        looked = self._screening.look(targets)
        again = [(objects[owner[k]], int(k)) for k in np.flatnonzero(looked.codes == CONTACT)]
        with_object = sorted((name, k) for name, k in again if name is not None)
        for name, group in groupby(with_object, key=lambda each: each[0]):
            rows = np.array([k for _, k in group])
            allowed = self._make(self._cell.checker.allowing(*((each, name) for each in self._hand)))
            looked.put(rows, allowed.look(targets[rows]), np.arange(len(rows)))
        return looked


@lru_cache(maxsize=64)
def _rings(spin: GraspSpin, tolerance: GraspTolerance, axis: tuple[float, float, float]) -> tuple[Array, ...]:
    """``nominal_from_tip`` (m, 4, 4) ring by ring; the first grasp, which mostly is free, stands alone."""
    rings = [np.array([matrix(each.nominal_from_tip) for each in r]) for r in family(spin, tolerance, np.array(axis))]
    return tuple(ring for ring in (rings[0][:1], rings[0][1:], *rings[1:]) if len(ring))
