"""Steps of the methods, residuals and goals in plain NumPy, with which the compiled ones are compared."""

from collections.abc import Iterable
from dataclasses import fields
from types import SimpleNamespace

import numpy as np

import pinproof as pp
from pinproof.ik.fabrik import HANDOVER
from pinproof.ik.loop import DescentState, ObservingRule
from pinproof.ik.result import TURN, stops
from pinproof.ik.task import LONGEST_GOAL_STEP
from pinproof.model import Arm
from pinproof.spatial import Array, inverse_matrix, matrix, rotation_about_line

WeightedEnds = Iterable[tuple[float, Array]]

NOTHING = 1e-12
"""An entry or a singular value of a Jacobian below this is due to rounding."""

FINITE_STEP, TINY = 1e-5, 1e-14
"""Rad or m, for central differences of the manipulability; added to the squares of singular values."""

CLIK = SimpleNamespace(GROWTH=4.0, RELIEF=0.5, MOST_GROWTHS=20, SMALLEST_DAMPING=1e-10)
FABRIK = SimpleNamespace(
    HINGE_HALF_LENGTH=0.17, HOLD=0.03, HOLD_POSED=1.0, REACH=0.001, RELAX_HOLD=0.8, RELAX_REACH=1.6, BASE=0.1, AIM=0.3,
    WAIT=30, BEND=0.2, STILL=1e-9, TINY=1e-12,
)  # fmt: skip


class DampedStep:
    """The step rule of Clik, with the current factor of its damping."""

    def __init__(self, damping: float, max_step: float) -> None:
        self._constants = CLIK
        self._damping, self._max_step = damping, max_step
        self._last, self._growth = np.inf, 1.0

    def observe(self, here: DescentState) -> None:
        # damping grows after a step that increased the error, and is relieved otherwise
        better = here.squared_residual < self._last
        reduced = max(1.0, self._growth * self._constants.RELIEF)
        self._growth = reduced if better else self._growth * self._constants.GROWTH
        self._last = here.squared_residual
        self._squared_residual = min(here.squared_residual, 1.0)

    def __call__(self, residual: Array, jacobian: Array) -> Array:
        # more damping until the step is not longer than the bound
        square = jacobian @ jacobian.T
        damping = 0.5 * self._growth * self._damping * self._squared_residual + self._constants.SMALLEST_DAMPING
        step = np.zeros(jacobian.shape[1])
        for _ in range(self._constants.MOST_GROWTHS):
            step = -jacobian.T @ np.linalg.solve(square + damping * np.eye(6), residual)
            if np.abs(step).max() <= self._max_step:
                break
            damping *= self._constants.GROWTH
        return np.asarray(step)


class SingularStep:
    """The step rule of DampedLeastSquares and PseudoInverse, from the singular values of A."""

    def __init__(self, cutoff: float, damping: float, region: float) -> None:
        self._cutoff, self._damping, self._region = cutoff, damping, region

    def __call__(self, residual: Array, jacobian: Array) -> Array:
        # rows that the task does not select and columns of held joints are zero, and reduce the rank
        left, values, right = np.linalg.svd(jacobian, full_matrices=False)
        nonzero = np.abs(jacobian) > NOTHING
        rank = min(nonzero.any(axis=1).sum(), nonzero.any(axis=0).sum())
        share = (values[rank - 1] if rank else 0.0) / self._region
        squared = self._damping**2 * float(np.linalg.norm(residual)) * (1 - share**2) if share < 1 else 0.0
        kept = values > max(self._cutoff * values[0], NOTHING)
        factors = values[kept] / (values[kept] ** 2 + squared)
        return np.asarray(-right[kept].T @ (factors * (left[:, kept].T @ residual)))


class Passes:
    """The step rule of Fabrik, with (4, 4) matrices in the axes of the target."""

    def __init__(self, end: ObservingRule, handover: float) -> None:
        self._constants = FABRIK
        self._end, self._handover = end, handover

    def observe(self, here: DescentState) -> None:
        """Compute the step by the two passes."""
        self._end.observe(here)
        self._step: Array | None = None
        if here.squared_residual <= self._handover**2:
            return
        # poses and hinges in the axes of the target
        chain, limits = here.arm.chain, here.arm.limits
        self._lower, self._upper = limits.lower, limits.upper
        self._low, self._high = stops(here.arm)
        joints = chain.joints
        self._links, self._prismatic = [*(joint.before for joint in joints), chain.tool], [j.prismatic for j in joints]
        self._start = matrix(here.target.inverse())
        self._position_weight, self._rotation_mask = here.task.mask[0], here.task.mask[3:]
        self._step = self._pass(here.q, here.iteration)
        deadlock = here.waited > 0 and here.waited % self._constants.WAIT == 0
        if deadlock or np.abs(self._step).max() <= self._constants.STILL:
            # bend every joint towards the middle of its range, or of the circle, the more the longer it has waited
            width = self._upper - self._lower
            share = self._constants.BEND * (1 + here.waited // self._constants.WAIT)
            bend = share * np.minimum(width, TURN)
            with np.errstate(invalid="ignore"):
                above = np.isfinite(width) & (here.q > 0.5 * (self._lower + self._upper))
            bent = np.clip(here.q + np.where(above, -bend, bend), self._low, self._high)
            self._step = np.asarray(bent - here.q)

    def __call__(self, residual: Array, jacobian: Array) -> Array:
        """The step of the passes, or that of Clik below the handover residual."""
        return self._end(residual, jacobian) if self._step is None else self._step

    def _pass(self, q: Array, iteration: int) -> Array:
        known, n, angles = self._constants, len(q), int(self._rotation_mask.sum())
        # passes that preserve the shape alternate with passes that reach for the target
        weight, relax = known.REACH, known.RELAX_REACH
        if iteration % 2 == 0:
            weight, relax = known.HOLD if angles == 0 else known.HOLD_POSED, known.RELAX_HOLD
        # the origin and direction (2, 3) of each hinge, and the pose (4, 4) of the tcp
        end, hinges = self._start, list[Array]()
        for k, link in enumerate(self._links):
            end = end @ link
            if k < n:
                hinges.append(np.vstack([end[:3, 3], end[:3, 2]]))
                end = self._motion(k, hinges[k], q[k]) @ end
        # backwards: the last link on the target, and each link below as close as possible to where it was
        moved = [np.eye(4)] * n + [self._last(hinges[-1], end)]
        for k in range(n - 1, 0, -1):
            ends = [(weight, hinges[k - 1])] + [(known.BASE, hinges[0])] * (k > 1)
            by = self._best(k, hinges[k], inverse_matrix(moved[k + 1]), ends)
            # The link below moves opposite to the joint.
            moved[k] = moved[k + 1] @ self._motion(k, hinges[k], -self._allowed(k, q[k], -by))
        # forwards from the fixed base: each link as close as possible to where the pass back placed it
        forward, step = np.eye(4), np.zeros(n)
        for k in range(n):
            tcp = inverse_matrix(moved[k + 1])
            axes = {0: np.zeros((0, 3)), 2: np.eye(3)[self._rotation_mask == 0], 3: np.eye(3)}[angles] @ tcp[:3, :3].T
            ends = [(1.0, np.vstack([tcp[:3, 3], axes]))] + [(weight, hinges[k + 1]) for _ in range(k < n - 1)]
            by = self._allowed(k, q[k], self._best(k, hinges[k], inverse_matrix(forward) @ moved[k + 1], ends))
            forward = forward @ self._motion(k, hinges[k], by)
            step[k] = np.clip(q[k] + relax * by, self._low[k], self._high[k]) - q[k]
        return step

    def _last(self, hinge: Array, end: Array) -> Array:
        """The motion (4, 4) of the last link that brings the tcp to the target."""
        if self._rotation_mask.any():
            spin = np.eye(4)
            if not self._rotation_mask.all():
                axis = np.vstack([np.zeros(3), np.eye(3)[self._rotation_mask == 0]])
                back = inverse_matrix(end)
                brought = np.vstack([_at(back, hinge[0]), back[:3, :3] @ hinge[1]])
                spin = rotation_about_line(axis[0], axis[1], self._angle(axis, end, [(1.0, brought)]))
            return np.asarray(spin @ inverse_matrix(end))
        # a position only: rotate the last link so that it points from its hinge to the target
        before, after = hinge[0] - end[:3, 3], hinge[0]
        normal = np.cross(before, after)
        size = float(np.linalg.norm(normal))
        turn = np.eye(4)
        if size > self._constants.TINY:
            angle = self._constants.AIM * np.arctan2(size, before @ after)
            turn = rotation_about_line(np.zeros(3), normal / size, angle)
        turn[:3, 3] = -turn[:3, :3] @ end[:3, 3]
        return turn

    def _best(self, k: int, hinge: Array, wanted: Array, ends: WeightedEnds) -> float:
        """The motion of hinge k that is closest to the wanted motion (4, 4), measured at the ends."""
        if not self._prismatic[k]:
            return self._angle(hinge, wanted, ends)
        shares = [(w, self._position_weight * float(hinge[1] @ (_at(wanted, one[0]) - one[0]))) for w, one in ends]
        return sum(w * along for w, along in shares) / sum(w for w, _ in shares)

    def _angle(self, hinge: Array, wanted: Array, ends: WeightedEnds) -> float:
        """:meth:`_best` for a revolute joint. An end is a point and directions (1 + i, 3), with its weight."""
        origin, d = hinge
        c = s = 0.0
        for weight, one in ends:
            pairs = [(self._position_weight, one[0] - origin, _at(wanted, one[0]) - origin)]
            pairs += [(self._constants.HINGE_HALF_LENGTH**2, e, wanted[:3, :3] @ e) for e in one[1:]]
            for share, a, z in pairs:
                c += weight * share * (a @ z - (d @ a) * (d @ z))
                s += weight * share * float(d @ np.cross(a, z))
        return float(np.arctan2(s, c)) if c * c + s * s > self._constants.TINY**2 else 0.0

    def _allowed(self, k: int, value: float, change: float) -> float:
        """The change closest to this one (on the circle, for a revolute joint) that keeps joint k within its limits."""
        low, high = self._low[k] - value, self._high[k] - value
        if low <= change <= high:
            return change
        if self._prismatic[k]:
            return float(np.clip(change, low, high))
        around = change + TURN if change < low else change - TURN
        if low <= around <= high:
            return around
        return float(low if np.cos(change - low) >= np.cos(change - high) else high)

    def _motion(self, k: int, hinge: Array, by: float) -> Array:
        if not self._prismatic[k]:
            return rotation_about_line(hinge[0], hinge[1], by)
        slid = np.eye(4)
        slid[:3, 3] = by * hinge[1]
        return slid


def _at(pose: Array, point: Array) -> Array:
    return np.asarray(pose[:3, :3] @ point + pose[:3, 3])


def rotation_vector(r: Array) -> Array:
    """The rotation vector (3,), axis times angle from 0 to pi, of a rotation (3, 3).

    The angle is computed from sine and cosine together, which is accurate to rounding both for small angles and near
    pi; the arccosine of the trace alone is inaccurate below 1e-8. Near pi the axis is computed from R + R^T.
    """
    # the axis times twice the sine of the angle
    twice = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    sine, cosine = float(np.linalg.norm(twice)) / 2, (float(np.trace(r)) - 1) / 2
    angle = np.arctan2(sine, cosine)
    if cosine >= -0.99:
        return np.asarray(twice / 2 * (angle / sine if sine > 1e-6 else 1.0))
    # the largest diagonal entry of R + R^T belongs to the largest component of the axis
    column = int(np.diag(r).argmax())
    axis = r[:, column] + r[column] - 2 * cosine * np.eye(3)[column]
    axis *= angle / np.linalg.norm(axis)
    return np.asarray(-axis if axis @ twice < 0 else axis)


def left_jacobian_inverse(v: Array) -> Array:
    """The inverse (3, 3) of the left Jacobian of SO(3) at a rotation vector (3,) shorter than 2 pi."""
    square = float(v @ v)
    angle = np.sqrt(square)
    c = 1 / 12 if angle < 1e-3 else (1 - 0.5 * angle / np.tan(0.5 * angle)) / square
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.asarray(np.eye(3) - 0.5 * cross + c * (cross @ cross))


def residual_and_jacobian(task, target_from_tcp, in_target_axes):
    """The residual (6,) at the pose E (4, 4), and its derivative from the Jacobian (6, n) in the axes of the target."""
    vector = rotation_vector(target_from_tcp[:3, :3])
    rows = in_target_axes * task.mask[:, None]
    if 0 < task.mask[3:].sum() < 3:
        rows[3:] = (left_jacobian_inverse(vector) @ in_target_axes[3:]) * task.mask[3:, None]
    return np.concatenate([target_from_tcp[:3, 3], vector]) * task.mask, rows


def log_manipulability(arm: Arm, q: Array) -> float:
    jacobian = arm.local_jacobian(q)[1]
    square = jacobian.T @ jacobian if arm.dof < 6 else jacobian @ jacobian.T
    return 0.5 * float(np.linalg.slogdet(square + TINY * np.eye(len(square)))[1])


def goal_step(goal, arm, q):
    """The step (n,) of a null-space goal, that of the manipulability by central differences."""
    if goal.kind == "manipulability":
        shifts = FINITE_STEP * np.eye(arm.dof)
        rises = [log_manipulability(arm, q + shift) - log_manipulability(arm, q - shift) for shift in shifts]
        step = goal.gain * np.array(rises) / (2 * FINITE_STEP)
    else:
        step = goal.gain * goal.weight * (goal.posture - q)
    return step * min(1.0, LONGEST_GOAL_STEP / max(float(np.abs(step).max()), TINY))


class PlainClik(pp.Clik):
    def step_rule(self):
        return DampedStep(self.damping, self.max_step)


class PlainDamped(pp.DampedLeastSquares):
    def step_rule(self):
        return SingularStep(0.0, self.damping, self.region)


class PlainPseudoInverse(pp.PseudoInverse):
    def step_rule(self):
        return SingularStep(self.cutoff, 0.0, 1.0)


class PlainFabrik(pp.Fabrik):
    def step_rule(self):
        return Passes(DampedStep(pp.Clik.damping, self.max_step), HANDOVER if self.polish else 0.0)


PLAIN = {kind.__base__: kind for kind in (PlainClik, PlainDamped, PlainPseudoInverse, PlainFabrik)}


def plain(solver, **settings):
    """The same method with the rule in NumPy, on Pinocchio."""
    own = {each.name: getattr(solver, each.name) for each in fields(solver)}
    return PLAIN[type(solver)](**{**own, "engine": "pinocchio", **settings})
