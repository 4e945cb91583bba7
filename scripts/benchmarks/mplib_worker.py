"""Plans with MPlib for the planning benchmark, in an environment of its own that needs nothing of pinproof.

worker_peers.py starts it. The first line on standard input is the problem as JSON, each further line asks for a
path with a seed. Each answer is a line of JSON. MPlib prints to standard output too, so the answers go to a copy of it.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import time
from typing import Any

import numpy as np

RANGE = 0.1
"""rad: the longest edge, the default of ``plan_qpos``."""


def _planner(job: dict[str, Any]) -> Any:
    import mplib
    from mplib.collision_detection import fcl

    planner = mplib.Planner(urdf=job["urdf"], srdf=job["srdf"], move_group=job["tcp"])
    for name, kind, sizes, pose in job["obstacles"]:
        body = fcl.CollisionObject(getattr(fcl, kind)(*sizes), mplib.Pose(np.array(pose)))
        planner.planning_world.add_object(name, body)
    for one, other in job["allowed"]:
        planner.acm.set_entry(one, other, True)
    return planner


def _ends(planner: Any, job: dict[str, Any]) -> tuple[Any, list[Any], list[int]]:
    """Start and goals in the order of the joints of the planner, and the place of each of our joints in it."""
    names = list(planner.user_joint_names)
    moving = [names[index] for index in planner.move_group_joint_indices]
    if sorted(moving) != sorted(job["joints"]):
        raise ValueError(f"its joints are {moving}, not {job['joints']}")
    full = np.array([job["held"].get(name, 0.0) for name in names])
    order = [job["joints"].index(name) for name in moving]
    start, goals = np.array(job["start"])[order], [np.array(goal)[order] for goal in job["goals"]]
    full[planner.move_group_joint_indices] = start
    planner.robot.set_qpos(full, True)
    return start, goals, [moving.index(name) for name in job["joints"]]


def _main() -> None:
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    def answer(content: dict[str, Any]) -> None:
        print(json.dumps(content), file=answers, flush=True)

    try:
        import mplib

        job = json.loads(sys.stdin.readline())
        planner = _planner(job)
        start, goals, order = _ends(planner, job)
        answer({})
        for line in sys.stdin:
            mplib.set_global_seed(json.loads(line)["seed"])
            began = time.process_time()
            # OMPL knows a limit of elapsed time only: the system ends a process that works for longer
            resource.setrlimit(resource.RLIMIT_CPU, (int(began + job["processor_limit"]) + 1, resource.RLIM_INFINITY))
            status, path = planner.planner.plan(start, goals, time=job["time_limit"], range=RANGE, simplify=True)
            ms = {"plan": 1e3 * (time.process_time() - began)}
            found = status == "Exact solution"
            answer({"path": np.asarray(path)[:, order].tolist() if found else None, "ms": ms, "message": str(status)})
    except Exception as error:  # noqa: BLE001  # reported to the benchmark
        answer({"error": f"{type(error).__name__}: {error}"})


if __name__ == "__main__":
    _main()
