"""Plots of a trajectory: position, velocity, acceleration and jerk of each joint over time, with their limits."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from pinproof.common.structs import described, key
from pinproof.common.validation import optional_module
from pinproof.errors import InputError
from pinproof.motion.curve import BezierCurve
from pinproof.motion.limits import MotionLimits
from pinproof.spatial import Array, finite

# Number of samples of each polynomial piece, so that jumps of acceleration and jerk remain vertical.
SAMPLES = 12
# Width and height of a panel in inches.
PANEL_SIZE = (9.0, 2.1)

QUANTITIES = (
    ("position", "rad or m"),
    ("velocity", "rad/s or m/s"),
    ("acceleration", "rad/s² or m/s²"),
    ("jerk", "rad/s³ or m/s³"),
)

# Largest number of joints that the legend names.
LEGEND_ROWS = 14


class DrawnConstraint(Protocol):
    """A :class:`~pinproof.motion.RateConstraint`."""

    @property
    def name(self) -> str:
        """The title of the panel."""

    def coefficients(self, q: Array, slope: Array, curvature: Array) -> tuple[Array, Array, Array, Array]:
        """(N, m) alpha, beta, gamma and the bound."""


@described(eq=False)
class Panel:
    """A quantity of a motion over time, with its limits."""

    name: str = key("the quantity, or the name of a constraint")
    unit: str = key("its unit; empty for a constraint")
    labels: tuple[str, ...] = key("the m joints or components")
    values: Array = key("(N, m) values at the times of the plot")
    lower: Array = key("(m,) the lower limits, infinite without a limit")
    upper: Array = key("(m,) the upper limits")


@dataclass
class _Picture:
    """The PNG file of a figure; a class, because functions within functions cannot be pickled."""

    figure: Any

    def __call__(self) -> bytes:
        picture = io.BytesIO()
        self.figure.savefig(picture, format="png", dpi=self.figure.dpi)
        return picture.getvalue()


def plot_trajectory(
    trajectory: BezierCurve,
    limits: MotionLimits | None = None,
    *,
    jerk: npt.ArrayLike | None = None,
    rate_limits: Sequence[DrawnConstraint] = (),
) -> Any:
    """Draw a trajectory as a :class:`matplotlib.figure.Figure`; see :meth:`Trajectory.plot`."""
    figures = optional_module("matplotlib.figure", "a plot", "plot")
    times, panels = panels_of(trajectory, limits, jerk=jerk, rate_limits=rate_limits)
    width, height = PANEL_SIZE
    figure = figures.Figure(figsize=(width, 0.6 + height * len(panels)), layout="constrained")
    # A notebook shows a Figure made without pyplot as text only, unless it has this method.
    figure._repr_png_ = _Picture(figure)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axis, panel in zip(axes, panels, strict=True):
        for label, column, *both in zip(panel.labels, panel.values.T, panel.lower, panel.upper, strict=True):
            (line,) = axis.plot(times, column, linewidth=1.4, label=label)
            for limit in both:
                if np.isfinite(limit):
                    axis.axhline(limit, color=line.get_color(), linestyle="--", linewidth=0.9, alpha=0.6)
        axis.set_ylabel(f"{panel.name}\n{panel.unit}".rstrip())
        axis.grid(alpha=0.3)
        axis.margins(x=0.0)
    axes[-1].set_xlabel("time, s")
    if len(trajectory.joint_names) <= LEGEND_ROWS:
        axes[0].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
    return figure


def panels_of(
    trajectory: BezierCurve,
    limits: MotionLimits | None = None,
    *,
    jerk: npt.ArrayLike | None = None,
    rate_limits: Sequence[DrawnConstraint] = (),
    samples: int = SAMPLES,
) -> tuple[Array, list[Panel]]:
    """(N,) times and the panels of a plot, with this number of samples of each piece; see :meth:`Trajectory.plot`."""
    names = trajectory.joint_names
    # (N,) times, and (N, n) positions and derivatives up to the jerk there, with both values where one jumps.
    knots, control = trajectory.bezier()
    piece, u = np.repeat(np.arange(len(control)), samples), np.tile(np.linspace(0.0, 1.0, samples), len(control))
    times = knots[piece] + u * np.diff(knots)[piece]
    values = [trajectory.derivative(order).on(piece, u) for order in range(4)]
    # The lower and the upper limit (n,) of each quantity, infinite where none is given.
    given = {kind: None if limits is None else getattr(limits, kind) for kind in ("velocity", "acceleration")}
    given["jerk"] = np.full(len(names), jerk) if jerk is not None and np.ndim(jerk) == 0 else jerk
    lower, upper = getattr(limits, "lower", None), getattr(limits, "upper", None)
    none: Array = np.full(len(names), np.inf)
    bounds = [(-none if lower is None else np.asarray(lower), none if upper is None else np.asarray(upper))]
    for kind, limit in given.items():
        unlimited = np.isposinf(np.asarray(none if limit is None else limit, dtype=float))
        rates = finite(kind, np.where(unlimited, 1.0, none if limit is None else limit), (len(names),))
        if (rates <= 0.0).any():
            raise InputError(f"{kind} must be above 0; it is {rates}")
        rates = np.where(unlimited, np.inf, rates)
        bounds.append((-rates, rates))
    panels = [
        Panel(*quantity, names, columns, *both)
        for quantity, columns, both in zip(QUANTITIES, values, bounds, strict=True)
    ]
    for constraint in rate_limits:
        _, beta, gamma, bound = constraint.coefficients(values[0], values[1], values[2])
        count, least = beta.shape[1], bound.min(axis=0)
        labels = names if count == len(names) else tuple(f"component {k + 1}" for k in range(count))
        panels.append(Panel(constraint.name, "", labels, beta + gamma, -least, least))
    return times, panels
