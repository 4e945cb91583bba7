"""An arm's chain as one array, for compiled loops.

Every joint is turned so that it moves about, or along, its own z: with a rotation A_k that takes z to the axis of joint
k, the chain base_from_tcp = C_1 X_1(q) C_2 X_2(q) ... C_m X_m(q) C_tool has X_k = Rz or Tz and constant C_k, into which
the A_k went. See :mod:`pinproof.kernels.chain` for the layout.

An arm: the chain from a base link to a tcp frame, with its kinematics from Pinocchio.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NoReturn

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.errors import InputError, UnknownNameError
from pinproof.model.chain import Chain, affine, periodic
from pinproof.model.limits import JointLimits
from pinproof.spatial import finite, frozen

if TYPE_CHECKING:
    from pinproof.description import UrdfJoint
    from pinproof.model.robot import Robot

__all__ = ["Arm", "Reference", "Singularity", "joint_axis", "pack_chain"]

Array = npt.NDArray[np.float64]


def pack_chain(arm: Arm) -> Array:
    """The (m + 1, 16) array of the m joints between base and tcp, followers included, and of the tool."""
    model = arm.model
    tcp = model.frames[model.getFrameId(arm.tcp, pin.FrameType.BODY)]
    joints = [joint for joint in model.supports[tcp.parentJoint] if joint != 0]
    rows = np.zeros((len(joints) + 1, 16))
    behind = arm.root_from_base.inverse()  # what stands before the next joint
    for row, joint in zip(rows, joints, strict=False):
        axis, slides = joint_axis(model, joint)
        aligned = _from_z(axis)
        row[:12] = (behind * model.jointPlacements[joint] * aligned).homogeneous[:3].ravel()
        leader = int(np.abs(arm.scale[joint - 1]).argmax())
        row[12:] = slides, leader, arm.scale[joint - 1, leader], arm.offset[joint - 1]
        behind = aligned.inverse()
    rows[-1, :12] = (behind * tcp.placement).homogeneous[:3].ravel()
    return rows


def joint_axis(model: pin.Model, joint: int) -> tuple[Array, bool]:
    """The unit axis (3,) of a joint in its own frame, and whether it slides."""
    kind = model.joints[joint]
    data = kind.createData()
    kind.calc(data, np.zeros(kind.nq))
    subspace = np.asarray(data.S, dtype=float).ravel()
    if kind.nq != 1 or subspace.shape != (6,):
        raise InputError(f"joint {model.names[joint]!r} is a {kind.shortname()}: a chain is made of single axes")
    slides = not subspace[3:].any()
    return (subspace[:3] if slides else subspace[3:]), slides


def _from_z(axis: Array) -> pin.SE3:
    """A rotation that takes z to the unit vector ``axis``; exact for an axis of the frame."""
    helper = np.zeros(3)
    helper[int(np.abs(axis).argmin())] = 1.0
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return pin.SE3(np.column_stack([x, np.cross(axis, x), axis]), np.zeros(3))


Reference = Literal["LOCAL_WORLD_ALIGNED", "LOCAL", "WORLD"]
REFERENCES: tuple[Reference, ...] = ("LOCAL_WORLD_ALIGNED", "LOCAL", "WORLD")


@dataclass(frozen=True, eq=False)
class Singularity:
    """How near a configuration is to losing a direction of motion.

    Parameters
    ----------
    smallest
        The smallest singular value of the tcp Jacobian (LOCAL_WORLD_ALIGNED; metres and radians mixed).
    direction
        (6,) the unit twist, linear then angular, that is hardest to make: lost altogether where ``smallest`` is 0.
    singular_values
        (min(6, n),) all of them, largest first.
    """

    smallest: float
    direction: Array
    singular_values: Array


class _Held(dict[str, float]):
    """The values of the joints outside an arm, which cannot be changed in place: the model was built with them."""

    def _refuse(self, *_args: object, **_named: object) -> NoReturn:
        raise TypeError(
            "the held joints of an arm are read-only; arm.with_held({name: value}) makes an arm with others"
        )

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return _Held, (dict(self),)


class Arm:
    """The joints between a base link and a tcp frame; made by :meth:`pinproof.Robot.arm`.

    A configuration ``q`` is (n,) in the order of :attr:`joint_names`, in rad or m; a continuous joint is one unwrapped
    angle. Poses of the tcp are given in the base link's frame. All methods may be called from several threads.

    Attributes
    ----------
    robot
        The robot it is an arm of.
    base, tcp
        Names of the base link and the tcp frame.
    joint_names
        The names of its n joints, from the base outwards.
    limits
        Of its joints, in their order.
    held
        Values (rad or m) of the robot's other joints by name; :meth:`with_held` makes an arm with other values.
    angular
        (n,) True where a joint turns, False where it slides.
    periodic
        (n,) True where q and q + 2 pi are the same pose of every link (an angular joint whose follower turns half as
        far is not).
    root_from_base
        Where the base is in the robot's root link.
    """

    def __init__(
        self, robot: Robot, base: str, tcp: str, chain: Chain, limits: JointLimits, held: Mapping[str, float]
    ) -> None:
        self.robot, self.base, self.tcp = robot, base, tcp
        self.limits, self.held = limits, _Held(held)
        self.joint_names, self.angular = chain.joint_names, chain.angular
        self.followers = chain.followers
        self.model = _reduced(robot, {*chain.joint_names, *chain.followers}, held)
        self.scale, self.offset = affine(robot.urdf, chain, tuple(self.model.names)[1:])
        for array in (self.scale, self.offset):
            array.setflags(write=False)
        self.periodic = periodic(robot.urdf, chain)
        self._tcp_id = self._frame_id(tcp)
        self._threads = threading.local()
        base_frame = self.model.frames[self._frame_id(base)]
        if base_frame.parentJoint != 0:
            raise InputError(
                f"the base {base!r} is moved by the arm's own joints, through a mimic joint; choose another"
            )
        self.root_from_base: pin.SE3 = frozen(base_frame.placement)
        self.packed: Array = pack_chain(self)

    @property
    def dof(self) -> int:
        """The number n of joints in q."""
        return len(self.joint_names)

    @property
    def home(self) -> Array:
        """(n,) the robot's home where it has one, else the middle of the limits (0 for a continuous joint)."""
        lower, upper = self.limits.sampling_range()
        middle = dict(zip(self.joint_names, (lower + upper) / 2, strict=True))
        return self.limits.clip(np.array([self.robot.home.get(name, middle[name]) for name in self.joint_names]))

    def state(self, name: str, *, group: str | None = None) -> Array:
        """(n,) a named state of the robot's SRDF (:meth:`pinproof.Robot.state`), in the order of :attr:`joint_names`.

        Raises
        ------
        UnknownNameError
            If there is no such state.
        InputError
            If the state leaves one of the arm's joints open.
        """
        values = self.robot.state(name, group=group)
        missing = [joint for joint in self.joint_names if joint not in values]
        if missing:
            raise InputError(f"state {name!r} says nothing about the joints {', '.join(missing)} of the arm")
        return np.array([values[joint] for joint in self.joint_names])

    def forward_kinematics(self, q: npt.ArrayLike) -> pin.SE3:
        """``base_from_tcp`` at the configuration q (n,)."""
        return self._placement(self.configuration(q), self._tcp_id)

    def forward_kinematics_batch(self, Q: npt.ArrayLike) -> Array:
        """``base_from_tcp`` (N, 4, 4) at the configurations Q (N, n)."""
        many = finite("Q", Q, (None, self.dof))
        out = np.empty((len(many), 4, 4))
        for row, q in enumerate(many):
            out[row] = self._placement(q, self._tcp_id).homogeneous
        return out

    def frame_placement(self, q: npt.ArrayLike, frame: str) -> pin.SE3:
        """``base_from_frame`` of any link of the robot at the configuration q (n,)."""
        return self._placement(self.configuration(q), self._frame_id(frame))

    def jacobian(self, q: npt.ArrayLike, *, reference: Reference = "LOCAL_WORLD_ALIGNED") -> Array:
        """The (6, n) Jacobian of the tcp: joint rates to twist, linear (m/s) then angular (rad/s).

        Parameters
        ----------
        q
            (n,) configuration.
        reference
            ``LOCAL_WORLD_ALIGNED``: velocity of the tcp point, in the axes of the base. ``LOCAL``: the same in the axes
            of the tcp. ``WORLD``: the spatial twist at the base's origin, in the axes of the base.
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

    def local_jacobian(self, q: Array) -> tuple[pin.SE3, Array]:
        """``base_from_tcp`` and its (6, n) Jacobian in the tcp's axes, unchecked: for loops that made q themselves."""
        data = self._data()
        pin.computeJointJacobians(self.model, data, self.scale @ q + self.offset)
        placement = pin.updateFramePlacement(self.model, data, self._tcp_id)
        local = pin.getFrameJacobian(self.model, data, self._tcp_id, pin.ReferenceFrame.LOCAL)
        # A model of one joint comes back from C++ as (6,), not (6, 1).
        return self.root_from_base.actInv(placement), local.reshape(6, -1) @ self.scale

    def singularity(self, q: npt.ArrayLike) -> Singularity:
        """The smallest singular value of the tcp Jacobian at q (n,) and the direction that is lost there."""
        u, values, _ = np.linalg.svd(self.jacobian(q))
        return Singularity(float(values[-1]), u[:, len(values) - 1].copy(), values)

    def configuration(self, q: npt.ArrayLike, name: str = "q") -> Array:
        """A checked copy (n,) of a configuration.

        Raises
        ------
        InputError
            If it is not n finite numbers; names the joints.
        """
        try:
            return finite(name, q, (self.dof,))
        except ValueError as error:
            raise type(error)(f"{error}; the arm's joints are {', '.join(self.joint_names)}") from None

    def with_limits(self, limits: JointLimits) -> Arm:
        """The same arm under other limits.

        Raises
        ------
        InputError
            If they hold another number of joints.
        """
        if len(limits) != self.dof:
            raise InputError(f"limits hold {len(limits)} joints; the arm has {self.dof}: {', '.join(self.joint_names)}")
        other = copy(self)
        other.limits = limits
        return other

    def with_held(self, held: Mapping[str, float]) -> Arm:
        """The same arm with some of the joints outside it held elsewhere; the others stay.

        Parameters
        ----------
        held
            Values (rad or m) by name. Followers go with the joint they follow, whatever is told of them.

        Raises
        ------
        UnknownNameError, InputError
            As :meth:`pinproof.Robot.arm`.
        """
        if all(self.held.get(name) == value for name, value in held.items()):
            return self
        joints = self.robot.urdf.joints
        told = {name: value for name, value in {**self.held, **held}.items() if not _follows(joints, name)}
        return self.robot.arm(self.tcp, base=self.base, limits=self.limits, held=told)

    def model_configuration(self, q: Array) -> Array:
        """The configuration of :attr:`model` (followers included) that belongs to q (n,), unchecked."""
        return np.asarray(self.scale @ q + self.offset)

    def __repr__(self) -> str:
        return f"Arm({self.robot.name!r}, {self.base} -> {self.tcp}, {self.dof} joints: {', '.join(self.joint_names)})"

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_threads"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        for array in (self.scale, self.offset):
            array.setflags(write=False)  # pickle forgets it
        self._threads = threading.local()

    def _placement(self, q: Array, frame_id: int) -> pin.SE3:
        data = self._data()
        pin.forwardKinematics(self.model, data, self.scale @ q + self.offset)
        # updateFramePlacement hands out a live view of data; the product below is a fresh transform.
        return self.root_from_base.actInv(pin.updateFramePlacement(self.model, data, frame_id))

    def _data(self) -> Any:
        """Pinocchio's workspace; one a thread, since a shared one gives wrong answers."""
        data = getattr(self._threads, "data", None)
        if data is None:
            data = self._threads.data = self.model.createData()
        return data

    def _frame_id(self, name: str) -> int:
        """Pinocchio answers an unknown name with the number of frames instead of an error; so it is asked first."""
        if not self.model.existFrame(name, pin.FrameType.BODY):
            raise UnknownNameError("frame", name, self.robot.urdf.links, f"robot {self.robot.name!r}")
        return int(self.model.getFrameId(name, pin.FrameType.BODY))


def _follows(joints: Mapping[str, UrdfJoint], name: str) -> bool:
    return name in joints and joints[name].mimic is not None


def _reduced(robot: Robot, moving: set[str], held: Mapping[str, float]) -> Any:
    """The model with every joint outside ``moving`` locked: at its held value, or neutral if it is not one number."""
    model = robot.model
    q = pin.neutral(model)
    lock = []
    for name in robot.urdf.joints:
        index = model.getJointId(robot.urdf.model_joint(name))
        if index == model.njoints or name in moving:  # fixed joints are none in the model
            continue
        lock.append(index)
        if name in held:
            q[model.joints[index].idx_q] = held[name]
    return pin.buildReducedModel(model, lock, q)
