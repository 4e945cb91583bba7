"""Straight lines of the tcp in space, as smooth curves in joint space, certified.

The tcp through a sequence of poses, straight from one to the next, as one certified joint curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CertificateStatus, CollisionChecker, certify
from pinproof.errors import InputError, NoClosedForm
from pinproof.ik import AnalyticIk, Clik, IkTask
from pinproof.ik.task import TaskName
from pinproof.model import Arm
from pinproof.motion import BlendedPath, CubicPath
from pinproof.planning.follow import Following, Walked, aimed, line_task
from pinproof.planning.result import LinearPlanResult, LinearStatus, PosesPlanResult
from pinproof.planning.route import Route, sections
from pinproof.spatial import SE3, rigid, rigid_many

__all__ = ["ended", "percent", "plan_linear", "plan_poses"]


def plan_linear(
    checker: CollisionChecker,
    start: npt.ArrayLike,
    target: SE3 | npt.ArrayLike,
    *,
    task: TaskName | IkTask = "pose",
    deviation: float = 1e-3,
    rotation_deviation: float = 1e-2,
    translation_step: float = 0.05,
    rotation_step: float = 0.2,
    max_joint_step: float = 0.3,
    parting: Sequence[tuple[str, str]] = (),
) -> LinearPlanResult:
    """Move the tcp from where it is at ``start`` straight to ``target``.

    The position goes along a line while the orientation turns about one fixed axis. Poses along the line are solved one
    from the other, so the arm stays on its branch, and joined by a twice differentiable curve that keeps the limits at
    every point and whose distance from the line is bounded everywhere (:mod:`pinproof.planning.follow`).

    Parameters
    ----------
    checker
        What the move must be free of.
    start
        (n,) the first configuration.
    target
        ``base_from_tcp`` at the end. If it is half a turn away, one of the two ways round is taken.
    task
        What is asked of the tcp, as for :meth:`pinproof.Clik.solve`: ``"pose"``; ``"position"``, however it turns;
        ``"spin_z"`` (``"spin_x"``, ``"spin_y"``), where that axis of the tcp is led the short way to where the target
        has it and the spin about it is free; ``"orientation"``, wherever it goes.
    deviation, rotation_deviation
        Metres and radians the tcp may be off the line, between the solved poses too; they are put closer together
        until it is proven.
    translation_step, rotation_step
        Largest distance (m) and angle (rad) between solved poses.
    max_joint_step
        Largest joint step (rad or m) between solved poses. They are put closer together until it holds, to a 64th of
        the steps; where that is not enough, it is a jump.
    parting
        Pairs that may touch at the start, as for :func:`pinproof.certify`.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, a setting is not above 0, or the task asks for part of the position
        or for one turn alone.
    """
    asked = line_task(task)
    arm = checker.arm
    following = Following(
        arm=arm,
        task=asked,
        deviation=deviation,
        rotation_deviation=rotation_deviation,
        translation_step=translation_step,
        rotation_step=rotation_step,
        max_joint_step=max_joint_step,
    )
    first, last = arm.limits.snap(arm.configuration(start, "start")), rigid("target", target)
    if outside := arm.limits.violations(first, arm.joint_names):
        said = f"the start is no place to start: {outside[0]}"
        beyond = np.flatnonzero((first < arm.limits.lower) | (first > arm.limits.upper))
        names = tuple(arm.joint_names[joint] for joint in beyond)
        return LinearPlanResult(LinearStatus.LIMIT, None, None, 0.0, said, joints=names)
    here = arm.forward_kinematics(first)
    return _line_result(following.walk(Route.straight(here, aimed(here, last, asked)), first), checker, parting)


def _line_result(walked: Walked, checker: CollisionChecker, parting: Sequence[tuple[str, str]]) -> LinearPlanResult:
    """The move as far as it was walked, unless a contact ends it before."""
    certificate = certify(walked.path, checker, parting=parting)
    if not certificate.free:
        return _touching(certificate)
    if walked.status is not LinearStatus.COMPLETE:
        message = f"stops at {percent(walked.fraction)} of the line: {walked.why}"
        return LinearPlanResult(walked.status, None, None, walked.fraction, message, joints=walked.joints)
    message = f"straight to the target, {certificate.message}"
    return LinearPlanResult(
        LinearStatus.COMPLETE,
        walked.path,
        certificate,
        1.0,
        message,
        walked.deviation,
        walked.rotation_deviation,
    )


def _touching(certificate: Certificate) -> LinearPlanResult:
    """The move that a contact, or a proof that met its tolerance, ends."""
    status, fraction = ended(certificate)
    return LinearPlanResult(
        status, None, certificate, fraction, f"stops at {percent(fraction)} of the line: {certificate.message}"
    )


def ended(certificate: Certificate) -> tuple[LinearStatus, float]:
    """What ends a curve that is not FREE, and the parameter up to which it is proven."""
    if certificate.status is CertificateStatus.COLLIDING and certificate.first_contact is not None:
        return LinearStatus.CONTACT, certificate.first_contact.proven_free_until
    return LinearStatus.UNDECIDED, 0.0 if certificate.undecided is None else certificate.undecided.start


def percent(fraction: float) -> str:
    """Rounded down: "100 %" is all of the line."""
    return f"{int(fraction * 100)} %"


Array = npt.NDArray[np.float64]

MOST_STARTS = 64
"""Configurations at the first pose that are tried, those nearest to the arm's home."""

SAMPLED_STARTS = 16
"""Of them, where they cannot be listed in closed form: as many different ones as are looked for."""


def plan_poses(
    checker: CollisionChecker,
    start: npt.ArrayLike | None,
    poses: Sequence[SE3] | npt.ArrayLike,
    *,
    task: TaskName | IkTask = "pose",
    rounding: float = 0.0,
    rotation_rounding: float = 0.1,
    deviation: float = 1e-3,
    rotation_deviation: float = 1e-2,
    translation_step: float = 0.05,
    rotation_step: float = 0.2,
    max_joint_step: float = 0.3,
    rng: int | np.random.Generator = 0,
) -> PosesPlanResult:
    """Move the tcp through all poses, on a straight line from each to the next, as :func:`plan_linear` does.

    At a pose the way turns: the arm stops there (the ``corners`` of the path), or, with ``rounding``, passes it on a
    smooth curve.

    Parameters
    ----------
    checker
        What the move must be free of.
    start
        (n,) the first configuration, from where a line leads to the first pose. None: the move begins at the first
        pose, in that configuration, of all branches there, that gets farthest; of those that get to the end, the one
        whose joints need the least time at full speed.
    poses
        (k, 4, 4) ``base_from_tcp``, or a sequence of ``pin.SE3``.
    task
        As for :func:`plan_linear`.
    rounding, rotation_rounding
        By how much (m, rad) a pose may be missed where the way turns; ``rounding`` of 0 stops at every pose. Where it
        turns back on itself the arm stops in any case.
    deviation, rotation_deviation
        Metres and radians the tcp may be off the lines and roundings anywhere.
    translation_step, rotation_step, max_joint_step
        As for :func:`plan_linear`.
    rng
        Seed or Generator of the search for a first configuration where there is no closed form.

    Raises
    ------
    InputError
        If there is no pose, a shape is wrong, a number is not finite, a setting makes no sense, or the task asks for
        part of the position or for one turn alone.
    """
    asked = line_task(task)
    arm = checker.arm
    following = Following(
        arm=arm,
        task=asked,
        deviation=deviation,
        rotation_deviation=rotation_deviation,
        translation_step=translation_step,
        rotation_step=rotation_step,
        max_joint_step=max_joint_step,
    )
    if not rounding >= 0 or not rotation_rounding > 0:
        raise InputError(
            f"rounding = {rounding} must be 0 m or more, and rotation_rounding = {rotation_rounding} above 0 rad"
        )
    wanted = [rigid("pose", pose) for pose in rigid_many("poses", poses)]
    if not wanted:
        raise InputError("poses has no pose; there is nowhere to go")
    if start is not None:
        first = arm.limits.snap(arm.configuration(start, "start"))
        if outside := arm.limits.violations(first, arm.joint_names):
            said = f"the start is no place to start: {outside[0]}"
            return PosesPlanResult(LinearStatus.LIMIT, None, None, 0.0, -1, said)
        return _poses_result(_walk(following, first, wanted, rounding, rotation_rounding), checker, -1)
    starts = _starts(checker, wanted[0], asked, rng)
    free = starts[checker.is_free_batch(starts)] if len(starts) else starts
    if not len(free):
        if not len(starts):
            said = "the first pose cannot be reached inside the limits; see what solve says of it"
            return PosesPlanResult(LinearStatus.UNREACHABLE, None, None, 0.0, -1, said)
        said = f"the first pose is in contact on all of its {len(starts)} branches: {checker.check(starts[0])}"
        return PosesPlanResult(LinearStatus.CONTACT, None, certify(_still(arm, starts[0]), checker), 0.0, -1, said)
    walks = [_walk(following, first, wanted[1:], rounding, rotation_rounding) for first in free]
    walks.sort(key=lambda walk: walk.cost)
    best = _poses_result(walks[0], checker, 0)
    for walk in walks[1:]:
        if best.fraction >= walk.fraction:
            break  # the others do not get farther even where nothing is in their way, or take longer
        move = _poses_result(walk, checker, 0)
        best = move if move.fraction > best.fraction else best
    return best


def _starts(checker: CollisionChecker, pose: SE3, task: IkTask, rng: int | np.random.Generator) -> Array:
    """(k, n) configurations at a pose: every branch where there is a closed form, else a sample of them."""
    if task == IkTask() and checker.arm.dof <= 6:
        try:
            return AnalyticIk().solve_all(checker.arm, pose).q[:MOST_STARTS]
        except NoClosedForm:
            pass
    return Clik().solve_many(checker.arm, pose, rng=rng, count=SAMPLED_STARTS, task=task).q


def _still(arm: Arm, q: Array) -> CubicPath:
    return CubicPath([q], np.zeros((1, len(q))), [0.0], arm.joint_names)


@dataclass(frozen=True, eq=False)
class _Walk:
    """What was walked of some routes, by their lengths; ``passed`` are the parameters at which poses are reached."""

    arm: Arm
    first: Array
    parts: list[CubicPath]
    last: Walked | None
    passed: list[float]
    total: float
    deviation: float
    rotation_deviation: float

    @property
    def path(self) -> BlendedPath:
        return BlendedPath.join(*(self.parts or [_still(self.arm, self.first)]))

    @property
    def fraction(self) -> float:
        """The share of the whole way that was walked."""
        if self.complete:
            return 1.0
        return self.parts[-1].domain[1] / self.total if self.parts else 0.0

    @property
    def complete(self) -> bool:
        return self.last is None or self.last.status is LinearStatus.COMPLETE

    @property
    def cost(self) -> tuple[float, float]:
        """The less the better: what is left to walk, then the time that the joints need at full speed."""
        speed = np.where(np.isfinite(self.arm.limits.velocity), self.arm.limits.velocity, 1.0)
        moves = [np.abs(np.diff(part.q, axis=0)) / speed for part in self.parts]
        return 1.0 - self.fraction, float(sum(move.max(axis=1).sum() for move in moves))


def _walk(following: Following, first: Array, poses: list[SE3], rounding: float, rotation_rounding: float) -> _Walk:
    """Follow the way from where the tcp is at first (n,) through poses, as far as it goes."""
    way = [following.arm.forward_kinematics(first)]
    for pose in poses:
        way.append(aimed(way[-1], pose, following.task))
    routes = sections(way, rounding, rotation_rounding)
    parts: list[CubicPath] = []
    passed: list[float] = []
    last: Walked | None = None
    metres, radians, begin, here = 0.0, 0.0, 0.0, first
    for route in routes:
        if route.size > 0.0:
            last = following.walk(route, here)
            if last.fraction > 0.0:
                parts.append(_stretched(last.path, begin, route.size))
                here = last.path.end
            metres, radians = max(metres, last.deviation), max(radians, last.rotation_deviation)
            passed.extend(begin + at * route.size for at in route.passes if at <= last.fraction)
            begin += route.size
            if last.status is not LinearStatus.COMPLETE:
                break
        else:
            passed.append(begin)
    total = sum(route.size for route in routes)
    return _Walk(following.arm, first, parts, last, passed, total, metres, radians)


def _stretched(path: CubicPath, begin: float, size: float) -> CubicPath:
    """A curve over [0, s] as one over [begin, begin + s size]."""
    return CubicPath(path.q, path.tangents / size, begin + size * path.knots, path.joint_names)


def _poses_result(walk: _Walk, checker: CollisionChecker, offset: int) -> PosesPlanResult:
    """The move as far as it was walked, unless a contact ends it before."""
    path = walk.path
    certificate = certify(path, checker)
    done = walk.total
    if not certificate.free:
        status, done = ended(certificate)
        return _stopped(walk, status, done, certificate.message, certificate, offset)
    if walk.last is not None and walk.last.status is not LinearStatus.COMPLETE:
        done = walk.parts[-1].domain[1] if walk.parts else 0.0
        return _stopped(walk, walk.last.status, done, walk.last.why, None, offset)
    stops = f", {len(path.corners)} stops" if path.corners else ""
    message = f"through all {len(walk.passed) + 1 + offset} poses{stops}, {certificate.message}"
    reached = len(walk.passed) + offset
    off = walk.deviation, walk.rotation_deviation
    return PosesPlanResult(LinearStatus.COMPLETE, path, certificate, 1.0, reached, message, *off)


def _stopped(
    walk: _Walk, status: LinearStatus, done: float, why: str, certificate: Certificate | None, offset: int
) -> PosesPlanResult:
    reached = sum(at <= done for at in walk.passed) + offset
    fraction = done / walk.total if walk.total > 0.0 else 0.0
    towards = f"after pose {reached}" if reached >= 0 else "before the first pose"
    message = f"stops at {percent(fraction)} of the way, {towards}: {why}"
    joints = walk.last.joints if walk.last is not None and certificate is None else ()
    return PosesPlanResult(status, None, certificate, fraction, reached, message, joints=joints)
