"""The task of a campaign: a chunk of picks is judged, and becomes lines of JSON."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from pinproof.errors import CampaignError
from pinproof.picks.campaign.code import code_here
from pinproof.picks.campaign.journal import CRASHED, RETRY, to_line
from pinproof.picks.pick import Pick, PickProblem
from pinproof.picks.report.rows import problem_row, verdict_row
from pinproof.picks.setup import PickSetup

__all__ = ["Judge", "RowTask", "crashed_row", "judge_row"]

Judge = Callable[[PickSetup, int, Pick], dict[str, Any]]
"""Judges the pick at a place, to a row of plain values with a ``verdict``. Importable, as it is sent by name."""


def judge_row(setup: PickSetup, index: int, pick: Pick) -> dict[str, Any]:
    """The verdict through all stages. What is not checked is the same in every row, and stands in the header."""
    row = verdict_row(setup.judge(index, pick))
    del row["excluded_pairs"]
    return row


@dataclass(frozen=True, eq=False)
class RowTask:
    """Judges chunks with one set-up; the lines of a chunk come back, one a pick."""

    setup: PickSetup
    judge: Judge

    def __call__(self, start: int, part: Iterable[Pick | PickProblem]) -> list[bytes]:
        """The rows of the picks from place ``start`` on."""
        return [self._line(index, item) for index, item in enumerate(part, start)]

    def __reduce__(self) -> tuple[Callable[[str, bytes], RowTask], tuple[str, bytes]]:
        return _unpacked, (code_here(), pickle.dumps((self.setup, self.judge), protocol=pickle.HIGHEST_PROTOCOL))

    def _line(self, index: int, item: Pick | PickProblem) -> bytes:
        if isinstance(item, PickProblem):
            return to_line({"index": index, **problem_row(item)})
        try:
            row = self.judge(self.setup, index, item)
            return to_line({"index": index, **{key: value for key, value in row.items() if key != "index"}})
        except Exception as error:  # noqa: BLE001  # one pick that cannot be judged never stops the others
            reason = f"the judge failed: {type(error).__name__}: {error}"
            return crashed_row(index, item.name, reason, retry=isinstance(error, MemoryError))


def _unpacked(code: str, packed: bytes) -> RowTask:
    """The task in a worker, which must have the code of the one who sent it: before anything of it is unpickled."""
    if code != code_here():
        raise CampaignError(
            f"a worker has pinproof {code_here()}; the campaign is run by {code}: rows of two codes do not make one "
            "file, so give the workers the same"
        )
    return RowTask(*pickle.loads(packed))


def crashed_row(index: int, name: str, reason: str, *, retry: bool) -> bytes:
    """The row of a pick that could not be judged; if ``retry``, the next run of the campaign judges it again."""
    row = {"index": index, "name": name, "verdict": CRASHED, "failed_at": None, "reason": reason}
    return to_line({**row, RETRY: True} if retry else row)
