"""Inverse dynamics of an arm: payloads, torques by Pinocchio, and the arm's bodies for the compiled core."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof._core import DynamicTree, Joint, JointTree, RigidBody
from pinproof.common.results import ByValue
from pinproof.common.structs import Accepting, any_of, array_of, key, list_of, parsed, simple, struct, vector
from pinproof.common.validation import named_arguments
from pinproof.errors import InputError, UnknownNameError
from pinproof.model.chain import aligned_axes
from pinproof.spatial import Array, finite

GRAVITY = (0.0, 0.0, -9.81)
"""m/s^2. Acceleration of free fall in the root link, unless stated otherwise."""

INERTIA_TOLERANCE = 1e-6
"""Violation of symmetry, of positive definiteness and of the triangle inequality, relative to the largest principal
moment, that is attributed to rounding in files."""


class ArmBodies(Protocol):
    """The attributes of :class:`pinproof.model.JointGroup` on which its dynamics depend."""

    robot: Any
    ends: Mapping[str, tuple[str, str]]
    scale: Array
    offset: Array

    @property
    def model(self) -> Any:
        """A copy of the reduced Pinocchio model."""

    def tcp_of(self, arm: str | None) -> str:
        """The tcp frame of an arm; None is the only arm."""

    @property
    def dof(self) -> int:
        """The number n of joints in q."""


def _checked_inertia(name: str, value: npt.ArrayLike) -> Array:
    try:
        moments_given = np.ndim(value) == 1
    except ValueError:  # rows of different lengths
        moments_given = False
    inertia = np.diag(finite(name, value, (3,))) if moments_given else finite(name, value, (3, 3))
    size = float(np.abs(inertia).max())
    if np.abs(inertia - inertia.T).max() > INERTIA_TOLERANCE * size:
        raise InputError(f"the inertia of a payload must be symmetric, not {inertia.tolist()}")
    # principal moments of a body are positive, and none exceeds the sum of the others
    moments = np.linalg.eigvalsh(inertia)
    text = ", ".join(f"{moment:.6g}" for moment in moments)
    if moments[0] < -INERTIA_TOLERANCE * size:
        raise InputError(
            f"the inertia of a payload is not positive definite: its principal moments are {text} kg m^2; it must be "
            "that about the centre of mass"
        )
    if moments[2] > moments[0] + moments[1] + INERTIA_TOLERANCE * size:
        raise InputError(
            f"no body has the inertia of the payload: of its principal moments {text} kg m^2, the largest exceeds the "
            "sum of the others"
        )
    inertia = np.asarray(0.5 * (inertia + inertia.T))
    inertia.setflags(write=False)
    return inertia


@named_arguments
@struct("payload", eq=False, repr=False)
class Payload(ByValue):
    """The mass of a rigid body fixed to a link of the arm, such as a tool or a carried part."""

    mass: float = key("mass, above 0", "kg", above=0)
    center_of_mass: Accepting[Array, npt.ArrayLike] = key(
        "(3,) centre of mass, in the axes of `frame`", "m", default=(0.0, 0.0, 0.0), kind=array_of(vector(), (3,))
    )
    inertia: Accepting[Array | None, npt.ArrayLike | None] = key(
        "inertia about the centre of mass, in the axes of `frame`: the diagonal (3,), or three rows (3, 3); by default "
        "that of a point mass",
        "kg m²",
        default=None,
        kind=simple(any_of(vector(), list_of(vector(), 3, 3)).schema, _checked_inertia, parsed),
    )
    frame: str | None = key(
        "the link that it is fixed to, in whose frame it is stated; by default the tcp. Required for a group with "
        "several arms",
        default=None,
    )

    def placed(self, a_from_b: pin.SE3) -> Payload:
        """The same body, which is stated in the axes of b, in those of a."""
        rotation = a_from_b.rotation
        inertia = None if self.inertia is None else rotation @ self.inertia @ rotation.T
        return Payload(self.mass, a_from_b * np.array(self.center_of_mass), inertia, self.frame)

    @property
    def body(self) -> pin.Inertia:
        """Mass, centre of mass and inertia for Pinocchio."""
        inertia = np.zeros((3, 3)) if self.inertia is None else self.inertia
        return pin.Inertia(self.mass, np.array(self.center_of_mass), np.array(inertia))

    def __repr__(self) -> str:
        kind = "point mass" if self.inertia is None else "rigid body"
        at = ", ".join(f"{value:g}" for value in self.center_of_mass)
        return f"Payload({self.mass:g} kg at ({at}) m of {self.frame or 'the tcp'}, {kind})"


def checked_payloads(payload: Payload | Iterable[Payload] | None) -> tuple[Payload, ...]:
    """Return none, one or several payloads as a tuple; InputError for anything else."""
    if payload is None:
        return ()
    payloads = (payload,) if isinstance(payload, Payload) else tuple(payload) if isinstance(payload, Iterable) else None
    if payloads is None or not all(isinstance(item, Payload) for item in payloads):
        raise InputError(f"payload must be a Payload or a sequence of them, not {payload!r}")
    return payloads


def inverse_dynamics(
    arm: ArmBodies, q: Array, v: Array, a: Array, payloads: Sequence[Payload], gravity: npt.ArrayLike
) -> Array:
    """Compute the torques (n,) at q, v and a (n,) by the recursive Newton-Euler algorithm of Pinocchio."""
    model = _loaded_model(arm, payloads, gravity)
    torques = pin.rnea(model, model.createData(), arm.scale @ q + arm.offset, arm.scale @ v, arm.scale @ a)
    return np.asarray(arm.scale.T @ torques)


def mass_matrix(arm: ArmBodies, q: Array, payloads: Sequence[Payload]) -> Array:
    """Compute the mass matrix (n, n) at q (n,) by the composite rigid body algorithm of Pinocchio."""
    model = _loaded_model(arm, payloads, GRAVITY)
    upper = np.triu(pin.crba(model, model.createData(), arm.scale @ q + arm.offset))
    return np.asarray(arm.scale.T @ (upper + np.triu(upper, 1).T) @ arm.scale)


def dynamic_tree(arm: ArmBodies, payloads: Sequence[Payload] = (), gravity: npt.ArrayLike = GRAVITY) -> DynamicTree:
    """The bodies that the arm moves for the compiled core, mimic followers and payloads included.

    As in :func:`~pinproof.model.chain.compiled_chain`, the frame of every joint is rotated by a constant A_k so that
    the joint moves about, or along, its own z axis; inertias are in these frames.
    """
    return _tree_of(arm, _loaded_model(arm, payloads, gravity))


def kinematic_tree(arm: ArmBodies) -> DynamicTree:
    """The same for the motion of the tool, which does not depend on masses; its torques have no meaning."""
    return _tree_of(arm, arm.model)


def carried_tree(arm: ArmBodies, payload: Payload, gravity: npt.ArrayLike) -> tuple[DynamicTree, pin.SE3]:
    """The tree with a body at a tcp as its only mass, and ``joint_from_tcp`` of the joint that moves this tcp.

    InputError if the payload is not stated in the frame of a tcp, or the arm does not move that.
    """
    model, tcps = arm.model, [tcp for _, tcp in arm.ends.values()]
    tcp = arm.tcp_of(None) if payload.frame is None else payload.frame
    if tcp not in tcps:
        raise InputError(f"a part is carried at a tcp: its frame must be {' or '.join(map(repr, tcps))}, not {tcp!r}")
    frame = model.frames[model.getFrameId(tcp, pin.FrameType.BODY)]
    if frame.parentJoint == 0:
        raise InputError(f"a part is carried at the tcp, {tcp!r}, which is not moved by the arm")
    model.gravity.linear = finite("gravity", gravity, (3,))
    for joint in range(model.njoints):
        model.inertias[joint] = pin.Inertia.Zero()
    model.inertias[frame.parentJoint] = frame.placement.act(payload.body)
    return _tree_of(arm, model, tcp), aligned_axes(model, frame.parentJoint)[0].actInv(frame.placement)


def _tree_of(arm: ArmBodies, model: pin.Model, tool: str | None = None) -> DynamicTree:
    axes = [(pin.SE3.Identity(), False), *(aligned_axes(model, joint) for joint in range(1, model.njoints))]
    joints, bodies = [], []
    for joint, (row, parent) in enumerate(zip(arm.scale, list(model.parents)[1:], strict=True), 1):
        aligned, prismatic = axes[joint]
        before = axes[parent][0].actInv(model.jointPlacements[joint]) * aligned
        leader = int(np.abs(row).argmax())
        joints.append(Joint(before.homogeneous, prismatic, leader, row[leader], arm.offset[joint - 1], parent - 1))
        body = aligned.actInv(model.inertias[joint])
        # The inertia is about the origin of the joint frame.
        bodies.append(RigidBody(body.mass, body.mass * body.lever, body.matrix()[3:, 3:].copy()))
    # The tool of a group with several arms is by default that of the first; limits of the tool are for one arm only.
    _, first = next(iter(arm.ends.values()))
    tcp = model.frames[model.getFrameId(tool or first, pin.FrameType.BODY)]
    return DynamicTree(
        JointTree(joints, arm.dof),
        bodies,
        np.array(model.gravity.linear),
        tcp.parentJoint - 1,
        np.array(axes[tcp.parentJoint][0].actInv(tcp.placement).translation),
    )


def massless_joints(arm: ArmBodies, payloads: Sequence[Payload] = ()) -> tuple[str, ...]:
    """The joints (mimic followers included) whose links have no inertia in the description."""
    model = _loaded_model(arm, payloads, GRAVITY)
    return tuple(name for name, body in zip(model.names, model.inertias, strict=True) if body.mass == 0.0)[1:]


def _loaded_model(arm: ArmBodies, payloads: Sequence[Payload], gravity: npt.ArrayLike) -> pin.Model:
    """A copy of the reduced model of the arm with payloads.

    UnknownNameError if a payload is fixed to a link that does not exist. InputError if the arm does not move that link,
    or it moves bodies without mass only.
    """
    model = arm.model
    model.gravity.linear = finite("gravity", gravity, (3,))
    # a payload adds to the body of the joint that moves its link
    for payload in payloads:
        name = arm.tcp_of(None) if payload.frame is None else payload.frame
        if name not in arm.robot.urdf.links:
            raise UnknownNameError("frame", name, arm.robot.urdf.links, "the payload")
        frame = model.frames[model.getFrameId(name, pin.FrameType.BODY)]
        if frame.parentJoint == 0:
            raise InputError(f"the payload is fixed to {name!r}, which the arm does not move")
        model.inertias[frame.parentJoint] += frame.placement.act(payload.body)
    # torques are unknown where a joint moves no mass
    for joint in range(1, model.njoints):
        moved = sum(model.inertias[below].mass for below in model.subtrees[joint])
        if moved <= 0.0:
            raise InputError(
                f"robot {arm.robot.name!r} states no mass of the links behind joint {model.names[joint]!r}, so that "
                "torques are unknown; add <inertial> elements to its URDF"
            )
    return model
