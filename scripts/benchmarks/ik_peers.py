"""Other libraries in the IK benchmark, called as their documentation recommends; the extra ``peers`` installs them.

They are imported only when they are used. They receive the chain and the limits of the run as the URDF of its DH table,
or as joint axes and the offsets between them: no meshes, grippers or mimic joints. Their answers are checked like ours;
branches of closed forms without limits are first shifted by full rotations into the limits, and dropped if that is not
possible, which is not timed.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring, tostring

import numpy as np

from benchmarks.ik_methods import (
    RESTARTS,
    TOLERANCE,
    IkMethod,
    Part,
    PreparedMethod,
    any_part,
    poses_only,
)
from benchmarks.tables import NotApplicableError
from pinproof.description.dh import row_transform
from pinproof.description.dh_urdf import TCP as TIP
from pinproof.ik.analytic_plan import lines_of
from pinproof.model import Arm, dh_to_urdf, load_robot, urdf_to_dh
from pinproof.spatial import Array

BASE = "base_link"

SAME_AXIS = 1e-6
"""Metres and rad within which axes count as intersecting or parallel: URDF files state pi/2 as 1.5708."""

TIME_LIMIT = 0.02
"""Time limit per target in s for TRAC-IK and roboplan: four times their default."""

MAX_ITERATIONS = 100
"""Iterations per attempt; the default of our solvers."""


# -- the chain as other libraries read it ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ScrewAxes:
    """Joint axes at q = 0 in the base frame: unit vectors (n, 3), a point (n, 3) on each in m, and the TCP (4, 4)."""

    directions: Array
    points: Array
    base_from_tcp: Array

    @property
    def offsets(self) -> Array:
        """(n + 1, 3) from the base to the first point, from each point to the next, and from the last to the TCP, m."""
        return np.diff(np.vstack([np.zeros(3), self.points, self.base_from_tcp[:3, 3]]), axis=0)

    def aligned(self, target: Array) -> Array:
        """Return a target (4, 4) of a TCP with the axes of the base at q = 0, which closed forms require."""
        back = np.eye(4)
        back[:3, :3] = self.base_from_tcp[:3, :3].T
        return target @ back

    def parallel(self, *joints: int) -> bool:
        """Return whether the axes of these joints (counted from 0) are parallel."""
        pairs = combinations(self.directions[list(joints)], 2)
        return all(bool(np.linalg.norm(np.cross(a, b)) < SAME_AXIS) for a, b in pairs)

    def intersecting(self, *joints: int) -> ScrewAxes | None:
        """Return the same axes with the intersection of these joints as their points; None if they do not intersect."""
        p, w = self.points[list(joints)], self.directions[list(joints)]
        across = np.eye(3) - w[:, :, None] * w[:, None, :]
        point, _, rank, _ = np.linalg.lstsq(across.reshape(-1, 3), np.einsum("kij,kj->ki", across, p).ravel())
        apart = np.linalg.norm(np.einsum("kij,kj->ki", across, point - p), axis=1)
        if rank < 3 or apart.max() >= SAME_AXIS:
            return None
        points = self.points.copy()
        points[list(joints)] = point
        return replace(self, points=points)


def screw_axes(arm: Arm) -> ScrewAxes:
    """Return the joint axes of six revolute joints; NotApplicableError if the arm has other or mimic joints."""
    if arm.followers:
        raise NotApplicableError("other libraries cannot read mimic joints on the chain")
    if arm.dof != 6 or not np.all(arm.angular):
        raise NotApplicableError("its closed forms apply to six revolute joints")
    lines, base_from_tcp = lines_of(arm)
    return ScrewAxes(np.array([x.direction for x in lines]), np.array([x.point for x in lines]), base_from_tcp)


def chain_urdf(arm: Arm) -> str:
    """Return a URDF of the chain from :data:`BASE` to :data:`TIP`: joints and limits of the arm, without bodies."""
    robot = fromstring(dh_to_urdf(urdf_to_dh(arm)))
    for link in robot.findall("link"):
        link[:] = []
    return tostring(robot, encoding="unicode")


# -- the libraries -----------------------------------------------------------------------------------------------------


def _eaik(arm: Arm, _: Part) -> PreparedMethod:
    """EAIK (Ostermeier, Külz, Althoff 2024): closed forms in C++."""
    from eaik.IK_HP import HPRobot

    axes = screw_axes(arm)
    robot = HPRobot(axes.directions, axes.offsets)
    if not robot.hasKnownDecomposition():
        raise NotApplicableError("EAIK has no closed form for this arm")

    def solve(target: Any, _: Array) -> tuple[Any, Any]:
        found = robot.IK(target)
        return found.Q, found.is_LS

    return PreparedMethod(
        solve=solve,
        read=lambda found: _inside(arm, np.reshape(found[0], (-1, arm.dof))[~np.ravel(found[1])]),
        convert_target=axes.aligned,
    )


def _ik_geo(arm: Arm, _: Part) -> PreparedMethod:
    """IK-Geo (Elias, Wen 2022): subproblems, in Rust."""
    from ik_geo import Robot

    kind, axes = _geometry(screw_axes(arm))
    robot = getattr(Robot, kind)(axes.directions, axes.offsets)

    def target(pose: Array) -> tuple[Array, Array]:
        turned = axes.aligned(pose)
        return np.ascontiguousarray(turned[:3, :3].T), turned[:3, 3].copy()  # it reads arrays in column order

    return PreparedMethod(
        solve=lambda posed, _: robot.get_ik(*posed),
        read=lambda found: _inside(arm, np.reshape([q for q, least_squares in found if not least_squares], (-1, 6))),
        convert_target=target,
    )


def _ssik(arm: Arm, _: Part) -> PreparedMethod:
    """Ssik (8.x): closed forms, and the elimination of Raghavan and Roth for general arms."""
    from ssik import Manipulator

    axes = screw_axes(arm)
    limits = np.stack([arm.limits.lower, arm.limits.upper], axis=1)
    robot = Manipulator.from_axes(axes.directions, axes.offsets, limits=limits)
    robot.solve(axes.aligned(axes.base_from_tcp))  # the first call derives symbolic terms, for up to minutes
    return PreparedMethod(
        solve=lambda pose, _: robot.solve(pose, enumerate_windings=False),
        read=lambda found: _inside(arm, np.reshape([one.q for one in found], (-1, 6))),
        convert_target=axes.aligned,
    )


def _trac_ik(arm: Arm, _: Part) -> PreparedMethod:
    """TRAC-IK (Beeson, Ames 2015), by pytracik: Newton with restarts and SQP in two threads, with a time limit."""
    from trac_ik import TracIK

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "chain.urdf"
        file.write_text(chain_urdf(arm), encoding="utf-8")
        solver = TracIK(BASE, TIP, str(file), timeout=TIME_LIMIT, epsilon=TOLERANCE / 2)  # of each coordinate
    return PreparedMethod(
        solve=lambda pose, q0: solver.ik(pose[:3, 3], pose[:3, :3], q0),
        # It stores limits in single precision, up to 1e-7 rad outside ours; this is not counted as an error.
        read=lambda q: np.empty((0, arm.dof)) if q is None else arm.limits.clip(q)[None],
        convert_target=lambda pose: pose,
    )


def _toolbox(arm: Arm, part: Part) -> PreparedMethod:
    """The Robotics Toolbox (Corke, Haviland): Levenberg-Marquardt in C++, with restarts."""
    from roboticstoolbox import ET, ETS

    table, (lower, upper) = urdf_to_dh(arm), arm.limits.sampling_range()
    ets = [ET.SE3(table.base)]
    for k, row in enumerate(table.rows):
        joint = ET.Rz if arm.angular[k] else ET.tz
        ets += [joint(jindex=k, qlim=[lower[k], upper[k]]), ET.SE3(row_transform(row, table.convention, 0.0))]
    chain = ETS([*ets, ET.SE3(table.tool)])
    mask = np.array([1.0, 1, 1, 0, 0, 0]) if part.task == "position" else None
    # Its tolerance applies to half the squared error.
    settings = {
        "ilimit": MAX_ITERATIONS,
        "slimit": 1 + RESTARTS if part.restarts else 1,
        "tol": TOLERANCE**2 / 4,
        "mask": mask,
    }
    return PreparedMethod(
        solve=lambda pose, q0: chain.ik_LM(pose, q0, **settings),
        read=lambda found: found.q[None] if found.success else np.empty((0, arm.dof)),
        convert_target=lambda pose: pose,
    )


def _pink(arm: Arm, part: Part) -> PreparedMethod:
    """Pink (Caron and others): differential IK by quadratic programs, here iterated to convergence."""
    from pink import Configuration, solve_ik
    from pink.limits import ConfigurationLimit
    from pink.tasks import FrameTask
    from qpsolvers import available_solvers

    if not available_solvers:
        raise NotApplicableError("Pink found no solver for quadratic programs; install daqp")
    model = load_robot(chain_urdf(arm)).arm(TIP).model
    if model.nq != arm.dof:
        raise NotApplicableError("Pink represents joints without limits by two numbers")
    # The limits of an arm are not part of its Pinocchio model.
    model.lowerPositionLimit, model.upperPositionLimit = arm.limits.lower.copy(), arm.limits.upper.copy()
    solver = "daqp" if "daqp" in available_solvers else available_solvers[0]
    limits = [ConfigurationLimit(model, config_limit_gain=1.0)]
    task = FrameTask(TIP, position_cost=1.0, orientation_cost=float(part.task == "pose"), lm_damping=1e-6)
    rows = slice(0, 6 if part.task == "pose" else 3)

    def solve(target: Any, q0: Array) -> tuple[Array, bool]:
        configuration = Configuration(model, model.createData(), np.array(q0))
        task.set_target(target)
        for _ in range(MAX_ITERATIONS):
            if np.linalg.norm(task.compute_error(configuration)[rows]) <= TOLERANCE:
                return configuration.q, True
            step = solve_ik(configuration, [task], 1.0, solver=solver, limits=limits, safety_break=False)
            configuration.integrate_inplace(step, 1.0)
        return configuration.q, False

    return PreparedMethod(
        solve=solve,
        # Clipping removes rounding errors.
        read=lambda found: arm.limits.clip(found[0])[None] if found[1] else np.empty((0, arm.dof)),
    )


def _roboplan(arm: Arm, part: Part) -> PreparedMethod:
    """Roboplan (Castro and others): damped least squares in C++ with restarts and a time limit."""
    from roboplan.core import CartesianConfiguration, JointConfiguration, Scene, loadUrdfSceneDescriptionFromXml
    from roboplan.simple_ik import SimpleIk, SimpleIkOptions

    scene, names = Scene("chain", loadUrdfSceneDescriptionFromXml(chain_urdf(arm))), list(arm.joint_names)
    options = SimpleIkOptions(
        max_iters=MAX_ITERATIONS,
        max_time=TIME_LIMIT,
        max_restarts=RESTARTS if part.restarts else 0,
        max_linear_error_norm=TOLERANCE,
        max_angular_error_norm=TOLERANCE,
        check_collisions=False,
    )
    solver = SimpleIk(scene, options)

    def solve(target: Any, q0: Array) -> tuple[bool, Any]:
        solution = JointConfiguration(names, q0)
        return solver.solveIk(target, JointConfiguration(names, q0), solution), solution

    return PreparedMethod(
        solve=solve,
        read=lambda found: np.array(found[1].positions)[None] if found[0] else np.empty((0, arm.dof)),
        convert_target=lambda pose: CartesianConfiguration(BASE, TIP, np.asfortranarray(pose)),
    )


def _geometry(axes: ScrewAxes) -> tuple[str, ScrewAxes]:
    """The solver of IK-Geo for this geometry, and the axes with the points that it requires."""
    wrist = axes.intersecting(3, 4, 5)
    if wrist is not None and axes.parallel(1, 2):
        return "spherical_two_parallel", wrist
    if wrist is not None:
        shoulder = wrist.intersecting(0, 1)
        return ("spherical", wrist) if shoulder is None else ("spherical_two_intersecting", shoulder)
    if axes.parallel(1, 2, 3):
        end = axes.intersecting(4, 5)
        return ("three_parallel", axes) if end is None else ("three_parallel_two_intersecting", end)
    raise NotApplicableError("the arm has neither a spherical wrist nor three parallel axes, so IK-Geo would search")


def _inside(arm: Arm, branches: Array) -> Array:
    """Shift the branches (k, n) by full rotations into the limits; drop those that stay outside."""
    branches = arm.limits.lower + np.mod(branches - arm.limits.lower, 2 * np.pi)
    return branches[((arm.limits.lower <= branches) & (branches <= arm.limits.upper)).all(axis=1)]


def _random_poses(part: Part) -> bool:
    return part.task == "pose" and part.problem == "random"


PEERS: tuple[IkMethod, ...] = tuple(
    IkMethod(key, label, prepare, applies, compared_with=ours, max_targets=most, distribution=label)
    for key, label, prepare, applies, ours, most in (
        ("eaik", "EAIK", _eaik, _random_poses, "analytic", None),
        ("ik_geo", "ik-geo", _ik_geo, _random_poses, "analytic", None),
        ("ssik", "ssik", _ssik, _random_poses, "analytic", 500),
        ("trac_ik", "pytracik", _trac_ik, lambda part: part.task == "pose" and part.restarts, "clik", None),
        ("toolbox", "roboticstoolbox-python", _toolbox, any_part, "clik", None),
        ("roboplan", "roboplan", _roboplan, poses_only, "clik", 1_000),
        ("pink", "pin-pink", _pink, lambda part: part.problem == "trajectory" or not part.restarts, "clik", 500),
    )
)
"""The other libraries."""
