"""The page: one HTML file with the viewer, the scene, the motion and its caption; it asks no network for anything."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from types import MappingProxyType

import numpy.typing as npt

from pinproof.collision import Certificate, CheckResult, Obstacle, Scene
from pinproof.common.files import write_text_whole
from pinproof.errors import FileError, ViewerError
from pinproof.model import Arm
from pinproof.motion import Trajectory
from pinproof.spatial import SE3
from pinproof.viewer.assembly import assemble, fill, part
from pinproof.viewer.overlays import ColouredPoints
from pinproof.viewer.picture import Picture
from pinproof.viewer.stage import Stage

__all__ = ["NO_FRAMES", "Page", "render_page", "write_html"]

NO_FRAMES: Mapping[str, SE3] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class Page:
    """A page's HTML, what it shows, whether in motion, the links whose frames it has, and when (s) it opens at rest."""

    text: str
    stage: Stage
    moving: bool
    frames: tuple[str, ...] = ()
    start: float = 0.0


def write_html(
    path: str | Path,
    arm: Arm,
    scene: Scene | None = None,
    trajectory: Trajectory | None = None,
    *,
    certificate: Certificate | None = None,
    attached: Sequence[Obstacle] = (),
    q: npt.ArrayLike | None = None,
    title: str | None = None,
    points: ColouredPoints | None = None,
    ghosts: npt.ArrayLike | None = None,
    check: CheckResult | None = None,
    frames: Mapping[str, SE3] = NO_FRAMES,
    layers: Collection[str] = (),
) -> None:
    """Write a page that shows an arm, its scene and a motion; it opens anywhere, offline.

    ``page.html#t=1.2`` opens it at rest at 1.2 s, ``page.html#still`` as a bare picture. A certificate with a contact
    opens it at the contact, with the two bodies in red.

    Parameters
    ----------
    path
        The file; written whole or not at all.
    arm, scene
        What is drawn, in the frame of the robot's root link.
    trajectory
        What is played. Without it, a still picture of ``q``.
    certificate
        The caption reads NOT VALIDATED unless this is FREE and made for exactly this trajectory, arm, scene and
        attached objects.
    attached
        Objects that move with the tcp, as the checker was given them; their pose is ``tcp_from_object``.
    q
        (n,) the configuration of a still picture; by default the arm's home.
    title
        The title of the page; by default the robot's name.
    points
        Coloured points to draw, with their legend.
    ghosts
        (k, n) configurations at which the arm is drawn once more, faintly: the branches of an IK answer.
    check
        What a checker found at ``q``: its contacts are marked, with their normals, and the bodies are red.
    frames
        ``root_from_frame`` by name: frames to draw with their names, besides those of the arm's links.
    layers
        What is shown at first besides the rest, all of which the page can switch: ``collision`` (the geometry that
        checks see; of meshes their hulls), ``frames`` (of base, links and tcp), ``sweep`` (the tool at steps of the
        motion).

    Raises
    ------
    InputError
        If the trajectory moves other joints than the arm's, has no timing, or ``q`` is given besides it.
    UnknownNameError
        For a layer that there is not.
    ViewerError
        If the page cannot be written, or meshcat's viewer is not installed.
    """
    picture = Picture(
        arm, scene, trajectory, certificate, attached, q, title, points, ghosts, check, frames, layers
    )  # fmt: skip
    try:
        write_text_whole(path, render_page(picture).text)
    except FileError as error:
        raise ViewerError(str(error)) from error


def render_page(picture: Picture, *, live: str | None = None) -> Page:
    """The page; ``live`` is its number where it listens to the server it came from."""
    drawn = picture.draw()
    title = picture.title or picture.arm.robot.name
    settings = {**drawn.settings, "live": live}
    plate = " \u00b7 ".join(drawn.words.brief)
    body = fill(
        part("page.html"),
        {
            "title": escape(title),
            "caption": drawn.words.html(drawn.stage.notes),
            "tone": drawn.words.tone,
            "plate": escape(plate),
        },
    )
    style, script = part("common.css") + part("page.css"), part("layers.js") + part("page.js")
    text = assemble(title, style, body, script, settings, drawn.commands, live=live is not None)
    return Page(text, drawn.stage, drawn.moving, drawn.frames, drawn.settings["start"] or 0.0)
