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
from functools import cached_property, lru_cache
from itertools import combinations, product
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof._core import Body as PlacedBody
from pinproof._core import Geometry, Joint, JointTree, Obstacles, World
from pinproof.collision.checking.links import DECOMPOSED, GEOMETRY_NAMES, Overlaps
from pinproof.collision.checking.spec import CheckerSpec, Levels
from pinproof.collision.geometry.bodies import Body, box_of, make_boxes, shape_bodies
from pinproof.collision.geometry.shapes import ANYTHING, Mesh, Obstacle
from pinproof.collision.geometry.surfaces import Cells
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


Indices = npt.NDArray[np.int64]


class Pairs(NamedTuple):
    """The checked pairs of bodies (P, 2), sorted, and the owners that are not checked, or with finer geometry."""

    checked: Indices
    excluded: Sequence[ExcludedPair]
    finer: Sequence[FinerPair]


class PairRules(NamedTuple):
    """The settings that determine which pairs of links are checked; ``housing`` (m) is that of the checker."""

    overlaps: Overlaps
    housing: float | None
    trust_disabled: bool = False


class _Known(NamedTuple):
    """What checkers with the same links, joints and rules have in common."""

    claims: dict[Any, tuple[str, bool]]  # :meth:`_Neighbours.claim` of two links, or of objects attached to them
    of_robot: dict[Any, Pairs]  # the pairs of the robot's bodies
    pairs: dict[Any, Pairs]  # all pairs, with as many obstacles
    levels: list[dict[frozenset[str], int]]  # the result of :func:`overlap_levels`, if it was computed


def _keep(kept: dict[Any, Any], key: Any, value: Any, most: int) -> None:
    if len(kept) >= most:
        kept.clear()
    kept[key] = value


_KNOWN: WeakKeyDictionary[Robot, dict[Any, _Known]] = WeakKeyDictionary()

CLAIMS_KEPT = 10_000
"""Number of pairs of links and attached objects of which it is kept whether they touch by design."""

PAIRS_KEPT, MOST_PAIRS = 64, 20_000
"""Number of sets of bodies of a robot (links and attached objects) of which the pairs are kept, and the largest number
of pairs of all bodies that is kept: 20 MB in all."""


def choose_pairs(
    own: Sequence[Body],
    obstacles: Mapping[str, range],
    arm: JointGroup,
    scene: Scene,
    rules: PairRules,
    *,
    levels: Levels,
    allowed: Iterable[Sequence[str]] = (),
) -> Pairs:
    """Return the pairs to check of the bodies of the robot, and of ``obstacles``: the indices of bodies by name.

    ``levels`` are the levels of detail of pairs of owners, where not 0.
    """
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
    # The bodies of each owner.
    members: dict[str, list[int]] = {}
    for i, body in enumerate(own):
        members.setdefault(body.owner, []).append(i)
    # Why pairs are not checked, whatever their bodies: they are disabled and trusted, or allowed.
    reasons: dict[frozenset[str], str] = {}
    if rules.trust_disabled:
        reasons.update({frozenset(pair): "scene: disabled without a reason" for pair in scene.disabled})
        reasons.update({frozenset(pair.links): _by_srdf(pair.reason) for pair in robot.srdf.disabled})
    by_scene, by_caller = (
        ("allowed by the scene", scene.where, scene.allowed),
        (ALLOWED_BY_CALLER, "the caller", allowed),
    )
    for reason, where, stated in (by_scene, by_caller):
        for first, second in stated:
            for name in (first, second):
                # Links without geometry may be named.
                if not (name in members or name in obstacles or name in robot.urdf.links or name == ANYTHING):
                    names = [*members, *obstacles]
                    raise UnknownNameError("body", name, names, f"the contacts allowed by {where}")
            if first == second:
                raise InputError(f"the contacts allowed by {where} name {first!r} twice; a pair is two bodies")
            every = (*members, *obstacles) if ANYTHING in (first, second) else ()
            for pair in product(*(every if name == ANYTHING else (name,) for name in (first, second))):
                reasons[frozenset(pair)] = reason
    # Pairs depend on the owners of bodies only, unless an attached object has to be sampled.
    neighbours = _Neighbours(arm, own, rules)
    known = neighbours.known
    named = {owner: obstacles[owner] for pair in (*reasons, *levels) for owner in pair if owner in obstacles}
    ruled = sorted(named.items(), key=lambda item: item[1].start)
    start, end = len(own), max((indices.stop for indices in obstacles.values()), default=len(own))
    described = tuple([(body.owner, body.link, body.level, body.source) for body in own])
    rules_of = frozenset(reasons.items()), frozenset(levels.items())
    key = described, rules_of, end, tuple(ruled)
    if key in known.pairs and not robot.movers:
        return known.pairs[key]
    among = frozenset(item for item in reasons.items() if members.keys() >= item[0])
    key_of_robot = described, among, rules_of[1]
    of_robot = known.of_robot.get(key_of_robot)
    if of_robot is None:
        of_robot = _pairs_of_robot(own, members, robot, neighbours, reasons, levels)
        if not neighbours.has_sampled_objects:
            _keep(known.of_robot, key_of_robot, of_robot, PAIRS_KEPT)
    excluded, finer = list(of_robot.excluded), list(of_robot.finer)
    # Obstacles are not checked against each other. Most are in no rule, and are paired with the whole robot at once.
    carriers = set(robot.movers.values())
    carried = sorted(owner for owner, mine in members.items() if own[mine[0]].link in carriers)
    others = [owner for owner in members if owner not in carried]
    rows = [i for owner in others for i in members[owner] if own[i].level == 0]
    plain = np.ones(end - start, dtype=np.bool_)
    for _, own_bodies in ruled:
        plain[own_bodies.start - start : own_bodies.stop - start] = False
    special = list[tuple[int, int]]()
    for a, (b, own_bodies) in product(others, ruled):
        owners = frozenset((a, b))
        if owners in reasons:
            excluded.append(ExcludedPair((a, b), reasons[owners]))
            continue
        level = levels.get(owners, 0)
        mine = _on_level(own, members[a], level)
        special.extend(product(mine, own_bodies))
        if any(own[i].level for i in mine):
            finer.append(FinerPair((a, b), GEOMETRY_NAMES[level], TOUCHED))
    for a, b in (*combinations(carried, 2), *product(carried, obstacles)):
        excluded.append(ExcludedPair((a, b), BOTH_OBSTACLES))
    # Sorted by their numbers in a table of all bodies.
    columns = start + np.flatnonzero(plain)
    listed = np.concatenate([of_robot.checked, np.array(special, dtype=np.int64).reshape(-1, 2)])
    numbers = (np.array(rows, dtype=np.int64)[:, None] * end + columns).ravel()
    numbers = np.concatenate([numbers, listed[:, 0] * end + listed[:, 1]])
    numbers.sort(kind="stable")
    made = Pairs(np.stack(np.divmod(numbers, max(end, 1)), axis=1), excluded, finer)
    if len(numbers) <= MOST_PAIRS and key_of_robot in known.of_robot:
        _keep(known.pairs, key, made, PAIRS_KEPT)
    return made


def _pairs_of_robot(
    own: Sequence[Body],
    members: Mapping[str, Sequence[int]],
    robot: Robot,
    neighbours: _Neighbours,
    reasons: Mapping[frozenset[str], str],
    levels: Levels,
) -> Pairs:
    """Return the pairs of links and attached objects, each with a reason against it or a level of detail."""
    checked, excluded, finer = list[tuple[int, int]](), list[ExcludedPair](), list[FinerPair]()
    unexplained = unexplained_pairs(robot)
    carried = {owner for owner, mine in members.items() if own[mine[0]].link in robot.movers.values()}
    bodies = {owner: [own[i] for i in mine] for owner, mine in members.items()}
    coarse = {owner: _on_level(own, mine, 0) for owner, mine in members.items()}
    for a, b in combinations(members, 2):
        if a in carried and b in carried:
            continue
        key = frozenset((a, b))
        reason = reasons.get(key) or neighbours.reason(bodies[a], bodies[b])
        if reason:
            excluded.append(ExcludedPair((a, b), reason))
            continue
        level = levels.get(key, 0)
        sides = [_on_level(own, members[owner], level) if level else coarse[owner] for owner in (a, b)]
        checked.extend([(i, j) if i < j else (j, i) for i, j in product(*sides)])
        if level and any(own[i].level for side in sides for i in side):
            reason = DISABLED if level == DECOMPOSED and key in unexplained else TOUCHED
            finer.append(FinerPair((a, b), GEOMETRY_NAMES[level], reason))
    return Pairs(np.array(checked, dtype=np.int64).reshape(-1, 2), excluded, finer)


def overlap_levels(bodies: Sequence[Body], arm: JointGroup, rules: PairRules) -> dict[frozenset[str], int]:
    """Return the levels of detail of pairs of links whose hulls touch much more often than their meshes."""
    # These are pairs that may touch, such as those that an SRDF disables, and pairs whose hulls touch in every
    # configuration, so that without finer bodies no configuration would be free.
    neighbours = _Neighbours(arm, bodies, rules)
    if neighbours.known.levels:
        return neighbours.known.levels[0]
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
    neighbours.known.levels.append(levels)
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
        robot = arm.robot
        self._robot, self._rules = robot, rules
        self._solid = frozenset([body.link for body in bodies if body.owner == body.link])
        self._own = {*arm.joint_names, *arm.followers}
        self._above: dict[str, list[str]] = {}
        self.has_sampled_objects = False  # whether a verdict depends on the shape of an attached object
        key = arm.joint_names, arm.followers, rules.overlaps.settings, *rules[1:], self._solid
        kept = _KNOWN.setdefault(robot, {})
        if key not in kept:
            kept[key] = _Known({}, {}, {}, [])
        self.known = kept[key]

    @cached_property
    def _model(self) -> Any:
        return self._robot.model  # one copy for all pairs

    @cached_property
    def _up(self) -> dict[str, UrdfJoint]:
        return {joint.child: joint for joint in self._robot.urdf.joints.values()}

    @cached_property
    def _disabled(self) -> dict[frozenset[str], str]:
        return {
            frozenset(pair.links): pair.reason
            for pair in self._robot.srdf.disabled
            if pair.reason.lower() in TOUCHING and not self._rules.trust_disabled
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
            self.has_sampled_objects = True
            overlap = overlaps.of_bodies([body for body in one if body.level == 0], [b for b in other if b.level == 0])
        return f"{claim}; {overlap}" if overlap.always else ""

    def claim(self, a: Body, b: Body) -> tuple[str, bool]:
        """Return why the owners of two bodies may touch (empty: they may not), and if sampling must confirm it."""
        key = a.owner, a.link, b.owner, b.link
        if key not in self.known.claims:
            _keep(self.known.claims, key, self._claim(a, b), CLAIMS_KEPT)
        return self.known.claims[key]

    def _claim(self, a: Body, b: Body) -> tuple[str, bool]:
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


ROUNDING = 1e-9
"""Allowance (m) for floating-point error in placements and supports, for each metre of extent of the scene (observed:
3e-9 m at 100 m). It is subtracted from every distance before it is compared with a margin."""

Known = dict[tuple[int, str | None], tuple[Obstacle, tuple[Body, ...], float]]
"""Cache of the bodies of obstacles and their largest extent (m), by identity of the obstacle (of which it keeps a
reference) and its link."""

ARMS_KEPT = 64
"""Number of arms whose joints and links are kept; many checkers are often made for one arm, and few positions of its
hand."""

ROOT = -1
"""In place of a joint: the body does not move."""

LARGEST_MESH = 30.0
"""Metres. A larger mesh, with no side below a metre, is assumed to be in millimetres."""

LARGEST_SMALL_PART = 3.0
"""Metres. No link or tool up to this length is assumed to be in millimetres, however small the rest of the robot is."""


def pack_geometry(
    arm: JointGroup, bodies: Sequence[Body], links: int, rounding: float, obstacles: Obstacles | None = None
) -> Geometry:
    """Return the joints of an arm's robot and the bodies on them, obstacles last, with the rounding (m).

    The first ``links`` bodies, and their poses on the joints, are kept for each arm; ``obstacles`` are packed already.
    """
    tree, frames = _joints(arm)
    robot = next((i for i, body in enumerate(bodies) if body.link is None), len(bodies))
    placed = list(_on_joints(arm, tuple(bodies[:links])))
    poses: dict[tuple[str | None, int], Array] = {}  # the pieces of one object share their pose
    for body in bodies[links:robot]:
        joint, above = frames[body.link or ""]
        key = body.link, id(body.link_from_body)
        if key not in poses:
            poses[key] = (above * body.link_from_body).homogeneous
        placed.append(PlacedBody(body.core_shape, joint, poses[key]))
    return Geometry(tree, placed, pack_obstacles(bodies[robot:]) if obstacles is None else obstacles, rounding)


def pack_obstacles(bodies: Iterable[Body]) -> Obstacles:
    """Return the bodies of obstacles with a tree of boxes around them, for several geometries."""
    return Obstacles([body.core_obstacle for body in bodies])


@lru_cache(maxsize=ARMS_KEPT)
def _on_joints(arm: JointGroup, bodies: tuple[Body, ...]) -> tuple[PlacedBody, ...]:
    frames = _joints(arm)[1]
    return tuple(_on_joint(frames, body) for body in bodies)


def _on_joint(frames: Mapping[str, tuple[int, pin.SE3]], body: Body) -> PlacedBody:
    joint, above = frames[body.link or ""]
    return PlacedBody(body.core_shape, joint, (above * body.link_from_body).homogeneous)


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
    _pairs: Indices  # (P, 2)
    bodies: tuple[Body, ...]
    """Links, attached objects and obstacles."""
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
    links: int  # the number of bodies of links
    pairs: Pairs
    rounding: float  # the allowance (m) for floating-point error
    geometry: Geometry  # bodies and joints in the compiled core
    obstacles: Obstacles  # the obstacles there, for derived checkers
    scene: Scene  # that of the obstacles
    known: Known  # the cached bodies of the obstacles, for derived checkers


def assemble(
    spec: CheckerSpec, links: Sequence[Body], rules: PairRules, levels: Levels, before: Assembly | None
) -> Assembly:
    """Assemble links, attached objects and a scene; errors are those of :class:`pinproof.CollisionChecker`.

    What is the same as in an assembly ``before`` is taken from it.
    """
    arm, scene = spec.arm, spec.scene
    if named := [obstacle.name for obstacle in scene.obstacles if obstacle.arm is not None]:
        raise InputError(f"the obstacles {', '.join(named)} of the scene name an arm; only attached objects have one")
    # Bodies of obstacles are made once and kept, because derived checkers have the same obstacles.
    known: Known = {} if before is None else before.known
    made: Known = {}
    make_boxes(scene.obstacles)
    bodies, extent = list(links), max((1.0, *[body.extent for body in links]))
    obstacles: dict[str, range] = {}
    for link, thing in [*[(arm.tcp_of(o.arm), o) for o in spec.attached], *[(None, o) for o in scene.obstacles]]:
        start = len(bodies)
        box = box_of(thing) if link is None else None
        if box is not None:
            bodies.append(box)
            obstacles[thing.name] = range(start, start + 1)
            if box.extent > extent:
                extent = box.extent
            continue
        entry = known.get((id(thing), link))
        if entry is None or entry[0] is not thing:
            own = tuple(shape_bodies(thing.name, link, thing.shape, thing.pose))
            entry = thing, own, max((body.extent for body in own), default=0.0)
        made[id(thing), link] = entry
        extent = max(extent, entry[2])
        bodies += entry[1]
        if link is None and len(bodies) > start:
            obstacles[thing.name] = range(start, len(bodies))
    # Names of bodies are unique, so that messages and margins are unambiguous.
    names = [body.name for body in bodies]
    if len(set(names)) < len(names) or not set(arm.robot.urdf.links).isdisjoint(names[len(links) :]):
        seen: set[str] = set()
        for body in bodies:
            if body.name in seen or (body.owner != body.link and body.name in arm.robot.urdf.links):
                raise InputError(f"two bodies have the name {body.name!r}; rename the obstacle or attached object")
            seen.add(body.name)
    first = len(links) + sum(len(made[id(thing), arm.tcp_of(thing.arm)][1]) for thing in spec.attached)
    pairs = choose_pairs(bodies[:first], obstacles, arm, scene, rules, levels=levels, allowed=spec.allowed)
    rounding = ROUNDING * extent
    others = bodies[first:]
    same = before is not None and before.scene is scene
    packed = before.obstacles if before is not None and same else pack_obstacles(others)
    geometry = pack_geometry(arm, bodies, len(links), rounding, packed)
    return Assembly(tuple(bodies), len(links), pairs, rounding, geometry, packed, scene, made)


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


def leave_out(assembly: Assembly, allowed: Sequence[tuple[str, str]]) -> Assembly | None:
    """Return the same bodies with more pairs of owners excluded; None if :func:`assemble` is needed, for a wildcard."""
    # Wildcards and links without geometry need all of the rules.
    order, owners = numbered_owners(assembly.bodies)
    if any(name not in order for pair in allowed for name in pair) or any(len(set(pair)) != 2 for pair in allowed):
        return None
    moving = {body.owner for body in assembly.bodies if body.link is not None}
    named = {frozenset(pair) for pair in allowed if moving & set(pair)}
    checked, excluded = owners[assembly.pairs.checked], list(assembly.pairs.excluded)
    kept = np.ones(len(checked), dtype=bool)
    excluded = [pair for pair in excluded if frozenset(pair.owners) not in named]
    for pair in named:
        first, second = sorted(pair, key=lambda owner: (owner not in moving, order[owner]))
        excluded.append(ExcludedPair((first, second), ALLOWED_BY_CALLER))
        kept &= ~is_pair(checked, order[first], order[second])
    # The order of the exclusions is that of choose_pairs.
    excluded.sort(key=lambda pair: (pair.owners[1] not in moving, *(order[owner] for owner in pair.owners)))
    finer = [pair for pair in assembly.pairs.finer if frozenset(pair.owners) not in named]
    return assembly._replace(pairs=Pairs(assembly.pairs.checked[kept], excluded, finer))


def is_pair(owners: Indices, one: int, other: int) -> npt.NDArray[np.bool_]:
    """Return (P,) which of the pairs (P, 2) of the numbers of owners are of these two, in either order."""
    first, second = owners.T
    return ((first == one) & (second == other)) | ((first == other) & (second == one))
