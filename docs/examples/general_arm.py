"""An arm of six joints without a closed form: all configurations of a pose within the limits, not one of them."""

import numpy as np

import pinproof as pp

arm = pp.load_robot("xarm6").arm()
target = arm.forward_kinematics([-2.1, -0.5, -2.7, -3.3, -0.6, 0.8])
found = pp.AnalyticIk().solve_all(arm, target)
print(found.message, "; complete:", found.complete)
for q in found.branches:
    error = arm.forward_kinematics(q).translation - target.translation
    print(np.round(q, 3), f"{np.linalg.norm(error):.0e} m")
pp.write_html("general_arm.html", arm, q=found.branches[0], ghosts=found.branches[1:])
