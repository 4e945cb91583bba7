"""Scenes of obstacles, and the bodies that the arm carries (attachments)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar, cast, overload

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.geometry.shapes import Obstacle, stated_shape
from pinproof.common.files import read_yaml, write_yaml
from pinproof.common.results import ByValue, Rows, Shown, View, shortened
from pinproof.common.structs import (
    ANY_TEXT,
    TEXT,
    Accepting,
    Kind,
    errors_of,
    key,
    list_of,
    number,
    parsed,
    plain,
    simple,
    struct,
    table_of,
)
from pinproof.common.validation import require_number, require_type
from pinproof.errors import InputError, SceneError, UnknownNameError
from pinproof.spatial import SE3, finite, matrix, rigid, xyz_rpy
from pinproof.units import MOST_MARGIN, MOST_REACH, warn_of_millimetres

SHAPE_WIDTH = 60
"""Largest number of characters of a shape in a table of obstacles."""


def _pair(name: str, value: object) -> tuple[str, str]:
    names = list(value) if isinstance(value, (list, tuple)) else []
    if len(names) != 2 or not all(isinstance(each, str) for each in names):
        raise InputError(f"{name} is {value!r}, not a pair of names")
    if names[0] == names[1]:
        raise InputError(f"{name} names {names[0]!r} twice; a pair is two bodies")
    return names[0], names[1]


Default = TypeVar("Default")

PAIRS = list_of(simple(list_of(ANY_TEXT, 2, 2).schema, _pair))


def _margin(name: str, value: Any) -> float:
    margin = require_number(name, value, "m", minimum=0)
    warn_of_millimetres(name, [margin], most=MOST_MARGIN)
    return margin


MARGIN = simple(number(minimum=0).schema, _margin, parsed)
"""A smallest allowed distance of bodies (m)."""


@struct("pair_margin")
class PairMargin:
    """The margin of one pair of bodies."""

    between: tuple[str, ...] = key(
        "the two bodies: links, bodies of a tool, parts or obstacles", kind=Kind(list_of(TEXT, 2, 2).schema, _pair)
    )
    margin: float = key("smallest allowed distance between them, in place of that of all bodies", "m", kind=MARGIN)


def _once(name: str, value: Any) -> tuple[PairMargin, ...]:
    pairs = Counter(frozenset(own.between) for own in value)
    if twice := [" and ".join(sorted(pair)) for pair, count in pairs.items() if count > 1]:
        raise InputError(f"{name} state the pair {twice[0]} twice; state it once")
    return tuple(value)


_MARGINS = list_of(table_of(PairMargin))

PAIR_MARGINS = Kind(_MARGINS.schema, lambda name, value: _once(name, _MARGINS.check(name, value)), _MARGINS.parse)
"""Margins of pairs of bodies, as scenes and picks state them."""


@struct(
    "scene",
    first=("obstacles", "allowed_contacts", "margins", "disabled_pairs", "frame"),
    init=False,
    repr=False,
    eq=False,
)
class Scene(Mapping[str, Obstacle], Shown):
    """Obstacles, which are not checked against each other. Poses are in the frame of the robot's root link.

    Notes
    -----
    A scene is a read-only mapping of names to obstacles, in order: ``scene["table"]``, ``"table" in scene``,
    ``len(scene)``, ``for name in scene``, ``scene.items()``. Scenes with equal contents are equal, wherever they were
    read from; :meth:`is_close` compares poses within a tolerance.
    """

    obstacles: tuple[Obstacle, ...] = key(
        "the obstacles; write `obstacles: []` for an empty scene", kind=list_of(table_of(Obstacle), named="obstacle")
    )
    allowed: tuple[tuple[str, str], ...] = key(
        "pairs of a robot link and an obstacle that may touch, such as the base and the table on which it is mounted; "
        "certificates list them as excluded. `*` as the link means every link and attached object",
        name="allowed_contacts",
        default=(),
        kind=PAIRS,
    )
    margins: tuple[PairMargin, ...] = key(
        "margins of pairs of bodies, which replace the margin of all bodies; the names are checked with the robot, its "
        "tool and the parts that it carries",
        default=(),
        kind=PAIR_MARGINS,
    )
    disabled: tuple[tuple[str, str], ...] = key(
        "pairs of robot links that a MoveIt matrix disables; they are checked unless the caller trusts them",
        name="disabled_pairs",
        default=(),
        kind=PAIRS,
    )
    frame: str = key(
        "the root link, or a link fixed to it, that the robot must have; by default any robot is accepted",
        default="",
        kind=ANY_TEXT,
    )
    notes: tuple[str, ...] = key("simplifications made when the file was read", default=(), hidden=True, compare=False)
    source: Path | None = key("the file from which it was read, for messages", default=None, hidden=True, compare=False)

    def _view(self) -> View:
        count = len(self.obstacles)
        shapes = ((each, shortened(repr(each.shape), SHAPE_WIDTH)) for each in self.obstacles)
        rows = ([each.name, shape, *(xyz_rpy(each.pose) + 0.0)] for each, shape in shapes)
        lines = (f"{each.name}: {shortened(repr(each.shape), SHAPE_WIDTH)}" for each in self.obstacles)
        table = Rows(("obstacle", "shape", "x", "y", "z", "roll", "pitch", "yaw"), rows, count)
        source = "" if self.source is None else f", from {self.source.name}"
        head = f"{count} obstacle{'' if count == 1 else 's'}{source}"
        return View(head, [table, self.notes], lines, count, f"Scene of {count} obstacles (m, rad)")

    def __init__(
        self,
        obstacles: Iterable[Obstacle] = (),
        *,
        allowed: Iterable[Sequence[str]] = (),
        margins: Iterable[PairMargin] = (),
        disabled: Iterable[Sequence[str]] = (),
        frame: str = "",
        notes: Iterable[str] = (),
        source: str | Path | None = None,
    ) -> None:
        given: dict[str, Any] = {"obstacles": obstacles, "allowed": allowed, "margins": margins}
        given |= {"disabled": disabled, "frame": frame}
        source = None if source is None else Path(source)
        for name, value in {**given, "notes": tuple(notes), "source": source}.items():
            object.__setattr__(self, name, value)
        self.__post_init__()

    def __post_init__(self) -> None:
        for _, obstacle in self.allowed:
            if obstacle not in self:
                error = UnknownNameError("obstacle", obstacle, self, "the allowed contacts of the scene")
                error.argument = "allowed"
                raise error

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {obstacle.name: i for i, obstacle in enumerate(self.obstacles)}

    def __getitem__(self, name: str) -> Obstacle:
        if name not in self:
            raise UnknownNameError("obstacle", name, self, "the scene")
        return self.obstacles[self._numbers[name]]

    def __contains__(self, name: object) -> bool:
        return name in self._numbers

    def __iter__(self) -> Iterator[str]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)

    @overload
    def get(self, name: str, default: None = None, /) -> Obstacle | None: ...
    @overload
    def get(self, name: str, default: Obstacle | Default, /) -> Obstacle | Default: ...
    def get(self, name: str, default: object = None, /) -> object:
        """Return the obstacle of this name, or ``default``."""
        return default if name not in self._numbers else self[str(name)]

    __eq__, __hash__ = Shown.__eq__, Shown.__hash__  # not those of a mapping

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of the obstacles, in order."""
        return tuple(self)

    def add(self, *obstacles: Obstacle) -> Scene:
        """Return a new scene with these obstacles added."""
        return replace(self, obstacles=(*self.obstacles, *obstacles))

    def remove(self, *names: str) -> Scene:
        """Return a new scene without these obstacles, and without their allowed contacts and margins."""
        removed = {self[name].name for name in names}
        kept = tuple(o for o in self.obstacles if o.name not in removed)
        allowed = tuple(pair for pair in self.allowed if not removed.intersection(pair))
        margins = tuple(own for own in self.margins if removed.isdisjoint(own.between))
        return replace(self, obstacles=kept, allowed=allowed, margins=margins)

    def move(self, name: str, pose: pin.SE3 | npt.ArrayLike) -> Scene:
        """Return a new scene in which the obstacle has this ``pose`` (root_from_obstacle, SE3 or (4, 4))."""
        moved, number = replace(self[name], pose=pose), self._numbers[name]
        # All else was checked when this scene was made, and is shared.
        other = object.__new__(Scene)
        obstacles = (*self.obstacles[:number], moved, *self.obstacles[number + 1 :])
        other.__dict__.update(self.__dict__, obstacles=obstacles)
        return other

    def transformed(self, root_from_scene: pin.SE3 | npt.ArrayLike) -> Scene:
        """Return the scene, stated in the frame of a cell, in the frame of a robot that is placed in it.

        Parameters
        ----------
        root_from_scene
            The pose of the cell in the root frame of the robot, SE3 or (4, 4).
        """
        placement = rigid("root_from_scene", root_from_scene)
        return replace(self, obstacles=tuple(replace(each, pose=placement * each.pose) for each in self.obstacles))

    @property
    def where(self) -> str:
        """The scene as named in messages, with its file if it has one."""
        return "the scene" if self.source is None else f"the scene {self.source}"

    def is_close(self, other: Scene, tolerance: float = 1e-9) -> bool:
        """Whether both have the same obstacles with poses equal within ``tolerance`` (metres and matrix entries)."""
        return (
            self.names == other.names
            and (self.allowed, self.disabled, self.frame) == (other.allowed, other.disabled, other.frame)
            and self.margins == other.margins
            and all(
                a.shape == b.shape and bool((abs(matrix(a.pose) - matrix(b.pose)) <= tolerance).all())
                for a, b in zip(self.obstacles, other.obstacles, strict=True)
            )
        )

    @classmethod
    def from_geometry_model(
        cls, geometry_model: Any, data: Any = None, *, model: Any = None, q: npt.ArrayLike | None = None
    ) -> Scene:
        """Return the scene of the objects of a ``pinocchio.GeometryModel``, all of them obstacles.

        Parameters
        ----------
        geometry_model
            The objects; their names are those of the obstacles. Those with ``disableCollision`` are obstacles too.
        data
            A ``pinocchio.GeometryData`` with their placements.
        model, q
            Instead of ``data``: the model that places them, and its configuration. Without either, all objects must be
            fixed to the universe.

        Raises
        ------
        InputError
            If an object moves with a joint and its placement is not given, or given twice, or its geometry is not
            supported.
        """
        require_type("geometry_model", geometry_model, pin.GeometryModel)
        objects = geometry_model.geometryObjects
        if data is not None and not (model is None and q is None):
            raise InputError("the placements are those of data, or those of model at q; pass one of them")
        if data is not None and len(getattr(data, "oMg", ())) != len(objects):
            raise InputError(f"data must be a pinocchio.GeometryData with the placements of {len(objects)} objects")
        if model is not None and q is not None:
            require_type("model", model, pin.Model)
            at, data = finite("q", q, (model.nq,)), pin.GeometryData(geometry_model)
            pin.updateGeometryPlacements(model, model.createData(), geometry_model, data, at)
        if data is None and (moved := [thing.name for thing in objects if thing.parentJoint]):
            raise InputError(f"geometry {moved[0]!r} moves with a joint; pass data, or model and q, for its placement")
        poses = [thing.placement for thing in objects] if data is None else data.oMg
        return cls(Obstacle(thing.name, thing.geometry, pose) for thing, pose in zip(objects, poses, strict=True))

    @classmethod
    def load(cls, path: str | Path) -> Scene:
        """Read a scene file (YAML) in the format of pinproof or of MoveIt (:mod:`pinproof.collision.moveit`).

        docs/formats/scene.md describes the format. Invalid values are refused, because a scene that is read wrongly can
        cause a collision.

        Raises
        ------
        SceneError
            If the file cannot be read or its content is invalid; the message names the obstacle and the key.
        """
        from pinproof.collision.moveit import is_moveit, read_moveit_scene

        path, table = Path(path), table_of(cls)
        content = read_yaml(path, table.names, SceneError)
        with errors_of(path, SceneError):
            if is_moveit(content):
                return cls(**read_moveit_scene(path, content), source=path)
            values = table.values("the scene", content, path)
            # Obstacles that are implausibly far away are noted, such as for a missing decimal point.
            far = [(thing.name, float(np.abs(thing.pose.translation).max())) for thing in values["obstacles"]]
            notes = [
                f"obstacle {name!r} is {off:g} m away; lengths are in metres" for name, off in far if off > MOST_REACH
            ]
            return cast(Scene, table.made(content, {**values, "notes": notes, "source": path}))

    def save(self, path: str | Path) -> None:
        """Write the scene as YAML, atomically.

        Sizes and positions are restored exactly, rotations (written as quaternions) to rounding. Paths of meshes are
        relative to the folder of the file if the mesh is inside it, otherwise absolute.

        Raises
        ------
        SceneError
            If the suffix is not ``.yaml`` or ``.yml``, or the file cannot be written.
        """
        content: dict[str, Any] = {"obstacles": _stated_bodies(self.obstacles, path)}
        more: dict[str, Any] = {"frame": self.frame, "allowed_contacts": self.allowed, "disabled_pairs": self.disabled}
        more["margins"] = [{"between": own.between, "margin": own.margin} for own in self.margins]
        write_yaml(path, content | {name: plain(value) for name, value in more.items() if value}, SceneError)


def _stated_bodies(bodies: Iterable[Obstacle], path: str | Path) -> list[dict[str, Any]]:
    """Return obstacles as mappings for a file."""
    folder = Path(path).resolve().parent
    rows = []
    for body in bodies:
        kind, shape = stated_shape(body.shape, folder)
        colour = {} if body.rgba is None else {"rgba": plain(body.rgba)}
        rows.append({"name": body.name, kind: shape, **_stated_pose(body.pose), **colour})
    return rows


def _stated_pose(placement: pin.SE3) -> dict[str, Any]:
    """Return the keys and values of a pose for a file."""
    position = {"xyz": placement.translation.tolist()}
    if np.array_equal(placement.rotation, np.eye(3)):
        return position
    return {**position, "quat_xyzw": pin.Quaternion(placement.rotation).coeffs().tolist()}


@struct("attached", eq=False)
class Attachments(ByValue):
    """Bodies that the arm carries at its tcp: a tool, a part, or both, for the option `--attached`."""

    bodies: Accepting[tuple[Obstacle, ...], Iterable[Obstacle]] = key(
        "bodies that move with the tcp; poses are tcp_from_body",
        name="attached",
        default=(),
        kind=list_of(table_of(Obstacle), named="attached body"),
        required=True,
    )
    allowed: tuple[tuple[str, str], ...] = key(
        "pairs of bodies (links, attached bodies, obstacles) that may touch; certificates list them as excluded",
        name="allowed_contacts",
        default=(),
        kind=PAIRS,
    )
    held: Mapping[str, float] = key(
        "values of joints outside the arm by name, such as those of the robot's own fingers",
        "rad or m",
        default_factory=dict,
    )
    tip: SE3 = key("tcp_from_tip: the point of the tool that reaches a target", default_factory=SE3.Identity)

    @classmethod
    def load(cls, path: str | Path) -> Attachments:
        """Read a YAML file of this format, which docs/formats/attached.md describes.

        Raises
        ------
        SceneError
            If the file cannot be read or its content is invalid; the message names file, line and key.
        """
        path, table = Path(path), table_of(cls)
        content = read_yaml(path, table.names, SceneError)
        with errors_of(path, SceneError):
            return cast(Attachments, table.read("the file", content, path))

    def with_more(self, more: Attachments, names: tuple[str, str] = ("the first", "the second")) -> Attachments:
        """Both together; ``names`` are those of their files, for messages.

        Raises
        ------
        InputError
            If both name the same body, hold a joint at different values, or state a tip.
        """
        first, second = names
        if both := {body.name for body in self.bodies} & {body.name for body in more.bodies}:
            raise InputError(f"{first} and {second} both name a body {sorted(both)[0]!r}; rename one of them")
        for name, value in more.held.items():
            if (own := self.held.get(name, value)) != value:
                raise InputError(f"{first} holds joint {name} at {own:g}, {second} at {value:g}; state it once")
        if not (more.tip.isIdentity() or self.tip.isIdentity()):
            raise InputError(f"{first} and {second} both state a tip; remove one of them")
        tip = self.tip if more.tip.isIdentity() else more.tip
        bodies, allowed = (*self.bodies, *more.bodies), (*self.allowed, *more.allowed)
        return Attachments(bodies, allowed, {**self.held, **more.held}, tip)

    def save(self, path: str | Path) -> None:
        """Write a file that :meth:`load` reads, atomically; mesh paths are as in :meth:`Scene.save`.

        Raises
        ------
        SceneError
            If the suffix is not ``.yaml`` or ``.yml``, or the file cannot be written.
        """
        content: dict[str, Any] = {"attached": _stated_bodies(self.bodies, path)}
        tip = {} if self.tip.isIdentity() else _stated_pose(self.tip)
        more = {"allowed_contacts": self.allowed, "held": self.held, "tip": tip}
        write_yaml(path, content | {name: plain(value) for name, value in more.items() if value}, SceneError)
