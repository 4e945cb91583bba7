"""A UR5 follows a closed contour with its tool: the best motion along the whole path, with a bound of the deviation."""

import numpy as np

import pinproof as pp

arm = pp.load_robot("ur5").arm()
table = pp.Obstacle("table", pp.Box(0.6, 1.2, 0.05), pp.pose((0.7, 0.0, 0.1)))
checker = pp.CollisionChecker(arm, pp.Scene([table]), margin=0.002)

angle = np.linspace(0.0, 2.0 * np.pi, 73)
contour = np.column_stack([0.45 + 0.12 * np.cos(angle), 0.12 * np.sin(angle), np.full(73, 0.2)])
path = pp.ToolPath.through(contour, (0.0, 0.0, 1.0), speed=0.1, name="contour")
seam = pp.follow(checker, path, approach=0.05)
print(seam.message)
seam.to_html("tool_path.html")
