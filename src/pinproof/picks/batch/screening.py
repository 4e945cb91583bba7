"""Screening of many poses at the grasp alone: candidate configurations, in rounds, and the result.

Later rounds process only the poses that are not solved yet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, fields
from enum import Enum, auto
from typing import Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, Scene
from pinproof.common.files import csv_text, figure
from pinproof.common.results import Rows, Saved, View
from pinproof.common.validation import freeze_arrays, require_integer
from pinproof.ik import AnalyticIk, Clik, IkBranchesBatch
from pinproof.model import Arm
from pinproof.picks.judging.configurations import SWEEP, has_closed_form, manipulability, turned_inside, widened
from pinproof.picks.judging.verdict import Stage
from pinproof.spatial import Array

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

TURN = 2 * np.pi


class Wanted(Enum):
    """The poses that a round processes."""

    OPEN = auto()
    """Poses without a known free configuration."""
    REACHED = auto()
    """The open poses that are known to be reachable."""
    UNREACHED = auto()
    """The open poses that are not known to be reachable."""


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


class Proposals(Protocol):
    """Configurations for poses of an arm.

    ``complete``: the first round gives all configurations, except at singular targets (see :class:`Proposed`).
    """

    complete: bool = False

    def rounds(self, *, why: bool) -> Iterator[tuple[Wanted, int]]:
        """The poses of each round, and its number.

        With ``why``, there are additional rounds that only determine why no configuration was found.
        """

    def propose(self, number: int, targets: Array) -> Proposed:
        """The configurations that a round finds for targets (N, 4, 4), ``base_from_tcp``."""


def proposals_for(arm: Arm, home: Array, *, attempts: int, rng: int) -> Proposals:
    """All IK branches if there is a closed form, a sweep for arms with seven joints, otherwise a search."""
    if has_closed_form(arm):
        return _Closed(arm, home)
    return _Swept(arm, home, rng) if has_closed_form(arm, most=7) else _Searched(arm, home, attempts, rng)


class _Closed(Proposals):
    """All IK branches of all targets, in one round."""

    complete = True

    def __init__(self, arm: Arm, home: Array) -> None:
        self._arm, self._home = arm, home

    def rounds(self, *, why: bool) -> Iterator[tuple[Wanted, int]]:
        del why
        yield Wanted.OPEN, 0

    def propose(self, number: int, targets: Array) -> Proposed:
        del number
        return _branches(AnalyticIk().solve_all_batch(self._arm, targets, self._home))


class _Swept(Proposals):
    """The branches of an arm with seven joints at fixed values of one joint, followed by a search.

    The values are those at which a pick is judged. To find configurations outside the limits, the joint is swept over a
    full rotation.
    """

    def __init__(self, arm: Arm, home: Array, rng: int) -> None:
        self._arm, self._home, self._rng, self._span = arm, home, rng, Span(arm)
        joint, values = SWEEP.redundant_grid(arm, home) or (0, home[:0])
        # sorting by the reversed binary digits of the index places neighbouring values far apart
        spread = values[np.argsort([int(f"{k:010b}"[::-1], 2) for k in range(len(values))])]
        self._groups = [group for group in np.split(spread, np.cumsum(GROUPS)) if len(group)]
        step = float(np.diff(values).max(initial=TURN))
        self._beyond = np.arange(values[-1] + step, values[0] + TURN, step) if arm.angular[joint] else values[:0]
        self._search = len(self._groups)

    def rounds(self, *, why: bool) -> Iterator[tuple[Wanted, int]]:
        yield from ((Wanted.OPEN, k) for k in range(self._search))
        yield Wanted.UNREACHED, self._search
        if why and len(self._beyond):
            yield Wanted.UNREACHED, self._search + 1

    def propose(self, number: int, targets: Array) -> Proposed:
        if number == self._search:
            return _searched(self._arm, targets, self._home, self._rng, self._span)
        values = self._groups[number] if number < self._search else self._beyond
        return _branches(SWEEP.solve_all_batch(self._arm, targets, self._home, redundant_values=values))


class _Searched(Proposals):
    """The results of a search from several start configurations."""

    def __init__(self, arm: Arm, home: Array, attempts: int, rng: int) -> None:
        low, high = arm.limits.sampling_range()
        others = np.random.default_rng(rng).uniform(low, high, (attempts - 1, arm.dof))
        self._arm, self._wide, self._rng = arm, widened(arm), rng
        self._starts, self._span = np.vstack([home, others]), Span(arm)

    def rounds(self, *, why: bool) -> Iterator[tuple[Wanted, int]]:
        yield Wanted.OPEN, 0
        # a pose that the first search did not reach with all its restarts is unlikely to be reached from another start
        yield from ((Wanted.REACHED, k) for k in range(1, len(self._starts)))
        if why:
            yield Wanted.UNREACHED, len(self._starts)

    def propose(self, number: int, targets: Array) -> Proposed:
        if number < len(self._starts):
            return _searched(self._arm, targets, self._starts[number], self._rng + number, self._span)
        wide = _searched(self._wide, targets, self._starts[0], self._rng, Span(self._wide))
        q, outside = turned_inside(self._arm, wide.q), wide.outside
        inside = self._arm.limits.inside(q)
        outside[wide.row[~inside]] = True
        return Proposed(wide.row[inside], np.ascontiguousarray(q[inside]), outside, np.zeros(len(targets), dtype=bool))


def _branches(found: IkBranchesBatch) -> Proposed:
    row, column = np.nonzero(np.arange(found.q.shape[1]) < found.count[:, None])
    return Proposed(row, found.q[row, column], found.outside > 0, found.complete)


def _searched(arm: Arm, targets: Array, start: Array, rng: int, span: Span) -> Proposed:
    near = np.flatnonzero(span.may_reach(targets))
    found = Clik(restarts=RESTARTS).solve_batch(arm, targets[near], start, rng=rng)
    none = np.zeros(len(targets), dtype=bool)
    return Proposed(near[found.ok], np.ascontiguousarray(found.q[found.ok]), none, none.copy())


CHUNK = 4096
"""Poses screened at a time, so that their results fit into the processor cache and progress can be reported."""

Part = TypeVar("Part")


def in_chunks(
    work: Callable[[int, int], Part], total: int, threads: int, progress: Callable[[int, int], None] | None
) -> list[Part]:
    """Return ``work(start, stop)`` for chunks of ``range(total)``, in order; ``progress`` gets the number finished."""
    stops = [min(start + CHUNK, total) for start in range(0, total, CHUNK)]
    parts: list[Part] = []
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
        return _STAGES[self]


_STAGES = {
    ScreenStatus.UNREADABLE: Stage.INPUT,
    ScreenStatus.REACH: Stage.REACH,
    ScreenStatus.LIMITS: Stage.LIMITS,
    ScreenStatus.SELF: Stage.SELF,
    ScreenStatus.CONTACT: Stage.GRASP,
    ScreenStatus.FREE: None,
}

CODES = tuple(ScreenStatus)
"""The statuses in the order of their codes in arrays."""


def code_of(status: ScreenStatus) -> int:
    """The code of a status in arrays."""
    return CODES.index(status)


@dataclass(frozen=True, eq=False)
class ScreenedPoses:
    """The screening results of N poses: ``codes`` (N,) are indices into :data:`CODES`.

    ``q`` (N, n) is the best free configuration found, otherwise one in contact; NaN if none was found. Manipulability
    and clearance (m) (N,) are those of free poses, otherwise NaN; the clearance also if it was not requested.
    """

    codes: npt.NDArray[np.int8]
    q: Array
    manipulability: Array
    clearance: Array

    @classmethod
    def nothing(cls, count: int, dof: int) -> ScreenedPoses:
        """Initial results of ``count`` poses, with the lowest status and NaN."""
        return cls(np.zeros(count, dtype=np.int8), np.full((count, dof), np.nan), *np.full((2, count), np.nan))

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
        self._proposals = proposals_for(checker.arm, home, attempts=attempts, rng=rng)
        self._own = checker.with_scene(Scene()) if why and checker.scene else checker

    @property
    def complete(self) -> bool:
        """Whether all configurations of each pose that is not free were checked, which proves that it is not free.

        Becomes False at the first pose for which this does not hold: a singular pose with infinitely many solutions.
        """
        return self._proposals.complete and self._known

    def screen(self, targets: Array) -> ScreenedPoses:
        """Screen targets (N, 4, 4), ``base_from_tcp``.

        Of the free configurations found in the same round, the result has the one with the largest manipulability.
        """
        count = len(targets)
        q, volume = np.full((count, self._arm.dof), np.nan), np.full(count, np.nan)
        reached, free, own, outside, known = np.zeros((5, count), dtype=bool)
        # Rounds of candidates for the poses that are still open
        for wanted, number in self._proposals.rounds(why=self._why):
            left = ~free
            if wanted is not Wanted.OPEN:
                left &= reached if wanted is Wanted.REACHED else ~reached
            rows = np.flatnonzero(left)
            if not len(rows):
                continue
            found = self._proposals.propose(number, targets if len(rows) == count else targets[rows])
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
        return ScreenedPoses(codes.astype(np.int8), q, volume, clearance)

    def _judge(self, row: Indices, q: Array, reached: Mask, free: Mask, own: Mask, kept: Array, volume: Array) -> None:
        """Check configurations q (k, n) of the poses ``row`` (k,), ascending, and update the results of all poses.

        The configurations of a pose are checked in order of decreasing manipulability until one is free.
        """
        # In order of decreasing manipulability, pose by pose
        volumes = manipulability(self._arm, q)
        starts = np.flatnonzero(np.diff(row, prepend=-1))
        order = _decreasing(starts, volumes)
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


def _decreasing(starts: Indices, values: Array) -> Indices:
    """(k,) the order of decreasing values (k,) in each group; the groups begin at ``starts`` (g,).

    The rows of a matrix, padded with the largest key, are sorted, which takes a tenth of the time of np.lexsort.
    """
    counts = np.diff(starts, append=len(values))
    keys = np.full((len(starts), counts.max()), np.inf)
    inside = np.arange(keys.shape[1]) < counts[:, None]
    keys[inside] = -values
    order = np.argsort(keys, axis=1, kind="stable")
    return np.asarray((starts[:, None] + order)[inside])


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


@dataclass(frozen=True, eq=False)
class ScreenResult(Saved):
    """The screening results of N picks or poses at the grasp.

    FREE means that the grasp is reached within the limits and free of contact. Approach, retreat and transit are not
    checked; use :func:`pinproof.validate_picks` for these.

    Parameters
    ----------
    names
        N names.
    joint_names
        The names of the joints of the arm.
    codes
        (N,) the statuses, as indices into ``ScreenStatus``; :attr:`status` has the members of the enumeration.
    q
        (N, n) if FREE, the free configuration found with the largest manipulability; if in contact, one of the
        configurations in contact; otherwise NaN.
    member
        (N,) index of the grasp of ``q`` in its family, in the order in which they are tried; 0 is the nominal grasp.
    limit_margin
        (N,) if FREE, distance of ``q`` from the limits: 1 in the middle of all ranges, 0 at a limit; otherwise NaN.
    manipulability
        (N,) sqrt(det(J J^T)) at ``q`` if FREE (Yoshikawa 1985; J mixes metres and radians).
    clearance
        (N,) smallest distance (m) between any two bodies at ``q`` if FREE and requested; otherwise NaN.
    complete
        Whether all configurations were enumerated in closed form. If so, a grasp that is not FREE is proven not to be;
        otherwise a sweep or a search found no free configuration.
    """

    names: Sequence[str]
    joint_names: tuple[str, ...]
    codes: npt.NDArray[np.int8]
    q: Array
    member: npt.NDArray[np.int64]
    limit_margin: Array
    manipulability: Array
    clearance: Array
    complete: bool
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
