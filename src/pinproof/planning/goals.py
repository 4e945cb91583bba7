"""What a goal of a motion may be: configurations, poses of the tcp, or IK solutions; and what is known of each pose."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from math import degrees, inf
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker
from pinproof.common.structs import described, key
from pinproof.errors import InputError, NoClosedForm
from pinproof.ik import AnalyticIk, Clik, IkBranches, IkResult, ReachProof, is_provable, prove_unreachable
from pinproof.model import Arm
from pinproof.planning.plan_results import InvalidEnd
from pinproof.planning.problem import read_configurations
from pinproof.spatial import SE3, Array, rigid

Goal: TypeAlias = npt.ArrayLike | SE3 | Sequence[SE3] | IkBranches
"""(n,) or (g, n) configurations, one or several poses ``base_from_tcp``, or all IK solutions of a pose."""

# Number of pairs of bodies that a message names beside those of the solution it describes.
MOST_PAIRS = 3


@described(eq=False)
class GoalPose:
    """What is known of a pose that is a goal."""

    pose: SE3 = key("``base_from_tcp``")
    branches: Array = key(
        "(b, n) the IK solutions within the limits that are distinct modulo 2 pi, nearest to the start first"
    )
    q: Array = key("(k, n) the same with every rotation by 2 pi within the limits")
    complete: bool = key("whether the closed form proves that these are all solutions", default=False)
    outside: int = key("number of solutions that are known outside the limits", default=0)
    nearest: IkResult | None = key(
        "the configuration with the smallest errors that was found, if there is no solution", default=None
    )
    proof: ReachProof | None = key(
        "the proof that no configuration reaches the pose, if there is one; a closed form that is ``complete`` "
        "without a solution is another one",
        default=None,
    )
    invalid: tuple[InvalidEnd, ...] = key(
        "why each of the branches that were examined is not valid, if none is", default=()
    )

    @property
    def unreachable(self) -> bool:
        """Whether it is proven that no configuration within the limits reaches the pose."""
        return (self.complete and not len(self.q)) or (self.proof is not None and self.proof.proven)

    @property
    def message(self) -> str:
        """The number of solutions, and why the pose is no goal of a motion if that is known, as text."""
        count = len(self.branches)
        which = f"all {'' if self.complete else 'known '}IK solutions ({count})"
        if self.invalid:
            # The solution that is in contact least, and the pairs that the others have in contact most often
            best = least_invalid(self.invalid)
            pairs = Counter(bodies for end in self.invalid for bodies in {contact.bodies for contact in end.contacts})
            for contact in best.contacts:
                pairs.pop(contact.bodies, None)
            common = [f"{first} with {other} in {n}" for (first, other), n in pairs.most_common(MOST_PAIRS)]
            others = f" (others: {', '.join(common)})" if common else ""
            how = "in contact" if all(end.contacts for end in self.invalid) else "invalid"
            return f"{which} are {how}; the best one: {best.message}{others}"
        if count:
            return f"IK solutions: {count}"
        # Out of reach, by a proof or as far as was searched
        reason = "not reached"
        if self.proof is not None and self.proof.proven:
            reason = self.proof.message
        elif self.complete:
            reason = "proven impossible: no configuration within the limits reaches the pose"
        reason += f"; {self.outside} solutions are outside the joint limits" if self.outside else ""
        if self.nearest is not None:
            away = f"{self.nearest.position_error * 1e3:.4g} mm and {degrees(self.nearest.orientation_error):.3g} deg"
            reason += f"; the nearest configuration found is {away} from it"
        return reason

    def to_dict(self) -> dict[str, Any]:
        """The facts as plain values for JSON."""
        facts = {name: getattr(self, name) for name in ("message", "complete", "unreachable")}
        errors = {name: getattr(self.nearest, name, None) for name in ("position_error", "orientation_error")}
        return {**facts, "solutions": len(self.branches), **errors}


class Goals(NamedTuple):
    """The configurations (g, n) that are goals, for each the index of the given goal, and the given poses, if any."""

    q: Array
    of: npt.NDArray[np.int64]
    poses: tuple[GoalPose, ...]


def read_goals(checker: CollisionChecker, start: Array, goal: Goal, rng: int) -> Goals:
    """The configurations of a goal within the limits; for poses, all solutions of the closed form, else those found.

    InputError if the goal is of another kind than :data:`Goal`, or for another arm.
    """
    poses: tuple[GoalPose, ...]
    if isinstance(goal, IkBranches):
        if goal.arm.joint_names != checker.group.joint_names:
            raise InputError(f"goal has IK solutions of another arm, with the joints {goal.arm.joint_names}")
        poses = (_of_branches(goal) if goal.ok else solve_pose(checker.arm, SE3(goal.target), start, rng),)
    elif isinstance(goal, SE3):
        poses = (solve_pose(checker.arm, goal, start, rng),)
    elif isinstance(goal, (list, tuple)) and any(isinstance(each, SE3) for each in goal):
        if not all(isinstance(each, SE3) for each in goal):
            raise InputError("goal has poses and other values; give poses only, or configurations only")
        poses = tuple(solve_pose(checker.arm, each, start, rng) for each in goal)
    else:
        try:
            many = read_configurations(checker.group, goal, "goal")
        except InputError as error:
            raise InputError(f"{error}; a pose is a pin.SE3, such as pp.pose(xyz=(0.4, 0.1, 0.3))") from error
        return Goals(many, np.arange(len(many)), ())
    index = np.repeat(np.arange(len(poses)), [len(pose.q) for pose in poses])
    return Goals(np.concatenate([pose.q for pose in poses]), index, poses)


def solve_pose(arm: Arm, pose: SE3, start: Array, rng: int) -> GoalPose:
    """The IK solutions of a pose, nearest to the start (n,) first; without one, the nearest configuration found."""
    pose = rigid("goal", pose)
    known = GoalPose(pose, np.empty((0, arm.dof)), np.empty((0, arm.dof)))
    with suppress(NoClosedForm):
        known = _of_branches(AnalyticIk().solve_all(arm, pose, start))
    if not len(known.q) and not known.complete:
        q = Clik().solve_many(arm, pose, start, rng=rng).q
        known = replace(known, branches=q, q=q)
    if len(known.q):
        return known
    nearest = Clik().solve(arm, pose, start, rng=rng)
    if nearest.ok:
        return replace(known, branches=nearest.q[None], q=nearest.q[None], complete=False)
    return replace(known, nearest=nearest)


def least_invalid(ends: Sequence[InvalidEnd]) -> InvalidEnd:
    """The start, goal or IK solution whose bodies penetrate each other least."""
    return max(ends, key=lambda end: min((contact.distance for contact in end.contacts), default=inf))


def prove(arm: Arm, pose: GoalPose) -> GoalPose:
    """The pose with a proof that it is out of reach, if one is found."""
    if len(pose.q) or not is_provable(arm):
        return pose
    return replace(pose, proof=prove_unreachable(arm, pose.pose, search=False))


def _of_branches(found: IkBranches) -> GoalPose:
    return GoalPose(SE3(found.target), found.branches, found.q, found.complete, found.outside)
