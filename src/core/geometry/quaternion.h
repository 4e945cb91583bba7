// Unit quaternions of rotations.
#pragma once

#include <cmath>

#include "geometry/vectors.h"

namespace pinproof {

// A rotation by `angle` about the unit vector `u`: (x, y, z) = sin(angle/2) u, w = cos(angle/2). Its negative is the
// same rotation. For two rotations a and b with quaternions p and q, trace(a^T b) = 4 (p . q)^2 - 1.
struct Quaternion {
    double x, y, z, w;
};

// The quaternion of a rotation, computed from its largest component (Shepperd 1978, "Quaternion from rotation matrix").
inline Quaternion quaternion_of(const Mat3& rotation) {
    const auto& r = rotation.m;
    const double trace = r[0][0] + r[1][1] + r[2][2];
    // Four times the square of each component, and four times the products with the largest one.
    const double squares[4] = {1.0 + 2.0 * r[0][0] - trace, 1.0 + 2.0 * r[1][1] - trace, 1.0 + 2.0 * r[2][2] - trace,
                               1.0 + trace};
    const double xy = r[1][0] + r[0][1], xz = r[2][0] + r[0][2], yz = r[2][1] + r[1][2];
    const double xw = r[2][1] - r[1][2], yw = r[0][2] - r[2][0], zw = r[1][0] - r[0][1];
    int largest = 3;
    for (int i = 0; i < 3; ++i)
        if (squares[i] > squares[largest]) largest = i;
    const double s = 0.5 / std::sqrt(squares[largest]);
    const double own = 0.5 * std::sqrt(squares[largest]);
    switch (largest) {
        case 0:
            return {own, s * xy, s * xz, s * xw};
        case 1:
            return {s * xy, own, s * yz, s * yw};
        case 2:
            return {s * xz, s * yz, own, s * zw};
        default:
            return {s * xw, s * yw, s * zw, own};
    }
}

}  // namespace pinproof
