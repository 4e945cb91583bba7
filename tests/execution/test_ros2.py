"""Messages of ROS 2 as dictionaries: round trips, refusals, and the node of the manual with a stub of rclpy."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import InputError, SceneError, TrajectoryError, UnknownNameError
from pinproof.execution import ros2

from . import ros_messages
from .conftest import HIGH, LOW

PAGE = Path(__file__).parents[2] / "docs" / "ros2.md"

# The fields of the definitions: a key that is not among them would be refused by to_ros.
FIELDS = {
    "trajectory": {"header", "joint_names", "points"},
    "point": {"positions", "velocities", "accelerations", "effort", "time_from_start"},
    "scene": {
        "name", "robot_state", "robot_model_name", "fixed_frame_transforms", "allowed_collision_matrix", "link_padding",
        "link_scale", "object_colors", "world", "is_diff",
    },
    "object": {
        "header", "pose", "id", "type", "primitives", "primitive_poses", "meshes", "mesh_poses", "planes",
        "plane_poses",
        "subframe_names", "subframe_poses", "operation",
    },
    "cloud": {"header", "height", "width", "fields", "is_bigendian", "point_step", "row_step", "data", "is_dense"},
    "display": {"model_id", "trajectory", "trajectory_start"},
    "robot": {"joint_trajectory", "multi_dof_joint_trajectory"},
}  # fmt: skip


@pytest.mark.parametrize("jerk", [None, 100.0])
def test_trajectories_are_restored_exactly(checker, swing, jerk) -> None:
    motion = swing if jerk is None else pp.time_parametrise(
        pp.JointPath([HIGH, LOW], checker.arm.joint_names), checker.arm.limits, jerk=jerk
    )  # fmt: skip
    message = ros2.joint_trajectory(motion, frame="base_link")
    assert set(message) <= FIELDS["trajectory"]
    assert all(set(point) <= FIELDS["point"] for point in message["points"])
    for point in message["points"]:
        point.setdefault("accelerations", [])  # as message_to_ordereddict writes empty fields
        point["effort"] = []
    assert ros2.read_joint_trajectory(message).digest() == motion.digest()
    shown = ros2.display_trajectory([motion, motion], model="ur5", held={"finger": 0.02})
    assert set(shown) <= FIELDS["display"]
    assert set(shown["trajectory"][0]) <= FIELDS["robot"]
    assert shown["trajectory_start"]["joint_state"]["position"] == [0.02, *motion.start]
    assert [each.digest() for each in ros2.read_display_trajectory(shown)] == [motion.digest()] * 2


def test_damaged_messages_and_shapes_without_equivalent_are_refused_with_their_place(swing) -> None:
    message = ros2.joint_trajectory(swing)
    message["points"][2]["velocities"] = []
    cloud = pp.Obstacle("scan", pp.PointCloud([[0, 0, 0]], 0.1), pp.pose((0, 0, 0)))
    attached = {"attached_collision_objects": [{"link_name": "tool0", "object": {"id": "part"}}]}
    broken = {"collision_objects": [{"id": "box", "primitives": [{"type": 9, "dimensions": [1]}]}]}
    for read, error, words in (
        (lambda: ros2.read_joint_trajectory(message), TrajectoryError, r"points\[2\]"),
        (lambda: ros2.read_robot_trajectory({"joint_trajectry": message}), InputError, "no field 'joint_trajectory'"),
        (lambda: ros2.planning_scene(pp.Scene([cloud])), InputError, "PointCloud 'scan'"),
        (lambda: ros2.read_planning_scene({"world": {}, "robot_state": attached}), SceneError, "'part' on 'tool0'"),
        (lambda: ros2.read_planning_scene({"world": broken}), SceneError, "object 'box'"),
    ):
        with pytest.raises(error, match=words):
            read()


def test_planning_scenes_are_restored() -> None:
    corners = [[x, y, z] for x in (0, 0.1) for y in (0, 0.2) for z in (0, 0.3)]
    hull = pp.collision.ConvexShape([*corners, [0.05, 0.1, 0.15]])
    placed = pp.pose((0.3, 0.3, -0.9), (0.1, 0.2, 0.3))
    shapes = {
        "box": pp.Box(0.1, 0.2, 0.3), "ball": pp.Sphere(0.1), "can": pp.Cylinder(0.1, 0.4),
        "cone": pp.collision.Cone(0.1, 0.4), "ground": pp.HalfSpace(), "hull": hull, "pill": pp.Capsule(0.05, 0.2),
    }  # fmt: skip
    scene = pp.Scene(
        [pp.Obstacle(name, shape, placed, (1, 0, 0, 1)) for name, shape in shapes.items()],
        allowed=[("base_link", "box"), ("*", "ground")],
        disabled=[("wrist_1_link", "wrist_3_link")],
    )
    message = ros2.planning_scene(scene)
    assert set(message) <= FIELDS["scene"]
    assert all(set(each) <= FIELDS["object"] for each in message["world"]["collision_objects"])
    for each in message["world"]["collision_objects"]:
        each["operation"] = "\x00"  # as message_to_ordereddict writes the byte of ADD
    again = ros2.read_planning_scene(message)
    assert again.names == (*list(shapes)[:-1], "pill/1", "pill/2", "pill/3")
    for name in list(shapes)[:5]:
        assert again[name].shape == scene[name].shape
        assert np.abs(again[name].pose.homogeneous - placed.homogeneous).max() < 1e-12
    assert len(again["hull"].shape.vertices) == 8, "points inside the hull are not written"
    assert set(again.allowed) == {("base_link", "box"), ("*", "ground")}
    assert again.disabled == (("wrist_1_link", "wrist_3_link"),)
    arm = pp.load_robot("ur5").arm()
    one, other = (pp.CollisionChecker(arm, pp.Scene(each.obstacles)) for each in (scene, again))
    Q = np.random.default_rng(0).uniform(-3, 3, (200, 6))
    separated = (clearances := one.clearance_batch(Q)) > 0
    assert separated.any()
    assert np.abs(clearances - other.clearance_batch(Q))[separated].max() < 1e-8


@pytest.mark.parametrize("kind", ["<f4", ">f8"])
def test_point_clouds_with_other_fields_and_padding(kind) -> None:
    points = np.random.default_rng(0).normal(size=(6, 3)).astype(kind)
    points[2, 1] = np.nan
    size = points.dtype.itemsize
    layout = np.dtype(
        {"names": ["x", "y", "z", "rgb"], "formats": [kind] * 3 + ["u4"], "offsets": [4, 4 + size, 4 + 2 * size, 0],
         "itemsize": 40}
    )  # fmt: skip
    rows = np.zeros((2, 3), layout)
    for k, name in enumerate("xyz"):
        rows[name] = points[:, k].reshape(2, 3)
    data = b"".join(row.tobytes() + b"\xff" * 8 for row in rows)  # 8 bytes of padding after each row
    number = {"f4": 7, "f8": 8}[kind[1:]]
    fields = [{"name": n, "offset": layout.fields[n][1], "datatype": number, "count": 1} for n in "xyz"]
    message = {
        "header": {}, "height": 2, "width": 3, "fields": fields, "is_bigendian": kind[0] == ">", "point_step": 40,
        "row_step": 128, "data": data, "is_dense": False,
    }  # fmt: skip
    assert set(message) == FIELDS["cloud"]
    cloud = ros2.read_point_cloud2(message, 0.01)
    assert cloud.dropped == 1
    assert np.array_equal(cloud.points, np.delete(points, 2, axis=0).astype(float))
    for changes, words in (
        ({"data": data[:-1]}, "255 bytes; 2 rows of 128 bytes"), ({"fields": [fields[0], fields[2]]}, "field 'y'"),
        ({"point_step": 8}, "beyond point_step"), ({"row_step": 100, "data": data[:200]}, "were expected"),
        ({"height": 3}, "were expected"), ({"width": 4}, "were expected"),
        ({"height": -1, "data": b""}, "were expected"),
    ):  # fmt: skip
        with pytest.raises(UnknownNameError if "field" in words else InputError, match=words):
            ros2.read_point_cloud2({**message, **changes}, 0.01)


def test_point_cloud_round_trip_in_single_precision() -> None:
    points = np.random.default_rng(0).normal(size=(100, 3))
    message = ros2.point_cloud2(points, frame="camera")
    assert set(message) == FIELDS["cloud"]
    assert np.array_equal(ros2.read_point_cloud2(message, 0.01).points, points.astype("f4").astype(float))


def test_joint_states_are_matched_by_name() -> None:
    message = {"name": ["b", "finger", "a"], "position": [2.0, 9.0, 1.0], "velocity": []}
    q, dq = ros2.read_joint_state(message, ("a", "b"))
    assert q.tolist() == [1.0, 2.0]
    assert dq is None
    assert ros2.read_joint_state({**message, "velocity": [0.2, 0, 0.1]}, ("a", "b"))[1].tolist() == [0.1, 0.2]
    assert ros2.read_joint_state({"name": [], "position": []}, ())[0].shape == (0,)
    with pytest.raises(UnknownNameError, match="unknown joint 'c'"):
        ros2.read_joint_state(message, ("a", "c"))
    with pytest.raises(InputError, match="'a' 2 times"):
        ros2.read_joint_state({"name": ["a", "b", "a"], "position": [1.0, 2.0, 3.0]}, ("a", "b"))
    with pytest.raises(InputError, match="3 names and 2 values"):
        ros2.read_joint_state({**message, "position": [1.0, 2.0]}, ("a",))


def test_a_dictionary_becomes_a_message_of_ros_and_back(monkeypatch, swing) -> None:
    ros_messages.install(monkeypatch)
    stated = ros2.joint_trajectory(swing, frame="base")
    message = ros2.to_ros("trajectory_msgs/JointTrajectory", stated)
    assert type(message) is ros_messages.CLASSES["trajectory_msgs/JointTrajectory"]
    assert message.header.frame_id == "base"
    assert list(message.points[-1].positions) == swing.end.tolist()
    assert ros2.read_joint_trajectory(ros2.from_ros(message)).digest() == swing.digest()
    points = np.random.default_rng(0).normal(size=(50, 3))
    cloud = ros2.to_ros("sensor_msgs/msg/PointCloud2", ros2.point_cloud2(points))
    again = ros2.read_point_cloud2(ros2.from_ros(cloud), resolution=0.1)
    assert np.abs(again.points - points).max() < 1e-6
    state = ros2.to_ros("sensor_msgs/JointState", {"name": ["a", "b"], "position": [1.0, 2.0]})
    assert ros2.read_joint_state(ros2.from_ros(state), ("b",))[0].tolist() == [2.0]


def test_a_message_that_ros_does_not_have_is_refused(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "trajectory_msgs.msg", None)
    with pytest.raises(InputError, match=r"trajectory_msgs/JointTrajectory.*source setup"):
        ros2.to_ros("trajectory_msgs/JointTrajectory", {})
    ros_messages.install(monkeypatch)
    with pytest.raises(InputError, match="JointPath"):
        ros2.to_ros("trajectory_msgs/JointPath", {})
    with pytest.raises(UnknownNameError, match="unknown field 'points'"):
        ros2.to_ros("sensor_msgs/JointState", {"points": []})


class StubNode:
    """A node without ROS: it records what is published and logged, and has a clock that the test sets."""

    def __init__(self, _name: str) -> None:
        self.published, self.logged, self.callbacks, self.time = [], [], {}, 0.0

    def create_publisher(self, _kind, _topic, _depth):
        return SimpleNamespace(publish=self.published.append)

    def create_timer(self, _period, callback) -> None:
        self.tick = callback

    def create_subscription(self, _kind, topic, callback, _depth) -> None:
        self.callbacks[topic] = callback

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=int(self.time * 1e9)))

    def get_logger(self):
        return SimpleNamespace(info=self.logged.append, error=self.logged.append)


def at_rest(q: np.ndarray, swing: pp.Trajectory) -> dict[str, object]:
    """The JointState of the robot at rest."""
    return {"name": list(swing.joint_names), "position": q.tolist(), "velocity": [0.0] * len(q)}


def ready(checker, swing: pp.Trajectory, **settings: object) -> ros2.CertifiedExecution:
    """An execution whose robot is at the start of a motion at the time 0."""
    execution = ros2.CertifiedExecution(checker, **settings)
    execution.on_state(at_rest(swing.start, swing), 0.0)
    return execution


class Message(dict):
    """A message whose dictionary is itself."""


def stub(monkeypatch, name: str, **attributes: object) -> None:
    module = ModuleType(name)
    for key, value in attributes.items():
        setattr(module, key, value)
    monkeypatch.setitem(sys.modules, name, module)


def test_the_node_of_the_manual_certifies_executes_and_stops(monkeypatch, checker, swing) -> None:
    stub(monkeypatch, "rclpy")
    stub(monkeypatch, "rclpy.node", Node=StubNode)
    ros_messages.install(monkeypatch)
    stub(monkeypatch, "moveit_msgs")
    stub(monkeypatch, "moveit_msgs.msg", DisplayTrajectory=Message, PlanningScene=Message)
    source = re.search(r"```py\n(.*?)```", PAGE.read_text(), re.DOTALL)[1]
    names: dict[str, object] = {"__name__": "certified_execution"}
    exec(compile(source, "certified_execution.py", "exec"), names)
    node = names["CertifiedExecution"]()

    assert len([line for line in source.splitlines() if line.strip()]) <= 45

    def complete(scene: pp.Scene) -> Message:
        return Message(ros2.planning_scene(scene), is_diff=False)

    node.callbacks["/monitored_planning_scene"](complete(checker.scene))
    assert node.execution.checker.scene.names == checker.scene.names
    node.callbacks["/display_planned_path"](Message(ros2.display_trajectory([swing])))
    assert node.published == [], "a motion is not sent before the state of the robot is known"
    node.callbacks["/joint_states"](Message(at_rest(swing.start, swing)))
    node.time = 0.001
    node.callbacks["/display_planned_path"](Message(ros2.display_trajectory([swing])))
    assert ros2.read_joint_trajectory(ros2.from_ros(node.published[0])).digest() == swing.digest()

    def state(time: float, off: float) -> None:
        node.time = 0.001 + time
        velocity = swing.velocity(time)
        q = {name: value + off for name, value in zip(swing.joint_names, swing(time), strict=True)}
        node.callbacks["/joint_states"](
            Message(name=list(q), position=list(q.values()), velocity=velocity.tolist(), effort=[])
        )

    for time in (0.08, 0.16, 0.22):
        state(time, 0.001)
    assert len(node.published) == 1
    state(0.3, 0.05)
    stop = ros2.read_joint_trajectory(ros2.from_ros(node.published[1]))
    assert np.abs(stop.start - swing(0.3) - 0.05).max() < 1e-12
    assert not stop.velocities[-1].any()
    assert (stop.max_acceleration() <= checker.arm.limits.acceleration * (1 + 1e-9)).all()
    assert node.execution.monitor is None

    ball = pp.Obstacle("ball", pp.Sphere(0.05), checker.arm.forward_kinematics(swing(1.9)))
    node.callbacks["/monitored_planning_scene"](complete(checker.scene.add(ball)))
    node.callbacks["/display_planned_path"](Message(ros2.display_trajectory([swing])))
    assert len(node.published) == 2, "a motion in collision is not sent"
    assert "ball" in node.logged[-1]


def test_no_motion_is_sent_after_a_scene_or_a_motion_that_cannot_be_read(checker, swing) -> None:
    execution = ready(checker, swing)
    shown = ros2.display_trajectory([swing])
    refused = execution.on_scene({"is_diff": False, "world": {"unknown": 1}}, 0.0)
    assert refused.alarm
    assert "'unknown'" in refused.text
    assert execution.on_path(shown, 0.0).command is None
    assert execution.on_scene({**ros2.planning_scene(checker.scene), "is_diff": False}, 0.0) == ros2.Reply()
    for message in (
        None,
        {},
        [],
        7,
        *({"trajectory": rows} for rows in (None, [{}], [None], [{"joint_trajectory": 3}])),
    ):
        reply = execution.on_path(message, 0.0)
        assert (reply.command, reply.alarm) == (None, True)
    assert execution.monitor is None
    assert execution.on_path(shown, 0.0).command is not None
    assert execution.monitor is not None


def test_no_motion_is_sent_after_a_difference_that_changes_objects_until_a_complete_scene(checker, swing) -> None:
    shown, complete = ros2.display_trajectory([swing]), {**ros2.planning_scene(checker.scene), "is_diff": False}
    moved = {
        "is_diff": True,
        "world": {"collision_objects": [], "octomap": {"header": {"frame_id": ""}, "octomap": {"id": "", "data": []}}},
        "robot_state": {"joint_state": {"name": ["a"], "position": [0.1]}, "attached_collision_objects": []},
        "allowed_collision_matrix": {"entry_names": [], "entry_values": []},
    }
    ball = pp.Obstacle("ball", pp.Sphere(0.05), checker.arm.forward_kinematics(swing(1.9)))
    execution = ready(checker, swing)
    for unchanged in (moved, {"is_diff": True}, {**moved, "robot_state": None, "world": None}):
        assert execution.on_scene(unchanged, 0.0) == ros2.Reply()
    assert execution.on_path(shown, 0.0).command is not None
    for changed in (
        ros2.planning_scene(pp.Scene([ball])),
        {**moved, "robot_state": {"attached_collision_objects": [{"link_name": "tool0"}]}},
        {**moved, "world": {"octomap": {"octomap": {"data": [1]}}}},
        {**moved, "allowed_collision_matrix": {"entry_names": ["a"], "entry_values": [[False]]}},
    ):
        execution = ready(checker, swing)
        assert execution.on_scene(changed, 0.0).alarm
        assert execution.on_path(shown, 0.0).command is None
        assert execution.on_scene(complete, 0.0) == ros2.Reply()
        assert execution.on_path(shown, 0.0).command is not None


def test_a_motion_that_is_executed_is_proven_again_in_a_new_scene(checker, swing) -> None:
    execution = ready(checker, swing, timeout=1.0)
    assert execution.on_path(ros2.display_trajectory([swing]), 0.0).command is not None
    here = {"name": swing.joint_names, "position": swing(0.3).tolist(), "velocity": swing.velocity(0.3).tolist()}

    def complete(at: np.ndarray) -> dict[str, object]:
        ball = pp.Obstacle("ball", pp.Sphere(0.05), checker.arm.forward_kinematics(at))
        return {**ros2.planning_scene(checker.scene.add(ball)), "is_diff": False}

    far = complete(swing.end)
    far["world"]["collision_objects"][-1]["pose"]["position"]["z"] += 5.0
    assert execution.on_scene(far, 0.2) == ros2.Reply()
    assert execution.on_state(here, 0.3) == ros2.Reply()
    assert execution.on_scene(complete(swing.end), 0.3).alarm
    reply = execution.on_state({**here, "position": swing(0.31).tolist()}, 0.31)
    assert reply.alarm
    assert "ball" in reply.text
    assert not ros2.read_joint_trajectory(reply.command).velocities[-1].any()
    assert execution.monitor is None


# -- faults --------------------------------------------------------------------------------------------------------


def measured(swing: pp.Trajectory, time: float, *, off: float = 0.0, velocity: bool = True) -> dict[str, object]:
    state = {"name": list(swing.joint_names), "position": (swing(time) + off).tolist(), "velocity": []}
    return {**state, "velocity": swing.velocity(time).tolist()} if velocity else state


def running(checker, swing: pp.Trajectory, *, velocity: bool = True) -> ros2.CertifiedExecution:
    """An execution at 0.2 s of its motion, after states each 10 ms."""
    execution = ready(checker, swing)
    assert execution.on_path(ros2.display_trajectory([swing]), 0.0).command is not None
    for time in np.arange(1, 21) * 0.01:
        assert execution.on_state(measured(swing, time, velocity=velocity), time) == ros2.Reply()
    return execution


@pytest.mark.parametrize("velocity", [True, False])
@pytest.mark.parametrize("time", [0.04, 0.03, 0.0, -0.01, -0.04])
def test_a_clock_that_returns_to_the_start_is_no_next_execution(checker, swing, time, velocity) -> None:
    execution = ready(checker, swing)
    execution.on_path(ros2.display_trajectory([swing]), 0.0)
    for at in (0.01, 0.02, 0.03, 0.04):
        assert execution.on_state(measured(swing, at, velocity=velocity), at) == ros2.Reply()
    assert execution.on_state(measured(swing, 0.04, velocity=velocity), time).command is not None


def test_a_stop_from_an_unknown_state_is_proven_from_the_whole_tube(checker, swing, monkeypatch) -> None:
    asked = []
    monkeypatch.setattr(pp.Monitor, "proves_stop", lambda _, q, dq, error=0.0: asked.append(error))
    assert "is not proven" in running(checker, swing).on_state({}, 0.21).text
    assert asked == [0.02]


def test_a_stop_from_an_unknown_state_says_whether_it_is_proven(checker, swing) -> None:
    """Without a measurement it begins at the state of the motion, and the robot may be anywhere in the tube."""
    for time in (0.3, 0.6, 1.0, 1.9):
        execution = ready(checker, swing, timeout=5.0)
        execution.on_path(ros2.display_trajectory([swing]), 0.0)
        monitor = execution.monitor
        q, dq = swing(time), swing.velocity(time)
        reply = execution.on_state({}, time)
        stop = ros2.read_joint_trajectory(reply.command)
        assert np.abs(stop.start - q).max() < 1e-9
        path, tolerance, _ = monitor.stopping(q, dq)
        proven = pp.collision.is_proven_free(path, checker, joint_tolerance=tolerance + 0.02)
        assert proven == ("is proven" in reply.text)
        assert monitor.proves_stop(q, dq, 0.02) == proven
        assert not monitor.proves_stop(q, dq, 0.3)


def test_the_stop_without_velocities_is_the_one_that_is_proven(checker, swing) -> None:
    execution = running(checker, swing, velocity=False)
    monitor = execution.monitor
    q, last = swing(0.21) + 0.03, swing(0.2)
    reply = execution.on_state({"name": list(swing.joint_names), "position": q.tolist()}, 0.21)
    stop = ros2.read_joint_trajectory(reply.command)
    np.testing.assert_allclose(stop.velocities[0], (q - last) / 0.01, rtol=1e-9)
    path, tolerance, _ = monitor.stopping(q, (q - last) / 0.01)
    np.testing.assert_allclose(stop.end, path.end)
    for time in np.linspace(0, stop.duration, 20):  # the stop is on the segment whose proof the monitor states
        along = (stop(time) - path.start) @ (path.end - path.start) / ((path.end - path.start) ** 2).sum()
        assert np.abs(stop(time) - path.start - along * (path.end - path.start)).max() <= tolerance.max() + 1e-9


class TestStart:
    """A motion is sent only if the robot, and the start that the message states, are at its start."""

    def test_it_is_not_sent_without_a_state_or_with_an_old_one(self, checker, swing) -> None:
        shown = ros2.display_trajectory([swing])
        assert ros2.CertifiedExecution(checker).on_path(shown, 0.0).command is None
        for late in (0.11, -0.5, np.nan):
            assert ready(checker, swing).on_path(shown, late).command is None
        assert ready(checker, swing).on_path(shown, 0.09).command is not None

    @pytest.mark.parametrize("off", [1.2, 0.03, -0.03, np.nan])
    def test_it_is_not_sent_if_the_robot_is_elsewhere(self, checker, swing, off) -> None:
        execution = ros2.CertifiedExecution(checker)
        execution.on_state(at_rest(swing.start + off * np.eye(6)[2], swing), 0.0)
        reply = execution.on_path(ros2.display_trajectory([swing]), 0.01)
        assert (reply.command, reply.alarm, execution.monitor) == (None, True, None)

    def test_it_is_not_sent_while_the_robot_moves_away(self, checker, swing) -> None:
        execution = ros2.CertifiedExecution(checker)
        execution.on_state({**at_rest(swing.start, swing), "velocity": [3.0] * 6}, 0.0)
        assert execution.on_path(ros2.display_trajectory([swing]), 0.01).command is None

    @pytest.mark.parametrize("joint", range(6))
    @pytest.mark.parametrize("off", [1.2, 0.0201, -0.0201, np.nan])
    def test_it_is_not_sent_if_the_message_states_another_start(self, checker, swing, off, joint) -> None:
        shown = ros2.display_trajectory([swing])
        shown["trajectory_start"]["joint_state"]["position"][joint] += off
        reply = ready(checker, swing).on_path(shown, 0.01)
        assert (reply.command, reply.alarm) == (None, True)
        assert swing.joint_names[joint] in reply.text

    def test_it_is_sent_if_the_stated_start_is_within_the_tolerance_or_partly_known(self, checker, swing) -> None:
        shown = ros2.display_trajectory([swing], held={"finger": 9.0})
        shown["trajectory_start"]["joint_state"]["position"][3] += 0.0199
        assert ready(checker, swing).on_path(shown, 0.01).command is not None
        for start in (None, {}, {"joint_state": {}}, {"joint_state": {"name": [], "position": []}}):
            assert ready(checker, swing).on_path({**shown, "trajectory_start": start}, 0.01).command is not None

    @pytest.mark.parametrize(("off", "sent"), [(0.0009, True), (0.0011, False), (-0.0011, False), (0.02, False)])
    def test_a_finger_that_is_held_must_be_where_it_is_certified(self, off, sent) -> None:
        arm = pp.load_robot("panda").arm()
        checker = pp.CollisionChecker(arm)
        name, held = next(iter(checker.group.held.items()))
        motion = pp.time_parametrise(pp.JointPath([arm.home, arm.home + 0.1], arm.joint_names), arm.limits)
        execution = ready(checker, motion)
        reply = execution.on_path(ros2.display_trajectory([motion], held={name: held + off}), 0.01)
        assert (reply.command is not None) == sent
        assert sent or name in reply.text

    @pytest.mark.parametrize("moving", [False, True])
    def test_it_is_not_sent_to_a_robot_that_is_elsewhere_on_the_motion(self, checker, swing, moving) -> None:
        """The tube of the whole motion says nothing about its start: the end and every corner are in it too."""
        sent = {True: 0, False: 0}
        for time in np.linspace(0.0, swing.duration, 100):
            q, dq = swing(time), swing.velocity(time) * moving
            execution = ros2.CertifiedExecution(checker)
            execution.on_state({**at_rest(q, swing), "velocity": dq.tolist()}, 0.0)
            there = np.abs(q - swing.start).max() <= 0.02
            command = execution.on_path(ros2.display_trajectory([swing]), 0.01).command
            assert command is None or there, time
            sent[there] += command is not None
        assert sent[False] == 0
        assert sent[True] > 0

    def test_without_velocities_two_states_are_needed(self, checker, swing) -> None:
        execution, shown = ros2.CertifiedExecution(checker), ros2.display_trajectory([swing])
        still = {**at_rest(swing.start, swing), "velocity": []}
        execution.on_state(still, 0.0)
        assert execution.on_path(shown, 0.001).command is None
        execution.on_state(still, 0.01)
        assert execution.on_path(shown, 0.011).command is not None
        moving = ros2.CertifiedExecution(checker)
        moving.on_state({**still, "position": (swing.start - 0.03).tolist()}, 0.0)
        moving.on_state(still, 0.01)
        assert moving.on_path(shown, 0.011).command is None

    def test_it_is_not_sent_for_a_start_with_attached_objects(self, checker, swing) -> None:
        shown = ros2.display_trajectory([swing])
        shown["trajectory_start"]["attached_collision_objects"] = [{"link_name": "tool0", "object": {"id": "part"}}]
        reply = ready(checker, swing).on_path(shown, 0.01)
        assert (reply.command, reply.alarm) == (None, True)

    def test_the_joints_outside_the_arm_must_be_where_they_are_certified(self) -> None:
        """The motion of a Panda is certified with closed fingers."""
        arm = pp.load_robot("panda").arm()
        motion = pp.time_parametrise(pp.JointPath([arm.home, arm.home + 0.1], arm.joint_names), arm.limits)
        finger = next(name for name in arm.held if "finger" in name)

        def state(q: np.ndarray, at: float) -> dict[str, object]:
            names = [*arm.joint_names, finger]
            return {"name": names, "position": [*q.tolist(), arm.held[finger] + at], "velocity": [0.0] * len(names)}

        for opened, sent in ((0.0, True), (5e-4, True), (0.03, False)):
            execution = ros2.CertifiedExecution(pp.CollisionChecker(arm))
            assert execution.on_state(state(arm.home, opened), 0.0) == ros2.Reply()
            assert (execution.on_path(ros2.display_trajectory([motion]), 0.01).command is not None) is sent
            stated = ros2.display_trajectory([motion], held={finger: arm.held[finger] + opened})
            execution = ros2.CertifiedExecution(pp.CollisionChecker(arm))
            execution.on_state(state(arm.home, 0.0), 0.0)
            assert (execution.on_path(stated, 0.01).command is not None) is sent
            if sent:
                reply = execution.on_state(state(arm.home, 0.03), 0.02)
                assert reply.alarm
                assert finger in reply.text
                assert not ros2.read_joint_trajectory(reply.command).velocities[-1].any()
