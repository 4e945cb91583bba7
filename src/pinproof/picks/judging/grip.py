"""Whether a hand holds a part: the closed fingers of a gripper, the face of a suction cup, or another tip.

Fingers are bodies of the gripper that translate along an axis (:class:`~pinproof.picks.GripperFingers`), or links that
are moved by joints outside the arm (``held: {joint: {open, grip}}``). Neither depends on the configuration of the arm,
so all computations are in the frame of the tcp.

Every finger is moved along its closing direction until it touches the part. The contact patch is the region where, at
that moment, the distance between the facing surfaces along the closing direction is at most the compliance of pads and
part, and where both normals lie within the friction cone about that direction. A part is held if the fingers touch it
at their closed positions, each over a sufficient area, and if forces within the friction cones at the patches can
balance each other: the fingers then press on opposite sides. Closed positions that are not stated follow from contact:
all fingers move together until a second one touches the part (:func:`close_on`).

The face of a suction cup is a disc at the tip, perpendicular to the tip's z axis. Lines along that axis from points of
its rim must meet the part within the stated gap, in front of the face or behind it, and the plane fitted to the points
where they meet it must be nearly parallel to the face. Inside the rim, every line must meet the part: through a hole
the cup would leak. Openings that are narrower than the distance of the lines (1/256 of the rim, 1/32 of the diameter)
are not detected. How far the part protrudes into the cup is measured with the depths of the hand
(:mod:`pinproof.picks.judging.hand`).

Sources of the force balance: V.-D. Nguyen (1988), "Constructing force-closure grasps", International Journal of
Robotics Research 7(3); for several contacts with linearised cones: J. Ponce, S. Sullivan, A. Sudsang, J.-D. Boissonnat,
J.-P. Merlet (1997), "On computing four-finger equilibrium and force-closure grasps of polyhedral objects", IJRR 16(1).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pinproof.collision import (
    TOUCH,
    ConvexShape,
    LineSurface,
    MeasureByCoal,
    Obstacle,
    SurfacePoints,
    body_distance,
    depth_along,
    link_bodies,
    outer_points,
    point_distance,
    travel_to_touch,
)
from pinproof.common.least_squares import non_negative_shares
from pinproof.common.structs import OPTIONAL_NUMBER, key, struct
from pinproof.description import UrdfJoint, moved_by
from pinproof.model import Arm, JointGroup, chain_of, held_values
from pinproof.picks.input.settings import GripLimits, GripperFingers, SuctionCup
from pinproof.spatial import SE3, Array, translated

CONE_EDGES = 16
"""Edges of the pyramids inscribed in the friction cones, which are conservative by 2 %."""

AREA_DIGITS = 12
"""Areas (m^2) that are equal when rounded to this decimal are equal: rounding decides the order of no two fingers."""

BALANCE_TOLERANCE = 1e-7
"""The sum of forces and torques may differ from zero by this share of the forces along the normals."""

SAME_PLACE = 1e-7
"""Metres: contacts closer to each other than this are considered coincident."""


def balanced(patches: Sequence[tuple[Array, Array]], angle: float) -> bool:
    """Whether forces within the friction cones at points of the patches can sum to zero force and zero torque.

    Each patch has its points (N, 3) in metres and the unit normal (3,) in which the finger presses; ``angle`` (rad) is
    the half angle of the cones.
    """
    # The edges of the friction cones at the outermost points of each patch
    points, forces, normals = [], [], []
    for touched, normal in patches:
        edges = _cone(normal, angle)
        # the extreme points of the patch in several directions across its normal
        outermost = np.unique(touched[(touched @ _cone(normal, np.pi / 2).T).argmax(axis=0)], axis=0)
        for point in outermost:
            points.append(np.tile(point, (len(edges), 1)))
            forces.append(edges)
            normals.append(edges @ normal)
    # Non-negative shares of these forces that sum to no force and no torque, and to 1 along the normals
    at, force = np.concatenate(points), np.concatenate(forces)
    centre = at.mean(axis=0)
    size = max(float(np.linalg.norm(at - centre, axis=1).max()), SAME_PLACE)
    torque = np.cross((at - centre) / size, force)
    balance = np.concatenate([force.T, torque.T, np.concatenate(normals)[None]])
    wanted = np.array([0.0] * 6 + [1.0])
    rest = balance @ non_negative_shares(balance, wanted) - wanted
    return bool(np.linalg.norm(rest) <= BALANCE_TOLERANCE)


def _cone(normal: Array, angle: float) -> Array:
    """(E, 3) unit vectors on the cone with the given half angle (rad) about a normal."""
    least = np.eye(3)[np.abs(normal).argmin()]
    u = np.cross(normal, least)
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    turns = np.arange(CONE_EDGES) * 2 * np.pi / CONE_EDGES
    across = np.cos(turns)[:, None] * u + np.sin(turns)[:, None] * v
    return np.asarray(np.cos(angle) * normal + np.sin(angle) * across)


class PlacedSurface(NamedTuple):
    """The surface of a body at a pose: of the hand or of the part, in the frame of the tcp."""

    surface: LineSurface
    pose: SE3

    @property
    def name(self) -> str:
        """The name of the link or obstacle."""
        return self.surface.body.owner

    @property
    def points(self) -> Array:
        """(N, 3) points whose convex hull contains the body."""
        return np.asarray(outer_points(self.surface) @ self.pose.rotation.T + self.pose.translation)

    def moved(self, by: SE3) -> PlacedSurface:
        """The surface after a motion of its frame."""
        return PlacedSurface(self.surface, by * self.pose)

    def enter(self, lines: Array, direction: Array, after: Array | float = -np.inf) -> SurfacePoints:
        """Where lines (G, 3) along a direction (3,) first meet it, see :meth:`LineSurface.enter`."""
        at = self.pose
        own = self.surface.enter((lines - at.translation) @ at.rotation, at.rotation.T @ direction, after)
        return own._replace(normals=own.normals @ at.rotation.T)


SAGITTA = 2e-4
"""Metres: largest distance of the points of a rotating finger from the chords that approximate its closing motion. The
swept bodies are enlarged by it, so it is small compared to the margins of a cell."""

MOST_STEPS = 64
"""Largest number of chords of a closing motion; with fewer than needed the bound is less tight."""

SHARE = 1e-4
"""Fraction of the closing motion over which the final closing direction is measured."""

LEAST_TRAVEL = 1e-9
"""Metres: a finger that moves less is considered fixed."""

FLAT = 1e-4
"""Metres by which flat swept bodies are enlarged, so that they have a convex hull."""


@dataclass(frozen=True, eq=False)
class MovingFinger:
    """A link or attached body that moves while the hand closes.

    ``surfaces`` are its bodies with ``finger_from_body``, ``placements`` are ``tcp_from_finger`` at the ends of the
    chords, from open to closed. ``direction`` (3,) is the unit vector of its motion in the tcp frame just before it is
    closed, and ``sagitta`` (m) the largest distance of its points from the chords. No point moves by more than ``rate``
    (m) times the share of the closing motion. For a finger that rotates, ``placed_at`` is ``tcp_from_finger`` at a
    share of it. Links that one link of the hand carries, such as a knuckle and its pad, have the same ``branch``.
    """

    name: str
    surfaces: tuple[PlacedSurface, ...]
    placements: tuple[SE3, ...]
    direction: Array
    sagitta: float = 0.0
    placed_at: Callable[[float], SE3] | None = None
    rate: float = 0.0
    branch: str = ""

    @property
    def open(self) -> SE3:
        """``tcp_from_finger`` before the grasp."""
        return self.placements[0]

    @property
    def closed(self) -> SE3:
        """``tcp_from_finger`` on the part."""
        return self.placements[-1]

    def at(self, share: float) -> SE3:
        """``tcp_from_finger`` at a share of the closing motion."""
        if self.placed_at is not None:
            return self.placed_at(share)
        return translated(self.open, share * (self.closed.translation - self.open.translation))

    @property
    def travel(self) -> float:
        """Metres that the centre of the finger moves along its closing direction; if it rotates, in the last chord."""
        centre = _centre(self.surfaces)
        start = self.open if self.placed_at is None else self.placements[-2]
        return float((self.closed.act(centre) - start.act(centre)) @ self.direction)

    def swept(self) -> tuple[Obstacle, ...]:
        """Convex bodies in the tcp frame that contain the finger during the complete closing motion.

        For each chord this is the hull of the body at both ends, enlarged by the sagitta, or by FLAT if it is coplanar.
        """
        bodies = []
        for number, body in enumerate(self.surfaces):
            placed = [body.moved(at).points for at in self.placements]
            for step, ends in enumerate(map(np.concatenate, pairwise(placed))):
                thin = np.linalg.svd(ends - ends.mean(axis=0), compute_uv=False).min() < FLAT
                shape = ConvexShape(ends, max(self.sagitta, FLAT if thin else 0.0))
                bodies.append(Obstacle(f"{self.name} closing {number}.{step}", shape))
        return tuple(bodies)


def _centre(surfaces: Sequence[PlacedSurface]) -> Array:
    """(3,) the mean of the centres of bodies."""
    return np.asarray(np.mean([at.act(surface.body.box.mean(axis=0)) for surface, at in surfaces], axis=0))


def fingers_of(arm: Arm | None, fingers: GripperFingers | None, grip: Mapping[str, float]) -> tuple[MovingFinger, ...]:
    """The moving fingers: the two bodies of the gripper, and the links of an arm moved by the gripping joints."""
    found = [] if arm is None else _links(arm, grip)
    if fingers is None:
        return tuple(found)
    bodies = []
    for sign, before, after in zip((-1.0, 1.0), fingers.apart(), fingers.gripping(), strict=True):
        surface = PlacedSurface(LineSurface.of_obstacle(after), SE3.Identity())
        direction = sign * np.array(fingers.axis)
        rate = float(np.linalg.norm(after.pose.translation - before.pose.translation))
        placements = before.pose, after.pose
        bodies.append(MovingFinger(after.name, (surface,), placements, direction, rate=rate, branch=after.name))
    return (*bodies, *found)


def _links(arm: Arm, grip: Mapping[str, float]) -> list[MovingFinger]:
    """The links that the gripping joints move, each with its exact surface."""
    urdf = arm.robot.urdf
    start = {name: arm.held[name] for name in grip}
    if all(abs(start[name] - value) < LEAST_TRAVEL for name, value in grip.items()):
        return []
    own: dict[str, tuple[PlacedSurface, ...]] = {}
    for geometry in urdf.collisions:
        if moved_by(urdf, geometry.link, grip):
            bodies = link_bodies(geometry, "surface")
            made = (PlacedSurface(LineSurface.of_body(body), body.link_from_body) for body in bodies)
            own[geometry.link] = (*own.get(geometry.link, ()), *made)
    # The number of chords, for the link whose points accelerate most
    bounds = {link: _rates(arm, link, own[link], grip) for link in own}
    sharpest = max((acceleration for _, acceleration in bounds.values()), default=0.0)
    steps = int(np.clip(np.ceil(np.sqrt(sharpest / (8 * SAGITTA))), 1, MOST_STEPS))

    # The joints of the gripper as a group, whose placements relative to the tcp do not depend on the arm
    robot, leaders = arm.robot, [name for name in grip if urdf.joints[name].mimic is None]
    chain = chain_of(urdf, leaders)
    still = {name: arm.held[name] for name in arm.held if name not in leaders and urdf.joints[name].mimic is None}
    still = held_values(urdf, chain, {**still, **dict(zip(arm.joint_names, arm.home.tolist(), strict=True))}, {})
    group = JointGroup(robot, {arm.tcp: (urdf.root, arm.tcp)}, chain, chain.limits, still)
    first, last = (np.array([values[name] for name in leaders]) for values in (start, grip))

    def placed_at(link: str, share: float) -> SE3:
        q = first + share * (last - first)
        return group.root_from_frame(q, arm.tcp).actInv(group.root_from_frame(q, link))

    found = []
    for link, surfaces in own.items():
        rate, acceleration = bounds[link]
        placements = [placed_at(link, share) for share in np.linspace(0.0, 1.0, steps + 1).tolist()]
        before = placed_at(link, 1.0 - SHARE)
        # The closing direction is that of the centre, or of the point that moves most if the link rotates about it.
        points = np.concatenate([_centre(surfaces)[None], *(body.points for body in surfaces)])
        moved = points @ (placements[-1].rotation - before.rotation).T + placements[-1].translation - before.translation
        lengths = np.linalg.norm(moved, axis=1) / SHARE
        leading = 0 if lengths[0] >= LEAST_TRAVEL else int(lengths.argmax())
        if lengths[leading] < LEAST_TRAVEL:
            continue
        direction, sagitta = moved[leading] / (SHARE * lengths[leading]), acceleration / (8 * steps**2)
        turning = partial(placed_at, link) if acceleration > 0.0 else None
        branch = link
        while (joint := urdf.parent_joint(branch)) is not None and moved_by(urdf, joint.parent, grip):
            branch = joint.parent
        found.append(MovingFinger(link, surfaces, tuple(placements), direction, sagitta, turning, rate, branch))
    return found


def _rates(arm: Arm, link: str, surfaces: Sequence[PlacedSurface], grip: Mapping[str, float]) -> tuple[float, float]:
    """Bounds (m) of the first and second derivative of every point of a link over the share of the closing motion.

    Joints at constant rates w_i (revolute) and v_i (prismatic) move a point by at most sum w R + sum v and accelerate
    it by at most (sum w)^2 R + 2 sum w sum v, where R bounds its distance from every one of the axes; along a chord of
    the share h it leaves the chord by at most h^2 / 8 times that.
    """
    # The gripping joints that move the link, from it to the palm
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
        return sliding, 0.0
    # The distance from the nearest axis, and those between consecutive axes, bound that from each of them
    origins = [arm.frame_placement(arm.home, joint.child).translation for joint in joints]
    placed = arm.frame_placement(arm.home, link)
    points = np.concatenate([body.moved(placed).points for body in surfaces])
    radius = float(np.linalg.norm(points - origins[0], axis=1).max()) + sliding
    radius += sum(float(np.linalg.norm(b - a)) for a, b in pairwise(origins))
    return turning * radius + sliding, turning**2 * radius + 2 * turning * sliding


def _rate(arm: Arm, joint: UrdfJoint, grip: Mapping[str, float]) -> float:
    """The travel (rad or m) of a joint from open to grip."""
    leader, factor = (joint.name, 1.0) if joint.mimic is None else (joint.mimic.leader, joint.mimic.multiplier)
    return abs(factor * (grip[leader] - arm.held[leader])) if leader in grip else 0.0


class Closing(NamedTuple):
    """Where fingers that close together touch a part: the share of the motion at which the second one does.

    ``first`` and ``second`` are the links or bodies that touch it, empty if they do not, and ``ahead`` is the share of
    the motion between both contacts.
    """

    share: float
    first: str
    second: str
    ahead: float

    def reason(self, part: str) -> str:
        """Why the part is not held; empty if two fingers touch it."""
        if self.second:
            return ""
        touching = f"only {self.first} touches" if self.first else "no finger touches"
        return f"{touching} {part} while the fingers close completely"


def close_on(fingers: Sequence[MovingFinger], part: PlacedSurface) -> Closing:
    """Close fingers until two of them touch a part; links of one branch are one finger.

    Each contact is found by conservative advancement (Mirtich, 1996): a finger whose points move by less than its
    distance cannot touch. It ends within :data:`TOUCH` of the part, or completely closed; each step is
    longer than that.
    """
    measure, target = MeasureByCoal(), part.surface.surface or part.surface.body
    touched: dict[str, tuple[float, str]] = {}
    for finger in fingers:
        share, most = 0.0, touched.get(finger.branch, (1.0, ""))[0]
        while share <= most:
            placed = [(own.surface or own.body, (finger.at(share) * at).homogeneous) for own, at in finger.surfaces]
            apart = min(measure(own, at, target, part.pose.homogeneous).attained for own, at in placed)
            if apart <= TOUCH:
                break
            share += apart / max(finger.rate, LEAST_TRAVEL)
        if share <= most:
            touched[finger.branch] = share, finger.name
    (at_first, first), (share, second) = [*sorted(touched.values()), (1.0, ""), (1.0, "")][:2]
    return Closing(share, first, second, share - at_first if first else 0.0)


COARSE, FINE = 32, 48
"""Number of lines along each side of the overlap rectangle of finger and part, and of that around the patch."""

SAMPLED = 0.02
"""Share by which a sampled area or extent may exceed the true one. Against a sampling that is 30 times as fine, the
largest excess was 0.8 % of the area and 1.6 % of the extent, on 300 patches of spheres, cylinders and boxes from 0.1
mm^2. A part is held only if its contacts exceed the limits by this share."""

ZOOMS, ZOOMED = 10, 9
"""Refinements of the place where a finger touches first, each to a third of the one before, and lines along each side
of it: to 2e-6 of the overlap."""

NOTICED = 5e-5
"""Metres by which a contact must precede the first contact on the lines to be a different one."""

LEAST_WIDTH = 1e-7
"""Metres: a narrower overlap is ignored."""


@struct("contact", written=True)
class FingerContact:
    """The contact of a closed finger.

    Notes
    -----
    Area and overlap are 0 without contact, and NaN if they were not measured because the fingers do not stop at the
    part. The gap is inf if the finger misses the part.
    """

    finger: str = key("name of the finger")
    closing_direction: tuple[float, float, float] = key("unit vector in the frame of the tcp")
    contact_area: float = key("area of contact", "m²", minimum=0)
    overlap: float = key("extent of the contact along the finger", "m", minimum=0)
    gap: float = key(
        "distance of the closed finger from the part; negative if it is pressed in", "m", kind=OPTIONAL_NUMBER
    )
    open_distance: float = key("distance from the open finger to the part", "m")
    closed_distance: float = key("distance from the closed finger to the part; negative for an overlap", "m")


@struct("cup", written=True)
class CupContact:
    """The contact of a suction cup.

    Notes
    -----
    The gap is inf, and the tilt NaN, if a part of the rim is not over the part.
    """

    contact_area: float = key("area of its face near the surface", "m²", minimum=0)
    gap: float = key("largest distance of the rim; negative if the rim is inside the part", "m")
    tilt: float = key("angle between face and surface", "rad", minimum=0)
    normal: tuple[float, float, float] = key(
        "inward unit normal of the surface at the rim, in the frame of the tip", default=(0.0, 0.0, 1.0), hidden=True
    )


class GripPatch(NamedTuple):
    """The contact patch of a finger: points (N, 3) in the tcp frame, and the mean normals there.

    ``normal`` is the outward one of the finger, and ``into`` the inward one of the part. They differ where an edge of
    one of them touches a face of the other, whose normal is then that of the contact.
    """

    contact: FingerContact
    points: Array
    normal: Array
    into: Array
    branch: str


@struct("grip", written=True)
class GripResult:
    """How the part is held."""

    held: bool = key("whether the part is held", hidden=True)
    message: str = key("the figures, and the criterion that is not met", hidden=True)
    contacts: tuple[FingerContact, ...] = key("the fingers that touch it", default=())
    tip_distance: float | None = key(
        "for a tool without fingers or cup: distance from its tip to the surface of the part", "m", default=None
    )
    cup: CupContact | None = key("the contact of a suction cup", default=None)
    depth: float = key(
        "how deep the deepest body of the hand is in the part, an upper bound; NaN if another criterion is not met, "
        "because it is measured last",
        "m",
        default=math.nan,
        hidden=True,
    )
    proven: bool = key(
        "whether it is proven that a part is not held. The depth of a body in a mesh is only an upper bound",
        default=True,
        hidden=True,
    )
    patches: tuple[GripPatch, ...] = key(
        "the contact patches of fingers whose force is stated", default=(), hidden=True, compare=False
    )

    @property
    def figures(self) -> dict[str, float]:
        """Depth of the hand, smallest area and overlap, largest gap, and closing direction, in m, m^2 and rad."""
        depth = {} if math.isnan(self.depth) else {"depth": self.depth}
        if self.cup is not None:
            return {"contact_area": self.cup.contact_area, "gap": self.cup.gap, "tilt": self.cup.tilt, **depth}
        if self.tip_distance is not None:
            return {"tip_distance": self.tip_distance, **depth}
        if not self.contacts:
            return depth
        x, y, z = self.contacts[0].closing_direction
        return {
            **depth,
            "contact_area": min(each.contact_area for each in self.contacts),
            "overlap": min(each.overlap for each in self.contacts),
            "gap": max(each.gap for each in self.contacts),
            "pressed_in": max(max(-each.gap, 0.0) for each in self.contacts),
            "open_distance": min(each.open_distance for each in self.contacts),
            "closed_distance": max(each.closed_distance for each in self.contacts),
            "closing_x": x,
            "closing_y": y,
            "closing_z": z,
        }


def grip_by_tip(tip: SE3, part: PlacedSurface, along: Array, approach: float, limits: GripLimits) -> GripResult:
    """Whether the tip of a tool without fingers and without a cup, such as a magnet, is close to the part.

    ``along`` (3,) is the direction of the approach in the tcp frame, and ``approach`` its length (m). A tip behind the
    surface that it meets first on the approach is as far from it as it has moved since, however near another surface
    is, such as the far side of the part.
    """
    point, direction = part.pose.actInv(tip.translation), part.pose.rotation.T @ along
    distance = point_distance(part.surface, point)
    words = f"the tip is {_mm(distance)} from the surface of {part.name}"
    if (behind := depth_along(part.surface, point, direction, approach)) > TOUCH:
        distance = behind
        words = f"the tip is {_mm(behind)} behind the surface of {part.name} that it meets first on the approach"
    if distance <= limits.tip:
        return GripResult(True, words, tip_distance=distance)
    return GripResult(False, f"{words}; at most {_mm(limits.tip)} is allowed", tip_distance=distance)


def too_far_to_hold(fingers: Sequence[MovingFinger], part: PlacedSurface, limits: GripLimits) -> bool:
    """Whether distances alone show that closed fingers do not hold a part, in a twentieth of the time.

    A closed finger farther from the part than both the allowed gap and the allowed depth does not touch it within
    either: it would have to move by at least this distance, forwards or back, to meet the part. At least two fingers
    must touch.
    """
    far = max(limits.gap, limits.depth) + 2 * TOUCH  # distances are exact to less than TOUCH
    return sum(_distance(finger, finger.closed, part) > far for finger in fingers) > len(fingers) - 2


def _distance(finger: MovingFinger, tcp_from_finger: SE3, part: PlacedSurface) -> float:
    """The signed distance (m) of a finger at a pose from a part."""
    return min(body_distance(*body.moved(tcp_from_finger), *part) for body in finger.surfaces)


def grip_by_fingers(
    fingers: Sequence[MovingFinger], part: PlacedSurface, along: Array, limits: GripLimits
) -> GripResult:
    """Whether closed fingers hold a part; ``along`` (3,) is the direction in the tcp frame in which they extend."""
    paths = [_FingerPath(finger, part, along) for finger in fingers]
    stops = tuple(each.contact for each in paths)
    # The open hand is free of the part
    for each in stops:
        if each.open_distance <= 0.0:
            depth = f"overlaps {part.name} by {_mm(-each.open_distance)}" if each.open_distance else ""
            return GripResult(False, f"the open {each.finger} {depth or f'touches {part.name}'}", stops)
    # The closed fingers reach the part, and are not in it
    deep = min(stops, key=lambda each: each.gap)
    if -deep.gap > limits.depth + TOUCH:
        reason = f"the closed {deep.finger} would penetrate {part.name} by {_mm(-deep.gap)}"
        return GripResult(False, f"{reason}; at most {_mm(limits.depth)} is allowed", stops)
    if sum(each.gap <= limits.gap for each in stops) < 2:
        apart = [each for each in stops if each.gap > limits.gap]
        reasons = []
        for each in sorted(apart, key=lambda contact: contact.gap)[:2]:
            how, distance = f"misses {part.name} by", _mm(max(each.closed_distance, 0.0))
            words = f"is {_mm(each.gap)} from {part.name}" if np.isfinite(each.gap) else f"{how} {distance}"
            reasons.append(f"the closed {each.finger} {words}")
        return GripResult(False, f"{' and '.join(reasons)}; a gap of at most {_mm(limits.gap)} is allowed", stops)
    # At least two contacts are large enough
    touching = [each.patch(limits) for each in paths if each.contact.gap <= limits.gap]
    contacts = tuple(patch.contact for patch in touching)
    area, overlap = (1 + SAMPLED) * limits.area, (1 + SAMPLED) * limits.overlap
    enough = [patch for patch in touching if patch.contact.contact_area >= area and patch.contact.overlap >= overlap]
    if len(enough) < 2:
        weak = min((patch.contact for patch in touching), key=lambda each: (each.contact_area, each.overlap))
        reason = (
            f"{weak.finger} touches {part.name} over {_mm2(weak.contact_area)} and {_mm(weak.overlap)} along the finger"
        )
        return GripResult(False, f"{reason}; at least {_mm2(area)} and {_mm(overlap)} are needed", contacts)
    # Their forces can balance
    if not balanced([(patch.points, patch.normal) for patch in enough], limits.angle):
        reason = f"{' and '.join(patch.contact.finger for patch in enough[:3])} do not press on opposite sides"
        cone = f"no forces within {np.degrees(limits.angle):.0f} deg of the contact normals balance"
        return GripResult(False, f"{reason} of {part.name}: {cone}", contacts)
    # The part withstands their force
    if limits.force is not None and limits.force_limit is not None and limits.force > limits.force_limit:
        reason = f"the fingers press with {limits.force:g} N; {part.name} withstands {limits.force_limit:g} N"
        return GripResult(False, reason, contacts)
    # What holds the part
    held = sorted((patch.contact for patch in enough), key=lambda each: -round(each.contact_area, AREA_DIGITS))
    least = min(held, key=lambda each: each.contact_area)
    overlap = min(each.overlap for each in held)
    direction = " ".join(f"{value + 0.0:.2f}" for value in np.round(held[0].closing_direction, 2))
    extent = f"at least {_mm2(least.contact_area)} and {_mm(overlap)} along the finger"
    message = f"{len(held)} fingers touch {part.name}, each over {extent}; closing direction ({direction})"
    patches = () if limits.force is None else tuple(enough)
    return GripResult(True, f"{message} in the tcp frame", tuple(held), patches=patches)


def _mm(metres: float) -> str:
    return f"{metres * 1e3:.2f} mm"


def _mm2(square_metres: float) -> str:
    return f"{square_metres * 1e6:.1f} mm^2"


# -- one finger -------------------------------------------------------------------------------------------------------


class _FingerPath:
    """The closing motion of a finger: the gap where it stops, and on request its contact patch."""

    def __init__(self, finger: MovingFinger, part: PlacedSurface, along: Array) -> None:
        # tcp_from_closing: z in the closing direction, y along the finger
        direction = finger.direction
        y = along - (along @ direction) * direction
        if np.linalg.norm(y) < 1e-6:  # the fingers close along the approach
            y = np.eye(3)[np.abs(direction).argmin()]
            y = y - (y @ direction) * direction
        y /= np.linalg.norm(y)
        self._finger = finger
        self._tcp_from_closing = np.stack([np.cross(y, direction), y, direction], axis=1)
        facing = [_Facing(body, part, self._tcp_from_closing, finger) for body in finger.surfaces]
        self._bodies = [(body, body.first_touch()) for body in facing if body.overlaps]
        # Where the finger first touches the part, on the lines or at a feature between them
        gap = min((start for _, start in self._bodies), default=np.inf)
        gap = min([gap, *(_earlier_contact(gap, body, part, finger) for body in finger.surfaces)])
        apart = [_distance(finger, place, part) for place in (finger.open, finger.closed)]
        x, y, z = finger.direction.tolist()
        unknown = 0.0 if np.isinf(gap) else np.nan
        self.contact = FingerContact(finger.name, (x, y, z), unknown, unknown, gap, *apart)

    def patch(self, limits: GripLimits) -> GripPatch:
        """The contact patch of a finger that touches the part."""
        most = self.contact.gap + limits.compliance
        found = [body.patch(most, np.cos(limits.angle)) for body, start in self._bodies if start <= most]
        points, *both = (np.concatenate([np.empty((0, 3)), *(each[k] for each in found)]) for k in (0, 2, 4))
        area = float(sum(each[1] for each in found))
        overlap = 0.0
        normal, into = (normals.mean(axis=0) if len(points) else np.array([0.0, 0.0, 1.0]) for normals in both)
        if len(points):
            overlap = float(np.ptp(points[:, 1])) + max(each[3] for each in found if len(each[0]))
        return GripPatch(
            replace(self.contact, contact_area=area, overlap=overlap),
            points @ self._tcp_from_closing.T,
            self._tcp_from_closing @ (normal / np.linalg.norm(normal)),
            self._tcp_from_closing @ (into / np.linalg.norm(into)),
            self._finger.branch,
        )


def _earlier_contact(gap: float, body: PlacedSurface, part: PlacedSurface, finger: MovingFinger) -> float:
    """The gap of an earlier contact than ``gap``, at a feature between the lines; inf if no earlier contact exists."""
    start, end = -finger.travel, gap if np.isfinite(gap) else 0.0
    if end <= start:
        return np.inf
    at = translated(finger.closed * body.pose, start * finger.direction)
    share = travel_to_touch(body.surface, at, *part, (end - start) * finger.direction)
    touch = start + share * (end - start)
    return touch if share < 1.0 and gap - touch > NOTICED else np.inf


class _Facing:
    """A body of a closed finger and the part, projected along the closing direction."""

    def __init__(self, body: PlacedSurface, part: PlacedSurface, tcp_from_closing: Array, finger: MovingFinger) -> None:
        here = SE3(tcp_from_closing, np.zeros(3)).inverse()
        self._body, self._part = body.moved(here * finger.closed), part.moved(here)
        self._back = max(finger.travel, 0.0)
        # The rectangle across the closing direction in which both can be
        ends = []
        for surface, at in (self._body, self._part):
            axes, offset = at.rotation[:2], at.translation[:2]
            ends.append((offset - surface.reaches(-axes), offset + surface.reaches(axes)))
        self._low, self._high = np.maximum(ends[0][0], ends[1][0]), np.minimum(ends[0][1], ends[1][1])

    @property
    def overlaps(self) -> bool:
        """Whether any line along the closing direction can intersect both."""
        return bool((self._high - self._low > LEAST_WIDTH).all())

    def first_touch(self) -> float:
        """Distance (m) from the final position of the body to the contact; negative if the contact is earlier."""
        low, high, count, best = self._low, self._high, COARSE, np.inf
        for _ in range(ZOOMS):
            lines, cell = _lines(low, high, count)
            gaps = self._gaps(lines)[0]
            if not np.isfinite(gaps).any():
                break
            best = min(best, float(gaps.min()))
            if np.ptp(gaps) <= LEAST_TRAVEL:  # two faces that are parallel here; infinite gaps are not
                break
            at = lines[int(gaps.argmin()), :2]
            low, high, count = np.maximum(at - 1.5 * cell, self._low), np.minimum(at + 1.5 * cell, self._high), ZOOMED
        return best

    def patch(self, most: float, cosine: float) -> tuple[Array, float, Array, float, Array]:
        """Points (N, 3) with gaps up to ``most``, area, normals (N, 3) of the finger, length of a line, part's normals.

        The normals of the finger are outward, and those (N, 3) of the part inward.
        """
        lines, cell = _lines(self._low, self._high, COARSE)
        gaps = self._gaps(lines)[0]
        near = lines[gaps <= most, :2]
        if not len(near):  # narrower than a cell
            near = lines[[int(gaps.argmin())], :2]
        low = np.maximum(near.min(axis=0) - cell, self._low)
        high = np.minimum(near.max(axis=0) + cell, self._high)
        lines, cell = _lines(low, high, FINE)
        gaps, depths, part_normals, finger_normals = self._gaps(lines)
        on = (gaps <= most) & (part_normals[:, 2] <= -cosine) & (finger_normals[:, 2] >= cosine)
        points = np.concatenate([lines[on, :2], depths[on, None]], axis=1)
        return points, float(on.sum() * cell.prod()), finger_normals[on], float(cell[1]), -part_normals[on]

    def _gaps(self, lines: Array) -> tuple[Array, Array, Array, Array]:
        """(G,) between the surfaces along each line, where the finger's is (G,), and both outward normals (G, 3)."""
        forward = np.array([0.0, 0.0, 1.0])
        back = self._body.enter(lines, -forward)
        leading = np.where(np.isfinite(back.depth), -back.depth, -np.inf)
        met = self._part.enter(lines, forward, leading - self._back)
        gaps = np.where(np.isfinite(leading) & np.isfinite(met.depth), met.depth - leading, np.inf)
        return gaps, leading, met.normals, back.normals


def _lines(low: Array, high: Array, count: int) -> tuple[Array, Array]:
    """(count^2, 3) points in the middle of the cells of a rectangle, and the sides (2,) of a cell."""
    cell = (high - low) / count
    x, y = (low[k] + cell[k] * (np.arange(count) + 0.5) for k in range(2))
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return np.concatenate([grid, np.zeros((len(grid), 1))], axis=1), cell


RIM, ACROSS = 256, 32
"""Number of lines around the rim, and along the diameter of the face."""


def grip_by_cup(cup: SuctionCup, tip: SE3, part: PlacedSurface) -> GripResult:
    """Whether the face of a cup at the tip, ``tcp_from_tip``, lies on a part."""
    # Where lines from the rim and from the face meet the part
    turns = np.arange(RIM) * 2 * np.pi / RIM
    rim = cup.radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    cells = cup.radius * ((np.arange(ACROSS) + 0.5) * 2 / ACROSS - 1)
    face = np.stack(np.meshgrid(cells, cells), axis=-1).reshape(-1, 2)
    face = face[np.linalg.norm(face, axis=1) <= cup.radius]
    points = np.concatenate([rim, face])
    lines = np.column_stack([points, np.zeros(len(points))])
    met_at = part.moved(tip.inverse()).enter(lines, np.array([0.0, 0.0, 1.0])).depth  # negative behind the face
    at_rim, at_face = np.split(met_at, [RIM])
    area = float(np.pi * cup.radius**2 * (np.abs(at_face) <= cup.gap).mean())
    met = np.isfinite(at_rim)
    if not met.all():
        contact = CupContact(area, np.inf, np.nan)
        words = f"{100 * (1 - met.mean()):.0f} % of the rim of the cup is not over {part.name}"
        return GripResult(False, f"{words}; all of it is needed", cup=contact)
    # The plane through the points at the rim
    gap = float(at_rim[np.abs(at_rim).argmax()])
    slope = np.linalg.lstsq(np.column_stack([rim, np.ones(RIM)]), at_rim, rcond=None)[0][:2]
    tilt = float(np.arctan(np.linalg.norm(slope)))
    # The rim is close enough, the face is parallel to the surface, and no air leaks
    x, y, z = (np.array([*-slope, 1.0]) * np.cos(tilt)).tolist()
    contact, held = CupContact(area, gap, tilt, (x, y, z)), False
    where = f"{abs(gap) * 1e3:.2f} mm {'from' if gap >= 0 else 'inside'} {part.name}"
    words = f"the rim of the cup is at most {where}, tilted by {np.degrees(tilt):.1f} deg"
    if abs(gap) > cup.gap:
        message = f"{words}; at most {cup.gap * 1e3:.2f} mm is allowed"
    elif tilt > cup.tilt:
        message = f"{words}; at most {np.degrees(cup.tilt):.1f} deg is allowed"
    elif not np.isfinite(at_face).all():
        message = f"{part.name} has a hole under the cup, through which air would leak"
    else:
        held, message = True, f"{words}; contact area {area * 1e6:.1f} mm^2"
    return GripResult(held, message, cup=contact)
