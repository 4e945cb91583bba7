"""A conveyor that moves the objects of picks."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from pinproof.collision import Mover
from pinproof.common.validation import require_positive, unique_names
from pinproof.spatial import unit_vector

NAME = "conveyor"
"""The name of the mover."""


@dataclass(frozen=True)
class Conveyor:
    """A belt of constant speed, with the obstacles on it.

    A pick whose object is one of them is judged on the moving belt: its pose, and those of all parts in the scene, are
    at time 0.

    Parameters
    ----------
    speed
        m/s, above 0.
    parts
        Names of the obstacles that move; they are at their poses in the scene at time 0.
    direction
        (3,) direction of the motion in the frame of the root link; it is normalised.
    dwell
        Seconds for which the tool follows the belt while the gripper closes.
    duration
        Seconds for which the belt runs from time 0; picks must end before.
    tolerance
        Metres by which a part may be ahead or behind on the belt; the certificates include it.

    Raises
    ------
    InputError
        If a number is out of its range, the direction is zero, or no part is named.
    """

    speed: float
    parts: tuple[str, ...]
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    dwell: float = 0.2
    duration: float = 60.0
    tolerance: float = 0.0

    def __post_init__(self) -> None:
        for name in ("speed", "duration"):
            require_positive(f"{name} of the conveyor", getattr(self, name))
        for name in ("dwell", "tolerance"):
            require_positive(f"{name} of the conveyor", getattr(self, name), zero=True)
        parts = unique_names("conveyor.parts", self.parts)
        object.__setattr__(self, "parts", parts)
        object.__setattr__(self, "direction", unit_vector("the direction of the conveyor", self.direction))
        self.mover(parts)  # refuses too long a travel

    def travel(self, time: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """(3,) the displacement (m) of the parts at a time (s)."""
        return self.speed * time * np.array(self.direction)

    def mover(self, parts: Collection[str]) -> Mover:
        """The motion of some of the parts."""
        names = [name for name in self.parts if name in parts]
        return Mover.constant(NAME, names, self.speed, self.duration, axis=self.direction, tolerance=self.tolerance)
