"""Torque limits of the joints, with payloads, for time parametrisation and for verification between samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof._core import DynamicTree
from pinproof.common.results import Shown, View, Written
from pinproof.common.structs import OPTIONAL_NUMBER, key, simple, struct
from pinproof.description import DEFAULT_EFFORT, GENERATED_MASSES, has_generated_bodies
from pinproof.errors import InputError, TimingError
from pinproof.model import GRAVITY, JointGroup, Payload, checked_payloads, dynamic_tree, massless_joints
from pinproof.motion.tool_limits import controls, require_joints, time_of
from pinproof.motion.trajectory import Trajectory
from pinproof.spatial import Array, finite

SAMPLES_PER_PIECE = 65
"""Configurations of a piece at which the torque at standstill is computed for an error message."""


@struct("torque", more=True, written=True)
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
        self.limits = _checked_limits(arm, arm.limits.torque if limits is None else limits)
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
        q, slope, curvature = (np.ascontiguousarray(each) for each in (q, slope, curvature))
        alpha, gamma = self._tree.torques(q, np.zeros_like(q), slope)
        beta, _ = self._tree.torques(q, slope, curvature)
        self._require_standstill(q, gamma)
        bound = np.broadcast_to(self.limits, q.shape)
        return tuple(each[:, self._limited] for each in (alpha, beta, gamma, bound))  # type: ignore[return-value]

    def excess(self, trajectory: Trajectory) -> Array:
        """(k,) for each piece, a proven upper bound of the factor by which its duration must be multiplied.

        Raises
        ------
        TimingError
            If gravity alone exceeds a limit.
        """
        require_joints(self.arm, trajectory)
        stretch = np.asarray(self._tree.torque_stretch(*controls(trajectory), self.limits))
        stuck = np.flatnonzero(np.isinf(stretch))
        if len(stuck):
            knots, inside = trajectory.bezier()[0], np.linspace(0.0, 1.0, SAMPLES_PER_PIECE)
            times = (knots[stuck, None] + np.diff(knots)[stuck, None] * inside).ravel().clip(knots[0], knots[-1])
            q = np.ascontiguousarray(trajectory(times))
            self._require_standstill(q, self._tree.torques(q, np.zeros_like(q), np.zeros_like(q))[1], strict=True)
            raise TimingError(f"torques at {times[0]:.4g} s of the motion have no finite bound within the limits")
        return stretch

    def peaks(self, trajectory: Trajectory) -> tuple[TorquePeak, ...]:
        """The largest torque of each joint over the motion, as a bound that holds between samples."""
        require_joints(self.arm, trajectory)
        bound, piece, fraction = self._tree.torque_peaks(*controls(trajectory))
        times = time_of(trajectory, piece, fraction)
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
            needed = f"joint {self.arm.joint_names[j]!r} needs {abs(gravity[i, j]):.4g} {unit} to hold the arm at rest"
            raise TimingError(
                f"{needed} at q = {np.round(q[i], 4).tolist()}; its torque limit is {self.limits[j]:.4g} {unit}"
                f"{self._guessed(int(j))}{self._loaded()}"
            )

    def _unit(self, joint: int) -> str:
        return "N m" if self.arm.angular[joint] else "N"

    def _guessed(self, joint: int) -> str:
        if self.limits[joint] != DEFAULT_EFFORT or not has_generated_bodies(self.arm.robot.urdf):
            return ""
        return ", the default of a DH table: state effort there, or max_effort in a file of joint limits"

    def largest(self, trajectory: Trajectory) -> TorquePeak:
        """The peak of the joint that uses the largest share of its limit along a motion."""
        return max(self.peaks(trajectory), key=lambda peak: peak.share)

    def report(self, trajectory: Trajectory) -> dict[str, Any]:
        """The peaks of all joints along a motion, and what is not known, as plain values for JSON."""
        return {"torques": [peak.to_dict() for peak in self.peaks(trajectory)], "torque_notes": list(self.notes)}

    def _loaded(self) -> str:
        return f" (payload {sum(each.mass for each in self.payloads):.4g} kg)" if self.payloads else ""

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuilt, (self.arm, self.payloads, self.limits, self.gravity)

    def _view(self) -> View:
        lines = [f"limits: {', '.join(f'{limit:g}' for limit in self.limits)}", *map(str, self.payloads), *self.notes]
        return View(f"{self.arm.robot.name!r}, {self.arm.dof} joints", [lines], lines)


def _rebuilt(arm: JointGroup, payloads: tuple[Payload, ...], limits: Array, gravity: Array) -> TorqueLimits:
    return TorqueLimits(arm, payloads, limits=limits, gravity=gravity)


def _checked_limits(arm: JointGroup, value: npt.ArrayLike | None) -> Array:
    joints = ", ".join(arm.joint_names)
    unknown = (
        f"no torque limit of the joints {joints} is known; state max_effort in a file of joint limits (--limits), or "
        "in Python limits="
    )
    if value is None:
        raise InputError(unknown)
    try:
        limits = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"torque limits must be numbers, not {value!r}") from error
    if limits.ndim == 0:
        limits = np.full(arm.dof, float(limits))
    if limits.shape != (arm.dof,):
        raise InputError(f"torque limits must have one number for each of the joints {joints}; shape {limits.shape}")
    for name, limit in zip(arm.joint_names, limits, strict=True):
        if limit <= 0.0:
            raise InputError(f"the torque limit of joint {name!r} must be above 0, not {limit:g}")
    limits[np.isnan(limits)] = np.inf
    if np.isinf(limits).all():
        raise InputError(unknown)
    return limits
