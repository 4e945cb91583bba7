"""What a campaign found: the file of its rows, read row by row, and how many there are of each kind."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pinproof.errors import CampaignError, FileError
from pinproof.picks.campaign.journal import JOURNAL, ROWS, is_to_retry, read_header, row_checker
from pinproof.picks.verdict import PickStatus

__all__ = ["CampaignResult"]


@dataclass(frozen=True)
class CampaignResult:
    """The rows of a campaign, which stay on disk.

    Parameters
    ----------
    path
        The file of the rows, in the order of the picks: JSON lines after a header.
    verdicts
        How many rows have each verdict.
    failed_at
        How many fail at each stage; those that crashed at none.
    acceleration_source
        Where the acceleration limits of the timing came from.
    notes
        What no verdict covers, in sentences.
    resumed
        How many of the rows existed when the campaign was resumed; 0 if it ran without interruption.
    damaged
        How many rows were damaged or edited when the campaign was resumed; their picks were judged again.
    to_retry
        How many picks crashed because their workers died or ran out of memory; another run judges these again.
    """

    path: Path
    verdicts: dict[str, int]
    failed_at: dict[str, int]
    acceleration_source: str
    notes: tuple[str, ...]
    resumed: int = 0
    damaged: int = 0
    to_retry: int = 0

    @classmethod
    def open(cls, folder: str | Path, *, resumed: int = 0, damaged: int = 0) -> CampaignResult:
        """The result in the folder of a campaign that is done.

        Raises
        ------
        CampaignError
            If the campaign is not done, or there is none.
        FileError
            If the file cannot be read or is damaged.
        """
        path = Path(folder) / ROWS
        if not path.exists():
            begun = (Path(folder) / JOURNAL).exists()
            raise CampaignError(f"{folder}: " + ("this campaign is not done yet; run it again" if begun else "no rows"))
        header = read_header(path)
        verdicts: Counter[str] = Counter()
        failed_at: Counter[str] = Counter()
        to_retry = 0
        for row in _rows(path):
            verdicts[str(row.get("verdict"))] += 1
            if row.get("failed_at") is not None:
                failed_at[str(row["failed_at"])] += 1
            to_retry += is_to_retry(row)
        if verdicts.total() != header["picks"]:
            raise FileError(path, f"has {verdicts.total()} rows of {header['picks']}; run the campaign again")
        return cls(
            path,
            dict(verdicts),
            dict(failed_at),
            header["acceleration_source"],
            tuple(header["notes"]),
            resumed,
            damaged,
            to_retry,
        )

    def rows(self) -> Iterator[dict[str, Any]]:
        """The rows in order, each read when it is asked for."""
        return _rows(self.path)

    @property
    def total(self) -> int:
        """How many rows there are."""
        return sum(self.verdicts.values())

    @property
    def good(self) -> int:
        """How many are good."""
        return self.verdicts.get(PickStatus.GOOD.value, 0)

    @property
    def ok(self) -> bool:
        """Whether every row is good, and there is one."""
        return 0 < self.good == self.total

    @property
    def summary(self) -> str:
        """One line: how many are good, and where the others fail."""
        places = dict(self.failed_at)
        if crashed := self.total - self.good - sum(places.values()):
            places["no stage (crashed)"] = crashed
        failed = ", ".join(f"{count} at {stage}" for stage, count in places.items())
        return f"{self.good} of {self.total} picks good" + (f"; failed: {failed}" if failed else "")

    def to_dict(self) -> dict[str, Any]:
        """All but the rows, as plain values for JSON."""
        return {
            "schema": "pinproof/campaign-summary/1",
            "rows": str(self.path),
            "summary": self.summary,
            "ok": self.ok,
            "total": self.total,
            "resumed": self.resumed,
            "damaged": self.damaged,
            "to_retry": self.to_retry,
            "verdicts": self.verdicts,
            "failed_at": self.failed_at,
            "acceleration_source": self.acceleration_source,
            "notes": list(self.notes),
        }


def _rows(path: Path) -> Iterator[dict[str, Any]]:
    try:
        with path.open("rb") as file:
            read = row_checker(file.readline())
            for index, line in enumerate(file):
                row = read(line)
                if row is None or row["index"] != index:
                    said = "is damaged or was edited; run the campaign again to judge its pick again"
                    raise FileError(path, said, f"line {index + 2}")
                yield row
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from error
