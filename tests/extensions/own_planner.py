"""The planner that OMPL chooses, with proven edges: ``pp.plan``, picks and cells take any object with this method."""

from typing import Any

from ompl import base, geometric

import pinproof as pp


class Ompl:
    def plan(self, checker: pp.CollisionChecker, start: Any, goals: Any, *, rng: int = 0) -> pp.PlanResult:
        def q(*states: Any) -> list[list[float]]:
            return [[state[joint] for joint in range(len(start))] for state in states]

        class ProvenEdges(base.MotionValidator):  # type: ignore[misc]  # OMPL has no types
            def checkMotion(self, one: Any, other: Any, *_: Any) -> bool:
                return bool(checker.edges_free(q(one), q(other))[0])

        space = base.RealVectorStateSpace(0)
        for low, high in zip(*checker.group.limits.sampling_range(), strict=True):
            space.addDimension(float(low), float(high))
        setup = geometric.SimpleSetup(space)
        setup.setStateValidityChecker(lambda state: checker.is_free(q(state)[0]))
        setup.getSpaceInformation().setMotionValidator(ProvenEdges(setup.getSpaceInformation()))
        states = [space.allocState() for _ in (start, *goals)]
        for state, values in zip(states, (start, *goals), strict=True):
            for joint, value in enumerate(values):
                state[joint] = float(value)
        setup.setStartState(states[0])
        setup.setGoal(goal := base.GoalStates(setup.getSpaceInformation()))
        for state in states[1:]:
            goal.addState(state)
        if not (setup.solve(5.0) and setup.haveExactSolutionPath()):
            return pp.PlanResult(pp.planning.PlanStatus.OUT_OF_BUDGET, message="OMPL found no path within 5 s")
        path = pp.JointPath(q(*setup.getSolutionPath().getStates()), checker.group.joint_names)
        return pp.PlanResult(pp.planning.PlanStatus.FOUND, path, message="OMPL found a path")
