"""The core refuses arguments whose sizes, indices or numbers would make it read beyond an array or not end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pinproof import _core

DOF = 6
EYE = np.eye(4)
NAN = float("nan")

REFUSALS = (ValueError, TypeError, IndexError, OverflowError, MemoryError)
"""What nanobind raises for std::invalid_argument, wrong types, indices, negative sizes and arrays that do not fit."""


def moved(x: float, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def before() -> np.ndarray:
    """Six joints whose axes alternate between z and y."""
    matrices = np.array([moved(0.1 * k, 0.0, 0.2) for k in range(DOF)])
    matrices[1::2, :3, :3] = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
    return matrices


JOINT: dict[str, Any] = {"before": EYE, "prismatic": False, "index": 0, "multiplier": 1.0, "offset": 0.0}


def joint(**changes: Any) -> Any:
    return _core.Joint(**{**JOINT, **changes})


def chain(last: int = DOF - 1, tool: np.ndarray = EYE, multiplier: float = 1.0) -> Any:
    """A chain whose last joint has this index and multiplier."""
    joints = [joint(before=place, index=k) for k, place in enumerate(before()[:-1])]
    return _core.Chain([*joints, joint(before=before()[-1], index=last, multiplier=multiplier)], tool, DOF)


def carve(**changes: Any) -> None:
    view: dict[str, Any] = {
        "cells": np.ones((2, 2, 2), dtype=np.uint8),
        "low": np.zeros(3, dtype=np.int64),
        "side": 0.1,
        "camera_from_grid": moved(0.0, 0.0, 1.0),
        "intrinsics": np.array([4.0, 4.0, 1.5, 1.0]),
        "nearest": np.ones((3, 4), dtype=np.float32),
        "farthest": np.ones((3, 4), dtype=np.float32),
        "pixel_margin": 0,
    }
    _core.carve(**{**view, **changes})


def clear(**changes: Any) -> int:
    box = np.array([[-1.0] * 3, [1.0] * 3])
    ball = _core.Shape.convex(np.zeros((1, 3)), np.zeros(1), 1.0, np.zeros(3), box)
    cells: dict[str, Any] = {
        "cells": np.ones((2, 2, 2), dtype=np.uint8),
        "low": np.zeros(3, dtype=np.int64),
        "side": 0.1,
        "shape": ball,
        "shape_from_grid": EYE,
        "padding": 0.0,
    }
    return _core.clear_within(**{**cells, **changes})


def tour(**changes: Any) -> Any:
    """Two options of a job, then one of another, which comes after it."""
    task: dict[str, Any] = {
        "job": np.array([0, 0, 1]),
        "time": np.arange(16.0).reshape(4, 4),
        "pairs": np.array([[0, 1]]),
        "first": np.array([0, 2]),
        "draws": np.full((3, 8), 0.5),
    }
    return _core.search_tour(**{**task, **changes})


def rates(**changes: Any) -> Any:
    return _core.RateLimits(**{"velocity": np.ones(2), "acceleration": np.ones(2), "jerk": np.zeros(0), **changes})


def timed(**changes: Any) -> Any:
    task: dict[str, Any] = {
        "knots": np.arange(2.0),
        "control": np.array([[[0.0, 0.0], [1.0, 1.0]]]),
        "stops": None,
        "limits": rates(),
        "start_velocity": np.zeros(2),
        "end_velocity": np.zeros(2),
        "image_tolerance": 1e-5,
        "rate_tolerance": 1e-9,
        "longest": 1e6,
        "rows": None,
        "excess": None,
    }
    return _core.time_path(**{**task, **changes})


def solver(**changes: Any) -> Any:
    settings: dict[str, Any] = {
        "ranges": [_core.JointRange(-3.0, 3.0, True, False)] * DOF,
        "task": task(),
        "rule": _core.ClikStep(1e-6),
        "max_iterations": 50,
        "max_step": 0.5,
        "progress": 0.9,
        "patience": 10,
    }
    return _core.IkSolver(chain(), **{**settings, **changes})


def task() -> Any:
    return _core.Task([True] * 6, 1e-6, 1e-6)


def seeds() -> Any:
    return _core.Seeds(chain(), np.linspace(-1.0, 1.0, 4 * DOF).reshape(4, DOF))


def goal(size: int = DOF) -> Any:
    return _core.Goal("posture", 0.5, np.zeros(size), np.ones(size))


BOX = np.array([[-0.1, -0.1, -0.1], [0.1, 0.1, 0.1]])
CORNERS = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1)])


def cube() -> Any:
    return _core.Shape.convex(CORNERS, np.zeros(8), 0.0, np.zeros(3), BOX)


def mesh_corners() -> np.ndarray:
    """The triangles of a tetrahedron."""
    return CORNERS[[0, 1, 2, 4]][[(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)]].reshape(-1, 9)


def mesh(**changes: Any) -> Any:
    values = {"corners": mesh_corners(), "witnesses": CORNERS[:1], "closed": True, "box": BOX}
    return _core.Shape.mesh(**{**values, **changes})


def cells(**changes: Any) -> Any:
    low = changes.pop("low", np.zeros((1, 3), dtype=np.int64))
    return _core.Shape.cells(**{"low": low, "high": low + 1, "side": 0.1, **changes})


def cells_on_a_joint() -> Any:
    space = _core.Geometry(tree(), [body(cells(), 0)], _core.Obstacles([body(cube(), -1)]), 1e-9)
    return world_of(space, PAIRS[:1] - [0, 1])


def tree(parents: tuple[int, int] = (-1, 0), dof: int = 2, **changes: Any) -> Any:
    """A revolute joint, and a prismatic one with these changes."""
    last = {"before": moved(0.5), "prismatic": True, "index": 1, **changes}
    return _core.JointTree([joint(parent=parents[0]), joint(parent=parents[1], **last)], dof)


def body(shape: Any, on: int, place: np.ndarray = EYE) -> Any:
    return _core.Body(shape, on, place)


def geometry(robot_bodies: int = 2, joints: tuple[int, int, int] = (0, 1, -1), obstacle: Any = None) -> Any:
    """Cubes on both joints, and one as an obstacle, unless it is another body."""
    cubes = [body(cube(), joints[0]), body(cube(), joints[1]), obstacle or body(cube(), joints[2], moved(3.0))]
    return _core.Geometry(tree(), cubes[:robot_bodies], _core.Obstacles(cubes[robot_bodies:]), 1e-9)


PAIRS = np.array([[0, 2], [1, 2]])


def world_of(space: Any, pairs: np.ndarray = PAIRS, margins: np.ndarray | None = None) -> Any:
    return _core.World(space, _core.PairTable(space, pairs), np.zeros(len(pairs)) if margins is None else margins)


def world() -> Any:
    return world_of(geometry())


def replaced(numbers: Any = (0,), others: Any = None) -> Any:
    space = _core.Obstacles([body(cube(), -1)])
    return space.replaced(np.array(numbers, dtype=np.int64), others or [body(cube(), -1)])


def edges() -> Any:
    return _core.EdgeChecker(world(), 0.05)


def search(**changes: Any) -> Any:
    values = {"start": np.zeros(2), "goals": np.ones((1, 2)), "box": np.array([[-3.0, -3.0], [3.0, 3.0]]), **changes}
    return _core.RrtSearch(edges(), **{"step": 0.5, "max_nodes": 100, "max_samples": 100, **values})


def staggered(**changes: Any) -> Any:
    values = {"start": np.zeros(2), "goals": np.ones((1, 2)), "box": np.array([[-3.0, -3.0], [3.0, 3.0]])}
    return _core.StaggeredSearch(edges(), **{**values, "limits": rates(), "sample_time": 0.1, **changes})


def settings(**changes: Any) -> Any:
    return _core.ProofSettings(**{"tolerance": 1e-4, "max_intervals": 100, **changes})


def departure(**changes: Any) -> Any:
    values = {"body": 1, "normal": np.array([0.0, 0.0, 1.0]), "level": 0.0, **changes}
    return _core.Departure(world(), **values)


def separate(pairs: Any = (1,), knots: Any = None, control: Any = None, more: Any = None, **changes: Any) -> Any:
    values = {"near": 10.0, "deepest": 1e-3, "displaced": 0.0, "tolerance": 1e-4, "max_intervals": 10, **changes}
    curve = np.array([0.0, 1.0]) if knots is None else knots, np.zeros((1, 2, 2)) if control is None else control
    directions = np.empty((0, 3)) if more is None else more
    return _core.separate(world(), np.array(pairs), *curve, _core.SeparationSettings(**values), directions)


def piece(**changes: Any) -> Any:
    """A piece of a route that stays at one pose."""
    still = _core.RouteSegment(np.zeros(3), np.zeros(3), 0.0)
    values = {"pose": EYE, "into": still, "out": still, "a": np.zeros(6), "b": np.zeros(6), "width": 0.0}
    return _core.RoutePiece(**{**values, **changes})


def route(*pieces: Any) -> Any:
    return _core.Route(list(pieces) or [piece()])


def follower(**changes: Any) -> Any:
    values = {"lower": np.full(DOF, -3.0), "upper": np.full(DOF, 3.0), "max_joint_step": 0.3}
    values |= {"deviation": 1e-3, "rotation_deviation": 1e-2, "translation_step": 0.05, "rotation_step": 0.2}
    return _core.RouteFollower(chain=chain(), task=_core.Task([True] * 6, 1e-6, 1e-6), **{**values, **changes})


def bounds() -> Any:
    return _core.MotionBounds(world(), np.zeros(2), np.full(2, 0.1), np.zeros(2))


Z = np.array([0.0, 0.0, 1.0])


def planned(**changes: Any) -> Any:
    line = {"direction": Z, "point": np.zeros(3), "prismatic": False, "index": 0, "lower": -3.0, "upper": 3.0}
    return _core.PlannedJoint(**{**line, **changes})


CLOSED: dict[str, Any] = {
    "size": 1.0,
    "joints": [planned(index=k) for k in range(DOF)],
    "tool": EYE,
    "first_of_triple": 3,
    "planar": False,
    "reversed": False,
    "normal": 0,
    "locked": [],
    "border": 1e-9,
    "spread": 1e-6,
    "rounding": 1e-12,
    "true_joints": [planned(index=k, direction=np.eye(3)[2 - k % 2]) for k in range(DOF)],
}


def reach(**changes: Any) -> Any:
    return _core.Reach(**{"chain": chain(), "lower": np.zeros(DOF), "upper": np.ones(DOF), **changes})


def overlap(**changes: Any) -> Any:
    ball = {"ball_link": 0, "centre": np.zeros(3), "ball_radius": 0.0}
    box = {"box_link": 1, "link_from_box": EYE, "half": np.zeros(3), "box_radius": 0.0}
    return _core.Overlap(**{**ball, **box, **changes})


def closed_form(**changes: Any) -> Any:
    return _core.ClosedForm(_core.ArmPlan(chain(), **{**CLOSED, **changes}))


def prove(knots: np.ndarray, control: np.ndarray, tolerance: np.ndarray) -> Any:
    return _core.prove(world(), knots, control, settings(), tolerance, _core.ProofState())


def mesh_world(**changes: Any) -> Any:
    obstacle = body(mesh(**changes), -1, moved(0.85))
    return world_of(geometry(obstacle=obstacle), np.array([[1, 2]]))


def prove_beside_mesh(**changes: Any) -> Any:
    return _core.prove(mesh_world(**changes), UNIT, STRAIGHT, settings(), np.zeros(2), _core.ProofState())


def upright(**changes: Any) -> Any:
    return _core.PathConstraint.direction(**{"axis": Z, "direction": Z, "tolerance": 0.1, **changes})


def region(**changes: Any) -> Any:
    zero = np.zeros(3)
    values = {"point": zero, "base_from_box": EYE, "low": zero, "high": zero, "tolerance": 0.1, **changes}
    return _core.PathConstraint.region(**values)


def manifold(**changes: Any) -> Any:
    values = {"constraints": [upright()], "lower": np.full(DOF, -3.0), "upper": np.full(DOF, 3.0), **changes}
    return _core.Manifold([(chain(), values.pop("constraints"))], **values)


def prove_upright(control: np.ndarray, tolerance: np.ndarray) -> Any:
    return _core.prove_constraint(
        chain(), upright(), UNIT, control, _core.ConstraintSettings(resolution=1e-6, max_intervals=10), tolerance
    )


def rigid(**changes: Any) -> Any:
    return _core.RigidBody(**{"mass": 1.0, "first_moment": np.zeros(3), "inertia": np.eye(3), **changes})


def bodies(count: int = 2, tool_joint: int = 1, **changes: Any) -> Any:
    """A tree of two joints with so many bodies."""
    return _core.DynamicTree(tree(**changes), [rigid()] * count, np.array([0.0, 0.0, -9.81]), tool_joint, np.zeros(3))


def pieces(points: int = 4, dof: int = 2, count: int = 3) -> list[np.ndarray]:
    return [np.zeros((count, points - order, dof)) for order in range(3)]


UNIT = np.array([0.0, 1.0])
STRAIGHT = np.zeros((1, 2, 2))

REFUSED: dict[str, Callable[[], Any]] = {
    "bodies with a tool on a joint that does not exist": lambda: bodies(tool_joint=2),
    "fewer bodies than joints": lambda: bodies(1),
    "a body with a mass that is not finite": lambda: rigid(mass=NAN),
    "a body with a moment in the plane": lambda: rigid(first_moment=np.zeros(2)),
    "a body with an inertia that is not finite": lambda: rigid(inertia=np.full((3, 3), NAN)),
    "a joint with a matrix of shape (3, 4)": lambda: joint(before=np.zeros((3, 4))),
    "a joint with a multiplier that is infinite": lambda: joint(multiplier=np.inf),
    "a range with a limit that is NaN": lambda: _core.JointRange(NAN, 1.0, True, False),
    "torques of rows that are too short": lambda: bodies().torques(*[np.zeros((3, 1))] * 3),
    "torques of fewer velocities than rows": lambda: bodies().torques(
        np.zeros((3, 2)), np.zeros((2, 2)), np.zeros((3, 2))
    ),
    "motion of the tool at NaN": lambda: bodies().tool_motion(*[np.full((1, 2), NAN)] * 3),
    "torque limits of the wrong length": lambda: bodies().torque_stretch(*pieces(), np.ones(3)),
    "a torque limit of 0": lambda: bodies().torque_stretch(*pieces(), np.zeros(2)),
    "tool limits of the wrong length": lambda: bodies().tool_stretch(*pieces(), np.ones(3)),
    "a curve with derivatives of fewer pieces": lambda: bodies().torque_peaks(*pieces()[:2], np.zeros((2, 2, 2))),
    "a curve of other joints": lambda: bodies().torque_peaks(*pieces(dof=3)),
    "a curve of degree 8": lambda: bodies().tool_peaks(*pieces(points=9)),
    "a curve that is not finite": lambda: bodies().tool_peaks(*[np.full((1, 4, 2), NAN)] * 3),
    "a chain with an index beyond dof": lambda: chain(DOF),
    "a chain with a negative index": lambda: chain(-1),
    "a chain with a tool of shape (1, 16)": lambda: chain(tool=EYE.reshape(1, 16)),
    "forward kinematics of rows that are too short": lambda: chain().forward_batch(np.zeros((3, DOF - 1))),
    "forward kinematics from a start of shape (3, 4)": lambda: chain().evaluate(np.zeros(DOF), EYE[:3]),
    "limits of fewer joints": lambda: solver(ranges=[_core.JointRange(-3.0, 3.0, True, False)]),
    "a negative number of iterations": lambda: solver(max_iterations=-1),
    "a negative patience": lambda: solver(patience=-1),
    "no seeds": lambda: _core.Seeds(chain(), np.zeros((0, DOF))),
    "a goal of fewer joints": lambda: goal(2).step(chain(), np.zeros(DOF)),
    "an unknown goal": lambda: _core.Goal("far", 0.5, np.zeros(1), np.ones(1)),
    "targets and starts of different numbers": lambda: solver().solve_batch(
        np.tile(EYE, (3, 1, 1)), np.zeros((2, DOF)), seeds(), None, 4, None, 1
    ),
    "a batch in a world of fewer joints": lambda: solver().solve_batch(
        EYE[None], np.zeros((1, DOF)), seeds(), None, 4, world(), 1
    ),
    "a target with NaN": lambda: _core.Search(solver(), seeds(), None, np.full((4, 4), NAN), np.zeros(DOF)),
    "a start of a search that is too short": lambda: _core.Search(solver(), seeds(), None, EYE, np.zeros(1)),
    "a start of a tracker that is too short": lambda: _core.Tracker(
        chain(), np.full(DOF, -3.0), np.full(DOF, 3.0), np.ones(DOF), task(), None, np.zeros(1)
    ),
    "a Jacobian of five rows": lambda: _core.box_step(np.zeros((5, 2)), np.zeros(6), 1e-6, -np.ones(2), np.ones(2)),
    "bounds of fewer joints": lambda: _core.box_step(np.zeros((6, 2)), np.zeros(6), 1e-6, -np.ones(1), np.ones(2)),
    "a planned joint with a direction in the plane": lambda: planned(direction=np.zeros(2)),
    "a planned joint at NaN": lambda: planned(point=np.full(3, NAN)),
    "a plan of five joints": lambda: closed_form(joints=CLOSED["joints"][:5]),
    "a plan of five true joints": lambda: closed_form(true_joints=CLOSED["joints"][:5]),
    "eigenvalues of a matrix of other size": lambda: _core.eigenvalues(np.eye(15)),
    "a plan with an index beyond the joints": lambda: closed_form(joints=[planned(index=DOF)] * DOF),
    "a plan with a true index beyond the joints": lambda: closed_form(true_joints=[planned(index=DOF)] * DOF),
    "a plan with a triple beyond the joints": lambda: closed_form(first_of_triple=4),
    "a plan with a locked joint but six joints": lambda: closed_form(locked=[2]),
    "branches with errors in one row": lambda: _core.Branches(np.zeros((2, DOF)), np.zeros((1, 4))),
    "branches of too many joints": lambda: _core.Branches(np.zeros((1, 9)), np.zeros((1, 2))),
    "a branch that does not exist": lambda: _core.Branches(np.zeros((1, 6)), np.zeros((1, 2))).select([1]),
    "a proof with too few limits": lambda: reach(lower=np.zeros(DOF - 1)),
    "a proof with an infinite limit": lambda: reach(upper=np.full(DOF, np.inf)),
    "a proof with limits in the wrong order": lambda: reach(lower=np.full(DOF, 2.0), upper=np.zeros(DOF)),
    "a proof with more than a full rotation": lambda: reach(lower=np.full(DOF, -4.0), upper=np.full(DOF, 4.0)),
    "a proof for a mimic joint": lambda: reach(chain=chain(multiplier=0.5)),
    "a proof for a target in one row": lambda: reach().prove(np.eye(3), 1e-6, 1e-6, 10, False),
    "a proof for a target that is not rigid": lambda: reach().prove(2 * EYE, 1e-6, 1e-6, 10, False),
    "a proof with a tolerance that is no number": lambda: reach().prove(EYE, NAN, 1e-6, 10, False),
    "an overlap on a link that does not exist": lambda: overlap(box_link=-1),
    "an overlap with a negative radius": lambda: overlap(ball_radius=-1.0),
    "an overlap with a negative half side": lambda: overlap(half=np.array([0.0, -1.0, 0.0])),
    "an overlap that is not finite": lambda: overlap(box_radius=NAN),
    "an overlap at a pose that is not rigid": lambda: overlap(link_from_box=2 * EYE),
    "an overlap behind the last joint": lambda: reach().prove(EYE, 1e-6, 1e-6, 10, False, [overlap(box_link=DOF + 1)]),
    "a proof with a negative budget": lambda: reach().prove(EYE, 1e-6, 1e-6, -1, False),
    "a batch whose size overflows": lambda: closed_form().solve_batch(
        np.tile(EYE, (2, 1, 1)), np.zeros((1, DOF)), np.zeros((1, 1, 0)), 2**62
    ),
    "four coefficients of a quartic": lambda: _core.quartic_roots(np.zeros(4)),
    "a convex shape without points": lambda: _core.Shape.convex(np.zeros((0, 3)), np.zeros(0), 0.0, np.zeros(3), BOX),
    "a shape with discs of another number": lambda: _core.Shape.convex(CORNERS, np.zeros(7), 0.0, np.zeros(3), BOX),
    "a mesh without triangles": lambda: mesh(corners=np.zeros((0, 9))),
    "a mesh of corners": lambda: mesh(corners=np.zeros((4, 3))),
    "a mesh with a corner that is NaN": lambda: mesh(corners=np.full((1, 9), NAN)),
    "a mesh with a witness that is NaN": lambda: mesh(witnesses=np.full((1, 3), NAN)),
    "a mesh with a box of one corner": lambda: mesh(box=np.zeros((1, 3))),
    "points of two coordinates": lambda: mesh().contains(np.zeros((1, 2))),
    "a tree with a joint before its parent": lambda: tree((1, -1)),
    "a tree with a negative index": lambda: tree(index=-1),
    "a tree with an index beyond dof": lambda: tree(index=2),
    "a tree with an offset that is NaN": lambda: tree(offset=NAN),
    "a body without a shape": lambda: body(None, 0),
    "a body on a joint that does not exist": lambda: geometry(joints=(0, 2, -1)),
    "an obstacle on a joint": lambda: geometry(joints=(0, 1, 1)),
    "an obstacle without a shape": lambda: _core.Obstacles([body(None, -1)]),
    "no cells": lambda: cells(low=np.zeros((0, 3), dtype=np.int64)),
    "cells without a volume": lambda: cells(high=np.ones((1, 3), dtype=np.int64) * [1, 0, 1]),
    "cells out of range": lambda: cells(low=np.full((1, 3), -(2**41))),
    "cells with more upper corners": lambda: cells(high=np.ones((2, 3), dtype=np.int64)),
    "cells of no side": lambda: cells(side=0.0),
    "cells of a side that is NaN": lambda: cells(side=NAN),
    "cells on a joint": cells_on_a_joint,
    "boxes of a pair that does not exist": lambda: _core.Workspace(world()).overlapping_boxes(2),
    "boxes without poses": lambda: _core.box_bodies(np.ones((2, 3)), np.zeros((1, 4, 4))),
    "boxes of infinite sides": lambda: _core.box_bodies(np.full((1, 3), np.inf), EYE[None]),
    "a name of no box": lambda: _core.describe_boxes(["'a'"], []),
    "a box without a shape": lambda: _core.describe_boxes(["'a'"], [body(None, -1)]),
    "a body placed at NaN": lambda: body(cube(), 0, np.full((4, 4), NAN)),
    "pairs in one row": lambda: world_of(geometry(), PAIRS.reshape(1, 4)),
    "a pair with a body that does not exist": lambda: world_of(geometry(), np.array([[0, 3]])),
    "a pair of an obstacle and another": lambda: world_of(geometry(), np.array([[2, 0]])),
    "pairs of bodies on other joints": lambda: _core.World(
        geometry(joints=(1, 0, -1)), _core.PairTable(geometry(), PAIRS), np.zeros(2)
    ),
    "pairs of fewer bodies": lambda: world().with_obstacles(geometry(robot_bodies=1, joints=(0, -1, -1))),
    "another obstacle that does not exist": lambda: replaced((1,)),
    "more obstacles than there are others": lambda: replaced((0, 0)),
    "another obstacle on a joint": lambda: replaced(others=[body(cube(), 0)]),
    "bodies at NaN": lambda: _core.bodies_on_joint([cube()], 0, np.full((4, 4), NAN)),
    "a margin that is NaN": lambda: world().with_margins(np.array([0.0, NAN])),
    "too few margins": lambda: world().with_margins(np.zeros(1)),
    "a workspace without a world": lambda: _core.Workspace(None),
    "contacts at NaN": lambda: _core.Workspace(world()).find_contacts(np.full(2, NAN)),
    "nearest bodies at NaN": lambda: _core.Workspace(world()).find_nearest(np.full(2, NAN)),
    "configurations that are too short": lambda: _core.Workspace(world()).judge_many(np.zeros((3, 1))),
    "a pair that does not exist": lambda: _core.Workspace(world()).measure(2),
    "the placement of a body that does not exist": lambda: _core.Workspace(world()).root_from_body(3),
    "the joints between a pair that does not exist": lambda: world().joints_between(2),
    "a negative number of intervals": lambda: settings(max_intervals=-1),
    "a curve with too many knots": lambda: prove(np.array([0.0, 0.5, 1.0]), STRAIGHT, np.zeros(2)),
    "a curve without pieces": lambda: prove(np.array([0.0]), np.zeros((0, 2, 2)), np.zeros(2)),
    "a curve of three joints": lambda: prove(UNIT, np.zeros((1, 2, 3)), np.zeros(2)),
    "a joint tolerance of one joint": lambda: prove(UNIT, STRAIGHT, np.zeros(1)),
    "bounds of a pair that does not exist": lambda: bounds().rough(2),
    "bounds with a split beyond the joints": lambda: bounds().tight(0, np.ones(3), 9, np.zeros((2, 2))),
    "bounds with a negative split": lambda: bounds().tight(0, np.ones(3), -1, np.zeros((2, 2))),
    "bounds of a piece without points": lambda: bounds().tight(0, np.ones(3), 0, np.zeros((0, 2))),
    "a resolution of zero": lambda: _core.EdgeChecker(world(), 0.0),
    "a negative resolution": lambda: edges().set_resolution(-1.0),
    "samples in a world with fewer bodies": lambda: edges().set_steering(
        world_of(geometry(robot_bodies=1, joints=(0, -1, -1)), np.array([[0, 2]])), False
    ),
    "torque limits of one joint": lambda: edges().set_torque_limits(bodies(), np.ones(1)),
    "torque limits of a tree of one joint": lambda: edges().set_torque_limits(bodies(dof=1, index=0), np.ones(2)),
    "a torque limit of zero": lambda: edges().set_torque_limits(bodies(), np.array([1.0, 0.0])),
    "an edge of one joint": lambda: edges().samples_free(np.zeros(1), np.zeros(2)),
    "points of one joint": lambda: edges().points_free(np.zeros((3, 1))),
    "no points of a motion": lambda: edges().points_free(np.zeros((0, 2))),
    "staggered moves without goals": lambda: staggered(goals=np.zeros((0, 2))),
    "staggered moves with goals that are NaN": lambda: staggered(goals=np.full((1, 2), NAN)),
    "staggered moves with a limit of zero": lambda: staggered(limits=rates(velocity=np.zeros(2))),
    "staggered moves with an infinite jerk": lambda: staggered(limits=rates(jerk=np.full(2, np.inf))),
    "staggered moves of joints with one jerk": lambda: staggered(limits=rates(jerk=np.ones(1))),
    "staggered moves with a sample time of zero": lambda: staggered(sample_time=0.0),
    "draws of staggered moves in short rows": lambda: staggered().run(1.0, np.zeros((1, 3))),
    "draws of staggered moves of 1": lambda: staggered().run(1.0, np.ones((1, staggered().draws_per_motion))),
    "a search without goals": lambda: search(goals=np.zeros((0, 2))),
    "a search with steps of zero": lambda: search(step=0.0),
    "a search with steps that are NaN": lambda: search(step=NAN),
    "draws outside [0, 1)": lambda: search().add_draws(np.full((1, 4), 1.0)),
    "draws that are NaN": lambda: search().add_draws(np.full((1, 4), NAN)),
    "draws in rows that are too short": lambda: search().add_draws(np.zeros((4, 1))),
    "a third tree": lambda: search().add(2, np.zeros(2), 0),
    "a parent that does not exist": lambda: search().add(0, np.zeros(2), 1),
    "a root that is cut": lambda: search().cut(0, 0),
    "a node that does not exist": lambda: search().branch(1, -1),
    "configurations of nodes that do not exist": lambda: search().configurations(0, [0, 1]),
    "a path without waypoints": lambda: _core.shortcut(edges(), np.zeros((0, 2)), np.zeros((0, 2)), False),
    "negative draws of a shortcut": lambda: _core.shortcut(edges(), np.eye(2), np.full((3, 2), -0.5), False),
    "a constraint with an axis of length 2": lambda: upright(axis=np.array([0.0, 0.0, 2.0])),
    "a constraint with a direction of two numbers": lambda: upright(direction=np.zeros(2)),
    "a constraint with a tolerance of zero": lambda: upright(tolerance=0.0),
    "a constraint with a tolerance that is NaN": lambda: upright(tolerance=NAN),
    "a region with a placement that is NaN": lambda: region(base_from_box=np.full((4, 4), NAN)),
    "a region with low above high": lambda: region(low=np.ones(3)),
    "a region with a point that is NaN": lambda: region(point=np.full(3, NAN)),
    "a proof of a constraint on a curve of two joints": lambda: prove_upright(STRAIGHT, np.zeros(DOF)),
    "a proof of a constraint at NaN": lambda: prove_upright(np.full((1, 2, DOF), NAN), np.zeros(DOF)),
    "a proof of a constraint with a tolerance of one joint": lambda: prove_upright(np.zeros((1, 2, DOF)), np.zeros(1)),
    "a departure of an obstacle": lambda: departure(body=2),
    "a departure along a direction of length 2": lambda: departure(normal=np.array([0.0, 0.0, 2.0])),
    "a departure along NaN": lambda: departure(normal=np.full(3, NAN)),
    "a departure at a configuration of one joint": lambda: departure().gap(np.zeros(1)),
    "a departure on a piece without points": lambda: departure().decrease(np.zeros((0, 2))),
    "a separation on a curve of NaN": lambda: separate(control=np.full((1, 2, 2), NAN)),
    "a separation with a tolerance of zero": lambda: separate(tolerance=0.0),
    "a separation with an overlap of NaN": lambda: separate(deepest=NAN),
    "a separation of a pair that does not exist": lambda: separate(pairs=(2,)),
    "a separation of a negative pair": lambda: separate(pairs=(-1,)),
    "a separation along directions of two numbers": lambda: separate(more=np.ones((1, 2))),
    "directions to facets at a configuration of one joint": lambda: _core.facet_directions(
        mesh_world(), 0, np.zeros(1), 0.1
    ),
    "directions to the facets of a pair that does not exist": lambda: _core.facet_directions(
        world(), 2, np.zeros(2), 0.1
    ),
    "a route without pieces": lambda: _core.Route([]),
    "a segment of a route with NaN": lambda: _core.RouteSegment(np.full(3, NAN), np.zeros(3), 0.0),
    "a piece of a route with too few coefficients": lambda: piece(a=np.zeros(5)),
    "a route with a piece of negative width": lambda: route(piece(), piece(width=-0.1)),
    "a route that is followed from one joint": lambda: follower().follow(route(), np.zeros(1)),
    "a route that is followed from above a limit": lambda: follower().follow(route(), np.full(DOF, 3.01)),
    "a route that is followed from below a limit": lambda: follower().follow(route(), np.full(DOF, -3.01)),
    "a route that is followed within limits that are not numbers": lambda: follower(upper=np.full(DOF, NAN)).follow(
        route(), np.zeros(DOF)
    ),
    "lines from one joint": lambda: follower().ends_of_lines(np.zeros((2, 1)), np.stack([EYE, EYE])),
    "lines to fewer poses than starts": lambda: follower().ends_of_lines(np.zeros((2, DOF)), EYE[None]),
    "a follower with a step of zero": lambda: follower(rotation_step=0.0),
    "a follower with limits of one joint": lambda: follower(lower=np.zeros(1)),
    "a follower with a deviation of zero": lambda: follower(deviation=0.0),
    "deviations of a curve that is not cubic": lambda: follower().deviations(route(), UNIT, np.zeros((1, 3, DOF))),
    "a spline through too few points": lambda: _core.spline_slopes(UNIT, np.zeros((3, 2))),
    "a manifold without constraints": lambda: manifold(constraints=[]),
    "a manifold with limits of one joint": lambda: manifold(lower=np.zeros(1)),
    "a manifold with crossed limits": lambda: manifold(lower=np.full(DOF, 4.0)),
    "a projection of one joint": lambda: manifold().project(np.zeros(1), 0.5),
    "a projection of NaN": lambda: manifold().project(np.full(DOF, NAN), 0.5),
    "a connection with edges of other joints": lambda: manifold().connect(
        edges(), np.zeros(DOF), np.ones(DOF), 0.3, 9.0
    ),
    "a search with a manifold of other joints": lambda: search(manifold=manifold()),
    "speeds with too few ceilings": lambda: _core.fastest_speeds(
        *(np.ones((2, 2, 3)) for _ in range(4)), np.ones(2), np.ones(2), 0.0, 0.0
    ),
    "a timed path without pieces": lambda: timed(knots=np.zeros(1), control=np.zeros((0, 2, 2))),
    "a timed path with knots that do not increase": lambda: timed(knots=np.zeros(2)),
    "a timed path with too few knots": lambda: timed(knots=np.zeros(1)),
    "a timed path of too high a degree": lambda: timed(control=np.ones((1, 17, 2))),
    "a timed path with NaN": lambda: timed(control=np.full((1, 2, 2), NAN)),
    "a timed path of length 0": lambda: timed(control=np.ones((1, 2, 2))),
    "a timed path with too few stops": lambda: timed(stops=np.ones(1)),
    "a timed path with too few limits": lambda: timed(limits=rates(acceleration=np.ones(1))),
    "a timed path with a limit of 0": lambda: timed(limits=rates(velocity=np.zeros(2))),
    "a timed path with a jerk limit that is NaN": lambda: timed(limits=rates(jerk=np.full(2, NAN))),
    "a timed path with constraints that are not verified": lambda: timed(rows=lambda *_: None),
    "a timed path with constraints of wrong shapes": lambda: timed(
        rows=lambda q, *_: (np.ones((len(q), 1)), *[np.ones((1, 1))] * 3), excess=lambda *_: np.ones(1)
    ),
    "a tour without jobs": lambda: tour(job=np.zeros(0, dtype=np.int64), time=np.zeros((1, 1))),
    "a tour of jobs with a gap": lambda: tour(job=np.array([0, 0, 2])),
    "a tour with too few times": lambda: tour(time=np.zeros((3, 3))),
    "a tour with an infinite time": lambda: tour(time=np.full((4, 4), np.inf)),
    "a pair of a job that does not exist": lambda: tour(pairs=np.array([[0, 2]])),
    "pairs of three jobs": lambda: tour(pairs=np.zeros((1, 3), dtype=np.int64)),
    "a tour that violates a pair": lambda: tour(first=np.array([2, 0])),
    "a tour with two options of a job": lambda: tour(first=np.array([0, 1])),
    "a tour with an option that does not exist": lambda: tour(first=np.array([0, 3])),
    "a tour that lacks a job": lambda: tour(first=np.array([0])),
    "draws of a tour that are too short": lambda: tour(draws=np.zeros((1, 4))),
    "draws of a tour above 1": lambda: tour(draws=np.ones((1, 8))),
    "corners of no waypoints": lambda: _core.corners(np.zeros((0, 2))),
    "cells of another type": lambda: carve(cells=np.zeros((2, 2, 2))),
    "cells of two dimensions": lambda: carve(cells=np.zeros((2, 2), dtype=np.uint8)),
    "cells without a size": lambda: carve(side=0.0),
    "cells without an end": lambda: carve(side=np.inf),
    "cells too far away": lambda: carve(low=np.array([2**62, 0, 0])),
    "a camera without a focal length": lambda: carve(intrinsics=np.array([0.0, 1, 0, 0])),
    "a camera with NaN": lambda: carve(intrinsics=np.array([1.0, 1, NAN, 0])),
    "a camera at NaN": lambda: carve(camera_from_grid=np.full((4, 4), NAN)),
    "depths of different sizes": lambda: carve(farthest=np.ones((3, 5), dtype=np.float32)),
    "depths without a pixel": lambda: carve(**dict.fromkeys(("nearest", "farthest"), np.ones((0, 4), np.float32))),
    "a negative depth": lambda: carve(nearest=-np.ones((3, 4), dtype=np.float32)),
    "a depth of NaN": lambda: carve(farthest=np.full((3, 4), NAN, dtype=np.float32)),
    "a negative margin of pixels": lambda: carve(pixel_margin=-1),
    "cells within a half-space": lambda: clear(shape=_core.Shape.half_space(np.zeros((2, 3)))),
    "cells within a negative padding": lambda: clear(padding=-1.0),
    "cells within a padding of NaN": lambda: clear(padding=NAN),
    "cells of a shape at NaN": lambda: clear(shape_from_grid=np.full((4, 4), NAN)),
    "an array of float32": lambda: _core.Workspace(world()).judge(np.zeros(2, dtype=np.float32)),
}


@pytest.mark.parametrize("case", REFUSED)
def test_the_core_refuses(case: str) -> None:
    with pytest.raises(REFUSALS):
        REFUSED[case]()


def test_the_arguments_without_a_mistake_are_accepted() -> None:
    carve()
    assert clear() == 8
    assert sorted(tour().tolist()) in ([0, 2], [1, 2])
    region()
    assert manifold().project(np.full(DOF, 0.3), 0.5) is not None
    prove_upright(np.zeros((1, 2, DOF)), np.zeros(DOF))
    assert _core.Workspace(world()).judge(np.zeros(2)) == 0
    assert prove(UNIT, STRAIGHT, np.zeros(2)).free
    assert separate()[0].groups[0].proof.end == 1.0
    assert _core.facet_directions(world(), 0, np.zeros(2), 0.1).shape == (0, 3)
    for first in (np.zeros(DOF), np.full(DOF, 3.0 + 1e-10)):
        assert follower().follow(route(), first).q.shape[1] == DOF
    assert np.allclose(_core.spline_slopes(UNIT, np.eye(2)), [[-1.0, 1.0]] * 2)
    assert prove_beside_mesh().free
    assert not prove_beside_mesh(corners=mesh_corners() - np.tile([0.25, 0.0, 0.0], 3), box=3.5 * BOX).free
    assert search().branch(0, 0) == [0]
    assert reach().prove(EYE, 1e-6, 1e-6, 10, False).boxes > 0
    assert len(closed_form().solve_batch(EYE[None], np.zeros((1, DOF)), np.zeros((1, 1, 0)), 8)[0]) == 1
    assert bounds().tight(0, np.array([1.0, 0.0, 0.0]), 0, np.zeros((2, 2))).distance >= 0.0
    assert edges().proven_free(np.zeros(2), np.array([0.1, 0.1]))
