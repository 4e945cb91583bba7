"""The result of following a tool path: the motion with its evidence, or the poses that cannot be passed and why."""

from __future__ import annotations

import math
from enum import Enum
from typing import Any

import numpy as np

from pinproof.collision import Certificate, CollisionChecker
from pinproof.common.results import Rows, Solution, View
from pinproof.common.structs import described, key
from pinproof.model import Arm
from pinproof.motion import Trajectory
from pinproof.planning import MotionPlan, PlannedMotion
from pinproof.spatial import Array
from pinproof.tool_paths.path import ToolPath
from pinproof.tool_paths.rungs import PathArm

# Number of blocked poses that a message states.
SHOWN = 3


class FollowStatus(Enum):
    """The outcome of following a tool path."""

    FOUND = "a certified motion follows the path"
    LIFTS_NEEDED = "the path can only be followed in pieces, with more lifts of the tool than permitted"
    BLOCKED = "some poses of the path cannot be passed"
    TOO_SLOW = "the tool cannot keep its speed within the tolerance"
    NO_TRANSIT = "no motion was found from one piece of the path to the next"
    NOT_PROVEN = "the motion that was found is not proven free, or cannot be timed within the limits"


class Obstruction(Enum):
    """Why a pose of the path cannot be passed."""

    OUT_OF_REACH = "out of reach"
    LIMIT = "only outside the joint limits"
    CONTACT = "every configuration is in contact"
    AVOIDED = "only near configurations to avoid"
    JUMP = "every way on would be a jump of the joints"


@described(eq=False)
class BlockedPose:
    """A part of the path that cannot be passed."""

    pose: float = key("index of its first pose; a fraction for a place between two poses")
    last: float = key("index of its last pose")
    obstruction: Obstruction = key("the reason")
    message: str = key("the reason with the bodies or joints, as text")
    proven: bool = key(
        "whether it is proven for the rotations and tilts of the tool on the grid: all IK solutions are known"
    )
    place: Array = key("(4, 4) ``base_from_tcp``", hidden=True)
    contacts: dict[tuple[str, str], int] = key(
        "how many of the configurations each pair of bodies excludes", default_factory=dict, hidden=True
    )
    q: Array | None = key("(n,) a configuration that shows the reason, if there is one", default=None, hidden=True)


@described(eq=False)
class PathPiece:
    """A part of the path that is followed without lifting the tool."""

    first: float = key("index of its first pose; a fraction for a place between two poses")
    last: float = key("index of its last pose")
    q: Array = key("(k, n) the configurations of the motion at the rungs", hidden=True)
    rotations: Array = key("(k,) the rotations (rad) of the tool about its axis at the rungs", hidden=True)
    poses: Array = key("(k,) the index of the pose of each rung; a fraction between two poses", hidden=True)
    cost: float = key("the cost of the motion from rung to rung")
    grid_cost: float = key("the least cost over the grid, before finer values around the optimum are compared")
    trajectory: Trajectory | None = key("the motion along the path, without approach and departure", hidden=True)
    deviation: float = key("bound of the distance of the tool from the path at every instant", "m")
    rotation_deviation: float = key(
        "bound of the angle to the orientation of the path at every instant; of the tool axis if its rotation is free",
        "rad",
    )
    speed: tuple[float, float] = key(
        "bounds (m/s) of the speed of the tool between ``ramps`` and outside of ``slow``; the upper one holds at every"
        " instant. Without a stated speed, over the whole piece",
        default=(math.nan, math.nan),
    )
    speed_share: float = key(
        "the least share of the stated speed at which the tool is proven to move there; 1 without a stated speed",
        default=1.0,
    )
    ramps: tuple[float, float] = key(
        "length (m) at the start and at the end on which the tool is slower than the tolerance permits, because it"
        " starts and stops there",
        default=(0.0, 0.0),
    )
    slow: tuple[tuple[float, float], ...] = key(
        "begin and end (s) of the intervals of ``trajectory`` between them in which the tool is slower: where it"
        " reverses, stops at a corner, or changes to another stated speed",
        default=(),
    )


@described(eq=False)
class FollowPlan(PlannedMotion):
    """A certified motion along a tool path, or why no motion exists; result of :func:`pinproof.follow`."""

    not_pickled = ("checker",)

    status: FollowStatus = key("FOUND if there is a motion that is proven, else the reason")
    message: str = key("the outcome as text")
    path: ToolPath = key("the path as given, without repeated poses")
    pieces: tuple[PathPiece, ...] = key("the parts that can be followed without lifting the tool, in order", default=())
    blocked: tuple[BlockedPose, ...] = key("the poses that cannot be passed", default=())
    cuts: tuple[float, ...] = key(
        "the places, as indices of poses, at which the tool must be lifted at least; the fewest", default=()
    )
    transits: tuple[MotionPlan, ...] = key("the motions between the pieces", default=())
    trajectory: Solution[Trajectory] = key(
        "the whole motion with approaches, departures and transits, if FOUND", default=Solution()
    )
    certificate: Solution[Certificate] = key("the FREE certificate of the motion, if FOUND", default=Solution())
    motions: tuple[tuple[str, Trajectory], ...] = key(
        "its parts in order, with their names: approach, path, departure or transit", default=(), hidden=True
    )
    nodes: int = key("number of configurations of the grid that were compared", default=0)
    removed: int = key("number of edges that were removed because no curve along them is possible", default=0)
    rungs: int = key("number of rungs of the grid", default=0)
    checker: Solution[CollisionChecker] = key("the checker of the certificate", default=Solution())
    path_arm: Solution[PathArm] = key("the arm as seen from the frame of the path", default=Solution(), hidden=True)

    @property
    def ok(self) -> bool:
        """Whether a motion was found that is proven."""
        return self.status is FollowStatus.FOUND

    @property
    def arm(self) -> Arm:
        """The arm as seen from the frame of the path: its poses of the tool are those that follow the path."""
        return self.path_arm.arm

    @property
    def root_from_path(self) -> Array:
        """(4, 4) the pose of the frame of the path where the motion starts; without a motion, where it is blocked."""
        shown = [self.trajectory.start] if self.ok else [each.q for each in self.blocked if each.q is not None]
        group = self.checker.group
        return np.asarray(group.root_from_frame([*shown, group.home][0], self.arm.base).homogeneous)

    @property
    def cost(self) -> float:
        """The cost of the motion from rung to rung, summed over the pieces."""
        return float(sum(piece.cost for piece in self.pieces))

    @property
    def deviation(self) -> float:
        """Bound (m) of the distance of the tool from the path at every instant; NaN without a motion."""
        return max((piece.deviation for piece in self.pieces), default=math.nan)

    @property
    def rotation_deviation(self) -> float:
        """Bound (rad) of the angle of the tool to the path at every instant; NaN without a motion."""
        return max((piece.rotation_deviation for piece in self.pieces), default=math.nan)

    def to_dict(self) -> dict[str, Any]:
        """The figures, the blocked poses and the certificate as plain values for JSON."""
        found = {"ok": self.ok, "status": self.status.name, "message": self.message, "poses": len(self.path)}
        pieces = [
            {name: getattr(piece, name) for name in ("first", "last", "cost", "deviation", "rotation_deviation")}
            | {
                "speed": None if piece.trajectory is None else list(piece.speed),
                "ramps": list(piece.ramps),
                "slow": [list(each) for each in piece.slow],
            }
            | {"rotations": piece.rotations.tolist()}
            for piece in self.pieces
        ]
        blocked = [
            {
                "pose": each.pose,
                "last": each.last,
                "reason": each.obstruction.name,
                "message": each.message,
                "proven": each.proven,
            }
            for each in self.blocked
        ]
        found |= {"pieces": pieces, "blocked": blocked, "cuts": list(self.cuts), "notes": list(self.path.notes)}
        if self.ok:
            found |= {"duration": self.duration, "cost": self.cost, "certificate": self.certificate.to_dict()}
        return found | {"rungs": self.rungs, "nodes": self.nodes, "removed": self.removed}

    def _pictured(self) -> tuple[Trajectory | None, dict[str, Any]]:
        from pinproof.tool_paths.pictures import pictured

        place, shown = self.root_from_path, pictured({self.path.name: self})
        if self.ok:
            ends = {"start of the path": self.path.poses[0], "end of the path": self.path.poses[-1]}
            shown |= {"frames": {name: place @ pose for name, pose in ends.items()}}
            return self.trajectory, {**shown, "certificate": self.certificate}
        frames = {f"blocked {each.pose:g}": place @ each.place for each in self.blocked[:8]}
        return None, shown | {"frames": frames, "title": self.status.value}

    def _view(self) -> View:
        reasons = [each.message for each in self.blocked]
        rows = [
            [
                f"{piece.first:g} to {piece.last:g}",
                piece.cost,
                piece.deviation * 1e3,
                np.degrees(piece.rotation_deviation),
            ]
            for piece in self.pieces
        ]
        table = Rows(("poses", "cost", "deviation [mm]", "rotation [deg]"), rows) if rows else None
        grid = f"{self.rungs} rungs, {self.nodes:,} nodes, {self.removed} edges removed"
        found = [vars(self).get(name) for name in ("trajectory", "certificate")]
        lines = [*reasons, *self.path.notes, grid]
        return View(f"{self.status.name}: {self.message}", [table, lines, *found], lines, title=self.message)
