#include "collision/world.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "collision/near.h"

namespace pinproof {
namespace {

struct Bounds {
    Vec3 low, high, centre;
};

// The box in the root frame around the box of an obstacle.
Bounds bounds_of(const PlacedBody& placed, const Vec3& half) {
    Bounds bounds{placed.centre, placed.centre, placed.centre};
    for (int i = 0; i < 3; ++i) {
        double reach = 0.0;
        for (int j = 0; j < 3; ++j) reach += std::abs(placed.root_from_body.rotation.m[i][j]) * half[j];
        if (std::isnan(reach)) reach = std::numeric_limits<double>::infinity();  // 0 times a side without end
        bounds.low[i] -= reach;
        bounds.high[i] += reach;
    }
    return bounds;
}

// An obstacle while the tree is built.
struct Member {
    Vec3 centre;
    int body;
};

// The axes along which obstacles were halved, the latest first: obstacles at one place along it are in the order along
// the earlier ones, and then of their numbers.
struct Axes {
    int axis[3];
    int count = 0;

    void put_first(int latest) {
        int* end = std::remove(axis, axis + count, latest);
        std::copy_backward(axis, end, end + 1);
        axis[0] = latest;
        count = static_cast<int>(end - axis) + 1;
    }
    bool operator()(const Member& a, const Member& b) const {
        for (int i = 0; i < count; ++i) {
            const double x = a.centre[axis[i]], y = b.centre[axis[i]];
            if (x != y) return x < y;
        }
        return a.body < b.body;
    }
};

// Append the node of some obstacles and all nodes within it. They are halved along the longest side of their centres.
void add_nodes(std::vector<ObstacleNode>& nodes, std::span<Member> members, const std::vector<Bounds>& bounds,
               Axes axes = {}) {
    const std::size_t here = nodes.size();
    if (members.size() == 1) {
        const Bounds& own = bounds[members[0].body];
        nodes.push_back({own.low, own.high, static_cast<int>(here) + 1, members[0].body});
        return;
    }
    Vec3 low = members[0].centre, high = low;
    for (const Member& member : members)
        for (int i = 0; i < 3; ++i) {
            low[i] = std::min(low[i], member.centre[i]);
            high[i] = std::max(high[i], member.centre[i]);
        }
    const Vec3 width = high - low;
    axes.put_first(width.x >= width.y && width.x >= width.z ? 0 : width.y >= width.z ? 1 : 2);
    const std::size_t half = members.size() / 2;
    std::ranges::nth_element(members, members.begin() + static_cast<std::ptrdiff_t>(half), axes);
    nodes.emplace_back();
    add_nodes(nodes, members.first(half), bounds, axes);
    const std::size_t second = nodes.size();
    add_nodes(nodes, members.subspan(half), bounds, axes);
    ObstacleNode& node = nodes[here];
    node = {nodes[here + 1].low, nodes[here + 1].high, static_cast<int>(nodes.size()), -1};
    for (int i = 0; i < 3; ++i) {
        node.low[i] = std::min(node.low[i], nodes[second].low[i]);
        node.high[i] = std::max(node.high[i], nodes[second].high[i]);
    }
}

// The joints between the bodies on joints a and b, from a to b; how many of them carry a.
std::uint32_t append_between(const JointTree& tree, int a, int b, std::vector<int>& path) {
    const std::size_t begin = path.size();
    std::vector<int> down;
    while (a != b) {  // Parents have smaller numbers.
        int& last = a > b ? a : b;
        (a > b ? path : down).push_back(last);
        last = tree.joints[last].parent;
    }
    const auto up = static_cast<std::uint32_t>(path.size() - begin);
    path.insert(path.end(), down.rbegin(), down.rend());
    return up;
}

// Whether joint k has an influence: a mimic joint with multiplier 0 has none.
bool has_influence(const JointTree& tree, int k) { return tree.joints[k].multiplier != 0.0; }

}  // namespace

Obstacles::Obstacles(std::vector<Body> bodies_) : bodies(std::move(bodies_)) {
    std::vector<Bounds> bounds;
    at_rest.reserve(bodies.size());
    bounds.reserve(bodies.size());
    for (const Body& body : bodies) {
        at_rest.push_back(placed(body.joint_from_body, *body.shape));
        bounds.push_back(bounds_of(at_rest.back(), body.shape->half));
    }
    std::vector<Member> members;
    for (std::size_t i = 0; i < bounds.size(); ++i) members.push_back({bounds[i].centre, static_cast<int>(i)});
    nodes.reserve(2 * bounds.size());
    if (!members.empty()) add_nodes(nodes, members, bounds);
}

Geometry::Geometry(JointTree tree_, std::vector<Body> robot, const Obstacles& others, double rounding_)
    : tree(std::move(tree_)),
      bodies(std::move(robot)),
      robot_bodies(bodies.size()),
      at_rest(bodies.size()),
      obstacles(others.nodes),
      rounding(rounding_) {
    for (std::size_t i = 0; i < bodies.size(); ++i)
        if (bodies[i].joint == kRoot) at_rest[i] = placed(bodies[i].joint_from_body, *bodies[i].shape);
    bodies.insert(bodies.end(), others.bodies.begin(), others.bodies.end());
    at_rest.insert(at_rest.end(), others.at_rest.begin(), others.at_rest.end());
    for (ObstacleNode& node : obstacles)
        if (node.body >= 0) node.body += static_cast<int>(robot_bodies);
}

World::World(std::shared_ptr<const Geometry> geometry_, std::span<const std::int64_t> bodies,
             std::span<const double> margins)
    : geometry(std::move(geometry_)) {
    const Geometry& space = *geometry;
    const std::size_t obstacles = space.bodies.size() - space.robot_bodies;
    std::vector<int> with_obstacles(space.robot_bodies * obstacles, -1);
    std::vector<Pair> made(margins.size());
    // All pairs of a body with obstacles have the same joints between them: for each body, the first such pair.
    std::vector<int> first_pair(space.robot_bodies, -1);
    std::vector<int> adjacent;
    for (std::size_t k = 0; k < margins.size(); ++k) {
        const int index = static_cast<int>(k);
        Pair& pair = made[k];
        pair.a = static_cast<int>(bodies[2 * k]);
        pair.b = static_cast<int>(bodies[2 * k + 1]);
        pair.margin = margins[k];
        pair.with_obstacle = static_cast<std::size_t>(pair.b) >= space.robot_bodies;
        const Body &a = space.bodies[pair.a], &b = space.bodies[pair.b];
        const auto is_convex = [](const Body& body) {
            return body.shape->kind == ShapeKind::kConvex || body.shape->kind == ShapeKind::kHalfSpace;
        };
        pair.convex = is_convex(a) && is_convex(b);
        if (pair.with_obstacle) widest_margin = std::max(widest_margin, pair.margin);
        std::ptrdiff_t influences = 0;
        if (pair.with_obstacle && first_pair[pair.a] >= 0) {
            const Pair& first = made[first_pair[pair.a]];
            pair.first = first.first;
            pair.joints = first.joints;
            pair.up = first.up;
            pair.moving = first.moving;
        } else {
            pair.first = static_cast<std::uint32_t>(between.size());
            pair.up = append_between(space.tree, a.joint, b.joint, between);
            pair.joints = static_cast<std::uint32_t>(between.size()) - pair.first;
            influences = std::ranges::count_if(joints_between(pair), [&](int j) { return has_influence(space.tree, j); });
            pair.moving = influences > 0;
            if (pair.with_obstacle) {
                first_pair[pair.a] = index;
                if (pair.moving) around.push_back(pair.a);
            }
        }
        if (!pair.moving) {
            still.push_back(index);
        } else if (pair.with_obstacle) {
            with_obstacles[pair.a * obstacles + pair.b - space.robot_bodies] = index;
        } else {
            own.push_back(index);
            if (influences == 1 && pair.convex) adjacent.push_back(index);
        }
    }
    std::ranges::sort(around, std::greater<>());
    if (!adjacent.empty()) {
        std::vector<Transform> joints(space.tree.joints.size());
        std::vector<PlacedBody> at = space.at_rest;
        const std::vector<double> zeros(space.tree.dof, 0.0);
        place(space, zeros.data(), joints, at);
        for (int k : adjacent) {
            Pair& pair = made[k];
            Separation separation;
            bound_distance(shape(pair.a), shape(pair.b), relative(at[pair.a].root_from_body, at[pair.b].root_from_body),
                           {}, separation);
            pair.first_direction = separation.direction;
        }
    }
    pairs = Shared(std::move(made));
    obstacle_pairs = Shared(std::move(with_obstacles));
}

World World::with_margins(std::span<const double> margins) const {
    World other = *this;
    std::vector<Pair> made = pairs.copy();
    other.widest_margin = 0.0;
    for (std::size_t k = 0; k < made.size(); ++k) {
        made[k].margin = margins[k];
        if (made[k].with_obstacle) other.widest_margin = std::max(other.widest_margin, margins[k]);
    }
    other.pairs = Shared(std::move(made));
    return other;
}

World World::of_still_pairs() const {
    World other = *this;
    other.own = still;
    other.uses_obstacles = false;
    return other;
}

bool place(const Geometry& geometry, const double* q, std::span<Transform> joints, std::span<PlacedBody> bodies) {
    double sum = 0.0;
    for (std::size_t j = 0; j < geometry.tree.dof; ++j) sum += 0.0 * q[j];
    if (!(sum == 0.0)) {
        constexpr double nan = std::numeric_limits<double>::quiet_NaN();
        const Vec3 nowhere{nan, nan, nan};
        const Transform unknown{{{{nan, nan, nan}, {nan, nan, nan}, {nan, nan, nan}}}, nowhere};
        std::ranges::fill(joints, unknown);
        for (std::size_t i = 0; i < geometry.robot_bodies; ++i)
            if (geometry.bodies[i].joint != kRoot) bodies[i] = {unknown, nowhere};
        return false;
    }
    place_joints(geometry.tree, q, joints);
    for (std::size_t i = 0; i < geometry.robot_bodies; ++i) {
        const Body& body = geometry.bodies[i];
        if (body.joint != kRoot) bodies[i] = placed(joints[body.joint] * body.joint_from_body, *body.shape);
    }
    return true;
}

}  // namespace pinproof
