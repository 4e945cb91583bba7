// Tracking of pose sequences, and joint curves along routes of the tcp.
#include <optional>

#include "bindings/arms.h"
#include "bindings/structs.h"
#include "ik/box_descent.h"
#include "ik/tracker.h"
#include "planning/route_follower.h"

namespace pinproof {
namespace {

// A tracker with the task that it refers to.
class OwningTracker {
  public:
    OwningTracker(const Chain& chain, const Vector& lower, const Vector& upper, const Vector& speed, const Task& task,
                  const std::optional<Goal>& goal, const Vector& q0)
        : tracking_{chain, list_of(shaped("lower", lower, {chain.dof})), list_of(shaped("upper", upper, {chain.dof})),
                    list_of(shaped("speed", speed, {chain.dof})), task, goal_for(goal, chain.dof)},
          tracker_(tracking_, list_of(shaped("q0", q0, {chain.dof}))) {}
    OwningTracker(const OwningTracker&) = delete;

    NewArray track(const Stack& poses, const Vector& durations) {
        const std::size_t rows = poses.shape(0), n = tracking_.chain.dof;
        const double* targets = shaped("poses", poses, {kAny, 4, 4}).data();
        const double* cycles = shaped("durations", durations, {rows}).data();
        return filled<double>({rows, n}, [&](double* out) {
            nb::gil_scoped_release release;
            for (std::size_t row = 0; row < rows; ++row) {
                tracker_.step(read_transform(targets + 16 * row), cycles[row]);
                out = std::ranges::copy(tracker_.q(), out).out;
            }
        });
    }

    const Doubles& q() const { return tracker_.q(); }

  private:
    TrackingTask tracking_;
    Tracker tracker_;
};

nb::tuple box_step(const Matrix& a, const Vector& pull, double shift, const Vector& lower, const Vector& upper) {
    const Jacobian columns = read_jacobian("a", a);
    const auto p = shaped("pull", pull, {6});
    BoxStep step(columns.size());
    step.lower = list_of(shaped("lower", lower, {columns.size()}));
    step.upper = list_of(shaped("upper", upper, {columns.size()}));
    const double gain = step.solve(shift, columns, {Double4{p[0], p[1], p[2], 0.0}, Double4{p[3], p[4], p[5], 0.0}});
    return nb::make_tuple(array_of(step.step()), column<double>(step.held(), std::identity{}), gain);
}

void check_route(const Route& route) {
    if (route.pieces.empty()) refuse("a route has no pieces");
    double end = route.pieces[0].start;
    for (const RoutePiece& piece : route.pieces) {
        if (piece.start != end || !(piece.start <= piece.end)) refuse("the pieces of a route must follow one another");
        end = piece.end;
    }
}

void bind_routes(nb::module_& module) {
    bind_struct<RouteDirection>(module, "RouteDirection", "A translation and a rotation vector per metre.", unchecked,
                                member("translation", &RouteDirection::translation),
                                member("rotation", &RouteDirection::rotation));
    bind_struct<RoutePiece>(module, "RoutePiece",
                            "A piece of a route: a pose, the incoming and the outgoing direction, the coefficients "
                            "(6,) of both, the parameters of the route at its ends, and the sizes of its derivatives.",
                            unchecked, member("pose", &RoutePiece::pose), member("into", &RoutePiece::into),
                            member("out", &RoutePiece::out), member("a", &RoutePiece::a), member("b", &RoutePiece::b),
                            member("start", &RoutePiece::start), member("end", &RoutePiece::end),
                            limit("acceleration", &RoutePiece::acceleration), limit("turn", &RoutePiece::turn),
                            limit("turn_change", &RoutePiece::turn_change));
    bind_struct<Route>(module, "Route", "A route of the tcp in space.", check_route, member("pieces", &Route::pieces))
        .def("poses", [](const Route& self, const Vector& s) {
                return filled<double>({s.shape(0), 4, 4}, [&](double* out) {
                    for (std::size_t i = 0; i < s.shape(0); ++i) write_homogeneous(self.pose(s(i)), out + 16 * i);
                });
            }, "s"_a, "(N, 4, 4) base_from_tcp at parameters (N,).");
    using Curve = JointCurve;
    bind_result<Curve>(
        module, "JointCurve",
        "A joint curve along a route: a spline with q (k, n) and slopes (k, n), and why it stops. By pose: the pose at "
        "`at` cannot be solved from the configuration `before`; the closest one is `reached`. By deviation: because of the "
        "deviation there, or because it may leave the limits by `outside` (n,).",
        "knots", &Curve::knots, "deviation", &Curve::deviation, "rotation_deviation", &Curve::rotation_deviation, "at",
        &Curve::at, "before", &Curve::before, "reached", &Curve::reached, "deviation_there", &Curve::deviation_there,
        "rotation_deviation_there", &Curve::rotation_deviation_there, "outside", &Curve::outside,
        "q", [](const Curve& self) { return rows_of(self.q, self.q.size() / self.knots.size()); },
        "slopes", [](const Curve& self) { return rows_of(self.slopes, self.q.size() / self.knots.size()); },
        "stopped_by_pose", [](const Curve& self) { return self.stop == RouteStop::kPose; },
        "stopped_by_deviation", [](const Curve& self) { return self.stop == RouteStop::kDeviation; });
    nb::class_<RouteFollower>(module, "RouteFollower", "Follows routes with a joint curve on one IK branch.")
        .def(nb::new_([](const Chain& chain, const Vector& lower, const Vector& upper, const Vector& tracked_lower,
                         const Vector& tracked_upper, const Task& task, double max_joint_step, double deviation,
                         double rotation_deviation) {
                 const auto list = [&](const char* name, const Vector& limits) {
                     return list_of(shaped(name, limits, {chain.dof}));
                 };
                 TrackingTask tracking{chain, list("tracked_lower", tracked_lower),
                                       list("tracked_upper", tracked_upper),
                                       Doubles(chain.dof, positive("max_joint_step", max_joint_step)), task, {}};
                 return RouteFollower(std::move(tracking),
                                      {positive("deviation", deviation),
                                       positive("rotation_deviation", rotation_deviation), max_joint_step},
                                      list("lower", lower), list("upper", upper));
             }), nb::kw_only(), "chain"_a, "lower"_a, "upper"_a, "tracked_lower"_a, "tracked_upper"_a, "task"_a,
             "max_joint_step"_a, "deviation"_a, "rotation_deviation"_a)
        .def("follow", [](const RouteFollower& self, const Route& route, const Vector& knots, const Vector& first) {
                const auto start = finite("first", first, {self.dof()});
                if (const std::size_t joint = self.outside(start); joint < self.dof())
                    refuse("first is outside the limits of joint " + std::to_string(joint));
                Doubles parameters = list_of(knots_of(knots));
                nb::gil_scoped_release release;
                return self.follow(route, std::move(parameters), list_of(start));
            }, "route"_a, "knots"_a, "first"_a)
        .def(
            "deviations",
            [](const RouteFollower& self, const Route& route, const Vector& knots, const Stack& control) {
                const auto parameters = knots_of(knots);
                const auto numbers = shaped("control", control, {knots.shape(0) - 1, 4, self.dof()});
                const auto deviations = self.deviations(route, parameters, numbers);
                return table(deviations, &RouteDeviation::position, &RouteDeviation::orientation);
            }, "route"_a, "knots"_a, "control"_a,
            "(k, 2) upper bounds (m, rad) of the deviation on each piece of a cubic curve.");
    module.def("spline_slopes", [](const Vector& knots, const Matrix& points) {
            const std::size_t n = points.shape(1);
            const auto parameters = knots_of(knots);
            const auto numbers = shaped("points", points, {parameters.size(), kSome});
            return rows_of(spline_slopes(parameters, numbers, n), n);
        }, "knots"_a, "points"_a, "(k, n) the slopes of the cubic spline through points (k, n).");
}

}  // namespace

void bind_tracking(nb::module_& module) {
    bind_routes(module);
    nb::class_<OwningTracker>(module, "Tracker", "Tracks poses cycle by cycle within position and speed limits.")
        .def(nb::init<const Chain&, const Vector&, const Vector&, const Vector&, const Task&,
                      const std::optional<Goal>&, const Vector&>(),
             "chain"_a, "lower"_a, "upper"_a, "speed"_a, "task"_a, "goal"_a.none(), "q0"_a)
        .def("track", &OwningTracker::track, "poses"_a, "durations"_a,
             "The next configurations (N, n) for poses (N, 4, 4) in cycles of these durations (N,) in seconds.")
        .def_prop_ro("q", [](const OwningTracker& self) { return array_of(self.q()); }, "(n,) the present one.");
    module.def("box_step", &box_step, "a"_a, "pull"_a, "shift"_a, "lower"_a, "upper"_a,
               "The bounded step, which joints are at a bound (-1 or 1), and the gain.");
}

}  // namespace pinproof
