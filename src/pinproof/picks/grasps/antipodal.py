"""Antipodal grasps of two fingers: opposite points of a part with normals in the friction cone, and hands about them.

Parallel lines along many directions join points of the surface to those that an opposite finger touches first (V.-D.
Nguyen, 1988, "Constructing force-closure grasps", IJRR 7(3)): two contacts with friction hold a part if the line
between them is in both cones. Around each pair, lines on rings measure where the pads would touch, for several
rotations about the closing axis; rotations by a step of the rings need no further lines.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import spiral_directions
from pinproof.errors import InputError
from pinproof.picks.grasps.hand_maps import FingerMaps, HandMaps
from pinproof.picks.grasps.part_surface import Candidates, PartSurface, spread
from pinproof.spatial import Array

DIRECTIONS, SPHERE = 72, 32
"""Largest number of closing directions from normals of the part, and number that are spread over a half sphere."""

PER_DIRECTION, PAIRS = 24, 128
"""Number of points that are paired along each direction, and of pairs that are examined further."""

RINGS, AROUND, TURN = 11, 24, 2
"""Number of rings of lines around a pair, of lines on each ring, and of these between two rotations of the hand."""

DEPTHS = (0.2, 0.5)
"""Places of the pair on the pads, as shares of their length from the end of the fingers; a further one is just inside
of the end, for parts that lie on a floor."""

INNERMOST = 4e-4
"""Metres: radius of the first ring."""

WITHIN = 0.9
"""Share of the limits of angle and compliance that proposals use, so that the judge of the grip agrees."""

BEYOND = 1.5
"""Proposals have contacts of this multiple of the smallest area and overlap."""

FINE, CERTAIN = 24, 1.2
"""Number of lines along each side of a pad of a proposal, and the multiple of the smallest area and overlap there."""

THINNEST = 1e-4
"""Metres: thinner places are the rounding of a line that meets one point twice."""

CLEAR = 5e-4
"""Metres between an open finger and the part, at least."""

PRESSED = 2e-4
"""Metres by which the points of a part may be inside the closed fingers: less than the compliance of pads."""

FEW = 8
"""Every so manieth point of a part is tried first."""

CHUNK = 64
"""Number of hands whose contact with the part is computed at a time."""


def find_pairs(
    part: PartSurface, opening: float, narrowest: float, angle: float, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Opposite points of a part for fingers that open to ``opening`` (m) and close to ``narrowest`` (m).

    A finger that closes along the third array (N, 3) touches the first points (N, 3), the other finger the second ones.

    InputError if no such points exist, with the reason.
    """
    # Closing directions: those of the normals, spread over a half sphere, and a few others for tapered parts
    folded = part.normals * np.where(part.normals[:, 2:] + 1e-3 * part.normals[:, 1:2] < 0.0, -1.0, 1.0)
    tensors = np.einsum("ni,nj->nij", folded, folded).reshape(-1, 9)
    around = spiral_directions(2 * SPHERE)
    directions = np.concatenate([folded[spread(tensors, 0, rng, DIRECTIONS)], np.eye(3), around[around[:, 2] > 0.0]])
    directions = np.unique(directions.round(6), axis=0)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    cosine, found = np.cos(WITHIN * angle), list[tuple[Array, Array, Array]]()
    least = float(np.inf)
    for direction in directions:
        facing = np.flatnonzero(part.normals @ -direction >= cosine)
        if not len(facing):
            continue
        start = part.points[rng.choice(facing, min(PER_DIRECTION, len(facing)), replace=False)]
        # The second finger comes from the opening, and then the first one to where it has stopped
        back = part.surface.enter(start + opening * direction, -direction, 0.0)
        met = np.isfinite(back.depth) & (back.normals @ direction >= cosine)
        second = (start + (opening - back.depth)[:, None] * direction)[met]
        ahead = part.surface.enter(second - opening * direction, direction, 0.0)
        first = second - (opening - ahead.depth)[:, None] * direction
        width = opening - ahead.depth
        good = np.isfinite(width) & (ahead.normals @ -direction >= cosine) & (width >= max(narrowest, THINNEST))
        least = min(least, float(width[good].min(initial=np.inf)))
        good &= width <= opening - 2 * CLEAR
        found.append((first[good], second[good], np.broadcast_to(direction, (int(good.sum()), 3))))
    if not sum(len(axes) for *_, axes in found):
        spans = [float(np.ptp(part.triangles.reshape(-1, 3) @ direction)) for direction in directions]
        narrow, name = min(least, *spans), part.obstacle.name
        if narrow > opening - 2 * CLEAR:
            raise InputError(
                f"{name} is at least {narrow * 1e3:.1f} mm wide in every direction, and the fingers open to "
                f"{opening * 1e3:.1f} mm; use a wider hand or a cup"
            )
        raise InputError(
            f"{name} has no opposite surfaces from {narrowest * 1e3:.1f} to {opening * 1e3:.1f} mm apart whose normals "
            f"are within {np.degrees(angle):.0f} deg of the line between them; state a larger angle (friction), or "
            "use a cup"
        )
    ones, others, axes = (np.concatenate(column) for column in zip(*found, strict=True))
    return ones, others, axes


def finger_grasps(
    part: PartSurface, hand: HandMaps, fingers: FingerMaps, limits: Any, count: int, rng: np.random.Generator
) -> Candidates:
    """Up to ``count`` grasps that are spread over a part; see :func:`find_pairs` for errors."""
    first, second, axes = find_pairs(part, float(fingers.widths[0]), float(fingers.widths[-1]), limits.angle, rng)
    tensors = np.einsum("ni,nj->nij", axes, axes).reshape(-1, 9)
    pairs = spread(np.concatenate([(first + second) / 2 / part.size, tensors], axis=1), 0, rng, PAIRS)
    grasps = _hands_at(part, fingers, first[pairs], second[pairs], axes[pairs], limits)
    if not len(grasps.widths):
        return grasps
    # In the order of a spread over places, closing directions and approaches, those that nothing of the hand touches
    middle, axes = grasps.contacts.mean(axis=1), grasps.normals[:, 0]
    tensors = np.einsum("ni,nj->nij", axes, axes).reshape(-1, 9)
    features = np.concatenate([middle / part.size, tensors / 2, grasps.rotations[:, :, 2] / 2], axis=1)
    order, kept = spread(features, int(grasps.areas.argmax()), rng), list[int]()
    wider = hand.widened(part.spacing), fingers.widened(part.spacing)
    for start in range(0, len(order), CHUNK):
        rows = order[start : start + CHUNK] if len(kept) < count else order[:0]
        for row in rows[_untouched(part, *wider, grasps.chosen(rows))].tolist():
            if (patches := _patches(part, fingers, grasps.chosen(np.array([row])), limits)) is not None:
                grasps.contacts[row], grasps.areas[row] = patches
                kept.append(row)
    return grasps.chosen(np.array(kept[:count], dtype=np.int64))


def _hands_at(
    part: PartSurface, fingers: FingerMaps, first: Array, second: Array, axes: Array, limits: Any
) -> Candidates:
    """The hands about pairs whose pads touch the part over a sufficient area, at all rotations and depths."""
    opening, widths = float(fingers.widths[0]), np.einsum("ni,ni->n", second - first, axes)
    pads = np.median(fingers.pads, axis=0)
    half, length = (pads[1] - pads[0]) / 2, pads[3] - pads[2]
    # Rings of lines: places (R, A) by radius and angle, and their areas
    reach = float(np.hypot(half, length))
    shares = (min(max(BEYOND * limits.overlap, 2 * INNERMOST) / length, DEPTHS[0]), *DEPTHS)
    radii = np.concatenate([[0.0], np.geomspace(INNERMOST, reach, RINGS - 1)])
    between = np.concatenate([[0.0], (radii[1:] + radii[:-1]) / 2, [reach]])
    areas = np.diff(between**2) * np.pi / AROUND
    angles = np.arange(AROUND) * 2 * np.pi / AROUND
    sideways, ahead = radii[:, None] * np.sin(angles), radii[:, None] * np.cos(angles)
    # Depths (N, 2, R, A) from the pair at which lines of both fingers meet the part, and whether within the cone
    basis = across(axes)
    offsets = np.einsum("ra,ni->nrai", ahead, basis[0]) + np.einsum("ra,ni->nrai", sideways, basis[1])
    depths = np.full((len(axes), 2, RINGS, AROUND), np.inf)
    inside = np.zeros(depths.shape, dtype=bool)
    back, cosine = (opening - widths) / 2, np.cos(WITHIN * limits.angle)
    _, group = np.unique(axes.round(9), axis=0, return_inverse=True)
    for number in range(int(group.max()) + 1):
        rows = np.flatnonzero(group.reshape(-1) == number)
        for side, (points, sign) in enumerate(((first, 1.0), (second, -1.0))):
            direction = sign * axes[rows[0]]
            origins = points[rows, None, None] + offsets[rows] - back[rows, None, None, None] * direction
            met = part.surface.enter(origins.reshape(-1, 3), direction, 0.0)
            depths[rows, side] = met.depth.reshape(-1, RINGS, AROUND) - back[rows, None, None]
            inside[rows, side] = (met.normals @ -direction >= cosine).reshape(-1, RINGS, AROUND)
    # For each place of the pair on the pads (D) and rotation (T): the first touch, and the patch around it
    turns = np.arange(0, AROUND, TURN)
    rolled = (np.arange(AROUND)[None] + turns[:, None]) % AROUND
    turned, cone = depths[..., rolled], inside[..., rolled]  # (N, 2, R, T, A)
    found: list[tuple[Array, ...]] = []
    for share in shares:
        pad = (np.abs(sideways) <= half) & (ahead <= share * length) & (ahead >= (share - 1.0) * length)
        on_pad = np.where(pad[:, None], turned, np.inf)
        touch = on_pad.min(axis=(2, 4))  # (N, 2, T)
        patch = cone & (on_pad <= touch[:, :, None, :, None] + WITHIN * limits.compliance)
        weight = patch * areas[:, None, None]
        area = weight.sum(axis=(2, 4))
        with np.errstate(invalid="ignore"):
            x = (weight * sideways[:, None]).sum(axis=(2, 4)) / area
            z = (weight * ahead[:, None]).sum(axis=(2, 4)) / area
        extent = np.where(patch, ahead[:, None], -np.inf).max(axis=(2, 4))
        extent = extent - np.where(patch, ahead[:, None], np.inf).min(axis=(2, 4))
        width = widths[:, None] - touch.sum(axis=1)
        apart = np.hypot(x[:, 0] - x[:, 1], z[:, 0] - z[:, 1])
        good = (area >= BEYOND * limits.area).all(axis=1) & (extent >= BEYOND * limits.overlap).all(axis=1)
        good &= (width <= opening - 2 * CLEAR) & (width >= fingers.widths[-1])
        good &= apart <= np.tan(WITHIN * limits.angle) * width
        pair, turn = np.nonzero(good)
        if not len(pair):
            continue
        # The axes of the hand: y closes, z approaches at the angle of the rotation
        y, wide, shift = axes[pair], width[pair, turn], touch[pair, :, turn]
        cosines, sines = np.cos(angles[turns[turn]])[:, None], np.sin(angles[turns[turn]])[:, None]
        approach = cosines * basis[0][pair] + sines * basis[1][pair]
        rotations = np.stack([np.cross(y, approach), y, approach], axis=2)
        # Both first touches are at equal distances from the middle between the pads
        middles, own_pads = fingers.at(wide)
        centre = (first[pair] + second[pair] + (shift[:, :1] - shift[:, 1:]) * y) / 2
        z_of_pair = own_pads[:, 3] - share * (own_pads[:, 3] - own_pads[:, 2])
        in_hand = np.column_stack([(own_pads[:, 0] + own_pads[:, 1]) / 2, middles, z_of_pair])
        aside = x[pair, :, turn][..., None] * rotations[:, None, :, 0] + z[pair, :, turn][..., None] * approach[:, None]
        contacts = centre[:, None] + np.array([-0.5, 0.5])[:, None] * (wide[:, None] * y)[:, None] + aside
        translations = centre - np.einsum("nij,nj->ni", rotations, in_hand)
        none, least = np.full(len(wide), np.nan), area[pair, :, turn].min(axis=1)
        found.append((rotations, translations, contacts, np.stack([y, -y], axis=1), least, wide, none))
    empty = [np.empty((0, *shape)) for shape in ((3, 3), (3,), (2, 3), (2, 3), (), (), ())]
    return Candidates(*(np.concatenate(column) for column in zip(empty, *found, strict=True)))


def _patches(part: PartSurface, fingers: FingerMaps, grasp: Candidates, limits: Any) -> tuple[Array, float] | None:
    """The centres (2, 3) and the smaller area of the contacts by a grid of lines over the pads; None if small."""
    rotation, translation, width = grasp.rotations[0], grasp.translations[0], grasp.widths[0]
    (middle,), (pad,) = fingers.at(width)
    cells = np.array([pad[1] - pad[0], pad[3] - pad[2]]) / FINE
    grid = pad[[0, 2]] + cells * (np.stack(np.meshgrid(*[np.arange(FINE)] * 2), axis=-1).reshape(-1, 2) + 0.5)
    back = (float(fingers.widths[0]) - width) / 2
    centres, areas, heights = [], [], []
    for sign in (1.0, -1.0):
        start = middle - sign * (width / 2 + back)
        own = np.column_stack([grid[:, 0], np.full(len(grid), start), grid[:, 1]])
        direction = sign * rotation[:, 1]
        met = part.surface.enter(own @ rotation.T + translation, direction, 0.0)
        depth = met.depth - back  # beyond the closed pad
        touch = min(0.0, float(depth.min()))
        on = depth <= touch + WITHIN * limits.compliance
        on &= met.normals @ -direction >= np.cos(WITHIN * limits.angle)
        areas.append(on.sum() * cells.prod())
        small = areas[-1] < CERTAIN * limits.area + 2 * cells.prod()
        if small or np.ptp(grid[on, 1]) + cells[1] < CERTAIN * limits.overlap:
            return None
        heights.append(touch)
        centres.append([*grid[on, :1].mean(axis=0), middle - sign * (width / 2 - touch), grid[on, 1].mean()])
    # The line between the centres of the contacts is in both cones
    aside = np.hypot(*(np.array(centres[0]) - centres[1])[[0, 2]])
    if min(heights) < -PRESSED or aside > np.tan(WITHIN * limits.angle) * width:
        return None
    return np.array(centres) @ rotation.T + translation, min(areas)


def across(axes: Array) -> tuple[Array, Array]:
    """Two unit vectors (N, 3) across axes (N, 3), right-handed with them."""
    least = np.eye(3)[np.abs(axes).argmin(axis=1)]
    first = np.cross(axes, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(axes, first)


def _untouched(part: PartSurface, hand: HandMaps, fingers: FingerMaps, grasps: Candidates) -> npt.NDArray[np.bool_]:
    """(N,) whether only the pads touch the part: on the approach, at the grasp, and while the fingers close."""
    swept = fingers.swept.reshape(*fingers.swept.shape[:3], -1)
    # The first width that is not larger, at which each finger has moved farther by up to half the difference
    levels = np.searchsorted(-fingers.widths, -grasps.widths).clip(max=len(fingers.widths) - 1)
    farther = (grasps.widths - fingers.widths[levels]) / 2
    free = np.ones(len(grasps.widths), dtype=bool)
    # A few of the points first, by which most of the others fail
    for cloud in (part.cloud[::FEW], part.cloud):
        rows = np.flatnonzero(free)
        if not len(rows):
            break
        rotations = grasps.rotations[rows]
        own = cloud @ rotations - np.einsum("ni,nij->nj", grasps.translations[rows], rotations)[:, None]
        free[rows] = ~(own[..., 2] < hand.grid.lookup(hand.front, own[..., :2], -np.inf)).any(axis=1)
        cell, inside = fingers.grid.cells(own[..., [0, 2]])
        hand_of, point = np.nonzero(inside)
        y, number, level = own[hand_of, point, 1], cell[hand_of, point], levels[rows][hand_of]
        least, most = swept[level, :, :, number].transpose(2, 1, 0)
        back = farther[rows][hand_of] + PRESSED
        touched = ((y > least[0]) & (y < most[0] - back)) | ((y > least[1] + back) & (y < most[1]))
        free[rows[hand_of[touched]]] = False
    return free
