"""A UR5 picks bolts from a bin: every pick gets a verdict, and a failed one its stage, the reason and a suggestion."""

import pinproof as pp
from pinproof.description import robots_folder

picks = pp.read_picks(robots_folder() / "ur5" / "picks.yaml")
report = pp.validate_picks(picks.load_arm(), picks.load_scene(), picks)
for verdict in report.verdicts:
    print(f"{verdict.pick.name}: {verdict.status.value}; {verdict.reason}")
    for suggestion in verdict.suggestions:
        print(f"    suggestion: {suggestion}")
report.save("bolt_pick.html")
