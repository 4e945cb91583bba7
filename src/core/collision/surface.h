// The topology of a surface of triangles: equal points, connected parts, and whether they are closed.
//
// Points and edges are found in hash tables with open addressing, so that the time is proportional to their number.
// Parts are sets of triangles that are joined along edges (B. Galler, M. Fischer (1964), "An improved equivalence
// algorithm", Communications of the ACM 7(5)).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

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

}  // namespace pinproof
