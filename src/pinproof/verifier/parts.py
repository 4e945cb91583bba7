"""The joints, bodies and curve of a proof file, each checked by itself."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import numpy.typing as npt

from .reading import Array, Refused, check_fields, index, is_text, items, member, number, numbers, shown, text

RIGID = 1e-9
"""Largest error of rotation matrices and unit vectors, which are then made orthonormal."""

JUMP = 1e-12
"""rad or m between the end of a piece of the curve and the start of the next: rounding, not motion."""

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

LEVELS = 3
"""Number of levels of detail, from coarse to fine, on which bodies may represent a geometry."""


def placement(row: Any, where: str) -> tuple[Array, Array]:
    """Return rotation (3, 3) and translation (3,) of three rows of four numbers."""
    place = numbers(row, where, "placement", (3, 4))
    rotation, translation = place[:, :3], place[:, 3]
    off = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if not off <= RIGID or np.linalg.det(rotation) < 0:
        raise Refused(f"{where}.placement: is not rigid (off by {off:.3g})")
    return rotation @ (1.5 * np.eye(3) - 0.5 * rotation.T @ rotation), translation  # one Newton step to the nearest


def unit_vector(row: Any, where: str, key: str) -> Array:
    """Return the unit vector (3,) of a key, normalised."""
    vector = numbers(row, where, key, (3,))
    length = float(np.linalg.norm(vector))
    if not abs(length - 1.0) <= RIGID:
        raise Refused(f"{where}.{key}: its length must be 1, not {length}")
    return vector / length


class Joint:
    """A revolute or prismatic joint whose value is multiplier * q[leader] + offset; parent -1 is the root."""

    FIELDS = ("name", "type", "axis", "placement", "parent", "leader", "multiplier", "offset")

    def __init__(self, row: Any, k: int, dof: int) -> None:
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
        self.axis = unit_vector(row, where, "axis")
        self.rotation, self.translation = placement(row, where)


class Body:
    """A convex body: the hull of ``points``, each with a flat disc about z, grown by a ball and by an ellipsoid.

    ``half_space`` is everything below the body's own z = 0. A body may have no shape; then it can be in no pair.
    """

    FIELDS = ("name", "owner", "kind", "geometry", "level", "source", "mesh_sha256", "joint", "placement", "shape",
              "sha256")  # fmt: skip
    SHAPE = ("points", "disc_radii", "radius", "semi_axes")

    def __init__(self, row: Any, i: int, joints: int) -> None:
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
        self.rotation, self.translation = placement(row, where)
        shape = member(row, where, "shape")
        self.half_space, self.convex = shape == "half_space", shape is not None and shape != "half_space"
        if self.half_space and self.kind != "obstacle":
            raise Refused(f"{where}.shape: only an obstacle can be a half-space")
        self.centre, self.ball = np.zeros(3), np.inf
        if self.convex:
            self._read(shape, f"{where}.shape")
        if self.sha256 != body_digest(row):
            raise Refused(f"{where}.sha256: does not match the joint, placement and shape in the file")

    def _read(self, shape: Any, where: str) -> None:
        check_fields(shape, where, self.SHAPE)
        self.points = numbers(shape, where, "points", (None, 3))
        self.discs = numbers(shape, where, "disc_radii", (len(self.points),))
        self.semi = numbers(shape, where, "semi_axes", (3,))
        self.radius = number(shape, where, "radius")
        if not len(self.points) or min(self.radius, self.semi.min(), self.discs.min()) < 0:
            raise Refused(f"{where}: must have points, and no radius below 0")
        self.centre = (self.points.min(axis=0) + self.points.max(axis=0)) / 2
        out = self.points - self.centre
        far = np.hypot(np.hypot(out[:, 0], out[:, 1]) + self.discs, out[:, 2])
        self.ball = float(far.max()) + self.radius + float(self.semi.max())

    @property
    def extent(self) -> float:
        """Distance (m) of its farthest point from the frame of its joint; of a half-space, of its surface."""
        ball = self.ball if self.convex else 0.0
        return float(np.linalg.norm(self.translation) + np.linalg.norm(self.centre)) + ball

    def reach(self, directions: Array) -> Array:
        """Return the support function: the largest d . x of the body for directions d (..., 3), in its frame.

        Supports of Minkowski sums add up; the support of a hull is the largest one of its points (Rockafellar 1970,
        section 13).
        """
        if self.half_space:
            return np.where(_straight_up(directions), 0.0, np.inf)
        return support(directions, self.points, self.discs, self.radius, self.semi)


def support(directions: Array, points: Array, discs: Array, radius: float | Array, semi: Array) -> Array:
    """Return the support function of one convex body, or of R bodies with ``directions`` (R, K, 3).

    The arguments of R bodies are points (R, V, 3), disc radii (R, 1, V), radius (R, 1) and semi-axes (R, 1, 3).
    """
    most = directions @ np.swapaxes(points, -1, -2)
    if discs.any():
        most = most + np.hypot(directions[..., 0], directions[..., 1])[..., None] * discs
    grown = radius * np.linalg.norm(directions, axis=-1)
    if semi.any():
        grown = grown + np.linalg.norm(semi * directions, axis=-1)
    return np.asarray(most.max(axis=-1) + grown)


def _straight_up(directions: Array) -> npt.NDArray[np.bool_]:
    sideways = np.abs(directions[..., :2]).max(axis=-1)
    return np.asarray((sideways <= RIGID) & (directions[..., 2] > 0))


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
        bad = np.flatnonzero(~(np.abs(self.control[1:, 0] - self.control[:-1, -1]).max(axis=1) <= JUMP))
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
        between two pieces, as long as all of them together have almost no effect.
        """
        width = np.diff(self.knots)[:, None]
        control, quantities = self.control, []
        size = ROUNDINGS * EPSILON * np.abs(self.control).max(axis=(0, 1)) * np.ones_like(width)
        for order, (quantity, (low, high)) in enumerate(limits.items()):
            excess = np.zeros(size.shape)  # of the pieces that are inside except for rounding
            jumps = np.abs(control[1:, 0] - control[:-1, -1]) * np.isfinite(high) if order == 2 else excess[1:]
            if order:  # a piece of degree 0, or a single configuration, does not move
                degree = control.shape[1] - 1
                rise = degree * np.diff(control, axis=1) if degree else 0.0 * control
                control = np.divide(rise, width[:, None], out=np.zeros_like(rise), where=width[:, None] > 0.0)
                size = np.divide(2.0 * degree * size, width, out=np.zeros_like(size), where=width > 0.0)
            if not (np.isfinite(low) | np.isfinite(high)).any():
                continue
            quantities.append(quantity)
            slack = LIMIT_SLACK * (np.where(np.isfinite(high), high, 0.0) if order else np.ones(self.dof))
            parts, owner = control, np.arange(len(control))
            for _ in range(BISECTIONS):
                over = np.maximum(low - slack - parts.min(axis=1), parts.max(axis=1) - high - slack)
                open_ = ~(over <= size[owner]).all(axis=1)
                np.maximum.at(excess, owner[~open_], over[~open_])
                parts, owner = parts[open_], owner[open_]
                ends, spare = parts[:, [0, -1]], (slack + size[owner])[:, None]
                outside = ~((ends >= low - spare) & (ends <= high + spare)).all(axis=(1, 2))
                if outside.any() or not len(parts):
                    break
                parts, owner = halves(parts), np.concatenate([owner, owner])
            impulse = excess * width
            impulse[1:] += jumps
            if not len(parts) and impulse.sum(axis=0).max() <= IMPULSE:
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
        parts += [shape[key] for key in Body.SHAPE]
    return _digest(*parts, shape if isinstance(shape, str) else "")


def curve_digest(names: tuple[str, ...], knots: Array, control: Array) -> str:
    """Return the hash of a curve: joint names and shape as text, knots, control points; certificates have it too."""
    return _digest(repr((names, control.shape)), knots, control)
