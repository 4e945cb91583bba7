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

from pinproof.model import Arm
from pinproof.motion import ContactPatch, HoldLimits, Trajectory
from pinproof.picks.input.pick import Pick
from pinproof.picks.input.picks import Picks
from pinproof.picks.judging.grip import GripResult
from pinproof.picks.judging.verdict import Stage, StageResult
from pinproof.spatial import SE3

RIM_POINTS = 16
"""Points of the rim of a cup, each at the centre of its arc."""

PROVEN = 1.001
"""A larger share is proven to exceed what the grip transmits: shares are upper bounds within a relative 2e-4."""


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


def hold_limits(pick: Pick, shared: Picks, grip: GripResult, tcp_from_object: SE3, arm: Arm) -> HoldLimits | None:
    """The limits of the motion by a grip that holds an object; None if :func:`hold_data_missing`."""
    cup, limits = shared.cup, shared.grip_limits
    force = limits.force if cup is None else cup.force
    if pick.payload is None or force is None or (cup is None and not grip.patches):
        return None
    friction = math.tan(limits.angle) if limits.friction is None else limits.friction
    contacts = []
    if cup is not None:
        turns = 2.0 * np.pi * np.arange(RIM_POINTS) / RIM_POINTS
        rim = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(RIM_POINTS)])
        rim = cup.radius * np.sinc(1.0 / RIM_POINTS) * rim @ shared.tip.rotation.T + shared.tip.translation
        friction = friction if cup.friction is None else cup.friction
        contacts.append(ContactPatch(rim, shared.tip.rotation[:, 2], force, friction, pulls=True))
    for patch in () if cup is not None else grip.patches:
        # On a surface that is inclined to the closing direction, a finger presses with at least this force
        cosine = float(np.clip(patch.normal @ patch.contact.closing_direction, 0.0, 1.0))
        pressed = force / (cosine + friction * math.sqrt(1.0 - cosine**2))
        contacts.append(ContactPatch(patch.points, patch.normal, pressed, friction))
    return HoldLimits(arm, pick.payload.placed(tcp_from_object), contacts)


def held_in_motion(limits: HoldLimits, carried: Mapping[str, tuple[float, Trajectory]]) -> StageResult:
    """The result of the stage for the motions with the part in the hand, by name, each with its start (s)."""
    peaks = {name: limits.peak(trajectory) for name, (_, trajectory) in carried.items()}
    name = max(peaks, key=lambda part: peaks[part].share)
    peak = replace(peaks[name], time=carried[name][0] + peaks[name].time)
    figures = {"reserve": peak.reserve, "time": peak.time, "force": peak.force, "moment": peak.moment}
    return StageResult(Stage.HOLD, peak.holds, f"the grip {peak}, in {name}", figures)
