"""Inverse kinematics: which joint configuration brings the tcp to a target. One file a method, one loop for all."""

from pinproof.ik.clik import Clik
from pinproof.ik.loop import IkStep, StepRule
from pinproof.ik.result import IkBatch, IkResult, IkSolutions, IkStatus
from pinproof.ik.solver import IterativeIk

__all__ = ["Clik", "IkBatch", "IkResult", "IkSolutions", "IkStatus", "IkStep", "IterativeIk", "StepRule"]
