#include "collision/shape.h"

#include <algorithm>
#include <array>
#include <cstring>
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

// Shapes with fewer points than this have no cells; those with more than the second number have none either, because the cells
// take time, which few queries of a large hull would save.
constexpr std::size_t kFewPoints = 2 * kBlock, kManyPoints = 1024;

// Size-relative distance by which a point must be behind another along all directions of a cell to be left out of it.
constexpr double kBehind = 1e-12;

// Those of some points that may be the farthest one along a direction of the cone with these four edges: at an edge, none of the
// farthest points of the edges is beyond them, and the directions of the cone are sums of multiples of its edges.
std::vector<std::array<double, 3>> farthest(std::span<const std::array<double, 3>> points, const Vec3 (&edges)[4], double size) {
    std::vector<Lanes> along(points.size());
    std::array<std::size_t, 4> best{};
    for (std::size_t i = 0; i < points.size(); ++i) {
        for (int k = 0; k < 4; ++k) {
            along[i][k] = dot(edges[k], Vec3{points[i][0], points[i][1], points[i][2]});
            if (along[i][k] > along[best[k]][k]) best[k] = i;
        }
    }
    std::vector<std::array<double, 3>> kept;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const Lanes reached = along[i] + kBehind * size;
        if (std::ranges::all_of(best, [&](std::size_t b) { return any(~(along[b] > reached)); })) kept.push_back(points[i]);
    }
    return kept;
}

void sort_into_cells(Shape& shape, std::span<const double> coordinates) {
    std::vector<std::array<double, 3>> points(coordinates.size() / 3);
    std::memcpy(points.data(), coordinates.data(), coordinates.size_bytes());
    double size = 0.0;
    for (double x : coordinates) size = std::max(size, std::abs(x));
    shape.of_cells.resize(kDirectionCells + 1);
    std::vector<PointBlock> cells[kDirectionCells];
    for (unsigned side = 0; side < 24; ++side) {
        // The edges of the cone where the other components are between these shares of the longest one.
        const unsigned axis = side / 8, first = axis == 0 ? 1 : 0, second = axis == 2 ? 1 : 2;
        const auto cone = [&](std::span<const std::array<double, 3>> some, double u, double v, double length) {
            Vec3 edges[4];
            for (unsigned k = 0; k < 4; ++k) {
                edges[k][axis] = 1.0;
                edges[k][first] = u + (k & 1) * length;
                edges[k][second] = v + (k >> 1) * length;
                for (unsigned c = 0; c < 3; ++c)
                    if (side & (4u >> c)) edges[k][c] = -edges[k][c];
            }
            return farthest(some, edges, size);
        };
        const auto on_side = cone(points, 0.0, 0.0, 1.0);
        for (unsigned part = 0; part < 4; ++part) {
            const auto kept = cone(on_side, 0.5 * (part >> 1), 0.5 * (part & 1), 0.5);
            const std::vector<double> no_discs(kept.size());
            cells[axis * 32 + part * 8 + side % 8] = pack({kept[0].data(), 3 * kept.size()}, no_discs);
        }
    }
    for (std::size_t c = 0; c < kDirectionCells; ++c) {
        shape.by_direction.insert(shape.by_direction.end(), cells[c].begin(), cells[c].end());
        shape.of_cells[c + 1] = static_cast<std::uint32_t>(shape.by_direction.size());
    }
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
        if (!shape.has_discs && discs.size() > kFewPoints && discs.size() <= kManyPoints) sort_into_cells(shape, points);
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
