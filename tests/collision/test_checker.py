"""The checker: what is checked, what is left out and why, and that answers agree."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import product

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh

import pinproof as pp
from pinproof.collision.checking.placed_bodies import GJK_SLACK


def reasons(checker) -> dict[frozenset[str], str]:
    return {frozenset(pair.owners): pair.reason for pair in checker.excluded}


def checked(checker) -> set[frozenset[str]]:
    return {frozenset((checker.bodies[i].owner, checker.bodies[j].owner)) for i, j in checker.pairs}


def random_q(arm, count, seed=0):
    lower, upper = arm.limits.sampling_range()
    return np.random.default_rng(seed).uniform(np.maximum(lower, -np.pi), np.minimum(upper, np.pi), (count, arm.dof))


def test_the_base_is_checked_against_the_scene(ur5):
    """Pinocchio's addAllCollisionPairs leaves such pairs out, since neither moves."""
    model = pin.GeometryModel()
    for name in ("base", "table"):
        model.addGeometryObject(pin.GeometryObject(name, 0, 0, pin.SE3.Identity(), coal.Box(1, 1, 1)))
    model.addAllCollisionPairs()
    assert len(model.collisionPairs) == 0  # the trap
    through_base = pp.Scene([pp.Obstacle("table", pp.Box(1, 1, 0.05), pp.pose((0, 0, 0.02)))])
    contacts = pp.CollisionChecker(ur5, through_base).check(ur5.home).contacts
    assert ("base_link", "table") in [contact.bodies for contact in contacts]
    standing = pp.Scene(through_base.obstacles, allowed=[("base_link", "table")])
    checker = pp.CollisionChecker(ur5, standing)
    assert ("base_link", "table") not in [contact.bodies for contact in checker.check(ur5.home).contacts]
    assert reasons(checker)[frozenset(("base_link", "table"))] == "allowed by the scene"


def test_obstacles_are_never_checked_against_each_other(slider):
    pile = [pp.Obstacle(f"can_{i}", pp.Sphere(0.1), pp.pose((1, 0, 0.01 * i))) for i in range(4)]
    checker = pp.CollisionChecker(slider, pp.Scene(pile))
    assert checker.is_free([0.0])
    assert len(checker.pairs) == 4
    assert checker.excluded == ()


def test_a_wrong_configuration_is_refused_and_names_the_joints(ur5):
    checker = pp.CollisionChecker(ur5)
    bent = np.array([0.0, -1.5, 1.0, 0.0, 0.0, 0.0])
    for q in (
        np.zeros(5),
        np.zeros((1, 6)),
        "home",
        *(np.where(np.eye(6)[3], bad, bent) for bad in (np.nan, np.inf, -np.inf)),
    ):
        asks = [checker.is_free, checker.check, checker.clearance]
        for ask in (*asks, *([checker.is_free_unchecked] if np.shape(q) == (6,) else [])):
            with pytest.raises(pp.InputError, match="shoulder_pan_joint"):
                ask(q)
    assert checker.is_free(bent)  # and nothing is left behind of it


def test_names_that_clash_or_do_not_exist_are_refused(ur5):
    for name in ("forearm_link", "forearm_link_0", "tool0"):
        with pytest.raises(pp.InputError, match=name):
            pp.CollisionChecker(ur5, pp.Scene([pp.Obstacle(name, pp.Sphere(0.1))]))
    with pytest.raises(pp.InputError, match="'tool'"):
        pp.CollisionChecker(
            ur5, pp.Scene([pp.Obstacle("tool", pp.Sphere(0.1))]), attached=[pp.Obstacle("tool", pp.Sphere(0.1))]
        )
    for allowed in ([("forearm", "wrist_3_link")], [("wrist_3_link", "tabel")]):
        with pytest.raises(pp.UnknownNameError, match="allowed by the caller"):
            pp.CollisionChecker(ur5, allowed=allowed)
    with pytest.raises(pp.UnknownNameError, match="hull"):
        pp.CollisionChecker(ur5, link_meshes="convex")


@pytest.mark.parametrize("tcp", ["tool0", "wrist_3_link"])
def test_a_tool_or_obstacle_with_the_name_of_a_link_is_refused_whatever_its_shape(ur5, tcp):
    """It would be taken for a part of the link: the pairs that may touch by design would not be checked."""
    two = trimesh.util.concatenate([trimesh.creation.box((0.03, 0.03, 0.3)), trimesh.creation.box((0.2, 0.03, 0.03))])
    pieces = pp.Mesh.from_arrays(two.vertices, two.faces)  # its bodies have names of their own
    arm = ur5.robot.arm(tcp=tcp)
    for shape, name in product((pp.Box(0.03, 0.03, 0.6), pieces), (tcp, "forearm_link")):
        thing = pp.Obstacle(name, shape, pp.pose((0, 0, 0.3)))
        for make in (
            lambda thing=thing: pp.CollisionChecker(arm, attached=[thing]),
            lambda thing=thing: pp.CollisionChecker(arm).with_attached(thing),
            lambda thing=thing: pp.CollisionChecker(arm, pp.Scene([thing])),
        ):
            with pytest.raises(pp.InputError, match=f"two bodies have the name '{name}'"):
                make()


@pytest.mark.parametrize("name", ["ur5", "panda", "generic_6dof"])
@pytest.mark.parametrize("margin", [0.0, 0.01])
def test_the_three_questions_agree(request, name, margin):
    arm = request.getfixturevalue(name)
    scene = pp.Scene(
        [
            pp.Obstacle("table", pp.Box(2, 2, 0.1), pp.pose((0, 0, -0.2))),
            pp.Obstacle("b", pp.Sphere(0.2), pp.pose((0.5, 0, 0.4))),
        ]
    )
    checker = pp.CollisionChecker(arm, scene, margin=margin)
    verdicts = []
    for q in random_q(arm, 150):
        clearance, result = checker.clearance(q), checker.check(q)
        verdicts.append(checker.is_free(q))
        if not margin < clearance <= margin + 2 * GJK_SLACK:  # inside that sliver "no" is said to be safe
            assert verdicts[-1] == result.free == (clearance > margin)
        if result.contacts:
            deepest = result.contacts[0]
            assert deepest.distance == clearance
            gap = deepest.points[1] - deepest.points[0]
            assert np.linalg.norm(gap) == pytest.approx(abs(deepest.distance), abs=1e-5)
            np.testing.assert_allclose(gap, deepest.distance * deepest.normal, atol=1e-5)
    assert 0 < sum(verdicts) < len(verdicts)


@pytest.mark.parametrize("name", ["ur5", "panda", "generic_6dof"])
def test_distances_agree_with_the_oracle(request, oracle, name):
    arm = request.getfixturevalue(name)
    scene = pp.Scene([pp.Obstacle("box", pp.Box(0.2, 0.3, 0.4), pp.pose((0.5, 0.2, 0.3), (0.3, 0.2, 0.1)))])
    checker = pp.CollisionChecker(
        arm, scene, attached=[pp.Obstacle("tool", pp.Box(0.02, 0.02, 0.1), pp.pose((0, 0, 0.06)))]
    )
    independent = oracle(checker)
    for q in random_q(arm, 12):
        expected, space = independent.distances(q), checker._placed(arm.configuration(q))
        for k, distance in enumerate(expected):
            ours = space.measure(k)
            if distance > 0 or ours.distance > 0:
                # inside a hull the oracle sees nothing
                assert ours.distance == pytest.approx(distance, abs=1e-6) or ours.distance < 0
                assert ours.proven <= distance + 1e-9


@pytest.mark.parametrize("count", [1, 4, 7, 31, 32, 33])
@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_few_obstacles_in_a_row_and_many_in_a_tree_give_equal_answers(request, name, count):
    arm = request.getfixturevalue(name)
    rng = np.random.default_rng(count)
    shapes = [pp.Box(*rng.uniform(0.02, 0.5, 3)) if k % 3 else pp.Sphere(radius=0.1) for k in range(count)]
    places = [pp.pose(rng.uniform([-0.9, -0.9, 0.0], [0.9, 0.9, 1.2]), rpy=rng.uniform(-3, 3, 3)) for _ in shapes]
    near = [pp.Obstacle(f"near_{k}", *both) for k, both in enumerate(zip(shapes, places, strict=True))]
    far = [pp.Obstacle(f"far_{k}", pp.Box(0.1, 0.1, 0.1), pp.pose((50 + k, 0, 0))) for k in range(40)]
    few, many = (pp.CollisionChecker(arm, pp.Scene(each), margin=0.003) for each in (near, near + far))
    lower, upper = arm.limits.sampling_range()
    q = rng.uniform(lower, upper, (200, arm.dof))
    free = few.is_free_batch(q)
    assert free.any() or count > 4
    assert free.sum() < len(q)
    assert free.tolist() == many.is_free_batch(q).tolist() == [few.is_free(each) for each in q]
    for each, is_free in zip(q[:40], free, strict=False):
        # the other questions begin each pair elsewhere, and agree
        assert [contact.bodies for contact in few.check(each).contacts] == [c.bodies for c in many.check(each).contacts]
        assert bool(few.check(each).contacts) != is_free
        assert few.clearance(each) == many.clearance(each)


def test_threads_get_equal_answers(ur5):
    checker = pp.CollisionChecker(ur5, pp.Scene([pp.Obstacle("ball", pp.Sphere(0.2), pp.pose((0.5, 0, 0.4)))]))
    many = random_q(ur5, 400)
    alone = [checker.clearance(q) for q in many]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(checker.clearance, many)) == alone


def test_another_setting_is_another_fingerprint(ur5):
    scene = pp.Scene([pp.Obstacle("ball", pp.Sphere(0.2), pp.pose((0.5, 0, 0.4)))])
    variants = [
        pp.CollisionChecker(ur5, scene),
        pp.CollisionChecker(ur5, scene, margin=1e-3),
        pp.CollisionChecker(ur5, scene, link_meshes="mesh"),
        pp.CollisionChecker(ur5, scene, trust_disabled=True),
        pp.CollisionChecker(ur5, scene, allowed=[("base_link", "ball")]),
        pp.CollisionChecker(ur5, scene, attached=[pp.Obstacle("tool", pp.Sphere(0.01))]),
        pp.CollisionChecker(ur5, pp.Scene([pp.Obstacle("ball", pp.Sphere(0.21), pp.pose((0.5, 0, 0.4)))])),
        pp.CollisionChecker(ur5, pp.Scene([pp.Obstacle("ball", pp.Sphere(0.2), pp.pose((0.5, 0, 0.41)))])),
    ]
    prints = [checker.fingerprint() for checker in variants]
    assert len(set(prints)) == len(prints)
    assert pp.CollisionChecker(ur5, scene).fingerprint() == prints[0]


def test_never_pairs_are_checked_unless_trusted(panda):
    never = {frozenset(pair.links) for pair in panda.robot.srdf.disabled if pair.reason == "Never"}
    other = {frozenset(pair.links): pair.reason for pair in panda.robot.srdf.disabled if pair.reason != "Never"}
    careful, trusting = pp.CollisionChecker(panda), pp.CollisionChecker(panda, trust_disabled=True)
    solid = {body.owner for body in careful.bodies}
    never = {pair for pair in never if pair <= solid}
    assert len(never) > 10
    assert never <= checked(careful)
    assert not never & checked(trusting)
    assert all(reasons(trusting)[pair] == "SRDF: Never" for pair in never)
    for pair, reason in other.items():
        if pair <= solid:
            assert reasons(trusting)[pair] == f"SRDF: {reason}"
            assert (pair in checked(careful)) == ("panda_link5" in pair and reason == "Default")


def test_pairs_disabled_without_a_reason_are_checked_unless_trusted(ur5):
    """The SRDF of the UR5 disables the forearm against the wrist, which do meet."""
    pair = frozenset(("forearm_link", "wrist_3_link"))
    assert pair in {frozenset(disabled.links) for disabled in ur5.robot.srdf.disabled if not disabled.reason}
    careful, trusting = pp.CollisionChecker(ur5, link_meshes="mesh"), pp.CollisionChecker(ur5, trust_disabled=True)
    assert pair in checked(careful)
    assert reasons(trusting)[pair] == "SRDF: disabled without a reason"
    found = set()
    for q in np.random.default_rng(0).uniform(*ur5.limits.sampling_range(), size=(60, 6)):
        found |= {frozenset(contact.bodies) for contact in careful.check(q).contacts}
    assert pair in found


def test_an_allowed_collision_matrix_is_used_only_on_request(ur5):
    pair = ("base_link", "wrist_3_link")
    scene = pp.Scene(disabled=[pair])
    assert frozenset(pair) in checked(pp.CollisionChecker(ur5, scene))
    trusting = pp.CollisionChecker(ur5, scene, trust_disabled=True)
    assert reasons(trusting)[frozenset(pair)] == "scene: disabled without a reason"


def test_a_body_allowed_to_touch_itself_is_refused(ur5):
    scene = pp.Scene([pp.Obstacle("ball", pp.Sphere(0.1))])
    with pytest.raises(pp.InputError, match="'ball' twice"):
        pp.CollisionChecker(ur5, scene, allowed=[("ball", "ball")])
    with pytest.raises(pp.InputError, match="names 'ball' twice"):
        pp.Scene(scene.obstacles, allowed=[("ball", "ball")])


@pytest.mark.parametrize("name", ["ur5", "panda", "generic_6dof"])
def test_every_pair_of_links_is_either_checked_or_listed(request, name):
    checker = pp.CollisionChecker(request.getfixturevalue(name))
    owners = sorted({body.owner for body in checker.bodies})
    everything = {frozenset((a, b)) for a in owners for b in owners if a != b}
    assert checked(checker) | set(reasons(checker)) == everything
    assert not checked(checker) & set(reasons(checker))
    assert all(reasons(checker).values())


def test_adjacency_reaches_across_links_without_geometry(arm_from_links):
    ball, turn = '<sphere radius="0.1"/>', ("0 0 0.05", "1 0 0")
    robot = arm_from_links(
        {"a": ball, "empty": "", "b": ball, "c": ball, "tip": ""},
        [
            ("j1", "revolute", "a", "empty", *turn),
            ("j2", "revolute", "empty", "b", "0 0 0.005", "0 1 0"),
            ("j3", "revolute", "b", "c", *turn),
            ("end", "fixed", "c", "tip", *turn),
        ],
    )
    checker = pp.CollisionChecker(robot.arm(tcp="tip"))
    assert checked(checker) == {frozenset("ac")}
    assert reasons(checker) == {
        frozenset("ab"): "adjacent: only links without geometry between them (empty), joints 5 mm apart "
        "(one housing: at most 7.75 mm); in contact in all 2,000 sampled configurations",
        frozenset("bc"): "adjacent: joined by a joint",
    }
    assert not checker.is_free(np.zeros(3))


def test_a_wall_beside_a_carriage_on_an_empty_root_is_checked(arm_from_links):
    ball, still, limit = '<sphere radius="0.1"/>', "0 0 0", '<limit lower="-1" upper="1" velocity="1" effort="1"/>'
    robot = arm_from_links(
        {"world": "", "wall": '<box size="0.1 1 1"/>@0.5 0 0', "carriage": ball, "bed": '<box size="3 1 0.1"/>'},
        [
            ("fix", "fixed", "world", "wall", still, "1 0 0"),
            ("lay", "fixed", "world", "bed", still, "1 0 0"),
            ("rail", "prismatic", "world", "carriage", still, "1 0 0", limit),
        ],
    )
    checker = pp.CollisionChecker(robot.arm(tcp="carriage"))
    assert checked(checker) == {frozenset(("wall", "carriage"))}
    assert not checker.is_free([0.5])
    sampled = "adjacent: joined by a joint; in contact in all 2,000 sampled configurations"
    assert reasons(checker)[frozenset(("carriage", "bed"))] == sampled


def test_a_tool_on_a_link_without_geometry_is_checked_against_the_link_before(arm_from_links):
    joint = ("bend", "revolute", "arm", "hand", "0 0 0.5", "0 1 0")
    robot = arm_from_links({"arm": '<box size="0.05 0.05 0.4"/>@0 0 0.2', "hand": ""}, [joint])
    rod = pp.Obstacle("rod", pp.Box(0.02, 0.02, 0.3), pp.pose((0, 0, 0.16)))
    checker = pp.CollisionChecker(robot.arm(tcp="hand"), attached=[rod])
    assert checked(checker) == {frozenset(("arm", "rod"))}
    assert checker.is_free([0.0])
    assert not checker.is_free([3.1])


@pytest.mark.parametrize("kinds", [("prismatic", "revolute"), ("revolute", "prismatic")])
def test_links_on_both_sides_of_an_empty_prismatic_link_are_not_adjacent(arm_from_links, kinds):
    robot = arm_from_links(
        {"rail": '<sphere radius="0.05"/>@1.3 0 0', "empty": "", "bar": '<box size="0.5 0.02 0.02"/>', "tip": ""},
        [
            ("j1", kinds[0], "rail", "empty", "0 0 0", "1 0 0"),
            ("j2", kinds[1], "empty", "bar", "0 0 0", "1 0 0"),
            ("end", "fixed", "bar", "tip", "0 0 0", "1 0 0"),
        ],
    )
    checker = pp.CollisionChecker(robot.arm(tcp="tip"))
    assert checked(checker) == {frozenset(("rail", "bar"))}
    out = np.array([1.2 if kind == "prismatic" else 0.0 for kind in kinds])
    assert checker.is_free(np.zeros(2))
    assert not checker.is_free(out)


BALL = '<sphere radius="0.01"/>'


@pytest.mark.parametrize(
    ("first", "second", "ends"),
    [
        (("a", "empty", "0 0 0.3"), ("empty", "b", "0 0 0.3"), "a link of some length"),
        (("empty", "a", "0 0.02 0"), ("empty", "b", "0 -0.02 0"), "two fingers of a palm"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_adjacency_does_not_reach_across_an_empty_link(arm_from_links, first, second, ends):
    root = "a" if "length" in ends else "empty"
    links = {root: "", "a": BALL, "empty": "", "b": BALL}
    joints = [(f"j{k}", "revolute", *each, "1 0 0") for k, each in enumerate((first, second))]
    robot = arm_from_links(links | {"a": BALL}, joints)
    assert checked(pp.CollisionChecker(robot.arm(tcp="b"))) == {frozenset("ab")}


def test_an_attached_object_collides_and_is_listed(ur5):
    tool = pp.Obstacle("gripper", pp.Box(0.02, 0.02, 0.3), pp.pose((0, 0, 0.16)))
    below = ur5.forward_kinematics(ur5.home) * pp.pose((0, 0, 0.25))
    scene = pp.Scene([pp.Obstacle("part", pp.Sphere(0.03), below)])
    assert pp.CollisionChecker(ur5, scene).is_free(ur5.home)
    checker = pp.CollisionChecker(ur5, scene, attached=[tool])
    assert [contact.bodies for contact in checker.check(ur5.home).contacts] == [("gripper", "part")]
    assert reasons(checker)[frozenset(("wrist_3_link", "gripper"))].startswith("rigid")
    assert {frozenset(("gripper", link)) for link in ("wrist_2_link", "forearm_link", "base_link")} <= checked(checker)
    allowing = pp.CollisionChecker(ur5, scene, attached=[tool], allowed=[("gripper", "part")])
    assert allowing.is_free(ur5.home)
    assert reasons(allowing)[frozenset(("gripper", "part"))] == "allowed by the caller"


def test_a_pair_is_begun_where_its_bodies_are_apart_and_not_where_they_were_last(panda):
    """Bodies with one joint between them: the direction found at q = 0, kept with the pair, in the first's frame."""
    checker = pp.CollisionChecker(panda)
    owners = [tuple(checker.bodies[i].owner for i in pair) for pair in checker.pairs]
    k = owners.index(("panda_link6", "panda_hand"))
    begin = checker.world.first_directions
    space = checker._placed(np.zeros(7))
    i = checker.pairs[k][0]
    np.testing.assert_allclose(space.root_from_body(i)[:3, :3] @ begin[k], space.measure(k).normal, atol=1e-9)
    begun = [any(row) for row in begin]
    assert 0 < sum(begun) < len(checker.pairs)


@pytest.mark.parametrize("hull", [False, True])
def test_a_certificate_observes_the_distance_of_bodies_that_no_joint_moves(arm_from_links, mesh_file, path, hull):
    arm = arm_from_links(
        {"root": '<box size="0.1 0.1 0.1"/>', "ball": '<sphere radius="0.01"/>@0 5 0'},
        [("slide", "prismatic", "root", "ball", "0 0 0", "1 0 0")],
    ).arm(tcp="ball")
    post = pp.Mesh(mesh_file(trimesh.creation.box((0.1, 0.1, 0.1))), hull=hull)
    checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("post", post, pp.pose((0.15, 0, 0)))]))
    certificate = pp.certify(path(arm, [0.0], [0.2]), checker)
    assert certificate.free
    assert 0.0499 < certificate.clearance <= certificate.observed == pytest.approx(0.05, abs=1e-5)
    assert checker.clearance([0.0]) == pytest.approx(0.05, abs=1e-5)


def test_many_contacts_are_stated_by_the_nearest_of_each_pair() -> None:
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    found = pp.CollisionChecker(arm, margin=2.0).check(arm.home)
    pairs = {contact.bodies for contact in found.contacts}
    assert len(pairs) < len(found.contacts)  # a link is several bodies
    *stated, last = str(found).split("; ")
    assert last == f"... ({len(pairs)} pairs in all)"
    assert len(stated) == 6
    nearest = {}
    for contact in found.contacts:
        nearest.setdefault(contact.bodies, str(contact))
    assert stated == list(nearest.values())[:6]
