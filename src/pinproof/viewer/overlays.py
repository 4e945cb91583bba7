"""Objects that are drawn in addition to the robot and the scene.

Pose markers (arrows, for example at the grasps of many picks), frames with names, contacts with their normals,
transparent copies of links (other IK solutions, the tool along a motion), coloured points, and the floor, lights and
background.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import CheckResult, FirstContact
from pinproof.common import theme
from pinproof.common.structs import described, key
from pinproof.errors import InputError
from pinproof.spatial import Array, finite
from pinproof.viewer.camera import View
from pinproof.viewer.stage import Drawing, Film
from pinproof.viewer.surfaces import Surface, ball, box_triangles, cone, revolved, shade, tube
from pinproof.viewer.wire import Commands, node_name, node_path

Rgb = tuple[float, float, float]

LONGEST, SHORTEST = 0.07, 0.015
"""Metres. Limits of the length of an arrow."""

SPACING_SHARE = 0.9
"""Largest length of an arrow as a fraction of the median distance between neighbouring markers."""

SIDES = 10
"""Segments of the cross section of an arrow; there may be thousands of arrows."""


@described(eq=False)
class PoseMarkers:
    """Poses that are marked by coloured arrows."""

    poses: Array = key(
        "(N, 4, 4) ``root_from_tip``. Each arrow ends at the tip and points along its z axis; the bar across its "
        "other end is parallel to the x axis"
    )
    kinds: npt.NDArray[np.int64] = key("(N,) index of the colour of each pose")
    colours: tuple[Rgb, ...] = key("(r, g, b) from 0 to 1")

    def settings(self, commands: Commands) -> dict[str, Any]:
        """The settings from which the script of the page draws the arrows; arrays are stored in ``commands``."""
        from scipy.spatial import cKDTree

        # Arrows at neighbouring grasps must not overlap
        places, length = np.unique(np.round(self.poses[:, :3, 3], 4), axis=0), LONGEST
        if len(places) > 1:
            gaps = cKDTree(places).query(places, k=2)[0][:, 1]
            length = float(np.clip(SPACING_SHARE * np.median(gaps), SHORTEST, LONGEST))
        shape = arrow(length)
        columns = np.swapaxes(self.poses, 1, 2).astype(np.float32)  # three.js reads matrices by columns
        rgb = np.array(self.colours, dtype=float).reshape(-1, 3)[self.kinds]
        return {
            "length": round(length, 4),
            "vertices": commands.array(shape.vertices.astype(np.float32).ravel()),
            "normals": commands.array(shape.normals.astype(np.float32).ravel()),
            "triangles": commands.array(shape.triangles.astype(np.uint16).ravel()),
            "poses": commands.array(columns.ravel()),
            "rgb": commands.array(rgb.astype(np.float32).ravel()),
        }


@lru_cache(maxsize=4)
def arrow(length: float) -> Surface:
    """An arrow of the given length (m) along z that ends at the origin."""
    head_length, radius = 0.42 * length, 0.05 * length
    head = revolved([0, 0.17 * length, 0], [-head_length, -head_length, 0], sides=SIDES)
    shaft = revolved([0, radius, radius, 0], [-length, -length, -head_length, -head_length], sides=SIDES)
    bar, faces = box_triangles(0.5 * length, 2 * radius, 2 * radius)
    parts = [head, shaft, (bar - [0.0, 0.0, length], faces)]
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
    triangles = np.concatenate([faces + start for (_, faces), start in zip(parts, starts, strict=True)])
    return shade(np.concatenate([vertices for vertices, _ in parts]), triangles, (1, 1, 1, 1))


FRAME_SHARE = 0.11
"""Length of the axes of a frame, as a fraction of the radius of the picture."""

LABEL_DISTANCE = 0.2
"""Fraction of the length of an axis. The labels of frames that are closer to each other are stacked."""


def frame_names(stage: Drawing) -> list[str]:
    """The links whose frames are drawn: for each arm the base, the child link of each joint, and the tcp."""
    arm, joints = stage.arm, stage.arm.robot.urdf.joints
    names: dict[str, None] = {}
    for name, (base, tcp) in arm.ends.items():
        moved = [joints[arm.joint_names[i]].child for i in arm.indices(name)]
        names |= dict.fromkeys([base, *moved, tcp])
    return list(names)


def add_frames(commands: Commands, placed: Mapping[str, Array], reach: float) -> dict[str, Any]:
    """Place frames and return the settings from which the script of the page draws their axes and names.

    ``placed`` is ``root_from_frame`` (4, 4) by name, ``reach`` the radius (m) of the picture.
    """
    for name, pose in placed.items():
        commands.set_transform(node_path("frames", name), pose)
    length = round(FRAME_SHARE * reach, 4)
    origins = [pose[:3, 3] for pose in placed.values()]
    names = []
    for number, name in enumerate(placed):
        # The labels of frames with the same origin are stacked.
        below = sum(
            bool(np.linalg.norm(origin - origins[number]) < LABEL_DISTANCE * length) for origin in origins[:number]
        )
        names.append([node_path("frames", name).removeprefix("/frames/"), name, below])
    return {"names": names, "length": length}


CONTACT_RED, NORMAL_INK = theme.rgba("contact", 0.9), theme.rgba("normal")

BALL_SHARE, LEAST_BALL = 0.012, 0.004
"""Radius of the sphere that marks a contact: a fraction of the radius of the picture, and the least value in metres."""

MAX_MARKS = 50
"""Largest number of marked contacts; the caption states the total number."""


@dataclass(frozen=True, eq=False)
class Mark:
    """A contact: the names of the two bodies, their contact points (2, 3), and the normal (3,) if it is known."""

    bodies: tuple[str, str]
    points: Array
    normal: Array | None

    def draw(self, commands: Commands, number: int, radius: float) -> None:
        """Draw a sphere midway between the points, one on each point if they are apart, and an arrow along the normal.

        All are visible through other objects.
        """
        seen_through = {"type": "MeshBasicMaterial", "depthTest": False, "transparent": True}
        middle = self.points.mean(axis=0)
        node = ("contact", str(number))
        commands.set_surface(node_path(*node, "ball"), ball(middle, radius, CONTACT_RED), **seen_through)
        if np.linalg.norm(self.points[1] - self.points[0]) > radius:
            for side, point in enumerate(self.points):
                commands.set_surface(
                    node_path(*node, f"point {side}"), ball(point, 0.5 * radius, CONTACT_RED), **seen_through
                )
        if self.normal is None:
            return
        tip = middle + 9.0 * radius * self.normal
        shaft = tube(np.array([middle, tip - 3.0 * radius * self.normal]), 0.3 * radius, NORMAL_INK)
        head = cone(tip, self.normal, 0.9 * radius, 3.0 * radius, NORMAL_INK)
        for name, surface in (("shaft", shaft), ("head", head)):
            if surface is not None:
                commands.set_surface(node_path(*node, name), surface, **seen_through)


def marks_of(found: FirstContact | CheckResult | None) -> list[Mark]:
    """The contacts of a certificate or of a check, at most :data:`MAX_MARKS`."""
    if found is None:
        return []
    if isinstance(found, CheckResult):
        # The normal is zero for a sphere whose centre is on the axis of a cylinder, among others
        return [
            Mark(contact.bodies, contact.points, contact.normal if np.linalg.norm(contact.normal) > 0.5 else None)
            for contact in found.contacts[:MAX_MARKS]
        ]
    # A certificate has no normal. It is the direction from the first point to the second, reversed if the bodies
    # penetrate; points that coincide give no direction.
    gap = found.points[1] - found.points[0]
    apart = float(np.linalg.norm(gap))
    normal = None if apart < 1e-7 else np.sign(found.distance or 1.0) * gap / apart
    return [Mark(found.bodies, found.points, normal)]


def body_nodes(stage: Drawing, marks: Sequence[Mark]) -> list[list[str]]:
    """The nodes of all bodies in contact; attached objects belong to the node of the tcp link."""
    links, obstacles = {link.name for link in stage.links}, {obstacle.name for obstacle in stage.obstacles}
    found: dict[tuple[str, str], None] = {}
    for name in (body for mark in marks for body in mark.bodies):
        if name in links:
            found["robot", node_name(name)] = None
        elif name in obstacles:
            found["scene", node_name(name)] = None
        elif name not in stage.arm.robot.urdf.links:
            found.update({("robot", node_name(tcp)): None for _, tcp in stage.arm.ends.values() if tcp in links})
    return [list(node) for node in found]


SWEEP_TURN, SWEEP_SHARE, MOST_STEPS = np.deg2rad(25.0), 0.07, 40
"""Rotation (rad) and tcp displacement (as a fraction of the radius of the picture) between two drawn steps of the tool,
and the largest number of steps."""

SAME_POSE = 1e-4
"""Metres or matrix entries. Copies that differ by less are drawn once; often joints differ only by full rotations."""


def ghosts_at(stage: Drawing, q: Array) -> Array:
    """(k, L, 4, 4) ``root_from_link`` at the configurations q (m, n), without duplicates."""
    poses = np.array([stage.link_poses(configuration) for configuration in q]).reshape(-1, len(stage.links), 4, 4)
    return poses[_different(poses)] if len(poses) else poses


def copies(
    commands: Commands,
    stage: Drawing,
    poses: Array,
    into: str,
    *,
    opacity: float,
    hues: Sequence[Any] = (),
    own: Array | None = None,
) -> list[dict[str, Any]]:
    """The settings from which the script of the page draws transparent copies of links.

    ``poses`` (k, L, 4, 4) are ``root_from_link`` of the drawn links, NaN if a link is not copied; ``into`` is the
    parent node of the copies. ``hues`` are the colours of the k copies, used cyclically, by default those of the links.
    A copy with the same pose as another copy, or as its link at ``own`` (L, 4, 4), is left out.
    """
    # Copies that coincide with others, or with the arm itself, would only flicker
    found = []
    rgb = np.array([hues[k % len(hues)] for k in range(len(poses))], dtype=np.float32) if hues else None
    for number, link in enumerate(stage.links):
        placed = poses[:, number]
        if not link.surfaces or not len(placed) or np.isnan(placed).any():
            continue
        kept = _different(placed)
        if own is not None:
            kept = kept[(np.abs(placed[kept] - own[number]) > SAME_POSE).any(axis=(1, 2))]
        columns = np.swapaxes(placed[kept], 1, 2).astype(np.float32)  # three.js reads matrices by columns
        entry = {"into": into, "of": ["robot", node_name(link.name), "visual"], "count": len(kept), "opacity": opacity}
        entry["matrices"] = commands.array(columns.ravel())
        if rgb is not None:
            entry["rgb"] = commands.array(rgb[kept].ravel())
        if len(kept):
            found.append(entry)
    return found


def _different(poses: Array) -> npt.NDArray[np.int64]:
    """Indices of poses (k, ...) without duplicates, in order."""
    rounded = np.round(poses.reshape(len(poses), -1) / SAME_POSE).astype(np.int64)
    return np.sort(np.unique(rounded, axis=0, return_index=True)[1])


def swept(stage: Drawing, shown: Film, reach: float) -> Array:
    """(k, L, 4, 4) poses of the tool at several steps of a motion; NaN for all other links."""
    tool = stage.tool
    if len(shown.times) < 2 or not tool.any():
        return np.empty((0, len(stage.links), 4, 4))
    # The steps are evenly spaced in rotation and displacement of the tool, not in time
    rotation = shown.poses[:, tool, :3, :3]
    cosine = np.clip((np.einsum("flij,flij->fl", rotation[:-1], rotation[1:]).min(axis=1) - 1) / 2, -1.0, 1.0)
    shift = np.linalg.norm(np.diff(shown.tcps, axis=0), axis=2).max(axis=1)
    total = np.concatenate([[0.0], np.cumsum(shift / (SWEEP_SHARE * reach) + np.arccos(cosine) / SWEEP_TURN)])
    steps = int(np.clip(np.ceil(total[-1]), 1, MOST_STEPS)) + 1
    frames = np.unique(np.searchsorted(total, np.linspace(0.0, total[-1], steps)).clip(max=len(total) - 1))
    poses = shown.poses[frames].copy()
    poses[:, ~tool] = np.nan
    return poses


LEGEND_STEPS = 5
"""Number of colours in the legend."""


@described(eq=False)
class ColouredPoints:
    """Coloured points, such as a reach map or a scan.

    Raises
    ------
    InputError
        If the shape of an array is wrong, a number is not finite or out of range, or the size is not positive.
    """

    xyz: Array = key("(N, 3) metres, in the frame of the robot's root link")
    rgb: Array = key("(N, 3) in [0, 1]")
    size: float = key("diameter of the drawn points", "m", default=0.02)
    legend: tuple[tuple[str, tuple[float, float, float]], ...] = key(
        "(text, (r, g, b)) pairs that explain the colours", default=()
    )

    def __post_init__(self) -> None:
        xyz = finite("xyz", self.xyz, (None, 3))
        rgb = finite("rgb", self.rgb, (len(xyz), 3))
        if len(rgb) and (rgb.min() < 0.0 or rgb.max() > 1.0):
            raise InputError("rgb holds numbers outside [0, 1]")
        if not self.size > 0:
            raise InputError(f"size = {self.size}; the diameter in metres must be positive")
        object.__setattr__(self, "xyz", xyz)
        object.__setattr__(self, "rgb", rgb)
        object.__setattr__(self, "legend", tuple((str(text), tuple(colour)) for text, colour in self.legend))

    @classmethod
    def of_values(
        cls, xyz: npt.ArrayLike, values: npt.ArrayLike, *, label: str, low: float = 0.0, high: float = 1.0,
        colours: str = "viridis", size: float = 0.02,
    ) -> ColouredPoints:  # fmt: skip
        """Points coloured by ``values`` (N,) from ``low`` to ``high`` with the map ``colours``: "viridis" or "RdBu"."""
        stops = np.array([theme.rgb(f"#{stop}") for stop in theme.COLOUR_MAPS[colours].split()])
        share = (finite("values", values, (None,)) - low) / (high - low)
        steps = np.linspace(0.0, 1.0, LEGEND_STEPS)
        even = np.linspace(0.0, 1.0, len(stops))
        of_points, of_steps = (
            np.stack([np.interp(at, even, channel) for channel in stops.T], axis=1) for at in (share, steps)
        )
        legend = [
            (f"{label} {low + (high - low) * step:.3g}", (float(r), float(g), float(b)))
            for step, (r, g, b) in zip(steps, of_steps, strict=True)
        ]
        return cls(np.asarray(xyz, dtype=float), of_points, size, tuple(legend))

    def draw(self, commands: Commands) -> None:
        """Add the points to the commands of a picture."""
        if len(self.xyz):
            commands.set_points("/points", self.xyz, self.rgb, self.size)
            commands.set_property("/points/<object>", "castShadow", False)


FLOOR_GAP = 0.002
"""Metres that the floor is lowered, because two surfaces at the same height flicker."""

SQUARE = 0.25
"""Metres between the lines of the grid on the floor."""


def add_surroundings(commands: Commands, view: View, floor: float) -> None:
    """Add lights, a floor at height ``floor`` (m) that receives shadows, and a background."""
    low, high = view.points.min(axis=0), view.points.max(axis=0)
    centre, radius = (low + high) / 2, view.radius
    commands.set_property("/Background", "top_color", [*theme.rgb(theme.PICTURE["sky-top"])])
    commands.set_property("/Background", "bottom_color", [*theme.rgb(theme.PICTURE["sky-bottom"])])
    for unused in ("/Grid", "/Axes", "/Lights/PointLightNegativeX", "/Lights/PointLightPositiveX"):
        commands.set_property(unused, "visible", False)
    commands.set_property("/Lights/AmbientLight/<object>", "intensity", 0.14)
    # The hemisphere light keeps shapes visible in the shadow: it is brighter from above than from below.
    from_above = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 1, 1]
    ground = theme.number("ground-light")
    sky = {"color": 0xFFFFFF, "groundColor": ground, "intensity": 0.38, "matrix": from_above}
    commands.set_object("/Lights/SkyLight", "HemisphereLight", {}, **sky)
    commands.set_property("/Lights/SkyLight/<object>", "castShadow", False)
    commands.set_property("/Lights/FillLight/<object>", "intensity", 0.15)
    commands.set_property("/Lights/FillLight/<object>", "position", [float(v) for v in (*(-view.direction[:2]), 0.4)])
    # A directional light points at the origin. Its shadow is computed in a box that must contain all objects.
    reach = float(np.linalg.norm(centre)) + 1.5 * radius
    left = np.cross(view.direction, (0.0, 0.0, 1.0))
    source = 0.55 * view.direction + 0.45 * left + (0.0, 0.0, 0.9)
    source *= 2 * reach / np.linalg.norm(source)
    matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, *(float(v) for v in source), 1]
    box = {"uuid": "shadow", "type": "OrthographicCamera", "near": 0.1 * reach, "far": 4 * reach, "zoom": 1}
    box |= {"left": -reach, "right": reach, "top": reach, "bottom": -reach}
    shadow = {"mapSize": [2048, 2048], "bias": -0.0005, "normalBias": 0.01, "radius": 2.5, "camera": box}
    look = {"color": 0xFFFFFF, "intensity": 0.52, "matrix": matrix, "shadow": shadow}
    commands.set_object("/Lights/KeyLight", "DirectionalLight", {}, **look)
    # The floor is a disc with a grid, which is clipped at its edge
    root_from_floor, half = np.eye(4), max(2.0, np.ceil(2 * radius))
    root_from_floor[:3, 3] = (*(np.round(centre[:2] / SQUARE) * SQUARE), floor - FLOOR_GAP)
    disc = {"type": "CircleGeometry", "radius": half * 1.05, "segments": 96}
    commands.set_mesh("/floor/disc", disc, theme.rgba("floor"), specular=0, shininess=0)
    commands.set_transform("/floor", root_from_floor)
    lines, above = [], FLOOR_GAP / 4
    for offset in np.arange(-half, half + SQUARE / 2, SQUARE):
        end = np.sqrt(max(half**2 - offset**2, 0.0))
        lines += [(offset, -end, above), (offset, end, above), (-end, offset, above), (end, offset, above)]
    commands.set_lines("/floor/lines", np.array(lines), theme.rgba("floor-lines", 0.35))
