"""Geometry of link meshes: hull, triangles or several hulls, for all links or for each link."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from pinproof import CollisionChecker, InputError, UnknownNameError, load_robot
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
    with pytest.raises(UnknownNameError):
        meshes_of(("base", "upper"), data)
    with pytest.raises(InputError):
        meshes_of(("base",), None)


def test_each_link_uses_the_requested_geometry(ur5):
    checker = CollisionChecker(ur5, link_meshes={"forearm_link": "mesh", "upper_arm_link": "decomposed"})
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
    robot = load_robot(
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
    exact, surface = (CollisionChecker(ur5, link_meshes=how).bodies for how in ("mesh", "surface"))
    assert [b.content() for b in exact] == [b.content() for b in surface]
    assert all(b.solid.watertight for b in surface if b.solid is not None)


def test_a_mesh_that_is_nowhere_is_named():
    robot = load_robot(
        '<robot name="r"><link name="base"><collision><geometry><mesh filename="gone.stl"/></geometry></collision>'
        "</link></robot>"
    )
    for how in ("hull", "mesh", "surface", "decomposed"):
        with pytest.raises(MeshError, match=r"gone\.stl"):
            link_bodies(robot.urdf.collisions[0], how)


def test_pairs_that_an_srdf_disables_without_a_reason_are_met_by_closer_hulls(ur5):
    """The hull of a UR5's upper arm overlaps its base at every third configuration; the arm itself hardly ever does."""
    usual, exact = CollisionChecker(ur5), CollisionChecker(ur5, link_meshes="mesh")
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
    assert not [b for b in CollisionChecker(ur5, trust_disabled=True).bodies if b.level]


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
    robot = load_robot(tmp_path / "r.urdf", srdf=tmp_path / "r.srdf")
    checker = CollisionChecker(robot.arm(tcp="tip"))
    met = {checker.bodies[j].name for i, j in checker.pairs if checker.bodies[i].owner == "base"}
    assert "tip_1" in met
    assert "tip_0" not in met
    assert met - {"tip_1"} == {body.name for body in checker.bodies if body.level}
