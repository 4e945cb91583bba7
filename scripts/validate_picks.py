#!/usr/bin/env python3
"""Validate a list of picks from Python, as a template for your own program.

python scripts/validate_picks.py robots/panda/bin_picks.yaml out [PICK ...]

Writes the report and the motions of the good picks to ``out``, and pages of the motions of the named picks.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pinproof as pp


def main(file: Path, folder: Path, shown: list[str]) -> int:
    """Validate the picks of a file and write the results; return 0 if all are good, else 1."""
    picks = pp.read_picks(file)
    if picks.robot is None or picks.scene is None:
        sys.exit(f"{file} must name a robot and a scene")
    arm = pp.load_robot(picks.robot).arm(tcp=picks.tcp, held=picks.held)
    scene = pp.Scene.load(picks.scene)
    report = pp.validate_picks(arm, scene, picks, rng=0)

    folder.mkdir(parents=True, exist_ok=True)
    report.save(folder / "report.json")
    report.save(folder / "report.html")
    print(report.to_markdown())
    for verdict in report.good:  # with an object, a pick has several motions with a certificate each
        verdict.trajectory.save(folder / f"{verdict.pick.name}.csv")
        for part in verdict.motions if verdict.pick.name in shown else ():
            page, around = folder / f"{verdict.pick.name}_{part.name}.html", (arm.with_held(part.held), part.scene)
            pp.write_html(page, *around, part.trajectory, certificate=part.certificate, attached=part.attached)
    return 0 if report.ok else 1


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:]))
