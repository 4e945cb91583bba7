"""``pinproof view``: a robot, a configuration or a motion to look at."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import pinproof as pp
from pinproof.cli.complete import robot_names
from pinproof.cli.console import check_outputs, complain, print_json, say, until_stopped, working
from pinproof.cli.options import (
    Carried,
    Chain,
    Configuration,
    Html,
    IgnoreRecord,
    Json,
    Surroundings,
    held_by,
    load_motion,
    parse_configuration,
)
from pinproof.errors import InputError, MeshError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from pinproof.collision import CheckResult

__all__ = ["view"]

TABLES = (".yaml", ".yml", ".csv")
"""Endings of DH tables; a robot file has another."""


@dataclass(frozen=True)
class Still:
    """A picture as a file."""

    png: Annotated[Path | None, typer.Option("--png", help="Write a still picture, drawn by a browser.")] = None
    time: Annotated[float | None, typer.Option(help="Seconds into the motion, for --png.")] = None
    size: Annotated[str, typer.Option(help="Pixels, for --png.", metavar="WIDTHxHEIGHT")] = "1280x800"

    def pixels(self) -> tuple[int, int]:
        """Width and height.

        Raises
        ------
        InputError
            If the size is no size, or a time is told without a picture.
        """
        found = re.fullmatch(r"(\d{1,6})[xX](\d{1,6})", self.size.strip())
        if found is None:
            raise InputError(f"--size is WIDTHxHEIGHT in pixels, such as 1280x800, not {self.size!r}")
        if self.time is not None and self.png is None:
            raise InputError("--time says when the picture of --png is taken, and there is none")
        return int(found[1]), int(found[2])


def view(
    robot: Annotated[
        str,
        typer.Argument(
            help="A catalogue name such as ur5, a robot file, or a DH table (.yaml, .csv).",
            metavar="ROBOT",
            autocompletion=robot_names,
        ),
    ],
    q: Configuration = None,
    motion: Annotated[Path | None, typer.Option(help="A motion (.json, .csv) to play.")] = None,
    branches: Annotated[
        bool, typer.Option("--branches", help="Also show, as ghosts, every other way to hold the tool as at --q.")
    ] = False,
    layer: Annotated[
        list[str] | None, typer.Option(help="Show from the start: collision, frames or sweep; repeatable.")
    ] = None,
    html: Html = None,
    port: Annotated[int, typer.Option(help="Port of the live view on 127.0.0.1; 0 takes a free one.", min=0)] = 0,
    browser: Annotated[bool, typer.Option(help="Open the live view in the browser.")] = True,
    ignore_record: IgnoreRecord = False,
    *,
    still: Still,
    chain: Chain,
    around: Surroundings,
    carried: Carried,
    as_json: Json = False,
) -> None:
    """Show a robot, still or in motion: live in the browser (Ctrl-C ends it), as a page (--html), as a picture (--png).

    A motion is certified for its caption. A configuration that is given by --q, or shown with --scene, --tool-of or
    --attached, is checked, and contacts are marked.

    Example: pinproof view ur5 --html ur5.html
    """
    check_outputs([html, still.png], [robot, motion, around.scene, chain.srdf, *carried.files])
    size = still.pixels()
    if motion is not None and (q is not None or branches):
        raise InputError(f"{'--branches' if q is None else '--q'} is of a still picture; --motion moves the arm")
    arm, world = _arm(robot, chain, carried), around.load()
    what: dict[str, Any] = {"layers": tuple(layer or ()), "attached": carried.attachments.bodies}
    if motion is not None:
        checker = around.checker(arm, world, carried)
        what["trajectory"] = trajectory = load_motion(motion, checker, ignore_record)
        with working("proving"):
            what["certificate"] = pp.certify(trajectory, checker)
    else:
        asked = q is not None or around.scene is not None or any(carried.files)
        what["q"] = held = parse_configuration(q, arm, "--q")
        what["check"] = _checked(arm, world, held, around, carried) if asked else None
        what["ghosts"] = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(held)).q if branches else None
    if html is None and still.png is None:
        # until_stopped from the first word on: who reads it may stop the view at once
        with pp.show(arm, world, **what, port=port, open_browser=browser) as shown, until_stopped():
            print_json({"url": shown.url}) if as_json else say(f"{shown.url} (Ctrl-C ends it)")
            shown.wait()
        return
    with working("drawing"):
        if still.png is not None:  # first, as it may fail for want of a browser: then nothing is written
            pp.write_png(still.png, arm, world, **what, time=still.time, size=size)
        if html is not None:
            pp.write_html(html, arm, world, **what)
    written = {kind: str(path) for kind, path in (("page", html), ("picture", still.png)) if path is not None}
    print_json(written) if as_json else say(f"wrote {' and '.join(written.values())}")


def _arm(robot: str, chain: Chain, carried: Carried) -> pp.Arm:
    if Path(robot).suffix not in TABLES:
        return chain.arm(robot, carried=carried)
    from pinproof.model import load_robot_from_text

    if chain.group is not None or chain.srdf is not None:
        raise InputError("--group and --srdf are of a robot file; a DH table is one chain")
    text = pp.dh_to_urdf(pp.DhTable.load(robot))
    return held_by(load_robot_from_text(text, name=robot).arm(chain.tcp, base=chain.base), carried, carried.picks.tcp)


def _checked(
    arm: pp.Arm, world: pp.Scene, q: npt.NDArray[np.float64], around: Surroundings, carried: Carried
) -> CheckResult | None:
    """What touches at q; None, said on stderr, where a body cannot be loaded: a robot can be looked at all the same."""
    try:
        return around.checker(arm, world, carried).check(q)
    except MeshError as error:
        complain(f"not checked for contacts: {error}")
        return None
