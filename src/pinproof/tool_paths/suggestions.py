"""Suggestions: the smallest changes of a tool path, the part or the base with which the whole path can be followed.

The candidates of each kind of change are ordered by size. A candidate is screened first: at some poses of the changed
path, the blocked ones before the others, some configuration must exist that is free. Those that pass are followed
completely, and the first one with a certified motion is the suggestion of its kind. The number of paths that are
followed is limited, not the time.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from pinproof.collision import CollisionChecker
from pinproof.common.steps import SUGGESTIONS, step
from pinproof.common.structs import described, key
from pinproof.common.validation import require_integer
from pinproof.errors import InputError
from pinproof.ik import IkTask
from pinproof.spatial import SE3, pose, rotation_about
from pinproof.tool_paths.following import follow
from pinproof.tool_paths.path import ToolPath
from pinproof.tool_paths.result import FollowPlan, FollowStatus
from pinproof.tool_paths.rungs import FollowCosts, Grid, PathArm, Rung, fill

# Degrees by which the tool is tilted and the part rotated, and millimetres by which the base and the part are moved.
TILTS = (5, 10, 15, 20, 30)
ROTATIONS = (5, 10, 15, 20, 30, 45, 60, 90, 120, 150, 180)
DISTANCES = (10, 20, 50, 100, 150, 200, 300, 400)
# Shares of the length of an approach and a departure, and millimetres to which the shorter lengths are rounded.
SHORTER = (0.75, 0.5, 0.25)
# Factors of the share of the speed that the tool keeps, to which its speed is reduced.
SLOWER = (0.9, 0.5, 0.25)
AXES = "xyz"
# Numbers of poses and of rotations of the tool at which a candidate is screened.
SCREENED, SCREENED_ROTATIONS = 24, 12
# Largest number of candidates of one kind that are followed.
FOLLOWED = 3


@described(eq=False)
class PathSuggestion:
    """A change with which a tool path is followed by a certified motion."""

    text: str = key("the change in one line")
    size: float = key("its size in mm, degrees, or as a share")
    plan: FollowPlan = key("the plan with the change", hidden=True)


class Case(NamedTuple):
    """What is followed: a path, by the arm of a checker, with settings of :func:`pinproof.follow`."""

    checker: CollisionChecker
    path: ToolPath
    settings: dict[str, Any]


class Change(NamedTuple):
    """A candidate: its text, its size and the changed case."""

    text: str
    size: float
    apply: Callable[[Case], Case]


@step(SUGGESTIONS)
def suggest_changes(
    plan: FollowPlan, settings: dict[str, Any], *, part: Sequence[str] = (), budget: int = 12
) -> tuple[PathSuggestion, ...]:
    """The smallest change of each kind with which the path of a failed plan can be followed.

    Parameters
    ----------
    plan
        The plan without a motion.
    settings
        The keyword arguments of :func:`pinproof.follow` that it was made with.
    part
        The names of the obstacles that move with the path when the part is moved or rotated.
    budget
        Largest number of changed paths that are followed completely; 0 for no suggestions.

    Raises
    ------
    InputError
        If a part is not an obstacle of the scene.
    """
    require_integer("budget", budget, 0)
    if plan.ok:
        return ()
    case = Case(plan.checker, plan.path, settings)
    if unknown := [name for name in part if name not in case.checker.scene]:
        raise InputError(f"the part {unknown[0]!r} is not an obstacle of the scene")
    # The poses that are screened, those that are blocked before the others
    blocked = [place for each in plan.blocked for place in (each.pose, each.last) if 0.0 <= place <= len(plan.path) - 1]
    spread = np.linspace(0.0, len(plan.path) - 1.0, min(SCREENED, len(plan.path)))
    places = list(dict.fromkeys([*blocked[:SCREENED], *spread.tolist()]))
    found = []
    for changes in _kinds(case, plan, tuple(part)):
        tried = 0
        for change in changes:
            if budget == 0 or tried == FOLLOWED:
                break
            changed = change.apply(case)
            if not _may_pass(changed, places):
                continue
            tried, budget = tried + 1, budget - 1
            again = follow(changed.checker, changed.path, **changed.settings)
            if again.ok:
                found.append(PathSuggestion(change.text, change.size, again))
                break
    return tuple(found)


def screening_grid(free: bool | tuple[float, float]) -> Grid:
    """Some rotations of the tool, by the setting ``free_rotation`` of :func:`pinproof.follow`."""
    if free is False:
        return Grid(np.zeros(1), np.eye(3)[None])
    low, high = (0.0, 2.0 * math.pi * (1.0 - 1.0 / SCREENED_ROTATIONS)) if free is True else free
    return Grid(np.linspace(low, high, SCREENED_ROTATIONS), np.eye(3)[None])


def _may_pass(case: Case, places: Sequence[float]) -> bool:
    """Whether some configuration is free at each of some poses; True if that is not decided by a closed form."""
    settings = case.settings
    path_arm = PathArm.of(case.checker.group, settings.get("frame"), settings.get("arm"))
    if path_arm.arm.dof != 6 or path_arm.external or path_arm.coupled:
        return True
    grid = screening_grid(case.settings.get("free_rotation", True))
    for first in range(0, len(places), 4):
        rungs = [Rung(0, 0.0, place, 0.0) for place in case.path.at(places[first : first + 4])]
        fill(rungs, case.checker, path_arm, grid, IkTask(), FollowCosts(), 0)
        if not all(len(rung.rates) for rung in rungs):
            return False
    return True


def _kinds(case: Case, plan: FollowPlan, part: tuple[str, ...]) -> Iterator[list[Change]]:
    """The candidates of each kind, in the order of their sizes."""
    settings, everything = case.settings, case.checker.scene.names
    if plan.status is FollowStatus.TOO_SLOW and case.path.speed is not None:
        share = min(piece.speed_share for piece in plan.pieces)
        percents = [percent for factor in SLOWER if (percent := math.floor(100.0 * factor * share))]
        yield [
            Change(f"reduce the speed of the tool to {to} %", 100.0 - to, partial(_slower, to=to / 100.0))
            for to in percents
        ]
        return
    # Shorter lines, where they are blocked, and a free rotation
    for name, beyond in (("approach", operator.lt), ("departure", operator.gt)):
        length, end = settings.get(name) or 0.0, 0.0 if name == "approach" else len(case.path) - 1.0
        if length and any(beyond(each.pose, end) or beyond(each.last, end) for each in plan.blocked):
            yield [
                Change(
                    f"shorten the {name} from {1e3 * length:g} mm to {after} mm", 1e3 * length - after,
                    partial(_with, changed={name: after / 1e3}),
                )
                for after in (math.floor(1e3 * share * length) for share in SHORTER)
            ]  # fmt: skip
    if settings.get("free_rotation", True) is not True:
        text = "let the tool rotate freely about its axis (free_rotation)"
        yield [Change(text, 1.0, partial(_with, changed={"free_rotation": True}))]
    yield [
        Change(
            f"tilt the tool by {sign * size:+d} deg about the {AXES[axis]} axis of its poses", float(size),
            partial(_tilted, turn=_turn(axis, sign * size)),
        )
        for size, axis, sign in product(TILTS, (0, 1), (1, -1))
    ]  # fmt: skip
    if settings.get("frame"):  # the part moves with the frame of the path
        return
    # The part rotates about the z axis of the base through the middle of the path
    ends = case.path.poses[:, :3, 3]
    middle = pose(0.5 * (ends.min(axis=0) + ends.max(axis=0)))
    what = f"the path and {', '.join(part)}" if part else "the path"
    yield [
        Change(
            f"rotate {what} by {sign * size:+d} deg about the z axis of the base", float(size),
            partial(_part_moved, motion=middle * _turn(2, sign * size) * middle.inverse(), names=part),
        )
        for size, sign in product(ROTATIONS, (1, -1)) if sign * size != -180
    ]  # fmt: skip
    for text, names, way in ((f"move {what}", part, 1.0), ("move the base", everything, -1.0)):
        yield [
            Change(
                f"{text} by {size} mm along {'+' if sign > 0 else '-'}{AXES[axis]} (base frame)", float(size),
                partial(_part_moved, motion=pose(1e-3 * way * sign * size * np.eye(3)[axis]), names=names),
            )
            for size, axis, sign in product(DISTANCES, range(3), (1, -1))
        ]  # fmt: skip


def _slower(case: Case, to: float) -> Case:
    speed = None if case.path.speed is None else to * case.path.speed
    return case._replace(path=replace(case.path, speed=speed))


def _with(case: Case, changed: dict[str, Any]) -> Case:
    return case._replace(settings={**case.settings, **changed})


def _tilted(case: Case, turn: SE3) -> Case:
    return case._replace(path=replace(case.path, poses=case.path.poses @ turn.homogeneous))


def _turn(axis: int, degrees: float) -> SE3:
    return SE3(rotation_about(np.eye(3)[axis], math.radians(degrees)), np.zeros(3))


def _part_moved(case: Case, motion: SE3, names: Sequence[str]) -> Case:
    """The case with the path and obstacles displaced by a motion that is stated in the base frame of the arm."""
    root = case.checker.arm.root_from_base
    scene, moved = case.checker.scene, root * motion * root.inverse()
    for name in names:
        scene = scene.move(name, moved * scene[name].pose)
    return Case(case.checker.with_scene(scene), case.path.transformed(motion), case.settings)
