"""Solves ladder graphs with Descartes of Tesseract for the benchmark of tool paths, in an environment of its own.

tool_paths.py starts it with the name of a file. It needs nothing of pinproof. The file (NPZ) has for each rung k its
nodes ``q{k}`` (m, n), and for each edge the costs ``cost{k}`` (m, m'), infinite where there is none. The answer is a
line of JSON: the nodes of the optimum, its cost by those costs, and the processor time.
"""

from __future__ import annotations

import json
import re
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from tesseract_robotics.tesseract_command_language import (
    CartesianWaypoint,
    CartesianWaypointPoly_wrap_CartesianWaypoint,
    CompositeInstruction,
    InstructionPoly_as_MoveInstructionPoly,
    MoveInstruction,
    MoveInstructionPoly_wrap_MoveInstruction,
    MoveInstructionType_LINEAR,
    ProfileDictionary,
    WaypointPoly_as_StateWaypointPoly,
)
from tesseract_robotics.tesseract_common import (
    FilesystemPath,
    GeneralResourceLocator,
    Isometry3d,
    ManipulatorInfo,
)
from tesseract_robotics.tesseract_environment import Environment
from tesseract_robotics.tesseract_motion_planners import PlannerRequest
from tesseract_robotics.tesseract_motion_planners_descartes import (
    DescartesEdgeEvaluatorD,
    DescartesMotionPlannerD,
    DescartesMoveProfileD,
    DescartesStateD,
    DescartesStateEvaluatorD,
    DescartesStateSampleD,
    DescartesWaypointSamplerD,
    cast_DescartesMoveProfileD,
)

NAMESPACE = "DescartesMotionPlannerTask"


class Sampler(DescartesWaypointSamplerD):
    """The nodes of a rung."""

    def __init__(self, q: np.ndarray) -> None:
        super().__init__()
        self.samples = [DescartesStateSampleD(DescartesStateD(row), 0.0) for row in q]

    def sample(self) -> list[DescartesStateSampleD]:
        """All of them, without further costs."""
        return self.samples


class Edges(DescartesEdgeEvaluatorD):
    """The costs of the edges from one rung to the next."""

    def __init__(self, before: np.ndarray, after: np.ndarray, cost: np.ndarray) -> None:
        super().__init__()
        self.rows = {row.tobytes(): k for k, row in enumerate(before)}
        self.columns = {row.tobytes(): k for k, row in enumerate(after)}
        self.cost = cost

    def evaluate(self, start: DescartesStateD, end: DescartesStateD) -> tuple[bool, float]:
        """Whether there is an edge, and its cost."""
        a, b = (np.ascontiguousarray(state.values).tobytes() for state in (start, end))
        cost = float(self.cost[self.rows[a], self.columns[b]])
        return (True, cost) if np.isfinite(cost) else (False, 0.0)


class Free(DescartesStateEvaluatorD):
    """No further cost of a node."""

    def evaluate(self, _solution: DescartesStateD) -> tuple[bool, float]:
        """Every node is valid."""
        return True, 0.0


class Profile(DescartesMoveProfileD):
    """The nodes of one rung, and the edges that lead to it or from it."""

    def __init__(self, sampler: Sampler, edges: Edges) -> None:
        super().__init__()
        self.sampler, self.edges, self.free = sampler, edges, Free()

    def createWaypointSampler(self, *_: Any) -> Sampler:
        """The nodes of the rung."""
        return self.sampler

    def createEdgeEvaluator(self, *_: Any) -> Edges:
        """The edges to the rung."""
        return self.edges

    def createStateEvaluator(self, *_: Any) -> Free:
        """No cost of nodes."""
        return self.free


def main() -> None:
    """Solve the graph of the file."""
    data = np.load(sys.argv[1])
    rungs = [np.ascontiguousarray(data[f"q{k}"]) for k in range(int(data["count"]))]
    # An environment with an arm of six joints, of which only the names of the joints are used, so it has wide limits
    locator, env = GeneralResourceLocator(), Environment()
    urdf, srdf = (
        Path(locator.locateResource(f"package://tesseract/support/urdf/abb_irb2400.{kind}").getFilePath())
        for kind in ("urdf", "srdf")
    )
    wide = Path(sys.argv[1]).with_suffix(".urdf")
    text = re.sub(r'\blower="[^"]*"', 'lower="-20"', urdf.read_text(encoding="utf-8"))
    wide.write_text(re.sub(r'\bupper="[^"]*"', 'upper="20"', text), encoding="utf-8")
    if not env.init(FilesystemPath(str(wide)), FilesystemPath(str(srdf)), locator):
        raise RuntimeError("the environment of Tesseract cannot be made")
    info = ManipulatorInfo()
    info.tcp_frame, info.working_frame, info.manipulator = "tool0", "base_link", "manipulator"
    info.manipulator_ik_solver = "OPWInvKin"
    program, profiles, kept = CompositeInstruction("DEFAULT", info), ProfileDictionary(), []
    for k, q in enumerate(rungs):
        # The edge evaluator of a waypoint is that of the edges to it
        edges = Edges(rungs[k - 1], q, data[f"cost{k - 1}"]) if k else None
        kept.append(Profile(Sampler(q), edges or Edges(q, q, np.zeros((len(q), len(q))))))
        profiles.addProfile(NAMESPACE, f"rung {k}", cast_DescartesMoveProfileD(kept[-1]))
        place = CartesianWaypointPoly_wrap_CartesianWaypoint(CartesianWaypoint(Isometry3d.Identity()))
        move = MoveInstruction(place, MoveInstructionType_LINEAR, f"rung {k}")
        program.appendMoveInstruction(MoveInstructionPoly_wrap_MoveInstruction(move))
    request = PlannerRequest()
    request.instructions, request.env, request.profiles = program, env, profiles
    begin = time.process_time()
    response = DescartesMotionPlannerD(NAMESPACE).solve(request)
    seconds = time.process_time() - begin
    answer: dict[str, Any] = {"ok": bool(response.successful), "message": response.message, "seconds": seconds}
    if response.successful:
        nodes = []
        for q, instruction in zip(rungs, response.results, strict=True):
            state = WaypointPoly_as_StateWaypointPoly(InstructionPoly_as_MoveInstructionPoly(instruction).getWaypoint())
            nodes.append(int(np.abs(q - np.asarray(state.getPosition()).ravel()).max(axis=1).argmin()))
        answer["nodes"] = nodes
        answer["cost"] = float(sum(data[f"cost{k}"][a, b] for k, (a, b) in enumerate(pairwise(nodes))))
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
