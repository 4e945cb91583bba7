// The iterative methods of inverse kinematics.
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/variant.h>

#include <numeric>
#include <optional>

#include "bindings/arms.h"
#include "bindings/structs.h"
#include "ik/batch.h"
#include "ik/search.h"

namespace pinproof {
namespace {

Goal make_goal(const std::string& kind, double gain, const Vector& posture, const Vector& weight) {
    Goal goal;
    if (kind == "posture") goal.kind = Goal::Kind::posture;
    else if (kind == "near") goal.kind = Goal::Kind::near;
    else if (kind == "manipulability") goal.kind = Goal::Kind::manipulability;
    else refuse("unknown kind of goal: " + kind);
    goal.gain = gain;
    goal.posture = list_of(shaped("posture", posture, {kAny}));
    goal.weight = list_of(shaped("weight", weight, {kAny}));
    return goal;
}

// The search for one target, with the engine that makes its attempts.
class OwningSearch {
  public:
    OwningSearch(const IkSolver& solver, const Seeds& seeds, const std::optional<Goal>& goal, const Matrix& target,
                 const Vector& q0)
        : engine_(solver), search_(solver, seeds, goal_for(goal, solver.chain.dof)) {
        require_size("a seed", seeds.dof(), solver.chain.dof);
        const double* start = shaped("q0", q0, {solver.chain.dof}).data();
        search_.begin(transform("target", target), start);
    }

    Candidate next(long long count, bool polish) { return engine_.next(search_, count, polish); }

  private:
    SearchEngine engine_;
    Search search_;
};

nb::tuple solve_batch_of(const IkSolver& solver, const Stack& targets, const Matrix& q0, const Seeds& seeds,
                         const std::optional<Goal>& goal, long long count, std::size_t threads) {
    const std::size_t n = solver.chain.dof, rows = targets.shape(0);
    require_size("a seed", seeds.dof(), n);
    const double* poses = shaped("targets", targets, {kAny, 4, 4}).data();
    const double* starts = shaped("q0", q0, {rows, n}).data();
    const Goal wanted = goal_for(goal, n);
    BatchResults out;
    const auto arrays = nb::make_tuple(filled({rows, n}, out.q), filled({rows}, out.position_error),
                                       filled({rows}, out.orientation_error), filled({rows}, out.fulfils),
                                       filled({rows}, out.iterations), filled({rows}, out.attempts));
    nb::gil_scoped_release release;
    solve_batch(solver, seeds, wanted, poses, starts, rows, count, threads, out);
    return arrays;
}

// The indices of the seeds, sorted by their distance in pose from a target.
std::vector<std::size_t> nearest_seeds(const Seeds& seeds, const Task& task, const Matrix& target) {
    std::vector<float> distances;
    seeds.measure(task, read_transform(shaped("target", target, {4, 4}).data()), distances);
    std::vector<std::size_t> order(distances.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::ranges::stable_sort(order, {}, [&](std::size_t i) { return distances[i]; });
    return order;
}

NewArray measure_batch(const Task& task, const Stack& targets, const Stack& poses) {
    const std::size_t rows = targets.shape(0);
    const double* from = shaped("targets", targets, {kAny, 4, 4}).data();
    const double* to = shaped("poses", poses, {rows, 4, 4}).data();
    std::vector<PoseError> errors;
    {
        nb::gil_scoped_release release;
        for (std::size_t i = 0; i < rows; ++i)
            errors.push_back(measure(task, read_transform(from + 16 * i), read_transform(to + 16 * i)));
    }
    return table(errors, &PoseError::position, &PoseError::orientation);
}

std::tuple<NewArray, NewArray> residual_and_jacobian(const Task& task, const Matrix& target_from_tcp,
                                                     const Matrix& in_target_axes) {
    const Frame frame = frame_of(transform("target_from_tcp", target_from_tcp));
    Jacobian jacobian = read_jacobian("in_target_axes", in_target_axes);
    task.apply(frame, jacobian);
    const auto [v, w] = task.residual(frame);
    return {array_of(std::array{v[0], v[1], v[2], w[0], w[1], w[2]}), jacobian_array(jacobian)};
}

}  // namespace

Goal goal_for(const std::optional<Goal>& goal, std::size_t dof) {
    if (!goal) return {};
    require_size("the posture of the goal", goal->posture.size(), dof);
    require_size("the weight of the goal", goal->weight.size(), dof);
    return *goal;
}

void bind_ik(nb::module_& module) {
    auto clik = nb::class_<ClikStep>(module, "ClikStep", "The step of Clik.").def(nb::init<double>(), "damping"_a);
    constants(clik, "GROWTH", ClikStep::kGrowth, "RELIEF", ClikStep::kRelief, "MOST_GROWTHS", ClikStep::kMostGrowths,
              "SMALLEST_DAMPING", ClikStep::kSmallestDamping);
    auto singular = nb::class_<SingularStep>(module, "SingularStep", "That of PseudoInverse and DampedLeastSquares.")
                        .def(nb::init<double, double, double>(), "cutoff"_a, "damping"_a, "region"_a);
    constants(singular, "NOTHING", SingularStep::kNothing);
    auto fabrik = nb::class_<FabrikStep>(module, "FabrikStep", "The step of FABRIK.")
                      .def(nb::init<ClikStep, double>(), "end"_a, "squared_handover"_a);
    constants(fabrik, "HINGE_HALF_LENGTH", FabrikStep::kHingeHalfLength, "HOLD", FabrikStep::kHold, "HOLD_POSED",
              FabrikStep::kHoldPosed, "REACH", FabrikStep::kReach, "RELAX_HOLD", FabrikStep::kRelaxHold, "RELAX_REACH",
              FabrikStep::kRelaxReach, "BASE", FabrikStep::kBase, "AIM", FabrikStep::kAim, "WAIT", FabrikStep::kWait,
              "BEND", FabrikStep::kBend, "STILL", FabrikStep::kStill, "TINY", FabrikStep::kTiny);

    bind_struct<JointRange>(module, "JointRange",
                            "The limits of a joint; periodic: q and q + 2 pi are the same pose; wraps: with a range of "
                            "at least 2 pi, so that a descent continues 2 pi away beyond a limit.",
                            unchecked, limit("lower", &JointRange::lower), limit("upper", &JointRange::upper),
                            member("periodic", &JointRange::periodic), member("wraps", &JointRange::wraps));

    nb::class_<Task>(module, "Task", "The coordinates of a target that count, with tolerances.")
        .def(nb::init<std::array<bool, 6>, double, double>(), "coordinates"_a, "position_tolerance"_a,
             "orientation_tolerance"_a)
        .def("measure_batch", &measure_batch, "targets"_a, "poses"_a,
             "Distances (m) and angles (rad), (N, 2), of poses from targets, both (N, 4, 4).")
        .def("residual_and_jacobian", &residual_and_jacobian, "target_from_tcp"_a, "in_target_axes"_a);

    nb::class_<Goal>(module, "Goal", "A null-space goal.")
        .def(nb::new_(&make_goal), "kind"_a, "gain"_a, "posture"_a, "weight"_a)
        .def("step", [](const Goal& goal, const Chain& chain, const Vector& q) {
                return array_of(GoalSteps(chain).at(goal_for(goal, chain.dof), shaped("q", q, {chain.dof}).data()));
            }, "chain"_a, "q"_a);

    nb::class_<Seeds>(module, "Seeds", "Starts of a search.")
        .def(nb::new_([](const Chain& chain, const Matrix& configurations) {
                 return Seeds(chain, shaped("configurations", configurations, {kSome, chain.dof}).data(),
                              configurations.shape(0));
             }), "chain"_a, "configurations"_a)
        .def("nearest", &nearest_seeds, "task"_a, "target"_a)
        .def("weights", [](const Seeds& seeds, const Task& task) {
            const Seeds::Weights weights = seeds.weights(task);
            return std::tuple(weights.distance, weights.spin);
        }, "task"_a);

    auto solver = nb::class_<IkSolver>(module, "IkSolver", "An arm, a task and a method with its settings.")
        .def(nb::new_([](const Chain& chain, const std::vector<JointRange>& ranges, const Task& task,
                         const StepRule& rule, int max_iterations, double max_step, double progress, int patience) {
                 require_size("ranges", ranges.size(), chain.dof);
                 if (std::holds_alternative<FabrikStep>(rule) && chain.has_mimic_joints())
                     refuse("FABRIK does not support mimic joints");
                 counted("max_iterations", max_iterations);
                 counted("patience", patience);
                 return IkSolver{chain, ranges, task, rule, max_iterations, max_step, {progress, patience}};
             }), "chain"_a, "ranges"_a, nb::kw_only(), "task"_a, "rule"_a, "max_iterations"_a, "max_step"_a,
             "progress"_a, "patience"_a)
        .def("solve_batch", &solve_batch_of, "targets"_a, "q0"_a, "seeds"_a, "goal"_a.none(), "count"_a, "threads"_a,
             "q, position and orientation errors, whether each fulfils the task, iterations and attempts.");
    constants(solver, "SATURATION", IkSolver::kSaturation, "SMALLEST_STEP", IkSolver::kSmallestStep, "GOAL_CONVERGED",
              IkSolver::kGoalConverged, "GOAL_STEPS", Progress::kGoalSteps);

    bind_result<Candidate>(module, "Candidate", "The result of a series of attempts.", "fulfils", &Candidate::fulfils,
                           "iterations", &Candidate::iterations, "attempts", &Candidate::attempts,
                           "q", [](const Candidate& found) { return array_of<const double>(found.q); },
                           "position_error", [](const Candidate& found) { return found.error.position; },
                           "orientation_error", [](const Candidate& found) { return found.error.orientation; });

    auto search = nb::class_<OwningSearch>(module, "Search", "The attempts for one target.")
        .def(nb::init<const IkSolver&, const Seeds&, const std::optional<Goal>&, const Matrix&, const Vector&>(),
             "solver"_a, "seeds"_a, "goal"_a.none(), "target"_a, "q0"_a, nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>())
        .def("next", &OwningSearch::next, "count"_a, "polish"_a, nb::call_guard<nb::gil_scoped_release>(),
             "Make attempts until one satisfies the task, or until there are `count` for this target.");
    constants(search, "POLISH_PROGRESS", Search::kPolish.progress, "POLISH_PATIENCE", Search::kPolish.patience);
}

}  // namespace pinproof
