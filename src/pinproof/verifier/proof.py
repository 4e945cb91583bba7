"""Whether a proof holds: what is in the file is re-derived, nothing it concludes is believed."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from .reading import FORMAT, VERSION, Body, Curve, Joint, Refused, index, items, member, number, numbers, words
from .stretches import Stretches

__all__ = ["Proof", "ProofVerdict", "verify"]

Array = npt.NDArray[np.float64]

ROUNDING = 1e-9
"""Metres by which floating point may be off, for each metre the bodies and the arm are wide: far more than it is."""

UNIT = 1e-3
"""How far the length of a direction may be from 1: it is rounded in the file, and scaled to 1 here."""


@dataclass(frozen=True, eq=False)
class ProofVerdict:
    """What re-checking a proof found.

    Parameters
    ----------
    reasons
        What is wrong, each beginning with the place; none if the proof holds.
    clearance
        Metres, re-derived: no two checked bodies come nearer than this anywhere in the tube. NaN if it does not hold.
    margin
        Metres that were asked for between any two bodies without a margin of their own.
    margins
        (owner, owner, metres) of those with one.
    joint_tolerance, obstacle_tolerance
        (n,) rad or m that joints, and metres that obstacles, may be off by.
    pairs, intervals
        How many pairs of bodies are settled, and in how many intervals altogether.
    excluded
        (owner, owner, reason): what the proof does not speak of, by the word of its maker.
    compared, not_compared
        What was compared with files of who verifies, and what was not: there the proof's own word stands.
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
    compared: tuple[str, ...] = ()
    not_compared: tuple[str, ...] = ("the robot", "the scene", "the motion")

    @property
    def ok(self) -> bool:
        """Whether the proof holds, and is of what it was compared with."""
        return not self.reasons

    def __str__(self) -> str:
        if self.reasons:
            return f"REFUSED: {'; '.join(self.reasons)}"
        told = f"HOLDS: {self.clearance * 1e3:.6g} mm stay between {self.pairs} pairs, in {self.intervals} intervals"
        if any(self.joint_tolerance):
            told += f"; joints off by up to {', '.join(f'{each:g}' for each in self.joint_tolerance)}"
        if self.obstacle_tolerance:
            told += f"; obstacles by up to {self.obstacle_tolerance:g} m"
        if self.compared:
            told += f"; compared: {', '.join(self.compared)}"
        if self.not_compared:
            told += f"; NOT compared with files of yours: {', '.join(self.not_compared)}"
        return told


def verify(document: Any) -> ProofVerdict:
    """Whether the proof in a parsed file holds; what does not make sense is a reason against it, not an error."""
    try:
        proof = Proof(document)
        proof.check_complete()
        clearance, intervals = proof.check_pairs()
    except Refused as refused:
        return ProofVerdict((str(refused),))
    return ProofVerdict(
        reasons=(),
        clearance=clearance,
        margin=proof.margin,
        margins=tuple((a, b, m) for a, b, m in proof.margins),
        joint_tolerance=tuple(proof.tolerance.tolist()),
        obstacle_tolerance=proof.moved,
        pairs=len(proof.pairs),
        intervals=intervals,
        excluded=tuple((a, b, reason) for a, b, reason in proof.excluded),
    )


class Proof:
    """A file whose parts make sense, each by itself.

    Parameters
    ----------
    document
        The mapping of docs/certificates.md; raises :class:`Refused`, with the place, where it is none.
    """

    def __init__(self, document: Any) -> None:
        if member(document, "", "format") != FORMAT or member(document, "", "version") != VERSION:
            raise Refused(f"format: this verifier reads {FORMAT!r}, version {VERSION}")
        self.document = document
        self.curve = Curve(member(document, "", "curve"))
        if member(member(document, "", "hashes"), "hashes", "curve") != self.curve.sha256:
            raise Refused("hashes.curve: is not that of the curve in the file")
        self.joints = [Joint(row, k, self.curve.dof) for k, row in enumerate(items(document, "", "joints"))]
        self.bodies = [Body(row, i, len(self.joints)) for i, row in enumerate(items(document, "", "bodies"))]
        settings = member(document, "", "settings")
        self.tolerance = numbers(settings, "settings", "joint_tolerance", (self.curve.dof,))
        self.moved, self.margin = (number(settings, "settings", key) for key in ("obstacle_tolerance", "margin"))
        self.margins = words(settings, "settings", "margins", 3)
        single = [number({"margin": margin}, "settings.margins", "margin") for *_, margin in self.margins]
        if min([*single, *self.tolerance, self.moved, self.margin]) < 0:
            raise Refused("settings: margins and tolerances are 0 or more")
        self._single = {frozenset(row[:2]): margin for row, margin in zip(self.margins, single, strict=True)}
        self.excluded = words(document, "", "excluded", 3)
        self.pairs = items(document, "", "pairs")
        self.intervals = numbers(document, "", "intervals", (None, 2), largest=np.inf)
        start, end = self.intervals.T if len(self.intervals) else (np.zeros(0), np.zeros(0))
        point = self.curve.low == self.curve.high
        wrong = (start < self.curve.low) | (end > self.curve.high) | ((start > end) if point else (start >= end))
        if wrong.any():
            raise Refused(f"intervals[{int(np.flatnonzero(wrong)[0])}]: has no length, or leaves the curve")
        ended = [body for body in self.bodies if body.convex]
        widest = max((np.linalg.norm(b.translation) + np.linalg.norm(b.centre) + b.ball for b in ended), default=0.0)
        chain = sum(float(np.linalg.norm(joint.translation)) for joint in self.joints)
        self.rounding = ROUNDING * max(1.0, float(widest) + chain)

    def members(self, k: int) -> tuple[int, int]:
        """The two bodies of pair k; an obstacle is the second."""
        where, pair = f"pairs[{k}].bodies", items(self.pairs[k], f"pairs[{k}]", "bodies")
        if len(pair) != 2 or pair[0] == pair[1]:
            raise Refused(f"{where}: are not two bodies")
        i, j = (index(value, 0, len(self.bodies), where) for value in pair)
        a, b = self.bodies[i], self.bodies[j]
        if not a.convex or not (b.convex or b.half_space) or a.kind == "obstacle":
            raise Refused(f"{where}: {a.name} and {b.name}: one has no convex shape, or an obstacle comes first")
        return i, j

    def margin_of(self, i: int, j: int) -> float:
        """Metres to stay between two bodies: those asked for, and what an obstacle may be moved by."""
        asked = self._single.get(frozenset((self.bodies[i].owner, self.bodies[j].owner)), self.margin)
        return asked + self.moved_of(j)

    def moved_of(self, j: int) -> float:
        """Metres by which body j may stand elsewhere."""
        return self.moved if self.bodies[j].kind == "obstacle" else 0.0

    def way(self, i: int, j: int) -> tuple[list[int], int]:
        """The joints from body i to body j, and how many of them carry i."""
        up: list[int] = []
        down: list[int] = []
        a, b = self.bodies[i].joint, self.bodies[j].joint
        while a != b:  # parents have smaller numbers
            if a > b:
                up.append(a)
                a = self.joints[a].parent
            else:
                down.append(b)
                b = self.joints[b].parent
        return [*up, *reversed(down)], len(up)

    def check_complete(self) -> None:
        """That any two bodies are checked, or their owners listed as excluded; raises Refused where a pair is missing.

        Left aside are only obstacles among themselves, and bodies of one owner, which hang on one joint. A geometry may
        be met on any one of its levels, by all of its bodies there.
        """
        forms: dict[str, dict[str, dict[int, list[int]]]] = {}
        first: dict[str, Body] = {}
        for i, body in enumerate(self.bodies):
            other = first.setdefault(body.owner, body)
            if (other.joint, other.kind) != (body.joint, body.kind):
                raise Refused(f"{body.where}: hangs elsewhere than the other bodies of {body.owner}")
            levels = forms.setdefault(body.owner, {}).setdefault(body.geometry, {})
            levels.setdefault(body.level, []).append(i)
        unknown = {name for row in self.excluded for name in row[:2]} - set(forms)
        if unknown:
            raise Refused(f"excluded: {', '.join(sorted(unknown))}: no body of that name")
        excluded = {frozenset(row[:2]) for row in self.excluded}
        checked = {frozenset(self.members(k)) for k in range(len(self.pairs))}
        owners = list(forms)
        for number_of_a, a in enumerate(owners):
            for b in owners[number_of_a + 1 :]:
                if first[a].kind == first[b].kind == "obstacle" or frozenset((a, b)) in excluded:
                    continue
                for one, another in product(forms[a].values(), forms[b].values()):
                    ways = product(one.values(), another.values())
                    if not any(checked.issuperset(map(frozenset, product(*way))) for way in ways):
                        raise Refused(f"pairs: {a} and {b} are neither checked nor excluded")

    def check_pairs(self) -> tuple[float, int]:
        """The least distance shown (m) and the number of intervals; raises Refused where a pair is not settled."""
        least, count = np.inf, 0
        stretches: Stretches | None = None
        for k, pair in enumerate(self.pairs):
            i, j = self.members(k)
            where = f"pairs[{k}] ({self.bodies[i].name} and {self.bodies[j].name})"
            stated, end = items(pair, where, "intervals"), len(self.intervals)
            rows = np.array([index(row, 0, end, f"{where}.intervals") for row in stated], dtype=np.int64)
            self._check_cover(self.intervals[rows], where)
            u = numbers(pair, where, "directions", (len(rows), 3))
            length = np.linalg.norm(u, axis=1)
            if not (np.abs(length - 1.0) <= UNIT).all():
                raise Refused(f"{where}.directions: not all are unit vectors")
            stretches = stretches or Stretches(self, self.intervals)
            bound, margin = stretches.bound(i, j, rows, u / length[:, None]), self.margin_of(i, j)
            short = np.flatnonzero(~(bound > margin))  # written so that NaN is short
            if len(short):
                interval = "[{:.6g}, {:.6g}]".format(*self.intervals[rows[short[0]]])
                shown = f"on {interval} {bound[short[0]]:.6g} m are shown to stay between them"
                raise Refused(f"{where}: {shown}, not more than {margin:.6g} m")
            least, count = min(least, float(bound.min()) - self.moved_of(j)), count + len(rows)
        claim = member(self.document, "", "claim")
        stated = member(claim, "claim", "clearance")
        claimed = np.inf if stated is None else number(claim, "claim", "clearance")
        if not claimed <= least:
            raise Refused(f"claim.clearance: {claimed} m is claimed, {least} m is shown")
        return least, count

    def _check_cover(self, intervals: Array, where: str) -> None:
        """That intervals (R, 2) leave out nothing of the curve."""
        rows = intervals[np.argsort(intervals[:, 0], kind="stable")]
        reached = np.concatenate([[self.curve.low], np.maximum.accumulate(rows[:, 1])])
        begins = np.append(rows[:, 0], self.curve.high)
        gaps = np.flatnonzero(begins > reached)
        if len(gaps) or not len(rows):
            start, end = (reached[gaps[0]], begins[gaps[0]]) if len(gaps) else (self.curve.low, self.curve.high)
            raise Refused(f"{where}: nothing is shown of [{start:.6g}, {end:.6g}]")
