"""Robots, and the arms and joint groups that are selected from them: FK, Jacobians, torques.

:class:`Robot` and :class:`Arm` refer to each other, so they are in one module. :mod:`pinproof.model.chain` finds the
joints between a base and a tcp, :mod:`pinproof.model.loading` reads the files.
"""

from __future__ import annotations

import math
import threading
from collections import Counter
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeVar, cast

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof._core import Chain as CompiledChain
from pinproof.common.files import write_text_whole
from pinproof.common.results import Identified, Rows, View
from pinproof.common.structs import described, key
from pinproof.common.validation import ReadOnlyDict, require_type
from pinproof.description import (
    GENERATED_BODIES,
    VISUALS_CAN_BE_CHECKED,
    Calibration,
    Srdf,
    Urdf,
    UrdfJoint,
    has_generated_bodies,
    notes,
    rerooted,
)
from pinproof.errors import InputError, UnknownNameError, UrdfError
from pinproof.model.chain import (
    Chain,
    LimitsLike,
    affine,
    base_of,
    chain_of,
    check_count,
    chosen_limits,
    compiled_chain,
    declared_tcp,
    find_chain,
    group_ends,
    held_values,
    known_frame,
    leaves,
    link_path,
    moving_joints,
    periodic,
    reduced_model,
)
from pinproof.model.dynamics import GRAVITY, Payload, checked_payloads, dynamic_tree, inverse_dynamics, mass_matrix
from pinproof.model.info import (
    EFFECT_SAMPLES,
    SAMPLES,
    CalibrationEffect,
    JointInfo,
    RobotInfo,
    Role,
    describe_axes,
)
from pinproof.model.limits import JointLimits
from pinproof.spatial import Array, finite, frozen

Reference = Literal["LOCAL_WORLD_ALIGNED", "LOCAL", "WORLD"]
REFERENCES: tuple[Reference, ...] = ("LOCAL_WORLD_ALIGNED", "LOCAL", "WORLD")


Group = TypeVar("Group", bound="JointGroup")

PART = "/"
"""Separates the name of a robot in a cell from the names of its links and joints."""


@described(eq=False)
class Singularity:
    """The distance of a configuration from a singularity; result of :meth:`Arm.singularity`."""

    smallest: float = key(
        "the smallest singular value of the tcp Jacobian (LOCAL_WORLD_ALIGNED; metres and radians mixed)"
    )
    direction: Array = key(
        "(6,) the unit twist, linear then angular, of the smallest singular value; if that is 0, motion in this "
        "direction is impossible"
    )
    singular_values: Array = key("(min(6, n),) all singular values, largest first")


HELD_READ_ONLY = "the held joints of an arm are read-only; arm.with_held({name: value}) makes an arm with others"
ENDS_READ_ONLY = "the arms of a joint group are read-only; robot.arms() makes other groups"
HOME_READ_ONLY = "the home of a robot is read-only; pass the configuration where it is needed"


class JointGroup(Identified):
    """Joints of a robot that are planned, certified and timed together, with the tcps of one or several arms.

    Created by :meth:`pinproof.Robot.arms` and :func:`pinproof.assemble`; :class:`Arm` is the group of a single arm. The
    arms are branches of one kinematic tree: they may share joints between their base and the links where they part,
    such as a torso or a linear axis.

    A configuration ``q`` is (n,) in the order of ``joint_names``, in rad or m; a continuous joint is one unwrapped
    angle. All methods are thread-safe.

    A group is read-only, so that a certificate of it stays valid; :meth:`with_limits` and :meth:`with_held` return
    other groups.

    Attributes
    ----------
    robot
        The robot.
    ends
        The base link and the tcp frame of each arm, by the name of the arm.
    joint_names
        Names of the n joints, arm by arm, each from base to tcp; a shared joint is listed with the first of its arms.
    limits
        Limits of the joints, in this order.
    held
        Values (rad or m) of the other joints of the robot by name; :meth:`with_held` returns a group with other values.
    angular
        (n,) True for a revolute or continuous joint, False for a prismatic one.
    periodic
        (n,) True where q and q + 2 pi give the same pose of every link (False for example for an angular joint with a
        mimic follower of multiplier 0.5).
    """

    def __init__(
        self,
        robot: Robot,
        ends: Mapping[str, tuple[str, str]],
        chain: Chain,
        limits: JointLimits,
        held: Mapping[str, float],
    ) -> None:
        self.robot = robot
        self.ends: Mapping[str, tuple[str, str]] = ReadOnlyDict(ends, ENDS_READ_ONLY)
        self.limits, self.held = limits, ReadOnlyDict(held, HELD_READ_ONLY)
        self._chain = chain
        self.joint_names, self.angular = chain.joint_names, chain.angular
        self.followers = chain.followers
        self._model = reduced_model(robot.urdf, robot._model, {*chain.joint_names, *chain.followers}, held)
        self.scale, self.offset = affine(robot.urdf, chain, tuple(self._model.names)[1:])
        for array in (self.scale, self.offset):
            array.setflags(write=False)
        self.periodic = periodic(robot.urdf, chain)
        # Pinocchio's data belong to a thread
        self._threads = threading.local()
        self._root_from_base: dict[str, pin.SE3] = {}
        self._chains: dict[tuple[str | None, str | None], CompiledChain] = {}
        # poses are relative to the base, which must therefore be at rest
        for name, (base, _) in self.ends.items():
            frame = self._model.frames[self._frame_id(base)]
            if frame.parentJoint and len(self.ends) > 1:
                what = f"the base {base!r} of arm {name!r} is moved by joints of another arm"
                raise InputError(f"{what}; pass a base= that no arm moves")
            if frame.parentJoint:
                what = f"the base {base!r} is moved by the arm's own joints, through a mimic joint"
                raise InputError(f"{what}; choose another")
            self._root_from_base[name] = frozen(frame.placement)

    def __setattr__(self, name: str, value: object) -> None:
        if name in self.__dict__:
            raise AttributeError(
                f"{name} of an arm is read-only; arm.with_limits(), arm.with_held() and robot.arm() return other arms"
            )
        object.__setattr__(self, name, value)

    @property
    def model(self) -> Any:
        """A copy of the reduced :class:`pinocchio.Model` of the arm; changing it does not change the arm."""
        return self._model.copy()

    @property
    def dof(self) -> int:
        """The number n of joints in q."""
        return len(self.joint_names)

    @cached_property
    def arms(self) -> Mapping[str, Arm]:
        """The arms by name; each is an :class:`Arm` whose other joints are held at their home."""
        made = {}
        for name, (base, tcp) in self.ends.items():
            chain = find_chain(self.robot.urdf, (base, tcp))
            limits, held = self.limits.select(self.indices(name)), self._held_for(chain, self.held)
            made[name] = Arm(self.robot, base, tcp, chain, limits, held)
        return ReadOnlyDict(made, ENDS_READ_ONLY)

    def _held_for(self, chain: Chain, held: Mapping[str, float]) -> dict[str, float]:
        """The values of the joints outside a chain; those of mimic joints follow from their leaders."""
        urdf, home = self.robot.urdf, self.robot.home
        mimic = {joint.name for joint in urdf.joints.values() if joint.mimic is not None}
        return held_values(urdf, chain, {name: value for name, value in held.items() if name not in mimic}, home)

    def indices(self, arm: str) -> npt.NDArray[np.int64]:
        """Return the indices of the joints of an arm in q, so that ``q[group.indices("left")]`` is its configuration.

        Raises
        ------
        UnknownNameError
            If the group has no arm of that name.
        """
        names = moving_joints(self.robot.urdf, *self._ends_of(arm))
        return np.array([self.joint_names.index(name) for name in names], dtype=int)

    def _ends_of(self, arm: str) -> tuple[str, str]:
        if arm not in self.ends:
            raise UnknownNameError("arm", arm, self.ends, f"the joint group of {self.robot.name!r}")
        return self.ends[arm]

    @property
    def shared_joints(self) -> tuple[str, ...]:
        """The joints that belong to more than one arm."""
        count = Counter(name for ends in self.ends.values() for name in moving_joints(self.robot.urdf, *ends))
        return tuple(name for name in self.joint_names if count[name] > 1)

    def tcp_of(self, arm: str | None) -> str:
        """Return the tcp frame of an arm; None is the only arm.

        Raises
        ------
        UnknownNameError
            If the group has no arm of that name.
        InputError
            If no arm is named, and the group has several.
        """
        if arm is None:
            if len(self.ends) > 1:
                raise InputError(f"the joint group has the arms {', '.join(self.ends)}; name one of them")
            arm = next(iter(self.ends))
        return self._ends_of(arm)[1]

    def tcp_placements(self, q: npt.ArrayLike) -> dict[str, pin.SE3]:
        """Compute ``root_from_tcp`` of each arm at q (n,), by the name of the arm, in the frame of the root link."""
        at = self.configuration(q)
        return {name: self._root_from(at, self._frame_id(tcp)) for name, (_, tcp) in self.ends.items()}

    def tcp_placement(self, q: npt.ArrayLike, arm: str | None = None, relative_to: str | None = None) -> pin.SE3:
        """Compute the pose of the tcp of an arm at q (n,), in the frame of its base or of the tcp of another arm.

        Raises
        ------
        UnknownNameError, InputError
            As :meth:`tcp_of`.
        """
        at = self.configuration(q)
        reference, tcp = (self._root_from(at, frame) for frame in self._reference_and_tcp(arm, relative_to))
        return reference.inverse() * tcp

    def tcp_chain(self, arm: str | None = None, relative_to: str | None = None) -> CompiledChain:
        """Return the joints that determine :meth:`tcp_placement`, for the compiled core."""
        chain = self._chains.get((arm, relative_to))
        if chain is None:
            frames = self._reference_and_tcp(arm, relative_to)
            chain = self._chains[arm, relative_to] = compiled_chain(self._model, *frames, self.scale, self.offset)
        return chain

    def hand_links(self, arm: str | None = None) -> tuple[str, ...]:
        """Return the links that no joint of the group moves relative to the tcp of an arm."""
        frames = self._model.frames
        joint = frames[self._frame_id(self.tcp_of(arm))].parentJoint
        return tuple(each.name for each in frames if each.parentJoint == joint and each.type == pin.FrameType.BODY)

    def _reference_and_tcp(self, arm: str | None, relative_to: str | None) -> tuple[int, int]:
        """The indices of the base of an arm, or of the tcp of another arm, and of the tcp of the arm."""
        tcp = self.tcp_of(arm)
        base = next(base for base, other in self.ends.values() if other == tcp)
        return self._frame_id(base if relative_to is None else self.tcp_of(relative_to)), self._frame_id(tcp)

    def root_from_frame(self, q: npt.ArrayLike, frame: str) -> pin.SE3:
        """Compute the pose of any link of the robot in the frame of the root link at the configuration q (n,)."""
        return self._root_from(self.configuration(q), self._frame_id(frame))

    def seen_from(self, frame: str, arm: str | None = None) -> Arm:
        """Return an :class:`Arm` of the same joints with poses of a tcp in the frame of any link, which may move too.

        An example is the torch of a robot seen from the plate of a turntable. The joints from the link to its common
        ancestor with the tcp come first in the chain, in reverse; their values and the order of q are those of the
        group.

        Parameters
        ----------
        frame
            The link.
        arm
            The arm whose tcp it is; None for the only arm.

        Raises
        ------
        UnknownNameError
            If the link or the arm does not exist.
        InputError
            If a joint of the group does not move the tcp relative to the link.
        """
        tcp = self.tcp_of(arm)
        robot = Robot(rerooted(self.robot.urdf, known_frame(self.robot.urdf, frame)), Srdf(), home=self.robot.home)
        chain = chain_of(robot.urdf, self.joint_names)
        moving = moving_joints(robot.urdf, frame, tcp)
        if still := [name for name in self.joint_names if name not in moving]:
            raise InputError(
                f"the joints {', '.join(still)} do not move {tcp!r} relative to {frame!r}; select a joint group "
                "without them, which holds them"
            )
        return Arm(robot, frame, tcp, chain, self.limits, self.held)

    @cached_property
    def _home(self) -> Array:
        lower, upper = self.limits.sampling_range()
        middle = dict(zip(self.joint_names, (lower + upper) / 2, strict=True))
        return self.limits.clip(np.array([self.robot.home.get(name, middle[name]) for name in self.joint_names]))

    @property
    def home(self) -> Array:
        """(n,) home configuration of the robot, or the middle of the limits where none is defined (continuous: 0)."""
        return self._home.copy()

    def state(self, name: str, *, group: str | None = None) -> Array:
        """Return a named state (n,) of the SRDF (:meth:`pinproof.Robot.state`), in the order of ``joint_names``.

        Raises
        ------
        UnknownNameError
            If the state does not exist.
        InputError
            If the state does not define all joints of the arm.
        """
        values = self.robot.state(name, group=group)
        missing = [joint for joint in self.joint_names if joint not in values]
        if missing:
            raise InputError(f"state {name!r} has no value for the joints {', '.join(missing)} of the arm")
        return np.array([values[joint] for joint in self.joint_names])

    def torques(
        self,
        q: npt.ArrayLike,
        v: npt.ArrayLike = 0.0,
        a: npt.ArrayLike = 0.0,
        *,
        payload: Payload | Sequence[Payload] | None = None,
        gravity: npt.ArrayLike = GRAVITY,
    ) -> Array:
        """Compute the torques (n,) that move the arm, by inverse dynamics: M(q) a + C(q, v) v + g(q).

        Torques are in N m, and in N for a prismatic joint. The inertias are those of the URDF. The other joints of the
        robot are held; mimic followers add their torque, times their multiplier, to that of the joint that they follow.
        Friction and rotor inertia are not modelled.

        Parameters
        ----------
        q, v, a
            (n,) configuration, velocity and acceleration; one number for the latter two applies to all joints.
        payload
            A body, or several, that the arm carries in addition to its own links.
        gravity
            (3,) acceleration of free fall in m/s^2, in the root link.

        Raises
        ------
        InputError
            If the description states no mass of the links behind a joint, or a payload is fixed to a link that the arm
            does not move.
        """
        configuration = self.configuration(q, batch="torques_batch")
        rates = [self.configuration(_for_all(x, (self.dof,)), name) for name, x in (("v", v), ("a", a))]
        return inverse_dynamics(self, configuration, rates[0], rates[1], checked_payloads(payload), gravity)

    def torques_batch(
        self,
        Q: npt.ArrayLike,
        V: npt.ArrayLike = 0.0,
        A: npt.ArrayLike = 0.0,
        *,
        payload: Payload | Sequence[Payload] | None = None,
        gravity: npt.ArrayLike = GRAVITY,
    ) -> Array:
        """Compute the torques (N, n) at N configurations, by the compiled core; see :meth:`torques`.

        It equals :meth:`torques`, which uses Pinocchio, up to rounding.
        """
        q = finite("Q", Q, (None, self.dof))
        rates = [finite(name, _for_all(x, q.shape), q.shape) for name, x in (("V", V), ("A", A))]
        of_motion, of_gravity = dynamic_tree(self, checked_payloads(payload), gravity).torques(q, *rates)
        return np.asarray(of_motion + of_gravity)

    def mass_matrix(self, q: npt.ArrayLike, *, payload: Payload | Sequence[Payload] | None = None) -> Array:
        """Compute the mass matrix M (n, n) at q (n,), of which 1/2 v^T M v is the kinetic energy (J).

        The composite rigid body algorithm of Pinocchio; see :meth:`torques` for what is included and for the errors.
        """
        return mass_matrix(self, self.configuration(q), checked_payloads(payload))

    def configuration(self, q: npt.ArrayLike, name: str = "q", *, batch: str = "") -> Array:
        """Return a validated copy (n,) of a configuration; ``batch`` is the method for several, for the message.

        Raises
        ------
        InputError
            If it is not n finite numbers; the message lists the joints.
        """
        try:
            return finite(name, q, (self.dof,))
        except ValueError as error:
            many = f"; {batch} takes configurations (N, {self.dof})" if batch and np.ndim(q) == 2 else ""
            raise type(error)(f"{error}; the arm's joints are {', '.join(self.joint_names)}{many}") from None

    def with_limits(self: Group, limits: JointLimits) -> Group:
        """Return the same joints with other limits.

        Raises
        ------
        InputError
            If the number of joints differs.
        """
        check_count(limits, self.joint_names)
        other = copy(self)
        other.__dict__["limits"] = limits
        for cached in ("_home", "arms"):
            other.__dict__.pop(cached, None)
        return other

    def with_held(self: Group, held: Mapping[str, float]) -> Group:
        """Return the same joints with other values for some of the joints outside them.

        Parameters
        ----------
        held
            Values (rad or m) by name. Values for mimic joints are ignored; they follow their leaders.

        Raises
        ------
        UnknownNameError, InputError
            As :meth:`pinproof.Robot.arm`.
        """
        require_type("held", held, Mapping)
        if all(name in self.held and self.held[name] == value for name, value in held.items()):
            return self
        values = self._held_for(self._chain, {**self.held, **held})
        model = reduced_model(self.robot.urdf, self.robot._model, {*self.joint_names, *self.followers}, values)
        if self._has_joints_of(model):
            # Only links on held joints, such as those of a hand, are elsewhere.
            other: Group = object.__new__(type(self))
            changed = {"held": ReadOnlyDict(values, HELD_READ_ONLY), "_model": model, "_threads": threading.local()}
            other.__dict__.update(self.__getstate__() | changed)
            other.__dict__.pop("arms", None)
            return other
        if isinstance(self, Arm):
            return cast(Group, Arm(self.robot, self.base, self.tcp, self._chain, self.limits, values))
        return cast(Group, JointGroup(self.robot, self.ends, self._chain, self.limits, values))

    def _has_joints_of(self, model: Any) -> bool:
        """Whether the joints, bases and tcps of another reduced model of the robot are placed as in :attr:`model`."""
        own = self._model
        frames = [(own.frames[i], model.frames[i]) for i in self._end_frames]
        return list(own.jointPlacements) == list(model.jointPlacements) and all(
            one.placement == other.placement and one.parentJoint == other.parentJoint and one.name == other.name
            for one, other in frames
        )

    @cached_property
    def _end_frames(self) -> list[int]:
        """The frames in :attr:`model` of the bases and tcps."""
        return [self._frame_id(name) for ends in self.ends.values() for name in ends]

    @cached_property
    def joints_key(self) -> tuple[object, ...]:
        """What the joints of :attr:`model` depend on; groups that differ in held joints without influence share it."""
        model = self._model
        places = b"".join([model.jointPlacements[k].homogeneous.tobytes() for k in range(1, model.njoints)])
        return tuple(model.names), places, self.scale.tobytes(), self.offset.tobytes()

    def place_of_frame(self, number: int) -> tuple[int, pin.SE3]:
        """Return the joint of :attr:`model` that moves a frame, and the placement of the frame on it."""
        frame = self._model.frames[number]
        return int(frame.parentJoint), frame.placement

    def model_configuration(self, q: Array) -> Array:
        """Return the configuration of :attr:`model` (mimic joints included) for q (n,), without validating q."""
        return np.asarray(self.scale @ q + self.offset)

    def _view(self) -> View:
        arms = ", ".join(f"{name}: {base} -> {tcp}" for name, (base, tcp) in self.ends.items())
        ends = " and ".join(f"{base} -> {tcp}" for base, tcp in self.ends.values())
        columns = ("joint", "lower", "upper", "velocity", "acceleration", "home")
        limits = self.limits
        rows = zip(
            self.joint_names, limits.lower, limits.upper, limits.velocity, limits.acceleration, self.home, strict=True
        )
        held = (f"{name} is held at {value:g}" for name, value in self.held.items())
        joints = f"{self.dof} joints: {', '.join(self.joint_names)}"
        title = f"{self._kind} of {self.robot.name}, {ends} (rad or m)"
        return View(f"{self.robot.name!r}, {arms}, {joints}", [Rows(columns, rows), held], title=title)

    _kind = "Joint group"

    def _values(self) -> tuple[object, ...]:
        return self.robot, self.ends, self.limits, self.held

    @cached_property
    def _hash(self) -> int:  # of what differs between the arms of a robot, so that they are seldom compared
        limits = self.limits
        return hash((self.joint_names, limits.lower.tobytes(), limits.upper.tobytes(), frozenset(self.held.items())))

    def __hash__(self) -> int:
        return self._hash

    __eq__ = Identified.__eq__

    def __getstate__(self) -> dict[str, Any]:
        left_out = ("_threads", "_hash", "_digest")  # the hashes are not those of a changed copy, or of another process
        return {name: value for name, value in self.__dict__.items() if name not in left_out}

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        self._threads = threading.local()

    def _root_from(self, q: Array, frame_id: int) -> pin.SE3:
        data = self._data()
        pin.forwardKinematics(self._model, data, self.scale @ q + self.offset)
        return pin.updateFramePlacement(self._model, data, frame_id).copy()  # it is a view of data

    def _data(self) -> Any:
        """Return the ``pinocchio.Data`` of this thread; sharing one between threads gives wrong results."""
        data = getattr(self._threads, "data", None)
        if data is None:
            data = self._threads.data = self._model.createData()
        return data

    def _frame_id(self, name: str) -> int:
        """Return the index of a frame; for an unknown name Pinocchio returns the number of frames without an error."""
        if not self._model.existFrame(name, pin.FrameType.BODY):
            raise UnknownNameError("frame", name, self.robot.urdf.links, f"robot {self.robot.name!r}")
        return int(self._model.getFrameId(name, pin.FrameType.BODY))


class Arm(JointGroup):
    """The chain of joints between a base link and a tcp frame; created by :meth:`pinproof.Robot.arm`.

    It is a :class:`JointGroup` with one arm, named by its tcp. A configuration ``q`` is (n,) in the order of
    ``joint_names``, in rad or m; a continuous joint is one unwrapped angle. Poses of the tcp are in the frame of
    the base link. All methods are thread-safe.

    An arm is read-only, so that a certificate of it stays valid; :meth:`with_limits`, :meth:`with_held` and
    :meth:`pinproof.Robot.arm` return other arms.

    Attributes
    ----------
    base, tcp
        Names of the base link and the tcp frame.
    root_from_base
        Pose of the base link in the root link.
    chain
        The joints from base to tcp for the compiled core.
    """

    def __init__(
        self, robot: Robot, base: str, tcp: str, chain: Chain, limits: JointLimits, held: Mapping[str, float]
    ) -> None:
        self.base, self.tcp = base, tcp
        super().__init__(robot, {tcp: (base, tcp)}, chain, limits, held)
        self._tcp_id = self._frame_id(tcp)
        self.root_from_base: pin.SE3 = self._root_from_base[tcp]
        self.chain = self.tcp_chain()

    @property
    def arms(self) -> Mapping[str, Arm]:
        """The arm itself, by its tcp."""
        return {self.tcp: self}

    @property
    def tcp_id(self) -> int:
        """The index of the tcp frame in :attr:`model`."""
        return self._tcp_id

    def forward_kinematics(self, q: npt.ArrayLike) -> pin.SE3:
        """Compute ``base_from_tcp`` at the configuration q (n,)."""
        return self._placement(self.configuration(q, batch="forward_kinematics_batch"), self._tcp_id)

    def forward_kinematics_batch(self, Q: npt.ArrayLike) -> Array:
        """Compute ``base_from_tcp`` (N, 4, 4) at the configurations Q (N, n), by the compiled core.

        It equals :meth:`forward_kinematics`, which uses Pinocchio, up to rounding.
        """
        return np.asarray(self.chain.forward_batch(finite("Q", Q, (None, self.dof))))

    def frame_placement(self, q: npt.ArrayLike, frame: str) -> pin.SE3:
        """Compute ``base_from_frame`` for any link of the robot at the configuration q (n,)."""
        return self._placement(self.configuration(q), self._frame_id(frame))

    def jacobian(self, q: npt.ArrayLike, *, reference: Reference = "LOCAL_WORLD_ALIGNED") -> Array:
        """Compute the (6, n) Jacobian of the tcp, joint velocities to twist, linear (m/s) then angular (rad/s).

        Parameters
        ----------
        q
            (n,) configuration.
        reference
            ``LOCAL_WORLD_ALIGNED``: velocity of the tcp point, in the axes of the base. ``LOCAL``: the same in the axes
            of the tcp. ``WORLD``: the spatial twist at the origin of the base, in the axes of the base.
        """
        if reference not in REFERENCES:
            raise UnknownNameError("reference", reference, REFERENCES)
        base_from_tcp, local = self.local_jacobian(self.configuration(q))
        if reference == "LOCAL":
            return local
        if reference == "WORLD":
            return np.asarray(base_from_tcp.toActionMatrix() @ local)
        rotation = base_from_tcp.rotation
        return np.vstack([rotation @ local[:3], rotation @ local[3:]])

    def jacobian_batch(self, Q: npt.ArrayLike) -> Array:
        """Compute the Jacobians (N, 6, n) of the tcp at the configurations Q (N, n), by the compiled core.

        They equal :meth:`jacobian` with the reference ``LOCAL_WORLD_ALIGNED``, which uses Pinocchio, up to rounding.
        """
        return np.asarray(self.chain.jacobian_batch(finite("Q", Q, (None, self.dof))))

    def manipulability(self, q: npt.ArrayLike) -> float:
        """Compute the manipulability sqrt(det(J J^T)) at q (n,); of J^T J with fewer than six joints.

        Source: T. Yoshikawa (1985), "Manipulability of robotic mechanisms", equation 4.
        """
        return float(self.manipulability_batch(self.configuration(q, batch="manipulability_batch")[None])[0])

    def manipulability_batch(self, Q: npt.ArrayLike) -> Array:
        """Compute :meth:`manipulability` (N,) at the configurations Q (N, n)."""
        return np.asarray(self.chain.manipulability_batch(finite("Q", Q, (None, self.dof))))

    def local_jacobian(self, q: Array) -> tuple[pin.SE3, Array]:
        """Compute ``base_from_tcp`` and its (6, n) Jacobian in the axes of the tcp without validating q."""
        data = self._data()
        pin.computeJointJacobians(self._model, data, self.scale @ q + self.offset)
        placement = pin.updateFramePlacement(self._model, data, self._tcp_id)
        local = pin.getFrameJacobian(self._model, data, self._tcp_id, pin.ReferenceFrame.LOCAL)
        # For a model with one joint Pinocchio returns (6,), not (6, 1).
        return self.root_from_base.actInv(placement), local.reshape(6, -1) @ self.scale

    def singularity(self, q: npt.ArrayLike) -> Singularity:
        """Compute the singular values of the tcp Jacobian at q (n,) and the direction of the smallest one."""
        u, values, _ = np.linalg.svd(self.jacobian(q))
        return Singularity(float(values[-1]), u[:, len(values) - 1].copy(), values)

    def __repr__(self) -> str:
        return f"Arm({self.robot.name!r}, {self.base} -> {self.tcp}, {self.dof} joints: {', '.join(self.joint_names)})"

    _kind = "Arm"

    def _placement(self, q: Array, frame_id: int) -> pin.SE3:
        data = self._data()
        pin.forwardKinematics(self._model, data, self.scale @ q + self.offset)
        # updateFramePlacement returns a view of data; the product below is a new transform.
        return self.root_from_base.actInv(pin.updateFramePlacement(self._model, data, frame_id))


def _for_all(value: npt.ArrayLike, shape: tuple[int, ...]) -> npt.ArrayLike:
    """One number for all entries, or the value itself."""
    return np.broadcast_to(value, shape) if isinstance(value, int | float) else value


@described(eq=False)
class Robot(Identified):
    """A robot: its description and its kinematic model; created by :func:`pinproof.load_robot`."""

    urdf: Urdf = key("links and joints")
    srdf: Srdf = key("groups, states and pairs of links that need no check")
    default_tcp: str | None = key("default tcp of :meth:`arm`", default=None)
    home: Mapping[str, float] = key("home configuration, joint name to rad or m; may be empty", default_factory=dict)
    default_base: str | None = key("default base of :meth:`arm` if the tcp is a descendant of it", default=None)
    declared_arms: Mapping[str, str] = key(
        "the tcp frames of the arms of :meth:`arms` by name; empty for a robot with one arm", default_factory=dict
    )
    parts: Mapping[str, Robot] = key(
        "the robots of a cell by name, if this robot is one that :func:`pinproof.assemble` made. Their links and "
        "joints have the names of the robots as prefixes: ``left/wrist_1_link``",
        default_factory=dict,
    )
    movers: Mapping[str, str] = key(
        "the links that carry moving obstacles by the name of the mover; see :class:`pinproof.Mover`",
        default_factory=dict,
    )
    nominal: Robot | None = key("the robot before its calibration; None for a robot without one", default=None)
    calibration: Calibration | None = key("the numbers of its calibration", default=None)
    remarks: tuple[str, ...] = key("sentences on how it was loaded, which are among the :attr:`notes`", default=())
    _model: Any = field(init=False, repr=False, compare=False)

    def __hash__(self) -> int:
        return hash(self.urdf.text)

    __eq__ = Identified.__eq__

    def __post_init__(self) -> None:
        where = self.urdf.path or self.urdf.name
        try:
            model = pin.buildModelFromXML(self.urdf.kinematics)
        except (ValueError, RuntimeError) as error:
            raise UrdfError(where, f"Pinocchio refuses it: {error}") from error
        # Pinocchio drops links without an error, for example below a joint that it does not know
        missing = [name for name in self.urdf.links if not model.existFrame(name, pin.FrameType.BODY)]
        if missing:
            raise UrdfError(where, f"Pinocchio dropped the links {missing}")
        object.__setattr__(self, "_model", model)
        object.__setattr__(self, "home", ReadOnlyDict(self.home, HOME_READ_ONLY))
        for name in ("declared_arms", "parts", "movers"):
            object.__setattr__(self, name, ReadOnlyDict(getattr(self, name), ENDS_READ_ONLY))

    @property
    def model(self) -> Any:
        """A copy of the :class:`pinocchio.Model` of all joints; changing it does not change the robot.

        Continuous joints are one angle; mimic joints are independent here and coupled to their leaders by :class:`Arm`.
        """
        return self._model.copy()

    def _view(self) -> View:
        rows = ((joint.name, joint.type, joint.parent, joint.child) for joint in self._moving)
        table = Rows(("joint", "type", "parent", "child"), rows)
        lines = (f"joints: {', '.join(joint.name for joint in self._moving)}", *self.notes)
        title = f"Robot {self.name}, {self._headline}"
        return View(f"{self.name!r}, {self._headline}", [table, self.notes], lines, title=title)

    @property
    def _moving(self) -> list[UrdfJoint]:
        return [joint for joint in self.urdf.joints.values() if joint.type != "fixed"]

    @property
    def _headline(self) -> str:
        tcp = "" if self.default_tcp is None else f", tcp {self.default_tcp}"
        return f"{len(self.urdf.links)} links, {len(self._moving)} moving joints{tcp}"

    @cached_property
    def size(self) -> float:
        """Largest distance (m) from the root to a link along the links, without the travel of prismatic joints.

        For a cell of several robots, that of the largest of them.
        """
        if self.parts:
            return max(robot.size for robot in self.parts.values())
        # reach[j]: length of the links up to joint j
        model = self._model
        reach = np.zeros(model.njoints)
        for joint in range(1, model.njoints):
            step = np.linalg.norm(model.jointPlacements[joint].translation)
            reach[joint] = reach[model.parents[joint]] + step
        own = [frame for frame in model.frames if frame.name not in self.movers.values()]
        return float(max(reach[f.parentJoint] + np.linalg.norm(f.placement.translation) for f in own))

    @property
    def calibrations(self) -> dict[str, Calibration]:
        """The calibrations by the name of the robot, or of each robot of a cell; without the nominal robots."""
        robots = self.parts or {self.name: self}
        return {name: own.calibration for name, own in robots.items() if own.calibration is not None}

    @property
    def has_generated_bodies(self) -> bool:
        """Whether collision bodies of links were generated from a DH table, in a cell those of any robot."""
        robots = self.parts.values() or (self,)
        return any(has_generated_bodies(robot.urdf) for robot in robots)

    def part_of(self, link: str) -> str | None:
        """Return the name of the robot of a cell, or the mover, that a link belongs to; None in any other robot."""
        if not self.parts and not self.movers:
            return None
        if link in self.movers.values():
            return link
        name = link.partition(PART)[0]
        return name if name in self.parts else None

    def size_around(self, link: str) -> float:
        """Return :attr:`size`, in a cell that of the robot that a link belongs to."""
        part = self.part_of(link)
        return self.size if part is None or part not in self.parts else self.parts[part].size

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about the description: its calibration, meshes not found, unknown names in the SRDF."""
        return (*self.remarks, *notes(self.urdf, self.srdf))

    @property
    def name(self) -> str:
        """Name of the robot in the URDF."""
        return self.urdf.name

    def save_urdf(self, path: str | Path) -> None:
        """Write the URDF atomically; for a xacro file the expanded one, for a DH table or MJCF the generated one.

        URIs of meshes that could not be found from the new file are replaced by the absolute paths of the meshes.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        write_text_whole(path, self.urdf.text_for(Path(path)))

    def info(self, arm: Arm | None = None) -> RobotInfo:
        """Return the properties of the robot and of one of its arms (default: :meth:`arm` without arguments).

        Raises
        ------
        InputError
            If no arm is given and the robot declares no tcp.
        """
        arm = self.arm() if arm is None else arm
        urdf, srdf = self.urdf, self.srdf
        return RobotInfo(
            name=self.name,
            source="" if urdf.path is None else str(urdf.path),
            base=arm.base,
            tcp=arm.tcp,
            dof=arm.dof,
            kinematic_class=kinematic_class(arm),
            joints=tuple(_joint(arm, name) for name in urdf.joints),
            frames=urdf.links,
            collisions=dict(Counter(geometry.kind for geometry in urdf.collisions)),
            visuals=dict(Counter(geometry.kind for geometry in urdf.visuals)),
            groups=tuple(srdf.groups),
            states=tuple(dict.fromkeys(state.name for state in srdf.states)),
            end_effectors=tuple(effector.name for effector in srdf.end_effectors),
            disabled_pairs=tuple((*pair.links, pair.reason) for pair in srdf.disabled),
            home=dict(zip(arm.joint_names, map(float, arm.home), strict=True)),
            acceleration_source=arm.limits.acceleration_source,
            missing=_missing(self, arm),
            calibration=_calibration_effect(self, arm),
        )

    def arm(
        self,
        tcp: str | None = None,
        *,
        base: str | None = None,
        group: str | None = None,
        limits: LimitsLike = None,
        held: Mapping[str, float] | None = None,
    ) -> Arm:
        """Select the chain from a base link to a tcp frame.

        Parameters
        ----------
        tcp
            A link of the robot. Default: the tcp of the group, of the catalogue or of the SRDF, or the only leaf of the
            kinematic tree if its parent joint is fixed.
        base
            A link on the path from the root to the tcp; poses of the tcp are relative to it. Default: the base of the
            group, else of the catalogue (if the tcp is a descendant of it), else the root.
        group
            A group of the SRDF, which defines base and tcp.
        limits
            New limits of all joints, those of a file (:meth:`JointLimits.load`), or new (lower, upper) by joint name,
            to tighten or extend those of the URDF.
        held
            Values (rad or m) of joints outside the arm; by default those of :attr:`home`, else 0 or the limit closest
            to 0. Floating and planar joints are at their neutral configuration.

        Raises
        ------
        UnknownNameError
            If a frame, group or joint does not exist.
        InputError
            If no tcp is declared and several are possible, or a joint of the chain has no limits.
        """
        if group is not None:
            group_base, group_tcp = group_ends(self.urdf, self.srdf, group)
            base, tcp = base or group_base, tcp or group_tcp
        tcp = known_frame(self.urdf, tcp or self.default_tcp or declared_tcp(self.urdf, self.srdf))
        base = known_frame(self.urdf, base or base_of(self.urdf, self.default_base, tcp))
        return Arm(self, base, tcp, *self._selected((base, tcp), limits=limits, held=held))

    def _selected(
        self, *ends: tuple[str, str], limits: LimitsLike, held: Mapping[str, float] | None
    ) -> tuple[Chain, JointLimits, dict[str, float]]:
        """The joints between ends, their limits, and the values of the other joints."""
        chain = find_chain(self.urdf, *ends)
        own = chosen_limits(self.urdf, chain, limits)
        return chain, own, held_values(self.urdf, chain, held or {}, self.home)

    def arms(
        self,
        *names: str | Mapping[str, str],
        base: str | None = None,
        limits: LimitsLike = None,
        held: Mapping[str, float] | None = None,
    ) -> JointGroup:
        """Select several arms as one joint group, to plan and certify their motions together.

        Parameters
        ----------
        names
            The arms: each the name of an arm that the catalogue declares (such as ``"left"``), a tcp frame, or a group
            of the SRDF. Or one mapping of names that you choose to these. Default: all arms that the catalogue
            declares.
        base
            A link above all arms. The joints between it and the links where the arms part, such as a torso or a linear
            axis, belong to the group and move all arms. Default: for each arm that of :meth:`arm`; the arms may not
            share a joint then.
        limits, held
            As for :meth:`arm`.

        Raises
        ------
        UnknownNameError
            If an arm, frame or joint does not exist.
        InputError
            If no arm is named and none is declared, two are the same, they share a joint and ``base`` is not given, or
            a joint has no limits.
        """
        # what each arm was given by, by the name of the arm
        if not names and not self.declared_arms:
            raise InputError(f"robot {self.name!r} declares no arms; name them by tcp frame or SRDF group")
        named: dict[str, str] = {}
        for item in names or self.declared_arms:
            for name, arm in item.items() if isinstance(item, Mapping) else ((item, item),):
                if not isinstance(name, str) or not isinstance(arm, str):
                    raise InputError(f"an arm is named by a text, not by {arm!r}")
                if name in named:
                    raise InputError(f"the arm {name!r} is given twice")
                named[name] = arm
        # the base and the tcp of each; arms share joints only behind a common base
        ends = {name: self._ends_of_arm(arm, base) for name, arm in named.items()}
        if base is not None:
            known_frame(self.urdf, base)
        # arms with different tcps that share no joint, unless a common base states that they do
        owner: dict[str, str] = {}
        for name, (_, tcp) in ends.items():
            if twin := next((other for other in ends if other != name and ends[other][1] == tcp), None):
                raise InputError(f"the arms {twin!r} and {name!r} have the same tcp {tcp!r}")
            for joint in moving_joints(self.urdf, *ends[name]):
                if owner.setdefault(joint, name) != name and base is None:
                    raise InputError(
                        f"joint {joint!r} belongs to both arms {owner[joint]!r} and {name!r}; pass a base= below it to "
                        "leave it out, or the base= above it to move both arms with it"
                    )
        return JointGroup(self, ends, *self._selected(*ends.values(), limits=limits, held=held))

    def _ends_of_arm(self, arm: str, base: str | None) -> tuple[str, str]:
        """Return the base and the tcp of an arm of :meth:`arms`."""
        if arm in self.declared_arms:
            tcp = known_frame(self.urdf, self.declared_arms[arm])
        elif arm in self.urdf.links:
            if arm in self.srdf.groups:
                raise InputError(f"{arm!r} is both a link and a group of the SRDF; name the tcp of the arm")
            tcp = arm
        elif arm in self.srdf.groups:
            group_base, tcp = group_ends(self.urdf, self.srdf, arm)
            return base or group_base, tcp
        else:
            known = (*self.declared_arms, *self.srdf.groups, *leaves(self.urdf))
            raise UnknownNameError("arm", arm, known, f"robot {self.name!r}")
        return base or base_of(self.urdf, self.default_base, tcp), tcp

    def state(self, name: str, *, group: str | None = None) -> dict[str, float]:
        """Return a named state of the SRDF (joint name to rad or m) of one group, or combined from all groups.

        Joints that the robot does not have (listed in :attr:`notes`) and virtual joints are omitted.

        Raises
        ------
        UnknownNameError
            If the state does not exist.
        InputError
            If groups define different values for one joint, or a joint has several numbers.
        """
        # states of one name of several groups are combined
        found = [s for s in self.srdf.states if s.name == name and group in (None, s.group)]
        if not found:
            names = {s.name for s in self.srdf.states if group in (None, s.group)}
            raise UnknownNameError("state", name, names, f"the SRDF of robot {self.name!r}")
        values: dict[str, float] = {}
        for state in found:
            for joint, numbers in state.joints.items():
                if joint not in self.urdf.joints:
                    continue
                if len(numbers) != 1:
                    raise InputError(
                        f"state {name!r} gives joint {joint!r} {len(numbers)} numbers; an arm joint has one"
                    )
                if values.setdefault(joint, numbers[0]) != numbers[0]:
                    raise InputError(f"state {name!r} gives joint {joint!r} different values; name its group=")
        return values


def kinematic_class(arm: Arm) -> str:
    """Describe the joint axes, for example ``"6 revolute joints (RRRRRR): spherical wrist (joints 4, 5, 6)"``.

    The sentence states the number and the order of the revolute (R) and prismatic (P) joints, where three neighbouring
    axes intersect in one point (a spherical shoulder or wrist), and where three or more are parallel. Whether a closed
    form exists is decided by :class:`pinproof.AnalyticIk`.
    """
    q = np.random.default_rng(0).uniform(*arm.limits.sampling_range(), size=(SAMPLES, arm.dof))
    return describe_axes(
        arm.angular,
        [arm.jacobian(configuration, reference="WORLD") for configuration in q],
        coupled=any(joint.mimic is not None for joint in link_path(arm.robot.urdf, arm.base, arm.tcp)),
    )


def _joint(arm: Arm, name: str) -> JointInfo:
    joint = arm.robot.urdf.joints[name]
    ends = (joint.name, joint.type, joint.parent, joint.child)
    mimic = "" if joint.mimic is None else f"{joint.mimic.multiplier:g} * {joint.mimic.leader} + {joint.mimic.offset:g}"
    if name in arm.joint_names:
        i = arm.joint_names.index(name)
        # limits in use, which may differ from those of the file
        limits = arm.limits
        return JointInfo(
            *ends,
            role="arm",
            lower=_known(limits.lower[i]),
            upper=_known(limits.upper[i]),
            velocity=_known(limits.velocity[i]),
            acceleration=_known(limits.acceleration[i]),
            mimic=mimic,
            effort=None if limits.torque is None else _known(limits.torque[i]),
        )
    role: Role = "follower" if name in arm.followers else "fixed" if joint.type == "fixed" else "held"
    held_at = arm.held.get(name) if role == "held" else None
    return JointInfo(*ends, role, joint.lower, joint.upper, joint.velocity, None, held_at, mimic, joint.effort)


def _missing(robot: Robot, arm: Arm) -> tuple[str, ...]:
    notes = []
    if robot.srdf.path is None and not robot.srdf.disabled:
        notes.append("no SRDF: no groups, no named states, and only neighbouring links may touch")
    if not robot.urdf.collisions:
        what = f"; {VISUALS_CAN_BE_CHECKED}" if robot.urdf.visuals else ""
        notes.append(f"no collision geometry: contact of its links is not detected{what}")
    elif robot.has_generated_bodies:
        notes.append(GENERATED_BODIES)
    if robot.urdf.collisions and robot.urdf.visual_only:
        notes.append(
            f"no collision geometry, only visual: {', '.join(robot.urdf.visual_only)}; {VISUALS_CAN_BE_CHECKED}"
        )
    # limits that are unknown
    slow = [name for name, v in zip(arm.joint_names, arm.limits.velocity, strict=True) if np.isnan(v)]
    if slow:
        notes.append(f"no velocity limit: {', '.join(slow)}")
    if arm.limits.acceleration_source.startswith("default"):
        notes.append(f"no acceleration limits; {arm.limits.acceleration_source}")
    endless = [n for n, low in zip(arm.joint_names, arm.limits.lower, strict=True) if np.isinf(low)]
    if endless:
        notes.append(f"no position limits (continuous): {', '.join(endless)}")
    if not robot.home:
        notes.append("no home: the middle of the limits is used")
    own = robot.notes if robot.nominal is None else robot.nominal.notes  # the calibration is reported by itself
    return (*notes, *own)


def _calibration_effect(robot: Robot, arm: Arm) -> CalibrationEffect | None:
    """What the calibration of a robot changes at the tcp of an arm; None without one."""
    if robot.nominal is None:
        return None
    nominal = robot.nominal.arm(arm.tcp, base=arm.base).with_held(arm.held)
    q = np.random.default_rng(0).uniform(*arm.limits.sampling_range(), size=(EFFECT_SAMPLES, arm.dof))
    before, after = nominal.forward_kinematics_batch(q), arm.forward_kinematics_batch(q)
    shifts = np.linalg.norm(after[:, :3, 3] - before[:, :3, 3], axis=1)
    # |R1 - R2| = 2 sqrt(2) sin(angle / 2)
    sines = np.linalg.norm(after[:, :3, :3] - before[:, :3, :3], axis=(1, 2)) / math.sqrt(8.0)
    angles = 2.0 * np.arcsin(np.minimum(sines, 1.0))
    return CalibrationEffect(
        source=robot.remarks[-1],
        mean_shift=float(shifts.mean()),
        largest_shift=float(shifts.max()),
        mean_rotation=float(angles.mean()),
        largest_rotation=float(angles.max()),
        configurations=len(q),
    )


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
