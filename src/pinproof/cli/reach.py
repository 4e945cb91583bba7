"""``pinproof reach``: compute a map of the orientations that an arm reaches without collision."""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass
from enum import Enum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import pinproof as pp
from pinproof.cli.console import check_output_files, print_note, print_result, progress_bar, written
from pinproof.cli.options import (
    ChainOptions,
    Json,
    Place,
    Robot,
    SceneOptions,
    Seed,
    ToolOptions,
    numbers,
    option,
    placement,
)
from pinproof.units import warn_of_millimetres

if TYPE_CHECKING:
    from pinproof.spatial import SE3, Array

SUFFIXES = (".csv", ".npz", ".png", ".html")

POINT_SIZE, MAX_POINT_SIZE = 0.4, 0.04
"""Size of a drawn point: as a fraction of the grid step, and the largest size in metres."""


class Orientations(str, Enum):
    """Named sets of orientations."""

    DOWN = "down"
    CONE = "cone"
    ALL = "all"
    HOME = "home"


@dataclass(frozen=True)
class OrientationOptions:
    """The orientations of the tool that are tried at each point."""

    orientations: Orientations = option(
        "Directions of the z axis of the tool: straight down, in a cone around straight down, all directions, "
        "or the direction at home, for planar arms.",
        Orientations.DOWN,
    )
    angle: float = option("Half angle of the cone in degrees.", 30.0, min=0.0, max=180.0)
    directions: int = option("Number of directions for cone and all.", 12, min=1)
    spins: int = option("Number of rotations about each direction.", 8, min=1)

    def frames(self, axis: Array) -> Array:
        """Rotations (k, 3, 3) of the tool; ``axis`` (3,) is the z axis of the tool at home."""
        if self.orientations is Orientations.HOME:
            return pp.picks.tool_orientations(axis[None], self.spins)
        half_angles = {Orientations.DOWN: 0.0, Orientations.CONE: math.radians(self.angle), Orientations.ALL: math.pi}
        half = half_angles[self.orientations]
        directions = pp.picks.approach_directions(half_angle=half, count=self.directions)
        if len(directions) > 1:
            # Straight down is one of the directions: an arm such as a SCARA takes no other.
            others = pp.picks.approach_directions(half_angle=half, count=self.directions - 1)
            directions = np.vstack([[0.0, 0.0, -1.0], others])
        return pp.picks.tool_orientations(directions, self.spins)


def reach(
    robot: Robot,
    region: str = option(
        'The box to map, in metres: "x0 x1 y0 y1 z0 z1". Two equal bounds make it a plane.', MISSING, metavar="BOX"
    ),
    step: float = option("Largest distance between neighbouring grid points (m).", 0.1),
    *,
    orientation_options: OrientationOptions,
    tip: str | None = option(
        'Position of the tool tip in the tcp frame, in metres: "0 0 0.1". It adds no collision body.',
        None,
        metavar="POSITION",
    ),
    place: Place = "0 0 0 0",
    output: list[Path] | None = option(
        "The map as .csv, .npz, .png (slices) or .html; can be given several times.",
        None,
        "-o",
        "--output",
        metavar="FILE",
    ),
    against: Path | None = option(
        "An earlier map (.npz). The number of orientations gained and lost since then is printed, and the "
        "files of -o other than .npz show where.",
        None,
    ),
    threads: int = option("Number of threads.", 1, min=1),
    seed: Seed = 0,
    chain: ChainOptions,
    scene_options: SceneOptions,
    tool: ToolOptions,
    as_json: Json = False,
) -> None:
    """Map the reach of an arm: for each grid point, the share of orientations that it reaches without collision.

    Exit code 1 if the arm reaches no orientation at any point.

    Example: pinproof reach ur5 --region "-0.6 0.6 -0.6 0.6 0.1 0.1" --step 0.2 -o reach.csv
    """
    outputs = output or []
    check_output_files(outputs, [robot, *scene_options.files, *chain.files, against, *tool.files], SUFFIXES)
    before = None if against is None else pp.picks.ReachMap.load(against)
    grid, world_from_root = _region(region, step), placement(place)
    arm = chain.arm(robot, tool=tool)
    checker = _checker(arm, scene_options, tool, world_from_root)
    tcp_from_tip = tool.attachments.tip if tip is None else pp.pose(numbers(tip, "--tip", "x y z"))
    frames = orientation_options.frames(_axis_at_home(arm, tcp_from_tip, world_from_root))
    with progress_bar("reach map") as show:
        found = pp.reach_map(
            checker, grid, frames, tip=tcp_from_tip, world_from_root=world_from_root, rng=seed, threads=threads,
            progress=partial(show, ""),
        )  # fmt: skip
    never = ""
    if not found.reachable.any():
        never = _why_unreachable(arm, frames, tcp_from_tip, world_from_root, orientation_options.orientations, seed)
    change = None if before is None else pp.picks.ReachComparison(before, found)
    for path in outputs:
        if path.suffix.lower() == ".html":
            _write_page(path, checker, found, change, world_from_root, step)
        else:
            (found if change is None or path.suffix.lower() == ".npz" else change).save(path)
    compared = "" if change is None else f"compared with {against}: {change.summary}"
    lines = [*filter(None, (found.summary, compared, never and f"note: {never}")), *written(*outputs)]
    print_result({**_figures(found, change), "note": never}, lines, as_json=as_json, ok=bool(found.free.any()))


def _checker(arm: pp.Arm, options: SceneOptions, tool: ToolOptions, world_from_root: SE3) -> pp.CollisionChecker:
    """The checker of the arm in its scene; links that touch at home or in every configuration are reported."""
    from pinproof.collision.checking.checker import overlap_hint

    # The checker needs the scene in the frame of the robot's root.
    checker = options.checker(arm, options.load().transformed(world_from_root.inverse()), tool)
    for k, measured in checker.still.touching:
        print_note(f"every configuration is in collision: {checker.contact(k, measured)}")
    if hint := overlap_hint(checker, arm.home, checker.check(arm.home)):
        print_note(hint)
    return checker


def _axis_at_home(arm: pp.Arm, tip: SE3, world_from_root: SE3) -> Array:
    """The z axis (3,) of the tool at home, in the world."""
    home = world_from_root * arm.root_from_base * arm.forward_kinematics(arm.home) * tip
    return np.array(home.rotation[:, 2])


def _why_unreachable(arm: pp.Arm, frames: Array, tip: SE3, world_from_root: SE3, asked: Orientations, seed: int) -> str:
    """Why no point can be reached if the arm takes none of the orientations at any position; else ''."""
    if pp.picks.attainable_orientations(arm, frames, tip=tip, world_from_root=world_from_root, rng=seed).any():
        return ""
    points = " ".join(f"{value + 0.0:.2g}" for value in _axis_at_home(arm, tip, world_from_root).round(3))
    other = {
        Orientations.ALL: "use --orientations home, more --directions, another --tcp or a --tip",
        Orientations.HOME: "use more --spins, another --tcp or a --tip",
    }.get(asked, "use --orientations all or home, another --tcp or a --tip")
    return (
        f"the arm takes none of the {len(frames)} orientations at any position that was tried, also outside the "
        f"region; at home the z axis of its tool points along [{points}]; {other}"
    )


def _figures(found: pp.picks.ReachMap, change: pp.picks.ReachComparison | None) -> dict[str, Any]:
    """The figures of a map for JSON output."""
    points, orientations = found.free.shape
    counts = {"points": points, "orientations": orientations, "complete": found.complete}
    figures = {"reachable": float(found.reachable.mean()), "free": float(found.free.mean())}
    compared = {} if change is None else {"won": int(change.won.sum()), "lost": int(change.lost.sum())}
    return {"ok": bool(found.free.any()), **counts, **figures, **compared}


def _write_page(
    path: Path,
    checker: pp.CollisionChecker,
    found: pp.picks.ReachMap,
    change: pp.picks.ReachComparison | None,
    world_from_root: SE3,
    step: float,
) -> None:
    title = f"{checker.arm.robot.name}: reach" + ("" if change is None else ", gained and lost")
    cloud = _points(found, change, world_from_root, step)
    pp.write_html(path, checker.arm, checker.scene, points=cloud, attached=checker.attached, title=title)


def _points(
    found: pp.picks.ReachMap, change: pp.picks.ReachComparison | None, world_from_root: SE3, step: float
) -> pp.viewer.ColouredPoints:
    """The points with reached (or changed) orientations in the frame of the robot's root; others would hide them."""
    values = found.free_share if change is None else change.won.mean(axis=1) - change.lost.mean(axis=1)
    shown = values > 0 if change is None else (change.won | change.lost).any(axis=1)
    local = (found.region.points[shown] - world_from_root.translation) @ world_from_root.rotation
    size = min(POINT_SIZE * step, MAX_POINT_SIZE)
    if change is None:
        return pp.viewer.ColouredPoints.of_values(local, values[shown], label="share free:", size=size)
    return pp.viewer.ColouredPoints.of_values(
        local, values[shown], label="gained minus lost:", low=-1.0, high=1.0, colours="RdBu", size=size
    )


def _region(text: str, step: float) -> pp.picks.ReachRegion:
    ends = numbers(text, "--region", "x0 x1 y0 y1 z0 z1")
    warn_of_millimetres("--region", ends)
    return pp.picks.ReachRegion.box(ends[0::2], ends[1::2], step)
