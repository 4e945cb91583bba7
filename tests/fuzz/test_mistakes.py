"""What those who begin with it get wrong: each is answered by the file, the place, and what would be right."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import pytest
import trimesh

import pinproof as pp

JOINT = '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>{}</joint>'
ROBOT = '<robot name="r"><link name="a"/><link name="b">{}</link>' + JOINT + "</robot>"
LIMIT = '<limit lower="-1" upper="1" velocity="1"/>'
SCENE = "obstacles:\n  - {{name: a, {}}}\n"
PICK = "picks:\n  - {{name: a, {}}}\n"
HEAD = "name,x,y,z,roll,pitch,yaw\n"
DH = "# convention: standard\nname,theta,d,a,alpha,lower,upper\n"


def mesh(file: str) -> str:
    return ROBOT.format(f'<collision><geometry><mesh filename="{file}"/></geometry></collision>', LIMIT)


def said_of(path: Path) -> str:
    """The message about a file: for picks also its unreadable rows, for robots also their notes."""
    try:
        if path.suffix == ".urdf":
            robot = pp.load_robot(path)
            robot.arm(tcp="b")
            return "\n".join(robot.notes)
        if path.name.startswith("picks"):
            return "\n".join(problem.reason for problem in pp.read_picks(path).problems)
        if path.name.startswith("scene"):
            return "\n".join(pp.Scene.load(path).notes)
        {"dh": pp.DhTable, "motion": pp.Trajectory}[path.stem].load(path)
    except pp.FileError as error:
        data = str(error)
        return data.removeprefix(f"{path}: ") if data.startswith(str(path)) else f"without its file: {data}"
    except pp.InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    ("name", "text", "stated"),
    [
        # degrees
        ("scene.yaml", SCENE.format("box: [1, 1, 1], rpy: [0, 0, 90]"), "line 2.*'a'.*radians, 90 degrees = 1.57"),
        ("picks.yaml", PICK.format("xyz: [0.4, 0, 0], rpy: [180, 0, 0]"), "line 2.*180 degrees = 3.14"),
        ("picks.csv", f"{HEAD}a,0.4,0,0,180,0,0\n", "180 degrees = 3.14"),
        ("picks.yaml", PICK.format("xyz: [0.4, 0, 0], rpy: [180deg, 0, 0]"), "'180deg' is not a number; write .*pi"),
        ("dh.csv", f"{DH}a,0,0.1,0,90,,\n", "row 1, column alpha.*90 degrees = 1.57"),
        ("dh.csv", f"{DH}a,0,0.1,0,0,-170,170\n", "row 1, column lower.*-170 degrees = -2.96"),
        ("r.urdf", ROBOT.format("", '<limit lower="-180" upper="180"/>'), "joint 'j': -180 rad is 29 full.*-3.14"),
        # millimetres
        ("scene.yaml", SCENE.format("box: [1, 1, 1], xyz: [400, 0, 300]"), "'a' is 400 m away; lengths are in metres"),
        ("picks.csv", f"{HEAD}a,460,150,35,pi,0,0\n", "460 mm = 0.46"),
        ("dh.csv", f"{DH}a,0,330,0,0,,\nb,0,0,425,0,,\n", "425 mm = 0.425"),
        ("dh.csv", f"{DH.replace('theta', 'type,theta', 1)}a,prismatic,0,0,0,0,-500,500\n", "column upper: 500 m is"),
        (
            "r.urdf",
            ROBOT.replace("revolute", "prismatic").format("", '<limit lower="0" upper="500"/>'),
            "joint 'j': 500 m is too long",
        ),
        # commas, tabs, encodings
        ("picks.csv", f"{HEAD}a,0,46,0,15,0,035,3,14,0,0\n", "11 cells under 7 columns; decimals have a point"),
        ("picks.csv", f'{HEAD}a,"0,46",0,0,pi,0,0\n', "'0,46' is not a number: use a decimal point"),
        ("picks.csv", "name;x;y;z\na;0,46;0;0\n", "line 1: .*separated by semicolons; save the file with commas"),
        ("dh.csv", "# convention: standard\nname\ttheta\td\n", "header: columns are separated by tabs"),
        ("dh.csv", f'{DH}a,0,"0,33",0,0,,\n', "row 1, column d: '0,33' is not a number.*decimal point"),
        ("scene.yaml", SCENE.format("sphere: {radius: 0,1}"), "sphere.1: unknown key 1; .*use a decimal point"),
        ("scene.yaml", "obstacles:\n\t- name: a\n", "line 2: .*indent with spaces"),
        ("scene.yaml", "obstacles: []\n".encode("utf-16"), "looks like UTF-16.*save it as UTF-8"),
        ("picks.csv", HEAD.encode("utf-16"), "line 1: is UTF-16 text; save it as UTF-8"),
        ("scene.yaml", "obstacles:\n- {name: Töpfe}\n".encode("latin-1"), "line 2: is not UTF-8 text"),
        # names and keys
        ("scene.yaml", SCENE.format("box: [1, 1, 1], quat_wxyz: [1, 0, 0, 0]"), "'quat_wxyz'; valid: quat_xyzw"),
        ("scene.yaml", SCENE.format("box: [1, 1, 1], position: [1, 0, 0]"), "'position'; valid: .*xyz"),
        ("scene.yaml", "obstacles:\n  name: a\n", "key obstacles: .* not a list; write '- ' before each"),
        ("scene.yaml", SCENE.format("sphere: 0.1"), "line 2.*write sphere: {radius: ...}"),
        ("scene.yaml", SCENE.format("box: {x: 1, y: 1, z: 1}"), r"line 2.*box: \[x, y, z\]"),
        ("scene.yaml", SCENE.format("mesh: {path: part.stl}"), "there is no file .*relative to this file"),
        ("picks.yaml", PICK.format("xyz: [0.4, 0, 0]"), "line 2, column 5: states no orientation.*rpy or quat_xyzw"),
        ("picks.yaml", PICK.replace("a,", "1,").format("xyz: [0, 0, 0]"), "put it in quotes"),
        ("dh.csv", DH.replace("standard", "craig") + "a,0,0,0,0,,\n", "unknown convention 'craig'.*; valid: modified"),
        ("dh.csv", "name,theta,d,a,alpha\na,0,0,0,0\n", "add 'convention: standard' or 'convention: modified'"),
        ("dh.yaml", "rows: [{name: a, theta: 010, d: 0, a: 0, alpha: 0}]\n", "line 1.*'010' is ambiguous in YAML"),
        # robots
        ("r.urdf", ROBOT.format("", ""), r"joint 'j' states no lower and upper limit; .*limits={'j'"),
        ("r.urdf", mesh("package://my/x.stl"), "1 collision mesh was not found: package://my/x.stl"),
        ("r.urdf", mesh("meshes\\x.stl"), "not found: .*use / in paths"),
        ("r.urdf", ROBOT.format("", LIMIT)[:50], "line 1: is not well-formed XML"),
        ("r.urdf", '<robot xmlns:x="http://ros.org/xacro"><x:arg name="a"/></robot>', "xacro elements.*expand it"),
        ("r.urdf", "<sdf/>", "the root element is <sdf>, not <robot>"),
        # motions
        (
            "motion.json",
            '{"joint_names": ["a"], "points": [{"positions": [0], "time_from_start": 0}]}',
            r"points\[0\]: lacks velocities.*time_parametrise",
        ),
    ],
)  # fmt: skip
def test_answer_names_place_and_remedy(tmp_path, name, text, stated):
    file = tmp_path / name
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    answer = said_of(file)
    assert re.search(stated, answer), answer
    assert "\n" not in answer


@pytest.mark.parametrize("ends", ["\r\n", "\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_line_ends_and_marks_of_windows_are_read(tmp_path, ends, mark):
    texts = {
        "scene.yaml": SCENE.format("box: [1, 1, 1]"),
        "picks.yaml": PICK.format("xyz: [0.4, 0, 0], rpy: [pi, 0, 0]"),
        "picks.csv": f"{HEAD}a,0.4,0,0,pi,0,0\n",
        "dh.csv": f"{DH}a,0,0.1,0,0,,\n",
        "r.urdf": ROBOT.format("", LIMIT),
    }
    for name, text in texts.items():
        (tmp_path / name).write_bytes((mark + text.replace("\n", ends)).encode())
        assert said_of(tmp_path / name) == ""


def test_mesh_in_millimetres_that_reaches_beyond_all_arms(tmp_path):
    trimesh.creation.box((30_000, 1, 1)).export(tmp_path / "part.stl")
    with pytest.raises(pp.errors.MeshError, match=r"extends to 15000 m.*millimetres is 0\.001"):
        pp.CollisionChecker(
            pp.load_robot("scara").arm(), pp.Scene([pp.Obstacle("part", pp.Mesh(tmp_path / "part.stl"))])
        )


def test_ground_as_wide_as_a_hall_is_a_box(tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE.format("box: [200, 200, 1], xyz: [0, 0, -0.5]"), encoding="utf-8")
    assert said_of(tmp_path / "scene.yaml") == ""


def test_too_few_joints_and_unknown_frames_are_refused():
    robot = pp.load_robot("scara")
    with pytest.raises(pp.InputError, match=r"4 numbers, not 3.*the arm's joints are "):
        robot.arm().forward_kinematics([0.0] * 3)
    with pytest.raises(pp.UnknownNameError, match=r"unknown frame 'tool'.*valid: tool0"):
        robot.arm(tcp="tool")
    with pytest.raises(pp.UnknownNameError, match=r"unknown robot 'ur5x'.*valid: ur5"):
        pp.load_robot("ur5x")


@pytest.fixture(scope="module")
def given() -> SimpleNamespace:
    arm = pp.load_robot("ur5").arm()
    two = pp.assemble({"left": (arm, pp.pose()), "right": (arm, pp.pose((1.5, 0, 0)))})
    path = pp.JointPath([arm.home, arm.home + 0.1], arm.joint_names)
    return SimpleNamespace(
        arm=arm, checker=pp.CollisionChecker(arm), two=two, of_two=pp.CollisionChecker(two), path=path
    )


@pytest.mark.parametrize(
    ("call", "stated"),
    [
        (lambda g: g.checker.with_scene(None), "scene must be of type Scene, not None"),
        (lambda _: pp.CollisionChecker("ur5"), "arm must be of type JointGroup, not 'ur5'"),
        (lambda _: pp.Scene(["table"]), "must be of type Obstacle, not 'table'"),
        (lambda _: pp.load_robot(None), "source must be a name of the catalogue"),
        (lambda g: pp.certify(None, g.checker), "the curve must be a curve, such as a JointPath"),
        (lambda g: pp.certify(g.path, None), "checker must be of type CollisionChecker"),
        (lambda g: pp.time_parametrise(g.path, None), "limits must be JointLimits, such as arm.limits"),
        (
            lambda g: pp.RrtConnect().plan("x", g.arm.home, g.arm.home),
            "of type CollisionChecker, not 'x'",
        ),
        (lambda _: pp.Clik().solve(None, pp.pose()), "arm must be of type Arm"),
        (lambda g: pp.write_html("x.html", g.arm, "table"), "scene must be of type Scene or None, not 'table'"),
        (lambda g: pp.validate_picks(g.arm, None, None), "picks must be of type Picks or Iterable"),
        (lambda g: pp.cell.allocate(g.two, None, None), "picks must be of type Picks, not None"),
        (lambda g: pp.planning.coordinate(g.of_two, {"left": None}), "motion of 'left'.* type Trajectory"),
        (
            lambda g: pp.planning.plan_arms(g.of_two, g.two.home, g.two.home, planner="x"),
            "planner 'x'.* valid: MODULE:CLASS, rrt_connect",
        ),
    ],
)
def test_an_argument_of_another_type_is_refused_with_the_valid_type(given, call, stated) -> None:
    with pytest.raises(pp.InputError, match=stated):
        call(given)
