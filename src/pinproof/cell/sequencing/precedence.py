"""Which picks must be executed before which others: stated pairs, and those that geometry demands."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from graphlib import CycleError, TopologicalSorter

import numpy as np

from pinproof.cell.sequencing.options import Job, PickOption
from pinproof.collision import CollisionChecker, Obstacle, Scene
from pinproof.common.structs import described, key
from pinproof.errors import InputError, UnknownNameError
from pinproof.motion import CubicPath
from pinproof.picks import PickSetup, PickTask, support_names, supports_below
from pinproof.spatial import Array

Pair = tuple[int, int]


@described()
class Precedence:
    """Pairs (before, after) of indices of picks, each with its reason."""

    names: tuple[str, ...] = key("the names of the picks")
    reasons: Mapping[Pair, str] = key(
        "why the first pick of each pair must be executed before the second", default_factory=dict
    )

    @classmethod
    def stated(cls, names: Iterable[str], pairs: Iterable[tuple[str, str]]) -> Precedence:
        """The precedence that pairs of names (before, after) state.

        Raises
        ------
        UnknownNameError
            If a pair names a pick that does not exist.
        InputError
            If an item is no pair, or the pairs contradict each other; the message names a cycle.
        """
        empty, reasons = cls(tuple(names)), dict[Pair, str]()
        for number, pair in enumerate(pairs):
            both = tuple(pair) if isinstance(pair, Iterable) and not isinstance(pair, str) else ()
            if len(both) != 2:
                raise InputError(f"precedence[{number}] = {pair!r:.80}; it must be a pair of names of picks")
            before, after = (empty.index(name, "the precedence") for name in both)
            reasons[before, after] = "stated"
        return cls(empty.names, reasons).checked()

    def index(self, name: str, where: str) -> int:
        """The index of a pick; UnknownNameError if it does not exist."""
        if name not in self.names:
            raise UnknownNameError("pick", name, self.names, where)
        return self.names.index(name)

    @property
    def rows(self) -> list[tuple[str, str, str]]:
        """The names of the first and the second pick of each pair, and the reason."""
        return [(self.names[a], self.names[b], reason) for (a, b), reason in self.reasons.items()]

    def with_pairs(self, reasons: Mapping[Pair, str]) -> Precedence:
        """The precedence with more pairs; the reasons of existing pairs are kept."""
        return Precedence(self.names, {**reasons, **self.reasons})

    def of(self, picks: Sequence[int]) -> Precedence:
        """The precedence of some of the picks."""
        new = {old: k for k, old in enumerate(picks)}
        pairs = {(new[a], new[b]): why for (a, b), why in self.reasons.items() if a in new and b in new}
        return Precedence(tuple(self.names[i] for i in picks), pairs)

    def checked(self) -> Precedence:
        """The same precedence, if an order satisfies it.

        Raises
        ------
        InputError
            If the pairs contradict each other; the message names a cycle, with its reasons.
        """
        if cycle := self.cycle():
            steps = [
                f"{self.names[a]} before {self.names[b]} ({self.reasons[a, b]})"
                for a, b in zip(cycle, (*cycle[1:], cycle[0]), strict=True)
            ]
            raise InputError(f"the precedence of the picks is contradictory: {', '.join(steps)}")
        return self

    def cycle(self) -> tuple[int, ...]:
        """Indices of picks each of which must be executed before the next, and the last before the first; or empty."""
        try:
            TopologicalSorter(dict(enumerate(self.predecessors()))).prepare()
        except CycleError as error:
            *cycle, _ = error.args[1]  # the last one is the first one again
            least = cycle.index(min(cycle))
            return (*cycle[least:], *cycle[:least])
        return ()

    def predecessors(self) -> list[set[int]]:
        """For each pick the picks that must be executed before it."""
        before: list[set[int]] = [set() for _ in self.names]
        for first, second in self.reasons:
            before[second].add(first)
        return before

    def allows(self, order: Iterable[int]) -> bool:
        """Whether an order of all picks satisfies every pair."""
        place = {pick: k for k, pick in enumerate(order)}
        return all(place[before] < place[after] for before, after in self.reasons)


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
    reasons: dict[Pair, str] = {}
    for i, job in enumerate(jobs):
        blockers: set[str] | None = None
        hands: dict[tuple[str | None, str | None, str], tuple[CollisionChecker, CollisionChecker | None]] = {}
        for option in job.options:
            member, pick = option.attempt.candidate.member, option.pick
            key = pick.tool, pick.grasp, member.words
            if key not in hands:
                # the open hand, and the part in the closed hand, among all parts before and after
                alone = setup.checker.with_scene(Scene(() if job.before is None else (job.before,)))
                task = PickTask(replace(pick, place=None, support=None), replace(setup.cell, checker=alone))
                closed = None
                if job.places:
                    held = replace(task.holding(member), name=CARRIED)
                    closed = task.closed(member).closed_hand.with_scene(everything).with_attached(held)
                hands[key] = task.cell.checker.with_scene(everything), closed
            blocked, supports = _contacts(option, *hands[key])
            for name in supports:
                owner_job, placed = owner.get(name, (i, False))
                if owner_job == i:
                    continue
                pair = (owner_job, i) if placed else (i, owner_job)
                verb = "is placed on" if placed else "rests on"
                reasons[pair] = f"{jobs[i].pick.name} {verb} {jobs[owner_job].pick.name}"
            blockers = blocked if blockers is None else blockers & blocked
        for name in blockers or ():
            owner_job, placed = owner.get(name, (i, False))
            if owner_job != i:
                pair = (i, owner_job) if placed else (owner_job, i)
                reasons.setdefault(pair, f"{name} blocks {jobs[i].pick.name}")
    return reasons


def _contacts(
    option: PickOption, open_hand: CollisionChecker, carrying: CollisionChecker | None
) -> tuple[set[str], set[str]]:
    """The names of what is in contact on the lines of an option, and of what supports the part at either end."""
    pick, attempt, release = option.pick, option.attempt, option.release
    blocked: set[str] = set()
    # with an empty hand: the line in, and the line after the release
    for q in _samples(attempt.approach, attempt.q):
        blocked |= _touched(open_hand, q)
    if release is not None:
        for q in _samples(release.leave, release.q):
            blocked |= _touched(open_hand, q)
    if carrying is None:
        return blocked, set()
    # with the part in the hand, which may touch what supports it at that end
    supports = _supports(carrying, attempt.q, pick.support)
    lines = [(attempt.retreat, attempt.q, supports)]
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
    names = set(checker.scene.names)
    return {name for contact in checker.check(q).contacts for name in contact.bodies if name in names}


def _supports(carrying: CollisionChecker, q: Array, support: str | Sequence[str] | None) -> set[str]:
    """What the carried part rests on at q (n,): the stated supports, and those below it."""
    names = set(support_names(support) or ())
    names |= {f"{name}{AT_PLACE}" for name in names}
    return (names & set(carrying.scene.names)) | set(supports_below(carrying, q, CARRIED))
