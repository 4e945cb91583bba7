"""Several arms on a common clock: their programs, where they wait for each other, and the proof that they never meet.

The motions of each arm are certified against itself, the obstacles and the parts by its own sequence, at whatever time
they are executed. What depends on the common clock are the pairs of bodies of different arms, with what they carry.
They are certified here, in each interval in which no arm grips or releases anything.

Waiting times come from the coordination diagram of two arms. Its states are pairs of times, one of each arm without its
waits. From a state, both arms advance by a tick, or one waits while the other advances; an arm waits only where its
path rests. The path through the free states that takes the shortest time is found by dynamic programming over the whole
diagram, so that a deadlock cannot occur.

Sources: P. O'Donnell, T. Lozano-Perez (1989), "Deadlock-free and collision-free coordination of two robot
manipulators", ICRA; K. Kant, S. W. Zucker (1986), "Toward efficient trajectory planning: the path-velocity
decomposition", IJRR 5(3).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate, islice, pairwise
from operator import attrgetter

import numpy as np
import numpy.typing as npt

from pinproof.cell.sequencing.sequence_result import PHASES, SequenceResult
from pinproof.collision import Certificate, CollisionChecker, Obstacle, certify
from pinproof.common import structs as st
from pinproof.model import JointGroup, link_path
from pinproof.motion import NANO, Trajectory, synchronise, whole_nanoseconds
from pinproof.picks import PickMotion
from pinproof.spatial import Array

Mask = npt.NDArray[np.bool_]

WAIT = "wait"
"""The name of a rest until the other arm has left."""

SAFE = ("transit", "unwind", "retreat", "transfer", "leave")
"""The motions after which an arm may wait: at their ends the hand is not at a part."""


@st.struct("arm_phase", first=("name", "pick", "start", "duration"), written=True, eq=False)
class ArmPiece:
    """A motion, a dwell time or a wait of an arm, with constant attached objects."""

    name: str = st.key(f"a phase of a [sequence](sequence.md), or `{WAIT}`", kind=st.choice(*PHASES, WAIT))
    pick: str = st.key("name of the pick; empty for the motion to home")
    start: float = st.key("from the start of the common clock", "s", minimum=0)
    trajectory: Trajectory = st.key("from rest to rest", hidden=True)
    motion: PickMotion | None = st.key(
        "the certified motion; for a dwell time and for a wait the motion before it, at whose end the arm rests",
        hidden=True,
    )
    carries: tuple[Obstacle, ...] = st.key(
        "objects that move with the tcp, tool and part; their poses are ``tcp_from_object``", hidden=True
    )
    held: Mapping[str, float] = st.key(
        "values of joints outside the arm", "rad or m", default_factory=dict, hidden=True
    )

    @st.reported("s", minimum=0)
    def duration(self) -> float:
        """Duration."""
        return self.trajectory.duration

    @property
    def end(self) -> float:
        """Seconds from the start of the common clock."""
        return self.start + self.duration


def pieces_of(result: SequenceResult) -> list[ArmPiece]:
    """The motions and dwell times of a sequence in order."""
    pieces: list[ArmPiece] = []
    timed = [
        (phase.name, phase.motion, phase.duration, step.pick.name) for step in result.steps for phase in step.phases
    ]
    if result.closing is not None:
        timed.append((result.closing.name, result.closing, 0.0, ""))
    for name, motion, duration, pick in timed:
        if motion is None:  # the arm rests where it is, with what it carries
            pieces.append(replace(pieces[-1], name=name, trajectory=_resting(pieces[-1].trajectory, duration)))
        else:
            pieces.append(ArmPiece(name, pick, 0.0, motion.trajectory, motion, motion.attached, motion.held))
    return _on_clock(pieces)


def with_waits(pieces: Sequence[ArmPiece], waits: Sequence[ArmWait]) -> list[ArmPiece]:
    """The same program with waits, at the start or after a motion."""
    left, waiting = list(waits), list[ArmPiece]()
    for piece in pieces:
        if left and left[0].time <= piece.start + 0.5 / NANO:
            still = _resting(piece.trajectory, left.pop(0).duration, row=0)
            before = waiting[-1] if waiting else replace(piece, motion=None)
            waiting.append(replace(before, name=WAIT, pick=piece.pick, trajectory=still))
        waiting.append(piece)
    return _on_clock(waiting)


def _on_clock(pieces: Sequence[ArmPiece]) -> list[ArmPiece]:
    """The pieces with their starts, in integer nanoseconds, as joined trajectories have them."""
    lengths = [int(whole_nanoseconds(piece.trajectory.times)[-1]) for piece in pieces]
    starts = [0, *accumulate(lengths)]
    return [replace(piece, start=start / NANO) for piece, start in zip(pieces, starts, strict=False)]


def _resting(trajectory: Trajectory, duration: float, row: int = -1) -> Trajectory:
    """A rest at the end (or, with ``row=0``, at the start) of a motion."""
    quintic = trajectory.accelerations is not None
    return Trajectory.at_rest(trajectory.q[row], trajectory.joint_names, duration, quintic=quintic)


TICK = 0.05
"""Seconds between two states: the resolution of the waiting times, a small part of a usual motion."""

NEVER = 1e9
"""Ticks: more than any program takes."""

APART = 1e11
"""Offset between the running minima of different runs of free states; above :data:`NEVER`."""


@dataclass(frozen=True)
class ArmWait:
    """An arm waits for ``duration`` seconds where it rests at ``time`` (s), the time without waiting."""

    time: float
    duration: float


@st.described(eq=False)
class ArmAxis:
    """The times of one arm, without waiting, at the ticks of its axis."""

    times: Array = st.key("(N + 1,) seconds; a tick at which the arm may wait has exactly the time of its rest")
    rests: Mask = st.key("(N + 1,) whether the arm may wait there. Before its start and after its end it always may")

    @classmethod
    def of(cls, duration: float, rests: Iterable[float], *, waits: bool = True) -> ArmAxis:
        """The axis of an arm that may wait at these times (s); if ``waits`` is False, only after its end."""
        count = int(np.ceil(duration / TICK - 1e-9))
        times, marks = np.minimum(np.arange(count + 1) * TICK, duration), np.zeros(count + 1, dtype=bool)
        marks[-1] = True
        if not waits:
            return cls(times, marks)
        marks[0] = True
        for time in rests:
            tick = round(time / TICK)
            if tick <= count and not marks[tick]:
                times[tick], marks[tick] = time, True
        return cls(times, marks)

    def tick(self, time: float) -> int:
        """The tick that is nearest to a time (s)."""
        return min(round(time / TICK), len(self.times) - 1)


def shortest_waits(first: ArmAxis, second: ArmAxis, blocked: Mask) -> tuple[list[ArmWait], list[ArmWait]] | None:
    """Where each arm waits in the fastest path from the start of both to the end of both; None if no such path exists.

    The axes have M + 1 and N + 1 ticks; ``blocked`` (M + 1, N + 1) are the states that must be avoided.
    """
    # the earliest arrival at each state in ticks, row by row
    rows, columns = blocked.shape
    ticks, steps = np.full((rows, columns), NEVER), np.arange(columns)
    ticks[0, 0] = 0.0
    for i in range(rows):
        row = ticks[i]
        if i:
            row[1:] = ticks[i - 1, :-1] + 1
            np.minimum(row, np.where(second.rests, ticks[i - 1] + 1, NEVER), out=row)
        row[blocked[i]] = NEVER
        if first.rests[
            i
        ]:  # the first arm waits while the second advances: a running minimum in each run of free states
            run = np.cumsum(blocked[i]) * APART
            waited = np.minimum.accumulate(row - steps - run) + run + steps
            row[:] = np.where(blocked[i], NEVER, waited)
        np.minimum(row, NEVER, out=row)
    if ticks[-1, -1] >= NEVER:
        return None
    # back along the states from which each was reached
    i, j = ends = rows - 1, columns - 1
    waits: tuple[dict[int, int], dict[int, int]] = ({}, {})
    while i or j:
        before = ticks[i, j] - 1
        both = bool(i and j and ticks[i - 1, j - 1] == before)
        second_waits = bool(i and second.rests[j] and ticks[i - 1, j] == before)
        first_waits = bool(j and first.rests[i] and ticks[i, j - 1] == before)
        # An arm that has finished does not wait: it finishes as early as possible.
        if (second_waits and j == ends[1]) or not (both or first_waits):
            waits[1][j] = waits[1].get(j, 0) + 1
            i -= 1
        elif (first_waits and i == ends[0]) or not both:
            waits[0][i] = waits[0].get(i, 0) + 1
            j -= 1
        else:
            i, j = i - 1, j - 1
    first_waits_at, second_waits_at = (
        [ArmWait(float(axis.times[k]), count[k] * TICK) for k in sorted(count) if k < len(axis.times) - 1]
        for axis, count in zip((first, second), waits, strict=True)
    )
    return first_waits_at, second_waits_at


SLACK = 0.02
"""Metres beyond the margin that the arms keep at the sampled states, so that the motion between them is probably free.
Where it is not, the certificate fails and the states around are avoided."""

BAND = 20.0
"""Seconds by which the times of two arms differ at most in the first search for waiting times."""

REPAIRS = 200
"""Largest number of states around failed certificates that are avoided."""

SAME_PLACE = 6
"""Decimals (m) of the poses of carried parts that are distinguished at sampled states; proofs use exact ones."""


PROVEN_APART = st.report_table(
    "proven_apart",
    "What a certificate of the arms against each other proves.",
    st.required("status", st.ANY_TEXT, "`FREE`, or why it is not", get=attrgetter("status.name")),
    st.required(
        "clearance_proven",
        st.OPTIONAL_NUMBER,
        "proven lower bound of the distance of the arms",
        "m",
        attrgetter("clearance"),
    ),
    st.required("pairs_proven", st.COUNT, "pairs of bodies proven", get=attrgetter("pairs")),
)


@st.struct("common_interval", first=("start", "duration"), written=True, eq=False)
class CommonInterval:
    """The certificate of the arms against each other in an interval in which no part is gripped or released."""

    start: float = st.key("from the start of the common clock", "s", minimum=0)
    trajectory: Trajectory = st.key("the motion of the joint group", hidden=True)
    attached: tuple[Obstacle, ...] = st.key("the tools and parts of all arms; each names its arm", hidden=True)
    held: Mapping[str, float] = st.key("values of the other joints", "rad or m", hidden=True)
    certificate: Certificate = st.key("the certificate of all pairs of bodies of different arms", inline=PROVEN_APART)

    @st.reported("s", minimum=0)
    def duration(self) -> float:
        """Duration."""
        return self.trajectory.duration

    @property
    def end(self) -> float:
        """Seconds on the common clock."""
        return self.start + self.trajectory.duration


@st.described(eq=False)
class Timing:
    """The programs of all arms on a common clock."""

    programs: Mapping[str, list[ArmPiece]] = st.key("the pieces of each arm with waits")
    trajectory: Trajectory = st.key("the motion of the joint group")
    intervals: tuple[CommonInterval, ...] = st.key(
        "the certificates of the arms against each other, in order. The last one is not FREE if no waiting times "
        "were found that make all of them FREE"
    )
    problem: str = st.key(
        "why no waiting times were found; empty if they were, or if a certificate states the reason", default=""
    )

    @property
    def free(self) -> bool:
        """Whether the arms are proven not to meet, and execute the picks in the stated order."""
        return not self.problem and all(interval.certificate.free for interval in self.intervals)


@dataclass(eq=False)
class ArmsApart:
    """The checker of the pairs of bodies of different arms of a group, for any carried objects."""

    # The checker of the group, without a scene and with the tools of all arms.
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

    def sampled(self, pieces: Mapping[str, ArmPiece], slack: float = SLACK) -> CollisionChecker:
        """The checker for sampled states, with larger margins. Equal parts in the same place of a hand share one."""
        key = (slack, *((name, _alike(piece)) for name, piece in pieces.items()))
        if key not in self._made:
            self._made[key] = self.carrying(*self.carried(pieces)).padded(slack)
        return self._made[key]

    def carried(self, pieces: Mapping[str, ArmPiece]) -> tuple[tuple[Obstacle, ...], dict[str, float]]:
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


Order = Sequence[tuple[str, str]]


def time_together(apart: ArmsApart, home: Array, results: Mapping[str, SequenceResult], order: Order) -> Timing:
    """Let arms wait so that their sequences, executed at the same time, are proven not to collide.

    Two arms are timed so that the later one finishes as early as possible. Further arms wait for those before them.

    In ``home`` (n,) the arms without a pick rest; they are left out of ``results``. ``order`` has pairs of picks
    (before, after) of different arms: the second starts after the first has ended.
    """
    group = apart.checker.group
    programs = {name: pieces_of(result) for name, result in results.items()}
    timing = Timing({}, Trajectory.at_rest(home, group.joint_names), ())
    for count, name in enumerate(list(programs), start=1):
        if count == 1:
            timing = _timing(apart, home, {name: programs[name]})
            continue
        timing = _Pair(apart, home, dict(islice(programs.items(), count)), order).solve()
        programs.update(timing.programs)
        if not timing.free:
            break
    return timing


class _Pair:
    """The last of some arms, and the others, which are already timed; if there is one other, both may wait."""

    def __init__(self, apart: ArmsApart, home: Array, programs: Mapping[str, list[ArmPiece]], order: Order) -> None:
        self._apart, self._home, self._programs, self._order = apart, home, programs, order
        *self._others, self._last = programs

        def axis(names: list[str], *, waits: bool) -> ArmAxis:
            duration = max(programs[name][-1].end for name in names)
            rests = [piece.end for piece in programs[names[0]] if piece.name in SAFE]
            return ArmAxis.of(duration, rests, waits=waits)

        self._axes = axis(self._others, waits=len(self._others) == 1), axis([self._last], waits=True)

    def solve(self) -> Timing:
        """The timing with the shortest waits whose certificates are FREE; else one that is not."""
        best: Timing | None = None
        for band, slack in ((BAND, SLACK), (np.inf, SLACK), (np.inf, 0.0)):
            blocked = self._blocked(band, slack)
            for _ in range(REPAIRS):
                waits = shortest_waits(*self._axes, blocked)
                if waits is None:
                    break
                best = self._timed(*waits)
                if best.free:
                    return replace(best, problem=self._out_of_order(best))
                # the states around the instant at which the last certificate failed are avoided
                failed = best.intervals[-1]
                contact, span = failed.certificate.first_contact, failed.certificate.undecided
                inside = contact.time if contact is not None else span.start if span is not None else 0.0
                i, j = (
                    axis.tick(_time_without_waits(failed.start + inside, own))
                    for axis, own in zip(self._axes, waits, strict=True)
                )
                blocked[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2] = True
        if best is None:
            return replace(self._timed([], []), problem="no waiting times were found that keep the arms apart")
        return best

    def _timed(self, first: list[ArmWait], second: list[ArmWait]) -> Timing:
        programs = {name: with_waits(self._programs[name], first) for name in self._others}
        programs[self._last] = with_waits(self._programs[self._last], second)
        return _timing(self._apart, self._home, programs)

    def _blocked(self, band: float, slack: float) -> Mask:
        """The states that must be avoided: contacts at samples, and violations of the order of picks."""
        group, rows, last = self._apart.checker.group, self._axes[0].times, self._axes[1].times
        columns, own = group.indices(self._last), _samples(self._programs[self._last], last)
        others = [(group.indices(name), _samples(self._programs[name], rows)) for name in self._others]
        hands = [_hands_at(self._programs[name], rows) for name in self._others]
        # states of the last arm in which its hand carries the same share a checker
        pieces = _hands_at(self._programs[self._last], last)
        alike: dict[object, list[int]] = {}
        for j, piece in enumerate(pieces):
            alike.setdefault(_alike(piece), []).append(j)
        blocked = np.abs(rows[:, None] - last) > max(band, abs(float(rows[-1] - last[-1])) + band / 2)
        for i in range(len(rows)):
            q = np.repeat(self._home[None], len(last), axis=0)
            for indices, samples in others:
                q[:, indices] = samples[i]
            q[:, columns] = own
            for members in alike.values():
                states = np.array(members)[~blocked[i, members]]
                if len(states):
                    now = (*(hand[i] for hand in hands), pieces[states[0]])
                    checker = self._apart.sampled(dict(zip((*self._others, self._last), now, strict=True)), slack)
                    blocked[i, states] = ~checker.is_free_batch(q[states])
        # states in which a pick has started and one before it has not ended, if two arms execute them
        sides = ([piece for name in self._others for piece in self._programs[name]], self._programs[self._last])
        for before, after in self._order:
            for first, second in ((0, 1), (1, 0)):
                ends = [piece.end for piece in sides[first] if piece.pick == before]
                starts = [piece.start for piece in sides[second] if piece.pick == after]
                if ends and starts:
                    # The tick of a rest differs by half a tick from its time; a motion starts a tick before its state.
                    axis = self._axes[first]
                    unfinished = np.arange(len(axis.times)) <= axis.tick(max(ends)) + 1
                    started = self._axes[second].times > min(starts) + 0.5 / NANO
                    wrong = unfinished[:, None] & started
                    blocked |= wrong.T if first else wrong
        return blocked

    def _out_of_order(self, timing: Timing) -> str:
        """The first stated pair of picks that the programs violate, as a sentence; empty if there is none."""
        pieces = [piece for program in timing.programs.values() for piece in program if piece.name != WAIT]
        for before, after in self._order:
            ends = [piece.end for piece in pieces if piece.pick == before]
            starts = [piece.start for piece in pieces if piece.pick == after]
            if ends and starts and max(ends) > min(starts) + 0.5 / NANO:
                return f"{after} starts before {before} has ended"
        return ""


def _time_without_waits(time: float, waits: Sequence[ArmWait]) -> float:
    """The time of an arm without waiting at a time of the common clock."""
    waited = 0.0
    for wait in waits:
        if time - waited <= wait.time:
            break
        waited += min(wait.duration, time - waited - wait.time)
    return time - waited


def _hands_at(pieces: Sequence[ArmPiece], times: Array) -> list[ArmPiece]:
    """For each time a piece with the objects that the arm carries then, the same for all pieces with the same ones."""
    same: list[ArmPiece] = []
    for piece in pieces:
        same.append(same[-1] if same and _hand(same[-1]) == _hand(piece) else piece)
    rows = np.searchsorted([piece.start for piece in pieces], times + 0.5 / NANO, side="right") - 1
    return [same[k] for k in rows.tolist()]


def _hand(piece: ArmPiece) -> object:
    return [id(thing) for thing in piece.carries], dict(piece.held)


def _alike(piece: ArmPiece) -> object:
    """A key that is equal for hands that carry equal shapes in the same place."""
    things = ((repr(thing.shape), np.round(thing.pose.homogeneous, SAME_PLACE).tobytes()) for thing in piece.carries)
    return tuple(things), tuple(sorted(piece.held.items()))


def _samples(pieces: Sequence[ArmPiece], times: Array) -> Array:
    joined = Trajectory.join(*(piece.trajectory for piece in pieces))
    return np.asarray(joined(np.minimum(times, joined.duration)))


def _timing(apart: ArmsApart, home: Array, programs: Mapping[str, list[ArmPiece]]) -> Timing:
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
    # an interval ends where the hand of an arm changes
    cuts = {0, int(clock[-1])}
    for pieces in programs.values():
        cuts |= {round(after.start * NANO) for piece, after in pairwise(pieces) if _hand(piece) != _hand(after)}
    intervals: list[CommonInterval] = []
    for begin, end in pairwise(sorted(cuts)):
        middle = np.array([(begin + end) / 2 / NANO])
        now = {name: _hands_at(pieces, middle)[0] for name, pieces in programs.items()}
        attached, held = apart.carried(now)
        part = whole.between(*np.searchsorted(clock, [begin, end]).tolist())
        certificate = certify(part, apart.carrying(attached, held))
        intervals.append(CommonInterval(begin / NANO, part, attached, held, certificate))
        if not certificate.free:
            break
    return Timing(programs, whole, tuple(intervals))
