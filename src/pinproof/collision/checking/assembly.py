"""The parts of a checker: its bodies, the pairs that are checked, and the excluded pairs with the reasons.

Links connected by one joint touch by design and are not checked. Pairs that an SRDF disables, and links that are
separated only by links without geometry in one joint housing, are excluded only if they touch in every sampled
configuration (:mod:`pinproof.collision.checking.links`), or if no joint of the arm moves them relative to each other. A
scene or a caller can allow contacts. Other pairs that an SRDF or a planning scene disables, as ``Never`` in contact or
without a reason, are checked unless the caller trusts them. Every exclusion is listed with its reason.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, product
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof._core import Body as PlacedBody
from pinproof._core import Geometry, Joint, JointTree, World
from pinproof.collision.checking.links import DECOMPOSED, GEOMETRY_NAMES, Overlaps
from pinproof.collision.checking.spec import CheckerSpec, Levels
from pinproof.collision.geometry.bodies import Body, shape_bodies
from pinproof.collision.geometry.shapes import ANYTHING, Mesh, Obstacle
from pinproof.collision.scene import Scene
from pinproof.description import OVERLAP_REASON, UrdfJoint
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import Arm, JointGroup, Robot
from pinproof.spatial import Array
from pinproof.units import FAR, MOST_REACH, warn_of_millimetres

HOUSING_SHARE = 0.05
"""Default length of a joint housing as a share of the robot's size. Links that are separated only by links without
geometry may touch inside a housing."""

SAME_PLACE = 1e-9
"""Tolerance (metres and matrix entries) within which a link frame equals the root frame."""

TOUCHING = ("adjacent", "always", "default", "user", OVERLAP_REASON)
"""Reasons, in lower case, with which an SRDF disables links that were found to touch: those of MoveIt's Setup Assistant
(``Default``: they touch with every joint at its default; ``User``: disabled by hand) and that of the catalogue. None of
them shows that two links touch in every configuration, so these pairs are sampled."""

ALLOWED_BY_CALLER = "allowed by the caller"
"""Reason for excluding a pair that may touch."""

DISABLED, TOUCHED = "the SRDF disables them without a reason", "their hulls touch where their meshes do not"
"""Reasons for checking a pair with finer geometry than requested."""

BOTH_OBSTACLES = "both are obstacles, of which a mover moves one or both"
"""Reason for excluding pairs of obstacles that move relative to each other; they need not be listed if none moves."""

NOT_MOVED = "no joint of the arm moves them relative to each other"
"""Reason for excluding a pair that an SRDF disables without sampling."""


@dataclass(frozen=True)
class ExcludedPair:
    """Two owners (links, attached objects, obstacles) that are not checked against each other, and the reason."""

    owners: tuple[str, str]
    reason: str


@dataclass(frozen=True)
class FinerPair:
    """Two owners that are checked with finer geometry than requested: by which, and the reason."""

    owners: tuple[str, str]
    by: str
    reason: str


class Pairs(NamedTuple):
    """The checked pairs of bodies, sorted, and the owners that are not checked or checked with finer geometry."""

    checked: list[tuple[int, int]]
    excluded: list[ExcludedPair]
    finer: list[FinerPair]


class PairRules(NamedTuple):
    """The settings that determine which pairs of links are checked; ``housing`` (m) is that of the checker."""

    overlaps: Overlaps
    housing: float | None
    trust_disabled: bool = False


def choose_pairs(
    bodies: Sequence[Body],
    arm: JointGroup,
    scene: Scene,
    rules: PairRules,
    *,
    levels: Mapping[frozenset[str], int] | None = None,
    allowed: Iterable[Sequence[str]] = (),
) -> Pairs:
    """Return the pairs to check; ``levels`` are the levels of detail of pairs of owners, where not 0."""
    robot = arm.robot
    if scene.frame:  # such as base_link, fixed to world without an offset
        frame = (
            robot.model.frames[robot.model.getFrameId(scene.frame, pin.FrameType.BODY)]
            if scene.frame in robot.urdf.links
            else None
        )
        if frame is None or frame.parentJoint != 0 or not frame.placement.isIdentity(SAME_PLACE):
            raise InputError(
                f"{scene.where} is placed from {scene.frame!r}; the root of the robot is {robot.urdf.root!r}"
            )
    levels = levels or {}
    # The bodies of each owner.
    members: dict[str, list[int]] = {}
    for i, body in enumerate(bodies):
        members.setdefault(body.owner, []).append(i)
    # Why pairs are not checked, whatever their bodies: they are disabled and trusted, or allowed.
    reasons: dict[frozenset[str], str] = {}
    if rules.trust_disabled:
        reasons.update({frozenset(pair): "scene: disabled without a reason" for pair in scene.disabled})
        reasons.update({frozenset(pair.links): _by_srdf(pair.reason) for pair in robot.srdf.disabled})
    silent = set(robot.urdf.links) - set(members)  # links without geometry
    by_scene, by_caller = (
        ("allowed by the scene", scene.where, scene.allowed),
        (ALLOWED_BY_CALLER, "the caller", allowed),
    )
    for reason, where, stated in (by_scene, by_caller):
        for first, second in stated:
            for name in (first, second):
                if name not in members and name not in silent and name != ANYTHING:
                    raise UnknownNameError("body", name, members, f"the contacts allowed by {where}")
            if first == second:
                raise InputError(f"the contacts allowed by {where} name {first!r} twice; a pair is two bodies")
            for pair in product(*(members if name == ANYTHING else (name,) for name in (first, second))):
                reasons[frozenset(pair)] = reason
    neighbours = _Neighbours(arm, bodies, rules)
    unexplained = unexplained_pairs(robot)
    moving = [owner for owner, own in members.items() if bodies[own[0]].link is not None]
    owned = {owner: [bodies[i] for i in own] for owner, own in members.items()}
    # Obstacles are not checked against each other. Most are in no rule, and are paired with all moving bodies at once.
    named = {owner for pair in (*reasons, *levels) for owner in pair}
    fixed = [owner for owner, own in members.items() if bodies[own[0]].link is None]
    plain = [i for owner in fixed if owner not in named for i in members[owner]]
    carried = {owner for owner in moving if bodies[members[owner][0]].link in robot.movers.values()}
    of_robot = [owner for owner in moving if owner not in carried]
    # The robot with obstacles without a rule.
    pairs = Pairs([(i, j) for a in of_robot for i in _on_level(bodies, members[a], 0) for j in plain], [], [])
    # All other pairs, each with a reason against it or the level of detail on which it is checked.
    for a, b in (*combinations(moving, 2), *product(of_robot, (owner for owner in fixed if owner in named))):
        if a in carried and b in carried:
            continue
        key = frozenset((a, b))
        reason = reasons.get(key) or neighbours.reason(owned[a], owned[b])
        if reason:
            pairs.excluded.append(ExcludedPair((a, b), reason))
            continue
        level = levels.get(key, 0)
        sides = [_on_level(bodies, members[owner], level) for owner in (a, b)]
        pairs.checked.extend((min(i, j), max(i, j)) for i, j in product(*sides))
        if any(bodies[i].level for side in sides for i in side):
            reason = DISABLED if level == DECOMPOSED and key in unexplained else TOUCHED
            pairs.finer.append(FinerPair((a, b), GEOMETRY_NAMES[level], reason))
    for a, b in (*combinations(sorted(carried), 2), *product(sorted(carried), fixed)):
        pairs.excluded.append(ExcludedPair((a, b), BOTH_OBSTACLES))
    pairs.checked.sort()
    return pairs


def overlap_levels(bodies: Sequence[Body], arm: JointGroup, rules: PairRules) -> dict[frozenset[str], int]:
    """Return the levels of detail of pairs of links whose hulls touch much more often than their meshes."""
    # These are pairs that may touch, such as those that an SRDF disables, and pairs whose hulls touch in every
    # configuration, so that without finer bodies no configuration would be free.
    neighbours = _Neighbours(arm, bodies, rules)
    robot, first = arm.robot, {body.owner: body for body in reversed(bodies)}
    trusted = {frozenset(pair.links) for pair in robot.srdf.disabled if rules.trust_disabled}
    levels = {}
    # The first body of each owner represents it, because rules are about owners.
    for a, b in combinations(first, 2):
        claim, sampled = neighbours.claim(first[a], first[b])
        if (claim and not sampled) or frozenset((a, b)) in trusted:
            continue
        if claim or (robot.part_of(a) == robot.part_of(b) and rules.overlaps.always_touch(a, b)):
            overlap = rules.overlaps.of(a, b)
            if overlap.level and not overlap.always:
                levels[frozenset((a, b))] = overlap.level
    return levels


def _on_level(bodies: Sequence[Body], members: Sequence[int], level: int) -> list[int]:
    """Return the bodies of one owner on a level: bodies of level 0, except where finer ones replace them."""
    closer = [i for i in members if level and bodies[i].level == level]
    replaced = {bodies[i].source for i in closer}
    return [i for i in members if bodies[i].level == 0 and not (closer and bodies[i].source in replaced)] + closer


def unexplained_pairs(robot: Robot) -> set[frozenset[str]]:
    """Return the pairs of links that the SRDF disables without a reason, except those connected by one joint."""
    # A possible cause is that their hulls overlap where the links do not, as for forearm and wrist of a UR5. Finer
    # geometry than hulls is therefore used for these pairs.
    joined = {frozenset((joint.parent, joint.child)) for joint in robot.urdf.joints.values()}
    return {frozenset(pair.links) for pair in robot.srdf.disabled if not pair.reason} - joined


def _by_srdf(reason: str) -> str:
    return reason if reason == OVERLAP_REASON else f"SRDF: {reason or 'disabled without a reason'}"


class _Neighbours:
    """Finds links that touch by design: connected by one joint, or in contact in all sampled configurations."""

    def __init__(self, arm: JointGroup, bodies: Sequence[Body], rules: PairRules) -> None:
        self._robot, self._rules = arm.robot, rules
        self._model = arm.robot.model  # one copy for all pairs
        self._solid = {body.link for body in bodies if body.link is not None and body.owner == body.link}
        self._up = {joint.child: joint for joint in self._robot.urdf.joints.values()}
        self._own = {*arm.joint_names, *arm.followers}
        self._above: dict[str, list[str]] = {}
        self._disabled = {
            frozenset(pair.links): pair.reason
            for pair in self._robot.srdf.disabled
            if pair.reason.lower() in TOUCHING and not rules.trust_disabled
        }

    def reason(self, one: Sequence[Body], other: Sequence[Body]) -> str:
        """Return why the bodies of two owners are not checked against each other; empty if they are."""
        claim, sampled = self.claim(one[0], other[0])
        if not claim or not sampled:
            return claim
        a, b, overlaps = one[0], other[0], self._rules.overlaps
        if a.owner == a.link and b.owner == b.link:
            overlap = overlaps.of(a.owner, b.owner)
        else:
            overlap = overlaps.of_bodies([body for body in one if body.level == 0], [b for b in other if b.level == 0])
        return f"{claim}; {overlap}" if overlap.always else ""

    def claim(self, a: Body, b: Body) -> tuple[str, bool]:
        """Return why the owners of two bodies may touch (empty: they may not), and if sampling must confirm it."""
        if a.link is None or b.link is None or self._robot.part_of(a.link) != self._robot.part_of(b.link):
            return "", False  # robots of a cell do not touch by design, also where one joint or none is between them
        # From each link up to the common ancestor.
        above_a, above_b = self._to_root(a.link), self._to_root(b.link)
        common = next(link for link in above_a if link in above_b)
        up, down = above_a[: above_a.index(common)], above_b[: above_b.index(common)]
        moving = [joint for link in (*up, *down) if (joint := self._up[link]).type != "fixed"]
        if not moving:
            return "rigid: no joint between them", False
        between = [*up, common, *reversed(down)][1:-1]
        # An attached object is a separate body: the link that carries it is between it and the other links.
        if a.owner != a.link:
            between = [a.link, *between]
        if b.owner != b.link:
            between = [*between, b.link]
        solid_between = any(link in self._solid for link in between)
        if len(moving) == 1 and not solid_between:
            return "adjacent: joined by a joint", False
        disabled = self._disabled.get(frozenset((a.owner, b.owner)))
        if disabled is not None:
            claim = _by_srdf(disabled)
        else:
            # A prismatic joint moves its child link out of the housing.
            given = self._rules.housing
            length = self._length(moving)
            housing = HOUSING_SHARE * self._robot.size_around(a.link) if given is None else given
            if solid_between or (up and down) or length > housing or any(joint.type == "prismatic" for joint in moving):
                return "", False
            claim = f"adjacent: only links without geometry between them ({', '.join(between)}), joints "
            claim += f"{length * 1e3:.3g} mm apart (one housing: at most {housing * 1e3:.3g} mm)"
        if not any(joint.name in self._own for joint in moving):
            return f"{claim}; {NOT_MOVED}", False
        return claim, True

    def _length(self, line: Sequence[UrdfJoint]) -> float:
        """Return the sum of the distances (m) between joints: a chain can fold back over its whole length."""
        model, urdf = self._model, self._robot.urdf
        placements = [model.jointPlacements[model.getJointId(urdf.model_joint(joint.name))] for joint in line[:-1]]
        return math.fsum(float(np.linalg.norm(placement.translation)) for placement in placements)

    def _to_root(self, link: str) -> list[str]:
        if link not in self._above:
            joint = self._up.get(link)
            self._above[link] = [link] if joint is None else [link, *self._to_root(joint.parent)]
        return self._above[link]


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
    """Return the joints of an arm's robot and the bodies on them, obstacles last, with the rounding (m)."""
    tree, links = _joints(arm)
    placed = []
    for body in bodies:
        joint, place = ROOT, body.link_from_body
        if body.link is not None:
            joint, above = links[body.link]
            place = above * place
        placed.append(PlacedBody(body.core_shape, joint, place.homogeneous))
    robot = sum(body.link is not None for body in bodies)
    return Geometry(tree, placed, robot, rounding)


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
    joints = []
    # The core has the axis of every joint along z, so that the frame of a joint is turned.
    for k in range(count):
        axis = data.oMi[k + 1].rotation.T @ (columns[:3, k] if prismatic[k] else columns[3:, k])
        turned = pin.SE3(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis), np.zeros(3))
        aligned.append(turned)
        above = pin.SE3.Identity() if parents[k] < 0 else aligned[parents[k]].inverse()
        before = (above * model.jointPlacements[k + 1] * turned).homogeneous
        leader = int(leaders[k])
        joints.append(Joint(before, prismatic[k], leader, arm.scale[k, leader], arm.offset[k], parents[k]))
    tree = JointTree(joints, arm.dof)
    # The joint that moves each link, and the link's placement on it.
    links: dict[str, tuple[int, pin.SE3]] = {}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.name not in links:
            k = int(frame.parentJoint) - 1
            links[frame.name] = k, pin.SE3(frame.placement) if k < 0 else aligned[k].inverse() * frame.placement
    return tree, links


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

    def owners(self, k: int) -> tuple[str, str]:
        """Return the owners of the two bodies of pair k."""
        i, j = self.pairs[k]
        return self.bodies[i].owner, self.bodies[j].owner

    @property
    def geometry_model(self) -> Any:
        """A copy of Pinocchio's geometry model of all bodies and checked pairs, for other libraries."""
        return self._coal_geometry().clone()

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


class Assembly(NamedTuple):
    """The bodies of a checker (links, attached objects, obstacles) and its pairs."""

    bodies: tuple[Body, ...]
    pairs: Pairs
    rounding: float  # the allowance (m) for floating-point error
    geometry: Geometry  # bodies and joints in the compiled core
    world: World  # the pairs there, without margins
    known: Known  # the cached bodies of the obstacles, for derived checkers


def assemble(spec: CheckerSpec, links: Sequence[Body], rules: PairRules, levels: Levels, known: Known) -> Assembly:
    """Assemble links, attached objects and a scene; errors are those of :class:`pinproof.CollisionChecker`."""
    arm, scene = spec.arm, spec.scene
    if named := [obstacle.name for obstacle in scene.obstacles if obstacle.arm is not None]:
        raise InputError(f"the obstacles {', '.join(named)} of the scene name an arm; only attached objects have one")
    # Bodies of obstacles are made once and kept, because derived checkers have the same obstacles.
    made: Known = {}
    added: list[Body] = []
    for link, obstacle in (*((arm.tcp_of(o.arm), o) for o in spec.attached), *((None, o) for o in scene.obstacles)):
        before = known.get((id(obstacle), link))
        if before is None or before[0] is not obstacle:
            before = obstacle, tuple(shape_bodies(obstacle.name, link, obstacle.shape, obstacle.pose))
        made[id(obstacle), link] = before
        added.extend(before[1])
    bodies = (*links, *added)
    # Names of bodies are unique, so that messages and margins are unambiguous.
    seen: set[str] = set()
    for body in bodies:
        if body.name in seen or (body.owner != body.link and body.name in arm.robot.urdf.links):
            raise InputError(f"two bodies have the name {body.name!r}; rename the obstacle or attached object")
        seen.add(body.name)
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
        # How large a body may be depends on its kind: meshes are often in millimetres.
        name, most = f"size of obstacle {body.owner!r}", MOST_REACH
        if isinstance(shapes.get(body.owner), Mesh):
            name, most = f"{name} (a mesh in millimetres needs scale: 0.001)", LARGEST_MESH
        elif body.link is not None:
            name = f"size of {body.owner!r} (a mesh in millimetres needs the scale 0.001)"
            sides, most = [max(sides)], max(far, LARGEST_SMALL_PART)
        warned.add(body.owner)
        warn_of_millimetres(name, sides, most=most, stacklevel=4)


def leave_out(assembly: Assembly, allowed: Sequence[tuple[str, str]]) -> Assembly | None:
    """Return the same bodies with more pairs of owners excluded; None if :func:`assemble` is needed, for a wildcard."""
    # Wildcards and links without geometry need all of the rules.
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
    # The order of the exclusions is that of choose_pairs.
    excluded.sort(key=lambda pair: (pair.owners[1] not in moving, *(order[owner] for owner in pair.owners)))
    finer = [pair for pair in assembly.pairs.finer if frozenset(pair.owners) not in named]
    fewer = keep_pairs(assembly, np.array(kept, dtype=int))
    return fewer._replace(pairs=Pairs(fewer.pairs.checked, excluded, finer))


def keep_pairs(assembly: Assembly, kept: Indices) -> Assembly:
    """Return the same bodies with only the pairs of these indices, in increasing order."""
    checked = [assembly.pairs.checked[k] for k in kept.tolist()]
    pairs = assembly.pairs._replace(checked=checked)
    return assembly._replace(pairs=pairs, world=pack_world(assembly.geometry, checked))
