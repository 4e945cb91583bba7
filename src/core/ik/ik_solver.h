// An arm, a task and a method with its settings, and the progress of a descent: when it stops, and how its damping grows.
#pragma once

#include <algorithm>
#include <limits>
#include <variant>
#include <vector>

#include "ik/fabrik_step.h"
#include "ik/step_rules.h"
#include "ik/task.h"
#include "kinematics/chain.h"
#include "kinematics/joint_range.h"

namespace pinproof {

// A descent has stalled if the squared residual has not fallen below the fraction `progress` within `patience` steps.
struct Stall {
    double progress;
    int patience;
};

// The state of a descent.
struct Progress {
    bool reached = false;  // the task is satisfied
    int iterations = 0;
    double squared_residual = std::numeric_limits<double>::infinity();  // of the best configuration

    double growth = 1.0;  // of the damping of ClikStep
    int waited = 0;       // steps since the last sufficient decrease of the residual

    // Additional steps for a goal after the task is satisfied. A step of a goal changes the task by the square of its
    // length only, which the following steps correct.
    static constexpr int kGoalSteps = 300;

    enum class Next { step, stop };
    struct Decision {
        Next next;
        bool best;  // the configuration is the best so far
    };

    // Decide after the residual has been computed; `here`: it satisfies the task.
    Decision observe(bool here, double squared, bool has_goal, const Stall& stall, int max_iterations) {
        const bool best = here || (!reached && squared < squared_residual);
        if (best) squared_residual = squared;
        reached = reached || here;
        if (here && !has_goal) return {Next::stop, best};
        if (squared < stall.progress * mark_) {
            mark_ = squared;
            marked_at_ = iterations;
        }
        waited = iterations - marked_at_;
        if (!reached && waited >= stall.patience) return {Next::stop, best};
        // The condition on the residual also ends the descent if it is NaN.
        const long long most = static_cast<long long>(max_iterations) + (reached ? kGoalSteps : 0);
        if (iterations >= most || !(squared < std::numeric_limits<double>::infinity())) return {Next::stop, best};
        growth = squared < last_ ? std::max(1.0, growth * ClikStep::kRelief) : growth * ClikStep::kGrowth;
        last_ = squared;
        return {Next::step, best};
    }

  private:
    double mark_ = std::numeric_limits<double>::infinity(), last_ = mark_;
    int marked_at_ = 0;
};

// An arm, a task and a method with its settings.
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
