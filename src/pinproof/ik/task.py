"""What is asked of the tcp: a pose, a position or an orientation, as a residual, its Jacobian and a stopping test.

All three are read off ``target_from_tcp = E``, the pose of the tcp seen from the target, which is the identity at a
solution. If the joints move by dq, the tcp moves by the twist ``J dq`` seen in its own axes, so E becomes
``E exp(J dq)``; with the right Jacobian of the logarithm, ``Jlog6``::

    pose         r = log6(E)                   dr/dq = Jlog6(E) J                 (6,), (6, n)
    position     r = translation of E          dr/dq = (rotation of E) J_linear   (3,), (3, n)
    orientation  r = angular part of log6(E)   dr/dq = Jlog3(E) J_angular         (3,), (3, n)

The other way round, ``log6(tcp_from_target) = -r``, with the same Jacobian up to its sign. ``Jlog3`` is the lower right
block of ``Jlog6``, since the rotation of E moves regardless of its translation.

Sources: Sola, Deray, Atchuthan (2018), "A micro Lie theory for state estimation in robotics", eqs. 68, 163, 179.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import numpy as np
import numpy.typing as npt

from pinproof.errors import UnknownNameError
from pinproof.spatial import SE3, log6, log6_jacobian

__all__ = ["Task", "TaskName", "make_task"]

Array = npt.NDArray[np.float64]
TaskName = Literal["pose", "position", "orientation"]


class Task(Protocol):
    """What the tcp shall do at the target; residuals in m and rad, one metre weighed as one radian."""

    def residual(self, target_from_tcp: SE3) -> Array:
        """(m,) what is still to go; zero at a solution."""

    def jacobian(self, target_from_tcp: SE3, local: Array) -> Array:
        """(m, n) derivative of :meth:`residual` by q, from the tcp's Jacobian (6, n) in its own axes."""

    def reached(self, residual: Array) -> bool:
        """Whether a residual is within the tolerances."""

    def fulfilled(self, position_error: float, orientation_error: float) -> bool:
        """The same question for errors (m, rad) measured independently of the residual."""


@dataclass(frozen=True)
class _Pose:
    position_tolerance: float
    orientation_tolerance: float

    def residual(self, target_from_tcp: SE3) -> Array:
        return log6(target_from_tcp)

    def jacobian(self, target_from_tcp: SE3, local: Array) -> Array:
        return log6_jacobian(target_from_tcp) @ local

    def reached(self, residual: Array) -> bool:
        # The linear part of log6 is never shorter than the translation, so this is the stricter of the two tests.
        linear, angular = residual[:3], residual[3:]
        return bool(
            linear.dot(linear) <= self.position_tolerance**2 and angular.dot(angular) <= self.orientation_tolerance**2
        )

    def fulfilled(self, position_error: float, orientation_error: float) -> bool:
        return position_error <= self.position_tolerance and orientation_error <= self.orientation_tolerance


@dataclass(frozen=True)
class _Position:
    position_tolerance: float

    def residual(self, target_from_tcp: SE3) -> Array:
        return np.array(target_from_tcp.translation)

    def jacobian(self, target_from_tcp: SE3, local: Array) -> Array:
        return np.asarray(target_from_tcp.rotation @ local[:3])

    def reached(self, residual: Array) -> bool:
        return bool(residual.dot(residual) <= self.position_tolerance**2)

    def fulfilled(self, position_error: float, orientation_error: float) -> bool:  # noqa: ARG002
        return position_error <= self.position_tolerance


@dataclass(frozen=True)
class _Orientation:
    orientation_tolerance: float

    def residual(self, target_from_tcp: SE3) -> Array:
        return log6(target_from_tcp)[3:]

    def jacobian(self, target_from_tcp: SE3, local: Array) -> Array:
        return log6_jacobian(target_from_tcp)[3:, 3:] @ local[3:]

    def reached(self, residual: Array) -> bool:
        return bool(residual.dot(residual) <= self.orientation_tolerance**2)

    def fulfilled(self, position_error: float, orientation_error: float) -> bool:  # noqa: ARG002
        return orientation_error <= self.orientation_tolerance


def make_task(name: str, position_tolerance: float, orientation_tolerance: float) -> Task:
    """The task of that name, with tolerances in m and rad.

    Raises
    ------
    UnknownNameError
        For a name other than ``pose``, ``position``, ``orientation``.
    """
    if name == "pose":
        return _Pose(position_tolerance, orientation_tolerance)
    if name == "position":
        return _Position(position_tolerance)
    if name == "orientation":
        return _Orientation(orientation_tolerance)
    raise UnknownNameError("task", name, get_args(TaskName))
