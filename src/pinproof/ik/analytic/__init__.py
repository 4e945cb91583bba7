"""Closed-form inverse kinematics: every branch, from the chain itself."""

from pinproof.ik.analytic.branches import IkBranches, IkBranchesBatch
from pinproof.ik.analytic.family import IkFamily
from pinproof.ik.analytic.solver import AnalyticIk
from pinproof.ik.analytic.sweep import Interval

__all__ = ["AnalyticIk", "IkBranches", "IkBranchesBatch", "IkFamily", "Interval"]
