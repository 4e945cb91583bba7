"""The files of a new cell: a scene and picks for a robot and meshes of parts, with a comment on each assumption."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from pinproof.cell.starting import station
from pinproof.cell.starting.workpieces import MOST_BIN, MOST_PART, RestingPose, Workpiece, arrange, free_floor, relative
from pinproof.collision import CollisionChecker, Mesh, Scene, sample_overlaps
from pinproof.common.files import write_text_whole
from pinproof.common.results import Rows, Shown, View
from pinproof.common.structs import plain
from pinproof.common.validation import refuse_repeated, require_integer, require_positive
from pinproof.description import VISUALS_CAN_BE_CHECKED
from pinproof.errors import FileError, InputError
from pinproof.model import Arm, Payload
from pinproof.motion import TorqueLimits
from pinproof.picks import (
    PartType,
    Picks,
    ProposedGrasp,
    ReachRegion,
    Tool,
    propose_grasps,
    reach_map,
    read_picks,
    tool_orientations,
)
from pinproof.spatial import SE3, Array, pose, rotation_about

ALUMINIUM = 2700.0
"""kg/m^3: the density of parts by default."""

LIFTS = (0.1, 0.05, 0.03)
"""Metres: lengths of approach and retreat, of which the first is used with which the arm reaches an area."""

GAP, BETWEEN, EDGE, BORDER = 0.05, 0.06, 0.02, 0.05
"""Metres: between parts, in addition to half of the opening of the hand; between them and the tray; of the tray around
its parts; and of the table around everything."""

TRAY, BOARD, REST_GAP, MARGIN = 0.01, 0.03, 2e-4, 1e-3
"""Metres: the thickness of the tray, and of a table on the ground; the gap below a part, because its mesh is rounded;
and the margin of the picks."""

PROPOSED, GRASPS = 2000, 10
"""Numbers of grasps that are proposed for a part, and kept of the vertical and of the other ones in a pose of rest."""

DOWNWARDS, VERTICAL, RAISED = 0.7, 1e-3, 8e-3
"""The least cosine of the angle between an approach and straight down, the sine up to which it is vertical, and how far
(m) a grasp is raised at most."""

TRIED = 8
"""Number of areas that are tried with the complete scene."""

COLOURS = {"floor": (0.82, 0.82, 0.80, 1), "table": (0.62, 0.60, 0.56, 1), "tray": (0.36, 0.55, 0.70, 1)}
BIN_COLOUR = (0.45, 0.50, 0.55, 0.6)
PART_COLOURS = ((0.80, 0.62, 0.25, 1), (0.72, 0.36, 0.30, 1), (0.42, 0.60, 0.38, 1), (0.55, 0.45, 0.66, 1))

HEAD = "# Written by pinproof new cell. Metres and radians{}.\n"


@dataclass(frozen=True, eq=False)
class NewCell(Shown):
    """A cell that was written to a folder; result of :func:`new_cell`.

    Parameters
    ----------
    folder
        The folder: ``picks.yaml``, ``scene.yaml``, ``tool.yaml`` unless a tool was stated, and ``robot.srdf`` for a
        robot file without an SRDF.
    arm
        The arm with the open hand.
    scene, picks
        The contents of the files.
    home
        (n,) the configuration in which motions start.
    assumed
        What was recognised or assumed; the same sentences are comments in the files.
    """

    folder: Path
    arm: Arm
    scene: Scene
    picks: Picks
    home: Array
    assumed: tuple[str, ...]

    def _view(self) -> View:
        head = f"{self.folder}: {self.arm.robot.name}, {len(self.scene)} obstacles, {len(self.picks)} picks"
        home = Rows(("joint", "home"), zip(self.arm.joint_names, self.home.tolist(), strict=True))
        return View(head, [self.assumed, home], self.assumed, title=f"New cell {head} (rad or m)")


class LaidPart(NamedTuple):
    """A part in a pose of rest, where it lies and where it is put down (``plane_from_part``)."""

    name: str
    piece: Workpiece
    rest: RestingPose
    at: SE3
    to: SE3


class Layout(NamedTuple):
    """Parts, tray and bin about the middle of a rectangle of ``size`` (2,) that the tip must reach.

    ``tray`` and ``table`` are the lower and upper corners (2,) of rectangles, ``bin_at`` is the pose of the bin.
    """

    parts: list[LaidPart]
    size: Array
    tray: tuple[Array, Array]
    table: tuple[Array, Array]
    bin_at: SE3


def new_cell(
    robot: str | Path,
    parts: Sequence[str | Path],
    *,
    folder: str | Path,
    bin: str | Path | None = None,  # noqa: A002  # what it is
    tool: str | Path | None = None,
    tcp: str | None = None,
    count: int = 1,
    unit: str | None = None,
    density: float = ALUMINIUM,
    srdf: str | Path | None = None,
    package_dirs: Sequence[str | Path] = (),
    xacro_args: Mapping[str, str] | None = None,
    calibration: str | Path | None = None,
    visual_bodies: bool = False,
    rng: int = 0,
) -> NewCell:
    """Write the scene and the picks of a cell in which a robot moves parts onto a tray.

    The parts lie in poses of rest, on a table or in a bin, where the arm reaches them from above. Every assumption is a
    comment in the files, which are meant to be edited.

    Parameters
    ----------
    robot
        A catalogue name, or a robot file (URDF, xacro, MJCF, DH table).
    parts
        Closed meshes (STL, OBJ, DAE, PLY, GLB or glTF), one for each type of part.
    folder
        The folder to write; it does not exist or is empty.
    bin
        The mesh of a bin that is open upwards (+z of its file).
    tool
        A tool file; by default the hand that the robot has.
    tcp
        The tcp frame; by default that of the tool file, or as for :meth:`pinproof.Robot.arm`.
    count
        Number of parts of each type.
    unit
        The unit of all meshes, ``"m"``, ``"mm"`` or ``"inch"``; by default millimetres for parts larger than 1 m and
        bins larger than 3 m, otherwise metres.
    density
        Density of the parts in kg/m^3.
    srdf, package_dirs, xacro_args, calibration, visual_bodies
        As for :func:`pinproof.load_robot`.
    rng
        Seed of the rotations in which the parts lie.

    Raises
    ------
    FileError
        If the folder is not empty, or a file cannot be read or written; MeshError if a mesh is open.
    InputError
        If the robot has no collision geometry, the hand does not grasp a part, the arm cannot hold it, the parts do not
        fit into the bin, or no area or home is found; also for the reasons of :meth:`pinproof.Robot.arm`.
    """
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise FileError(folder, "exists and is not an empty folder; choose another with -o (folder=)")
    if not parts:
        raise InputError("parts is empty; state at least one mesh")
    require_integer("count", count, 1)
    require_positive("density", density)
    # The folder is written beside its place and moved there at the end, so that it is complete or does not exist
    made = folder.parent / f".{folder.name}.partial"
    shutil.rmtree(made, ignore_errors=True)
    made.mkdir(parents=True)
    try:
        # The parts, and the robot with the tool of a file or with its own hand
        own = Tool() if tool is None else Tool.load(tool)
        stated: dict[str, Any] = {"robot": str(robot), "srdf": srdf, "calibration": calibration, "tcp": tcp or own.tcp}
        stated |= {"package_dirs": tuple(map(Path, package_dirs)), "xacro_args": dict(xacro_args or {})}
        own = replace(own, visual_bodies=visual_bodies or own.visual_bodies, **stated)
        pieces = [Workpiece.read(path, made, most=MOST_PART, unit=unit) for path in parts]
        refuse_repeated("parts, which are those of their files,", (piece.name for piece in pieces))
        box = None if bin is None else Workpiece.read(bin, made, most=MOST_BIN, unit=unit)
        own, head, hand = _with_hand(own, tool is None, min(piece.narrowest for piece in pieces), made)
        arm = own.load_arm()
        # The part types with their grasps, and where the parts lie
        points = station.hand_points(arm, own)
        types = [_part_type(piece, own, arm, points, density, rng) for piece in pieces]
        chosen = [
            (f"{piece.name}_{number + 1}", piece, rests[number % len(rests)])
            for number in range(count)
            for piece, (_, rests) in zip(pieces, types, strict=True)
        ]
        layout = _lay_out(chosen, GAP + hand.opening / 2, box, rng)
        settled = _settle(arm, own, layout, box, made / "scene.yaml", rng)
        hand_file = "tool.yaml" if tool is None else relative(tool, made)
        text = _picks_text(arm, own, head, hand_file, [text for text, _ in types], layout, settled)
        write_text_whole(made / "picks.yaml", text)
        read_picks(made / "picks.yaml")  # before the folder is moved
        if folder.exists():
            folder.rmdir()
        made.rename(folder)
    finally:
        shutil.rmtree(made, ignore_errors=True)
    picks = read_picks(folder / "picks.yaml")
    recognised = [piece.described for piece in (*pieces, *([] if box is None else [box]))]
    recognised += [f"{key}: {text}" for key, text in hand.why.items()]
    return NewCell(folder, arm, picks.load_scene(), picks, settled.home, (*recognised, f"home: {settled.why}"))


def _with_hand(own: Tool, without_file: bool, narrowest: float, made: Path) -> tuple[Tool, str, station.OwnHand]:
    """The tool with its robot, the keys of the robot as text, and what was recognised of its own hand.

    If the tool was stated ``without_file``, the hand that the robot has is written as one.
    """
    arm, robot = own.load_arm(), str(own.robot)
    if not arm.robot.urdf.collisions:
        what = f"robot {arm.robot.name!r} has no collision geometry, so nothing can be proven of its motions"
        raise InputError(f"{what}; add <collision> to the links of its URDF, or {VISUALS_CAN_BE_CHECKED}")
    is_name = not Path(robot).suffix and "/" not in robot
    if own.srdf is None and not is_name and arm.robot.srdf.path is None:
        sample_overlaps(arm.robot).save_srdf(made / "robot.srdf")
        own = replace(own, srdf=made / "robot.srdf")
    own = replace(own, tcp=arm.tcp)
    files = {
        "robot": robot if is_name else relative(robot, made),
        "srdf": own.srdf and relative(own.srdf, made),
        "package_dirs": [relative(each, made) for each in own.package_dirs],
        "xacro_args": own.xacro_args,
        "calibration": own.calibration and relative(own.calibration, made),
        "visual_bodies": own.visual_bodies,
        "tcp": own.tcp,
    }
    head, hand = "".join(f"{key}: {_flow(value)}\n" for key, value in files.items() if value), station.OwnHand()
    if without_file:
        hand = station.recognise_hand(arm, narrowest)
        lines = "".join(f"{_comment(hand.why[key])}{key}: {_flow(value)}\n" for key, value in hand.keys.items())
        write_text_whole(made / "tool.yaml", f"{HEAD.format('')}{head}{lines}")
        own = replace(Tool.load(made / "tool.yaml"), **{key: getattr(own, key) for key in files})
    return own, head, hand


def _picks_text(
    arm: Arm, own: Tool, head: str, hand_file: str, types: Sequence[str], layout: Layout, settled: Settled
) -> str:
    """The picks file."""
    area, home, why, lift = settled
    named, ends = dict(zip(arm.joint_names, home.tolist(), strict=True)), {"approach": lift, "retreat": lift}
    text = f"{HEAD.format('; each comment states what was recognised or assumed')}{head}scene: scene.yaml\n"
    text += f"{_comment('Assumed: the smallest distance of any two bodies.')}margin: {MARGIN:g}\n"
    text += f"{_comment(f'Where motions start: {why}.')}home: {_flow(named)}\n"
    if own.held:
        text += f"{_comment('The open hand, with which motions start.')}held: {_flow(own.held)}\n"
    text += f"tools: {{hand: {hand_file}}}\nparts:\n{''.join(types)}"
    text += f"{_comment('Assumed: the lengths of the straight lines.')}defaults: {_flow(ends)}\n"
    text += f"{_comment('Each part is put onto the tray, in the pose in which it rests.')}picks:\n"
    for part in layout.parts:
        place = {"object_pose": station.stated_pose(area * part.to), **ends}
        text += f"  - {_flow({'name': part.name, 'part': part.piece.name, 'object': part.name, 'place': place})}\n"
    return text


def _part_type(
    piece: Workpiece, tool: Tool, arm: Arm, hand: tuple[Array, Array], density: float, rng: int
) -> tuple[str, list[RestingPose]]:
    """The part type as text of the picks file, and the poses of rest in which the tool grasps it from above."""
    mass, centre = round(piece.mesh.volume * density, 6), piece.mesh.center_mass.round(6)
    hint = f"or state its unit with --unit (unit=): {piece.described}"
    # The mass, if torques are known for it
    text, row = f"{piece.described}.", {"mesh": piece.stated}
    try:
        limits = TorqueLimits(arm, payload := Payload(mass, centre)).limits
        empty, loaded = (np.abs(arm.torques(arm.home, payload=carried)) for carried in (None, payload))
    except InputError as error:
        text += f" Its mass, {mass:.4g} kg with {density:g} kg/m^3, is not stated: {error}."
    else:
        if ((loaded > limits) & (empty <= limits)).any():
            raise InputError(
                f"{piece.path}: with {density:g} kg/m^3 the part has {mass:.4g} kg, which the arm cannot hold; state "
                f"its density with --density (density=), {hint}"
            )
        if (empty <= limits).all():
            row |= {"mass": mass, "center_of_mass": centre}
            text += f" Assumed: the mass is that of {density:g} kg/m^3; state the true one."
        else:
            text += f" Its mass, {mass:.4g} kg, is not stated: the torque limits do not hold the empty arm at its home."
    # The best grasps for each pose of rest in which some come from above
    try:
        part = PartType(name=piece.name, shape=Mesh(piece.path, piece.scale))
        proposed = propose_grasps(part, tool, arm=arm, count=PROPOSED, rng=rng)
    except InputError as error:
        raise InputError(f"{piece.path}: {error}; use another tool (--tool, tool=), {hint}") from error
    from_above = [_from_above(proposed, rest.plane_from_part, hand) for rest in piece.rests]
    rests = [rest for rest, found in zip(piece.rests, from_above, strict=True) if found]
    if not rests:
        raise InputError(
            f"{piece.path}: the tool grasps the part from above in none of the {len(piece.rests)} poses in which it "
            f"rests ({len(proposed.grasps)} grasps from other sides were found); use another tool (--tool, tool=), "
            f"{hint}"
        )
    shares = ", ".join(f"{100 * rest.share:.0f} %" for rest in rests)
    poses = "1 pose" if len(rests) == 1 else f"{len(rests)} poses"
    text += f" It rests in {poses} (probability {shares}); the grasps from above in them, the best first:"
    stated = proposed.stated()
    grasps = [
        {**stated[k], "name": f"grasp_{number}", **station.stated_pose(part_from_tip)}
        for number, (k, part_from_tip) in enumerate((grasp for found in from_above for grasp in found), 1)
    ]
    rows = "".join(f"      - {_flow(grasp)}\n" for grasp in grasps)
    keys = "".join(f"    {key}: {_flow(value)}\n" for key, value in row.items())
    return f"{_comment(text, '  ')}  {_flow(piece.name)}:\n{keys}    grasps:\n{rows}", rests


def _from_above(
    proposed: Iterable[ProposedGrasp], plane_from_part: SE3, hand: tuple[Array, Array]
) -> list[tuple[int, SE3]]:
    """Grasps from above in a pose of rest: the numbers of proposals, and ``part_from_tip``.

    A grasp of two fingers is also turned about the middle of its contacts until it is vertical. Each is raised until
    the open hand, and the hand at any opening, is above the plane. Whether these grasps hold the part is judged with
    the picks. ``hand`` are points of the open hand, and of the hand at any opening, in the frame of the tip.
    """
    found: dict[bool, list[tuple[float, int, SE3]]] = {True: [], False: []}
    for k, proposal in enumerate(proposed):
        tip = plane_from_part * proposal.grasp.pose
        tilt = np.cross(tip.rotation[:, 2], [0.0, 0.0, -1.0])
        if tip.rotation[2, 2] > -DOWNWARDS:
            continue
        poses = [tip]
        if len(proposal.contacts) > 1 and (sine := float(np.linalg.norm(tilt))) > VERTICAL:
            middle = plane_from_part.act(proposal.contacts.mean(axis=0))
            turn = SE3(rotation_about(tilt / sine, float(np.arcsin(min(sine, 1.0)))), np.zeros(3))
            poses.append(SE3(np.eye(3), middle) * turn * SE3(np.eye(3), -middle) * tip)
        for tilted in poses:
            up = tilted.rotation[2]
            lowest = (float((points @ up).min() + tilted.translation[2]) for points in hand)
            for raised in {max(MARGIN - height, 0.0) / -float(up[2]) for height in lowest}:  # often the same for both
                if raised <= RAISED:
                    placed = plane_from_part.inverse() * tilted * pose([0.0, 0.0, -raised])
                    found[up[2] < -1.0 + VERTICAL**2].append((raised, k, placed))
    kept = [sorted(grasps, key=lambda grasp: grasp[:2])[:GRASPS] for grasps in found.values()]
    return [(k, placed) for grasps in kept for _, k, placed in grasps]


def _lay_out(
    chosen: Sequence[tuple[str, Workpiece, RestingPose]], gap: float, box: Workpiece | None, rng: int
) -> Layout:
    """Lay parts onto a table, or onto the floor of a bin, with ``gap`` (m) between them, and a tray for them beside."""
    radii = [rest.radius for *_, rest in chosen]
    to, tray_size = arrange(radii, gap, 1.2 * float(np.sqrt(sum((2 * radius + gap) ** 2 for radius in radii))))
    # On a table as on the tray, in a bin with a gap for which its floor suffices
    at, size, floor, middle, bottom = to, tray_size, 0.0, np.zeros(2), 0.0
    low, high = -size / 2, size / 2
    if box is not None:
        first, last, level = free_floor(box)
        for part_of_gap in (1.0, 0.5, 0.25, 0.1):
            at, size = arrange(radii, part_of_gap * gap, float(last[1] - first[1]))
            if (size <= last - first).all():
                break
        else:
            sides = " x ".join(f"{1e3 * side:.0f}" for side in last - first)
            raise InputError(
                f"{box.path}: {len(radii)} parts do not fit onto its free floor of {sides} mm; state fewer parts "
                "(--count, count=) or a larger bin"
            )
        middle, bottom = (first + last) / 2, float(box.mesh.bounds[0, 2])
        low, high, floor = box.mesh.bounds[0, :2] - middle, box.mesh.bounds[1, :2] - middle, level - bottom
    # The parts beyond the tray along y, both about the middle of what the tip must reach
    half = tray_size / 2 + EDGE
    apart = float(half[1] + BETWEEN - low[1])
    length = float(tray_size[1] / 2 + apart + size[1] / 2)
    tray_at = np.array([0.0, (tray_size[1] - length) / 2])
    parts_at = tray_at + np.array([0.0, apart])
    turns = np.random.default_rng(rng).uniform(0.0, 2 * np.pi, len(chosen))
    parts = [
        LaidPart(
            *chosen[k],
            pose([*(parts_at + at[k]), floor + REST_GAP], [0.0, 0.0, turns[k]]) * chosen[k][2].plane_from_part,
            pose([*(tray_at + to[k]), TRAY + REST_GAP]) * chosen[k][2].plane_from_part,
        )
        for k in range(len(chosen))
    ]
    every = np.array([parts_at + low, parts_at + high, tray_at - half, tray_at + half])
    table = every.min(axis=0) - BORDER, every.max(axis=0) + BORDER
    size = np.array([max(size[0], tray_size[0]), length])
    return Layout(parts, size, (tray_at - half, tray_at + half), table, pose([*(parts_at - middle), -bottom]))


class Settled(NamedTuple):
    """Where a layout is: ``root_from_area``, the home and the reason for it, and the length of the lines."""

    area: SE3
    home: Array
    why: str
    lift: float


def _settle(arm: Arm, tool: Tool, layout: Layout, box: Workpiece | None, file: Path, rng: int) -> Settled:
    """Put a layout where the arm reaches all of it and has a home, and write the scene file."""
    bare = CollisionChecker(arm, margin=MARGIN, attached=tool.open_tool)
    around = float(np.max([-layout.size / 2 - layout.table[0], layout.table[1] - layout.size / 2]))
    for lift in LIFTS:
        if areas := station.work_areas(bare, tool.tip, layout.size, lift, around, rng):
            break
    else:
        sides = " x ".join(f"{side:.2f}" for side in layout.size)
        raise InputError(
            f"{arm.robot.name!r} reaches no free area of {sides} m with {arm.tcp!r} pointing down; state fewer parts "
            f"(--count, count=), a smaller bin, or another tcp (--tcp, tcp=){station.down_hint(arm, rng)}"
        )
    # The first area with a home in which the tip reaches every part and its place; otherwise that with most of them
    best: Settled | None = None
    most, kept = 0, ""
    for area in areas[:TRIED]:
        text = _scene_text(arm, layout, box, area)
        write_text_whole(file, text)
        scene = Scene.load(file)
        found = station.find_home(bare.with_spec(replace(bare.spec, scene=scene)), tool.tip, area, lift, rng)
        if found is None:
            continue
        tops = [
            area * placed * part.rest.plane_from_part.inverse() * SE3(np.eye(3), np.array([0, 0, part.rest.height]))
            for part in layout.parts
            for placed in (part.at, part.to)
        ]
        empty = bare.with_spec(replace(bare.spec, scene=scene.remove(*(part.name for part in layout.parts))))
        region = ReachRegion(np.array([top.translation for top in tops]))
        reached = reach_map(empty, region, tool_orientations(spins=8), tip=tool.tip, rng=rng)
        count = int(reached.free.any(axis=1).sum())
        if count > most:
            best, most, kept = Settled(area, *found, lift), count, text
        if most == len(tops):
            break
    if best is None:
        raise InputError(
            f"{arm.robot.name!r} has no collision-free home above the {len(areas[:TRIED])} areas that it reaches best; "
            "state one as group_state of an SRDF (--srdf, srdf=), or another tcp (--tcp, tcp=)"
        )
    write_text_whole(file, kept)
    return best


def _scene_text(arm: Arm, layout: Layout, box: Workpiece | None, root_from_area: SE3) -> str:
    """The scene file: floor, table, tray, bin and parts."""
    height, floor = float(root_from_area.translation[2]), float(station.fixed_box(arm)[0][2])

    def board(name: str, corners: tuple[Array, Array], bottom: float, top: float) -> dict[str, Any]:
        middle = root_from_area * pose([*(corners[0] + corners[1]) / 2, (bottom + top) / 2])
        sides = [*(corners[1] - corners[0]), top - bottom]
        return {"name": name, "box": np.round(sides, 6), **station.stated_pose(middle), "rgba": COLOURS[name]}

    def mesh(name: str, piece: Workpiece, at: SE3, colour: Sequence[float]) -> dict[str, Any]:
        return {"name": name, "mesh": piece.stated, **station.stated_pose(root_from_area * at), "rgba": colour}

    side = 2 * round(arm.robot.size + 1.0, 1)
    ground = {"box": [side, side, 0.02], "xyz": [0, 0, round(floor - 0.015, 6)], "rgba": COLOURS["floor"]}
    rows = [
        (
            "Assumed: a floor below the lowest fixed body of the robot. Remove it if the cell has no floor.",
            {"name": "floor", **ground},
        ),
        (
            f"Assumed: a table at {height:g} m, where the tip reaches all parts from above. State yours instead.",
            board("table", layout.table, min(floor - height, -BOARD), 0.0),
        ),
        ("Assumed: a tray for the parts.", board("tray", layout.tray, 0.0, TRAY)),
    ]
    if box is not None:
        rows.append((f"{box.described}.", mesh("bin", box, layout.bin_at, BIN_COLOUR)))
    names = list(dict.fromkeys(part.piece.name for part in layout.parts))
    for part in layout.parts:
        text = f"{part.piece.described}. It rests so with a probability of {100 * part.rest.share:.0f} %."
        colour = PART_COLOURS[names.index(part.piece.name) % len(PART_COLOURS)]
        rows.append((text, mesh(part.name, part.piece, part.at, colour)))
    listed = "".join(f"{_comment(why, '  ')}  - {_flow(row)}\n" for why, row in rows)
    return f"{HEAD.format(', in the frame of the root link')}obstacles:\n{listed}"


def _flow(value: Any) -> str:
    """A value as YAML in one line."""
    text = yaml.safe_dump(plain(value), default_flow_style=True, sort_keys=False, width=10**6)
    return text.removesuffix("...\n").strip()


def _comment(text: str, indent: str = "") -> str:
    """A comment of as many lines as it needs."""
    return "".join(f"{indent}# {line}\n" for line in textwrap.wrap(text, 110))
