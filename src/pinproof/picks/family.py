"""Families of grasps: one grasp turned about its approach, or moved within a tolerance, the nominal one first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.spatial import SE3, finite, pose

__all__ = ["GraspSpin", "GraspTolerance", "Member", "family", "rotation_about"]

Array = npt.NDArray[np.float64]

STEPS = 24
"""Turns that are tried of a free spin: every 15 degrees."""

MOST_STEPS = 3600
"""Of a range of turns: a tenth of a degree each of a whole turn. Every one is tried."""

SHARES = (0.5, 1.0)
"""Of a tolerance, where grasps are tried: half way out, then at its end."""


@dataclass(frozen=True)
class GraspSpin:
    """Turns (rad) of a grasp about the direction of its approach.

    Parameters
    ----------
    angles
        Those that are tried, in this order.
    sampled
        Whether they stand for a range of turns: then a "no" to all of them proves nothing about those between.
    """

    angles: tuple[float, ...] = (0.0,)
    sampled: bool = False

    def __post_init__(self) -> None:
        angles = finite("spin", self.angles, (None,))
        if not len(angles):
            raise InputError("spin has no angle; leave it out, or give at least one")
        object.__setattr__(self, "angles", tuple(angles.tolist()))

    @classmethod
    def free(cls, steps: int = STEPS) -> GraspSpin:
        """Any turn at all."""
        return cls(tuple(sorted((2 * np.pi * k / steps for k in _outwards(steps)), key=abs)), sampled=True)

    @classmethod
    def between(cls, first: float, last: float, steps: int = STEPS) -> GraspSpin:
        """Turns from ``first`` to ``last``, the smallest first."""
        if not last >= first or not 1 <= steps <= MOST_STEPS:
            raise InputError(f"spin from {first} to {last} in {steps} steps; it goes upwards in 1 to {MOST_STEPS}")
        return cls(tuple(sorted(np.linspace(first, last, steps + 1).tolist(), key=abs)), sampled=last > first)


@dataclass(frozen=True)
class GraspTolerance:
    """How far a grasp may be moved in the tip's own axes: tried half way and at the end, one axis at a time.

    Parameters
    ----------
    position
        (3,) metres to either side along x, y, z.
    tilt
        rad to either side about x and y.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt: float = 0.0

    def __post_init__(self) -> None:
        sides = np.full(3, self.position) if np.ndim(self.position) == 0 else self.position
        position = finite("tolerance.position", sides, (3,))
        tilt = float(finite("tolerance.tilt", [self.tilt], (1,))[0])
        if (position < 0).any() or tilt < 0:
            raise InputError(f"tolerance of {position.tolist()} m and {tilt} rad; they are 0 or more")
        object.__setattr__(self, "position", tuple(position.tolist()))
        object.__setattr__(self, "tilt", tilt)

    def rings(self) -> Iterator[list[tuple[str, SE3]]]:
        """What a grasp is moved by, ``nominal_from_moved`` in words and as a transform, ring by ring outwards."""
        yield [("", SE3.Identity())]
        for share in SHARES:
            ring = []
            for axis, side in enumerate(self.position):
                for shift in (share * side, -share * side) if side else ():
                    words = f"{shift * 1e3:+.1f} mm along the tip's {'xyz'[axis]}"
                    ring.append((words, pose(xyz=[shift * (axis == k) for k in range(3)])))
            for axis in (0, 1) if self.tilt else ():
                for turn in (share * self.tilt, -share * self.tilt):
                    words = f"tilted by {np.degrees(turn):+.1f} deg about the tip's {'xy'[axis]}"
                    ring.append((words, pose(rpy=[turn * (axis == k) for k in range(3)])))
            if ring:
                yield ring


@dataclass(frozen=True, eq=False)
class Member:
    """One grasp of a family: ``nominal_from_tip``, and in words how it differs from the nominal one."""

    nominal_from_tip: SE3
    words: str = ""


def family(spin: GraspSpin, tolerance: GraspTolerance, axis: Array) -> Iterator[list[Member]]:
    """The members ring by ring, the nominal grasp and its turns first.

    Parameters
    ----------
    spin, tolerance
        What may differ.
    axis
        (3,) the direction in the tip's frame about which it spins, of length 1.
    """
    for ring in tolerance.rings():
        yield [
            Member(
                SE3(rotation_about(axis, angle), np.zeros(3)) * shift, ", ".join(filter(None, [_spun(angle), words]))
            )
            for words, shift in ring
            for angle in spin.angles
        ]


def _spun(angle: float) -> str:
    return f"spun by {np.degrees(angle):+.0f} deg" if angle else ""


def rotation_about(axis: Array, angle: float) -> Array:
    """The rotation (3, 3) about an axis by an angle (Rodrigues' formula)."""
    if angle == 0.0:
        return np.eye(3)
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)


def _outwards(steps: int) -> list[int]:
    """0, 1, -1, 2, -2, ... as many as ``steps``."""
    return [(k + 1) // 2 * (1 if k % 2 else -1) for k in range(steps)]
