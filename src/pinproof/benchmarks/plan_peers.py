"""Other planners on the same problems, each as it is meant to be called; the extra ``peers`` installs them.

A peer is imported when it is asked, and only then. It collides with the links' own meshes and checks the pairs of links
that we check: not those that touch by build, but those that an SRDF disables as never in contact or without a reason.
What it hits, it then hit between its samples, and not because it was told not to look.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from pinproof.benchmarks.ik_methods import Unsuitable
from pinproof.benchmarks.plan_methods import PLANNER, Answer, Ask, PlanMethod, Stopwatch
from pinproof.benchmarks.plan_problem import PlanProblem
from pinproof.collision import Box, CollisionChecker, Cylinder, Sphere
from pinproof.motion import JointPath
from pinproof.spatial import matrix

__all__ = ["PEERS"]

GROUP = "arm"

NODES = 100_000
"""Room for roboplan's trees: its default of 1,000 would end searches that its time limit lets go on."""

FINE = 0.02
"""Rad between roboplan's samples on an edge in the row that looks closer; its default is 0.05."""

COLOUR = np.array([0.5, 0.5, 0.5, 1.0])


def _roboplan(shorten: bool, step: float | None) -> Callable[[PlanProblem, CollisionChecker], Ask]:
    """Roboplan (Castro and others): RRT-Connect in C++, with or without its shortcuts, sampled at ``step`` rad."""

    def prepare(problem: PlanProblem, checker: CollisionChecker) -> Ask:
        from roboplan.core import JointConfiguration, PathShortcutter, PathShortcuttingOptions
        from roboplan.rrt import RRT, RRTOptions

        scene, names = _scene(problem, checker), list(problem.arm.joint_names)
        if len(problem.goals) > 1:
            raise Unsuitable("roboplan takes one goal")
        options = RRTOptions(group_name=GROUP, max_nodes=NODES, max_planning_time=PLANNER.time_limit, rrt_connect=True)
        shortening = PathShortcuttingOptions(group_name=GROUP)
        if step is not None:
            options.collision_check_step_size = shortening.max_step_size = step

        def ask(seed: int) -> Answer:
            shortening.seed = seed
            planner = RRT(scene, options)
            planner.setRngSeed(seed)
            start, goal = (JointConfiguration(names, q) for q in (problem.start, problem.goals[0]))
            watch = Stopwatch()
            try:
                path = planner.plan(start, goal)
            except RuntimeError as error:
                watch.lap("plan")
                return Answer(None, watch.ms, message=str(error))
            watch.lap("plan")
            if path is not None and shorten:
                path = PathShortcutter(scene, shortening).shortcut(path)
                watch.lap("simplify")
            if path is None:
                return Answer(None, watch.ms, message="no path")
            order = [list(path.joint_names).index(name) for name in names]
            return Answer(JointPath(np.array(path.positions)[:, order], names), watch.ms)

        return ask

    return prepare


def _scene(problem: PlanProblem, checker: CollisionChecker) -> Any:
    """Roboplan's scene: the robot's own URDF, what stands around, and which pairs may touch."""
    from roboplan.core import Box as PeerBox
    from roboplan.core import Cylinder as PeerCylinder
    from roboplan.core import Scene as PeerScene
    from roboplan.core import Sphere as PeerSphere
    from roboplan.core import loadUrdfSceneDescriptionFromXml

    arm, root = problem.arm, problem.arm.robot.urdf.root
    scene = PeerScene(problem.full_set, loadUrdfSceneDescriptionFromXml(_urdf(problem)))
    scene.importSrdf(_srdf(problem, checker))
    if len(scene.getCurrentJointPositions()) != len(scene.getJointNames()):
        raise Unsuitable("joints without limits are pairs of numbers to roboplan")
    q = np.array(scene.getCurrentJointPositions())
    for index, name in enumerate(scene.getJointNames()):
        q[index] = arm.held.get(name, q[index])
    scene.setJointPositions(q)
    for obstacle in problem.scene.obstacles:
        at, shape = np.asfortranarray(matrix(obstacle.pose)), obstacle.shape
        if isinstance(shape, Box):
            scene.addBoxGeometry(obstacle.name, root, PeerBox(shape.x, shape.y, shape.z), at, COLOUR)
        elif isinstance(shape, Cylinder):
            scene.addCylinderGeometry(obstacle.name, root, PeerCylinder(shape.radius, shape.length), at, COLOUR)
        elif isinstance(shape, Sphere):
            scene.addSphereGeometry(obstacle.name, root, PeerSphere(shape.radius), at, COLOUR)
        else:
            raise Unsuitable(f"{obstacle.name} is a {type(shape).__name__}, which is not handed to roboplan")
    # It takes cans that stand on shelves for collisions.
    scene.setCollisions(list(combinations(problem.scene.names, 2)), False)
    for pair in checker.excluded:
        if set(pair.owners) & set(problem.scene.names):
            scene.setCollisions(*pair.owners, False)
    return scene


def _urdf(problem: PlanProblem) -> str:
    """The robot's own URDF with the places of its collision meshes written out."""
    urdf = problem.arm.robot.urdf
    if urdf.path is None or urdf.path.suffix != ".urdf":
        raise Unsuitable("roboplan is handed URDF files only")
    text = urdf.path.read_text(encoding="utf-8")
    for geometry in urdf.collisions:
        if geometry.mesh is not None and geometry.mesh.path is not None:
            text = text.replace(quoteattr(geometry.mesh.uri), quoteattr(str(geometry.mesh.path)))
    return text


def _srdf(problem: PlanProblem, checker: CollisionChecker) -> str:
    """An SRDF with the chain and the pairs of links that touch by build."""
    arm = problem.arm
    links = set(arm.robot.urdf.links)
    pairs = [pair.owners for pair in checker.excluded if set(pair.owners) <= links]
    return "\n".join(
        [
            f"<robot name={quoteattr(arm.robot.name)}>",
            f'  <group name="{GROUP}"><chain base_link={quoteattr(arm.base)} tip_link={quoteattr(arm.tcp)}/></group>',
            *(f'  <disable_collisions link1={quoteattr(a)} link2={quoteattr(b)} reason="User"/>' for a, b in pairs),
            "</robot>",
        ]
    )


PEERS: tuple[PlanMethod, ...] = (
    PlanMethod("roboplan_plan", "roboplan, plan alone", _roboplan(False, None), "roboplan"),
    PlanMethod("roboplan", "roboplan", _roboplan(True, None), "roboplan"),
    PlanMethod("roboplan_fine", f"roboplan, sampled at {FINE:g} rad", _roboplan(True, FINE), "roboplan"),
)
"""Roboplan with and without its shortcuts as it comes, and once sampled more densely."""
