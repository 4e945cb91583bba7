"""Checkers for other stages of a task, their specifications, margins of single pairs, many configurations at once."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.collision import CheckerSpec, PairMargin
from pinproof.collision.checking import pairs
from pinproof.description import robots_folder

from ..examples import examples

BALL = pp.Obstacle("ball", pp.Sphere(0.1), pp.pose((0.5, 0.1, 0.4)))
TABLE = pp.Obstacle("table", pp.Box(1.0, 1.0, 0.05), pp.pose((0.6, 0, -0.1)))
TOOL = pp.Obstacle("tool", pp.Box(0.05, 0.05, 0.2), pp.pose((0, 0, 0.1)))


def random_q(arm, count, seed=0):
    return np.random.default_rng(seed).uniform(-3, 3, (count, arm.dof))


def same(one, other, arm):
    many = random_q(arm, 60)
    assert one.is_free_batch(many).tolist() == other.is_free_batch(many).tolist()
    assert one.clearance_batch(many).tolist() == other.clearance_batch(many).tolist()
    for name in ("pairs", "excluded", "finer"):
        assert getattr(one, name) == getattr(other, name)
    for name in ("margins", "still_pairs", "convex"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_array_equal(one.world.first_directions, other.world.first_directions)
    assert one.fingerprint() == other.fingerprint()


def test_a_derived_checker_equals_a_new_one(ur5):
    checker = pp.CollisionChecker(ur5, pp.Scene([BALL, TABLE]))
    same(checker.with_margin(0.01), pp.CollisionChecker(ur5, checker.scene, margin=0.01), ur5)
    same(checker.with_scene(pp.Scene([TABLE])), pp.CollisionChecker(ur5, pp.Scene([TABLE])), ur5)
    same(checker.with_attached(TOOL), pp.CollisionChecker(ur5, checker.scene, attached=[TOOL]), ur5)
    allowed = [("forearm_link", "ball")]
    same(checker.allowing(*allowed), pp.CollisionChecker(ur5, checker.scene, allowed=allowed), ur5)
    grasp = checker.with_attached(TOOL).allowing(("tool", "ball")).with_margin(0.002)
    same(grasp, pp.CollisionChecker(ur5, checker.scene, margin=0.002, attached=[TOOL], allowed=[("tool", "ball")]), ur5)
    same(pickle.loads(pickle.dumps(checker)).with_attached(TOOL), checker.with_attached(TOOL), ur5)
    same(pickle.loads(pickle.dumps(grasp)), grasp, ur5)


def test_another_scene_keeps_what_is_stated_of_attached_objects(ur5):
    """Margins and allowed contacts of both objects are kept, those of a removed obstacle are dropped."""
    grip = pp.Obstacle("grip", pp.Box(0.02, 0.02, 0.02), pp.pose((0, 0, 0.02)))
    stated = {
        "attached": [grip, TOOL],
        "allowed": [("grip", "table"), ("forearm_link", "tool")],
        "margins": {("tool", "table"): 0.02, ("grip", "upper_arm_link"): 0.01},
    }
    of_ball = {"allowed": [("tool", "ball")], "margins": {("grip", "ball"): 0.03}}
    checker = pp.CollisionChecker(
        ur5,
        pp.Scene([BALL, TABLE]),
        attached=stated["attached"],
        allowed=[*stated["allowed"], *of_ball["allowed"]],
        margins=stated["margins"] | of_ball["margins"],
    )
    same(checker.with_scene(pp.Scene([TABLE])), pp.CollisionChecker(ur5, pp.Scene([TABLE]), **stated), ur5)


def test_a_checker_with_held_joints_equals_that_of_the_arm_with_these():
    arm = pp.load_robot("panda").arm()
    checker, held = pp.CollisionChecker(arm, pp.Scene([BALL])), {"panda_finger_joint1": 0.03}
    other = checker.with_held(held)
    same(other, pp.CollisionChecker(arm.with_held(held), pp.Scene([BALL])), arm)
    assert other.group.held["panda_finger_joint1"] == 0.03
    assert other.fingerprint() != checker.fingerprint()
    same(other.with_held(arm.held), checker, arm)


def crowd(count: int) -> pp.Scene:
    """Boxes, spheres and exact meshes about an arm."""
    rng = np.random.default_rng(4)
    solid = trimesh.creation.annulus(0.03, 0.08, 0.05)
    shapes = (
        pp.Box(0.1, 0.15, 0.2),
        pp.Sphere(0.06),
        pp.Mesh(vertices=np.array(solid.vertices), triangles=np.array(solid.faces), hull=False),
    )
    places = [somewhere(rng) for _ in range(count)]
    return pp.Scene([pp.Obstacle(f"thing_{i}", shapes[i % 3], place) for i, place in enumerate(places)])


def somewhere(rng):
    towards = rng.normal(size=3)
    return pp.pose(towards / np.linalg.norm(towards) * rng.uniform(0.6, 3.0), rng.uniform(-2, 2, 3))


@pytest.mark.parametrize("moves", [1, 5, 40])
def test_a_checker_of_moved_obstacles_equals_a_new_one(ur5, moves):
    """A few of them take their places in the tree of the others; with many moves, a new tree is made."""
    rng = np.random.default_rng(moves)
    checker = first = pp.CollisionChecker(ur5, crowd(150), allowed=[("forearm_link", "thing_7")])
    for _ in range(moves):
        checker = checker.with_scene(checker.scene.move(f"thing_{rng.integers(150)}", somewhere(rng)))
    assert checker._assembly.pairs is first._assembly.pairs
    assert 0 < len(checker._assembly.around.replaced) <= min(moves, 150 / 8)
    new = pp.CollisionChecker(ur5, checker.scene, allowed=[("forearm_link", "thing_7")])
    Q = random_q(ur5, 2000)
    assert checker.is_free_batch(Q).tolist() == new.is_free_batch(Q).tolist()
    assert 100 < checker.is_free_batch(Q).sum() < 1900
    np.testing.assert_allclose(checker.clearance_batch(Q[:200]), new.clearance_batch(Q[:200]), rtol=0, atol=1e-9)
    for q in Q[:100]:
        assert {c.bodies for c in checker.check(q).contacts} == {c.bodies for c in new.check(q).contacts}
    assert checker.rounding == new.rounding
    assert checker.fingerprint() == new.fingerprint()
    same(pickle.loads(pickle.dumps(checker)), checker, ur5)


def test_an_obstacle_of_another_shape_takes_the_place_of_the_old_one(ur5):
    scene = crowd(40)
    plate = trimesh.creation.box((0.3, 0.3, 0.01))
    shapes = [
        pp.Sphere(0.2),
        pp.HalfSpace(),
        pp.Mesh(vertices=np.array(plate.vertices), triangles=np.array(plate.faces), hull=False),
    ]
    checker = pp.CollisionChecker(ur5, scene)
    for shape in shapes:
        changed = replace(scene["thing_4"], shape=shape)
        other = replace(scene, obstacles=tuple(changed if o.name == "thing_4" else o for o in scene.obstacles))
        derived, new = checker.with_scene(other), pp.CollisionChecker(ur5, other)
        Q = random_q(ur5, 500)
        assert derived.is_free_batch(Q).tolist() == new.is_free_batch(Q).tolist()
        assert derived.convex.tolist() == new.convex.tolist()


def test_a_margin_stays_with_its_obstacle_when_the_order_of_the_obstacles_changes(ur5):
    """The pairs of bodies are the same, but of other obstacles."""
    near, far = BALL, pp.Obstacle("far", pp.Sphere(0.1), pp.pose((-3.0, 0, 0)))
    margins = {("forearm_link", "ball"): 0.2, ("wrist_3_link", "ball"): 0.1}
    checker = pp.CollisionChecker(ur5, pp.Scene([near, far]), margins=margins)
    turned = pp.Scene([far, near])
    same(checker.with_scene(turned), pp.CollisionChecker(ur5, turned, margins=margins), ur5)
    again = checker.with_scene(turned).with_scene(checker.scene).with_held({})
    same(again, checker, ur5)


def test_a_moved_obstacle_that_was_the_farthest_no_longer_sets_the_allowance_for_rounding(ur5):
    scene = crowd(40).move("thing_3", pp.pose((900.0, 0, 0)))
    far = pp.CollisionChecker(ur5, scene)
    near = far.with_scene(scene.move("thing_3", pp.pose((1.0, 0, 0))))
    assert far.rounding > 100 * near.rounding
    assert near.rounding == pp.CollisionChecker(ur5, near.scene).rounding
    assert near.with_scene(far.scene).rounding == far.rounding


def test_omitted_pairs_are_checked_again_in_another_scene(ur5):
    checker = pp.CollisionChecker(ur5, crowd(40))
    less = checker.without_pairs(range(0, len(checker.pairs), 2))
    assert len(less.pairs) < len(checker.pairs)
    assert less.with_scene(checker.scene.move("thing_1", pp.pose((0, 0, 3.0)))).pairs == checker.pairs
    assert less.with_margin(0.01).pairs == less.pairs
    allowed = less.allowing(("forearm_link", "thing_2"))
    again = allowed.with_scene(checker.scene.move("thing_1", pp.pose((0, 0, 3.0))))
    assert again.pairs == checker.allowing(("forearm_link", "thing_2")).pairs


def test_deriving_does_not_change_the_checker(ur5):
    checker, fresh = pp.CollisionChecker(ur5, pp.Scene([BALL])), pp.CollisionChecker(ur5, pp.Scene([BALL]))
    checker.is_free(np.zeros(6))
    derived = [checker.with_margin(0.1), checker.with_scene(pp.Scene()), checker.with_attached(TOOL)]
    for other in derived:
        other.is_free(np.zeros(6))
    same(checker, fresh, ur5)


def test_a_margin_of_a_single_pair_goes_before_the_common_one(slider):
    scene = pp.Scene(
        [
            pp.Obstacle("part", pp.Sphere(0.04), pp.pose((0.0, 0.1, 0))),
            pp.Obstacle("wall", pp.Box(1, 0.1, 1), pp.pose((0, -0.2, 0))),
        ]
    )
    for part, common, free in ((0.049, 0.139, True), (0.051, 0.139, False), (0.049, 0.141, False)):
        checker = pp.CollisionChecker(slider, scene, margin=common, margins={("part", "ball"): part})
        assert checker.is_free([0.0]) is free
        assert checker.check([0.0]).free is free
        assert checker.is_free_batch([[0.0]]).tolist() == [free]
    assert checker.with_margin(0.1).is_free([0.0])  # the single one stays
    assert not checker.with_margin(margins={}).is_free([0.0])


@pytest.mark.parametrize("far", range(3))
def test_the_allowance_for_rounding_grows_with_the_farthest_body(slider, far):
    """Whichever of the obstacles it is; a free configuration is then free by more."""
    places = [pp.pose((0, 1, 0)), pp.pose((0, 2, 0)), pp.pose((0, 3, 0))]
    near = pp.CollisionChecker(
        slider, pp.Scene([pp.Obstacle(f"o{k}", pp.Sphere(0.1), at) for k, at in enumerate(places)])
    )
    places[far] = pp.pose((0, 1000, 0))
    wide = pp.CollisionChecker(
        slider, pp.Scene([pp.Obstacle(f"o{k}", pp.Sphere(0.1), at) for k, at in enumerate(places)])
    )
    assert wide.rounding == pytest.approx(1000.1 * near.rounding / max(3.1, 1.0), rel=0.01)
    assert 1e-10 <= near.rounding < 1e-8


@pytest.mark.parametrize("threads", [1, 3])
def test_a_batch_is_its_configurations(ur5, mesh_file, threads):
    """Convex bodies, and an exact mesh."""

    exact = pp.Obstacle(
        "exact", pp.Mesh(mesh_file(trimesh.creation.box((0.3, 0.3, 0.3))), hull=False), pp.pose((0.4, -0.3, 0.5))
    )
    checker = pp.CollisionChecker(ur5, pp.Scene([BALL, TABLE, exact]))
    many = random_q(ur5, 200)
    assert checker.is_free_batch(many, threads=threads).tolist() == [checker.is_free(q) for q in many]
    assert checker.clearance_batch(many, threads=threads).tolist() == [checker.clearance(q) for q in many]
    assert checker.is_free_batch(np.empty((0, 6)), threads=threads).shape == (0,)
    with pytest.raises(pp.InputError):
        checker.is_free_batch(np.full((1, 6), np.nan), threads=threads)
    with pytest.raises(pp.InputError, match="threads"):
        checker.is_free_batch(many, threads=0)


@pytest.mark.parametrize("name", ["ur5", "panda", "kinova", "stanford", "scara", "xarm7", "iiwa14", "so100", "puma560"])
def test_bodies_are_placed_where_pinocchio_places_them(name):
    arm = pp.load_robot(name).arm()
    checker = pp.CollisionChecker(arm, pp.Scene([BALL, pp.Obstacle("floor", pp.HalfSpace(), pp.pose((0, 0, -1)))]))
    data, placed = arm.model.createData(), checker.geometry_model.createData()
    for q in (*random_q(arm, 20), np.full(arm.dof, 1e6)):
        pin.updateGeometryPlacements(arm.model, data, checker.geometry_model, placed, arm.model_configuration(q))
        space = checker._placed(q)
        for i, body in enumerate(checker.bodies):
            size = 1 + np.abs(placed.oMg[i].translation).max()
            at = space.root_from_body(i)
            np.testing.assert_allclose(at[:3, :3], placed.oMg[i].rotation, atol=1e-9)
            np.testing.assert_allclose(at[:3, 3], placed.oMg[i].translation, atol=1e-9 * size, err_msg=body.name)


def test_no_result_depends_on_earlier_queries(ur5):
    """Pairs that touched recently are tested first. Pinocchio's own requests start GJK where the last query ended."""
    checker, many = pp.CollisionChecker(ur5, pp.Scene([BALL, TABLE])), random_q(ur5, 150)
    single = [checker.with_margin(0.0) for _ in many]
    fresh = [pp.CollisionChecker.is_free(one, q) for one, q in zip(single, many, strict=True)]
    clear = [pp.CollisionChecker.clearance(one, q) for one, q in zip(single, many, strict=True)]
    assert 10 < sum(fresh) < 140
    for order in (np.arange(150), np.arange(150)[::-1], np.random.default_rng(1).permutation(150)):
        assert [checker.is_free(q) for q in many[order]] == [fresh[i] for i in order]
        assert [checker.clearance(q) for q in many[order]] == [clear[i] for i in order]
        assert checker.is_free_batch(many[order]).tolist() == [fresh[i] for i in order]


def test_a_padded_checker_is_that_of_its_own_margins(ur5):
    checker = pp.CollisionChecker(ur5, pp.Scene([BALL]), margin=0.01)
    assert checker.padded(0.005) is checker.padded(0.005)
    assert checker.padded(0.001).margin == 0.011
    assert checker.with_margin(0.02).padded(0.001).margin == 0.021
    same(checker.padded(0.005), pp.CollisionChecker(ur5, checker.scene, margin=0.015), ur5)


def test_checkers_of_one_robot_share_convex_bodies_until_a_mesh_file_changes(tmp_path):
    def write(side: float) -> None:
        trimesh.creation.box((side, side, side)).export(tmp_path / "part.stl")

    write(0.1)
    (tmp_path / "arm.urdf").write_text(
        '<robot name="arm"><link name="base"><collision><geometry><mesh filename="part.stl"/></geometry></collision>'
        '</link><link name="tip"/><joint name="turn" type="revolute"><parent link="base"/><child link="tip"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    arm = pp.load_robot(tmp_path / "arm.urdf").arm("tip")
    first, second = (pp.CollisionChecker(arm, pp.Scene([BALL])).bodies[0] for _ in range(2))
    assert first is second
    write(0.3)
    assert pp.CollisionChecker(arm, pp.Scene([BALL])).bodies[0].box[1, 0] == pytest.approx(0.15)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        *(({"margin": margin}, "margin") for margin in ([0.01], "wide", np.nan, np.inf, -1e-9, -0.001, 10**400)),
        *(
            ({"margins": {pair: 0.1}}, "margin")
            for pair in (("ball", "ball"), ("ball",), "ball", ("a", "ball", "ball"))
        ),
        ({"margins": {("table", "ball"): -1.0}}, "margin"),
        *(({"margins": {(name, "ball"): 0.1}}, "table") for name in ("nobody", "aaa")),
        ({"allowed": [("screw", "table")]}, "screw"),
        ({"housing": np.nan}, "housing"),
    ],
)
def test_an_invalid_setting_is_refused(ur5, wrong, words):
    scene = pp.Scene([BALL, TABLE])
    with pytest.raises(pp.InputError, match=words):
        pp.CollisionChecker(ur5, scene, **wrong)
    checker = pp.CollisionChecker(ur5, scene)
    changes = [checker.with_margin, checker.padded] if "margin" in wrong else []
    for change in changes:
        with pytest.raises(pp.InputError, match="distance in metres"):
            change(wrong["margin"])
    if "allowed" in wrong:
        with pytest.raises(pp.UnknownNameError, match=words):
            checker.allowing(*wrong["allowed"])


POST = pp.Obstacle("post", pp.Box(0.1, 0.1, 1.0), pp.pose(xyz=(0.6, 0, 0.5)))
WALL = pp.Obstacle("wall", pp.Box(0.1, 0.1, 1.0), pp.pose(xyz=(0.6, 0.5, 0.5)))

CHANGES = {
    "scene": lambda of: of.with_scene(pp.Scene([WALL])),
    "attached": lambda of: of.with_attached(TOOL),
    "margin": lambda of: of.with_margin(0.03),
    "padded": lambda of: of.padded(0.01),
    "tolerance": lambda of: of.with_obstacle_tolerance(0.02),
    "allowed": lambda of: of.allowing(("wrist_3_link", "wall")),
}


@pytest.fixture(scope="module")
def spec() -> CheckerSpec:
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    return CheckerSpec(arm, pp.Scene([POST, WALL]), margin=0.002, margins={("forearm_link", "post"): 0.05})


@examples(30)
@given(names=st.lists(st.sampled_from(sorted(CHANGES)), min_size=1, max_size=3))
def test_changed_checker_equals_the_checker_of_the_changed_specification(spec: CheckerSpec, names: list[str]) -> None:
    changed, checker = spec, pp.CollisionChecker.of(spec)
    for name in names:
        changed, checker = CHANGES[name](changed), CHANGES[name](checker)
    built = pp.CollisionChecker.of(changed)
    assert checker.fingerprint() == built.fingerprint()
    assert checker.spec.setup_hash() == changed.setup_hash()
    q = np.random.default_rng(0).uniform(-2, 2, (20, 6))
    assert (checker.clearance_batch(q) == built.clearance_batch(q)).all()
    assert (checker.is_free_batch(q) == built.is_free_batch(q)).all()


def test_changes_leave_the_specification_as_it_was(spec: CheckerSpec) -> None:
    before = spec.setup_hash(), dict(spec.margins), spec.margin, spec.allowed, spec.scene.names, spec.attached
    for change in CHANGES.values():
        change(spec)
    assert before == (spec.setup_hash(), dict(spec.margins), spec.margin, spec.allowed, spec.scene.names, spec.attached)


def test_hash_depends_on_the_set_up_and_not_on_margins(spec: CheckerSpec) -> None:
    moved = replace(POST, pose=pp.pose(xyz=(0.6, 0, 0.5000001)))
    others = [
        spec.with_scene(pp.Scene([moved, WALL])),
        spec.with_scene(pp.Scene([POST])),
        spec.with_attached(TOOL),
        replace(spec, arm=pp.load_robot("ur5").arm(tcp="ee_link")),
        replace(spec, arm=pp.load_robot("ur3").arm(tcp="tool0")),
    ]
    assert len({spec.setup_hash(), *(other.setup_hash() for other in others)}) == 6
    assert spec.with_margin(0.1).padded(0.1).setup_hash() == spec.setup_hash()


def test_margin_of_a_removed_obstacle_has_no_effect_until_it_returns(spec: CheckerSpec) -> None:
    checker = pp.CollisionChecker.of(spec)
    without = checker.with_scene(pp.Scene([WALL]))
    assert set(without.margins.tolist()) == {spec.margin}
    assert spec.with_scene(pp.Scene([POST])).margins == {frozenset(("forearm_link", "post")): 0.05}
    assert without.with_scene(spec.scene).margins.tolist() == checker.margins.tolist()


def test_pairs_that_were_left_out_are_checked_again_in_the_same_surroundings(spec: CheckerSpec) -> None:
    checker = pp.CollisionChecker.of(spec)
    partial = checker.without_pairs(range(len(checker.pairs)))
    assert partial.pairs == ()
    assert partial.with_scene(checker.scene).pairs == checker.pairs
    assert partial.with_attached().pairs == checker.pairs


PICKER = pp.Obstacle("picker", pp.Cylinder(radius=0.02, length=0.1), pp.pose((0, 0, 0.05)))


@pytest.fixture(scope="module")
def cell() -> tuple[pp.Arm, pp.Scene]:
    return pp.load_robot("ur5").arm(tcp="tool0"), pp.Scene.load(robots_folder() / "ur5" / "scene.yaml")


@pytest.mark.parametrize(
    "pairs",
    [
        [("picker", "bolt_1")],
        [("bolt_3", "wrist_3_link"), ("picker", "bolt_3"), ("picker", "table")],
        [("forearm_link", "wrist_3_link")],
        [("upper_arm_link", "picker"), ("shoulder_link", "bolt_7")],
        [("bolt_1", "table")],
        [("base_link", "table"), ("base_link", "shoulder_link")],
        [("picker", "*")],
        [],
    ],
)
def test_it_is_the_same_as_one_that_was_made_so(cell, pairs) -> None:
    arm, scene = cell
    before = [("picker", "bolt_5"), ("wrist_2_link", scene.names[-1])]
    started = pp.CollisionChecker(arm, scene, margin=0.002, attached=[PICKER], allowed=before)
    derived = started.allowing(*pairs)
    made = pp.CollisionChecker(arm, scene, margin=0.002, attached=[PICKER], allowed=[*before, *pairs])
    same(derived, made, arm)
    # Checkers that are derived from these two are the same, too.
    again, direct = (each.with_scene(scene.remove("bolt_2")) for each in (derived, made))
    same(again, direct, arm)


def test_a_copy_keeps_the_bodies_it_has(cell) -> None:
    arm, scene = cell
    checker = pp.CollisionChecker(arm, scene)
    fewer = checker.with_scene(scene.remove("bolt_2"))
    kept = {id(body) for body in checker.bodies}
    assert all(id(body) in kept for body in fewer.bodies)


CLUTTER = [pp.Obstacle(f"box_{i}", pp.Box(0.1, 0.1, 0.1 + 0.01 * i), pp.pose((2.0, 0.2 * i, 0.3))) for i in range(8)]


def chain_of_checkers(arm, link: str, hand: dict[str, float]):
    """Checkers of a task, each derived from another, of which some were derived before with other bodies."""
    start = pp.CollisionChecker(arm, pp.Scene([BALL, TABLE, *CLUTTER], allowed=[(link, "box_3")]), margin=0.002)
    yield start
    for size in (0.02, 0.5):  # a small object touches other links than one that contains the hand
        part = pp.Obstacle("part", pp.Box(size, size, size), pp.pose((0, 0, size / 2)))
        yield (held := start.with_attached(TOOL, part))
        yield held.allowing(("tool", "part"), ("part", "table"), (link, "ball"))
        yield held.with_scene(held.scene.move("box_5", pp.pose((2.1, 0.0, 0.3)))).with_held(hand)
        yield held.with_scene(held.scene.remove("box_3", "ball")).with_margin(0.01)
        yield held.with_margin(margins={("part", "box_6"): 0.03, ("tool", link): 0.0}).with_obstacle_tolerance(0.001)
        yield start.with_scene(pp.Scene([*CLUTTER, TABLE], allowed=[("*", "table")])).with_attached(part)
        yield held.without_pairs(range(5)).with_scene(pp.Scene([TABLE]))


@pytest.mark.parametrize(
    ("robot", "link", "hand"), [("ur5", "forearm_link", {}), ("panda", "panda_link5", {"panda_finger_joint1": 0.02})]
)
def test_checkers_of_a_task_equal_new_ones(robot, link, hand, monkeypatch):
    arm = pp.load_robot(robot).arm()
    derived = list(chain_of_checkers(arm, link, hand))
    monkeypatch.setattr(pairs, "_KNOWN", WeakKeyDictionary())
    for checker in derived:
        pairs._KNOWN.clear()  # nothing is known of the robot
        same(checker, pp.CollisionChecker.of(checker.spec), checker.group)


def test_an_obstacle_cannot_have_the_bodies_of_another(ur5):
    with pytest.raises(pp.InputError, match="two bodies have the name 'ball'"):
        pp.CollisionChecker(ur5, pp.Scene([BALL])).with_attached(BALL)


def near_ball(arm, margins, **more):
    """Checkers of the ball with margins that the scene states, and with those of a caller."""
    stated = [PairMargin(pair, margin) for pair, margin in margins.items()]
    scene = pp.Scene([BALL, TABLE])
    return pp.CollisionChecker(arm, replace(scene, margins=stated), **more), pp.CollisionChecker(
        arm, scene, margins=margins, **more
    )


def test_margins_that_a_scene_states_are_those_of_the_checker(ur5):
    margins = {("forearm_link", "ball"): 0.05, ("tool", "table"): 0.02}
    of_scene, of_caller = near_ball(ur5, margins, margin=0.002, attached=[TOOL])
    same(of_scene, of_caller, ur5)
    for change in (
        lambda checker: checker.padded(0.01),
        lambda checker: checker.with_margin(0.004),
        lambda checker: checker.with_obstacle_tolerance(0.01),
        lambda checker: checker.with_held({}),
        lambda checker: checker.exact(),
        lambda checker: pickle.loads(pickle.dumps(checker)),
    ):
        same(change(of_scene), change(of_caller), ur5)
    # Stated for the same pair by the caller, that of the scene has no effect
    other = pp.CollisionChecker(
        ur5, of_scene.scene, margin=0.002, margins={("ball", "forearm_link"): 0.0}, attached=[TOOL]
    )
    assert set(other.margins.tolist()) == {0.0, 0.002, 0.02}


def test_a_part_keeps_its_margins_while_it_is_carried_and_put_down(ur5):
    checker, _ = near_ball(ur5, {("forearm_link", "ball"): 0.05, ("ball", "table"): 0.03}, margin=0.002)
    lifted = checker.with_scene(checker.scene.remove("ball")).with_attached(BALL)
    at = {frozenset(lifted.owners(k)): margin for k, margin in enumerate(lifted.margins.tolist())}
    assert at[frozenset(("ball", "table"))] == 0.03
    put_down = replace(lifted.spec, attached=(), scene=checker.scene)
    same(lifted.with_spec(put_down), checker, ur5)


def test_another_scene_replaces_the_margins_of_the_one_before(ur5):
    checker, _ = near_ball(ur5, {("forearm_link", "ball"): 0.05}, margin=0.002)
    nearer = replace(checker.scene, margins=[PairMargin(("ball", "forearm_link"), 0.01)])
    same(checker.with_scene(nearer), pp.CollisionChecker(ur5, nearer, margin=0.002), ur5)


def test_a_margin_of_a_scene_for_a_body_that_does_not_exist_is_refused(ur5):
    scene = pp.Scene([BALL], margins=[PairMargin(("forearm", "ball"), 0.05)], source="cell.yaml")
    for make in (lambda: pp.CollisionChecker(ur5, scene), lambda: pp.CollisionChecker(ur5).with_scene(scene)):
        with pytest.raises(
            pp.UnknownNameError, match=r"'forearm' in the margins of the scene cell\.yaml; valid: forearm_"
        ):
            make()


def test_the_proof_of_a_motion_states_the_margins_of_the_scene(ur5, tmp_path):
    """It is verified from its file, and only for checkers whose margins are no larger."""
    path = pp.JointPath([[0.0, -1.6, 1.0, 0, 0, 0], [0.3, -1.6, 1.0, 0, 0, 0]], ur5.joint_names)
    scene = pp.Scene([pp.Obstacle("ball", pp.Sphere(0.1), pp.pose((0.5, 0.1, 1.3)))])
    distance = pp.certify(path, pp.CollisionChecker(ur5, scene)).clearance
    for margin, status in ((0.5 * distance, "FREE"), (2.0 * distance + 0.5, "COLLIDING")):
        own = replace(scene, margins=[PairMargin((link, "ball"), margin) for link in ("forearm_link", "wrist_1_link")])
        checker = pp.CollisionChecker(ur5, own)
        certificate = pp.certify(path, checker, record=True)
        assert certificate.status.name == status
        if certificate.free:
            certificate.save(tmp_path / "m.proof.json")
            stated = json.loads((tmp_path / "m.proof.json").read_text())["settings"]["margins"]
            assert {(*sorted(pair), own) for *pair, own in stated} == {
                ("ball", "forearm_link", margin), ("ball", "wrist_1_link", margin)
            }  # fmt: skip
            assert pp.verify_proof(tmp_path / "m.proof.json", checker).ok
            wider = replace(scene, margins=[PairMargin(("forearm_link", "ball"), 1.1 * margin)])
            assert not pp.verify_proof(tmp_path / "m.proof.json", pp.CollisionChecker(ur5, wider)).ok
