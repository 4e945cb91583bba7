"""What stands on the stage: the robot's links, the obstacles and the path of the tcp, in the frame of the root link."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pinproof.collision import Obstacle, Scene
from pinproof.description import LinkGeometry
from pinproof.errors import MeshError
from pinproof.model import Arm
from pinproof.spatial import matrix
from pinproof.viewer.appearance import body_surfaces, link_surfaces, obstacle_surfaces
from pinproof.viewer.surfaces import Surface, merge_by_colour

__all__ = ["DrawnLink", "DrawnObstacle", "Stage", "set_stage"]

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
