"""The bodies, joints and pairs of a checker as objects of the compiled core."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof._core import Geometry, JointTree, World
from pinproof.collision.geometry.bodies import Body
from pinproof.model import JointGroup

Array = npt.NDArray[np.float64]

ARMS_KEPT = 8
"""Number of arms whose joints are kept; several checkers are often made for one arm."""

ROOT = -1
"""In place of a joint: the body does not move."""


def pack_geometry(arm: JointGroup, bodies: Sequence[Body], rounding: float) -> Geometry:
    """Return the joints of an arm's robot, and the bodies on them.

    Parameters
    ----------
    bodies
        Obstacles last.
    rounding
        Allowance (m) for floating-point errors.
    """
    tree, links = _joints(arm)
    joints, placements = [], np.zeros((len(bodies), 4, 4))
    for i, body in enumerate(bodies):
        joint, place = ROOT, body.link_from_body
        if body.link is not None:
            joint, above = links[body.link]
            place = above * place
        joints.append(joint)
        placements[i] = place.homogeneous
    robot = sum(body.link is not None for body in bodies)
    return Geometry(tree, [body.core_shape for body in bodies], joints, placements, robot, rounding)


def pack_world(geometry: Geometry, pairs: Sequence[tuple[int, int]]) -> World:
    """Return the world of these pairs of bodies, of which the first is the robot's, with margins of 0."""
    return World(geometry, np.array(pairs, dtype=np.int64).reshape(-1, 2), np.zeros(len(pairs)))


@lru_cache(maxsize=ARMS_KEPT)
def _joints(arm: JointGroup) -> tuple[JointTree, dict[str, tuple[int, pin.SE3]]]:
    """Return the joints, whose axis is z, and for each link the joint that moves it and its placement there."""
    model = arm.model
    data = model.createData()
    columns = pin.computeJointJacobians(model, data, pin.neutral(model)).reshape(6, -1)
    count = model.njoints - 1
    prismatic = (~columns[3:].any(axis=0)).tolist()
    leaders = np.abs(arm.scale).argmax(axis=1)
    parents = [int(parent) - 1 for parent in model.parents[1:]]
    aligned: list[pin.SE3] = []
    placements = np.zeros((count, 4, 4))
    for k in range(count):
        axis = data.oMi[k + 1].rotation.T @ (columns[:3, k] if prismatic[k] else columns[3:, k])
        turned = pin.SE3(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis), np.zeros(3))
        aligned.append(turned)
        above = pin.SE3.Identity() if parents[k] < 0 else aligned[parents[k]].inverse()
        placements[k] = (above * model.jointPlacements[k + 1] * turned).homogeneous
    multipliers = np.ascontiguousarray(arm.scale[np.arange(count), leaders])
    offsets = np.ascontiguousarray(arm.offset, dtype=float)
    tree = JointTree(placements, prismatic, leaders.tolist(), multipliers, offsets, parents, arm.dof)
    links: dict[str, tuple[int, pin.SE3]] = {}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.name not in links:
            k = int(frame.parentJoint) - 1
            links[frame.name] = k, pin.SE3(frame.placement) if k < 0 else aligned[k].inverse() * frame.placement
    return tree, links
