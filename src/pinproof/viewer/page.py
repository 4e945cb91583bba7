"""The page of a robot or a motion: film, caption, layers and plots in one HTML file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.collision import Scene
from pinproof.common import theme
from pinproof.common.structs import described, key
from pinproof.common.theme import SERIES
from pinproof.model import JointGroup
from pinproof.motion import Bounds, MotionLimits, Panel, RateConstraint, Trajectory, panels_of
from pinproof.spatial import Array
from pinproof.viewer import panels
from pinproof.viewer.panels import legend
from pinproof.viewer.picture import Picture, PictureContent, RenderedPicture
from pinproof.viewer.web_cell import web_cell_of

if TYPE_CHECKING:
    from typing_extensions import Unpack

SUMMARY_FIGURES = ("Proven clearance", "Duration")
"""Figures of a caption that are also in the line below the title."""

SIDE = """<section class="side card">
<div id="caption" aria-label="What is proven about this motion">{caption}</div>
<button type="button" id="moment" hidden>Show the contact</button>
<section id="proof" aria-label="Verify the proof" hidden></section>
<section id="live" aria-label="Check other poses" hidden></section>
<fieldset id="layers"><legend>Show</legend></fieldset>
<p class="hint">Drag to orbit, scroll to zoom, right-drag to pan.
<span class="keys"><kbd>space</kbd> plays, <kbd>&larr;</kbd> <kbd>&rarr;</kbd> step,
<kbd>R</kbd> resets the view.</span></p>
</section>"""


class Page(NamedTuple):
    """The HTML text of a page, and the picture that it shows."""

    text: str
    shown: RenderedPicture


def write_html(
    path: str | Path,
    arm: JointGroup,
    scene: Scene | None = None,
    trajectory: Trajectory | None = None,
    *,
    plot: PlotLimits | None = None,
    live: bool | None = None,
    **content: Unpack[PictureContent],
) -> None:
    """Write an HTML page that shows an arm, its scene and a motion, and opens without a network connection.

    ``page.html#t=1.2`` opens the page paused at 1.2 s, ``page.html#still`` without controls. If the certificate has a
    contact, the page opens at the contact, with both bodies in red.

    Parameters
    ----------
    path
        The file to write.
    arm, scene
        The arm and the obstacles, drawn in the frame of the robot's root link.
    trajectory
        The motion to play. Without it, the page shows the configuration ``q``.
    certificate
        The certificate of the trajectory. The caption is NOT VALIDATED unless the certificate is FREE and was made for
        exactly this trajectory, arm, scene and attached objects.
    attached
        Objects that move with the tcp, as given to the checker; their pose is ``tcp_from_object``.
    q
        (n,) the configuration to show without a trajectory. Default: the home configuration of the arm.
    title
        The title of the page. Default: the name of the robot.
    points
        Coloured points to draw, with their legend.
    ghosts
        (k, n) configurations at which transparent copies of the arm are drawn, for example all IK solutions of a pose.
    elbow
        A self-motion (:meth:`pinproof.AnalyticIk.self_motion`) or one of its curves. The page has a slider that moves
        the redundant joint along the curve, of a self-motion the longest one, and opens at the solution closest to q.
    check
        The result of a collision check of ``q``. Contacts are marked with their normals, and the bodies are red.
    frames
        ``root_from_frame`` by name: frames to draw in addition to those of the links.
    layers
        Layers that are visible when the page opens, in addition to the default ones: ``collision`` (the collision
        geometry, with meshes as convex hulls), ``frames`` (of base, links and tcp), ``sweep`` (the tool at several
        steps of the motion). The page has a switch for each layer.
    panel
        HTML of a panel of the class ``below``, which the page shows below the picture.
    plot
        The limits in the plots of position, velocity, acceleration, jerk and torque over time, which the page shows
        below the motion. Default: the limits of position and velocity of the arm, and those of acceleration and jerk
        if they are known.
    live
        Whether the page computes: joints, a target of the tcp, obstacles and the base of the robot can be moved, and
        the page checks each pose for contacts, with the compiled core as WebAssembly. Default: True if that enlarges
        the page by 1 MB at most.
    checker
        The checker with which such a page checks. Default: that of a recorded certificate, otherwise one of the arm,
        the scene and the attached objects, with the margin of the certificate and without the pairs that it leaves out;
        margins that a checker has for single pairs are then unknown.

    Raises
    ------
    InputError
        If the trajectory has other joints than the arm or no timing, or is combined with ``q`` or ``check``; if
        ``elbow`` is for another arm, or combined with ``trajectory`` or ``check``.
    UnknownNameError
        If a layer does not exist.
    ViewerError
        If the page cannot be written, a shape cannot be drawn, or meshcat is not installed.
    """
    panels.write_page(path, render_page(Picture(arm, scene, trajectory, **content), plot=plot, compute=live).text)


def render_page(
    picture: Picture,
    *,
    live: str | None = None,
    plot: PlotLimits | None = None,
    compute: bool | None = False,
) -> Page:
    """Create the page; ``live`` is the identifier of a page that receives events from the server of the live view.

    ``compute`` is the parameter ``live`` of :func:`write_html`.
    """
    rendered, motion = picture.render(), picture.trajectory
    cell = web_cell_of(picture, rendered, compute)
    script = panels.part("motion_page.js")
    if cell is not None:
        verifying = ["verifier.js"] if "proof-file" in cell.texts else []
        verifying += ["proof_page.js"] if cell.settings["proof"] else []
        script += "\n".join(map(panels.part, (*panels.COMPUTING, "live_page.js", *verifying)))
    caption = rendered.caption
    # The line below the title, which is the caption of a picture without controls
    shown = [f"{name.lower()} {value}" for name, value in caption.figures if name in SUMMARY_FIGURES]
    headline = f'<b style="color:{theme.TONES[caption.tone]}">{escape(caption.headline)}</b>'
    summary = " \u00b7 ".join([*([] if caption.tone == "still" else [headline]), *map(escape, shown)])
    # Only a motion has plots over time
    plots = "" if motion is None else plots_html(motion, plot or PlotLimits.of(picture.arm))
    text = panels.page(
        picture.title or picture.arm.robot.name,
        "motion",
        picture.panel + plots + SIDE.format(caption=caption.html(rendered.stage.notes)),
        {**rendered.settings, "live": live, "web": None if cell is None else cell.settings},
        rendered.commands,
        label="Three-dimensional view",
        summary=summary,
        colours=() if picture.points is None else picture.points.legend,
        script=script,
        texts=None if cell is None else cell.texts,
        live=live is not None,
    )
    return Page(text, rendered)


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


@described(eq=False)
class PlotLimits:
    """The limits of the plots of a page, as for :meth:`pinproof.Trajectory.plot`."""

    limits: MotionLimits | None = key("limits of position, velocity and acceleration; None for none", default=None)
    jerk: npt.ArrayLike | None = key("jerk limits, (n,) or one number; None for none", default=None)
    rate_limits: Sequence[RateConstraint] = key("constraints such as torques, each of which adds a panel", default=())

    @classmethod
    def of(cls, arm: JointGroup) -> PlotLimits:
        """The known limits of an arm; accelerations that are only assumed are no limits."""
        limits = arm.limits
        assumed = limits.acceleration_source.startswith("default")
        acceleration = np.full(arm.dof, np.inf) if assumed else limits.acceleration
        lower, upper = limits.lower, limits.upper
        velocity, acceleration = (np.where(np.isnan(rates), np.inf, rates) for rates in (limits.velocity, acceleration))
        jerk = None if limits.jerk is None else np.where(np.isnan(limits.jerk), np.inf, limits.jerk)
        return cls(Bounds(velocity, acceleration, None, lower, upper, ""), jerk)


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
    xs, ys, kept = x.tolist(), y.tolist(), [0]
    least, most = -math.inf, math.inf  # slopes from the last kept point with which all points since are within FLAT
    for i in range(1, len(xs) - 1):
        first = kept[-1]
        run, rise, span = xs[i] - xs[first], ys[i] - ys[first], xs[i + 1] - xs[first]
        if run > 0.0:
            least, most = max(least, (rise - FLAT) / run), min(most, (rise + FLAT) / run)
        elif abs(rise) > FLAT:
            most = -math.inf
        slope = (ys[i + 1] - ys[first]) / span if span > 0.0 else math.inf
        if not (math.isfinite(slope) and least <= slope <= most):
            kept.append(i)
            least, most = -math.inf, math.inf
    return " ".join(f"{xs[i]:.1f},{ys[i]:.1f}" for i in (*kept, len(xs) - 1))
