// Shapes, the world of a collision checker, and queries at single configurations.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "collision/gjk.h"
#include "collision/near.h"
#include "collision/world.h"

namespace pinproof {
namespace {

Vec3 vec3(const char* name, const Vector& v) {
    require_size(name, v.shape(0), 3);
    return {v(0), v(1), v(2)};
}

// An array argument that must be an array of doubles already: conversions would hide copies in inner loops.
const double* configuration(const Vector& q, std::size_t dof) {
    require_size("q", q.shape(0), dof);
    return q.data();
}

const double* box_of(const Matrix& box) {
    require_size("box", box.size(), 6);
    return box.data();
}

std::shared_ptr<Shape> make(ShapeKind kind, const Matrix& points, const Vector& discs, double radius,
                            const Vector& semi_axes, const Matrix& box) {
    require_size("points", points.size(), 3 * discs.shape(0));
    if (kind == ShapeKind::kConvex && discs.shape(0) == 0) throw std::invalid_argument("a convex shape has no points");
    const double* b = box_of(box);
    return std::make_shared<Shape>(make_shape(kind, {points.data(), points.size()}, {discs.data(), discs.shape(0)},
                                              radius, vec3("semi_axes", semi_axes), {b[0], b[1], b[2]},
                                              {b[3], b[4], b[5]}));
}

std::shared_ptr<Shape> make_without_support(ShapeKind kind, const Matrix& box) {
    const double* b = box_of(box);
    return std::make_shared<Shape>(make_shape(kind, {}, {}, 0.0, {}, {b[0], b[1], b[2]}, {b[3], b[4], b[5]}));
}

JointTree make_tree(const Stack& placements, const std::vector<bool>& prismatic, const std::vector<int>& index,
                    const Vector& multiplier, const Vector& offset, const std::vector<int>& parent, std::size_t dof) {
    const std::size_t count = prismatic.size();
    require_size("placements", placements.size(), 16 * count);
    require_size("index", index.size(), count);
    require_size("multiplier", multiplier.shape(0), count);
    require_size("offset", offset.shape(0), count);
    require_size("parent", parent.size(), count);
    require_finite("placements", placements.data(), placements.size());
    require_finite("multiplier", multiplier.data(), count);
    require_finite("offset", offset.data(), count);
    JointTree tree;
    tree.dof = dof;
    for (std::size_t k = 0; k < count; ++k) {
        if (index[k] < 0 || static_cast<std::size_t>(index[k]) >= dof)
            throw std::invalid_argument("the index of a joint must be within 0 and dof - 1");
        if (parent[k] < kRoot || parent[k] >= static_cast<int>(k))
            throw std::invalid_argument("the parent of a joint must come before it");
        tree.joints.push_back(
            {read_transform(placements.data() + 16 * k), prismatic[k], index[k], multiplier(k), offset(k), parent[k]});
    }
    return tree;
}

std::shared_ptr<Geometry> make_geometry(const JointTree& tree, const std::vector<std::shared_ptr<Shape>>& shapes,
                                        const std::vector<int>& joints, const Stack& placements,
                                        std::size_t robot_bodies, double rounding) {
    const std::size_t count = shapes.size();
    require_size("joints", joints.size(), count);
    require_size("placements", placements.size(), 16 * count);
    require_finite("placements", placements.data(), placements.size());
    if (robot_bodies > count) throw std::invalid_argument("robot_bodies exceeds the number of bodies");
    std::vector<Body> bodies;
    bodies.reserve(count);
    for (std::size_t i = 0; i < count; ++i) {
        const bool on_joint = joints[i] >= 0 && static_cast<std::size_t>(joints[i]) < tree.joints.size();
        if (shapes[i] == nullptr || (joints[i] != kRoot && (!on_joint || i >= robot_bodies)))
            throw std::invalid_argument("a body has no shape, or is on a joint that it cannot be on");
        bodies.push_back({shapes[i], joints[i], read_transform(placements.data() + 16 * i)});
    }
    return std::make_shared<Geometry>(tree, std::move(bodies), robot_bodies, rounding);
}

void require_margins(const Vector& margins, std::size_t pairs) {
    require_size("margins", margins.shape(0), pairs);
    // No comparison with NaN is true, so that the largest margin would not include it.
    if (std::any_of(margins.data(), margins.data() + pairs, [](double margin) { return std::isnan(margin); }))
        throw std::invalid_argument("a margin is NaN");
}

std::shared_ptr<World> make_world(std::shared_ptr<Geometry> geometry, const IndexMatrix& pairs, const Vector& margins) {
    const std::size_t count = pairs.shape(0);
    require_margins(margins, count);
    require_size("a pair", pairs.shape(1), 2);
    const auto robot = static_cast<std::int64_t>(geometry->robot_bodies);
    const auto every = static_cast<std::int64_t>(geometry->bodies.size());
    for (std::size_t k = 0; k < count; ++k) {
        const std::int64_t a = pairs(k, 0), b = pairs(k, 1);
        if (a < 0 || a >= robot || b < 0 || b >= every || a == b)
            throw std::invalid_argument("a pair must be a body of the robot and another body");
        if (geometry->shape(static_cast<int>(a)).kind == ShapeKind::kHalfSpace)
            throw std::invalid_argument("a half-space must be the second body of a pair");
    }
    return std::make_shared<World>(std::move(geometry), std::span(pairs.data(), pairs.size()),
                                   std::span(margins.data(), count));
}

nb::object indices(const std::vector<int>& values) {
    auto out = new_array<std::int64_t>({values.size()});
    std::copy(values.begin(), values.end(), out.data);
    return nb::cast(out.array);
}

nb::object homogeneous(const Transform& transform) {
    auto out = new_array({4, 4});
    write_homogeneous(transform, out.data);
    return nb::cast(out.array);
}

nb::object vector3(const Vec3& v) {
    auto out = new_array({3});
    out.data[0] = v.x;
    out.data[1] = v.y;
    out.data[2] = v.z;
    return nb::cast(out.array);
}

nb::object points2(const Witnesses& points) {
    auto out = new_array({2, 3});
    for (int i = 0; i < 3; ++i) {
        out.data[i] = points.of_a[i];
        out.data[3 + i] = points.of_b[i];
    }
    return nb::cast(out.array);
}

void bind_shapes(nb::module_& module) {
    nb::class_<Shape>(module, "Shape", "The shape of a body in its own frame.")
        .def_static(
            "convex",
            [](const Matrix& points, const Vector& discs, double radius, const Vector& semi_axes, const Matrix& box) {
                return make(ShapeKind::kConvex, points, discs, radius, semi_axes, box);
            },
            nb::arg("points"), nb::arg("discs"), nb::arg("radius"), nb::arg("semi_axes"), nb::arg("box"),
            "The hull of points (V, 3) with discs (V,) about z, to which a ball and an ellipsoid are added.")
        .def_static(
            "half_space", [](const Matrix& box) { return make_without_support(ShapeKind::kHalfSpace, box); },
            nb::arg("box"), "Everything below z = 0.")
        .def_static(
            "exact", [](const Matrix& box) { return make_without_support(ShapeKind::kExact, box); }, nb::arg("box"),
            "A shape without a support function, whose distances the caller measures.")
        .def_prop_ro(
            "centre", [](const Shape& shape) { return vector3(shape.centre); }, "(3,) the centre of its box.")
        .def_ro("ball", &Shape::ball, "The radius (m) of the ball about the centre of its box that contains it.");
    // For tests of the bounds of a distance.
    module.def(
        "bound_distance",
        [](const Shape& a, const Shape& b, const Matrix& a_from_b, const Vector& direction, double above, double below,
           double precision) {
            require_size("a_from_b", a_from_b.size(), 16);
            if (a.kind != ShapeKind::kConvex || b.kind == ShapeKind::kExact)
                throw std::invalid_argument("the distance of these shapes cannot be bounded by support functions");
            Separation separation;
            separation.direction = vec3("direction", direction);
            const Transform placement = read_transform(a_from_b.data());
            const DistanceBounds bounds =
                bound_distance(a, b, placement, {.above = above, .below = below, .precision = precision}, separation);
            std::vector<double> weights;
            Vec3 nearest;
            for (int i = 0; i < separation.simplex.size; ++i) {
                const Simplex::Vertex& vertex = separation.simplex.vertices[i];
                weights.push_back(vertex.weight);
                nearest += vertex.weight * vertex.difference;
            }
            return std::tuple(bounds.lower, bounds.upper, vector3(separation.direction), weights, vector3(nearest));
        },
        nb::arg("a"), nb::arg("b"), nb::arg("a_from_b"), nb::arg("direction"), nb::arg("above"), nb::arg("below"),
        nb::arg("precision"),
        "(lower, upper, direction, weights of the simplex, its point closest to the origin) of two convex shapes.");
}

void bind_world(nb::module_& module) {
    nb::class_<TreeJoint>(module, "TreeJoint", "A joint whose value is multiplier * q[index] + offset.")
        .def_ro("prismatic", &TreeJoint::prismatic)
        .def_ro("index", &TreeJoint::index)
        .def_ro("multiplier", &TreeJoint::multiplier)
        .def_ro("offset", &TreeJoint::offset);
    nb::class_<JointTree>(module, "JointTree", "The joints of a robot, each after its parent.")
        .def(
            "__init__",
            [](JointTree* self, const Stack& placements, const std::vector<bool>& prismatic,
               const std::vector<int>& index, const Vector& multiplier, const Vector& offset,
               const std::vector<int>& parent, std::size_t dof) {
                new (self) JointTree(make_tree(placements, prismatic, index, multiplier, offset, parent, dof));
            },
            nb::arg("placements"), nb::arg("prismatic"), nb::arg("index"), nb::arg("multiplier"), nb::arg("offset"),
            nb::arg("parent"), nb::arg("dof"));
    nb::class_<Geometry>(module, "Geometry", "The bodies of a checker: those of the robot, then the obstacles.")
        .def(nb::new_(&make_geometry), nb::arg("tree"), nb::arg("shapes"), nb::arg("joints"), nb::arg("placements"),
             nb::arg("robot_bodies"), nb::arg("rounding"));
    nb::class_<World>(module, "World", "The pairs of bodies of a checker, and their margins.")
        .def(nb::new_(&make_world), nb::arg("geometry"), nb::arg("pairs"), nb::arg("margins"))
        .def(
            "with_margins",
            [](const World& world, const Vector& margins) {
                require_margins(margins, world.pairs.size());
                return std::make_shared<World>(world.with_margins({margins.data(), margins.shape(0)}));
            },
            nb::arg("margins"))
        .def("of_still_pairs", [](const World& world) { return std::make_shared<World>(world.of_still_pairs()); })
        .def_prop_ro(
            "still", [](const World& world) { return indices(world.still); },
            "The pairs that no joint moves relative to each other.")
        .def_prop_ro(
            "convex",
            [](const World& world) {
                auto out = new_array<bool>({world.pairs.size()});
                for (std::size_t k = 0; k < world.pairs.size(); ++k) out.data[k] = world.pairs[k].convex;
                return nb::cast(out.array);
            },
            "(P,) whether both bodies of a pair have a support function, so that the core measures it.")
        .def_prop_ro(
            "first_directions",
            [](const World& world) {
                auto out = new_array({world.pairs.size(), 3});
                for (std::size_t k = 0; k < world.pairs.size(); ++k)
                    for (int i = 0; i < 3; ++i) out.data[3 * k + i] = world.pairs[k].first_direction[i];
                return nb::cast(out.array);
            },
            "(P, 3) the direction at which the search for the distance of a pair begins; zeros: any.");
}

// The result for one configuration, without the pairs.
constexpr int kFree = 0, kContact = -1, kNotFinite = -2;

int judge(Workspace& self, const double* q) {
    if (!self.place_at(q)) return kNotFinite;
    if (self.any_contact()) return kContact;
    return static_cast<int>(self.left().size());
}

// Place the bodies at q for a question whose result cannot express that q is not finite.
void place_finite(Workspace& self, const Vector& q) {
    if (!self.place_at(configuration(q, self.world().space().tree.dof)))
        throw std::invalid_argument("q holds a number that is not finite");
}

void bind_workspace(nb::module_& module) {
    nb::class_<Workspace>(module, "Workspace", "The bodies of a world at one configuration; one for each thread.")
        .def(
            "__init__", [](Workspace* self, std::shared_ptr<World> world) { new (self) Workspace(std::move(world)); },
            nb::arg("world"))
        .def(
            "place",
            [](Workspace& self, const Vector& q) { self.place_at(configuration(q, self.world().space().tree.dof)); },
            nb::arg("q"))
        .def(
            "judge",
            [](Workspace& self, const Vector& q) {
                return judge(self, configuration(q, self.world().space().tree.dof));
            },
            nb::arg("q").noconvert(), "CONTACT, NOT_FINITE, or the number of pairs that are left to the caller.")
        .def(
            "judge_many",
            [](Workspace& self, const Matrix& configurations) {
                require_size("a configuration", configurations.shape(1), self.world().space().tree.dof);
                const std::size_t count = configurations.shape(0), dof = configurations.shape(1);
                auto out = new_array<std::int64_t>({count});
                {
                    nb::gil_scoped_release release;
                    for (std::size_t i = 0; i < count; ++i) out.data[i] = judge(self, configurations.data() + i * dof);
                }
                return out.array;
            },
            nb::arg("configurations"))
        .def(
            "find_contacts",
            [](Workspace& self, const Vector& q) {
                place_finite(self, q);
                self.find_contacts();
                return std::tuple(self.contacts(), self.left());
            },
            nb::arg("q"), "(pairs in contact, pairs left to the caller) at q, which must be finite.")
        .def(
            "find_nearest",
            [](Workspace& self, const Vector& q) {
                place_finite(self, q);
                const Nearest nearest = self.find_nearest();
                return std::tuple(self.contacts(), self.left(), nearest.lower, nearest.upper, nearest.pair);
            },
            nb::arg("q"),
            "(overlapping pairs, pairs left to the caller, lower and upper bound of the smallest distance of the "
            "others, its pair) at q, which must be finite.")
        .def(
            "find_nearest_many",
            [](Workspace& self, const Matrix& configurations) {
                require_size("a configuration", configurations.shape(1), self.world().space().tree.dof);
                const std::size_t count = configurations.shape(0), dof = configurations.shape(1);
                auto lower = new_array({count});
                auto open = new_array<bool>({count});
                {
                    nb::gil_scoped_release release;
                    for (std::size_t i = 0; i < count; ++i) {
                        const bool finite = self.place_at(configurations.data() + i * dof);
                        lower.data[i] = finite ? self.find_nearest().lower : std::nan("");
                        open.data[i] = finite && !(self.contacts().empty() && self.left().empty());
                    }
                }
                return std::tuple(nb::cast(lower.array), nb::cast(open.array));
            },
            nb::arg("configurations"),
            "(N,) lower bounds of the smallest distance, and whether pairs overlap or are left to the caller.")
        .def(
            "measure",
            [](const Workspace& self, std::size_t pair) {
                if (pair >= self.world().pairs.size() || !self.world().pairs[pair].convex)
                    throw std::invalid_argument("not a pair of convex bodies");
                const Measured measured = self.measure(static_cast<int>(pair));
                return std::tuple(measured.bounds.lower, measured.bounds.upper, points2(measured.points),
                                  vector3(measured.normal));
            },
            nb::arg("pair"),
            "(lower, upper, points (2, 3), normal (3,)) of the distance of a convex pair, in the root frame.")
        .def_prop_ro("left", &Workspace::left, "The pairs that the last query left to the caller.")
        .def(
            "root_from_body",
            [](const Workspace& self, std::size_t body) {
                if (body >= self.bodies().size()) throw std::invalid_argument("no such body");
                return homogeneous(self.bodies()[body].root_from_body);
            },
            nb::arg("body"))
        .def_prop_ro(
            "root_from_joints",
            [](const Workspace& self) {
                auto out = new_array({self.joints().size(), 4, 4});
                for (std::size_t k = 0; k < self.joints().size(); ++k)
                    write_homogeneous(self.joints()[k], out.data + 16 * k);
                return nb::cast(out.array);
            },
            "(m, 4, 4) the placements of the joints, whose axis is z.")
        .def(
            "joint",
            [](const Workspace& self, std::size_t joint) { return self.world().space().tree.joints.at(joint); },
            nb::arg("joint"))
        .def(
            "joints_of_body",
            [](const Workspace& self, std::size_t body) {
                const Geometry& space = self.world().space();
                std::vector<int> chain;
                for (int k = space.bodies.at(body).joint; k != kRoot; k = space.tree.joints[k].parent)
                    chain.insert(chain.begin(), k);
                return chain;
            },
            nb::arg("body"), "The joints that carry a body, from the root outwards.");
    module.attr("CONTACT") = kContact;
    module.attr("NOT_FINITE") = kNotFinite;
    static_assert(kFree == 0);
}

}  // namespace

void bind_collision(nb::module_& module) {
    bind_shapes(module);
    bind_world(module);
    bind_workspace(module);
}

}  // namespace pinproof
