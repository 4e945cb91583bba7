"""The pairs of bodies that are checked, the pairs that are excluded, and the reasons.

Links connected by one joint touch by design and are not checked. Pairs that an SRDF disables, and links that are
separated only by links without geometry in one joint housing, are excluded only if they touch in every sampled
configuration, or if no joint of the arm moves them relative to each other. A scene or a caller can allow contacts.
Other pairs that an SRDF or a planning scene disables, as ``Never`` in contact or without a reason, are checked unless
the caller trusts them. Every exclusion is listed with its reason.

:mod:`pinproof.collision.checking.overlaps` samples how often links touch, and states why this is needed.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinproof.collision.checking.links import DECOMPOSED, GEOMETRY_NAMES
from pinproof.collision.checking.overlaps import Overlap, Overlaps
from pinproof.collision.geometry.bodies import Body
from pinproof.collision.geometry.shapes import ANYTHING
from pinproof.collision.scenes.scene import Scene
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


class Pairs(NamedTuple):
    """The checked and the excluded pairs."""

    checked: list[tuple[int, int]]
    """Sorted pairs of indices of bodies."""
    excluded: list[ExcludedPair]
    """Pairs of owners that are not checked."""
    finer: list[FinerPair]
    """Pairs of owners that are checked with finer geometry."""


class PairRules(NamedTuple):
    """The settings that determine which pairs of links are checked."""

    overlaps: Overlaps
    """How often links touch."""
    housing: float | None
    """Length (m) of a joint housing; None is :data:`HOUSING_SHARE` of the size of the robot."""
    trust_disabled: bool = False
    """Whether every pair that the SRDF or the scene disables is excluded."""


def choose_pairs(
    bodies: Sequence[Body],
    arm: JointGroup,
    scene: Scene,
    rules: PairRules,
    *,
    levels: Mapping[frozenset[str], int] | None = None,
    allowed: Iterable[Sequence[str]] = (),
) -> Pairs:
    """Return the pairs to check; ``levels`` are the levels of detail of pairs of owners, where not 0.

    UnknownNameError if an allowed contact of the scene or of the caller names an unknown body; InputError if it names
    the same body twice, or the scene is for a robot with another root link.
    """
    robot = arm.robot
    if scene.frame and not _is_root_frame(robot, scene.frame):
        raise InputError(f"{scene.where} is placed from {scene.frame!r}; the root of the robot is {robot.urdf.root!r}")
    levels = levels or {}
    members: dict[str, list[int]] = {}
    for i, body in enumerate(bodies):
        members.setdefault(body.owner, []).append(i)
    reasons = _reasons(members, robot, scene, allowed, rules.trust_disabled)
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
    pairs = Pairs([(i, j) for a in of_robot for i in _on_level(bodies, members[a], 0) for j in plain], [], [])
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
    """Return the levels of detail of pairs of links whose hulls touch much more often than their meshes.

    These are pairs that may touch, such as those that an SRDF disables, and pairs whose hulls touch in every
    configuration, so that without finer bodies no configuration would be free.
    """
    neighbours = _Neighbours(arm, bodies, rules)
    robot, first = arm.robot, {body.owner: body for body in reversed(bodies)}
    trusted = {frozenset(pair.links) for pair in robot.srdf.disabled if rules.trust_disabled}
    levels = {}
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
    """Return the pairs of links that the SRDF disables without a reason, except those connected by one joint.

    A possible cause is that the links' hulls overlap where the links do not, as for forearm and wrist of a UR5. These
    pairs are therefore checked with finer geometry than hulls.
    """
    joined = {frozenset((joint.parent, joint.child)) for joint in robot.urdf.joints.values()}
    return {frozenset(pair.links) for pair in robot.srdf.disabled if not pair.reason} - joined


def _is_root_frame(robot: Robot, link: str) -> bool:
    """Whether a link frame equals the root frame, such as ``base_link`` fixed to ``world`` without an offset."""
    if link not in robot.urdf.links:
        return False
    model = robot.model
    frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    return frame.parentJoint == 0 and bool(frame.placement.isIdentity(SAME_PLACE))


def _reasons(
    owners: Collection[str], robot: Robot, scene: Scene, allowed: Iterable[Sequence[str]], trust_disabled: bool
) -> dict[frozenset[str], str]:
    reasons: dict[frozenset[str], str] = {}
    if trust_disabled:
        reasons.update({frozenset(pair): "scene: disabled without a reason" for pair in scene.disabled})
        reasons.update({frozenset(pair.links): _by_srdf(pair.reason) for pair in robot.srdf.disabled})
    silent = set(robot.urdf.links) - set(owners)  # links without geometry
    for reason, where, pairs in (
        ("allowed by the scene", scene.where, scene.allowed),
        (ALLOWED_BY_CALLER, "the caller", tuple(allowed)),
    ):
        for first, second in pairs:
            for name in (first, second):
                if name not in owners and name not in silent and name != ANYTHING:
                    raise UnknownNameError("body", name, owners, f"the contacts allowed by {where}")
            if first == second:
                raise InputError(f"the contacts allowed by {where} name {first!r} twice; a pair is two bodies")
            for one, other in product(*(owners if name == ANYTHING else (name,) for name in (first, second))):
                reasons[frozenset((one, other))] = reason
    return reasons


def _by_srdf(reason: str) -> str:
    return reason if reason == OVERLAP_REASON else f"SRDF: {reason or 'disabled without a reason'}"


class _Neighbours:
    """Finds links that touch by design: connected by one joint, or in contact in all sampled configurations."""

    def __init__(self, arm: JointGroup, bodies: Sequence[Body], rules: PairRules) -> None:
        self._robot, self._rules = arm.robot, rules
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
        overlap = self._overlap(one, other)
        return f"{claim}; {overlap}" if overlap.always else ""

    def claim(self, a: Body, b: Body) -> tuple[str, bool]:
        """Return why the owners of two bodies may touch (empty: they may not), and if sampling must confirm it."""
        if a.link is None or b.link is None or self._robot.part_of(a.link) != self._robot.part_of(b.link):
            return "", False  # robots of a cell do not touch by design, also where one joint or none is between them
        up, common, down = self._links_between(a.link, b.link)
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
            length, housing = self._length(moving), self._housing(a.link)
            if solid_between or (up and down) or length > housing or any(joint.type == "prismatic" for joint in moving):
                return "", False
            claim = f"adjacent: only links without geometry between them ({', '.join(between)}), joints "
            claim += f"{length * 1e3:.3g} mm apart (one housing: at most {housing * 1e3:.3g} mm)"
        if not any(joint.name in self._own for joint in moving):
            return f"{claim}; {NOT_MOVED}", False
        return claim, True

    def _overlap(self, one: Sequence[Body], other: Sequence[Body]) -> Overlap:
        a, b = one[0], other[0]
        if a.owner == a.link and b.owner == b.link:
            return self._rules.overlaps.of(a.owner, b.owner)
        return self._rules.overlaps.of_bodies(
            [body for body in one if body.level == 0], [body for body in other if body.level == 0]
        )

    def _housing(self, link: str) -> float:
        """Return the length (m) of a joint housing of the robot that a link belongs to."""
        given = self._rules.housing
        return HOUSING_SHARE * self._robot.size_around(link) if given is None else given

    def _length(self, line: Sequence[UrdfJoint]) -> float:
        """Return the length (m) of a chain of joints, listed from the tip: the sum of the distances between the joints.

        The distances are added because a chain of many short segments can fold back over its whole length.
        """
        model, urdf = self._robot.model, self._robot.urdf
        placements = [model.jointPlacements[model.getJointId(urdf.model_joint(joint.name))] for joint in line[:-1]]
        return math.fsum(float(np.linalg.norm(placement.translation)) for placement in placements)

    def _links_between(self, a: str, b: str) -> tuple[list[str], str, list[str]]:
        """Return the links from a up to the common ancestor, the ancestor, and the links from b up to it."""
        above_a, above_b = self._to_root(a), self._to_root(b)
        common = next(link for link in above_a if link in above_b)
        return above_a[: above_a.index(common)], common, above_b[: above_b.index(common)]

    def _to_root(self, link: str) -> list[str]:
        if link not in self._above:
            joint = self._up.get(link)
            self._above[link] = [link] if joint is None else [link, *self._to_root(joint.parent)]
        return self._above[link]
