// Forward kinematics and Jacobians of a chain of joints with one axis each.
#pragma once

#include <cstddef>
#include <vector>

#include "geometry/vectors.h"

namespace pinproof {

// A joint that rotates about, or moves along, the z axis of its own frame. A mimic joint follows another one.
struct Joint {
    Transform before;  // constant transform from the frame behind the previous joint
    bool prismatic;
    std::size_t index;          // of its value in q
    double multiplier, offset;  // value = multiplier * q[index] + offset; 1 and 0 except for mimic joints

    double value(const double* q) const { return multiplier * q[index] + offset; }
};

// base_from_tcp(q) = before_1 X_1(q) before_2 X_2(q) ... tool, where X_k is a rotation about z or a translation along z.
struct Chain {
    std::vector<Joint> joints;
    Transform tool;
    std::size_t dof;  // the length of q
};

Transform forward_kinematics(const Chain& chain, const double* q);

}  // namespace pinproof
