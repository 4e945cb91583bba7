"""Times paths with copp-py and toppra for timing.py, in an environment of its own that needs nothing of pinproof.

The arguments are a JSON file with the Bernstein pieces of the paths and the limits, the number of grid points, and the
number of calls of which the fastest counts. The answer is a line of JSON.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

import copp_py
import numpy as np
import toppra
from scipy.interpolate import BPoly
from toppra import algorithm, constraint


class Geometry(toppra.interpolator.AbstractGeometricPath):
    """A path of Bernstein pieces for toppra."""

    def __init__(self, curve: BPoly) -> None:
        self.curve, self.rates = curve, {0: curve, 1: curve.derivative(1), 2: curve.derivative(2)}

    def __call__(self, s: Any, order: int = 0) -> Any:
        """The path or a derivative by its parameter."""
        return self.rates[order](s)

    @property
    def dof(self) -> int:
        """The number of joints."""
        return int(self.curve.c.shape[2])

    @property
    def path_interval(self) -> Any:
        """The ends of the parameter."""
        return np.array([self.curve.x[0], self.curve.x[-1]])

    @property
    def waypoints(self) -> Any:
        """The ends of the pieces."""
        return self.curve.x, self.curve(self.curve.x)


def _toppra(curve: BPoly, velocity: Any, acceleration: float, grid: Any) -> float:
    limits = np.stack([-velocity, velocity], axis=1)
    bounds = [
        constraint.JointVelocityConstraint(limits),
        constraint.JointAccelerationConstraint(np.sign(limits) * acceleration),
    ]
    problem = algorithm.TOPPRA(bounds, Geometry(curve), gridpoints=grid, solver_wrapper="seidel")
    motion = problem.compute_trajectory()
    return float(motion.duration)


def _copp(curve: BPoly, velocity: Any, acceleration: float, grid: Any) -> float:
    count, dof = len(grid), len(velocity)
    robot = copp_py.Robot(dof, capacity=count)
    robot.append_s(grid)
    first, second = curve.derivative(1), curve.derivative(2)
    robot.set_q(curve(grid), first(grid), second(grid), 0)
    robot.add_velocity_limits(velocity, -velocity, start_idx_s=0, length=count)
    most = np.full(dof, acceleration)
    robot.add_acceleration_limits(most, -most, start_idx_s=0, length=count)
    solver = copp_py.solver.topp2_ra
    ends = {"idx_s_interval": (0, count - 1), "a_boundary": (0.0, 0.0)}
    profile = solver.solve(solver.Problem(robot.constraints, **ends), solver.Options())
    duration, _ = copp_py.interpolation.s_to_t_topp2(grid, profile, 0.0)
    return float(duration)


def main() -> None:
    """Time every path with both."""
    job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    velocity, answers = np.array(job["velocity"]), {}
    methods: dict[str, Callable[..., float]] = {"copp-py": _copp, "toppra": _toppra}
    for name, method in methods.items():
        ms, durations = [], []
        for knots, control in job["paths"]:
            curve = BPoly(np.array(control).transpose(1, 0, 2), np.array(knots))
            grid = np.linspace(knots[0], knots[-1], int(sys.argv[2]) + 1)
            times = []
            for _ in range(int(sys.argv[3])):
                begin = process_time()
                duration = method(curve, velocity, job["acceleration"], grid)
                times.append(1e3 * (process_time() - begin))
            ms.append(min(times))
            durations.append(duration)
        answers[name] = {"ms": ms, "durations": durations}
    print(json.dumps(answers))


if __name__ == "__main__":
    main()
