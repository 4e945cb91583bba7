"""Checks configurations for collisions between the arm, its attached objects and a scene."""

from __future__ import annotations

import hashlib
import threading
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from types import MethodType
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof._core import FREE, NOT_FINITE, World, edges_proven
from pinproof.collision.checking.assembly import (
    Assembly,
    CheckedBodies,
    assemble,
    is_pair,
    numbered_owners,
    warn_of_units,
)
from pinproof.collision.checking.links import DECOMPOSED, EXACT, LinkBodies, LinkMeshes, Overlaps, meshes_of
from pinproof.collision.checking.pairs import PairRules, overlap_levels, unexplained_pairs
from pinproof.collision.checking.penetration import crossing_depth
from pinproof.collision.checking.placed_bodies import Distance, FixedPairs, PlacedBodies
from pinproof.collision.checking.spec import Changeable, CheckerSpec, Levels, Pair, margins_of
from pinproof.collision.geometry.bodies import Body, CellsBody, with_triangles
from pinproof.collision.geometry.shapes import Obstacle
from pinproof.collision.scene import Scene
from pinproof.common.results import Rows, Shown, View
from pinproof.common.structs import described, key
from pinproof.common.validation import require_type
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import JointGroup
from pinproof.motion import Curve, refuse_broken
from pinproof.spatial import Array, finite


@described(eq=False)
class Contact:
    """Two bodies whose distance is the margin or less."""

    bodies: tuple[str, str] = key("the owners: links, attached objects, obstacles")
    distance: float = key("signed distance in metres; below 0 it is the penetration depth as computed by coal")
    points: Array = key("(2, 3) the nearest (or deepest) point of each body, in the robot's root frame")
    normal: Array = key(
        "(3,) unit vector in the root frame along which the second body would be moved away from the first"
    )

    @property
    def depth(self) -> float:
        """Penetration depth (m); 0 if the bodies do not penetrate."""
        return max(-self.distance, 0.0)

    def __str__(self) -> str:
        one, other = self.bodies
        millimetres = f"{abs(self.distance) * 1e3:.1f} mm"
        if self.distance < 0:
            return f"{one} penetrates {other} by {millimetres}"
        return f"{one} is near {other} ({millimetres} apart)"


@dataclass(frozen=True, eq=False)
class CheckResult(Shown):
    """All contacts at one configuration, sorted by distance."""

    contacts: tuple[Contact, ...]

    @property
    def free(self) -> bool:
        """Whether there is no contact."""
        return not self.contacts

    def __str__(self) -> str:
        # A link may be several bodies, of which the nearest is named
        nearest = {contact.bodies: str(contact) for contact in reversed(self.contacts)}
        texts = [nearest.pop(contact.bodies) for contact in self.contacts if contact.bodies in nearest]
        more = [f"... ({len(texts)} pairs in all)"] if len(texts) > NAMED else []
        return "; ".join(texts[:NAMED] + more) or "free"

    def _view(self) -> View:
        rows = [(*each.bodies, each.distance * 1e3) for each in self.contacts]
        table = Rows(("body", "body", "distance [mm]"), rows) if rows else None
        title = f"{len(rows)} contact{'' if len(rows) == 1 else 's'}" if rows else "free"
        return View(title, [table], map(str, self.contacts), len(rows))


NAMED = 6
"""Largest number of contacts that a message states."""

CHECKERS_KEPT = 16
"""Number of checkers with finer bodies, larger margins or fewer pairs that a checker keeps."""

CHUNK = 64
"""Number of configurations that a thread processes at a time."""


class CollisionChecker(CheckedBodies, Changeable, Shown):
    """Checks configurations of an arm against itself and a scene.

    ``q`` contains the arm's own joints only; joints outside the arm keep the values that the arm holds. Two bodies are
    in contact if their distance is not proven to be larger than the margin, so floating-point error never produces a
    false "free". Results do not depend on earlier queries. A checker can be used from several threads; each thread has
    its own workspace.

    :meth:`with_scene`, :meth:`with_attached`, :meth:`with_held`, :meth:`allowing` and :meth:`with_margin` return
    checkers for other stages of a task, which share the bodies with this one.

    Parameters
    ----------
    arm
        The arm, or a joint group with several arms.
    scene
        The obstacles.
    margin
        Distance (m) that is required between any two checked bodies.
    margins
        Margins of single pairs of names (links, attached objects, obstacles), which replace ``margin``.
    link_meshes
        How link meshes are represented. ``"hull"``: by their convex hulls, which contain the mesh. ``"mesh"``: by their
        triangles, solid if the mesh is watertight; otherwise by the hull. ``"surface"``: by their triangles; a mesh
        that is not watertight is then a surface, and a body entirely inside it is not detected. ``"decomposed"``: by
        several convex hulls that together contain the mesh. One value for all links, or a mapping of link names to
        values, in which ``"*"`` stands for all other links. Pairs of links that an SRDF disables without a reason, and
        pairs whose hulls touch in every sampled configuration, are checked with finer geometry, see :attr:`finer`.
    attached
        Objects that move with the tcp, such as a gripper; their pose is ``tcp_from_object``. For a joint group with
        several arms, ``Obstacle(..., arm=name)`` states the arm.
    allowed
        Pairs of names (links, attached objects, obstacles) that may touch.
    trust_disabled
        Exclude every pair that the SRDF or the scene's allowed-collision matrix disables. Otherwise these pairs are
        checked, unless they touch in all sampled configurations or no joint of the arm moves them relative to each
        other.
    housing
        Length (m) of a joint housing, such as that of a spherical wrist. Two links that are separated only by links
        without geometry are excluded if they touch in all sampled configurations and the distances between the
        revolute joints between them add up to no more than this length. Default: 5 % of the robot's size (the largest
        sum of joint offsets from the root to a link).

    Raises
    ------
    MeshError
        If a collision mesh is missing or has no hull.
    UnknownNameError
        If an allowed contact or a margin names an unknown body.
    InputError
        If a margin is negative or not finite, or two bodies share a name.
    """

    _kept: dict[Hashable, CollisionChecker]

    def __init__(
        self,
        arm: JointGroup,
        scene: Scene | None = None,
        *,
        margin: float = 0.0,
        margins: Mapping[tuple[str, str], float] | None = None,
        link_meshes: LinkMeshes | Mapping[str, LinkMeshes] = "hull",
        attached: Sequence[Obstacle] = (),
        allowed: Iterable[Sequence[str]] = (),
        trust_disabled: bool = False,
        housing: float | None = None,
    ) -> None:
        self._build(
            CheckerSpec(
                arm,
                Scene() if scene is None else scene,
                margin=margin,
                margins=margins or {},
                link_meshes=link_meshes,
                attached=tuple(attached),
                allowed=tuple((a, b) for a, b in allowed),
                trust_disabled=trust_disabled,
                housing=housing,
            )
        )
        self._require_bodies(margins or {}, "margins")
        self._require_bodies(margins_of(self.scene), f"the margins of {self.scene.where}")

    def _require_bodies(self, margins: Mapping[Any, float], where: str) -> None:
        """Raise UnknownNameError if margins of pairs are for bodies that this checker does not have."""
        for name in (name for pair in margins for name in sorted(pair)):
            if name not in self._owners[0]:
                raise UnknownNameError("body", name, tuple(self._owners[0]), where)

    @classmethod
    def of(cls, spec: CheckerSpec) -> CollisionChecker:
        """Return the checker of a specification."""
        checker = object.__new__(cls)
        checker._build(spec)
        return checker

    def _build(self, spec: CheckerSpec) -> None:
        arm, urdf = spec.arm, spec.arm.robot.urdf
        self._spec = spec
        self._link_bodies = LinkBodies(urdf.collisions, meshes_of(urdf.links, spec.link_meshes))
        self._rules = PairRules(Overlaps(arm.robot, self._link_bodies), spec.housing, spec.trust_disabled)
        # Levels of detail: several hulls for unexplained pairs, what overlaps require, and what is stated.
        unexplained = () if spec.trust_disabled else unexplained_pairs(arm.robot)
        self._levels: Levels = {
            **dict.fromkeys(unexplained, DECOMPOSED),
            **overlap_levels(self._link_bodies.of({}), arm, self._rules),
            **spec.finer,
        }
        self._assemble(None)
        warn_of_units(spec, self.bodies)
        # Robots of a cell may overlap with links that no joint moves, such as their bases.
        for k, measured in self._fixed.touching if arm.robot.parts else ():
            one, other = (self.bodies[i].link for i in self.indices_of(k))
            if one is not None and other is not None and arm.robot.part_of(one) != arm.robot.part_of(other):
                raise InputError(
                    f"the robots of the cell overlap: {self._contact(k, measured)}. Place them farther apart, or pass "
                    f"allowed=[{self.owners(k)}] if these links may touch"
                )

    def _view(self) -> View:
        counts = f"{len(self.bodies)} bodies, {len(self._pairs)} checked pairs, {len(self.excluded)} excluded pairs"
        attached = "".join(f", {body.name} attached" for body in self.attached)
        owners = Counter(owner for k in range(len(self._pairs)) for owner in self.owners(k))
        excluded = ((" and ".join(pair.owners), pair.reason) for pair in self.excluded)
        parts = [Rows(("body", "checked pairs"), owners.items()), Rows(("excluded pair", "reason"), excluded)]
        head = f"{self.group.robot.name!r}, {counts}, margin {self.margin * 1e3:g} mm{attached}"
        return View(head, parts, title=f"CollisionChecker({head})")

    # -- queries ----------------------------------------------------------------------------------------------------

    def is_free(self, q: npt.ArrayLike) -> bool:
        """Whether every checked pair is proven farther apart than its margin at q (n,). Ignores joint limits."""
        try:
            result = self._threads.judge(q)
        except (AttributeError, TypeError, ValueError):  # the first query of a thread, or not (n,) contiguous doubles
            return self.is_free_unchecked(self.group.configuration(q, batch="is_free_batch"))
        if result == NOT_FINITE:
            self.group.configuration(q)  # raises
        return bool(result == FREE and not self._fixed.touching)

    def is_free_unchecked(self, q: Array) -> bool:
        """:meth:`is_free` without validation of q (n,), for inner loops."""
        result = self._workspace.judge(np.ascontiguousarray(q, dtype=float))
        if result == NOT_FINITE:
            self.group.configuration(q)  # raises
        return bool(result == FREE and not self._fixed.touching)

    def is_free_batch(self, Q: npt.ArrayLike, *, threads: int = 1) -> npt.NDArray[np.bool_]:
        """Return (N,) :meth:`is_free` for each row of Q (N, n); the result does not depend on ``threads``."""
        many = finite("Q", Q, (None, self.group.dof))
        if self._fixed.touching:
            return np.zeros(len(many), dtype=bool)
        return self._batch(lambda part: self._workspace.judge_many(part), many, threads) == FREE

    def world_for(self, accept: object, arm: JointGroup) -> World | None:
        """Return the world in which the core decides the same as ``accept`` for an arm, or None.

        That is possible if ``accept`` is :meth:`is_free` of this checker, the arm has the joints of its group, and no
        pair that no joint moves is in contact.
        """
        own = accept == MethodType(CollisionChecker.is_free, self) and arm.joint_names == self.group.joint_names
        return self.world if own and not self._fixed.touching else None

    def edges_free(self, A: npt.ArrayLike, B: npt.ArrayLike, *, threads: int = 0) -> npt.NDArray[np.bool_]:
        """Return (N,) whether the straight edges from the rows of A to those of B are proven free, without the GIL.

        A proof holds for all configurations of an edge, not for samples. An edge that is not proven is in contact, or
        the distance on it is hardly larger than the margin. Joint limits are ignored.

        Parameters
        ----------
        A, B
            (N, n) the configurations at which the edges begin and end.
        threads
            The number of threads; 0: one for each processor. The result does not depend on it.
        """
        begin = finite("A", A, (None, self.group.dof))
        end = finite("B", B, begin.shape)
        if threads < 0:
            raise InputError(f"threads = {threads}; it must be 0 or more")
        if self._fixed.touching:
            return np.zeros(len(begin), dtype=bool)
        return edges_proven(self.world, begin, end, threads)

    def check(self, q: npt.ArrayLike) -> CheckResult:
        """Return all contacts at q (n,), sorted by distance, with names, distances, points and normals."""
        space = self._workspace
        touching = (*self._fixed.touching, *space.touching(self.group.configuration(q)))
        found = [self._contact(k, measured) for k, measured in touching]
        return CheckResult(tuple(sorted(found, key=lambda contact: contact.distance)))

    def lasting_contacts(self, q: npt.ArrayLike, motion: float) -> CheckResult:
        """Return the contacts at q (n,) that remain if bodies move by ``motion`` (m) or less relative to each other.

        They are deeper penetrations. The depth of two exact meshes, which coal does not know, is a lower bound.
        """
        space, found = self._workspace, []
        for k, measured in (*self._fixed.touching, *space.touching(self.group.configuration(q))):
            (i, j), depth = self.indices_of(k), -measured.distance
            if self.bodies[i].is_exact and self.bodies[j].is_exact:
                placed = space.root_from_body(i), space.root_from_body(j)
                depth = max(depth, crossing_depth(self.bodies[i], placed[0], self.bodies[j], placed[1]))
            if depth > motion:
                found.append(self._contact(k, measured._replace(distance=-depth)))
        return CheckResult(tuple(sorted(found, key=lambda contact: contact.distance)))

    def clearance(self, q: npt.ArrayLike) -> float:
        """Return the smallest signed distance (m) over all checked pairs at q (n,); inf if no pair is checked.

        For separated bodies it is a lower bound up to :attr:`rounding`, within 1e-9 m of the distance. For penetrating
        bodies it is minus the penetration depth as computed by coal.
        """
        space = self._workspace
        near = space.nearest(self.group.configuration(q, batch="clearance_batch"))
        judged = (space.measure(k).distance for k in near.contacts)
        return min((near.lower, self._fixed.lower, *judged))

    def clearance_batch(self, Q: npt.ArrayLike, *, threads: int = 1) -> Array:
        """Return (N,) :meth:`clearance` for each row of Q (N, n); the result does not depend on ``threads``."""
        many = finite("Q", Q, (None, self.group.dof))
        lower = self._batch(lambda part: self._workspace.clearances(part), many, threads)
        out = np.minimum(lower, self._fixed.lower)
        for i in np.flatnonzero(np.isnan(lower)):
            out[i] = self.clearance(many[i])
        return np.asarray(out)

    # -- checkers for other stages of a task --------------------------------------------------------------------------

    def with_spec(self, spec: CheckerSpec) -> CollisionChecker:
        """Return the checker of another specification, which shares with this one the bodies and pairs of both.

        For changes that no other method makes: ``checker.with_spec(replace(checker.spec, arm=arm))`` checks the same
        links for another joint group of the robot, or of the robot with movers.
        """
        before, settings = self._spec, (spec.housing, spec.trust_disabled)
        same = spec.arm.robot.urdf.collisions == before.arm.robot.urdf.collisions
        return self._derived(spec) if same and settings == self._rules[1:] else type(self).of(spec)

    def _changed(self, key: Hashable = None, **changes: object) -> CollisionChecker:
        if key is not None and key in self._kept:
            return self._kept[key]
        # In other surroundings, pairs that were left out are checked again even if the surroundings are equal.
        return self._derived(self._spec._changed(**changes), key, assemble="scene" in changes)

    def without_pairs(self, pairs: Iterable[int]) -> CollisionChecker:
        """Return a checker without the pairs of bodies that have these indices in :attr:`pairs`.

        For proofs that handle the omitted pairs by other means: ``excluded`` does not list them, and checkers that
        are derived from this one by a new scene, attached object or allowed contact check them again.
        """
        dropped = frozenset(pairs)
        if dropped in self._kept:
            return self._kept[dropped]
        left = np.ones(len(self._pairs), dtype=bool)
        left[[k for k in dropped if 0 <= k < len(left)]] = False
        other, made = copy(self), self._assembly  # the specification does not state these pairs
        other._take(made.with_pairs(replace(made.pairs, checked=self._pairs[left])))
        return self._keep(dropped, other)

    def _with_obstacle_bodies(
        self, bodies: Sequence[Body], pairs: npt.NDArray[np.int64]
    ) -> tuple[CollisionChecker, npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Return a checker with more bodies of the scene's obstacles, and more checked pairs (P, 2), sorted.

        Also returns the indices there of the present pairs and of the new ones. The new bodies follow those in
        :attr:`bodies`. As for :meth:`without_pairs`, derived checkers do not have them.
        """
        made = self._assembly
        before = np.searchsorted(self._pairs[:, 0], pairs[:, 0], side="right")
        checked, new = np.insert(self._pairs, before, pairs, axis=0), before + np.arange(len(pairs))
        other = copy(self)
        other._take(made.with_obstacle_bodies((*made.around.bodies, *bodies), replace(made.pairs, checked=checked)))
        return other, np.delete(np.arange(len(checked)), new), new

    def _with_facets_of(self, owners: Iterable[str]) -> CollisionChecker:
        """Return the same checker in which those of these obstacles that are many boxes are triangles."""
        made = self._assembly
        ranges, bodies = made.around.ranges, made.around.bodies
        named = {name for name in owners if any(isinstance(bodies[k], CellsBody) for k in ranges.get(name, ()))}
        if not named:
            return self
        other = copy(self)
        with_meshes = [b.as_mesh() if isinstance(b, CellsBody) and b.owner in named else b for b in bodies]
        other._take(made.with_obstacle_bodies(with_meshes, made.pairs))
        return other

    def finer_at(self, q: npt.ArrayLike) -> CollisionChecker:
        """Return a checker with finer geometry for pairs whose bodies touch at q (n,) although their meshes do not.

        A link whose hull is in contact is represented by several hulls or, where these also touch, by its exact mesh.
        Derived checkers keep this. :attr:`finer` and certificates list these pairs. Returns this checker if there is
        no contact at q, or only contacts of the exact meshes.
        """
        at = self.group.configuration(q)

        def touching(levels: Levels) -> set[Pair]:
            return (self if levels == self._levels else self._finer(levels))._meshes_in_contact(at)

        # Each pair gets the coarsest level on which it does not touch, because convex bodies are checked in compiled
        # code. A pair that touches on every level keeps its level: the contact is real, and finer bodies only cost
        # time.
        levels = dict(self._levels)
        still_open = touching(levels)
        for level in (DECOMPOSED, EXACT):
            if raised := {pair for pair in still_open if levels.get(pair, 0) < level}:
                levels.update(dict.fromkeys(raised, level))
                still_open &= touching(levels)
        for pair in still_open:
            levels.pop(pair)
            if pair in self._levels:
                levels[pair] = self._levels[pair]
        return self if levels == self._levels else self._finer(levels)

    def exact_at(self, q: npt.ArrayLike) -> CollisionChecker:
        """Return a checker in which links that touch at q (n,) are represented by their exact meshes."""
        pairs = self._meshes_in_contact(self.group.configuration(q))
        levels = {pair: max(EXACT, self._levels.get(pair, 0)) for pair in pairs}
        return self._finer({**self._levels, **levels}) if pairs else self

    def _meshes_in_contact(self, q: Array) -> set[Pair]:
        """Return the pairs of owners in contact at q (n,) that finer bodies can represent."""
        pairs = {frozenset(self.owners(k)) for k in self.pairs_in_contact(q)}
        return {pair for pair in pairs if any(map(self._link_bodies.can_be_finer, pair))}

    def exact(self) -> CollisionChecker:
        """Return a checker of the same pairs in which all meshes are their triangles, for checks at configurations.

        Links are surfaces where their mesh is not watertight. Meshes of obstacles and attached objects that are covered
        by convex pieces, or replaced by their hull because they are not watertight, are their triangles too; those with
        ``Mesh(hull=True)`` remain hulls.
        """
        spec = replace(
            self.spec,
            link_meshes="surface",
            scene=replace(self.scene, obstacles=tuple(map(with_triangles, self.scene.obstacles))),
            attached=tuple(map(with_triangles, self.attached)),
        )
        return self._derived(spec, "exact")

    def _finer(self, levels: Levels) -> CollisionChecker:
        """Return the checker in which pairs of owners have at least these levels of detail."""
        return self._derived(replace(self.spec, finer=levels), ("levels", frozenset(levels.items())))

    def with_margin(
        self, margin: float | None = None, margins: Mapping[tuple[str, str], float] | None = None
    ) -> CollisionChecker:
        """Return the same bodies and pairs with other margins (m); None keeps the present ones.

        ``margins`` replaces those of single pairs, except those that the scene alone states.
        """
        self._require_bodies(margins or {}, "margins")
        return super().with_margin(margin, margins)

    def with_scene(self, scene: Scene) -> CollisionChecker:
        """Return the same arm and attached objects in another scene, see :meth:`CheckerSpec.with_scene`."""
        other = super().with_scene(scene)
        other._require_bodies(margins_of(scene), f"the margins of {scene.where}")
        return other

    def _derived(self, spec: CheckerSpec, key: Hashable = None, *, assemble: bool = False) -> CollisionChecker:
        """Return the checker of a specification that was derived from this one's; with a key, it is kept."""
        if key is not None and key in self._kept:
            return self._kept[key]
        # The two share what the change leaves as it is: the bodies of links and obstacles, and the pairs.
        before, other = self.spec, copy(self)
        other._spec = spec
        if spec.link_meshes is not before.link_meshes:
            urdf = spec.arm.robot.urdf
            other._link_bodies, other._levels = LinkBodies(urdf.collisions, meshes_of(urdf.links, spec.link_meshes)), {}
        elif spec.arm.joint_names != before.arm.joint_names:
            # Joints that move in addition may need finer bodies of their links.
            other._levels = {**overlap_levels(self._link_bodies.of({}), spec.arm, self._rules), **self._levels}
        elif spec.finer is not before.finer:
            other._levels = {**self._levels, **spec.finer}
        bodies = ("arm", "scene", "attached", "link_meshes", "finer", "allowed")
        if assemble or any(getattr(spec, name) is not getattr(before, name) for name in bodies):
            other._assemble(self._assembly)
        else:
            other._set_margins()
        return other if key is None else self._keep(key, other)

    def _keep(self, key: Hashable, other: CollisionChecker) -> CollisionChecker:
        """Keep a derived checker for later requests, and return it."""
        latest = list(self._kept.items())[1 - CHECKERS_KEPT :]
        self._kept = {**dict(latest), key: other}  # replaced as a whole, because threads share this checker
        return other

    # -- properties ------------------------------------------------------------------------------------------

    @property
    def spec(self) -> CheckerSpec:
        """The specification from which the checker was built, and its hash."""
        return self._spec

    @property
    def scene(self) -> Scene:
        """The scene that is checked; :meth:`with_scene` makes a checker of another one."""
        return self._spec.scene

    @property
    def attached(self) -> tuple[Obstacle, ...]:
        """The objects that move with the tcp; :meth:`with_attached` makes a checker with more of them."""
        return self._spec.attached

    @property
    def margin(self) -> float:
        """The common margin (m); :meth:`with_margin` makes a checker with another one."""
        return self._spec.margin

    @property
    def obstacles_and_links(self) -> tuple[str, ...]:
        """The owners of all bodies: links with geometry, attached objects, obstacles."""
        return tuple(self._owners[0])

    @cached_property
    def _owners(self) -> tuple[dict[str, int], npt.NDArray[np.int64]]:
        """The owners of all bodies with their numbers, and (B,) the number of the owner of each body."""
        return numbered_owners(self.bodies)

    def pairs_of_owners(self, one: str, other: str) -> list[int]:
        """Return the indices of the checked pairs of the bodies of two owners."""
        numbers, owners = self._owners
        if one not in numbers or other not in numbers:
            return []
        found: list[int] = np.flatnonzero(is_pair(owners[self._pairs], numbers[one], numbers[other])).tolist()
        return found

    def pairs_in_contact(self, q: Array) -> list[int]:
        """Return the indices of the pairs in contact at q (n,)."""
        return [*(k for k, _ in self._fixed.touching), *self._workspace.contacts(q)]

    @cached_property
    def _exact(self) -> tuple[Body, ...]:
        return tuple([body for body in self.bodies if body.is_exact and body.support is None])

    @property
    def hollow_meshes(self) -> tuple[str, ...]:
        """The exact meshes that are not watertight: a body that is entirely inside one of them is not in contact."""
        return tuple(body.name for body in self.bodies if body.is_hollow)

    @property
    def fixed_contacts(self) -> tuple[Contact, ...]:
        """The contacts of bodies that no joint moves relative to each other, with which no configuration is free."""
        return tuple(self._contact(k, measured) for k, measured in self._fixed.touching)

    @cached_property
    def _fixed(self) -> FixedPairs:
        """The result for pairs that no joint moves relative to each other."""
        space = PlacedBodies(self, self.world.of_still_pairs())
        q = np.zeros(self.group.dof)  # any configuration
        near, touching = space.nearest(q), tuple(space.touching(q))
        judged = [space.measure(k) for k in near.contacts]
        lower = min((near.lower, *(measured.distance for measured in judged)))
        return FixedPairs(touching, lower, min((near.upper, *(measured.attained for measured in judged))))

    def fingerprint(self) -> str:
        """Return a hash of all inputs of a verdict: kinematics, held joints, geometry, placements, pairs, margins."""
        digest = hashlib.sha256()
        group = self.group
        words = (group.robot.urdf.kinematics, dict(group.ends), group.joint_names, dict(group.held))
        digest.update(repr((words, self._rules[1:], self._link_bodies, self.excluded, self.finer)).encode())
        digest.update(self.margins.tobytes() + repr(self.margin).encode())
        for body in self.bodies:
            digest.update(body.content())
        return digest.hexdigest()

    def _refuse_changes(self) -> None:
        """Raise an exception if the geometry of a body was modified in place.

        Raises
        ------
        InputError
            If the geometry of an exact mesh differs from that when the checker was created.
        """
        found = [f"the geometry of {body.name}" for body in self._exact if not body.unchanged]
        if found:
            raise InputError(f"the checker was modified in place ({', '.join(found)}); create a new checker")

    def __setattr__(self, name: str, value: object) -> None:
        if not name.startswith("_"):
            raise AttributeError(
                f"{name} of a checker is read-only; with_scene(), with_attached(), with_margin(), with_held() and "
                "allowing() return other checkers"
            )
        object.__setattr__(self, name, value)

    def _placed(self, q: Array) -> PlacedBodies:
        """Place every body at q (n,) in the workspace of this thread, without validation of q."""
        space = self._workspace
        space.move(q)
        return space

    def _contact(self, k: int, measured: Distance) -> Contact:
        """Return the contact of pair k."""
        return Contact(self.owners(k), measured.distance, measured.points, measured.normal)

    # -- assembly -----------------------------------------------------------------------------------------------

    def _assemble(self, before: Assembly | None) -> None:
        """Assemble bodies and pairs of the specification, with what it has in common with an assembly ``before``."""
        self._take(assemble(self._spec, self._link_bodies, self._rules, self._levels, before))

    def _take(self, made: Assembly) -> None:
        """Check the bodies and pairs of an assembly."""
        known = self.__dict__
        if known.get("bodies") is not made.bodies:
            for name in ("_owners", "_exact"):
                known.pop(name, None)
        pairs = made.pairs
        known.update(bodies=made.bodies, excluded=pairs.excluded, finer=pairs.finer, rounding=made.rounding)
        self._assembly, self._pairs, self._geometry_model = made, pairs.checked, None
        self._set_margins()

    def _set_margins(self) -> None:
        """Set the margins of all pairs, and place the bodies in the core."""
        spec, made, known = self._spec, self._assembly, self.__dict__
        pairs, (before, required, world) = made.pairs, known.get("_judged", (None, None, None))
        # What the world of a checker from which this one was derived has in common with its own is kept.
        # Scenes with as many bodies have the same pairs, of which other ones may belong to an obstacle.
        ranges = made.around.ranges if spec.margins else None
        requires = made.pairs, spec.margin, spec.margins, spec.obstacle_tolerance, ranges
        if requires != required:
            margins = np.full(len(pairs.checked), spec.margin, dtype=float)
            if spec.margins:
                numbers, owners = self._owners
                present = {pair: own for pair, own in spec.margins.items() if numbers.keys() >= pair}
                named = sorted({name for pair in present for name in pair})
                # A table of the named owners, in which all others are the last row and column
                row = {name: k for k, name in enumerate(named)}
                table = np.full((len(named) + 1, len(named) + 1), spec.margin, dtype=float)
                for (one, other), margin in present.items():
                    table[row[one], row[other]] = table[row[other], row[one]] = margin
                rows = np.full(len(numbers), len(named))
                rows[[numbers[name] for name in named]] = np.arange(len(named))
                first, second = rows[owners][pairs.checked].T
                margins = table[first, second]
            if spec.obstacle_tolerance:
                margins[pairs.checked[:, 1] >= len(made.own)] += spec.obstacle_tolerance
            margins.setflags(write=False)
            known["margins"] = margins
        if world is None or before.own is not made.own or before.spec.arm is not spec.arm or before.pairs is not pairs:
            world = World(made.geometry, pairs.table(made.geometry), self.margins)
        else:
            if made.around is not before.around:
                world = world.with_obstacles(made.geometry)
            if requires != required:
                world = world.with_margins(self.margins)
        known.update(world=world, _judged=(made, requires, world))
        # Drop what is computed on first access.
        for name in ("_fixed", "pairs", "still_pairs", "convex"):
            known.pop(name, None)
        self._kept = {}
        self._threads = threading.local()

    @property
    def _workspace(self) -> PlacedBodies:
        """The workspace of this thread."""
        try:
            return self._threads.space
        except AttributeError:
            space = PlacedBodies(self, self.world)
            self._threads.space, self._threads.judge = space, space.judge
            return space

    def _batch(self, judge: Callable[[Array], npt.NDArray[Any]], many: Array, threads: int) -> npt.NDArray[Any]:
        """Return (N,) the results of ``judge`` for parts of the configurations ``many`` (N, n)."""
        if threads < 1:
            raise InputError(f"threads = {threads}; it must be 1 or more")
        if threads == 1:
            return judge(many)
        with ThreadPoolExecutor(threads) as pool:
            parts = [many[i : i + CHUNK] for i in range(0, len(many), CHUNK)] or [many]
            return np.concatenate(list(pool.map(judge, parts)))

    def __copy__(self) -> CollisionChecker:
        """Copy including the cached obstacle bodies, which a pickle omits."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other

    def __getstate__(self) -> dict[str, Any]:
        names = ("_spec", "_link_bodies", "_rules", "_levels", "_assembly")
        return {name: self.__dict__[name] for name in names}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._take(self._assembly)


def require_curve(curve: Curve, checker: CollisionChecker, name: str = "curve") -> None:
    """Raise InputError unless the curve has the joints of the checker's group, in their order, and does not jump."""
    require_type("checker", checker, CollisionChecker)
    if not callable(getattr(curve, "bezier", None)):
        raise InputError(f"the {name} must be a curve, such as a JointPath or a Trajectory, not {curve!r:.80}")
    if tuple(curve.joint_names) != checker.group.joint_names:
        raise InputError(f"the {name} has the joints {curve.joint_names}, the arm has {checker.group.joint_names}")
    refuse_broken(curve)


MOSTLY = 0.5
"""Links that touch in more than this share of the samples touch by the design of their meshes rather than by chance."""


def overlap_hint(checker: CollisionChecker, q: Array, found: CheckResult) -> str:
    """A remedy for bodies that mostly touch, and for links that touch at the home of the arm, else an empty text."""
    links = set(checker.group.robot.urdf.links)
    among_links = dict.fromkeys(contact.bodies for contact in found.contacts if links.issuperset(contact.bodies))
    overlaps = {pair: checker._rules.overlaps.of(*pair) for pair in among_links}
    mostly = [f"{' and '.join(pair)} {how}" for pair, how in overlaps.items() if how.touching > MOSTLY * how.samples]
    still = {contact.bodies for contact in checker.fixed_contacts}
    mostly += [f"{' and '.join(each.bodies)} in every configuration" for each in found.contacts if each.bodies in still]
    hints = []
    # Bodies that mostly touch do so by design; at its home an arm is expected to be free.
    if mostly:
        hints.append(
            f"{'; '.join(mostly)}: if these bodies touch by design, list them in allowed_contacts of a scene (allowed= "
            "of the checker in Python)"
        )
    if among_links and (q == checker.group.home).all():
        hints.append(
            "if these links overlap by design, `pinproof info ROBOT --overlaps` lists all such pairs and "
            "--write-srdf writes an SRDF that excludes them (pinproof.collision.sample_overlaps in Python)"
        )
    return "; ".join(hints)
