"""Is a whole curve free of contact? Proven between samples, not sampled.

The curve is cut into intervals in path order. In each, the distance of every pair at the middle is compared with how
much nearer the pair can come anywhere in the interval (:mod:`pinproof.kernels.approach`): what is settled is dropped,
what is not is taken to both halves. A contact at a middle ends the search to its right; the search to its left goes on
until everything before the contact is proven free or the tolerance is met. The loop itself is compiled
(:mod:`pinproof.kernels.sweep`); where a body has no support function, it stops and asks coal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pinproof.collision.by_coal import Distance
from pinproof.collision.certificate import (
    Certificate,
    CertificateStatus,
    FirstContact,
    MotionTube,
    UndecidedSpan,
    checked_hash,
    curve_hash,
    free_sentence,
)
from pinproof.collision.checker import CollisionChecker
from pinproof.collision.contact import Contact
from pinproof.collision.notes import notes_of
from pinproof.collision.parting import prove_parting
from pinproof.collision.placed import NEAREST
from pinproof.collision.recorded import changes_since
from pinproof.errors import InputError
from pinproof.motion import Curve
from pinproof.motion.curve import read_only
from pinproof.spatial import finite

__all__ = ["certify", "is_proven_free"]

Array = npt.NDArray[np.float64]

GOAL_SHARE = 0.5
"""A pair is settled once this share of the clearance seen so far is proven, so that the proven bound says something."""

LOOK_AHEAD = 200
"""Intervals: how far behind a span that stays undecided a contact is looked for, to say COLLIDING where that is so."""

TOLERANCE = 1e-4
"""Metres: a hundredth of what a careful cell leaves between bodies; an interval in which they move less is not cut."""

TOLERANCES = (TOLERANCE, 1e-5, 1e-6)
"""Metres: what is UNDECIDED at one of them is proven again at the next. A path that a planner proved with little to
spare may need it once it is timed, since its pieces are cut elsewhere then. Only spans that stay open cost more, a few
halvings each; below 1e-6 m the slack of coal's distances, 2e-6 m, decides anyway."""

QUICK_INTERVALS = 2000
"""Intervals after which a quick proof is given up: a hundred times those of a short piece in the open."""

DEPTH = 192
"""Entries on the stack of intervals. Halving 60 times leaves no two numbers to tell apart; a curve of 2^64 pieces is
not met."""

LISTS = 16
"""Times the number of pairs: room for the lists of open pairs at first; they grow where it is too little."""


def certify(
    curve: Curve,
    checker: CollisionChecker,
    *,
    tolerance: float | None = None,
    max_intervals: int = 200_000,
    joint_tolerance: npt.ArrayLike = 0.0,
    obstacle_tolerance: float = 0.0,
    parting: Sequence[tuple[str, str]] = (),
    record: bool = False,
) -> Certificate:
    """Prove that a curve is free of contact, or show where it is not.

    Parameters
    ----------
    curve
        A :class:`~pinproof.JointPath`, :class:`~pinproof.motion.CubicPath` or :class:`~pinproof.Trajectory`.
    checker
        Says which bodies are checked, and the margins that must stay between them.
    tolerance
        Metres. An interval in which no body moves farther than this towards another is not cut any further; a curve
        that grazes by less may be UNDECIDED. By default 1e-4, and where that leaves the verdict UNDECIDED, 1e-5 and
        1e-6; :attr:`Certificate.tolerance` is the one that the verdict was reached with.
    max_intervals
        The number of intervals after which the answer is UNDECIDED, for each tolerance.
    joint_tolerance
        rad or m, one number or (n,): prove it for every configuration that differs from one of the curve by no more
        than this in each joint, what a controller may deviate.
    obstacle_tolerance
        Metres: prove it for obstacles any of which may be moved, turned or grown, as long as no point of its surface
        comes farther than this.
    parting
        Pairs of names, a link or attached object and an obstacle each, that may touch at the start, such as a part and
        what it lies on: proven never to approach until they have left each other, and to keep their margin from then
        on. So they are not just left out, as :meth:`CollisionChecker.allowing` does. Not with ``joint_tolerance``.
    record
        Keep what a proof has to tell in :attr:`Certificate.evidence`, for :meth:`Certificate.save`.

    Returns
    -------
    Certificate
        FREE, COLLIDING or UNDECIDED. FREE is never said without a proof. COLLIDING is a contact on the curve itself,
        with what obstacles may be moved by taken off the distance.

    Raises
    ------
    InputError
        If the curve's joints are not the arm's, or a setting makes no sense.
    UnknownNameError
        If ``parting`` names nothing that is there.
    """
    if tuple(curve.joint_names) != checker.arm.joint_names:
        raise InputError(f"the curve has the joints {curve.joint_names}, the arm {checker.arm.joint_names}")
    if (tolerance is not None and not tolerance > 0) or max_intervals < 1:
        raise InputError(f"tolerance = {tolerance} must be above 0 m and max_intervals = {max_intervals} at least 1")
    n = checker.arm.dof
    each = np.full(n, joint_tolerance) if np.ndim(joint_tolerance) == 0 else joint_tolerance
    joints = finite("joint_tolerance", each, (n,))
    if (joints < 0).any() or not 0 <= obstacle_tolerance < np.inf:
        raise InputError(
            f"joint_tolerance = {joint_tolerance!r} and obstacle_tolerance = {obstacle_tolerance}; they are 0 or more"
        )

    if parting and (joints.any() or record):
        raise InputError("parting goes with no joint_tolerance, and cannot be recorded: it is proven of the bare curve")

    def at(each: float) -> Certificate:
        def prove(part: Curve, judge: CollisionChecker) -> Certificate:
            return _Proof(part, judge, each, max_intervals, joints, float(obstacle_tolerance), record).run()

        if not parting:
            return prove(curve, checker)
        return prove_parting(
            curve,
            checker,
            parting,
            prove,
            tolerance=each,
            max_intervals=max_intervals,
            obstacle_tolerance=float(obstacle_tolerance),
        )

    first, *finer = TOLERANCES if tolerance is None else (tolerance,)
    certificate = at(first)
    for each in finer:
        if certificate.status is not CertificateStatus.UNDECIDED or certificate.intervals >= max_intervals:
            break
        certificate = at(each)
    return certificate


def is_proven_free(curve: Curve, checker: CollisionChecker) -> bool:
    """Whether :func:`certify` would say FREE: the proof alone, for searches that ask it of many short pieces.

    It goes no farther than to the margin, proves no clearance beyond it, and does not tell why a curve is not free.
    """
    proof = _Proof(curve, checker, TOLERANCE, QUICK_INTERVALS, np.zeros(checker.arm.dof), 0.0, False)
    return proof.succeeds()


class _Proof:
    """One certification."""

    def __init__(
        self,
        curve: Curve,
        checker: CollisionChecker,
        tolerance: float,
        max_intervals: int,
        joints: Array,
        obstacles: float,
        record: bool,
    ) -> None:
        from pinproof.kernels import sweep

        self._kernel = sweep
        self._curve, self._checker = curve, checker
        self._judge = checker.moved_obstacles(obstacles) if obstacles > 0 else checker
        self._joints, self._obstacles = joints, obstacles
        self._knots, self._control = (np.array(part) for part in curve.bezier())
        self._settings = np.array([tolerance, max_intervals, obstacles, GOAL_SHARE, LOOK_AHEAD])
        self._state = np.zeros(sweep.STATE_SIZE)
        self._state[[sweep.OBSERVED, sweep.SPARE, sweep.PROVEN, sweep.JOINT_TUBE, sweep.OBSTACLE_TUBE]] = np.inf
        self._log = np.empty((64 if record else 0, sweep.LOG_COLUMNS))
        self._record = record

    def run(self) -> Certificate:
        first, last = float(self._knots[0]), float(self._knots[-1])
        start, end = self._control[0, 0], self._control[-1, -1]
        # Both ends first: a start in contact is the commonest "no", and halving alone would only creep up on it.
        if (contact := self._look(start)) is not None:
            return self._colliding(first, start, contact, first)
        at_end = self._look(end)
        if (undecided := self._still()) is not None:
            return self._undecided(undecided) if at_end is None else self._colliding(last, end, at_end, first)
        found = self._sweep()
        k, state = self._kernel, self._state
        open_from = float(state[k.OPEN_START]) if state[k.OPEN] else None
        if found is not None:
            time = float(state[k.FOUND_TIME])
            pair = int(state[k.FOUND_PAIR])
            contact = self._deepest(found) or self._contact(pair, self._judge.placed(found).measure(pair))
            return self._colliding(time, found, contact, time if open_from is None else open_from)
        if at_end is not None:
            return self._colliding(last, end, at_end, last if open_from is None else open_from)
        if open_from is not None:
            pair, until, distance = int(state[k.OPEN_PAIR]), float(state[k.OPEN_END]), float(state[k.OPEN_DISTANCE])
            if distance == np.inf:  # the pair was given up unmeasured: a longer interval had shown it to be near
                distance = self._judge.placed(self._curve((open_from + until) / 2)).measure(pair).attained
            return self._undecided(UndecidedSpan(open_from, until, self._names(pair), distance))
        return self._free()

    def succeeds(self) -> bool:
        """Whether the curve is proven free, with nothing to spare."""
        k = self._kernel
        self._settings[k.GOAL_SHARE] = self._settings[k.LOOK_AHEAD] = 0.0
        return self._still() is None and self._sweep() is None and not self._state[k.OPEN]

    def _look(self, q: Array) -> Contact | None:
        """The deepest contact at q (n,), after taking down how near bodies are to each other there."""
        space = self._judge.workspace
        near = space.near(q, NEAREST)
        self._saw(near.nearest, near.upper)
        for pair in near.left_to_coal:
            self._saw(pair, space.measure(pair).attained)
        return self._deepest(q)

    def _saw(self, pair: int, attained: float) -> None:
        if pair < 0:
            return
        k, state = self._kernel, self._state
        state[k.OBSERVED] = min(state[k.OBSERVED], attained)
        state[k.SPARE] = min(state[k.SPARE], attained - self._judge.margins[pair])

    def _deepest(self, q: Array) -> Contact | None:
        """The deepest contact at q (n,) for which there is evidence: a distance that is attained."""
        judge, deepest = self._judge, None
        for pair, measured in (*judge.workspace.touching(q), *judge.still.touching):
            if measured.attained <= judge.margins[pair]:
                self._saw(pair, measured.attained)
                contact = self._contact(pair, measured)
                if deepest is None or contact.distance < deepest.distance:
                    deepest = contact
        return deepest

    def _contact(self, pair: int, measured: Distance) -> Contact:
        """The contact of a pair, nearer by what an obstacle may be moved by."""
        contact = self._judge.contact(pair, measured)
        moved = self._obstacles if self._checker.bodies[self._checker.pairs[pair][1]].link is None else 0.0
        return replace(contact, distance=contact.distance - moved) if moved else contact

    def _still(self) -> UndecidedSpan | None:
        """Judge once the pairs between which no joint moves; contacts among them were seen at the start."""
        judge, k, state = self._judge, self._kernel, self._state
        for pair, measured in judge.still.touching:
            return UndecidedSpan(float(self._knots[0]), float(self._knots[-1]), self._names(pair), measured.distance)
        if len(judge.still_pairs):
            proven = judge.still.lower - judge.rounding
            state[k.OBSERVED] = min(state[k.OBSERVED], judge.still.upper)
            state[k.PROVEN] = min(state[k.PROVEN], proven - self._obstacles)
            room = max(proven - float(judge.margins[judge.still_pairs].max()), 0.0)
            state[k.OBSTACLE_TUBE] = min(state[k.OBSTACLE_TUBE], room)
        return None

    def _sweep(self) -> Array | None:
        """Go through the curve; the configuration (n,) of the first contact, if one was found."""
        k, judge, control = self._kernel, self._judge, self._control
        pieces, points, n = control.shape
        spans, ranges = np.empty((DEPTH, 2)), np.empty((DEPTH, 4), dtype=np.int64)
        stack = np.empty((DEPTH, points, n))
        lists = np.empty(LISTS * len(judge.pairs) + 64, dtype=np.int64)
        spans[0], ranges[0], stack[0] = self._knots[[0, -1]], (0, pieces, 0, k.EVERYTHING), control[0]
        if self._record:  # every pair by name, none left out by the tree of obstacles
            everything = np.setdiff1d(np.arange(len(judge.pairs)), judge.still_pairs)
            lists[: len(everything)], ranges[0, 3] = everything, len(everything)
        self._state[k.TOP] = 1
        directions, told = np.zeros((len(judge.pairs), 3)), np.zeros((len(judge.pairs), 3))
        seen = np.full(len(judge.pairs), np.inf)
        asked, found = np.empty(len(judge.pairs), dtype=np.int64), np.empty((2, n))
        space = judge.workspace
        while True:
            ended = k.sweep(
                judge.numbers, judge.indices, self._knots, control, self._joints, self._settings, space.at,
                spans, ranges, stack, lists, directions, seen, asked, told, self._state, found, self._log,
            )  # fmt: skip
            if ended == k.DONE:
                break
            if ended == k.GROW:
                lists = np.concatenate([lists, np.empty_like(lists)])
                if self._record:
                    self._log = np.concatenate([self._log, np.empty((len(lists) + len(self._log), k.LOG_COLUMNS))])
                continue
            space.move(found[1])
            for pair in asked[: int(self._state[k.ASKED])].tolist():
                measured = space.measure(pair)
                told[pair] = self._state[k.INTERVALS] + 1, measured.attained, measured.proven
        return found[0] if self._state[k.FOUND] else None

    def _names(self, pair: int) -> tuple[str, str]:
        i, j = self._checker.pairs[pair]
        return self._checker.bodies[i].owner, self._checker.bodies[j].owner

    def _free(self) -> Certificate:
        count, seen = len(self._checker.pairs), float(self._state[self._kernel.OBSERVED])
        proven = float(self._state[self._kernel.PROVEN])
        message = free_sentence(proven, seen, count, len(self._checker.excluded))
        if self._tolerances:
            message += f", {self._tolerances}"
        return self._certificate(CertificateStatus.FREE, message, clearance=proven)

    @property
    def _tolerances(self) -> str:
        """The tube in words; empty for the bare curve."""
        said = []
        if self._joints.any():
            low, high = float(self._joints.min()), float(self._joints.max())
            said.append(f"joints off by up to {high:g} rad or m" if low == high else "joints off by their tolerances")
        if self._obstacles:
            said.append(f"obstacles by up to {self._obstacles * 1e3:g} mm")
        return " and ".join(said)

    def _colliding(self, time: float, q: Array, contact: Contact, proven_free_until: float) -> Certificate:
        first = FirstContact(
            time, q.copy(), contact.bodies, contact.distance, contact.points, contact.distance < 0, proven_free_until
        )
        message = f"at {time:.4g} {contact}; proven free until {proven_free_until:.4g}"
        return self._certificate(CertificateStatus.COLLIDING, message, first_contact=first)

    def _undecided(self, span: UndecidedSpan) -> Certificate:
        intervals, budget = self._state[self._kernel.INTERVALS], self._settings[self._kernel.MAX_INTERVALS]
        why = "its budget of intervals" if intervals >= budget else "its tolerance"
        message = (
            f"the proof met {why} at [{span.start:.6g}, {span.end:.6g}]: {' and '.join(span.bodies)} are "
            f"{span.distance * 1e3:.3f} mm apart there; keep more distance, or lower the margin or the tolerance"
        )
        if self._tolerances:
            message += f" (asked for {self._tolerances})"
        return self._certificate(CertificateStatus.UNDECIDED, message, undecided=span)

    def _certificate(
        self,
        status: CertificateStatus,
        message: str,
        *,
        clearance: float = np.nan,
        first_contact: FirstContact | None = None,
        undecided: UndecidedSpan | None = None,
    ) -> Certificate:
        checker, k, state = self._checker, self._kernel, self._state
        free = status is CertificateStatus.FREE
        curve, setup = curve_hash(self._curve), checked_hash(checker)
        records = getattr(self._curve, "certified", ())  # of a trajectory that was read from a file
        changes = (f"the file of the motion states: {each}" for each in changes_since(records, checker, curve, setup))
        return Certificate(
            status=status,
            margin=checker.margin,
            clearance=clearance,
            observed=float(state[k.OBSERVED]),
            first_contact=first_contact,
            undecided=undecided,
            message=message,
            pairs=len(checker.pairs),
            intervals=int(state[k.INTERVALS]),
            excluded=tuple(checker.excluded),
            tolerance=float(self._settings[k.TOLERANCE]),
            curve=curve,
            setup=setup,
            notes=(*notes_of(checker), *changes),
            tube=MotionTube(
                read_only(self._joints),
                self._obstacles,
                max(float(state[k.JOINT_TUBE]), 0.0) if free else np.nan,
                max(float(state[k.OBSTACLE_TUBE]), 0.0) if free else np.nan,
            ),
            evidence=read_only(self._log[: int(state[k.LOGGED])].copy()) if self._record else None,
            subject=(self._curve, self._checker) if self._record else None,
            attached=checker.attached,
            held=dict(checker.arm.held),
            obstacles=checker.scene.names,
        )
