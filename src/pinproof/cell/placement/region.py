"""Where the base of a robot may be placed: a region of positions and angles, forbidden zones, and discrete choices."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.collision import KINDS, CollisionChecker, Mesh, Obstacle, Scene
from pinproof.common.structs import described, key, struct
from pinproof.common.validation import refuse_repeated, require_integer
from pinproof.description import CELL, PLACEMENT_JOINTS, LinkGeometry, MeshFile, moved_by, with_movable_base
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import Arm, JointLimits, Robot
from pinproof.picks import Picks, spec_of_picks
from pinproof.spatial import SE3, Array, finite, frozen, matrix, pose, rigid, rigid_matrix

Range = tuple[float, float]

AXES = ("x", "y", "z", "yaw")

FULL_TURN = 2 * np.pi

LONGEST = 100.0
"""Metres: larger coordinates of a region are probably stated in millimetres."""

METRES_PER_RADIAN = 0.5
"""By which a rotation is compared with a displacement when a grid is divided: the displacement of a point half a metre
from the base, which is in the middle of the work area of most arms."""

MOST_PLACEMENTS = 1_000_000
"""Largest number of placements of a grid."""

MOUNTINGS: Mapping[str, tuple[float, float, float]] = {
    "floor": (0.0, 0.0, 0.0),
    "ceiling": (np.pi, 0.0, 0.0),
    "wall": (0.0, np.pi / 2, 0.0),
}
"""The roll, pitch and yaw of the root link behind the placement, by name. The z axis of the root link of a robot on a
wall points along the x axis of the placement, away from the wall."""


def mounting_pose(mounting: str | SE3 | npt.ArrayLike) -> SE3:
    """``placement_from_root`` of a mounting: a name of :data:`MOUNTINGS`, or any pose.

    UnknownNameError if there is no mounting of this name.
    """
    if not isinstance(mounting, str):
        return rigid("mounting", mounting)
    if mounting not in MOUNTINGS:
        raise UnknownNameError("mounting", mounting, MOUNTINGS)
    return pose(rpy=MOUNTINGS[mounting])


@struct(written=True)
class Placement:
    """The placement of a base in the frame of the cell."""

    x: float = key("position of the base", "m")
    y: float = key("position of the base", "m")
    z: float = key("position of the base", "m", default=0.0)
    yaw: float = key("rotation of the base about z", "rad", default=0.0)
    choice: str = key("name of the discrete choice; empty if there is only one", default="")

    @classmethod
    def of(cls, values: Array, choice: str = "") -> Placement:
        """The placement with x, y, z and yaw (4,)."""
        x, y, z, yaw = map(float, values + 0.0)  # no negative zero
        return cls(x, y, z, yaw, choice)

    @property
    def values(self) -> Array:
        """(4,) x, y, z, yaw."""
        return np.array([self.x, self.y, self.z, self.yaw])

    @property
    def pose(self) -> SE3:
        """The pose in the frame of the cell, before the mounting."""
        return pose(xyz=(self.x, self.y, self.z), rpy=(0.0, 0.0, self.yaw))

    def __str__(self) -> str:
        text = f"({self.x:.4f}, {self.y:.4f}, {self.z:.4f}) m, yaw {np.degrees(self.yaw):.2f} deg"
        return f"{text}, {self.choice}" if self.choice else text


@described(eq=False)
class PlacementRegion:
    """The placements that are searched, in the frame of the scene and the picks.

    Raises
    ------
    InputError
        If a range is empty or too large, or if names of forbidden zones are repeated.
    """

    x: Range = key("(lower, upper); equal values fix a coordinate", "m")
    y: Range = key("(lower, upper)", "m")
    z: Range = key("(lower, upper)", "m", default=(0.0, 0.0))
    yaw: Range = key("(lower, upper), at most a full rotation", "rad", default=(0.0, 0.0))
    forbidden: tuple[Obstacle, ...] = key(
        "volumes that the base and the bodies that move with it must not touch, such as a walkway. The moving links "
        "may enter them",
        default=(),
    )

    def __post_init__(self) -> None:
        for name in AXES:
            low, high = finite(f"{name} of the region", getattr(self, name), (2,)).tolist()
            if high < low:
                raise InputError(
                    f"the region is empty: its upper {name} = {high:g} is below its lower {name} = {low:g}"
                )
            if name == "yaw" and high - low > FULL_TURN * (1 + 1e-12):
                raise InputError(
                    f"yaw from {low:g} to {high:g} rad is more than a full rotation; angles are in radians"
                )
            if name != "yaw" and max(abs(low), abs(high)) > LONGEST:
                raise InputError(
                    f"{name} from {low:g} to {high:g} is more than {LONGEST:g} m away; lengths are in metres"
                )
            object.__setattr__(self, name, (low, high))
        object.__setattr__(self, "forbidden", tuple(self.forbidden))
        refuse_repeated("forbidden zones", (zone.name for zone in self.forbidden))

    @property
    def lower(self) -> Array:
        """(4,) lower x, y, z, yaw."""
        return np.array([getattr(self, name)[0] for name in AXES])

    @property
    def upper(self) -> Array:
        """(4,) upper x, y, z, yaw."""
        return np.array([getattr(self, name)[1] for name in AXES])

    @property
    def free_axes(self) -> tuple[int, ...]:
        """The indices of the coordinates that vary."""
        return tuple(np.flatnonzero(self.upper > self.lower).tolist())

    def axes(self, count: int) -> tuple[Array, Array, Array, Array]:
        """The values of x, y, z and yaw of a grid of about ``count`` placements with similar steps.

        The placements are the centres of equal cells that cover the region. A radian counts as half a metre.
        """
        require_integer("grid", count, 1)
        if count > MOST_PLACEMENTS:
            raise InputError(f"grid = {count}; the largest number of placements is {MOST_PLACEMENTS}")
        extent = (self.upper - self.lower) * np.array([1.0, 1.0, 1.0, METRES_PER_RADIAN])
        numbers = np.ones(4, dtype=int)
        free = extent > 0
        while free.any():
            # axes that are shorter than a step have one cell, and the others share the placements that are left
            step = (np.prod(extent[free]) / (count / np.prod(numbers[~free]))) ** (1.0 / free.sum())
            short = free & (extent < step)
            if not short.any():
                numbers[free] = np.maximum(np.round(extent[free] / step), 1)
                break
            free &= ~short
        return self.cells(numbers.tolist())

    def cells(self, numbers: Sequence[int]) -> tuple[Array, Array, Array, Array]:
        """The centres along x, y, z and yaw of a division into these numbers of cells."""
        for name, number in zip(AXES, numbers, strict=True):
            require_integer(f"the number of cells along {name}", number, 1)
        x, y, z, yaw = (
            low + (np.arange(number) + 0.5) * (high - low) / number
            for low, high, number in zip(self.lower, self.upper, numbers, strict=True)
        )
        return x, y, z, yaw


@described(eq=False)
class PlacementChoice:
    """One of several discrete alternatives: another robot, tool, length of the tool, or mounting.

    What is None is as in the arguments of :func:`pinproof.place_base`.
    """

    name: str = key("unique name")
    arm: Arm | None = key("another arm, with its own tcp and limits", default=None)
    tip: SE3 | npt.ArrayLike | None = key("``tcp_from_tip`` of another tool, as ``pin.SE3`` or (4, 4)", default=None)
    tool: Iterable[Obstacle] | None = key("the bodies of another tool; their pose is ``tcp_from_body``", default=None)
    mounting: str | SE3 | npt.ArrayLike = key(
        '``"floor"``, ``"wall"``, ``"ceiling"``, or ``placement_from_root`` as ``pin.SE3`` or (4, 4)', default="floor"
    )
    home: npt.ArrayLike | None = key("(n,) another home configuration", default=None)

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError(f"a choice needs a name, not {self.name!r}")
        if self.tip is not None:
            object.__setattr__(self, "tip", frozen(rigid(f"tip of choice {self.name!r}", self.tip)))
        if self.tool is not None:
            object.__setattr__(self, "tool", tuple(self.tool))
        mounting_pose(self.mounting)
        if self.home is not None:
            object.__setattr__(self, "home", finite(f"home of choice {self.name!r}", self.home, (None,)))

    @property
    def placement_from_root(self) -> Array:
        """(4, 4) the mounting."""
        return rigid_matrix("mounting", mounting_pose(self.mounting))


FARTHEST = 1e3
"""Metres or rad: limits of the placement joints, beyond every region."""


@described(eq=False)
class PlacedRobot:
    """An arm with a movable base in a cell."""

    robot: Robot = key("the robot with its placement joints")
    original: Arm = key("the arm without them")
    scene: Scene = key("the obstacles that do not move with the base, in the frame of the cell")
    mounting: Array = key("(4, 4) ``placement_from_root``")

    @classmethod
    def make(cls, arm: Arm, scene: Scene, mounting: Array, moves_with_base: Sequence[str] = ()) -> PlacedRobot:
        """Build the robot; the named obstacles of the scene move with the base.

        UnknownNameError if there is no obstacle of a name; InputError if the shape of such an obstacle cannot be a
        link.
        """
        if scene.frame and scene.frame not in arm.robot.urdf.links:
            raise UnknownNameError("frame", scene.frame, arm.robot.urdf.links, scene.where)
        names = tuple(dict.fromkeys(moves_with_base))
        mount = tuple(_geometry(scene[name]) for name in names)
        robot = arm.robot
        movable = Robot(
            with_movable_base(robot.urdf, mounting, mount),
            robot.srdf,
            robot.default_tcp,
            robot.home,
            robot.default_base,
        )
        # The scene without these obstacles, which may still touch what the scene allows them to touch
        left = scene.remove(*names)
        flipped = [(a, b) if b in left.names else (b, a) for a, b in scene.allowed]
        allowed = tuple((a, b) for a, b in flipped if b in left.names and (a in names or (a, b) in left.allowed))
        return cls(movable, arm, replace(left, allowed=allowed, frame="", margins=scene.margins), mounting)

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
        own, wide = self.original.limits, np.full(4, FARTHEST)
        lower, upper = np.concatenate([-wide, own.lower]), np.concatenate([wide, own.upper])
        limits = JointLimits(lower, upper, np.concatenate([np.ones(4), own.velocity]))
        return self.robot.arm(self.original.tcp, base=CELL, limits=limits, held=self._held)

    @property
    def _held(self) -> dict[str, float]:
        """The values of the joints outside the arm; mimic joints follow their leaders."""
        joints = self.original.robot.urdf.joints
        return {name: value for name, value in self.original.held.items() if joints[name].mimic is None}

    def checker(self, picks: Picks, *, hand_may_touch: Sequence[str] = ()) -> CollisionChecker:
        """The checker of :attr:`wide_arm`; the open hand may touch the named obstacles.

        Of several tools that are changed, only what is always mounted is checked; the certified picks have all of it.
        """
        picks = picks.always_mounted
        checker = CollisionChecker.of(spec_of_picks(self.wide_arm, self.scene, picks))
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
        checker = CollisionChecker(self.wide_arm, scene, attached=picks.always_mounted.open_tool)
        # the links that no joint of the arm moves, with the bodies that move with the base
        urdf, moving = self.robot.urdf, (*self.original.joint_names, *self.original.followers)
        base = {link for link in urdf.links if not moved_by(urdf, link, moving)}
        owners = [{checker.bodies[k].owner for k in pair} for pair in checker.pairs]
        return checker.without_pairs(k for k, own in enumerate(owners) if own.isdisjoint(scene.names) or not own & base)

    def refuse_on_base(self, stated: Iterable[tuple[str, str]], shared: Picks) -> None:
        """Raise if a part of the work is stated in the frame of the robot or of a body that moves with the base.

        InputError the message names the part and the frame; UnknownNameError if there is no frame of this name.
        """
        for part, frame in stated:
            parent = frame
            for _ in range(len(shared.frames) + 1):
                parent = shared.frames[parent].frame if parent in shared.frames else parent
            if parent and parent not in self.scene.names:
                if parent not in self.robot.urdf.links:
                    raise UnknownNameError("frame", parent, [*shared.frames, *self.scene.names], part)
                raise InputError(
                    f"{part} is stated in the frame {frame!r}, which moves with the base; state it in the frame of the "
                    "cell or of an obstacle that does not move with the base"
                )


def _geometry(obstacle: Obstacle) -> LinkGeometry:
    """The obstacle as the geometry of a link of its name."""
    shape, placed, mesh = obstacle.shape, np.array(matrix(obstacle.pose)), None
    placed.setflags(write=False)
    kind = next((name for name, own in KINDS.items() if type(shape) is own), None)
    if isinstance(shape, Mesh) and shape.path is not None:
        path, size = Path(shape.path), tuple(np.broadcast_to(shape.scale, 3).tolist())
        kind, mesh = "mesh", MeshFile(str(path), path, ())
    elif kind is not None:
        size = astuple(shape)
    else:
        raise InputError(
            f"obstacle {obstacle.name!r} cannot move with the base: its shape is {type(shape).__name__}; use a box, "
            "sphere, cylinder, capsule or a mesh from a file"
        )
    return LinkGeometry(f"{obstacle.name}_0", obstacle.name, kind, size, placed, mesh, obstacle.rgba)  # type: ignore[arg-type]
