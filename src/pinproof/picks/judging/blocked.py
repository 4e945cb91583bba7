"""Proofs that every configuration of an arm at a pose is in collision, for arms whose solutions are curves.

Shapes inside the bodies that collide at the configurations found are given to the proof that a pose is out of reach: it
excludes the joint values at which the pose is not reached, and those at which two of the shapes overlap.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinproof.collision import Body, CollisionChecker, inner_shapes
from pinproof.description import moved_by
from pinproof.ik import BodyOverlap, ReachProof, is_provable, prove_unreachable
from pinproof.model import Arm
from pinproof.spatial import SE3, Array

BOXES = 3000
"""Largest number of boxes of a proof; each takes 10 to 40 microseconds."""

EXAMINED = 12
"""Number of configurations whose contacts are used."""


def blocked_words(checker: CollisionChecker, target: SE3, q: Array) -> str:
    """The pairs of bodies of :func:`prove_blocked` as text; empty if it is not proven."""
    proof = prove_blocked(checker, target, q)
    if proof is None:
        return ""
    return " or ".join(f"{first} collides with {second}" for first, second in proof.bodies)


def prove_blocked(checker: CollisionChecker, target: SE3, q: Array) -> ReachProof | None:
    """Try to prove that every configuration at a target ``base_from_tcp`` is in collision; None if it is not proven.

    The contacts at the known configurations q (k, n), all in collision, show which bodies may block. Only penetration
    counts, not the margin.
    """
    arm = checker.arm
    if not is_provable(arm) or not len(q) or checker.is_free_batch(q).any():
        return None
    overlaps = _overlaps(checker, q)
    if not overlaps:
        return None
    proof = prove_unreachable(arm, target, search=False, budget=BOXES, overlaps=overlaps)
    return proof if proof.proven else None


def _overlaps(checker: CollisionChecker, q: Array) -> list[BodyOverlap]:
    """The overlaps of shapes inside the bodies that penetrate each other at some of the configurations q (k, n)."""
    bare = checker.with_margin(0.0, {})
    pairs: dict[tuple[str, str], tuple[Body, Body, tuple[str, str]]] = {}
    for each in q[:: max(len(q) // EXAMINED, 1)]:
        exact = bare.exact_at(each)  # overlap of convex hulls is no proof of contact
        for k in exact._in_contact(each):
            first, second = (exact.bodies[i] for i in exact.pairs[k])
            pairs.setdefault((first.name, second.name), (first, second, (first.owner, second.owner)))
    carriers = _Carriers(checker.arm)
    found: list[BodyOverlap] = []
    for first, second, names in pairs.values():
        on = carriers.of(first), carriers.of(second)
        if on[0] is not None and on[1] is not None and on[0][0] != on[1][0]:
            found += _between((first, second), (on[0], on[1]), names)
    return found


class _Carriers:
    """The links of a chain that carry bodies: link k follows joint k, and link 0 is the base."""

    def __init__(self, arm: Arm) -> None:
        self._arm, self._base_from_links = arm, _along(arm, arm.home)

    def of(self, body: Body) -> tuple[int, Array] | None:
        """The number of the link that carries a body, and link_from_body; None if a mimic joint moves the body."""
        arm = self._arm
        if body.link is None:
            return 0, (arm.root_from_base.inverse() * body.link_from_body).homogeneous
        joint = moving_joint(arm, body.link)
        if joint and joint not in arm.joint_names:
            return None
        number = arm.joint_names.index(joint) + 1 if joint else 0
        base_from_body = (arm.frame_placement(arm.home, body.link) * body.link_from_body).homogeneous
        return number, np.linalg.inv(self._base_from_links[number]) @ base_from_body


def moving_joint(arm: Arm, link: str) -> str:
    """The last of the joints between the root and a link that move with the arm; empty if the link does not move.

    Links with the same joint are rigidly connected.
    """
    return moved_by(arm.robot.urdf, link, (*arm.joint_names, *arm.followers))


def _along(arm: Arm, q: Array) -> list[Array]:
    """The poses (4, 4) of the links of the chain in the base, link k behind joint k."""
    poses = [np.eye(4)]
    for before, prismatic, value in zip(arm.chain.before, arm.chain.prismatic, q, strict=True):
        motion = np.eye(4)
        if prismatic:
            motion[2, 3] = value
        else:
            motion[:2, :2] = [[np.cos(value), -np.sin(value)], [np.sin(value), np.cos(value)]]
        poses.append(poses[-1] @ before @ motion)
    return poses


def _between(
    bodies: tuple[Body, Body], on: tuple[tuple[int, Array], tuple[int, Array]], names: tuple[str, str]
) -> Sequence[BodyOverlap]:
    """The overlaps of the balls of each body with the box of the other one or, if neither has a box, with its balls."""
    found = []
    shapes = inner_shapes(bodies[0]), inner_shapes(bodies[1])
    for mine, other in ((0, 1), (1, 0)):
        (link, link_from_body), (other_link, other_from_body) = on[mine], on[other]
        there = shapes[other]
        boxes = []
        if there.box_half is not None:
            boxes = [(there.box_centre, there.box_half, there.box_radius)]
        elif shapes[mine].box_half is None and mine == 0:
            boxes = [(ball[:3], np.zeros(3), float(ball[3])) for ball in there.balls]
        balls = [
            *shapes[mine].balls,
            *(np.append(shapes[mine].corners, np.zeros((len(shapes[mine].corners), 1)), axis=1)),
        ]
        for ball in balls if there.box_half is not None else shapes[mine].balls:
            centre = link_from_body[:3, :3] @ ball[:3] + link_from_body[:3, 3]
            for at, half, radius in boxes:
                pose = other_from_body.copy()
                pose[:3, 3] = other_from_body[:3, :3] @ at + other_from_body[:3, 3]
                found.append(
                    BodyOverlap(
                        (names[mine], names[other]), link, centre, float(ball[3]), other_link, pose, half, radius
                    )
                )
    return found
