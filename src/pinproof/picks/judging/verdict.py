"""The verdict on a pick: its stages with figures and reasons, and the motions of a good pick."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, Mover, Obstacle, Scene, proven_millimetres
from pinproof.common import structs as st
from pinproof.common.results import Rows, Shown, View, Written
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
from pinproof.spatial import xyz_rpy


class Stage(Enum):
    """The stages of a pick, in the order in which they are judged."""

    INPUT = "input"
    REACH = "reach"
    LIMITS = "limits"
    SELF = "self-collision"
    GRASP = "grasp"
    GRIP = "grip"
    CHECK = "check"
    APPROACH = "approach"
    RETREAT = "retreat"
    TRANSIT = "transit"
    PLACE = "place"
    HOLD = "hold"
    TIMING = "timing"

    def is_later_than(self, other: Stage) -> bool:
        """Whether this stage is judged after another one."""
        order = list(Stage)
        return order.index(self) > order.index(other)


LINES, REFUTATION = "approach and retreat", "refutation"
"""Further steps of which the time is measured: both lines, and the proof that a pick is impossible."""


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


@st.struct("stage", written=True)
class StageResult:
    """The result of one stage of a pick."""

    stage: Stage = st.key("name of the stage", kind=st.ANY_TEXT)
    ok: bool = st.key("whether it succeeded")
    message: str = st.key("what was found")
    figures: Mapping[str, float] = st.key(
        "numbers by name, in m, rad and s", default_factory=dict, kind=st.mapping_to(st.OPTIONAL_NUMBER)
    )

    def __str__(self) -> str:
        return f"{self.stage.value}: {'passed' if self.ok else 'failed'}: {self.message}"


class ProvenMotion:
    """The combined values of the certificates of a motion, or of the motions of a pick."""

    certificates: tuple[Certificate, ...]

    @st.reported("m")
    def clearance_proven(self) -> float | None:
        """Proven lower bound of every distance; null with a number in ``pairs_proven`` if no two bodies can touch."""
        return float(np.min([each.clearance for each in self.certificates])) if self.certificates else None

    @st.reported("m")
    def clearance_observed(self) -> float | None:
        """Smallest distance found while proving."""
        return float(np.min([each.observed for each in self.certificates])) if self.certificates else None

    @st.reported()
    def pairs_proven(self) -> int | None:
        """Number of pairs of bodies proven."""
        return max((each.pairs for each in self.certificates), default=None)


@st.struct(
    "motion",
    first=("name", "duration", "clearance_proven", "clearance_observed", "pairs_proven", "attached", "backwards",
           "partings", "constraints"),
    written=True,
    eq=False,
)  # fmt: skip
class PickMotion(ProvenMotion, Shown):
    """A part of the motion of a good pick, with its own proof. The parts follow each other.

    Notes
    -----
    The attached bodies and the scene are constant. The certificate is FREE for exactly the trajectory; that of
    ``"place"`` is proven for the reversed motion. A trajectory is at rest at the grasp and at the release. It may move
    at its other end, where the next motion continues with the same velocity: the approach begins on its line, and the
    retreat ends there.
    """

    name: str = st.key("`pick`, or `transit`, `approach`, `retreat`, `transfer`, `place`, `leave`")
    trajectory: Trajectory = st.key("the timed motion", hidden=True)
    certificate: Certificate = st.key("its proof, for `arm.with_held(held)`", hidden=True)
    attached: tuple[Obstacle, ...] = st.key(
        "names of the bodies that move with the tcp",
        kind=st.Kind(
            st.list_of(st.ANY_TEXT).schema, lambda _, value: value, write=lambda found: [each.name for each in found]
        ),
    )
    scene: Scene = st.key("the scene during this motion", hidden=True)
    held: Mapping[str, float] = st.key(
        "values of the joints outside the arm by name, such as finger joints", "rad or m", default_factory=dict,
        hidden=True,
    )  # fmt: skip
    torques: tuple[TorquePeak, ...] = st.key("the largest torques, if torque is limited", default=(), added=True)
    movers: tuple[Mover, ...] = st.key(
        "the obstacles that move during this motion, as seen from its start", default=(), hidden=True
    )

    @property
    def certificates(self) -> tuple[Certificate, ...]:  # type: ignore[override]  # read-only
        """The only certificate."""
        return (self.certificate,)

    @st.reported("s")
    def duration(self) -> float:
        """Duration."""
        return self.trajectory.duration

    @st.reported()
    def backwards(self) -> bool:
        """Whether the reversed motion was proven."""
        return self.certificate.backwards

    @st.reported()
    def partings(self) -> tuple[str, ...]:
        """Pairs that may touch at the start (at the end if ``backwards``), and how they were proven to separate."""
        return tuple(map(str, self.certificate.partings))

    @st.reported()
    def constraints(self) -> tuple[str, ...]:
        """Constraints of the tcp, each with its proven largest error."""
        return tuple(map(str, self.certificate.constraints))

    def __repr__(self) -> str:
        attached = f", attached: {', '.join(thing.name for thing in self.attached)}" if self.attached else ""
        return f"PickMotion({self.name!r}, {self.trajectory.duration:.4g} s, {self.certificate.status.name}{attached})"


@st.struct("intercept", written=True)
class Intercept:
    """Where and when the part is taken from a conveyor."""

    start_time: float = st.key("start of the motion on the clock of the conveyor", "s")
    time: float = st.key("time on that clock at which the tool is at the part", "s")
    travel: float = st.key("distance that the part has moved until then", "m")
    position_deviation: float = st.key(
        "upper bound of the deviation of the tcp while the gripper closes", "m", minimum=0
    )
    rotation_deviation: float = st.key("upper bound of the deviation of its orientation", "rad", minimum=0)


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

    def apply(self, pick: Pick) -> Pick:
        """Return the pick with the change.

        Raises
        ------
        InputError
            If the suggestion does not fit the pick: it is for another frame or length, or the pick has no place, or no
            pose of its own.
        """
        if pick.by_part:
            reason = "its pose is that of a grasp of its part; apply it to the pick of the verdict"
            raise self.does_not_fit(pick, reason)
        return self._changed(pick)

    @abstractmethod
    def _changed(self, pick: Pick) -> Pick:
        """The pick with the change, which has a pose of its own."""

    def __str__(self) -> str:
        return f"{self.text}; it then {self.effect}" if self.effect else self.text

    def does_not_fit(self, pick: Pick, reason: str) -> InputError:
        """The error for a pick that the suggestion was not made for."""
        return InputError(f"{self.text!r} does not fit pick {pick.name!r}: {reason}")


def member_of(grasp: str | None, words: str) -> str:
    """The member of a program: the grasp of the part, and how it differs from the nominal one."""
    return ": ".join(filter(None, (grasp, words)))


@st.struct(
    "verdict",
    first=("name", "verdict", "failed_at", "reason", "remedy", "frame", "xyz", "rpy", "member", "configurations_tried",
           "grip", "grasp", "tool", "grasps_failed", "stages", "refuted", "q_grasp", "grasp_time", "release_time",
           "intercept", "duration", "score",
           "clearance_proven", "clearance_observed", "pairs_proven", "margin", "motions", "excluded_pairs"),
    rules=[
        {
            "if": {"properties": {"verdict": {"const": "good"}}},
            "then": {
                "properties": {
                    "failed_at": {"type": "null"},
                    "q_grasp": {"type": "array"},
                    "grasp_time": {"type": "number"},
                    "duration": {"type": "number"},
                    "pairs_proven": {"type": "integer"},
                    "motions": {"minItems": 1},
                    "refuted": {"maxItems": 0},
                }
            },
            "else": {
                "properties": {"reason": {"minLength": 1}, "duration": {"type": "null"}, "motions": {"maxItems": 0}}
            },
        }
    ],
    written=True,
    eq=False,
)  # fmt: skip
class PickVerdict(ProvenMotion, Shown, Written):
    """The verdict on one pick.

    Notes
    -----
    ``stages`` are those of the attempt that passed the most stages; if one failed, it is the last. Each suggestion is
    the smallest change of its kind of those tried. The pick was judged again with the change exactly as printed: it is
    then good, or the text states the later stage at which it fails.
    """

    pick: Pick = st.key("the pick", hidden=True)
    status: PickStatus = st.key("the verdict; `impossible` is proven, `not found` is not", name="verdict")
    stages: tuple[StageResult, ...] = st.key("the stages in order")
    configurations: int = st.key(
        "number of configurations at the grasp that were tried", name="configurations_tried", default=0, minimum=0
    )
    q_grasp: npt.NDArray[np.float64] | None = st.key(
        "configuration at the grasp", "rad or m", default=None, kind=st.optional(st.list_of(st.PLAIN_NUMBER))
    )
    trajectory: Trajectory | None = st.key("all motions joined; None unless GOOD", default=None, hidden=True)
    grasp_time: float | None = st.key("time of the grasp", "s", default=None)
    certificate: Certificate | None = st.key(
        "FREE for exactly the trajectory of a good pick without an object. With an object the moving bodies change, "
        "and each of `motions` has its own certificate",
        default=None,
        hidden=True,
    )
    motions: tuple[PickMotion, ...] = st.key("the parts of the motion of a good pick", default=())
    release_time: float | None = st.key("time of the release; null without a place", "s", default=None)
    suggestions: tuple[Suggestion, ...] = st.key("one for each kind of change that helps", default=(), hidden=True)
    refuted: tuple[str, ...] = st.key(
        "for an impossible pick: each configuration with the reason why it is excluded", default=()
    )
    member: str = st.key(
        "how the grasp differs from the nominal one, such as its spin; empty for the nominal one", default=""
    )
    score: Mapping[str, float] = st.key(
        "the parts of the score, from 0 to 1, and under `score` their weighted sum",
        default_factory=dict,
        kind=st.mapping_to(st.OPTIONAL_NUMBER),
    )
    grip: GripResult | None = st.key("how the part of a good pick is held", default=None, added=True)
    intercept: Intercept | None = st.key("where and when a part is taken from a conveyor", default=None, added=True)
    grasps_failed: tuple[str, ...] = st.key(
        "the other grasps of its part that were tried, each with the stage at which it failed and the reason",
        default=(),
        added=True,
    )

    def __post_init__(self) -> None:
        freeze_arrays(self, "q_grasp")

    def _view(self) -> View:
        rows = ([each.stage.value, "passed" if each.ok else "failed", each.message] for each in self.stages)
        table = Rows(("stage", "result", "figures or reason"), rows)
        pick, tool = self.pick, f" with {self.pick.tool}" if self.pick.tool else ""
        grasp = () if pick.grasp is None else (f"grasp {pick.grasp} of {pick.part}{tool}",)
        notes = (*grasp, *(f"failed: {each}" for each in self.grasps_failed))
        notes += tuple(f"suggestion: {each}" for each in self.suggestions)
        at = "" if self.failed is None else f" at {self.failed.value}"
        seconds = "" if self.trajectory is None else f", {self.trajectory.duration:.2f} s"
        proven = f", {proven_millimetres(self.clearance)} clearance proven" if self.motions else ""
        headline = f"{pick.name}: {self.status.value.upper()}{at}{seconds}{proven}"
        return View(headline, [table, notes, self.refuted], (*map(str, self.stages), *notes))

    @property
    def ok(self) -> bool:
        """Whether the pick is GOOD."""
        return self.status is PickStatus.GOOD

    @st.reported(name="failed_at", kind=st.optional(st.ANY_TEXT))
    def failed(self) -> Stage | None:
        """The stage that failed; null for a good pick."""
        return None if self.ok else self.stages[-1].stage

    @st.reported(kind=st.optional(st.ANY_TEXT))
    def grasp(self) -> str | None:
        """The grasp of its part with which it was judged; null for a pick with a pose of its own."""
        return self.pick.grasp

    @st.reported(kind=st.optional(st.ANY_TEXT))
    def tool(self) -> str | None:
        """The tool with which it was judged; null if the file has no tools."""
        return self.pick.tool

    @st.reported()
    def reason(self) -> str:
        """Why it failed, or what is proven of a good pick: the message of the last stage judged."""
        return self.stages[-1].message

    @st.reported(kind=st.TEXT)
    def name(self) -> str:
        """Name of the pick."""
        return self.pick.name

    @st.reported()
    def frame(self) -> str:
        """The frame of the pose; empty for the root link of the robot."""
        return self.pick.frame

    @st.reported("m")
    def xyz(self) -> tuple[float, float, float]:
        """Position of the tip at the nominal grasp."""
        x, y, z = (xyz_rpy(self.pick.pose)[:3] + 0.0).tolist()  # no negative zeros
        return x, y, z

    @st.reported("rad")
    def rpy(self) -> tuple[float, float, float]:
        """Its orientation about fixed axes: R = Rz Ry Rx."""
        roll, pitch, yaw = (xyz_rpy(self.pick.pose)[3:] + 0.0).tolist()
        return roll, pitch, yaw

    @st.reported("s")
    def duration(self) -> float | None:
        """Duration of the motion."""
        return None if self.trajectory is None else self.trajectory.duration

    @property
    def certificates(self) -> tuple[Certificate, ...]:  # type: ignore[override]  # read-only
        """The certificates of all motions."""
        return tuple(motion.certificate for motion in self.motions)

    @st.reported("m")
    def margin(self) -> float | None:
        """Required distance between any two bodies."""
        return min((each.margin for each in self.certificates), default=None)

    @st.reported(kind=st.list_of(st.list_of(st.ANY_TEXT, 3, 3)))
    def excluded_pairs(self) -> tuple[tuple[str, str, str], ...]:
        """Pairs that no proof covers: name, name, reason."""
        pairs = (pair for certificate in self.certificates for pair in certificate.excluded)
        return tuple(dict.fromkeys((*pair.owners, pair.reason) for pair in pairs))

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
        # What happens on the way, in order, in whole nanoseconds of motion
        name = self.pick.object_name or ""
        pending = [("grip", _clock(self.grasp_time or 0.0), grip_dwell)]
        if self.release_time is not None:
            pending.append(("release", _clock(self.release_time), release_dwell))
        # One segment for each motion; a motion that contains the grasp is split there
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
            # An event, and its dwell time, follows the segment that ends at its time
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
            self.pick.name,
            tuple(segments),
            tuple(events),
            records,
            robot=robot,
            tcp=tcp,
            member=member_of(self.grasp, self.member),
        )

    @st.reported()
    def remedy(self) -> str:
        """All suggestions with their effects in one line; empty if none was found."""
        return "; or ".join(map(str, self.suggestions))

    @property
    def clearance(self) -> float:
        """Metres: the smallest proven clearance of all motions; NaN unless GOOD."""
        return min((motion.certificate.clearance for motion in self.motions), default=float("nan"))


def grasp_failure(verdict: PickVerdict) -> str:
    """The grasp of a failed verdict, with the stage and the reason in one line."""
    return f"{verdict.pick.grasp}: {verdict.stages[-1].stage.value}: {verdict.reason.split('; ')[0]}"


def _clock(seconds: float) -> int:
    return round(seconds * NANO)
