"""A depth image becomes an obstacle: space that the camera did not see counts as occupied."""

import numpy as np

import pinproof as pp
from pinproof.collision import Intrinsics

camera = Intrinsics(fx=300, fy=300, cx=159.5, cy=119.5, width=320, height=240)
root_from_camera = pp.pose((0.5, 0.0, 1.4), (np.pi, 0, 0))  # looks straight down
depth = np.full((240, 320), 1.4)  # the table, at z = 0
depth[60:110, 200:250] = 1.15  # a box of 0.25 m
depth[130:145, 60:75] = 1.0  # a post of 0.4 m
bounds = [(0.15, -0.55, -0.05), (0.85, 0.55, 0.7)]
grid = pp.OccupancyGrid.from_depth(depth, camera, root_from_camera, voxel=0.01, bounds=bounds)
print(grid)

arm = pp.load_robot("ur5").arm(tcp="tool0")
checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("camera", grid)]), margin=0.002)
left, right = (pp.pose((0.5, y, 0.15), (np.pi, 0, 0)) for y in (-0.35, 0.35))
q = pp.AnalyticIk().solve(arm, left, accept=checker.is_free).or_raise().q
motion = pp.plan(checker, q, right).or_raise()
print(motion.certificate)
motion.to_html("depth_image.html")
