#include "ik/box_descent.h"

#include <cmath>

namespace pinproof {
namespace {

// The smallest fraction of the improvement predicted by the linear model for which a step is accepted.
constexpr double kFaithful = 0.5;

// The damping of a step, per unit of the residual (m or rad); the box bounds the step, so that little is needed.
constexpr double kDamping = 1e-3;

// Far below the squares of relevant singular values, far above rounding.
constexpr double kSmallestDamping = 1e-14;

// Factors of the damping after a rejected and after an accepted step.
constexpr double kDampingGrowth = 8.0, kDampingRelief = 0.125;

// Maximum number of steps of one descent in a cycle. One or two are typical, about ten close to a singularity.
constexpr int kMostSteps = 20;

// m and rad: a residual below this is not reduced further; rounding is a hundred times smaller.
constexpr double kArrived = 1e-10;

// m and rad: a descent ends if the next step promises a smaller improvement.
constexpr double kGain = 1e-11;

// The square of a singular value below which a motion counts as singular, that is, preserves the residual.
constexpr double kLost = 1e-8;

}  // namespace

BoxDescent::BoxDescent(const Chain& chain, const Task& task)
    : lower(chain.dof),
      upper(chain.dof),
      chain_(chain),
      task_(task),
      posture_(chain),
      jacobian_(chain.dof),
      box_step_(chain.dof),
      trial_(chain.dof) {}

double BoxDescent::look(const std::vector<double>& q) {
    posture_.evaluate(chain_, target_from_base, q.data());
    residual_ = task_.residual(posture_.tcp());
    return squared_norm(residual_);
}

double BoxDescent::look_closely(const std::vector<double>& q) {
    const double squared = look(q);
    posture_.jacobian(chain_, jacobian_);
    task_.apply(posture_.tcp(), jacobian_);
    return squared;
}

double BoxDescent::converge(std::vector<double>& q) {
    double squared = look(q), damping = kDamping;
    Twist pull;
    bool accepted = true;
    for (int step = 0; step < kMostSteps && squared > kArrived * kArrived; ++step) {
        if (accepted) {  // the posture and the residual are those of q
            posture_.jacobian(chain_, jacobian_);
            task_.apply(posture_.tcp(), jacobian_);
            pull = residual_;
            for (std::size_t i = 0; i < q.size(); ++i) {
                box_step_.lower[i] = lower[i] - q[i];
                box_step_.upper[i] = upper[i] - q[i];
            }
        }
        const double size = std::sqrt(squared);
        const double promised = box_step_.solve(damping * size + kSmallestDamping, jacobian_, pull);
        if (!(promised > 2.0 * size * kGain)) break;  // the condition also ends the descent if the residual is NaN
        for (std::size_t i = 0; i < q.size(); ++i) trial_[i] = clamped(i, q[i] + box_step_.step()[i]);
        const double there = look(trial_);
        accepted = squared - there >= kFaithful * promised;
        if (accepted) {
            squared = there;
            damping = std::max(kDamping, kDampingRelief * damping);
            q = trial_;
        } else {
            damping *= kDampingGrowth;
        }
    }
    return squared;
}

void BoxDescent::keep_lost_motion(const std::vector<double>& q, std::vector<double>& motion) {
    look_closely(q);
    Twist pull;
    for (std::size_t i = 0; i < q.size(); ++i) {
        box_step_.lower[i] = lower[i] - q[i] - motion[i];
        box_step_.upper[i] = upper[i] - q[i] - motion[i];
        pull += motion[i] * jacobian_[i];
    }
    box_step_.solve(kLost, jacobian_, pull);
    for (std::size_t i = 0; i < q.size(); ++i) motion[i] += box_step_.step()[i];
}

double BoxDescent::wander(std::vector<double>& q, std::vector<double>& motion) {
    keep_lost_motion(q, motion);
    for (std::size_t i = 0; i < q.size(); ++i) q[i] = clamped(i, q[i] + motion[i]);
    return converge(q);
}

}  // namespace pinproof
