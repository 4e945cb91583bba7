"""Planners that need a Python environment of their own, in which a worker of the benchmark runs.

MPlib (Guo and others) is RRT-Connect of OMPL with FCL and needs NumPy 1; Tesseract (ROS-Industrial) is OMPL and TrajOpt
with Bullet.
"""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
import weakref
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from select import select
from time import perf_counter_ns
from typing import Any

import numpy as np
import trimesh
from lxml import etree

from benchmarks.planning_methods import (
    ELAPSED_LIMIT,
    NANOSECONDS_PER_MS,
    TIME_LIMIT,
    PlanAnswer,
    PlanMethod,
    Solve,
    robot_srdf,
    robot_urdf,
    simple_shape,
    without_repetitions,
)
from benchmarks.planning_problems import PlanProblem
from benchmarks.tables import NotApplicableError
from pinproof.collision import CollisionChecker
from pinproof.common.content_hash import digest
from pinproof.motion import JointPath
from pinproof.spatial import matrix

PATIENCE = 10 * ELAPSED_LIMIT
"""Seconds after which a process is ended that gives no answer; the limit of processor time usually ends it before."""

HALF = np.pi - 1e-3
"""Half the range (rad) of a periodic joint: MPlib may end a motion at a goal shifted by 2 pi if the range is larger."""

PIPELINES = {"FreespacePipeline": "OMPL, then TrajOpt", "OMPLPipeline": "OMPL", "TrajOptPipeline": "TrajOpt"}
"""The pipelines of Tesseract that are measured, and the planners that they run."""


def mplib_method(python: str | Path) -> PlanMethod:
    """Return MPlib as a method of the planning benchmark, run by this Python."""
    return PlanMethod("mplib", "MPlib", partial(_prepare, (str(python), "mplib_worker.py")), "mplib", str(python))


def tesseract_methods(python: str | Path) -> list[PlanMethod]:
    """Return the pipelines of Tesseract as methods of the planning benchmark, run by this Python."""
    return [
        PlanMethod(
            f"tesseract_{name}",
            f"Tesseract, {planners}",
            partial(_prepare, (str(python), "tesseract_plan_worker.py", name)),
            "tesseract-robotics-nanobind",
            str(python),
        )
        for name, planners in PIPELINES.items()
    ]


def _prepare(command: Sequence[str], problem: PlanProblem, checker: CollisionChecker) -> Solve:
    """Start a process for a problem. Its URDF has ranges of 2 pi about start and goals, see :data:`HALF`.

    ``command`` is the Python, the worker beside this file, and what the worker is started with.
    """
    arm = problem.arm
    with tempfile.TemporaryDirectory() as folder:
        urdf, srdf = Path(folder) / "robot.urdf", Path(folder) / "robot.srdf"
        text = robot_urdf(problem, partial(_mesh_path, Path(folder)))
        urdf.write_text(_with_one_rotation(text, problem), encoding="utf-8")
        srdf.write_text(robot_srdf(problem, checker), encoding="utf-8")
        worker = subprocess.Popen(
            [command[0], Path(__file__).parent / command[1], *command[2:]],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        job = {
            "urdf": str(urdf),
            "srdf": str(srdf),
            "root": arm.robot.urdf.root,
            "base": arm.base,
            "tcp": arm.tcp,
            "joints": list(arm.joint_names),
            "held": dict(arm.held),
            "obstacles": [
                (each.name, *simple_shape(each), matrix(each.pose).tolist()) for each in problem.scene.obstacles
            ],
            "allowed": [pair.owners for pair in checker.excluded if set(pair.owners) & set(problem.scene.names)],
            "start": problem.start.tolist(),
            "goals": problem.goals.tolist(),
            "time_limit": PATIENCE,
            "processor_limit": TIME_LIMIT,
        }
        _exchange(worker, job)

    def solve(seed: int) -> PlanAnswer:
        began = perf_counter_ns()
        try:
            answer = _exchange(worker, {"seed": seed})
        except _NoAnswerError as error:  # a problem that is not solved
            return PlanAnswer(None, {"plan": (perf_counter_ns() - began) / NANOSECONDS_PER_MS}, message=str(error))
        if answer["path"] is None:
            return PlanAnswer(None, answer["ms"], message=answer["message"])
        return PlanAnswer(JointPath(without_repetitions(np.array(answer["path"])), arm.joint_names), answer["ms"])

    weakref.finalize(solve, _end, worker)
    return solve


def _mesh_path(folder: Path, path: str) -> str:
    """The path of a mesh relative to a folder, or of a copy as STL: MPlib refuses OBJ files that contain lines."""
    if not path.endswith(".obj"):
        return os.path.relpath(path, folder)
    name = f"{digest(path)}.stl"
    trimesh.load(path, force="mesh").export(folder / name)
    return name


def _with_one_rotation(urdf: str, problem: PlanProblem) -> str:
    """The URDF with a range of at most 2 pi for each joint of the arm, about the middle of start and goals."""
    arm, tree = problem.arm, etree.fromstring(urdf.encode())
    ends = np.vstack([problem.start, problem.goals])
    middle = (ends.min(axis=0) + ends.max(axis=0)) / 2
    low, high = (np.maximum(arm.limits.lower, middle - HALF), np.minimum(arm.limits.upper, middle + HALF))
    for joint in tree.iter("joint"):
        if joint.get("name") in arm.joint_names and joint.find("limit") is not None:
            index = arm.joint_names.index(joint.get("name"))
            if arm.periodic[index] and np.ptp(ends[:, index]) < 2 * HALF:
                joint.find("limit").set("lower", repr(float(low[index])))
                joint.find("limit").set("upper", repr(float(high[index])))
    return str(etree.tostring(tree, encoding="unicode"))


class _NoAnswerError(NotApplicableError):
    """The process ended, or gave no answer within :data:`PATIENCE`."""


def _exchange(worker: subprocess.Popen[str], question: dict[str, Any]) -> dict[str, Any]:
    """Send a line of JSON to a worker and return its answer."""
    if worker.stdin is None or worker.stdout is None:
        raise RuntimeError("the worker was started without pipes")
    with suppress(BrokenPipeError):  # of a process that has ended, which is reported below
        print(json.dumps(question), file=worker.stdin, flush=True)
    if not select([worker.stdout], [], [], PATIENCE)[0]:
        worker.kill()
        raise _NoAnswerError(f"the planner gave no answer within {PATIENCE:g} s")
    line = worker.stdout.readline()
    if not line:
        raise _NoAnswerError(f"the process of the planner ended with {worker.wait()}")
    answer: dict[str, Any] = json.loads(line)
    if "error" in answer:
        raise NotApplicableError(answer["error"])
    return answer


def _end(worker: subprocess.Popen[str]) -> None:
    worker.kill()
    worker.communicate()
