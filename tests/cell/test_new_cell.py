"""New cells from a robot and meshes: units, poses of rest, bins, hands, homes, and files that state assumptions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import trimesh
import yaml
from scipy.spatial import ConvexHull, Delaunay

import pinproof as pp
from pinproof.cell import NewCell, new_cell
from pinproof.cell.starting.new_cell import _part_type
from pinproof.cell.starting.station import find_home, fixed_box, hand_points, recognise_hand, work_areas
from pinproof.cell.starting.workpieces import Workpiece, arrange, free_floor
from pinproof.errors import FileError, InputError, MeshError
from pinproof.picks import Tool

from ..pages import run_main


def link(name: str, at: str, shape: str) -> str:
    body = f'<collision><origin xyz="{at}"/><geometry><{shape}/></geometry></collision>'
    return f'<link name="{name}">{body if shape else ""}</link>'


def joint(
    name: str, ends: str, origin: str, axis: str = "", low: float = 0.0, high: float = 0.0, more: str = ""
) -> str:
    parent, child = ends.split()
    moving = f'<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" velocity="2" effort="150"/>' if axis else ""
    kind = "fixed" if not axis else "prismatic" if high - low < 1 else "revolute"
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin {origin}/>'
    return f'<joint name="{name}" type="{kind}">{ends}{moving}{more}</joint>'


def jaws(at: float, axis: int) -> str:
    """A gripper whose jaws open by 60 mm along an axis, and are this far from the middle at 0."""
    return (
        link("palm", "0 0 0.02", 'box size="0.09 0.03 0.03"')
        + link("jaw_a", "0 0 0.025", 'box size="0.01 0.02 0.05"')
        + link("jaw_b", "0 0 0.025", 'box size="0.01 0.02 0.05"')
        + link("tip", "", "")
        + joint("mount", "flange palm", "")
        + joint("jaw", "palm jaw_a", f'xyz="{at} 0 0.035"', f"{axis} 0 0", 0.0, 0.03)
        + joint("jaw_2", "palm jaw_b", f'xyz="-{at} 0 0.035"', f"{-axis} 0 0", 0.0, 0.03, '<mimic joint="jaw"/>')
        + joint("end", "palm tip", 'xyz="0 0 0.075"')
    )


JAWS = jaws(0.005, 1)
CUP = (
    link("pipe", "0 0 0.05", 'cylinder radius="0.015" length="0.1"')
    + link("tip", "", "")
    + joint("mount", "flange pipe", "")
    + joint("end", "pipe tip", 'xyz="0 0 0.1"')
)
BARE = link("tip", "", "") + joint("end", "flange tip", 'xyz="0 0 0.01"')


def scara(folder: Path, hand: str) -> pp.Arm:
    """An arm with four joints and a hand, without an SRDF and a home."""
    links = (
        link("base", "0 0 0.15", 'cylinder radius="0.07" length="0.3"')
        + link("upper", "0.15 0 0.03", 'box size="0.38 0.08 0.05"')
        + link("fore", "0.12 0 0.03", 'box size="0.32 0.07 0.05"')
        + link("quill", "0 0 0.1", 'cylinder radius="0.012" length="0.4"')
        + link("flange", "0 0 0", 'cylinder radius="0.02" length="0.01"')
    )
    joints = (
        joint("j1", "base upper", 'xyz="0 0 0.3"', "0 0 1", -2.6, 2.6)
        + joint("j2", "upper fore", 'xyz="0.3 0 0.055"', "0 0 1", -2.5, 2.5)
        + joint("j3", "fore quill", 'xyz="0.25 0 -0.07"', "0 0 1", -0.05, 0.1)
        + joint("j4", "quill flange", 'xyz="0 0 -0.11" rpy="3.141592653589793 0 0"', "0 0 1", -6.2, 6.2)
    )
    (folder / "scara.urdf").write_text(f'<robot name="own">{links}{joints}{hand}</robot>')
    return pp.load_robot(folder / "scara.urdf").arm("tip")


def mesh_file(folder: Path, name: str, mesh: trimesh.Trimesh) -> Path:
    mesh.export(folder / name)
    return folder / name


def piece(folder: Path, mesh: trimesh.Trimesh, unit: str | None = None) -> Workpiece:
    return Workpiece.read(mesh_file(folder, "part.stl", mesh), folder, most=1.0, unit=unit)


@pytest.fixture(scope="module", autouse=True)
def few_proposals() -> Iterator[None]:
    """The grasps of a part are chosen among a tenth of the proposals."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pinproof.cell.starting.new_cell.PROPOSED", 200)
        yield


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> NewCell:
    """A cell of a UR5 with an assumed cup and two parts of each of two types, one of which is in millimetres."""
    folder = tmp_path_factory.mktemp("files")
    parts = [
        mesh_file(folder, "block.stl", trimesh.creation.box((0.05, 0.03, 0.03))),
        mesh_file(folder, "plate.stl", trimesh.creation.box((60.0, 40.0, 8.0))),
    ]
    return new_cell("ur5", parts, folder=folder / "cell", count=2)


def placed_vertices(cell: NewCell, name: str, pose: pp.spatial.SE3) -> np.ndarray:
    mesh = cell.scene[name].shape
    points = trimesh.load(mesh.path).vertices * np.asarray(mesh.scale)
    return points @ pose.rotation.T + pose.translation


# -- files ------------------------------------------------------------------------------------------------------------


def test_the_files_pass_their_schemas_and_load_again_with_equal_meaning(made: NewCell) -> None:
    for name, kind in {"picks.yaml": "picks", "scene.yaml": "scene", "tool.yaml": "tool"}.items():
        text = (made.folder / name).read_text()
        jsonschema.validate(yaml.safe_load(text), pp.formats.file_schema(kind))
    picks = pp.read_picks(made.folder / "picks.yaml")
    assert picks == made.picks
    assert picks.load_scene() == made.scene
    assert not picks.problems
    np.testing.assert_array_equal(picks.home_configuration(made.arm.joint_names, made.arm.home), made.home)
    assert {path.name for path in made.folder.parent.iterdir()} == {"block.stl", "plate.stl", "cell"}


def test_the_grasps_of_a_part_differ(made: NewCell) -> None:
    for part in made.picks.parts.values():
        poses = [grasp.pose.homogeneous for grasp in part.grasps]
        apart = [np.abs(one - other).max() for k, one in enumerate(poses) for other in poses[:k]]
        assert min(apart, default=1.0) > 1e-9


def test_every_key_that_was_assumed_has_a_comment(made: NewCell) -> None:
    assumed = {"picks.yaml": ("margin", "home", "  block", "defaults"), "tool.yaml": ("tool", "cup", "tip")}
    for name, keys in assumed.items():
        lines = (made.folder / name).read_text().splitlines()
        for key in keys:
            number = next(k for k, line in enumerate(lines) if line.startswith(f"{key}:"))
            assert lines[number - 1].lstrip().startswith("#")
    scene = (made.folder / "scene.yaml").read_text().splitlines()
    assert all(scene[k - 1].startswith("  #") for k, line in enumerate(scene) if line.startswith("  - "))


def test_parts_rest_on_the_table_and_their_places_on_the_tray_without_overlap(made: NewCell) -> None:
    table, tray = made.scene["table"], made.scene["tray"]
    for where, on in (("at", table), ("to", tray)):
        outlines = []
        for pick in made.picks:
            assert pick.place is not None
            pose = made.scene[pick.name].pose if where == "at" else pick.place.pose
            points = placed_vertices(made, pick.name, pose)
            top = on.pose.translation[2] + on.shape.z / 2
            assert 0.0 < points[:, 2].min() - top < 1e-3
            local = (points - on.pose.translation) @ on.pose.rotation
            assert (np.abs(local[:, :2]) < [on.shape.x / 2, on.shape.y / 2]).all()
            outlines.append(points[ConvexHull(points[:, :2]).vertices, :2])
        for k, one in enumerate(outlines):
            for other in outlines[k + 1 :]:
                assert np.linalg.norm(one[:, None] - other[None], axis=2).min() > 0.02
                assert not (Delaunay(one).find_simplex(other) >= 0).any()


def test_the_home_is_free_and_the_picks_are_good(made: NewCell) -> None:
    assert pp.CollisionChecker(made.arm, made.scene, attached=Tool.load(made.folder / "tool.yaml").open_tool).is_free(
        made.home
    )
    report = pp.validate_picks(made.arm, made.scene, made.picks, rng=0)
    assert len(report.good) == 4


def test_the_command_makes_a_cell_of_an_own_robot_with_fingers_and_an_srdf(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scara(tmp_path, JAWS)
    mesh_file(tmp_path, "block.stl", trimesh.creation.box((40.0, 25.0, 20.0)))
    code, out, _ = run_main("new", "cell", "scara.urdf", "block.stl", "--tcp", "tip", "-o", "made")
    assert code == 0, out
    picks = pp.read_picks("made/picks.yaml")
    assert picks.load_arm().held["jaw"] == 0.03
    assert picks.srdf is not None
    assert {pair.reason for pair in pp.load_robot("scara.urdf", srdf=picks.srdf).srdf.disabled} <= {
        "Adjacent",
        "Always",
    }
    assert {path.name for path in (tmp_path / "made" / "report").iterdir()} > {"report.html", "block_1.program.json"}


@pytest.mark.slow
def test_an_equal_seed_gives_equal_files(made: NewCell) -> None:
    parts = [made.folder.parent / name for name in ("block.stl", "plate.stl")]
    again = new_cell("ur5", parts, folder=made.folder.parent / "again" / "cell", count=2)
    for name in ("scene.yaml", "picks.yaml"):
        assert (again.folder / name).read_text().replace("../../", "../") == (made.folder / name).read_text()


# -- parts and bins ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sides", "unit", "metres", "word"),
    [
        ((0.04, 0.012, 0.012), None, 0.04, "metres"),
        ((40.0, 12.0, 12.0), None, 0.04, "millimetres"),
        ((2.0, 1.0, 1.0), "inch", 0.0508, "inches"),
        ((0.9, 0.5, 0.5), "mm", 0.0009, "millimetres"),
    ],
)
def test_the_unit_of_a_mesh_follows_from_its_size_unless_it_is_stated(
    tmp_path: Path, sides: Sequence[float], unit: str | None, metres: float, word: str
) -> None:
    found = piece(tmp_path, trimesh.creation.box(sides), unit)
    assert found.mesh.extents.max() == pytest.approx(metres)
    assert found.described.startswith(f"part.stl: {sides[0]:g} x ")
    assert found.described.endswith(f"taken as {word}")


@pytest.mark.parametrize("seed", range(4))
def test_poses_of_rest_are_stable(tmp_path: Path, seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(12, 3)) * [0.03, 0.02, 0.01]
    part = piece(tmp_path, trimesh.convex.convex_hull(points))
    for rest in part.rests:
        placed = part.mesh.vertices @ rest.plane_from_part.rotation.T + rest.plane_from_part.translation
        assert placed[:, 2].min() == pytest.approx(0.0, abs=1e-9)
        assert placed[:, 2].max() == pytest.approx(rest.height)
        assert np.linalg.norm(placed[:, :2], axis=1).max() == pytest.approx(rest.radius)
        support = placed[placed[:, 2] < 1e-6, :2]
        centre = rest.plane_from_part.act(part.mesh.center_mass)[:2]
        assert Delaunay(support).find_simplex(centre) >= 0


def test_the_facets_of_a_cylinder_are_one_pose_of_rest(tmp_path: Path) -> None:
    side, *_ = piece(tmp_path, trimesh.creation.cylinder(0.01, 0.08, sections=48)).rests
    assert side.share > 0.9
    assert side.height == pytest.approx(0.02, abs=1e-4)


def walls(*more: trimesh.Trimesh) -> trimesh.Trimesh:
    outer, inner = trimesh.creation.box((0.4, 0.6, 0.15)), trimesh.creation.box((0.38, 0.58, 0.15))
    inner.apply_translation((0.0, 0.0, 0.01))
    return trimesh.boolean.union([trimesh.boolean.difference([outer, inner]), *more])


def test_the_free_floor_of_a_bin_is_its_inside_beside_ribs(tmp_path: Path) -> None:
    low, high, floor = free_floor(piece(tmp_path, walls()))
    assert floor == pytest.approx(-0.065)
    np.testing.assert_allclose([low, high], [[-0.19, -0.29], [0.19, 0.29]], atol=0.006)
    rib = trimesh.creation.box((0.38, 0.01, 0.05))
    rib.apply_translation((0.0, 0.1, -0.045))
    low, high, _ = free_floor(piece(tmp_path, walls(rib)))
    np.testing.assert_allclose([low[1], high[1]], [-0.29, 0.095], atol=0.006)


def test_a_bin_that_is_closed_above_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="open upwards"):
        free_floor(piece(tmp_path, trimesh.creation.box((0.4, 0.6, 0.15))))


def test_circles_in_rows_keep_their_gap_and_the_length_of_rows() -> None:
    radii = np.random.default_rng(0).uniform(0.01, 0.05, 12).tolist()
    centres, size = arrange(radii, 0.02, 0.3)
    for k, one in enumerate(centres):
        for m in range(k):
            assert np.linalg.norm(one - centres[m]) >= radii[k] + radii[m] + 0.02 - 1e-12
    reach = np.abs(centres) + np.array(radii)[:, None]
    assert (reach <= size / 2 + 1e-12).all()
    assert size[1] <= 0.3


# -- robots -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("at", "axis", "value"), [(0.005, 1, 0.03), (0.035, -1, 0.0)])
def test_fingers_are_open_where_they_are_farthest_apart(tmp_path: Path, at: float, axis: int, value: float) -> None:
    arm = scara(tmp_path, jaws(at, axis))
    hand = recognise_hand(arm, 0.02)
    assert hand.keys == {"held": {"jaw": {"open": value}}, "gripper": ["palm"]}
    assert hand.opening == pytest.approx(0.06, abs=1e-6)


def test_a_link_on_the_flange_that_ends_at_the_tcp_is_a_cup(tmp_path: Path) -> None:
    hand = recognise_hand(scara(tmp_path, CUP), 0.02)
    assert set(hand.keys) == {"gripper", "cup", "tip"}
    np.testing.assert_allclose(hand.keys["tip"]["xyz"], 0.0, atol=1e-6)
    assert hand.keys["cup"]["radius"] == pytest.approx(0.015, rel=0.05)


def test_a_bare_flange_is_given_a_lance_for_the_narrowest_part(tmp_path: Path) -> None:
    hand = recognise_hand(scara(tmp_path, BARE), 0.02)
    assert hand.keys["cup"] == {"radius": 0.005}
    assert hand.keys["tip"]["xyz"] == [0.0, 0.0, 0.1]


def test_the_approach_is_the_axis_along_which_the_tool_points_away_from_the_arm() -> None:
    keys = recognise_hand(pp.load_robot("ur5").arm("ee_link"), 0.02).keys  # its x axis points away
    np.testing.assert_allclose(pp.pose(**keys["tip"]).rotation[:, 2], [1.0, 0.0, 0.0], atol=1e-8)


def test_the_points_of_a_hand_contain_its_fingers_at_any_opening(tmp_path: Path) -> None:
    arm = scara(tmp_path, JAWS)
    still, moving = hand_points(arm.with_held({"jaw": 0.03}), Tool(held={"jaw": 0.03}, grip={"jaw": None}))
    fingers = still[still[:, 2] > -0.0401]
    assert np.abs(fingers[:, 0]).min() == pytest.approx(0.03)
    assert np.abs(moving[moving[:, 2] > -0.0401][:, 0]).min() == pytest.approx(0.0, abs=1e-9)


def test_an_arm_without_a_home_is_given_one_above_an_area_that_it_reaches(tmp_path: Path) -> None:
    arm, size = scara(tmp_path, JAWS).with_held({"jaw": 0.03}), np.array([0.1, 0.2])
    checker = pp.CollisionChecker(arm)
    areas = work_areas(checker, pp.spatial.SE3.Identity(), size, 0.05, 0.05, 0)
    low, high = fixed_box(arm)
    assert areas
    for area in areas:
        corners = np.array([area.act(np.array([x, y, 0.0])) for x in (-0.05, 0.05) for y in (-0.1, 0.1)])
        assert (corners[:, :2].max(axis=0) < low[:2]).any() or (corners[:, :2].min(axis=0) > high[:2]).any()
        for corner in corners:  # independent of the grid on which they were searched
            for above in (0.02, 0.07):
                target = pp.pose(corner + np.array([0.0, 0.0, above]), (np.pi, 0, 0))
                assert pp.AnalyticIk().solve_all(arm, target).free(checker.is_free)
    home, why = find_home(checker, pp.spatial.SE3.Identity(), areas[0], 0.05, 0) or (None, "")
    assert home is not None
    assert why.startswith("found")
    assert checker.is_free(home)
    assert not arm.limits.violations(home, arm.joint_names)
    assert arm.forward_kinematics(home).translation[2] > areas[0].translation[2] + 0.05 - 1e-3


# -- bad input --------------------------------------------------------------------------------------------------------


def test_an_open_mesh_and_an_empty_file_are_refused_by_name(tmp_path: Path) -> None:
    box = trimesh.creation.box((0.05, 0.03, 0.03))
    box.update_faces(np.arange(len(box.faces)) > 0)
    open_mesh = mesh_file(tmp_path, "open.stl", box)
    (tmp_path / "empty.stl").write_text("solid empty\nendsolid empty\n")
    for file, reason in ((open_mesh, "3 edges"), (tmp_path / "empty.stl", "triangle")):
        with pytest.raises(MeshError, match=reason) as caught:
            new_cell("ur5", [file], folder=tmp_path / "cell")
        assert file.name in str(caught.value)
        assert not (tmp_path / "cell").exists()
    assert {path.name for path in tmp_path.iterdir()} == {"open.stl", "empty.stl"}


def test_a_folder_with_files_is_not_overwritten(tmp_path: Path) -> None:
    block = mesh_file(tmp_path, "block.stl", trimesh.creation.box((0.05, 0.03, 0.03)))
    with pytest.raises(FileError, match="not an empty folder"):
        new_cell("ur5", [block], folder=tmp_path)


def test_a_robot_without_collision_geometry_is_refused(tmp_path: Path) -> None:
    block = mesh_file(tmp_path, "block.stl", trimesh.creation.box((0.05, 0.03, 0.03)))
    (tmp_path / "bare.urdf").write_text(
        '<robot name="bare"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
        '<child link="b"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    with pytest.raises(InputError, match="no collision geometry"):
        new_cell(tmp_path / "bare.urdf", [block], folder=tmp_path / "cell", tcp="b")


def test_a_tcp_whose_z_axis_is_not_that_of_the_tool_is_explained(tmp_path: Path) -> None:
    block = mesh_file(tmp_path, "block.stl", trimesh.creation.box((0.02, 0.02, 0.03)))
    with pytest.raises(InputError, match=r"y axis.*rpy"):
        new_cell("so100", [block], folder=tmp_path / "cell")


def test_fingers_without_collision_geometry_are_refused(tmp_path: Path) -> None:
    block = mesh_file(tmp_path, "block.stl", trimesh.creation.box((0.02, 0.02, 0.03)))
    (tmp_path / "jaw.yaml").write_text("tip: {xyz: [0, -0.09, 0], rpy: [pi/2, 0, 0]}\nheld: {gripper: {open: 1.0}}\n")
    made = new_cell("so100", [block], folder=tmp_path / "cell", tool=tmp_path / "jaw.yaml")
    with pytest.raises(InputError, match=r"gripper moves no link with collision geometry \(jaw\)"):
        pp.validate_picks(made.arm, made.scene, made.picks)


def test_a_part_that_is_too_wide_for_the_hand_is_refused_with_its_unit(tmp_path: Path) -> None:
    wide = mesh_file(tmp_path, "wide.stl", trimesh.creation.box((0.2, 0.2, 0.2)))
    scara(tmp_path, JAWS)
    with pytest.raises(InputError, match="wide") as caught:
        new_cell(tmp_path / "scara.urdf", [wide], folder=tmp_path / "cell", tcp="tip")
    assert "taken as metres" in str(caught.value)


def test_more_parts_than_the_bin_holds_are_refused(tmp_path: Path) -> None:
    block = mesh_file(tmp_path, "block.stl", trimesh.creation.box((0.09, 0.09, 0.09)))
    with pytest.raises(InputError, match="40 parts do not fit"):
        new_cell("ur5", [block], folder=tmp_path / "cell", bin=mesh_file(tmp_path, "bin.stl", walls()), count=40)


@pytest.mark.parametrize("name", ["1", "ring#1: a's"])
def test_names_that_yaml_reads_as_other_values_remain_names(tmp_path: Path, name: str) -> None:
    arm = pp.load_robot("ur5").arm()
    piece = Workpiece.read(
        mesh_file(tmp_path, f"{name}.stl", trimesh.creation.box((30, 30, 30))), tmp_path, most=1.0, unit=None
    )
    tool = Tool(cup=pp.picks.SuctionCup(radius=0.005), tip=pp.pose((0, 0, 0.1)))
    text, _ = _part_type(piece, tool, arm, hand_points(arm, tool), 2700.0, 0)
    assert list(yaml.safe_load(text)) == [piece.name]
