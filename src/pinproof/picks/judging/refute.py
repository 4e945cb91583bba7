"""Proofs that every configuration of a pick is excluded, with the reason for each IK branch.

Where all IK solutions are known, each is excluded by its contacts. For arms whose solutions are curves, shapes inside
the bodies that collide at the configurations found are given to the proof that a pose is out of reach: it excludes the
joint values at which the pose is not reached, and those at which two of the shapes overlap.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from pinproof.collision import Body, CollisionChecker, inner_shapes
from pinproof.ik import BodyOverlap, ReachProof, is_provable, prove_unreachable
from pinproof.model import Arm
from pinproof.picks.input.pick import Member
from pinproof.picks.judging.configurations import along_families, configurations
from pinproof.picks.judging.grasp import (
    NO_SOLUTION,
    Reached,
    contact_words,
    contacts_everywhere,
    every_branch_is_known,
    moving_joint,
    proven_unreachable,
)
from pinproof.picks.judging.task import PickTask
from pinproof.spatial import SE3, Array

BOXES = 3000
"""Largest number of boxes of a proof; each takes 10 to 40 microseconds."""

EXAMINED = 12
"""Number of configurations whose contacts are used."""


def prove_blocked(checker: CollisionChecker, target: SE3, q: Array) -> ReachProof | None:
    """Try to prove that every configuration at a target ``base_from_tcp`` is in collision; None if it is not proven.

    The contacts at the known configurations q (k, n), all in collision, show which bodies may block. Only penetration
    counts, not the margin.
    """
    arm = checker.arm
    if not is_provable(arm) or not len(q) or checker.is_free_batch(q).any():
        return None
    # The bodies that penetrate each other at some of the configurations
    bare = checker.with_margin(0.0, {})
    pairs: dict[tuple[str, str], tuple[Body, Body]] = {}
    for each in q[:: max(len(q) // EXAMINED, 1)]:
        exact = bare.exact_at(each)  # overlap of convex hulls is no proof of contact
        for k in exact.pairs_in_contact(each):
            first, second = (exact.bodies[i] for i in exact.pairs[k])
            pairs.setdefault((first.name, second.name), (first, second))
    # Shapes inside them, on two different links of the chain
    base_from_links, overlaps = _chain_at(arm, arm.home), list[BodyOverlap]()
    for first, second in pairs.values():
        on = _carrier(arm, base_from_links, first), _carrier(arm, base_from_links, second)
        if on[0] is not None and on[1] is not None and on[0][0] != on[1][0]:
            overlaps += _overlaps((first, second), (on[0], on[1]))
    if not overlaps:
        return None
    proof = prove_unreachable(arm, target, search=False, budget=BOXES, overlaps=overlaps)
    return proof if proof.proven else None


def _chain_at(arm: Arm, q: Array) -> list[Array]:
    """The poses (4, 4) of the links of the chain in the base, link k behind joint k; link 0 is the base."""
    poses = [np.eye(4)]
    for joint, value in zip(arm.chain.joints, q, strict=True):
        motion = np.eye(4)
        if joint.prismatic:
            motion[2, 3] = value
        else:
            motion[:2, :2] = [[np.cos(value), -np.sin(value)], [np.sin(value), np.cos(value)]]
        poses.append(poses[-1] @ joint.before @ motion)
    return poses


def _carrier(arm: Arm, base_from_links: list[Array], body: Body) -> tuple[int, Array] | None:
    """The number of the link that carries a body, and link_from_body; None if a mimic joint moves the body."""
    if body.link is None:
        return 0, (arm.root_from_base.inverse() * body.link_from_body).homogeneous
    joint = moving_joint(arm, body.link)
    if joint and joint not in arm.joint_names:
        return None
    number = arm.joint_names.index(joint) + 1 if joint else 0
    base_from_body = (arm.frame_placement(arm.home, body.link) * body.link_from_body).homogeneous
    return number, np.linalg.inv(base_from_links[number]) @ base_from_body


def _overlaps(bodies: tuple[Body, Body], on: tuple[tuple[int, Array], tuple[int, Array]]) -> Iterator[BodyOverlap]:
    """The overlaps of the balls of each body with the box of the other one or, if neither has a box, with its balls."""
    shapes, owners = (inner_shapes(bodies[0]), inner_shapes(bodies[1])), (bodies[0].owner, bodies[1].owner)
    for mine, other in ((0, 1), (1, 0)):
        (link, link_from_body), (other_link, other_from_body) = on[mine], on[other]
        own, there, boxes, balls = shapes[mine], shapes[other], [], [*shapes[mine].balls]
        if there.box_half is not None:
            boxes = [(there.box_centre, there.box_half, there.box_radius)]
            balls += [*np.append(own.corners, np.zeros((len(own.corners), 1)), axis=1)]
        elif own.box_half is None and mine == 0:
            boxes = [(ball[:3], np.zeros(3), float(ball[3])) for ball in there.balls]
        for ball in balls:
            centre = link_from_body[:3, :3] @ ball[:3] + link_from_body[:3, 3]
            for at, half, radius in boxes:
                pose = other_from_body.copy()
                pose[:3, 3] = other_from_body[:3, :3] @ at + other_from_body[:3, 3]
                names, size = (owners[mine], owners[other]), float(ball[3])
                yield BodyOverlap(names, link, centre, size, other_link, pose, half, radius)


# -- reasons ----------------------------------------------------------------------------------------------------------

LINE_DEVIATION = 1e-3, 1e-2
"""Metres and rad: the deviation of the tcp from the pose on a straight line that :func:`plan_linear` permits."""

BETWEEN = (0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875)
"""Shares of a line at which its poses are tested."""

BETWEEN_BOXES = 100
"""Largest number of boxes of each of these proofs, a few milliseconds."""


def _refuted(members: list[Member], reasons_of: Callable[[Member], list[str]]) -> tuple[str, ...]:
    """The reasons that exclude each grasp; empty if there are none for one of them."""
    reasons: list[str] = []
    for member in members:
        if not (found := reasons_of(member)):
            return ()
        reasons += [member.head + words for words in found]
    return tuple(reasons)


def reasons_against_every_branch(task: PickTask, members: list[Member], seed: int) -> tuple[str, ...]:
    """Why each IK branch of each grasp is excluded, at the grasp or at the end of a line; empty if one is not.

    A line that could not be planned proves nothing. A grasp is refuted if no branch reaches an end of its lines or a
    pose on them, or if every branch is in contact at an end.
    """
    pick, (position, orientation) = task.pick, LINE_DEVIATION

    def reasons_of(member: Member) -> list[str]:
        grasp = task.grasp(member)
        found = _branches_refuted(task, grasp, task.at_grasp, "the grasp", seed)
        if not found and pick.approach:
            found = _branches_refuted(task, pick.before(grasp), task.at_grasp, "the end of the approach", seed)
        if not found and pick.retreat:
            found = _branches_refuted(task, pick.after(grasp), task.carrying(member), "the end of the retreat", seed)
        if found or not is_provable(task.arm):
            return found
        # A pose on a line may be out of reach, by more than lines may deviate
        lines = (pick.approach, pick.before, "approach"), (pick.retreat, pick.after, "retreat")
        for length, pose_at, name in lines:
            for share in BETWEEN if length else ():
                proof = prove_unreachable(
                    task.arm,
                    task.target(pose_at(grasp, share)),
                    position_tolerance=position,
                    orientation_tolerance=orientation,
                    budget=BETWEEN_BOXES,
                    search=False,
                )
                if proof.proven:
                    return [f"{NO_SOLUTION} the {name} {share * length * 1e3:.0f} mm from the grasp"]
        return []

    return _refuted(members, reasons_of)


def reasons_at_release(task: PickTask, members: list[Member], seed: int) -> tuple[str, ...]:
    """Why each IK branch at the release of each grasp is excluded; empty if one is not."""
    if task.place is None:
        return ()
    return _refuted(
        members,
        lambda member: _branches_refuted(task, task.release(member), task.letting_go(member), "the release", seed),
    )


def reasons_by_contact(task: PickTask, members: list[Member], reached: Reached, seed: int) -> tuple[str, ...]:
    """Why no configuration of an arm with unknown further IK solutions is free at any grasp; empty if not proven."""

    def reasons_of(member: Member) -> list[str]:
        known = reached.q[reached.member == members.index(member)]
        if not len(known) and proven_unreachable(task.arm, [task.target(task.grasp(member))]):
            return [f"{NO_SOLUTION} the grasp"]
        words = _contacts_of_all(task, task.grasp(member), task.at_grasp, seed, known)
        return [f"{words}, for every IK solution"] if words else []

    return _refuted(members, reasons_of)


def _branches_refuted(
    task: PickTask, root_from_tip: SE3, checker: CollisionChecker, where: str, seed: int
) -> list[str]:
    """Why each IK branch at a pose is excluded; empty if one is not, or if not all are known."""
    if not every_branch_is_known(task, [task.target(root_from_tip)]):
        if proven_unreachable(task.arm, [task.target(root_from_tip)]):
            return [f"{NO_SOLUTION} {where}"]
        words = _contacts_of_all(task, root_from_tip, checker, seed)
        return [f"at {where}: {words}"] if words else []
    _, many = configurations(task.arm, task.targets([root_from_tip]), task.cell.home, seed)
    if checker.is_free_batch(many).any():
        return []
    reasons = []
    for q in many:
        result = checker.finer_at(q).check(q)  # contact between convex hulls is no proof of contact between the meshes
        if result.free:
            return []
        reasons.append(f"at {where}: {'; '.join(contact_words(result))}")
    return reasons or [f"{NO_SOLUTION} {where}"]


def _contacts_of_all(
    task: PickTask, root_from_tip: SE3, checker: CollisionChecker, seed: int, known: Array | None = None
) -> str:
    """The contacts by which every configuration at a pose is excluded; empty if this is not proven.

    Bodies that are rigidly connected to the tcp have the same pose for every IK solution, so their contacts with
    obstacles exclude all of them. Otherwise the joint values are divided into boxes (:func:`prove_blocked`).
    """
    targets = task.targets([root_from_tip])
    some = configurations(task.arm, targets, task.cell.home, seed)[1] if known is None else known
    if len(some) and (words := contacts_everywhere(checker, some[0])):
        return "; ".join(words)
    many = np.concatenate([some, along_families(task.arm, targets, task.cell.home)[1]])
    proof = prove_blocked(checker, task.target(root_from_tip), many)
    pairs = () if proof is None else proof.bodies
    return " or ".join(f"{first} collides with {second}" for first, second in pairs)
