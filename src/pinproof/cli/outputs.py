"""Files that commands write: where they may stand, and a good pick as its page and its motion."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path

import pinproof as pp
from pinproof.errors import FileError, InputError

__all__ = ["check_outputs", "file_stems", "make_folder", "write_motion"]


def check_outputs(outputs: Iterable[Path | None], inputs: Iterable[str | Path | None] = ()) -> None:
    """Refuse, before the work and not after it, a file that cannot be written or that this command needs otherwise.

    Raises
    ------
    InputError
        If an output is also an input, or is named twice.
    FileError
        If there is no folder for it, or it is a folder itself.
    """
    taken = {os.path.realpath(path): "read" for path in inputs if path is not None}
    for path in outputs:
        if path is None:
            continue
        place = os.path.realpath(path)
        if place in taken:
            raise InputError(f"{path}: is {taken[place]} by this same command; name another file to write to")
        try:
            is_folder, has_folder = Path(place).is_dir(), Path(place).parent.is_dir()
        except OSError as error:
            raise FileError(path, f"cannot be written: {error.strerror or error}") from error
        if is_folder:
            raise FileError(path, "cannot be written: it is a folder")
        if not has_folder:
            raise FileError(path, f"cannot be written: there is no folder {path.parent}")
        taken[place] = "written to"


def write_motion(verdict: pp.PickVerdict, arm: pp.Arm, html: Path, motion: Path) -> list[Path]:
    """Write the trajectory of a good pick and its page, or a page for each motion where what is carried changes.

    The files written are handed back.
    """
    if verdict.trajectory is None:
        raise InputError(f"pick {verdict.pick.name!r} is not good, so it has no motion to write")
    verdict.save_motion(motion)
    pages = []
    for number, part in enumerate(verdict.motions, start=1):
        alone = len(verdict.motions) == 1
        pages.append(html if alone else html.with_name(f"{html.stem}_{number}_{part.name}{html.suffix}"))
        pp.write_html(
            pages[-1],
            arm.with_held(part.held),
            part.scene,
            part.trajectory,
            certificate=part.certificate,
            attached=part.attached,
            title=f"{arm.robot.name}: {verdict.pick.name}" + ("" if alone else f", {part.name}"),
        )
    return [*pages, motion]


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
