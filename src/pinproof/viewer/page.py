"""The HTML page of a robot or a motion: one file that needs no network connection.

It contains the viewer of meshcat, commands, scripts, styles and texts.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping, Sequence
from html import escape
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy.typing as npt

from pinproof.collision import Certificate, CheckResult, Obstacle, Scene
from pinproof.common import theme
from pinproof.common.files import write_text_whole
from pinproof.errors import FileError, ViewerError
from pinproof.ik import SelfMotion, SelfMotionCurve
from pinproof.model import JointGroup
from pinproof.motion import Trajectory
from pinproof.spatial import SE3
from pinproof.viewer.overlays import ColouredPoints
from pinproof.viewer.picture import Picture, RenderedPicture
from pinproof.viewer.plots import PlotLimits, plots_html
from pinproof.viewer.wire import Commands

NO_FRAMES: Mapping[str, SE3] = MappingProxyType({})


# The page runs only the scripts that it contains; the browser blocks every network request.
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; worker-src blob:; connect-src {connect}; base-uri 'none'; form-action 'none'"
)


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
    try:
        write_text_whole(path, render_page(picture, plot=plot).text)
    except FileError as error:
        raise ViewerError(str(error)) from error


def render_page(picture: Picture, *, live: str | None = None, plot: PlotLimits | None = None) -> Page:
    """Create the page; ``live`` is the identifier of a page that receives events from the server of the live view."""
    rendered = picture.render()
    title = picture.title or picture.arm.robot.name
    settings = {**rendered.settings, "live": live}
    summary = " \u00b7 ".join(rendered.caption.summary)
    motion = picture.trajectory
    plots = "" if motion is None else plots_html(motion, plot or PlotLimits.of(picture.arm))
    body = fill(
        part("page.html"),
        {
            "title": escape(title),
            "caption": rendered.caption.html(rendered.stage.notes),
            "tone": rendered.caption.tone,
            "summary": escape(summary),
            "plots": plots,
        },
    )
    style, script = part("common.css") + part("page.css"), part("layers.js") + part("page.js")
    text = assemble(title, style, body, script, settings, rendered.commands, live=live is not None)
    return Page(text, rendered)


def assemble(
    title: str,
    style: str,
    body: str,
    script: str,
    settings: Mapping[str, Any],
    commands: Commands,
    *,
    live: bool = False,
) -> str:
    """The HTML of a page with a title in plain text, CSS, an HTML body and JavaScript.

    ``picture.js`` and ``player.js`` run before ``script``. The scripts have the object ``settings``, in which
    references to arrays of ``commands`` (to the viewer of meshcat) become typed arrays. With ``live``, the page may
    receive events from the server that sent it.
    """
    bundle, licences = _viewer_bundle()
    own = "\n".join([part("picture.js"), part("player.js"), script])
    settings = {**settings, "theme": theme.COLOURS}
    values = {
        "title": escape(title),
        "policy": POLICY.format(connect="'self'" if live else "'none'"),
        "style": theme.css() + style,
        "body": body,
        "licences": _inside_script(licences),
        "bundle": _inside_script(bundle),
        "settings": json.dumps(settings, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"),
        "commands": commands.json(),
        "pictures": commands.pictures_json(),
        "buffers": commands.base64(),
        "script": f'"use strict";\n(function () {{\n{own}\n}})();',
    }
    return fill(part("shell.html"), values)


def fill(template: str, values: Mapping[str, str]) -> str:
    """Replace each ``{{name}}`` of a template in a single pass, so that inserted text is never replaced again."""
    return re.sub(r"\{\{(\w+)\}\}", lambda place: values[place[1]], template)


def part(name: str, package: str = "pinproof.viewer") -> str:
    """The text of a file in a package."""
    return files(package).joinpath(name).read_text(encoding="utf-8")


def _viewer_bundle() -> tuple[str, str]:
    """The viewer of meshcat (MIT licence; it includes three.js and dat.GUI) and the licences to distribute with it."""
    spec = find_spec("meshcat")  # does not import the package; see pinproof.viewer.wire
    if spec is None or spec.origin is None:
        raise ViewerError("meshcat is not installed; pages need its viewer: pip install meshcat")
    folder = Path(spec.origin).parent / "viewer"
    try:
        bundle = (folder / "dist" / "main.min.js").read_text(encoding="utf-8")
        notices = [
            (folder / name).read_text(encoding="utf-8")
            for name in ("LICENSE", "dist/main.min.js.LICENSE.txt", "dist/main.min.js.THIRD_PARTY_LICENSES.json")
            if (folder / name).is_file()
        ]
    except OSError as error:
        raise ViewerError(f"the installed meshcat has no viewer at {error.filename}: reinstall it") from error
    return bundle, "\n\n".join(["The viewer below is meshcat's.", *notices])


def _inside_script(text: str) -> str:
    """Escape a text so that it cannot close the ``<script>`` element that contains it."""
    return re.sub(r"<(?=/script|!--)", r"\\x3c", text, flags=re.IGNORECASE)
