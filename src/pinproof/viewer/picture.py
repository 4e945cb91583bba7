"""The content of a picture: its objects, its layers, and its caption.

:class:`Picture` turns an arm, a scene and a motion into commands and settings for the page. The caption is FREE only
with a certificate for exactly the motion, arm, scene and attached objects that are shown.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import NoneType
from typing import Any, TypedDict

import numpy as np
import numpy.typing as npt

from pinproof.collision import (
    Certificate,
    CertificateStatus,
    CheckResult,
    CollisionChecker,
    Obstacle,
    Scene,
    proven_millimetres,
)
from pinproof.common import theme
from pinproof.common.validation import require_type
from pinproof.errors import InputError, UnknownNameError, ViewerError
from pinproof.ik import SelfMotion, SelfMotionCurve
from pinproof.model import JointGroup, guess_mark
from pinproof.motion import Trajectory, check_limits
from pinproof.spatial import SE3, finite, matrix, rigid
from pinproof.viewer import overlays
from pinproof.viewer.camera import View, choose_view, tool_points
from pinproof.viewer.panels import Caption
from pinproof.viewer.stage import (
    Drawing,
    Film,
    FilmPhase,
    checked_motion,
    film,
    film_of_elbow,
    set_stage,
    simplified,
    still,
    tracks,
)
from pinproof.viewer.surfaces import ball, tube
from pinproof.viewer.wire import Commands, node_name, node_path

UNPROVEN, CONFIGURATION, UNTOUCHED, MAP = "NOT VALIDATED", "CONFIGURATION", "NO CONTACT", "MAP"


def caption_of(
    arm: JointGroup,
    scene: Scene | None,
    motion: Trajectory | None,
    certificate: Certificate | None,
    attached: Sequence[Obstacle] = (),
    check: CheckResult | None = None,
) -> Caption:
    """The caption of a motion, or of a configuration and its ``check`` if ``motion`` is None."""
    ends = ", ".join(f"{base} \u2192 {tcp}" for base, tcp in arm.ends.values())
    figures = [("Robot", arm.robot.name), ("Base to tcp", ends)]
    headline, tone, excluded = UNPROVEN, "open", []
    # A configuration: nothing is proven about motions
    if motion is None:
        headline, tone = CONFIGURATION, "still"
        reason = "The picture shows a configuration; there is no motion to prove."
        if check is not None and check.free:
            headline = UNTOUCHED
            reason = "The check found no contact at this configuration. Nothing is proven about motions."
        elif check is not None:
            headline, tone, more = "IN CONTACT", "colliding", len(check.contacts) - 1
            more_text = f", and {more} more" if more else ""
            reason = f"{check.contacts[0]}{more_text}. Red spheres mark the contacts, arrows their normals."
            figures.append(("Contacts", str(len(check.contacts))))
        return Caption(headline, reason, tone, tuple(figures))
    duration = ("Duration", f"{motion.duration:.2f} s{guess_mark(motion.limits_note)}")
    # Only a certificate of exactly what is shown counts
    if certificate is None:
        reason = "There is no certificate for this motion."
    elif not certificate.matches(motion, arm, Scene() if scene is None else scene, attached):
        reason = "The certificate is for another motion, arm, scene or tool."
    elif certificate.status is CertificateStatus.FREE:
        headline, tone = "FREE", "free"
        reason = "Proven at every instant, not at samples: every checked pair keeps at least the clearance below."
        figures.append(("Proven clearance", proven_millimetres(certificate.clearance)))
        excluded = [f"{' and '.join(pair.owners)}: {pair.reason}" for pair in certificate.excluded]
    elif certificate.status is CertificateStatus.COLLIDING and certificate.first_contact is not None:
        contact, tone = certificate.first_contact, "colliding"
        body, obstacle = contact.bodies
        near = f"comes within {certificate.margin * 1e3:g} mm of"
        what = f"{body} {'touches' if contact.penetrating else near} {obstacle}"
        reason = f"Colliding: {what} at {contact.time:.3f} s. A red sphere marks the contact; both bodies are red."
    elif certificate.status is CertificateStatus.VIOLATED or certificate.undecided_constraint is not None:
        reason = f"{certificate.message[:1].upper()}{certificate.message[1:]}."
    else:
        span, where = certificate.undecided, ""
        if span is not None:
            where = f" for {span.bodies[0]} and {span.bodies[1]} between {span.start:.3f} and {span.end:.3f} s"
        reason = f"Undecided: neither a contact nor its absence could be proven{where}."
    figures.append(duration)
    # What a proof covers besides contacts; the certificate may state other limits than those of the arm
    if certificate is not None and headline == "FREE":
        limits = "not compared" if certificate.limits is None else str(certificate.limits)
        if outside := check_limits(motion, arm.limits).violations:
            limits = f"{'not compared' if certificate.limits is None else 'not those of the arm'}; {outside[0]}"
        figures.append(("Joint limits", limits))
        figures += [("Constraint", str(proof)) for proof in certificate.constraints]
        end = "Ends in contact (described for the reversed motion)" if certificate.backwards else "Starts in contact"
        figures += [(end, str(parting)) for parting in certificate.partings]
    summary = f"{len(excluded)} body pair{'' if len(excluded) == 1 else 's'} not covered by the proof"
    return Caption(headline, reason, tone, tuple(figures), ((summary, excluded),) if excluded else ())


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
"""The layers of a page by name, with the label of their switch."""


PATH_RADIUS, PATH_SHARE = 0.004, 0.006
"""Radius of the drawn tcp path: metres, and the largest fraction of the radius of the picture."""

PATH_ORANGE, START_WHITE = theme.rgba("path"), theme.rgba("start")

GHOST_OPACITY, SWEEP_OPACITY = 0.28, 0.30


@dataclass(frozen=True, eq=False)
class RenderedPicture:
    """A picture as drawing commands, settings for the script of the page, and a caption.

    ``moving`` states whether it shows a motion; ``frames`` names the links whose frames are drawn.
    """

    stage: Drawing
    commands: Commands
    settings: dict[str, Any]
    caption: Caption
    moving: bool
    frames: tuple[str, ...]
    curve: SelfMotionCurve | None = None  # along which a slider moves the arm

    @property
    def start(self) -> float:
        """Time (s) at which the page opens."""
        return float(self.settings["start"] or 0.0)


class PictureContent(TypedDict, total=False):
    """What a picture shows besides an arm, a scene and a motion: keyword arguments of :func:`pinproof.write_html`."""

    certificate: Certificate | None
    attached: Sequence[Obstacle]
    q: npt.ArrayLike | None
    title: str | None
    points: overlays.ColouredPoints | None
    ghosts: npt.ArrayLike | None
    check: CheckResult | None
    frames: Mapping[str, SE3]
    layers: Collection[str]
    elbow: SelfMotion | SelfMotionCurve | None
    panel: str
    checker: CollisionChecker | None


@dataclass(frozen=True, eq=False)
class Picture:
    """The content of a picture; the fields are the parameters of :func:`pinproof.write_html`."""

    arm: JointGroup
    scene: Scene | None = None
    trajectory: Trajectory | None = None
    certificate: Certificate | None = None
    attached: Sequence[Obstacle] = ()
    q: npt.ArrayLike | None = None
    title: str | None = None
    points: overlays.ColouredPoints | None = None
    ghosts: npt.ArrayLike | None = None
    check: CheckResult | None = None
    frames: Mapping[str, SE3] = field(default_factory=dict)
    layers: Collection[str] = ()
    elbow: SelfMotion | SelfMotionCurve | None = None
    panel: str = ""
    checker: CollisionChecker | None = None

    def render(self) -> RenderedPicture:
        """Create the drawing commands, the settings and the caption.

        InputError if fields contradict each other; ViewerError if the robot has no geometry, or a shape cannot be
        drawn.
        """
        require_type("arm", self.arm, JointGroup)
        require_type("scene", self.scene, Scene, NoneType)
        if self.trajectory is not None and (self.q is not None or self.check is not None):
            given = "q" if self.q is not None else "check"
            raise InputError(f"trajectory and {given} cannot be combined; remove one of them")
        # Everything that can be refused, before anything is loaded
        curve = self._curve()
        wanted = [self.layers] if isinstance(self.layers, str) else self.layers
        for name in wanted:
            if name not in LAYERS:
                raise UnknownNameError("layer", name, LAYERS, "layers")
        ghosts = np.empty((0, self.arm.dof))
        if self.ghosts is not None:
            ghosts = finite("ghosts", np.atleast_2d(np.asarray(self.ghosts, dtype=float)), (None, self.arm.dof))
        stage = simplified(set_stage(self.arm, self.scene, self.attached, bodies=True))
        if not any(link.surfaces for link in stage.links):
            why = "; ".join(stage.notes) or "no link has geometry"
            raise ViewerError(f"robot {self.arm.robot.name!r} cannot be drawn: {why}")
        # The key frames of the motion, of the self-motion, or of one configuration
        names = [name for name in overlays.frame_names(stage) if name not in self.frames]
        q = self.arm.home if self.q is None else self.arm.configuration(self.q)
        if curve is not None:
            shown = film_of_elbow(stage, curve, names)
        elif self.trajectory is not None:
            shown = film(stage, [FilmPhase(checked_motion(self.arm, self.trajectory))], frames=names)
        else:
            shown = still(stage, q, frames=names)
        # The caption, and the slider of a self-motion, which opens at the solution closest to q
        parameter = None
        caption = caption_of(self.arm, self.scene, self.trajectory, self.certificate, self.attached, self.check)
        if curve is not None:
            reason = (
                f"The slider moves {curve.parameter} along a curve of IK solutions of one pose of the tcp. Nothing is "
                "proven about collisions."
            )
            span = (curve.parameter, f"{curve.lower:.3f} to {curve.upper:.3f}")
            caption = replace(caption, reason=reason, figures=(*caption.figures, span))
            joint = self.arm.joint_names.index(curve.parameter)
            opened = float(np.clip(curve.nearest(q)[joint], curve.lower, curve.upper))
            unit = "rad" if self.arm.angular[joint] else "m"
            parameter = {"name": curve.parameter, "unit": unit, "first": curve.lower, "shown": opened}
        # What is drawn besides the robot and the scene, and the camera that frames all of it
        contact = None
        if self.trajectory is not None and self.certificate is not None and caption.tone == "colliding":
            contact = self.certificate.first_contact
        marks = overlays.marks_of(self.check if contact is None else contact)
        ghost_poses = overlays.ghosts_at(stage, ghosts)
        extra = [mark.points for mark in marks] + ([] if self.points is None else [self.points.xyz])
        points = np.concatenate([*shown.tcps.swapaxes(0, 1), *extra])
        view = choose_view(stage, shown.poses, points, also=ghost_poses, tool=tool_points(stage, shown.poses))
        commands, radius = stage_commands(stage, shown, view), view.radius
        # The commands and settings for the page
        if self.points is not None:
            self.points.draw(commands)
            if self.trajectory is None and self.check is None:
                reason = "The coloured points show a map; the arm shows one configuration, and nothing is proven."
                caption = replace(caption, headline=MAP, reason=reason)
        for number, mark in enumerate(marks):
            mark.draw(commands, number, max(overlays.BALL_SHARE * radius, overlays.LEAST_BALL))
        steps = (
            overlays.swept(stage, shown, radius)
            if curve is None
            else overlays.swept(stage, still(stage, curve.q[0]), radius)
        )
        frames = {name: poses[0] for name, poses in shown.frames.items()}
        frames |= {name: matrix(rigid(f"frames[{name!r}]", pose)) for name, pose in self.frames.items()}
        look = {"opacity": GHOST_OPACITY, "hues": [*map(theme.rgb, theme.GHOSTS)], "own": shown.poses[0]}
        settings = {
            **view.settings(),
            "tools": stage.tools,
            "duration": float(shown.times[-1]),
            "start": None if contact is None else contact.time,
            "parameter": parameter,
            "frames": overlays.add_frames(commands, frames, radius),
            "copies": [
                *overlays.copies(commands, stage, ghost_poses, "ghosts", **look),
                *overlays.copies(commands, stage, steps, "sweep", opacity=SWEEP_OPACITY),
            ],
            "touching": overlays.body_nodes(stage, marks),
            "layers": self._layers(stage, shown, wanted, len(marks), len(steps), len(ghost_poses), len(ghosts)),
        }
        moving = self.trajectory is not None or curve is not None
        return RenderedPicture(stage, commands, settings, caption, moving, tuple(shown.frames), curve)

    def _curve(self) -> SelfMotionCurve | None:
        """The curve of the slider: the longest one of a self-motion."""
        if self.elbow is None:
            return None
        given = [name for name in ("trajectory", "check") if getattr(self, name) is not None]
        if given:
            raise InputError(f"elbow and {given[0]} cannot be combined; remove one of them")
        curve = self.elbow.or_raise().curves[0] if isinstance(self.elbow, SelfMotion) else self.elbow
        if curve.parameter not in self.arm.joint_names or curve.q.shape[1] != self.arm.dof:
            raise InputError(
                f"elbow is a self-motion of another arm: it has {curve.q.shape[1]} joints with {curve.parameter!r}"
            )
        return curve

    def _layers(
        self, stage: Drawing, shown: Film, wanted: Collection[str], marks: int, steps: int, ghosts: int, given: int
    ) -> list[dict[str, Any]]:
        """The layers that are not empty, as the script of the page needs them."""
        links = [(node_name(link.name), link.surfaces, link.bodies) for link in stage.links]
        copied = f"{ghosts}" if ghosts == given else f"{ghosts} of {given}"
        # Nodes in meshcat's tree, whether they are visible when the page opens, and a note after the label
        layers: dict[str, tuple[list[list[str]], bool, str]] = {
            "robot": ([["robot", name, "visual"] for name, surfaces, _ in links if surfaces], True, ""),
            "collision": ([["robot", name, "collision"] for name, _, bodies in links if bodies], False, ""),
            "scene": ([["scene"]] if stage.obstacles else [], True, ""),
            "path": ([["tcp path"]] if np.ptp(shown.tcps, axis=0).any() else [], self.points is None, ""),
            "sweep": ([["sweep"]] if steps else [], False, f"{steps} steps"),
            "ghosts": ([["ghosts"]] if ghosts else [], True, copied),
            "frames": ([["frames"]], bool(self.frames), ""),
            "contact": ([["contact"]] if marks else [], True, str(marks) if marks > 1 else ""),
            "points": ([["points"]] if self.points is not None else [], True, ""),
        }
        return [
            {"name": name, "label": LAYERS[name], "nodes": nodes, "shown": visible or name in wanted, "note": note}
            for name, (nodes, visible, note) in layers.items()
            if nodes
        ]


def stage_commands(stage: Drawing, shown: Film, view: View) -> Commands:
    """The commands that draw the links, obstacles, tcp path and motion in meshcat's viewer."""
    commands = Commands()
    overlays.add_surroundings(commands, view, stage.floor(shown.poses))
    for link, root_from_link in zip(stage.links, shown.poses[0], strict=True):
        for number, surface in enumerate(link.surfaces):
            commands.set_surface(node_path("robot", link.name, "visual", str(number)), surface)
        for number, surface in enumerate(link.bodies):
            # Rendered after opaque objects and with a depth offset, because it often coincides with the visual surface.
            look = {"depthWrite": False, "polygonOffset": True, "polygonOffsetFactor": -1, "polygonOffsetUnits": -1}
            commands.set_surface(node_path("robot", link.name, "collision", str(number)), surface, **look)
        commands.set_transform(node_path("robot", link.name), root_from_link)
    for obstacle in stage.obstacles:
        for number, surface in enumerate(obstacle.surfaces):
            commands.set_surface(node_path("scene", obstacle.name, str(number)), surface)
        commands.set_transform(node_path("scene", obstacle.name), obstacle.pose)
    # The path of each tcp, from a white sphere at its start to an orange one at its end
    radius = min(PATH_RADIUS, PATH_SHARE * view.radius)
    for number, tcp in enumerate(shown.tcps.swapaxes(0, 1)):
        line, node = tube(tcp, radius, PATH_ORANGE), f"/tcp path/{number}"
        if line is not None:
            commands.set_surface(f"{node}/line", line)
            commands.set_surface(f"{node}/start", ball(tcp[0], 2.5 * radius, START_WHITE))
            commands.set_surface(f"{node}/end", ball(tcp[-1], 2.5 * radius, PATH_ORANGE))
    if animations := tracks(commands, stage, shown):
        commands.set_animation(animations)
    return commands
