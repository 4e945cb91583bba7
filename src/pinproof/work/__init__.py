"""Long work: executors and their processes, a journal of finished rows, stages that can be interrupted and resumed."""

from pinproof.common import faces
from pinproof.work.executors import (
    IN_FLIGHT as IN_FLIGHT, LocalWorkers as LocalWorkers, Outcome as Outcome, Workers as Workers,
    do_chunks as do_chunks,
)  # fmt: skip
from pinproof.work.journal import (
    JOURNAL as JOURNAL, Checksums as Checksums, Journal as Journal, ranges_missing as ranges_missing,
    refuse_foreign as refuse_foreign, to_line as to_line,
)  # fmt: skip
from pinproof.work.runner import Progress as Progress, Runner as Runner

__all__ = faces.exported(globals())
