// Null-space goals: motions that use the degrees of freedom that a task leaves.
#pragma once

#include <vector>

#include "kinematics/chain.h"

namespace pinproof {

struct Goal {
    enum class Kind {
        none,
        posture,         // towards a configuration
        near,            // the posture from which a search starts
        manipulability,  // towards the largest manipulability
    };

    Kind kind = Kind::none;
    double gain = 0.0;            // the fraction of the way to the posture, or the step per unit of the gradient
    std::vector<double> posture;  // (n,)
    std::vector<double> weight;   // (n,) the share of each joint; for a posture only

    bool exists() const { return kind != Kind::none; }
};

// The step (n,) of a goal at q (n,) before its projection into the null space. `posture`, `jacobian` and `moved` (n,)
// are scratch; the posture is left at another configuration than q.
void goal_step(const Goal& goal, const Chain& chain, const double* q, Posture& posture, Jacobian& jacobian,
               std::vector<double>& moved, std::vector<double>& step);

}  // namespace pinproof
