"""A UR10 on a rail of 4 m: all configurations over the travel of the rail, and a certified motion along it."""

import numpy as np

import pinproof as pp

fixed = '<joint name="world_joint" type="fixed">'
rail = '<joint name="rail" type="prismatic"><axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="1" effort="1"/>'
arm = pp.load_robot(pp.load_robot("ur10").urdf.text.replace(fixed, rail)).arm(tcp="tool0")
racks = [pp.Obstacle(f"rack_{y}", pp.Box(0.5, 0.05, 0.9), pp.pose((0.85, y, 0.45))) for y in (-0.7, 0.0, 0.7)]
checker = pp.CollisionChecker(arm, pp.Scene(racks), margin=0.005)
left, right = (pp.pose((0.75, y, 0.5), (np.pi, 0, 0)) for y in (-1.1, 1.1))
found = pp.AnalyticIk().solve_all(arm, left)
print(found.message)

start = found.q[checker.is_free_batch(found.q)][0]
motion = pp.plan(checker, start, right).or_raise()
print(f"{motion.duration:.2f} s", motion.certificate)
motion.to_html("rail.html")
