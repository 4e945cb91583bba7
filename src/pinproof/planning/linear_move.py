"""What a straight move of the tcp came to: a certified curve, or where it stops and why."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from pinproof.collision import Certificate
from pinproof.errors import PlanFailed
from pinproof.motion import BlendedPath, CubicPath

__all__ = ["LinearMove", "LinearStatus", "PosesMove"]


class LinearStatus(Enum):
    """How a straight move, or one through poses, ended."""

    COMPLETE = "complete"
    UNREACHABLE = "a pose on the way is out of reach without leaving the branch"
    LIMIT = "a joint is at its limit"
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
        By how much (m, rad) the tcp may be off where it should be anywhere on ``path``: bounds, not samples; NaN
        without one.
    joints
        Those at their limits, or that would have to jump, where that is what stops it.
    """

    status: LinearStatus
    path: CubicPath | None
    certificate: Certificate | None
    fraction: float
    message: str
    deviation: float = math.nan
    rotation_deviation: float = math.nan
    joints: tuple[str, ...] = ()

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


@dataclass(frozen=True, eq=False)
class PosesMove:
    """A move of the tcp through a sequence of poses.

    Parameters
    ----------
    status, certificate, message, deviation, rotation_deviation, joints
        As of a :class:`LinearMove`.
    path
        The joint curve, its ``corners`` where the arm stops; None unless COMPLETE.
    fraction
        The share of the whole way, by its length, up to which the move is possible and proven free.
    reached
        The index of the last pose that is reached (or passed, where its corner is rounded); -1 for none.
    """

    status: LinearStatus
    path: BlendedPath | None
    certificate: Certificate | None
    fraction: float
    reached: int
    message: str
    deviation: float = math.nan
    rotation_deviation: float = math.nan
    joints: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether the whole way is possible and proven free."""
        return self.status is LinearStatus.COMPLETE

    def or_raise(self) -> PosesMove:
        """Return the move if it is complete.

        Raises
        ------
        PlanFailed
            With the message otherwise.
        """
        if not self.ok:
            raise PlanFailed(self.message, self)
        return self
