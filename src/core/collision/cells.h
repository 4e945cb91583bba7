// Many boxes that are one body, such as the occupied cells of a point cloud: a tree of boxes around them, and distances
// by branch and bound.
//
// The distance of the body is the smallest of its boxes, each of which is a convex shape (gjk.h). Nodes of the tree are
// visited, the closer half first, and left out if they are farther than the smallest upper bound so far. The lower bound
// is the smallest one of all measured boxes and of all nodes that were left out.
//
// Source: C. Ericson (2005), "Real-time collision detection", sections 6.1 and 6.3.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "collision/boxes.h"
#include "collision/gjk.h"
#include "collision/shape.h"
#include "geometry/vectors.h"

namespace pinproof {

struct CellBox {
    Vec3 centre, half;
};

struct CellTree {
    BoxTree tree;
    std::vector<CellBox> boxes;  // in the order of the leaves

    CellTree() = default;

    // Boxes from `low` (N, 3) to `high` (N, 3), in cells of a side (m), which do not overlap. They are joined along z,
    // then y, then x, if they have a common face.
    CellTree(std::span<const std::int64_t> low, std::span<const std::int64_t> high, double side);
};

// A box as a convex shape.
Shape shape_of(const CellBox& box);

// A convex shape or a mesh in the frame of the boxes, to bound its distance from them.
struct BesideCells {
    const Shape& shape;
    Mat3 shape_from_cells;
    Vec3 centre;  // of the shape, in the frame of the boxes

    BesideCells(const Shape& shape, const Transform& shape_from_cells)
        : shape(shape),
          shape_from_cells(shape_from_cells.rotation),
          centre(transposed_times(shape_from_cells.rotation, shape.centre - shape_from_cells.translation)) {}

    // A lower bound (m) of the distance; it need not be close beyond `enough`.
    double gap(const Vec3& box_centre, const Vec3& half, double enough) const {
        const Vec3 offset = centre - box_centre;
        const double gap = point_to_box(offset, half) - shape.ball;
        if (gap > enough) return gap;
        return std::max(gap, gap_of_faces(shape_from_cells, shape_from_cells * -offset, shape.half, half));
    }
};

// Pass the boxes that may be within `enough()` (m) of a shape to `visit(box)`, the closer half of each node first, until
// it returns true; nodes and boxes that are left out are passed to `leave(gap)`.
template <class Enough, class Visit, class Leave>
void visit_cells(const CellTree& cells, const BesideCells& beside, Enough enough, Visit visit, Leave leave) {
    struct Entry {
        std::int32_t node;
        double gap;
    };
    constexpr std::size_t kDepth = 40;  // each level halves the boxes, whose number has 31 bits
    Entry stack[kDepth];
    const auto entry = [&](std::int32_t row) {
        return Entry{row, beside.gap(cells.tree.nodes[row].centre, cells.tree.nodes[row].half, enough())};
    };
    int top = 0;
    stack[top++] = entry(0);
    bool ended = false;
    while (top > 0) {
        const Entry here = stack[--top];
        if (ended || here.gap > enough()) {
            leave(here.gap);
            continue;
        }
        const BoxNode& node = cells.tree.nodes[here.node];
        if (node.count == 0) {
            Entry near = entry(here.node + 1), far = entry(node.second_child);
            if (near.gap > far.gap) std::swap(near, far);
            stack[top++] = far;
            stack[top++] = near;
            continue;
        }
        for (std::int32_t i = node.first; i < node.first + node.count; ++i) {
            const double gap = beside.gap(cells.boxes[i].centre, cells.boxes[i].half, enough());
            if (ended || gap > enough())
                leave(gap);
            else
                ended = visit(i);
        }
    }
}

// bound_distance if b is many boxes.
DistanceBounds bound_cell_distance(const Shape& a, const Shape& b, const Transform& a_from_b,
                                   const DistanceQuery& query, Separation& separation);

}  // namespace pinproof
