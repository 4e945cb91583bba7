"""Distances of placed bodies, of which one is a mesh or both are, and of the pairs that no joint moves."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from benchmarks.plain_coal import PlainCoal

import pinproof as pp
from pinproof import _core
from pinproof.collision.checking.links import Overlaps, _Samples, _touch
from pinproof.collision.checking.movers import with_movers
from pinproof.collision.geometry.bodies import shape_body
from pinproof.spatial import SE3

from .conftest import urdf_of
from .test_line_surface import mesh_of

HERE = pp.pose()


def gantry(joints: tuple[tuple[str, ...], ...] = (), base: str = "0.4 0.4 0.4") -> pp.Arm:
    """A ball of 0.1 m on three prismatic joints, and a box as base, with more joints and links at the base."""
    links = {"base": f'<box size="{base}"/>' if base else "", "x": "", "y": "", "z": '<sphere radius="0.1"/>'}
    slides = [("jx", "prismatic", "base", "x", "0 0 0", "1 0 0"), ("jy", "prismatic", "x", "y", "0 0 0", "0 1 0"),
              ("jz", "prismatic", "y", "z", "0 0 0", "0 0 1")]  # fmt: skip
    more = [(f"j_{name}", kind, "base", name, "0 0 0", "0 0 1", *rest) for name, kind, *rest in joints]
    text = urdf_of(links | {name: "" for name, *_ in joints}, [*slides, *more])
    return pp.load_robot(text.replace('lower="-7" upper="7"', 'lower="-9" upper="9"')).arm(tcp="z")


ROOM = pp.Obstacle("room", mesh_of(trimesh.creation.box((1, 1, 1))), pp.pose((3, 0, 0)))
SHELL = pp.Obstacle("shell", mesh_of(trimesh.creation.box((1, 1, 1)), hollow=True), pp.pose((-3, 0, 0)))


def signed(q: np.ndarray, middle: float, solid: bool) -> float:
    """The distance of the ball at q from a cube of 1 m; a ball inside a solid one overlaps it."""
    off = np.abs(q - [middle, 0, 0]) - 0.5
    outside = np.linalg.norm(np.maximum(off, 0))
    inside = -off.max()
    return outside - 0.1 if outside > 0 else -abs(inside - 0.1) if solid else inside - 0.1


@pytest.mark.parametrize("base", ["0.4 0.4 0.4", ""])
def test_contacts_with_meshes_are_those_of_the_formula(base) -> None:
    checker = pp.CollisionChecker(gantry(base=base), pp.Scene([ROOM, SHELL]), margin=0.02)
    pairs = {checker.bodies[j].owner: k for k, (i, j) in enumerate(checker.pairs) if checker.bodies[i].owner == "z"}
    space, rng = checker._workspace, np.random.default_rng(0)
    seen = set()
    for _ in range(300):
        middle = float(rng.choice([3.0, -3.0]))
        q = np.array([middle, 0, 0]) + rng.uniform(-0.8, 0.8, 3)
        expected = {"room": signed(q, 3, True), "shell": signed(q, -3, False)}
        if min(abs(distance - 0.02) for distance in expected.values()) < 1e-4:
            continue
        near = {name: bool(distance < 0.02) for name, distance in expected.items()}
        for name, k in pairs.items():
            if name != "base":
                assert (k in checker.pairs_in_contact(q)) is near[name]
                measured = space.measure(k)
                assert measured.proven <= measured.attained + 1e-12
                if expected[name] > 0:
                    assert measured.attained == pytest.approx(expected[name], abs=1e-9)
                else:
                    assert measured.attained == 0
                    assert measured.distance <= 0
        assert checker.is_free(q) is not any(near.values())
        seen.add(tuple(near.values()))
    assert seen == {(False, False), (True, False), (False, True)}


def test_an_audit_finds_a_body_that_is_inside_another_from_the_start() -> None:
    checker = pp.CollisionChecker(gantry(), pp.Scene([ROOM]))
    for at, clean in (((3.0, 0, 0), False), ((4.0, 0, 0), True), ((3.45, 0, 0), False)):
        for path in ([at], [at, np.add(at, 1e-3)]):
            assert pp.audit(pp.JointPath(path, checker.arm.joint_names), checker).clean is clean


def test_points_are_judged_without_those_that_were_judged_before() -> None:
    checker = pp.CollisionChecker(gantry(), pp.Scene([ROOM, pp.Obstacle("ball", pp.Sphere(0.1), pp.pose((0, 3, 0)))]))
    edges = _core.EdgeChecker(checker.world, 0.05)
    near, free, blocked = np.array([2.95, 0, 0]), np.array([0, 0, 2.0]), np.array([0, 3.0, 0])
    for judge in (lambda a, b: edges.points_free(np.array([a, b])), edges.samples_free, edges.proven_free):
        for _ in range(2):
            assert not judge(near, blocked)
            assert not judge(blocked, near)
            assert judge(free, free + 0.1)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
def test_the_clearance_includes_the_pairs_that_no_joint_moves(order) -> None:
    """Balls at the base, one of them a mesh inside it, near one that moves far away."""
    gaps = (-0.03, -0.01, 0.02)
    things = [pp.Obstacle(f"ball{k}", pp.Sphere(0.05), pp.pose((0.25 + gap, 0, 0))) for k, gap in enumerate(gaps)]
    q = np.array([0, 0, 5.0])
    for count in (1, 2, 3):
        scene = pp.Scene([things[k] for k in order[:count]])
        checker = pp.CollisionChecker(gantry(), scene)
        assert checker.clearance(q) == pytest.approx(min(gaps[k] for k in order[:count]), abs=1e-5)
        touching = {thing.name for thing in scene.obstacles if gaps[int(thing.name[-1])] < 0}
        assert {contact.bodies[1] for contact in checker.check(q).contacts} == touching


def test_the_distance_of_touching_bodies_is_within_the_bounds_of_the_core() -> None:
    rng = np.random.default_rng(1)
    for _ in range(40):
        shape = pp.Box(*rng.uniform(0.1, 1, 3)) if rng.integers(2) else pp.Capsule(0.1, 0.5)
        block = pp.Obstacle("block", shape, pp.pose((3, 0, 0), rng.uniform(-3, 3, 3)))
        checker = pp.CollisionChecker(gantry(), pp.Scene([block]))
        (k,) = (
            k for k, (i, j) in enumerate(checker.pairs) if [checker.bodies[b].owner for b in (i, j)] == ["z", "block"]
        )
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        low, high = 0.0, 3.0
        space = checker._placed(np.zeros(3))
        for _ in range(45):  # to where they touch
            middle = (low + high) / 2
            space.move(np.array([3, 0, 0]) + middle * direction)
            low, high = (middle, high) if space.measure(k).attained <= 0 else (low, middle)
        for offset in (-1e-2, -1e-4, -1e-7, -1e-9, 0.0, 1e-9, 1e-7, 1e-4):
            space.move(np.array([3, 0, 0]) + (low + offset) * direction)
            measured = space.measure(k)
            assert measured.distance <= max(measured.attained, 0.0) + 1e-9
            assert abs(offset) < 1e-8 or (measured.attained <= 0) is (offset <= 0)


def test_the_plain_check_with_and_without_a_tree_is_that_of_the_checker() -> None:
    block = pp.Obstacle("block", pp.Box(0.4, 0.4, 0.4), pp.pose((0.6, 0, 0.3)))
    checker = pp.CollisionChecker(pp.load_robot("ur5").arm(), pp.Scene([block]), margin=0.005)
    many = np.random.default_rng(0).uniform(-2, 2, (60, 6))
    expected = checker.is_free_batch(many)
    assert 10 < expected.sum() < 50
    for broadphase in (False, True):
        plain = PlainCoal(checker, broadphase=broadphase)
        assert [plain.is_free(q) for q in plain.configurations(many)] == expected.tolist()
        apart = [plain.clearance(q) for q in plain.configurations(many)]
        clear = checker.clearance_batch(many)
        assert (np.abs(apart - clear) < 1e-4)[clear > 1e-3].all()


def test_samples_of_joints_are_within_their_ranges_and_followers_follow() -> None:
    limit = '<limit lower="{}" upper="{}" velocity="1" effort="1"/>'
    robot = gantry(
        (
            ("slide", "prismatic", limit.format(0.2, 0.3)), ("hinge", "revolute", limit.format(-0.1, 0.4)),
            ("wheel", "continuous", limit.format(0, 0.1)), ("free", "continuous", "<!--<limit-->"),
            ("after", "revolute", limit.format(-9, 9), '<mimic joint="j_hinge" multiplier="-2" offset="0.5"/>'),
        )
    ).robot  # fmt: skip
    samples = _Samples(robot)
    q = np.array([samples.configuration(i) for i in range(300)])

    def column(name: str) -> np.ndarray:
        joint = robot.model.joints[robot.model.getJointId(robot.urdf.model_joint(f"j_{name}"))]
        if joint.nq == 2:
            return np.arctan2(q[:, joint.idx_q + 1], q[:, joint.idx_q])
        return q[:, joint.idx_q]

    for name, low, high in (
        ("slide", 0.2, 0.3),
        ("hinge", -0.1, 0.4),
        ("wheel", -np.pi, np.pi),
        ("free", -np.pi, np.pi),
    ):
        values = column(name)
        assert low <= values.min() < low + 0.03 * (high - low)
        assert high - 0.03 * (high - low) < values.max() <= high
    assert column("after") == pytest.approx(0.5 - 2 * column("hinge"))


def test_bodies_touch_in_a_sample_where_their_distance_is_zero_or_one_is_inside_the_other() -> None:
    rng, counts = np.random.default_rng(2), {True: 0, False: 0}
    shapes = [pp.Sphere(0.1), pp.Box(0.3, 0.2, 0.4), pp.Capsule(0.05, 0.3), ROOM.shape, SHELL.shape]
    for _ in range(200):
        chosen = [shapes[int(k)] for k in rng.integers(len(shapes), size=2)]
        one, other = (shape_body("b", "b", None, shape, HERE) for shape in chosen)
        places = [SE3(pp.pose(rng.uniform(-0.5, 0.5, 3), rng.uniform(-3, 3, 3))) for _ in range(2)]
        touching = _touch(one, places[0], other, places[1])
        assert touching == _touch(other, places[1], one, places[0])
        counts[touching] += 1
        samples = rng.uniform(-0.5, 0.5, (1000, 3)) @ places[0].rotation.T + places[0].translation
        common = np.ones(len(samples), dtype=bool)
        for shape, body, place in zip(chosen, (one, other), places, strict=True):
            local = (samples - place.translation) @ place.rotation
            common &= (local > body.box[0]).all(axis=1) & (local < body.box[1]).all(axis=1)
            if isinstance(shape, pp.Sphere | pp.Capsule):
                half = 0.15 if isinstance(shape, pp.Capsule) else 0.0
                common &= np.linalg.norm(local - np.clip(local * [0, 0, 1], -half, half), axis=1) < shape.radius
        assert touching or SHELL.shape in chosen or not common.any()
    assert min(counts.values()) > 30


def test_bodies_just_apart_do_not_touch() -> None:
    box, ball = (shape_body("b", "b", None, shape, HERE) for shape in (pp.Box(0.2, 0.2, 0.2), pp.Sphere(0.1)))
    corner = np.full(3, 0.1 + 0.1 / np.sqrt(3))
    for gap, expected in ((-1e-5, True), (1e-4, False), (0.5, False)):
        at = SE3(pp.pose(corner + gap / np.sqrt(3)))
        assert _touch(box, SE3(HERE), ball, at) is expected
        assert _touch(ball, at, box, SE3(HERE)) is expected


@pytest.mark.filterwarnings("ignore::pinproof.errors.UnitWarning")
def test_overlaps_of_bodies_count_the_samples_in_which_they_touch() -> None:
    checker = pp.CollisionChecker(gantry(base="6 6 6"))
    robot = checker.arm.robot
    overlaps = Overlaps(robot, checker._link_bodies, 100, 400)
    overlap = overlaps.of("base", "z")
    assert (overlap.samples, overlap.always) == (100, False)
    assert abs(overlap.touching / 100 - (6.2 / 18) ** 3) < 0.1
    always = overlaps.of("base", "base")
    assert (always.touching, always.samples, always.always) == (400, 400, True)
    assert overlaps.always_touch("base", "base")
    assert not overlaps.always_touch("base", "z")


def test_joints_that_are_held_keep_their_values_among_movers() -> None:
    arm = gantry((("first", "revolute"), ("last", "revolute"))).with_held({"j_first": 0.2, "j_last": 0.3})
    checker = pp.CollisionChecker(arm, pp.Scene([ROOM]))
    motion = pp.time_parametrise(pp.JointPath([[0, 0, 2], [0, 0, 2.1]], arm.joint_names), arm.limits)
    belt = pp.Mover.constant("belt", ["room"], 0.1, 10.0)
    assert dict(with_movers(motion, checker, [belt]).checker.group.held) == {"j_first": 0.2, "j_last": 0.3}
