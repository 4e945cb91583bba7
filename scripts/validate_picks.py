#!/usr/bin/env python3
"""Judge a list of picks from Python: copy this and make it yours.

python scripts/validate_picks.py robots/ur5/picks.yaml out
"""

from __future__ import annotations

import sys
from pathlib import Path

import pinproof as pp


def main(file: Path, folder: Path) -> int:
    """Judge the picks of a file, write the report and the good motions; 0 if all are good, else 1."""
    picks = pp.read_picks(file)
    if picks.robot is None or picks.scene is None:
        sys.exit(f"{file} must name a robot and a scene")
    arm = pp.load_robot(picks.robot).arm(tcp=picks.tcp, held=picks.held)
    scene = pp.Scene.load(picks.scene)
    report = pp.validate_picks(arm, scene, picks, rng=0)

    folder.mkdir(parents=True, exist_ok=True)
    report.save(folder / "report.json")
    pp.write_report_page(folder / "report.html", report, arm, scene, picks)
    print(report.to_markdown())
    for verdict in report.good:
        verdict.trajectory.save(folder / f"{verdict.pick.name}.csv")
        for part in verdict.motions:  # several where an object is carried: it is not the same motion with and without
            page = folder / f"{verdict.pick.name}_{part.name}.html"
            motion, proof, held = part.trajectory, part.certificate, part.attached
            pp.write_html(page, arm, part.scene, motion, certificate=proof, attached=held)
    return 0 if report.ok else 1


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
