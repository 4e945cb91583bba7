// Forward kinematics and Jacobians of a chain of joints with one axis each.
#pragma once

#include <cstddef>
#include <vector>

#include "geometry/lanes.h"
#include "geometry/vectors.h"
#include "kinematics/tree.h"

namespace pinproof {

// base_from_tcp(q) = before_1 X_1(q) before_2 X_2(q) ... tool, where X_k is a rotation about z or a translation along
// z.
struct Chain {
    std::vector<Joint> joints;
    Transform tool;
    std::size_t dof;  // the length of q

    // Whether a joint of the chain follows another one.
    bool has_mimic_joints() const;
};

// base_from_tcp, joint by joint. It shares no code with `Posture`, whose results it checks.
Transform forward_kinematics(const Chain& chain, const double* q);

// A twist, a residual, or a column of a Jacobian: linear part in m, angular part in rad.
struct Twist {
    Double4 linear = {}, angular = {};
};

inline Twist operator+(const Twist& a, const Twist& b) { return {a.linear + b.linear, a.angular + b.angular}; }
inline Twist operator*(double s, const Twist& a) { return {s * a.linear, s * a.angular}; }
inline Twist& operator+=(Twist& a, const Twist& b) { return a = a + b; }
inline double dot(const Twist& a, const Twist& b) { return sum(a.linear * b.linear + a.angular * b.angular); }
inline double squared_norm(const Twist& a) { return dot(a, a); }

// A (6, n) Jacobian by columns.
using Jacobian = std::vector<Twist>;

// A chain at one configuration: the axis of each joint, and the tcp. It is reused, so that loops do not allocate.
class Posture {
  public:
    explicit Posture(const Chain& chain);

    // Evaluate the chain at q (n,), from any start frame; all results are in the axes of that frame.
    void evaluate(const Chain& chain, const Frame& start, const double* q);

    // The twist of the tcp per rate of q, in the axes of the start frame.
    void jacobian(const Chain& chain, Jacobian& out) const;

    struct Axis {
        Double4 origin, direction;
    };
    const std::vector<Axis>& axes() const { return axes_; }
    const Frame& tcp() const { return tcp_; }

  private:
    std::vector<Axis> axes_;
    Frame tcp_;
    std::vector<double> values_, sines_, cosines_;  // of the joints, padded to whole vector registers
};

// The manipulability of an arm.

// The logarithm of sqrt(det(J J^T + tiny I)); with fewer than 6 joints of J^T J in its place.
//
// Source: Yoshikawa (1985), "Manipulability of robotic mechanisms".
double log_manipulability(const Jacobian& jacobian);

}  // namespace pinproof
