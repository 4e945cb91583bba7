"""The parts of a checker: its bodies and checked pairs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof._core import Geometry, JointTree, World
from pinproof.collision.checking.links import DECOMPOSED, EXACT
from pinproof.collision.checking.pairs import ALLOWED_BY_CALLER, ExcludedPair, FinerPair, PairRules, Pairs, choose_pairs
from pinproof.collision.checking.spec import CheckerSpec, Levels, Pair
from pinproof.collision.geometry.bodies import Body, shape_bodies
from pinproof.collision.geometry.shapes import Mesh, Obstacle
from pinproof.errors import InputError
from pinproof.model import Arm, JointGroup
from pinproof.spatial import Array
from pinproof.units import FAR, MOST_REACH, warn_of_millimetres

Indices = npt.NDArray[np.int64]

ROUNDING = 1e-9
"""Allowance (m) for floating-point error in placements and supports, for each metre of extent of the scene (observed:
3e-9 m at 100 m). It is subtracted from every distance before it is compared with a margin."""

Known = dict[tuple[int, str | None], tuple[Obstacle, tuple[Body, ...]]]
"""Cache of obstacle bodies, by identity of the obstacle (of which it keeps a reference) and its link."""

ARMS_KEPT = 8
"""Number of arms whose joints are kept; several checkers are often made for one arm."""

ROOT = -1
"""In place of a joint: the body does not move."""

LARGEST_MESH = 30.0
"""Metres. A larger mesh, with no side below a metre, is assumed to be in millimetres."""

LARGEST_SMALL_PART = 3.0
"""Metres. No link or tool up to this length is assumed to be in millimetres, however small the rest of the robot is."""


def pack_geometry(arm: JointGroup, bodies: Sequence[Body], rounding: float) -> Geometry:
    """Return the joints of an arm's robot and the bodies on them, obstacles last.

    ``rounding`` is the allowance (m) for floating-point errors.
    """
    tree, links = _joints(arm)
    joints, placements = [], np.zeros((len(bodies), 4, 4))
    for i, body in enumerate(bodies):
        joint, place = ROOT, body.link_from_body
        if body.link is not None:
            joint, above = links[body.link]
            place = above * place
        joints.append(joint)
        placements[i] = place.homogeneous
    robot = sum(body.link is not None for body in bodies)
    return Geometry(tree, [body.core_shape for body in bodies], joints, placements, robot, rounding)


def pack_world(geometry: Geometry, pairs: Sequence[tuple[int, int]]) -> World:
    """Return the world of these pairs of bodies, of which the first is the robot's, with margins of 0."""
    return World(geometry, np.array(pairs, dtype=np.int64).reshape(-1, 2), np.zeros(len(pairs)))


@lru_cache(maxsize=ARMS_KEPT)
def _joints(arm: JointGroup) -> tuple[JointTree, dict[str, tuple[int, pin.SE3]]]:
    """Return the joints, whose axis is z, and for each link the joint that moves it and its placement there."""
    model = arm.model
    data = model.createData()
    columns = pin.computeJointJacobians(model, data, pin.neutral(model)).reshape(6, -1)
    count = model.njoints - 1
    prismatic = (~columns[3:].any(axis=0)).tolist()
    leaders = np.abs(arm.scale).argmax(axis=1)
    parents = [int(parent) - 1 for parent in model.parents[1:]]
    aligned: list[pin.SE3] = []
    placements = np.zeros((count, 4, 4))
    for k in range(count):
        axis = data.oMi[k + 1].rotation.T @ (columns[:3, k] if prismatic[k] else columns[3:, k])
        turned = pin.SE3(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis), np.zeros(3))
        aligned.append(turned)
        above = pin.SE3.Identity() if parents[k] < 0 else aligned[parents[k]].inverse()
        placements[k] = (above * model.jointPlacements[k + 1] * turned).homogeneous
    multipliers = np.ascontiguousarray(arm.scale[np.arange(count), leaders])
    offsets = np.ascontiguousarray(arm.offset, dtype=float)
    tree = JointTree(placements, prismatic, leaders.tolist(), multipliers, offsets, parents, arm.dof)
    links: dict[str, tuple[int, pin.SE3]] = {}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.name not in links:
            k = int(frame.parentJoint) - 1
            links[frame.name] = k, pin.SE3(frame.placement) if k < 0 else aligned[k].inverse() * frame.placement
    return tree, links


def finer_levels(touching: Callable[[Levels], Collection[Pair]], levels: Levels) -> dict[Pair, int]:
    """Return levels of detail at which only those pairs of owners touch whose exact meshes touch.

    Each pair gets the coarsest level on which it does not touch, because convex bodies are checked in compiled code. A
    pair that touches on every level keeps its level: the contact is real, and finer bodies would only cost time.
    ``touching`` returns the pairs in contact at given levels for which finer bodies exist; ``levels`` are the present
    ones, where not 0.
    """
    found = dict(levels)
    open_pairs = set(touching(levels))
    for level in (DECOMPOSED, EXACT):
        if raised := {pair for pair in open_pairs if found.get(pair, 0) < level}:
            found.update(dict.fromkeys(raised, level))
            open_pairs &= set(touching(found))
    for pair in open_pairs:
        found.pop(pair)
        if pair in levels:
            found[pair] = levels[pair]
    return found


def only_arm(group: JointGroup) -> Arm:
    """Return the arm of a joint group with one arm; InputError if it has several."""
    if isinstance(group, Arm):
        return group
    if len(group.ends) > 1:
        raise InputError(
            f"this requires one arm; the checker is for the arms {', '.join(group.ends)}. Create a checker of "
            "group.arms[name]"
        )
    return next(iter(group.arms.values()))


class CheckedBodies:
    """The bodies, pairs and margins of a checker: the part of it that the workspaces of its threads read."""

    _spec: CheckerSpec
    _geometry_model: Any = None
    bodies: tuple[Body, ...]
    """Links, attached objects and obstacles."""
    pairs: tuple[tuple[int, int], ...]
    """The checked pairs, as indices of :attr:`bodies`."""
    margins: Array
    """(P,) the margin (m) of each pair."""
    world: World
    """The bodies, pairs and margins in the compiled core."""
    convex: npt.NDArray[np.bool_]
    """(P,) whether both bodies of the pair have a support function, so that coal is not needed."""
    rounding: float
    """The allowance (m) for floating-point error, which is subtracted from every distance."""
    excluded: tuple[ExcludedPair, ...]
    """The pairs of owners that are not checked, with the reasons."""
    finer: tuple[FinerPair, ...]
    """The pairs of owners that are checked with finer bodies."""
    still_pairs: Indices
    """The pairs that no joint moves relative to each other."""

    @property
    def group(self) -> JointGroup:
        """The joints of q: an arm, or several; :meth:`with_held` returns a checker with other values of the others."""
        return self._spec.arm

    @property
    def arm(self) -> Arm:
        """The arm; InputError if the checker is for a joint group with several arms, which is :attr:`group`."""
        return only_arm(self._spec.arm)

    @property
    def geometry_model(self) -> Any:
        """A copy of Pinocchio's geometry model of all bodies and checked pairs, for other libraries."""
        return self.coal_geometry().clone()

    def coal_geometry(self) -> Any:
        """The geometry model itself, which must not be changed; created on first access."""
        if self._geometry_model is None:
            self._geometry_model = geometry_model(self.group.model, self.bodies, self.pairs)
        return self._geometry_model


def on_joint(model: Any, body: Body) -> tuple[int, int, pin.SE3]:
    """Return the frame and the joint of ``model`` that move a body (0 for an obstacle), and its pose on the joint."""
    if body.link is None:
        return 0, 0, body.link_from_body
    index = model.getFrameId(body.link, pin.FrameType.BODY)
    frame = model.frames[index]
    return index, frame.parentJoint, frame.placement * body.link_from_body


def geometry_model(model: Any, bodies: Sequence[Body], pairs: Sequence[tuple[int, int]]) -> Any:
    """Return Pinocchio's geometry model of the bodies on the joints of ``model``, with the checked pairs."""
    geometry = pin.GeometryModel()
    for body in bodies:
        frame, joint, placement = on_joint(model, body)
        geometry.addGeometryObject(pin.GeometryObject(body.name, joint, frame, placement, body.geometry))
    for i, j in pairs:
        geometry.addCollisionPair(pin.CollisionPair(i, j))
    return geometry


class Assembly(NamedTuple):
    """The bodies of a checker and its pairs."""

    bodies: tuple[Body, ...]
    """Links, attached objects, obstacles."""
    pairs: Pairs
    """The checked and excluded pairs."""
    rounding: float
    """The allowance (m) for floating-point error."""
    geometry: Geometry
    """The bodies and joints in the compiled core."""
    world: World
    """The pairs in the compiled core, without margins."""
    known: Known
    """The cached bodies of the obstacles, for derived checkers."""


def assemble(spec: CheckerSpec, links: Sequence[Body], rules: PairRules, levels: Levels, known: Known) -> Assembly:
    """Assemble links, attached objects and a scene; errors are those of :class:`pinproof.CollisionChecker`."""
    arm, scene = spec.arm, spec.scene
    if named := [obstacle.name for obstacle in scene.obstacles if obstacle.arm is not None]:
        raise InputError(f"the obstacles {', '.join(named)} of the scene name an arm; only attached objects have one")
    made: Known = {}
    added: list[Body] = []
    for link, obstacle in (*((arm.tcp_of(o.arm), o) for o in spec.attached), *((None, o) for o in scene.obstacles)):
        before = known.get((id(obstacle), link))
        if before is None or before[0] is not obstacle:
            before = obstacle, tuple(shape_bodies(obstacle.name, link, obstacle.shape, obstacle.pose))
        made[id(obstacle), link] = before
        added.extend(before[1])
    bodies = (*links, *added)
    _check_names(bodies, arm.robot.urdf.links)
    pairs = choose_pairs(bodies, arm, scene, rules, levels=levels, allowed=spec.allowed)
    rounding = ROUNDING * max((1.0, *(body.extent for body in bodies)))
    geometry = pack_geometry(arm, bodies, rounding)
    return Assembly(bodies, pairs, rounding, geometry, pack_world(geometry, pairs.checked), made)


def warn_of_units(spec: CheckerSpec, bodies: Sequence[Body]) -> None:
    """Warn of links, attached objects and obstacles that are implausibly large, as meshes in millimetres are."""
    shapes = {obstacle.name: obstacle.shape for obstacle in spec.scene.obstacles}
    warned: set[str] = set()
    far = FAR * spec.arm.robot.size
    for body in bodies:
        sides = (body.box[1] - body.box[0]).tolist()
        if body.owner in warned or max(sides) <= min(LARGEST_MESH, far):
            continue
        name, most = f"size of obstacle {body.owner!r}", MOST_REACH
        if isinstance(shapes.get(body.owner), Mesh):
            name, most = f"{name} (a mesh in millimetres needs scale: 0.001)", LARGEST_MESH
        elif body.link is not None:
            name = f"size of {body.owner!r} (a mesh in millimetres needs the scale 0.001)"
            sides, most = [max(sides)], max(far, LARGEST_SMALL_PART)
        warned.add(body.owner)
        warn_of_millimetres(name, sides, most=most, stacklevel=4)


def leave_out(assembly: Assembly, allowed: Sequence[tuple[str, str]]) -> Assembly | None:
    """Return the same bodies with more pairs of owners excluded, faster than :func:`assemble`.

    None if a name is unknown or a wildcard: then :func:`assemble` is needed.
    """
    order = {owner: i for i, owner in enumerate(dict.fromkeys(body.owner for body in assembly.bodies))}
    if any(name not in order for pair in allowed for name in pair) or any(len(set(pair)) != 2 for pair in allowed):
        return None
    moving = {body.owner for body in assembly.bodies if body.link is not None}
    named = {frozenset(pair) for pair in allowed if moving & set(pair)}
    owners = [body.owner for body in assembly.bodies]
    kept = [k for k, (i, j) in enumerate(assembly.pairs.checked) if frozenset((owners[i], owners[j])) not in named]
    excluded = [pair for pair in assembly.pairs.excluded if frozenset(pair.owners) not in named]
    for pair in named:
        first, second = sorted(pair, key=lambda owner: (owner not in moving, order[owner]))
        excluded.append(ExcludedPair((first, second), ALLOWED_BY_CALLER))
    excluded.sort(key=lambda pair: (pair.owners[1] not in moving, *(order[owner] for owner in pair.owners)))
    finer = [pair for pair in assembly.pairs.finer if frozenset(pair.owners) not in named]
    fewer = keep_pairs(assembly, np.array(kept, dtype=int))
    return fewer._replace(pairs=Pairs(fewer.pairs.checked, excluded, finer))


def keep_pairs(assembly: Assembly, kept: Indices) -> Assembly:
    """Return the same bodies with only the pairs of these indices, in increasing order."""
    checked = [assembly.pairs.checked[k] for k in kept.tolist()]
    pairs = assembly.pairs._replace(checked=checked)
    return assembly._replace(pairs=pairs, world=pack_world(assembly.geometry, checked))


def add_obstacle_bodies(
    arm: JointGroup, assembly: Assembly, bodies: Sequence[Body], pairs: Sequence[tuple[int, int]]
) -> Assembly:
    """Return the assembly with more bodies of obstacles, appended to the others, and more checked pairs."""
    every = (*assembly.bodies, *bodies)
    checked = sorted({*assembly.pairs.checked, *pairs})
    geometry = pack_geometry(arm, every, assembly.rounding)
    return assembly._replace(
        bodies=every,
        pairs=assembly.pairs._replace(checked=checked),
        geometry=geometry,
        world=pack_world(geometry, checked),
    )


def _check_names(bodies: Sequence[Body], links: Sequence[str]) -> None:
    seen: set[str] = set()
    for body in bodies:
        if body.name in seen or (body.owner != body.link and body.name in links):
            raise InputError(f"two bodies have the name {body.name!r}; rename the obstacle or attached object")
        seen.add(body.name)
