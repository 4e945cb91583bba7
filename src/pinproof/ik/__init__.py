"""Inverse kinematics: which joint configuration brings the tcp to a target. One file a method, one loop for all."""

from pinproof.ik.analytic import AnalyticIk, IkBranches, IkBranchesBatch, IkFamily
from pinproof.ik.clik import Clik
from pinproof.ik.damped_least_squares import DampedLeastSquares
from pinproof.ik.fabrik import Fabrik
from pinproof.ik.loop import Here, IkStep, StepRule
from pinproof.ik.pseudo_inverse import PseudoInverse
from pinproof.ik.result import IkBatch, IkResult, IkSolutions, IkStatus
from pinproof.ik.solver import IterativeIk
from pinproof.ik.task import IkGoal, IkTask
from pinproof.ik.tracking import Tracker, TrackResult, track

__all__ = [
    "AnalyticIk",
    "Clik",
    "DampedLeastSquares",
    "Fabrik",
    "Here",
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
    "PseudoInverse",
    "StepRule",
    "TrackResult",
    "Tracker",
    "track",
]
