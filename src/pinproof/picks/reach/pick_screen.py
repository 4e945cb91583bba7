"""What screening found: a status for each pick or pose, and the configurations of those that are free."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.common.files import write_text_whole
from pinproof.errors import InputError
from pinproof.picks.reach.screening import CODES, ScreenStatus, code_of

__all__ = ["ScreenResult"]

Array = npt.NDArray[np.float64]

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
        said = ", ".join(f"{count:,} {status.value}" for status, count in self.counts.items() if count)
        how = "every configuration enumerated" if self.complete else "configurations swept or searched for"
        return f"{len(self):,} screened: {said or 'none'} ({how})"

    def reason(self, index: int) -> str:
        """Why one is not free, in the words of a verdict; names what touches what. Worked out when asked."""
        if self.free[index]:
            return "free at the grasp"
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
            raise InputError(f"{path}: what was screened is written as .csv")
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(("name", "status", "grasp", *FIGURES, *self.joint_names))
        figures = np.column_stack([*(getattr(self, name) for name in FIGURES), self.q])
        for name, code, member, row in zip(self.names, self.codes.tolist(), self.member.tolist(), figures, strict=True):
            told = ["" if np.isnan(value) else f"{value:.9g}" for value in row.tolist()]
            writer.writerow((name, CODES[code].value, member, *told))
        write_text_whole(path, out.getvalue())
