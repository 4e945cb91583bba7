"""Robot cells: where the robot is placed, in which order parts are picked, and how long the cycle takes.

:func:`pinproof.sequence` orders picks and places so that the certified motions take the shortest total time.
"""

from pinproof.cell.cycle_time import CycleTime, PickTime, cycle_time
from pinproof.cell.precedence import Precedence
from pinproof.cell.sequence_page import read_heat_map, write_sequence_page
from pinproof.cell.sequence_report import SEQUENCE_SUFFIXES, save_sequence, sequence_dict
from pinproof.cell.sequence_result import LeftOut, Phase, SequenceResult, SequenceStep
from pinproof.cell.sequencing import SequenceInterrupted, sequence

__all__ = [
    "SEQUENCE_SUFFIXES",
    "CycleTime",
    "LeftOut",
    "Phase",
    "PickTime",
    "Precedence",
    "SequenceInterrupted",
    "SequenceResult",
    "SequenceStep",
    "cycle_time",
    "read_heat_map",
    "save_sequence",
    "sequence",
    "sequence_dict",
    "write_sequence_page",
]
