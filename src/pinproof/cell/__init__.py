"""Robot cells: where the robot is placed, in which order parts are picked, and how long the cycle takes.

:func:`pinproof.place_base` searches for the placement of the base at which all picks work, with the shortest cycle
time.
:func:`pinproof.sequence` orders picks and places so that the certified motions take the shortest total time.
:func:`pinproof.cell.new_cell` writes the scene and the picks of a cell for a robot and meshes of parts.
:func:`pinproof.cell.allocate` distributes picks over several arms that move at the same time.
"""

from pinproof.cell.allocation.allocate import allocate as allocate
from pinproof.cell.allocation.allocation_result import (
    AllocationResult as AllocationResult, ArmTime as ArmTime, OneArm as OneArm, PartState as PartState,
)  # fmt: skip
from pinproof.cell.allocation.common_clock import (
    ArmPiece as ArmPiece, CommonInterval as CommonInterval, Timing as Timing,
)  # fmt: skip
from pinproof.cell.comparison import (
    CellComparison as CellComparison, PickChange as PickChange, PickDifference as PickDifference, compare as compare,
)  # fmt: skip
from pinproof.cell.pages import read_heat_map as read_heat_map
from pinproof.cell.placement.placed_work import PlacedWork as PlacedWork
from pinproof.cell.placement.place_base import PlacementBudget as PlacementBudget, place_base as place_base
from pinproof.cell.placement.placement_result import (
    CertifiedPlacement as CertifiedPlacement, PlacementMap as PlacementMap, PlacementResult as PlacementResult,
    PlacementSensitivity as PlacementSensitivity,
)  # fmt: skip
from pinproof.cell.placement.region import (
    Placement as Placement, PlacementChoice as PlacementChoice, PlacementRegion as PlacementRegion,
)  # fmt: skip
from pinproof.cell.placement.screening import GraspTable as GraspTable
from pinproof.cell.sequencing.options import without_parts as without_parts
from pinproof.cell.sequencing.precedence import Precedence as Precedence
from pinproof.cell.sequencing.sequence import SequenceBudget as SequenceBudget, sequence as sequence
from pinproof.cell.sequencing.sequence_result import (
    LeftOut as LeftOut, SequencePhase as SequencePhase, SequenceResult as SequenceResult, SequenceStep as SequenceStep,
)  # fmt: skip
from pinproof.cell.sequencing.tour import Tour as Tour, TourProblem as TourProblem
from pinproof.cell.sequencing.windings import CableTwist as CableTwist
from pinproof.cell.starting.new_cell import NewCell as NewCell, new_cell as new_cell
from pinproof.cell.tolerance import (
    PickTolerance as PickTolerance, ToleranceStudy as ToleranceStudy, tolerance_study as tolerance_study,
)  # fmt: skip
from pinproof.common import faces

__all__ = faces.exported(globals())
