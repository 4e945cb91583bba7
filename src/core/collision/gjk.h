// Lower and upper bounds of the distance of two convex bodies, which are valid even without convergence.
//
// The algorithm of Gilbert, Johnson and Keerthi moves to the point v of B - A that is closest to the origin, using
// support points only. Two bounds are known at every iteration:
//
// - along a unit direction u no point of B - A is below  min_B u . y - max_A u . x,  so that this support gap is a
// lower
//   bound of the distance for any u;
// - v is a convex combination of points of B - A, so that |v| is an upper bound, 0 if the bodies overlap.
//
// Balls are omitted in the iteration and subtracted from both bounds: a sphere is a point, a capsule a segment.
//
// For a mesh, both are the smallest bounds over its triangles (mesh.h).
//
// Sources: E. Gilbert, D. Johnson, S. Keerthi (1988), "A fast procedure for computing the distance between complex
// objects in three-dimensional space", IEEE Journal of Robotics and Automation 4(2); C. Ericson (2005), "Real-time
// collision detection", sections 5.1.5 and 5.1.6 (nearest points of triangle and tetrahedron), 9.5.
#pragma once

#include <limits>

#include "collision/shape.h"
#include "geometry/vectors.h"

namespace pinproof {

// Metres between the two bounds of a distance at which the iteration ends, where nothing coarser suffices.
inline constexpr double kDistancePrecision = 1e-9;

// Up to four points of B - A whose convex combination is the point closest to the origin.
struct Simplex {
    struct Vertex {
        Vec3 difference;      // of the points of b and a, in the frame of a
        Vec3 of_a, of_b;      // the points, each in its own body's frame
        double weight = 0.0;  // the weights of all vertices add up to 1
    };
    Vertex vertices[4];
    int size = 0;
};

// Where a query begins, and what it found. It may begin at the result of an earlier query of the same two bodies:
// points of the bodies remain points of the bodies at every placement.
struct Separation {
    Vec3 direction;  // in the frame of a; zeros: unknown. Afterwards the unit vector whose support gap is the lower
                     // bound.
    Simplex simplex;
    int of_a = -1, of_b = -1;  // of a mesh: the triangle to which direction and simplex belong; -1: unknown
};

// When a query ends; by default with both bounds.
struct DistanceQuery {
    double above = std::numeric_limits<double>::infinity();  // the lower bound exceeds this
    double below = -1.0;                                     // the upper bound is at most this
    double precision = kDistancePrecision;                   // the bounds differ by at most this ...
    double share = 0.0;                                      // ... or this share of upper - below
};

struct DistanceBounds {
    double lower, upper;  // metres; upper is 0 if the bodies overlap
};

// Bounds of the distance of a and b. At the limit of floating point they may differ by more than the precision.
DistanceBounds bound_distance(const Shape& a, const Shape& b, const Transform& a_from_b, const DistanceQuery& query,
                              Separation& separation);

// The same for triangles and shapes without triangles.
DistanceBounds bound_distance(const Triangle& a, const Shape& b, const Transform& a_from_b, const DistanceQuery& query,
                              Separation& separation);
DistanceBounds bound_distance(const Shape& a, const Triangle& b, const Transform& a_from_b, const DistanceQuery& query,
                              Separation& separation);
DistanceBounds bound_distance(const Triangle& a, const Triangle& b, const Transform& a_from_b,
                              const DistanceQuery& query, Separation& separation);

// The points of a and b, in the frame of a, that the simplex of a completed query combines; their balls included.
struct Witnesses {
    Vec3 of_a, of_b;
};
Witnesses witnesses(const Shape& a, const Shape& b, const Separation& separation);

}  // namespace pinproof
