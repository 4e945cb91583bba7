"""Budgets of rotation over a sequence: how far joints may turn from home, so that cables and hoses do not wind up.

The value of a joint with a budget stays within the budget of its value at home at every instant. The budgets are
therefore joint limits, which every certificate proves between samples too. Within them, each choice for a pick is
repeated for the full rotations at the grasp and at the release that the budgets permit; the search for the order
chooses among these as among other choices.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import cast

import numpy as np

from pinproof.cell.sequencing.options import Job, PickOption, rotated
from pinproof.common.structs import OPTIONAL_NUMBER, TEXT, key, struct
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.motion import Trajectory
from pinproof.picks import Attempt, PickSetup, Release, check_windings
from pinproof.spatial import Array

TURN = 2 * np.pi

MOST_ROTATIONS = 64
"""Largest number of combinations of full rotations of one choice for a pick, those with the shortest transfer first."""

ROUNDING = 1e-6
"""Rad: a budget that is missed by less is not reported as too small."""


@struct("cable_twist", written=True)
class CableTwist:
    """How far a joint turns from its value at home during a sequence, which is the twist of a cable along it."""

    joint: str = key("name of the joint", kind=TEXT)
    largest: float = key("the largest magnitude, proven", "rad", minimum=0)
    final: float = key("at the end, signed", "rad")
    budget: float | None = key("the largest allowed magnitude; null without a budget", "rad", kind=OPTIONAL_NUMBER)

    def __str__(self) -> str:
        largest, final = np.degrees([self.largest, self.final])
        budget = "" if self.budget is None else f" of {np.degrees(self.budget):.0f}"
        return f"{self.joint} {largest:.0f}{budget} deg, at the end {final + 0.0:.0f} deg"


def twists(
    arm: Arm, home: Array, windings: Mapping[str, float], motions: Sequence[Trajectory]
) -> tuple[CableTwist, ...]:
    """The twist of each joint with a budget, and of each revolute joint that can turn by more than a full rotation."""
    able = arm.periodic & (arm.limits.upper - arm.limits.lower > TURN)
    joints = [j for j, name in enumerate(arm.joint_names) if motions and (able[j] or name in windings)]
    ranges = np.array([motion.range() for motion in motions]) - home if motions else np.empty(0)
    return tuple(
        CableTwist(name := arm.joint_names[j], float(np.abs(ranges[..., j]).max()), float(motions[-1].end[j] - home[j]),
              windings.get(name))
        for j in joints
    )  # fmt: skip


def within_windings(setup: PickSetup, windings: Mapping[str, float | str] | None) -> PickSetup:
    """The setup with the budgets (rad) by joint, by default those of the picks, as limits of its arm.

    UnknownNameError for a joint that the arm does not have; InputError for one that is not revolute, or for a budget
    that is not above 0.
    """
    arm, shared = setup.checker.arm, setup.shared
    if windings is not None:
        shared = replace(shared, windings=cast(Mapping[str, float], windings), places={})  # reads texts
    check_windings(arm, shared)
    if not shared.windings:
        return replace(setup, shared=shared)
    lower, upper = arm.limits.lower.copy(), arm.limits.upper.copy()
    for name, budget in shared.windings.items():
        j = arm.joint_names.index(name)
        lower[j] = max(lower[j], setup.home[j] - budget)
        upper[j] = min(upper[j], setup.home[j] + budget)
    narrow = arm.with_limits(replace(arm.limits, lower=lower, upper=upper))
    checker = setup.checker.with_spec(replace(setup.checker.spec, arm=narrow))
    return replace(setup, checker=checker, shared=shared)


def home_of_budgeted(setup: PickSetup) -> dict[str, float]:
    """The values at home of the joints with budgets."""
    home = dict(zip(setup.checker.arm.joint_names, setup.home.tolist(), strict=True))
    return {name: home[name] for name in setup.shared.windings}


def unwound(moved: Trajectory, home: Mapping[str, float]) -> dict[str, int]:
    """The joints that a motion turns back by full rotations, and their number; ``home`` has the joints with budgets.

    The end is closer to home than the same end at the rotation that is nearest to the start.
    """
    numbers = {}
    for name, value in home.items():
        j = moved.joint_names.index(name)
        start, end = float(moved.start[j]) - value, float(moved.end[j]) - value
        number = round((end - start) / TURN)
        if number and abs(end) < abs(end - TURN * number):
            numbers[name] = number
    return numbers


def wound(arm: Arm, home: Array, jobs: Sequence[Job], windings: Mapping[str, float]) -> list[Job]:
    """The jobs with every option at all full rotations of the joints with budgets, in limits that are the budgets."""
    if not windings:
        return list(jobs)
    joints = [arm.joint_names.index(name) for name in windings]

    def turns(part: Attempt | Release) -> list[Array]:
        """(n,) the full rotations that can be added to the lines of a grasp or a release; none is one of them."""
        low, high = part.span
        fewest, most = np.ceil((arm.limits.lower - low) / TURN), np.floor((arm.limits.upper - high) / TURN)
        chosen = product(*(sorted({0.0, *np.arange(fewest[j], most[j] + 1).tolist()}) for j in joints))
        return [TURN * np.array(numbers) @ np.eye(arm.dof)[joints] for numbers in chosen]

    def variants(option: PickOption) -> list[PickOption]:
        release = option.release
        pairs = product(turns(option.attempt), [np.zeros(arm.dof)] if release is None else turns(release))
        found = [one for pick, put in pairs if (one := rotated(arm, option, pick, put)) is not None]
        # of equal ones, the search for the order takes the first: that with the least rotation from home
        found.sort(key=lambda one: (one.transfer, float(np.abs(one.exit - home)[joints].max())))
        return found[:MOST_ROTATIONS]

    return [replace(job, options=tuple(one for option in job.options for one in variants(option))) for job in jobs]


def refuse_small_budgets(setup: PickSetup, free: Job) -> None:
    """Raise InputError if the options that a pick has without budgets all exceed one; ``setup`` has the budgets."""
    windings, names = setup.shared.windings, setup.checker.arm.joint_names
    joints = [names.index(name) for name in windings]
    budgets = np.array(list(windings.values()))
    needs = []
    for option in free.options:
        parts: list[Attempt | Release] = [option.attempt, *([] if option.release is None else [option.release])]
        need = np.zeros(len(joints))
        for part in parts:
            # the rotation at which the larger of the two ends is smallest
            low, high = (bound[joints] - setup.home[joints] for bound in part.span)
            turn = TURN * np.rint((low + high) / 2 / TURN)
            need = np.maximum(need, np.maximum(np.abs(low - turn), np.abs(high - turn)))
        needs.append(need)
    if not needs:
        return
    least = needs[int(np.argmin([(need - budgets).max() for need in needs]))]
    short = [k for k in range(len(joints)) if least[k] > budgets[k] + ROUNDING]
    if short:
        own = "; ".join(
            f"it turns {names[joints[k]]} by {np.degrees(least[k]):.1f} deg from home, and the budget is "
            f"{np.degrees(budgets[k]):.1f} deg"
            for k in short
        )
        raise InputError(
            f"windings: too small for pick {free.pick.name!r}: {own}. Raise the budget, choose another home, or leave "
            "out the pick"
        )
