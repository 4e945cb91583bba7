"""Tables of figures with their provenance: what the methods do, measured, and judged apart from them."""

from pinproof.benchmarks.ik_files import write_ik_table
from pinproof.benchmarks.ik_markdown import ik_markdown, ik_summary, success_markdown
from pinproof.benchmarks.ik_run import ik_benchmark
from pinproof.benchmarks.ik_success import SuccessRow, success_rates
from pinproof.benchmarks.ik_table import IkTable

__all__ = [
    "IkTable",
    "SuccessRow",
    "ik_benchmark",
    "ik_markdown",
    "ik_summary",
    "success_markdown",
    "success_rates",
    "write_ik_table",
]
