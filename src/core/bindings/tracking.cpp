// Tracking of pose sequences, and joint curves along routes of the tcp.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <optional>
#include <tuple>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "bindings/jacobians.h"
#include "ik/box_step.h"
#include "ik/tracker.h"
#include "planning/route_follower.h"

namespace pinproof {
namespace {

using Doubles = std::vector<double>;

TrackingTask checked(TrackingTask tracking) {
    const std::size_t n = tracking.chain.dof;
    require_size("lower", tracking.lower.size(), n);
    require_size("upper", tracking.upper.size(), n);
    require_size("speed", tracking.speed.size(), n);
    if (tracking.goal.exists()) {
        require_size("the posture of the goal", tracking.goal.posture.size(), n);
        require_size("the weight of the goal", tracking.goal.weight.size(), n);
    }
    return tracking;
}

// A tracker with the task that it refers to.
class OwningTracker {
  public:
    OwningTracker(TrackingTask tracking, const Doubles& q0)
        : tracking_(checked(std::move(tracking))), tracker_(tracking_, q0) {
        require_size("q0", q0.size(), tracking_.chain.dof);
    }
    OwningTracker(const OwningTracker&) = delete;

    nb::object track(const Stack& poses, const Vector& durations) {
        const std::size_t rows = poses.shape(0), n = tracking_.chain.dof;
        require_size("a pose", poses.shape(1) == 4 ? poses.shape(2) : 0, 4);
        require_size("durations", durations.shape(0), rows);
        auto configurations = new_array({rows, n});
        {
            nb::gil_scoped_release release;
            for (std::size_t row = 0; row < rows; ++row) {
                tracker_.step(read_transform(poses.data() + 16 * row), durations(row));
                std::copy(tracker_.q().begin(), tracker_.q().end(), configurations.data + n * row);
            }
        }
        return nb::cast(configurations.array);
    }

    nb::object q() const { return array_of(tracker_.q()); }

  private:
    TrackingTask tracking_;
    Tracker tracker_;
};

nb::tuple box_step(const Matrix& a, const Vector& pull, double shift, Doubles lower, Doubles upper) {
    const Jacobian columns = read_jacobian(a);
    require_size("pull", pull.shape(0), 6);
    require_size("lower", lower.size(), columns.size());
    require_size("upper", upper.size(), columns.size());
    BoxStep step(columns.size());
    step.lower = std::move(lower);
    step.upper = std::move(upper);
    const double gain =
        step.solve(shift, columns, {Double4{pull(0), pull(1), pull(2), 0.0}, Double4{pull(3), pull(4), pull(5), 0.0}});
    Doubles held;
    for (BoxStep::Held one : step.held()) held.push_back(static_cast<double>(one));
    return nb::make_tuple(array_of(step.step()), array_of(held), gain);
}

std::vector<RoutePiece> read_pieces(const Stack& poses, const Stack& directions, const Stack& coefficients,
                                    const Vector& borders, const Matrix& derivatives) {
    const std::size_t count = poses.shape(0);
    if (count == 0) throw std::invalid_argument("a route has no pieces");
    require_size("poses", poses.size(), 16 * count);
    require_size("directions", directions.size(), 12 * count);
    require_size("coefficients", coefficients.size(), 2 * RoutePiece::kCoefficients * count);
    require_size("borders", borders.shape(0), count + 1);
    require_size("derivatives", derivatives.size(), 3 * count);
    require_finite("poses", poses.data(), poses.size());
    require_finite("directions", directions.data(), directions.size());
    require_finite("coefficients", coefficients.data(), coefficients.size());
    require_finite("borders", borders.data(), borders.size());
    std::vector<RoutePiece> pieces(count);
    for (std::size_t i = 0; i < count; ++i) {
        RoutePiece& piece = pieces[i];
        piece.pose = read_transform(poses.data() + 16 * i);
        const double* d = directions.data() + 12 * i;
        piece.into = {{d[0], d[1], d[2]}, {d[3], d[4], d[5]}};
        piece.out = {{d[6], d[7], d[8]}, {d[9], d[10], d[11]}};
        const double* c = coefficients.data() + 2 * RoutePiece::kCoefficients * i;
        std::copy_n(c, RoutePiece::kCoefficients, piece.a.begin());
        std::copy_n(c + RoutePiece::kCoefficients, RoutePiece::kCoefficients, piece.b.begin());
        piece.start = borders(i);
        piece.end = borders(i + 1);
        if (!(piece.start <= piece.end)) throw std::invalid_argument("the borders of a route must not decrease");
        piece.derivatives = {derivatives(i, 0), derivatives(i, 1), derivatives(i, 2)};
    }
    return pieces;
}

void require_increasing(const Vector& knots) {
    require_finite("knots", knots.data(), knots.shape(0));
    if (knots.shape(0) == 0) throw std::invalid_argument("there are no knots");
    for (std::size_t i = 0; i + 1 < knots.shape(0); ++i)
        if (!(knots(i) < knots(i + 1))) throw std::invalid_argument("knots must increase");
}

nb::object rows(const Doubles& values, std::size_t n) {
    auto out = new_array({values.size() / n, n});
    std::copy(values.begin(), values.end(), out.data);
    return nb::cast(out.array);
}

void bind_routes(nb::module_& module) {
    nb::class_<Route>(module, "Route", "A route of the tcp in space.")
        .def(
            "__init__",
            [](Route* self, const Stack& poses, const Stack& directions, const Stack& coefficients,
               const Vector& borders, const Matrix& derivatives) {
                new (self) Route{read_pieces(poses, directions, coefficients, borders, derivatives)};
            },
            nb::arg("poses"), nb::arg("directions"), nb::arg("coefficients"), nb::arg("borders"),
            nb::arg("derivatives"))
        .def(
            "poses",
            [](const Route& self, const Vector& s) {
                auto out = new_array({s.shape(0), 4, 4});
                for (std::size_t i = 0; i < s.shape(0); ++i) write_homogeneous(self.pose(s(i)), out.data + 16 * i);
                return nb::cast(out.array);
            },
            nb::arg("s"), "(N, 4, 4) base_from_tcp at parameters (N,).");
    nb::class_<JointCurve>(module, "JointCurve", "A joint curve along a route: a spline, and why it stops.")
        .def_prop_ro("knots", [](const JointCurve& self) { return array_of(self.knots); })
        .def_prop_ro("q", [](const JointCurve& self) { return rows(self.q, self.q.size() / self.knots.size()); })
        .def_prop_ro("slopes",
                     [](const JointCurve& self) { return rows(self.slopes, self.q.size() / self.knots.size()); })
        .def_ro("deviation", &JointCurve::deviation)
        .def_ro("rotation_deviation", &JointCurve::rotation_deviation)
        .def_prop_ro(
            "stopped_by_pose", [](const JointCurve& self) { return self.stop == RouteStop::kPose; },
            "Whether it stops because the pose at `at` cannot be solved from the configuration `before`.")
        .def_prop_ro(
            "stopped_by_deviation", [](const JointCurve& self) { return self.stop == RouteStop::kDeviation; },
            "Whether it stops because of the deviation there, or because it may leave the limits by `outside` (n,).")
        .def_ro("at", &JointCurve::at)
        .def_prop_ro("before", [](const JointCurve& self) { return array_of(self.before); })
        .def_prop_ro(
            "reached", [](const JointCurve& self) { return array_of(self.reached); },
            "(n,) the configuration closest to the pose at `at`.")
        .def_ro("deviation_there", &JointCurve::deviation_there)
        .def_ro("rotation_deviation_there", &JointCurve::rotation_deviation_there)
        .def_prop_ro("outside", [](const JointCurve& self) { return array_of(self.outside); });
    nb::class_<RouteFollower>(module, "RouteFollower", "Follows routes with a joint curve on one IK branch.")
        .def(
            "__init__",
            [](RouteFollower* self, const Chain& chain, Doubles lower, Doubles upper, Doubles tracked_lower,
               Doubles tracked_upper, const Task& task, double max_joint_step, double deviation,
               double rotation_deviation) {
                const std::size_t n = chain.dof;
                require_size("lower", lower.size(), n);
                require_size("upper", upper.size(), n);
                require_positive("max_joint_step", max_joint_step);
                require_positive("deviation", deviation);
                require_positive("rotation_deviation", rotation_deviation);
                TrackingTask tracking = checked({chain, std::move(tracked_lower), std::move(tracked_upper),
                                                 Doubles(n, max_joint_step), task, Goal{}});
                new (self) RouteFollower(std::move(tracking), {deviation, rotation_deviation, max_joint_step},
                                         std::move(lower), std::move(upper));
            },
            nb::kw_only(), nb::arg("chain"), nb::arg("lower"), nb::arg("upper"), nb::arg("tracked_lower"),
            nb::arg("tracked_upper"), nb::arg("task"), nb::arg("max_joint_step"), nb::arg("deviation"),
            nb::arg("rotation_deviation"))
        .def(
            "follow",
            [](const RouteFollower& self, const Route& route, const Vector& knots, const Vector& first) {
                require_increasing(knots);
                require_size("first", first.shape(0), self.dof());
                require_finite("first", first.data(), first.shape(0));
                if (const std::size_t joint = self.outside({first.data(), first.size()}); joint < self.dof())
                    throw std::invalid_argument("first is outside the limits of joint " + std::to_string(joint));
                nb::gil_scoped_release release;
                return self.follow(route, {knots.data(), knots.data() + knots.size()},
                                   {first.data(), first.data() + first.size()});
            },
            nb::arg("route"), nb::arg("knots"), nb::arg("first"))
        .def(
            "deviations",
            [](const RouteFollower& self, const Route& route, const Vector& knots, const Stack& control) {
                require_increasing(knots);
                require_size("pieces", control.shape(0), knots.shape(0) - 1);
                require_size("control points of a cubic", control.shape(1), 4);
                require_size("a control point", control.shape(2), self.dof());
                const auto found =
                    self.deviations(route, {knots.data(), knots.size()}, {control.data(), control.size()});
                auto out = new_array({found.size(), 2});
                for (std::size_t i = 0; i < found.size(); ++i) {
                    out.data[2 * i] = found[i].position;
                    out.data[2 * i + 1] = found[i].orientation;
                }
                return nb::cast(out.array);
            },
            nb::arg("route"), nb::arg("knots"), nb::arg("control"),
            "(k, 2) upper bounds (m, rad) of the deviation on each piece of a cubic curve.");
    module.def(
        "spline_slopes",
        [](const Vector& knots, const Matrix& points) {
            require_increasing(knots);
            require_size("points", points.shape(0), knots.shape(0));
            if (points.shape(1) == 0) throw std::invalid_argument("points have no coordinates");
            return rows(spline_slopes({knots.data(), knots.size()}, {points.data(), points.size()}, points.shape(1)),
                        points.shape(1));
        },
        nb::arg("knots"), nb::arg("points"), "(k, n) the slopes of the cubic spline through points (k, n).");
}

}  // namespace

void bind_tracking(nb::module_& module) {
    bind_routes(module);
    nb::class_<OwningTracker>(module, "Tracker", "Tracks poses cycle by cycle within position and speed limits.")
        .def(
            "__init__",
            [](OwningTracker* self, const Chain& chain, Doubles lower, Doubles upper, Doubles speed, const Task& task,
               const std::optional<Goal>& goal, const Doubles& q0) {
                new (self) OwningTracker(
                    {chain, std::move(lower), std::move(upper), std::move(speed), task, goal.value_or(Goal{})}, q0);
            },
            nb::arg("chain"), nb::arg("lower"), nb::arg("upper"), nb::arg("speed"), nb::arg("task"),
            nb::arg("goal").none(), nb::arg("q0"))
        .def("track", &OwningTracker::track, nb::arg("poses"), nb::arg("durations"),
             "The next configurations (N, n) for poses (N, 4, 4) in cycles of these durations (N,) in seconds.")
        .def_prop_ro("q", &OwningTracker::q, "(n,) the current configuration.");
    module.def("box_step", &box_step, nb::arg("a"), nb::arg("pull"), nb::arg("shift"), nb::arg("lower"),
               nb::arg("upper"), "The bounded step, which joints are at a bound (-1 or 1), and the gain.");
}

}  // namespace pinproof
