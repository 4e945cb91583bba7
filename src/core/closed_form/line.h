// The lines of joints, their motions, and the curves on which they move points and directions.
#pragma once

#include <cmath>

#include "geometry/sincos.h"
#include "geometry/vectors.h"

namespace pinproof {

// The value of a joint in the form in which the equations are linear: (cos q, sin q) of a revolute joint, (q, q^2) of a
// prismatic one.
struct JointState {
    double first = 1.0, second = 0.0;
};

inline JointState prismatic_state(double value) { return {value, value * value}; }

// The line about which a joint rotates, or along which it moves, when all joints are at zero.
struct Line {
    Vec3 direction;  // unit
    Vec3 point;      // any point of the line, in lengths of the arm
    bool prismatic = false;
    double reference = 0.0;  // the value of the joint where it is free
};

// Forward: by the motion of the joint. Backward: by its inverse.
enum class Sense { forward, backward };

inline double sign_of(Sense sense) { return sense == Sense::forward ? 1.0 : -1.0; }

// v rotated about the unit vector h (Rodrigues).
inline Vec3 rotated(const Vec3& h, double cosine, double sine, const Vec3& v) {
    return cosine * v + ((1.0 - cosine) * dot(h, v)) * h + sine * cross(h, v);
}

// The component of v that is perpendicular to the unit vector h.
inline Vec3 across(const Vec3& v, const Vec3& h) { return v - dot(h, v) * h; }

inline Vec3 unit_perpendicular(const Vec3& h) {
    const double x = std::abs(h.x), y = std::abs(h.y), z = std::abs(h.z);
    if (x <= y && x <= z) return (1.0 / std::hypot(h.y, h.z)) * Vec3{0.0, -h.z, h.y};
    if (y <= z) return (1.0 / std::hypot(h.x, h.z)) * Vec3{h.z, 0.0, -h.x};
    return (1.0 / std::hypot(h.x, h.y)) * Vec3{-h.y, h.x, 0.0};
}

inline Vec3 move_point(const Line& line, const JointState& state, Sense sense, const Vec3& p) {
    const double sign = sign_of(sense);
    if (line.prismatic) return p + (sign * state.first) * line.direction;
    return line.point + rotated(line.direction, state.first, sign * state.second, p - line.point);
}

// A prismatic joint keeps directions.
inline Vec3 move_direction(const Line& line, const JointState& state, Sense sense, const Vec3& v) {
    return line.prismatic ? v : rotated(line.direction, state.first, sign_of(sense) * state.second, v);
}

// The points centre + first * state.first + second * state.second.
struct Curve {
    Vec3 centre, first, second;

    Vec3 at(const JointState& state) const { return centre + state.first * first + state.second * second; }
};

// The curve of a point that a joint moves: a circle about its line, or a straight line parallel to it.
inline Curve point_curve(const Line& line, Sense sense, const Vec3& p) {
    const double sign = sign_of(sense);
    if (line.prismatic) return {p, sign * line.direction, {}};
    const Vec3 v = p - line.point;
    const Vec3 centre = line.point + dot(line.direction, v) * line.direction;
    return {centre, p - centre, sign * cross(line.direction, v)};
}

// The curve of a direction, which only a revolute joint changes.
inline Curve direction_curve(const Line& line, Sense sense, const Vec3& v) {
    if (line.prismatic) return {v, {}, {}};
    const Vec3 centre = dot(line.direction, v) * line.direction;
    return {centre, v - centre, sign_of(sense) * cross(line.direction, v)};
}

inline JointState reference_state(const Line& line) {
    if (line.prismatic) return prismatic_state(line.reference);
    const auto [sine, cosine] = sincos(line.reference);
    return {cosine, sine};
}

// The derivative of the state of a joint by its value.
inline JointState derivative(const JointState& state, bool prismatic) {
    return prismatic ? JointState{1.0, 2.0 * state.first} : JointState{-state.second, state.first};
}

// The state after the joint has moved by `step`.
inline JointState advanced(const JointState& state, bool prismatic, double step) {
    if (prismatic) return prismatic_state(state.first + step);
    const auto [sine, cosine] = sincos(step);
    return {state.first * cosine - state.second * sine, state.first * sine + state.second * cosine};
}

// The rotation about the unit vector h that aligns v with w.
struct Alignment {
    JointState state;
    double size;  // the product of the distances of v and w from h; 0: undetermined
};

// From the components perpendicular to h: v . w - (h . v)(h . w) would lose a short component, for example of a nearly
// straight wrist.
inline Alignment align(const Vec3& h, const Vec3& v, const Vec3& w) {
    const Vec3 a = across(v, h), b = across(w, h);
    const double c = dot(a, b), s = dot(h, cross(a, b));
    const double size = std::sqrt(c * c + s * s);
    if (size == 0.0) return {{1.0, 0.0}, 0.0};
    return {{c / size, s / size}, size};
}

}  // namespace pinproof
