"""Campaigns and base placement on a Dask cluster: a real scheduler, real worker processes, some of which die."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.cell import PlacementBudget, PlacementRegion, place_base
from pinproof.description import robots_folder
from pinproof.picks import PickBudget

from ..pages import run_main
from ..processes import PATIENCE

distributed = pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
dask = pytest.importorskip("dask", reason="the extra 'dask' is not installed")

# What Dask leaves open when its processes are killed is not ours to close.
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture(scope="module")
def cluster(tmp_path_factory) -> Iterator[distributed.LocalCluster]:
    """A scheduler and two worker processes on this machine, which are replaced when they die."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parent))  # the processes have the paths of this one
        patch.setenv("CAMPAIGN_TEST_FLAG", str(tmp_path_factory.mktemp("dask") / "flag"))
        # a busy machine starts a worker, and lets it answer, later than Dask waits by default
        busy = {"distributed.comm.timeouts.connect": f"{PATIENCE}s", "distributed.comm.timeouts.tcp": f"{PATIENCE}s"}
        with (
            dask.config.set(busy),
            distributed.LocalCluster(
                n_workers=2,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address=":0",
                local_directory=str(tmp_path_factory.mktemp("scratch")),
            ) as made,  # fmt: skip
        ):
            yield made


@pytest.fixture
def client(cluster) -> Iterator[distributed.Client]:
    with distributed.Client(cluster) as made:
        made.wait_for_workers(2, timeout=PATIENCE)
        yield made


def run_by_threads(made: pp.Campaign, folder: Path) -> bytes:
    with ThreadPoolExecutor(2) as threads:
        return made.run(folder, executor=threads).path.read_bytes()


def test_picks_of_a_killed_worker_are_judged_again(client, stick, many, judges, tmp_path) -> None:
    killed: list[int] = []

    def kill_one(done: int, total: int) -> None:
        if done >= 60 and not killed:
            killed.append(next(iter(client.run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)

    made = pp.Campaign(stick, pp.Scene(), many, judge=judges.slow)
    result = made.run(tmp_path / "dask", executor=client.get_executor(), chunk=3, in_flight=4, progress=kill_one)
    assert killed
    assert result.ok
    assert result.path.read_bytes() == run_by_threads(made, tmp_path / "threads")
    times = [json.loads(line) for line in (tmp_path / "dask" / "timings.jsonl").read_text().splitlines()]
    assert len({time["worker"] for time in times} - {f"{os.uname().nodename}:{os.getpid()}"}) >= 2


def test_a_pick_that_kills_its_workers_is_found(cluster, client, stick, many, judges, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(cluster.scheduler, "allowed_failures", 0)  # by default Dask tries four times itself
    made = pp.Campaign(stick, pp.Scene(), many, judge=judges.dies_on_7)
    result = made.run(tmp_path, executor=client.get_executor(), chunk=2, in_flight=2)
    rows = list(result.rows())
    assert [row["index"] for row in rows if row["verdict"] == "crashed"] == [7]
    assert result.summary == "119 of 120 picks good; failed: 1 at no stage (crashed)"


def test_real_picks_have_the_same_rows_and_verdicts_as_here(client, arms, cells, reports, tmp_path) -> None:
    arm, (scene, picks) = arms["generic_6dof"], cells["generic_6dof"]
    made = pp.Campaign(arm, scene, picks)
    result = made.run(tmp_path / "dask", executor=client.get_executor(), chunk=1)
    assert result.path.read_bytes() == run_by_threads(made, tmp_path / "threads")
    data = reports["generic_6dof"].to_dict()["picks"]
    for row, pick in zip(result.rows(), data, strict=True):
        assert {**row, "excluded_pairs": 0} == {**pick, "excluded_pairs": 0, "index": row["index"]}
    report = pp.validate_picks(arm, scene, picks, executor=client.get_executor())
    assert report.to_dict() == reports["generic_6dof"].to_dict()


def test_the_command_line_takes_a_scheduler(cluster, tmp_path) -> None:
    picks = str(robots_folder() / "generic_6dof" / "picks.yaml")
    for more in (("--campaign", str(tmp_path / "out")), ("-o", str(tmp_path / "report.json"))):
        code, out, _ = run_main("pick", picks, "--dask", cluster.scheduler_address, *more)
        assert (code, "2 of 4 picks good" in out) == (1, True)
    assert pp.picks.CampaignResult.open(tmp_path / "out").good == 2


def test_a_search_of_placements_is_interrupted_resumed_and_equal_to_that_of_one_process(client, tmp_path: Path) -> None:
    picks = pp.read_picks(robots_folder() / "ur5" / "picks.yaml")
    picks = replace(picks, picks=picks.picks[:2])
    arm, scene = picks.load_arm(), pp.Scene.load(picks.scene)
    region = PlacementRegion(x=(-0.3, 0.1), y=(-0.3, 0.3), yaw=(-np.pi, np.pi))
    settings = {
        "placement_budget": PlacementBudget(grid=30, runs=1, evaluations=6, certified=1, deviations=1),
        "budget": PickBudget(motion=0, compared=4, remedies=0),
    }
    alone = place_base(arm, scene, picks, region, **settings)
    stages: list[str] = []

    def stop(stage: str, done: int, total: int) -> None:
        if stage == "certify_1" and done == 1:
            raise KeyboardInterrupt

    there = {"executor": client.get_executor(), "folder": tmp_path / "search", **settings}
    with pytest.raises(pp.errors.RunInterrupted) as error:
        place_base(arm, scene, picks, region, progress=stop, **there)
    assert error.value.result.interrupted
    assert error.value.result.map.to_csv() == alone.map.to_csv()
    again = place_base(arm, scene, picks, region, progress=lambda stage, *_: stages.append(stage), **there)
    assert again.to_dict() == alone.to_dict()
    assert "grid" not in stages
    assert "certify_1" in stages
