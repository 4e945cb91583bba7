#include "collision/mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace pinproof {
namespace {

// Largest number of triangles in a leaf.
constexpr std::size_t kLeafTriangles = 2;

// Boxes are enlarged by this share of the largest coordinate, so that the rounding of a ray never misses one.
constexpr double kEnlarged = 1e-12;

// Share of the products of its terms below which the sign of a triple product is not certain.
constexpr double kUncertain = 1e-11;

// Largest depth of a tree: each level halves the triangles, whose number has 31 bits.
constexpr std::size_t kTreeDepth = 32;

constexpr double kUnbounded = std::numeric_limits<double>::infinity();

// Directions of rays, in no plane or line of symmetry that a machine part is likely to have.
constexpr std::array<Vec3, 4> kRays = {{{0.0712, 0.1239, 0.9897},
                                        {0.9812, -0.1123, 0.1571},
                                        {-0.1434, -0.9713, 0.1897},
                                        {-0.5171, 0.6113, -0.5991}}};

// Whether a ray from `from` intersects a box, with `inverse` one over the coordinates of its direction.
bool meets_box(const Vec3& from, const Vec3& inverse, const BoxNode& node) {
    double enter = 0.0, leave = kUnbounded;
    for (int i = 0; i < 3; ++i) {
        const double middle = (node.centre[i] - from[i]) * inverse[i], reach = std::abs(node.half[i] * inverse[i]);
        enter = std::max(enter, middle - reach);
        leave = std::min(leave, middle + reach);
    }
    return enter <= leave;
}

enum class Crossing { kNone, kOutwards, kInwards, kUncertain };

// How a ray crosses a triangle.
Crossing cross_triangle(const Vec3& from, const Vec3& ray, const Triangle& triangle) {
    const Vec3 a = triangle.corners[0] - from, b = triangle.corners[1] - from, c = triangle.corners[2] - from;
    // On which side of each edge the line of the ray is: all the same if it crosses the triangle.
    const auto side = [&](const Vec3& p, const Vec3& q) {
        const double volume = dot(cross(p, q), ray), uncertain = kUncertain * size_1(p) * size_1(q);
        return volume > uncertain ? 1 : volume < -uncertain ? -1 : 0;
    };
    const int sides[] = {side(a, b), side(b, c), side(c, a)};
    const auto [least, most] = std::ranges::minmax(sides);
    if (least < 0 && most > 0) return Crossing::kNone;
    // Whether the triangle is ahead of the point.
    const double height = dot(cross(a, b), c), uncertain = kUncertain * size_1(a) * size_1(b) * size_1(c);
    if (least == 0 || most == 0 || std::abs(height) <= uncertain) {
        // Behind the point, nothing is uncertain.
        const bool behind = dot(a, ray) < 0.0 && dot(b, ray) < 0.0 && dot(c, ray) < 0.0;
        return behind ? Crossing::kNone : Crossing::kUncertain;
    }
    if ((height > 0.0) != (most > 0)) return Crossing::kNone;
    return most > 0 ? Crossing::kOutwards : Crossing::kInwards;
}

// The winding number of the triangles about a point: the sum of their solid angles over 4 pi.
double winding_number(const std::vector<Triangle>& triangles, const Vec3& point) {
    double angles = 0.0;
    for (const Triangle& triangle : triangles) {
        const Vec3 a = triangle.corners[0] - point, b = triangle.corners[1] - point, c = triangle.corners[2] - point;
        const double la = norm(a), lb = norm(b), lc = norm(c);
        angles += 2.0 * std::atan2(dot(cross(a, b), c),
                                   la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb);
    }
    return angles / (4.0 * std::numbers::pi);
}

// One body of a distance query: the nodes of a mesh, or a convex shape as a leaf.
struct Side {
    explicit Side(const Shape& shape)
        : mesh(shape.mesh.get()), whole{shape.centre, shape.half, 0, 1, 0}, ball(shape.ball) {}

    const BoxNode* root() const { return mesh ? mesh->tree.nodes.data() : &whole; }

    const TriangleMesh* mesh;
    BoxNode whole;
    double ball;
};

// A search for the smallest distance.
class Descent {
public:
    Descent(const Shape& a, const Shape& b, const Transform& a_from_b, const DistanceQuery& query, Separation& best)
        : a_(a), b_(b), a_from_b_(a_from_b), query_(query), best_(best), side_a_(a), side_b_(b) {}

    DistanceBounds run() {
        remeasure();
        set_plane(best_.direction);
        if (bounds_.upper <= query_.below) {
            bounds_.lower = std::min(bounds_.lower, gap(*side_a_.root(), *side_b_.root()));
            return bounds_;
        }
        NodePair stack[2 * kTreeDepth + 2];
        int top = 0;
        stack[top++] = {side_a_.root(), side_b_.root(), -kUnbounded};
        while (top > 0) {
            const NodePair here = stack[--top];
            if (here.gap > enough()) {
                bounds_.lower = std::min(bounds_.lower, here.gap);
                continue;
            }
            const bool leaf_a = here.a->count > 0, leaf_b = here.b->count > 0;
            if (leaf_a && leaf_b) {
                measure_leaves(here);
                // The end: the nodes that were not visited are not farther than stated.
                if (bounds_.upper <= query_.below || !(bounds_.lower > -kUnbounded)) {
                    while (top > 0) bounds_.lower = std::min(bounds_.lower, stack[--top].gap);
                    break;
                }
                continue;
            }
            for (const NodePair& half : halves(here)) {
                if (half.gap > enough())
                    bounds_.lower = std::min(bounds_.lower, half.gap);
                else
                    stack[top++] = half;
            }
        }
        return bounds_;
    }

    bool visit(const Vec3& direction, PartsQuestion& question) {
        set_plane(direction);
        NodePair stack[2 * kTreeDepth + 2];
        int top = 0;
        stack[top++] = {side_a_.root(), side_b_.root(), -kUnbounded};
        while (top > 0) {
            const NodePair here = stack[--top];
            if (question.leave(here.gap, along_plane(*here.a, *here.b))) continue;
            if (here.a->count == 0 || here.b->count == 0) {
                for (const NodePair& half : halves(here)) stack[top++] = half;
                continue;
            }
            for (int i = here.a->first; i < here.a->first + here.a->count; ++i)
                for (int j = here.b->first; j < here.b->first + here.b->count; ++j) {
                    if (question.leave(-kUnbounded, along_plane(i, j))) continue;
                    Separation separation;
                    separation.direction = plane_;
                    const DistanceBounds bounds = of_triangles(i, j, query_, separation);
                    if (!question.measured(bounds, separation.direction)) return false;
                    set_plane(separation.direction);
                }
        }
        return true;
    }

private:
    struct NodePair {
        const BoxNode *a, *b;
        double gap;  // between their boxes
    };

    // The pairs into which one is divided at its larger node, the closer one last.
    std::array<NodePair, 2> halves(const NodePair& whole) const {
        const bool leaf_a = whole.a->count > 0, leaf_b = whole.b->count > 0;
        const bool divide_a = leaf_b || (!leaf_a && squared_norm(whole.a->half) >= squared_norm(whole.b->half));
        NodePair near = whole, far = whole;
        const BoxNode*& near_node = divide_a ? near.a : near.b;
        const BoxNode*& far_node = divide_a ? far.a : far.b;
        const std::vector<BoxNode>& nodes = (divide_a ? side_a_ : side_b_).mesh->tree.nodes;
        far_node = nodes.data() + near_node->second_child;
        ++near_node;
        near.gap = gap(*near.a, *near.b);
        far.gap = gap(*far.a, *far.b);
        if (near.gap > far.gap) std::swap(near, far);
        return {far, near};
    }

    // Beyond this distance, nodes and triangles need not be visited.
    double enough() const {
        if (!(bounds_.upper < kUnbounded)) return query_.above;
        const double precision = std::max(query_.precision, query_.share * (bounds_.upper - query_.below));
        return std::min(query_.above, bounds_.upper - precision);
    }

    double gap(const BoxNode& a, const BoxNode& b) const {
        if (b_.kind == ShapeKind::kHalfSpace) {
            const Vec3 up = a_from_b_.rotation.column(2);
            return dot(up, a.centre - a_from_b_.translation) - half_extent(a.half, up);
        }
        const Vec3 offset = a_from_b_ * b.centre - a.centre;
        double gap = gap_of_faces(a_from_b_.rotation, offset, a.half, b.half);
        if (side_b_.mesh == nullptr) gap = std::max(gap, point_to_box(offset, a.half) - side_b_.ball);
        if (side_a_.mesh == nullptr)
            gap = std::max(gap, point_to_box(transposed_times(a_from_b_.rotation, offset), b.half) - side_a_.ball);
        // The direction that separates the closest triangles so far separates those next to them, too.
        return std::max(gap, along_plane(a, b));
    }

    // The gap of two nodes along the direction of the plane, if there is one.
    double along_plane(const BoxNode& a, const BoxNode& b) const {
        if (!has_plane_) return -kUnbounded;
        const double top = side_a_.mesh ? dot(plane_, a.centre) + half_extent(a.half, plane_) : top_;
        const double bottom =
            side_b_.mesh ? dot(plane_, a_from_b_ * b.centre) - half_extent(b.half, plane_in_b_) : bottom_;
        return bottom - top;
    }

    // The same of two triangles.
    double along_plane(int i, int j) const {
        if (!has_plane_) return -kUnbounded;
        const double top = side_a_.mesh ? dot(plane_, support(side_a_.mesh->triangles[i], plane_)) : top_;
        const double bottom =
            side_b_.mesh ? dot(plane_, a_from_b_ * support(side_b_.mesh->triangles[j], -plane_in_b_)) : bottom_;
        return bottom - top;
    }

    // Take a vector of any length in the frame of a as the direction of further gaps.
    void set_plane(const Vec3& direction) {
        has_plane_ = squared_norm(direction) > 0.0 && b_.kind != ShapeKind::kHalfSpace;
        if (!has_plane_) return;
        const Vec3 u = (1.0 / norm(direction)) * direction;
        plane_ = u;
        plane_in_b_ = transposed_times(a_from_b_.rotation, u);
        if (side_a_.mesh == nullptr) top_ = dot(u, support(a_, u)) + a_.radius;
        if (side_b_.mesh == nullptr) bottom_ = dot(u, a_from_b_ * support(b_, -plane_in_b_)) - b_.radius;
    }

    // Measure the triangles that were closest in an earlier query; most often they still are.
    void remeasure() {
        const auto valid = [](int triangle, const Side& side) {
            return triangle >= 0 && triangle < static_cast<int>(side.mesh ? side.mesh->triangles.size() : 1);
        };
        if (!valid(best_.of_a, side_a_) || !valid(best_.of_b, side_b_)) {
            best_.simplex.size = 0;  // It is not of one triangle.
            return;
        }
        bounds_ = of_triangles(best_.of_a, best_.of_b, query_, best_);
    }

    void measure_leaves(const NodePair& leaves) {
        for (int i = leaves.a->first; i < leaves.a->first + leaves.a->count; ++i)
            for (int j = leaves.b->first; j < leaves.b->first + leaves.b->count; ++j) {
                if (i == best_.of_a && j == best_.of_b) continue;  // measured already
                Separation separation;
                separation.direction = best_.direction;
                if (!(squared_norm(separation.direction) > 0.0) && b_.kind != ShapeKind::kHalfSpace)
                    separation.direction = a_from_b_ * leaves.b->centre - leaves.a->centre;
                separation.of_a = i;
                separation.of_b = j;
                DistanceQuery query = query_;
                query.above = std::min(query.above, bounds_.upper);
                const DistanceBounds found = of_triangles(i, j, query, separation);
                if (found.upper < bounds_.upper || !(bounds_.upper < kUnbounded)) set_plane(separation.direction);
                bounds_.lower = std::min(bounds_.lower, found.lower);
                if (found.upper < bounds_.upper) {
                    bounds_.upper = found.upper;
                    best_ = separation;
                }
            }
    }

    DistanceBounds of_triangles(int i, int j, const DistanceQuery& query, Separation& separation) const {
        if (side_a_.mesh == nullptr)
            return bound_distance(a_, side_b_.mesh->triangles[j], a_from_b_, query, separation);
        const Triangle& triangle = side_a_.mesh->triangles[i];
        return side_b_.mesh ? bound_distance(triangle, side_b_.mesh->triangles[j], a_from_b_, query, separation)
                            : bound_distance(triangle, b_, a_from_b_, query, separation);
    }

    const Shape &a_, &b_;
    const Transform& a_from_b_;
    const DistanceQuery& query_;
    Separation& best_;
    Side side_a_, side_b_;
    bool has_plane_ = false;
    Vec3 plane_, plane_in_b_;           // the direction of further gaps, in the frames of a and b
    double top_ = 0.0, bottom_ = 0.0;  // the extents of a convex a and a convex b along it
    DistanceBounds bounds_{kUnbounded, kUnbounded};
};

// Whether a connected part of `inner` is inside the mesh of `outer`, if their surfaces are apart.
bool contains_part(const Shape& outer, const Shape& inner, const Transform& outer_from_inner) {
    if (outer.kind != ShapeKind::kMesh || !outer.mesh->closed || inner.kind == ShapeKind::kHalfSpace) return false;
    if (inner.kind == ShapeKind::kMesh)
        return std::ranges::any_of(inner.mesh->witnesses,
                                   [&](const Vec3& point) { return outer.mesh->contains(outer_from_inner * point); });
    return outer.mesh->contains(outer_from_inner * support(inner, {1.0, 0.0, 0.0}));
}

}  // namespace

bool visit_parts(const Shape& a, const Shape& b, const Transform& a_from_b, const DistanceQuery& query,
                 const Vec3& direction, PartsQuestion& question) {
    Separation unknown;
    return Descent(a, b, a_from_b, query, unknown).visit(direction, question);
}

TriangleMesh::TriangleMesh(std::span<const double> corners, std::span<const double> points, bool closed_)
    : closed(closed_) {
    const auto vectors = [](std::span<const double> x, std::size_t i) {
        return Vec3{x[3 * i], x[3 * i + 1], x[3 * i + 2]};
    };
    std::vector<Triangle> source(corners.size() / 9);
    for (std::size_t i = 0; i < 3 * source.size(); ++i) source[i / 3].corners[i % 3] = vectors(corners, i);
    for (std::size_t i = 0; i < points.size() / 3; ++i) witnesses.push_back(vectors(points, i));
    Bounds all;
    std::vector<Vec3> centres;  // three times that of each triangle
    for (const Triangle& triangle : source) {
        for (const Vec3& corner : triangle.corners) all.add(corner);
        centres.push_back(triangle.corners[0] + triangle.corners[1] + triangle.corners[2]);
    }
    const double more = kEnlarged * std::max(size_1(all.low), size_1(all.high));
    triangles.reserve(source.size());
    const auto box = [&](std::int32_t i) {
        Bounds around;
        for (const Vec3& corner : source[i].corners) around.add(corner);
        return around;
    };
    for (std::int32_t i : tree.build(centres, kLeafTriangles, more, box)) triangles.push_back(source[i]);
}

bool TriangleMesh::contains(const Vec3& point) const {
    const BoxNode& all = tree.nodes[0];
    const Vec3 offset = point - all.centre;
    const bool within = std::abs(offset.x) <= all.half.x && std::abs(offset.y) <= all.half.y &&
                        std::abs(offset.z) <= all.half.z;
    if (!closed || !within) return false;
    for (const Vec3& ray : kRays) {
        const Vec3 inverse{1.0 / ray.x, 1.0 / ray.y, 1.0 / ray.z};
        std::int32_t stack[kTreeDepth + 1];
        int top = 0, turns = 0;
        bool certain = true;
        stack[top++] = 0;
        while (top > 0 && certain) {
            const std::int32_t row = stack[--top];
            const BoxNode& node = tree.nodes[row];
            if (!meets_box(point, inverse, node)) continue;
            if (node.count == 0) {
                stack[top++] = node.second_child;
                stack[top++] = row + 1;
            }
            for (std::int32_t i = node.first; i < node.first + node.count; ++i) {
                const Crossing crossing = cross_triangle(point, ray, triangles[i]);
                certain = certain && crossing != Crossing::kUncertain;
                turns += crossing == Crossing::kOutwards ? 1 : crossing == Crossing::kInwards ? -1 : 0;
            }
        }
        if (certain) return turns != 0;
    }
    return std::abs(winding_number(triangles, point)) > 0.5;
}

DistanceBounds bound_mesh_distance(const Shape& a, const Shape& b, const Transform& a_from_b,
                                   const DistanceQuery& query, Separation& separation) {
    const DistanceBounds bounds = Descent(a, b, a_from_b, query, separation).run();
    if (!(bounds.upper > 0.0) || !(bounds.lower > -kUnbounded)) return bounds;
    const bool nested = contains_part(a, b, a_from_b) || contains_part(b, a, inverse(a_from_b));
    return nested ? DistanceBounds{0.0, 0.0} : bounds;
}

}  // namespace pinproof
