"""Plots in pages: the drawn lines are the quantities of the motion as shares of their limits."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

from pinproof import Trajectory
from pinproof.errors import InputError
from pinproof.viewer import PlotLimits
from pinproof.viewer.page import HEIGHT, WIDTH, plots_html, render_page
from pinproof.viewer.picture import Picture

from .conftest import small_arm, swing

RATES = SimpleNamespace(velocity=np.array([1.5, 1.0]), acceleration=np.array([3.0, np.inf]))


class Twice:
    """A constraint with one component, the doubled speed of the first joint."""

    name = "torque"

    def coefficients(self, q, slope, curvature):
        value = 2.0 * slope[:, :1]
        return np.zeros_like(value), value, np.zeros_like(value), np.full_like(value, 4.0)

    def excess(self, trajectory):
        return np.ones(len(trajectory.times) - 1)


def lines(text: str) -> list[np.ndarray]:
    """The points (N, 2) of each line."""
    found = re.findall(r'<polyline [^>]*points="([^"]+)"', text)
    return [np.array([pair.split(",") for pair in points.split()], dtype=float) for points in found]


def share(y: np.ndarray) -> np.ndarray:
    """The share of the limit at heights in a panel, with the limit lines of the panel at 100 % (-100 %)."""
    return 1.12 * (1.0 - 2.0 * y / HEIGHT)


def test_lines_are_shares_of_the_limits() -> None:
    trajectory = swing(small_arm(), 0.0, 1.0, duration=2.0)  # a cubic with velocities of up to 0.75
    text = plots_html(trajectory, PlotLimits(RATES, None, [Twice()]))
    heads = re.findall(r'role="img" aria-label="([^"]+)"', text)
    assert heads == [
        "position, rad or m", "velocity, % of the limit", "acceleration, % of the limit", "jerk, rad/s³ or m/s³",
        "torque, % of the limit",
    ]  # fmt: skip
    drawn = lines(text)
    assert len(drawn) == 2 + 2 + 1 + 2 + 1  # the second joint has no limit of acceleration
    times = 2.0 * drawn[2][:, 0] / WIDTH
    expected = trajectory.velocity(times.clip(0.0, 2.0))[:, 0] / 1.5
    assert np.abs(share(drawn[2][:, 1]) - expected).max() < 0.01
    assert share(drawn[4][:, 1]).max() == pytest.approx(1.5 / 3.0, abs=0.01)
    assert share(drawn[7][:, 1]).max() == pytest.approx(1.5 / 4.0, abs=0.01)
    assert "up to 50 % of the limit" in text


def test_an_excess_is_drawn_beyond_the_limit() -> None:
    slow = SimpleNamespace(velocity=np.array([0.25, 1.0]), acceleration=np.ones(2))
    text = plots_html(swing(small_arm(), 0.0, 1.0, duration=2.0), PlotLimits(slow))
    assert "up to 300 % of the limit" in text
    assert all((line >= 0.0).all() and (line[:, 1] <= HEIGHT).all() for line in lines(text))


def test_a_page_without_a_motion_has_no_plots_and_one_with_a_motion_has_them() -> None:
    arm = small_arm()
    assert 'id="chart"' not in render_page(Picture(arm, None, None)).text
    assert render_page(Picture(arm, None, swing(arm))).text.count("<polyline") >= 4
    standing = Trajectory([0.0], np.zeros((1, 2)), np.zeros((1, 2)), arm.joint_names)
    assert plots_html(standing, PlotLimits()) == ""


def test_limits_of_another_length_are_refused() -> None:
    with pytest.raises(InputError, match="velocity"):
        plots_html(swing(small_arm()), PlotLimits(SimpleNamespace(velocity=np.ones(3), acceleration=np.ones(2))))
