"""Settings of the judgement: the weights of the score, the budget of the search, and the limits of a grip.

Budgets count work instead of seconds, so that the verdict is the same on every machine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from pinproof.common.validation import require_integer, require_positive
from pinproof.planning import DEFAULT_PLANNER, make_planner


@dataclass(frozen=True, kw_only=True)
class PickWeights:
    """Weights of the four parts of the score, each from 0 to 1, by which motions of a pick are compared.

    Parameters
    ----------
    clearance
        The smallest clearance observed on the motion; 50 mm or more score 1.
    limit_margin
        The smallest distance of a joint from its limits; the middle of every range scores 1.
    manipulability
        Yoshikawa's measure at the grasp, relative to the best configuration.
    duration
        The lower bound of the time over all configurations, divided by the time at full speed. Its default weight is
        that of the other three together, because every motion keeps the margin and the limits anyway.
    """

    clearance: float = 1.0
    limit_margin: float = 1.0
    manipulability: float = 1.0
    duration: float = 3.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            require_positive(f"PickWeights.{name}", value, zero=True)


@dataclass(frozen=True, kw_only=True)
class PickBudget:
    """The search budget of one pick.

    Parameters
    ----------
    configurations
        Largest number of collision-free configurations at the grasp that are planned, those with the highest bounds
        first. The default exceeds the number of IK solutions of any arm with a closed form for one grasp.
    compared
        Largest number of complete motions, of which the best is returned. Fewer are planned if the bounds of the other
        candidates show that none of them is better.
    quick_nodes
        Nodes of the RRT for a transit to one configuration.
    nodes
        Nodes of the RRT for a transit to any configuration, used if no quick one was found.
    remedies
        Number of changed picks of each kind (moved, turned, shortened) that are judged to find suggestions; 0 for none.
    planner
        The planner of transits and transfers, as :func:`pinproof.planning.make_planner` names it.
    motion
        Number of evaluations by which :func:`~pinproof.optimise` shortens each transit and each transfer; with 0, they
        follow the planned paths.

    Raises
    ------
    InputError
        If a number is too small, the planner is unknown or its library is not installed.
    """

    configurations: int = 32
    compared: int = 16
    quick_nodes: int = 300
    nodes: int = 4000
    remedies: int = 12
    planner: str = DEFAULT_PLANNER
    motion: int = 100

    def __post_init__(self) -> None:
        for name in ("configurations", "compared", "quick_nodes", "nodes", "remedies", "motion"):
            require_integer(f"PickBudget.{name}", getattr(self, name), 0 if name in ("remedies", "motion") else 1)
        make_planner(self.planner)


@dataclass(frozen=True, kw_only=True)
class GripLimits:
    """The criteria for holding a part.

    Parameters
    ----------
    area
        m^2: smallest contact area of each finger. The default is 2 x 2 mm; less is contact at a corner or an edge.
    overlap
        Metres: smallest extent of each contact along the finger.
    angle
        rad: the largest angle between a contact normal and the closing direction, and the half angle of the friction
        cones. The default is the arc tangent of 0.5, the coefficient of friction of rubber on dry metal at its lowest.
    gap, depth
        Metres: largest distance of a closed finger from the part, and largest penetration. They allow for measurement
        errors, which soft pads and play of the part compensate.
    compliance
        Metres: compliance of pads and part. Surfaces within this distance at first contact belong to the contact patch,
        so that round parts have an area of contact instead of a line. 0.2 mm is small for a rubber pad.
    tip
        Metres: largest distance of the tip of a tool without fingers from the surface of the part.
    """

    area: float = 4e-6
    overlap: float = 2e-3
    angle: float = math.atan(0.5)
    gap: float = 1e-3
    depth: float = 1e-3
    compliance: float = 2e-4
    tip: float = 5e-3

    def __post_init__(self) -> None:
        for name, value in vars(self).items():  # without compliance, round parts have no contact area
            most = math.pi / 2 if name == "angle" else math.inf
            require_positive(f"GripLimits.{name}", value, zero=name != "compliance", below=most)
