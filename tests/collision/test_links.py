"""Geometry of link meshes, as requested for each link and finer for pairs of which only the hulls touch."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.collision import audit
from pinproof.collision.checking.links import link_bodies, meshes_of
from pinproof.errors import MeshError


def test_one_name_or_a_mapping_sets_the_geometry_of_every_link():
    links = ("base", "upper", "fore")
    assert meshes_of(links, "mesh") == dict.fromkeys(links, "mesh")
    assert meshes_of(links, {"fore": "mesh"}) == {"base": "hull", "upper": "hull", "fore": "mesh"}
    data = meshes_of(links, {"fore": "mesh", "*": "decomposed"})
    assert data == {"base": "decomposed", "upper": "decomposed", "fore": "mesh"}


@pytest.mark.parametrize("data", ["exact", {"base": "exact"}, {"bse": "hull"}, {"*": "all"}])
def test_unknown_links_and_kinds_of_geometry_are_refused(data):
    with pytest.raises(pp.UnknownNameError):
        meshes_of(("base", "upper"), data)
    with pytest.raises(pp.InputError):
        meshes_of(("base",), None)


def test_each_link_uses_the_requested_geometry(ur5):
    checker = pp.CollisionChecker(ur5, link_meshes={"forearm_link": "mesh", "upper_arm_link": "decomposed"})
    bodies = {link: [b for b in checker.bodies if b.owner == link and not b.level] for link in ur5.robot.urdf.links}
    assert [b.support is None for b in bodies["forearm_link"]] == [True]
    assert len(bodies["upper_arm_link"]) > 2
    assert all(b.support is not None for b in bodies["upper_arm_link"])
    assert [b.support is None for b in bodies["shoulder_link"]] == [False]
    assert len({b.name for b in checker.bodies}) == len(checker.bodies)


@pytest.mark.parametrize("how", ["mesh", "decomposed"])
def test_an_open_mesh_is_replaced_by_its_hull_with_a_note(tmp_path, how):
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    trimesh.Trimesh(box.vertices, box.faces[1:], process=False).export(tmp_path / "open.stl")
    robot = pp.load_robot(
        f'<robot name="r"><link name="base"><collision><geometry><mesh filename="{tmp_path}/open.stl"/></geometry>'
        "</collision></link></robot>"
    )
    (body,) = link_bodies(robot.urdf.collisions[0], how)
    assert body.support is not None
    assert "open.stl is not watertight" in body.remark
    (plain,) = link_bodies(robot.urdf.collisions[0], "hull")
    assert "convex hull" in plain.remark
    (surface,) = link_bodies(robot.urdf.collisions[0], "surface")
    assert surface.support is None
    assert "not watertight" in surface.remark


def test_a_closed_mesh_is_solid_as_a_surface_too(ur5):
    exact, surface = (pp.CollisionChecker(ur5, link_meshes=how).bodies for how in ("mesh", "surface"))
    assert [b.content() for b in exact] == [b.content() for b in surface]
    assert all(b.solid.watertight for b in surface if b.solid is not None)


def test_a_mesh_that_is_nowhere_is_named():
    robot = pp.load_robot(
        '<robot name="r"><link name="base"><collision><geometry><mesh filename="gone.stl"/></geometry></collision>'
        "</link></robot>"
    )
    for how in ("hull", "mesh", "surface", "decomposed"):
        with pytest.raises(MeshError, match=r"gone\.stl"):
            link_bodies(robot.urdf.collisions[0], how)


def test_pairs_that_an_srdf_disables_without_a_reason_are_met_by_closer_hulls(ur5):
    """The hull of a UR5's upper arm overlaps its base at every third configuration; the arm itself hardly ever does."""
    usual, exact = pp.CollisionChecker(ur5), pp.CollisionChecker(ur5, link_meshes="mesh")
    pair = {"base_link", "upper_arm_link"}
    details = {body.owner for body in usual.bodies if body.level}
    assert pair <= details
    met = [(usual.bodies[i], usual.bodies[j]) for i, j in usual.pairs]
    assert all(a.level and b.level for a, b in met if {a.owner, b.owner} == pair)
    assert not [1 for a, b in met if {a.owner, b.owner} == {"upper_arm_link", "wrist_1_link"} and (a.level or b.level)]
    q = np.random.default_rng(0).uniform(*ur5.limits.sampling_range(), (200, 6))
    touching = [[pair in [set(c.bodies) for c in checker.check(x).contacts] for x in q] for checker in (usual, exact)]
    assert all(coarse or not fine for coarse, fine in zip(*touching, strict=True))
    assert sum(touching[0]) <= sum(touching[1]) + 6
    assert not [b for b in pp.CollisionChecker(ur5, trust_disabled=True).bodies if b.level]


def test_a_geometry_without_parts_is_drawn_with_the_parts_of_its_link(tmp_path):
    """Where an SRDF disables a pair without a reason: a ring is met in parts, the box on the same link as it is."""
    trimesh.creation.annulus(0.2, 0.25, 0.05).export(tmp_path / "ring.stl")
    box = '<collision><origin xyz="0 0 0.5"/><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    ring = '<collision><geometry><mesh filename="ring.stl"/></geometry></collision>'
    limit = '<limit lower="-3" upper="3" velocity="1" effort="1"/>'
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="1 0 0"/><axis xyz="0 1 0"/>{limit}</joint>'
        for name, parent, child in (("j1", "base", "middle"), ("j2", "middle", "tip"))
    )
    links = "".join(f'<link name="{n}">{g}</link>' for n, g in (("base", box), ("middle", box), ("tip", ring + box)))
    (tmp_path / "r.urdf").write_text(f'<robot name="r">{links}{joints}</robot>')
    (tmp_path / "r.srdf").write_text('<robot name="r"><disable_collisions link1="base" link2="tip"/></robot>')
    robot = pp.load_robot(tmp_path / "r.urdf", srdf=tmp_path / "r.srdf")
    checker = pp.CollisionChecker(robot.arm(tcp="tip"))
    met = {checker.bodies[j].name for i, j in checker.pairs if checker.bodies[i].owner == "base"}
    assert "tip_1" in met
    assert "tip_0" not in met
    assert met - {"tip_1"} == {body.name for body in checker.bodies if body.level}


HOLE = 0.15


@pytest.fixture(scope="module")
def ring(arm_from_links, mesh_file):
    """A ring about x (hole of 0.15 m) that slides along x, with a knob far out, so that it has two geometries."""
    torus = trimesh.creation.torus(HOLE + 0.05, 0.05, 24, 12)
    torus.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0)))
    shapes = f'<mesh filename="{mesh_file(torus)}"/>;<box size="0.1 0.1 0.1"/>@0 0 0.6'
    return arm_from_links(
        {"root": "", "ring": shapes, "tip": ""},
        [("slide", "prismatic", "root", "ring", "0 0 0", "1 0 0"), ("end", "fixed", "ring", "tip", "0 0 0", "1 0 0")],
    ).arm(tcp="tip")


def rod(side: float) -> pp.Obstacle:
    return pp.Obstacle("rod", pp.Box(2.0, side, side))


BALL = pp.Obstacle("ball", pp.Sphere(0.02), pp.pose((1.0, 0, HOLE + 0.05)))


def owners(checker):
    return [contact.bodies for contact in checker.check([0.0]).contacts]


def test_contacts_of_the_hull_only_are_checked_by_several_hulls(ring):
    coarse = pp.CollisionChecker(ring, pp.Scene([rod(0.05), BALL]), margin=0.01)
    assert owners(coarse) == [("ring", "rod")]
    fine = coarse.finer_at([0.0])
    assert fine.is_free([0.0])
    assert fine.check([0.0]).free
    assert fine.is_free_batch([[0.0]]).all()
    assert all(body.support is not None for body in fine.bodies)
    (pair,) = fine.finer
    assert (pair.owners, pair.by) == (("ring", "rod"), "several hulls")
    assert not coarse.is_free([0.0])
    assert coarse.finer == ()


def test_contacts_of_several_hulls_are_checked_by_the_mesh(ring):
    widest = HOLE * np.sqrt(2) * 0.985  # the ring has flat sides
    coarse = pp.CollisionChecker(ring, pp.Scene([rod(widest)]))
    fine = coarse.finer_at([0.0])
    assert fine.is_free([0.0])
    assert [pair.by for pair in fine.finer] == ["exact meshes"]
    exact = pp.CollisionChecker(ring, coarse.scene, link_meshes="mesh")
    assert fine.clearance([0.0]) == pytest.approx(exact.clearance([0.0]), abs=1e-6)


def test_a_real_contact_leaves_the_checker_as_it_is(ring):
    for side in (0.25, 0.5):
        coarse = pp.CollisionChecker(ring, pp.Scene([rod(side)]))
        assert coarse.finer_at([0.0]) is coarse
    free = pp.CollisionChecker(ring, pp.Scene([BALL]))
    assert free.finer_at([0.0]) is free


def test_a_margin_that_the_mesh_violates_is_a_real_contact(ring):
    scene = pp.Scene([rod(0.05)])
    coarse = pp.CollisionChecker(ring, scene, margin=0.2)
    assert coarse.finer_at([0.0]) is coarse
    assert pp.CollisionChecker(ring, scene, margin=0.09).finer_at([0.0]).is_free([0.0])


def test_only_the_pairs_that_call_for_it_change(ring):
    knocked = pp.Obstacle("knocked", pp.Sphere(0.05), pp.pose((0, 0, 0.6)))
    hung = pp.Obstacle("hung", pp.Sphere(0.02), pp.pose((1.5, 0, 0)))
    fine = pp.CollisionChecker(ring, pp.Scene([rod(0.05), hung, knocked])).finer_at([0.0])
    assert owners(fine) == [("ring", "knocked")]
    assert [pair.owners for pair in fine.finer] == [("ring", "rod")]
    assert [contact.bodies for contact in fine.check([1.5]).contacts] == [("ring", "hung")]  # by the hull


def test_every_geometry_of_the_link_stays_in_the_pair(ring):
    """The knob of the ring has no closer bodies: it is met as it was."""
    fine = pp.CollisionChecker(ring, pp.Scene([rod(0.05)])).finer_at([0.0])
    assert not fine.with_scene(pp.Scene([pp.Obstacle("rod", pp.Box(2.0, 0.05, 0.05), pp.pose((0, 0, 0.6)))])).is_free(
        [0.0]
    )


def test_whatever_is_derived_keeps_it(ring):
    coarse = pp.CollisionChecker(ring, pp.Scene([rod(0.05), BALL]))
    fine = coarse.finer_at([0.0])
    tool = pp.Obstacle("tool", pp.Box(0.01, 0.01, 0.01), pp.pose((0.3, 0.3, 0.3)))
    for other in (
        fine.with_margin(0.001),
        fine.padded(0.001),
        fine.with_obstacle_tolerance(0.001),
        fine.with_scene(pp.Scene([rod(0.06)])),
        fine.with_scene(pp.Scene([BALL])).with_scene(coarse.scene),
        fine.with_attached(tool),
        fine.allowing(("ring", "ball")),
        pickle.loads(pickle.dumps(fine)),
    ):
        assert other.is_free([0.0])
        assert other.finer == fine.finer
    assert fine.fingerprint() != coarse.fingerprint()


def test_the_certificate_names_owners_and_their_geometry(ring, path):
    coarse = pp.CollisionChecker(ring, pp.Scene([rod(0.05), BALL]))
    fine = coarse.finer_at([0.0])
    free = pp.certify(path(ring, [-0.5], [0.5]), fine)
    assert free.free
    (note,) = [note for note in free.notes if "checked with" in note]
    assert note.startswith("ring and rod: checked with several hulls")
    assert not [note for note in pp.certify(path(ring, [-0.5], [0.5]), coarse).notes if "checked with" in note]
    assert pp.certify(path(ring, [0.0], [1.0]), fine).first_contact.bodies == ("ring", "ball")


@pytest.mark.parametrize("side", [0.05, HOLE * np.sqrt(2) * 0.985])
def test_free_with_finer_bodies_is_free_in_dense_samples_of_the_meshes(ring, path, side):
    """Several hulls, and the exact mesh."""
    fine = pp.CollisionChecker(ring, pp.Scene([rod(side)])).finer_at([0.0])
    curve = path(ring, [-0.2], [0.2])
    assert pp.certify(curve, fine).free
    assert audit(curve, pp.CollisionChecker(ring, fine.scene, link_meshes="mesh")).clean
    tilted = fine.with_scene(pp.Scene([pp.Obstacle("rod", pp.Box(2.0, side, side), pp.pose((0, 0, 0), (0, 0.3, 0)))]))
    through = path(ring, [-0.9], [0.9])
    verdict = pp.certify(through, tilted)
    assert not verdict.free
    assert verdict.first_contact.bodies == ("ring", "rod")


@pytest.mark.slow
def test_random_edges_of_an_arm_that_starts_within_its_hulls(ur5, path):
    """Balls near a UR5's forearm and upper arm: free by closer bodies, and then so by exact meshes, densely."""
    rng, proven = np.random.default_rng(0), 0
    lower, upper = ur5.limits.sampling_range()
    usual, exact = pp.CollisionChecker(ur5), pp.CollisionChecker(ur5, link_meshes="mesh")
    for _ in range(200):
        if proven == 3:
            break
        q = rng.uniform(lower, upper)
        link = str(rng.choice(["upper_arm_link", "forearm_link"]))
        place = ur5.frame_placement(q, link).act(rng.uniform((-0.15, -0.15, 0.0), (0.15, 0.15, 0.4)))
        scene = pp.Scene([pp.Obstacle("ball", pp.Sphere(0.03), pp.pose(place))])
        coarse = usual.with_scene(scene)
        fine = coarse.finer_at(q)
        judge = exact.with_scene(scene)
        assert judge.is_free(q) or not fine.is_free(q)
        if fine is coarse or not fine.is_free(q):
            continue
        curve = path(ur5, q, q + rng.normal(size=6) * 0.05)
        if pp.certify(curve, fine).free:
            assert audit(curve, judge, step=0.01).clean
            proven += 1
    assert proven == 3
