"""The surfaces of all links and obstacles of a picture, in the frame of the root link.

:func:`simplified` reduces the detail of the meshes where a page would otherwise be too large.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pinproof.collision import Obstacle, Scene
from pinproof.description import LinkGeometry
from pinproof.errors import MeshError
from pinproof.model import JointGroup
from pinproof.spatial import Array, matrix
from pinproof.viewer.surfaces import Surface, body_surfaces, link_surfaces, merge_by_colour, obstacle_surfaces, shade

MAX_BYTES = 10e6
"""Size of all meshes of a page in base64. With the viewer (1 MB) and a motion, the page is then below 15 MB."""

CELLS = (0.0005, 0.001, 0.002, 0.003, 0.005, 0.008, 0.012, 0.020, 0.035, 0.060)
"""Cell sizes (m) of the simplification grid, tried in this order. The effect of the first is not visible."""

MIN_TRIANGLES = 1500
"""Surfaces with fewer triangles are not simplified."""


RIGID_TOLERANCE = 1e-6
"""Metres or matrix entries. Links whose pose in the tcp frame changes by less belong to the tool."""


@dataclass(frozen=True, eq=False)
class DrawnLink:
    """A link with its visual surfaces and, if requested, those of its collision geometry, in the frame of the link."""

    name: str
    surfaces: tuple[Surface, ...]
    bodies: tuple[Surface, ...] = ()


@dataclass(frozen=True, eq=False)
class DrawnObstacle:
    """An obstacle with its surfaces in its own frame, and its pose ``root_from_obstacle`` (4, 4)."""

    name: str
    surfaces: tuple[Surface, ...]
    pose: Array


@dataclass(frozen=True, eq=False)
class Drawing:
    """The links and obstacles of a picture; ``notes`` states what could not be drawn, or not in full detail."""

    arm: JointGroup
    links: tuple[DrawnLink, ...]
    obstacles: tuple[DrawnObstacle, ...]
    notes: tuple[str, ...]

    def link_poses(self, q: Array) -> Array:
        """(L, 4, 4) ``root_from_link`` of the drawn links at the configuration q (n,)."""
        return self.frame_poses(q, [link.name for link in self.links])

    def frame_poses(self, q: Array, names: Sequence[str]) -> Array:
        """(K, 4, 4) ``root_from_frame`` of any links at the configuration q (n,)."""
        poses = [matrix(self.arm.root_from_frame(q, name)) for name in names]
        return np.array(poses).reshape(-1, 4, 4)

    def tcp_poses(self, q: Array) -> Array:
        """(A, 4, 4) ``root_from_tcp`` of each arm at the configuration q (n,)."""
        return np.array([matrix(pose) for pose in self.arm.tcp_placements(q).values()])

    @cached_property
    def tool(self) -> npt.NDArray[np.bool_]:
        """(L,) which links belong to a tool: the drawn ones fixed in a tcp frame, else the last one before it."""
        rng = np.random.default_rng(0)
        arm, names = self.arm, [link.name for link in self.links]
        own = np.array([name in arm.robot.urdf.links for name in names])  # a page also draws groups of arrows
        drawn = np.array([bool(link.surfaces) for link in self.links]) & own
        low, high = np.maximum(arm.limits.lower, arm.home - 1.0), np.minimum(arm.limits.upper, arm.home + 1.0)
        # Three configurations tell apart what moves with the tcp and what does not
        samples = [arm.home, *(low + rng.random((2, arm.dof)) * (high - low))]
        moving = [name for name, is_own in zip(names, own, strict=True) if is_own]
        poses = np.stack([self.frame_poses(q, moving) for q in samples])
        tools = np.zeros(len(names), dtype=bool)
        for number, (_, tcp) in enumerate(arm.ends.values()):
            inverse = np.linalg.inv([self.tcp_poses(q)[number] for q in samples])
            tcp_from_link = inverse[:, None] @ poses
            fixed = np.zeros(len(names), dtype=bool)
            fixed[own] = (np.abs(tcp_from_link - tcp_from_link[0]) < RIGID_TOLERANCE).all(axis=(0, 2, 3))
            fixed, joint = fixed & drawn, arm.robot.urdf.parent_joint(tcp)
            # Nothing is drawn at the tcp itself: the nearest drawn link before it is the tool
            while not fixed.any() and joint is not None:
                fixed = np.array([name == joint.parent for name in names]) & drawn
                joint = arm.robot.urdf.parent_joint(joint.parent)
            tools |= fixed
        return tools

    def floor(self, poses: Array) -> float:
        """Height (m) of the floor: the lowest point of all obstacles and of links at poses (F, L, 4, 4), at most 0."""
        lowest = [float((s.vertices @ o.pose[2, :3] + o.pose[2, 3]).min()) for o in self.obstacles for s in o.surfaces]
        for link, root_from_link in zip(self.links, np.moveaxis(poses, 1, 0), strict=True):
            if link.surfaces:
                corners = box_corners(link.surfaces)
                lowest.append(float((root_from_link[:, 2, :3] @ corners.T + root_from_link[:, 2, 3:]).min()))
        return min([0.0, *lowest])


def box_corners(surfaces: Iterable[Surface]) -> Array:
    """(8, 3) the corners of the box around surfaces, with edges along the axes."""
    points = np.concatenate([surface.vertices for surface in surfaces])
    low, high = points.min(axis=0), points.max(axis=0)
    return np.where(np.indices((2, 2, 2)).reshape(3, 8).T == 0, low, high)


def set_stage(
    arm: JointGroup, scene: Scene | None, attached: Sequence[Obstacle] = (), *, bodies: bool = False
) -> Drawing:
    """Load the surfaces of an arm and a scene, and with ``bodies`` those of the collision geometry of the links too.

    A mesh that cannot be loaded is left out and named in ``notes``; ViewerError if a shape cannot be drawn.
    ``attached`` are objects that are drawn with the link of the tcp; their pose is ``tcp_from_object``.
    """
    notes: list[str] = []
    visuals, collisions = _by_link(arm.robot.urdf.visuals), _by_link(arm.robot.urdf.collisions)
    links = []
    for name in arm.robot.urdf.links:
        surfaces, problem = _load_surfaces(visuals.get(name, ()), link_surfaces)
        # Without a visual, the collision geometry is better than nothing
        if not surfaces and (not visuals or problem):
            surfaces, second_problem = _load_surfaces(collisions.get(name, ()), link_surfaces)
            if surfaces and problem:
                notes.append(f"{name} is drawn with its collision geometry: {problem}")
            problem = second_problem if surfaces else problem or second_problem
        if problem:
            notes.append(f"{name} is {'only partly' if surfaces else 'not'} drawn: {problem}")
        # Objects in the hand of an arm are drawn with the link of its tcp
        for item in (item for item in attached if arm.tcp_of(item.arm) == name):
            parts, problem = _load_surfaces((item,), obstacle_surfaces)
            surfaces = [*surfaces, *(part.moved(matrix(item.pose)) for part in parts)]
            if problem:
                notes.append(f"attached {item.name} is not drawn: {problem}")
        # The collision geometry is a layer of its own
        collision, problem = _load_surfaces(collisions.get(name, ()) if bodies else (), body_surfaces)
        if problem:
            notes.append(f"the collision geometry of {name} is not drawn: {problem}")
        if surfaces or collision:
            links.append(DrawnLink(name, tuple(merge_by_colour(surfaces)), tuple(merge_by_colour(collision))))
    # An obstacle whose mesh is missing is left out, which a note states
    obstacles = []
    for obstacle in scene.obstacles if scene is not None else ():
        surfaces, problem = _load_surfaces((obstacle,), obstacle_surfaces)
        if problem:
            notes.append(f"obstacle {obstacle.name} is not drawn: {problem}")
        else:
            obstacles.append(DrawnObstacle(obstacle.name, tuple(surfaces), matrix(obstacle.pose)))
    return Drawing(arm, tuple(links), tuple(obstacles), tuple(notes))


def _by_link(geometries: Sequence[LinkGeometry]) -> dict[str, list[LinkGeometry]]:
    groups: dict[str, list[LinkGeometry]] = {}
    for geometry in geometries:
        groups.setdefault(geometry.link, []).append(geometry)
    return groups


def _load_surfaces(items: Sequence[object], draw: Callable[..., list[Surface]]) -> tuple[list[Surface], str | None]:
    """The surfaces of all items whose meshes can be loaded, and the first problem with a mesh."""
    surfaces: list[Surface] = []
    problem = None
    for item in items:
        try:
            surfaces += draw(item)
        except MeshError as error:
            problem = problem or str(error).splitlines()[0]
    return surfaces, problem


def size_in_bytes(stage: Drawing) -> float:
    """Size of the surfaces in a page: 15 bytes for each vertex, 2 or 4 for each index, in base64."""
    drawn = [surface for link in stage.links for surface in (*link.surfaces, *link.bodies)]
    drawn += [surface for obstacle in stage.obstacles for surface in obstacle.surfaces]
    wide = [4 if len(surface.vertices) > np.iinfo(np.uint16).max else 2 for surface in drawn]
    return 4 / 3 * sum(15 * len(s.vertices) + index * s.triangles.size for s, index in zip(drawn, wide, strict=True))


def simplified(stage: Drawing, max_bytes: float = MAX_BYTES) -> Drawing:
    """The stage with surfaces that together fit into ``max_bytes``; a note states the simplification.

    All vertices in a cell of a grid are replaced by their mean, and triangles with two vertices in the same cell are
    removed (J. Rossignac and P. Borrel, 1993, "Multi-resolution 3D approximations for rendering complex scenes").
    Collision checks always use the original meshes.
    """

    def merged(surface: Surface, cell: float) -> Surface:
        if len(surface.triangles) < MIN_TRIANGLES or surface.image is not None:  # it would distort a texture
            return surface
        grid = np.floor(surface.vertices / cell).astype(np.int64)
        _, cell_of, count = np.unique(grid, axis=0, return_inverse=True, return_counts=True)
        cell_of = cell_of.reshape(-1)
        means = np.column_stack([np.bincount(cell_of, surface.vertices[:, axis]) for axis in range(3)])
        corners = cell_of[surface.triangles]
        # Triangles with two corners in one cell have no area, and equal ones are drawn once
        proper = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
        _, first = np.unique(np.sort(corners[proper], axis=1), axis=0, return_index=True)
        kept = corners[proper][first]
        return shade(means / count[:, None], kept, surface.rgba) if len(kept) else surface

    result, used_cell = stage, 0.0
    for cell in CELLS:
        if size_in_bytes(result) <= max_bytes:
            break
        links = [
            replace(
                link,
                surfaces=tuple(merged(surface, cell) for surface in link.surfaces),
                bodies=tuple(merged(surface, cell) for surface in link.bodies),
            )
            for link in stage.links
        ]
        obstacles = [
            replace(thing, surfaces=tuple(merged(surface, cell) for surface in thing.surfaces))
            for thing in stage.obstacles
        ]
        result, used_cell = replace(stage, links=tuple(links), obstacles=tuple(obstacles)), cell
    if result is stage:
        return stage
    note = (
        f"Meshes are simplified for display, to details of {used_cell * 1e3:g} mm; checks and proofs use the original "
        "meshes."
    )
    return replace(result, notes=(*stage.notes, note))
