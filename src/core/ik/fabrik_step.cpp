#include "ik/fabrik_step.h"

#include <algorithm>
#include <cmath>

#include "geometry/rotations.h"
#include "geometry/sincos.h"

namespace pinproof {
namespace {

constexpr double kDirectionWeight = FabrikStep::kHingeHalfLength * FabrikStep::kHingeHalfLength;

// The axis of the target about which the tcp may rotate; zero if it may not, or about any axis.
Vec3 free_axis(const Task& task) {
    if (task.angles != 2) return {};
    return {1.0 - task.mask.angular[0], 1.0 - task.mask.angular[1], 1.0 - task.mask.angular[2]};
}

// Move every joint by this fraction of its range towards the middle; upwards without a range, or at the middle.
void bend(double share, const std::vector<JointRange>& ranges, const double* q, std::vector<double>& step) {
    for (std::size_t i = 0; i < ranges.size(); ++i) {
        const JointRange& range = ranges[i];
        const double size = share * std::min(range.upper - range.lower, kTurn);
        const bool above = range.finite() && q[i] > 0.5 * (range.lower + range.upper);
        step[i] = range.stopped(q[i] + (above ? -size : size)) - q[i];
    }
}

// The motion by a value (rad or m) about, or along, a hinge.
Transform hinge_motion(const Hinge& hinge, double value) {
    return motion_of_joint(hinge.direction, hinge.origin, hinge.prismatic, value);
}

// The motion of a hinge that is closest to a wanted motion, measured at weighted points and directions.
class HingeFit {
  public:
    HingeFit(const Hinge& hinge, const Transform& wanted) : hinge_(hinge), wanted_(wanted) {}

    void add_point(double weight, const Vec3& point) {
        const Vec3 wanted = wanted_ * point;
        along_ += weight * dot(hinge_.direction, wanted - point);
        const Vec3 a = point - hinge_.origin, z = wanted - hinge_.origin;
        cosine_ += weight * (dot(a, z) - dot(hinge_.direction, a) * dot(hinge_.direction, z));
        sine_ += weight * dot(hinge_.direction, cross(a, z));
    }

    void add_direction(double weight, const Vec3& direction) {
        const Vec3 z = wanted_.rotation * direction;
        cosine_ += weight * (dot(direction, z) - dot(hinge_.direction, direction) * dot(hinge_.direction, z));
        sine_ += weight * dot(hinge_.direction, cross(direction, z));
    }

    // Three orthonormal directions, whichever they are.
    void add_all_directions(double weight) {
        // The sums of add_direction over an orthonormal basis are the trace and the vector of the rotation.
        const auto& m = wanted_.rotation.m;
        const Vec3& d = hinge_.direction;
        cosine_ += weight * (m[0][0] + m[1][1] + m[2][2] - dot(d, wanted_.rotation * d));
        sine_ += weight * dot(d, Vec3{m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]});
    }

    double angle() const {
        const bool determined = sine_ * sine_ + cosine_ * cosine_ > FabrikStep::kTiny * FabrikStep::kTiny;
        return determined ? std::atan2(sine_, cosine_) : 0.0;
    }

    // `total` is the weight of all points.
    double translation(double total) const { return along_ / total; }

  private:
    Hinge hinge_;
    Transform wanted_;
    double along_ = 0.0, cosine_ = 0.0, sine_ = 0.0;
};

// The change closest on the circle to this one that keeps a revolute joint within its limits.
double allowed_change(const JointRange& range, double value, double change) {
    const double low = range.stop_lower(), high = range.stop_upper(), there = value + change;
    if (there >= low && there <= high) return change;
    if (there < low && there + kTurn <= high) return change + kTurn;
    if (there > high && there - kTurn >= low) return change - kTurn;
    return (std::cos(there - low) >= std::cos(there - high) ? low : high) - value;
}

}  // namespace

// What a pass needs besides the hinges.
struct FabrikPasses::Pass {
    const std::vector<JointRange>& ranges;
    const Task& task;
    const double* q;
    double weight = FabrikStep::kReach;      // of the hinges
    double relax = FabrikStep::kRelaxReach;  // the fraction of the pass that is applied
    double position_share = 1.0;             // 1 if the task selects a position, else 0
    Vec3 axis = {};                          // about which the tcp may rotate

    // The motion of joint k from a fit, within its limits; `sense` is -1 for the link below the joint.
    double change(std::size_t k, const Hinge& hinge, const HingeFit& fit, double total, double sense) const {
        const double by = hinge.prismatic ? fit.translation(total) : fit.angle();
        if (hinge.prismatic) return sense * (ranges[k].stopped(q[k] + sense * by) - q[k]);
        return sense * allowed_change(ranges[k], q[k], sense * by);
    }
};

void FabrikPasses::step(const Chain& chain, const std::vector<JointRange>& ranges, const Task& task,
                        const Posture& posture, const double* q, int iteration, int waited, std::vector<double>& out) {
    for (std::size_t k = 0; k < hinges_.size(); ++k)
        hinges_[k] = {narrowed(posture.axes()[k].origin), narrowed(posture.axes()[k].direction),
                      chain.joints[k].prismatic};
    tcp_ = transform_of(posture.tcp());
    Pass pass{ranges, task, q};
    if (iteration % 2 == 0) {
        pass.weight = task.angles == 0 ? FabrikStep::kHold : FabrikStep::kHoldPosed;
        pass.relax = FabrikStep::kRelaxHold;
    }
    pass.position_share = task.positions > 0 ? 1.0 : 0.0;
    pass.axis = free_axis(task);
    backward(pass);
    forward(pass, out);
    double largest = 0.0;
    for (double one : out) largest = std::max(largest, std::abs(one));
    const bool deadlock = waited > 0 && waited % FabrikStep::kWait == 0;
    if (deadlock || largest <= FabrikStep::kStill)
        bend(FabrikStep::kBend * (1 + waited / FabrikStep::kWait), ranges, q, out);
}

// The motion of the last link that brings the tcp to the target.
Transform FabrikPasses::last_link(const Task& task) const {
    const Hinge& last = hinges_.back();
    if (task.angles == 0) {  // a translation to the target, and a partial rotation towards the hinge
        const Vec3 before = last.origin - tcp_.translation, normal = cross(before, last.origin);
        const double size = norm(normal);
        Transform motion;
        if (size > FabrikStep::kTiny) {
            const auto [sine, cosine] = sincos(FabrikStep::kAim * std::atan2(size, dot(before, last.origin)));
            motion.rotation = rotation_about((1.0 / size) * normal, sine, cosine);
        }
        motion.translation = -(motion.rotation * tcp_.translation);
        return motion;
    }
    const Transform to_target = inverse(tcp_);
    if (task.angles == 3) return to_target;
    // The rotation about the free axis after `to_target` that keeps the hinge of the last link closest to its place.
    const Hinge spin{{}, free_axis(task)};
    HingeFit fit(spin, tcp_);
    fit.add_point(task.positions > 0 ? 1.0 : 0.0, to_target * last.origin);
    fit.add_direction(kDirectionWeight, transposed_times(tcp_.rotation, last.direction));
    return hinge_motion(spin, fit.angle()) * to_target;
}

void FabrikPasses::backward(const Pass& pass) {
    moved_.back() = last_link(pass.task);
    for (std::size_t k = hinges_.size() - 1; k > 0; --k) {
        HingeFit fit(hinges_[k], inverse(moved_[k + 1]));
        double total = pass.weight;
        fit.add_point(pass.weight * pass.position_share, hinges_[k - 1].origin);
        fit.add_direction(pass.weight * kDirectionWeight, hinges_[k - 1].direction);
        if (k > 1) {
            fit.add_point(FabrikStep::kBase * pass.position_share, hinges_[0].origin);
            fit.add_direction(FabrikStep::kBase * kDirectionWeight, hinges_[0].direction);
            total += FabrikStep::kBase;
        }
        // The link below moves opposite to the joint.
        moved_[k] = moved_[k + 1] * hinge_motion(hinges_[k], pass.change(k, hinges_[k], fit, total, -1.0));
    }
}

void FabrikPasses::forward(const Pass& pass, std::vector<double>& out) {
    Transform below;  // N of the link below the hinge
    for (std::size_t k = 0; k < hinges_.size(); ++k) {
        const Transform to_link = inverse(moved_[k + 1]);
        HingeFit fit(hinges_[k], inverse(below) * moved_[k + 1]);
        double total = 1.0;
        // The tcp, and the axis about which it may rotate, on this link after the backward pass.
        fit.add_point(pass.position_share, to_link.translation);
        if (pass.task.angles == 2) fit.add_direction(kDirectionWeight, to_link.rotation * pass.axis);
        if (pass.task.angles == 3) fit.add_all_directions(kDirectionWeight);
        if (k + 1 < hinges_.size()) {
            fit.add_point(pass.weight * pass.position_share, hinges_[k + 1].origin);
            fit.add_direction(pass.weight * kDirectionWeight, hinges_[k + 1].direction);
            total += pass.weight;
        }
        const double change = pass.change(k, hinges_[k], fit, total, 1.0);
        below = below * hinge_motion(hinges_[k], change);
        out[k] = pass.ranges[k].stopped(pass.q[k] + pass.relax * change) - pass.q[k];
    }
}

}  // namespace pinproof
