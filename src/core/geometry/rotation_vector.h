// The logarithm of a rotation.
#pragma once

#include <cmath>

#include "geometry/vectors.h"

namespace pinproof {

// The rotation vector (axis times angle, 0 to pi) of a rotation.
//
// The angle is computed from sine and cosine together, which is accurate to rounding both for small angles and near pi;
// the arccosine of the trace alone is inaccurate below 1e-8.
inline Vec3 rotation_vector(const Mat3& rotation) {
    constexpr double small_angle = 1e-6;  // rad; below it the sine equals the angle up to rounding
    // Below this cosine the axis is computed from the symmetric part, because the sine is inaccurate.
    constexpr double near_half_turn = -0.99;
    const auto& r = rotation.m;
    const Vec3 v = 0.5 * Vec3{r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]};
    const double cosine = 0.5 * (r[0][0] + r[1][1] + r[2][2] - 1.0), sine = norm(v);
    if (!(cosine < near_half_turn)) return (sine > small_angle ? std::atan2(sine, cosine) / sine : 1.0) * v;

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
