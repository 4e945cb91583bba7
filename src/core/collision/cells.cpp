#include "collision/cells.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace pinproof {
namespace {

constexpr std::size_t kLeafBoxes = 4;

// Boxes of nodes are enlarged by this share of the largest coordinate, against rounding.
constexpr double kBoxRounding = 1e-15;

constexpr double kFar = std::numeric_limits<double>::infinity();

// Cells from `low` up to, but without, `high`.
struct CellRange {
    std::array<std::int64_t, 3> low, high;
};

// Join ranges that follow each other along an axis and have the same ends along the two others.
void join_along(std::vector<CellRange>& ranges, int axis) {
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    const auto ends = [&](const CellRange& r) {
        return std::array{r.low[u], r.low[v], r.high[u], r.high[v], r.low[axis]};
    };
    std::ranges::sort(ranges, {}, ends);
    std::size_t last = 0;
    for (std::size_t i = 1; i < ranges.size(); ++i) {
        CellRange& before = ranges[last];
        const CellRange& next = ranges[i];
        if (next.low[axis] == before.high[axis] && next.low[u] == before.low[u] && next.low[v] == before.low[v] &&
            next.high[u] == before.high[u] && next.high[v] == before.high[v])
            before.high[axis] = next.high[axis];
        else
            ranges[++last] = next;
    }
    ranges.resize(last + 1);
}

}  // namespace

CellTree::CellTree(std::span<const std::int64_t> low, std::span<const std::int64_t> high, double side) {
    std::vector<CellRange> ranges(low.size() / 3);
    for (std::size_t i = 0; i < low.size(); ++i) {
        ranges[i / 3].low[i % 3] = low[i];
        ranges[i / 3].high[i % 3] = high[i];
    }
    for (int axis : {2, 1, 0}) join_along(ranges, axis);
    std::vector<CellBox> source;
    std::vector<Vec3> centres;
    double largest = 0.0;
    for (const CellRange& range : ranges) {
        const auto corner = [&](const std::array<std::int64_t, 3>& at) {
            return Vec3{static_cast<double>(at[0]) * side, static_cast<double>(at[1]) * side,
                        static_cast<double>(at[2]) * side};
        };
        const Vec3 least = corner(range.low), most = corner(range.high);
        source.push_back({0.5 * (least + most), 0.5 * (most - least)});
        centres.push_back(source.back().centre);
        largest = std::max({largest, size_1(least), size_1(most)});
    }
    boxes.reserve(source.size());
    const auto box = [&](std::int32_t i) {
        return Bounds{source[i].centre - source[i].half, source[i].centre + source[i].half};
    };
    for (std::int32_t i : tree.build(centres, kLeafBoxes, kBoxRounding * largest, box)) boxes.push_back(source[i]);
}

Shape shape_of(const CellBox& box) {
    Shape shape;
    shape.is_box = true;
    shape.corners_centre = shape.centre = box.centre;
    shape.corners_half = shape.half = box.half;
    shape.ball = norm(box.half);
    return shape;
}

DistanceBounds bound_cell_distance(const Shape& a, const Shape& b, const Transform& a_from_b,
                                   const DistanceQuery& query, Separation& separation) {
    const CellTree& cells = *b.cells;
    const BesideCells beside(a, a_from_b);
    DistanceBounds bounds{kFar, kFar};
    const auto enough = [&] {
        if (!(bounds.upper < kFar)) return query.above;
        const double precision = std::max(query.precision, query.share * (bounds.upper - query.below));
        return std::min(query.above, bounds.upper - precision);
    };
    const auto measure = [&](std::int32_t i, Separation& of_box) {
        DistanceQuery closer = query;
        closer.above = std::min(query.above, bounds.upper);
        of_box.of_b = 0;  // For a mesh, a box is one convex body. The simplex is of the triangle and of this box.
        const DistanceBounds found = bound_distance(a, shape_of(cells.boxes[i]), a_from_b, closer, of_box);
        of_box.of_b = i;
        bounds.lower = std::min(bounds.lower, found.lower);
        const bool best = found.upper < bounds.upper;
        if (best) bounds.upper = found.upper;
        return best;
    };
    const auto decided = [&] { return bounds.upper <= query.below || !(bounds.lower > -kFar); };
    // The box that was closest in an earlier query most often still is.
    const std::int32_t earlier = separation.of_b >= 0 && separation.of_b < static_cast<int>(cells.boxes.size())
                                     ? separation.of_b : -1;
    if (earlier >= 0) measure(earlier, separation);
    else separation.simplex.size = 0;
    bool ended = decided();
    visit_cells(
        cells, beside, enough,
        [&](std::int32_t i) {
            if (ended || i == earlier) return ended;
            Separation of_box;
            of_box.direction = a_from_b * cells.boxes[i].centre - a.centre;
            if (measure(i, of_box) || separation.of_b < 0) separation = of_box;
            return ended = decided();
        },
        [&](double gap) { bounds.lower = std::min(bounds.lower, gap); });
    return bounds;
}

}  // namespace pinproof
