"""Benchmark of timing: the same rounded paths by pinproof, copp-py and toppra, each in the Python that has it.

./scripts/benchmark timing --mbm FOLDER                      ours
./scripts/benchmark timing --mbm FOLDER --peers PYTHON       also copp-py and toppra in the environment of this Python

The paths are the shortened and rounded ones of MotionBenchMaker's Panda problems, with the velocity limits of the Panda
and 15 rad/s^2. Processor time of a call is the fastest of three.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np

import pinproof as pp
from benchmarks.planning_problems import find_sets, read_problems

ACCELERATION = 15.0
"""Limit of every joint in rad/s^2."""

REPEATS, GRID = 3, 500
"""Calls of which the fastest counts, and grid points of the other libraries."""


def main() -> None:
    """Time the paths and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mbm", type=Path, required=True, metavar="FOLDER", help="MotionBenchMaker problems")
    parser.add_argument("--problems", type=int, default=4, metavar="N", help="largest number of problems per set")
    parser.add_argument("--peers", metavar="PYTHON", help="a Python with copp-py and toppra")
    options = parser.parse_args()
    ours, durations, paths, limits = [], [], [], None
    for found in find_sets(options.mbm):
        for problem in read_problems(found, options.problems):
            checker = pp.CollisionChecker(problem.arm, problem.scene)
            plan = pp.RrtConnect().plan(checker, problem.start, problem.goals)
            path = pp.simplify(plan.path, plan.checker).path
            limits = problem.arm.limits
            limits = replace(limits, acceleration=np.full(problem.arm.dof, ACCELERATION), acceleration_source="stated")
            times = []
            for _ in range(REPEATS):
                begin = process_time()
                motion = pp.time_parametrise(path, limits)
                times.append(1e3 * (process_time() - begin))
            ours.append(min(times))
            durations.append(motion.duration)
            paths.append(path)
    print("| library | time of a call, ms: median / largest | duration, s: median | longer than ours, median |")
    print("| --- | --: | --: | --: |")
    print(f"| pinproof | {np.median(ours):.2f} / {max(ours):.2f} | {np.median(durations):.3f} | |")
    if options.peers is None or limits is None:
        return
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        pieces = [[part.tolist() for part in path.bezier()] for path in paths]
        json.dump({"paths": pieces, "velocity": limits.velocity.tolist(), "acceleration": ACCELERATION}, file)
        file.flush()
        worker = [options.peers, str(Path(__file__).with_name("timing_worker.py")), file.name, str(GRID), str(REPEATS)]
        answer = json.loads(subprocess.run(worker, capture_output=True, check=True, text=True).stdout.splitlines()[-1])
    for name, result in answer.items():
        ratio = np.median(np.array(result["durations"]) / durations) - 1.0
        ms = result["ms"]
        print(f"| {name} | {np.median(ms):.2f} / {max(ms):.2f} | {np.median(result['durations']):.3f} | {ratio:.2%} |")


if __name__ == "__main__":
    main()
