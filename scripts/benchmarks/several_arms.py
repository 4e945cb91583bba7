"""Benchmark of joint groups with several arms: motions planned and certified together.

./scripts/benchmark several_arms --mbm FOLDER            MotionBenchMaker problems of both arms of a Baxter
./scripts/benchmark several_arms --edges 10000           certifies random edges and checks every verdict
./scripts/benchmark several_arms --mover-edges 10000     the same among moving obstacles
./scripts/benchmark several_arms --shared-bin            two UR5 over one bin with 40 parts
./scripts/benchmark several_arms --belt                  takes the parts of a conveyor and audits the motions
./scripts/benchmark several_arms --mbm FOLDER --edges 10000 --mover-edges 10000 --shared-bin --belt --docs
                                                                 all, and rewrites docs/benchmarks/several_arms.*;
                                                                 with --keep, parts that are not measured are kept
./scripts/benchmark several_arms --render                rewrites the page from several_arms.json

10,000 edges take some minutes, most of them for the independent check; the other parts take about a minute each. Exit
code 1 if a motion is in collision or a verdict on an edge is wrong.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from time import process_time, process_time_ns
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import pinocchio as pin

import pinproof as pp
from benchmarks.arm_picks import BELT_STEP, BIN_STEP, SPEEDS, BeltRow, SharedBinRow, belt_rows, measure_shared_bin
from benchmarks.collision_edges import (
    MARGINS,
    TOLERANCE,
    EdgeCase,
    EdgeRow,
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
from benchmarks.tables import (
    FOLDER,
    BenchmarkTable,
    bullet_section,
    fastest,
    markdown_table,
    page_parser,
    provenance,
    provenance_text,
    quantiles,
    report,
    row_table,
    run,
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


STEPS = ("plan", "shortcut", "time", "certify")

REPEATS = 3
"""Runs of each problem, of which the fastest counts: this reduces the influence of other processes."""

MOTION_AUDIT_STEP = 0.005
"""Largest joint motion in rad or m between samples at which a motion is checked on exact meshes."""


@dataclass(frozen=True)
class MotionOfTwoRow:
    """One problem: processor times in ms, and the results of the proof and of the independent check."""

    problem: str
    ends: str = ""
    status: str = ""
    ms: Mapping[str, float] = field(default_factory=dict)
    edges: int = 0
    edge_ms: float = 0.0
    longest_edge_ms: float = 0.0
    clearance: float | None = None
    duration: float | None = None
    audit: str = ""
    samples: int = 0
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class SeveralArmsTable(BenchmarkTable):
    """Planned motions, and random edges."""

    motions: tuple[MotionOfTwoRow, ...]
    edges: tuple[EdgeRow, ...]
    mover_edges: tuple[EdgeRow, ...]
    cells: tuple[SharedBinRow, ...] = ()
    belts: tuple[BeltRow, ...] = ()

    topic: ClassVar[str] = "several arms"
    row_types: ClassVar[dict[str, type]] = {
        "motions": MotionOfTwoRow,
        "edges": EdgeRow,
        "mover_edges": EdgeRow,
        "cells": SharedBinRow,
        "belts": BeltRow,
    }

    @property
    def wrong(self) -> list[str]:
        """Motions in collision, and wrong verdicts on edges, as sentences."""
        unsafe = [f"{row.problem}: {row.audit}" for row in self.motions if row.audit]
        unsafe += [f"{row.cell}: {text}" for row in self.cells for text in row.unsafe]
        return [*unsafe, *(text for row in (*self.edges, *self.mover_edges, *self.belts) for text in row.wrong)]


def measure_problem(problem: PlanProblem, seed: int) -> MotionOfTwoRow:
    """Plan, shorten, time and certify the motion of a problem."""
    group = problem.group
    checker = pp.CollisionChecker(group, problem.scene, trust_disabled=True)
    faults = end_faults(problem, checker)
    if faults:
        return MotionOfTwoRow(problem.name, "; ".join(faults))
    best: dict[str, float] = {}
    for _ in range(REPEATS):
        watch = Stopwatch(process_time_ns)
        plan = pp.RrtConnect().plan(checker, problem.start, problem.goals, rng=seed)
        watch.lap("plan")
        if not plan.ok:
            return MotionOfTwoRow(problem.name, status=plan.message)
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
    return MotionOfTwoRow(
        problem.name,
        "",
        certificate.status.name,
        best,
        len(edges),
        median(times),
        max(times),
        certificate.clearance if certificate.status is pp.CertificateStatus.FREE else None,
        trajectory.duration,
        "" if found.clean else found.message,
        found.samples,
        problem.notes,
    )


def _prove(edge: pp.JointPath, checker: pp.CollisionChecker) -> None:
    if not is_proven_free(edge, checker):
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


def groups() -> dict[str, tuple[pp.JointGroup, float]]:
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


def measure_edges(edges: int, seed: int) -> list[EdgeRow]:
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


def page(table: SeveralArmsTable) -> str:
    """Return the page as Markdown."""
    lines = [
        "# Benchmark of several arms",
        "",
        *wrapped(provenance_text(table)),
        *wrapped(_other_runs(table)),
        "",
    ]
    for part, (title, _, section) in SECTIONS.items():
        if getattr(table, part):
            lines += [f"## {title}", "", *section(table), ""]
    lines += bullet_section("Wrong verdicts", table.wrong)
    return "\n".join(lines).rstrip() + "\n"


def _motions(table: SeveralArmsTable) -> list[str]:
    text = (
        "MotionBenchMaker's problems of a Baxter that moves both arms, 14 joints, in a tall bookshelf with cans. "
        f"Processor times in ms on one thread, of {REPEATS} runs the fastest; median / largest over the problems. The "
        "edge column is the proof of one edge of the shortened path. The pairs of links that the SRDF of the robot "
        "disables are excluded, as in other planners: the hull of the torso overlaps those of the shoulders in every "
        "start and goal. The audit checks every motion on exact meshes at samples between which no joint moves more "
        f"than {MOTION_AUDIT_STEP:g} rad, by Pinocchio and coal alone."
    )
    names = list(dict.fromkeys(row.problem.rpartition("/")[0] for row in table.motions))
    cells = []
    for name in [*names, ""]:
        rows = [row for row in table.motions if row.problem.startswith(name)]
        posed = [row for row in rows if not row.ends]
        done = [row for row in posed if row.status == "FREE"]
        steps = {step: _spread([row.ms[step] for row in done], 1) for step in STEPS}
        edge = quantiles((row.edge_ms for row in done), "{:.2f}".format)
        longest = quantiles((row.longest_edge_ms for row in done), "{:.2f}".format, (1.0,))
        clearances = [1e3 * row.clearance for row in done if row.clearance is not None]
        cells.append(
            {
                "set": name.removeprefix("mbm/") or "all",
                "ends free": f"{len(posed)} of {len(rows)}",
                "certified": f"{len(done)} of {len(posed)}",
                **steps,
                "edge": f"{edge} / {longest}" if done else "",
                "clearance, mm": quantiles(clearances, "{:.1f}".format, (0.5, 0.0)),
                "unsafe in the audit": f"{sum(bool(row.audit) for row in done)} of {len(done)}",
            }
        )
    total = [sum(row.ms.values()) for row in table.motions if row.status == "FREE"]
    samples = sum(row.samples for row in table.motions)
    summary = (
        f"Planning, shortening, timing and certifying together take {_spread(total, 0)} ms. The audit took {samples:,} "
        "samples. For comparison, Amice, Werner and Tedrake (2023, arXiv 2310.16603) report 0.299 s for the "
        "certificate of an edge and 1.211 s for that of a plan of two arms with 12 joints together."
    )
    other = [f"{row.problem}: {row.status or row.ends}" for row in table.motions if row.status != "FREE"]
    return [
        *wrapped(text),
        "",
        *markdown_table(tuple(cells[0]), [tuple(each.values()) for each in cells]),
        "",
        *wrapped(summary),
        "",
        *bullet_section("Not certified", other),
        *bullet_section("Notes", sorted({note for row in table.motions for note in row.notes})),
    ]


def _spread(values: list[float], digits: int) -> str:
    """Median and largest value."""
    return quantiles(values, f"{{:.{digits}f}}".format, (0.5, 1.0))


def _edges(table: SeveralArmsTable) -> list[str]:
    text = (
        "Straight edges of all joints in random scenes, a third each with standard deviations of 0.05, 0.3 and 1 rad "
        "or m, and with margins of 0 to 20 mm. FREE is checked at "
        f"{SAMPLES} samples on the hulls, whose distances by coal must not be below the proven clearance, and on exact "
        f"meshes at samples between which no joint moves more than {AUDIT_STEP:g} rad or m. COLLIDING is checked at "
        "the configuration that it names. Times are means over edges of all kinds."
    )
    return [*wrapped(text), "", *edge_table("group", table.edges)]


def _mover_edges(table: SeveralArmsTable) -> list[str]:
    text = (
        "Random edges of one arm, timed with the limits of the robot, among up to eight obstacles of which up to three "
        "movers move some: along or about random axes, at constant speed or there and back, at up to "
        f"{FASTEST:g} m/s or rad/s. FREE is checked at samples in time between which nothing moves more than about "
        f"{SAMPLE_STEP:g} rad or m: the arm is placed by Pinocchio, each obstacle by the formula of its mover, and "
        "the distances by coal must not be below the proven clearance. COLLIDING is checked at the instant that it "
        "names. The times include the set-up of the movers."
    )
    return [*wrapped(text), "", *edge_table("robot", table.mover_edges)]


def _other_runs(table: SeveralArmsTable) -> str:
    """The commits of parts that were measured by another run."""
    own = table.provenance["commit"]
    kept = {part: commit for part, commit in table.settings.get("measured", {}).items() if commit != own}
    if not kept:
        return ""
    parts = "; ".join(f"{SECTIONS[part][1]}: {commit[:12]}" for part, commit in kept.items())
    return f"Parts that were measured at another commit: {parts}."


def _cells(table: SeveralArmsTable) -> list[str]:
    text = (
        "Two UR5 move 40 parts from one bin to two trays (`robots/two_ur5`). `pp.cell.allocate` judges every pick for "
        "both arms, allocates and orders the picks, and lets the arms wait for each other. Every motion is certified, "
        "and so are the pairs of bodies of the two arms in each interval of the common clock without a grip or a "
        "release. One arm is the shorter time in which one of them executes all picks, with the other at home. The "
        "audit checks all bodies of both arms on exact meshes, among the parts that are in the scene at each time, at "
        f"common times between which no joint moves more than {BIN_STEP:g} rad. The last column is the processor "
        "time of everything but the audit, the sequences of one arm included."
    )
    columns = {
        "cell": "{.cell}",
        "picks": "{.picks}",
        "makespan": "{.makespan:.1f} s",
        "one arm": "{.one_arm:.1f} s",
        "ratio": "{.ratio:.3f}",
        "waiting": lambda row: " / ".join(f"{each:.1f} s" for each in row.waiting),
        "utilisation": lambda row: " / ".join(f"{100 * each:.0f} %" for each in row.utilisation),
        "certified": "{0.status}, {0.intervals} intervals",
        "clearance, mm": lambda row: f"{1e3 * row.clearance:.1f}",
        "audited samples": "{.samples:,}",
        "unsafe": lambda row: str(len(row.unsafe)),
        "time": "{.seconds:.0f} s",
    }
    return [*wrapped(text), "", *row_table(columns, table.cells)]


def _belts(table: SeveralArmsTable) -> list[str]:
    text = (
        "The parts of a conveyor are taken one after the other and put onto a tray; each pick starts where and when "
        "the one before ended. A part that comes too early for the arm passes, and is an obstacle. The tool meets each "
        "part, follows it while the gripper closes, and lifts it. The audit checks every motion on exact meshes at "
        f"samples between which nothing moves more than {BELT_STEP:g} rad or m, with all parts on the belt moving. The "
        "deviation is the largest proven bound of the distance of the tcp from its place on the moving part while the "
        "gripper closes."
    )
    columns = {
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
    return [*wrapped(text), "", *row_table(columns, table.belts)]


SECTIONS = {
    "motions": ("Motions of both arms", "motions of both arms", _motions),
    "edges": ("Certificates of random edges", "random edges", _edges),
    "mover_edges": ("Certificates among moving obstacles", "edges among moving obstacles", _mover_edges),
    "cells": ("Picks of two arms over one bin", "picks of two arms", _cells),
    "belts": ("Picks from a conveyor", "picks from a conveyor", _belts),
}
"""The sections of the page, which can be measured in separate runs: title, name in a sentence, and what writes it."""


def measure(options: argparse.Namespace) -> SeveralArmsTable:
    """Measure the parts of the page that the options select."""
    origin, motions = provenance(options.seed), []
    for each in [] if options.mbm is None else find_sets(options.mbm, options.robot):
        for problem in read_problems(each, options.problems, as_stated=True):
            report(problem.name)
            motions.append(measure_problem(problem, options.seed))
    rows = {
        "motions": motions,
        "edges": measure_edges(options.edges, options.seed) if options.edges else [],
        "mover_edges": mover_edge_rows(options.mover_edges, options.seed) if options.mover_edges else [],
        "cells": [measure_shared_bin(options.seed)] if options.shared_bin else [],
        "belts": belt_rows(SPEEDS, options.seed) if options.belt else [],
    }
    measured = {part: origin["commit"] for part, found in rows.items() if found}
    if options.keep:
        before = SeveralArmsTable.load(FOLDER / "several_arms.json")
        kept = [part for part in rows if not rows[part] and getattr(before, part)]
        earlier = before.settings.get("measured", {})
        measured |= {part: earlier.get(part, before.provenance["commit"]) for part in kept}
        rows |= {part: getattr(before, part) for part in kept}
    return SeveralArmsTable({"measured": measured}, origin, **{part: tuple(found) for part, found in rows.items()})


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = page_parser(__doc__, "several_arms")
    parser.add_argument("--mbm", type=Path, metavar="FOLDER", help="MotionBenchMaker problems of several arms")
    parser.add_argument("--robot", help="the robot of these problems, if the files do not name one")
    parser.add_argument("--problems", type=int, metavar="N", help="largest number of problems per set")
    parser.add_argument("--edges", type=int, default=0, metavar="N", help="number of random edges")
    parser.add_argument("--mover-edges", type=int, default=0, metavar="N", help="number of random edges among movers")
    parser.add_argument("--shared-bin", action="store_true", help="the picks of two arms over one bin")
    parser.add_argument("--keep", action="store_true", help="keep the parts of the page that are not measured")
    parser.add_argument("--belt", action="store_true", help="picks from a conveyor")
    run(parser, "several_arms", SeveralArmsTable, measure, page)
