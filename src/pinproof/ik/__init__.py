"""Inverse kinematics (IK): joint configurations that bring the tcp to a target, and tracking of pose sequences."""

from pinproof.ik.analytic_branches import IkBranches, IkBranchesBatch
from pinproof.ik.analytic_ik import AnalyticIk
from pinproof.ik.analytic_self_motion import CurveEnd, IkFamily, SelfMotion, SelfMotionCurve
from pinproof.ik.fabrik import Fabrik
from pinproof.ik.iterative import IterativeIk
from pinproof.ik.jacobian_methods import Clik, DampedLeastSquares, PseudoInverse
from pinproof.ik.loop import DescentState, IkStep, ObservingRule, StepRule
from pinproof.ik.methods import IK_METHODS, bench, make_ik
from pinproof.ik.reach_check import BodyOverlap
from pinproof.ik.reach_proof import ReachProof, ReachStatus, is_provable, prove_unreachable
from pinproof.ik.result import NEAR_LIMIT, IkBatch, IkResult, IkSolutions, IkStatus
from pinproof.ik.task import Cost, GoalLike, IkGoal, IkTask, TaskName, look_at, make_task, posture
from pinproof.ik.tracking import Tracker, TrackResult, track

__all__ = [
    "IK_METHODS",
    "NEAR_LIMIT",
    "AnalyticIk",
    "BodyOverlap",
    "Clik",
    "Cost",
    "CurveEnd",
    "DampedLeastSquares",
    "DescentState",
    "Fabrik",
    "GoalLike",
    "IkBatch",
    "IkBranches",
    "IkBranchesBatch",
    "IkFamily",
    "IkGoal",
    "IkResult",
    "IkSolutions",
    "IkStatus",
    "IkStep",
    "IkTask",
    "IterativeIk",
    "ObservingRule",
    "PseudoInverse",
    "ReachProof",
    "ReachStatus",
    "SelfMotion",
    "SelfMotionCurve",
    "StepRule",
    "TaskName",
    "TrackResult",
    "Tracker",
    "bench",
    "is_provable",
    "look_at",
    "make_ik",
    "make_task",
    "posture",
    "prove_unreachable",
    "track",
]
