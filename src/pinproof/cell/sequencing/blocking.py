"""The precedence that geometry demands: which parts must be moved before others."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pinproof.cell.sequencing.options import Job, PickOption
from pinproof.cell.sequencing.precedence import Pair
from pinproof.collision import CollisionChecker, Obstacle, Scene
from pinproof.motion import CubicPath
from pinproof.picks import PickSetup
from pinproof.picks.input.pick import Member
from pinproof.picks.judging.task import DOWN, SUPPORT_GAP, Cell, Task
from pinproof.spatial import Array

SAMPLES = 9
"""Number of samples of each straight line. They only find the precedence; every motion is certified later."""

CARRIED, AT_PLACE = "carried part", " at its place"
"""Names for the carried part, and for parts at their places, in a scene with all parts before and after."""


def geometric_precedence(setup: PickSetup, jobs: list[Job], fixed: Scene) -> dict[Pair, str]:
    """Pairs (before, after) of indices of jobs that no motion can avoid, with the reason.

    A part that rests on another is picked first, and put down after its support. A part that blocks every option of
    another pick is moved before it if it blocks at its first position, and after it if it blocks at its place.
    """
    owner: dict[str, tuple[int, bool]] = {}
    parts: list[Obstacle] = []
    for i, job in enumerate(jobs):
        if job.before is not None:
            owner[job.before.name] = i, False
            parts.append(job.before)
        if len(job.places) == 1:  # with several places, none of them is certain to block
            owner[job.places[0].name + AT_PLACE] = i, True
            parts.append(replace(job.places[0], name=job.places[0].name + AT_PLACE))
    if not parts:
        return {}
    everything = fixed.add(*parts)
    open_hand = setup.checker.with_scene(everything)
    closed_hand = setup.cell.closed_hand.with_scene(everything)
    found: dict[Pair, str] = {}
    for i, job in enumerate(jobs):
        blockers: set[str] | None = None
        hands: dict[str, CollisionChecker] = {}
        for option in job.options:
            member = option.attempt.candidate.member
            if job.places and member.words not in hands:
                hands[member.words] = _carrying(setup, job, member, closed_hand)
            blocked, supports = _contacts(job, option, open_hand, hands.get(member.words))
            for name in supports:
                other, placed = owner.get(name, (i, False))
                if other == i:
                    continue
                pair = (other, i) if placed else (i, other)
                verb = "is placed on" if placed else "rests on"
                found[pair] = f"{jobs[i].pick.name} {verb} {jobs[other].pick.name}"
            blockers = blocked if blockers is None else blockers & blocked
        for name in blockers or ():
            other, placed = owner.get(name, (i, False))
            if other != i:
                pair = (i, other) if placed else (other, i)
                found.setdefault(pair, f"{name} blocks {jobs[i].pick.name}")
    return found


def _carrying(setup: PickSetup, job: Job, member: Member, closed_hand: CollisionChecker) -> CollisionChecker:
    """The checker with the part in the closed hand, among all parts before and after."""
    alone = setup.checker.with_scene(Scene(() if job.before is None else (job.before,)))
    pick = replace(job.pick, place=None, support=None)
    held = Task(pick, Cell(alone, setup.shared, setup.home, setup.weights, setup.budget)).holding(member)
    return closed_hand.with_attached(replace(held, name=CARRIED))


def _contacts(
    job: Job, option: PickOption, open_hand: CollisionChecker, carrying: CollisionChecker | None
) -> tuple[set[str], set[str]]:
    """The names of what is in contact on the lines of an option, and of what supports the part at either end."""
    pick, attempt, release = job.pick, option.attempt, option.release
    blocked: set[str] = set()
    for q in _samples(attempt.line_in(), attempt.q):
        blocked |= _touched(open_hand, q)
    if release is not None:
        for q in _samples(release.leave, release.q):
            blocked |= _touched(open_hand, q)
    if carrying is None:
        return blocked, set()
    supports = _supports(carrying, attempt.q, pick.support)
    lines = [(attempt.line_out(), attempt.q, supports)]
    if release is not None:
        below = _supports(carrying, release.q, None if pick.place is None else pick.place.support)
        lines.append((release.lift, release.q, below))
        supports = supports | below
    for curve, end, allowed in lines:
        for q in _samples(curve, end):
            blocked |= _touched(carrying, q) - allowed
    return blocked, supports


def _samples(curve: CubicPath | None, q: Array) -> Iterator[Array]:
    if curve is None:
        yield q
        return
    yield from curve(np.linspace(curve.bezier()[0][0], curve.bezier()[0][-1], SAMPLES))


def _touched(checker: CollisionChecker, q: Array) -> set[str]:
    """The names of obstacles in contact with the arm and what it carries."""
    if checker.is_free_unchecked(q):
        return set()
    return {name for contact in checker.check(q).contacts for name in contact.bodies if name in checker.scene}


def _supports(carrying: CollisionChecker, q: Array, stated: object) -> set[str]:
    """What the carried part rests on at q (n,); see :meth:`pinproof.picks.judging.task.Task.supports`."""
    found = set() if stated is None else {str(name) for name in stated}  # type: ignore[attr-defined]
    found |= {f"{name}{AT_PLACE}" for name in found}
    near = carrying.with_margin(max(SUPPORT_GAP, carrying.margin))
    for contact in near.check(q).contacts:
        if CARRIED in contact.bodies and contact.distance <= SUPPORT_GAP:
            first = contact.bodies[0] == CARRIED
            if (1 if first else -1) * contact.normal[2] < DOWN:
                found.add(contact.bodies[1] if first else contact.bodies[0])
    return found & carrying.scene.keys()
