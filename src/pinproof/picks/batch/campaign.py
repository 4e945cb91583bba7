"""Judge many picks: a list in memory, the parts of a conveyor one after the other, and campaigns of any size.

A campaign judges any items that have names, such as tool paths (:func:`pinproof.tool_paths.path_campaign`).

The workers of a campaign compute the rows of chunks of picks as lines of JSON, which are written to disk. All rows of a
file are computed by the same version of the code, which is stated in the header of the file.
"""

from __future__ import annotations

import json
import pickle
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, Scene
from pinproof.common.content_hash import code_here, describe_code
from pinproof.common.files import os_errors, write_bytes_whole
from pinproof.common.results import Rows, Shown, View, Written
from pinproof.common.structs import COUNT, TEXT, Kind, key, mapping_to, reported, struct
from pinproof.common.validation import Rng, require_integer, require_type, seed_sequence
from pinproof.errors import CampaignError, FileError, InputError, RunInterrupted
from pinproof.model import Arm
from pinproof.motion import Trajectory
from pinproof.picks.input.pick import Pick
from pinproof.picks.input.picks import MOUNTED, PickProblem, Picks
from pinproof.picks.input.settings import PickBudget, PickWeights
from pinproof.picks.input.sources import PickList, PickSource, as_source
from pinproof.picks.judging.conveyor import judge_on_conveyor, on_conveyor
from pinproof.picks.judging.grasp import PickCheck
from pinproof.picks.judging.setup import PickSetup
from pinproof.picks.judging.verdict import PickStatus, PickVerdict
from pinproof.picks.report.page import MOST_ROWS, write_page
from pinproof.picks.report.report import PickReport, problem_row
from pinproof.work import (
    IN_FLIGHT,
    JOURNAL,
    Checksums,
    Journal,
    Outcome,
    Runner,
    Workers,
    do_chunks,
    ranges_missing,
    refuse_foreign,
    to_line,
)

Progress = Callable[[int, int], object]


def validate_picks(
    arm: Arm,
    scene: Scene,
    picks: Picks | Sequence[Pick],
    *,
    home: npt.ArrayLike | None = None,
    rng: Rng = 0,
    executor: Workers | None = None,
    workers: int | None = None,
    in_flight: int = IN_FLIGHT,
    weights: PickWeights | None = None,
    budget: PickBudget | None = None,
    checks: Iterable[PickCheck] = (),
    progress: Progress | None = None,
) -> PickReport:
    """Judge every pick in all stages, from reach to the timed and certified motion.

    For many thousands of picks, use :class:`pinproof.Campaign`, which keeps neither picks nor verdicts in memory.

    Parameters
    ----------
    arm
        The arm.
    scene
        The obstacles around the arm.
    picks
        The picks. The tool of a :class:`Picks` is attached to the tcp, and its margin is kept; a sequence of
        :class:`Pick` has neither.
    home
        (n,) the configuration in which each transit starts. The default is the home of the picks if they define one,
        otherwise that of the arm.
    rng
        Seed or Generator. Each pick has its own random stream, which depends on its index in the list, so the result
        does not depend on the number of workers.
    executor
        The executor that judges the picks, or a function that creates it. By default the picks are judged in this
        process, one after another.
    workers
        The number of local processes, if no executor is given.
    in_flight
        The number of chunks pending in ``executor`` at a time.
    weights
        The weights of the score by which complete motions are compared.
    budget
        The limits of the search for each pick.
    checks
        Further conditions of configurations at the grasp: functions ``check(task, candidate)`` that return why it
        fails, or None (:class:`pinproof.picks.PickCheck`). If no configuration passes, the pick fails at the stage
        ``check``, as not found; a motion that is found passes through a configuration that fulfils them.
    progress
        Called after each pick or chunk of picks with the number of picks that are judged, and the number of all picks.

    Raises
    ------
    InputError
        If ``picks`` contains anything but picks, and for the same reasons as in :meth:`PickSetup.make`.
    CampaignError
        If the workers cannot start, or a pick kills every worker that judges it.
    RunInterrupted
        After Ctrl-C (a KeyboardInterrupt); its ``result`` is the report on the picks that were judged before.
    """
    # A sequence of picks has no shared settings
    if not isinstance(picks, Picks):
        require_type("picks", picks, Picks, Iterable)
        for index, pick in enumerate(picks):
            require_type(f"picks[{index}]", pick, Pick)
        picks = Picks(tuple(picks))
    # Each pick has its own stream of random numbers
    setup = PickSetup.make(arm, scene, picks, home=home, rng=rng, weights=weights, budget=budget, checks=checks)
    seed_sequence(rng).spawn(len(picks))  # so that the next call with this Generator uses other streams

    def show(_stage: str, done: int, total: int) -> None:
        if progress is not None:
            progress(done, total)

    runner = Runner(executor=executor, workers=workers, in_flight=in_flight, progress=show)

    def report() -> PickReport:
        found: dict[int, PickVerdict] = runner.rows.get("picks", {})
        return PickReport(
            arm.robot.name,
            tuple(found[index] for index in sorted(found)),
            picks.problems,
            arm.limits.acceleration_source,
            setup.not_covered(PickList(picks).with_object),
            setup,
            not_judged=len(picks) - len(found),
        )

    # What was judged is reported also if the run is interrupted
    try:
        with runner:
            runner.run("picks", partial(_verdicts, setup), picks.picks)
    except KeyboardInterrupt:
        known = report()
        done = len(picks) - known.not_judged
        raise RunInterrupted(f"interrupted after {done:,} of {len(picks):,} picks", known) from None
    return report()


def _verdicts(setup: PickSetup, start: int, part: Iterable[Pick]) -> list[PickVerdict]:
    return [setup.judge(index, pick) for index, pick in enumerate(part, start)]


@dataclass(frozen=True, eq=False)
class BeltSequence(Shown):
    """The picks that an arm takes from a conveyor one after the other; result of :func:`pick_from_belt`.

    There is one of the ``verdicts`` for each pick, in order. Each good pick starts where and when the one before it
    ended. The last motion ends at ``end_time`` (s) on the clock of the conveyor.
    """

    verdicts: tuple[PickVerdict, ...]
    end_time: float

    @property
    def taken(self) -> tuple[PickVerdict, ...]:
        """The good picks."""
        return tuple(verdict for verdict in self.verdicts if verdict.ok)

    @property
    def trajectory(self) -> Trajectory | None:
        """The complete motion from time 0; None if nothing is taken."""
        parts = [verdict.trajectory for verdict in self.taken if verdict.trajectory is not None]
        return Trajectory.join(*parts) if parts else None

    @property
    def cycle_times(self) -> tuple[float, ...]:
        """Seconds from the release of each part to that of the next one, or from the start to the first release."""
        ends = [
            verdict.intercept.start_time + (verdict.release_time or verdict.trajectory.duration)
            for verdict in self.taken
            if verdict.intercept is not None and verdict.trajectory is not None
        ]
        return tuple(later - sooner for sooner, later in zip([0.0, *ends], ends, strict=False))

    @property
    def summary(self) -> str:
        """One line."""
        cycles = self.cycle_times
        mean = f", {sum(cycles) / len(cycles):.2f} s for each" if cycles else ""
        return f"{len(self.taken)} of {len(self.verdicts)} parts taken in {self.end_time:.1f} s{mean}"

    def _view(self) -> View:
        rows = (f"{each.pick.name}: {each.status.value}: {each.reason}" for each in self.verdicts)
        return View(self.summary, lines=rows, total=len(self.verdicts))


def pick_from_belt(setup: PickSetup, picks: Iterable[Pick]) -> BeltSequence:
    """Take parts from a conveyor one after the other, in the given order.

    The arm takes each part as early as it can after the one before. A part that cannot be taken passes and stays on the
    belt, where all later motions are certified against it, as they are against the parts at their places. The arm
    starts at its home at time 0, and each pick starts where the one before ended.

    Parameters
    ----------
    setup
        The cell, the gripper and the conveyor.
    picks
        The picks, whose objects are parts of the conveyor.

    Raises
    ------
    InputError
        If there is no conveyor, or the object of a pick is not on it.
    """
    if len(setup.shared.tools) > 1 and setup.shared.tool_change != MOUNTED:
        raise InputError(f"the belt does not wait for a change of the tools {', '.join(setup.shared.tools)}; state one")
    cell, now, verdicts = setup.cell, 0.0, list[PickVerdict]()
    for index, pick in enumerate(picks):
        if not on_conveyor(pick, setup.cell):
            raise InputError(f"the object of pick {pick.name!r} is not a part of the conveyor")
        seeds = setup.rng(index).integers(2**31, size=4).tolist()
        for grasp in setup.shared.grasps_of(pick):
            verdict = judge_on_conveyor(grasp, cell, seeds, now)
            if verdict.ok:
                break
        verdicts.append(verdict)
        belt = cell.shared.conveyor
        if verdict.trajectory is None or belt is None:
            continue
        # The arm is at the end of its motion, and the part at its place or gone
        now += verdict.trajectory.duration
        name, last = str(pick.carried), verdict.motions[-1]
        rest = tuple(part for part in belt.parts if part != name)
        placed = verdict.release_time is not None and name in last.scene
        cell = replace(
            cell,
            checker=cell.checker.with_scene(last.scene if placed else cell.checker.scene.remove(name)),
            shared=replace(cell.shared, conveyor=replace(belt, parts=rest) if rest else None),
            home=verdict.trajectory.end,
        )
    return BeltSequence(tuple(verdicts), now)


# -- campaigns ---------------------------------------------------------------------------------------------------------

ROWS, TIMINGS = "rows.jsonl", "timings.jsonl"
"""The files of a finished campaign. Times are not stored in the rows, because these would then differ between runs."""

SCHEMA = "pinproof/campaign/3"

RETRY = "retry"
"""The key that marks rows whose picks the next run judges again, because a worker died or had no memory."""

KILLED = "every worker process that judged this pick alone died"


Judge = Callable[[Any, int, Any], dict[str, Any]]
"""Judges the pick with the given index by a setup and returns a row of plain values with the key ``verdict``.

The function must be importable, because it is sent to the workers by name.
"""


class CampaignSetup(Protocol):
    """What the items of a campaign are judged with, such as :class:`PickSetup`; it can be pickled."""

    @property
    def checker(self) -> CollisionChecker:
        """The arm in its scene."""

    def identity(self) -> dict[str, Any]:
        """What the rows depend on, as plain values by name."""

    def not_covered(self, with_object: Collection[bool]) -> tuple[str, ...]:
        """What the verdicts do not cover, in sentences."""


class CampaignSource(Protocol):
    """The items of a campaign in order, such as a :class:`PickSource`; each has a ``name``."""

    @property
    def with_object(self) -> frozenset[bool]:
        """As of :class:`PickSource`; empty if the items are no picks."""

    def __len__(self) -> int: ...

    def part(self, start: int, stop: int) -> Iterable[Any]:
        """The items from index ``start`` to ``stop`` (exclusive); the result can be pickled."""

    def digest(self) -> str:
        """A hash of all items."""


def judge_row(setup: PickSetup, index: int, pick: Pick) -> dict[str, Any]:
    """The row of the verdict of all stages. Pairs excluded from collision checking are stated once, in the header."""
    row = setup.judge(index, pick).to_dict()
    del row["excluded_pairs"]
    return row


@dataclass(frozen=True, eq=False)
class RowTask:
    """Judges chunks of picks with one setup and returns one line for each pick."""

    setup: CampaignSetup
    judge: Judge

    def __call__(self, start: int, part: Iterable[Any]) -> list[bytes]:
        """The rows of consecutive picks, the first of which has the index ``start``."""
        lines = []
        for index, item in enumerate(part, start):
            try:
                row = problem_row(item) if isinstance(item, PickProblem) else self.judge(self.setup, index, item)
                lines.append(to_line({"index": index, **{name: row[name] for name in row if name != "index"}}))
            except Exception as error:  # noqa: BLE001  # one failed pick must not stop the others
                reason = f"the judge failed: {type(error).__name__}: {error}"
                lines.append(crashed_row(index, item.name, reason, retry=isinstance(error, MemoryError)))
        return lines

    def __reduce__(self) -> tuple[Callable[[str, bytes], RowTask], tuple[str, bytes]]:
        return _unpacked, (code_here(), pickle.dumps((self.setup, self.judge), protocol=pickle.HIGHEST_PROTOCOL))


def _unpacked(code: str, packed: bytes) -> RowTask:
    """Unpickle the task in a worker, after checking that the worker runs the same code as the sender."""
    if code != code_here():
        raise CampaignError(
            f"a worker runs pinproof {code_here()}, the campaign runs {code}; install the same version on all workers"
        )
    return RowTask(*pickle.loads(packed))


def crashed_row(index: int, name: str, reason: str, *, retry: bool) -> bytes:
    """The row of a pick that could not be judged; if ``retry``, the next run of the campaign judges it again."""
    row = {"index": index, "name": name, "verdict": PickStatus.CRASHED.value, "failed_at": None, "reason": reason}
    return to_line({**row, RETRY: True} if retry else row)


@struct(
    version="pinproof/campaign-summary/1",
    first=("rows", "summary", "ok", "total", "resumed", "damaged", "to_retry", "verdicts", "failed_at",
           "acceleration_source", "notes"),
    written=True,
    eq=False,
)  # fmt: skip
class CampaignResult(Shown, Written):
    """The rows of a campaign, which stay on disk."""

    not_pickled = ("setup",)

    path: Path = key(
        "the file of the rows, in the order of the picks: JSON lines after a header",
        name="rows",
        kind=Kind(TEXT.schema, lambda _, path: path, write=str),
    )
    verdicts: dict[str, int] = key("number of rows with each verdict", kind=mapping_to(COUNT))
    failed_at: dict[str, int] = key(
        "number of rows that failed at each stage; crashed picks are not counted at any stage", kind=mapping_to(COUNT)
    )
    acceleration_source: str = key("source of the acceleration limits used in the timing")
    notes: tuple[str, ...] = key("what the verdicts do not cover, in sentences")
    resumed: int = key(
        "number of rows that existed when the campaign was resumed; 0 if it ran without interruption", default=0
    )
    damaged: int = key(
        "number of rows found damaged or edited when the campaign was resumed; their picks were judged again", default=0
    )
    to_retry: int = key(
        "number of picks that crashed because a worker died or ran out of memory. The next run judges them again",
        default=0,
    )
    items: str = key("what the rows are: `picks`, or `paths`", default="picks")
    setup: Any = key(
        "the setup that the picks were judged with, used for the page; None for a result opened from its folder",
        default=None,
        hidden=True,
        compare=False,
    )

    def _view(self) -> View:
        rows = [*self.verdicts.items(), *((f"failed at {stage}", count) for stage, count in self.failed_at.items())]
        parts = [Rows(("verdict", self.items), rows), (str(self.path), *self.notes)]
        return View(f"{self.summary}; {str(self.path)!r}", parts, title=self.summary)

    @classmethod
    def open(cls, folder: str | Path, *, resumed: int = 0, damaged: int = 0) -> CampaignResult:
        """Open the result of a finished campaign from its folder.

        Raises
        ------
        CampaignError
            If the campaign is not finished, or the folder contains no campaign.
        FileError
            If the file cannot be read or is damaged.
        """
        path = Path(folder) / ROWS
        if not path.exists():
            started = (Path(folder) / JOURNAL).exists()
            raise CampaignError(f"{folder}: {'this campaign is not finished; run it again' if started else 'no rows'}")
        # Rows are counted, not kept
        header = _read_header(path)
        verdicts, failed_at, to_retry = Counter[str](), Counter[str](), 0
        for row in _read_rows(path):
            verdicts[str(row.get("verdict"))] += 1
            if row.get("failed_at") is not None:
                failed_at[str(row["failed_at"])] += 1
            to_retry += _is_to_retry(row)
        items = header["items"]
        if verdicts.total() != header[items]:
            raise FileError(path, f"has {verdicts.total()} rows of {header[items]}; run the campaign again")
        return cls(
            path,
            dict(verdicts),
            dict(failed_at),
            header["acceleration_source"],
            tuple(header["notes"]),
            resumed,
            damaged,
            to_retry,
            items,
        )

    def rows(self) -> Iterator[dict[str, Any]]:
        """The rows in order, read lazily from the file."""
        return _read_rows(self.path)

    @reported()
    def total(self) -> int:
        """The number of rows."""
        return sum(self.verdicts.values())

    @property
    def good(self) -> int:
        """The number of good picks."""
        return self.verdicts.get(PickStatus.GOOD.value, 0)

    @reported()
    def ok(self) -> bool:
        """Whether there is at least one row and every row is good."""
        return 0 < self.good == self.total

    @reported()
    def summary(self) -> str:
        """One line: the number of good picks, and the stages at which the others fail."""
        places = dict(self.failed_at)
        if crashed := self.total - self.good - sum(places.values()):
            places["no stage (crashed)"] = crashed
        failed = ", ".join(f"{count} at {stage}" for stage, count in places.items())
        return f"{self.good} of {self.total} {self.items} good" + (f"; failed: {failed}" if failed else "")

    def save(
        self,
        path: str | Path,
        *,
        arm: Arm | None = None,
        scene: Scene | None = None,
        picks: Picks | None = None,
        title: str | None = None,
        live: bool | None = None,
    ) -> None:
        """Write an HTML page with the table and a 3D view with every grasp; the rows themselves are in ``path``.

        The rows of a campaign contain no motions, so the page does not animate any. Arguments and errors are those of
        :meth:`PickReport.save` for ``.html``, the only suffix. A result that was opened from its folder needs ``arm``,
        ``scene`` and ``picks``. The page judges again the rows whose picks are in ``picks``.
        """
        if self.items != "picks":
            raise InputError(f"{path}: there are pages for campaigns of picks only; the rows are in {self.path}")
        if Path(path).suffix.lower() != ".html":
            raise InputError(f"{path}: the page of a campaign is a .html file; its rows are in {self.path}")
        rows = ((row, None) for row in self.rows())
        write_page(path, self, rows, self.verdicts, arm=arm, scene=scene, picks=picks, title=title, live=live)


def _is_to_retry(row: Mapping[str, Any]) -> bool:
    """Whether the next run judges the pick of a row again."""
    return row.get("verdict") == PickStatus.CRASHED.value and row.get(RETRY) is True


def _read_header(path: Path) -> dict[str, Any]:
    """Read the header of a file of rows; raises CampaignError if the file has another content."""
    with os_errors(path), path.open("rb") as file:
        line = file.readline()
    try:
        header = dict(json.loads(line))
        schema = header["schema"]
    except (ValueError, TypeError, KeyError) as error:
        raise CampaignError(f"{path}: does not belong to a campaign; choose another folder") from error
    if schema != SCHEMA:
        raise CampaignError(f"{path}: has the schema {schema}, but {SCHEMA} is required; choose another folder")
    return header


def _read_rows(path: Path, *, skip_damaged: bool = False) -> Iterator[dict[str, Any]]:
    """The rows of a file in order; a damaged one is skipped, or an error that names its line."""
    with os_errors(path), path.open("rb") as file:
        checksums = Checksums(file.readline())
        for index, line in enumerate(file):
            row = checksums.row(line)
            if row is not None and (skip_damaged or row["index"] == index):
                yield row
            elif not skip_damaged:
                reason = "is damaged or was edited; run the campaign again to judge this pick again"
                raise FileError(path, reason, f"line {index + 2}")


class ItemCampaign:
    """A campaign of items that have names, from tens to millions; see :class:`Campaign`.

    Parameters
    ----------
    setup, source
        What the items are judged with, and the items.
    judge
        A function ``judge(setup, index, item)`` that returns a row of plain values with the keys ``verdict`` and
        ``failed_at``. It must be importable by name.
    items
        What the items are called in sentences.
    """

    def __init__(self, setup: CampaignSetup, source: CampaignSource, judge: Judge, *, items: str) -> None:
        self._setup, self._source, self._judge, self.items = setup, source, judge, items

    def __len__(self) -> int:
        return len(self._source)

    def write_page(self, result: CampaignResult, path: str | Path, *, live: bool | None = None) -> None:
        """Write the page of a result of this campaign; ``live`` is that of :meth:`PickReport.save`."""
        result.save(path, live=live)

    def header(self) -> dict[str, Any]:
        """The first line of the file of rows: the identity of the campaign, and what its verdicts do not cover."""
        checker = self._setup.checker
        header = {
            "schema": SCHEMA,
            "items": self.items,
            self.items: len(self),
            "setup": {
                "pinproof": code_here(),
                **self._setup.identity(),
                self.items: f"{len(self)} {self.items} {self._source.digest()}",
                "judge": describe_code(self._judge),
            },
            "acceleration_source": checker.group.limits.acceleration_source,
            "notes": list(self._setup.not_covered(self._source.with_object)),
            "excluded_pairs": [[*pair.owners, pair.reason] for pair in checker.excluded],
        }
        return dict(json.loads(to_line(header)))

    def run(
        self,
        folder: str | Path,
        *,
        executor: Workers | None = None,
        workers: int | None = None,
        in_flight: int = IN_FLIGHT,
        chunk: int | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> CampaignResult:
        """Judge all picks that have no row yet, and write the rows to ``folder/rows.jsonl``.

        A chunk whose worker dies is submitted again. After three workers have died on a chunk, it is halved until the
        pick that causes the failure is found; the verdict of this pick is ``crashed``. The workers may also have been
        killed for another reason, so each further run judges crashed picks again. Picks whose rows are damaged or were
        edited by hand are also judged again.

        Parameters
        ----------
        folder
            The folder of the rows; it is created if it does not exist. Until the campaign is finished, the rows are in
            ``journal.sqlite``. The durations of the chunks are then in ``timings.jsonl``.
        executor
            Any :class:`concurrent.futures.Executor`, such as ``distributed.Client(...).get_executor()``, or a function
            that creates one, which is called again if the executor breaks. The default is local processes.
        workers
            The number of local processes, if no executor is given; the default is one per core.
        in_flight
            The number of chunks pending in ``executor`` at a time; twice the number of its workers is recommended.
        chunk
            The number of picks per chunk; the default is about one second of work. It does not affect the rows.
        progress
            Called with (existing rows, total rows) at the start and after each chunk.

        Raises
        ------
        CampaignError
            If ``folder`` contains another campaign or rows computed by other code (the message names the difference),
            or if the workers cannot start or run other code.
        FileError
            If the folder cannot be written to; rows written before the error are kept.
        RunInterrupted
            After Ctrl-C (a KeyboardInterrupt); rows written before are kept.
        """
        folder, header = Path(folder), self.header()
        rows = folder / ROWS
        # A finished campaign is not repeated, unless some of its picks are to be judged again
        if rows.exists():
            refuse_foreign(rows, _read_header(rows), header)
            if not (folder / JOURNAL).exists():
                with suppress(FileError):  # damaged rows are judged again
                    finished = CampaignResult.open(folder, resumed=len(self))
                    if not finished.to_retry:
                        return replace(finished, setup=self._setup)
        done = np.zeros(len(self), dtype=bool)
        with Journal(folder, header) as journal:
            # The rows that exist already, in the journal or in the file of a finished run
            for index, row in journal.rows():
                done[index] = not _is_to_retry(row)
            damaged = journal.damaged
            if rows.exists() and not done.any():  # rows of a finished run, some of which are judged again
                valid = 0
                for valid, row in enumerate(_read_rows(rows, skip_damaged=True), 1):  # noqa: B007
                    if not _is_to_retry(row):
                        journal.append(row["index"], [to_line(row)])
                        done[row["index"]] = True
                damaged = len(self) - valid
            before = there = int(done.sum())
            if progress is not None:
                progress(there, len(self))
            # The others are judged in chunks, in any order
            chunks = do_chunks(
                RowTask(self._setup, self._judge),
                self._source.part,
                ranges_missing(done),
                executor=executor,
                workers=workers,
                in_flight=in_flight,
                chunk=chunk,
            )
            try:
                with closing(chunks) as outcomes:
                    for outcome in outcomes:
                        timing = round(outcome.seconds, 6), outcome.worker
                        journal.append(outcome.start, self._lines(outcome), timing=timing)
                        there += outcome.stop - outcome.start
                        if progress is not None:
                            progress(there, len(self))
            except KeyboardInterrupt:
                raise RunInterrupted(f"interrupted after {there:,} of {len(self):,} {self.items}", None) from None
            # The rows in order replace the journal, which is removed only when they are on the disk.
            write_bytes_whole(rows, chain([journal.header], journal.lines()))
            times = folder / TIMINGS
            with os_errors(times):
                earlier = times.read_bytes() if times.exists() else b""
            write_bytes_whole(times, chain([earlier], map(to_line, journal.timings())))
            journal.remove()
        return replace(CampaignResult.open(folder, resumed=before, damaged=damaged), setup=self._setup)

    def _lines(self, outcome: Outcome) -> list[bytes]:
        if outcome.crashed:
            (item,) = self._source.part(outcome.start, outcome.stop)
            return [crashed_row(outcome.start, item.name, KILLED, retry=True)]
        lines: list[bytes] = outcome.result
        if len(lines) != outcome.stop - outcome.start:
            raise InputError(f"the source gave {len(lines)} picks for {outcome.start} to {outcome.stop - 1}")
        return lines


class Campaign(ItemCampaign):
    """A campaign of picks, from tens to millions.

    ``run`` can be interrupted at any time and called again, also from another process; it then resumes. The rows are
    identical byte for byte for any number of workers and any number of interruptions.

    Parameters
    ----------
    arm, scene, home
        As for :func:`validate_picks`.
    picks
        The picks: a list, or a source that is read in chunks and not held in memory
        (:func:`pinproof.picks.open_picks`, :class:`pinproof.picks.PickGrid`). The result also contains a row for each
        input row that could not be read.
    rng
        The seed. Each pick has its own random stream, which depends only on the seed and on the index of the pick.
    judge
        A function ``judge(setup, index, pick)`` that returns a row of plain values with the keys ``verdict`` and
        ``failed_at``. It must be importable by name. The default judges all stages.
    checks
        As for :func:`validate_picks`; each must be importable by name.

    Raises
    ------
    InputError
        If home is not a valid start configuration, a joint has no velocity limit, or an argument is invalid.
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        picks: Picks | PickSource,
        *,
        home: npt.ArrayLike | None = None,
        rng: int = 0,
        judge: Judge = judge_row,
        checks: Iterable[PickCheck] = (),
    ) -> None:
        require_integer("rng", rng, 0)
        source = as_source(picks)
        setup = PickSetup.make(arm, scene, source.shared, home=home, rng=rng, checks=checks)
        super().__init__(setup, source, judge, items="picks")
        self._shared = setup.shared

    def write_page(self, result: CampaignResult, path: str | Path, *, live: bool | None = None) -> None:
        """Write the page of a result of this campaign, which judges the picks of its rows again."""
        shown = tuple(pick for pick in self._source.part(0, MOST_ROWS) if isinstance(pick, Pick))
        result.save(path, picks=replace(self._shared, picks=shown), live=live)
