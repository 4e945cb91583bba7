"""Proofs that no configuration of an arm within its limits reaches a pose, also for redundant arms.

The compiled core (``src/core/reach``) divides the joint ranges into boxes and excludes each of them by a distance: see
:mod:`pinproof.ik.reach_check`, which states the bounds and repeats them independently.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from enum import Enum
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pinproof import _core
from pinproof.common.results import Solution
from pinproof.common.structs import described, key
from pinproof.common.validation import Rng, require_integer, require_positive, require_type
from pinproof.errors import InputError
from pinproof.ik.jacobian_methods import Clik
from pinproof.ik.reach_check import BodyOverlap, Loop, Steps, check_exclusion, excluded_boxes
from pinproof.ik.result import IkAnswer, judge
from pinproof.ik.task import make_task, orientation_tolerance_of
from pinproof.model import AT_LIMIT, Arm
from pinproof.spatial import SE3, Array, rigid
from pinproof.units import far_hint

FIRST_BOXES = 64
"""Number of boxes before a numerical search for a solution; most poses that are out of reach need fewer."""

BUDGET = 4000
"""Largest number of boxes; each takes 5 to 20 microseconds."""


class ReachStatus(Enum):
    """The outcomes of :func:`prove_unreachable`."""

    FOUND = "found"
    """A configuration within the limits reaches the target."""
    IMPOSSIBLE = "impossible"
    """It is proven that no configuration within the limits reaches the target within the tolerances, or none without
    one of the given overlaps."""
    UNDECIDED = "undecided"
    """The budget was used without a solution or a proof."""


@described(eq=False)
class ReachProof(IkAnswer):
    """A configuration that reaches a target, or a proof that none does."""

    status: ReachStatus = key("the outcome")
    arm: Arm = key("the arm")
    target: Array = key("(4, 4) ``base_from_tcp``, read-only")
    position_tolerance: float = key("IMPOSSIBLE holds for every pose within both tolerances from the target", "m")
    orientation_tolerance: float = key("the other of them", "rad")
    examined: int = key("number of boxes of joint values that were examined")
    q: Solution[Array] = key(
        "(n,) a solution if the status is FOUND; if it is UNDECIDED, the middle of the box that could not be "
        "excluded. Reading it from a proof that none exists raises :class:`pinproof.errors.IkFailed`",
        default=Solution(),
    )
    overlaps: tuple[BodyOverlap, ...] = key("the overlaps that exclude configurations", default=())

    @property
    def proven(self) -> bool:
        """Whether the target is proven to be out of reach, or reached only with one of the overlaps."""
        return self.status is ReachStatus.IMPOSSIBLE

    @property
    def ok(self) -> bool:
        """Whether a solution was found."""
        return self.status is ReachStatus.FOUND

    @property
    def _tolerances(self) -> tuple[float, float]:
        return self.position_tolerance, self.orientation_tolerance

    def _repeated(self, *, recorded: bool) -> _core.ReachProof:
        """The proof of the compiled core again, with its steps if ``recorded``."""
        packed = _packed(self.overlaps)
        return _prover(self.arm).prove(self.target, *self._tolerances, self.examined + 1, recorded, packed)

    @cached_property
    def steps(self) -> Steps:
        """The steps of the proof if the status is IMPOSSIBLE, for :meth:`verify`; else an empty sequence."""
        if not self.proven:
            return Steps(*np.empty((5, 0)))
        proof = self._repeated(recorded=True)
        return Steps(proof.kinds, proof.joints, proof.constraints, proof.evaluations, proof.values)

    @property
    def boxes(self) -> Array:
        """(k, 2, n) lower and upper ends of the boxes of joint values that are excluded; they cover the joint ranges.

        Each violates one distance, see :attr:`steps`.
        """
        return excluded_boxes(self.steps, *_ranges(self.arm))[0]

    def verify(self) -> bool:
        """Check the result independently of the compiled core.

        A solution is checked by forward kinematics and the limits. For a proof, the boxes are reconstructed from its
        steps, and the distance that excludes each is bounded again in NumPy.

        Raises
        ------
        InputError
            If the status is UNDECIDED.
        """
        if self.status is ReachStatus.UNDECIDED:
            raise InputError("the proof is undecided, so there is nothing to verify; raise budget")
        if not self.proven:
            return judge(self.arm, self.target, make_task("pose", *self._tolerances), self.q, self.q).fulfils
        return check_exclusion(self._loop, self.steps, _ranges(self.arm), self.target, self._tolerances, self.overlaps)

    @cached_property
    def bodies(self) -> tuple[tuple[str, str], ...]:
        """The names of the bodies whose overlaps exclude a box of joint values, each pair once."""
        if not self.proven or not self.overlaps:
            return ()
        proof = self._repeated(recorded=False)
        return tuple(dict.fromkeys(each.names for each, used in zip(self.overlaps, proof.used, strict=True) if used))

    @property
    def _loop(self) -> Loop:
        prover, chain = _prover(self.arm), self.arm.chain
        joints, points = chain.joints, prover.points
        before, prismatic = np.array([joint.before for joint in joints]), [joint.prismatic for joint in joints]
        first, at = [point.first for point in points], [np.array(point.at) for point in points]
        return Loop(before, chain.tool, prismatic, first, at, prover.constraints)

    @cached_property
    def message(self) -> str:
        """The result as text."""
        size = f"{self.position_tolerance:g} m and {self.orientation_tolerance:g} rad"
        if self.status is ReachStatus.FOUND:
            return "reachable: a configuration was found"
        if self.status is ReachStatus.UNDECIDED:
            return f"undecided: {self.examined} boxes of joint values were examined; raise budget to examine more"
        parts = "at once" if self.examined == 1 else f"in {self.examined} parts"
        far = far_hint(float(np.linalg.norm(self.target[:3, 3])), self.arm.robot.size)
        pairs = " or ".join(f"{first} with {second}" for first, second in self.bodies)
        without = f" without a collision of {pairs}" if pairs else ""
        return (
            f"proven impossible: no configuration within the limits reaches the target to within {size}{without} "
            f"(the range of the joints is excluded {parts}){far}"
        )


def is_provable(arm: Arm) -> bool:
    """Whether :func:`prove_unreachable` supports the arm: at most 12 joints, none mimic, prismatic ones with limits."""
    return _unsupported(arm) is None


def prove_unreachable(
    arm: Arm,
    target: SE3 | npt.ArrayLike,
    *,
    position_tolerance: float = 1e-6,
    orientation_tolerance: float | None = None,
    budget: int = BUDGET,
    search: bool = True,
    rng: Rng = 0,
    overlaps: Sequence[BodyOverlap] = (),
) -> ReachProof:
    """Prove that no configuration within the joint limits reaches a pose, or find one that does.

    The proof holds for arms with any number of joints, redundant or not. It encloses distances in intervals over boxes
    of joint values, and divides boxes that it cannot exclude. With ``overlaps``, it excludes boxes also in which one of
    them exists at every configuration that reaches the pose: the proof then states that every such configuration is in
    collision.

    Parameters
    ----------
    arm
        The arm: up to 12 revolute and prismatic joints without mimic joints.
    target
        ``base_from_tcp``, as ``pin.SE3`` or (4, 4).
    position_tolerance, orientation_tolerance
        In m and rad: IMPOSSIBLE means that no pose within both tolerances is reachable. The angle is by default that
        of :class:`pinproof.Clik`.
    budget
        Largest number of boxes that are examined.
    search
        Whether to search for a solution numerically (:class:`pinproof.Clik`) if the first boxes are not excluded.
    rng
        Seed of that search.
    overlaps
        Shapes inside bodies on different links. They need ``search=False``, because the search does not check them.

    Raises
    ------
    InputError
        If the target is not rigid or the arm is not supported.

    References
    ----------
    Porta, Ros, Thomas, Torras (2005), "A branch-and-prune solver for distance constraints"; Moore, Kearfott, Cloud
    (2009), "Introduction to interval analysis"; Merlet (2004), "Solving the forward kinematics of a Gough-type parallel
    manipulator with interval analysis".
    """
    # what the proof supports
    require_type("arm", arm, Arm)
    require_positive("position_tolerance", position_tolerance)
    orientation_tolerance = orientation_tolerance_of(arm, orientation_tolerance, usual=1e-6)
    require_positive("orientation_tolerance", orientation_tolerance)
    require_integer("budget", budget, 1)
    unsupported = _unsupported(arm)
    if unsupported is not None:
        raise InputError(f"{unsupported}; use Clik to search for a solution")
    matrix = np.array(rigid("target", target).homogeneous)
    matrix.setflags(write=False)
    tolerances = position_tolerance, orientation_tolerance
    if overlaps and search:
        raise InputError("overlaps require search=False, because the search does not check collisions")
    # few boxes first, then the search for a solution, then the others
    prover, first = _prover(arm), min(FIRST_BOXES, budget) if search else budget
    proof = prover.prove(matrix, *tolerances, first, False, _packed(overlaps))
    if not proof.excluded and search:
        clik = Clik(position_tolerance=position_tolerance, orientation_tolerance=orientation_tolerance)
        found = clik.solve(arm, matrix, rng=rng)
        if found.ok:
            return ReachProof(ReachStatus.FOUND, arm, matrix, *tolerances, proof.boxes, found.q)
        if first < budget:
            proof = prover.prove(matrix, *tolerances, budget, False)
    # what is proven, or the box that could not be excluded
    if proof.excluded:
        return ReachProof(ReachStatus.IMPOSSIBLE, arm, matrix, *tolerances, proof.boxes, None, tuple(overlaps))
    left = np.array(proof.remaining)
    return ReachProof(ReachStatus.UNDECIDED, arm, matrix, *tolerances, proof.boxes, left, tuple(overlaps))


def _packed(overlaps: Sequence[BodyOverlap]) -> list[_core.Overlap]:
    return [
        _core.Overlap(
            each.ball_link,
            np.asarray(each.centre, dtype=float),
            each.radius,
            each.box_link,
            np.asarray(each.link_from_box, dtype=float),
            np.asarray(each.half, dtype=float),
            each.box_radius,
        )
        for each in overlaps
    ]


_PROVERS: weakref.WeakKeyDictionary[Arm, _core.Reach] = weakref.WeakKeyDictionary()


def _prover(arm: Arm) -> _core.Reach:
    prover = _PROVERS.get(arm)
    if prover is None:
        prover = _PROVERS[arm] = _core.Reach(arm.chain, *_ranges(arm))
    return prover


def _ranges(arm: Arm) -> tuple[Array, Array]:
    """(n,) lower and upper ends of the joint ranges: the limits with their tolerance, at most one full rotation."""
    lower, upper = arm.limits.sampling_range()
    lower, upper = lower - AT_LIMIT, upper + AT_LIMIT
    return lower, np.where(arm.angular, np.minimum(upper, lower + 2 * np.pi), upper)


def _unsupported(arm: Arm) -> str | None:
    if arm.dof > _core.MOST_PROOF_JOINTS:
        return f"proofs support at most {_core.MOST_PROOF_JOINTS} joints, and this arm has {arm.dof}"
    if arm.chain.has_mimic_joints:
        return f"proofs do not support the mimic joint between {arm.base!r} and {arm.tcp!r}"
    unlimited = ~arm.angular & ~np.isfinite(arm.limits.upper - arm.limits.lower)
    if unlimited.any():
        return (
            f"proofs need finite limits of the prismatic joint {arm.joint_names[int(np.flatnonzero(unlimited)[0])]!r}"
        )
    return None
