// Surfaces of triangles: equal points, connected parts, whether they are closed, and where lines meet them.
//
// Points and edges are found in hash tables with open addressing, so that the time is proportional to their number.
// Parts are sets of triangles that are joined along edges (B. Galler, M. Fischer (1964), "An improved equivalence
// algorithm", Communications of the ACM 7(5)).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "geometry/vectors.h"

namespace pinproof {

// For each point (N, 3) the number of the first point that is equal to it.
std::vector<std::int64_t> first_equal_points(std::span<const double> points);

struct SurfaceParts {
    std::vector<std::int64_t> part_of;  // of each triangle; parts are numbered by their first triangles
    bool closed;  // whether each edge of a part joins exactly two of its triangles, once in each direction
};

// The parts of triangles, three different vertices each, which are connected over edges that join exactly two
// triangles, once in each direction. Others do not connect: bodies that touch are separate parts.
SurfaceParts surface_parts(std::span<const std::int64_t> triangles);

// For each line, from its origin (three numbers) along a unit direction, the depth (m) at which it first meets a triangle
// (nine numbers) at or beyond `start`, and the unit normal there that opposes the direction; infinity and zero on a
// miss. Both sides of a triangle count, and a line within the plane of a triangle does not meet it.
void enter_triangles(std::span<const double> triangles, std::span<const double> origins, const Vec3& direction,
                     std::span<const double> start, std::span<double> depth, std::span<Vec3> normals);

// A plane of a face: normal . x + offset <= 0 in the hull.
struct FacePlane {
    Vec3 normal;
    double offset;
};

// The distance from a point to the surface of the hull along a unit direction; infinite if no plane is reached. The
// result is only exact above `enough`, at which the search for a nearer plane ends.
double hull_space(std::span<const FacePlane> planes, const Vec3& point, const Vec3& direction, double enough);

}  // namespace pinproof
