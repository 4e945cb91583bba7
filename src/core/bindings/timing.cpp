// Time parametrisation of paths, inverse dynamics, and bounds of torques and of the motion of the tool.
#include <nanobind/stl/string.h>

#include "bindings/structs.h"
#include "dynamics/curve_bounds.h"
#include "dynamics/inverse_dynamics.h"
#include "timing/path_speed.h"
#include "timing/time_path.h"

namespace pinproof {
namespace {

const char* name_of(TimingStatus status) {
    switch (status) {
        case TimingStatus::timed: return "timed";
        case TimingStatus::end_too_fast: return "end too fast";
        case TimingStatus::ends_unreachable: return "ends unreachable";
        case TimingStatus::not_smooth: return "not smooth";
        case TimingStatus::too_long: return "too long";
        case TimingStatus::deviates: return "deviates";
        case TimingStatus::exceeds: return "exceeds";
    }
    return "";
}

void check_rates(const RateLimits& limits) {
    require_size("acceleration", limits.acceleration.size(), limits.velocity.size());
    if (limits.smooth()) require_size("jerk", limits.jerk.size(), limits.velocity.size());
    for (const Doubles* rates : {&limits.velocity, &limits.acceleration, &limits.jerk})
        for (double rate : *rates) positive("a limit", rate);
}

// The limits of Python's `rows(q, slope, curvature)`.
ConstraintRows called(const nb::callable& rows, std::size_t joints, std::span<const double> q,
                      std::span<const double> slope, std::span<const double> curvature) {
    const auto [alpha, beta, gamma, bound] = nb::cast<std::tuple<Matrix, Matrix, Matrix, Matrix>>(
        rows(rows_of(q, joints), rows_of(slope, joints), rows_of(curvature, joints)));
    const std::size_t points = q.size() / joints, columns = alpha.shape(1);
    const auto list = [&](const char* name, const Matrix& matrix) {
        return list_of(shaped(name, matrix, {points, columns}));
    };
    return {columns, list("alpha", alpha), list("beta", beta), list("gamma", gamma), list("bound", bound)};
}

nb::tuple timed(const Vector& knots, const Stack& control, const std::optional<Vector>& stops, const RateLimits& limits,
                const Vector& start_velocity, const Vector& end_velocity, double image_tolerance, double rate_tolerance,
                double longest, const std::optional<nb::callable>& rows, const std::optional<nb::callable>& excess) {
    const std::size_t n = control.shape(2), pieces = control.shape(0);
    const auto points = finite("control", control, {kSome, kSome, kSome});
    if (control.shape(1) > TimedPath::kMaxDegree + 1)
        refuse("a path needs pieces of a degree up to " + std::to_string(TimedPath::kMaxDegree));
    const auto parameters = knots_of(knots, pieces + 1);
    require_size("limits", limits.velocity.size(), n);
    if (!moves(n, points)) refuse("the path has length 0");
    if (excess.has_value() != rows.has_value()) refuse("rows and excess belong together");
    std::vector<char> flags;
    if (stops) for (double stop : shaped("stops", *stops, {pieces + 1})) flags.push_back(stop != 0.0);
    else flags = tangent_jumps(n, parameters, points);
    const TimedPath path(n, parameters, points, flags, limits);
    TimingTask task{path, limits, list_of(finite("start_velocity", start_velocity, {n})),
                    list_of(finite("end_velocity", end_velocity, {n})), positive("image_tolerance", image_tolerance),
                    rate_tolerance, longest, {}, {}};
    const auto accelerations = [n](const HermiteCurve& curve) {
        return curve.quintic() ? nb::cast(rows_of(curve.acceleration, n)) : nb::none();
    };
    TimedMotion motion;
    if (rows) {
        task.rows = [&](auto q, auto slope, auto curvature) { return called(*rows, n, q, slope, curvature); };
        task.excess = [&](const HermiteCurve& curve) {
            const auto factors = nb::cast<Vector>((*excess)(array_of(curve.times), rows_of(curve.q, n),
                                                            rows_of(curve.velocity, n), accelerations(curve)));
            return list_of(shaped("excess", factors, {curve.pieces()}));
        };
        motion = time_path(task);
    } else {
        nb::gil_scoped_release release;
        motion = time_path(task);
    }
    const HermiteCurve& curve = motion.curve;
    return nb::make_tuple(name_of(motion.status), array_of(curve.times), rows_of(curve.q, n),
                          rows_of(curve.velocity, n), accelerations(curve), motion.deviation, motion.excess);
}

std::tuple<NewArray, std::optional<std::size_t>> speeds(const Stack& alpha, const Stack& beta, const Stack& gamma,
                                                        const Stack& bound, const Vector& step, const Vector& ceiling,
                                                        double start, double end) {
    const std::size_t steps = step.shape(0), rows = alpha.shape(2);
    const SpeedProblem problem{rows, shaped("alpha", alpha, {steps, 2, rows}), shaped("beta", beta, {steps, 2, rows}),
                               shaped("gamma", gamma, {steps, 2, rows}), shaped("bound", bound, {steps, 2, rows}),
                               shaped("step", step, {kAny}), shaped("ceiling", ceiling, {steps + 1}), start, end};
    Doubles x(steps + 1);
    const auto stuck = fastest_speeds(problem, x);
    return {array_of(x), stuck};
}

void bind_timing_of_paths(nb::module_& module) {
    bind_struct<RateLimits>(module, "RateLimits", "Limits of the joints (n); without a jerk limit, jerk is empty.",
                            check_rates, MEMBERS(RateLimits, velocity, acceleration, jerk));
    module.def("fastest_speeds", &speeds, "alpha"_a, "beta"_a, "gamma"_a, "bound"_a, "step"_a, "ceiling"_a, "start"_a,
               "end"_a,
               "(x, node): x = s'^2 (N + 1,) at the nodes of a grid, and the node from which the path cannot be driven "
               "or None.");
    module.def("time_path", &timed, "knots"_a, "control"_a, "stops"_a.none(), "limits"_a, "start_velocity"_a,
               "end_velocity"_a, "image_tolerance"_a, "rate_tolerance"_a, "longest"_a, "rows"_a.none(),
               "excess"_a.none(),
               "(status, times, q, velocities, accelerations or None, deviation, excess) of the fastest motion along "
               "pieces with control points (k, degree + 1, n). Without stops (k + 1,) it stops where the "
               "tangent jumps.");
    module.def("corners", [](const Matrix& q) {
            const std::size_t n = q.shape(1);
            return rows_of(corners(n, finite("q", q, {kSome, kSome})), n);
        }, "q"_a, "The waypoints at which a motion along a polyline must stop.");
}

void check_model(const DynamicTree& model) {
    require_size("bodies", model.bodies.size(), model.tree.joints.size());
    if (model.tool_joint < kRoot || model.tool_joint >= static_cast<int>(model.bodies.size()))
        refuse("tool_joint is not a joint of the tree");
}

// Drive the model along the rows of q, v and a (N, n), and call `record(row, dynamics)` after each.
template <class Record>
void drive_rows(const DynamicTree& model, const Matrix& q, const Matrix& v, const Matrix& a, Record record) {
    const std::size_t dof = model.tree.dof, rows = q.shape(0);
    const double *position = finite("q", q, {kAny, dof}).data(), *velocity = finite("v", v, {rows, dof}).data();
    const double* acceleration = finite("a", a, {rows, dof}).data();
    nb::gil_scoped_release release;
    InverseDynamics<double> dynamics(model);
    std::vector<JointMotion<double>> motion(dof);
    for (std::size_t row = 0; row < rows; ++row) {
        for (JointMotion<double>& joint : motion) joint = {*position++, *velocity++, *acceleration++};
        dynamics.move(motion);
        record(row, dynamics);
    }
}

nb::tuple torques(const DynamicTree& model, const Matrix& q, const Matrix& v, const Matrix& a) {
    const std::size_t dof = model.tree.dof;
    double *of_motion = nullptr, *of_gravity = nullptr;
    const auto arrays = nb::make_tuple(filled({q.shape(0), dof}, of_motion), filled({q.shape(0), dof}, of_gravity));
    drive_rows(model, q, v, a, [&](std::size_t row, InverseDynamics<double>& dynamics) {
        dynamics.torques({of_motion + row * dof, dof}, {of_gravity + row * dof, dof});
    });
    return arrays;
}

NewArray tool_motion(const DynamicTree& model, const Matrix& q, const Matrix& v, const Matrix& a) {
    return filled<double>({q.shape(0), 4, 3}, [&](double* out) {
        drive_rows(model, q, v, a, [&](std::size_t, InverseDynamics<double>& dynamics) {
            const ToolMotion<double> tool = dynamics.tool();
            for (const Vector3<double>* each : {&tool.linear_velocity, &tool.angular_velocity,
                                                &tool.linear_acceleration, &tool.angular_acceleration})
                out = std::ranges::copy(std::array{each->x, each->y, each->z}, out).out;
        });
    });
}

TimedCurve read_curve(const DynamicTree& model, const Stack& position, const Stack& velocity,
                      const Stack& acceleration) {
    TimedCurve curve{position.shape(0), model.tree.dof, {}, {}};
    std::size_t order = 0;
    for (const Stack* control : {&position, &velocity, &acceleration}) {
        if (control->shape(1) > kMaxCurveDegree + 1) refuse("a piece must have at most 8 control points");
        curve.points[order] = control->shape(1);
        curve.control[order++] = finite("a control point", *control, {curve.pieces, kSome, curve.dof});
    }
    return curve;
}

// How much the pieces of a curve must be slowed down, by `stretch(model, curve, limits, out)`.
template <class Stretch>
NewArray stretch_of(const DynamicTree& model, const TimedCurve& curve, const Vector& limits, std::size_t count,
                    Stretch stretch) {
    const auto most = shaped("limits", limits, {count});
    for (double limit : most) positive("a limit", limit);
    return filled<double>({curve.pieces}, [&](double* out) {
        nb::gil_scoped_release release;
        stretch(model, curve, most, std::span(out, curve.pieces));
    });
}

NewArray torque_stretch_of(const DynamicTree& model, const Stack& position, const Stack& velocity,
                           const Stack& acceleration, const Vector& limits) {
    const TimedCurve curve = read_curve(model, position, velocity, acceleration);
    return stretch_of(model, curve, limits, model.tree.dof, torque_stretch);
}

NewArray tool_stretch_of(const DynamicTree& model, const Stack& position, const Stack& velocity,
                         const Stack& acceleration, const Vector& limits) {
    return stretch_of(model, read_curve(model, position, velocity, acceleration), limits, 4,
                      [](auto& tree, auto& curve, auto most, auto out) {
                          tool_stretch(tree, curve, {most[0], most[1], most[2], most[3]}, out);
                      });
}

template <std::vector<Peak> (*peaks_of)(const DynamicTree&, const TimedCurve&)>
nb::tuple peaks(const DynamicTree& model, const Stack& position, const Stack& velocity, const Stack& acceleration) {
    const TimedCurve curve = read_curve(model, position, velocity, acceleration);
    std::vector<Peak> found;
    {
        nb::gil_scoped_release release;
        found = peaks_of(model, curve);
    }
    return nb::make_tuple(column<double>(found, &Peak::bound), column<std::int64_t>(found, &Peak::piece),
                          column<double>(found, &Peak::fraction));
}

}  // namespace

void bind_timing(nb::module_& module) {
    bind_timing_of_paths(module);
    bind_struct<RigidBody>(module, "RigidBody",
                           "Mass, mass times centre (3,) and inertia about the origin (3, 3) in the frame of a joint.",
                           unchecked, MEMBERS(RigidBody, mass, first_moment, inertia));
    bind_struct<DynamicTree>(module, "DynamicTree",
                             "The moving bodies of an arm, one for each joint of a tree; gravity (3,) is in the root "
                             "frame, and the tool (3,) in that of tool_joint.",
                             check_model, MEMBERS(DynamicTree, tree, bodies, gravity, tool_joint, tool))
        .def("torques", &torques, "q"_a, "v"_a, "a"_a,
             "Torques (N, n) of the motion, and of gravity (N, n), at the rows of q, v and a (N, n).")
        .def("tool_motion", &tool_motion, "q"_a, "v"_a, "a"_a,
             "(N, 4, 3) linear and angular velocity, linear and angular acceleration of the tool, in the axes of its "
             "joint.")
        .def("torque_stretch", &torque_stretch_of, "position"_a, "velocity"_a, "acceleration"_a, "limits"_a,
             "(k,) the factors by which the pieces of a curve, given by the control points (k, p, n) of its "
             "derivatives, must be slowed down to keep the limits (n,); inf where gravity alone exceeds them.")
        .def("tool_stretch", &tool_stretch_of, "position"_a, "velocity"_a, "acceleration"_a, "limits"_a,
             "The same for limits (4,) of the tool: speeds and accelerations, linear and angular.")
        .def("torque_peaks", &peaks<&torque_peaks>, "position"_a, "velocity"_a, "acceleration"_a,
             "Bounds (n,) of the torques over a curve, and the piece and the fraction of it where each occurs.")
        .def("tool_peaks", &peaks<&tool_peaks>, "position"_a, "velocity"_a, "acceleration"_a,
             "Bounds (4,) of the speeds and accelerations of the tool, and the piece and fraction where each occurs.");
}

}  // namespace pinproof
