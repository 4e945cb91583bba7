"""``pinproof reach``: compute a map of the orientations that an arm reaches without collision."""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

import pinproof as pp
from pinproof.cli import options
from pinproof.cli.console import check_output_files, print_note, print_result, progress_bar, written
from pinproof.units import warn_of_millimetres

if TYPE_CHECKING:
    from pinproof.spatial import Array

SUFFIXES = (".csv", ".npz", ".png", ".html")


REMEDIES = {
    "down": "use --orientations all or home, another --tcp or a --tip",
    "cone": "use --orientations all or home, another --tcp or a --tip",
    "all": "use --orientations home, more --directions, another --tcp or a --tip",
    "home": "use more --spins, another --tcp or a --tip",
}
"""What to do if the arm takes none of the orientations."""


@dataclass(frozen=True)
class OrientationOptions:
    """The orientations of the tool that are tried at each point."""

    orientations: Literal["down", "cone", "all", "home"] = options.option(
        "Directions of the z axis of the tool: straight down, in a cone around straight down, all directions, "
        "or the direction at home, for planar arms.",
        "down",
    )
    angle: float = options.option("Half angle of the cone in degrees.", 30.0, min=0.0, max=180.0)
    directions: int = options.option("Number of directions for cone and all.", 12, min=1)
    spins: int = options.option("Number of rotations about each direction.", 8, min=1)

    def frames(self, axis: Array) -> Array:
        """Rotations (k, 3, 3) of the tool; ``axis`` (3,) is the z axis of the tool at home."""
        if self.orientations == "home":
            return pp.picks.tool_orientations(axis[None], self.spins)
        # Directions in a cone around straight down; all directions are a cone of half a turn
        half_angles = {"down": 0.0, "cone": math.radians(self.angle), "all": math.pi}
        half = half_angles[self.orientations]
        directions = pp.picks.approach_directions(half_angle=half, count=self.directions)
        if len(directions) > 1:
            # Straight down is one of the directions: an arm such as a SCARA takes no other.
            others = pp.picks.approach_directions(half_angle=half, count=self.directions - 1)
            directions = np.vstack([[0.0, 0.0, -1.0], others])
        return pp.picks.tool_orientations(directions, self.spins)


def reach(
    robot: options.Robot,
    region: str = options.option(
        'The box to map, in metres: "x0 x1 y0 y1 z0 z1". Two equal bounds make it a plane.', MISSING, metavar="BOX"
    ),
    step: float = options.option("Largest distance between neighbouring grid points (m).", 0.1),
    *,
    orientation_options: OrientationOptions,
    tip: str | None = options.option(
        'Position of the tool tip in the tcp frame, in metres: "0 0 0.1". It adds no collision body.',
        None,
        metavar="POSITION",
    ),
    place: options.Place = "0 0 0 0",
    output: list[Path] | None = options.option(
        "The map as .csv, .npz, .png (slices) or .html; can be given several times.",
        None,
        "-o",
        "--output",
        metavar="FILE",
    ),
    against: Path | None = options.option(
        "An earlier map (.npz). The number of orientations gained and lost since then is printed, and the "
        "files of -o other than .npz show where.",
        None,
    ),
    threads: int = options.option("Number of threads.", 1, min=1),
    seed: options.Seed = 0,
    setup: options.SetupOptions,
    as_json: options.Json = False,
) -> None:
    """Map the reach of an arm: for each grid point, the share of orientations that it reaches without collision.

    Exit code 1 if the arm reaches no orientation at any point.

    Example: pinproof reach ur5 --region "-0.6 0.6 -0.6 0.6 0.1 0.1" --step 0.2 -o reach.csv
    """
    outputs = output or []
    check_output_files(outputs, [robot, *setup.files, against], SUFFIXES)
    # Everything that can be refused is read before the map is computed
    before = None if against is None else pp.picks.ReachMap.load(against)
    ends = options.numbers(region, "--region", "x0 x1 y0 y1 z0 z1")
    warn_of_millimetres("--region", ends)
    grid, world_from_root = pp.picks.ReachRegion.box(ends[0::2], ends[1::2], step), options.placement(place)
    arm = setup.arm(robot)
    # The checker needs the scene in the frame of the robot's root.
    checker = setup.checker(arm, setup.world().transformed(world_from_root.inverse()))
    for contact in checker.fixed_contacts:
        print_note(f"every configuration is in collision: {contact}")
    if hint := pp.collision.overlap_hint(checker, arm.home, checker.check(arm.home)):
        print_note(hint)
    tcp_from_tip = setup.attachments.tip if tip is None else pp.pose(options.numbers(tip, "--tip", "x y z"))
    at_home = world_from_root * arm.root_from_base * arm.forward_kinematics(arm.home) * tcp_from_tip
    axis = np.array(at_home.rotation[:, 2])
    frames = orientation_options.frames(axis)
    with progress_bar("reach map") as show:
        found = pp.reach_map(
            checker, grid, frames, tip=tcp_from_tip, world_from_root=world_from_root, rng=seed, threads=threads,
            progress=partial(show, ""),
        )  # fmt: skip
    # If no point is reachable, the reason may be that the arm takes none of the orientations anywhere.
    never = ""
    if not found.reachable.any():
        placed = {"tip": tcp_from_tip, "world_from_root": world_from_root}
        if not pp.picks.attainable_orientations(arm, frames, rng=seed, **placed).any():
            along = " ".join(f"{value + 0.0:.2g}" for value in axis.round(3))
            never = (
                f"the arm takes none of the {len(frames)} orientations at any position that was tried, also outside "
                f"the region; at home the z axis of its tool points along [{along}]; "
                f"{REMEDIES[orientation_options.orientations]}"
            )
    # Files of a comparison show the change, except the data of the map itself
    change = None if before is None else pp.picks.ReachComparison(before, found)
    title = f"{arm.robot.name}: reach" + ("" if change is None else ", gained and lost")
    for path in outputs:
        shown = found if change is None or path.suffix.lower() == ".npz" else change
        if path.suffix.lower() == ".html":
            cloud = shown.coloured_points(world_from_root, size=step)
            pp.write_html(path, arm, checker.scene, points=cloud, attached=checker.attached, title=title)
        else:
            shown.save(path)
    compared = "" if change is None else f"compared with {against}: {change.summary}"
    lines = [*filter(None, (found.summary, compared, never and f"note: {never}")), *written(*outputs)]
    points, orientations = found.free.shape
    data: dict[str, Any] = {
        "ok": bool(found.free.any()),
        "points": points,
        "orientations": orientations,
        "complete": found.complete,
    }
    data |= {"reachable": float(found.reachable.mean()), "free": float(found.free.mean())}
    data |= {} if change is None else {"won": int(change.won.sum()), "lost": int(change.lost.sum())}
    print_result({**data, "note": never}, lines, as_json=as_json, ok=data["ok"])
