"""Robot cells: where the robot is placed, in which order parts are picked, and how long the cycle takes.

:func:`pinproof.place_base` searches for the placement of the base at which all picks work, with the shortest cycle
time.
:func:`pinproof.sequence` orders picks and places so that the certified motions take the shortest total time.
:func:`pinproof.cell.allocate` distributes picks over several arms that move at the same time.
"""

from pinproof.cell.allocation.allocate import allocate
from pinproof.cell.allocation.allocation_report import (
    ALLOCATION_SUFFIXES,
    save_allocation,
    write_allocation_page,
)
from pinproof.cell.allocation.allocation_result import AllocationResult, ArmTime, OneArm, PartState
from pinproof.cell.allocation.common_clock import ArmPiece, CommonInterval, Timing
from pinproof.cell.comparison import CellComparison, PickChange, PickDifference, compare
from pinproof.cell.placement.heat_map import PlacementMap
from pinproof.cell.placement.place_base import PlacementBudget, place_base
from pinproof.cell.placement.placement_result import CertifiedPlacement, PlacementResult, PlacementSensitivity
from pinproof.cell.placement.region import Placement, PlacementChoice, PlacementRegion
from pinproof.cell.sequencing.options import without_parts
from pinproof.cell.sequencing.precedence import Precedence
from pinproof.cell.sequencing.sequence import sequence
from pinproof.cell.sequencing.sequence_page import read_heat_map, write_sequence_page
from pinproof.cell.sequencing.sequence_report import SEQUENCE_SUFFIXES, save_sequence, sequence_dict
from pinproof.cell.sequencing.sequence_result import (
    CycleTime,
    LeftOut,
    PickTime,
    SequencePhase,
    SequenceResult,
    SequenceStep,
    cycle_time,
)
from pinproof.cell.sequencing.sequence_run import SequenceBudget
from pinproof.cell.tolerance import PickTolerance, ToleranceStudy, tolerance_study

__all__ = [
    "ALLOCATION_SUFFIXES",
    "SEQUENCE_SUFFIXES",
    "AllocationResult",
    "ArmPiece",
    "ArmTime",
    "CellComparison",
    "CertifiedPlacement",
    "CommonInterval",
    "CycleTime",
    "LeftOut",
    "OneArm",
    "PartState",
    "PickChange",
    "PickDifference",
    "PickTime",
    "PickTolerance",
    "Placement",
    "PlacementBudget",
    "PlacementChoice",
    "PlacementMap",
    "PlacementRegion",
    "PlacementResult",
    "PlacementSensitivity",
    "Precedence",
    "SequenceBudget",
    "SequencePhase",
    "SequenceResult",
    "SequenceStep",
    "Timing",
    "ToleranceStudy",
    "allocate",
    "compare",
    "cycle_time",
    "place_base",
    "read_heat_map",
    "save_allocation",
    "save_sequence",
    "sequence",
    "sequence_dict",
    "tolerance_study",
    "without_parts",
    "write_allocation_page",
    "write_sequence_page",
]
