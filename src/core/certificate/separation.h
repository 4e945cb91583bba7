// The directions along which a body of the robot separates from obstacles that it may touch at the start of a curve.
//
// departure.h proves that a body never approaches an obstacle along one direction. Directions are tried in the order of
// their gap at the start, the largest first, until the body is proven to separate: z of the root, the axes of the
// obstacle, and the line of the nearest points. Directions along which the two overlap more than at the start are left
// out. Whatever is farther away at the start than `near` needs no direction, because the ordinary proof covers it.
//
// A mesh is not convex, and each of its facets is left along a direction of its own. The facets close to the body are
// found by the tree of the mesh, and their normals are tried too. The direction that serves the most facets comes first,
// and those that it does not serve are left to the next one. A group is then extended by all facets of the mesh with no
// larger extent along its direction: the same proof holds for them, and a verdict does not depend on how finely a plane
// is cut into facets.
#pragma once

#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "certificate/departure.h"

namespace pinproof {

struct SeparationSettings {
    double near;                 // m; beyond the required distance, pairs and facets are close up to this
    double deepest;              // m; the largest overlap at the start
    double displaced;            // m; how far obstacles may be displaced
    double tolerance;            // m, and the number of intervals: see Departure::follow
    std::int64_t max_intervals;
};

// An obstacle, or some facets of it, from which a body separates along one direction.
struct SeparatingGroup {
    Vec3 normal;
    double level;             // m, the extent along it
    double gap;               // m, at the start; negative in overlap
    double slack;             // m, by which the gap at the end of the proof exceeds the required distance
    DepartureProof proof;     // `until` is infinity if no direction separates them
    std::vector<int> facets;  // of a mesh, in increasing order
};

struct PairSeparation {
    bool far = false;                     // whether the ordinary proof covers the pair
    bool overlaps = false;                // whether the bodies are not proven apart at the start
    double gap = 0.0;                     // m, along the best direction; of a mesh, of the facet with the smallest one
    std::vector<SeparatingGroup> groups;  // none if the overlap is too deep, or if no facet is close
    bool complete = false;                // whether every facet that is close is in a group
    std::vector<int> rest;                // the facets of a mesh in no group, if there are groups
    std::vector<int> unclear;             // facets that overlap a convex body along each direction, the deepest first
};

// A body of the robot at a configuration, and an obstacle that no joint moves. Directions are in the root frame.
struct ClosePair {
    const PlacedBody &body, &other;
    std::shared_ptr<const Shape> hull;  // of the body
    const Shape& obstacle;

    // z of the root and the axes of the obstacle; of a half-space, its normal.
    std::vector<Vec3> directions() const;
    // The least n . y over the points y of the body.
    double lowest(const Vec3& normal) const;
    // The facets of a mesh that may be within `reach` (m) of the body; some directions are tried to exclude others.
    std::vector<int> near_facets(std::span<const Vec3> tried, double reach) const;
    // Append the most frequent normals of facets, and their opposites.
    void append_normals(std::span<const int> facets, std::vector<Vec3>& directions) const;
    // The unit normal of a facet, and its extent (m) along a direction.
    Vec3 normal_of(int facet) const;
    double top(int facet, const Vec3& normal) const;
    // Unit vectors to the facets within `reach` (m): opposite to the direction of the largest gap of each.
    std::vector<Vec3> directions_to_facets(double reach) const;
};

// The convex hull of a body.
std::shared_ptr<const Shape> hull_of(const std::shared_ptr<const Shape>& shape);

// The separations of pairs along a curve. `more` are further directions to try; those without the length 1 are left out,
// because along them gaps are no distances.
std::vector<PairSeparation> separate(const World& world, const CurveView& curve, const SeparationSettings& settings,
                                     std::span<const int> pairs, std::span<const Vec3> more);

}  // namespace pinproof
