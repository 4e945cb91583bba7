"""Self-collision, collision and grip at the grasp: every configuration is judged, those that pass are ranked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker
from pinproof.collision.checker import CheckResult, Contact
from pinproof.picks.configurations import manipulability
from pinproof.picks.family import Member
from pinproof.picks.settings import PickWeights
from pinproof.picks.stages.grip import grip_holds, judge_grip, not_held_words
from pinproof.picks.stages.reach import Reached
from pinproof.picks.stages.task import Task
from pinproof.picks.verdict import Stage, StageResult

__all__ = ["Candidate", "Screened", "contact_words", "limit_margin", "rank", "screen", "weighed"]

Array = npt.NDArray[np.float64]

AMPLE = 0.05
"""Metres of clearance from which on more is worth nothing."""

RANKED = 256
"""Free configurations that are measured and ranked; of more, those nearest to home in the time that joints take."""

SAID = 6
"""Contacts that a reason names at most."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A configuration that is free at the grasp, with the parts (0 to 1) by which it is ranked."""

    q: Array
    member: Member
    clearance: float
    parts: dict[str, float]


@dataclass(frozen=True, eq=False)
class Screened:
    """Those that are free and hold the object, the best first, and what is to be said of the stages.

    ``refuted``, where there are none: why each configuration is out. ``not_held``: whether no grasp holds the object,
    so that no other configuration would.
    """

    candidates: tuple[Candidate, ...]
    stages: tuple[StageResult, ...]
    refuted: tuple[str, ...] = ()
    not_held: bool = False


def screen(task: Task, members: list[Member], reached: Reached) -> Screened:
    """Look at all configurations at the grasp."""
    checker = task.at_grasp
    free = checker.is_free_batch(reached.q)
    if not free.any():
        return _none(checker, members, reached)
    q, of_member = reached.q[free], reached.member[free]
    gripped = judge_grip(task, members, q, of_member)
    of = f"{int(free.sum())} of {len(free)} configurations" if len(free) > 1 else "it"
    own = StageResult(Stage.SELF, True, "the arm is free of itself")
    if not gripped.kept.any():
        stages = (own, StageResult(Stage.GRASP, True, f"{of} free", {"free": float(free.sum())}), gripped.result)
        if not any(grip_holds(task, member) for member in members):
            return Screened((), stages, tuple(not_held_words(task, member) for member in members), True)
        touching = _refuted([checker.check(each) for each in reached.q[~free]], members, reached.member[~free])
        return Screened((), stages, (*gripped.refuted, *touching))
    kept = np.flatnonzero(gripped.kept)
    candidates = rank(task, q[kept], [members[i] for i in of_member[kept]])
    said = f"{of} free, up to {max(c.clearance for c in candidates) * 1e3:.1f} mm clearance"
    figures = {"free": float(free.sum()), "clearance": max(c.clearance for c in candidates)}
    return Screened(tuple(candidates), (own, StageResult(Stage.GRASP, True, said, figures), gripped.result))


def rank(task: Task, q: Array, members: list[Member]) -> list[Candidate]:
    """Free configurations q (k, n), the best first by the weights of the cell."""
    arm, home = task.arm, task.cell.home
    seconds = (np.abs(q - home) / arm.limits.velocity).max(axis=1)
    if len(q) > RANKED:
        near = np.sort(np.argsort(seconds, kind="stable")[:RANKED])
        q, members, seconds = q[near], [members[i] for i in near], seconds[near]
    clearance, volume = task.at_grasp.clearance_batch(q), manipulability(arm, q)
    margins = limit_margin(task, q, q)
    ranked = []
    for i, member in enumerate(members):
        parts = {
            "clearance": float(np.clip(clearance[i], 0.0, AMPLE)) / AMPLE,
            "limit_margin": float(margins[i]),
            "manipulability": float(volume[i] / max(volume.max(), np.finfo(float).tiny)),
            "duration": float((seconds.min() + 0.1) / (seconds[i] + 0.1)),
        }
        ranked.append(Candidate(q[i], member, float(clearance[i]), parts))
    return sorted(ranked, key=lambda candidate: -weighed(candidate.parts, task.cell.weights))


def weighed(parts: dict[str, float], weights: PickWeights) -> float:
    """The weighted sum of parts."""
    return sum(getattr(weights, name) * value for name, value in parts.items())


def limit_margin(task: Task, low: Array, high: Array) -> Array:
    """How far joints that span from low to high (..., n) stay from limits: 1 in the middle of all ranges, 0 at one."""
    limits = task.arm.limits
    half = (limits.upper - limits.lower) / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.minimum(low - limits.lower, limits.upper - high) / half
    return np.asarray(np.clip(np.where(np.isfinite(share), share, 1.0).min(axis=-1), 0.0, 1.0))


def contact_words(result: CheckResult) -> list[str]:
    """One sentence for each two that touch, the deepest first: links have several bodies, and one contact says it."""
    deepest = {contact.bodies: contact for contact in reversed(result.contacts)}
    return [str(contact) for contact in result.contacts if deepest[contact.bodies] is contact]


def _none(checker: CollisionChecker, members: list[Member], reached: Reached) -> Screened:
    """No configuration is free: the one with the least contact speaks for all."""
    found = [checker.check(q) for q in reached.q]
    own = [[c for c in each.contacts if not _with_obstacle(c, checker)] for each in found]
    refuted = _refuted(found, members, reached.member)
    stage = Stage.SELF if all(own) else Stage.GRASP
    # where some are free of themselves, one of these is told of
    told = [i for i in range(len(found)) if stage is Stage.SELF or not own[i]]
    best = max(told, key=lambda i: min((c.distance for c in found[i].contacts), default=-np.inf))
    words = contact_words(found[best])
    said = "; ".join(words[:SAID]) + (f"; and {len(words) - SAID} more" if len(words) > SAID else "")
    if len(found) > 1:
        said += f" (the least of {len(found)} configurations, all in contact{_others(found)})"
    figures = {"configurations": float(len(found)), "distance": min(c.distance for c in found[best].contacts)}
    failed = StageResult(stage, False, said, figures)
    if stage is Stage.SELF:
        return Screened((), (failed,), refuted)
    passed = StageResult(Stage.SELF, True, f"{len(told)} of {len(found)} configurations free of the arm itself")
    return Screened((), (passed, failed), refuted)


def _refuted(found: list[CheckResult], members: list[Member], of: npt.NDArray[np.int64]) -> tuple[str, ...]:
    """What each configuration touches, and which grasp it is of."""
    return tuple(
        f"{members[i].words + ': ' if members[i].words else ''}{'; '.join(contact_words(each))}"
        for i, each in zip(of, found, strict=True)
    )


def _with_obstacle(contact: Contact, checker: CollisionChecker) -> bool:
    return any(name in checker.scene.names for name in contact.bodies)


def _others(found: list[CheckResult]) -> str:
    """Which pairs touch in how many of the configurations, the commonest first."""
    counts: dict[str, int] = {}
    for each in found:
        for pair in {" and ".join(contact.bodies) for contact in each.contacts}:
            counts[pair] = counts.get(pair, 0) + 1
    common = sorted(counts.items(), key=lambda item: (-item[1], item[0]))[:3]
    return ": " + ", ".join(f"{pair} in {count}" for pair, count in common)
