"""Rigid transforms: making them, reading them, measuring between them, and refusing what is not one.

Transforms are :class:`pinocchio.SE3` and read ``a_from_b``. Lengths are metres, angles radians. Twists are linear
first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.errors import InputError

__all__ = [
    "RIGID_TOLERANCE",
    "SE3",
    "FrozenSE3",
    "finite",
    "frozen",
    "interpolate",
    "log6",
    "log6_jacobian",
    "matrix",
    "pose",
    "rigid",
    "rigid_many",
    "twist_size",
    "xyz_rpy",
]

Array = npt.NDArray[np.float64]

SE3 = pin.SE3
"""A rigid transform, for the annotations of rooms that do not import Pinocchio themselves."""

RIGID_TOLERANCE = 1e-6
"""How far R^T R may be from the identity (largest entry) before a matrix is refused; below, it is orthonormalised."""


class FrozenSE3(pin.SE3):  # type: ignore[misc]  # Pinocchio has no stubs
    """A rigid transform that cannot be changed in place; Pinocchio takes it wherever it takes a :class:`pinocchio.SE3`.

    :attr:`translation` and :attr:`rotation` are read-only copies, and whatever would change the transform raises.
    ``copy()`` and ``pin.SE3(frozen)`` make ordinary transforms, and so does every product.
    """

    @property
    def translation(self) -> Array:
        """(3,) the position in metres, read-only."""
        return _read_only(pin.SE3.translation.__get__(self))

    @translation.setter
    def translation(self, _value: object) -> None:
        self._refuse("translation")

    @property
    def rotation(self) -> Array:
        """(3, 3) the rotation matrix, read-only."""
        return _read_only(pin.SE3.rotation.__get__(self))

    @rotation.setter
    def rotation(self, _value: object) -> None:
        self._refuse("rotation")

    def setIdentity(self) -> None:
        """Not possible."""
        self._refuse("value")

    def setRandom(self) -> None:
        """Not possible."""
        self._refuse("value")

    def _refuse(self, what: str) -> None:
        raise AttributeError(
            f"the {what} of this pose is read-only; change a copy (pose.copy()) and make a new object with it, such as "
            "scene.move(name, pose)"
        )


def _read_only(view: Any) -> Array:
    array = np.array(view)
    array.setflags(write=False)
    return array


def frozen(transform: pin.SE3) -> FrozenSE3:
    """A copy of a transform that cannot be changed in place."""
    return transform if type(transform) is FrozenSE3 else FrozenSE3(transform.rotation, transform.translation)


def pose(
    xyz: Sequence[float] = (0.0, 0.0, 0.0),
    rpy: Sequence[float] | None = None,
    *,
    quat_xyzw: Sequence[float] | None = None,
) -> pin.SE3:
    """A rigid transform from a position and an orientation.

    Parameters
    ----------
    xyz
        (3,) position in metres.
    rpy
        (3,) roll, pitch, yaw about fixed axes in radians: R = Rz(yaw) Ry(pitch) Rx(roll).
    quat_xyzw
        (4,) quaternion, scalar last; normalised here. Give ``rpy`` or ``quat_xyzw``, not both.

    Raises
    ------
    InputError
        For a wrong shape, a non-finite number, both orientations at once, or a quaternion of length zero.
    """
    position = finite("xyz", xyz, (3,))
    if rpy is not None and quat_xyzw is not None:
        raise InputError("give rpy or quat_xyzw, not both")
    if quat_xyzw is not None:
        quaternion = finite("quat_xyzw", quat_xyzw, (4,))
        if (largest := float(np.abs(quaternion).max())) < 1e-9:
            raise InputError(f"quat_xyzw has length {largest:g}; a rotation needs a quaternion of length 1")
        quaternion /= largest  # so that no square overflows
        return pin.SE3(pin.Quaternion(quaternion / np.linalg.norm(quaternion)), position)
    roll, pitch, yaw = finite("rpy", (0.0, 0.0, 0.0) if rpy is None else rpy, (3,))
    return pin.SE3(pin.rpy.rpyToMatrix(roll, pitch, yaw), position)


def xyz_rpy(transform: pin.SE3 | npt.ArrayLike) -> Array:
    """The textbook's pose vector ``[x, y, z, roll, pitch, yaw]`` (6,) of a transform, in metres and radians.

    Angles are about fixed axes (R = Rz Ry Rx), pitch in [-pi/2, pi/2].
    """
    transform = rigid("transform", transform)
    return np.concatenate([transform.translation, pin.rpy.matrixToRpy(transform.rotation)])


def log6(a_from_b: pin.SE3) -> Array:
    """The twist (6,) that leads from frame a to frame b in unit time, seen in a: linear (m), then angular (rad)."""
    return np.array(pin.log6(a_from_b).vector)


def log6_jacobian(a_from_b: pin.SE3) -> Array:
    """The (6, 6) derivative of :func:`log6` by a motion of b, seen in b (right Jacobian of SE(3))."""
    return np.array(pin.Jlog6(a_from_b))


def interpolate(a: pin.SE3, b: pin.SE3, share: float) -> pin.SE3:
    """The pose at ``share`` (0 to 1) of the way from a to b: the origin on a line, the axes turning about one axis."""
    turn = pin.exp3(share * pin.log3(a.rotation.T @ b.rotation))
    return pin.SE3(a.rotation @ turn, a.translation + share * (b.translation - a.translation))


def twist_size(a: pin.SE3, b: pin.SE3) -> tuple[float, float]:
    """How far b is from a: metres between the origins, and the angle (rad) between the axes."""
    distance = float(np.linalg.norm(b.translation - a.translation))
    return distance, float(np.linalg.norm(pin.log3(a.rotation.T @ b.rotation)))


def rigid(name: str, value: pin.SE3 | npt.ArrayLike) -> pin.SE3:
    """A fresh, truly rigid copy of a transform given as ``pin.SE3`` or as a (4, 4) matrix.

    Rotations that are off by rounding (:data:`RIGID_TOLERANCE`) are re-orthonormalised by SVD; Pinocchio itself takes
    NaN and sheared matrices without a word, so nothing reaches it unchecked.

    Raises
    ------
    InputError
        If the shape is wrong, a number is not finite, or the matrix is no rigid motion.
    """
    try:
        source: Any = value.homogeneous if isinstance(value, pin.SE3) else value
        m = np.array(source, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name} must be a pin.SE3 or a (4, 4) matrix, not {type(value).__name__}") from error
    if m.shape != (4, 4):
        raise InputError(f"{name} must be a pin.SE3 or a (4, 4) matrix; its shape is {m.shape}")
    # In plain numbers from here: a handful of small array operations would take three times as long.
    (a, b, c, x), (d, e, f, y), (g, h, i, z), last = m.tolist()
    if not math.isfinite(a + b + c + d + e + f + g + h + i + x + y + z + sum(last)) and not np.isfinite(m).all():
        raise InputError(f"{name} holds numbers that are not finite:\n{m}")
    rotation = m[:3, :3]
    squares = (a * a + d * d + g * g, b * b + e * e + h * h, c * c + f * f + i * i)
    across = (a * b + d * e + g * h, a * c + d * f + g * i, b * c + e * f + h * i)
    error_size = max(*(abs(one - 1.0) for one in squares), *(abs(one) for one in across))
    mirrors = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0  # the determinant
    if error_size > RIGID_TOLERANCE or mirrors:
        what = "mirrors" if mirrors else f"is {error_size:.2g} off a rotation"
        raise InputError(f"{name} is not a rigid transform: its upper left 3x3 block {what}")
    if max(abs(last[0]), abs(last[1]), abs(last[2]), abs(last[3] - 1.0)) > RIGID_TOLERANCE:
        raise InputError(f"{name} is not a rigid transform: its last row is {m[3].tolist()}, not [0, 0, 0, 1]")
    if error_size > 1e-14:
        u, _, vt = np.linalg.svd(rotation)
        rotation = u @ vt
    return pin.SE3(rotation, m[:3, 3])


def rigid_many(name: str, values: npt.ArrayLike | Sequence[pin.SE3]) -> Array:
    """Truly rigid copies (N, 4, 4) of N transforms, given as such an array or a sequence, checked as by :func:`rigid`.

    Raises
    ------
    InputError
        As :func:`rigid`, naming ``name[index]``.
    """
    shape = np.shape(values) if isinstance(values, np.ndarray) else None
    if shape is not None and shape[1:] != (4, 4):
        raise InputError(f"{name} must have the shape (N, 4, 4); it has {shape}")
    if shape is None or values.dtype != np.float64:  # type: ignore[union-attr]
        try:
            sequence = list(values)  # type: ignore[arg-type]  # array-likes that cannot be walked are refused here
        except TypeError as error:
            raise InputError(f"{name} must be (N, 4, 4) or a sequence of poses, not {type(values).__name__}") from error
        checked = [rigid(f"{name}[{index}]", value).homogeneous for index, value in enumerate(sequence)]
        return np.array(checked, dtype=float).reshape(-1, 4, 4)
    many = np.array(values)
    rotations = many[:, :3, :3]
    off = np.abs(np.swapaxes(rotations, 1, 2) @ rotations - np.eye(3)).max(axis=(1, 2), initial=0.0)
    mirrored = np.einsum("ni,ni->n", np.cross(rotations[:, :, 0], rotations[:, :, 1]), rotations[:, :, 2]) < 0
    # Written so that NaN is among them: these are looked at one by one, and repaired or refused.
    odd = (
        ~(off <= 1e-14)
        | mirrored
        | (many[:, 3] != (0.0, 0.0, 0.0, 1.0)).any(axis=1)
        | ~np.isfinite(many[:, :3, 3]).all(axis=1)
    )
    for index in np.flatnonzero(odd):
        many[index] = rigid(f"{name}[{index}]", many[index]).homogeneous
    return many


def matrix(transform: pin.SE3) -> Array:
    """The (4, 4) homogeneous matrix of a transform, as a copy."""
    return np.array(transform.homogeneous)


def finite(name: str, value: npt.ArrayLike, shape: tuple[int | None, ...]) -> Array:
    """A fresh float array of the given shape (``None`` matches any length) with finite numbers only.

    Raises
    ------
    InputError
        Naming ``name``, the shape wanted and the shape found, or the first place that is not finite.
    """
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name} must be numbers of shape {_shape_text(shape)}: {error}") from error
    if array.ndim != len(shape) or any(w is not None and w != s for w, s in zip(shape, array.shape, strict=True)):
        raise InputError(f"{name} must have the shape {_shape_text(shape)}; it has {array.shape}")
    if not np.isfinite(array).all():
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InputError(f"{name} holds {array[place]} at index {place[0] if len(place) == 1 else place}")
    return array


def _shape_text(shape: tuple[int | None, ...]) -> str:
    names = iter("NMKL")
    inner = ", ".join(next(names) if size is None else str(size) for size in shape)
    return f"({inner},)" if len(shape) == 1 else f"({inner})"
