"""The result of :func:`pinproof.cell.allocate`: the program of each arm on a common clock, and the certificates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from pinproof.cell.allocation.arm_program import WAIT, Piece
from pinproof.cell.allocation.common_clock import CommonInterval, Timing
from pinproof.cell.sequencing.blocking import AT_PLACE
from pinproof.cell.sequencing.sequence_result import LeftOut, SequenceResult
from pinproof.collision import Obstacle, Scene
from pinproof.common.display import outline
from pinproof.errors import NoAnswer
from pinproof.model import JointGroup, guess_mark
from pinproof.motion import Trajectory
from pinproof.picks import Picks
from pinproof.spatial import SE3

SAME_PLACE = 1e-6
"""Relative difference of poses below which a part is where it was assumed to be."""


@dataclass(frozen=True)
class OneArm:
    """The time that one arm alone takes for all picks.

    Parameters
    ----------
    arm
        The arm.
    duration
        Seconds; None if it cannot execute all picks.
    reason
        Why it cannot.
    """

    arm: str
    duration: float | None
    reason: str


@dataclass(frozen=True)
class ArmTime:
    """The time of one arm.

    Parameters
    ----------
    arm
        The arm.
    picks
        Its picks in order.
    duration
        Seconds until it is at home again.
    waiting
        Seconds that it waits for other arms.
    utilisation
        The share of the makespan in which it executes its sequence.
    """

    arm: str
    picks: tuple[str, ...]
    duration: float
    waiting: float
    utilisation: float


@dataclass(frozen=True)
class PartState:
    """A part that an arm grips, carries and releases.

    Parameters
    ----------
    arm
        The arm.
    before, after
        The part in the scene until the grip, and after the release; ``before`` is None for a part that the scene does
        not contain.
    gripped, released
        Seconds on the common clock.
    """

    arm: str
    before: Obstacle | None
    after: Obstacle
    gripped: float
    released: float


@dataclass(frozen=True, eq=False)
class AllocationResult:
    """Picks of several arms with certified motions on a common clock.

    Parameters
    ----------
    group
        The arms.
    scene
        The obstacles before the first pick.
    picks
        The picks as given.
    timing
        The pieces of each arm on the common clock, the motion of the group, and the certificates of the arms against
        each other.
    sequences
        The sequence of each arm that has a pick, on its own clock.
    left_out
        The picks that no arm can execute.
    alone
        The time of each arm for all picks, if it was computed.
    tools
        The open tools of all arms; each names its arm.
    """

    group: JointGroup
    scene: Scene
    picks: Picks
    timing: Timing
    sequences: Mapping[str, SequenceResult]
    left_out: tuple[LeftOut, ...]
    alone: tuple[OneArm, ...] = ()
    tools: tuple[Obstacle, ...] = ()

    def __repr__(self) -> str:
        rows = (
            f"{each.arm}: {len(each.picks)} picks in {each.duration:.2f} s, including {each.waiting:.2f} s of waiting"
            for each in self.arms
        )
        return outline(f"AllocationResult({self.message})", rows)

    @property
    def programs(self) -> Mapping[str, list[Piece]]:
        """The pieces of each arm that has a pick, with waits, on the common clock."""
        return self.timing.programs

    @property
    def trajectory(self) -> Trajectory:
        """The motion of all joints of the group; :func:`pinproof.motion.separate` divides it into one for each arm."""
        return self.timing.trajectory

    @property
    def intervals(self) -> tuple[CommonInterval, ...]:
        """The certificates of the arms against each other."""
        return self.timing.intervals

    @property
    def makespan(self) -> float:
        """Seconds until all arms are at home again."""
        return self.trajectory.duration

    @cached_property
    def arms(self) -> tuple[ArmTime, ...]:
        """The time of each arm of the group."""
        found = []
        for name in self.group.ends:
            pieces = self.programs.get(name, [])
            sequence = self.sequences.get(name)
            waiting = sum(piece.duration for piece in pieces if piece.name == WAIT)
            duration = pieces[-1].end if pieces else 0.0
            share = (duration - waiting) / self.makespan if self.makespan else 0.0
            found.append(ArmTime(name, () if sequence is None else sequence.order, duration, waiting, share))
        return tuple(found)

    @property
    def missing(self) -> tuple[LeftOut, ...]:
        """The picks that are not executed, with the reasons: those that no arm can do, and those left out later."""
        more = (
            LeftOut(each.name, f"{arm}: {each.reason}")
            for arm, sequence in self.sequences.items()
            for each in sequence.left_out
        )
        return (*self.left_out, *more)

    @property
    def one_arm(self) -> OneArm | None:
        """The arm that alone takes the shortest time for all picks; None if no arm can or none was tried."""
        able = [each for each in self.alone if each.duration is not None]
        return min(able, key=lambda each: each.duration or 0.0, default=None)

    @property
    def ratio(self) -> float:
        """The makespan divided by the time of one arm for all picks; NaN if it is not known."""
        one = self.one_arm
        return float("nan") if one is None or not one.duration else self.makespan / one.duration

    @property
    def free(self) -> bool:
        """Whether every motion is certified, and the arms are proven not to meet."""
        own = all(motion.certificate.free for each in self.sequences.values() for motion in each.motions)
        return own and self.timing.free and not self.misplaced

    @property
    def ok(self) -> bool:
        """Whether every pick is executed and everything is certified."""
        return self.free and not self.missing

    @property
    def clearance(self) -> float:
        """Metres: the smallest proven clearance, between the arms and of each of them."""
        own = [motion.certificate.clearance for each in self.sequences.values() for motion in each.motions]
        return min([*own, *(each.certificate.clearance for each in self.intervals)], default=float("nan"))

    @property
    def message(self) -> str:
        """The result in one line."""
        count = sum(len(each.picks) for each in self.arms)
        if not count:
            return "no pick can be executed"
        guess = guess_mark(self.group.limits.acceleration_source)
        shares = ", ".join(f"{each.arm} {100 * each.utilisation:.0f} %" for each in self.arms)
        text = f"{count} picks of {len(self.arms)} arms in {self.makespan:.1f} s{guess}; utilisation {shares}"
        if self.one_arm is not None:
            text += f"; {self.one_arm.arm} alone takes {self.one_arm.duration:.1f} s, ratio {self.ratio:.2f}"
        if self.missing:
            text += f"; {len(self.missing)} left out"
        return text if self.free else f"{text}; NOT PROVEN: {self.reason}"

    @property
    def reason(self) -> str:
        """Why not everything is certified; empty if it is."""
        if self.timing.problem or self.misplaced:
            return self.timing.problem or self.misplaced
        failed = next((each for each in self.intervals if not each.certificate.free), None)
        if failed is not None:
            return f"{failed.start:.2f} s to {failed.end:.2f} s: {failed.certificate.message}"
        motion = next((m for s in self.sequences.values() for m in s.motions if not m.certificate.free), None)
        return "" if motion is None else motion.certificate.message

    @property
    def notes(self) -> tuple[str, ...]:
        """What the certificates do not cover, one sentence each."""
        with_object = {pick.carried is not None for pick in self.picks}
        found = (note for each in self.sequences.values() for note in each.setup.not_covered(with_object))
        return tuple(dict.fromkeys(found))

    def or_raise(self) -> AllocationResult:
        """Return the result if every pick is executed and everything is certified.

        Raises
        ------
        NoAnswer
            If it is not.
        """
        if self.ok:
            return self
        reasons = [f"{each.name}: {each.reason}" for each in self.missing] or [self.reason]
        raise NoAnswer(f"the picks cannot all be executed: {'; '.join(reasons)}")

    @cached_property
    def parts(self) -> Mapping[str, PartState]:
        """For each part when and where it is gripped and released."""
        found = {}
        for name, pieces in self.programs.items():
            tools = {body.name for body in self.sequences[name].setup.shared.open_tool}
            own = self.sequences[name].setup.checker.arm
            carrying: dict[str, list[Piece]] = {}
            for piece in pieces:
                for thing in piece.carries:
                    if thing.name not in tools:
                        carrying.setdefault(thing.name, []).append(piece)
            for part, held in carrying.items():
                thing = next(each for each in held[-1].carries if each.name == part)
                tcp = own.root_from_frame(held[-1].trajectory.end, own.tcp)
                before = self.scene.get(part)
                after = Obstacle(part, thing.shape, tcp * SE3(thing.pose), thing.rgba)
                found[part] = PartState(name, before, after, held[0].start, held[-1].end)
        return found

    @cached_property
    def misplaced(self) -> str:
        """The first part that is put where the motions of another arm are not certified with it; empty without one.

        An object that is stated in the tcp rotates with the grasp, so that its place depends on the chosen option.
        """
        for part, state in self.parts.items():
            for name, sequence in self.sequences.items():
                scene = sequence.setup.checker.scene
                known = [each.pose for each in scene.obstacles if each.name.startswith(part + AT_PLACE)]
                if name != state.arm and not any(pose.isApprox(state.after.pose, SAME_PLACE) for pose in known):
                    return f"{name} is not certified with {part} where {state.arm} places it"
        return ""

    def scene_at(self, time: float) -> Scene:
        """The scene at a time (s) of the common clock, without the parts that are carried then."""
        scene = self.scene
        for part, state in self.parts.items():
            if part in scene and time >= state.gripped:
                scene = scene.remove(part)
            if time >= state.released:
                scene = scene.add(state.after)
        return scene

    def __iter__(self) -> Iterator[ArmTime]:
        return iter(self.arms)
