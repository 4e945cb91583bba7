#include "certificate/path_constraint.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace pinproof {
namespace {

constexpr double kUnbounded = std::numeric_limits<double>::infinity();

// rad, and metres for each metre of reach: about 10^5 roundings of numbers of that size.
constexpr double kRounding = 1e-11;

// rad or m: up to this sum of joint values, their own rounding is within kRounding; beyond, it grows in proportion.
constexpr double kTurning = 1e3;

// A direction to a target that is nearer to the tcp than this (m) is undefined.
constexpr double kNearest = 1e-9;

double angle_between(const Vec3& a, const Vec3& b) { return std::atan2(norm(cross(a, b)), dot(a, b)); }

// The signed distance of one coordinate from a range.
double excess(double x, double low, double high) { return x > high ? x - high : x < low ? x - low : 0.0; }

Vec3 excess_of_box(const PathConstraint& region, const Vec3& point) {
    const Vec3 local =
        transposed_times(region.base_from_box.rotation, point - region.base_from_box.translation);
    return {excess(local.x, region.low.x, region.high.x), excess(local.y, region.low.y, region.high.y),
            excess(local.z, region.low.z, region.high.z)};
}

// A unit vector perpendicular to a unit vector.
Vec3 perpendicular_to(const Vec3& a) {
    const Vec3 other = std::abs(a.x) < 0.6 ? Vec3{1.0, 0.0, 0.0} : Vec3{0.0, 1.0, 0.0};
    const Vec3 n = cross(a, other);
    return (1.0 / norm(n)) * n;
}

}  // namespace

ConstrainedTcp::ConstrainedTcp(Chain chain, std::vector<PathConstraint> constraints)
    : chain_(std::move(chain)), constraints_(std::move(constraints)), axes_(chain_.joints.size()) {
    double reach = norm(chain_.tool.translation);
    for (const Joint& joint : chain_.joints) reach += norm(joint.before.translation);
    for (const PathConstraint& each : constraints_)
        reach = std::max({reach, norm(each.point), norm(each.base_from_box.translation)});
    reach_ = std::max(reach, 1.0);
    rounding_ = kRounding * reach_;
}

void ConstrainedTcp::place(const double* q) {
    Transform pose;
    double travel = 0.0, turning = 0.0;
    for (std::size_t k = 0; k < chain_.joints.size(); ++k) {
        const Joint& joint = chain_.joints[k];
        pose = pose * joint.before;
        axes_[k] = {pose.translation, pose.rotation.column(2)};
        const double value = joint.value(q);
        turning += std::abs(value);
        if (joint.prismatic) travel += std::abs(value);
        move(pose, joint.prismatic, value);
    }
    tcp_ = pose * chain_.tool;
    rounding_ = kRounding * (reach_ + travel) * std::max(turning / kTurning, 1.0);
}

double ConstrainedTcp::error(std::size_t i) const {
    const PathConstraint& constraint = constraints_[i];
    switch (constraint.kind) {
        case ConstraintKind::kDirection:
            return angle_between(tcp_.rotation * constraint.axis, constraint.point);
        case ConstraintKind::kRegion:
            return norm(excess_of_box(constraint, tcp_ * constraint.point));
        case ConstraintKind::kTarget:
        default: {
            const Vec3 view = constraint.point - tcp_.translation;
            return norm(view) < kNearest ? std::numbers::pi : angle_between(tcp_.rotation * constraint.axis, view);
        }
    }
}

// The velocity of a point that joint k carries, per unit of the joint's own rate.
Vec3 ConstrainedTcp::velocity(std::size_t k, const Vec3& point) const {
    const Axis& axis = axes_[k];
    return chain_.joints[k].prismatic ? axis.direction : cross(axis.direction, point - axis.origin);
}

ConstrainedTcp::Bound ConstrainedTcp::bound(std::size_t i, const double* control, std::size_t points,
                                            const double* middle, const double* delta, const double* extra) const {
    const PathConstraint& constraint = constraints_[i];
    const std::size_t count = chain_.joints.size(), n = chain_.dof;
    const bool direction = constraint.kind == ConstraintKind::kDirection;
    const bool target = constraint.kind == ConstraintKind::kTarget;
    const bool region = constraint.kind == ConstraintKind::kRegion;
    const Vec3 moved = direction ? tcp_.rotation * constraint.axis
                                 : region ? tcp_ * constraint.point : constraint.point;
    // Relative to the tcp, the target moves by the inverse of each joint.
    const double sign = target ? -1.0 : 1.0;
    const auto rate_of = [&](std::size_t k) {
        if (!direction) return sign * velocity(k, moved);
        return chain_.joints[k].prismatic ? Vec3{} : cross(axes_[k].direction, moved);
    };

    double remainder = 0.0, tolerated = 0.0, turned = 0.0;
    for (std::size_t step = 0; step < count; ++step) {
        const std::size_t k = target ? count - 1 - step : step;
        const Joint& joint = chain_.joints[k];
        if (direction && joint.prismatic) continue;
        const JointSwing swing = swing_of(joint.prismatic, joint.multiplier, delta[joint.index], extra[joint.index]);
        const double radius = norm(rate_of(k));
        remainder += radius * (swing.bend + turned * swing.chord);
        tolerated += radius * swing.share * extra[joint.index];
        if (!joint.prismatic) turned += swing.chord;
    }

    const Vec3 axis = direction ? constraint.point : tcp_.rotation * constraint.axis;
    const Vec3 start = target ? moved - tcp_.translation : moved;
    double largest = 0.0, furthest = 0.0, shortest = kUnbounded;
    for (std::size_t r = 0; r < points; ++r) {
        Vec3 change;
        for (std::size_t k = 0; k < count; ++k) {
            const Joint& joint = chain_.joints[k];
            const double by = joint.multiplier * (control[r * n + joint.index] - middle[joint.index]);
            if (by != 0.0) change += by * rate_of(k);
        }
        const Vec3 image = start + change;
        furthest = std::max(furthest, norm(change));
        if (region) {
            largest = std::max(largest, norm(excess_of_box(constraint, image)));
        } else {
            largest = std::max(largest, angle_between(image, axis));
            shortest = std::min(shortest, dot(image, axis));
        }
    }
    const double rest = remainder + tolerated + rounding_;
    if (region) return {largest + rest, furthest + remainder};
    if (!(rest < shortest)) return {kUnbounded, target ? kUnbounded : furthest + remainder};
    return {largest + std::asin(rest / shortest) + rounding_, (furthest + remainder) / shortest};
}

void ConstrainedTcp::append_equations(std::size_t i, double wanted,
                                      std::vector<ConstraintEquation>& equations) const {
    const PathConstraint& constraint = constraints_[i];
    const double error = this->error(i);
    if (!(error > wanted)) return;
    const auto append = [&](double right, auto rate) {
        ConstraintEquation equation{std::vector<double>(chain_.dof, 0.0), right};
        for (std::size_t k = 0; k < chain_.joints.size(); ++k)
            equation.row[chain_.joints[k].index] += chain_.joints[k].multiplier * rate(k);
        equations.push_back(std::move(equation));
    };
    if (constraint.kind == ConstraintKind::kRegion) {
        const Vec3 point = tcp_ * constraint.point, off = excess_of_box(constraint, point);
        for (int axis = 0; axis < 3; ++axis) {
            if (off[axis] == 0.0) continue;
            const Vec3 side = constraint.base_from_box.rotation.column(axis);
            append(-off[axis] * (1.0 - wanted / error),
                   [&](std::size_t k) { return dot(side, velocity(k, point)); });
        }
        return;
    }
    // Rotate the axis of the tcp towards the other direction: about `normal` by the excess, about `other` by nothing.
    const bool target = constraint.kind == ConstraintKind::kTarget;
    const Vec3 axis = tcp_.rotation * constraint.axis;
    const Vec3 view = target ? constraint.point - tcp_.translation : constraint.point;
    const double length = norm(view);
    if (length < kNearest) return;
    const Vec3 towards = (1.0 / length) * view;
    Vec3 normal = cross(axis, towards);
    const double sine = norm(normal);
    normal = sine > 1e-12 ? (1.0 / sine) * normal : perpendicular_to(axis);
    const Vec3 other = cross(normal, axis);
    const auto about = [&](const Vec3& b) {
        return [&, b](std::size_t k) {
            double rate = chain_.joints[k].prismatic ? 0.0 : dot(b, axes_[k].direction);
            // The view rotates by -towards x v / length while the tcp moves with the velocity v.
            if (target) rate += dot(b, cross(towards, velocity(k, tcp_.translation))) / length;
            return rate;
        };
    };
    append(error - wanted, about(normal));
    append(0.0, about(other));
}

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
