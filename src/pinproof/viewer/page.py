"""The page of a robot or a motion: film, caption, layers and plots in one HTML file."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from html import escape
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy.typing as npt

from pinproof.collision import Certificate, CheckResult, Obstacle, Scene
from pinproof.common import theme
from pinproof.ik import SelfMotion, SelfMotionCurve
from pinproof.model import JointGroup
from pinproof.motion import Trajectory
from pinproof.spatial import SE3
from pinproof.viewer import panels
from pinproof.viewer.overlays import ColouredPoints
from pinproof.viewer.picture import Picture, RenderedPicture
from pinproof.viewer.plots import PlotLimits, plots_html

NO_FRAMES: Mapping[str, SE3] = MappingProxyType({})

SUMMARY_FIGURES = ("Proven clearance", "Duration")
"""Figures of a caption that are also in the line below the title."""

SIDE = """<section class="side card">
<div id="caption" aria-label="What is proven about this motion">{caption}</div>
<button type="button" id="moment" hidden>Show the contact</button>
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
    certificate: Certificate | None = None,
    attached: Sequence[Obstacle] = (),
    q: npt.ArrayLike | None = None,
    title: str | None = None,
    points: ColouredPoints | None = None,
    ghosts: npt.ArrayLike | None = None,
    elbow: SelfMotion | SelfMotionCurve | None = None,
    check: CheckResult | None = None,
    frames: Mapping[str, SE3] = NO_FRAMES,
    layers: Collection[str] = (),
    plot: PlotLimits | None = None,
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
    plot
        The limits in the plots of position, velocity, acceleration, jerk and torque over time, which the page shows
        below the motion. Default: the limits of position and velocity of the arm, and those of acceleration and jerk
        if they are known.

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
    picture = Picture(
        arm, scene, trajectory, certificate, attached, q, title, points, ghosts, check, frames, layers, elbow
    )  # fmt: skip
    panels.write_page(path, render_page(picture, plot=plot).text)


def render_page(picture: Picture, *, live: str | None = None, plot: PlotLimits | None = None) -> Page:
    """Create the page; ``live`` is the identifier of a page that receives events from the server of the live view."""
    rendered, motion = picture.render(), picture.trajectory
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
        plots + SIDE.format(caption=caption.html(rendered.stage.notes)),
        {**rendered.settings, "live": live},
        rendered.commands,
        label="Three-dimensional view",
        summary=summary,
        colours=() if picture.points is None else picture.points.legend,
        script=panels.part("motion_page.js"),
        live=live is not None,
    )
    return Page(text, rendered)
