"""Robots and arms: loading a description, selecting the chain from a base to a tcp, FK and Jacobians by Pinocchio.

:class:`Robot` and :class:`Arm` refer to each other, so they are in one module.
"""

from __future__ import annotations

import math
import re
import threading
from collections import Counter
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from dataclasses import replace as replace_fields
from pathlib import Path
from typing import Any, Literal, NoReturn

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.description import (
    CatalogueEntry,
    Srdf,
    Urdf,
    UrdfJoint,
    find_robot,
    read_description,
    read_srdf,
    read_urdf_text,
)
from pinproof.description.sources import notes
from pinproof.description.srdf import DisabledPair
from pinproof.errors import FileError, InputError, UnknownNameError, UrdfError
from pinproof.model.chain import (
    Chain,
    affine,
    find_chain,
    group_ends,
    held_values,
    link_path,
    pack_chain,
    periodic,
    reduced_model,
)
from pinproof.model.info import SAMPLES, JointInfo, RobotInfo, Role, describe_axes
from pinproof.model.limits import JointLimits, LimitsFile
from pinproof.spatial import finite, frozen

__all__ = [
    "Arm",
    "Reference",
    "Robot",
    "Singularity",
    "kinematic_class",
    "load_robot",
    "load_robot_from_text",
]

Array = npt.NDArray[np.float64]

Reference = Literal["LOCAL_WORLD_ALIGNED", "LOCAL", "WORLD"]
REFERENCES: tuple[Reference, ...] = ("LOCAL_WORLD_ALIGNED", "LOCAL", "WORLD")


DH_FRAME = re.compile(r"dh_\d+")
SUFFIXES = (".urdf", ".xacro", ".xml", ".mjcf")


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
        self.model = reduced_model(robot.urdf, robot.model, {*chain.joint_names, *chain.followers}, held)
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
        self.packed: Array = pack_chain(self.model, self._tcp_id, self.root_from_base, self.scale, self.offset)

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


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot as described, with its kinematic model.

    Parameters
    ----------
    urdf, srdf
        The description.
    model
        The :class:`pinocchio.Model` of all its joints: continuous joints are one angle, mimic followers free (an
        :class:`Arm` ties them to their leaders).
    default_tcp
        The frame meant when :meth:`arm` names none.
    home
        A comfortable configuration, joint name to rad or m; may be empty.
    default_base
        The link meant as base when :meth:`arm` names none and the tcp hangs on it.
    """

    urdf: Urdf
    srdf: Srdf
    model: Any
    default_tcp: str | None = None
    home: Mapping[str, float] = field(default_factory=dict)
    default_base: str | None = None

    @property
    def size(self) -> float:
        """Metres: the largest length of a line of joints and links from the root to a link.

        How far the robot reaches when it is stretched, without the travel of joints that slide.
        """
        model = self.model
        reach = np.zeros(model.njoints)
        for joint in range(1, model.njoints):
            step = np.linalg.norm(model.jointPlacements[joint].translation)
            reach[joint] = reach[model.parents[joint]] + step
        return float(max(reach[f.parentJoint] + np.linalg.norm(f.placement.translation) for f in model.frames))

    @property
    def notes(self) -> tuple[str, ...]:
        """What is odd about the description, in sentences: meshes not found, names in the SRDF that do not exist."""
        return notes(self.urdf, self.srdf)

    @property
    def name(self) -> str:
        """The robot's name in its URDF."""
        return self.urdf.name

    def info(self, arm: Arm | None = None) -> RobotInfo:
        """The properties of the robot and of one of its arms, by default of :meth:`arm` without arguments.

        Raises
        ------
        InputError
            If no arm is given and the robot declares no tcp.
        """
        return _robot_info(self, self.arm() if arm is None else arm)

    def arm(
        self,
        tcp: str | None = None,
        *,
        base: str | None = None,
        group: str | None = None,
        limits: JointLimits | LimitsFile | Mapping[str, tuple[float, float]] | None = None,
        held: Mapping[str, float] | None = None,
    ) -> Arm:
        """The chain from a base link to a tcp frame.

        Parameters
        ----------
        tcp
            A link of the robot. Without it: the one the group, the catalogue or the SRDF declares, or the only leaf
            when that hangs on a fixed joint.
        base
            A link between the root and the tcp; poses of the tcp are given in it. By default the group's, else the
            catalogue's where the tcp hangs on it, else the root.
        group
            A group of the SRDF, which names base and tcp.
        limits
            New limits of all joints, those of a file (:meth:`JointLimits.load`), or new (lower, upper) by joint name,
            to tighten or extend those of the URDF.
        held
            Values (rad or m) of joints outside the arm; by default those of :attr:`home`, else 0 or the bound nearest
            to it. A floating or planar joint stands at its neutral place.

        Raises
        ------
        UnknownNameError
            For a frame, group or joint that does not exist; names those that do.
        InputError
            If no tcp is declared and more than one is possible, or a joint of the chain has no limits.
        """
        if group is not None:
            group_base, group_tcp = group_ends(self.urdf, self.srdf, group)
            base, tcp = base or group_base, tcp or group_tcp
        tcp = tcp or self._declared_tcp()
        self._known_frame(tcp)
        base = base or self._base_of(tcp)
        self._known_frame(base)
        chain = find_chain(self.urdf, base, tcp)
        if isinstance(limits, JointLimits):
            if len(limits) != len(chain.joint_names):
                raise InputError(
                    f"limits hold {len(limits)} joints; the arm has {len(chain.joint_names)}: {chain.joint_names}"
                )
            new_limits = limits
        else:
            if isinstance(limits, LimitsFile):
                new_limits = limits.over(chain.limits, chain.joint_names, list(self.urdf.joints))
                told: Mapping[str, tuple[float, float]] = limits.position
            else:
                told = limits or {}
                new_limits = chain.limits.replace(chain.joint_names, told)
            for name in chain.joint_names:
                joint = self.urdf.joints[name]
                if joint.type != "continuous" and (joint.lower is None or joint.upper is None) and name not in told:
                    raise InputError(
                        f"{joint.type} joint {name!r} states no lower and upper limit; "
                        f"pass limits={{{name!r}: (lower, upper)}}"
                    )
        return Arm(self, base, tcp, chain, new_limits, held_values(self.urdf, chain, held or {}, self.home))

    def state(self, name: str, *, group: str | None = None) -> dict[str, float]:
        """A named state of the SRDF, joint name to rad or m; of all groups that have one of that name, or of one group.

        Joints of the state that the robot does not have are left out (:attr:`notes` names them), and so is a virtual
        joint that places the robot in the world.

        Raises
        ------
        UnknownNameError
            If there is no such state; names those that exist.
        InputError
            If groups give one joint different values under this name, or a joint several numbers.
        """
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

    def _known_frame(self, name: str) -> None:
        if name not in self.urdf.links:
            raise UnknownNameError("frame", name, self.urdf.links, f"robot {self.name!r}")

    def _base_of(self, tcp: str) -> str:
        if self.default_base is not None and self.default_base != tcp:
            try:
                link_path(self.urdf, self.default_base, tcp)
            except InputError:
                return self.urdf.root
            return self.default_base
        return self.urdf.root

    def _declared_tcp(self) -> str:
        if self.default_tcp is not None:
            return self.default_tcp
        declared = sorted({effector.parent_link for effector in self.srdf.end_effectors})
        if len(declared) == 1:
            return declared[0]
        parents = {joint.parent for joint in self.urdf.joints.values()}
        leaves = [link for link in self.urdf.links if link not in parents]
        # The frames of a DH table, as our own URDFs bear them, mark places; what else hangs there is the tool.
        leaves = [link for link in leaves if not DH_FRAME.fullmatch(link)] or leaves
        if not declared and len(leaves) == 1:
            joint = self.urdf.parent_joint(leaves[0])
            if joint is not None and joint.type == "fixed":
                return leaves[0]
        raise InputError(
            f"robot {self.name!r} declares no single tcp; name one with tcp=. "
            f"Candidates: {', '.join(declared or leaves)}"
        )


def kinematic_class(arm: Arm) -> str:
    """Describe the joint axes, for example ``"6 revolute joints (RRRRRR): spherical wrist (joints 4, 5, 6)"``.

    The sentence states the number and the order of the revolute (R) and prismatic (P) joints, where three neighbouring
    axes intersect in one point (a spherical shoulder or wrist), and where three or more are parallel. Whether a closed
    form exists is decided by :class:`pinproof.AnalyticIk`.
    """
    q = np.random.default_rng(0).uniform(*arm.limits.sampling_range(), size=(SAMPLES, arm.dof))
    return describe_axes(
        arm.angular,
        [arm.jacobian(each, reference="WORLD") for each in q],
        coupled=any(joint.mimic is not None for joint in link_path(arm.robot.urdf, arm.base, arm.tcp)),
    )


def _robot_info(robot: Robot, arm: Arm) -> RobotInfo:
    """Collect the properties; see :meth:`Robot.info`."""
    urdf, srdf = robot.urdf, robot.srdf
    return RobotInfo(
        name=robot.name,
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
        missing=_missing(robot, arm),
    )


def _joint(arm: Arm, name: str) -> JointInfo:
    joint = arm.robot.urdf.joints[name]
    ends = (joint.name, joint.type, joint.parent, joint.child)
    mimic = "" if joint.mimic is None else f"{joint.mimic.multiplier:g} * {joint.mimic.leader} + {joint.mimic.offset:g}"
    if name in arm.joint_names:
        i = arm.joint_names.index(name)
        limits = arm.limits
        return JointInfo(
            *ends,
            role="arm",
            lower=_known(limits.lower[i]),
            upper=_known(limits.upper[i]),
            velocity=_known(limits.velocity[i]),
            acceleration=_known(limits.acceleration[i]),
            mimic=mimic,
        )
    role: Role = "follower" if name in arm.followers else "fixed" if joint.type == "fixed" else "held"
    held_at = arm.held.get(name) if role == "held" else None
    return JointInfo(*ends, role, joint.lower, joint.upper, joint.velocity, None, held_at, mimic)


def _missing(robot: Robot, arm: Arm) -> tuple[str, ...]:
    said = []
    if robot.srdf.path is None and not robot.srdf.disabled:
        said.append("no SRDF: no groups, no named states, and only neighbouring links may touch")
    if not robot.urdf.collisions:
        said.append("no collision geometry: nothing of the robot can collide")
    slow = [name for name, v in zip(arm.joint_names, arm.limits.velocity, strict=True) if np.isnan(v)]
    if slow:
        said.append(f"no velocity limit: {', '.join(slow)}")
    if arm.limits.acceleration_source.startswith("default"):
        said.append(f"no acceleration limits; {arm.limits.acceleration_source}")
    endless = [n for n, low in zip(arm.joint_names, arm.limits.lower, strict=True) if np.isinf(low)]
    if endless:
        said.append(f"no position limits (continuous): {', '.join(endless)}")
    if not robot.home:
        said.append("no home: the middle of the limits stands for it")
    return (*said, *robot.notes)


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def load_robot(
    source: str | Path,
    *,
    srdf: str | Path | None = None,
    package_dirs: Sequence[str | Path] = (),
    xacro_args: Mapping[str, str] | None = None,
) -> Robot:
    """A robot by catalogue name or from a URDF, xacro or MJCF file.

    Parameters
    ----------
    source
        A name such as ``"ur5"``, or a path that ends in ``.urdf``, ``.xacro``, ``.xml`` or ``.mjcf``.
    srdf
        An SRDF file; by default the catalogue's, for a path none.
    package_dirs
        Folders searched first for ``package://`` meshes and for ``$(find ...)`` in xacro.
    xacro_args
        What a xacro file is told for its ``<xacro:arg>``.

    Raises
    ------
    UnknownNameError
        For a name that is not in the catalogue.
    UrdfError
        For a file that cannot be used, with its line.
    FileError
        For one of ``package_dirs`` that is no folder.
    InputError
        For a xacro file where the extra ``xacro`` is not installed.
    """
    entry: CatalogueEntry | None = None
    if isinstance(source, str) and not source.endswith(SUFFIXES) and "/" not in source:
        entry = find_robot(source)
        source, srdf = entry.urdf, srdf or entry.srdf
    path = Path(source)
    if path.suffix not in SUFFIXES:
        raise UrdfError(path, f"is not a robot description: its name must end in one of {', '.join(SUFFIXES)}")
    for folder in package_dirs:
        if not Path(folder).is_dir():
            raise FileError(folder, "is no folder; package_dirs holds folders with ROS packages in them")
    urdf, words = read_description(path, package_dirs=package_dirs, xacro_args=xacro_args)
    if srdf is not None:
        words = read_srdf(srdf)
    if entry is not None:
        overlaps = tuple(DisabledPair(pair, "overlaps in every sampled configuration") for pair in entry.overlaps)
        words = replace_fields(words, disabled=(*words.disabled, *overlaps))
    return _robot(urdf, words, entry)


def load_robot_from_text(text: str, *, name: str = "URDF text", package_dirs: Sequence[str | Path] = ()) -> Robot:
    """A robot from URDF text; ``name`` stands for the file in errors."""
    return _robot(read_urdf_text(text, name=name, package_dirs=package_dirs), Srdf(), None)


def _robot(urdf: Urdf, srdf: Srdf, entry: CatalogueEntry | None) -> Robot:
    try:
        model = pin.buildModelFromXML(urdf.kinematics)
    except (ValueError, RuntimeError) as error:
        raise UrdfError(urdf.path or urdf.name, f"Pinocchio refuses it: {error}") from error
    missing = [name for name in urdf.links if not model.existFrame(name, pin.FrameType.BODY)]
    if missing:
        raise UrdfError(urdf.path or urdf.name, f"Pinocchio dropped the links {missing}")
    if entry is None:
        return Robot(urdf, srdf, model)
    return Robot(urdf, srdf, model, entry.tcp, entry.home, entry.base)
