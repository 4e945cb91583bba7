// The damped least-squares step within a box, and the Gauss-Newton steps in a box of a tracking cycle.
#pragma once

#include <algorithm>
#include <vector>

#include "ik/task.h"
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

// Gauss-Newton steps in a box: the descent of a tracking cycle, and motions that preserve the residual at first order.
class BoxDescent {
  public:
    // Chain and task must exist as long as the descent.
    BoxDescent(const Chain& chain, const Task& task);

    // The configurations (n,) that may be reached, and the target; to be set before the other methods are called.
    std::vector<double> lower, upper;
    Frame target_from_base;

    double clamped(std::size_t i, double value) const { return std::min(std::max(value, lower[i]), upper[i]); }

    // The squared residual at q (n,).
    double look(const std::vector<double>& q);

    // The same, and the Jacobian of the residual.
    double look_closely(const std::vector<double>& q);
    const Jacobian& jacobian() const { return jacobian_; }

    // Descend in the box from q, which becomes the result; returns the squared residual.
    double converge(std::vector<double>& q);

    // Reduce a motion (n,) to the part that preserves the residual at q at first order, within the box.
    void keep_lost_motion(const std::vector<double>& q, std::vector<double>& motion);

    // Move q along the part of a motion that preserves the residual, and descend; returns the squared residual.
    double wander(std::vector<double>& q, std::vector<double>& motion);

  private:
    const Chain& chain_;
    const Task& task_;
    Posture posture_;
    Twist residual_;
    Jacobian jacobian_;
    BoxStep box_step_;
    std::vector<double> trial_;
};

}  // namespace pinproof
