// The loop of the methods other than Clik, see clik_lanes.h; it computes the same iterates as pinproof.ik.loop.
#pragma once

#include <vector>

#include "algebra/singular_values.h"
#include "ik/ik_solver.h"
#include "ik/task.h"
#include "kinematics/chain.h"

namespace pinproof {

// One descent after another, with the memory that they need.
class Descent {
  public:
    // The solver must exist as long as the descent.
    explicit Descent(const IkSolver& solver);

    // Descend from q (n,) within the limits until the task is satisfied or the descent stalls. q becomes the best
    // configuration found.
    Progress run(const Frame& target_from_base, const Goal& goal, const Stall& stall, std::vector<double>& q);

  private:
    void bounded_step(double growth, double squared_residual, bool drifts, const std::vector<double>& q, Twist pull);
    void rule_step(double growth, double squared_residual, const Twist& pull);
    void shorten();

    const IkSolver& solver_;
    Posture posture_;
    Jacobian jacobian_;
    std::vector<double> step_;   // of the joints
    std::vector<double> fixed_;  // its part that is known before the rule: the step of a goal, and motions to limits
    std::vector<double> best_;
    std::vector<char> held_;  // the joints that are held at a limit
    SingularValues decomposition_;
    FabrikPasses passes_;
    GoalSteps goal_steps_;
};

}  // namespace pinproof
