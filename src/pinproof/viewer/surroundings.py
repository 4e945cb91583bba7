"""Floor, background and light: they make shape and place readable and are no part of the scene."""

from __future__ import annotations

import numpy as np

from pinproof.viewer.camera import View
from pinproof.viewer.wire import Commands

__all__ = ["add_surroundings"]

FLOOR_GAP = 0.002
"""Metres between the floor and what stands on it: two surfaces at one height flicker."""

SQUARE = 0.25
"""Metres between two lines on the floor."""


def add_surroundings(commands: Commands, view: View, floor: float) -> None:
    """Light from the camera's left, a floor at height ``floor`` (m) that takes shadows, and a calm background."""
    low, high = view.points.min(axis=0), view.points.max(axis=0)
    centre, radius = (low + high) / 2, view.radius
    commands.set_property("/Background", "top_color", [0.85, 0.88, 0.91])
    commands.set_property("/Background", "bottom_color", [0.70, 0.74, 0.79])
    for unused in ("/Grid", "/Axes", "/Lights/PointLightNegativeX", "/Lights/PointLightPositiveX"):
        commands.set_property(unused, "visible", False)
    _light(commands, view, float(np.linalg.norm(centre)) + 1.5 * radius)
    _floor(commands, centre[:2], floor - FLOOR_GAP, max(2.0, np.ceil(2 * radius)))


def _light(commands: Commands, view: View, reach: float) -> None:
    commands.set_property("/Lights/AmbientLight/<object>", "intensity", 0.14)
    # From the sky more than from the floor: what lies in shadow keeps its shape.
    above = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 1, 1]
    sky = {"color": 0xFFFFFF, "groundColor": 0x8A8378, "intensity": 0.38, "matrix": above}
    commands.set_object("/Lights/SkyLight", "HemisphereLight", {}, **sky)
    commands.set_property("/Lights/SkyLight/<object>", "castShadow", False)
    commands.set_property("/Lights/FillLight/<object>", "intensity", 0.15)
    commands.set_property("/Lights/FillLight/<object>", "position", [float(v) for v in (*(-view.direction[:2]), 0.4)])
    # A directional light shines on the origin; its shadow is drawn in a box about it that must hold everything.
    left = np.cross(view.direction, (0.0, 0.0, 1.0))
    source = 0.55 * view.direction + 0.45 * left + (0.0, 0.0, 0.9)
    source *= 2 * reach / np.linalg.norm(source)
    matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, *(float(v) for v in source), 1]
    box = {"uuid": "shadow", "type": "OrthographicCamera", "near": 0.1 * reach, "far": 4 * reach, "zoom": 1}
    box |= {"left": -reach, "right": reach, "top": reach, "bottom": -reach}
    shadow = {"mapSize": [2048, 2048], "bias": -0.0005, "normalBias": 0.01, "radius": 2.5, "camera": box}
    look = {"color": 0xFFFFFF, "intensity": 0.52, "matrix": matrix, "shadow": shadow}
    commands.set_object("/Lights/KeyLight", "DirectionalLight", {}, **look)


def _floor(commands: Commands, centre: np.ndarray, height: float, half: float) -> None:
    root_from_floor = np.eye(4)
    root_from_floor[:3, 3] = (*(np.round(centre / SQUARE) * SQUARE), height)
    disc = {"type": "CircleGeometry", "radius": half * 1.05, "segments": 96}
    commands.set_mesh("/floor/disc", disc, (0.70, 0.73, 0.76, 1.0), specular=0, shininess=0)
    commands.set_transform("/floor", root_from_floor)
    lines, above = [], FLOOR_GAP / 4
    for offset in np.arange(-half, half + SQUARE / 2, SQUARE):
        reach = np.sqrt(max(half**2 - offset**2, 0.0))
        lines += [(offset, -reach, above), (offset, reach, above), (-reach, offset, above), (reach, offset, above)]
    commands.set_lines("/floor/lines", np.array(lines), (0.36, 0.41, 0.47, 0.35))
