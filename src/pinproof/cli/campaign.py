"""``pinproof pick --campaign``: very many picks, with a progress bar; interrupted, it can be gone on with."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

import pinproof as pp
from pinproof.cli.console import Stopped, print_json, remark, say
from pinproof.cli.workers import chosen_workers

__all__ = ["run_campaign"]


class _Rate(ProgressColumn):
    """Picks a second."""

    def render(self, task: Task) -> Text:
        return Text("" if task.speed is None else f"{task.speed:,.1f}/s")


def run_campaign(
    campaign: pp.Campaign, folder: Path, workers: int | None, dask: str | None, *, as_json: bool
) -> pp.CampaignResult:
    """Run it and tell how it went; an interrupted one ends with the exit code that says so."""
    console = Console(stderr=True)
    columns = (
        TextColumn("picks"),
        BarColumn(),
        MofNCompleteColumn(),
        _Rate(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    try:
        with (
            chosen_workers(workers, dask) as where,
            Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar,
        ):
            line = bar.add_task("picks", total=len(campaign), start=False)

            def progress(done: int, total: int) -> None:
                if not bar.tasks[line].started:
                    if done:
                        remark(f"going on: {done:,} of {total:,} picks were judged before")
                    bar.start_task(line)
                bar.update(line, completed=done)

            result = campaign.run(folder, progress=progress, **where)
    except KeyboardInterrupt:
        from pinproof.picks.campaign.journal import rows_there

        # Counted, not remembered: it may have come between a row and its being counted.
        there = f"after {rows_there(folder):,} of {len(campaign):,} picks"
        raise Stopped(f"interrupted {there}; the same command goes on there") from None
    if as_json:
        print_json(result.to_dict())
    else:
        say(result.summary)
        if result.damaged:
            say(f"{result.damaged:,} damaged or edited rows were judged again")
        if result.to_retry:
            say(f"{result.to_retry:,} picks crashed with their workers; the same command judges them once more")
        for note in result.notes:
            say(f"not covered: {note}")
        say(f"wrote {result.path}")
    return result
