// What a collision checker checks: the joints of a robot, the bodies on them, the obstacles, and the pairs of bodies.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "collision/boxes.h"
#include "collision/gjk.h"
#include "collision/shape.h"
#include "geometry/lanes.h"
#include "geometry/vectors.h"
#include "kinematics/tree.h"

namespace pinproof {

// A body of the robot on a joint or on the root, or an obstacle on the root.
struct Body {
    std::shared_ptr<const Shape> shape;
    int joint = kRoot;
    Transform joint_from_body;
};

// A body at a configuration.
struct PlacedBody {
    Transform root_from_body;
    Vec3 centre;  // of its box, in the root frame
};

inline PlacedBody placed(const Transform& root_from_body, const Shape& shape) {
    return {root_from_body, root_from_body * shape.centre};
}

// A list in pages. Copies share them, so that few are copied if few items are replaced.
template <class T>
class Pages {
public:
    Pages() = default;
    explicit Pages(const std::vector<T>& items) : size_(items.size()) {
        for (std::size_t first = 0; first < size_; first += kPage) {
            pages_.push_back(std::make_shared<Page>());
            std::copy_n(items.begin() + first, std::min(kPage, size_ - first), pages_.back()->begin());
        }
    }
    const T& operator[](std::size_t i) const { return (*pages_[i / kPage])[i % kPage]; }
    std::size_t size() const { return size_; }
    void replace(std::size_t i, const T& item) {
        std::shared_ptr<Page>& page = pages_[i / kPage];
        if (page.use_count() > 1) page = std::make_shared<Page>(*page);
        (*page)[i % kPage] = item;
    }

private:
    static constexpr std::size_t kPage = 64;
    using Page = std::array<T, kPage>;
    std::vector<std::shared_ptr<Page>> pages_;
    std::size_t size_ = 0;
};

// A body that rests on the root.
struct Obstacle {
    std::shared_ptr<const Shape> shape;
    PlacedBody placed;
};

// A box in the root frame around the boxes of some obstacles. The nodes within it follow it.
struct ObstacleNode {
    Bounds box;
    int skip;      // the node after all nodes within this one
    int obstacle;  // its number, if it is a single one; otherwise -1
};

// Obstacles with a tree of boxes around them, which checkers of different robots, tools or parts share.
struct Obstacles {
    Pages<Obstacle> bodies;
    Pages<ObstacleNode> nodes;
    std::shared_ptr<const std::vector<int>> leaves;  // the node of each obstacle

    explicit Obstacles(std::span<const Body> bodies);

    // The same tree with other bodies in place of those with these numbers.
    Obstacles replaced(std::span<const std::int64_t> numbers, std::span<const Body> others) const;

    // Pass the obstacles to `visit(number)` until it returns true, except those in nodes for which `skip(row)` is true.
    template <class Skip, class Visit>
    bool visit(Skip skip, Visit visit) const {
        for (std::size_t row = 0; row < nodes.size();) {
            const ObstacleNode& node = nodes[row];
            const bool skipped = skip(static_cast<int>(row));
            row = skipped ? static_cast<std::size_t>(node.skip) : row + 1;
            if (!skipped && node.obstacle >= 0 && visit(node.obstacle)) return true;
        }
        return false;
    }
};

// The bodies and joints, which checkers with different pairs or margins share. Bodies are numbered: first those of the
// robot (links, then attached objects), then the obstacles.
struct Geometry {
    JointTree tree;
    std::vector<Body> robot;
    std::shared_ptr<const Obstacles> obstacles;
    double rounding = 0.0;  // allowance (m) for floating-point errors, subtracted from every distance

    std::size_t size() const { return robot.size() + obstacles->bodies.size(); }
    const Obstacle& obstacle(int body) const { return obstacles->bodies[static_cast<std::size_t>(body) - robot.size()]; }
    const Shape& shape(int body) const {
        const auto number = static_cast<std::size_t>(body);
        return number < robot.size() ? *robot[number].shape : *obstacle(body).shape;
    }
};

// The joints and bodies of a geometry at a configuration, which must outlive it.
class Placement {
public:
    explicit Placement(const Geometry& geometry);

    // Place the joints and the bodies that they move at q (dof). False if q is not finite: then every moving placement is
    // NaN, so that no previous value is used as a result.
    bool set(const double* q);

    const PlacedBody& operator[](int body) const {
        const auto number = static_cast<std::size_t>(body);
        return number < robot_.size() ? robot_[number] : geometry_->obstacle(body).placed;
    }
    const PlacedBody& of_robot(int body) const { return robot_[static_cast<std::size_t>(body)]; }
    const Transform& joint(int k) const { return joints_[static_cast<std::size_t>(k)]; }

private:
    const Geometry* geometry_;
    std::vector<double> values_, sines_, cosines_;  // of the joints, padded to whole registers
    std::vector<Frame> frames_;                     // the joints, for products
    std::vector<Transform> joints_;
    std::vector<PlacedBody> robot_;
    std::vector<char> in_joint_frame_;  // (robot bodies) whether it is placed as its joint
};

// Two bodies that are checked against each other, the first of the robot.
struct Pair {
    int a, b;
    bool with_obstacle;  // whether b is an obstacle

    // The joints between the bodies: `joints` of them in PairTable::between, from a to b; the first `up` of them carry
    // a, the others b. Mimic multipliers of 0 count; `moving` states whether any joint moves the bodies relative to each
    // other.
    bool moving;
    std::uint32_t first, joints, up;
    int adjacent;  // the number of the pair among those with a single joint between the bodies; -1: another pair
};

// The pairs of the bodies of a geometry, whatever their shapes and places.
struct PairTable {
    std::vector<Pair> pairs;
    std::vector<int> between;         // joints between the bodies of all pairs, see Pair::first
    std::vector<int> own;             // the moving pairs of two bodies of the robot
    std::vector<int> adjacent;        // those with a single joint between them
    std::vector<int> around;          // the robot's bodies with obstacle pairs, from the hand to the base, likely
                                      // contacts first
    std::vector<int> still;           // the pairs that no joint moves relative to each other
    std::vector<int> obstacle_pairs;  // (robot bodies, obstacles) the moving pair of each, or -1
    std::vector<char> is_first;       // (robot bodies) whether a pair begins with it

    PairTable(const Geometry& geometry, std::span<const std::int64_t> bodies);

    // Whether a geometry has as many bodies, on the same joints.
    bool fits(const Geometry& geometry) const;

private:
    // Of the geometry: the joint of each body of the robot; the parent of each joint, and whether it has an influence.
    std::vector<int> joints_, parents_;
    std::vector<char> influence_;
};

// Pairs of placed bodies with their margins.
struct World {
    std::shared_ptr<const Geometry> geometry;
    std::shared_ptr<const PairTable> table;
    std::shared_ptr<const std::vector<double>> margins;  // m, of each pair
    double widest_margin = 0.0;                          // of a pair with an obstacle
    std::vector<int> own;        // the pairs of two bodies of the robot that are checked
    bool uses_obstacles = true;  // false: only `own` is checked

    World(std::shared_ptr<const Geometry> geometry, std::shared_ptr<const PairTable> table, std::vector<double> margins);

    World with_margins(std::vector<double> margins) const;
    World with_obstacles(std::shared_ptr<const Geometry> geometry) const;  // the same robot, pairs and margins
    World of_still_pairs() const;  // checks only the pairs that no joint moves

    const Geometry& space() const { return *geometry; }
    const Shape& shape(int body) const { return geometry->shape(body); }
    std::size_t size() const { return table->pairs.size(); }
    const Pair& pair(int k) const { return table->pairs[static_cast<std::size_t>(k)]; }
    double margin(int k) const { return (*margins)[static_cast<std::size_t>(k)]; }
    // Whether both bodies have a support function, which bounds their distance along a direction.
    bool is_convex(const Pair& pair) const;
    // A direction in the frame of a that separates the bodies at q = 0, if a single joint is between them: they are
    // always close, and the direction hardly changes. Zeros: unknown. Found at q = 0 and not at an earlier query, so
    // that no result depends on earlier queries.
    Vec3 first_direction(const Pair& pair) const {
        return pair.adjacent < 0 ? Vec3{} : first_directions_[static_cast<std::size_t>(pair.adjacent)];
    }
    std::span<const int> joints_between(const Pair& pair) const {
        return {table->between.data() + pair.first, pair.joints};
    }
    int pair_with_obstacle(int body, int obstacle) const {
        return table->obstacle_pairs[static_cast<std::size_t>(body) * geometry->obstacles->bodies.size() +
                                     static_cast<std::size_t>(obstacle)];
    }

private:
    void set_margins(std::vector<double> numbers);

    std::vector<Vec3> first_directions_;  // of the adjacent pairs
};

}  // namespace pinproof
