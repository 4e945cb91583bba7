"""Approach and retreat: the straight lines to a grasp and away from it, with the object in the hand if one is named."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker
from pinproof.collision.certificate import proven_millimetres
from pinproof.motion import CubicPath
from pinproof.picks.stages.grasp import Candidate
from pinproof.picks.stages.task import Task
from pinproof.picks.verdict import Stage, StageResult
from pinproof.planning import LinearMove, plan_linear
from pinproof.spatial import SE3

__all__ = ["Pairs", "Way", "along", "line"]

Array = npt.NDArray[np.float64]
Pairs = tuple[tuple[str, str], ...]


@dataclass(frozen=True, eq=False)
class Way:
    """A configuration at the grasp, as far as it came; both lines lead from the grasp outwards.

    ``parting`` are the pairs of the object and what it stands on, ``shift`` (n,) whole turns that all of it is moved
    by, ``fraction`` how much of the line that failed was possible.
    """

    candidate: Candidate
    stages: tuple[StageResult, ...] = ()
    approach: CubicPath | None = None
    retreat: CubicPath | None = None
    parting: Pairs = ()
    shift: Array = field(default_factory=lambda: np.zeros(1))
    fraction: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether every stage so far is."""
        return self.stages[-1].ok

    @property
    def q(self) -> Array:
        """(n,) at the grasp."""
        return np.asarray(self.candidate.q + self.shift)

    def line_in(self) -> CubicPath | None:
        """From the grasp outwards to where the approach begins; None without one."""
        return shifted(self.approach, self.shift)

    def line_out(self) -> CubicPath | None:
        """From the grasp to the end of the retreat; None without one."""
        return shifted(self.retreat, self.shift)

    @property
    def entrance(self) -> Array:
        """(n,) where the transit ends: the beginning of the approach, or the grasp without one."""
        return self.q if self.approach is None else np.asarray(self.approach.end + self.shift)

    @property
    def exit(self) -> Array:
        """(n,) where the retreat ends, or the grasp without one."""
        return self.q if self.retreat is None else np.asarray(self.retreat.end + self.shift)

    def span(self) -> tuple[Array, Array]:
        """Bounds (n,) of every joint along both lines, without ``shift``: those of Bezier control points."""
        paths = [path for path in (self.approach, self.retreat) if path is not None]
        points = np.vstack([self.candidate.q, *(path.bezier()[1].reshape(-1, len(self.candidate.q)) for path in paths)])
        return points.min(axis=0), points.max(axis=0)


def shifted(path: CubicPath | None, by: Array) -> CubicPath | None:
    """A path with its joints moved by (n,)."""
    if path is None or not by.any():
        return path
    return CubicPath(path.q + by, path.tangents, path.knots, path.joint_names)


def along(task: Task, candidate: Candidate) -> Way:
    """A configuration judged on approach and retreat."""
    pick, member, q = task.pick, candidate.member, candidate.q
    root_from_tip = task.grasp(member)
    stages: list[StageResult] = []
    # The approach is planned from the grasp outwards, so that both moves share its configuration to the last bit.
    result, approach, fraction = line(
        Stage.APPROACH, task, task.at_grasp, q, task.approach_end(root_from_tip), pick.approach
    )
    stages.append(result)
    if not result.ok:
        return Way(candidate, tuple(stages), fraction=fraction)
    carrying = task.carrying(member)
    parting = task.supports(carrying, q, pick.support)
    result, retreat, fraction = line(
        Stage.RETREAT, task, carrying, q, task.retreat_end(root_from_tip), pick.retreat, parting
    )
    stages.append(result)
    shift = np.zeros(task.arm.dof)
    return Way(candidate, tuple(stages), approach, retreat, parting, shift, fraction)


def line(
    stage: Stage,
    task: Task,
    checker: CollisionChecker,
    q: Array,
    end: SE3,
    length: float,
    parting: Pairs = (),
) -> tuple[StageResult, CubicPath | None, float]:
    """A straight line from q (n,) to a pose of the tip; the stage's result, the curve, and how much was possible."""
    if length == 0:
        return StageResult(stage, True, "none asked for"), None, 1.0
    # a support that is not checked against the object needs no leave
    parting = tuple(pair for pair in parting if _is_checked(checker, pair))
    move = plan_linear(checker, q, task.target(end), parting=parting)
    if not move.ok:
        said = f"of {length * 1e3:.0f} mm, seen from the grasp, {move.message}"
        return (
            StageResult(stage, False, said, {"distance": length, "possible": move.fraction * length}),
            None,
            move.fraction,
        )
    said = f"{length * 1e3:.0f} mm straight, {_proven(move)}"
    figures = {"distance": length, "clearance": np.nan if move.certificate is None else move.certificate.clearance}
    return StageResult(stage, True, said, figures), move.path, 1.0


def _is_checked(checker: CollisionChecker, pair: tuple[str, str]) -> bool:
    owners = [(checker.bodies[i].owner, checker.bodies[j].owner) for i, j in checker.pairs]
    return any(set(pair) == set(each) for each in owners)


def _proven(move: LinearMove) -> str:
    if move.certificate is None:
        return ""
    parted = "".join(f", {parting.bodies[0]} off {parting.bodies[1]}" for parting in move.certificate.partings)
    return f"{proven_millimetres(move.certificate.clearance)} clearance proven{parted}"
