"""Robot programs: what is written is read back, and what was edited or is not supported is refused with its line."""

import json
import re
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
import yaml
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

import pinproof as pp
from pinproof.errors import InputError, TrajectoryError, UnknownNameError
from pinproof.motion import (
    Blend,
    CheckInput,
    JointMap,
    JointMove,
    LinearMove,
    Remark,
    RobotProgram,
    SetLoad,
    SetOutput,
    StreamedPoint,
    StreamedTrajectory,
    ToolData,
    UserFrame,
    Wait,
    external_joints,
    make_program,
)
from pinproof.motion.dialects import DIALECTS

NAMES = tuple(f"joint_{i}" for i in range(1, 7))
MOVING = ("urscript", "rapid", "krl", "fanuc")
RESOLUTION = {"urscript": 0.6e-6, "rapid": 1e-6, "krl": 1e-6, "fanuc": 1e-5}
"""rad: half of the last decimal that each language is written with."""

OUTPUT = {"urscript": "0", "rapid": "do_gripper", "krl": "1", "fanuc": "1"}
POINTS = [JointMove(np.zeros(6)), StreamedPoint(np.full(6, 1e-6), 0.008), StreamedPoint(np.full(6, 2e-6), 0.008)]

BLEND = {
    "urscript": Blend(0.01),
    "rapid": Blend(0.02, share=0.5, stated=0.5),
    "krl": Blend(0.01, share=0.5),
    "fanuc": Blend(share=0.5),
}

every_language = pytest.mark.parametrize("dialect", MOVING)


def some_steps(dialect):
    q = np.random.default_rng(5).uniform(-3, 3, (4, 6))
    blend = BLEND[dialect]
    moves = [JointMove(row, None if i == 0 else 0.5 + i, blend if i == 1 else None) for i, row in enumerate(q)]
    line = LinearMove(q[1] - 0.1, pp.pose((0.1, -0.2345678, 0.5), (0.3, -0.4, 2.5)), 1.25)
    return [*moves[:2], line, SetOutput(OUTPUT[dialect], True), Wait(0.25), *moves[2:]]


def some_program(dialect, **settings):
    return make_program(some_steps(dialect), NAMES, dialect=dialect, **settings)


def refused(text, dialect, place="line "):
    """The error of a program that is not read even if changes are allowed; its place begins so."""
    with pytest.raises(TrajectoryError) as error:
        RobotProgram.parse(text, dialect=dialect, allow_changes=True)
    assert (error.value.place or "").startswith(place)
    return error.value


def short_motion(name="ur5", **settings):
    arm = pp.load_robot(name).arm()
    path = pp.JointPath([arm.home, arm.home + 0.1], arm.joint_names)
    return pp.time_parametrise(path, arm.limits, **settings)


def goal_of(motion, **settings):
    return make_program([StreamedTrajectory(motion.record())], motion.joint_names, dialect="ros2", **settings)


@every_language
def test_every_construct_is_read_back(dialect):
    steps = some_steps(dialect)
    program = some_program(dialect, name="lift 1", deviation=0.003, certificate="ab12")
    assert [type(step) for step in program.steps] == [type(step) for step in steps]
    for wrote, read in zip(steps, program.steps, strict=True):
        if isinstance(wrote, JointMove):
            assert np.abs(read.q - wrote.q).max() <= RESOLUTION[dialect]
            assert (read.blend is None) == (wrote.blend is None)
            assert read.duration is None or read.duration == pytest.approx(wrote.duration, abs=1e-3)
        if isinstance(wrote, LinearMove) and dialect == "krl":
            assert np.abs(read.pose.homogeneous - wrote.pose.homogeneous).max() < 2e-7
        elif isinstance(wrote, LinearMove):
            assert np.abs(read.q - wrote.q).max() <= RESOLUTION[dialect]
            assert read.duration == pytest.approx(1.25)
    assert (program.name, program.deviation, program.certificate) == ("lift_1", 0.003, "ab12")
    assert program.joint_names == NAMES
    output, wait = program.steps[3:5]
    assert (output.output, output.on, wait.seconds) == (OUTPUT[dialect], True, 0.25)
    # line endings of another system, and texts of any characters about what is not covered, change nothing
    uncovered = some_program(dialect, certificate="ab12", uncovered="T\u00fcr; a\nmovej([0], t=1)\u2028end").text
    for text in (program.text.replace("\n", "\r\n"), uncovered):
        again = RobotProgram.parse(text, dialect=dialect)
        assert again.certificate == "ab12"
        assert [type(step) for step in again.steps] == [type(step) for step in steps]


@every_language
@settings(max_examples=20)
@given(data=st.data())
def test_an_edited_number_is_refused_with_its_line(dialect, data):
    lines = some_program(dialect).text.splitlines()
    numbers = [
        (i, found.span())
        for i, line in enumerate(lines)
        if DIALECTS[dialect].comment_of(line) is None
        for found in re.finditer(r"(?<![\w.])\d+\.\d+", line)
    ]
    i, (start, end) = data.draw(st.sampled_from(numbers))
    digit = data.draw(st.sampled_from([k for k in range(start, end) if lines[i][k].isdigit()]))
    other = data.draw(st.sampled_from([each for each in "0123456789" if each != lines[i][digit]]))
    lines[i] = lines[i][:digit] + other + lines[i][digit + 1 :]
    with pytest.raises(TrajectoryError) as error:
        RobotProgram.parse("\n".join(lines), dialect=dialect)
    assert error.value.place == f"line {i + 1}"


@pytest.mark.parametrize("dialect", DIALECTS)
def test_an_edited_comment_is_refused(dialect):
    own = goal_of(short_motion(), deviation=0.25) if dialect == "ros2" else some_program(dialect, deviation=0.25)
    text = own.text
    assert text.count("0.25 rad") == 1
    with pytest.raises(TrajectoryError, match="comments"):
        RobotProgram.parse(text.replace("0.25 rad", "0 rad"), dialect=dialect)


def wait_of(lines):
    return next(i for i, line in enumerate(lines) if "WAIT" in line.upper() or "sleep" in line)


@every_language
def test_a_removed_or_added_line_is_refused(dialect):
    lines = some_program(dialect).text.splitlines()
    wait = wait_of(lines)
    for changed in (lines[:wait] + lines[wait + 1 :], lines[: wait + 1] + lines[wait:]):
        with pytest.raises(TrajectoryError):
            RobotProgram.parse("\n".join(changed), dialect=dialect)


@pytest.mark.parametrize(
    ("dialect", "line"),
    [
        ("urscript", "  movel(p[0.1, 0.2, 0.3, 0, 0, 0], a=1.2, v=0.25)"),
        ("rapid", "    MoveL p10, v100, fine, tool0;"),
        ("krl", "  LIN {X 100,Y 0,Z 300,A 0,B 0,C 0} C_ORI"),
        ("fanuc", ":L P[1] 100cm/min FINE ;"),
        ("urscript", "  movel([0, 0, 0, 0, 0, 0], t=1.0, r=0.01, a=1)"),
        ("urscript", "  movec(p[0, 0, 0, 0, 0, 0], p[0, 0, 0, 0, 0, 0])"),
    ],
)
def test_an_unsupported_instruction_is_refused_with_line_and_text(dialect, line):
    lines = some_program(dialect).text.splitlines()
    at = wait_of(lines)
    error = refused("\n".join([*lines[:at], line, *lines[at:]]), dialect)
    assert error.place == f"line {at + 1}"
    assert line.strip() in error.reason


def test_changes_are_accepted_on_request_and_withdraw_the_certificate():
    text = some_program("urscript", certificate="ab12").text.replace("sleep(0.250000)", "sleep(0.750000)")
    edited = RobotProgram.parse(text, dialect="urscript", allow_changes=True)
    assert edited.certificate == ""
    assert [step.seconds for step in edited.steps if isinstance(step, Wait)] == [0.75]


def test_set_points_are_streamed_and_stopped():
    program = make_program([*POINTS, Wait(1.0)], NAMES, dialect="urscript")
    words = [line.strip().partition("(")[0] for line in program.text.splitlines() if "#" not in line]
    assert words == ["def motion", "movej", "servoj", "servoj", "stopj", "sleep", "end"]
    assert [step.period for step in program.steps if isinstance(step, StreamedPoint)] == [0.008, 0.008]


angles = st.lists(st.floats(-3, 3), min_size=6, max_size=6)


@settings(max_examples=50)
@given(q=angles, offsets=angles, signs=st.lists(st.sampled_from([-1.0, 1.0]), min_size=6, max_size=6))
def test_the_joint_map_is_undone_by_its_inverse(q, offsets, signs):
    mapping = JointMap(np.array(signs), np.array(offsets), coupling=-1.0)
    assert mapping.from_controller(mapping.to_controller(q)) == pytest.approx(q, abs=1e-14)


def test_a_coupled_joint_is_written_as_the_controller_measures_it():
    q = np.deg2rad([0.0, 30.0, 10.0, 0.0, 0.0, 0.0])
    mapping = JointMap(np.ones(6), np.zeros(6), coupling=-1.0)
    program = make_program([JointMove(q)], NAMES, dialect="fanuc", joint_map=mapping)
    assert "J3 = -20.000 deg" in program.text
    assert program.moves[0].q == pytest.approx(q, abs=1e-5)


def test_a_goal_of_ros_is_exactly_the_trajectory(tmp_path):
    motion = short_motion("panda", jerk=500.0)
    goal_of(motion).save(tmp_path / "m.goal.yaml")
    (step,) = RobotProgram.load(tmp_path / "m.goal.yaml").steps
    assert pp.Trajectory.of_record(step.record).digest() == motion.digest()


@pytest.mark.parametrize(
    ("dialect", "steps", "names", "message"),
    [
        ("krl", some_steps("krl"), (*NAMES[:5], "joint 6"), "'joint 6' has spaces"),
        *(
            (dialect, [JointMove(np.zeros(6)), SetOutput(output, True)], NAMES, "output")
            for dialect, output in (("urscript", "gripper"), ("rapid", "1"), ("krl", "0"), ("fanuc", "a"))
        ),
        ("urscript", [JointMove(np.zeros(6)), StreamedPoint(np.zeros(6), 0.5)], NAMES, "period"),
        *((dialect, [JointMove(np.zeros(7))], (*NAMES, "joint_7"), "6 joints") for dialect in MOVING),
    ],
)
def test_what_the_language_does_not_have_is_not_written(dialect, steps, names, message):
    with pytest.raises(InputError, match=message):
        make_program(steps, names, dialect=dialect)


def test_an_unknown_language_names_the_valid_ones():
    with pytest.raises(UnknownNameError) as error:
        make_program(some_steps("krl"), NAMES, dialect="karel")
    assert set(error.value.valid) == set(DIALECTS)


def test_files_of_other_programs_are_refused(tmp_path):
    (tmp_path / "other.script").write_text("def a():\n  movej([0, 0, 0, 0, 0, 0], a=1, v=1)\nend\n")
    with pytest.raises(TrajectoryError, match="pinproof"):
        RobotProgram.load(tmp_path / "other.script")
    with pytest.raises(InputError, match="ending"):
        RobotProgram.load(tmp_path / "program.txt")


@pytest.mark.parametrize(
    "character", ["\r", "\x0b", "\x0c", "\x1c", "\x1d", "\x1e", "\x85", "\u2028", "\u2029", "\x00"]
)
@every_language
def test_a_character_that_only_some_programs_end_lines_at_is_refused(dialect, character):
    lines = some_program(dialect).text.split("\n")
    at = next(k for k, line in enumerate(lines) if "pinproof program" in line)
    lines[at] = lines[at].removesuffix(" ;") + character + lines[-3]
    refused("\n".join(lines), dialect, f"line {at + 1}, column ")


@every_language
def test_a_carriage_return_at_the_end_and_spaces_that_are_none_for_a_controller_are_refused(dialect):
    text = some_program(dialect).text
    assert refused(text + "\r", dialect)
    lines = text.split("\n")
    for blank in ("\u00a0", "\u2003", "\ufeff", "\u3000"):
        for k in range(1, len(lines)):
            assert refused("\n".join([*lines[:k], blank + lines[k], *lines[k + 1 :]]), dialect, "")


@every_language
def test_the_comments_are_at_the_top(dialect):
    lines = some_program(dialect).text.split("\n")
    comments = [k for k, line in enumerate(lines) if DIALECTS[dialect].comment_of(line) is not None]
    moved = [line for k, line in enumerate(lines) if k not in comments]
    for place in (0, comments[0] + 2, len(moved) - 2):
        refused("\n".join([*moved[:place], *(lines[k] for k in comments), *moved[place:]]), dialect)


@every_language
@pytest.mark.parametrize(
    "name", ["T\u00fcre 1", "1 bolt", "\u65e5\u672c", "end", "main", "PTP", "moveabsj", "movej", "_x", ""]
)
def test_every_name_makes_a_program_with_a_name_of_its_own(dialect, name):
    """It begins with a letter, and is none of the words of the program, which would then call itself."""
    text = some_program(dialect, name=name).text
    first = re.search(r"(?:\bdef|\bMODULE|\bDEF|/PROG) +([^\s(]+)", text)[1]
    assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", first)
    words = re.findall(r"[A-Za-z_]\w*", "\n".join(line for line in text.split("\n") if "pinproof" not in line))
    assert dialect == "fanuc" or [word.lower() for word in words].count(first.lower()) == 1


@every_language
@pytest.mark.parametrize("place", ["inside", "behind"])
def test_a_second_routine_and_code_behind_the_end_are_refused(dialect, place):
    """A controller does not execute them, or not in this order."""
    lines = some_program(dialect).text.rstrip().split("\n")
    move = next(line for line in reversed(lines) if re.search(r"movej|MoveAbsJ|PTP|J P\[", line))
    routine = {
        "urscript": ["def more():", move, "end"], "rapid": ["PROC more()", move, "ENDPROC"],
        "krl": ["DEF more()", move, "END"], "fanuc": ["/PROG  MORE", "/ATTR", "/MN", move, "/POS", "/END"],
    }[dialect]  # fmt: skip
    at = lines.index(move) if place == "inside" else len(lines)
    for added in (routine, routine[:-1], routine[1:], *([[move]] if place == "behind" else [])):
        assert refused("\n".join([*lines[:at], *added, *lines[at:]]), dialect, "")


@pytest.mark.parametrize(
    ("dialect", "before", "after"),
    [
        # the name of an instruction as that of the program
        *(("urscript", "def motion", f"def {name}") for name in ("movej", "end", "1")),
        ("rapid", "MODULE m_motion", "MODULE MoveAbsJ"), ("rapid", "MODULE m_motion", "MODULE main"),
        ("rapid", "PROC motion", "PROC aux"), ("krl", "DEF motion", "DEF BAS"), ("krl", "DEF motion", "DEF ptp"),
        # a value outside the range of its instruction
        ("urscript", "sleep(0.250000)", "sleep(-0.25)"), ("urscript", "sleep(0.250000)", f"sleep({'9' * 400})"),
        ("urscript", "t=1.500000", f"t={'9' * 400}"), ("urscript", "t=1.500000", "t=1e-3"),
        ("urscript", "a=0.5", "a=-0.5"), ("urscript", "v=0.3", "v=-0.3"), ("urscript", "v=0.3", "v=0"),
        ("urscript", "out(0", "out(8"), ("urscript", "r=0.010000", "r=-0.010000"),
        ("rapid", "WaitTime 0.2500", "WaitTime -0.25"), ("rapid", "v100,", "v0,"), ("rapid", "v100,", "v99,"),
        ("rapid", "z10", "z7"), ("rapid", "z10", "z999"),
        ("krl", "WAIT SEC 0.2500", "WAIT SEC -0.25"), ("krl", "  BAS(#INITMOV,0)\n", ""),
        ("krl", "  BAS(#VEL_CP,0.1)\n", ""), ("krl", "  BAS(#ACC_CP,1.0)\n", ""), ("krl", "#ACC_PTP,100", "#ACC_PTP,0"),
        ("krl", "#ACC_CP,1.0", "#ACC_CP,0"), ("krl", "#VEL_CP,0.1", "#VEL_CP,100"), ("krl", "#VEL_CP,0.1", "#VEL_CP,0"),
        ("krl", "#VEL_PTP,30", "#VEL_PTP,300"), ("krl", "CDIS=10.0", "CDIS=0"), ("krl", "CDIS=10.0", "CDIS=5000"),
        ("krl", "  $APO.CDIS=10.0\n", "  $APO.CDIS=10.0\n  BAS(#INITMOV,0)\n"),
        ("krl", "  LIN {", "  $APO.CDIS=5.0\n  LIN {"), ("krl", "  $APO.CDIS=10.0\n", ""),
        ("fanuc", "WAIT 0.25(sec)", "WAIT -0.25(sec)"), ("fanuc", " 5%", " 0%"), ("fanuc", " 5%", " 101%"),
        ("fanuc", "CNT100", "CNT101"), ("fanuc", "1500msec", f"{'9' * 400}msec"), ("fanuc", "J P[2]", "J P[02]"),
        ("fanuc", "P[2]{", "P[02]{"), ("fanuc", "P[2]{", "P[1]{"), ("fanuc", "UFRAME_NUM=0 ;", "UTOOL_NUM=1 ;"),
        # another frame or tool
        ("fanuc", "UFRAME_NUM=0", "UFRAME_NUM=3"), ("fanuc", "UTOOL_NUM=1", "UTOOL_NUM=2"),
        # a stop on the way of a blended move: the arm would stop before the point, and the next move begin there
        ("urscript", "r=0.010000)\n", "r=0.010000)\n  stopj(10)\n"),
    ],
)  # fmt: skip
def test_a_value_or_name_that_its_instruction_does_not_have_is_refused(dialect, before, after):
    text = some_program(dialect).text
    assert before in text
    assert refused(text.replace(before, after, 1), dialect)


@pytest.mark.parametrize("word", ["1A6 11.8", "A6 11.8 A6 12", "A7 11.8", "A6", "A6 nan", "A6 1_1.8", "A06 11.8"])
def test_an_axis_of_krl_that_is_not_stated_exactly_is_refused(word):
    text = make_program([JointMove(np.zeros(6)), JointMove(np.full(6, 0.1))], NAMES, dialect="krl").text
    assert "A6 5.7296" in text
    refused(text.replace("A6 5.7296", word), "krl", "")


def test_a_position_of_fanuc_has_one_name():
    """P[01] and P[1] are the same position for a controller, which then has two."""
    text = make_program([JointMove(np.zeros(6)), JointMove(np.full(6, 0.1), 1.0)], NAMES, dialect="fanuc").text
    entry = text[text.index("P[2]{") : text.index("/END")]
    again = entry.replace("P[2]{", "P[02]{").replace("J1 = 5.730", "J1 = 90.000")
    refused(text.replace("J P[2]", "J P[02]").replace("/END", f"{again}/END"), "fanuc", "")


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("t=0.008000", "t=0.5"), ("lookahead_time=0.03", "lookahead_time=0.2"), ("gain=2000", "gain=100"),
        ("lookahead_time=0.03", "lookahead_time=-1"), ("  servoj", "  stopj(10)\n  servoj"),
    ],
)  # fmt: skip
def test_set_points_that_are_not_followed_closely_are_refused(before, after):
    text = make_program(POINTS, NAMES, dialect="urscript").text
    assert before in text
    refused(text.replace(before, after, 1), "urscript", "")


def ros_goal():
    """Comments and contents of a goal of ROS, which is read as JSON, and by controllers as YAML."""
    points = [[0.0] * 6, [1e-5, 1.0, -3e-7, 2e-5, 0.1, 0.2], [0.0] * 6]
    text = goal_of(pp.Trajectory([0.0, 1.0, 2.0], points, np.zeros((3, 6)), NAMES)).text
    assert RobotProgram.parse(text, dialect="ros2").joint_names == NAMES
    goal = yaml.safe_load(text)
    assert goal["trajectory"]["points"][1]["positions"] == points[1]  # every number is a number of YAML
    return [line for line in text.split("\n") if line.startswith("#")], goal


STAMP = {"sec": 5, "nanosec": 0}


@pytest.mark.parametrize(
    "change",
    [
        lambda goal: goal["trajectory"]["joint_names"].reverse(),
        # its stamp starts the motion at another time, without the points before
        lambda goal: goal["trajectory"].update(header={"stamp": STAMP}),
        lambda goal: goal["trajectory"]["joint_names"].pop(),
        lambda goal: goal.update(goal_time_tolerance=STAMP),
    ],
)
def test_a_goal_of_ros_with_other_contents_is_refused(change):
    comments, goal = ros_goal()
    change(goal)
    refused("\n".join([*comments, json.dumps(goal)]), "ros2", "")


def test_an_approximated_move_of_krl_uses_its_distance_in_at_most_half_of_its_moves():
    text = make_program([JointMove(q) for q in np.eye(6)[:3]], NAMES, dialect="krl").text
    edited = "\n".join(line + " C_DIS" * line.startswith("  PTP") for line in text.split("\n"))
    refused(edited, "krl")
    stated = edited.replace("  PTP", "  $APO.CDIS=50\n  PTP", 1)
    moves = RobotProgram.parse(stated, dialect="krl", allow_changes=True).moves
    assert [(move.blend.radius, move.blend.share) for move in moves] == [(0.05, 0.5)] * 3
    assert [move.blend for move in RobotProgram.parse(text, dialect="krl").moves] == [None] * 3


def test_blends_of_krl_between_two_stops_have_the_least_of_their_distances():
    radii = (None, 0.05, 0.02, None, 0.1, None)
    moves = [JointMove(np.full(6, 0.1 * k), blend=radius and Blend(radius, 0.5)) for k, radius in enumerate(radii)]
    read = make_program(moves, NAMES, dialect="krl").moves
    assert [move.blend and move.blend.radius for move in read] == [None, 0.02, 0.02, None, 0.1, None]


@pytest.mark.parametrize(("zone", "stated"), [("z0", 0.0003), ("z10", 0.01), ("z200", 0.2)])
def test_a_zone_of_rapid_is_covered_with_twice_its_radius(zone, stated):
    text = some_program("rapid").text.replace("z10", zone)
    blend = RobotProgram.parse(text, dialect="rapid", allow_changes=True).moves[1].blend
    assert (blend.radius, blend.share, blend.radius * blend.stated) == pytest.approx((2 * stated, 0.5, stated))


# -- tools, loads, frames, sensors and external axes ------------------------------------------------------------------

RAIL = {"rail": "mm", "table": "deg"}
INPUT = {"urscript": "3", "rapid": "di_part", "krl": "3", "fanuc": "3"}
LENGTH = {"urscript": 1e-6, "rapid": 1e-7, "krl": 1e-8, "fanuc": 1e-6}
"""m: half of the last decimal of the lengths of a tool or frame, and more for their rotation."""

values = st.floats(-1, 1)
vectors = st.tuples(values, values, values)
poses = st.builds(pp.pose, vectors, st.tuples(*[st.floats(-1.5, 1.5)] * 3))
times = st.floats(0.05, 30).map(lambda x: round(x, 2))
words = st.text(max_size=24)


@st.composite
def programs(draw, dialect):
    """The arguments of a random program."""
    external = {} if dialect == "urscript" else draw(st.sampled_from([{}, RAIL, {"rail": "mm"}]))
    names = (*external, *NAMES)
    q = st.lists(st.floats(-3, 3), min_size=len(names), max_size=len(names)).map(np.array)
    blend = st.sampled_from([None, BLEND[dialect]])
    percent = st.integers(1, 100)
    joint = {
        "krl": st.builds(JointMove, q, blend=blend, percent=percent, gain=percent),
        "fanuc": st.builds(JointMove, q, blend=blend, percent=percent) | st.builds(JointMove, q, times, blend),
        "rapid": st.builds(JointMove, q, times, blend),
        "urscript": st.builds(JointMove, q, times, blend) | st.builds(JointMove, q, blend=blend, speed=times),
    }[dialect]
    speed = st.floats(0.01, 2).map(lambda x: round(x, 3))
    line = st.builds(LinearMove, q, poses, speed=speed, blend=blend, acceleration=speed)
    if dialect != "krl":
        line |= st.builds(LinearMove, q, poses, times, blend=blend)
    parts = st.none() | st.builds(pp.Payload, st.floats(0.01, 5), vectors)
    step = st.one_of(
        joint, line, st.builds(SetOutput, st.just(OUTPUT[dialect]), st.booleans()), st.builds(Wait, times),
        st.builds(CheckInput, st.just(INPUT[dialect]), st.booleans(), times, error=st.sampled_from(["", "recover"])),
        st.builds(SetLoad, parts), st.builds(Remark, words),
    )  # fmt: skip
    tool = draw(st.none() | st.builds(ToolData, st.just("gripper"), poses, st.floats(0.001, 5), vectors))
    frame = None if dialect == "urscript" else draw(st.none() | st.builds(UserFrame, st.just("bin"), poses))
    steps = [JointMove(draw(q)), *draw(st.lists(step, max_size=12))]
    return steps, {"tool": tool, "frame": frame, "external_joints": external, "joint_names": names}


def close(one, other, tolerance):
    return np.abs(np.asarray(one) - np.asarray(other)).max(initial=0) <= tolerance


@every_language
@settings(max_examples=40, deadline=None, phases=(Phase.generate,))
@given(data=st.data())
def test_what_is_written_is_read_back_to_the_last_decimal(dialect, data):
    steps, stated = data.draw(programs(dialect))
    program, unit = make_program(steps, dialect=dialect, **stated), RESOLUTION[dialect]
    assert [type(step) for step in program.steps] == [type(step) for step in steps]
    tool, frame = stated["tool"], stated["frame"]
    for one, other, facts in (
        (program.tool, tool, lambda each: (each.name, each.tcp)),
        (program.frame, frame, lambda each: (each.name, each.pose)),
    ):  # fmt: skip
        assert (one is None) == (other is None)
        if other is not None:
            (name, read), (_, wrote) = facts(one), facts(other)
            assert name == other.name
            assert close(read.translation, wrote.translation, LENGTH[dialect])
            assert close(read.rotation, wrote.rotation, 2e-5 if dialect == "fanuc" else 3e-8)
    if tool is not None:
        assert close([program.tool.mass, *program.tool.center_of_mass], [tool.mass, *tool.center_of_mass], 6e-4)
    for wrote, read in zip(steps, program.steps, strict=True):
        if isinstance(wrote, JointMove):
            assert close(read.q, wrote.q, unit)
            assert (read.blend is None) == (wrote.blend is None)
            assert wrote.percent in (None, read.percent)
            assert wrote.gain in (None, read.gain)
            assert wrote.duration in (None, pytest.approx(read.duration, abs=1e-3))
        elif isinstance(wrote, LinearMove):
            assert (read.blend is None) == (wrote.blend is None)
            assert (wrote.speed, wrote.duration) == (
                pytest.approx(read.speed, abs=1e-3), pytest.approx(read.duration, abs=1e-3),
            )  # fmt: skip
            if dialect == "krl":
                assert read.acceleration == pytest.approx(wrote.acceleration, abs=1e-6)
                assert close(read.pose.homogeneous, wrote.pose.homogeneous, 1e-6)
                rail = wrote.q[: len(stated["external_joints"])]
                assert read.external is None if not len(rail) else close(read.external, rail, unit)
            else:
                assert close(read.q, wrote.q, unit)
        elif isinstance(wrote, SetLoad):
            assert (read.payload is None) == (wrote.payload is None)
            if wrote.payload is not None:
                assert read.payload.mass == pytest.approx(wrote.payload.mass, abs=1e-3)
                # rounding of the masses of tool and part moves the centre of mass of the part
                error = 2e-6 + 4e-3 * (1 + (tool.mass if tool else 0)) / wrote.payload.mass
                assert close(read.payload.center_of_mass, wrote.payload.center_of_mass, error)
        elif isinstance(wrote, Remark):
            assert all(" " <= character <= "~" and character != ";" for character in read.words)
        else:
            assert replace(read, line=0) == wrote


@pytest.mark.parametrize("dialect", ["rapid", "krl", "fanuc"])
def test_a_rail_and_a_turntable_are_external_axes_in_millimetres_and_degrees(dialect):
    q = np.array([1.2345, np.pi / 4, *np.zeros(6)])
    program = make_program([JointMove(q)], (*RAIL, *NAMES), dialect=dialect, external_joints=RAIL)
    wanted = {
        "rapid": "],[1234.5000,45.0000,9E9,9E9,9E9,9E9]]",
        "krl": ",E1 1234.5000,E2 45.0000}",
        "fanuc": "   GP2:\n    UF : 0, UT : 1,\n    J1 = 1234.500 mm, J2 = 45.000 deg\n",
    }[dialect]
    assert wanted in program.text
    assert ("DEFAULT_GROUP = 1,1,*,*,*;" in program.text) == (dialect == "fanuc")
    assert close(program.moves[0].q, q, 1e-9)
    assert program.external_joints == RAIL
    # The coupling of joints is that of the robot
    mapping = JointMap(-np.ones(6), np.zeros(6), coupling=-1.0)
    bent = np.array([1.0, 0.5, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    mapped = make_program([JointMove(bent)], (*RAIL, *NAMES), dialect=dialect, external_joints=RAIL, joint_map=mapping)
    assert close(mapped.moves[0].q, bent, 2 * RESOLUTION[dialect])


@pytest.mark.parametrize("dialect", ["urscript", "krl", "fanuc"])
def test_a_load_that_is_less_than_the_tool_or_elsewhere_is_refused(dialect):
    tool = ToolData("gripper", pp.pose((0.0, 0.0, 0.1)), 1.25, (0.0, 0.0, 0.06))
    steps = [JointMove(np.zeros(6)), SetLoad(None)]
    text = make_program(steps, NAMES, dialect=dialect, tool=tool).text
    first = text.rindex("1.25")
    for old, new in (("1.25", "0.25"), ("0.06", "0.09") if dialect == "urscript" else ("60.0", "90.0")):
        edited = text[:first] + text[first:].replace(old, new, 1)
        assert edited != text
        with pytest.raises(TrajectoryError, match="load"):
            RobotProgram.parse(edited, dialect=dialect, allow_changes=True)


def test_external_joints_are_the_prismatic_ones_before_the_robot():
    class Rail:
        joint_names, angular = ("x", "y", *NAMES), np.array([False, False, *[True] * 6])

    assert external_joints(Rail) == {"x": "mm", "y": "mm"}
    for dialect in ("rapid", "krl", "fanuc"):
        assert DIALECTS[dialect].refuses(Rail, external_joints(Rail)) == ""
    assert "external axes" in DIALECTS["urscript"].refuses(Rail, external_joints(Rail))
    panda = pp.load_robot("panda").arm()
    with pytest.raises(InputError, match="panda_joint1"):
        external_joints(panda)
    assert external_joints(panda, ["panda_joint1"]) == {"panda_joint1": "deg"}
    with pytest.raises(UnknownNameError):
        external_joints(panda, ["rail"])
    with pytest.raises(InputError, match="external axes"):
        make_program([JointMove(np.zeros(7))], ("rail", *NAMES), dialect="urscript", external_joints={"rail": "mm"})


@every_language
def test_two_programs_have_names_of_their_own(dialect):
    language = DIALECTS[dialect]
    names = list[str]()
    for name in ("bolt 1", "bolt-1", "Bolt_1", "b" * 99, "b" * 98 + "c", "main", "while", "9\u00fc", "tool0"):
        names.append(language.identifier(name, names))
    assert len({name.lower() for name in names}) == len(names)
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) and len(name) <= language.longest for name in names)
    texts = [some_program(dialect, name=name).text for name in names[:2]]
    routines = [set(re.findall(r"(?:def|PROC|DEF|MODULE|/PROG) +(\w+)", text)) for text in texts]
    assert not routines[0] & routines[1]
    assert "PROC main" not in "".join(texts)


@every_language
def test_a_main_routine_calls_the_programs_in_order(dialect):
    language = DIALECTS[dialect]
    if dialect == "urscript":
        with pytest.raises(InputError, match="main: true"):
            language.main(["a", "b"])
        return
    text = language.main(["home", "bolt_1"])
    calls = [
        name.lower() for name in re.findall(r"^(?:[ \d:]+(?:CALL )?)(home|bolt_1)(?:\(\)|;| ;)", text, re.M | re.I)
    ]
    assert calls == ["home", "bolt_1"]
    assert (
        text
        == {
            "rapid": "MODULE m_main\n  PROC main()\n    home;\n    bolt_1;\n  ENDPROC\nENDMODULE\n",
            "krl": "DEF main()\n  EXT home()\n  EXT bolt_1()\n  home()\n  bolt_1()\nEND\n",
            "fanuc": '/PROG  MAIN\n/ATTR\nCOMMENT = "pinproof";\nDEFAULT_GROUP = 1,*,*,*,*;\n/MN\n   1:  CALL HOME ;\n'
            "   2:  CALL BOLT_1 ;\n/POS\n/END\n",
        }[dialect]
    )


def full_text(dialect):
    """A program with every construct."""
    tool = ToolData("gripper", pp.pose((0.0, 0.01, 0.17), (0.1, 0.2, 0.3)), 1.25, (0.0, 0.0, 0.06))
    frame = None if dialect == "urscript" else UserFrame("bin", pp.pose((0.5, 0.1, 0.0)))
    sensor = CheckInput(INPUT[dialect], True, 1.5, error="recover")
    part = SetLoad(pp.Payload(0.5, (0.0, 0.0, 0.2)))
    steps = [*some_steps(dialect), sensor, part, Remark("retreat"), SetLoad(None)]
    return make_program(steps, NAMES, dialect=dialect, tool=tool, frame=frame).text


@pytest.mark.parametrize(
    ("dialect", "before", "after"),
    [
        # a tool or frame that is not declared, declared twice or later, or another one in a move
        ("rapid", "LOCAL PERS tooldata", "! PERS tooldata"), ("rapid", "fine, t_gripper", "fine, tool0"),
        ("rapid", "fine, t_gripper", "fine, t_other"), ("rapid", "WObj:=w_bin", "WObj:=wobj0"),
        ("rapid", "GripLoad load_1", "GripLoad load_2"), ("rapid", "[FALSE,TRUE,", "[TRUE,TRUE,"),
        ("rapid", "[TRUE,[[", "[FALSE,[["), ("rapid", "loaddata load_1", "loaddata load_2"),
        ("krl", "  $TOOL=", "  ; $TOOL="), ("krl", "  $BASE=", "  ; $BASE="),
        ("krl", "  $APO.CDIS=10.0\n", "  $APO.CDIS=10.0\n  $BASE={X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}\n"),
        ("urscript", "  set_tcp(", "  # set_tcp("),
        ("urscript", "sleep(0.25", "set_tcp(p[0.0, 0.0, 0.0, 0.0, 0.0, 0.0])\n  sleep(0.25"),
        ("fanuc", "UTOOL_NUM=1", "UTOOL_NUM=2"), ("fanuc", "UFRAME_NUM=1", "UFRAME_NUM=0"),
        ("fanuc", "!Z 170.000", "!Z 17O.000"),
        ("fanuc", "  PAYLOAD[2]", "  PAYLOAD[3]"), ("fanuc", "UF : 1", "UF : 0"),
        # a check of the sensor without its branch, for another time, state or label
        ("rapid", "      EXIT;\n", ""), ("rapid", "IF timed_out THEN", "IF TRUE THEN"), ("rapid", "EXIT;", "RETURN;"),
        ("krl", "    HALT\n", ""), ("krl", ",A 0.000000", ",A 1800.000000"),
        ("krl", "$TIMER[1]=-1500", "$TIMER[1]=1500"),
        ("krl", "IF $IN[3]<>TRUE", "IF $IN[4]<>TRUE"),
        ("krl", "IF $IN[3]<>TRUE", "IF $IN[3]<>FALSE"), ("krl", "ENDLOOP", "END"),
        ("urscript", "halt", "sync()"), ("urscript", "waited > 1.5", "waited < 1.5"),
        ("urscript", "waited = 0\n", ""), ("fanuc", "ABORT", "PAUSE"),
        ("fanuc", "TIMEOUT,LBL[1]", "TIMEOUT,LBL[2]"), ("fanuc", "JMP LBL[2]", "JMP LBL[1]"),
        ("fanuc", "  LBL[2]", "  LBL[3]"),
    ],
)  # fmt: skip
def test_a_declaration_or_a_check_that_was_broken_is_refused(dialect, before, after):
    text = full_text(dialect)
    assert before in text
    RobotProgram.parse(text, dialect=dialect)
    assert refused(text.replace(before, after, 1), dialect)


def test_a_joint_move_of_rapid_at_the_slow_speed_is_only_the_first_one():
    """At v100 the tcp moves with 100 mm/s, however far the joints move."""
    text = full_text("rapid")
    slow = re.sub(r"(MoveAbsJ .*, )v1000\\T:=[0-9.]+", r"\1v100", text)
    assert slow != text
    assert "first" in str(refused(slow, "rapid"))


@pytest.mark.parametrize("number", [1, 3])
def test_a_load_schedule_of_fanuc_has_one_load(number):
    """The pendant holds one load in each schedule; schedule 1 is that of the tool."""
    tool = ToolData("gripper", pp.pose((0.0, 0.0, 0.17)), 1.25, (0.0, 0.0, 0.06))
    loads = [SetLoad(pp.Payload(mass, (0.0, 0.0, 0.2))) for mass in (0.5, 0.25)]
    steps = [*some_steps("fanuc"), *loads, loads[0]]
    text = make_program(steps, NAMES, dialect="fanuc", tool=tool).text
    other = re.sub(r"PAYLOAD( |\[)2", rf"PAYLOAD\g<1>{number}", text)
    assert other != text
    assert f"PAYLOAD[{number}]" in str(refused(other, "fanuc"))


def reading(value):
    """What a program states, as plain values without the numbers of lines."""
    if is_dataclass(value):
        rows = [(name.name, reading(getattr(value, name.name))) for name in fields(value)]
        return tuple(row for row in rows if row[0] not in ("line", "lines", "text", "certificate", "source"))
    if isinstance(value, pp.spatial.SE3):
        return reading(value.homogeneous)
    if isinstance(value, np.ndarray):
        return tuple(value.ravel())
    return tuple(reading(each) for each in value) if isinstance(value, tuple | list) else value


@every_language
def test_every_number_counts(dialect):
    """Each number of a program is edited: the program is refused, or read with another value."""
    lines, known = full_text(dialect).split("\n"), DIALECTS[dialect]
    original = reading(RobotProgram.parse("\n".join(lines), dialect=dialect))
    read = 0
    for k, line in enumerate(lines):
        if known.comment_of(line) is not None or (line.strip().startswith("!") and "-" in line[:12]):
            continue
        bare = re.sub(r"^ *\d*:", lambda found: " " * len(found[0]), line)  # numbers of lines mean nothing
        for found in re.finditer(r"\d+(?:\.\d+)?", bare):
            start, end = found.span()
            for number in (f"{float(found[0]) * 1.25 + 1:g}", f"{float(found[0]) * 0.75:g}", f"{float(found[0]):g}1"):
                if float(number) == float(found[0]):
                    continue
                text = "\n".join([*lines[:k], line[:start] + number + line[end:], *lines[k + 1 :]])
                try:
                    changed = RobotProgram.parse(text, dialect=dialect, allow_changes=True)
                except TrajectoryError:
                    continue
                read += 1
                assert reading(changed) != original, (line, number)
    assert read > 40


@pytest.mark.parametrize(("acceleration", "free"), [(1.0, True), (1e3, False)])
def test_a_stated_acceleration_is_compared_with_the_limits(acceleration, free):
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    arm = arm.with_limits(replace(arm.limits, acceleration=np.full(6, 40.0), acceleration_source="measured"))
    q = np.array([0.0, -1.2, 1.4, -1.7, -1.57, 0.0])
    near = LinearMove(q + 0.02, None, speed=0.05, acceleration=acceleration)
    for step in (JointMove(q + 0.1, speed=0.05, acceleration=acceleration), near):
        program = make_program([JointMove(q), step], arm.joint_names, dialect="urscript")
        assert program.moves[1].acceleration == acceleration
        certificate = pp.collision.certify_program(program, pp.CollisionChecker(arm))
        assert any("acceleration" in each for each in certificate.outside_limits) == (not free)


@pytest.mark.parametrize(
    ("dialect", "old", "new"),
    [
        ("rapid", "AccSet 100, 100;", "AccSet 50, 100;"),
        ("rapid", "AccSet 100, 100;", "AccSet 150, 150;"),
        ("rapid", "    AccSet 100, 100;\n", ""),
        ("rapid", "  ENDPROC", "    PathAccLim TRUE \\AccMax:=1, FALSE;\n  ENDPROC"),
        ("fanuc", " FINE ;", " FINE ACC50 ;"),
        ("fanuc", " FINE ;", " FINE ACC150 ;"),
    ],
)
def test_other_accelerations_than_the_usual_ones_are_refused(dialect, old, new):
    """Per cents of values that no manual states, so that no motion could be proven with them."""
    text = full_text(dialect)
    assert old in text
    with pytest.raises(TrajectoryError):
        RobotProgram.parse(text.replace(old, new), dialect=dialect, allow_changes=True)


@every_language
def test_every_edited_line_of_a_complete_program_is_noticed(dialect):
    lines = full_text(dialect).rstrip("\n").split("\n")
    for k, line in enumerate(lines):
        with pytest.raises(TrajectoryError):
            RobotProgram.parse("\n".join([*lines[:k], line + "1", *lines[k + 1 :]]), dialect=dialect)
        with pytest.raises(TrajectoryError):
            RobotProgram.parse("\n".join([*lines[:k], *lines[k + 1 :]]), dialect=dialect)


def test_a_frame_is_refused_where_a_language_has_none():
    with pytest.raises(InputError, match="frame"):
        make_program([JointMove(np.zeros(6))], NAMES, dialect="urscript", frame=UserFrame("bin", pp.pose()))


def test_poses_of_krl_are_stated_in_the_frame():
    frame = UserFrame("bin", pp.pose((0.5, 0.1, 0.2), (0.0, 0.0, np.pi / 2)))
    line = LinearMove(None, frame.pose * pp.pose((0.1, 0.2, 0.3), (0.0, 0.0, 0.5)), speed=0.2)
    text = make_program([JointMove(np.zeros(6)), line], NAMES, dialect="krl", frame=frame).text
    assert "LIN {X 100.00000,Y 200.00000,Z 300.00000,A 28.64789,B 0.00000,C 0.00000}" in text


def test_the_load_of_rapid_is_that_of_the_part_in_the_axes_of_the_tool():
    """Other languages state tool and part together, at the flange."""
    tool = ToolData("gripper", pp.pose((0.0, 0.0, 0.1), (np.pi, 0.0, 0.0)), 1.0, (0.0, 0.0, 0.05))
    steps = [JointMove(np.zeros(6)), SetLoad(pp.Payload(0.5, (0.0, 0.0, 0.11))), SetLoad(None)]
    texts = {dialect: make_program(steps, NAMES, dialect=dialect, tool=tool).text for dialect in MOVING}
    assert "load_1:=[0.5000,[0.0000,0.0000,-10.0000]" in texts["rapid"]
    assert "set_target_payload(1.500000, [0.000000, 0.000000, 0.070000])" in texts["urscript"]
    assert texts["krl"].count("$LOAD={M 1.000000,CM {X 0.000000,Y 0.000000,Z 50.000000") == 2
    assert "!PAYLOAD 2 1.500kg ;" in texts["fanuc"]


def test_a_tool_without_a_mass_leaves_the_load_to_the_controller():
    """A payload of 0 would replace that of the installation."""
    tool = ToolData("gripper", pp.pose((0.0, 0.0, 0.1)))
    texts = {d: make_program([JointMove(np.zeros(6))], NAMES, dialect=d, tool=tool) for d in MOVING}
    assert "set_target_payload" not in texts["urscript"].text
    assert "$LOAD" not in texts["krl"].text
    assert "PAYLOAD" not in texts["fanuc"].text
    assert [program.tool.mass for program in texts.values()] == [0.0, 0.001, 0.0, 0.0]
