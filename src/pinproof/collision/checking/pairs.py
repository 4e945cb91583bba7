"""The parts of a checker: its bodies, the pairs that are checked, and the excluded pairs with the reasons.

The two links of a joint touch by design and are not checked. Pairs that an SRDF disables, and links, or attached
objects, that are separated only by links without geometry, are excluded only if they touch in every sampled
configuration (:mod:`pinproof.collision.checking.links`), or if no joint of the arm moves them relative to each other. A
scene or a caller can allow contacts. Other pairs that an SRDF or a planning scene disables, as ``Never`` in contact or
without a reason, are checked unless the caller trusts them. Every exclusion is listed with its reason.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof._core import Geometry, PairTable
from pinproof.collision.checking.links import DECOMPOSED, GEOMETRY_NAMES, Overlaps
from pinproof.collision.checking.spec import Levels
from pinproof.collision.geometry.bodies import Body
from pinproof.collision.geometry.shapes import ANYTHING
from pinproof.collision.scene import Scene
from pinproof.description import OVERLAP_REASON, UrdfJoint
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import JointGroup, Robot

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


@dataclass(frozen=True, eq=False)
class Pairs:
    """The checked pairs of bodies (P, 2), sorted, and the owners that are not checked, or with finer geometry."""

    checked: Indices
    excluded: tuple[ExcludedPair, ...]
    finer: tuple[FinerPair, ...]

    def table(self, geometry: Geometry) -> PairTable:
        """Return the pairs in the compiled core, which geometries with the same bodies on the same joints share."""
        known = self.__dict__.get("_table")
        if known is None or not known.fits(geometry):
            known = self.__dict__["_table"] = PairTable(geometry, self.checked)
        return known

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_table"}


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
    """Return the pairs to check of the bodies of the robot, and of ``obstacles``: the numbers of their bodies by name.

    ``levels`` are the levels of detail of pairs of owners, where not 0.
    """
    robot, neighbours = arm.robot, _Neighbours(arm, own, rules)
    known = neighbours.known
    # Pairs depend on the owners of bodies only, unless an attached object has to be sampled.
    start, count = len(own), max((numbers.stop for numbers in obstacles.values()), default=0)
    described = tuple([(body.owner, body.link, body.level, body.source) for body in own])
    named = {owner for pair in (*scene.allowed, *scene.disabled, *allowed, *levels) for owner in pair}
    ranges = obstacles.items() if ANYTHING in named else ((owner, obstacles.get(owner)) for owner in sorted(named))
    of_scene = scene.allowed, scene.disabled, scene.frame
    key = described, of_scene, tuple(allowed), frozenset(levels.items()), count, tuple(ranges)
    if key in known.pairs and not robot.movers:
        return known.pairs[key]
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
    ruled = {owner: obstacles[owner] for pair in (*reasons, *levels) for owner in pair if owner in obstacles}
    among = frozenset(item for item in reasons.items() if members.keys() >= item[0])
    key_of_robot = described, among, frozenset(levels.items())
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
    plain = np.ones(count, dtype=np.bool_)
    for numbers in ruled.values():
        plain[numbers.start : numbers.stop] = False
    special = list[tuple[int, int]]()
    for a, (b, numbers) in product(others, sorted(ruled.items(), key=lambda item: item[1].start)):
        owners = frozenset((a, b))
        if owners in reasons:
            excluded.append(ExcludedPair((a, b), reasons[owners]))
            continue
        level = levels.get(owners, 0)
        mine = _on_level(own, members[a], level)
        special.extend([(i, start + j) for i, j in product(mine, numbers)])
        if any(own[i].level for i in mine):
            finer.append(FinerPair((a, b), GEOMETRY_NAMES[level], TOUCHED))
    for a, b in (*combinations(carried, 2), *product(carried, obstacles)):
        excluded.append(ExcludedPair((a, b), BOTH_OBSTACLES))
    # Sorted by their numbers in a table of all bodies.
    end, columns = start + count, start + np.flatnonzero(plain)
    listed = np.concatenate([of_robot.checked, np.array(special, dtype=np.int64).reshape(-1, 2)])
    order = (np.array(rows, dtype=np.int64)[:, None] * end + columns).ravel()
    order = np.concatenate([order, listed[:, 0] * end + listed[:, 1]])
    order.sort(kind="stable")
    checked = np.stack(np.divmod(order, max(end, 1)), axis=1)
    checked.setflags(write=False)
    made = Pairs(checked, tuple(excluded), tuple(finer))
    if len(order) <= MOST_PAIRS and key_of_robot in known.of_robot:
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
    return Pairs(np.array(checked, dtype=np.int64).reshape(-1, 2), tuple(excluded), tuple(finer))


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
        # The name of an attached object does not matter: rules of an SRDF are about links.
        key = a.owner == a.link, a.link, b.owner == b.link, b.link
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
            # Only the links of the joint itself touch by design. A wall and a carriage that are both fixed to an empty
            # root, or an attached object on a link without geometry, may be hit by the motion of the joint.
            return "adjacent: joined by a joint", bool(between)
        both_links = a.owner == a.link and b.owner == b.link
        disabled = self._disabled.get(frozenset((a.owner, b.owner))) if both_links else None
        if disabled is not None:
            claim = _by_srdf(disabled)
        else:
            # A prismatic joint moves its child link out of the housing.
            if solid_between or (up and down) or any(joint.type == "prismatic" for joint in moving):
                return "", False
            given, length = self._rules.housing, self._length(moving)
            housing = HOUSING_SHARE * self._robot.size_around(a.link) if given is None else given
            if length > housing:
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
