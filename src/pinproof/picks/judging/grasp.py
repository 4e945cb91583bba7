"""The stages at the grasp: reach, limits, self-collision, grasp (collision with the scene) and grip.

Every IK solution of every grasp of the family is checked. Those that pass all stages are ranked. If none passes, it is
tried to prove that every configuration is excluded, with the reason for each IK branch: where all IK solutions are
known, each is excluded by its contacts. For arms whose solutions are curves, shapes inside the bodies that collide at
the configurations found are given to the proof that a pose is out of reach: it excludes the joint values at which the
pose is not reached, and those at which two of the shapes overlap.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from pinproof.collision import Body, CheckResult, CollisionChecker, Contact, inner_shapes
from pinproof.common.steps import step
from pinproof.description import moved_by
from pinproof.errors import InputError
from pinproof.ik import AnalyticIk, BodyOverlap, Clik, ReachProof, is_provable, prove_unreachable
from pinproof.model import Arm
from pinproof.motion import least_times
from pinproof.picks.input.pick import Member
from pinproof.picks.input.settings import PickWeights
from pinproof.picks.judging.configurations import STARTS, along_families, configurations, limit_margin, turned_inside
from pinproof.picks.judging.hold import PROVEN, normals_agree
from pinproof.picks.judging.task import PickTask, at_rest
from pinproof.picks.judging.verdict import REFUTATION, Stage, StageResult
from pinproof.spatial import SE3, Array, twist_size

NO_SOLUTION = "no IK solution within the limits reaches"

Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]


class Reached(NamedTuple):
    """Configurations q (k, n) at the grasp within the limits, and the index of the grasp of each, ``member`` (k,).

    ``stages`` are the results of the stages reach and limits. If there is no configuration, and this is proven,
    ``refuted`` has a reason for each IK branch.
    """

    q: Array
    member: Indices
    stages: tuple[StageResult, ...]
    refuted: tuple[str, ...] = ()


@step(Stage.REACH.value)
def reach(task: PickTask, members: list[Member], seed: int) -> Reached:
    """The configurations at each of the given grasps; without any, the reason is either the limits or the reach."""
    # All configurations within the limits, by the closed form, along curves of solutions, or by a search
    arm, home, limits = task.arm, task.cell.home, task.arm.limits
    targets = [task.target(task.grasp(member)) for member in members]
    many = task.targets([task.grasp(member) for member in members])
    row, q = configurations(arm, many, home, seed)
    if not len(q) and not task.cell.closed_form:
        row, q = along_families(arm, many, home)
    if not len(q) and not task.cell.closed_form:  # the nearest configuration may still converge to the target
        nearest = Clik().solve(arm, targets[0], home, rng=seed)
        if nearest.ok:
            row, q = np.zeros(1, dtype=np.int64), np.array([nearest.q])
    if len(q):
        return _reached(task, members, targets, row, q)

    # Without the limits, are there configurations at any of the grasps?
    nothing = np.empty((0, arm.dof)), np.empty(0, dtype=np.int64)
    row, free = configurations(task.cell.wide_arm, many, home, seed)
    inside = [turned_inside(arm, each) for each in free]
    complete = every_branch_is_known(task, targets)
    proven = not complete and proven_unreachable(arm, targets)
    if not inside:
        complete = proven or (complete and every_branch_is_known(task, targets, task.cell.wide_arm))
        starts = "" if task.cell.closed_form else f" (best of {STARTS} starts)"
        failed = out_of_reach(task, Stage.REACH, targets[0], seed, "out of reach", f"the target{starts}")
        reasons = (f"{member.head}no IK solution reaches the pose" for member in members if complete)
        return Reached(*nothing, (failed,), tuple(reasons))
    by = [float(np.abs(each - limits.clip(each)).sum()) for each in inside]
    best = int(np.argmin(by))
    if by[best] == 0.0:  # found by the search only with the wider limits
        return _reached(task, members, targets, row[[best]], np.array([inside[best]]))

    # Only the limits are in the way: the reason describes the configuration that exceeds them least
    beyond = np.abs(inside[best] - limits.clip(inside[best]))
    outside = "; ".join(limits.violations(inside[best], arm.joint_names))
    outside += f" ({', '.join(f'{arm.joint_names[j]} by {beyond[j]:.3g}' for j in np.flatnonzero(beyond))})"
    count = {"configurations": float(len(inside))}
    reached = StageResult(Stage.REACH, True, "reachable if the joint limits are ignored", count)
    message = f"reachable only outside the joint limits: {outside}"
    failed = StageResult(Stage.LIMITS, False, message, {"outside": by[best], **count})
    refuted: tuple[str, ...] = ()
    if proven:  # the configurations outside the limits are a sample
        refuted = tuple(f"{member.head}{NO_SOLUTION} the grasp" for member in members)
    elif complete:
        violated = ("; ".join(limits.violations(each, arm.joint_names)) for each in inside)
        refuted = tuple(members[i].head + words for i, words in zip(row, violated, strict=True))
    return Reached(*nothing, (reached, failed), refuted)


def _reached(task: PickTask, members: list[Member], targets: list[SE3], row: Indices, q: Array) -> Reached:
    """The result with configurations."""
    pairs = zip(row[:8], q[:8], strict=True) if task.cell.trial is None else ()  # the error of a trial is not shown
    off = max((twist_size(targets[i], task.arm.forward_kinematics(each))[0] for i, each in pairs), default=0.0)
    spread = f" for {len(members)} grasps" if len(members) > 1 else ""
    message = f"{len(q)} IK solution{'' if len(q) == 1 else 's'}{spread}, position error {off:.1e} m"
    figures = {"configurations": float(len(q)), "grasps": float(len(members)), "position_error": off}
    widest = {"widest_margin": float(limit_margin(task.arm, q).max())}
    limits = StageResult(Stage.LIMITS, True, "within all limits", widest)
    return Reached(q, row, (StageResult(Stage.REACH, True, message, figures), limits))


def reach_between(task: PickTask, members: list[Member], reached: Reached) -> Reached | None:
    """The configurations along the curves of IK solutions at the first grasps; None if all are in contact.

    An arm of seven joints has more configurations than those known for some values of the redundant joint. Grasps at
    which a body at the tcp collides are omitted, because every configuration collides there.
    """
    known = [reached.q[reached.member == i] for i in range(len(members))]
    rest = [i for i, q in enumerate(known) if not len(q) or not contacts_everywhere(task.at_grasp, q[0])]
    targets = [task.target(task.grasp(member)) for member in members]
    row, q = along_families(task.arm, task.targets([task.grasp(members[i]) for i in rest]), task.cell.home)
    if not task.at_grasp.is_free_batch(q).any():
        return None
    return _reached(task, members, targets, np.array(rest, dtype=np.int64)[row], q)


def every_branch_is_known(task: PickTask, targets: list[SE3], arm: Arm | None = None) -> bool:
    """Whether the closed form is proven to give every configuration for each target."""
    if not task.cell.closed_form:
        return False
    branches = (AnalyticIk().solve_all(arm or task.arm, target, task.cell.home) for target in targets)
    return all(found.complete and not found.families for found in branches)


def proven_unreachable(arm: Arm, targets: list[SE3]) -> bool:
    """Whether every target is proven to be out of reach, which needs no closed form."""
    return is_provable(arm) and all(prove_unreachable(arm, target, search=False).proven for target in targets)


def every_branch(task: PickTask, root_from_tip: SE3, wanted: bool = True) -> Array:
    """(m, n) all configurations at a pose; empty if not all are known, or if they are not wanted."""
    if not wanted or not every_branch_is_known(task, [task.target(root_from_tip)]):
        return np.empty((0, task.arm.dof))
    return configurations(task.arm, task.targets([root_from_tip]), task.cell.home, 0)[1]


SMALL = 0.05
"""mm and deg: errors below are stated with two digits, so that none appears as zero."""


def out_of_reach(task: PickTask, stage: Stage, target: SE3, seed: int, what: str, where: str) -> StageResult:
    """The failure at a target ``base_from_tcp``, with the error of the nearest configuration found."""
    nearest = Clik().solve(task.arm, target, task.cell.home, rng=seed)
    off = nearest.position_error * 1e3, float(np.degrees(nearest.orientation_error))
    error = "{} mm and {} deg".format(*(f"{each:.1f}" if each >= SMALL or not each else f"{each:.2g}" for each in off))
    figures = {"position_error": nearest.position_error, "orientation_error": nearest.orientation_error}
    message = f"{what}: the nearest configuration found is {error} from {where}"
    return StageResult(stage, False, message, figures)


# -- grip -------------------------------------------------------------------------------------------------------------

MOST_CONTACTS = 6
"""Largest number of contacts in a reason."""


class Gripped(NamedTuple):
    """The result of the grip stage, and whether each configuration holds the object while the hand can close.

    ``refuted`` states why a configuration is excluded; the text is empty for those that are ``kept`` (k,).
    """

    kept: Mask
    result: StageResult
    refuted: tuple[str, ...]


@step(Stage.GRIP.value)
def judge_grip(task: PickTask, members: list[Member], q: Array, of: Indices) -> Gripped:
    """Judge collision-free configurations q (k, n) at the grasp; ``of`` (k,) is the member of each."""
    if task.name is None:
        message = "not checked: the pick states no object"
        return Gripped(np.ones(len(q), dtype=bool), StageResult(Stage.GRIP, True, message), ("",) * len(q))

    def gripped(kept: Mask, message: str, figures: dict[str, float]) -> Gripped:
        return Gripped(kept, StageResult(Stage.GRIP, bool(kept.any()), message, figures), tuple(refuted))

    # Does the closed hand hold the part? That does not depend on the configuration
    grips = [task.grip(members[i]) for i in of]
    refuted = ["" if grip.held else members[i].head + grip.message for i, grip in zip(of, grips, strict=True)]
    kept = np.array([grip.held for grip in grips])
    if not kept.any():
        tried = sorted(set(of.tolist()))
        best = task.grip(members[tried[0]])
        more = f"; none of the {len(tried)} grasps holds the part" if len(tried) > 1 else ""
        return gripped(kept, best.message + more, best.figures)
    if not task.cell.fingers:
        grip = grips[int(np.flatnonzero(kept)[0])]
        return gripped(kept, grip.message, grip.figures)

    # Are the fingers free of everything else while they close?
    closing, closes = [task.closing(members[i]) for i in of], kept.copy()
    for checker in dict.fromkeys(closing):
        own = kept & np.array([each is checker for each in closing])
        closes[own] = checker.is_free_batch(q[own])
    found = {int(i): closing[i].check(q[i]) for i in np.flatnonzero(kept & ~closes)}
    for i, contact in found.items():
        refuted[i] = members[of[i]].head + closing_words(task, members[of[i]], contact)
    if not closes.any():
        depths = {i: [c.distance for c in result.contacts] for i, result in found.items()}
        worst = max(found, key=lambda i: min(depths[i], default=-np.inf))
        more = f"; all {len(found)} IK solutions collide" if len(found) > 1 else ""
        distance = {"distance": min(depths[worst], default=np.nan)}
        return gripped(closes, closing_words(task, members[of[worst]], found[worst]) + more, distance)
    first = int(np.flatnonzero(closes)[0])
    clear = closing[first].clearance(q[first])
    message = f"{grips[first].message}; {clear * 1e3:.1f} mm clearance while closing"
    return gripped(closes, message, {**grips[first].figures, "closing_clearance": clear})


def closing_words(task: PickTask, member: Member, result: CheckResult) -> str:
    """The contacts of the fingers while they close or open, each pair once, the deepest first."""
    finger_of = {body.name: name for name, bodies in task.closed(member).swept.items() for body in bodies}
    by_pair: dict[frozenset[str], str] = {}
    for contact in result.contacts:
        first, second = (finger_of.get(name, name) for name in contact.bodies)
        by_pair.setdefault(frozenset((first, second)), _contact_text(replace(contact, bodies=(first, second))))
    return f"while the fingers move: {_first_of(list(by_pair.values()))}"


def _first_of(contacts: list[str]) -> str:
    """The first :data:`MOST_CONTACTS` contacts as one text."""
    more = f"; and {len(contacts) - MOST_CONTACTS} more" if len(contacts) > MOST_CONTACTS else ""
    return "; ".join(contacts[:MOST_CONTACTS]) + more


# -- contacts and rank ------------------------------------------------------------------------------------------------

AMPLE = 0.05
"""Metres: the clearance beyond which the score does not increase."""

INSTANT = 0.1
"""Seconds that are added to durations before they are compared, so that small differences have little weight."""

RANKED = 256
"""Largest number of ranked configurations; of more, those with the shortest time from home are ranked."""


@dataclass(frozen=True, eq=False)
class GraspCandidate:
    """A collision-free configuration at the grasp; its manipulability is relative to the best one, 0 to 1."""

    q: Array
    member: Member
    clearance: float
    manipulability: float


class PickCheck(Protocol):
    """A check of one's own: any function of a pick in its cell and of a configuration at its grasp.

    It is called after all other stages at the grasp, for the best configurations first. For workers in other processes
    it must be importable by name.
    """

    def __call__(self, task: PickTask, candidate: GraspCandidate, /) -> str | None:
        """Why the configuration fails, in words; None if it passes."""


class Screened(NamedTuple):
    """The configurations that are collision-free and hold the object, the best first, and the results of the stages.

    Without any, ``refuted`` states why each configuration is excluded, and ``not_held`` whether no grasp holds the
    object, which does not depend on the configuration.
    """

    candidates: tuple[GraspCandidate, ...]
    stages: tuple[StageResult, ...]
    refuted: tuple[str, ...] = ()
    not_held: bool = False


@step(Stage.GRASP.value)
def screen(task: PickTask, members: list[Member], reached: Reached) -> Screened:
    """Judge all configurations at the grasp."""
    checker = task.at_grasp
    free = checker.is_free_batch(reached.q)
    if not free.any():
        return _all_in_contact(checker, members, reached)

    def in_contact() -> tuple[str, ...]:
        """Why each of the configurations in contact is excluded."""
        rows = np.flatnonzero(~free)
        checks = zip(rows, [checker.check(reached.q[k]) for k in rows], strict=True)
        return tuple(members[reached.member[k]].head + "; ".join(contact_words(check)) for k, check in checks)

    # Torque limits exclude configurations that cannot hold the part at rest
    own = StageResult(Stage.SELF, True, "no self-collision")
    count = f"{int(free.sum())} of {len(free)} IK solution{'' if len(free) == 1 else 's'} collision-free"
    reasons = at_rest(task, [members[i] for i in reached.member[free]], reached.q[free])
    if all(reasons):
        failed = StageResult(Stage.GRASP, False, f"{reasons[0]}; {count}, and torque limits exclude all of them")
        return Screened((), (own, failed), (*reasons, *in_contact()))
    if any(reasons):
        count += f", {sum(map(bool, reasons))} of them excluded by torque limits"
        free[np.flatnonzero(free)[[bool(reason) for reason in reasons]]] = False

    # Of the others, those that hold the part are ranked
    q, of_member = reached.q[free], reached.member[free]
    gripped = judge_grip(task, members, q, of_member)
    if not gripped.kept.any():
        stages = (own, StageResult(Stage.GRASP, True, count, {"free": float(free.sum())}), gripped.result)
        grips = [] if task.name is None else [task.grip(member) for member in members]
        if grips and not any(grip.held for grip in grips):
            proven = all(grip.proven for grip in grips)
            refuted = (member.head + grip.message for member, grip in zip(members, grips, strict=True) if proven)
            return Screened((), stages, tuple(refuted), True)
        return Screened((), stages, (*gripped.refuted, *in_contact()))
    # The grip must carry the part at rest, before and after any motion
    slips = [task.slip_at_rest(member) for member in members]
    carries = np.array([not slips[i][0] for i in of_member]) & gripped.kept
    if not carries.any():
        stages = (own, StageResult(Stage.GRASP, True, count, {"free": float(free.sum())}), gripped.result)
        slip, share = slips[of_member[int(np.flatnonzero(gripped.kept)[0])]]
        failed = StageResult(Stage.HOLD, False, slip, {"reserve": 1.0 - share})
        reasons = []
        for member, (slip, share) in zip(members, slips, strict=True):
            grip = task.grip(member)
            reason = (
                slip if share > PROVEN and normals_agree(grip) else "" if grip.held or not grip.proven else grip.message
            )
            reasons += [member.head + reason] if reason else []
        complete = len(reasons) == len(members)
        return Screened((), (*stages, failed), tuple(reasons) if complete else (), True)
    # The best are planned first
    kept = np.flatnonzero(carries)
    candidates = rank(task, q[kept], [members[i] for i in of_member[kept]])
    clearance = max(candidate.clearance for candidate in candidates)
    figures = {"free": float(free.sum()), "clearance": clearance}
    grasp = StageResult(Stage.GRASP, True, f"{count}, clearance up to {clearance * 1e3:.1f} mm", figures)
    stages = (own, grasp, gripped.result)
    if not task.cell.shared.checks:
        return Screened(tuple(candidates), stages)
    # The checks of the user, each of which may exclude candidates
    reasons = [_own_reason(task, candidate) for candidate in candidates]
    passed = tuple(each for each, reason in zip(candidates, reasons, strict=True) if not reason)
    names = ", ".join(check.__qualname__ for check in task.cell.shared.checks)
    result = f"{names}: {len(passed)} of {len(candidates)} configurations pass"
    message = result if passed else f"{reasons[0]}; none of {len(candidates)} configurations passes {names}"
    return Screened(passed, (*stages, StageResult(Stage.CHECK, bool(passed), message)))


def _own_reason(task: PickTask, candidate: GraspCandidate) -> str:
    """The first reason of a check of the user, or an empty text."""
    for check in task.cell.shared.checks:
        reason = check(task, candidate)
        if reason is not None and not isinstance(reason, str):
            raise InputError(
                f"the check {check.__qualname__} must return a reason as text, or None if the candidate passes, not "
                f"{reason!r:.80}"
            )
        if reason:
            return f"{check.__qualname__}: {reason}"
    return ""


def _all_in_contact(checker: CollisionChecker, members: list[Member], reached: Reached) -> Screened:
    """The result if every IK solution is in contact; the reason describes the one with the smallest penetration."""
    found = [checker.check(q) for q in reached.q]
    own = [[c for c in check.contacts if not any(name in checker.scene for name in c.bodies)] for check in found]
    texts = ["; ".join(contact_words(check)) for check in found]
    refuted = tuple(members[i].head + text for i, text in zip(reached.member, texts, strict=True))
    stage = Stage.SELF if all(own) else Stage.GRASP
    # if some have no self-collision, the reason describes one of these
    eligible = [i for i in range(len(found)) if stage is Stage.SELF or not own[i]]
    best = max(eligible, key=lambda i: min((c.distance for c in found[i].contacts), default=-np.inf))
    message = _first_of(contact_words(found[best]))
    if len(found) > 1:
        # the most frequent pairs that the described solution does not have in contact
        counts: Counter[tuple[str, str]] = Counter()
        for check in found:
            counts.update({contact.bodies for contact in check.contacts})
        for contact in found[best].contacts:
            counts.pop(contact.bodies, None)
        common = sorted(counts.items(), key=lambda item: (-item[1], item[0]))[:3]
        others = ", ".join(f"{first} with {second} in {count}" for (first, second), count in common)
        message += f"; all {len(found)} IK solutions collide{f' ({others})' if others else ''}"
    figures = {"configurations": float(len(found)), "distance": min(c.distance for c in found[best].contacts)}
    failed = StageResult(stage, False, message, figures)
    if stage is Stage.SELF:
        return Screened((), (failed,), refuted)
    passed = StageResult(Stage.SELF, True, f"{len(eligible)} of {len(found)} IK solutions without self-collision")
    return Screened((), (passed, failed), refuted)


def rank(task: PickTask, q: Array, members: list[Member]) -> list[GraspCandidate]:
    """The collision-free configurations q (k, n), ordered by score with the weights of the cell."""
    arm, home = task.arm, task.cell.home
    seconds = least_times(q - home, arm.limits, full_speed=True)
    if len(q) > RANKED:
        near = np.sort(np.argsort(seconds, kind="stable")[:RANKED])
        q, members, seconds = q[near], [members[i] for i in near], seconds[near]
    clearance, volume = task.at_grasp.clearance_batch(q), arm.manipulability_batch(q)
    volume = volume / max(volume.max(), np.finfo(float).tiny)
    parts = score_parts(task.cell.weights, seconds.min(), clearance, limit_margin(arm, q), volume, seconds)
    order = np.argsort(-parts["score"], kind="stable").tolist()
    return [GraspCandidate(q[i], members[i], float(clearance[i]), float(volume[i])) for i in order]


def score_parts(
    weights: PickWeights,
    least: float,
    clearance: Array | float,
    limit_margin: Array | float,
    manipulability: Array | float,
    seconds: Array | float,
) -> dict[str, Array]:
    """The four parts of a score, from 0 to 1, and their weighted sum as ``score``.

    ``least`` is a lower bound (s) of all durations.
    """
    parts = {
        "clearance": np.clip(clearance, 0.0, AMPLE) / AMPLE,
        "limit_margin": np.asarray(limit_margin),
        "manipulability": np.asarray(manipulability),
        "duration": np.asarray((least + INSTANT) / (np.asarray(seconds) + INSTANT)),
    }
    return {**parts, "score": np.asarray(sum(getattr(weights, name) * part for name, part in parts.items()))}


def contact_words(result: CheckResult) -> list[str]:
    """The deepest contact of each pair of links, attached bodies and obstacles as text, the deepest pair first."""
    deepest = {contact.bodies: contact for contact in reversed(result.contacts)}
    return [_contact_text(contact) for contact in result.contacts if deepest[contact.bodies] is contact]


def _contact_text(contact: Contact) -> str:
    """A contact with its penetration depth, or with its distance if only the margin is violated."""
    first, second = contact.bodies
    if contact.distance < 0:
        return f"{first} penetrates {second} by {-contact.distance * 1e3:.1f} mm"
    return f"{first} is {contact.distance * 1e3:.1f} mm from {second}, less than the margin"


SPREAD = 1e-5
"""Metres: more than the bodies at the tcp move relative to obstacles between IK solutions for the same target, which
agree to 1e-6 m and rad."""


def contacts_everywhere(checker: CollisionChecker, q: Array) -> list[str]:
    """The contacts at q (n,) that exist at every configuration with the same pose of the tcp, the deepest first.

    They are penetrations, by more than solutions differ, of bodies that no joint moves relative to the tcp.
    """
    # Overlap of convex hulls is no proof of contact.
    found = checker.with_margin(0.0, {}).exact_at(q).lasting_contacts(q, SPREAD)
    arm, rigid = checker.arm, {thing.name for thing in checker.attached}

    def exists_everywhere(contact: Contact) -> bool:
        moving = [name for name in contact.bodies if name not in checker.scene]
        if len(moving) != 1:
            return False
        return moving[0] in rigid or moving_joint(arm, moving[0]) == moving_joint(arm, arm.tcp)

    return contact_words(replace(found, contacts=tuple(filter(exists_everywhere, found.contacts))))


def moving_joint(arm: Arm, link: str) -> str:
    """The last of the joints between the root and a link that move with the arm; empty if the link does not move.

    Links with the same joint are rigidly connected.
    """
    return moved_by(arm.robot.urdf, link, (*arm.joint_names, *arm.followers))


# -- proofs that every configuration is excluded -----------------------------------------------------------------------

BOXES = 3000
"""Largest number of boxes of a proof; each takes 10 to 40 microseconds."""

EXAMINED = 12
"""Number of configurations whose contacts are used."""


def prove_blocked(checker: CollisionChecker, target: SE3, q: Array) -> ReachProof | None:
    """Try to prove that every configuration at a target ``base_from_tcp`` is in collision; None if it is not proven.

    The contacts at the known configurations q (k, n), all in collision, show which bodies may block. Only penetration
    counts, not the margin.
    """
    arm = checker.arm
    if not is_provable(arm) or not len(q) or checker.is_free_batch(q).any():
        return None
    # The bodies that penetrate each other at some of the configurations
    bare = checker.with_margin(0.0, {})
    pairs: dict[tuple[str, str], tuple[Body, Body]] = {}
    for each in q[:: max(len(q) // EXAMINED, 1)]:
        exact = bare.exact_at(each)  # overlap of convex hulls is no proof of contact
        for k in exact.pairs_in_contact(each):
            first, second = (exact.bodies[i] for i in exact.pairs[k])
            pairs.setdefault((first.name, second.name), (first, second))
    # Shapes inside them, on two different links of the chain
    base_from_links, overlaps = _chain_at(arm, arm.home), list[BodyOverlap]()
    for first, second in pairs.values():
        on = _carrier(arm, base_from_links, first), _carrier(arm, base_from_links, second)
        if on[0] is not None and on[1] is not None and on[0][0] != on[1][0]:
            overlaps += _overlaps((first, second), (on[0], on[1]))
    if not overlaps:
        return None
    proof = prove_unreachable(arm, target, search=False, budget=BOXES, overlaps=overlaps)
    return proof if proof.proven else None


def _chain_at(arm: Arm, q: Array) -> list[Array]:
    """The poses (4, 4) of the links of the chain in the base, link k behind joint k; link 0 is the base."""
    poses = [np.eye(4)]
    for joint, value in zip(arm.chain.joints, q, strict=True):
        motion = np.eye(4)
        if joint.prismatic:
            motion[2, 3] = value
        else:
            motion[:2, :2] = [[np.cos(value), -np.sin(value)], [np.sin(value), np.cos(value)]]
        poses.append(poses[-1] @ joint.before @ motion)
    return poses


def _carrier(arm: Arm, base_from_links: list[Array], body: Body) -> tuple[int, Array] | None:
    """The number of the link that carries a body, and link_from_body; None if a mimic joint moves the body."""
    if body.link is None:
        return 0, (arm.root_from_base.inverse() * body.link_from_body).homogeneous
    joint = moving_joint(arm, body.link)
    if joint and joint not in arm.joint_names:
        return None
    number = arm.joint_names.index(joint) + 1 if joint else 0
    base_from_body = (arm.frame_placement(arm.home, body.link) * body.link_from_body).homogeneous
    return number, np.linalg.inv(base_from_links[number]) @ base_from_body


def _overlaps(bodies: tuple[Body, Body], on: tuple[tuple[int, Array], tuple[int, Array]]) -> Iterator[BodyOverlap]:
    """The overlaps of the balls of each body with the box of the other one or, if neither has a box, with its balls."""
    shapes, owners = (inner_shapes(bodies[0]), inner_shapes(bodies[1])), (bodies[0].owner, bodies[1].owner)
    for mine, other in ((0, 1), (1, 0)):
        (link, link_from_body), (other_link, other_from_body) = on[mine], on[other]
        own, there, boxes, balls = shapes[mine], shapes[other], [], [*shapes[mine].balls]
        if there.box_half is not None:
            boxes = [(there.box_centre, there.box_half, there.box_radius)]
            balls += [*np.append(own.corners, np.zeros((len(own.corners), 1)), axis=1)]
        elif own.box_half is None and mine == 0:
            boxes = [(ball[:3], np.zeros(3), float(ball[3])) for ball in there.balls]
        for ball in balls:
            centre = link_from_body[:3, :3] @ ball[:3] + link_from_body[:3, 3]
            for at, half, radius in boxes:
                pose = other_from_body.copy()
                pose[:3, 3] = other_from_body[:3, :3] @ at + other_from_body[:3, 3]
                names, size = (owners[mine], owners[other]), float(ball[3])
                yield BodyOverlap(names, link, centre, size, other_link, pose, half, radius)


# -- reasons ----------------------------------------------------------------------------------------------------------

LINE_DEVIATION = 1e-3, 1e-2
"""Metres and rad: the deviation of the tcp from the pose on a straight line that :func:`plan_linear` permits."""

BETWEEN = (0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875)
"""Shares of a line at which its poses are tested."""

BETWEEN_BOXES = 100
"""Largest number of boxes of each of these proofs, a few milliseconds."""


def _refuted(members: list[Member], reasons_of: Callable[[Member], list[str]]) -> tuple[str, ...]:
    """The reasons that exclude each grasp; empty if there are none for one of them."""
    reasons: list[str] = []
    for member in members:
        if not (found := reasons_of(member)):
            return ()
        reasons += [member.head + words for words in found]
    return tuple(reasons)


@step(REFUTATION)
def reasons_against_every_branch(task: PickTask, members: list[Member], seed: int) -> tuple[str, ...]:
    """Why each IK branch of each grasp is excluded, at the grasp or at the end of a line; empty if one is not.

    A line that could not be planned proves nothing. A grasp is refuted if no branch reaches an end of its lines or a
    pose on them, or if every branch is in contact at an end.
    """
    pick, (position, orientation) = task.pick, LINE_DEVIATION

    def reasons_of(member: Member) -> list[str]:
        # Every branch is out of reach or in contact at an end of a line
        grasp = task.grasp(member)
        found = _branches_refuted(task, grasp, task.at_grasp, "the grasp", seed)
        if not found and pick.approach:
            found = _branches_refuted(task, pick.before(grasp), task.at_grasp, "the end of the approach", seed)
        if not found and pick.retreat:
            found = _branches_refuted(task, pick.after(grasp), task.carrying(member), "the end of the retreat", seed)
        if found or not is_provable(task.arm):
            return found
        # A pose on a line may be out of reach, by more than lines may deviate
        lines = (pick.approach, pick.before, "approach"), (pick.retreat, pick.after, "retreat")
        for length, pose_at, name in lines:
            for share in BETWEEN if length else ():
                proof = prove_unreachable(
                    task.arm,
                    task.target(pose_at(grasp, share)),
                    position_tolerance=position,
                    orientation_tolerance=orientation,
                    budget=BETWEEN_BOXES,
                    search=False,
                )
                if proof.proven:
                    return [f"{NO_SOLUTION} the {name} {share * length * 1e3:.0f} mm from the grasp"]
        return []

    return _refuted(members, reasons_of)


@step(REFUTATION)
def reasons_at_release(task: PickTask, members: list[Member], seed: int) -> tuple[str, ...]:
    """Why each IK branch at the release of each grasp is excluded; empty if one is not."""
    if task.place is None:
        return ()
    return _refuted(
        members,
        lambda member: _branches_refuted(task, task.release(member), task.letting_go(member), "the release", seed),
    )


@step(REFUTATION)
def reasons_by_contact(task: PickTask, members: list[Member], reached: Reached) -> tuple[str, ...]:
    """Why no configuration of an arm with unknown further IK solutions is free at any grasp; empty if not proven."""

    def reasons_of(member: Member) -> list[str]:
        known = reached.q[reached.member == members.index(member)]
        if not len(known) and proven_unreachable(task.arm, [task.target(task.grasp(member))]):
            return [f"{NO_SOLUTION} the grasp"]
        words = _contacts_of_all(task, task.grasp(member), task.at_grasp, known)
        return [f"{words}, for every IK solution"] if words else []

    return _refuted(members, reasons_of)


def _branches_refuted(
    task: PickTask, root_from_tip: SE3, checker: CollisionChecker, where: str, seed: int
) -> list[str]:
    """Why each IK branch at a pose is excluded; empty if one is not, or if not all are known."""
    _, many = configurations(task.arm, task.targets([root_from_tip]), task.cell.home, seed)
    if checker.is_free_batch(many).any():
        return []
    if not every_branch_is_known(task, [task.target(root_from_tip)]):
        if not len(many) and proven_unreachable(task.arm, [task.target(root_from_tip)]):
            return [f"{NO_SOLUTION} {where}"]
        words = _contacts_of_all(task, root_from_tip, checker, many)
        return [f"at {where}: {words}"] if words else []
    reasons = []
    for q in many:
        result = checker.finer_at(q).check(q)  # contact between convex hulls is no proof of contact between the meshes
        if result.free:
            return []
        reasons.append(f"at {where}: {'; '.join(contact_words(result))}")
    return reasons or [f"{NO_SOLUTION} {where}"]


def _contacts_of_all(task: PickTask, root_from_tip: SE3, checker: CollisionChecker, some: Array) -> str:
    """The contacts by which every configuration at a pose is excluded; empty if this is not proven.

    Bodies that are rigidly connected to the tcp have the same pose for every IK solution, so their contacts with
    obstacles exclude all of them. Otherwise the joint values are divided into boxes (:func:`prove_blocked`). The
    configurations ``some`` (k, n) are known.
    """
    targets = task.targets([root_from_tip])
    if len(some) and (words := contacts_everywhere(checker, some[0])):
        return "; ".join(words)
    many = np.concatenate([some, along_families(task.arm, targets, task.cell.home)[1]])
    proof = prove_blocked(checker, task.target(root_from_tip), many)
    pairs = () if proof is None else proof.bodies
    return " or ".join(f"{first} collides with {second}" for first, second in pairs)
