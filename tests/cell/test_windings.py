"""Budgets of rotation over a sequence: dense sampling, brute force over full rotations, unwinding moves, bad input."""

from __future__ import annotations

import json
import re
from itertools import pairwise, permutations, product
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.cell.sequencing.sequence import judge_options
from pinproof.motion import Bounds, least_times
from pinproof.picks import PickBudget, PickSetup, PlaceTarget, SuctionCup

TURN = 2 * np.pi
WRIST = "wrist_3_joint"
TABLE = pp.Obstacle("table", pp.Box(2.4, 2.4, 0.04), pp.pose((0.3, 0, -0.025)))
ROD = pp.Obstacle("lance", pp.Cylinder(radius=0.01, length=0.15), pp.pose((0, 0, 0.075)))
REACH = {"ur5": 0.45, "ur10e": 0.75}


def arm_of(name: str, *, continuous: bool = False) -> pp.Arm:
    if not continuous:
        return pp.load_robot(name).arm(tcp="tool0")
    before, after = pp.load_robot(name).urdf.text.split(f'name="{WRIST}" type="revolute"')
    return pp.load_robot(f'{before}name="{WRIST}" type="continuous"{after}').arm(tcp="tool0")


def turning(
    name: str, count: int, *, step: float = 100.0, places: float | None = None, continuous: bool = False
) -> tuple[PickSetup, tuple[pp.Pick, ...]]:
    """Picks in a row, each turned by ``step`` degrees against the one before; and places, turned by ``places``."""
    picks = []
    for k in range(count):
        at, turned = (REACH[name], 0.07 * (k - (count - 1) / 2), 0.05), np.radians(step * k % 360)
        own = {}
        if places is not None:
            put = pp.pose(np.add(at, (-0.12, 0, 0)), (np.pi, 0, (turned + np.radians(places)) % TURN))
            part = pp.Obstacle(f"part_{k}", pp.Box(0.03, 0.03, 0.03), pp.pose((0, 0, 0.015)))
            own = {"carried": part, "place": PlaceTarget(put, approach=0.06, retreat=0.06)}
        picks.append(pp.Pick(f"pick_{k}", pp.pose(at, (np.pi, 0, turned)), approach=0.06, retreat=0.07, **own))
    shared = {"tip": pp.pose((0, 0, 0.15)), "tool": (ROD,), "cup": SuctionCup(radius=0.01), "margin": 0.002}
    arm = arm_of(name, continuous=continuous)
    scene = pp.Scene([TABLE], allowed=[(arm.robot.urdf.links[0], "table")])
    budget = PickBudget(remedies=0, motion=40)
    return PickSetup.make(arm, scene, pp.Picks(picks, **shared), home=None, rng=0, budget=budget), tuple(picks)


def in_order(setup: PickSetup, picks: tuple[pp.Pick, ...], degrees: float | None, **more) -> pp.cell.SequenceResult:
    budgets = None if degrees is None else {WRIST: np.radians(degrees)}
    return pp.sequence(setup, picks, order=[pick.name for pick in picks], windings=budgets, **more)


def largest(result: pp.cell.SequenceResult) -> float:
    """The largest rotation (rad) of the last joint from home at many samples of all motions, which must be joined."""
    motions = [motion.trajectory for motion in result.motions]
    assert all(np.allclose(before.end, after.start, atol=1e-12) for before, after in pairwise(motions))
    samples = [motion(np.linspace(0.0, motion.duration, 3000)) for motion in motions]
    return float(np.abs(np.concatenate(samples)[:, -1] - result.setup.home[-1]).max())


@pytest.mark.parametrize(
    ("name", "count", "degrees", "continuous"),
    [("ur5", 12, 200, False), ("ur5", 6, 300, False), ("ur10e", 12, 250, False), ("ur10e", 6, 400, True)],
)
def test_a_joint_stays_within_its_budget_at_every_sample(name, count, degrees, continuous) -> None:
    setup, picks = turning(name, count, continuous=continuous)
    result = in_order(setup, picks, degrees)
    assert result.ok
    assert all(motion.certificate.free for motion in result.motions)
    (twist,) = (own for own in result.twist if own.joint == WRIST)
    sampled = largest(result)
    assert sampled <= np.radians(degrees) + 1e-9
    assert sampled - 1e-9 <= twist.largest <= sampled + 1e-3
    assert twist.budget == pytest.approx(np.radians(degrees))
    assert twist.final == 0.0


def test_a_wider_budget_takes_less_time_and_winds_further() -> None:
    setup, picks = turning("ur10e", 6)
    narrow, wide = (in_order(setup, picks, degrees) for degrees in (200, 400))
    assert wide.lower_bound <= narrow.lower_bound
    assert wide.duration < narrow.duration
    assert largest(wide) > np.radians(200) > largest(narrow)


def turned_inside(curve: pp.motion.CubicPath | None, q: np.ndarray, shift: float, limit: float, home: float) -> bool:
    """Whether the last joint is within the limit of home at q (n,), and on a line at many samples."""
    values = q[None] if curve is None else np.vstack([q, curve(np.linspace(*curve.domain, 200))])
    return bool(np.abs(values[:, -1] + shift - home).max() <= limit)


@pytest.mark.parametrize(("places", "degrees"), [(None, 230), (None, 400), (170.0, 240), (170.0, 400)])
def test_no_choice_of_full_rotations_is_shorter(places: float | None, degrees: float) -> None:
    """All orders of two or three picks, with all options and all full rotations, independent of the search."""
    setup, picks = turning("ur5", 3 if places is None else 2, places=places)
    budget = pp.cell.SequenceBudget(options=2, refinements=0, search=0)
    limit, home = np.radians(degrees), setup.home
    bounds = Bounds.of(setup.checker.arm.limits, setup.checker.arm.joint_names)
    choices = []
    for job in judge_options(setup, picks, budget).jobs:
        mine = []
        for option in job.options:
            for first, second in product(range(-3, 4), repeat=2):
                pick, put = TURN * first, TURN * second
                attempt, release = option.attempt, option.release
                lines = [(attempt.approach, attempt.q, pick), (attempt.retreat, attempt.q, pick)]
                if release is not None:
                    lines += [(release.lift, release.q, put), (release.leave, release.q, put)]
                elif second:
                    continue
                if not all(turned_inside(curve, q, shift, limit, home[-1]) for curve, q, shift in lines):
                    continue
                shift = np.eye(6)[5]
                seconds, last = sum(option.lines.values()), option.exit + shift * (pick if release is None else put)
                if release is not None:
                    across = release.entrance + put * shift - attempt.exit - pick * shift
                    seconds += float(least_times(across, bounds))
                mine.append((option.entrance + pick * shift, last, seconds))
        choices.append(mine)

    def cost(tour) -> float:
        ends = [home, *(q for first, last, _ in tour for q in (first, last)), home]
        transits = np.array([there - here for here, there in zip(ends[::2], ends[1::2], strict=True)])
        return float(least_times(transits, bounds).sum()) + sum(seconds for *_, seconds in tour)

    best = min(cost(tour) for order in permutations(choices) for tour in product(*order))
    result = pp.sequence(setup, picks, windings={WRIST: limit}, budget=budget)
    assert result.lower_bound == pytest.approx(best, abs=1e-9)


def test_an_unwinding_move_is_named_and_counted() -> None:
    setup, picks = turning("ur10e", 6)
    result = in_order(setup, picks, 200, grip_dwell=0.1)
    (step,) = (step for step in result if step.phases[0].name == "unwind")
    motion = step.phases[0].motion
    assert motion.certificate.free
    assert abs(motion.trajectory.end[-1] - motion.trajectory.start[-1]) > np.pi
    assert result.by_phase["unwind"] == pytest.approx(motion.trajectory.duration)
    assert sum(result.by_phase.values()) == pytest.approx(result.duration, abs=1e-6)
    program = step.program()
    assert program.segments[0].name == f"unwind {WRIST} by 360 deg"
    assert all(proof.free for proof in setup.recertify(program, step.verdict.pick))
    assert [own.program().segments[0].name for own in result if own is not step] == ["transit"] * 5


def test_the_twist_is_in_the_text_the_json_and_the_page(tmp_path: Path) -> None:
    setup, picks = turning("ur10e", 5)
    result = in_order(setup, picks, 350, end="free")
    (twist,) = (own for own in result.twist if own.joint == WRIST)
    assert twist.final == pytest.approx(result.motions[-1].trajectory.end[-1] - setup.home[-1])
    written = next(row for row in json.loads(result.to_json())["twist"] if row["joint"] == WRIST)
    assert written == {
        "joint": WRIST, "largest": twist.largest, "final": twist.final, "budget": pytest.approx(np.radians(350))
    }  # fmt: skip
    assert str(twist) in result.to_text()
    result.save(tmp_path / "cell.html")
    assert f"twist from home of {WRIST}" in (tmp_path / "cell.html").read_text(encoding="utf-8")


def test_a_budget_that_is_too_small_for_a_pick_is_refused_with_its_need() -> None:
    setup, picks = turning("ur10e", 1, step=0.0)
    with pytest.raises(pp.InputError, match=r"pick_0.*wrist_3_joint.*budget is 20\.0 deg") as caught:
        in_order(setup, picks, 20)
    needed = float(re.search(r"by ([\d.]+) deg", str(caught.value))[1])
    with pytest.raises(pp.InputError, match="pick_0"):
        in_order(setup, picks, needed - 0.2)
    assert in_order(setup, picks, needed + 0.2).ok


@pytest.mark.parametrize(
    ("windings", "named"),
    [
        ({"wrist_4_joint": 3.0}, "wrist_4_joint.*wrist_3_joint"),
        ({WRIST: -1.0}, "windings.*wrist_3_joint"),
        ({WRIST: 0}, "windings.*wrist_3_joint"),
        ({WRIST: 400}, "wrist_3_joint.*deg"),
        ({WRIST: "400 degrees"}, "400 degrees"),
    ],
)
def test_bad_budgets_are_refused(windings, named: str) -> None:
    setup, picks = turning("ur5", 1)
    with pytest.raises(pp.InputError, match=named):
        pp.sequence(setup, picks, windings=windings)


def test_a_prismatic_joint_has_no_budget() -> None:
    arm = pp.load_robot("stanford").arm()
    slide = arm.joint_names[int(np.flatnonzero(~arm.angular)[0])]
    with pytest.raises(pp.InputError, match=f"windings.{slide}.*prismatic"):
        PickSetup.make(arm, pp.Scene([]), pp.Picks([], windings={slide: 1.0}), home=None, rng=0)


def test_budgets_of_a_picks_file_apply_and_wrong_ones_name_their_line(tmp_path: Path) -> None:
    text = """robot: ur5
tcp: tool0
windings: {wrist_3_joint: 250 deg, %s: 6.1}
picks:
- {name: a, xyz: [0.45, 0.1, 0.2], rpy: [pi, 0, 0]}
"""
    file = tmp_path / "picks.yaml"
    file.write_text(text % "wrist_1_joint", encoding="utf-8")
    picks = pp.read_picks(file)
    assert picks.windings == {WRIST: pytest.approx(np.radians(250)), "wrist_1_joint": 6.1}
    setup = PickSetup.make(picks.load_arm(), pp.Scene([]), picks, home=None, rng=0)
    result = pp.sequence(setup, picks.picks)
    assert {own.joint: own.budget for own in result.twist if own.budget is not None} == picks.windings
    file.write_text(text % "wrist_9_joint", encoding="utf-8")
    picks = pp.read_picks(file)
    with pytest.raises(pp.PinproofError, match=r"picks\.yaml.*line 3.*wrist_9_joint"):
        PickSetup.make(picks.load_arm(), pp.Scene([]), picks, home=None, rng=0)
    file.write_text((text % "wrist_1_joint").replace("250 deg", "-250 deg"), encoding="utf-8")
    with pytest.raises(pp.PinproofError, match=r"picks\.yaml.*line 3.*windings"):
        pp.read_picks(file)
