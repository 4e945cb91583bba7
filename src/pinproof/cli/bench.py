"""``pinproof bench``: benchmark tables, measured on this machine."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from pinproof.cli.complete import planner_names, robot_names
from pinproof.cli.console import make_folder, print_result, progress_status, written
from pinproof.cli.options import Json, Seed, argument, option
from pinproof.errors import InputError

Peers = Annotated[bool, typer.Option("--peers/--no-peers", help="Include other installed libraries.")]
Folder = Annotated[
    Path | None,
    typer.Option("-o", "--output", help="Folder for the table (JSON, Markdown) and its plots.", metavar="FOLDER"),
]


def bench_ik(
    robots: list[str] | None = argument(
        "Catalogue names or robot files. Default: ur5.", None, metavar="ROBOT...", autocompletion=robot_names
    ),
    points: int = option("Targets per part of the table.", 10_000, min=1),
    methods: str | None = option(
        'Methods to run, for example "clik pseudo_inverse". Default: all.', None, metavar="METHODS"
    ),
    peers: Peers = True,
    limits_pi: bool = option("Reduce joint ranges wider than one rotation to +-pi.", True, "--limits-pi/--own-limits"),
    output: Folder = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Compare IK methods on the same targets: time, success rate, largest error.

    Example: pinproof bench ik ur5 --points 20 --no-peers
    """
    from pinproof.benchmarks import ik_benchmark, ik_markdown, write_ik_table

    if output is not None:
        make_folder(output)
    with progress_status("running the IK benchmark") as report:
        table = ik_benchmark(
            robots or ["ur5"],
            points=points,
            methods=None if methods is None else methods.replace(",", " ").split(),
            peers=peers,
            limits_pi=limits_pi,
            seed=seed,
            on_progress=report,
        )
    files = [] if output is None else write_ik_table(table, output)
    print_result(table.to_dict(), [ik_markdown(table), *written(*files)], as_json=as_json)


@dataclass(frozen=True)
class ProblemOptions:
    """The planning problems."""

    mbm: Path | None = option("Folder of MotionBenchMaker problems to run as well.", None, metavar="FOLDER")
    robot: str | None = option(
        "Catalogue name or robot file for the MotionBenchMaker problems. Default: the URDF in a folder "
        "'robot' beside them, otherwise the robot that they name.",
        None,
        metavar="ROBOT",
    )
    sets: list[str] | None = option(
        "Run only this set, such as ur5/shelf, shelf, ur5 or mbm; can be given several times.",
        None,
        "--set",
        metavar="NAME",
    )
    problems: int | None = option(
        "Problems per set. Default: all of MotionBenchMaker, 10 per scene of pinproof.", None, min=1
    )


def bench_plan(
    robots: list[str] | None = argument(
        "Catalogue names or robot files for the scenes of pinproof. Default: ur5, panda, generic_6dof.",
        None,
        metavar="ROBOT...",
        autocompletion=robot_names,
    ),
    *,
    given: ProblemOptions,
    planners: list[str] | None = option(
        "The planner of pinproof: rrt_connect (default) or ompl; can be given several times.",
        None,
        "--planner",
        metavar="PLANNER",
        autocompletion=planner_names,
    ),
    motion: bool = option(
        "Measure the durations of optimised motions to the goal poses of the problems of --mbm.", False
    ),
    repeats: int = option("Runs per problem; the fastest counts.", 1, min=1),
    peers: Peers = True,
    output: Folder = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Compare planners on the same problems: solved, certified, unsafe, time of each step, length.

    The scenes of pinproof are a table top, a shelf, bins, a cage and a narrow slot. Every motion is checked
    independently of its certificate; exit code 1 if this check finds a fault in a motion planned by pinproof.

    Example: pinproof bench plan ur5 --set shelf --problems 1 --no-peers
    """
    from pinproof.benchmarks import plan_benchmark, plan_markdown, write_plan_table
    from pinproof.benchmarks.plan_problems import OWN_ROBOTS
    from pinproof.planning import DEFAULT_PLANNER

    if output is not None:
        make_folder(output)
    if motion:
        _bench_motion(given, output, seed, as_json)
        return
    with progress_status("running the planning benchmark") as report:
        table = plan_benchmark(
            OWN_ROBOTS if robots is None else robots,
            mbm=given.mbm,
            robot=given.robot,
            sets=given.sets or (),
            problems=given.problems,
            planners=planners or (DEFAULT_PLANNER,),
            repeats=repeats,
            peers=peers,
            seed=seed,
            on_progress=report,
        )
    files = [] if output is None else write_plan_table(table, output)
    print_result(table.to_dict(), [plan_markdown(table), *written(*files)], as_json=as_json, ok=not table.unsafe)


def _bench_motion(given: ProblemOptions, output: Path | None, seed: int, as_json: bool) -> None:
    from pinproof.benchmarks import motion_benchmark, motion_markdown

    if given.mbm is None:
        raise InputError("--motion needs problems with goal poses; give their folder with --mbm")
    with progress_status("running the motion benchmark") as report:
        table = motion_benchmark(
            given.mbm,
            robot=given.robot,
            sets=given.sets or [],
            problems=given.problems,
            seed=seed,
            on_progress=report,
        )
    page = motion_markdown(table)
    files = [] if output is None else table.write(output, "motion", page)
    print_result(table.to_dict(), [page, *written(*files)], as_json=as_json, ok=not table.unsafe)
