"""The verdict on a pick: its stages with figures and reasons, and the motions of a good pick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, Obstacle, Scene
from pinproof.errors import InputError
from pinproof.motion import MotionRecord, Trajectory
from pinproof.picks.input.pick import Pick
from pinproof.picks.judging.grip import GripResult

__all__ = ["PickMotion", "PickStatus", "PickVerdict", "Stage", "StageResult"]


class Stage(Enum):
    """The stages of a pick, in the order in which they are judged."""

    INPUT = "input"
    REACH = "reach"
    LIMITS = "limits"
    SELF = "self-collision"
    GRASP = "grasp"
    GRIP = "grip"
    APPROACH = "approach"
    RETREAT = "retreat"
    TRANSIT = "transit"
    PLACE = "place"
    TIMING = "timing"


class PickStatus(Enum):
    """The verdict on a pick."""

    GOOD = "good"
    """It carries certified, timed motions."""
    IMPOSSIBLE = "impossible"
    """Every configuration of every grasp asked for is refuted by name: all were enumerated in closed form, or no grasp
    holds the part, which does not depend on the configuration."""
    NOT_FOUND = "not found"
    """No way was found within the budget that the reason names; there may be one."""
    UNREADABLE = "unreadable"
    """What it states makes no sense in this scene, with this robot."""
    CRASHED = "crashed"
    """It could not be judged: the judge failed, or its process died."""


@dataclass(frozen=True)
class StageResult:
    """One stage: whether it is passed, the reason, and its figures (m, rad, s and counts, by name)."""

    stage: Stage
    ok: bool
    message: str
    figures: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class PickMotion:
    """A part of a pick's motion along which what is carried, and what stands around, stay the same.

    Parameters
    ----------
    name
        ``"pick"``, the only one of a pick that names no object; else ``"transit"``, ``"approach"``, ``"retreat"``,
        ``"transfer"``, ``"place"``, ``"leave"``.
    trajectory
        From rest to rest.
    certificate
        FREE, for exactly this trajectory; of ``"place"``, proven of the motion run backwards.
    attached
        What moves with the tcp: tool, fingers, object; poses are ``tcp_from_body``.
    scene
        What stands around.
    held
        Where the joints outside the arm stand (rad or m by name), such as the robot's own fingers: the arm that the
        certificate is of is ``arm.with_held(held)``.
    """

    name: str
    trajectory: Trajectory
    certificate: Certificate
    attached: tuple[Obstacle, ...]
    scene: Scene
    held: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class PickVerdict:
    """The verdict on one pick.

    Parameters
    ----------
    pick
        The pick.
    status
        The kind of answer.
    stages
        Every stage that was judged, for the way that came farthest; the last is the one that failed, if any did.
    configurations
        How many different configurations at the grasp were tried.
    q_grasp
        (n,) the configuration at the grasp; None unless GOOD.
    trajectory
        All motions joined, at rest where they meet; None unless GOOD.
    grasp_time
        Seconds from the start of the trajectory to the grasp.
    certificate
        FREE, for exactly the trajectory, of a good pick that names no object. With one, what moves changes on the way,
        and each of ``motions`` has its own.
    motions
        The parts in order; none unless GOOD.
    release_time
        Seconds to where the object is let go; None without a place.
    suggestions
        Changes that help, one line for each kind, each the smallest of those tried. The pick was judged again with each
        of them exactly as printed: it is then good, or the line states at which later stage it fails. Apply one with
        :func:`pinproof.picks.apply_suggestion`.
    refuted
        Why each configuration is out, if the pick is IMPOSSIBLE: one line each.
    member
        How the grasp differs from the nominal one of its family, in words.
    grip
        How the part is held, of a good pick that names an object.
    score
        The parts by which it was ranked and their weighted sum, of a good pick.
    """

    pick: Pick
    status: PickStatus
    stages: tuple[StageResult, ...]
    configurations: int = 0
    q_grasp: npt.NDArray[np.float64] | None = None
    trajectory: Trajectory | None = None
    grasp_time: float | None = None
    certificate: Certificate | None = None
    motions: tuple[PickMotion, ...] = ()
    release_time: float | None = None
    suggestions: tuple[str, ...] = ()
    refuted: tuple[str, ...] = ()
    member: str = ""
    score: Mapping[str, float] = field(default_factory=dict)
    grip: GripResult | None = None

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

    def save_motion(self, path: str | Path) -> None:
        """Write the trajectory of a good pick, with a record of what each part of it was certified with.

        The formats are those of :meth:`pinproof.Trajectory.save`.

        Raises
        ------
        InputError
            If the pick is not good, so that there is no motion.
        TrajectoryError
            If the file cannot be written.
        """
        if self.trajectory is None:
            raise InputError(f"pick {self.pick.name!r} is {self.status.value}, so it has no motion to write")
        records: list[MotionRecord] = []
        for part in self.motions:
            start = records[-1].end if records else 0.0
            name = part.name if len(self.motions) > 1 else "motion"
            records.append(part.certificate.motion_record(name, start, start + part.trajectory.duration))
        self.trajectory.with_records(records).save(path)

    @property
    def remedy(self) -> str:
        """All suggestions in one line; empty if there are none."""
        return "; or ".join(self.suggestions)

    @property
    def clearance(self) -> float:
        """Metres: the least that is proven of any of the motions; NaN unless GOOD."""
        return min((motion.certificate.clearance for motion in self.motions), default=float("nan"))
