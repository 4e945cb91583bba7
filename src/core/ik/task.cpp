#include "ik/task.h"

#include <algorithm>
#include <cmath>

#include "geometry/rotations.h"
#include "kinematics/chain.h"

namespace pinproof {

Task::Task(const std::array<bool, 6>& coordinates, double position_tolerance, double orientation_tolerance)
    : positions(0), angles(0), position_tolerance(position_tolerance), orientation_tolerance(orientation_tolerance) {
    for (int i = 0; i < 3; ++i) {
        mask.linear[i] = coordinates[i] ? 1.0 : 0.0;
        mask.angular[i] = coordinates[i + 3] ? 1.0 : 0.0;
        positions += coordinates[i];
        angles += coordinates[i + 3];
    }
}

Twist Task::residual(const Frame& target_from_tcp) const {
    const Double4 rotation = widened(rotation_vector(rotation_of(target_from_tcp)));
    return {mask.linear * target_from_tcp.origin, mask.angular * rotation};
}

void Task::apply(const Frame& target_from_tcp, Jacobian& jacobian) const {
    if (positions == 3 && angles == 3) return;
    if (angles == 1 || angles == 2) {
        const Double4 v = widened(rotation_vector(rotation_of(target_from_tcp)));
        const double square = dot(v, v), c = left_jacobian_coefficient(square);
        for (Twist& column : jacobian) {
            const Double4 w = column.angular;
            column.angular = w - 0.5 * cross(v, w) + c * (dot(v, w) * v - square * w);
        }
    }
    for (Twist& column : jacobian) {
        column.linear *= mask.linear;
        column.angular *= mask.angular;
    }
}

double left_jacobian_coefficient(double squared_angle) {
    // c = 1/t^2 - (1 + cos t) / (2 t sin t), with (1 + cos) / sin = 1 / tan(t/2)
    const double angle = std::sqrt(squared_angle);
    return angle < 1e-3 ? 1.0 / 12.0 : (1.0 - 0.5 * angle / std::tan(0.5 * angle)) / squared_angle;
}

bool Task::reached(const Twist& residual) const {
    return dot(residual.linear, residual.linear) <= position_tolerance * position_tolerance &&
           dot(residual.angular, residual.angular) <= orientation_tolerance * orientation_tolerance;
}

PoseError measure(const Task& task, const Transform& base_from_target, const Transform& base_from_tcp) {
    Mat3 relative;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            relative.m[i][j] = dot(base_from_target.rotation.column(i), base_from_tcp.rotation.column(j));
    const Vec3 shift =
        transposed_times(base_from_target.rotation, base_from_tcp.translation - base_from_target.translation);
    Twist error{widened(shift), widened(rotation_vector(relative))};
    if (task.positions > 0) error.linear *= task.mask.linear;
    if (task.angles > 0) error.angular *= task.mask.angular;
    return {std::sqrt(dot(error.linear, error.linear)), std::sqrt(dot(error.angular, error.angular))};
}

bool fulfils(const Task& task, const PoseError& error) {
    return (task.positions == 0 || error.position <= task.position_tolerance) &&
           (task.angles == 0 || error.orientation <= task.orientation_tolerance);
}

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
