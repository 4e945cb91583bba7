"""One pick in its cell: its frames resolved, what it grasps found, and the checkers of its stages."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, Obstacle
from pinproof.collision.line_surface import LineSurface
from pinproof.collision.separation import directions_to_facets
from pinproof.errors import InputError, UnknownNameError
from pinproof.picks.family import Member, family
from pinproof.picks.frames import root_from_frame
from pinproof.picks.grip import GripResult, HeldPart, grip_by_fingers, grip_by_tip
from pinproof.picks.pick import TIP, Pick, PlaceTarget, moved, support_names
from pinproof.picks.stages.cell import Cell
from pinproof.spatial import SE3, matrix

__all__ = ["SUPPORT_GAP", "Task"]

Array = npt.NDArray[np.float64]

SUPPORT_GAP = 1e-3
"""Metres: what lies no farther than this below an object is what it stands on."""

DOWN = -0.5
"""The z of the direction from an object to what it stands on is below this: within 60 degrees of straight down."""


class Task:
    """What the stages ask of a pick.

    Parameters
    ----------
    pick
        As it was stated.
    cell
        Where it is judged.

    Raises
    ------
    InputError
        If a frame, the object or a support does not exist, or the object's name is taken.
    """

    def __init__(self, pick: Pick, cell: Cell) -> None:
        self.cell, self.arm, self.scene = cell, cell.arm, cell.checker.scene
        self.pick = replace(pick, pose=self._in_root(pick.pose, pick.frame), frame="")
        self.place: PlaceTarget | None = None
        if pick.place is not None:
            self.place = replace(pick.place, pose=self._in_root(pick.place.pose, pick.place.frame), frame="")
        carried, names = pick.carried, self.scene.names
        self.from_scene = isinstance(carried, str)
        if isinstance(carried, str) and carried not in names:
            raise UnknownNameError("object", carried, names, self.scene.where)
        if not isinstance(carried, str) and carried is not None and carried.name in cell.checker.obstacles_and_links:
            raise InputError(f"the object's name {carried.name!r} is taken; name an obstacle by its name alone")
        for stated in (pick.support, None if pick.place is None else pick.place.support):
            for support in support_names(stated) or ():
                if support not in names:
                    raise UnknownNameError("support", support, names, self.scene.where)
        self.name = carried.name if isinstance(carried, Obstacle) else carried
        self._carrying: dict[str, CollisionChecker] = {}
        self._letting_go: dict[str, CollisionChecker] = {}
        self._opening: dict[str, CollisionChecker] = {}
        self._passing_off: dict[str, CollisionChecker] = {}
        self._grips: dict[str, GripResult] = {}

    @property
    def sampled(self) -> bool:
        """Whether grasps that are not tried would be as good as those that are."""
        tolerance = self.pick.tolerance
        return self.pick.spin.sampled or any(tolerance.position) or tolerance.tilt > 0

    def rings(self) -> Iterator[list[Member]]:
        """The grasps of the family, ring by ring outwards."""
        axis = np.array(self.pick.approach_direction)
        if self.pick.approach_frame != TIP:
            axis = self.pick.pose.rotation.T @ axis
        return family(self.pick.spin, self.pick.tolerance, axis)

    def with_pick(self, **changes: object) -> Task:
        """The same with another approach, retreat or pose: for remedies."""
        return Task(replace(self.pick, **changes), self.cell)  # type: ignore[arg-type]

    # -- poses --------------------------------------------------------------------------------------------------------

    def grasp(self, member: Member) -> SE3:
        """``root_from_tip`` at the grasp."""
        return self.pick.pose * member.nominal_from_tip

    def release(self, member: Member) -> SE3:
        """``root_from_tip`` where the object is let go."""
        return (self.place or self.pick).pose * member.nominal_from_tip

    def target(self, root_from_tip: SE3) -> SE3:
        """``base_from_tcp`` that brings the tip to a pose."""
        return self.cell.shared.tcp_target(root_from_tip, self.arm.root_from_base)

    def targets(self, poses: list[SE3]) -> Array:
        """The same (N, 4, 4) of many."""
        return np.array([matrix(self.target(pose)) for pose in poses]).reshape(-1, 4, 4)

    def approach_end(self, root_from_tip: SE3) -> SE3:
        """Where the approach to a grasp begins."""
        pick = self.pick
        return moved(root_from_tip, -pick.approach, pick.approach_direction, pick.approach_frame)

    def retreat_end(self, root_from_tip: SE3) -> SE3:
        """Where the retreat from a grasp ends."""
        pick = self.pick
        return moved(root_from_tip, pick.retreat, pick.retreat_direction, pick.retreat_frame)

    # -- checkers -----------------------------------------------------------------------------------------------------

    @property
    def outside(self) -> CollisionChecker:
        """On the way to the object."""
        return self.cell.checker

    @cached_property
    def at_grasp(self) -> CollisionChecker:
        """At the grasp: the hand may touch the object. How the fingers do is judged by :meth:`grip`."""
        return self.outside.allowing(*self._touching(self.outside)) if self.from_scene else self.outside

    @cached_property
    def passing(self) -> CollisionChecker | None:
        """Around nothing but the object, which the open fingers must pass by; None without fingers or such an object.

        On the approach the hand may touch the object, as :attr:`at_grasp` says, but its open fingers may not.
        """
        if not self.from_scene or not self.cell.fingers:
            return None
        return self._passing(self.scene[str(self.name)])

    @cached_property
    def closing(self) -> CollisionChecker:
        """While the fingers close: the hand may touch the object."""
        closing = self.cell.closing_hand
        return closing.allowing(*self._touching(closing)) if self.from_scene else closing

    # -- the grip -----------------------------------------------------------------------------------------------------

    def grip(self, member: Member) -> GripResult:
        """How the closed hand holds the object; it does not depend on the configuration of the arm."""
        if member.words not in self._grips:
            part = HeldPart(self._surface, self.holding(member).pose)
            limits, tip = self.cell.shared.grip_limits, self.cell.shared.tip
            if self.cell.fingers:
                along = np.array(self.pick.approach_direction)
                if self.pick.approach_frame != TIP:
                    along = self.grasp(member).rotation.T @ along
                self._grips[member.words] = grip_by_fingers(self.cell.fingers, part, tip.rotation @ along, limits)
            else:
                self._grips[member.words] = grip_by_tip(tip, part, limits)
        return self._grips[member.words]

    @cached_property
    def _surface(self) -> LineSurface:
        carried = self.pick.carried
        if carried is None:
            raise InputError(f"pick {self.pick.name!r} names no object to hold")
        return LineSurface.of_obstacle(self.scene[carried] if isinstance(carried, str) else carried)

    def holding(self, member: Member) -> Obstacle:
        """The object as it is held: its pose is ``tcp_from_object``."""
        carried, tip = self.pick.carried, self.cell.shared.tip
        if isinstance(carried, str):
            stands = self.scene[carried]
            return replace(stands, pose=tip * self.grasp(member).actInv(stands.pose))
        if carried is None:
            raise InputError(f"pick {self.pick.name!r} names no object to hold")
        return replace(carried, pose=tip * carried.pose)

    def carrying(self, member: Member) -> CollisionChecker:
        """With the object in the hand, or the empty tool where none is named."""
        if self.name is None:
            return self.outside
        if member.words not in self._carrying:
            full = self._without_object.with_attached(self.holding(member))
            self._carrying[member.words] = full.allowing(*self._touching(full))
        return self._carrying[member.words]

    @cached_property
    def _without_object(self) -> CollisionChecker:
        """With the hand closed, and nothing where the object was."""
        bare = self.cell.closed_hand
        return bare.with_scene(self.scene.remove(str(self.name))) if self.from_scene else bare

    def letting_go(self, member: Member) -> CollisionChecker:
        """With the object where it was put, and the hand open."""
        if member.words not in self._letting_go:
            held = self.holding(member)
            stands = replace(held, pose=self.release(member) * self.cell.shared.tip.actInv(held.pose))
            others = self.scene.remove(held.name) if self.from_scene else self.scene
            there = self.outside.with_scene(others.add(stands))
            self._letting_go[member.words] = there.allowing(*self._touching(there))
        return self._letting_go[member.words]

    def passing_off(self, member: Member) -> CollisionChecker | None:
        """As :attr:`passing`, of the object where it was put."""
        if not self.cell.fingers:
            return None
        if member.words not in self._passing_off:
            self._passing_off[member.words] = self._passing(self.letting_go(member).scene[str(self.name)])
        return self._passing_off[member.words]

    def opening(self, member: Member) -> CollisionChecker:
        """While the fingers open where the object was put."""
        if member.words not in self._opening:
            there = self.cell.closing_hand.with_scene(self.letting_go(member).scene)
            self._opening[member.words] = there.allowing(*self._touching(there))
        return self._opening[member.words]

    def supports(
        self, checker: CollisionChecker, q: Array, stated: str | Sequence[str] | None
    ) -> tuple[tuple[str, str], ...]:
        """The pairs of the object and what it stands on, held at q (n,)."""
        if self.name is None:
            return ()
        if stated is not None:
            return tuple((self.name, name) for name in support_names(stated) or ())
        found = []
        for contact in checker.with_margin(max(SUPPORT_GAP, checker.margin)).check(q).contacts:
            if self.name in contact.bodies and contact.distance <= SUPPORT_GAP:
                first = contact.bodies[0] == self.name
                other = contact.bodies[1] if first else contact.bodies[0]
                # The nearest facet of a bin may be one of its wall while the object stands on its floor.
                below = (1 if first else -1) * contact.normal[2] < DOWN
                if other in checker.scene.names and (below or self._has_facets_below(checker, q, other)):
                    found.append((self.name, other))
        return tuple(dict.fromkeys(found))

    def _has_facets_below(self, checker: CollisionChecker, q: Array, obstacle: str) -> bool:
        """Whether the object, held at q (n,), is near facets of an exact mesh that are below it."""
        directions = [
            directions_to_facets(checker, pair, q, SUPPORT_GAP)
            for pair, (i, j) in enumerate(checker.pairs)
            if (checker.bodies[i].owner, checker.bodies[j].owner) == (self.name, obstacle)
        ]
        return any((found[:, 2] < DOWN).any() for found in directions)

    def _touching(self, checker: CollisionChecker) -> list[tuple[str, str]]:
        """The pairs of the object and the hand."""
        swept = (body.name for bodies in self.cell.swept.values() for body in bodies)
        return [(each, str(self.name)) for each in (*self.cell.hand, *swept) if each in checker.obstacles_and_links]

    def _passing(self, part: Obstacle) -> CollisionChecker:
        checker = self.outside.with_scene(replace(self.scene, obstacles=(part,), allowed=(), disabled=()))
        there = checker.obstacles_and_links
        palm = ((name, part.name) for name in self.cell.palm if name in there)
        return checker.with_margin(0.0).allowing(*palm)

    def _in_root(self, pose: SE3, frame: str) -> SE3:
        if not frame:
            return pose
        return root_from_frame(frame, self.cell.shared.frames, self.scene, self.arm) * pose
