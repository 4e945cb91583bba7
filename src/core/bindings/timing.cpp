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
}

}  // namespace pinproof
