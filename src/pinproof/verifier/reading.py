"""The parts of a proof file, each checked for making sense by itself; what does not is refused with its place."""

from __future__ import annotations

import gzip
import hashlib
import json
import stat
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = [
    "FORMAT",
    "VERSION",
    "Body",
    "Curve",
    "Joint",
    "Refused",
    "body_digest",
    "curve_digest",
    "index",
    "items",
    "load",
    "member",
    "number",
    "numbers",
    "words",
]

Array = npt.NDArray[np.float64]

FORMAT, VERSION = "pinproof proof", 1

RIGID = 1e-9
"""How far the columns of a rotation, or an axis, may be from orthonormal; they are then made so."""

MEET = 1e-12
"""rad or m between the end of a piece of the curve and the start of the next: rounding, no jump."""

LARGEST = 1e6
"""Of any number but a parameter of the curve: beyond it double precision is too coarse for a proof."""

LEVELS = 3
"""How many sets of bodies there may be that each stand for a geometry: coarse and finer ones."""

LARGEST_FILE = 1 << 30
"""Bytes, packed or unpacked: what has more is no proof of ours."""


class Refused(ValueError):
    """What is wrong with a proof, beginning with the place."""


def load(path: str | Path) -> Any:
    """The parsed JSON of a file, packed with gzip or not; raises OSError or ValueError if it is none."""
    status = Path(path).stat()
    if not stat.S_ISREG(status.st_mode):  # a pipe would be waited on for ever
        raise ValueError("is a folder, a pipe or a device, not a file")
    if status.st_size > LARGEST_FILE:
        raise ValueError(f"holds {status.st_size} bytes; at most {LARGEST_FILE} are read")
    data = Path(path).read_bytes()
    if data[:2] == b"\x1f\x8b":
        try:
            with gzip.open(path) as file:
                data = file.read(LARGEST_FILE + 1)
        except (EOFError, zlib.error) as error:
            raise ValueError(f"is no whole gzip file: {error}") from error
    if len(data) > LARGEST_FILE:
        raise ValueError(f"unpacks to more than {LARGEST_FILE} bytes")
    try:
        return json.loads(data, object_pairs_hook=_once)
    except RecursionError as error:
        raise ValueError("is nested too deep") from error


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A mapping; a key that stands twice would be read in two ways by two readers."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError(f"a key stands twice among {', '.join(sorted(found))}")
    return found


def member(holder: Any, where: str, key: str) -> Any:
    """What stands under a key."""
    if not isinstance(holder, dict) or key not in holder:
        raise Refused(f"{where}{'.' if where else ''}{key}: is missing")
    return holder[key]


def items(holder: Any, where: str, key: str) -> list[Any]:
    """The list under a key."""
    found = member(holder, where, key)
    if not isinstance(found, list):
        raise Refused(f"{where}{'.' if where else ''}{key}: is no list")
    return found


def words(holder: Any, where: str, key: str, count: int) -> list[Any]:
    """The list under a key of rows of ``count`` entries, of which the first two are texts."""
    rows = items(holder, where, key)
    for row in rows:
        if not isinstance(row, list) or len(row) != count or not all(isinstance(word, str) for word in row[:2]):
            raise Refused(f"{where}{'.' if where else ''}{key}: {row!r} is no row of {count}, two names first")
    return rows


def numbers(holder: Any, where: str, key: str, shape: tuple[int | None, ...], largest: float = LARGEST) -> Array:
    """The finite numbers under a key, in an array of the given shape; None stands for any length."""
    place = f"{where}{'.' if where else ''}{key}"
    stated = member(holder, where, key)
    if isinstance(stated, list) and not stated and shape and shape[0] in (None, 0):
        return np.zeros([0, *(size or 0 for size in shape[1:])])
    try:
        array = np.array(stated)
    except (TypeError, ValueError, OverflowError):
        array = np.array("")
    if array.dtype.kind not in "if":
        raise Refused(f"{place}: is not made of numbers")
    if array.ndim != len(shape) or any(want not in (None, have) for want, have in zip(shape, array.shape, strict=True)):
        raise Refused(f"{place}: has the shape {array.shape}, not {shape}")
    if not (np.abs(array) <= largest).all() or not np.isfinite(array).all():
        raise Refused(f"{place}: holds a number that is not finite, or beyond {largest:g}")
    return array.astype(np.float64)


def number(holder: Any, where: str, key: str) -> float:
    """One finite number under a key."""
    return float(numbers(holder, where, key, ()))


def index(value: Any, low: int, end: int, where: str) -> int:
    """An integer from ``low`` to below ``end``."""
    if type(value) is not int or not low <= value < end:
        raise Refused(f"{where}: {value!r} is no index from {low} to below {end}")
    return value


def _placement(row: Any, where: str) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,), from three rows of four."""
    place = numbers(row, where, "placement", (3, 4))
    rotation, translation = place[:, :3], place[:, 3]
    off = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if not off <= RIGID or np.linalg.det(rotation) < 0:
        raise Refused(f"{where}.placement: is not rigid (off by {off:.3g})")
    return rotation @ (1.5 * np.eye(3) - 0.5 * rotation.T @ rotation), translation  # one Newton step to the nearest


class Joint:
    """A joint that turns about, or slides along, its axis by multiplier * q[leader] + offset; parent -1: the root."""

    def __init__(self, row: Any, k: int, dof: int) -> None:
        where = f"joints[{k}]"
        kind = member(row, where, "type")
        if kind not in ("turns", "slides"):
            raise Refused(f"{where}.type: {kind!r} is neither turns nor slides")
        self.turns = kind == "turns"
        self.parent = index(member(row, where, "parent"), -1, k, f"{where}.parent")
        self.leader = index(member(row, where, "leader"), 0, dof, f"{where}.leader")
        self.multiplier, self.offset = number(row, where, "multiplier"), number(row, where, "offset")
        axis = numbers(row, where, "axis", (3,))
        length = float(np.linalg.norm(axis))
        if not abs(length - 1.0) <= RIGID:
            raise Refused(f"{where}.axis: its length is {length}, not 1")
        self.axis = axis / length
        self.rotation, self.translation = _placement(row, where)


class Body:
    """A convex body: the hull of ``points``, each with a flat disc about z, grown by a ball and by an ellipsoid.

    ``half_space`` is what lies below its own z = 0. A body may have no shape; then no pair may hold it.
    """

    def __init__(self, row: Any, i: int, joints: int) -> None:
        self.where = where = f"bodies[{i}]"
        self.name, self.owner, self.geometry, self.kind, self.sha256 = (
            str(member(row, where, key)) for key in ("name", "owner", "geometry", "kind", "sha256")
        )
        if self.kind not in ("link", "attached", "obstacle"):
            raise Refused(f"{where}.kind: {self.kind!r} is neither link, attached nor obstacle")
        self.level = index(member(row, where, "level"), 0, LEVELS, f"{where}.level")
        self.joint = index(member(row, where, "joint"), -1, joints, f"{where}.joint")
        if self.kind == "obstacle" and self.joint != -1:
            raise Refused(f"{where}.joint: an obstacle moves with none")
        self.rotation, self.translation = _placement(row, where)
        shape = member(row, where, "shape")
        self.half_space, self.convex = shape == "half_space", shape is not None and shape != "half_space"
        if self.half_space and self.kind != "obstacle":
            raise Refused(f"{where}.shape: only an obstacle can be a half-space")
        self.centre, self.ball = np.zeros(3), np.inf
        if self.convex:
            self._read(shape, f"{where}.shape")
        if self.sha256 != body_digest(row):
            raise Refused(f"{where}.sha256: is not that of its place and shape")

    def _read(self, shape: Any, where: str) -> None:
        self.points = numbers(shape, where, "points", (None, 3))
        self.discs = numbers(shape, where, "disc_radii", (len(self.points),))
        self.semi = numbers(shape, where, "semi_axes", (3,))
        self.radius = number(shape, where, "radius")
        if not len(self.points) or min(self.radius, self.semi.min(), self.discs.min()) < 0:
            raise Refused(f"{where}: no points, or a radius below 0")
        self.centre = (self.points.min(axis=0) + self.points.max(axis=0)) / 2
        out = self.points - self.centre
        far = np.hypot(np.hypot(out[:, 0], out[:, 1]) + self.discs, out[:, 2])
        self.ball = float(far.max()) + self.radius + float(self.semi.max())

    def reach(self, directions: Array) -> Array:
        """The support function: the largest d . x of the body for directions d (..., 3) of any length, in its frame.

        Supports of Minkowski sums add up; that of a hull is the largest of its points' (Rockafellar 1970, section 13).
        """
        if self.half_space:
            return np.where(_straight_up(directions), 0.0, np.inf)
        most = directions @ self.points.T
        if self.discs.any():
            most = most + np.hypot(directions[..., 0], directions[..., 1])[..., None] * self.discs
        grown = self.radius * np.linalg.norm(directions, axis=-1) + np.linalg.norm(self.semi * directions, axis=-1)
        return np.asarray(most.max(axis=-1) + grown)


def _straight_up(directions: Array) -> npt.NDArray[np.bool_]:
    sideways = np.abs(directions[..., :2]).max(axis=-1)
    return np.asarray((sideways <= RIGID) & (directions[..., 2] > 0))


class Curve:
    """The curve: ``knots`` (k + 1,), Bernstein control points (k, degree + 1, n); ``pieces`` are those of some width.

    Where no piece has one, the curve is a single configuration.
    """

    def __init__(self, row: Any) -> None:
        names = items(row, "curve", "joint_names")
        if not names or not all(isinstance(name, str) for name in names) or len(set(names)) != len(names):
            raise Refused("curve.joint_names: are not different names")
        self.names, self.dof = tuple(names), len(names)
        self.knots = numbers(row, "curve", "knots", (None,), largest=np.inf)
        self.control = numbers(row, "curve", "control", (len(self.knots) - 1, None, self.dof))
        wide = np.diff(self.knots) > 0
        if self.control.size == 0 or (np.diff(self.knots) < 0).any():
            raise Refused("curve.knots: they must not fall, with a piece between each two")
        inside = np.ptp(self.control, axis=1).max(axis=1) * ~wide
        between = np.append(np.abs(self.control[1:, 0] - self.control[:-1, -1]).max(axis=1), 0.0)
        jumps = np.flatnonzero(np.maximum(inside, between) > MEET)
        if len(jumps):
            raise Refused(f"curve.control[{jumps[0]}]: the curve jumps there")
        self.low, self.high = float(self.knots[0]), float(self.knots[-1])
        solid = np.flatnonzero(wide) if wide.any() else np.zeros(1, dtype=np.int64)
        self.begins, self.ends, self.pieces = self.knots[solid], self.knots[solid + 1], self.control[solid]
        self.sha256 = curve_digest(self.names, self.knots, self.control)


def _digest(*parts: Any) -> str:
    """SHA-256 over texts and numbers, these as doubles with the least byte first."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part.encode() if isinstance(part, str) else np.asarray(part, dtype="<f8").tobytes())
    return digest.hexdigest()


def body_digest(row: Any) -> str:
    """The hash of a body: its joint, placement and the numbers of its shape, in the order of docs/certificates.md."""
    shape = row["shape"]
    parts: list[Any] = [row["joint"], row["placement"]]
    if isinstance(shape, dict):
        parts += [shape[key] for key in ("points", "disc_radii", "radius", "semi_axes")]
    return _digest(*parts, shape if isinstance(shape, str) else "")


def curve_digest(names: tuple[str, ...], knots: Array, control: Array) -> str:
    """The hash of a curve: joint names and shape as text, knots, control points; certificates carry the same."""
    return _digest(repr((names, control.shape)), knots, control)
