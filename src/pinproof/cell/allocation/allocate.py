"""Picks for several arms: which arm executes which pick, in which order, and when.

Every pick is judged for every arm that may execute it. Picks are allocated so that the largest time of an arm is as
short as possible, each arm's picks are put in sequence (:func:`pinproof.sequence`), and the arms wait for each other
where they would meet (:mod:`pinproof.cell.allocation.common_clock`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from pinproof.cell.allocation.allocation_result import AllocationResult, OneArm
from pinproof.cell.allocation.common_clock import ArmsApart, Timing, time_together
from pinproof.cell.sequencing.options import Job
from pinproof.cell.sequencing.precedence import AT_PLACE, Precedence
from pinproof.cell.sequencing.sequence import SequenceBudget, judge_options, sequence
from pinproof.cell.sequencing.sequence_result import LeftOut, SequenceResult
from pinproof.collision import CollisionChecker, Obstacle, PairMargin, Scene
from pinproof.common.validation import Rng, require_type
from pinproof.errors import InputError, NoAnswer, UnknownNameError
from pinproof.model import PART, JointGroup, Payload
from pinproof.picks import Hand, HandValues, PartType, Pick, Picks, PickSetup, gripper_links, spec_of_picks
from pinproof.spatial import Array
from pinproof.work import Progress

CROWDED = 3.0
"""A pick costs 1 + this times as much if its arm would meet every other arm at every of its picks."""

ROUNDS = 3
"""Number of allocations: after the first, with costs that are scaled to the certified times of each arm."""

GAIN = 1e-3
"""Share of the largest load of an arm that a change of the allocation must save."""

TOTAL = 0.05
"""Weight of the sum of all loads beside the largest."""

EXCHANGES = 500
"""Largest number of exchanges that are compared for one change of the allocation."""


def allocate(
    group: JointGroup,
    scene: Scene,
    picks: Picks,
    *,
    precedence: Iterable[tuple[str, str]] = (),
    grip_dwell: float = 0.0,
    release_dwell: float = 0.0,
    budget: SequenceBudget | None = None,
    compare: bool = True,
    rng: Rng = 0,
    progress: Progress | None = None,
) -> AllocationResult:
    """Allocate picks to the arms of a cell, order them, and time all arms on a common clock.

    Each arm starts and ends at home. It executes its sequence; its motions are certified with the other arms at home
    and with the parts of the other arms both where they are picked and where they are placed. All arms move at the same
    time, and wait at rest after a motion where they would meet. The pairs of bodies of different arms are certified on
    the common clock.

    Parameters
    ----------
    group
        The arms, such as a cell of :func:`pinproof.assemble`; ``picks.load_cell()`` loads the cell of a picks file.
    scene
        The obstacles before the first pick, in the root frame of the group.
    picks
        The picks in the root frame of the group. With ``picks.robots``, each arm has its own hand and home, otherwise
        they are the same for all.
    precedence
        Pairs of names: the first pick has ended when the second starts, whichever arms execute them.
    grip_dwell, release_dwell
        As for :func:`pinproof.sequence`.
    budget
        The effort of the search for the sequence of each arm.
    compare
        Whether the sequence of all picks by one arm is computed too, for each arm.
    rng
        Seed or Generator.
    progress
        Called with the name of the work, the number of its parts that are finished, and the number of all parts.

    Returns
    -------
    AllocationResult
        The program of each arm and their certificates. Picks that no arm can execute are left out, with the reasons.

    Raises
    ------
    InputError
        If the group has one arm or arms that share joints, the robots overlap, the object of a pick is not in the
        scene, or the picks are not valid for a sequence.
    UnknownNameError
        If a pick or ``picks.robots`` names an arm that the group does not have.
    NoAnswer
        If no sequence of an arm can be certified.
    """
    require_type("group", group, JointGroup)
    require_type("picks", picks, Picks)
    require_type("scene", scene, Scene)
    require_type("budget", budget, SequenceBudget, type(None))
    # arms that can move independently
    if len(group.ends) < 2:
        raise InputError("picks are allocated to several arms; for one arm use pinproof.sequence")
    if shared := group.shared_joints:
        raise InputError(
            f"the joints {', '.join(shared)} are shared by several arms of {group.robot.name!r}, which can "
            "therefore not execute picks independently; choose arms without common joints (robot.arms(base=...))"
        )
    # arms that the group has, each with its settings
    for name in picks.robots:
        if name not in group.ends:
            raise UnknownNameError("arm", name, group.ends, "the robots of the picks")
    if missing := [name for name in group.ends if picks.robots and name not in picks.robots]:
        raise InputError(f"the picks state no robot {', '.join(missing)}, which the group has")
    # picks for these arms, whose parts are in the scene from the start
    for pick in picks:
        if pick.arm is not None and pick.arm not in group.ends:
            raise UnknownNameError("arm", pick.arm, group.ends, f"pick {pick.name!r}")
        if isinstance(pick.carried, Obstacle):
            raise InputError(
                f"the object {pick.carried.name!r} of pick {pick.name!r} is not in the scene before the pick, so the "
                "other arms could not be certified with it; add it to the scene and state its name as the object"
            )
    if not picks.picks:
        raise InputError("there are no picks to allocate")
    # which arm executes which pick, in several tries
    dwell, effort = (grip_dwell, release_dwell), budget or SequenceBudget()
    run = AllocationRun(group, scene, picks, tuple(precedence), dwell, effort, progress or (lambda *_: None), rng)
    run.judge()
    timing, results = run.shortest()
    alone = tuple(run.alone(name) for name in group.ends) if compare else ()
    return AllocationResult(
        group, scene, picks, timing, results, tuple(run.left_out), alone, run.apart.checker.attached
    )


HandLike = TypeVar("HandLike", bound=Hand)

Values = TypeVar("Values", bound=HandValues)


def _settings_in_cell(group: JointGroup, arm: str, picks: Picks) -> Picks:
    """The settings of an arm, with the names of links and joints in the cell and unique names of its tool."""
    own = picks.robots[arm].settings if picks.robots else picks
    part = group.robot.part_of(group.ends[arm][1])
    prefix = "" if part is None else part + PART

    def full(name: str) -> str:
        urdf = group.robot.urdf
        return name if name in urdf.links or name in urdf.joints else prefix + name

    def named(body: Obstacle) -> Obstacle:
        return replace(body, name=f"{arm}{PART}{body.name}")

    def placed(payload: Payload) -> Payload:
        return payload if payload.frame is None else replace(payload, frame=full(payload.frame))

    # tools of two arms may have the same name, and a link that of another robot
    def in_cell(hand: HandLike) -> HandLike:
        fingers = hand.fingers
        if fingers is not None:
            fingers = replace(fingers, bodies=(named(fingers.bodies[0]), named(fingers.bodies[1])))
        return replace(
            hand,
            tool=tuple(map(named, hand.tool)),
            fingers=fingers,
            gripper=tuple(map(full, hand.gripper)),
            payload=tuple(map(placed, hand.payload)),
            **joints(hand),
        )

    def joints(values: Hand | HandValues) -> dict[str, Any]:
        return {own: {full(name): at for name, at in getattr(values, own).items()} for own in ("held", "grip")}

    mounted = (None, *own.tools)

    def of_part(part: PartType) -> PartType:
        """The part with the grasps that are for the tools of the arm, and the values that these have."""
        usable = (each for each in part.grasps if (each.tool or part.tool) in mounted)
        return fitting(replace(part, grasps=tuple(map(fitting, usable))))

    def fitting(values: Values) -> Values:
        own_values = HandValues.that_fit(values, *(own.tools.values() or (own,)))
        return replace(values, **{**{name: getattr(own_values, name) for name in values.VALUES}, **joints(own_values)})

    if len(own.tools) > 1 and own.tool_change != "mounted":
        raise InputError(
            f"arm {arm!r} changes the tools {', '.join(own.tools)}, which an allocation does not support; state one "
            "tool for each arm, or tool_change: mounted"
        )
    return replace(
        in_cell(own),
        picks=(),
        problems=(),
        robots={},
        tools={name: in_cell(tool) for name, tool in own.tools.items()},
        parts={
            name: of_part(part)
            for name, part in own.parts.items()
            if any((each.tool or part.tool) in mounted for each in part.grasps or (part,))
        },
        home={full(joint): value for joint, value in own.home.items()},
        windings={full(joint): budget for joint, budget in own.windings.items()},
        frames=picks.frames,
        margin=picks.margin,
        margins=picks.margins,
        source=picks.source,
    )


@dataclass(eq=False)
class AllocationRun:
    """The work on one allocation."""

    group: JointGroup
    scene: Scene
    picks: Picks
    order: tuple[tuple[str, str], ...]
    dwell: tuple[float, float]
    budget: SequenceBudget
    progress: Progress
    rng: Rng
    left_out: list[LeftOut] = field(default_factory=list)
    jobs: dict[tuple[str, str], Job] = field(default_factory=dict)
    costs: dict[str, dict[str, float]] = field(default_factory=dict)
    meetings: dict[tuple[str, str], dict[tuple[str, str], float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        group = self.group
        Precedence.stated((pick.name for pick in self.picks), self.order)
        self.shared = {name: _settings_in_cell(group, name, self.picks) for name in group.ends}
        self.home = group.home
        for name, arm in group.arms.items():
            self.home[group.indices(name)] = self.shared[name].home_configuration(arm.joint_names, arm.home)
        hands = {name: own.always_mounted for name, own in self.shared.items()}
        tools = [replace(body, arm=name) for name, own in hands.items() for body in own.open_tool]
        self.held = {joint: value for own in hands.values() for joint, value in own.held.items()}
        links = (gripper_links(group.arms[name], own) for name, own in self.shared.items())
        margins: dict[Any, float] = {frozenset(pair): 0.0 for of_arm in links for pair in combinations(of_arm, 2)}
        stated = spec_of_picks(group.with_held(self.held), self.scene, self.picks)
        apart = replace(stated, scene=Scene(), attached=tuple(tools), margins={**margins, **stated.margins})
        checker = CollisionChecker.of(apart)
        self.apart = ArmsApart(checker)
        at_home = self.apart.carrying((), {}).check(self.home)
        if not at_home.free:
            raise InputError(f"the arms are in contact at home: {at_home}")
        self.setups = {name: self._setup(name, ()) for name in group.ends}

    def _setup(self, arm: str, others: Sequence[Obstacle]) -> PickSetup:
        """The setup of an arm, with the others at home and with these parts of the others at their places."""
        group, own = self.group, self.group.arms[arm]
        resting = dict(zip(group.joint_names, self.home.tolist(), strict=True))
        still = own.with_held({**{j: q for j, q in resting.items() if j not in own.joint_names}, **self.held})
        # the tools of the other arms rest at home, and may touch the links that hold them
        tools, allowed = [], list(self.scene.allowed)
        for name, (base, tcp) in group.ends.items():
            if name == arm:
                continue
            world_from_tcp = group.root_from_frame(self.home, tcp)
            of_arm = [link for link in group.robot.urdf.links if self.apart.arm_of[link] == name or link in (base, tcp)]
            for body in self.shared[name].always_mounted.open_tool:
                tools.append(replace(body, pose=world_from_tcp * body.pose))
                allowed += [(link, body.name) for link in of_arm]
        # the parts of the others have the margins that are stated for them at their places too
        stated = {frozenset(own.between): own.margin for own in (*self.scene.margins, *self.picks.margins)}
        margins = [
            PairMargin((*pair - {part}, body.name), margin)
            for body in others
            for pair, margin in stated.items()
            if (part := body.name.partition(AT_PLACE)[0]) in pair
        ]
        scene = replace(
            self.scene,
            obstacles=(*self.scene.obstacles, *tools, *others),
            allowed=tuple(allowed),
            margins=(*self.scene.margins, *margins),
        )
        shared = replace(self.shared[arm], picks=self.picks.picks)  # whose parts may be named by margins
        return PickSetup.make(still, scene, shared, home=None, rng=self.rng)

    # -- which arm ----------------------------------------------------------------------------------------------------

    def judge(self) -> None:
        """Judge every pick for every arm that may execute it; picks that none can execute are left out."""
        names = [pick.name for pick in self.picks]
        reasons: dict[str, list[str]] = {name: [] for name in names}
        self.tied = {name: {name} for name in names}
        self.costs = {arm: dict.fromkeys(names, np.inf) for arm in self.setups}
        for number, (arm, setup) in enumerate(self.setups.items()):
            own = list[Pick]()
            for pick in self.picks:
                try:
                    if pick.arm in (None, arm) and setup.shared.grasps_of(pick):
                        own.append(pick)
                except InputError as error:  # the arm has no tool for the part
                    reasons[pick.name].append(f"{arm}: {error}")
            self.progress("picks", number, len(self.setups))
            if not own:
                continue
            judged = judge_options(setup, own, self.budget)
            for left in judged.left_out:
                reasons[left.name].append(f"{arm}: {left.reason}")
            # the same arm executes picks whose parts support or block each other
            for first, second in judged.pairs:
                joined = self.tied[first] | self.tied[second]
                self.tied |= dict.fromkeys(joined, joined)
            self.jobs |= {(arm, job.pick.name): job for job in judged.jobs}
            self.costs[arm] |= judged.seconds
        self.progress("picks", len(self.setups), len(self.setups))
        for pick in self.picks:
            if not any(np.isfinite(costs[pick.name]) for costs in self.costs.values()):
                self.left_out.append(LeftOut(pick.name, "; ".join(reasons[pick.name])))
        arm_of = {pick.name: pick.arm for pick in self.picks}
        for name, tied in self.tied.items():
            if len({arm_of[member] for member in tied} - {None}) > 1:
                rival = next(member for member in sorted(tied) if arm_of[member] not in (None, arm_of[name]))
                raise InputError(
                    f"the picks {name!r} and {rival!r} support or block each other, so that one arm must execute both; "
                    f"state the same arm for {', '.join(sorted(tied))}"
                )
        # for each arm and pick, and each other arm and pick, the share of their grasps and releases that collide
        checker, ends = self.apart.sampled({}), {}
        for key, job in self.jobs.items():
            option = job.options[0]
            ends[key] = [option.attempt.q, *([] if option.release is None else [option.release.q])]
        for key, configurations in ends.items():
            rivals = [(end, q) for end, qs in ends.items() if end[0] != key[0] for q in qs]
            whole = np.repeat(self.home[None], len(rivals), axis=0)
            for row, ((arm, _), q) in zip(whole, rivals, strict=True):
                row[self.group.indices(arm)] = q
            shares: dict[tuple[str, str], float] = {}
            for q in configurations:
                whole[:, self.group.indices(key[0])] = q
                for (end, _), free in zip(rivals, checker.is_free_batch(whole).tolist(), strict=True):
                    share = (not free) / len(configurations) / len(ends[end])
                    shares[end] = shares.get(end, 0.0) + share
            self.meetings[key] = shares

    def allocation(self) -> tuple[str, ...]:
        """The arm of each pick, empty for those that are left out, so that the largest time of an arm is short."""
        out = {left.name for left in self.left_out}
        units = list(dict.fromkeys(tuple(sorted(tied - out)) for tied in self.tied.values()))
        units, arms = [unit for unit in units if unit], list(self.costs)
        cost = np.array([[sum(self.costs[arm][name] for name in unit) for arm in arms] for unit in units])
        meet = np.zeros((len(units), len(arms)) * 2)
        unit_of = {name: k for k, unit in enumerate(units) for name in unit}
        for (arm, name), others in self.meetings.items():
            for (rival, pick), share in others.items():
                if name in unit_of and pick in unit_of:
                    weight = 1.0 / len(units[unit_of[name]]) / len(units[unit_of[pick]])
                    meet[unit_of[name], arms.index(arm), unit_of[pick], arms.index(rival)] += share * weight
        chosen = balanced(cost.reshape(len(units), len(arms)), meet)
        of = {name: arms[k] for unit, k in zip(units, chosen, strict=True) for name in unit}
        return tuple(of.get(pick.name, "") for pick in self.picks)

    def shortest(self) -> tuple[Timing, dict[str, SequenceResult]]:
        """The allocation with the shortest certified time of several, and its sequences."""
        seen: set[tuple[str, ...]] = set()
        tried: list[tuple[Timing, dict[str, SequenceResult]]] = []
        for _ in range(ROUNDS):
            chosen = self.allocation()
            if chosen in seen:
                break
            seen.add(chosen)
            try:
                results = self.sequences(chosen)
            except (InputError, NoAnswer):  # this allocation is not possible, but one before it may be
                if not tried:
                    raise
                break
            tried.append((time_together(self.apart, self.home, results, self.order), results))

        def worth(timing: Timing, results: Mapping[str, SequenceResult]) -> tuple[bool, int, float]:
            left_out = sum(len(result.left_out) for result in results.values())
            return not timing.free, left_out, timing.trajectory.duration

        return min(tried, key=lambda pair: worth(*pair))

    # -- the programs -------------------------------------------------------------------------------------------------

    def sequences(self, chosen: tuple[str, ...]) -> dict[str, SequenceResult]:
        """The sequence of each arm that has a pick; the costs are then scaled to the certified times."""
        results = {}
        for number, arm in enumerate(self.setups):
            self.progress("sequences", number, len(self.setups))
            own = [pick for pick, of in zip(self.picks, chosen, strict=True) if of == arm]
            if not own:
                continue
            # the parts of the other arms are obstacles at their places too
            others = [
                self.jobs[of, pick.name] for pick, of in zip(self.picks, chosen, strict=True) if of not in ("", arm)
            ]
            placed = [(part, k) for job in others for k, part in enumerate(job.places)]
            parts = [replace(part, name=f"{part.name}{AT_PLACE}{f' {k}' if k else ''}") for part, k in placed]
            names = {pick.name for pick in own}
            pairs = [pair for pair in self.order if names.issuperset(pair)]
            results[arm] = self._sequence(self._setup(arm, parts), own, pairs)
            load = sum(self.costs[arm][name] for name in names)
            scale = results[arm].duration / load if load > 0.0 else 1.0  # picks at home need no motion
            self.costs[arm] = {name: cost * scale for name, cost in self.costs[arm].items()}
        self.progress("sequences", len(self.setups), len(self.setups))
        return results

    def _sequence(self, setup: PickSetup, picks: Sequence[Pick], pairs: Sequence[tuple[str, str]]) -> SequenceResult:
        grip, release = self.dwell
        return sequence(setup, picks, precedence=pairs, grip_dwell=grip, release_dwell=release, budget=self.budget)

    def alone(self, arm: str) -> OneArm:
        """The sequence of all picks by one arm, with the others at home."""
        self.progress("one arm", list(self.setups).index(arm), len(self.setups))
        try:
            result = self._sequence(self.setups[arm], tuple(self.picks), self.order)
        except (InputError, NoAnswer) as error:  # the arm may have no tool for some of the parts
            return OneArm(arm, None, str(error))
        if not result.ok:
            missing = result.left_out
            return OneArm(arm, None, f"{len(missing)} picks left out; {missing[0].name}: {missing[0].reason}")
        return OneArm(arm, result.duration, "")


def balanced(cost: Array, meet: Array) -> list[int]:
    """For each unit (row) the arm (column), so that the largest load of an arm is small.

    The load of an arm is the sum of its costs, each increased by the share of the other arms' units at which they meet.
    Each unit starts with its cheapest arm. A unit is then given to another arm, or two of different arms are exchanged,
    as long as this reduces the largest load; of all such changes, the best is made.

    ``cost`` (U, A) are seconds, infinite where the arm cannot; ``meet`` (U, A, U, A) is the share of collisions of a
    unit of an arm with one of another arm.
    """
    units, arms = np.arange(len(cost)), range(cost.shape[1] if len(cost) else 0)

    def load(chosen: npt.NDArray[np.intp]) -> float:
        apart = chosen[:, None] != chosen
        met = (meet[units[:, None], chosen[:, None], units, chosen] * apart).sum(axis=1)
        seconds = cost[units, chosen] * (1.0 + CROWDED * met / np.maximum(apart.sum(axis=1), 1))
        loads = [float(seconds[chosen == arm].sum()) for arm in arms]
        return max(loads) + TOTAL * sum(loads)

    if not len(cost):
        return []
    # each unit starts with its cheapest arm
    chosen = (cost * (1.0 + CROWDED * meet.mean(axis=(2, 3)))).argmin(axis=1)
    best = load(chosen)
    while True:
        # every unit to another arm, and exchanges of two units of different arms
        changes: list[tuple[tuple[int, int], ...]]
        changes = [((unit, arm),) for unit in range(len(cost)) for arm in arms if arm != chosen[unit]]
        pairs = [(a, b) for a in range(len(cost)) for b in range(a) if chosen[a] != chosen[b]]
        changes += [((a, chosen[b]), (b, chosen[a])) for a, b in pairs[:: -(-len(pairs) // EXCHANGES) or 1]]
        # the best change is made if it saves enough
        tried = []
        for change in changes:
            changed = chosen.copy()
            for unit, arm in change:
                changed[unit] = arm
            tried.append((load(changed) if np.isfinite(cost[units, changed]).all() else np.inf, changed))
        value, changed = min(tried, key=lambda trial: trial[0], default=(np.inf, chosen))
        if value > (1.0 - GAIN) * best:
            return list(map(int, chosen))
        best, chosen = value, changed
