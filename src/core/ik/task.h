// Tasks: the coordinates of the target pose that count, their residual and its Jacobian.
//
// With target_from_tcp = E, the identity at a solution of the complete pose,
//
//     r = (translation of E, rotation vector of E),   coordinates that the task does not select are zero
//     dr/dq = (v, Jl^-1 w) with the Jacobian of the tcp (v, w) in the axes of the target
//
// Jl is the left Jacobian of SO(3). Since Jl e = e for its own rotation vector e, the Newton step and the gradient of
// |r|^2 do not change without this factor if all three angles are selected; it is then omitted.
//
// Source: Sola, Deray, Atchuthan (2018), "A micro Lie theory for state estimation in robotics", eqs. 132, 146.
#pragma once

#include <array>
#include <vector>

#include "kinematics/chain.h"

namespace pinproof {

struct Task {
    Task(const std::array<bool, 6>& coordinates, double position_tolerance, double orientation_tolerance);

    // 1 for coordinates that count, else 0; x, y, z and rx, ry, rz in the axes of the target.
    Twist mask;
    int positions, angles;                             // how many of them count
    double position_tolerance, orientation_tolerance;  // m and rad

    Twist residual(const Frame& target_from_tcp) const;

    // Transform the Jacobian of the tcp in the axes of the target into that of the residual, in place.
    void apply(const Frame& target_from_tcp, Jacobian& jacobian) const;

    // Whether the residual is within the tolerances.
    bool reached(const Twist& residual) const;
};

// c in the inverse of the left Jacobian of SO(3), Jl^-1(v) = I - [v]/2 + c [v]^2, from the square of the angle |v|.
double left_jacobian_coefficient(double squared_angle);

// Distance in m and angle in rad.
struct PoseError {
    double position = 0.0, orientation = 0.0;
};

// The errors of a pose. Only coordinates that the task selects count; if it selects no position or no orientation, all
// three do.
PoseError measure(const Task& task, const Transform& base_from_target, const Transform& base_from_tcp);

// Whether measured errors are within the tolerances of what the task selects.
bool fulfils(const Task& task, const PoseError& error);

// Null-space goals: motions that use the degrees of freedom that a task leaves.
struct Goal {
    enum class Kind {
        none,
        posture,         // towards a configuration
        near,            // the posture from which a search starts
        manipulability,  // towards the largest manipulability
    };

    Kind kind = Kind::none;
    double gain = 0.0;            // the fraction of the distance to the posture, or the step per unit of the gradient
    std::vector<double> posture;  // (n,)
    std::vector<double> weight;   // (n,) the share of each joint; for a posture only

    bool exists() const { return kind != Kind::none; }
};

// Computes the steps of goals for one chain, which must exist as long as it.
class GoalSteps {
  public:
    explicit GoalSteps(const Chain& chain);

    // The step (n,) of a goal at q (n,) before its projection into the null space.
    const std::vector<double>& at(const Goal& goal, const double* q);

  private:
    double log_manipulability_at(const std::vector<double>& q);

    const Chain& chain_;
    Posture posture_;
    Jacobian jacobian_;
    std::vector<double> moved_, step_;
};

}  // namespace pinproof
