"""``pinproof demo``: the main job, end to end, on a robot that comes with the package."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import pinproof as pp
from pinproof.cli.console import (
    check_outputs,
    complain,
    print_json,
    print_report,
    remark,
    say,
    until_stopped,
    working,
    write_motion,
)
from pinproof.cli.options import Json, Seed
from pinproof.cli.pick import judge_file

__all__ = ["demo"]


def demo(
    html: Annotated[Path, typer.Option(help="The page.")] = Path("pick.html"),
    output: Annotated[
        Path,
        typer.Option("-o", "--output", help="The motion (.json, shaped as trajectory_msgs/JointTrajectory; or .csv)."),
    ] = Path("pick.json"),
    live: Annotated[bool, typer.Option("--live", help="Also open the live view; Ctrl-C ends it.")] = False,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Give a UR5 bolts to pick: judge each, prove the first good one, show it in a page.

    Example: pinproof demo --html pick.html
    """
    from pinproof.description import robots_folder

    check_outputs([html, output])
    with working("judging the picks of robots/ur5/picks.yaml"):
        arm, _, _, report = judge_file(robots_folder() / "ur5" / "picks.yaml", seed=seed)
    if not as_json:
        print_report(report)
    if not report.good:
        if as_json:
            print_json({**report.to_dict(), "written": []})
        complain("no pick is good, so there is no motion to show")
        raise typer.Exit(1)
    first = report.good[0]
    with working("drawing the page"):
        written = write_motion(first, arm, html, output)
    if as_json:
        print_json({**report.to_dict(), "written": [str(path) for path in written]})
    else:
        for motion in first.motions:
            say(f"{first.pick.name}: {motion.certificate}")
        say(f"wrote {' and '.join(map(str, written))}; open the page in a browser, it needs no network")
    if live:
        shown = first.motions[0]
        with (
            pp.show(
                arm.with_held(shown.held),
                shown.scene,
                shown.trajectory,
                certificate=shown.certificate,
                attached=shown.attached,
                title=first.pick.name,
                open_browser=True,
            ) as view,
            until_stopped(),
        ):
            (remark if as_json else say)(f"live view at {view.url} (Ctrl-C ends it)")
            view.wait()
