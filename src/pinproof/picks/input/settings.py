"""Settings of the judgement: the weights of the score, the budget of the search, and the limits of a grip.

Budgets count work instead of seconds, so that the verdict is the same on every machine.
"""

from __future__ import annotations

import math

from pinproof.common.structs import key, struct
from pinproof.planning import DEFAULT_PLANNER, make_planner


@struct(kw_only=True)
class PickWeights:
    """Weights of the four parts of the score, each from 0 to 1, by which motions of a pick are compared."""

    clearance: float = key(
        "the smallest clearance observed on the motion; 50 mm or more score 1", default=1.0, minimum=0
    )
    limit_margin: float = key(
        "the smallest distance of a joint from its limits; the middle of every range scores 1", default=1.0, minimum=0
    )
    manipulability: float = key(
        "Yoshikawa's measure at the grasp, relative to the best configuration", default=1.0, minimum=0
    )
    duration: float = key(
        "the lower bound of the time over all configurations, divided by the time at full speed. Its default weight is "
        "that of the other three together, because every motion keeps the margin and the limits anyway",
        default=3.0,
        minimum=0,
    )


@struct(kw_only=True)
class PickBudget:
    """The search budget of one pick.

    Raises
    ------
    InputError
        If a number is too small, the planner is unknown or its library is not installed.
    """

    configurations: int = key(
        "largest number of collision-free configurations at the grasp that are planned, those with the highest bounds "
        "first. The default exceeds the number of IK solutions of any arm with a closed form for one grasp",
        default=32,
        minimum=1,
    )
    compared: int = key(
        "largest number of complete motions, of which the best is returned. Fewer are planned if the bounds of the "
        "other candidates show that none of them is better",
        default=16,
        minimum=1,
    )
    quick_nodes: int = key("nodes of the RRT for a transit to one configuration", default=300, minimum=1)
    nodes: int = key(
        "nodes of the RRT for a transit to any configuration, used if no quick one was found", default=4000, minimum=1
    )
    remedies: int = key(
        "number of changed picks of each kind (moved, turned, shortened) that are judged to find suggestions; 0 for "
        "none",
        default=12,
        minimum=0,
    )
    planner: str = key(
        "the planner of transits and transfers, as :func:`pinproof.planning.make_planner` names it",
        default=DEFAULT_PLANNER,
    )
    motion: int = key(
        "number of evaluations by which :func:`~pinproof.optimise` shortens each transit and each transfer; with 0, "
        "they follow the planned paths",
        default=100,
        minimum=0,
    )

    def __post_init__(self) -> None:
        make_planner(self.planner)


@struct("grip_limits", kw_only=True)
class GripLimits:
    """The criteria for holding an object."""

    area: float = key(
        "smallest contact area of each finger; the default is 2 x 2 mm, because less is contact at a corner or an edge",
        "m²",
        default=4e-6,
        minimum=0,
    )
    overlap: float = key("smallest extent of each contact along the finger", "m", default=2e-3, minimum=0)
    angle: float = key(
        "largest angle between a contact normal and the closing direction, and half angle of the friction cones. The "
        "default is the arc tangent of 0.5, the coefficient of friction of rubber on dry metal at its lowest",
        "rad",
        default=math.atan(0.5),
        minimum=0,
        below=math.pi / 2,
    )
    gap: float = key(
        "largest distance of a closed finger from the object; it allows for measurement errors, which soft pads and "
        "play of the object compensate",
        "m",
        default=1e-3,
        minimum=0,
    )
    depth: float = key(
        "largest depth of any body of the hand in the object, at the grasp and on the lines, for the same reason: the "
        "length of the shortest displacement after which the body is outside of the object",
        "m",
        default=1e-3,
        minimum=0,
    )
    compliance: float = key(
        "compliance of pads and object, above 0: surfaces within this distance at first contact belong to the contact "
        "patch, so that round objects have an area of contact instead of a line. The default is small for a rubber pad",
        "m",
        default=2e-4,
        above=0,
    )
    tip: float = key(
        "largest distance of the tip of a tool without fingers from the surface of the object; behind the surface that "
        "it meets first on the approach, the distance from there",
        "m",
        default=5e-3,
        minimum=0,
    )
