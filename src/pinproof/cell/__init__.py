"""Robot cells: where the robot is placed, in which order parts are picked, and how long the cycle takes.

:func:`pinproof.sequence` orders picks and places so that the certified motions take the shortest total time.
"""

from pinproof.cell.precedence import Precedence
from pinproof.cell.sequencing import sequence

__all__ = ["Precedence", "sequence"]
