"""How picks are judged: what the best whole pick is, and how much work is spent on each.

No budget is a time: work is the same on every machine, and so is the verdict.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from pinproof.common.validation import require_integer
from pinproof.errors import InputError

__all__ = ["GripLimits", "PickBudget", "PickWeights"]


@dataclass(frozen=True, kw_only=True)
class PickWeights:
    """How much each part counts where good picks are compared; each part is from 0 to 1.

    Parameters
    ----------
    clearance
        The least clearance seen on the way, 1 from 50 mm on.
    limit_margin
        How far the joints stay from their limits, 1 in the middle of every range.
    manipulability
        Yoshikawa's measure at the grasp, 1 for the best of the configurations.
    duration
        The share of the time at full speed that no pick from any of the configurations can undercut; 1 at best.
    """

    clearance: float = 1.0
    limit_margin: float = 1.0
    manipulability: float = 1.0
    duration: float = 1.0

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not 0 <= value < float("inf"):
                raise InputError(f"PickWeights.{each.name} = {value}; it is a finite number, 0 or more")


@dataclass(frozen=True, kw_only=True)
class PickBudget:
    """How much is tried for one pick.

    Parameters
    ----------
    configurations
        Of the configurations that are free at the grasp, how many are taken on, those with the highest bounds first:
        more than any arm with a closed form has for one grasp.
    compared
        How many whole picks are made at most, of which the best is returned. Fewer are made where bounds of the scores
        of the others tell that none is better.
    quick_nodes
        Nodes of the trees that look for a transit to one configuration.
    nodes
        Nodes of those that look for one to any, where no quick one was found.
    remedies
        Changed picks of each kind (moved, turned, shortened) that are judged for a suggestion; 0 for no suggestions.
    """

    configurations: int = 32
    compared: int = 16
    quick_nodes: int = 300
    nodes: int = 4000
    remedies: int = 12

    def __post_init__(self) -> None:
        for each in fields(self):
            require_integer(f"PickBudget.{each.name}", getattr(self, each.name), 0 if each.name == "remedies" else 1)


@dataclass(frozen=True, kw_only=True)
class GripLimits:
    """What counts as holding a part.

    Parameters
    ----------
    area
        m^2 that each finger must touch at least: 2 x 2 mm by default, less than which is a corner or an edge.
    overlap
        Metres that each contact must extend along the finger at least.
    angle
        rad: the largest angle between a contact normal and the closing direction, and the half angle of the friction
        cones. The default is the arc tangent of 0.5, the coefficient of friction of rubber on dry metal at its lowest.
    gap, depth
        Metres that a closed finger may stay from the part, or be pressed into it: what is measured or taught is off by
        that much, and rubber pads and the part's own play make up for it.
    compliance
        Metres by which pads and part give way: surfaces that are no farther apart where a finger touches first belong
        to the contact patch. 0.2 mm is little for a rubber pad; with it, round parts touch over an area, not in a line.
    tip
        Metres that the tip of a tool without fingers may be from the part's surface.
    """

    area: float = 4e-6
    overlap: float = 2e-3
    angle: float = math.atan(0.5)
    gap: float = 1e-3
    depth: float = 1e-3
    compliance: float = 2e-4
    tip: float = 5e-3

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not (isinstance(value, int | float) and 0 <= value < float("inf")):
                raise InputError(f"GripLimits.{each.name} = {value!r}; it is a finite number, 0 or more")
        if self.compliance == 0:
            raise InputError("GripLimits.compliance = 0; it is above 0, else round parts touch over no area")
        if not self.angle < math.pi / 2:
            raise InputError(f"GripLimits.angle = {self.angle}; it is below pi/2")
