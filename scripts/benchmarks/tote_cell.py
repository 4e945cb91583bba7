"""A cell with CAD meshes that no example of the package resembles: an xArm 7 empties the compartments of a tote.

:func:`write_cell` writes meshes, scene and picks to a folder: a tapered tote with three dividers, and parts that lie in
its compartments at random (hexagonal nuts with a bore, tubes, tees of two pipes), which the two fingers of a gripper
place on a tray with a raised rim.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml
from trimesh.boolean import difference, union
from trimesh.creation import box, cylinder
from trimesh.transformations import euler_from_matrix, rotation_matrix, translation_matrix

TOTE, TRAY = np.array([0.45, 0.05, 0.0]), np.array([0.1, -0.42, 0.0])
"""Positions (m) of the middle of their undersides, in the frame of the robot's base."""

SIDES, WALL, FLOOR, HEIGHT = (0.40, 0.30), 0.004, 0.005, 0.10
"""Outer sides of the tote at its underside, and the thickness of its walls, of its floor, and its height (m)."""

GRIP = {"nut": 0.028, "tube": 0.024, "tee": 0.020}
"""Width (m) of each kind of part between the fingers."""

KINDS = ("nut", "tube", "tee")

PARTS = 12
"""Number of parts in the tote."""


def _part(kind: str) -> trimesh.Trimesh:
    """A part about the middle of its grasp, lying on its side or end (m)."""
    if kind == "nut":  # 28 mm across flats
        return difference([cylinder(0.028 / np.sqrt(3), 0.022, sections=6), cylinder(0.009, 0.03, sections=40)])
    lying = rotation_matrix(np.pi / 2, [0, 1, 0])
    if kind == "tube":
        made = difference([cylinder(0.012, 0.06, sections=40), cylinder(0.0105, 0.07, sections=40)])
        made.apply_transform(lying)
        return made
    branch = cylinder(
        0.008, 0.035, sections=32, transform=translation_matrix([0, 0.0175, 0]) @ rotation_matrix(np.pi / 2, [1, 0, 0])
    )
    return union([cylinder(0.010, 0.07, sections=40, transform=lying), branch])


def _tote() -> trimesh.Trimesh:
    """A tapered box without a lid, with three dividers across it."""

    def frustum(inset: float, low: float, high: float) -> trimesh.Trimesh:
        corners = []
        for z in (low, high):
            x, y = (side / 2 - inset + 0.08 * z for side in SIDES)
            corners += [[sx * x, sy * y, z] for sx in (-1, 1) for sy in (-1, 1)]
        return trimesh.convex.convex_hull(np.array(corners))

    hollow = difference([frustum(0.0, 0.0, HEIGHT), frustum(WALL, FLOOR, HEIGHT + 0.01)])
    dividers = [
        box([0.003, SIDES[1] - WALL, 0.6 * HEIGHT], translation_matrix([x, 0, 0.3 * HEIGHT])) for x in (-0.1, 0.0, 0.1)
    ]
    return union([hollow, *dividers])


def write_cell(folder: Path, seed: int = 0) -> Path:
    """Write the cell to an existing folder, which is returned."""
    rng = np.random.default_rng(seed)
    rim = difference(
        [
            box([0.30, 0.24, 0.012], translation_matrix([0, 0, 0.006])),
            box([0.29, 0.23, 0.02], translation_matrix([0, 0, 0.014])),
        ]
    )
    for name, mesh in {"tote": _tote(), "tray": rim, **{kind: _part(kind) for kind in KINDS}}.items():
        if not mesh.is_watertight:
            raise ValueError(f"the mesh of the {name} is not watertight")
        mesh.export(folder / f"{name}.stl")
    obstacles: list[dict[str, Any]] = [
        {"name": "floor", "half_space": {}, "xyz": [0, 0, -0.002]},
        {"name": "tote", "mesh": {"path": "tote.stl"}, "xyz": TOTE.tolist()},
        {"name": "tray", "mesh": {"path": "tray.stl"}, "xyz": TRAY.tolist()},
        {"name": "column", "cylinder": {"radius": 0.03, "length": 0.6}, "xyz": [0.30, -0.28, 0.3]},
    ]
    picks: list[dict[str, Any]] = []
    for number in range(PARTS):
        kind, name = KINDS[number % 3], f"{KINDS[number % 3]}_{number + 1}"
        low = -float(_part(kind).bounds[0, 2])
        # Three rows in each of the four compartments
        slot = np.array([-0.15 + 0.1 * (number % 4), 0.085 * (number // 4 - 1)])
        place = slot + rng.uniform([-0.012, -0.005], [0.012, 0.005])
        turn = rotation_matrix(
            rng.uniform(-np.pi, np.pi) if kind == "nut" else np.pi / 2 + rng.uniform(-0.3, 0.3), [0, 0, 1]
        )
        obstacles.append(
            {
                "name": name,
                "mesh": {"path": f"{kind}.stl"},
                "rpy": [float(v) for v in euler_from_matrix(turn)],
                "xyz": [*(TOTE[:2] + place).tolist(), float(FLOOR + low + 2e-4)],
            }
        )
        column, row = number % 4, number // 4
        put = TRAY + np.array([-0.105 + 0.07 * column, -0.07 + 0.07 * row, 0.004 + low + 3e-4])
        picks.append(
            {
                "name": name,
                "frame": name,
                "object": name,
                "xyz": [0.022 if kind == "tee" else 0, 0, 0.004],
                "rpy": ["pi", 0, 0],
                "place": {"object_pose": {"xyz": put.tolist()}, "approach": 0.06, "retreat": 0.06},
            }
        )
    scene = {"obstacles": obstacles, "allowed_contacts": [["link_base", "floor"]]}
    fingers = [
        {"name": f"finger_{side}", "box": [0.012, 0.006, 0.055], "xyz": [0, 0.003 * sign, 0.105]}
        for side, sign in (("left", 1), ("right", -1))
    ]
    for kind in KINDS:
        document = {
            "robot": "xarm7",
            "scene": "scene.yaml",
            "margin": 0.001,
            "tip": {"xyz": [0, 0, 0.125]},
            "tool": [{"name": "gripper", "box": [0.06, 0.09, 0.07], "xyz": [0, 0, 0.04]}],
            "fingers": {"opening": GRIP[kind] + 0.02, "grip": GRIP[kind], "axis": [0, 1, 0], "bodies": fingers},
            "defaults": {"approach": 0.09, "retreat": 0.09, "spin": [0, "pi"]},
            "picks": [pick for pick in picks if pick["name"].startswith(kind)],
        }
        (folder / f"{kind}.yaml").write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    (folder / "scene.yaml").write_text(yaml.safe_dump(scene, sort_keys=False), encoding="utf-8")
    return folder
