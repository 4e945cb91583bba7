"""How often links of a robot touch in random configurations, and an SRDF that excludes the pairs that always do.

Sampling is needed because a pair that an SRDF disables is no evidence: ``Default`` means that the two touched in one
configuration, ``Adjacent`` and ``User`` that the author disabled them. Collision models are often larger than the
robot, and links that share a housing overlap by design; a pair that overlaps in nearly all configurations carries no
information. If the hulls of two links overlap much more often than their exact meshes, the pair is checked with several
hulls each, or with the exact meshes, instead.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any, Literal, NamedTuple
from weakref import WeakKeyDictionary

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.checking.links import AS_REQUESTED, DECOMPOSED, EXACT, GEOMETRY_NAMES, LinkBodies
from pinproof.collision.geometry.bodies import Body
from pinproof.common.files import write_text_whole
from pinproof.common.validation import require_integer
from pinproof.description.srdf import DisabledPair, srdf_text
from pinproof.model import Robot

Booleans = npt.NDArray[np.bool_]
Frequency = Literal["always", "nearly always", "sometimes", "never"]

ADJACENT, ALWAYS = "Adjacent", "Always"
"""The reasons of MoveIt's Setup Assistant with which pairs are excluded; a checker confirms ``Always`` by samples."""

MIN_SAMPLES = 50
"""Smallest number of configurations: links that touch in all of them touch in 94 % of all, with 95 % confidence."""

NEARLY_ALL = 0.95
"""A pair that touches in this share of the samples is excluded: the share above which MoveIt's Setup Assistant regards
a pair as always in collision (``min_collision_fraction``)."""

MOST = 0.5
"""A pair that touches in this share of the samples is also excluded if it is close in :data:`NEARLY_ALL` of them."""

CLOSE_SHARE = 0.0025
"""Share of the robot's size, a few millimetres: links at a smaller distance are close. Meshes are not more accurate;
shoulder links whose meshes touch in three of four configurations and are never farther apart are adjacent."""

COARSE = 0.05
"""Bodies represent a pair well enough if the share of samples in which they touch, and the exact meshes do not, is no
larger than this."""

SAMPLES = 200
"""Number of sampled configurations: a share of 0.95 is estimated within 0.03 in 19 of 20 cases."""

SEED = 0
"""Seed of the samples, so that every checker of a robot excludes the same pairs."""


class Overlap(NamedTuple):
    """How often two links, or objects attached to them, touch."""

    touching: float
    """The share of the samples in which they touch, with bodies of ``level``."""
    near: float
    """The share of the samples in which their distance is at most ``close``."""
    close: float
    """Distance (m) up to which they count as close."""
    level: int = AS_REQUESTED
    """The level of detail that the pair needs, see :mod:`pinproof.collision.checking.links`."""

    @property
    def nearly_all(self) -> bool:
        """Whether they touch in nearly all configurations, so that contact does not distinguish configurations."""
        return self.touching >= NEARLY_ALL or (self.touching >= MOST and self.near >= NEARLY_ALL)

    def __str__(self) -> str:
        text = f"in contact in {self.touching:.0%} of sampled configurations"
        return text if self.touching >= NEARLY_ALL else f"{text}, within {self.close * 1e3:.2g} mm in {self.near:.0%}"


class Overlaps:
    """Estimates how often pairs of links of a robot touch, at a number of sampled configurations.

    Results are cached for all checkers of the robot.
    """

    def __init__(self, robot: Robot, links: LinkBodies, samples: int = SAMPLES) -> None:
        self._robot, self._links, self._count = robot, links, samples
        self._verdicts: dict[frozenset[str], Overlap] = {}  # included in a pickle

    def of(self, a: str, b: str) -> Overlap:
        """Return how often two links touch."""
        pair = frozenset((a, b))
        if pair not in self._verdicts:
            known = _known(self._robot, self._count).overlaps
            key = pair, *sorted((link, self._links.meshes_of(link)) for link in pair)
            if key not in known:
                known[key] = self._found(a, b)
            self._verdicts[pair] = known[key]
        return self._verdicts[pair]

    def of_bodies(self, a: Sequence[Body], b: Sequence[Body]) -> Overlap:
        """Return how often any of these bodies touch, each of which moves with a link; not cached."""
        return self._overlap(a, b, self._touching(a, b), AS_REQUESTED)

    def _found(self, a: str, b: str) -> Overlap:
        requested, exact = self._on(AS_REQUESTED, a, b), self._on(EXACT, a, b)
        coarse = self._touching(*requested)
        if coarse.mean() <= COARSE or not any(map(self._links.can_be_finer, (a, b))):
            return self._overlap(*requested, coarse, AS_REQUESTED)
        true = self._touching(*exact, where=coarse)
        found = self._overlap(*exact, true, EXACT)
        if found.nearly_all:
            return found
        if coarse.mean() - true.mean() <= COARSE:
            return self._overlap(*requested, coarse, AS_REQUESTED)
        several = self._on(DECOMPOSED, a, b)
        closer = self._touching(*several, where=coarse)
        return self._overlap(*several, closer, DECOMPOSED) if closer.mean() - true.mean() <= COARSE else found

    def _overlap(self, a: Sequence[Body], b: Sequence[Body], touching: Booleans, level: int) -> Overlap:
        close, near = CLOSE_SHARE * self._robot.size_around(a[0].link or ""), touching
        if MOST <= touching.mean() < NEARLY_ALL:
            near = touching | self._touching(a, b, where=~touching, within=close)
        return Overlap(float(touching.mean()), float(near.mean()), close, level)

    def _on(self, level: int, a: str, b: str) -> tuple[Sequence[Body], Sequence[Body]]:
        return self._links.on_level(a, level), self._links.on_level(b, level)

    def _touching(
        self, a: Sequence[Body], b: Sequence[Body], *, where: Booleans | None = None, within: float = 0.0
    ) -> Booleans:
        """Return (samples,) whether any bodies are ``within`` this distance (m), only at the samples ``where``."""
        touching = np.zeros(self._count, dtype=bool)
        samples = _known(self._robot, self._count)
        for i in range(self._count) if where is None else np.flatnonzero(where).tolist():
            placed = [[(body, samples.placement(i, body)) for body in bodies] for bodies in (a, b)]
            touching[i] = any(_touch(*one, *other, within) for one in placed[0] for other in placed[1])
        return touching

    def __repr__(self) -> str:
        return f"Overlaps({self._robot.name!r})"


class _Samples:
    """Random configurations of all joints of a robot, and the cached overlaps of its links."""

    def __init__(self, robot: Robot, count: int) -> None:
        self._model = robot.model
        self.overlaps: dict[Any, Overlap] = {}
        self._data = self._model.createData()
        self._placements: dict[tuple[int, str | None], pin.SE3] = {}
        rng = np.random.default_rng(SEED)
        self._configurations = [_configuration(robot, rng) for _ in range(count)]
        self._placed_at = -1
        self._lock = threading.Lock()  # all threads share the workspace

    def placement(self, i: int, body: Body) -> pin.SE3:
        """``root_from_body`` of a body that moves with a link at sample ``i``."""
        key = i, body.link
        with self._lock:
            if key not in self._placements:
                if self._placed_at != i:
                    pin.forwardKinematics(self._model, self._data, self._configurations[i])
                    self._placed_at = i
                frame = self._model.getFrameId(body.link, pin.FrameType.BODY)
                self._placements[key] = pin.updateFramePlacement(self._model, self._data, frame).copy()
        return self._placements[key] * body.link_from_body


_KNOWN: WeakKeyDictionary[Robot, dict[int, _Samples]] = WeakKeyDictionary()


def _known(robot: Robot, count: int) -> _Samples:
    known = _KNOWN.setdefault(robot, {})
    if count not in known:
        known[count] = _Samples(robot, count)
    return known[count]


def _configuration(robot: Robot, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """Return a random configuration of all joints: mimic joints follow their leaders, floating joints are neutral."""
    model, joints = robot.model, robot.urdf.joints
    q = pin.neutral(model)
    values = {}
    for name, joint in joints.items():
        if joint.mimic is None and joint.type in ("revolute", "continuous", "prismatic"):
            open_range = 1.0 if joint.type == "prismatic" else np.pi
            lower = -open_range if joint.lower is None or joint.type == "continuous" else joint.lower
            upper = open_range if joint.upper is None or joint.type == "continuous" else joint.upper
            values[name] = rng.uniform(lower, upper)
    for name, joint in joints.items():
        if joint.mimic is not None and joint.mimic.leader in values:
            value = joint.mimic.multiplier * values[joint.mimic.leader] + joint.mimic.offset
        elif name in values:
            value = values[name]
        else:
            continue
        q[model.joints[model.getJointId(robot.urdf.model_joint(name))].idx_q] = value
    return np.asarray(q)


def _touch(a: Body, root_from_a: pin.SE3, b: Body, root_from_b: pin.SE3, within: float) -> bool:
    """Whether two bodies are at most ``within`` (m) apart, or one is inside the watertight mesh of the other."""
    offset = _middle(a, root_from_a) - _middle(b, root_from_b)
    if offset @ offset > (_ball(a) + _ball(b) + within + 1e-6) ** 2:  # farther apart than their bounding balls
        return False
    request = coal.CollisionRequest()
    request.security_margin = within
    placed = [coal.Transform3s(at.rotation, at.translation) for at in (root_from_a, root_from_b)]
    if coal.collide(a.geometry, placed[0], b.geometry, placed[1], request, coal.CollisionResult()):
        return True
    return a.contains_part_of(b, root_from_a.actInv(root_from_b)) or b.contains_part_of(
        a, root_from_b.actInv(root_from_a)
    )


def _middle(body: Body, root_from_body: pin.SE3) -> npt.NDArray[np.float64]:
    return np.asarray(root_from_body.rotation @ body.box.mean(axis=0) + root_from_body.translation)


def _ball(body: Body) -> float:
    return float(np.linalg.norm(body.box[1] - body.box[0])) / 2


@dataclass(frozen=True)
class LinkOverlap:
    """How often two links touch.

    Parameters
    ----------
    links
        The two links.
    touching, samples
        In how many of the sampled configurations they touch.
    adjacent
        Whether one joint connects them.
    geometry
        The geometry that was tested: that of the collision model (meshes as hulls), or ``several hulls`` or ``exact
        meshes`` where the hulls touch much more often than the meshes.
    disabled
        The reason with which the SRDF of the robot disables the pair, ``without a reason``, or empty.
    """

    links: tuple[str, str]
    touching: int
    samples: int
    adjacent: bool
    geometry: str
    disabled: str = ""

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
class OverlapReport:
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
    overlaps = Overlaps(robot, bodies, samples)
    joined = {frozenset((joint.parent, joint.child)) for joint in robot.urdf.joints.values()}
    disabled = {frozenset(pair.links): pair.reason or "without a reason" for pair in robot.srdf.disabled}
    pairs = []
    for first, second in combinations(links, 2):
        found, key = overlaps.of(first, second), frozenset((first, second))
        geometry = "collision model" if found.level == AS_REQUESTED else GEOMETRY_NAMES[found.level]
        count = round(found.touching * samples)
        pairs.append(LinkOverlap((first, second), count, samples, key in joined, geometry, disabled.get(key, "")))
    return OverlapReport(robot, tuple(sorted(pairs, key=lambda pair: -pair.touching)), samples)
