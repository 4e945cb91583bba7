"""Fingers: two bodies of a gripper that stand apart before the grasp and on the object after it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinproof.collision import Obstacle
from pinproof.errors import InputError
from pinproof.spatial import SE3, finite

__all__ = ["GripperFingers"]


@dataclass(frozen=True, eq=False)
class GripperFingers:
    """Two fingers of a parallel gripper.

    Parameters
    ----------
    bodies
        The two, as they stand when closed on nothing; their pose is ``tcp_from_body``.
    opening
        Metres between their faces before the grasp.
    grip
        Metres between them on the object.
    axis
        (3,) the direction in the tcp's frame that the first one moves along when they open; the other moves against it.
    """

    bodies: tuple[Obstacle, Obstacle]
    opening: float
    grip: float
    axis: tuple[float, float, float] = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        if len(self.bodies) != 2:
            raise InputError(f"fingers are 2 bodies, not {len(self.bodies)}")
        opening, grip = finite("opening and grip of the fingers", [self.opening, self.grip], (2,)).tolist()
        if not 0 <= grip <= opening:
            raise InputError(f"the fingers open to {opening} m and grip at {grip} m; 0 <= grip <= opening")
        axis = finite("axis of the fingers", self.axis, (3,))
        if (largest := float(np.abs(axis).max())) < 1e-9:
            raise InputError("axis of the fingers has no length")
        axis /= largest  # so that no square overflows
        object.__setattr__(self, "axis", tuple((axis / np.linalg.norm(axis)).tolist()))

    def apart(self) -> tuple[Obstacle, Obstacle]:
        """The bodies before the grasp."""
        return self._at(self.opening)

    def gripping(self) -> tuple[Obstacle, Obstacle]:
        """The bodies on the object."""
        return self._at(self.grip)

    def _at(self, gap: float) -> tuple[Obstacle, Obstacle]:
        aside = SE3(np.eye(3), gap / 2 * np.array(self.axis))
        first, second = self.bodies
        return replace(first, pose=aside * first.pose), replace(second, pose=aside.inverse() * second.pose)
