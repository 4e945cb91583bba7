"""Part types: shape, mass and friction of the parts of a bin, and the grasps by which they are picked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.collision import LineSurface, Obstacle, Shape, outer_points
from pinproof.common.results import ByValue
from pinproof.common.structs import Accepting, Direction, Kind, key, list_of, simple, struct, table_of
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import Payload
from pinproof.picks.input.pick import GRASP, MOVES, ROOT, GraspSpin, GraspTolerance, Pick
from pinproof.picks.input.tools import Hand, HandValues, Tool
from pinproof.spatial import SE3, Array

_OF_PICK = {own.name: own.metadata["declared"] for own in fields(Pick) if "declared" in own.metadata}
_OF_PAYLOAD = {own.name: own.metadata["declared"] for own in fields(Payload)}
_LINES = ("spin", "tolerance", *(f"{move}{part}" for move in MOVES for part in ("", "_direction", "_frame")))


def _optional(declared: Any) -> Any:
    """The key of a field of another struct, which need not be stated."""
    return key(declared.text, declared.unit, default=None, kind=declared.kind, **declared.bounds)


@struct("part_grasp", eq=False, first=("name", "pose", "tool", *_LINES))
class PartGrasp(HandValues, ByValue):
    """A grasp of a part type. The keys of a pick that it states apply in place of those of the pick."""

    pose: SE3 = key("``part_from_tip``: the pose of the tool's tip in the frame of the part", inline=GRASP)
    name: str = key("its name, unique among the grasps of the part; by default its number", default="")
    tool: str | None = key("the tool; by default that of the part", default=None)
    spin: GraspSpin | None = _optional(_OF_PICK["spin"])
    tolerance: GraspTolerance | None = _optional(_OF_PICK["tolerance"])
    approach: float | None = _optional(_OF_PICK["approach"])
    approach_direction: Direction | None = _optional(_OF_PICK["approach_direction"])
    approach_frame: str | None = _optional(_OF_PICK["approach_frame"])
    retreat: float | None = _optional(_OF_PICK["retreat"])
    retreat_direction: Direction | None = _optional(_OF_PICK["retreat_direction"])
    retreat_frame: str | None = _optional(_OF_PICK["retreat_frame"])

    def lines(self) -> dict[str, Any]:
        """The keys of a pick that the grasp states."""
        return {name: value for name in _LINES if (value := getattr(self, name)) is not None}

    def turned(self, rotation: Array) -> PartGrasp:
        """The grasp with the directions of its lines, if they are in the root frame, rotated (3, 3)."""
        changes: dict[str, Any] = {}
        for move, usual in (("approach", "tip"), ("retreat", ROOT)):
            direction, frame = getattr(self, f"{move}_direction"), getattr(self, f"{move}_frame") or usual
            if direction is not None and frame == ROOT:
                changes[f"{move}_direction"] = tuple((rotation @ direction).tolist())
        return replace(self, **changes)


def uniform_body(surface: LineSurface) -> tuple[Array, Array]:
    """Centre of mass (3,) and inertia (3, 3) about it of 1 kg of uniform density; of an open mesh, that of its hull."""
    from trimesh.convex import convex_hull
    from trimesh.triangles import mass_properties

    corners, solid = surface.triangles, (surface.surface or surface.body).solid
    if corners is None or solid is None or not solid.watertight:
        corners = convex_hull(outer_points(surface)).triangles
    found = mass_properties(corners, skip_inertia=False)
    return np.asarray(found.center_mass), np.asarray(found.inertia / found.mass)


def _shape(name: str, value: Any) -> Shape:
    body = Obstacle("part", value)
    if not body.pose.isIdentity():
        raise InputError(f"{name} is displaced in its own frame; state it in the frame of the part")
    return body.shape


@struct("part_type", kw_only=True, eq=False, first=("shape", "mass", "center_of_mass", "inertia", "friction", "tool"))
class PartType(HandValues, ByValue):
    """A type of parts. Obstacles of the scene that picks name as parts of this type have its shape and its frame."""

    shape: Accepting[Shape, Any] = key(
        "its shape", kind=simple({}, _shape), inline=next(k.kind for k in table_of(Obstacle).keys if k.name == "shape")
    )
    mass: float | None = key(
        "its mass, above 0; the torque limits of the joints then apply", "kg", default=None, above=0
    )
    center_of_mass: tuple[float, float, float] | None = key(
        "its centre of mass; by default that of a uniform density", "m", default=None
    )
    inertia: Accepting[Array | None, Any] = _optional(_OF_PAYLOAD["inertia"])
    friction: float | None = key(
        "coefficient of friction between the part and the fingers or the cup, above 0", default=None, above=0
    )
    tool: str | None = key("the tool of grasps that state none; by default the only one of the file", default=None)
    grasps: tuple[PartGrasp, ...] = key(
        "the grasps, in the order in which they are tried. Without any, grasps are [proposed](../grasps.md) from the "
        "shape",
        default=(),
        kind=list_of(table_of(PartGrasp)),
    )
    name: str = key("its name in messages", default="part", hidden=True)
    proposed: bool = key(
        "whether the grasps are proposals from its shape. If all of them fail, nothing is proven about other grasps",
        default=False,
        hidden=True,
    )

    def __post_init__(self) -> None:
        named = tuple(
            own if own.name else replace(own, name=f"grasp {number}") for number, own in enumerate(self.grasps, 1)
        )
        if doubled := [own.name for number, own in enumerate(named) if own.name in {o.name for o in named[:number]}]:
            raise InputError(f"a second grasp of {self.name} is named {doubled[0]!r}; their names must differ")
        object.__setattr__(self, "grasps", named)
        if self.mass is None and (self.center_of_mass is not None or self.inertia is not None):
            raise InputError(f"part type {self.name!r} states a centre of mass or an inertia but no mass")

    @cached_property
    def payload(self) -> Payload | None:
        """The mass of a part in its own frame; None if it is not stated."""
        if self.mass is None:
            return None
        if self.center_of_mass is not None:
            return Payload(self.mass, self.center_of_mass, self.inertia)
        centre, _ = uniform_body(LineSurface.of_obstacle(Obstacle(self.name, self.shape)))
        return Payload(self.mass, centre.round(9), self.inertia)

    def that_fit(self, *hands: Hand) -> HandValues:
        """The values for hands, with the friction of the part."""
        values = super().that_fit(*hands)
        if self.friction is None:
            return values
        limits = {"friction": self.friction, **values.grip_limits}
        cup = {} if all(hand.cup is None for hand in hands) else {"friction": self.friction, **values.cup}
        return replace(values, grip_limits=limits, cup=cup)


PART = table_of(PartType)


def _part(name: str, stated: Any, path: Path) -> PartType:
    made: PartType = PART.made(stated, {**PART.values(name, stated, path), "name": name})
    return made


PART_TYPE = Kind(PART, PART.check, _part)
"""A part type of a picks file."""


def grasps_of(pick: Pick, parts: Mapping[str, PartType], tools: Mapping[str, Tool], hand: Hand) -> Iterator[Pick]:
    """The picks with one grasp and one tool each that a pick describes, in the order in which they are tried.

    A pick without a part, or with a pose of its own, describes one grasp. One whose part states no grasps describes
    none until they are proposed. ``hand`` is that of files without tools.

    Raises
    ------
    UnknownNameError
        If the part, the grasp or the tool does not exist.
    InputError
        If no tool is stated although several exist, or no grasp of the part is for the tool of the pick, or the pick
        states values that none of the tools of these grasps has.
    """
    if pick.tool is not None and pick.tool not in tools:
        raise UnknownNameError("tool", pick.tool, tools or ("none",), "the tools of the picks file")
    part: PartType | None = None
    if pick.part is None:
        grasps: tuple[PartGrasp, ...] = ()
    elif pick.part not in parts:
        raise UnknownNameError("part", pick.part, parts, "the parts of the picks file")
    else:
        part = parts[pick.part]
        grasps = part.grasps

    def resolved(grasp: PartGrasp | None) -> Pick:
        """The pick with the values of its part and of a grasp."""
        stated = [own for own in (grasp, part) if own is not None]
        tool = next((own.tool for own in (grasp, pick, part) if own is not None and own.tool is not None), None)
        if tool is None and tools:
            if len(tools) > 1:
                raise InputError(f"pick {pick.name!r} states no tool; choose one of {', '.join(tools)}")
            tool = next(iter(tools))
        if tool is not None and tool not in tools:
            raise UnknownNameError("tool", tool, tools, "the tools of the picks file")
        changes: dict[str, Any] = {"tool": tool}
        if part is not None:
            own = hand if tool is None else tools[tool]
            changes |= part.that_fit(own).hand_values(pick if grasp is None else pick.that_fit(own), *stated[:-1])
            changes["payload"] = pick.payload or part.payload
        if grasp is not None:
            frame = {"pose": grasp.pose, "frame": str(pick.carried), "by_part": False, "grasp": grasp.name}
            changes |= {**grasp.lines(), **frame}
        return replace(pick, **changes)

    if part is None or not pick.by_part:
        yield resolved(None)
        return
    if pick.grasp is not None:
        named = {own.name: own for own in grasps}
        if pick.grasp not in named:
            raise UnknownNameError("grasp", pick.grasp, named or ("none",), f"the grasps of part {pick.part!r}")
        grasps = (named[pick.grasp],)
    if not grasps:  # they are proposed when the picks are judged
        return
    # The tool of a pick selects the grasps that are for it
    usable = [own for own in grasps if pick.tool is None or (own.tool or part.tool or pick.tool) == pick.tool]
    if not usable:
        found = ", ".join(f"{own.name} ({own.tool or part.tool})" for own in grasps)
        raise InputError(f"pick {pick.name!r} is for the tool {pick.tool!r}, but the grasps of its part are {found}")
    pick.refuse_unused([tools.get(own.tool or part.tool or pick.tool or next(iter(tools), ""), hand) for own in usable])
    yield from map(resolved, usable)
