// Inverse dynamics, and bounds of torques and of the motion of the tool.
#include <nanobind/stl/vector.h>

#include <cmath>
#include <stdexcept>
#include <vector>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "dynamics/curve_bounds.h"
#include "dynamics/inverse_dynamics.h"

namespace pinproof {
namespace {

DynamicTree make_tree(const Stack& before, const std::vector<bool>& prismatic, const std::vector<std::int64_t>& index,
                      const std::vector<double>& multiplier, const std::vector<double>& offset,
                      const std::vector<std::int64_t>& parent, const Vector& mass, const Matrix& first_moment,
                      const Stack& inertia, const Vector& gravity, std::int64_t tool_joint, const Vector& tool,
                      std::size_t dof) {
    const std::size_t count = prismatic.size();
    require_size("before", before.shape(0), count);
    require_size("a matrix of before", before.shape(1) == 4 ? before.shape(2) : 0, 4);
    require_size("index", index.size(), count);
    require_size("multiplier", multiplier.size(), count);
    require_size("offset", offset.size(), count);
    require_size("parent", parent.size(), count);
    require_size("mass", mass.shape(0), count);
    require_size("first_moment", first_moment.shape(0), count);
    require_size("a row of first_moment", first_moment.shape(1), 3);
    require_size("inertia", inertia.shape(0), count);
    require_size("a matrix of inertia", inertia.shape(1) == 3 ? inertia.shape(2) : 0, 3);
    require_size("gravity", gravity.shape(0), 3);
    require_size("tool", tool.shape(0), 3);
    require_finite("gravity", gravity.data(), 3);
    require_finite("tool", tool.data(), 3);
    require_finite("mass", mass.data(), mass.size());
    require_finite("first_moment", first_moment.data(), first_moment.size());
    require_finite("inertia", inertia.data(), inertia.size());
    if (tool_joint < kRoot || tool_joint >= static_cast<std::int64_t>(count))
        throw std::invalid_argument("tool_joint is not a joint of the tree");
    DynamicTree model;
    model.tree.dof = dof;
    model.gravity = {gravity(0), gravity(1), gravity(2)};
    model.tool_joint = static_cast<int>(tool_joint);
    model.tool = {tool(0), tool(1), tool(2)};
    for (std::size_t k = 0; k < count; ++k) {
        if (index[k] < 0 || index[k] >= static_cast<std::int64_t>(dof))
            throw std::invalid_argument("the index of a joint is not smaller than dof");
        if (parent[k] < kRoot || parent[k] >= static_cast<std::int64_t>(k))
            throw std::invalid_argument("the parent of a joint must have a smaller number");
        model.tree.joints.push_back({read_transform(before.data() + 16 * k), prismatic[k], static_cast<int>(index[k]),
                                     multiplier[k], offset[k], static_cast<int>(parent[k])});
        RigidBody body;
        body.mass = mass(k);
        body.first_moment = {first_moment(k, 0), first_moment(k, 1), first_moment(k, 2)};
        for (std::size_t i = 0; i < 3; ++i)
            for (std::size_t j = 0; j < 3; ++j) body.inertia[i][j] = inertia(k, i, j);
        model.bodies.push_back(body);
    }
    return model;
}

// Drive the model along the rows of q, v and a (N, n), and call `record(row, dynamics)` after each.
template <class Record>
void drive_rows(const DynamicTree& model, const Matrix& q, const Matrix& v, const Matrix& a, Record record) {
    const std::size_t dof = model.tree.dof;
    InverseDynamics<double> dynamics(model);
    std::vector<JointMotion<double>> motion(dof);
    for (std::size_t row = 0; row < q.shape(0); ++row) {
        for (std::size_t j = 0; j < dof; ++j) motion[j] = {q(row, j), v(row, j), a(row, j)};
        dynamics.move(motion);
        record(row, dynamics);
    }
}

void require_rows(const DynamicTree& model, const Matrix& q, const Matrix& v, const Matrix& a) {
    for (const Matrix* rows : {&q, &v, &a}) {
        require_size("a row", rows->shape(1), model.tree.dof);
        require_size("the number of rows", rows->shape(0), q.shape(0));
        require_finite("a row", rows->data(), rows->size());
    }
}

nb::tuple torques(const DynamicTree& model, const Matrix& q, const Matrix& v, const Matrix& a) {
    require_rows(model, q, v, a);
    const std::size_t dof = model.tree.dof;
    auto of_motion = new_array({q.shape(0), dof}), of_gravity = new_array({q.shape(0), dof});
    {
        nb::gil_scoped_release release;
        drive_rows(model, q, v, a, [&](std::size_t row, InverseDynamics<double>& dynamics) {
            dynamics.torques({of_motion.data + row * dof, dof}, {of_gravity.data + row * dof, dof});
        });
    }
    return nb::make_tuple(nb::cast(of_motion.array), nb::cast(of_gravity.array));
}

nb::object tool_motion(const DynamicTree& model, const Matrix& q, const Matrix& v, const Matrix& a) {
    require_rows(model, q, v, a);
    auto rates = new_array({q.shape(0), 4, 3});
    {
        nb::gil_scoped_release release;
        drive_rows(model, q, v, a, [&](std::size_t row, InverseDynamics<double>& dynamics) {
            const ToolMotion<double> tool = dynamics.tool();
            double* out = rates.data + 12 * row;
            for (const Vector3<double>* each : {&tool.linear_velocity, &tool.angular_velocity,
                                                &tool.linear_acceleration, &tool.angular_acceleration}) {
                *out++ = each->x;
                *out++ = each->y;
                *out++ = each->z;
            }
        });
    }
    return nb::cast(rates.array);
}

TimedCurve read_curve(const DynamicTree& model, const Stack& position, const Stack& velocity,
                      const Stack& acceleration) {
    TimedCurve curve{position.shape(0), model.tree.dof, {}, {}};
    std::size_t order = 0;
    for (const Stack* control : {&position, &velocity, &acceleration}) {
        require_size("the number of pieces", control->shape(0), curve.pieces);
        require_size("a control point", control->shape(2), curve.dof);
        if (control->shape(1) < 1 || control->shape(1) > kMaxCurveDegree + 1)
            throw std::invalid_argument("a piece must have 1 to 8 control points");
        require_finite("a control point", control->data(), control->size());
        curve.points[order] = control->shape(1);
        curve.control[order++] = {control->data(), control->size()};
    }
    return curve;
}

void require_limits(const Vector& limits, std::size_t expected) {
    require_size("limits", limits.shape(0), expected);
    for (std::size_t i = 0; i < expected; ++i) require_positive("a limit", limits(i));
}

nb::object torque_stretch_of(const DynamicTree& model, const Stack& position, const Stack& velocity,
                             const Stack& acceleration, const Vector& limits) {
    const TimedCurve curve = read_curve(model, position, velocity, acceleration);
    require_limits(limits, curve.dof);
    auto stretch = new_array({curve.pieces});
    {
        nb::gil_scoped_release release;
        torque_stretch(model, curve, {limits.data(), curve.dof}, {stretch.data, curve.pieces});
    }
    return nb::cast(stretch.array);
}

nb::object tool_stretch_of(const DynamicTree& model, const Stack& position, const Stack& velocity,
                           const Stack& acceleration, const Vector& limits) {
    const TimedCurve curve = read_curve(model, position, velocity, acceleration);
    require_limits(limits, 4);
    auto stretch = new_array({curve.pieces});
    {
        nb::gil_scoped_release release;
        tool_stretch(model, curve, {limits(0), limits(1), limits(2), limits(3)}, {stretch.data, curve.pieces});
    }
    return nb::cast(stretch.array);
}

using PeaksOf = std::vector<Peak> (*)(const DynamicTree&, const TimedCurve&);

template <PeaksOf peaks_of>
nb::tuple peaks(const DynamicTree& model, const Stack& position, const Stack& velocity, const Stack& acceleration) {
    const TimedCurve curve = read_curve(model, position, velocity, acceleration);
    std::vector<Peak> found;
    {
        nb::gil_scoped_release release;
        found = peaks_of(model, curve);
    }
    auto bound = new_array({found.size()}), fraction = new_array({found.size()});
    auto piece = new_array<std::int64_t>({found.size()});
    for (std::size_t i = 0; i < found.size(); ++i) {
        bound.data[i] = found[i].bound;
        piece.data[i] = static_cast<std::int64_t>(found[i].piece);
        fraction.data[i] = found[i].fraction;
    }
    return nb::make_tuple(nb::cast(bound.array), nb::cast(piece.array), nb::cast(fraction.array));
}

}  // namespace

void bind_dynamics(nb::module_& module) {
    nb::class_<DynamicTree>(module, "DynamicTree", "The moving bodies of an arm, with their inertias, as a tree.")
        .def(
            "__init__",
            [](DynamicTree* self, const Stack& before, const std::vector<bool>& prismatic,
               const std::vector<std::int64_t>& index, const std::vector<double>& multiplier,
               const std::vector<double>& offset, const std::vector<std::int64_t>& parent, const Vector& mass,
               const Matrix& first_moment, const Stack& inertia, const Vector& gravity, std::int64_t tool_joint,
               const Vector& tool, std::size_t dof) {
                new (self) DynamicTree(make_tree(before, prismatic, index, multiplier, offset, parent, mass,
                                                 first_moment, inertia, gravity, tool_joint, tool, dof));
            },
            nb::arg("before"), nb::arg("prismatic"), nb::arg("index"), nb::arg("multiplier"), nb::arg("offset"),
            nb::arg("parent"), nb::arg("mass"), nb::arg("first_moment"), nb::arg("inertia"), nb::arg("gravity"),
            nb::arg("tool_joint"), nb::arg("tool"), nb::arg("dof"),
            "Joints about or along z of their frames (m), parents first, -1 for the root; bodies in the joint frames: "
            "mass (m,), mass times centre (m, 3), inertia about the origin (m, 3, 3); gravity (3,) in the root frame; "
            "the tool (3,) in the frame of tool_joint.")
        .def("torques", &torques, nb::arg("q"), nb::arg("v"), nb::arg("a"),
             "Torques (N, n) of the motion, and of gravity (N, n), at the rows of q, v and a (N, n).")
        .def("tool_motion", &tool_motion, nb::arg("q"), nb::arg("v"), nb::arg("a"),
             "(N, 4, 3) linear and angular velocity, linear and angular acceleration of the tool, in the axes of its "
             "joint.")
        .def("torque_stretch", &torque_stretch_of, nb::arg("position"), nb::arg("velocity"), nb::arg("acceleration"),
             nb::arg("limits"),
             "(k,) the factors by which the pieces of a curve, given by the control points (k, p, n) of its "
             "derivatives, must be slowed down to keep the limits (n,); inf where gravity alone exceeds them.")
        .def("tool_stretch", &tool_stretch_of, nb::arg("position"), nb::arg("velocity"), nb::arg("acceleration"),
             nb::arg("limits"), "The same for limits (4,) of the tool: speeds and accelerations, linear and angular.")
        .def("torque_peaks", &peaks<&torque_peaks>, nb::arg("position"), nb::arg("velocity"), nb::arg("acceleration"),
             "Bounds (n,) of the torques over a curve, and the piece and the fraction of it where each occurs.")
        .def("tool_peaks", &peaks<&tool_peaks>, nb::arg("position"), nb::arg("velocity"), nb::arg("acceleration"),
             "Bounds (4,) of the speeds and accelerations of the tool, and the piece and fraction where each occurs.");
}

}  // namespace pinproof
