"""A robot that can be placed anywhere in a cell, while scene and picks stay where they are.

The robot description gets four joints before its root link, x, y, z and yaw, and the bodies that move with the base
become links that are fixed to the root. An arm at a placement holds these joints, so that gravity, supports and the
vertical direction are those of the cell for every mounting. A second arm has them as its first joints: one collision
checker of it checks configurations at many placements in one call.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from pinproof.collision import Box, Capsule, CollisionChecker, Cylinder, Mesh, Obstacle, Scene, Sphere
from pinproof.description import CELL, PLACEMENT_JOINTS, LinkGeometry, MeshFile, moved_by, with_movable_base
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import Arm, JointLimits, Robot
from pinproof.picks import Pick, Picks
from pinproof.spatial import Array, matrix

FARTHEST = 1e3
"""Metres or rad: limits of the placement joints, beyond every region."""


@dataclass(frozen=True, eq=False)
class PlacedRobot:
    """An arm with a movable base in a cell."""

    # The robot with its placement joints.
    robot: Robot
    # The arm without them.
    original: Arm
    # The obstacles that do not move with the base, in the frame of the cell.
    scene: Scene
    # (4, 4) ``placement_from_root``.
    mounting: Array

    @classmethod
    def make(cls, arm: Arm, scene: Scene, mounting: Array, moves_with_base: Sequence[str] = ()) -> PlacedRobot:
        """Build the robot; the named obstacles of the scene move with the base.

        Raises
        ------
        UnknownNameError
            If there is no obstacle of a name.
        InputError
            If the shape of such an obstacle cannot be a link.
        """
        if scene.frame and scene.frame not in arm.robot.urdf.links:
            raise UnknownNameError("frame", scene.frame, arm.robot.urdf.links, scene.where)
        mount = tuple(_geometry(scene[name]) for name in dict.fromkeys(moves_with_base))
        robot = arm.robot
        movable = Robot(
            with_movable_base(robot.urdf, mounting, mount),
            robot.srdf,
            robot.default_tcp,
            robot.home,
            robot.default_base,
        )
        return cls(movable, arm, _without(scene, tuple(dict.fromkeys(moves_with_base))), mounting)

    def arm_at(self, values: Array) -> Arm:
        """The arm with its base at x, y, z, yaw (4,)."""
        held = {**self._held, **dict(zip(PLACEMENT_JOINTS, map(float, values), strict=True))}
        return self.robot.arm(self.original.tcp, base=self.original.base, limits=self.original.limits, held=held)

    def root_from_cell(self, values: Array) -> Array:
        """(4, 4) the pose of the cell in the root link of the original robot, at x, y, z, yaw (4,)."""
        return np.asarray(np.linalg.inv(self.cell_from_root(values[None])[0]))

    def cell_from_root(self, values: Array) -> Array:
        """(m, 4, 4) the poses of the root link of the original robot at placements (m, 4)."""
        c, s = np.cos(values[:, 3]), np.sin(values[:, 3])
        placed = np.tile(np.eye(4), (len(values), 1, 1))
        placed[:, 0, 0] = placed[:, 1, 1] = c
        placed[:, 1, 0], placed[:, 0, 1] = s, -s
        placed[:, :3, 3] = values[:, :3]
        return np.asarray(placed @ self.mounting)

    def base_from_cell(self, values: Array) -> Array:
        """(m, 4, 4) the poses of the cell in the base link of the arm at placements (m, 4)."""
        return np.asarray(np.linalg.inv(self.cell_from_root(values) @ matrix(self.original.root_from_base)))

    @cached_property
    def wide_arm(self) -> Arm:
        """The arm whose first four joints are those of the placement."""
        return self.arm_within(np.full(4, -FARTHEST), np.full(4, FARTHEST))

    def arm_within(self, lower: Array, upper: Array) -> Arm:
        """:attr:`wide_arm` with the placement joints limited to (4,) ``lower`` and ``upper``."""
        own = self.original.limits
        limits = JointLimits(
            np.concatenate([lower, own.lower]),
            np.concatenate([upper, own.upper]),
            np.concatenate([np.ones(4), own.velocity]),
        )
        return self.robot.arm(self.original.tcp, base=CELL, limits=limits, held=self._held)

    @property
    def _held(self) -> dict[str, float]:
        """The values of the joints outside the arm; mimic joints follow their leaders."""
        joints = self.original.robot.urdf.joints
        return {name: value for name, value in self.original.held.items() if joints[name].mimic is None}

    @cached_property
    def base_links(self) -> tuple[str, ...]:
        """The links that no joint of the arm moves, with the bodies that move with the base."""
        urdf, moving = self.robot.urdf, (*self.original.joint_names, *self.original.followers)
        return tuple(link for link in urdf.links if not moved_by(urdf, link, moving))

    def checker(self, picks: Picks, *, hand_may_touch: Sequence[str] = ()) -> CollisionChecker:
        """The checker of :attr:`wide_arm`; the open hand may touch the named obstacles."""
        checker = CollisionChecker(self.wide_arm, self.scene, margin=picks.margin, attached=picks.open_tool)
        urdf = self.robot.urdf
        hand = [*(body.name for body in picks.open_tool), *picks.gripper]
        hand += [link for link in urdf.links if moved_by(urdf, link, picks.grip)]
        there = set(checker.obstacles_and_links)
        return checker.allowing(
            *((body, name) for body in dict.fromkeys(hand) if body in there for name in hand_may_touch)
        )

    def zone_checker(self, zones: Sequence[Obstacle], picks: Picks) -> CollisionChecker | None:
        """The checker of the base and the bodies that move with it against zones; None without zones."""
        if not zones:
            return None
        scene = Scene([replace(zone, name=f"forbidden zone {zone.name}") for zone in zones])
        checker = CollisionChecker(self.wide_arm, scene, attached=picks.open_tool)

        def judged(pair: tuple[int, int]) -> bool:
            owners = [checker.bodies[k].owner for k in pair]
            return any(name in scene.names for name in owners) and any(name in self.base_links for name in owners)

        return checker.without_pairs(k for k, pair in enumerate(checker.pairs) if not judged(pair))

    def refuse_picks_on_base(self, picks: Sequence[Pick], shared: Picks) -> None:
        """Raise if a pick is stated in the frame of the robot or of a body that moves with the base.

        Raises
        ------
        InputError
            The message names the pick and the frame.
        """
        for pick in picks:
            for frame in (pick.frame, "" if pick.place is None else pick.place.frame):
                parent = frame
                for _ in range(len(shared.frames) + 1):
                    parent = shared.frames[parent].frame if parent in shared.frames else parent
                if parent and parent not in self.scene.names:
                    raise InputError(
                        f"pick {pick.name!r} is stated in the frame {frame!r}, which moves with the base; state it in "
                        "the frame of the cell or of an obstacle that does not move with the base"
                    )


def _without(scene: Scene, names: tuple[str, ...]) -> Scene:
    """The scene without these obstacles; they may still touch what the scene allows them to touch."""
    left = scene.remove(*names)
    flipped = [(a, b) if b in left.names else (b, a) for a, b in scene.allowed]
    allowed = [(a, b) for a, b in flipped if b in left.names and (a in names or (a, b) in left.allowed)]
    return Scene(left.obstacles, allowed=allowed, disabled=left.disabled, notes=left.notes, source=left.source)


def _geometry(obstacle: Obstacle) -> LinkGeometry:
    """The obstacle as the geometry of a link of its name."""
    shape, placed = obstacle.shape, np.array(matrix(obstacle.pose))
    placed.setflags(write=False)
    mesh: MeshFile | None = None
    kind: Literal["box", "sphere", "cylinder", "capsule", "mesh"]
    size: tuple[float, ...]
    if isinstance(shape, Box):
        kind, size = "box", (shape.x, shape.y, shape.z)
    elif isinstance(shape, Sphere):
        kind, size = "sphere", (shape.radius,)
    elif isinstance(shape, (Cylinder, Capsule)):
        kind = "cylinder" if isinstance(shape, Cylinder) else "capsule"
        size = (shape.radius, shape.length)
    elif isinstance(shape, Mesh) and shape.path is not None:
        path = Path(shape.path)
        scale = shape.scale if isinstance(shape.scale, tuple) else (shape.scale,) * 3
        kind, size, mesh = "mesh", scale, MeshFile(str(path), path, ())
    else:
        raise InputError(
            f"obstacle {obstacle.name!r} cannot move with the base: its shape is {type(shape).__name__}; use a box, "
            "sphere, cylinder, capsule or a mesh from a file"
        )
    return LinkGeometry(f"{obstacle.name}_0", obstacle.name, kind, size, placed, mesh, obstacle.rgba)
