"""Which bodies are checked against each other, and why the others are not.

Links that are joined by one joint, or by several in one place, touch by design, and so do the pairs that an SRDF
disables as touching (:data:`TOUCHING`); a scene or a caller may name contacts that are meant to be. Other pairs that an
SRDF or a planning scene disables, as ``Never`` in contact or without a reason, were sampled at best, and some do touch
(a UR5's forearm and wrist_3 at one configuration in thirteen): they are checked all the same unless the caller trusts
them. Nothing is left out without its reason.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinproof.collision.bodies import Body
from pinproof.collision.links import DECOMPOSED, EXACT
from pinproof.collision.scene import ANYTHING, Scene
from pinproof.description import UrdfJoint
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import Robot

__all__ = ["ALLOWED_BY_CALLER", "ExcludedPair", "FinerPair", "Pairs", "choose_pairs", "unexplained_pairs"]

HOUSING = 0.05
"""Metres. Joints nearer than this share a housing: the links on both sides of a link without geometry meet there."""


SAME_PLACE = 1e-9
"""Metres and matrix entries: how far a link may be from the root to be the same frame."""

TOUCHING = ("adjacent", "always", "default", "user", "overlaps in every sampled configuration")
"""Reasons, in lower case, why an SRDF says that two links touch and are meant to: what MoveIt's Setup Assistant writes
(``Default``: they overlap where every joint stands at its default; ``User``: somebody decided), and the catalogue's."""

BY = {DECOMPOSED: "several hulls", EXACT: "exact meshes"}
"""What a pair is judged by on each level."""

ALLOWED_BY_CALLER = "allowed by the caller"
"""Why a pair is left out that may touch."""

DISABLED, TOUCHED = "the SRDF disables them without a reason", "they touch by their hulls where their meshes do not"
"""Why a pair is judged more finely than as told."""


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


def choose_pairs(
    bodies: Sequence[Body],
    robot: Robot,
    scene: Scene,
    *,
    levels: Mapping[frozenset[str], int] | None = None,
    allowed: Iterable[Sequence[str]] = (),
    trust_disabled: bool = False,
) -> Pairs:
    """Which bodies to check against each other; ``levels`` are the pairs of owners to judge more finely than as told.

    Raises
    ------
    UnknownNameError
        If an allowed contact of the scene or of the caller names nothing that is there.
    InputError
        If it names the same body twice, or the scene belongs to a robot with another root link.
    """
    if scene.frame and not _stands_at_root(robot, scene.frame):
        raise InputError(f"{scene.where} is placed from {scene.frame!r}; the root of the robot is {robot.urdf.root!r}")
    levels = levels or {}
    members: dict[str, list[int]] = {}
    for i, body in enumerate(bodies):
        members.setdefault(body.owner, []).append(i)
    reasons = _reasons(members, robot, scene, allowed, trust_disabled)
    neighbours = _Neighbours(robot, {body.link for body in bodies if body.link is not None and body.owner == body.link})
    unexplained = unexplained_pairs(robot)
    moving = [owner for owner, own in members.items() if bodies[own[0]].link is not None]
    # Obstacle against obstacle is never a question; those that nothing is said of are many, and all alike.
    named = {owner for pair in (*reasons, *levels) for owner in pair}
    standing = [owner for owner, own in members.items() if bodies[own[0]].link is None]
    plain = [i for owner in standing if owner not in named for i in members[owner]]
    pairs = Pairs([(i, j) for a in moving for i in _on_level(bodies, members[a], 0) for j in plain], [], [])
    for a, b in (*combinations(moving, 2), *product(moving, (owner for owner in standing if owner in named))):
        key = frozenset((a, b))
        reason = reasons.get(key) or neighbours.reason(bodies[members[a][0]], bodies[members[b][0]])
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
    for pair in robot.srdf.disabled:
        if trust_disabled or pair.reason.lower() in TOUCHING:
            reasons[frozenset(pair.links)] = f"SRDF: {pair.reason or 'disabled without a reason'}"
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


class _Neighbours:
    """Which links touch by construction: joined by one joint, or by several that sit in one place."""

    def __init__(self, robot: Robot, solid_links: set[str]) -> None:
        self._robot, self._solid = robot, solid_links
        self._up = {joint.child: joint for joint in robot.urdf.joints.values()}

    def reason(self, a: Body, b: Body) -> str:
        """Why the two may touch; empty when they may not."""
        if a.link is None or b.link is None:
            return ""
        up, common, down = self._way(a.link, b.link)
        joints = [self._up[link] for link in (*up, *down)]
        moving = [joint for joint in joints if joint.type != "fixed"]
        if not moving:
            return "rigid: no joint between them"
        between = [*up, common, *reversed(down)][1:-1]
        # An attached object is a body of its own: what it hangs on stands between it and the links beyond.
        if a.owner != a.link:
            between = [a.link, *between]
        if b.owner != b.link:
            between = [*between, b.link]
        if any(link in self._solid for link in between):
            return ""
        if len(moving) == 1:
            return "adjacent: joined by a joint"
        if (up and down) or not self._in_one_place(moving):
            return ""
        return f"adjacent: across {', '.join(between)} without geometry"

    def _in_one_place(self, line: list[UrdfJoint]) -> bool:
        """Whether each joint of a line of descent, listed from below, sits within a housing of the one above.

        A joint that slides carries what is below it out of the housing.
        """
        if any(joint.type == "prismatic" for joint in line):
            return False
        model, urdf = self._robot.model, self._robot.urdf
        placements = [model.jointPlacements[model.getJointId(urdf.model_joint(joint.name))] for joint in line[:-1]]
        return all(float(np.linalg.norm(placement.translation)) <= HOUSING for placement in placements)

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
