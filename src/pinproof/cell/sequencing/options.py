"""The choices for a pick in a sequence: grasp, IK branches at the grasp and at the release, and its straight lines.

Picks are judged without the other parts of a sequence, which are not at their places when a pick is executed.

An obstacle beside the base can prevent that a joint passes some of its values. A configuration on the other side can
then only be reached the other way round, with the joint shifted by a full rotation. Neighbouring configurations with a
free straight path between them need the same rotations, so a path from the start is planned once for each such group.
"""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, Obstacle, Scene
from pinproof.common.structs import described, key
from pinproof.errors import InputError, TimingError
from pinproof.model import Arm
from pinproof.motion import Bounds, CubicPath, least_times, time_parametrise
from pinproof.picks import (
    Attempt,
    GraspCandidate,
    NamedFrame,
    Pick,
    Picks,
    PickSetup,
    PickTask,
    PickVerdict,
    Placer,
    Release,
    along,
    judge,
    rate_limits,
    reach,
    release_lines,
    root_from_frame,
    screen,
    support_names,
)
from pinproof.planning import Edges, planner_of, with_turns
from pinproof.spatial import Array

Indices = npt.NDArray[np.int64]


def without_parts(arm: Arm, scene: Scene, picks: Picks) -> tuple[Scene, Picks]:
    """Remove all parts that picks carry from the scene, and state each part in its pick.

    Parts that are stacked or placed on each other block each other in a scene that contains all of them at
    their first place. A placement of the base should not depend on this: the sequence decides which parts are there
    when a pick is made (:func:`pinproof.sequence`), and certifies the motions with them.

    Returns
    -------
    tuple[Scene, Picks]
        The scene without the parts, and the picks, each with its part attached after the grasp.
    """
    if typed := next((pick.name for pick in picks if pick.part is not None), None):
        raise InputError(f"pick {typed!r} names a part type, whose object must be in the scene; state its pose instead")
    parts = {pick.carried for pick in picks if isinstance(pick.carried, str) and pick.carried in scene.names}

    def of_part(frame: str) -> bool:
        while frame in picks.frames:
            frame = picks.frames[frame].frame
        return frame in parts

    def alone(pick: Pick) -> Pick:
        place = pick.place
        # frames of parts are replaced by poses, and supports that are parts are left out
        if place is not None:
            if of_part(place.frame):
                pose = root_from_frame(place.frame, picks.frames, scene, arm) * place.pose
                place = replace(place, pose=pose, frame="")
            place = replace(place, support=other_supports(place.support, parts))
        support = other_supports(pick.support, parts)
        pose = root_from_frame(pick.frame, picks.frames, scene, arm) * pick.pose if pick.frame else pick.pose
        carried = pick.carried
        # the part itself is stated in the tcp
        if isinstance(carried, str) and carried in parts:
            carried = replace(scene[carried], pose=pose.actInv(scene[carried].pose))
        if not of_part(pick.frame):
            return replace(pick, carried=carried, place=place, support=support)
        return replace(pick, pose=pose, frame="", carried=carried, place=place, support=support)

    frames = {
        name: NamedFrame(root_from_frame(name, picks.frames, scene, arm)) if of_part(name) else frame
        for name, frame in picks.frames.items()
    }
    return replace(scene.remove(*sorted(parts)), margins=scene.margins), replace(
        picks, picks=tuple(map(alone, picks)), frames=frames
    )


def other_supports(support: str | Sequence[str] | None, parts: AbstractSet[str]) -> tuple[str, ...] | None:
    """The stated supports that are not parts; None if no other is stated."""
    return tuple(name for name in support_names(support) or () if name not in parts) or None


RELEASES = 2
"""Number of IK solutions at the release that are considered for each configuration at the grasp, the nearest ones."""


NEAREST = 4
"""Number of nearest other configurations to which straight paths from each configuration are tried."""

ROTATIONS = 8
"""Largest number of combinations of full rotations that are tried for a group, those with the shortest times first."""

RESOLUTION = 0.01
"""Distance (m) by which bodies move between samples of a straight path before it is proven free."""

SAME_PLACE = 6
"""Decimals (m) of the poses of parts by which two places are distinguished."""


@dataclass(frozen=True, eq=False)
class PickOption:
    """One complete choice for a pick."""

    # The pick with its grasp and its tool, and its poses in the root frame.
    pick: Pick
    # The configuration at the grasp, with approach and retreat.
    attempt: Attempt
    # The configuration at the release with its lines; None without a place.
    release: Release | None
    # Seconds of the straight lines by name.
    lines: dict[str, float]
    # Lower bound (s) of the time of the transfer; 0 without a place.
    transfer: float
    # The part at its place, as an obstacle; None without one. An object that is stated in the tcp rotates with it.
    after: Obstacle | None = None

    @property
    def entrance(self) -> Array:
        """(n,) the end of the transit to the pick."""
        return self.attempt.entrance

    @property
    def exit(self) -> Array:
        """(n,) the configuration after the pick, where the next transit starts."""
        return self.attempt.exit if self.release is None else self.release.exit

    @property
    def seconds(self) -> float:
        """Lower bound of the time from the entrance to the exit, without dwell times."""
        return sum(self.lines.values()) + self.transfer


@described(eq=False)
class Job:
    """A pick of a sequence with its options."""

    pick: Pick = key(
        "the pick, with the first of its grasps, and its poses in the root frame, so that they do not depend on "
        "obstacles that are moved"
    )
    options: tuple[PickOption, ...] = key("the options; empty if the pick fails in the scene without the other parts")
    before: Obstacle | None = key("the part before the pick, as an obstacle; None without one", default=None)
    failed: PickVerdict | None = key("the verdict on a pick without options", default=None)

    @cached_property
    def places(self) -> tuple[Obstacle, ...]:
        """The part at the different places where the options leave it; empty without a part."""
        parts = [option.after for option in self.options if option.after is not None]
        return tuple({(np.round(part.pose.homogeneous, SAME_PLACE) + 0.0).tobytes(): part for part in parts}.values())


def part_names(picks: tuple[Pick, ...], scene: Scene) -> dict[str, str]:
    """For each obstacle of the scene that a pick carries, the name of that pick.

    InputError if two picks carry the same obstacle, or a pick with an object states no place.
    """
    owner: dict[str, str] = {}
    for pick in picks:
        if pick.carried is None:
            continue
        if pick.place is None:
            raise InputError(
                f"pick {pick.name!r} carries an object but states no place; the next pick of a sequence needs an "
                "empty hand, so state place or remove the object"
            )
        name = pick.carried if isinstance(pick.carried, str) else pick.carried.name
        if name in owner:
            raise InputError(f"picks {owner[name]!r} and {pick.name!r} carry the same object {name!r}; select one")
        if isinstance(pick.carried, Obstacle) and name in scene.names:
            raise InputError(f"the object {name!r} of pick {pick.name!r} has the name of an obstacle")
        owner[name] = pick.name
    return owner


def resolved(pick: Pick, setup: PickSetup) -> tuple[Pick, ...]:
    """The pick with each of its grasps, with the poses of the grasp and of its place in the root frame.

    InputError if a frame, an object or a support does not exist; the message names the pick.
    """
    try:
        tasks = [PickTask(grasp, setup.cell) for grasp in setup.shared.grasps_of(pick)]
    except InputError as error:
        raise InputError(f"pick {pick.name!r}: {error}") from error
    return tuple(replace(task.pick, place=task.place) for task in tasks)


@dataclass(frozen=True, eq=False)
class PickOptions:
    """Finds the options of resolved picks, each in the scene without the other parts."""

    setup: PickSetup
    # The obstacles that no pick moves.
    fixed: Scene
    # The names of all parts that are moved.
    parts: frozenset[str]
    # Largest number of options of a pick with one tool.
    most: int

    def __call__(self, start: int, picks: Sequence[tuple[Pick, ...]]) -> list[Job]:
        """The jobs of consecutive picks, each with its grasps; the index determines the random stream."""
        return [self._job(grasps, index) for index, grasps in enumerate(picks, start)]

    def _job(self, grasps: tuple[Pick, ...], index: int) -> Job:
        """The options of the first grasp that has some for each tool; the order chooses between the tools."""
        found: dict[str | None, Job] = {}
        failed: list[Job] = []
        for pick in grasps:
            if pick.tool not in found:
                job = self._of_grasp(pick, index)
                if job.options:
                    found[pick.tool] = job
                else:
                    failed.append(job)
        if found:
            options = tuple(option for job in found.values() for option in job.options)
            return replace(next(iter(found.values())), pick=grasps[0], options=options)
        return max(failed, key=lambda job: 0 if job.failed is None else len(job.failed.stages))

    def _of_grasp(self, pick: Pick, index: int) -> Job:
        setup, parts = self.setup, self.parts
        before = setup.checker.scene[pick.carried] if isinstance(pick.carried, str) else None
        # where the other parts are absent, they support nothing
        place = None if pick.place is None else replace(pick.place, support=other_supports(pick.place.support, parts))
        alone = replace(pick, support=other_supports(pick.support, parts), place=place)
        checker = setup.checker.with_scene(self.fixed if before is None else self.fixed.add(before))
        cell = replace(setup.cell, checker=checker)
        task = PickTask(alone, cell)
        seeds = setup.rng(index).integers(2**31, size=4).tolist()
        bounds = Bounds.of(task.arm.limits, task.arm.joint_names)
        for group in task.groups():
            reached = reach(task, group, seeds[0])
            screened = screen(task, group, reached) if len(reached.q) else None
            if screened is not None:
                for nearest in (RELEASES, None):  # the nearest releases may all be in contact
                    options = _options(task, pick, screened.candidates, seeds[0], bounds, self.most, nearest)
                    if options:
                        return Job(pick, tuple(options), before)
        # without an option, the pick is judged for its reason
        quick = replace(cell, budget=replace(setup.budget, remedies=0, motion=0))
        return Job(pick, (), before, failed=judge(alone, quick, setup.rng(index)))


def _options(
    task: PickTask,
    pick: Pick,
    candidates: tuple[GraspCandidate, ...],
    seed: int,
    bounds: Bounds,
    most: int,
    nearest: int | None,
) -> list[PickOption]:
    """The options with the shortest lower bounds of their time from home, of the ``nearest`` releases of each grasp."""
    # the nearest releases of each candidate, by the time from home through both and back
    placer = Placer(task, seed)
    ranked: list[tuple[float, GraspCandidate, Array | None]] = []
    for candidate in candidates:
        into = least_times(candidate.q - task.cell.home, bounds)
        if task.place is None:
            ranked.append((float(into), candidate, None))
            continue
        releases = placer.releases(candidate.member)
        if not len(releases):
            continue
        across = least_times(releases - candidate.q, bounds)
        back = least_times(releases - task.cell.home, bounds)
        for k in np.argsort(across, kind="stable")[:nearest]:
            ranked.append((float(into + across[k] + back[k]), candidate, releases[k]))
    # those whose lines exist and can be timed; lines of a grasp and of a release are computed once
    options: list[PickOption] = []
    attempts: dict[int, Attempt] = {}
    releases_of: dict[tuple[str, bytes], Release] = {}
    for _, candidate, q in sorted(ranked, key=lambda rank: rank[0]):
        if len(options) >= most:
            break
        if id(candidate) not in attempts:
            attempts[id(candidate)] = along(task, candidate)
        attempt, member = attempts[id(candidate)], candidate.member
        if not attempt.passed:
            continue
        release = None
        curves: dict[str, CubicPath | None] = {"approach": attempt.approach, "retreat": attempt.retreat}
        if q is not None and task.place is not None:
            key = member.words, q.tobytes()
            if key not in releases_of:
                releases_of[key] = release_lines(task, task.place, member, q)
            release = releases_of[key]
            if release.why:
                continue
            curves |= {"place": release.lift, "leave": release.leave}
        seconds = {}
        try:
            for name, curve in curves.items():
                if curve is not None:
                    rates = rate_limits(task, member, name, task.outside)
                    line = curve.reversed() if name in ("approach", "place") else curve
                    seconds[name] = time_parametrise(line, task.arm.limits, rate_limits=rates).duration
        except TimingError:
            continue
        after = None
        if task.name is not None:
            held = task.holding(member)
            after = replace(held, pose=task.release(member) * task.cell.shared.tip.actInv(held.pose))
        transfer = 0.0 if release is None else float(least_times(release.entrance - attempt.exit, bounds))
        options.append(PickOption(pick, attempt, release, seconds, transfer, after))
    return options


def connected(setup: PickSetup, checker: CollisionChecker, start: Array, jobs: list[Job]) -> list[Job]:
    """The jobs with the full rotations of their options that a path from the start (n,) reaches.

    The rotations with the shortest times are tried first. Options to which no path is found are removed, unless a job
    has no others. The checker has the obstacles that no pick moves.
    """
    options = [option for job in jobs for option in job.options]
    ends = np.array([[option.entrance, option.exit] for option in options]).reshape(-1, len(start))
    q = np.vstack([start, ends])
    # groups of configurations with free straight paths between them; an option without a place is one line
    one_line = [(2 * k + 1, 2 * k + 2) for k, option in enumerate(options) if option.release is None]
    bounds = Bounds.of(checker.arm.limits, checker.arm.joint_names)
    group = _groups(checker, q, np.array([least_times(q - start_of, bounds) for start_of in q]), one_line)
    # the full rotations with which a path from the start reaches the nearest configuration of each group
    planner = planner_of(setup.budget.planner).limited_to(setup.budget.nodes)
    shifts = np.full(q.shape, np.nan)
    shifts[group == group[0]] = 0.0
    from_start = least_times(q - q[0], bounds)
    queue = [np.flatnonzero(group == number) for number in np.unique(group[group != group[0]])]
    for members in queue:
        nearest = q[members[from_start[members].argmin()]]
        goals = with_turns(checker.arm, q[0], nearest[None])[0]
        seconds = least_times(goals - q[0], bounds, by_joint=True)
        for goal in goals[np.lexsort((seconds.sum(axis=1), seconds.max(axis=1)))[:ROTATIONS]]:
            if planner.plan(checker, q[0], goal, rng=0).ok:
                inside = checker.arm.limits.inside(q[members] + goal - nearest)
                shifts[members[inside]] = goal - nearest
                if not inside.all():
                    queue.append(members[~inside])
                break
    pairs = zip(options, shifts[1:].reshape(-1, 2, len(start)), strict=True)
    turned = iter([rotated(checker.arm, option, *both) for option, both in pairs])
    connected_jobs = []
    for job in jobs:
        reached = tuple(option for option in [next(turned) for _ in job.options] if option is not None)
        connected_jobs.append(replace(job, options=reached) if reached else job)
    return connected_jobs


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
        members = [np.flatnonzero(group == number) for number in np.unique(group)]
        pairs = set()
        if len(members) < len(before):  # the nearest configurations of every two groups
            for first, second in combinations(members, 2):
                row, column = np.unravel_index(times[np.ix_(first, second)].argmin(), (len(first), len(second)))
                pairs.add((int(first[row]), int(second[column])))
    return group


def rotated(arm: Arm, option: PickOption, entrance: Array, exit_: Array) -> PickOption | None:
    """The option with full rotations (n,) of the pick and of the release; None if they are NaN or beyond a limit."""
    if not np.isfinite([entrance, exit_]).all():
        return None
    if not np.any([entrance, exit_]):
        return option
    attempt, release = option.attempt, option.release
    for part, by in ((attempt, entrance), (release, exit_)):
        if part is not None and not arm.limits.inside(np.array(part.span) + by).all():
            return None
    attempt = attempt.turned(entrance)
    if release is None:
        return replace(option, attempt=attempt)
    release = release.turned(exit_)
    transfer = float(least_times(release.entrance - attempt.exit, Bounds.of(arm.limits, arm.joint_names)))
    return replace(option, attempt=attempt, release=release, transfer=transfer)
