"""The bodies of robot links, with meshes represented as the caller requests, and how often links touch.

Sampling is needed because a pair that an SRDF disables is no evidence: ``Default`` means that the two touched in one
configuration, ``Adjacent`` and ``User`` that the author disabled them. Only a pair that touches in every configuration
carries no information, such as links that share a housing. If the hulls of two links overlap much more often than their
triangles, the pair is checked with several hulls each, or with the triangles, instead.
"""

from __future__ import annotations

import threading
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import combinations
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args
from weakref import WeakKeyDictionary

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.geometry import convex_pieces, hulls
from pinproof.collision.geometry.bodies import MESHES_KEPT, Body, FileStamp, hull_body, one_inside_other, shape_body
from pinproof.collision.geometry.convex_pieces import clusters
from pinproof.collision.geometry.hulls import Solid
from pinproof.collision.geometry.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from pinproof.common.content_hash import cached, content_digest
from pinproof.common.files import write_text_whole
from pinproof.common.results import Rows, Shown, View
from pinproof.common.structs import described, key
from pinproof.common.validation import require_integer
from pinproof.description import DisabledPair, LinkGeometry, read_mesh, resolved, srdf_text
from pinproof.errors import InputError, MeshError, UnknownNameError
from pinproof.model import Robot

LinkMeshes = Literal["hull", "mesh", "surface", "decomposed"]
"""Representation of a link's mesh: its convex hull, its triangles if watertight, its triangles in any case, or several
convex hulls that cover it."""

AS_REQUESTED, DECOMPOSED, EXACT, SURFACES = 0, 1, 2, 3
"""Levels of detail: the representation that the caller requests, several hulls, the triangles of watertight meshes, the
triangles of all meshes. A body inside a mesh that is not watertight is not detected, so only pairs whose hulls would
tell nothing are checked by surfaces."""

GEOMETRY_NAMES = {DECOMPOSED: "several hulls", EXACT: "exact meshes", SURFACES: "surfaces of meshes"}
"""The geometry of each level of detail, for messages."""

FINER: dict[int, LinkMeshes] = {DECOMPOSED: "decomposed", EXACT: "mesh", SURFACES: "surface"}
"""The representation of each finer level."""

COARSER: dict[int, tuple[LinkMeshes, ...]] = {
    DECOMPOSED: ("hull",),
    EXACT: ("hull", "decomposed"),
    SURFACES: ("hull", "decomposed", "mesh"),
}
"""The requested representations that are coarser than each level."""

KINDS: dict[str, type[Box] | type[Sphere] | type[Cylinder] | type[Capsule]] = {
    "box": Box,
    "sphere": Sphere,
    "cylinder": Cylinder,
    "capsule": Capsule,
}
"""The shapes of the kinds of collision geometry that a URDF has besides meshes."""

DEFAULT = "*"
"""The key of a mapping for every link without an own key."""


def meshes_of(links: Iterable[str], link_meshes: LinkMeshes | Mapping[str, LinkMeshes]) -> dict[str, LinkMeshes]:
    """Return the mesh representation of each link, from one value for all or a mapping; ``"*"`` is all other links."""
    links = tuple(links)
    stated: Mapping[str, LinkMeshes] = {DEFAULT: link_meshes} if isinstance(link_meshes, str) else link_meshes
    if not isinstance(stated, Mapping):
        raise InputError(f"link_meshes = {link_meshes!r} must be a representation or a mapping of links to them")
    for link, how in stated.items():
        if how not in get_args(LinkMeshes):
            raise UnknownNameError("kind of link meshes", how, get_args(LinkMeshes))
        if link != DEFAULT and link not in links:
            raise UnknownNameError("link", link, links, "link_meshes")
    return {link: stated.get(link, stated.get(DEFAULT, "hull")) for link in links}


def link_bodies(geometry: LinkGeometry, how: LinkMeshes) -> list[Body]:
    """Return the bodies of one collision geometry of a link: several if its mesh is ``decomposed``, else one.

    A mesh that is not watertight has no inside. Its hull is used, or its ``surface`` if requested, and the remark of
    the body states it. MeshError if the mesh is missing or cannot be represented as requested.
    """
    name, link, at = geometry.name, geometry.link, pin.SE3(np.array(geometry.origin))

    def body_of(shape: Shape) -> Body:
        return shape_body(name, link, link, shape, at)

    # A primitive shape, or the hull of a mesh.
    if geometry.kind != "mesh":
        return [body_of(KINDS[geometry.kind](*geometry.size))]
    if geometry.mesh is None:
        raise MeshError(name, f"the mesh of link {link!r} has no file")
    path = resolved(geometry.mesh, link)
    shape = Mesh(path, geometry.size, hull=True)  # type: ignore[arg-type]  # three
    if how == "hull":
        return [body_of(shape)]
    # The triangles are read only if they are needed.
    file = FileStamp.of(path)
    mesh_file = path.absolute(), file, shape.scale
    watertight = _is_watertight(*mesh_file)
    if how == "surface":
        return [body_of(replace(shape, hull=False, hollow=not watertight))]
    if not watertight:
        return [replace(body_of(shape), remark=f"{path.name} is not watertight, so its convex hull is used")]
    if how == "mesh":
        return [body_of(replace(shape, hull=False))]
    return [
        replace(part, name=f"{name}_part_{i}", owner=link, link=link, link_from_body=at, file=file)
        for i, part in enumerate(_parts(*mesh_file))
    ]


SOLID_CODE = (hulls.__file__,)
"""The modules that decide whether a mesh is watertight, for entries of the cache on disk."""

GEOMETRIES_KEPT = 512
"""Number of collision geometries of links whose hulls and primitive shapes are kept."""


@lru_cache(maxsize=GEOMETRIES_KEPT)
def _bodies_of_file(geometry: LinkGeometry, how: LinkMeshes, _stamp: FileStamp | None) -> tuple[Body, ...]:
    return tuple(replace(body, source=geometry.name) for body in link_bodies(geometry, how))


def _kept_bodies(geometry: LinkGeometry, how: LinkMeshes) -> Sequence[Body]:
    """Return :func:`link_bodies` with their source; checkers of one robot share all bodies that are convex."""
    stamp = None if geometry.mesh is None else FileStamp.of(resolved(geometry.mesh, geometry.link))
    exact = geometry.kind == "mesh" and how in ("mesh", "surface")
    return (_bodies_of_file.__wrapped__ if exact else _bodies_of_file)(geometry, how, stamp)


class LinkBodies:
    """The bodies of a robot's links, with meshes as requested for each link and, for some pairs, in finer ones."""

    def __init__(self, geometries: Sequence[LinkGeometry], meshes: Mapping[str, LinkMeshes]) -> None:
        self._geometries, self._meshes = tuple(geometries), dict(meshes)
        self._finer: dict[tuple[str, int], tuple[Body, ...]] = {}
        self._requested = tuple(
            body for geometry in self._geometries for body in _kept_bodies(geometry, self._meshes[geometry.link])
        )

    def of(self, levels: Mapping[frozenset[str], int]) -> tuple[Body, ...]:
        """Return all bodies for these levels of pairs of owners, those of the requested representation first."""
        wanted = {(owner, level) for pair, level in levels.items() for owner in pair}
        return self._requested + tuple(
            body
            for geometry in self._geometries
            for level in FINER
            if (geometry.link, level) in wanted
            for body in self._more_finely(geometry, level)
        )

    def on_level(self, link: str, level: int) -> tuple[Body, ...]:
        """Return the bodies of a link on a level; the requested ones where there are no finer ones."""
        bodies: list[Body] = []
        for geometry in self._geometries:
            if geometry.link == link:
                requested = [body for body in self._requested if body.source == geometry.name]
                bodies += (level and self._more_finely(geometry, level)) or requested
        return tuple(bodies)

    @property
    def meshes(self) -> Mapping[str, LinkMeshes]:
        """The representation of the meshes of each link."""
        return self._meshes

    def can_be_finer(self, owner: str, level: int = EXACT) -> bool:
        """Whether it is a link with a mesh whose requested representation is coarser than that of a level."""
        return any(
            geometry.link == owner and geometry.kind == "mesh" and self._meshes[owner] in COARSER[level]
            for geometry in self._geometries
        )

    def _more_finely(self, geometry: LinkGeometry, level: int) -> tuple[Body, ...]:
        """Return the bodies of a geometry on a level; none if the requested representation is as fine."""
        key = geometry.name, level
        if key not in self._finer:
            requested, finer = self._meshes[geometry.link], list[Body]()
            if geometry.kind == "mesh" and requested in COARSER[level]:
                bodies = _kept_bodies(geometry, FINER[level])
                if level == DECOMPOSED:  # a single hull fits closely, or the mesh is not watertight
                    finer = [replace(body, level=level) for body in bodies] if len(bodies) > 1 else []
                elif bodies[0].support is None and not (requested == "mesh" and not bodies[0].is_hollow):
                    # watertight, and not represented by its triangles already
                    name = f"{geometry.name}_{'exact' if level == EXACT else 'surface'}"
                    finer = [replace(body, name=name, level=level) for body in bodies]
            self._finer[key] = tuple(finer)
        return self._finer[key]

    def __repr__(self) -> str:
        return f"LinkBodies({sorted(self._meshes.items())!r})"


Scale = float | tuple[float, float, float]


@lru_cache(maxsize=MESHES_KEPT)
def _solid(path: Path, _file: FileStamp | None, scale: Scale) -> Solid:
    mesh = read_mesh(path, scale)  # type: ignore[arg-type]  # made three numbers by Mesh
    return Solid(mesh.vertices, mesh.triangles)


@lru_cache(maxsize=MESHES_KEPT)
def _is_watertight(path: Path, file: FileStamp | None, scale: Scale) -> bool:
    mesh = read_mesh(path, scale)  # type: ignore[arg-type]  # made three numbers by Mesh

    def make() -> dict[str, npt.NDArray[Any]]:
        return {"watertight": np.array(_solid(path, file, scale).watertight)}

    key = content_digest(mesh.vertices, mesh.triangles)
    return bool(cached("watertight", key, make, code=SOLID_CODE, libraries=["scipy"])["watertight"])


@lru_cache(maxsize=MESHES_KEPT)
def _parts(path: Path, file: FileStamp | None, scale: Scale) -> tuple[Body, ...]:
    """Return convex hulls that cover a watertight mesh, without a link; this takes 0.05 s to some seconds."""
    mesh = read_mesh(path, scale)  # type: ignore[arg-type]  # made three numbers by Mesh

    def make() -> dict[str, npt.NDArray[Any]]:
        solid = _solid(path, file, scale)
        return {f"{number:04d}": part for number, part in enumerate(clusters(solid.corners, solid.contains))}

    code = [convex_pieces.__file__, *SOLID_CODE]
    found = cached("hulls", content_digest(mesh.vertices, mesh.triangles), make, code=code, libraries=["scipy", "coal"])
    return tuple(hull_body("", "", found[name], pin.SE3.Identity()) for name in sorted(found))


Booleans = npt.NDArray[np.bool_]
Frequency = Literal["always", "nearly always", "sometimes", "never"]

ADJACENT, ALWAYS = "Adjacent", "Always"
"""The reasons of MoveIt's Setup Assistant with which pairs are excluded; a checker confirms ``Always`` by samples."""

MIN_SAMPLES = 50
"""Smallest number of configurations: links that touch in all of them touch in 94 % of all, with 95 % confidence."""

NEARLY_ALL = 0.95
"""A pair that touches in this share of the samples does so nearly always, in words: the share above which MoveIt's
Setup Assistant regards a pair as always in collision (``min_collision_fraction``)."""

COARSE = 0.05
"""Bodies represent a pair well enough if the share of samples in which they touch, and the exact meshes do not, is no
larger than this, and no larger than half of the share in which the exact meshes are apart."""

SAMPLES = 200
"""Number of sampled configurations for a choice of geometry: shares have a standard deviation of at most 0.035."""

CONFIRMATIONS = 2000
"""Number of configurations in which links must touch to be excluded: they then touch in 99.85 % of all configurations,
with 95 % confidence."""

SEED = 0
"""Seed of the samples, so that every checker of a robot excludes the same pairs."""


class Overlap(NamedTuple):
    """How often two links, or objects attached to them, touch."""

    touching: int  # number of samples in which they touch, with bodies of the level
    samples: int  # more where they touch in all of the first ones
    level: int = AS_REQUESTED  # the level of detail that the pair needs

    @property
    def always(self) -> bool:
        """Whether they touch in every sample, so that contact does not distinguish configurations."""
        return self.touching == self.samples

    def __str__(self) -> str:
        share = f"all {self.samples:,}" if self.always else f"{self.touching:,} of {self.samples:,}"
        return f"in contact in {share} sampled configurations"


class Overlaps:
    """Counts how often pairs of links touch, in ``samples`` configurations, or ``confirmations`` if in all of these."""

    def __init__(
        self, robot: Robot, links: LinkBodies, samples: int = SAMPLES, confirmations: int = CONFIRMATIONS
    ) -> None:
        self._robot, self._links, self._count, self._most = robot, links, samples, confirmations
        self._verdicts: dict[frozenset[str], Overlap] = {}  # included in a pickle

    def of(self, a: str, b: str) -> Overlap:
        """Return how often two links touch, on the level of detail on which the pair is to be checked."""
        pair = frozenset((a, b))
        if pair not in self._verdicts:
            known = self._samples.overlaps
            key = pair, self._count, self._most, *sorted((link, self._links.meshes[link]) for link in pair)
            if key not in known:
                known[key] = self._measured(a, b)
            self._verdicts[pair] = known[key]
        return self._verdicts[pair]

    def of_bodies(self, a: Sequence[Body], b: Sequence[Body]) -> Overlap:
        """Return how often any of these bodies touch, up to the first sample in which they do not; not cached.

        Each body moves with a link.
        """
        samples = max(self._count, self._most)
        for i in range(samples):
            if not self._touch_at(i, a, b):
                return Overlap(i, i + 1)
        return Overlap(samples, samples)

    @property
    def settings(self) -> Hashable:
        """What the verdicts for a robot depend on: the numbers of samples, and the representation of its meshes."""
        return self._count, self._most, tuple(self._links.meshes.items())

    def always_touch(self, a: str, b: str) -> bool:
        """Whether two links touch in every sample as requested; most pairs are decided by the first sample."""
        one, other = self._on(AS_REQUESTED, a, b)
        return all(self._touch_at(i, one, other) for i in range(self._count))

    def _measured(self, a: str, b: str) -> Overlap:
        # The requested bodies are sufficient if they rarely touch, or if no finer ones exist.
        requested = self._on(AS_REQUESTED, a, b)
        coarse = self._touching(*requested)
        if coarse.mean() <= COARSE or not any(self._links.can_be_finer(link, SURFACES) for link in (a, b)):
            return self._confirmed(*requested, coarse, AS_REQUESTED)
        # Hulls contain the triangles, so only samples in which the hulls touch are in question. A mesh that is not
        # watertight keeps its hull, which has an inside, unless the hull touches in every sample and shows nothing.
        level, finest = EXACT, self._on(EXACT, a, b)
        true = self._touching(*finest, where=coarse)
        if true.all() and any(body.is_hollow for link in (a, b) for body in self._links.on_level(link, SURFACES)):
            level, finest = SURFACES, self._on(SURFACES, a, b)
            true = self._touching(*finest)
        measured = self._confirmed(*finest, true, level)
        if measured.always:
            return measured
        # The coarsest bodies that represent the pair well enough are checked fastest, and their proofs can be saved.
        apart = 1 - measured.touching / measured.samples
        for coarser in (AS_REQUESTED, DECOMPOSED):
            bodies = self._on(coarser, a, b)
            touching = coarse if coarser == AS_REQUESTED else self._touching(*bodies, where=coarse)
            if touching.mean() - true.mean() <= min(COARSE, apart / 2) and not touching.all():
                return Overlap(int(touching.sum()), self._count, coarser)
        return measured

    def _confirmed(self, a: Sequence[Body], b: Sequence[Body], touching: Booleans, level: int) -> Overlap:
        """Return the overlap of bodies that touch in these samples, from more samples if they touch in all."""
        if not touching.all():
            return Overlap(int(touching.sum()), self._count, level)
        more = sum(self._touch_at(i, a, b) for i in range(self._count, self._most))
        return Overlap(self._count + more, max(self._count, self._most), level)

    def _on(self, level: int, a: str, b: str) -> tuple[Sequence[Body], Sequence[Body]]:
        return self._links.on_level(a, level), self._links.on_level(b, level)

    def _touching(self, a: Sequence[Body], b: Sequence[Body], *, where: Booleans | None = None) -> Booleans:
        """Return (samples,) whether any bodies touch, only at the samples ``where``."""
        touching = np.zeros(self._count, dtype=bool)
        for i in range(self._count) if where is None else np.flatnonzero(where).tolist():
            touching[i] = self._touch_at(i, a, b)
        return touching

    def _touch_at(self, i: int, a: Sequence[Body], b: Sequence[Body]) -> bool:
        """Whether any bodies touch in sample ``i``."""
        placed = [[(body, self._samples.placement(i, body)) for body in bodies] for bodies in (a, b)]
        return any(_touch(*one, *other) for one in placed[0] for other in placed[1])

    @cached_property
    def _samples(self) -> _Samples:
        """The samples, which all checkers of the robot share."""
        if self._robot not in _SAMPLES:
            _SAMPLES[self._robot] = _Samples(self._robot)
        return _SAMPLES[self._robot]

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_samples"}

    def __repr__(self) -> str:
        return f"Overlaps({self._robot.name!r})"


class _Samples:
    """Random configurations of all joints of a robot, and the cached overlaps of its links."""

    def __init__(self, robot: Robot) -> None:
        self._model, joints = robot.model, robot.urdf.joints
        # Joints that lead others and follow none have a random value within their limits; others follow them (mimic)
        kinds = {"revolute": np.pi, "continuous": np.pi, "prismatic": 1.0}
        leading = {name: kinds[own.type] for name, own in joints.items() if own.mimic is None and own.type in kinds}
        following = {
            name: own.mimic for name, own in joints.items() if own.mimic is not None and own.mimic.leader in leading
        }
        at = {
            name: self._model.joints[self._model.getJointId(robot.urdf.model_joint(name))].idx_q
            for name in (*leading, *following)
        }
        self._leading, ranges = [at[name] for name in leading], list[tuple[float, float]]()
        for name, wide in leading.items():
            low, high = joints[name].lower, joints[name].upper
            endless = joints[name].type == "continuous"
            ranges.append((-wide if low is None or endless else low, wide if high is None or endless else high))
        self._lower, self._upper = np.array(ranges).reshape(-1, 2).T
        self._following = [(at[name], at[own.leader], own.multiplier, own.offset) for name, own in following.items()]
        self.overlaps: dict[Any, Overlap] = {}
        self._data = self._model.createData()
        self._placements: dict[tuple[int, str | None], pin.SE3] = {}
        self._rng = np.random.default_rng(SEED)
        self._configurations: list[npt.NDArray[np.float64]] = []  # extended as far as they are used
        self._placed_at = -1
        self._lock = threading.Lock()  # all threads share the workspace

    def configuration(self, i: int) -> npt.NDArray[np.float64]:
        """The random configuration of a sample; floating joints are neutral."""
        while len(self._configurations) <= i:
            q = pin.neutral(self._model)
            q[self._leading] = self._rng.uniform(self._lower, self._upper)
            for index, leader, multiplier, offset in self._following:
                q[index] = multiplier * q[leader] + offset
            self._configurations.append(q)
        return self._configurations[i]

    def placement(self, i: int, body: Body) -> pin.SE3:
        """``root_from_body`` of a body that moves with a link at sample ``i``."""
        key = i, body.link
        if key not in self._placements:
            with self._lock:
                if self._placed_at != i:
                    pin.forwardKinematics(self._model, self._data, self.configuration(i))
                    self._placed_at = i
                frame = self._model.getFrameId(body.link, pin.FrameType.BODY)
                self._placements[key] = pin.updateFramePlacement(self._model, self._data, frame).copy()
        return self._placements[key] * body.link_from_body


_SAMPLES: WeakKeyDictionary[Robot, _Samples] = WeakKeyDictionary()


def _touch(a: Body, root_from_a: pin.SE3, b: Body, root_from_b: pin.SE3) -> bool:
    """Whether two bodies touch, or one is inside the watertight mesh of the other."""
    # Bodies whose bounding balls are apart do not touch.
    (one, one_radius), (other, other_radius) = a.ball, b.ball
    apart = root_from_a.act(one) - root_from_b.act(other)
    if apart.dot(apart) > (one_radius + other_radius + 1e-6) ** 2:
        return False
    there = [coal.Transform3s(at.rotation, at.translation) for at in (root_from_a, root_from_b)]
    if coal.collide(a.geometry, there[0], b.geometry, there[1], coal.CollisionRequest(), coal.CollisionResult()):
        return True
    return one_inside_other(a, root_from_a, b, root_from_b)


@described()
class LinkOverlap:
    """How often two links touch."""

    links: tuple[str, str] = key("the two links")
    touching: int = key("in how many of the sampled configurations they touch")
    samples: int = key("number of sampled configurations")
    adjacent: bool = key("whether one joint connects them")
    geometry: str = key(
        "the geometry that was tested, with which a checker checks the pair: that of the collision model (meshes as "
        "hulls), or ``several hulls``, ``exact meshes`` or ``surfaces of meshes`` (of which at least one is not "
        "watertight) where the hulls touch much more often than the triangles"
    )
    disabled: str = key(
        "the reason with which the SRDF of the robot disables the pair, ``without a reason``, or empty", default=""
    )

    @property
    def frequency(self) -> Frequency:
        """How often they touch in words; ``nearly always`` means in 95 % of the samples or more."""
        if self.touching in (0, self.samples):
            return "always" if self.touching else "never"
        return "nearly always" if self.touching >= NEARLY_ALL * self.samples else "sometimes"

    @property
    def reason(self) -> str:
        """The reason for excluding the pair in the proposed SRDF; empty if it stays checked."""
        return ADJACENT if self.adjacent else ALWAYS if self.touching == self.samples else ""


@dataclass(frozen=True)
class OverlapReport(Shown):
    """All pairs of links with collision geometry; result of :func:`sample_overlaps`."""

    robot: Robot
    pairs: tuple[LinkOverlap, ...]
    samples: int

    @property
    def proposed(self) -> tuple[DisabledPair, ...]:
        """The pairs to exclude: adjacent links, and links that touch in every sample.

        Links that never touch in the samples are not excluded, because samples do not prove that they never do: a
        certificate that leaves them out could report a motion in collision as free.
        """
        return tuple(DisabledPair(pair.links, pair.reason) for pair in self.pairs if pair.reason)

    def to_dict(self) -> dict[str, Any]:
        """The pairs with their counts and the proposal as plain values for JSON."""
        keys = ("links", "touching", "frequency", "adjacent", "geometry")
        pairs = [
            {**{key: getattr(pair, key) for key in keys}, "srdf": pair.disabled, "proposed": pair.reason}
            for pair in self.pairs
        ]
        return {"robot": self.robot.name, "samples": self.samples, "pairs": pairs}

    def _view(self) -> View:
        # The pairs by frequency, each with the proposal; those that never touch as one line.
        touching = [pair for pair in self.pairs if pair.touching or pair.reason]
        never = [" and ".join(pair.links) for pair in self.pairs if pair not in touching]
        rows = [
            (
                " and ".join(pair.links),
                f"{pair.touching} of {pair.samples}: {pair.frequency}",
                pair.geometry,
                pair.disabled or "-",
                f"exclude: {pair.reason}" if pair.reason else "keep checking",
            )
            for pair in touching
        ]
        table = Rows(("links", "in contact", "geometry", "SRDF", "proposal"), rows)
        sampled = f"{len(self.pairs)} pairs of links in {self.samples:,} sampled configurations of all joints"
        notes = [
            f"never in contact in these samples: {len(never)} pairs{': ' if never else ''}{', '.join(never)}",
            "proposed: exclude adjacent links and links that touch in every sample, and check all others",
            "samples do not prove that links never touch",
        ]
        return View(f"{self.robot.name}: {sampled}", [table, notes], (*table.text(), *notes))

    def save_srdf(self, path: str | Path) -> None:
        """Write an SRDF atomically: the content of the robot's own SRDF, if there is one, and the proposed pairs.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        write_text_whole(path, srdf_text(self.robot.name, self.robot.srdf, self.proposed))


def sample_overlaps(robot: Robot, *, samples: int = 1000) -> OverlapReport:
    """Count in how many random configurations of all joints each two links of a robot touch.

    Parameters
    ----------
    robot
        The robot.
    samples
        Number of configurations within the limits, at least :data:`MIN_SAMPLES`, from a fixed seed. Joints without
        limits take one full rotation.

    Returns
    -------
    OverlapReport
        The pairs, those that touch most often first.

    Raises
    ------
    MeshError
        If a collision mesh is missing or cannot be used.
    """
    require_integer("samples", samples, MIN_SAMPLES)
    links = list(dict.fromkeys(geometry.link for geometry in robot.urdf.collisions))
    bodies = LinkBodies(robot.urdf.collisions, dict.fromkeys(robot.urdf.links, "hull"))
    overlaps = Overlaps(robot, bodies, samples, samples)
    # What the SRDF states of each pair, beside how often it touches.
    joined = {frozenset((joint.parent, joint.child)) for joint in robot.urdf.joints.values()}
    disabled = {frozenset(pair.links): pair.reason or "without a reason" for pair in robot.srdf.disabled}
    pairs = []
    for first, second in combinations(links, 2):
        overlap, key = overlaps.of(first, second), frozenset((first, second))
        geometry = "collision model" if overlap.level == AS_REQUESTED else GEOMETRY_NAMES[overlap.level]
        reason = disabled.get(key, "")
        pairs.append(LinkOverlap((first, second), overlap.touching, samples, key in joined, geometry, reason))
    return OverlapReport(robot, tuple(sorted(pairs, key=lambda pair: -pair.touching)), samples)
