"""Where the base of a robot may be placed: a region of positions and angles, forbidden zones, and discrete choices."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pinproof.collision import Obstacle
from pinproof.common.structs import key, struct
from pinproof.common.validation import require_integer
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import Arm
from pinproof.spatial import SE3, Array, finite, frozen, pose, rigid, rigid_matrix

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

    Raises
    ------
    UnknownNameError
        If there is no mounting of this name.
    """
    if not isinstance(mounting, str):
        return rigid("mounting", mounting)
    if mounting not in MOUNTINGS:
        raise UnknownNameError("mounting", mounting, MOUNTINGS)
    return pose(rpy=MOUNTINGS[mounting])


@struct(more=True, written=True)
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


@dataclass(frozen=True, eq=False)
class PlacementRegion:
    """The placements that are searched, in the frame of the scene and the picks.

    Parameters
    ----------
    x, y, z
        (lower, upper) in metres; equal values fix a coordinate.
    yaw
        (lower, upper) in radians, at most a full rotation.
    forbidden
        Volumes that the base and the bodies that move with it must not touch, such as a walkway. The moving links may
        enter them.

    Raises
    ------
    InputError
        If a range is empty or too large, or if names of forbidden zones are repeated.
    """

    x: Range
    y: Range
    z: Range = (0.0, 0.0)
    yaw: Range = (0.0, 0.0)
    forbidden: tuple[Obstacle, ...] = ()

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
        names = [zone.name for zone in self.forbidden]
        if doubled := sorted({name for name in names if names.count(name) > 1}):
            raise InputError(f"the names of forbidden zones must differ; repeated: {', '.join(doubled)}")

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

    def contains(self, values: npt.ArrayLike) -> bool:
        """Whether x, y, z, yaw (4,) are in the ranges; forbidden zones are not checked."""
        placement = np.asarray(values, dtype=float)
        return bool((placement >= self.lower - 1e-12).all() and (placement <= self.upper + 1e-12).all())


@dataclass(frozen=True, eq=False)
class PlacementChoice:
    """One of several discrete alternatives: another robot, tool, length of the tool, or mounting.

    What is None is as in the arguments of :func:`pinproof.place_base`.

    Parameters
    ----------
    name
        Unique name.
    arm
        Another arm, with its own tcp and limits.
    tip
        ``tcp_from_tip`` of another tool, as ``pin.SE3`` or (4, 4).
    tool
        The bodies of another tool; their pose is ``tcp_from_body``.
    mounting
        ``"floor"``, ``"wall"``, ``"ceiling"``, or ``placement_from_root`` as ``pin.SE3`` or (4, 4).
    home
        (n,) another home configuration.
    """

    name: str
    arm: Arm | None = None
    tip: SE3 | npt.ArrayLike | None = None
    tool: Iterable[Obstacle] | None = None
    mounting: str | SE3 | npt.ArrayLike = "floor"
    home: npt.ArrayLike | None = field(default=None)

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
