// Where parallel lines first meet triangles: the visible surface of a mesh along a direction.
#pragma once

#include <span>

#include "geometry/vectors.h"

namespace pinproof {

// For each line, from its origin (three numbers) along a unit direction, the depth (m) at which it first meets a triangle
// (nine numbers) at or beyond `start`, and the unit normal there that opposes the direction; infinity and zero on a
// miss. Both sides of a triangle count, and a line within the plane of a triangle does not meet it.
void enter_triangles(std::span<const double> triangles, std::span<const double> origins, const Vec3& direction,
                     std::span<const double> start, std::span<double> depth, std::span<Vec3> normals);

}  // namespace pinproof
