"""Decides whether a proof holds: every claim is derived again from the numbers in the file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from .interval_bounds import Constraint, IntervalBounds
from .parts import (
    LARGEST_PARAMETER,
    Array,
    Body,
    Curve,
    Indices,
    Joint,
    Refused,
    check_fields,
    index,
    items,
    member,
    number,
    numbers,
    optional_numbers,
    rows_of_names,
    shown,
    text,
)
from .rounding import ROOT_3, UP, Near, rotated

FORMAT, VERSION = "pinproof proof", 3

OUTSIDE = 0.5
"""A closed surface winds about a point by a whole number, which is 0 outside; its error is added before comparison."""

MOST_CELLS, MOST_STEPS = 1 << 24, 1 << 31
"""Largest number of cells that the parts of two meshes form, and of comparisons of a parameter with an interval."""

UNIT = 1e-3
"""Largest error of the length of a direction, which is rounded in the file and normalised here."""

FIELDS = ("format", "version", "made_by", "claim", "settings", "hashes", "robot", "curve", "limits", "joints", "bodies",
          "notes", "excluded", "intervals", "pairs", "constraints")  # fmt: skip


@dataclass(frozen=True, eq=False)
class ProofVerdict:
    """The result of re-checking a proof.

    Parameters
    ----------
    reasons
        What is wrong, each beginning with the place in the file; empty if the proof holds.
    clearance
        Metres, derived again: the distance of two checked bodies is larger everywhere in the tube around the curve. NaN
        if the proof does not hold, infinite if it has no pair.
    margin
        Required distance (m) of any two owners without an individual margin.
    margins
        (owner, owner, metres) of each individual margin.
    joint_tolerance, obstacle_tolerance
        (n,) rad or m by which joints may deviate, and metres by which obstacles may deviate.
    pairs, intervals
        Number of proven body pairs, and of the intervals of all pairs.
    excluded
        (owner, owner, reason): pairs that the proof does not cover; the reasons are the maker's own and not checked.
    constraints
        (name, proven largest error, tolerance, unit) of each constraint of the tcp, derived again; unit rad or m.
    limits
        The quantities whose joint limits the curve keeps: position, velocity, acceleration; empty if none are claimed.
    compared, not_compared
        What was compared with the caller's own files, and what was not, for which the proof file is trusted.
    """

    reasons: tuple[str, ...]
    clearance: float = np.nan
    margin: float = np.nan
    margins: tuple[tuple[str, str, float], ...] = ()
    joint_tolerance: tuple[float, ...] = ()
    obstacle_tolerance: float = 0.0
    pairs: int = 0
    intervals: int = 0
    excluded: tuple[tuple[str, str, str], ...] = ()
    constraints: tuple[tuple[str, float, float, str], ...] = ()
    limits: tuple[str, ...] = ()
    compared: tuple[str, ...] = ()
    not_compared: tuple[str, ...] = ("the robot", "the scene", "the motion")

    @property
    def ok(self) -> bool:
        """Whether the proof holds and matches everything with which it was compared."""
        return not self.reasons

    def __str__(self) -> str:
        if self.reasons:
            return f"REFUSED: {'; '.join(self.reasons)}"
        line = "HOLDS: no pair of bodies is checked"
        if self.pairs:
            distance = f"clearance of {self.clearance * 1e3:.6g} mm or more"
            line = f"HOLDS: {distance} between {self.pairs} body pairs, proven over {self.intervals} intervals"
        for name, largest, tolerance, unit in self.constraints:
            line += f"; {name}: error of {largest:.6g} {unit} or less, {tolerance:.6g} {unit} allowed"
        line += f"; within the limits of {', '.join(self.limits)}" if self.limits else "; joint limits are NOT claimed"
        if any(self.joint_tolerance):
            line += f"; joint tolerance {', '.join(f'{each:g}' for each in self.joint_tolerance)}"
        if self.obstacle_tolerance:
            line += f"; obstacle tolerance {self.obstacle_tolerance:g} m"
        if self.compared:
            line += f"; compared with your files: {', '.join(self.compared)}"
        if self.not_compared:
            line += f"; NOT compared with your files: {', '.join(self.not_compared)}"
        return line


def verify(document: Any, within: float = 0.0) -> ProofVerdict:
    """Return whether the proof in a parsed file holds; a malformed document is refused, and raises no exception.

    If it holds, it does so for all numbers of joints, bodies, constraints and control points that differ from those in
    the file by at most ``within``.
    """
    try:
        # Everything that the proof claims is derived again.
        proof = Proof(document, within)
        proof.check_complete()
        clearance, intervals = proof.check_pairs()
        constraints = proof.check_constraints()
        limits = proof.curve.check_limits(proof.limits)
    except Refused as refused:
        return ProofVerdict((str(refused),))
    except MemoryError:
        return ProofVerdict(("proof: does not fit into memory",))
    return ProofVerdict(
        reasons=(),
        clearance=clearance,
        margin=proof.margin,
        margins=tuple((a, b, margin) for a, b, margin in proof.margins),
        joint_tolerance=tuple(proof.tolerance.tolist()),
        obstacle_tolerance=proof.obstacle_tolerance,
        pairs=len(proof.pairs),
        intervals=intervals,
        excluded=tuple((a, b, reason) for a, b, reason in proof.excluded),
        constraints=constraints,
        limits=limits,
        not_compared=(*ProofVerdict.not_compared, *(("the constraints",) if constraints else ())),
    )


class Parts:
    """The convex parts of meshes that the evidence of a proof names; their numbers follow those of its bodies."""

    def __init__(self, bodies: Sequence[Body]) -> None:
        self._all = bodies
        self._number: dict[tuple[int, int, int], int] = {}
        self.bodies: list[Body] = []

    def numbers(self, i: int, ranges: Indices) -> Indices:
        """Return (R,) the numbers of parts of a mesh, given as ranges (R, 2) of its triangles; else that of body i."""
        if not self._all[i].is_mesh:
            return np.full(len(ranges), i)
        different, index_of = np.unique(ranges, axis=0, return_inverse=True)
        found = []
        for first, end in different.tolist():
            number = self._number.setdefault((i, first, end), len(self._all) + len(self.bodies))
            if number == len(self._all) + len(self.bodies):
                self.bodies.append(self._all[i].part(first, end))
            found.append(number)
        return np.array(found, dtype=np.int64)[index_of.reshape(-1)]


class Proof:
    """The parts of a proof file, the mapping of docs/formats/proof.md; raises Refused if one is malformed.

    Its bounds hold for all numbers that differ from those in the file by at most ``within``.
    """

    def __init__(self, document: Any, within: float = 0.0) -> None:
        version = member(document, "", "version")
        if member(document, "", "format") != FORMAT or type(version) is not int or version != VERSION:
            raise Refused(f"format: this verifier reads {FORMAT!r}, version {VERSION}")
        check_fields(document, "", FIELDS)
        self.document, self.within = document, (within := UP * within)  # a difference is rounded
        # The parts in the order in which others refer to them.
        self.curve = Curve(member(document, "", "curve"))
        if member(member(document, "", "hashes"), "hashes", "curve") != self.curve.sha256:
            raise Refused("hashes.curve: does not match the curve in the file")
        self.limits = self._read_limits(member(document, "", "limits"))
        self.joints = [Joint(row, k, self.curve.dof, within) for k, row in enumerate(items(document, "", "joints"))]
        self.bodies = [Body(row, i, len(self.joints), within) for i, row in enumerate(items(document, "", "bodies"))]
        # Names are unique, and all bodies of an owner move with the same joint.
        names: set[str] = set()
        self._owners: dict[str, Body] = {}
        for body in self.bodies:
            if body.name in names:
                raise Refused(f"{body.where}.name: another body is named {body.name} too")
            names.add(body.name)
            other = self._owners.setdefault(body.owner, body)
            if (other.joint, other.kind) != (body.joint, body.kind):
                raise Refused(f"{body.where}: the other bodies of {body.owner} have another joint or kind")
        self.excluded: list[tuple[str, str, str]] = []
        for k, (a, b, reason) in enumerate(rows_of_names(document, "", "excluded")):
            self.excluded.append((a, b, text({"reason": reason}, f"excluded[{k}]", "reason")))
            self._check_owners((a, b), f"excluded[{k}]")
        # Margins and tolerances; a pair of owners has at most one margin of its own.
        settings = member(document, "", "settings")
        check_fields(settings, "settings", ("margin", "margins", "joint_tolerance", "obstacle_tolerance"))
        self.tolerance = numbers(settings, "settings", "joint_tolerance", (self.curve.dof,))
        self.obstacle_tolerance = number(settings, "settings", "obstacle_tolerance")
        self.margin = number(settings, "settings", "margin")
        self.margins: list[tuple[str, str, float]] = []
        self._margin_of: dict[frozenset[str], float] = {}
        for k, row in enumerate(rows_of_names(settings, "settings", "margins")):
            where, owners = f"settings.margins[{k}]", frozenset(row[:2])
            self._check_owners(row, where)
            if owners in self._margin_of:
                raise Refused(f"{where}: {row[0]} and {row[1]} have a margin already")
            self._margin_of[owners] = number({"margin": row[2]}, where, "margin")
            self.margins.append((row[0], row[1], self._margin_of[owners]))
        if min([*self._margin_of.values(), *self.tolerance, self.obstacle_tolerance, self.margin]) < 0:
            raise Refused("settings: margins and tolerances must be 0 or more")
        self.pairs = items(document, "", "pairs")
        self.intervals = numbers(document, "", "intervals", (None, 2), LARGEST_PARAMETER)
        self._check_intervals(self.intervals, "intervals")
        rows = items(document, "", "constraints") if "constraints" in document else []
        self.constraints = [Constraint(row, k, len(self.joints), within) for k, row in enumerate(rows)]

    def _read_limits(self, row: Any) -> dict[str, tuple[Array, Array]]:
        """Return the lowest and highest position, velocity and acceleration (n,); nothing if no limits are claimed."""
        if row is None:
            return {}
        keys = ("lower", "upper", "velocity", "acceleration")
        check_fields(row, "limits", keys)
        lower, upper, velocity, acceleration = (
            optional_numbers(row, "limits", key, self.curve.dof, -np.inf if key == "lower" else np.inf) for key in keys
        )
        if not ((lower <= upper).all() and (velocity > 0).all() and (acceleration > 0).all()):
            raise Refused("limits: lower must not exceed upper, and velocity and acceleration must be above 0")
        ranges = ((lower, upper), (-velocity, velocity), (-acceleration, acceleration))
        return dict(zip(("position", "velocity", "acceleration"), ranges, strict=True))

    def _check_owners(self, row: Sequence[str], where: str) -> None:
        unknown = [name for name in row[:2] if name not in self._owners]
        if unknown:
            raise Refused(f"{where}: no body has the owner {shown(unknown[0])}")

    def members(self, k: int) -> tuple[int, int]:
        """Return the two bodies of pair k; an obstacle is the second."""
        where, pair = f"pairs[{k}].bodies", items(self.pairs[k], f"pairs[{k}]", "bodies")
        if len(pair) != 2:
            raise Refused(f"{where}: must be two bodies")
        i, j = (index(value, 0, len(self.bodies), where) for value in pair)
        a, b = self.bodies[i], self.bodies[j]
        if i == j or not a.bounded or not (b.bounded or b.half_space) or a.kind == "obstacle":
            raise Refused(f"{where}: {a.name} and {b.name} must be two bodies with a shape, an obstacle second")
        return i, j

    def margin_between(self, i: int, j: int) -> float:
        """Return the required distance (m) of two bodies, without the tolerance of obstacles."""
        return self._margin_of.get(frozenset((self.bodies[i].owner, self.bodies[j].owner)), self.margin)

    def tolerance_of(self, j: int) -> float:
        """Return the distance (m) by which body j may deviate from its placement."""
        return self.obstacle_tolerance if self.bodies[j].kind == "obstacle" else 0.0

    def required(self, i: int, j: int) -> float:
        """Return the distance (m) to be proven between two bodies: their margin plus the tolerance of an obstacle."""
        return math.nextafter(self.margin_between(i, j) + self.tolerance_of(j), math.inf)

    def joints_between(self, a: int, b: int) -> tuple[list[int], int]:
        """Return the joints on the path from joint a to joint b, and how many of them, from the first, are up."""
        up: list[int] = []
        down: list[int] = []
        while a != b:  # parents have smaller numbers
            if a > b:
                up.append(a)
                a = self.joints[a].parent
            else:
                down.append(b)
                b = self.joints[b].parent
        return [*up, *reversed(down)], len(up)

    def check_complete(self) -> None:
        """Refuse the proof if two bodies are neither checked nor excluded by their owners.

        Only pairs of obstacles, and of bodies of one owner, which are fixed to one joint, are exempt. A geometry may be
        checked on any of its levels, with all of its bodies of that level.
        """
        # The bodies of each level of each geometry of each owner.
        geometries: dict[str, dict[str, dict[int, list[int]]]] = {}
        for i, body in enumerate(self.bodies):
            levels = geometries.setdefault(body.owner, {}).setdefault(body.geometry, {})
            levels.setdefault(body.level, []).append(i)
        excluded = {frozenset((a, b)) for a, b, _ in self.excluded}
        checked = {frozenset(self.members(k)) for k in range(len(self.pairs))}
        owners = list(geometries)
        for number_of_a, a in enumerate(owners):
            for b in owners[number_of_a + 1 :]:
                if self._owners[a].kind == self._owners[b].kind == "obstacle" or frozenset((a, b)) in excluded:
                    continue
                for one, another in product(geometries[a].values(), geometries[b].values()):
                    levels_of_both = product(one.values(), another.values())
                    if not any(checked.issuperset(map(frozenset, product(*each))) for each in levels_of_both):
                        raise Refused(f"pairs: {a} and {b} are neither checked nor excluded")

    def check_pairs(self) -> tuple[float, int]:
        """Return the smallest proven distance (m) and the number of intervals; refuse a pair that is not proven."""
        least, count = np.inf, 0
        if self.pairs:
            # The intervals (R,) of all pairs with their directions (R, 3), and the two bodies, or parts of meshes, that
            # each direction separates (R, 2).
            bodies = [self.members(pair) for pair in range(len(self.pairs))]
            parts, known = Parts(self.bodies), set[bytes]()
            read = [self._read_pair(pair, parts, known) for pair in range(len(self.pairs))]
            rows, u, separated = (np.concatenate(columns) for columns in zip(*read, strict=True))
            k, count = np.repeat(np.arange(len(read)), [len(mine) for mine, _, _ in read]), len(rows)
            length = np.linalg.norm(u, axis=1)
            bad = k[~(np.abs(length - 1.0) <= UNIT)]
            if len(bad):
                raise Refused(f"{self._name_of(bad[0])}.directions: must be unit vectors")
            # The distance that the directions prove must be larger than the margin.
            bounds = IntervalBounds(self, self.intervals, parts.bodies)
            bound = bounds.distance(separated[:, 0], separated[:, 1], rows, u)
            required = np.array([self.required(*pair) for pair in bodies])[k]
            short = np.flatnonzero(~(bound > required))  # also true for NaN
            if len(short):
                row = short[0]
                interval = "[{:.9g}, {:.9g}]".format(*self.intervals[rows[row]])
                found = f"on {interval} a distance of {bound[row]:.9g} m is proven"
                raise Refused(f"{self._name_of(k[row])}: {found}; it must be larger than {required[row]:.9g} m")
            least = math.nextafter((bound - np.array([self.tolerance_of(b) for _, b in bodies])[k]).min(), -math.inf)
            self._check_outside(bodies)
        claim = member(self.document, "", "claim")
        check_fields(claim, "claim", ("status", "clearance"))
        if member(claim, "claim", "status") != "FREE":
            raise Refused(f"claim.status: must be FREE, not {shown(claim['status'])}")
        stated = member(claim, "claim", "clearance")
        claimed = np.inf if stated is None else number(claim, "claim", "clearance")
        if not claimed <= least:
            raise Refused(f"claim.clearance: {claimed:.17g} m is claimed, {least:.17g} m is proven")
        return least, count

    def _read_pair(self, k: int, parts: Parts, known: set[bytes]) -> tuple[Indices, Array, Indices]:
        """Return intervals (R,), directions (R, 3), and the two bodies or parts that each separates (R, 2).

        A pair is refused if they leave out a parameter of the curve, or a triangle of a mesh at some parameter. Many
        pairs of convex bodies have the same intervals; what is ``known`` to cover the curve is not compared again.
        """
        pair, where, members = self.pairs[k], self._name_of(k), self.members(k)
        check_fields(pair, where, ("bodies", "intervals", "directions", "parts"))
        listed, end = items(pair, where, "intervals"), len(self.intervals)
        rows = np.array([index(row, 0, end, f"{where}.intervals") for row in listed], dtype=np.int64)
        u = numbers(pair, where, "directions", (len(rows), 3))
        meshes = [i for i in members if self.bodies[i].is_mesh]
        if not meshes:
            if "parts" in pair:
                raise Refused(f"{where}.parts: must be missing, since both bodies are convex")
            if rows.tobytes() not in known:
                self._check_cover(self.intervals[rows], where)
                known.add(rows.tobytes())
            return rows, u, np.tile(members, (len(rows), 1))
        # The first triangle, and the one after the last, of each part of a mesh.
        stated = numbers(pair, where, "parts", (len(rows), 2 * len(meshes)), LARGEST_PARAMETER)
        stated = stated.reshape(len(rows), len(meshes), 2)
        count = np.array([self.bodies[i].pieces for i in meshes])
        first, after = stated[..., 0], stated[..., 1]
        if not ((stated % 1 == 0).all() and (first >= 0).all() and (first < after).all() and (after <= count).all()):
            raise Refused(f"{where}.parts: must be the first of some triangles, and the one after the last")
        column = dict(zip(meshes, np.moveaxis(stated.astype(np.int64), 1, 0), strict=True))
        whole = np.tile(np.array([0, 1]), (len(rows), 1))
        ranges = np.stack([column.get(i, whole) for i in members], axis=1)
        self._check_parts(self.intervals[rows], ranges, where, members)
        return rows, u, np.stack([parts.numbers(i, ranges[:, side]) for side, i in enumerate(members)], axis=1)

    def _check_parts(self, intervals: Array, ranges: Indices, where: str, members: tuple[int, int]) -> None:
        """Refuse intervals (R, 2) whose parts (R, 2, 2) of two bodies leave out a pair of triangles at some parameter.

        Between two consecutive ends of intervals, the parts that are apart are rectangles in the plane of the numbers
        of the triangles of both bodies. Each cell of this plane must be in one of them.
        """
        times = np.unique([self.curve.low, self.curve.high, *intervals.reshape(-1)])
        begins, ends = (times, times) if self.curve.single else (times[:-1], times[1:])
        if len(times) * len(intervals) > MOST_STEPS:
            raise Refused(f"{where}.parts: are too many")
        for begin, end in zip(begins, ends, strict=True):
            valid = ranges[(intervals[:, 0] <= begin) & (intervals[:, 1] >= end)]
            if not len(valid):
                raise Refused(f"{where}: nothing is proven between the parameters {begin:.17g} and {end:.17g}")
            lines = [
                np.unique([0, self.bodies[i].pieces, *valid[:, side].reshape(-1)]) for side, i in enumerate(members)
            ]
            if len(lines[0]) * len(lines[1]) > MOST_CELLS:
                raise Refused(f"{where}.parts: are too many")
            # How many rectangles begin or end at each corner of a cell, and from their sums, how many contain it.
            number = np.zeros((len(lines[0]), len(lines[1])), dtype=np.int64)
            at = [np.searchsorted(line, valid[:, side]) for side, line in enumerate(lines)]
            for one, other in product((0, 1), (0, 1)):
                np.add.at(number, (at[0][:, one], at[1][:, other]), 1 if one == other else -1)
            missing = np.argwhere(number.cumsum(axis=0).cumsum(axis=1)[:-1, :-1] < 1)
            if len(missing):
                a, b = (int(line[cell]) for line, cell in zip(lines, missing[0], strict=True))
                stated = f"triangle {a} of {self.bodies[members[0]].name} and {b} of {self.bodies[members[1]].name}"
                raise Refused(f"{where}.parts: leave out {stated} at the parameter {begin:.17g}")

    def _check_outside(self, pairs: Sequence[tuple[int, int]]) -> None:
        """Refuse a body of a pair that is inside the mesh of the other at the start of the curve.

        Their surfaces are apart on the whole curve, so that a part that begins outside stays outside.
        """
        start = IntervalBounds(self, np.array([[self.curve.low, self.curve.low]]))
        for outer, inner in {*pairs, *((j, i) for i, j in pairs)}:
            mesh, other = self.bodies[outer], self.bodies[inner]
            if not mesh.solid:
                continue
            (turn, shift), (other_turn, other_shift) = (
                (rotation[0], translation[0]) for rotation, translation in map(start.placed, (mesh.joint, other.joint))
            )
            corners = ROOT_3 * self.within
            points = rotated(other.rotation, Near(other.witnesses, corners)) + other.translation
            points = rotated(turn, rotated(other_turn, points) + other_shift - shift, back=True) - mesh.translation
            points = rotated(mesh.rotation, points, back=True)
            for point in points.value:
                number, error = mesh.winding(point, points.error + corners)
                if not abs(number) + error < OUTSIDE:
                    raise Refused(f"{other.where}: a part of {other.name} is inside {mesh.name}, or in its surface")

    def _name_of(self, k: int) -> str:
        i, j = self.members(k)
        return f"pairs[{k}] ({self.bodies[i].name} and {self.bodies[j].name})"

    def errors_of(self, constraint: Constraint, intervals: Array) -> Array:
        """Return (T,) upper bounds (rad or m) of the error of a constraint on intervals (T, 2)."""
        return constraint.errors(IntervalBounds(self, intervals), self.joints, self.tolerance)

    def check_constraints(self) -> tuple[tuple[str, float, float, str], ...]:
        """Return name, proven largest error, tolerance and unit of each constraint; refuse one that is not proven."""
        found = []
        for each in self.constraints:
            self._check_intervals(each.intervals, f"{each.where}.intervals")
            self._check_cover(each.intervals, each.where)
            errors = self.errors_of(each, each.intervals)
            bad = np.flatnonzero(~(errors <= each.largest))  # also true for NaN
            if len(bad):
                interval = "[{:.9g}, {:.9g}]".format(*each.intervals[bad[0]])
                stated = f"{each.largest:.17g} {each.unit} is claimed"
                raise Refused(f"{each.where}: on {interval} an error of {errors[bad[0]]:.9g} is not excluded; {stated}")
            found.append((each.name, float(errors.max()), each.tolerance, each.unit))
        return tuple(found)

    def _check_intervals(self, intervals: Array, where: str) -> None:
        """Refuse intervals (T, 2) without a length or outside the curve."""
        start, end = intervals.T
        outside = ~((start >= self.curve.low) & (end <= self.curve.high))
        wrong = np.flatnonzero(outside | ~((start <= end) if self.curve.single else (start < end)))
        if len(wrong):
            raise Refused(f"{where}[{wrong[0]}]: must have a length and lie on the curve")

    def _check_cover(self, intervals: Array, where: str) -> None:
        """Refuse intervals (R, 2) that do not cover the whole curve."""
        rows = intervals[np.argsort(intervals[:, 0], kind="stable")]
        reached = np.concatenate([[self.curve.low], np.maximum.accumulate(rows[:, 1])])
        begins = np.append(rows[:, 0], self.curve.high)
        gaps = np.flatnonzero(begins > reached)
        if len(gaps) or not len(rows):
            start, end = (reached[gaps[0]], begins[gaps[0]]) if len(gaps) else (self.curve.low, self.curve.high)
            raise Refused(f"{where}: nothing is proven between the parameters {start:.17g} and {end:.17g}")
