"""Certification of a motion in a changed scene: only pairs of bodies that changed are proven again.

The evidence of a certificate is kept for each pair. It remains a proof of a pair if both bodies are the same (geometry,
and placement on its link or in the scene), the kinematics of the robot are the same, and the margin is not larger. All
other pairs of the new checker, those of moved and added obstacles, are proven as in :func:`pinproof.certify`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pinproof.collision.certificates.certificate import Certificate, ProofLimits, setup_of
from pinproof.collision.certificates.certify import TOLERANCES, KnownPairs, certify, prove_rest, with_limits
from pinproof.collision.certificates.proof_file import EVIDENCE_DISTANCE, EVIDENCE_PAIR, final_evidence
from pinproof.collision.checking.checker import CollisionChecker
from pinproof.collision.geometry.bodies import Body
from pinproof.errors import InputError
from pinproof.motion import check_limits
from pinproof.spatial import Array


def setup_differences(before: CollisionChecker, after: CollisionChecker) -> list[str]:
    """List, in sentences, what differs between two checkers except for their scenes."""
    one, other = before.group, after.group
    found = []
    if one.robot.urdf.kinematics != other.robot.urdf.kinematics:
        found.append(f"the robot: {one.robot.name!r} and {other.robot.name!r} have different kinematics")
    if one.joint_names != other.joint_names or dict(one.ends) != dict(other.ends):
        found.append(f"the arm: {_ends(before)} and {_ends(after)}")
    held = [name for name, value in other.held.items() if one.held.get(name) != value]
    if held or len(one.held) != len(other.held):
        found.append(f"the positions of held joints: {', '.join(held) or 'other joints are held'}")
    # Attached objects and links are compared by name and content, in order.
    tools = [{each.name: each for each in checker.attached} for checker in (before, after)]
    unlike = sorted(tools[0].keys() ^ tools[1].keys())
    mine, theirs = ([body for body in each.bodies if body.link is not None] for each in (before, after))
    changed = sorted({a.owner for a, b in zip(mine, theirs, strict=False) if not _same(a, b)})
    if unlike or len(mine) != len(theirs) or changed:
        names = ", ".join(dict.fromkeys((*unlike, *changed))) or "other bodies"
        found.append(f"the attached objects or the geometry of the links: {names}")
    if before.margin != after.margin:
        found.append(f"the margin: {before.margin * 1e3:.9g} mm and {after.margin * 1e3:.9g} mm")
    return found


class SetupChange:
    """The pairs that two checkers with different scenes have in common, and the other pairs.

    Motions were proven for ``before`` and are to be proven for ``after``. InputError if the robot, its attached
    objects, its held joints or the margin differ, or an array of ``after`` was modified in place.
    """

    def __init__(self, before: CollisionChecker, after: CollisionChecker) -> None:
        if differences := setup_differences(before, after):
            raise InputError(
                f"a proof cannot be reused for another setup; different are {'; '.join(differences)}. Certify the "
                "motion for the new checker instead"
            )
        after._refuse_changes()
        self.before, self.after = before, after
        # The unchanged pairs of both checkers that a joint moves, as indices in each. Those that no joint moves are
        # checked once for each checker, and not for each motion.
        index = {body.name: i for i, body in enumerate(before.bodies)}
        same: dict[int, int] = {}  # bodies of `after` and `before`
        for j, body in enumerate(after.bodies):
            i = index.get(body.name)
            if i is not None and _same(before.bodies[i], body):
                same[j] = i
        numbers = {pair: k for k, pair in enumerate(before.pairs)}
        still, kept = set(after.still_pairs.tolist()), []
        for k, (i, j) in enumerate(after.pairs):
            old = numbers.get((same.get(i, -1), same.get(j, -1)))
            if old is not None and k not in still and before.margins[old] >= after.margins[k]:
                kept.append((old, k))
        self.kept_before = np.array([k for k, _ in kept], dtype=np.int64)
        self.kept_after = np.array([k for _, k in kept], dtype=np.int64)
        self.rest = after.without_pairs(self.kept_after.tolist())
        self._rest_pairs = np.setdiff1d(np.arange(len(after.pairs)), self.kept_after)
        self._setup = setup_of(after)
        self._moved = np.array([after.bodies[after.pairs[k][1]].link is None for k in self.kept_after], dtype=bool)
        self._required = after.margins[self.kept_after] + max(after.rounding - before.rounding, 0.0)

    @property
    def changed(self) -> int:
        """The number of moving pairs that must be proven again."""
        return len(self.rest.pairs) - len(self.rest.still_pairs)

    def known(self, proof: StoredProof) -> KnownPairs | None:
        """Return what a proof for ``before`` shows about ``after``; None if not all kept pairs are proven."""
        lowest = proof.lowest[self.kept_before]
        obstacles = proof.obstacle_tolerance
        spare = lowest - self._required - obstacles * self._moved
        if not (spare > 0.0).all():  # also for NaN: not proven on the whole curve
            return None
        # The allowance for rounding grows with the extent of the scene.
        more = max(self.after.rounding - self.before.rounding, 0.0)

        def evidence_with(rest: Array) -> Array:
            # The pairs of the kept evidence and of the rest are renumbered.
            renumbered = np.full(len(self.before.pairs), -1)
            renumbered[self.kept_before] = self.kept_after
            kept, rest = proof.leaves.copy(), rest.copy()
            kept[:, EVIDENCE_PAIR] = renumbered[kept[:, EVIDENCE_PAIR].astype(int)]
            rest[:, EVIDENCE_PAIR] = self._rest_pairs[rest[:, EVIDENCE_PAIR].astype(int)]
            return np.concatenate([kept[kept[:, EVIDENCE_PAIR] >= 0], rest])

        return KnownPairs(
            rest=self.rest,
            proven=float((lowest - obstacles * self._moved).min(initial=np.inf)) - more,
            joint_tube=max(proof.joint_tube - more, 0.0) if more else proof.joint_tube,
            obstacle_tube=max(proof.obstacle_tube - more, 0.0),
            identity=(proof.certificate.curve, self._setup),
            evidence_with=evidence_with,
        )


class StoredProof:
    """A certificate with its evidence sorted by pairs, for use in other scenes.

    InputError if the certificate is not FREE, has no evidence (``record=True``), or allows pairs to touch
    (``parting``).
    """

    def __init__(self, certificate: Certificate) -> None:
        if not certificate.free or certificate.tube is None:
            raise InputError(f"only a FREE certificate can be reused; this one is {certificate.status.name}")
        if certificate.partings:
            raise InputError("a certificate with pairs that may touch at the start cannot be reused")
        self.certificate = certificate
        evidence, self.curve, self.checker = certificate.recorded("reuse")
        self.joint_tolerance: Array = certificate.tube.joints
        self.obstacle_tolerance = certificate.tube.obstacles
        self.joint_tube, self.obstacle_tube = certificate.tube.largest_joints, certificate.tube.largest_obstacles
        # The smallest proven distance (P,) of each pair; NaN if its intervals do not cover the curve.
        rows = self.leaves = final_evidence(evidence)
        self.lowest = np.full(len(self.checker.pairs), np.nan)
        if not len(rows):
            return
        (first, last), pair = self.curve.domain, rows[:, EVIDENCE_PAIR]
        starts = np.flatnonzero(np.diff(pair, prepend=-1.0))
        ends = np.append(starts[1:], len(rows)) - 1
        gaps = np.zeros(len(rows), dtype=int)
        gaps[1:] = rows[1:, 0] > rows[:-1, 1]
        gaps[starts] = 0
        covered = (np.add.reduceat(gaps, starts) == 0) & (rows[starts, 0] <= first) & (rows[ends, 1] >= last)
        distances = np.minimum.reduceat(rows[:, EVIDENCE_DISTANCE], starts)
        self.lowest[pair[starts].astype(int)[covered]] = distances[covered]

    def certify(
        self, change: SetupChange, *, tolerance: float | None = None, max_intervals: int = 200_000, record: bool = False
    ) -> Certificate:
        """Return the certificate of the same curve for ``change.after``; arguments as :func:`pinproof.certify`.

        InputError if the proof is not for ``change.before``.
        """
        if change.before is not self.checker:
            raise InputError("the change begins at another checker than that of the proof")
        known, old = change.known(self), self.certificate
        # The limits of the arm are those of the new checker; others were stated for this motion.
        limits = None if old.limits is None else old.limits.limits
        if limits is self.checker.group.limits:
            limits = change.after.group.limits
        tolerances = TOLERANCES if tolerance is None else (tolerance,)
        if known is None:
            return certify(
                self.curve,
                change.after,
                tolerance=tolerance,
                max_intervals=max_intervals,
                joint_tolerance=self.joint_tolerance,
                obstacle_tolerance=self.obstacle_tolerance,
                constraints=[each.constraint for each in old.constraints],
                limits=limits,
                record=record,
            )
        fresh = prove_rest(
            self.curve,
            change.after,
            known,
            ProofLimits(tolerances, max_intervals, self.joint_tolerance, self.obstacle_tolerance, record),
        )
        if old.constraints:  # they do not depend on the scene
            message = "; ".join((fresh.message, *map(str, old.constraints))) if fresh.free else fresh.message
            fresh = replace(fresh, message=message, constraints=old.constraints)
        return with_limits(fresh, None if limits is None else check_limits(self.curve, limits))


def _ends(checker: CollisionChecker) -> str:
    return ", ".join(f"{base} to {tcp}" for base, tcp in checker.group.ends.values())


def _same(a: Body, b: Body) -> bool:
    return a is b or (a.name == b.name and a.content() == b.content())
