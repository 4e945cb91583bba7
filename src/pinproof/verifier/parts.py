"""Reads the parts of a proof file, each checked by itself: values, joints, bodies and the curve.

Nothing is converted silently: a number is a JSON number (no boolean, no text), an integer is an integer, a text is a
printable text, and a field that this version does not define is refused. Errors state the place in the file.
"""

from __future__ import annotations

import copy
import gzip
import hashlib
import io
import json
import math
import reprlib
import stat
import zlib
from itertools import chain, product
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .rounding import ROOT_3, TINY, UNIT_ROUNDOFF, UP, Near, sine_cosine

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

LARGEST = 1e6
"""Largest magnitude of a number by default: double precision is too coarse for a proof beyond it."""

EXACT_INTEGER = 1 << 53
"""Up to this number every integer is a double."""

LONGEST_INTEGER = 20
"""Largest number of digits of an integer; longer integers are refused before they are converted."""

LARGEST_FILE = 1 << 28
"""Largest size (bytes) of a file, compressed or not: about a thousand times that of a proof."""


class Refused(ValueError):
    """A fault of a proof; the message begins with the place in the file."""


def load(path: str | Path) -> Any:
    """Return the parsed JSON of a file, compressed with gzip or not.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not JSON, repeats a key, or holds a number that is not a finite double.
    """
    status = Path(path).stat()
    if not stat.S_ISREG(status.st_mode):  # reading a pipe would never end
        raise ValueError("is a folder, a pipe or a device, not a file")
    if status.st_size > LARGEST_FILE:
        raise ValueError(f"holds {status.st_size} bytes; at most {LARGEST_FILE} are read")
    # Compressed or not, no more than the limit is read.
    data = Path(path).read_bytes()
    if data[:2] == b"\x1f\x8b":
        try:
            with gzip.open(io.BytesIO(data)) as file:
                data = file.read(LARGEST_FILE + 1)
        except (EOFError, zlib.error) as error:
            raise ValueError(f"is not a complete gzip file: {error}") from error
    if len(data) > LARGEST_FILE:
        raise ValueError(f"holds more than {LARGEST_FILE} bytes after decompression")
    try:
        return json.loads(
            data, object_pairs_hook=_unique_keys, parse_constant=_finite, parse_float=_finite, parse_int=_short_integer
        )
    except RecursionError as error:
        raise ValueError("is nested too deeply") from error


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a mapping, and refuse repeated keys, of which readers may use either."""
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f"the key {shown(key)} is repeated")
        found[key] = value
    return found


def _finite(literal: str) -> float:
    value = float(literal)
    if not math.isfinite(value):
        raise ValueError(f"{literal[:LONGEST_INTEGER]} is not a finite double")
    return value


def _short_integer(literal: str) -> int:
    if len(literal) > LONGEST_INTEGER:
        raise ValueError(f"an integer has {len(literal)} digits; at most {LONGEST_INTEGER} are read")
    return int(literal)


def shown(value: Any) -> str:
    """Return a short text of any value for messages."""
    if isinstance(value, int) and not -EXACT_INTEGER <= value <= EXACT_INTEGER:
        return f"an integer of {value.bit_length()} bits"
    return ascii(value) if isinstance(value, str) and len(value) < 80 else reprlib.repr(value)


def _place(where: str, key: str) -> str:
    return f"{where}.{key}" if where else key


def member(holder: Any, where: str, key: str) -> Any:
    """Return the value of a key."""
    if not isinstance(holder, dict):
        raise Refused(f"{where or 'proof'}: must be a mapping")
    if key not in holder:
        raise Refused(f"{_place(where, key)}: is missing")
    return holder[key]


def check_fields(holder: Any, where: str, known: tuple[str, ...]) -> None:
    """Refuse a mapping with an unknown key, because its meaning is not known."""
    unknown = [key for key in holder if key not in known] if isinstance(holder, dict) else []
    if unknown:
        raise Refused(f"{where or 'proof'}: unknown field {shown(unknown[0])}; known are {', '.join(known)}")


def items(holder: Any, where: str, key: str) -> list[Any]:
    """Return the list of a key."""
    found = member(holder, where, key)
    if type(found) is not list:
        raise Refused(f"{_place(where, key)}: must be a list")
    return found


def text(holder: Any, where: str, key: str) -> str:
    """Return the text of a key, which must be printable: control characters could forge messages that contain it."""
    found = member(holder, where, key)
    if not is_text(found):
        raise Refused(f"{_place(where, key)}: must be a printable text, not {shown(found)}")
    return str(found)


def is_text(value: Any) -> bool:
    """Whether a value is a text that is not empty and has no control characters."""
    return type(value) is str and value != "" and value.isprintable()


def rows_of_names(holder: Any, where: str, key: str) -> list[Any]:
    """Return the list of a key, whose rows are two different names and a third entry of any kind."""
    rows = items(holder, where, key)
    for k, row in enumerate(rows):
        if type(row) is not list or len(row) != 3 or not all(map(is_text, row[:2])) or row[0] == row[1]:
            place = f"{_place(where, key)}[{k}]"
            raise Refused(f"{place}: must be two different names and a third entry, not {shown(row)}")
    return rows


def numbers(holder: Any, where: str, key: str, shape: tuple[int | None, ...], largest: float = LARGEST) -> Array:
    """Return the finite numbers of a key as an array of the given shape; None is any length, that of the first list."""
    place, sizes, found = _place(where, key), list[int](), [member(holder, where, key)]
    for depth, size in enumerate(shape):
        for other in found if {*map(type, found)} - {list} else ():
            if type(other) is not list:
                raise Refused(f"{place}: must be {len(shape) - depth} nested lists of numbers, not {shown(other)}")
        sizes.append(size if size is not None else len(found[0]) if found else 0)
        lengths = {*map(len, found)} - {sizes[-1]}
        if lengths:
            raise Refused(f"{place}: must have {sizes[-1]} entries, not {min(lengths)}")
        found = list(chain.from_iterable(found))
    # A boolean is no number, and a large integer is no double.
    for each in found if {*map(type, found)} - {float} else ():
        if type(each) is not float and (type(each) is not int or abs(each) > EXACT_INTEGER):
            raise Refused(f"{place}: must be a number within double precision, not {shown(each)}")
    array = np.array(found, dtype=np.float64)
    if not (np.abs(array) <= largest).all():  # also true for NaN
        raise Refused(f"{place}: a number is not finite, or its magnitude is above {largest:g}")
    return array.reshape(sizes)


def optional_numbers(holder: Any, where: str, key: str, count: int, missing: float) -> Array:
    """Return ``count`` numbers of a key, of which null is read as ``missing``."""
    values = items(holder, where, key)
    known = [0.0 if value is None else value for value in values]
    return np.where([value is None for value in values], missing, numbers({key: known}, where, key, (count,)))


def number(holder: Any, where: str, key: str) -> float:
    """Return the finite number of a key."""
    return float(numbers(holder, where, key, ()))


def index(value: Any, low: int, end: int, where: str) -> int:
    """Return an index, which must be an integer from ``low`` to below ``end``."""
    if type(value) is not int or not low <= value < end:
        raise Refused(f"{where}: must be an index from {low} to below {end}, not {shown(value)}")
    return value


RIGID = 1e-9
"""Largest error of rotation matrices and unit vectors: what is meant is the nearest rotation, and the unit vector."""

UNIT_ERROR = 8 * UNIT_ROUNDOFF
"""Error of normalised vectors: 2.5 roundings of the length, and one of the quotient."""

JUMP = 1e-12
"""rad or m between the end of a piece and the start of the next; bounds include deviations by the largest jump."""

LARGEST_PARAMETER = 1e12
"""Largest magnitude of a curve parameter: 30,000 years in seconds, and differences are far from overflowing."""

FASTEST = 1e6
"""rad or m per unit of the curve's parameter. A piece in which a joint moves faster is too narrow for its motion:
readers that round parameters (trajectory messages have nanoseconds) would lose the piece, and its motion with it."""

LIMIT_SLACK = 1.1e-6
"""Rad or m, of rates relative: by how much a curve may exceed its limits. It is above the 1e-6 of the maker of proofs,
so that rounding does not decide."""

EPSILON = float(np.finfo(float).eps)

ROUNDINGS = 8
"""Rounding errors of each control point, in units in the last place. In a piece of nanoseconds they are accelerations
of thousands of rad/s^2."""

IMPULSE = 0.011
"""rad or m, or per s: the sum of what these errors may change positions, or speeds, in all pieces that they decide."""

BISECTIONS = 60
"""Maximum number of bisections of a piece near its limits: it then has the resolution of a double."""

BOXED = 64
"""A range of more triangles is represented by the box around it."""

LEVELS = 3
"""Number of levels of detail, from coarse to fine, on which bodies may represent a geometry."""


def rotation_error(within: float) -> float:
    """Return the error of the rotation of a placement, in the norm of all entries, which are known within a number.

    The Newton step has an error of 1.5 x^2 where singular values are 1 + x, less than 1e-17, and 12 roundings. The
    nearest rotation changes by as much as the matrix (Higham 2008, "Functions of matrices", theorem 8.9).
    """
    return 16 * UNIT_ROUNDOFF + 4.0 * within


def placement(row: Any, where: str, within: float) -> tuple[Near, Near]:
    """Return rotation (3, 3) and translation (3,) of three rows of four numbers: the nearest rotation is meant."""
    place = numbers(row, where, "placement", (3, 4))
    rotation, translation = place[:, :3], place[:, 3]
    off = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if not off <= RIGID or np.linalg.det(rotation) < 0:
        raise Refused(f"{where}.placement: is not rigid (off by {off:.3g})")
    rotation = rotation @ (1.5 * np.eye(3) - 0.5 * rotation.T @ rotation)  # one Newton step to the nearest
    return Near(rotation, rotation_error(within)), Near(translation, ROOT_3 * within)


def unit_vector(row: Any, where: str, key: str, within: float) -> Near:
    """Return the unit vector (3,) of a key, normalised."""
    vector = numbers(row, where, key, (3,))
    length = float(np.linalg.norm(vector))
    if not abs(length - 1.0) <= RIGID:
        raise Refused(f"{where}.{key}: its length must be 1, not {length}")
    return Near(vector / length, UNIT_ERROR + 4.0 * within, 1.0 + UNIT_ERROR)


class Joint:
    """A revolute or prismatic joint whose value is multiplier * q[leader] + offset; parent -1 is the root."""

    FIELDS = ("name", "type", "axis", "placement", "parent", "leader", "multiplier", "offset")

    def __init__(self, row: Any, k: int, dof: int, within: float = 0.0) -> None:
        where = f"joints[{k}]"
        check_fields(row, where, self.FIELDS)
        text(row, where, "name")
        kind = member(row, where, "type")
        if kind not in ("revolute", "prismatic"):
            raise Refused(f"{where}.type: must be revolute or prismatic, not {shown(kind)}")
        self.revolute = kind == "revolute"
        self.parent = index(member(row, where, "parent"), -1, k, f"{where}.parent")
        self.leader = index(member(row, where, "leader"), 0, dof, f"{where}.leader")
        self.multiplier, self.offset = number(row, where, "multiplier"), number(row, where, "offset")
        self.axis = unit_vector(row, where, "axis", within)
        self.rotation, self.translation = placement(row, where, within)


class Body:
    """A convex body: the hull of ``points``, each with a flat disc about z, grown by a ball and by an ellipsoid.

    ``half_space`` is everything below the body's own z = 0. A body may have no shape; then it can be in no pair.

    A mesh consists of triangles, which are proven apart from other bodies in ranges: the points of a range are the
    corners of its triangles, or of the box around them if there are many, and its hull contains the triangles. If the
    mesh is solid, the points about which its triangles wind belong to it too.
    """

    FIELDS = ("name", "owner", "kind", "geometry", "level", "source", "mesh_sha256", "joint", "placement", "shape",
              "sha256")  # fmt: skip
    SHAPE = ("points", "disc_radii", "radius", "semi_axes")
    MESH = ("vertices", "triangles", "solid")

    def __init__(self, row: Any, i: int, joints: int, within: float = 0.0) -> None:
        self.where = where = f"bodies[{i}]"
        check_fields(row, where, self.FIELDS)
        self.name, self.owner, self.geometry, self.kind, self.sha256 = (
            text(row, where, key) for key in ("name", "owner", "geometry", "kind", "sha256")
        )
        if self.kind not in ("link", "attached", "obstacle"):
            raise Refused(f"{where}.kind: must be link, attached or obstacle, not {shown(self.kind)}")
        self.level = index(member(row, where, "level"), 0, LEVELS, f"{where}.level")
        self.joint = index(member(row, where, "joint"), -1, joints, f"{where}.joint")
        if self.kind == "obstacle" and self.joint != -1:
            raise Refused(f"{where}.joint: an obstacle moves with no joint; it must be -1")
        self.rotation, self.translation = placement(row, where, within)
        shape = member(row, where, "shape")
        self.half_space, self.bounded = shape == "half_space", shape is not None and shape != "half_space"
        if self.half_space and self.kind != "obstacle":
            raise Refused(f"{where}.shape: only an obstacle can be a half-space")
        self.centre, self.ball = np.zeros(3), np.inf
        self.triangles, self.solid = np.empty((0, 3), dtype=np.int64), False
        self.is_mesh = isinstance(shape, dict) and "triangles" in shape
        if self.is_mesh:
            self._read_mesh(shape, f"{where}.shape")
        elif self.bounded:
            where = f"{where}.shape"
            check_fields(shape, where, self.SHAPE)
            points = numbers(shape, where, "points", (None, 3))
            discs = numbers(shape, where, "disc_radii", (len(points),))
            semi, radius = numbers(shape, where, "semi_axes", (3,)), number(shape, where, "radius")
            if not len(points) or min(radius, semi.min(), discs.min()) < 0:
                raise Refused(f"{where}: must have points, and no radius below 0")
            self._set(points, discs, radius, semi)
        if self.sha256 != body_digest(row):
            raise Refused(f"{self.where}.sha256: does not match the joint, placement and shape in the file")

    def _set(self, points: Array, discs: Array, radius: float, semi: Array) -> None:
        """Set the shape, and a ball around it.

        The ball is about the middle of the points, as large as the farthest disc with what it grows.
        """
        self.points, self.discs, self.radius, self.semi = points, discs, radius, semi
        self.centre = (points.min(axis=0) + points.max(axis=0)) / 2
        out = points - self.centre
        far = np.sqrt((np.sqrt(out[:, 0] ** 2 + out[:, 1] ** 2) + discs) ** 2 + out[:, 2] ** 2)
        self.ball = (float(far.max()) + radius + float(semi.max())) * (1.0 + 16 * UNIT_ROUNDOFF) + TINY

    def _read_mesh(self, shape: Any, where: str) -> None:
        check_fields(shape, where, self.MESH)
        vertices = numbers(shape, where, "vertices", (None, 3))
        rows = numbers(shape, where, "triangles", (None, 3), LARGEST_PARAMETER)
        if not (len(vertices) and len(rows) and ((rows >= 0) & (rows < len(vertices)) & (rows % 1 == 0)).all()):
            raise Refused(f"{where}.triangles: must be indices of vertices, and one triangle or more")
        self.triangles, solid = rows.astype(np.int64), member(shape, where, "solid")
        if type(solid) is not bool:
            raise Refused(f"{where}.solid: must be true or false, not {shown(solid)}")
        self.solid = solid
        self._set(vertices, np.zeros(len(vertices)), 0.0, np.zeros(3))
        if solid:
            # A point cannot get from outside to inside without crossing a triangle if each edge between two points
            # occurs equally often in both directions.
            same = np.unique(vertices, axis=0, return_inverse=True)[1].reshape(-1)[self.triangles]
            begin, end = same.reshape(-1), np.roll(same, -1, axis=1).reshape(-1)
            edge = np.minimum(begin, end) * len(vertices) + np.maximum(begin, end)
            if np.bincount(np.unique(edge, return_inverse=True)[1], np.sign(end - begin)).any():
                raise Refused(f"{where}.solid: the triangles do not enclose a volume")

    @property
    def pieces(self) -> int:
        """The number of triangles of a mesh; a convex body is in one piece."""
        return len(self.triangles) if self.is_mesh else 1

    def part(self, first: int, end: int) -> Body:
        """Return the convex body around a range of the triangles of this mesh."""
        points = self.points[self.triangles[first:end].reshape(-1)]
        if end - first > BOXED:
            low, high = points.min(axis=0), points.max(axis=0)
            points = np.array(list(product(*zip(low, high, strict=True))))
        part = copy.copy(self)
        part.is_mesh, part.triangles = False, self.triangles[:0]
        part._set(points, np.zeros(len(points)), 0.0, np.zeros(3))
        return part

    @property
    def witnesses(self) -> Array:
        """(W, 3) a point of each connected part: if the surfaces of two bodies are apart, it is inside if this is."""
        if not self.is_mesh:
            return np.empty((0, 3)) if self.half_space else self.points[:1]
        # Each vertex gets the smallest label of its triangles, until no label changes; labels are followed to the end.
        label = np.arange(len(self.points))
        while True:
            least = label.copy()
            np.minimum.at(least, self.triangles, label[self.triangles].min(axis=1)[:, None])
            least = least[least]
            if np.array_equal(least, label):
                return np.asarray(self.points[np.unique(label[self.triangles])])
            label = least

    def winding(self, point: Array, error: float = 0.0) -> tuple[float, float]:
        """Return how often the triangles wind about a point, and the error: the sum of their solid angles over 4 pi.

        ``error`` is that of the point relative to the corners. The error is infinite if the point may be in an edge.
        Source: A. van Oosterom, J. Strackee (1983), "The solid angle of a plane triangle", equation 8.
        """
        if np.linalg.norm(point - self.centre) * (1.0 - 8 * UNIT_ROUNDOFF) > self.ball + error:
            return 0.0, 0.0
        a, b, c = np.moveaxis(self.points[self.triangles] - point, 1, 0)
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        across = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
        volume = (a * np.cross(b, c)).sum(axis=1)
        half = np.arctan2(volume, across)  # a guess, which its sine and cosine prove
        sine, cosine = sine_cosine(Near(half))
        size = np.sqrt(volume * volume + across * across)
        # Five products of three lengths change with their factors, and have less than 20 roundings each.
        larger = (la + error) * (lb + error) * (lc + error)
        off = 5.0 * (larger - la * lb * lc + 32 * UNIT_ROUNDOFF * larger) + 3.0 * size * sine.error
        off += np.abs(volume * cosine.value - across * sine.value)
        known = (off < size / 2.0) & (across * cosine.value + volume * sine.value > 0.0)
        # An angle below 90 degrees is at most pi/2 times its sine.
        off = np.where(known, off / np.where(known, size, 1.0), np.inf)
        return float(half.sum() / (2.0 * np.pi)), float(off.sum()) / 2.0

    @property
    def extent(self) -> float:
        """Above the distance (m) of a point from the origin of the body, with what it grows; of a half-space 0."""
        return UP * (float(np.linalg.norm(self.centre)) + 2.0 * self.ball) if self.bounded else 0.0

    def reach(self, directions: Array) -> Array:
        """Return the support function: the largest d . x of the body for directions d (..., 3), in its frame."""
        return support(directions, self.points, self.discs, self.radius, self.semi)


def support(directions: Array, points: Array, discs: Array, radius: float | Array, semi: Array) -> Array:
    """Return the largest d . x of one convex body for ``directions`` (R, K, 3), or of R bodies.

    The arguments of R bodies are points (R, V, 3), disc radii (R, 1, V), radius (R, 1) and semi-axes (R, 1, 3).
    Supports of Minkowski sums add up; that of a hull is the largest one of its points (Rockafellar 1970, section 13).
    No term has more than 10 roundings, and their sum is at most the length of d times the extent of the body.
    """
    most = directions @ np.swapaxes(points, -1, -2)
    if discs.any():
        most = most + np.sqrt(directions[..., 0] ** 2 + directions[..., 1] ** 2)[..., None] * discs
    grown = radius * np.sqrt(np.einsum("...x,...x->...", directions, directions))
    if semi.any():
        grown = grown + np.linalg.norm(semi * directions, axis=-1)
    return np.asarray(most.max(axis=-1) + grown)


def halves(control: Array) -> Array:
    """Return the left halves of pieces (k, degree + 1, n), then the right ones, by de Casteljau's algorithm."""
    left, right, rest = np.empty_like(control), np.empty_like(control), control
    for r in range(control.shape[1]):
        left[:, r], right[:, -1 - r] = rest[:, 0], rest[:, -1]
        rest = (rest[:, :-1] + rest[:, 1:]) / 2.0
    return np.concatenate([left, right])


class Curve:
    """The curve: strictly increasing ``knots`` (k + 1,) and Bernstein control points (k, degree + 1, n).

    A single configuration is one piece of no width whose control points are equal.
    """

    FIELDS = ("joint_names", "knots", "control")

    def __init__(self, row: Any) -> None:
        check_fields(row, "curve", self.FIELDS)
        names = items(row, "curve", "joint_names")
        if not names or not all(map(is_text, names)) or len(set(names)) != len(names):
            raise Refused("curve.joint_names: must be different printable names, one or more")
        self.names, self.dof = tuple(names), len(names)
        self.knots = numbers(row, "curve", "knots", (None,), LARGEST_PARAMETER)
        if len(self.knots) < 2:
            raise Refused("curve.knots: must be two or more")
        self.control = numbers(row, "curve", "control", (len(self.knots) - 1, None, self.dof))
        if not self.control.size:
            raise Refused("curve.control: must have one control point or more in each piece")
        # Knots increase, no piece is too narrow for its motion, and pieces join.
        width, span = np.diff(self.knots), np.ptp(self.control, axis=1).max(axis=1)
        self.single = len(width) == 1 and width[0] == 0.0 and span[0] == 0.0
        """Whether the curve is a single configuration."""
        bad = np.flatnonzero(~(width > 0.0))
        if len(bad) and not self.single:
            raise Refused(f"curve.knots[{bad[0] + 1}]: must be larger than the knot before it")
        bad = np.flatnonzero(~(span <= FASTEST * width))
        if len(bad):
            k = bad[0]
            described = f"piece {k} moves a joint by {span[k]:.6g} within a width of {width[k]:.6g}"
            raise Refused(f"curve.knots[{k + 1}]: {described}; at most {FASTEST:g} per unit of the parameter is read")
        jumps = np.abs(self.control[1:, 0] - self.control[:-1, -1]).max(axis=1)
        bad = np.flatnonzero(~(jumps <= JUMP))
        self.jump = UP * float(jumps.max(initial=0.0))
        """rad or m, at least the largest difference between the end of a piece and the start of the next."""
        if len(bad):
            raise Refused(f"curve.control[{bad[0]}]: the next piece does not begin where this one ends")
        self.low, self.high = float(self.knots[0]), float(self.knots[-1])
        self.sha256 = curve_digest(self.names, self.knots, self.control)

    def check_limits(self, limits: dict[str, tuple[Array, Array]]) -> tuple[str, ...]:
        """Return the quantities with limits; refuse a piece that is not proven to keep them.

        A piece is inside the hull of its control points, and differences of control points are those of its derivative
        (Farouki 2012, section 3). Pieces whose hull exceeds a limit are bisected, which brings the hull closer to the
        curve, until the hull is inside or a point of the curve itself is outside. Control points are rounded numbers:
        an excess that is not larger than the rounding of their differences is allowed, and a jump of the velocity
        between two pieces, as long as all of them together have almost no effect. ``own`` are the errors of this
        computation: of differences and quotients 4 roundings of numbers whose errors are divided by the width too,
        and of a bisection one for each average, which does not amplify errors.
        """
        width = np.diff(self.knots)[:, None]
        # The errors of the control points are those of numbers that were rounded several times.
        control, quantities = self.control, []
        size = ROUNDINGS * EPSILON * np.abs(self.control).max(axis=(0, 1)) * np.ones_like(width)
        own = np.zeros_like(size)
        for order, (quantity, (low, high)) in enumerate(limits.items()):
            excess = np.zeros(size.shape)  # of the pieces that are inside except for rounding
            jumps = np.abs(control[1:, 0] - control[:-1, -1]) * np.isfinite(high) if order == 2 else excess[1:]
            if order:  # a piece of degree 0, or a single configuration, does not move
                degree = control.shape[1] - 1
                rise = degree * np.diff(control, axis=1) if degree else 0.0 * control
                control = np.divide(rise, width[:, None], out=np.zeros_like(rise), where=width[:, None] > 0.0)
                size, own = (
                    np.divide(2.0 * degree * each, width, out=np.zeros_like(size), where=width > 0.0)
                    for each in (size, own)
                )
                own = UP * (own + 4 * UNIT_ROUNDOFF * np.abs(control).max(axis=1))
            if not (np.isfinite(low) | np.isfinite(high)).any():
                continue
            quantities.append(quantity)
            slack = LIMIT_SLACK * (np.where(np.isfinite(high), high, 0.0) if order else np.ones(self.dof))
            averages = (BISECTIONS + 2) * control.shape[1]
            off = own + averages * UNIT_ROUNDOFF * (np.abs(control).max(axis=1) + slack)
            parts, owner = control, np.arange(len(control))
            # Bisection of the pieces whose hull exceeds a limit.
            for _ in range(BISECTIONS):
                over = np.maximum(low - slack - parts.min(axis=1), parts.max(axis=1) - high - slack) + off[owner]
                open_ = ~(over <= size[owner]).all(axis=1)
                np.maximum.at(excess, owner[~open_], over[~open_])
                parts, owner = parts[open_], owner[open_]
                ends, spare = parts[:, [0, -1]], (slack + size[owner])[:, None]
                outside = ~((ends >= low - spare) & (ends <= high + spare)).all(axis=(1, 2))
                if outside.any() or not len(parts):
                    break
                parts, owner = halves(parts), np.concatenate([owner, owner])
            # What is allowed for rounding must have almost no effect in sum.
            impulse = excess * width
            impulse[1:] += jumps
            if not len(parts) and UP * impulse.sum(axis=0).max() <= IMPULSE:
                continue
            k = int(owner[int(outside.argmax())]) if len(parts) else int(impulse.max(axis=1).argmax())
            raise Refused(f"curve.control[{k}]: the {quantity} is not proven to keep the limits of the proof")
        return tuple(quantities)


def _digest(*parts: Any) -> str:
    """Return the SHA-256 hash of texts and of numbers as little-endian doubles."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part.encode() if isinstance(part, str) else np.asarray(part, dtype="<f8").tobytes())
    return digest.hexdigest()


def body_digest(row: Any) -> str:
    """Return the hash of a body: joint, placement and numbers of its shape, in the order of docs/formats/proof.md."""
    shape = row["shape"]
    parts: list[Any] = [row["joint"], row["placement"]]
    if isinstance(shape, dict):
        parts += [shape[key] for key in (Body.MESH if "triangles" in shape else Body.SHAPE)]
    return _digest(*parts, shape if isinstance(shape, str) else "")


def curve_digest(names: tuple[str, ...], knots: Array, control: Array) -> str:
    """Return the hash of a curve: joint names and shape as text, knots, control points; certificates have it too."""
    return _digest(repr((names, control.shape)), knots, control)
