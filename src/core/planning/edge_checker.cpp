#include "planning/edge_checker.h"

#include <algorithm>
#include <cmath>

namespace pinproof {
namespace {

// Maximum number of samples of an edge; longer edges are sampled more coarsely, and left to the proof.
constexpr int kMostSamples = 1024;

}  // namespace

EdgeChecker::EdgeChecker(std::shared_ptr<const World> world, double resolution)
    : world_(std::move(world)),
      proof_(*world_),
      sampler_(world_),
      resolution_(resolution),
      q_(dof()),
      control_(2 * dof()),
      no_tolerance_(dof(), 0.0) {}

bool EdgeChecker::has_bodies_of(const World& world) const {
    const Geometry &here = world_->space(), &there = world.space();
    return here.tree.dof == there.tree.dof && here.tree.joints.size() == there.tree.joints.size() &&
           here.robot.size() == there.robot.size();
}

void EdgeChecker::set_steering(std::shared_ptr<const World> world, bool blocked) {
    sampler_.emplace(std::move(world));
    blocked_ = blocked;
}

void EdgeChecker::set_torque_limits(DynamicTree model, std::vector<double> limits) {
    load_ = std::make_unique<Load>(std::move(model), std::move(limits));
}

EdgeChecker::Load::Load(DynamicTree tree, std::vector<double> most)
    : model(std::move(tree)),
      limits(std::move(most)),
      dynamics(model),
      motion(limits.size()),
      of_motion(limits.size()),
      of_gravity(limits.size()) {}

bool EdgeChecker::Load::is_held(const double* q) {
    for (std::size_t j = 0; j < motion.size(); ++j) motion[j].position = q[j];
    dynamics.move(motion);
    dynamics.torques(of_motion, of_gravity);
    for (std::size_t j = 0; j < limits.size(); ++j)
        if (!(std::abs(of_gravity[j]) <= limits[j])) return false;
    return true;
}

bool EdgeChecker::samples_free(const double* a, const double* b) {
    if (blocked_) return false;
    return is_sample_free(b) && inner_samples_free(a, b);
}

bool EdgeChecker::points_free(std::span<const double> points) {
    if (blocked_) return false;
    const std::size_t count = points.size() / dof();
    const auto point = [&](std::size_t i) { return points.data() + i * dof(); };
    std::size_t stride = 1;
    while (stride < count) stride *= 2;
    if (count > 0 && !is_sample_free(point(0))) return false;
    for (stride /= 2; stride >= 1; stride /= 2)
        for (std::size_t i = stride; i < count; i += 2 * stride)
            if (!is_sample_free(point(i))) return false;
    for (std::size_t i = 1; i < count; ++i) {
        sampler_->place_at(point(i));  // motion() requires the bodies at the end of the edge.
        if (!inner_samples_free(point(i - 1), point(i))) return false;
    }
    return true;
}

// The samples between a and b, with the bodies placed at b.
bool EdgeChecker::inner_samples_free(const double* a, const double* b) {
    const double wanted = motion(a, b) / resolution_;
    const int steps = wanted < kMostSamples ? std::max(static_cast<int>(std::ceil(wanted)), 1) : kMostSamples;
    int stride = 1;
    while (stride < steps) stride *= 2;
    for (stride /= 2; stride >= 1; stride /= 2)
        for (int index = stride; index < steps; index += 2 * stride) {
            const double share = static_cast<double>(index) / steps;
            for (std::size_t j = 0; j < q_.size(); ++j) q_[j] = a[j] + (b[j] - a[j]) * share;
            if (!is_sample_free(q_.data())) return false;
        }
    return true;
}

bool EdgeChecker::proven_free(const double* a, const double* b) {
    return samples_free(a, b) && proven_between(a, b);
}

bool EdgeChecker::proven_without_samples(const double* a, const double* b) {
    return !blocked_ && is_sample_free(a) && is_sample_free(b) && proven_between(a, b);
}

bool EdgeChecker::proven_between(const double* a, const double* b) {
    std::copy_n(a, dof(), control_.data());
    std::copy_n(b, dof(), control_.data() + dof());
    return curve_proven_free({kUnitKnots, control_, 2, dof()});
}

bool EdgeChecker::curve_proven_free(const CurveView& curve) {
    return !blocked_ && proof_.run(curve, {}, no_tolerance_.data()).free();
}

bool EdgeChecker::is_sample_free(const double* q) {
    ++samples_;
    if (load_ && !load_->is_held(q)) return false;
    return sampler_->place_at(q) && !sampler_->any_contact();
}

// The largest motion (m) of a point of a body between a and b, with the bodies placed at b. It uses the speeds at b: a
// good estimate for the whole edge, but not a bound.
double EdgeChecker::motion(const double* a, const double* b) const {
    const Geometry& space = world_->space();
    double most = 0.0;
    for (std::size_t body = 0; body < space.robot.size(); ++body) {
        double length = 0.0;
        for (int k = space.robot[body].joint; k != kRoot; k = space.tree.joints[k].parent) {
            const Joint& joint = space.tree.joints[k];
            length += std::abs(joint.multiplier * (b[joint.index] - a[joint.index])) *
                      radius_about(joint, sampler_->bodies().joint(k), sampler_->bodies()[body], *space.robot[body].shape);
        }
        most = std::max(most, length);
    }
    return most;
}

}  // namespace pinproof
