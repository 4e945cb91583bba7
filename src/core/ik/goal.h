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
