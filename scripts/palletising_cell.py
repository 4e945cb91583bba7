"""Write the palletising cell of robots/ur10: 200 boxes, each with its pick and its place on one of two pallets.

python scripts/palletising_cell.py            writes the scene and the picks
python scripts/palletising_cell.py --check    exit code 1 if the files are not up to date
"""

from __future__ import annotations

from itertools import product
from pathlib import Path

from generated_files import main

FOLDER = Path(__file__).resolve().parents[1] / "robots" / "ur10"

BOX = 0.06, 0.06, 0.05
"""Sides of a box (m)."""

PITCH = 0.08
"""Distance (m) between the centres of neighbouring boxes."""

ROWS, COLUMNS, LAYERS = 5, 5, 4

TOP = 0.02
"""Height (m) of the upper side of a pallet."""

STACKS = {"supply_a": (0.05, 0.78), "supply_b": (0.05, -0.78), "pallet_1": (0.72, 0.26), "pallet_2": (0.72, -0.26)}
"""Centres (m) of the supplies and of the pallets."""

DECK = 0.42, 0.42, 0.02
COLOURS = {"a": "[0.80, 0.62, 0.25, 1]", "b": "[0.36, 0.55, 0.70, 1]"}

SCENE = """\
# A palletising cell: a UR10 moves 200 boxes from two supplies onto two pallets. Metres; the frame is the robot's root.
# Written by scripts/palletising_cell.py; SOURCE.md states the source of the numbers.
obstacles:
  - {{name: floor, box: [2.6, 2.6, 0.04], xyz: [0.2, 0, -0.025], rgba: [0.78, 0.78, 0.76, 1]}}
{decks}
{boxes}
allowed_contacts:
  - [base_link, floor] # the base is bolted to it
"""

PICKS = """\
# 200 picks and places with a UR10 and a suction cup. Metres and radians, in the frame of the robot's root.
# Written by scripts/palletising_cell.py in the order of the pallets: layer by layer, row by row.
robot: ur10
tcp: tool0
scene: pallet_scene.yaml
margin: 0.002
home:
  shoulder_pan_joint: 0
  shoulder_lift_joint: -1.9
  elbow_joint: 1.9
  wrist_1_joint: -1.57
  wrist_2_joint: -1.57
  wrist_3_joint: 0
tip: {{xyz: [0, 0, 0.15]}}
cup: {{radius: 0.015}}
tool:
  - {{name: lance, cylinder: {{radius: 0.012, length: 0.145}}, xyz: [0, 0, 0.0725], rgba: [0.2, 0.22, 0.25, 1]}}
  - {{name: bellows, cylinder: {{radius: 0.015, length: 0.005}}, xyz: [0, 0, 0.1475], rgba: [0.1, 0.1, 0.1, 1]}}
defaults: {{rpy: [pi, 0, 0], approach: 0.06, retreat: 0.06, spin: [0, pi]}}
picks:
{picks}
"""


def centre(stack: str, layer: int, row: int, column: int) -> str:
    """The centre of a box of a stack."""
    x, y = STACKS[stack]
    at = (
        x + (column - (COLUMNS - 1) / 2) * PITCH,
        y + (row - (ROWS - 1) / 2) * PITCH,
        TOP + (layer + 0.5) * BOX[2],
    )
    return f"[{', '.join(f'{value:.3f}' for value in at)}]"


def files() -> dict[Path, str]:
    """The content of the two files."""
    decks = [
        f"  - {{name: {name}_deck, box: [{', '.join(map(str, DECK))}], xyz: [{x}, {y}, {TOP - DECK[2] / 2}], "
        "rgba: [0.55, 0.45, 0.33, 1]}"
        for name, (x, y) in STACKS.items()
    ]
    sides = f"[{', '.join(map(str, BOX))}]"
    supply = {kind: f"supply_{kind}" for kind in "ab"}
    from_above = list(product(reversed(range(LAYERS)), range(ROWS), range(COLUMNS)))
    boxes = [
        f"  - {{name: {kind}{number:03}, box: {sides}, xyz: {centre(supply[kind], *spot)}, rgba: {COLOURS[kind]}}}"
        for kind in "ab"
        for number, spot in enumerate(from_above, 1)
    ]
    rows = []
    for pallet, *spot in product(("pallet_1", "pallet_2"), range(LAYERS), range(ROWS), range(COLUMNS)):
        name = f"{'ab'[len(rows) % 2]}{len(rows) // 2 + 1:03}"  # alternately from both supplies
        rows.append(
            f"  - {{name: {name}, frame: {name}, xyz: [0, 0, {BOX[2] / 2}], object: {name}, "
            f"place: {{object_pose: {{xyz: {centre(pallet, *spot)}}}, approach: 0.06, retreat: 0.06}}}}"
        )
    return {
        FOLDER / "pallet_scene.yaml": SCENE.format(decks="\n".join(decks), boxes="\n".join(boxes)),
        FOLDER / "pallet_picks.yaml": PICKS.format(picks="\n".join(rows)),
    }


if __name__ == "__main__":
    main(__doc__, files)
