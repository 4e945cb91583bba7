"""What a worker computes: the rows of a chunk of picks as lines of JSON; and the version of the code that does so."""

from __future__ import annotations

import hashlib
import inspect
import pickle
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from pinproof import __version__
from pinproof.common.content_hash import LENGTH, digest
from pinproof.errors import CampaignError
from pinproof.picks.campaign.journal import CRASHED, RETRY, to_line
from pinproof.picks.pick import Pick, PickProblem
from pinproof.picks.report.rows import problem_row, verdict_row
from pinproof.picks.setup import PickSetup

__all__ = [
    "Judge",
    "RowTask",
    "code_here",
    "crashed_row",
    "judge_row",
    "judge_words",
]

PACKAGE = Path(__file__).parents[2]

BESIDE_IT = ("benchmarks", "cli", "viewer")
"""Rooms that no verdict comes from: a folder is not to be refused for a word of help that was mended."""

LIBRARIES = ("pin", "coal", "numpy", "numba")
"""The libraries whose numbers stand in verdicts."""


@cache
def code_here() -> str:
    """The code of this process in a line: version and hash of pinproof's own source, and the libraries beneath it.

    A version is not enough: it stays the same in a checkout that is worked on.
    """
    into = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*.py"), key=lambda path: path.relative_to(PACKAGE).as_posix()):
        name = path.relative_to(PACKAGE)
        if name.parts[0] not in BESIDE_IT:
            content = path.read_bytes()
            into.update(f"{name.as_posix()}\0{len(content)}\0".encode() + content)
    libraries = ", ".join(f"{name} {_version(name)}" for name in LIBRARIES)
    return f"{__version__} {into.hexdigest()[:LENGTH]} on {libraries}"


def judge_words(judge: Callable[..., Any]) -> str:
    """A judge by its name and, if it is not one of pinproof's own, a hash of its source."""
    name = f"{judge.__module__}.{judge.__qualname__}"
    if judge.__module__.partition(".")[0] == PACKAGE.name:
        return name
    try:
        return f"{name} {digest(inspect.getsource(judge))}"
    except (OSError, TypeError):  # without a source file it goes by its name
        return name


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"


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
