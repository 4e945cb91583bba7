"""Which pairs of links are left out, and that none is left out that could touch in only some configurations."""

from __future__ import annotations

from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh

from pinproof import CollisionChecker, JointPath, Obstacle, Sphere, certify, load_robot, pose
from pinproof.description.meshes import read_mesh, resolved
from pinproof.description.srdf import DisabledPair, Srdf
from pinproof.errors import InputError

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
    checker = CollisionChecker(arm)
    assert checked(checker) == {frozenset(("base", "last"))}
    assert not checker.is_free(curled)
    certificate = certify(JointPath(np.array([np.zeros(8), curled]), arm.joint_names), checker)
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
    checker = CollisionChecker(arm)
    bar, met = coal.Box(0.2, 0.02, 0.02), []
    for q in np.random.default_rng(0).uniform(-7.0, 7.0, size=(300, 2)):
        placed = [arm.frame_placement(q, link) for link in ("fore", "hand")]
        placed = [placed[0] * pose((-0.1, 0, 0)), placed[1] * pose((0.1 + reach, 0, 0))]
        at = [coal.Transform3s(each.rotation, each.translation) for each in placed]
        met.append(coal.collide(bar, at[0], bar, at[1], coal.CollisionRequest(), coal.CollisionResult()) > 0)
        assert left_out or not (met[-1] and checker.is_free(q))
    assert (pair in reasons(checker)) == left_out == np.all(met)
    assert left_out or 0.02 < np.mean(met) < 1


def test_the_housing_is_a_setting_that_the_certificate_states(chain):
    arm = chain(2, 0.004, '<sphere radius="0.05"/>')
    assert arm.robot.size == pytest.approx(0.03 + 0.004 + 0.02)
    pair = frozenset(("base", "last"))
    assert checked(CollisionChecker(arm)) == {pair}  # 5 % of 54 mm are less than 4 mm
    checker = CollisionChecker(arm, housing=0.005)
    stay = JointPath(np.zeros((2, 2)), arm.joint_names)
    (left_out,) = (each for each in certify(stay, checker).excluded if frozenset(each.owners) == pair)
    assert left_out.reason == (
        "adjacent: only links without geometry between them (empty_1), joints 4 mm apart (one housing: at most 5 mm); "
        "in contact in all 2,000 sampled configurations"
    )
    assert CollisionChecker(arm, housing=0.0).fingerprint() != checker.fingerprint()
    for wrong in (-0.1, np.nan):
        with pytest.raises(InputError, match="housing"):
            CollisionChecker(arm, housing=wrong)


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
    ball = Obstacle("ball", Sphere(0.03), pose((0.15, 0, 0)))
    checker = CollisionChecker(arm, attached=[ball])
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
    checker = CollisionChecker(arm)
    assert frozenset(("base", "fore")) in checked(checker)
    assert rising.srdf.disabled[0].reason == reason
    trusting = CollisionChecker(arm, trust_disabled=True)
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
    assert checked(CollisionChecker(arm)) == {frozenset("ac")}
    checker = CollisionChecker(disabled(arm, ("a", "c", "Default")))
    assert reasons(checker)[frozenset("ac")] == "SRDF: Default; in contact in all 2,000 sampled configurations"


# -- the shipped Panda ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def panda_meshes(panda):
    """The collision geometry of each link, meshes as all of their triangles."""
    shapes = {}
    for each in panda.robot.urdf.collisions:
        if each.kind == "mesh":
            mesh = read_mesh(resolved(each.mesh, each.link), each.size)
            shape = coal.BVHModelOBBRSS()
            shape.beginModel(len(mesh.triangles), len(mesh.vertices))
            shape.addVertices(np.asarray(mesh.vertices, dtype=float))
            shape.addTriangles(np.asarray(mesh.triangles, dtype=np.int64))
            shape.endModel()
        else:
            shape = {"box": coal.Box, "sphere": coal.Sphere, "cylinder": coal.Cylinder}[each.kind](*each.size)
        shapes.setdefault(each.link, []).append((shape, pin.SE3(np.array(each.origin))))
    return shapes


def meshes_meet(panda, meshes, q):
    """The pairs of links of which exact meshes meet at q, by coal, but those that a joint joins or none moves."""
    joints = panda.robot.urdf.joints.values()
    joined = {frozenset((joint.parent, joint.child)) for joint in joints}
    rigid = [{"panda_link7", "panda_hand"}, {"panda_leftfinger", "panda_rightfinger"}]
    links, placed = sorted(meshes), {}
    for link in links:
        at = panda.frame_placement(q, link)
        placed[link] = [
            (shape, coal.Transform3s((at * own).rotation, (at * own).translation)) for shape, own in meshes[link]
        ]
    meet = set()
    for k, a in enumerate(links):
        for b in links[k + 1 :]:
            if frozenset((a, b)) in joined or {a, b} in rigid:
                continue
            if any(
                coal.collide(*one, *other, coal.CollisionRequest(), coal.CollisionResult())
                for one in placed[a]
                for other in placed[b]
            ):
                meet.add((a, b))
    return meet


def test_exact_meshes_of_the_panda_meet_nowhere_where_it_is_free(panda, panda_meshes):
    checker = CollisionChecker(panda)
    Q = np.random.default_rng(7).uniform(panda.limits.lower, panda.limits.upper, size=(400, 7))
    free = checker.is_free_batch(Q)
    met = [bool(meshes_meet(panda, panda_meshes, q)) for q in Q]
    assert not (free & met).any()
    assert np.mean(met) > 0.05  # so that the comparison says something
    assert np.mean(free) > 0.7


def test_the_default_pairs_of_the_panda_are_checked_except_its_fingers(panda):
    checker = CollisionChecker(panda)
    assert {frozenset(("panda_link5", "panda_link7")), frozenset(("panda_link5", "panda_hand"))} <= checked(checker)
    fingers = reasons(checker)[frozenset(("panda_leftfinger", "panda_rightfinger"))]
    assert fingers == "SRDF: Default; no joint of the arm moves them relative to each other"
    assert checker.is_free(panda.home)


def test_a_motion_of_the_panda_into_its_own_hand_is_not_free(panda, panda_meshes):
    checker = CollisionChecker(panda)
    rng, goal = np.random.default_rng(1), None
    for q in rng.uniform(panda.limits.lower, panda.limits.upper, size=(500, 7)):
        if meshes_meet(panda, panda_meshes, q) == {("panda_hand", "panda_link5")}:
            goal = q
            break
    certificate = certify(JointPath(np.array([panda.home, goal]), panda.joint_names), checker)
    assert certificate.status.name == "COLLIDING"


def test_excluded_pairs_are_never_reported_as_free(panda, slider):
    stay = certify(JointPath(np.array([panda.home, panda.home]), panda.joint_names), CollisionChecker(panda))
    assert stay.free
    assert f"{len(stay.excluded)} pairs are excluded" in stay.message
    alone = certify(JointPath(np.array([[0.0], [1.0]]), slider.joint_names), CollisionChecker(slider))
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
    triangles = coal.BVHModelOBBRSS()
    triangles.beginModel(len(ring.faces), len(ring.vertices))
    triangles.addVertices(np.asarray(ring.vertices, dtype=float))
    triangles.addTriangles(np.asarray(ring.faces, dtype=np.int64))
    triangles.endModel()
    return disabled(arm, ("ring", "rod", "Default")), triangles


@pytest.mark.parametrize("link_meshes", ["hull", "mesh", "surface"])
def test_links_whose_hulls_always_overlap_are_checked_by_their_triangles_if_a_mesh_is_not_watertight(
    open_ring, path, link_meshes
):
    """The bar of 0.2 m reaches the inner radius of 0.1 m only at its corners: it touches where it lies in the ring."""
    arm, triangles = open_ring
    checker = CollisionChecker(arm, link_meshes=link_meshes)
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
    proven = certify(path(arm, upright - 0.3, upright + 0.3), checker)
    assert proven.free
    assert any("entirely inside is not detected" in note for note in proven.notes)
    met_at = Q[int(np.argmax(met))]
    certificate = certify(path(arm, upright, met_at), checker)
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
    checker = CollisionChecker(disabled(arm, ("ring", "ball", "User")))
    assert checker.finer == ()
    assert not checker.is_free([0.0, 0.0])


def triangles_of_links(arm, links):
    """The collision geometry of links in coal, with meshes as all of their triangles."""
    surfaces = CollisionChecker(arm, link_meshes="surface", trust_disabled=True).bodies
    return {link: [body for body in surfaces if body.owner == link] for link in links}


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
    arm = load_robot(name).arm()
    checker = CollisionChecker(arm)
    assert checker.is_free(arm.home)
    sampled = [pair.owners for pair in checker.excluded if "in contact in" in pair.reason]
    assert sampled or name == "pr2_left"
    shapes = triangles_of_links(arm, {link for links in sampled for link in links})
    Q = np.random.default_rng(11).uniform(*arm.limits.sampling_range(), size=(300, arm.dof))
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
    arm = load_robot(name).arm()
    checker = CollisionChecker(arm)
    shapes = triangles_of_links(arm, links)
    Q = np.random.default_rng(3).uniform(*arm.limits.sampling_range(), size=(400, arm.dof))
    met = np.array([triangles_meet(arm, shapes, links, q) for q in Q])
    assert least < met.mean() < most
    pair = checker.pairs_of_owners(*links)
    touching = np.array([bool(set(pair) & set(checker.placed(q).contacts(q))) for q in Q])
    assert (touching >= met).all()
    assert np.mean(touching != met) < 0.02  # within the tolerance of coal's distances, or a body inside another


@pytest.mark.slow
def test_links_whose_hulls_overlap_and_whose_meshes_do_not_are_checked_by_their_meshes():
    arm = load_robot("pr2_left").arm()
    finer = {frozenset(pair.owners): pair.by for pair in CollisionChecker(arm).finer}
    assert finer[frozenset(("l_forearm_link", "l_gripper_palm_link"))] == "exact meshes"
    assert finer[frozenset(("l_upper_arm_link", "l_forearm_roll_link"))] == "several hulls"
