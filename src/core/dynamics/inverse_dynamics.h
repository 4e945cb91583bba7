// Torques of a tree of joints from its motion, and the motion of its tool: for numbers and for Taylor models.
//
// Recursive Newton-Euler algorithm: velocities and accelerations from the root to the leaves, forces and moments back
// (R. Featherstone, "Rigid Body Dynamics Algorithms", 2008, section 5.3; here with vectors of three dimensions). All
// vectors of a joint are in the axes of its own frame. The torque from gravity is computed apart from that of the
// motion: only the latter changes with the speed at which a path is driven.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "dynamics/taylor.h"
#include "geometry/vectors.h"
#include "kinematics/tree.h"

namespace pinproof {

// The rigid body that a joint moves, without the bodies behind further joints, in the frame of the joint.
struct RigidBody {
    double mass = 0.0;            // kg
    Vec3 first_moment;            // mass times centre of mass, kg m
    Mat3 inertia{};               // about the origin of the joint frame, kg m^2
};

struct DynamicTree {
    JointTree tree;
    std::vector<RigidBody> bodies;  // one for each joint
    Vec3 gravity;                   // acceleration of free fall in the root frame, m/s^2
    int tool_joint = kRoot;         // the joint that moves the tool, or kRoot
    Vec3 tool;                      // the tool centre point in the frame of that joint
};

template <class S>
struct Vector3 {
    S x{}, y{}, z{};
};

template <class S>
Vector3<S> operator+(const Vector3<S>& a, const Vector3<S>& b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class S>
Vector3<S>& operator+=(Vector3<S>& a, const Vector3<S>& b) {
    return a = a + b;
}
template <class S>
S squared_norm(const Vector3<S>& a) {
    return a.x * a.x + a.y * a.y + a.z * a.z;
}

// The motion of one entry of q: a value and its first two derivatives with respect to time.
template <class S>
struct JointMotion {
    S position{}, velocity{}, acceleration{};
};

// The velocities and accelerations of the tool centre point, relative to the root and in the axes of the tool joint.
template <class S>
struct ToolMotion {
    Vector3<S> linear_velocity, angular_velocity, linear_acceleration, angular_acceleration;
};

// The algorithm for numbers (double) or Taylor models; it is reused, so that loops do not allocate.
template <class S>
class InverseDynamics {
  public:
    explicit InverseDynamics(const DynamicTree& model);

    // The velocities and accelerations of all joints; `q` has one motion for each entry of q.
    void move(std::span<const JointMotion<S>> q);

    // The torques (dof) of the last motion, without and from gravity: N m, or N for a prismatic joint. The torque of a
    // mimic joint is added to that of the joint that it follows, times its multiplier (virtual work).
    void torques(std::span<S> of_motion, std::span<S> of_gravity);

    ToolMotion<S> tool() const;

    // The forces and moments about the origin of the tool joint, in its axes, that its own body needs for its motion and
    // against gravity.
    struct Load {
        Vector3<S> force, moment, weight, weight_moment;
    };
    Load load_of_tool() const;

  private:
    // W with W v = alpha x v + omega x (omega x v), the acceleration of a point of the body at v; and omega omega^T.
    struct Spin {
        S w[3][3];
        S xx{}, yy{}, zz{}, xy{}, xz{}, yz{};
    };
    struct State {
        S value{}, sine{}, cosine{};
        Vector3<S> angular_velocity, angular_acceleration, velocity, acceleration, fall;
        Spin spin;
        Load load;
    };

    Load load(std::size_t joint) const;

    const DynamicTree& model_;
    std::vector<State> joints_;
};

extern template class InverseDynamics<double>;
extern template class InverseDynamics<TaylorModel>;

}  // namespace pinproof
