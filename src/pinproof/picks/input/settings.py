"""The settings that picks share: conveyor, hand, limits of a grip, weights and budget of the search, and programs.

Budgets count work instead of seconds, so that the verdict is the same on every machine.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from pinproof.collision import Mesh, Mover, Obstacle
from pinproof.common.structs import TEXT, Accepting, Direction, Kind, Rule, key, list_of, simple, struct, table_of
from pinproof.common.validation import unique_names
from pinproof.description import COLOURED_SUFFIXES
from pinproof.planning import DEFAULT_PLANNER, Planner, planner_of
from pinproof.spatial import SE3

CONVEYOR = "conveyor"
"""The name of the mover."""


@struct("conveyor")
class Conveyor:
    """A belt of constant speed, with the obstacles on it.

    A pick whose ``object`` is one of ``parts`` is judged on the moving belt; its pose, and those of the parts in the
    scene file, are at time 0.
    """

    speed: float = key("speed of the belt, above 0", "m/s", above=0)
    parts: Accepting[tuple[str, ...], Iterable[str]] = key(
        "the obstacles that move", kind=simple(list_of(TEXT, 1).schema, unique_names)
    )
    direction: Direction = key(
        "direction of the motion in the frame of the root link; it is normalised", default=(1.0, 0.0, 0.0)
    )
    dwell: float = key("time for which the tool follows the part while the gripper closes", "s", default=0.2, minimum=0)
    duration: float = key("time for which the belt runs from time 0; picks must end before", "s", default=60.0, above=0)
    tolerance: float = key(
        "how far a part may be ahead or behind on the belt; the certificates include it", "m", default=0.0, minimum=0
    )

    def __post_init__(self) -> None:
        self.mover(self.parts)  # refuses too long a travel

    def travel(self, time: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """(3,) the displacement (m) of the parts at a time (s)."""
        return self.speed * time * np.array(self.direction)

    def mover(self, parts: Collection[str]) -> Mover:
        """The motion of some of the parts."""
        names = [name for name in self.parts if name in parts]
        return Mover.constant(CONVEYOR, names, self.speed, self.duration, axis=self.direction, tolerance=self.tolerance)


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
    quick_nodes: int = key(
        "nodes of the RRT for a transit to one configuration, and for a transfer that must be better than a known one",
        default=300,
        minimum=1,
    )
    nodes: int = key(
        "nodes of the RRT for a transit to any configuration, used if no quick one was found", default=4000, minimum=1
    )
    remedies: int = key(
        "number of changed picks of each kind (moved, turned, shortened) that are judged to find suggestions; 0 for "
        "none",
        default=12,
        minimum=0,
    )
    planner: str | Planner = key(
        "the planner of transits and transfers, as for :func:`pinproof.planning.planner_of`: a name, or an object with "
        "the method ``plan``, which for workers in other processes can be pickled",
        default=DEFAULT_PLANNER,
        kind=simple(TEXT.schema, lambda _, planner: planner),
    )
    motion: int = key(
        "number of evaluations by which :func:`~pinproof.optimise` shortens each transit and each transfer; with 0, "
        "they follow the planned paths",
        default=100,
        minimum=0,
    )

    def __post_init__(self) -> None:
        planner_of(self.planner)


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
    force: float | None = key(
        "force with which each finger presses on the object; with the mass of the object, it is then judged whether "
        "the grip [holds in motion](../holding.md)",
        "N",
        default=None,
        above=0,
    )
    force_limit: float | None = key(
        "largest force of a finger that the object withstands; a larger `force` fails the grip",
        "N",
        default=None,
        above=0,
    )
    friction: float | None = key(
        "coefficient of friction between the hand and the object; by default the tangent of `angle`",
        default=None,
        above=0,
    )
    hold: bool = key(
        "whether picks must be judged for holding in motion: missing data (mass, force) is then an error instead of a "
        "note",
        default=False,
    )


TOOL_GREY = (0.30, 0.32, 0.36, 1.0)
"""The colour of tools and fingers without ``rgba``, so that they differ from obstacles in pictures."""


def bodies(least: int = 0, most: int | None = None) -> Kind:
    """Bodies with different names; in a file, they are grey if neither they nor their mesh state a colour."""
    obstacles = list_of(table_of(Obstacle), least, most, named="body")

    def parse(name: str, stated: object, path: Path) -> list[Obstacle]:
        found: list[Obstacle] = []
        for body in obstacles.parse(name, stated, path):
            coloured = isinstance(body.shape, Mesh) and str(body.shape.path).lower().endswith(COLOURED_SUFFIXES)
            found.append(body if body.rgba or coloured else replace(body, rgba=TOOL_GREY))
        return found

    return Kind(obstacles.schema, obstacles.check, parse)


@struct(
    "fingers",
    first=("opening", "grip", "axis"),
    rules=[
        Rule(
            ("grip", "opening"),
            lambda fingers: (
                f"open to {fingers.opening} m and grip at {fingers.grip} m; required: 0 <= grip <= opening"
                if fingers.grip is not None and fingers.grip > fingers.opening
                else ""
            ),
        )
    ],
    eq=False,
)
class GripperFingers:
    """Two fingers of a parallel gripper that are not part of the robot."""

    bodies: tuple[Obstacle, Obstacle] = key("the two fingers, fully closed; poses are tcp_from_body", kind=bodies(2, 2))
    opening: float = key("distance between their faces before the grasp", "m", minimum=0)
    grip: float | None = key(
        "distance between their faces on the object, at most `opening`; by default the fingers close until both touch "
        "the object",
        "m",
        default=None,
        minimum=0,
    )
    axis: Direction = key(
        "opening direction of the first finger, in the tcp frame; the second moves in the opposite direction",
        default=(0.0, 1.0, 0.0),
    )

    def apart(self) -> tuple[Obstacle, Obstacle]:
        """The open fingers, before the grasp."""
        return self._at(self.opening)

    def gripping(self) -> tuple[Obstacle, Obstacle]:
        """The fingers on the object; completely closed if it is not stated where they grip."""
        return self._at(self.grip or 0.0)

    def _at(self, gap: float) -> tuple[Obstacle, Obstacle]:
        aside = SE3(np.eye(3), gap / 2 * np.array(self.axis))
        first, second = self.bodies
        return replace(first, pose=aside * first.pose), replace(second, pose=aside.inverse() * second.pose)


@struct("cup", kw_only=True)
class SuctionCup:
    """The face of a suction cup: a disc centred at the tip, which faces along the z axis of the tip."""

    radius: float = key("radius of the face, above 0", "m", above=0)
    gap: float = key(
        "largest distance of any point of the rim from the surface of the object along the axis, in front of the face "
        "or behind it; the default suits a flat cup, and bellows allow more",
        "m",
        default=1e-3,
        above=0,
    )
    tilt: float = key(
        "largest angle between the face and the surface at its rim", "rad", default=0.1, above=0, below=np.pi / 2
    )
    rise: float | None = key(
        "how far the object may protrude into the cup, inside the rim and beyond the face; by default `gap`",
        "m",
        default=None,
        above=0,
    )
    force: float | None = key(
        "pull-off force along the axis at the vacuum that is used; with the mass of the object, it is then judged "
        "whether the cup [holds in motion](../holding.md)",
        "N",
        default=None,
        above=0,
    )
    friction: float | None = key(
        "coefficient of friction between the rim and the object; by default that of `grip_limits`",
        default=None,
        above=0,
    )

    @property
    def highest(self) -> float:
        """Metres: how far the object may protrude into the cup."""
        return self.gap if self.rise is None else self.rise


ERROR_OF_INPUT = Rule(
    ("error",),
    lambda own: "state the input whose absence calls it" if own.error is not None and own.input is None else "",
    {"dependentRequired": {"error": ["input"]}},
)


@struct("program_settings", eq=False, rules=[ERROR_OF_INPUT])
class ProgramSettings:
    """What programs of a robot controller state beside the moves."""

    tool: str = key("name of the tool", default="tool")
    flange: str | None = key(
        "the link that is the flange of the controller, in whose frame its tool is stated; by default `tool0` or "
        "`flange`, if the last joint moves it, or else the link of the last joint",
        default=None,
    )
    frame: str | None = key("one of `frames`, as the work object or user frame; by default none", default=None)
    output: str | None = key(
        "the digital output that closes the gripper; by default that of the language", default=None
    )
    input: str | None = key(
        "a digital input that is on while the hand holds a part. It is checked after each grip; by default none",
        default=None,
    )
    timeout: float = key("how long a program waits for the input, after which it ends", "s", default=1.0, above=0)
    error: str | None = key(
        "a routine of the controller that is called before a program ends because the input is off; by default none",
        default=None,
    )
    home: bool = key(
        "whether a program returns to home after the part is put down, if a return is proven", default=True
    )
    main: bool = key("whether a routine `main` that calls the programs in order is written too", default=False)
    external_axes: tuple[str, ...] | None = key(
        "the joints that the controller moves as external axes; by default the prismatic joints before the last six",
        default=None,
        kind=list_of(TEXT),
        shown=None,
    )
