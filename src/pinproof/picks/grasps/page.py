"""The page of proposed grasps: the part, the hand at the chosen grasp with its contacts, and the table of all."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from pinproof import viewer
from pinproof.collision import ConvexShape, Cylinder, LineSurface, Mesh, Obstacle, outer_points
from pinproof.picks.grasps.antipodal import across
from pinproof.spatial import Array, matrix

RESTS = 0.6
"""Share of each second of the film for which a grasp is shown; in the rest of it the hand moves to the next one."""

PART_GREY, HAND_BLUE, CONTACT_RED = (0.72, 0.70, 0.64, 1.0), (0.35, 0.45, 0.62, 0.75), (0.85, 0.2, 0.1, 1.0)

THICK = 4e-4
"""Metres: the thickness of the discs that mark contacts."""


def write_grasps_page(path: str | Path, found: Any) -> None:
    """Write the page of proposed grasps, which import this module; ViewerError if it cannot be written."""
    hand, part = found.hand, found.part.obstacle
    # Each body of the hand and each contact, with its pose (F, 4, 4) at every grasp
    drawn: list[tuple[Obstacle, Array]] = []
    hands = [each.grasp.pose * (hand.tcp_from_hand.actInv(found.tip)).inverse() for each in found]
    for number, (surface, at) in enumerate(hand.palm):
        drawn.append((_body(f"palm {number}", surface), np.array([matrix(placed * at) for placed in hands])))
    shares = [0.0 if hand.fingers is None else hand.fingers.share(each.width) for each in found]
    fingers = [hand.fingers_at(share) for share in shares]
    for number, (surface, _) in enumerate(fingers[0]):
        placements = [matrix(placed * own[number][1]) for placed, own in zip(hands, fingers, strict=True)]
        drawn.append((_body(f"finger {number}", surface), np.array(placements)))
    radius = 0.05 * found.part.size
    for number in range(len(found[0].contacts)):
        disc = Obstacle(f"contact {number}", Cylinder(radius, THICK), rgba=CONTACT_RED)
        poses = np.tile(np.eye(4), (len(found), 1, 1))
        normals = np.array([each.normals[number] for each in found])
        poses[:, :3, :3] = np.stack([*across(normals), normals], axis=2)
        poses[:, :3, 3] = [each.contacts[number] for each in found]
        drawn.append((disc, poses))
    # A film that rests at each grasp; what is drawn first is where it is lowest, on which the floor depends
    times = np.concatenate([np.arange(len(found))[:, None] + [0.0, RESTS]]).reshape(-1)
    riders = {thing.name: np.repeat(poses, 2, axis=0) for thing, poses in drawn}
    things = [
        viewer.DrawnObstacle(
            part.name, tuple(viewer.obstacle_surfaces(Obstacle(part.name, part.shape, rgba=PART_GREY))), np.eye(4)
        )
    ]
    points = [found.part.triangles.reshape(-1, 3)]
    for thing, poses in drawn:
        surfaces = tuple(viewer.obstacle_surfaces(thing))
        vertices = np.concatenate([surface.vertices for surface in surfaces])
        heights = (vertices @ poses[:, 2, :3].T + poses[:, 2, 3]).min(axis=0)
        things.append(viewer.DrawnObstacle(thing.name, surfaces, poses[heights.argmin()]))
        points.append(viewer.placed_points(np.array([vertices.min(axis=0), vertices.max(axis=0)]), poses[:1]))
    stage: Any = viewer.Drawing(None, (), tuple(things), ())  # type: ignore[arg-type]  # no robot is drawn
    direction = np.array([1.0, -1.6, 0.9])
    view = viewer.View(direction / np.linalg.norm(direction), np.concatenate(points))
    still = viewer.Film(np.zeros(1), np.empty((1, 0, 4, 4)), np.empty((1, 0, 3)))
    commands = viewer.stage_commands(stage, still, view)
    film = viewer.Film(times, np.empty((len(times), 0, 4, 4)), np.empty((len(times), 0, 3)), riders)
    commands.set_animation(
        viewer.tracks(commands, stage, film, {name: viewer.node_path("scene", name) for name in riders})
    )
    notes = [
        (
            "resists: a force at the centre of mass that the grasp is proven to resist in every direction, in "
            "multiples of the force of a finger or of the cup."
        ),
        "The red discs are at the centres of the contacts; the hand is drawn at the width of the grasp.",
    ]
    text = viewer.panels.page(
        f"Grasps of {part.name}",
        "cell",
        viewer.panels.table("side", found.rows(), notes),
        {**view.settings(), "duration": float(len(found)), "start": 0.0},
        commands,
        label="The part with the hand at the chosen grasp",
        summary=escape(found.message),
        colours=(("part", PART_GREY), ("hand", HAND_BLUE), ("contact", CONTACT_RED)),
        script=viewer.panels.part("page.js", "pinproof.picks.grasps"),
    )
    viewer.panels.write_page(path, text)


def _body(name: str, surface: LineSurface) -> Obstacle:
    """A body of the hand as it is drawn."""
    if surface.triangles is None:
        return Obstacle(name, ConvexShape(outer_points(surface)), rgba=HAND_BLUE)
    corners = np.asarray(surface.triangles).reshape(-1, 3)
    return Obstacle(name, Mesh.from_arrays(corners, np.arange(len(corners)).reshape(-1, 3)), rgba=HAND_BLUE)
