"""The parts of a checker: its bodies, the pairs of :mod:`pinproof.collision.checking.pairs`, both in the compiled core.

Whatever a change leaves as it is, such as the bodies of links or the tree of the obstacles, is taken from the checker
from which another is derived.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import chain, compress, groupby
from operator import is_not
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof._core import Body as PlacedBody
from pinproof._core import Geometry, Joint, JointTree, Obstacles, World, bodies_on_joint
from pinproof._core import Shape as CoreShape
from pinproof.collision.checking.links import LinkBodies
from pinproof.collision.checking.pairs import ExcludedPair, FinerPair, Indices, PairRules, Pairs, choose_pairs
from pinproof.collision.checking.spec import CheckerSpec, Levels
from pinproof.collision.geometry.bodies import Body, bodies_of, box_of, make_boxes
from pinproof.collision.geometry.shapes import Box, Mesh, Obstacle
from pinproof.collision.geometry.surfaces import Cells
from pinproof.collision.scene import Scene
from pinproof.errors import InputError
from pinproof.model import Arm, JointGroup, Robot
from pinproof.spatial import Array, matrix
from pinproof.units import FAR, MOST_REACH, warn_of_millimetres

ROUNDING = 1e-9
"""Allowance (m) for floating-point error in placements and supports, for each metre of extent of the scene (observed:
3e-9 m at 100 m). It is subtracted from every distance before it is compared with a margin."""

ARMS_KEPT = 64
"""Number of arms whose joints and links are kept; many checkers are often made for one arm, and few positions of its
hand."""

ROOT = -1
"""In place of a joint: the body does not move."""

LARGEST_MESH = 30.0
"""Metres. A larger mesh, with no side below a metre, is assumed to be in millimetres."""

LARGEST_SMALL_PART = 3.0
"""Metres. No link or tool up to this length is assumed to be in millimetres, however small the rest of the robot is."""


class _Pieces(NamedTuple):
    """Bodies that follow each other at one pose of a link, such as the pieces of a mesh."""

    link: str
    pose: pin.SE3
    shapes: list[CoreShape]
    placed: dict[tuple[int, bytes], list[PlacedBody]]  # by the joint, and the pose there


@lru_cache(maxsize=ARMS_KEPT)
def _pieces(bodies: tuple[Body, ...]) -> list[_Pieces]:
    """Return bodies by the pose of a link; a hand at another position leaves most of them at their joints."""
    groups = (list(group) for _, group in groupby(bodies, lambda body: (body.link, id(body.link_from_body))))
    return [_Pieces(own[0].link or "", own[0].link_from_body, [body.core_shape for body in own], {}) for own in groups]


@lru_cache(maxsize=ARMS_KEPT)
def _on_joints(arm: JointGroup, bodies: tuple[Body, ...]) -> list[PlacedBody]:
    """Return bodies of links on the joints that move them."""
    frames, result = _joints(arm)[1], list[PlacedBody]()
    for link, pose, shapes, placed in _pieces(bodies):
        joint, above = frames[link]
        place = (above * pose).homogeneous
        key = joint, place.tobytes()
        if key not in placed:
            if len(placed) >= ARMS_KEPT:
                placed.clear()
            placed[key] = bodies_on_joint(shapes, joint, place)
        result += placed[key]
    return result


class _Joints(NamedTuple):
    """The joints of an arm's robot in the compiled core."""

    tree: JointTree
    to_axis: Sequence[pin.SE3]  # of the root and each joint: turns its frame so that the axis is along z
    frames: Mapping[str, int]  # of the links in the reduced model


_JOINTS: WeakKeyDictionary[Robot, dict[Any, _Joints]] = WeakKeyDictionary()


class _Frames(dict[str, tuple[int, pin.SE3]]):
    """The joint that moves each link (-1: none), and its placement there, on demand."""

    def __init__(self, arm: JointGroup, joints: _Joints) -> None:
        super().__init__()
        self._arm, self._joints = arm, joints

    def __missing__(self, link: str) -> tuple[int, pin.SE3]:
        joint, placement = self._arm.place_of_frame(self._joints.frames[link])
        found = joint - 1, self._joints.to_axis[joint] * placement
        self[link] = found
        return found


@lru_cache(maxsize=ARMS_KEPT)
def _joints(arm: JointGroup) -> tuple[JointTree, _Frames]:
    """Return the joints, whose axis is z, and the joint of each link with the placement of the link on it."""
    # Held joints, such as those of a hand, mostly move links and no other joint.
    known, key = _JOINTS.setdefault(arm.robot, {}), arm.joints_key
    if key not in known:
        if len(known) >= ARMS_KEPT:
            known.clear()
        known[key] = _make_joints(arm)
    joints = known[key]
    return joints.tree, _Frames(arm, joints)


def _make_joints(arm: JointGroup) -> _Joints:
    model = arm.model
    data = model.createData()
    columns = pin.computeJointJacobians(model, data, pin.neutral(model)).reshape(6, -1)
    prismatic = (~columns[3:].any(axis=0)).tolist()
    leaders = np.abs(arm.scale).argmax(axis=1)
    parents = [int(parent) - 1 for parent in model.parents[1:]]
    aligned: list[pin.SE3] = []
    joints = []
    # The core has the axis of every joint along z, so that the frame of a joint is turned.
    for k in range(model.njoints - 1):
        axis = data.oMi[k + 1].rotation.T @ (columns[:3, k] if prismatic[k] else columns[3:, k])
        turned = pin.SE3(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis), np.zeros(3))
        aligned.append(turned)
        above = pin.SE3.Identity() if parents[k] < 0 else aligned[parents[k]].inverse()
        before = (above * model.jointPlacements[k + 1] * turned).homogeneous
        leader = int(leaders[k])
        joints.append(Joint(before, prismatic[k], leader, arm.scale[k, leader], arm.offset[k], parents[k]))
    links: dict[str, int] = {}
    for i, frame in enumerate(model.frames):
        if frame.type == pin.FrameType.BODY:
            links.setdefault(frame.name, i)
    to_axis = [pin.SE3.Identity(), *(turned.inverse() for turned in aligned)]
    return _Joints(JointTree(joints, arm.dof), to_axis, links)


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
    _pairs: Indices  # (P, 2)
    bodies: tuple[Body, ...]
    """Links, attached objects and obstacles."""
    margins: Array
    """(P,) the margin (m) of each pair."""
    world: World
    """The bodies, pairs and margins in the compiled core."""
    rounding: float
    """The allowance (m) for floating-point error, which is subtracted from every distance."""
    excluded: tuple[ExcludedPair, ...]
    """The pairs of owners that are not checked, with the reasons."""
    finer: tuple[FinerPair, ...]
    """The pairs of owners that are checked with finer bodies."""

    @cached_property
    def convex(self) -> npt.NDArray[np.bool_]:
        """(P,) whether both bodies of the pair have a support function, so that coal is not needed."""
        convex = self.world.convex
        convex.setflags(write=False)
        return convex

    @cached_property
    def still_pairs(self) -> Indices:
        """The pairs that no joint moves relative to each other."""
        still = self.world.still
        still.setflags(write=False)
        return still

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """The checked pairs, as indices of :attr:`bodies`."""
        return tuple([(i, j) for i, j in self._pairs.tolist()])

    @property
    def group(self) -> JointGroup:
        """The joints of q: an arm, or several; :meth:`with_held` returns a checker with other values of the others."""
        return self._spec.arm

    @property
    def arm(self) -> Arm:
        """The arm; InputError if the checker is for a joint group with several arms, which is :attr:`group`."""
        return only_arm(self._spec.arm)

    def owners(self, k: int) -> tuple[str, str]:
        """Return the owners of the two bodies of pair k."""
        i, j = self.indices_of(k)
        return self.bodies[i].owner, self.bodies[j].owner

    def indices_of(self, k: int) -> tuple[int, int]:
        """Return the indices of the two bodies of pair k, without all of :attr:`pairs`."""
        i, j = self._pairs[k].tolist()
        return i, j

    @property
    def geometry_model(self) -> Any:
        """A copy of Pinocchio's geometry model of all bodies and checked pairs, for other libraries."""
        return self._coal_geometry().clone()

    def joints_of_links(self, links: Sequence[str]) -> tuple[Indices, Array]:
        """Return the core's joint of each link (K,), -1 for none, and the poses of the links on them (K, 4, 4)."""
        placed = [_joints(self.group)[1][link] for link in links]
        poses = np.array([matrix(pose) for _, pose in placed]).reshape(-1, 4, 4)
        return np.array([joint for joint, _ in placed], dtype=np.int64), poses

    def _coal_geometry(self) -> Any:
        """The geometry model itself, which must not be changed; created on first access."""
        if self._geometry_model is None:
            self._geometry_model = pin.GeometryModel()
            for body in self.bodies:
                frame, joint, placement = on_joint(self.group.model, body)
                thing = pin.GeometryObject(body.name, joint, frame, placement, body.geometry)
                self._geometry_model.addGeometryObject(thing)
            for i, j in self.pairs:
                self._geometry_model.addCollisionPair(pin.CollisionPair(i, j))
        return self._geometry_model


def on_joint(model: Any, body: Body) -> tuple[int, int, pin.SE3]:
    """Return the frame and the joint of ``model`` that move a body (0 for an obstacle), and its pose on the joint."""
    if body.link is None:
        return 0, 0, body.link_from_body
    index = model.getFrameId(body.link, pin.FrameType.BODY)
    frame = model.frames[index]
    return index, frame.parentJoint, frame.placement * body.link_from_body


REPLACED_SHARE = 1 / 8
"""Share of the bodies of obstacles that may take the places of others in a tree; with more, a new one is made."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The bodies of a scene's obstacles."""

    scene: Scene | None  # None: they are not those of a scene
    bodies: tuple[Body, ...]
    ranges: Mapping[str, range]  # the numbers of the bodies of each obstacle
    names: frozenset[str]  # of the bodies
    extent: float  # the largest one of a body (m)
    tree_of: Surroundings | None = None  # those from whose tree in the core the own one is derived
    replaced: frozenset[int] = frozenset()  # the bodies that differ from these

    @classmethod
    def of(cls, scene: Scene, before: Surroundings | None) -> Surroundings:
        """Return the bodies of a scene; those of the same obstacles are taken from those ``before``."""
        things = scene.obstacles
        old = () if before is None or before.scene is None else before.scene.obstacles
        if before is not None and before.scene is not None and len(old) == len(things):
            changed = list(compress(range(len(things)), map(is_not, things, old)))
            if not changed:
                return before
            if len(changed) <= max(1, REPLACED_SHARE * len(things)):
                moved = before._with([(old[i], things[i]) for i in changed], scene)
                if moved is not None:
                    return moved
        known = {} if before is None else {id(o): before._bodies_of(o.name) for o in old if type(o.shape) is not Box}
        _refuse_arms(things)
        make_boxes(things)
        bodies, ranges = list[Body](), dict[str, range]()
        for thing in things:
            start, box = len(bodies), box_of(thing)
            if box is not None:
                bodies.append(box)
            else:
                bodies += known.get(id(thing)) or bodies_of(thing, None)
            if len(bodies) > start:
                ranges[thing.name] = range(start, len(bodies))
        names, extent = frozenset([body.name for body in bodies]), max((body.extent for body in bodies), default=0.0)
        return cls(scene, tuple(bodies), ranges, names, extent)

    def _with(self, changed: Sequence[tuple[Obstacle, Obstacle]], scene: Scene) -> Surroundings | None:
        """Return the bodies of a scene in which few obstacles took the places of others of their names.

        None if one has another number of bodies.
        """
        _refuse_arms([new for _, new in changed])
        bodies, replaced = list(self.bodies), set(self.replaced)
        before, after = list[Body](), list[Body]()
        for old, new in changed:
            numbers, own = self.ranges.get(old.name, range(0)), bodies_of(new, None)
            if old.name != new.name or len(numbers) != len(own):
                return None
            before += bodies[numbers.start : numbers.stop]
            after += own
            bodies[numbers.start : numbers.stop] = own
            replaced.update(numbers)
        is_largest = any(body.extent >= self.extent for body in before)
        extent = max([body.extent for body in (bodies if is_largest else after)], default=0.0)
        if not is_largest:
            extent = max(extent, self.extent)
        # A tree in which many obstacles were moved is slow.
        few = len(replaced) <= REPLACED_SHARE * len(bodies)
        tree_of, replaced = (self.tree_of or self, replaced) if few else (None, set())
        return Surroundings(scene, tuple(bodies), self.ranges, self.names, extent, tree_of, frozenset(replaced))

    def _bodies_of(self, name: str) -> tuple[Body, ...]:
        """Return the bodies of an obstacle."""
        numbers = self.ranges.get(name, range(0))
        return self.bodies[numbers.start : numbers.stop]

    @cached_property
    def core(self) -> Obstacles:
        """The obstacles in the compiled core."""
        if self.tree_of is None:
            return Obstacles([body.core_obstacle for body in self.bodies])
        numbers = sorted(self.replaced)
        others = [self.bodies[number].core_obstacle for number in numbers]
        return self.tree_of.core.replaced(np.array(numbers, dtype=np.int64), others)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "core"}


def _refuse_arms(obstacles: Iterable[Obstacle]) -> None:
    if named := [obstacle.name for obstacle in obstacles if obstacle.arm is not None]:
        raise InputError(f"the obstacles {', '.join(named)} of the scene name an arm; only attached objects have one")


@dataclass(frozen=True, eq=False)
class Assembly:
    """The bodies of a checker (links, attached objects, obstacles) and its pairs."""

    spec: CheckerSpec
    levels: Levels
    links: tuple[Body, ...]
    attached: tuple[tuple[Body, ...], ...]
    own: tuple[Body, ...]  # links and attached objects
    around: Surroundings
    bodies: tuple[Body, ...]
    rounding: float  # the allowance (m) for floating-point error
    pairs: Pairs
    chosen: Pairs  # those that the specification states

    @cached_property
    def geometry(self) -> Geometry:
        """Bodies and joints in the compiled core."""
        arm, attached = self.spec.arm, self.own[len(self.links) :]
        placed = [*_on_joints(arm, self.links), *_on_joints.__wrapped__(arm, attached)]
        return Geometry(_joints(arm)[0], placed, self.around.core, self.rounding)

    def with_pairs(self, pairs: Pairs) -> Assembly:
        """Return the same bodies with other pairs, which the specification does not state."""
        other = object.__new__(Assembly)
        other.__dict__.update(self.__dict__, pairs=pairs)
        return other

    def with_obstacle_bodies(self, bodies: Sequence[Body], pairs: Pairs) -> Assembly:
        """Return the same with other bodies of obstacles, and pairs of them."""
        around = replace(self.around, scene=None, bodies=tuple(bodies), tree_of=None, replaced=frozenset())
        return replace(self, around=around, bodies=(*self.own, *bodies), pairs=pairs)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "geometry"}


def assemble(
    spec: CheckerSpec, link_bodies: LinkBodies, rules: PairRules, levels: Levels, before: Assembly | None
) -> Assembly:
    """Assemble links, attached objects and a scene; errors are those of :class:`pinproof.CollisionChecker`.

    What is the same as in an assembly ``before`` is taken from it.
    """
    arm, scene, urdf = spec.arm, spec.scene, spec.arm.robot.urdf
    around = Surroundings.of(scene, None if before is None else before.around)
    links = link_bodies.of(levels) if before is None or levels is not before.levels else before.links
    known = {}
    if before is not None and arm.ends == before.spec.arm.ends:
        known = {(id(o), o.arm): own for o, own in zip(before.spec.attached, before.attached, strict=True)}
    attached = tuple([known.get((id(o), o.arm)) or bodies_of(o, arm.tcp_of(o.arm)) for o in spec.attached])
    if before is not None and links is before.links and [*map(id, attached)] == [*map(id, before.attached)]:
        own = before.own
    else:
        own = (*links, *chain.from_iterable(attached))
    # Names of bodies and of their owners are unique, so that rules, messages and margins are unambiguous: an attached
    # object with the name of a link would be excluded from the pairs of that link.
    if before is None or own is not before.own or around.names is not before.around.names:
        mine, free = [body.name for body in own], around.names.isdisjoint
        owners = [*urdf.links, *[thing.name for thing in spec.attached]]
        repeated = len(set(mine)) < len(mine) or len(around.names) < len(around.bodies) or not free(mine)
        repeated = repeated or not free(urdf.links) or not set(urdf.links).isdisjoint(mine[len(links) :])
        if repeated or len(set(owners)) < len(owners) or not around.ranges.keys().isdisjoint(owners):
            pieces = [body.name for body in (*own, *around.bodies) if body.name != body.owner]
            seen: set[str] = set()
            for name in (*owners, *around.ranges, *pieces):
                if name in seen:
                    raise InputError(f"two bodies have the name {name!r}; rename the obstacle or attached object")
                seen.add(name)
    pairs = None
    if before is not None and own is before.own and around.ranges is before.around.ranges and levels is before.levels:
        old = before.spec
        same_joints = (arm.robot, arm.joint_names) == (old.arm.robot, old.arm.joint_names)
        if same_joints and _rules_of(spec) == _rules_of(old):
            pairs = before.chosen
    pairs = pairs or choose_pairs(own, around.ranges, arm, scene, rules, levels=levels, allowed=spec.allowed)
    rounding = ROUNDING * max(1.0, around.extent, *[body.extent for body in own])
    return Assembly(
        spec, levels, links, attached, own, around, (*own, *around.bodies), rounding, pairs=pairs, chosen=pairs
    )


def _rules_of(spec: CheckerSpec) -> tuple[object, ...]:
    return spec.allowed, spec.scene.allowed, spec.scene.disabled, spec.scene.frame


def warn_of_units(spec: CheckerSpec, bodies: Sequence[Body]) -> None:
    """Warn of links, attached objects and obstacles that are implausibly large, as meshes in millimetres are."""
    shapes = {obstacle.name: obstacle.shape for obstacle in spec.scene.obstacles}
    warned: set[str] = set()
    far = FAR * spec.arm.robot.size
    large = min(LARGEST_MESH, far)
    for body in bodies:
        # No side is larger, unless it is infinite; clouds of points may be of any size.
        if body.extent < large / 2 or isinstance(body.solid, Cells):
            continue
        sides = (body.box[1] - body.box[0]).tolist()
        if max(sides) <= large or body.owner in warned:
            continue
        # How large a body may be depends on its kind: meshes are often in millimetres.
        name, most = f"size of obstacle {body.owner!r}", MOST_REACH
        if isinstance(shapes.get(body.owner), Mesh):
            name, most = f"{name} (a mesh in millimetres needs scale: 0.001)", LARGEST_MESH
        elif body.link is not None:
            name = f"size of {body.owner!r} (a mesh in millimetres needs the scale 0.001)"
            sides, most = [max(sides)], max(far, LARGEST_SMALL_PART)
        warned.add(body.owner)
        warn_of_millimetres(name, sides, most=most, stacklevel=4)


def numbered_owners(bodies: Sequence[Body]) -> tuple[dict[str, int], Indices]:
    """Return the owners of bodies with their numbers, in order, and (B,) the number of the owner of each body."""
    owners = [body.owner for body in bodies]
    numbers = {owner: i for i, owner in enumerate(dict.fromkeys(owners))}
    return numbers, np.array([numbers[owner] for owner in owners], dtype=np.int64)


def is_pair(owners: Indices, one: int, other: int) -> npt.NDArray[np.bool_]:
    """Return (P,) which of the pairs (P, 2) of the numbers of owners are of these two, in either order."""
    first, second = owners.T
    return ((first == one) & (second == other)) | ((first == other) & (second == one))
