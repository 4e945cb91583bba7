"""A browser without a window, which turns a page into a picture file.

A still picture as a file, drawn by a browser without a window.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy.typing as npt

from pinproof.collision import Certificate, CheckResult, Obstacle, Scene
from pinproof.common.files import write_bytes_whole
from pinproof.errors import FileError, InputError, ViewerError
from pinproof.model import Arm
from pinproof.motion import Trajectory
from pinproof.spatial import SE3
from pinproof.viewer.overlays import ColouredPoints
from pinproof.viewer.page import NO_FRAMES, render_page
from pinproof.viewer.picture import Picture

__all__ = ["BROWSERS", "find_browser", "photograph", "write_png"]

VARIABLE = "PINPROOF_BROWSER"
"""The environment variable that names the browser; it goes before what is found."""

BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    "brave-browser",
)
"""Browsers of the Chromium family, which all take the same options, in the order in which they are looked for."""

APPLICATIONS = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
)

PATIENCE = 120.0
"""Seconds; drawn by the processor alone, a large robot on a busy machine takes some tens."""

DRAWN = "pinproof: drawn"
"""What the page says to its console once the picture stands."""

FLAGS = (
    "--headless",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",  # the processor draws, the same on every machine
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
    "--host-resolver-rules=MAP * ~NOTFOUND",  # it has no business on a network
    "--enable-logging=stderr",
    "--virtual-time-budget=4000",
)


def find_browser() -> str:
    """The browser to draw with.

    Raises
    ------
    ViewerError
        If there is none; says what to do.
    """
    told = os.environ.get(VARIABLE)
    if told:
        found = shutil.which(told)
        if found is None:
            raise ViewerError(f"{VARIABLE} names {told}, which is no program that can be run")
        return found
    for name in (*BROWSERS, *APPLICATIONS):
        found = shutil.which(name)
        if found is not None:
            return found
    raise ViewerError(
        f"a still picture is drawn by a browser, and none of {', '.join(BROWSERS)} is on PATH: install Chromium, or "
        f"name a browser of its family in {VARIABLE}, or write the page with write_html (--html) and open it yourself"
    )


def photograph(html: str, address: str, size: tuple[int, int], browser: str, near: Path) -> bytes:
    """The picture of a page, as PNG.

    Parameters
    ----------
    html, address
        The page, and what follows its file's name: ``#still``.
    size
        Pixels: width, height.
    browser
        The program.
    near
        A folder for the browser's files, if it may not look into the system's own.

    Raises
    ------
    ViewerError
        If the browser fails, takes too long or cannot draw in three dimensions.
    """
    confined = "/snap/" in str(Path(browser).resolve()) or "/snap/" in browser  # such a browser has a /tmp of its own
    with tempfile.TemporaryDirectory(
        prefix="pinproof-", dir=near if confined else None, ignore_cleanup_errors=True
    ) as folder:
        page, picture = Path(folder) / "page.html", Path(folder) / "picture.png"
        page.write_text(html, encoding="utf-8")
        own = [f"--user-data-dir={folder}/profile", f"--screenshot={picture}", f"--window-size={size[0]},{size[1]}"]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            own.append("--no-sandbox")  # Chromium refuses to run as root with one
        said = _run([browser, *FLAGS, *own, page.as_uri() + address])
        if DRAWN not in said or not picture.is_file():
            last = next(
                (line for line in reversed(said.splitlines()) if "CONSOLE" in line or "ERROR" in line), "nothing"
            )
            raise ViewerError(f"{browser} drew no picture; the last it said: {last.strip()[:300]}")
        return picture.read_bytes()


def _run(command: list[str]) -> str:
    """What a program writes to its standard error; it and all that it has started are ended when it takes too long."""
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
    except OSError as error:
        raise ViewerError(f"{command[0]} cannot be run: {error.strerror or error}") from error
    with process:
        try:
            return process.communicate(timeout=PATIENCE)[1].decode("utf-8", "replace")
        except BaseException as error:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            if isinstance(error, subprocess.TimeoutExpired):
                raise ViewerError(f"{command[0]} did not draw the picture within {PATIENCE:.0f} s") from error
            raise


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
