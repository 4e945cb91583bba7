"""Plots of a trajectory: position, velocity, acceleration and jerk of each joint over time, with their limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.motion import bezier
from pinproof.motion.limits import Bounds, MotionLimits
from pinproof.motion.rate_constraints import RateConstraint, checked_constraints

__all__ = ["plot_trajectory"]

Array = npt.NDArray[np.float64]

SAMPLES = 12
"""Number of samples of each polynomial piece, so that jumps of acceleration and jerk remain vertical."""

PANEL_SIZE = (9.0, 2.1)
"""Width and height of a panel in inches."""

TITLES = ("position\nrad or m", "velocity\nrad/s or m/s", "acceleration\nrad/s² or m/s²", "jerk\nrad/s³ or m/s³")

LEGEND_ROWS = 14
"""Largest number of joints that the legend names."""


class _Motion(Protocol):
    @property
    def joint_names(self) -> tuple[str, ...]: ...

    def bezier(self, order: int = 0) -> tuple[Array, Array]: ...


def plot_trajectory(
    trajectory: _Motion,
    limits: MotionLimits | None = None,
    *,
    jerk: npt.ArrayLike | None = None,
    constraints: Sequence[RateConstraint] = (),
) -> Any:
    """Draw a trajectory as a :class:`matplotlib.figure.Figure`; see :meth:`Trajectory.plot`."""
    from matplotlib.figure import Figure

    names = trajectory.joint_names
    bounds = None if limits is None else Bounds.of(limits, names, jerk)
    if bounds is None and jerk is not None:
        raise InputError("jerk without limits: give the velocity and acceleration limits too, such as arm.limits")
    further = checked_constraints(constraints)
    times, values = _sampled(trajectory)
    panels = [*zip(TITLES, values, _lines(bounds, len(names)), strict=True)]
    for constraint in further:
        _, beta, gamma, bound = constraint.coefficients(values[0], values[1], values[2])
        panels.append((constraint.name, beta + gamma, (-bound.min(axis=0), bound.min(axis=0))))
    width, height = PANEL_SIZE
    figure = Figure(figsize=(width, 0.6 + height * len(panels)), layout="constrained")
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for panel, (title, columns, (lower, upper)) in zip(axes, panels, strict=True):
        for k, column in enumerate(columns.T):
            label = names[k] if columns.shape[1] == len(names) else f"component {k + 1}"
            (line,) = panel.plot(times, column, linewidth=1.4, label=label)
            for limit in (lower[k], upper[k]):
                if np.isfinite(limit):
                    panel.axhline(limit, color=line.get_color(), linestyle="--", linewidth=0.9, alpha=0.6)
        panel.set_ylabel(title)
        panel.grid(alpha=0.3)
        panel.margins(x=0.0)
    axes[-1].set_xlabel("time, s")
    if len(names) <= LEGEND_ROWS:
        axes[0].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
    return figure


def _sampled(trajectory: _Motion) -> tuple[Array, list[Array]]:
    """(N,) times, and (N, n) positions and derivatives up to the jerk, with both values where one jumps."""
    knots, control = trajectory.bezier()
    pieces = len(control)
    piece, u = np.repeat(np.arange(pieces), SAMPLES), np.tile(np.linspace(0.0, 1.0, SAMPLES), pieces)
    times = knots[piece] + u * np.diff(knots)[piece]
    return times, [bezier.on_pieces(trajectory.bezier(order)[1], piece, u) for order in range(4)]


def _lines(bounds: Bounds | None, n: int) -> list[tuple[Array, Array]]:
    """The lower and the upper limit (n,) of each panel; infinite where there is none."""
    none = np.full(n, np.inf)
    if bounds is None:
        return [(-none, none)] * 4
    jerk = none if bounds.jerk is None else bounds.jerk
    rates = [(-limit, limit) for limit in (bounds.velocity, bounds.acceleration, jerk)]
    return [(bounds.lower, bounds.upper), *rates]
