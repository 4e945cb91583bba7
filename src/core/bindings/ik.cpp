// The iterative methods of inverse kinematics.
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/variant.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <optional>
#include <stdexcept>
#include <string>

#include "algebra/singular_values.h"
#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "bindings/jacobians.h"
#include "ik/batch.h"
#include "ik/search.h"

namespace pinproof {
namespace {

using Doubles = std::vector<double>;

std::vector<JointRange> make_ranges(const Doubles& lower, const Doubles& upper, const std::vector<bool>& periodic,
                                    const std::vector<bool>& wraps, std::size_t dof) {
    require_size("lower", lower.size(), dof);
    require_size("upper", upper.size(), dof);
    require_size("periodic", periodic.size(), dof);
    require_size("wraps", wraps.size(), dof);
    std::vector<JointRange> ranges;
    for (std::size_t i = 0; i < dof; ++i) ranges.push_back({lower[i], upper[i], periodic[i], wraps[i]});
    return ranges;
}

Goal make_goal(const std::string& kind, double gain, Doubles posture, Doubles weight) {
    Goal goal;
    goal.kind = kind == "posture"          ? Goal::Kind::posture
                : kind == "near"           ? Goal::Kind::near
                : kind == "manipulability" ? Goal::Kind::manipulability
                                           : throw std::invalid_argument("unknown kind of goal: " + kind);
    goal.gain = gain;
    goal.posture = std::move(posture);
    goal.weight = std::move(weight);
    return goal;
}

// The goal, which must suit the arm; without one, the goal that does not exist.
Goal checked_goal(const std::optional<Goal>& goal, std::size_t dof) {
    if (!goal) return {};
    require_size("the posture of the goal", goal->posture.size(), dof);
    require_size("the weight of the goal", goal->weight.size(), dof);
    return *goal;
}

void check_seeds(const Seeds& seeds, std::size_t dof) { require_size("a seed", seeds.dof(), dof); }

void require_target(const double* matrix) {
    for (int i = 0; i < 12; ++i)
        if (!std::isfinite(matrix[i])) throw std::invalid_argument("the target holds a number that is not finite");
}

// The search for one target, with the engine that makes its attempts.
class OwningSearch {
  public:
    OwningSearch(const IkSolver& solver, const Seeds& seeds, const std::optional<Goal>& goal, const Matrix& target,
                 const Vector& q0)
        : engine_(solver), search_(solver, seeds, checked_goal(goal, solver.chain.dof)) {
        check_seeds(seeds, solver.chain.dof);
        require_size("target", target.shape(0) == 4 ? target.shape(1) : 0, 4);
        require_target(target.data());
        require_size("q0", q0.shape(0), solver.chain.dof);
        search_.begin(read_transform(target.data()), q0.data());
    }

    Candidate next(long long count, bool polish) { return engine_.next(search_, count, polish); }

  private:
    SearchEngine engine_;
    Search search_;
};

nb::tuple solve_batch_of(const IkSolver& solver, const Stack& targets, const Matrix& q0, const Seeds& seeds,
                         const std::optional<Goal>& goal, long long count, std::size_t threads) {
    const std::size_t n = solver.chain.dof, rows = targets.shape(0);
    check_seeds(seeds, n);
    require_size("a target", targets.shape(1) == 4 ? targets.shape(2) : 0, 4);
    require_size("q0", q0.shape(0), rows);
    require_size("a row of q0", q0.shape(1), n);
    const Goal checked = checked_goal(goal, n);
    auto q = new_array({rows, n});
    auto position = new_array({rows}), orientation = new_array({rows});
    auto fulfils = new_array<bool>({rows});
    auto iterations = new_array<std::int64_t>({rows}), attempts = new_array<std::int64_t>({rows});
    {
        nb::gil_scoped_release release;
        solve_batch(solver, seeds, checked, targets.data(), q0.data(), rows, count, threads,
                    {q.data, position.data, orientation.data, fulfils.data, iterations.data, attempts.data});
    }
    return nb::make_tuple(nb::cast(q.array), nb::cast(position.array), nb::cast(orientation.array),
                          nb::cast(fulfils.array), nb::cast(iterations.array), nb::cast(attempts.array));
}

// The indices of the seeds, sorted by their distance in pose from a target.
std::vector<std::size_t> nearest_seeds(const Seeds& seeds, const Task& task, const Matrix& target) {
    require_size("target", target.shape(0) == 4 ? target.shape(1) : 0, 4);
    std::vector<float> distances;
    seeds.measure(task, read_transform(target.data()), distances);
    std::vector<std::size_t> order(distances.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(), [&](auto a, auto b) { return distances[a] < distances[b]; });
    return order;
}

nb::object measure_batch(const Task& task, const Stack& targets, const Stack& poses) {
    const std::size_t rows = targets.shape(0);
    require_size("poses", poses.shape(0), rows);
    require_size("a target", targets.shape(1) == 4 ? targets.shape(2) : 0, 4);
    require_size("a pose", poses.shape(1) == 4 ? poses.shape(2) : 0, 4);
    auto errors = new_array({rows, 2});
    {
        nb::gil_scoped_release release;
        for (std::size_t i = 0; i < rows; ++i) {
            const PoseError error =
                measure(task, read_transform(targets.data() + 16 * i), read_transform(poses.data() + 16 * i));
            errors.data[2 * i] = error.position;
            errors.data[2 * i + 1] = error.orientation;
        }
    }
    return nb::cast(errors.array);
}

nb::tuple residual_and_jacobian(const Task& task, const Matrix& target_from_tcp, const Matrix& in_target_axes) {
    require_size("target_from_tcp", target_from_tcp.shape(0) == 4 ? target_from_tcp.shape(1) : 0, 4);
    const Frame frame = frame_of(read_transform(target_from_tcp.data()));
    Jacobian jacobian = read_jacobian(in_target_axes);
    task.apply(frame, jacobian);
    const Twist r = task.residual(frame);
    return nb::make_tuple(array_of({r.linear[0], r.linear[1], r.linear[2], r.angular[0], r.angular[1], r.angular[2]}),
                          jacobian_array(jacobian));
}

nb::object goal_step_of(const Goal& goal, const Chain& chain, const Vector& q) {
    require_size("q", q.shape(0), chain.dof);
    checked_goal(goal, chain.dof);
    return array_of(GoalSteps(chain).at(goal, q.data()));
}

void bind_step_rules(nb::module_& module) {
    nb::class_<ClikStep>(module, "ClikStep", "The step of Clik.")
        .def(nb::init<double>(), nb::arg("damping"))
        .def_ro_static("GROWTH", &ClikStep::kGrowth)
        .def_ro_static("RELIEF", &ClikStep::kRelief)
        .def_ro_static("MOST_GROWTHS", &ClikStep::kMostGrowths)
        .def_ro_static("SMALLEST_DAMPING", &ClikStep::kSmallestDamping);
    nb::class_<SingularStep>(module, "SingularStep", "The steps of PseudoInverse and DampedLeastSquares.")
        .def(nb::init<double, double, double>(), nb::arg("cutoff"), nb::arg("damping"), nb::arg("region"))
        .def_ro_static("NOTHING", &SingularStep::kNothing);
    nb::class_<FabrikStep>(module, "FabrikStep", "The step of FABRIK.")
        .def(nb::init<ClikStep, double>(), nb::arg("end"), nb::arg("squared_handover"))
        .def_ro_static("HINGE_HALF_LENGTH", &FabrikStep::kHingeHalfLength)
        .def_ro_static("HOLD", &FabrikStep::kHold)
        .def_ro_static("HOLD_POSED", &FabrikStep::kHoldPosed)
        .def_ro_static("REACH", &FabrikStep::kReach)
        .def_ro_static("RELAX_HOLD", &FabrikStep::kRelaxHold)
        .def_ro_static("RELAX_REACH", &FabrikStep::kRelaxReach)
        .def_ro_static("BASE", &FabrikStep::kBase)
        .def_ro_static("AIM", &FabrikStep::kAim)
        .def_ro_static("WAIT", &FabrikStep::kWait)
        .def_ro_static("BEND", &FabrikStep::kBend)
        .def_ro_static("STILL", &FabrikStep::kStill)
        .def_ro_static("TINY", &FabrikStep::kTiny);
}

Vec3 read_vec3(const char* name, const Vector& v) {
    require_size(name, v.shape(0), 3);
    return {v(0), v(1), v(2)};
}

nb::object hinge_motion_of(const Vector& origin, const Vector& direction, bool prismatic, double value) {
    const Hinge hinge{read_vec3("origin", origin), read_vec3("direction", direction), prismatic};
    auto motion = new_array({4, 4});
    write_homogeneous(hinge_motion(hinge, value), motion.data);
    return nb::cast(motion.array);
}

nb::tuple hinge_fit(const Vector& origin, const Vector& direction, const Matrix& wanted, double point_weight,
                    const Vector& point, double direction_weight, const Vector& along) {
    require_size("wanted", wanted.shape(0) == 4 ? wanted.shape(1) : 0, 4);
    HingeFit fit({read_vec3("origin", origin), read_vec3("direction", direction)}, read_transform(wanted.data()));
    fit.add_point(point_weight, read_vec3("point", point));
    fit.add_direction(direction_weight, read_vec3("along", along));
    return nb::make_tuple(fit.angle(), fit.translation(point_weight));
}

// Parts that only tests call one by one.
void bind_parts(nb::module_& module) {
    nb::class_<JointRange>(module, "JointRange")
        .def(nb::init<double, double, bool, bool>(), nb::arg("lower"), nb::arg("upper"), nb::arg("periodic"),
             nb::arg("wraps"))
        .def("inside", &JointRange::inside)
        .def("nearest_winding", &JointRange::nearest_winding)
        .def("allowed_change", &allowed_change, nb::arg("value"), nb::arg("change"));
    module.def("hinge_motion", &hinge_motion_of, nb::arg("origin"), nb::arg("direction"), nb::arg("prismatic"),
               nb::arg("value"), "The motion (4, 4) by a value (rad or m) about, or along, a hinge.");
    module.def("hinge_fit", &hinge_fit, nb::arg("origin"), nb::arg("direction"), nb::arg("wanted"),
               nb::arg("point_weight"), nb::arg("point"), nb::arg("direction_weight"), nb::arg("along"),
               "The angle and the translation of a hinge that are closest to a wanted motion (4, 4).");
}

}  // namespace

void bind_ik(nb::module_& module) {
    bind_step_rules(module);
    bind_parts(module);

    nb::class_<Task>(module, "Task", "The coordinates of a target that count, with tolerances.")
        .def(nb::init<std::array<bool, 6>, double, double>(), nb::arg("coordinates"), nb::arg("position_tolerance"),
             nb::arg("orientation_tolerance"))
        .def("measure_batch", &measure_batch, nb::arg("targets"), nb::arg("poses"),
             "Distances (m) and angles (rad), (N, 2), of poses from targets, both (N, 4, 4).")
        .def("residual_and_jacobian", &residual_and_jacobian, nb::arg("target_from_tcp"), nb::arg("in_target_axes"));

    nb::class_<Goal>(module, "Goal", "A null-space goal.")
        .def(
            "__init__",
            [](Goal* self, const std::string& kind, double gain, Doubles posture, Doubles weight) {
                new (self) Goal(make_goal(kind, gain, std::move(posture), std::move(weight)));
            },
            nb::arg("kind"), nb::arg("gain"), nb::arg("posture"), nb::arg("weight"))
        .def("step", &goal_step_of, nb::arg("chain"), nb::arg("q"));

    nb::class_<Seeds>(module, "Seeds", "Starts of a search.")
        .def(
            "__init__",
            [](Seeds* self, const Chain& chain, const Matrix& configurations) {
                require_size("a configuration", configurations.shape(1), chain.dof);
                if (configurations.shape(0) == 0) throw std::invalid_argument("there must be at least one seed");
                new (self) Seeds(chain, configurations.data(), configurations.shape(0));
            },
            nb::arg("chain"), nb::arg("configurations"))
        .def("nearest", &nearest_seeds, nb::arg("task"), nb::arg("target"))
        .def("weights", [](const Seeds& seeds, const Task& task) {
            const Seeds::Weights weights = seeds.weights(task);
            return std::make_tuple(weights.distance, weights.spin);
        });

    nb::class_<IkSolver>(module, "IkSolver", "An arm, a task and a method with its settings.")
        .def(
            "__init__",
            [](IkSolver* self, const Chain& chain, const Doubles& lower, const Doubles& upper,
               const std::vector<bool>& periodic, const std::vector<bool>& wraps, const Task& task,
               const StepRule& rule, int max_iterations, double max_step, double progress, int patience) {
                if (std::holds_alternative<FabrikStep>(rule) && chain.has_mimic_joints())
                    throw std::invalid_argument("FABRIK does not support mimic joints");
                require_count("max_iterations", max_iterations);
                require_count("patience", patience);
                new (self) IkSolver{chain,
                                    make_ranges(lower, upper, periodic, wraps, chain.dof),
                                    task,
                                    rule,
                                    max_iterations,
                                    max_step,
                                    {progress, patience}};
            },
            nb::arg("chain"), nb::kw_only(), nb::arg("lower"), nb::arg("upper"), nb::arg("periodic"), nb::arg("wraps"),
            nb::arg("task"), nb::arg("rule"), nb::arg("max_iterations"), nb::arg("max_step"), nb::arg("progress"),
            nb::arg("patience"))
        .def("solve_batch", &solve_batch_of, nb::arg("targets"), nb::arg("q0"), nb::arg("seeds"),
             nb::arg("goal").none(), nb::arg("count"), nb::arg("threads"),
             "q, position and orientation errors, whether each fulfils the task, iterations and attempts.")
        .def_ro_static("SATURATION", &IkSolver::kSaturation)
        .def_ro_static("SMALLEST_STEP", &IkSolver::kSmallestStep)
        .def_ro_static("GOAL_CONVERGED", &IkSolver::kGoalConverged)
        .def_prop_ro_static("GOAL_STEPS", [](nb::handle) { return Progress::kGoalSteps; });

    nb::class_<Candidate>(module, "Candidate", "The result of a series of attempts.")
        .def_prop_ro("q", [](const Candidate& found) { return read_only_array_of(found.q); })
        .def_prop_ro("position_error", [](const Candidate& found) { return found.error.position; })
        .def_prop_ro("orientation_error", [](const Candidate& found) { return found.error.orientation; })
        .def_ro("fulfils", &Candidate::fulfils)
        .def_ro("iterations", &Candidate::iterations)
        .def_ro("attempts", &Candidate::attempts);

    nb::class_<OwningSearch>(module, "Search", "The attempts for one target.")
        .def(nb::init<const IkSolver&, const Seeds&, const std::optional<Goal>&, const Matrix&, const Vector&>(),
             nb::arg("solver"), nb::arg("seeds"), nb::arg("goal").none(), nb::arg("target"), nb::arg("q0"),
             nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>())
        .def_prop_ro_static("POLISH_PROGRESS", [](nb::handle) { return Search::kPolish.progress; })
        .def_prop_ro_static("POLISH_PATIENCE", [](nb::handle) { return Search::kPolish.patience; })
        .def("next", &OwningSearch::next, nb::arg("count"), nb::arg("polish"), nb::call_guard<nb::gil_scoped_release>(),
             "Make attempts until one satisfies the task, or until there are `count` for this target.");
}

}  // namespace pinproof
