"""A UR5 with its calibration file: targets, certificates and programs are those of this one arm."""

from pathlib import Path

import numpy as np

import pinproof as pp

Path("calibration.conf").write_text("""[mounting]
delta_theta = [ -0.00113451165, -1.48004144, 0.0318778313, 1.45125122, -0.000251038519, 1e-05 ]
delta_a = [ 0.00102190862, 0.38693729, 0.344424277, 0.00072548692, -0.000875409178, 0 ]
delta_d = [ 0.00020959942, 151.485161, -309.210189, 157.724841, -0.00155912879, 0.000505902167 ]
delta_alpha = [ 0.000430804016, -0.00280775248, 0.00246253531, 0.000613955821, -0.00309440806, 0 ]
calibration_status = 2
""")
arm = pp.load_robot("ur5", calibration="calibration.conf").arm(tcp="tool0")
nominal = pp.load_robot("ur5").arm(tcp="tool0")
target = pp.pose((0.45, 0.1, 0.2), (np.pi, 0, 0))
q = pp.AnalyticIk().solve(nominal, target).or_raise().q
missed = arm.forward_kinematics(q).translation - target.translation
print(f"joint values of the nominal arm miss the target by {1e3 * np.linalg.norm(missed):.2f} mm")

motion = pp.plan(pp.CollisionChecker(arm), arm.home, target).or_raise()
reached = arm.forward_kinematics(motion.trajectory.end).translation
print(f"with the calibration: {1e3 * np.linalg.norm(reached - target.translation):.6f} mm", motion.certificate)
motion.to_html("calibrated_ur.html")
