"""Grasps by a suction cup on flat places of a part, and by a plain tip, such as a magnet, on any.

The face of the cup lies on the surface at a point, across the normal there; the judge of the grip decides whether it
seals (:func:`~pinproof.picks.judging.grip.grip_by_cup`). Lines on rings outside of the rim measure how far the surface
continues, which is the distance of the seal from edges and holes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.picks.grasps.hand_maps import HandMaps
from pinproof.picks.grasps.part_surface import Candidates, PartSurface, spread
from pinproof.picks.input.settings import SuctionCup
from pinproof.picks.judging.grip import PlacedSurface, grip_by_cup
from pinproof.spatial import SE3, Array

RINGS, AROUND = 10, 48
"""Number of rings outside of the rim, up to twice its radius, and of lines on each."""

NEAREST_EDGE = 5e-4
"""Metres: the seal of a proposal is at least this far from edges and holes."""

CHUNK = 64
"""Number of places that are tried at a time."""

AHEAD = 5e-4
"""Metres by which the hand may reach beyond the face: a lip is soft."""

MOST_TRIED = 6
"""Largest number of places that are tried, as a multiple of the number of grasps."""

SHRUNK, TRIED_SMALLER = 0.8, 64
"""Factor by which the radius of a cup is reduced to find the largest flat circle, and number of places for each."""


def point_grasps(
    part: PartSurface, hand: HandMaps, cup: SuctionCup | None, count: int, rng: np.random.Generator
) -> Candidates:
    """Up to ``count`` grasps that are spread over the surface; with a ``cup``, only where it seals.

    InputError if the cup seals nowhere; the message states the largest flat circle that was found.
    """
    places = np.arange(len(part.points)) if cup is None else part.flat_points(cup.radius, cup.gap)
    every = _hands_at(part, places, cup, rng)
    order = np.empty(0, dtype=np.int64)
    if len(places):
        features = np.concatenate([part.points[places] / part.size, part.normals[places] / 2], axis=1)
        order = spread(features, int(np.linalg.norm(part.points[places] - part.centre, axis=1).argmin()), rng)
    kept, sealed = list[int](), False
    allowed = AHEAD if cup is None else max(AHEAD, cup.gap, cup.highest)
    for start in range(0, min(len(order), MOST_TRIED * count), CHUNK):
        rows = order[start : start + CHUNK] if len(kept) < count else order[:0]
        for row in rows if cup is None else rows[_rim_is_near(part, every.chosen(rows), cup)]:
            rotation, point = every.rotations[row], every.translations[row]
            if cup is not None:
                every.edges[row] = edge = seal(part, SE3(rotation, point), cup)
                sealed |= edge > 0.0
                if edge < NEAREST_EDGE:
                    continue
            # Nothing of the hand is in the part at the grasp and on the straight approach
            own = (part.cloud - point) @ rotation
            if not (own[:, 2] < hand.grid.lookup(hand.front, own[:, :2], -np.inf) - allowed).any():
                kept.append(row)
    if cup is None or sealed:
        return every.chosen(np.array(kept[:count], dtype=np.int64))
    # The largest flat circle
    radius = cup.radius
    while radius > 0.02 * cup.radius:
        radius *= SHRUNK
        smaller = replace(cup, radius=radius)
        hands = _hands_at(part, rng.permutation(part.flat_points(radius, cup.gap))[:TRIED_SMALLER], smaller, rng)
        placed = zip(hands.rotations, hands.translations, strict=True)
        if any(seal(part, SE3(*one), smaller) for one in placed):
            raise InputError(
                f"{part.obstacle.name} has no place where a cup with a radius of {cup.radius * 1e3:.1f} mm seals; the "
                f"largest flat circle that was found has a radius of about {radius * 1e3:.1f} mm; use a smaller cup, "
                "bellows with a larger gap, or fingers"
            )
    raise InputError(f"{part.obstacle.name} has no place that is flat enough for a cup; use fingers")


def _hands_at(
    part: PartSurface, rows: npt.NDArray[np.int64], cup: SuctionCup | None, rng: np.random.Generator
) -> Candidates:
    """Hands with the tip on points of a part and z along the inward normals, at random rotations about them."""
    points, inward = part.points[rows], -part.normals[rows]
    across = rng.normal(size=inward.shape)
    x = across - np.einsum("ni,ni->n", across, inward)[:, None] * inward
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    rotations = np.stack([x, np.cross(inward, x), inward], axis=2)
    areas = np.full(len(rows), np.nan if cup is None else np.pi * cup.radius**2)
    widths, edges = np.full((2, len(rows)), np.nan)
    return Candidates(rotations, points, points[:, None], inward[:, None], areas, widths, edges)


def _circle(radii: Array | float) -> Array:
    """(..., AROUND, 3) points on circles about the z axis."""
    angles = np.arange(AROUND) * 2 * np.pi / AROUND
    unit = np.stack([np.cos(angles), np.sin(angles), np.zeros(AROUND)], axis=1)
    return np.asarray(radii)[..., None, None] * unit


def _rim_is_near(part: PartSurface, hands: Candidates, cup: SuctionCup) -> npt.NDArray[np.bool_]:
    """(N,) whether the surface continues to a little outside of the rim; one set of lines for equal normals."""
    rim = _circle(cup.radius + NEAREST_EDGE)
    _, group = np.unique(hands.rotations[:, :, 2].round(7), axis=0, return_inverse=True)
    near = np.zeros(len(group), dtype=bool)
    for number in np.unique(group):
        rows = np.flatnonzero(group.reshape(-1) == number)
        lines = rim @ hands.rotations[rows].swapaxes(1, 2) + hands.translations[rows, None]
        depth = part.surface.enter(lines.reshape(-1, 3), hands.rotations[rows[0], :, 2], -2 * cup.gap).depth
        near[rows] = (np.abs(depth.reshape(len(rows), AROUND)) <= 1.5 * cup.gap).all(axis=1)
    return near


def seal(part: PartSurface, part_from_tip: SE3, cup: SuctionCup) -> float:
    """How far (m) the rim of a cup is from the nearest edge or hole, at most its radius; 0 if it does not seal."""
    if not grip_by_cup(cup, SE3.Identity(), PlacedSurface(part.surface, part_from_tip.inverse())).held:
        return 0.0
    radii = cup.radius * np.linspace(1.0, 2.0, RINGS + 1)
    lines = _circle(radii).reshape(-1, 3) @ part_from_tip.rotation.T + part_from_tip.translation
    met = part.surface.enter(lines, np.array(part_from_tip.rotation[:, 2])).depth.reshape(RINGS + 1, AROUND)
    # curved surfaces leave the plane of the face farther out, by the square of the radius
    beyond = np.any(np.abs(met) > cup.gap * (radii[:, None] / cup.radius) ** 2, axis=1)
    return float(radii[beyond.argmax() - 1] - cup.radius) if beyond[1:].any() else cup.radius
