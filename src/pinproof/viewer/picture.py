"""What is to be shown, and how it becomes the commands and settings of a page."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CheckResult, Obstacle, Scene
from pinproof.errors import InputError, ViewerError
from pinproof.model import Arm
from pinproof.motion import Trajectory
from pinproof.spatial import SE3, finite, matrix, rigid
from pinproof.viewer.animation import Film, Phase, animate, checked_motion, film, still
from pinproof.viewer.appearance import ball, tube
from pinproof.viewer.assembly import view_settings
from pinproof.viewer.camera import View, choose_view
from pinproof.viewer.caption import Caption, caption
from pinproof.viewer.cloud import ColouredPoints
from pinproof.viewer.contacts import Mark, body_nodes, mark_radius, marks_of
from pinproof.viewer.copies import GHOST_HUES, copies, ghosts_at, swept
from pinproof.viewer.frames import add_frames, frame_names
from pinproof.viewer.layers import Layer, checked_layers
from pinproof.viewer.simplify import simplified
from pinproof.viewer.stage import Stage, set_stage
from pinproof.viewer.surfaces import Rgba
from pinproof.viewer.surroundings import add_surroundings
from pinproof.viewer.wire import Commands, node_path

__all__ = ["Drawn", "Picture", "stage_commands"]

Array = npt.NDArray[np.float64]

PATH_RADIUS = 0.004
"""Metres; the drawn path of the tcp."""

PATH_ORANGE: Rgba = (0.93, 0.42, 0.05, 1.0)
START_WHITE: Rgba = (0.98, 0.98, 0.98, 1.0)

GHOST_OPACITY, SWEEP_OPACITY = 0.28, 0.30


@dataclass(frozen=True, eq=False)
class Drawn:
    """A picture that is drawn: its stage, commands, settings for the page's script, and words."""

    stage: Stage
    commands: Commands
    settings: dict[str, Any]
    words: Caption
    moving: bool
    frames: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Picture:
    """What is shown; the fields are those of :func:`pinproof.write_html`."""

    arm: Arm
    scene: Scene | None = None
    trajectory: Trajectory | None = None
    certificate: Certificate | None = None
    attached: Sequence[Obstacle] = ()
    q: npt.ArrayLike | None = None
    title: str | None = None
    points: ColouredPoints | None = None
    ghosts: npt.ArrayLike | None = None
    check: CheckResult | None = None
    frames: Mapping[str, SE3] = field(default_factory=dict)
    layers: Collection[str] = ()

    def draw(self) -> Drawn:
        """Draw it.

        Raises
        ------
        InputError
            If the fields do not go together.
        ViewerError
            If there is nothing to draw.
        """
        if self.trajectory is not None and (self.q is not None or self.check is not None):
            given = "q" if self.q is not None else "check"
            raise InputError(f"give a trajectory or {given}, not both: a trajectory says where the arm is")
        wanted, ghosts = checked_layers(self.layers), self._ghosts()
        stage = simplified(set_stage(self.arm, self.scene, self.attached, bodies=True))
        if not any(link.surfaces for link in stage.links):
            why = "; ".join(stage.notes) or "no link has geometry"
            raise ViewerError(f"robot {self.arm.robot.name!r} has nothing to draw: {why}")
        shown = self._film(stage)
        words = caption(self.arm, self.scene, self.trajectory, self.certificate, self.attached, self.check)
        marks = marks_of(self.check if words.contact is None else words.contact)
        extra = np.concatenate([np.empty((0, 3)), *self._points_to_frame(marks)])
        ghosted = ghosts_at(stage, ghosts)
        view = choose_view(stage, shown.poses, np.concatenate([shown.tcp, extra]), also=ghosted)
        commands, reach = stage_commands(stage, shown, view), view.radius
        if self.points is not None:
            self.points.draw(commands)
            words = replace(words, legend=self.points.legend)
        for number, mark in enumerate(marks):
            mark.draw(commands, number, mark_radius(reach))
        steps = swept(stage, shown, reach)
        placed = {name: poses[0] for name, poses in shown.frames.items()}
        placed |= {name: matrix(rigid(f"frames[{name!r}]", pose)) for name, pose in self.frames.items()}
        layers = self._layers(stage, shown, wanted, marks=len(marks), steps=len(steps), ghosts=len(ghosted))
        settings = {
            **view_settings(view),
            "duration": float(shown.times[-1]),
            "start": words.contact.time if words.contact is not None else None,
            "frames": add_frames(commands, placed, reach),
            "copies": [
                *copies(commands, stage, ghosted, "ghosts", opacity=GHOST_OPACITY, hues=GHOST_HUES, own=shown.poses[0]),
                *copies(commands, stage, steps, "sweep", opacity=SWEEP_OPACITY),
            ],
            "touching": body_nodes(stage, marks),
            "layers": [each.settings() for each in layers],
        }
        return Drawn(stage, commands, settings, words, self.trajectory is not None, tuple(shown.frames))

    def _film(self, stage: Stage) -> Film:
        names = [name for name in frame_names(stage) if name not in self.frames]
        if self.trajectory is not None:
            return film(stage, [Phase(checked_motion(self.arm, self.trajectory))], frames=names)
        return still(stage, self.arm.home if self.q is None else self.arm.configuration(self.q), frames=names)

    def _ghosts(self) -> Array:
        """(k, n) checked."""
        if self.ghosts is None:
            return np.empty((0, self.arm.dof))
        return finite("ghosts", np.atleast_2d(np.asarray(self.ghosts, dtype=float)), (None, self.arm.dof))

    def _points_to_frame(self, marks: Sequence[Mark]) -> list[Array]:
        return [mark.points for mark in marks] + ([] if self.points is None else [self.points.xyz])

    def _layers(
        self, stage: Stage, shown: Film, wanted: Collection[str], *, marks: int, steps: int, ghosts: int
    ) -> list[Layer]:
        """The layers that have something in them."""
        visible = tuple(("robot", link.name, "visual") for link in stage.links if link.surfaces)
        solid = tuple(("robot", link.name, "collision") for link in stage.links if link.bodies)
        told = len(self._ghosts())
        found: list[tuple[str, tuple[tuple[str, ...], ...], bool, str]] = [
            ("robot", visible, True, ""),
            ("collision", solid, False, ""),
            ("scene", (("scene",),) if stage.obstacles else (), True, ""),
            ("path", (("tcp path",),) if len(shown.tcp) > 1 else (), True, ""),
            ("sweep", (("sweep",),) if steps else (), False, f"{steps} steps"),
            (
                "ghosts",
                (("ghosts",),) if ghosts else (),
                True,
                f"{ghosts}" if ghosts == told else f"{ghosts} of {told}",
            ),
            ("frames", (("frames",),), bool(self.frames), ""),
            ("contact", (("contact",),) if marks else (), True, str(marks) if marks > 1 else ""),
            ("points", (("points",),) if self.points is not None else (), True, ""),
        ]
        return [Layer(name, nodes, on or name in wanted, note) for name, nodes, on, note in found if nodes]


def stage_commands(stage: Stage, shown: Film, view: View) -> Commands:
    """Everything that is drawn, as commands to meshcat's viewer."""
    commands = Commands()
    add_surroundings(commands, view, stage.floor)
    for link, root_from_link in zip(stage.links, shown.poses[0], strict=True):
        for number, surface in enumerate(link.surfaces):
            commands.set_surface(node_path("robot", link.name, "visual", str(number)), surface)
        for number, surface in enumerate(link.bodies):
            # drawn after what is opaque, and pushed back a little: it often lies on the visual surface itself
            look = {"depthWrite": False, "polygonOffset": True, "polygonOffsetFactor": -1, "polygonOffsetUnits": -1}
            commands.set_surface(node_path("robot", link.name, "collision", str(number)), surface, **look)
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
