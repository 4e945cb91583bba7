"""Several arms on a common clock: where they wait for each other, and the proof that they never meet.

The motions of each arm are certified against itself, the obstacles and the parts by its own sequence, at whatever time
they are executed. What depends on the common clock are the pairs of bodies of different arms, with what they carry.
They are certified here, in each interval in which no arm grips or releases anything.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pinproof.cell.allocation.arm_program import WAIT, Piece, pieces_of, with_waits
from pinproof.cell.allocation.waiting import Progress, Wait, shortest_waits
from pinproof.cell.sequencing.sequence_result import SequenceResult
from pinproof.collision import Certificate, CollisionChecker, Obstacle, certify
from pinproof.model import JointGroup
from pinproof.model.chain import link_path
from pinproof.motion import Trajectory, synchronise
from pinproof.motion.trajectory_files import NANO, whole_nanoseconds
from pinproof.spatial import Array

Mask = npt.NDArray[np.bool_]

SLACK = 0.02
"""Metres beyond the margin that the arms keep at the sampled states, so that the motion between them is probably free.
Where it is not, the certificate fails and the states around are avoided."""

BAND = 20.0
"""Seconds by which the times of two arms differ at most in the first search for waiting times."""

REPAIRS = 200
"""Largest number of states around failed certificates that are avoided."""

SAME_PLACE = 6
"""Decimals (m) of the poses of carried parts that are distinguished at sampled states; proofs use exact ones."""


@dataclass(frozen=True, eq=False)
class CommonInterval:
    """An interval of the common clock in which the arms carry the same objects.

    Parameters
    ----------
    start
        Seconds on the common clock.
    trajectory
        The motion of the joint group.
    attached
        The tools and parts of all arms; each names its arm.
    held
        Values (rad or m) of the other joints.
    certificate
        The certificate of all pairs of bodies of different arms.
    """

    start: float
    trajectory: Trajectory
    attached: tuple[Obstacle, ...]
    held: Mapping[str, float]
    certificate: Certificate

    @property
    def end(self) -> float:
        """Seconds on the common clock."""
        return self.start + self.trajectory.duration


@dataclass(frozen=True, eq=False)
class Timing:
    """The programs of all arms on a common clock.

    Parameters
    ----------
    programs
        The pieces of each arm with waits.
    trajectory
        The motion of the joint group.
    intervals
        The certificates of the arms against each other, in order. The last one is not FREE if no waiting
        times were found that make all of them FREE.
    problem
        Why no waiting times were found; empty if they were, or if a certificate states the reason.
    """

    programs: Mapping[str, list[Piece]]
    trajectory: Trajectory
    intervals: tuple[CommonInterval, ...]
    problem: str = ""

    @property
    def free(self) -> bool:
        """Whether the arms are proven not to meet, and execute the picks in the stated order."""
        return not self.problem and all(interval.certificate.free for interval in self.intervals)


@dataclass(eq=False)
class ArmsApart:
    """The checker of the pairs of bodies of different arms of a group, for any carried objects.

    Parameters
    ----------
    checker
        The checker of the group, without a scene and with the tools of all arms.
    """

    checker: CollisionChecker
    _made: dict[object, CollisionChecker] = field(default_factory=dict)

    def __post_init__(self) -> None:
        group = self.checker.group
        self.arm_of = {link: arm_of(group, link) for link in group.robot.urdf.links}

    def carrying(self, attached: Sequence[Obstacle], held: Mapping[str, float]) -> CollisionChecker:
        """The checker with these attached objects, each with the name of its arm."""
        made = self.checker.with_held(held).with_attached(*attached)
        owners = [None if body.link is None else self.arm_of[body.link] for body in made.bodies]
        return made.without_pairs(
            k for k, (i, j) in enumerate(made.pairs) if None in (owners[i], owners[j]) or owners[i] == owners[j]
        )

    def sampled(self, pieces: Mapping[str, Piece], slack: float = SLACK) -> CollisionChecker:
        """The checker for sampled states, with larger margins. Equal parts in the same place of a hand share one."""
        key = (slack, *((name, _alike(piece)) for name, piece in pieces.items()))
        if key not in self._made:
            self._made[key] = self.carrying(*self.carried(pieces)).padded(slack)
        return self._made[key]

    def carried(self, pieces: Mapping[str, Piece]) -> tuple[tuple[Obstacle, ...], dict[str, float]]:
        """What the arms carry where each executes a piece, and the joints that a hand has moved."""
        open_hands = self.checker.group.held
        attached = tuple(replace(thing, arm=name) for name, piece in pieces.items() for thing in piece.carries)
        moved = (item for piece in pieces.values() for item in piece.held.items())
        return attached, {joint: value for joint, value in moved if open_hands.get(joint, value) != value}


def arm_of(group: JointGroup, link: str) -> str | None:
    """The arm whose joints move a link; None if none does, or the link is moved by several."""
    urdf = group.robot.urdf
    joints = {j.name if j.mimic is None else j.mimic.leader for j in link_path(urdf, urdf.root, link)}
    own = [name for name in group.ends if joints & {group.joint_names[i] for i in group.indices(name)}]
    return own[0] if len(own) == 1 else None


def time_together(apart: ArmsApart, home: Array, results: Mapping[str, SequenceResult], order: Order) -> Timing:
    """Let arms wait so that their sequences, executed at the same time, are proven not to collide.

    Two arms are timed so that the later one finishes as early as possible. Further arms wait for those before them.

    Parameters
    ----------
    apart
        The pairs of bodies of different arms.
    home
        (n,) the configuration of the group in which arms without a pick rest.
    results
        The sequences by arm; arms without a pick are left out.
    order
        For pairs of picks (before, after) of different arms: the second starts after the first has ended.
    """
    group = apart.checker.group
    programs = {name: pieces_of(result) for name, result in results.items()}
    placed: list[str] = []
    timing: Timing | None = None
    for name in programs:
        placed.append(name)
        if len(placed) == 1:
            timing = _timing(apart, home, {name: programs[name]})
            continue
        pair = _Pair(apart, home, {each: programs[each] for each in placed}, order)
        timing = pair.solve()
        programs.update(timing.programs)
        if not timing.free:
            break
    if timing is None:
        return Timing({}, Trajectory.at_rest(home, group.joint_names), ())
    return timing


Order = Sequence[tuple[str, str]]


class _Pair:
    """The last of some arms, and the others, which are already timed; if there is one other, both may wait."""

    def __init__(self, apart: ArmsApart, home: Array, programs: Mapping[str, list[Piece]], order: Order) -> None:
        self._apart, self._home, self._programs = apart, home, programs
        *self._others, self._last = programs
        both = len(self._others) == 1
        self._first = _axis([programs[name] for name in self._others], waits=both)
        self._second = _axis([programs[self._last]], waits=True)
        self._order = order

    def solve(self) -> Timing:
        """The timing with the shortest waits whose certificates are FREE; else one that is not."""
        best: Timing | None = None
        for band, slack in ((BAND, SLACK), (np.inf, SLACK), (np.inf, 0.0)):
            blocked = self._states(band, slack)
            for _ in range(REPAIRS):
                found = shortest_waits(self._first, self._second, blocked)
                if found is None:
                    break
                best = self._timed(*found)
                if best.free and (late := self._out_of_order(best)):
                    return replace(best, problem=late)
                if best.free:
                    return best
                self._avoid(blocked, best, found)
        if best is None:
            return replace(self._timed([], []), problem="no waiting times were found that keep the arms apart")
        return best

    def _timed(self, first: list[Wait], second: list[Wait]) -> Timing:
        programs = {name: with_waits(self._programs[name], first) for name in self._others}
        programs[self._last] = with_waits(self._programs[self._last], second)
        return _timing(self._apart, self._home, programs)

    def _avoid(self, blocked: Mask, timing: Timing, found: tuple[list[Wait], list[Wait]]) -> None:
        """Block the states around the instant at which the last certificate failed."""
        failed = timing.intervals[-1]
        contact, span = failed.certificate.first_contact, failed.certificate.undecided
        inside = contact.time if contact is not None else span.start if span is not None else 0.0
        i, j = (
            axis.tick(_own_time(failed.start + inside, waits))
            for axis, waits in zip((self._first, self._second), found, strict=True)
        )
        blocked[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2] = True

    def _states(self, band: float, slack: float) -> Mask:
        """The states that must be avoided: contacts at samples, and violations of the order of picks."""
        group, rows, last = self._apart.checker.group, self._first.times, self._second.times
        columns, own = group.indices(self._last), _samples(self._programs[self._last], last)
        others = [(group.indices(name), _samples(self._programs[name], rows)) for name in self._others]
        hands = [_hands_at(self._programs[name], rows) for name in self._others]
        classes: dict[object, list[int]] = {}
        pieces = _hands_at(self._programs[self._last], last)
        for j, piece in enumerate(pieces):
            classes.setdefault(_alike(piece), []).append(j)
        blocked = np.abs(rows[:, None] - last) > max(band, abs(float(rows[-1] - last[-1])) + band / 2)
        for i in range(len(rows)):
            q = np.repeat(self._home[None], len(last), axis=0)
            for indices, samples in others:
                q[:, indices] = samples[i]
            q[:, columns] = own
            for every in classes.values():
                at = np.array(every)[~blocked[i, every]]
                if len(at):
                    now = (*(each[i] for each in hands), pieces[at[0]])
                    checker = self._apart.sampled(dict(zip((*self._others, self._last), now, strict=True)), slack)
                    blocked[i, at] = ~checker.is_free_batch(q[at])
        for before, after in self._order:
            self._forbid(blocked, before, after)
        return blocked

    def _out_of_order(self, timing: Timing) -> str:
        """The first stated pair of picks that the programs violate, as a sentence; empty if there is none."""
        every = [piece for pieces in timing.programs.values() for piece in pieces if piece.name != WAIT]
        for before, after in self._order:
            ends = [piece.end for piece in every if piece.pick == before]
            starts = [piece.start for piece in every if piece.pick == after]
            if ends and starts and max(ends) > min(starts) + 0.5 / NANO:
                return f"{after} starts before {before} has ended"
        return ""

    def _forbid(self, blocked: Mask, before: str, after: str) -> None:
        """Block the states in which ``after`` has started and ``before`` has not ended, if two arms execute them."""
        sides = ([piece for name in self._others for piece in self._programs[name]], self._programs[self._last])
        for (axis, pieces), (other, those), swapped in (
            ((self._first, sides[0]), (self._second, sides[1]), False),
            ((self._second, sides[1]), (self._first, sides[0]), True),
        ):
            ends = [piece.end for piece in pieces if piece.pick == before]
            starts = [piece.start for piece in those if piece.pick == after]
            if ends and starts:
                # The tick of a rest differs by half a tick from its time, and a motion starts a tick before its state.
                unfinished = np.arange(len(axis.times)) <= axis.tick(max(ends)) + 1
                started = other.times > min(starts) + 0.5 / NANO
                states = unfinished[:, None] & started
                blocked |= states.T if swapped else states


def _axis(programs: Sequence[Sequence[Piece]], *, waits: bool) -> Progress:
    duration = max(pieces[-1].end for pieces in programs)
    return Progress.of(duration, [piece.end for piece in programs[0] if piece.may_wait], waits=waits)


def _own_time(time: float, waits: Sequence[Wait]) -> float:
    """The time of an arm without waiting at a time of the common clock."""
    waited = 0.0
    for wait in waits:
        if time - waited <= wait.time:
            break
        waited += min(wait.duration, time - waited - wait.time)
    return time - waited


def _hands_at(pieces: Sequence[Piece], times: Array) -> list[Piece]:
    """For each time a piece with the objects that the arm carries then, the same for all pieces with the same ones."""
    same: list[Piece] = []
    for piece in pieces:
        same.append(same[-1] if same and _hand(same[-1]) == _hand(piece) else piece)
    at = np.searchsorted([piece.start for piece in pieces], times + 0.5 / NANO, side="right") - 1
    return [same[k] for k in at.tolist()]


def _hand(piece: Piece) -> object:
    return [id(thing) for thing in piece.carries], dict(piece.held)


def _alike(piece: Piece) -> object:
    """A key that is equal for hands that carry equal shapes in the same place."""
    things = ((repr(each.shape), np.round(each.pose.homogeneous, SAME_PLACE).tobytes()) for each in piece.carries)
    return tuple(things), tuple(sorted(piece.held.items()))


def _samples(pieces: Sequence[Piece], times: Array) -> Array:
    joined = Trajectory.join(*(piece.trajectory for piece in pieces))
    return np.asarray(joined(np.minimum(times, joined.duration)))


def _timing(apart: ArmsApart, home: Array, programs: Mapping[str, list[Piece]]) -> Timing:
    """The certificates of programs on a common clock, up to the first that is not FREE."""
    group = apart.checker.group
    parts = {name: Trajectory.join(*(piece.trajectory for piece in pieces)) for name, pieces in programs.items()}
    for name in group.ends:
        if name not in parts:
            index = group.indices(name)
            parts[name] = Trajectory.at_rest(home[index], [group.joint_names[i] for i in index])
    whole = synchronise(parts, group, wait=True)
    clock = whole_nanoseconds(whole.times)
    if len(programs) < 2:
        return Timing(programs, whole, ())
    cuts = {0, int(clock[-1])}
    for pieces in programs.values():
        for piece, other in pairwise(pieces):
            if _hand(piece) != _hand(other):
                cuts.add(round(other.start * NANO))
    ordered = sorted(cuts)
    found: list[CommonInterval] = []
    for begin, end in pairwise(ordered):
        middle = np.array([(begin + end) / 2 / NANO])
        now = {name: _hands_at(pieces, middle)[0] for name, pieces in programs.items()}
        attached, held = apart.carried(now)
        part = whole.between(*np.searchsorted(clock, [begin, end]).tolist())
        certificate = certify(part, apart.carrying(attached, held))
        found.append(CommonInterval(begin / NANO, part, attached, held, certificate))
        if not certificate.free:
            break
    return Timing(programs, whole, tuple(found))
