"""What a check says: contacts by name, distance and points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["CheckResult", "Contact"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Contact:
    """Two bodies nearer than the margin.

    Parameters
    ----------
    bodies
        The owners: links, attached objects, obstacles.
    distance
        Signed distance in metres; below 0 they penetrate, by that depth where coal knows it.
    points
        (2, 3) the nearest (or deepest) point of each body, in the robot's root frame.
    normal
        (3,) the unit vector along which the second body would leave the first, in the robot's root frame.
    """

    bodies: tuple[str, str]
    distance: float
    points: Array
    normal: Array

    @property
    def depth(self) -> float:
        """How deep (m) the bodies penetrate each other; 0 where they do not."""
        return max(-self.distance, 0.0)

    def __str__(self) -> str:
        how = "penetrates" if self.distance < 0 else "is near"
        return f"{self.bodies[0]} {how} {self.bodies[1]} ({self.distance * 1e3:+.1f} mm)"


@dataclass(frozen=True, eq=False)
class CheckResult:
    """Every contact at one configuration, the deepest first."""

    contacts: tuple[Contact, ...]

    @property
    def free(self) -> bool:
        """Whether there is no contact."""
        return not self.contacts

    def __str__(self) -> str:
        return "; ".join(str(contact) for contact in self.contacts) or "free"
