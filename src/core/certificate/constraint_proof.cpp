#include "certificate/constraint_proof.h"

#include <algorithm>
#include <cmath>

namespace pinproof {
namespace {

// Bisections of one piece: 60 reach the resolution of a double.
constexpr std::size_t kMostBisections = 64;

struct Span {
    double start, end;
};

// The search in one piece of the curve after the other.
class Search {
public:
    Search(ConstrainedTcp& tcp, std::size_t i, const CurveView& curve, const ConstraintSettings& settings,
           const double* joint_tolerance)
        : tcp_(tcp),
          i_(i),
          curve_(curve),
          settings_(settings),
          joint_tolerance_(joint_tolerance),
          size_(curve.points * curve.dof),
          parts_((kMostBisections + 2) * size_),
          part_(size_),
          halves_(2 * size_),
          delta_(curve.dof) {
        stack_.reserve(kMostBisections + 2);
    }

    ConstraintState run() {
        const double* first = curve_.piece(0);
        if (look_at(curve_.knots[0], first)) return std::move(state_);
        for (std::size_t piece = 0; piece < curve_.pieces() && !ended_; ++piece) {
            push({curve_.knots[piece], curve_.knots[piece + 1]}, curve_.piece(piece));
            while (!stack_.empty() && !ended_) step();
            if (state_.violation) break;
        }
        return std::move(state_);
    }

private:
    double* part(std::size_t depth) { return parts_.data() + depth * size_; }
    bool is_violation(double error) const { return error > tcp_.tolerance(i_) + tcp_.rounding(); }

    void push(const Span& span, const double* control) {
        std::copy_n(control, size_, part(stack_.size()));
        stack_.push_back(span);
    }

    // Whether q is a violation, which then replaces the one that was found later on the curve.
    bool look_at(double time, const double* q) {
        tcp_.place(q);
        const double error = tcp_.error(i_);
        state_.observed = std::max(state_.observed, error);
        if (!is_violation(error)) return false;
        state_.violation = FoundViolation{time, error, {q, q + curve_.dof}};
        return true;
    }

    void step() {
        const Span span = stack_.back();
        std::copy_n(part(stack_.size() - 1), size_, part_.data());
        stack_.pop_back();
        ++state_.intervals;
        double* left = halves_.data();
        double* right = left + size_;
        halve(part_.data(), curve_.points, curve_.dof, left, right);
        const double* middle = right;  // its first control point
        std::fill(delta_.begin(), delta_.end(), 0.0);
        for (std::size_t r = 0; r < curve_.points; ++r)
            for (std::size_t j = 0; j < curve_.dof; ++j)
                delta_[j] = std::max(delta_[j], std::abs(part_[r * curve_.dof + j] - middle[j]));
        const double time = 0.5 * (span.start + span.end);
        const bool violated = look_at(time, middle);
        if (violated) {
            stack_.clear();  // only what comes before the violation matters
        } else {
            const auto bound = tcp_.bound(i_, part_.data(), curve_.points, middle, delta_.data(), joint_tolerance_);
            const double limit = tcp_.tolerance(i_);
            const double goal = limit - settings_.goal_share * std::max(limit - state_.observed, 0.0);
            if (bound.error <= goal) return prove(span, bound.error);
            if (bound.change < settings_.resolution || !(time > span.start && time < span.end) || spent()) {
                if (bound.error <= limit) return prove(span, bound.error);
                return leave_open(span);
            }
        }
        if (!(time > span.start && time < span.end) || spent()) {
            if (time > span.start) leave_open({span.start, time});
            return;
        }
        if (stack_.size() + 2 > kMostBisections) return leave_open(span);
        if (!violated) push({time, span.end}, right);
        push({span.start, time}, left);
    }

    bool spent() const { return state_.intervals >= settings_.max_intervals; }

    void prove(const Span& span, double bound) {
        state_.proven = std::max(state_.proven, bound);
        if (settings_.record) state_.evidence.push_back({span.start, span.end});
    }

    // The interval cannot be decided. A violation may begin at its end, which is checked.
    void leave_open(const Span& span) {
        const std::size_t last = (curve_.points - 1) * curve_.dof;
        tcp_.place(part_.data() + last);
        const double at_end = tcp_.error(i_);
        state_.observed = std::max(state_.observed, at_end);
        if (is_violation(at_end) && !state_.violation) {
            state_.violation = FoundViolation{span.end, at_end, {part_.data() + last, part_.data() + last + curve_.dof}};
            stack_.clear();
        }
        if (!state_.open) {
            state_.open = UndecidedConstraint{span.start, span.end, at_end};
            last_interval_ = state_.intervals + std::min(settings_.look_ahead, settings_.max_intervals);
        }
        ended_ = state_.violation.has_value() || spent() || state_.intervals >= last_interval_;
    }

    ConstrainedTcp& tcp_;
    std::size_t i_;
    CurveView curve_;
    ConstraintSettings settings_;
    const double* joint_tolerance_;
    std::size_t size_;
    ConstraintState state_;
    std::int64_t last_interval_ = 0;  // until which a violation is searched for after an undecided span
    bool ended_ = false;
    std::vector<Span> stack_;
    std::vector<double> parts_, part_, halves_, delta_;
};

}  // namespace

ConstraintState prove_constraint(ConstrainedTcp& tcp, std::size_t i, const CurveView& curve,
                                 const ConstraintSettings& settings, const double* joint_tolerance) {
    return Search(tcp, i, curve, settings, joint_tolerance).run();
}

}  // namespace pinproof
