"""Paths of a tool: poses in order, with the speed of the tool between them, checked when they are made."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pinproof.common.results import Rows, Shown, View
from pinproof.common.structs import Accepting, described, key
from pinproof.common.validation import require_integer
from pinproof.errors import InputError
from pinproof.spatial import SE3, Array, finite, interpolate, rigid_many, rigid_matrix
from pinproof.units import MOST_REACH, hint_at_unit, refuse_millimetres

# Distance (m) and angle (rad) up to which consecutive poses are equal: a tenth of the accuracy of inverse kinematics.
SAME_POSITION, SAME_ANGLE = 1e-7, 1e-7
# Length below which a direction has no direction.
ZERO = 1e-9
# Cosine of the largest angle between two lines at which the path counts as a curve.
SLIGHT = 0.9
# m/s: faster tools are stated in mm/s by mistake.
FASTEST = 10.0
# m: longest approach and departure; longer ones are stated in other units.
LONGEST_LINE = 10.0
NO_POSE = "the tool path has no pose; give at least one"


@described(eq=False, repr=False)
class ToolPath(Shown):
    """A path of the tool: straight lines between poses, on which the orientation rotates about one fixed axis.

    The z axis of the tcp is the axis of the tool. Consecutive poses that are equal become one, which a note states.

    Raises
    ------
    InputError
        If there is no pose, a pose is not rigid, a number is not finite, a length is probably in millimetres, or a
        speed is not above 0 or probably in mm/s.
    """

    poses: Accepting[Array, npt.ArrayLike | Sequence[SE3]] = key("(N, 4, 4) ``base_from_tcp``", hidden=True)
    speed: Accepting[Array | None, npt.ArrayLike | None] = key(
        "speed of the tcp (m/s) on the lines: one number, or (N - 1,); None for as fast as the joints permit",
        default=None, hidden=True,
    )  # fmt: skip
    name: str = key("name of the path", default="path")
    names: Accepting[tuple[str, ...], Iterable[str]] = key("the names of the poses", default=(), hidden=True)
    notes: tuple[str, ...] = key("what was changed of the path as given", default=(), hidden=True)

    def __post_init__(self) -> None:
        poses = rigid_many("poses", self.poses)
        count = len(poses)
        if not count:
            raise InputError(NO_POSE)
        refuse_millimetres("poses", np.abs(poses[:, :3, 3]).max(axis=1).tolist())
        _refuse_long(poses[:, :3, 3])
        speed = None
        if self.speed is not None:
            given = np.asarray(self.speed, dtype=float)
            speed = np.full(count - 1, float(given)) if given.ndim == 0 else finite("speed", given, (count - 1,))
            if count == 1 and given.ndim == 0:
                finite("speed", [given], (1,))
            bad = ~((speed > 0.0) & (speed <= FASTEST))
            if bad.any():
                hint = "; speeds are in m/s, and this looks like mm/s" if speed[bad][0] > FASTEST else ""
                raise InputError(f"speed {speed[bad][0]:g} m/s must be above 0 and at most {FASTEST:g}{hint}")
        names = tuple(map(str, self.names)) or tuple(f"pose {number}" for number in range(count))
        if len(names) != count:
            raise InputError(f"names has {len(names)} names for {count} poses; state one for each pose")
        # Equal poses become one
        moved = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1) > SAME_POSITION
        turned = np.linalg.norm(np.diff(poses[:, :3, :3], axis=0), axis=(1, 2)) > np.sqrt(2.0) * SAME_ANGLE
        kept = np.concatenate([[True], moved | turned])
        notes = self.notes
        if not kept.all():
            repeated = [names[index] for index in np.flatnonzero(~kept)]
            more = ", ..." if len(repeated) > 5 else ""
            notes = (*notes, f"{len(repeated)} poses repeat the one before: {', '.join(repeated[:5])}{more}")
            poses, names = poses[kept], tuple(name for name, keep in zip(names, kept, strict=True) if keep)
            speed = None if speed is None else speed[kept[1:]]
        for field, value in (("poses", poses), ("speed", speed), ("names", names), ("notes", notes)):
            if isinstance(value, np.ndarray):
                value = value.copy()
                value.setflags(write=False)
            object.__setattr__(self, field, value)

    @classmethod
    def through(
        cls,
        points: npt.ArrayLike,
        normals: npt.ArrayLike,
        *,
        speed: npt.ArrayLike | None = None,
        name: str = "path",
        names: Iterable[str] = (),
    ) -> ToolPath:
        """The path through points of a surface, with the axis of the tool against the normals.

        The x axis of each pose points along the path, as far as the axis of the tool permits.

        Parameters
        ----------
        points
            (N, 3) in the base frame.
        normals
            (N, 3) or (3,) outward normals of the surface: the z axis of the tcp points in the opposite direction. They
            need not have length 1.
        speed, name, names
            As for the constructor.

        Raises
        ------
        InputError
            Also if a normal has length 0; the message states its number.
        """
        places = finite("points", points, (None, 3))
        if not len(places):
            raise InputError(NO_POSE)
        refuse_millimetres("points", np.abs(places).max(axis=1, initial=0.0).tolist())
        _refuse_long(places)
        given = np.asarray(normals, dtype=float)
        axes = -finite("normals", np.tile(given, (len(places), 1)) if given.ndim == 1 else given, (len(places), 3))
        with np.errstate(over="ignore"):
            sizes = finite("lengths of normals", np.linalg.norm(axes, axis=1), (len(places),))
        if (sizes < ZERO).any():
            raise InputError(f"normal {int((sizes < ZERO).argmax())} has length 0; every point needs a direction")
        z = axes / sizes[:, None]
        # The direction of travel at each point, at the ends of an open path by extrapolation of slight bends
        steps = np.diff(places, axis=0)
        lengths = np.linalg.norm(steps, axis=1, keepdims=True)
        steps = np.divide(steps, lengths, out=np.zeros_like(steps), where=lengths > 0.0)
        along = np.zeros((1, 3)) if len(places) < 2 else np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
        if len(places) > 2 and np.linalg.norm(places[0] - places[-1]) < SAME_POSITION:
            along[0] = along[-1] = steps[0] + steps[-1]
        elif len(places) > 2:
            for end, beside in ((0, 1), (-1, -2)):
                if steps[end] @ steps[beside] > SLIGHT:
                    along[end] = 1.5 * steps[end] - 0.5 * steps[beside]
        moving = np.flatnonzero(np.linalg.norm(along, axis=1) > ZERO)
        poses, previous = np.tile(np.eye(4), (len(places), 1, 1)), along[moving[0]] if len(moving) else np.zeros(3)
        for index, (axis, travel) in enumerate(zip(z, along, strict=True)):
            for x in (travel, previous, np.eye(3)[int(np.abs(axis).argmin())]):
                across = x - (x @ axis) * axis
                if np.linalg.norm(across) > 1e-6 * max(float(np.linalg.norm(x)), ZERO):
                    break
            x = across / np.linalg.norm(across)
            poses[index, :3, :3] = np.column_stack([x, np.cross(axis, x), axis])
            poses[index, :3, 3] = places[index]
            previous = x
        return cls(poses, speed, name, names)

    def transformed(self, a_from_b: SE3 | npt.ArrayLike) -> ToolPath:
        """The path, stated in a frame b, in a frame a."""
        return replace(self, poses=rigid_matrix("a_from_b", a_from_b) @ self.poses)

    def reversed(self) -> ToolPath:
        """The path from its end to its start, with the same poses."""
        speed = None if self.speed is None else self.speed[::-1]
        return replace(self, poses=self.poses[::-1], speed=speed, names=self.names[::-1])

    def started_at(self, index: int) -> ToolPath:
        """A closed path from one of its poses through all others and back to it.

        Raises
        ------
        InputError
            If the path is not closed, or has no pose of this index.
        """
        if not self.closed:
            raise InputError(f"tool path {self.name!r} is not closed; it starts at its first pose only")
        index = require_integer("index", index, 0, len(self) - 1) % (len(self) - 1)
        order = np.append(np.roll(np.arange(len(self) - 1), -index), index)
        speed = None if self.speed is None else np.roll(self.speed, -index)
        return replace(self, poses=self.poses[order], speed=speed, names=[self.names[k] for k in order])

    @cached_property
    def lengths(self) -> Array:
        """(N - 1,) distances (m) from each pose to the next."""
        return np.asarray(np.linalg.norm(np.diff(self.poses[:, :3, 3], axis=0), axis=1))

    @property
    def length(self) -> float:
        """M: of the whole path."""
        return float(self.lengths.sum())

    @property
    def closed(self) -> bool:
        """Whether the path ends at the point at which it begins, with the same axis of the tool."""
        first, last = self.poses[0], self.poses[-1]
        apart = np.linalg.norm(last[:3, 3] - first[:3, 3]), np.linalg.norm(last[:3, 2] - first[:3, 2])
        return bool(len(self) > 2 and max(apart) < 1e-6)

    def at(self, places: npt.ArrayLike) -> Array:
        """(k, 4, 4) the poses at indices (k,) of poses; a fraction is a place on the line between two poses."""
        here = np.clip(finite("places", places, (None,)), 0.0, len(self) - 1.0)
        first = np.minimum(here.astype(int), max(len(self) - 2, 0))
        ends = [SE3(each[:3, :3], each[:3, 3]) for each in self.poses]
        return np.array([
            interpolate(ends[k], ends[min(k + 1, len(ends) - 1)], share).homogeneous
            for k, share in zip(first.tolist(), (here - first).tolist(), strict=True)
        ]).reshape(-1, 4, 4)  # fmt: skip

    @property
    def duration(self) -> float:
        """S: of the path at the stated speed; 0 where none is stated."""
        return 0.0 if self.speed is None else float((self.lengths / self.speed).sum())

    def __len__(self) -> int:
        return len(self.poses)

    def _view(self) -> View:
        speed = "" if self.speed is None or not len(self.speed) else f", {self.speed.min() * 1e3:g} mm/s"
        if speed and self.speed is not None and np.ptp(self.speed) > 0.0:
            speed = f", {self.speed.min() * 1e3:g} to {self.speed.max() * 1e3:g} mm/s"
        head = f"{self.name!r}, {len(self)} poses, {self.length:.4g} m{speed}{', closed' if self.closed else ''}"
        rows = ([name, *pose[:3, 3], *pose[:3, 2]] for name, pose in zip(self.names, self.poses, strict=True))
        columns = ("pose", "x [m]", "y [m]", "z [m]", "tool x", "tool y", "tool z")
        return View(head, [self.notes, Rows(columns, rows, len(self))], self.notes)


def _refuse_long(places: Array) -> None:
    """InputError if positions (N, 3) extend over more than a robot reaches."""
    with np.errstate(over="ignore"):
        size = float(np.ptp(places, axis=0).max())
    if size > MOST_REACH:
        raise InputError(f"the tool path extends over {size:g} m; {hint_at_unit(size, 'm')}")
