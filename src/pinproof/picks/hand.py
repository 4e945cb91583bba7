"""The moving fingers of a hand in the frame of the tcp: open, closed, and bodies that hold the way between.

Fingers are bodies of the gripper that translate along an axis (:class:`~pinproof.picks.GripperFingers`), or links that
joints outside the arm move (``held: {joint: {open, grip}}``). Neither depends on the configuration of the arm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pinproof.collision import ConvexHull, Obstacle
from pinproof.collision.line_surface import LineSurface, outer_points
from pinproof.collision.links import link_bodies
from pinproof.description import UrdfJoint
from pinproof.model import Arm
from pinproof.picks.frames import moved_by
from pinproof.picks.gripper import GripperFingers
from pinproof.spatial import SE3

__all__ = ["MovingFinger", "fingers_of"]

Array = npt.NDArray[np.float64]

SAGITTA = 2e-4
"""Metres: how far the points of a rotating finger may leave the chords by which its closing motion is bounded. The
swept bodies are larger by it, so it is small beside the margins of a cell."""

MOST_STEPS = 64
"""Chords of a closing motion; a finger that needs more is bounded less closely."""

SHARE = 1e-4
"""The share of the closing motion over which the direction of its end is measured."""

SMALLEST = 1e-9
"""Metres: a finger that moves less does not move."""

FLAT = 1e-4
"""Metres by which swept bodies without thickness are grown, so that they have a hull."""


@dataclass(frozen=True, eq=False)
class MovingFinger:
    """A part of the hand that moves while the hand closes.

    Parameters
    ----------
    name
        The link or the attached body.
    surfaces
        Its bodies, each with ``finger_from_body``.
    way
        ``tcp_from_finger`` from open (first) to closed (last).
    direction
        (3,) the unit direction in the tcp's frame in which it moves when it is nearly closed.
    sagitta
        Metres by which its points may leave the chords between the placements of ``way``.
    """

    name: str
    surfaces: tuple[tuple[LineSurface, SE3], ...]
    way: tuple[SE3, ...]
    direction: Array
    sagitta: float = 0.0

    @property
    def open(self) -> SE3:
        """``tcp_from_finger`` before the grasp."""
        return self.way[0]

    @property
    def closed(self) -> SE3:
        """``tcp_from_finger`` on the part."""
        return self.way[-1]

    @property
    def travel(self) -> float:
        """Metres that the middle of the finger moves along its closing direction from open to closed."""
        middle = np.mean([at.translation + at.rotation @ _middle(surface) for surface, at in self.surfaces], axis=0)
        start, end = (at.translation + at.rotation @ middle for at in (self.open, self.closed))
        return float((end - start) @ self.direction)

    def swept(self) -> tuple[Obstacle, ...]:
        """Convex bodies in the tcp's frame that hold every point of the finger at every instant of the closing motion.

        Over each chord the hull of the body at both of its ends, grown by the sagitta.
        """
        bodies = []
        for number, (surface, at) in enumerate(self.surfaces):
            own = outer_points(surface)
            placed = [at_finger * at for at_finger in self.way]
            for step, (one, other) in enumerate(pairwise(placed)):
                ends = np.concatenate([own @ each.rotation.T + each.translation for each in (one, other)])
                bodies.append(Obstacle(f"{self.name} closing {number}.{step}", _hull(ends, self.sagitta)))
        return tuple(bodies)


def _middle(surface: LineSurface) -> Array:
    return np.asarray(surface.body.box.mean(axis=0))


def _hull(points: Array, grow: float) -> ConvexHull:
    """The hull of points (V, 3), grown by a cube of half side ``grow``, and somewhat if they have no thickness."""
    corners = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8).T
    thin = np.linalg.svd(points - points.mean(axis=0), compute_uv=False).min() < FLAT
    by = max(grow, FLAT if thin else 0.0)
    if by > 0.0:
        points = (points[:, None] + by * corners).reshape(-1, 3)
    return ConvexHull(points)


def fingers_of(arm: Arm, fingers: GripperFingers | None, grip: Mapping[str, float]) -> tuple[MovingFinger, ...]:
    """All that moves while the hand closes: the gripper's two bodies, and the links moved by the joints that grip."""
    return (*_sliding(fingers), *_links(arm, grip))


def _sliding(fingers: GripperFingers | None) -> list[MovingFinger]:
    if fingers is None:
        return []
    found, axis = [], np.array(fingers.axis)
    for sign, before, after in zip((-1.0, 1.0), fingers.apart(), fingers.gripping(), strict=True):
        surface = (LineSurface.of_obstacle(after), SE3.Identity())
        found.append(MovingFinger(after.name, (surface,), (before.pose, after.pose), sign * axis))
    return found


def _links(arm: Arm, grip: Mapping[str, float]) -> list[MovingFinger]:
    """The links that the joints move, each with its exact surface."""
    urdf = arm.robot.urdf
    start = {name: arm.held[name] for name in grip}
    if all(abs(start[name] - value) < SMALLEST for name, value in grip.items()):
        return []
    own: dict[str, tuple[tuple[LineSurface, SE3], ...]] = {}
    for geometry in urdf.collisions:
        if moved_by(urdf, geometry.link, grip):
            made = tuple((LineSurface.of_body(body), body.link_from_body) for body in link_bodies(geometry, "surface"))
            own[geometry.link] = (*own.get(geometry.link, ()), *made)
    bounds = {link: _acceleration(arm, link, own[link], grip) for link in own}
    steps = int(np.clip(np.ceil(np.sqrt(max(bounds.values(), default=0.0) / (8 * SAGITTA))), 1, MOST_STEPS))
    shares = [*np.linspace(0.0, 1.0, steps + 1).tolist(), 1.0 - SHARE]
    arms = [
        arm.with_held({name: start[name] + share * (value - start[name]) for name, value in grip.items()})
        for share in shares
    ]
    found = []
    for link, surfaces in own.items():
        *way, before = [each.forward_kinematics(arm.home).actInv(each.frame_placement(arm.home, link)) for each in arms]
        middle = np.mean([at.translation + at.rotation @ _middle(surface) for surface, at in surfaces], axis=0)
        last = (way[-1].act(middle) - before.act(middle)) / SHARE
        if (length := float(np.linalg.norm(last))) < SMALLEST:
            continue
        found.append(MovingFinger(link, surfaces, tuple(way), last / length, bounds[link] / (8 * steps**2)))
    return found


def _acceleration(arm: Arm, link: str, surfaces: Sequence[tuple[LineSurface, SE3]], grip: Mapping[str, float]) -> float:
    """A bound (m) of the second derivative of every point of a link over the share of the closing motion.

    Joints at constant rates w_i (revolute) and v_i (prismatic) accelerate a point by at most (sum w)^2 R + 2 sum w
    sum v, where R bounds its distance from every one of the axes; along a chord of the share h it leaves the chord by
    at most h^2 / 8 times that.
    """
    urdf = arm.robot.urdf
    joints: list[UrdfJoint] = []
    at: str = link
    while (joint := urdf.parent_joint(at)) is not None and moved_by(urdf, at, grip):
        if _rate(arm, joint, grip):
            joints.append(joint)
        at = joint.parent
    rates = [_rate(arm, joint, grip) for joint in joints]
    turning = sum(rate for joint, rate in zip(joints, rates, strict=True) if joint.type != "prismatic")
    sliding = sum(rate for joint, rate in zip(joints, rates, strict=True) if joint.type == "prismatic")
    if turning == 0.0:
        return 0.0
    origins = [arm.frame_placement(arm.home, joint.child).translation for joint in joints]
    placed = arm.frame_placement(arm.home, link)
    own = np.concatenate([outer_points(surface) @ pose.rotation.T + pose.translation for surface, pose in surfaces])
    points = own @ placed.rotation.T + placed.translation
    radius = float(np.linalg.norm(points - origins[0], axis=1).max()) + sliding
    radius += sum(float(np.linalg.norm(b - a)) for a, b in pairwise(origins))
    return turning**2 * radius + 2 * turning * sliding


def _rate(arm: Arm, joint: UrdfJoint, grip: Mapping[str, float]) -> float:
    """How far (rad or m) a joint moves from open to grip."""
    leader, factor = (joint.name, 1.0) if joint.mimic is None else (joint.mimic.leader, joint.mimic.multiplier)
    return abs(factor * (grip[leader] - arm.held[leader])) if leader in grip else 0.0
