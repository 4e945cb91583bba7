r"""The score of a whole pick, and what it is at most where only a part of the pick is known.

The score is the weighted sum of four parts from 0 to 1: the least clearance that is seen on the way, the least distance
of a joint from its limits, the manipulability at the grasp, and the share

.. math:: \frac{T_0 + c}{T + c}

of the time T that the motions take at full speed, without stops at corners, with a constant c. T_0 is a lower bound of
that time for every configuration at the grasp, so the score of one does not depend on which others were made.

At most: the clearance and the distance from limits of a part of the motions are never less than those of all; a motion
takes no less time than the joint that has farthest to go, from home to where the approach begins, on to the grasp, to
where the retreat ends, and to where the object is let go. Where the closed form gives every configuration at these
poses, the motion goes through one of them; else only through the grasp.

Source of the search that is made of it: A. Land, A. Doig (1960), "An automatic method of solving discrete programming
problems", Econometrica 28(3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.model import Arm
from pinproof.picks.family import Member
from pinproof.picks.stages.grasp import AMPLE, Candidate
from pinproof.picks.stages.reach import every_branch
from pinproof.picks.stages.seconds import TURN, least_seconds
from pinproof.picks.stages.task import Task

__all__ = ["Scoring"]

Array = npt.NDArray[np.float64]

INSTANT = 0.1
"""Seconds that are added to durations before they are compared: what differs by less is as good."""

TURNS = range(-2, 3)
"""Whole turns at which a joint is looked for inside its limits; limits that are wider bound nothing anyway."""

MANY = 64
"""Grasps of a family up to which the poses at the ends of their lines are solved, to bound the time more closely."""


@dataclass(frozen=True, eq=False)
class Scoring:
    """How the whole picks from some configurations are scored.

    Parameters
    ----------
    bounds
        (k,) the score that a whole pick from each configuration has at most, at whichever whole turns.
    least
        T_0, in seconds.
    """

    task: Task
    bounds: Array
    least: float

    @classmethod
    def of(cls, task: Task, candidates: tuple[Candidate, ...], rest: Callable[[Member, Array, bool], Array]) -> Scoring:
        """The scoring of picks from some configurations; ``rest`` is :meth:`Placer.rest`."""
        seconds = np.empty(len(candidates))
        members: dict[str, list[int]] = {}
        for i, candidate in enumerate(candidates):
            members.setdefault(candidate.member.words, []).append(i)
        exact = len(members) <= MANY and task.cell.closed_form
        for own in members.values():
            q, member = np.array([candidates[i].q for i in own]), candidates[own[0]].member
            seconds[own] = _least(task, q, member, rest, exact)
        least = float(seconds.min(initial=np.inf))
        margins = _widest(task.arm, np.array([candidate.q for candidate in candidates]).reshape(-1, task.arm.dof))
        clearances = np.array([candidate.clearance for candidate in candidates])
        volumes = np.array([candidate.parts["manipulability"] for candidate in candidates])
        return cls(task, _sum(_parts(least, clearances, margins, volumes, seconds), task), least)

    def scores(self, clearance: float, margins: Array, manipulability: float, seconds: Array) -> Array:
        """(k,) the weighted sums of the parts."""
        return _sum(_parts(self.least, np.array(clearance), margins, np.array(manipulability), seconds), self.task)

    def parts(self, clearance: float, margin: float, manipulability: float, seconds: float) -> dict[str, float]:
        """The four parts (0 to 1), and their weighted sum as ``score``."""
        told = (np.array(each) for each in (clearance, margin, manipulability, seconds))
        parts = _parts(self.least, *told)
        return {**{name: float(part) for name, part in parts.items()}, "score": float(_sum(parts, self.task))}


def _parts(least: float, clearance: Array, margin: Array, manipulability: Array, seconds: Array) -> dict[str, Array]:
    return {
        "clearance": np.clip(clearance, 0.0, AMPLE) / AMPLE,
        "limit_margin": margin,
        "manipulability": manipulability,
        "duration": (least + INSTANT) / (seconds + INSTANT),
    }


def _sum(parts: dict[str, Array], task: Task) -> Array:
    weights = task.cell.weights
    return np.asarray(sum(getattr(weights, name) * part for name, part in parts.items()))


def _least(task: Task, q: Array, member: Member, rest: Callable[[Member, Array, bool], Array], exact: bool) -> Array:
    """(k,) seconds that a whole pick takes at least that grasps at q (k, n)."""
    arm, home, grasp = task.arm, task.cell.home[None], task.grasp(member)
    ends = (task.approach_end(grasp), task.pick.approach), (task.retreat_end(grasp), task.pick.retreat)
    before, after = (every_branch(task, pose, exact and length > 0) for pose, length in ends)
    into = least_seconds(arm, home, q)[0]
    if len(before):
        into = (least_seconds(arm, home, before) + least_seconds(arm, q, before)).min(axis=1)
    if len(after):
        return np.asarray(into + (least_seconds(arm, q, after) + rest(member, after, exact)).min(axis=1))
    return np.asarray(into + rest(member, q, exact))


def _widest(arm: Arm, q: Array) -> Array:
    """(k,) what :func:`limit_margin` says of each of q (k, n) at most, at any whole turns inside the limits."""
    limits = arm.limits
    half = (limits.upper - limits.lower) / 2
    best = np.full(q.shape, -np.inf)
    for turns in TURNS:
        at = q + turns * TURN * arm.periodic
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.minimum(at - limits.lower, limits.upper - at) / half
        best = np.maximum(best, np.where(np.isfinite(share), share, 1.0))
    return np.asarray(np.clip(best.min(axis=1, initial=1.0), 0.0, 1.0))
