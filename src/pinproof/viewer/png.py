"""PNG pictures of a page, rendered by a headless browser."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from pinproof.collision import Scene
from pinproof.common.files import write_bytes_whole
from pinproof.errors import FileError, InputError, ViewerError
from pinproof.model import JointGroup
from pinproof.motion import Trajectory
from pinproof.viewer.page import render_page
from pinproof.viewer.picture import Picture, PictureContent

if TYPE_CHECKING:
    from typing_extensions import Unpack

BROWSER_VARIABLE = "PINPROOF_BROWSER"
"""The environment variable that names the browser; it takes precedence over browsers on PATH."""

BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    "brave-browser",
)
"""Names of Chromium-based browsers, which accept the same options, in search order."""

APPLICATIONS = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
)

TIMEOUT = 120.0
"""Seconds. With software rendering, a large robot on a busy machine takes several tens of seconds."""

DRAWN_MESSAGE = "pinproof: drawn"
"""The message that the page logs to the console when the picture is complete."""

MIN_SIZE, MAX_SIZE = 64, 4096
"""Limits of the width and height in pixels; not every driver can render larger pictures."""

FLAGS = (
    "--headless",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",  # software rendering, which gives the same picture on every machine
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
    "--host-resolver-rules=MAP * ~NOTFOUND",  # no network access
    "--enable-logging=stderr",
    "--virtual-time-budget=4000",
)


def find_browser() -> str:
    """The path of a Chromium-based browser; ViewerError if no browser is found."""
    name = os.environ.get(BROWSER_VARIABLE)
    for candidate in [name] if name else [*BROWSERS, *APPLICATIONS]:
        if (executable := shutil.which(candidate)) is not None:
            return executable
    if name:
        raise ViewerError(f"{BROWSER_VARIABLE} names {name}, which is not an executable program")
    raise ViewerError(
        f"a PNG picture needs a Chromium-based browser, and none of {', '.join(BROWSERS)} is on PATH. Install "
        f"Chromium, set {BROWSER_VARIABLE} to such a browser, or write a page with write_html (--html)"
    )


def screenshot(html: str, fragment: str, size: tuple[int, int], browser: str, fallback_folder: Path) -> bytes:
    """Render a page as PNG of a size in pixels; ``fragment`` is the end of its URL, such as ``#still``.

    Temporary files are created in ``fallback_folder`` if the browser cannot access the folder of the system.
    ViewerError if the browser fails, exceeds :data:`TIMEOUT`, or does not support WebGL.
    """
    confined = "/snap/" in str(Path(browser).resolve()) or "/snap/" in browser  # a snap has a private /tmp
    with tempfile.TemporaryDirectory(
        prefix="pinproof-", dir=fallback_folder if confined else None, ignore_cleanup_errors=True
    ) as folder:
        page, picture = Path(folder) / "page.html", Path(folder) / "picture.png"
        page.write_text(html, encoding="utf-8")
        # A profile of its own, so that no other browser is affected
        options = [f"--user-data-dir={folder}/profile", f"--screenshot={picture}", f"--window-size={size[0]},{size[1]}"]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            options.append("--no-sandbox")  # Chromium refuses to run as root with a sandbox
        command = [browser, *FLAGS, *options, page.as_uri() + fragment]
        try:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                start_new_session=True,
            )
        except OSError as error:
            raise ViewerError(f"{browser} cannot be run: {error.strerror or error}") from error
        with process:
            try:
                output = process.communicate(timeout=TIMEOUT)[1].decode("utf-8", "replace")
            except BaseException as error:  # kill the browser and all processes that it has started
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
                if isinstance(error, subprocess.TimeoutExpired):
                    raise ViewerError(f"{browser} did not produce a picture within {TIMEOUT:.0f} s") from error
                raise
        if DRAWN_MESSAGE not in output or not picture.is_file():
            messages = [line for line in output.splitlines() if "CONSOLE" in line or "ERROR" in line]
            last = messages[-1].strip()[:300] if messages else "none"
            raise ViewerError(f"{browser} did not produce a picture; its last message: {last}")
        return picture.read_bytes()


def write_png(
    path: str | Path,
    arm: JointGroup,
    scene: Scene | None = None,
    trajectory: Trajectory | None = None,
    *,
    time: float | None = None,
    size: tuple[int, int] = (1280, 800),
    **content: Unpack[PictureContent],
) -> None:
    """Write a PNG picture of what :func:`pinproof.write_html` shows, with a caption of one line.

    A headless Chromium, Chrome, Edge or Brave renders the picture; the environment variable ``PINPROOF_BROWSER`` names
    another Chromium-based browser.

    Parameters
    ----------
    path
        The PNG file to write.
    time
        Time of the trajectory in seconds. Default: its start, or the contact of the certificate.
    size
        Width and height in pixels, 64 to 4096 each.
    arm, scene, trajectory, **content
        As in :func:`pinproof.write_html`.

    Raises
    ------
    InputError
        If the time is outside the trajectory or the size outside its limits, and as in :func:`pinproof.write_html`.
    ViewerError
        If no browser is found, the browser fails, or the file cannot be written.
    """
    width, height = size
    if not (MIN_SIZE <= width <= MAX_SIZE and MIN_SIZE <= height <= MAX_SIZE):
        raise InputError(f"size = {width} x {height}; width and height must be {MIN_SIZE} to {MAX_SIZE} pixels")
    if time is not None:
        if trajectory is None:
            raise InputError("time needs a trajectory; without one, the picture shows the configuration q")
        if not 0.0 <= time <= trajectory.duration:
            raise InputError(f"time = {time:g} s is outside the trajectory, which lasts {trajectory.duration:g} s")
    # Invalid settings are refused first, also on a machine without a browser
    page = render_page(Picture(arm, scene, trajectory, **content))
    browser = find_browser()
    shown_time = page.shown.start if time is None else time
    picture = screenshot(page.text, f"#still&t={shown_time:.6f}", size, browser, Path(path).absolute().parent)
    try:
        write_bytes_whole(path, picture)
    except FileError as error:
        raise ViewerError(str(error)) from error
