"""The verdict on a pick: its stages with figures and reasons, and the motions of a good pick."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, Mover, Obstacle, Scene, proven_millimetres
from pinproof.common.results import Rows, Shown, View
from pinproof.common.structs import ANY_TEXT, OPTIONAL_NUMBER, key, mapping_to, struct
from pinproof.common.validation import freeze_arrays
from pinproof.errors import InputError
from pinproof.motion import (
    NANO,
    EventKind,
    MotionProgram,
    MotionRecord,
    ProgramEvent,
    ProgramSegment,
    TorquePeak,
    Trajectory,
    certificate_id,
)
from pinproof.picks.input.pick import Pick
from pinproof.picks.judging.grip import GripResult


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
    """The pick has certified, timed motions."""
    IMPOSSIBLE = "impossible"
    """Every configuration of every grasp is refuted: all were enumerated in closed form, or the grasp is proven to be
    out of reach or every configuration to be in collision (also of redundant arms), or what is at the tcp penetrates an
    obstacle, or no grasp holds the part. The last two do not depend on the configuration. The same may hold for a pose
    on a straight line or for the release."""
    NOT_FOUND = "not found"
    """No solution was found within the budget; one may exist."""
    UNREADABLE = "unreadable"
    """The pick is invalid for this scene or robot."""
    CRASHED = "crashed"
    """The pick could not be judged: the judge raised an error or its process died."""


@struct("stage", more=True, written=True)
class StageResult:
    """The result of one stage of a pick."""

    stage: Stage = key("name of the stage", kind=ANY_TEXT)
    ok: bool = key("whether it succeeded")
    message: str = key("what was found")
    figures: Mapping[str, float] = key(
        "numbers by name, in m, rad and s", default_factory=dict, kind=mapping_to(OPTIONAL_NUMBER)
    )

    def __str__(self) -> str:
        return f"{self.stage.value}: {'passed' if self.ok else 'failed'}: {self.message}"


@dataclass(frozen=True, eq=False)
class PickMotion:
    """A part of a pick's motion with constant attached bodies and constant scene.

    Parameters
    ----------
    name
        ``"pick"``, the only motion of a pick without an object; otherwise ``"transit"``, ``"approach"``, ``"retreat"``,
        ``"transfer"``, ``"place"``, ``"leave"``; on a conveyor also ``"tracking"``, while the
        gripper closes, and ``"release"``, while it opens.
    trajectory
        At rest at the grasp and at the release. It may move at its other end, where the next motion continues with the
        same velocity: the approach begins on its line, and the retreat ends there.
    certificate
        FREE for exactly this trajectory; that of ``"place"`` is proven for the reversed motion.
    attached
        The bodies attached to the tcp: tool, fingers, object; poses are ``tcp_from_body``.
    scene
        The scene during this motion.
    held
        Values of the joints outside the arm (rad or m by name), such as finger joints. The certificate is for
        ``arm.with_held(held)``.
    torques
        The largest torque of each joint; empty unless torque is limited.
    movers
        The obstacles that move during this motion, as seen from its start; the certificate includes them.
    """

    name: str
    trajectory: Trajectory
    certificate: Certificate
    attached: tuple[Obstacle, ...]
    scene: Scene
    held: Mapping[str, float] = field(default_factory=dict)
    torques: tuple[TorquePeak, ...] = ()
    movers: tuple[Mover, ...] = ()

    def __repr__(self) -> str:
        attached = f", attached: {', '.join(thing.name for thing in self.attached)}" if self.attached else ""
        return f"PickMotion({self.name!r}, {self.trajectory.duration:.4g} s, {self.certificate.status.name}{attached})"


@struct("intercept", more=True, written=True)
class Intercept:
    """Where and when the part is taken from a conveyor."""

    start_time: float = key("start of the motion on the clock of the conveyor", "s")
    time: float = key("time on that clock at which the tool is at the part", "s")
    travel: float = key("distance that the part has moved until then", "m")
    position_deviation: float = key("upper bound of the deviation of the tcp while the gripper closes", "m", minimum=0)
    rotation_deviation: float = key("upper bound of the deviation of its orientation", "rad", minimum=0)


@dataclass(frozen=True, kw_only=True)
class Suggestion(ABC):
    """A change of a failed pick that was judged; ``str`` is its text, with every number as :meth:`apply` uses it.

    Parameters
    ----------
    effect
        The stage that the changed pick passes and the later one at which it fails; empty if it is good.
    """

    effect: str = ""

    @property
    @abstractmethod
    def text(self) -> str:
        """The change in one line, without its effect, such as ``move the pick 20 mm along -x (base frame)``."""

    @abstractmethod
    def apply(self, pick: Pick) -> Pick:
        """Return the pick with the change.

        Raises
        ------
        InputError
            If the suggestion does not fit the pick: it is for another frame or length, or the pick has no place.
        """

    def __str__(self) -> str:
        return f"{self.text}; it then {self.effect}" if self.effect else self.text

    def does_not_fit(self, pick: Pick, reason: str) -> InputError:
        """The error for a pick that the suggestion was not made for."""
        return InputError(f"{self.text!r} does not fit pick {pick.name!r}: {reason}")


@dataclass(frozen=True, eq=False)
class PickVerdict(Shown):
    """The verdict on one pick.

    Parameters
    ----------
    pick
        The pick.
    status
        The kind of verdict.
    stages
        The judged stages of the attempt that passed the most stages; if one failed, it is the last.
    configurations
        Number of configurations at the grasp that were tried.
    q_grasp
        (n,) the configuration at the grasp; None unless GOOD.
    trajectory
        All motions joined; None unless GOOD.
    grasp_time
        Seconds from the start of the trajectory to the grasp.
    certificate
        FREE for exactly the trajectory of a good pick without an object. With an object the moving bodies change, and
        each of ``motions`` has its own certificate.
    motions
        The parts of the motion in order; empty unless GOOD.
    release_time
        Seconds from the start of the trajectory to the release; None without a place.
    suggestions
        One for each kind of change that helps, each the smallest of those tried. The pick was judged again with the
        change exactly as printed: it is then good, or the text states the later stage at which it fails.
    refuted
        One line for each configuration with the reason why it is excluded, if the pick is IMPOSSIBLE.
    member
        The difference of the grasp from the nominal grasp of its family, as text.
    grip
        How the part is held, for a good pick with an object.
    score
        The parts of the score and their weighted sum, for a good pick.
    intercept
        Where and when a good pick takes its part from a conveyor; None for parts at rest.
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
    suggestions: tuple[Suggestion, ...] = ()
    refuted: tuple[str, ...] = ()
    member: str = ""
    score: Mapping[str, float] = field(default_factory=dict)
    grip: GripResult | None = None
    intercept: Intercept | None = None

    def __post_init__(self) -> None:
        freeze_arrays(self, "q_grasp")

    def _view(self) -> View:
        rows = ([each.stage.value, "passed" if each.ok else "failed", each.message] for each in self.stages)
        table = Rows(("stage", "result", "figures or reason"), rows)
        lines = (*map(str, self.stages), *self._suggested())
        return View(self._headline, [table, self._suggested(), self.refuted], lines)

    @property
    def _headline(self) -> str:
        at = "" if self.failed is None else f" at {self.failed.value}"
        seconds = "" if self.trajectory is None else f", {self.trajectory.duration:.2f} s"
        proven = f", {proven_millimetres(self.clearance)} clearance proven" if self.motions else ""
        return f"{self.pick.name}: {self.status.value.upper()}{at}{seconds}{proven}"

    def _suggested(self) -> tuple[str, ...]:
        return tuple(f"suggestion: {each}" for each in self.suggestions)

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
        """Write the trajectory of a good pick, with a record of the conditions under which each part is certified.

        The formats are those of :meth:`pinproof.Trajectory.save`.

        Raises
        ------
        InputError
            If the pick is not good and therefore has no motion.
        TrajectoryError
            If the file cannot be written.
        """
        trajectory = self._motion()
        records: list[MotionRecord] = []
        for part in self.motions:
            start = records[-1].end if records else 0.0
            name = part.name if len(self.motions) > 1 else "motion"
            records.append(part.certificate.motion_record(name, start, start + part.trajectory.duration))
        trajectory.with_records(records).save(path)

    def _motion(self) -> Trajectory:
        if self.trajectory is None:
            raise InputError(f"pick {self.pick.name!r} is {self.status.value}, so it has no motion")
        return self.trajectory

    def program(
        self, *, grip_dwell: float = 0.0, release_dwell: float = 0.0, robot: str = "", tcp: str = ""
    ) -> MotionProgram:
        """All motions of a good pick as one program with the events grip and release.

        Parameters
        ----------
        grip_dwell, release_dwell
            Seconds that the arm rests while the gripper closes and while it opens.
        robot, tcp
            The names that the program states; :meth:`pinproof.picks.PickReport.programs` fills them in.

        Raises
        ------
        InputError
            If the pick is not good and therefore has no motion, or a dwell time is negative.
        """
        self._motion()
        if self.intercept is not None:
            raise InputError(
                f"pick {self.pick.name!r} takes its part from a moving conveyor, whose clock a program does not have; "
                "save the motion instead (save_motion)"
            )
        name = self.pick.object_name or ""
        pending = [("grip", _clock(self.grasp_time or 0.0), grip_dwell)]
        if self.release_time is not None:
            pending.append(("release", _clock(self.release_time), release_dwell))
        segments: list[ProgramSegment] = []
        events: list[ProgramEvent] = []
        records: dict[str, MotionRecord] = {}
        moved, rested = 0, 0  # nanoseconds of motion and of dwell time so far
        for number, motion in enumerate(self.motions):
            duration = motion.trajectory.duration
            record = motion.certificate.motion_record(motion.name, 0.0, duration)
            key = certificate_id(record)
            records[key] = record
            parts = [(motion.name, motion.trajectory)]
            inside = [time - moved for _, time, _ in pending[:1] if moved < time < moved + _clock(duration)]
            for time in inside:  # one certificate covers the motions before and after the grasp
                before, after = motion.trajectory.split(time / NANO)
                parts = [(f"{motion.name} to grasp", before), (f"{motion.name} from grasp", after)]
            for title, trajectory in parts:
                segments.append(ProgramSegment(title, (moved + rested) / NANO, trajectory, key))
                moved += _clock(trajectory.duration)
                if pending and pending[0][1] == moved:
                    kind, _, dwell = pending.pop(0)
                    later = self.motions[min(number + 1, len(self.motions) - 1)].held
                    joints = {joint: later[joint] for joint in later if later[joint] != motion.held.get(joint)}
                    now = (moved + rested) / NANO
                    events.append(ProgramEvent(cast(EventKind, kind), now, dwell, name, joints))
                    rested += _clock(dwell)
        return MotionProgram(
            self.pick.name, tuple(segments), tuple(events), records, robot=robot, tcp=tcp, member=self.member
        )

    @property
    def remedy(self) -> str:
        """All suggestions in one line; empty without suggestions."""
        return "; or ".join(map(str, self.suggestions))

    @property
    def clearance(self) -> float:
        """Metres: the smallest proven clearance of all motions; NaN unless GOOD."""
        return min((motion.certificate.clearance for motion in self.motions), default=float("nan"))


def _clock(seconds: float) -> int:
    return round(seconds * NANO)
