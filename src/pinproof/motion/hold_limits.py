"""Limits of a motion by the grip on a carried part: contact patches, and the loads that they transmit by friction.

docs/holding.md states the model, its sources and its limits. The core (``src/core/dynamics/grip``) computes the share
of a load, and bounds it over each complete piece of a motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof._core import Grip, GripContact
from pinproof.common.results import Shown, View, Written
from pinproof.common.structs import Accepting, described, key, struct
from pinproof.common.validation import require_positive
from pinproof.errors import InputError, SlipError
from pinproof.model import GRAVITY, JointGroup, Payload, carried_tree
from pinproof.motion.limits import LIMIT_TOLERANCE
from pinproof.motion.rate_limits import controls_of
from pinproof.motion.trajectory import Trajectory
from pinproof.spatial import SE3, Array, finite

CELLS = 16
"""A patch of more than CELLS^2 points is divided into so many cells along each side, each of which presses at its
centre. By the triangle inequality, this transmits less than the patch: by 0.4 % of tilting moments for a square."""


@described(eq=False)
class ContactPatch:
    """A patch on which a finger or a suction cup presses on a part.

    The pressure is linear over the patch: uniform if the normal force acts at its centre. At every point the friction
    is at most ``friction`` times the pressure.
    """

    points: Accepting[Array, npt.ArrayLike] = key(
        "(N, 3) points of the patch in the frame of the tcp, of which each represents the same area", "m"
    )
    normal: Accepting[Array, npt.ArrayLike] = key(
        "(3,) direction in which the hand presses on the part; it is normalised"
    )
    force: float = key("largest normal force, or of a suction cup the pull-off force", "N")
    friction: float = key("coefficient of friction")
    pulls: bool = key(
        "whether it is a suction cup, which pulls the part with the constant force and is pressed against it with the "
        "part of the force that the load leaves",
        default=False,
    )

    def __post_init__(self) -> None:
        points = finite("the points of a contact patch", self.points, (None, 3))
        normal = finite("the normal of a contact patch", self.normal, (3,))
        if not len(points) or not normal.any():
            raise InputError("a contact patch needs at least one point and a normal that is not zero")
        require_positive("the force of a contact patch (N)", self.force)
        require_positive("the friction of a contact patch", self.friction)
        for name, array in (("points", points), ("normal", normal / np.linalg.norm(normal))):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def placed(self, a_from_b: SE3) -> ContactPatch:
        """The same patch, which is stated in the frame of b, in that of a."""
        points = self.points @ a_from_b.rotation.T + a_from_b.translation
        return replace(self, points=points, normal=a_from_b.rotation @ self.normal)

    def compiled(self, a_from_tcp: SE3) -> GripContact:
        """The patch in another frame for the core: the centres of its cells, and distributions of the normal force."""
        from scipy.spatial import ConvexHull

        # Plane coordinates along the principal axes of the patch, relative to its extent
        centre = self.points.mean(axis=0)
        flat = self.points - centre
        flat = flat - np.outer(flat @ self.normal, self.normal)
        axes = np.linalg.svd(flat, full_matrices=False)[2][:2] if len(flat) > 1 else np.eye(3)[:2]
        plane = flat @ axes.T
        plane /= np.maximum(np.ptp(plane, axis=0), np.finfo(float).tiny)
        # Points that are few are kept; others are joined to cells
        cells = np.arange(len(plane))
        if len(plane) > CELLS**2:
            steps = ((plane - plane.min(axis=0)) * CELLS).astype(int).clip(0, CELLS - 1)
            cells = np.unique(steps @ (CELLS, 1), return_inverse=True)[1].ravel()
        counts = np.bincount(cells)
        own, place = (
            np.stack([np.bincount(cells, values) for values in rows.T], axis=1) / counts[:, None]
            for rows in (self.points, plane)
        )
        # The uniform pressure, and those that decrease linearly to zero at one side of the hull of the points: their
        # convex combinations are all linear pressures that are positive within the polygon
        is_area = np.linalg.matrix_rank(plane) == 2
        sides = ConvexHull(plane).equations[:, :2].T if is_area else np.array([[1.0, -1.0], [0.0, 0.0]])
        reach = (plane @ sides).max(axis=0)
        lean = np.divide(place @ sides, reach, out=np.zeros((len(place), len(reach))), where=reach > 0.0)
        lean = np.column_stack([np.zeros(len(place)), lean])
        shares = ((1.0 - lean).clip(0.0) * (counts / counts.sum())[:, None]).T
        own = own @ a_from_tcp.rotation.T + a_from_tcp.translation
        return GripContact(
            own.ravel(), np.ascontiguousarray(shares).ravel(), a_from_tcp.rotation @ self.normal, self.force,
            self.friction, self.pulls,
        )  # fmt: skip


@struct("hold", written=True)
class HoldPeak(Written):
    """The load that needs the largest share of what a grip transmits during a motion."""

    share: float = key("upper bound of the share, which holds between samples; above 1 the part may slip", minimum=0)
    time: float = key("when a load within a relative 1e-3 of the bound occurs, from the start of the motion", "s")
    force: float = key("force on the part then, for its acceleration and against gravity", "N", minimum=0)
    moment: float = key("moment on the part then, about the centre of the contacts", "N m", minimum=0)
    slower: float | None = key(
        "factor of the duration with which the grip is proven to hold; null if it holds, or slips even at rest",
        default=None,
    )

    @property
    def holds(self) -> bool:
        """Whether the grip transmits every load of the motion."""
        return self.share <= 1.0

    @property
    def reserve(self) -> float:
        """The share that is not used; negative if the part slips."""
        return 1.0 - self.share

    @property
    def words(self) -> str:
        """The load and what the grip transmits of it, such as ``14 N and 0.2 N m of 11 N and 0.16 N m``."""
        most = max(self.share, np.finfo(float).tiny)
        load, limit = ((self.force / by, self.moment / by) for by in (1.0, most))
        return " of ".join(f"{force:.3g} N and {moment:.2g} N m" for force, moment in (load, limit))

    def __str__(self) -> str:
        if self.holds:
            return f"holds with a reserve of {100.0 * self.reserve:.0f} %, least at {self.time:.2f} s"
        slower = "" if self.slower is None else f"; it is held in {self.slower:.10g} times the duration"
        return f"slips at {self.time:.2f} s: {self.words}{slower}"


class HoldLimits(Shown):
    """Limits of a motion by the grip on a carried part, a :class:`~pinproof.motion.RateConstraint`.

    At every instant, contact forces within the friction cones must give the part its acceleration and carry its weight.
    Of several hands that hold one part, the contacts of all of them share the load.

    Parameters
    ----------
    arm
        The arm, or a joint group whose arms hold the part together.
    part
        Mass, centre of mass and inertia of the part, in the frame of the tcp; of a group, its ``frame`` is the tcp of
        one of the arms, which moves the part.
    contacts
        The contact patches of all hands, in the frame of this tcp.
    gravity
        (3,) acceleration of free fall in m/s^2, in the root link.

    Raises
    ------
    InputError
        If the arm does not move the tcp, a group has several and the part names none of them, or the contacts do not
        resist loads in every direction.
    """

    name = "grip"

    def __init__(
        self, arm: JointGroup, part: Payload, contacts: Sequence[ContactPatch], *, gravity: npt.ArrayLike = GRAVITY
    ) -> None:
        self.arm, self.part, self.contacts = arm, part, tuple(contacts)
        self.gravity = finite("gravity", gravity, (3,))
        self.gravity.setflags(write=False)
        if not self.contacts:
            raise InputError("a grip needs at least one contact patch")
        self._tree, self._joint_from_tcp = carried_tree(arm, part, self.gravity)
        self._tcp = part.frame or arm.tcp_of(None)
        self._centre = np.mean([contact.points.mean(axis=0) for contact in self.contacts], axis=0)
        self._grip = Grip([contact.compiled(self._joint_from_tcp) for contact in self.contacts])
        if not self._grip.complete:
            raise InputError("the contacts do not resist forces and moments in every direction; the part would slip")

    def coefficients(self, q: Array, slope: Array, curvature: Array) -> tuple[Array, Array, Array, Array]:
        """Chords of the set of s'' and s'^2 with which the grip holds the part, at points of a path.

        Raises
        ------
        SlipError
            If the part slips at rest; the message states the load and the configuration.
        """
        q, slope, curvature = (np.ascontiguousarray(array) for array in (q, slope, curvature))
        along, across, below, at_rest = self._grip.sections(self._tree, q, slope, curvature)
        if not (at_rest < 1.0).all():
            raise self._slip_at_rest(q[[np.argmax(at_rest)]])
        return along, across, 0.5 * (below - 1.0), 0.5 * (below + 1.0)

    def excess(self, trajectory: Trajectory) -> Array:
        """(k,) for each piece, a proven upper bound of the factor by which its duration must be multiplied.

        Raises
        ------
        SlipError
            If the part slips at rest at a configuration of the motion.
        """
        stretch = np.asarray(self._grip.stretch(self._tree, *controls_of(self.arm, trajectory)))
        stuck = np.flatnonzero(np.isinf(stretch))
        if len(stuck):
            knots = trajectory.bezier().knots
            inside = np.linspace(knots[stuck[0]], knots[stuck[0] + 1], 65).clip(knots[0], knots[-1])
            raise self._slip_at_rest(trajectory(inside))
        return stretch

    def peak(self, trajectory: Trajectory) -> HoldPeak:
        """The largest share of what the grip transmits during a motion, as a bound that holds between samples."""
        bound, piece, fraction = self._grip.peak(self._tree, *controls_of(self.arm, trajectory))
        knots = trajectory.bezier().knots
        time = float(knots[piece] + fraction * (knots[piece + 1] - knots[piece]))
        slower: float | None = None
        if bound > 1.0:
            with suppress(SlipError):  # it slips even at rest
                stretch = float(self.excess(trajectory).max())
                if stretch <= 1.0 + LIMIT_TOLERANCE:  # which is a proof that it holds
                    bound = 1.0
                else:
                    slower = math.ceil(1e3 * stretch) / 1e3
        # on this piece, because the acceleration may jump at its ends
        state = (trajectory.bezier(order).on(np.array([piece]), np.array([fraction])) for order in range(3))
        force, moment = self._tree.loads(*(np.ascontiguousarray(row) for row in state))[0].sum(axis=0).reshape(2, 3)
        about = np.linalg.norm(moment - np.cross(self._joint_from_tcp.act(self._centre), force))
        return HoldPeak(bound, time, float(np.linalg.norm(force)), float(about), slower)

    def exceeded(self, trajectory: Trajectory) -> list[str]:
        """A sentence with the largest load."""
        return [f"the part {self.peak(trajectory)}"]

    def at_rest(self, root_from_tcp: SE3) -> HoldPeak:
        """The load while the tcp rests at a pose."""
        force = -self.part.mass * root_from_tcp.rotation.T @ self.gravity
        moment = np.cross(self.part.center_of_mass, force)
        about = np.linalg.norm(moment - np.cross(self._centre, force))
        share = float(self.shares([[*force, *moment]])[0])
        return HoldPeak(share, 0.0, float(np.linalg.norm(force)), float(about))

    def shares(self, wrenches: npt.ArrayLike) -> Array:
        """(N,) upper bounds of the shares of what the grip transmits that given loads need, within a relative 2e-4.

        ``wrenches`` (N, 6) are the forces (N) and the moments (N m) about the tcp that the hand exerts on the part, in
        the axes of the tcp.
        """
        force, moment = np.split(finite("wrenches", wrenches, (None, 6)), 2, axis=1)
        rotation, offset = self._joint_from_tcp.rotation, self._joint_from_tcp.translation
        force, moment = force @ rotation.T, moment @ rotation.T
        return np.asarray(self._grip.shares(np.hstack([force, moment + np.cross(offset, force)])))

    def _slip_at_rest(self, q: Array) -> SlipError:
        """The error for the configuration, of several (N, n), at which the part slips most."""
        rests = [self.at_rest(self.arm.root_from_frame(row, self._tcp)) for row in q]
        worst = int(np.argmax([rest.share for rest in rests]))
        return SlipError(f"the part slips at rest at q = {np.round(q[worst], 4).tolist()}: {rests[worst].words}")

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(HoldLimits, gravity=self.gravity), (self.arm, self.part, self.contacts)

    def _view(self) -> View:
        lines = [
            f"{'pulls' if each.pulls else 'presses'} with {each.force:g} N, friction {each.friction:g}"
            for each in self.contacts
        ]
        return View(f"{self.part}, {len(lines)} contacts", [lines], lines)
