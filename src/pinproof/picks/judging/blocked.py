"""Proofs that every configuration of an arm at a pose is in collision, for arms whose solutions are curves.

Shapes inside the bodies that collide at the configurations found are given to the proof that a pose is out of reach: it
excludes the joint values at which the pose is not reached, and those at which two of the shapes overlap.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker
from pinproof.collision.geometry.bodies import Body
from pinproof.collision.geometry.inner_shapes import inner_shapes
from pinproof.ik import Overlap, ReachProof, is_provable, prove_unreachable
from pinproof.model import Arm
from pinproof.spatial import SE3

Array = npt.NDArray[np.float64]

BOXES = 3000
"""Largest number of boxes of a proof; each takes 10 to 40 microseconds."""

LOOKED_AT = 12
"""Number of configurations whose contacts are used."""

PROBES = 4
"""Number of random configurations at which it is determined by which joints a body is moved."""

AS_RIGID = 1e-9
"""Largest difference of two poses (m, and entries of the rotation) of bodies that are rigidly connected."""


def blocked_words(checker: CollisionChecker, target: SE3, q: Array) -> str:
    """The pairs of bodies of :func:`prove_blocked` as text; empty if it is not proven."""
    proof = prove_blocked(checker, target, q)
    if proof is None:
        return ""
    return " or ".join(f"{first} collides with {second}" for first, second in proof.bodies)


def prove_blocked(checker: CollisionChecker, target: SE3, q: Array) -> ReachProof | None:
    """Try to prove that every configuration at a target is in collision; None if it is not proven.

    Parameters
    ----------
    checker
        The bodies. Only penetration counts, not the margin.
    target
        ``base_from_tcp``.
    q
        (k, n) configurations at the target, all in collision, whose contacts show which bodies may block.
    """
    arm = checker.arm
    if not is_provable(arm) or not len(q) or checker.is_free_batch(q).any():
        return None
    overlaps = _overlaps(checker, q)
    if not overlaps:
        return None
    proof = prove_unreachable(arm, target, search=False, budget=BOXES, overlaps=overlaps)
    return proof if proof.proven else None


def _overlaps(checker: CollisionChecker, q: Array) -> list[Overlap]:
    """The overlaps of shapes inside the bodies that penetrate each other at some of the configurations q (k, n)."""
    bare = checker.with_margin(0.0, {})
    pairs: dict[tuple[str, str], tuple[Body, Body, tuple[str, str]]] = {}
    for each in q[:: max(len(q) // LOOKED_AT, 1)]:
        exact = bare.exact_at(each)  # overlap of convex hulls is no proof of contact
        for k in exact._in_contact(each):
            first, second = (exact.bodies[i] for i in exact.pairs[k])
            pairs.setdefault((first.name, second.name), (first, second, (first.owner, second.owner)))
    carriers = _Carriers(checker.arm)
    found: list[Overlap] = []
    for first, second, names in pairs.values():
        on = carriers.of(first), carriers.of(second)
        if on[0] is not None and on[1] is not None and on[0][0] != on[1][0]:
            found += _between((first, second), (on[0], on[1]), names)
    return found


class _Carriers:
    """The links of a chain by which bodies are carried."""

    def __init__(self, arm: Arm) -> None:
        low, high = arm.limits.sampling_range()
        self._arm = arm
        self._probes = np.random.default_rng(0).uniform(low, high, (PROBES, arm.dof))
        self._base_from_links = [_along(arm, each) for each in self._probes]
        self._known: dict[str | None, tuple[int, Array] | None] = {
            None: (0, np.linalg.inv(arm.root_from_base.homogeneous))
        }

    def of(self, body: Body) -> tuple[int, Array] | None:
        """The number of the link that carries a body, and link_from_body; None if it is rigid with none of them."""
        if body.link not in self._known:
            self._known[body.link] = self._carrier(str(body.link))
        carrier = self._known[body.link]
        return None if carrier is None else (carrier[0], carrier[1] @ body.link_from_body.homogeneous)

    def _carrier(self, frame: str) -> tuple[int, Array] | None:
        poses = np.array([self._arm.frame_placement(q, frame).homogeneous for q in self._probes])
        for number in range(self._arm.dof + 1):
            from_link = np.array([np.linalg.inv(links[number]) for links in self._base_from_links]) @ poses
            if np.abs(from_link - from_link[0]).max() < AS_RIGID:
                return number, from_link[0]
        return None


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
) -> Sequence[Overlap]:
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
                    Overlap((names[mine], names[other]), link, centre, float(ball[3]), other_link, pose, half, radius)
                )
    return found
