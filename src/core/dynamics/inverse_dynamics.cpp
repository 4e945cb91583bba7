#include "dynamics/inverse_dynamics.h"

#include <algorithm>

namespace pinproof {
namespace {

// a v and a^T v of a constant matrix.
template <class S>
Vector3<S> times(const Mat3& a, const Vector3<S>& v) {
    return {a.m[0][0] * v.x + a.m[0][1] * v.y + a.m[0][2] * v.z, a.m[1][0] * v.x + a.m[1][1] * v.y + a.m[1][2] * v.z,
            a.m[2][0] * v.x + a.m[2][1] * v.y + a.m[2][2] * v.z};
}
template <class S>
Vector3<S> transposed_times(const Mat3& a, const Vector3<S>& v) {
    return {a.m[0][0] * v.x + a.m[1][0] * v.y + a.m[2][0] * v.z, a.m[0][1] * v.x + a.m[1][1] * v.y + a.m[2][1] * v.z,
            a.m[0][2] * v.x + a.m[1][2] * v.y + a.m[2][2] * v.z};
}

// The cross products of a constant vector with v, and of v with it.
template <class S>
Vector3<S> cross(const Vec3& a, const Vector3<S>& v) {
    return {a.y * v.z - a.z * v.y, a.z * v.x - a.x * v.z, a.x * v.y - a.y * v.x};
}
template <class S>
Vector3<S> cross(const Vector3<S>& v, const Vec3& a) {
    return {a.z * v.y - a.y * v.z, a.x * v.z - a.z * v.x, a.y * v.x - a.x * v.y};
}

// w v of a matrix of models and a constant vector.
template <class S>
Vector3<S> times(const S (&w)[3][3], const Vec3& v) {
    return {v.x * w[0][0] + v.y * w[0][1] + v.z * w[0][2], v.x * w[1][0] + v.y * w[1][1] + v.z * w[1][2],
            v.x * w[2][0] + v.y * w[2][1] + v.z * w[2][2]};
}

// Vectors through the rotation of a joint about its z axis: into its frame and out of it.
template <class S>
Vector3<S> into(const S& sine, const S& cosine, const Vector3<S>& v) {
    return {cosine * v.x + sine * v.y, cosine * v.y - sine * v.x, v.z};
}
template <class S>
Vector3<S> out_of(const S& sine, const S& cosine, const Vector3<S>& v) {
    return {cosine * v.x - sine * v.y, sine * v.x + cosine * v.y, v.z};
}

}  // namespace

template <class S>
InverseDynamics<S>::InverseDynamics(const DynamicTree& model) : model_(model), joints_(model.tree.joints.size()) {}

template <class S>
void InverseDynamics<S>::move(std::span<const JointMotion<S>> q) {
    for (std::size_t k = 0; k < joints_.size(); ++k) {
        const Joint& joint = model_.tree.joints[k];
        const JointMotion<S>& entry = q[static_cast<std::size_t>(joint.index)];
        State& at = joints_[k];
        at.value = joint.multiplier * entry.position + S(joint.offset);
        const S rate = joint.multiplier * entry.velocity, growth = joint.multiplier * entry.acceleration;
        const Mat3& rotation = joint.before.rotation;
        const Vec3& origin = joint.before.translation;
        // In the axes of the joint before it moves, at its origin.
        Vector3<S> omega, alpha, velocity, acceleration, fall;
        if (joint.parent == kRoot) {
            const Vec3 g = pinproof::transposed_times(rotation, model_.gravity);
            fall = {S(g.x), S(g.y), S(g.z)};
        } else {
            const State& from = joints_[static_cast<std::size_t>(joint.parent)];
            omega = transposed_times(rotation, from.angular_velocity);
            alpha = transposed_times(rotation, from.angular_acceleration);
            velocity = transposed_times(rotation, from.velocity + cross(from.angular_velocity, origin));
            acceleration = transposed_times(rotation, from.acceleration + times(from.spin.w, origin));
            fall = transposed_times(rotation, from.fall);
        }
        if (joint.prismatic) {
            // The origin moves along z by the value d: v + omega x d z + d' z, and
            // a + alpha x d z + omega x (omega x d z) + 2 omega x d' z + d'' z.
            const S& d = at.value;
            const S dx = d * omega.x, dy = d * omega.y;
            acceleration.x = acceleration.x + d * alpha.y + dx * omega.z + 2.0 * (rate * omega.y);
            acceleration.y = acceleration.y - d * alpha.x + dy * omega.z - 2.0 * (rate * omega.x);
            acceleration.z = acceleration.z - (dx * omega.x + dy * omega.y) + growth;
            velocity.x = velocity.x + dy;
            velocity.y = velocity.y - dx;
            velocity.z = velocity.z + rate;
        } else {
            sine_cosine(at.value, at.sine, at.cosine);
            omega = into(at.sine, at.cosine, omega);
            alpha = into(at.sine, at.cosine, alpha);
            // alpha + omega x rate z + growth z
            alpha.x = alpha.x + omega.y * rate;
            alpha.y = alpha.y - omega.x * rate;
            alpha.z = alpha.z + growth;
            omega.z = omega.z + rate;
            velocity = into(at.sine, at.cosine, velocity);
            acceleration = into(at.sine, at.cosine, acceleration);
            fall = into(at.sine, at.cosine, fall);
        }
        at.angular_velocity = omega;
        at.angular_acceleration = alpha;
        at.velocity = velocity;
        at.acceleration = acceleration;
        at.fall = fall;
        Spin& spin = at.spin;
        spin.xx = omega.x * omega.x;
        spin.yy = omega.y * omega.y;
        spin.zz = omega.z * omega.z;
        spin.xy = omega.x * omega.y;
        spin.xz = omega.x * omega.z;
        spin.yz = omega.y * omega.z;
        // omega x (omega x v) = (omega omega^T - |omega|^2) v
        spin.w[0][0] = -(spin.yy + spin.zz);
        spin.w[1][1] = -(spin.xx + spin.zz);
        spin.w[2][2] = -(spin.xx + spin.yy);
        spin.w[0][1] = spin.xy - alpha.z;
        spin.w[1][0] = spin.xy + alpha.z;
        spin.w[0][2] = spin.xz + alpha.y;
        spin.w[2][0] = spin.xz - alpha.y;
        spin.w[1][2] = spin.yz - alpha.x;
        spin.w[2][1] = spin.yz + alpha.x;
    }
}

// Euler's equations about the origin of the joint, which itself accelerates by a, with the first moment h: force m a + W h,
// moment I alpha + omega x I omega + h x a. The weight is m g with the moment h x g.
template <class S>
auto InverseDynamics<S>::load(std::size_t joint) const -> Load {
    const RigidBody& body = model_.bodies[joint];
    const State& at = joints_[joint];
    const Vector3<S>& a = at.acceleration;
    const Vector3<S>& g = at.fall;
    Load load;
    load.force = times(at.spin.w, body.first_moment);
    load.force += Vector3<S>{body.mass * a.x, body.mass * a.y, body.mass * a.z};
    const Spin& s = at.spin;
    const auto& i = body.inertia.m;
    load.moment = times(body.inertia, at.angular_acceleration) + cross(body.first_moment, a);
    load.moment += Vector3<S>{
        i[2][0] * s.xy + i[2][1] * s.yy + i[2][2] * s.yz - (i[1][0] * s.xz + i[1][1] * s.yz + i[1][2] * s.zz),
        i[0][0] * s.xz + i[0][1] * s.yz + i[0][2] * s.zz - (i[2][0] * s.xx + i[2][1] * s.xy + i[2][2] * s.xz),
        i[1][0] * s.xx + i[1][1] * s.xy + i[1][2] * s.xz - (i[0][0] * s.xy + i[0][1] * s.yy + i[0][2] * s.yz)};
    // The joints carry the bodies against gravity, hence the sign.
    load.weight = {-body.mass * g.x, -body.mass * g.y, -body.mass * g.z};
    const Vector3<S> m = cross(body.first_moment, g);
    load.weight_moment = {-1.0 * m.x, -1.0 * m.y, -1.0 * m.z};
    return load;
}

template <class S>
void InverseDynamics<S>::torques(std::span<S> of_motion, std::span<S> of_gravity) {
    std::fill(of_motion.begin(), of_motion.end(), S{});
    std::fill(of_gravity.begin(), of_gravity.end(), S{});
    for (std::size_t k = 0; k < joints_.size(); ++k) joints_[k].load = load(k);
    for (std::size_t k = joints_.size(); k-- > 0;) {
        const Joint& joint = model_.tree.joints[k];
        const State& at = joints_[k];
        const Load& own = at.load;
        const auto entry = static_cast<std::size_t>(joint.index);
        of_motion[entry] += joint.multiplier * (joint.prismatic ? own.force.z : own.moment.z);
        of_gravity[entry] += joint.multiplier * (joint.prismatic ? own.weight.z : own.weight_moment.z);
        if (joint.parent == kRoot) continue;
        Load& to = joints_[static_cast<std::size_t>(joint.parent)].load;
        const auto pass_on = [&](Vector3<S> force, Vector3<S> moment, Vector3<S>& parent_force, Vector3<S>& parent_moment) {
            if (joint.prismatic) {  // at the origin before the motion: d z x force
                moment.x = moment.x - at.value * force.y;
                moment.y = moment.y + at.value * force.x;
            } else {
                force = out_of(at.sine, at.cosine, force);
                moment = out_of(at.sine, at.cosine, moment);
            }
            force = times(joint.before.rotation, force);
            parent_force += force;
            parent_moment +=
                times(joint.before.rotation, moment) + cross(joint.before.translation, force);
        };
        pass_on(own.force, own.moment, to.force, to.moment);
        pass_on(own.weight, own.weight_moment, to.weight, to.weight_moment);
    }
}

template <class S>
ToolMotion<S> InverseDynamics<S>::tool() const {
    if (model_.tool_joint == kRoot) return {};
    const State& at = joints_[static_cast<std::size_t>(model_.tool_joint)];
    return {at.velocity + cross(at.angular_velocity, model_.tool), at.angular_velocity,
            at.acceleration + times(at.spin.w, model_.tool), at.angular_acceleration};
}

template <class S>
auto InverseDynamics<S>::load_of_tool() const -> Load {
    return model_.tool_joint == kRoot ? Load{} : load(static_cast<std::size_t>(model_.tool_joint));
}

template class InverseDynamics<double>;
template class InverseDynamics<TaylorModel>;

}  // namespace pinproof
