"""Dispatch ``./scripts/benchmark TOPIC [OPTIONS]`` to the module of the topic."""

from __future__ import annotations

import sys
from importlib import import_module

TOPICS = {
    "ik": "IK methods and other libraries; with --success the success rates on all arms",
    "planning": "planners on own scenes and MotionBenchMaker; with --motion the durations of optimised motions",
    "collision": "checks, certificates and edges, compared with coal",
    "several_arms": "joint groups, moving obstacles and conveyors",
    "reuse": "certificates reused in changed scenes",
    "replanning": "motions that are replaced while they run",
    "depth": "occupancy grids of depth images",
    "scaling": "costs against the number of obstacles, triangles and joints",
    "picks": "picks, screening, campaigns and durations",
    "own_cells": "picks among CAD meshes, and edges beside exact meshes",
    "holding": "grips in motion, against linear programmes and simulations with contact",
    "programs": "robot programs with zones, against dense samples of what controllers may execute",
    "sequence": "the order of picks",
    "cell": "base placement",
    "tool_paths": "tool paths against independent audits, and Descartes on the same graphs",
    "timing": "timing of the same rounded paths by this package, copp-py and toppra",
    "rates": "bounds of torque and tool motion against dense samples; the table of docs/dynamics.md",
}
"""The modules of this package that are benchmarks, and what they measure."""


def main() -> None:
    """Run the benchmark that the first argument names; list them without one."""
    topic = sys.argv[1] if len(sys.argv) > 1 else "--help"
    if topic not in TOPICS:
        listed = "\n".join(f"  {name:<13} {text}" for name, text in TOPICS.items())
        print(f"usage: ./scripts/benchmark TOPIC [OPTIONS]; TOPIC --help lists the options\n\n{listed}")
        sys.exit(0 if topic in ("-h", "--help") else 2)
    sys.argv[:2] = [f"benchmark {topic}"]
    import_module(f"benchmarks.{topic}").main()


if __name__ == "__main__":
    main()
