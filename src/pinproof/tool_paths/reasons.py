"""Why a tool path cannot be passed: what excludes all configurations at a pose, or all steps to the next one."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from pinproof.collision import CollisionChecker
from pinproof.model import Arm
from pinproof.spatial import Array
from pinproof.tool_paths.result import BlockedPose, Obstruction
from pinproof.tool_paths.rungs import Rung

# Number of configurations of blocked poses whose contacts are counted.
CHECKED = 64
# Smallest singular value below which a jump is reported as singular.
SINGULAR = 0.05


def obstruction(rung: Rung) -> Obstruction:
    """Why a rung has no nodes."""
    if rung.avoided:
        return Obstruction.AVOIDED
    if len(rung.q):
        return Obstruction.CONTACT
    return Obstruction.LIMIT if rung.outside else Obstruction.OUT_OF_REACH


def place_name(rung: Rung, names: tuple[str, ...]) -> str:
    """The name of the pose of a rung, or of the place between two poses of the path."""
    at = rung.at
    if at < 0.0 or at > len(names) - 1:
        return "the approach" if at < 0.0 else "the departure"
    before = names[int(at)]
    return (
        before if at == int(at) else f"{100.0 * (at - int(at)):.0f} % of the way from {before} to {names[int(at) + 1]}"
    )


def blocked_rungs(checker: CollisionChecker, rungs: list[Rung], turns: int, names: tuple[str, ...]) -> BlockedPose:
    """Why consecutive rungs have no nodes, all for one reason; ``turns`` is the number of rotations, 0 for all."""
    first, last = rungs[0], rungs[-1]
    where = " to ".join(dict.fromkeys((place_name(first, names), place_name(last, names))))
    over = "at the rotation of the path" if turns == 1 else f"at all {turns or ''} rotations".replace("  ", " ")
    kind, proven = obstruction(first), all(rung.complete and not rung.avoided for rung in rungs)
    if kind is not Obstruction.CONTACT:
        outside = f", {sum(rung.outside for rung in rungs)} solutions" if kind is Obstruction.LIMIT else ""
        return BlockedPose(first.at, last.at, kind, f"{where}: {kind.value}{outside} {over}", proven, first.place)
    # The pairs of bodies in contact, and the configuration with the least penetration
    contacts: Counter[tuple[str, str]] = Counter()
    q = np.concatenate([rung.q for rung in rungs])
    count, least, shown = len(q), -math.inf, q[0]
    q = q[:: math.ceil(count / CHECKED)]
    for one in q:
        found = checker.check(one).contacts
        contacts.update({contact.bodies for contact in found})
        depth = min((contact.distance for contact in found), default=0.0)
        if depth > least:
            least, shown = depth, one
    pairs = ", ".join(f"{one} and {other} ({number})" for (one, other), number in contacts.most_common(3))
    of = str(len(q)) if len(q) < count else f"all {count}"
    message = f"{where}: {kind.value} {over}; pairs of bodies, counted in {of} configurations: {pairs}"
    return BlockedPose(first.at, last.at, kind, message, proven, first.place, dict(contacts), shown)


def smallest_step(arm: Arm, here: Array, there: Array) -> tuple[int, Array] | None:
    """The row of the configuration (k, n) that is closest to one of others (m, n), and the step (n,) between them."""
    if not len(here) or not len(there):
        return None
    step = there[None] - here[:, None]
    step -= np.where(arm.periodic, 2.0 * np.pi * np.round(step / (2.0 * np.pi)), 0.0)
    row, column = np.unravel_index(int(np.abs(step).max(axis=2).argmin()), step.shape[:2])
    return int(row), step[row, column]


def jump(arm: Arm, here: Array, rungs: tuple[Rung, Rung], names: tuple[str, ...], failed: str) -> BlockedPose:
    """Why no node of the second rung is within reach of configurations ``here`` (k, n) of the first one."""
    rung, following = rungs
    row, step = smallest_step(arm, here, following.nodes) or (0, np.zeros(arm.dof))
    joint = int(np.abs(step).argmax())
    least = float(np.linalg.svd(arm.jacobian(here[row]), compute_uv=False)[-1])
    singular = f", smallest singular value {least:.2g}" if least < SINGULAR else ""
    moved = (
        f"{arm.joint_names[joint]} would jump by {abs(step[joint]):.2g} {'rad' if arm.angular[joint] else 'm'} at least"
    )
    message = f"{place_name(rung, names)} to {place_name(following, names)}: {moved}{singular}{failed}"
    return BlockedPose(rung.at, following.at, Obstruction.JUMP, message, False, following.place, q=np.array(here[row]))
