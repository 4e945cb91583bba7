"""Robot cells: where the robot is placed, in which order parts are picked, and how long the cycle takes.

:func:`pinproof.place_base` searches for the placement of the base at which all picks work, with the shortest cycle
time.
:func:`pinproof.sequence` orders picks and places so that the certified motions take the shortest total time.
"""

from pinproof.cell.comparison import CellComparison, PickChange, PickDifference, compare
from pinproof.cell.placement import OBJECTIVES, PlacementBudget, PlacementInterrupted, place_base
from pinproof.cell.placement_region import Placement, PlacementChoice, PlacementRegion
from pinproof.cell.placement_result import (
    CertifiedPlacement,
    EmptyCell,
    PlacementMap,
    PlacementResult,
    PlacementSensitivity,
)
from pinproof.cell.precedence import Precedence
from pinproof.cell.sequencing import sequence
from pinproof.cell.tolerance import PickTolerance, ToleranceStudy, tolerance_study

__all__ = [
    "OBJECTIVES",
    "CellComparison",
    "CertifiedPlacement",
    "EmptyCell",
    "PickChange",
    "PickDifference",
    "PickTolerance",
    "Placement",
    "PlacementBudget",
    "PlacementChoice",
    "PlacementInterrupted",
    "PlacementMap",
    "PlacementRegion",
    "PlacementResult",
    "PlacementSensitivity",
    "Precedence",
    "ToleranceStudy",
    "compare",
    "place_base",
    "sequence",
    "tolerance_study",
]
