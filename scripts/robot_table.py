"""Generate the tables of docs/robots.md: the catalogue, and each URDF of example-robot-data with its verdict.

python scripts/robot_table.py            writes the tables to docs/robots.md; 20 s
python scripts/robot_table.py --check    exit code 1 if the tables in docs/robots.md are not up to date
"""

from __future__ import annotations

from collections import Counter
from importlib.metadata import version
from pathlib import Path

from generated_files import main, with_tables

import pinproof as pp
from pinproof.description import catalogue_names, find_robot, robots_folder
from pinproof.description.ros_files import example_robot_data
from pinproof.model import kinematic_class

PAGE = Path(__file__).resolve().parents[1] / "docs" / "robots.md"


def catalogue_table() -> str:
    """One row for each catalogue name."""
    rows = ["| name | file | base | tcp | arm | SRDF |", "|---|---|---|---|---|---|"]
    for name in catalogue_names():
        entry, arm = find_robot(name), pp.load_robot(name).arm()
        srdf = "yes" if entry.srdf is not None else "no"
        if entry.overlaps:
            srdf += f", and {len(entry.overlaps)} overlap{'' if len(entry.overlaps) == 1 else 's'}"
        rows.append(f"| `{name}` | {_file(entry.urdf)} | {arm.base} | {arm.tcp} | {kinematic_class(arm)} | {srdf} |")
    return "\n".join(rows)


def urdf_table() -> str:
    """One row for each URDF of example-robot-data."""
    folder = _shared()
    rows = [
        f"example-robot-data {version('example-robot-data')}:",
        "",
        "| URDF | joints that move | by type | collision geometries | SRDF beside it | verdict |",
        "|---|--:|---|--:|---|---|",
    ]
    for file in sorted(folder.rglob("*.urdf")):
        name = file.relative_to(folder)
        srdf = "yes" if any((folder / name.parts[0]).rglob("*.srdf")) else "no"
        try:
            robot = pp.load_robot(file)
        except pp.PinproofError as error:
            reason = str(error).removeprefix(f"{file}: ").split("; valid: ")[0]
            rows.append(f"| {name} | | | | {srdf} | **refused**: {reason} |")
            continue
        kinds = Counter("mimic" if j.mimic is not None else j.type for j in robot.urdf.joints.values())
        moving = sum(count for kind, count in kinds.items() if kind not in ("fixed", "mimic"))
        types = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items())) or "none"
        verdict = "; ".join(["loads", *_remarks(robot)])
        rows.append(f"| {name} | {moving} | {types} | {len(robot.urdf.collisions)} | {srdf} | {verdict} |")
    return "\n".join(rows)


def page(text: str) -> str:
    """The text of the page with new tables."""
    return with_tables(text, "robot_table.py", {"catalogue": catalogue_table(), "urdfs": urdf_table()})


def _remarks(robot: pp.Robot) -> list[str]:
    """Missing data of a URDF: meshes that are not found, and joints without limits."""
    notes = [
        f"{len(lost)} {kind} meshes not found"
        for kind, geometries in (("collision", robot.urdf.collisions), ("visual", robot.urdf.visuals))
        if (lost := [g for g in geometries if g.mesh is not None and g.mesh.path is None])
    ]
    endless = [
        joint.name
        for joint in robot.urdf.joints.values()
        if joint.type in ("revolute", "prismatic") and None in (joint.lower, joint.upper)
    ]
    if endless:
        notes.append(f"no limits stated for {', '.join(endless)}")
    return notes


def _shared() -> Path:
    share = example_robot_data()
    if share is None:
        raise SystemExit("example-robot-data is not installed")
    return share / "example-robot-data" / "robots"


def _file(urdf: Path) -> str:
    if urdf.is_relative_to(robots_folder()):
        return f"robots/{urdf.relative_to(robots_folder())}"
    return str(urdf.relative_to(_shared()))


if __name__ == "__main__":
    main(__doc__, lambda: {PAGE: page(PAGE.read_text(encoding="utf-8"))})
