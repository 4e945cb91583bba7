"""Files of tool paths: the strokes that they state, the frames of their poses, and what is refused with which line."""

import inspect
import json

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import FileError, ToolPathError
from pinproof.tool_paths import Stroke, ToolJob, ToolPath, read_tool_paths

SQUARE = [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0], [0, 0, 0]]
UP = (0.0, 0.0, 1.0)


def job_of(folder, *strokes, **keys):
    file = folder / "job.json"
    file.write_text(json.dumps({"robot": "ur5", **keys, "strokes": list(strokes)}))
    return read_tool_paths(file)


def test_the_poses_are_those_of_the_tip_in_the_base_frame(tmp_path):
    tip, part = {"xyz": [0, 0.05, 0.1], "rpy": [0.4, 0, 0]}, {"xyz": [0.4, 0.1, 0.2], "rpy": [0, 0, 0.5]}
    stroke = {"name": "a", "points": SQUARE, "normals": UP}
    tool = [{"name": "rod", "sphere": {"radius": 0.01}, "xyz": [0, 0, 0.05]}]
    job = job_of(tmp_path, stroke, tip=tip, tool=tool, frames={"part": part}, frame="part", speed=0.1)
    checker = job.load_checker()
    (placed,) = job.placed(checker)
    base_from_part = checker.arm.root_from_base.inverse() * pp.pose(**{k: tuple(v) for k, v in part.items()})
    assert placed.path.poses[:, :3, 3] == pytest.approx(
        np.array(SQUARE) @ base_from_part.rotation.T + base_from_part.translation
    )
    # The tcp of the arm is the tip, and the body of the tool stays where the flange has it
    flange, q = pp.load_robot("ur5").arm(), np.array([0.1, -1.0, 1.2, 0.3, 0.4, 0.5])
    expected = flange.forward_kinematics(q) * pp.pose(tuple(tip["xyz"]), tuple(tip["rpy"]))
    assert checker.arm.forward_kinematics(q).isApprox(expected, 1e-9)
    (rod,) = checker.attached
    rod_in_base = checker.arm.forward_kinematics(q) * rod.pose
    assert rod_in_base.translation == pytest.approx(flange.forward_kinematics(q).act(np.array([0, 0, 0.05])))
    assert pp.follow(checker, placed.path, **job.options).ok


def test_the_defaults_of_a_job_are_those_of_follow():
    stated = inspect.signature(pp.follow).parameters
    for name, value in ToolJob(strokes=()).options.items():
        assert (
            value == pytest.approx(stated[name].default) if isinstance(value, float) else value == stated[name].default
        )


@pytest.mark.parametrize(
    ("text", "unit", "scale", "noted"),
    [
        ("x,y,z,nx,ny,nz\n0,0,0,0,0,1\n100,0,0,0,0,2\n100,100,0,0,0,1\n", None, 1e-3, True),
        ("x [mm],y [mm],z [mm],nx,ny,nz\n0,0,0,0,0,1\n100,0,0,0,0,1\n100,100,0,0,0,1\n", None, 1e-3, False),
        ("x,y,z,nx,ny,nz\n0,0,0,0,0,1\n100,0,0,0,0,1\n100,100,0,0,0,1\n", "in", 0.0254, False),
        ("# seam\nx,y,z,qx,qy,qz,qw\n0,0,0,1,0,0,0\n100,0,0,1,0,0,0\n\n100,100,0,1,0,0,0\n", "mm", 1e-3, False),
        ("x,y,z,roll,pitch,yaw\n0,0,0,pi,0,0\n100,0,0,pi,0,0\n100,100,0,pi,0,0\n", "mm", 1e-3, False),
    ],
)
def test_tables_state_their_unit_or_it_is_recognised_and_noted(tmp_path, text, unit, scale, noted):
    (tmp_path / "a.csv").write_text(text)
    (stroke,) = job_of(tmp_path, {"file": "a.csv", **({"unit": unit} if unit else {})}).strokes
    assert stroke.name == "a"
    assert stroke.path.poses[:, :3, 3] == pytest.approx(scale * np.array([[0, 0, 0], [100, 0, 0], [100, 100, 0]]))
    assert stroke.path.poses[:, :3, 2] == pytest.approx(np.tile([0, 0, -1], (3, 1)))
    assert any("millimetres" in note for note in stroke.path.notes) is noted


def test_names_and_speeds_of_a_table_are_those_of_its_lines(tmp_path):
    (tmp_path / "a.csv").write_text("name,x,y,z,speed\np,0,0,0,1\nq,0.1,0,0,0.2\nr,0.2,0,0,0.3\n")
    (stroke,) = job_of(tmp_path, {"file": "a.csv", "normals": UP, "name": "seam"}, speed=0.5).strokes
    assert (stroke.name, stroke.path.names) == ("seam", ("p", "q", "r"))
    assert stroke.path.speed == pytest.approx([0.2, 0.3])


def test_a_json_file_states_points_or_poses(tmp_path):
    (tmp_path / "a.json").write_text(json.dumps({"points": [[0, 0, 0], [50, 0, 0]], "normals": UP, "unit": "mm"}))
    (tmp_path / "b.json").write_text(json.dumps({"poses": [{"rpy": ["pi", 0, 0]}, {"xyz": [2, 0, 0]}], "unit": "in"}))
    a, b = job_of(tmp_path, {"file": "a.json", "speed": 0.2}, {"file": "b.json", "process": False}).strokes
    assert (a.path.length, a.path.speed, a.process, b.process) == (pytest.approx(0.05), [0.2], True, False)
    assert b.path.length == pytest.approx(0.0508)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.csv", "x,y,z,nx,ny,nz\n0,0,0,0,0,1\n1,nan,0,0,0,1\n", "line 3"),
        ("a.csv", "x,y,z,nx,ny,nz\n0,0,0,0,0,1\n1,0,0,0,0,0\n", "line 3: the normal has length 0"),
        ("a.csv", "x,y,z,nx,ny,nz\n0,0,0,0,0,1\n1,0,0,0,0\n", "line 3.*5 cells under 6 columns"),
        ("a.csv", "x;y;z\n0;0;0\n", "semicolons"),
        ("a.csv", "x,y,w\n0,0,0\n", "line 1.*'w'"),
        ("a.csv", "x,y\n0,0\n", "lacks the column z"),
        ("a.csv", "x,y,z,nx\n0,0,0,1\n", "lacks the column ny"),
        ("a.csv", "x [mm],y,z\n0,0,0\n", "one unit"),
        ("a.csv", "x [km],y [km],z [km]\n0,0,0\n", "one unit"),
        ("a.csv", "x,y,z,nx,ny,nz,speed [mm/s]\n0,0,0,0,0,1,5\n1,0,0,0,0,1,5\n", "line 1.*speed in 'mm/s'.*m/s"),
        ("a.csv", "x,y,z,roll [deg],pitch [deg],yaw [deg]\n0,0,0,3,0,0\n1,0,0,3,0,0\n", "roll in 'deg'.*rad"),
        ("a.csv", "x,y,z\n0,0,0\n1,0,0\n", "normals"),
        ("a.csv", "x,y,z,roll,pitch,yaw\n0,0,0,180,0,0\n1,0,0,180,0,0\n", "degrees"),
        ("a.csv", "", "no poses"),
        ("a.csv", "x,y,z,nx,ny,nz\n", "no poses"),
        ("a.json", '{"points": [[0, 0, 0]], "normal": [0, 0, 1]}', "unknown key 'normal'"),
        ("a.json", '{"unit": "m"}', "no path"),
        ("a.json", '{"points": [[0, 0, 0], [1, 0, 0]]}', "without normals"),
        ("a.json", '{"points": [[0, 0, 0], [500, 0.5, 0]], "normals": [0, 0, 1], "unit": "m"}', "500"),
        ("a.json", '{"points": [[0, 0, 0], [1, 0]], "normals": [0, 0, 1]}', "points"),
        ("a.json", "{", "not valid"),
        ("a.xyz", "", "unknown file type '.xyz'.*csv"),
    ],
)  # fmt: skip
def test_unusable_files_of_paths_are_refused_with_their_line(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises(ToolPathError, match=words):
        job_of(tmp_path, {"file": name})


@pytest.mark.parametrize(
    ("stroke", "keys", "words"),
    [
        ({"points": SQUARE}, {}, "without normals"),
        ({"points": SQUARE, "normals": UP, "poses": [{}]}, {}, "one of poses, points"),
        ({"name": "a"}, {}, "one of poses, points"),
        ({"poses": [{}, {"xyz": [0.1, 0, 0]}], "normals": UP}, {}, "normals for poses"),
        ({"points": [[0, 0, 0], [0, float(10**9), 0]], "normals": UP}, {}, "mm"),
        ({"points": SQUARE[:3], "normals": UP, "closed": True}, {}, "first and the last pose of its path differ"),
        ({"points": SQUARE, "normals": UP, "unit": "mm"}, {}, "in metres"),
        ({"points": SQUARE, "normals": [UP, UP]}, {}, "2 normals for 5 points"),
        ({"points": SQUARE, "normals": [0, 0, 0]}, {}, "normal 0 has length 0"),
        ({"points": SQUARE, "normals": UP}, {"cost": "cheap"}, "cheap.*balanced"),
        ({"points": SQUARE, "normals": UP}, {"speed": 50}, "mm/s"),
        ({"points": SQUARE, "normals": UP}, {"deviation": 0}, "deviation"),
        ({"points": SQUARE, "normals": UP}, {"approach": 50}, "line .*approach.*at most 10.*mm"),
        ({"points": SQUARE, "normals": UP}, {"free_rotation": [1, 0]}, "line .*free_rotation.*smaller angle first"),
        ({"points": SQUARE, "normals": UP}, {"rotation": 1}, "unknown key 'rotation'.*rotations"),
        ({"file": "none.csv"}, {}, "there is no file"),
    ],
)  # fmt: skip
def test_unusable_jobs_are_refused_by_name(tmp_path, stroke, keys, words):
    with pytest.raises(ToolPathError, match=words):
        job_of(tmp_path, stroke, **keys)


def test_two_strokes_of_one_name_are_refused(tmp_path):
    stroke = {"name": "a", "points": SQUARE, "normals": UP}
    with pytest.raises(ToolPathError, match=r"strokes\[1\].*second stroke is named 'a'"):
        job_of(tmp_path, stroke, stroke)


def test_an_unknown_frame_is_named_with_the_valid_ones(tmp_path):
    job = job_of(tmp_path, {"points": SQUARE, "normals": UP}, frame="tabel", frames={"table": {}})
    with pytest.raises(ToolPathError, match=r"line 1, column \d+, key frame: unknown frame 'tabel'; valid: table"):
        job.placed(job.load_checker())


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("redundant", {"elbow": [0.1]}, "unknown redundant joint 'elbow'"),
        ("home", {"elbow": 0.1}, "names elbow"),
        ("part", [{"name": "part", "sphere": {"radius": 0.1}}], "no joint outside the arm does"),
    ],
)
def test_what_needs_the_robot_to_be_checked_is_refused_with_its_line(tmp_path, key, value, words):
    job = job_of(tmp_path, {"points": SQUARE, "normals": UP}, **{key: value})
    with pytest.raises(FileError, match=rf"line 1, column \d+, key {key}: .*{words}"):
        pp.tool_paths.follow_job(job)


def test_a_frame_that_follows_a_joint_of_the_arm_is_refused_with_its_line(tmp_path):
    table = (
        '<link name="table"/><joint name="table" type="revolute"><parent link="base_link"/><child link="table"/>'
        '<axis xyz="0 0 1"/><limit lower="-9" upper="9" velocity="3" effort="1"/>'
        '<mimic joint="shoulder_pan_joint" multiplier="0.5"/></joint></robot>'
    )
    text = pp.load_robot("ur5").urdf.text
    (tmp_path / "robot.urdf").write_text(text.replace("</robot>", table))
    stroke, part = {"points": SQUARE, "normals": UP}, [{"name": "part", "sphere": {"radius": 0.1}}]
    for bodies in ({}, {"part": part}):
        job = job_of(tmp_path, stroke, robot="robot.urdf", tcp="tool0", frame="table", **bodies)
        with pytest.raises(ToolPathError, match=r"line 1, .* key frame: .*joint table follows shoulder_pan_joint"):
            pp.tool_paths.follow_job(job)


def test_a_tip_is_added_to_an_arm_whose_fingers_follow_each_other(tmp_path):
    stroke = {"points": SQUARE, "normals": UP}
    job = job_of(tmp_path, stroke, robot="panda", held={"panda_finger_joint1": 0.02}, tip={"xyz": [0, 0, 0.1]})
    arm = job.load_arm()
    assert (arm.tcp, arm.held["panda_finger_joint2"]) == ("tool_tip", 0.02)


def test_a_closed_stroke_may_start_anywhere_and_be_reversed():
    points = np.add(SQUARE, [0.4, 0, 0.2])
    stroke = Stroke("a", ToolPath.through(points, UP, speed=[0.1, 0.2, 0.3, 0.4], names="abcde"), closed=True)
    turned = stroke.variant(2)
    assert turned.path.poses[:, :3, 3] == pytest.approx(points[[2, 3, 0, 1, 2]])
    assert turned.path.speed == pytest.approx([0.3, 0.4, 0.1, 0.2])
    assert turned.path.names == ("c", "d", "a", "b", "c")
    back = stroke.variant(2, reverse=True)
    assert back.path.poses[:, :3, 3] == pytest.approx(points[[2, 1, 0, 3, 2]])
    assert back.path.speed == pytest.approx([0.2, 0.1, 0.4, 0.3])
    once = Stroke("b", ToolPath.through(points[:3], UP), reversible=False)
    for change in ({"start": 1}, {"reverse": True}):
        with pytest.raises(pp.InputError, match="'b' is not"):
            once.variant(**change)
