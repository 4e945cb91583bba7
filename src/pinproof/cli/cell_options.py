"""Options that commands on files of picks and on files of tool paths share, and campaigns of both."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import pinproof as pp
from pinproof.cli.console import (
    Interrupted,
    check_output_files,
    check_report_output,
    print_note,
    print_result,
    progress_bar,
    written,
)
from pinproof.cli.options import Limits, Place, RobotFileOptions, option, placement
from pinproof.common.files import read_text
from pinproof.common.validation import optional_module
from pinproof.errors import CampaignError, FileError, InputError, RunInterrupted

if TYPE_CHECKING:
    from pinproof.picks import ItemCampaign, PickSource

CONNECT_SECONDS = 20
"""Time to wait for the Dask scheduler."""


@dataclass(frozen=True)
class CellOptions(RobotFileOptions):
    """Options that replace the robot and the scene of the picks file."""

    PANEL: ClassVar = "Robot and scene"

    robot: str | None = option(
        "A catalogue name, a robot file or a DH table. It replaces robot, srdf, package_dirs, xacro_args, "
        "calibration and limits of the picks file.",
        None,
        metavar="ROBOT",
    )
    limits: Limits = None
    tcp: str | None = option(
        "The tcp frame. Default: the tcp of the picks file, otherwise of the robot.", None, metavar="LINK"
    )
    scene: Path | None = option("The scene file (YAML). Default: the scene of the picks file.", None)
    place: Place = "0 0 0 0"

    @property
    def files(self) -> tuple[str | Path | None, ...]:
        """The input files."""
        return self.robot, self.srdf, self.calibration, self.limits, self.scene

    def open(self, file: Path) -> tuple[pp.Arm, pp.Scene, PickSource]:
        """The arm, the scene and the picks of a picks file."""
        # The picks are in the world; the arm needs them, and the scene, in the frame of its root.
        source = pp.picks.open_picks(file)
        world_from_root = placement(self.place)
        if not world_from_root.isIdentity():
            source = source.transformed(world_from_root.inverse())
        shared = self.replaced(source.shared)
        return shared.load_arm(), shared.load_scene().transformed(world_from_root.inverse()), source

    def open_job(self, file: Path) -> tuple[pp.Arm, pp.Scene, pp.tool_paths.ToolJob]:
        """The arm without its tool, the scene and the job of a file of tool paths."""
        job, root_from_world = pp.tool_paths.read_tool_paths(file), placement(self.place).inverse()
        settings = self.replaced(job.settings).transformed(root_from_world)
        strokes = job.strokes if job.frame else tuple(each.transformed(root_from_world) for each in job.strokes)
        job = replace(job, settings=settings, strokes=strokes)
        return settings.load_arm(), job.load_scene().transformed(root_from_world), job

    def replaced(self, shared: pp.Picks) -> pp.Picks:
        """The settings of a file with those of the command, which replace keys of the file, in their place."""
        # Errors then no longer name the lines of these keys
        if self.robot is not None:
            none: dict[str, Any] = {"srdf": None, "calibration": None, "limits": None, "visual_bodies": False}
            shared = replace(shared, robot=self.robot, package_dirs=(), xacro_args={}, **none)
        stated_here = {"robot": self.robot, "tcp": self.tcp, **{f"xacro_args.{name}": name for name in self.xacro_args}}
        return replace(
            shared,
            srdf=self.srdf or shared.srdf,
            package_dirs=tuple(self.package_dir or shared.package_dirs),
            xacro_args={**shared.xacro_args, **self.xacro_args},
            calibration=self.calibration or shared.calibration,
            visual_bodies=self.visual_bodies or shared.visual_bodies,
            limits=self.limits or shared.limits,
            tcp=self.tcp or shared.tcp,
            scene=self.scene or shared.scene,
            places={key: place for key, place in shared.places.items() if not stated_here.get(key)},
        )


@dataclass(frozen=True)
class ExportOptions:
    """Options for the files of the results."""

    PANEL: ClassVar = "Output"

    output: Path | None = option("A report, or a folder.", None, "-o", "--output", metavar="FILE|FOLDER")
    export: str | None = option(
        "Also write robot programs to the folder of -o: urscript, rapid, krl or fanuc.", None, metavar="LANGUAGE"
    )
    export_deviation: float | None = option(
        "For --export: assumed deviation of each joint from the moves of the program (rad). Default: 0.002.",
        None,
        min=0.0,
    )

    def check_outputs(
        self, suffixes: Iterable[str], inputs: Iterable[str | Path | None], name: str, signal: str | None
    ) -> bool:
        """Refuse outputs that cannot be written and a wrong digital output, before the work starts.

        ``signal`` is the value of the option ``name`` for a digital output. Return whether the output is a folder.
        """
        for stated, value in ((name, signal), ("--export-deviation", self.export_deviation)):
            if value is not None and self.export is None:
                raise InputError(f"{stated} needs --export")
        if signal is not None and self.export is not None:
            pp.motion.find_dialect(self.export).checked_signal(name, signal, "output")
        if self.export is not None and not has_folder(self.output, suffixes):
            raise InputError("--export belongs to -o with a folder; add -o FOLDER")
        is_folder = self.output is not None and check_report_output(self.output, tuple(suffixes))
        if not is_folder:
            check_output_files([self.output], inputs)
        return is_folder


def has_folder(output: Path | None, suffixes: Iterable[str]) -> bool:
    """Whether an output is a folder: it exists as one, or its name has none of the suffixes of reports."""
    return output is not None and (output.is_dir() or output.suffix.lower() not in suffixes)


@dataclass(frozen=True)
class WorkerOptions:
    """Options for the processes that check picks."""

    PANEL: ClassVar = "Parallel work"

    workers: int | None = option("Number of parallel processes.", None, min=1)
    dask: str | None = option("Use the Dask cluster of this scheduler.", None, metavar="tcp://HOST:PORT")

    @property
    def stated(self) -> bool:
        """Whether an option is used."""
        return self.workers is not None or self.dask is not None

    @contextmanager
    def settings(self) -> Iterator[dict[str, Any]]:
        """The options as settings of :class:`pinproof.Campaign` and :func:`pinproof.validate_picks`.

        InputError if both options are given, or Dask is not installed; CampaignError if the scheduler does not answer.
        """
        # Local processes, or the threads of a cluster
        if self.dask is None:
            yield {} if self.workers is None else {"workers": self.workers}
            return
        if self.workers is not None:
            raise InputError("--workers and --dask cannot be combined; remove one of them")
        distributed = optional_module("distributed", "--dask", "dask")
        try:
            client = distributed.Client(self.dask, timeout=CONNECT_SECONDS, set_as_default=False)
        except (OSError, ValueError) as error:
            raise CampaignError(f"no Dask scheduler answers at {self.dask}: {error}") from error
        with client:
            threads = sum(client.nthreads().values())
            # Two chunks for each thread keep all threads busy; more workers may join later.
            yield {"executor": client.get_executor(), "in_flight": max(2 * threads, 16)}


def states_paths(file: Path) -> bool:
    """Whether a file is a job of tool paths, which has the key ``strokes`` or one like it, and not one of picks."""
    try:
        text = read_text(file, FileError) if file.suffix.lower() in (".yaml", ".yml", ".json") else ""
    except FileError:  # the reader of the file states what is wrong
        return False
    # The keys at the start of lines, or else, as in JSON, all keys
    keys = re.findall(r"""^["']?(\w+)["']?\s*:""", text, re.MULTILINE)
    keys = keys or re.findall(r"""(?:^|[{,])\s*["']?(\w+)["']?\s*:""", text, re.MULTILINE)
    return "strokes" in keys or ("picks" not in keys and bool(get_close_matches("strokes", map(str.lower, keys))))


def run_campaign(
    campaign: ItemCampaign,
    folder: Path,
    pool: WorkerOptions,
    page: Path | None = None,
    *,
    live: bool | None = None,
    as_json: bool,
) -> None:
    """Run a campaign with a progress bar, print its summary, and write its page; exit code 1 unless all are good.

    Interrupted after Ctrl-C.
    """
    try:
        with pool.settings() as settings, progress_bar(f"campaign {folder}") as show:
            started = False

            def progress(done: int, total: int) -> None:
                nonlocal started
                if not started and done:
                    print_note(f"resuming: {done:,} of {total:,} {campaign.items} are already checked")
                started = True
                show(campaign.items, done, total)

            result = campaign.run(folder, progress=progress, **settings)
    except RunInterrupted as error:
        raise Interrupted(f"{error}; run the same command again to resume") from None
    lines = [result.summary]
    if result.damaged:
        lines.append(f"{result.damaged:,} damaged or edited rows were computed again")
    if result.to_retry:
        lines.append(
            f"{result.to_retry:,} {campaign.items} crashed their workers; run the same command again to retry them"
        )
    if page is not None:
        campaign.write_page(result, page, live=live)
    lines += [*(f"not covered: {note}" for note in result.notes), *written(result.path, page)]
    print_result(result.to_dict(), lines, as_json=as_json, ok=result.ok)
