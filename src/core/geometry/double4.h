// Four doubles in one vector register, and rigid transforms whose columns are such vectors.
//
// These are the vector extensions of GCC and Clang; the compiler splits them on processors with shorter registers. The
// fourth number of a point or a direction is 0.
#pragma once

#include "geometry/vectors.h"

namespace pinproof {

typedef double Double4 __attribute__((vector_size(4 * sizeof(double))));

inline Double4 cross(Double4 a, Double4 b) {
    // a x b = yzx(a * yzx(b) - yzx(a) * b), with yzx the cyclic permutation
    const Double4 c = a * __builtin_shufflevector(b, b, 1, 2, 0, 3) - __builtin_shufflevector(a, a, 1, 2, 0, 3) * b;
    return __builtin_shufflevector(c, c, 1, 2, 0, 3);
}
inline double sum(Double4 a) {
    const Double4 b = a + __builtin_shufflevector(a, a, 2, 3, 0, 1);
    return b[0] + b[1];
}
inline double dot(Double4 a, Double4 b) { return sum(a * b); }
inline Double4 widened(const Vec3& a) { return Double4{a.x, a.y, a.z, 0.0}; }
inline Vec3 narrowed(Double4 a) { return {a[0], a[1], a[2]}; }

// A rigid transform a_from_b: the axes of b and its origin, in the axes of a.
struct Frame {
    Double4 x = {1.0, 0.0, 0.0, 0.0}, y = {0.0, 1.0, 0.0, 0.0}, z = {0.0, 0.0, 1.0, 0.0}, origin = {};

    // The direction with components (u, v, w) in b, in the axes of a.
    Double4 direction(double u, double v, double w) const { return u * x + v * y + w * z; }
};

inline Frame operator*(const Frame& a, const Transform& b) {
    const auto& m = b.rotation.m;
    return {a.direction(m[0][0], m[1][0], m[2][0]), a.direction(m[0][1], m[1][1], m[2][1]),
            a.direction(m[0][2], m[1][2], m[2][2]),
            a.origin + a.direction(b.translation.x, b.translation.y, b.translation.z)};
}

inline Frame frame_of(const Transform& t) {
    return {widened(t.rotation.column(0)), widened(t.rotation.column(1)), widened(t.rotation.column(2)),
            widened(t.translation)};
}
inline Mat3 rotation_of(const Frame& a) {
    Mat3 r;
    for (int i = 0; i < 3; ++i) {
        r.m[i][0] = a.x[i];
        r.m[i][1] = a.y[i];
        r.m[i][2] = a.z[i];
    }
    return r;
}
inline Transform transform_of(const Frame& a) { return {rotation_of(a), narrowed(a.origin)}; }

}  // namespace pinproof
