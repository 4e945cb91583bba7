"""The full rotations with which the arm can move from the start of a sequence to the options of the picks.

An obstacle beside the base can prevent that a joint passes some of its values. A configuration on the other side can
then only be reached the other way round, with the joint shifted by a full rotation. Neighbouring configurations with a
free straight path between them need the same rotations, so a path from the start is planned once for each such group.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import numpy.typing as npt

from pinproof.cell.sequencing.options import Job, PickOption
from pinproof.collision import CollisionChecker
from pinproof.motion.limits import Bounds
from pinproof.motion.steering import least_times, rest_to_rest_times
from pinproof.picks import PickSetup
from pinproof.picks.judging.lines import shifted, span
from pinproof.planning import make_planner
from pinproof.planning.edges import Edges
from pinproof.planning.ends import with_turns
from pinproof.spatial import Array

Indices = npt.NDArray[np.int64]

NEAREST = 4
"""Number of nearest other configurations to which straight paths from each configuration are tried."""

ROTATIONS = 8
"""Largest number of combinations of full rotations that are tried for a group, those with the shortest times first."""

RESOLUTION = 0.01
"""Distance (m) by which bodies move between samples of a straight path before it is proven free."""


def connected(setup: PickSetup, checker: CollisionChecker, start: Array, jobs: list[Job]) -> list[Job]:
    """The jobs with the full rotations of their options that a path from the start (n,) reaches.

    The rotations with the shortest times are tried first. Options to which no path is found are removed, unless a job
    has no others. The checker has the obstacles that no pick moves.
    """
    options = [option for job in jobs for option in job.options]
    ends = np.array([[option.entrance, option.exit] for option in options]).reshape(-1, len(start))
    one_line = [(2 * k + 1, 2 * k + 2) for k, option in enumerate(options) if option.release is None]
    shifts = _rotations(setup, checker, np.vstack([start, ends]), one_line)[1:].reshape(-1, 2, len(start))
    found = iter([_rotated(setup, option, *both) for option, both in zip(options, shifts, strict=True)])
    made = []
    for job in jobs:
        reached = tuple(option for option in [next(found) for _ in job.options] if option is not None)
        made.append(replace(job, options=reached) if reached else job)
    return made


def _rotations(setup: PickSetup, checker: CollisionChecker, q: Array, joined: list[tuple[int, int]]) -> Array:
    """(k, n) the full rotations (rad) with which a path from the first of q (k, n) reaches each of them, or NaN.

    ``joined`` are the pairs of configurations that are known to be connected.
    """
    bounds = Bounds.of(checker.arm.limits, checker.arm.joint_names)
    group = _groups(checker, q, np.array([least_times(q - each, bounds) for each in q]), joined)
    planner = make_planner(setup.budget.planner).limited_to(setup.budget.nodes)
    found = np.full(q.shape, np.nan)
    found[group == group[0]] = 0.0
    from_start = least_times(q - q[0], bounds)
    queue = [np.flatnonzero(group == each) for each in np.unique(group[group != group[0]])]
    for members in queue:
        nearest = q[members[from_start[members].argmin()]]
        goals = with_turns(checker.arm, q[0], nearest[None])[0]
        seconds = rest_to_rest_times(goals - q[0], bounds)
        for goal in goals[np.lexsort((seconds.sum(axis=1), seconds.max(axis=1)))[:ROTATIONS]]:
            if planner.plan(checker, q[0], goal, rng=0).ok:
                inside = checker.arm.limits.inside(q[members] + goal - nearest)
                found[members[inside]] = goal - nearest
                if not inside.all():
                    queue.append(members[~inside])
                break
    return found


def _groups(checker: CollisionChecker, q: Array, times: Array, joined: list[tuple[int, int]]) -> Indices:
    """(k,) the number of the group of each configuration (k, n), by joined pairs and by straight paths proven free."""
    edges = Edges(checker, RESOLUTION, q[:1])
    near = np.argsort(times, axis=1, kind="stable")[:, : NEAREST + 1]
    pairs = {(min(a, b), max(a, b)) for a, row in enumerate(near.tolist()) for b in (0, *row) if a != b}
    group = np.arange(len(q))
    for a, b in joined:
        group[group == group[b]] = group[a]
    while pairs:
        before = np.unique(group)
        for a, b in sorted(pairs, key=lambda pair: (times[pair], pair)):
            if group[a] != group[b] and edges.proven_free(q[a], q[b]):
                group[group == group[b]] = group[a]
        members = [np.flatnonzero(group == each) for each in np.unique(group)]
        pairs = set()
        if len(members) < len(before):  # the nearest configurations of every two groups
            for one, other in combinations(members, 2):
                row, column = np.unravel_index(times[np.ix_(one, other)].argmin(), (len(one), len(other)))
                pairs.add((int(one[row]), int(other[column])))
    return group


def _rotated(setup: PickSetup, option: PickOption, entrance: Array, exit_: Array) -> PickOption | None:
    """The option with full rotations (n,) of the pick and of the release; None if they are NaN or beyond a limit."""
    if not np.isfinite([entrance, exit_]).all():
        return None
    if not np.any([entrance, exit_]):
        return option
    arm, attempt, release = setup.checker.arm, option.attempt, option.release
    if not arm.limits.inside(np.array(attempt.span()) + entrance).all():
        return None
    attempt = replace(attempt, shift=attempt.shift + entrance)
    if release is None:
        return replace(option, attempt=attempt)
    if not arm.limits.inside(np.array(span(release.q, release.lift, release.leave)) + exit_).all():
        return None
    release = replace(
        release, q=release.q + exit_, lift=shifted(release.lift, exit_), leave=shifted(release.leave, exit_)
    )
    bounds = Bounds.of(arm.limits, arm.joint_names)
    transfer = float(least_times(release.entrance - attempt.exit, bounds))
    return replace(option, attempt=attempt, release=release, transfer=transfer)
