"""Which pairs of links overlap in nearly all configurations, found by sampling.

Collision models are often made larger than the robot, and links that share a housing overlap by design. A pair of links
that overlaps however the joints between them stand says nothing about a configuration, and has to be left out of
collision checks. That an SRDF disables a pair is no evidence of this: ``Default`` means that the two touched in one
configuration, ``Adjacent`` and ``User`` that somebody disabled them. So each such pair is placed at random
configurations, and only what touches in nearly all of them is left out.

A contact of hulls alone is not held against a pair: where the hulls of two links overlap much more often than their
exact meshes do, the pair is checked with several hulls each, or with the exact meshes.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.bodies import Body
from pinproof.collision.links import AS_TOLD, DECOMPOSED, EXACT, LinkBodies
from pinproof.model import Robot

__all__ = ["Overlap", "Overlaps"]

Booleans = npt.NDArray[np.bool_]

NEARLY_ALL = 0.95
"""A pair that touches in this share of the samples is left out: the share above which MoveIt's Setup Assistant calls a
pair always in collision (``min_collision_fraction``)."""

MOST = 0.5
"""A pair that touches in this share of the samples is left out, too, if it is close in :data:`NEARLY_ALL` of them."""

CLOSE_SHARE = 0.0025
"""Of the robot's size: links that are nearer than this are close, a few millimetres. Meshes are no more accurate than
that; shoulders of which the meshes rub in three of four configurations, and are never farther apart, are neighbours."""

COARSE = 0.05
"""Bodies are close enough for a pair if they touch in no more than this share of the samples beyond those in which the
exact meshes touch."""

SAMPLES = 200
"""Configurations at which pairs are placed: a share of 0.95 is found to within 0.03 in 19 of 20 cases."""

SEED = 0
"""Of the samples, so that every checker of a robot leaves out the same pairs."""


class Overlap(NamedTuple):
    """How often two links, or objects that they carry, touch."""

    touching: float
    """The share of the samples in which they touch, judged on ``level``."""
    near: float
    """The share in which they are no farther apart than ``close``."""
    close: float
    """Metres."""
    level: int = AS_TOLD
    """How finely the pair has to be judged, see :mod:`pinproof.collision.links`."""

    @property
    def nearly_all(self) -> bool:
        """Whether they touch in nearly all configurations, so that contact says nothing about a configuration."""
        return self.touching >= NEARLY_ALL or (self.touching >= MOST and self.near >= NEARLY_ALL)

    def __str__(self) -> str:
        said = f"in contact in {self.touching:.0%} of sampled configurations"
        return said if self.touching >= NEARLY_ALL else f"{said}, within {self.close * 1e3:.2g} mm in {self.near:.0%}"


class Overlaps:
    """Finds how often pairs of links of a robot touch, and remembers it for all checkers of the robot.

    Parameters
    ----------
    robot
        The robot.
    links
        The bodies of its links.
    """

    def __init__(self, robot: Robot, links: LinkBodies) -> None:
        self._robot, self._links = robot, links
        self._verdicts: dict[frozenset[str], Overlap] = {}  # go along with a pickle

    def of(self, a: str, b: str) -> Overlap:
        """How often two links touch."""
        pair = frozenset((a, b))
        if pair not in self._verdicts:
            known = _known(self._robot).overlaps
            key = pair, *sorted((link, self._links.meshes_of(link)) for link in pair)
            if key not in known:
                known[key] = self._found(a, b)
            self._verdicts[pair] = known[key]
        return self._verdicts[pair]

    def of_bodies(self, a: Sequence[Body], b: Sequence[Body]) -> Overlap:
        """How often any of the bodies touch, each of which moves with a link; not remembered."""
        return self._overlap(a, b, self._touching(a, b), AS_TOLD)

    def _found(self, a: str, b: str) -> Overlap:
        told, exact = self._on(AS_TOLD, a, b), self._on(EXACT, a, b)
        coarse = self._touching(*told)
        if coarse.mean() <= COARSE or not any(map(self._links.can_be_finer, (a, b))):
            return self._overlap(*told, coarse, AS_TOLD)
        true = self._touching(*exact, where=coarse)
        found = self._overlap(*exact, true, EXACT)
        if found.nearly_all:
            return found
        if coarse.mean() - true.mean() <= COARSE:
            return self._overlap(*told, coarse, AS_TOLD)
        several = self._on(DECOMPOSED, a, b)
        closer = self._touching(*several, where=coarse)
        return self._overlap(*several, closer, DECOMPOSED) if closer.mean() - true.mean() <= COARSE else found

    def _overlap(self, a: Sequence[Body], b: Sequence[Body], touching: Booleans, level: int) -> Overlap:
        close, near = CLOSE_SHARE * self._robot.size, touching
        if MOST <= touching.mean() < NEARLY_ALL:
            near = touching | self._touching(a, b, where=~touching, within=close)
        return Overlap(float(touching.mean()), float(near.mean()), close, level)

    def _on(self, level: int, a: str, b: str) -> tuple[Sequence[Body], Sequence[Body]]:
        return self._links.on_level(a, level), self._links.on_level(b, level)

    def _touching(
        self, a: Sequence[Body], b: Sequence[Body], *, where: Booleans | None = None, within: float = 0.0
    ) -> Booleans:
        """(SAMPLES,) whether any bodies are ``within`` this distance (m), asked only at the samples ``where`` given."""
        touching = np.zeros(SAMPLES, dtype=bool)
        samples = _known(self._robot)
        for i in range(SAMPLES) if where is None else np.flatnonzero(where).tolist():
            placed = [[(body, samples.placement(i, body)) for body in bodies] for bodies in (a, b)]
            touching[i] = any(_touch(*one, *other, within) for one in placed[0] for other in placed[1])
        return touching

    def __repr__(self) -> str:
        return f"Overlaps({self._robot.name!r})"


class _Samples:
    """A robot at random configurations of all of its joints, and what was found of pairs of its links there."""

    def __init__(self, robot: Robot) -> None:
        self._model = robot.model
        self.overlaps: dict[Any, Overlap] = {}
        self._data = self._model.createData()
        self._placements: dict[tuple[int, str | None], pin.SE3] = {}
        rng = np.random.default_rng(SEED)
        self._configurations = [_configuration(robot, rng) for _ in range(SAMPLES)]
        self._placed_at = -1
        self._lock = threading.Lock()  # the workspace is one for all threads

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


_KNOWN: WeakKeyDictionary[Robot, _Samples] = WeakKeyDictionary()


def _known(robot: Robot) -> _Samples:
    if robot not in _KNOWN:
        _KNOWN[robot] = _Samples(robot)
    return _KNOWN[robot]


def _configuration(robot: Robot, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """A random configuration of the model of all joints: followers as their leaders have it, what floats neutral."""
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
    """Whether two bodies touch or are ``within`` (m); a part of one inside the watertight mesh of the other counts."""
    request = coal.CollisionRequest()
    request.security_margin = within
    placed = [coal.Transform3s(at.rotation, at.translation) for at in (root_from_a, root_from_b)]
    if coal.collide(a.geometry, placed[0], b.geometry, placed[1], request, coal.CollisionResult()):
        return True
    return _inside(a, root_from_a, b, root_from_b) or _inside(b, root_from_b, a, root_from_a)


def _inside(outer: Body, root_from_outer: pin.SE3, inner: Body, root_from_inner: pin.SE3) -> bool:
    if outer.solid is None or not outer.solid.watertight:
        return False
    outer_from_inner = root_from_outer.actInv(root_from_inner)
    return outer.solid.contains(inner.witnesses @ outer_from_inner.rotation.T + outer_from_inner.translation)
