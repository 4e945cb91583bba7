"""Scenes of obstacles, and the bodies that the arm carries (attachments)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.geometry.shapes import Obstacle
from pinproof.common.display import html_block, html_list, html_table, outline, shortened
from pinproof.common.validation import require_type
from pinproof.errors import InputError, SceneError, UnknownNameError
from pinproof.spatial import SE3, matrix, rigid, xyz_rpy

SHAPE_WIDTH = 60
"""Largest number of characters of a shape in a table of obstacles."""


@dataclass(frozen=True, eq=False)
class Scene:
    """An immutable set of obstacles, which are not checked against each other.

    Parameters
    ----------
    obstacles
        The obstacles; their names differ.
    allowed
        Pairs of (robot link, obstacle) that may touch, such as the base and the table on which it is mounted.
        Certificates list them as excluded. ``"*"`` as the link means every link and attached object.
    disabled
        Pairs of robot links that a MoveIt allowed-collision matrix disables. Like an SRDF's pairs without a reason they
        are checked, unless the checker has ``trust_disabled``.
    frame
        Name of the frame of the poses. A checker refuses a robot if neither its root nor a link fixed at the root has
        this name. Empty: the root of any robot.
    notes
        Simplifications made when the file was read.
    source
        The file from which it was read, for messages.
    """

    obstacles: tuple[Obstacle, ...] = ()
    allowed: tuple[tuple[str, str], ...] = ()
    disabled: tuple[tuple[str, str], ...] = ()
    frame: str = ""
    notes: tuple[str, ...] = ()
    source: Path | None = None

    def __repr__(self) -> str:
        things = (f"{each.name}: {shortened(repr(each.shape), SHAPE_WIDTH)}" for each in self.obstacles)
        count = len(self.obstacles)
        source = "" if self.source is None else f", from {self.source.name}"
        return outline(f"Scene({count} obstacle{'' if count == 1 else 's'}{source})", things, total=count)

    def _repr_html_(self) -> str:
        rows = (
            [each.name, shortened(repr(each.shape), SHAPE_WIDTH), *(xyz_rpy(each.pose) + 0.0)]
            for each in self.obstacles
        )
        columns = ("obstacle", "shape", "x", "y", "z", "roll", "pitch", "yaw")
        title = f"Scene of {len(self.obstacles)} obstacles (m, rad)"
        return html_block(title, html_table(columns, rows, total=len(self.obstacles)), html_list(self.notes))

    def __init__(
        self,
        obstacles: Iterable[Obstacle] = (),
        *,
        allowed: Iterable[Sequence[str]] = (),
        disabled: Iterable[Sequence[str]] = (),
        frame: str = "",
        notes: Iterable[str] = (),
        source: str | Path | None = None,
    ) -> None:
        obstacles = tuple(obstacles)
        for each in obstacles:
            require_type("an obstacle of a scene", each, Obstacle)
        names = [obstacle.name for obstacle in obstacles]
        doubled = sorted({name for name in names if names.count(name) > 1})
        if doubled:
            raise InputError(f"obstacle names must differ; {', '.join(doubled)} appear more than once")
        pairs = _pairs("allowed", allowed)
        for _, obstacle in pairs:
            if obstacle not in names:
                raise UnknownNameError("obstacle", obstacle, names, "the allowed contacts of the scene")
        object.__setattr__(self, "obstacles", obstacles)
        object.__setattr__(self, "allowed", pairs)
        object.__setattr__(self, "disabled", _pairs("disabled", disabled))
        object.__setattr__(self, "frame", frame)
        object.__setattr__(self, "notes", tuple(notes))
        object.__setattr__(self, "source", None if source is None else Path(source))

    def __getitem__(self, name: str) -> Obstacle:
        for obstacle in self.obstacles:
            if obstacle.name == name:
                return obstacle
        raise UnknownNameError("obstacle", name, self.names, "the scene")

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the obstacles, in order."""
        return tuple(obstacle.name for obstacle in self.obstacles)

    def add(self, *obstacles: Obstacle) -> Scene:
        """Return a new scene with these obstacles added."""
        return self._with((*self.obstacles, *obstacles))

    def remove(self, *names: str) -> Scene:
        """Return a new scene without these obstacles and without their allowed contacts."""
        removed = {self[name].name for name in names}
        return self._with(o for o in self.obstacles if o.name not in removed)

    def move(self, name: str, pose: pin.SE3 | npt.ArrayLike) -> Scene:
        """Return a new scene in which the obstacle has this ``pose`` (root_from_obstacle, SE3 or (4, 4))."""
        moved = replace(self[name], pose=pose)
        return self._with(moved if o.name == name else o for o in self.obstacles)

    def transformed(self, root_from_scene: pin.SE3 | npt.ArrayLike) -> Scene:
        """Return the scene, stated in the frame of a cell, in the frame of a robot that is placed in it.

        Parameters
        ----------
        root_from_scene
            The pose of the cell in the root frame of the robot, SE3 or (4, 4).
        """
        placement = rigid("root_from_scene", root_from_scene)
        return self._with(replace(each, pose=placement * each.pose) for each in self.obstacles)

    def _with(self, obstacles: Iterable[Obstacle]) -> Scene:
        obstacles = tuple(obstacles)
        removed = set(self.names) - {obstacle.name for obstacle in obstacles}
        allowed = [pair for pair in self.allowed if not removed & set(pair)]
        more = {name: getattr(self, name) for name in ("disabled", "frame", "notes", "source")}
        return Scene(obstacles, allowed=allowed, **more)

    @property
    def where(self) -> str:
        """The scene as named in messages, with its file if it has one."""
        return "the scene" if self.source is None else f"the scene {self.source}"

    def is_close(self, other: Scene, tolerance: float = 1e-9) -> bool:
        """Whether both have the same obstacles with poses equal within ``tolerance`` (metres and matrix entries)."""
        return (
            self.names == other.names
            and (self.allowed, self.disabled, self.frame) == (other.allowed, other.disabled, other.frame)
            and all(
                a.shape == b.shape and bool((abs(matrix(a.pose) - matrix(b.pose)) <= tolerance).all())
                for a, b in zip(self.obstacles, other.obstacles, strict=True)
            )
        )

    @classmethod
    def load(cls, path: str | Path) -> Scene:
        """Read a scene file (YAML) in the format of pinproof or of MoveIt.

        The formats are described in :mod:`pinproof.collision.scenes.scene_file` and
        :mod:`pinproof.collision.scenes.moveit`.

        Raises
        ------
        SceneError
            If the file cannot be read or its content is invalid; the message names the obstacle and the key.
        """
        from pinproof.collision.scenes.moveit import is_moveit, read_moveit_scene
        from pinproof.collision.scenes.scene_file import read_scene
        from pinproof.collision.scenes.scene_keys import SCENE
        from pinproof.common.yaml_file import read_yaml

        path = Path(path)
        stated = read_yaml(path, SCENE.names, SceneError)
        content = (read_moveit_scene if is_moveit(stated) else read_scene)(path, stated)
        try:
            return cls(**content._asdict(), source=path)
        except InputError as error:
            raise SceneError(path, str(error), "key allowed_contacts or disabled_pairs") from error

    def save(self, path: str | Path) -> None:
        """Write the scene as YAML, atomically.

        Raises
        ------
        SceneError
            If the suffix is not ``.yaml`` or ``.yml``, or the file cannot be written.
        """
        from pinproof.collision.scenes.scene_file import SceneContent, write_scene

        write_scene(SceneContent(self.obstacles, self.allowed, self.disabled, self.frame), path)


def _pairs(what: str, stated: Iterable[Sequence[str]]) -> tuple[tuple[str, str], ...]:
    pairs = []
    for pair in stated:
        if isinstance(pair, str) or len(pair) != 2 or not all(isinstance(name, str) for name in pair):
            raise InputError(f"{what}: {pair!r} is not a pair of names")
        first, second = pair
        if first == second:
            raise InputError(f"{what}: {first!r} is named twice; a pair is two bodies")
        pairs.append((first, second))
    return tuple(pairs)


@dataclass(frozen=True, eq=False)
class Attachments:
    """Bodies that the arm carries at its tcp: a tool, a part, or both.

    :meth:`load` reads them from a YAML file, whose keys are in :mod:`pinproof.collision.scenes.scene_keys`;
    docs/formats/attached.md describes them with an example.

    Parameters
    ----------
    bodies
        Bodies that move with the tcp; their pose is ``tcp_from_body``.
    allowed
        Pairs of names (links, attached bodies, obstacles) that may touch. Certificates list them as excluded.
    held
        Values (rad or m) of joints outside the arm by name, such as those of the robot's own fingers.
    tip
        ``tcp_from_tip``: the point of the tool that reaches a target.
    """

    bodies: tuple[Obstacle, ...] = ()
    allowed: tuple[tuple[str, str], ...] = ()
    held: Mapping[str, float] = field(default_factory=dict)
    tip: SE3 = field(default_factory=SE3.Identity)

    def __post_init__(self) -> None:
        object.__setattr__(self, "bodies", tuple(self.bodies))
        object.__setattr__(self, "allowed", tuple((str(a), str(b)) for a, b in self.allowed))
        object.__setattr__(self, "tip", rigid("tip", self.tip))
        names = [body.name for body in self.bodies]
        if doubled := sorted({name for name in names if names.count(name) > 1}):
            raise InputError(f"names of attached bodies must differ; {', '.join(doubled)} appear more than once")

    @classmethod
    def load(cls, path: str | Path) -> Attachments:
        """Read a YAML file of this format.

        Raises
        ------
        SceneError
            If the file cannot be read or its content is invalid; the message names file, line and key.
        """
        from pinproof.collision.scenes.scene_file import read_attached

        return cls(**read_attached(Path(path)))

    def save(self, path: str | Path) -> None:
        """Write a file that :meth:`load` reads, atomically; mesh paths are as in :meth:`Scene.save`.

        Raises
        ------
        SceneError
            If the suffix is not ``.yaml`` or ``.yml``, or the file cannot be written.
        """
        from pinproof.collision.scenes.scene_file import write_attached

        write_attached(path, self.bodies, self.allowed, self.held, self.tip)
