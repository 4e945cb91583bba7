"""Screening picks: which of very many can be grasped at all, before any is judged in full."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, Obstacle, Scene
from pinproof.common.validation import require_integer
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.picks.configurations import limit_margins
from pinproof.picks.pick import Pick, PickProblem, Picks
from pinproof.picks.reach.pick_grasps import GraspScreening, LookedPicks
from pinproof.picks.reach.pick_screen import ScreenResult
from pinproof.picks.reach.screening import ScreenStatus, code_of
from pinproof.picks.setup import refuse_another_hand
from pinproof.picks.source import PickSource, as_source
from pinproof.picks.stages.cell import Cell
from pinproof.picks.stages.grasp import screen
from pinproof.picks.stages.reach import reach
from pinproof.picks.stages.task import Task
from pinproof.spatial import SE3, rigid, rigid_many

__all__ = ["screen_picks"]

Array = npt.NDArray[np.float64]

CHUNK = 4096
"""Picks looked at together: their answers stay in the processor's cache, and progress can be told."""


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
    """Tell of very many picks, or poses, which can be grasped: reached inside the limits, free of contact.

    The stages reach, limits, self-collision and collision at the grasp of :func:`pinproof.validate_picks` alone, with
    the same checks, tens of thousands a second. What is free here may still fail on its ways; what is not free need not
    be judged in full, where ``complete``.

    Parameters
    ----------
    arm
        The arm.
    scene
        What stands around it.
    picks
        Picks, or (N, 4, 4) poses ``root_from_tip``.
    tip, tool, margin
        ``tcp_from_tip``, the bodies that move with the tcp, and the metres to keep between any two bodies. By default
        those of the picks; of poses the tcp itself, none, and 0.
    home
        (n,) near which whole turns are chosen, and where searches begin; by default the one of the picks, else the
        arm's.
    clearance
        Whether the clearance of what is free is measured, too; it costs as much as all the rest.
    attempts
        Starts of the search, for arms without a closed form.
    rng
        Seed of the searches.
    threads
        Threads that share the work; the answers do not depend on their number.
    progress
        Called with the number of picks done and of all.

    Raises
    ------
    InputError
        If a pose is none, a setting makes no sense, or the arm holds other joints elsewhere than the picks say.
    """
    require_integer("threads", threads, 1)
    source = as_source(picks) if isinstance(picks, (Picks, PickSource)) else _Poses(rigid_many("poses", picks))
    named = source.shared
    shared = replace(
        named,
        tip=named.tip if tip is None else rigid("tip", tip),
        tool=named.tool if tool is None else tuple(tool),
        margin=named.margin if margin is None else margin,
    )
    refuse_another_hand(arm, shared)
    told = shared.home_configuration(arm.joint_names, arm.home) if home is None else home
    checker = CollisionChecker(arm, scene, margin=shared.margin, attached=shared.open_tool)
    cell = Cell(checker, shared, arm.configuration(told, "home"))
    screening = GraspScreening(cell, attempts=attempts, rng=rng, clearance=clearance)
    total = len(source)

    def share(start: int) -> LookedPicks:
        stop = min(start + CHUNK, total)
        if isinstance(source, _Poses):
            return LookedPicks((), screening.poses(source.poses[start:stop]), np.zeros(stop - start, dtype=np.int64))
        return screening.picks(source.part(start, stop))

    parts = []
    with ThreadPoolExecutor(threads) as pool:
        for part in pool.map(share, range(0, total, CHUNK)):
            parts.append(part)
            if progress is not None:
                progress(min(len(parts) * CHUNK, total), total)
    found = LookedPicks.joined(parts, arm.dof)
    looked, free = found.looked, found.looked.codes == code_of(ScreenStatus.FREE)
    margins = np.full(total, np.nan)
    margins[free] = np.clip(limit_margins(arm, looked.q[free]), 0.0, 1.0)
    return ScreenResult(
        source.names if isinstance(source, _Poses) else found.names,
        arm.joint_names,
        looked.codes,
        looked.q,
        found.member,
        margins,
        looked.manipulability,
        looked.clearance,
        screening.complete,
        _Reasons(cell, source, rng),
    )


class _Poses(PickSource):
    """Poses as picks without ways."""

    def __init__(self, poses: Array) -> None:
        self.poses, self.shared = poses, Picks(())
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

    def __getitem__(self, index):  # type: ignore[no-untyped-def]  # a name, or a tuple of them for a slice
        places = range(self._count)[index]
        return tuple(f"pose_{i}" for i in places) if isinstance(places, range) else f"pose_{places}"


@dataclass(frozen=True, eq=False)
class _Reasons:
    """Judges a single pick again, for what the stages say of it."""

    cell: Cell
    source: PickSource
    rng: int

    def __call__(self, index: int) -> str:
        (item,) = self.source.part(index, index + 1)
        if isinstance(item, PickProblem):
            return item.reason
        try:
            task = Task(item, self.cell)
        except InputError as error:
            return str(error)
        members = next(task.rings())
        reached = reach(task, members, self.rng)
        stages = (*reached.stages, *(screen(task, members, reached).stages if len(reached.q) else ()))
        return next((stage.message for stage in stages if not stage.ok), "")
