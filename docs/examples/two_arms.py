"""Two UR5 reach over one bin: one certified motion of twelve joints, with the clearance between the arms proven too."""

import numpy as np

import pinproof as pp

ur5 = pp.load_robot("ur5").arm(tcp="tool0")
facing = pp.pose((0.45, 0, 0), (0, 0, np.pi))
cell = pp.assemble({"left": (ur5, pp.pose((-0.45, 0, 0))), "right": (ur5, facing)})
walls = [pp.Obstacle(f"wall_{y}", pp.Box(0.5, 0.02, 0.15), pp.pose((0, y, 0.08))) for y in (0.25, 0.55)]
checker = pp.CollisionChecker(cell, pp.Scene(walls), margin=0.005)


def reach(name: str, x: float) -> np.ndarray:
    arm, over_the_bin = cell.arms[name], pp.pose((x, 0.4, 0.3), (np.pi, 0, 0))
    return pp.AnalyticIk().solve_all(arm, arm.root_from_base.inverse() * over_the_bin).q[:8]


goals = np.array([[*left, *right] for left in reach("left", -0.1) for right in reach("right", 0.1)])
motion = pp.plan(checker, cell.home, goals[checker.is_free_batch(goals)]).or_raise()
print(motion.certificate)
motion.to_html("two_arms.html")
