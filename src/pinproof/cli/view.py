"""``pinproof view``: show a robot, a configuration or a motion."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pinproof as pp
from pinproof.cli.console import (
    check_output_files,
    print_error,
    print_result,
    progress_status,
    until_interrupted,
    written,
)
from pinproof.cli.options import (
    Configuration,
    Html,
    IgnoreRecord,
    Json,
    Robot,
    SetupOptions,
    argument,
    load_motion,
    note_limits,
    option,
    parse_configuration,
)
from pinproof.errors import InputError, MeshError


@dataclass(frozen=True)
class PngOptions:
    """Options of the PNG picture."""

    png: Path | None = option("Write a picture (PNG). Requires a Chromium-based browser.", None)
    time: float | None = option("Time of the motion that --png shows, in seconds.", None)
    size: str = option("Size of --png in pixels.", "1280x800", metavar="WIDTHxHEIGHT")


def view(
    robot: Robot,
    motion: Path | None = argument("A motion file to play (.json, .csv, .yaml or .yml).", None, metavar="MOTION"),
    q: Configuration = None,
    branches: bool = option("Also show all other IK solutions for the tcp pose of --q, transparent.", False),
    layer: list[str] | None = option(
        "A layer to show at first: collision, frames or sweep; can be given several times.", None, metavar="LAYER"
    ),
    html: Html = None,
    port: int = option("Port of the live view on 127.0.0.1; 0 selects a free port.", 0, min=0),
    browser: bool = option("Open the live view in the browser.", True),
    ignore_record: IgnoreRecord = False,
    *,
    png_options: PngOptions,
    setup: SetupOptions,
    as_json: Json = False,
) -> None:
    """Show a robot or a motion in the browser (Ctrl-C ends it), as an HTML page (--html) or as a picture (--png).

    A motion is certified first, and the page shows the result. With --q, --scene, --tool-of or --attached, the
    configuration is checked for collisions, and contacts are marked.

    Example: pinproof view ur5 --html ur5.html
    """
    check_output_files([html, png_options.png], [robot, motion, *setup.files])
    match = re.fullmatch(r"(\d{1,6})[xX](\d{1,6})", png_options.size.strip())
    if match is None:
        raise InputError(f"--size must be WIDTHxHEIGHT in pixels, such as 1280x800, not {png_options.size!r}")
    size = int(match[1]), int(match[2])
    if png_options.time is not None and png_options.png is None:
        raise InputError("--time needs --png; add --png FILE")
    if motion is not None and (q is not None or branches):
        option = "--branches" if q is None else "--q"
        raise InputError(f"{option} cannot be combined with the motion {motion}; remove one of them")
    arm, world = setup.arm(robot), setup.world()
    content: dict[str, Any] = {"layers": tuple(layer or ()), "attached": setup.attachments.bodies}
    # A motion is certified; a configuration is checked if there is something to collide with.
    if motion is not None:
        checker = setup.checker(arm, world)
        content["trajectory"] = trajectory = load_motion(motion, checker, ignore_record)
        with progress_status("certifying"):
            content["certificate"] = pp.certify(trajectory, checker)
    else:
        content["q"] = configuration = parse_configuration(q, arm, "--q")
        note_limits(arm, configuration)
        if q is not None or setup.surrounds:
            try:
                content["check"] = setup.checker(arm, world).check(configuration)
            except MeshError as error:
                print_error(f"not checked for contacts: {error}")
        if branches:
            content["ghosts"] = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(configuration)).q
    if html is None and png_options.png is None:
        # Ctrl-C can arrive as soon as the URL is printed, so until_interrupted must be active before.
        with pp.show(arm, world, **content, port=port, open_browser=browser) as shown, until_interrupted():
            print_result({"url": shown.url}, [f"{shown.url} (Ctrl-C ends it)"], as_json=as_json)
            shown.wait()
        return
    with progress_status("writing"):
        if png_options.png is not None:  # first, because it fails without a browser: then no file is written
            pp.write_png(png_options.png, arm, world, **content, time=png_options.time, size=size)
        if html is not None:
            pp.write_html(html, arm, world, **content)
    files = {kind: str(path) for kind, path in (("page", html), ("picture", png_options.png)) if path is not None}
    print_result(files, written(*files.values()), as_json=as_json)
