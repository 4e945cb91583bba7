// Time parametrisation of paths.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include <optional>
#include <stdexcept>
#include <tuple>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "timing/path_speed.h"
#include "timing/time_path.h"

namespace pinproof {
namespace {

template <class Array>
std::span<const double> span_of(const Array& array) {
    return {array.data(), array.size()};
}

template <class Array>
std::vector<double> vector_of(const Array& array) {
    return {array.data(), array.data() + array.size()};
}

// Rows of n numbers as an array (N, n).
nb::object rows_of(std::span<const double> values, std::size_t columns) {
    auto array = new_array({values.size() / columns, columns});
    std::copy(values.begin(), values.end(), array.data);
    return nb::cast(array.array);
}

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

RateLimits limits_of(const Vector& velocity, const Vector& acceleration, const std::optional<Vector>& jerk) {
    const std::size_t n = velocity.shape(0);
    require_size("acceleration", acceleration.shape(0), n);
    if (jerk) require_size("jerk", jerk->shape(0), n);
    RateLimits limits{vector_of(velocity), vector_of(acceleration), {}};
    if (jerk) limits.jerk = vector_of(*jerk);
    for (const auto* rates : {&limits.velocity, &limits.acceleration, &limits.jerk})
        for (double rate : *rates) require_positive("a limit", rate);
    return limits;
}

// The limits of Python's `rows(q, slope, curvature)`.
ConstraintRows called(const nb::callable& rows, std::size_t joints, std::span<const double> q,
                      std::span<const double> slope, std::span<const double> curvature) {
    const auto result = nb::cast<std::tuple<Matrix, Matrix, Matrix, Matrix>>(
        rows(rows_of(q, joints), rows_of(slope, joints), rows_of(curvature, joints)));
    const auto& [alpha, beta, gamma, bound] = result;
    const std::size_t columns = alpha.shape(1), size = q.size() / joints * columns;
    require_size("alpha", alpha.size(), size);
    require_size("beta", beta.size(), size);
    require_size("gamma", gamma.size(), size);
    require_size("bound", bound.size(), size);
    return {columns, vector_of(alpha), vector_of(beta), vector_of(gamma), vector_of(bound)};
}

nb::tuple timed(const Vector& knots, const Stack& control, const std::optional<Vector>& stops, const Vector& velocity,
                const Vector& acceleration, const std::optional<Vector>& jerk, const Vector& start_velocity,
                const Vector& end_velocity, double image_tolerance, double rate_tolerance, double longest,
                const std::optional<nb::callable>& rows, const std::optional<nb::callable>& excess) {
    const std::size_t n = control.shape(2), pieces = control.shape(0), points = control.shape(1);
    if (n == 0 || pieces == 0 || points < 1 || points > TimedPath::kMaxDegree + 1)
        throw std::invalid_argument("a path needs joints, pieces, and pieces of a degree up to " +
                                    std::to_string(TimedPath::kMaxDegree));
    require_size("knots", knots.shape(0), pieces + 1);
    require_size("velocity", velocity.shape(0), n);
    require_size("start_velocity", start_velocity.shape(0), n);
    require_size("end_velocity", end_velocity.shape(0), n);
    require_finite("knots", knots.data(), knots.size());
    require_finite("control", control.data(), control.size());
    require_finite("start_velocity", start_velocity.data(), n);
    require_finite("end_velocity", end_velocity.data(), n);
    require_positive("image_tolerance", image_tolerance);
    for (std::size_t k = 0; k < pieces; ++k)
        if (!(knots(k) < knots(k + 1))) throw std::invalid_argument("knots must increase");
    if (!moves(n, span_of(control))) throw std::invalid_argument("the path has length 0");
    if (excess.has_value() != rows.has_value()) throw std::invalid_argument("rows and excess belong together");
    const RateLimits limits = limits_of(velocity, acceleration, jerk);
    std::vector<char> flags;
    if (stops) {
        require_size("stops", stops->shape(0), pieces + 1);
        for (std::size_t k = 0; k <= pieces; ++k) flags.push_back((*stops)(k) != 0.0);
    } else {
        flags = tangent_jumps(n, span_of(knots), span_of(control));
    }
    const TimedPath path(n, span_of(knots), span_of(control), flags, limits);
    TimingTask task{path, limits, vector_of(start_velocity), vector_of(end_velocity), image_tolerance, rate_tolerance,
                    longest, {}, {}};
    TimedMotion motion;
    if (rows) {
        task.rows = [&](auto q, auto slope, auto curvature) { return called(*rows, n, q, slope, curvature); };
        task.excess = [&](const HermiteCurve& curve) {
            const auto factors = nb::cast<Vector>((*excess)(
                array_of(curve.times), rows_of(curve.q, n), rows_of(curve.velocity, n),
                curve.quintic() ? rows_of(curve.acceleration, n) : nb::none()));
            require_size("excess", factors.shape(0), curve.pieces());
            return vector_of(factors);
        };
        motion = time_path(task);
    } else {
        nb::gil_scoped_release release;
        motion = time_path(task);
    }
    const HermiteCurve& curve = motion.curve;
    nb::object none = nb::none();
    return nb::make_tuple(name_of(motion.status), array_of(curve.times), rows_of(curve.q, n), rows_of(curve.velocity, n),
                          curve.quintic() ? rows_of(curve.acceleration, n) : none, motion.deviation, motion.excess);
}

}  // namespace

void bind_timing(nb::module_& module) {
    module.def(
        "fastest_speeds",
        [](const Stack& alpha, const Stack& beta, const Stack& gamma, const Stack& bound, const Vector& step,
           const Vector& ceiling, double start, double end) {
            const std::size_t steps = step.shape(0), rows = alpha.shape(2), count = 2 * steps * rows;
            require_size("alpha", alpha.size(), count);
            require_size("beta", beta.size(), count);
            require_size("gamma", gamma.size(), count);
            require_size("bound", bound.size(), count);
            require_size("ceiling", ceiling.shape(0), steps + 1);
            const SpeedProblem problem{rows,
                                       {alpha.data(), count},
                                       {beta.data(), count},
                                       {gamma.data(), count},
                                       {bound.data(), count},
                                       {step.data(), steps},
                                       {ceiling.data(), steps + 1},
                                       start,
                                       end};
            auto x = new_array({steps + 1});
            const auto stuck = fastest_speeds(problem, {x.data, steps + 1});
            return std::tuple(nb::cast(x.array), stuck);
        },
        nb::arg("alpha"), nb::arg("beta"), nb::arg("gamma"), nb::arg("bound"), nb::arg("step"), nb::arg("ceiling"),
        nb::arg("start"), nb::arg("end"),
        "(x, node): x = s'^2 (N + 1,) at the nodes of a grid, and the node from which the path cannot be driven or "
        "None.");
    module.def("time_path", &timed, nb::arg("knots"), nb::arg("control"), nb::arg("stops").none(), nb::arg("velocity"),
               nb::arg("acceleration"), nb::arg("jerk").none(), nb::arg("start_velocity"), nb::arg("end_velocity"),
               nb::arg("image_tolerance"), nb::arg("rate_tolerance"), nb::arg("longest"), nb::arg("rows").none(),
               nb::arg("excess").none(),
               "(status, times, q, velocities, accelerations or None, deviation, excess) of the fastest motion along "
               "pieces with control points (k, degree + 1, n). Without stops (k + 1,) it stops where the "
               "tangent jumps.");
    module.def(
        "corners",
        [](const Matrix& q) {
            if (q.shape(0) == 0 || q.shape(1) == 0) throw std::invalid_argument("q has no waypoint or no joint");
            require_finite("q", q.data(), q.size());
            const std::size_t n = q.shape(1);
            std::vector<double> result = corners(n, span_of(q));
            return rows_of(result, n);
        },
        nb::arg("q"), "The waypoints at which a motion along a polyline must stop.");
}

}  // namespace pinproof
