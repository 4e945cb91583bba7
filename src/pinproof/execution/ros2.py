"""Messages of ROS 2 as nested dictionaries, without ROS: trajectories, planning scenes, point clouds, joint states.

The keys are the fields of the message definitions. Where ROS is installed, :func:`to_ros` makes a message of such a
dictionary, and :func:`from_ros` a dictionary of a message. Fields that are not written keep their defaults.

Sources of the definitions, as of ROS 2 Jazzy: the packages builtin_interfaces and std_msgs (``Duration``, ``Header``),
trajectory_msgs (``JointTrajectory``), sensor_msgs (``JointState``, ``PointCloud2``, ``PointField``), shape_msgs,
geometry_msgs, and moveit_msgs (``RobotTrajectory``, ``RobotState``, ``DisplayTrajectory``, ``PlanningScene``,
``CollisionObject``, ``AllowedCollisionMatrix``).
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, PointCloud, Scene, certify, moveit_message, read_moveit_message
from pinproof.common.validation import require_positive
from pinproof.errors import InputError, PinproofError, UnknownNameError
from pinproof.execution.monitor import Monitor, MonitorResult
from pinproof.motion import Trajectory, from_message, to_message
from pinproof.spatial import Array, finite

__all__ = [
    "CertifiedExecution",
    "Reply",
    "display_trajectory",
    "from_ros",
    "joint_trajectory",
    "planning_scene",
    "point_cloud2",
    "read_display_trajectory",
    "read_joint_state",
    "read_joint_trajectory",
    "read_planning_scene",
    "read_point_cloud2",
    "read_robot_trajectory",
    "robot_trajectory",
    "to_ros",
]

Message = dict[str, Any]

POINT_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""The numbers of sensor_msgs/PointField, as types of NumPy."""

FLOAT32 = 7


def to_ros(name: str, message: Mapping[str, Any]) -> Any:
    """Return a message of ROS 2 with the fields of a dictionary of this module.

    Parameters
    ----------
    name
        The type of the message, such as ``"trajectory_msgs/JointTrajectory"``.
    message
        The dictionary, such as that of :func:`joint_trajectory`.

    Raises
    ------
    InputError
        If the package of the message is not installed, or it has no such message or field.
    """
    package, _, kind = name.replace("/msg/", "/").partition("/")
    try:
        made = getattr(import_module(f"{package}.msg"), kind)()
    except (ImportError, AttributeError) as error:
        remedy = "install ROS 2 and its package, and source setup.bash"
        raise InputError(f"there is no message {name!r} ({error}); {remedy}") from error
    types = made.get_fields_and_field_types()
    for field, value in message.items():
        if field not in types:
            raise UnknownNameError("field", field, types, f"the message {name}")
        # the type of a nested message, or of the items of a list of messages
        inner = re.sub(r"^sequence<|[,>\[].*$", "", types[field])
        if isinstance(value, Mapping):
            value = to_ros(inner, value)
        elif isinstance(value, list) and "/" in inner:
            value = [to_ros(inner, item) for item in value]
        setattr(made, field, value)
    return made


def from_ros(message: Any) -> Any:
    """Return a message of ROS 2 as a dictionary, which the functions of this module read; other values unchanged."""
    if hasattr(message, "get_fields_and_field_types"):
        return {field: from_ros(getattr(message, field)) for field in message.get_fields_and_field_types()}
    if isinstance(message, (array, np.ndarray)):
        return message.tobytes() if isinstance(message, array) and message.typecode == "B" else message.tolist()
    return [from_ros(item) for item in message] if isinstance(message, (list, tuple)) else message


def joint_trajectory(trajectory: Trajectory, *, frame: str = "") -> Message:
    """Return a trajectory_msgs/JointTrajectory; its header has the time 0, which starts the motion on arrival."""
    message = to_message(trajectory.record())
    return {"header": _header(frame), "joint_names": message["joint_names"], "points": message["points"]}


def read_joint_trajectory(message: Mapping[str, Any]) -> Trajectory:
    """Read a trajectory_msgs/JointTrajectory with positions and velocities; the time of its header is ignored.

    Raises
    ------
    TrajectoryError
        If a field is missing or invalid; the message names its place, such as ``points[3].velocities``.
    """
    return Trajectory.of_record(from_message(dict(message), "trajectory_msgs/JointTrajectory"))


def robot_trajectory(trajectory: Trajectory) -> Message:
    """Return a moveit_msgs/RobotTrajectory."""
    return {"joint_trajectory": joint_trajectory(trajectory)}


def read_robot_trajectory(message: Mapping[str, Any]) -> Trajectory:
    """Read a moveit_msgs/RobotTrajectory; one that moves joints of several degrees of freedom is refused.

    Raises
    ------
    InputError
        If it moves such joints or has no joint_trajectory.
    TrajectoryError
        As for :func:`read_joint_trajectory`.
    """
    if (message.get("multi_dof_joint_trajectory") or {}).get("points"):
        raise InputError("the RobotTrajectory moves joints of several degrees of freedom, which are not supported")
    return read_joint_trajectory(_field(message, "joint_trajectory", "RobotTrajectory"))


def display_trajectory(
    trajectories: Sequence[Trajectory], *, model: str = "", held: Mapping[str, float] | None = None
) -> Message:
    """Return a moveit_msgs/DisplayTrajectory, as RViz shows it.

    Parameters
    ----------
    trajectories
        The motions, one after the other.
    model
        The name of the robot model of MoveIt.
    held
        Positions (rad or m) of other joints at the start, such as the fingers.
    """
    # RViz shows the robot where the first motion starts
    if not trajectories:
        raise InputError("display_trajectory needs at least one trajectory")
    first = trajectories[0]
    state = {**(held or {}), **dict(zip(first.joint_names, first.start.tolist(), strict=True))}
    joints = {"header": _header(""), "name": list(state), "position": [float(value) for value in state.values()]}
    return {
        "model_id": model,
        "trajectory": [robot_trajectory(each) for each in trajectories],
        "trajectory_start": {"joint_state": joints},
    }


def read_display_trajectory(message: Mapping[str, Any]) -> tuple[Trajectory, ...]:
    """Read the motions of a moveit_msgs/DisplayTrajectory; errors as for :func:`read_robot_trajectory`."""
    return tuple(map(read_robot_trajectory, _field(message, "trajectory", "DisplayTrajectory")))


def planning_scene(scene: Scene, *, frame: str = "") -> Message:
    """Return a moveit_msgs/PlanningScene that adds the obstacles of a scene to the scene of MoveIt (``is_diff``).

    MoveIt replaces its allowed-collision matrix by the matrix of a message, which contains only the pairs of
    ``scene.allowed`` and ``scene.disabled``. A scene without such pairs leaves it unchanged.

    Parameters
    ----------
    scene
        The scene.
    frame
        The frame of the poses; default: the frame of the scene, or ``"world"``.

    Raises
    ------
    InputError
        If the message has no shape for an obstacle, such as a height map.
    """
    return moveit_message(scene.obstacles, scene.allowed, scene.disabled, frame or scene.frame)


def read_planning_scene(message: Mapping[str, Any]) -> Scene:
    """Read a moveit_msgs/PlanningScene, with the rules of :mod:`pinproof.collision.moveit`.

    Raises
    ------
    SceneError
        If something is not supported, such as attached objects; the message names it.
    """
    return Scene(**read_moveit_message(message))


def point_cloud2(points: npt.ArrayLike, *, frame: str = "world") -> Message:
    """Return a sensor_msgs/PointCloud2 of points (N, 3) in metres, as 32-bit floats in the fields x, y and z."""
    stated = finite("points", points, (None, 3)).astype("<f4")
    fields = [{"name": name, "offset": 4 * k, "datatype": FLOAT32, "count": 1} for k, name in enumerate("xyz")]
    return {
        "header": _header(frame),
        "height": 1,
        "width": len(stated),
        "fields": fields,
        "is_bigendian": False,
        "point_step": 12,
        "row_step": 12 * len(stated),
        "data": list(stated.tobytes()),
        "is_dense": True,
    }


def read_point_cloud2(message: Mapping[str, Any], resolution: float) -> PointCloud:
    """Read the fields x, y and z of a sensor_msgs/PointCloud2 as a :class:`~pinproof.PointCloud`.

    The points are in the frame ``message["header"]["frame_id"]``, whose pose is the pose of the obstacle.
    Points that are not finite are dropped and counted (:attr:`PointCloud.dropped <pinproof.PointCloud.dropped>`).

    Parameters
    ----------
    message
        The message; ``data`` may be bytes, an array or a list of integers.
    resolution
        The side (m) of a cell.

    Raises
    ------
    InputError
        If a field is missing, its type is unknown, or the data have another size than the fields state.
    """
    # The layout of a point: where its coordinates are, and of which type
    where = "PointCloud2"
    step, width, height, row = (
        int(_field(message, key, where)) for key in ("point_step", "width", "height", "row_step")
    )
    fields = {str(each["name"]): each for each in _field(message, "fields", where)}
    order = ">" if message.get("is_bigendian") else "<"
    formats, offsets = [], []
    for name in "xyz":
        if name not in fields:
            raise UnknownNameError("field", name, fields, f"the {where}")
        kind, offset = POINT_TYPES.get(int(fields[name]["datatype"])), int(fields[name]["offset"])
        if kind is None or not kind.startswith("f"):
            raise InputError(f"the field {name} of the {where} has the datatype {fields[name]['datatype']}, not 7 or 8")
        if offset < 0 or offset + int(kind[1]) > step:
            raise InputError(f"the field {name} of the {where} is beyond point_step = {step}")
        formats.append(order + kind)
        offsets.append(offset)
    # The bytes, whose number must agree with what the message states
    stated = _field(message, "data", where)
    try:
        data = np.frombuffer(stated if isinstance(stated, (bytes, bytearray)) else bytes(stated), dtype=np.uint8)
    except (TypeError, ValueError) as error:
        raise InputError(f"data of the {where} must be bytes: {error}") from error
    if min(width, height) < 0 or row < width * step or len(data) != row * height:
        raise InputError(
            f"the {where} has {len(data)} bytes; {height} rows of {row} bytes with {width} points of {step} bytes were "
            "expected"
        )
    # The points without the padding between the rows
    layout = np.dtype({"names": list("xyz"), "formats": formats, "offsets": offsets, "itemsize": step})
    rows = np.ascontiguousarray(data.reshape(height, row)[:, : width * step]).view(layout).reshape(-1)
    return PointCloud(np.column_stack([rows[name].astype(float) for name in "xyz"]), resolution)


def read_joint_state(message: Mapping[str, Any], joint_names: Sequence[str]) -> tuple[Array, Array | None]:
    """Return positions (n,) and, if the message has them, velocities (n,) of a sensor_msgs/JointState, by name.

    Values that are not finite are returned as they are; :meth:`pinproof.Monitor.update` reports them.

    Raises
    ------
    UnknownNameError
        If a joint is missing.
    InputError
        If the numbers of names and values differ, or a joint occurs twice.
    """
    # Joints are matched by name; the message may have others
    names = [str(name) for name in _field(message, "name", "JointState")]
    order = []
    for name in joint_names:
        if name not in names:
            raise UnknownNameError("joint", name, names, "the JointState")
        if names.count(name) > 1:
            raise InputError(f"the JointState has the joint {name!r} {names.count(name)} times")
        order.append(names.index(name))
    found = []
    for key in ("position", "velocity"):
        try:
            values = np.asarray(message.get(key, ()), dtype=float)
        except (TypeError, ValueError) as error:
            raise InputError(f"{key} of the JointState must be numbers: {error}") from error
        if len(values) not in (len(names), 0 if key == "velocity" else len(names)):
            raise InputError(f"the JointState has {len(names)} names and {len(values)} values of {key}")
        found.append(values[order] if len(values) else None)
    position, velocity = found
    return np.zeros(0) if position is None else position, velocity


MALFORMED = (PinproofError, AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError)
"""What reading a message raises that is no message of its type; a message comes from outside the process."""

HELD_TOLERANCE = 1e-3
"""rad or m: by how much a joint outside the arm, such as a finger, may differ from the value that is certified."""


class Reply(NamedTuple):
    """The answer of :class:`CertifiedExecution` to a message: a text to log, and a JointTrajectory to send or None."""

    text: str = ""
    command: Message | None = None
    alarm: bool = False


class _ReceivedState(NamedTuple):
    """A joint state: the time (s) of its measurement, its positions and velocities (n,).

    Without measured velocities they follow from the state before, and are None without one. ``elsewhere`` is the joint
    outside the arm that is not where the certificates assume it, in words.
    """

    time: float
    q: Array
    dq: Array | None
    elsewhere: str


class CertifiedExecution:
    """Sends each motion that is displayed if it is proven collision-free, and monitors its execution.

    A node passes messages as dictionaries with the time (s) of its clock, and sends the commands of the replies. No
    message raises an exception: what cannot be read while a motion is executed is answered by a stop.

    Parameters
    ----------
    checker
        The arm. Each complete planning scene that is received replaces its scene.
    joint_tolerance
        rad or m, one number or (n,): the deviations that certificates and monitor cover.
    latency
        Seconds from a measurement until the brakes act, as for :class:`pinproof.Monitor`.
    timeout
        Seconds after which a joint state is too old: a motion is stopped without a later one (:meth:`on_clock`), and no
        motion begins.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        *,
        joint_tolerance: npt.ArrayLike = 0.02,
        latency: float = 0.01,
        timeout: float = 0.1,
    ):
        require_positive("timeout (s)", timeout)
        self.checker, self.joint_tolerance, self.latency, self.timeout = checker, joint_tolerance, latency, timeout
        self.monitor: Monitor | None = None
        self._motion: Trajectory | None = None
        self._begin, self._unread, self._unproven = 0.0, "", ""
        self._frames: tuple[list[Any], ...] | None = None
        self._last: _ReceivedState | None = None
        """The last joint state; None before the first one, and after one that cannot be read."""

    def on_scene(self, message: Mapping[str, Any], seconds: float) -> Reply:  # noqa: ARG002
        """Use a complete moveit_msgs/PlanningScene, and prove a motion that is executed again in it.

        No motion is sent after a scene that cannot be read, or a difference that changes the objects, until a complete
        scene can be read. A motion that is executed then, or that is not proven collision-free in the new scene, is
        stopped at the next joint state.
        """
        try:
            if message.get("is_diff"):
                moved = any(_frames(message)) and _frames(message) != self._frames
                if not moved and not _changes_objects(message):
                    return Reply()
                self._unread = "no motion is sent until a complete planning scene is received, because objects changed"
            else:
                self.checker, self._unread = self.checker.with_scene(read_planning_scene(message)), ""
                self._frames = _frames(message)
        except MALFORMED as error:
            self._unread = f"no motion is sent, because the planning scene cannot be read: {error}"
        # A motion that is executed is monitored in the present scene
        self._unproven = self._unread
        if not self._unread and self._motion is not None:
            tolerance, latency = self.joint_tolerance, self.latency
            try:
                self.monitor = Monitor(self.checker, self._motion, joint_tolerance=tolerance, latency=latency)
            except PinproofError as error:
                self._unproven = f"the motion is stopped: {error}"
        return Reply(self._unproven, alarm=bool(self._unproven))

    def on_path(self, message: Mapping[str, Any], seconds: float) -> Reply:
        """Certify the motion of a moveit_msgs/DisplayTrajectory, and send it if it is collision-free.

        It is not sent while another motion is executed, or unless the last joint state, at most ``timeout`` old, and
        the ``trajectory_start`` of the message are within the tolerance of its start.
        """
        try:
            trajectory = Trajectory.join(*read_display_trajectory(message))
            certificate = certify(trajectory, self.checker, joint_tolerance=self.joint_tolerance)
            if not certificate.free or self._unread:
                return Reply(self._unread or certificate.message, alarm=True)
            if self._motion is not None and seconds < self._begin + self._motion.duration:
                return Reply("the motion is not sent: another motion is executed", alarm=True)
            monitor = Monitor(self.checker, trajectory, certificate=certificate, latency=self.latency)
            if reason := self._away_from_start(message, trajectory, monitor, seconds):
                return Reply(f"the motion is not sent: {reason}", alarm=True)
        except MALFORMED as error:
            return Reply(f"the motion is not sent: {error}", alarm=True)
        self.monitor, self._motion, self._begin, self._unproven = monitor, trajectory, seconds, ""
        return Reply(certificate.message, joint_trajectory(trajectory))

    def on_state(self, message: Mapping[str, Any], seconds: float) -> Reply:
        """Compare a sensor_msgs/JointState with the motion; send the stop if the robot leaves its tube.

        The time of the measurement is the stamp of the header, or ``seconds`` without a stamp. A state that cannot be
        read, or is not later than the one before, is answered by the stop too; so is a time of the last measurement
        that is more than ``timeout`` before or after ``seconds``, by :meth:`on_clock`.
        """
        # After a stop because of silence, this state is not judged any more
        if (silence := self.on_clock(seconds)).alarm:
            return silence
        before, self._last = self._last, None
        try:
            stamp = (message.get("header") or {}).get("stamp") or {}
            stamped = int(stamp.get("sec", 0)) + int(stamp.get("nanosec", 0)) * 1e-9
            time = stamped if stamped != 0.0 else seconds
            if before is not None and not time > before.time:
                raise InputError(f"it was measured at {time:.6g} s, not after the one before, at {before.time:.6g} s")
            q, dq = read_joint_state(message, self.checker.group.joint_names)
            if not np.isfinite(q).all() or (dq is not None and not np.isfinite(dq).all()):
                raise InputError("it has values that are not finite")
            elsewhere = _difference(message, self._expected())
            known = dq if dq is not None or before is None else (q - before.q) / (time - before.time)
            result = None if self.monitor is None else self.monitor.update(time - self._begin, q, dq)
        except MALFORMED as error:
            return self._stop(f"the joint state cannot be used: {error}", seconds)
        self._last = _ReceivedState(time, q, known, elsewhere)
        if result is None or not (result.alarm or self._unproven or elsewhere):
            return Reply()
        return self._stop(self._unproven or elsewhere or str(result), seconds, result)

    def on_clock(self, seconds: float) -> Reply:
        """Send the stop if a motion is executed and no joint state came for ``timeout``; call it regularly."""
        last = self._begin if self._last is None else max(self._last.time, self._begin)
        if self.monitor is None or self._motion is None or last >= self._begin + self._motion.duration:
            return Reply()
        if abs(seconds - last) <= self.timeout:
            return Reply()
        return self._stop(f"no joint state was received for {abs(seconds - last):.3g} s", seconds)

    def _stop(self, text: str, seconds: float, result: MonitorResult | None = None) -> Reply:
        """The stop that the monitor judged; from the state of the motion if the measured one is not known."""
        if self.monitor is None or self._motion is None:
            return Reply(text, alarm=True)
        if result is not None and np.isfinite(result.q).all() and np.isfinite(result.dq).all():
            q, dq = result.q, result.dq
        else:
            elapsed = seconds - self._begin if np.isfinite(seconds) else 0.0
            time = min(max(elapsed, 0.0), self._motion.duration)
            q, dq = np.asarray(self._motion(time)), np.asarray(self._motion.velocity(time))
            # The robot was in the tube, and may still be anywhere in it.
            proven = self.monitor.proves_stop(q, dq, self.joint_tolerance)
            text += f"; the stop from the state of the motion is{'' if proven else ' not'} proven collision-free"
        stop = self.monitor.stop_trajectory(q, dq)
        self.monitor = self._motion = None
        return Reply(text, joint_trajectory(stop), alarm=True)

    def _away_from_start(
        self, message: Mapping[str, Any], trajectory: Trajectory, monitor: Monitor, seconds: float
    ) -> str:
        """Why the robot, or the start that the message states, is not at the start of a motion; empty if both are."""
        # Where the robot is, and how fast it moves there
        state = self._last
        if state is None or not abs(seconds - state.time) <= self.timeout:
            return f"no joint state was received in the last {self.timeout:g} s"
        if state.elsewhere:
            return state.elsewhere
        if state.dq is None:
            return "the velocities of the robot are not known; a second joint state is needed"
        off = monitor.start_deviation(state.q, state.dq)
        if not (off <= 1.0).all():
            j = int(off.argmax())
            where = f"{state.q[j]:.6g}, with a velocity of {state.dq[j]:.3g}"
            return f"the robot is not at its start: {trajectory.joint_names[j]} is at {where}"
        # What the message states of the start must agree with what is certified
        stated = message.get("trajectory_start") or {}
        if stated.get("attached_collision_objects"):
            return "its trajectory_start has attached objects, which are not certified"
        if wrong := _difference(stated.get("joint_state") or {}, self._expected(trajectory)):
            return f"its trajectory_start is another: {wrong}"
        return ""

    def _expected(self, motion: Trajectory | None = None) -> dict[str, tuple[float, float]]:
        """Value and tolerance (rad or m) of each joint outside the arm, and of the arm at the start of a motion."""
        expected = {name: (value, HELD_TOLERANCE) for name, value in self.checker.group.held.items()}
        if motion is not None:
            tolerance = np.broadcast_to(self.joint_tolerance, motion.start.shape).tolist()
            pairs = zip(motion.start.tolist(), tolerance, strict=True)
            expected |= dict(zip(motion.joint_names, pairs, strict=True))
        return expected


def _difference(state: Mapping[str, Any], expected: Mapping[str, tuple[float, float]]) -> str:
    """The first joint of a JointState that is not where it is expected; empty without one."""
    for name, position in zip(state.get("name", ()), state.get("position", ()), strict=True):
        value, tolerance = expected.get(str(name), (0.0, np.inf))
        if str(name) in expected and not abs(float(position) - value) <= tolerance:
            return f"{name} is at {float(position):.6g}, but {value:.6g} is certified"
    return ""


def _frames(message: Mapping[str, Any]) -> tuple[list[Any], ...]:
    """What a planning scene states of the poses of its frames, and of the robot in it."""
    floating = (message.get("robot_state") or {}).get("multi_dof_joint_state") or {}
    return list(message.get("fixed_frame_transforms") or ()), list(floating.get("transforms") or ())


def _changes_objects(difference: Mapping[str, Any]) -> bool:
    """Whether a difference to a planning scene states more than the positions of the joints.

    An unknown key of the world counts, the padding of links does not, because the checker has its own margins.
    """
    world = dict(difference.get("world") or {})
    octomap = (world.pop("octomap", None) or {}).get("octomap") or {}
    matrix = difference.get("allowed_collision_matrix") or {}
    attached = (difference.get("robot_state") or {}).get("attached_collision_objects")
    return any(map(bool, (*world.values(), octomap.get("data"), attached, *matrix.values())))


def _header(frame: str) -> Message:
    return {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame}


def _field(message: Mapping[str, Any], key: str, where: str) -> Any:
    if key not in message:
        raise InputError(f"the {where} has no field {key!r}; it has {', '.join(map(str, message)) or 'none'}")
    return message[key]
