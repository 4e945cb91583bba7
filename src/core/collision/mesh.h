// Triangle meshes: a tree of boxes around the triangles, distances by branch and bound, and the enclosed volume.
//
// The distance of a mesh is the smallest of its triangles. Both bounds of the distance of a triangle are known (gjk.h),
// and that of boxes is a lower bound for all triangles within them. Pairs of nodes of the two trees are visited, the
// closer ones first, and left out if their boxes are farther apart than the smallest upper bound so far. The lower bound
// of the distance is the smallest one of all measured triangles and of all nodes that were left out.
//
// Surfaces are hollow. If two surfaces are apart, a body is inside a closed mesh if one of its points is. This is so if
// the surface winds about the point: a ray from the point crosses it more often outwards than inwards, or the reverse.
// If the ray is so close to an edge that rounding decides, another one is used; after the last one, the solid angles of
// all triangles are added up.
//
// Sources: E. Larsen, S. Gottschalk, M. Lin, D. Manocha (2000), "Fast distance queries with rectangular swept sphere
// volumes", IEEE ICRA (distances with bounding volume hierarchies); A. van Oosterom, J. Strackee (1983), "The solid
// angle of a plane triangle", IEEE Transactions on Biomedical Engineering 30(2), equation 8.
#pragma once

#include <span>
#include <vector>

#include "collision/boxes.h"
#include "collision/gjk.h"
#include "collision/shape.h"
#include "geometry/vectors.h"

namespace pinproof {

struct TriangleMesh {
    BoxTree tree;
    std::vector<Triangle> triangles;  // in the order of the leaves
    std::vector<Vec3> witnesses;      // a point of each connected part
    bool closed = false;              // whether the triangles enclose a volume

    TriangleMesh() = default;

    // `corners` has nine coordinates per triangle, `points` three per witness.
    TriangleMesh(std::span<const double> corners, std::span<const double> points, bool closed);

    // Whether a point is inside; never if the mesh is not closed.
    bool contains(const Vec3& point) const;
};

// bound_distance if one body or both are meshes. A body inside a closed mesh overlaps it: then both bounds are 0.
DistanceBounds bound_mesh_distance(const Shape& a, const Shape& b, const Transform& a_from_b,
                                   const DistanceQuery& query, Separation& separation);

// What is asked of the parts of two bodies, one of which is a mesh: its triangles, and boxes about some of them.
class PartsQuestion {
public:
    virtual ~PartsQuestion() = default;

    // Whether parts are left out that are `gap` (m) apart, and `along` along the direction that was measured last.
    virtual bool leave(double gap, double along) = 0;
    // The bounds of two triangles, or of one and a convex body, and the direction of the lower one in the frame of a;
    // false ends the search, before all parts were seen.
    virtual bool measured(const DistanceBounds& bounds, const Vec3& direction) = 0;
};

// Ask about the parts of two bodies, the closer ones first, beginning with a direction that separates some of them; false
// if the search was ended. Neither of the bodies is a half-space.
bool visit_parts(const Shape& a, const Shape& b, const Transform& a_from_b, const DistanceQuery& query,
                 const Vec3& direction, PartsQuestion& question);

}  // namespace pinproof
