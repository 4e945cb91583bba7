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
from pinproof.motion import MotionLimits, Panel, RateConstraint, Trajectory, panels_of
from pinproof.spatial import Array
from pinproof.viewer.panels import legend

WIDTH, HEIGHT = 360, 110
"""Size of a plot in SVG units; the page stretches it to the width of its column."""

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
        lower, upper = limits.lower, limits.upper
        velocity, acceleration = (np.where(np.isnan(rates), np.inf, rates) for rates in (limits.velocity, acceleration))
        jerk = None if limits.jerk is None else np.where(np.isnan(limits.jerk), np.inf, limits.jerk)
        return cls(_Known(lower, upper, velocity, acceleration), jerk)


@dataclass(frozen=True, eq=False)
class _Known:
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array


def plots_html(trajectory: Trajectory, drawn: PlotLimits) -> str:
    """The panel of the plots, which is closed at first; empty without a motion."""
    if not trajectory.duration > 0.0:
        return ""
    # Enough samples for smooth lines, whatever the number of pieces
    samples = int(np.clip(TOTAL // (len(trajectory.times) - 1), FEWEST, MOST))
    times, panels = panels_of(trajectory, drawn.limits, jerk=drawn.jerk, rate_limits=drawn.rate_limits, samples=samples)
    joints = [(name, SERIES[k % len(SERIES)]) for k, name in enumerate(trajectory.joint_names)]
    more = "".join(f", {escape(panel.name)}" for panel in panels[4:])
    return (
        f'<details id="chart" class="below"><summary>Position, velocity, acceleration, jerk{more} over time</summary>'
        f'{legend(joints, "Colours of the joints")}<div class="panels">{"".join(_plot(p, times) for p in panels)}</div>'
        "</details>"
    )


def _plot(panel: Panel, times: Array) -> str:
    """One plot; its lines have titles with the range of the samples, which browsers show as tooltips."""
    # The values as shares of their limits, from -1 to 1 within them
    limited = np.isfinite(panel.lower) & np.isfinite(panel.upper) & (panel.upper > panel.lower)
    middle, half = np.zeros(len(limited)), np.ones(len(limited))
    lower, upper = panel.lower[limited], panel.upper[limited]
    middle[limited], half[limited] = 0.5 * (lower + upper), 0.5 * (upper - lower)
    shares = (panel.values - middle) / half
    # If any line has a limit, those without one are left out
    percent = bool(limited.any())
    drawn, columns = (shares, np.flatnonzero(limited)) if percent else (panel.values, np.arange(len(panel.labels)))
    largest = float(np.abs(drawn[:, columns]).max(initial=0.0))
    size = max(1.12 * LIMIT if percent else 0.0, 1.05 * largest) or 1.0
    x, y = WIDTH * times / times[-1], 0.5 * HEIGHT * (1.0 - drawn / size)
    # The limits, or the largest value, and zero
    marks = []
    for tick in (-LIMIT, 0.0, LIMIT) if percent else (-size / 1.05, 0.0, size / 1.05):
        share = 0.5 * (1.0 - tick / size)
        kind, number = "limit" if percent and tick else "zero", f"{100.0 * tick:.0f}" if percent else f"{tick:.3g}"
        line = f'<line class="{kind}" x1="0" x2="{WIDTH}" y1="{HEIGHT * share:.1f}" y2="{HEIGHT * share:.1f}"/>'
        marks.append((line, f'<span class="tick" style="top:{100.0 * share:.1f}%">{number}</span>'))
    unit = panel.unit or UNITS.get(panel.name, "")
    curves = []
    for k in columns.tolist():
        values = panel.values[:, k]
        title = f"{panel.labels[k]}: {values.min():.3g} to {values.max():.3g} {unit}".rstrip()
        if limited[k]:
            title += f", up to {100.0 * float(np.abs(shares[:, k]).max()):.0f} % of the limit"
        colour, points = SERIES[k % len(SERIES)], _points(x, y[:, k])
        curves.append(f'<polyline stroke="{colour}" points="{points}"><title>{escape(title)}</title></polyline>')
    what = ("% between the limits" if panel.name == "position" else "% of the limit") if percent else unit
    head = escape(f"{panel.name}, {what}" if what else panel.name)
    lines, ticks = ("".join(parts) for parts in zip(*marks, strict=True))
    return (
        f'<figure><figcaption>{head}</figcaption><div class="plot">'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none" role="img" aria-label="{head}">'
        f"{lines}{''.join(curves)}</svg>{ticks}</div>"
        f'<div class="ends"><span>0</span><span>{times[-1]:.3g} s</span></div></figure>'
    )


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
