// Rotations: the test whether transforms are rigid, rotation vectors and unit quaternions.
#pragma once

#include <cmath>

#include "geometry/sincos.h"
#include "geometry/vectors.h"

namespace pinproof {

// Whether a transform is rigid up to rounding: finite, a rotation whose columns are orthonormal up to 1e-14.
inline bool is_rigid(const Transform& t) {
    constexpr double rounding = 1e-14;
    const Vec3 x = t.rotation.column(0), y = t.rotation.column(1), z = t.rotation.column(2), &p = t.translation;
    const double off[] = {dot(x, x) - 1.0, dot(y, y) - 1.0, dot(z, z) - 1.0, dot(x, y), dot(x, z), dot(y, z)};
    bool rigid = dot(cross(x, y), z) > 0.0 && std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
    for (double one : off) rigid = rigid && std::abs(one) <= rounding;
    return rigid;
}

// The same for a homogeneous matrix (16 numbers), with (0, 0, 0, 1) as the last row.
inline bool is_rigid(const double* matrix) {
    return is_rigid(read_transform(matrix)) && matrix[12] == 0.0 && matrix[13] == 0.0 && matrix[14] == 0.0 &&
           matrix[15] == 1.0;
}

// The motion of a joint by a value: along a direction, or about the line through a point.
inline Transform motion_of_joint(const Vec3& direction, const Vec3& point, bool prismatic, double value) {
    if (prismatic) return {{}, value * direction};
    const auto [sine, cosine] = sincos_of_any(value);
    const Mat3 rotation = rotation_about(direction, sine, cosine);
    return {rotation, point - rotation * point};
}

// The logarithm of a rotation.

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

// Unit quaternions of rotations.

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
