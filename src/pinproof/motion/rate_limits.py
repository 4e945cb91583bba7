"""Limits that depend on the configuration, for time parametrisation: the protocol, tool speeds, and joint torques.

A limit is any object with the protocol :class:`RateConstraint`: it guides the timing by its coefficients at points of
the path, and decides by a bound over each complete piece of the result. docs/timing.md derives the bounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from pinproof._core import DynamicTree
from pinproof.common.results import Shown, View, Written
from pinproof.common.structs import OPTIONAL_NUMBER, key, simple, struct
from pinproof.common.validation import require_positive
from pinproof.description import DEFAULT_EFFORT, GENERATED_MASSES, has_generated_bodies
from pinproof.errors import InputError, TimingError
from pinproof.model import (
    GRAVITY,
    Arm,
    JointGroup,
    Payload,
    checked_payloads,
    dynamic_tree,
    kinematic_tree,
    massless_joints,
)
from pinproof.motion.limits import LIMIT_TOLERANCE
from pinproof.motion.trajectory import Trajectory
from pinproof.spatial import Array, finite

# Number of directions in which a bound of the length of a vector is imposed during timing. The regular polygon with
# twice as many sides inside the circle loses 1 - cos(pi / 32) = 0.5 % of the acceleration.
DIRECTIONS = 16
# The limits and their units.
UNITS = {
    "linear_speed": "m/s",
    "angular_speed": "rad/s",
    "linear_acceleration": "m/s^2",
    "angular_acceleration": "rad/s^2",
}
# Configurations of a piece at which the torque at standstill is computed for an error message.
SAMPLES_PER_PIECE = 65


@runtime_checkable
class RateConstraint(Protocol):
    """A limit of :func:`~pinproof.motion.time_parametrise` on a motion q(s(t)) along a path q(s).

    The timing uses :meth:`coefficients` to find the fastest motion. They are evaluated at nodes of the path, and their
    accuracy affects the duration only. The result is verified with :meth:`excess`, which decides what is returned.
    """

    @property
    def name(self) -> str:
        """The name for messages, such as ``"torque"``."""

    def coefficients(self, q: Array, slope: Array, curvature: Array) -> tuple[Array, Array, Array, Array]:
        """The limit at points of the path: ``|alpha * s'' + beta * s'^2 + gamma| <= bound``.

        Parameters
        ----------
        q, slope, curvature
            (N, n) configurations, and the first and the second derivative of the path with respect to s.

        Returns
        -------
        ``alpha``, ``beta``, ``gamma`` and ``bound``, (N, m) each, for m scalar limits. ``alpha = 0`` and ``gamma = 0``
        limit the speed s' to ``sqrt(bound / |beta|)``. ``bound`` is not negative. The limit must permit a standstill,
        ``|gamma| <= bound``; otherwise :func:`~pinproof.motion.time_parametrise` raises
        :class:`~pinproof.errors.TimingError`.
        """

    def excess(self, trajectory: Trajectory) -> Array:
        """(k,) for each piece, a proven upper bound of the factor by which its duration must be multiplied.

        The bound covers the whole piece, not only samples. It is 1 or less if the piece satisfies the limit. For
        limits without ``gamma`` on speed it is speed / limit, on acceleration sqrt(acceleration / limit).
        """


def checked_constraints(constraints: Sequence[RateConstraint]) -> tuple[RateConstraint, ...]:
    """The constraints as a tuple; InputError if one is not a :class:`RateConstraint`."""
    if not isinstance(constraints, list | tuple) and isinstance(constraints, RateConstraint):
        raise InputError("rate_limits must be a sequence, such as a list with this one limit")
    for constraint in constraints:
        if not isinstance(constraint, RateConstraint):
            raise InputError(
                f"rate_limits must hold objects with name, coefficients and excess, not a {type(constraint).__name__}"
            )
    return tuple(constraints)


def constraint_rows(
    constraints: Sequence[RateConstraint], q: Array, slope: Array, curvature: Array
) -> tuple[Array, Array, Array, Array]:
    """``alpha``, ``beta``, ``gamma`` and ``bound`` (N, m) of all constraints at points (N, n) of a path.

    TimingError names a constraint that is violated at standstill, and the configuration.
    """
    parts: list[list[Array]] = [[np.zeros((len(q), 0))] for _ in range(4)]
    for constraint in constraints:
        rows = [np.asarray(values, dtype=float) for values in constraint.coefficients(q, slope, curvature)]
        if len(rows) != 4 or any(row.ndim != 2 or row.shape != (len(q), rows[0].shape[1]) for row in rows):
            raise InputError(f"the coefficients of {constraint.name!r} must be four arrays of the same shape (N, m)")
        if not all(np.isfinite(row).all() for row in rows):
            raise InputError(f"the coefficients of {constraint.name!r} hold a number that is not finite")
        over = np.abs(rows[2]) - rows[3]
        if over.max(initial=-np.inf) > 0.0:
            i, k = np.unravel_index(over.argmax(), over.shape)
            raise TimingError(
                f"the constraint {constraint.name!r} is violated at standstill at q = {np.round(q[i], 4).tolist()}: "
                f"component {k} is {rows[2][i, k]:.6g}, the limit is {rows[3][i, k]:.6g}; no timing can satisfy it"
            )
        for part, row in zip(parts, rows, strict=True):
            part.append(row)
    alpha, beta, gamma, bound = (np.concatenate(part, axis=1) for part in parts)
    return alpha, beta, gamma, bound


def rate_violations(constraints: Sequence[RateConstraint], trajectory: Trajectory) -> list[str]:
    """A sentence for each limit that a motion exceeds by more than rounding, between samples too."""
    sentences: list[str] = []
    for constraint in constraints:
        try:
            if float(constraint.excess(trajectory).max()) > 1.0 + LIMIT_TOLERANCE:
                describe = getattr(constraint, "exceeded", None)
                sentences += [f"{constraint.name} is exceeded"] if describe is None else describe(trajectory)
        except TimingError as error:  # no timing satisfies the limit
            sentences.append(str(error))
    return sentences


def require_joints(arm: JointGroup, trajectory: Trajectory) -> None:
    """Raise InputError unless the trajectory moves the joints of the arm."""
    if trajectory.joint_names != arm.joint_names:
        raise InputError(f"the trajectory moves {trajectory.joint_names}; the joints of the arm are {arm.joint_names}")


def controls_of(arm: JointGroup, trajectory: Trajectory) -> tuple[Array, Array, Array]:
    """Contiguous control points of a trajectory of an arm and of its first two derivatives."""
    require_joints(arm, trajectory)
    position, velocity, acceleration = (np.ascontiguousarray(trajectory.bezier(order).control) for order in range(3))
    return position, velocity, acceleration


# -- the tool ----------------------------------------------------------------------------------------------------------


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
        q, slope, curvature = (np.ascontiguousarray(array) for array in (q, slope, curvature))
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
        return np.asarray(self._tree.tool_stretch(*controls_of(self.arm, trajectory), self.limits))

    def peaks(self, trajectory: Trajectory) -> dict[str, float]:
        """Bounds of the largest speeds and accelerations of the tcp over the motion, which hold between samples.

        The keys are ``linear_speed`` (m/s), ``angular_speed`` (rad/s), ``linear_acceleration`` (m/s^2) and
        ``angular_acceleration`` (rad/s^2).
        """
        bound, _, _ = self._tree.tool_peaks(*controls_of(self.arm, trajectory))
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
        return partial(ToolLimits, **{name: getattr(self, name) for name in UNITS}), (self.arm,)

    def __repr__(self) -> str:
        given = [f"{name}={value:g}" for name in UNITS if (value := getattr(self, name)) is not None]
        return f"ToolLimits({self.arm.tcp!r}, {', '.join(given)})"


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


# -- torques -----------------------------------------------------------------------------------------------------------


@struct("torque", written=True)
class TorquePeak(Written):
    """The largest torque of a joint during a part of the motion."""

    joint: str = key("name of the joint")
    torque: float = key("upper bound of its magnitude, which holds between samples", "N m or N", minimum=0)
    limit: float = key("the limit; infinite, null in files, if none is known", "N m or N", kind=OPTIONAL_NUMBER)
    time: float = key("when a value within a relative 2e-4 of the bound occurs, from the start of the part", "s")
    unit: str = key("the unit of both, `N` for a prismatic joint", default="N m", kind=simple({"enum": ["N m", "N"]}))

    @property
    def share(self) -> float:
        """The torque divided by its limit."""
        return self.torque / self.limit

    def __str__(self) -> str:
        limit = f", {100.0 * self.share:.0f} % of its limit" if np.isfinite(self.limit) else ""
        return f"{self.joint}: {self.torque:.3g} {self.unit}{limit} at {self.time:.3g} s"


class TorqueLimits(Shown):
    """Limits of the joint torques, a :class:`~pinproof.motion.RateConstraint`; docs/timing.md derives its bounds.

    Inertias come from the URDF and the payloads, as in :meth:`pinproof.Arm.torques`. A motion that is slowed down
    keeps the torque from gravity; a path on which gravity alone exceeds a limit cannot be timed.

    Parameters
    ----------
    arm
        The arm, or a joint group with several arms.
    payload
        A body, or several, that the arm carries in addition to its own links.
    limits
        (n,) or one number in N m (N for a prismatic joint), above 0, NaN or infinite for no limit. By default,
        ``arm.limits.torque``.
    gravity
        (3,) acceleration of free fall in m/s^2, in the root link.

    Raises
    ------
    InputError
        If no limit is known, a limit is not above 0, their number is wrong, or the description states no masses.
    """

    name = "torque"

    def __init__(
        self,
        arm: JointGroup,
        payload: Payload | Sequence[Payload] | None = None,
        *,
        limits: npt.ArrayLike | None = None,
        gravity: npt.ArrayLike = GRAVITY,
    ) -> None:
        self.arm = arm
        self.payloads = checked_payloads(payload)
        joints = ", ".join(arm.joint_names)
        unknown = InputError(
            f"no torque limit of the joints {joints} is known; state max_effort in a file of joint limits (--limits), "
            "or in Python limits="
        )
        given = arm.limits.torque if limits is None else limits
        if given is None:
            raise unknown
        try:
            torques = np.array(given, dtype=float)
        except (TypeError, ValueError) as error:
            raise InputError(f"torque limits must be numbers, not {given!r}") from error
        if torques.ndim == 0:
            torques = np.full(arm.dof, float(torques))
        if torques.shape != (arm.dof,):
            raise InputError(
                f"torque limits must have one number for each of the joints {joints}; shape {torques.shape}"
            )
        for name, torque in zip(arm.joint_names, torques, strict=True):
            if torque <= 0.0:
                raise InputError(f"the torque limit of joint {name!r} must be above 0, not {torque:g}")
        torques[np.isnan(torques)] = np.inf
        if np.isinf(torques).all():
            raise unknown
        self.limits = torques
        self.gravity = finite("gravity", gravity, (3,))
        for array in (self.limits, self.gravity):
            array.setflags(write=False)
        self._tree = dynamic_tree(arm, self.payloads, self.gravity)
        self._limited = np.flatnonzero(np.isfinite(self.limits))

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about missing data: joints without mass or limit, and masses that are generated."""
        massless = massless_joints(self.arm, self.payloads)
        unlimited = [name for name, limit in zip(self.arm.joint_names, self.limits, strict=True) if np.isinf(limit)]
        return (
            *([f"no mass of the links moved by {', '.join(massless)}"] if massless else []),
            *([f"no torque limit: {', '.join(unlimited)}"] if unlimited else []),
            *([GENERATED_MASSES] if self.arm.robot.has_generated_bodies else []),
        )

    def coefficients(self, q: Array, slope: Array, curvature: Array) -> tuple[Array, Array, Array, Array]:
        """``M(q) q'``, ``M(q) q'' + C(q, q') q'``, ``g(q)`` and the limits (N, m) of the m joints with a limit.

        Raises
        ------
        TimingError
            If gravity alone exceeds a limit; the message names the joint, the torque and the configuration.
        """
        q, slope, curvature = (np.ascontiguousarray(array) for array in (q, slope, curvature))
        alpha, gamma = self._tree.torques(q, np.zeros_like(q), slope)
        beta, _ = self._tree.torques(q, slope, curvature)
        self._require_standstill(q, gamma)
        bound = np.broadcast_to(self.limits, q.shape)
        return tuple(array[:, self._limited] for array in (alpha, beta, gamma, bound))  # type: ignore[return-value]

    def excess(self, trajectory: Trajectory) -> Array:
        """(k,) for each piece, a proven upper bound of the factor by which its duration must be multiplied.

        Raises
        ------
        TimingError
            If gravity alone exceeds a limit.
        """
        stretch = np.asarray(self._tree.torque_stretch(*controls_of(self.arm, trajectory), self.limits))
        stuck = np.flatnonzero(np.isinf(stretch))
        if len(stuck):
            knots, inside = trajectory.bezier().knots, np.linspace(0.0, 1.0, SAMPLES_PER_PIECE)
            times = (knots[stuck, None] + np.diff(knots)[stuck, None] * inside).ravel().clip(knots[0], knots[-1])
            q = np.ascontiguousarray(trajectory(times))
            self._require_standstill(q, self._tree.torques(q, np.zeros_like(q), np.zeros_like(q))[1], strict=True)
            raise TimingError(f"torques at {times[0]:.4g} s of the motion have no finite bound within the limits")
        return stretch

    def peaks(self, trajectory: Trajectory) -> tuple[TorquePeak, ...]:
        """The largest torque of each joint over the motion, as a bound that holds between samples."""
        bound, piece, fraction = self._tree.torque_peaks(*controls_of(self.arm, trajectory))
        knots = trajectory.bezier().knots
        times = knots[piece] + fraction * (knots[piece + 1] - knots[piece])
        return tuple(
            TorquePeak(name, float(bound[j]), float(self.limits[j]), float(times[j]), self._unit(j))
            for j, name in enumerate(self.arm.joint_names)
        )

    def exceeded(self, trajectory: Trajectory) -> list[str]:
        """A sentence for each joint whose largest torque exceeds its limit."""
        return [
            f"{peak.joint} needs {peak.torque:.6g} {peak.unit} at {peak.time:.3f} s; its limit is "
            f"{peak.limit:.6g} {peak.unit}"
            for peak in self.peaks(trajectory)
            if peak.share > 1.0
        ] or ["the torques are so close to their limits that these are not proven to be kept"]

    @property
    def tree(self) -> DynamicTree:
        """The arm and its payloads in the compiled core."""
        return self._tree

    def standstill_share(self, q: npt.ArrayLike) -> float:
        """The largest share of a limit that holding the arm at rest at configurations (N, n) needs."""
        rows = np.ascontiguousarray(finite("q", np.atleast_2d(q), (None, self.arm.dof)))
        still = np.zeros_like(rows)
        return float((np.abs(self._tree.torques(rows, still, still)[1]) / self.limits).max(initial=0.0))

    def standstill(self, q: npt.ArrayLike) -> str:
        """A sentence about the joint that cannot hold the arm at rest at q (n,), or an empty text if all can."""
        still = np.zeros((1, self.arm.dof))
        try:
            self._require_standstill(q := self.arm.configuration(q)[None], self._tree.torques(q, still, still)[1])
        except TimingError as error:
            return str(error)
        return ""

    def _require_standstill(self, q: Array, gravity: Array, *, strict: bool = False) -> None:
        share = np.abs(gravity) / self.limits
        worst = float(share.max(initial=0.0))
        if worst > 1.0 or (strict and worst >= 1.0):
            i, j = np.unravel_index(share.argmax(), share.shape)
            unit = self._unit(int(j))
            reason = (
                f"joint {self.arm.joint_names[j]!r} needs {abs(gravity[i, j]):.4g} {unit} to hold the arm at rest at "
                f"q = {np.round(q[i], 4).tolist()}; its torque limit is {self.limits[j]:.4g} {unit}"
            )
            if self.limits[j] == DEFAULT_EFFORT and has_generated_bodies(self.arm.robot.urdf):
                reason += ", the default of a DH table: state effort there, or max_effort in a file of joint limits"
            if self.payloads:
                reason += f" (payload {sum(load.mass for load in self.payloads):.4g} kg)"
            raise TimingError(reason)

    def _unit(self, joint: int) -> str:
        return "N m" if self.arm.angular[joint] else "N"

    def largest(self, trajectory: Trajectory) -> TorquePeak:
        """The peak of the joint that uses the largest share of its limit along a motion."""
        return max(self.peaks(trajectory), key=lambda peak: peak.share)

    def report(self, trajectory: Trajectory) -> dict[str, Any]:
        """The peaks of all joints along a motion, and what is not known, as plain values for JSON."""
        return {"torques": [peak.to_dict() for peak in self.peaks(trajectory)], "torque_notes": list(self.notes)}

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(TorqueLimits, limits=self.limits, gravity=self.gravity), (self.arm, self.payloads)

    def _view(self) -> View:
        lines = [f"limits: {', '.join(f'{limit:g}' for limit in self.limits)}", *map(str, self.payloads), *self.notes]
        return View(f"{self.arm.robot.name!r}, {self.arm.dof} joints", [lines], lines)
