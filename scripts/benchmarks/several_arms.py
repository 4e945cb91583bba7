"""Benchmark of joint groups with several arms: motions planned and certified together.

./scripts/benchmark several_arms --mbm FOLDER            MotionBenchMaker problems of both arms of a Baxter
./scripts/benchmark several_arms --edges 10000           certifies random edges and checks every verdict
./scripts/benchmark several_arms --mover-edges 10000     the same among moving obstacles
./scripts/benchmark several_arms --shared-bin            two UR5 over one bin with 40 parts
./scripts/benchmark several_arms --carry 50              parts in two hands, of two UR10e and of a Baxter
./scripts/benchmark several_arms --stations 10           stations of others: two iiwa, two GP4, two and four Pandas
./scripts/benchmark several_arms --belt                  takes the parts of a conveyor and audits the motions
./scripts/benchmark several_arms --belt --docs           rewrites this part of docs/benchmarks/several_arms.*

10,000 edges take some minutes, most of them for the independent check; the other parts take about a minute each. Exit
code 1 if a motion is in collision or a verdict on an edge is wrong.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

import pinproof as pp
from benchmarks.arm_picks import SPEEDS, belt_rows, shared_bin_row
from benchmarks.carried_parts import carried_rows
from benchmarks.collision_edges import (
    MARGINS,
    TOLERANCE,
    EdgeCase,
    check_edges,
    contradiction,
    count_verdicts,
    distributed,
    edge_table,
    random_edge,
    random_scene,
)
from benchmarks.planning_methods import Stopwatch
from benchmarks.planning_problems import PlanProblem, end_faults, find_sets, own_reach, read_problems
from benchmarks.stations import coordinated, station_problems
from benchmarks.tables import (
    Benchmark,
    Blocks,
    Results,
    Row,
    bullet_section,
    fastest,
    page_parser,
    provenance,
    quantiles,
    report,
    row_table,
    wrapped,
)
from pinproof.collision import audit, is_proven_free

Array = npt.NDArray[np.float64]

ROBOTS = ("ur5", "panda", "generic_6dof")

MOST_MOVERS = 3

FASTEST = 0.8
"""Largest speed of a mover, m/s or rad/s."""

SAMPLE_STEP = 0.02
"""Largest motion of a joint or mover (rad or m) between two samples of the independent check."""


def mover_edge_rows(edges: int, seed: int) -> list[Row]:
    """Check this number of edges, distributed over :data:`ROBOTS`."""
    return [check_robot(name, count, seed) for name, count in distributed(edges, ROBOTS).items()]


def check_robot(robot: str, edges: int, seed: int) -> Row:
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


STEPS = ("plan", "shortcut", "time", "certify")

REPEATS = 3
"""Runs of each problem, of which the fastest counts: this reduces the influence of other processes."""

MOTION_AUDIT_STEP = 0.005
"""Largest joint motion in rad or m between samples at which a motion is checked on exact meshes."""


def measure_problem(problem: PlanProblem, seed: int) -> Row:
    """Plan, shorten, time and certify the motion of a problem; processor times in ms."""
    group = problem.group
    checker = pp.CollisionChecker(group, problem.scene, trust_disabled=True)
    faults = end_faults(problem, checker)
    if faults:
        return Row(problem=problem.name, ends="; ".join(faults), status="", wrong=[])
    best: dict[str, float] = {}
    for _ in range(REPEATS):
        watch = Stopwatch()
        plan = pp.RrtConnect().plan(checker, problem.start, problem.goals, rng=seed)
        watch.lap("plan")
        if not plan.ok:
            return Row(problem=problem.name, ends="", status=plan.message, wrong=[])
        path = pp.shortcut(plan.path, checker, rng=seed)
        watch.lap("shortcut")
        trajectory = pp.time_parametrise(path, group.limits)
        watch.lap("time")
        certificate = pp.certify(trajectory, checker)
        watch.lap("certify")
        best = {step: min(ms, best.get(step, np.inf)) for step, ms in watch.ms.items()}
    edges = [pp.JointPath(np.array(ends), group.joint_names) for ends in zip(path.q[:-1], path.q[1:], strict=True)]
    times = [1e3 * fastest(lambda edge=edge: _prove(edge, checker), REPEATS) for edge in edges]
    meshes = pp.CollisionChecker(group, problem.scene, trust_disabled=True, link_meshes="surface")
    found = audit(trajectory, meshes, step=MOTION_AUDIT_STEP, measure=False)
    return Row(
        problem=problem.name,
        ends="",
        status=certificate.status.name,
        ms=best,
        edges=len(edges),
        edge_ms=median(times),
        longest_edge_ms=max(times),
        clearance=certificate.clearance if certificate.status is pp.CertificateStatus.FREE else None,
        duration=trajectory.duration,
        wrong=[] if found.clean else [f"{problem.name}: {found.message}"],
        samples=found.samples,
        notes=problem.notes,
    )


def _prove(edge: pp.JointPath, checker: pp.CollisionChecker) -> None:
    if not is_proven_free(edge, checker) and not pp.certify(edge, checker).free:
        raise RuntimeError("an edge of a certified path is not proven free")


SHARES = {
    "two ur5, 0.8 m apart": 0.3,
    "ur5 and panda, 0.6 m apart": 0.3,
    "baxter": 0.395,
    "tiago_dual with its torso": 0.005,
}
"""The share of each group in the edges; the independent check of the TIAGo's meshes takes a second per edge."""

SAMPLES, AUDIT_STEP = 12, 0.02
"""Samples per edge at which distances are measured, and largest joint motion (rad or m) between samples at which exact
meshes are checked."""


def groups() -> dict[str, tuple[pp.model.JointGroup, float]]:
    """The joint groups of the random edges, with the distance (m) from the root within which obstacles are placed."""
    ur5, panda = pp.load_robot("ur5").arm(), pp.load_robot("panda").arm()
    return {
        "two ur5, 0.8 m apart": (pp.assemble({"a": (ur5, np.eye(4)), "b": (ur5, _facing(0.8))}), 0.9),
        "ur5 and panda, 0.6 m apart": (pp.assemble({"ur": (ur5, np.eye(4)), "panda": (panda, _facing(0.6))}), 0.9),
        "baxter": (pp.load_robot("baxter_left").arms(), 1.2),
        "tiago_dual with its torso": (pp.load_robot("tiago_dual_left").arms(base="torso_fixed_link"), 1.2),
    }


def _facing(distance: float) -> Any:
    return pp.pose(xyz=(distance, 0, 0), rpy=(0, 0, np.pi))


def measure_edges(edges: int, seed: int) -> list[Row]:
    """Certify this number of edges, distributed over :func:`groups`, and check the verdicts."""
    rows = []
    for name, (group, reach) in groups().items():
        count = round(edges * SHARES[name])
        hulls, meshes = (
            pp.CollisionChecker(group, link_meshes=how, trust_disabled=True) for how in ("hull", "surface")
        )
        row = check_edges(name, count, seed, checkers=(hulls, meshes), reach=reach, samples=SAMPLES, step=AUDIT_STEP)
        rows.append(row)
    return rows


def motions_of_both(rows: Sequence[Row]) -> list[str]:
    """The table of the planned motions, and what was not certified."""
    groups = []
    for name in (*dict.fromkeys(row.problem.rpartition("/")[0] for row in rows), ""):
        group = [row for row in rows if row.problem.startswith(name)]
        posed = [row for row in group if not row.ends]
        done = [row for row in posed if row.status == "FREE"]
        groups.append(Row(name=name, group=group, posed=posed, done=done))

    def spread(step: str) -> Any:
        return lambda row: quantiles([each.ms[step] for each in row.done], "{:.1f}", (0.5, 1.0))

    def edges(row: Row) -> str:
        typical = quantiles((each.edge_ms for each in row.done), "{:.2f}")
        return f"{typical} / {quantiles((each.longest_edge_ms for each in row.done), '{:.2f}', (1.0,))}"

    columns = {
        "set": lambda row: row.name.partition("/")[2] or "all",
        "ends free": lambda row: f"{len(row.posed)} of {len(row.group)}",
        "certified": lambda row: f"{len(row.done)} of {len(row.posed)}",
        **{step: spread(step) for step in STEPS},
        "edge": edges,
        "clearance, mm": lambda row: quantiles((each.clearance for each in row.done), "{:.1f}", (0.5, 0.0), 1e3),
        "unsafe in the audit": lambda row: f"{sum(bool(each.wrong) for each in row.done)} of {len(row.done)}",
    }
    total = quantiles((sum(row.ms.values()) for row in groups[-1].done), "{:.0f}", (0.5, 1.0))
    summary = (
        f"Planning, shortening, timing and certifying together take {total} ms. The audit took "
        f"{sum(row.samples for row in groups[-1].done):,} samples."
    )
    other = [f"{row.problem}: {row.status or row.ends}" for row in rows if row.status != "FREE"]
    notes = sorted({note for row in rows for note in getattr(row, "notes", ())})
    lists = [*bullet_section("Not certified", other), *bullet_section("Notes", notes)]
    return [*row_table(columns, groups), "", *wrapped(summary), "", *lists][: None if lists else -1]


def blocks(results: Results) -> Blocks:
    """The tables of the page."""
    cells = {
        "cell": "{.cell}",
        "picks": "{.picks}",
        "makespan": "{.makespan:.1f} s",
        "one arm": "{.one_arm:.1f} s",
        "ratio": lambda row: f"{row.makespan / row.one_arm:.3f}",
        "waiting": lambda row: " / ".join(f"{each:.1f} s" for each in row.waiting),
        "utilisation": lambda row: " / ".join(f"{100 * each:.0f} %" for each in row.utilisation),
        "certified": "{0.status}, {0.intervals} intervals",
        "clearance, mm": lambda row: f"{1e3 * row.clearance:.1f}",
        "audited samples": "{.samples:,}",
        "unsafe": lambda row: str(len(row.wrong)),
        "time": "{.seconds:.0f} s",
    }
    belts = {
        "cell": "{.cell}",
        "belt, m/s": "{.speed:g}",
        "taken": "{0.taken} of {0.parts}",
        "cycle, s": "{.mean_cycle:.2f}",
        "deviation, mm": lambda row: f"{row.deviation * 1e3:.4f}",
        "clearance, mm": lambda row: f"{row.clearance * 1e3:.1f}",
        "planning, s for each": lambda row: f"{row.seconds / row.parts:.2f}",
        "samples": "{.samples:,}",
        "unsafe in the audit": lambda row: str(len(row.wrong)),
    }
    carried = {
        "cell": "{.cell}",
        "problems": "{.problems}",
        "certified": "{.found}",
        "processor time, s": "{0.seconds:.2f} / {0.most_seconds:.2f}",
        "motion, s": "{.duration:.2f}",
        "deviation": lambda row: f"{row.position * 1e3:.3f} mm, {np.degrees(row.rotation):.3f} deg",
        "largest at samples / proven": "{.share:.2f}",
        "wrong": lambda row: str(len(row.wrong)),
    }
    return {
        "carried": row_table(carried, results["carried"]),
        "motions": motions_of_both(results["motions"]) if results["motions"] else [],
        "stations": motions_of_both(results["stations"]) if results["stations"] else [],
        "coordinated": coordination_table(results["coordinated"]),
        "edges": edge_table("group", results["edges"]),
        "mover_edges": edge_table("robot", results["mover_edges"]),
        "cells": row_table(cells, results["cells"]),
        "belts": row_table(belts, results["belts"]),
    }


def station_rows(problems: int, seed: int) -> dict[str, list[Row]]:
    """The motions of this number of problems at each station, planned together, and by :func:`pp.plan_arms`."""
    rows: dict[str, list[Row]] = {"stations": [], "coordinated": []}
    for problem in station_problems(problems, seed) if problems else ():
        report(problem.name)
        rows["stations"].append(measure_problem(problem, seed))
        rows["coordinated"].append(coordinated(problem, seed))
    return rows


def coordination_table(rows: Sequence[Row]) -> list[str]:
    """The table of the coordinated motions."""
    names = dict.fromkeys(row.station for row in rows)
    groups = [Row(name=name, all=[row for row in rows if row.station == name]) for name in names]
    columns = {
        "station": "{.name}",
        "certified": lambda row: f"{sum(each.ok for each in row.all)} of {len(row.all)}",
        "processor time, s": lambda row: quantiles((each.seconds for each in row.all), "{:.2f}", (0.5, 1.0)),
        "motion, s": lambda row: quantiles((each.duration for each in row.all if each.ok), "{:.2f}", (0.5, 1.0)),
        "unsafe in the audit": lambda row: str(sum(bool(each.wrong) for each in row.all)),
    }
    return row_table(columns, groups)


def measure(options: argparse.Namespace) -> Results:
    """Measure the parts that the options select."""
    results = Results({}, provenance(options.seed), {"motions": []})
    for each in [] if options.mbm is None else find_sets(options.mbm, options.robot):
        for problem in read_problems(each, options.problems, as_stated=True):
            report(problem.name)
            results["motions"].append(measure_problem(problem, options.seed))
    results.parts |= {
        "edges": measure_edges(options.edges, options.seed) if options.edges else [],
        "mover_edges": mover_edge_rows(options.mover_edges, options.seed) if options.mover_edges else [],
        **station_rows(options.stations, options.seed),
        "cells": [shared_bin_row(options.seed)] if options.shared_bin else [],
        "belts": belt_rows(SPEEDS, options.seed) if options.belt else [],
        "carried": carried_rows(options.carry, options.seed) if options.carry else [],
    }
    return results


BENCHMARK = Benchmark("several_arms", measure, blocks)


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = page_parser(__doc__, "several_arms")
    parser.add_argument("--mbm", type=Path, metavar="FOLDER", help="MotionBenchMaker problems of several arms")
    parser.add_argument("--robot", help="the robot of these problems, if the files do not name one")
    parser.add_argument("--problems", type=int, metavar="N", help="largest number of problems per set")
    parser.add_argument("--edges", type=int, default=0, metavar="N", help="number of random edges")
    parser.add_argument("--mover-edges", type=int, default=0, metavar="N", help="number of random edges among movers")
    parser.add_argument("--stations", type=int, default=0, metavar="N", help="problems at each station of others")
    parser.add_argument("--shared-bin", action="store_true", help="the picks of two arms over one bin")
    parser.add_argument("--carry", type=int, default=0, metavar="N", help="number of problems of parts in two hands")
    parser.add_argument("--belt", action="store_true", help="picks from a conveyor")
    BENCHMARK.run(parser)
