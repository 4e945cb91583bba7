"""A motion of a program of one's own: joints that swing, with the largest speed of each from its derivative."""

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

import pinproof as pp

arm = pp.load_robot("ur5").arm(tcp="tool0")
shelf = pp.Obstacle("shelf", pp.Box(0.3, 0.8, 0.02), pp.pose((0.8, 0, 0.3)))
checker = pp.CollisionChecker(arm, pp.Scene([shelf]), margin=0.005)
amplitude, rate = np.array([0.5, 0.1, 0.1, 0.2, 0.0, 1.0]), 1.5


def swing(t: float) -> npt.NDArray[np.float64]:
    return np.asarray(arm.home + amplitude * np.sin(rate * t))


certificate = pp.certify(swing, checker, domain=(0.0, 4.0), speed_bound=amplitude * rate)
print(certificate)

times = np.linspace(0.0, 4.0, 20)
spline = CubicSpline(times, [swing(t) for t in times])
print(pp.certify(spline, checker))  # polynomials are proven exactly: nothing is trusted
