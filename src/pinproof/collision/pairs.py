"""Which bodies are checked against each other, and why the others are not.

Links that are joined by one joint touch by design and are not checked against each other. Pairs that an SRDF disables,
and links on both sides of links without geometry whose joints share a housing, are left out only where sampling shows
that they touch in nearly all configurations (:mod:`pinproof.collision.overlaps`), or where no joint of the arm moves
them against each other; a scene or a caller may name contacts that are meant to be. Other pairs that an SRDF or a
planning scene disables, as ``Never`` in contact or without a reason, are checked unless the caller trusts them. Nothing
is left out without its reason.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinproof.collision.bodies import Body
from pinproof.collision.links import DECOMPOSED, EXACT
from pinproof.collision.overlaps import Overlap, Overlaps
from pinproof.collision.scene import ANYTHING, Scene
from pinproof.description import UrdfJoint
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import Arm, Robot

__all__ = [
    "ALLOWED_BY_CALLER",
    "HOUSING_SHARE",
    "ExcludedPair",
    "FinerPair",
    "PairRules",
    "Pairs",
    "choose_pairs",
    "overlap_levels",
    "unexplained_pairs",
]

HOUSING_SHARE = 0.05
"""Of the robot's size: joints that lie along no more than this share a housing, unless the caller states its length.
The links on both sides of links without geometry may meet there."""

SAME_PLACE = 1e-9
"""Metres and matrix entries: how far a link may be from the root to be the same frame."""

TOUCHING = ("adjacent", "always", "default", "user", "overlaps in every sampled configuration")
"""Reasons, in lower case, with which an SRDF disables links that were seen to touch: what MoveIt's Setup Assistant
writes (``Default``: they touch where every joint is at its default; ``User``: somebody decided), and the catalogue's.
None of them shows that two links touch in every configuration, so these pairs are sampled."""

BY = {DECOMPOSED: "several hulls", EXACT: "exact meshes"}
"""What a pair is judged by on each level."""

ALLOWED_BY_CALLER = "allowed by the caller"
"""Why a pair is left out that may touch."""

DISABLED, TOUCHED = "the SRDF disables them without a reason", "they touch by their hulls where their meshes do not"
"""Why a pair is judged more finely than as told."""

NOT_MOVED = "no joint of the arm moves them against each other"
"""Why a pair that an SRDF disables is left out without being sampled."""


@dataclass(frozen=True)
class ExcludedPair:
    """Two owners (links, attached objects, obstacles) that are not checked against each other, and why."""

    owners: tuple[str, str]
    reason: str


@dataclass(frozen=True)
class FinerPair:
    """Two owners that are judged by closer bodies than those of the links as told, by what, and why."""

    owners: tuple[str, str]
    by: str
    reason: str


class Pairs(NamedTuple):
    """What is checked, and how."""

    checked: list[tuple[int, int]]
    """Index pairs of bodies, in order."""
    excluded: list[ExcludedPair]
    """Owners that are left out."""
    finer: list[FinerPair]
    """Owners for which closer bodies stand in."""


class PairRules(NamedTuple):
    """What decides which pairs of links are checked."""

    overlaps: Overlaps
    """How often links touch."""
    housing: float
    """Metres: the length along which joints share a housing."""
    trust_disabled: bool = False
    """Whether to leave out every pair that the SRDF or the scene disables."""


def choose_pairs(
    bodies: Sequence[Body],
    arm: Arm,
    scene: Scene,
    rules: PairRules,
    *,
    levels: Mapping[frozenset[str], int] | None = None,
    allowed: Iterable[Sequence[str]] = (),
) -> Pairs:
    """Which bodies to check against each other; ``levels`` are the pairs of owners to judge more finely than as told.

    Raises
    ------
    UnknownNameError
        If an allowed contact of the scene or of the caller names nothing that is there.
    InputError
        If it names the same body twice, or the scene belongs to a robot with another root link.
    """
    robot = arm.robot
    if scene.frame and not _stands_at_root(robot, scene.frame):
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
    # Obstacle against obstacle is never a question; those that nothing is said of are many, and all alike.
    named = {owner for pair in (*reasons, *levels) for owner in pair}
    standing = [owner for owner, own in members.items() if bodies[own[0]].link is None]
    plain = [i for owner in standing if owner not in named for i in members[owner]]
    pairs = Pairs([(i, j) for a in moving for i in _on_level(bodies, members[a], 0) for j in plain], [], [])
    for a, b in (*combinations(moving, 2), *product(moving, (owner for owner in standing if owner in named))):
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
            pairs.finer.append(FinerPair((a, b), BY[level], reason))
    pairs.checked.sort()
    return pairs


def overlap_levels(bodies: Sequence[Body], arm: Arm, rules: PairRules) -> dict[frozenset[str], int]:
    """How finely pairs of links have to be judged that may touch and do not in nearly all configurations.

    Where their hulls touch much more often than they do themselves, several hulls or the exact meshes judge them.
    """
    neighbours = _Neighbours(arm, bodies, rules)
    first = {body.owner: body for body in reversed(bodies)}
    levels = {}
    for a, b in combinations(first, 2):
        if neighbours.claim(first[a], first[b])[1]:
            overlap = rules.overlaps.of(a, b)
            if overlap.level and not overlap.nearly_all:
                levels[frozenset((a, b))] = overlap.level
    return levels


def _on_level(bodies: Sequence[Body], members: Sequence[int], level: int) -> list[int]:
    """Those of the bodies of one owner that judge it on a level: as told, but where there are closer ones."""
    closer = [i for i in members if level and bodies[i].level == level]
    replaced = {bodies[i].source for i in closer}
    return [i for i in members if bodies[i].level == 0 and not (closer and bodies[i].source in replaced)] + closer


def unexplained_pairs(robot: Robot) -> set[frozenset[str]]:
    """The pairs of links that the SRDF disables without saying why.

    Somebody may have done so because the links' hulls overlap where the links do not, as those of a UR5's forearm and
    wrist. So these are checked by closer bodies than hulls. Links that one joint joins are not checked at all.
    """
    joined = {frozenset((joint.parent, joint.child)) for joint in robot.urdf.joints.values()}
    return {frozenset(pair.links) for pair in robot.srdf.disabled if not pair.reason} - joined


def _stands_at_root(robot: Robot, link: str) -> bool:
    """Whether a link is the root, or one that is fixed to it without being moved: ``base_link`` in ``world``."""
    if link not in robot.urdf.links:
        return False
    frame = robot.model.frames[robot.model.getFrameId(link, pin.FrameType.BODY)]
    return frame.parentJoint == 0 and bool(frame.placement.isIdentity(SAME_PLACE))


def _reasons(
    owners: Collection[str], robot: Robot, scene: Scene, allowed: Iterable[Sequence[str]], trust_disabled: bool
) -> dict[frozenset[str], str]:
    reasons: dict[frozenset[str], str] = {}
    if trust_disabled:
        reasons.update({frozenset(pair): "scene: disabled without a reason" for pair in scene.disabled})
        reasons.update({frozenset(pair.links): _by_srdf(pair.reason) for pair in robot.srdf.disabled})
    silent = set(robot.urdf.links) - set(owners)  # links without geometry touch nothing
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
    return f"SRDF: {reason or 'disabled without a reason'}"


class _Neighbours:
    """Which links touch by construction: joined by one joint, or in contact in nearly all configurations."""

    def __init__(self, arm: Arm, bodies: Sequence[Body], rules: PairRules) -> None:
        self._robot, self._rules = arm.robot, rules
        self._solid = {body.link for body in bodies if body.link is not None and body.owner == body.link}
        self._up = {joint.child: joint for joint in self._robot.urdf.joints.values()}
        self._own = {*arm.joint_names, *arm.followers}
        self._disabled = {
            frozenset(pair.links): pair.reason
            for pair in self._robot.srdf.disabled
            if pair.reason.lower() in TOUCHING and not rules.trust_disabled
        }

    def reason(self, one: Sequence[Body], other: Sequence[Body]) -> str:
        """Why the bodies of two owners are not checked against each other; empty where they are."""
        claim, sampled = self.claim(one[0], other[0])
        if not claim or not sampled:
            return claim
        overlap = self._overlap(one, other)
        return f"{claim}; {overlap}" if overlap.nearly_all else ""

    def claim(self, a: Body, b: Body) -> tuple[str, bool]:
        """Why the owners of two bodies may touch, if they may, and whether sampling has to confirm it."""
        if a.link is None or b.link is None:
            return "", False
        up, common, down = self._way(a.link, b.link)
        moving = [joint for link in (*up, *down) if (joint := self._up[link]).type != "fixed"]
        if not moving:
            return "rigid: no joint between them", False
        between = [*up, common, *reversed(down)][1:-1]
        # An attached object is a body of its own: what it hangs on stands between it and the links beyond.
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
        elif solid_between or (up and down) or not self._in_one_place(moving):
            return "", False
        else:
            length, housing = self._length(moving) * 1e3, self._rules.housing * 1e3
            claim = f"adjacent: across {', '.join(between)} without geometry, within {length:.3g} mm of joints "
            claim += f"(housing {housing:.3g} mm)"
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

    def _in_one_place(self, line: Sequence[UrdfJoint]) -> bool:
        """Whether all joints of a line of descent, listed from below, lie within one housing.

        A joint that slides carries what is below it out of the housing.
        """
        if any(joint.type == "prismatic" for joint in line):
            return False
        return self._length(line) <= self._rules.housing

    def _length(self, line: Sequence[UrdfJoint]) -> float:
        """Metres from the first joint of a line of descent, listed from below, to the last, from joint to joint.

        The distances add up: many joints near each other make a line that can curl back as far as it is long.
        """
        model, urdf = self._robot.model, self._robot.urdf
        placements = [model.jointPlacements[model.getJointId(urdf.model_joint(joint.name))] for joint in line[:-1]]
        return math.fsum(float(np.linalg.norm(placement.translation)) for placement in placements)

    def _way(self, a: str, b: str) -> tuple[list[str], str, list[str]]:
        """From a up to below the common ancestor, the ancestor, and from b up to below it."""
        above_a, above_b = self._to_root(a), self._to_root(b)
        common = next(link for link in above_a if link in set(above_b))
        return above_a[: above_a.index(common)], common, above_b[: above_b.index(common)]

    def _to_root(self, link: str) -> list[str]:
        way = [link]
        while way[-1] in self._up:
            way.append(self._up[way[-1]].parent)
        return way
