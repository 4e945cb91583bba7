#include "ik/descent.h"

#include <algorithm>
#include <cmath>

namespace pinproof {
namespace {

double largest_of(const std::vector<double>& step) {
    double largest = 0.0;
    for (double one : step) largest = std::max(largest, std::abs(one));
    return largest;
}

}  // namespace

Descent::Descent(const IkSolver& solver)
    : solver_(solver),
      posture_(solver.chain),
      jacobian_(solver.chain.dof),
      step_(solver.chain.dof),
      fixed_(solver.chain.dof),
      best_(solver.chain.dof),
      scratch_(solver.chain.dof),
      held_(solver.chain.dof),
      decomposition_(solver.chain.dof),
      passes_(solver.chain.joints.size()) {}

Progress Descent::run(const Frame& target_from_base, const Goal& goal, const Stall& stall, std::vector<double>& q) {
    const Chain& chain = solver_.chain;
    const Task& task = solver_.task;
    const FabrikStep* fabrik = std::get_if<FabrikStep>(&solver_.rule);
    Progress progress;
    for (;; ++progress.iterations) {
        posture_.evaluate(chain, target_from_base, q.data());
        Twist residual = task.residual(posture_.tcp());
        const double squared = squared_norm(residual);
        const bool here = task.reached(residual);
        const auto [next, best] = progress.observe(here, squared, goal.exists(), stall, solver_.max_iterations);
        if (best) best_ = q;
        if (next == Progress::Next::stop) break;

        if (fabrik && squared > fabrik->squared_handover) {
            passes_.step(chain, solver_.ranges, task, posture_, q.data(), progress.iterations, progress.waited, step_);
        } else {
            if (here) {
                goal_step(goal, chain, q.data(), posture_, jacobian_, scratch_, fixed_);
                posture_.evaluate(chain, target_from_base, q.data());
            }
            posture_.jacobian(chain, jacobian_);
            task.apply(posture_.tcp(), jacobian_);
            double kept = squared;
            if (squared > IkSolver::kSaturation * IkSolver::kSaturation) {
                residual = (IkSolver::kSaturation / std::sqrt(squared)) * residual;
                kept = squared_norm(residual);
            }
            bounded_step(progress.growth, kept, here, q, residual);
        }
        const double largest = largest_of(step_);
        if (largest <= IkSolver::kSmallestStep || (here && largest <= IkSolver::kGoalConverged)) break;
        const double share = largest > solver_.max_step ? solver_.max_step / largest : 1.0;
        for (std::size_t i = 0; i < q.size(); ++i) q[i] = solver_.ranges[i].inside(q[i] + share * step_[i]);
    }
    q = best_;
    return progress;
}

// The step of the rule within the limits (active set), added to the step of a goal (if it `drifts`).
//
// Joints that would leave their limits are moved to them and held. The effect of that motion is added to the residual,
// and the rule is evaluated again for the remaining joints until none leaves its limits.
void Descent::bounded_step(double growth, double squared_residual, bool drifts, const std::vector<double>& q,
                           Twist pull) {
    const std::size_t n = q.size();
    std::fill(held_.begin(), held_.end(), false);
    if (drifts)
        for (std::size_t i = 0; i < n; ++i) pull += fixed_[i] * jacobian_[i];
    else
        std::fill(fixed_.begin(), fixed_.end(), 0.0);
    for (bool again = true; again;) {
        rule_step(growth, squared_residual, pull);
        shorten();
        again = false;
        for (std::size_t i = 0; i < n; ++i) {
            if (held_[i]) {
                step_[i] = fixed_[i];
                continue;
            }
            step_[i] += fixed_[i];
            const double there = q[i] + step_[i], stopped = solver_.ranges[i].stopped(there);
            if (stopped == there || std::isnan(there)) continue;
            again = true;
            held_[i] = true;
            pull += (stopped - q[i] - fixed_[i]) * jacobian_[i];
            fixed_[i] = stopped - q[i];
            jacobian_[i] = Twist{};
        }
    }
}

void Descent::rule_step(double growth, double squared_residual, const Twist& pull) {
    if (const SingularStep* singular = std::get_if<SingularStep>(&solver_.rule))
        return (*singular)(pull, jacobian_, decomposition_, step_);
    const FabrikStep* fabrik = std::get_if<FabrikStep>(&solver_.rule);
    const ClikStep& clik = fabrik ? fabrik->end : std::get<ClikStep>(solver_.rule);
    clik(growth, solver_.max_step, squared_residual, pull, jacobian_, step_);
}

// Scale the step of the rule such that no free joint moves by more than the longest step.
//
// It is scaled before the limits are applied: a very long step would hold joints at limits unnecessarily.
void Descent::shorten() {
    double largest = 0.0;
    for (std::size_t i = 0; i < step_.size(); ++i)
        if (!held_[i]) largest = std::max(largest, std::abs(step_[i]));
    if (largest > solver_.max_step)
        for (double& one : step_) one *= solver_.max_step / largest;
}

}  // namespace pinproof
