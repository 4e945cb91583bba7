"""From a start and a goal to a certified motion in one call: IK, a path, a shorter and rounded one, and a timed one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CollisionChecker, Contact, PathConstraint, check_constraints
from pinproof.common.results import Solution, View
from pinproof.common.structs import described, key
from pinproof.common.validation import require_type
from pinproof.errors import TimingError
from pinproof.model import JointLimits
from pinproof.motion import Bounds, MotionLimits, RateConstraint, TorqueLimits, Trajectory, least_times
from pinproof.planning.goals import Goal, GoalPose, Goals, least_invalid, prove, read_goals
from pinproof.planning.optimisation import OptimiseResult, optimise
from pinproof.planning.plan_results import Barrier, InvalidEnd, PlannedMotion, PlanResult, PlanStatus
from pinproof.planning.planners import CertifiedPlanner, Planner, planner_of
from pinproof.planning.problem import MAX_GOALS, find_barriers, read_ends, with_turns
from pinproof.planning.replanning import Replan, replan
from pinproof.planning.rrt_connect import RrtConnect
from pinproof.planning.simplification import SimplifyResult, shortcut, simplify
from pinproof.spatial import Array

if TYPE_CHECKING:
    from pinproof.viewer import PlotLimits

# IK solutions whose time without obstacles is within this factor of the least are tried first.
PROMISING = 1.3
# Maximum number of IK solutions that are described if none is free.
DESCRIBED = 64
# Maximum number of goals that a page shows.
GHOSTS = 4
UNREACHABLE = PlanStatus.GOAL_UNREACHABLE


@described(eq=False)
class MotionPlan(PlannedMotion):
    """A planned and certified motion, or the reason of the failure."""

    status: PlanStatus = key("FOUND if there is a motion that is proven FREE, else the reason")
    planned: PlanResult = key("the path of the planner, or the evidence of its failure")
    start: Array = key("(n,) the start")
    goals: Array = key("(g, n) the configurations at which the motion may end, such as all IK solutions of a pose")
    poses: tuple[GoalPose, ...] = key("what is known of each pose that was given as a goal", default=())
    goal: Solution[int] = key("the index of the given goal at which the motion ends, if FOUND", default=Solution())
    simplified: Solution[SimplifyResult] = key("the shortened path, if there is a path", default=Solution())
    optimised: Solution[OptimiseResult] = key("the timed motion, if there is one", default=Solution())
    limits: MotionLimits | None = key("the limits as given", default=None)
    jerk: npt.ArrayLike | Literal["limits"] | None = key("the jerk limits as given", default=None)
    rate_limits: tuple[RateConstraint, ...] = key("further limits of the motion, such as torques", default=())
    budget: int = key("how many changes of the motion were tried", default=0)
    reason: str = key("why there is no motion, if the path was not the reason", default="")

    @property
    def ok(self) -> bool:
        """Whether a motion was found that is proven FREE."""
        return self.status is PlanStatus.FOUND

    @property
    def checker(self) -> CollisionChecker:
        """The checker of the certificate: it has tighter bodies if an end was in collision only with coarse ones."""
        return self.planned.checker

    @property
    def trajectory(self) -> Trajectory:
        """The motion; without one, reading it raises :class:`pinproof.errors.PlanFailed`."""
        return self.optimised.trajectory

    @property
    def certificate(self) -> Certificate:
        """The certificate of the motion; without one, reading it raises :class:`pinproof.errors.PlanFailed`."""
        return self.optimised.certificate

    @property
    def invalid(self) -> tuple[InvalidEnd, ...]:
        """Why the start, each goal or each IK solution is not valid: joints outside limits, bodies in contact."""
        return self.planned.invalid

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """The contacts that are the reason of the failure: of the start, of the goals, at barriers, or on the path."""
        return self.planned.contacts

    @property
    def barriers(self) -> tuple[Barrier, ...]:
        """The values that joints cannot pass, if it is proven that no path exists."""
        return self.planned.barriers

    @property
    def message(self) -> str:
        """The length and the durations, or why there is no motion."""
        if self.reason or not self.planned.ok:
            return self.reason or self.planned.message
        stops, best = self.simplified.stops, self.optimised
        length = f"path of length {self.simplified.path.length:.3g} rad"
        text = f"{length}, {stops} intermediate stop{'' if stops == 1 else 's'}, {best.duration_before:.2f} s"
        text += f"; optimised motion {best.duration:.2f} s" if self.budget else ""
        return f"{text}, lower bound without obstacles {best.lower_bound:.2f} s ({best.trajectory.limits_note})"

    def to_dict(self) -> dict[str, Any]:
        """The figures, the torques and the certificate, or the evidence of the failure, as plain values for JSON."""
        outcome: dict[str, Any] = {"ok": self.ok, "status": self.status.name, "message": self.message}
        motion = vars(self)["optimised"]
        if motion is None:
            outcome |= {name: [asdict(each) for each in getattr(self, name)] for name in ("invalid", "barriers")}
            work = {name: getattr(self.planned, name) for name in ("nodes", "samples", "gap")}
            return {**outcome, "poses": [pose.to_dict() for pose in self.poses], **work}
        figures = {
            "goal": vars(self)["goal"],
            "stops": self.simplified.stops,
            "length": self.simplified.path.length,
            "duration_of_path": motion.duration_before,
            "duration": motion.duration,
            "lower_bound": motion.lower_bound,
        }
        torques = _torques(self.rate_limits)
        report = {} if torques is None else torques.report(self.trajectory)
        return {**outcome, **figures, **report, "certificate": self.certificate.to_dict()}

    def replan(self, checker: CollisionChecker, q_now: npt.ArrayLike, t_now: float, **settings: Any) -> Replan:
        """Continue this motion from its present state in a scene that has changed, see :func:`pinproof.replan`.

        The goals, limits and constraints are those of this motion unless ``settings`` state others.
        """
        own = {name: getattr(self, name) for name in ("goals", "limits", "jerk", "rate_limits")}
        own["constraints"] = [proof.constraint for proof in self.certificate.constraints]
        return replan(self.trajectory, checker, q_now, t_now, **{**own, **settings})

    def _pictured(self) -> tuple[Trajectory | None, dict[str, Any]]:
        checker, motion = self.checker, vars(self)["optimised"]
        shown: dict[str, Any] = {"attached": checker.attached}
        if motion is not None:
            return motion.trajectory, {**shown, "certificate": motion.certificate}
        # The configuration that shows the reason: in contact, at a barrier, nearest to a pose, or the start
        q = self.start
        if self.invalid:
            q = least_invalid(self.invalid).q
        elif self.barriers:
            barrier = self.barriers[0]
            q = np.where(np.array(checker.group.joint_names) == barrier.joint, barrier.value, q)
        elif self.poses and self.poses[0].nearest is not None:
            q = self.poses[0].nearest.q
        frames = {f"goal {index}": checker.arm.root_from_base * pose.pose for index, pose in enumerate(self.poses)}
        shown |= {"q": q, "frames": frames, "ghosts": self.goals[:GHOSTS], "title": self.status.value}
        shown |= {"check": checker.check(q)} if self.contacts else {}
        return None, shown

    def _plot_limits(self) -> PlotLimits:
        from pinproof.viewer import PlotLimits

        arm = self.checker.group
        bounds = Bounds.of(self.limits or arm.limits, arm.joint_names, self.jerk)
        known = PlotLimits.of(arm) if self.limits is None else PlotLimits(self.limits)
        return replace(known, jerk=bounds.jerk, rate_limits=self.rate_limits)

    def _view(self) -> View:
        if vars(self)["optimised"] is None:
            evidence = [*(pose.message for pose in self.poses), *(end.message for end in self.invalid)]
            return View(f"{self.status.name}: {self.message}", [evidence])
        torques = _torques(self.rate_limits)
        largest = [] if torques is None else [f"largest torque: {torques.largest(self.trajectory)}"]
        notes = () if torques is None else torques.notes
        lines = [*largest, str(self.certificate), *(f"note: {note}" for note in notes)]
        return View(self.message, [largest, self.trajectory, self.certificate], lines)


def plan(
    checker: CollisionChecker,
    start: npt.ArrayLike,
    goal: Goal,
    *,
    planner: Planner | str | None = None,
    limits: MotionLimits | None = None,
    jerk: npt.ArrayLike | Literal["limits"] | None = None,
    constraints: Sequence[PathConstraint] = (),
    rate_limits: Sequence[RateConstraint] = (),
    blend: bool = True,
    budget: int = 600,
    rng: int = 0,
) -> MotionPlan:
    """Plan a motion from a configuration to a goal: collision-free by a proof, within all limits, and short.

    A pose becomes its IK solutions, by the closed form if the arm has one. The planner connects the start with one of
    them, its path is shortened and rounded, and :func:`optimise` makes a timed motion of it, which may end at another
    one of the goals. The motion is certified. Of :class:`pinproof.RrtConnect`, the shorter one of two paths is used.

    Parameters
    ----------
    checker
        The arm in its scene, with what it carries.
    start
        (n,) rad or m.
    goal
        A configuration (n,), several (g, n), a pose ``base_from_tcp`` as ``pin.SE3``, several poses, or
        :class:`~pinproof.ik.IkBranches`. The motion ends at one of them.
    planner
        Finds the path; by default :class:`pinproof.RrtConnect`. Any object with the method of
        :class:`pinproof.planning.Planner`, or its name.
    limits, jerk, rate_limits, constraints
        What the motion must keep to, as for :func:`pinproof.optimise`. :class:`pinproof.JointLimits` replace those of
        the arm; by default, the limits of the arm are used.
    blend
        Whether the corners of the path are rounded.
    budget
        How many changes of the motion are tried to reduce its duration. With 0, the shortened path is only timed.
    rng
        The seed.

    Returns
    -------
    MotionPlan
        With ``trajectory`` and ``certificate``; or with a status, a message, and the evidence: joints outside their
        limits, bodies in contact, IK solutions, the proof that a pose is out of reach or the nearest configuration,
        barriers, or the work of the search.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, a setting is invalid, or the planner does not support the task.
    """
    require_type("checker", checker, CollisionChecker)
    group, search, solved = checker.group, planner_of(planner), checker
    first = group.configuration(start, "start")
    if isinstance(limits, JointLimits):  # also of the positions; the certificate proves them
        checker = checker.with_spec(replace(checker.spec, arm=group.with_limits(limits)))
        # What is known of the IK of an arm is kept for it; the solutions depend on the limits of position only
        same = np.array_equal([limits.lower, limits.upper], [group.limits.lower, group.limits.upper])
        group, solved = checker.group, solved if same else checker
    bounds = Bounds.of(group.limits if limits is None else limits, group.joint_names, jerk)
    task: dict[str, Any] = {"constraints": constraints, "torque_limits": _torques(rate_limits)}
    # A path to one of the goals
    goals = read_goals(solved, first, goal, rng)
    planned, goals, tried = _path(search, checker, first, goals, bounds, {**task, "rng": rng})
    given: dict[str, Any] = {"limits": limits, "jerk": jerk, "rate_limits": tuple(rate_limits), "budget": budget}
    result = MotionPlan(planned.status, planned, first, goals.q, goals.poses, **given)
    if not planned.ok:
        return result
    # A shorter and rounded one; the checker has finer bodies if an end is in collision only with coarse ones
    checker, path = planned.checker, planned.path
    if isinstance(search, RrtConnect) and not constraints and len(path) > 2:
        # A second search may pass obstacles on another side; it has twice the work of the first
        other = search.limited_to(2 * planned.nodes).plan(checker, first, goals.q[tried], **task, rng=rng + 1)
        found = [planned, other] if other.ok else [planned]
        short = [shortcut(each.path, checker, rng=rng, torque_limits=task["torque_limits"]) for each in found]
        path, planned = min(zip(short, found, strict=True), key=lambda pair: pair[0].length)
        task["attempts"] = 0
    simplified = simplify(path, checker, rng=rng, blend=blend, **task)
    result = result.changed(planned=planned, simplified=simplified)
    # A motion, which may end at another goal
    many = goals.q if len(goals.q) > 1 else None
    try:
        kept: dict[str, Any] = {"limits": limits, "jerk": jerk, "rate_limits": rate_limits, "constraints": constraints}
        optimised = optimise(simplified.path, checker, goals=many, rng=rng, budget=budget, **kept)
    except TimingError as error:
        return result.changed(status=PlanStatus.NOT_TIMED, reason=str(error))
    row = tried[planned.goal] if many is None or optimised.goal is None else optimised.goal
    result = result.changed(optimised=optimised, goal=int(goals.of[row]))
    if not optimised.certificate.free:
        return result.changed(status=PlanStatus.NOT_PROVEN, goal=None, reason=optimised.certificate.message)
    return result


def _torques(rate_limits: Sequence[RateConstraint]) -> TorqueLimits | None:
    return next((limit for limit in rate_limits if isinstance(limit, TorqueLimits)), None)


def _path(
    search: RrtConnect | CertifiedPlanner,
    checker: CollisionChecker,
    start: Array,
    goals: Goals,
    bounds: Bounds,
    task: dict[str, Any],
) -> tuple[PlanResult, Goals, npt.NDArray[np.int64]]:
    """The result of the planner, the goals at which the motion may end, and the rows of those the planner was given."""
    if not goals.poses:
        return search.plan(checker, start, goals.q, **task), goals, np.arange(len(goals.q))
    # Those of the free IK solutions that are near in time first; if no path is found, also the others
    if (free := np.flatnonzero(checker.is_free_batch(goals.q))).size:
        seconds = least_times(goals.q[free] - start, bounds)
        nearest = np.argsort(seconds, kind="stable")[:MAX_GOALS]
        goals = goals._replace(q=goals.q[free[nearest]], of=goals.of[free[nearest]])
        near = np.flatnonzero(seconds[nearest] <= PROMISING * seconds.min())
        for rows in [near, np.arange(len(nearest))][len(near) == len(nearest) :]:
            planned = search.plan(checker, start, goals.q[rows], **task)
            if planned.ok or planned.status in (PlanStatus.START_INVALID, PlanStatus.CANCELLED):
                break
        if planned.status is PlanStatus.IMPOSSIBLE:
            planned, goals = _around(search, checker, start, goals, planned, task)
            rows = np.arange(len(goals.q))
    else:
        # With coarse bodies none is free: the planner tries finer ones, and describes the contacts
        many = [pose.branches[:DESCRIBED] for pose in goals.poses]
        of = np.repeat(np.arange(len(many)), [len(q) for q in many])
        goals, rows = goals._replace(q=np.concatenate(many), of=of), np.arange(len(of))
        if len(rows):
            planned = search.plan(checker, start, goals.q, **task)
        else:
            kept = {"constraints": check_constraints(task["constraints"]), "torque_limits": task["torque_limits"]}
            alone = read_ends(checker, start, start, turns=False, **kept)
            planned = alone if isinstance(alone, PlanResult) else PlanResult(UNREACHABLE, checker=checker)
    # What is known of each pose
    if planned.status in (PlanStatus.GOAL_INVALID, UNREACHABLE):
        poses = []
        for number, pose in enumerate(goals.poses):
            ends = [end for end in planned.invalid if end.goal is not None and goals.of[rows[end.goal]] == number]
            poses.append(prove(checker.arm, replace(pose, invalid=tuple(ends))))
        names = [f"goal pose {number}: " if len(poses) > 1 else "goal pose: " for number in range(len(poses))]
        message = "; ".join(name + pose.message for name, pose in zip(names, poses, strict=True))
        planned, goals = planned.changed(message=message), goals._replace(poses=tuple(poses))
    return planned, goals, rows


def _around(
    search: RrtConnect | CertifiedPlanner,
    checker: CollisionChecker,
    start: Array,
    goals: Goals,
    planned: PlanResult,
    task: dict[str, Any],
) -> tuple[PlanResult, Goals]:
    """The result, and the goals, if barriers are before all goals that the planner was given for poses."""
    # Of a joint without limits, IK gives the nearest angle only; the next one may be on the other side of the start
    every = np.concatenate([pose.q for pose in goals.poses])
    if np.isinf([checker.group.limits.lower, checker.group.limits.upper]).any():
        every, _ = with_turns(checker.group, start, every)
        turned, of = with_turns(checker.group, start, goals.q)
        goals = goals._replace(q=turned, of=goals.of[of])
        planned = search.plan(checker, start, turned, **task)
        if planned.status is not PlanStatus.IMPOSSIBLE:
            return planned, goals
    # It is a proof if barriers are before all solutions that exist, also those in contact with coarse bodies
    known = all(pose.complete for pose in goals.poses) and len(every) != MAX_GOALS
    if known and find_barriers(checker, start, every):
        return planned, goals
    reason = f"no path to an IK solution that is known: {'; '.join(map(str, planned.barriers))}. Others may be reached"
    return planned.changed(status=PlanStatus.OUT_OF_BUDGET, message=reason, barriers=()), goals
