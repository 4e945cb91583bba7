"""Random picks in the cells that come with the package."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from pinproof.collision import Cylinder, Obstacle, Scene
from pinproof.description import robots_folder
from pinproof.errors import UnknownNameError
from pinproof.model import Arm, load_robot
from pinproof.picks import Pick, Picks, PlaceTarget, read_picks
from pinproof.spatial import SE3, pose

__all__ = ["CELLS", "PickCell", "pick_cell"]

Array = npt.NDArray[np.float64]

TILT = np.radians(30.0)
"""Tools look down within this; carried bolts hang straight down, since they stand on the table."""

LOWEST, HIGHEST = 0.035, 0.25
"""Metres above the base: of the heads of bolts that stand on the table, and of the highest picks."""

BOLT = Cylinder(radius=0.008, length=0.04)

REGIONS = {"ur5": (0.15, 0.85), "panda": (0.15, 0.8), "generic_6dof": (0.15, 0.75)}
"""Metres from the base, along x and y: from its foot to a little out of reach."""

CELLS = (*REGIONS, "ur5, carried")
"""The cells there are."""


@dataclass(frozen=True, eq=False)
class PickCell:
    """A cell: ``name``, the arm, the scene, what its picks share, and the ``nearest`` and ``farthest`` (m) of them."""

    name: str
    arm: Arm
    scene: Scene
    shared: Picks
    nearest: float
    farthest: float

    def picks(self, count: int, seed: int) -> Picks:
        """As many random picks: the tool looks down within 30 degrees, a quarter of the way round to either side."""
        rng = np.random.default_rng(seed)
        return replace(self.shared, picks=tuple(self._pick(f"pick_{i}", rng) for i in range(count)), problems=())

    def poses(self, count: int, seed: int) -> Array:
        """The poses (N, 4, 4) of as many picks that are not carried, ``root_from_tip``."""
        rng = np.random.default_rng(seed)
        return np.array([self._pose(rng, TILT).homogeneous for _ in range(count)])

    def everywhere(self, count: int, seed: int) -> Array:
        """Poses (N, 4, 4) of random configurations inside the limits: all are in reach, in any orientation."""
        low, high = self.arm.limits.sampling_range()
        at = self.arm.forward_kinematics_batch(np.random.default_rng(seed).uniform(low, high, (count, self.arm.dof)))
        return np.asarray(self.arm.root_from_base.homogeneous @ at @ self.shared.tip.homogeneous)

    def _pick(self, name: str, rng: np.random.Generator) -> Pick:
        if not self.name.endswith("carried"):
            return Pick(name, self._pose(rng, TILT))
        grasp, put = self._pose(rng, 0.0), self._pose(rng, 0.0)
        bolt = Obstacle("bolt", BOLT, pose(xyz=(0.0, 0.0, BOLT.length / 2)))
        return Pick(name, grasp, carried=bolt, place=PlaceTarget(put))

    def _pose(self, rng: np.random.Generator, tilt: float) -> SE3:
        way, distance = rng.uniform(-np.pi / 2, np.pi / 2), rng.uniform(self.nearest, self.farthest)
        height = rng.uniform(LOWEST, HIGHEST) if tilt else LOWEST
        xyz = (distance * np.cos(way), distance * np.sin(way), height)
        lean, towards, spin = rng.uniform(0.0, tilt), *rng.uniform(-np.pi, np.pi, 2)
        turned = pose(rpy=(0.0, 0.0, towards)) * pose(rpy=(0.0, np.pi - lean, 0.0)) * pose(rpy=(0.0, 0.0, spin))
        return SE3(turned.rotation, np.array(xyz))


def pick_cell(name: str) -> PickCell:
    """A cell of :data:`CELLS`.

    Raises
    ------
    UnknownNameError
        For another name.
    """
    if name not in CELLS:
        raise UnknownNameError("cell", name, CELLS)
    robot = name.partition(",")[0]
    shared = read_picks(robots_folder() / robot / "picks.yaml")
    arm = load_robot(robot).arm(shared.tcp, held=shared.held)
    return PickCell(name, arm, Scene.load(robots_folder() / robot / "scene.yaml"), shared, *REGIONS[robot])
