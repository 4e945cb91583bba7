// What a collision checker checks: the joints of a robot, the bodies on them, the obstacles, and the pairs of bodies.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "collision/gjk.h"
#include "collision/shape.h"
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

// A box in the root frame around the boxes of some obstacles. The nodes within it follow it.
struct ObstacleNode {
    Vec3 low, high;
    int skip;  // the node after all nodes within this one
    int body;  // the obstacle, if it is a single one; otherwise -1
};

// The bodies of obstacles with a tree of boxes around them, which checkers of different robots, tools or parts share.
struct Obstacles {
    std::vector<Body> bodies;
    std::vector<PlacedBody> at_rest;
    std::vector<ObstacleNode> nodes;

    explicit Obstacles(std::vector<Body> bodies);
};

// The bodies and joints, which checkers with different pairs or margins share.
struct Geometry {
    JointTree tree;
    std::vector<Body> bodies;  // first those of the robot (links, then attached objects), then the obstacles
    std::size_t robot_bodies = 0;
    std::vector<PlacedBody> at_rest;  // the placements of the bodies that no joint moves; others are undefined
    std::vector<ObstacleNode> obstacles;
    double rounding = 0.0;  // allowance (m) for floating-point errors, subtracted from every distance

    Geometry(JointTree tree, std::vector<Body> robot, const Obstacles& others, double rounding);

    const Shape& shape(int body) const { return *bodies[static_cast<std::size_t>(body)].shape; }
};

// Two bodies that are checked against each other, the first of the robot.
struct Pair {
    int a, b;
    double margin;       // m
    bool with_obstacle;  // whether b is an obstacle
    bool convex;         // whether both have a support function, which bounds their distance along a direction

    // The joints between the bodies: `joints` of them in World::between, from a to b; the first `up` of them carry a,
    // the others b. Mimic multipliers of 0 count; `moving` states whether any joint moves the bodies relative to each
    // other.
    std::uint32_t first, joints, up;
    bool moving;

    // A direction in the frame of a that separates the bodies at q = 0, if a single joint is between them: they are
    // always close, and the direction hardly changes. Zeros: unknown. Found at q = 0 and not at an earlier query, so
    // that no result depends on earlier queries.
    Vec3 first_direction;
};

// A list that copies of a world share.
template <class T>
class Shared {
public:
    Shared() = default;
    explicit Shared(std::vector<T> items) : owner_(std::make_shared<std::vector<T>>(std::move(items))), span_(*owner_) {}

    const T& operator[](std::size_t i) const { return span_[i]; }
    const T& at(std::size_t i) const { return owner_->at(i); }
    std::size_t size() const { return span_.size(); }
    auto begin() const { return span_.begin(); }
    auto end() const { return span_.end(); }
    std::vector<T> copy() const { return {begin(), end()}; }

private:
    std::shared_ptr<const std::vector<T>> owner_;
    std::span<const T> span_;
};

struct World {
    std::shared_ptr<const Geometry> geometry;
    Shared<Pair> pairs;
    std::vector<int> between;  // joints between the bodies of all pairs, see Pair::first
    std::vector<int> own;      // the moving pairs of two bodies of the robot
    std::vector<int>
        around;              // the robot's bodies with obstacle pairs, from the hand to the base, likely contacts first
    std::vector<int> still;      // the pairs that no joint moves relative to each other
    Shared<int> obstacle_pairs;  // (robot bodies, obstacles) the moving pair of each, or -1
    bool uses_obstacles = true;       // false: only `own` is checked
    double widest_margin = 0.0;       // of a pair with an obstacle

    World(std::shared_ptr<const Geometry> geometry, std::span<const std::int64_t> pairs,
          std::span<const double> margins);

    World with_margins(std::span<const double> margins) const;
    World of_still_pairs() const;  // checks only the pairs that no joint moves

    const Geometry& space() const { return *geometry; }
    const Shape& shape(int body) const { return geometry->shape(body); }
    std::span<const int> joints_between(const Pair& pair) const { return {between.data() + pair.first, pair.joints}; }
    int pair_with_obstacle(int body, int obstacle) const {
        const std::size_t obstacles = geometry->bodies.size() - geometry->robot_bodies;
        return obstacle_pairs[static_cast<std::size_t>(body) * obstacles + static_cast<std::size_t>(obstacle) -
                              geometry->robot_bodies];
    }
};

// Place the joints and the bodies that they move at q (dof); the other bodies must be placed already. False if q is not
// finite: then every moving placement is NaN, so that no previous value is used as a result.
bool place(const Geometry& geometry, const double* q, std::span<Transform> joints, std::span<PlacedBody> bodies);

}  // namespace pinproof
