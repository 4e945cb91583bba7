"""Tracking of a sequence of poses, cycle by cycle; each joint moves by at most what its speed limit allows.

Each cycle minimises the squared residual |r|^2 in the box of all configurations that position and speed limits allow,
by Gauss-Newton steps in that box (:mod:`pinproof.kernels.track_descent`). The box keeps the motion regular near a
singularity: the tcp deviates in the singular direction, and returns as soon as the speeds suffice.

If several solutions meet at a singularity, the choice is as follows:

* A cycle starts at the extrapolated motion (FADING of it), if that is closer to the target than the current
  configuration. A path through a singular configuration therefore continues smoothly, although one direction of motion
  is singular. If the extrapolation does not lead to the target, the cycle is repeated from the current configuration.
* An arm that deviates and thereby crosses a singularity returns to its side where that is equally good: at the boundary
  of the workspace, where elbow up and elbow down meet, both are. The elbow is therefore the same when the target
  returns. The side is the sign of the determinant of the Jacobian; without a determinant (a redundant arm, or task),
  the side is not guaranteed.
* At rest at a saddle, where the gradient is zero although the target is not reached (it moves in a singular
  direction), the arm tries a motion that does not change the residual at first order, in both senses, and uses it if
  the tcp comes closer to the target.
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
"""The fraction of the last motion with which a cycle starts. Below 1, so that self-motion that no goal requires
decays within about ten cycles."""

SLIP = 1e-8
"""m and rad: a cycle with a larger residual has not reached its target; goals are then ignored."""

FULL_SPEED = 1.0 - 1e-12
"""The fraction of the speed limit that is used, so that quotients of the results do not exceed it by rounding."""


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
    """Track the poses (N, 4, 4), one in each of N cycles, into ``out`` (N, n).

    ``limits`` (2, n) and ``speeds`` (n,) bound the joints; ``durations`` (N,) are those of the cycles in seconds. The
    gain of a goal is per second. ``state`` (3, n) is the state between cycles: the configuration; the rates; and, in
    the first entry of its last row, 0 or the side to which a deviating arm belongs.
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
            # The motion of a goal is not part of the rate, because the goal is evaluated in each cycle.
            state[1, i] = (joints[MOVED, i] - state[0, i]) / duration if duration > 0.0 else 0.0
            state[0, i] = out[row, i] = q[i]


@inlined
def _within(now: float, reach: float) -> float:
    """The sum of both, rounded such that its difference to ``now`` is at most ``reach``."""
    there = now + reach
    while abs(there - now) > abs(reach):
        there = np.nextafter(there, now)
    return there


@compiled
def _tick(belongs: float, chain: Any, goal: Any, q: Any, trial: Any, work: Any) -> float:
    """One cycle; q (n,) is the extrapolated configuration, and becomes the result.

    ``belongs`` is 0, or the side to which the arm belongs since its last cycle deviated; returns the same for this
    cycle.
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
