"""Benchmark of tool paths: independent dense audits, processor times, and Descartes of Tesseract on the same graphs.

./scripts/benchmark tool_paths                        prints the tables; 15 minutes
./scripts/benchmark tool_paths --tesseract PYTHON     with Descartes, whose wheel this Python has
./scripts/benchmark tool_paths --docs                 rewrites docs/benchmarks/tool_paths.*

The wheel tesseract-robotics-nanobind needs libstdc++ of GCC 13 (GLIBCXX_3.4.31) and glibc 2.38. Exit code 1 if an audit
finds a fault, or an optimum differs.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from collections import Counter
from itertools import pairwise
from pathlib import Path
from time import process_time

import numpy as np

import pinproof as pp
from benchmarks.tables import Benchmark, Blocks, Results, Row, page_parser, provenance, report, row_table
from benchmarks.tool_path_audits import ARMS, best_of_tries, off_the_path, random_problem, why_not, wrong
from pinproof._core import Ladder
from pinproof.spatial import matrix, rotation_about
from pinproof.tool_paths import COSTS, ToolPath
from pinproof.tool_paths.rungs import LadderSettings, ladder_of

PATHS, GRAPHS, RUNS = 1000, 40, 3
ROTATIONS, JUMP, SLOWEST = 12, 0.5, 0.1
"""The graphs for Descartes: rotations of the tool, largest step of a joint (rad), and share of the speed."""

SIX = ("ur5", "irb120", "crx10ia", "puma560")
"""The arms with six joints."""

RAILS = (0.0, 2.0, 4.0)
"""Metres: lengths of the rails of the large paths; 0 for none."""

EQUAL, NOISE = 1e-9, 5e-4
"""Relative difference of optima that is rounding, and of costs that is due to the places at which they are computed."""

NAMED = ("proven", "OUT_OF_REACH", "LIMIT", "CONTACT", "JUMP", "LIFTS_NEEDED", "finer")
"""What :func:`why_not` returns that has a column."""


# -- audits -----------------------------------------------------------------------------------------------------------


def audited(arm: str, seed: int) -> Row:
    """One random path: the outcome, and the faults that the independent dense check finds in the motion."""
    checker, path, settings = random_problem(arm, np.random.default_rng(seed))
    begin = process_time()
    plan = pp.follow(checker, path, **settings)
    took = process_time() - begin
    faults = [f"{arm}, path {seed}: {fault}" for fault in (wrong(plan, settings) if plan.ok else [])]
    if not (plan.ok or plan.blocked or plan.cuts):
        report(f"{arm}, path {seed}: {plan.message}")
    # The baseline: paths that a try passes and the plan does not, and the costs of both
    tried, least, own = best_of_tries(checker, path, settings, plan, np.random.default_rng([seed, 1]))
    return Row(
        arm=arm, seed=seed, status=plan.status.name, seconds=round(took, 4), tried=tried, least=least, cost=own,
        why="" if plan.ok else why_not(plan, settings), wrong=faults,
    )  # fmt: skip


# -- large paths ------------------------------------------------------------------------------------------------------


def large_problem(rail: float) -> tuple[pp.CollisionChecker, ToolPath, dict[str, object]]:
    """A curve of 500 poses of a UR10e among 50 boxes, with tilting tools; the arm may be on a rail of a length (m)."""
    robot = pp.load_robot("ur10e")
    if rail:
        text = (
            '<link name="rail"/><joint name="rail_joint" type="prismatic"><parent link="rail"/>'
            f'<child link="{robot.urdf.root}"/><axis xyz="0 1 0"/>'
            f'<limit lower="{-rail / 2}" upper="{rail / 2}" velocity="1" effort="1"/>'
            "</joint>"
        )
        robot = pp.load_robot(robot.urdf.text.replace("</robot>", f"{text}</robot>"))
    arm = robot.arm(tcp="tool0")
    a = np.linspace(0.0, 2.0 * np.pi, 500)
    points = np.column_stack([0.75 + 0.15 * np.cos(a), 0.35 * np.sin(a), 0.25 + 0.03 * np.sin(3.0 * a)])
    normals = np.column_stack([0.2 * np.cos(2.0 * a), 0.2 * np.sin(a), np.ones(500)])
    rng, boxes = np.random.default_rng(1), []
    while len(boxes) < 50:
        place, sides = rng.uniform([-1.3, -1.3, 0.0], [1.3, 1.3, 1.2]), rng.uniform(0.03, 0.12, 3)
        clear = np.linalg.norm(points - place, axis=1).min() > 0.3 and np.linalg.norm(place[:2]) > 0.4
        if clear and not (place[0] > 0.0 and abs(place[1]) < 0.6 and place[2] > 0.1):
            boxes.append(pp.Obstacle(f"box {len(boxes)}", pp.Box(*sides), pp.pose(place)))
    checker = pp.CollisionChecker(arm, pp.Scene(boxes))
    settings: dict[str, object] = {"rotations": 30, "redundant": 30} if rail else {"rotations": 24}
    return checker, ToolPath.through(points, normals, speed=0.1), settings


def large(rail: float) -> Row:
    """The processor time from the path to the certified motion, the least of several runs."""
    checker, path, settings = large_problem(rail)
    times = []
    for _ in range(RUNS):
        begin = process_time()
        plan = pp.follow(checker, path, **settings)
        times.append(process_time() - begin)
    name = f"UR10e on a rail of {rail:g} m, 30 rotations, 30 places" if rail else "UR10e, 24 rotations"
    faults = [] if plan.ok else [f"{name}: {plan.message}"]
    checked = {"free_rotation": True, "deviation": 1e-3, "rotation_deviation": np.radians(1.0)}
    faults += [f"{name}: {fault}" for fault in (wrong(plan, checked) if plan.ok else [])]
    return Row(name=name, poses=len(path), nodes=plan.nodes, seconds=min(times), slowest=max(times), wrong=faults)


# -- Descartes --------------------------------------------------------------------------------------------------------


def graph(checker: pp.CollisionChecker, path: ToolPath) -> tuple[Ladder, list[np.ndarray], list[np.ndarray]]:
    """Our ladder of a random path, its nodes, and the costs of its edges, computed from their formula."""
    arm = checker.arm
    turns = np.array([rotation_about(np.array([0.0, 0.0, 1.0]), 2.0 * np.pi * k / ROTATIONS) for k in range(ROTATIONS)])
    turned = np.tile(np.eye(4), (ROTATIONS, 1, 1))
    turned[:, :3, :3] = turns
    # Poses at most 20 mm apart, each with its collision-free solutions
    places = [path.poses[:1]]
    for a, b in pairwise(path.poses):
        parts = max(1, int(np.ceil(np.linalg.norm(b[:3, 3] - a[:3, 3]) / 0.02)))
        shares = np.arange(1, parts + 1) / parts
        places.append(np.array([matrix(pp.spatial.interpolate(_se3(a), _se3(b), share)) for share in shares]))
    every = np.concatenate(places)
    nodes = []
    for place in every:
        q = pp.AnalyticIk().solve_all_batch(arm, place @ turned).q.reshape(-1, arm.dof)
        q = q[~np.isnan(q).any(axis=1)]
        q = np.where(arm.periodic, (q + np.pi) % (2.0 * np.pi) - np.pi, q)
        q = np.unique(np.round(q, 12), axis=0)
        q = q[((q >= arm.limits.lower) & (q <= arm.limits.upper)).all(axis=1)]
        nodes.append(q[checker.is_free_batch(q)] if len(q) else q)
    lengths = np.linalg.norm(np.diff(every[:, :3, 3], axis=0), axis=1)
    durations, costs = np.maximum(lengths / 0.1, 1e-3), COSTS["balanced"]
    speed = arm.limits.velocity
    steps = 1.2 * 2.0 * np.pi / ROTATIONS / float(speed.min())
    jump = np.full(arm.dof, max(JUMP, 1.2 * 2.0 * np.pi / ROTATIONS))
    settings = LadderSettings(costs, steps, SLOWEST, jump)
    counts = np.array([len(q) for q in nodes])
    ladder = ladder_of(
        arm, counts, np.concatenate(nodes), np.zeros(counts.sum()), np.zeros(arm.dof), durations,
        np.ones(len(durations), dtype=bool), settings,
    )  # fmt: skip
    edges = []
    for (a, b), h in zip(pairwise(nodes), durations, strict=True):
        step = np.abs(a[:, None] - b[None])
        r = step / speed
        cost = costs.time * np.maximum(r.max(axis=2), h) + costs.travel * r.sum(axis=2)
        cost += costs.effort * (r**2).sum(axis=2) / h
        reach = np.minimum(speed * max(h / SLOWEST, steps), jump)
        edges.append(np.where((step <= reach).all(axis=2), cost, np.inf))
    return ladder, nodes, edges


def _se3(pose: np.ndarray) -> pp.spatial.SE3:
    return pp.spatial.SE3(pose[:3, :3], pose[:3, 3])


def compared(python: str, arm: str, seed: int) -> Row | None:
    """Both optima over one graph; None if a rung has no node, which Descartes does not accept."""
    checker, path, _ = random_problem(arm, np.random.default_rng(seed))
    ladder, nodes, edges = graph(checker, path)
    if not all(map(len, nodes)) or len(nodes) < 2:
        return None
    begin = process_time()
    course = ladder.solve(0, len(nodes) - 1)
    took = process_time() - begin
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "graph.npz"
        arrays = {f"q{k}": q for k, q in enumerate(nodes)} | {f"cost{k}": cost for k, cost in enumerate(edges)}
        np.savez(file, count=len(nodes), **arrays)
        worker = Path(__file__).with_name("tesseract_worker.py")
        answer = subprocess.run([python, worker, file], capture_output=True, text=True, check=False)
    try:
        other = json.loads(answer.stdout.splitlines()[-1])
    except (ValueError, IndexError) as error:
        raise RuntimeError(f"{python} does not run Descartes: {answer.stderr[-400:]}") from error
    complete = len(course.nodes) == len(nodes)
    equal = complete == other["ok"] and (not complete or abs(course.cost - other["cost"]) <= EQUAL * course.cost)
    figures = f"{course.cost if complete else None} and {other.get('cost')}"
    # The motions of both: straight in joint space between the nodes of Descartes, and ours of the same grid
    found = pp.follow(checker, path, rotations=ROTATIONS, rotation_deviation=0.1)
    audits: dict[str, object] = {"followed": found.ok}
    if other["ok"]:
        q = np.array([row[node] for row, node in zip(nodes, other["nodes"], strict=True)])
        line = pp.JointPath(q[np.append(True, np.abs(np.diff(q, axis=0)).max(axis=1) > 1e-9)], checker.arm.joint_names)
        audits |= {
            "other_contact": _in_contact(line, checker),
            "other_off": _off(line(np.linspace(0, 1, 2000)), checker, path),
        }
    if found.ok:
        own = found.trajectory
        along = [piece.trajectory for piece in found.pieces if piece.trajectory is not None]
        off = max((_off(each(np.linspace(0, each.duration, 2000)), checker, path) for each in along), default=0.0)
        audits |= {"contact": _in_contact(own, checker), "off": off}
    return Row(
        arm=arm, seed=seed, rungs=len(nodes), nodes=sum(map(len, nodes)), found=complete,
        cost=course.cost if complete else None,
        other=other.get("cost"), seconds=took, other_seconds=other["seconds"],
        wrong=[] if equal and not audits.get("contact") else [f"{arm}, graph {seed}: {figures}, {audits}"], **audits,
    )  # fmt: skip


def _in_contact(curve: pp.motion.Curve, checker: pp.CollisionChecker) -> bool:
    """Whether dense samples of a motion are in contact on the exact meshes."""
    return not pp.audit(curve, checker, step=0.005, measure=False).clean


def _off(q: np.ndarray, checker: pp.CollisionChecker, path: ToolPath) -> float:
    """The largest distance (m) of the tool from the path at configurations (k, n)."""
    poses = checker.arm.forward_kinematics_batch(q)
    own = {"freedom": True, "first": 0, "last": len(path) - 1, "parts": 3}
    return float(off_the_path(path, poses, 1e-3, **own)[:, 0].max())


# -- the page ---------------------------------------------------------------------------------------------------------


def measure(options: argparse.Namespace) -> Results:
    """Run the parts that the options name."""
    counts = {"paths": options.paths, "graphs": options.graphs if options.tesseract else 0}
    results = Results({name: count for name, count in counts.items() if count}, provenance(options.seed))
    audits: list[Row] = []
    for seed in range(options.paths // len(ARMS)):
        audits += [audited(arm, seed) for arm in ARMS]
        if seed % 20 == 19:
            report(f"{len(audits)} paths: {dict(Counter(row.status for row in audits))}")
    results.parts["audits"] = audits
    results.parts["large"] = [large(rail) for rail in RAILS] if options.large else []
    graphs: list[Row] = []
    seed = 0
    while options.tesseract and len(graphs) < options.graphs:
        graphs += filter(None, (compared(options.tesseract, arm, seed) for arm in SIX))
        seed += 1
    results.parts["graphs"] = graphs
    return results


def blocks(results: Results) -> Blocks:
    """The tables."""
    audits, graphs, tries = [], [], []
    for arm in ARMS:
        if rows := [row for row in results["audits"] if row.arm == arm]:
            whys, times = Counter(row.why for row in rows if row.status != "FOUND"), [row.seconds for row in rows]
            audits.append(Row(
                arm=arm, count=len(rows), found=sum(row.status == "FOUND" for row in rows), proven=whys["proven"],
                reach=whys["OUT_OF_REACH"] + whys["LIMIT"], contact=whys["CONTACT"],
                jump=whys["JUMP"] + whys["LIFTS_NEEDED"], finer=whys["finer"],
                others=sum(whys[own] for own in whys if own not in NAMED),
                wrong=sum(bool(row.wrong) for row in rows), median=float(np.median(times)), most=max(times),
            ))  # fmt: skip
        if rows := [row for row in results["audits"] if row.arm == arm and hasattr(row, "tried")]:
            ratios = [row.cost / row.least for row in rows if row.cost is not None and row.least is not None]
            tries.append(Row(
                arm=arm, count=len(rows), followed=sum(row.status == "FOUND" for row in rows),
                tried=sum(row.tried for row in rows), above=sum(ratio > 1.0 + NOISE for ratio in ratios),
                missed=sum(row.tried and row.status != "FOUND" for row in rows),
                median=float(np.median(ratios)), most=max(ratios),
            ))  # fmt: skip
        if rows := [row for row in results["graphs"] if row.arm == arm]:
            both = [row for row in rows if row.found and row.other is not None]
            difference = max((abs(row.cost - row.other) / row.cost for row in both), default=0.0)
            graphs.append(Row(
                arm=arm, count=len(rows), nodes=float(np.median([row.nodes for row in rows])),
                found=sum(row.found for row in rows), equal=sum(not row.wrong for row in rows), difference=difference,
                other_contact=sum(getattr(row, "other_contact", False) for row in rows),
                other_off=1e3 * max((row.other_off for row in rows if hasattr(row, "other_off")), default=np.nan),
                followed=sum(row.followed for row in rows), contact=sum(getattr(row, "contact", False) for row in rows),
                off=1e3 * max((row.off for row in rows if hasattr(row, "off")), default=np.nan),
            ))  # fmt: skip
    return {
        "audits": row_table({
            "arm": "{0.arm}", "paths": "{0.count:,}", "found": "{0.found}", "wrong": "{0.wrong}",
            "proven out of reach": "{0.proven}", "out of reach or limits": "{0.reach}", "contact": "{0.contact}",
            "jump": "{0.jump}", "others": "{0.others}", "found on a finer grid": "{0.finer}",
            "median": "{0.median:.2f} s", "largest": "{0.most:.1f} s",
        }, audits),
        "tries": row_table({
            "arm": "{0.arm}", "paths": "{0.count:,}", "`follow`": "{0.followed}", "best of 20": "{0.tried}",
            "best of 20 only": "{0.missed}", "median cost": "{0.median:.3f}", "largest": "{0.most:.4f}",
            "above 1": "{0.above}",
        }, tries),
        "large": row_table({
            "path": "{0.name}", "poses": "{0.poses:,}", "configurations": "{0.nodes:,}", "fastest": "{0.seconds:.2f} s",
            "slowest": "{0.slowest:.2f} s",
        }, results["large"]),
        "graphs": row_table({
            "arm": "{0.arm}", "graphs": "{0.count}", "nodes": "{0.nodes:,.0f}", "passable": "{0.found}",
            "equal": "{0.equal}", "largest difference": "{0.difference:.0e}",
        }, graphs),
        "motions": row_table({
            "arm": "{0.arm}", "graphs": "{0.count}", "Descartes: sequences": "{0.found}",
            "in contact": "{0.other_contact}", "off the path": "{0.other_off:.2f} mm",
            "`follow`: motions": "{0.followed}", "in contact ": "{0.contact}", "off the path ": "{0.off:.2f} mm",
        }, graphs),
    }  # fmt: skip


BENCHMARK = Benchmark("tool_paths", measure, blocks)


def main() -> None:
    """Measure, and print or write the page."""
    parser = page_parser(__doc__, "tool_paths")
    parser.add_argument("--paths", type=int, default=PATHS, help="number of audited paths")
    parser.add_argument("--graphs", type=int, default=GRAPHS, help="number of graphs that Descartes solves too")
    parser.add_argument("--tesseract", help="a Python that has tesseract-robotics-nanobind")
    parser.add_argument("--no-large", dest="large", action="store_false", help="without the large paths")
    BENCHMARK.run(parser)


if __name__ == "__main__":
    main()
