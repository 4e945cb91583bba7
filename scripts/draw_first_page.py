#!/usr/bin/env python3
"""Draw docs/first_page.png: a still of the page that the first lines of docs/index.md write, by a headless Chromium."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
PICTURE = DOCS / "first_page.png"
SIZE = (1200, 750)
"""Pixels."""

INSTANT = 0.6
"""Seconds: where the motion stands still."""

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--hide-scrollbars", "--virtual-time-budget=8000",
)  # fmt: skip


def draw(target: Path = PICTURE) -> None:
    """Run the lines, open the page and take a still of it, in 128 colours so that it stays small."""
    from PIL import Image

    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if browser is None:
        sys.exit("this needs Chromium: apt-get install chromium")
    found = re.search(r"^```python\n(.*?)^```$", (DOCS / "index.md").read_text(encoding="utf-8"), re.M | re.S)
    if found is None:
        sys.exit("docs/index.md has no lines of Python")
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        exec(found[1], {})
        os.chdir(DOCS)
        still = Path(folder, "still.png")
        options = (f"--user-data-dir={folder}/profile", f"--window-size={SIZE[0]},{SIZE[1]}", f"--screenshot={still}")
        subprocess.run([browser, *FLAGS, *options, f"file://{folder}/pick.html#t={INSTANT}"], check=True, timeout=120)
        with Image.open(still) as image:
            image.convert("RGB").quantize(128).save(target, optimize=True)


if __name__ == "__main__":
    draw()
