"""Properties of a robot and of one of its arms as plain values, and the description of the arm's joint axes.

Whether neighbouring axes are parallel or intersect does not depend on q. It decides whether the inverse kinematics has
a closed form: three intersecting or three parallel axes suffice (Pieper 1968).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from pinproof.common.results import Rows, Shown, View
from pinproof.common.structs import described, key
from pinproof.spatial import Array

PARALLEL_TOLERANCE = 1e-4
"""Rad. Axes closer to parallel than this count as parallel: URDF files write 1.5708 for pi/2 (an error of 4e-6)."""

MEETING_TOLERANCE = 1e-5
"""Metres. Axes that pass a common point closer than this count as intersecting (4e-6 rad on an arm of 2 m)."""

SAMPLES = 3
"""Number of configurations compared: in a single one, axes may intersect by chance."""


def describe_axes(angular: npt.NDArray[np.bool_], twists: Sequence[Array], *, coupled: bool) -> str:
    """Describe the joint axes of an arm in one sentence; see :func:`pinproof.model.kinematic_class`.

    ``angular`` is (n,) False for a prismatic joint; ``twists`` are the (6, n) Jacobians with reference ``WORLD`` at
    several configurations; ``coupled`` states whether a joint between the base and the tcp is a mimic joint.
    """
    n = len(angular)
    pattern = "".join("R" if is_angular else "P" for is_angular in angular)
    kinds = [
        f"{pattern.count(letter)} {word}"
        for letter, word in (("R", "revolute"), ("P", "prismatic"))
        if letter in pattern
    ]
    head = f"{' and '.join(kinds)} joint{'s' if n > 1 else ''} ({pattern})"
    if coupled:
        return f"{head}: coupled by mimic joints on the chain"
    features, first = list[str](), 0
    # triples of neighbouring revolute axes that intersect in one point, at all configurations
    for i in range(n - 2):
        three = slice(i, i + 3)
        if angular[three].all() and all(_distance_from_common_point(t[:, three]) < MEETING_TOLERANCE for t in twists):
            place = "wrist" if i == n - 3 else "shoulder" if i == 0 else "joint"
            features.append(f"spherical {place} (joints {_numbers(i, i + 3)})")
    # runs of three or more neighbouring parallel axes
    axes = np.where(angular, twists[0][3:], twists[0][:3]).T
    same = [bool(np.linalg.norm(np.cross(a, b)) < PARALLEL_TOLERANCE) for a, b in pairwise(axes)]
    for end in range(1, n + 1):
        if end < n and same[end - 1]:
            continue
        if end - first >= 3:
            count = {3: "three", 4: "four"}.get(end - first, str(end - first))
            run = f"{count} parallel axes (joints {_numbers(first, end)})"
            features.append("all axes parallel" if end - first == n else run)
        first = end
    if n > 6:
        features.append(f"redundant by {n - 6}")
    if n < 6:
        features.append("fewer than six joints: most poses cannot be reached exactly")
    return f"{head}: {'; '.join(features or ['no three neighbouring axes intersect in a point or are parallel'])}"


def _distance_from_common_point(twists: Array) -> float:
    """Return the largest distance (m) of three lines, given as twists (6, 3), from the point closest to all of them.

    The axis of a revolute joint has the direction w and passes through w x v. The closest point x solves
    sum (I - w w^T) (x - w x v) = 0, which has no unique solution where all w are parallel (the result is then inf).
    """
    axes, points = twists[3:].T, np.cross(twists[3:].T, twists[:3].T)
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    total = across.sum(axis=0)
    if np.linalg.eigvalsh(total)[0] < PARALLEL_TOLERANCE**2:
        return np.inf
    nearest = np.linalg.solve(total, np.einsum("kij,kj->i", across, points))
    return float(np.linalg.norm(np.einsum("kij,kj->ki", across, nearest - points), axis=1).max())


def _numbers(first: int, end: int) -> str:
    return ", ".join(str(i + 1) for i in range(first, end))


Role = Literal["arm", "follower", "held", "fixed"]


@described()
class JointInfo:
    """Properties of one joint of the robot."""

    name: str = key("its name, as in the URDF")
    type: str = key("its type, as in the URDF")
    parent: str = key("the link before it")
    child: str = key("the link that it moves")
    role: Role = key(
        "``arm``: one of the joints of q. ``follower``: a mimic joint that moves with one of them. ``held``: a "
        "joint outside the arm, held at ``held_at`` (rad or m; None for a floating or planar joint). ``fixed``: a "
        "fixed joint"
    )
    lower: float | None = key("the limit in use; None if unlimited", "rad or m")
    upper: float | None = key("the limit in use; None if unlimited", "rad or m")
    velocity: float | None = key("the limit in use; None if unlimited or unknown", "rad/s or m/s")
    acceleration: float | None = key("the limit in use; None if unlimited or unknown", "rad/s^2 or m/s^2")
    held_at: float | None = key("where a joint outside the arm is held; None for others", "rad or m", default=None)
    mimic: str = key('``"multiplier * leader + offset"`` of a mimic joint, else empty', default="")
    effort: float | None = key("the largest torque or force, in N m or N; None if unknown", default=None)

    def row(self) -> tuple[str, ...]:
        """The cells of a table: name, type, limits, speed, acceleration, effort and role."""
        figures = (self.lower, self.upper, self.velocity, self.acceleration, self.effort)
        low, high, *others = ("-" if value is None else f"{value:.4g}" for value in figures)
        role = {"follower": f"= {self.mimic}", "held": "held at neutral"}.get(self.role, self.role)
        if self.held_at is not None:
            role = f"held at {self.held_at:.4g}"
        return self.name, self.type, f"{low} .. {high}", *others, role


EFFECT_SAMPLES = 2000
"""Number of configurations at which a calibrated arm is compared with the nominal one."""


@described()
class CalibrationEffect:
    """What a calibration changes at the tcp, at random configurations within the limits."""

    source: str = key("a sentence with the file of the calibration")
    mean_shift: float = key("mean distance of the calibrated tcp from the nominal one", "m")
    largest_shift: float = key("largest distance", "m")
    mean_rotation: float = key("mean angle between both orientations", "rad")
    largest_rotation: float = key("largest angle", "rad")
    configurations: int = key("number of configurations")

    def __str__(self) -> str:
        shifts, angles = (self.mean_shift, self.largest_shift), (self.mean_rotation, self.largest_rotation)
        mean, most = (f"{1e3 * s:.3g} mm and {1e3 * a:.3g} mrad" for s, a in zip(shifts, angles, strict=True))
        moved = f"moves the tcp by {mean} on average and at most {most}"
        return f"{self.source}, which {moved} ({self.configurations} random configurations)"


@described()
class RobotInfo(Shown):
    """Properties of a robot and of one of its arms; made by :meth:`pinproof.Robot.info`."""

    name: str = key("name of the robot")
    source: str = key("its file; empty for a robot from text")
    base: str = key("base link of the arm")
    tcp: str = key("tcp frame of the arm")
    dof: int = key("number of joints of the arm")
    kinematic_class: str = key("description of the joint axes (:func:`pinproof.model.kinematic_class`)")
    joints: tuple[JointInfo, ...] = key("all joints of the robot, in the order of the file")
    frames: tuple[str, ...] = key("all links, in the order of the file; each can be a base or a tcp")
    collisions: Mapping[str, int] = key("number of collision geometries by kind")
    visuals: Mapping[str, int] = key("number of visual geometries by kind")
    groups: tuple[str, ...] = key("names of the groups of the SRDF")
    states: tuple[str, ...] = key("names of its states")
    end_effectors: tuple[str, ...] = key("names of its end effectors")
    disabled_pairs: tuple[tuple[str, str, str], ...] = key(
        "pairs of links that the SRDF excludes from collision checking: (link, link, reason)"
    )
    home: Mapping[str, float] = key("home configuration of the arm: joint name to rad or m")
    acceleration_source: str = key("where the acceleration limits come from")
    missing: tuple[str, ...] = key(
        "sentences about missing or inconsistent data: no SRDF, no limits, meshes not found, unknown names"
    )
    calibration: CalibrationEffect | None = key(
        "what the calibration changes; None for a robot without one", default=None
    )

    def to_dict(self) -> dict[str, Any]:
        """Return nested dicts and lists that JSON can represent, without NaN and infinity."""
        plain: dict[str, Any] = json.loads(json.dumps(asdict(self), allow_nan=False))
        return plain

    def _view(self) -> View:
        names = ("name", "type", "role", "parent", "child", "lower", "upper", "velocity", "acceleration")
        table = Rows(names, ([getattr(joint, name) for name in names] for joint in self.joints))
        facts = (self.kinematic_class, f"Acceleration limits: {self.acceleration_source}", *self.missing)
        lines = (self.kinematic_class, *self.missing)
        return View(self._headline, [facts, table], lines, title=f"{self._headline} (rad or m)")

    def to_text(self) -> str:
        """The moving joints in a table, the frames, the geometries, the home configuration, and what is missing."""
        columns = ("joint", "type", "limits", "speed", "accel.", "effort", "role")
        lists = {"groups": self.groups, "states": self.states, "end effectors": self.end_effectors}
        geometry = ", ".join(f"{count} {kind}" for kind, count in self.collisions.items()) or "none"
        lines = [
            f"{self.name}: {self.dof} joints from {self.base} to {self.tcp}; {self.kinematic_class}",
            f"file: {self.source}" if self.source else "loaded from text",
            *(() if self.calibration is None else (str(self.calibration),)),
            *Rows(columns, [joint.row() for joint in self.joints if joint.role != "fixed"]).text(),
            f"frames: {', '.join(self.frames)}",
            f"collision geometry: {geometry}",
            *(f"{name}: {', '.join(values)}" for name, values in lists.items() if values),
            "home: " + ", ".join(f"{name} {value:.4g}" for name, value in self.home.items()),
            *(f"missing: {sentence}" for sentence in self.missing),
        ]
        return "\n".join(lines)

    @property
    def _headline(self) -> str:
        count = f"{self.dof} joint{'' if self.dof == 1 else 's'}"
        return f"{self.name}, {self.base} -> {self.tcp}, {count} of {len(self.joints)} in the robot"
