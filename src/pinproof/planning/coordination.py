"""Coordination of several arms: each keeps its own path, and arms wait or move slower, so that all are certified.

The arms are coordinated in the order of their priority: the motion of an arm ends as early as the certificate of all
motions so far allows. Delays and slowdowns are searched on a grid, so that the result is not the best one that exists.

:func:`plan_arms` plans the paths too: of all arms together in the space of all joints, and one arm after the other with
waiting; the shorter certified motion is returned.

Sources: M. Erdmann, T. Lozano-Perez (1987), "On multiple moving objects", Algorithmica 2 (prioritised planning); K.
Kant, S. W. Zucker (1986), "Toward efficient trajectory planning: the path-velocity decomposition", IJRR 5(3).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import permutations
from typing import Literal

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CertificateStatus, CollisionChecker, certify
from pinproof.common.results import Answer, Solution
from pinproof.common.structs import described, key
from pinproof.common.validation import Rng, require_positive, require_type
from pinproof.errors import InputError, NoAnswer
from pinproof.model import guess_mark
from pinproof.motion import JointPath, Trajectory, synchronise, time_parametrise
from pinproof.planning.planners import CertifiedPlanner, Planner, planner_of
from pinproof.planning.rrt_connect import RrtConnect
from pinproof.planning.simplification import shortcut

# Seconds between the delays that are tried: a small part of a usual motion.
STEP = 0.05
# Factors of the duration of a motion that are tried: an arm that follows another must move as slowly as it does.
SLOWDOWNS = (1.0, 1.25, 1.5, 2.0, 3.0)
# Largest number of arms of which every order is tried.
MOST_ORDERED = 3


@described(eq=False)
class CoordinationResult(Answer):
    """The motion of all arms; result of :func:`coordinate`."""

    certificate: Certificate = key(
        "the certificate of ``trajectory``, or of the motion with the last delays that were tried"
    )
    delays: dict[str, float] = key("seconds by which each arm starts later, by name")
    slowdowns: dict[str, float] = key("the factor of the duration of each arm's motion, by name: 1 or more")
    message: str = key("the result as a sentence")
    trajectory: Solution[Trajectory] = key(
        "the motion of the joint group; reading it raises :class:`pinproof.errors.NoAnswer` if no delays were found",
        default=Solution(),
    )
    method: Literal["joint", "prioritised"] = key(
        '``"prioritised"``, or ``"joint"`` if :func:`plan_arms` planned all arms in the space of all joints',
        default="prioritised",
    )

    @property
    def ok(self) -> bool:
        """Whether the motion of all arms together is proven."""
        return self.certificate.free


def coordinate(
    checker: CollisionChecker, trajectories: Mapping[str, Trajectory], *, step: float = STEP
) -> CoordinationResult:
    """Find start times of given motions of several arms such that all of them together are proven collision-free.

    Parameters
    ----------
    checker
        The checker of the joint group.
    trajectories
        For each arm of the group its motion, at rest at both ends. The first has the highest priority and starts at
        once; the others wait, or move slower along the same path, whichever ends earlier. An arm that has not started
        rests at the start of its motion, and one that has arrived at its end.
    step
        Seconds between the delays that are tried.

    Raises
    ------
    UnknownNameError
        If the group has no arm of a name.
    InputError
        If an arm is missing, a motion does not rest at its ends, or ``step`` is not positive.
    """
    require_positive("step (s)", step)
    for name, given in trajectories.items():
        require_type(f"the motion of {name!r}", given, Trajectory)
        ends = [given.velocities[[0, -1]], *([] if given.accelerations is None else [given.accelerations[[0, -1]]])]
        if any(values.any() for values in ends):
            raise InputError(f"the motion of arm {name!r} does not rest at its ends, so that the arm cannot wait there")
    group, placed = checker.group, dict[str, Trajectory]()
    delays, slowdowns = dict.fromkeys(trajectories, 0.0), dict.fromkeys(trajectories, 1.0)
    whole = certificate = None
    for name, given in trajectories.items():
        waiting = {
            other: Trajectory.at_rest(later.start, later.joint_names)
            for other, later in trajectories.items()
            if other not in (*placed, name)
        }
        if waiting and not placed:
            placed[name] = given  # it starts at once in any case; the certificates with the other arms cover it
            continue
        # Delays and slowdowns, the earliest end first. At a delay of `busy`, all other arms have arrived.
        busy = max((motion.duration for motion in placed.values()), default=0.0)
        retimings = [
            (delay, factor)
            for delay in (*np.arange(0.0, busy, step).tolist(), busy)
            for factor in SLOWDOWNS
            if delay + (factor - 1.0) * given.duration <= busy
        ]
        for delay, factor in sorted(retimings, key=lambda timing: (timing[0] + timing[1] * given.duration, timing[1])):
            slower = given if factor == 1.0 else given.slowed(factor)
            rest = Trajectory.at_rest(given.start, given.joint_names, delay, quintic=given.accelerations is not None)
            motion = Trajectory.join(rest, slower) if delay and slower.duration else slower
            whole = synchronise({**placed, name: motion, **waiting}, group, wait=True)
            certificate = certify(whole, checker)
            if certificate.status is CertificateStatus.FREE:
                placed[name], delays[name], slowdowns[name] = motion, motion.duration - slower.duration, factor
                break
        else:
            if certificate is None:
                raise InputError("there is no trajectory")
            message = f"arm {name!r} is not free of collisions at any delay up to {busy:.3g} s: {certificate.message}"
            return CoordinationResult(certificate, delays, slowdowns, message)
    if whole is None or certificate is None:
        raise InputError("there is no trajectory")
    changes = [f"{name} waits {delay:.3g} s" for name, delay in delays.items() if delay > 0.0]
    changes += [f"{name} takes {factor:.3g} times as long" for name, factor in slowdowns.items() if factor > 1.0]
    duration = f"{whole.duration:.3g} s{guess_mark(whole.limits_note)}"
    message = f"{len(delays)} arms in {duration}; {', '.join(changes) or 'none waits'}; {certificate.message}"
    return CoordinationResult(certificate, delays, slowdowns, message, whole)


def plan_arms(
    checker: CollisionChecker,
    start: npt.ArrayLike,
    goals: npt.ArrayLike,
    *,
    planner: Planner | str | None = None,
    step: float = STEP,
    rng: Rng = 0,
) -> CoordinationResult:
    """Plan the motion of several arms by two methods, and return the shorter certified one.

    The arms are planned together in the space of all joints, and one after the other: each arm is planned with those
    of higher priority at their goals and the others at their starts, and :func:`coordinate` lets them wait. Each order
    of up to three arms is tried, and the given order of more.

    Parameters
    ----------
    checker
        The checker of the joint group.
    start
        (n,) the configuration of the group at the start.
    goals
        (n,) or (k, n) configurations, one of which is reached.
    planner
        The planner of both; by default RRT-Connect.
    step
        Seconds between the delays that are tried.
    rng
        Seed or Generator.

    Raises
    ------
    InputError
        If the start or no goal is valid, or arms share joints.
    NoAnswer
        If neither finds a motion; the message has the reason of both.
    """
    group, search = checker.group, planner_of(planner)
    if group.shared_joints:
        raise InputError(
            f"the joints {', '.join(group.shared_joints)} are shared, so that arms cannot wait for each other"
        )
    seed = int(np.random.default_rng(rng).integers(2**31))
    plan = search.plan(checker, start, goals, rng=seed)
    found: list[CoordinationResult] = []
    reasons = [f"joint: {plan.message}"]
    if plan.ok:
        motion = time_parametrise(shortcut(plan.path, checker, rng=seed), group.limits)
        certificate = certify(motion, checker)
        message = (
            f"{len(group.ends)} arms in {motion.duration:.3g} s{guess_mark(motion.limits_note)}, planned together; "
            f"{certificate.message}"
        )
        reasons = [f"joint: {certificate.message}"]
        if certificate.free:
            delays, slowdowns = dict.fromkeys(group.ends, 0.0), dict.fromkeys(group.ends, 1.0)
            found.append(CoordinationResult(certificate, delays, slowdowns, message, motion, "joint"))
    begin = group.configuration(start, "start")
    # One goal for both, so that the order of the arms does not decide which one is reached.
    goal = np.atleast_2d(np.asarray(goals, dtype=float))[0] if not plan.ok else np.asarray(plan.path.q[-1])
    orders = list(permutations(group.ends)) if len(group.ends) <= MOST_ORDERED else [tuple(group.ends)]
    for order in orders:
        motions, reason = _one_after_the_other(checker, begin, goal, order, search, seed)
        result = None if reason else coordinate(checker, motions, step=step)
        if result is not None and result.ok:
            found.append(result)
        else:
            reasons.append(f"{', '.join(order)}: {reason or (result.message if result else '')}")
    if not found:
        raise NoAnswer(f"no motion of all arms was found: {'; '.join(reasons)}")
    return min(found, key=lambda result: result.trajectory.duration)


def _one_after_the_other(
    checker: CollisionChecker,
    start: npt.NDArray[np.float64],
    goal: npt.NDArray[np.float64],
    order: Sequence[str],
    planner: RrtConnect | CertifiedPlanner,
    seed: int,
) -> tuple[dict[str, Trajectory], str]:
    """The motion of each arm with those before it at the goal and those after it at the start, or the reason."""
    group, now, motions = checker.group, start.copy(), {}
    for name in order:
        own = group.indices(name)
        then = now.copy()
        then[own] = goal[own]
        others = np.setdiff1d(np.arange(group.dof), own)
        lower, upper = group.limits.lower.copy(), group.limits.upper.copy()
        lower[others] = upper[others] = now[others]
        still = group.with_limits(replace(group.limits, lower=lower, upper=upper))
        alone = checker.with_spec(replace(checker.spec, arm=still))
        plan = planner.plan(alone, now, then, rng=seed)
        if not plan.ok:
            return {}, f"{name}: {plan.message}"
        path = shortcut(plan.path, alone, rng=seed)
        names = [group.joint_names[i] for i in own]
        motions[name] = time_parametrise(JointPath(path.q[:, own], names), group.limits.select(own))
        now = then
    return motions, ""
