"""What a campaign found: the file of its rows, read row by row, and how many there are of each kind."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pinproof.errors import CampaignError, FileError
from pinproof.picks.campaign.journal import JOURNAL, ROWS, read_header
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
        How many of the rows were there when the campaign went on; 0 if it ran in one go.
    """

    path: Path
    verdicts: dict[str, int]
    failed_at: dict[str, int]
    acceleration_source: str
    notes: tuple[str, ...]
    resumed: int = 0

    @classmethod
    def open(cls, folder: str | Path, *, resumed: int = 0) -> CampaignResult:
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
        for row in _rows(path):
            verdicts[str(row.get("verdict"))] += 1
            if row.get("failed_at") is not None:
                failed_at[str(row["failed_at"])] += 1
        if verdicts.total() != header["picks"]:
            raise FileError(path, f"holds {verdicts.total()} rows of {header['picks']}")
        return cls(
            path, dict(verdicts), dict(failed_at), header["acceleration_source"], tuple(header["notes"]), resumed
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
            "verdicts": self.verdicts,
            "failed_at": self.failed_at,
            "acceleration_source": self.acceleration_source,
            "notes": list(self.notes),
        }


def _rows(path: Path) -> Iterator[dict[str, Any]]:
    try:
        with path.open("rb") as file:
            file.readline()
            for number, line in enumerate(file, start=2):
                try:
                    yield json.loads(line)
                except ValueError as error:
                    raise FileError(path, "is damaged", f"line {number}") from error
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from error
