"""What a straight move of the tcp came to: a certified curve, or where it stops and why."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from pinproof.collision import Certificate
from pinproof.errors import PlanFailed
from pinproof.motion import CubicPath

__all__ = ["LinearMove", "LinearStatus"]


class LinearStatus(Enum):
    """How a straight move ended."""

    COMPLETE = "complete"
    UNREACHABLE = "a pose on the line is out of reach or limits without leaving the branch"
    JUMP = "the joints would have to jump"
    CONTACT = "a body touches"
    UNDECIDED = "the proof met its tolerance"


@dataclass(frozen=True, eq=False)
class LinearMove:
    """A straight move of the tcp.

    Parameters
    ----------
    status
        COMPLETE, or why it stops.
    path
        The joint curve; None unless COMPLETE.
    certificate
        FREE when COMPLETE; the verdict that stopped it for CONTACT and UNDECIDED; else None.
    fraction
        The share of the line, 0 to 1, up to which the move is possible and proven free.
    message
        The outcome in a sentence.
    deviation, rotation_deviation
        Largest distance (m) and angle (rad) of the tcp from where it should be on the line, seen at eight points of
        each piece; NaN unless the whole line was followed.
    """

    status: LinearStatus
    path: CubicPath | None
    certificate: Certificate | None
    fraction: float
    message: str
    deviation: float = math.nan
    rotation_deviation: float = math.nan

    @property
    def ok(self) -> bool:
        """Whether the whole line is possible and proven free."""
        return self.status is LinearStatus.COMPLETE

    def or_raise(self) -> LinearMove:
        """Return the move if it is complete.

        Raises
        ------
        PlanFailed
            With the message otherwise.
        """
        if not self.ok:
            raise PlanFailed(self.message, self)
        return self
