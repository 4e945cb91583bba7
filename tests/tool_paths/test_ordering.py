"""Several strokes in one motion: the order, directions and start points are the best of all by brute force."""

import json
from functools import cache
from itertools import permutations, product

import numpy as np
import pytest

import pinproof as pp
from pinproof.motion import Bounds, least_times
from pinproof.tool_paths import FollowStatus, Stroke, ToolPath, follow_all, ordering

UP = (0.0, 0.0, 1.0)
SETTINGS = {"approach": 0.03, "rotations": 12}


def line(name, a, b, **more):
    return Stroke(name, ToolPath.through(np.linspace(a, b, 4), UP, speed=0.2), **more)


@pytest.fixture(scope="module")
def checker():
    arm = pp.load_robot("ur5").arm()
    table = pp.Obstacle("table", pp.Box(0.6, 1.4, 0.05), pp.pose((0.7, 0.0, 0.1)))
    # A wall between the strokes, around which the transits lead
    wall = pp.Obstacle("wall", pp.Box(0.3, 0.02, 0.3), pp.pose((0.55, 0.05, 0.3)))
    return pp.CollisionChecker(arm, pp.Scene([table, wall]))


def random_strokes(rng, count):
    strokes = []
    for number in range(count):
        side = 1 if number % 2 else -1
        a = np.array([rng.uniform(0.42, 0.55), side * rng.uniform(0.17, 0.3), rng.uniform(0.2, 0.3)])
        strokes.append(line(f"s{number}", a, a + np.array([0.08 * rng.uniform(-1, 1), 0.06 * side, 0.0])))
    return strokes


@pytest.mark.parametrize("seed", range(4))
def test_the_order_and_the_directions_are_the_best_of_all(checker, seed):
    strokes = random_strokes(np.random.default_rng(seed), 3)
    home = checker.arm.home
    found = follow_all(checker, strokes, home=home, **SETTINGS).or_raise()
    plans = {
        (k, reverse): pp.follow(checker, own.variant(reverse=reverse).path, **SETTINGS)
        for k, own in enumerate(strokes) for reverse in (False, True)
    }  # fmt: skip

    @cache
    def transit(a, b):
        begin = home if a is None else plans[a].trajectory.end
        end = home if b is None else plans[b].trajectory.start
        return pp.plan(checker, begin, end).duration

    @cache
    def least(a, b):
        begin = home if a is None else plans[a].trajectory.end
        end = home if b is None else plans[b].trajectory.start
        return float(least_times(end - begin, Bounds.of(checker.arm.limits, checker.arm.joint_names)))

    def seconds(nodes, time):
        ends = [None, *nodes, None]
        return sum(plans[node].duration for node in nodes) + sum(map(time, ends[:-1], ends[1:]))

    every = [
        tuple(zip(order, reverse, strict=True))
        for order in permutations(range(3)) for reverse in product((False, True), repeat=3)
    ]  # fmt: skip
    assert found.duration == pytest.approx(min(seconds(nodes, transit) for nodes in every), abs=1e-6)
    assert found.bound == pytest.approx(min(seconds(nodes, least) for nodes in every))
    assert found.bound <= found.duration
    own = tuple((int(step.stroke.name[1:]), step.reverse) for step in found.steps)
    assert seconds(own, transit) == pytest.approx(found.duration, abs=1e-6)


def test_the_motion_follows_every_stroke_and_is_free(checker):
    points = np.array([[0.45, -0.3, 0.25], [0.55, -0.3, 0.25], [0.5, -0.2, 0.25], [0.45, -0.3, 0.25]])
    triangle = Stroke("triangle", ToolPath.through(points, UP, speed=0.1), closed=True)
    strokes = [
        triangle,
        line("a", (0.45, 0.2, 0.25), (0.55, 0.2, 0.25)),
        line("b", (0.55, 0.3, 0.25), (0.45, 0.3, 0.25)),
    ]
    found = follow_all(checker, strokes, starts=3, **SETTINGS).or_raise()
    assert sorted(step.stroke.name for step in found.steps) == ["a", "b", "triangle"]
    assert found.variants == 6 + 2 + 2
    assert len(found.transits) == 2
    for step in found.steps:
        # The whole motion is that of the stroke while it is followed, and the tool passes all of its points
        times = np.linspace(0.0, step.plan.duration, 800)
        q = found.trajectory(step.begin + times)
        assert q == pytest.approx(step.plan.trajectory(times), abs=1e-9)
        tool = checker.arm.forward_kinematics_batch(q)[:, :3, 3]
        for point in step.stroke.path.poses[:, :3, 3]:
            assert np.linalg.norm(tool - point, axis=1).min() < 2e-3
        given = next(own for own in strokes if own.name == step.stroke.name)
        assert step.stroke.path.poses == pytest.approx(given.variant(step.start, reverse=step.reverse).path.poses)
    dense = found.trajectory(np.linspace(0.0, found.duration, 3000))
    assert checker.is_free_batch(dense).all()
    assert found.certificate.matches(found.trajectory, checker.arm, checker.scene)


def test_a_free_start_point_is_used_where_it_is_shorter(checker):
    points = np.array([[0.5, -0.35, 0.25], [0.5, -0.2, 0.25], [0.45, -0.28, 0.25], [0.5, -0.35, 0.25]])
    path, near = ToolPath.through(points, UP, speed=0.2), line("a", (0.5, -0.12, 0.25), (0.45, -0.12, 0.25))
    free = follow_all(checker, [near, Stroke("loop", path, closed=True)], starts=6, **SETTINGS).or_raise()
    fixed = follow_all(checker, [near, Stroke("loop", path)], **SETTINGS).or_raise()
    assert free.duration < fixed.duration
    assert {step.stroke.name: step.start for step in free.steps}["loop"] == 1


def test_a_stroke_that_is_not_reversible_keeps_its_direction(checker):
    strokes = [line(name, (0.45, y, 0.25), (0.55, y, 0.25), reversible=False) for name, y in (("a", 0.2), ("b", 0.3))]
    found = follow_all(checker, strokes, **SETTINGS).or_raise()
    assert not any(step.reverse for step in found.steps)


def test_a_stroke_out_of_reach_is_named_with_its_reason(checker):
    strokes = [line("near", (0.45, 0.2, 0.25), (0.5, 0.2, 0.25)), line("far", (1.4, 0.2, 0.25), (1.5, 0.2, 0.25))]
    found = follow_all(checker, strokes, **SETTINGS)
    assert found.status is FollowStatus.BLOCKED
    ((name, plan),) = found.failed
    assert name == "far"
    assert plan.blocked
    assert "'far'" in found.message
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["steps"][0]["begin"] is None
    with pytest.raises(pp.NoAnswer, match="far"):
        found.or_raise()


def test_a_home_in_contact_has_no_transit(checker):
    low = np.zeros(6)
    assert not checker.is_free(low)
    found = follow_all(checker, [line("a", (0.45, 0.2, 0.25), (0.5, 0.2, 0.25))], home=low, **SETTINGS)
    assert found.status is FollowStatus.NO_TRANSIT
    assert "table" in found.message


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"strokes": []}, "at least one stroke"),
        ({"strokes": [line("a", (0.4, 0, 0.3), (0.5, 0, 0.3))] * 2}, "names must differ"),
        ({"strokes": [ToolPath([pp.pose((0.4, 0, 0.3))])]}, r"strokes\[0\]"),
        ({"start": np.zeros(6)}, "state home"),
        ({"starts": 0}, "starts"),
        ({"home": np.full(6, np.nan)}, "home"),
        ({"cost": "cheap"}, "cheap"),
    ],
)  # fmt: skip
def test_unusable_strokes_and_options_are_refused(checker, change, words):
    strokes = change.pop("strokes", [line("a", (0.45, 0.2, 0.25), (0.5, 0.2, 0.25))])
    with pytest.raises(pp.InputError, match=words):
        follow_all(checker, strokes, **change)


def test_strokes_whose_transits_fail_are_followed_from_other_configurations(checker, monkeypatch):
    (stroke,) = random_strokes(np.random.default_rng(0), 1)
    usual = follow_all(checker, [stroke], home=checker.arm.home, **SETTINGS).or_raise()
    starts = [step.plan.trajectory.start for step in usual.steps]
    starts += [pp.follow(checker, stroke.variant(reverse=True).path, **SETTINGS).trajectory.start]

    def no_way_to_the_usual_ones(checker, begin, end, **settings):
        refused = any(np.abs(np.asarray(end) - start).max() < 1e-6 for start in starts)
        scene = [pp.Obstacle("block", pp.Box(2.0, 2.0, 2.0))] if refused else []
        return pp.plan(checker.with_scene(pp.Scene([*checker.scene.obstacles, *scene])), begin, end, **settings)

    monkeypatch.setattr(ordering, "plan", no_way_to_the_usual_ones)
    other = follow_all(checker, [stroke], home=checker.arm.home, **SETTINGS).or_raise()
    (step,) = other.steps
    apart = [np.abs((step.plan.trajectory.start - start + np.pi) % (2 * np.pi) - np.pi).max() for start in starts]
    assert min(apart) > 0.9
    assert other.certificate.matches(other.trajectory, checker.arm, checker.scene)


def test_a_stroke_that_no_transit_leads_to_is_not_left_out(checker, monkeypatch):
    """All transits between the sides of the robot fail, from all configurations."""

    def no_way_across(checker, begin, end, **settings):
        sides = [checker.arm.forward_kinematics(q).translation[1] for q in (begin, end)]
        block = [pp.Obstacle("block", pp.Box(2.0, 2.0, 2.0))] if sides[0] * sides[1] < 0.0 else []
        return pp.plan(checker.with_scene(pp.Scene([*checker.scene.obstacles, *block])), begin, end, **settings)

    class AscendingProblem(ordering.TourProblem):
        def __post_init__(self):
            assert (np.diff(self.job) >= 0).all()

    monkeypatch.setattr(ordering, "plan", no_way_across)
    monkeypatch.setattr(ordering, "TourProblem", AscendingProblem)
    strokes = [line(name, (0.5, y, 0.25), (0.55, y, 0.25), reversible=False) for name, y in (("a", 0.3), ("b", -0.3))]
    found = follow_all(checker, strokes, **SETTINGS)
    assert found.status is FollowStatus.NO_TRANSIT
    assert found.variants > 2
    assert np.isfinite(found.bound)  # whatever the transits
