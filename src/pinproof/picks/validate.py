"""Many picks, judged one by one, here or by any executor."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, Scene
from pinproof.errors import InputError
from pinproof.ik.settings import Rng, seed_sequence
from pinproof.model import Arm
from pinproof.picks.judge import contact_words, judge
from pinproof.picks.pick import Pick, Picks
from pinproof.picks.report import PickReport
from pinproof.picks.verdict import PickVerdict

__all__ = ["validate_picks"]

Array = npt.NDArray[np.float64]


def validate_picks(
    arm: Arm,
    scene: Scene,
    picks: Picks,
    *,
    home: npt.ArrayLike | None = None,
    rng: Rng = 0,
    executor: Executor | None = None,
) -> PickReport:
    """Judge every pick: reachable, inside limits, free at the grasp, straight approach and retreat, transit from home.

    Parameters
    ----------
    arm
        The arm.
    scene
        What stands around it.
    picks
        The picks; their tool is attached to the tcp, their margin is kept.
    home
        (n,) where each transit starts; by default the one of the picks, else the arm's.
    rng
        Seed or Generator. Each pick has a stream of its own by its place in the list, so the answer does not depend on
        the number of workers.
    executor
        Where the picks are judged; by default here, one after another.

    Raises
    ------
    InputError
        If home is outside the limits or in contact (with what), or names joints the arm does not have; or if a joint
        has no velocity limit, without which no motion can be timed.
    """
    _timed_joints(arm)
    checker = CollisionChecker(arm, scene, margin=picks.margin, attached=picks.tool)
    start = arm.configuration(picks.home_configuration(arm.joint_names, arm.home) if home is None else home, "home")
    trouble = [*arm.limits.violations(start, arm.joint_names), *contact_words(checker.check(start))]
    if trouble:
        raise InputError(f"home cannot be a start: {'; '.join(trouble)}")
    streams = seed_sequence(rng).spawn(len(picks))
    jobs = [_Job(pick, picks, checker, start, stream) for pick, stream in zip(picks, streams, strict=True)]
    verdicts = list(map(_run, jobs)) if executor is None else list(executor.map(_run, jobs))
    return PickReport(
        arm.robot.name, tuple(verdicts), picks.problems, arm.limits.acceleration_source, _not_covered(checker)
    )


def _timed_joints(arm: Arm) -> None:
    unknown = [
        name
        for name, *rates in zip(arm.joint_names, arm.limits.velocity, arm.limits.acceleration, strict=True)
        if not np.isfinite(rates).all()
    ]
    if unknown:
        raise InputError(
            f"no motion can be timed: {', '.join(unknown)} states no velocity or acceleration limit; "
            "give the arm limits (robot.arm(limits=JointLimits(...)))"
        )


def _not_covered(checker: CollisionChecker) -> tuple[str, ...]:
    """What a yes says nothing about, so that nobody takes it for more than it is."""
    urdf = checker.arm.robot.urdf
    solid = {geometry.link for geometry in urdf.collisions}
    ghosts = [link for link in dict.fromkeys(geometry.link for geometry in urdf.visuals) if link not in solid]
    notes = ["what is picked is not carried: the way from the grasp on is judged for the empty tool"]
    if not solid:
        notes.append("the robot has no collision geometry: its links touch nothing whatever they meet")
    elif ghosts:
        notes.append(f"links that are drawn but have no collision geometry: {', '.join(ghosts)}")
    if not checker.scene.obstacles:
        notes.append("there is no obstacle: the robot was only judged against itself")
    if checker.hollow:
        notes.append(f"not watertight, so being wholly inside is not seen: {', '.join(checker.hollow)}")
    return tuple(notes)


@dataclass(frozen=True, eq=False)
class _Job:
    """All that one pick's verdict depends on; it pickles."""

    pick: Pick
    picks: Picks
    checker: CollisionChecker
    home: Array
    stream: np.random.SeedSequence


def _run(job: _Job) -> PickVerdict:
    return judge(job.pick, job.picks, job.checker, job.home, np.random.default_rng(job.stream))
