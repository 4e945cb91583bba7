#!/usr/bin/env python3
"""Draw docs/first_page.png: a picture of the motion of the first example in docs/index.md."""

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
"""Width and height of the picture in pixels."""

INSTANT = 0.6
"""Time of the picture in seconds; the tool is above the post."""

COLOURS = 128
"""Size of the palette, which keeps the file small."""


def draw(target: Path = PICTURE) -> None:
    """Run the example, and draw the motion that it creates."""
    from PIL import Image

    (example, *_) = re.findall(r"^```python\n(.*?)^```$", (DOCS / "index.md").read_text(encoding="utf-8"), re.M | re.S)
    names: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # the example writes a page
        exec(example, names)
        arm, scene, motion = names["arm"], names["scene"], names["trajectory"]
        pp.write_png("still.png", arm, scene, motion, time=INSTANT, size=SIZE, certificate=names["certificate"])
        with Image.open("still.png") as image:
            image.convert("RGB").quantize(COLOURS).save(target, optimize=True)
        os.chdir(DOCS)


if __name__ == "__main__":
    draw()
