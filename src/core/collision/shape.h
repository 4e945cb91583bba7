// The shape of a body: its support function if it is convex, or its triangles, and the volumes that bound it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "geometry/lanes.h"
#include "geometry/vectors.h"

namespace pinproof {

inline constexpr std::size_t kBlock = 2 * kLanes;

// Eight points, coordinate by coordinate. The last block of a shape is filled by repeating a point.
struct PointBlock {
    Lanes x[2], y[2], z[2];
    Lanes disc[2];  // radius of a flat disc about the point, perpendicular to z
};

enum class ShapeKind {
    kConvex,
    kHalfSpace,  // everything below z = 0 of its own frame
    kMesh,       // triangles, see mesh.h
    kCells,      // boxes, see cells.h; only as an obstacle
};

struct TriangleMesh;
struct CellTree;

// A triangle of a mesh: a convex shape of three points.
struct Triangle {
    static constexpr double radius = 0.0;
    Vec3 corners[3];
};

// A convex shape is the hull of points, each with a flat disc, to which a ball and an ellipsoid are added (Minkowski
// sums): a sphere is a point and a ball, a cylinder has two points with discs.
struct Shape {
    ShapeKind kind = ShapeKind::kConvex;
    std::shared_ptr<const TriangleMesh> mesh;  // of a mesh only
    std::shared_ptr<const CellTree> cells;     // of cells only
    std::vector<PointBlock> points;
    // The points that may be the farthest one along the directions of each cell, see direction_cell: `of_cells[c]` is the
    // number of the first block of cell c. Empty for few points, which are compared as fast.
    std::vector<PointBlock> by_direction;
    std::vector<std::uint32_t> of_cells;
    bool has_discs = false;
    bool is_box = false;  // the points are the eight corners of the box `corners_centre` +- `corners_half`
    Vec3 corners_centre, corners_half;
    double radius = 0.0;  // of the ball
    Vec3 semi_axes;       // of the ellipsoid; zeros: none
    bool has_ellipsoid = false;

    // A box and a ball about its centre, each of which contains the shape; infinite for a half-space.
    Vec3 centre, half;
    double ball = 0.0;
};

// `points` has three coordinates per point and `discs` one radius; `low` and `high` are corners of a box around the
// shape.
Shape make_shape(ShapeKind kind, std::span<const double> points, std::span<const double> discs, double radius,
                 const Vec3& semi_axes, const Vec3& low, const Vec3& high);

// The number of the cell of a direction: which component is the longest, whether each of the two others is longer than half of
// it, and the signs of all three. The cell is the cone around a rectangle on a side of a cube.
inline constexpr std::size_t kDirectionCells = 96;
inline std::size_t direction_cell(const Vec3& d) {
    const double x = std::abs(d.x), y = std::abs(d.y), z = std::abs(d.z);
    const bool is_y = y > x, is_z = z > std::max(x, y);
    const std::size_t axis = is_z ? 2 : is_y;
    const double longest = is_z ? z : is_y ? y : x, u = axis == 0 ? y : x, v = is_z ? y : z;
    return axis * 32 + (2.0 * u > longest) * 16 + (2.0 * v > longest) * 8 + std::signbit(d.x) * 4 + std::signbit(d.y) * 2 +
           std::signbit(d.z);
}

namespace detail {

// The point with the largest dot product with d, to which `flat` times its disc radius is added; and that disc radius.
template <bool discs>
inline Vec3 extreme_point(std::span<const PointBlock> blocks, const Vec3& d, double flat, double& disc) {
    Lanes best[2], index[2];
    for (int h = 0; h < 2; ++h) {
        best[h] = blocks[0].x[h] * d.x + blocks[0].y[h] * d.y + blocks[0].z[h] * d.z;
        if constexpr (discs) best[h] += blocks[0].disc[h] * flat;
        index[h] = Lanes{};
    }
    for (std::size_t i = 1; i < blocks.size(); ++i) {
        const PointBlock& block = blocks[i];
        const Lanes here = Lanes{} + static_cast<double>(i);
        for (int h = 0; h < 2; ++h) {
            Lanes reach = block.x[h] * d.x + block.y[h] * d.y + block.z[h] * d.z;
            if constexpr (discs) reach += block.disc[h] * flat;
            const LaneMask farther = reach > best[h];
            best[h] = farther ? reach : best[h];
            index[h] = farther ? here : index[h];
        }
    }
    const LaneMask upper = best[1] > best[0];
    const Lanes reach = upper ? best[1] : best[0];
    const Lanes block_of = upper ? index[1] : index[0];
    int lane = 0;
    for (int i = 1; i < kLanes; ++i)
        if (reach[i] > reach[lane]) lane = i;
    const PointBlock& block = blocks[static_cast<std::size_t>(block_of[lane])];
    const int h = upper[lane] != 0 ? 1 : 0;
    if constexpr (discs) disc = block.disc[h][lane];
    return {block.x[h][lane], block.y[h][lane], block.z[h][lane]};
}

}  // namespace detail

// The point of a convex shape, without its ball, that is farthest along d (any length), in the frame of the shape.
inline Vec3 support(const Shape& shape, const Vec3& d) {
    if (shape.is_box)
        return {shape.corners_centre.x + std::copysign(shape.corners_half.x, d.x),
                shape.corners_centre.y + std::copysign(shape.corners_half.y, d.y),
                shape.corners_centre.z + std::copysign(shape.corners_half.z, d.z)};
    Vec3 point;
    const double flat = shape.has_discs ? std::sqrt(d.x * d.x + d.y * d.y) : 0.0;
    double disc = 0.0;
    if (flat > 0.0) {
        point = detail::extreme_point<true>(shape.points, d, flat, disc);
        point.x += disc / flat * d.x;
        point.y += disc / flat * d.y;
    } else {
        std::span<const PointBlock> blocks = shape.points;
        if (!shape.of_cells.empty()) {
            const std::uint32_t* first = &shape.of_cells[direction_cell(d)];
            blocks = {&shape.by_direction[first[0]], first[1] - first[0]};
        }
        point = detail::extreme_point<false>(blocks, d, flat, disc);
    }
    if (shape.has_ellipsoid) {
        const Vec3 s = shape.semi_axes;
        const Vec3 stretched{s.x * s.x * d.x, s.y * s.y * d.y, s.z * s.z * d.z};
        const double length = std::sqrt(dot(stretched, d));
        if (length > 0.0) point += (1.0 / length) * stretched;
    }
    return point;
}

inline Vec3 support(const Triangle& triangle, const Vec3& d) {
    const Vec3 &a = triangle.corners[0], &b = triangle.corners[1], &c = triangle.corners[2];
    const double along_a = dot(a, d), along_b = dot(b, d), along_c = dot(c, d);
    if (along_a >= along_b) return along_a >= along_c ? a : c;
    return along_b >= along_c ? b : c;
}

}  // namespace pinproof
