"""How deep the bodies of a hand are in the part: at the grasp, and along the lines to it and from it.

The depth of a body is the length of the shortest displacement after which it is outside of the part
(:mod:`pinproof.collision.checking.penetration`). At the grasp it is measured. Along a line it is limited by a proof:
the body is displaced by the allowed depth, in the direction that leaves the largest clearance at the grasp, and the
displaced body is proven to be free of the part over the whole motion. Open fingers must not touch the part at all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pinproof.collision import (
    GJK_SLACK,
    KINDS,
    MOST_ADVANCES,
    TOUCH,
    Certificate,
    CollisionChecker,
    Cylinder,
    LineSurface,
    MeasureByCoal,
    Mesh,
    Mover,
    Obstacle,
    Scene,
    Shape,
    body_distance,
    certify,
    penetration,
)
from pinproof.description import moved_by, resolved
from pinproof.model import Arm
from pinproof.motion import Curve, CurvePart
from pinproof.picks.input.picks import Picks
from pinproof.picks.judging.grip import MovingFinger, PlacedSurface
from pinproof.spatial import SE3, Array, pose, translated

DISC = 1e-5
"""Metres: the thickness of the disc that represents the face of a suction cup."""

AROUND = 64
"""Number of directions in which it is measured whether a body is within the rim of a cup."""

SAMPLES = 5
"""Number of points of a motion at which the depth of a body is measured for a reason; eight times as many around the
contact."""

MOST_PIECES = 8
"""Largest number of displacements along a motion."""

RENEWED = 0.2
"""Share of the allowed depth: another displacement is searched where the displaced body is nearer to the part."""

DISPLACEMENT_DIGITS = 9
"""Displacements are rounded to nanometres, so that grasps with equal displacements share a checker."""

FACE = "the face of the cup"
"""The name of the face of the cup."""


@dataclass(frozen=True, eq=False)
class HandBody:
    """A link or attached body that does not move relative to the tcp; certificates need it as the obstacle ``solid``.

    It may be in the part by ``limit`` (m). For the face of a cup, ``axis`` (3,) is the only direction, in the tcp
    frame, in which the depth is measured.
    """

    placed: PlacedSurface
    solid: Obstacle
    limit: float
    axis: Array | None = None
    name: str = FACE


@dataclass(frozen=True)
class BodyDepth:
    """How deep a body of the hand is in the part, in metres.

    ``depth`` is an upper bound of the length of the shortest displacement after which it is outside of the part, and
    ``least`` a lower bound. The ``displacement`` (3,) in the tcp frame has the length ``limit`` or zero, and leaves the
    largest ``clearance`` of the displaced body from the part.
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
        if self.depth <= self.limit:
            return f"{self.body} {where} not proven to be at most {self.limit * 1e3:.2f} mm inside {part}"
        return f"{self.body} {where} {self.depth * 1e3:.2f} mm inside {part}; {limit}"


def hand_bodies(arm: Arm, shared: Picks, palm: Sequence[str]) -> tuple[HandBody, ...]:
    """The bodies of the tool and the rigidly connected links, those of the ``palm``, and the face of the cup."""
    depth, urdf, joints = shared.grip_limits.depth, arm.robot.urdf, (*arm.joint_names, *arm.followers)
    found = []
    face: HandBody | None = None
    # The face of a cup, into which the part may protrude by a limit of its own
    if (cup := shared.cup) is not None:
        disc = Obstacle(FACE, Cylinder(cup.radius, DISC), shared.tip * pose((0, 0, -DISC / 2)))
        placed = PlacedSurface(LineSurface.of_obstacle(disc), disc.pose)
        face = HandBody(placed, disc, cup.highest, -np.array(shared.tip.rotation[:, 2]))
        found.append(face)
    # The bodies of the tool, and the links that no joint moves relative to the tcp
    solids = [(body.name, body) for body in shared.tool]
    tcp, home = arm.forward_kinematics(arm.home), arm.home
    for geometry in urdf.collisions:
        rigid = moved_by(urdf, geometry.link, joints) == moved_by(urdf, arm.tcp, joints)
        if geometry.link in palm and rigid:
            at = tcp.actInv(arm.frame_placement(home, geometry.link)) * SE3(np.array(geometry.origin))
            if geometry.mesh is None:
                shape: Shape = KINDS[geometry.kind](*geometry.size)
            else:  # a mesh is the solid that it is
                shape = Mesh(resolved(geometry.mesh, geometry.link), geometry.size)  # type: ignore[arg-type]  # three
            solids.append((geometry.link, Obstacle(f"{geometry.name} of the hand", shape, at)))
    # A body that is the lip of the cup yields as far as the cup
    for name, solid in solids:
        placed, limit = PlacedSurface(LineSurface.of_obstacle(solid), solid.pose), depth
        if face is not None and cup is not None:
            # It is the lip if it reaches the face and is within the cylinder of the rim
            centre, turns = face.placed.pose, np.arange(AROUND) * 2 * np.pi / AROUND
            across = np.stack([np.cos(turns), np.sin(turns), np.zeros(AROUND)], axis=1) @ centre.rotation.T
            reaches = placed.surface.reaches(across @ solid.pose.rotation)
            reaches = reaches + across @ (solid.pose.translation - centre.translation)
            touches = body_distance(*placed, *face.placed) <= TOUCH
            if touches and reaches.max() <= cup.radius + TOUCH:
                limit = max(depth, cup.gap, cup.highest)
        found.append(HandBody(placed, solid, limit, name=name))
    return tuple(found)


def depth_of(body: HandBody, part: PlacedSurface, directions: Array) -> BodyDepth:
    """How deep a body is in the part; ``directions`` (K, 3) in the tcp frame are tried first to move it out."""
    only, ways = body.axis is not None, directions if body.axis is None else body.axis[None]
    return _depth(body.name, body.placed, body.limit, part, ways, only=only)


def _depth(
    name: str, body: PlacedSurface, limit: float, part: PlacedSurface, directions: Array, *, only: bool = False
) -> BodyDepth:
    found = penetration(*body, *part, directions, limit + TOUCH, only=only)
    x, y, z = np.round(found.by, DISPLACEMENT_DIGITS).tolist()
    return BodyDepth(name, found.depth, limit, found.least, (x, y, z), found.clearance)


def depths_at_grasp(
    palm: Sequence[HandBody], fingers: Sequence[MovingFinger], part: PlacedSurface, back: Array, limit: float
) -> tuple[BodyDepth, ...]:
    """The depths of the bodies of the palm, then those of the closed fingers, limited by ``limit`` (m).

    ``back`` (3,) is the direction opposite to the approach, in the tcp frame.
    """
    found = [depth_of(body, part, back[None]) for body in palm]
    for finger in fingers:
        out = np.array([-finger.direction, back])
        found += [_depth(finger.name, body.moved(finger.closed), limit, part, out) for body in finger.surfaces]
    return tuple(found)


def depths_while_closing(
    fingers: Sequence[MovingFinger], depths: Sequence[BodyDepth], part: PlacedSurface, limit: float
) -> tuple[BodyDepth, ...]:
    """The depths of bodies of rotating fingers between open and closed, where they exceed ``limit`` (m).

    ``depths`` are those of all bodies of the closed fingers, in the same order. The motion is followed back from there
    by conservative advancement (Mirtich, 1996): as long as a body that is displaced by the limit does not touch the
    part, the body itself is in it by no more. Where it does, another displacement is searched. Fingers that translate
    need no such proof: their first contact on the line is measured.
    """
    found = []
    bodies = [(finger, body) for finger in fingers for body in finger.surfaces]
    for (finger, body), closed in zip(bodies, depths, strict=True):
        if finger.placed_at is None or not closed.within:
            continue
        measure, share, depth = MeasureByCoal(), 1.0, closed
        solid = body.surface.surface or body.surface.body
        target = part.surface.surface or part.surface.body
        for _ in range(MOST_ADVANCES):
            here = body.moved(finger.placed_at(share))
            moved = translated(here.pose, depth.displacement)
            clearance = measure(solid, moved.homogeneous, target, part.pose.homogeneous).attained
            if clearance < RENEWED * limit:
                depth = _depth(finger.name, here, limit, part, np.array([-finger.direction]))
                clearance = depth.clearance
                if not depth.within:
                    break
            share -= clearance / finger.rate
            if share <= 0.0:
                break
        if share > 0.0:
            found.append(replace(depth, clearance=min(depth.clearance, 0.0)))
    return tuple(found)


@dataclass(eq=False)
class OpenHand:
    """The open hand and a part that lies still or moves on a belt, without anything else.

    ``outside`` is the checker before the grasp, ``palm`` are the bodies of the hand that do not move while it closes,
    with their ``depths`` at the grasp, and ``hand`` the names of all bodies and links that may touch the part.
    """

    outside: CollisionChecker
    part: Obstacle
    surface: LineSurface
    palm: tuple[HandBody, ...]
    depths: tuple[BodyDepth, ...]
    hand: tuple[str, ...]
    padding: float = 0.0

    def padded(self, by: float) -> OpenHand:
        """The same for a part that may be displaced by up to ``by`` metres, which only concerns the open fingers."""
        other = copy(self)
        other.padding = by
        return other

    @cached_property
    def _coarse(self) -> CollisionChecker:
        return self._checker()

    @cached_property
    def _exact(self) -> CollisionChecker:
        return self._checker(exact=True)

    def _checker(
        self, finer_at: Array | None = None, *, exact: bool = False, depths: Sequence[BodyDepth] = ()
    ) -> CollisionChecker:
        """The checker of the displaced palm and the open fingers against the part, with finer links or exact meshes.

        The displacements are those of ``depths``, by default those at the grasp.
        """
        # Exact meshes of the palm and of the part, if hulls are not sufficient
        solids, part = [each.solid for each in self.palm], self.part
        if exact:
            solids = [_exactly(each.solid, each.placed.surface) for each in self.palm]
            part = _exactly(part, self.surface)
        placed = [
            replace(solid, pose=translated(solid.pose, depth.displacement))
            for solid, depth in zip(solids, depths or self.depths, strict=False)  # those of closed fingers follow
        ]
        replaced = {solid.name for solid in placed}
        attached = (*(each for each in self.outside.attached if each.name not in replaced), *placed)
        spec = replace(self.outside.spec, scene=Scene((part,)), attached=attached, margins={})
        checker = self.outside.with_spec(spec).with_margin(0.0)
        if finer_at is not None:
            checker = checker.finer_at(finer_at)
        # the displaced copies of links of the palm replace them
        return self._against_part(checker, replaced | (set(self.hand) - {body.name for body in self.palm}))

    def _against_part(self, checker: CollisionChecker, names: Set[str]) -> CollisionChecker:
        """The checker of bodies of the hand against the part alone; derived checkers check the other pairs again."""
        owners = [{checker.bodies[k].owner for k in pair} for pair in checker.pairs]
        return checker.without_pairs(
            k for k, pair in enumerate(owners) if not (self.part.name in pair and names & pair)
        )

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
        # First the hand against the part where it is, then the open fingers with the tolerances
        still = [replace(mover, tolerance=0.0) for mover in movers]
        wider = bool(deviation or self.padding or any(mover.tolerance for mover in movers))
        failed, deepest = list[Certificate](), None
        # The coarsest checker that is free at the grasp; both if the configuration is not known
        suited = [self._coarse] if grasp is None or self._coarse.is_free(grasp) else [self._checker(grasp)]
        if grasp is None:
            suited.append(self._exact)
        elif not suited[0].is_free(grasp):
            suited = [self._checker(grasp, exact=True)]
        for checker in suited:
            there, palm = checker.obstacles_and_links, {body.solid.name for body in self.palm}
            own = {name for name in there if name in palm or name in self.hand}
            fingers = own - palm
            if closing:
                checker = self._against_part(checker, own & palm)
            # The displaced palm and, unless they close, the open fingers stay outside of the part
            failed.append(certify(curve, checker, movers=still, limits=None))
            proven = failed[-1].free
            if not proven and grasp is not None and palm and not (closing or movers):
                proven, deepest = self._prove_piecewise(curve, grasp)
            if proven and wider and fingers and not closing:
                alone = self._against_part(checker.padded(self.padding) if self.padding else checker, fingers)
                failed.append(certify(curve, alone, joint_tolerance=deviation, movers=movers, limits=None))
                proven = failed[-1].free
            if proven:
                return None
        if deepest is not None and deepest.depth > deepest.limit:
            return EntryFailure(failed[-1], deepest.words(self.part.name, "would be"), deepest.depth)
        return self._failure(curve, failed[-1], part_at or (lambda _: self.part.pose))

    def _prove_piecewise(self, curve: Curve, grasp: Array) -> tuple[bool, BodyDepth | None]:
        """Whether the palm is in the part by no more than is allowed; if not, where it is deeper, if that is known.

        The displacement that fits the grasp may lead into another wall of the part. The curve is followed from its far
        end to the ``grasp`` (n,). Where the displaced palm touches the part, another displacement is measured, with
        which the proof continues.
        """
        # The curve from its far end to the grasp
        rest = CurvePart.of(curve, *curve.domain)
        if np.abs(curve.start - grasp).max() < np.abs(curve.end - grasp).max():
            rest = rest.reversed()
        touched = rest.domain[0]
        # The displacements where the palm touches the part, then the proof until it touches it again
        for _ in range(MOST_PIECES):
            part = PlacedSurface(self.surface, self._tcp_from_part(rest(touched), self.part.pose))
            depths = [depth_of(body, part, np.empty((0, 3))) for body in self.palm]
            if outside := [depth for depth in depths if not depth.within]:
                # a wall beside the cup is in the way of its body; the depth in its face would be misleading
                return False, max((d for d in outside if d.body != FACE), key=lambda d: d.depth, default=None)
            proof = certify(rest, self._checker(exact=True, depths=depths), limits=None)
            contact = proof.first_contact
            if proof.free or contact is None or contact.proven_free_until <= rest.domain[0]:
                return proof.free, None
            rest, touched = CurvePart.of(rest, contact.proven_free_until, rest.domain[1]), contact.time
        return False, None

    def _tcp_from_part(self, q: Array, root_from_part: SE3) -> SE3:
        arm = self.outside.arm
        return (arm.root_from_base * arm.forward_kinematics(q)).actInv(root_from_part)

    def _failure(self, curve: Curve, proof: Certificate, part_at: Callable[[float], SE3]) -> EntryFailure:
        """What enters the part, with its largest depth at some points of the curve."""
        met = proof.first_contact or proof.undecided
        body = next((each for each in self.palm if met is not None and each.solid.name in met.bodies), None)
        if body is None:
            return EntryFailure(proof, f"the open fingers collide with the object: {proof.message}")
        knots = curve.bezier()[0]
        times = np.linspace(knots[0], knots[-1], SAMPLES).tolist()
        if proof.first_contact is not None:  # and points around the contact, which may be a touch
            at, spacing = proof.first_contact.time, times[1] - times[0]
            near = np.linspace(at - spacing, at + spacing, 8 * SAMPLES).clip(knots[0], knots[-1])
            times += [at, *near.tolist()]
        deepest: BodyDepth | None = None
        for time in times:
            part = PlacedSurface(self.surface, self._tcp_from_part(np.asarray(curve(time)), part_at(time)))
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
