"""Benchmark of costs against size (obstacles, triangles of a mesh, joints) with the exponents, and of single calls.

./scripts/benchmark scaling                       prints the tables; 2 min
./scripts/benchmark scaling --largest 10000       up to 10,000 obstacles and triangles
./scripts/benchmark scaling --mbm FOLDER          also checkers and checks of MotionBenchMaker problems
./scripts/benchmark scaling --mbm FOLDER --docs   rewrites docs/benchmarks/scaling.*
"""

from __future__ import annotations

import gc
import os
import resource
import subprocess
import sys
import tempfile
from argparse import Namespace
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

import pinproof as pp
from benchmarks.planning_problems import find_sets, read_problems
from benchmarks.tables import Benchmark, Blocks, Results, Row, fastest, page_parser, provenance, row_table, seconds

COUNTS = {"obstacles": [10, 100, 1000, 10**4, 10**5], "triangles": [10**2, 10**3, 10**4, 10**5, 10**6]}
JOINTS = [3, 4, 6, 8, 10, 12, 14]

REPEATS, CHECKS = 5, 2000
"""Runs of each proof, of which the fastest counts, and configurations of one measurement of checks."""

STEP = 0.6
"""Length (rad) of the edge that is proven."""

COSTS = ("checker", "is_free", "first", "certify")
"""The measured costs: a checker, a check, the first proof of an edge, and the proof of the same edge again."""


def boxes(count: int, rng: np.random.Generator) -> list[pp.Obstacle]:
    """Boxes of 1 to 5 cm in a cube of 6 m around the robot, except within its reach."""
    xyz = rng.uniform(-3, 3, (2 * count + 50, 3))
    xyz = xyz[np.linalg.norm(xyz, axis=1) > 1.1][:count]
    sizes = rng.uniform(0.01, 0.05, (count, 3)).tolist()
    return [
        pp.Obstacle(f"box_{i}", pp.Box(*size), pp.pose(xyz=at))
        for i, (size, at) in enumerate(zip(sizes, xyz, strict=True))
    ]


def sphere(count: int) -> pp.Mesh:
    """An exact mesh of about ``count`` triangles: a sphere of 0.6 m."""
    rows = max(3, round((count / 4) ** 0.5))
    columns = 2 * rows
    polar, around = np.pi * np.arange(1, rows) / rows, 2 * np.pi * np.arange(columns) / columns
    ring = [np.outer(np.sin(polar), f(around)).ravel() for f in (np.cos, np.sin)]
    points = np.stack([*ring, np.repeat(np.cos(polar), columns)], axis=1)
    k, j = np.divmod(np.arange((rows - 2) * columns), columns)
    onward = k * columns + (j + 1) % columns
    here = k * columns + j
    sides = np.concatenate(
        [np.stack([here, here + columns, onward], 1), np.stack([onward, here + columns, onward + columns], 1)]
    )
    top, bottom, turn = len(points), len(points) + 1, np.arange(columns)
    caps = [np.stack([np.full(columns, top), turn, np.roll(turn, -1)], 1)]
    last = turn + (rows - 2) * columns
    caps.append(np.stack([np.full(columns, bottom), np.roll(last, -1), last], 1))
    vertices = 0.3 * np.concatenate([points, [[0, 0, 1], [0, 0, -1]]])
    return pp.Mesh.from_arrays(vertices, np.concatenate([sides, *caps]), hull=False)


def chain(joints: int) -> pp.Arm:
    """An arm of 1 m with this number of joints, whose axes alternate between z and y."""
    length = 1.0 / joints
    shape = f'<origin xyz="0 0 {length / 2}"/><geometry><cylinder radius="0.03" length="{length}"/></geometry>'
    links = "".join(f'<link name="l{i}"><collision>{shape}</collision></link>' for i in range(joints + 1))
    limits = '<limit lower="-3" upper="3" velocity="1" effort="1"/>'
    axes = ("0 0 1", "0 1 0")
    chained = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="0 0 {length}"/><axis xyz="{axes[i % 2]}"/>{limits}</joint>'
        for i in range(joints)
    )
    return pp.load_robot(f'<robot name="chain">{links}{chained}</robot>').arm(tcp=f"l{joints}")


def measured(kind: str, count: int, arm: pp.Arm, scene: pp.Scene, q: np.ndarray, rng: np.random.Generator) -> Row:
    """Measure the costs (s) of an arm beside a scene."""
    made: list[pp.CollisionChecker] = []

    def make() -> None:
        # Obstacles keep their bodies, so that each checker gets new ones.
        new = [pp.Obstacle(each.name, each.shape, each.pose) for each in scene.obstacles]
        made[:] = [pp.CollisionChecker(arm, pp.Scene(new))]

    checker = fastest(make, 3 if kind != "triangles" and count < 10**5 else 1)  # of a mesh, the first time counts
    Q = rng.uniform(-1, 1, (CHECKS, arm.dof)) * arm.limits.upper
    made[0].is_free_batch(Q[:2])
    is_free = fastest(lambda: made[0].is_free_batch(Q), 3) / CHECKS
    edge = pp.JointPath(np.array([q, q + STEP / np.sqrt(arm.dof)]), arm.joint_names)
    first = seconds(lambda: pp.certify(edge, made[0]))
    certify = fastest(lambda: pp.certify(edge, made[0]), REPEATS)
    free = pp.certify(edge, made[0]).free
    wrong = [] if free else [f"the edge among {count} {kind} is not proven"]
    return Row(
        kind=kind, count=count, checker=checker, is_free=is_free, first=first, certify=certify, free=free, wrong=wrong
    )


def rows_of(largest: int, seed: int) -> Iterator[Row]:
    """Measure all numbers of obstacles and of triangles beside a UR5, and arms of several numbers of joints."""
    ur5, rng = pp.load_robot("ur5").arm(), np.random.default_rng(seed)
    q = np.array([0.0, -1.2, 1.0, 0.0, 0.0, 0.0])
    pp.CollisionChecker(ur5)
    for count in COUNTS["obstacles"]:
        if count <= largest:
            yield measured("obstacles", count, ur5, pp.Scene(boxes(count, rng)), q, rng)
    for count in COUNTS["triangles"]:
        if count <= largest:
            mesh = sphere(count)
            scene = pp.Scene([pp.Obstacle("sphere", mesh, pp.pose(xyz=(-0.75, 0.0, 0.3)))])
            yield measured("triangles", len(mesh.triangles), ur5, scene, q, rng)  # type: ignore[arg-type]
    scene = pp.Scene(boxes(100, rng))
    for count in JOINTS:
        arm = chain(count)
        pp.CollisionChecker(arm)
        yield measured("joints", count, arm, scene, np.full(count, 0.1), rng)


RUNS = 200
"""Number of times that a call is measured; the median counts."""

START = """
import pinproof as pp
arm = pp.load_robot("ur5").arm()
pp.CollisionChecker(arm)
"""

LOAD = """
import numpy as np
given = np.load({path!r})
"""

CHECK = """
mesh = pp.Mesh.from_arrays(given["vertices"], given["triangles"], hull=False)
checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("sphere", mesh, pp.pose(xyz={at}))]))
checker.check(np.zeros(6)), checker.clearance(np.zeros(6))
"""

CLOUD = """
checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("cloud", pp.PointCloud(given["points"], 0.01))]))
checker.is_free(np.zeros(6))
"""

PEAK = """
print(open("/proc/self/status").read().split("VmHWM:")[1].split()[0])
"""
"""Programs of the measured processes, and the end of each, which prints its largest memory (kB)."""


def calls(largest: int, mbm: str | None, seed: int) -> Iterator[Row]:
    """Measure single calls (ms) on checkers and arms, and processes with large inputs."""
    rng = np.random.default_rng(seed)

    def row(what: str, call: Callable[[int], object], runs: int) -> Row:
        gc.freeze()  # the garbage collector does not search what is made for the measurements
        return Row(what=what, ms=1e3 * float(np.median([seconds(partial(call, i)) for i in range(runs)])))

    # Checkers that are derived from another, each with a change that it has not seen
    ur5, panda = pp.load_robot("ur5").arm(), pp.load_robot("panda").arm()
    scene = pp.Scene(boxes(100, rng))
    checker, hand = pp.CollisionChecker(ur5, scene), pp.CollisionChecker(panda)
    moved = [scene.move("box_3", pp.pose(xyz=(2, 0, 0.005 * i))) for i in range(RUNS)]
    tools = [pp.Obstacle(f"tool_{i}", pp.Cylinder(0.03, 0.1 + 0.0005 * i)) for i in range(RUNS)]
    parts = [pp.Obstacle("part", pp.Cylinder(0.03, 0.1), pp.pose(xyz=(0, 0, 0.0005 * i))) for i in range(RUNS)]
    finger = next(iter(panda.held))
    yield row("checker with one of 100 obstacles moved", lambda i: checker.with_scene(moved[i]), RUNS)
    yield row("checker with a part at another pose", lambda i: checker.with_attached(parts[i]), RUNS)
    yield row("checker with a tool of a new shape", lambda i: checker.with_attached(tools[i]), RUNS)
    yield row(
        "checker with the hand of a Panda at a new position", lambda i: hand.with_held({finger: 0.04 * i / RUNS}), RUNS
    )
    # Inverse kinematics at a pose that each arm reaches
    middle = np.mean(panda.limits.sampling_range(), axis=0)
    for_panda, for_ur5 = panda.forward_kinematics(middle + 0.3), ur5.forward_kinematics(np.full(6, 0.7))
    clik, analytic = pp.Clik(), pp.AnalyticIk()
    yield row("`Clik().solve`, Panda", lambda _: clik.solve(panda, for_panda, middle), RUNS)
    yield row("`AnalyticIk().solve_all`, UR5, a `pin.SE3`", lambda _: analytic.solve_all(ur5, for_ur5), RUNS)
    # Checkers and checks of scenes that are not ours
    problems = [each for found in find_sets(mbm, None) for each in read_problems(found, None)] if mbm else []
    if problems:
        own = [pp.CollisionChecker(each.arm, each.scene) for each in problems]
        Q = rng.uniform(*problems[0].arm.limits.sampling_range(), (CHECKS, own[0].group.dof))
        new = [pp.Scene([pp.Obstacle(o.name, o.shape, o.pose) for o in each.scene.obstacles]) for each in problems]
        count = f"median of {len(problems)} problems of MotionBenchMaker"
        yield row(f"checker, {count}", lambda i: pp.CollisionChecker(problems[i].arm, new[i]), len(problems))
        checks = [fastest(partial(each.is_free_batch, Q), REPEATS) / CHECKS for each in own]
        yield Row(what=f"`is_free_batch`, a configuration, {count}", ms=1e3 * float(np.median(checks)))
    # Processes, including the start of Python and all imports
    mesh, points = sphere(min(largest, 327_680)), 6 * rng.random((min(largest, 10**6), 3)) + [1.0, -3.0, 0.0]
    triangles = f"{len(mesh.triangles):,} triangles"  # type: ignore[arg-type]
    with tempfile.TemporaryDirectory() as folder:
        saved = Path(folder) / "inputs.npz"
        np.savez(saved, vertices=mesh.vertices, triangles=mesh.triangles, points=points)  # type: ignore[arg-type]
        environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": folder}
        subprocess.run([sys.executable, "-c", START], check=True, env=environment)  # compiles the modules
        load = START + LOAD.format(path=str(saved))
        for what, script in (
            ("an arm and its checker", START),
            (f"a check beside an exact mesh of {triangles}", load + CHECK.format(at=(-0.75, 0.0, 0.3))),
            ("the same with links inside the mesh", load + CHECK.format(at=(0.4, 0.2, 0.3))),
            (f"a checker beside a cloud of {len(points):,} scattered points", load + CLOUD),
        ):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            done = subprocess.run(
                [sys.executable, "-c", script + PEAK], check=True, capture_output=True, text=True, env=environment
            )
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            yield Row(what=f"process: {what}", ms=1e3 * spent, peak_mb=int(done.stdout.split()[-1]) / 1024)


def exponent(rows: list[Row], cost: str) -> float:
    """Return the slope of the cost against the number on logarithmic scales, by least squares."""
    numbers = np.log([(row.count, getattr(row, cost)) for row in rows])
    return float(np.polyfit(*numbers.T, 1)[0])


def blocks(results: Results) -> Blocks:
    """The tables of the page."""
    every: list[Row] = results["costs"]
    columns = {
        "number of": "{.kind}",
        "number": "{.count:,}",
        "scene and checker [ms]": lambda row: f"{1e3 * row.checker:.2f}",
        "`is_free` [µs]": lambda row: f"{1e6 * row.is_free:.2f}",
        "first `certify` [ms]": lambda row: f"{1e3 * row.first:.2f}",
        "`certify` again [ms]": lambda row: f"{1e3 * row.certify:.3f}",
    }
    kinds = dict.fromkeys(row.kind for row in every)
    fitted = [
        Row(kind=kind, **{cost: exponent([row for row in every if row.kind == kind], cost) for cost in COSTS})
        for kind in kinds
    ]
    titles = ("scene and checker", "`is_free`", "first `certify`", "`certify` again")
    slopes = {"exponent of": "{.kind}"}
    for title, cost in zip(titles, COSTS, strict=True):
        slopes[title] = f"{{.{cost}:.2f}}"
    single = {
        "call": "{.what}",
        "time [ms]": lambda row: f"{row.ms:.4g}",
        "memory [MB]": lambda row: f"{row.peak_mb:.0f}" if hasattr(row, "peak_mb") else "",
    }
    return {
        "costs": row_table(columns, every),
        "exponents": row_table(slopes, fitted),
        "calls": row_table(single, results["calls"]),
    }


def measure(options: Namespace) -> Results:
    """Measure with the arguments of the command line."""
    single = list(calls(options.largest, options.mbm, options.seed))  # before the memory is in pieces
    return Results(
        {"largest": options.largest},
        provenance(options.seed),
        {"costs": list(rows_of(options.largest, options.seed)), "calls": single},
    )


BENCHMARK = Benchmark("scaling", measure, blocks)


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = page_parser(__doc__, "scaling")
    parser.add_argument("--largest", type=int, default=10**6, help="the largest number of obstacles and of triangles")
    parser.add_argument("--mbm", metavar="FOLDER", help="MotionBenchMaker problems")
    BENCHMARK.run(parser)
