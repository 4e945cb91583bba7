// Lower bounds of distances between boxes.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "geometry/lanes.h"
#include "geometry/vectors.h"

namespace pinproof {

// The part of an offset from the centre of a box that is outside it, in the frame of the box.
inline Vec3 beyond_box(const Vec3& offset, const Vec3& half) {
    const auto out = [](double x, double h) { return std::copysign(std::max(std::abs(x) - h, 0.0), x); };
    return {out(offset.x, half.x), out(offset.y, half.y), out(offset.z, half.z)};
}

// The vector to a point from the closest point of a box with two opposite corners.
inline Vec3 beyond_box(const Vec3& point, const Vec3& low, const Vec3& high) {
    const auto out = [](double x, double l, double h) { return x < l ? x - l : x > h ? x - h : 0.0; };
    return {out(point.x, low.x, high.x), out(point.y, low.y, high.y), out(point.z, low.z, high.z)};
}

// The square of the distance of a box and a point at `offset` from its centre, in the frame of the box.
inline double squared_point_to_box(const Vec3& offset, const Vec3& half) {
    // In lanes, because a processor does not predict which of the three are positive.
    const Lanes out = lanes_max(lanes_abs(widened(offset)) - widened(half), Lanes{});
    const Lanes squares = out * out;
    return squares[0] + squares[1] + squares[2];
}
inline double point_to_box(const Vec3& offset, const Vec3& half) { return std::sqrt(squared_point_to_box(offset, half)); }

// The largest gap of two boxes along the six normals of their faces; `offset` is the centre of b in the frame of a.
// Sides without end give no gap: comparisons with NaN are false.
inline double gap_of_faces(const Mat3& a_from_b, const Vec3& offset, const Vec3& half_a, const Vec3& half_b) {
    double gap = -std::numeric_limits<double>::infinity();
    for (int i = 0; i < 3; ++i) {
        double reach = half_a[i];
        for (int j = 0; j < 3; ++j) reach += std::abs(a_from_b.m[i][j]) * half_b[j];
        const double here = std::abs(offset[i]) - reach;
        if (here > gap) gap = here;
    }
    const Vec3 offset_b = transposed_times(a_from_b, offset);
    for (int j = 0; j < 3; ++j) {
        double reach = half_b[j];
        for (int i = 0; i < 3; ++i) reach += std::abs(a_from_b.m[i][j]) * half_a[i];
        const double here = std::abs(offset_b[j]) - reach;
        if (here > gap) gap = here;
    }
    return gap;
}

}  // namespace pinproof
