"""``pinproof demo``: check the picks of a UR5 example and write the first good motion."""

from __future__ import annotations

from pathlib import Path

import typer

import pinproof as pp
from pinproof.cli.console import (
    check_output_files,
    print_error,
    print_json,
    print_line,
    print_note,
    print_report,
    progress_status,
    until_interrupted,
    write_pages,
    written,
)
from pinproof.cli.options import Json, Seed, option
from pinproof.cli.pick import judge_file


def demo(
    html: Path = option("The HTML page to write.", Path("pick.html")),
    output: Path = option(
        "The motion file to write: .json with the structure of trajectory_msgs/JointTrajectory, or .csv.",
        Path("pick.json"),
        "-o",
        "--output",
    ),
    live: bool = option("Also open the motion in a browser; Ctrl-C ends it.", False),
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Check seven bolt picks of a UR5, then write the first good motion and an HTML page that shows it.

    Example: pinproof demo --html pick.html
    """
    from pinproof.description import robots_folder

    check_output_files([html, output])
    with progress_status("checking the picks of robots/ur5/picks.yaml"):
        arm, _, _, report = judge_file(robots_folder() / "ur5" / "picks.yaml", seed=seed)
    if not as_json:
        print_report(report)
    if not report.good:
        if as_json:
            print_json({**report.to_dict(), "written": []})
        print_error("no pick is good, so no motion is written")
        raise typer.Exit(1)
    first = report.good[0]
    with progress_status("writing the page"):
        first.save_motion(output)
        files = [*write_pages(first, arm, html), output]
    if as_json:
        print_json({**report.to_dict(), "written": [str(path) for path in files]})
    else:
        for motion in first.motions:
            print_line(f"{first.pick.name}: {motion.certificate}")
        print_line(f"{written(*files)[0]}; open {html} in a browser (no network needed)")
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
            until_interrupted(),
        ):
            (print_note if as_json else print_line)(f"live view at {view.url} (Ctrl-C ends it)")
            view.wait()
