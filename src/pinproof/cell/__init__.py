"""Robot cells: where the robot is placed, in which order parts are picked, and how long the cycle takes.

:func:`pinproof.place_base` searches for the placement of the base at which all picks work, with the shortest cycle
time.
:func:`pinproof.sequence` orders picks and places so that the certified motions take the shortest total time.
:func:`pinproof.cell.allocate` distributes picks over several arms that move at the same time.
"""

from pinproof.cell.allocation.allocate import allocate
from pinproof.cell.allocation.allocation_result import (
    AllocationResult,
    ArmTime,
    OneArm,
    PartState,
)
from pinproof.cell.allocation.common_clock import ArmPiece, CommonInterval, Timing
from pinproof.cell.comparison import CellComparison, PickChange, PickDifference, compare
from pinproof.cell.pages import read_heat_map
from pinproof.cell.placement.place_base import PlacementBudget, place_base
from pinproof.cell.placement.placement_result import (
    CertifiedPlacement,
    PlacementMap,
    PlacementResult,
    PlacementSensitivity,
)
from pinproof.cell.placement.region import Placement, PlacementChoice, PlacementRegion
from pinproof.cell.sequencing.options import without_parts
from pinproof.cell.sequencing.precedence import Precedence
from pinproof.cell.sequencing.sequence import SequenceBudget, sequence
from pinproof.cell.sequencing.sequence_result import (
    LeftOut,
    SequencePhase,
    SequenceResult,
    SequenceStep,
)
from pinproof.cell.tolerance import PickTolerance, ToleranceStudy, tolerance_study

__all__ = [
    "AllocationResult",
    "ArmPiece",
    "ArmTime",
    "CellComparison",
    "CertifiedPlacement",
    "CommonInterval",
    "LeftOut",
    "OneArm",
    "PartState",
    "PickChange",
    "PickDifference",
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
    "place_base",
    "read_heat_map",
    "sequence",
    "tolerance_study",
    "without_parts",
]
