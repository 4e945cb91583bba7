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

}  // namespace

GoalSteps::GoalSteps(const Chain& chain)
    : chain_(chain), posture_(chain), jacobian_(chain.dof), moved_(chain.dof), step_(chain.dof) {}

const std::vector<double>& GoalSteps::at(const Goal& goal, const double* q) {
    double largest = 0.0;
    moved_.assign(q, q + chain_.dof);
    for (std::size_t i = 0; i < chain_.dof; ++i) {
        if (goal.kind == Goal::Kind::manipulability) {
            moved_[i] = q[i] + kFiniteStep;
            const double above = log_manipulability_at(moved_);
            moved_[i] = q[i] - kFiniteStep;
            const double below = log_manipulability_at(moved_);
            moved_[i] = q[i];
            step_[i] = goal.gain * (above - below) / (2.0 * kFiniteStep);
        } else {
            step_[i] = goal.gain * goal.weight[i] * (goal.posture[i] - q[i]);
        }
        largest = std::max(largest, std::abs(step_[i]));
    }
    if (largest > kLongestGoalStep)
        for (double& one : step_) one *= kLongestGoalStep / largest;
    return step_;
}

double GoalSteps::log_manipulability_at(const std::vector<double>& q) {
    posture_.evaluate(chain_, Frame{}, q.data());
    posture_.jacobian(chain_, jacobian_);
    return log_manipulability(jacobian_);
}

}  // namespace pinproof
