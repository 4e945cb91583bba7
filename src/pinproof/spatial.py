"""Rigid transforms: construction, conversion, interpolation, distances and validation.

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

from pinproof._core import all_finite, is_rigid, not_rigid
from pinproof.errors import InputError
from pinproof.units import warn_of_degrees

__all__ = [
    "RIGID_TOLERANCE",
    "SE3",
    "FrozenSE3",
    "finite",
    "floats",
    "frozen",
    "interpolate",
    "inverse_matrix",
    "log6",
    "matrix",
    "pose",
    "rigid",
    "rigid_many",
    "rigid_matrix",
    "rotation_about",
    "rotation_about_line",
    "translated",
    "twist_size",
    "unit_vector",
    "xyz_rpy",
]

Array = npt.NDArray[np.float64]

SE3 = pin.SE3
"""A rigid transform, for annotations in packages that do not import Pinocchio."""

RIGID_TOLERANCE = 1e-6
"""Largest entry of abs(R^T R - I) that is accepted; accepted matrices are orthonormalised."""


class FrozenSE3(pin.SE3):  # type: ignore[misc]  # Pinocchio has no stubs
    """A read-only :class:`pinocchio.SE3`.

    :attr:`translation` and :attr:`rotation` are read-only copies, and methods that modify the transform raise an
    exception. ``copy()``, ``pin.SE3(frozen)`` and products return ordinary transforms.
    """

    @property
    def translation(self) -> Array:
        """(3,) position in metres, read-only."""
        return _read_only(pin.SE3.translation.__get__(self))

    @translation.setter
    def translation(self, _value: object) -> None:
        self._refuse("translation")

    @property
    def rotation(self) -> Array:
        """(3, 3) rotation matrix, read-only."""
        return _read_only(pin.SE3.rotation.__get__(self))

    @rotation.setter
    def rotation(self, _value: object) -> None:
        self._refuse("rotation")

    def setIdentity(self) -> None:
        """Raise AttributeError: the transform is read-only."""
        self._refuse("value")

    def setRandom(self) -> None:
        """Raise AttributeError: the transform is read-only."""
        self._refuse("value")

    def _refuse(self, what: str) -> None:
        raise AttributeError(
            f"the {what} of this pose is read-only; modify a copy (pose.copy()) and create a new object with it, for "
            "example scene.move(name, pose)"
        )


def _read_only(view: Any) -> Array:
    array = np.array(view)
    array.setflags(write=False)
    return array


def frozen(transform: pin.SE3) -> FrozenSE3:
    """Return a read-only copy of a transform."""
    return transform if type(transform) is FrozenSE3 else FrozenSE3(transform)


def pose(
    xyz: npt.ArrayLike = (0.0, 0.0, 0.0), rpy: npt.ArrayLike | None = None, *, quat_xyzw: npt.ArrayLike | None = None
) -> pin.SE3:
    """Create a rigid transform from a position and an orientation.

    Parameters
    ----------
    xyz
        (3,) position in metres.
    rpy
        (3,) roll, pitch, yaw about fixed axes in radians: R = Rz(yaw) Ry(pitch) Rx(roll). Angles beyond two full
        rotations give a :class:`pinproof.errors.UnitWarning`, because they are probably degrees.
    quat_xyzw
        (4,) quaternion, scalar last; it is normalised. Pass either ``rpy`` or ``quat_xyzw``.

    Raises
    ------
    InputError
        For a wrong shape, a non-finite number, both orientations at once, or a quaternion of length zero.
    """
    position = finite("xyz", xyz, (3,))
    if rpy is not None and quat_xyzw is not None:
        raise InputError("pass either rpy or quat_xyzw, not both")
    if quat_xyzw is not None:
        quaternion = finite("quat_xyzw", quat_xyzw, (4,))
        if (largest := float(np.abs(quaternion).max())) < 1e-9:
            raise InputError(f"quat_xyzw has length {largest:g}; a rotation needs a quaternion of length 1")
        quaternion /= largest  # so that no square overflows
        return pin.SE3(pin.Quaternion(quaternion / np.linalg.norm(quaternion)), position)
    roll, pitch, yaw = finite("rpy", (0.0, 0.0, 0.0) if rpy is None else rpy, (3,)).tolist()
    warn_of_degrees("rpy", (roll, pitch, yaw))
    return pin.SE3(pin.rpy.rpyToMatrix(roll, pitch, yaw), position)


def xyz_rpy(transform: pin.SE3 | npt.ArrayLike) -> Array:
    """Return the pose vector ``[x, y, z, roll, pitch, yaw]`` (6,) of a transform, in metres and radians.

    The angles are about fixed axes (R = Rz Ry Rx), with the pitch in [-pi/2, pi/2].
    """
    transform = rigid("transform", transform)
    return np.concatenate([transform.translation, pin.rpy.matrixToRpy(transform.rotation)])


def log6(a_from_b: pin.SE3) -> Array:
    """Return the twist (6,) that moves frame a to frame b in unit time, in a: linear (m), then angular (rad)."""
    return np.array(pin.log6(a_from_b).vector)


def inverse_matrix(a_from_b: Array) -> Array:
    """Return ``b_from_a`` (4, 4) of a rigid transform (4, 4), without validating it."""
    b_from_a = np.eye(4)
    b_from_a[:3, :3] = a_from_b[:3, :3].T
    b_from_a[:3, 3] = -b_from_a[:3, :3] @ a_from_b[:3, 3]
    return b_from_a


def rotation_about(axis: Array, angle: float) -> Array:
    """Return the rotation (3, 3) about a unit axis (3,) by an angle (rad), by Rodrigues' formula."""
    if angle == 0.0:
        return np.eye(3)
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)


def rotation_about_line(point: Array, axis: Array, angle: float) -> Array:
    """Return the transform (4, 4) of a rotation by an angle (rad) about the line through a point (3,) along an axis."""
    motion = np.eye(4)
    motion[:3, :3] = rotation_about(axis, angle)
    motion[:3, 3] = point - motion[:3, :3] @ point
    return motion


def interpolate(a: pin.SE3, b: pin.SE3, share: float) -> pin.SE3:
    """Interpolate from a (``share`` = 0) to b (1): the origin on a line, the orientation about one fixed axis."""
    turn = pin.exp3(share * pin.log3(a.rotation.T @ b.rotation))
    return pin.SE3(a.rotation @ turn, a.translation + share * (b.translation - a.translation))


def translated(transform: pin.SE3, by: npt.ArrayLike) -> pin.SE3:
    """Return a transform whose origin is displaced by (3,) metres along the axes of its parent frame."""
    return pin.SE3(transform.rotation, transform.translation + np.asarray(by))


def twist_size(a: pin.SE3, b: pin.SE3) -> tuple[float, float]:
    """Return the distance (m) between the origins of a and b and the rotation angle (rad) between their axes."""
    distance = float(np.linalg.norm(b.translation - a.translation))
    return distance, float(np.linalg.norm(pin.log3(a.rotation.T @ b.rotation)))


def rigid(name: str, value: pin.SE3 | npt.ArrayLike, *, batch: str = "") -> pin.SE3:
    """Return a validated copy of a transform given as ``pin.SE3`` or as a (4, 4) matrix.

    ``batch`` is the method for several transforms, for the message.

    Rotations with rounding errors up to :data:`RIGID_TOLERANCE` are orthonormalised by SVD. Pinocchio itself accepts
    NaN and sheared matrices without an error.

    Raises
    ------
    InputError
        If the shape is wrong, a number is not finite, or the matrix is not a rigid transform.
    """
    try:
        source: Any = value.homogeneous if isinstance(value, pin.SE3) else value
        m = np.array(source, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name} must be a pin.SE3 or a (4, 4) matrix, not {type(value).__name__}") from error
    if m.shape != (4, 4):
        many = f"; {batch} takes (N, 4, 4)" if batch and m.shape[1:] == (4, 4) else ""
        raise InputError(f"{name} must be a pin.SE3 or a (4, 4) matrix; its shape is {m.shape}{many}")
    # Plain numbers are three times as fast here as small arrays.
    (a, b, c, x), (d, e, f, y), (g, h, i, z), last = m.tolist()
    if not math.isfinite(a + b + c + d + e + f + g + h + i + x + y + z + sum(last)) and not np.isfinite(m).all():
        raise InputError(f"{name} holds numbers that are not finite:\n{m}")
    rotation = m[:3, :3]
    squares = (a * a + d * d + g * g, b * b + e * e + h * h, c * c + f * f + i * i)
    across = (a * b + d * e + g * h, a * c + d * f + g * i, b * c + e * f + h * i)
    error_size = max(*(abs(one - 1.0) for one in squares), *(abs(one) for one in across))
    mirrors = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0  # the determinant
    if error_size > RIGID_TOLERANCE or mirrors:
        what = "is a reflection" if mirrors else f"differs from a rotation by {error_size:.2g}"
        raise InputError(f"{name} is not a rigid transform: its upper left 3x3 block {what}")
    if max(abs(last[0]), abs(last[1]), abs(last[2]), abs(last[3] - 1.0)) > RIGID_TOLERANCE:
        raise InputError(f"{name} is not a rigid transform: its last row is {m[3].tolist()}, not [0, 0, 0, 1]")
    if error_size > 1e-14:
        u, _, vt = np.linalg.svd(rotation)
        rotation = u @ vt
    return pin.SE3(rotation, m[:3, 3])


def rigid_matrix(name: str, value: pin.SE3 | npt.ArrayLike, *, batch: str = "") -> Array:
    """As :func:`rigid`, but returns the (4, 4) matrix, which is faster."""
    if isinstance(value, pin.SE3):
        copy: Array = value.homogeneous  # a new array
        if is_rigid(copy):
            return copy
    elif type(value) is np.ndarray and value.dtype == np.float64 and value.shape == (4, 4):
        copy = np.array(value, order="C")
        if is_rigid(copy):
            return copy
    return matrix(rigid(name, value, batch=batch))


def rigid_many(name: str, values: npt.ArrayLike | Sequence[pin.SE3]) -> Array:
    """Return validated copies (N, 4, 4) of N transforms, given as an array or a sequence; see :func:`rigid`.

    Raises
    ------
    InputError
        As :func:`rigid`; the message states ``name[index]``.
    """
    shape = np.shape(values) if isinstance(values, np.ndarray) else None
    if shape is not None and shape[1:] != (4, 4):
        raise InputError(f"{name} must have the shape (N, 4, 4); it has {shape}")
    if shape is None or values.dtype != np.float64:  # type: ignore[union-attr]
        try:
            sequence = list(values)  # type: ignore[arg-type]  # array-likes that are not iterable raise here
        except TypeError as error:
            raise InputError(f"{name} must be (N, 4, 4) or a sequence of poses, not {type(values).__name__}") from error
        checked = [rigid(f"{name}[{index}]", value).homogeneous for index, value in enumerate(sequence)]
        return np.array(checked, dtype=float).reshape(-1, 4, 4)
    many = np.array(values, order="C")
    for index in not_rigid(many):  # repaired or rejected one by one
        many[index] = rigid(f"{name}[{index}]", many[index]).homogeneous
    return many


def matrix(transform: pin.SE3) -> Array:
    """Return a copy of the (4, 4) homogeneous matrix of a transform."""
    return np.array(transform.homogeneous)


def floats(name: str, value: npt.ArrayLike, shape: tuple[int | None, ...]) -> Array:
    """Return a copy as a float array, checked for its shape (``None`` matches any length); NaN and infinity are valid.

    Raises
    ------
    InputError
        If the value is not numbers or the shape differs; the message states ``name`` and both shapes.
    """
    try:
        array = np.array(value, dtype=float, order="C")
    except (TypeError, ValueError, OverflowError) as error:
        reason = "; it is a dict, so give its values in order" if isinstance(value, dict) else f": {error}"
        raise InputError(f"{name} must be numbers of shape {_shape_text(shape)}{reason}") from error
    if array.shape != shape and (
        array.ndim != len(shape) or any(w is not None and w != s for w, s in zip(shape, array.shape, strict=True))
    ):
        if len(shape) == 1 and shape[0] is not None and array.ndim <= 1:
            raise InputError(f"{name} must have {shape[0]} number{'' if shape[0] == 1 else 's'}, not {array.size}")
        raise InputError(f"{name} must have the shape {_shape_text(shape)}; it has {array.shape}")
    return array


def finite(name: str, value: npt.ArrayLike, shape: tuple[int | None, ...]) -> Array:
    """As :func:`floats`, but all numbers must be finite; the message states the index of one that is not."""
    array = floats(name, value, shape)
    if not all_finite(array):
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        index = place[0] if len(place) == 1 else place
        raise InputError(f"{name} holds {array[place]} at index {index}; all numbers must be finite")
    return array


def unit_vector(name: str, value: npt.ArrayLike) -> tuple[float, float, float]:
    """Return the direction of a vector (3,) as a unit vector; raise InputError if it is zero or not finite."""
    vector = finite(name, value, (3,))
    if (largest := float(np.abs(vector).max())) < 1e-9:
        raise InputError(f"{name} is zero; it must be a direction")
    vector /= largest  # so that no square overflows
    x, y, z = (vector / np.linalg.norm(vector)).tolist()
    return x, y, z


def _shape_text(shape: tuple[int | None, ...]) -> str:
    names = iter("NMKL")
    inner = ", ".join(next(names) if size is None else str(size) for size in shape)
    return f"({inner},)" if len(shape) == 1 else f"({inner})"
