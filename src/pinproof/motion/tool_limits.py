"""Limits of the speed and acceleration of the tool, for time parametrisation and verification between samples."""

from __future__ import annotations

from typing import Any

import numpy as np

from pinproof.common.validation import require_positive
from pinproof.errors import InputError
from pinproof.model import Arm, JointGroup, kinematic_tree
from pinproof.motion.trajectory import Trajectory
from pinproof.spatial import Array

DIRECTIONS = 16
"""Number of directions in which a bound of the length of a vector is imposed during timing. The regular polygon with
twice as many sides inside the circle loses 1 - cos(pi / 32) = 0.5 % of the acceleration."""

UNITS = {
    "linear_speed": "m/s",
    "angular_speed": "rad/s",
    "linear_acceleration": "m/s^2",
    "angular_acceleration": "rad/s^2",
}
"""The limits and their units."""


class ToolLimits:
    """Limits of the speed and acceleration of the tcp, a :class:`~pinproof.motion.RateConstraint`.

    Speeds and accelerations are lengths of vectors, relative to the base: of the velocity and acceleration of the tcp
    point, and of the angular velocity and acceleration of its frame. ISO 10218-1:2011 limits the speed of the tcp to
    0.25 m/s where persons may be near (reduced speed).

    Parameters
    ----------
    arm
        The arm.
    linear_speed, angular_speed
        In m/s and rad/s, above 0; None for no limit.
    linear_acceleration, angular_acceleration
        In m/s^2 and rad/s^2, above 0; None for no limit.

    Raises
    ------
    InputError
        If no limit is given, or a limit is not above 0.
    """

    name = "tool"

    def __init__(
        self,
        arm: Arm,
        *,
        linear_speed: float | None = None,
        angular_speed: float | None = None,
        linear_acceleration: float | None = None,
        angular_acceleration: float | None = None,
    ) -> None:
        given = (linear_speed, angular_speed, linear_acceleration, angular_acceleration)
        for name, value in zip(UNITS, given, strict=True):
            if value is not None:
                require_positive(f"{name} ({UNITS[name]})", value)
        if all(value is None for value in given):
            raise InputError(f"ToolLimits requires a limit: {', '.join(UNITS)}")
        self.arm = arm
        self.linear_speed, self.angular_speed, self.linear_acceleration, self.angular_acceleration = given
        self.limits = np.array([np.inf if value is None else float(value) for value in given])
        self.limits.setflags(write=False)
        self._tree = kinematic_tree(arm)

    def coefficients(self, q: Array, slope: Array, curvature: Array) -> tuple[Array, Array, Array, Array]:
        """The limits at points of a path: of s'^2 for a speed, in several directions for an acceleration."""
        q, slope, curvature = (np.ascontiguousarray(each) for each in (q, slope, curvature))
        motion = self._tree.tool_motion(q, slope, curvature)
        alpha: list[Array] = []
        beta: list[Array] = []
        bound: list[float] = []
        for kind, limit in enumerate(self.limits):
            if np.isinf(limit):
                continue
            if kind < 2:
                square = (motion[:, kind] ** 2).sum(axis=1, keepdims=True)
                alpha.append(np.zeros_like(square))
                beta.append(square)
                bound.append(limit**2)
            else:  # the acceleration is V s'' + W s'^2 with the velocity V and the acceleration W per rate of s
                along, across = _in_plane(motion[:, kind - 2], motion[:, kind])
                alpha.append(along)
                beta.append(across)
                bound += [limit * np.cos(0.5 * np.pi / DIRECTIONS)] * DIRECTIONS
        first, second = np.concatenate(alpha, axis=1), np.concatenate(beta, axis=1)
        return first, second, np.zeros_like(first), np.broadcast_to(bound, first.shape)

    def excess(self, trajectory: Trajectory) -> Array:
        """(k,) for each piece, a proven upper bound of the factor by which its duration must be multiplied."""
        require_joints(self.arm, trajectory)
        return np.asarray(self._tree.tool_stretch(*controls(trajectory), self.limits))

    def peaks(self, trajectory: Trajectory) -> dict[str, float]:
        """Bounds of the largest speeds and accelerations of the tcp over the motion, which hold between samples.

        The keys are ``linear_speed`` (m/s), ``angular_speed`` (rad/s), ``linear_acceleration`` (m/s^2) and
        ``angular_acceleration`` (rad/s^2).
        """
        require_joints(self.arm, trajectory)
        bound, _, _ = self._tree.tool_peaks(*controls(trajectory))
        return dict(zip(UNITS, bound.tolist(), strict=True))

    def exceeded(self, trajectory: Trajectory) -> list[str]:
        """A sentence for each limit that the tcp exceeds."""
        nouns = ("a speed", "an angular speed", "an acceleration", "an angular acceleration")
        return [
            f"the tcp reaches {noun} of {value:.6g} {UNITS[name]}; the limit is {limit:g} {UNITS[name]}"
            for noun, (name, value) in zip(nouns, self.peaks(trajectory).items(), strict=True)
            if (limit := getattr(self, name)) is not None and value > limit
        ] or ["the tcp is so close to its limits that these are not proven to be kept"]

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuilt, (self.arm, {name: getattr(self, name) for name in UNITS})

    def __repr__(self) -> str:
        given = [f"{name}={value:g}" for name in UNITS if (value := getattr(self, name)) is not None]
        return f"ToolLimits({self.arm.tcp!r}, {', '.join(given)})"


def _rebuilt(arm: Arm, limits: dict[str, float | None]) -> ToolLimits:
    return ToolLimits(arm, **limits)


def _in_plane(v: Array, w: Array) -> tuple[Array, Array]:
    """The components (N, DIRECTIONS) of v and w (N, 3) in directions spread evenly over the plane that they span."""
    first = _unit(v, np.broadcast_to([1.0, 0.0, 0.0], v.shape))
    rest = w - (w * first).sum(axis=1, keepdims=True) * first
    second = _unit(rest, np.zeros_like(v))  # if w is parallel to v, its component beside v is 0
    angle = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    cosine, sine = np.cos(angle), np.sin(angle)

    def components(x: Array) -> Array:
        a, b = (x * first).sum(axis=1, keepdims=True), (x * second).sum(axis=1, keepdims=True)
        return np.asarray(a * cosine + b * sine)

    return components(v), components(w)


def _unit(v: Array, otherwise: Array) -> Array:
    size = np.linalg.norm(v, axis=1, keepdims=True)
    return np.where(size > 0.0, v / np.where(size > 0.0, size, 1.0), otherwise)


def controls(trajectory: Trajectory) -> tuple[Array, Array, Array]:
    """Contiguous control points of a trajectory and of its first two derivatives."""
    position, velocity, acceleration = (np.ascontiguousarray(trajectory.bezier(order)[1]) for order in range(3))
    return position, velocity, acceleration


def time_of(trajectory: Trajectory, piece: Array, fraction: Array) -> Array:
    """The times (s) of fractions of pieces."""
    knots = trajectory.bezier()[0]
    return np.asarray(knots[piece] + fraction * (knots[piece + 1] - knots[piece]))


def require_joints(arm: JointGroup, trajectory: Trajectory) -> None:
    """Raise InputError unless the trajectory moves the joints of the arm."""
    if trajectory.joint_names != arm.joint_names:
        raise InputError(f"the trajectory moves {trajectory.joint_names}; the joints of the arm are {arm.joint_names}")
