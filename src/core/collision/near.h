// The bodies that are in contact, or closest, at one configuration.
//
// Far pairs are decided by balls and boxes, obstacles many at once by a tree of boxes, and the others by bounds of
// their distance (gjk.h).
#pragma once

#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "collision/world.h"
#include "geometry/lanes.h"

namespace pinproof {

// A lower bound (m) of the distance of two placed bodies, from their balls and boxes; a larger bound is not searched
// for once it exceeds `enough`. `a_from_b` is set if it was computed.
double separation_of_bounds(const PlacedBody& a, const Shape& shape_a, const PlacedBody& b, const Shape& shape_b,
                            double enough, std::optional<Transform>& a_from_b);

// The result for one configuration.
struct Nearest {
    // Bounds (m) of the smallest distance over the pairs that do not overlap.
    double lower = std::numeric_limits<double>::infinity();
    double upper = std::numeric_limits<double>::infinity();
    int pair = -1;  // the pair of `upper`
};

// Distances of a placed pair, with the points and the direction that prove them.
struct Measured {
    DistanceBounds bounds;
    Witnesses points;  // in the root frame
    Vec3 normal;       // the unit vector from a to b along which their supports are `bounds.lower` apart; of a mesh,
                       // that of its closest triangle
    std::array<const Triangle*, 2> triangles;  // of a and b, if they are meshes: the closest ones, or two that overlap
};

// The bodies of a world at one configuration. Each thread needs its own.
class Workspace {
public:
    explicit Workspace(std::shared_ptr<const World> world);

    // Place the bodies at q; false if q is not finite.
    bool place_at(const double* q) { return bodies_.set(q); }

    // The questions about the placed bodies. A pair is in contact unless it is proven farther apart than its margin.

    // Whether a pair is in contact. Stops at the first one.
    bool any_contact();
    // All pairs in contact are in contacts().
    void find_contacts();
    // The pair with the smallest distance; those that are not proven apart are in contacts().
    Nearest find_nearest();

    Measured measure(int pair) const;

    // The boxes of cells that are not proven apart from the first body of a pair.
    std::vector<int> overlapping_boxes(int pair) const;

    const std::vector<int>& contacts() const { return contacts_; }
    const World& world() const { return *world_; }
    const Placement& bodies() const { return bodies_; }

private:
    template <class Question>
    bool ask(Question& question);
    template <class Question>
    bool judge(int pair, std::optional<Transform>& a_from_b, Question& question);

    // Pairs that were in contact recently and are checked first, because they are often in contact again. The results
    // do not depend on the order.
    static constexpr std::size_t kLikely = 8;

    // The boxes of four obstacles. A processor core compares a body with four boxes as fast as with one node of the
    // tree, whose branches it cannot predict, so that few obstacles are compared one after the other.
    struct FourBoxes {
        LaneVec3 low, high;
        std::array<int, kLanes> obstacles;
    };
    static constexpr std::size_t kMostInRow = 32;
    template <class Limit, class Visit>
    bool visit_obstacles(int body, Limit limit, Visit visit) const;

    // Two bodies that are checked, the first of the robot, the sum of their balls, and the square of the distance of their centres up
    // to which they may be in contact.
    struct OwnPair {
        int a, b;
        double balls, squared_reach;
    };

    std::shared_ptr<const World> world_;
    std::vector<OwnPair> own_;     // those of World::own
    std::vector<FourBoxes> four_;  // in the order of the tree; empty for more than kMostInRow obstacles
    Placement bodies_;
    std::vector<int> contacts_;
    std::array<int, kLikely> likely_;
};

}  // namespace pinproof
