// The damped least-squares step within a box: a small convex problem, solved exactly by an active set.
//
// Source: Stark, Parker (1995), "Bounded-variable least-squares: an algorithm and applications". With damping the
// minimum is unique, and the 6 x 6 form A^T (A A^T + shift I)^-1 is valid for any number of joints.
#pragma once

#include <vector>

#include "kinematics/chain.h"

namespace pinproof {

class BoxStep {
  public:
    explicit BoxStep(std::size_t joints);

    // The bounds of the step (n,), to be set before `solve`.
    std::vector<double> lower, upper;

    // The step d within the bounds that minimises |A d + pull|^2 + shift |d|^2. Returns |pull|^2 - |A d + pull|^2.
    double solve(double shift, const Jacobian& a, const Twist& pull);

    const std::vector<double>& step() const { return step_; }

    enum class Held : signed char { at_lower = -1, free = 0, at_upper = 1 };
    const std::vector<Held>& held() const { return held_; }

  private:
    bool advance(const Jacobian& a);
    bool release(const Jacobian& a);

    std::vector<double> step_;
    std::vector<double> optimum_;  // of the free joints, without bounds
    std::vector<Held> held_;
    Jacobian free_;  // the columns of A of the free joints; those of the others are zero
    Twist left_;     // pull, and the effect of the held joints
};

}  // namespace pinproof
