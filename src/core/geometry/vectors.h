// Vectors, rotation matrices and rigid transforms of three dimensions.
#pragma once

#include <cmath>

namespace pinproof {

struct Vec3 {
    double x = 0.0, y = 0.0, z = 0.0;

    double operator[](int i) const { return i == 0 ? x : i == 1 ? y : z; }
    double& operator[](int i) { return i == 0 ? x : i == 1 ? y : z; }
};

inline Vec3 operator+(const Vec3& a, const Vec3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3 operator-(const Vec3& a, const Vec3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3 operator-(const Vec3& a) { return {-a.x, -a.y, -a.z}; }
inline Vec3 operator*(double s, const Vec3& a) { return {s * a.x, s * a.y, s * a.z}; }
inline Vec3& operator+=(Vec3& a, const Vec3& b) { return a = a + b; }
inline Vec3& operator-=(Vec3& a, const Vec3& b) { return a = a - b; }

inline double dot(const Vec3& a, const Vec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3 cross(const Vec3& a, const Vec3& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double squared_norm(const Vec3& a) { return dot(a, a); }
inline double size_1(const Vec3& a) { return std::abs(a.x) + std::abs(a.y) + std::abs(a.z); }
inline double norm(const Vec3& a) { return std::sqrt(dot(a, a)); }

// A rotation matrix; m[row][column].
struct Mat3 {
    double m[3][3] = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}};

    Vec3 row(int i) const { return {m[i][0], m[i][1], m[i][2]}; }
    Vec3 column(int j) const { return {m[0][j], m[1][j], m[2][j]}; }
};

inline Vec3 operator*(const Mat3& a, const Vec3& v) { return {dot(a.row(0), v), dot(a.row(1), v), dot(a.row(2), v)}; }

// a^T v.
inline Vec3 transposed_times(const Mat3& a, const Vec3& v) {
    return {dot(a.column(0), v), dot(a.column(1), v), dot(a.column(2), v)};
}

// a^T b.
inline Mat3 transposed_times(const Mat3& a, const Mat3& b) {
    Mat3 product;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            product.m[i][j] = a.m[0][i] * b.m[0][j] + a.m[1][i] * b.m[1][j] + a.m[2][i] * b.m[2][j];
    return product;
}

inline Mat3 operator*(const Mat3& a, const Mat3& b) {
    Mat3 product;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            product.m[i][j] = a.m[i][0] * b.m[0][j] + a.m[i][1] * b.m[1][j] + a.m[i][2] * b.m[2][j];
    return product;
}

// A rigid transform a_from_b: p_a = rotation p_b + translation.
struct Transform {
    Mat3 rotation;
    Vec3 translation;
};

inline Vec3 operator*(const Transform& a, const Vec3& p) { return a.rotation * p + a.translation; }
inline Transform operator*(const Transform& a, const Transform& b) {
    return {a.rotation * b.rotation, a * b.translation};
}

inline Transform inverse(const Transform& a) {
    Transform out;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) out.rotation.m[i][j] = a.rotation.m[j][i];
    out.translation = -transposed_times(a.rotation, a.translation);
    return out;
}

// b_from_c for a_from_b and a_from_c.
inline Transform relative(const Transform& a_from_b, const Transform& a_from_c) {
    return {transposed_times(a_from_b.rotation, a_from_c.rotation),
            transposed_times(a_from_b.rotation, a_from_c.translation - a_from_b.translation)};
}

// The rotation about a unit vector by an angle of the given sine and cosine (Rodrigues).
inline Mat3 rotation_about(const Vec3& axis, double sine, double cosine) {
    const Vec3 v = (1.0 - cosine) * axis, s = sine * axis;
    return {{{cosine + v.x * axis.x, v.x * axis.y - s.z, v.x * axis.z + s.y},
             {v.x * axis.y + s.z, cosine + v.y * axis.y, v.y * axis.z - s.x},
             {v.x * axis.z - s.y, v.y * axis.z + s.x, cosine + v.z * axis.z}}};
}

// Multiply from the right by a rotation about z, of the given sine and cosine.
inline void rotate_about_z(Mat3& a, double sine, double cosine) {
    for (int i = 0; i < 3; ++i) {
        const double x = a.m[i][0], y = a.m[i][1];
        a.m[i][0] = x * cosine + y * sine;
        a.m[i][1] = y * cosine - x * sine;
    }
}

// The first three rows of a homogeneous matrix, row by row (12 numbers, the rows `stride` apart), read and written.
inline Transform read_transform(const double* rows, int stride = 4) {
    Transform t;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) t.rotation.m[i][j] = rows[i * stride + j];
    t.translation = {rows[3], rows[stride + 3], rows[2 * stride + 3]};
    return t;
}
inline void write_homogeneous(const Transform& t, double* out) {
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) out[4 * i + j] = t.rotation.m[i][j];
        out[4 * i + 3] = t.translation[i];
        out[12 + i] = 0.0;
    }
    out[15] = 1.0;
}

}  // namespace pinproof
