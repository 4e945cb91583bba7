"""The choices for a pick in a sequence: grasp, IK branches at the grasp and at the release, and its straight lines."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pinproof.cell.sequencing.parts import other_supports
from pinproof.collision import Obstacle, Scene
from pinproof.errors import InputError, TimingError
from pinproof.motion import CubicPath, time_parametrise
from pinproof.motion.limits import Bounds
from pinproof.motion.steering import least_times
from pinproof.picks import Pick, PickSetup, PickVerdict
from pinproof.picks.judging.grasp import Candidate, reach, screen
from pinproof.picks.judging.judge import judge
from pinproof.picks.judging.lines import Attempt, along
from pinproof.picks.judging.motion_limits import rate_limits
from pinproof.picks.judging.place import Placer, Release, release_lines
from pinproof.picks.judging.task import Cell, Task
from pinproof.spatial import Array

RELEASES = 2
"""Number of IK solutions at the release that are considered for each configuration at the grasp, the nearest ones."""


SAME_PLACE = 6
"""Decimals (m) of the poses of parts by which two places are distinguished."""


@dataclass(frozen=True, eq=False)
class PickOption:
    """One complete choice for a pick.

    Parameters
    ----------
    attempt
        The configuration at the grasp, with approach and retreat.
    release
        The configuration at the release with its lines; None without a place.
    lines
        Seconds of the straight lines by name.
    transfer
        Lower bound (s) of the time of the transfer; 0 without a place.
    after
        The part at its place, as an obstacle; None without one. An object that is stated in the tcp rotates with it.
    """

    attempt: Attempt
    release: Release | None
    lines: dict[str, float]
    transfer: float
    after: Obstacle | None = None

    @property
    def entrance(self) -> Array:
        """(n,) the end of the transit to the pick."""
        return self.attempt.entrance

    @property
    def exit(self) -> Array:
        """(n,) the configuration after the pick, where the next transit starts."""
        if self.release is None:
            return self.attempt.exit
        return self.release.q if self.release.leave is None else self.release.leave.end

    @property
    def seconds(self) -> float:
        """Lower bound of the time from the entrance to the exit, without dwell times."""
        return sum(self.lines.values()) + self.transfer


@dataclass(frozen=True, eq=False)
class Job:
    """A pick of a sequence with its options.

    Parameters
    ----------
    pick
        The pick with its poses in the root frame, so that they do not depend on obstacles that are moved.
    options
        The options; empty if the pick fails in the scene without the other parts.
    before
        The part before the pick, as an obstacle; None without one.
    failed
        The verdict on a pick without options.
    """

    pick: Pick
    options: tuple[PickOption, ...]
    before: Obstacle | None = None
    failed: PickVerdict | None = None

    @cached_property
    def places(self) -> tuple[Obstacle, ...]:
        """The part at the different places where the options leave it; empty without a part."""
        found = [option.after for option in self.options if option.after is not None]
        return tuple({(np.round(each.pose.homogeneous, SAME_PLACE) + 0.0).tobytes(): each for each in found}.values())


def part_names(picks: tuple[Pick, ...], scene: Scene) -> dict[str, str]:
    """For each obstacle of the scene that a pick carries, the name of that pick.

    Raises
    ------
    InputError
        If two picks carry the same obstacle, or a pick with an object states no place.
    """
    found: dict[str, str] = {}
    for pick in picks:
        if pick.carried is None:
            continue
        if pick.place is None:
            raise InputError(
                f"pick {pick.name!r} carries an object but states no place; the next pick of a sequence needs an "
                "empty hand, so state place or remove the object"
            )
        name = pick.carried if isinstance(pick.carried, str) else pick.carried.name
        if name in found:
            raise InputError(f"picks {found[name]!r} and {pick.name!r} carry the same object {name!r}; select one")
        if isinstance(pick.carried, Obstacle) and name in scene:
            raise InputError(f"the object {name!r} of pick {pick.name!r} has the name of an obstacle")
        found[name] = pick.name
    return found


def resolved(pick: Pick, setup: PickSetup) -> Pick:
    """The pick with the poses of its grasp and of its place in the root frame.

    Raises
    ------
    InputError
        If a frame, an object or a support does not exist; the message names the pick.
    """
    try:
        task = Task(pick, setup.cell)
    except InputError as error:
        raise InputError(f"pick {pick.name!r}: {error}") from error
    return replace(task.pick, place=task.place)


def options_of(pick: Pick, setup: PickSetup, fixed: Scene, parts: frozenset[str], most: int, index: int) -> Job:
    """The options of a pick, in the scene without the other parts.

    Parameters
    ----------
    pick
        A resolved pick.
    setup
        The cell.
    fixed
        The obstacles that no pick moves.
    parts
        The names of all parts that are moved.
    most
        Largest number of options.
    index
        The index of the pick, for its random stream.
    """
    own = (setup.checker.scene[pick.carried],) if isinstance(pick.carried, str) else ()
    alone = _without_supports(pick, parts)
    checker = setup.checker.with_scene(fixed.add(*own))
    cell = Cell(checker, setup.shared, setup.home, setup.weights, setup.budget)
    task = Task(alone, cell)
    seeds = setup.rng(index).integers(2**31, size=4).tolist()
    bounds = Bounds.of(task.arm.limits, task.arm.joint_names)
    for group in task.groups():
        reached = reach(task, group, seeds[0])
        screened = screen(task, group, reached) if len(reached.q) else None
        candidates = () if screened is None else screened.candidates
        found = _of_candidates(task, candidates, seeds[0], bounds, most)
        if found:
            return Job(pick, tuple(found), own[0] if own else None)
    quick = replace(cell, budget=replace(setup.budget, remedies=0, motion=0))
    verdict = judge(alone, quick, setup.rng(index))
    return Job(pick, (), own[0] if own else None, failed=verdict)


def _without_supports(pick: Pick, parts: frozenset[str]) -> Pick:
    """The pick without stated supports that are parts; where the others are absent, they support nothing."""
    place = None if pick.place is None else replace(pick.place, support=other_supports(pick.place.support, parts))
    return replace(pick, support=other_supports(pick.support, parts), place=place)


def _of_candidates(
    task: Task, candidates: tuple[Candidate, ...], seed: int, bounds: Bounds, most: int
) -> list[PickOption]:
    """The options with the shortest lower bounds of their time from home."""
    placer = Placer(task, seed)
    ranked: list[tuple[float, Candidate, Array | None]] = []
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
        for k in np.argsort(across, kind="stable")[:RELEASES]:
            ranked.append((float(into + across[k] + back[k]), candidate, releases[k]))
    found: list[PickOption] = []
    attempts: dict[int, Attempt] = {}
    releases_of: dict[tuple[str, bytes], Release] = {}
    for _, candidate, q in sorted(ranked, key=lambda each: each[0]):
        if len(found) >= most:
            break
        if id(candidate) not in attempts:
            attempts[id(candidate)] = along(task, candidate)
        attempt = attempts[id(candidate)]
        if not attempt.passed:
            continue
        release = None
        if q is not None and task.place is not None:
            key = candidate.member.words, q.tobytes()
            if key not in releases_of:
                releases_of[key] = release_lines(task, task.place, candidate.member, q)
            release = releases_of[key]
            if release.why:
                continue
        option = _option(task, attempt, release, bounds)
        if option is not None:
            found.append(option)
    return found


def _option(task: Task, attempt: Attempt, release: Release | None, bounds: Bounds) -> PickOption | None:
    """The option with the times of its lines; None if a line cannot be timed."""
    curves: dict[str, CubicPath | None] = {"approach": attempt.line_in(), "retreat": attempt.line_out()}
    transfer = 0.0
    if release is not None:
        curves |= {"place": release.lift, "leave": release.leave}
        transfer = float(least_times(release.entrance - attempt.exit, bounds))
    seconds = {}
    for name, curve in curves.items():
        if curve is None:
            continue
        rates = rate_limits(task, attempt.candidate.member, name, task.outside)
        line = curve.reversed() if name in ("approach", "place") else curve
        try:
            seconds[name] = time_parametrise(line, task.arm.limits, rate_limits=rates).duration
        except TimingError:
            return None
    member, after = attempt.candidate.member, None
    if task.name is not None:
        held = task.holding(member)
        after = replace(held, pose=task.release(member) * task.cell.shared.tip.actInv(held.pose))
    return PickOption(attempt, release, seconds, transfer, after)
