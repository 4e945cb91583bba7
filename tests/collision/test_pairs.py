"""Which pairs of links are left out, how often links touch, and that no pair that touches at times is left out."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from itertools import combinations

import coal
import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.collision import sample_overlaps
from pinproof.collision.checking.links import AS_REQUESTED, DECOMPOSED, LinkBodies, Overlaps, link_bodies, meshes_of
from pinproof.collision.geometry.hulls import bvh
from pinproof.description import find_robot, read_srdf
from pinproof.description.srdf import DisabledPair, Srdf
from pinproof.errors import InputError

from .conftest import urdf_of

BAR = '<box size="0.2 0.02 0.02"/>'
CUBE = '<box size="0.04 0.04 0.04"/>'


def reasons(checker):
    return {frozenset(pair.owners): pair.reason for pair in checker.excluded}


def checked(checker):
    return {frozenset(checker.bodies[i].owner for i in pair) for pair in checker.pairs}


@pytest.fixture(scope="module")
def chain(arm_from_links):
    """Builds a chain of revolute joints about y, at equal steps (m) along x, without geometry but at both ends."""

    def build(joints: int, step: float, geometry: str = CUBE):
        links = {"base": geometry, **{f"empty_{i}": "" for i in range(1, joints)}, "last": geometry, "tip": ""}
        names = list(links)
        line = [
            (f"j{i}", "revolute", names[i], names[i + 1], f"{step if i else 0.03} 0 0", "0 1 0") for i in range(joints)
        ]
        return arm_from_links(links, [*line, ("end", "fixed", "last", "tip", "0.02 0 0", "1 0 0")]).arm(tcp="tip")

    return build


def boxes_apart(arm, q):
    """Metres between the boxes of base and last link, by coal on boxes placed by Pinocchio."""
    placed = [arm.frame_placement(q, link) for link in ("base", "last")]
    at = [coal.Transform3s(each.rotation, each.translation) for each in placed]
    box = coal.Box(0.04, 0.04, 0.04)
    return coal.distance(box, at[0], box, at[1], coal.DistanceRequest(), coal.DistanceResult())


def test_many_short_offsets_between_joints_are_not_a_link(chain):
    arm = chain(8, 0.05)
    curled = np.full(8, 0.864)
    assert boxes_apart(arm, curled) < -0.005
    checker = pp.CollisionChecker(arm)
    assert checked(checker) == {frozenset(("base", "last"))}
    assert not checker.is_free(curled)
    certificate = pp.certify(pp.JointPath(np.array([np.zeros(8), curled]), arm.joint_names), checker)
    assert certificate.status.name == "COLLIDING"
    assert certificate.first_contact.bodies == ("base", "last")


@pytest.mark.parametrize(("reach", "left_out"), [(0.05, False), (0.03, False), (0.004, False), (-0.02, True)])
def test_links_in_one_housing_are_left_out_only_if_they_touch_in_all_configurations(arm_from_links, reach, left_out):
    """A bar that starts at the wrist, and one that starts ``reach`` before it and meets the first when folded."""
    pair = frozenset(("fore", "hand"))
    arm = arm_from_links(
        {"fore": f"{BAR}@-0.1 0 0", "empty": "", "hand": f"{BAR}@{0.1 + reach} 0 0", "tip": ""},
        [
            ("j1", "revolute", "fore", "empty", "0.001 0 0", "0 1 0"),
            ("j2", "revolute", "empty", "hand", "0.001 0 0", "0 0 1"),
            ("end", "fixed", "hand", "tip", "1 0 0", "1 0 0"),
        ],
    ).arm(tcp="tip")
    checker = pp.CollisionChecker(arm)
    bar, met = coal.Box(0.2, 0.02, 0.02), []
    for q in np.random.default_rng(0).uniform(-7.0, 7.0, size=(300, 2)):
        placed = [arm.frame_placement(q, link) for link in ("fore", "hand")]
        placed = [placed[0] * pp.pose((-0.1, 0, 0)), placed[1] * pp.pose((0.1 + reach, 0, 0))]
        at = [coal.Transform3s(each.rotation, each.translation) for each in placed]
        met.append(coal.collide(bar, at[0], bar, at[1], coal.CollisionRequest(), coal.CollisionResult()) > 0)
        assert left_out or not (met[-1] and checker.is_free(q))
    assert (pair in reasons(checker)) == left_out == np.all(met)
    assert left_out or 0.02 < np.mean(met) < 1


def test_the_housing_is_a_setting_that_the_certificate_states(chain):
    arm = chain(2, 0.004, '<sphere radius="0.05"/>')
    assert arm.robot.size == pytest.approx(0.03 + 0.004 + 0.02)
    pair = frozenset(("base", "last"))
    assert checked(pp.CollisionChecker(arm)) == {pair}  # 5 % of 54 mm are less than 4 mm
    checker = pp.CollisionChecker(arm, housing=0.005)
    stay = pp.JointPath(np.zeros((2, 2)), arm.joint_names)
    (left_out,) = (each for each in pp.certify(stay, checker).excluded if frozenset(each.owners) == pair)
    assert left_out.reason == (
        "adjacent: only links without geometry between them (empty_1), joints 4 mm apart (one housing: at most 5 mm); "
        "in contact in all 2,000 sampled configurations"
    )
    assert pp.CollisionChecker(arm, housing=0.0).fingerprint() != checker.fingerprint()
    for wrong in (-0.1, np.nan):
        with pytest.raises(InputError, match="housing"):
            pp.CollisionChecker(arm, housing=wrong)


def test_an_object_attached_behind_links_without_geometry_is_checked(arm_from_links):
    """A robot whose wrist has no geometry: what it holds can reach the forearm."""
    arm = arm_from_links(
        {"root": '<box size="0.02 0.02 0.02"/>@-1 0 0', "fore": '<box size="0.4 0.04 0.04"/>@-0.2 0 0', "wrist": "",
         "flange": ""},
        [
            ("j1", "revolute", "root", "fore", "0.5 0 0", "0 0 1"),
            ("j2", "revolute", "fore", "wrist", "0 0 0", "0 1 0"),
            ("j3", "revolute", "wrist", "flange", "0 0 0", "1 0 0"),
        ],
    ).arm(tcp="flange")  # fmt: skip
    ball = pp.Obstacle("ball", pp.Sphere(0.03), pp.pose((0.15, 0, 0)))
    checker = pp.CollisionChecker(arm, attached=[ball])
    assert frozenset(("fore", "ball")) in checked(checker)
    assert checker.is_free([0.0, 0.0, 0.0])
    assert not checker.is_free([0.0, np.pi, 0.0])


def disabled(arm, *pairs):
    robot = replace(arm.robot, srdf=Srdf(disabled=tuple(DisabledPair(links, reason) for *links, reason in pairs)))
    return robot.arm(tcp=arm.tcp)


@pytest.mark.parametrize("reason", ["Default", "Adjacent", "Always", "User"])
def test_a_pair_that_an_srdf_disables_is_checked_where_it_touches_only_at_times(planar_2r, reason):
    arm = disabled(planar_2r, ("base", "fore", reason))
    rising = arm.robot
    checker = pp.CollisionChecker(arm)
    assert frozenset(("base", "fore")) in checked(checker)
    assert rising.srdf.disabled[0].reason == reason
    trusting = pp.CollisionChecker(arm, trust_disabled=True)
    assert reasons(trusting)[frozenset(("base", "fore"))] == f"SRDF: {reason}"


def test_a_disabled_pair_that_always_overlaps_is_left_out_with_its_share(arm_from_links):
    ball = '<sphere radius="0.1"/>'
    arm = arm_from_links(
        {"a": ball, "b": ball, "c": ball, "tip": ""},
        [
            ("j1", "revolute", "a", "b", "0 0 0.05", "1 0 0"),
            ("j2", "revolute", "b", "c", "0 0 0.05", "0 1 0"),
            ("end", "fixed", "c", "tip", "0 0 0", "1 0 0"),
        ],
    ).arm(tcp="tip")
    assert checked(pp.CollisionChecker(arm)) == {frozenset("ac")}
    checker = pp.CollisionChecker(disabled(arm, ("a", "c", "Default")))
    assert reasons(checker)[frozenset("ac")] == "SRDF: Default; in contact in all 2,000 sampled configurations"


# -- the shipped Panda ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def panda_meets(panda):
    """Returns the pairs of links of which exact meshes meet at q, but those that a joint joins or none moves."""
    shapes = triangles_of_links(panda, {each.link for each in panda.robot.urdf.collisions})
    apart = {frozenset((joint.parent, joint.child)) for joint in panda.robot.urdf.joints.values()}
    apart |= {frozenset(("panda_link7", "panda_hand")), frozenset(("panda_leftfinger", "panda_rightfinger"))}
    pairs = [pair for pair in combinations(sorted(shapes), 2) if frozenset(pair) not in apart]
    return lambda q: {pair for pair in pairs if triangles_meet(panda, shapes, pair, q)}


def test_exact_meshes_of_the_panda_meet_nowhere_where_it_is_free(panda, panda_meets):
    Q = np.random.default_rng(7).uniform(panda.limits.lower, panda.limits.upper, size=(200, 7))
    free, met = pp.CollisionChecker(panda).is_free_batch(Q), [bool(panda_meets(q)) for q in Q]
    assert not (free & met).any()
    assert np.mean(met) > 0.05  # so that the comparison says something
    assert np.mean(free) > 0.7


def test_the_default_pairs_of_the_panda_are_checked_except_its_fingers(panda):
    checker = pp.CollisionChecker(panda)
    assert {frozenset(("panda_link5", "panda_link7")), frozenset(("panda_link5", "panda_hand"))} <= checked(checker)
    fingers = reasons(checker)[frozenset(("panda_leftfinger", "panda_rightfinger"))]
    assert fingers == "SRDF: Default; no joint of the arm moves them relative to each other"
    assert checker.is_free(panda.home)


def test_a_motion_of_the_panda_into_its_own_hand_is_not_free(panda, panda_meets):
    Q = np.random.default_rng(1).uniform(panda.limits.lower, panda.limits.upper, size=(500, 7))
    goal = next(q for q in Q if panda_meets(q) == {("panda_hand", "panda_link5")})
    certificate = pp.certify(pp.JointPath(np.array([panda.home, goal]), panda.joint_names), pp.CollisionChecker(panda))
    assert certificate.status.name == "COLLIDING"


def test_excluded_pairs_are_never_reported_as_free(panda, slider):
    stay = pp.certify(pp.JointPath(np.array([panda.home, panda.home]), panda.joint_names), pp.CollisionChecker(panda))
    assert stay.free
    assert f"{len(stay.excluded)} pairs are excluded" in stay.message
    alone = pp.certify(pp.JointPath(np.array([[0.0], [1.0]]), slider.joint_names), pp.CollisionChecker(slider))
    assert alone.excluded == ()
    assert "excluded" not in alone.message


# -- hulls that are too coarse ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def open_ring(arm_from_links, mesh_file):
    """A rod that tilts in a ring about z of which one triangle is missing, and the ring's triangles in coal."""
    ring = trimesh.creation.torus(0.15, 0.05, 24, 12)
    ring.update_faces(np.arange(len(ring.faces)) > 0)
    arm = arm_from_links(
        {"ring": f'<mesh filename="{mesh_file(ring)}"/>', "cross": '<sphere radius="0.01"/>', "rod": BAR, "tip": ""},
        [
            ("j1", "revolute", "ring", "cross", "0 0 0", "0 1 0"),
            ("j2", "revolute", "cross", "rod", "0 0 0", "1 0 0"),
            ("end", "fixed", "rod", "tip", "0.1 0 0", "1 0 0"),
        ],
    ).arm(tcp="tip")
    triangles = bvh(np.array(ring.vertices), np.array(ring.faces))
    return disabled(arm, ("ring", "rod", "Default")), triangles


@pytest.mark.parametrize("link_meshes", ["hull", "mesh", "surface"])
def test_links_whose_hulls_always_overlap_are_checked_by_their_triangles_if_a_mesh_is_not_watertight(
    open_ring, path, link_meshes
):
    """The bar of 0.2 m reaches the inner radius of 0.1 m only at its corners: it touches where it lies in the ring."""
    arm, triangles = open_ring
    checker = pp.CollisionChecker(arm, link_meshes=link_meshes)
    assert frozenset(("ring", "rod")) in checked(checker)
    bar, place, met = coal.Box(0.2, 0.02, 0.02), coal.Transform3s.Identity(), []
    Q = np.random.default_rng(5).uniform(-np.pi, np.pi, size=(300, 2))
    for q in Q:
        rod = arm.frame_placement(q, "rod")
        rod_place = coal.Transform3s(rod.rotation, rod.translation)
        met.append(coal.collide(triangles, place, bar, rod_place, coal.CollisionRequest(), coal.CollisionResult()) > 0)
    assert 0.05 < np.mean(met) < 0.5
    assert (checker.is_free_batch(Q) == ~np.array(met)).all()
    upright = np.array([np.pi / 2, 0.0])
    proven = pp.certify(path(arm, upright - 0.3, upright + 0.3), checker)
    assert proven.free
    assert any("entirely inside is not detected" in note for note in proven.notes)
    met_at = Q[int(np.argmax(met))]
    certificate = pp.certify(path(arm, upright, met_at), checker)
    assert certificate.status.name == "COLLIDING"
    assert set(certificate.first_contact.bodies) == {"ring", "rod"}


def test_an_open_mesh_whose_hull_is_sometimes_apart_keeps_its_hull(arm_from_links, mesh_file):
    """A ball that enters the hole of an open ring: its triangles do not show whether the ball is inside."""
    ring = trimesh.creation.torus(0.15, 0.05, 24, 12)
    ring.update_faces(np.arange(len(ring.faces)) > 0)
    arm = arm_from_links(
        {"ring": f'<mesh filename="{mesh_file(ring)}"/>', "arm": "", "ball": '<sphere radius="0.02"/>', "tip": ""},
        [
            ("j1", "revolute", "ring", "arm", "0.3 0 0", "0 1 0"),
            ("j2", "revolute", "arm", "ball", "-0.3 0 0", "1 0 0"),
            ("end", "fixed", "ball", "tip", "0.1 0 0", "1 0 0"),
        ],
    ).arm(tcp="tip")
    checker = pp.CollisionChecker(disabled(arm, ("ring", "ball", "User")))
    assert checker.finer == ()
    assert not checker.is_free([0.0, 0.0])


@cache
def catalogue_checker(name):
    """The checker of a robot of the catalogue, for all tests that ask how often its links touch."""
    return pp.CollisionChecker(pp.load_robot(name).arm())


def triangles_of_links(arm, links):
    """The collision geometry of links in coal, with meshes as all of their triangles."""
    own = [each for each in arm.robot.urdf.collisions if each.link in links]
    return {
        link: [body for each in own if each.link == link for body in link_bodies(each, "surface")] for link in links
    }


def triangles_meet(arm, shapes, links, q):
    """Whether the triangles of two links meet at q, by coal and Pinocchio alone."""
    sides = [
        [(body.geometry, arm.frame_placement(q, link) * body.link_from_body) for body in shapes[link]] for link in links
    ]
    return any(
        coal.collide(
            one, coal.Transform3s(at.rotation, at.translation), other, coal.Transform3s(to.rotation, to.translation),
            coal.CollisionRequest(), coal.CollisionResult(),
        ) > 0
        for one, at in sides[0] for other, to in sides[1]
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pr2_left", "baxter_left", "romeo_left", "talos_left", "tiago_no_hand", "iiwa14"])
def test_a_pair_is_left_out_only_if_it_touches_in_all_configurations(name):
    """Every pair that is left out because of samples, against other samples and the triangles of the meshes."""
    checker = catalogue_checker(name)
    arm = checker.arm
    assert checker.is_free(arm.home)
    sampled = [pair.owners for pair in checker.excluded if "in contact in" in pair.reason]
    assert sampled or name == "pr2_left"
    shapes = triangles_of_links(arm, {link for links in sampled for link in links})
    Q = np.random.default_rng(11).uniform(*arm.limits.sampling_range(), size=(200, arm.dof))
    for links in sampled:
        assert all(triangles_meet(arm, shapes, links, q) for q in Q), links


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "links", "least", "most"),
    [
        ("romeo_left", ("torso", "LShoulderYawLink"), 0.05, 0.3),
        ("romeo_left", ("LWristRollLink", "l_wrist"), 0.8, 0.99),
        ("baxter_left", ("left_upper_shoulder", "left_upper_elbow"), 0.6, 0.85),
        ("pr2_left", ("l_shoulder_pan_link", "l_upper_arm_link"), 0.6, 0.9),
    ],
)
def test_links_that_touch_in_some_configurations_are_checked_there_although_an_srdf_disables_them(
    name, links, least, most
):
    checker = catalogue_checker(name)
    arm = checker.arm
    shapes = triangles_of_links(arm, links)
    Q = np.random.default_rng(3).uniform(*arm.limits.sampling_range(), size=(150, arm.dof))
    met = np.array([triangles_meet(arm, shapes, links, q) for q in Q])
    assert least < met.mean() < most
    pair = checker.pairs_of_owners(*links)
    touching = np.array([bool(set(pair) & set(checker._placed(q).contacts(q))) for q in Q])
    assert (touching >= met).all()
    assert np.mean(touching != met) < 0.02  # within the tolerance of coal's distances, or a body inside another


@pytest.mark.slow
def test_links_whose_hulls_overlap_and_whose_meshes_do_not_are_checked_by_their_meshes():
    finer = {frozenset(pair.owners): pair.by for pair in catalogue_checker("pr2_left").finer}
    assert finer[frozenset(("l_forearm_link", "l_gripper_palm_link"))] == "exact meshes"
    assert finer[frozenset(("l_upper_arm_link", "l_forearm_roll_link"))] == "several hulls"


WRIST = urdf_of(
    {
        "base": '<box size="0.1 0.1 0.1"/>',
        "fore": '<sphere radius="0.05"/>',
        "cross": '<sphere radius="0.06"/>',
        "hand": '<sphere radius="0.05"/>',
        "tip": "",
    },
    [
        ("j1", "revolute", "base", "fore", "0 0 0.4", "0 1 0"),
        ("j2", "revolute", "fore", "cross", "0 0 0.02", "1 0 0"),
        ("j3", "revolute", "cross", "hand", "0 0 0.02", "0 0 1"),
        ("end", "fixed", "hand", "tip", "0 0 0.1", "1 0 0"),
    ],
    name="wrist",
).replace('lower="-7" upper="7"', 'lower="-1.5" upper="1.5"')
"""A wrist whose housings overlap: fore and hand touch in every configuration."""


@pytest.fixture
def wrist(tmp_path):
    path = tmp_path / "wrist.urdf"
    path.write_text(WRIST)
    return path


def test_adjacent_and_always_touching_links_are_proposed_and_others_are_not(wrist):
    report = sample_overlaps(pp.load_robot(wrist), samples=100)
    assert {(frozenset(pair.links), pair.reason) for pair in report.proposed} == {
        (frozenset(("base", "fore")), "Adjacent"),
        (frozenset(("fore", "cross")), "Adjacent"),
        (frozenset(("cross", "hand")), "Adjacent"),
        (frozenset(("fore", "hand")), "Always"),
    }
    counts = {frozenset(pair.links): pair.touching for pair in report.pairs}
    assert counts[frozenset(("fore", "hand"))] == 100
    assert counts[frozenset(("base", "hand"))] == 0


def test_the_written_srdf_makes_the_home_free_and_keeps_the_other_pairs(wrist, tmp_path):
    arm = pp.load_robot(wrist).arm()
    assert not pp.CollisionChecker(arm).is_free(arm.home)
    sample_overlaps(arm.robot, samples=100).save_srdf(tmp_path / "wrist.srdf")
    arm = pp.load_robot(wrist, srdf=tmp_path / "wrist.srdf").arm()
    checker = pp.CollisionChecker(arm)
    assert checker.is_free(arm.home)
    assert {frozenset((checker.bodies[i].owner, checker.bodies[j].owner)) for i, j in checker.pairs} == {
        frozenset(("base", "cross")),
        frozenset(("base", "hand")),
    }


def test_groups_and_states_of_the_present_srdf_are_kept(wrist, tmp_path):
    (tmp_path / "own.srdf").write_text(
        '<robot name="wrist"><group name="arm"><chain base_link="base" tip_link="tip"/></group>'
        '<group_state name="up" group="arm"><joint name="j1" value="0.5"/></group_state>'
        '<disable_collisions link1="fore" link2="hand" reason="User"/></robot>'
    )
    robot = pp.load_robot(wrist, srdf=tmp_path / "own.srdf")
    sample_overlaps(robot, samples=50).save_srdf(tmp_path / "new.srdf")
    written = read_srdf(tmp_path / "new.srdf")
    assert written.groups["arm"].chains == (("base", "tip"),)
    assert written.states[0].joints == {"j1": (0.5,)}
    reasons = [pair.reason for pair in written.disabled if set(pair.links) == {"fore", "hand"}]
    assert reasons == ["User"]
    assert sum(pair.reason == "Adjacent" for pair in written.disabled) == 3


def test_links_whose_hulls_touch_and_meshes_do_not_are_counted_by_their_meshes():
    """The hulls of forearm and wrists of the UR5 overlap far more often than the links."""
    report = sample_overlaps(pp.load_robot("ur5"), samples=200)
    pairs = {frozenset(pair.links): pair for pair in report.pairs}
    forearm = pairs[frozenset(("forearm_link", "wrist_2_link"))]
    assert forearm.geometry != "collision model"
    assert forearm.frequency == "sometimes"
    assert forearm.disabled == "without a reason"
    assert {pair.reason for pair in report.proposed} == {"Adjacent"}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["talos_left", "tiago_no_hand"])
def test_the_overlaps_of_the_catalogue_touch_in_every_sample(name):
    entry = find_robot(name)
    report = sample_overlaps(pp.load_robot(entry.urdf, srdf=entry.srdf), samples=50)
    always = {frozenset(pair.links) for pair in report.proposed if pair.reason == "Always"}
    assert {frozenset(pair) for pair in entry.overlaps} <= always


def test_a_start_in_self_collision_names_the_command(wrist):
    arm = pp.load_robot(wrist).arm()
    plan = pp.RrtConnect().plan(pp.CollisionChecker(arm), arm.home, arm.home + 0.1, rng=0)
    assert plan.status is pp.planning.PlanStatus.START_INVALID
    assert "info ROBOT --overlaps" in plan.message
    with pytest.raises(pp.InputError, match="info ROBOT --overlaps"):
        pp.validate_picks(arm, pp.Scene(), [pp.Pick("a", pp.pose((0, 0, 0.5)))])


def test_a_start_at_which_links_touch_that_touch_in_most_configurations_states_their_share(arm_from_links):
    bar = '<box size="0.2 0.02 0.02"/>'
    arm = arm_from_links(
        {"fore": f"{bar}@-0.1 0 0", "empty": "", "hand": f"{bar}@0.104 0 0", "tip": ""},
        [
            ("j1", "revolute", "fore", "empty", "0.001 0 0", "0 1 0"),
            ("j2", "revolute", "empty", "hand", "0.001 0 0", "0 0 1"),
            ("end", "fixed", "hand", "tip", "1 0 0", "1 0 0"),
        ],
    ).arm(tcp="tip")
    start = np.array([0.0, 2.0])
    message = pp.RrtConnect().plan(pp.CollisionChecker(arm), start, arm.home, rng=0).message
    share = re.search(r"fore and hand in contact in (\d+) of 200 ", message)
    assert share is not None
    assert 180 < int(share[1]) < 200
    assert "allowed_contacts" in message


def test_contact_with_an_obstacle_at_home_gives_no_hint_of_an_srdf():
    arm = pp.load_robot("ur5").arm()
    scene = pp.Scene([pp.Obstacle("block", pp.Box(2, 2, 2))])
    plan = pp.RrtConnect().plan(pp.CollisionChecker(arm, scene), arm.home, arm.home + 0.1, rng=0)
    assert plan.status is pp.planning.PlanStatus.START_INVALID
    assert "--overlaps" not in plan.message


def test_the_command_lists_the_pairs_and_writes_both_files(wrist, tmp_path, monkeypatch, capsys):
    from pinproof.cli.main import main

    monkeypatch.chdir(tmp_path)

    def run(*words: str) -> tuple[int, str]:
        monkeypatch.setattr("sys.argv", ["pinproof", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        return int(ended.value.code or 0), capsys.readouterr().out

    code, out = run("info", "wrist.urdf", "--samples", "50", "--write-srdf", "new.srdf", "--write-urdf", "new.urdf")
    assert code == 0
    assert "exclude: Always" in out
    assert run("check", "new.urdf", "--srdf", "new.srdf")[0] == 0
    code, out = run("info", "wrist.urdf", "--overlaps", "--samples", "50", "--json")
    found = json.loads(out)
    assert (code, found["samples"], len(found["pairs"])) == (0, 50, 6)
    assert run("info", "wrist.urdf", "--overlaps", "--write-urdf", "wrist.urdf")[0] == 2


def test_few_samples_are_refused_because_chance_contacts_would_be_excluded() -> None:
    """In a single configuration of the Panda, link 1 and link 7 touch by chance."""
    with pytest.raises(pp.InputError, match="samples"):
        sample_overlaps(pp.load_robot("panda"), samples=1)


@pytest.mark.parametrize(("form", "level"), [("bar", AS_REQUESTED), ("angle", DECOMPOSED)])
def test_a_pair_is_checked_with_the_coarsest_bodies_that_touch_about_as_often_as_the_meshes(
    arm_from_links, mesh_file, form, level
):
    """A mesh turns about z past a block: a bar is its hull, an angle consists of two bars."""
    bars = [trimesh.creation.box((0.6, 0.04, 0.1)).apply_translation((0.28, 0, 0))]
    bars.append(trimesh.creation.box((0.04, 0.6, 0.1)).apply_translation((0, 0.28, 0)))
    mesh = {"bar": bars[0], "angle": trimesh.boolean.union(bars, engine="manifold")}[form]
    block, xyz = trimesh.creation.box((0.1, 0.2, 0.1)), "0.25 0 0"
    robot = arm_from_links(
        {
            "base": f'<mesh filename="{mesh_file(block)}"/>@{xyz}',
            "hand": f'<mesh filename="{mesh_file(mesh)}"/>',
        },
        [("turn", "continuous", "base", "hand", "0 0 0", "0 0 1")],
    )
    links = LinkBodies(robot.urdf.collisions, meshes_of(robot.urdf.links, "hull"))
    found = Overlaps(robot, links).of("base", "hand")
    assert found.level == level
