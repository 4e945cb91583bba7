"""Other libraries in the same run, each as it is meant to be called; the extra ``peers`` installs them.

A peer is imported when it is asked, and only then. Its answers are judged as ours are: a closed form that knows no
limits has its branches turned into them first, and the others dropped, which costs it no time.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.benchmarks.ik_methods import RESTARTS, TOLERANCE, Asked, IkMethod, Solvers, Unsuitable
from pinproof.benchmarks.peer_chain import BASE, TIP, ScrewAxes, chain_urdf, joint_names, screw_axes
from pinproof.model import Arm
from pinproof.model.robot import load_robot_from_text

__all__ = ["PEERS"]

Array = npt.NDArray[np.float64]

BUDGET = 0.02
"""Seconds that TRAC-IK and roboplan, which stop by the clock, may spend on a target: four times their default."""

STEPS = 100
"""Steps of one attempt; the default of our own solvers."""


def _eaik(arm: Arm, asked: Asked) -> Solvers | None:
    """EAIK (Ostermeier, Külz, Althoff 2024): closed forms in C++."""
    from eaik.IK_HP import HPRobot

    if asked.task != "pose" or asked.problem != "random":
        return None
    axes = _six_turning(arm)
    robot = HPRobot(axes.directions, axes.offsets)
    if not robot.hasKnownDecomposition():
        raise Unsuitable("EAIK knows no closed form for this arm")

    def one(target: Any, _: Array) -> tuple[Any, Any]:
        found = robot.IK(target)
        return found.Q, found.is_LS

    return Solvers(
        one=one,
        read=lambda found: _inside(arm, np.reshape(found[0], (-1, arm.dof))[~np.ravel(found[1])]),
        target=lambda pose: pose @ _without_tool_turn(axes),
    )


def _ik_geo(arm: Arm, asked: Asked) -> Solvers | None:
    """IK-Geo (Elias, Wen 2022): subproblems, in Rust."""
    from ik_geo import Robot

    if asked.task != "pose" or asked.problem != "random":
        return None
    axes = _six_turning(arm)
    kind, axes = _geometry(axes)
    robot = getattr(Robot, kind)(axes.directions, axes.offsets)

    def target(pose: Array) -> tuple[Array, Array]:
        turned = pose @ _without_tool_turn(axes)
        return np.ascontiguousarray(turned[:3, :3].T), turned[:3, 3].copy()  # it reads arrays by columns

    return Solvers(
        one=lambda posed, _: robot.get_ik(*posed),
        read=lambda found: _inside(arm, np.reshape([q for q, least_squares in found if not least_squares], (-1, 6))),
        target=target,
    )


def _trac_ik(arm: Arm, asked: Asked) -> Solvers | None:
    """TRAC-IK (Beeson, Ames 2015), by pytracik: Newton with restarts and SQP, two threads, until the clock stops it."""
    from trac_ik import TracIK

    if asked.task != "pose" or not asked.restarts:
        return None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "chain.urdf"
        file.write_text(chain_urdf(arm), encoding="utf-8")
        solver = TracIK(BASE, TIP, str(file), timeout=BUDGET, epsilon=TOLERANCE / 2)  # of each coordinate
    return Solvers(
        one=lambda pose, q0: solver.ik(pose[:3, 3], pose[:3, :3], q0),
        # It keeps limits in single precision: up to 1e-7 rad outside ours, which is not held against it.
        read=lambda q: np.empty((0, arm.dof)) if q is None else arm.limits.clip(q)[None],
        target=lambda pose: pose,
    )


def _toolbox(arm: Arm, asked: Asked) -> Solvers:
    """The Robotics Toolbox (Corke, Haviland): Levenberg-Marquardt in C++, with restarts."""
    from roboticstoolbox import ET, ETS

    axes = screw_axes(arm)
    parts, last = [], np.eye(4)
    for k in range(arm.dof):
        own = _frame_along(axes.directions[k], axes.points[k])
        parts.append(ET.SE3(np.linalg.inv(last) @ own))
        make = ET.Rz if arm.angular[k] else ET.tz
        lower, upper = arm.limits.sampling_range()
        parts.append(make(jindex=k, qlim=[lower[k], upper[k]]))
        last = own
    ets = ETS([*parts, ET.SE3(np.linalg.inv(last) @ axes.base_from_tcp)])
    mask = np.array([1.0, 1, 1, 0, 0, 0]) if asked.task == "position" else None
    # It stops at half the squared error.
    settings = {"ilimit": STEPS, "slimit": 1 + RESTARTS if asked.restarts else 1, "tol": TOLERANCE**2 / 4, "mask": mask}
    return Solvers(
        one=lambda pose, q0: ets.ik_LM(pose, q0, **settings),
        read=lambda found: found.q[None] if found.success else np.empty((0, arm.dof)),
        target=lambda pose: pose,
    )


def _pink(arm: Arm, asked: Asked) -> Solvers | None:
    """Pink (Caron and others): differential inverse kinematics by quadratic programs, here run to convergence."""
    from pink import Configuration, solve_ik
    from pink.limits import ConfigurationLimit
    from pink.tasks import FrameTask
    from qpsolvers import available_solvers

    if asked.restarts and asked.problem == "random":
        return None
    if not available_solvers:
        raise Unsuitable("pink has no solver for quadratic programs; install daqp")
    model = load_robot_from_text(chain_urdf(arm)).arm(TIP).model
    if model.nq != arm.dof:
        raise Unsuitable("joints without limits are pairs of numbers to pink")
    # Ours keeps limits beside the model, not in it.
    model.lowerPositionLimit, model.upperPositionLimit = arm.limits.lower.copy(), arm.limits.upper.copy()
    solver = "daqp" if "daqp" in available_solvers else available_solvers[0]
    limits = [ConfigurationLimit(model, config_limit_gain=1.0)]
    task = FrameTask(TIP, position_cost=1.0, orientation_cost=float(asked.task == "pose"), lm_damping=1e-6)
    shown = slice(0, 6 if asked.task == "pose" else 3)

    def one(target: Any, q0: Array) -> tuple[Array, bool]:
        configuration = Configuration(model, model.createData(), np.array(q0))
        task.set_target(target)
        for _ in range(STEPS):
            if np.linalg.norm(task.compute_error(configuration)[shown]) <= TOLERANCE:
                return configuration.q, True
            step = solve_ik(configuration, [task], 1.0, solver=solver, limits=limits, safety_break=False)
            configuration.integrate_inplace(step, 1.0)
        return configuration.q, False

    return Solvers(
        one=one,
        read=lambda found: arm.limits.clip(found[0])[None] if found[1] else np.empty((0, arm.dof)),  # but for rounding
    )


def _roboplan(arm: Arm, asked: Asked) -> Solvers | None:
    """Roboplan (Castro and others): damped steps in C++, with restarts, until the clock stops it."""
    from roboplan.core import CartesianConfiguration, JointConfiguration, Scene, loadUrdfSceneDescriptionFromXml
    from roboplan.simple_ik import SimpleIk, SimpleIkOptions

    if asked.task != "pose":
        return None
    scene, names = Scene("chain", loadUrdfSceneDescriptionFromXml(chain_urdf(arm))), joint_names(arm)
    options = SimpleIkOptions(
        max_iters=STEPS,
        max_time=BUDGET,
        max_restarts=RESTARTS if asked.restarts else 0,
        max_linear_error_norm=TOLERANCE,
        max_angular_error_norm=TOLERANCE,
        check_collisions=False,
    )
    solver = SimpleIk(scene, options)

    def one(target: Any, q0: Array) -> tuple[bool, Any]:
        solution = JointConfiguration(names, q0)
        return solver.solveIk(target, JointConfiguration(names, q0), solution), solution

    return Solvers(
        one=one,
        read=lambda found: np.array(found[1].positions)[None] if found[0] else np.empty((0, arm.dof)),
        target=lambda pose: CartesianConfiguration(BASE, TIP, np.asfortranarray(pose)),
    )


def _six_turning(arm: Arm) -> ScrewAxes:
    if arm.dof != 6 or not np.all(arm.angular):
        raise Unsuitable("its closed forms are for six joints that turn")
    return screw_axes(arm)


def _without_tool_turn(axes: ScrewAxes) -> Array:
    """(4, 4) what turns a target so that the tool has the axes of the base at q = 0, as closed forms take it."""
    back = np.eye(4)
    back[:3, :3] = axes.base_from_tcp[:3, :3].T
    return back


def _geometry(axes: ScrewAxes) -> tuple[str, ScrewAxes]:
    """Which of IK-Geo's solvers fits, and the axes with their points where it wants them."""
    wrist = axes.meeting_point(3, 4, 5)
    if wrist is not None:
        axes = axes.at((3, 4, 5), wrist)
        shoulder = axes.meeting_point(0, 1)
        if axes.parallel(1, 2):
            return "spherical_two_parallel", axes
        if shoulder is not None:
            return "spherical_two_intersecting", axes.at((0, 1), shoulder)
        return "spherical", axes
    if axes.parallel(1, 2, 3):
        end = axes.meeting_point(4, 5)
        if end is not None:
            return "three_parallel_two_intersecting", axes.at((4, 5), end)
        return "three_parallel", axes
    raise Unsuitable("neither a spherical wrist nor three parallel axes; IK-Geo would search")


def _inside(arm: Arm, branches: Array) -> Array:
    """The branches (k, n) with a whole turn inside the limits, at it."""
    branches = arm.limits.lower + np.mod(branches - arm.limits.lower, 2 * np.pi)
    return branches[((arm.limits.lower <= branches) & (branches <= arm.limits.upper)).all(axis=1)]


def _frame_along(direction: Array, point: Array) -> Array:
    """(4, 4) a frame at a point whose z is a direction."""
    across = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
    across /= np.linalg.norm(across)
    frame = np.eye(4)
    frame[:3] = np.column_stack([across, np.cross(direction, across), direction, point])
    return frame


def _peer(
    key: str, distribution: str, prepare: Callable[[Arm, Asked], Solvers | None], rival: str, most: int | None = None
) -> IkMethod:
    return IkMethod(key, distribution, prepare, rival=rival, most_points=most, distribution=distribution)


PEERS: tuple[IkMethod, ...] = (
    _peer("eaik", "EAIK", _eaik, "analytic"),
    _peer("ik_geo", "ik-geo", _ik_geo, "analytic"),
    _peer("trac_ik", "pytracik", _trac_ik, "clik"),
    _peer("toolbox", "roboticstoolbox-python", _toolbox, "clik"),
    _peer("roboplan", "roboplan", _roboplan, "clik", 1_000),
    _peer("pink", "pin-pink", _pink, "clik", 500),
)
"""The peers; ``rival`` is ours that answers the same question."""
