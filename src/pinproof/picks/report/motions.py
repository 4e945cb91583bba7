"""The motions of good picks as key frames for one page: resampled, so that a hundred of them stay a small file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import Obstacle, Scene
from pinproof.errors import MeshError
from pinproof.picks.verdict import PickVerdict
from pinproof.viewer.animation import Film, Phase, film, tracks
from pinproof.viewer.stage import Stage
from pinproof.viewer.surfaces import Surface, obstacle_surfaces
from pinproof.viewer.wire import Commands, node_path, transform_command

__all__ = ["Reel", "surfaces_of"]

Array = npt.NDArray[np.float64]

RATE, LEAST_RATE = 30.0, 5.0
"""Key frames a second of a motion: at best, and where there is so much motion that fewer fit."""

MOST_BYTES = 5e6
"""Of all motions together, as text."""

BYTES_A_POSE = 28 * 4 / 3
"""Seven numbers of four bytes, as base64."""

BYTES_A_LINK = 450
"""What a motion says of a link beside the poses."""

SHOWN_MOMENTS = 40
"""Moments of all motions together that the camera frames."""


SHOWN_PLACES = 4000
"""Places on all ways together that it frames."""


@dataclass(frozen=True, eq=False)
class Reel:
    """The motions of a page.

    Parameters
    ----------
    stage
        What they move.
    scene
        What stands around; of an obstacle that is carried, the drawn one moves.
    films
        One a verdict; None where there is nothing to play.
    bodies
        What is carried, by name, of each film; drawn only if the scene has none of that name.
    notes
        What was changed for show, in sentences.
    """

    stage: Stage
    scene: Scene
    films: tuple[Film | None, ...]
    bodies: tuple[dict[str, Obstacle], ...]
    notes: tuple[str, ...]

    @classmethod
    def of(cls, stage: Stage, scene: Scene, tool: Sequence[Obstacle], verdicts: Sequence[PickVerdict | None]) -> Reel:
        """The motions of verdicts; ``tool`` is what the stage draws with the tcp always."""
        always = {thing.name for thing in tool}
        parts = [_phases(verdict, always) for verdict in verdicts]
        seconds = [sum(phase.trajectory.duration for phase in phases) for phases in parts]
        room = MOST_BYTES / max(len(stage.links), 1)
        said = BYTES_A_LINK * np.array([bool(phases) for phases in parts])
        fits = np.cumsum(np.array(seconds) * LEAST_RATE * BYTES_A_POSE + said) <= room
        spare = room - said[fits].sum()  # for poses
        rate = min(RATE, spare / (BYTES_A_POSE * max(float(np.array(seconds)[fits].sum()), 1e-9)))
        films = tuple(
            film(stage, phases, rate=rate) if phases and fit else None for phases, fit in zip(parts, fits, strict=True)
        )
        bodies = tuple({thing.name: thing for phase in phases for thing in phase.attached} for phases in parts)
        notes = []
        if any(films):
            notes.append(f"Motions are resampled for show, {rate:.0f} poses a second; the proofs are of the motions.")
        if left := sum(bool(phases) and not fit for phases, fit in zip(parts, fits, strict=True)):
            notes.append(f"{left} more good picks have motions that found no room in this page.")
        return cls(stage, scene, films, bodies, tuple(notes))

    @property
    def moments(self) -> Array:
        """(M, L, 4, 4) poses of the links at some moments of the motions, for the camera."""
        films = [each for each in self.films if each is not None]
        none = np.empty((0, len(self.stage.links), 4, 4))
        chosen = films[:: max(1, len(films) * 2 // SHOWN_MOMENTS)]
        return np.concatenate([none, *(each.poses[[len(each.times) // 2, -1]] for each in chosen)])

    @property
    def ways(self) -> Array:
        """(N, 3) places on the ways of the tcp, and of what is carried, for the camera."""
        films = [each for each in self.films if each is not None]
        carried = [poses[:, :3, 3] for each in films for poses in each.riders.values()]
        ways = np.concatenate([np.empty((0, 3)), *(each.tcp for each in films), *carried])
        return ways[:: -(-len(ways) // SHOWN_PLACES) or 1]

    def add_to(self, commands: Commands) -> list[dict[str, Any] | None]:
        """The tracks of each motion; draws what is carried, hidden until its pick is chosen."""
        drawn: dict[tuple[str, bytes], str] = {}
        motions: list[dict[str, Any] | None] = []
        for shown, bodies in zip(self.films, self.bodies, strict=True):
            if shown is None:
                motions.append(None)
                continue
            places = {name: self._place(thing, commands, drawn) for name, thing in bodies.items()}
            motions.append(
                {
                    "duration": float(shown.times[-1]),
                    "tracks": tracks(commands, self.stage, shown, places),
                    "path": commands.array(shown.tcp.astype(np.float32).ravel()),
                    "riders": {places[name]: _column(poses[0]) for name, poses in shown.riders.items()},
                }
            )
        return motions

    def at_rest(self, rest: Film) -> list[dict[str, Any]]:
        """Commands that put everything back that a motion has moved."""
        names = {name for bodies in self.bodies for name in bodies}
        back = [
            transform_command(node_path("robot", link.name), at)
            for link, at in zip(self.stage.links, rest.poses[0], strict=True)
        ]
        things = (thing for thing in self.stage.obstacles if thing.name in names)
        return back + [transform_command(node_path("scene", thing.name), thing.pose) for thing in things]

    def _place(self, thing: Obstacle, commands: Commands, drawn: dict[tuple[str, bytes], str]) -> str:
        """The node of something carried, drawn once however many picks carry the like."""
        if any(thing.name == each.name for each in self.scene.obstacles):
            return node_path("scene", thing.name)
        surfaces = surfaces_of(thing)
        key = (thing.name, b"".join(surface.vertices.tobytes() for surface in surfaces))
        if key not in drawn:
            drawn[key] = path = node_path("riders", str(len(drawn)))
            for number, surface in enumerate(surfaces):
                commands.set_surface(f"{path}/{number}", surface)
            commands.set_property(path, "visible", False)
        return drawn[key]


def _phases(verdict: PickVerdict | None, always: set[str]) -> list[Phase]:
    if verdict is None:
        return []
    return [Phase(each.trajectory, tuple(t for t in each.attached if t.name not in always)) for each in verdict.motions]


def surfaces_of(thing: Obstacle) -> list[Surface]:
    """The pictures of a thing; none where they cannot be read."""
    try:
        return obstacle_surfaces(thing)
    except MeshError:  # a picture that is missing is no reason to show none
        return []


def _column(a_from_b: Array) -> list[float]:
    return [float(value) for value in a_from_b.T.ravel()]
