// The loop of the iterative methods; it computes the same iterates as pinproof.ik.loop on Pinocchio.
#pragma once

#include <optional>
#include <variant>
#include <vector>

#include "ik/clik_step.h"
#include "ik/fabrik_step.h"
#include "ik/goal.h"
#include "ik/joint_range.h"
#include "ik/singular_step.h"
#include "ik/task.h"
#include "kinematics/chain.h"

namespace pinproof {

using StepRule = std::variant<ClikStep, SingularStep, FabrikStep>;

// A descent has stalled if the squared residual has not fallen below the fraction `progress` within `patience` steps.
struct Stall {
    double progress;
    int patience;
};

// An arm, a task and a method with its settings.
struct IkSolver {
    Chain chain;
    std::vector<JointRange> ranges;
    Task task;
    StepRule rule;
    int max_iterations;
    double max_step;  // the largest motion of a joint in one step, rad or m
    Stall stall;

    // Largest norm of the residual (m and rad together) that is passed to a step rule; longer residuals are scaled.
    static constexpr double kSaturation = 1.0;

    // rad or m. A descent stops if its step is at most this, which does not change a pose.
    static constexpr double kSmallestStep = 1e-12;

    // rad or m. A goal has converged if its step moves no joint by more than this.
    static constexpr double kGoalConverged = 1e-4;

    // Additional steps for a goal after the task is satisfied. A step of a goal changes the task by the square of its
    // length only, which the following steps correct.
    static constexpr int kGoalSteps = 300;
};

// One descent after another, with the memory that they need.
class Descent {
  public:
    // The solver must exist as long as the descent.
    explicit Descent(const IkSolver& solver);

    struct Result {
        bool reached;  // the task is satisfied
        int iterations;
        double squared_residual;
    };

    // Descend from q (n,) within the limits until the task is satisfied or the descent stalls. q becomes the best
    // configuration found.
    Result run(const Frame& target_from_base, const Goal& goal, const Stall& stall, std::vector<double>& q);

    // target_from_tcp at q.
    const Frame& look(const Frame& target_from_base, const double* q);

  private:
    void bounded_step(double growth, double squared_residual, bool drifts, const std::vector<double>& q, Twist pull);
    void rule_step(double growth, double squared_residual, const Twist& pull);
    void shorten();

    const IkSolver& solver_;
    Posture posture_;
    Jacobian jacobian_;
    std::vector<double> step_;   // of the joints
    std::vector<double> fixed_;  // its part that is known before the rule: the step of a goal, and motions to limits
    std::vector<double> best_, scratch_;
    std::vector<char> held_;  // the joints that are held at a limit
    SingularValues decomposition_;
    FabrikPasses passes_;
};

}  // namespace pinproof
