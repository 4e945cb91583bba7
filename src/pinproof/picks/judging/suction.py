"""Whether the face of a suction cup lies on a part.

The face is a disc at the tip, perpendicular to the tip's z axis. Lines along that axis from points of its rim must meet
the part within the stated gap, in front of the face or behind it, and the plane fitted to the points where they meet it
must be nearly parallel to the face. Inside the rim, every line must meet the part: through a hole the cup would leak.
Openings that are narrower than the distance of the lines (1/256 of the rim, 1/32 of the diameter) are not detected. How
far the part protrudes into the cup is measured with the depths of the hand (:mod:`pinproof.picks.judging.hand`).
"""

from __future__ import annotations

import numpy as np

from pinproof.picks.input.picks import SuctionCup
from pinproof.picks.judging.grip import CupContact, GripResult, HeldPart
from pinproof.spatial import SE3, Array

RIM, ACROSS = 256, 32
"""Number of lines around the rim, and along the diameter of the face."""


def grip_by_cup(cup: SuctionCup, tip: SE3, part: HeldPart) -> GripResult:
    """Whether the face of a cup at the tip, ``tcp_from_tip``, lies on a part."""
    turns = np.arange(RIM) * 2 * np.pi / RIM
    rim = cup.radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    cells = cup.radius * ((np.arange(ACROSS) + 0.5) * 2 / ACROSS - 1)
    face = np.stack(np.meshgrid(cells, cells), axis=-1).reshape(-1, 2)
    face = face[np.linalg.norm(face, axis=1) <= cup.radius]
    at_rim, at_face = np.split(_gaps(np.concatenate([rim, face]), tip, part), [RIM])
    area = float(np.pi * cup.radius**2 * (np.abs(at_face) <= cup.gap).mean())
    met = np.isfinite(at_rim)
    if not met.all():
        contact = CupContact(area, np.inf, np.nan)
        words = f"{100 * (1 - met.mean()):.0f} % of the rim of the cup is not over {part.name}"
        return GripResult(False, f"{words}; all of it is needed", cup=contact)
    gap = float(at_rim[np.abs(at_rim).argmax()])
    slope = np.linalg.lstsq(np.column_stack([rim, np.ones(RIM)]), at_rim, rcond=None)[0][:2]
    tilt = float(np.arctan(np.linalg.norm(slope)))
    contact, held = CupContact(area, gap, tilt), False
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


def _gaps(points: Array, tip: SE3, part: HeldPart) -> Array:
    """(G,) where lines from points (G, 2) of the face along its axis meet the part first (m); negative behind it."""
    part_from_face = part.pose.actInv(tip)
    origins = np.column_stack([points, np.zeros(len(points))])
    origins = origins @ part_from_face.rotation.T + part_from_face.translation
    return np.asarray(part.surface.enter(origins, part_from_face.rotation[:, 2]).depth)
