// Boxes: lower bounds of distances between them, and trees of boxes around the parts of a body.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <span>
#include <vector>

#include "geometry/lanes.h"
#include "geometry/vectors.h"

namespace pinproof {

// The part of an offset from the centre of a box that is outside it, in the frame of the box.
inline Vec3 beyond_box(const Vec3& offset, const Vec3& half) {
    const auto out = [](double x, double h) { return std::copysign(std::max(std::abs(x) - h, 0.0), x); };
    return {out(offset.x, half.x), out(offset.y, half.y), out(offset.z, half.z)};
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

// Half the extent along a direction of a box with half sides; the direction is in the frame of the box.
inline double half_extent(const Vec3& half, const Vec3& d) {
    return std::abs(d.x) * half.x + std::abs(d.y) * half.y + std::abs(d.z) * half.z;
}

// A box by two opposite corners; at first it contains nothing.
struct Bounds {
    static constexpr double kInfinity = std::numeric_limits<double>::infinity();
    Vec3 low{kInfinity, kInfinity, kInfinity}, high{-kInfinity, -kInfinity, -kInfinity};

    void add(const Vec3& p) {
        low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
        high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
    }
    void add(const Bounds& other) {
        add(other.low);
        add(other.high);
    }
    int longest_side() const {
        const Vec3 width = high - low;
        return width.x >= width.y && width.x >= width.z ? 0 : width.y >= width.z ? 1 : 2;
    }
};

// The vector to a point from the closest point of a box.
inline Vec3 beyond_box(const Vec3& point, const Bounds& box) {
    const auto out = [](double x, double l, double h) { return x < l ? x - l : x > h ? x - h : 0.0; };
    return {out(point.x, box.low.x, box.high.x), out(point.y, box.low.y, box.high.y), out(point.z, box.low.z, box.high.z)};
}

// The axis along which items are divided: that of the longest side of the box around their centres.
template <class Item, class Centre>
int dividing_axis(std::span<const Item> items, Centre centre) {
    Bounds centres;
    for (const Item& item : items) centres.add(centre(item));
    return centres.longest_side();
}

// A box of a tree. Its first child is the next node.
struct BoxNode {
    Vec3 centre, half;
    std::int32_t first = 0, count = 0;  // its items; none if it has children
    std::int32_t second_child = 0;
};

// A tree of boxes around items, which are halved along the longest side of their centres.
class BoxTree {
public:
    std::vector<BoxNode> nodes;

    // Build the tree of the items with these centres, in leaves of up to `most_in_leaf`; returns their order in the
    // leaves. `bounds_of(i)` is the box around item i, to which `more` is added on each side.
    template <class BoundsOf>
    std::vector<std::int32_t> build(std::span<const Vec3> centres, std::size_t most_in_leaf, double more,
                                    BoundsOf bounds_of) {
        std::vector<std::int32_t> order(centres.size());
        std::iota(order.begin(), order.end(), 0);
        nodes.reserve(centres.size() + 1);
        const auto centre = [&](std::int32_t i) -> const Vec3& { return centres[i]; };
        // Append the node of some items and all nodes within it; returns the box around the items.
        const auto append = [&](const auto& self, std::size_t first, std::size_t last) -> Bounds {
            const std::size_t here = nodes.size();
            nodes.emplace_back();
            const std::span<std::int32_t> items(order.begin() + first, order.begin() + last);
            Bounds box;
            if (items.size() <= most_in_leaf) {
                nodes[here].first = static_cast<std::int32_t>(first);
                nodes[here].count = static_cast<std::int32_t>(items.size());
                std::ranges::sort(items);
                for (std::int32_t i : items) box.add(bounds_of(i));
            } else {
                const int axis = dividing_axis(std::span<const std::int32_t>(items), centre);
                const std::size_t half = items.size() / 2;
                std::ranges::nth_element(items, items.begin() + static_cast<std::ptrdiff_t>(half), [&](int i, int j) {
                    const double x = centres[i][axis], y = centres[j][axis];
                    return x != y ? x < y : i < j;  // a total order, so that every library builds the same tree
                });
                box = self(self, first, first + half);
                nodes[here].second_child = static_cast<std::int32_t>(nodes.size());
                box.add(self(self, first + half, last));
            }
            nodes[here].centre = 0.5 * (box.low + box.high);
            nodes[here].half = 0.5 * (box.high - box.low) + Vec3{more, more, more};
            return box;
        };
        append(append, 0, order.size());
        return order;
    }
};

}  // namespace pinproof
