"""Where should the robot stand? The placement of the base at which all picks work, with the shortest cycle time."""

from dataclasses import replace

import pinproof as pp
from pinproof.cell import PlacementBudget, PlacementRegion
from pinproof.description import robots_folder

picks = pp.read_picks(robots_folder() / "ur5" / "picks.yaml")
picks = replace(picks, picks=[pick for pick in picks if pick.name in ("bolt_1", "bolt_2", "bolt_5")])
arm, scene = picks.load_arm(), picks.load_scene()
walkway = pp.Obstacle("walkway", pp.Box(1.0, 0.4, 1.0), pp.pose((0, -0.6, 0)))
region = PlacementRegion(x=(-0.4, 0.1), y=(-0.5, 0.5), yaw=(-3.14, 3.14), forbidden=(walkway,))
few = PlacementBudget(grid=60, runs=1, evaluations=8, certified=1, deviations=0)  # a quick look
found = pp.place_base(arm, scene, picks, region, placement_budget=few)
best = found.best
print(f"x {best.placement.x:.2f} m, y {best.placement.y:.2f} m, cycle time {best.cycle_time:.2f} s")
best.report.save("cell_placement.html")
print(f"{len(best.report.good)} of {len(picks)} picks certified")
