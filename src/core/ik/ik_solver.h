// An arm, a task and a method with its settings.
#pragma once

#include <variant>
#include <vector>

#include "ik/clik_step.h"
#include "ik/fabrik_step.h"
#include "ik/joint_range.h"
#include "ik/progress.h"
#include "ik/singular_step.h"
#include "ik/task.h"
#include "kinematics/chain.h"

namespace pinproof {

using StepRule = std::variant<ClikStep, SingularStep, FabrikStep>;

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
};

}  // namespace pinproof
