"""Following a sequence of poses tick by tick: each joint moves no further than its speed allows, whatever is asked.

In each tick the residual |r|^2 is made as small as it gets in the box of all configurations that position and speed
limits allow, by Gauss-Newton steps in that box (:mod:`pinproof.kernels.track_descent`). The box is what keeps the arm
whole near a singularity: the direction that is lost there slips, and is caught up as soon as the speeds suffice.

Which of several answers is taken, where a singularity makes several meet:

* A tick begins where the last motion would lead (FADING of it), if that is nearer to the target than standing still.
  So a path through a singular configuration goes on as smoothly as it came, though the singularity hides one direction
  of motion. Where a first slip shows that it does not lead to the target, the tick is made again from where it began.
* An arm that slips, and thereby crosses a singularity, goes back to its side wherever that is as good: at the boundary
  of the reach, where elbow up and elbow down meet, each is. So an arm asked out of its reach comes back as it went. The
  side is the sign of the Jacobian's determinant; without one (a redundant arm, or task), nothing is promised.
* At rest on a saddle, where the gradient vanishes though the target is not reached (it moves in a direction that the
  arm has lost), the arm tries a motion that changes nothing at first order, one way and the other, and takes it if the
  target comes nearer.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pinproof.kernels.compiled import compiled, inlined
from pinproof.kernels.goals import NONE, drift_of
from pinproof.kernels.search import _start_from_target
from pinproof.kernels.track_branch import BACK, SLACK, escape, side_of, stay
from pinproof.kernels.track_descent import BEGAN, CEILING, FLOOR, clamped, copy, look, settle, wander
from pinproof.kernels.workspace import ASKED, BEST, MOVED, Workspace, workspace

__all__ = ["track_many"]

FADING = 0.9
"""The share of the last motion that a tick begins with. Below 1, so that self-motion which nothing asks for dies out,
within some ten ticks."""

SLIP = 1e-8
"""m and rad: a tick that ends with more has not reached its target; what a goal wishes for waits."""

FULL_SPEED = 1.0 - 1e-12
"""The share of the speed limit that is used: quotients of the answers do not round above it."""


@compiled
def track_many(
    chain: Any,
    limits: Any,
    speeds: Any,
    asked: Any,
    goal: Any,
    state: Any,
    poses: Any,
    durations: Any,
    out: Any,
) -> None:
    """Follow the poses (N, 4, 4), one in each of N ticks, into ``out`` (N, n).

    ``limits`` (2, n) and ``speeds`` (n,) bound the joints, ``durations`` (N,) are those of the ticks in seconds. The
    gain of a goal counts per second. ``state`` (3, n) is what goes from tick to tick: the configuration; the rates;
    and, the first entry of its last row, 0 or the side to which an arm that slips belongs.
    """
    n = speeds.shape[0]
    turns, axes, start, end, jacobian, rows, square, lower, _, _ = workspace(chain.shape[0] - 1, n)
    joints, errors = np.zeros((BACK + 1, n)), np.zeros((5, 6))
    work = Workspace(turns, axes, start, end, jacobian, rows, square, lower, joints, errors)
    q, trial, gained = np.empty(n), np.empty(n), goal.copy()
    for i in range(6):
        errors[ASKED, i] = asked[i]
    for row in range(len(poses)):
        _start_from_target(poses, row, start)
        duration = durations[row]
        for i in range(n):
            now, reach = state[0, i], FULL_SPEED * speeds[i] * duration
            joints[BEGAN, i] = now
            joints[FLOOR, i] = max(limits[0, i], _within(now, -reach))
            joints[CEILING, i] = min(limits[1, i], _within(now, reach))
            q[i] = clamped(joints, i, now + FADING * state[1, i] * duration)
        gained[0, 1] = min(1.0, goal[0, 1] * duration)
        state[2, 0] = _tick(state[2, 0], chain, gained, q, trial, work)
        for i in range(n):
            # What a goal has moved is no part of the rate: the goal asks again in each tick.
            state[1, i] = (joints[MOVED, i] - state[0, i]) / duration if duration > 0.0 else 0.0
            state[0, i] = out[row, i] = q[i]


@inlined
def _within(now: float, reach: float) -> float:
    """The sum of both, rounded such that its difference to ``now`` is no more than ``reach``."""
    there = now + reach
    while abs(there - now) > abs(reach):
        there = np.nextafter(there, now)
    return there


@compiled
def _tick(belongs: float, chain: Any, goal: Any, q: Any, trial: Any, work: Any) -> float:
    """One tick; q (n,) is where the last motion leads, and becomes the answer.

    ``belongs`` is 0, or the side to which the arm belongs since its last tick slipped; returns the same of this tick.
    """
    turns, axes, start, end, jacobian, _, square, lower, joints, _ = work
    n = q.shape[0]
    for i in range(n):
        trial[i] = joints[BEGAN, i]
    moving = look(chain, q, work) < look(chain, trial, work)
    if not moving:
        copy(trial, q)
    squared = settle(chain, q, trial, work)
    if squared > SLIP * SLIP and moving and belongs == 0.0:
        for i in range(n):
            joints[BEST, i], q[i] = q[i], joints[BEGAN, i]
        other = settle(chain, q, trial, work)
        if math.sqrt(other) > math.sqrt(squared) + SLACK:
            for i in range(n):
                q[i] = joints[BEST, i]
        else:
            squared = other
    slipped = squared > SLIP * SLIP
    if slipped:
        squared = escape(chain, q, trial, squared, work)
    if slipped or belongs != 0.0:
        if belongs == 0.0:
            for i in range(n):
                trial[i] = joints[BEGAN, i]
            belongs = side_of(chain, trial, work)
        if side_of(chain, q, work) == -belongs:
            squared = stay(belongs, chain, q, trial, squared, work)
    for i in range(n):
        joints[MOVED, i] = q[i]
    if squared > SLIP * SLIP:
        return belongs
    if goal[0, 0] != NONE:
        look(chain, q, work)
        drift_of(goal, chain, q, start, turns, axes, end, jacobian, square, lower, joints)
        if wander(chain, q, trial, work) > SLIP * SLIP:
            for i in range(n):
                q[i] = joints[MOVED, i]
    return 0.0
