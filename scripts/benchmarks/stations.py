"""Stations of several arms as published by others: motions planned together, coordinated, certified and audited.

The stations are described by the numbers that their authors publish: P. Huang, Y. Shaoul, J. Li (2025), "Benchmarking
Shortcutting Techniques for Multi-Robot-Arm Motion Planning", arXiv 2508.05027, for the Pandas on a table of 2 m. The
two iiwa arms are the robots of A. Amice, P. Werner, R. Tedrake (2023), arXiv 2310.16603, who certify edges of them.
Starts and goals are ours: random free configurations of all arms whose straight connection is in collision.
"""

from __future__ import annotations

from collections.abc import Iterator
from time import process_time

import numpy as np

import pinproof as pp
from benchmarks.planning_problems import PlanProblem
from benchmarks.tables import Row
from pinproof.collision import audit, is_proven_free
from pinproof.errors import NoAnswer
from pinproof.model import JointGroup
from pinproof.planning import plan_arms

TABLE, TOP = 2.0, 0.1
"""Side of the table and height of the bases in m."""

GAP = 0.002
"""The table ends this far (m) below the bases, which would touch it."""

CORNERS = {"a": (0.4, -0.4, 2.28), "b": (-0.4, -0.4, 0.66), "c": (-0.4, 0.4, -0.66), "d": (0.4, 0.4, -2.28)}
"""x and y (m) and yaw (rad) of the four Pandas."""

SIDES = {"a": (0.4, 0.0, np.pi), "b": (-0.4, 0.0, 0.0)}
"""The same of the two Pandas, and of the two iiwa arms, whose distance is not published."""

RANDOM, NARROW = 20_000, 0.6
"""Configurations that are tried for starts and goals, within this part of the joint ranges about their middle."""

AUDIT_STEP = 0.005
"""Largest joint motion (rad) between samples at which a motion is checked on exact meshes."""


def stations() -> dict[str, tuple[JointGroup, pp.Scene]]:
    """The joint group and the scene of each station by name."""
    panda, iiwa = pp.load_robot("panda").arm(), pp.load_robot("iiwa14").arm()
    table = pp.Obstacle("table", pp.Box(TABLE, TABLE, TOP - GAP), pp.pose(xyz=(0, 0, (TOP - GAP) / 2)))
    bare = pp.Scene([table])
    return {
        "two iiwa14": (_assembled(iiwa, SIDES, 0.0), pp.Scene()),
        "two Pandas": (_assembled(panda, SIDES, TOP), bare),
        "four Pandas": (_assembled(panda, CORNERS, TOP), bare),
    }


def _assembled(arm: pp.Arm, places: dict[str, tuple[float, float, float]], height: float) -> JointGroup:
    at = {name: pp.pose(xyz=(x, y, height), rpy=(0, 0, yaw)) for name, (x, y, yaw) in places.items()}
    return pp.assemble({name: (arm, pose) for name, pose in at.items()})


def station_problems(count: int, seed: int) -> Iterator[PlanProblem]:
    """Generate this number of problems for each station; each depends on the seed only."""
    for name, (group, scene) in stations().items():
        checker = pp.CollisionChecker(group, scene, trust_disabled=True)
        lower, upper = group.limits.sampling_range()
        middle, half = (lower + upper) / 2, NARROW * (upper - lower) / 2
        q = np.random.default_rng(seed).uniform(middle - half, middle + half, (RANDOM, group.dof))
        free = q[checker.is_free_batch(q)]
        number = 0
        for start, goal in zip(free[:-1:2], free[1::2], strict=False):
            if number == count:
                break
            if not is_proven_free(pp.JointPath(np.array([start, goal]), group.joint_names), checker):
                number += 1
                yield PlanProblem("stations", name, number, group, scene, start, goal[None])


def coordinated(problem: PlanProblem, seed: int) -> Row:
    """The motion of :func:`pinproof.planning.plan_arms`: planned together, or one after the other with waits."""
    checker = pp.CollisionChecker(problem.group, problem.scene, trust_disabled=True)
    begin = process_time()
    try:
        result = plan_arms(checker, problem.start, problem.goals, rng=seed)
    except NoAnswer as error:
        return Row(station=problem.set_name, ok=False, message=str(error), seconds=process_time() - begin, wrong=[])
    seconds = process_time() - begin
    meshes = pp.CollisionChecker(problem.group, problem.scene, trust_disabled=True, link_meshes="surface")
    found = audit(result.trajectory, meshes, step=AUDIT_STEP, measure=False)
    return Row(
        station=problem.set_name,
        ok=result.certificate.free,
        message=result.message,
        seconds=seconds,
        duration=result.trajectory.duration,
        wrong=[] if found.clean else [f"{problem.name}: {found.message}"],
    )
