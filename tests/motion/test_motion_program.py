"""Motion programs: segments and events on one clock, files that restore every number, and changes that are noticed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import InputError, TrajectoryError
from pinproof.motion import MotionProgram, MotionRecord, ProgramEvent, ProgramSegment, certificate_id

NAMES = ("a", "b")


def motion(*points: tuple[float, float], quintic: bool = False) -> pp.Trajectory:
    """A motion of one second between two points, at rest at its ends."""
    count = len(points)
    curvature = np.zeros((count, 2)) if quintic else None
    times = np.arange(count) / (count - 1)
    return pp.Trajectory(times, points, np.zeros((count, 2)), NAMES, "given", accelerations=curvature)


def record(trajectory: pp.Trajectory, name: str) -> MotionRecord:
    curve = trajectory.digest()
    return MotionRecord(
        name, 0.0, trajectory.duration, "FREE", 0.01, 0.002, 3, curve, "setup", {"part": "1a"}, {"f": 0.1}
    )


def program(*, dwell: float = 0.25, quintic: bool = False) -> MotionProgram:
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


def test_duration_counts_segments_and_dwell_times() -> None:
    assert program().duration == 2.35
    assert program(dwell=0).duration == 2.1


def test_every_segment_has_a_certificate_and_lists_are_copied() -> None:
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


def test_a_record_is_not_changed_by_what_it_was_made_from() -> None:
    attached, held, obstacles = {"part": "1a"}, {"finger": 0.1}, ["table"]
    made = MotionRecord(
        "pick", 0.0, 1.0, "FREE", 0.01, 0.002, 3, "curve", "setup", attached, held, obstacles, constraints=obstacles
    )
    attached["other"], held["finger"] = "2b", 0.2
    obstacles.clear()
    assert (made.attached, made.held) == ({"part": "1a"}, {"finger": 0.1})
    assert (made.obstacles, made.constraints) == (("table",), ("table",))


def test_arm_rests_during_dwell_times_and_moves_continuously() -> None:
    made = program()
    np.testing.assert_array_equal(made(0.6), [0.5, 0.1])
    times = np.linspace(0, made.duration, 2000)
    steps = np.abs(np.diff([made(t) for t in times], axis=0)).max()
    assert steps < 3 * (times[1] - times[0])  # no segment is faster than 2.25 rad/s
    with pytest.raises(InputError, match=r"outside the program"):
        made(3.0)


@pytest.mark.parametrize("quintic", [False, True])
def test_file_restores_every_number(tmp_path: Path, quintic: bool) -> None:
    made = program(quintic=quintic)
    made.save(tmp_path / "a.json")
    found = MotionProgram.load(tmp_path / "a.json")
    assert found.to_json() == made.to_json()
    assert (found.name, found.robot, found.tcp, found.member) == ("bolt", "two", "tip", "rotated by 1")
    assert found.events == made.events
    assert found.certificates == made.certificates
    for one, other in zip(found.segments, made.segments, strict=True):
        assert (one.name, one.start, one.end, one.certificate) == (
            other.name,
            other.start,
            other.end,
            other.certificate,
        )
        assert one.trajectory.digest() == other.trajectory.digest()
    assert [each.digest() for each in found.motions.values()] == [each.curve for each in made.certificates.values()]


def test_file_states_times_on_the_clock_of_the_program() -> None:
    data = json.loads(program().to_json())
    starts = [segment["points"][0]["time"] for segment in data["segments"]]
    assert starts == [{"sec": 0, "nanosec": 0}, {"sec": 0, "nanosec": 750_000_000}, {"sec": 1, "nanosec": 250_000_000}]
    assert [event["time"]["sec"] for event in data["events"]] == [0, 2]


def edited(tmp_path: Path, change) -> Path:
    """A program file with a change."""
    data = json.loads(program().to_json())
    change(data)
    path = tmp_path / "edited.json"
    path.write_text(json.dumps(data))
    return path


def move_a_via_point(data) -> None:
    data["segments"][2]["points"][-1]["positions"][1] += 1e-9


def test_changed_number_is_refused_and_named(tmp_path: Path) -> None:
    path = edited(tmp_path, move_a_via_point)
    with pytest.raises(TrajectoryError, match=r"place"):
        MotionProgram.load(path)
    assert MotionProgram.load(path, allow_changes=True).changed == ("place",)
    assert program().changed == ()


def clearer(data) -> None:
    next(iter(data["certificates"].values()))["clearance"] = 0.02


def later(data) -> None:
    data["events"][0]["dwell"]["nanosec"] += 1


def jump(data) -> None:
    data["segments"][1]["points"][0]["positions"][0] += 1e-3


def in_motion(data) -> None:
    data["segments"][1]["points"][0]["velocities"][0] = 1.0


def early(data) -> None:
    data["events"][0]["time"]["nanosec"] -= 1000


def unknown_event(data) -> None:
    data["events"][0]["kind"] = "weld"


def no_certificate(data) -> None:
    data["certificates"] = {}


def no_points(data) -> None:
    del data["segments"][0]["points"]


def text_time(data) -> None:
    data["segments"][0]["start"]["sec"] = "0"


def other_schema(data) -> None:
    data["schema"] = "pinproof/program/9"


@pytest.mark.parametrize(
    ("change", "fact"),
    [
        (clearer, "hash"),
        (later, "dwell"),
        (jump, "'a'"),
        (in_motion, "rest"),
        (early, "end of a segment"),
        (unknown_event, "grip, release"),
        (no_certificate, "does not exist"),
        (no_points, "points"),
        (text_time, "an integer"),
        (other_schema, "pinproof/program/1"),
    ],
)
def test_contradictory_file_is_refused(tmp_path: Path, change, fact: str) -> None:
    with pytest.raises(TrajectoryError, match=fact) as caught:
        MotionProgram.load(edited(tmp_path, change), allow_changes=True)
    assert "edited.json" in str(caught.value)


@pytest.mark.parametrize("text", ["", "[]", "{", '{"schema": "pinproof/program/1"}', "NaN", "3"])
def test_file_that_is_no_program_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "no.json").write_text(text)
    with pytest.raises(TrajectoryError, match=r"no\.json"):
        MotionProgram.load(tmp_path / "no.json")


def test_negative_dwell_time_is_refused() -> None:
    made = program()
    with pytest.raises(InputError, match=r"0 or more"):
        replace(made, events=(replace(made.events[0], dwell=-0.1),))


def test_split_and_join_restore_a_trajectory_exactly() -> None:
    whole = motion((0, 0), (0.5, 0.1), (1, 1 / 3))
    assert pp.Trajectory.join(*whole.split(0.5)).digest() == whole.digest()
    for time in (0.0, 1.0, 0.3):
        with pytest.raises(InputError, match=r"no point"):
            whole.split(time)
    for wrong in (float("nan"), "0.5"):
        with pytest.raises(InputError, match=r"time \(s\)"):
            whole.split(wrong)
    moving = pp.Trajectory([0, 1, 2], [[0], [1], [2]], [[0], [1], [0]], ["a"])
    with pytest.raises(InputError, match=r"moves"):
        moving.split(1.0)


def test_repr_lists_segments_and_events_in_order() -> None:
    lines = repr(program()).splitlines()
    assert "2.35 s" in lines[0]
    assert [line.split(": ")[1] for line in lines[1:]] == [
        "segment in", "event grip bolt", "segment out", "segment place", "event release bolt",
    ]  # fmt: skip
