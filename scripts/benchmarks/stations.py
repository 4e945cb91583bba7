"""Stations of several arms as published by others: motions planned together, coordinated, certified and audited.

The stations are described by the numbers that their authors publish: P. Huang, Y. Shaoul, J. Li (2025), "Benchmarking
Shortcutting Techniques for Multi-Robot-Arm Motion Planning", arXiv 2508.05027, for the Pandas on a table of 2 m, and
the URDF of two Yaskawa GP4 in intelligent-control-lab/Robot_Digital_Twin (config/gazebo_dual_gp4.urdf), whose name is
that of their environment. Its meshes are not part of the description here; cylinders of our choice replace them. The
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

GP4_DISTANCE = 0.7951
"""Distance (m) of the bases of the two GP4, which face each other on a table whose top has their height."""

GP4 = (
    ("0 0 0.33", "0 0 1", (-170, 170, 465), (0.075, 0.16, "0 0 0", "1.5708 0 0")),
    ("0 0 0", "0 1 0", (-100, 145, 310), (0.06, 0.26, "0 0.09 0.13", "0 0 0")),
    ("0 0 0.26", "0 -1 0", (-70, 213, 410), (0.065, 0.2, "0.05 0 0.015", "0 1.5708 0")),
    ("0.29 0 0.015", "-1 0 0", (-190, 190, 550), (0.045, 0.12, "-0.07 0 0", "0 1.5708 0")),
    ("0 0 0", "0 -1 0", (-125, 125, 545), (0.035, 0.06, "0 0 0", "1.5708 0 0")),
    ("0 0 0", "-1 0 0", (-360, 360, 1000), (0.025, 0.02, "0.06 0 0", "0 1.5708 0")),
)
"""Of each joint of a GP4: origin, axis, limits (deg, deg, deg/s), and the cylinder of its link: radius and length (m),
place and orientation."""

RANDOM, NARROW = 20_000, 0.6
"""Configurations that are tried for starts and goals, within this part of the joint ranges about their middle."""

AUDIT_STEP = 0.005
"""Largest joint motion (rad) between samples at which a motion is checked on exact meshes."""


def stations() -> dict[str, tuple[JointGroup, pp.Scene]]:
    """The joint group and the scene of each station by name."""
    panda, iiwa = pp.load_robot("panda").arm(), pp.load_robot("iiwa14").arm()
    table = pp.Obstacle("table", pp.Box(TABLE, TABLE, TOP - GAP), pp.pose(xyz=(0, 0, (TOP - GAP) / 2)))
    bare = pp.Scene([table])
    gp4, beside = pp.load_robot(_gp4()).arm(tcp="flange"), {"a": (0.0, 0.0, 0.0), "b": (GP4_DISTANCE, 0.0, np.pi)}
    below = pp.Obstacle("table", pp.Box(TABLE, TABLE, 1.0), pp.pose(xyz=(0, 0, -0.5 - GAP)))
    return {
        "two GP4": (_assembled(gp4, beside, 0.0), pp.Scene([below])),
        "two iiwa14": (_assembled(iiwa, SIDES, 0.0), pp.Scene()),
        "two Pandas": (_assembled(panda, SIDES, TOP), bare),
        "four Pandas": (_assembled(panda, CORNERS, TOP), bare),
    }


def _gp4() -> str:
    """The URDF of a GP4."""
    base = '<geometry><cylinder radius="0.09" length="0.24"/></geometry>'
    text = f'<link name="base_link"><collision><origin xyz="0 0 0.12"/>{base}</collision></link>'
    for number, (place, axis, (lower, upper, velocity), (radius, length, at, rpy)) in enumerate(GP4, 1):
        limits = [
            f'{name}="{np.radians(value)}"'
            for name, value in zip(("lower", "upper", "velocity"), (lower, upper, velocity), strict=True)
        ]
        shape = f'<geometry><cylinder radius="{radius}" length="{length}"/></geometry>'
        parent = f"link_{number - 1}" if number > 1 else "base_link"
        text += (
            f'<link name="link_{number}"><collision><origin xyz="{at}" rpy="{rpy}"/>{shape}</collision></link>'
            f'<joint name="joint_{number}" type="revolute"><parent link="{parent}"/><child link="link_{number}"/>'
            f'<origin xyz="{place}"/><axis xyz="{axis}"/><limit effort="0" {" ".join(limits)}/></joint>'
        )
    flange = '<parent link="link_6"/><child link="flange"/><origin xyz="0.072 0 0"/>'
    return f'<robot name="gp4">{text}<link name="flange"/><joint name="flange" type="fixed">{flange}</joint></robot>'


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
