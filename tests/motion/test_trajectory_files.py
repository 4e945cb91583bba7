import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pinproof import TrajectoryError
from pinproof.motion import Trajectory

NAMES = ("slide, long", 'the "turn"')
number = st.floats(allow_nan=False, allow_infinity=False)


@pytest.fixture
def trajectory():
    return Trajectory([0, 0.1, 1 / 3], [[0.1, -0.0], [1 / 3, 2], [1, 1e-300]], np.eye(3, 2) / 7, NAMES, "as\ngiven: é")


@pytest.mark.parametrize("ending", [".json", ".csv"])
@settings(deadline=None, max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_saved_trajectory_comes_back_bit_for_bit(tmp_path, ending, data):
    m = data.draw(st.integers(1, 4))
    clock = np.cumsum([0, *data.draw(st.lists(st.integers(1, 10**12), min_size=m - 1, max_size=m - 1))])
    q = data.draw(arrays(float, (m, 2), elements=number))
    v = data.draw(arrays(float, (m, 2), elements=number)) if m > 1 else np.zeros((1, 2))
    saved = Trajectory(clock / 10**9, q, v, NAMES, "as given")
    saved.save(tmp_path / f"t{ending}")
    loaded = Trajectory.load(tmp_path / f"t{ending}")
    assert (loaded.joint_names, loaded.limits_note) == (NAMES, "as given")
    for ours, theirs in zip(
        (saved.times, saved.q, saved.velocities), (loaded.times, loaded.q, loaded.velocities), strict=True
    ):
        assert ours.tobytes() == theirs.tobytes()


@pytest.mark.parametrize("ending", [".json", ".csv", ".JSON"])
def test_names_and_notes_of_any_spelling_survive(tmp_path, trajectory, ending):
    trajectory.save(tmp_path / f"t{ending}")
    loaded = Trajectory.load(tmp_path / f"t{ending}")
    assert loaded.joint_names == NAMES
    assert loaded.limits_note == "as\ngiven: é"


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


def test_a_plain_message_with_empty_optional_lists_is_read(tmp_path):
    point = {"positions": [1], "velocities": [0], "accelerations": [], "effort": []}
    points = [{**point, "time_from_start": {"sec": t, "nanosec": 5 * t}} for t in (0, 2)]
    (tmp_path / "t.json").write_text(json.dumps({"header": {"frame_id": ""}, "joint_names": ["j"], "points": points}))
    loaded = Trajectory.load(tmp_path / "t.json")
    assert loaded.times.tolist() == [0, 2.00000001]
    assert loaded.limits_note == ""


@pytest.mark.parametrize("ending", [".json", ".csv"])
def test_columns_are_matched_by_name(tmp_path, trajectory, ending):
    trajectory.save(tmp_path / f"t{ending}")
    loaded = Trajectory.load(tmp_path / f"t{ending}", joint_names=NAMES[::-1])
    assert loaded.joint_names == NAMES[::-1]
    np.testing.assert_array_equal(loaded.q, trajectory.q[:, ::-1])
    np.testing.assert_array_equal(loaded.velocities, trajectory.velocities[:, ::-1])
    with pytest.raises(TrajectoryError, match="wanted are"):
        Trajectory.load(tmp_path / f"t{ending}", joint_names=[NAMES[0], "wrist"])


def good_json():
    point = {"positions": [1.0, 2.0], "velocities": [0.0, 0.0]}
    return {
        "joint_names": ["a", "b"],
        "points": [{**point, "time_from_start": {"sec": t, "nanosec": 0}} for t in range(3)],
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
        (("joint_names", ["a", 3]), "joint_names: must be a list of texts"),
        (("joint_names", []), r"points\[0\].positions"),
        (("points", []), "points: must be a list of at least one"),
        (("points", 1, 7), r"points\[1\]: must be an object"),
        (("points", 1, "positions", [1.0, float("nan")]), "NaN"),
        (("points", 1, "velocities", [1.0, float("-inf")]), "-Infinity"),
        (("points", 1, "positions", [1.0, "2"]), r"points\[1\].positions: '2' is no number"),
        (("points", 1, "positions", [1.0, True]), r"points\[1\].positions: True is no number"),
        (("points", 1, "positions", [1.0, 10**400]), r"points\[1\].positions"),
        (("points", 1, "accelerations", [1.0, 2.0]), r"points\[1\].accelerations: .* quintic"),
        (("points", 1, "effort", [1.0, 2.0]), r"points\[1\].effort"),
        (("points", 1, "speed", []), r"points\[1\]: has unknown keys speed"),
        (("points", 1, "time_from_start", 1.5), r"points\[1\].time_from_start: must be"),
        (("points", 1, "time_from_start", {"sec": 1.0, "nanosec": 0}), r"points\[1\].time_from_start: must be"),
        (("points", 1, "time_from_start", {"sec": 1, "nanosec": 10**9}), r"points\[1\].time_from_start: .* nanosec"),
        (("points", 1, "time_from_start", {"sec": 2, "nanosec": 0}), r"points\[2\].time_from_start: .* increase"),
        (("points", 0, "time_from_start", {"sec": 0, "nanosec": 1}), r"points\[0\].time_from_start: .* time 0"),
        (("pinproof", {"version": 1, "interpolant": "linear"}), "pinproof: interpolant must be"),
        (("pinproof", {"version": 2}), "pinproof: version must be 1"),
        (("frame", 1), "unknown keys frame"),
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


def test_a_message_without_velocities_is_refused(tmp_path):
    data = good_json()
    del data["points"][0]["velocities"]
    (tmp_path / "bad.json").write_text(json.dumps(data))
    with pytest.raises(TrajectoryError, match=r"points\[0\]: lacks velocities"):
        Trajectory.load(tmp_path / "bad.json")


@pytest.mark.parametrize("text", ["", "{", "[]", '{"points": []}', "[" * 100_000, "1e999"])
def test_what_is_no_trajectory_json_is_refused(tmp_path, text):
    (tmp_path / "bad.json").write_text(text)
    with pytest.raises(TrajectoryError, match=r"bad\.json"):
        Trajectory.load(tmp_path / "bad.json")


def lines_of(tmp_path):
    Trajectory([0, 1], [[1, 2], [3, 4]], np.zeros((2, 2)), ["a", "b"]).save(tmp_path / "good.csv")
    return (tmp_path / "good.csv").read_text().splitlines()


@pytest.mark.parametrize(
    ("line", "old", "new", "message"),
    [
        (0, "# pinproof: ", "# ", "line 1: must start"),
        (0, "cubic Hermite", "linear", "line 1: interpolant"),
        (0, '"}', '"', "line 1: is no JSON"),
        (1, "position a", "a", "line 2: columns"),
        (1, "velocity a", "velocity c", "line 2: columns"),
        (1, "time_from_start,position a,position b,velocity a,velocity b", "time_from_start", "line 2: columns"),
        (3, "3.0", "nan", "line 4: holds nan"),
        (3, "3.0", "x", "line 4: 'x' is no number"),
        (3, "3.0,", "", "line 4: has 4 cells"),
        (3, "1.000000000", "1.0", "line 4: time_from_start must read"),
        (3, "1.000000000", "-1.000000000", "line 4: time_from_start must read"),
        (3, "1.000000000", "0.000000000", "line 4: times must increase"),
        (2, "0.000000000", "0.000000001", "line 3: the first point"),
    ],
)
def test_bad_csv_is_refused_with_file_and_line(tmp_path, line, old, new, message):
    lines = lines_of(tmp_path)
    assert old in lines[line]
    lines[line] = lines[line].replace(old, new, 1)
    (tmp_path / "bad.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(TrajectoryError, match=f"bad.csv: {message}"):
        Trajectory.load(tmp_path / "bad.csv")


def test_repeated_joints_and_missing_points_in_csv_are_refused(tmp_path):
    lines = lines_of(tmp_path)
    (tmp_path / "bad.csv").write_text("\n".join(lines[:2]) + "\n")
    with pytest.raises(TrajectoryError, match="line 3: has no point"):
        Trajectory.load(tmp_path / "bad.csv")
    (tmp_path / "bad.csv").write_text("\n".join([lines[0], lines[1].replace(" b", " a"), *lines[2:]]) + "\n")
    with pytest.raises(TrajectoryError, match="'a' twice"):
        Trajectory.load(tmp_path / "bad.csv")


def test_files_that_cannot_be_read_are_named(tmp_path):
    with pytest.raises(TrajectoryError, match=r"none\.json: cannot be read"):
        Trajectory.load(tmp_path / "none.json")
    (tmp_path / "latin.csv").write_bytes(b"\xff\xfe")
    with pytest.raises(TrajectoryError, match="UTF-8"):
        Trajectory.load(tmp_path / "latin.csv")


def test_other_endings_and_places_that_do_not_exist_are_refused(tmp_path, trajectory):
    with pytest.raises(TrajectoryError, match=r"a \.json or a \.csv"):
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
