"""Random edges, proven, and then looked at by other means for verdicts that are wrong; and how many stay open.

FREE is looked at with coal alone, densely, both on the links as the proof took them, for the distances it claims, and
on their exact meshes (:func:`pinproof.collision.audit`). COLLIDING has to name a configuration at which coal finds a
distance that is no larger than the margin.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np
import numpy.typing as npt

from pinproof.benchmarks.collision_problems import MARGINS, random_edge, random_scene
from pinproof.benchmarks.plan_own import own_reach
from pinproof.collision import Certificate, CertificateStatus, CollisionChecker, audit, certify
from pinproof.collision.coal_checks import PlainCoal
from pinproof.model import load_robot
from pinproof.motion import JointPath

__all__ = ["EDGE_ROBOTS", "EdgeRow", "audited_edges", "what_is_wrong"]

Array = npt.NDArray[np.float64]

EDGE_ROBOTS = ("ur5", "panda", "generic_6dof", "xarm7", "stanford")

EDGES_PER_SCENE = 12

TOLERANCE = 1e-4
"""Metres: what a proof is asked for."""

SAMPLES = 60
"""Places along an edge at which distances are measured."""

STEP = 0.01
"""Rad or m between two places at which exact meshes are looked at."""

SLACK = 3e-6
"""Metres that coal's own distances may be off."""

THOUSAND = 1e3


@dataclass(frozen=True)
class EdgeRow:
    """What became of a robot's edges.

    Parameters
    ----------
    robot, scenes, edges
        How many edges of whom in how many scenes.
    free, colliding, undecided
        The verdicts.
    looks
        Configurations at which FREE edges were looked at again.
    mean_ms
        Of a proof.
    wrong
        Verdicts that the second look contradicts, each in a sentence.
    """

    robot: str
    scenes: int
    edges: int
    free: int
    colliding: int
    undecided: int
    looks: int
    mean_ms: float
    wrong: tuple[str, ...]


def audited_edges(robot: str, edges: int, seed: int = 0, on_progress: Callable[[str], None] | None = None) -> EdgeRow:
    """Prove random edges of a robot in random scenes, each depending on the seed and its number alone, and look again.

    Raises
    ------
    InputError
        For an unknown robot.
    """
    arm = load_robot(robot).arm()
    reach = own_reach(arm)
    hulls, exact = CollisionChecker(arm), CollisionChecker(arm, link_meshes="surface")
    counts = dict.fromkeys(CertificateStatus, 0)
    wrong: list[str] = []
    looks, spent, scenes = 0, 0.0, -(-edges // EDGES_PER_SCENE)
    for number in range(scenes):
        rng = np.random.default_rng([seed, number])
        scene, margin = random_scene(rng, reach), float(rng.choice(MARGINS))
        checker, meshes = hulls.with_scene(scene).with_margin(margin), exact.with_scene(scene)
        for edge in range(min(EDGES_PER_SCENE, edges - number * EDGES_PER_SCENE)):
            path = random_edge(checker, rng)
            began = perf_counter()
            certificate = certify(path, checker, tolerance=TOLERANCE)
            spent += perf_counter() - began
            counts[certificate.status] += 1
            looked, said = what_is_wrong(path, certificate, checker, meshes)
            looks += looked
            if said:
                wrong.append(f"{robot}, seed {seed}, scene {number}, edge {edge}: {said}")
        if on_progress is not None and number % 10 == 9:
            on_progress(f"{robot}: {min((number + 1) * EDGES_PER_SCENE, edges)} of {edges} edges, {len(wrong)} wrong")
    return EdgeRow(
        robot,
        scenes,
        edges,
        counts[CertificateStatus.FREE],
        counts[CertificateStatus.COLLIDING],
        counts[CertificateStatus.UNDECIDED],
        looks,
        THOUSAND * spent / max(edges, 1),
        tuple(wrong),
    )


def what_is_wrong(
    path: JointPath, certificate: Certificate, checker: CollisionChecker, meshes: CollisionChecker
) -> tuple[int, str]:
    """How many configurations were looked at, and what contradicts a verdict; empty if nothing does.

    Parameters
    ----------
    checker, meshes
        The checker that the certificate is of, and one for the same arm and scene on exact meshes.
    """
    if certificate.status is CertificateStatus.COLLIDING:
        contact = certificate.first_contact
        if contact is None:
            return 0, "COLLIDING without a contact"
        least = _least_distance(checker, contact.q[None])
        if contact.distance > checker.margin or least > checker.margin + SLACK:
            return 1, f"COLLIDING, but {least:.6g} m apart where it is said to touch (margin {checker.margin:g} m)"
        return 1, ""
    if certificate.status is CertificateStatus.UNDECIDED:
        return 0, ""
    least = _least_distance(checker, path(np.linspace(*path.domain, SAMPLES)))
    if least < max(checker.margin, certificate.clearance) - SLACK:
        return SAMPLES, f"FREE with {certificate.clearance:.6g} m proven, but {least:.6g} m apart"
    seen = audit(path, meshes, step=STEP)
    return SAMPLES + seen.samples, "" if seen.clean else f"FREE, but on exact meshes {seen.message}"


def _least_distance(checker: CollisionChecker, many: Array) -> float:
    """The smallest distance (m) over all pairs at the configurations (N, n), by Pinocchio and coal."""
    plain = PlainCoal(checker)
    return min(map(plain.clearance, plain.configurations(many)))
