"""Files of trajectories: every number comes back, damage is refused with its place, and certificates are recorded."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import pinproof as pp
from pinproof.errors import InputError, TrajectoryError
from pinproof.motion import Trajectory

from ..examples import examples

NAMES = ("slide, long", 'the "turn"')
number = st.floats(allow_nan=False, allow_infinity=False)


@pytest.fixture
def trajectory():
    return Trajectory([0, 0.1, 1 / 3], [[0.1, -0.0], [1 / 3, 2], [1, 1e-300]], np.eye(3, 2) / 7, NAMES, "as\ngiven: é")


def points_of(trajectory):
    points = [trajectory.times, trajectory.q, trajectory.velocities, trajectory.accelerations]
    return [numbers for numbers in points if numbers is not None]


@pytest.mark.parametrize("ending", [".json", ".csv"])
@examples(40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), quintic=st.booleans())
def test_a_saved_trajectory_comes_back_bit_for_bit(tmp_path, ending, data, quintic):
    m = data.draw(st.integers(1, 4))
    clock = np.cumsum([0, *data.draw(st.lists(st.integers(1, 10**12), min_size=m - 1, max_size=m - 1))])
    q = data.draw(arrays(float, (m, 2), elements=number))
    v = data.draw(arrays(float, (m, 2), elements=number)) if m > 1 else np.zeros((1, 2))
    a = (data.draw(arrays(float, (m, 2), elements=number)) if m > 1 else np.zeros((1, 2))) if quintic else None
    saved = Trajectory(clock / 10**9, q, v, NAMES, "as given", accelerations=a)
    saved.save(tmp_path / f"t{ending}")
    loaded = Trajectory.load(tmp_path / f"t{ending}")
    assert (loaded.joint_names, loaded.limits_note) == (NAMES, "as given")
    assert loaded.interpolant == ("quintic" if quintic else "cubic")
    for ours, theirs in zip(points_of(saved), points_of(loaded), strict=True):
        assert ours.tobytes() == theirs.tobytes()


@pytest.mark.parametrize("ending", [".json", ".csv", ".JSON"])
def test_names_and_notes_of_any_spelling_survive_and_columns_are_matched_by_name(tmp_path, trajectory, ending):
    trajectory.save(tmp_path / f"t{ending}")
    loaded = Trajectory.load(tmp_path / f"t{ending}")
    assert (loaded.joint_names, loaded.limits_note) == (NAMES, "as\ngiven: é")
    loaded = Trajectory.load(tmp_path / f"t{ending}", joint_names=NAMES[::-1])
    assert loaded.joint_names == NAMES[::-1]
    np.testing.assert_array_equal(loaded.q, trajectory.q[:, ::-1])
    np.testing.assert_array_equal(loaded.velocities, trajectory.velocities[:, ::-1])
    with pytest.raises(TrajectoryError, match="joint_names"):
        Trajectory.load(tmp_path / f"t{ending}", joint_names=[NAMES[0], "wrist"])


def test_json_is_a_joint_trajectory_message_plus_one_key(tmp_path, trajectory):
    trajectory.save(tmp_path / "t.json")
    data = json.loads((tmp_path / "t.json").read_text(encoding="utf-8"))
    assert set(data) == {"pinproof", "joint_names", "points"}
    assert data["pinproof"]["interpolant"] == "cubic Hermite between points"
    assert set(data["pinproof"]["units"]) == {"positions", "velocities", "time_from_start"}
    assert data["joint_names"] == list(NAMES)
    # no accelerations: with them a controller would rebuild a quintic
    assert {frozenset(point) for point in data["points"]} == {frozenset({"positions", "velocities", "time_from_start"})}
    assert data["points"][2]["time_from_start"] == {"sec": 0, "nanosec": 333333333}


def test_a_quintic_is_stated_with_its_accelerations(tmp_path):
    v, a = np.zeros((2, 2)), np.array([[0.0, 1.0], [2.0, 3.0]])
    Trajectory([0, 1], [[0, 1], [2, 3]], v, NAMES, accelerations=a).save(tmp_path / "t.json")
    data = json.loads((tmp_path / "t.json").read_text(encoding="utf-8"))
    assert data["pinproof"]["interpolant"] == "quintic Hermite between points"
    assert "accelerations" in data["pinproof"]["units"]
    assert [point["accelerations"] for point in data["points"]] == a.tolist()
    for point in data["points"]:
        del point["accelerations"]
    (tmp_path / "t.json").write_text(json.dumps(data))
    with pytest.raises(TrajectoryError, match="interpolant must be 'cubic"):  # the file says what the points do not
        Trajectory.load(tmp_path / "t.json")


def test_a_plain_message_with_empty_optional_lists_is_read(tmp_path):
    point = {"positions": [1], "velocities": [0], "accelerations": [], "effort": []}
    points = [{**point, "time_from_start": {"sec": t, "nanosec": 5 * t}} for t in (0, 2)]
    (tmp_path / "t.json").write_text(json.dumps({"header": {"frame_id": ""}, "joint_names": ["j"], "points": points}))
    loaded = Trajectory.load(tmp_path / "t.json")
    assert loaded.times.tolist() == [0, 2.00000001]
    assert loaded.limits_note == ""


@pytest.mark.parametrize(
    "spelled",
    [{"sec": 1, "nanosec": 250000000}, {"secs": 1, "nsecs": 250000000}, 1.25],
    ids=["ROS 2", "ROS 1", "seconds"],
)
def test_times_are_read_as_either_ros_and_as_plain_seconds(tmp_path, spelled):
    points = [{"positions": [0.0], "velocities": [0.0], "time_from_start": t} for t in (0, spelled)]
    (tmp_path / "t.json").write_text(json.dumps({"joint_names": ["j"], "points": points}))
    assert Trajectory.load(tmp_path / "t.json").times.tolist() == [0.0, 1.25]


ECHO = """header:
  stamp: {sec: 0, nanosec: 0}
  frame_id: ''
joint_names:
- shoulder
- elbow
points:
- positions: [0.1, 1.0e-05]
  velocities: [0.0, 0.0]
  accelerations: []
  effort: []
  time_from_start:
    sec: 0
    nanosec: 0
- positions:
  - 0.5
  - -1.0
  velocities:
  - 0.0
  - 0.25
  time_from_start: {sec: 2, nanosec: 500000000}
---
"""


@pytest.mark.parametrize("ending", [".yaml", ".yml"])
def test_the_output_of_ros2_topic_echo_is_read(tmp_path, ending):
    (tmp_path / f"t{ending}").write_text(ECHO)
    loaded = Trajectory.load(tmp_path / f"t{ending}", ["elbow", "shoulder"])
    assert loaded.times.tolist() == [0.0, 2.5]
    assert loaded.q.tolist() == [[1e-5, 0.1], [-1.0, 0.5]]
    assert loaded.velocities.tolist() == [[0.0, 0.0], [0.25, 0.0]]
    assert loaded.interpolant == "cubic"


def test_fixed_joints_outside_the_arm_are_omitted_on_request(tmp_path):
    q = np.array([[0.0, 5.0, 1.0], [1.0, 5.0, 2.0]])
    Trajectory([0, 1], q, np.zeros((2, 3)), ["a", "finger", "b"]).save(tmp_path / "t.json")
    loaded = Trajectory.load(tmp_path / "t.json", ["b", "a"], subset=True)
    assert loaded.q.tolist() == [[1.0, 0.0], [2.0, 1.0]]
    for names, subset, message in (
        (["b", "a"], False, "subset=True"),
        (["a", "finger"], True, "'b' moves"),
        (["a", "wrist", "b", "finger"], True, r"differ in \['wrist'\]"),
    ):
        with pytest.raises(TrajectoryError, match=message):
            Trajectory.load(tmp_path / "t.json", names, subset=subset)


def good_json():
    point = {"positions": [1.0, 2.0], "velocities": [0.0, 0.0]}
    return {
        "joint_names": ["a", "b"],
        "points": [{**point, "time_from_start": {"sec": t, "nanosec": 0}} for t in range(3)],
    }


META = {
    "version": 1,
    "interpolant": "cubic Hermite between points",
    "units": {"positions": "rad or m", "velocities": "rad/s or m/s", "time_from_start": "s and ns"},
}


def set_at(data, *keys_and_value):
    *keys, last, value = keys_and_value
    for key in keys:
        data = data[key]
    data[last] = value


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("joint_names", ["a", "a"]), "joint_names.*'a' twice"),
        (("joint_names", ["a"]), r"points\[0\].positions: must be a list of 1 numbers.*2 values"),
        (("joint_names", ["a", 3]), r"joint_names: .*\[1\] is 3, not a text"),
        (("joint_names", []), "joint_names: .*at least 1"),
        (("points", []), "points: .*at least 1"),
        (("points", 1, 7), r"points\[1\]: .*not a mapping"),
        (("points", 1, "positions", [1.0, float("nan")]), "NaN"),
        (("points", 1, "velocities", [1.0, float("-inf")]), "-Infinity"),
        (("points", 1, "positions", [1.0, "2"]), r"points\[1\].positions: '2' is not a number"),
        (("points", 1, "positions", [1.0, True]), r"points\[1\].positions: True is not a number"),
        (("points", 1, "positions", [1.0, 10**400]), r"points\[1\].positions"),
        (("points", 1, "accelerations", [1.0, 2.0]), r"points: .*accelerations"),
        (("points", 1, "accelerations", [1.0]), r"points\[1\].accelerations: must be a list of 2"),
        (("points", 0, "velocities", []), r"points\[0\]: lacks velocities"),
        (("points", 1, "velocities", []), r"points\[1\]: lacks velocities: .* JointPath"),
        (("points", 1, "effort", [1.0, 2.0]), r"points\[1\].effort"),
        (("points", 1, "speed", []), r"points\[1\].speed: unknown key"),
        (("points", 1, "time_from_start", -1.5), r"points\[1\].time_from_start: must be"),
        (("points", 1, "time_from_start", True), r"points\[1\].time_from_start: must be"),
        (("points", 1, "time_from_start", float("inf")), "Infinity"),
        (("points", 1, "time_from_start", {"sec": 1, "nsecs": 0}), r"points\[1\].time_from_start: must be"),
        (("points", 1, "time_from_start", {"sec": 1.0, "nanosec": 0}), r"points\[1\].time_from_start: must be"),
        (("points", 1, "time_from_start", {"sec": 1, "nanosec": 10**9}), r"points\[1\].time_from_start: .* nanosec"),
        (("points", 1, "time_from_start", {"sec": 2, "nanosec": 0}), r"points\[2\].time_from_start: .* increase"),
        (("points", 0, "time_from_start", {"sec": 0, "nanosec": 1}), r"points\[0\].time_from_start: .* time 0"),
        (("pinproof", {**META, "interpolant": "linear"}), "pinproof.interpolant: unknown .*valid: cubic"),
        (("pinproof", {**META, "version": 2}), "pinproof.version: unknown .*valid: 1"),
        (("pinproof", {"version": 1}), "pinproof: .*does not state interpolant and units"),
        (("pinproof", {**META, "interpolant": "quintic Hermite between points"}), "interpolant must be 'cubic"),
        (("pinproof", {**META, "units": {**META["units"], "accelerations": "rad/s^2 or m/s^2"}}), "units must be"),
        (("pinproof", 7), "pinproof: .*not a mapping"),
        (("frame", 1), "frame: unknown key"),
    ],
)
def test_bad_json_is_refused_with_file_and_place(tmp_path, change, message):
    data = good_json()
    set_at(data, *change)
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(data))
    with pytest.raises(TrajectoryError, match=message) as caught:
        Trajectory.load(path)
    assert caught.value.path == str(path)


@pytest.mark.parametrize(
    ("line", "old", "new", "message"),
    [
        (0, "# pinproof: ", "# ", "line 1: must start"),
        (0, "cubic Hermite", "linear", "line 1: unknown interpolant"),
        (0, '"}', '"', "line 1: .*JSON"),
        (0, '"version": 1', '"version": 1, "version": 1', "line 1: .*'version' twice"),
        (1, "position a", "a", "line 2: columns"),
        (1, "velocity a", "velocity c", "line 2: columns"),
        (1, "time_from_start,position a,position b,velocity a,velocity b", "time_from_start", "line 2: columns"),
        (3, "3.0", "nan", "line 4: holds nan"),
        (3, "3.0", "x", "line 4: 'x' is not a number"),
        (3, "3.0,", "", "line 4: has 4 cells"),
        (3, "1.000000000", "1.0", "line 4: time_from_start"),
        (3, "1.000000000", "-1.000000000", "line 4: time_from_start"),
        (3, "1.000000000", "0.000000000", "line 4: times must increase"),
        (2, "0.000000000", "0.000000001", "line 3: the first point"),
        (1, " b", " a", ".*'a' twice"),
        (2, "", None, "line 3: has no point"),
    ],
)
def test_bad_csv_is_refused_with_file_and_line(tmp_path, line, old, new, message):
    Trajectory([0, 1], [[1, 2], [3, 4]], np.zeros((2, 2)), ["a", "b"]).save(tmp_path / "good.csv")
    lines = (tmp_path / "good.csv").read_text().splitlines()
    assert old in lines[line]
    lines[line:] = (
        [lines[line].replace(old, new, -1 if old == " b" else 1), *lines[line + 1 :]] if new is not None else []
    )
    (tmp_path / "bad.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(TrajectoryError, match=f"bad.csv: {message}"):
        Trajectory.load(tmp_path / "bad.csv")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        *(("bad.json", text, "bad.json") for text in ("", "{", "[]", '{"points": []}', "[" * 100_000, "1e999")),
        ("t.json", '{"joint_names": ["a"], "joint_names": ["b"], "points": []}', "'joint_names' twice"),
        ("t.yaml", ECHO.replace("  - 0.25\n", ""), r"t\.yaml: .*points\[1\].velocities: must be a list of 2"),
        ("t.yaml", ECHO.replace("header:", "header: {", 1), r"t\.yaml: line \d+: is not valid YAML"),
        ("none.json", None, r"none\.json: cannot be read"),
        ("latin.csv", b"\xff\xfe", "UTF-8"),
    ],
)
def test_a_file_that_is_no_trajectory_is_refused(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(TrajectoryError, match=message):
        Trajectory.load(tmp_path / name)


def test_other_endings_and_places_that_do_not_exist_are_refused(tmp_path, trajectory):
    with pytest.raises(TrajectoryError, match=r"unknown file type .\.txt.; valid: \.json, \.csv$"):
        trajectory.save(tmp_path / "t.txt")
    with pytest.raises(TrajectoryError, match="cannot be written"):
        trajectory.save(tmp_path / "no" / "t.json")


def test_a_save_that_fails_leaves_the_old_file_and_nothing_beside(tmp_path, trajectory, monkeypatch):
    target = tmp_path / "t.json"
    target.write_text("old")

    def full(self, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.replace", full)
    with pytest.raises(TrajectoryError, match="No space left"):
        trajectory.save(target)
    assert target.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["t.json"]


@pytest.mark.parametrize(("separator", "name"), [(";", "semicolons"), ("\t", "tabs")])
def test_a_table_that_a_spreadsheet_saved_with_other_separators_is_recognised(tmp_path, trajectory, separator, name):
    trajectory.save(tmp_path / "m.csv")
    mark, *rows = (tmp_path / "m.csv").read_text().splitlines()
    other = [row.replace(",", separator) for row in rows]
    for lines in (other, [mark, *other], ['"' + mark.replace('"', '""').replace(",", separator) + '"', *other]):
        (tmp_path / "other.csv").write_text("\n".join(lines))
        with pytest.raises(TrajectoryError, match=name):
            Trajectory.load(tmp_path / "other.csv")


# -- A motion file records what its motion was certified with, and refuses a record that makes no sense


@pytest.fixture(scope="module")
def arm():
    return pp.load_robot("generic_6dof").arm()


@pytest.fixture(scope="module")
def motion(arm):
    return pp.time_parametrise(pp.JointPath([arm.home, arm.home + 0.05], arm.joint_names), arm.limits)


BALL = pp.Obstacle("ball", pp.Sphere(radius=0.02), pp.pose((0, 0, 0.1)))
SCENE = pp.Scene([pp.Obstacle("post", pp.Sphere(radius=0.02), pp.pose((0, 0, 5)))])


@pytest.fixture(scope="module")
def certificate(arm, motion):
    return pp.certify(motion, pp.CollisionChecker(arm, SCENE, attached=[BALL], allowed=[]))


@pytest.fixture(scope="module")
def saved(motion, certificate, tmp_path_factory):
    """The file of a motion with its certificate."""
    file = tmp_path_factory.mktemp("motion") / "motion.json"
    motion.save(file, certificate=certificate)
    return file


@pytest.mark.parametrize("name", ["motion.json", "motion.csv"])
def test_the_record_comes_back(tmp_path, motion, certificate, name):
    motion.save(tmp_path / name, certificate=certificate)
    found = Trajectory.load(tmp_path / name)
    assert found.certified == (certificate.motion_record(end=motion.duration),)
    (record,) = found.certified
    assert (record.status, record.pairs, record.setup) == (
        certificate.status.name,
        certificate.pairs,
        certificate.setup,
    )
    assert (tuple(record.attached), record.obstacles) == (("ball",), ("post",))
    assert record.curve == found.digest() == certificate.curve
    found.save(tmp_path / f"again_{name}")
    assert Trajectory.load(tmp_path / f"again_{name}").certified == found.certified
    assert pickle.loads(pickle.dumps(found)).certified == found.certified


def test_joints_in_another_order_keep_the_record_of_the_same_motion(saved, motion):
    turned = Trajectory.load(saved, motion.joint_names[::-1])
    assert turned.digest() != motion.digest()
    assert turned.certified[0].curve == turned.digest()


def test_another_motion_has_no_record(motion, certificate, saved, tmp_path):
    slower, found = motion.slowed(2.0), Trajectory.load(saved)
    with pytest.raises(InputError, match="another motion"):
        slower.save(tmp_path / "motion.json", certificate=certificate)
    assert not (tmp_path / "motion.json").exists()
    for other in (slower, found.slowed(2.0), Trajectory.join(found)):
        assert other.certified == ()


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda r: r.clear(), "does not state name and start"),
        (lambda r: r.update(extra=1), "extra"),
        (lambda r: r.update(margin=True), "margin"),
        (lambda r: r.update(margin=None), "margin"),
        (lambda r: r.update(end=10**400), "end"),
        (lambda r: r.update(pairs=1.5), "pairs"),
        (lambda r: r.update(status=1), "status"),
        (lambda r: r.update(attached=["ball"]), "attached"),
        (lambda r: r.update(attached={"ball": 1}), "1"),
        (lambda r: r.update(held={"joint": "far"}), "held.joint"),
        (lambda r: r.update(obstacles="post"), "obstacles"),
        (lambda r: r.update(obstacles=[1]), "1"),
    ],
)
def test_a_record_that_makes_no_sense_is_refused(tmp_path, saved, change, named):
    data = json.loads(saved.read_text())
    change(data["pinproof"]["certified"][0])
    (tmp_path / "motion.json").write_text(json.dumps(data))
    with pytest.raises(TrajectoryError, match="certified") as caught:
        Trajectory.load(tmp_path / "motion.json")
    assert named in str(caught.value)


def test_records_must_be_a_list(tmp_path, motion):
    motion.save(tmp_path / "motion.json")
    data = json.loads((tmp_path / "motion.json").read_text())
    assert "certified" not in data["pinproof"]
    data["pinproof"]["certified"] = {"status": "FREE"}
    (tmp_path / "motion.json").write_text(json.dumps(data))
    with pytest.raises(TrajectoryError, match="certified"):
        Trajectory.load(tmp_path / "motion.json")


def test_each_difference_from_the_recorded_certification_is_noted(tmp_path, arm, motion):
    """The same setup has no such note; one of a smaller margin, without a constraint, or with other bodies has."""
    checker = pp.CollisionChecker(arm, SCENE, attached=[BALL], margin=0.002)
    tilt = pp.Upright.keeping(arm, motion.start, tolerance=1.0)
    motion.save(tmp_path / "motion.json", certificate=pp.certify(motion, checker, constraints=[tilt]))
    found, moved = Trajectory.load(tmp_path / "motion.json"), replace(BALL, pose=pp.pose((0, 0, 0.101)))
    for other, constraints, expected in (
        (checker, [tilt], []),
        (checker.with_margin(0.003), [tilt], []),
        (checker.with_margin(0.001), [tilt], ["margin of 2 mm"]),
        (checker, [], ["Upright"]),
        (checker.with_scene(SCENE.move("post", pp.pose((0, 0, 4)))), [tilt], ["another scene"]),
        (pp.CollisionChecker(arm, SCENE, attached=[moved], margin=0.002), [tilt], ["ball"]),
        (checker.with_scene(pp.Scene()), [tilt], ["post"]),
        (pp.CollisionChecker(arm, SCENE, margin=0.002), [tilt], ["ball"]),
    ):
        certificate = pp.certify(found, other, constraints=constraints)
        notes = [note for note in certificate.notes if note.startswith("the file of the motion")]
        assert len(notes) == len(expected)
        assert all(note.count(words) == 1 for note, words in zip(notes, expected, strict=True))
