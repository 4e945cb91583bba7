"""Arrows that mark poses, each in the colour of its kind: where many picks grasp, and which of them are good.

Frames in the picture: axes with a name, at the links of the arm and wherever else they are told.

Contacts in the picture: where two bodies touch, and along which normal.

Faint copies of links: every branch of an IK answer as a ghost, and the tool at steps of its motion.

Coloured points in the picture: a reach map, a scan, the places of many picks.

Floor, background and light: they make shape and place readable and are no part of the scene.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import CheckResult, FirstContact
from pinproof.errors import InputError
from pinproof.spatial import finite
from pinproof.viewer.animation import Film
from pinproof.viewer.camera import View
from pinproof.viewer.stage import Stage
from pinproof.viewer.surfaces import Rgba, Surface, ball, cone, shade, tube
from pinproof.viewer.wire import Commands, node_path

__all__ = [
    "GHOST_HUES",
    "LONGEST",
    "ColouredPoints",
    "Mark",
    "PoseMarkers",
    "add_frames",
    "add_surroundings",
    "arrow",
    "body_nodes",
    "copies",
    "frame_names",
    "ghosts_at",
    "mark_radius",
    "marks_of",
    "swept",
]

Array = npt.NDArray[np.float64]
Rgb = tuple[float, float, float]

LONGEST, SHORTEST = 0.07, 0.015
"""Metres: an arrow, alone or in a crowd."""

SHARE = 0.9
"""An arrow is at most this share of the usual distance between neighbours long: beside each other, not a thicket."""

SIDES = 10
"""Sides of an arrow, which is drawn up to some thousand times."""


@dataclass(frozen=True, eq=False)
class PoseMarkers:
    """Poses and their kinds.

    Parameters
    ----------
    poses
        (N, 4, 4) ``root_from_tip``. The arrow ends at the tip and points along its z axis, the way it comes; the bar
        across its tail lies along the tip's x axis.
    kinds
        (N,) which of ``colours`` each has.
    colours
        0 to 1 each.
    """

    poses: Array
    kinds: npt.NDArray[np.int64]
    colours: tuple[Rgb, ...]

    def settings(self, commands: Commands) -> dict[str, Any]:
        """What the page's script draws them from; arrays go to ``commands``."""
        shape = arrow(self._length())
        columns = np.swapaxes(self.poses, 1, 2).astype(np.float32)  # three.js reads matrices by columns
        rgb = np.array(self.colours, dtype=float).reshape(-1, 3)[self.kinds]
        return {
            "length": round(self._length(), 4),
            "vertices": commands.array(shape.vertices.astype(np.float32).ravel()),
            "normals": commands.array(shape.normals.astype(np.float32).ravel()),
            "triangles": commands.array(shape.triangles.astype(np.uint16).ravel()),
            "poses": commands.array(columns.ravel()),
            "rgb": commands.array(rgb.astype(np.float32).ravel()),
        }

    def _length(self) -> float:
        from scipy.spatial import cKDTree

        places = np.unique(np.round(self.poses[:, :3, 3], 4), axis=0)
        if len(places) < 2:
            return LONGEST
        gaps = cKDTree(places).query(places, k=2)[0][:, 1]
        return float(np.clip(SHARE * np.median(gaps), SHORTEST, LONGEST))


@lru_cache(maxsize=4)
def arrow(length: float) -> Surface:
    """An arrow of a length (m) along z that ends at the origin."""
    from trimesh import creation, util

    head, thick = 0.42 * length, 0.05 * length
    cone = creation.cone(radius=0.17 * length, height=head, sections=SIDES)  # its disc lies at z = 0, its point above
    cone.apply_translation((0, 0, -head))
    shaft = creation.cylinder(radius=thick, height=length - head, sections=SIDES)
    shaft.apply_translation((0, 0, -(length + head) / 2))
    bar = creation.box(extents=(0.5 * length, 2 * thick, 2 * thick))
    bar.apply_translation((0, 0, -length))
    whole = util.concatenate([cone, shaft, bar])
    return shade(np.array(whole.vertices, dtype=float), np.array(whole.faces, dtype=np.int64), (1, 1, 1, 1))


FRAME_SHARE = 0.11
"""Length of a frame's axes, as a share of the picture's radius."""

NEAR = 0.2
"""Origins nearer than this share of an axis' length would have their names on each other."""


def frame_names(stage: Stage) -> list[str]:
    """The links whose frames are shown: base, what each joint of the arm moves, tcp."""
    joints = stage.arm.robot.urdf.joints
    return list(dict.fromkeys([stage.arm.base, *(joints[name].child for name in stage.arm.joint_names), stage.arm.tcp]))


def add_frames(commands: Commands, placed: Mapping[str, Array], reach: float) -> dict[str, Any]:
    """Place frames, (4, 4) ``root_from_frame`` by name; what the page's script draws their axes and names from.

    ``reach`` (m) is the picture's radius.
    """
    for name, pose in placed.items():
        commands.set_transform(node_path("frames", name), pose)
    length = round(FRAME_SHARE * reach, 4)
    origins = [pose[:3, 3] for pose in placed.values()]
    names = []
    for number, name in enumerate(placed):
        # names at one origin stand above each other
        below = sum(bool(np.linalg.norm(each - origins[number]) < NEAR * length) for each in origins[:number])
        names.append([node_path("frames", name).removeprefix("/frames/"), name, below])
    return {"names": names, "length": length}


CONTACT_RED: Rgba = (0.90, 0.05, 0.05, 0.9)
NORMAL_INK: Rgba = (0.10, 0.05, 0.05, 1.0)

BALL_SHARE, LEAST_BALL = 0.012, 0.004
"""Radius of the ball that marks a contact: this share of the picture's own radius, but so many metres at least."""

MOST_MARKS = 50
"""Contacts that are marked; the caption counts them all."""


@dataclass(frozen=True, eq=False)
class Mark:
    """A contact: the two bodies (links, attached objects, obstacles), their points (2, 3), the normal (3,) if known."""

    bodies: tuple[str, str]
    points: Array
    normal: Array | None

    def draw(self, commands: Commands, number: int, radius: float) -> None:
        """A ball midway between the points, one on each where they are apart, and an arrow along the normal.

        They are seen through whatever lies before them.
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
    """The contacts of a certificate or of a check, :data:`MOST_MARKS` at most."""
    if found is None:
        return []
    if isinstance(found, CheckResult):
        return [Mark(each.bodies, each.points, _direction(each.normal)) for each in found.contacts[:MOST_MARKS]]
    # A certificate tells no normal. It is the way from the first point to the second, or back where bodies overlap;
    # two points on one place show none.
    gap = found.points[1] - found.points[0]
    apart = float(np.linalg.norm(gap))
    normal = None if apart < 1e-7 else np.sign(found.distance or 1.0) * gap / apart
    return [Mark(found.bodies, found.points, normal)]


def _direction(normal: Array) -> Array | None:
    """A unit normal; None where there is none, as between a ball and a cylinder whose axis holds its centre."""
    return normal if np.linalg.norm(normal) > 0.5 else None


def mark_radius(reach: float) -> float:
    """Metres, of the ball of a mark in a picture of radius ``reach`` (m)."""
    return max(BALL_SHARE * reach, LEAST_BALL)


def body_nodes(stage: Stage, marks: Sequence[Mark]) -> list[list[str]]:
    """The nodes of all bodies in contact; an attached object is drawn with the tcp's link."""
    links, obstacles = {link.name for link in stage.links}, {obstacle.name for obstacle in stage.obstacles}
    found: dict[tuple[str, str], None] = {}
    for name in (body for mark in marks for body in mark.bodies):
        if name in links:
            found["robot", name] = None
        elif name in obstacles:
            found["scene", name] = None
        elif name not in stage.arm.robot.urdf.links and stage.arm.tcp in links:
            found["robot", stage.arm.tcp] = None
    return [list(node) for node in found]


SWEEP_TURN, SWEEP_SHARE, MOST_STEPS = np.deg2rad(25.0), 0.07, 40
"""The tool is drawn anew after this turn (rad), or a way of this share of the picture's radius; this often at most."""

GHOST_HUES = ((0.12, 0.47, 0.80), (0.90, 0.45, 0.10), (0.16, 0.58, 0.28), (0.72, 0.22, 0.55), (0.45, 0.36, 0.75),
              (0.75, 0.62, 0.10), (0.10, 0.60, 0.62), (0.78, 0.25, 0.22))  # fmt: skip
"""Colours that tell ghosts apart; they repeat."""
SAME_LOOK = 1e-4
"""Copies that differ by about this much (m, or matrix entries) are one: joints often differ by whole turns alone."""

SAME_PLACE = 1e-6
"""Links whose pose in the tcp frame changes by less (m, or matrix entries) move with the tool."""


def ghosts_at(stage: Stage, q: Array) -> Array:
    """(k, L, 4, 4) ``root_from_link`` at each of the configurations q (k, n), those once that look the same."""
    poses = np.array([stage.link_poses(each) for each in q]).reshape(-1, len(stage.links), 4, 4)
    return poses[_different(poses)] if len(poses) else poses


def copies(
    commands: Commands,
    stage: Stage,
    poses: Array,
    into: str,
    *,
    opacity: float,
    hues: Sequence[Any] = (),
    own: Array | None = None,
) -> list[dict[str, Any]]:
    """Faint copies of links, for the page's script.

    Parameters
    ----------
    commands
        Takes the arrays.
    poses
        (k, L, 4, 4) ``root_from_link`` of the drawn links; NaN where a link is not copied.
    into
        The node that holds them.
    hues
        A colour for each of the k, in turn; without, each mesh keeps its own.
    own
        (L, 4, 4) where the links themselves are: a copy on the same place is left out, as is one on another copy.
    """
    found = []
    rgb = np.array([hues[k % len(hues)] for k in range(len(poses))], dtype=np.float32) if hues else None
    for number, link in enumerate(stage.links):
        placed = poses[:, number]
        if not link.surfaces or not len(placed) or np.isnan(placed).any():
            continue
        kept = _different(placed)
        if own is not None:
            kept = kept[(np.abs(placed[kept] - own[number]) > SAME_LOOK).any(axis=(1, 2))]
        columns = np.swapaxes(placed[kept], 1, 2).astype(np.float32)  # three.js reads matrices by columns
        entry = {"into": into, "of": ["robot", link.name, "visual"], "count": len(kept), "opacity": opacity}
        entry["matrices"] = commands.array(columns.ravel())
        if rgb is not None:
            entry["rgb"] = commands.array(rgb[kept].ravel())
        if len(kept):
            found.append(entry)
    return found


def _different(poses: Array) -> npt.NDArray[np.int64]:
    """Which of poses (k, ...) are the first of their kind, in order."""
    same = np.round(poses.reshape(len(poses), -1) / SAME_LOOK).astype(np.int64)
    return np.sort(np.unique(same, axis=0, return_index=True)[1])


def _tool(stage: Stage) -> npt.NDArray[np.bool_]:
    """(L,) which drawn links are the tool: those that stand still in the tcp frame, else the last one before it."""
    rng = np.random.default_rng(0)
    arm, drawn = stage.arm, np.array([bool(link.surfaces) for link in stage.links])
    low, high = np.maximum(arm.limits.lower, arm.home - 1.0), np.minimum(arm.limits.upper, arm.home + 1.0)
    tried = [arm.home, *(low + rng.random((2, arm.dof)) * (high - low))]
    seen = np.stack([np.linalg.inv(stage.tcp_pose(q)) @ stage.link_poses(q) for q in tried])
    still = np.asarray((np.abs(seen - seen[0]) < SAME_PLACE).all(axis=(0, 2, 3))) & drawn
    names, at = [link.name for link in stage.links], arm.robot.urdf.parent_joint(arm.tcp)
    while not still.any() and at is not None:
        still = np.array([name == at.parent for name in names]) & drawn
        at = arm.robot.urdf.parent_joint(at.parent)
    return still


def swept(stage: Stage, shown: Film, reach: float) -> Array:
    """(k, L, 4, 4) the tool at steps of a motion, NaN for the links that are no part of it."""
    tool = _tool(stage)
    if len(shown.times) < 2 or not tool.any():
        return np.empty((0, len(stage.links), 4, 4))
    turning = shown.poses[:, int(np.flatnonzero(tool)[0]), :3, :3]
    cosine = np.clip((np.einsum("fij,fij->f", turning[:-1], turning[1:]) - 1) / 2, -1.0, 1.0)
    way = np.linalg.norm(np.diff(shown.tcp, axis=0), axis=1) / (SWEEP_SHARE * reach) + np.arccos(cosine) / SWEEP_TURN
    total = np.concatenate([[0.0], np.cumsum(way)])
    steps = int(np.clip(np.ceil(total[-1]), 1, MOST_STEPS)) + 1
    frames = np.unique(np.searchsorted(total, np.linspace(0.0, total[-1], steps)).clip(max=len(total) - 1))
    poses = shown.poses[frames].copy()
    poses[:, ~tool] = np.nan
    return poses


LEGEND_STEPS = 5
"""Colours that the legend names."""


@dataclass(frozen=True, eq=False)
class ColouredPoints:
    """Points and their colours.

    Parameters
    ----------
    xyz
        (N, 3) metres, in the frame of the robot's root link.
    rgb
        (N, 3) in [0, 1].
    size
        Metres: the diameter they are drawn with.
    legend
        (text, (r, g, b)) pairs that say what the colours mean.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, or the size is not above 0.
    """

    xyz: Array
    rgb: Array
    size: float = 0.02
    legend: tuple[tuple[str, tuple[float, float, float]], ...] = ()

    def __post_init__(self) -> None:
        xyz = finite("xyz", self.xyz, (None, 3))
        rgb = finite("rgb", self.rgb, (len(xyz), 3))
        if len(rgb) and (rgb.min() < 0.0 or rgb.max() > 1.0):
            raise InputError("rgb holds numbers outside [0, 1]")
        if not self.size > 0:
            raise InputError(f"size = {self.size}; it is a diameter in metres, above 0")
        object.__setattr__(self, "xyz", xyz)
        object.__setattr__(self, "rgb", rgb)
        object.__setattr__(self, "legend", tuple((str(text), tuple(colour)) for text, colour in self.legend))

    @classmethod
    def of_values(
        cls, xyz: npt.ArrayLike, values: npt.ArrayLike, *, label: str, low: float = 0.0, high: float = 1.0,
        colours: str = "viridis", size: float = 0.02,
    ) -> ColouredPoints:  # fmt: skip
        """Points coloured by ``values`` (N,) between ``low`` and ``high``; ``colours`` names a map of matplotlib."""
        from matplotlib import colormaps

        map_of = colormaps[colours]
        share = (finite("values", values, (None,)) - low) / (high - low)
        steps = np.linspace(0.0, 1.0, LEGEND_STEPS)
        legend = [(f"{label} {low + (high - low) * step:.3g}", tuple(map_of(step)[:3])) for step in steps]
        return cls(np.asarray(xyz, dtype=float), map_of(share.clip(0.0, 1.0))[:, :3], size, tuple(legend))

    def draw(self, commands: Commands) -> None:
        """Add the points to a picture."""
        if len(self.xyz):
            commands.set_points("/points", self.xyz, self.rgb, self.size)
            commands.set_property("/points/<object>", "castShadow", False)


FLOOR_GAP = 0.002
"""Metres between the floor and what stands on it: two surfaces at one height flicker."""

SQUARE = 0.25
"""Metres between two lines on the floor."""


def add_surroundings(commands: Commands, view: View, floor: float) -> None:
    """Light from the camera's left, a floor at height ``floor`` (m) that takes shadows, and a calm background."""
    low, high = view.points.min(axis=0), view.points.max(axis=0)
    centre, radius = (low + high) / 2, view.radius
    commands.set_property("/Background", "top_color", [0.85, 0.88, 0.91])
    commands.set_property("/Background", "bottom_color", [0.70, 0.74, 0.79])
    for unused in ("/Grid", "/Axes", "/Lights/PointLightNegativeX", "/Lights/PointLightPositiveX"):
        commands.set_property(unused, "visible", False)
    _light(commands, view, float(np.linalg.norm(centre)) + 1.5 * radius)
    _floor(commands, centre[:2], floor - FLOOR_GAP, max(2.0, np.ceil(2 * radius)))


def _light(commands: Commands, view: View, reach: float) -> None:
    commands.set_property("/Lights/AmbientLight/<object>", "intensity", 0.14)
    # From the sky more than from the floor: what lies in shadow keeps its shape.
    above = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 1, 1]
    sky = {"color": 0xFFFFFF, "groundColor": 0x8A8378, "intensity": 0.38, "matrix": above}
    commands.set_object("/Lights/SkyLight", "HemisphereLight", {}, **sky)
    commands.set_property("/Lights/SkyLight/<object>", "castShadow", False)
    commands.set_property("/Lights/FillLight/<object>", "intensity", 0.15)
    commands.set_property("/Lights/FillLight/<object>", "position", [float(v) for v in (*(-view.direction[:2]), 0.4)])
    # A directional light shines on the origin; its shadow is drawn in a box about it that must hold everything.
    left = np.cross(view.direction, (0.0, 0.0, 1.0))
    source = 0.55 * view.direction + 0.45 * left + (0.0, 0.0, 0.9)
    source *= 2 * reach / np.linalg.norm(source)
    matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, *(float(v) for v in source), 1]
    box = {"uuid": "shadow", "type": "OrthographicCamera", "near": 0.1 * reach, "far": 4 * reach, "zoom": 1}
    box |= {"left": -reach, "right": reach, "top": reach, "bottom": -reach}
    shadow = {"mapSize": [2048, 2048], "bias": -0.0005, "normalBias": 0.01, "radius": 2.5, "camera": box}
    look = {"color": 0xFFFFFF, "intensity": 0.52, "matrix": matrix, "shadow": shadow}
    commands.set_object("/Lights/KeyLight", "DirectionalLight", {}, **look)


def _floor(commands: Commands, centre: np.ndarray, height: float, half: float) -> None:
    root_from_floor = np.eye(4)
    root_from_floor[:3, 3] = (*(np.round(centre / SQUARE) * SQUARE), height)
    disc = {"type": "CircleGeometry", "radius": half * 1.05, "segments": 96}
    commands.set_mesh("/floor/disc", disc, (0.70, 0.73, 0.76, 1.0), specular=0, shininess=0)
    commands.set_transform("/floor", root_from_floor)
    lines, above = [], FLOOR_GAP / 4
    for offset in np.arange(-half, half + SQUARE / 2, SQUARE):
        reach = np.sqrt(max(half**2 - offset**2, 0.0))
        lines += [(offset, -reach, above), (offset, reach, above), (-reach, offset, above), (reach, offset, above)]
    commands.set_lines("/floor/lines", np.array(lines), (0.36, 0.41, 0.47, 0.35))
