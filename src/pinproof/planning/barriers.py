"""Proofs that no path exists, because a joint cannot pass a value between the start and every goal.

Two bodies that a single joint moves relative to each other have the same distance at all configurations with the same
value of that joint. If they are in contact at a value between the start and a goal, every path to this goal
contains the contact, because the joint passes the value (intermediate value theorem). An example is the second arm of
a mobile robot in front of a shelf: it is held in place, moves with the torso alone, and cannot pass the boards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinproof._core import Workspace
from pinproof.collision import CollisionChecker, Contact
from pinproof.spatial import Array

VALUES = 128
"""Number of values of a joint that are checked between the start and the nearest goal."""

CONFIRMED = 8
"""Number of values in contact that are checked with finer bodies: a contact of hulls alone proves nothing."""


@dataclass(frozen=True, eq=False)
class Barrier:
    """A value that a joint cannot pass.

    Parameters
    ----------
    joint
        The name of the joint.
    value
        The value (rad or m).
    contact
        The contact of bodies that only this joint moves relative to each other.
    """

    joint: str
    value: float
    contact: Contact

    def __str__(self) -> str:
        return f"{self.joint} cannot pass {self.value:.4g}, where {self.contact} at all values of the other joints"


def find_barriers(checker: CollisionChecker, start: Array, goals: Array) -> tuple[Barrier, ...]:
    """Return barriers between the start (n,) and the goals (g, n) if every goal is behind a barrier, otherwise ()."""
    # The pairs of bodies that a single joint moves relative to each other, by the index of the joint.
    space = Workspace(checker.world)
    joints_of = [frozenset(space.joints_of_body(i)) for i in range(len(checker.bodies))]
    pairs_of: dict[int, set[int]] = {}
    for pair, (i, j) in enumerate(checker.pairs):
        between = {space.joint(k).index for k in joints_of[i] ^ joints_of[j]}
        if len(between) == 1:
            pairs_of.setdefault(between.pop(), set()).add(pair)

    reachable = np.ones(len(goals), dtype=bool)
    barriers = []
    for joint, pairs in sorted(pairs_of.items()):
        judge = checker.without_pairs(set(range(len(checker.pairs))) - pairs)
        owners = {frozenset(checker.bodies[i].owner for i in checker.pairs[pair]) for pair in pairs}
        for side in (-1.0, 1.0):
            steps = side * (goals[:, joint] - start[joint])
            behind = reachable & (steps > 0)
            if not behind.any():
                continue
            # Values of the joint between the start and the nearest goal on this side at which a pair is in contact.
            q = np.tile(start, (VALUES, 1))
            q[:, joint] += side * float(steps[behind].min()) * np.arange(1, VALUES + 1) / (VALUES + 1)
            blocked = [k for k in range(VALUES) if not judge.is_free_unchecked(q[k])]
            chosen = np.linspace(0, len(blocked) - 1, min(CONFIRMED, len(blocked)))
            # Contacts of hulls are no proof; the deepest contact of finer bodies is the barrier.
            confirmed = [
                Barrier(judge.group.joint_names[joint], float(q[k, joint]), contact)
                for k in (blocked[round(row)] for row in chosen.tolist())
                for contact in judge.finer_at(q[k]).check(q[k]).contacts
                if frozenset(contact.bodies) in owners  # checkers with finer bodies check all pairs again
            ]
            if confirmed:
                barriers.append(min(confirmed, key=lambda barrier: barrier.contact.distance))
                reachable &= ~behind
    return () if reachable.any() else tuple(barriers)


def no_path_message(barriers: Sequence[Barrier]) -> str:
    """The message of a plan to goals behind these barriers."""
    remedy = "Move what collides, hold its joints at other values, or choose goals before this value"
    return f"no path exists: {'; '.join(map(str, barriers))}. {remedy}"
