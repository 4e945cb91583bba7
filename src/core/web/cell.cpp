#include "web/cell.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "collision/cells.h"
#include "collision/mesh.h"

namespace pinproof {
namespace {

// The first number of a block, which changes with the order of its members.
constexpr double kFormat = 38.01;

struct Writer {
    static constexpr bool kReads = false;
    std::vector<double> numbers;
    std::vector<std::shared_ptr<const Shape>> shapes;  // those that were written, each once

    void number(double& value) { numbers.push_back(value); }
};

struct Reader {
    static constexpr bool kReads = true;
    std::span<const double> rest;
    std::vector<std::shared_ptr<const Shape>> shapes;
    bool valid = true;

    void number(double& value) {
        valid = valid && !rest.empty();
        value = valid ? rest.front() : 0.0;
        if (valid) rest = rest.subspan(1);
    }
};

template <class T>
concept Whole = std::is_integral_v<T> || std::is_enum_v<T>;

template <class A>
void visit(A& archive, double& value) {
    archive.number(value);
}

template <class A, class T>
    requires Whole<T>
void visit(A& archive, T& value) {
    constexpr double most = 9e15;  // whole numbers up to this are exact
    double number = static_cast<double>(value);
    archive.number(number);
    if constexpr (A::kReads) {
        const double largest = sizeof(T) == 8 ? most : sizeof(T) == 1 ? 1.0 : 2147483647.0;
        archive.valid = archive.valid && std::floor(number) == number && std::abs(number) <= largest &&
                        (std::is_signed_v<T> || number >= 0.0);
        value = static_cast<T>(static_cast<std::int64_t>(archive.valid ? number : 0.0));
    }
}

template <class A, class T>
void visit(A& archive, std::vector<T>& items);

template <class A, class T, std::size_t count>
void visit(A& archive, T (&items)[count]) {
    for (T& item : items) visit(archive, item);
}

template <class A, class... Members>
    requires(sizeof...(Members) > 1)
void visit(A& archive, Members&... members);

template <class A>
void visit(A& archive, Vec3& v) { visit(archive, v.x, v.y, v.z); }
template <class A>
void visit(A& archive, Transform& t) { visit(archive, t.rotation.m, t.translation); }
template <class A>
void visit(A& archive, Lanes& lanes) {
    for (int lane = 0; lane < kLanes; ++lane) {
        double value = lanes[lane];
        archive.number(value);
        lanes[lane] = value;
    }
}
template <class A>
void visit(A& archive, Joint& j) { visit(archive, j.before, j.prismatic, j.index, j.multiplier, j.offset, j.parent); }
template <class A>
void visit(A& archive, JointTree& tree) { visit(archive, tree.joints, tree.dof); }
template <class A>
void visit(A& archive, Chain& chain) { visit(archive, chain.joints, chain.tool, chain.dof); }
template <class A>
void visit(A& archive, JointRange& r) { visit(archive, r.lower, r.upper, r.periodic, r.wraps); }
template <class A>
void visit(A& archive, CellFrame& frame) { visit(archive, frame.joint, frame.joint_from_frame); }
template <class A>
void visit(A& archive, PointBlock& block) { visit(archive, block.x, block.y, block.z, block.disc); }
template <class A>
void visit(A& archive, Triangle& triangle) { visit(archive, triangle.corners); }
template <class A>
void visit(A& archive, CellBox& box) { visit(archive, box.centre, box.half); }
template <class A>
void visit(A& archive, BoxNode& node) {
    visit(archive, node.centre, node.half, node.first, node.count, node.second_child);
}
template <class A>
void visit(A& archive, Cut& cut) { visit(archive, cut.dropped, cut.reversed, cut.shifted); }
template <class A>
void visit(A& archive, PlannedJoint& j) {
    visit(archive, j.direction, j.point, j.prismatic, j.index, j.lower, j.upper);
}
template <class A>
void visit(A& archive, ArmPlan& plan) {
    visit(archive, plan.chain, plan.size, plan.joints, plan.tool, plan.first_of_triple, plan.planar, plan.reversed,
          plan.normal, plan.locked, plan.border, plan.spread, plan.rounding, plan.true_joints, plan.position_tolerance,
          plan.orientation_tolerance, plan.virtual_tolerance, plan.equation_tolerance, plan.cuts);
}
template <class A>
void visit(A& archive, CellArm& arm) {
    visit(archive, arm.chain, arm.ranges, arm.position_tolerance, arm.orientation_tolerance, arm.damping, arm.max_step,
          arm.max_iterations, arm.stall.progress, arm.stall.patience, arm.attempts, arm.seeds, arm.plan, arm.base,
          arm.joints);
}

// The tree of a mesh or of cells with the items in its leaves. A child comes after its parent, so that no walk is
// endless, and a leaf has items that exist.
template <class A, class Item>
void visit_tree(A& archive, BoxTree& tree, std::vector<Item>& items) {
    visit(archive, tree.nodes, items);
    if constexpr (A::kReads) {
        const auto nodes = static_cast<std::int64_t>(tree.nodes.size()), count = static_cast<std::int64_t>(items.size());
        archive.valid = archive.valid && nodes > 0;
        for (std::int64_t k = 0; k < nodes; ++k) {
            const BoxNode& node = tree.nodes[static_cast<std::size_t>(k)];
            const bool leaf = node.first >= 0 && node.count > 0 && std::int64_t{node.first} + node.count <= count;
            const bool inner = node.count == 0 && node.second_child > k + 1 && node.second_child < nodes;
            archive.valid = archive.valid && (leaf || inner);
        }
    }
}

template <class A>
void visit(A& archive, Shape& shape) {
    visit(archive, shape.kind, shape.points, shape.has_discs, shape.is_box, shape.corners_centre, shape.corners_half,
          shape.radius, shape.semi_axes, shape.has_ellipsoid, shape.centre, shape.half, shape.ball);
    if (shape.kind == ShapeKind::kMesh) {
        auto mesh = shape.mesh ? std::make_shared<TriangleMesh>(*shape.mesh) : std::make_shared<TriangleMesh>();
        visit_tree(archive, mesh->tree, mesh->triangles);
        visit(archive, mesh->witnesses, mesh->closed);
        shape.mesh = std::move(mesh);
    } else if (shape.kind == ShapeKind::kCells) {
        auto cells = shape.cells ? std::make_shared<CellTree>(*shape.cells) : std::make_shared<CellTree>();
        visit_tree(archive, cells->tree, cells->boxes);
        shape.cells = std::move(cells);
    } else if constexpr (A::kReads) {
        archive.valid = archive.valid && (shape.kind == ShapeKind::kHalfSpace || !shape.points.empty());
    }
}

// Bodies share shapes: a shape is stored where it is first used.
template <class A>
void visit(A& archive, Body& body) {
    auto& shapes = archive.shapes;
    std::size_t number = static_cast<std::size_t>(std::ranges::find(shapes, body.shape) - shapes.begin());
    visit(archive, number, body.joint, body.joint_from_body);
    if constexpr (A::kReads) archive.valid = archive.valid && number <= shapes.size();
    if (number == shapes.size()) {
        auto shape = body.shape ? std::make_shared<Shape>(*body.shape) : std::make_shared<Shape>();
        visit(archive, *shape);
        if constexpr (A::kReads) body.shape = shape;
        shapes.push_back(body.shape);
    }
    if constexpr (A::kReads) body.shape = archive.valid ? shapes[number] : nullptr;
}

template <class A, class T>
void visit(A& archive, std::vector<T>& items) {
    std::size_t count = items.size();
    visit(archive, count);
    if constexpr (A::kReads) {
        archive.valid = archive.valid && count <= archive.rest.size();  // an item has a number at least
        items.resize(archive.valid ? count : 0);
    }
    for (T& item : items) visit(archive, item);
}

template <class A, class... Members>
    requires(sizeof...(Members) > 1)
void visit(A& archive, Members&... members) {
    (visit(archive, members), ...);
}

template <class A>
void visit_cell(A& archive, Cell& cell) {
    double format = kFormat;
    visit(archive, format, cell.tree, cell.robot, cell.obstacles, cell.rounding, cell.pairs, cell.margins, cell.frames,
          cell.arms);
    if constexpr (A::kReads) archive.valid = archive.valid && format == kFormat;
}

// Whether every index of a cell is one of something that exists.
bool is_consistent(const Cell& cell) {
    const auto within = [](std::int64_t index, std::size_t count, std::int64_t least = 0) {
        return index >= least && index < static_cast<std::int64_t>(count);
    };
    const auto& joints = cell.tree.joints;
    bool valid = cell.pairs.size() == 2 * cell.margins.size();
    for (std::size_t k = 0; k < joints.size(); ++k)
        valid = valid && within(joints[k].parent, k, kRoot) && joints[k].index < cell.tree.dof;
    for (const Body& body : cell.robot) valid = valid && within(body.joint, joints.size(), kRoot);
    for (const Body& body : cell.obstacles) valid = valid && body.joint == kRoot;
    const std::size_t bodies = cell.robot.size() + cell.obstacles.size();
    for (std::size_t k = 0; k < cell.pairs.size(); ++k)
        valid = valid && within(cell.pairs[k], k % 2 == 0 ? cell.robot.size() : bodies);
    for (const CellFrame& frame : cell.frames) valid = valid && within(frame.joint, joints.size(), kRoot);
    const auto fits = [&](const Chain& chain) {
        return std::ranges::all_of(chain.joints, [&](const Joint& joint) { return joint.index < chain.dof; });
    };
    for (const CellArm& arm : cell.arms) {
        const std::size_t n = arm.joints.size();
        valid = valid && n > 0 && arm.chain.dof == n && arm.ranges.size() == n && fits(arm.chain) && arm.plan.size() < 2;
        valid = valid && !arm.seeds.empty() && arm.seeds.size() % n == 0 && within(arm.base, cell.frames.size());
        for (int joint : arm.joints) valid = valid && within(joint, cell.tree.dof);
        for (const ArmPlan& plan : arm.plan)
            valid = valid && plan.chain.dof == n && fits(plan.chain) && plan.joints.size() == 6 + plan.locked.size();
    }
    return valid;
}

}  // namespace

Cell cell_of(const World& world) {
    const Geometry& space = world.space();
    Cell cell{.tree = space.tree, .robot = space.robot, .rounding = space.rounding, .margins = *world.margins};
    for (std::size_t i = 0; i < space.obstacles->bodies.size(); ++i) {
        const Obstacle& obstacle = space.obstacles->bodies[i];
        cell.obstacles.push_back({obstacle.shape, kRoot, obstacle.placed.root_from_body});
    }
    for (const Pair& pair : world.table->pairs) cell.pairs.insert(cell.pairs.end(), {pair.a, pair.b});
    return cell;
}

std::shared_ptr<const World> Cell::world() const {
    auto space = std::make_shared<Geometry>(tree, robot, std::make_shared<Obstacles>(obstacles), rounding);
    auto table = std::make_shared<PairTable>(*space, pairs);
    return std::make_shared<World>(std::move(space), std::move(table), margins);
}

std::vector<double> write_cell(Cell cell) {
    Writer writer;
    visit_cell(writer, cell);
    return std::move(writer.numbers);
}

std::optional<Cell> read_cell(std::span<const double> numbers) {
    Reader reader{.rest = numbers};
    Cell cell;
    visit_cell(reader, cell);
    if (!reader.valid || !reader.rest.empty() || !is_consistent(cell)) return std::nullopt;
    return cell;
}

}  // namespace pinproof
