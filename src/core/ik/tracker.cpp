#include "ik/tracker.h"

#include <cmath>
#include <utility>

namespace pinproof {
namespace {

// The fraction of the last motion with which a cycle starts. Below 1, so that self-motion that no goal requires decays
// within about ten cycles.
constexpr double kFading = 0.9;

// m and rad: a cycle with a larger residual has not reached its target; goals are then ignored.
constexpr double kSlip = 1e-8;

// The fraction of the speed limit that is used, so that quotients of the results do not exceed it by rounding.
constexpr double kFullSpeed = 1.0 - 1e-12;

// m and rad: by how much an error may increase to keep the branch. An extended arm remains bent by about 1e-4.
constexpr double kSlack = 1e-7;

// The factor by which an error may increase to keep the branch, while the target returns.
constexpr double kWorth = 1.5;

// rad or m: the largest motion tried across a singularity, and the number of its halvings.
constexpr double kMostBend = 0.1;
constexpr int kBends = 16;

// m and rad: the smallest improvement that a motion away from a saddle must bring.
constexpr double kEscape = 1e-9;

bool slips(double squared) { return squared > kSlip * kSlip; }

// now + reach, rounded such that its difference to `now` is at most |reach|.
double within(double now, double reach) {
    double there = now + reach;
    while (std::abs(there - now) > std::abs(reach)) there = std::nextafter(there, now);
    return there;
}

// The sign of the determinant of a matrix (n, n), which is overwritten; 1 or -1 also if it is singular.
bool determinant_is_positive(std::vector<double>& matrix, std::size_t n) {
    const auto at = [&](std::size_t i, std::size_t j) -> double& { return matrix[i * n + j]; };
    bool positive = true;
    for (std::size_t c = 0; c < n; ++c) {  // Gaussian elimination with partial pivoting
        std::size_t pivot = c;
        for (std::size_t r = c + 1; r < n; ++r)
            if (std::abs(at(r, c)) > std::abs(at(pivot, c))) pivot = r;
        if (at(pivot, c) == 0.0) return positive;
        if (pivot != c) {
            positive = !positive;
            for (std::size_t i = c; i < n; ++i) std::swap(at(c, i), at(pivot, i));
        }
        if (at(c, c) < 0.0) positive = !positive;
        for (std::size_t r = c + 1; r < n; ++r) {
            const double share = at(r, c) / at(c, c);
            for (std::size_t i = c + 1; i < n; ++i) at(r, i) -= share * at(c, i);
        }
    }
    return positive;
}

}  // namespace

Tracker::Tracker(const TrackingTask& tracking, std::vector<double> q0)
    : tracking_(tracking),
      descent_(tracking.chain, tracking.task),
      q_(std::move(q0)),
      began_(q_.size()),
      rate_(q_.size()),
      goal_(tracking.goal),
      goal_steps_(tracking.chain),
      best_(q_.size()),
      motion_(q_.size()),
      trial_(q_.size()) {}

void Tracker::step(const Transform& base_from_target, double duration) {
    descent_.target_from_base = frame_of(inverse(base_from_target));
    began_ = q_;
    for (std::size_t i = 0; i < q_.size(); ++i) {
        const double reach = kFullSpeed * tracking_.speed[i] * duration;
        descent_.lower[i] = std::max(tracking_.lower[i], within(began_[i], -reach));
        descent_.upper[i] = std::min(tracking_.upper[i], within(began_[i], reach));
        q_[i] = descent_.clamped(i, began_[i] + kFading * rate_[i] * duration);
    }
    const bool reached = !slips(cycle());
    // The motion of a goal is not part of the rate, because the goal is evaluated in each cycle.
    for (std::size_t i = 0; i < q_.size(); ++i) rate_[i] = duration > 0.0 ? (q_[i] - began_[i]) / duration : 0.0;
    if (!reached) return;
    side_ = Side::unknown;
    if (goal_.exists()) move_for_goal(duration);
}

void Tracker::resume(const State& state) {
    q_ = state.q;
    rate_ = state.rate;
    side_ = state.side;
}

// One cycle from the extrapolated configuration; returns the squared residual.
double Tracker::cycle() {
    const bool moving = descent_.look(q_) < descent_.look(began_);
    if (!moving) q_ = began_;
    double squared = descent_.converge(q_);
    if (slips(squared) && moving && side_ == Side::unknown) {
        best_ = q_;
        q_ = began_;
        const double other = descent_.converge(q_);
        if (std::sqrt(other) > std::sqrt(squared) + kSlack)
            q_ = best_;
        else
            squared = other;
    }
    const bool slipped = slips(squared);
    if (slipped) squared = leave_saddle(squared);
    if (slipped || side_ != Side::unknown) {
        if (side_ == Side::unknown) side_ = side_at(began_);
        if (side_at(q_) == opposite(side_)) squared = return_to_side(squared);
    }
    return squared;
}

void Tracker::move_for_goal(double duration) {
    best_ = q_;
    goal_.gain = std::min(1.0, tracking_.goal.gain * duration);
    motion_ = goal_steps_.at(goal_, q_.data());
    if (slips(descent_.wander(q_, motion_))) q_ = best_;
}

// Move q away from a saddle within the box, if that reduces the residual; returns the squared residual.
double Tracker::leave_saddle(double squared) {
    best_ = q_;
    for (std::size_t i = 0; i < q_.size(); ++i)
        if (q_[i] == descent_.lower[i] || q_[i] == descent_.upper[i]) return squared;
    for (double sense : {1.0, -1.0}) {
        q_ = best_;
        for (std::size_t i = 0; i < q_.size(); ++i) motion_[i] = sense * (descent_.upper[i] - descent_.lower[i]);
        const double other = descent_.wander(q_, motion_);
        if (std::sqrt(other) < std::sqrt(squared) - kEscape) return other;
    }
    q_ = best_;
    return squared;
}

Tracker::Side Tracker::opposite(Side side) {
    if (side == Side::positive) return Side::negative;
    // No configuration is on the opposite of a side that does not exist.
    return side == Side::negative ? Side::positive : Side::unknown;
}

Tracker::Side Tracker::side_at(const std::vector<double>& q) {
    const Task& task = tracking_.task;
    const std::size_t n = q.size();
    descent_.look_closely(q);
    if (n != static_cast<std::size_t>(task.positions + task.angles)) return Side::undefined;
    determinant_.clear();
    for (int row = 0; row < 6; ++row) {
        const int k = row % 3;
        if ((row < 3 ? task.mask.linear[k] : task.mask.angular[k]) == 0.0) continue;
        for (const Twist& column : descent_.jacobian())
            determinant_.push_back(row < 3 ? column.linear[k] : column.angular[k]);
    }
    return determinant_is_positive(determinant_, n) ? Side::positive : Side::negative;
}

// Move q back to the side of the singularity to which the arm belongs, if the residual permits; returns the squared
// residual.
double Tracker::return_to_side(double squared) {
    best_ = q_;
    if (bend_to_side(squared) || restart_on_side(squared)) return squared;
    q_ = best_;
    return squared;
}

// Move along the singular motion, as far as it increases the error by at most kSlack.
bool Tracker::bend_to_side(double& squared) {
    lost_direction(q_);
    double bend = kMostBend;
    for (int i = 0; i < 2 * kBends; ++i) {
        for (std::size_t j = 0; j < q_.size(); ++j) trial_[j] = descent_.clamped(j, q_[j] + bend * motion_[j]);
        if (side_at(trial_) == side_) {
            const double there = descent_.look(trial_);
            if (std::sqrt(there) <= std::sqrt(squared) + kSlack) {
                q_ = trial_;
                squared = there;
                return true;
            }
        }
        bend = bend > 0.0 ? -bend : -0.5 * bend;
    }
    return false;
}

// Repeat the cycle from a start as deep on that side as possible, or from the start of the cycle.
bool Tracker::restart_on_side(double& squared) {
    lost_direction(began_);
    trial_ = motion_;
    for (double bend : {kMostBend, -kMostBend, 0.0}) {
        for (std::size_t i = 0; i < q_.size(); ++i) q_[i] = descent_.clamped(i, began_[i] + bend * trial_[i]);
        if (side_at(q_) != side_) continue;
        const double there = descent_.converge(q_);
        if (std::sqrt(there) <= kWorth * std::sqrt(squared) + kSlack && side_at(q_) == side_) {
            squared = there;
            return true;
        }
    }
    return false;
}

// The singular motion at q, its largest entry 1; 0 if it does not exist.
void Tracker::lost_direction(const std::vector<double>& q) {
    for (std::size_t i = 0; i < q.size(); ++i) motion_[i] = descent_.upper[i] - descent_.lower[i];
    descent_.keep_lost_motion(q, motion_);
    double largest = 0.0;
    for (double one : motion_) largest = std::max(largest, std::abs(one));
    for (double& one : motion_) one = largest > 0.0 ? one / largest : 0.0;
}

}  // namespace pinproof
