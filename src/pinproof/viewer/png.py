"""A still picture as a file, drawn by a browser without a window."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy.typing as npt

from pinproof.collision import Certificate, CheckResult, Obstacle, Scene
from pinproof.description.whole_file import write_bytes_whole
from pinproof.errors import FileError, InputError, ViewerError
from pinproof.model import Arm
from pinproof.motion import Trajectory
from pinproof.spatial import SE3
from pinproof.viewer.cloud import ColouredPoints
from pinproof.viewer.headless import find_browser, photograph
from pinproof.viewer.page import NO_FRAMES, render_page
from pinproof.viewer.picture import Picture

__all__ = ["write_png"]

SMALLEST, LARGEST = 64, 4096
"""Pixels of a side: less shows nothing, more is beyond what every driver draws."""


def write_png(
    path: str | Path,
    arm: Arm,
    scene: Scene | None = None,
    trajectory: Trajectory | None = None,
    *,
    time: float | None = None,
    size: tuple[int, int] = (1280, 800),
    certificate: Certificate | None = None,
    attached: Sequence[Obstacle] = (),
    q: npt.ArrayLike | None = None,
    title: str | None = None,
    points: ColouredPoints | None = None,
    ghosts: npt.ArrayLike | None = None,
    check: CheckResult | None = None,
    frames: Mapping[str, SE3] = NO_FRAMES,
    layers: Collection[str] = (),
) -> None:
    """Write a still picture of what :func:`pinproof.write_html` shows, with its caption in one line.

    It is drawn by Chromium, Chrome, Edge or Brave without a window; the environment variable ``PINPROOF_BROWSER`` names
    another one of that family.

    Parameters
    ----------
    path
        The PNG file; written whole or not at all.
    time
        Seconds into the trajectory; by default its start, or the contact of the certificate.
    size
        Width and height in pixels.
    arm, scene, trajectory, certificate, attached, q, title, points, ghosts, check, frames, layers
        As in :func:`pinproof.write_html`.

    Raises
    ------
    InputError
        For a time outside the trajectory or a size beyond what can be drawn, and as in :func:`pinproof.write_html`.
    ViewerError
        If there is no such browser, it fails, or the file cannot be written.
    """
    width, height = size
    if not (SMALLEST <= width <= LARGEST and SMALLEST <= height <= LARGEST):
        raise InputError(f"size = {width} x {height}; both lie between {SMALLEST} and {LARGEST} pixels")
    if time is not None:
        if trajectory is None:
            raise InputError("time is of a trajectory, and none is given; q says where the arm is")
        if not 0.0 <= time <= trajectory.duration:
            raise InputError(f"time = {time:g} s lies outside the trajectory, which takes {trajectory.duration:g} s")
    picture = Picture(
        arm, scene, trajectory, certificate, attached, q, title, points, ghosts, check, frames, layers
    )  # fmt: skip
    browser = find_browser()
    page = render_page(picture)
    moment = page.start if time is None else time
    content = photograph(page.text, f"#still&t={moment:.6f}", (width, height), browser, Path(path).absolute().parent)
    try:
        write_bytes_whole(path, content)
    except FileError as error:
        raise ViewerError(str(error)) from error
