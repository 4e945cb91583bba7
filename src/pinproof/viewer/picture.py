"""What the page says about its motion. FREE stands there only with a proof for exactly what is shown.

The parts of a picture that a reader switches on and off.

What is to be shown, and how it becomes the commands and settings of a page.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CertificateStatus, CheckResult, FirstContact, Obstacle, Scene, UndecidedSpan
from pinproof.collision.certificate import proven_millimetres
from pinproof.errors import InputError, UnknownNameError, ViewerError
from pinproof.model import Arm
from pinproof.motion import Trajectory
from pinproof.spatial import SE3, finite, matrix, rigid
from pinproof.viewer.animation import Film, Phase, animate, checked_motion, film, still
from pinproof.viewer.assembly import view_settings
from pinproof.viewer.camera import View, choose_view
from pinproof.viewer.overlays import (
    GHOST_HUES,
    ColouredPoints,
    Mark,
    add_frames,
    add_surroundings,
    body_nodes,
    copies,
    frame_names,
    ghosts_at,
    mark_radius,
    marks_of,
    swept,
)
from pinproof.viewer.stage import Stage, set_stage, simplified
from pinproof.viewer.surfaces import Rgba, ball, tube
from pinproof.viewer.wire import Commands, node_path

__all__ = ["LAYERS", "Caption", "Drawn", "Layer", "Picture", "caption", "checked_layers", "stage_commands"]

UNPROVEN = "NOT VALIDATED"

BRIEF = ("Proven clearance", "Duration")
"""Figures that are told in one line too."""


@dataclass(frozen=True)
class Caption:
    """A headline, why, and figures.

    Parameters
    ----------
    headline
        ``FREE``, or ``NOT VALIDATED``.
    reason
        One sentence; why it is not validated, or what was proven.
    tone
        ``free``, ``colliding``, ``open`` or ``still``: how it is coloured.
    figures
        (name, value) pairs.
    left_out
        What the proof did not look at, and why.
    contact
        The contact that the picture marks.
    legend
        What the colours of drawn points mean: (text, (r, g, b)) pairs.
    """

    headline: str
    reason: str
    tone: str
    figures: tuple[tuple[str, str], ...]
    left_out: tuple[str, ...] = ()
    contact: FirstContact | None = None
    legend: tuple[tuple[str, tuple[float, float, float]], ...] = ()

    def html(self, notes: Sequence[str] = ()) -> str:
        """As HTML; every text is escaped."""
        rows = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in self.figures)
        remarks = f'<ul class="notes" aria-label="Remarks about the picture">{_items(notes)}</ul>' if notes else ""
        count = len(self.left_out)
        summary = f"{count} pair{'' if count == 1 else 's'} left out of the proof"
        left_out = f"<details><summary>{summary}</summary><ul>{_items(self.left_out)}</ul></details>" if count else ""
        return (
            f'<p class="verdict {escape(self.tone)}" id="verdict">{escape(self.headline)}</p>'
            f'<p id="reason">{escape(self.reason)}</p><dl>{rows}</dl>{self._legend()}{left_out}{remarks}'
        )

    @property
    def brief(self) -> tuple[str, ...]:
        """What there is to say in one line: the headline, unless there was nothing to prove, and the main figures."""
        figures = tuple(f"{name.lower()} {value}" for name, value in self.figures if name in BRIEF)
        return figures if self.tone == "still" else (self.headline, *figures)

    def _legend(self) -> str:
        items = "".join(
            f'<li><span class="swatch" style="background:rgb({r * 255:.0f},{g * 255:.0f},{b * 255:.0f})"></span>'
            f"{escape(text)}</li>"
            for text, (r, g, b) in self.legend
        )
        return f'<ul class="legend" aria-label="What the colours mean">{items}</ul>' if items else ""


def caption(
    arm: Arm,
    scene: Scene | None,
    motion: Trajectory | None,
    certificate: Certificate | None,
    attached: Sequence[Obstacle] = (),
    check: CheckResult | None = None,
) -> Caption:
    """The caption of a motion of an arm in a scene; ``motion`` None is a still picture, of which ``check`` may tell."""
    figures = [("Robot", arm.robot.name), ("Base to tcp", f"{arm.base} \u2192 {arm.tcp}")]
    if motion is None:
        return _still(check, figures)
    duration = ("Duration", f"{motion.duration:.2f} s")
    if certificate is None:
        return _open("No certificate was given for this motion.", [*figures, duration])
    if not certificate.matches(motion, arm, Scene() if scene is None else scene, attached):
        return _open("The certificate given belongs to another motion, arm, scene or tool.", [*figures, duration])
    if certificate.status is CertificateStatus.FREE:
        proof = "Proven at every instant, not at samples: no checked pair comes closer than the clearance below."
        clearance = ("Proven clearance", proven_millimetres(certificate.clearance))
        left_out = tuple(f"{' and '.join(pair.owners)}: {pair.reason}" for pair in certificate.excluded)
        contact = "Ends in contact; told of the motion run backwards" if certificate.backwards else "Begins in contact"
        leaves = tuple((contact, str(parting)) for parting in certificate.partings)
        return Caption("FREE", proof, "free", (*figures, clearance, duration, *leaves), left_out)
    if certificate.status is CertificateStatus.COLLIDING and certificate.first_contact is not None:
        reason = _contact(certificate.first_contact, certificate.margin)
        return Caption(UNPROVEN, reason, "colliding", (*figures, duration), contact=certificate.first_contact)
    return _open(_undecided(certificate.undecided), [*figures, duration])


def _still(check: CheckResult | None, figures: Sequence[tuple[str, str]]) -> Caption:
    if check is None:
        return Caption(
            UNPROVEN, "A still picture: there is no motion that could have been proven.", "still", (*figures,)
        )
    if check.free:
        reason = "The check that was given found no contact here; what lies around this picture is not proven."
        return Caption(UNPROVEN, reason, "still", (*figures,))
    first, more = check.contacts[0], len(check.contacts) - 1
    reason = f"{first}{f', and {more} more' if more else ''}. Red balls mark the places, arrows the normals."
    return Caption("IN CONTACT", reason, "colliding", (*figures, ("Contacts", str(len(check.contacts)))))


def _open(reason: str, figures: Sequence[tuple[str, str]]) -> Caption:
    return Caption(UNPROVEN, reason, "open", tuple(figures))


def _contact(contact: FirstContact, margin: float) -> str:
    one, other = contact.bodies
    how = f"{one} touches {other}" if contact.penetrating else f"{one} comes within {margin * 1e3:g} mm of {other}"
    return f"Colliding: {how} at {contact.time:.3f} s. The red ball marks the place, the two bodies are red."


def _undecided(span: UndecidedSpan | None) -> str:
    said = "Undecided: neither contact nor freedom could be proven"
    if span is None:
        return f"{said}."
    return f"{said}: {span.bodies[0]} and {span.bodies[1]} between {span.start:.3f} and {span.end:.3f} s."


def _items(texts: Sequence[str]) -> str:
    return "".join(f"<li>{escape(text)}</li>" for text in texts)


LAYERS = {
    "robot": "Robot",
    "collision": "Collision geometry",
    "scene": "Obstacles",
    "path": "Tcp path",
    "sweep": "Swept tool",
    "ghosts": "Ghosts",
    "frames": "Frames",
    "contact": "Contacts",
    "points": "Points",
}
"""What a page can show and hide, by the name it is called by, with its label."""


@dataclass(frozen=True)
class Layer:
    """A part of the picture that can be switched.

    Parameters
    ----------
    name
        One of :data:`LAYERS`.
    nodes
        Its nodes in meshcat's tree.
    shown
        Whether it is seen at first.
    note
        Added to its label: a number, how it is drawn.
    """

    name: str
    nodes: tuple[tuple[str, ...], ...]
    shown: bool
    note: str = ""

    def settings(self) -> dict[str, Any]:
        """For the page's script."""
        return {
            "name": self.name,
            "label": LAYERS[self.name],
            "note": self.note,
            "nodes": [list(node) for node in self.nodes],
            "shown": self.shown,
        }


def checked_layers(names: Collection[str]) -> frozenset[str]:
    """The names of layers.

    Raises
    ------
    UnknownNameError
        For one that is none of :data:`LAYERS`.
    """
    for name in [names] if isinstance(names, str) else names:
        if name not in LAYERS:
            raise UnknownNameError("layer", name, LAYERS, "layers")
    return frozenset([names] if isinstance(names, str) else names)


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
