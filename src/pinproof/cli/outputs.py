"""A good pick as files: the page and the motion."""

from __future__ import annotations

from pathlib import Path

from pinproof.collision import Scene
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.picks import Picks, PickVerdict
from pinproof.viewer import write_html

__all__ = ["write_motion"]


def write_motion(verdict: PickVerdict, arm: Arm, scene: Scene, picks: Picks, html: Path, json: Path) -> list[Path]:
    """Write the page and the trajectory of a good pick; the files written."""
    if verdict.trajectory is None:
        raise InputError(f"pick {verdict.pick.name!r} is not good, so it has no motion to write")
    verdict.trajectory.save(json)
    write_html(
        html,
        arm,
        scene,
        verdict.trajectory,
        certificate=verdict.certificate,
        attached=picks.tool,
        title=f"{arm.robot.name}: {verdict.pick.name}",
    )
    return [html, json]
