// The logarithm of a rotation.
#pragma once

#include <cmath>

#include "geometry/vectors.h"

namespace pinproof {

// Below this sine, the angle (rad) equals the sine up to rounding.
inline constexpr double kSmallSine = 1e-6;

// Below this cosine the axis is computed from the symmetric part, because the sine is inaccurate.
inline constexpr double kNearHalfTurn = -0.99;

// The rotation vector (axis times angle, 0 to pi) of a rotation.
//
// The angle is computed from sine and cosine together, which is accurate to rounding both for small angles and near pi;
// the arccosine of the trace alone is inaccurate below 1e-8.
inline Vec3 rotation_vector(const Mat3& rotation) {
    const auto& r = rotation.m;
    const Vec3 v = 0.5 * Vec3{r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]};
    const double cosine = 0.5 * (r[0][0] + r[1][1] + r[2][2] - 1.0), sine = norm(v);
    if (!(cosine < kNearHalfTurn)) return (sine > kSmallSine ? std::atan2(sine, cosine) / sine : 1.0) * v;

    // R + R^T = 2 cosine I + 2 (1 - cosine) u u^T: the column of the largest entry of u is the best conditioned.
    int i = r[1][1] > r[0][0] ? 1 : 0;
    if (r[2][2] > r[i][i]) i = 2;
    double u[3] = {r[0][i] + r[i][0], r[1][i] + r[i][1], r[2][i] + r[i][2]};
    u[i] -= 2.0 * cosine;
    const Vec3 axis{u[0], u[1], u[2]};
    const double angle = std::atan2(sine, cosine) / norm(axis);
    return (dot(axis, v) < 0.0 ? -angle : angle) * axis;
}

}  // namespace pinproof
