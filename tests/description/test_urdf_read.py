"""Reading URDF keeps all content; what other parsers drop or misread is an error with its line."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import find_robot, read_srdf, read_urdf, read_urdf_text
from pinproof.description.meshes import read_mesh, resolved
from pinproof.description.ros_files import example_robot_data, locate
from pinproof.description.urdf import MAX_LINKS
from pinproof.model import load_robot

LIMIT = '<limit lower="-1" upper="1" velocity="2" effort="1"/>'


def urdf(*, joint="", kind="revolute", limit=LIMIT, link="", more=""):
    """Two links and a joint, whose joint element is on line 4."""
    return (
        f'<robot name="two">\n<link name="base"/>\n<link name="tip">{link}</link>\n'
        f'<joint name="j" type="{kind}"><parent link="base"/><child link="tip"/>{limit}{joint}</joint>\n{more}</robot>'
    )


def shape(text):
    return f"<collision><geometry>{text}</geometry></collision>"


def test_joint_is_kept_as_written():
    joint = read_urdf_text(urdf()).joints["j"]
    assert (joint.type, joint.parent, joint.child) == ("revolute", "base", "tip")
    assert (joint.lower, joint.upper, joint.velocity, joint.mimic) == (-1.0, 1.0, 2.0, None)


@pytest.mark.parametrize(
    ("text", "kind", "size"),
    [
        ('<capsule radius="0.1" length="0.4"/>', "capsule", (0.1, 0.4)),
        ('<cylinder radius="0.1" length="0.4"/>', "cylinder", (0.1, 0.4)),
        ('<sphere radius="0.1"/>', "sphere", (0.1,)),
        ('<box size="1 2 3"/>', "box", (1.0, 2.0, 3.0)),
        ('<!-- a comment --><?a note?><sphere radius="0.1"/>', "sphere", (0.1,)),
    ],
)
def test_geometry_is_kept(text, kind, size):
    (body,) = read_urdf_text(urdf(link=shape(text))).collisions
    assert (body.kind, body.size, body.link) == (kind, size, "tip")


def test_the_origin_rotates_about_fixed_axes():
    text = '<collision><origin xyz="1 2 3" rpy="0.3 -0.7 1.1"/><geometry><sphere radius="1"/></geometry></collision>'
    (body,) = read_urdf_text(urdf(link=text)).collisions
    assert body.origin == pytest.approx(pp.pose((1, 2, 3), (0.3, -0.7, 1.1)).homogeneous, abs=1e-15)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"link": shape('<sphere radius="-1"/>')}, "line 3.*above 0"),
        ({"link": shape('<sphere radius="nan"/>')}, "line 3.*finite"),
        ({"link": shape('<sphere radius="0"/>')}, "line 3.*above 0"),
        ({"link": shape('<box size="1 1 inf"/>')}, "line 3.*finite"),
        ({"link": shape('<box size="1 1"/>')}, "line 3.*3 finite numbers"),
        ({"link": shape('<torus radius="1"/>')}, "line 3.*torus.*valid"),
        ({"link": shape("")}, "line 3.*one shape"),
        ({"link": shape('<mesh filename="a.stl" scale="1 0 1"/>')}, "line 3.*has the scale"),
        ({"link": shape("<mesh/>")}, "line 3.*filename"),
        ({"joint": '<axis xyz="0 0 0"/>'}, "line 4.*no direction"),
        ({"joint": '<axis xyz="0 nan 1"/>'}, "line 4.*finite"),
        ({"joint": '<origin xyz="0 0"/>'}, "line 4.*3 finite numbers"),
        ({"limit": '<limit lower="1" upper="-1" velocity="1"/>'}, "line 4.*above upper"),
        ({"limit": '<limit lower="nan" upper="1" velocity="1"/>'}, "line 4.*finite"),
        ({"limit": '<limit lower="-1" upper="1" velocity="-1"/>'}, "line 4.*negative velocity"),
        ({"kind": "revolut"}, "line 4.*revolut.*valid: revolute"),
        ({"joint": '<mimic joint="k"/>'}, "unknown joint 'k'"),
        ({"joint": '<mimic joint="j"/>'}, "mimic joint itself"),
        (
            {
                "more": '<link name="c"/><joint name="k" type="floating"><parent link="base"/><child link="c"/>'
                '<mimic joint="j"/></joint>'
            },
            "floating and cannot",
        ),
        ({"more": '<link name="universe"/>'}, "line 5.*universe"),
        ({"more": '<x:arm xmlns:x="http://www.ros.org/wiki/xacro"/>'}, "line 5.*xacro"),
        ({"link": shape('<sphere radius="1_0"/>')}, "line 3.*not numeric"),
        ({"more": '<link name="tip"/>'}, "line 5.*duplicate"),
        ({"more": '<link name="island"/>'}, "base.*island.*one root"),
        (
            {"more": '<joint name="k" type="fixed"><parent link="base"/><child link="tip"/></joint>'},
            "more than one joint",
        ),
        ({"more": '<joint name="k" type="fixed"><parent link="base"/></joint>'}, "line 5.*<child>"),
        ({"more": '<joint name="k" type="fixed"><parent link="base"/><child link="tp"/></joint>'}, "'tp'.*valid: tip"),
        ({"more": '<joint name="k" type="fixed"><parent link="tip"/><child link="base"/></joint>'}, "loop"),
        ({"link": "<collison><geometry/></collison>"}, "line 3.*<collison>; did you mean <collision>"),
        ({"link": "<Collision/>"}, "line 3.*<Collision>; did you mean <collision>"),
        ({"link": "<collision><orgin/><geometry><sphere radius='1'/></geometry></collision>"}, "did you mean <origin>"),
        ({"joint": '<orign xyz="0 0 1"/>'}, "line 4.*did you mean <origin>"),
        ({"joint": '<mimc joint="k"/>'}, "line 4.*did you mean <mimic>"),
        ({"joint": '<origin xzy="0 0 1"/>'}, "line 4.*'xzy'; valid: xyz, rpy"),
        ({"joint": '<origin xyz="0 0 1" quat_xyzw="0 0 0 1"/>'}, "line 4.*'quat_xyzw'; valid"),
        ({"joint": '<axis xyz="0 0 1" rpy="0 0 1"/>'}, "line 4.*'rpy'; valid"),
        ({"limit": '<limit lower="-1" uper="1" velocity="1"/>'}, "line 4.*'uper'; did you mean 'upper'"),
        ({"joint": '<origin xyz="1e300 0 0"/>'}, "line 4.*more than 10000 m away"),
        ({"link": shape('<box size="1e300 1 1"/>')}, "line 3.*at most 10000 m"),
        ({"joint": '<mimic joint="k" multiplier="1e308"/>'}, "line 4.*limit is 10000"),
        ({"joint": '<origin xyz="٣ 0 0"/>'}, "line 4.*not numeric"),
        ({"joint": '<origin xyz="1e400 0 0"/>'}, "line 4.*finite"),
    ],
)
def test_invalid_content_is_refused_with_its_line(parts, message):
    with pytest.raises(pp.errors.UrdfError, match=message):
        read_urdf_text(urdf(**parts))


@pytest.mark.parametrize("limit", ["", '<limit velocity="1" effort="1"/>', '<limit lower="-1" velocity="1"/>'])
def test_missing_limits_are_an_error_and_never_zero(limit):
    robot = load_robot(urdf(limit=limit))
    with pytest.raises(pp.InputError, match=r"'j' states no lower and upper limit"):
        robot.arm(tcp="tip")
    assert robot.arm(tcp="tip", limits={"j": (-2, 2)}).limits.upper.tolist() == [2.0]


def test_velocity_zero_means_not_known():
    robot = load_robot(urdf(limit='<limit lower="-1" upper="1" velocity="0"/>'))
    assert robot.urdf.joints["j"].velocity is None
    assert str(robot.arm(tcp="tip").limits.velocity) == "[nan]"


def chain(links):
    parts = ['<robot name="long"><link name="l0"/>']
    for i in range(1, links):
        parts.append(
            f'<link name="l{i}"/><joint name="j{i}" type="revolute"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'<axis xyz="0 0 1"/>{LIMIT}</joint>'
        )
    return "".join([*parts, "</robot>"])


def test_robot_of_5000_joints_is_refused_before_it_crashes_the_parser():
    with pytest.raises(pp.errors.UrdfError, match="5001 links"):
        load_robot(chain(5001))


def test_robot_of_the_most_links_moves_part_by_part():
    robot = load_robot(chain(MAX_LINKS))
    tip = f"l{MAX_LINKS - 1}"
    assert robot.arm(tcp=tip, base=f"l{MAX_LINKS - 201}").dof == 200
    with pytest.raises(pp.InputError, match=rf"{MAX_LINKS - 1} joints are between.*limit"):
        robot.arm(tcp=tip)


BOMB = '<!DOCTYPE robot [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>\n<robot name="&b;"><link name="base"/></robot>'


@pytest.mark.parametrize(
    ("text", "named"), [(BOMB, "DOCTYPE"), ("<sdf/>", "<sdf>, not <robot>"), ('<robot name="r"/>', "no links")]
)
def test_other_documents_are_refused(text, named):
    with pytest.raises(pp.errors.UrdfError, match=named):
        read_urdf_text(text)


def test_external_entity_is_not_read(tmp_path):
    secret = tmp_path / "secret.txt"
    secret.write_text("hidden")
    text = f'<!DOCTYPE r [<!ENTITY x SYSTEM "file://{secret}">]>\n<robot name="r"><link name="a">&x;</link></robot>'
    with pytest.raises(pp.errors.UrdfError) as caught:
        read_urdf_text(text)
    assert "hidden" not in str(caught.value)


def test_missing_files_and_broken_xml_are_named(tmp_path):
    with pytest.raises(pp.errors.UrdfError, match=r"nowhere\.urdf: cannot be read"):
        read_urdf(tmp_path / "nowhere.urdf")
    file = tmp_path / "broken.urdf"
    file.write_text('<robot name="r">\n<link name="a">\n</robot>')
    with pytest.raises(pp.errors.UrdfError, match=r"broken.urdf: line 3: .*not well-formed"):
        read_urdf(file)


def test_axis_of_any_length_is_a_direction():
    robot = load_robot(urdf(joint='<axis xyz="3e200 0 4e200"/>'))
    twist = robot.arm(tcp="tip").jacobian([0.2])[:, 0]
    assert twist == pytest.approx([0, 0, 0, 0.6, 0, 0.8], abs=1e-15)


def test_an_unusably_large_limit_is_no_limit():
    joint = read_urdf_text(urdf(limit='<limit lower="-1e16" upper="1e16" velocity="1e308"/>')).joints["j"]
    assert (joint.lower, joint.upper, joint.velocity) == (None, None, None)


@pytest.mark.parametrize("mass", ["nan", "abc", "", "1e400"])
def test_invalid_inertia_is_ignored_without_output(mass, capfd):
    inertial = f'<inertial><mass value="{mass}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    assert load_robot(urdf(link=inertial)).arm(tcp="tip").dof == 1
    assert capfd.readouterr() == ("", "")


# Mesh files: found by every kind of URI, named with the places searched when not, scaled and checked when read.


TRIANGLES = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def mesh(tmp_path):
    """tmp_path/ws/arm_description/{urdf,meshes}; the mesh is a tetrahedron."""
    package = tmp_path / "ws" / "arm_description"
    (package / "urdf").mkdir(parents=True)
    (package / "meshes").mkdir()
    file = package / "meshes" / "a part.obj"
    file.write_text(TRIANGLES)
    return file


def robot(folder, uri):
    file = folder / "arm.urdf"
    file.write_text(
        f'<robot name="r"><link name="a"><visual><geometry><mesh filename="{uri}"/></geometry></visual></link></robot>'
    )
    return file


@pytest.mark.parametrize(
    "uri",
    [
        "package://arm_description/meshes/a part.obj",
        "package://arm_description/meshes/a%20part.obj",
        "../meshes/a part.obj",
    ],
)
def test_mesh_is_found_from_the_urdf_alone(mesh, uri):
    (visual,) = read_urdf(robot(mesh.parents[1] / "urdf", uri)).visuals
    assert visual.mesh is not None
    assert visual.mesh.path is not None
    assert visual.mesh.path.samefile(mesh)


@pytest.mark.parametrize("prefix", ["file://", ""])
def test_mesh_is_found_by_absolute_path(mesh, tmp_path, prefix):
    (visual,) = read_urdf(robot(tmp_path, f"{prefix}{mesh}")).visuals
    assert visual.mesh is not None
    assert visual.mesh.path == mesh


def test_package_folders_are_searched_first(mesh, tmp_path):
    other = tmp_path / "other" / "arm_description" / "meshes" / "a part.obj"
    other.parent.mkdir(parents=True)
    other.write_text(TRIANGLES)
    uri = "package://arm_description/meshes/a part.obj"
    (visual,) = read_urdf(robot(mesh.parents[1] / "urdf", uri), package_dirs=[tmp_path / "other"]).visuals
    assert visual.mesh is not None
    assert visual.mesh.path == other


@pytest.mark.parametrize("uri", ["package://arm_description/meshes/no.stl", "no.stl", "file:///no/such.stl"])
def test_missing_mesh_names_link_and_every_place_searched(tmp_path, uri):
    found = locate(uri, tmp_path / "urdf", [tmp_path / "packages"])
    with pytest.raises(pp.errors.MeshError) as caught:
        resolved(found, "forearm")
    text = str(caught.value)
    assert "forearm" in text
    assert found.searched
    assert all(str(place) in text for place in found.searched)
    if not uri.startswith("file"):
        assert str(tmp_path / "packages") in text


def test_scale_is_applied_and_a_mirrored_mesh_keeps_its_outside_out(mesh):
    plain, mirrored = read_mesh(mesh, (2, 1, 1)), read_mesh(mesh, (-2, 1, 1))

    def volume(m):
        a, b, c = m.vertices[m.triangles].transpose(1, 0, 2)
        return np.einsum("ij,ij->", a, np.cross(b, c)) / 6

    assert volume(plain) == pytest.approx(1 / 3)
    assert volume(mirrored) == pytest.approx(1 / 3)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.obj", "v 0 0 0\n", "no triangle|cannot be read"),
        ("a.obj", TRIANGLES.replace("v 1 0 0", "v nan 0 0"), "not finite"),
        ("a.stl", "nonsense", "cannot be read|no triangle"),
        ("a.txt", "", "unknown file type"),
    ],
)
def test_unusable_mesh_is_refused(tmp_path, name, text, message):
    file = tmp_path / name
    file.write_text(text)
    with pytest.raises(pp.errors.MeshError, match=message):
        read_mesh(file)


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(pp.errors.MeshError, match="No such file"):
        read_mesh(tmp_path / "a.stl")


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_catalogue_robots_have_their_meshes(name):
    urdf = pp.load_robot(name).urdf
    meshes = [g for g in (*urdf.visuals, *urdf.collisions) if g.mesh is not None]
    assert meshes
    assert all(resolved(g.mesh, g.link).is_file() for g in meshes)


# SRDF: groups, states, end effectors and disabled pairs.


TEXT = """<robot name="r">
  <group name="arm"><chain base_link="base" tip_link="tip"/></group>
  <group name="hand"><joint name="finger"/></group>
  <group name="all"><joint name="track"/><group name="arm"/><group name="hand"/></group>
  <group_state name="ready" group="arm"><joint name="j1" value="0.5"/></group_state>
  <end_effector name="gripper" parent_link="tip" group="hand" parent_group="arm"/>
  <disable_collisions link1="a" link2="b" reason="Never"/>
  <disable_collisions link1="a" link2="c"/>
</robot>"""


def read(tmp_path, text):
    file = tmp_path / "r.srdf"
    file.write_text(text)
    return read_srdf(file)


def test_srdf_is_kept_as_written(tmp_path):
    srdf = read(tmp_path, TEXT)
    assert srdf.groups["arm"].chains == (("base", "tip"),)
    assert srdf.groups["all"].joints == ("track", "finger")
    assert srdf.groups["all"].chains == (("base", "tip"),)
    assert [(s.name, s.group, s.joints) for s in srdf.states] == [("ready", "arm", {"j1": (0.5,)})]
    assert [(e.parent_link, e.group) for e in srdf.end_effectors] == [("tip", "arm")]
    assert [(p.links, p.reason) for p in srdf.disabled] == [(("a", "b"), "Never"), (("a", "c"), "")]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot><group/></robot>", "line 1.*name"),
        (
            '<robot><group name="a"><group name="b"/></group><group name="b"><group name="a"/></group></robot>',
            "a -> b -> a",
        ),
        ('<robot><group_state name="s"><joint name="j" value="x"/></group_state></robot>', "not numeric"),
        ('<robot><disable_collisions link1="a"/></robot>', "link2"),
        ("<launch/>", "<launch>, not <robot>"),
        ("<robot>", "well-formed"),
    ],
)
def test_invalid_srdf_is_refused(tmp_path, text, message):
    with pytest.raises(pp.errors.UrdfError, match=message):
        read(tmp_path, text)


def test_urdf_in_place_of_an_srdf_is_refused():
    with pytest.raises(pp.errors.UrdfError, match=r"line \d+: contains links: this is a URDF, not an SRDF"):
        read_srdf(find_robot("ur5").urdf)


def test_a_missing_subgroup_invalidates_only_the_groups_that_contain_it(tmp_path):
    text = '<robot><group name="a"><group name="b"/></group><group name="c"><joint name="j"/></group></robot>'
    groups = read(tmp_path, text).groups
    assert (groups["a"].missing, groups["c"].missing, groups["c"].joints) == (("b",), (), ("j",))


def test_names_are_trimmed(tmp_path):
    assert set(read(tmp_path, '<robot><group name=" arm "><joint name="j"/></group></robot>').groups) == {"arm"}


def test_panda_group_gives_base_and_tcp():
    entry = find_robot("panda")
    assert entry.srdf is not None
    robot = pp.load_robot("panda")
    arm = robot.arm(group="arm")
    assert (arm.base, arm.tcp, arm.dof) == ("panda_link0", "panda_hand_tcp", 7)
    with pytest.raises(pp.UnknownNameError, match="valid: arm"):
        robot.arm(group="am")


def test_a_name_of_two_groups_keeps_both_states(tmp_path):
    text = """<robot name="r">
      <group_state name="home" group="arm"><joint name="j" value="1"/></group_state>
      <group_state name="home" group="hand"><joint name="f" value="2"/></group_state></robot>"""
    assert [(s.group, dict(s.joints)) for s in read(tmp_path, text).states] == [
        ("arm", {"j": (1.0,)}),
        ("hand", {"f": (2.0,)}),
    ]


def test_joint_of_several_numbers_is_read(tmp_path):
    text = '<robot name="r"><group_state name="s"><joint name="root" value=" 0 0 1  0 0 0 1."/></group_state></robot>'
    assert read(tmp_path, text).states[0].joints["root"] == (0, 0, 1, 0, 0, 0, 1)


def test_pair_that_is_enabled_by_name_is_not_disabled(tmp_path):
    text = """<robot name="r"><disable_default_collisions link="c"/>
      <disable_collisions link1="a" link2="b"/><disable_collisions link1="a" link2="c"/>
      <enable_collisions link1="b" link2="a"/></robot>"""
    srdf = read(tmp_path, text)
    assert [pair.links for pair in srdf.disabled] == [("a", "c")]
    assert srdf.disabled_links == ("c",)


def test_deeply_nested_subgroups_are_read_quickly(tmp_path):
    levels = [
        f'<group name="g{i}">' + (f'<group name="g{i + 1}"/>' * 2 if i < 60 else '<joint name="j"/>') + "</group>"
        for i in range(61)
    ]
    assert read(tmp_path, f'<robot name="r">{"".join(levels)}</robot>').groups["g0"].joints == ("j",)


@pytest.mark.parametrize("file", sorted(example_robot_data().rglob("*.srdf")), ids=lambda file: file.stem)
def test_every_srdf_of_example_robot_data_is_read(file):
    srdf = read_srdf(file)
    assert srdf.groups or srdf.disabled
