"""Inverse kinematics with objectives, and with a step rule, of one's own."""

import numpy as np
import numpy.typing as npt

import pinproof as pp

Array = npt.NDArray[np.float64]
arm = pp.load_robot("panda").arm(tcp="panda_hand")
target = pp.pose((0.45, 0.2, 0.4), (np.pi, 0, 0))


def elbow_aside(q: Array) -> float:
    return float(arm.frame_placement(q, "panda_link4").translation[1])


class Transpose(pp.ik.IterativeIk):
    """Wolovich and Elliott (1984): along the transposed Jacobian, as far as reduces the error the most."""

    def step_rule(self) -> pp.ik.StepRule:
        def step(residual: Array, jacobian: Array, /) -> Array:
            descent = jacobian.T @ residual
            across = jacobian @ descent
            return np.asarray(-descent * (across @ residual) / max(float(across @ across), 1e-12))

        return step


goal = [(1.0, elbow_aside), (0.01, pp.ik.posture(arm.home))]  # weighted costs, in the null space of the pose
found = pp.Clik().solve(arm, target, goal=goal).or_raise()
print(
    f"elbow at y = {elbow_aside(pp.Clik().solve(arm, target).q):.3f} m, with the goal at {elbow_aside(found.q):.3f} m"
)
camera = pp.ik.look_at(arm, (0.6, 0, 0))  # the z axis of the tcp points at it; the task leaves the orientation free
print(pp.Clik().solve(arm, target, task="position", goal=camera))
print(Transpose(max_iterations=2000, position_tolerance=1e-4, orientation_tolerance=1e-4).solve(arm, target))
