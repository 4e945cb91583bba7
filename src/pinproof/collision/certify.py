"""Certification of a whole curve: proven collision-free between samples too, not sampled.

The curve is bisected into intervals in path order. In each interval, the distance of every pair at the middle is
compared with an upper bound of the approach of the pair within the interval (:mod:`pinproof.kernels.approach`).
Pairs that are proven apart are dropped; the others are passed to both halves. A contact at a middle ends the search to
its right; the search to its left continues until everything before the contact is proven collision-free or the
tolerance is reached. The loop is compiled (:mod:`pinproof.kernels.sweep`); for bodies without a support function it
returns to Python and calls coal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pinproof.collision.certificate import (
    Certificate,
    CertificateStatus,
    FirstContact,
    MotionTube,
    UndecidedSpan,
    changes_since,
    checked_hash,
    curve_hash,
    free_sentence,
    notes_of,
    parameter_text,
)
from pinproof.collision.checker import CollisionChecker, Contact
from pinproof.collision.coal_checks import Distance
from pinproof.collision.parting import prove_parting
from pinproof.collision.placed_bodies import NEAREST
from pinproof.errors import InputError
from pinproof.motion import Curve
from pinproof.motion.curve import read_only
from pinproof.spatial import finite

__all__ = ["certify", "is_proven_free"]

Array = npt.NDArray[np.float64]

GOAL_SHARE = 0.5
"""A pair is dropped once this share of the smallest distance found so far is proven, so that the bound is useful."""

LOOK_AHEAD = 200
"""Number of intervals that are searched for a contact behind an undecided span, so that COLLIDING is preferred."""

TOLERANCE = 1e-4
"""Metres: a hundredth of a usual clearance; an interval in which bodies move less is not bisected further."""

TOLERANCES = (TOLERANCE, 1e-5, 1e-6)
"""Metres: a curve that is UNDECIDED at one tolerance is certified again with the next. A path that was proven with a
small clearance may need it after timing, because its pieces are then bisected at other parameters. The cost is a few
bisections of each open span; below 1e-6 m the tolerance of coal's distances, 2e-6 m, dominates."""

QUICK_INTERVALS = 2000
"""Number of intervals after which a quick proof fails: about 100 times those of a short edge in free space."""

DEPTH = 192
"""Entries of the stack of intervals: 60 bisections reach the resolution of a double."""

LISTS = 16
"""Initial capacity of the lists of open pairs, as a multiple of the number of pairs; they grow if needed."""


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
    """Prove that a curve is collision-free, or find a configuration where it is not.

    Parameters
    ----------
    curve
        A :class:`~pinproof.JointPath`, :class:`~pinproof.motion.CubicPath` or :class:`~pinproof.Trajectory`.
    checker
        Defines the checked bodies and pairs, and their margins.
    tolerance
        Metres. An interval in which no body moves farther than this towards another is not bisected further, so a curve
        whose clearance beyond the margin is smaller may be UNDECIDED. Default: 1e-4, then 1e-5 and 1e-6 while the
        verdict is UNDECIDED; :attr:`Certificate.tolerance` is the last one used.
    max_intervals
        Maximum number of intervals for each tolerance; the verdict is UNDECIDED when it is reached.
    joint_tolerance
        rad or m, one number or (n,): the proof also covers every configuration that differs from one on the curve by no
        more than this in each joint, such as the tracking error of a controller.
    obstacle_tolerance
        Metres: the proof also covers obstacles that are displaced, rotated or enlarged, if no point of their surface
        moves farther than this.
    parting
        Pairs of names, each of a link or attached object and an obstacle, that may touch at the start, such as a part
        and its support. It is proven that the two do not approach each other until they have separated, and that they
        keep their margin afterwards; :meth:`CollisionChecker.allowing` would exclude the pair instead. Cannot be
        combined with ``joint_tolerance`` or ``record``.
    record
        Store the evidence in :attr:`Certificate.evidence`, which :meth:`Certificate.save` needs.

    Returns
    -------
    Certificate
        FREE, COLLIDING or UNDECIDED. FREE is always proven. COLLIDING is a contact at a configuration on the curve
        itself; its distance is reduced by ``obstacle_tolerance``.

    Raises
    ------
    InputError
        If the curve's joints are not the arm's, a setting is invalid, or an array of the checker was modified in place.
    UnknownNameError
        If ``parting`` names an unknown body.
    """
    if tuple(curve.joint_names) != checker.arm.joint_names:
        raise InputError(f"the curve has the joints {curve.joint_names}, the arm has {checker.arm.joint_names}")
    if (tolerance is not None and not tolerance > 0) or max_intervals < 1:
        raise InputError(f"tolerance = {tolerance} must be above 0 m and max_intervals = {max_intervals} at least 1")
    n = checker.arm.dof
    each = np.full(n, joint_tolerance) if np.ndim(joint_tolerance) == 0 else joint_tolerance
    joints = finite("joint_tolerance", each, (n,))
    if (joints < 0).any() or not 0 <= obstacle_tolerance < np.inf:
        raise InputError(
            f"joint_tolerance = {joint_tolerance!r} and obstacle_tolerance = {obstacle_tolerance}; both are 0 or more"
        )

    if parting and (joints.any() or record):
        raise InputError("parting cannot be combined with joint_tolerance or record")

    checker.refuse_changes()

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
    """Return whether the curve is proven collision-free, for searches that query many short edges.

    Faster than :func:`certify`: it proves the margin and no clearance beyond it, and returns no reason.
    """
    proof = _Proof(curve, checker, TOLERANCE, QUICK_INTERVALS, np.zeros(checker.arm.dof), 0.0, False)
    return proof.succeeds()


class _Proof:
    """The certification of one curve at one tolerance."""

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
        # Both ends are checked first: a start in contact is the most common failure, and bisection finds it late.
        if (contact := self._look(start)) is not None:
            return self._colliding(first, start, contact, first)
        at_end = self._look(end)
        if (undecided := self._check_fixed_pairs()) is not None:
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
            if distance == np.inf:  # not measured here: a longer interval had shown that the pair is close
                distance = self._judge.placed(self._curve((open_from + until) / 2)).measure(pair).attained
            return self._undecided(UndecidedSpan(open_from, until, self._names(pair), distance))
        return self._free()

    def succeeds(self) -> bool:
        """Whether the curve is proven to keep the margins."""
        k = self._kernel
        self._settings[k.GOAL_SHARE] = self._settings[k.LOOK_AHEAD] = 0.0
        return self._check_fixed_pairs() is None and self._sweep() is None and not self._state[k.OPEN]

    def _look(self, q: Array) -> Contact | None:
        """Return the deepest contact at q (n,) and update the smallest observed distance."""
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
        """Return the deepest contact at q (n,) whose measured distance is attained, so that it is evidence."""
        judge, deepest = self._judge, None
        for pair, measured in (*judge.workspace.touching(q), *judge.still.touching):
            if measured.attained <= judge.margins[pair]:
                self._saw(pair, measured.attained)
                contact = self._contact(pair, measured)
                if deepest is None or contact.distance < deepest.distance:
                    deepest = contact
        return deepest

    def _contact(self, pair: int, measured: Distance) -> Contact:
        """Return the contact of a pair, with the distance reduced by the tolerance of obstacles."""
        contact = self._judge.contact(pair, measured)
        moved = self._obstacles if self._checker.bodies[self._checker.pairs[pair][1]].link is None else 0.0
        return replace(contact, distance=contact.distance - moved) if moved else contact

    def _check_fixed_pairs(self) -> UndecidedSpan | None:
        """Check once the pairs that no joint moves relative to each other; their contacts were found at the start."""
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
        """Bisect the curve; return the configuration (n,) of the first contact, if one was found."""
        k, judge, control = self._kernel, self._judge, self._control
        pieces, points, n = control.shape
        spans, ranges = np.empty((DEPTH, 2)), np.empty((DEPTH, 4), dtype=np.int64)
        stack = np.empty((DEPTH, points, n))
        lists = np.empty(LISTS * len(judge.pairs) + 64, dtype=np.int64)
        spans[0], ranges[0], stack[0] = self._knots[[0, -1]], (0, pieces, 0, k.EVERYTHING), control[0]
        if self._record:  # every pair is listed, none is skipped by the tree of obstacles
            everything = np.setdiff1d(np.arange(len(judge.pairs)), judge.still_pairs)
            lists[: len(everything)], ranges[0, 3] = everything, len(everything)
        self._state[k.TOP] = 1
        directions, measured_by_coal = np.zeros((len(judge.pairs), 3)), np.zeros((len(judge.pairs), 3))
        seen = np.full(len(judge.pairs), np.inf)
        asked, found = np.empty(len(judge.pairs), dtype=np.int64), np.empty((2, n))
        space = judge.workspace
        while True:
            ended = k.sweep(
                judge.numbers, judge.indices, self._knots, control, self._joints, self._settings, space.at,
                spans, ranges, stack, lists, directions, seen, asked, measured_by_coal, self._state, found, self._log,
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
                measured_by_coal[pair] = self._state[k.INTERVALS] + 1, measured.attained, measured.proven
        return found[0] if self._state[k.FOUND] else None

    def _names(self, pair: int) -> tuple[str, str]:
        i, j = self._checker.pairs[pair]
        return self._checker.bodies[i].owner, self._checker.bodies[j].owner

    def _free(self) -> Certificate:
        count = len(self._checker.pairs)
        proven = float(self._state[self._kernel.PROVEN])
        message = free_sentence(proven, count, len(self._checker.excluded))
        if self._tolerances:
            message += f"; {self._tolerances}"
        return self._certificate(CertificateStatus.FREE, message, clearance=proven)

    @property
    def _tolerances(self) -> str:
        """The allowed deviations as text; empty if there are none."""
        deviations = []
        if self._joints.any():
            low, high = float(self._joints.min()), float(self._joints.max())
            by = f"{high:g} rad or m" if low == high else "the given tolerances"
            deviations.append(f"joints may deviate by up to {by}")
        if self._obstacles:
            deviations.append(f"obstacles may deviate by up to {self._obstacles * 1e3:g} mm")
        return " and ".join(deviations)

    def _colliding(self, time: float, q: Array, contact: Contact, proven_free_until: float) -> Certificate:
        first = FirstContact(
            time, q.copy(), contact.bodies, contact.distance, contact.points, contact.distance < 0, proven_free_until
        )
        at, until = (parameter_text(self._curve, t) for t in (time, proven_free_until))
        message = f"{contact} at {at}; collision-free until {until}"
        return self._certificate(CertificateStatus.COLLIDING, message, first_contact=first)

    def _undecided(self, span: UndecidedSpan) -> Certificate:
        intervals, budget = self._state[self._kernel.INTERVALS], self._settings[self._kernel.MAX_INTERVALS]
        spent = intervals >= budget
        limit = f"limit of {budget:.0f} intervals" if spent else f"tolerance of {self._settings[0] * 1e3:g} mm"
        message = (
            f"neither proven collision-free nor in collision on [{span.start:.6g}, {span.end:.6g}]: "
            f"{' and '.join(span.bodies)} are {span.distance * 1e3:.3f} mm apart there, and the {limit} was reached; "
            f"increase the distance{' or max_intervals' if spent else ''}, or lower the margin or the tolerance"
        )
        if self._tolerances:
            message += f" ({self._tolerances})"
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
