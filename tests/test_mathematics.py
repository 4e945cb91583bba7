"""The mathematics page runs as printed and agrees with the code."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from pinproof import _core
from pinproof.collision.certificates.certify import GOAL_SHARE, TOLERANCE
from pinproof.collision.certificates.parting import DEEPEST
from pinproof.collision.checking.assembly import ROUNDING

from .pages import ROOT, run_page

PAGE = ROOT / "docs" / "mathematics.md"
TEXT = PAGE.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def names(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the page's blocks define, run one after the other."""
    return run_page(PAGE, tmp_path_factory.mktemp("reader"))


@pytest.mark.slow
def test_every_block_runs_as_printed(names: dict[str, Any]) -> None:
    assert names["certificate"].first_contact.bodies[1] == "plate"
    assert names["leaving"].partings[0].until < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("delta", [0.0, 1e-3, 0.3, 1.5, 3.0, 4.0, 7.0])
@pytest.mark.parametrize("share", [1.0, -0.5])
def test_chord_and_bend_are_those_of_the_code(names: dict[str, Any], delta: float, share: float) -> None:
    (chord, bend), prismatic = (_core.joint_swing(kind, share, delta) for kind in (False, True))
    angle = abs(share) * delta
    assert chord == pytest.approx(names["chord"](angle), abs=1e-15)
    assert bend == pytest.approx(names["bend"](angle), abs=1e-15)
    assert prismatic == (pytest.approx(angle), 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("delta", [1e-3, 0.3, 1.5, 3.0, 4.0])
def test_no_turned_point_moves_farther_or_bends_more(names: dict[str, Any], delta: float) -> None:
    angles = np.linspace(-delta, delta, 2001)
    moved = np.stack([np.cos(angles) - 1, np.sin(angles)])
    assert np.linalg.norm(moved, axis=0).max() <= names["chord"](delta) + 1e-12
    assert np.linalg.norm(moved - [np.zeros(2001), angles], axis=0).max() <= names["bend"](delta) + 1e-12


@pytest.mark.slow
def test_the_printed_remainder_bounds_chains_of_both_kinds_of_joints_for_large_motions(names: dict[str, Any]) -> None:
    """Against placements: joints about random axes, angles beyond pi, and long prismatic joints."""
    rng, largest = np.random.default_rng(0), 0.0
    for _ in range(300):
        count = int(rng.integers(1, 5))
        revolute = rng.random(count) < 0.6
        axes = rng.normal(size=(count, 3))
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        points, y = rng.normal(size=(count, 3)), rng.normal(size=3)
        delta = np.where(revolute, rng.uniform(0, 7, count), rng.uniform(0, 20, count))
        rates = np.where(revolute[:, None], np.cross(axes, y - points), axes)
        bound = names["remainder"](np.linalg.norm(rates, axis=1), delta, revolute)
        for _ in range(20):
            theta = delta * rng.choice([-1.0, 1.0, rng.uniform(-1, 1)], count)
            moved = y
            for k in reversed(range(count)):  # the joint closest to the body first, each about its axis at the start
                turned = points[k] + pin.exp3(axes[k] * theta[k]) @ (moved - points[k])
                moved = turned if revolute[k] else moved + axes[k] * theta[k]
            off = float(np.linalg.norm(moved - y - theta @ rates))
            assert off <= bound + 1e-9
            largest = max(largest, off / bound if bound else 0.0)
    assert largest > 0.5  # not a bound that says nothing


def test_numbers_in_the_text_are_those_of_the_code() -> None:
    text = " ".join(TEXT.split())
    for phrase, value, stated in (
        ("$10^{-9}$ m per metre of extent", ROUNDING, 1e-9),
        ("half of the clearance observed so far is proven", GOAL_SHARE, 0.5),
        ("(0.1 mm by default)", TOLERANCE, 1e-4),
        ("At the start, $g_n \\ge -1$ mm", DEEPEST, 1e-3),
        ("up to 0.05 rad", _core.GROWTH_RANGE, 0.05),
    ):
        assert phrase in text
        assert value == stated


def test_functions_in_the_text_exist() -> None:
    files = [*(ROOT / "src" / "core").rglob("*.h"), *(ROOT / "src" / "pinproof").rglob("*.py")]
    source = "".join(path.read_text(encoding="utf-8") for path in files)
    named = re.findall(r"[(;] ?`(?:\w+::)?(\w+)`\)", TEXT)
    assert len(named) > 4
    assert not [name for name in named if f" {name}(" not in source]


def test_links_lead_somewhere() -> None:
    links = re.findall(r"\]\((?!https?://|#)([^)#]+)", TEXT)
    assert links
    assert [link for link in links if not (PAGE.parent / link).exists()] == []


@pytest.mark.slow
def test_the_picture_is_drawn_by_its_script(tmp_path: Path) -> None:
    """In a separate process, so that only it loads matplotlib."""
    target = tmp_path / "bisection.png"
    program = "import runpy, sys, pathlib; runpy.run_path(sys.argv[1])['bisection'](pathlib.Path(sys.argv[2]))"
    script = ROOT / "scripts" / "pictures.py"
    subprocess.run([sys.executable, "-c", program, str(script), str(target)], check=True)
    assert target.stat().st_size > 10_000
