"""Screening of many poses at the grasp alone, and the result of screening."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from enum import Enum
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, Scene
from pinproof.common.files import write_text_whole
from pinproof.common.validation import require_integer
from pinproof.errors import InputError
from pinproof.picks.batch.proposals import Wanted, proposals_for
from pinproof.picks.judging.configurations import manipulability
from pinproof.picks.judging.verdict import Stage

__all__ = ["CODES", "Looked", "ScreenResult", "ScreenStatus", "Screening", "code_of"]

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]


class ScreenStatus(Enum):
    """What became of a pose that was screened, from the worst on: how far the way went that went farthest."""

    UNREADABLE = "unreadable"
    """What is asked for makes no sense in this scene."""
    REACH = "out of reach"
    """No configuration was found, not outside the limits either."""
    LIMITS = "out of limits"
    """Configurations were found outside the limits only."""
    SELF = "self-collision"
    """In every configuration found the arm, or what it holds, touches itself."""
    CONTACT = "in contact"
    """Every configuration found touches something, not all of them the arm alone."""
    FREE = "free"
    """There is a configuration that keeps every margin."""

    @property
    def stage(self) -> Stage | None:
        """The stage of a pick that would fail; None where all up to the grasp would be passed."""
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
"""The order in which arrays number the statuses."""


def code_of(status: ScreenStatus) -> int:
    """The number of a status in arrays."""
    return CODES.index(status)


@dataclass(frozen=True, eq=False)
class Looked:
    """What became of N poses.

    Parameters
    ----------
    codes
        (N,) places in :data:`CODES`.
    q
        (N, n) a configuration: the best free one found, else one in contact; NaN where none reaches.
    manipulability, clearance
        (N,) of free ones; NaN elsewhere, and clearance (m) where it was not asked for.
    """

    codes: npt.NDArray[np.int8]
    q: Array
    manipulability: Array
    clearance: Array

    @classmethod
    def nothing(cls, count: int, dof: int) -> Looked:
        """As many of which nothing is known."""
        return cls(np.zeros(count, dtype=np.int8), np.full((count, dof), np.nan), *np.full((2, count), np.nan))

    @classmethod
    def joined(cls, parts: Sequence[Looked]) -> Looked:
        """At least one part, one behind the other."""
        return cls(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(cls)))

    def put(self, rows: Indices, other: Looked, others: Indices) -> None:
        """What is known of rows of another into these rows."""
        for each in fields(self):
            getattr(self, each.name)[rows] = getattr(other, each.name)[others]


class Screening:
    """Looks at poses with one checker; may be used from several threads.

    Parameters
    ----------
    checker
        The arm in its scene, with its tool attached.
    home
        (n,) whole turns are chosen near it, and searches begin there.
    attempts
        Starts of the search, for arms without a closed form.
    rng
        Seed of the searches.
    why
        Whether all is done to tell limits from reach, and the arm's touching itself from other contact: without, every
        contact is said to be CONTACT, and LIMITS where a closed form tells it by the way.
    clearance
        Whether the clearance of what is free is measured.
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
        self._own = checker.with_scene(Scene()) if why and checker.scene.obstacles else checker

    @property
    def complete(self) -> bool:
        """Whether every configuration was checked of each pose that is not free, so that it cannot be free.

        Changes to False with the first pose of which this is not so: a singular one with a continuum of configurations.
        """
        return self._proposals.complete and self._known

    def look(self, targets: Array) -> Looked:
        """What becomes of targets (N, 4, 4), ``base_from_tcp``.

        Of several free configurations, the most manipulable of those that were proposed in one round is told.
        """
        count = len(targets)
        q, volume = np.full((count, self._arm.dof), np.nan), np.full(count, np.nan)
        reached, free, own, outside, known = np.zeros((5, count), dtype=bool)
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
        codes = np.where(outside, code_of(ScreenStatus.LIMITS), code_of(ScreenStatus.REACH))
        contact = np.where(own, code_of(ScreenStatus.CONTACT), code_of(ScreenStatus.SELF))
        codes = np.where(reached, contact if self._why else code_of(ScreenStatus.CONTACT), codes)
        codes[free] = code_of(ScreenStatus.FREE)
        if not (free | known).all():
            self._known = False
        clearance = np.full(count, np.nan)
        if self._clearance and free.any():
            clearance[free] = self._checker.clearance_batch(q[free])
        return Looked(codes.astype(np.int8), q, volume, clearance)

    def _judge(self, row: Indices, q: Array, reached: Mask, free: Mask, own: Mask, kept: Array, volume: Array) -> None:
        """Judge configurations q (k, n) of the poses ``row`` (k,), into what is known of all poses.

        The most manipulable of each pose goes first, and the others only where it is in contact.
        """
        volumes = manipulability(self._arm, q)
        order = np.lexsort((-volumes, row))
        row, q, volumes = row[order], q[order], volumes[order]
        starts = np.flatnonzero(np.diff(row, prepend=-1))
        poses, new = row[starts], ~reached[row[starts]]
        kept[poses[new]], reached[poses] = q[starts[new]], True
        best = _first(starts, len(row), lambda at: self._checker.is_free_batch(q[at]))
        good = best >= 0
        free[poses[good]], kept[poses[good]], volume[poses[good]] = True, q[best[good]], volumes[best[good]]
        if self._why and self._own is not self._checker:
            of_itself = _first(starts, len(row), lambda at: self._own.is_free_batch(q[at]), ~good & ~own[poses])
            own[poses[of_itself >= 0]] = True


def _first(starts: Indices, total: int, passes: Callable[[Indices], Mask], asked: Mask | None = None) -> Indices:
    """(g,) the first entry that passes, of groups of entries that begin at ``starts`` (g,); -1 where none does.

    ``passes`` is only asked for entries behind those of their group that failed. ``asked`` (g,): of which groups.
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
class ScreenResult:
    """What became of N picks, or poses, at the grasp alone.

    FREE says that the grasp is reached, inside the limits and free of contact; nothing is said of the ways to it and
    from it. For these there is :func:`pinproof.validate_picks`.

    Parameters
    ----------
    names
        N names.
    joint_names
        Of the arm.
    codes
        (N,) the statuses, as places in ``ScreenStatus``; :attr:`status` are they themselves.
    q
        (N, n) where FREE, the most manipulable free configuration found; where in contact, one of those; NaN elsewhere.
    member
        (N,) which grasp of the family ``q`` is of, in the order in which they are tried; 0 the nominal one.
    limit_margin
        (N,) how far ``q`` stays from limits where FREE: 1 in the middle of all ranges, 0 at a limit; NaN elsewhere.
    manipulability
        (N,) sqrt(det(J J^T)) at ``q`` where FREE (Yoshikawa 1985; metres and radians mixed as J has them).
    clearance
        (N,) metres between the bodies nearest to each other at ``q`` where FREE, if it was asked for; else NaN.
    complete
        Whether the closed form told every configuration, so that of a grasp, what is not free cannot be. Else a "no" is
        one of a sweep or a search.
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

    def __post_init__(self) -> None:
        for name in ("codes", "q", "member", "limit_margin", "manipulability", "clearance"):
            array = np.array(getattr(self, name))
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.codes)

    @property
    def status(self) -> tuple[ScreenStatus, ...]:
        """N statuses."""
        return tuple(CODES[code] for code in self.codes.tolist())

    @property
    def free(self) -> npt.NDArray[np.bool_]:
        """(N,) which are FREE."""
        return np.asarray(self.codes == code_of(ScreenStatus.FREE))

    @property
    def counts(self) -> dict[ScreenStatus, int]:
        """How many there are of each status, the best first."""
        return {status: int((self.codes == code_of(status)).sum()) for status in reversed(CODES)}

    @property
    def summary(self) -> str:
        """The counts in a sentence."""
        counts = ", ".join(f"{count:,} {status.value}" for status, count in self.counts.items() if count)
        how = "every configuration enumerated" if self.complete else "configurations swept or searched for"
        return f"{len(self):,} screened: {counts or 'none'} ({how})"

    def reason(self, index: int) -> str:
        """Why one is not free, in the words of a verdict; names what touches what. Worked out when asked."""
        if self.free[index]:
            return "collision-free at the grasp"
        return self._reason(index % len(self)) or CODES[self.codes[index]].value

    def save(self, path: str | Path) -> None:
        """Write a table (``.csv``), whole or not at all: a row a pick with its status and all that is known of it.

        Raises
        ------
        InputError
            For another ending.
        FileError
            For a place that cannot be written to.
        """
        if Path(path).suffix.lower() != ".csv":
            raise InputError(f"{path}: the suffix of a screening result is .csv")
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(("name", "status", "grasp", *FIGURES, *self.joint_names))
        figures = np.column_stack([*(getattr(self, name) for name in FIGURES), self.q])
        for name, code, member, row in zip(self.names, self.codes.tolist(), self.member.tolist(), figures, strict=True):
            told = ["" if np.isnan(value) else f"{value:.9g}" for value in row.tolist()]
            writer.writerow((name, CODES[code].value, member, *told))
        write_text_whole(path, out.getvalue())
