"""Who judges: this process, several of this machine, or a Dask cluster.

``pinproof pick --screen``: which picks can be grasped at all, tens of thousands a second.

``pinproof pick --campaign``: very many picks, with a progress bar; interrupted, it can be gone on with.

``pinproof pick``: judge a picks file.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

import pinproof as pp
from pinproof.cli.compiling import compile_ahead
from pinproof.cli.console import (
    Stopped,
    check_outputs,
    file_stems,
    make_folder,
    print_json,
    print_report,
    remark,
    say,
    working,
    write_motion,
)
from pinproof.errors import CampaignError, InputError

if TYPE_CHECKING:
    from pinproof.picks import PickSource

__all__ = ["Dask", "WorkerCount", "chosen_workers", "judge_file", "pick", "run_campaign", "run_screen"]

WorkerCount = Annotated[int | None, typer.Option("--workers", help="Judge in so many processes.", min=1)]
Dask = Annotated[str | None, typer.Option(help="Judge on a Dask cluster: its scheduler.", metavar="tcp://HOST:PORT")]

CONNECT_SECONDS = 20
"""How long a scheduler has to answer."""


@contextmanager
def chosen_workers(workers: int | None, dask: str | None) -> Iterator[dict[str, Any]]:
    """What the options say, as settings of :class:`pinproof.Campaign` and :func:`pinproof.validate_picks`.

    Raises
    ------
    InputError
        If both are given, or Dask is not installed.
    CampaignError
        If no scheduler answers.
    """
    if dask is None:
        yield {} if workers is None else {"workers": workers}
        return
    if workers is not None:
        raise InputError("--workers counts processes of this machine, and --dask has its own; give one of them")
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError("--dask needs the extra 'dask': pip install 'pinproof[dask]'") from error
    try:
        client = Client(dask, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise CampaignError(f"no Dask scheduler answers at {dask}: {error}") from error
    with client:
        threads = sum(client.nthreads().values())
        # Two a thread, so that the next chunk is there when one is done; more workers may still come.
        yield {"executor": client.get_executor(), "in_flight": max(2 * threads, 16)}


def run_screen(
    arm: pp.Arm, scene: pp.Scene, source: PickSource, file: Path, output: Path | None, seed: int, *, as_json: bool
) -> pp.picks.ScreenResult:
    """Screen the picks of a file, tell how many there are of each status, and write the table that is asked for."""
    if output is not None:
        if output.suffix.lower() != ".csv":
            raise InputError(f"{output}: --screen writes a table (.csv), a row a pick")
        check_outputs([output], [file])
    begun = time.perf_counter()
    with Progress(console=Console(stderr=True), transient=True, disable=not Console(stderr=True).is_terminal) as bar:
        line = bar.add_task("screening", total=len(source))
        found = pp.screen_picks(
            arm, scene, source, rng=seed, clearance=output is not None,
            progress=lambda done, _: bar.update(line, completed=done),
        )  # fmt: skip
    seconds = time.perf_counter() - begun
    if output is not None:
        found.save(output)
    if as_json:
        counts = {status.value: count for status, count in found.counts.items()}
        print_json({"ok": bool(found.free.all()), "picks": len(found), "complete": found.complete, "counts": counts})
        return found
    say(found.summary)
    rate = len(found) / max(seconds, 1e-9)
    say(f"{seconds:.3g} s, {rate:,.0f} picks a second; the ways to and from the grasp are not judged")
    if output is not None:
        say(f"wrote {output}")
    return found


class _Rate(ProgressColumn):
    """Picks a second."""

    def render(self, task: Task) -> Text:
        return Text("" if task.speed is None else f"{task.speed:,.1f}/s")


def run_campaign(
    campaign: pp.Campaign, folder: Path, workers: int | None, dask: str | None, *, as_json: bool
) -> pp.picks.CampaignResult:
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
        from pinproof.picks.batch.journal import rows_there

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


PAGE = ".html"
KINDS = (".json", ".md", ".csv", PAGE)


def pick(
    file: Annotated[Path, typer.Argument(help="The picks (YAML, or a table: CSV).", metavar="PICKS")],
    robot: Annotated[str | None, typer.Option(help="A catalogue name or a URDF; by default the file's.")] = None,
    tcp: Annotated[str | None, typer.Option(help="The tcp frame; by default the file's, else the robot's.")] = None,
    scene: Annotated[Path | None, typer.Option(help="The scene (YAML); by default the file's.")] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="A report (.json, .md, .csv, .html), or a folder for all of them and the good motions.",
        ),
    ] = None,
    campaign: Annotated[
        Path | None,
        typer.Option(help="For very many picks: stream rows to this folder, or go on with what was begun there."),
    ] = None,
    screen: Annotated[
        bool, typer.Option("--screen", help="Judge the grasp alone: reach, limits, contact; -o writes a table (.csv).")
    ] = False,
    workers: WorkerCount = None,
    dask: Dask = None,
    seed: Annotated[int, typer.Option(help="Seed of every random choice.", min=0)] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Judge every pick of a file: reach, limits, grasp, grip, approach, retreat, transit, motion.

    Exit code 0 if all are good, 1 if one is not.

    Example: pinproof pick robots/ur5/picks.yaml -o report.json
    """
    if screen:
        if campaign is not None or workers is not None or dask is not None:
            raise InputError("--screen needs no workers and leaves no campaign; leave one of them out")
        arm, world, source = _read(pp.picks.open_picks(file), file, robot, tcp, scene)
        if not run_screen(arm, world, source, file, output, seed, as_json=as_json).free.all():
            raise typer.Exit(1)
        return
    if campaign is not None:
        if output is not None:
            if output.suffix.lower() != PAGE:
                raise InputError("--campaign writes rows to its folder as they come; -o adds a page of them (.html)")
            _check_output(output)
        arm, world, source = _read(pp.picks.open_picks(file), file, robot, tcp, scene)
        if dask is None:
            compile_ahead()
        result = run_campaign(pp.Campaign(arm, world, source, rng=seed), campaign, workers, dask, as_json=as_json)
        if output is not None:
            result.save(output)
            if not as_json:
                say(f"wrote {output}")
        if not result.ok:
            raise typer.Exit(1)
        return
    if output is not None:
        _check_output(output)
    with working(f"judging {file}"), chosen_workers(workers, dask) as where:
        arm, _, _, report = judge_file(file, robot, tcp, scene, seed, **where)
    if as_json:
        print_json(report.to_dict())
    else:
        print_report(report)
    if output is not None:
        written = _write(output, arm, report)
        if not as_json:
            say(f"wrote {', '.join(str(path) for path in written)}")
    if not report.ok:
        raise typer.Exit(1)


def judge_file(
    file: Path,
    robot: str | None = None,
    tcp: str | None = None,
    scene: Path | None = None,
    seed: int = 0,
    **where: Any,
) -> tuple[pp.Arm, pp.Scene, pp.Picks, pp.PickReport]:
    """The arm, the scene, the picks and the report of a picks file; what is given goes before what the file names."""
    arm, world, source = _read(pp.picks.open_picks(file), file, robot, tcp, scene)
    picks = source.load()
    compile_ahead()
    return arm, world, picks, pp.validate_picks(arm, world, picks, rng=seed, **where)


def _read(
    source: PickSource, file: Path, robot: str | None, tcp: str | None, scene: Path | None
) -> tuple[pp.Arm, pp.Scene, PickSource]:
    named = source.shared
    name = robot or named.robot
    if name is None:
        raise InputError(f"{file} names no robot; add 'robot: ur5' to it or give --robot")
    arm = pp.load_robot(name).arm(tcp or named.tcp, held=named.held)
    place = scene or named.scene
    return arm, pp.Scene() if place is None else pp.Scene.load(place), source


def _is_folder(output: Path) -> bool:
    return output.is_dir() or output.suffix.lower() not in KINDS


def _check_output(output: Path) -> None:
    """Refuse a place that cannot be written to before the work, not after it."""
    if _is_folder(output):
        if output.suffix and not output.is_dir():
            raise InputError(f"{output}: a report ends in {', '.join(KINDS)}; for a folder, give one that exists")
        make_folder(output)
    elif not output.parent.is_dir():
        raise InputError(f"{output}: there is no folder {output.parent}")


def _write(output: Path, arm: pp.Arm, report: pp.PickReport) -> list[Path]:
    written = [output] if not _is_folder(output) else [output / f"report{kind}" for kind in KINDS]
    for path in written:
        report.save(path)
    if _is_folder(output):
        for verdict, stem in zip(report.good, file_stems(v.pick.name for v in report.good), strict=True):
            written += write_motion(verdict, arm, output / f"{stem}.html", output / f"{stem}.json")
    return written
