// Time parametrisation of paths, inverse dynamics, and bounds of torques and of the motion of the tool.
#include <nanobind/stl/string.h>

#include "bindings/structs.h"
#include "dynamics/curve_bounds.h"
#include "dynamics/grip.h"
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
    const std::vector<Peak> found = without_gil([&] { return peaks_of(model, curve); });
    return nb::make_tuple(column<double>(found, &Peak::bound), column<std::int64_t>(found, &Peak::piece),
                          column<double>(found, &Peak::fraction));
}

// The load of the body of the tool joint at the rows of q, v and a: `record(row, of motion, of gravity)`.
template <class Record>
void each_load(const DynamicTree& model, const Matrix& q, const Matrix& v, const Matrix& a, Record record) {
    drive_rows(model, q, v, a, [&](std::size_t row, InverseDynamics<double>& dynamics) {
        const auto load = dynamics.load_of_tool();
        const auto wrench = [](const Vector3<double>& force, const Vector3<double>& moment) {
            return Wrench{force.x, force.y, force.z, moment.x, moment.y, moment.z};
        };
        record(row, wrench(load.force, load.moment), wrench(load.weight, load.weight_moment));
    });
}

NewArray loads(const DynamicTree& model, const Matrix& q, const Matrix& v, const Matrix& a) {
    return filled<double>({q.shape(0), 2, 6}, [&](double* out) {
        each_load(model, q, v, a, [&](std::size_t, const Wrench& of_motion, const Wrench& of_gravity) {
            out = std::ranges::copy(of_gravity, std::ranges::copy(of_motion, out).out).out;
        });
    });
}

void check_contact(const GripContact& contact) {
    positive("force", contact.force);
    positive("friction", contact.friction);
    const std::size_t points = contact.points.size() / 3;
    if (points == 0 || contact.points.size() % 3 != 0) refuse("points needs three numbers for each point");
    if (contact.distributions.empty() || contact.distributions.size() % points != 0)
        refuse("distributions needs a number for each point");
    if (!(std::abs(norm(contact.normal) - 1.0) < 1e-9)) refuse("normal is not a unit vector");
    for (double share : contact.distributions)
        if (!(finite("distributions", share) >= 0.0)) refuse("distributions must not be negative");
    for (double x : contact.points) finite("points", x);
}

nb::tuple sections(const Grip& grip, const DynamicTree& model, const Matrix& q, const Matrix& slope,
                   const Matrix& curvature) {
    const std::size_t rows = q.shape(0);
    const Doubles zeros(q.size());
    std::vector<std::array<Wrench, 3>> wrenches(rows);  // of s'', of s'^2 and of gravity
    each_load(model, q, Matrix(zeros.data(), {rows, model.tree.dof}), slope,
              [&](std::size_t row, const Wrench& of_motion, const Wrench& of_gravity) {
                  wrenches[row][0] = grip.local(of_motion), wrenches[row][2] = grip.local(of_gravity);
              });
    each_load(model, q, slope, curvature, [&](std::size_t row, const Wrench& of_motion, const Wrench&) {
        wrenches[row][1] = grip.local(of_motion);
    });
    double *along = nullptr, *across = nullptr, *below = nullptr, *at_rest = nullptr;
    const auto arrays = nb::make_tuple(filled({rows, kChords}, along), filled({rows, kChords}, across),
                                       filled({rows, kChords}, below), filled({rows}, at_rest));
    nb::gil_scoped_release release;
    ShareOfGrip share(grip);
    for (const auto& [alpha, beta, gamma] : wrenches) {
        const Section section = section_of(grip, share, alpha, beta, gamma);
        for (const auto& [x, y] : section.rows) *along++ = x, *across++ = y;
        below = std::ranges::copy(section.below, below).out;
        *at_rest++ = section.at_rest;
    }
    return arrays;
}

void bind_grip(nb::module_& module) {
    bind_struct<GripContact>(module, "GripContact",
                             "Points (3 K) pressed along a normal (3,), and distributions (D K) of the normal force over "
                             "them.",
                             check_contact, MEMBERS(GripContact, points, distributions, normal, force, friction, pulls));
    nb::class_<Grip>(module, "Grip", "The wrenches that contacts transmit to a part, in the frame of the tool joint.")
        .def(nb::new_([](const std::vector<GripContact>& contacts) {
                 if (contacts.empty()) refuse("a grip needs a contact");
                 return new Grip(contacts);
             }), "contacts"_a)
        .def_prop_ro("complete", &Grip::complete,
                     "Whether it transmits some force and moment in every direction.")
        .def("shares", [](const Grip& grip, const Matrix& wrenches) {
                const auto rows = finite("wrenches", wrenches, {kAny, 6});
                return filled<double>({wrenches.shape(0)}, [&](double* out) {
                    ShareOfGrip share(grip);
                    for (std::size_t row = 0; row < wrenches.shape(0); ++row) {
                        Wrench wrench;
                        std::ranges::copy(rows.subspan(6 * row, 6), wrench.begin());
                        *out++ = share(grip.local(wrench));
                    }
                });
            }, "wrenches"_a,
             "(N,) upper bounds of the shares of what the grip transmits that the forces and moments (N, 6) need.")
        .def("sections", &sections, "model"_a, "q"_a, "slope"_a, "curvature"_a,
             "(alpha, beta, below, at rest): rows (N, m) with -below <= alpha s'' + beta s'^2 <= 1 on a path, and the "
             "shares (N,) of gravity.")
        .def("stretch", [](const Grip& grip, const DynamicTree& model, const Stack& position, const Stack& velocity,
                           const Stack& acceleration) {
                const TimedCurve curve = read_curve(model, position, velocity, acceleration);
                return filled<double>({curve.pieces}, [&](double* out) {
                    nb::gil_scoped_release release;
                    grip_stretch(model, curve, grip, std::span(out, curve.pieces));
                });
            }, "model"_a, "position"_a, "velocity"_a, "acceleration"_a,
             "(k,) the factors by which the pieces of a curve must be slowed down so that the grip transmits the load.")
        .def("peak", [](const Grip& grip, const DynamicTree& model, const Stack& position, const Stack& velocity,
                        const Stack& acceleration) {
                const TimedCurve curve = read_curve(model, position, velocity, acceleration);
                const Peak peak = without_gil([&] { return grip_peak(model, curve, grip); });
                return nb::make_tuple(peak.bound, peak.piece, peak.fraction);
            }, "model"_a, "position"_a, "velocity"_a, "acceleration"_a,
             "A bound of the largest share over a curve, and the piece and the fraction of it where it occurs.");
}

}  // namespace

void bind_timing(nb::module_& module) {
    bind_grip(module);
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
        .def("loads", &loads, "q"_a, "v"_a, "a"_a,
             "(N, 2, 6) force and moment about the origin of the tool joint, in its axes, that its own body needs for its "
             "motion and against gravity.")
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
