"""Paths on a part that moves with a turntable or a second arm: checked against Pinocchio's model of the whole cell."""

import json
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pinocchio as pin
import pytest
from benchmarks.tool_path_audits import off_the_path

import pinproof as pp
from pinproof.ik import IkTask
from pinproof.tool_paths import FollowCosts, FollowStatus, ToolPath
from pinproof.tool_paths.rungs import Grid, LadderSettings, PathArm, Rung, RungLadder, fill

TABLE = """<link name="tip"/>
<joint name="tip" type="fixed"><parent link="{flange}"/><child link="tip"/><origin xyz="0 0 0.15"/></joint>
<link name="column"><collision><geometry><cylinder radius="0.08" length="0.2"/></geometry></collision></link>
<joint name="column" type="fixed"><parent link="{root}"/><child link="column"/><origin xyz="0.55 0 0.1"/></joint>
<link name="plate"><collision><geometry><cylinder radius="0.12" length="0.02"/></geometry></collision></link>
<joint name="table" type="{kind}"><parent link="column"/><child link="plate"/>
<origin xyz="0 0 0.12" rpy="0.15 0 0"/><axis xyz="0 0 1"/>{limits}</joint></robot>"""
LIMITS = '<limit lower="-{0}" upper="{0}" velocity="1" effort="1"/>'


def with_table(name, limit=None):
    """A robot with a turntable, whose axis is tilted, as one description."""
    urdf = pp.load_robot(name).urdf
    kind, limits = (
        ("continuous", '<limit velocity="1" effort="1"/>') if limit is None else ("revolute", LIMITS.format(limit))
    )
    own = TABLE.format(root=urdf.root, flange=pp.load_robot(name).arm().tcp, kind=kind, limits=limits)
    return pp.load_robot(urdf.text.replace("</robot>", own))


def seam(angle=2.0 * np.pi, count=49, speed=0.05):
    """A seam around a part on the plate, with the tool tilted outwards: one side of the part faces the robot."""
    a = np.linspace(0.0, angle, count)
    out = np.column_stack([np.cos(a), np.sin(a), np.zeros(count)])
    return ToolPath.through(0.09 * out + np.array([0, 0, 0.08]), out + np.array([0, 0, 0.8]), speed=speed, name="seam")


def tool_in_frame(checker, q, frame, tcp):
    """(N, 4, 4) the poses of the tool in a frame, by Pinocchio's model of the whole robot."""
    model = pin.buildModelFromXML(checker.group.robot.urdf.kinematics)
    data, poses = model.createData(), []
    held = dict(checker.group.held)
    for row in q:
        values = held | dict(zip(checker.group.joint_names, row, strict=True))
        full = pin.neutral(model)
        followers = {joint.name: joint.mimic for joint in checker.group.robot.urdf.joints.values() if joint.mimic}
        values |= {name: own.multiplier * values[own.leader] + own.offset for name, own in followers.items()}
        for name, value in values.items():
            full[model.joints[model.getJointId(checker.group.robot.urdf.model_joint(name))].idx_q] = value
        pin.framesForwardKinematics(model, data, full)
        one, other = (data.oMf[model.getFrameId(link)] for link in (frame, tcp))
        poses.append((one.inverse() * other).homogeneous)
    return np.array(poses)


def faults(plan, frame, tcp, *, freedom=True, deviation=1e-3, rotation=0.0174533):
    """What dense samples find wrong: contacts, limits, deviation and speed of the tool in the moving frame."""
    checker, found = plan.checker, []
    if not pp.audit(plan.trajectory, checker, step=0.02, measure=False, exact=False).clean:
        found.append("collision")
    limits, q = checker.group.limits, plan.trajectory(np.linspace(0.0, plan.duration, 2000))
    if (q < limits.lower - 1e-6).any() or (q > limits.upper + 1e-6).any():
        found.append("limits")
    for piece in plan.pieces:
        times = np.linspace(0.0, piece.trajectory.duration, 2001)
        poses = tool_in_frame(checker, piece.trajectory(times), frame, tcp)
        off = off_the_path(
            plan.path, poses, piece.deviation, freedom=freedom, first=piece.first, last=piece.last, parts=201
        ).max(axis=0)
        if off[0] > min(piece.deviation, deviation) + 1e-9 or off[1] > min(piece.rotation_deviation, rotation) + 1e-6:
            found.append(f"deviation {off}")
        speed = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1) / np.diff(times)
        along = np.cumsum(speed * np.diff(times))
        inside = (along > piece.ramps[0] + 1e-3) & (along < along[-1] - piece.ramps[1] - 1e-3)
        if speed.max() > piece.speed[1] * (1 + 1e-4) or speed[inside].min() < piece.speed[0] * (1 - 1e-4):
            found.append(f"speed {speed[inside].min()} to {speed.max()} of {piece.speed}")
    return found


@pytest.fixture(scope="module", params=["ur5", "ur10e"])
def table(request):
    robot = with_table(request.param)
    group = robot.arms({"torch": "tip", "work": "plate"})
    part = pp.Obstacle("part", pp.Cylinder(radius=0.06, length=0.12), pp.pose((0, 0, 0.07)), arm="work")
    torch = pp.Obstacle("torch", pp.Cylinder(radius=0.01, length=0.12), pp.pose((0, 0, -0.07)), arm="torch")
    return pp.CollisionChecker(group, attached=[part, torch])


def test_a_seam_around_a_part_is_followed_with_the_turntable(table):
    path = seam()
    plan = pp.follow(table, path, frame="plate", arm="torch", rotations=8, redundant=16, speed_tolerance=0.1).or_raise()
    assert faults(plan, "plate", "tip") == []
    assert np.ptp(plan.trajectory.q[:, table.group.joint_names.index("table")]) > 0.2
    assert plan.trajectory.joint_names == table.group.joint_names
    assert plan.certificate.matches(plan.trajectory, table.group, table.scene, table.attached)


def test_lines_to_and_from_the_path_follow_the_part(table):
    plan = pp.follow(table, seam(2.0), frame="plate", rotations=8, redundant=12, approach=0.04).or_raise()
    assert faults(plan, "plate", "tip") == []
    names = [name for name, _ in plan.motions]
    assert names == ["approach", "path", "departure"]
    ends = tool_in_frame(table, np.array([plan.trajectory.start, plan.trajectory.end]), "plate", "tip")
    off = np.array([plan.path.poses[0] @ pp.pose((0, 0, -0.04)).homogeneous, plan.path.poses[-1]])
    assert ends[0][:3, 3] == pytest.approx(off[0][:3, 3], abs=1e-3)
    assert ends[1][:3, 3] == pytest.approx(off[1][:3, 3] - 0.04 * off[1][:3, 2], abs=1e-3)


def test_the_values_of_the_turntable_are_stated_by_name(table):
    path = seam(1.0, 12)
    held = pp.follow(table, path, frame="plate", rotations=8, redundant={"table": [2.2]}).or_raise()
    assert held.nodes < pp.follow(table, path, frame="plate", rotations=8, redundant={"table": [2.1, 2.2]}).nodes
    assert held.pieces[0].q[:, table.group.joint_names.index("table")] == pytest.approx(2.2, abs=0.2)
    for wrong, words in (({"tabel": [0.0]}, "table"), ({"table": []}, "table"), ({"elbow_joint": [0.0]}, "table")):
        with pytest.raises(pp.InputError, match=words):
            pp.follow(table, path, frame="plate", redundant=wrong)


def test_a_joint_that_does_not_move_the_tool_on_the_part_is_refused(table):
    path = ToolPath.through([[0.4, 0.2, 0.4]], (0.0, 0.0, 1.0))
    with pytest.raises(pp.InputError, match="table do"):
        pp.follow(table, path)
    with pytest.raises(pp.errors.UnknownNameError):
        pp.follow(table, path, frame="dish")


def test_a_part_that_joints_do_not_reach_is_blocked_in_the_moving_frame(table):
    far = ToolPath.through([[0.0, 0.0, 0.2], [0.0, 0.0, 3.0]], (0.0, 0.0, 1.0), speed=0.1)
    plan = pp.follow(table, far, frame="plate", rotations=4, redundant=4, step=0.3)
    assert plan.status is FollowStatus.BLOCKED
    assert not plan.blocked[-1].proven  # the values of the table between those of the grid were not tried
    assert "out of reach" in plan.message


def test_a_part_that_follows_a_joint_of_the_arm_has_no_closed_form_of_its_poses():
    """The table is geared to the first joint of the arm: its pose is unknown before the arm is solved."""
    geared = LIMITS.format(6.0) + '<mimic joint="shoulder_pan_joint" multiplier="0.5" offset="0.1"/>'
    own = TABLE.format(root="base_link", flange="tool0", kind="revolute", limits=geared)
    checker = pp.CollisionChecker(
        pp.load_robot(pp.load_robot("ur5").urdf.text.replace("</robot>", own)).arms({"torch": "tip"})
    )
    one = ToolPath.through([[0.0, 0.09, 0.2]], (0.3, 0.3, 1.0))
    plan = pp.follow(checker, one, frame="plate", rotations=8).or_raise()
    (pose,) = tool_in_frame(checker, plan.trajectory.q[:1], "plate", "tip")
    assert pose[:3, 3] == pytest.approx(one.poses[0, :3, 3], abs=1e-5)
    moving = pp.follow(checker, seam(0.5, 6), frame="plate", rotations=8).or_raise()
    assert faults(moving, "plate", "tip") == []
    far = pp.follow(checker, ToolPath.through([[0.0, 0.0, 3.0]], (0.0, 0.0, 1.0)), frame="plate", rotations=4)
    assert not far.blocked[0].proven


def test_a_short_arm_with_a_turntable_is_not_screened_as_an_arm_of_six_joints():
    text = with_table("ur5").urdf.text.replace(
        'parent link="tool0"/><child link="tip"', 'parent link="wrist_2_link"/><child link="tip"'
    )
    checker = pp.CollisionChecker(pp.load_robot(text).arms({"torch": "tip", "work": "plate"}))
    assert checker.group.dof == 6
    settings = {"frame": "plate", "redundant": 4}
    plan = pp.follow(checker, ToolPath.through([[0.0, 0.0, 3.0]], (0.0, 0.0, 1.0)), **settings)
    assert plan.status is FollowStatus.BLOCKED
    assert pp.tool_paths.suggest_changes(plan, settings, budget=1) == ()


def test_a_table_is_at_rest_if_the_joint_that_it_follows_is_held(tmp_path):
    gear = TABLE.format(root="base_link", flange="tool0", kind="revolute", limits=LIMITS.format(3.0)).replace(
        "</robot>",
        '<link name="dish"/><joint name="gear" type="revolute"><parent link="plate"/><child link="dish"/>'
        + LIMITS.format(3.0)
        + '<mimic joint="table" multiplier="0.5"/></joint></robot>',
    )
    text = pp.load_robot("ur5").urdf.text.replace("</robot>", gear)
    pp.load_robot(text).save_urdf(tmp_path / "cell.urdf")
    content = {
        "robot": "cell.urdf", "tcp": "tip", "frame": "dish",
        "strokes": [{"points": [[0.09, 0.0, 0.1]], "normals": [[0.3, 0.0, 1.0]]}],
    }  # fmt: skip
    for held, moves in (({}, True), ({"table": 0.5}, False)):
        (tmp_path / "job.json").write_text(json.dumps(content | {"held": held}))
        job = pp.tool_paths.read_tool_paths(tmp_path / "job.json")
        assert (job.carrier is not None) is moves
        assert job.load_arm().dof == 6 + moves


def test_a_second_arm_turns_the_part_in_front_of_the_torch():
    arm = pp.load_robot("ur5").arm()
    cell = pp.assemble({"torch": (arm, pp.pose((0, 0, 0))), "holder": (arm, pp.pose((1.0, 0, 0), (0, 0, np.pi)))})
    home = {"shoulder_pan": 0.0, "shoulder_lift": -1.9, "elbow": 2.2, "wrist_1": -1.87, "wrist_2": -np.pi / 2}
    part = pp.Obstacle("part", pp.Cylinder(radius=0.05, length=0.1), pp.pose((0, 0, 0.05)), arm="holder")
    checker = pp.CollisionChecker(cell, attached=[part])
    a = np.linspace(0.0, 1.5, 16)
    out = np.column_stack([np.cos(a), np.sin(a), np.zeros(16)])
    path = ToolPath.through(0.2 * out + np.array([0, 0, 0.05]), out, speed=0.03)
    stated = {f"holder/{name}_joint": [value] for name, value in home.items()}
    stated["holder/wrist_3_joint"] = np.linspace(-2.0, 2.0, 9)
    plan = pp.follow(checker, path, frame="holder/tool0", arm="torch", rotations=6, redundant=stated).or_raise()
    assert faults(plan, "holder/tool0", "torch/tool0") == []
    assert plan.trajectory.q.shape[1] == 12
    assert np.ptp(plan.trajectory.q[:, 11]) > 0.1


@pytest.fixture(scope="module")
def small():
    """A UR5 with a turntable whose joints have one winding each."""
    names = [joint for joint, own in with_table("ur5").urdf.joints.items() if own.type in ("revolute", "continuous")]
    group = with_table("ur5").arms({"torch": "tip", "work": "plate"}, limits=dict.fromkeys(names, (-3.1, 3.1)))
    return pp.CollisionChecker(
        group, attached=[pp.Obstacle("part", pp.Box(0.05, 0.05, 0.05), pp.pose((0, 0, 0.04)), arm="work")]
    )


def test_the_optimum_over_a_turntable_equals_that_of_all_sequences(small):
    group, found = small.group, 0
    table, torch = group.joint_names.index("table"), group.arms["torch"]
    for seed in range(40):
        rng = np.random.default_rng(seed)
        places = seam(rng.uniform(0.1, 0.6), int(rng.integers(2, 5))).transformed(
            pp.pose(rng.uniform(-0.05, 0.05, 3), rng.uniform(-0.4, 0.4, 3))
        ).poses  # fmt: skip
        grid = Grid(np.linspace(0.0, 2.0, 3), np.eye(3)[None], others=(rng.uniform(1.6, 2.9, 3),))
        costs = FollowCosts(time=rng.uniform(0, 2), travel=rng.uniform(0, 2), effort=rng.uniform(0, 2))
        settings = LadderSettings(costs, rng.uniform(0.2, 1.5), 0.5, np.full(7, rng.uniform(0.05, 0.6)))
        durations = rng.uniform(0.2, 2.0, len(places) - 1)
        rungs = [Rung(0, float(k), place, float(k)) for k, place in enumerate(places)]
        fill(rungs, small, PathArm.of(group, "plate"), grid, IkTask(rz=False), costs, 0)
        # All solutions of the arm for each value of the turntable, whose pose is that of Pinocchio
        total = np.zeros(1)
        nodes = before = None
        for k, place in enumerate(places):
            rows = []
            for value in grid.external[:, 0]:
                q = np.insert(np.zeros(6), table, value)
                base_from_plate = torch.root_from_base.inverse() * group.root_from_frame(q, "plate")
                for angle in grid.rotations:
                    target = base_from_plate.homogeneous @ place @ pp.pose((0, 0, 0), (0, 0, angle)).homogeneous
                    rows += [np.insert(own, table, value) for own in pp.AnalyticIk().solve_all(torch, target).q]
            nodes = np.array([row for row in rows if small.is_free(row)]).reshape(-1, 7)
            assert len(nodes) == len(rungs[k].nodes), seed
            if before is not None:
                r = np.abs(nodes[None] - before[:, None]) / group.limits.velocity
                reach = np.minimum(
                    np.maximum(durations[k - 1] / 0.5, settings.steps), settings.jump / group.limits.velocity
                )
                edge = costs.time * np.maximum(r.max(axis=2), durations[k - 1]) + costs.travel * r.sum(axis=2)
                edge += costs.effort * (r**2).sum(axis=2) / durations[k - 1]
                edge[(r > reach + 1e-12).any(axis=2)] = np.inf
                total = (total[:, None] + edge).min(axis=0, initial=np.inf)
            else:
                total = np.zeros(len(nodes))
            before = nodes
        best = float(total.min(initial=np.inf))
        arm = PathArm.of(group, "plate").arm
        course = RungLadder(arm, rungs, durations, np.ones(len(durations), dtype=bool), settings).solve(
            0, len(rungs) - 1
        )
        assert (len(course.nodes) == len(rungs)) == np.isfinite(best), seed
        if np.isfinite(best):
            found += 1
            assert course.cost == pytest.approx(best, rel=1e-9), seed
    assert 10 < found < 40


def test_a_job_states_the_part_that_moves(tmp_path):
    with_table("ur5").save_urdf(tmp_path / "cell.urdf")
    a = np.linspace(0.0, 1.0, 8)
    points = [[0.09 * np.cos(x), 0.09 * np.sin(x), 0.07] for x in a]
    normals = [[np.cos(x), np.sin(x), 0.8] for x in a]
    content = {
        "robot": "cell.urdf", "tcp": "tip", "frames": {"top": {"frame": "plate", "xyz": [0, 0, 0.01]}}, "frame": "top",
        "part": [{"name": "part", "cylinder": {"radius": 0.06, "length": 0.12}, "xyz": [0, 0, 0.06]}],
        "tool": [{"name": "torch", "cylinder": {"radius": 0.01, "length": 0.12}, "xyz": [0, 0, -0.07]}],
        "speed": 0.05, "rotations": 8, "redundant": {"table": [1.6, 1.9, 2.2]},
        "strokes": [{"name": "seam", "points": points, "normals": normals}],
    }  # fmt: skip
    (tmp_path / "job.json").write_text(json.dumps(content))
    job = pp.tool_paths.read_tool_paths(tmp_path / "job.json")
    checker = job.load_checker()
    assert [(body.name, body.arm) for body in checker.attached] == [("torch", "tool"), ("part", "part")]
    report = pp.tool_paths.follow_job(job, checker=checker)
    assert report.ok, report.summary
    (own,) = report.strokes
    assert own.plan.path.poses[0, 2, 3] == pytest.approx(0.08)
    assert faults(own.plan, "plate", "tip") == []
    report.save(tmp_path / "report.html")
    # A campaign follows the path in the moving frame too
    campaign = pp.tool_paths.path_campaign(job, checker=checker)
    (row,) = campaign.run(tmp_path / "out", executor=ThreadPoolExecutor(1)).rows()
    assert (row["verdict"], row["poses"]) == ("good", 8)
    with pytest.raises(pp.InputError, match="table"):
        pp.tool_paths.require_language(checker.group, "rapid")
    # A joint that is held does not move the part, whose frame is at rest then
    (tmp_path / "job.json").write_text(json.dumps(content | {"held": {"table": 2.0}, "part": [], "redundant": 4}))
    still = pp.tool_paths.read_tool_paths(tmp_path / "job.json")
    assert still.carrier is None
    assert still.load_arm().joint_names == own.plan.checker.group.arms["tool"].joint_names
