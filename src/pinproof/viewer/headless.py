"""A browser without a window, which turns a page into a picture file."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
from contextlib import suppress
from pathlib import Path

from pinproof.errors import ViewerError

__all__ = ["BROWSERS", "find_browser", "photograph"]

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
