"""The steps of a robot program: moves, set points, outputs and waiting times."""

from __future__ import annotations

from dataclasses import dataclass

from pinproof.motion.trajectory_files import Record
from pinproof.spatial import SE3, Array


@dataclass(frozen=True)
class Blend:
    """The part of the two moves at a point in which the controller may leave their straight lines.

    Parameters
    ----------
    radius
        Metres between the tcp and its position at the point; None if the controller does not use a radius.
    share
        Largest share of each of the two moves that the blend may use.
    """

    radius: float | None = None
    share: float = 0.5


@dataclass(frozen=True, eq=False)
class JointMove:
    """A move on a straight line in joint space: all joints start and end at the same time, in constant proportion.

    Parameters
    ----------
    q
        (n,) rad, the end of the move.
    duration
        Seconds; None if the text states a speed instead.
    blend
        None for a stop at the end.
    line
        The line number in the text, from 1.
    speed
        rad/s of the joint that moves farthest; None if the text states none.
    """

    q: Array
    duration: float | None = None
    blend: Blend | None = None
    line: int = 0
    speed: float | None = None


@dataclass(frozen=True, eq=False)
class LinearMove:
    """A move of the tcp on a straight line, with a stop at its end.

    Parameters
    ----------
    q
        (n,) rad, the configuration at the end; None if the text states the pose.
    pose
        ``base_from_tcp`` at the end; None if the text states joint values.
    duration
        Seconds; None if the text states a speed instead.
    line
        The line number in the text, from 1.
    speed
        m/s of the tcp; None if the text states none.
    """

    q: Array | None = None
    pose: SE3 | None = None
    duration: float | None = None
    line: int = 0
    speed: float | None = None


@dataclass(frozen=True, eq=False)
class StreamedPoint:
    """A set point that the program sends every ``period`` seconds; the arm does not stop."""

    q: Array
    period: float
    line: int = 0


@dataclass(frozen=True, eq=False)
class StreamedTrajectory:
    """The points of a trajectory that the controller interpolates exactly as :class:`~pinproof.Trajectory` does."""

    record: Record
    line: int = 0


@dataclass(frozen=True)
class SetOutput:
    """A digital output, such as that of a gripper, switched while the arm rests."""

    output: str
    on: bool
    line: int = 0


@dataclass(frozen=True)
class Wait:
    """A waiting time in seconds, while the arm rests."""

    seconds: float
    line: int = 0


Step = JointMove | LinearMove | StreamedPoint | StreamedTrajectory | SetOutput | Wait
