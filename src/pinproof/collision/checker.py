"""Is a configuration free of contact? Self and environment, by coal over Pinocchio's placements."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.bodies import Body, shape_body
from pinproof.collision.contact import CheckResult, Contact
from pinproof.collision.links import LinkMeshes, detail_bodies, link_bodies, meshes_of
from pinproof.collision.pairs import choose_pairs, unexplained_pairs
from pinproof.collision.placed import GJK_SLACK, Placed
from pinproof.collision.scene import Obstacle, Scene
from pinproof.errors import InputError
from pinproof.model import Arm

__all__ = ["CollisionChecker"]

Array = npt.NDArray[np.float64]


class CollisionChecker:
    """Checks configurations of an arm against itself and a scene.

    ``q`` is always the arm's own joints; joints outside the arm stay where the arm holds them. May be used from several
    threads: each has its own workspace.

    Parameters
    ----------
    arm
        The arm.
    scene
        What stands around it.
    margin
        Metres that must stay between any two checked bodies; contact is a distance of ``margin`` or less.
    link_meshes
        ``"hull"``: the links' meshes are collided with as their convex hulls, which hold all of the mesh. ``"mesh"``:
        as their triangles, solid where watertight. ``"decomposed"``: as several hulls, which together hold all of it.
        One word for all links, or a mapping of links to words; ``"*"`` is the others. Pairs of links that an SRDF
        disables without a reason are checked by several hulls each where one would be coarse.
    attached
        Objects that move with the tcp, such as a gripper; their pose is ``tcp_from_object``.
    allowed
        Pairs of names (links, attached objects, obstacles) that may touch.
    trust_disabled
        Leave out every pair that the SRDF or the scene's matrix disables, not only those that touch by build: what is
        marked ``Never`` or has no reason was sampled at best, so this gives up the proof for it.

    Raises
    ------
    MeshError
        If a collision mesh is missing or has no hull.
    UnknownNameError
        If an allowed contact names nothing that is there.
    InputError
        If the margin is negative or not finite, or two bodies share a name.
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene | None = None,
        *,
        margin: float = 0.0,
        link_meshes: LinkMeshes | Mapping[str, LinkMeshes] = "hull",
        attached: Sequence[Obstacle] = (),
        allowed: Iterable[Sequence[str]] = (),
        trust_disabled: bool = False,
    ) -> None:
        if not np.isfinite(margin) or margin < 0:
            raise InputError(f"margin = {margin}; it is a distance in metres, 0 or more")
        self.arm, self.scene, self.margin = arm, scene or Scene(), float(margin)
        self.attached = tuple(attached)
        urdf = arm.robot.urdf
        meshes = meshes_of(urdf.links, link_meshes)
        unexplained = () if trust_disabled else unexplained_pairs(arm.robot)
        coarse = {link for pair in unexplained for link in pair if meshes.get(link) == "hull"}
        self.bodies: tuple[Body, ...] = (
            *(body for geometry in urdf.collisions for body in link_bodies(geometry, meshes[geometry.link])),
            *(body for geometry in urdf.collisions if geometry.link in coarse for body in detail_bodies(geometry)),
            *(shape_body(o.name, o.name, arm.tcp, o.shape, o.pose) for o in self.attached),
            *(shape_body(o.name, o.name, None, o.shape, o.pose) for o in self.scene.obstacles),
        )
        _check_names(self.bodies, urdf.links)
        self.pairs, self.excluded = choose_pairs(
            self.bodies, arm.robot, self.scene, allowed=allowed, trust_disabled=trust_disabled
        )
        self.geometry_model = _geometry_model(arm.model, self.bodies, self.pairs)
        self.body_joints = np.array([o.parentJoint for o in self.geometry_model.geometryObjects], dtype=np.int64)
        solid = [body.solid is not None for body in self.bodies]
        self._exact_pairs = [k for k, (i, j) in enumerate(self.pairs) if solid[i] or solid[j]]
        self._settings = (sorted(meshes.items()), trust_disabled, self.excluded)
        self._threads = threading.local()

    def is_free(self, q: npt.ArrayLike) -> bool:
        """Whether every checked pair is farther apart than the margin at q (n,). Limits are not looked at."""
        return self.is_free_unchecked(self.arm.configuration(q))

    def is_free_unchecked(self, q: Array) -> bool:
        """:meth:`is_free` for loops that made q (n,) themselves."""
        space = self.placed(q)
        return not space.any_contact() and not any(space.one_inside_other(k) for k in self._exact_pairs)

    def check(self, q: npt.ArrayLike) -> CheckResult:
        """Every contact at q (n,), with names, distances and points."""
        space = self.placed(self.arm.configuration(q))
        found = []
        for k in range(len(self.pairs)):
            distance = space.distance(k)
            if distance <= self.margin + GJK_SLACK:
                found.append(self.contact(space, k, distance))
        return CheckResult(tuple(sorted(found, key=lambda contact: contact.distance)))

    def clearance(self, q: npt.ArrayLike) -> float:
        """The smallest signed distance (m) over all checked pairs at q (n,); inf if there is none to check."""
        space = self.placed(self.arm.configuration(q))
        return min((space.distance(k) for k in range(len(self.pairs))), default=np.inf)

    @property
    def obstacles_and_links(self) -> tuple[str, ...]:
        """The owners of all bodies: links with geometry, attached objects, obstacles."""
        return tuple(dict.fromkeys(body.owner for body in self.bodies))

    @property
    def hollow(self) -> tuple[str, ...]:
        """Exact meshes that are not watertight: being wholly inside one of them is not seen as contact."""
        return tuple(b.name for b in self.bodies if b.solid is not None and not b.solid.watertight)

    def fingerprint(self) -> str:
        """A hash of all that a verdict depends on: kinematics, held joints, geometry, placements, pairs, margin."""
        digest = hashlib.sha256()
        words = (self.arm.robot.urdf.kinematics, self.arm.base, self.arm.tcp, self.arm.joint_names, self.arm.held)
        digest.update(repr((words, self.margin, self._settings)).encode())
        for body in self.bodies:
            digest.update(body.content())
        return digest.hexdigest()

    def placed(self, q: Array) -> Placed:
        """Place every body at q (n,), unchecked, in the workspace of this thread: for loops that made q themselves."""
        space: Placed | None = getattr(self._threads, "space", None)
        if space is None:
            space = self._threads.space = Placed(self)
        space.move(q)
        return space

    def contact(self, space: Placed, k: int, distance: float) -> Contact:
        """The contact of pair k, whose distance was just asked for."""
        i, j = self.pairs[k]
        return Contact((self.bodies[i].owner, self.bodies[j].owner), distance, space.points(k))

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_threads"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._threads = threading.local()


def _geometry_model(model: Any, bodies: Sequence[Body], pairs: Sequence[tuple[int, int]]) -> Any:
    geometry_model = pin.GeometryModel()
    for body in bodies:
        if body.link is None:
            frame, joint, placement = 0, 0, body.link_from_body
        else:
            frame = model.getFrameId(body.link, pin.FrameType.BODY)
            joint = model.frames[frame].parentJoint
            placement = model.frames[frame].placement * body.link_from_body
        geometry_model.addGeometryObject(pin.GeometryObject(body.name, joint, frame, placement, body.geometry))
    for i, j in pairs:
        geometry_model.addCollisionPair(pin.CollisionPair(i, j))
    return geometry_model


def _check_names(bodies: Sequence[Body], links: Sequence[str]) -> None:
    seen: set[str] = set()
    for body in bodies:
        if body.name in seen or (body.owner != body.link and body.name in links):
            raise InputError(f"the name {body.name!r} stands for two bodies; rename the obstacle or attached object")
        seen.add(body.name)
