"""Plots of a motion as inline SVG: position, velocity, acceleration, jerk and torque over time, against their limits.

A joint is drawn as a share of its own limit, so that all joints of a panel have the same two limit lines: 100 % and
-100 %. The position is drawn between its limits. A panel without any limit has the values themselves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
import numpy.typing as npt

from pinproof.common.theme import SERIES
from pinproof.model import JointGroup
from pinproof.motion import MotionLimits, RateConstraint, Trajectory
from pinproof.motion.plot import Panel, panels_of
from pinproof.spatial import Array

WIDTH, HEIGHT = 360, 150
"""Size of a panel in SVG units, which are pixels on a narrow screen."""

LEFT, RIGHT, TOP, BOTTOM = 46, 8, 22, 18
"""Margins of a panel, for the numbers and the title."""

FEWEST, MOST, TOTAL = 2, 25, 600
"""Samples of each polynomial piece, at least and at most, and the number of samples of a motion that is aimed at."""

FLAT = 0.12
"""SVG units by which a line may deviate from the samples that it omits."""


LIMIT = 1.0
"""The share at which a limit is reached."""

UNITS = {"torque": "N m or N"}
"""Units of the panels of constraints by their names."""


@dataclass(frozen=True, eq=False)
class PlotLimits:
    """The limits of the plots of a page, as for :meth:`pinproof.Trajectory.plot`.

    Parameters
    ----------
    limits
        Limits of position, velocity and acceleration; None for none.
    jerk
        Jerk limits, (n,) or one number; None for none.
    rate_limits
        Constraints such as torques, each of which adds a panel.
    """

    limits: MotionLimits | None = None
    jerk: npt.ArrayLike | None = None
    rate_limits: Sequence[RateConstraint] = ()

    @classmethod
    def of(cls, arm: JointGroup) -> PlotLimits:
        """The known limits of an arm; accelerations that are only assumed are no limits."""
        limits = arm.limits
        assumed = limits.acceleration_source.startswith("default")
        acceleration = np.full(arm.dof, np.inf) if assumed else limits.acceleration
        known = _Known(limits.lower, limits.upper, _or_infinite(limits.velocity), _or_infinite(acceleration))
        return cls(known, None if limits.jerk is None else _or_infinite(limits.jerk))


@dataclass(frozen=True, eq=False)
class _Known:
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array


def _or_infinite(rates: Array) -> Array:
    return np.where(np.isnan(rates), np.inf, rates)


def plots_html(trajectory: Trajectory, drawn: PlotLimits) -> str:
    """The plots as HTML with inline SVG: a disclosure that is closed at first; empty without a motion."""
    if not trajectory.duration > 0.0:
        return ""
    samples = int(np.clip(TOTAL // (len(trajectory.times) - 1), FEWEST, MOST))
    times, panels = panels_of(trajectory, drawn.limits, jerk=drawn.jerk, rate_limits=drawn.rate_limits, samples=samples)
    names = "".join(
        f'<li><span class="swatch" style="background:{_colour(k)}"></span>{escape(name)}</li>'
        for k, name in enumerate(trajectory.joint_names)
    )
    figures = "".join(_svg(panel, times) for panel in panels)
    return (
        f'<details id="plots"><summary>Position, velocity, acceleration, jerk{_more(panels[4:])} over time</summary>'
        f'<ul class="legend" aria-label="Colours of the joints">{names}</ul>'
        f'<div class="panels">{figures}</div></details>'
    )


def _more(panels: Sequence[Panel]) -> str:
    return "".join(f", {escape(panel.name)}" for panel in panels)


def _colour(index: int) -> str:
    return SERIES[index % len(SERIES)]


def _svg(panel: Panel, times: Array) -> str:
    """One panel; its lines have titles with the range of the samples, which browsers show as tooltips."""
    shares, limited = _shares(panel)
    percent = bool(limited.any())
    drawn = shares if percent else panel.values
    columns = np.flatnonzero(limited) if percent else np.arange(len(panel.labels))
    size = max(1.12 * LIMIT if percent else 0.0, 1.05 * float(np.abs(drawn[:, columns]).max(initial=0.0)))
    size = size or 1.0
    x = LEFT + (WIDTH - LEFT - RIGHT) * times / times[-1]

    def height(value: Array | float) -> Array:
        middle = 0.5 * (TOP + HEIGHT - BOTTOM)
        return np.asarray(middle - 0.5 * (HEIGHT - TOP - BOTTOM) * np.asarray(value) / size)

    ticks = (-LIMIT, 0.0, LIMIT) if percent else (-size / 1.05, 0.0, size / 1.05)
    lines = "".join(
        f'<line class="{"limit" if percent and tick else "zero"}" x1="{LEFT}" x2="{WIDTH - RIGHT}" '
        f'y1="{float(height(tick)):.1f}" y2="{float(height(tick)):.1f}"/>'
        f'<text class="tick" x="{LEFT - 5}" y="{float(height(tick)) + 3.5:.1f}">{_number(tick, percent)}</text>'
        for tick in ticks
    )
    curves = "".join(
        f'<polyline stroke="{_colour(k)}" points="{_points(x, height(drawn[:, k]))}">'
        f"<title>{escape(_title(panel, k, shares[:, k] if limited[k] else None))}</title></polyline>"
        for k in columns.tolist()
    )
    unit = panel.unit or UNITS.get(panel.name, "")
    what = "% of the limit" if percent else unit
    if percent and panel.name == "position":
        what = "% between the limits"
    head = f"{panel.name}, {what}" if what else panel.name
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(head)}" '
        f'data-left="{LEFT}" data-right="{RIGHT}"><text class="head" x="{LEFT}" y="14">{escape(head)}</text>'
        f'{lines}{curves}<line class="now" x1="{LEFT}" x2="{LEFT}" y1="{TOP}" y2="{HEIGHT - BOTTOM}"/>'
        f'<text class="tick start" x="{LEFT}" y="{HEIGHT - 4}">0</text>'
        f'<text class="tick" x="{WIDTH - RIGHT}" y="{HEIGHT - 4}">{times[-1]:.3g} s</text></svg>'
    )


def _shares(panel: Panel) -> tuple[Array, npt.NDArray[np.bool_]]:
    """(N, m) the values as shares of their limits, from -1 to 1 within them, and (m,) which of them have limits."""
    limited = np.isfinite(panel.lower) & np.isfinite(panel.upper) & (panel.upper > panel.lower)
    middle, half = np.zeros(len(limited)), np.ones(len(limited))
    lower, upper = panel.lower[limited], panel.upper[limited]
    middle[limited], half[limited] = 0.5 * (lower + upper), 0.5 * (upper - lower)
    return (panel.values - middle) / half, limited


def _title(panel: Panel, k: int, share: Array | None) -> str:
    values = panel.values[:, k]
    unit = panel.unit or UNITS.get(panel.name, "")
    most = f"{panel.labels[k]}: {values.min():.3g} to {values.max():.3g} {unit}".rstrip()
    return most if share is None else f"{most}, up to {100.0 * float(np.abs(share).max()):.0f} % of the limit"


def _number(value: float, percent: bool) -> str:
    return f"{100.0 * value:.0f}" if percent else f"{value:.3g}"


def _points(x: Array, y: Array) -> str:
    """The points of a line, without points within :data:`FLAT` of the line between their neighbours."""
    kept = [0]
    for i in range(1, len(x) - 1):
        first = kept[-1]
        span = x[i + 1] - x[first]
        slope = (y[i + 1] - y[first]) / span if span > 0.0 else math.inf
        inner = slice(first + 1, i + 1)
        if not math.isfinite(slope) or np.abs(y[first] + slope * (x[inner] - x[first]) - y[inner]).max() > FLAT:
            kept.append(i)
    kept.append(len(x) - 1)
    return " ".join(f"{x[i]:.1f},{y[i]:.1f}" for i in kept)
