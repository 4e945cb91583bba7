"""Random robots and scenes of balls, boxes and capsules whose distances are computed here, by products of matrices."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

import pinproof as pp
from pinproof import _core
from pinproof.collision.certificates.path_constraints import PathConstraint
from pinproof.model import load_robot

Array = np.ndarray


@dataclass(frozen=True)
class Joint:
    """A joint whose value is ``multiplier * q[leader] + offset``; a held joint has no leader."""

    parent: str
    child: str
    prismatic: bool
    place: Array
    axis: Array
    leader: int | None
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Cell:
    """A checker, and what it checks as plain numbers: a link is one ball."""

    checker: pp.CollisionChecker
    joints: tuple[Joint, ...]
    balls: dict[str, tuple[str, Array, float]]
    """Link, centre in its frame and radius of each ball: those of the links and an attached one."""
    obstacles: dict[str, pp.Obstacle]

    @property
    def owners(self) -> list[tuple[str, str]]:
        """The owners of each checked pair."""
        bodies = self.checker.bodies
        return [(bodies[i].owner, bodies[j].owner) for i, j in self.checker.pairs]

    def frames(self, Q: Array) -> dict[str, Array]:
        """The placements (N, 4, 4) of the links at Q (N, n)."""
        frames = {"base": np.tile(np.eye(4), (len(Q), 1, 1))}
        for joint in self.joints:
            value = joint.offset + (0.0 if joint.leader is None else joint.multiplier * Q[:, joint.leader])
            move = np.tile(np.eye(4), (len(Q), 1, 1))
            if joint.prismatic:
                move[:, :3, 3] = np.multiply.outer(value, joint.axis)
            else:
                move[:, :3, :3] = rotations(joint.axis, np.broadcast_to(value, len(Q)))
            frames[joint.child] = frames[joint.parent] @ joint.place @ move
        return frames

    def centres(self, Q: Array) -> dict[str, Array]:
        """The centres (N, 3) of each ball at Q (N, n)."""
        frames = self.frames(Q)
        return {name: (frames[link] @ [*xyz, 1.0])[:, :3] for name, (link, xyz, _) in self.balls.items()}

    def distances(self, Q: Array) -> Array:
        """(N, P) the distance of each checked pair at Q (N, n); at most 0 if the two overlap."""
        at = self.centres(Q)
        found = []
        for one, other in self.owners:
            if other in self.balls:
                gap = np.linalg.norm(at[one] - at[other], axis=1) - self.balls[other][2]
            else:
                gap = distances_of_points(self.obstacles[other], at[one])
            found.append(gap - self.balls[one][2])
        return np.array(found).T


def rotations(axis: Array, angles: Array) -> Array:
    """The rotations (N, 3, 3) about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angles)[:, None, None] * cross + (1 - np.cos(angles))[:, None, None] * cross @ cross


def distances_of_points(obstacle: pp.Obstacle, points: Array) -> Array:
    """The distances (N,) of points from an obstacle, 0 inside a box."""
    local, shape = (points - obstacle.pose.translation) @ obstacle.pose.rotation, obstacle.shape
    if isinstance(shape, pp.HalfSpace):
        return local[:, 2]
    if isinstance(shape, pp.Box):
        return np.linalg.norm(np.maximum(np.abs(local) - np.array([shape.x, shape.y, shape.z]) / 2, 0.0), axis=1)
    if isinstance(shape, pp.Capsule):
        local[:, 2] -= np.clip(local[:, 2], -shape.length / 2, shape.length / 2)
    return np.linalg.norm(local, axis=1) - shape.radius


@cache
def cell(seed: int, kinds: str = "rprpr") -> Cell:
    """A chain of revolute (r) and prismatic (p) joints, a branch that follows the second joint, and a held one.

    The bodies are small and the space is large: most configurations are free.
    """
    rng = np.random.default_rng(seed)
    names = ["base", *(f"link{k}" for k in range(len(kinds)))]
    rows = [(a, b, kind, k, 1.0, 0.0) for k, ((a, b), kind) in enumerate(zip(pairwise(names), kinds, strict=True))]
    rows.append((names[2], "follower", "p" if kinds[1] == "p" else "r", 1, float(rng.choice([-2.0, 3.0])), 0.2))
    rows.append(("base", "held", "r", None, 0.0, float(rng.uniform(-1, 1))))
    joints, balls, parts, radius = [], {}, [], 0.02
    for link in [*names, "follower", "held"]:
        centre = rng.uniform(-0.05, 0.05, 3)
        balls[link] = (link, centre, radius * rng.uniform(0.5, 1.5))
        parts.append(
            f'<link name="{link}"><collision><origin xyz="{words(centre)}"/>'
            f'<geometry><sphere radius="{balls[link][2]!r}"/></geometry></collision></link>'
        )
    for parent, child, kind, leader, multiplier, offset in rows:
        axis, place = (
            rng.normal(size=3),
            pp.pose(rng.uniform([-0.25, -0.25, 0.0], [0.25, 0.25, 0.4]), rng.uniform(-3, 3, 3)),
        )
        axis /= np.linalg.norm(axis)
        xyz, rpy = np.split(pp.xyz_rpy(place), 2)
        mimic = f'<mimic joint="to_link1" multiplier="{multiplier}" offset="{offset}"/>' if child == "follower" else ""
        parts.append(
            f'<joint name="to_{child}" type="{"prismatic" if kind == "p" else "revolute"}"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="{words(xyz)}" rpy="{words(rpy)}"/><axis xyz="{words(axis)}"/>'
            f'<limit lower="-3" upper="3" velocity="1" effort="1"/>{mimic}</joint>'
        )
        joints.append(Joint(parent, child, kind == "p", place.homogeneous, axis, leader, multiplier, offset))
    robot = load_robot(f'<robot name="balls{seed}">{"".join(parts)}</robot>')
    arm = robot.arm(tcp=names[-1]).with_held({"to_held": joints[-1].offset})
    grip, radius = rng.uniform(-0.1, 0.1, 3), 0.015
    balls["held_ball"] = (names[-1], grip, radius)
    shapes = [pp.Sphere(0.03), pp.Box(0.05, 0.2, 0.1), pp.Capsule(0.03, 0.2), pp.Box(0.3, 0.02, 0.02), pp.HalfSpace()]
    places = [pp.pose(rng.uniform(-0.7, 0.7, 3), rng.uniform(-3, 3, 3)) for _ in shapes[:-1]] + [pp.pose((0, 0, -0.9))]
    obstacles = [pp.Obstacle(f"thing{k}", *each) for k, each in enumerate(zip(shapes, places, strict=True))]
    attached = [pp.Obstacle("held_ball", pp.Sphere(radius), pp.pose(grip))]
    checker = pp.CollisionChecker(arm, pp.Scene(obstacles), attached=attached)
    return Cell(checker, tuple(joints), balls, {each.name: each for each in obstacles})


def words(numbers: Array) -> str:
    """Numbers as text, to the last bit."""
    return " ".join(repr(float(x)) for x in numbers)


@dataclass
class PairMotion:
    """Two balls at a configuration, and the joints between them, from the first to the second."""

    joints: list[Joint]
    up: int
    axes: np.ndarray
    points: np.ndarray
    centres: np.ndarray
    radii: tuple[float, float]

    @classmethod
    def of(cls, known: Cell, names: tuple[str, str], q: np.ndarray) -> PairMotion:
        frames, moved_by = known.frames(q[None]), {joint.child: joint for joint in known.joints}

        def to_root(link: str) -> list[Joint]:
            found = []
            while link != "base":
                found.append(moved_by[link])
                link = moved_by[link].parent
            return [joint for joint in found if joint.leader is not None]

        links = [known.balls[name][0] if name in known.balls else "base" for name in names]
        up, down = map(to_root, links)
        common = {joint.child for joint in up} & {joint.child for joint in down}
        up, down = ([joint for joint in each if joint.child not in common] for each in (up, down))
        joints = [*up, *down[::-1]]
        places = [frames[joint.parent][0] @ joint.place for joint in joints]
        axes = np.array([place[:3, :3] @ joint.axis for place, joint in zip(places, joints, strict=True)])
        points = np.array([place[:3, 3] for place in places])
        at = known.centres(q[None])
        centres = [at[name][0] if name in at else known.obstacles[name].pose.translation for name in names]
        radii = tuple(known.balls[n][2] if n in known.balls else known.obstacles[n].shape.radius for n in names)
        return cls(joints, len(up), axes.reshape(-1, 3), points.reshape(-1, 3), np.array(centres), radii)

    @property
    def direction(self) -> np.ndarray:
        """The unit vector from the first to the second centre."""
        between = self.centres[1] - self.centres[0]
        return between / np.linalg.norm(between)

    def of_body(self, split: int) -> list[int]:
        """Which of the two balls each joint moves, seen from the link before joint ``split``."""
        return [0 if i < split else 1 for i in range(len(self.joints))]

    def deltas(self, delta: np.ndarray) -> list[float]:
        return [abs(joint.multiplier) * delta[joint.leader] for joint in self.joints]

    def radius(self, i: int, which: int) -> float:
        """The largest distance of a point of a ball from an axis."""
        if self.joints[i].prismatic:
            return 1.0
        return float(np.linalg.norm(np.cross(self.axes[i], self.centres[which] - self.points[i]))) + self.radii[which]

    def chord(self, i: int, delta: float) -> float:
        return delta if self.joints[i].prismatic else 2 * np.sin(min(delta, np.pi) / 2)

    def rough(self, delta: np.ndarray, split: int) -> float:
        """The simple bound of the approach (m)."""
        return sum(
            self.radius(i, which) * self.chord(i, d)
            for i, (which, d) in enumerate(zip(self.of_body(split), self.deltas(delta), strict=True))
        )

    def tight(
        self, control: np.ndarray, middle: np.ndarray, delta: np.ndarray, extra: np.ndarray, u: np.ndarray, split: int
    ) -> float:
        """The bound (m) of the decrease of the gap along u: to first order, curvature, inner rotations, tolerances."""
        of_body, total = self.of_body(split), 0.0
        first = []
        for point in control:
            along, slopes = 0.0, np.zeros((2, 3))
            for i, which in enumerate(of_body):
                joint = self.joints[i]
                theta = joint.multiplier * (point[joint.leader] - middle[joint.leader])
                carried = (i < self.up) == (which == 0)  # whether the joint's child side is that of this ball
                theta *= (1 if carried else -1) * (1 if which == 0 else -1)
                if joint.prismatic:
                    along += theta * float(u @ self.axes[i])
                else:
                    slope = theta * np.cross(u, self.axes[i])
                    slopes[which] += slope
                    along += float(slope @ (self.centres[which] - self.points[i]))
            grown = [np.linalg.norm(u + slopes[0]) - 1, np.linalg.norm(u - slopes[1]) - 1]
            first.append(along + self.radii[0] * grown[0] + self.radii[1] * grown[1])
        total += max(first)
        for order in (range(split)[::-1], range(split, len(self.joints))):
            turned = 0.0
            for i in order:
                joint, which = self.joints[i], of_body[i]
                x = abs(joint.multiplier) * (delta + extra)[joint.leader]
                bend = 0.0 if joint.prismatic else np.hypot(x - np.sin(x), 1 - np.cos(min(x, np.pi)))
                total += self.radius(i, which) * (bend + turned * self.chord(i, x))
                turned += 0.0 if joint.prismatic else self.chord(i, x)
                g = np.cross(u, self.axes[i])
                speed = abs(u @ self.axes[i])
                if not joint.prismatic:
                    speed = abs(g @ (self.centres[which] - self.points[i])) + self.radii[which] * np.linalg.norm(g)
                total += speed * abs(joint.multiplier) * extra[joint.leader]
        return total


def largest_error(constraint, known: Cell, q, control, delta, extra) -> float:
    """The bound of the error of docs/mathematics.md on a piece of a curve in a box about q (n,)."""
    count = len(q)
    frames, joints = known.frames(q[None]), known.joints[:count]
    tcp = frames[joints[-1].child][0]
    places = [frames[joint.parent][0] @ joint.place for joint in joints]
    axes = np.array([place[:3, :3] @ joint.axis for place, joint in zip(places, joints, strict=True)])
    points, slides = np.array([place[:3, 3] for place in places]), np.array([joint.prismatic for joint in joints])
    order, cone = range(count), None
    if constraint.name == "upright":
        start, cone = tcp[:3, :3] @ constraint.axis_in_tcp, np.array(constraint.up)
        rates = np.where(slides[:, None], 0.0, np.cross(axes, start))
    elif constraint.name == "within":
        start = (tcp @ [*constraint.point_in_tcp, 1.0])[:3]
        rates = np.where(slides[:, None], axes, np.cross(axes, start - points))
    else:  # relative to the tcp, the point moves by the inverse of each joint
        start, cone, order = constraint.point - tcp[:3, 3], tcp[:3, :3] @ constraint.axis_in_tcp, range(count)[::-1]
        rates = -np.where(slides[:, None], axes, np.cross(axes, constraint.point - points))
    rest = turned = 0.0
    for i in order:
        x, length = (delta + extra)[i], np.linalg.norm(rates[i])
        chord = x if slides[i] else 2 * np.sin(min(x, np.pi) / 2)
        bend = 0.0 if slides[i] else np.hypot(x - np.sin(x), 1 - np.cos(min(x, np.pi)))
        rest += length * (bend + turned * chord + extra[i])
        turned += 0.0 if slides[i] else chord
    images = start + (control - q) @ rates
    if cone is None:
        place = constraint.base_from_region
        local = (images - place.translation) @ place.rotation
        return np.linalg.norm(local - np.clip(local, constraint.low, constraint.high), axis=1).max() + rest
    along = images @ cone
    if rest >= along.min():
        return np.inf
    angles = np.arctan2(np.linalg.norm(np.cross(images, cone), axis=1), along)
    return angles.max() + np.arcsin(rest / along.min())


def constraint_bound(
    arm: pp.Arm, constraint: PathConstraint, control: np.ndarray, extra: np.ndarray
) -> tuple[float, float]:
    """The largest error that the core finds on a piece, at its start or elsewhere, and its bound on the whole piece.

    It is proven in a single interval within a tolerance of 1e9, so that the bound is that of the proof.
    """
    anything = copy(constraint)
    object.__setattr__(anything, "tolerance", 1e9)
    once = _core.ConstraintSettings(resolution=1e9, max_intervals=1)
    state = _core.prove_constraint(arm.chain, anything.compiled(), np.array([0.0, 1.0]), control[None], once, extra)
    return state.observed, state.proven if state.satisfied else np.inf
