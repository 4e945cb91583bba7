"""Screening of many poses and picks at the grasp alone, and the result.

Candidate configurations are made in rounds; later rounds process only the poses that are not solved yet. Of a pick, the
grasps of its family are screened group by group, in its named frame, and the hand may touch its object.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from enum import Enum
from functools import lru_cache, partial
from itertools import chain, groupby
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, Obstacle, Scene
from pinproof.common.files import csv_text, figure
from pinproof.common.results import Rows, Saved, View
from pinproof.common.structs import described, key
from pinproof.common.validation import freeze_arrays, require_integer
from pinproof.errors import InputError
from pinproof.ik import AnalyticIk, Clik
from pinproof.model import Arm
from pinproof.picks.input.pick import GraspSpin, GraspTolerance, Pick, family
from pinproof.picks.input.picks import PickProblem, Picks
from pinproof.picks.input.sources import PickSource, as_source
from pinproof.picks.judging.configurations import TURN, has_closed_form, limit_margin, sweep, turned_inside, widened
from pinproof.picks.judging.grasp import reach, screen
from pinproof.picks.judging.task import PickCell, PickTask, check_held_joints, checker_of_picks
from pinproof.picks.judging.verdict import Stage
from pinproof.spatial import SE3, Array, matrix, rigid, rigid_many

Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]

FINEST_SPAN = 1e-6
"""Metres: a tolerance larger than the position error of a solved pose."""


class Span:
    """An upper bound of the reach of an arm.

    The bound excludes distant targets with two matrix products, whereas a search would spend all its restarts on them.

    A rotation about an axis leaves the points of the axis fixed. Therefore the origin of the first joint is fixed in
    the base and that of the last joint is fixed in the target. The distance between them is at most the sum of the
    distances between consecutive joints.
    """

    def __init__(self, arm: Arm) -> None:
        joints = arm.chain.joints
        reach = np.maximum(np.abs(arm.limits.lower), np.abs(arm.limits.upper))
        travel = [abs(each.multiplier) * reach[each.index] + abs(each.offset) for each in joints if each.prismatic]
        origins = np.array([each.before[:3, 3] for each in joints])
        self._longest = np.linalg.norm(origins[1:], axis=1).sum() + sum(travel)
        self._first = origins[0]
        self._last = np.linalg.inv(arm.chain.tool)[:, 3]

    def may_reach(self, targets: Array) -> Mask:
        """(N,) whether targets (N, 4, 4) are within the bound; all others are proven to be out of reach."""
        away = (targets @ self._last)[:, :3] - self._first
        return np.asarray(np.linalg.norm(away, axis=1) <= self._longest + FINEST_SPAN)


RESTARTS = 8
"""Restarts of the search for one pose. They are sufficient for all but a few poses in a thousand, and a pose out of
reach takes an eighth of the time that it would take with the default of the solver."""

GROUPS = 2, 4, 8
"""Numbers of values of the swept joint in the first rounds; the last round has the rest. Most poses need few."""


@dataclass(frozen=True, eq=False)
class Proposed:
    """The configurations q (k, n) within the limits that a round finds, and the index (k,) of the target of each.

    For each target (N,), ``outside`` states whether a configuration was found that only the limits exclude, and
    ``complete`` whether the configurations are proven to be all.
    """

    row: Indices
    q: Array
    outside: Mask
    complete: Mask


Round = tuple[bool | None, Callable[[Array], Proposed]]
"""The configurations that a round finds for targets (N, 4, 4), ``base_from_tcp``: those of all poses without a known
free configuration (None), or of those that are known to be reachable, or of those that are not."""


def rounds_for(arm: Arm, home: Array, *, attempts: int, rng: int, why: bool) -> list[Round]:
    """The rounds of candidates for an arm: all IK branches, a sweep for arms with seven joints, or a search.

    With ``why``, there are additional rounds that only determine why no configuration was found.
    """

    def branches(solver: AnalyticIk, values: Array | None = None) -> Callable[[Array], Proposed]:
        def propose(targets: Array) -> Proposed:
            found = solver.solve_all_batch(arm, targets, home, redundant_values=values)
            row, column = np.nonzero(np.arange(found.q.shape[1]) < found.count[:, None])
            return Proposed(row, found.q[row, column], found.outside > 0, found.complete)

        return propose

    def search(of: Arm, start: Array, seed: int) -> Callable[[Array], Proposed]:
        span = Span(of)

        def propose(targets: Array) -> Proposed:
            near = np.flatnonzero(span.may_reach(targets))
            found = Clik(restarts=RESTARTS).solve_batch(of, targets[near], start, rng=seed)
            q, none = np.ascontiguousarray(found.q[found.ok]), np.zeros((2, len(targets)), dtype=bool)
            return Proposed(near[found.ok], q, *none)

        return propose

    if has_closed_form(arm):
        return [(None, branches(AnalyticIk()))]
    if has_closed_form(arm, most=7):
        # The values of the redundant joint at which a pick is judged. Sorting by the reversed binary digits of the
        # index places neighbouring values far apart, so that few of them find most poses
        swept = sweep(arm)
        joint, values = swept.redundant_grid(arm, home) or (0, home[:0])
        spread = values[np.argsort([int(f"{k:010b}"[::-1], 2) for k in range(len(values))])]
        rounds: list[Round] = [(None, branches(swept, few)) for few in np.split(spread, np.cumsum(GROUPS)) if len(few)]
        rounds.append((False, search(arm, home, rng)))
        # Configurations outside the limits are found on the rest of a full rotation
        step = float(np.diff(values).max(initial=TURN))
        if why and arm.angular[joint] and len(rest := np.arange(values[-1] + step, values[0] + TURN, step)):
            rounds.append((False, branches(swept, rest)))
        return rounds

    # A pose that the first search did not reach with all its restarts is unlikely to be reached from another start
    others = np.random.default_rng(rng).uniform(*arm.limits.sampling_range(), (attempts - 1, arm.dof))
    rounds = [(None, search(arm, home, rng))]
    rounds += [(True, search(arm, start, rng + k)) for k, start in enumerate(others, 1)]
    wider = search(widened(arm), home, rng)

    def without_limits(targets: Array) -> Proposed:
        found = wider(targets)
        q = turned_inside(arm, found.q)
        inside = arm.limits.inside(q)
        found.outside[found.row[~inside]] = True
        return replace(found, row=found.row[inside], q=np.ascontiguousarray(q[inside]))

    return rounds + ([(False, without_limits)] if why else [])


CHUNK = 4096
"""Poses screened at a time, so that their results fit into the processor cache and progress can be reported."""

Part = TypeVar("Part")


def in_chunks(
    work: Callable[[int, int], Part], total: int, threads: int, progress: Callable[[int, int], None] | None
) -> list[Part]:
    """Return ``work(start, stop)`` for chunks of ``range(total)``, in order; ``progress`` gets the number finished."""
    stops = [min(start + CHUNK, total) for start in range(0, total, CHUNK)]
    parts: list[Part] = []
    # Most of the work is done in the core, without the GIL
    with ThreadPoolExecutor(threads) as pool:
        for stop, part in zip(stops, pool.map(work, range(0, total, CHUNK), stops), strict=True):
            parts.append(part)
            if progress is not None:
                progress(stop, total)
    return parts


class ScreenStatus(Enum):
    """The result of the screening of a pose, ordered from worst to best.

    The status is that of the configuration that passed the most stages.
    """

    UNREADABLE = "unreadable"
    """The pick is invalid in this scene."""
    REACH = "out of reach"
    """No configuration was found, neither within nor outside the limits."""
    LIMITS = "out of limits"
    """Configurations were found only outside the limits."""
    SELF = "self-collision"
    """In every configuration found, the arm or its attached bodies are in self-collision."""
    CONTACT = "in contact"
    """Every configuration found is in contact, and at least one of them without self-collision."""
    FREE = "free"
    """A configuration was found that keeps every margin."""

    @property
    def stage(self) -> Stage | None:
        """The stage at which a pick with this status fails; None if it passes all stages up to the grasp."""
        stages = (Stage.INPUT, Stage.REACH, Stage.LIMITS, Stage.SELF, Stage.GRASP, None)
        return dict(zip(ScreenStatus, stages, strict=True))[self]


CODES = tuple(ScreenStatus)
"""The statuses in the order of their codes in arrays."""


def code_of(status: ScreenStatus) -> int:
    """The code of a status in arrays."""
    return CODES.index(status)


@dataclass(frozen=True, eq=False)
class ScreenedPoses:
    """The screening results of N poses or picks: ``codes`` (N,) are indices into :data:`CODES`.

    ``q`` (N, n) is the best free configuration found, otherwise one in contact; NaN if none was found. Manipulability
    and clearance (m) (N,) are those of free poses, otherwise NaN; the clearance also if it was not requested.
    ``member`` (N,) is the index of the best grasp of a pick in its family.
    """

    codes: npt.NDArray[np.int8]
    q: Array
    manipulability: Array
    clearance: Array
    member: Indices

    @classmethod
    def nothing(cls, count: int, dof: int) -> ScreenedPoses:
        """Initial results of ``count`` poses, with the lowest status and NaN."""
        codes, member = np.zeros(count, dtype=np.int8), np.zeros(count, dtype=np.int64)
        return cls(codes, np.full((count, dof), np.nan), np.full(count, np.nan), np.full(count, np.nan), member)

    @classmethod
    def joined(cls, parts: Sequence[ScreenedPoses]) -> ScreenedPoses:
        """The concatenation of at least one part."""
        return cls(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(cls)))

    def put(self, rows: Indices, other: ScreenedPoses, others: Indices) -> None:
        """Copy the rows ``others`` of another result into ``rows``."""
        for each in fields(self):
            getattr(self, each.name)[rows] = getattr(other, each.name)[others]


class Screening:
    """Screens poses with one checker; safe to use from several threads.

    2 pi windings are those nearest to ``home`` (n,). Without ``why``, which takes time, every contact is CONTACT, and
    LIMITS is reported only if the closed form gives it at no cost. The other arguments are those of
    :func:`pinproof.screen_picks`.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        home: Array,
        *,
        attempts: int = 4,
        rng: int = 0,
        why: bool = True,
        clearance: bool = False,
    ) -> None:
        require_integer("attempts", attempts, 1)
        require_integer("rng", rng, 0)
        self._checker, self._arm = checker, checker.arm
        self._why, self._clearance = why, clearance
        self._known = True
        self._closed_form = has_closed_form(checker.arm)
        self._rounds = rounds_for(checker.arm, home, attempts=attempts, rng=rng, why=why)
        self._own = checker.with_scene(Scene()) if why and checker.scene else checker

    @property
    def complete(self) -> bool:
        """Whether all configurations of each pose that is not free were checked, which proves that it is not free.

        Becomes False at the first pose for which this does not hold: a singular pose with infinitely many solutions.
        """
        return self._closed_form and self._known

    def screen(self, targets: Array) -> ScreenedPoses:
        """Screen targets (N, 4, 4), ``base_from_tcp``.

        Of the free configurations found in the same round, the result has the one with the largest manipulability.
        """
        count = len(targets)
        q, volume = np.full((count, self._arm.dof), np.nan), np.full(count, np.nan)
        reached, free, own, outside, known = np.zeros((5, count), dtype=bool)
        # Rounds of candidates for the poses that are still open
        for wanted, propose in self._rounds:
            left = ~free
            if wanted is not None:
                left &= reached == wanted
            rows = np.flatnonzero(left)
            if not len(rows):
                continue
            found = propose(targets if len(rows) == count else targets[rows])
            outside[rows] |= found.outside
            known[rows] |= found.complete
            if len(found.q):
                self._judge(rows[found.row], found.q, reached, free, own, q, volume)
        # The status is that of the configuration that passed the most stages
        codes = np.where(outside, code_of(ScreenStatus.LIMITS), code_of(ScreenStatus.REACH))
        in_contact = own | (not self._why)
        codes[reached] = code_of(ScreenStatus.SELF)
        codes[reached & in_contact] = code_of(ScreenStatus.CONTACT)
        codes[free] = code_of(ScreenStatus.FREE)
        if not (free | known).all():
            self._known = False
        clearance = np.full(count, np.nan)
        if self._clearance and free.any():
            clearance[free] = self._checker.clearance_batch(q[free])
        return ScreenedPoses(codes.astype(np.int8), q, volume, clearance, np.zeros(count, dtype=np.int64))

    def _judge(self, row: Indices, q: Array, reached: Mask, free: Mask, own: Mask, kept: Array, volume: Array) -> None:
        """Check configurations q (k, n) of the poses ``row`` (k,), ascending, and update the results of all poses.

        The configurations of a pose are checked in order of decreasing manipulability until one is free.
        """
        # In order of decreasing manipulability, pose by pose: the rows of a matrix, padded with the largest key, are
        # sorted, which takes a tenth of the time of np.lexsort
        volumes = self._arm.manipulability_batch(q)
        starts = np.flatnonzero(np.diff(row, prepend=-1))
        counts = np.diff(starts, append=len(row))
        keys = np.full((len(starts), counts.max()), np.inf)
        inside = np.arange(keys.shape[1]) < counts[:, None]
        keys[inside] = -volumes
        order = (starts[:, None] + np.argsort(keys, axis=1, kind="stable"))[inside]
        q, volumes = q[order], volumes[order]
        poses, new = row[starts], ~reached[row[starts]]
        kept[poses[new]], reached[poses] = q[starts[new]], True
        # Is one of them free?
        best = _first(starts, len(row), lambda at: self._checker.is_free_batch(q[at]))
        good = best >= 0
        free[poses[good]], kept[poses[good]], volume[poses[good]] = True, q[best[good]], volumes[best[good]]
        # If not, is one of them without self-collision?
        if self._why and self._own is not self._checker:
            of_itself = _first(starts, len(row), lambda at: self._own.is_free_batch(q[at]), ~good & ~own[poses])
            own[poses[of_itself >= 0]] = True


def _first(starts: Indices, total: int, passes: Callable[[Indices], Mask], asked: Mask | None = None) -> Indices:
    """(g,) the first entry that passes in each group; -1 if none does. The groups begin at ``starts`` (g,).

    ``passes`` is evaluated for an entry only if all earlier entries of its group failed. ``asked`` (g,) selects groups.
    """
    ends = np.append(starts[1:], total)
    found = np.full(len(starts), -1)
    groups = np.arange(len(starts)) if asked is None else np.flatnonzero(asked)
    at = starts[groups]
    while len(groups):
        good = passes(at)
        found[groups[good]] = at[good]
        groups, at = groups[~good], at[~good] + 1
        more = at < ends[groups]
        groups, at = groups[more], at[more]
    return found


FIGURES = ("limit_margin", "manipulability", "clearance")


@described(eq=False)
class ScreenResult(Saved):
    """The screening results of N picks or poses at the grasp.

    FREE means that the grasp is reached within the limits and free of contact. Approach, retreat and transit are not
    checked; use :func:`pinproof.validate_picks` for these.
    """

    names: Sequence[str] = key("N names")
    joint_names: tuple[str, ...] = key("the names of the joints of the arm")
    codes: npt.NDArray[np.int8] = key(
        "(N,) the statuses, as indices into ``ScreenStatus``; :attr:`status` has the members of the enumeration"
    )
    q: Array = key(
        "(N, n) if FREE, the free configuration found with the largest manipulability; if in contact, one of the "
        "configurations in contact; otherwise NaN"
    )
    member: npt.NDArray[np.int64] = key(
        "(N,) index of the grasp of ``q`` in its family, in the order in which they are tried; 0 is the nominal grasp"
    )
    limit_margin: Array = key(
        "(N,) if FREE, distance of ``q`` from the limits: 1 in the middle of all ranges, 0 at a limit; otherwise NaN"
    )
    manipulability: Array = key("(N,) sqrt(det(J J^T)) at ``q`` if FREE (Yoshikawa 1985; J mixes metres and radians)")
    clearance: Array = key(
        "(N,) smallest distance (m) between any two bodies at ``q`` if FREE and requested; otherwise NaN"
    )
    complete: bool = key(
        "whether all configurations were enumerated in closed form. If so, a grasp that is not FREE is proven not "
        "to be; otherwise a sweep or a search found no free configuration"
    )
    _reason: Callable[[int], str] = field(repr=False)

    formats = (".csv",)

    def _view(self) -> View:
        rows = (
            (name, status.name, *self.q[k].tolist(), self.reason(k))
            for k, (name, status) in enumerate(zip(self.names, self.status, strict=True))
        )
        return View(self.summary, [Rows(("pick", "status", *self.joint_names, "reason"), rows, len(self))])

    def __post_init__(self) -> None:
        freeze_arrays(self, "codes", "q", "member", "limit_margin", "manipulability", "clearance")

    def __len__(self) -> int:
        return len(self.codes)

    @property
    def status(self) -> tuple[ScreenStatus, ...]:
        """The N statuses."""
        return tuple(CODES[code] for code in self.codes.tolist())

    @property
    def free(self) -> npt.NDArray[np.bool_]:
        """(N,) whether each pick is FREE."""
        return np.asarray(self.codes == code_of(ScreenStatus.FREE))

    @property
    def counts(self) -> dict[ScreenStatus, int]:
        """The number of picks with each status, the best status first."""
        return {status: int((self.codes == code_of(status)).sum()) for status in reversed(CODES)}

    @property
    def summary(self) -> str:
        """The counts in one sentence."""
        counts = ", ".join(f"{count:,} {status.value}" for status, count in self.counts.items() if count)
        how = "every configuration enumerated" if self.complete else "configurations swept or searched for"
        return f"{len(self):,} screened: {counts or 'none'} ({how})"

    def reason(self, index: int) -> str:
        """Why a pick is not free, as in a verdict, with the bodies in contact. Computed on each call."""
        if self.free[index]:
            return "collision-free at the grasp"
        return self._reason(index % len(self)) or CODES[self.codes[index]].value

    def to_csv(self) -> str:
        """One row per pick: its status and all results."""
        figures = np.column_stack([*(getattr(self, name) for name in FIGURES), self.q])
        columns = (self.names, self.codes.tolist(), self.member.tolist(), figures.tolist())
        rows = (
            (name, CODES[code].value, member, *map(figure, row))
            for name, code, member, row in zip(*columns, strict=True)
        )
        return csv_text(("name", "status", "grasp", *FIGURES, *self.joint_names), rows)


CONTACT, FREE = code_of(ScreenStatus.CONTACT), code_of(ScreenStatus.FREE)


@dataclass(eq=False)
class _Open:
    """A pick with the grasps that are not screened yet, in groups, and the object that the hand may touch."""

    index: int
    pose: Array
    groups: list[Array]
    object: str | None
    done: int = 0


class GraspScreening(Screening):
    """Screens picks of a cell; safe to use from several threads. The arguments are those of :func:`screen_picks`."""

    def __init__(self, cell: PickCell, **settings: Any) -> None:
        super().__init__(cell.checker, cell.home, **settings)
        self._cell, self._settings = cell, settings
        self._hand = [each for each in cell.hand if each in cell.checker.obstacles_and_links]
        self._before = np.linalg.inv(matrix(cell.arm.root_from_base))
        self._after = np.linalg.inv(matrix(cell.shared.tip))

    def targets(self, poses: Array) -> Array:
        """``base_from_tcp`` (N, 4, 4) for poses ``root_from_tip`` (N, 4, 4)."""
        return np.ascontiguousarray(self._before @ poses @ self._after)

    def picks(self, items: Sequence[Pick | PickProblem]) -> ScreenedPoses:
        """Screen picks; the grasps of a family are checked group by group until one is free."""
        best = ScreenedPoses.nothing(len(items), self._cell.arm.dof)
        left = list(self._readable(items))
        while left:
            # The next group of grasps of every pick that is still open, in one call
            sizes = np.array([len(each.groups[0]) for each in left])
            owner, starts = np.repeat(np.arange(len(left)), sizes), np.cumsum(sizes) - sizes
            targets = self.targets(np.concatenate([each.pose @ each.groups[0] for each in left]))
            screened = self.screen(targets)
            # Contact of the hand with the object is first not allowed, which needs no additional checker: a pose that
            # is free then is also free with the contact allowed
            again = [(left[owner[k]].object, int(k)) for k in np.flatnonzero(screened.codes == CONTACT)]
            with_object = sorted((name, k) for name, k in again if name is not None)
            for name, group in groupby(with_object, key=lambda each: each[0]):
                rows = np.array([k for _, k in group])
                checker = self._cell.checker.allowing(*((each, name) for each in self._hand))
                allowed = Screening(checker, self._cell.home, **self._settings)
                screened.put(rows, allowed.screen(targets[rows]), np.arange(len(rows)))
            # The best grasp of each pick replaces that of earlier groups if its status is better
            order = np.lexsort((-np.nan_to_num(screened.manipulability), -screened.codes, owner))
            top, index = order[starts], np.array([each.index for each in left])
            better = screened.codes[top] > best.codes[index]
            best.put(index[better], screened, top[better])
            done = np.array([each.done for each in left])
            best.member[index[better]] = (done + top - starts)[better]
            for each in left:
                each.done += len(each.groups.pop(0))
            left = [each for each in left if best.codes[each.index] != FREE and each.groups]
        return best

    def of_parts(self, items: Sequence[Pick | PickProblem]) -> ScreenedPoses:
        """Screen picks of a file with tools or part types: the best of the grasps of each, each with its own hand."""
        best = ScreenedPoses.nothing(len(items), self._cell.arm.dof)
        hands: dict[PickCell, list[tuple[int, Pick]]] = {}
        for index, item in enumerate(items):
            with suppress(InputError):
                for grasp in () if isinstance(item, PickProblem) else self._cell.shared.grasps_of(item):
                    hands.setdefault(self._cell.for_pick(grasp), []).append((index, grasp))
        for cell, grasps in hands.items():
            screened = GraspScreening(cell, **self._settings).picks([grasp for _, grasp in grasps])
            for row, (index, _) in enumerate(grasps):
                if screened.codes[row] > best.codes[index]:
                    best.put(np.array([index]), screened, np.array([row]))
        return best

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
    checker = checker_of_picks(arm, scene, shared)
    cell = PickCell(checker, shared, arm.limits.snap(arm.configuration(home_q, "home")))
    screening = GraspScreening(cell, attempts=attempts, rng=rng, clearance=clearance)

    def share(start: int, stop: int) -> tuple[Sequence[str], ScreenedPoses]:
        if isinstance(source, _Poses):
            return source.names[start:stop], screening.screen(screening.targets(source.poses[start:stop]))
        items = list(source.part(start, stop))
        several = shared.tools or shared.parts
        return [item.name for item in items], (screening.of_parts if several else screening.picks)(items)

    # All picks in chunks, and figures of those that are free
    parts = in_chunks(share, len(source), threads, progress)
    screened = ScreenedPoses.joined([ScreenedPoses.nothing(0, arm.dof), *(part for _, part in parts)])
    free = screened.codes == FREE
    margins = np.full(len(free), np.nan)
    margins[free] = limit_margin(arm, screened.q[free])
    return ScreenResult(
        tuple(chain.from_iterable(names for names, _ in parts)),
        arm.joint_names,
        screened.codes,
        screened.q,
        screened.member,
        margins,
        screened.manipulability,
        screened.clearance,
        screening.complete,
        partial(_reason, cell, source, rng),
    )


class _Poses(PickSource):
    """Poses as picks without approach and retreat."""

    def __init__(self, poses: Array) -> None:
        self.poses, self.shared, self.with_object = poses, Picks(()), frozenset([False])
        self.names = tuple(f"pose_{number}" for number in range(len(poses)))

    def __len__(self) -> int:
        return len(self.poses)

    def part(self, start: int, stop: int) -> list[Pick]:
        numbers = range(start, min(stop, len(self)))
        return [Pick(self.names[number], rigid("pose", self.poses[number]), 0.0, 0.0) for number in numbers]

    def digest(self) -> str:
        raise NotImplementedError


def _reason(cell: PickCell, source: PickSource, rng: int, index: int) -> str:
    """Judge a single pick again, to obtain the message of the stage that it fails."""
    (item,) = source.part(index, index + 1)
    if isinstance(item, PickProblem):
        return item.reason
    try:
        task = PickTask(cell.shared.grasps_of(item)[0], cell)
    except InputError as error:
        return str(error)
    members = task.nearest_group
    reached = reach(task, members, rng)
    stages = (*reached.stages, *(screen(task, members, reached).stages if len(reached.q) else ()))
    return next((stage.message for stage in stages if not stage.ok), "")
