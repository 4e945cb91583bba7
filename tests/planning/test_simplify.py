"""Shortened, rounded and simplified paths: shorter, proven as they come out, never at the price of the ends."""

import importlib

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision import is_proven_free
from pinproof.motion import Bezier, BlendedPath, JointPath

from .arms import assert_free, ball_arm


def path_of(checker, *q):
    return JointPath(q, checker.group.joint_names)


def assert_same_ends(path, other):
    assert np.array_equal([path.start, path.end], [other.start, other.end])


# -- shortcuts ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_a_shortcut_is_shorter_with_the_same_ends_and_proven(slot, detour, seed):
    short = pp.shortcut(detour, slot, rng=seed)
    assert_same_ends(short, detour)
    assert short.length < 0.9 * detour.length
    assert pp.certify(short, slot).free
    assert_free(short, slot)


def test_the_same_seed_gives_the_same_path_to_the_last_bit(slot, detour):
    for shortened in (lambda seed: pp.shortcut(detour, slot, rng=seed).q,
                      lambda seed: pp.simplify(detour, slot, rng=seed).path.control):  # fmt: skip
        paths = [shortened(seed).tobytes() for seed in (3, 3, 4)]
        assert paths[0] == paths[1] != paths[2]


def test_a_shortcut_is_never_longer_whatever_the_path(slot):
    rng = np.random.default_rng(0)
    for seed in range(5):
        path = path_of(slot, *rng.uniform((0.1, -0.9), (0.9, 0.9), (6, 2)))  # a convex space: the line is free
        assert np.array_equal(pp.shortcut(path, slot, rng=seed).q, path.q[[0, -1]])


def test_a_shortcut_through_a_thin_plate_is_not_taken(gantry):
    plate = pp.Obstacle("plate", pp.Box(0.002, 1.0, 1.0), pp.pose((0.013, -0.5, 0.0)))
    checker = pp.CollisionChecker(gantry, pp.Scene([plate]))
    path = path_of(checker, (-0.9, -0.5), (-0.2, 0.5), (0.2, 0.5), (0.9, -0.5))
    short = pp.shortcut(path, checker, resolution=0.6, attempts=30)  # its samples step over the plate
    assert pp.certify(short, checker).free
    assert_free(short, checker)


def test_repeated_waypoints_are_dropped(slot):
    a, b, c = (-0.8, -0.8), (-0.8, 0.6), (0.8, 0.6)
    path = path_of(slot, a, a, b, b, b, c, c)
    short = pp.shortcut(path, slot, rng=0)
    assert_same_ends(short, path)
    assert (np.abs(np.diff(short.q, axis=0)).max(axis=1) > 0).all()
    assert short.length <= path.length
    for count in (1, 2, 5):  # a path without motion
        assert pp.shortcut(path_of(slot, *[(0.5, 0.5)] * count), slot).q.tolist() == [[0.5, 0.5]]


def test_no_attempts_still_skips_waypoints(slot, detour):
    short = pp.shortcut(detour, slot, attempts=0)
    assert {tuple(q) for q in short.q} < {tuple(q) for q in detour.q}
    assert short.length < detour.length


def test_a_waypoint_moves_towards_the_line_between_its_neighbours(gantry):
    """It cannot be left out, because of a post; the shortest path passes the post closely."""
    checker = pp.CollisionChecker(gantry, pp.Scene([pp.Obstacle("post", pp.Sphere(0.05), pp.pose((0.0, 0.0, 0.0)))]))
    path = path_of(checker, (-0.8, 0.0), (0.0, 0.8), (0.8, 0.0))
    short = pp.shortcut(path, checker, attempts=1)
    assert pp.certify(short, checker).free
    assert short.length < 1.75 < path.length


def test_a_tightened_path_is_shorter_proven_and_in_the_range_of_the_given_one():
    """Moves along oblique vectors may not take a joint out of its limits, at which the waypoints of these paths are."""
    crane = ball_arm(("x", "y", "z"))
    checker = pp.CollisionChecker(crane, pp.Scene([pp.Obstacle("ball", pp.Sphere(0.5), pp.pose((0.0, 0.0, 0.6)))]))
    rng, lengths = np.random.default_rng(0), []
    for _ in range(20):
        a, b, c, d, x = rng.uniform(-0.2, 0.2, 5)
        path = path_of(checker, (-0.9, a, 0.8 + b), (x, 0.9, 1.0), (0.9, c, 0.8 + d))
        short, tight = pp.shortcut(path, checker), pp.shortcut(path, checker, tighten=True)
        assert_same_ends(tight, path)
        assert pp.certify(tight, checker).free
        assert_free(tight, checker)
        assert (tight.q <= path.q.max(axis=0)).all()
        lengths.append((short.length, tight.length))
    lengths = np.array(lengths)
    assert (lengths[:, 1] <= lengths[:, 0]).all()
    assert lengths[:, 1].sum() < 0.998 * lengths[:, 0].sum()


@pytest.mark.parametrize(
    ("shorten", "settings", "message"),
    [
        (pp.shortcut, {"path": JointPath([(0.0, 0.0)], ("a", "b"))}, "joints"),
        (pp.shortcut, {"attempts": -1}, "attempts"),
        (pp.shortcut, {"resolution": 0.0}, "resolution"),
        (pp.blend, {"path": JointPath([(0.0, 0.0)], ("a", "b"))}, "joints"),
        (pp.blend, {"deviation": 0.0}, "deviation"),
    ],
)
def test_arguments_that_make_no_sense(slot, detour, shorten, settings, message):
    with pytest.raises(pp.InputError, match=message):
        shorten(**{"path": detour, "checker": slot, **settings})


# -- rounded corners: proven one by one, within the deviation, smaller if a body is in the corner, otherwise a stop ----


def on_plane(*q, obstacle=None, limits=(-1.0, 1.0)):
    """A path of a ball, without obstacles and beside one."""
    arm = ball_arm(("x", "y"), limits)
    checker = pp.CollisionChecker(arm, pp.Scene([] if obstacle is None else [obstacle]))
    return JointPath(q, arm.joint_names), pp.CollisionChecker(arm), checker


def test_roundings_are_twice_differentiable_and_shorter():
    path, checker, _ = on_plane((-0.9, 0), (0, 0), (0.5, 0.6), (0.9, -0.9))
    for deviation in (0.02, 0.1):
        smooth = pp.blend(path, checker, deviation=deviation)
        assert smooth.corners == ()
        points = smooth(np.linspace(*smooth.domain, 20_001))
        for waypoint in path.q[1:-1]:
            assert np.linalg.norm(points - waypoint, axis=1).min() <= deviation + 1e-6  # the samples are 1e-4 apart
        assert_same_ends(smooth, path)
        assert smooth.length < path.length
    curve = Bezier(*smooth.bezier())
    for _ in range(2):
        curve = curve.derivative()
        jumps = np.abs(curve.control[1:, 0] - curve.control[:-1, -1]).max()
        assert jumps < 1e-6 * max(1.0, np.abs(curve.control).max())


def test_a_body_in_the_corner_shrinks_the_rounding():
    # The ball (5 cm) moves around a post that is a little inside its corner.
    post = pp.Obstacle("post", pp.Sphere(0.02), pp.pose((-0.09, 0.09, 0)))
    path, empty, checker = on_plane((-0.9, 0), (0, 0), (0, 0.9), obstacle=post)
    assert pp.certify(path, checker).free
    wide, narrow = (pp.blend(path, c, deviation=0.15) for c in (empty, checker))
    assert not pp.certify(wide, checker).free
    assert pp.certify(narrow, checker).free
    assert narrow.corners == ()
    assert narrow.length > wide.length
    assert_free(narrow, checker)


def test_a_corner_without_clearance_stays_a_stop_and_is_reported():
    # A shallow turn with a post inside it, a hair's breadth from both legs.
    half, gap = np.radians(5), 1e-4
    out = (0.07 + gap) / np.cos(half) * np.array([-np.sin(half), np.cos(half)])
    path, empty, checker = on_plane(
        (-0.95, 0), (0, 0), (0.9 * np.cos(2 * half), 0.9 * np.sin(2 * half)),
        obstacle=pp.Obstacle("post", pp.Sphere(0.02), pp.pose((*out, 0))),
    )  # fmt: skip
    assert pp.certify(path, checker).free
    smooth = pp.blend(path, checker, deviation=0.2)
    assert len(smooth.corners) == 1
    assert np.array_equal(smooth(smooth.corners[0]), path.q[1])
    assert pp.certify(smooth, checker).free
    assert pp.blend(path, empty, deviation=0.2).corners == ()


@pytest.mark.parametrize(
    ("q", "stops", "length"),
    [
        ([(-0.5, 0), (0.5, 0), (-0.5, 1e-3)], 1, 2.0),  # it reverses
        ([(-0.5, 0), (-0.5, 0), (0.0, 0), (0.5, 0), (0.5, 0)], 0, 1.0),  # collinear and repeated waypoints
        ([(0.1, 0.2)] * 3, 0, 0.0),
    ],
)
def test_a_path_stops_where_it_reverses_and_at_no_waypoint_that_is_no_corner(q, stops, length):
    path, checker, _ = on_plane(*q)
    smooth = pp.blend(path, checker)
    assert (len(smooth.corners), smooth.length) == (stops, pytest.approx(length, abs=1e-6))
    assert length or smooth.domain == (0.0, 0.0)


def test_short_legs_share_what_there_is():
    path, checker, _ = on_plane((-0.9, 0), (0, 0), (0, 0.02), (0.9, 0.02))
    smooth = pp.blend(path, checker, deviation=0.5)
    assert smooth.corners == ()
    assert np.abs(smooth(np.linspace(*smooth.domain, 2001))[:, 1]).max() <= 0.02 + 1e-12


def test_a_rounding_may_end_at_a_waypoint_that_is_no_corner():
    rng = np.random.default_rng(0)
    for _ in range(20):
        corner, away = rng.uniform(-0.2, 0.2, 2), rng.uniform((0.1, -0.5), (0.5, 0.5))
        path, checker, _ = on_plane((-0.9, 0.1), corner, corner + 0.3 * away, corner + away)
        smooth = pp.blend(path, checker, deviation=0.5)
        assert smooth.corners == ()
        assert_same_ends(smooth, path)


@pytest.mark.parametrize("seed", range(12))
def test_random_corners_are_missed_by_no_more_and_share_their_segments(seed):
    """Segments of very different lengths, without obstacles: no corner is a stop, and none deviates too far."""
    rng = np.random.default_rng(seed)
    angles, lengths = np.cumsum(rng.uniform(-2.5, 2.5, 6)), 10.0 ** rng.uniform(-2, 0, 6)
    steps = lengths[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    path, checker, _ = on_plane(*np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)]), limits=(-9.0, 9.0))
    deviation = 10.0 ** rng.uniform(-3, 0)
    smooth = pp.blend(path, checker, deviation=deviation)
    assert smooth.corners == ()
    points = smooth(np.linspace(*smooth.domain, 8001))
    for k, waypoint in enumerate(path.q[1:-1]):
        distance = np.linalg.norm(points - waypoint, axis=1).min()
        assert distance <= min(deviation, lengths[k], lengths[k + 1]) + 1e-3
    assert smooth.length <= path.length * (1 + 1e-9)


def test_the_quick_proof_agrees_with_certify(ur5):
    post = pp.Obstacle("post", pp.Box(0.1, 0.1, 1.4), pp.pose((0.5, 0.0, 0.6)))
    checker = pp.CollisionChecker(ur5, pp.Scene([post]), margin=0.002)
    rng, agreed = np.random.default_rng(0), set()
    for _ in range(60):
        a = ur5.limits.clip(ur5.home + rng.uniform(-1, 1, 6))
        path = path_of(checker, a, a + rng.uniform(-0.4, 0.4, 6))
        quick, complete = is_proven_free(path, checker), pp.certify(path, checker).free
        assert quick == complete
        agreed.add(quick)
    assert agreed == {True, False}


# -- simplified paths: with the certificate of exactly the curve that comes out ----------------------------------------


@pytest.mark.parametrize("blend", [True, False])
def test_shorter_and_proven(slot, detour, blend):
    found = pp.simplify(detour, slot, blend=blend).or_raise()
    assert isinstance(found.path, BlendedPath if blend else JointPath)
    assert found.certificate.matches(found.path, slot.arm, slot.scene)
    assert found.path.length < 0.9 * detour.length
    assert found.certificate.observed >= found.certificate.clearance >= slot.margin
    assert_same_ends(found.path, detour)
    assert f"from {detour.length:.3g} to {found.path.length:.3g}" in found.message
    assert_free(found.path, slot)


def test_rounded_is_shorter_than_not(slot, detour):
    rounded, straight = (pp.simplify(detour, slot, blend=blend) for blend in (True, False))
    assert rounded.path.length < straight.path.length
    assert (rounded.path.corners, rounded.stops) == ((), 0)
    assert straight.stops == len(straight.path) - 2 > 0


def test_a_curve_that_fails_its_last_proof_is_given_up_for_the_one_before(slot, detour, monkeypatch):
    home, through = importlib.import_module("pinproof.planning.simplification"), path_of(slot, *detour.q[[0, -1]])
    monkeypatch.setattr(home, "blend", lambda *args, **settings: BlendedPath.join(through))
    found = pp.simplify(detour, slot).or_raise()
    assert isinstance(found.path, JointPath)
    assert "rejected" in found.message
    monkeypatch.setattr(home, "shortcut", lambda *args, **settings: through)
    found = pp.simplify(detour, slot).or_raise()
    assert found.path is detour
    assert found.certificate.matches(detour, slot.arm, slot.scene)


def test_a_path_that_is_not_free_is_not_proven(slot, detour):
    found = pp.simplify(path_of(slot, *detour.q[[0, -1]]), slot)
    assert not found.ok
    with pytest.raises(pp.errors.NotProvenFree):
        found.or_raise()


def test_a_panda_s_plan(panda):
    post = pp.Obstacle("post", pp.Box(0.1, 0.1, 1.0), pp.pose((0.5, 0.0, 0.5)))
    checker = pp.CollisionChecker(panda, pp.Scene([post]), margin=0.002)
    start, goal = panda.home.copy(), panda.home.copy()
    start[0], goal[0] = -0.8, 0.8
    plan = pp.RrtConnect(time_limit=600.0).plan(checker, start, goal, rng=1).or_raise()
    found = pp.simplify(plan.path, checker).or_raise()
    assert found.path.length <= plan.path.length
    assert_free(found.path, checker)


def test_a_path_along_a_line_is_shortened_along_it_and_one_that_leaves_it_is_not_proven(ur5, free):
    start = np.array([0.3, -1.4, 1.7, -1.9, -1.57, 0.2])
    here = ur5.forward_kinematics(start)
    line = pp.plan_linear(free, start, pp.pose((0, 0.35, 0)) * here).path
    within = [pp.Within.line(tuple(here.translation), (0, 1, 0), tolerance=0.002)]
    shares = np.concatenate([np.linspace(0, 0.6, 13), np.linspace(0.55, 0.2, 8), np.linspace(0.25, 1, 16)])
    path = path_of(free, *line(shares))
    found = pp.simplify(path, free, blend=False, constraints=within).or_raise()
    assert found.path.length < 0.7 * path.length
    places = ur5.forward_kinematics_batch(found.path(np.linspace(*found.path.domain, 400)))[:, :3, 3]
    assert np.linalg.norm((places - here.translation)[:, [0, 2]], axis=1).max() <= 0.002
    straight = path_of(free, *path.q[[0, -1]])
    assert pp.certify(straight, free).free
    refused = pp.simplify(straight, free, blend=False, constraints=within)
    assert not refused.ok
    assert refused.certificate.violation is not None
