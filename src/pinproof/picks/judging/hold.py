"""Whether the grip holds the part in motion: the stage ``hold``, from the contact patches, the forces and the mass.

docs/holding.md states the model and its limits. The grip limits the timing of the motions with the part in the hand
(:class:`pinproof.motion.HoldLimits`); before any planning, it must carry the part at rest at the grasp and at the
release, which does not depend on the configuration of the arm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pinproof.collision import LineSurface
from pinproof.errors import InputError
from pinproof.model import Arm, Payload
from pinproof.motion import ContactPatch, HoldLimits, Trajectory
from pinproof.picks.input.parts import uniform_body
from pinproof.picks.input.pick import Pick
from pinproof.picks.input.picks import Picks
from pinproof.picks.judging.grip import GripPatch, GripResult
from pinproof.picks.judging.verdict import Stage, StageResult
from pinproof.spatial import SE3

RIM_POINTS = 16
"""Points of the rim of a cup, each at the centre of its arc."""

RESERVE = 0.02
"""Share of the forces that motions do not use. At the limit of Coulomb, elastic contacts of a simulation slip already:
a part that a motion loaded to it moved by 8 mm, and with 1 % more friction or 3 % more force by 0.6 mm."""

PROVEN = 1.03 / (1.0 - RESERVE)
"""A larger share is proven to exceed what the grip transmits: shares are upper bounds within a relative 2e-4, and the
cells of a patch of many points transmit somewhat less than the patch. It is also at least what :data:`SAME_NORMAL`
changes."""

SAME_NORMAL = 1e-3
"""rad: normals of finger and part that differ by less are equal."""


def normals_agree(grip: GripResult) -> bool:
    """Whether the fingers lie flat on the part, each with one body; what they transmit is otherwise a lower bound."""
    apart = any(np.linalg.norm(patch.normal - patch.into) > SAME_NORMAL for patch in grip.patches)
    return not apart and len({patch.branch for patch in grip.patches}) == len(grip.patches)


def hold_data_missing(pick: Pick, shared: Picks) -> list[str]:
    """What is not stated of a pick with an object and would be needed to judge whether the grip holds in motion."""
    missing = [] if pick.payload is not None else ["the mass of the object (`payload` of the pick, `mass` of its part)"]
    if shared.cup is not None:
        return missing + ([] if shared.cup.force is not None else ["the pull-off force of the cup (`cup.force`)"])
    if shared.fingers is None and not shared.grip:
        return [*missing, "fingers or a cup, whose force is known"]
    if shared.grip_limits.force is None:
        missing.append("the force of the fingers (`grip_limits.force`)")
    return missing


def with_inertia(payload: Payload, surface: LineSurface) -> Payload:
    """The mass of an object, with the inertia of a uniform density if none is stated; of an open mesh, of its hull."""
    if payload.inertia is not None:
        return payload
    return replace(payload, inertia=payload.mass * uniform_body(surface)[1])


def hold_limits(
    pick: Pick, shared: Picks, grip: GripResult, tcp_from_object: SE3, arm: Arm, surface: LineSurface
) -> HoldLimits | None:
    """The limits of the motion by a grip that holds an object; None if :func:`hold_data_missing`."""
    if pick.payload is None or not (contacts := contacts_of(shared, grip, str(pick.object_name))):
        return None
    return HoldLimits(arm, with_inertia(pick.payload, surface).placed(tcp_from_object), contacts)


def contacts_of(shared: Picks, grip: GripResult, part: str) -> list[ContactPatch]:
    """The contacts of a hand with the part that it holds, in the frame of its tcp; none if its force is not stated."""
    cup, limits = shared.cup, shared.grip_limits
    force = limits.force if cup is None else cup.force
    if force is None:
        return []
    friction = math.tan(limits.angle) if limits.friction is None else limits.friction
    force *= 1.0 - RESERVE
    contacts = []
    if cup is not None:
        turns = 2.0 * np.pi * np.arange(RIM_POINTS) / RIM_POINTS
        rim = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(RIM_POINTS)])
        rim = cup.radius * np.sinc(1.0 / RIM_POINTS) * rim @ shared.tip.rotation.T + shared.tip.translation
        friction = friction if cup.friction is None else cup.friction
        # The vacuum acts along the normal of the surface, also if the face is tilted
        normal = shared.tip.rotation @ ((0.0, 0.0, 1.0) if grip.cup is None else grip.cup.normal)
        contacts.append(ContactPatch(rim, normal, force, friction, pulls=True))
    for patch in () if cup is not None else grip.patches:
        together = sum(other.branch == patch.branch for other in grip.patches)  # links of one finger share its force
        contacts.append(_pressing(patch, force / together, friction, part))
    return contacts


def _pressing(patch: GripPatch, force: float, friction: float, part: str) -> ContactPatch:
    """The patch of a finger that presses with a force (N) along its closing direction.

    The normal of the contact is that of the finger, that of the part, or between them. Forces that are within the
    friction cones about both are within the cone about their bisector whose angle is smaller by half of that between
    them, and their share along either is larger than that along the bisector by no more than the last factor.

    InputError if no force is within both cones.
    """
    half = 0.5 * math.acos(min(1.0, float(patch.normal @ patch.into)))
    angle = math.atan(friction) - half
    if angle <= 0.0:
        raise InputError(
            f"{part} slips out of the fingers: {patch.contact.finger} touches it at an edge, where the surfaces are at "
            f"{math.degrees(2 * half):.1f} deg to each other, and the friction of {friction:g} allows less than "
            f"{math.degrees(2 * math.atan(friction)):.1f} deg"
        )
    # On a surface that is inclined to the closing direction, a finger presses with at least this force
    closing = np.array(patch.contact.closing_direction)
    cosine = float(np.clip(min(patch.normal @ closing, patch.into @ closing), 0.0, 1.0))
    pressed = force / (cosine + friction * math.sqrt(1.0 - cosine**2))
    pressed /= math.cos(half) + math.sin(half) * math.tan(angle)
    return ContactPatch(patch.points, patch.normal + patch.into, pressed, math.tan(angle))


def held_in_motion(limits: HoldLimits, carried: Mapping[str, tuple[float, Trajectory]]) -> StageResult:
    """The result of the stage for the motions with the part in the hand, by name, each with its start (s)."""
    peaks = {name: limits.peak(trajectory) for name, (_, trajectory) in carried.items()}
    name = max(peaks, key=lambda part: peaks[part].share)
    peak = replace(peaks[name], time=carried[name][0] + peaks[name].time)
    figures = {"reserve": peak.reserve, "time": peak.time, "force": peak.force, "moment": peak.moment}
    return StageResult(Stage.HOLD, peak.holds, f"the grip {peak}, in {name}", figures)
