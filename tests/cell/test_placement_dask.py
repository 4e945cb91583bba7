"""Base placement on a Dask cluster: a real scheduler and two worker processes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.cell import PlacementBudget, PlacementRegion, place_base
from pinproof.description import robots_folder
from pinproof.picks import PickBudget

from ..processes import PATIENCE

distributed = pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
dask = pytest.importorskip("dask", reason="the extra 'dask' is not installed")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"),
]


def test_search_on_dask_is_interrupted_resumed_and_equal_to_that_of_one_process(tmp_path: Path) -> None:
    picks = pp.read_picks(robots_folder() / "ur5" / "picks.yaml")
    picks = replace(picks, picks=tuple(pick for pick in picks if pick.name in ("bolt_1", "bolt_2")))
    arm, scene = picks.load_arm(), pp.Scene.load(robots_folder() / "ur5" / "scene.yaml")
    region = PlacementRegion(x=(-0.3, 0.1), y=(-0.3, 0.3), yaw=(-np.pi, np.pi))
    settings = {
        "placement_budget": PlacementBudget(grid=60, runs=2, evaluations=12, certified=2),
        "budget": PickBudget(motion=0, compared=4, remedies=0),
    }
    alone = place_base(arm, scene, picks, region, **settings)
    stages: list[str] = []

    def stop(stage: str, done: int, total: int) -> None:
        stages.append(stage)
        if stage == "certify_1" and done == 1:
            raise KeyboardInterrupt

    busy = {"distributed.comm.timeouts.connect": f"{PATIENCE}s", "distributed.comm.timeouts.tcp": f"{PATIENCE}s"}
    with (
        dask.config.set(busy),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=":0",
            local_directory=str(tmp_path / "scratch"),
        ) as cluster,
        distributed.Client(cluster) as client,
    ):  # fmt: skip
        client.wait_for_workers(2, timeout=PATIENCE)
        with pytest.raises(pp.errors.RunInterrupted) as error:
            place_base(
                arm,
                scene,
                picks,
                region,
                executor=client.get_executor(),
                folder=tmp_path / "search",
                progress=stop,
                **settings,
            )
        kept = error.value.result
        assert kept.interrupted
        assert kept.map is not None
        assert alone.map is not None
        assert kept.map.to_csv() == alone.map.to_csv()
        stages.clear()
        again = place_base(
            arm, scene, picks, region, executor=client.get_executor(), folder=tmp_path / "search",
            progress=lambda stage, *_: stages.append(stage), **settings,
        )  # fmt: skip
    assert again.to_dict() == alone.to_dict()
    assert "grid" not in stages
    assert "certify_1" in stages
