// The progress of a descent: when it stops, and how its damping grows.
#pragma once

#include <algorithm>
#include <limits>

#include "ik/clik_step.h"

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

}  // namespace pinproof
