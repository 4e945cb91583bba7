#include "ik/box_descent.h"

#include <algorithm>
#include <cmath>

#include "algebra/least_squares.h"

namespace pinproof {
namespace {

// Maximum number of changes of the active set per joint; the step is then used as it is, which is feasible. More than
// two are rare; the limit only ends cycles due to rounding.
constexpr std::size_t kChanges = 4;

// Maximum number of increases of the shift, and their factor, until the matrix is numerically positive definite; more
// than one is rare.
constexpr int kMostGrowths = 20;
constexpr double kGrowth = 4.0;

}  // namespace

BoxStep::BoxStep(std::size_t joints)
    : lower(joints), upper(joints), step_(joints), optimum_(joints), held_(joints), free_(joints) {}

double BoxStep::solve(double shift, const Jacobian& a, const Twist& pull) {
    for (std::size_t i = 0; i < step_.size(); ++i) step_[i] = std::min(std::max(0.0, lower[i]), upper[i]);
    std::fill(held_.begin(), held_.end(), Held::free);
    free_ = a;
    left_ = pull;
    Factor6 factor;
    for (std::size_t change = 0; change < kChanges * step_.size(); ++change) {
        const Symmetric6 square = gram(free_);
        bool exists = factor.factorise(square, shift);
        for (int growths = 1; !exists && growths < kMostGrowths; ++growths)
            exists = factor.factorise(square, shift *= kGrowth);
        const Twist x = factor.solve(left_);
        for (std::size_t i = 0; i < step_.size(); ++i) optimum_[i] = -dot(a[i], x);
        if (!advance(a) && !release(a)) break;
    }
    Twist effect;
    for (std::size_t i = 0; i < step_.size(); ++i) effect += step_[i] * a[i];
    return -dot(effect, 2.0 * pull + effect);
}

// Move the free joints towards their optimum, up to the first that meets a bound, which is then held; returns whether
// one did.
bool BoxStep::advance(const Jacobian& a) {
    double share = 1.0;
    std::size_t stopped = step_.size();
    for (std::size_t i = 0; i < step_.size(); ++i) {
        if (held_[i] != Held::free || (optimum_[i] >= lower[i] && optimum_[i] <= upper[i])) continue;
        const double bound = optimum_[i] > upper[i] ? upper[i] : lower[i];
        const double part = (bound - step_[i]) / (optimum_[i] - step_[i]);
        if (part < share) {
            share = part;
            stopped = i;
        }
    }
    for (std::size_t i = 0; i < step_.size(); ++i)
        if (held_[i] == Held::free) step_[i] += share * (optimum_[i] - step_[i]);
    if (stopped == step_.size()) return false;
    const bool beyond = optimum_[stopped] > upper[stopped];
    held_[stopped] = beyond ? Held::at_upper : Held::at_lower;
    step_[stopped] = beyond ? upper[stopped] : lower[stopped];
    left_ += step_[stopped] * a[stopped];
    free_[stopped] = Twist{};
    return true;
}

// Release the held joint whose optimum is farthest inside the box; returns whether there is one. The gradient at a held
// joint is shift (step - optimum).
bool BoxStep::release(const Jacobian& a) {
    double farthest = 0.0;
    std::size_t released = step_.size();
    for (std::size_t i = 0; i < step_.size(); ++i) {
        const double inward = static_cast<double>(held_[i]) * (step_[i] - optimum_[i]);
        if (inward > farthest) {
            farthest = inward;
            released = i;
        }
    }
    if (released == step_.size()) return false;
    held_[released] = Held::free;
    left_ += -step_[released] * a[released];
    free_[released] = a[released];
    return true;
}

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
