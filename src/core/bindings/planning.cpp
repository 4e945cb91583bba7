// Edges, searches and shortcuts in joint space, and the order of jobs with options.
#include <nanobind/stl/pair.h>

#include <optional>

#include "bindings/arrays.h"
#include "bindings/structs.h"
#include "common/threads.h"
#include "planning/edge_checker.h"
#include "planning/ladder.h"
#include "planning/manifold.h"
#include "planning/rrt_connect.h"
#include "planning/shortcut.h"
#include "planning/staggered_move.h"
#include "planning/tour_search.h"

namespace pinproof {
namespace {

// Whether an edge is free, by one of the checks.
auto of_edge(bool (EdgeChecker::*check)(const double*, const double*)) {
    return [check](EdgeChecker& self, const Vector& a, const Vector& b) {
        const double *from = shaped("a", a, {self.dof()}).data(), *to = shaped("b", b, {self.dof()}).data();
        nb::gil_scoped_release release;
        return (self.*check)(from, to);
    };
}

// Whether the straight edges from rows of a to rows of b are proven free; 0 threads: one for each processor.
NewArrayOf<bool> edges_proven(const std::shared_ptr<World>& world, const Matrix& a, const Matrix& b, std::size_t threads) {
    const std::size_t dof = world->space().tree.dof, count = a.shape(0);
    const double *from = shaped("a", a, {kAny, dof}).data(), *to = shaped("b", b, {count, dof}).data();
    struct Worker {
        EdgeChecker edges;
        const double *from, *to;
        bool* free;

        void operator()(Rows& rows) {
            for (std::size_t row; rows.take(row);)
                free[row] = edges.proven_without_samples(from + row * edges.dof(), to + row * edges.dof());
        }
    };
    if (threads == 0) threads = std::max(std::thread::hardware_concurrency(), 1u);
    return filled<bool>({count}, [&](bool* free) {
        nb::gil_scoped_release release;
        share_rows(count, threads, [&] { return Worker{EdgeChecker(world, 1.0), from, to, free}; });
    });
}

void bind_edges(nb::module_& module) {
    module.def("edges_proven", &edges_proven, "world"_a, "a"_a, "b"_a, "threads"_a,
               "(N,) whether the straight edges between rows of a and b (N, n) are proven free, without the GIL; 0 threads: "
               "one for each processor.");
    nb::class_<EdgeChecker>(module, "EdgeChecker", "Checks straight edges in joint space by samples and by proofs.")
        .def(nb::new_([](std::shared_ptr<World> world, double resolution) {
                 return new EdgeChecker(std::move(world), positive("resolution", resolution));
             }), "world"_a, "resolution"_a)
        .def("set_steering", [](EdgeChecker& self, std::shared_ptr<World> world, bool blocked) {
                if (!self.has_bodies_of(*world)) refuse("the worlds have different bodies");
                self.set_steering(std::move(world), blocked);
            }, "world"_a, "blocked"_a, "Take samples in another world; `blocked`: none is free.")
        .def(
            "set_resolution",
            [](EdgeChecker& self, double resolution) { self.set_resolution(positive("resolution", resolution)); },
            "resolution"_a)
        .def("set_torque_limits", [](EdgeChecker& self, const DynamicTree& model, const Vector& limits) {
                require_size("a configuration of model", model.tree.dof, self.dof());
                const auto torques = shaped("limits", limits, {self.dof()});
                for (double torque : torques) positive("limits", torque);
                self.set_torque_limits(model, list_of(torques));
            }, "model"_a, "limits"_a)
        .def("samples_free", of_edge(&EdgeChecker::samples_free), "a"_a, "b"_a)
        .def("points_free", [](EdgeChecker& self, const Matrix& points) {
                const auto rows = shaped("points", points, {kSome, self.dof()});
                nb::gil_scoped_release release;
                return self.points_free(rows);
            }, "points"_a, "Whether points (N, n) of a motion and the samples of the edges between them are free.")
        .def("proven_free", of_edge(&EdgeChecker::proven_free), "a"_a, "b"_a)
        .def_prop_ro("samples", &EdgeChecker::samples, "Total number of samples so far.");
}

void bind_manifold(nb::module_& module) {
    nb::class_<Manifold>(module, "Manifold", "The configurations of an arm that satisfy constraints of its tcp.")
        .def(nb::new_([](const std::vector<std::pair<Chain, std::vector<PathConstraint>>>& tcps, const Vector& lower,
                         const Vector& upper) {
                 if (tcps.empty()) refuse("there is no constraint");
                 const std::size_t n = tcps.front().first.dof;
                 Doubles low = list_of(shaped("lower", lower, {n})), high = list_of(shaped("upper", upper, {n}));
                 if (!std::ranges::equal(low, high, std::less_equal{})) refuse("lower must not exceed upper");
                 std::vector<ConstrainedTcp> constrained;
                 for (const auto& [chain, constraints] : tcps) {
                     require_size("a configuration of a chain", chain.dof, n);
                     if (constraints.empty()) refuse("there is no constraint");
                     constrained.emplace_back(chain, constraints);
                 }
                 return Manifold(std::move(constrained), std::move(low), std::move(high));
             }), "tcps"_a, "lower"_a, "upper"_a, "`tcps`: chains of the same joints, each with constraints of its tcp.")
        .def("errors", [](Manifold& self, const Vector& q) {
                const double* at = shaped("q", q, {self.dof()}).data();
                return filled<double>({self.size()}, [&](double* out) { self.errors(at, out); });
            }, "q"_a, "(k,) the error of each constraint at q, in rad or m.")
        .def("project", [](Manifold& self, const Vector& q, double share) -> std::optional<NewArray> {
                Doubles moved = list_of(finite("q", q, {self.dof()}));
                if (!self.project(moved.data(), share)) return std::nullopt;
                return array_of(moved);
            }, "q"_a, "share"_a,
            "A configuration near q at which every error is at most this share of its tolerance, or None.")
        .def("edge_proven", [](Manifold& self, const Vector& a, const Vector& b) {
                const std::size_t n = self.dof();
                return self.edge_proven(shaped("a", a, {n}).data(), shaped("b", b, {n}).data());
            }, "a"_a, "b"_a, "Whether all constraints are proven on the straight edge from a to b.")
        .def("connect", [](Manifold& self, EdgeChecker& edges, const Vector& a, const Vector& b, double step,
               double most) -> std::optional<NewArray> {
                require_size("edges", edges.dof(), self.dof());
                const auto from = finite("a", a, {self.dof()}), to = finite("b", b, {self.dof()});
                positive("step", step);
                Doubles path = list_of(from);
                if (!without_gil([&] { return self.connect(edges, from.data(), to.data(), step, most, path); }))
                    return std::nullopt;
                return rows_of(path, self.dof());
            }, "edges"_a, "a"_a, "b"_a, "step"_a, "most"_a,
            "Waypoints (k, n) from a to b along the constraints with free edges, not longer than `most`, or None.");
}

const Tree& tree_of(const RrtSearch& search, int tree) {
    if (tree != 0 && tree != 1) refuse("tree must be 0 or 1");
    return search.tree(tree);
}

int node_of(const Tree& tree, int node) {
    if (node < 0 || node >= tree.size()) refuse("no such node");
    return node;
}

// The nodes of a tree with these numbers, (N, dof).
NewArray nodes_of(const Tree& tree, const std::vector<int>& nodes, std::size_t dof) {
    return filled<double>({nodes.size(), dof}, [&](double* out) {
        for (int node : nodes) out = std::copy_n(tree.node(node_of(tree, node)), dof, out);
    });
}

void bind_search(nb::module_& module) {
    nb::class_<RrtSearch> search(module, "RrtSearch", "Two trees that grow towards each other.");
    nb::enum_<RrtSearch::Event>(search, "Event", "Why a search stopped.")
        .value("MET", RrtSearch::Event::kMet)
        .value("NEEDS_DRAWS", RrtSearch::Event::kNeedsDraws)
        .value("SPENT", RrtSearch::Event::kSpent)
        .value("PAUSED", RrtSearch::Event::kPaused);
    search
        .def(nb::new_([](EdgeChecker& edges, const Vector& start, const Matrix& goals, const Matrix& box, double step,
                         std::int64_t max_nodes, std::int64_t max_samples, Manifold* manifold) {
                 const std::size_t n = edges.dof();
                 if (manifold != nullptr) require_size("a configuration of manifold", manifold->dof(), n);
                 return RrtSearch(edges, shaped("start", start, {n}), shaped("goals", goals, {kSome, n}),
                                  shaped("box", box, {2, n}), {positive("step", step), max_nodes, max_samples},
                                  manifold);
             }), "edges"_a, "start"_a, "goals"_a, "box"_a, nb::kw_only(), "step"_a, "max_nodes"_a, "max_samples"_a,
             "manifold"_a.none() = nb::none(), nb::keep_alive<0, 2>(), nb::keep_alive<0, 9>())
        .def("grow", &RrtSearch::grow, "until"_a, nb::call_guard<nb::gil_scoped_release>(),
             "Continue until something happens, or the edges have taken this many samples.")
        .def("add_draws", [](RrtSearch& self, const Matrix& draws) { self.add_draws(draws_of(draws, self.dof() + 2)); },
             "draws"_a, "Provide random numbers (N, n + 2) in [0, 1).")
        .def("size", [](const RrtSearch& self, int tree) { return tree_of(self, tree).size(); }, "tree"_a)
        .def("branch", [](const RrtSearch& self, int tree, int node) {
                const Tree& all = tree_of(self, tree);
                return all.branch(node_of(all, node));
            }, "tree"_a, "node"_a, "The nodes from this one to its root.")
        .def("cut", [](RrtSearch& self, int tree, int node) {
                const Tree& all = tree_of(self, tree);
                if (all.is_root(node_of(all, node))) refuse("a root cannot be removed");
                self.tree(tree).cut(node);
                self.forget_gap();  // The nearest nodes may have been removed.
            }, "tree"_a, "node"_a, "Remove a node that is not a root, and its subtree.")
        .def("configurations", [](const RrtSearch& self, int tree, const std::vector<int>& nodes) {
                return nodes_of(tree_of(self, tree), nodes, self.dof());
            }, "tree"_a, "nodes"_a)
        .def("nodes", [](const RrtSearch& self, int tree) {
                const Tree& all = tree_of(self, tree);
                std::vector<int> kept;
                for (int i = 0; i < all.size(); ++i)
                    if (!all.removed(i)) kept.push_back(i);
                return nodes_of(all, kept, self.dof());
            }, "tree"_a, "(m, n) the nodes of a tree that were not removed.")
        .def("add", [](RrtSearch& self, int tree, const Vector& q, int parent) {
                node_of(tree_of(self, tree), parent);
                return self.tree(tree).add(shaped("q", q, {self.dof()}).data(), parent);
            }, "tree"_a, "q"_a, "parent"_a, "Add a node, for tests.")
        .def("nearest", [](const RrtSearch& self, int tree, const Vector& q) {
                return tree_of(self, tree).nearest(shaped("q", q, {self.dof()}).data());
            }, "tree"_a, "q"_a)
        .def("meeting", [](const RrtSearch& self, int tree) {
                tree_of(self, tree);
                return self.meeting(tree);
            }, "tree"_a, "The node at which a tree met the other.")
        .def_prop_ro("samples", &RrtSearch::samples, "Total number of random samples.")
        .def_prop_ro("gap", &RrtSearch::gap, "The smallest distance found so far between nodes of both trees.")
        .def("distance_of_trees", &RrtSearch::distance_of_trees, nb::call_guard<nb::gil_scoped_release>(),
             "The smallest distance between the nodes of both trees.");
}

// The state at a time, as three lists.
std::tuple<Doubles, Doubles, Doubles> state_of(const StaggeredMove& move, double time) {
    std::tuple<Doubles, Doubles, Doubles> state;
    for (std::size_t j = 0; j < move.joints.size(); ++j) {
        const Instant at = move.at(j, time);
        std::get<0>(state).push_back(at.s);
        std::get<1>(state).push_back(at.speed);
        std::get<2>(state).push_back(at.acceleration);
    }
    return state;
}

void bind_staggered_moves(nb::module_& module) {
    bind_result<StaggeredMove>(module, "StaggeredMove", "A motion from rest to rest; joints move at different times.",
                               FIELDS(StaggeredMove, goal, duration))
        .def("at_time", state_of, "time"_a, "Positions, velocities and accelerations after a time (s), as lists.")
        .def("phase_ends", [](const StaggeredMove& self) { return array_of(self.phase_ends()); },
             "The times (s) at which a phase of a joint ends, sorted.");
    nb::class_<StaggeredSearch>(module, "StaggeredSearch", "Searches for motions whose joints move at different times.")
        .def(nb::new_([](EdgeChecker& edges, const Vector& start, const Matrix& goals, const Matrix& box,
                         const RateLimits& limits, double sample_time) {
                 const std::size_t n = edges.dof();
                 require_size("limits", limits.velocity.size(), n);
                 for (const Doubles* rates : {&limits.velocity, &limits.acceleration, &limits.jerk})
                     for (double rate : *rates) finite("limits", rate);
                 const auto sides = shaped("box", box, {2, n});
                 return StaggeredSearch(edges, finite("start", start, {n}), finite("goals", goals, {kSome, n}),
                                        sides.first(n), sides.last(n), limits,
                                        positive("sample_time", sample_time));
             }), "edges"_a, "start"_a, "goals"_a, "box"_a, "limits"_a, "sample_time"_a, nb::keep_alive<0, 2>())
        .def("run", [](StaggeredSearch& self, double below, const Matrix& draws) {
                const auto numbers = draws_of(draws, self.draws_per_motion());
                nb::gil_scoped_release release;
                return self.run(below, numbers);
            }, "below"_a, "draws"_a,
            "The fastest motion of those that the rows of random numbers (N, draws_per_motion) in [0, 1) describe, of "
            "less than `below` (s) and free at samples, or None.")
        .def_prop_ro("draws_per_motion", &StaggeredSearch::draws_per_motion)
        .def_prop_ro("tried", &StaggeredSearch::tried, "Total number of motions that were checked.");
}

TourProblem problem_of(const Indices& job, const Matrix& time, const IndexMatrix& pairs) {
    const std::size_t options = job.shape(0);
    TourProblem problem;
    int last = -1;
    for (std::int64_t number : shaped("job", job, {kSome})) {
        if (number != last + 1 && (number != last || last < 0)) refuse("job must ascend from 0 without gaps");
        problem.job.push_back(last = static_cast<int>(number));
    }
    problem.time = list_of(finite("time", time, {options + 1, options + 1}));
    const auto jobs = shaped("pairs", pairs, {kAny, 2});
    for (std::size_t k = 0; k < jobs.size(); k += 2) {
        for (std::int64_t number : jobs.subspan(k, 2))
            if (number < 0 || number >= problem.jobs()) refuse("no such job");
        problem.pairs.emplace_back(jobs[k], jobs[k + 1]);
    }
    return problem;
}

// The first tour, in which every job occurs once, in an order that satisfies the pairs.
std::vector<int> first_of(const TourProblem& problem, const Indices& first) {
    std::vector<int> tour, place(problem.jobs(), -1);
    for (std::int64_t option : shaped("first", first, {static_cast<std::size_t>(problem.jobs())})) {
        if (option < 0 || option >= problem.options()) refuse("no such option");
        int& at = place[problem.job[option]];
        if (at >= 0) refuse("first has two options of a job");
        at = static_cast<int>(tour.size());
        tour.push_back(static_cast<int>(option));
    }
    for (const auto& [before, after] : problem.pairs)
        if (place[before] >= place[after]) refuse("first violates a pair");
    return tour;
}

std::size_t rung_of(const Ladder& ladder, std::int64_t rung) {
    if (rung < 0 || static_cast<std::size_t>(rung) >= ladder.rungs()) refuse("no such rung");
    return static_cast<std::size_t>(rung);
}

void bind_ladder(nb::module_& module) {
    nb::class_<LadderCourse>(module, "LadderCourse")
        .def_ro("cost", &LadderCourse::cost)
        .def_prop_ro("nodes", [](const LadderCourse& self) { return array_of<std::int64_t>(self.nodes); },
                     "The number of one node of each rung, up to the farthest rung that can be reached.")
        .def_prop_ro("reachable", [](const LadderCourse& self) { return array_of<std::int64_t>(self.reachable); },
                     "The numbers of the nodes of the last of these rungs that can be reached.")
        .def_prop_ro("others", [](const LadderCourse& self) { return self.others; },
                     "The cheapest sequences to other nodes of the last rung.");
    nb::class_<Ladder>(module, "Ladder", "The best sequence of configurations through the rungs of a ladder graph.")
        .def(nb::new_([](const Indices& counts, const Matrix& q, const Vector& cost, const Vector& period,
                         const Vector& speed, const Matrix& reach, const Vector& least, const Vector& duration,
                         double time, double travel, double effort) {
                 LadderGraph graph;
                 graph.first = {0};
                 for (std::int64_t count : shaped("counts", counts, {kSome}))
                     graph.first.push_back(graph.first.back() + static_cast<std::size_t>(counted("counts", count)));
                 const std::size_t nodes = graph.first.back(), steps = graph.first.size() - 2, n = period.shape(0);
                 graph.dof = n;
                 graph.q = list_of(finite("q", q, {nodes, n}));
                 graph.cost = list_of(finite("cost", cost, {nodes}));
                 graph.period = list_of(finite("period", period, {kSome}));
                 graph.speed = list_of(finite("speed", speed, {n}));
                 graph.reach = list_of(shaped("reach", reach, {steps, n}));
                 graph.least = list_of(finite("least", least, {steps}));
                 graph.duration = list_of(finite("duration", duration, {steps}));
                 for (double each : graph.speed) positive("speed", each);
                 for (double each : graph.duration) positive("duration", each);
                 graph.weights = {finite("time", time), finite("travel", travel), finite("effort", effort)};
                 return Ladder(std::move(graph));
             }), "counts"_a, "q"_a, "cost"_a, "period"_a, "speed"_a, "reach"_a, "least"_a, "duration"_a, nb::kw_only(),
             "time"_a, "travel"_a, "effort"_a,
             "R rungs with counts (R,) of the nodes q (N, n); cost (N,) of the nodes; period and speed (n,) of the joints, "
             "0 for joints whose values are not periodic; reach (R - 1, n), least and duration (R - 1,) between rungs.")
        .def("solve", [](const Ladder& self, std::int64_t from, std::int64_t to, std::size_t others, double apart) {
                const std::size_t begin = rung_of(self, from), end = rung_of(self, to);
                if (begin > end) refuse("the last rung comes before the first one");
                nb::gil_scoped_release release;
                return self.solve(begin, end, others, apart);
            }, "first"_a, "last"_a, "others"_a = 0, "apart"_a = 0.0,
             "The cheapest sequence from a rung to another one, or to the farthest before it, and others to last nodes that "
             "differ by more than `apart` in two joints.")
        .def("remove", [](Ladder& self, std::int64_t node, std::int64_t next) {
                for (std::int64_t each : {node, next})
                    if (each < 0 || static_cast<std::size_t>(each) >= self.size()) refuse("no such node");
                self.remove(static_cast<std::size_t>(node), static_cast<std::size_t>(next));
            }, "node"_a, "next"_a, "Remove the edge between two nodes.");
}

}  // namespace

void bind_planning(nb::module_& module) {
    bind_edges(module);
    bind_ladder(module);
    bind_manifold(module);
    bind_search(module);
    bind_staggered_moves(module);
    module.def("shortcut", [](EdgeChecker& edges, const Matrix& path, const Matrix& draws, bool tighten) {
            const auto points = shaped("path", path, {kSome, edges.dof()}), numbers = draws_of(draws, 2);
            return rows_of(without_gil([&] { return shortened_path(edges, points, numbers, tighten); }), edges.dof());
        }, "edges"_a, "path"_a, "draws"_a, "tighten"_a,
        "A shorter path (k, n) with the same ends, from random numbers (attempts, 2) in [0, 1).");
    module.def(
        "search_tour",
        [](const Indices& job, const Matrix& time, const IndexMatrix& pairs, const Indices& first,
           const Matrix& draws) {
            const auto numbers = draws_of(draws, kTourDraws);
            TourProblem problem = problem_of(job, time, pairs);
            const std::vector<int> start = first_of(problem, first);
            return array_of<std::int64_t>(
                without_gil([&] { return search_tour(std::move(problem), start, numbers); }));
        }, "job"_a, "time"_a, "pairs"_a, "first"_a, "draws"_a,
        "A short tour: the option of each job in order (n,), from the jobs of all options (M,), the times between them "
        "and home (M + 1, M + 1), pairs of jobs in a fixed order (K, 2), a first tour (n,), and random numbers "
        "(disturbances, 8) in [0, 1).");
}

}  // namespace pinproof
