"""What is said of a pick: stage by stage, with the motion if it is good."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate
from pinproof.motion import Trajectory
from pinproof.picks.pick import Pick

__all__ = ["PickStatus", "PickVerdict", "Stage", "StageResult"]


class Stage(Enum):
    """The stages of a pick, in the order in which they are judged."""

    REACH = "reach"
    LIMITS = "limits"
    GRASP = "grasp"
    APPROACH = "approach"
    RETREAT = "retreat"
    TRANSIT = "transit"
    MOTION = "motion"


class PickStatus(Enum):
    """The verdict on a pick.

    GOOD carries a certified, timed motion. NOT_FOUND means that no way was found among the configurations tried; there
    may be another, since configurations are sampled.
    """

    GOOD = "good"
    NOT_FOUND = "not found"


@dataclass(frozen=True)
class StageResult:
    """One stage: whether it is passed, and the reason or the figures."""

    stage: Stage
    ok: bool
    message: str


@dataclass(frozen=True, eq=False)
class PickVerdict:
    """The verdict on one pick.

    Parameters
    ----------
    pick
        The pick.
    status
        GOOD or NOT_FOUND.
    stages
        Every stage that was judged, for the best configuration; the last is the one that failed, if any did.
    configurations
        How many different configurations at the grasp were tried.
    q_grasp
        (n,) the configuration at the grasp; None unless GOOD.
    trajectory
        From home over approach and grasp to the end of the retreat; None unless GOOD.
    grasp_time
        Seconds from the start of the trajectory to the grasp.
    certificate
        FREE, for exactly the trajectory; None unless GOOD.
    """

    pick: Pick
    status: PickStatus
    stages: tuple[StageResult, ...]
    configurations: int
    q_grasp: npt.NDArray[np.float64] | None = None
    trajectory: Trajectory | None = None
    grasp_time: float | None = None
    certificate: Certificate | None = None

    def __post_init__(self) -> None:
        if self.q_grasp is not None:
            q = np.array(self.q_grasp)
            q.setflags(write=False)
            object.__setattr__(self, "q_grasp", q)

    @property
    def ok(self) -> bool:
        """Whether the pick is GOOD."""
        return self.status is PickStatus.GOOD

    @property
    def failed(self) -> Stage | None:
        """The stage that failed; None for a good pick."""
        return None if self.ok else self.stages[-1].stage

    @property
    def reason(self) -> str:
        """The message of the last stage judged."""
        return self.stages[-1].message
