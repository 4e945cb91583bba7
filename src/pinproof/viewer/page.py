"""The page: one HTML file with the viewer, the scene, the motion and its caption; it asks no network for anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, FirstContact, Obstacle, Scene
from pinproof.description.whole_file import write_text_whole
from pinproof.errors import FileError, InputError, ViewerError
from pinproof.model import Arm
from pinproof.motion import Trajectory
from pinproof.viewer.animation import Film, Phase, animate, checked_motion, film, still
from pinproof.viewer.appearance import ball, tube
from pinproof.viewer.assembly import assemble, fill, part, view_settings
from pinproof.viewer.camera import View, choose_view
from pinproof.viewer.caption import Caption, caption
from pinproof.viewer.cloud import ColouredPoints
from pinproof.viewer.stage import Stage, set_stage
from pinproof.viewer.surfaces import Rgba
from pinproof.viewer.surroundings import add_surroundings
from pinproof.viewer.wire import Commands, node_path

__all__ = ["Page", "render_page", "write_html"]

PATH_RADIUS = 0.004
"""Metres; the drawn path of the tcp."""

PATH_ORANGE: Rgba = (0.93, 0.42, 0.05, 1.0)
START_WHITE: Rgba = (0.98, 0.98, 0.98, 1.0)
CONTACT_RED: Rgba = (0.90, 0.05, 0.05, 0.85)

CONTACT_RADIUS = 0.02
"""Metres; the ball that marks a contact."""


@dataclass(frozen=True, eq=False)
class Page:
    """A page's HTML, what it shows, and whether it shows it in motion."""

    text: str
    stage: Stage
    moving: bool


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
) -> None:
    """Write a page that shows an arm, its scene and a motion; it opens anywhere, offline.

    ``page.html#t=1.2`` opens it at rest at 1.2 s.

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

    Raises
    ------
    InputError
        If the trajectory moves other joints than the arm's, has no timing, or ``q`` is given besides it.
    ViewerError
        If the page cannot be written, or meshcat's viewer is not installed.
    """
    page = render_page(
        arm, scene, trajectory, certificate=certificate, attached=attached, q=q, title=title, points=points
    )
    try:
        write_text_whole(path, page.text)
    except FileError as error:
        raise ViewerError(str(error)) from error


def render_page(
    arm: Arm,
    scene: Scene | None,
    trajectory: Trajectory | None,
    *,
    certificate: Certificate | None = None,
    attached: Sequence[Obstacle] = (),
    q: npt.ArrayLike | None = None,
    title: str | None = None,
    live: bool = False,
    points: ColouredPoints | None = None,
) -> Page:
    """The page; ``live`` lets it listen to the server it came from."""
    if trajectory is not None and q is not None:
        raise InputError("give a trajectory or q, not both: a trajectory says where the arm is")
    stage = set_stage(arm, scene, attached)
    if not stage.links:
        why = "; ".join(stage.notes) or "no link has geometry"
        raise ViewerError(f"robot {arm.robot.name!r} has nothing to draw: {why}")
    if trajectory is not None:
        shown = film(stage, [Phase(checked_motion(arm, trajectory))])
    else:
        shown = still(stage, arm.home if q is None else arm.configuration(q))
    marks = np.empty((0, 3)) if points is None else points.xyz
    view = choose_view(stage, shown.poses, np.concatenate([shown.tcp, marks]))
    commands = stage_commands(stage, shown, view)
    words = caption(arm, scene, trajectory, certificate, attached)
    if points is not None:
        points.draw(commands)
        words = replace(words, legend=points.legend)
    if words.contact is not None:
        mark_contact(commands, words.contact)
    text = _assemble(stage, shown, view, commands, words, title or arm.robot.name, live)
    return Page(text, stage, moving=trajectory is not None)


def stage_commands(stage: Stage, shown: Film, view: View) -> Commands:
    """Everything that is drawn, as commands to meshcat's viewer."""
    commands = Commands()
    add_surroundings(commands, view, stage.floor)
    for link, root_from_link in zip(stage.links, shown.poses[0], strict=True):
        for number, surface in enumerate(link.surfaces):
            commands.set_surface(node_path("robot", link.name, str(number)), surface)
        commands.set_transform(node_path("robot", link.name), root_from_link)
    for obstacle in stage.obstacles:
        for number, surface in enumerate(obstacle.surfaces):
            commands.set_surface(node_path("scene", obstacle.name, str(number)), surface)
        commands.set_transform(node_path("scene", obstacle.name), obstacle.pose)
    add_path(commands, shown)
    animate(commands, stage, shown)
    return commands


def add_path(commands: Commands, shown: Film) -> None:
    """The way of the tcp, from a white ball to an orange one."""
    line = tube(shown.tcp, PATH_RADIUS, PATH_ORANGE)
    if line is not None:
        commands.set_surface("/tcp path/line", line)
        commands.set_surface("/tcp path/start", ball(shown.tcp[0], 2.5 * PATH_RADIUS, START_WHITE))
        commands.set_surface("/tcp path/end", ball(shown.tcp[-1], 2.5 * PATH_RADIUS, PATH_ORANGE))


def mark_contact(commands: Commands, contact: FirstContact) -> None:
    """A ball midway between the two points of a contact, seen through whatever lies before it."""
    surface = ball(contact.points.mean(axis=0), CONTACT_RADIUS, CONTACT_RED)
    commands.set_surface("/contact", surface, type="MeshBasicMaterial", depthTest=False)


def _assemble(stage: Stage, shown: Film, view: View, commands: Commands, words: Caption, title: str, live: bool) -> str:
    settings = {**view_settings(view), "duration": float(shown.times[-1]), "live": live}
    body = fill(part("page.html"), {"title": escape(title), "caption": words.html(stage.notes)})
    style, script = part("common.css") + part("page.css"), part("page.js")
    return assemble(title, style, body, script, settings, commands, live=live)
