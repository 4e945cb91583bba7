"""Inverse kinematics (IK): joint configurations that bring the tcp to a target, and tracking of pose sequences."""

from pinproof.common import faces
from pinproof.ik.analytic_branches import IkBranches as IkBranches, IkBranchesBatch as IkBranchesBatch
from pinproof.ik.analytic_ik import AnalyticIk as AnalyticIk
from pinproof.ik.analytic_self_motion import (
    CurveEnd as CurveEnd, IkFamily as IkFamily, SelfMotion as SelfMotion, SelfMotionCurve as SelfMotionCurve,
)  # fmt: skip
from pinproof.ik.fabrik import Fabrik as Fabrik
from pinproof.ik.iterative import IterativeIk as IterativeIk
from pinproof.ik.jacobian_methods import (
    Clik as Clik, DampedLeastSquares as DampedLeastSquares, PseudoInverse as PseudoInverse,
)  # fmt: skip
from pinproof.ik.loop import (
    DescentState as DescentState, IkStep as IkStep, ObservingRule as ObservingRule, StepRule as StepRule,
)  # fmt: skip
from pinproof.ik.methods import IK_METHODS as IK_METHODS, bench as bench, make_ik as make_ik
from pinproof.ik.reach_check import BodyOverlap as BodyOverlap
from pinproof.ik.reach_proof import (
    ReachProof as ReachProof, ReachStatus as ReachStatus, is_provable as is_provable,
    prove_unreachable as prove_unreachable,
)  # fmt: skip
from pinproof.ik.result import (
    NEAR_LIMIT as NEAR_LIMIT, IkBatch as IkBatch, IkResult as IkResult, IkSolutions as IkSolutions,
    IkStatus as IkStatus,
)  # fmt: skip
from pinproof.ik.task import (
    Cost as Cost, GoalLike as GoalLike, IkGoal as IkGoal, IkTask as IkTask, TaskName as TaskName, look_at as look_at,
    make_task as make_task, orientation_tolerance_of as orientation_tolerance_of, posture as posture,
)  # fmt: skip
from pinproof.ik.tracking import Tracker as Tracker, TrackResult as TrackResult, track as track
from pinproof.ik.arm_of_page import web_arm as web_arm

__all__ = faces.exported(globals())
