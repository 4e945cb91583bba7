"""Long work: executors and their processes, a journal of finished rows, stages that can be interrupted and resumed."""

from __future__ import annotations

from pinproof.work.executors import IN_FLIGHT, LocalWorkers, Outcome, Workers, do_chunks
from pinproof.work.journal import JOURNAL, Checksums, Journal, ranges_missing, refuse_foreign, to_line
from pinproof.work.runner import Progress, Runner

__all__ = [
    "IN_FLIGHT",
    "JOURNAL",
    "Checksums",
    "Journal",
    "LocalWorkers",
    "Outcome",
    "Progress",
    "Runner",
    "Workers",
    "do_chunks",
    "ranges_missing",
    "refuse_foreign",
    "to_line",
]
