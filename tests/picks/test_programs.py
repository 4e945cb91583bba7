"""Programs of judged picks: events at the right times, files, robot programs, and certification in the cell again."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision.certificates.certificate import curve_hash
from pinproof.errors import InputError, UnknownNameError
from pinproof.motion import (
    Blend,
    CheckInput,
    JointMove,
    LinearMove,
    MotionProgram,
    Remark,
    RobotProgram,
    SetLoad,
    SetOutput,
    StreamedPoint,
    Wait,
)
from pinproof.picks import REPORT_SUFFIXES, PickReport, certify_picks_program, export_picks, write_motion_pages
from pinproof.picks.input.pick import ToolSpeed
from pinproof.picks.judging.task import PickTask
from pinproof.picks.report import program_export

from .conftest import cell_of

FREE, VIOLATED = pp.CertificateStatus.FREE, pp.CertificateStatus.VIOLATED
UNDECIDED = pp.CertificateStatus.UNDECIDED


@pytest.fixture(scope="module")
def carried() -> tuple[PickReport, pp.Picks]:
    """A pick with an object and a place."""
    cell = cell_of("ur5", "carry.yaml", "over_the_wall")
    report = pp.validate_picks(*cell)
    assert report.ok, report.summary
    return report, cell[2]


@pytest.fixture(scope="module")
def empty() -> tuple[PickReport, pp.Picks]:
    """A pick that states no object."""
    cell = cell_of("ur5", "picks.yaml", "bolt_1")
    report = pp.validate_picks(*cell)
    assert report.ok, report.summary
    return report, cell[2]


@pytest.fixture(scope="module")
def report(carried) -> PickReport:
    return carried[0]


@pytest.fixture(scope="module")
def verdict(report) -> pp.picks.PickVerdict:
    return report.good[0]


# -- motion programs --------------------------------------------------------------------------------------------------


def test_segments_and_events_share_one_continuous_clock(carried, verdict) -> None:
    program = verdict.program(grip_dwell=0.4, release_dwell=0.2)
    assert [segment.name for segment in program.segments] == [motion.name for motion in verdict.motions]
    rest = {event.time: event.dwell for event in program.events}
    for one, other in pairwise(program.segments):
        assert other.start == pytest.approx(one.end + rest.get(one.end, 0.0), abs=1e-9)
        np.testing.assert_array_equal(one.trajectory.end, other.trajectory.start)
    assert program.duration == pytest.approx(verdict.trajectory.duration + 0.6, abs=1e-9)
    assert verdict.program().duration == pytest.approx(verdict.trajectory.duration, abs=1e-9)
    # The events are at the grasp and at the release
    arm, program = carried[0].setup.checker.arm, verdict.program(grip_dwell=0.4)
    grip, release = program.events
    assert (grip.kind, grip.time, grip.dwell) == ("grip", verdict.grasp_time, 0.4)
    assert (release.kind, release.dwell) == ("release", 0.0)
    assert release.time == pytest.approx(verdict.release_time + 0.4, abs=1e-9)
    assert grip.object == release.object == verdict.motions[2].attached[-1].name
    np.testing.assert_array_equal(program(grip.time), verdict.q_grasp)
    tip = arm.root_from_base * arm.forward_kinematics(program(grip.time + 0.2)) * carried[1].tip
    assert np.linalg.norm(tip.translation - verdict.pick.pose.translation) < 1e-5


def test_pick_without_object_is_split_at_the_grasp_under_one_certificate(empty) -> None:
    verdict = empty[0].good[0]
    program = verdict.program(grip_dwell=0.5)
    assert [event.kind for event in program.events] == ["grip"]
    assert (len(program.segments), len(program.certificates)) == (2, 1)
    assert program.segments[0].end == verdict.grasp_time
    (whole,) = program.motions.values()
    assert curve_hash(whole) == verdict.motions[0].certificate.curve == next(iter(program.certificates.values())).curve


@pytest.mark.slow
def test_a_folder_has_all_reports_and_the_motion_and_program_of_each_good_pick(report, verdict, tmp_path) -> None:
    (stem,) = report.save_folder(tmp_path, grip_dwell=0.2)
    motions = {f"{stem}.json", f"{stem}.program.json"}
    assert {path.name for path in tmp_path.iterdir()} == {f"report{kind}" for kind in REPORT_SUFFIXES} | motions
    program = MotionProgram.load(tmp_path / f"{stem}.program.json")
    assert program.to_json() == report.programs(grip_dwell=0.2)[0].to_json()
    # It names its certificates
    assert (program.robot, program.tcp) == ("ur5", "tool0")
    curves = [motion.certificate.curve for motion in verdict.motions]
    assert [program.certificates[segment.certificate].curve for segment in program.segments] == curves
    pages = write_motion_pages(verdict, report.setup.checker.arm, tmp_path / "motion.html")
    names = [f"motion_{number}_{motion.name}" for number, motion in enumerate(verdict.motions, start=1)]
    assert [page.stem for page in pages] == names
    assert all(page.is_file() for page in pages)


@pytest.mark.parametrize("cell", ["carried", "empty"])
def test_program_is_certified_again_in_its_cell(cell, request) -> None:
    report, picks = request.getfixturevalue(cell)
    verdict = report.good[0]
    proofs = report.setup.recertify(verdict.program(grip_dwell=0.3), picks.picks[0])
    assert [proof.status for proof in proofs] == [FREE] * len(verdict.motions)
    for proof, motion in zip(proofs, verdict.motions, strict=True):
        assert (proof.curve, proof.setup) == (motion.certificate.curve, motion.certificate.setup)
        assert proof.clearance == pytest.approx(motion.certificate.clearance, abs=1e-6)


def test_changed_number_is_noticed_by_certifying_again(report, verdict, tmp_path: Path) -> None:
    (path,) = report.save_programs(tmp_path)
    data = json.loads(path.read_text())
    points = data["segments"][0]["points"]
    points[len(points) // 2]["positions"][1] += 1.0  # the shoulder lowers the arm into the table
    path.write_text(json.dumps(data))
    program = MotionProgram.load(path, allow_changes=True)
    assert program.changed == (program.segments[0].name,)
    first, *others = report.setup.recertify(program, verdict.pick)
    assert not first.free
    assert all(proof.free for proof in others)


def test_programs_that_do_not_fit_are_refused(report, verdict, empty) -> None:
    program, both = report.programs()[0], [(verdict.pick, report.programs()[0])] * 2
    for refused, named in (
        # Without a place, the part would be where it was grasped while the hand leaves
        (
            lambda: report.setup.recertify(program, replace(verdict.pick, place=None)),
            "'transfer', which does not",
        ),
        (lambda: report.setup.recertify(empty[0].good[0].program(), verdict.pick), r"'pick'"),
        (replace(verdict, trajectory=None, status=pp.picks.PickStatus.NOT_FOUND).program, r"no motion"),
        (lambda: export_picks(report.setup, both, "urscript", output="0"), "does not start where"),
    ):
        with pytest.raises(InputError, match=named):
            refused()


# -- robot programs ---------------------------------------------------------------------------------------------------

OUTPUTS = {"urscript": "0", "rapid": "grip", "krl": "3", "fanuc": "3"}


def exported(report: PickReport, dialect: str, *, grip: float = 0.5, **settings: float):
    """The pick as a robot program."""
    (program,) = report.programs(grip_dwell=grip, release_dwell=0.25)
    pick = report.good[0].pick
    return export_picks(report.setup, [(pick, program)], dialect, output=OUTPUTS[dialect], **settings)


@pytest.fixture(scope="module", params=OUTPUTS)
def made(report, request):
    return exported(report, request.param)


@pytest.fixture(scope="module")
def text(report) -> RobotProgram:
    return without_remarks(exported(report, "urscript").program)


def without_remarks(program: RobotProgram) -> RobotProgram:
    """The same moves, outputs and waiting times, in which the point before a move is the step before it."""
    return replace(program, steps=tuple(step for step in program.steps if not isinstance(step, Remark)))


@pytest.fixture(scope="module")
def certified(report, verdict) -> Callable[..., list]:
    """The certificates of a changed program for a changed pick."""

    def certify(program: RobotProgram, *steps, pick: pp.Pick | None = None):
        program = replace(program, steps=steps) if steps else program
        ((*proofs,),) = certify_picks_program(report.setup, [pick or verdict.pick], program)[0]
        return proofs

    return certify


def test_a_carried_part_is_gripped_at_the_grasp_and_released_at_the_place(report, verdict, made) -> None:
    assert made.free
    steps = made.program.steps
    switched = [(k, step.on) for k, step in enumerate(steps) if isinstance(step, SetOutput)]
    assert [on for _, on in switched] == [True, False]
    assert [step.seconds for step in steps if isinstance(step, Wait)] == [0.5, 0.25]
    ends = [motion.trajectory.end for motion in verdict.motions if motion.name in ("approach", "place", "leave")]
    arm = report.setup.checker.arm
    stops = [*(steps[k - 1] for k, _ in switched), made.program.moves[-1]]  # the line that leaves is as long as stated
    for stop, q in zip(stops, ends, strict=True):
        reached = stop.pose if stop.q is None else arm.forward_kinematics(stop.q)
        assert np.linalg.norm(reached.translation - arm.forward_kinematics(q).translation) < 1e-4
    # Few moves, linear next to the part, in little more time than the motion takes
    moves = made.program.moves
    assert len(moves) <= 12
    assert made.duration <= 1.1 * made.motion_duration
    assert [type(moves[k]) for k in (-4, -3, -2, -1)].count(LinearMove) >= 2
    assert all(isinstance(steps[k - 1], LinearMove) and steps[k - 1].blend is None for k, _ in switched)
    # The text alone is certified with the picks, and is undecided without them
    read = RobotProgram.parse(made.program.text, dialect=made.program.dialect)
    certificates, notes = certify_picks_program(report.setup, [verdict.pick], read)
    assert [[proof.status for proof in row] for row in certificates] == [[FREE] * len(verdict.motions)]
    assert (len(notes), read.deviation) == (1, 0.002)
    alone = pp.collision.certify_program(made.program, report.setup.checker)
    assert (alone.free, len(alone.outputs)) == (False, 2)


def test_a_line_entered_at_nearly_its_speed_states_the_acceleration_with_which_it_brakes() -> None:
    report = pp.validate_picks(*cell_of("ur5", "picks.yaml", "bolt_7"))
    made = exported(report, "krl")
    assert made.free
    assert any(isinstance(move, LinearMove) for move in made.program.moves)
    assert made.duration <= 1.1 * made.motion_duration


def test_moves_between_stops_take_as_long_as_the_limits_require(report, text) -> None:
    arm = report.setup.checker.arm
    for before, after in pairwise(text.moves):
        if not isinstance(after, JointMove):
            continue
        needed = pp.time_parametrise(pp.JointPath([before.q, after.q], arm.joint_names), arm.limits).duration
        # The text rounds joints to 1e-6 rad; a time grows at most in proportion to the relative change of a distance.
        rounding = 1e-6 / np.abs(after.q - before.q).max()
        assert after.blend is None or after.blend.radius > 0.0
        assert after.duration >= needed * (1.0 - rounding) - 2e-6


def test_a_deviation_of_the_controller_is_covered_where_the_part_is_on_no_support(report, verdict) -> None:
    exact, wide = (exported(report, "urscript", deviation=deviation) for deviation in (0.0, 0.0005))
    with pytest.raises(InputError, match="collision-free"):
        exported(report, "urscript", deviation=0.2)
    assert wide.free
    assert (exact.program.deviation, wide.program.deviation, exact.notes) == (0.0, 0.0005, ())
    (note,) = wide.notes
    for motion, tube in zip(verdict.motions, wide.certificates[0], strict=True):
        assert (motion.name in note) == bool(tube.partings)
        if tube.partings:
            assert not tube.tube.joints.any()
        else:
            assert np.all(np.asarray(tube.tube.joints) >= 0.0005)
    # Proven clearances are lower bounds, so they are compared with those of samples off the moves
    first, second = (move.q for move in wide.program.moves[:2])
    samples = first + np.linspace(0.0, 0.9, 60)[:, None] * (second - first)
    samples += 0.0005 * np.random.default_rng(0).choice([-1.0, 1.0], samples.shape)
    least = report.setup.checker.clearance_batch(samples).min()
    assert verdict.motions[0].name == "transit"
    assert least - 0.02 < wide.certificates[0][0].clearance <= least
    assert "not covered: over_the_wall" in wide.program.text
    assert "not covered" not in exact.program.text
    assert RobotProgram.parse(wide.program.text, dialect="urscript").certificate == wide.program.certificate != ""
    assert any(tube.partings for tube in wide.certificates[0])


@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.5), (0.0, 0.003, 0.0), *(0.001 * np.eye(3)).tolist()])
def test_a_program_for_a_part_that_is_elsewhere_or_turned_is_not_free(verdict, text, certified, shift) -> None:
    turned = pp.pose(rpy=shift) if max(shift) == 0.001 else None
    there = verdict.pick.pose * turned if turned else pp.pose(shift) * verdict.pick.pose
    _, approach, *_ = certified(text, pick=replace(verdict.pick, pose=there))
    assert approach.status is VIOLATED
    assert "from the grasp of the pick" in approach.message


def test_a_program_that_grasps_beside_the_part_is_not_free(report, verdict) -> None:
    """The pose of the pick is reached, but the part is not there: the grip stage decides."""
    arm, scene, picks = cell_of("ur5", "carry.yaml")
    part = scene[verdict.pick.object_name]
    aside = scene.remove(part.name).add(replace(part, pose=pp.pose((0.02, 0.02, 0.0)) * part.pose))
    setup = pp.picks.PickSetup.make(arm, aside, picks, home=None, rng=0)
    proofs = setup.recertify(report.programs()[0], verdict.pick)
    approach = proofs[[motion.name for motion in verdict.motions].index("approach")]
    assert approach.status is VIOLATED
    assert np.isnan(approach.clearance)


def test_the_parts_of_earlier_picks_are_not_covered(report, verdict, text) -> None:
    """Where the part was put down is no obstacle for the second pick, which a note states."""
    (pick,) = text.picks
    (first, count), *rest = pick.motions
    again = replace(pick, motions=((first, count + 1), *rest))
    below = tuple(replace(step, line=step.line + 100) for step in text.steps)
    both = replace(text, steps=(*text.steps, *below), picks=(pick, again))
    certificates, notes = certify_picks_program(report.setup, [verdict.pick], both)
    single = certify_picks_program(report.setup, [verdict.pick], text)[1]
    assert [len(row) for row in certificates] == [len(pick.motions)] * 2
    assert len(notes) == 2 * len(single) + 1
    assert "where they were picked" in notes[-1]


def test_a_gripper_that_does_not_switch_or_elsewhere_or_the_wrong_way_is_not_free(text, certified) -> None:
    """The outputs of the text count, not the names of the motions: later, earlier, exchanged."""
    switched = [k for k, step in enumerate(text.steps) if isinstance(step, SetOutput)]
    without = [step for step in text.steps if not isinstance(step, SetOutput | SetLoad | Wait)]
    assert certified(text, *without)[0].status is VIOLATED
    edits = []
    for wrong in (*([k] for k in switched), switched):
        edits.append([replace(s, on=not s.on) if i in wrong else s for i, s in enumerate(text.steps)])
    (pick,) = text.picks
    ends = np.cumsum([count for _, count in pick.motions])
    assert len(pick.motions) == 6
    for grip, release in ((0, 4), (2, 4), (1, 3), (1, 5), (0, 5), (3, 4)):
        steps = list(without)
        for at, on in ((release, False), (grip, True)):
            steps.insert(1 + int(ends[at]), replace(text.steps[switched[0]], on=on))
        edits.append(steps)
    for steps in edits:
        assert not all(proof.free for proof in certified(text, *steps))


def test_robot_programs_that_do_not_fit_are_refused(report, text, certified) -> None:
    steps = text.steps
    last = max(k for k, step in enumerate(steps) if isinstance(step, SetOutput))
    at = next(k for k, step in enumerate(steps) if isinstance(step, JointMove)) + 1
    point = StreamedPoint(steps[at].q, 0.008)
    for changed, named in (
        ({"steps": (*steps[:last], replace(steps[last], output="do_9"), *steps[last + 1 :])}, "do_9"),
        ({"steps": (replace(steps[0], duration=0.5), *steps[1:])}, "first point"),
        ({"steps": (*steps[:at], point, *steps[at + 1 :])}, "joint moves and linear moves only"),
        ({"steps": steps[:-1]}, r"moves|continues"),
        ({"steps": (*steps, steps[-1])}, r"moves|continues"),
        ({"joint_names": text.joint_names[::-1]}, "joints"),
        ({"picks": ()}, "states no picks"),
    ):
        with pytest.raises(InputError, match=named):
            certified(replace(text, **changed))
    with pytest.raises(UnknownNameError, match="over_the_wall"):
        certify_picks_program(report.setup, [], text)


def test_a_blend_that_leads_into_an_obstacle_is_not_free(text, certified) -> None:
    """The zone between the transit and the approach covers the wall of the bin if it is large."""
    at = next(k for k, step in enumerate(text.steps) if isinstance(step, LinearMove)) - 1
    for radius, free in ((0.005, True), (0.08, False)):
        blended = replace(text.steps[at], blend=Blend(radius))
        first, *others = certified(text, *text.steps[:at], blended, *text.steps[at + 1 :])
        assert first.free is free
        assert free or "blend at line" in first.message
        assert all(proof.free for proof in others)


def test_a_move_that_is_too_fast_is_not_free(made, certified) -> None:
    text = without_remarks(made.program)
    at = next(k for k, step in enumerate(text.steps) if isinstance(step, JointMove)) + 1
    if text.dialect != "krl":  # which states no durations
        proofs = certified(text, *text.steps[:at], replace(text.steps[at], duration=1e-3), *text.steps[at + 1 :])
        assert {proof.status for proof in proofs} == {VIOLATED}


@pytest.mark.parametrize("dialect", OUTPUTS)
def test_programs_keep_the_limits_of_the_tool_that_a_pick_states(report, verdict, dialect) -> None:
    """KRL states no durations, so that a speed is reached earlier than in a motion that is slowed down."""
    (program,) = report.programs()
    pick = replace(verdict.pick, speed={name: ToolSpeed(linear_speed=0.1) for name in ("transit", "transfer", "place")})
    limited = export_picks(report.setup, [(pick, program)], dialect, output=OUTPUTS[dialect])
    assert limited.free
    arm, stages = (
        report.setup.checker.arm,
        [name for name, count in limited.program.picks[0].motions for _ in range(count)],
    )
    stage = dict(zip([move.line for move in limited.program.moves[1:]], stages, strict=True))
    text, traces, _ = pp.collision.traced(limited.program, arm)
    seen = set()
    for lines, motion in pp.collision.program_motions(text, arm, traces):
        for line, start, profile in zip(lines, motion.starts, motion.profiles, strict=True):
            if stage[line] in pick.speed:  # outside the zones, where only this move is executed
                last = min(start + profile.duration - profile.exit, motion.trajectory.duration)
                times = np.linspace(start + profile.entry, last, 300)
                tcp = arm.forward_kinematics_batch(motion.trajectory(times))[:, :3, 3]
                assert (np.linalg.norm(np.diff(tcp, axis=0), axis=1) / np.diff(times)).max() <= 0.1 * 1.001
                seen.add(stage[line])
    assert seen == set(pick.speed)
    # The program of the same pick without limits is too fast for them
    faster = exported(report, dialect).program
    (proofs,) = certify_picks_program(report.setup, [pick], faster)[0]
    slow = {name for (name, _), proof in zip(faster.picks[0].motions, proofs, strict=True) if proof.status is VIOLATED}
    assert slow == set(pick.speed)


@pytest.fixture(scope="module")
def slow() -> tuple[PickReport, float]:
    """The pick whose tool may be no faster than 0.25 m/s, and the duration of its motion."""
    arm, scene, picks = cell_of("ur5", "carry.yaml", "over_the_wall")
    speeds = {name: ToolSpeed(linear_speed=0.25) for name in ("transit", "approach", "retreat", "transfer", "place")}
    picks = replace(picks, picks=tuple(replace(pick, speed=speeds) for pick in picks.picks))
    report = pp.validate_picks(arm, scene, picks)
    return report, report.programs()[0].duration


@pytest.mark.parametrize("dialect", ["urscript", "krl", "fanuc"])
def test_a_stated_speed_of_the_tool_costs_a_program_little_time(slow, dialect) -> None:
    """Each move states the speed that it may have, at the usual accelerations; slow parts are moves of their own."""
    report, motion = slow
    made = exported(report, dialect, grip=0.0)
    assert made.free
    assert made.duration - 0.25 < 1.1 * motion


def test_a_program_that_leaves_the_position_limits_is_not_free(text, certified) -> None:
    """The last joint a turn further on: the same poses, but outside the limits."""
    turn = np.array([0.0] * 5 + [-2.0 * np.pi])
    steps = [replace(s, q=s.q + turn) if isinstance(s, JointMove | LinearMove) else s for s in text.steps]
    with pytest.raises(InputError, match=r"line \d+: wrist_3_joint = -7"):
        certified(text, *steps)


def test_the_hold_of_a_part_is_judged_on_all_moves_with_it(text, certified, monkeypatch) -> None:
    """Also behind a stop within the transfer."""
    (pick,) = text.picks
    names = [name for name, _ in pick.motions]
    first = 1 + sum(count for _, count in pick.motions[: names.index("transfer")])
    moves = [k for k, step in enumerate(text.steps) if isinstance(step, JointMove | LinearMove)]
    before, end = (text.steps[moves[k]] for k in (first - 1, first))
    middle = replace(end, q=(before.q + end.q) / 2.0, blend=None, line=1000)
    counts = tuple((name, count + (name == "transfer")) for name, count in pick.motions)
    starts = []

    class Hold:
        def peak(self, trajectory):
            starts.append(trajectory.start)
            return SimpleNamespace(holds=True)

    monkeypatch.setattr(PickTask, "hold", lambda *_: Hold())
    at = moves[first]
    certified(replace(text, picks=(replace(pick, motions=counts),)), *text.steps[:at], middle, *text.steps[at:])
    assert any(np.abs(q - middle.q).max() < 1e-9 for q in starts)


def test_a_line_whose_outer_end_is_out_of_reach_is_as_long_as_that_of_the_motion(report, verdict, monkeypatch) -> None:
    (program,), trace = report.programs(), program_export.trace_line

    def within_reach(arm, q, target, external=None):
        found, length = trace(arm, q, target, external), target.translation - arm.forward_kinematics(q).translation
        far = np.linalg.norm(length) > 0.0999 and np.allclose(q, verdict.q_grasp)
        return found._replace(reason="the arm cannot follow it") if far else found

    monkeypatch.setattr(program_export, "trace_line", within_reach)
    made = export_picks(report.setup, [(verdict.pick, program)], "rapid", output=OUTPUTS["rapid"])
    assert made.free
    motions = [name for name, _ in made.program.picks[0].motions]
    assert {"approach", "retreat", "place", "leave"} <= set(motions)


def test_krl_states_lower_accelerations_where_the_torques_of_a_heavy_part_need_them(report, verdict, certified) -> None:
    (program,) = report.programs()
    pick = replace(verdict.pick, payload=pp.Payload(8.0))
    made = export_picks(report.setup, [(pick, program)], "krl", output=OUTPUTS["krl"])
    transfer = next(k for k, step in enumerate(made.program.steps) if isinstance(step, JointMove) and step.gain < 100)
    assert made.free
    steps = [replace(step, gain=100) if k == transfer else step for k, step in enumerate(made.program.steps)]
    (proofs,), _ = certify_picks_program(report.setup, [pick], replace(made.program, steps=tuple(steps)))
    assert VIOLATED in {proof.status for proof in proofs}


# -- what programs state beside their moves ----------------------------------------------------------------------------


def with_settings(report: PickReport, **stated) -> pp.picks.PickSetup:
    """The set-up with settings of programs."""
    settings = replace(report.setup.shared.program, **stated)
    payload = pp.Payload(1.5, (0.0, 0.0, 0.05))
    shared = replace(report.setup.shared, program=settings, payload=(payload,))
    return replace(report.setup, shared=shared)


@pytest.mark.parametrize("dialect", OUTPUTS)
def test_a_program_states_tool_load_sensor_and_remarks(report, verdict, dialect) -> None:
    (program,) = report.programs(grip_dwell=0.5)
    pick = replace(verdict.pick, payload=pp.Payload(0.4))
    setup = with_settings(report, tool="gripper", input=INPUTS[dialect], timeout=2.0, error="recover")
    made = export_picks(setup, [(pick, program)], dialect, output=OUTPUTS[dialect], name="over 1")
    assert made.free
    read = made.program
    assert (read.name, read.tool.name, read.tool.mass) == ("over_1", "gripper", pytest.approx(1.5, abs=1e-3))
    arm = report.setup.checker.arm
    assert np.allclose(read.tool.tcp.homogeneous, np.eye(4), atol=1e-6)  # the tcp of this arm is its flange
    kinds = [type(step) for step in read.steps if not isinstance(step, JointMove | LinearMove | Remark)]
    assert kinds == [SetOutput, Wait, CheckInput, SetLoad, SetOutput, SetLoad]
    check = next(step for step in read.steps if isinstance(step, CheckInput))
    assert (check.input, check.on, check.seconds, check.error) == (INPUTS[dialect], True, 2.0, "recover")
    on, off = (step.payload for step in read.steps if isinstance(step, SetLoad))
    assert off is None
    assert on.mass == pytest.approx(0.4, abs=2e-3)
    # The centre of mass of the part at the grasp is at its frame in the scene
    q = verdict.q_grasp
    there = arm.root_from_base * arm.forward_kinematics(q) * np.array(on.center_of_mass)
    part = report.setup.checker.scene[verdict.pick.object_name].pose.translation
    assert np.linalg.norm(there - part) < 0.01
    words = [step.words for step in read.steps if isinstance(step, Remark)]
    assert len(words) == len(verdict.motions)
    assert words[0].startswith("pick over_the_wall")


def test_a_text_with_another_load_or_without_the_check_of_the_sensor_is_undecided(report, verdict) -> None:
    (program,) = report.programs(grip_dwell=0.5)
    pick = replace(verdict.pick, payload=pp.Payload(0.4))
    setup = with_settings(report, tool="gripper", input="3", timeout=2.0)
    read = export_picks(setup, [(pick, program)], "krl", output=OUTPUTS["krl"]).program
    check = next(step for step in read.steps if isinstance(step, CheckInput))
    load = next(step for step in read.steps if isinstance(step, SetLoad))
    without = [step for step in read.steps if step is not check]
    heavy = [replace(step, payload=pp.Payload(0.5)) if step is load else step for step in read.steps]
    late = [step for step in read.steps if step is not load]
    late.insert(late.index(check) + 3, load)  # after the remark and the next move
    tool = replace(read.tool, mass=1.4)
    for steps, stated, named in (
        (without, read.tool, "check of the sensor"),
        (heavy, read.tool, "load is not"),
        (late, read.tool, "load is not"),
        (read.steps, tool, "of the tool"),
    ):
        text = replace(read, steps=tuple(steps), tool=stated)
        (proofs,), _ = certify_picks_program(setup, [pick], text)
        assert {proof.status for proof in proofs} == {UNDECIDED}
        assert all(named in proof.message for proof in proofs)


INPUTS = {"urscript": "3", "rapid": "di_part", "krl": "3", "fanuc": "3"}


def test_a_language_is_refused_before_anything_is_planned() -> None:
    picks = pp.Picks(picks=())
    panda = pp.load_robot("panda").arm()
    for language, arm, settings, named in (
        ("ros2", pp.load_robot("ur5").arm(), {}, "digital outputs"),
        ("rapid", panda, {}, "panda_joint1"),
        ("urscript", panda, {"external_axes": ("panda_joint1",)}, "external axes"),
        ("urscript", pp.load_robot("ur5").arm(), {"main": True}, "main: true"),
        ("krl", pp.load_robot("ur5").arm(), {"input": "di_part"}, "digital inputs"),
    ):
        stated = replace(picks, program=replace(picks.program, **settings))
        with pytest.raises(InputError, match=named):
            pp.picks.check_export(arm, stated, language)
    stated = replace(picks, program=replace(picks.program, external_axes=("panda_joint1",)))
    assert pp.picks.check_export(panda, stated, "rapid") == {"panda_joint1": "deg"}
