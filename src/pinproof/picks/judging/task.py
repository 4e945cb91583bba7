"""One pick in its cell: resolved frames and poses, the object, and the checkers and limits of each stage."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, wraps
from itertools import combinations
from typing import Any, TypeVar, cast

import numpy as np
import numpy.typing as npt

from pinproof.collision import (
    TOUCH,
    CheckerSpec,
    CollisionChecker,
    LineSurface,
    Obstacle,
    Scene,
    Upright,
    directions_to_facets,
    margins_of,
    point_distance,
)
from pinproof.description import moved_by
from pinproof.errors import InputError, PicksError, UnknownNameError
from pinproof.model import Arm, JointGroup
from pinproof.motion import HoldLimits, RateConstraint, TorqueLimits, TorquePeak, Trajectory
from pinproof.picks.input.pick import OBJECT, TIP, Member, Pick, family, support_names
from pinproof.picks.input.picks import Picks, root_from_frame
from pinproof.picks.input.settings import PickBudget, PickWeights
from pinproof.picks.judging.configurations import has_closed_form, widened
from pinproof.picks.judging.grip import (
    Closing,
    GripResult,
    MovingFinger,
    PlacedSurface,
    close_on,
    fingers_of,
    grip_by_cup,
    grip_by_fingers,
    grip_by_tip,
    too_far_to_hold,
)
from pinproof.picks.judging.hand import (
    BodyDepth,
    HandBody,
    OpenHand,
    depths_at_grasp,
    depths_while_closing,
    hand_bodies,
)
from pinproof.picks.judging.hold import hold_data_missing, hold_limits
from pinproof.picks.judging.verdict import Stage
from pinproof.planning import planner_of
from pinproof.spatial import SE3, Array, matrix

HELD_TOLERANCE = 1e-9
"""rad or m: two values of a held joint that differ by less are considered equal."""

CLOSED_DIGITS = 7
"""Closed positions (rad or m) that follow from contact are rounded to this decimal, which is less than the tolerance of
the contact, so that grasps of equal parts share the checkers of the closed hand."""

GRIPS_KEPT = 256
"""Number of grips that a cell keeps for other picks of equal parts."""


@dataclass(frozen=True, eq=False)
class PickCell:
    """The arm in its scene, with the checkers of the open, the closed and the closing hand.

    ``checker`` has the tool and the open fingers attached, and transits start at ``home`` (n,). If changed picks are
    judged for suggestions, only good verdicts and failures at stages later than ``trial`` count, so the stages need not
    be judged in order.
    """

    checker: CollisionChecker
    shared: Picks
    home: npt.NDArray[np.float64]
    weights: PickWeights = field(default_factory=PickWeights)
    budget: PickBudget = field(default_factory=PickBudget)
    trial: Stage | None = None
    bare: PickCell | None = field(default=None, repr=False)
    """The cell with the hand of the picks file, of which this one has the hand of some of the picks."""
    hand_key: Hashable = field(default=None, repr=False)
    """What its hand depends on, see :meth:`Picks.hand_key`."""
    grips: dict[Hashable, GripResult] = field(default_factory=dict, init=False, repr=False)
    """The first :data:`GRIPS_KEPT` different grips that were judged."""
    depths: dict[Hashable, tuple[BodyDepth, ...]] = field(default_factory=dict, init=False, repr=False)
    """The depths of the bodies of the hand of the first :data:`GRIPS_KEPT` different grips."""
    surfaces: dict[str, LineSurface] = field(default_factory=dict, init=False, repr=False)
    """The surfaces of the obstacles of the scene that were picked."""
    _trials: dict[Stage, PickCell] = field(default_factory=dict, init=False, repr=False)
    _hands: dict[Hashable, PickCell] = field(default_factory=dict, init=False, repr=False)

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.checker.arm

    def for_trials(self, stage: Stage) -> PickCell:
        """The cell for judging changed picks: one complete motion is sufficient, and no suggestions are made."""
        if stage not in self._trials:
            budget = replace(self.budget, compared=1, remedies=0, motion=0)
            self._trials[stage] = replace(self, budget=budget, trial=stage)
        return self._trials[stage]

    def for_pick(self, pick: Pick) -> PickCell:
        """The cell with the hand of a pick with one grasp.

        Raises
        ------
        InputError
            If the values of the hand that the pick states do not fit the robot or its tool.
        """
        key = self.shared.hand_key(pick)
        if key == self.hand_key:
            return self
        bare = self.bare or self
        if key not in bare._hands:
            shared = bare.shared.for_pick(pick)
            checker = with_hand(bare.checker, shared)
            check_held_joints(checker.arm, shared)
            made = replace(bare, checker=checker, shared=shared, bare=bare, hand_key=key)
            object.__setattr__(made, "surfaces", bare.surfaces)
            bare._hands[key] = made
        return bare._hands[key]

    @cached_property
    def without_remedies(self) -> PickCell:
        """The cell for judging grasps of which another one may be good: no suggestions are made."""
        return replace(self, budget=replace(self.budget, remedies=0))

    @property
    def by_contact(self) -> bool:
        """Whether the fingers close until they touch the object, because no closed positions are stated."""
        fingers = self.shared.fingers
        return None in self.shared.grip.values() or (fingers is not None and fingers.grip is None)

    @cached_property
    def grip(self) -> dict[str, float]:
        """The closed positions of the gripping joints; the ends of their ranges if they follow from contact."""
        ends = {}
        for name, value in self.shared.grip.items():
            joint, start = self.arm.robot.urdf.joints[name], self.arm.held[name]
            limits = [limit for limit in (joint.lower, joint.upper) if limit is not None]
            ends[name] = max(limits, key=lambda limit: abs(limit - start)) if value is None else value
        return ends

    def closed_at(self, share: float) -> PickCell:
        """The cell whose hand holds the object at a share of the closing motion."""
        start, fingers = self.arm.held, self.shared.fingers
        stops = {
            name: round(start[name] + share * (end - start[name]), CLOSED_DIGITS) for name, end in self.grip.items()
        }
        if fingers is not None:
            fingers = replace(fingers, grip=round((1.0 - share) * fingers.opening, CLOSED_DIGITS))
        key = "closed", *stops.items(), None if fingers is None else fingers.grip
        if key not in self._hands:
            made = replace(self, shared=replace(self.shared, grip=stops, fingers=fingers), bare=self.bare or self)
            object.__setattr__(made, "surfaces", self.surfaces)
            self._hands[key] = made
        return self._hands[key]

    @cached_property
    def closed_hand(self) -> CollisionChecker:
        """The checker with the fingers on the object."""
        closed, fingers = self.checker.with_held(self.grip), self.shared.fingers
        return closed if fingers is None else closed.with_attached(*fingers.gripping())

    @cached_property
    def closed_contact(self) -> GripResult | None:
        """The failure of every grip if the closed hand is in contact at every configuration of the arm, else None."""
        if self.by_contact or not (contacts := self.closed_hand.fixed_contacts):
            return None
        message = f"the hand cannot be closed: {'; '.join(map(str, contacts))} at every configuration of the arm"
        proven = bool(self.closed_hand.finer_at(self.home).fixed_contacts)  # not only between convex hulls of meshes
        return GripResult(held=False, message=message, proven=proven)

    @cached_property
    def hand(self) -> tuple[str, ...]:
        """The names of all bodies and links that may touch the object."""
        urdf, shared = self.arm.robot.urdf, self.shared
        moved = (link for link in urdf.links if moved_by(urdf, link, shared.grip))
        return tuple(dict.fromkeys((*(body.name for body in shared.open_tool), *shared.gripper, *moved)))

    @cached_property
    def fingers(self) -> tuple[MovingFinger, ...]:
        """The moving fingers; empty for a tool without fingers."""
        return fingers_of(self.arm, self.shared.fingers, self.grip)

    @cached_property
    def palm_bodies(self) -> tuple[HandBody, ...]:
        """The bodies of the hand that no joint moves relative to the tcp, and the face of a suction cup."""
        moving = {finger.name for finger in self.fingers}
        return hand_bodies(self.arm, self.shared, [name for name in self.hand if name not in moving])

    @cached_property
    def closing_hand(self) -> CollisionChecker:
        """The checker with the swept volumes of the closing fingers attached.

        The swept volume of a finger is not checked against the links that the finger itself is not checked against.
        Fingers are checked against each other only open and closed.
        """
        checker, swept = self.checker, {body.name: of for of, bodies in self.swept.items() for body in bodies}
        excluded = {frozenset(pair.owners) for pair in checker.excluded}
        moved = checker.spec.with_attached(*(body for bodies in self.swept.values() for body in bodies))
        allowed = (
            (name, other)
            for name, finger in swept.items()
            for other in checker.obstacles_and_links
            if other == finger or other in self.swept or frozenset((finger, other)) in excluded
        )
        # One change: without the allowed contacts, swept volumes and links would be sampled for contacts.
        return checker.with_spec(with_gripper_margins(moved, self.shared, swept).allowing(*allowed))

    @cached_property
    def swept(self) -> dict[str, tuple[Obstacle, ...]]:
        """For each finger the convex bodies that contain its closing motion; their poses are ``tcp_from_body``."""
        return {finger.name: finger.swept() for finger in self.fingers}

    @cached_property
    def wide_arm(self) -> Arm:
        """The arm with limits that are one rotation, or half a metre, wider on both sides."""
        return widened(self.arm)

    @cached_property
    def closed_form(self) -> bool:
        """Whether the arm has a closed form that gives every IK branch."""
        return has_closed_form(self.arm)


def check_held_joints(arm: Arm, picks: Picks) -> None:
    """Raise if the held joints, the gripper links or the gripping values of the picks do not fit the arm."""
    # Joints outside the arm are where the picks assume them
    for name, value in picks.held.items():
        if name not in arm.held or abs(arm.held[name] - value) > HELD_TOLERANCE:
            actual = f"holds it at {arm.held[name]:g}" if name in arm.held else "does not hold it"
            raise InputError(
                f"the picks state {name} = {value:g}, but the arm {actual}; create the arm with "
                "robot.arm(held=picks.held)"
            )
    # The two values of finger joints are within their limits
    joints = arm.robot.urdf.joints
    for name, closed in picks.grip.items():
        if name not in arm.held or joints[name].mimic is not None:
            others = [joint for joint in arm.held if joints[joint].mimic is None]
            raise UnknownNameError("joint", name, others, "the joints outside the arm that can grip")
        low = -np.inf if (lower := joints[name].lower) is None else lower
        high = np.inf if (upper := joints[name].upper) is None else upper
        if closed is None and None in (joints[name].lower, joints[name].upper):
            raise InputError(f"{name} has no limits between which the fingers close; state its grip under held")
        for when, at in (("open", arm.held[name]), ("grip", closed)):
            if at is not None and not low <= at <= high:
                raise InputError(f"{name} = {at:g} ({when}) is outside its limits [{low:g}, {high:g}]")
    closed_positions = [*picks.grip.values(), *([] if picks.fingers is None else [picks.fingers.grip])]
    if None in closed_positions and any(stop is not None for stop in closed_positions):
        raise InputError("only some of the fingers state a grip; state it for all of them, or for none")
    if mover := moved_by(arm.robot.urdf, arm.tcp, picks.grip):
        raise InputError(
            f"the tcp {arm.tcp!r} is moved by {mover}, a gripper joint; choose a tcp that no gripper joint moves"
        )
    # Fingers without geometry never touch a part
    urdf = arm.robot.urdf
    if picks.grip and not any(moved_by(urdf, geometry.link, picks.grip) for geometry in urdf.collisions):
        links = ", ".join(link for link in urdf.links if moved_by(urdf, link, picks.grip))
        raise InputError(
            f"{', '.join(picks.grip)} moves no link with collision geometry ({links}), so no contact with a part can "
            "be found; add <collision> to these links in the URDF, or state the fingers as bodies (`fingers`)"
        )
    moving = (*arm.joint_names, *arm.followers)
    for name in picks.gripper:
        if name not in arm.robot.urdf.links:
            raise UnknownNameError("link", name, arm.robot.urdf.links, "the gripper of the picks")
        # only of bodies that do not move relative to the part is the depth in it judged
        if (mover := moved_by(arm.robot.urdf, name, moving)) != (carrier := moved_by(arm.robot.urdf, arm.tcp, moving)):
            raise InputError(
                f"the gripper of the picks: {name} is moved by {mover or 'no joint'}, but the tcp {arm.tcp!r} by "
                f"{carrier}; name only links of the hand, which are fixed to the tcp or moved by gripping joints"
            )


def check_windings(arm: Arm, picks: Picks) -> None:
    """Raise InputError if a budget of rotation of the picks is not for a revolute joint of the arm."""
    turning = [name for name, angular in zip(arm.joint_names, arm.angular, strict=True) if angular]
    for name in picks.windings:
        if name in turning:
            continue
        if name in arm.joint_names:
            error = InputError(
                f"windings.{name}: the joint is prismatic and does not wind; joints: {', '.join(turning)}"
            )
        else:
            error = UnknownNameError("joint", name, turning, "windings")
        if picks.source is None or (place := picks.places.get(f"windings.{name}")) is None:
            raise error
        raise PicksError(picks.source, str(error), place) from error


def gripper_links(arm: Arm, picks: Picks) -> tuple[str, ...]:
    """The links of grippers: those that gripping joints move, and with them those that no joint moves against the tcp.

    The margin between bodies of a cell allows for errors of its calibration, which two links of one gripper do not
    have: they are built to be as close as they are. They are checked for contact, unless the SRDF disables the pair.
    """
    grip = {joint for hand in (picks, *picks.tools.values()) for joint in hand.grip}
    if not grip:
        return ()
    urdf, joints = arm.robot.urdf, (*arm.joint_names, *arm.followers, *grip)
    still = moved_by(urdf, arm.tcp, joints)
    return tuple(link for link in urdf.links if moved_by(urdf, link, grip) or moved_by(urdf, link, joints) == still)


def with_gripper_margins(spec: CheckerSpec, picks: Picks, swept: Mapping[str, str] | None = None) -> CheckerSpec:
    """The specification with a margin of 0 for pairs within a gripper for which none is stated.

    ``swept`` names the finger of each swept volume, which has the margins of this finger.
    """
    margins = spec.margins
    if not margins and (spec.margin == 0.0 or not (picks.grip or picks.tools)):
        return spec
    links = gripper_links(next(iter(spec.arm.arms.values())), picks)
    wanted: dict[Any, float] = {frozenset(pair): 0.0 for pair in combinations(links, 2)} | dict(margins)
    for volume, finger in (swept or {}).items():
        wanted |= {pair - {finger} | {volume}: margin for pair, margin in wanted.items() if finger in pair}
    return replace(spec, margins=wanted)


def with_hand(checker: CollisionChecker, picks: Picks) -> CollisionChecker:
    """The checker of an arm with another hand, which is open."""
    spec = checker.spec.with_held(picks.held).with_attached(*picks.open_tool)
    return checker.with_spec(with_gripper_margins(spec, picks))


def checker_of_picks(arm: JointGroup, scene: Scene, picks: Picks) -> CollisionChecker:
    """The checker of an arm in its cell with the open hand of picks.

    Its scene states no margins of pairs: those of the scene and of the picks, which have precedence, are its own.

    Raises
    ------
    UnknownNameError
        If a margin of the scene or of the picks is for a body that does not exist.
    """
    checker = CollisionChecker.of(with_gripper_margins(spec_of_picks(arm, scene, picks), picks))
    names = {*checker.obstacles_and_links, *(body.name for tool in picks.tools.values() for body in tool.open_tool)}
    names |= {pick.carried.name for pick in picks.picks if isinstance(pick.carried, Obstacle)}
    for where, margins in (("the picks", picks.margins), (scene.where, scene.margins)):
        for name in (name for own in margins for name in own.between):
            if name not in names:
                raise UnknownNameError("body", name, names, f"the margins of {where}")
    return checker


def spec_of_picks(arm: JointGroup, scene: Scene, picks: Picks) -> CheckerSpec:
    """What :func:`checker_of_picks` checks, without a test of the names of margins and without those of grippers."""
    margins = {**margins_of(scene), **{frozenset(own.between): own.margin for own in picks.margins}}
    bare = replace(scene, margins=()) if scene.margins else scene
    return CheckerSpec(arm, bare, margin=picks.margin, margins=margins, attached=picks.open_tool)


FAR_GRASP = 0.1
"""Metres. A tip and fingers that are farther from the surface of the object are probably stated in another frame."""

SAME_PART = 1e-3
"""Metres: largest difference of the extents of an object of the scene from those of its part type."""

SUPPORT_GAP = 1e-3
"""Metres: an obstacle at most this far below an object is taken for its support."""

DOWN = -0.5
"""Largest z component of the unit direction from an object to its support: within 60 degrees of straight down."""


def supports_below(checker: CollisionChecker, q: Array, name: str) -> tuple[str, ...]:
    """The obstacles that are close below an object of this name in the hand, held at q (n,), which they support."""
    found = []
    for contact in checker.with_margin(max(SUPPORT_GAP, checker.margin)).check(q).contacts:
        if name not in contact.bodies or contact.distance > SUPPORT_GAP:
            continue
        first = contact.bodies[0] == name
        other, sign = (contact.bodies[1], 1) if first else (contact.bodies[0], -1)
        below = sign * contact.normal[2] < DOWN
        if other in checker.scene and not below:
            # The facet of a bin that is nearest to the object may belong to a wall instead of the floor
            owners = ((checker.bodies[i].owner, checker.bodies[j].owner) for i, j in checker.pairs)
            pairs = (pair for pair, both in enumerate(owners) if both == (name, other))
            facets = (directions_to_facets(checker, pair, q, SUPPORT_GAP) for pair in pairs)
            below = any((directions[:, 2] < DOWN).any() for directions in facets)
        if other in checker.scene and below:
            found.append(other)
    return tuple(dict.fromkeys(found))


Method = TypeVar("Method", bound=Callable[..., Any])


def once_per_grasp(compute: Method) -> Method:
    """Make a method keep its result for each grasp and further arguments in the attribute ``kept`` of its object."""

    @wraps(compute)
    def kept(owner: Any, member: Member, /, *args: Any, **kwargs: Any) -> Any:
        key = compute.__name__, member.words, *args, *kwargs.values()
        if key not in owner.kept:
            owner.kept[key] = compute(owner, member, *args, **kwargs)
        return owner.kept[key]

    return cast(Method, kept)


class PickTask:
    """One pick in its cell: poses, object and collision checkers for all stages.

    Raises
    ------
    InputError
        If a frame, the object or a support does not exist, the object's name is taken, or the planner does not support
        ``upright``.
    """

    def __init__(self, pick: Pick, cell: PickCell) -> None:
        if pick.by_part:
            raise InputError(f"pick {pick.name!r} describes several grasps; choose one of picks.grasps_of(pick)")
        cell = cell.for_pick(pick)
        self.cell, self.arm, self.scene, shared_tip = cell, cell.arm, cell.checker.scene, cell.shared.tip
        self.outside = cell.checker
        """The checker before the grasp, without an object that the pick states itself."""
        self.pick = replace(pick, pose=self._in_root(pick.pose, pick.frame), frame="") if pick.frame else pick
        self._stated_pose, self._stated_frame = pick.pose, pick.frame
        # The object and the supports exist under their names
        carried = pick.carried
        self.from_scene = isinstance(carried, str)
        if isinstance(carried, str) and carried not in self.scene:
            raise UnknownNameError("object", carried, self.scene, self.scene.where)
        if not isinstance(carried, str) and carried is not None and carried.name in cell.checker.obstacles_and_links:
            raise InputError(f"the object's name {carried.name!r} is taken; name an obstacle by its name alone")
        if pick.part in cell.shared.parts:
            # Of other extents than its part type, its grasps are not for it
            known, key = cell.surfaces, f"part type {pick.part}"
            shape = Obstacle(key, cell.shared.parts[str(pick.part)].shape)
            known.setdefault(key, known.get(key) or LineSurface.of_obstacle(shape))
            extents = [surface.body.box for surface in (self._surface, known[key])]
            if np.abs(extents[0] - extents[1]).max() > SAME_PART:
                own, other = (" x ".join(f"{side * 1e3:.1f}" for side in high - low) for low, high in extents)
                reason = f"{own} mm, the part {other} mm" if own != other else "the same size in another frame"
                raise InputError(f"{carried!r} of the scene is no {pick.part}: its extents are {reason}")
        for stated in (pick.support, None if pick.place is None else pick.place.support):
            for support in support_names(stated) or ():
                if support not in self.scene:
                    raise UnknownNameError("support", support, self.scene, self.scene.where)
        if pick.upright is not None and not planner_of(cell.budget.planner).supports("constraints"):
            raise InputError(f"the planner {cell.budget.planner!r} does not support upright; use rrt_connect")
        self.name = pick.object_name
        if self.name and cell.shared.grip_limits.hold and (missing := hold_data_missing(pick, cell.shared)):
            raise InputError(f"whether the grip holds in motion (`hold`) is unknown without {' and '.join(missing)}")
        self.place = pick.place
        if pick.place is not None:
            # The pose of the tip in the root frame, at the nominal grasp
            there = self._in_root(pick.place.pose, pick.place.frame)
            if pick.place.pose_of == OBJECT:
                there = there * shared_tip.actInv(self.holding(Member(SE3.Identity())).pose).inverse()
            self.place = replace(pick.place, pose=there, frame="", pose_of=TIP)
        self.kept: dict[tuple[Hashable, ...], Any] = {}
        self._open_hands: dict[Hashable, OpenHand] = {}
        self._closing: dict[PickCell, CollisionChecker] = {}
        self._empty: dict[PickCell, CollisionChecker] = {}

    @property
    def sampled(self) -> bool:
        """Whether the tried grasps are samples of a continuous family."""
        tolerance = self.pick.tolerance
        return self.pick.spin.sampled or any(tolerance.position) or tolerance.tilt > 0

    def groups(self) -> Iterator[list[Member]]:
        """The grasps of the family in groups of increasing displacement."""
        return family(self.pick.spin, self.pick.tolerance, self.pick.axis_in(self.pick.pose))

    @cached_property
    def nearest_group(self) -> list[Member]:
        """The first of the groups: the nominal grasp and its rotations."""
        return next(self.groups())

    # -- poses --------------------------------------------------------------------------------------------------------

    def grasp(self, member: Member) -> SE3:
        """``root_from_tip`` at the grasp."""
        return self.pick.pose * member.nominal_from_tip

    def release(self, member: Member) -> SE3:
        """``root_from_tip`` at the release."""
        return (self.place or self.pick).pose * member.nominal_from_tip

    def target(self, root_from_tip: SE3) -> SE3:
        """``base_from_tcp`` that places the tip at a pose."""
        return self.arm.root_from_base.actInv(root_from_tip * self.cell.shared.tip.inverse())

    def targets(self, poses: list[SE3]) -> Array:
        """``base_from_tcp`` (N, 4, 4) for many poses of the tip."""
        return np.array([matrix(self.target(pose)) for pose in poses]).reshape(-1, 4, 4)

    def constraints(self, member: Member) -> tuple[Upright, ...]:
        """The constraints of the tcp while the object is carried."""
        pick = self.pick
        if pick.upright is None:
            return ()
        up = self.arm.root_from_base.rotation.T @ np.array([0.0, 0.0, 1.0])
        axis = self.target(self.grasp(member)).rotation.T @ up
        if pick.upright_axis is not None:
            axis = self.cell.shared.tip.rotation @ np.array(pick.upright_axis)
        return (Upright(tolerance=pick.upright, axis_in_tcp=(*axis.tolist(),), up=(*up.tolist(),)),)

    # -- checkers -----------------------------------------------------------------------------------------------------

    @once_per_grasp
    def before(self, member: Member, *, touching: bool = False) -> CollisionChecker:
        """The checker before the grasp and, if ``touching``, on the approach, where the hand may touch the object.

        An object that the pick states itself is where it will be grasped. Without an approach, the transit ends there.
        """
        if not isinstance(self.pick.carried, Obstacle):
            return self.at_grasp if touching else self.outside
        if touching:
            return self._allowing_hand(self.before(member))
        part = replace(self.pick.carried, pose=self.grasp(member) * self.pick.carried.pose)
        checker = self.outside.with_scene(self.scene.add(part))
        return checker if self.pick.approach else self._allowing_hand(checker)

    @cached_property
    def at_grasp(self) -> CollisionChecker:
        """The checker at the grasp, where the hand may touch the object; :meth:`grip` judges how it does."""
        return self._allowing_hand(self.outside) if self.from_scene else self.outside

    @once_per_grasp
    def passing(self, member: Member, *, placed: bool = False) -> OpenHand | None:
        """The open hand against the object alone, before the grasp or ``placed``; None without an object or a hand.

        It may touch the object on the lines, where :attr:`at_grasp` and :meth:`letting_go` allow any contact.
        """
        palm, hand = self.cell.palm_bodies, self.cell.hand
        if self.name is None or not (palm or hand):
            return None
        part = (self.letting_go(member) if placed else self.before(member)).scene[self.name]
        depths = self.depths(member)
        key = matrix(part.pose).tobytes(), tuple(depth.displacement for depth in depths[: len(palm)])
        if key not in self._open_hands:  # rotations about the approach often have the same displacements
            self._open_hands[key] = OpenHand(self.outside, part, self._surface, palm, depths, hand)
        return self._open_hands[key]

    @once_per_grasp
    def stop(self, member: Member) -> Closing | None:
        """Where the fingers touch the object if they close until then; None if their closed positions are stated."""
        if self.name is None or not self.cell.by_contact:
            return None
        return close_on(self.cell.fingers, PlacedSurface(self._surface, self.holding(member).pose))

    def closed(self, member: Member) -> PickCell:
        """The cell with the closed positions of the fingers on the object."""
        stop = self.stop(member)
        # An open finger that touches the object has no closing motion; what it touches is found in the complete one
        return self.cell if stop is None else self.cell.closed_at(stop.share or 1.0)

    @once_per_grasp
    def closing(self, member: Member) -> CollisionChecker:
        """The checker while the fingers close; the hand may touch the object."""
        closed = self.closed(member)
        if closed not in self._closing:
            closing = closed.closing_hand
            self._closing[closed] = self._allowing_hand(closing, closed) if self.from_scene else closing
        return self._closing[closed]

    # -- the grip -----------------------------------------------------------------------------------------------------

    @once_per_grasp
    def grip(self, member: Member) -> GripResult:
        """Whether the closed hand holds the object, which does not depend on the configuration of the arm."""
        # Picks of equal parts often have the same grasp of the part
        cell, stop, along = self.closed(member), self.stop(member), self._along(member)
        shared = cell.shared
        if stop is not None and stop.ahead < stop.share and (reason := stop.reason(str(self.name))):
            return GripResult(held=False, message=reason)
        if cell.closed_contact is not None:
            return cell.closed_contact
        key, known = self._grip_key(member), cell.grips
        if key in known:
            return known[key]

        def kept(grip: GripResult) -> GripResult:
            """The result, which is kept for other picks of equal parts."""
            if len(known) < GRIPS_KEPT:
                known[key] = grip
            return grip

        # Fingers, cup or tip are where the part is
        part, limits = PlacedSurface(self._surface, self.holding(member).pose), shared.grip_limits
        if cell.trial and cell.fingers and too_far_to_hold(cell.fingers, part, limits):
            grip = GripResult(held=False, message="the closed fingers do not reach the part")  # is not shown
        elif cell.fingers:
            grip = grip_by_fingers(cell.fingers, part, along, limits)
            if stop is not None:
                grip = replace(grip, message=f"{self._stop_words(stop, grip)}{grip.message}")
        elif shared.cup is not None:
            grip = grip_by_cup(shared.cup, shared.tip, part)
        else:
            grip = grip_by_tip(shared.tip, part, along, self.pick.approach, limits)
        if not grip.held:
            return kept(grip)
        # No body of the hand is in the part by more than is allowed, also while the hand closes
        depths = self.depths(member)
        depth = max((body.depth for body in depths), default=0.0)
        outside, where = [body for body in depths if not body.within], "is"
        if not outside and any(finger.placed_at is not None for finger in cell.fingers):
            closed = depths[len(cell.palm_bodies) :]
            outside = [*depths_while_closing(cell.fingers, closed, part, limits.depth)]
            where = "is, while the hand closes,"
        if not outside:
            return kept(replace(grip, depth=depth))
        worst, proven = max(outside, key=lambda body: body.depth), any(body.least > body.limit for body in outside)
        message, depth = worst.words(part.name, where), max(depth, worst.depth)
        return kept(replace(grip, held=False, message=message, depth=depth, proven=proven))

    def _stop_words(self, stop: Closing, grip: GripResult) -> str:
        """Where the fingers stopped, before the message of a grip; of one that fails, which finger touched first."""
        ahead = max((-contact.gap for contact in grip.contacts), default=0.0)
        if not grip.held:
            where = f"{self.name} is not in the middle of the hand: {stop.first} touches it {ahead * 1e3:.2f} mm before"
            apart = all(contact.open_distance > 0.0 for contact in grip.contacts)
            return f"{where} {stop.second}; " if ahead > TOUCH and stop.second and apart else ""
        closed = self.cell.closed_at(stop.share).shared
        stops = [f"{name} = {value:.4g}" for name, value in closed.grip.items()]
        stops += [] if closed.fingers is None else [f"{(closed.fingers.grip or 0.0) * 1e3:.2f} mm"]
        return f"closed by contact at {', '.join(stops)}: "

    @once_per_grasp
    def hold(self, member: Member) -> HoldLimits | None:
        """The limits of the motions with the object by the grip; None if it does not hold it or its data are unknown.

        Raises
        ------
        InputError
            If the contacts do not resist forces and moments in every direction.
        """
        shared = self.cell.shared
        if self.name is None or self.pick.payload is None or not (grip := self.grip(member)).held:
            return None
        return hold_limits(self.pick, shared, grip, self.holding(member).pose, self.arm, self._surface)

    @once_per_grasp
    def slip_at_rest(self, member: Member) -> tuple[str, float]:
        """Why the grip does not carry the object at rest at the grasp or at the release, and the share that is needed.

        An empty text and 0 if it does, or if its data are unknown.
        """
        try:
            limits = self.hold(member)
        except InputError as error:
            return str(error), np.inf
        if limits is not None:
            tcp_from_tip = self.cell.shared.tip
            places = {"grasp": self.grasp(member), **({} if self.place is None else {"release": self.release(member)})}
            for where, root_from_tip in places.items():
                rest = limits.at_rest(root_from_tip * tcp_from_tip.inverse())
                if not rest.holds:
                    return f"{self.name} slips at rest at the {where}: {rest.words}", rest.share
        return "", 0.0

    def _grip_key(self, member: Member) -> Hashable:
        """What a grip depends on, besides the hand; picks of equal parts often have the same grasp of the part."""
        held, along = self.holding(member), self._along(member)
        return held.name, held.shape, matrix(held.pose).tobytes(), along.tobytes(), self.pick.approach

    def _along(self, member: Member) -> Array:
        """(3,) the direction of the approach in the frame of the tcp."""
        return np.asarray(self.cell.shared.tip.rotation @ self.pick.axis_in(self.grasp(member)))

    @once_per_grasp
    def depths(self, member: Member) -> tuple[BodyDepth, ...]:
        """How deep the bodies of the palm, and after them those of the closed fingers, are in the object."""
        key, known = self._grip_key(member), self.cell.depths
        if key in known:
            return known[key]
        cell, part = self.closed(member), PlacedSurface(self._surface, self.holding(member).pose)
        limit = cell.shared.grip_limits.depth
        found = depths_at_grasp(cell.palm_bodies, cell.fingers, part, -self._along(member), limit)
        if len(known) < GRIPS_KEPT:
            known[key] = found
        return found

    def frame_hint(self) -> str:
        """A hint on the frame of the pick, if its grasp is implausibly far from an object of the scene; else empty."""
        if not self.from_scene:
            return ""

        def distance_in(frame: str) -> float:
            """Distance (m) from the tip to the surface of the object, with the pose stated in a frame."""
            tip = self._in_root(self._stated_pose, frame).translation
            return point_distance(self._surface, self.scene[str(self.name)].pose.actInv(tip))

        def described(frame: str) -> str:
            return f"frame {frame!r}" if frame else "the root frame"

        # A grasp far from the object is probably stated in another frame
        stated = self._stated_frame
        distance = distance_in(stated)
        if distance > FAR_GRASP and self.cell.fingers:
            contacts = self.grip(Member(SE3.Identity())).contacts
            distance = min([distance, *(min(each.open_distance, each.closed_distance) for each in contacts)])
        if distance <= FAR_GRASP:
            return ""
        words = f"the grasp is {distance:.3g} m from {self.name}; its pose is stated in {described(stated)}"
        # Would the same numbers in another frame be a grasp of the object?
        others = {frame: distance_in(frame) for frame in {str(self.name), "", *self.cell.shared.frames} - {stated}}
        closest = min(others, key=lambda frame: others[frame])
        if others[closest] > FAR_GRASP:
            return f"{words}; check its frame"
        return f"{words}, but in {described(closest)} it would be {max(others[closest], 0.0) * 1e3:.0f} mm from it"

    @cached_property
    def _surface(self) -> LineSurface:
        carried = self.pick.carried
        if carried is None:
            raise InputError(f"pick {self.pick.name!r} states no object")
        if isinstance(carried, Obstacle):
            return LineSurface.of_obstacle(carried)
        known = self.cell.surfaces
        return known.setdefault(carried, known.get(carried) or LineSurface.of_obstacle(self.scene[carried]))

    def holding(self, member: Member) -> Obstacle:
        """The held object; its pose is ``tcp_from_object``."""
        carried, tip = self.pick.carried, self.cell.shared.tip
        if isinstance(carried, str):
            obstacle = self.scene[carried]
            return replace(obstacle, pose=tip * self.grasp(member).actInv(obstacle.pose))
        if carried is None:
            raise InputError(f"pick {self.pick.name!r} states no object")
        return replace(carried, pose=tip * carried.pose)

    @once_per_grasp
    def carrying(self, member: Member) -> CollisionChecker:
        """The checker with the object in the hand, or with the empty tool if no object is stated."""
        if self.name is None:
            return self.outside
        closed = self.closed(member)
        if closed not in self._empty:  # the closed hand without the object in the scene
            hand = closed.closed_hand
            self._empty[closed] = hand.with_scene(self.scene.remove(str(self.name))) if self.from_scene else hand
        return self._allowing_hand(self._empty[closed].with_attached(self.holding(member)))

    @once_per_grasp
    def letting_go(self, member: Member) -> CollisionChecker:
        """The checker with the object at its place and the hand open."""
        held = self.holding(member)
        placed = replace(held, pose=self.release(member) * self.cell.shared.tip.actInv(held.pose))
        others = self.scene.remove(held.name) if self.from_scene else self.scene
        return self._allowing_hand(self.outside.with_scene(others.add(placed)))

    def returning(self, member: Member) -> CollisionChecker:
        """The checker with the object at its place and the open hand away from it."""
        return self.outside.with_scene(self.letting_go(member).scene)

    @once_per_grasp
    def opening(self, member: Member) -> CollisionChecker:
        """The checker while the fingers open at the place."""
        closed = self.closed(member)
        return self._allowing_hand(closed.closing_hand.with_scene(self.letting_go(member).scene), closed)

    def supports(
        self, checker: CollisionChecker, q: Array, stated: str | Sequence[str] | None
    ) -> tuple[tuple[str, str], ...]:
        """The pairs of the object and its supports, with the object held at q (n,)."""
        if self.name is None:
            return ()
        if stated is not None:
            return tuple((self.name, name) for name in support_names(stated) or ())
        return tuple((self.name, name) for name in supports_below(checker, q, self.name))

    def _allowing_hand(self, checker: CollisionChecker, closing: PickCell | None = None) -> CollisionChecker:
        """The checker in which the hand may touch the object, with the swept volumes of the cell of a closing hand."""
        swept = {} if closing is None else {body.name: of for of, bodies in closing.swept.items() for body in bodies}
        there = checker.obstacles_and_links
        return checker.allowing(*((each, str(self.name)) for each in (*self.cell.hand, *swept) if each in there))

    def _in_root(self, pose: SE3, frame: str) -> SE3:
        return self.root_from(frame) * pose if frame else pose

    def root_from(self, frame: str) -> SE3:
        """``root_from_frame`` of a frame in which a pick or a place is stated."""
        return root_from_frame(frame, self.cell.shared.frames, self.scene, self.arm)


CARRYING = ("retreat", "transfer", "place")
"""The parts of the motion with the object in the hand."""


def limits_torque(shared: Picks, pick: Pick | None = None) -> bool:
    """Whether the torque limits apply: a payload is stated, or the picks demand it."""
    return shared.torque_limits or bool(shared.payload) or (pick is not None and pick.payload is not None)


def torque_limits_of_tool(arm: Arm, shared: Picks) -> TorqueLimits | None:
    """The torque limits with the empty tool; None if torque is not limited.

    Raises
    ------
    InputError
        If the arm has no torque limits or no masses, or a payload is fixed to a link that the arm does not move.
    """
    try:
        return TorqueLimits(arm, shared.payload) if limits_torque(shared) else None
    except InputError as error:
        raise InputError(f"the picks limit torques: {error}") from error


def torque_limits(task: PickTask, member: Member, part: str, arm: Arm) -> TorqueLimits | None:
    """The limits of torque during a part of the motion; None if torque is not limited."""
    shared, pick = task.cell.shared, task.pick
    if not limits_torque(shared, pick):
        return None
    # The object is carried in the frame of the tcp
    carried = () if pick.payload is None or part not in CARRYING else (pick.payload.placed(task.holding(member).pose),)
    return TorqueLimits(arm, (*shared.payload, *carried))


def rate_limits(task: PickTask, member: Member, part: str, checker: CollisionChecker) -> list[RateConstraint]:
    """The limits of torque, of the grip and of the tool during a part of the motion, beside those of the joints."""
    torques = torque_limits(task, member, part, checker.arm)
    constraints: list[RateConstraint] = [] if torques is None else [torques]
    if part in CARRYING and (hold := task.hold(member)) is not None:
        constraints.append(hold)
    if (speed := task.pick.speed.get(part)) is not None:
        constraints.append(speed.limits(checker.arm))
    return constraints


def at_rest(task: PickTask, members: Sequence[Member], q: Array) -> list[str]:
    """Why the arm cannot hold the object at rest at each configuration of the grasp (k, n); empty texts if it can."""
    limits: dict[str, TorqueLimits | None] = {}
    reasons = []
    for member, each in zip(members, q, strict=True):
        if member.words not in limits:
            limits[member.words] = torque_limits(task, member, "retreat", task.arm)
        limit = limits[member.words]
        reasons.append("" if limit is None else limit.standstill(each))
    return reasons


def peaks_of(constraints: list[RateConstraint], trajectory: Trajectory) -> tuple[TorquePeak, ...]:
    """The largest torques of a trajectory; empty if torque is not limited."""
    return next((each.peaks(trajectory) for each in constraints if isinstance(each, TorqueLimits)), ())
