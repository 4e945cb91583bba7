"""Compare the bounds of torque and tool motion with dense samples by Pinocchio; prints the table of docs/dynamics.md.

./scripts/benchmark rates [--trajectories 40] [--points 10000]     takes some minutes

Half of the trajectories of a robot are random Hermite curves, which exceed their limits. The others are random paths,
timed with and without a jerk limit for limits of torque, and half of those of the tool too.
"""

from __future__ import annotations

import argparse
import dataclasses
import re
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pinocchio as pin

import pinproof as pp
from benchmarks.tables import Row, row_table
from pinproof.model import load_robot
from pinproof.motion import JointPath, RateConstraint, ToolLimits, TorqueLimits, Trajectory, time_parametrise

Array = npt.NDArray[np.float64]

ROBOTS = ("panda", "panda with a mimic joint", "ur5", "iiwa14", "stanford", "scara")
PART = pp.Payload(3.0, np.array([0.0, 0.03, 0.1]), np.array([0.02, 0.02, 0.03]))
ROUNDING = 1e-9
"""Relative excess over a bound that counts as a violation."""

RATES = ("linear_speed", "angular_speed", "linear_acceleration", "angular_acceleration")


def load(name: str) -> pp.Arm:
    """An arm of the catalogue; with a mimic joint, joint 6 of the Panda follows joint 4."""
    robot = pp.load_robot(name.split()[0])
    if "mimic" not in name:
        return robot.arm()
    text = re.sub(
        r'(<joint name="panda_joint6"[^>]*>)',
        r'\1<mimic joint="panda_joint4" multiplier="-0.5" offset="0.4"/>',
        Path(str(robot.urdf.path)).read_text(encoding="utf-8"),
    )
    arm = load_robot(text).arm(tcp="panda_hand_tcp")
    if not arm.chain.has_mimic_joints:
        raise RuntimeError("the URDF of the Panda has no joint 6 as expected")
    return arm


@dataclass(frozen=True)
class Samples:
    """Torques (N, n) with and from gravity, and rates of the tcp (N, 4), at ``per_piece`` times of each piece."""

    torque: Array
    gravity: Array
    tool: Array
    per_piece: int

    @classmethod
    def of(cls, arm: pp.Arm, trajectory: Trajectory, points: int) -> Samples:
        """Sample inside the pieces, because the acceleration of a cubic jumps between them."""
        knots = trajectory.times
        per_piece = max(2, -(-points // (len(knots) - 1)))
        inside = np.linspace(1e-7, 1.0 - 1e-7, per_piece)
        times = (knots[:-1, None] + np.diff(knots)[:, None] * inside).ravel()
        model, scale = arm.model, arm.scale
        frame = model.frames[arm.tcp_id]
        body = pin.Inertia(PART.mass, np.array(PART.center_of_mass), np.array(PART.inertia))
        model.inertias[frame.parentJoint] += frame.placement.act(body)
        data, axes = model.createData(), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        torque, gravity, tool = [], [], []
        motion = trajectory(times), trajectory.velocity(times), trajectory.acceleration(times)
        for q, v, a in zip(*motion, strict=True):
            state = scale @ q + arm.offset, scale @ v, scale @ a
            torque.append(scale.T @ pin.rnea(model, data, *state))
            gravity.append(scale.T @ pin.computeGeneralizedGravity(model, data, state[0]))
            pin.forwardKinematics(model, data, *state)
            speed = pin.getFrameVelocity(model, data, arm.tcp_id, axes)
            gain = pin.getFrameClassicalAcceleration(model, data, arm.tcp_id, axes)
            tool.append([np.linalg.norm(x) for x in (speed.linear, speed.angular, gain.linear, gain.angular)])
        return cls(np.array(torque), np.array(gravity), np.array(tool), per_piece)

    def stretch_of_torque(self, limits: Array) -> Array:
        """(k,) the largest factor of time that a sample of each piece needs."""
        of_motion = self.torque - self.gravity
        square = np.maximum(of_motion / (limits - self.gravity), -of_motion / (limits + self.gravity))
        return self._per_piece(np.sqrt(np.maximum(square, 0.0)))

    def stretch_of_tool(self, limits: Array) -> Array:
        """(k,) the same for limits (4,) of the tool."""
        share = self.tool / limits
        share[:, 2:] = np.sqrt(share[:, 2:])
        return self._per_piece(share)

    def _per_piece(self, factors: Array) -> Array:
        largest: Array = factors.max(axis=1).reshape(-1, self.per_piece).max(axis=1)
        return largest


def random_curve(arm: pp.Arm, rng: np.random.Generator, *, quintic: bool) -> Trajectory:
    """A Hermite curve through 12 random points."""
    q = rng.uniform(*arm.limits.sampling_range()) + np.cumsum(rng.normal(scale=0.1, size=(12, arm.dof)), axis=0)
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.02, 0.2, 11))])
    a = 4.0 * rng.normal(size=q.shape) if quintic else None
    return Trajectory(times, q, 0.5 * rng.normal(size=q.shape), arm.joint_names, accelerations=a)


@dataclass(frozen=True)
class Problem:
    """A trajectory with its samples, limits of torque and of the tool, and those for which it was timed."""

    trajectory: Trajectory
    samples: Samples
    torque: TorqueLimits
    tool: ToolLimits
    kept: tuple[RateConstraint, ...] = ()

    @classmethod
    def random(cls, arm: pp.Arm, rng: np.random.Generator, points: int, *, quintic: bool) -> Problem:
        """A random curve with limits that it exceeds, and that standstill keeps."""
        trajectory = random_curve(arm, rng, quintic=quintic)
        samples = Samples.of(arm, trajectory, points)
        torque = TorqueLimits(arm, PART, limits=1.2 * np.abs(samples.gravity).max(axis=0) + 0.5)
        tool = ToolLimits(arm, **dict(zip(RATES, 0.4 * samples.tool.max(axis=0), strict=True)))
        return cls(trajectory, samples, torque, tool)

    @classmethod
    def timed(cls, arm: pp.Arm, rng: np.random.Generator, points: int, *, jerk: float | None, slow: bool) -> Problem:
        """A random path with two segments, timed for the limits of torque, and of the tool if it is slow."""
        low, high = arm.limits.sampling_range()
        path = JointPath(low + (high - low) * rng.uniform(0.2, 0.8, (3, arm.dof)), arm.joint_names)
        gravity = np.abs(arm.torques_batch(path(np.linspace(*path.domain, 200)), payload=PART)).max(axis=0)
        torque = TorqueLimits(arm, PART, limits=1.15 * gravity + 5.0)
        tool = ToolLimits(arm, linear_speed=0.5, angular_speed=2.0, linear_acceleration=3.0)
        limits = dataclasses.replace(arm.limits, acceleration=np.full(arm.dof, 15.0))
        kept: tuple[RateConstraint, ...] = (torque, tool) if slow else (torque,)
        trajectory = time_parametrise(path, limits, jerk=jerk, rate_limits=kept)
        return cls(trajectory, Samples.of(arm, trajectory, points), torque, tool, kept)

    def violations(self, torque: Array, tool: Array) -> int:
        """Count the samples above the bounds (k,) of the pieces, above the peaks, and above limits that are kept."""
        largest = np.abs(self.samples.torque).max(axis=0)
        peaks = np.array([peak.torque for peak in self.torque.peaks(self.trajectory)])
        pairs = [(self.samples.stretch_of_torque(self.torque.limits), torque), (largest, peaks)]
        pairs.append((self.samples.stretch_of_tool(self.tool.limits), tool))
        if self.kept:
            pairs.append((largest, self.torque.limits))
        if self.tool in self.kept:
            pairs.append((self.samples.tool.max(axis=0), self.tool.limits))
        return sum(int((values > bound * (1.0 + ROUNDING)).sum()) for values, bound in pairs)


def measure_robot(name: str, trajectories: int, points: int) -> Row:
    """Compare the bounds of the trajectories of a robot with samples."""
    arm, rng = load(name), np.random.default_rng(11)
    found, times = Row(robot=name, trajectories=trajectories, samples=0, violations=0, torque=1.0, tool=1.0), []
    for number in range(trajectories):
        each = (
            Problem.random(arm, rng, points, quintic=number % 4 == 1)
            if number % 2
            else Problem.timed(arm, rng, points, jerk=500.0 if number % 4 else None, slow=number % 8 >= 4)
        )
        start = time.process_time()
        torque = each.torque.excess(each.trajectory)
        times.append(1e3 * (time.process_time() - start))
        tool = each.tool.excess(each.trajectory)
        found.samples += len(each.samples.torque)
        found.violations += each.violations(torque, tool)
        for kind, bound, dense in (
            ("torque", torque, each.samples.stretch_of_torque(each.torque.limits)),
            ("tool", tool, each.samples.stretch_of_tool(each.tool.limits)),
        ):
            if bound.max() > 1.0:
                setattr(found, kind, max(getattr(found, kind), float(bound.max() / dense.max())))
    found.ms = float(np.median(times))
    return found


COLUMNS = {
    "robot": "{.robot}",
    "trajectories": "{.trajectories}",
    "samples": "{.samples:,}",
    "violations": "{.violations}",
    "looseness, torque": lambda row: f"{row.torque - 1.0:.1e}",
    "looseness, tool": lambda row: f"{row.tool - 1.0:.1e}",
    "time (ms)": "{.ms:.2f}",
}


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trajectories", type=int, default=40, help="number for each robot")
    parser.add_argument("--points", type=int, default=10_000, help="samples of each trajectory")
    options = parser.parse_args()
    rows = [measure_robot(robot, options.trajectories, options.points) for robot in ROBOTS]
    print("\n".join(row_table(COLUMNS, rows)))
