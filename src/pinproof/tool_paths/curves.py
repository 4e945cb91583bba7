"""From configurations at the rungs to a curve: a spline whose tool stays close to the route at every point.

The configurations of the rungs are smoothed in joint space and then projected back onto the route, so that steps of the
grid become even motions. The spline through the projected points is twice differentiable; the compiled core bounds the
deviation of its tool from the route at every point (``src/core/planning/route_follower.h``). Where the bound exceeds
the tolerance, a joint leaves its limits, or the rotation of the tool leaves its range, points are added.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.ik import Clik, IkTask
from pinproof.model import Arm
from pinproof.motion import IMAGE_TOLERANCE, CubicPath
from pinproof.planning import Route, RouteFollower
from pinproof.spatial import Array

# Largest number of rounds in which points are added, and the number of parts into which a step is divided at most.
ROUNDS, PARTS = 14, 256
# M and rad: accuracy with which points are projected onto the route.
PROJECTED = 1e-8
# The same as a share of the allowed deviation, for an arm that cannot be closer to the route, such as one of five
# joints whose parallel axes differ by the rounding of its description. The bound of the deviation decides.
NEARLY = 0.01
# Distance of parameters of a route that are equal up to rounding.
SAME = 1e-12
# rad or m: largest distance of a projected point from the curve before. A longer one leads to another branch.
FAR = 0.5
# rad or m: excess over a joint limit that is attributed to floating-point errors.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class RouteCurve:
    """A joint curve along a route, with bounds of the deviation (m, rad) of the tool from it at every point."""

    path: CubicPath
    deviation: float
    rotation_deviation: float


@dataclass(frozen=True)
class NoCurve:
    """The parameter of the route at which no curve was found, and why."""

    s: float
    reason: str


@dataclass(frozen=True, eq=False)
class CurveMaker:
    """Makes curves along routes, whose tool deviates by at most ``deviation`` (m) and ``rotation_deviation`` (rad).

    ``task`` states what the deviation counts, ``projection`` the coordinates that projected points share with the
    route. ``spin`` is the range (rad) of the rotation of the tool about its axis, None if it is not limited.
    """

    arm: Arm
    task: IkTask
    deviation: float
    rotation_deviation: float
    spin: tuple[float, float] | None
    projection: IkTask

    @property
    def follower(self) -> RouteFollower:
        """The bounds of the deviation."""
        return RouteFollower(
            arm=self.arm, task=self.task, deviation=self.deviation, rotation_deviation=self.rotation_deviation
        )

    def curve(self, route: Route, s: Array, q: Array, width: float) -> RouteCurve | NoCurve:
        """The curve along a route over the rungs s (k,) with configurations q (k, n).

        ``width`` is the length of the window of the parameter over which steps are smoothed; 0 for none. The first and
        the last configuration are kept.
        """
        arm, follower = self.arm, self.follower
        borders = np.array([piece.end for piece in route.compiled.pieces[:-1]])
        borders = borders[(borders > s[0] + SAME) & (borders < s[-1] - SAME)]
        # A rung that is a border up to rounding is that border
        apart = np.abs(s[1:-1, None] - borders).min(axis=1, initial=np.inf) > SAME
        knots = np.concatenate([s[:1], np.union1d(s[1:-1][apart], borders), s[-1:]])
        guess = _smoothed(knots, s, q, width)
        points, missed = self._projected(route, knots[1:-1], guess[1:-1])
        if missed is not None:
            return NoCurve(*missed)
        points = np.concatenate([q[:1], points, q[-1:]])
        finest = np.diff(s).min() / PARTS
        for _ in range(ROUNDS):
            path = CubicPath.through(points, arm.joint_names, knots)
            bounds = follower.bound(path, route)
            outside = self._outside(path)
            bad = ~(bounds <= [self.deviation, self.rotation_deviation]).all(axis=1) | (outside > ROUNDING)
            if self.spin is not None:
                bad |= self._spins(path, route)
            if not bad.any():
                return RouteCurve(path, float(bounds[:, 0].max()), float(bounds[:, 1].max()))
            worst = int(np.flatnonzero(bad)[0])
            if (np.diff(knots)[bad] < finest).any():
                break
            # A spline may swing far out in a long piece beside the short ones of a rounded corner. From there, the
            # projection would change the rotation of the tool too
            middles, guess = 0.5 * (knots[:-1] + knots[1:])[bad], 0.5 * (points[:-1] + points[1:])[bad]
            bent, steps = path(middles), np.abs(np.diff(points, axis=0))[bad].max(axis=1, keepdims=True)
            guess = np.where(np.abs(bent - guess).max(axis=1, keepdims=True) <= steps, bent, guess)
            added, missed = self._projected(route, middles, guess)
            if missed is not None:
                return NoCurve(*missed)
            order = np.argsort(np.concatenate([knots, middles]), kind="stable")
            knots, points = np.concatenate([knots, middles])[order], np.concatenate([points, added])[order]
        if outside[worst] > ROUNDING:
            reason = f"a joint leaves its limits or stated values by {outside[worst]:.2g} rad or m between the poses"
        else:
            reason = (
                f"the tool deviates by {bounds[worst, 0] * 1e3:.2g} mm, {bounds[worst, 1]:.2g} rad between the poses"
            )
        return NoCurve(float(0.5 * (knots[worst] + knots[worst + 1])), reason)

    def _projected(self, route: Route, s: Array, q: Array) -> tuple[Array, tuple[float, str] | None]:
        """The configurations closest to q (k, n) with the tool on the route at s (k,), or where none exists."""
        if not len(s):
            return np.empty((0, self.arm.dof)), None
        targets, start = route.poses(s), self.arm.limits.clip(q)
        for accuracy in ((PROJECTED, PROJECTED), (NEARLY * self.deviation, NEARLY * self.rotation_deviation)):
            solver = Clik(position_tolerance=accuracy[0], orientation_tolerance=accuracy[1], restarts=0)
            found = solver.solve_batch(self.arm, targets, start, task=self.projection)
            far = np.abs(found.q - q).max(axis=1) > FAR
            if not (bad := far | ~found.ok).any():
                return found.q, None
        first = int(bad.argmax())
        joint = self.arm.joint_names[int(np.abs(found.q - q)[first].argmax())]
        reason = f"{joint} would jump" if found.ok[first] else "the tool cannot stay on the path between the poses"
        return found.q, (float(s[first]), reason)

    def _outside(self, path: CubicPath) -> Array:
        """(k,) the largest excess over a joint limit on each piece."""
        control, limits = path.bezier().control, self.arm.limits
        excess = np.maximum(control - limits.upper, limits.lower - control).max(axis=(1, 2))
        return np.asarray(np.maximum(excess, 0.0))

    def _spins(self, path: CubicPath, route: Route) -> npt.NDArray[np.bool_]:
        """(k,) whether the rotation of the tool about its axis may leave its range on each piece.

        From the closer one of the two ends of a piece, the tool rotates by at most half of the sum of the lengths of
        the control polygons of the revolute joints, and the route by at most half of its rotation.
        """
        knots, control = path.bezier()
        relative = (
            np.swapaxes(route.poses(knots)[:, :3, :3], 1, 2) @ self.arm.forward_kinematics_batch(path.q)[:, :3, :3]
        )
        angle = np.arctan2(relative[:, 1, 0] - relative[:, 0, 1], relative[:, 0, 0] + relative[:, 1, 1])
        low, high = self.spin or (-np.pi, np.pi)
        middle = 0.5 * (low + high)
        angle = middle + np.remainder(angle - middle + np.pi, 2.0 * np.pi) - np.pi
        excess = np.maximum(low - angle, angle - high)
        revolute = [joint for joint in self.arm.chain.joints if not joint.prismatic]  # followers (mimic) too
        shares = np.bincount(
            [joint.index for joint in revolute], [abs(joint.multiplier) for joint in revolute], self.arm.dof
        )
        turned = 0.5 * np.abs(np.diff(control, axis=1)).sum(axis=1) @ shares
        rates = np.array([
            5.0 * max(np.abs(np.diff(piece.b)).max(), np.abs(np.diff(piece.a)).max())
            * (np.linalg.norm(piece.into.rotation) + np.linalg.norm(piece.out.rotation))
            for piece in route.compiled.pieces
        ])  # fmt: skip
        ends = np.array([piece.end for piece in route.compiled.pieces[:-1]])
        starts = np.concatenate([[0.0], ends])
        spans = np.diff(np.concatenate([starts, [1.0]]))
        piece = np.searchsorted(ends, 0.5 * (knots[:-1] + knots[1:]))
        turned += 0.5 * rates[piece] / np.maximum(spans[piece], 1e-300) * np.diff(knots)
        margin = self.rotation_deviation / max(np.cos(min(self.rotation_deviation, 1.5)), 1e-3)
        return np.asarray(np.maximum(excess[:-1], excess[1:]) + turned > margin + 1e-6, dtype=bool)


def image_deviation(arm: Arm) -> tuple[float, float]:
    """How far (m, rad) the tool of a timed curve may be from that of its path, which it follows to a joint tolerance.

    Each joint moves the tool by at most its distance from it times its own deviation, a prismatic joint by its own.
    """
    total, turned, lever = 0.0, 0.0, float(np.linalg.norm(arm.chain.tool[:3, 3]))
    for joint in reversed(arm.chain.joints):
        share = abs(joint.multiplier)
        total += share * (1.0 if joint.prismatic else lever)
        turned += 0.0 if joint.prismatic else share
        lever += float(np.linalg.norm(joint.before[:3, 3]))
        if joint.prismatic:
            ends = np.array([arm.limits.lower[joint.index], arm.limits.upper[joint.index]])
            lever += float(np.abs(joint.multiplier * ends + joint.offset).max())
    return IMAGE_TOLERANCE * total, IMAGE_TOLERANCE * turned


def _smoothed(knots: Array, s: Array, q: Array, width: float) -> Array:
    """(m, n) the polyline through q (k, n) at s (k,), averaged over windows of the parameter that keep both ends."""
    if width <= 0.0 or len(s) < 3:
        return np.column_stack([np.interp(knots, s, column) for column in q.T])
    # The mean over a window that shrinks towards the ends, by the integral of the polyline
    half = np.minimum(0.5 * width, np.minimum(knots - s[0], s[-1] - knots))
    fine = np.union1d(s, np.concatenate([knots - half, knots + half]).clip(s[0], s[-1]))
    columns = []
    for column in q.T:
        values = np.interp(fine, s, column)
        integral = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(fine))])
        mean = np.interp(knots + half, fine, integral) - np.interp(knots - half, fine, integral)
        columns.append(np.where(half > 1e-12, mean / np.maximum(2.0 * half, 1e-300), np.interp(knots, s, column)))
    return np.column_stack(columns)
