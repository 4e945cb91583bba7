"""Closed-form inverse kinematics: all IK branches, derived from the geometry of the chain."""

from pinproof.ik.analytic.analytic_ik import AnalyticIk
from pinproof.ik.analytic.branches import IkBranches, IkBranchesBatch, Interval
from pinproof.ik.analytic.family import IkFamily
from pinproof.ik.analytic.self_motion import CurveEnd, SelfMotion, SelfMotionCurve

__all__ = [
    "AnalyticIk",
    "CurveEnd",
    "IkBranches",
    "IkBranchesBatch",
    "IkFamily",
    "Interval",
    "SelfMotion",
    "SelfMotionCurve",
]
