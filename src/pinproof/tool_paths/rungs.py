"""The rungs of a ladder graph: all configurations of an arm at the poses of a tool path, and the best sequence of them.

A rung is a pose of the route on which the tool moves. Its nodes are the IK solutions of that pose for each rotation of
the tool about its axis, each tilt, and each value of a redundant joint, within the limits and free of contact. The core
(``src/core/planning/ladder.h``) finds the cheapest sequence of nodes by dynamic programming.

A joint that can rotate by more than a full revolution has several windings for each solution. They are not separate
nodes: its steps are compared modulo 2 pi. If the optimum then fits into the limits with one of the windings at the
start, it is the optimum over all windings too, because the windings were a relaxation. Otherwise the windings of the
joint that does not fit become separate nodes, and the search is repeated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product

import numpy as np
import numpy.typing as npt

from pinproof._core import Ladder
from pinproof.collision import CollisionChecker
from pinproof.common.steps import step
from pinproof.common.structs import key, struct
from pinproof.description import with_spin
from pinproof.errors import InputError, NoClosedForm, UnknownNameError
from pinproof.ik import AnalyticIk, Clik, IkTask
from pinproof.model import AT_LIMIT, Arm, JointGroup
from pinproof.planning import Route
from pinproof.spatial import Array, finite

TURN = 2.0 * np.pi
# Number of different configurations that are searched for at each pose and rotation if the arm has no closed form.
SAMPLED = 8
# M: distance of bodies at which half of the cost of the clearance is reached.
CLEARANCE = 0.02
# Smallest singular value at which half of the cost of singularities is reached: 10 rad/s of a joint for 1 m/s.
SINGULAR = 0.1
# Number of values of a redundant joint by default, and largest number of combinations of values of several.
REDUNDANT, MOST_VALUES = 24, 20_000
# Smallest singular value of the position and the axis of the tool with which an arm cannot rotate the tool alone, and
# the number of configurations at which it is computed. Axes that differ by the rounding of a description, such as
# 1.5708 for pi/2, count as parallel.
NO_ROTATION, COMPARED = 1e-5, 8
# Rad: a rotation of the tool at an end of its range is in it, up to the accuracy of the closed form.
AT_END = 1e-6
COUPLED = "the joints of the arm also move the frame of the path"
# The link behind the virtual joint of an arm that cannot choose the rotation of the tool.
SPIN = "tool_rotation"
# Least duration (s) between rungs for the cost of the effort.
SHORTEST = 1e-3

Flags = npt.NDArray[np.bool_]


@struct("costs", kw_only=True)
class FollowCosts:
    """The weights of the cost of a motion along a tool path, which is in seconds if they are 1.

    With the shares r of the velocity limits that the joints use, the cost is the integral over the time at tool speed
    of the weighted sum of these terms. A term that is not computed for weight 0 costs time otherwise.
    """

    time: float = key("1, and more where a joint is too slow for the speed of the tool", default=1.0, minimum=0)
    travel: float = key("the sum of r over the joints", default=0.1, minimum=0)
    effort: float = key("the sum of r^2 over the joints, which makes motions even", default=1.0, minimum=0)
    limits: float = key(
        "the largest square over the joints of the distance from the middle of the range divided by half of the range; "
        "joints that can rotate by more than a full revolution do not count",
        default=0.0,
        minimum=0,
    )
    singularity: float = key("s / (s + w), with the smallest singular value w of the Jacobian", default=0.0, minimum=0)
    clearance: float = key("20 mm / (20 mm + d), with the distance d of the closest bodies", default=0.0, minimum=0)


COSTS = {
    "balanced": FollowCosts(),
    "time": FollowCosts(travel=0.0, effort=1e-3),
    "travel": FollowCosts(time=0.1, travel=1.0, effort=1e-3),
    "limits": FollowCosts(limits=10.0),
    "singularity": FollowCosts(singularity=10.0),
    "clearance": FollowCosts(clearance=10.0),
}
"""The costs that have a name."""


@dataclass(frozen=True, eq=False)
class PathArm:
    """An arm as seen from the frame of a path, and the arm whose inverse kinematics are solved.

    ``arm`` has the joints of the checker in the same order, and its poses are those of the tool in the frame of the
    path. ``solved`` leads from its own base to the tool: the other joints, ``external``, move the frame of the path
    relative to that base. ``coupled`` states that its own joints move that frame too, with followers (mimic): then the
    targets of a closed form are unknown. ``spun`` is the same with a virtual joint about the axis of the tool, if it is
    needed, and ``spin`` the range (rad) of the rotation of the tool, if it is limited.
    """

    arm: Arm
    solved: Arm
    external: tuple[int, ...] = ()
    coupled: bool = False
    spun: Arm | None = None
    spin: tuple[float, float] | None = None

    @classmethod
    def of(cls, group: JointGroup, frame: str | None = None, name: str | None = None) -> PathArm:
        """The arm of this name in a joint group, by default the first, as seen from a link, by default its own base.

        Raises
        ------
        UnknownNameError, InputError
            As :meth:`pinproof.JointGroup.seen_from`.
        """
        name = next(iter(group.ends)) if name is None else name
        tcp = group.tcp_of(name)
        solved = next(arm for arm in group.arms.values() if arm.tcp == tcp)
        if isinstance(group, Arm) and frame in (None, group.base):
            return cls(group, solved)
        arm = group.seen_from(solved.base if frame is None else frame, name)
        external = tuple(k for k, joint in enumerate(arm.joint_names) if joint not in solved.joint_names)
        own = sum(joint.index not in external for joint in arm.chain.joints)
        return cls(arm, solved, external, own > len(solved.chain.joints))

    def with_spin(self, spin: tuple[float, float] | None) -> PathArm:
        """The same with a virtual joint if the solved arm cannot choose the rotation of the tool about its axis.

        An arm of five joints that reaches a position and an axis has one rotation for each of its solutions. With the
        virtual joint, its closed form finds all of them at any rotation, of which those in a range ``spin`` remain.
        """
        arm = self.solved
        if arm.dof != 5 or self.coupled:
            return self
        lower, upper = arm.limits.sampling_range()
        many = np.random.default_rng(0).uniform(lower, upper, (COMPARED, arm.dof))
        jacobians = np.array([arm.jacobian(q, reference="LOCAL")[:5] for q in many])
        if np.linalg.svd(jacobians, compute_uv=False)[:, -1].max() < NO_ROTATION:
            return self
        limits = dict(zip(arm.joint_names, zip(arm.limits.lower, arm.limits.upper, strict=True), strict=True))
        urdf = with_spin(arm.robot.urdf, SPIN, arm.tcp)
        held = {joint: arm.held[joint] for joint in arm.held if urdf.joints[joint].mimic is None}
        spun = replace(arm.robot, urdf=urdf).arm(SPIN, base=arm.base, limits=limits, held=held)
        return replace(self, spun=spun, spin=spin)

    def base_from_path(self, values: Array) -> Array:
        """(e, 4, 4) the frame of the path in the base of the solved arm at values (e, k) of the external joints."""
        q = np.tile(self.arm.home, (len(values), 1))
        q[:, self.external] = values
        base_from_tcp = self.solved.forward_kinematics_batch(np.delete(q, self.external, axis=1))
        return np.asarray(base_from_tcp @ np.linalg.inv(self.arm.forward_kinematics_batch(q)))

    def solutions(self, places: Array, grid: Grid) -> tuple[Array, Array, Array, Flags]:
        """All IK solutions (m, n) at poses (k, 4, 4) of the path with the values of the grid, one pose after another.

        Also their number (k,), that of solutions outside the limits (k,), and whether they are known to be complete.

        Raises
        ------
        NoClosedForm
            If the solved arm has no closed form, or its joints move the frame of the path.
        """
        if self.coupled:
            raise NoClosedForm(COUPLED)
        values = np.zeros((1, 0)) if grid.external is None else grid.external
        targets = (places[:, None] @ grid.turns[None])[:, :, None]
        if self.arm is not self.solved:
            targets = self.base_from_path(values) @ targets
        count = len(places)
        solved = self.spun if grid.any_rotation and self.spun is not None else self.solved
        if grid.redundant is not None:
            q, number, outside = AnalyticIk().branches_at(solved, targets.reshape(-1, 4, 4), grid.redundant)
            known = np.zeros(len(number), dtype=bool)
        else:
            found = AnalyticIk().solve_all_batch(solved, targets.reshape(-1, 4, 4))
            exists = np.arange(found.q.shape[1]) < found.count[:, None]
            if solved is self.spun and self.spin is not None:  # the tool rotates against the virtual joint
                low, high = self.spin
                exists &= np.remainder(-found.q[:, :, -1] - low + AT_END, TURN) <= high - low + 2.0 * AT_END
            number, q = exists.sum(axis=1), found.q[exists][:, : self.solved.dof]
            outside, known = found.outside, found.complete
        if self.external:
            own, q = q, np.empty((len(q), self.arm.dof))
            q[:, np.delete(np.arange(self.arm.dof), self.external)] = own
            q[:, self.external] = np.repeat(np.tile(values, (len(number) // len(values), 1)), number, axis=0)
        counts, outside = (each.reshape(count, -1).sum(axis=1) for each in (number, outside))
        complete = known.reshape(count, -1).all(axis=1) & (not self.external)
        return q, counts, outside, np.asarray(complete)


@dataclass(frozen=True, eq=False)
class Grid:
    """The values over which the nodes of a rung are computed.

    ``rotations`` (k,) are angles (rad) about the axis of the tool, ``tilts`` (m, 3, 3) rotations of the tool that come
    before, ``own`` the values of each redundant joint of the solved arm, and ``others`` those of each external joint.
    ``any_rotation`` states that an arm with a virtual joint about the axis of the tool is solved at all rotations, of
    which ``rotations`` then has one.
    """

    rotations: Array
    tilts: Array
    own: tuple[Array, ...] = ()
    others: tuple[Array, ...] = ()
    any_rotation: bool = False

    @cached_property
    def redundant(self) -> Array | None:
        """(v,) values of the redundant joint of the solved arm, (v, 2) of two joints, None for an arm without one."""
        return self.own[0] if len(self.own) == 1 else _combined(self.own)

    @cached_property
    def external(self) -> Array | None:
        """(e, j) values of the external joints."""
        return _combined(self.others)

    def finer(self) -> Grid | None:
        """The grid with the middles between its values too; None if it has none, or too many combinations of them."""

        def halved(values: Array) -> Array:
            return np.union1d(values, 0.5 * (values[1:] + values[:-1]))

        count = len(self.rotations)
        around = np.append(self.rotations, self.rotations[:1] + TURN)
        closed = count > 1 and np.ptp(np.diff(around)) < AT_END  # over a full revolution
        rotations = halved(around)[:-1] if closed else halved(self.rotations)
        own, others = tuple(map(halved, self.own)), tuple(map(halved, self.others))
        values = math.prod(map(len, (*own, *others)))
        if values > MOST_VALUES or len(rotations) * values == count * math.prod(map(len, (*self.own, *self.others))):
            return None
        return replace(self, rotations=rotations, own=own, others=others)

    @cached_property
    def turns(self) -> Array:
        """(m k, 4, 4) the poses of the tcp in the frame of a pose of the route."""
        cosine, sine, zero = np.cos(self.rotations), np.sin(self.rotations), np.zeros_like(self.rotations)
        spin = np.array([[cosine, -sine, zero], [sine, cosine, zero], [zero, zero, zero + 1.0]]).transpose(2, 0, 1)
        turns = np.tile(np.eye(4), (len(self.tilts) * len(spin), 1, 1))
        turns[:, :3, :3] = (self.tilts[:, None] @ spin[None]).reshape(-1, 3, 3)
        return turns


def redundant_axes(
    path_arm: PathArm, values: int | Mapping[str, npt.ArrayLike]
) -> tuple[tuple[int, ...], tuple[Array, ...], tuple[Array, ...]]:
    """The redundant and external joints, and the values of each, as :class:`Grid` has them.

    ``values`` is their number, or the values of joints by name. By default, those of a joint are evenly over its
    limits, and over one revolution if it can rotate by more.

    Raises
    ------
    NoClosedForm
        If the arm has no closed form, or its joints move the frame of the path.
    InputError
        If values are stated for another joint, are outside its limits, or there are too many combinations.
    """
    arm, solved = path_arm.arm, path_arm.solved
    if path_arm.coupled:
        raise NoClosedForm(COUPLED)
    own = [arm.joint_names.index(solved.joint_names[joint]) for joint in AnalyticIk().redundant_joints(solved)]
    joints = (*own, *path_arm.external)
    names = [arm.joint_names[joint] for joint in joints]
    stated = values if isinstance(values, Mapping) else {}
    lower, upper = arm.limits.sampling_range()
    axes = []
    for joint, name in zip(joints, names, strict=True):
        low, high, count = lower[joint], upper[joint], values if isinstance(values, int) else REDUNDANT
        axis = np.linspace(low, high, count)
        if arm.periodic[joint] and high - low >= TURN:
            axis = np.clip(0.5 * (low + high) - np.pi, low, high - TURN) + TURN * np.arange(count) / count
        if name in stated:
            axis = np.unique(finite(f"redundant[{name!r}]", np.atleast_1d(np.asarray(stated[name])), (None,)))
            if not len(axis) or axis[0] < arm.limits.lower[joint] or axis[-1] > arm.limits.upper[joint]:
                raise InputError(
                    f"redundant[{name!r}] must have values from {arm.limits.lower[joint]:g} to "
                    f"{arm.limits.upper[joint]:g}, the limits of the joint"
                )
        axes.append(axis)
    if unknown := [name for name in stated if name not in names]:
        raise UnknownNameError("redundant joint", unknown[0], names)
    if (combinations := math.prod(map(len, axes))) > MOST_VALUES:
        raise InputError(
            f"the joints {', '.join(names)} have {combinations:,} combinations of values, and at most {MOST_VALUES:,} "
            "are compared; state fewer values with redundant, or hold some of the joints"
        )
    return joints, tuple(axes[: len(own)]), tuple(axes[len(own) :])


def _combined(axes: tuple[Array, ...]) -> Array | None:
    """(v, k) all combinations of the values of k axes, None without one."""
    return np.array(list(product(*axes))) if axes else None


@dataclass(eq=False)
class Rung:
    """A pose of a route with its nodes; ``at`` is the index of the pose of the path, a fraction between two poses.

    ``q`` (m, n) are all IK solutions within the limits, and ``free`` (m,) states which of them have no contact.
    ``outside`` solutions exist outside the limits. ``complete`` states that no other solution exists at the rotations
    and tilts of the grid. ``removed`` are the edges to the next rung, as pairs of rows of :attr:`nodes`, along which no
    curve was found. A rung that is ``given`` has one node, whose values are not exchanged for other windings.
    """

    route: int
    s: float
    place: Array
    at: float
    q: Array = field(default_factory=lambda: np.empty((0, 0)))
    free: Flags = field(default_factory=lambda: np.empty(0, dtype=bool))
    outside: int = 0
    complete: bool = False
    rates: Array = field(default_factory=lambda: np.empty(0))  # (k,) the costs of the nodes per second
    removed: list[tuple[int, int]] = field(default_factory=list)
    given: bool = False
    avoided: bool = False  # nodes near the starts to avoid are left out

    @property
    def nodes(self) -> Array:
        """(k, n) the nodes without contact."""
        return self.q[self.free]


def fill(
    rungs: list[Rung],
    checker: CollisionChecker,
    path_arm: PathArm,
    grid: Grid,
    task: IkTask,
    costs: FollowCosts,
    rng: int,
    *,
    ranged: bool = False,
) -> None:
    """Compute the nodes of rungs; ``ranged`` states that the rotation of the tool is free only in a range."""
    arm, turns, count = path_arm.arm, grid.turns, len(rungs)
    places = np.array([rung.place for rung in rungs]).reshape(-1, 4, 4)
    try:
        q, counts, outside, complete = path_arm.solutions(places, grid)
    except NoClosedForm:
        # Different solutions from random starts; a rotation that is free without a range is left to the search
        if task != IkTask():
            turns, task = (turns, IkTask()) if ranged else (turns[:: len(grid.rotations)], task)
        solver = Clik(restarts=SAMPLED)
        many = [
            solver.solve_many(arm, place @ change, rng=rng, count=SAMPLED, task=task).q
            for place in places
            for change in turns
        ]
        q = np.concatenate(many)
        counts = np.array([len(part) for part in many]).reshape(count, -1).sum(axis=1)
        outside, complete = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=bool)
    free = np.asarray(checker.is_free_batch(q), dtype=bool) if len(q) else np.empty(0, dtype=bool)
    rates, start = rates_of(checker, arm, q[free], costs), 0
    for number, rung in enumerate(rungs):
        rows = slice(start, start := start + int(counts[number]))
        first = int(free[: rows.start].sum())
        rung.q, rung.free = q[rows], free[rows]
        rung.rates = rates[first : first + int(rung.free.sum())]
        rung.outside, rung.complete = int(outside[number]), bool(complete[number])


def rates_of(checker: CollisionChecker, arm: Arm, q: Array, costs: FollowCosts) -> Array:
    """(N,) the costs per second of configurations (N, n) by themselves."""
    limits, total = arm.limits, np.zeros(len(q))
    if not len(q):
        return total
    if costs.limits:
        span = limits.upper - limits.lower
        counted = np.isfinite(span) & ~_wide(arm)
        offset = 2.0 * (q - 0.5 * (limits.lower + limits.upper))[:, counted] / span[counted]
        total += costs.limits * (offset**2).max(axis=1, initial=0.0)
    if costs.singularity:
        values = np.linalg.svd(arm.jacobian_batch(q), compute_uv=False)[:, -1]
        total += costs.singularity * SINGULAR / (SINGULAR + values)
    if costs.clearance:
        distance = np.maximum(checker.clearance_batch(q), 0.0)
        total += costs.clearance * CLEARANCE / (CLEARANCE + distance)
    return total


def _wide(arm: Arm) -> Flags:
    """(n,) which joints can rotate by more than a full revolution."""
    return np.asarray(arm.periodic & ~(arm.limits.upper - arm.limits.lower <= TURN))


@dataclass(frozen=True, eq=False)
class LadderSettings:
    """How rungs are connected; see :func:`pinproof.follow`.

    A step from rung to rung is within reach if the joints can make it while the tool moves at its speed times
    ``slowest``, or in ``steps`` (s), which permits a step of the grid. No joint moves farther than ``jump`` (n,).
    ``finest`` (rad) is the size of a step of the grid; it is 0 if the grid has no free values.
    """

    costs: FollowCosts
    steps: float
    slowest: float
    jump: Array
    finest: float = 0.0


@dataclass(frozen=True, eq=False)
class Course:
    """The best sequence from one rung to the farthest one: q (k, n), its cost, and the nodes that can be reached last.

    ``nodes`` (k,) are the rows of :attr:`Rung.nodes`, ``reachable`` (r, n) configurations of the last rung, and
    ``others`` the best sequences to some of these.
    """

    q: Array
    nodes: npt.NDArray[np.int64]
    cost: float
    reachable: Array
    others: tuple[Course, ...] = ()


class RungLadder:
    """The ladder graph over rungs.

    ``durations`` (R - 1,) are the times (s) between the rungs at the speed of the tool, ``timed`` (R - 1,) states for
    which of them a speed is stated.
    """

    def __init__(self, arm: Arm, rungs: list[Rung], durations: Array, timed: Flags, settings: LadderSettings) -> None:
        self.arm, self._rungs, self._settings = arm, rungs, settings
        self.durations, self.timed = durations, timed
        self._wide = _wide(arm)  # the joints with several windings
        self._split: list[int] = []  # the joints whose windings are separate nodes
        self._build()

    @step("optimum")
    def solve(self, first: int, last: int, others: int = 0, apart: float = 0.0) -> Course:
        """The cheapest sequence from one rung to another one, or to the farthest before it, within all limits.

        Also those to ``others`` last configurations, which differ by more than ``apart`` in two joints.
        """
        given = self._rungs[first].given
        while True:
            found = self._ladder.solve(first, last, others, apart)
            q, misfit = self._unwound(self._q[found.nodes], given=given)
            if misfit is None:
                ends = self._q[found.reachable]
                more = [(*self._unwound(self._q[own.nodes], given=given), own) for own in found.others]
                courses = (Course(row, self._node[own.nodes], own.cost, ends) for row, bad, own in more if bad is None)
                return Course(q, self._node[found.nodes], found.cost, ends, tuple(courses))
            self._split.append(misfit)
            self._build()

    def _build(self) -> None:
        """The graph, with a node for each winding of the joints that are split."""
        arm, limits = self.arm, self.arm.limits
        parts, nodes = [], []
        for rung in self._rungs:
            q, node = rung.nodes, np.arange(len(rung.rates))
            for joint in self._split if len(q) and not rung.given else ():
                value = q[:, joint]
                fewest = int(np.ceil((limits.lower[joint] - AT_LIMIT - value.max()) / TURN))
                most = int(np.floor((limits.upper[joint] + AT_LIMIT - value.min()) / TURN))
                windings = [(q + TURN * k * (np.arange(arm.dof) == joint), node) for k in range(fewest, most + 1)]
                q, node = (np.concatenate(both) for both in zip(*windings, strict=True))
                inside = np.abs(limits.clip(q) - q)[:, joint] <= AT_LIMIT
                q, node = q[inside], node[inside]
            parts.append(q.reshape(-1, arm.dof))
            nodes.append(node)
        counts = np.array([len(part) for part in parts], dtype=np.int64)
        self._q, self._node = np.ascontiguousarray(np.concatenate(parts)), np.concatenate(nodes)
        rates = np.concatenate([rung.rates[node] for rung, node in zip(self._rungs, nodes, strict=True)])
        period = np.where(self._wide, TURN, 0.0)
        period[self._split] = 0.0
        self._ladder = ladder_of(arm, counts, self._q, rates, period, self.durations, self.timed, self._settings)
        starts = np.concatenate([[0], np.cumsum(counts)])
        for number, rung in enumerate(self._rungs):
            for edge in rung.removed:
                windings = [
                    (starts[number + end] + np.flatnonzero(nodes[number + end] == node)).tolist()
                    for end, node in enumerate(edge)
                ]
                for here, there in product(*windings):
                    self._ladder.remove(here, there)

    def _unwound(self, q: Array, *, given: bool) -> tuple[Array, int | None]:
        """The sequence (k, n) with the shortest steps of the joints with several windings, within the limits.

        If its first configuration is ``given``, its windings are kept. The second result is a joint that does not fit
        into its limits with any winding, if there is one.
        """
        q, limits = q.copy(), self.arm.limits
        for joint in np.flatnonzero(self._wide).tolist() if len(q) else ():
            if joint in self._split:
                continue
            steps = np.diff(q[:, joint])
            q[1:, joint] = q[0, joint] + np.cumsum(steps - TURN * np.round(steps / TURN))
            low, high = float(q[:, joint].min()), float(q[:, joint].max())
            if not np.isfinite(limits.upper[joint] - limits.lower[joint]):
                continue
            fewest = np.ceil((limits.lower[joint] - AT_LIMIT - low) / TURN)
            most = np.floor((limits.upper[joint] + AT_LIMIT - high) / TURN)
            if given:
                fewest, most = max(fewest, 0.0), min(most, 0.0)
            if fewest > most:
                return q, joint
            # The winding that keeps the joint closest to the middle of its range
            middle = 0.5 * (limits.lower[joint] + limits.upper[joint] - low - high)
            q[:, joint] += TURN * np.clip(np.round(middle / TURN), fewest, most)
        return limits.clip(q), None


def ladder_of(
    arm: Arm,
    counts: npt.NDArray[np.int64],
    q: Array,
    rates: Array,
    period: Array,
    durations: Array,
    timed: Flags,
    settings: LadderSettings,
) -> Ladder:
    """The graph over rungs with ``counts`` (R,) of the nodes q (N, n), whose costs per second are ``rates`` (N,).

    Steps of joints with a ``period`` (n,), which is 0 for the others, are compared modulo it.
    """
    share = np.zeros(len(counts))  # the time that belongs to each rung
    share[:-1] += 0.5 * durations
    share[1:] += 0.5 * durations
    speed = np.where(np.isfinite(arm.limits.velocity), arm.limits.velocity, 1.0)
    seconds = np.where(timed, durations / settings.slowest, np.inf)
    reach = np.minimum(speed * np.maximum(seconds, settings.steps)[:, None], settings.jump)
    return Ladder(
        counts, q, rates * np.repeat(share, counts), period, speed, np.ascontiguousarray(reach),
        np.where(timed, durations, 0.0), np.maximum(durations, SHORTEST),
        time=settings.costs.time, travel=settings.costs.travel, effort=settings.costs.effort,
    )  # fmt: skip


def rungs_of(routes: list[Route], first: float, step: float, angle: float) -> list[Rung]:
    """The rungs of routes that follow one another: the poses that they pass, and more where these are farther apart.

    ``first`` is the index of the pose at which the first route begins. Two rungs are at most ``step`` (m) and ``angle``
    (rad) apart. A route ends where the next one begins, which is one rung.
    """
    rungs, at = [Rung(0, 0.0, routes[0].poses(np.zeros(1))[0], first)], first
    for number, route in enumerate(routes):
        begin = 0.0
        for end in route.passes:
            places = route.poses(np.array([begin, end]))
            distance = float(np.linalg.norm(places[1, :3, 3] - places[0, :3, 3]))
            cosine = 0.5 * (np.trace(places[0, :3, :3].T @ places[1, :3, :3]) - 1.0)
            turned = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
            parts = max(1, int(np.ceil(distance / step - 1e-9)), int(np.ceil(turned / angle - 1e-9)))
            shares = np.arange(1, parts + 1) / parts
            parameters = np.append(begin + (end - begin) * shares[:-1], end)
            ats = np.append(at + shares[:-1], at + 1.0)
            rungs += [
                Rung(number, *each)
                for each in zip(parameters.tolist(), route.poses(parameters), ats.tolist(), strict=True)
            ]
            begin, at = end, at + 1.0
    return rungs
