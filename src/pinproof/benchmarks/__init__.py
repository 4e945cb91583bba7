"""Tables of figures with their provenance: what the methods do, measured, and judged apart from them."""

from pinproof.benchmarks.collision_files import write_collision_table
from pinproof.benchmarks.collision_markdown import collision_markdown
from pinproof.benchmarks.collision_run import collision_benchmark
from pinproof.benchmarks.collision_table import CollisionTable
from pinproof.benchmarks.ik_files import write_ik_table
from pinproof.benchmarks.ik_markdown import ik_markdown, success_markdown
from pinproof.benchmarks.ik_run import ik_benchmark
from pinproof.benchmarks.ik_success import SuccessRow, success_rates
from pinproof.benchmarks.ik_table import IkTable
from pinproof.benchmarks.picks_markdown import picks_markdown, write_picks_table
from pinproof.benchmarks.picks_run import picks_benchmark
from pinproof.benchmarks.picks_table import PicksTable
from pinproof.benchmarks.plan_files import write_plan_table
from pinproof.benchmarks.plan_markdown import plan_markdown
from pinproof.benchmarks.plan_run import plan_benchmark
from pinproof.benchmarks.plan_table import PlanTable

__all__ = [
    "CollisionTable",
    "IkTable",
    "PicksTable",
    "PlanTable",
    "SuccessRow",
    "collision_benchmark",
    "collision_markdown",
    "ik_benchmark",
    "ik_markdown",
    "picks_benchmark",
    "picks_markdown",
    "plan_benchmark",
    "plan_markdown",
    "success_markdown",
    "success_rates",
    "write_collision_table",
    "write_ik_table",
    "write_picks_table",
    "write_plan_table",
]
