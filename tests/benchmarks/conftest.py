"""A small data set in both layouts of MotionBenchMaker."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from benchmarks.__main__ import main

ARM = [f"panda_joint{k}" for k in range(1, 8)]
FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]
START = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
GOAL = [0.6, -0.5, 0.1, -2.1, 0.0, 1.6, 0.9]


def scene(box_at: list[float]) -> dict:
    placed = {"position": box_at, "orientation": [0, 0, 0, 1]}
    box = {"type": "box", "dimensions": [0.1, 0.1, 0.1]}
    return {
        "robot_model_name": "panda",
        "world": {"collision_objects": [{"id": "box", "primitives": [box], "primitive_poses": [placed]}]},
    }


def request_data(start: list[float] = START, goal: list[float] = GOAL, finger: float = 0.03) -> dict:
    """A request whose goal lists the joints in another order than its start."""
    constraints = [{"joint_name": name, "position": value} for name, value in zip(ARM, goal, strict=True)]
    return {
        "group_name": "panda_arm",
        "start_state": {"joint_state": {"name": [*FINGERS, *ARM], "position": [finger, finger, *start]}},
        "goal_constraints": [{"joint_constraints": constraints[::-1]}],
    }


def write_problem(folder: Path, number: int, request: dict, box_at: list[float]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for kind, content in (("scene", scene(box_at)), ("request", request)):
        (folder / f"{kind}{number:04d}.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")


@pytest.fixture(params=["box", "box_panda"], ids=["plain", "original"])
def mbm(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A folder with one set of two problems, the second of which ends in the box."""
    folder = tmp_path / "data" / request.param
    write_problem(folder, 1, request_data(), [0.45, 0.2, 0.1])
    write_problem(folder, 2, request_data(), [0.3, 0.26, 0.51])
    if request.param == "box_panda":  # other files of the original data
        (folder / "scene_sensed0001.yaml").write_text("world: {}\n", encoding="utf-8")
        (folder / "path0001.yaml").write_text("joint_trajectory: {}\n", encoding="utf-8")
        (folder / "config.yaml").write_text("planning_group: panda_arm\n", encoding="utf-8")
    return tmp_path / "data"


@pytest.fixture
def mbm_files() -> SimpleNamespace:
    """Functions that write such files: ``request(...)``, ``scene(box_at)``, and ``write(...)`` for both."""
    return SimpleNamespace(request=request_data, scene=scene, write=write_problem, start=START, goal=GOAL)


@pytest.fixture
def printed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs ``./scripts/benchmark WORDS`` in this process, and returns what it prints."""

    def run(*words: str) -> str:
        monkeypatch.setattr("sys.argv", ["benchmark", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        assert not ended.value.code
        return capsys.readouterr().out

    return run
