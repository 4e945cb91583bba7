"""Grasps of a part that are proposed from its shape, ranked by the force that they resist."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from functools import lru_cache
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from pinproof import viewer
from pinproof.collision import ConvexShape, Cylinder, LineSurface, Mesh, Obstacle, outer_points
from pinproof.common.files import json_text, save_as, write_yaml
from pinproof.common.results import Rows, Shown, View
from pinproof.common.structs import OPTIONAL_NUMBER, described, key
from pinproof.common.validation import Rng, random_generator, require_integer
from pinproof.errors import FileError, InputError
from pinproof.model import Arm
from pinproof.picks.grasps.antipodal import across, finger_grasps
from pinproof.picks.grasps.hand_maps import HandMaps, closed_completely
from pinproof.picks.grasps.part_surface import PartSurface
from pinproof.picks.grasps.quality import resisted_by_cup, resisted_by_fingers
from pinproof.picks.grasps.seals import point_grasps
from pinproof.picks.input.parts import PartGrasp, PartType
from pinproof.picks.input.pick import GraspSpin
from pinproof.picks.input.picks import Picks
from pinproof.picks.input.tools import Hand, Tool, with_values
from pinproof.spatial import SE3, Array, matrix, xyz_rpy

ANTIPODAL, CUP, TIP = "antipodal", "cup", "tip"

TURNED = (0.0, np.pi)
"""Rotations of proposals for hands that are the same after half a rotation about the approach."""

ROUND = tuple(np.pi / 4 * np.array([0, 1, -1, 2, -2, 3, -3, 4]))
"""Rotations of proposals for cups and tips."""

DIGITS = 7
"""Decimals of the poses of proposals: 0.1 micrometres."""

LEAST_ANGLE = np.radians(0.5)
"""Smallest half angle of the friction cones: less than the errors of facets and of poses."""


@described(eq=False)
class ProposedGrasp:
    """One proposal, with its figures."""

    grasp: PartGrasp = key("the grasp; its pose is ``part_from_tip``")
    kind: str = key("``antipodal``, ``cup`` or ``tip``")
    resists: float = key(
        "a force at the centre of mass that it is proven to resist in every direction, in multiples of the force of a "
        "finger or of the cup; within a few percent of the largest; NaN for a tip",
        kind=OPTIONAL_NUMBER,
    )
    width: float = key("distance of the pads; NaN without fingers", "m", kind=OPTIONAL_NUMBER)
    area: float = key("smallest area of contact; NaN for a tip", "m²", kind=OPTIONAL_NUMBER)
    edge: float = key(
        "distance of the rim of a cup from edges and holes, at most its radius", "m", kind=OPTIONAL_NUMBER
    )
    lever: float = key("distance of the centre of mass from the line of the forces", "m")
    contacts: Array = key("(C, 3) the centres of the contacts in the frame of the part")
    normals: Array = key("(C, 3) the directions in which the hand presses there")

    @property
    def words(self) -> str:
        """The kind and its main figure."""
        if self.kind == ANTIPODAL:
            return f"antipodal, {self.width * 1e3:.1f} mm wide"
        return self.kind if self.kind == TIP else f"cup, {self.edge * 1e3:.1f} mm from an edge"


@described(eq=False)
class ProposedGrasps(Shown):
    """Grasps of a part, the one that resists most first."""

    proposals: tuple[ProposedGrasp, ...] = key("the grasps with their figures")
    part: PartSurface = key("the part")
    hand: HandMaps = key("the maps of the hand")
    wanted: int = key("the number that was asked for")
    tip: SE3 = key("``tcp_from_tip``")
    open: Mapping[str, float] = key("values (rad or m) of the gripping joints of the open hand", default_factory=dict)

    @property
    def grasps(self) -> tuple[PartGrasp, ...]:
        """The grasps, for :class:`PartType` or a picks file."""
        return tuple(proposal.grasp for proposal in self.proposals)

    def __len__(self) -> int:
        return len(self.proposals)

    def __iter__(self) -> Iterator[ProposedGrasp]:
        return iter(self.proposals)

    def __getitem__(self, number: int) -> ProposedGrasp:
        return self.proposals[number]

    @property
    def message(self) -> str:
        """The number of grasps, and what was recognised."""
        count, name = len(self), self.part.obstacle.name
        fewer = f" of {self.wanted} asked for: no more fit" if count < self.wanted else ""
        remark = f"; {self.part.remark}" if self.part.remark else ""
        return f"{count} grasp{'' if count == 1 else 's'} of {name}{fewer}{remark}"

    def rows(self) -> Rows:
        """The table."""
        cells = []
        for number, each in enumerate(self, start=1):
            x, y, z = each.grasp.pose.translation
            forwards = " ".join(f"{value + 0.0:.2f}" for value in each.grasp.pose.rotation[:, 2].round(2))
            area = None if np.isnan(each.area) else f"{each.area * 1e6:.0f}"
            figures = (None if np.isnan(each.resists) else f"{each.resists:.3f}", area, f"{each.lever * 1e3:.1f}")
            cells.append((number, each.words, *figures, *(f"{value * 1e3:.1f}" for value in (x, y, z)), forwards))
        columns = ("#", "grasp", "resists", "area mm²", "lever mm", "x mm", "y mm", "z mm", "approach")
        return Rows(columns, cells, numbers=("#", *columns[2:8]))

    def _view(self) -> View:
        return View(self.message, [self.rows()], self.rows().text(), len(self) + 1)

    def to_dict(self) -> dict[str, Any]:
        """The grasps and their figures for JSON."""
        grasps = []
        for each, stated in zip(self, self.stated(), strict=True):
            figures = {name: getattr(each, name) for name in ("resists", "width", "area", "edge", "lever")}
            known = {name: None if np.isnan(value) else value for name, value in figures.items()}
            grasps.append({**stated, "kind": each.kind, **known, "contacts": each.contacts.tolist()})
        return {"ok": bool(self.proposals), "message": self.message, "grasps": grasps}

    def stated(self) -> list[dict[str, Any]]:
        """The grasps as the key ``grasps`` of a part type states them."""
        stated = []
        for each in self.grasps:
            place = (xyz_rpy(each.pose).round(DIGITS) + 0.0).tolist()
            turns = {} if each.spin is None else {"spin": [round(angle, DIGITS) for angle in each.spin.angles]}
            hand: dict[str, Any] = {"fingers": dict(each.fingers)} if each.fingers else {}
            if each.grip:
                hand["held"] = {name: {"open": self.open[name], "grip": value} for name, value in each.grip.items()}
            stated.append({"name": each.name, "xyz": place[:3], "rpy": place[3:], **turns, **hand})
        return stated

    def save(self, path: str | Path) -> None:
        """Write the grasps: ``.yaml`` as the key ``parts`` of a picks file, ``.json`` with figures, ``.html`` a page.

        Raises
        ------
        InputError
            For another suffix.
        FileError
            If the file cannot be written.
        """
        shape, part = self.part.obstacle.shape, dict[str, Any]()
        if isinstance(shape, Mesh) and shape.path is not None:
            file, folder = Path(shape.path).resolve(), Path(path).resolve().parent
            mesh = {"path": str(file.relative_to(folder) if file.is_relative_to(folder) else file)}
            scale = np.broadcast_to(shape.scale, 3).tolist()
            part["mesh"] = mesh | ({} if scale == [1.0] * 3 else {"scale": scale[0] if len(set(scale)) == 1 else scale})
        content = {"parts": {self.part.obstacle.name: {**part, "grasps": self.stated()}}}
        save_as(
            path,
            {
                ".yaml": lambda: write_yaml(path, content, FileError),
                ".json": lambda: json_text(self.to_dict(), 1),
                ".html": lambda: _write_page(path, self),
            },
        )


def propose_grasps(part: Any, tool: Hand, *, arm: Arm | None = None, count: int = 200, rng: Rng = 0) -> ProposedGrasps:
    """Propose grasps of a part from its shape, ranked by the force at the centre of mass that they resist.

    For fingers, antipodal pairs of the surface within the friction cone, with hands at several rotations about the
    closing direction, are kept where both pads touch over a sufficient area and nothing else of the hand touches the
    part: at the grasp, while the fingers close, and on a straight approach. For a cup, places where its rim seals. For
    a plain tip, any place where the tool does not touch the part elsewhere. The grasps are spread over places,
    directions and rotations. docs/grasps.md describes the method and its limits.

    Parameters
    ----------
    part
        A :class:`PartType`, an obstacle (whose pose is ignored), the path of a mesh file, or any shape that
        :class:`~pinproof.Obstacle` accepts. A mesh must be closed. The file of a part that is longer than 2 m is read
        in millimetres, which the message of the result states.
    tool
        The hand: a :class:`Tool`, or picks without ``tools``.
    arm
        The arm whose links are the fingers or the palm; by default that of the ``robot`` of the tool.
    count
        The largest number of grasps.
    rng
        The seed: equal seeds give equal grasps.

    Raises
    ------
    InputError
        If the part is not closed or too wide for the fingers, no cup seals on it, the friction is zero, or the tool
        has nothing that holds a part. The message states both widths, or the largest flat circle.
    """
    count, random = require_integer("count", count, 1), random_generator(rng)
    centre = None
    if isinstance(part, PartType):
        tool, centre = with_values(tool, part.that_fit(tool), "the tool"), part.center_of_mass
        part = Obstacle(part.name, part.shape)
    if arm is None and getattr(tool, "robot", None) is not None:
        arm = tool.load_arm()  # type: ignore[attr-defined]  # a tool with a robot
    if tool.grip and arm is None:
        raise InputError(
            f"the fingers of the tool are links that {', '.join(tool.grip)} moves; state their robot: `robot` in the "
            "tool file, --robot, or arm="
        )
    if not (tool.grip or tool.fingers or tool.cup or tool.tool or tool.gripper or not tool.tip.isIdentity()):
        raise InputError(
            "the tool has neither fingers nor a cup; state fingers, cup, or held with two values for finger joints "
            "(for a magnet: tip or tool)"
        )
    surface, hand = PartSurface.of(part, random, centre), HandMaps.of(tool, arm)
    limits = tool.grip_limits
    stated = limits.friction if tool.cup is None or tool.cup.friction is None else tool.cup.friction
    friction = float(np.tan(limits.angle)) if stated is None else stated
    fingers, quality = hand.fingers, None
    spin = GraspSpin(ROUND) if fingers is None else GraspSpin(TURNED) if fingers.symmetric else None
    if fingers is None:
        found = point_grasps(surface, hand, tool.cup, count, random)
        if tool.cup is not None:
            normals = found.normals[:, 0]
            quality = resisted_by_cup(found.translations - surface.centre, normals, tool.cup.radius, friction)
    else:
        angle = min(limits.angle, float(np.arctan(friction)))
        if angle < LEAST_ANGLE:
            raise InputError(
                f"the grip limits allow {np.degrees(angle):.2g} deg between contact normals and the closing direction, "
                "so two fingers hold nothing; state a friction above 0 (rubber on metal: 0.5, angle 27 deg)"
            )
        found = finger_grasps(surface, hand, fingers, replace(limits, angle=angle), count, random)
        torsion = 2 / 3 * np.sqrt(found.areas / np.pi)  # of an even pressure on a disc of the smaller area
        quality = resisted_by_fingers(found.contacts - surface.centre, found.normals[:, 0], torsion, friction)
    resists = np.full(len(found.areas), np.nan) if quality is None else quality
    levers = np.linalg.norm(np.cross(surface.centre - found.contacts.mean(axis=1), found.normals[:, 0]), axis=1)
    # The values of the hand on the part, where the tool states a closed position; otherwise it closes by contact
    hand_from_tip, held = hand.tcp_from_hand.actInv(tool.tip), {} if arm is None else arm.held
    ends = {} if arm is None or None in tool.grip.values() else closed_completely(tool, arm)
    kind = ANTIPODAL if fingers is not None else TIP if tool.cup is None else CUP
    proposals = []
    for row, width in enumerate(found.widths.tolist()):
        own: dict[str, Any] = {}
        if tool.fingers is not None and tool.fingers.grip is not None:
            own["fingers"] = {"grip": round(width, DIGITS)}
        if fingers is not None and ends:
            share = fingers.share(width)
            own["grip"] = {n: round(held[n] + share * (end - held[n]), DIGITS) for n, end in ends.items()}
        tip = SE3(found.rotations[row], found.translations[row]) * hand_from_tip
        grasp = PartGrasp(SE3(tip.rotation, tip.translation.round(DIGITS)), spin=spin, **own)
        q, area, edge, lever = (float(values[row]) for values in (resists, found.areas, found.edges, levers))
        contacts, normals = found.contacts[row], found.normals[row]
        proposals.append(ProposedGrasp(grasp, kind, q, width, area, edge, lever, contacts, normals))
    # The best first; names state the rank
    proposals.sort(key=lambda each: (-np.nan_to_num(round(each.resists, 9)), each.lever))
    ranked = tuple(
        replace(each, grasp=replace(each.grasp, name=f"proposed grasp {number}: {each.words}"))
        for number, each in enumerate(proposals, start=1)
    )
    return ProposedGrasps(ranked, surface, hand, count, tool.tip, {name: held[name] for name in tool.grip})


def with_proposals(picks: Picks, arm: Arm) -> Picks:
    """The picks with proposed grasps of the part types that state none, for each tool that may hold them.

    InputError if no tool holds a part.
    """
    wanted = {pick.part for pick in picks.picks if pick.by_part} if picks.picks else set(picks.parts)
    parts = dict(picks.parts)
    for name, part in picks.parts.items():
        if part.grasps or name not in wanted:
            continue
        stated = [pick.tool for pick in picks.picks if pick.part == name and pick.tool is not None]
        usual = [None] if not picks.tools else list[str | None](picks.tools)
        tools = dict.fromkeys([part.tool, *stated] if part.tool is not None else stated or usual)
        grasps, reasons = list[PartGrasp](), list[str]()
        for tool in tools:
            own = picks.with_tool(tool)
            hand = Tool(**{each.name: getattr(own, each.name) for each in fields(Hand)})
            try:
                found = _proposed(part, hand, arm.with_held(own.held))
            except InputError as error:
                reasons.append(str(error))
                continue
            reasons.append("no pose was found at which only the pads touch it")
            head = "" if tool is None else f"{tool}: "
            grasps += [replace(grasp, name=head + grasp.name, tool=tool) for grasp in found.grasps]
        if not grasps:
            raise InputError(f"no grasp of part {name!r} can be proposed: {'; '.join(reasons)}; state its grasps")
        parts[name] = replace(part, grasps=tuple(grasps), proposed=True)
    return replace(picks, parts=parts)


@lru_cache(maxsize=64)
def _proposed(part: PartType, tool: Tool, arm: Arm) -> ProposedGrasps:
    """The proposals for a part type, which are computed once."""
    return propose_grasps(part, tool, arm=arm)


# -- the page ----------------------------------------------------------------------------------------------------------

RESTS = 0.6
"""Share of each second of the film for which a grasp is shown; in the rest of it the hand moves to the next one."""

PART_GREY, HAND_BLUE, CONTACT_RED = (0.72, 0.70, 0.64, 1.0), (0.35, 0.45, 0.62, 0.75), (0.85, 0.2, 0.1, 1.0)

THICK = 4e-4
"""Metres: the thickness of the discs that mark contacts."""


def _write_page(path: str | Path, found: ProposedGrasps) -> None:
    """Write the page of the part, the hand at the chosen grasp with its contacts, and the table of all grasps."""
    hand, part = found.hand, found.part.obstacle
    # Each body of the hand and each contact, with its pose (F, 4, 4) at every grasp
    drawn: list[tuple[Obstacle, Array]] = []
    hands = [each.grasp.pose * (hand.tcp_from_hand.actInv(found.tip)).inverse() for each in found]
    for number, (surface, at) in enumerate(hand.palm):
        drawn.append((_body(f"palm {number}", surface), np.array([matrix(placed * at) for placed in hands])))
    shares = [0.0 if hand.fingers is None else hand.fingers.share(each.width) for each in found]
    fingers = [hand.fingers_at(share) for share in shares]
    for number, (surface, _) in enumerate(fingers[0]):
        placements = [matrix(placed * own[number][1]) for placed, own in zip(hands, fingers, strict=True)]
        drawn.append((_body(f"finger {number}", surface), np.array(placements)))
    radius = 0.05 * found.part.size
    for number in range(len(found[0].contacts)):
        disc = Obstacle(f"contact {number}", Cylinder(radius, THICK), rgba=CONTACT_RED)
        poses = np.tile(np.eye(4), (len(found), 1, 1))
        normals = np.array([each.normals[number] for each in found])
        poses[:, :3, :3] = np.stack([*across(normals), normals], axis=2)
        poses[:, :3, 3] = [each.contacts[number] for each in found]
        drawn.append((disc, poses))
    # A film that rests at each grasp; what is drawn first is where it is lowest, on which the floor depends
    times = np.concatenate([np.arange(len(found))[:, None] + [0.0, RESTS]]).reshape(-1)
    riders = {thing.name: np.repeat(poses, 2, axis=0) for thing, poses in drawn}
    things = [
        viewer.DrawnObstacle(
            part.name, tuple(viewer.obstacle_surfaces(Obstacle(part.name, part.shape, rgba=PART_GREY))), np.eye(4)
        )
    ]
    points = [found.part.triangles.reshape(-1, 3)]
    for thing, poses in drawn:
        surfaces = tuple(viewer.obstacle_surfaces(thing))
        vertices = np.concatenate([surface.vertices for surface in surfaces])
        heights = (vertices @ poses[:, 2, :3].T + poses[:, 2, 3]).min(axis=0)
        things.append(viewer.DrawnObstacle(thing.name, surfaces, poses[heights.argmin()]))
        points.append(viewer.placed_points(np.array([vertices.min(axis=0), vertices.max(axis=0)]), poses[:1]))
    stage: Any = viewer.Drawing(None, (), tuple(things), ())  # type: ignore[arg-type]  # no robot is drawn
    direction = np.array([1.0, -1.6, 0.9])
    view = viewer.View(direction / np.linalg.norm(direction), np.concatenate(points))
    still = viewer.Film(np.zeros(1), np.empty((1, 0, 4, 4)), np.empty((1, 0, 3)))
    commands = viewer.stage_commands(stage, still, view)
    film = viewer.Film(times, np.empty((len(times), 0, 4, 4)), np.empty((len(times), 0, 3)), riders)
    commands.set_animation(
        viewer.tracks(commands, stage, film, {name: viewer.node_path("scene", name) for name in riders})
    )
    notes = [
        (
            "resists: a force at the centre of mass that the grasp is proven to resist in every direction, in "
            "multiples of the force of a finger or of the cup."
        ),
        "The red discs are at the centres of the contacts; the hand is drawn at the width of the grasp.",
    ]
    text = viewer.panels.page(
        f"Grasps of {part.name}",
        "cell",
        viewer.panels.table("side", found.rows(), notes),
        {**view.settings(), "duration": float(len(found)), "start": 0.0},
        commands,
        label="The part with the hand at the chosen grasp",
        summary=escape(found.message),
        colours=(("part", PART_GREY), ("hand", HAND_BLUE), ("contact", CONTACT_RED)),
        script=viewer.panels.part("page.js", "pinproof.picks.grasps"),
    )
    viewer.panels.write_page(path, text)


def _body(name: str, surface: LineSurface) -> Obstacle:
    """A body of the hand as it is drawn."""
    if surface.triangles is None:
        return Obstacle(name, ConvexShape(outer_points(surface)), rgba=HAND_BLUE)
    corners = np.asarray(surface.triangles).reshape(-1, 3)
    return Obstacle(name, Mesh.from_arrays(corners, np.arange(len(corners)).reshape(-1, 3)), rgba=HAND_BLUE)
