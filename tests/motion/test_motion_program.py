"""Motion programs: segments and events on one clock, files that restore every number, and changes that are noticed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import Calibration
from pinproof.errors import InputError, TrajectoryError
from pinproof.motion import MotionProgram, MotionRecord, ProgramEvent, ProgramSegment, certificate_id


def motion(*points, quintic=False):
    """A motion of one second between two points, at rest at its ends."""
    still, times = np.zeros((len(points), 2)), np.arange(len(points)) / (len(points) - 1)
    return pp.Trajectory(times, points, still, ("a", "b"), "given", accelerations=still if quintic else None)


def record(trajectory, name):
    bodies, arm = (
        ({"part": "1a"}, {"f": 0.1}),
        Calibration(Path("a.csv"), "differences", deltas=[[0.0, 0.0, 1e-3, 0.0]]),
    )
    hashes = trajectory.digest(), "setup"
    return MotionRecord(
        name, 0.0, trajectory.duration, "FREE", 0.01, 0.002, 3, *hashes, *bodies, calibrations={"arm": arm}
    )


def program(*, dwell=0.25, quintic=False):
    """Two certified motions; the first has two segments with a grip between them, a release is at the end."""
    whole = motion((0, 0), (0.5, 0.1), (1, 0.3), quintic=quintic)
    before, after = whole.split(0.5)
    last = motion((1, 0.3), (0, 1 / 3), quintic=quintic)
    records = {certificate_id(each): each for each in (record(whole, "pick"), record(last, "place"))}
    first, second = records
    segments = (
        ProgramSegment("in", 0.0, before, first),
        ProgramSegment("out", 0.5 + dwell, after, first),
        ProgramSegment("place", 1.0 + dwell, last, second),
    )
    events = (
        ProgramEvent("grip", 0.5, dwell, "bolt", {"finger": 0.01}),
        ProgramEvent("release", 2.0 + dwell, 0.1, "bolt"),
    )
    return MotionProgram("bolt", segments, events, records, robot="two", tcp="tip", member="rotated by 1")


def test_duration_counts_segments_and_dwell_times_which_are_listed_in_order():
    made = program()
    assert (made.duration, program(dwell=0).duration) == (2.35, 2.1)
    lines = repr(made).splitlines()
    assert "2.35 s" in lines[0]
    assert [line.split(": ")[1] for line in lines[1:]] == [
        "segment in", "event grip bolt", "segment out", "segment place", "event release bolt",
    ]  # fmt: skip


def test_every_segment_has_a_certificate_and_lists_are_copied():
    made = program()
    for k in range(3):
        segments = [replace(each, certificate="none") if i == k else each for i, each in enumerate(made.segments)]
        with pytest.raises(InputError, match=rf"'none' of segment '{segments[k].name}'"):
            replace(made, segments=segments)
    segments, events = list(made.segments), list(made.events)
    copied = replace(made, segments=segments, events=events)
    segments.clear()
    events.clear()
    assert (copied.segments, copied.events) == (made.segments, made.events)
    attached, held, obstacles = {"part": "1a"}, {"finger": 0.1}, ["table"]
    kept = replace(
        made.certificates[made.segments[0].certificate],
        attached=attached, held=held, obstacles=obstacles, constraints=obstacles,
    )  # fmt: skip
    attached["other"], held["finger"] = "2b", 0.2
    obstacles.clear()
    assert (kept.attached, kept.held) == ({"part": "1a"}, {"finger": 0.1})
    assert (kept.obstacles, kept.constraints) == (("table",), ("table",))


def test_arm_rests_during_dwell_times_and_moves_continuously():
    made = program()
    np.testing.assert_array_equal(made(0.6), [0.5, 0.1])
    times = np.linspace(0, made.duration, 2000)
    steps = np.abs(np.diff([made(t) for t in times], axis=0)).max()
    assert steps < 3 * (times[1] - times[0])  # no segment is faster than 2.25 rad/s
    with pytest.raises(InputError, match=r"outside the program"):
        made(3.0)


@pytest.mark.parametrize("quintic", [False, True])
def test_file_restores_every_number(tmp_path, quintic):
    made = program(quintic=quintic)
    made.save(tmp_path / "a.json")
    found = MotionProgram.load(tmp_path / "a.json")
    assert found.to_json() == made.to_json()
    assert (found.name, found.robot, found.tcp, found.member) == ("bolt", "two", "tip", "rotated by 1")
    assert (found.events, found.certificates) == (made.events, made.certificates)
    for one, other in zip(found.segments, made.segments, strict=True):
        stated = (
            (each.name, each.start, each.end, each.certificate, each.trajectory.digest()) for each in (one, other)
        )
        assert len(set(stated)) == 1
    assert [each.digest() for each in found.motions.values()] == [each.curve for each in made.certificates.values()]


def test_file_states_times_on_the_clock_of_the_program():
    data = json.loads(program().to_json())
    starts = [segment["points"][0]["time"] for segment in data["segments"]]
    assert starts == [{"sec": 0, "nanosec": 0}, {"sec": 0, "nanosec": 750_000_000}, {"sec": 1, "nanosec": 250_000_000}]
    assert [event["time"]["sec"] for event in data["events"]] == [0, 2]


def edited(tmp_path, *change):
    """A program file in which the value at a list of keys is another one, or greater by a number; None deletes it."""
    data = json.loads(program().to_json())
    *keys, last, value = change
    place = data
    for key in keys:
        place = place[key]
    if value is None:
        del place[last]
    else:
        place[last] = place[last] + value if isinstance(value, (int, float)) else value
    (tmp_path / "edited.json").write_text(json.dumps(data))
    return tmp_path / "edited.json"


def test_changed_number_is_refused_and_named(tmp_path):
    path = edited(tmp_path, "segments", 2, "points", -1, "positions", 1, 1e-9)
    with pytest.raises(TrajectoryError, match=r"place"):
        MotionProgram.load(path)
    assert MotionProgram.load(path, allow_changes=True).changed == ("place",)
    assert program().changed == ()


@pytest.mark.parametrize(
    ("change", "fact"),
    [
        (("certificates", next(iter(program().certificates)), "clearance", 0.01), "hash"),
        (("events", 0, "dwell", "nanosec", 1), "dwell"),
        (("segments", 1, "points", 0, "positions", 0, 1e-3), "'a'"),
        (("segments", 1, "points", 0, "velocities", 0, 1.0), "rest"),
        (("events", 0, "time", "nanosec", -1000), "end of a segment"),
        (("events", 0, "kind", "weld"), "grip, release"),
        (("certificates", {}), "does not exist"),
        (("segments", 0, "points", None), "points"),
        (("segments", 0, "start", "sec", "0"), "an integer"),
        (("schema", "pinproof/program/9"), "pinproof/program/1"),
    ],
)
def test_contradictory_file_is_refused(tmp_path, change, fact):
    with pytest.raises(TrajectoryError, match=fact) as caught:
        MotionProgram.load(edited(tmp_path, *change), allow_changes=True)
    assert "edited.json" in str(caught.value)


@pytest.mark.parametrize("text", ["", "[]", "{", '{"schema": "pinproof/program/1"}', "NaN", "3"])
def test_file_that_is_no_program_is_refused(tmp_path, text):
    (tmp_path / "no.json").write_text(text)
    with pytest.raises(TrajectoryError, match=r"no\.json"):
        MotionProgram.load(tmp_path / "no.json")


def test_negative_dwell_time_is_refused():
    made = program()
    with pytest.raises(InputError, match=r"dwell must be .* at least 0"):
        replace(made, events=(replace(made.events[0], dwell=-0.1),))


def test_split_and_join_restore_a_trajectory_exactly():
    whole = motion((0, 0), (0.5, 0.1), (1, 1 / 3))
    assert pp.Trajectory.join(*whole.split(0.5)).digest() == whole.digest()
    moving = pp.Trajectory([0, 1, 2], [[0], [1], [2]], [[0], [1], [0]], ["a"])
    wrong = [(whole, time, "no point") for time in (0.0, 1.0, 0.3)]
    wrong += [(whole, time, r"time \(s\)") for time in (float("nan"), "0.5")]
    for trajectory, time, message in [*wrong, (moving, 1.0, "moves")]:
        with pytest.raises(InputError, match=message):
            trajectory.split(time)
