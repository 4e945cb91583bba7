"""Is a configuration free of contact? The arm against itself and a scene: yes only where that is proven."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision.assembly import Assembly, Known, add_obstacle_bodies, assemble, keep_pairs, leave_out
from pinproof.collision.bodies import Body
from pinproof.collision.by_coal import Distance, geometry_model
from pinproof.collision.contact import CheckResult, Contact
from pinproof.collision.finer import Levels, finer_levels
from pinproof.collision.links import DECOMPOSED, LinkBodies, LinkMeshes, meshes_of
from pinproof.collision.margins import Margins, checked_margin
from pinproof.collision.overlaps import Overlaps
from pinproof.collision.pairs import HOUSING_SHARE, PairRules, Pairs, overlap_levels, unexplained_pairs
from pinproof.collision.placed import EVERY, FIRST_ONLY, NEAREST, NOT_FINITE, Placed
from pinproof.collision.scene import Obstacle, Scene
from pinproof.collision.still import Still, judge_still
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.spatial import finite

__all__ = ["CollisionChecker"]

Array = npt.NDArray[np.float64]

DOUBLE = np.dtype(np.float64)

CHUNK = 64
"""Configurations that a thread takes at a time."""


class CollisionChecker:
    """Checks configurations of an arm against itself and a scene.

    ``q`` is always the arm's own joints; joints outside the arm stay where the arm holds them. Two bodies are in
    contact where their distance is the margin or less, and where it cannot be told from that: "free" is only said of
    what is proven farther apart. No answer depends on what was asked before. May be used from several threads: each has
    its own workspace.

    Tasks have stages, in which other things are held and other contacts are meant: :meth:`with_scene`,
    :meth:`with_attached`, :meth:`with_held`, :meth:`allowing` and :meth:`with_margin` give checkers that differ in
    that, and share the bodies.

    Parameters
    ----------
    arm
        The arm.
    scene
        What stands around it.
    margin
        Metres that must stay between any two checked bodies.
    margins
        The same for single pairs of names (links, attached objects, obstacles), in place of ``margin``.
    link_meshes
        ``"hull"``: the links' meshes are collided with as their convex hulls, which hold all of the mesh. ``"mesh"``:
        as their triangles, solid where watertight, else as their hull. ``"surface"``: as their triangles, which where
        not watertight are hollow: being wholly inside is not seen. ``"decomposed"``: as several hulls, which together
        hold all of it. One word for all links, or a mapping of links to words; ``"*"`` is the others. Pairs of links
        that an SRDF disables without a reason are checked by several hulls each where one would be coarse.
    attached
        Objects that move with the tcp, such as a gripper; their pose is ``tcp_from_object``.
    allowed
        Pairs of names (links, attached objects, obstacles) that may touch.
    trust_disabled
        Leave out every pair that the SRDF or the scene's matrix disables. Without it these pairs are checked, unless
        they touch in nearly all sampled configurations or no joint of the arm moves them against each other.
    housing
        Metres. Links on both sides of links without geometry are left out if they touch in nearly all sampled
        configurations and the revolute joints between them lie along no more than this, summed from joint to joint: a
        spherical wrist. By default 5 % of the robot's size (its largest sum of lengths from the root to a link).

    Raises
    ------
    MeshError
        If a collision mesh is missing or has no hull.
    UnknownNameError
        If an allowed contact or a margin names nothing that is there.
    InputError
        If a margin is negative or not finite, or two bodies share a name.
    """

    def __init__(
        self,
        arm: Arm,
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
        urdf = arm.robot.urdf
        self._arm, self._shape = arm, (arm.dof,)
        self._link_bodies = LinkBodies(urdf.collisions, meshes_of(urdf.links, link_meshes))
        unexplained = () if trust_disabled else unexplained_pairs(arm.robot)
        length = HOUSING_SHARE * arm.robot.size if housing is None else checked_margin("housing", housing)
        self._rules = PairRules(Overlaps(arm.robot, self._link_bodies), length, trust_disabled)
        self._levels: Levels = {
            **dict.fromkeys(unexplained, DECOMPOSED),
            **overlap_levels(self._link_bodies.of({}), arm, self._rules),
        }
        self._margins, self._moved = Margins(margin, margins or {}), 0.0
        self._still: Still | None = None
        self._geometry_model: Any = None
        self._known: Known = {}  # obstacles by where they lie in memory
        self._assemble(scene or Scene(), tuple(attached), tuple((str(a), str(b)) for a, b in allowed))

    # -- questions ----------------------------------------------------------------------------------------------------

    def is_free(self, q: npt.ArrayLike) -> bool:
        """Whether every checked pair is proven farther apart than its margin at q (n,). Limits are not looked at."""
        if type(q) is np.ndarray and q.dtype is DOUBLE and q.shape == self._shape:
            return self.is_free_unchecked(q)
        return self.is_free_unchecked(self.arm.configuration(q))

    def is_free_unchecked(self, q: Array) -> bool:
        """:meth:`is_free` for loops that made q (n,) themselves."""
        space = self.workspace
        left = space.judge(q)
        if left == 0:
            return not (self._still or self.still).touching
        if left == NOT_FINITE:
            self.arm.configuration(q)  # says what is wrong with it
        if left < 0:
            return False
        return not self.still.touching and not any(space.touches(k) for k in space.left_to_coal(left))

    def is_free_batch(self, Q: npt.ArrayLike, *, threads: int = 1) -> npt.NDArray[np.bool_]:
        """(N,) :meth:`is_free` at each row of Q (N, n); the same for any number of ``threads``."""
        many, rows = self._batch(Q, FIRST_ONLY, threads)
        free = (rows[:, 0] == 0) & (not self.still.touching)
        for i in np.flatnonzero(free & (rows[:, 1] > 0)):
            free[i] = self.is_free_unchecked(many[i])
        return np.asarray(free)

    def check(self, q: npt.ArrayLike) -> CheckResult:
        """Every contact at q (n,), the deepest first, with names, distances, points and normals."""
        space = self.workspace
        touching = (*self.still.touching, *space.touching(self.arm.configuration(q)))
        found = [self.contact(k, measured) for k, measured in touching]
        return CheckResult(tuple(sorted(found, key=lambda contact: contact.distance)))

    def clearance(self, q: npt.ArrayLike) -> float:
        """The smallest signed distance (m) over all checked pairs at q (n,); inf if there is none to check.

        Where bodies are apart it is a lower bound up to :attr:`rounding`, within 1e-9 m of the distance; where they
        penetrate, the depth as coal knows it, below 0.
        """
        space = self.workspace
        near = space.near(self.arm.configuration(q), NEAREST)
        judged = (space.measure(k).distance for k in (*near.contacts, *near.left_to_coal))
        return min((near.lower, self.still.lower, *judged))

    def clearance_batch(self, Q: npt.ArrayLike, *, threads: int = 1) -> Array:
        """(N,) :meth:`clearance` at each row of Q (N, n); the same for any number of ``threads``."""
        many, rows = self._batch(Q, NEAREST, threads)
        out = np.minimum(rows[:, 2], self.still.lower)
        for i in np.flatnonzero(rows[:, :2].any(axis=1)):
            out[i] = self.clearance(many[i])
        return np.asarray(out)

    # -- checkers for other stages of a task --------------------------------------------------------------------------

    def with_margin(
        self, margin: float | None = None, margins: Mapping[tuple[str, str], float] | None = None
    ) -> CollisionChecker:
        """The same bodies and pairs under another common margin, or other margins of single pairs (m)."""
        other = copy(self)
        common = self.margin if margin is None else margin
        other._set_margins(self._margins.under(common) if margins is None else Margins(common, margins))
        return other

    def padded(self, by: float) -> CollisionChecker:
        """The same, with every margin larger by ``by`` metres, those of single pairs too."""
        other = copy(self)
        other._set_margins(self._margins.padded(by))
        return other

    def moved_obstacles(self, by: float) -> CollisionChecker:
        """The same, but every obstacle may stand elsewhere by up to ``by`` metres: its margins are that much larger."""
        other = copy(self)
        other._moved = self._moved + checked_margin("by", by)
        other._set_margins(self._margins)
        return other

    def with_scene(self, scene: Scene) -> CollisionChecker:
        """The same arm, with what it holds, in another scene; single margins of obstacles that are gone are dropped."""
        return self._derived(scene, self.attached, self._allowed)

    def with_attached(self, *objects: Obstacle) -> CollisionChecker:
        """The same with more objects that move with the tcp, each in place of one of its name, if there is one.

        Of a grasped one, take the obstacle out of the scene.
        """
        new = {thing.name for thing in objects}
        kept = (thing for thing in self.attached if thing.name not in new)
        return self._derived(self.scene, (*kept, *objects), self._allowed)

    def with_held(self, held: Mapping[str, float]) -> CollisionChecker:
        """The same with joints outside the arm held elsewhere (rad or m by name), such as the robot's own fingers."""
        arm = self.arm.with_held(held)
        if arm is self.arm:
            return self
        other = copy(self)
        other._arm = arm
        other._assemble(self.scene, self.attached, self._allowed)
        return other

    def allowing(self, *pairs: Sequence[str]) -> CollisionChecker:
        """The same with more pairs of names that may touch: a gripper and what it grasps, a part and its support.

        A certificate lists them as not checked. So allow a contact for the stage that means it, and for no other. For a
        part and the support it is lifted off, ``certify(..., parting=)`` allows less and proves more: that they part.
        """
        more = tuple((str(a), str(b)) for a, b in pairs)
        made = leave_out(self._assembly, more)
        if made is None:
            return self._derived(self.scene, self.attached, (*self._allowed, *more))
        other = copy(self)
        other._take(made, self.scene, self.attached, (*self._allowed, *more))
        return other

    def without_pairs(self, pairs: Iterable[int]) -> CollisionChecker:
        """The same, but the pairs of bodies with these indices in :attr:`pairs` are not checked.

        Pairs of bodies, where :meth:`allowing` leaves out all pairs of two owners. It is meant for proofs that show the
        omitted pairs apart by other means: :attr:`excluded` does not list them, and checkers derived from this one by a
        new scene, attached object or allowed contact check them again.
        """
        dropped = set(pairs)
        kept = np.array([k for k in range(len(self.pairs)) if k not in dropped], dtype=int)
        other = copy(self)
        other._take(keep_pairs(self._assembly, kept), self.scene, self.attached, self._allowed)
        return other

    def with_obstacle_bodies(self, bodies: Sequence[Body], pairs: Iterable[tuple[int, int]]) -> CollisionChecker:
        """The same with more bodies of obstacles of the scene, and more pairs of indices of bodies checked.

        The new bodies follow those in :attr:`bodies`. As for :meth:`without_pairs`, derived checkers do not have them.
        """
        other = copy(self)
        made = add_obstacle_bodies(self.arm, self._assembly, bodies, list(pairs))
        other._take(made, self.scene, self.attached, self._allowed)
        return other

    def finer_at(self, q: npt.ArrayLike) -> CollisionChecker:
        """The same, but pairs that touch at q (n,) by coarse bodies alone are judged by closer ones, as far as needed.

        Those of the links whose exact meshes are farther apart than the margin at q, though their bodies as told are
        not: by several hulls, or by the meshes themselves where these touch, too. Whatever is derived from it keeps
        that. :attr:`finer` lists them, and so do certificates. This checker itself where nothing touches at q, or
        whatever does is truly in contact.
        """
        at = self.arm.configuration(q)

        def touching(levels: Levels) -> set[frozenset[str]]:
            judge = self if levels == self._levels else self._on(levels)
            owners = (frozenset(judge._owners(k)) for k in judge._in_contact(at))
            return {pair for pair in owners if any(map(self._link_bodies.can_be_finer, pair))}

        levels = finer_levels(touching, self._levels)
        return self if levels == self._levels else self._on(levels)

    def _on(self, levels: Levels) -> CollisionChecker:
        other = copy(self)
        other._levels = levels
        other._assemble(self.scene, self.attached, self._allowed)
        return other

    def _derived(
        self, scene: Scene, attached: tuple[Obstacle, ...], allowed: tuple[tuple[str, str], ...]
    ) -> CollisionChecker:
        other = copy(self)
        gone = {*self.scene.names, *(o.name for o in self.attached)} - {*scene.names, *(o.name for o in attached)}
        allowed = tuple(pair for pair in allowed if not gone & set(pair))
        other._margins = self._margins.without(gone)
        other._assemble(scene, attached, allowed)
        return other

    # -- what is known of it ------------------------------------------------------------------------------------------

    @property
    def arm(self) -> Arm:
        """The arm; :meth:`with_held` makes a checker in which its other joints are held elsewhere."""
        return self._arm

    @property
    def scene(self) -> Scene:
        """The scene that is checked; :meth:`with_scene` makes a checker of another one."""
        return self._scene

    @property
    def attached(self) -> tuple[Obstacle, ...]:
        """The objects that move with the tcp; :meth:`with_attached` makes a checker with more of them."""
        return self._attached

    @property
    def margin(self) -> float:
        """The common margin (m); :meth:`with_margin` makes a checker with another one."""
        return self._margins.common

    @property
    def obstacles_and_links(self) -> tuple[str, ...]:
        """The owners of all bodies: links with geometry, attached objects, obstacles."""
        return tuple(dict.fromkeys(body.owner for body in self.bodies))

    @property
    def hollow(self) -> tuple[str, ...]:
        """Exact meshes that are not watertight: being wholly inside one of them is not seen as contact."""
        return tuple(b.name for b in self.bodies if b.solid is not None and not b.solid.watertight)

    @property
    def still(self) -> Still:
        """The verdict on the pairs between which no joint moves; found once, by whoever asks first."""
        if self._still is None:
            from pinproof.kernels.world import flatten

            world = self._margined
            space = Placed(self, *flatten(world._replace(own=self.still_pairs, tree=world.tree[:0])))
            self._still = judge_still(space, np.zeros(self.arm.dof))
        return self._still

    @property
    def geometry_model(self) -> Any:
        """Pinocchio's model of all bodies and of the pairs that are checked, made when first asked for."""
        if self._geometry_model is None:
            self._geometry_model = geometry_model(self.arm.model, self.bodies, self.pairs)
        return self._geometry_model

    def fingerprint(self) -> str:
        """A hash of all that a verdict depends on: kinematics, held joints, geometry, placements, pairs, margins."""
        digest = hashlib.sha256()
        words = (self.arm.robot.urdf.kinematics, self.arm.base, self.arm.tcp, self.arm.joint_names, self.arm.held)
        digest.update(repr((words, self._rules[1:], self._link_bodies, self.excluded, self.finer)).encode())
        digest.update(self.margins.tobytes() + repr(self.margin).encode())
        for body in self.bodies:
            digest.update(body.content())
        return digest.hexdigest()

    def placed(self, q: Array) -> Placed:
        """Place every body at q (n,), unchecked, in the workspace of this thread: for loops that made q themselves."""
        space = self.workspace
        space.move(q)
        return space

    def contact(self, k: int, measured: Distance) -> Contact:
        """The contact of pair k."""
        return Contact(self._owners(k), measured.distance, measured.points, measured.normal)

    def _owners(self, k: int) -> tuple[str, str]:
        i, j = self.pairs[k]
        return self.bodies[i].owner, self.bodies[j].owner

    def _in_contact(self, q: Array) -> list[int]:
        """The pairs in contact at q (n,), finite."""
        space = self.workspace
        near = space.near(q, EVERY)
        still = [k for k, _ in self.still.touching]
        return [*still, *near.contacts, *(k for k in near.left_to_coal if space.touches(k))]

    # -- how it is made -----------------------------------------------------------------------------------------------

    def _assemble(self, scene: Scene, attached: tuple[Obstacle, ...], allowed: tuple[tuple[str, str], ...]) -> None:
        """Everything that follows from the links, the scene, what is attached, what is allowed, and the margins."""
        made = assemble(
            self.arm, self._link_bodies.of(self._levels), scene, attached, self._rules,
            levels=self._levels, allowed=allowed, known=self._known,
        )  # fmt: skip
        self._take(made, scene, attached, allowed)

    def _take(
        self, made: Assembly, scene: Scene, attached: tuple[Obstacle, ...], allowed: tuple[tuple[str, str], ...]
    ) -> None:
        self._scene, self._attached, self._allowed = scene, attached, allowed
        self.bodies, self.pairs, self.rounding = made.bodies, tuple(made.pairs.checked), made.rounding
        self.excluded, self.finer = tuple(made.pairs.excluded), tuple(made.pairs.finer)
        self._world, self.at, self.still_pairs, self.convex = made.world, made.at, made.still, made.convex
        self._known, self._geometry_model = made.known, None
        self._set_margins(self._margins)

    @property
    def _assembly(self) -> Assembly:
        pairs = Pairs(list(self.pairs), list(self.excluded), list(self.finer))
        return Assembly(
            self.bodies, pairs, self.rounding, self._world, self.at, self.still_pairs, self.convex, self._known
        )

    def _set_margins(self, margins: Margins) -> None:
        """The margins of all pairs, larger where obstacles may be moved, and what follows from them."""
        from pinproof.collision.packed import with_margins
        from pinproof.kernels.world import flatten

        self._margins = margins
        owners = map(self._owners, range(len(self.pairs)))
        self.margins = margins.of(owners, len(self.pairs), self.obstacles_and_links)
        if self._moved:
            self.margins += self._moved * np.array([self.bodies[j].link is None for _, j in self.pairs])
        self.margins.setflags(write=False)
        self._margined = with_margins(self._world, self.margins)
        self.numbers, self.indices = flatten(self._margined)
        self._still = None
        self._threads = threading.local()

    @property
    def workspace(self) -> Placed:
        """The workspace of this thread."""
        try:
            return self._threads.space
        except AttributeError:
            space = self._threads.space = Placed(self, self.numbers, self.indices)
            return space

    def _batch(self, Q: npt.ArrayLike, question: int, threads: int) -> tuple[Array, Array]:
        """Q (N, n) checked, and the answers (N, 5) of :func:`pinproof.kernels.near.near`."""
        many = finite("Q", Q, (None, self.arm.dof))
        if threads < 1:
            raise InputError(f"threads = {threads}; it is 1 or more")
        rows = np.empty((len(many), 5))
        starts = range(0, len(many), CHUNK)
        if threads == 1:
            self.workspace.judge_many(many, question, rows)
            return many, rows
        with ThreadPoolExecutor(threads) as pool:
            for done in [
                pool.submit(lambda i: self.workspace.judge_many(many[i : i + CHUNK], question, rows[i : i + CHUNK]), i)
                for i in starts
            ]:
                done.result()
        return many, rows

    def __copy__(self) -> CollisionChecker:
        """With all that is known of the obstacles, which a pickle leaves out."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other

    def __getstate__(self) -> dict[str, Any]:
        left_out = ("_threads", "_known")
        return {name: value for name, value in self.__dict__.items() if name not in left_out}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._known, self._threads = {}, threading.local()
