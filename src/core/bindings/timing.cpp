// Time parametrisation of paths.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <stdexcept>
#include <tuple>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "timing/path_speed.h"

namespace pinproof {

void bind_timing(nb::module_& module) {
    module.def(
        "fastest_speeds",
        [](const Stack& slope, const Stack& curvature, const Vector& step, const Vector& ceiling,
           const Matrix& acceleration, double start, double end) {
            const std::size_t steps = step.shape(0), dof = slope.shape(2);
            require_size("slope", slope.size(), 2 * steps * dof);
            require_size("curvature", curvature.size(), 2 * steps * dof);
            require_size("ceiling", ceiling.shape(0), steps + 1);
            require_size("acceleration", acceleration.size(), steps * dof);
            const SpeedProblem problem{dof,
                                       {slope.data(), slope.size()},
                                       {curvature.data(), curvature.size()},
                                       {step.data(), steps},
                                       {ceiling.data(), steps + 1},
                                       {acceleration.data(), acceleration.size()},
                                       start,
                                       end};
            auto x = new_array({steps + 1});
            const auto stuck = fastest_speeds(problem, {x.data, steps + 1});
            return std::tuple(nb::cast(x.array), stuck);
        },
        nb::arg("slope"), nb::arg("curvature"), nb::arg("step"), nb::arg("ceiling"), nb::arg("acceleration"),
        nb::arg("start"), nb::arg("end"),
        "(x, node): x = s'^2 (N + 1,) at the nodes of a grid, and the node from which the path cannot be driven or "
        "None.");
}

}  // namespace pinproof
