"""Two set-ups compared: the same poses, before and after the robot was moved or the tool changed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.picks.reach.reach_map import ReachMap

__all__ = ["ReachComparison"]


@dataclass(frozen=True, eq=False)
class ReachComparison:
    """What a change of the set-up won and lost.

    Parameters
    ----------
    before, after
        Maps of the same poses.

    Raises
    ------
    InputError
        If they asked for different poses.
    """

    before: ReachMap
    after: ReachMap

    def __post_init__(self) -> None:
        if differ := self.before.same_question(self.after):
            raise InputError(f"two reach maps cannot be compared: {differ}")

    @property
    def won(self) -> npt.NDArray[np.bool_]:
        """(N, m) poses that are free after, and were not before."""
        return np.asarray(self.after.free & ~self.before.free)

    @property
    def lost(self) -> npt.NDArray[np.bool_]:
        """(N, m) poses that were free before, and are not after."""
        return np.asarray(self.before.free & ~self.after.free)

    @property
    def summary(self) -> str:
        """The change in a sentence, with the places where most was won and lost."""
        total = self.before.free.size
        words = [f"of {total} poses {_share(self.won, total)} won, {_share(self.lost, total)} lost"]
        for name, mask in (("won", self.won), ("lost", self.lost)):
            counts = mask.sum(axis=1)
            if counts.any():
                where = self.before.region.points[int(counts.argmax())]
                words.append(f"most {name} at ({', '.join(f'{v:.3f}' for v in where)}): {counts.max()} orientations")
        words += [] if self.before.complete and self.after.complete else ["a search stands behind a no, not a proof"]
        return "; ".join(words)

    def save(self, path: str | Path) -> None:
        """Write the change, whole or not at all: ``.csv`` (a row a point) or ``.png`` (slices, won less lost).

        Raises
        ------
        InputError
            For another ending, or a picture of points that are no grid.
        FileError
            For a place that cannot be written to.
        """
        from pinproof.picks.reach.reach_files import write_change

        write_change(path, self)


def _share(mask: npt.NDArray[np.bool_], total: int) -> str:
    return f"{int(mask.sum())} ({mask.sum() / total:.1%})"
