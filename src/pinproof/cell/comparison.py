"""Comparison of two set-ups of a cell pick by pick: won, lost, faster, slower."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from enum import Enum
from operator import attrgetter
from pathlib import Path
from tempfile import TemporaryDirectory

from pinproof.cell.pages import write_comparison_page
from pinproof.common import structs as st
from pinproof.common.files import csv_text, figure
from pinproof.common.results import Rows, Saved, View, Written
from pinproof.common.validation import require_positive
from pinproof.errors import InputError, UnknownNameError
from pinproof.picks import PickReport, PickStatus, PickVerdict

SHARED, LEAST = "{{block %d of both pages}}", 10_000
"""What the pages of both set-ups contain, until they are opened, instead of scripts and data of at least so many
characters that are equal in both, such as the viewer."""


class PickChange(Enum):
    """How the verdict on a pick changes."""

    WON = "won"
    """The pick is good only after the change."""
    LOST = "lost"
    """The pick is good only before the change."""
    FASTER = "faster"
    """The pick takes less time after the change."""
    SLOWER = "slower"
    """The pick takes more time after the change."""
    SAME = "same"
    """The pick takes the same time, up to the smallest difference that counts."""
    FAILING = "failing"
    """The pick is good neither before nor after the change."""


SIDE = st.report_table(
    "compared_verdict",
    "The verdict on a pick in one set-up.",
    st.required(
        "verdict",
        st.choice(*(status.value for status in PickStatus)),
        "the verdict",
        get=lambda verdict: verdict.status,
    ),
    st.required(
        "failed_at", st.optional(st.ANY_TEXT), "the stage that failed; null for a good pick", get=attrgetter("failed")
    ),
    st.required("duration", st.OPTIONAL_NUMBER, "duration of the motion", "s", lambda verdict: _seconds(verdict)),
    st.required("reason", st.ANY_TEXT, "why it failed"),
)


@st.struct("difference", first=("name", "change"), written=True, eq=False)
class PickDifference:
    """One pick in both set-ups, before and after a change."""

    change: PickChange = st.key("how the verdict changes")
    before: PickVerdict = st.key("in the first set-up", kind=SIDE)
    after: PickVerdict = st.key("in the second set-up", kind=SIDE)

    @st.reported(kind=st.TEXT)
    def name(self) -> str:
        """The name of the pick."""
        return self.before.pick.name

    @property
    def seconds(self) -> tuple[float | None, float | None]:
        """The times (s) before and after; None where the pick is not good."""
        return _seconds(self.before), _seconds(self.after)

    @property
    def verdicts(self) -> tuple[str, str]:
        """The verdicts before and after."""
        return self.before.status.value, self.after.status.value

    @property
    def gained(self) -> float | None:
        """Seconds by which the pick is faster; None unless it is good before and after."""
        before, after = self.seconds
        return None if before is None or after is None else before - after

    @property
    def reason(self) -> str:
        """Why the pick fails, if it does after the change, otherwise if it did before."""
        return self.after.reason if not self.after.ok else "" if self.before.ok else self.before.reason


def _seconds(verdict: PickVerdict) -> float | None:
    return None if verdict.trajectory is None else verdict.trajectory.duration


@st.struct(
    "comparison",
    first=("ok", "summary", "counts", "seconds_before", "seconds_after", "cycle_time_before", "cycle_time_after"),
    written=True,
    version="pinproof/comparison/1",
    eq=False,
)
class CellComparison(Saved, Written):
    """Two set-ups compared pick by pick. Readers must accept unknown keys: they are additions of the same version."""

    before: PickReport = st.key("the first report", hidden=True)
    after: PickReport = st.key("the second report, on the same picks", hidden=True)
    differences: tuple[PickDifference, ...] = st.key("the picks, in the order of the first report", name="picks")
    least: float = st.key("the smallest difference that counts as faster or slower", "s", hidden=True)

    formats = (".json", ".csv", ".md", ".html")

    def of(self, change: PickChange) -> tuple[PickDifference, ...]:
        """The picks with one kind of change."""
        return tuple(pick for pick in self.differences if pick.change is change)

    @property
    def seconds(self) -> tuple[float, float]:
        """The sums of the times (s) before and after, over the picks that are good in both."""
        both = [pick for pick in self.differences if pick.gained is not None]
        return sum(pick.seconds[0] or 0.0 for pick in both), sum(pick.seconds[1] or 0.0 for pick in both)

    @st.reported("s", minimum=0)
    def seconds_before(self) -> float:
        """Sum of the times of the picks that are good in both, in the first."""
        return self.seconds[0]

    @st.reported("s", minimum=0)
    def seconds_after(self) -> float:
        """The same in the second."""
        return self.seconds[1]

    @st.reported("s", minimum=0)
    def cycle_time_before(self) -> float:
        """Sum of the times of all good picks of the first."""
        return self.before.total_time

    @st.reported("s", minimum=0)
    def cycle_time_after(self) -> float:
        """Sum of the times of all good picks of the second."""
        return self.after.total_time

    @st.reported(kind=st.mapping_to(st.COUNT))
    def counts(self) -> dict[str, int]:
        """Number of picks by kind of change."""
        return {change.value: len(self.of(change)) for change in PickChange}

    @st.reported()
    def ok(self) -> bool:
        """Whether no pick is lost."""
        return not self.of(PickChange.LOST)

    @st.reported()
    def summary(self) -> str:
        """The number of picks with each change, and the change of the time."""
        counts = ", ".join(f"{number} {change}" for change, number in self.counts.items() if number)
        before, after = self.seconds
        share = f" ({(after - before) / before:+.1%})" if before else ""
        both = sum(pick.gained is not None for pick in self.differences)
        return f"{counts}; {both} good in both take {before:.3f} s before and {after:.3f} s after{share}"

    def _table(self) -> Rows:
        rows = (
            (pick.name, pick.change.value, *("" if s is None else f"{s:.3f}" for s in pick.seconds), pick.reason)
            for pick in self.differences
        )
        return Rows(("pick", "change", "before [s]", "after [s]", "reason"), rows, len(self.differences))

    def _view(self) -> View:
        lines = (f"{pick.name}: {pick.change.value}" for pick in self.differences)
        return View(self.summary, [self._table()], lines, len(self.differences))

    def _write_page(self, path: str | Path) -> None:
        """Write both reports side by side, with one slider, one camera and one table; errors as for a report."""
        with TemporaryDirectory() as folder:
            texts = []
            for report in (self.before, self.after):
                report.save(Path(folder) / "page.html")
                texts.append((Path(folder) / "page.html").read_text(encoding="utf-8"))
        # What both pages contain is stored once
        blocks = re.findall(r"<script[^>]*>(.*?)</script>", texts[0], re.DOTALL)
        shared = {SHARED % k: block for k, block in enumerate(blocks) if len(block) >= LEAST and block in texts[1]}
        for mark, block in shared.items():
            texts = [text.replace(block, mark, 1) for text in texts]
        content = {
            "names": [pick.name for pick in self.differences],
            "shared": shared,
            "titles": ("Before", "After"),
            "pages": texts,
        }
        title = f"Comparison of {self.before.robot}"
        write_comparison_page(path, title, self.summary, self._table().html(sys.maxsize), content)

    def to_csv(self) -> str:
        """One row for each pick."""
        columns = ("name", "change", "seconds_before", "seconds_after", "verdict_before", "verdict_after", "reason")
        rows = (
            (pick.name, pick.change.value, *map(figure, pick.seconds), *pick.verdicts, pick.reason)
            for pick in self.differences
        )
        return csv_text(columns, rows)


def compare(before: PickReport, after: PickReport, *, least: float = 0.01) -> CellComparison:
    """Compare the reports on the same picks in two set-ups, such as two placements, tools, scenes or robots.

    Parameters
    ----------
    before, after
        Reports of :func:`pinproof.validate_picks`, or of a placement (:attr:`CertifiedPlacement.report`).
    least
        Seconds: the smallest difference that counts as faster or slower.

    Raises
    ------
    InputError
        If a report is incomplete.
    UnknownNameError
        If one report has a pick that the other does not have.
    """
    require_positive("least", least, zero=True)
    for when, report in (("before", before), ("after", after)):
        if report.not_judged:
            raise InputError(f"the report {when} was interrupted: {report.not_judged} picks have no verdict")
    verdicts = [{verdict.pick.name: verdict for verdict in report.verdicts} for report in (before, after)]
    for own, others, when in ((verdicts[0], verdicts[1], "after"), (verdicts[1], verdicts[0], "before")):
        for name in own:
            if name not in others:
                raise UnknownNameError("pick", name, others, f"the report {when} the change")
    # good in both, in one or in none
    differences = []
    for verdict in before.verdicts:
        difference = PickDifference(PickChange.FAILING, verdict, verdicts[1][verdict.pick.name])
        gained = difference.gained
        if gained is None:
            if verdict.ok is not difference.after.ok:
                difference = replace(difference, change=PickChange.LOST if verdict.ok else PickChange.WON)
        elif abs(gained) < least:
            difference = replace(difference, change=PickChange.SAME)
        else:
            difference = replace(difference, change=PickChange.FASTER if gained > 0 else PickChange.SLOWER)
        differences.append(difference)
    return CellComparison(before, after, tuple(differences), least)
