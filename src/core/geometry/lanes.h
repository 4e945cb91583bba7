// Four doubles in one vector register, and rigid transforms whose columns are such vectors.
//
// These are the vector extensions of GCC and Clang; the compiler splits them on processors with shorter registers. The
// fourth number of a point or a direction is 0.
#pragma once

#include <cmath>
#include <cstdint>

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

// Numbers, vectors and frames of four independent problems at once, one in each lane of a vector register.
inline constexpr int kLanes = 4;
using Lanes = Double4;
typedef std::int64_t LaneMask __attribute__((vector_size(kLanes * sizeof(std::int64_t))));  // -1 for true, 0 for false

inline Lanes all_lanes(double value) { return Lanes{value, value, value, value}; }
inline Lanes load_lanes(const double* numbers) { return Lanes{numbers[0], numbers[1], numbers[2], numbers[3]}; }
inline void store_lanes(Lanes a, double* numbers) {
    for (int lane = 0; lane < kLanes; ++lane) numbers[lane] = a[lane];
}
inline bool any(LaneMask mask) {
#ifdef __AVX__  // one instruction, which compilers do not find
    typedef long long Mask __attribute__((vector_size(sizeof(LaneMask))));
    return __builtin_ia32_ptestz256((Mask)mask, (Mask)mask) == 0;
#else
    return (mask[0] | mask[1] | mask[2] | mask[3]) != 0;
#endif
}
inline Lanes lanes_min(Lanes a, Lanes b) { return a < b ? a : b; }
inline Lanes lanes_max(Lanes a, Lanes b) { return a > b ? a : b; }
inline Lanes lanes_abs(Lanes a) { return a < 0.0 ? -a : a; }
inline Lanes lanes_sqrt(Lanes a) { return Lanes{std::sqrt(a[0]), std::sqrt(a[1]), std::sqrt(a[2]), std::sqrt(a[3])}; }

struct LaneVec3 {
    Lanes x = {}, y = {}, z = {};

    void set(int lane, const Vec3& v) {
        x[lane] = v.x;
        y[lane] = v.y;
        z[lane] = v.z;
    }
};

inline LaneVec3 operator+(const LaneVec3& a, const LaneVec3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline LaneVec3 operator-(const LaneVec3& a, const LaneVec3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline LaneVec3 operator*(Lanes s, const LaneVec3& a) { return {s * a.x, s * a.y, s * a.z}; }
inline LaneVec3 operator*(double s, const LaneVec3& a) { return {s * a.x, s * a.y, s * a.z}; }
inline Lanes dot(const LaneVec3& a, const LaneVec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline LaneVec3 cross(const LaneVec3& a, const LaneVec3& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// Rigid transforms a_from_b: the axes of b and its origin, in the axes of a.
struct LaneFrame {
    LaneVec3 x, y, z, origin;

    LaneVec3 direction(double u, double v, double w) const { return u * x + v * y + w * z; }

    void set(int lane, const Transform& t) {
        x.set(lane, t.rotation.column(0));
        y.set(lane, t.rotation.column(1));
        z.set(lane, t.rotation.column(2));
        origin.set(lane, t.translation);
    }
    Mat3 rotation(int lane) const {
        return {
            {{x.x[lane], y.x[lane], z.x[lane]}, {x.y[lane], y.y[lane], z.y[lane]}, {x.z[lane], y.z[lane], z.z[lane]}}};
    }
};

inline LaneFrame operator*(const LaneFrame& a, const Transform& b) {
    const auto& m = b.rotation.m;
    return {a.direction(m[0][0], m[1][0], m[2][0]), a.direction(m[0][1], m[1][1], m[2][1]),
            a.direction(m[0][2], m[1][2], m[2][2]),
            a.origin + a.direction(b.translation.x, b.translation.y, b.translation.z)};
}

}  // namespace pinproof
