"""What stands on the stage: the robot's links, the obstacles and the path of the tcp, in the frame of the root link.

Meshes made coarser for show, where a page would otherwise be too large to send or to open.
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
from pinproof.model import Arm
from pinproof.spatial import matrix
from pinproof.viewer.surfaces import Surface, body_surfaces, link_surfaces, merge_by_colour, obstacle_surfaces, shade

__all__ = ["MOST_BYTES", "DrawnLink", "DrawnObstacle", "Stage", "set_stage", "simplified"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DrawnLink:
    """A link, its surfaces and, where they were asked for, the bodies it collides with, all in its own frame."""

    name: str
    surfaces: tuple[Surface, ...]
    bodies: tuple[Surface, ...] = ()


@dataclass(frozen=True, eq=False)
class DrawnObstacle:
    """An obstacle, its surfaces in its own frame, and ``root_from_obstacle`` (4, 4)."""

    name: str
    surfaces: tuple[Surface, ...]
    pose: Array


@dataclass(frozen=True, eq=False)
class Stage:
    """Everything that is drawn, and ``notes``: what is not, or not as its file means it to be."""

    arm: Arm
    links: tuple[DrawnLink, ...]
    obstacles: tuple[DrawnObstacle, ...]
    notes: tuple[str, ...]

    def link_poses(self, q: Array) -> Array:
        """(L, 4, 4) ``root_from_link`` of the drawn links at the configuration q (n,)."""
        return self.frame_poses(q, [link.name for link in self.links])

    def frame_poses(self, q: Array, names: Sequence[str]) -> Array:
        """(K, 4, 4) ``root_from_frame`` of links, drawn or not, at the configuration q (n,)."""
        root_from_base = self.arm.root_from_base
        placed = [matrix(root_from_base * self.arm.frame_placement(q, name)) for name in names]
        return np.array(placed).reshape(-1, 4, 4)

    def tcp_position(self, q: Array) -> Array:
        """(3,) the tcp at the configuration q (n,), in metres."""
        return self.tcp_pose(q)[:3, 3]

    def tcp_pose(self, q: Array) -> Array:
        """(4, 4) ``root_from_tcp`` at the configuration q (n,)."""
        return matrix(self.arm.root_from_base * self.arm.forward_kinematics(q))

    @cached_property
    def floor(self) -> float:
        """Height (m) of the ground: under the lowest obstacle, and never above the robot's root."""
        lowest = [float((s.vertices @ o.pose[2, :3] + o.pose[2, 3]).min()) for o in self.obstacles for s in o.surfaces]
        return min([0.0, *lowest])


def set_stage(arm: Arm, scene: Scene | None, attached: Sequence[Obstacle] = (), *, bodies: bool = False) -> Stage:
    """Load every picture; what cannot be loaded is left out and named in ``notes``, never dropped in silence.

    ``attached`` objects (their pose is ``tcp_from_object``) are drawn with the link that is the tcp. ``bodies`` also
    loads what links collide with.
    """
    notes: list[str] = []
    visuals, collisions = _by_link(arm.robot.urdf.visuals), _by_link(arm.robot.urdf.collisions)
    bare = not visuals  # then what is collided with is all there is to see
    links = []
    for name in arm.robot.urdf.links:
        surfaces, problem = _pictures(visuals.get(name, ()), link_surfaces)
        if not surfaces and (bare or problem):
            surfaces, second = _pictures(collisions.get(name, ()), link_surfaces)
            if surfaces and problem:
                notes.append(f"{name} is drawn by its collision geometry: {problem}")
            problem = second if surfaces else problem or second
        if problem:
            notes.append(f"{name} is not drawn{' whole' if surfaces else ''}: {problem}")
        for thing in attached if name == arm.tcp else ():
            parts, lost = _pictures((thing,), obstacle_surfaces)
            surfaces = [*surfaces, *(part.moved(matrix(thing.pose)) for part in parts)]
            if lost:
                notes.append(f"attached {thing.name} is not drawn: {lost}")
        solid, unusable = _pictures(collisions.get(name, ()) if bodies else (), body_surfaces)
        if unusable:
            notes.append(f"the collision geometry of {name} is not drawn: {unusable}")
        if surfaces or solid:
            links.append(DrawnLink(name, tuple(merge_by_colour(surfaces)), tuple(merge_by_colour(solid))))
    obstacles = []
    for obstacle in scene.obstacles if scene is not None else ():
        surfaces, problem = _pictures((obstacle,), obstacle_surfaces)
        if problem:
            notes.append(f"obstacle {obstacle.name} is not drawn: {problem}")
        else:
            obstacles.append(DrawnObstacle(obstacle.name, tuple(surfaces), matrix(obstacle.pose)))
    return Stage(arm, tuple(links), tuple(obstacles), tuple(notes))


def _by_link(geometries: Sequence[LinkGeometry]) -> dict[str, list[LinkGeometry]]:
    groups: dict[str, list[LinkGeometry]] = {}
    for geometry in geometries:
        groups.setdefault(geometry.link, []).append(geometry)
    return groups


def _pictures(things: Sequence[object], draw: Callable[..., list[Surface]]) -> tuple[list[Surface], str | None]:
    """The surfaces of all that can be drawn, and the first reason why something cannot."""
    surfaces: list[Surface] = []
    problem = None
    for thing in things:
        try:
            surfaces += draw(thing)
        except MeshError as error:
            problem = problem or str(error).splitlines()[0]
    return surfaces, problem


MOST_BYTES = 10e6
"""Of all meshes of a page, as text; with the viewer (1 MB) and a motion it stays below 15 MB."""

CELLS = (0.0005, 0.001, 0.002, 0.003, 0.005, 0.008, 0.012, 0.020, 0.035, 0.060)
"""Metres, tried in turn: points that share a cell of this size become one. The first is never seen."""

FINE = 1500
"""Triangles; a surface with fewer is left as it is."""


def simplified(stage: Stage, most: float = MOST_BYTES) -> Stage:
    """The stage with surfaces so coarse that all of them fit into so many bytes; its notes say so.

    Points in one cell of a grid become their mean, and triangles that thereby lose a corner vanish (J. Rossignac and
    P. Borrel, 1993, "Multi-resolution 3D approximations for rendering complex scenes"). What checks see stays as it is.
    """
    made, used = stage, 0.0
    for cell in CELLS:
        if _bytes(made) <= most:
            break
        made, used = _coarser(stage, cell), cell
    if made is stage:
        return stage
    said = f"Meshes are simplified for show, to details of {used * 1e3:g} mm; checks and proofs use them as they are."
    return replace(made, notes=(*stage.notes, said))


def _bytes(stage: Stage) -> float:
    """What the surfaces take in a page: 15 bytes a vertex, indices of 2 or 4, as base64."""
    return (
        4
        / 3
        * sum(
            15 * len(each.vertices) + (4 if len(each.vertices) > np.iinfo(np.uint16).max else 2) * each.triangles.size
            for each in _surfaces(stage)
        )
    )


def _surfaces(stage: Stage) -> Iterable[Surface]:
    for link in stage.links:
        yield from (*link.surfaces, *link.bodies)
    for obstacle in stage.obstacles:
        yield from obstacle.surfaces


def _coarser(stage: Stage, cell: float) -> Stage:
    def merged(surfaces: tuple[Surface, ...]) -> tuple[Surface, ...]:
        return tuple(_merged(each, cell) for each in surfaces)

    links = tuple(replace(link, surfaces=merged(link.surfaces), bodies=merged(link.bodies)) for link in stage.links)
    obstacles = tuple(replace(each, surfaces=merged(each.surfaces)) for each in stage.obstacles)
    return replace(stage, links=links, obstacles=obstacles)


def _merged(surface: Surface, cell: float) -> Surface:
    if len(surface.triangles) < FINE or surface.image is not None:  # a picture would no longer lie where it should
        return surface
    grid = np.floor(surface.vertices / cell).astype(np.int64)
    _, kind, count = np.unique(grid, axis=0, return_inverse=True, return_counts=True)
    kind = kind.reshape(-1)
    means = np.column_stack([np.bincount(kind, surface.vertices[:, axis]) for axis in range(3)]) / count[:, None]
    corners = kind[surface.triangles]
    whole = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    _, first = np.unique(np.sort(corners[whole], axis=1), axis=0, return_index=True)
    kept = corners[whole][first]
    return shade(means, kept, surface.rgba) if len(kept) else surface
