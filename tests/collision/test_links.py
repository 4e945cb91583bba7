"""How a robot's link meshes are met: hull, triangles or several hulls, for all links or link by link."""

from __future__ import annotations

import pytest
import trimesh

from pinproof import CollisionChecker, InputError, MeshError, UnknownNameError
from pinproof.collision.links import link_bodies, meshes_of
from pinproof.model.robot import load_robot_from_text


def test_one_word_or_a_mapping_speaks_for_every_link():
    links = ("base", "upper", "fore")
    assert meshes_of(links, "mesh") == dict.fromkeys(links, "mesh")
    assert meshes_of(links, {"fore": "mesh"}) == {"base": "hull", "upper": "hull", "fore": "mesh"}
    told = meshes_of(links, {"fore": "mesh", "*": "decomposed"})
    assert told == {"base": "decomposed", "upper": "decomposed", "fore": "mesh"}


@pytest.mark.parametrize("told", ["exact", {"base": "exact"}, {"bse": "hull"}, {"*": "all"}])
def test_what_does_not_exist_is_refused(told):
    with pytest.raises(UnknownNameError):
        meshes_of(("base", "upper"), told)
    with pytest.raises(InputError):
        meshes_of(("base",), None)


def test_each_link_is_met_as_told(ur5):
    checker = CollisionChecker(ur5, link_meshes={"forearm_link": "mesh", "upper_arm_link": "decomposed"})
    bodies = {link: [b for b in checker.bodies if b.owner == link] for link in ur5.robot.urdf.links}
    assert [b.support is None for b in bodies["forearm_link"]] == [True]
    assert len(bodies["upper_arm_link"]) > 2
    assert all(b.support is not None for b in bodies["upper_arm_link"])
    assert [b.support is None for b in bodies["shoulder_link"]] == [False]
    assert len({b.name for b in checker.bodies}) == len(checker.bodies)


@pytest.mark.parametrize("how", ["mesh", "decomposed"])
def test_an_open_mesh_is_hulled_and_says_so(tmp_path, how):
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    trimesh.Trimesh(box.vertices, box.faces[1:], process=False).export(tmp_path / "open.stl")
    robot = load_robot_from_text(
        f'<robot name="r"><link name="base"><collision><geometry><mesh filename="{tmp_path}/open.stl"/></geometry>'
        "</collision></link></robot>"
    )
    (body,) = link_bodies(robot.urdf.collisions[0], how)
    assert body.support is not None
    assert "open.stl is not watertight: its hull is taken" in body.remark
    (plain,) = link_bodies(robot.urdf.collisions[0], "hull")
    assert plain.remark == ""


def test_a_mesh_that_is_nowhere_is_named():
    robot = load_robot_from_text(
        '<robot name="r"><link name="base"><collision><geometry><mesh filename="gone.stl"/></geometry></collision>'
        "</link></robot>"
    )
    for how in ("hull", "mesh", "decomposed"):
        with pytest.raises(MeshError, match=r"gone\.stl"):
            link_bodies(robot.urdf.collisions[0], how)
