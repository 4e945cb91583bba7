"""A bolt, a plate and a block, taken by a gripper or a suction cup; every grasp must hold its part."""

from dataclasses import replace

import pinproof as pp
from pinproof.description import robots_folder

picks = pp.read_picks(robots_folder() / "ur5" / "mixed_picks.yaml")
few = replace(picks, picks=picks.picks[:3])
report = pp.validate_picks(picks.load_arm(), picks.load_scene(), few)
for verdict in report.verdicts:
    print(f"{verdict.pick.name}: {verdict.status.value}; {verdict.reason}")
report.save("mixed_bin.html")
