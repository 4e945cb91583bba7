"""Pages of joint groups: every arm is drawn, with its tool, its path and the objects that it carries."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.viewer.picture import Picture

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cell():
    arm = pp.load_robot("generic_6dof").arm()
    return pp.assemble({"a": (arm, np.eye(4)), "b": (arm, pp.pose((1.5, 0, 0)))})


def motion(cell) -> pp.Trajectory:
    return pp.time_parametrise(pp.JointPath(np.array([cell.home, cell.home + 0.4]), cell.joint_names), cell.limits)


def test_each_arm_has_its_path_and_carries_its_object(cell) -> None:
    tool = pp.Obstacle("tool", pp.Sphere(0.03), pp.pose(), arm="b")
    picture = Picture(cell, None, motion(cell), attached=[tool]).render()
    paths = {each.get("path") for each in picture.commands.items}
    assert {"/tcp path/0/line", "/tcp path/1/line"} <= paths
    names = [link.name for link in picture.stage.links]
    assert "b/tool0" in names  # drawn because of the tool that it carries
    assert "a/tool0" not in names
    tools = [name for name, is_tool in zip(names, picture.stage.tool, strict=True) if is_tool]
    assert {name.partition("/")[0] for name in tools} == {"a", "b"}


def test_layers_name_the_nodes_of_links_with_a_prefix(cell) -> None:
    picture = Picture(cell, None, motion(cell)).render()
    paths = {str(each.get("path")) for each in picture.commands.items}
    for layer in picture.settings["layers"]:
        for node in layer["nodes"]:
            if node[0] == "robot":
                assert any(path.startswith("/" + "/".join(node) + "/") for path in paths)


def test_page_of_a_cell_is_free_with_its_certificate_only(cell) -> None:
    trajectory, checker = motion(cell), pp.CollisionChecker(cell)
    certificate = pp.certify(trajectory, checker)
    assert certificate.status is pp.CertificateStatus.FREE
    assert Picture(cell, None, trajectory, certificate).render().caption.headline == "FREE"
    assert Picture(cell.arms["a"], None, None, certificate).render().caption.headline != "FREE"
