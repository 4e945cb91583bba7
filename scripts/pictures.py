#!/usr/bin/env python3
"""Draw the pictures of the manual that are not made by benchmarks.

python scripts/pictures.py bisection         docs/bisection.png: a pair of bodies, its distance and the proven bounds
python scripts/pictures.py first_page        docs/first_page.png: the motion of the first example in docs/index.md
python scripts/pictures.py demo              docs/demo.webp: the page of the first example of the gallery, animated
python scripts/pictures.py gallery [NAME...] docs/examples/*.webp: the pages that the examples of the gallery write

All but the first one need Chromium.
"""

from __future__ import annotations

import os
import re
import runpy
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import pinproof as pp

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
EXAMPLES = DOCS / "examples"

SIZE = (1200, 700)
"""Width and height of the picture of the first page in pixels."""

INSTANT = 0.6
"""Time of this picture in seconds; the tool is above the post."""

COLOURS = 128
"""Size of its palette, which keeps the file small."""

SHOWN = {
    "bolt_pick": 1.18,
    "calibrated_ur": 0.6,
    "cell_placement": 1.2,
    "conveyor": 3.2,
    "depth_image": 0.6,
    "general_arm": 0.0,
    "mixed_bin": 1.2,
    "rail": 0.9,
    "tool_path": 5.0,
    "two_arms": 0.7,
}
"""The examples of the gallery, with the time (s) of each picture."""

GALLERY, DEMO = (480, 300), (640, 360)
"""Width and height of the pictures of the gallery and of the animated page; pages are drawn at twice that size."""

FRAMES, SLOWER = 12, 2.0
"""Frames per second of the animation, and the factor by which it is slower than the robot."""


def bisection(target: Path) -> None:
    """Certify a motion of a UR5 whose tool passes a post, and plot the evidence of this pair."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    arm = pp.load_robot("ur5").arm(tcp="tool0")
    tool = pp.Obstacle("tool", pp.Cylinder(radius=0.01, length=0.3), pp.pose((0, 0, 0.16)))
    beside_tool = arm.forward_kinematics(arm.home).translation * [1.09, 1.09, 1] - [0, 0, 0.2]
    scene = pp.Scene([pp.Obstacle("post", pp.Cylinder(radius=0.03, length=0.3), pp.pose(beside_tool))])
    checker = pp.CollisionChecker(arm, scene, attached=[tool])
    turn = np.array([0.9, 0, 0, 0, 0, 0])
    swing = pp.JointPath([arm.home - turn, arm.home + turn], arm.joint_names)
    rows = np.array(pp.certify(swing, checker, record=True).or_raise().evidence)
    owners = [{checker.bodies[i].owner for i in pair} for pair in checker.pairs]
    pair = owners.index({"tool", "post"})
    of_pair = rows[rows[:, 2] == pair]
    halved = [any(r[0] <= s[0] and s[1] <= r[1] and s[1] - s[0] < r[1] - r[0] for s in of_pair) for r in of_pair]
    leaves = of_pair[~np.array(halved)]

    times = np.linspace(*swing.domain, 400)
    alone = checker.without_pairs(k for k in range(len(checker.pairs)) if k != pair)
    distances = alone.clearance_batch(swing(times))
    figure, axes = pyplot.subplots(figsize=(7, 3.2), layout="constrained")
    axes.plot(times, distances * 1e3, color="black", label="distance between tool and post")
    for k, (start, end, _, proven) in enumerate(leaves[:, :4]):
        axes.fill_between([start, end], 0, proven * 1e3, color="tab:green", alpha=0.25, linewidth=0)
        axes.plot([start, end], [proven * 1e3] * 2, color="tab:green", label=None if k else "proven lower bound")
        axes.axvline(start, color="tab:green", linewidth=0.5, alpha=0.5)
    axes.set(xlabel="path parameter", ylabel="mm", xlim=swing.domain, ylim=(0, None))
    axes.legend(facecolor="white", edgecolor="none", framealpha=1)
    figure.savefig(target, dpi=110, metadata={"Software": None})
    pyplot.close(figure)


def first_page(target: Path) -> None:
    """Run the example, and draw the motion that it creates."""
    from PIL import Image

    (example, *_) = re.findall(r"^```python\n(.*?)^```$", (DOCS / "index.md").read_text(encoding="utf-8"), re.M | re.S)
    names: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # the example writes a page
        exec(example, names)
        arm, scene, motion = names["arm"], names["scene"], names["motion"]
        shown = {"time": INSTANT, "size": SIZE, "certificate": motion.certificate}
        pp.write_png("still.png", arm, scene, motion.trajectory, **shown)
        with Image.open("still.png") as image:
            image.convert("RGB").quantize(COLOURS).save(target, optimize=True)
        os.chdir(DOCS)


@contextmanager
def page_of(name: str, size: tuple[int, int], names: dict[str, Any] | None = None) -> Iterator[Any]:
    """Run an example of the gallery, and open its page in a browser, without controls and at twice the size."""
    sys.path.insert(0, str(ROOT))
    from tests.viewer.browser import Browser, find_browser

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        os.chdir(folder)
        (names if names is not None else {}).update(runpy.run_path(str(EXAMPLES / f"{name}.py")))
        executable = find_browser()
        if executable is None:
            sys.exit("these pictures need Chromium, which was not found")
        browser = Browser(executable, Path(folder) / "profile")
        try:
            url = f"{(Path(folder) / name).as_uri()}.html#still"
            yield browser.open(url, 2 * size[0], 2 * size[1], ready="window.pinproof?.pictured")
        finally:
            browser.close()
            os.chdir(DOCS)


def picture_of(page: Any, size: tuple[int, int]) -> Any:
    """What the page shows, with smooth edges."""
    from PIL import Image

    page.evaluate("window.pinproof.pictured.then(() => true)")
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))")
    return Image.fromarray(page.screenshot()).resize(size, Image.Resampling.LANCZOS)


def gallery(*chosen: str) -> None:
    """Run examples, and draw the page that each of them writes."""
    for name in chosen or SHOWN:
        with page_of(name, GALLERY) as page:
            page.seek(SHOWN[name])
            picture_of(page, GALLERY).save(EXAMPLES / f"{name}.webp", quality=80, method=6)


def demo(target: Path) -> None:
    """Draw the page of the bolt picks in motion, above the proven clearance, and then a pick that cannot work."""
    from PIL import Image, ImageDraw, ImageFont

    names: dict[str, Any] = {}
    width, height, strip, left = *DEMO, 110, 64
    large, small = (ImageFont.load_default(size) for size in (15, 12))
    with page_of("bolt_pick", DEMO, names) as page:
        good, refused = (names["report"].verdicts[k] for k in (0, 2))

        # The bounds by which each pair is proven, the least of them at each column of the plot. Pairs that do not move
        # relative to each other have no intervals.
        picks, trajectory = names["picks"], good.trajectory
        checker = pp.CollisionChecker(picks.load_arm(), picks.load_scene(), attached=picks.tool, margin=picks.margin)
        rows = np.array(pp.certify(trajectory, checker, record=True).or_raise().evidence)
        times = np.linspace(0.0, trajectory.duration, width - left - 12)
        proven = np.full((len(checker.pairs), len(times)), -np.inf)
        for start, end, pair, bound in rows[:, :4]:
            covered = (start - 1e-9 <= times) & (times <= end + 1e-9)
            proven[int(pair), covered] = np.maximum(proven[int(pair), covered], bound)
        moving = np.unique(rows[:, 2].astype(int))
        bounds, distances = 1e3 * proven[moving].min(axis=0), 1e3 * checker.clearance_batch(trajectory(times))

        def frame(time: float) -> Any:
            page.seek(time)
            image = Image.new("RGB", (width, height + strip), "white")
            image.paste(picture_of(page, DEMO), (0, 0))
            return image

        def heights(millimetres: Any) -> Any:
            return height + strip - 8 - (strip - 38) * np.clip(millimetres, 0.0, 16.0) / 16.0

        frames = []
        for time in np.append(np.arange(0.0, trajectory.duration, 1 / (FRAMES * SLOWER)), trajectory.duration):
            image = frame(time)
            draw = ImageDraw.Draw(image)
            title = (
                f"{good.pick.name}: FREE, all bodies are proven to stay at least {1e3 * good.clearance:.1f} mm apart"
            )
            draw.text((12, height + 6), title, "black", large)
            passed = int(np.searchsorted(times, time, side="right"))
            for column, (bound, distance) in enumerate(zip(heights(bounds), heights(distances), strict=True)):
                shade = "#0b7d3e" if column < passed else "#b9dcc8"
                draw.line([(left + column, heights(0.0)), (left + column, bound)], shade)
                draw.line(
                    [(left + column, distance), (left + column, distance + 1)],
                    "black" if column < passed else "#999999",
                )
            draw.line([(left, heights(1e3 * picks.margin)), (width - 12, heights(1e3 * picks.margin))], "#b3131b")
            draw.text((8, heights(14.0) - 8), "distance", "black", small)
            draw.text((8, heights(7.0) - 8), "proven", "#0b7d3e", small)
            draw.text((8, heights(2.0) - 8), "margin", "#b3131b", small)
            frames.append(image)
        page.evaluate("window.pinproof.choose(2)")
        image = frame(0.0)
        draw = ImageDraw.Draw(image)
        draw.text(
            (12, height + 6), f"{refused.pick.name}: {refused.status.value} at {refused.failed.value}", "#b3131b", large
        )
        draw.text((12, height + 34), str(refused.reason).partition(";")[0], "black", large)
        draw.text((12, height + 62), f"suggestion, checked: {refused.suggestions[0]}", "black", large)
    step = round(1000 / FRAMES)
    times_shown = [step] * (len(frames) - 1) + [1500, 3500]
    frames[0].save(
        target, save_all=True, append_images=[*frames[1:], image], duration=times_shown, loop=0, quality=72, method=6
    )


PICTURES = {"bisection": "bisection.png", "first_page": "first_page.png", "demo": "demo.webp", "gallery": None}

if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] not in PICTURES or set(sys.argv[2:]) - set(SHOWN):
        sys.exit(f"usage: python scripts/pictures.py {'|'.join(PICTURES)}")
    if sys.argv[1] == "gallery":
        gallery(*sys.argv[2:])
    else:
        globals()[sys.argv[1]](DOCS / str(PICTURES[sys.argv[1]]))
