r"""Constraints of the tcp in a proof file, and upper bounds of their errors on intervals of the curve.

A constraint states that a vector y stays in a convex set. It is an axis of the tcp (``direction``; in a cone about a
direction of the root), a point of the tcp (``region``; near a box), or the position of a target relative to the tcp
(``target``; in a cone about an axis of the tcp). In an interval the joints stay in a box about q, joint i within
delta_i. With the notation of :mod:`.interval_bounds`, and the joints moving one after the other from the set outward,

.. math:: y' = y + \sum_i \theta_i v_i + z, \qquad
    |z| \le \sum_i |v_i| \, (b_i + \chi_i \sum_{l \text{ between the set and } i} \chi_l) ,

where v_i is the velocity of y per rate of joint i at q, chi its chord and b its second-order term. Without z, y' is in
the hull of its values at the control points. The distance from a box is convex and changes by |z| at most; the angle to
the axis of a cone below 90 degrees is largest at a control point and changes by at most asin(|z| / c), with c the
smallest component of the hull along the axis. In an interval of several pieces the chords bound the whole change.
"""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np

from .interval_bounds import IntervalBounds
from .parts import LARGEST_PARAMETER, Joint, placement, unit_vector
from .reading import Array, Refused, check_fields, index, member, number, numbers, optional_numbers, shown, text

COMMON = ("name", "kind", "joint", "tolerance", "largest", "intervals")
FIELDS = {
    "direction": ("axis", "direction"),
    "region": ("point", "placement", "low", "high"),
    "target": ("axis", "origin", "point"),
}


class Constraint:
    """One constraint of a file.

    Vectors of the tcp (``axis``; the ``point`` of a region; the ``origin`` of the view of a target) are in the frame of
    the joint that carries it, all others in the root frame.
    """

    def __init__(self, row: Any, k: int, joints: int) -> None:
        self.where = where = f"constraints[{k}]"
        self.kind = member(row, where, "kind")
        if type(self.kind) is not str or self.kind not in FIELDS:
            raise Refused(f"{where}.kind: must be {', '.join(FIELDS)}, not {shown(self.kind)}")
        check_fields(row, where, (*COMMON, *FIELDS[self.kind]))
        self.name = text(row, where, "name")
        self.joint = index(member(row, where, "joint"), -1, joints, f"{where}.joint")
        self.tolerance, self.largest = number(row, where, "tolerance"), number(row, where, "largest")
        self.unit = "m" if self.kind == "region" else "rad"
        if not self.tolerance > 0 or not 0 <= self.largest <= self.tolerance:
            raise Refused(f"{where}: tolerance must be above 0, and largest from 0 to the tolerance")
        if self.unit == "rad" and not self.tolerance < pi / 2:
            raise Refused(f"{where}.tolerance: must be below pi/2")
        keys = [key for key in FIELDS[self.kind] if key in ("axis", "direction", "point", "origin")]
        self.vectors = {
            key: unit_vector(row, where, key) if key in ("axis", "direction") else numbers(row, where, key, (3,))
            for key in keys
        }
        if self.kind == "region":
            self.rotation, self.translation = placement(row, where)
            self.low, self.high = (self._corner(row, key, end) for key, end in (("low", -np.inf), ("high", np.inf)))
            if not (self.low <= self.high).all():
                raise Refused(f"{where}: low exceeds high")
        self.intervals = numbers(row, where, "intervals", (None, 2), LARGEST_PARAMETER)

    @property
    def positions(self) -> list[Array]:
        """The vectors (3,) of the constraint, whose size determines the rounding error."""
        return [*self.vectors.values(), *([self.translation] if self.kind == "region" else [])]

    def _corner(self, row: Any, key: str, end: float) -> Array:
        """Return three coordinates; null is a side without an end."""
        return optional_numbers(row, self.where, key, 3, end)

    def errors(self, bounds: IntervalBounds, joints: list[Joint], tolerance: Array, rounding: float) -> Array:
        """Return (T,) upper bounds (rad or m) of the error in each interval; joints deviate by ``tolerance`` (n,)."""
        rotation, translation = bounds.placed(self.joint)
        cone: Array | None = None
        centre = np.zeros(3)
        if self.kind == "direction":
            moved = rotation @ self.vectors["axis"]
            cone = np.broadcast_to(self.vectors["direction"], translation.shape)
        elif self.kind == "region":
            moved = rotation @ self.vectors["point"] + translation
        else:
            moved = np.broadcast_to(self.vectors["point"], translation.shape)
            centre, cone = rotation @ self.vectors["origin"] + translation, rotation @ self.vectors["axis"]
        path: list[int] = []
        joint = self.joint
        while joint >= 0:
            path.append(joint)
            joint = joints[joint].parent
        # The joints in the order from the set outward: from the root, except for a target.
        order = path if self.kind == "target" else path[::-1]
        sign = -1.0 if self.kind == "target" else 1.0

        count, points = len(translation), bounds.theta.shape[1]
        change = np.zeros((count, points, 3))
        rest, rough, turned = np.zeros((3, count))
        for k in order:
            each, (w, p) = joints[k], bounds.axis(k)
            if self.kind == "direction":
                velocity = np.cross(w, moved) if each.revolute else np.zeros((count, 3))
            else:
                velocity = sign * (np.cross(w, moved - p) if each.revolute else w)
            share, radius = abs(each.multiplier), np.linalg.norm(velocity, axis=1)
            deviation = share * tolerance[each.leader]
            delta = share * bounds.half_width[:, each.leader] + deviation
            chord = 2.0 * np.sin(np.minimum(delta, pi) / 2.0) if each.revolute else delta
            bend = np.hypot(delta - np.sin(delta), 1.0 - np.cos(np.minimum(delta, pi))) if each.revolute else 0.0
            rest += radius * (bend + turned * chord + deviation)
            rough += radius * chord
            if each.revolute:
                turned = turned + chord
            change += each.multiplier * bounds.theta[:, :, each.leader, None] * velocity[:, None]
        change = np.where(bounds.single[:, None, None], change, 0.0)
        rest = np.where(bounds.single, rest, rough) + rounding
        image = np.asarray(moved - centre)[:, None] + change
        if cone is None:
            local = (image - self.translation) @ self.rotation
            far = np.linalg.norm(local - np.clip(local, self.low, self.high), axis=2)
            return np.asarray(far.max(axis=1) + rest)
        along = np.einsum("tkx,tx->tk", image, cone)
        angle = np.arctan2(np.linalg.norm(np.cross(image, cone[:, None]), axis=2), along).max(axis=1)
        shortest = along.min(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = np.arcsin(np.where(rest < shortest, rest / shortest, 1.0))
        return np.where(rest < shortest, angle + turn + rounding, np.inf)
