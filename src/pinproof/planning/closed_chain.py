"""Motions of a joint group whose arms hold one part together: a closed chain.

The part moves with the tcp of the first arm, the leader. Each other arm must follow: the pose of its tcp in the tcp
frame of the leader is constant. These are constraints of the tcp (:func:`pinproof.collision.held_together`), so that
:func:`pinproof.plan` plans along them in the space of all joints: samples are projected onto the configurations that
close the chain, by the pseudo-inverse, which needs no closed form and leaves the free joints of redundant arms to the
search. Steps are connected only if the straight edge between them is proven to satisfy the constraints, so that an arm
never jumps to another branch of its inverse kinematics.

The certificate of the motion bounds the deviation of the chain at every instant.

Sources: J. Yakey, S. LaValle, L. Kavraki (2001), "Randomized path planning for linkages with closed kinematic chains",
IEEE Transactions on Robotics and Automation 17(6); D. Berenson, S. Srinivasa, J. Kuffner (2011), "Task space regions: a
framework for pose-constrained manipulation planning", IJRR 30(12), section 4.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, Obstacle, Within, held_together
from pinproof.common.structs import described, key
from pinproof.common.validation import require_type
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import JointGroup
from pinproof.planning.goals import GoalPose, prove, solve_pose
from pinproof.planning.motion_plan import MotionPlan, plan
from pinproof.planning.plan_results import PlanResult, PlanStatus
from pinproof.planning.planners import planner_of
from pinproof.planning.problem import read_configurations
from pinproof.planning.rrt_connect import RrtConnect
from pinproof.spatial import SE3, Array, rigid

# m and rad: by how much a hand may deviate from its place at the part, by default. Grippers and parts yield by more.
TOLERANCE = 2e-4
ROTATION_TOLERANCE = math.radians(0.1)
# Number of IK solutions of each arm at a pose of the part that are combined: half of them are those nearest to the
# start, the others are spread over the rest.
MOST_SOLUTIONS = 24
# Number of combinations, nearest to the start, at which the motion may end.
MOST_GOALS = 200
# Number of combinations that are described if all are in contact.
DESCRIBED = 8
# Number of combinations at the pose of the part at the start from which a motion is searched for.
MOST_STARTS = 4
# Number of nodes of the search that ignores all contacts, after a failure.
NODES_WITHOUT_CONTACTS = 4000


@described()
class ChainDeviation:
    """The largest deviation of a hand from its place at the part, proven over the whole motion, between samples too."""

    position: float = key("of the origin of the tcp", "m")
    rotation: float = key("of its orientation", "rad")

    def __str__(self) -> str:
        return f"{self.position * 1e3:.3f} mm and {math.degrees(self.rotation):.3f} deg"


@described(eq=False)
class CarryPlan(MotionPlan):
    """A motion of several arms that hold one part, or the reason of the failure; result of :func:`plan_carry`."""

    leader: str = key("the arm to which the part is attached", default="")
    grasps: dict[str, SE3] = key("``tcp_from_part`` of each arm", default=None)

    @property
    def deviations(self) -> dict[str, ChainDeviation]:
        """For each arm that follows the leader, its largest deviation; without a motion, it raises PlanFailed."""
        largest: dict[str, list[float]] = {}
        angles: dict[str, float] = {}
        for proof in self.certificate.constraints:
            arm, relative = proof.constraint.arm, proof.constraint.relative_to
            if arm is None or relative is None:
                continue
            if isinstance(proof.constraint, Within):
                largest.setdefault(arm, []).append(proof.largest)
            else:  # see held_together: the squares of the sines of half the angles of two axes add up
                angles[arm] = angles.get(arm, 0.0) + math.sin(proof.largest / 2.0) ** 2
        return {
            arm: ChainDeviation(max(distances), 2.0 * math.asin(min(1.0, math.sqrt(angles[arm]))))
            for arm, distances in largest.items()
        }

    @property
    def message(self) -> str:
        """The length, the durations and the deviations, or why there is no motion."""
        text = super().message
        if self.ok:
            text += "".join(f"; {arm} follows {self.leader} within {by}" for arm, by in self.deviations.items())
        return text

    def to_dict(self) -> dict[str, Any]:
        """The values of :meth:`MotionPlan.to_dict`, and the deviation of each arm that follows the leader."""
        own = {arm: [by.position, by.rotation] for arm, by in self.deviations.items()} if self.ok else {}
        return {**super().to_dict(), "leader": self.leader, "deviations": own}


def plan_carry(
    checker: CollisionChecker,
    part: Obstacle | Sequence[Obstacle],
    grasps: Mapping[str, SE3],
    start: npt.ArrayLike | SE3,
    goal: npt.ArrayLike | SE3 | Sequence[SE3],
    *,
    tolerance: float = TOLERANCE,
    rotation_tolerance: float = ROTATION_TOLERANCE,
    budget: int = 0,
    rng: int = 0,
    **settings: Any,
) -> CarryPlan:
    """Plan a motion of several arms of a joint group that hold one part together.

    The motion keeps the limits of all joints, is proven collision-free, and every hand stays at its place at the part
    within the tolerances, which the certificate proves between samples too.

    Parameters
    ----------
    checker
        The joint group in its scene. The part is attached to the leader, and taken out of the scene if that has an
        obstacle of its name. It may touch the hands of the arms: the links, and objects attached to them, that no joint
        of the group moves relative to their tcp. All other pairs are checked.
    part
        One or several bodies, whose poses are in the frame of the part.
    grasps
        For each arm that holds the part ``tcp_from_part``, the pose of the part in the frame of its tcp. The first arm
        is the leader. Other arms of the group stay at rest in the goals that are computed.
    start
        (n,) the configuration of the group, in which the hands are at their places within the tolerances; or the pose
        of the part in the frame of the root link as ``pin.SE3``, for which configurations are computed.
    goal
        Configurations (n,) or (g, n), or one or several poses of the part.
    tolerance, rotation_tolerance
        The largest deviation (m, rad) of the tcp of each arm from its place at the part.
    budget, rng, settings
        As for :func:`pinproof.plan`: ``constraints`` of the leader's tcp, for example, are stated with ``arm=``.

    Returns
    -------
    CarryPlan
        A :class:`pinproof.MotionPlan` of all joints with the ``deviations`` of the hands; or with a status and a
        message: which arm does not reach its place at the part, which bodies are in contact, or whether the closed
        chain has no continuous motion even without contacts, as far as was searched.

    Raises
    ------
    UnknownNameError, InputError
        If ``grasps`` names an unknown arm or fewer than two, arms share joints and a pose is given, or as for
        :func:`pinproof.plan`.
    """
    require_type("checker", checker, CollisionChecker)
    group, leader, held = checker.group, next(iter(grasps), ""), _checked_grasps(checker.group, grasps)
    carrying = _carrying(checker, part, leader, held)
    chain = [
        each
        for arm, pose in held.items()
        if arm != leader
        for each in held_together(
            arm, leader, held[leader] * pose.inverse(), tolerance=tolerance, rotation_tolerance=rotation_tolerance
        )
    ]
    settings |= {"constraints": (*chain, *settings.get("constraints", ())), "budget": budget, "rng": rng}
    own: dict[str, Any] = {"leader": leader, "grasps": held}
    # The configurations at the start and at the goals
    poses = {"start": [start] if isinstance(start, SE3) else [], "goal": _poses(goal)}
    if any(poses.values()) and group.shared_joints:
        shared = ", ".join(group.shared_joints)
        raise InputError(f"the joints {shared} are shared by arms; give configurations instead of poses of the part")
    near, reached = group.home, []
    if poses["start"]:
        reached = [_reach(carrying, held, "start", poses["start"][0], near, rng)]
    else:
        near = group.configuration(start, "start")
    given = reached[0].q[_free_rows(carrying, reached[0].q, near, MOST_STARTS)] if reached else near[None]
    near = given[0] if len(given) else near
    goals = [_reach(carrying, held, "goal", pose, near, rng) for pose in poses["goal"]]
    if not len(given) or (goals and not any(len(each.q) for each in goals)):
        failed = [each for each in (*reached, *goals) if not len(each.q)]
        status = PlanStatus.GOAL_UNREACHABLE if len(given) else PlanStatus.START_INVALID
        planned = PlanResult(status, message="; ".join(each.message for each in failed), checker=carrying)
        known = tuple(pose for each in failed for pose in each.poses)
        return CarryPlan(status, planned, near, np.empty((0, group.dof)), known, **own)
    ends = np.concatenate([each.q for each in goals]) if goals else read_configurations(group, goal, "goal")
    of = np.repeat(np.arange(len(goals)), [len(each.q) for each in goals]) if goals else np.arange(len(ends))
    # A motion from the first of the starts from which one is found
    for first in given:
        rows = _free_rows(carrying, ends, first, MOST_GOALS) if goals else np.arange(len(ends))
        motion = plan(carrying, first, ends[rows], **settings)
        if motion.ok:
            break
    result = CarryPlan(**{each.name: vars(motion)[each.name] for each in fields(motion)}, **own)
    if motion.ok:
        return result.changed(goal=int(of[rows[motion.goal]]))
    if motion.status is not PlanStatus.OUT_OF_BUDGET or not isinstance(planner_of(settings.get("planner")), RrtConnect):
        return result
    # Do contacts prevent the motion, or does the chain have no continuous motion to these configurations?
    anywhere = carrying.without_pairs(range(len(carrying.pairs)))
    search = RrtConnect().limited_to(NODES_WITHOUT_CONTACTS)
    if search.plan(anywhere, first, ends[rows], constraints=chain, rng=rng).ok:
        reason = "without contacts, the arms can carry the part to a goal"
    else:
        reason = (
            "no continuous motion of the closed chain was found even without contacts: all goals may be on other IK "
            "branches, or out of reach in between; try another start or goal"
        )
    return result.changed(reason=f"{motion.message}; {reason}")


class _Reached(NamedTuple):
    """Configurations (k, n) of a group at a pose of the part; what is known of each arm; and the reason if k = 0."""

    q: Array
    poses: tuple[GoalPose, ...]
    message: str


def _checked_grasps(group: JointGroup, grasps: Mapping[str, SE3]) -> dict[str, SE3]:
    require_type("grasps", grasps, Mapping)
    for name in grasps:
        if name not in group.ends:
            raise UnknownNameError("arm", name, group.ends, "grasps")
    if len(grasps) < 2:
        raise InputError(
            f"grasps names {', '.join(grasps) or 'no arm'}; at least two arms hold the part: {{arm: tcp_from_part}}"
        )
    return {name: rigid(f"grasps[{name!r}]", pose) for name, pose in grasps.items()}


def _carrying(
    checker: CollisionChecker, part: Obstacle | Sequence[Obstacle], leader: str, grasps: Mapping[str, SE3]
) -> CollisionChecker:
    """The checker with the part attached to the leader, which may touch the hands that hold it."""
    bodies = (part,) if isinstance(part, Obstacle) else tuple(part) if isinstance(part, Sequence) else ()
    if not bodies or not all(isinstance(body, Obstacle) for body in bodies):
        raise InputError("part must be an Obstacle or several, with poses in the frame of the part")
    names = [body.name for body in bodies]
    attached = [replace(body, arm=leader, pose=grasps[leader] * body.pose) for body in bodies]
    lifted = checker.with_scene(checker.scene.remove(*[name for name in names if name in checker.scene]))
    group, owners = checker.group, {body.owner for body in checker.bodies}
    hands = [link for arm in grasps for link in group.hand_links(arm) if link in owners]
    hands += [body.name for body in checker.attached if body.arm in grasps]
    return lifted.with_attached(*checker.attached, *attached).allowing(*product(names, hands))


def _poses(goal: Any) -> list[SE3]:
    """The poses of a goal; empty for configurations."""
    many = [goal] if isinstance(goal, SE3) else goal
    if not isinstance(many, (list, tuple)) or not any(isinstance(each, SE3) for each in many):
        return []
    if not all(isinstance(each, SE3) for each in many):
        raise InputError("goal has poses and other values; give poses of the part only, or configurations only")
    return list(many)


def _reach(
    carrying: CollisionChecker, grasps: Mapping[str, SE3], what: str, pose: SE3, near: Array, rng: int
) -> _Reached:
    """The configurations at which all hands are at their places at a part, the other joints as in ``near`` (n,)."""
    group, root_from_part = carrying.group, rigid(what, pose)
    between = [{joint.index for joint in carrying.world.joints_between(k)} for k in range(len(carrying.pairs))]
    q, poses, reasons = near[None], list[GoalPose](), list[str]()
    for name, tcp_from_part in grasps.items():
        arm, own = group.arms[name], group.indices(name)
        target = arm.root_from_base.inverse() * root_from_part * tcp_from_part.inverse()
        known = prove(arm, solve_pose(arm, target, near[own], rng))
        poses.append(known)
        if not len(known.branches):
            reasons.append(f"arm {name!r} does not reach its place at the part: {known.message}")
            continue
        # The solutions without contacts among the bodies that only this arm moves: those nearest, and some others
        single = np.repeat(near[None], len(known.branches), axis=0)
        single[:, own] = known.branches
        alone = carrying.without_pairs(k for k, joints in enumerate(between) if not joints.issubset(own.tolist()))
        free = np.flatnonzero(alone.is_free_batch(single))
        free = free if len(free) else np.arange(len(single))
        several = np.linspace(0, len(free) - 1, MOST_SOLUTIONS).astype(int)
        rows = free[np.unique([*range(min(MOST_SOLUTIONS // 2, len(free))), *several])]
        combined = np.repeat(q, len(rows), axis=0)
        combined[:, own] = np.tile(known.branches[rows], (len(q), 1))
        q = combined
    return _Reached(
        q[: 0 if reasons else None], tuple(poses), f"at the {what}, {'; '.join(reasons)}" if reasons else ""
    )


def _free_rows(checker: CollisionChecker, q: Array, near: Array, most: int) -> npt.NDArray[np.int64]:
    """The rows of the free configurations (k, n) nearest to one, or of a few in contact if none is free."""
    order = np.argsort(np.abs(q - near).max(axis=1), kind="stable")
    free = order[checker.is_free_batch(q[order])]
    return free[:most] if len(free) else order[:DESCRIBED]
