"""Contacts in the picture: where two bodies touch, and along which normal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.collision import CheckResult, FirstContact
from pinproof.viewer.appearance import ball, cone, tube
from pinproof.viewer.stage import Stage
from pinproof.viewer.surfaces import Rgba
from pinproof.viewer.wire import Commands, node_path

__all__ = ["Mark", "body_nodes", "mark_radius", "marks_of"]

Array = npt.NDArray[np.float64]

CONTACT_RED: Rgba = (0.90, 0.05, 0.05, 0.9)
NORMAL_INK: Rgba = (0.10, 0.05, 0.05, 1.0)

BALL_SHARE, LEAST_BALL = 0.012, 0.004
"""Radius of the ball that marks a contact: this share of the picture's own radius, but so many metres at least."""

MOST_MARKS = 50
"""Contacts that are marked; the caption counts them all."""


@dataclass(frozen=True, eq=False)
class Mark:
    """A contact: the two bodies (links, attached objects, obstacles), their points (2, 3), the normal (3,) if known."""

    bodies: tuple[str, str]
    points: Array
    normal: Array | None

    def draw(self, commands: Commands, number: int, radius: float) -> None:
        """A ball midway between the points, one on each where they are apart, and an arrow along the normal.

        They are seen through whatever lies before them.
        """
        seen_through = {"type": "MeshBasicMaterial", "depthTest": False, "transparent": True}
        middle = self.points.mean(axis=0)
        node = ("contact", str(number))
        commands.set_surface(node_path(*node, "ball"), ball(middle, radius, CONTACT_RED), **seen_through)
        if np.linalg.norm(self.points[1] - self.points[0]) > radius:
            for side, point in enumerate(self.points):
                commands.set_surface(
                    node_path(*node, f"point {side}"), ball(point, 0.5 * radius, CONTACT_RED), **seen_through
                )
        if self.normal is None:
            return
        tip = middle + 9.0 * radius * self.normal
        shaft = tube(np.array([middle, tip - 3.0 * radius * self.normal]), 0.3 * radius, NORMAL_INK)
        head = cone(tip, self.normal, 0.9 * radius, 3.0 * radius, NORMAL_INK)
        for name, surface in (("shaft", shaft), ("head", head)):
            if surface is not None:
                commands.set_surface(node_path(*node, name), surface, **seen_through)


def marks_of(found: FirstContact | CheckResult | None) -> list[Mark]:
    """The contacts of a certificate or of a check, :data:`MOST_MARKS` at most."""
    if found is None:
        return []
    if isinstance(found, CheckResult):
        return [Mark(each.bodies, each.points, _direction(each.normal)) for each in found.contacts[:MOST_MARKS]]
    # A certificate tells no normal. It is the way from the first point to the second, or back where bodies overlap;
    # two points on one place show none.
    gap = found.points[1] - found.points[0]
    apart = float(np.linalg.norm(gap))
    normal = None if apart < 1e-7 else np.sign(found.distance or 1.0) * gap / apart
    return [Mark(found.bodies, found.points, normal)]


def _direction(normal: Array) -> Array | None:
    """A unit normal; None where there is none, as between a ball and a cylinder whose axis holds its centre."""
    return normal if np.linalg.norm(normal) > 0.5 else None


def mark_radius(reach: float) -> float:
    """Metres, of the ball of a mark in a picture of radius ``reach`` (m)."""
    return max(BALL_SHARE * reach, LEAST_BALL)


def body_nodes(stage: Stage, marks: Sequence[Mark]) -> list[list[str]]:
    """The nodes of all bodies in contact; an attached object is drawn with the tcp's link."""
    links, obstacles = {link.name for link in stage.links}, {obstacle.name for obstacle in stage.obstacles}
    found: dict[tuple[str, str], None] = {}
    for name in (body for mark in marks for body in mark.bodies):
        if name in links:
            found["robot", name] = None
        elif name in obstacles:
            found["scene", name] = None
        elif name not in stage.arm.robot.urdf.links and stage.arm.tcp in links:
            found["robot", stage.arm.tcp] = None
    return [list(node) for node in found]
