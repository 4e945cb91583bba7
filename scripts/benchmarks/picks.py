"""Benchmark of picks: judging through all stages, screening of poses, campaigns.

./scripts/benchmark picks                        all cells; prints the table; some minutes
./scripts/benchmark picks ur5 --campaign 0       one cell, without campaigns
./scripts/benchmark picks --docs                 rewrites docs/benchmarks/picks.*
./scripts/benchmark picks --durations [--docs]   only durations, which do not depend on the machine
"""

from __future__ import annotations

import argparse
import logging
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.tables import (
    Benchmark,
    Blocks,
    Results,
    Row,
    fastest,
    page_parser,
    provenance,
    report,
    row_table,
    wrapped,
)
from pinproof.collision import CollisionChecker, Cylinder, Obstacle, Scene, audit
from pinproof.description import robots_folder
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import Arm, load_robot
from pinproof.picks import (
    Campaign,
    Pick,
    PickList,
    PickMotion,
    Picks,
    PickSetup,
    PlaceTarget,
    ScreenStatus,
    read_picks,
    screen_picks,
)
from pinproof.picks.batch.screening import Screening
from pinproof.spatial import SE3, pose

Array = npt.NDArray[np.float64]

TILT = np.radians(30.0)
"""Largest angle between the approach direction and the vertical; carried bolts are vertical."""

LOWEST, HIGHEST = 0.035, 0.25
"""Height range of picks above the base in m; the lowest is the head of a bolt on the table."""

BOLT = Cylinder(radius=0.008, length=0.04)

DISTANCES = {"ur5": (0.15, 0.85), "panda": (0.15, 0.8), "generic_6dof": (0.15, 0.75)}
"""Horizontal distances of picks from the base in m: the largest are slightly out of reach."""

CELLS = (*DISTANCES, "ur5, carried")

SHIPPED = {
    "ur5/picks": 1,
    "ur5/carry": 1,
    "ur5/plate_picks": 1,
    "panda/picks": 1,
    "panda/bin_picks": 1,
    "generic_6dof/picks": 1,
    "generic_6dof/machine_picks": 1,
    "ur10/pallet_picks": 20,
}
"""Files of picks in the package whose durations are measured: every first or every n-th pick."""

AUDIT_STEP = 0.002
"""rad: largest step of a joint between two samples of an audit."""

WARM_UP_PICKS = 4
"""Picks that are judged before the measurement, which loads compiled code."""

RUNS = 3, perf_counter
"""Number of runs of each screening, of which the fastest counts, and their clock."""

CHUNK = 4096
"""Poses per call, as in screen_picks."""

CAMPAIGN_WARM_UP = 64
"""Picks of a first campaign, which fills the caches of compiled code and of files."""

STEADY_FROM, STEADY_TO = 0.2, 0.9
"""The steady rate is measured between these shares of the picks, while all workers are busy."""


def picks_benchmark(
    cells: Sequence[str] = CELLS,
    *,
    picks: int = 200,
    poses: int = 20_000,
    campaign: int = 1_500,
    overhead: int = 20_000,
    durations: Sequence[str] = tuple(SHIPPED),
    seed: int = 0,
) -> Results:
    """Run the benchmark in the cells of the package.

    ``picks`` and ``poses`` are judged and screened in each cell; ``campaign`` is the number of picks of the campaigns,
    and ``overhead`` that of the campaign without judging, which run in the first cell. 0 skips a part. ``durations``:
    files of :data:`SHIPPED` whose durations are measured.
    """
    counts = {"picks": picks, "poses": poses, "campaign": campaign, "overhead": overhead}
    if min(counts.values()) < 0:
        raise InputError(f"picks, poses, campaign and overhead must be at least 0, not {counts}")
    for file in durations:
        if file not in SHIPPED:
            raise UnknownNameError("file of picks", file, list(SHIPPED))
    selected = [pick_cell(name) for name in cells]
    origin = provenance(seed)  # first, since the load must be that of other processes
    parts = ("verdicts", "screening", "campaigns", "overhead", "durations")
    rows: dict[str, list[Row]] = {name: [] for name in parts}
    for cell in selected:
        if picks:
            report(f"{cell.name}: {picks} picks through all stages")
            rows["verdicts"] += verdict_rows(cell, picks, seed)
        if poses and cell.name in DISTANCES:
            report(f"{cell.name}: {poses:,} poses screened")
            rows["screening"] += screen_rows(cell, poses, seed)
    for row in campaign_rows(selected[0], campaign, seed) if campaign and selected else ():
        report(f"{row.cell}: campaign of {campaign:,} picks, {row.workers}: {row.wall_s:.1f} s")
        rows["campaigns"].append(row)
    if overhead and selected:
        report(f"{selected[0].name}: campaign of {overhead:,} picks without judging")
        rows["overhead"].append(overhead_row(selected[0], overhead, seed))
    for file in durations:
        report(f"{file}: durations")
        rows["durations"].append(duration_row(file))
    return Results(counts, origin, dict(rows))


# -- random picks ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PickCell:
    """A cell: the arm, the scene, the settings shared by its picks, and their smallest and largest distance (m)."""

    name: str
    arm: Arm
    scene: Scene
    shared: Picks
    nearest: float
    farthest: float

    def picks(self, count: int, seed: int) -> Picks:
        """Return random picks from above, tilted by up to 30 degrees, in front of the arm."""
        rng = np.random.default_rng(seed)
        return replace(self.shared, picks=tuple(self._pick(f"pick_{i}", rng) for i in range(count)), problems=())

    def poses(self, count: int, seed: int) -> Array:
        """Return the poses (N, 4, 4) of random picks, ``root_from_tip``."""
        rng = np.random.default_rng(seed)
        return np.array([self._pose(rng, TILT).homogeneous for _ in range(count)])

    def reachable_poses(self, count: int, seed: int) -> Array:
        """Return poses (N, 4, 4) of random configurations within the limits."""
        low, high = self.arm.limits.sampling_range()
        q = np.random.default_rng(seed).uniform(low, high, (count, self.arm.dof))
        base_from_tcp = self.arm.forward_kinematics_batch(q)
        return np.asarray(self.arm.root_from_base.homogeneous @ base_from_tcp @ self.shared.tip.homogeneous)

    def _pick(self, name: str, rng: np.random.Generator) -> Pick:
        if self.name in DISTANCES:
            return Pick(name, self._pose(rng, TILT))
        grasp, put = self._pose(rng, 0.0), self._pose(rng, 0.0)
        bolt = Obstacle("bolt", BOLT, pose(xyz=(0.0, 0.0, BOLT.length / 2)))
        return Pick(name, grasp, carried=bolt, place=PlaceTarget(put))

    def _pose(self, rng: np.random.Generator, tilt: float) -> SE3:
        azimuth, distance = rng.uniform(-np.pi / 2, np.pi / 2), rng.uniform(self.nearest, self.farthest)
        height = rng.uniform(LOWEST, HIGHEST) if tilt else LOWEST
        xyz = (distance * np.cos(azimuth), distance * np.sin(azimuth), height)
        angle, direction, spin = rng.uniform(0.0, tilt), *rng.uniform(-np.pi, np.pi, 2)
        turned = pose(rpy=(0.0, 0.0, direction)) * pose(rpy=(0.0, np.pi - angle, 0.0)) * pose(rpy=(0.0, 0.0, spin))
        return SE3(turned.rotation, np.array(xyz))


def pick_cell(name: str) -> PickCell:
    """Return a cell of :data:`CELLS`."""
    if name not in CELLS:
        raise UnknownNameError("cell", name, CELLS)
    robot = name.partition(",")[0]
    shared = read_picks(robots_folder() / robot / "picks.yaml")
    arm = load_robot(robot).arm(shared.tcp, held=shared.held)
    return PickCell(name, arm, Scene.load(robots_folder() / robot / "scene.yaml"), shared, *DISTANCES[robot])


# -- judging and screening ---------------------------------------------------------------------------------------------


def verdict_rows(cell: PickCell, count: int, seed: int) -> list[Row]:
    """Judge random picks one by one through all stages on one thread; one row for all and one for each verdict."""
    picks = cell.picks(count, seed)
    setup = PickSetup.make(cell.arm, cell.scene, picks, home=None, rng=seed)
    for index, pick in enumerate(cell.picks(WARM_UP_PICKS, seed + 1)):
        setup.judge(index, pick)
    times: dict[str, list[float]] = {"all": []}
    for index, pick in enumerate(picks):
        begin = perf_counter()
        verdict = setup.judge(index, pick)
        ms = 1e3 * (perf_counter() - begin)
        for name in ("all", verdict.status.value):
            times.setdefault(name, []).append(ms)
    rows = []
    for name, values in times.items():
        median, p95 = np.percentile(values, (50, 95)).tolist()
        figures = {"mean_ms": float(np.mean(values)), "median_ms": median, "p95_ms": p95, "largest_ms": max(values)}
        rows.append(Row(cell=cell.name, verdict=name, picks=len(values), **figures))
    return rows


def duration_row(file: str) -> Row:
    """Judge picks of a file of the package, with and without stops between stages, and audit the motions.

    The durations are means in s of good picks; ``unsafe`` is the number of motions with a contact of exact meshes.
    """
    shared = read_picks(robots_folder() / f"{file}.yaml")
    arm, scene = shared.load_arm(), Scene.load(shared.scene or Path())
    setup = PickSetup.make(arm, scene, shared, home=None, rng=0)
    stopping = replace(setup, budget=replace(setup.budget, motion=0))
    seconds: dict[PickSetup, list[float]] = {setup: [], stopping: []}
    motions = unsafe = 0
    for index in range(0, len(shared), SHIPPED[file]):
        verdicts = {each: each.judge(index, shared.picks[index]) for each in seconds}
        if not all(verdict.ok for verdict in verdicts.values()):
            continue
        for each, verdict in verdicts.items():
            seconds[each].append(verdict.trajectory.duration)  # type: ignore[union-attr]
        motions += len(verdicts[setup].motions)
        unsafe += unsafe_motions(setup, verdicts[setup].motions)
    mean, stopping = (float(np.mean(each)) for each in seconds.values())
    return Row(cell=file, good=len(seconds[setup]), stopping_s=stopping, mean_s=mean, motions=motions, unsafe=unsafe)


def unsafe_motions(setup: PickSetup, motions: Sequence[PickMotion], step: float = AUDIT_STEP) -> int:
    """The number of motions in contact, on the exact meshes in the scene of their moment.

    The tool may touch the part that it holds, and the part may touch the supports that it is proven to leave.
    """
    hand = set(setup.cell.hand)
    unsafe = 0
    bare: dict[tuple[object, ...], CollisionChecker] = {}  # exact meshes are read once for each state of the gripper
    for motion in motions:
        key = tuple(sorted(motion.held.items()))
        if key not in bare:
            arm = setup.checker.arm.with_held(motion.held)
            bare[key] = CollisionChecker(arm, Scene(), link_meshes="mesh")
        checker = bare[key].with_attached(*motion.attached).with_scene(motion.scene)
        known = set(checker.obstacles_and_links)
        excluded = [tuple(pair.owners) for pair in motion.certificate.excluded]
        touching = [pair for pair in excluded if set(pair) <= known and hand & set(pair)]
        touching += [tuple(each.bodies) for each in motion.certificate.partings]
        unsafe += not audit(motion.trajectory, checker.allowing(*touching), step=step, measure=False).clean
    return unsafe


def screen_rows(cell: PickCell, count: int, seed: int) -> Iterator[Row]:
    """Screen the poses of random picks, and poses of random configurations; poses per second."""
    settings: dict[str, Any] = {"tip": cell.shared.tip, "tool": cell.shared.open_tool, "margin": cell.shared.margin}
    picks = PickList(cell.picks(count, seed))
    setup = PickSetup.make(cell.arm, cell.scene, picks.shared, home=None, rng=seed)
    reach_only = Screening(_NoContacts(setup.checker), setup.home, why=False)
    tip_from_tcp = np.linalg.inv(cell.shared.tip.homogeneous)
    base_from_root = np.linalg.inv(cell.arm.root_from_base.homogeneous)
    kinds = {"picks": cell.poses(count, seed), "random configurations": cell.reachable_poses(count, seed)}
    for kind, poses in kinds.items():
        targets = np.ascontiguousarray(base_from_root @ poses @ tip_from_tcp)

        def screen(poses: Array = poses, **more: Any) -> Any:
            return screen_picks(cell.arm, cell.scene, poses, home=setup.home, **settings, **more)

        def reach(targets: Array = targets) -> None:
            for start in range(0, count, CHUNK):
                reach_only.screen(targets[start : start + CHUNK])

        def screen_pick_objects() -> None:
            screen_picks(cell.arm, cell.scene, picks, home=setup.home)

        yield Row(
            cell=cell.name,
            poses=kind,
            count=count,
            free=screen().counts[ScreenStatus.FREE] / count,
            rate=count / fastest(screen, *RUNS),
            with_clearance=count / fastest(lambda screen=screen: screen(clearance=True), *RUNS),
            reach_only=count / fastest(reach, *RUNS),
            as_picks=count / fastest(screen_pick_objects, *RUNS) if kind == "picks" else None,
            two_threads=count / fastest(lambda screen=screen: screen(threads=2), *RUNS),
        )


class _NoContacts:
    """Replaces a checker: every configuration is free."""

    def __init__(self, checker: Any) -> None:
        self.arm, self.scene = checker.arm, checker.scene

    def is_free_batch(self, Q: Array) -> npt.NDArray[np.bool_]:
        return np.ones(len(Q), dtype=bool)


# -- campaigns ---------------------------------------------------------------------------------------------------------


def campaign_rows(cell: PickCell, count: int, seed: int) -> Iterator[Row]:
    """Judge the same random picks with one process, with two, and with two of Dask if it is installed."""
    warm_up = Campaign(cell.arm, cell.scene, cell.picks(min(count, CAMPAIGN_WARM_UP), seed), rng=seed)
    _run(warm_up, cell.name, "", workers=2)
    campaign = Campaign(cell.arm, cell.scene, cell.picks(count, seed), rng=seed)
    yield _run(campaign, cell.name, "1 process", workers=1)
    yield _run(campaign, cell.name, "2 processes", workers=2)
    with _dask_executor() as executor:
        if executor is not None:
            yield _run(campaign, cell.name, "Dask, 2 processes", executor=executor, in_flight=4)


def overhead_row(cell: PickCell, count: int, seed: int) -> Row:
    """Run a campaign whose judge does nothing."""
    campaign = Campaign(cell.arm, cell.scene, cell.picks(count, seed), rng=seed, judge=empty_verdict)
    return _run(campaign, cell.name, "1 process, no judging", workers=1)


def empty_verdict(setup: PickSetup, index: int, pick: Pick) -> dict[str, Any]:
    """Return the row of a pick without judging it. Worker processes import this function by its module name."""
    del setup, index
    return {"name": pick.name, "verdict": "not found", "failed_at": "input"}


def _run(campaign: Campaign, cell: str, label: str, **options: Any) -> Row:
    progress: list[tuple[float, int]] = []
    with tempfile.TemporaryDirectory() as folder:
        begin = perf_counter()
        campaign.run(Path(folder), progress=lambda done, _: progress.append((perf_counter(), done)), **options)
        wall = perf_counter() - begin
    count = len(campaign)
    steady = steady_rate(progress, count)
    return Row(cell=cell, workers=label, picks=count, wall_s=wall, rate=count / wall, steady_rate=steady)


def steady_rate(progress: list[tuple[float, int]], count: int) -> float:
    """Return picks per second between :data:`STEADY_FROM` and :data:`STEADY_TO`; over all picks if there are few.

    ``progress`` lists times (s) and the numbers of picks done.
    """
    times, done = np.array(progress).T
    first, last = np.searchsorted(done, (STEADY_FROM * count, STEADY_TO * count)).tolist()
    if last <= first:
        first, last = 0, len(done) - 1
    return float((done[last] - done[first]) / (times[last] - times[first]))


@contextmanager
def _dask_executor() -> Iterator[Any]:
    """An executor of two processes of one thread each; None if Dask is not installed."""
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        yield None
        return
    with (
        tempfile.TemporaryDirectory() as scratch,
        LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=":0",
            local_directory=scratch, silence_logs=logging.ERROR,
        ) as cluster,
        Client(cluster) as client,
    ):  # fmt: skip
        client.wait_for_workers(2, timeout=60)
        yield client.get_executor()


def blocks(results: Results) -> Blocks:
    """The tables of the page."""
    verdicts = {
        "cell": "{.cell}",
        "verdict": "{.verdict}",
        "picks": "{.picks}",
        "median": "{.median_ms:.1f}",
        "p95": "{.p95_ms:.1f}",
        "maximum": "{.largest_ms:.1f}",
        "mean": "{.mean_ms:.1f}",
    }
    durations = {
        "cell": "{.cell}",
        "good picks": "{.good}",
        "with stops, s": "{.stopping_s:.3f}",
        "default, s": "{.mean_s:.3f}",
        "shorter by": lambda row: f"{100 * (1 - row.mean_s / row.stopping_s):.0f} %",
        "motions in contact": "{0.unsafe} of {0.motions}",
    }
    screening = {
        "cell": "{.cell}",
        "poses": "{0.count:,}, {0.poses}",
        "free": lambda row: f"{100 * row.free:.0f} %",
        "poses/s": "{.rate:,.0f}",
        "reach only": "{.reach_only:,.0f}",
        "with clearance": "{.with_clearance:,.0f}",
        "as picks": lambda row: "-" if row.as_picks is None else f"{row.as_picks:,.0f}",
        "2 threads": "{.two_threads:,.0f}",
    }
    campaigns = {
        "cell": "{.cell}",
        "workers": "{.workers}",
        "picks": "{.picks:,}",
        "total, s": "{.wall_s:.1f}",
        "picks/s": "{.rate:.1f}",
        "speed-up": lambda row: f"{row.rate / results['campaigns'][0].rate:.2f}",
        "steady picks/s": "{.steady_rate:.1f}",
        "steady speed-up": lambda row: f"{row.steady_rate / results['campaigns'][0].steady_rate:.2f}",
    }
    overhead = [
        f"Without judging, {row.picks:,} picks take {row.wall_s:.1f} s in one process; the steady overhead of a "
        f"campaign is {1e6 / row.steady_rate:.0f} us per pick, for generating the picks and writing the results."
        for row in results["overhead"]
    ]
    return {
        "verdicts": row_table(verdicts, results["verdicts"], text_columns=2),
        "durations": row_table(durations, results["durations"]),
        "screening": row_table(screening, results["screening"], text_columns=2),
        "campaigns": row_table(campaigns, results["campaigns"], text_columns=2),
        "overhead": wrapped(*overhead),
    }


def measure(options: argparse.Namespace) -> Results:
    """Measure the parts that the options select."""
    if options.durations:
        return Results({}, provenance(options.seed), {"durations": list(map(duration_row, options.files))})
    counts = {name: getattr(options, name) for name in ("picks", "poses", "campaign", "overhead")}
    return picks_benchmark(options.cells or CELLS, **counts, durations=options.files, seed=options.seed)


BENCHMARK = Benchmark("picks", measure, blocks)


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = page_parser(__doc__, "picks")
    parser.add_argument("cells", nargs="*", metavar="CELL", help="ur5, panda, generic_6dof, 'ur5, carried'")
    for name, default, text in (
        ("picks", 200, "picks to judge in each cell"),
        ("poses", 20_000, "poses to screen in each cell"),
        ("campaign", 1_500, "picks of the campaigns"),
        ("overhead", 20_000, "picks of a campaign without judging"),
    ):
        parser.add_argument(f"--{name}", type=int, default=default, metavar="N", help=text)
    files = "files of which durations are measured"
    parser.add_argument("--files", nargs="*", default=list(SHIPPED), metavar="FILE", help=files)
    parser.add_argument("--durations", action="store_true", help="measure durations only")
    BENCHMARK.run(parser)
