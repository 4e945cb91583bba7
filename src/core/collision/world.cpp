#include "collision/world.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace pinproof {
namespace {

// The box in the root frame around the box of an obstacle.
Bounds bounds_of(const PlacedBody& placed, const Vec3& half) {
    Bounds bounds{placed.centre, placed.centre};
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

// The box around two nodes.
Bounds around(const ObstacleNode& a, const ObstacleNode& b) {
    Bounds box = a.box;
    box.add(b.box);
    return box;
}

// Append the node of some obstacles and all nodes within it. They are halved along the longest side of their centres.
void add_nodes(std::vector<ObstacleNode>& nodes, std::span<Member> members, const std::vector<Bounds>& bounds,
               Axes axes = {}) {
    const std::size_t here = nodes.size();
    if (members.size() == 1) {
        nodes.push_back({bounds[members[0].body], static_cast<int>(here) + 1, members[0].body});
        return;
    }
    axes.put_first(dividing_axis(std::span<const Member>(members), [](const Member& m) { return m.centre; }));
    const std::size_t half = members.size() / 2;
    std::ranges::nth_element(members, members.begin() + static_cast<std::ptrdiff_t>(half), axes);
    nodes.emplace_back();
    add_nodes(nodes, members.first(half), bounds, axes);
    const std::size_t second = nodes.size();
    add_nodes(nodes, members.subspan(half), bounds, axes);
    nodes[here] = {around(nodes[here + 1], nodes[second]), static_cast<int>(nodes.size()), -1};
}

Obstacle obstacle_of(const Body& body) { return {body.shape, placed(body.joint_from_body, *body.shape)}; }

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

bool is_identity(const Transform& t) {
    bool same = squared_norm(t.translation) == 0.0;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) same = same && t.rotation.m[i][j] == (i == j ? 1.0 : 0.0);
    return same;
}

// Whether a joint has an influence: a mimic joint with multiplier 0 has none.
bool has_influence(const Joint& joint) { return joint.multiplier != 0.0; }

bool is_convex(const Shape& shape) { return shape.kind == ShapeKind::kConvex || shape.kind == ShapeKind::kHalfSpace; }

}  // namespace

Obstacles::Obstacles(std::span<const Body> others) {
    std::vector<Obstacle> resting;
    std::vector<Bounds> bounds;
    std::vector<Member> members;
    resting.reserve(others.size());
    bounds.reserve(others.size());
    members.reserve(others.size());
    for (const Body& body : others) {
        resting.push_back(obstacle_of(body));
        bounds.push_back(bounds_of(resting.back().placed, body.shape->half));
        members.push_back({resting.back().placed.centre, static_cast<int>(members.size())});
    }
    std::vector<ObstacleNode> tree;
    tree.reserve(2 * bounds.size());
    if (!members.empty()) add_nodes(tree, members, bounds);
    std::vector<int> leaf_of(others.size());
    for (std::size_t row = 0; row < tree.size(); ++row)
        if (tree[row].obstacle >= 0) leaf_of[static_cast<std::size_t>(tree[row].obstacle)] = static_cast<int>(row);
    bodies = Pages(resting);
    nodes = Pages(tree);
    leaves = std::make_shared<const std::vector<int>>(std::move(leaf_of));
}

Obstacles Obstacles::replaced(std::span<const std::int64_t> numbers, std::span<const Body> others) const {
    Obstacles made = *this;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        const auto number = static_cast<std::size_t>(numbers[i]);
        const Obstacle obstacle = obstacle_of(others[i]);
        made.bodies.replace(number, obstacle);
        // The boxes around it, from the smallest to the largest.
        const int leaf = (*leaves)[number];
        std::vector<int> path;
        const auto second_child = [&](int row) { return made.nodes[static_cast<std::size_t>(row) + 1].skip; };
        for (int row = 0; row != leaf; row = leaf < second_child(row) ? row + 1 : second_child(row)) path.push_back(row);
        made.nodes.replace(leaf, {bounds_of(obstacle.placed, obstacle.shape->half), leaf + 1, static_cast<int>(number)});
        for (; !path.empty(); path.pop_back()) {
            const int row = path.back();
            made.nodes.replace(row, {around(made.nodes[row + 1], made.nodes[second_child(row)]), made.nodes[row].skip, -1});
        }
    }
    return made;
}

PairTable::PairTable(const Geometry& space, std::span<const std::int64_t> bodies)
    : pairs(bodies.size() / 2),
      obstacle_pairs(space.robot.size() * space.obstacles->bodies.size(), -1),
      is_first(space.robot.size()) {
    for (const Body& body : space.robot) joints_.push_back(body.joint);
    for (const Joint& joint : space.tree.joints) {
        parents_.push_back(joint.parent);
        influence_.push_back(has_influence(joint));
    }
    // All pairs of a body with obstacles have the same joints between them: for each body, the first such pair.
    const std::size_t robot = space.robot.size(), obstacles = space.obstacles->bodies.size();
    std::vector<int> first_pair(robot, -1);
    for (std::size_t k = 0; k < pairs.size(); ++k) {
        const int index = static_cast<int>(k);
        Pair& pair = pairs[k];
        pair.a = static_cast<int>(bodies[2 * k]);
        pair.b = static_cast<int>(bodies[2 * k + 1]);
        pair.with_obstacle = static_cast<std::size_t>(pair.b) >= robot;
        pair.adjacent = -1;
        is_first[pair.a] = true;
        std::ptrdiff_t influences = 0;
        if (pair.with_obstacle && first_pair[pair.a] >= 0) {
            const Pair& first = pairs[first_pair[pair.a]];
            pair.first = first.first;
            pair.joints = first.joints;
            pair.up = first.up;
            pair.moving = first.moving;
        } else {
            pair.first = static_cast<std::uint32_t>(between.size());
            pair.up = append_between(space.tree, joints_[pair.a], pair.with_obstacle ? kRoot : joints_[pair.b], between);
            pair.joints = static_cast<std::uint32_t>(between.size()) - pair.first;
            influences = std::count_if(between.begin() + pair.first, between.end(), [&](int j) { return influence_[j]; });
            pair.moving = influences > 0;
            if (pair.with_obstacle) {
                first_pair[pair.a] = index;
                if (pair.moving) around.push_back(pair.a);
            }
        }
        if (!pair.moving) {
            still.push_back(index);
        } else if (pair.with_obstacle) {
            obstacle_pairs[pair.a * obstacles + pair.b - robot] = index;
        } else {
            own.push_back(index);
            if (influences != 1) continue;
            pair.adjacent = static_cast<int>(adjacent.size());
            adjacent.push_back(index);
        }
    }
    std::ranges::sort(around, std::greater<>());
}

bool PairTable::fits(const Geometry& space) const {
    const auto& joints = space.tree.joints;
    return std::ranges::equal(joints_, space.robot, {}, {}, &Body::joint) &&
           obstacle_pairs.size() == space.robot.size() * space.obstacles->bodies.size() &&
           std::ranges::equal(parents_, joints, {}, {}, &Joint::parent) &&
           std::ranges::equal(influence_, joints, {}, {}, has_influence);
}

World::World(std::shared_ptr<const Geometry> geometry_, std::shared_ptr<const PairTable> table_,
             std::vector<double> numbers)
    : geometry(std::move(geometry_)), table(std::move(table_)), own(table->own) {
    set_margins(std::move(numbers));
    if (table->adjacent.empty()) return;
    Placement at(*geometry);
    at.set(std::vector<double>(geometry->tree.dof, 0.0).data());
    for (int k : table->adjacent) {
        const Pair& of = pair(k);
        Separation separation;
        if (is_convex(of))
            bound_distance(shape(of.a), shape(of.b), relative(at[of.a].root_from_body, at[of.b].root_from_body), {},
                           separation);
        first_directions_.push_back(separation.direction);
    }
}

bool World::is_convex(const Pair& pair) const {
    return pinproof::is_convex(shape(pair.a)) && pinproof::is_convex(shape(pair.b));
}

void World::set_margins(std::vector<double> numbers) {
    widest_margin = 0.0;
    for (std::size_t k = 0; k < numbers.size(); ++k)
        if (table->pairs[k].with_obstacle) widest_margin = std::max(widest_margin, numbers[k]);
    margins = std::make_shared<const std::vector<double>>(std::move(numbers));
}

World World::with_margins(std::vector<double> numbers) const {
    World other = *this;
    other.set_margins(std::move(numbers));
    return other;
}

World World::with_obstacles(std::shared_ptr<const Geometry> space) const {
    World other = *this;
    other.geometry = std::move(space);
    return other;
}

World World::of_still_pairs() const {
    World other = *this;
    other.own = table->still;
    other.uses_obstacles = false;
    return other;
}

Placement::Placement(const Geometry& geometry)
    : geometry_(&geometry),
      values_((geometry.tree.joints.size() + kLanes - 1) / kLanes * kLanes),
      sines_(values_.size()),
      cosines_(values_.size()),
      frames_(geometry.tree.joints.size()),
      joints_(frames_.size()),
      robot_(geometry.robot.size()) {
    for (std::size_t i = 0; i < robot_.size(); ++i) {
        const Body& body = geometry.robot[i];
        if (body.joint == kRoot) robot_[i] = placed(body.joint_from_body, *body.shape);
        in_joint_frame_.push_back(is_identity(body.joint_from_body));
    }
}

bool Placement::set(const double* q) {
    const std::vector<Joint>& joints = geometry_->tree.joints;
    double sum = 0.0;
    for (std::size_t j = 0; j < geometry_->tree.dof; ++j) sum += 0.0 * q[j];
    const bool is_finite = sum == 0.0;
    if (is_finite) {
        for (std::size_t k = 0; k < joints.size(); ++k) values_[k] = joints[k].value(q);
        sincos_of_each(values_.data(), sines_.data(), cosines_.data(), values_.size());
        for (std::size_t k = 0; k < joints.size(); ++k) {
            Frame frame = joints[k].parent == kRoot ? frame_of(joints[k].before) : frames_[joints[k].parent] * joints[k].before;
            move(frame, joints[k].prismatic, values_[k], sines_[k], cosines_[k]);
            frames_[k] = frame;
            joints_[k] = transform_of(frame);
        }
    } else {
        constexpr double nan = std::numeric_limits<double>::quiet_NaN();
        std::ranges::fill(joints_, Transform{{{{nan, nan, nan}, {nan, nan, nan}, {nan, nan, nan}}}, {nan, nan, nan}});
        for (std::size_t k = 0; k < joints_.size(); ++k) frames_[k] = frame_of(joints_[k]);
    }
    for (std::size_t i = 0; i < robot_.size(); ++i) {
        const Body& body = geometry_->robot[i];
        if (body.joint == kRoot) continue;
        robot_[i] = placed(
            in_joint_frame_[i] ? joints_[body.joint] : transform_of(frames_[body.joint] * body.joint_from_body), *body.shape);
    }
    return is_finite;
}

}  // namespace pinproof
