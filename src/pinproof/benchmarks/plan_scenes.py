"""Our own scenes: table top, shelf, bin, cage and narrow slot, drawn at random around an arm and fit to its reach.

All lengths are multiples of the arm's reach r, all places are in the frame of its base, z up, the front along x. Under
the arm lies a floor just below the base. What the tool is asked for is a place and the direction of its z axis; it may
be turned about that axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinproof.collision import Box, Cylinder, Obstacle
from pinproof.spatial import SE3, pose

__all__ = ["OWN_SCENES", "Drawn"]

Rng = np.random.Generator
Draw = Callable[[Rng], SE3]

FLOOR = -0.02
"""Height of the floor: below what the base stands with."""

DOWN = np.pi
"""The pitch of a tool that points down; at pi / 2 it points outwards."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """A scene: its obstacles (base_from_obstacle), and where a start and a goal of the tool may be (base_from_tcp)."""

    obstacles: tuple[Obstacle, ...]
    start: Draw
    goal: Draw


def table_top(r: float, rng: Rng) -> Drawn:
    """Ten boxes and cans of up to 0.45 r on a table; the tool goes from among them on the left to the right."""
    things = [_floor(r)]
    for number in range(10):
        radius, height = rng.uniform(0.035, 0.07), rng.uniform(0.12, 0.45)
        distance, azimuth = rng.uniform(0.4, 0.85), rng.uniform(-1.7, 1.7)
        at = pose(_round(r, distance, azimuth, FLOOR + height / 2), (0, 0, rng.uniform(-np.pi, np.pi)))
        round_one = rng.random() < 0.5
        shape = Cylinder(radius * r, height * r) if round_one else Box(1.8 * radius * r, 1.4 * radius * r, height * r)
        things.append(Obstacle(f"{'can' if round_one else 'box'}_{number + 1}", shape, at))

    def tool(side: float) -> Draw:
        return lambda g: _tool(
            r, g.uniform(0.45, 0.75), side * g.uniform(0.4, 1.4), g.uniform(0.05, 0.15), DOWN - g.uniform(0, 0.3)
        )

    return Drawn(tuple(things), tool(1.0), tool(-1.0))


def shelf(r: float, rng: Rng) -> Drawn:
    """Three levels of two compartments, 0.36 r high; the tool goes from one into another."""
    front, depth, width, level = rng.uniform(0.5, 0.55), 0.35, 1.3, 0.36
    middle = front + depth / 2
    tall = 3 * level
    things = [_floor(r), _box(r, "back", (0.02, width, tall), (front + depth, 0, FLOOR + tall / 2))]
    things += [
        _box(r, f"board_{k}", (depth, width, 0.02), (middle, 0, FLOOR + k * level)) for k in (1, 2, 3)
    ]  # the lowest level stands on the floor
    uprights = (("left", width / 2), ("middle", rng.uniform(-0.1, 0.1)), ("right", -width / 2))
    things += [_box(r, name, (depth, 0.02, tall), (middle, y, FLOOR + tall / 2)) for name, y in uprights]
    places = rng.permutation(6)[:2]

    def tool(place: int) -> Draw:
        side, floor = (1.0 if place % 2 else -1.0), FLOOR + (place // 2) * level
        return lambda g: pose(
            (
                r * (front + g.uniform(0.05, 0.15)),
                r * side * g.uniform(0.2, 0.45),
                r * (floor + g.uniform(0.12, 0.22)),
            ),
            (0, DOWN / 2 + g.uniform(-0.1, 0.3), 0),
        )

    return Drawn(tuple(things), tool(int(places[0])), tool(int(places[1])))


def bins(r: float, rng: Rng) -> Drawn:
    """Two open bins, half a reach wide and up to 0.3 r deep; the tool goes out of one and into the other."""
    inside, wall = 0.5, 0.02
    tall = rng.uniform(0.2, 0.3)
    things, centres = [_floor(r)], []
    for side, name in ((1.0, "left"), (-1.0, "right")):
        distance, azimuth = rng.uniform(0.62, 0.67), side * rng.uniform(0.5, 0.8)
        at = pose(_round(r, distance, azimuth, FLOOR + tall / 2), (0, 0, azimuth + rng.uniform(-0.2, 0.2)))
        centres.append((distance, azimuth))
        away = (inside + wall) / 2
        for number, (x, y) in enumerate(((away, 0), (-away, 0), (0, away), (0, -away))):
            sides = (wall, inside, tall) if x else (inside + 2 * wall, wall, tall)
            place = at * pose((x * r, y * r, 0))
            things.append(Obstacle(f"{name}_wall_{number + 1}", Box(*(r * side for side in sides)), place))

    def tool(centre: tuple[float, float]) -> Draw:
        distance, azimuth = centre
        return lambda g: _tool(
            r,
            distance + g.uniform(-0.06, 0.06),
            azimuth + g.uniform(-0.06, 0.06),
            FLOOR + g.uniform(0.05, 0.2),
            DOWN - g.uniform(0, 0.2),
        )

    return Drawn(tuple(things), tool(centres[0]), tool(centres[1]))


def cage(r: float, rng: Rng) -> Drawn:
    """Seven posts, 0.43 r apart, and a roof around the arm; the tool goes from between two of them to two others."""
    posts, radius, height = 7, 0.5, 1.25
    apart = 2 * np.pi / posts
    phase = rng.uniform(0, apart)
    things = [_floor(r), _box(r, "roof", (1.1, 1.1, 0.02), (0, 0, height))]
    for number in range(posts):
        at = pose(_round(r, radius, phase + number * apart, (FLOOR + height) / 2))
        things.append(Obstacle(f"post_{number + 1}", Cylinder(0.02 * r, (height - FLOOR) * r), at))
    gaps = [phase + (number + 0.5) * apart for number in range(posts)]
    front = sorted(((gap + np.pi) % (2 * np.pi) - np.pi for gap in gaps), key=abs)[:4]
    first, second = rng.permutation(sorted(front))[:2]

    def tool(azimuth: float) -> Draw:
        return lambda g: _tool(r, g.uniform(0.62, 0.75), azimuth, g.uniform(0.25, 0.6), DOWN / 2 + g.uniform(-0.2, 0.3))

    return Drawn(tuple(things), tool(float(first)), tool(float(second)))


def narrow_slot(r: float, rng: Rng) -> Drawn:
    """A wall with a window of 0.45 r by 0.28 r; the tool goes from beside the arm through the window."""
    near, thick, tall, half = rng.uniform(0.45, 0.5), 0.04, 1.3, 0.9
    wide, high = 0.45, 0.28
    y, z = rng.uniform(-0.15, 0.15), rng.uniform(0.35, 0.5)
    x = near + thick / 2
    bottom, top, left, right = z - high / 2, z + high / 2, y + wide / 2, y - wide / 2
    things = [
        _floor(r),
        _box(r, "below", (thick, 2 * half, bottom - FLOOR), (x, 0, (bottom + FLOOR) / 2)),
        _box(r, "above", (thick, 2 * half, tall - top), (x, 0, (tall + top) / 2)),
        _box(r, "left", (thick, half - left, high), (x, (half + left) / 2, z)),
        _box(r, "right", (thick, half + right, high), (x, (right - half) / 2, z)),
    ]
    side = rng.choice([-1.0, 1.0])

    def start(g: Rng) -> SE3:
        return _tool(r, g.uniform(0.4, 0.6), side * g.uniform(1.3, 2.0), g.uniform(0.1, 0.5), DOWN - g.uniform(0, 0.6))

    def goal(g: Rng) -> SE3:
        place = (near + thick + g.uniform(0.06, 0.18), y + g.uniform(-0.1, 0.1), z + g.uniform(-0.05, 0.05))
        return pose([r * value for value in place], (0, DOWN / 2 + g.uniform(-0.1, 0.1), g.uniform(-0.2, 0.2)))

    return Drawn(tuple(things), start, goal)


OWN_SCENES: dict[str, Callable[[float, Rng], Drawn]] = {
    "table_top": table_top,
    "shelf": shelf,
    "bin": bins,
    "cage": cage,
    "narrow_slot": narrow_slot,
}
"""The scenes by name: each draws one for a reach in metres."""


def _floor(r: float) -> Obstacle:
    return _box(r, "floor", (2.6, 2.6, 0.04), (0, 0, FLOOR - 0.02))


def _box(r: float, name: str, sides: tuple[float, float, float], at: tuple[float, float, float]) -> Obstacle:
    return Obstacle(name, Box(*(r * side for side in sides)), pose([r * value for value in at]))


def _round(r: float, distance: float, azimuth: float, z: float) -> tuple[float, float, float]:
    return r * distance * float(np.cos(azimuth)), r * distance * float(np.sin(azimuth)), r * z


def _tool(r: float, distance: float, azimuth: float, z: float, pitch: float) -> SE3:
    """base_from_tcp with z at a pitch, away from the base."""
    return pose(_round(r, distance, azimuth, z), (0, pitch, azimuth))
