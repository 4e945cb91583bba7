// Shapes, the world of a collision checker, queries at single configurations, and grids of free cells.
#include <bit>
#include <charconv>
#include <numeric>

#include "bindings/structs.h"
#include "collision/cells.h"
#include "collision/mesh.h"
#include "collision/near.h"
#include "collision/occupancy.h"
#include "collision/surface.h"
#include "collision/world.h"

namespace pinproof {
namespace {

// The corners of the box (2, 3) around a shape; those of a half-space are infinite.
std::shared_ptr<Shape> make(ShapeKind kind, const Matrix& box, std::span<const double> points = {},
                            std::span<const double> discs = {}, double radius = 0.0, const Vec3& semi_axes = {}) {
    const auto b = shaped("box", box, {2, 3});
    return std::make_shared<Shape>(
        make_shape(kind, points, discs, radius, semi_axes, {b[0], b[1], b[2]}, {b[3], b[4], b[5]}));
}

// Metres: a direction that proves a distance closely, at which its search may end.
constexpr double kCloseDirection = 1e-6;

// The directions from each of convex shapes `a` to that of `b`, along which they are farthest apart.
NewArray separating_directions(const std::vector<std::shared_ptr<Shape>>& a,
                               const std::vector<std::shared_ptr<Shape>>& b, const Matrix& root_from_a,
                               const Matrix& root_from_b) {
    const std::size_t count = a.size();
    const auto from_a = finite("root_from_a", root_from_a, {count, 16});
    const auto from_b = finite("root_from_b", root_from_b, {b.size() == count ? count : 0, 16});
    return filled<double>({count, 3}, [&](double* out) {
        for (std::size_t i = 0; i < count; ++i, out += 3) {
            if (a[i]->kind != ShapeKind::kConvex || b[i]->kind == ShapeKind::kMesh) refuse("a shape is not convex");
            const Transform at_a = read_transform(&from_a[16 * i]), at_b = read_transform(&from_b[16 * i]);
            Separation separation;
            bound_distance(*a[i], *b[i], inverse(at_a) * at_b, {.precision = kCloseDirection}, separation);
            const Vec3 direction = at_a.rotation * separation.direction;
            for (int k = 0; k < 3; ++k) out[k] = direction[k];
        }
    });
}

// Cells whose indices are below this are exact as doubles, and do not overflow.
constexpr std::int64_t kMostCells = std::int64_t{1} << 40;

std::shared_ptr<Shape> make_cells(const IndexMatrix& low, const IndexMatrix& high, double side) {
    const auto first = shaped("low", low, {kSome, 3}), end = shaped("high", high, {low.shape(0), 3});
    for (std::size_t i = 0; i < first.size(); ++i)
        if (first[i] < -kMostCells || end[i] > kMostCells || first[i] >= end[i]) refuse("a box of cells has no volume");
    finite("side", positive("side", side));
    auto cells = std::make_shared<CellTree>(first, end, side);
    const BoxNode& all = cells->tree.nodes[0];
    auto shape = std::make_shared<Shape>(
        make_shape(ShapeKind::kCells, {}, {}, 0.0, {}, all.centre - all.half, all.centre + all.half));
    shape->cells = std::move(cells);
    return shape;
}

NewArray boxes_of(const Shape& shape, const std::vector<int>& numbers) {
    return filled<double>({numbers.size(), 2, 3}, [&](double* out) {
        for (int number : numbers)
            for (const Vec3& v : {shape.cells->boxes[number].centre, shape.cells->boxes[number].half})
                for (int i = 0; i < 3; ++i) *out++ = v[i];
    });
}

void bind_shapes(nb::module_& module) {
    nb::class_<Shape>(module, "Shape", "The shape of a body in its own frame.")
        .def_static(
            "convex",
            [](const Matrix& points, const Vector& discs, double radius, const Vector& semi_axes, const Matrix& box) {
                return make(ShapeKind::kConvex, box, shaped("points", points, {kSome, 3}),
                            shaped("discs", discs, {points.shape(0)}), radius, vec3("semi_axes", semi_axes));
            }, "points"_a, "discs"_a, "radius"_a, "semi_axes"_a, "box"_a,
            "The hull of points (V, 3) with discs (V,) about z, to which a ball and an ellipsoid are added.")
        .def_static("half_space", [](const Matrix& box) { return make(ShapeKind::kHalfSpace, box); }, "box"_a,
                    "Everything below z = 0.")
        .def_static(
            "mesh",
            [](const Matrix& corners, const Matrix& witnesses, bool closed, const Matrix& box) {
                const auto points = finite("corners", corners, {kSome, 9});
                auto shape = make(ShapeKind::kMesh, box);
                shape->mesh = std::make_shared<TriangleMesh>(points, finite("witnesses", witnesses, {kAny, 3}), closed);
                return shape;
            }, "corners"_a, "witnesses"_a, "closed"_a, "box"_a,
            "Triangles (F, 9) with a point of each connected part (W, 3). A closed mesh is solid.")
        .def_static("cells", &make_cells, "low"_a, "high"_a, "side"_a,
                    "Boxes from low (N, 3) to high (N, 3), in cells of a side (m), as one obstacle.")
        .def_prop_ro("boxes", [](const Shape& shape) {
                std::vector<int> every(shape.cells ? shape.cells->boxes.size() : 0);
                std::iota(every.begin(), every.end(), 0);
                return boxes_of(shape, every);
            }, "(B, 2, 3) centre and half sides of the boxes to which cells are joined.")
        .def("contains", [](const Shape& shape, const Matrix& points) {
                const double* p = shaped("points", points, {kAny, 3}).data();
                return filled<bool>({points.shape(0)}, [&](bool* inside) {
                    for (std::size_t i = 0; i < points.shape(0); ++i, p += 3)
                        inside[i] = shape.mesh != nullptr && shape.mesh->contains({p[0], p[1], p[2]});
                });
            }, "points"_a, "(N,) whether points (N, 3) are inside a closed mesh.")
        .def_prop_ro("triangles", [](const Shape& shape) {
                const std::size_t count = shape.mesh ? shape.mesh->triangles.size() : 0;
                return filled<double>({count, 3, 3}, [&](double* out) {
                    for (std::size_t i = 0; i < 3 * count; ++i)
                        for (int k = 0; k < 3; ++k) *out++ = shape.mesh->triangles[i / 3].corners[i % 3][k];
                });
            }, "(F, 3, 3) the triangles of a mesh in the order in which the core numbers them, that of its tree: each half of "
            "them is close together.")
        .def_ro("centre", &Shape::centre, "(3,) the centre of its box.")
        .def_ro("ball", &Shape::ball, "The radius (m) of the ball about the centre of its box that contains it.");
    module.def("first_equal_points", [](const Matrix& points) {
            return array_of<std::int64_t>(first_equal_points(finite("points", points, {kAny, 3})));
        }, "points"_a, "(N,) the number of the first of the points (N, 3) that is equal to each.");
    module.def("surface_parts", [](const IndexMatrix& triangles) {
            const SurfaceParts parts = surface_parts(shaped("triangles", triangles, {kAny, 3}));
            return std::tuple(array_of<std::int64_t>(parts.part_of), parts.closed);
        }, "triangles"_a, "The part (F,) of each triangle (F, 3) of a surface, and whether all parts are closed.");
    module.def("separating_directions", &separating_directions, "a"_a, "b"_a, "root_from_a"_a, "root_from_b"_a,
               "(N, 3) the unit vectors in the root frame from convex shapes a to shapes b at placements (N, 16).");
    module.def(
        "hull_space",
        [](const Matrix& planes, const Matrix& points, const Matrix& directions, double enough) {
            std::vector<FacePlane> faces;
            const double* p = shaped("planes", planes, {kAny, 4}).data();
            for (std::size_t e = 0; e < planes.shape(0); ++e, p += 4) faces.push_back({{p[0], p[1], p[2]}, p[3]});
            const double* x = shaped("points", points, {kAny, 3}).data();
            const double* d = shaped("directions", directions, {points.shape(0), 3}).data();
            return filled<double>({points.shape(0)}, [&](double* space) {
                for (std::size_t i = 0; i < points.shape(0); ++i, x += 3, d += 3)
                    space[i] = hull_space(faces, {x[0], x[1], x[2]}, {d[0], d[1], d[2]}, enough);
            });
        }, "planes"_a, "points"_a, "directions"_a, "enough"_a,
        "(N,) the distance (m) from points (N, 3) in the hull of planes (E, 4) to its surface along unit directions "
        "(N, 3), exact above `enough`.");
}

// Boxes with half their sides (N, 3) at poses (N, 4, 4), as obstacles.
std::vector<Body> box_bodies(const Matrix& halves, const Stack& poses) {
    const double* half = finite("halves", halves, {kAny, 3}).data();
    const double* pose = finite("poses", poses, {halves.shape(0), 4, 4}).data();
    constexpr std::array<double, 8> no_discs{};
    std::vector<Body> bodies(halves.shape(0));
    for (Body& body : bodies) {
        const Vec3 high{half[0], half[1], half[2]}, low = -high;
        std::array<double, 24> corners;
        for (unsigned i = 0; i < 24; ++i) corners[i] = i / 3 >> i % 3 & 1 ? high[i % 3] : low[i % 3];
        body.shape = std::make_shared<Shape>(make_shape(ShapeKind::kConvex, corners, no_discs, 0.0, {}, low, high));
        body.joint_from_body = read_transform(pose);
        half += 3;
        pose += 16;
    }
    return bodies;
}

// Append a number from 1e-9 to 1e15 as Python's repr writes it: the fewest digits that are read as this number.
void append_repr(std::string& text, double number) {
    char digits[32];
    const auto format = number < 1e-4 ? std::chars_format::scientific : std::chars_format::fixed;
    const std::string_view made(digits, std::to_chars(digits, digits + sizeof(digits), number, format).ptr);
    text += made;
    if (number >= 1e-4 && made.find('.') == made.npos) text += ".0";
}

// What the hash of a setup covers of boxes: repr((name, shape, None)), and the numbers of the pose. The core writes
// numbers ten times as fast as Python.
nb::bytes describe_boxes(const nb::typed<nb::list, nb::str>& names, const nb::typed<nb::list, Body>& boxes) {
    require_size("names", names.size(), boxes.size());
    std::string text;
    text.reserve(256 * boxes.size());
    for (std::size_t i = 0; i < boxes.size(); ++i) {
        const Body& box = nb::cast<const Body&>(boxes[i]);
        if (box.shape == nullptr) refuse("a box has no shape");
        const Vec3 sides = 2.0 * box.shape->corners_half;
        text += '(';
        text += nb::cast<const char*>(names[i]);
        text += ", Box(x=";
        append_repr(text, sides.x);
        append_repr(text += ", y=", sides.y);
        append_repr(text += ", z=", sides.z);
        text += "), None)";
        double pose[16];
        write_homogeneous(box.joint_from_body, pose);
        text.append(reinterpret_cast<const char*>(pose), sizeof(pose));
    }
    return nb::bytes(text.data(), text.size());
}

const std::vector<Body>& at_rest(const std::vector<Body>& bodies) {
    for (const Body& body : bodies)
        if (body.shape == nullptr || body.joint != kRoot) refuse("an obstacle has no shape, or is on a joint");
    return bodies;
}

std::shared_ptr<Obstacles> replace_obstacles(const Obstacles& obstacles, const Indices& numbers,
                                             const std::vector<Body>& others) {
    const auto replaced = shaped("numbers", numbers, {others.size()});
    for (std::int64_t number : replaced)
        if (number < 0 || static_cast<std::size_t>(number) >= obstacles.bodies.size()) refuse("not an obstacle");
    return std::make_shared<Obstacles>(obstacles.replaced(replaced, at_rest(others)));
}

std::shared_ptr<Geometry> make_geometry(const JointTree& tree, const std::vector<Body>& robot,
                                        std::shared_ptr<Obstacles> others, double rounding) {
    for (const Body& body : robot) {
        const bool on_joint = body.joint >= 0 && static_cast<std::size_t>(body.joint) < tree.joints.size();
        if (body.shape == nullptr || (body.joint != kRoot && !on_joint))
            refuse("a body has no shape, or is on a joint that does not exist");
    }
    return std::make_shared<Geometry>(tree, robot, std::move(others), rounding);
}

std::shared_ptr<PairTable> make_pairs(const Geometry& geometry, const IndexMatrix& pairs) {
    const auto bodies = shaped("pairs", pairs, {kAny, 2});
    const auto robot = static_cast<std::int64_t>(geometry.robot.size());
    const auto every = static_cast<std::int64_t>(geometry.size());
    for (std::size_t k = 0; k < bodies.size(); k += 2)
        if (bodies[k] < 0 || bodies[k] >= robot || bodies[k + 1] < 0 || bodies[k + 1] >= every ||
            bodies[k] == bodies[k + 1])
            refuse("a pair must be a body of the robot and another body");
    return std::make_shared<PairTable>(geometry, bodies);
}

std::vector<double> margins_of(const Vector& margins, const PairTable& table) {
    const auto numbers = shaped("margins", margins, {table.pairs.size()});
    // No comparison with NaN is true, so that the largest margin would not include it.
    if (std::ranges::any_of(numbers, [](double margin) { return std::isnan(margin); })) refuse("a margin is NaN");
    return list_of(numbers);
}

// A geometry whose bodies a table of pairs is for.
std::shared_ptr<Geometry> fitting(std::shared_ptr<Geometry> geometry, const PairTable& table) {
    if (!table.fits(*geometry)) refuse("the pairs are those of other bodies or joints");
    for (std::size_t a = 0; a < table.is_first.size(); ++a) {
        const ShapeKind kind = geometry->shape(static_cast<int>(a)).kind;
        if (table.is_first[a] && (kind == ShapeKind::kHalfSpace || kind == ShapeKind::kCells))
            refuse("a half-space, and cells, must be the second body of a pair");
    }
    return geometry;
}

void bind_world(nb::module_& module) {
    bind_struct<Body>(module, "Body", "A body of the robot on a joint or the root (-1), or an obstacle on the root.",
                      unchecked, MEMBERS(Body, shape, joint, joint_from_body));
    module.def("bodies_on_joint", [](const std::vector<std::shared_ptr<Shape>>& shapes, int joint, const Matrix& pose) {
            const Transform place = transform("joint_from_body", pose);
            std::vector<Body> bodies;
            for (const auto& shape : shapes) bodies.push_back({shape, joint, place});
            return bodies;
        }, "shapes"_a, "joint"_a, "joint_from_body"_a, "Bodies of several shapes at one pose on a joint or the root.");
    module.def("box_bodies", &box_bodies, "halves"_a, "poses"_a,
               "The bodies of boxes with half their sides (N, 3) at poses (N, 4, 4) in the root frame.");
    module.def("describe_boxes", &describe_boxes, "names"_a, "boxes"_a,
               "The names (as repr), sides and poses of the bodies of boxes, for a hash.");
    nb::class_<Obstacles>(module, "Obstacles", "The bodies of obstacles, for the geometries of several checkers.")
        .def(nb::new_([](const std::vector<Body>& bodies) { return std::make_shared<Obstacles>(at_rest(bodies)); }),
             "bodies"_a)
        .def("replaced", &replace_obstacles, "numbers"_a, "bodies"_a,
             "The same with other bodies in place of those with these numbers.");
    nb::class_<Geometry>(module, "Geometry", "The bodies of a checker: those of the robot, then the obstacles.")
        .def(nb::new_(&make_geometry), "tree"_a, "robot"_a, "obstacles"_a, "rounding"_a);
    nb::class_<PairTable>(module, "PairTable", "Pairs of bodies (P, 2), whatever their shapes and places.")
        .def(nb::new_(&make_pairs), "geometry"_a, "pairs"_a)
        .def("fits", &PairTable::fits, "geometry"_a, "Whether a geometry has as many bodies, on the same joints.");
    nb::class_<World>(module, "World", "The pairs of bodies of a checker, and their margins.")
        .def(nb::new_([](std::shared_ptr<Geometry> geometry, std::shared_ptr<PairTable> table, const Vector& margins) {
                auto numbers = margins_of(margins, *table);
                return std::make_shared<World>(fitting(std::move(geometry), *table), std::move(table), std::move(numbers));
            }), "geometry"_a, "pairs"_a, "margins"_a)
        .def("with_margins", [](const World& world, const Vector& margins) {
                return std::make_shared<World>(world.with_margins(margins_of(margins, *world.table)));
            }, "margins"_a)
        .def("with_obstacles", [](const World& world, std::shared_ptr<Geometry> geometry) {
                return std::make_shared<World>(world.with_obstacles(fitting(std::move(geometry), *world.table)));
            }, "geometry"_a, "The same robot, pairs and margins among obstacles that were replaced.")
        .def("of_still_pairs", [](const World& world) { return std::make_shared<World>(world.of_still_pairs()); })
        .def("joints_between", [](const World& world, std::size_t pair) {
                std::vector<Joint> joints;
                for (int k : world.joints_between(world.table->pairs.at(pair))) joints.push_back(world.space().tree.joints[k]);
                return joints;
            }, "pair"_a, "The joints between the bodies of a pair.")
        .def_prop_ro("still", [](const World& world) { return array_of<std::int64_t>(world.table->still); },
                     "The pairs that no joint moves relative to each other.")
        .def_prop_ro("convex", [](const World& world) { 
                return column<bool>(world.table->pairs, [&](const Pair& pair) { return world.is_convex(pair); });
             },
                     "(P,) whether both bodies of a pair have a support function, as no mesh has.")
        .def_prop_ro("first_directions", [](const World& world) {
                const auto along = [&](int axis) {
                    return [&world, axis](const Pair& pair) { return world.first_direction(pair)[axis]; };
                };
                return table(world.table->pairs, along(0), along(1), along(2));
            }, "(P, 3) the direction at which the search for the distance of a pair begins; zeros: any.");
}

// The result for one configuration.
constexpr int kFree = 0, kContact = -1, kNotFinite = -2;

int judge(Workspace& self, const double* q) {
    if (!self.place_at(q)) return kNotFinite;
    return self.any_contact() ? kContact : kFree;
}

const double* configuration(const Workspace& self, const Vector& q) {
    return shaped("q", q, {self.world().space().tree.dof}).data();
}

// Place the bodies at q for a question whose result cannot express that q is not finite.
void place_finite(Workspace& self, const Vector& q) {
    if (!self.place_at(configuration(self, q))) refuse("q holds a number that is not finite");
}

// Ask `question(q, row)` about each of the configurations (N, n), without the GIL.
template <class Question>
void ask_all(const Workspace& self, const Matrix& configurations, Question question) {
    const std::size_t dof = self.world().space().tree.dof;
    const double* q = shaped("configurations", configurations, {kAny, dof}).data();
    nb::gil_scoped_release release;
    for (std::size_t row = 0; row < configurations.shape(0); ++row) question(q + row * dof, row);
}

void bind_workspace(nb::module_& module) {
    nb::class_<Workspace>(module, "Workspace", "The bodies of a world at one configuration; one for each thread.")
        .def(nb::init<std::shared_ptr<World>>(), "world"_a)
        .def("place", [](Workspace& self, const Vector& q) { self.place_at(configuration(self, q)); }, "q"_a)
        // No conversion of q, which would hide copies in inner loops.
        .def("judge", [](Workspace& self, const Vector& q) { return judge(self, configuration(self, q)); },
             "q"_a.noconvert(), "FREE, CONTACT or NOT_FINITE.")
        .def("judge_many", [](Workspace& self, const Matrix& configurations) {
                std::int64_t* numbers = nullptr;
                auto array = filled({configurations.shape(0)}, numbers);
                ask_all(self, configurations, [&](const double* q, std::size_t row) { numbers[row] = judge(self, q); });
                return array;
            }, "configurations"_a)
        .def("find_contacts", [](Workspace& self, const Vector& q) {
                place_finite(self, q);
                self.find_contacts();
                return self.contacts();
            }, "q"_a, "The pairs in contact at q, which must be finite.")
        .def("find_nearest", [](Workspace& self, const Vector& q) {
                place_finite(self, q);
                const Nearest nearest = self.find_nearest();
                return std::tuple(self.contacts(), nearest.lower, nearest.upper, nearest.pair);
            }, "q"_a,
            "(overlapping pairs, lower and upper bound of the smallest distance of the others, its pair) at q, which "
            "must be finite.")
        .def("find_nearest_many", [](Workspace& self, const Matrix& configurations) {
                double* lower = nullptr;
                bool* overlap = nullptr;
                const std::size_t count = configurations.shape(0);
                std::tuple arrays(filled({count}, lower), filled({count}, overlap));
                ask_all(self, configurations, [&](const double* q, std::size_t row) {
                    const bool finite = self.place_at(q);
                    lower[row] = finite ? self.find_nearest().lower : std::nan("");
                    overlap[row] = finite && !self.contacts().empty();
                });
                return arrays;
            }, "configurations"_a,
            "(N,) lower bounds of the smallest distance, and whether pairs overlap.")
        .def("measure", [](const Workspace& self, std::size_t pair) {
                if (pair >= self.world().size()) refuse("not a pair of bodies");
                const Measured found = self.measure(static_cast<int>(pair));
                const Vec3 &a = found.points.of_a, &b = found.points.of_b;
                auto witnesses = rows_of(std::array{a.x, a.y, a.z, b.x, b.y, b.z}, 3);
                std::array<std::optional<NewArray>, 2> triangles;
                for (int i = 0; i < 2; ++i)
                    if (found.triangles[i]) triangles[i] = rows_of({&found.triangles[i]->corners[0].x, 9}, 3);
                return std::tuple(found.bounds.lower, found.bounds.upper, witnesses, found.normal, triangles[0], triangles[1]);
            }, "pair"_a,
            "(lower, upper, points (2, 3), normal (3,)) of the distance of a pair, in the root frame, and the closest triangle (3, 3) "
            "of the first and of the second body in its own frame, or two that overlap; None of a body that is no mesh.")
        .def("overlapping_boxes", [](const Workspace& self, std::size_t pair) {
                if (pair >= self.world().size()) refuse("not a pair of bodies");
                const int k = static_cast<int>(pair);
                return boxes_of(self.world().shape(self.world().pair(k).b), self.overlapping_boxes(k));
            }, "pair"_a, "(B, 2, 3) centre and half sides of the boxes of cells that a pair does not prove apart.")
        .def("root_from_body", [](const Workspace& self, std::size_t body) {
                if (body >= self.world().space().size()) refuse("not a body");
                return self.bodies()[static_cast<int>(body)].root_from_body;
            }, "body"_a);
    module.attr("FREE") = kFree;
    module.attr("CONTACT") = kContact;
    module.attr("NOT_FINITE") = kNotFinite;
}

using Cells = nb::ndarray<std::uint8_t, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

// An image is addressed by int, and its windows by a shift of it.
constexpr std::size_t kMostPixels = 1 << 16;

CellGrid grid_of(const Cells& cells, const Indices& low, double side) {
    const auto l = shaped("low", low, {3});
    for (std::int64_t index : l)
        if (index < -kMostCells || index > kMostCells) refuse("low is out of range");
    finite("side", positive("side", side));
    return {{l[0], l[1], l[2]}, {cells.shape(0), cells.shape(1), cells.shape(2)}, side};
}

// The depths in single precision, rounded down or up, so that bounds remain bounds. The next number of a positive one
// is that whose bits, read as an integer, are one more.
template <bool up>
std::vector<float> rounded(std::span<const double> depth) {
    std::vector<float> values(depth.size());
    bool valid = true;
    for (std::size_t i = 0; i < values.size(); ++i) {
        const auto nearest = static_cast<float>(depth[i]);
        const auto bits = std::bit_cast<std::uint32_t>(nearest);
        const auto wrong = static_cast<std::uint32_t>(up ? nearest < depth[i] : nearest > depth[i]);
        values[i] = std::bit_cast<float>(up ? bits + wrong : bits - wrong);
        valid &= depth[i] >= 0.0;
    }
    if (!valid) refuse("a depth is negative or NaN");
    return values;
}

void bind_lines(nb::module_& module) {
    module.def(
        "enter_triangles",
        [](const Stack& triangles, const Matrix& origins, const Vector& direction, const Vector& start) {
            const auto corners = shaped("triangles", triangles, {kAny, 3, 3});
            const auto from = shaped("origins", origins, {kAny, 3});
            const std::size_t count = origins.shape(0);
            const auto after = shaped("start", start, {count});
            double* depth = nullptr;
            auto depths = filled({count}, depth);
            std::vector<Vec3> normals(count);
            enter_triangles(corners, from, unit_vector("direction", direction, 1e-6), after, {depth, count}, normals);
            return std::tuple(depths, table(normals, &Vec3::x, &Vec3::y, &Vec3::z));
        }, "triangles"_a, "origins"_a, "direction"_a, "start"_a,
        "Where lines along a direction first meet triangles (F, 3, 3) beyond `start` (G,): depths (G,), normals (G, 3).");
}

void bind_occupancy(nb::module_& module) {
    module.def(
        "carve",
        [](Cells cells, const Indices& low, double side, const Matrix& camera_from_grid, const Vector& intrinsics,
           const Matrix& nearest, const Matrix& farthest, int pixel_margin) {
            const CellGrid grid = grid_of(cells, low, side);
            const auto f = finite("intrinsics", intrinsics, {4});
            const std::size_t height = nearest.shape(0), width = nearest.shape(1);
            if (height > kMostPixels || width > kMostPixels) refuse("an image has at most 65536 rows and columns");
            if (pixel_margin < 0 || pixel_margin > static_cast<int>(kMostPixels))
                refuse("pixel_margin is out of range");
            const auto near_bounds = rounded<false>(shaped("nearest", nearest, {kSome, kSome}));
            const auto far_bounds = rounded<true>(shaped("farthest", farthest, {height, width}));
            const PinholeCamera camera{positive("fx", f[0]), positive("fy", f[1]), f[2], f[3], static_cast<int>(width),
                                       static_cast<int>(height), transform("camera_from_grid", camera_from_grid)};
            nb::gil_scoped_release release;
            carve(grid, camera, {near_bounds, far_bounds}, pixel_margin, {cells.data(), grid.size()});
        }, "cells"_a.noconvert(), "low"_a, "side"_a, "camera_from_grid"_a, "intrinsics"_a, "nearest"_a, "farthest"_a,
        "pixel_margin"_a,
        "Set the state of each cell (nx, ny, nz) from one depth image, given as bounds of depth (m); see "
        "collision/occupancy.h. The intrinsics are fx, fy, cx, cy.");
    module.def(
        "clear_within",
        [](Cells cells, const Indices& low, double side, const Shape& shape, const Matrix& shape_from_grid,
           double padding) {
            const CellGrid grid = grid_of(cells, low, side);
            if (shape.kind != ShapeKind::kConvex) refuse("the shape is not convex and bounded");
            if (!(finite("padding", padding) >= 0.0)) refuse("padding must be 0 or more");
            const Transform placement = transform("shape_from_grid", shape_from_grid);
            nb::gil_scoped_release release;
            return clear_within(grid, shape, placement, padding, {cells.data(), grid.size()});
        }, "cells"_a.noconvert(), "low"_a, "side"_a, "shape"_a, "shape_from_grid"_a, "padding"_a,
        "Set the cells that are entirely within the padding (m) of a convex shape to free; returns how many were not.");
}

}  // namespace

void bind_collision(nb::module_& module) {
    bind_shapes(module);
    bind_world(module);
    bind_workspace(module);
    bind_lines(module);
    bind_occupancy(module);
}

}  // namespace pinproof
