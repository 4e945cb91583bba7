"""Grips of several hands that hold one part together, each judged as that of a pick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace

from pinproof.collision import Obstacle, Scene
from pinproof.common.results import Answer, Rows, View
from pinproof.common.structs import described, key
from pinproof.common.validation import require_type
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import JointGroup
from pinproof.picks.input.pick import Pick
from pinproof.picks.input.picks import Picks
from pinproof.picks.input.tools import Hand, Tool
from pinproof.picks.judging.grip import GripResult
from pinproof.picks.judging.task import PickCell, PickTask, check_held_joints, checker_of_picks
from pinproof.spatial import SE3, rigid


@described(eq=False)
class HandsResult(Answer):
    """Whether every hand holds the part; result of :func:`judge_hands`."""

    grips: dict[str, GripResult] = key("the grip of each arm, by its name")

    @property
    def ok(self) -> bool:
        """Whether all hands hold the part."""
        return all(grip.held for grip in self.grips.values())

    @property
    def message(self) -> str:
        """The reason of each hand that does not hold the part, or what all hands touch."""
        shown = {name: grip for name, grip in self.grips.items() if self.ok or not grip.held}
        return "; ".join(f"{name}: {grip.message}" for name, grip in shown.items())

    def _view(self) -> View:
        rows = [(name, "holds" if grip.held else "does not hold", grip.message) for name, grip in self.grips.items()]
        return View(self.message, [Rows(("arm", "grip", "reason"), rows)])


def judge_hands(group: JointGroup, part: Obstacle, grasps: Mapping[str, SE3], tools: Mapping[str, Tool]) -> HandsResult:
    """Judge for each arm of a joint group whether its hand holds a part, by the criteria of the grip of a pick.

    A motion of these arms with the part is planned by :func:`pinproof.planning.plan_carry`.

    Parameters
    ----------
    group
        The joint group; fingers that are links are those of its robots.
    part
        The part, with its pose in the frame of the part.
    grasps
        ``tcp_from_part`` of each arm that holds it.
    tools
        The tool of each of these arms, with the criteria of its grip. Without fingers and cup, the tip must be at the
        surface of the part.

    Raises
    ------
    UnknownNameError
        If the group has no arm of a name.
    InputError
        If no arm is named, an arm has no tool, or a tool does not fit its robot.
    """
    require_type("part", part, Obstacle)
    require_type("grasps", grasps, Mapping)
    require_type("tools", tools, Mapping)
    if not grasps:
        raise InputError("grasps names no arm; state tcp_from_part of each arm that holds the part")
    grips = {}
    for name, given in grasps.items():
        if name not in group.ends:
            raise UnknownNameError("arm", name, group.ends, "grasps")
        if name not in tools:
            raise InputError(f"arm {name!r} has no tool; tools must state one for each of {', '.join(grasps)}")
        # A pick of the part by this arm alone, without a scene: the grip does not depend on where the part is
        tool, tcp_from_part = tools[name], rigid(f"grasps[{name!r}]", given)
        require_type(f"tools[{name!r}]", tool, Tool)
        in_hand = replace(part, pose=tool.tip.actInv(tcp_from_part * part.pose))
        shared = Picks([], **{own.name: getattr(tool, own.name) for own in fields(Hand)})
        arm = group.arms[name].with_held(tool.held)
        check_held_joints(arm, shared)
        cell = PickCell(checker_of_picks(arm, Scene(), shared), shared, arm.home)
        task = PickTask(Pick(part.name, tcp_from_part.actInv(tool.tip), carried=in_hand), cell)
        grips[name] = task.grip(task.nearest_group[0])
    return HandsResult(grips)
