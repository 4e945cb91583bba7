"""Which links of a robot touch each other in random configurations, and an SRDF that excludes those that always do."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pinproof.collision.checking.links import AS_REQUESTED, LinkBodies
from pinproof.collision.checking.pairs import BY, NEARLY_ALL, Overlaps
from pinproof.common.files import write_text_whole
from pinproof.common.validation import require_integer
from pinproof.description.srdf import DisabledPair, srdf_text
from pinproof.model import Robot

if TYPE_CHECKING:
    from pinproof.collision.checking.checker import CheckResult, CollisionChecker
    from pinproof.spatial import Array

Frequency = Literal["always", "nearly always", "sometimes", "never"]

ADJACENT, ALWAYS = "Adjacent", "Always"
"""The reasons of MoveIt's Setup Assistant with which pairs are excluded; a checker confirms ``Always`` by samples."""

MIN_SAMPLES = 50
"""Smallest number of configurations: links that touch in all of them touch in 94 % of all, with 95 % confidence."""


@dataclass(frozen=True)
class LinkOverlap:
    """How often two links touch.

    Parameters
    ----------
    links
        The two links.
    touching, samples
        In how many of the sampled configurations they touch.
    adjacent
        Whether one joint connects them.
    geometry
        The geometry that was tested: that of the collision model (meshes as hulls), or ``several hulls`` or ``exact
        meshes`` where the hulls touch much more often than the meshes.
    disabled
        The reason with which the SRDF of the robot disables the pair, ``without a reason``, or empty.
    """

    links: tuple[str, str]
    touching: int
    samples: int
    adjacent: bool
    geometry: str
    disabled: str = ""

    @property
    def frequency(self) -> Frequency:
        """How often they touch in words; ``nearly always`` means in 95 % of the samples or more."""
        if self.touching in (0, self.samples):
            return "always" if self.touching else "never"
        return "nearly always" if self.touching >= NEARLY_ALL * self.samples else "sometimes"

    @property
    def reason(self) -> str:
        """The reason for excluding the pair in the proposed SRDF; empty if it stays checked."""
        return ADJACENT if self.adjacent else ALWAYS if self.touching == self.samples else ""


@dataclass(frozen=True)
class OverlapReport:
    """All pairs of links with collision geometry; result of :func:`sample_overlaps`."""

    robot: Robot
    pairs: tuple[LinkOverlap, ...]
    samples: int

    @property
    def proposed(self) -> tuple[DisabledPair, ...]:
        """The pairs to exclude: adjacent links, and links that touch in every sample.

        Links that never touch in the samples are not excluded, because samples do not prove that they never do: a
        certificate that leaves them out could report a motion in collision as free.
        """
        return tuple(DisabledPair(pair.links, pair.reason) for pair in self.pairs if pair.reason)

    def save_srdf(self, path: str | Path) -> None:
        """Write an SRDF atomically: the content of the robot's own SRDF, if there is one, and the proposed pairs.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        write_text_whole(path, srdf_text(self.robot.name, self.robot.srdf, self.proposed))


def sample_overlaps(robot: Robot, *, samples: int = 1000) -> OverlapReport:
    """Count in how many random configurations of all joints each two links of a robot touch.

    Parameters
    ----------
    robot
        The robot.
    samples
        Number of configurations within the limits, at least :data:`MIN_SAMPLES`, from a fixed seed. Joints without
        limits take one full rotation.

    Returns
    -------
    OverlapReport
        The pairs, those that touch most often first.

    Raises
    ------
    MeshError
        If a collision mesh is missing or cannot be used.
    """
    require_integer("samples", samples, MIN_SAMPLES)
    links = list(dict.fromkeys(geometry.link for geometry in robot.urdf.collisions))
    bodies = LinkBodies(robot.urdf.collisions, dict.fromkeys(robot.urdf.links, "hull"))
    overlaps = Overlaps(robot, bodies, samples)
    joined = {frozenset((joint.parent, joint.child)) for joint in robot.urdf.joints.values()}
    disabled = {frozenset(pair.links): pair.reason or "without a reason" for pair in robot.srdf.disabled}
    pairs = []
    for first, second in combinations(links, 2):
        found, key = overlaps.of(first, second), frozenset((first, second))
        geometry = "collision model" if found.level == AS_REQUESTED else BY[found.level]
        count = round(found.touching * samples)
        pairs.append(LinkOverlap((first, second), count, samples, key in joined, geometry, disabled.get(key, "")))
    return OverlapReport(robot, tuple(sorted(pairs, key=lambda pair: -pair.touching)), samples)


def overlap_hint(checker: CollisionChecker, q: Array, found: CheckResult) -> str:
    """Return a remedy if links touch each other at the home configuration of an arm, else an empty text."""
    links = set(checker.group.robot.urdf.links)
    among_links = [contact for contact in found.contacts if links.issuperset(contact.bodies)]
    if not among_links or not (q == checker.group.home).all():
        return ""
    return (
        "if these links overlap by design, `pinproof info ROBOT --overlaps` lists all such pairs and "
        "--write-srdf writes an SRDF that excludes them (pinproof.collision.sample_overlaps in Python)"
    )
