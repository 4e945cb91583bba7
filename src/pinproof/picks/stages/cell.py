"""What all picks of a list are judged in: the arm, the scene, the open and the closed hand."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, Obstacle
from pinproof.model import Arm
from pinproof.picks.configurations import has_closed_form, widened
from pinproof.picks.frames import moved_by
from pinproof.picks.hand import MovingFinger, fingers_of
from pinproof.picks.pick import Picks
from pinproof.picks.settings import PickBudget, PickWeights

__all__ = ["Cell"]


@dataclass(frozen=True, eq=False)
class Cell:
    """The arm in its scene.

    Parameters
    ----------
    checker
        With the tool attached, fingers apart.
    shared
        What the picks share.
    home
        (n,) where transits start.
    weights, budget
        How picks are compared, and how much is tried.
    trial
        Picks are changed picks, judged for suggestions: of a failed one only the stage matters, not a proof.
    """

    checker: CollisionChecker
    shared: Picks
    home: npt.NDArray[np.float64]
    weights: PickWeights = field(default_factory=PickWeights)
    budget: PickBudget = field(default_factory=PickBudget)
    trial: bool = False

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.checker.arm

    @cached_property
    def for_trials(self) -> Cell:
        """The same for judging changed picks: one whole pick is enough, and there are no suggestions."""
        return replace(self, budget=replace(self.budget, compared=1, remedies=0), trial=True)

    @cached_property
    def closed_hand(self) -> CollisionChecker:
        """The same with the fingers on the object."""
        closed, fingers = self.checker.with_held(self.shared.grip), self.shared.fingers
        return closed if fingers is None else closed.with_attached(*fingers.gripping())

    @cached_property
    def hand(self) -> tuple[str, ...]:
        """The names of all that may touch what is grasped."""
        urdf, shared = self.arm.robot.urdf, self.shared
        moved = (link for link in urdf.links if moved_by(urdf, link, shared.grip))
        return tuple(dict.fromkeys((*(body.name for body in shared.open_tool), *shared.gripper, *moved)))

    @cached_property
    def fingers(self) -> tuple[MovingFinger, ...]:
        """All that moves while the hand closes; empty for a tool without fingers."""
        return fingers_of(self.arm, self.shared.fingers, self.shared.grip)

    @cached_property
    def palm(self) -> tuple[str, ...]:
        """The names of all of the hand that does not move while it closes."""
        moving = {finger.name for finger in self.fingers}
        return tuple(name for name in self.hand if name not in moving)

    @cached_property
    def closing_hand(self) -> CollisionChecker:
        """With the closing motion of all fingers as bodies that hold all of it.

        A link that closes meets the links that it is not checked against as it stands; the fingers are judged against
        each other open and closed.
        """
        checker, swept = self.checker, {body.name: of for of, bodies in self.swept.items() for body in bodies}
        excluded = {frozenset(pair.owners) for pair in checker.excluded}
        moved = checker.with_attached(*(body for bodies in self.swept.values() for body in bodies))
        owners = moved.obstacles_and_links
        return moved.allowing(
            *(
                (name, other)
                for name, finger in swept.items()
                for other in owners
                if other not in swept
                and (other == finger or other in self.swept or frozenset((finger, other)) in excluded)
            )
        )

    @cached_property
    def swept(self) -> dict[str, tuple[Obstacle, ...]]:
        """By finger, convex bodies that hold all of its closing motion; their poses are ``tcp_from_body``."""
        return {finger.name: finger.swept() for finger in self.fingers}

    @cached_property
    def wide_arm(self) -> Arm:
        """The arm under limits that are a turn, or half a metre, wider on either side."""
        return widened(self.arm)

    @cached_property
    def closed_form(self) -> bool:
        """Whether every branch of a pose can be told."""
        return has_closed_form(self.arm)
