"""A shape of one's own: a cushion |x/a|^4 + |y/b|^4 + |z/c|^4 <= 1, by its farthest point in a direction."""

import numpy as np
import numpy.typing as npt

import pinproof as pp

half = np.array([0.15, 0.2, 0.05])


def farthest(direction: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    scaled = half * direction
    root = np.cbrt(np.abs(scaled)) * np.sign(scaled)
    return np.asarray(half * root / (np.abs(root) ** 4).sum() ** 0.25)


cushion = pp.ConvexShape.from_support(farthest, error=0.005)
bolster = pp.ConvexShape([(0, -0.2, 0), (0, 0.2, 0)], radius=0.05)  # a rod along y with round ends
arm = pp.load_robot("ur5").arm(tcp="tool0")
scene = pp.Scene(
    [pp.Obstacle("cushion", cushion, pp.pose((0.5, 0, 0.1))), pp.Obstacle("bolster", bolster, pp.pose((0.6, 0, 0.6)))]
)
scene.save("sofa.yaml")
checker = pp.CollisionChecker(arm, pp.Scene.load("sofa.yaml"), margin=0.002)
print(f"{len(cushion.points)} points, clearance {checker.clearance(arm.home):.4f} m")
