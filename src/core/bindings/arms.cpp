// Arms: chains of joints, the iterative methods of inverse kinematics, tracking, and joint curves along routes of the tcp.
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/variant.h>

#include <cmath>
#include <numeric>
#include <optional>

#include "bindings/structs.h"
#include "collision/world.h"
#include "geometry/rotations.h"
#include "geometry/sincos.h"
#include "ik/box_descent.h"
#include "ik/search.h"
#include "ik/tracker.h"
#include "kinematics/chain.h"
#include "planning/route_follower.h"

namespace pinproof {
namespace {

void require_indices(const std::vector<Joint>& joints, std::size_t dof) {
    for (const Joint& joint : joints)
        if (joint.index >= dof) refuse("the index of a joint is not smaller than dof");
}

void check_tree(const JointTree& tree) {
    require_indices(tree.joints, tree.dof);
    for (std::size_t k = 0; k < tree.joints.size(); ++k)
        if (tree.joints[k].parent < kRoot || tree.joints[k].parent >= static_cast<int>(k))
            refuse("the parent of a joint must come before it");
}

// Write a Jacobian (6, n) row by row; returns the position after it.
double* write_jacobian(const Jacobian& columns, double* out) {
    for (int i = 0; i < 6; ++i)
        for (const Twist& column : columns) *out++ = i < 3 ? column.linear[i] : column.angular[i - 3];
    return out;
}

NewArray jacobian_array(const Jacobian& columns) {
    return filled<double>({6, columns.size()}, [&](double* out) { write_jacobian(columns, out); });
}

Jacobian read_jacobian(const char* name, const Matrix& matrix) {
    shaped(name, matrix, {6, kAny});
    Jacobian columns(matrix.shape(1));
    for (std::size_t j = 0; j < columns.size(); ++j)
        for (std::size_t i = 0; i < 3; ++i) {
            columns[j].linear[i] = matrix(i, j);
            columns[j].angular[i] = matrix(i + 3, j);
        }
    return columns;
}

// Place the chain at each row of the configurations (N, n), and call `record(row, posture)`.
template <class Record>
void place_rows(const Chain& chain, const Matrix& configurations, Record record) {
    const double* q = shaped("configurations", configurations, {kAny, chain.dof}).data();
    nb::gil_scoped_release release;
    Posture posture(chain);
    for (std::size_t row = 0; row < configurations.shape(0); ++row, q += chain.dof) {
        posture.evaluate(chain, Frame{}, q);
        record(row, posture);
    }
}

NewArray forward_batch(const Chain& chain, const Matrix& configurations) {
    return filled<double>({configurations.shape(0), 4, 4}, [&](double* out) {
        place_rows(chain, configurations, [&](std::size_t row, const Posture& posture) {
            write_homogeneous(transform_of(posture.tcp()), out + 16 * row);
        });
    });
}

NewArray jacobian_batch(const Chain& chain, const Matrix& configurations) {
    return filled<double>({configurations.shape(0), 6, chain.dof}, [&](double* out) {
        Jacobian jacobian(chain.dof);
        place_rows(chain, configurations, [&](std::size_t, const Posture& posture) {
            posture.jacobian(chain, jacobian);
            out = write_jacobian(jacobian, out);
        });
    });
}

NewArray manipulability_batch(const Chain& chain, const Matrix& configurations) {
    return filled<double>({configurations.shape(0)}, [&](double* out) {
        Jacobian jacobian(chain.dof);
        place_rows(chain, configurations, [&](std::size_t row, const Posture& posture) {
            posture.jacobian(chain, jacobian);
            out[row] = std::exp(log_manipulability(jacobian));
        });
    });
}

std::tuple<Transform, NewArray> evaluate(const Chain& chain, const Vector& q, const Matrix& start) {
    const double *values = shaped("q", q, {chain.dof}).data(), *from = shaped("start", start, {4, 4}).data();
    Posture posture(chain);
    Jacobian columns(chain.dof);
    posture.evaluate(chain, frame_of(read_transform(from)), values);
    posture.jacobian(chain, columns);
    return {transform_of(posture.tcp()), jacobian_array(columns)};
}

std::vector<std::size_t> not_rigid(const Stack& matrices) {
    const auto numbers = shaped("matrices", matrices, {kAny, 4, 4});
    std::vector<std::size_t> indices;
    for (std::size_t i = 0; i < matrices.shape(0); ++i)
        if (!is_rigid(numbers.data() + 16 * i)) indices.push_back(i);
    return indices;
}

void bind_chains(nb::module_& module) {
    bind_struct<Joint>(module, "Joint",
                       "A joint about or along the z axis of its frame, with the value multiplier * q[index] + offset, "
                       "behind a constant transform from its parent (in a tree; -1: the root) or the previous joint.",
                       unchecked, MEMBERS(Joint, before, prismatic, index, multiplier, offset), OPTIONALS(Joint,
                                                                                                          parent));
    bind_struct<JointTree>(module, "JointTree", "The joints of a robot, each after its parent.", check_tree,
                           MEMBERS(JointTree, joints, dof));
    bind_struct<Chain>(module, "Chain",
                       "The joints of an arm from base to tcp: base_from_tcp(q) = before_1 X_1(q) before_2 X_2(q) ... "
                       "tool, where X_k is a rotation about z or a translation along z by the value of the joint.",
                       [](const Chain& chain) { require_indices(chain.joints, chain.dof); },
                       MEMBERS(Chain, joints, tool, dof))
        .def_prop_ro("has_mimic_joints", &Chain::has_mimic_joints)
        .def("forward_batch", &forward_batch, "configurations"_a,
             "base_from_tcp (N, 4, 4) at each row of the configurations (N, n).")
        .def("jacobian_batch", &jacobian_batch, "configurations"_a,
             "(N, 6, n) the Jacobian of the tcp at each row of the configurations (N, n), in the axes of the base.")
        .def("manipulability_batch", &manipulability_batch, "configurations"_a,
             "sqrt(det(J J^T)) of the Jacobian of the tcp at each row (N, n); of J^T J with fewer than 6 joints.")
        .def("evaluate", &evaluate, "q"_a, "start"_a,
             "start times base_from_tcp (4, 4) at q (n,), and the Jacobian of the tcp (6, n) in the axes of start.");

    module.def(
        "is_rigid", [](const Matrix& matrix) { return is_rigid(shaped("matrix", matrix, {4, 4}).data()); }, "matrix"_a,
        "Whether a (4, 4) matrix is a rigid transform up to rounding.");
    module.def("all_finite", [](const nb::ndarray<const double, nb::c_contig, nb::device::cpu>& numbers) {
            return std::all_of(numbers.data(), numbers.data() + numbers.size(),
                               [](double x) { return std::isfinite(x); });
        }, "numbers"_a, "Whether all numbers of an array are finite.");
    module.def("not_rigid", &not_rigid, "matrices"_a,
               "The indices of the matrices (N, 4, 4) that are not rigid transforms up to rounding.");
}

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

// A goal, which must suit the arm; without one, the goal that does not exist.
Goal goal_for(const std::optional<Goal>& goal, std::size_t dof) {
    if (!goal) return {};
    require_size("the posture of the goal", goal->posture.size(), dof);
    require_size("the weight of the goal", goal->weight.size(), dof);
    return *goal;
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
                         const std::optional<Goal>& goal, long long count, const std::shared_ptr<World>& world,
                         std::size_t threads) {
    const std::size_t n = solver.chain.dof, rows = targets.shape(0);
    require_size("a seed", seeds.dof(), n);
    if (world) require_size("a configuration of the world", world->space().tree.dof, n);
    const double* poses = shaped("targets", targets, {kAny, 4, 4}).data();
    const double* starts = shaped("q0", q0, {rows, n}).data();
    const Goal wanted = goal_for(goal, n);
    BatchResults out;
    const auto arrays = nb::make_tuple(filled({rows, n}, out.q), filled({rows}, out.position_error),
                                       filled({rows}, out.orientation_error), filled({rows}, out.fulfils),
                                       filled({rows}, out.iterations), filled({rows}, out.attempts),
                                       filled({rows}, out.refusals));
    nb::gil_scoped_release release;
    solve_batch(solver, seeds, wanted, poses, starts, rows, count, world, threads, out);
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
    for (std::size_t i = 0; i < rows; ++i)
        errors.push_back(measure(task, read_transform(from + 16 * i), read_transform(to + 16 * i)));
    return table(errors, &PoseError::position, &PoseError::orientation);
}

std::tuple<NewArray, NewArray> residual_and_jacobian(const Task& task, const Matrix& target_from_tcp,
                                                     const Matrix& in_target_axes) {
    const Frame frame = frame_of(read_transform(shaped("target_from_tcp", target_from_tcp, {4, 4}).data()));  // may be NaN
    Jacobian jacobian = read_jacobian("in_target_axes", in_target_axes);
    task.apply(frame, jacobian);
    const auto [v, w] = task.residual(frame);
    return {array_of(std::array{v[0], v[1], v[2], w[0], w[1], w[2]}), jacobian_array(jacobian)};
}

Twist read_twist(const char* name, const Vector& twist) {
    const auto v = shaped(name, twist, {6});
    return {Double4{v[0], v[1], v[2], 0.0}, Double4{v[3], v[4], v[5], 0.0}};
}

// The step (n,) of a rule for a residual, whose Jacobian is (6, n); `run` receives both and the step.
template <class Run>
NewArray step_of(const Vector& residual, const Matrix& jacobian, Run run) {
    const Jacobian columns = read_jacobian("jacobian", jacobian);
    Doubles step(columns.size());
    run(read_twist("residual", residual), columns, step);
    return array_of(step);
}

NewArray fabrik_passes(const Chain& chain, const std::vector<JointRange>& ranges, const Task& task,
                       const Matrix& target_from_base, const Vector& q, int iteration, int waited) {
    require_size("ranges", ranges.size(), chain.dof);
    if (chain.has_mimic_joints()) refuse("FABRIK does not support mimic joints");
    const double* here = shaped("q", q, {chain.dof}).data();
    Posture posture(chain);
    posture.evaluate(chain, frame_of(transform("target_from_base", target_from_base)), here);
    Doubles step(chain.dof);
    FabrikPasses(chain.joints.size()).step(chain, ranges, task, posture, here, iteration, waited, step);
    return array_of(step);
}

void bind_methods(nb::module_& module) {
    auto clik = nb::class_<ClikStep>(module, "ClikStep", "The step of Clik.")
        .def(nb::init<double>(), "damping"_a)
        .def("step", [](const ClikStep& rule, double growth, double longest, double squared_residual,
                        const Vector& residual, const Matrix& jacobian) {
            return step_of(residual, jacobian, [&](const Twist& pull, const Jacobian& columns, Doubles& step) {
                rule(growth, longest, squared_residual, pull, columns, step);
            });
        }, "growth"_a, "longest"_a, "squared_residual"_a, "residual"_a, "jacobian"_a);
    constants(clik, "GROWTH", ClikStep::kGrowth, "RELIEF", ClikStep::kRelief);
    nb::class_<SingularStep>(module, "SingularStep", "That of PseudoInverse and DampedLeastSquares.")
        .def(nb::init<double, double, double>(), "cutoff"_a, "damping"_a, "region"_a)
        .def("step", [](const SingularStep& rule, const Vector& residual, const Matrix& jacobian) {
            return step_of(residual, jacobian, [&](const Twist& pull, const Jacobian& columns, Doubles& step) {
                SingularValues decomposition(columns.size());
                rule(pull, columns, decomposition, step);
            });
        }, "residual"_a, "jacobian"_a);
    nb::class_<FabrikStep>(module, "FabrikStep", "The step of FABRIK.")
        .def(nb::init<ClikStep, double>(), "end"_a, "squared_handover"_a)
        .def_static("passes", &fabrik_passes, "chain"_a, "ranges"_a, "task"_a, "target_from_base"_a, "q"_a,
                    "iteration"_a, "waited"_a);

    bind_struct<JointRange>(module, "JointRange",
                            "The limits of a joint; periodic: q and q + 2 pi are the same pose; wraps: with a range of "
                            "at least 2 pi, so that a descent continues 2 pi away beyond a limit.",
                            unchecked, LIMITS(JointRange, lower, upper),
                            MEMBERS(JointRange, periodic, wraps));

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
        .def("solve_batch", &solve_batch_of, "targets"_a, "q0"_a, "seeds"_a, "goal"_a.none(), "count"_a,
             "world"_a.none(), "threads"_a,
             "q, position and orientation errors, whether each fulfils the task (without contact in the world, if one "
             "is given), iterations, attempts, and solutions in contact.");
    constants(solver, "SATURATION", IkSolver::kSaturation, "SMALLEST_STEP", IkSolver::kSmallestStep, "GOAL_CONVERGED",
              IkSolver::kGoalConverged, "GOAL_STEPS", Progress::kGoalSteps);

    bind_result<Candidate>(module, "Candidate", "The result of a series of attempts.", FIELDS(Candidate, fulfils,
                                                                                              iterations, attempts),
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
    BoxStep step(columns.size());
    step.lower = list_of(shaped("lower", lower, {columns.size()}));
    step.upper = list_of(shaped("upper", upper, {columns.size()}));
    const double gain = step.solve(shift, columns, read_twist("pull", pull));
    return nb::make_tuple(array_of(step.step()), column<double>(step.held(), std::identity{}), gain);
}

void make_route(Route& route) {
    if (route.pieces.empty()) refuse("a route has no pieces");
    for (const RoutePiece& piece : route.pieces)
        if (!(piece.width >= 0.0)) refuse("the width of a piece of a route must be 0 or more");
    route = Route::of(std::move(route.pieces));
}

void bind_routes(nb::module_& module) {
    auto segment = bind_struct<RouteSegment>(
        module, "RouteSegment", "A straight segment: a translation and a rotation vector per metre, and the length (m).",
        unchecked, MEMBERS(RouteSegment, translation, rotation, length));
    segment.def_static("between", [](const Matrix& first, const Matrix& last) {
            return RouteSegment::between(transform("first", first), transform("last", last));
        }, "first"_a, "last"_a, "The segment on which the orientation rotates about one fixed axis.");
    constants(segment, "LEVER", RouteSegment::kLever, "MIN_LENGTH", RouteSegment::kMinLength);
    bind_struct<RoutePiece>(module, "RoutePiece",
                            "A piece of a route: a pose, the incoming and the outgoing segment, the coefficients (6,) "
                            "of both, and the width (m). The parameters of the route at its ends are set by the route.",
                            unchecked, MEMBERS(RoutePiece, pose, into, out, a, b, width))
        .def_ro("start", &RoutePiece::start)
        .def_ro("end", &RoutePiece::end)
        .def("derivatives", [](const RoutePiece& self) {
                const RoutePiece::Derivatives most = self.derivatives();
                return std::tuple{most.acceleration, most.turn, most.turn_change};
            }, "Bounds of |p''|, |w| and |w'| for position p and angular velocity w by the parameter of the route.");
    bind_struct<Route>(module, "Route", "A route of the tcp in space.", make_route, MEMBERS(Route, pieces))
        .def("poses", [](const Route& self, const Vector& s) {
                return filled<double>({s.shape(0), 4, 4}, [&](double* out) {
                    for (std::size_t i = 0; i < s.shape(0); ++i) write_homogeneous(self.pose(s(i)), out + 16 * i);
                });
            }, "s"_a, "(N, 4, 4) base_from_tcp at parameters (N,).");
    using Curve = JointCurve;
    bind_result<Curve>(
        module, "JointCurve",
        "A joint curve along a route: a spline with q (k, n) and slopes (k, n), and why it stops. By pose: the pose at "
        "`at` cannot be solved from the configuration `before`, within the limits `lower` and `upper`, at the initial "
        "spacing of poses; the closest one is `reached`. By deviation: because of the deviation there, or because it may leave the limits by `outside` (n,).",
        FIELDS(Curve, knots, deviation, rotation_deviation, at, before, reached, lower, upper, spacing, deviation_there,
               rotation_deviation_there, outside),
        "q", [](const Curve& self) { return rows_of(self.q, self.q.size() / self.knots.size()); },
        "slopes", [](const Curve& self) { return rows_of(self.slopes, self.q.size() / self.knots.size()); },
        "stopped_by_pose", [](const Curve& self) { return self.stop == RouteStop::kPose; },
        "stopped_by_deviation", [](const Curve& self) { return self.stop == RouteStop::kDeviation; });
    nb::class_<RouteFollower>(module, "RouteFollower", "Follows routes with a joint curve on one IK branch.")
        .def(nb::new_([](const Chain& chain, const Vector& lower, const Vector& upper, const Task& task,
                         double max_joint_step, double translation_step, double rotation_step, double deviation,
                         double rotation_deviation, bool only_complete) {
                 TrackingTask tracking{chain, list_of(shaped("lower", lower, {chain.dof})),
                                       list_of(shaped("upper", upper, {chain.dof})),
                                       Doubles(chain.dof, positive("max_joint_step", max_joint_step)), task, {}};
                 return RouteFollower(std::move(tracking),
                                      {positive("deviation", deviation),
                                       positive("rotation_deviation", rotation_deviation),
                                       positive("translation_step", translation_step),
                                       positive("rotation_step", rotation_step), max_joint_step, only_complete});
             }), nb::kw_only(), "chain"_a, "lower"_a, "upper"_a, "task"_a, "max_joint_step"_a, "translation_step"_a,
             "rotation_step"_a, "deviation"_a, "rotation_deviation"_a, "only_complete"_a = false)
        .def("follow", [](const RouteFollower& self, const Route& route, const Vector& first) {
                const auto start = finite("first", first, {self.dof()});
                if (const std::size_t joint = self.outside(start); joint < self.dof())
                    refuse("first is outside the limits of joint " + std::to_string(joint));
                nb::gil_scoped_release release;
                return self.follow(route, list_of(start));
            }, "route"_a, "first"_a)
        .def("ends_of_lines", [](const RouteFollower& self, const Matrix& starts, const Stack& targets) {
                const std::size_t count = starts.shape(0), n = self.dof();
                const auto from = finite("starts", starts, {count, n});
                const auto poses = shaped("targets", targets, {count, 4, 4});
                return filled<double>({count, n}, [&](double* out) {
                    nb::gil_scoped_release release;
                    std::fill_n(out, count * n, std::numeric_limits<double>::quiet_NaN());
                    for (std::size_t i = 0; i < count; ++i) {
                        const Doubles first(from.begin() + i * n, from.begin() + (i + 1) * n);
                        if (self.outside(first) < n) continue;
                        const Transform here = forward_kinematics(self.chain(), first.data());
                        const Transform there = read_transform(poses.data() + 16 * i);
                        const JointCurve curve = self.follow(Route::straight(here, there), first);
                        if (curve.stop == RouteStop::kNone) std::copy_n(curve.q.end() - n, n, out + i * n);
                    }
                });
            }, "starts"_a, "targets"_a,
            "(N, n) the configurations at the ends of straight lines from (N, n) to base_from_tcp (N, 4, 4); NaN for "
            "lines that cannot be followed to their end.")
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

void bind_tracker(nb::module_& module) {
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

}  // namespace

void bind_arms(nb::module_& module) {
    for (auto* bind : {bind_chains, bind_methods, bind_routes, bind_tracker}) bind(module);
}

}  // namespace pinproof
