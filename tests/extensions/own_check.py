"""Picks with a check, a column and an executor of one's own."""

from concurrent.futures import ThreadPoolExecutor

import pinproof as pp

arm = pp.load_robot("ur5").arm(tcp="tool0")
table = pp.Obstacle("table", pp.Box(1.2, 1.6, 0.04), pp.pose((0.4, 0, -0.025)))
scene = pp.Scene([table], allowed=[("base_link", "table")])
picks = [pp.Pick(f"at {x}", pp.pose((x, 0.2, 0.05), (3.1416, 0, 0)), retreat=0.1) for x in (0.35, 0.6)]
camera = pp.pose((0.9, 0.2, 0.3)).translation


def visible_from_camera(task: pp.picks.PickTask, candidate: pp.picks.GraspCandidate) -> str | None:
    """A thin rod from the camera to 50 mm before the tip touches no link."""
    tip = task.arm.forward_kinematics(candidate.q).translation
    before = tip + 0.05 * (camera - tip) / sum((camera - tip) ** 2) ** 0.5
    sight = pp.Obstacle("sight", pp.ConvexShape([camera, before], radius=0.001))
    contacts = pp.CollisionChecker(task.arm, pp.Scene([sight])).check(candidate.q).contacts
    hiding = [contact.bodies[0] for contact in contacts if contact.bodies[1] == "sight"]
    return f"{hiding[0]} hides the tip" if hiding else None


with ThreadPoolExecutor(2) as executor:  # any executor; processes need checks that are importable by name
    report = pp.validate_picks(arm, scene, picks, checks=[visible_from_camera], executor=executor)
print(report.with_columns({"reach": lambda verdict: f"{verdict.pick.pose.translation[0]} m"}))
