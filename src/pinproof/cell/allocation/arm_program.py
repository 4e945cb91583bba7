"""The program of one arm of a cell: the motions and dwell times of its sequence, on its own clock or with waiting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from pinproof.cell.allocation.waiting import Wait
from pinproof.cell.sequencing.sequence_result import SequenceResult
from pinproof.collision import Obstacle
from pinproof.motion import Trajectory
from pinproof.motion.trajectory_files import NANO, whole_nanoseconds
from pinproof.picks import PickMotion

WAIT = "wait"
"""The name of a rest until the other arm has left."""

SAFE = ("transit", "retreat", "transfer", "leave")
"""The motions after which an arm may wait: at their ends the hand is not at a part."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A part of the program of an arm with constant attached objects.

    Parameters
    ----------
    name
        A phase of a sequence, or ``"wait"``.
    pick
        The name of the pick; empty for the motion to the end.
    start
        Seconds from the start of the program.
    trajectory
        From rest to rest.
    motion
        The certified motion; for a dwell time and for a wait the motion before it, at whose end the arm rests.
    carries
        Objects that move with the tcp, tool and part; their poses are ``tcp_from_object``.
    held
        Values (rad or m) of joints outside the arm.
    """

    name: str
    pick: str
    start: float
    trajectory: Trajectory
    motion: PickMotion | None
    carries: tuple[Obstacle, ...]
    held: Mapping[str, float] = field(default_factory=dict)

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.trajectory.duration

    @property
    def end(self) -> float:
        """Seconds from the start of the program."""
        return self.start + self.duration

    @property
    def may_wait(self) -> bool:
        """Whether the arm may wait after this piece."""
        return self.name in SAFE


def pieces_of(result: SequenceResult) -> list[Piece]:
    """The motions and dwell times of a sequence in order."""
    found: list[Piece] = []
    for step in result.steps:
        motions = iter(step.verdict.motions)
        motion: PickMotion | None = None
        for phase in step.phases:
            if phase.name in ("grip", "release") and motion is not None:
                still = _resting(motion.trajectory, phase.duration)
                found.append(replace(found[-1], name=phase.name, trajectory=still))
            else:
                motion = next(motions)
                found.append(_piece(motion, step.pick.name))
    if result.closing is not None:
        found.append(_piece(result.closing, ""))
    return _on_clock(found)


def with_waits(pieces: Sequence[Piece], waits: Sequence[Wait]) -> list[Piece]:
    """The same program with waits, at the start or after a motion."""
    left, found = list(waits), list[Piece]()
    for piece in pieces:
        if left and left[0].time <= piece.start + 0.5 / NANO:
            still = _resting(piece.trajectory, left.pop(0).duration, at=0)
            before = found[-1] if found else replace(piece, motion=None)
            found.append(replace(before, name=WAIT, pick=piece.pick, trajectory=still))
        found.append(piece)
    return _on_clock(found)


def _piece(motion: PickMotion, pick: str) -> Piece:
    return Piece(motion.name, pick, 0.0, motion.trajectory, motion, motion.attached, motion.held)


def _on_clock(pieces: Sequence[Piece]) -> list[Piece]:
    """The pieces with their starts, in integer nanoseconds, as joined trajectories have them."""
    found: list[Piece] = []
    now = 0
    for piece in pieces:
        found.append(replace(piece, start=now / NANO))
        now += int(whole_nanoseconds(piece.trajectory.times)[-1])
    return found


def _resting(trajectory: Trajectory, duration: float, at: int = -1) -> Trajectory:
    """A rest at the end (or, with ``at=0``, at the start) of a motion."""
    quintic = trajectory.accelerations is not None
    return Trajectory.at_rest(trajectory.q[at], trajectory.joint_names, duration, quintic=quintic)
