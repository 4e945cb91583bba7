"""Named frames that picks are given in: frames of the file, obstacles, links that do not move."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from pinproof.collision import Scene
from pinproof.description import Urdf
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import Arm
from pinproof.spatial import SE3, frozen, rigid

__all__ = ["NamedFrame", "moved_by", "root_from_frame"]


@dataclass(frozen=True, eq=False)
class NamedFrame:
    """``parent_from_frame``, and the name of the parent, which may be any that a pick may be given in."""

    pose: SE3
    frame: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", frozen(rigid("pose of a frame", self.pose)))


def root_from_frame(name: str, frames: Mapping[str, NamedFrame], scene: Scene, arm: Arm) -> SE3:
    """Where a named frame is; ``""`` is the frame of the robot's root link itself.

    A frame of ``frames`` goes before an obstacle of its name, and that before a link.

    Raises
    ------
    UnknownNameError
        If nothing is called so.
    InputError
        If frames hang on each other in a circle, or the link is moved by the arm.
    """
    placement, seen = SE3.Identity(), list[str]()
    while name in frames:
        if name in seen:
            raise InputError(f"the frames {', '.join(seen)} hang on each other in a circle")
        seen.append(name)
        placement, name = frames[name].pose * placement, frames[name].frame
    if name in ("", arm.robot.urdf.root):
        return placement
    if name in scene.names:
        return scene[name].pose * placement
    if name not in arm.robot.urdf.links:
        raise UnknownNameError("frame", name, [*frames, *scene.names, *arm.robot.urdf.links])
    if moving := moved_by(arm.robot.urdf, name, (*arm.joint_names, *arm.followers)):
        raise InputError(f"the frame {name!r} is a link that joint {moving} moves; poses of picks need one at rest")
    return arm.root_from_base * arm.frame_placement(arm.home, name) * placement


def moved_by(urdf: Urdf, link: str, joints: Collection[str]) -> str:
    """Which of some joints, or of those that follow one of them, moves a link; empty if none does."""
    while (joint := urdf.parent_joint(link)) is not None:
        if joint.name in joints or (joint.mimic is not None and joint.mimic.leader in joints):
            return joint.name
        link = joint.parent
    return ""
