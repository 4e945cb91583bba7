// How far points in a convex hull are from its surface along directions, which measures how closely a hull fits a mesh.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <span>

#include "geometry/vectors.h"

namespace pinproof {

// A plane of a face: normal . x + offset <= 0 in the hull.
struct FacePlane {
    Vec3 normal;
    double offset;
};

// A plane is not reached along a direction whose slope towards it is at most this.
inline constexpr double kLeastSlope = 1e-9;

// The distance from a point to the surface of the hull along a unit direction; infinite if no plane is reached. The
// result is only exact above `enough`, at which the search for a nearer plane ends.
inline double hull_space(std::span<const FacePlane> planes, const Vec3& point, const Vec3& direction, double enough) {
    double least = std::numeric_limits<double>::infinity();
    for (const FacePlane& plane : planes) {
        const double slope = dot(plane.normal, direction);
        const double height = std::max(-(dot(plane.normal, point) + plane.offset), 0.0);
        // height / slope < least, without a division
        if (slope <= kLeastSlope || height >= least * slope) continue;
        least = height / slope;
        if (least <= enough) break;
    }
    return least;
}

}  // namespace pinproof
