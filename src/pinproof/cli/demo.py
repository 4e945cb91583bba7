"""``pinproof demo``: the main job, end to end, on a robot that comes with the package."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from pinproof.cli.console import complain, print_report, say, working
from pinproof.cli.outputs import check_outputs, write_motion
from pinproof.cli.pick import judge_file
from pinproof.description import robots_folder
from pinproof.viewer import show

__all__ = ["demo"]


def demo(
    html: Annotated[Path, typer.Option(help="The page.")] = Path("pick.html"),
    json: Annotated[Path, typer.Option(help="The motion, shaped as trajectory_msgs/JointTrajectory.")] = Path(
        "pick.json"
    ),
    live: Annotated[bool, typer.Option("--live", help="Also open the live view; Ctrl-C ends it.")] = False,
    seed: Annotated[int, typer.Option(help="Seed of every random choice.", min=0)] = 0,
) -> None:
    """Give a UR5 bolts to pick: judge each, prove the first good one, show it in a page.

    Example: pinproof demo --html pick.html
    """
    check_outputs([html, json])
    with working("judging the picks of robots/ur5/picks.yaml"):
        arm, _, _, report = judge_file(robots_folder() / "ur5" / "picks.yaml", seed=seed)
    print_report(report)
    if not report.good:
        complain("no pick is good, so there is no motion to show")
        raise typer.Exit(1)
    first = report.good[0]
    with working("drawing the page"):
        written = write_motion(first, arm, html, json)
    for motion in first.motions:
        say(f"{first.pick.name}: {motion.certificate}")
    say(f"wrote {' and '.join(str(path) for path in written)}; open the page in a browser, it needs no network")
    if live:
        with show(
            arm,
            first.motions[0].scene,
            first.motions[0].trajectory,
            certificate=first.motions[0].certificate,
            attached=first.motions[0].attached,
            title=first.pick.name,
            open_browser=True,
        ) as view:
            say(f"live view at {view.url} (Ctrl-C ends it)")
            with suppress(KeyboardInterrupt):
                view.wait()
