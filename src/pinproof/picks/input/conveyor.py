"""A conveyor that moves the objects of picks."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np

from pinproof.collision import Mover
from pinproof.common.structs import TEXT, Accepting, Direction, key, list_of, simple, struct
from pinproof.common.validation import unique_names

NAME = "conveyor"
"""The name of the mover."""


@struct("conveyor")
class Conveyor:
    """A belt of constant speed, with the obstacles on it.

    A pick whose ``object`` is one of ``parts`` is judged on the moving belt; its pose, and those of the parts in the
    scene file, are at time 0.
    """

    speed: float = key("speed of the belt, above 0", "m/s", above=0)
    parts: Accepting[tuple[str, ...], Iterable[str]] = key(
        "the obstacles that move", kind=simple(list_of(TEXT, 1).schema, unique_names)
    )
    direction: Direction = key(
        "direction of the motion in the frame of the root link; it is normalised", default=(1.0, 0.0, 0.0)
    )
    dwell: float = key("time for which the tool follows the part while the gripper closes", "s", default=0.2, minimum=0)
    duration: float = key("time for which the belt runs from time 0; picks must end before", "s", default=60.0, above=0)
    tolerance: float = key(
        "how far a part may be ahead or behind on the belt; the certificates include it", "m", default=0.0, minimum=0
    )

    def __post_init__(self) -> None:
        self.mover(self.parts)  # refuses too long a travel

    def travel(self, time: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """(3,) the displacement (m) of the parts at a time (s)."""
        return self.speed * time * np.array(self.direction)

    def mover(self, parts: Collection[str]) -> Mover:
        """The motion of some of the parts."""
        names = [name for name in self.parts if name in parts]
        return Mover.constant(NAME, names, self.speed, self.duration, axis=self.direction, tolerance=self.tolerance)
