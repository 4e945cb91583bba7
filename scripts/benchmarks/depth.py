"""Benchmark of occupancy grids of depth images: making and fusing them, and certificates among them.

./scripts/benchmark depth             prints the table; 5 s
./scripts/benchmark depth --docs      rewrites docs/benchmarks/depth.*
"""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np

import pinproof as pp
from benchmarks.tables import Benchmark, Blocks, Results, Row, page_parser, provenance, row_table, seconds
from pinproof.collision import Intrinsics

REPEATS = 10
"""Runs of each measurement, of which the median counts."""

CAMERA = Intrinsics(600, 600, 319.5, 239.5, 640, 480)
VOXEL, BOUNDS = 0.01, [(0.3, -0.5, -0.1), (1.3, 0.5, 0.9)]
"""10^6 cells in front of the robot."""

PARTS = 30
"""Boxes on the table."""

TURN = np.array([0.4, 0, 0, 0, 0, 0])
"""Difference of the configurations (rad) at the end and at the start of the motion."""


def depth_image(root_from_camera: np.ndarray, boxes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the depth of boxes (n, 2, 3) along the optical axis with errors of 1 mm; 0 if a ray meets none."""
    u, v = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1)
    rays, eye = rays @ root_from_camera[:3, :3].T, root_from_camera[:3, 3]
    depth = np.full(u.shape, np.inf)
    for corners in boxes:
        low, high = (corners[0] - eye) / rays, (corners[1] - eye) / rays
        enter, leave = np.minimum(low, high).max(axis=-1), np.maximum(low, high).min(axis=-1)
        depth = np.where((enter <= leave) & (enter < depth), enter, depth)
    return np.where(np.isfinite(depth), rng.normal(np.where(np.isfinite(depth), depth, 0.0), 0.001), 0.0)


def downwards(eye: tuple[float, float, float], tilt: float) -> np.ndarray:
    """Return root_from_camera of a camera whose optical axis is tilted about x from the direction -z."""
    return np.array(pp.pose(eye, (np.pi + tilt, 0, 0)).homogeneous)


def measured(step: str, call: Callable[[], Any], text: Callable[[Any], str]) -> tuple[Row, Any]:
    """Return the processor times (ms) of the first call and of the others, and the result."""
    first, *times = (1e3 * seconds(call) for _ in range(REPEATS + 1))
    made = call()
    return Row(step=step, result=text(made), first=first, times=times), made


def time_rows(seed: int) -> list[Row]:
    """Measure all steps for random boxes on a table, seen by two cameras."""
    rng = np.random.default_rng(seed)
    center, half = rng.uniform((0.35, -0.45, 0.0), (1.25, 0.45, 0.0), (PARTS, 3)), rng.uniform(0.01, 0.05, (PARTS, 3))
    center[:, 2] = half[:, 2]
    table = [[(-2, -3, -0.05), (4, 3, 0.0)]]
    boxes = np.concatenate([table, np.stack([center - half, center + half], axis=1)])
    poses = [downwards((0.8, -0.5, 1.8), 0.25), downwards((0.8, 0.5, 1.8), -0.25)]
    images = [depth_image(pose, boxes, rng) for pose in poses]

    def grid(k: int) -> pp.OccupancyGrid:
        return pp.OccupancyGrid.from_depth(images[k], CAMERA, poses[k], voxel=VOXEL, bounds=BOUNDS)

    two = grid(1)
    first, one = measured("`OccupancyGrid.from_depth`", lambda: grid(0), _cells)
    second, both = measured("fusing with a second view", lambda: one | two, _cells)
    points = (np.argwhere(both.occupied) + both.low + 0.5) * VOXEL
    arm = pp.load_robot("ur5").arm()
    path = pp.JointPath(np.array([arm.home, arm.home + TURN]), arm.joint_names)
    rows = [first, second]
    for kind, shape in (("points", pp.PointCloud(points, VOXEL)), ("grid", both)):
        scene = pp.Scene([pp.Obstacle("camera", shape)])
        step, checker = measured(
            f"`CollisionChecker` with the {kind}",
            lambda scene=scene: pp.CollisionChecker(arm, scene),  # type: ignore[misc]
            lambda made: f"{len(points):,} occupied cells, {len(made.bodies):,} bodies",
        )
        proof, _ = measured(
            f"`certify` among the {kind}",
            lambda checker=checker: pp.certify(path, checker),  # type: ignore[misc]
            lambda made: f"{made.status.name}, clearance {1e3 * made.clearance:.1f} mm",
        )
        rows += [step, proof]
    return rows


def _cells(grid: pp.OccupancyGrid) -> str:
    return ", ".join(f"{n:,} {kind}" for n, kind in zip(grid.counts, ("free", "seen", "unknown"), strict=True))


def blocks(results: Results) -> Blocks:
    """The table of the page."""
    columns = {
        "step": "{.step}",
        "result": "{.result}",
        "first": "{.first:.2f}",
        "median": lambda row: f"{median(row.times):.2f}",
        "least": lambda row: f"{min(row.times):.2f}",
        "largest": lambda row: f"{max(row.times):.2f}",
    }
    return {"times": row_table(columns, results["times"], text_columns=2)}


BENCHMARK = Benchmark(
    "depth", lambda options: Results({}, provenance(options.seed), {"times": time_rows(options.seed)}), blocks
)


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    BENCHMARK.run(page_parser(__doc__, "depth"))
