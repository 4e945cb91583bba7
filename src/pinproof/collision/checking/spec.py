"""What a collision checker checks, as a value: the arm, its surroundings, margins and geometry, and their hash.

Mesh files are hashed by their present content, which is examined again for each hash; a search that needs many hashes
examines each file once in the context of :func:`files_examined_once`.
"""

from __future__ import annotations

import hashlib
import math
import os
from abc import ABCMeta, abstractmethod
from collections.abc import Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from copy import copy
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from pinproof._core import describe_boxes
from pinproof.collision.checking.links import LinkMeshes
from pinproof.collision.geometry.bodies import FileStamp, box_of
from pinproof.collision.geometry.shapes import BODY, Mesh, Obstacle
from pinproof.collision.scene import Scene
from pinproof.common.validation import require_type
from pinproof.errors import InputError
from pinproof.model import JointGroup
from pinproof.spatial import matrix

Pair = frozenset[str]
"""Two owners of bodies: links, attached objects, obstacles."""

Levels = Mapping[Pair, int]
"""The levels of detail of pairs of owners (:mod:`pinproof.collision.checking.links`), where not 0."""

FILES_KEPT = 1024
"""Number of cached hashes of mesh files; an entry is valid while time and size of the file are unchanged."""

ARMS_KEPT = 64
"""Number of cached arms and of their hashes: a task has one for each position of the fingers."""


Own = TypeVar("Own", bound="Changeable")


class HasIdentity(Protocol):
    """An object that moves obstacles: a :class:`pinproof.Mover`."""

    def identity(self) -> str:
        """Return a text that differs for movers that move differently."""


class Changeable(metaclass=ABCMeta):
    """What a :class:`CheckerSpec` and a :class:`pinproof.CollisionChecker` have in common: changed copies of both."""

    @property
    @abstractmethod
    def spec(self) -> CheckerSpec:
        """The specification of a checker, or a specification itself."""

    @abstractmethod
    def _changed(self: Own, key: Hashable = None, **changes: object) -> Own:
        """Return a copy with other values, which are valid; all others are the same objects. With a key, it is kept."""

    def with_margin(
        self: Own, margin: float | None = None, margins: Mapping[tuple[str, str], float] | None = None
    ) -> Own:
        """Return the same bodies and pairs with other margins (m); None keeps the present ones.

        ``margins`` replaces those of single pairs, except those that the scene alone states.
        """
        spec = self.spec
        common = spec.margin if margin is None else checked_margin("margin", margin)
        if margins is None:
            return self._changed(("margin", common), margin=common)
        return self._changed(margin=common, margins={**margins_of(spec.scene), **_checked_pairs(margins)})

    def padded(self: Own, by: float) -> Own:
        """Return the same with all margins increased by ``by`` metres, those of single pairs included."""
        by, spec = checked_margin("by", by), self.spec
        margins = {pair: own + by for pair, own in spec.margins.items()}
        return self._changed(("padded", by), margin=spec.margin + by, margins=margins)

    def with_obstacle_tolerance(self: Own, by: float) -> Own:
        """Return the same for obstacles that may be displaced by ``by`` metres more, by larger margins."""
        return self._changed(obstacle_tolerance=self.spec.obstacle_tolerance + checked_margin("by", by))

    def with_scene(self: Own, scene: Scene) -> Own:
        """Return the same arm and attached objects in another scene.

        Allowed contacts of obstacles that it does not have are dropped. Margins of pairs are kept for bodies that
        return, such as a part that is put down; those of the scene replace those of the present one.
        """
        require_type("scene", scene, Scene)
        return self._surrounded(scene, self.spec.attached)

    def with_attached(self: Own, *objects: Obstacle) -> Own:
        """Return the same with more objects that move with the tcp; an object replaces an attached one of its name.

        When an object is grasped, also remove its obstacle from the scene.
        """
        new, spec = {thing.name for thing in objects}, self.spec
        return self._surrounded(spec.scene, (*(thing for thing in spec.attached if thing.name not in new), *objects))

    def _surrounded(self: Own, scene: Scene, attached: tuple[Obstacle, ...]) -> Own:
        spec, allowed, margins = self.spec, self.spec.allowed, self.spec.margins
        if allowed:
            before = {*spec.scene.names, *(thing.name for thing in spec.attached)}
            gone = before.difference(scene.names, (thing.name for thing in attached))
            allowed = tuple(pair for pair in allowed if not gone & set(pair))
        if stated := {pair: own for pair, own in margins_of(scene).items() if own != margins_of(spec.scene).get(pair)}:
            margins = {**margins, **stated}
        return self._changed(scene=scene, attached=attached, allowed=allowed, margins=margins)

    def with_held(self: Own, held: Mapping[str, float]) -> Own:
        """Return the same with other values (rad or m) of joints outside the arm, such as the robot's fingers."""
        try:
            arm = _holding(self.spec.arm, tuple(held.items()))
        except (AttributeError, TypeError):  # not a mapping, or of numbers without a hash
            arm = self.spec.arm.with_held(held)
        return self if arm is self.spec.arm else self._changed(arm=arm)

    def allowing(self: Own, *pairs: Sequence[str]) -> Own:
        """Return the same with more pairs of names that may touch: a gripper and its object, a part and its support.

        Certificates list these pairs as excluded, so allow a contact only for the stage that needs it. For a part that
        is lifted off its support, ``certify(..., parting=)`` is stricter: it proves that the two separate.
        """
        return self._changed(allowed=(*self.spec.allowed, *((str(a), str(b)) for a, b in pairs)))


@dataclass(frozen=True, eq=False)
class CheckerSpec(Changeable):
    """What a :class:`pinproof.CollisionChecker` checks, as a value; ``CollisionChecker.of(spec)`` builds the checker.

    The parameters are those of the checker, which has the same methods; the checkers that these return share with it
    what the change leaves as it is. ``obstacle_tolerance`` (m) increases the margins of pairs with an obstacle,
    which may then be displaced by as much. ``finer`` adds levels of detail of pairs of owners to those that the checker
    chooses. ``margins`` has those of the scene too, unless they are stated for the same pair; those of bodies that do
    not exist have no effect, because a task attaches bodies and removes them. InputError if a margin is negative or not
    finite, or is for a pair that is not two names.
    """

    arm: JointGroup
    scene: Scene = field(default_factory=Scene)
    margin: float = 0.0
    margins: Mapping[Any, float] = field(default_factory=dict)
    link_meshes: LinkMeshes | Mapping[str, LinkMeshes] = "hull"
    attached: tuple[Obstacle, ...] = ()
    allowed: tuple[tuple[str, str], ...] = ()
    trust_disabled: bool = False
    housing: float | None = None
    obstacle_tolerance: float = 0.0
    finer: Levels = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_type("arm", self.arm, JointGroup)
        require_type("scene", self.scene, Scene)
        checked = {
            "margin": checked_margin("margin", self.margin),
            "margins": {**margins_of(self.scene), **_checked_pairs(self.margins)},
            "attached": tuple(self.attached),
            "allowed": tuple((str(a), str(b)) for a, b in self.allowed),
            "housing": None if self.housing is None else checked_margin("housing", self.housing),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def spec(self) -> CheckerSpec:
        """The specification itself."""
        return self

    def _changed(self, key: Hashable = None, **changes: object) -> CheckerSpec:  # noqa: ARG002  # no copy is kept
        other = copy(self)
        other.__dict__.update(changes)
        return other

    def setup_hash(self, movers: Sequence[HasIdentity] = ()) -> str:
        """Return a hash of the arm (kinematics, held joints, collision geometry), attached objects, scene, and movers.

        The pairs that the SRDF and the scene allow or disable are included; margins and the representation of meshes
        are not. Meshes are hashed by name and by the present content of their files.
        """
        robot = self.arm.robot
        meshes = [None if geometry.mesh is None else geometry.mesh.path for geometry in robot.urdf.collisions]
        digest = _hash_of(self.arm, tuple(map(content_hash, meshes))).copy()
        digest.update(repr((self.scene.allowed, self.scene.disabled, robot.srdf.disabled)).encode())
        # Meshes of obstacles and attached objects count by content, wherever their files are.
        things = (*self.attached, None, *self.scene.obstacles)  # None separates the attached objects from the scene
        for are_boxes, group in groupby(things, lambda thing: hasattr(thing, BODY)):
            if are_boxes:  # they are described as all others, many at once
                boxes: list[Any] = list(group)
                cores = [box.core_obstacle for box in map(box_of, boxes) if box is not None]
                digest.update(describe_boxes([repr(box.name) for box in boxes], cores))
                continue
            for obstacle in group:
                if obstacle is None:
                    digest.update(b"scene")
                    continue
                description = repr((obstacle.name, obstacle.shape, obstacle.arm)).encode()
                digest.update(description + matrix(obstacle.pose).tobytes())
                if isinstance(obstacle.shape, Mesh):
                    digest.update(content_hash(obstacle.shape.path).encode())
        for mover in movers:
            digest.update(mover.identity().encode())
        return digest.hexdigest()


@lru_cache(maxsize=ARMS_KEPT)
def _holding(arm: JointGroup, held: tuple[tuple[str, float], ...]) -> JointGroup:
    return arm.with_held(dict(held))


def checked_margin(name: str, margin: float) -> float:
    """Return a margin as a number; InputError if it is negative, not finite, or not a number."""
    try:
        value = float(margin)
    except (TypeError, ValueError, OverflowError):
        value = math.nan
    if not math.isfinite(value) or value < 0:
        raise InputError(f"{name} = {margin}; it must be a distance in metres, 0 or more")
    return value


def margins_of(scene: Scene) -> dict[Pair, float]:
    """Return the margins of pairs that a scene states."""
    return {frozenset(own.between): own.margin for own in scene.margins}


def _checked_pairs(margins: Mapping[Any, float]) -> Mapping[Pair, float]:
    """Return margins of single pairs; a key is two names in either order."""
    pairs = {}
    for pair, margin in margins.items():
        names = frozenset(pair) if isinstance(pair, (tuple, frozenset)) else frozenset()
        if len(names) != 2 or len(pair) != 2:
            raise InputError(f"margins has the key {pair!r}; it must be two names")
        pairs[names] = checked_margin(f"margins[{pair!r}]", margin)
    return pairs


# Hashes of files and arms.


class Examined(NamedTuple):
    """What was examined in the context of :func:`files_examined_once`: files, and checkers with the hash and notes."""

    stamps: dict[str, FileStamp | None]
    setups: dict[object, tuple[str, tuple[str, ...]]]


EXAMINED: ContextVar[Examined | None] = ContextVar("examined", default=None)


@contextmanager
def files_examined_once() -> Iterator[None]:
    """In this context, each mesh file is examined at most once, for a search that makes many certificates.

    A certificate states the files at the moment of their first examination in the context; of the outer one, if it is
    nested.
    """
    token = EXAMINED.set(EXAMINED.get() or Examined({}, {}))
    try:
        yield
    finally:
        EXAMINED.reset(token)


def present_stamp(path: str | Path) -> FileStamp | None:
    """Return the present stamp of a file; None if there is no file."""
    examined = EXAMINED.get()
    if examined is None:
        return FileStamp.of(path)
    path = os.fspath(path)
    if path not in examined.stamps:
        examined.stamps[path] = FileStamp.of(path)
    return examined.stamps[path]


def content_hash(path: str | Path | None) -> str:
    """Return a hash of the present content of a file; empty if there is no file."""
    stamp = None if path is None else present_stamp(path)
    return "" if stamp is None else _hash_of_file(stamp)


@lru_cache(maxsize=FILES_KEPT)
def _hash_of_file(stamp: FileStamp) -> str:
    return hashlib.sha256(Path(stamp.path).read_bytes()).hexdigest()


@lru_cache(maxsize=ARMS_KEPT)
def _hash_of(arm: JointGroup, meshes: tuple[str, ...]) -> Any:
    digest = hashlib.sha256(repr((arm.robot.urdf.kinematics, dict(arm.ends), arm.joint_names, dict(arm.held))).encode())
    for geometry, content in zip(arm.robot.urdf.collisions, meshes, strict=True):
        mesh = None if geometry.mesh is None else geometry.mesh.uri
        digest.update(repr((geometry.name, geometry.link, geometry.kind, geometry.size, mesh, content)).encode())
        digest.update(np.ascontiguousarray(geometry.origin).tobytes())
    return digest
