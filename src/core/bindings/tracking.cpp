// Tracking of pose sequences.
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

}  // namespace

void bind_tracking(nb::module_& module) {
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
