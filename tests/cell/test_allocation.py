"""Picks of several arms: allocation, waiting, certificates on a common clock, and refused input."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.cell.allocation.allocate import AllocationRun
from pinproof.cell.allocation.common_clock import TICK, ArmAxis, shortest_waits
from pinproof.cell.sequencing.precedence import AT_PLACE
from pinproof.collision import PairMargin, audit

FILE = Path(__file__).parents[2] / "robots" / "two_ur5" / "picks.yaml"


@pytest.fixture(scope="module")
def cell():
    picks = pp.read_picks(FILE)
    return picks.load_cell(), pp.Scene.load(picks.scene), picks


def some(picks, *names, **changes):
    return replace(picks, picks=tuple(replace(p, **changes.get(p.name, {})) for p in picks if p.name in names))


@pytest.fixture(scope="module")
def allocated(cell):
    group, scene, picks = cell
    chosen = some(picks, "part_2_1", "part_3_2", "part_4_2", "part_5_3")
    return pp.cell.allocate(group, scene, chosen, compare=False, grip_dwell=0.2)


def brute_force(first, second, blocked) -> int | None:
    """The smallest number of ticks, by breadth-first search."""
    goal, seen, queue = (blocked.shape[0] - 1, blocked.shape[1] - 1), {(0, 0): 0}, deque([(0, 0)])
    while queue:
        i, j = queue.popleft()
        for a, b in ((1, 1), (1, 0), (0, 1)):
            if (not a and not first[i]) or (not b and not second[j]):
                continue
            at = (i + a, j + b)
            if at[0] <= goal[0] and at[1] <= goal[1] and not blocked[at] and at not in seen:
                seen[at] = seen[i, j] + 1
                queue.append(at)
    return seen.get(goal)


def test_waits_are_the_shortest_and_avoid_blocked_states() -> None:
    rng, solved = np.random.default_rng(0), 0
    for _ in range(200):
        sizes = rng.integers(2, 12, 2)
        axes = []
        for size in sizes.tolist():
            rests = rng.random(size) < 0.4
            rests[[0, -1]] = True
            axes.append(ArmAxis(np.arange(size) * TICK, rests))
        blocked = rng.random(tuple(sizes)) < 0.25
        blocked[0, 0] = blocked[-1, -1] = False
        least = brute_force(axes[0].rests, axes[1].rests, blocked)
        found = shortest_waits(*axes, blocked)
        assert (found is None) == (least is None)
        if found is None or least is None:
            continue
        solved += 1
        ends = [axis.times[-1] + sum(wait.duration for wait in waits) for axis, waits in zip(axes, found, strict=True)]
        assert max(ends) == pytest.approx(least * TICK)
        for tick in range(least + 1):
            state = []
            for axis, waits in zip(axes, found, strict=True):
                own = tick
                for wait in waits:
                    own -= min(max(own - round(wait.time / TICK), 0), round(wait.duration / TICK))
                state.append(min(own, len(axis.times) - 1))
            assert not blocked[tuple(state)]
    assert solved > 50


@pytest.mark.slow
def test_every_instant_is_certified_and_free_on_exact_meshes(cell, allocated) -> None:
    group, scene, _ = cell
    assert allocated.ok
    assert {name for each in allocated for name in each.picks} == {p.name for p in allocated.picks}
    assert all(each.picks for each in allocated)
    starts, ends = ([getattr(each, end) for each in allocated.intervals] for end in ("start", "end"))
    assert starts[0] == 0.0
    assert ends[-1] == pytest.approx(allocated.makespan)
    assert starts[1:] == pytest.approx(ends[:-1])
    assert all(each.certificate.free for each in allocated.intervals)
    whole = allocated.trajectory
    assert np.abs(whole.max_velocity()).max() <= group.limits.velocity.max() + 1e-9
    for interval in allocated.intervals:
        middle = interval.start + interval.trajectory.duration / 2
        still = allocated.scene_at(middle)
        carried = {thing.name for thing in interval.attached}
        # The tip touches its part while it grips and releases, and a part rests on what supports it.
        near = [(name, other) for name in carried for other in still.names if name.startswith("part")]
        near += [(name, other) for name in carried for other in still.names if other in allocated.parts]
        meshes = pp.CollisionChecker(group, still, link_meshes="surface", attached=interval.attached, allowed=near)
        assert audit(interval.trajectory, meshes, step=0.02, measure=False).clean

    # Parts are taken and placed in the order of time
    for name, part in allocated.parts.items():
        pick = next(each for each in allocated.picks if each.name == name)
        assert part.gripped < part.released
        assert np.allclose(allocated.scene_at(0.0)[name].pose, scene[name].pose)
        assert name not in allocated.scene_at((part.gripped + part.released) / 2).names
        shift = pick.place.pose.translation - pick.pose.translation
        assert np.allclose(part.after.pose.translation, scene[name].pose.translation + shift, atol=1e-6)


def test_hands_of_the_other_arms_are_open_as_stated(tmp_path) -> None:
    (tmp_path / "scene.yaml").write_text("obstacles: []\n")
    path = tmp_path / "picks.yaml"
    path.write_text(
        "robot: panda\nscene: scene.yaml\nheld: {panda_finger_joint1: {open: 0.04, grip: 0.02}}\n"
        "robots:\n  left: {base: {xyz: [-1, 0, 0]}}\n  right: {base: {xyz: [1, 0, 0]}}\n"
        "picks:\n  - {name: one, arm: left, xyz: [-0.5, 0, 0.3], rpy: [pi, 0, 0]}\n"
    )
    picks = pp.read_picks(path)
    group = picks.load_cell()
    group = group.with_held({joint: 0.0 for joint in group.held if "finger_joint1" in joint})
    run = AllocationRun(group, pp.Scene.load(picks.scene), picks, (), (0.0, 0.0), pp.cell.SequenceBudget(), print, 0)
    for setup in run.setups.values():
        fingers = [value for joint, value in setup.checker.group.held.items() if "finger_joint1" in joint]
        assert fingers == [0.04, 0.04]


def test_budgets_of_rotation_are_those_of_each_arm(tmp_path) -> None:
    """The joints of a cell have prefixes, so budgets were refused as those of unknown joints."""
    text = FILE.read_text().replace("scene: scene.yaml", f"scene: {FILE.parent}/scene.yaml")
    text = text.replace("left: {base", "left: {windings: {wrist_3_joint: 200 deg}, base")
    text = text.replace("right: {base", "right: {windings: {elbow_joint: 3.0}, base")
    (tmp_path / "picks.yaml").write_text(text)
    picks = pp.read_picks(tmp_path / "picks.yaml")
    chosen = some(picks, "part_2_1", "part_5_3", part_2_1={"arm": "left"}, part_5_3={"arm": "right"})
    found = pp.cell.allocate(picks.load_cell(), pp.Scene.load(picks.scene), chosen, compare=False)
    assert found.ok
    budgets = {"left/wrist_3_joint": np.radians(200), "right/elbow_joint": 3.0}
    twists = [own for result in found.sequences.values() for own in result.twist if own.budget is not None]
    assert {own.joint: own.budget for own in twists} == pytest.approx(budgets)
    moved = found.timing.trajectory
    for name, budget in budgets.items():
        values = moved(np.linspace(0.0, moved.duration, 5000))[:, moved.joint_names.index(name)]
        assert np.abs(values - values[0]).max() <= budget + 1e-9


def test_margins_of_the_scene_and_of_the_picks_apply_to_each_arm_and_between_arms(cell) -> None:
    """Those of obstacles were refused as unknown bodies of the checker of both arms, which has no scene."""
    group, scene, picks = cell
    obstacle = next(iter(scene))
    of_scene = [
        PairMargin(("left/forearm_link", obstacle), 0.01),
        PairMargin(("left/forearm_link", "right/forearm_link"), 0.05),
    ]
    of_picks = (PairMargin(("right/forearm_link", "left/forearm_link"), 0.07),)
    scene, picks = replace(scene, margins=of_scene), replace(picks, margins=of_picks)
    run = AllocationRun(group, scene, picks, (), (0.0, 0.0), pp.cell.SequenceBudget(), print, 0)

    def margin(checker, *pair) -> set[float]:
        pairs = {frozenset(checker.owners(k)): own for k, own in enumerate(checker.margins.tolist())}
        return {own for owners, own in pairs.items() if owners == frozenset(pair)}

    forearms = ("left/forearm_link", "right/forearm_link")
    assert margin(run.apart.carrying((), {}), *forearms) == {0.07}
    assert margin(run.setups["left"].checker, *forearms) == {0.07}
    assert margin(run.setups["left"].checker, "left/forearm_link", obstacle) == {0.01}
    # the parts of the other arm are obstacles at their places too, with the same margins
    placed = pp.Obstacle(f"{obstacle}{AT_PLACE}", pp.Sphere(radius=0.02), pp.pose((0, 0.3, 0.05)))
    assert margin(run._setup("left", [placed]).checker, "left/forearm_link", placed.name) == {0.01}


@pytest.mark.slow
def test_part_that_is_not_where_the_other_arm_was_certified_with_it_is_named(allocated) -> None:
    assert not allocated.misplaced
    part, state = next(iter(allocated.parts.items()))
    other = next(name for name in allocated.sequences if name != state.arm)
    sequence = allocated.sequences[other]
    checker = sequence.setup.checker
    moved = [replace(each, pose=pp.pose((0.001, 0, 0)) * each.pose) for each in checker.scene.obstacles]
    setup = replace(sequence.setup, checker=checker.with_scene(replace(checker.scene, obstacles=tuple(moved))))
    wrong = replace(allocated, sequences={**allocated.sequences, other: replace(sequence, setup=setup)})
    assert not wrong.ok
    assert part in wrong.reason


@pytest.mark.slow
def test_pick_is_executed_by_the_arm_that_it_names_and_in_the_stated_order(cell) -> None:
    group, scene, picks = cell
    chosen = some(picks, "part_2_2", "part_5_2", part_2_2={"arm": "right"}, part_5_2={"arm": "left"})
    result = pp.cell.allocate(group, scene, chosen, compare=False, precedence=[("part_2_2", "part_5_2")])
    assert result.ok
    assert {each.arm: each.picks for each in result} == {"left": ("part_5_2",), "right": ("part_2_2",)}
    before = max(piece.end for piece in result.programs["right"] if piece.pick == "part_2_2")
    after = min(p.start for p in result.programs["left"] if p.pick == "part_5_2" and p.name != "wait")
    assert after >= before


@pytest.mark.slow
def test_pick_that_no_arm_can_execute_is_left_out_with_the_reason_of_each(cell) -> None:
    group, scene, picks = cell
    chosen = some(picks, "part_3_2", "part_4_2", part_4_2={"pose": pp.pose((0.0, 2.0, 0.03), (np.pi, 0, 0))})
    result = pp.cell.allocate(group, scene, chosen, compare=False)
    (left,) = result.missing
    assert (left.name, result.ok, result.free) == ("part_4_2", False, True)
    assert "left: " in left.reason
    assert "right: " in left.reason
    with pytest.raises(pp.NoAnswer, match="part_4_2"):
        result.or_raise()


@pytest.mark.parametrize("later", ["leaves out", "fails"])
def test_a_later_allocation_that_leaves_out_a_pick_or_fails_does_not_replace_the_first(
    cell, monkeypatch, later
) -> None:
    group, scene, picks = cell
    slow = {"approach": pp.picks.ToolSpeed(linear_speed=0.01)}
    far = {"pose": pp.pose((0.8, 0.3, 0.05), (np.pi, 0, 0)), "carried": None, "place": None, "speed": slow}
    chosen = some(picks, "part_2_2", "part_5_2", part_2_2={"carried": None, "place": None}, part_5_2=far)
    allocations = iter([("left", "right"), ("left", "left"), ("left", "right")])
    monkeypatch.setattr(AllocationRun, "allocation", lambda self: next(allocations))
    if later == "fails":
        sequences = AllocationRun.sequences

        def failing(self, allocation):
            if allocation == ("left", "left"):
                raise pp.NoAnswer("no order was found")
            return sequences(self, allocation)

        monkeypatch.setattr(AllocationRun, "sequences", failing)
    budget = pp.cell.SequenceBudget(options=1, motion=0, refinements=0)
    result = pp.cell.allocate(group, scene, chosen, compare=False, budget=budget)
    assert result.ok
    assert {each.arm: each.picks for each in result} == {"left": ("part_2_2",), "right": ("part_5_2",)}


def test_unknown_arm_is_refused_with_the_valid_ones(cell, tmp_path) -> None:
    group, scene, picks = cell
    with pytest.raises(pp.UnknownNameError, match=r"unknown arm 'lefty'.*left, right"):
        pp.cell.allocate(group, scene, some(picks, "part_0_0", part_0_0={"arm": "lefty"}))
    text = FILE.read_text().replace("name: part_0_0,", "name: part_0_0, arm: lefty,")
    (tmp_path / "picks.yaml").write_text(text.replace("scene: scene.yaml\n", ""))
    (problem,) = pp.read_picks(tmp_path / "picks.yaml").problems
    assert problem.name == "part_0_0"
    assert "lefty" in problem.reason
    assert "left, right" in problem.reason


def test_cells_that_cannot_be_allocated_are_refused(cell) -> None:
    group, scene, picks = cell
    left, right = picks.robots.values()
    close = replace(picks, robots={"left": left, "right": replace(right, world_from_base=pp.pose((-0.4, 0, 0)))})
    single, common = replace(picks, robots={}), pp.load_robot("tiago_dual_left").arms(base="torso_fixed_link")
    stated = some(picks, "part_0_0", part_0_0={"carried": scene["part_0_0"]})
    allocate = pp.cell.allocate
    for refused, named in (
        (lambda: allocate(group, scene.remove("part_0_0"), stated), r"part_0_0.*not in the scene"),
        (lambda: allocate(common, pp.Scene(), single), "torso_lift_joint"),
        (lambda: allocate(close.load_cell(), scene, close), r"left/base_link.*right/base_link"),
        (picks.load_arm, r"several robots \(left, right\)"),
        (single.load_cell, "robots"),
        (lambda: allocate(single.load_arm(), pp.Scene(), single), "one arm"),
    ):
        with pytest.raises(pp.InputError, match=named):
            refused()


def test_wrong_robots_of_a_file_are_refused(tmp_path) -> None:
    base = "right: {base: {xyz: [0.45, 0, 0], rpy: [0, 0, pi]}}"
    for old, new, named in (
        ("left: {base:", "left: {bse:", "key robots.left.bse: unknown key 'bse'"),
        (base, "right: {tcp: tool0}", "key robots.right: right does not state base"),
    ):
        text = FILE.read_text()
        assert old in text
        (tmp_path / "picks.yaml").write_text(text.replace(old, new))
        with pytest.raises(pp.FileError, match=named):
            pp.read_picks(tmp_path / "picks.yaml")


def test_table_with_arms_needs_robots(tmp_path) -> None:
    (tmp_path / "picks.csv").write_text("name,x,y,z,roll,pitch,yaw,arm\na,0.1,0.2,0.3,3.1,0,0,left\n")
    with pytest.raises(pp.FileError, match="column arm"):
        pp.read_picks(tmp_path / "picks.csv")
    text = FILE.read_text()
    text = text[: text.index("picks:\n")].replace("scene: scene.yaml\n", "") + "picks: picks.csv\n"
    (tmp_path / "picks.yaml").write_text(text)
    (pick,) = pp.read_picks(tmp_path / "picks.yaml")
    assert pick.arm == "left"
