"""A UR5 takes parts from a belt that does not stop; the certificates cover the motion of all parts on it."""

from dataclasses import replace

import pinproof as pp
from pinproof.description import robots_folder

picks = pp.read_picks(robots_folder() / "ur5" / "conveyor_picks.yaml")
report = pp.validate_picks(picks.load_arm(), picks.load_scene(), replace(picks, picks=picks.picks[:1]))
for verdict in report.verdicts:
    assert verdict.intercept is not None
    print(f"{verdict.pick.name}: {verdict.status.value}, met after {verdict.intercept.travel:.2f} m")
    for motion in verdict.motions:
        print(f"{motion.name:9} {motion.certificate.status.name}, among {len(motion.movers)} parts in motion")
report.save("conveyor.html")
