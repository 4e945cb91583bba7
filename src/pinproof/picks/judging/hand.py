"""How deep the bodies of a hand are in the part: at the grasp, and along the lines to it and from it.

The depth of a body is the length of the shortest displacement after which it is outside of the part
(:mod:`pinproof.collision.checking.penetration`). At the grasp it is measured. Along a line it is limited by a proof:
the body is displaced by the allowed depth, in the direction that leaves the largest clearance at the grasp, and the
displaced body is proven to be free of the part over the whole motion. Open fingers must not touch the part at all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pinproof.collision import Certificate, CollisionChecker, Cylinder, Mesh, Mover, Obstacle, Scene, Shape, certify
from pinproof.collision.checking.coal_checks import GJK_SLACK
from pinproof.collision.checking.line_surface import TOUCH, LineSurface, body_distance
from pinproof.collision.checking.links import KINDS
from pinproof.collision.checking.penetration import penetration
from pinproof.description import LinkGeometry
from pinproof.description.meshes import resolved
from pinproof.description.urdf import moved_by
from pinproof.model import Arm
from pinproof.motion import Curve
from pinproof.picks.input.pick import Picks, SuctionCup
from pinproof.picks.judging.grip import HeldPart, MovingFinger
from pinproof.spatial import SE3, Array, pose, translated

DISC = 1e-5
"""Metres: the thickness of the disc that represents the face of a suction cup."""

AROUND = 64
"""Number of directions in which it is measured whether a body is within the rim of a cup."""

SAMPLES = 5
"""Number of points of a motion at which the depth of a body is measured for a reason, besides that of the contact."""

FACE = "the face of the cup"
"""The name of the face of the cup."""


@dataclass(frozen=True, eq=False)
class HandBody:
    """A body that does not move relative to the tcp.

    Parameters
    ----------
    name
        Its link or attached body.
    surface, tcp_from_body
        Its surface and its pose.
    solid
        The same as an obstacle with a pose in the tcp frame, for certificates.
    limit
        Metres: how deep it may be in the part.
    axis
        (3,) for the face of a cup: the only direction, in the tcp frame, in which the depth is measured.
    """

    name: str
    surface: LineSurface
    tcp_from_body: SE3
    solid: Obstacle
    limit: float
    axis: Array | None = None


@dataclass(frozen=True)
class BodyDepth:
    """How deep a body of the hand is in the part.

    Parameters
    ----------
    body
        The link or attached body.
    depth
        Metres: an upper bound of the length of the shortest displacement after which it is outside of the part.
    limit
        Metres: the largest allowed depth.
    least
        Metres: a lower bound of the depth.
    displacement
        (3,) metres in the tcp frame: a displacement of the length ``limit`` or zero that leaves the largest clearance.
    clearance
        Metres between the displaced body and the part.
    """

    body: str
    depth: float
    limit: float
    least: float
    displacement: tuple[float, float, float]
    clearance: float

    @property
    def within(self) -> bool:
        """Whether it is proven that the body is in the part by no more than the limit, up to 0.01 mm."""
        return self.clearance > GJK_SLACK

    def words(self, part: str, where: str = "is") -> str:
        """The depth and the limit."""
        limit = f"at most {self.limit * 1e3:.2f} mm is allowed"
        if self.body == FACE:
            return f"{part} protrudes {self.depth * 1e3:.2f} mm into the cup; {limit}"
        return f"{self.body} {where} {self.depth * 1e3:.2f} mm inside {part}; {limit}"


def hand_bodies(arm: Arm, shared: Picks, palm: Sequence[str]) -> tuple[HandBody, ...]:
    """The bodies of the tool and the rigidly connected links, those of the ``palm``, and the face of the cup."""
    depth, urdf, joints = shared.grip_limits.depth, arm.robot.urdf, (*arm.joint_names, *arm.followers)
    found = []
    face: HandBody | None = None
    if (cup := shared.cup) is not None:
        disc = Obstacle(FACE, Cylinder(cup.radius, DISC), shared.tip * pose((0, 0, -DISC / 2)))
        surface = LineSurface.of_obstacle(disc)
        face = HandBody(FACE, surface, disc.pose, disc, cup.highest, -np.array(shared.tip.rotation[:, 2]))
        found.append(face)
    solids = [(body.name, body) for body in shared.tool]
    tcp, home = arm.forward_kinematics(arm.home), arm.home
    for geometry in urdf.collisions:
        rigid = moved_by(urdf, geometry.link, joints) == moved_by(urdf, arm.tcp, joints)
        if geometry.link in palm and rigid:
            at = tcp.actInv(arm.frame_placement(home, geometry.link)) * SE3(np.array(geometry.origin))
            solids.append((geometry.link, Obstacle(f"{geometry.name} of the hand", _shape(geometry), at)))
    for name, solid in solids:
        surface, limit = LineSurface.of_obstacle(solid), depth
        if face is not None and cup is not None and _is_lip(surface, solid.pose, face, cup):
            limit = max(depth, cup.gap, cup.highest)
        found.append(HandBody(name, surface, solid.pose, solid, limit))
    return tuple(found)


def _shape(geometry: LinkGeometry) -> Shape:
    """The shape of a link's geometry, a mesh as the solid that it is."""
    if geometry.mesh is None:
        return KINDS[geometry.kind](*geometry.size)
    return Mesh(resolved(geometry.mesh, geometry.link), geometry.size)  # type: ignore[arg-type]  # three


def _is_lip(surface: LineSurface, at: SE3, face: HandBody, cup: SuctionCup) -> bool:
    """Whether a body is the cup: it reaches its face and is within the cylinder of its rim, so that it is compliant."""
    if body_distance(surface, at, face.surface, face.tcp_from_body) > TOUCH:
        return False
    turns = np.arange(AROUND) * 2 * np.pi / AROUND
    across = np.stack([np.cos(turns), np.sin(turns), np.zeros(AROUND)], axis=1) @ face.tcp_from_body.rotation.T
    reaches = surface.reaches(across @ at.rotation) + across @ (at.translation - face.tcp_from_body.translation)
    return bool(reaches.max() <= cup.radius + TOUCH)


def depth_of(body: HandBody, part: HeldPart, directions: Array) -> BodyDepth:
    """How deep a body is in the part; ``directions`` (K, 3) in the tcp frame are tried first to move it out."""
    if body.axis is not None:
        return _depth(body.name, body.surface, body.tcp_from_body, body.limit, part, body.axis[None], only=True)
    return _depth(body.name, body.surface, body.tcp_from_body, body.limit, part, directions)


def _depth(
    name: str, surface: LineSurface, at: SE3, limit: float, part: HeldPart, directions: Array, *, only: bool = False
) -> BodyDepth:
    found = penetration(surface, at, part.surface, part.pose, directions, limit + TOUCH, only=only)
    x, y, z = found.by.tolist()
    return BodyDepth(name, found.depth, limit, found.least, (x, y, z), found.clearance)


def depths_at_grasp(
    palm: Sequence[HandBody], fingers: Sequence[MovingFinger], part: HeldPart, back: Array, limit: float
) -> tuple[BodyDepth, ...]:
    """The depths of the bodies of the palm, then those of the closed fingers, limited by ``limit`` (m).

    ``back`` (3,) is the direction opposite to the approach, in the tcp frame.
    """
    found = [depth_of(body, part, back[None]) for body in palm]
    for finger in fingers:
        out = np.array([-finger.direction, back])
        found += [_depth(finger.name, own, finger.closed * at, limit, part, out) for own, at in finger.surfaces]
    return tuple(found)


class OpenHand:
    """The open hand and a part that lies still or moves on a belt, without anything else.

    ``outside`` is the checker before the grasp, ``palm`` are the bodies of the hand that do not move while it closes,
    with their ``depths`` at the grasp, and ``hand`` the names of all bodies and links that may touch the part.
    """

    def __init__(
        self,
        outside: CollisionChecker,
        part: Obstacle,
        surface: LineSurface,
        palm: Sequence[HandBody],
        depths: Sequence[BodyDepth],
        hand: Sequence[str],
    ) -> None:
        self._outside, self.part, self._surface = outside, part, surface
        self._palm, self._depths, self._hand = tuple(palm), tuple(depths), tuple(hand)
        self._padding = 0.0

    def padded(self, by: float) -> OpenHand:
        """The same for a part that may be displaced by up to ``by`` metres, which only concerns the open fingers."""
        other = copy(self)
        other._padding = by
        return other

    @cached_property
    def _coarse(self) -> CollisionChecker:
        return self._checker()

    @cached_property
    def _exact(self) -> CollisionChecker:
        return self._checker(exact=True)

    def _checker(self, finer_at: Array | None = None, *, exact: bool = False) -> CollisionChecker:
        """The checker of the displaced palm and the open fingers against the part, with finer links or exact meshes."""
        solids, part = [each.solid for each in self._palm], self.part
        if exact:
            solids = [_exactly(each.solid, each.surface) for each in self._palm]
            part = _exactly(part, self._surface)
        placed = [
            replace(solid, pose=translated(solid.pose, found.displacement))
            for solid, found in zip(solids, self._depths, strict=False)  # the depths of closed fingers follow
        ]
        replaced = {solid.name for solid in placed}
        attached = (*(each for each in self._outside.attached if each.name not in replaced), *placed)
        checker = self._outside.on_group(self._outside.arm, Scene((part,)), attached).with_margin(0.0)
        if finer_at is not None:
            checker = checker.finer_at(finer_at)
        # the displaced copies of links of the palm replace them
        own = replaced | (set(self._hand) - {body.name for body in self._palm})
        owners = [{checker.bodies[k].owner for k in pair} for pair in checker.pairs]
        return checker.without_pairs(k for k, pair in enumerate(owners) if not (part.name in pair and own & pair))

    def _suited(self, grasp: Array | None) -> list[CollisionChecker]:
        """The coarsest checker that is free at the grasp; both if the configuration is not known."""
        if grasp is None:
            return [self._coarse, self._exact]
        if self._coarse.is_free(grasp):
            return [self._coarse]
        finer = self._checker(grasp)
        return [finer if finer.is_free(grasp) else self._checker(grasp, exact=True)]

    def prove(
        self,
        curve: Curve,
        grasp: Array | None,
        *,
        deviation: float = 0.0,
        movers: Sequence[Mover] = (),
        part_at: Callable[[float], SE3] | None = None,
        closing: bool = False,
    ) -> EntryFailure | None:
        """Why the hand may enter the part by more than is allowed on a motion; None if it is proven not to.

        ``grasp`` (n,) is the configuration at the grasp, None if the part moves there. The ``deviation`` (rad or m) of
        the joints and the tolerance of the movers only concern the open fingers: the palm may touch the part, so no
        proof with them is possible. ``part_at`` is the pose of the part by the parameter of the curve. While the
        fingers are ``closing``, they may touch the part.
        """
        still = [replace(mover, tolerance=0.0) for mover in movers]
        wider = bool(deviation or self._padding or any(mover.tolerance for mover in movers))
        failed = list[Certificate]()
        for checker in self._suited(grasp):
            there, palm = checker.obstacles_and_links, {body.solid.name for body in self._palm}
            pairs = [(name, self.part.name) for name in there if name in palm or name in self._hand]
            fingers = [pair for pair in pairs if pair[0] not in palm]
            if closing:
                checker = checker.allowing(*fingers)
            failed.append(certify(curve, checker, movers=still, limits=None))
            if failed[-1].free and wider and fingers and not closing:
                alone = checker.allowing(*(pair for pair in pairs if pair[0] in palm)).padded(self._padding)
                failed.append(certify(curve, alone, joint_tolerance=deviation, movers=movers, limits=None))
            if failed[-1].free:
                return None
        return self._failure(curve, failed[-1], part_at or (lambda _: self.part.pose))

    def _failure(self, curve: Curve, proof: Certificate, part_at: Callable[[float], SE3]) -> EntryFailure:
        """What enters the part, with its largest depth at some points of the curve."""
        met = proof.first_contact or proof.undecided
        body = next((each for each in self._palm if met is not None and each.solid.name in met.bodies), None)
        if body is None:
            return EntryFailure(proof, f"the open fingers collide with the object: {proof.message}")
        arm, knots = self._outside.arm, curve.bezier()[0]
        times = np.linspace(knots[0], knots[-1], SAMPLES).tolist()
        if proof.first_contact is not None:
            times.append(proof.first_contact.time)
        deepest: BodyDepth | None = None
        for time in times:
            root_from_tcp = arm.root_from_base * arm.forward_kinematics(np.asarray(curve(time)))
            part = HeldPart(self._surface, root_from_tcp.actInv(part_at(time)))
            found = depth_of(body, part, np.empty((0, 3)))
            deepest = found if deepest is None or found.depth > deepest.depth else deepest
        if deepest is None or deepest.depth <= body.limit:
            limit = f"{body.name} is not proven to be at most {body.limit * 1e3:.2f} mm inside {self.part.name}"
            return EntryFailure(proof, f"{limit}: {proof.message}")
        return EntryFailure(proof, deepest.words(self.part.name, "would be"), deepest.depth)


class EntryFailure(NamedTuple):
    """A motion on which the hand may enter the part: the failed proof, the reason, and the depth (m) if measured."""

    proof: Certificate
    reason: str
    depth: float = np.nan


def _exactly(solid: Obstacle, surface: LineSurface) -> Obstacle:
    """The obstacle with a mesh of its own triangles, if it is represented by a hull or by convex pieces otherwise."""
    own = (surface.surface or surface.body).solid
    if not isinstance(solid.shape, Mesh) or own is None:
        return solid
    return replace(solid, shape=replace(solid.shape, hull=False, hollow=not own.watertight))
