"""What a robot brings to a cell: its hand, the areas that it reaches from above, and a home."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from pinproof.collision import CollisionChecker, LineSurface, body_distance, link_bodies
from pinproof.description import LinkGeometry, moved_by
from pinproof.errors import InputError
from pinproof.ik import Clik
from pinproof.model import Arm
from pinproof.picks import PlacedSurface, ReachRegion, Tool, limit_margin, reach_map, tool_orientations
from pinproof.spatial import SE3, Array, pose, xyz_rpy

LEAST_OPENING, VALUES = 1e-3, 9
"""Metres by which a gripper joint changes the distance of two links, measured at this number of its values."""

MOST_JOINTS = 3
"""Largest number of joints of a hand that is a gripper."""

AT_TIP, MOST_CUP, LEAST_TOOL = 3e-3, 0.05, 0.02
"""Metres: the depth of the end of a tool that is its face, the largest radius of a face that is a cup, and the least
length of a tool; a shorter link is a mark of the tcp."""

SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Shares of the range of gripper joints at which the hand is regarded."""

LANCE, LANCE_CUP = 0.1, (2e-3, 1e-2)
"""Metres: the length of the suction lance of a bare flange, and the least and largest radius of its cup."""

SAMPLES, HEIGHTS, CELLS, SPINS = 2000, 7, 28, 4
"""Numbers of random configurations that bound the region of the tip, and of heights, cells along a side, and rotations
about the vertical at which its reach is examined."""

NEARLY_DOWN, MORE_OFTEN = 0.97, 3
"""The least cosine of the angle of an axis that points down, and how much more often than z another one does if it is
the axis along which the tool grasps."""

ABOVE = 0.02
"""Metres of the tip above a plane at which reach is examined."""

FORWARD, LOW = 0.2, 0.5
"""Largest advantages, as shares, of an area in front of the robot over one beside it, and of a low over a high one."""

CLEAR = 0.05
"""Metres: a home is no better with more clearance."""


class HandLinks:
    """The links behind the last joint of an arm, the ``flange`` included, with the hulls of their bodies."""

    def __init__(self, arm: Arm) -> None:
        urdf, self.joints = arm.robot.urdf, (*arm.joint_names, *arm.followers)
        self.carrier = moved_by(urdf, arm.tcp, self.joints)
        self.flange = urdf.joints[self.carrier].child
        self.bodies: dict[str, list[PlacedSurface]] = {}
        for geometry in urdf.collisions:
            if moved_by(urdf, geometry.link, self.joints) == self.carrier:
                self.bodies.setdefault(geometry.link, []).extend(_hulls(geometry))

    def placed(self, arm: Arm, link: str) -> list[PlacedSurface]:
        """The bodies of a link in the frame of the tcp, for an arm with any values of its other joints."""
        tcp_from_link = arm.forward_kinematics(arm.home).actInv(arm.frame_placement(arm.home, link))
        return [body.moved(tcp_from_link) for body in self.bodies[link]]

    def points(self, arm: Arm, links: Iterable[str]) -> Array:
        """(N, 3) points in the frame of the tcp whose hull contains links."""
        return np.concatenate([np.empty((0, 3)), *(body.points for link in links for body in self.placed(arm, link))])


def _hulls(geometry: LinkGeometry) -> list[PlacedSurface]:
    """The hulls of the bodies of a link, in the frame of the link."""
    return [PlacedSurface(LineSurface.of_body(body), body.link_from_body) for body in link_bodies(geometry, "hull")]


def hand_points(arm: Arm, tool: Tool) -> tuple[Array, Array]:
    """(N, 3) points in the frame of the tip whose hull contains the open hand, and those of it at any opening.

    Of a hand without bodies, the tip.
    """
    links, joints = HandLinks(arm), arm.robot.urdf.joints
    ends = {name: (joints[name].lower or 0.0, joints[name].upper or 0.0) for name in tool.grip}
    arms = [arm.with_held({name: low + share * (high - low) for name, (low, high) in ends.items()}) for share in SHARES]
    bodies = [PlacedSurface(LineSurface.of_obstacle(body), body.pose).points for body in tool.open_tool]
    open_hand = np.concatenate([links.points(arm, links.bodies), *bodies])
    if not len(open_hand):  # a hand without collision geometry
        open_hand = tool.tip.translation[np.newaxis]
    every = np.concatenate([open_hand, *(links.points(each, links.bodies) for each in arms)])
    back = tool.tip.inverse()
    return open_hand @ back.rotation.T + back.translation, every @ back.rotation.T + back.translation


class OwnHand(NamedTuple):
    """The hand of a robot: keys of a tool file, why they are so, and the largest distance (m) of its fingers."""

    keys: Mapping[str, Any] = MappingProxyType({})
    why: Mapping[str, str] = MappingProxyType({})
    opening: float = 0.0


def recognise_hand(arm: Arm, narrowest: float) -> OwnHand:
    """The hand that the description of a robot has behind the last joint of an arm.

    Fingers are links of the hand that a joint outside the arm moves: it is open where the distance of the two links is
    largest that changes most. Without fingers, a link that is mounted on the flange ends in the tip, with a suction cup
    if it is narrow there. A bare flange is given a lance with a cup for parts with this ``narrowest`` side (m).
    """
    urdf, links = arm.robot.urdf, HandLinks(arm)
    # Each joint outside the arm is moved through its range, and the distances of the links on it are measured
    leaders = [
        name
        for name in arm.held
        if (joint := urdf.joints[name]).mimic is None and None not in (joint.lower, joint.upper)
        if moved_by(urdf, joint.parent, links.joints) == links.carrier
        if any(moved_by(urdf, link, [name]) for link in links.bodies)
    ]
    if len(leaders) > MOST_JOINTS:
        raise InputError(
            f"the hand of {arm.robot.name!r} has {len(leaders)} joints; only grippers with at most "
            f"{MOST_JOINTS} are recognised, so state the fingers in a tool file (--tool, tool=)"
        )
    fingers = [link for link in links.bodies if moved_by(urdf, link, leaders)]
    keys: dict[str, Any] = {}
    why: dict[str, str] = {}
    opening, closing = 0.0, np.zeros(3)
    for name in leaders:
        values = np.linspace(urdf.joints[name].lower, urdf.joints[name].upper, VALUES).tolist()  # type: ignore[arg-type]
        arms = [arm.with_held({name: value}) for value in values]
        pairs = [
            (a, b) for a in fingers for b in fingers if a < b and moved_by(urdf, a, [name]) != moved_by(urdf, b, [name])
        ]
        distances = np.array(
            [
                [
                    min(body_distance(*one, *other) for one in links.placed(each, a) for other in links.placed(each, b))
                    for each in arms
                ]
                for a, b in pairs
            ]
        ).reshape(len(pairs), VALUES)
        change = np.ptp(distances, axis=1)
        if not len(pairs) or change.max() < LEAST_OPENING:
            continue
        (a, b), measured = pairs[int(change.argmax())], distances[change.argmax()]
        widest = int(measured.argmax())
        opening = max(opening, float(measured[widest]))
        one, other = (links.points(arms[widest], [link]).mean(axis=0) for link in (a, b))
        closing = other - one
        keys.setdefault("held", {})[name] = {"open": round(values[widest], 9)}
        narrow, wide = (f"{1e3 * max(float(value), 0.0):.3g}" for value in (measured.min(), measured.max()))
        text = f"{name} moves {a} and {b} from {narrow} to {wide} mm apart; the closed value follows from contact."
        why["held"] = f"{why.get('held', '')} {text}".strip()

    # The approach is along the axis of the tcp in which the hand extends from the last joint
    last = arm.forward_kinematics(arm.home).actInv(arm.frame_placement(arm.home, links.flange)).translation
    end = links.points(arm, fingers).mean(axis=0) if "held" in keys else np.zeros(3)
    axes = [axis for axis in (*np.eye(3), *-np.eye(3)) if abs(axis @ closing) <= 0.5 * np.linalg.norm(closing)]
    approach = max(axes, key=lambda axis: (round(float(axis @ (end - last)), 3), axis[2]))
    rotation, length = tool_orientations(approach, 1)[0], 0.0
    others = [link for link in links.bodies if link not in (*fingers, links.flange)]
    mounted = [link for link in others if np.ptp(links.points(arm, [link]) @ approach) > LEAST_TOOL]
    if mounted:
        keys["gripper"], why["gripper"] = mounted, "Links of the hand that may touch the part, as its fingers may."
    if "held" not in keys and mounted:
        ends = links.points(arm, mounted)
        length = round(float((ends @ approach).max()), 6)
        face = ends[ends @ approach > length - AT_TIP]
        radius = round(float(np.linalg.norm(face - np.outer(face @ approach, approach), axis=1).max()), 6)
        why["tip"] = f"The end of {mounted[-1]}; its z axis is the direction of the approach."
        if radius <= MOST_CUP:
            keys["cup"], why["cup"] = {"radius": radius}, f"The end of {mounted[-1]} is taken as a suction cup."
    elif "held" not in keys:
        length, radius = LANCE, round(float(np.clip(narrowest / 4, *LANCE_CUP)), 6)
        body = {"cylinder": {"radius": radius, "length": LANCE}, **stated_pose(SE3(rotation, LANCE / 2 * approach))}
        keys["tool"], keys["cup"] = [{"name": "lance", **body}], {"radius": radius}
        why["tool"] = "Assumed, because the robot has no tool: a suction lance. State your tool with --tool."
        why["cup"] = "Its cup has a quarter of the narrowest side of the parts as its radius, from 2 to 10 mm."
        why["tip"] = "The end of the lance; its z axis is the direction of the approach."
    if "held" not in keys or approach[2] < 0.5:
        keys["tip"] = stated_pose(SE3(rotation, length * approach))
        why.setdefault("tip", "Its z axis is the direction of the approach.")
    return OwnHand(keys, why, opening)


def stated_pose(placed: SE3) -> dict[str, list[float]]:
    """A pose as keys of a file, with nine decimals."""
    stated = (np.round(xyz_rpy(placed), 9) + 0.0).tolist()
    return {"xyz": stated[:3], "rpy": stated[3:]}


def fixed_box(arm: Arm) -> tuple[Array, Array]:
    """The lower and upper corner (3,) of all links that no revolute joint of the arm moves, wherever they are."""
    turning = [name for name, angular in zip(arm.joint_names, arm.angular, strict=True) if angular]
    corners = [np.zeros((1, 3))]
    for geometry in arm.robot.urdf.collisions:
        if not moved_by(arm.robot.urdf, geometry.link, turning):
            places = [arm.root_from_base * arm.frame_placement(q, geometry.link) for q in arm.limits.sampling_range()]
            corners += [body.moved(place).points for body in _hulls(geometry) for place in places]
    every = np.concatenate(corners)
    return every.min(axis=0), every.max(axis=0)


def work_areas(checker: CollisionChecker, tip: SE3, size: Array, lift: float, around: float, rng: int) -> list[SE3]:
    """Rectangles of ``size`` (2,) (m) that the tip reaches pointing down, as ``root_from_area``, the best ones first.

    Every cell of a rectangle has a free configuration, and one ``lift`` (m) above it with the same orientation. With
    ``around`` (m) on all sides, it is beside the links that no revolute joint moves. The best one has the largest mean
    of Yoshikawa's measure, with a preference for those in front of the robot (+x of the root) and for low ones.
    """
    # The region of the tip, and heights in it from the ground, or from its lower end, upwards
    arm = checker.arm
    sampled = np.random.default_rng(rng).uniform(*arm.limits.sampling_range(), (SAMPLES, arm.dof))
    tips = (arm.root_from_base.homogeneous @ arm.forward_kinematics_batch(sampled) @ tip.homogeneous)[:, :3, 3]
    low, high = tips.min(axis=0), tips.max(axis=0)
    ground = max(low[2], 0.0) if high[2] > lift else low[2]
    step = max(float((high - low)[:2].max()) / CELLS, 0.02)
    down, (fixed_low, fixed_high) = tool_orientations(spins=SPINS), fixed_box(arm)
    found: list[tuple[float, SE3]] = []
    for height in np.linspace(ground, high[2] - lift, HEIGHTS + 1)[:-1].round(3).tolist():
        # Where the tip reaches the plane and, from there, the point above it
        region = ReachRegion.box([*low[:2], height + ABOVE], [*high[:2], height + ABOVE], step)
        near = reach_map(checker, region, down, tip=tip, attempts=2, rng=rng)
        rows = np.flatnonzero(near.free.any(axis=1))
        if not len(rows):
            continue
        over = ReachRegion(region.points[rows] + [0.0, 0.0, lift])
        far = reach_map(checker, over, down, tip=tip, attempts=2, rng=rng)
        reached, quality = np.zeros(len(region), dtype=bool), np.nan_to_num(near.best_manipulability)
        reached[rows] = (near.free[rows] & far.free).any(axis=1)
        shape = region.shape[:2]
        steps = (high - low)[:2] / (np.array(shape) - 1)
        # The best rectangle along either axis
        for turn in (0.0, -np.pi / 2):
            sides = size if turn == 0.0 else size[::-1]
            window = [int(np.ceil(side / each)) + 1 for side, each in zip(sides, steps, strict=True)]
            if window[0] > shape[0] or window[1] > shape[1]:
                continue
            whole = sliding_window_view(reached.reshape(shape), window).all(axis=(2, 3))
            mean = sliding_window_view(quality.reshape(shape), window).mean(axis=(2, 3))
            middle = low[:2] + steps * (np.indices(whole.shape).transpose(1, 2, 0) + (np.array(window) - 1) / 2)
            reach = sides / 2 + around
            beside = ((middle + reach < fixed_low[:2]) | (middle - reach > fixed_high[:2])).any(axis=-1)
            away = middle - arm.root_from_base.translation[:2]
            ahead = away[..., 0] / np.maximum(np.linalg.norm(away, axis=-1), step)
            worth = mean * (1.0 + FORWARD * ahead) * (1.0 - LOW * (height - ground) / (high[2] - ground))
            score = np.where(whole & beside, worth, 0.0)
            if score.max() > 0.0:
                x, y = middle[np.unravel_index(score.argmax(), score.shape)].round(3).tolist()
                found.append((float(score.max()), pose([x, y, height], [0.0, 0.0, turn])))
    return [area for _, area in sorted(found, key=lambda rated: -rated[0])]


ALONG = {"x": "[0, pi/2, 0] or [0, -pi/2, 0]", "y": "[-pi/2, 0, 0] or [pi/2, 0, 0]", "z": "[pi, 0, 0]"}
"""Roll, pitch and yaw of a tip whose z axis is an axis of the tcp, or opposite to it."""


def down_hint(arm: Arm, rng: int) -> str:
    """Which axis of the tcp points up or down much more often than z points down, and the tip for it; else empty."""
    sampled = np.random.default_rng(rng).uniform(*arm.limits.sampling_range(), (SAMPLES, arm.dof))
    upwards = (arm.root_from_base.homogeneous @ arm.forward_kinematics_batch(sampled))[:, 2, :3]
    often = (np.abs(upwards) > NEARLY_DOWN).sum(axis=0)
    axis = int(often.argmax())
    if often[axis] <= MORE_OFTEN * (upwards[:, 2] < -NEARLY_DOWN).sum():
        return ""
    name = "xyz"[axis]
    return (
        f". A tool grasps along z of its tip, and z of {arm.tcp!r} rarely points down, but its {name} axis does in one "
        f"direction: state a tool file (--tool, tool=) with `tip: {{rpy: ...}}`, {ALONG[name]}"
    )


def find_home(checker: CollisionChecker, tip: SE3, area: SE3, lift: float, rng: int) -> tuple[Array, str] | None:
    """A home (n,) and why it was chosen: that of the robot if it is free, else one above an area; None without one.

    Above the area and between it and the base, the tip points down. The home has the largest product of the least
    distance of a joint from its limits (1 in the middle), the smallest singular value of the Jacobian, and the
    clearance up to :data:`CLEAR`.
    """
    arm = checker.arm
    if set(arm.joint_names) <= set(arm.robot.home) and checker.is_free(arm.home):
        return arm.home, "that of the robot, which is collision-free in this cell"
    base = arm.root_from_base
    targets = [
        (base.actInv(SE3(turn, np.array([x, y, area.translation[2] + lift + height]))) * tip.inverse()).homogeneous
        for share in (1.0, 0.8, 0.6)
        for x, y in [base.translation[:2] + share * (area.translation - base.translation)[:2]]
        for height in (0.0, 0.05, 0.1, 0.2, 0.3)
        for turn in tool_orientations(spins=2 * SPINS)
    ]
    best, home = 0.0, None
    for seed in (rng, rng + 1):
        solved = Clik().solve_batch(arm, np.array(targets), rng=seed, accept=checker.is_free)
        for q in solved.q[solved.ok]:
            score = float(limit_margin(arm, q)) * arm.singularity(q).smallest * min(checker.clearance(q), CLEAR)
            if score > best:
                best, home = score, q
    return None if home is None else (home.round(4), "found above the parts, far from joint limits and singularities")
