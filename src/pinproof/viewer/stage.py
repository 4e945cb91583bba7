"""What a page draws: the links, obstacles and frames with their poses, and their motion as key frames of meshcat."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision import Mover, Obstacle, Scene
from pinproof.common.structs import described, key
from pinproof.description import LinkGeometry
from pinproof.errors import InputError, MeshError
from pinproof.ik import SelfMotionCurve
from pinproof.model import JointGroup
from pinproof.motion import Trajectory
from pinproof.spatial import Array, matrix
from pinproof.viewer.surfaces import (
    LEAST_AREA,
    Surface,
    body_surfaces,
    link_surfaces,
    merge_by_colour,
    obstacle_surfaces,
    shade,
)
from pinproof.viewer.wire import Commands, node_name, node_path

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
    def tools(self) -> list[dict[str, Any]]:
        """The tcp of each arm, for a camera that follows it: its pose in the nearest drawn link before it, at home."""
        drawn, tools = {link.name for link in self.links if link.surfaces}, []
        for arm, (_, tcp) in self.arm.ends.items():
            link, joint = tcp, self.arm.robot.urdf.parent_joint(tcp)
            while link not in drawn and joint is not None:
                link, joint = joint.parent, self.arm.robot.urdf.parent_joint(joint.parent)
            root_from_link, root_from_tcp = self.frame_poses(self.arm.home, [link, tcp])
            link_from_tcp = np.linalg.inv(root_from_link) @ root_from_tcp
            name = arm if len(self.arm.ends) > 1 else ""
            tools.append({"name": name, "node": ["robot", node_name(link)], "matrix": link_from_tcp.T.ravel().tolist()})
        return tools

    def nodes(self, names: Iterable[str | None]) -> list[list[str] | None]:
        """The nodes of obstacles in the tree of a page; None for other names."""
        known = {thing.name for thing in self.obstacles}
        return [["scene", node_name(name)] if name is not None and name in known else None for name in names]

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
    """The surfaces of all items whose meshes can be loaded and have an area, and the first problem with an item."""
    surfaces: list[Surface] = []
    problem = None
    for item in items:
        try:
            drawn = [surface for surface in draw(item) if len(surface.triangles)]
        except MeshError as error:
            problem = problem or str(error).splitlines()[0]
            continue
        if not drawn:
            problem = problem or f"it has no triangle of more than {LEAST_AREA / 2:g} m^2"
        surfaces += drawn
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


FRAME_RATE = 60.0
"""Key frames per second. The viewer interpolates in between (slerp); at 3 rad/s and 1 m the error is 0.3 mm."""

MAX_FRAMES = 3600
"""One minute at the full rate; longer motions have fewer key frames per second."""

REST = 1.0
"""Seconds that the last pose is shown before the motion starts again."""

MOVING_TOLERANCE = 1e-9
"""Metres or matrix entries. A link whose pose changes by less needs no track."""


@described(eq=False)
class FilmPhase:
    """A part of a motion with constant attached objects."""

    trajectory: Trajectory = key("starts where the previous phase ends")
    attached: tuple[Obstacle, ...] = key(
        "objects that move with the tcp of the first arm, in addition to those of the stage; poses are "
        "``tcp_from_object``",
        default=(),
    )
    held: Mapping[str, float] = key(
        "values (rad or m, by name) of joints outside the arm, such as fingers. Default: those of the arm of the stage",
        default_factory=dict,
    )
    movers: tuple[Mover, ...] = key(
        "the obstacles of the stage that move by themselves, as seen from the start of the phase", default=()
    )
    start: float | None = key(
        "when the phase starts, if the arm rests before it; by default the end of the previous phase", "s", default=None
    )


@described(eq=False)
class Film:
    """Key frames."""

    times: Array = key("(F,) seconds; F = 1 for a single configuration")
    poses: Array = key("(F, L, 4, 4) ``root_from_link`` of the drawn links")
    tcps: Array = key("(F, A, 3) positions of the tcps of the A arms in the root frame")
    riders: dict[str, Array] = key(
        "by name, (F, 4, 4) ``root_from_object`` of objects that are attached in some phases. Before and after, "
        "they rest where they are picked and placed",
        default_factory=dict,
    )
    frames: dict[str, Array] = key("by name, (F, 4, 4) ``root_from_frame`` of further links", default_factory=dict)
    moved: dict[str, Array] = key(
        "by name, (F, 4, 4) ``root_from_obstacle`` of the obstacles that a mover moves in some phases. They are not "
        "among the riders, also if they are attached in other phases",
        default_factory=dict,
    )


def checked_motion(arm: JointGroup, motion: Trajectory) -> Trajectory:
    """Return the motion; InputError if it has no timing or other joints than the arm."""
    if not hasattr(motion, "duration"):
        raise InputError(f"a {type(motion).__name__} has no timing; convert it to a trajectory with time_parametrise")
    if tuple(motion.joint_names) != arm.joint_names:
        moved, own = ", ".join(motion.joint_names), ", ".join(arm.joint_names)
        raise InputError(f"the trajectory has the joints {moved}, but the arm has {own}")
    return motion


def film(
    stage: Drawing,
    phases: Sequence[FilmPhase],
    *,
    rate: float = FRAME_RATE,
    most: int = MAX_FRAMES,
    frames: Sequence[str] = (),
) -> Film:
    """Key frames of a motion: ``rate`` per second, but at most about ``most``. ``frames`` names further links."""
    total = sum(phase.trajectory.duration for phase in phases)
    rate = min(rate, (most - 1) / max(total, 1e-9))
    scene = {thing.name: thing.pose for thing in stage.obstacles}
    times, poses, tcps, axes, holding = [], [], [], [], []
    moving: list[dict[str, Array]] = []
    end = -np.inf
    for phase in phases:
        motion, placed = phase.trajectory, replace(stage, arm=stage.arm.with_held(phase.held))
        start = max(end, 0.0) if phase.start is None else phase.start
        instants = np.linspace(0.0, motion.duration, int(np.ceil(motion.duration * rate)) + 1)
        if start <= end:  # the first instant is the last one of the previous phase
            instants = instants[1:]
        for q in np.asarray(motion(instants), dtype=float):
            poses.append(placed.link_poses(q))
            tcps.append(placed.tcp_poses(q))
            axes.append(placed.frame_poses(q, frames))
        times.append(start + instants)
        # The obstacles that movers move, and the objects in the hand
        moved_now: list[dict[str, Array]] = [{} for _ in instants]
        for mover in phase.movers:
            for placement, places in zip(mover.placements(instants), moved_now, strict=True):
                places.update({name: placement @ scene[name] for name in mover.obstacles if name in scene})
        moving += moved_now
        holding += [{thing.name: matrix(thing.pose) for thing in phase.attached}] * len(instants)
        end = start + motion.duration
    root_from_tcp = np.stack(tcps)
    # An obstacle that moves by itself is in the hand, where its mover puts it, or rests where it was last
    moved: dict[str, Array] = {}
    for name in dict.fromkeys(name for places in moving for name in places):
        track = [next(places[name] for places in moving if name in places)]
        for tcp, places, held in zip(root_from_tcp[:, 0], moving, holding, strict=True):
            track.append(tcp @ held[name] if name in held else places.get(name, track[-1]))
        moved[name] = np.array(track[1:])
    # Any other carried object rests at its pick pose before it is picked, and where it was last after it is placed
    riders: dict[str, Array] = {}
    for name in dict.fromkeys(name for held in holding for name in held if name not in moved):
        first = next(k for k, held in enumerate(holding) if name in held)
        track = [root_from_tcp[max(first - 1, 0), 0] @ holding[first][name]]  # picked at the end of the phase before
        for tcp, held in zip(root_from_tcp[:, 0], holding, strict=True):
            track.append(tcp @ held[name] if name in held else track[-1])
        riders[name] = np.array(track[1:])
    # The frames of further links, for the layer of frames
    named = dict(zip(frames, np.stack(axes).swapaxes(0, 1), strict=True))
    return Film(np.concatenate(times), np.stack(poses), root_from_tcp[:, :, :3, 3], riders, named, moved)


ELBOW_STEP = 0.03
"""Largest motion (rad or m) of a joint between key frames of a self-motion; the viewer interpolates in between."""


def film_of_elbow(stage: Drawing, curve: SelfMotionCurve, frames: Sequence[str] = ()) -> Film:
    """Key frames along a curve of IK solutions; the times are the values of its parameter minus the smallest one."""
    # Between the solutions of the curve, as many key frames as the fastest joint needs
    values = [curve.values[:1]]
    for low, high, before, after in zip(curve.values, curve.values[1:], curve.q, curve.q[1:], strict=False):
        parts = int(np.ceil(np.abs(after - before).max() / ELBOW_STEP))
        values.append(np.linspace(low, high, max(parts, 1) + 1)[1:])
    parameters = np.concatenate(values)
    return film_at(stage, parameters - curve.lower, [curve.at(value) for value in parameters.tolist()], frames)


def film_at(stage: Drawing, times: Array, configurations: Iterable[Array], frames: Sequence[str] = ()) -> Film:
    """Key frames at these times (F,) and configurations (F, n), without carried objects."""
    rows = [(stage.link_poses(q), stage.tcp_poses(q)[:, :3, 3], stage.frame_poses(q, frames)) for q in configurations]
    poses, tcps, named = (np.stack(part) for part in zip(*rows, strict=True))
    return Film(times, poses, tcps, frames=dict(zip(frames, named.swapaxes(0, 1), strict=True)))


def still(stage: Drawing, q: Array, *, frames: Sequence[str] = ()) -> Film:
    """A single key frame at the configuration q (n,)."""
    return film_at(stage, np.zeros(1), [q], frames)


def tracks(
    commands: Commands, stage: Drawing, shown: Film, places: dict[str, str] | None = None, *, rest: float = REST
) -> list[dict[str, Any]]:
    """The tracks of all links and carried objects that move, in the form that meshcat's ``set_animation`` expects.

    ``places`` is the node of each carried object by name; objects without a node are left out. ``rest`` is the time (s)
    for which the last pose is shown. A clip is repeated after its last key frame, so all clips end at the same time.
    """
    times = np.append(shown.times, shown.times[-1] + rest).astype(np.float32)
    moving = [(node_path("robot", link.name), shown.poses[:, k]) for k, link in enumerate(stage.links)]
    moving += [(node_path("frames", name), poses) for name, poses in shown.frames.items()]
    moving += [(node_path("scene", name), poses) for name, poses in shown.moved.items()]
    moving += [(path, shown.riders[name]) for name, path in (places or {}).items() if name in shown.riders]
    animations = []
    for path, poses in moving:
        # The viewer interpolates between key frames, so those inside a rest are not needed
        changed = (np.abs(np.diff(poses, axis=0)) > MOVING_TOLERANCE).any(axis=(1, 2))
        keep = np.append([True], changed) | np.append(changed, True)
        poses, keep = np.concatenate([poses[keep], poses[-1:]]), np.append(keep, True)
        values = {}
        if np.ptp(poses[:, :3, 3], axis=0).max() > MOVING_TOLERANCE:
            values[".position", "vector3"] = poses[:, :3, 3]
        if np.ptp(poses[:, :3, :3], axis=0).max() > MOVING_TOLERANCE:
            values[".quaternion", "quaternion"] = quaternions(poses[:, :3, :3])
        stamps = commands.array(times[keep]) if values else {}
        made = [
            {"name": name, "type": kind, "times": stamps, "values": commands.array(rows.astype(np.float32).ravel())}
            for (name, kind), rows in values.items()
        ]
        # The time unit of a clip is one frame; with one frame per second, times are in seconds
        if made:
            animations.append({"path": path, "clip": {"fps": 1, "name": "motion", "tracks": made}})
    return animations


def quaternions(rotations: Array) -> Array:
    """(N, 4) quaternions x, y, z, w of rotation matrices (N, 3, 3); those of neighbours have the same sign."""
    rows = np.array([pin.Quaternion(rotation).coeffs() for rotation in rotations])
    flips = np.einsum("ij,ij->i", rows[1:], rows[:-1]) < 0
    rows[1:] *= np.where(np.cumsum(flips) % 2, -1.0, 1.0)[:, None]
    return rows
