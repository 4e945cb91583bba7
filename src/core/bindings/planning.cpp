// Edges, searches and shortcuts in joint space.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <memory>
#include <optional>
#include <stdexcept>

#include "bindings/arrays.h"
#include "bindings/bindings.h"
#include "bindings/exact_judge.h"
#include "planning/edge_checker.h"
#include "planning/manifold.h"
#include "planning/rrt_connect.h"
#include "planning/shortcut.h"
#include "planning/staggered_move.h"

namespace pinproof {
namespace {

std::unique_ptr<ExactJudge> judge(nb::object exact, const World& world) {
    return std::make_unique<PythonJudge>(std::move(exact), world.space().tree.dof);
}

void require_rows(const char* name, const Matrix& rows, std::size_t length) {
    require_size(name, rows.shape(1), length);
    if (rows.shape(0) == 0) throw std::invalid_argument(std::string(name) + ": there are no rows");
}

const Tree& tree_of(const RrtSearch& search, int tree) {
    if (tree != 0 && tree != 1) throw std::invalid_argument("tree must be 0 or 1");
    return search.tree(tree);
}

int node_of(const Tree& tree, int node) {
    if (node < 0 || node >= tree.size()) throw std::invalid_argument("no such node");
    return node;
}

// The nodes of a tree with these numbers, (N, dof).
nb::object rows_of(const Tree& tree, const std::vector<int>& nodes, std::size_t dof) {
    auto out = new_array({nodes.size(), dof});
    for (std::size_t i = 0; i < nodes.size(); ++i)
        std::copy_n(tree.node(node_of(tree, nodes[i])), dof, out.data + i * dof);
    return nb::cast(out.array);
}

void bind_edges(nb::module_& module) {
    nb::class_<EdgeChecker>(module, "EdgeChecker", "Checks straight edges in joint space by samples and by proofs.")
        .def(
            "__init__",
            [](EdgeChecker* self, std::shared_ptr<World> world, nb::object exact, double resolution) {
                require_positive("resolution", resolution);
                auto by_exact = judge(std::move(exact), *world);
                new (self) EdgeChecker(std::move(world), std::move(by_exact), resolution);
            },
            nb::arg("world"), nb::arg("exact"), nb::arg("resolution"))
        .def(
            "set_steering",
            [](EdgeChecker& self, std::shared_ptr<World> world, nb::object exact, bool blocked) {
                if (!self.has_bodies_of(*world)) throw std::invalid_argument("the worlds have different bodies");
                auto by_exact = judge(std::move(exact), *world);
                self.set_steering(std::move(world), std::move(by_exact), blocked);
            },
            nb::arg("world"), nb::arg("exact"), nb::arg("blocked"),
            "Take samples in another world; `blocked`: none is free.")
        .def(
            "set_resolution",
            [](EdgeChecker& self, double resolution) {
                require_positive("resolution", resolution);
                self.set_resolution(resolution);
            },
            nb::arg("resolution"))
        .def(
            "set_torque_limits",
            [](EdgeChecker& self, const DynamicTree& model, const Vector& limits) {
                require_size("a configuration of model", model.tree.dof, self.dof());
                require_size("limits", limits.shape(0), self.dof());
                for (std::size_t j = 0; j < self.dof(); ++j)
                    if (!(limits(j) > 0.0)) throw std::invalid_argument("limits must be above 0");
                self.set_torque_limits(model, {limits.data(), limits.data() + limits.size()});
            },
            nb::arg("model"), nb::arg("limits"),
            "Only samples at which the arm is held at rest with torques (n,) within the limits are free.")
        .def(
            "samples_free",
            [](EdgeChecker& self, const Vector& a, const Vector& b) {
                require_size("a", a.shape(0), self.dof());
                require_size("b", b.shape(0), self.dof());
                nb::gil_scoped_release release;
                return self.samples_free(a.data(), b.data());
            },
            nb::arg("a"), nb::arg("b"))
        .def(
            "points_free",
            [](EdgeChecker& self, const Matrix& points) {
                require_rows("points", points, self.dof());
                nb::gil_scoped_release release;
                return self.points_free({points.data(), points.size()});
            },
            nb::arg("points"), "Whether points (N, n) of a motion and the samples of the edges between them are free.")
        .def(
            "proven_free",
            [](EdgeChecker& self, const Vector& a, const Vector& b) {
                require_size("a", a.shape(0), self.dof());
                require_size("b", b.shape(0), self.dof());
                nb::gil_scoped_release release;
                return self.proven_free(a.data(), b.data());
            },
            nb::arg("a"), nb::arg("b"))
        .def_prop_ro("samples", &EdgeChecker::samples, "Total number of samples so far.");
}

void bind_manifold(nb::module_& module) {
    nb::class_<Manifold>(module, "Manifold", "The configurations of an arm that satisfy constraints of its tcp.")
        .def(
            "__init__",
            [](Manifold* self, const Chain& chain, const std::vector<PathConstraint>& constraints, const Vector& lower,
               const Vector& upper) {
                require_size("lower", lower.shape(0), chain.dof);
                require_size("upper", upper.shape(0), chain.dof);
                for (std::size_t j = 0; j < chain.dof; ++j)
                    if (!(lower(j) <= upper(j))) throw std::invalid_argument("lower must not exceed upper");
                if (constraints.empty()) throw std::invalid_argument("there is no constraint");
                new (self) Manifold(ConstrainedTcp(chain, constraints), {lower.data(), lower.data() + chain.dof},
                                    {upper.data(), upper.data() + chain.dof});
            },
            nb::arg("chain"), nb::arg("constraints"), nb::arg("lower"), nb::arg("upper"))
        .def(
            "errors",
            [](Manifold& self, const Vector& q) {
                require_size("q", q.shape(0), self.dof());
                std::vector<double> found(self.size());
                self.errors(q.data(), found.data());
                return array_of(found);
            },
            nb::arg("q"), "(k,) the error of each constraint at q, in rad or m.")
        .def(
            "project",
            [](Manifold& self, const Vector& q, double share) -> nb::object {
                require_size("q", q.shape(0), self.dof());
                require_finite("q", q.data(), q.size());
                std::vector<double> moved(q.data(), q.data() + q.size());
                return self.project(moved.data(), share) ? array_of(moved) : nb::none();
            },
            nb::arg("q"), nb::arg("share"),
            "A configuration near q at which every error is at most this share of its tolerance, or None.")
        .def(
            "edge_proven",
            [](Manifold& self, const Vector& a, const Vector& b) {
                require_size("a", a.shape(0), self.dof());
                require_size("b", b.shape(0), self.dof());
                return self.edge_proven(a.data(), b.data());
            },
            nb::arg("a"), nb::arg("b"), "Whether all constraints are proven on the straight edge from a to b.")
        .def(
            "connect",
            [](Manifold& self, EdgeChecker& edges, const Vector& a, const Vector& b, double step,
               double most) -> nb::object {
                require_size("edges", edges.dof(), self.dof());
                require_size("a", a.shape(0), self.dof());
                require_size("b", b.shape(0), self.dof());
                require_finite("a", a.data(), a.size());
                require_finite("b", b.data(), b.size());
                require_positive("step", step);
                std::vector<double> path(a.data(), a.data() + a.size());
                bool reached = false;
                {
                    nb::gil_scoped_release release;
                    reached = self.connect(edges, a.data(), b.data(), step, most, path);
                }
                if (!reached) return nb::none();
                auto out = new_array({path.size() / self.dof(), self.dof()});
                std::copy(path.begin(), path.end(), out.data);
                return nb::cast(out.array);
            },
            nb::arg("edges"), nb::arg("a"), nb::arg("b"), nb::arg("step"), nb::arg("most"),
            "Waypoints (k, n) from a to b along the constraints with free edges, not longer than `most`, or None.");
}

void bind_search(nb::module_& module) {
    nb::class_<RrtSearch> search(module, "RrtSearch", "Two trees that grow towards each other.");
    nb::enum_<RrtSearch::Event>(search, "Event", "Why a search stopped.")
        .value("MET", RrtSearch::Event::kMet)
        .value("NEEDS_DRAWS", RrtSearch::Event::kNeedsDraws)
        .value("SPENT", RrtSearch::Event::kSpent)
        .value("PAUSED", RrtSearch::Event::kPaused);
    search
        .def(
            "__init__",
            [](RrtSearch* self, EdgeChecker& edges, const Vector& start, const Matrix& goals, const Matrix& box,
               double step, std::int64_t max_nodes, std::int64_t max_samples, Manifold* manifold) {
                require_size("start", start.shape(0), edges.dof());
                require_rows("goals", goals, edges.dof());
                require_size("box", box.size(), 2 * edges.dof());
                require_positive("step", step);
                if (manifold != nullptr) require_size("a configuration of manifold", manifold->dof(), edges.dof());
                new (self) RrtSearch(edges, {start.data(), start.size()}, {goals.data(), goals.size()},
                                     {box.data(), box.size()}, {step, max_nodes, max_samples}, manifold);
            },
            nb::arg("edges"), nb::arg("start"), nb::arg("goals"), nb::arg("box"), nb::kw_only(), nb::arg("step"),
            nb::arg("max_nodes"), nb::arg("max_samples"), nb::arg("manifold").none() = nb::none(),
            nb::keep_alive<1, 2>(), nb::keep_alive<1, 9>())
        .def("grow", &RrtSearch::grow, nb::arg("until"), nb::call_guard<nb::gil_scoped_release>(),
             "Continue until something happens, or the edges have taken this many samples.")
        .def(
            "add_draws",
            [](RrtSearch& self, const Matrix& draws) {
                require_size("a row of draws", draws.shape(1), self.dof() + 2);
                require_draws(draws);
                self.add_draws({draws.data(), draws.size()});
            },
            nb::arg("draws"), "Provide random numbers (N, n + 2) in [0, 1).")
        .def(
            "size", [](const RrtSearch& self, int tree) { return tree_of(self, tree).size(); }, nb::arg("tree"))
        .def(
            "branch",
            [](const RrtSearch& self, int tree, int node) {
                return tree_of(self, tree).branch(node_of(tree_of(self, tree), node));
            },
            nb::arg("tree"), nb::arg("node"), "The nodes from this one to its root.")
        .def(
            "cut",
            [](RrtSearch& self, int tree, int node) {
                const Tree& whole = tree_of(self, tree);
                if (whole.is_root(node_of(whole, node))) throw std::invalid_argument("a root cannot be removed");
                self.tree(tree).cut(node);
                self.forget_gap();  // The nearest nodes may have been removed.
            },
            nb::arg("tree"), nb::arg("node"), "Remove a node that is not a root, and its subtree.")
        .def(
            "configurations",
            [](const RrtSearch& self, int tree, const std::vector<int>& nodes) {
                const Tree& all = tree_of(self, tree);
                return rows_of(all, nodes, self.dof());
            },
            nb::arg("tree"), nb::arg("nodes"))
        .def(
            "nodes",
            [](const RrtSearch& self, int tree) {
                const Tree& all = tree_of(self, tree);
                std::vector<int> kept;
                for (int i = 0; i < all.size(); ++i)
                    if (!all.removed(i)) kept.push_back(i);
                return rows_of(all, kept, self.dof());
            },
            nb::arg("tree"), "(m, n) the nodes of a tree that were not removed.")
        .def(
            "add",
            [](RrtSearch& self, int tree, const Vector& q, int parent) {
                require_size("q", q.shape(0), self.dof());
                node_of(tree_of(self, tree), parent);
                return self.tree(tree).add(q.data(), parent);
            },
            nb::arg("tree"), nb::arg("q"), nb::arg("parent"), "Add a node, for tests.")
        .def(
            "nearest",
            [](const RrtSearch& self, int tree, const Vector& q) {
                require_size("q", q.shape(0), self.dof());
                return tree_of(self, tree).nearest(q.data());
            },
            nb::arg("tree"), nb::arg("q"))
        .def(
            "meeting",
            [](const RrtSearch& self, int tree) {
                tree_of(self, tree);
                return self.meeting(tree);
            },
            nb::arg("tree"), "The node at which a tree met the other.")
        .def_prop_ro("samples", &RrtSearch::samples, "Total number of random samples.")
        .def_prop_ro("gap", &RrtSearch::gap, "The smallest distance found so far between nodes of both trees.")
        .def("distance_of_trees", &RrtSearch::distance_of_trees, nb::call_guard<nb::gil_scoped_release>(),
             "The smallest distance between the nodes of both trees.");
}

// The state at a time, as three lists.
nb::tuple state_of(const StaggeredMove& move, double time) {
    nb::list q, velocity, acceleration;
    for (std::size_t j = 0; j < move.joints.size(); ++j) {
        const Instant at = move.at(j, time);
        q.append(at.s);
        velocity.append(at.speed);
        acceleration.append(at.acceleration);
    }
    return nb::make_tuple(q, velocity, acceleration);
}

void bind_staggered_moves(nb::module_& module) {
    nb::class_<StaggeredMove>(module, "StaggeredMove", "A motion from rest to rest; joints move at different times.")
        .def_ro("goal", &StaggeredMove::goal, "The index of the goal.")
        .def_ro("duration", &StaggeredMove::duration)
        .def("at_time", state_of, nb::arg("time"), "Positions, velocities and accelerations after a time (s), as lists.")
        .def("phase_ends", [](const StaggeredMove& self) { return array_of(self.phase_ends()); },
             "The times (s) at which a phase of a joint ends, sorted.");
    nb::class_<StaggeredSearch>(module, "StaggeredSearch", "Searches for motions whose joints move at different times.")
        .def(
            "__init__",
            [](StaggeredSearch* self, EdgeChecker& edges, const Vector& start, const Matrix& goals, const Matrix& box,
               const Vector& velocity, const Vector& acceleration, const std::optional<Vector>& jerk,
               double sample_time) {
                const std::size_t n = edges.dof();
                require_size("start", start.shape(0), n);
                require_rows("goals", goals, n);
                require_size("box", box.size(), 2 * n);
                require_size("velocity", velocity.shape(0), n);
                require_size("acceleration", acceleration.shape(0), n);
                if (jerk) require_size("jerk", jerk->shape(0), n);
                require_finite("start", start.data(), n);
                require_finite("goals", goals.data(), goals.size());
                require_positive("sample_time", sample_time);
                JointRates rates{{velocity.data(), velocity.data() + n}, {acceleration.data(), acceleration.data() + n}, {}};
                if (jerk) rates.jerk.assign(jerk->data(), jerk->data() + n);
                for (const auto* each : {&rates.velocity, &rates.acceleration, &rates.jerk})
                    for (double rate : *each) {
                        require_positive("a limit", rate);
                        require_finite("a limit", &rate, 1);
                    }
                new (self) StaggeredSearch(edges, {start.data(), n}, {goals.data(), goals.size()}, {box.data(), n},
                                           {box.data() + n, n}, std::move(rates), sample_time);
            },
            nb::arg("edges"), nb::arg("start"), nb::arg("goals"), nb::arg("box"), nb::kw_only(), nb::arg("velocity"),
            nb::arg("acceleration"), nb::arg("jerk").none(), nb::arg("sample_time"), nb::keep_alive<1, 2>())
        .def(
            "run",
            [](StaggeredSearch& self, double below, const Matrix& draws) {
                require_size("a row of draws", draws.shape(1), self.draws_per_motion());
                require_draws(draws);
                nb::gil_scoped_release release;
                return self.run(below, {draws.data(), draws.size()});
            },
            nb::arg("below"), nb::arg("draws"),
            "The fastest motion of those that the rows of random numbers (N, draws_per_motion) in [0, 1) describe, of "
            "less than `below` (s) and free at samples, or None.")
        .def_prop_ro("draws_per_motion", &StaggeredSearch::draws_per_motion)
        .def_prop_ro("tried", &StaggeredSearch::tried, "Total number of motions that were checked.");
}

}  // namespace

void bind_planning(nb::module_& module) {
    bind_edges(module);
    bind_manifold(module);
    bind_search(module);
    bind_staggered_moves(module);
    module.def(
        "shortcut",
        [](EdgeChecker& edges, const Matrix& path, const Matrix& draws) {
            require_rows("path", path, edges.dof());
            require_size("a row of draws", draws.shape(1), 2);
            require_draws(draws);
            std::vector<double> shorter;
            {
                nb::gil_scoped_release release;
                PathShortener shortener(edges, {path.data(), path.size()});
                shortener.connect_farthest();
                if (draws.shape(0) > 0) {
                    shortener.random_shortcuts({draws.data(), draws.size()});
                    shortener.remove_waypoints();
                    shortener.straighten();
                    shortener.remove_waypoints();
                }
                shorter = shortener.path();
            }
            auto out = new_array({shorter.size() / edges.dof(), edges.dof()});
            std::copy(shorter.begin(), shorter.end(), out.data);
            return nb::cast(out.array);
        },
        nb::arg("edges"), nb::arg("path"), nb::arg("draws"),
        "A shorter path (k, n) with the same ends, from random numbers (attempts, 2) in [0, 1).");
}

}  // namespace pinproof
