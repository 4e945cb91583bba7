"""One pick, judged stage by stage: reach, limits, grasp, approach, retreat, transit, motion.

Every configuration found at the grasp is tried; all that pass approach and retreat are goals of one transit plan. If
none passes, the verdict tells of the configuration that came farthest.

What is picked is not carried: it stands in the scene, if it is there, before the grasp and after it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, certify
from pinproof.collision.certificate import proven_millimetres
from pinproof.collision.contact import CheckResult
from pinproof.errors import TimingError
from pinproof.ik import Clik
from pinproof.model import Arm, JointLimits
from pinproof.motion import CubicPath, Trajectory, time_parametrise
from pinproof.picks.pick import Pick, Picks
from pinproof.picks.verdict import PickStatus, PickVerdict, Stage, StageResult
from pinproof.planning import LinearMove, RrtConnect, plan_linear, shortcut
from pinproof.planning.goals import with_turns
from pinproof.spatial import SE3

__all__ = ["contact_words", "judge"]

Array = npt.NDArray[np.float64]

CONFIGURATIONS = 8
"""How many different configurations at a grasp are looked for."""

ATTEMPTS = 64
"""From how many starts."""

TURN = 2 * np.pi

TRANSIT = RrtConnect(max_nodes=4000, time_limit=600.0)
"""The budget of a transit is its nodes: the same pick gets the same verdict on a slow machine."""


@dataclass(frozen=True, eq=False)
class _Way:
    """A configuration at the grasp, as far as it came."""

    q: Array
    stages: tuple[StageResult, ...]
    approach: CubicPath | None = None  # from the grasp outwards
    retreat: CubicPath | None = None

    @property
    def entrance(self) -> Array:
        """(n,) where the transit ends: the beginning of the approach, or the grasp without one."""
        return self.q if self.approach is None else self.approach.end

    def shifted(self, by: Array) -> _Way:
        """The way with its joints moved by (n,): whole turns, so that nothing else changes."""
        if not by.any():
            return self
        approach, retreat = (
            None if path is None else CubicPath(path.q + by, path.tangents, path.knots, path.joint_names)
            for path in (self.approach, self.retreat)
        )
        return _Way(self.q + by, self.stages, approach, retreat)

    def extremes(self) -> list[Array]:
        """Configurations (n,) that bound every joint along approach and retreat: Bezier control points."""
        paths = [path for path in (self.approach, self.retreat) if path is not None]
        return [self.q, *(point for path in paths for point in path.bezier()[1].reshape(-1, len(self.q)))]

    @property
    def passed(self) -> bool:
        return self.stages[-1].ok


def judge(pick: Pick, picks: Picks, checker: CollisionChecker, home: Array, rng: np.random.Generator) -> PickVerdict:
    """The verdict on one pick.

    Parameters
    ----------
    pick
        The pick.
    picks
        The list it is from: its tip and tool.
    checker
        The arm in its scene, with the tool attached.
    home
        (n,) where the transit starts; free and inside the limits.
    rng
        Where random choices come from.
    """
    arm = checker.arm
    seeds = rng.integers(2**31, size=3).tolist()
    target = picks.tcp_target(pick.pose, arm.root_from_base)
    grasps, stages = _reach(arm, target, home, seeds[0])
    if not grasps:
        return PickVerdict(pick, PickStatus.NOT_FOUND, stages, 0)
    ways = [_along(pick, picks, checker, q, stages) for q in grasps]
    good = [way for way in ways if way.passed]
    if not good:
        best = max(ways, key=lambda way: len(way.stages))
        return PickVerdict(pick, PickStatus.NOT_FOUND, best.stages, len(ways))
    return _with_transit(pick, good, checker, home, seeds[1:], len(ways))


def _reach(arm: Arm, target: SE3, home: Array, seed: int) -> tuple[list[Array], tuple[StageResult, ...]]:
    """Configurations at the grasp, and what is to be said of reach and limits; without any, why there is none.

    Where none is found, the same target is tried with a turn (or half a metre) more on either side of every joint.
    """
    found = Clik().solve_many(arm, target, home, rng=seed, count=CONFIGURATIONS, attempts=ATTEMPTS)
    if len(found):
        return [np.array(q) for q in found.q], _reached(len(found), float(found.position_error.max()))
    nearest = Clik().solve(arm, target, home, rng=seed)  # brings the nearest miss to its end, which may be the target
    if nearest.ok:
        return [np.array(nearest.q)], _reached(1, nearest.position_error)
    limits = arm.limits
    beyond = 2 * np.pi * arm.angular + 0.5 * ~arm.angular
    wide = JointLimits(limits.lower - beyond, limits.upper + beyond, limits.velocity, limits.acceleration)
    free = Clik().solve_many(arm.with_limits(wide), target, home, rng=seed, count=CONFIGURATIONS, attempts=ATTEMPTS)
    if not len(free):
        short = f"{nearest.position_error * 1e3:.1f} mm and {np.degrees(nearest.orientation_error):.1f} deg short"
        return [], (StageResult(Stage.REACH, False, f"out of reach: the nearest configuration found is {short}"),)
    q = min((_turned_inside(arm, q) for q in free.q), key=lambda q: float(np.abs(q - limits.clip(q)).sum()))
    outside = "; ".join(limits.violations(q, arm.joint_names))
    if not outside:
        return [q], _reached(1, float(free.position_error.max()))
    return [], (
        StageResult(Stage.REACH, True, "reachable if limits are left aside"),
        StageResult(Stage.LIMITS, False, f"found only outside the limits: {outside}"),
    )


def _reached(count: int, off: float) -> tuple[StageResult, ...]:
    return (
        StageResult(Stage.REACH, True, f"{_count(count, 'configuration')}, {off:.1e} m off"),
        StageResult(Stage.LIMITS, True, "inside all limits"),
    )


def _turned_inside(arm: Arm, q: Array) -> Array:
    """The same poses, with each joint that is outside its limits inside them where whole turns do it."""
    lower, upper = arm.limits.lower, arm.limits.upper
    turned = q + np.ceil((lower - q) / TURN) * TURN
    return np.where(arm.periodic & ((q < lower) | (q > upper)) & (turned <= upper), turned, q)


def _along(pick: Pick, picks: Picks, checker: CollisionChecker, q: Array, stages: tuple[StageResult, ...]) -> _Way:
    """A configuration judged at the grasp, on the approach and on the retreat."""
    result = checker.check(q)
    if not result.free:
        return _Way(q, (*stages, StageResult(Stage.GRASP, False, "; ".join(contact_words(result)))))
    clearance = proven_millimetres(checker.clearance(q))
    stages = (*stages, StageResult(Stage.GRASP, True, f"free, {clearance} clearance"))
    moves: list[CubicPath | None] = []
    for stage, length, end in (
        (Stage.APPROACH, pick.approach, pick.approach_pose()),
        (Stage.RETREAT, pick.retreat, pick.retreat_pose()),
    ):
        if length == 0:
            moves.append(None)
            stages = (*stages, StageResult(stage, True, "none asked for"))
            continue
        # The approach is planned from the grasp outwards, so that both moves share its configuration to the last bit.
        move = plan_linear(checker, q, picks.tcp_target(end, checker.arm.root_from_base))
        if not move.ok:
            where = f"of {length * 1e3:.0f} mm, seen from the grasp, "
            return _Way(q, (*stages, StageResult(stage, False, where + move.message)))
        moves.append(move.path)
        stages = (*stages, StageResult(stage, True, f"{length * 1e3:.0f} mm straight, {_proven(move)}"))
    return _Way(q, stages, *moves)


def contact_words(result: CheckResult) -> list[str]:
    """One sentence for each two that touch, the deepest first: links have several bodies, and one contact says it."""
    deepest = {contact.bodies: contact for contact in reversed(result.contacts)}
    return [str(contact) for contact in result.contacts if deepest[contact.bodies] is contact]


def _turned(arm: Arm, home: Array, ways: list[_Way]) -> list[_Way]:
    """The ways, and the same poses with joints whole turns away wherever all of the way stays inside the limits."""
    entrances, index_of = with_turns(arm, home, np.array([way.entrance for way in ways]))
    every = []
    for entrance, index in zip(entrances, index_of, strict=True):
        way = ways[index].shifted(entrance - ways[index].entrance)
        if way is ways[index] or all(arm.limits.contains(extreme) for extreme in way.extremes()):
            every.append(way)
    return every


def _with_transit(
    pick: Pick, ways: list[_Way], checker: CollisionChecker, home: Array, seeds: list[int], tried: int
) -> PickVerdict:
    """The first way that home leads to, as one certified motion."""
    ways = _turned(checker.arm, home, ways)
    plan = TRANSIT.plan(checker, home, np.array([way.entrance for way in ways]), rng=seeds[0])
    if plan.path is None or plan.goal is None:
        failed = StageResult(Stage.TRANSIT, False, f"from home: {plan.message}")
        return PickVerdict(pick, PickStatus.NOT_FOUND, (*ways[0].stages, failed), tried)
    way = ways[plan.goal]
    path = shortcut(plan.path, checker, rng=seeds[1])
    stages = (*way.stages, StageResult(Stage.TRANSIT, True, f"{path.length:.2f} rad, {len(path)} waypoints"))
    limits = checker.arm.limits
    try:
        parts = [time_parametrise(path, limits)]
        if way.approach is not None:
            parts.append(time_parametrise(way.approach.reversed(), limits))
        # Joined, not summed: the clock counts nanoseconds, and the grasp shall be a time that the motion has.
        grasp_time = Trajectory.join(*parts).duration
        if way.retreat is not None:
            parts.append(time_parametrise(way.retreat, limits))
        trajectory = Trajectory.join(*parts)
    except TimingError as error:
        failed = StageResult(Stage.MOTION, False, str(error))
        return PickVerdict(pick, PickStatus.NOT_FOUND, (*stages, failed), tried)
    certificate = certify(trajectory, checker)
    if not certificate.free:
        failed = StageResult(Stage.MOTION, False, certificate.message)
        return PickVerdict(pick, PickStatus.NOT_FOUND, (*stages, failed), tried)
    proven = StageResult(Stage.MOTION, True, f"proven free over {_count(certificate.pairs, 'pair')} of bodies")
    return PickVerdict(pick, PickStatus.GOOD, (*stages, proven), tried, way.q, trajectory, grasp_time, certificate)


def _proven(move: LinearMove) -> str:
    return "" if move.certificate is None else f"{proven_millimetres(move.certificate.clearance)} clearance proven"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
