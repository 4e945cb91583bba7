"""An arm as other libraries read one: a plain URDF of its chain, or its axes and the offsets between them.

Peers get the chain and the limits of this run and nothing else: no meshes, no fingers, no couplings. What they get is
read off Pinocchio at q = 0, where joint frames with the axes of the base stand on each joint's axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from pinproof.benchmarks.ik_methods import Unsuitable
from pinproof.model import Arm
from pinproof.spatial import xyz_rpy

__all__ = ["BASE", "TIP", "ScrewAxes", "chain_urdf", "joint_names", "screw_axes"]

Array = npt.NDArray[np.float64]

BASE, TIP = "chain_base", "chain_tip"

TOUCHING = 1e-6
"""Metres and rad: axes this near to meeting, or to being parallel, are taken to be; URDFs write 1.5708 for pi/2."""


@dataclass(frozen=True, eq=False)
class ScrewAxes:
    """A chain at q = 0 in the axes of its base.

    Parameters
    ----------
    directions
        (n, 3) unit vectors the joints turn about or slide along.
    points
        (n, 3) a point on each axis, in m.
    base_from_tcp
        (4, 4) at q = 0.
    """

    directions: Array
    points: Array
    base_from_tcp: Array

    @property
    def offsets(self) -> Array:
        """(n + 1, 3) from the base to the first point, from each point to the next, and from the last to the tcp."""
        return np.diff(np.vstack([np.zeros(3), self.points, self.base_from_tcp[:3, 3]]), axis=0)

    def parallel(self, *joints: int) -> bool:
        """Whether the axes of these joints (from 0) are parallel."""
        pairs = combinations(self.directions[list(joints)], 2)
        return all(bool(np.linalg.norm(np.cross(a, b)) < TOUCHING) for a, b in pairs)

    def meeting_point(self, *joints: int) -> Array | None:
        """(3,) where the axes of these joints meet; None if they do not, or anywhere."""
        p, w = self.points[list(joints)], self.directions[list(joints)]
        across = np.eye(3) - w[:, :, None] * w[:, None, :]
        point, _, rank, _ = np.linalg.lstsq(across.reshape(-1, 3), np.einsum("kij,kj->ki", across, p).ravel())
        apart = np.linalg.norm(np.einsum("kij,kj->ki", across, point - p), axis=1)
        return np.asarray(point) if rank == 3 and apart.max() < TOUCHING else None

    def at(self, joints: tuple[int, ...], point: Array) -> ScrewAxes:
        """The same axes with the points of these joints moved to where they meet."""
        points = self.points.copy()
        points[list(joints)] = point
        return ScrewAxes(self.directions, points, self.base_from_tcp)


def screw_axes(arm: Arm) -> ScrewAxes:
    """The axes of a chain without mimic followers.

    The Jacobian's columns at q = 0, seen at the base's origin, are the screws (v, w) of the joints: the direction is w
    (v of one that slides), and the point of its axis nearest to the origin is w x v.

    Raises
    ------
    Unsuitable
        If a joint moves others than itself.
    """
    if arm.followers:
        raise Unsuitable("mimic joints on the chain cannot be handed to a peer")
    zero = np.zeros(arm.dof)
    screws = arm.jacobian(zero, reference="WORLD").T
    turns = np.asarray(arm.angular, dtype=bool)[:, None]
    directions = np.where(turns, screws[:, 3:], screws[:, :3])
    points = np.where(turns, np.cross(screws[:, 3:], screws[:, :3]), 0.0)
    return ScrewAxes(directions, points, np.array(arm.forward_kinematics(zero).homogeneous))


def joint_names(arm: Arm) -> list[str]:
    """The joints of :func:`chain_urdf`, in the order of q."""
    return [f"chain_joint_{k + 1}" for k in range(arm.dof)]


def chain_urdf(arm: Arm) -> str:
    """A URDF of the chain from :data:`BASE` to :data:`TIP` under the arm's limits.

    Raises
    ------
    Unsuitable
        As :func:`screw_axes`.
    """
    axes, names = screw_axes(arm), joint_names(arm)
    links = [BASE, *(f"chain_link_{k + 1}" for k in range(arm.dof)), TIP]
    lines = ['<robot name="chain">', *(f'  <link name="{link}"/>' for link in links)]
    for k, name in enumerate(names):
        lower, upper, fastest = (float(each[k]) for each in (arm.limits.lower, arm.limits.upper, arm.limits.velocity))
        bounded = math.isfinite(upper - lower)
        kind = "prismatic" if not arm.angular[k] else "revolute" if bounded else "continuous"
        bounds = f'lower="{lower!r}" upper="{upper!r}" ' if bounded else ""
        speed = fastest if math.isfinite(fastest) else 1.0
        lines += [
            f'  <joint name="{name}" type="{kind}">',
            f'    <parent link="{links[k]}"/><child link="{links[k + 1]}"/>',
            f'    <origin xyz="{_numbers(axes.offsets[k])}"/><axis xyz="{_numbers(axes.directions[k])}"/>',
            f'    <limit {bounds}velocity="{speed!r}" effort="1"/>',
            "  </joint>",
        ]
    rpy = xyz_rpy(axes.base_from_tcp)[3:]
    lines += [
        '  <joint name="chain_tool" type="fixed">',
        f'    <parent link="{links[-2]}"/><child link="{TIP}"/>',
        f'    <origin xyz="{_numbers(axes.offsets[-1])}" rpy="{_numbers(rpy)}"/>',
        "  </joint>",
        "</robot>",
    ]
    return "\n".join(lines)


def _numbers(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)
