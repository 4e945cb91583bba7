#!/usr/bin/env python3
"""Draw docs/first_page.png: a still of the motion that the first lines of docs/index.md make."""

from __future__ import annotations

import os
import re
import tempfile
from pathlib import Path
from typing import Any

import pinproof as pp

DOCS = Path(__file__).resolve().parents[1] / "docs"
PICTURE = DOCS / "first_page.png"
SIZE = (1200, 700)
"""Pixels."""

INSTANT = 0.6
"""Seconds: the tool is above the post."""

COLOURS = 128
"""Of the palette, so that the file stays small."""


def draw(target: Path = PICTURE) -> None:
    """Run the lines, and take a still of what they made."""
    from PIL import Image

    (lines, *_) = re.findall(r"^```python\n(.*?)^```$", (DOCS / "index.md").read_text(encoding="utf-8"), re.M | re.S)
    made: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # the lines write a page
        exec(lines, made)
        arm, scene, motion = made["arm"], made["scene"], made["trajectory"]
        pp.write_png("still.png", arm, scene, motion, time=INSTANT, size=SIZE, certificate=made["certificate"])
        with Image.open("still.png") as image:
            image.convert("RGB").quantize(COLOURS).save(target, optimize=True)
        os.chdir(DOCS)


if __name__ == "__main__":
    draw()
