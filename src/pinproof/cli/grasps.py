"""``pinproof grasps``: propose grasps of a part from its shape."""

from __future__ import annotations

from dataclasses import MISSING, replace
from pathlib import Path

import pinproof as pp
from pinproof.cli.console import check_output_files, print_result, progress_status, written
from pinproof.cli.options import Html, Json, Seed, argument, option

SUFFIXES = (".yaml", ".yml", ".json", ".html")


def grasps(
    part: Path = argument("The mesh of the part (STL, OBJ, DAE, PLY, GLB or glTF).", MISSING, metavar="MESH"),
    *,
    tool: Path = option("The tool file: the hand, and the robot whose links are its fingers.", MISSING, metavar="FILE"),
    robot: str | None = option(
        "A catalogue name, or a robot file, whose links are the fingers. Default: the robot of the tool file.",
        None,
        metavar="ROBOT",
    ),
    tcp: str | None = option("The tcp frame. Default: the tcp of the tool file, otherwise of the robot.", None),
    count: int = option("The largest number of grasps.", 200, "-n", "--count", min=1),
    output: Path | None = option(
        "The grasps as .yaml, which a picks file states under `parts`, as .json, or as .html.",
        None,
        "-o",
        "--output",
        metavar="FILE",
    ),
    html: Html = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Propose grasps of a part for fingers, a cup or a plain tip, ranked by the force that they resist.

    Exit code 1 if no grasp is found.

    Example: pinproof grasps part.stl --tool gripper.yaml -o grasps.yaml --html grasps.html
    """
    check_output_files([output, html], [part, tool, robot], SUFFIXES)
    hand = pp.picks.Tool.load(tool)
    if robot is not None:
        hand = replace(hand, robot=robot, srdf=None, xacro_args={}, limits=None)
    if tcp is not None:
        hand = replace(hand, tcp=tcp)
    with progress_status(f"proposing grasps of {part}"):
        found = pp.picks.propose_grasps(part, hand, count=count, rng=seed)
        for path in filter(None, (output, html)):
            found.save(path)
    lines = [found.message, *(found.rows().text() if len(found) else ()), *written(output, html)]
    print_result(found.to_dict(), lines, as_json=as_json, ok=bool(len(found)))
