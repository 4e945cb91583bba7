#!/usr/bin/env python3
"""Draw the pictures of the manual that are not made by benchmarks.

python scripts/pictures.py bisection     docs/bisection.png: a pair of bodies, its distance and the proven lower bounds
python scripts/pictures.py first_page    docs/first_page.png: the motion of the first example in docs/index.md

Each takes some seconds; the second one needs Chromium.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import pinproof as pp

DOCS = Path(__file__).resolve().parents[1] / "docs"

SIZE = (1200, 700)
"""Width and height of the picture of the first page in pixels."""

INSTANT = 0.6
"""Time of this picture in seconds; the tool is above the post."""

COLOURS = 128
"""Size of its palette, which keeps the file small."""


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


PICTURES = {"bisection": bisection, "first_page": first_page}

if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1] not in PICTURES:
        sys.exit(f"usage: python scripts/pictures.py {'|'.join(PICTURES)}")
    PICTURES[sys.argv[1]](DOCS / f"{sys.argv[1]}.png")
