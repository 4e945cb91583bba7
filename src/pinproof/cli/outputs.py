"""A good pick as files: the page and the motion."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from pinproof.collision import Scene
from pinproof.errors import FileError, InputError
from pinproof.model import Arm
from pinproof.picks import Picks, PickVerdict
from pinproof.viewer import write_html

__all__ = ["file_stems", "make_folder", "write_motion"]


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


def make_folder(path: Path) -> None:
    """Make a folder, and those above it, unless it is there.

    Raises
    ------
    FileError
        If it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(path, f"cannot be made a folder: {error.strerror or error}") from error


def file_stems(names: Iterable[str]) -> list[str]:
    """A file name without ending for each name: all different, none that leaves its folder, none called ``report``."""
    stems: list[str] = []
    taken = {"report"}
    for name in names:
        stem = plain = re.sub(r"[^\w.+-]+", "_", name).lstrip(".") or "pick"
        count = 1
        while stem.lower() in taken:
            count += 1
            stem = f"{plain}_{count}"
        taken.add(stem.lower())
        stems.append(stem)
    return stems
