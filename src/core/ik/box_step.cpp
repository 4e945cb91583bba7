#include "ik/box_step.h"

#include <algorithm>

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

}  // namespace pinproof
