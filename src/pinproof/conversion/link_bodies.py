"""Bodies for the links of a DH table: plausible in look and weight, and the same for the eye and for the checker.

A table knows lengths and no shapes, so bodies are made by rule:

- A row's d and a become capsule-like arms, along z and along x: a cylinder with a ball at each end. A prismatic row's
  arm is a rod that reaches back to its joint at full stretch, and slides out behind it otherwise.
- Radius of a link: 4 % of the table's total length, but at most 30 % of its own length and of the nearest links with
  length on either side, and never more than that of a link before it, for arms taper. The ends of two links that are
  one link apart then keep 40 % of that link's length between their balls. It is a rule of thumb and no proof: a table
  that folds back on itself (d = 0.1, then d = -0.1) collides, and an offset elbow such as the Panda's does so when it
  is nearly straight.
- Each link with length has a housing about its joint's axis: a cylinder of 1.1 radii, 2.2 radii long.
- A row shorter than 2 % of the total length (or 1 mm) gets no body; the balls of its neighbours close the gap.
- The arm's foot and tip are trimmed: the first column stands on a flat foot 5 mm above dh_0, so that a table top at
  z = 0 is no contact; the last arm ends flat one radius before its end, so that a tool frame put on a surface is none
  either.
- Weights are those of solid cylinders at :data:`DENSITY`; a link without length weighs as a ball.

Everything drawn is collidable and the reverse: what a picture shows is what was checked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from pinproof.conversion.dh_layout import ahead
from pinproof.description.dh_table import DhTable

__all__ = ["DENSITY", "Body", "Shape", "link_bodies"]

Array = npt.NDArray[np.float64]

DENSITY = 1500.0
"""kg/m^3: aluminium housings, motors and gears, with the air between them. The generic arm comes to 13.4 kg;
where short wrist links keep the radii small, arms come out light (a UR5's table: 3.8 kg, the arm itself 18 kg)."""
RADIUS_OF_TOTAL = 0.04
RADIUS_OF_LENGTH = 0.3
HOUSING = 1.1
"""Radius and half length of a housing in radii of its link: it holds a ball of one radius, so none is drawn there."""
SHORT_OF_TOTAL = 0.02
SHORT = 1e-3
"""Metres; anything shorter is a tolerance of the build and not a link."""
FOOT_GAP = 5e-3
"""Metres between dh_0 and the underside of the foot, more than a collision margin (2 mm is usual)."""
FOOT_RADIUS = 1.5
FOOT_HEIGHT = 0.5
"""Radius and height of the foot in radii of the first link."""
BALL_RADIUS = 5e-3
"""Metres; the ball that a link weighs as where neither it nor a neighbour has a length."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A ball (length None) or a cylinder along its own z; ``origin`` is link_from_shape (4, 4), sizes are metres."""

    origin: Array
    radius: float
    length: float | None = None
    part: Literal["arm", "joint"] = "arm"


@dataclass(frozen=True, eq=False)
class Body:
    """The shapes of a link and its weight: mass in kg, centre of mass (3,) in m, inertia (3, 3) about it in kg m^2."""

    shapes: tuple[Shape, ...]
    mass: float
    centre: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class _Arm:
    """A straight piece of a link, from ``start`` to ``end`` (3,) in the link; the chain goes on at ``end``."""

    start: Array
    end: Array

    @property
    def length(self) -> float:
        return float(np.linalg.norm(self.end - self.start))


def link_bodies(table: DhTable) -> tuple[Body, ...]:
    """The bodies (n + 1) of base_link, link_1, ..., link_n, each in its own link; one without shapes never collides."""
    arms = [_arms(table, i) for i in range(len(table) + 1)]
    total = sum(arm.length for link in arms for arm in link)
    shortest = max(SHORT, SHORT_OF_TOTAL * total)
    arms = [link if any(arm.length >= shortest for arm in link) else [] for link in arms]
    arms = [[arm for arm in link if arm.length >= SHORT] for link in arms]
    radii = _radii([_span(link) for link in arms], total)
    tip = max((i for i, link in enumerate(arms) if link), default=-1)

    foot = _foot(table, arms, radii)
    bodies = []
    for i, (link, radius) in enumerate(zip(arms, radii, strict=True)):
        on_foot = i == 1 and foot is not None
        cylinders, balls = _cylinders(link, radius, on_foot=on_foot, is_tip=i == tip)
        turns = i > 0 and not table.rows[i - 1].is_prismatic
        shapes = [*cylinders, *balls]
        if link and turns and not on_foot:
            shapes.insert(0, Shape(_at(link[0].start), HOUSING * radius, 2 * HOUSING * radius, "joint"))
        elif link and not on_foot:
            shapes.insert(0, Shape(_at(link[0].start), radius, part="joint"))
        if i == 0:
            shapes = [replace(shape, origin=table.base @ shape.origin) for shape in shapes]
            shapes += [] if foot is None else [foot]
        bodies.append(Body(tuple(shapes), *_weight(cylinders, radius or _neighbour(radii, i))))
    return tuple(bodies)


def _arms(table: DhTable, i: int) -> list[_Arm]:
    """The straight pieces of link i (0: what is fixed to dh_0) in its frame, in the order of the chain."""
    points: list[Array] = []
    if table.convention == "standard":
        if i == 0:
            return []
        row = table.rows[i - 1]
        yaw = row.theta if row.is_prismatic else 0.0
        corner = np.array([0.0, 0.0, row.d])
        points = [np.zeros(3), corner, corner + row.a * np.array([math.cos(yaw), math.sin(yaw), 0.0])]
    else:
        # The row's d leads up to dh_i, and from there the next row's a and alpha belong to this link.
        d = table.rows[i - 1].d if i > 0 else 0.0
        a = table.rows[i].a if i < len(table) else 0.0
        start = -d if i > 0 and table.rows[i - 1].is_prismatic else 0.0  # a sliding link's own frame is dh_i
        points = [np.array([x, 0.0, start + z]) for x, z in ((0.0, 0.0), (0.0, d), (a, d))]
    if i > 0 and table.rows[i - 1].is_prismatic:
        # The joint stands at z = (start of d) - q; the rod must reach it at both ends of its stroke.
        row, first, bend = table.rows[i - 1], float(points[0][2]), float(points[1][2])
        reach = (bend, first - row.lower, first - row.upper)
        low, high = min(reach), max(reach)
        start, end = (low, high) if bend - low >= high - bend else (high, low)
        rod = _Arm(np.array([0.0, 0.0, start]), np.array([0.0, 0.0, end]))
        return [arm for arm in (rod, _Arm(points[1], points[2])) if arm.length > 0]
    return [arm for arm in (_Arm(points[0], points[1]), _Arm(points[1], points[2])) if arm.length > 0]


def _span(link: Sequence[_Arm]) -> float:
    """How far apart the two ends of a link stand."""
    return float(np.linalg.norm(link[-1].end - link[0].start)) if link else 0.0


def _radii(lengths: Sequence[float], total: float) -> list[float]:
    """Radius of each link; 0 for a link without length."""
    radii: list[float] = []
    for i, length in enumerate(lengths):
        before = next((x for x in reversed(lengths[:i]) if x > 0), math.inf)
        after = next((x for x in lengths[i + 1 :] if x > 0), math.inf)
        thinnest = min((r for r in radii if r > 0), default=math.inf)
        radii.append(min(RADIUS_OF_TOTAL * total, RADIUS_OF_LENGTH * min(length, before, after), thinnest))
    return radii


def _neighbour(radii: Sequence[float], i: int) -> float:
    """Radius of the nearest link before, else after, that has one."""
    return next((r for r in [*reversed(radii[:i]), *radii[i + 1 :]] if r > 0), BALL_RADIUS)


def _foot(table: DhTable, arms: Sequence[Sequence[_Arm]], radii: Sequence[float]) -> Shape | None:
    """A flat foot on base_link, where a column that turns about its own axis begins; else None."""
    row, radius = table.rows[0], radii[1]
    height = FOOT_HEIGHT * radius
    if arms[0] or not arms[1] or row.is_prismatic or abs(row.d) < 2 * (FOOT_GAP + height):
        return None
    centre = math.copysign(FOOT_GAP + height / 2, row.d)
    origin = table.base @ ahead(replace(row, d=0.0), table.convention) @ _at(np.array([0.0, 0.0, centre]))
    return Shape(origin, FOOT_RADIUS * radius, height, "joint")


def _cylinders(link: Sequence[_Arm], radius: float, *, on_foot: bool, is_tip: bool) -> tuple[list[Shape], list[Shape]]:
    """The cylinders of a link and the balls at their ends; the ball at the link's start is left to the caller."""
    cylinders, balls = [], []
    for k, arm in enumerate(link):
        direction = (arm.end - arm.start) / arm.length
        ends_here = is_tip and k == len(link) - 1
        start = FOOT_GAP if on_foot and k == 0 else 0.0
        end = arm.length - (min(radius, arm.length / 2) if ends_here else 0.0)
        middle = arm.start + (start + end) / 2 * direction
        cylinders.append(Shape(_along(middle, direction), radius, end - start))
        if not ends_here:
            balls.append(Shape(_at(arm.end), radius, part="joint"))
    return cylinders, balls


def _weight(cylinders: Sequence[Shape], ball_radius: float) -> tuple[float, Array, Array]:
    """Mass, centre of mass and inertia about it of solid cylinders (a ball if there are none), by the parallel axes."""
    if not cylinders:
        mass = DENSITY * 4 / 3 * math.pi * ball_radius**3
        return mass, np.zeros(3), 2 / 5 * mass * ball_radius**2 * np.eye(3)
    masses = [DENSITY * math.pi * c.radius**2 * (c.length or 0.0) for c in cylinders]
    mass = sum(masses)
    centre = np.array(sum(m * c.origin[:3, 3] for m, c in zip(masses, cylinders, strict=True)) / mass)
    inertia = np.zeros((3, 3))
    for m, c in zip(masses, cylinders, strict=True):
        across = m * (3 * c.radius**2 + (c.length or 0.0) ** 2) / 12
        own = c.origin[:3, :3] @ np.diag([across, across, m * c.radius**2 / 2]) @ c.origin[:3, :3].T
        arm = c.origin[:3, 3] - centre
        inertia += own + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return mass, centre, (inertia + inertia.T) / 2


def _at(point: Array) -> Array:
    origin = np.eye(4)
    origin[:3, 3] = point
    return origin


def _along(point: Array, direction: Array) -> Array:
    """A frame at ``point`` whose z is the unit vector ``direction``, which lies along z or across it."""
    origin = _at(point)
    if direction[2] == 0.0:
        z = np.array([0.0, 0.0, 1.0])
        origin[:3, :3] = np.column_stack([np.cross(z, direction), z, direction])
    return origin
