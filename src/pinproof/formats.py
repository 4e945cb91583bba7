"""The formats of pinproof's files: each with the keys that its reader accepts, as a JSON Schema.

The schemas (draft 2020-12) are for editors, which complete keys and mark errors, and for other programs. The readers
check more, such as the names of frames.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from pinproof.errors import UnknownNameError

__all__ = ["FORMATS", "file_schema"]

FORMATS = {
    "scene": ("pinproof.collision.scene", "Scene"),
    "picks": ("pinproof.picks.input.sources", "PICKS"),
    "tool": ("pinproof.picks.input.tools", "Tool"),
    "tool_paths": ("pinproof.tool_paths.files", "JOB"),
    "attached": ("pinproof.collision.scene", "Attachments"),
    "dh": ("pinproof.description.dh", "DhTable"),
    "limits": ("pinproof.model.limits", "FILE"),
    "motion": ("pinproof.motion.trajectory_files", "MOTION"),
    "library": ("pinproof.execution.motion_library", "LIBRARY"),
    "program": ("pinproof.motion.motion_program", "PROGRAM"),
    "report": ("pinproof.picks.report.report", "PickReport"),
    "sequence": ("pinproof.cell.sequencing.sequence_result", "SequenceResult"),
    "allocation": ("pinproof.cell.allocation.allocation_result", "AllocationResult"),
    "proof": ("pinproof.collision.certificates.proof_file", "PROOF"),
    "placement": ("pinproof.cell.placement.placement_result", "PlacementResult"),
    "comparison": ("pinproof.cell.comparison", "CellComparison"),
    "tolerance": ("pinproof.cell.tolerance", "ToleranceStudy"),
}
"""Module and name of the struct, or the table of keys, of each format."""


def file_schema(name: str) -> dict[str, Any]:
    """Return the JSON Schema of a format of files: one of :data:`FORMATS`, such as ``"picks"``.

    Raises
    ------
    UnknownNameError
        If there is no format of this name.
    """
    if name not in FORMATS:
        raise UnknownNameError("file format", name, FORMATS)
    from pinproof.common.structs import Table, json_schema, table_of  # loads the kinematics, which no help needs

    module, table = FORMATS[name]
    found = getattr(import_module(module), table)
    return json_schema(found if isinstance(found, Table) else table_of(found))
