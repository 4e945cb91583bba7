"""Parts in two hands: random problems of two UR10e and of a Baxter, each motion checked by Pinocchio and coal."""

from __future__ import annotations

from statistics import median
from time import process_time
from typing import NamedTuple

import numpy as np
import pinocchio as pin

import pinproof as pp
from benchmarks.tables import Row, report
from pinproof.collision import audit
from pinproof.planning import CarryPlan, PlanStatus, plan_carry

SAMPLES = 2000
"""Configurations of each motion at which the deviation of the hands and the velocities are computed."""

AUDIT_STEP = 0.01
"""Largest motion of a joint (rad) between two samples of the independent check for contacts."""

UNPOSED = (PlanStatus.START_INVALID, PlanStatus.GOAL_INVALID, PlanStatus.GOAL_UNREACHABLE)
"""The outcomes of poses at which no free configuration is known: those that are no problem."""


class Carriers(NamedTuple):
    """A cell with a post, the part, and the ranges of its poses on both sides of the post: (2, 6) each."""

    name: str
    checker: pp.CollisionChecker
    part: pp.Obstacle
    grasps: dict[str, pin.SE3]
    start: np.ndarray
    goal: np.ndarray


def carriers() -> list[Carriers]:
    """Two UR10e with a box of 1.2 m, and a Baxter with a tray."""
    ur10e = pp.load_robot("ur10e").arm()
    cell = pp.assemble({"left": (ur10e, pp.pose((0, -0.7, 0))), "right": (ur10e, pp.pose((0, 0.7, 0)))})
    obstacles = [
        pp.Obstacle("floor", pp.Box(4, 4, 0.02), pp.pose((0, 0, -0.02))),
        pp.Obstacle("post", pp.Cylinder(radius=0.06, length=0.5), pp.pose((0.75, 0, 0.25))),
    ]
    scene = pp.Scene(obstacles, allowed=[("left/base_link", "floor"), ("right/base_link", "floor")])
    on_top = {name: pp.pose((0, y, 0.0775), (np.pi, 0, 0)).inverse() for name, y in (("left", -0.45), ("right", 0.45))}
    box = pp.Obstacle("box", pp.Box(0.2, 1.2, 0.15))

    baxter = pp.load_robot("baxter_left").arms()
    obstacles = [
        pp.Obstacle("table", pp.Box(0.5, 1.2, 0.04), pp.pose((0.85, 0, -0.25))),
        pp.Obstacle("post", pp.Cylinder(radius=0.02, length=0.6), pp.pose((0.55, 0, 0.07))),
    ]
    sides = {"left": pp.pose((0, 0.16, 0), (np.pi / 2, 0, 0)), "right": pp.pose((0, -0.16, 0), (-np.pi / 2, 0, 0))}
    tray = pp.Obstacle("tray", pp.Box(0.25, 0.3, 0.06))
    turned = np.array([0.3, 0.3, 0.5])

    def between(low: tuple[float, ...], high: tuple[float, ...], share: float = 1.0) -> np.ndarray:
        return np.array([[*low, *-share * turned], [*high, *share * turned]])

    return [
        Carriers(
            "two UR10e, box of 1.2 m", pp.CollisionChecker(cell, scene, margin=0.002), box, on_top,
            between((0.4, -0.2, 0.2), (0.55, 0.2, 0.4)), between((0.95, -0.2, 0.2), (1.1, 0.2, 0.4)),
        ),
        Carriers(
            "Baxter, tray of 0.3 m",
            pp.CollisionChecker(baxter, pp.Scene(obstacles), margin=0.002, trust_disabled=True), tray,
            {name: pose.inverse() for name, pose in sides.items()},
            between((0.36, -0.1, 0.15), (0.40, 0.1, 0.35), 0.4), between((0.69, -0.1, 0.15), (0.73, 0.1, 0.35), 0.4),
        ),
    ]  # fmt: skip


def carried_rows(problems: int, seed: int) -> list[Row]:
    """So many random problems for each cell that have free configurations at the start and at the goal."""
    return [_measured(cell, problems, seed) for cell in carriers()]


def _measured(cell: Carriers, problems: int, seed: int) -> Row:
    rng = np.random.default_rng(seed)
    seconds, motions, failed, wrong, tried = list[float](), list[CarryPlan](), list[str](), list[str](), 0
    nearness = 0.0
    while len(seconds) < problems:
        tried += 1
        start, goal = (pp.pose(*np.split(rng.uniform(*ranges), 2)) for ranges in (cell.start, cell.goal))
        before = process_time()
        motion = plan_carry(cell.checker, cell.part, cell.grasps, start, goal, rng=tried)
        spent = process_time() - before
        if motion.status in UNPOSED:
            continue
        seconds.append(spent)
        if not motion.ok:
            failed.append(f"{cell.name}, {tried}: {motion.message}")
            continue
        motions.append(motion)
        share, faults = check(motion)
        nearness = max(nearness, share)
        wrong += [f"{cell.name}, {tried}: {fault}" for fault in faults]
        report(f"{cell.name}: {len(seconds)} of {problems}")
    largest = [deviation for motion in motions for deviation in motion.deviations.values()]
    return Row(
        cell=cell.name,
        problems=len(seconds),
        tried=tried,
        found=len(motions),
        seconds=median(seconds),
        most_seconds=max(seconds),
        duration=median(motion.duration for motion in motions),
        position=max(each.position for each in largest),
        rotation=max(each.rotation for each in largest),
        share=nearness,
        failed=failed,
        wrong=wrong,
    )


def check(motion: CarryPlan) -> tuple[float, list[str]]:
    """The largest deviation at samples as a share of the proven bound, and what is wrong with a motion."""
    group, trajectory, leader = motion.checker.group, motion.trajectory, motion.leader
    model, faults, most = group.model, list[str](), 0.0
    data = model.createData()
    frames = {name: model.getFrameId(tcp) for name, (_, tcp) in group.ends.items()}
    t = np.linspace(0.0, trajectory.duration, SAMPLES)
    q = trajectory(t)
    off = {name: np.zeros(2) for name in motion.deviations}
    for each in q:
        pin.framesForwardKinematics(model, data, group.model_configuration(each))
        for name, largest in off.items():
            there = data.oMf[frames[leader]].inverse() * data.oMf[frames[name]]
            placed = motion.grasps[leader] * motion.grasps[name].inverse()
            turned = np.linalg.norm(pin.log3(placed.rotation.T @ there.rotation))
            np.maximum(largest, (np.linalg.norm(there.translation - placed.translation), turned), out=largest)
    for name, proven in motion.deviations.items():
        shares = off[name] / (proven.position, proven.rotation)
        most = max(most, float(shares.max()))
        if most > 1.0:
            faults.append(f"{name} deviates by {off[name]}, {proven} are proven")
    if not group.limits.inside(q).all() or (np.abs(trajectory.velocity(t)) > group.limits.velocity * (1 + 1e-9)).any():
        faults.append("a joint exceeds its limits")
    found = audit(trajectory, motion.checker, step=AUDIT_STEP, measure=False)
    return most, faults if found.clean else [*faults, found.message]
