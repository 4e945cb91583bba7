#include "ik/goal.h"

#include <algorithm>
#include <cmath>

#include "kinematics/manipulability.h"

namespace pinproof {
namespace {

// rad or m, for central differences of the manipulability: truncation and rounding errors are both about 1e-10 of it.
constexpr double kFiniteStep = 1e-5;

// rad or m: the largest motion of a joint for a goal in one step, so that the task remains nearly satisfied.
constexpr double kLongestGoalStep = 0.2;

double log_manipulability_at(const Chain& chain, const double* q, Posture& posture, Jacobian& jacobian) {
    posture.evaluate(chain, Frame{}, q);
    posture.jacobian(chain, jacobian);
    return log_manipulability(jacobian);
}

}  // namespace

void goal_step(const Goal& goal, const Chain& chain, const double* q, Posture& posture, Jacobian& jacobian,
               std::vector<double>& moved, std::vector<double>& step) {
    double largest = 0.0;
    std::copy(q, q + chain.dof, moved.begin());
    for (std::size_t i = 0; i < chain.dof; ++i) {
        if (goal.kind == Goal::Kind::manipulability) {
            moved[i] = q[i] + kFiniteStep;
            const double above = log_manipulability_at(chain, moved.data(), posture, jacobian);
            moved[i] = q[i] - kFiniteStep;
            const double below = log_manipulability_at(chain, moved.data(), posture, jacobian);
            moved[i] = q[i];
            step[i] = goal.gain * (above - below) / (2.0 * kFiniteStep);
        } else {
            step[i] = goal.gain * goal.weight[i] * (goal.posture[i] - q[i]);
        }
        largest = std::max(largest, std::abs(step[i]));
    }
    if (largest > kLongestGoalStep)
        for (double& one : step) one *= kLongestGoalStep / largest;
}

}  // namespace pinproof
