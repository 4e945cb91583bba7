#include "collision/shape.h"

#include <algorithm>
#include <limits>

namespace pinproof {
namespace {

// Whether the points are the corners of a box about a centre, each once; finds the box.
bool are_corners(std::span<const double> points, Vec3& centre, Vec3& half) {
    if (points.size() != 24) return false;
    double low[3], high[3];
    for (int c = 0; c < 3; ++c) {
        low[c] = high[c] = points[c];
        for (int i = 1; i < 8; ++i) {
            low[c] = std::min(low[c], points[3 * i + c]);
            high[c] = std::max(high[c], points[3 * i + c]);
        }
    }
    unsigned seen = 0;
    for (int i = 0; i < 8; ++i) {
        unsigned corner = 0;
        for (int c = 0; c < 3; ++c) {
            const double x = points[3 * i + c];
            if (x != low[c] && x != high[c]) return false;
            if (x == high[c]) corner |= 1u << c;
        }
        seen |= 1u << corner;
    }
    centre = {0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.5 * (low[2] + high[2])};
    half = Vec3{high[0], high[1], high[2]} - centre;
    // The corners must be found again exactly, so that a point of the box is a point of the body.
    const bool exact = centre.x - half.x == low[0] && centre.y - half.y == low[1] && centre.z - half.z == low[2] &&
                       centre.x + half.x == high[0] && centre.y + half.y == high[1] && centre.z + half.z == high[2];
    return seen == 0xff && exact;
}

std::vector<PointBlock> pack(std::span<const double> points, std::span<const double> discs) {
    const std::size_t count = discs.size();
    std::vector<PointBlock> blocks((count + kBlock - 1) / kBlock);
    for (std::size_t i = 0; i < blocks.size() * kBlock; ++i) {
        const std::size_t source = std::min(i, count - 1);
        PointBlock& block = blocks[i / kBlock];
        const std::size_t h = i % kBlock / kLanes, lane = i % kLanes;
        block.x[h][lane] = points[3 * source];
        block.y[h][lane] = points[3 * source + 1];
        block.z[h][lane] = points[3 * source + 2];
        block.disc[h][lane] = discs[source];
    }
    return blocks;
}

}  // namespace

Shape make_shape(ShapeKind kind, std::span<const double> points, std::span<const double> discs, double radius,
                 const Vec3& semi_axes, const Vec3& low, const Vec3& high) {
    Shape shape;
    shape.kind = kind;
    shape.radius = radius;
    shape.semi_axes = semi_axes;
    shape.has_ellipsoid = semi_axes.x > 0.0;
    shape.has_discs = std::ranges::any_of(discs, [](double disc) { return disc != 0.0; });
    if (kind == ShapeKind::kConvex) {
        shape.points = pack(points, discs);
        shape.is_box =
            !shape.has_discs && !shape.has_ellipsoid && are_corners(points, shape.corners_centre, shape.corners_half);
    }
    shape.centre = 0.5 * (low + high);
    shape.half = 0.5 * (high - low);
    const double size = dot(shape.centre, shape.centre) + dot(shape.half, shape.half);
    if (!std::isfinite(size)) {  // A body without end is never decided by its box.
        constexpr double inf = std::numeric_limits<double>::infinity();
        shape.centre = {};
        shape.half = {inf, inf, inf};
    }
    shape.ball = norm(shape.half);
    if (kind == ShapeKind::kConvex) {
        double reach = 0.0;
        for (std::size_t i = 0; i < discs.size(); ++i)
            reach = std::max(reach,
                             norm(Vec3{points[3 * i], points[3 * i + 1], points[3 * i + 2]} - shape.centre) + discs[i]);
        reach += radius + std::max({semi_axes.x, semi_axes.y, semi_axes.z});
        shape.ball = std::min(shape.ball, reach);
    }
    return shape;
}

}  // namespace pinproof
