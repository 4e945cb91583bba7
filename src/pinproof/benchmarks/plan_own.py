"""Problems in our own scenes: starts and goals by inverse kinematics, free of contact, and never a straight line apart.

No planner has a say in what becomes a problem, so none is favoured; whether each has an answer is not known.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from pinproof.benchmarks.plan_problem import PlanProblem
from pinproof.benchmarks.plan_scenes import OWN_SCENES, Draw, Drawn
from pinproof.collision import CollisionChecker, Obstacle, Scene
from pinproof.errors import InputError
from pinproof.ik import Clik
from pinproof.model import Arm, load_robot

__all__ = ["OWN_ROBOTS", "own_problems", "own_reach"]

Array = npt.NDArray[np.float64]

OWN_ROBOTS = ("ur5", "panda", "generic_6dof")

MARGIN = 0.005
"""Metres that starts and goals are away from everything, by the hulls: nobody is asked to leave a contact."""

POSES = 30
"""Poses of the tool that are drawn for an end before another scene is drawn."""

SCENES = 20
"""Scenes that are drawn for a problem before the arm is said to fit none."""

AROUND_HOME = 0.5
"""Rad or m around home in which the search for an end starts."""

STRAIGHT = 0.02
"""Rad or m between the samples of the straight way, which must touch something."""

SAMPLES, SHARE = 2_000, 0.95
"""The reach is the distance within which so large a share of so many random configurations have the tcp."""


def own_reach(arm: Arm) -> float:
    """The arm's reach in metres: from the base's z axis to the tcp, but for the farthest twentieth of it."""
    lower, upper = arm.limits.sampling_range()
    poses = arm.forward_kinematics_batch(np.random.default_rng(0).uniform(lower, upper, (SAMPLES, arm.dof)))
    return float(np.quantile(np.hypot(poses[:, 0, 3], poses[:, 1, 3]), SHARE))


def own_problems(robot: str, scene: str, count: int, seed: int = 0) -> Iterator[PlanProblem]:
    """The first problems of a robot in one of :data:`OWN_SCENES`; each depends on the seed and its number alone.

    Raises
    ------
    InputError
        If no problem is found for this arm in this scene.
    """
    arm = load_robot(robot).arm()
    alone = CollisionChecker(arm, margin=MARGIN)
    reach, index = own_reach(arm), list(OWN_SCENES).index(scene)
    for number in range(1, count + 1):
        found = _found(alone, scene, reach, np.random.default_rng([seed, index, number]))
        if found is None:
            raise InputError(f"no start and goal of {robot!r} were found in {SCENES} scenes of the kind {scene!r}")
        around, start, goal = found
        yield PlanProblem(robot, scene, number, arm, around, start, goal[None])


def _found(
    alone: CollisionChecker, name: str, reach: float, rng: np.random.Generator
) -> tuple[Scene, Array, Array] | None:
    root_from_base = alone.arm.root_from_base
    for _ in range(SCENES):
        drawn = OWN_SCENES[name](reach, rng)
        scene = Scene(Obstacle(o.name, o.shape, root_from_base * o.pose) for o in drawn.obstacles)
        ends = _ends(alone.with_scene(scene), drawn, rng)
        if ends is not None:
            return scene, *ends
    return None


def _ends(checker: CollisionChecker, drawn: Drawn, rng: np.random.Generator) -> tuple[Array, Array] | None:
    start = _reached(checker, drawn.start, rng)
    if start is None:
        return None
    goal = _reached(checker, drawn.goal, rng)
    if goal is None:
        return None
    steps = max(2, int(np.ceil(np.abs(goal - start).max() / STRAIGHT)))
    straight = start + np.linspace(0, 1, steps)[:, None] * (goal - start)
    return None if checker.is_free_batch(straight).all() else (start, goal)


def _reached(checker: CollisionChecker, draw: Draw, rng: np.random.Generator) -> Array | None:
    """A free configuration with the tcp at a drawn pose, turned about its z axis as it comes.

    The search starts near home: what is found then stands as people would have the arm stand, and is seldom cut off
    from the rest by an elbow or a wrist bent the other way.
    """
    arm, solver = checker.arm, Clik(restarts=0)
    for _ in range(POSES):
        near_home = arm.limits.clip(arm.home + rng.uniform(-AROUND_HOME, AROUND_HOME, arm.dof))
        found = solver.solve(arm, draw(rng), near_home, rng=rng, task="spin_z", accept=checker.is_free)
        if found.ok:
            return np.asarray(found.q)
    return None
