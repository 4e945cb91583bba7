"""Certificates of random timed edges among random movers, and an independent check of every verdict.

The check does not use the joint group of the movers: at dense samples in time it places the arm by Pinocchio and every
obstacle by the formula of its mover, in a coal model of the checker without movers.
"""

from __future__ import annotations

from collections.abc import Sequence
from time import process_time

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from collision_edges import (
    MARGINS,
    TOLERANCE,
    EdgeCase,
    EdgeRow,
    contradiction,
    count_verdicts,
    distributed,
    random_edge,
    random_scene,
)

import pinproof as pp
from pinproof.benchmarks.plan_problems import own_reach

Array = npt.NDArray[np.float64]

ROBOTS = ("ur5", "panda", "generic_6dof")

MOST_MOVERS = 3

FASTEST = 0.8
"""Largest speed of a mover, m/s or rad/s."""

SAMPLE_STEP = 0.02
"""Largest motion of a joint or mover (rad or m) between two samples of the independent check."""


def mover_edge_rows(edges: int, seed: int) -> list[EdgeRow]:
    """Check this number of edges, distributed over :data:`ROBOTS`."""
    return [check_robot(name, count, seed) for name, count in distributed(edges, ROBOTS).items()]


def check_robot(robot: str, edges: int, seed: int) -> EdgeRow:
    """Certify random timed edges of a robot among movers and check the verdicts."""
    arm = pp.load_robot(robot).arm()
    reach, empty = own_reach(arm), pp.CollisionChecker(arm)

    def edges_of_scene(rng: np.random.Generator) -> EdgeCase:
        checker = empty.with_scene(random_scene(rng, reach)).with_margin(float(rng.choice(MARGINS)))
        oracle = Oracle(checker)

        def case() -> tuple[pp.Certificate, float, int, str]:
            trajectory = pp.time_parametrise(random_edge(checker, rng), arm.limits)
            movers = random_movers(checker.scene.names, trajectory.duration, reach, rng)
            begin = process_time()
            certificate = pp.certify(trajectory, checker, movers=movers, tolerance=TOLERANCE)
            return certificate, process_time() - begin, *check_verdict(trajectory, movers, certificate, oracle)

        return case

    return count_verdicts(robot, edges, (seed, 1), edges_of_scene)


def random_movers(names: Sequence[str], duration: float, reach: float, rng: np.random.Generator) -> list[pp.Mover]:
    """Return movers of some of these obstacles, at constant speed or there and back, along or about random axes."""
    owner = rng.integers(-1, MOST_MOVERS, len(names))
    movers = []
    for k in range(MOST_MOVERS):
        moved = [name for name, mover in zip(names, owner.tolist(), strict=True) if mover == k]
        if not moved:
            continue
        kind, axis = ("prismatic", "revolute")[int(rng.integers(2))], rng.normal(size=3)
        point, speed, until = rng.uniform(-reach, reach, 3), rng.uniform(-FASTEST, FASTEST), duration + rng.uniform()
        name = f"mover_{k}"
        if rng.random() < 0.5:
            start = float(rng.uniform(0.0, duration))
            mover = pp.Mover.constant(name, moved, speed, until, start=start, type=kind, axis=axis, point=point)
        else:
            half = until / 2
            q = np.array([[0.0], [speed * half], [0.0]])
            there_and_back = pp.Trajectory([0.0, half, until], q, np.zeros((3, 1)), [name])
            mover = pp.Mover(name, moved, there_and_back, kind, axis, point)
        movers.append(mover)
    return movers


class Oracle:
    """Distances of an arm and obstacles at a configuration and given placements, by Pinocchio and coal alone."""

    def __init__(self, checker: pp.CollisionChecker) -> None:
        self._arm, self._geometry = checker.arm, checker.geometry_model
        self._model = checker.arm.model
        self._data, self._bodies = self._model.createData(), self._geometry.createData()
        self._rest = [each.placement.copy() for each in self._geometry.geometryObjects]
        self._owners = [body.owner if body.link is None else "" for body in checker.bodies]
        self.margin, self.any = checker.margin, bool(checker.pairs)

    def distance(self, q: Array, moved: dict[str, pin.SE3]) -> float:
        """Return the smallest distance (m) with the obstacles ``moved`` by these transforms of the root frame."""
        for thing, rest, owner in zip(self._geometry.geometryObjects, self._rest, self._owners, strict=True):
            if owner:  # an obstacle, which another edge may have moved before
                thing.placement = moved[owner] * rest if owner in moved else rest
        if not self.any:
            return float("inf")
        configuration = self._arm.model_configuration(q)
        nearest = pin.computeDistances(self._model, self._data, self._geometry, self._bodies, configuration)
        return float(self._bodies.distanceResults[nearest].min_distance)


def moved_at(movers: Sequence[pp.Mover], t: float) -> dict[str, pin.SE3]:
    """Return the transform of the root frame that each moved obstacle has undergone at time t."""
    found = {}
    for mover in movers:
        value, axis, point = float(mover.trajectory(t)[0]), np.asarray(mover.axis), np.asarray(mover.point)
        if mover.type == "prismatic":
            at = pin.SE3(np.eye(3), value * axis)
        else:
            rotation = pin.exp3(value * axis)
            at = pin.SE3(rotation, point - rotation @ point)
        found.update(dict.fromkeys(mover.obstacles, at))
    return found


def check_verdict(
    trajectory: pp.Trajectory, movers: Sequence[pp.Mover], certificate: pp.Certificate, oracle: Oracle
) -> tuple[int, str]:
    """Return the number of instants checked, and how they contradict the verdict (empty if they do not)."""
    if certificate.status is pp.CertificateStatus.UNDECIDED:
        return 0, ""
    if certificate.status is pp.CertificateStatus.COLLIDING:
        times = [] if certificate.first_contact is None else [certificate.first_contact.time]
    else:
        travel = float(np.abs(np.diff(trajectory.q, axis=0)).max(axis=1).sum()) + FASTEST * trajectory.duration
        times = np.linspace(0.0, trajectory.duration, max(3, int(travel / SAMPLE_STEP))).tolist()
    nearest = min((oracle.distance(trajectory(t), moved_at(movers, t)) for t in times), default=np.inf)
    return len(times), contradiction(certificate, oracle.margin, nearest)
