"""Benchmarks of inverse kinematics and planning: tables of figures with provenance and an independent check."""

from pinproof.benchmarks.ik_run import ik_benchmark
from pinproof.benchmarks.ik_table import IkTable, ik_markdown, write_ik_table
from pinproof.benchmarks.plan_motion import MotionTable, motion_benchmark, motion_markdown
from pinproof.benchmarks.plan_run import plan_benchmark
from pinproof.benchmarks.plan_table import PlanTable, plan_markdown, write_plan_table

__all__ = [
    "IkTable",
    "MotionTable",
    "PlanTable",
    "ik_benchmark",
    "ik_markdown",
    "motion_benchmark",
    "motion_markdown",
    "plan_benchmark",
    "plan_markdown",
    "write_ik_table",
    "write_plan_table",
]
