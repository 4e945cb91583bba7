"""What kind of chain an arm is, read off the lines its joints turn about and slide along.

Which axes are parallel or meet in a point does not depend on q, if they are neighbours: it decides whether the inverse
kinematics has a closed form (Pieper 1968: three axes that meet, or three that are parallel).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pinproof.model.arm import Arm
from pinproof.model.chain import link_path

__all__ = ["kinematic_class"]

Array = npt.NDArray[np.float64]

PARALLEL_TOLERANCE = 1e-4
"""Rad. Axes this close to parallel count as such: URDFs write 1.5708 for pi/2 (4e-6 off), and some less."""

MEETING_TOLERANCE = 1e-5
"""Metres. Axes whose distances from one point are below this meet: what 4e-6 rad make of an arm of two metres."""

SAMPLES = 3
"""Configurations looked at: in a single one, axes that are not neighbours may meet by chance."""


def kinematic_class(arm: Arm) -> str:
    """A sentence on the arm's axes, such as ``"6 revolute joints (RRRRRR): spherical wrist (joints 4, 5, 6)"``.

    Says how many joints turn (R) and slide (P) in which order, where three neighbouring axes meet in a point (a
    spherical shoulder or wrist), and where three or more are parallel. It describes; whether a closed form holds to
    the last digit is for the solver to check.
    """
    pattern = "".join("R" if turns else "P" for turns in arm.angular)
    kinds = [
        f"{pattern.count(letter)} {word}"
        for letter, word in (("R", "revolute"), ("P", "prismatic"))
        if letter in pattern
    ]
    head = f"{' and '.join(kinds)} joint{'s' if arm.dof > 1 else ''} ({pattern})"
    if any(joint.mimic is not None for joint in link_path(arm.robot.urdf, arm.base, arm.tcp)):
        return f"{head}: coupled by mimic joints on the chain"
    features = [*_meeting(arm), *_parallel(arm)]
    if arm.dof > 6:
        features.append(f"redundant by {arm.dof - 6}")
    if arm.dof < 6:
        features.append("fewer than six joints: most poses cannot be reached exactly")
    return f"{head}: {'; '.join(features or ['no three neighbouring axes meet or are parallel'])}"


def _configurations(arm: Arm) -> Array:
    rng = np.random.default_rng(0)
    return rng.uniform(*arm.limits.sampling_range(), size=(SAMPLES, arm.dof))


def _meeting(arm: Arm) -> list[str]:
    """Triples of neighbouring turning axes that meet in one point."""
    screws = [arm.jacobian(q, reference="WORLD") for q in _configurations(arm)]
    found = []
    for first in range(arm.dof - 2):
        if not arm.angular[first : first + 3].all():
            continue
        if all(_miss(screw[:, first : first + 3]) < MEETING_TOLERANCE for screw in screws):
            place = "wrist" if first == arm.dof - 3 else "shoulder" if first == 0 else "joint"
            found.append(f"spherical {place} (joints {_numbers(first, first + 3)})")
    return found


def _miss(screws: Array) -> float:
    """The largest distance (m) of three lines, given as twists (6, 3), from the point nearest to them; inf if parallel.

    The line of a turning joint has the direction w and passes through w x v; the nearest point x solves
    sum (I - w w^T) (x - w x v) = 0, which has no single solution where all w are parallel.
    """
    axes, points = screws[3:].T, np.cross(screws[3:].T, screws[:3].T)
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    total = across.sum(axis=0)
    if np.linalg.eigvalsh(total)[0] < PARALLEL_TOLERANCE**2:
        return np.inf
    nearest = np.linalg.solve(total, np.einsum("kij,kj->i", across, points))
    return float(np.linalg.norm(np.einsum("kij,kj->ki", across, nearest - points), axis=1).max())


def _parallel(arm: Arm) -> list[str]:
    """Runs of three or more neighbouring axes with one direction."""
    screw = arm.jacobian(_configurations(arm)[0], reference="WORLD")
    axes = np.where(arm.angular, screw[3:], screw[:3]).T
    same = [bool(np.linalg.norm(np.cross(a, b)) < PARALLEL_TOLERANCE) for a, b in pairwise(axes)]
    found, first = [], 0
    for end in range(1, arm.dof + 1):
        if end < arm.dof and same[end - 1]:
            continue
        if end - first >= 3:
            count = {3: "three", 4: "four"}.get(end - first, str(end - first))
            some = f"{count} parallel axes (joints {_numbers(first, end)})"
            found.append("all axes parallel" if end - first == arm.dof else some)
        first = end
    return found


def _numbers(first: int, end: int) -> str:
    return ", ".join(str(i + 1) for i in range(first, end))
