"""How picks are judged: what the best whole pick is, and how much work is spent on each.

No budget is a time: work is the same on every machine, and so is the verdict.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

from pinproof.errors import InputError
from pinproof.ik.settings import whole

__all__ = ["PickBudget", "PickWeights"]


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
            whole(f"PickBudget.{each.name}", getattr(self, each.name), 0 if each.name == "remedies" else 1)
