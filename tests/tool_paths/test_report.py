"""Jobs of tool paths: the whole motion, the strip of rotations, suggestions that hold, and programs as executed."""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.tool_path_audits import arm_of, off_the_path

import pinproof as pp
from pinproof.motion import JointMove, LinearMove, RobotProgram, SetOutput
from pinproof.tool_paths import (
    FollowStatus,
    Stroke,
    ToolJob,
    ToolPath,
    follow_job,
    rotation_strip,
    suggest_changes,
)

UP = (0.0, 0.0, 1.0)
ANGLE = np.linspace(0.0, 2.0 * np.pi, 33)
CIRCLE = np.column_stack([0.45 + 0.1 * np.cos(ANGLE), 0.1 * np.sin(ANGLE), np.full(33, 0.2)])
TABLE = pp.Obstacle("table", pp.Box(0.7, 1.2, 0.05), pp.pose((0.65, 0.0, 0.1)))
WALL = pp.Obstacle("wall", pp.Box(0.5, 0.02, 0.4), pp.pose((0.5, -0.19, 0.3)))
FIN = pp.Obstacle("fin", pp.Box(0.2, 0.02, 0.02), pp.pose((0.14, 0.0, 0.03)))
LANGUAGES = ("urscript", "rapid", "krl", "fanuc")


@pytest.fixture(scope="module")
def checker():
    """The UR5 above a table."""
    return pp.CollisionChecker(arm_of("ur5"), pp.Scene([TABLE]), margin=0.002)


@pytest.fixture(scope="module")
def report(checker):
    """A circle and a line without the process, and the motion between them."""
    line = ToolPath.through([[0.45, -0.1, 0.2], [0.45, 0.1, 0.2]], UP, speed=0.1, name="line")
    circle = ToolPath.through(CIRCLE, UP, speed=0.1, name="circle")
    job = ToolJob(
        strokes=(Stroke("circle", circle), Stroke("line", line, process=False, reversible=False)), approach=0.04
    )
    return follow_job(job, checker=checker)


def test_the_motion_of_a_job_is_one_certified_curve_over_all_strokes(report, checker, tmp_path):
    assert report.ok
    whole = report.motion
    assert whole.certificate.matches(whole.trajectory, checker.arm, checker.scene)
    assert pp.audit(whole.trajectory, checker, step=0.02).clean
    parts = [*(own.plan.duration for own in report.strokes), *(transit.duration for transit in whole.transits)]
    assert whole.duration == pytest.approx(sum(parts), abs=1e-6)
    assert [name for name, _ in report.strokes[0].plan.motions] == ["approach", "path", "departure"]
    proof = whole.save(tmp_path / "motion.json")
    assert pp.verify_proof(proof, checker, pp.Trajectory.load(tmp_path / "motion.json", checker.arm.joint_names)).ok
    with pytest.raises(pp.errors.PlanFailed):
        follow_job(ToolJob(strokes=(far_stroke(),)), checker=checker, suggestions=0).export_program("rapid")


def far_stroke():
    return Stroke("far", ToolPath.through([[0.8, 0.0, 0.2], [1.2, 0.0, 0.2]], UP, speed=0.1))


def test_reports_have_the_figures_of_the_plans(report, tmp_path):
    data = json.loads(report.to_json())
    assert data["ok"]
    assert {each["name"] for each in data["strokes"]} == {"circle", "line"}
    rows = list(csv.DictReader(io.StringIO(report.to_csv())))
    for row, own in zip(rows, report.strokes, strict=True):
        assert float(row["duration"]) == own.plan.duration
        assert float(row["deviation"]) == own.plan.deviation
    for kind in report.formats:
        report.save(tmp_path / f"report{kind}")
        assert "circle" in (tmp_path / f"report{kind}").read_text()


def test_the_home_of_a_job_begins_and_ends_its_motion(checker):
    home = np.array([0.3, -1.5, 1.3, -1.4, -1.6, 0.0])
    settings = pp.Picks((), home=dict(zip(checker.arm.joint_names, home, strict=True)))
    line = ToolPath.through([[0.45, -0.1, 0.2], [0.45, 0.1, 0.2]], UP, speed=0.1)
    found = follow_job(ToolJob(strokes=(Stroke("line", line),), settings=settings), checker=checker)
    assert found.motion.trajectory.start == pytest.approx(home)
    assert found.motion.trajectory.end == pytest.approx(home)


# -- the strip ---------------------------------------------------------------------------------------------------------


def test_the_strip_states_what_every_solution_of_a_cell_is(checker):
    finned = pp.CollisionChecker(checker.arm, pp.Scene([TABLE, WALL]), margin=0.002, attached=[FIN])
    path = ToolPath.through(np.vstack([CIRCLE, [[1.0, 0.0, 0.2]]]), UP)
    strip = rotation_strip(finned, path, rotations=24)
    rng, seen = np.random.default_rng(0), set()
    for k in rng.integers(len(strip.places), size=60):
        for m in rng.integers(24, size=3):
            turn = pp.pose(rpy=(0.0, 0.0, strip.rotations[m]))
            target = path.at([strip.places[k]])[0] @ turn.homogeneous
            found = pp.AnalyticIk().solve_all(finned.arm, target).q
            expected = 0 if any(finned.is_free(q) for q in found) else 1 if len(found) else strip.cells[k, m]
            assert strip.cells[k, m] == expected
            assert len(found) or strip.cells[k, m] in (2, 3)
            seen.add(int(expected))
    assert {0, 1, 3} <= seen


def test_the_line_of_the_motion_passes_free_cells_only(checker):
    finned = pp.CollisionChecker(checker.arm, pp.Scene([TABLE, WALL]), margin=0.002, attached=[FIN])
    path = ToolPath.through(CIRCLE, UP, speed=0.1)
    plan = pp.follow(finned, path, lifts=2).or_raise()
    strip = rotation_strip(finned, path, plan)
    assert (strip.cells == 1).any()
    width = strip.rotations[1] - strip.rotations[0]
    for line in strip.chosen:
        for place, angle in line:
            apart = np.remainder(strip.rotations - angle + np.pi, 2.0 * np.pi) - np.pi
            # A cell is the rotation in its middle: the motion may pass a cell whose neighbour is free
            near = np.abs(apart) <= 1.5 * width
            assert (strip.cells[int(np.abs(strip.places - place).argmin()), near] == 0).any()
    # The rotation is that of the motion, by FK alone
    q = plan.pieces[0].q[0]
    turned = path.poses[0][:3, :3].T @ finned.arm.forward_kinematics(q).rotation
    assert strip.chosen[0][0, 1] == pytest.approx(np.arctan2(turned[1, 0], turned[0, 0]))


# -- suggestions -------------------------------------------------------------------------------------------------------


def test_a_suggestion_holds_and_is_the_smallest_of_its_kind(checker):
    table = pp.Obstacle("table", pp.Box(1.0, 1.2, 0.05), pp.pose((0.6, 0.0, 0.1)))
    blocked = checker.with_scene(pp.Scene([table]))
    path = ToolPath.through(CIRCLE - [0.02, 0.0, 0.0], UP, speed=0.1)
    plan = pp.follow(blocked, path, approach=0.05)
    assert plan.status is FollowStatus.BLOCKED
    found = {each.text: each for each in suggest_changes(plan, {"approach": 0.05})}
    assert found
    for each in found.values():
        assert each.plan.ok
        assert pp.audit(each.plan.trajectory, each.plan.checker, step=0.02).clean
    base = next(each for text, each in found.items() if text.startswith("move the base"))
    assert (base.text, base.size) == ("move the base by 50 mm along -x (base frame)", 50.0)
    # The base moves against the scene, and the path with it
    assert base.plan.checker.scene["table"].pose.translation == pytest.approx([0.65, 0.0, 0.1])
    assert base.plan.path.poses[:, 0, 3] == pytest.approx(path.poses[:, 0, 3] + 0.05)
    for size in (10, 20):
        for axis in np.vstack([np.eye(3), -np.eye(3)]):
            by = 1e-3 * size * axis
            moved = blocked.with_scene(pp.Scene([table]).move("table", pp.pose(table.pose.translation + by)))
            assert not pp.follow(moved, path.transformed(pp.pose(by)), approach=0.05).ok


def test_a_part_moves_with_its_path(checker):
    block = pp.Obstacle("block", pp.Box(0.1, 0.1, 0.1), pp.pose((0.95, 0.0, 0.2)))
    cell = checker.with_scene(pp.Scene([block]))
    path = ToolPath.through([[0.93, -0.04, 0.26], [0.93, 0.04, 0.26]], UP, speed=0.1)
    plan = pp.follow(cell, path)
    assert not plan.ok
    moved = [each for each in suggest_changes(plan, {}, part=["block"]) if "path and block" in each.text]
    assert moved
    for each in moved:
        scene, own = each.plan.checker.scene, each.plan.path
        to_path = own.poses[0][:3, 3] - scene["block"].pose.translation
        rotation = scene["block"].pose.rotation
        assert rotation.T @ to_path == pytest.approx(path.poses[0][:3, 3] - block.pose.translation)
    with pytest.raises(pp.errors.InputError, match="blok"):
        suggest_changes(plan, {}, part=["blok"])


@pytest.mark.parametrize(
    ("settings", "points", "expected"),
    [
        ({"free_rotation": False}, np.vstack([CIRCLE[::4]] * 3), "rotate freely"),
        ({"speed_tolerance": 0.1}, CIRCLE, "reduce the speed"),
    ],
)
def test_settings_that_are_the_reason_are_suggested(checker, settings, points, expected):
    plan = pp.follow(checker, ToolPath.through(points, UP, speed=2.0 if "speed" in expected else 0.1), **settings)
    assert not plan.ok
    texts = [each.text for each in suggest_changes(plan, settings, budget=4)]
    assert any(expected in text for text in texts), (plan.message, texts)


# -- programs ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_program_keeps_to_the_path_and_its_speed_as_its_text_is_executed(report, checker, language, tmp_path):
    made = report.export_program(language)
    assert made.ok
    assert made.certificate.free
    file = tmp_path / f"paths{pp.motion.find_dialect(language).endings[0]}"
    made.program.save(file)
    program, arm = RobotProgram.load(file), checker.arm
    # The process is on along the circle, and off along the line and between them
    on, strokes, here = False, [], None
    for step in program.steps:
        if isinstance(step, SetOutput):
            on = step.on
            if on:
                strokes.append([])
        if isinstance(step, JointMove):
            here = arm.forward_kinematics(step.q)
        if isinstance(step, LinearMove):
            end = arm.forward_kinematics(step.q) if step.pose is None else step.pose
            if on:
                strokes[-1].append((here, end, step))
            here = end
    (circle,) = strokes
    own = next(own for own in report.strokes if own.stroke.name == "circle")
    path = own.stroke.path
    ends = [circle[0][0], circle[-1][1]]
    for end, wanted in zip(ends, (path.poses[0], path.poses[-1]), strict=True):
        assert end.translation == pytest.approx(wanted[:3, 3], abs=1e-3)
    # By linear interpolation of the text, without the zones
    lines = [
        pp.spatial.interpolate(a, b, share).homogeneous for a, b, _ in circle for share in np.linspace(0.0, 1.0, 15)
    ]
    off = off_the_path(path, np.array(lines), made.deviation, freedom=True, first=0, last=len(path) - 1, parts=11)
    assert off[:, 0].max() <= made.deviation <= 1e-3
    assert off[:, 1].max() <= made.rotation_deviation + 1e-7
    assert off[:, 0].max() >= 1e-5
    speeds = [step.speed for *_, step in circle]
    assert min(speeds) >= made.speed_share * 0.1 * (1.0 - 1e-6)
    assert max(speeds) <= 0.1 + 1e-9
    assert made.speed_share > 0.95
    # Every point of the path is passed
    passed = np.array(lines)[:, :3, 3]
    assert max(np.linalg.norm(passed - pose[:3, 3], axis=1).min() for pose in path.poses) <= 1.5e-3
    # The lines are free by dense inverse kinematics
    q = np.array(own.plan.pieces[0].trajectory.start)
    for target in lines[::9]:
        q = pp.Clik().solve(arm, target, q0=q).or_raise().q
        assert checker.is_free(q)


def test_a_program_that_leaves_the_deviation_or_the_arm_is_refused(checker):
    line = ToolPath.through([[0.45, -0.1, 0.2], [0.45, 0.1, 0.2]], UP, speed=0.1)
    found = follow_job(ToolJob(strokes=(Stroke("line", line, reversible=False),)), checker=checker)
    strict = replace(found, job=replace(found.job, deviation=1e-9, rotation_deviation=1e-9))
    made = strict.export_program("rapid")
    assert made.certificate.free
    assert not made.ok
    with pytest.raises(pp.errors.NoAnswer):
        made.or_raise()
    # A program that states less than the tolerated speed
    quick = replace(found, job=replace(found.job, speed_tolerance=0.01))
    steady = quick.export_program("rapid")
    assert steady.ok
    own = found.strokes[0]
    faster = replace(own.plan.path, speed=4.0)
    hurried = replace(quick, strokes=(replace(own, plan=replace(own.plan, path=faster)),)).export_program("rapid")
    assert hurried.certificate.free
    assert hurried.speed_share < 0.99
    assert not hurried.ok
    with pytest.raises(pp.errors.InputError, match="7"):
        pp.tool_paths.require_language(arm_of("panda"), "rapid")


def test_sharp_corners_are_passed_in_zones_that_keep_to_the_deviation(checker):
    square = np.array([[0.4, -0.1, 0.25], [0.55, -0.1, 0.25], [0.55, 0.1, 0.25], [0.4, 0.1, 0.25]])
    job = ToolJob(strokes=(Stroke("square", ToolPath.through(square, UP, speed=0.05), reversible=False),))
    made = follow_job(job, checker=checker).export_program("urscript")
    zones = [step.blend.radius for step in made.program.moves if isinstance(step, LinearMove) and step.blend]
    assert made.ok
    assert made.stops == 0
    assert len(zones) == 2
    # A circle that touches both lines of a right angle at the ends of the zone is this far from the point
    assert max(zones) * (np.sqrt(2.0) - 1.0) / 2.0 <= made.deviation <= 1e-3
