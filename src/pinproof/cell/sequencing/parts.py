"""Picks without the other parts: what they need of a cell from which blocking parts have been removed."""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace

from pinproof.collision import Scene
from pinproof.model import Arm
from pinproof.picks.input.pick import Pick, support_names
from pinproof.picks.input.picks import NamedFrame, Picks, root_from_frame


def without_parts(arm: Arm, scene: Scene, picks: Picks) -> tuple[Scene, Picks]:
    """Remove all parts that picks carry from the scene, and state each part in its pick.

    Parts that are stacked or placed on each other block each other in a scene that contains all of them at
    their first place. A placement of the base should not depend on this: the sequence decides which parts are there
    when a pick is made (:func:`pinproof.sequence`), and certifies the motions with them.

    Returns
    -------
    tuple[Scene, Picks]
        The scene without the parts, and the picks, each with its part attached after the grasp.
    """
    parts = {pick.carried for pick in picks if isinstance(pick.carried, str) and pick.carried in scene}

    def of_part(frame: str) -> bool:
        while frame in picks.frames:
            frame = picks.frames[frame].frame
        return frame in parts

    def alone(pick: Pick) -> Pick:
        place = pick.place
        if place is not None:
            if of_part(place.frame):
                pose = root_from_frame(place.frame, picks.frames, scene, arm) * place.pose
                place = replace(place, pose=pose, frame="")
            place = replace(place, support=other_supports(place.support, parts))
        support = other_supports(pick.support, parts)
        pose = root_from_frame(pick.frame, picks.frames, scene, arm) * pick.pose if pick.frame else pick.pose
        carried = pick.carried
        if isinstance(carried, str) and carried in parts:
            carried = replace(scene[carried], pose=pose.actInv(scene[carried].pose))
        if not of_part(pick.frame):
            return replace(pick, carried=carried, place=place, support=support)
        return replace(pick, pose=pose, frame="", carried=carried, place=place, support=support)

    frames = {
        name: NamedFrame(root_from_frame(name, picks.frames, scene, arm)) if of_part(name) else frame
        for name, frame in picks.frames.items()
    }
    return scene.remove(*sorted(parts)), replace(picks, picks=tuple(map(alone, picks)), frames=frames)


def other_supports(support: str | Sequence[str] | None, parts: AbstractSet[str]) -> tuple[str, ...] | None:
    """The stated supports that are not parts; None if no other is stated."""
    return tuple(name for name in support_names(support) or () if name not in parts) or None
