"""``pinproof reach``: which share of orientations an arm reaches, free of contact, all over a region."""

from __future__ import annotations

import math
from dataclasses import replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.progress import Progress

import pinproof as pp
from pinproof.cli.console import check_outputs, print_json, remark, say
from pinproof.cli.options import Carried, Chain, Json, Robot, Seed, Surroundings, numbers
from pinproof.errors import InputError

if TYPE_CHECKING:
    from pinproof.spatial import SE3

__all__ = ["reach"]

SUFFIXES = (".csv", ".npz", ".png", ".html")

POINT_SHARE, LARGEST_POINT = 0.4, 0.04
"""How large points are drawn: of the distance between them, and in metres at most."""


class Orientations(str, Enum):
    """The sets of orientations that have a name."""

    DOWN = "down"
    CONE = "cone"
    ALL = "all"


def reach(
    robot: Robot,
    region: Annotated[str, typer.Option(help='Metres, from and to: "x0 x1 y0 y1 z0 z1"; equal ends make a surface.')],
    step: Annotated[float, typer.Option(help="Largest distance (m) between neighbouring points.")] = 0.1,
    orientations: Annotated[
        Orientations, typer.Option(help="Of the tool's z: straight down, in a cone about that, or all.")
    ] = Orientations.DOWN,
    angle: Annotated[float, typer.Option(help="Half the angle of the cone, in degrees.", min=0.0, max=180.0)] = 30.0,
    directions: Annotated[int, typer.Option(help="Directions in the cone, or all round.", min=1)] = 12,
    spins: Annotated[int, typer.Option(help="Turns about each direction.", min=1)] = 8,
    tip: Annotated[
        str | None, typer.Option(help='Where on the tcp the tool\'s tip is, in metres: "0 0 0.1"; a point, not a body.')
    ] = None,
    place: Annotated[
        str, typer.Option(help='Where the robot stands among scene and region: "x y z", and a turn about z (rad).')
    ] = "0 0 0 0",
    output: Annotated[
        list[Path] | None,
        typer.Option("-o", "--output", help="The map: .csv, .npz, .png (slices), .html; repeatable."),
    ] = None,
    against: Annotated[
        Path | None,
        typer.Option(
            help="A map (.npz) of another set-up: say, and show in what -o writes but .npz, what was won and lost."
        ),
    ] = None,
    threads: Annotated[int, typer.Option(help="Threads that share the work.", min=1)] = 1,
    seed: Seed = 0,
    *,
    chain: Chain,
    around: Surroundings,
    carried: Carried,
    as_json: Json = False,
) -> None:
    """Say where an arm can be used: at each point, the share of orientations it reaches free of contact.

    Exit code 1 if it reaches none at all.

    Example: pinproof reach ur5 --region "-0.6 0.6 -0.6 0.6 0.1 0.1" --step 0.2 -o reach.csv
    """
    outputs = output or []
    for path in outputs:
        if path.suffix.lower() not in SUFFIXES:
            raise InputError(f"{path}: a reach map is written as {', '.join(SUFFIXES)}")
    check_outputs(outputs, [robot, around.scene, chain.srdf, against, *carried.files])
    before = None if against is None else pp.ReachMap.load(against)
    grid = _region(region, step)
    stands = _place(place)
    arm = chain.arm(robot, carried=carried)
    world = around.load()
    # the scene as the robot sees it from where it stands
    seen = replace(world, obstacles=tuple(replace(o, pose=stands.actInv(o.pose)) for o in world.obstacles))
    checker = around.checker(arm, seen, carried)
    for k, measured in checker.still.touching:
        remark(f"nothing can be free: {checker.contact(k, measured)}, whatever the arm does")
    half = {Orientations.DOWN: 0.0, Orientations.CONE: math.radians(angle), Orientations.ALL: math.pi}[orientations]
    frames = pp.picks.tool_orientations(pp.picks.approach_directions(half_angle=half, count=directions), spins)
    tcp_from_tip = carried.attachments.tip if tip is None else pp.pose(numbers(tip, "--tip"))
    with Progress(console=Console(stderr=True), transient=True, disable=not Console(stderr=True).is_terminal) as bar:
        task = bar.add_task("reach map", total=len(grid) * len(frames))
        found = pp.reach_map(
            checker,
            grid,
            frames,
            tip=tcp_from_tip,
            world_from_root=stands,
            rng=seed,
            threads=threads,
            progress=lambda done, _: bar.update(task, completed=done),
        )
    change = None if before is None else pp.picks.ReachComparison(before, found)
    for path in outputs:
        if path.suffix.lower() == ".html":
            title = f"{arm.robot.name}: reach" + ("" if change is None else ", won and lost")
            cloud = _points(found, change, stands, step)
            pp.write_html(path, arm, seen, points=cloud, attached=checker.attached, title=title)
        elif change is None or path.suffix.lower() == ".npz":
            found.save(path)
        else:
            change.save(path)
    if as_json:
        figures = {"reachable": float(found.reachable.mean()), "free": float(found.free.mean())}
        counts = {"points": len(grid), "orientations": len(frames), "complete": found.complete}
        compared = {} if change is None else {"won": int(change.won.sum()), "lost": int(change.lost.sum())}
        print_json({"ok": bool(found.free.any()), **counts, **figures, **compared})
    else:
        say(found.summary)
        if change is not None:
            say(f"against {against}: {change.summary}")
        if outputs:
            say(f"wrote {', '.join(map(str, outputs))}")
    if not found.free.any():
        raise typer.Exit(1)


def _points(
    found: pp.ReachMap, change: pp.picks.ReachComparison | None, stands: SE3, step: float
) -> pp.viewer.ColouredPoints:
    """Points where something is reached, or changed, as the robot sees them; the others would hide these."""
    values = found.free_share if change is None else change.won.mean(axis=1) - change.lost.mean(axis=1)
    told = values > 0 if change is None else (change.won | change.lost).any(axis=1)
    seen = (found.region.points[told] - stands.translation) @ stands.rotation
    size = min(POINT_SHARE * step, LARGEST_POINT)
    if change is None:
        return pp.viewer.ColouredPoints.of_values(seen, values[told], label="share free:", size=size)
    return pp.viewer.ColouredPoints.of_values(
        seen, values[told], label="won less lost:", low=-1.0, high=1.0, colours="RdBu", size=size
    )


def _place(text: str) -> SE3:
    told = numbers(text, "--place")
    if len(told) not in (3, 4):
        raise InputError(f'--place: "x y z", and a turn about z, are three numbers or four, not {len(told)}')
    return pp.pose(told[:3], (0.0, 0.0, told[3] if len(told) == 4 else 0.0))


def _region(text: str, step: float) -> pp.picks.ReachRegion:
    ends = numbers(text, "--region")
    if len(ends) != 6:
        raise InputError(f'--region: "x0 x1 y0 y1 z0 z1" are six numbers, not {len(ends)}')
    return pp.picks.ReachRegion.box(ends[0::2], ends[1::2], step)
