// Two trees in joint space that grow towards each other until they meet.
//
// A random sample is drawn about a random node of the growing tree and not over all joint ranges, where most samples
// would extend the trees in useless directions. With constraints, every step is projected onto them (manifold.h), and the
// search begins with connections from the start to the nearest goals instead of samples.
//
// Source: J. Kuffner, S. LaValle (2000), "RRT-Connect: an efficient approach to single-query path planning", ICRA.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "planning/edge_checker.h"
#include "planning/manifold.h"

namespace pinproof {

// Configurations that are connected by edges to a root. Removed nodes keep their numbers.
class Tree {
public:
    explicit Tree(std::size_t dof) : dof_(dof) {}

    int add_root(const double* q) { return add(q, size()); }
    int add(const double* q, int parent);
    // Remove a node that is not a root, and its subtree.
    void cut(int node);

    // The number of nodes that were added, including those that were removed.
    int size() const { return static_cast<int>(parents_.size()); }
    bool is_root(int node) const { return parents_[static_cast<std::size_t>(node)] == node; }
    bool removed(int node) const { return removed_[static_cast<std::size_t>(node)]; }
    const double* node(int index) const { return nodes_.data() + static_cast<std::size_t>(index) * dof_; }
    // The nodes from this one to its root.
    std::vector<int> branch(int node) const;
    // The first of the nodes closest to q by the Euclidean distance in joint space.
    int nearest(const double* q) const;

private:
    std::size_t dof_;
    std::vector<double> nodes_;  // (size, dof); infinity where removed
    std::vector<int> parents_;   // a root is its own parent
    std::vector<bool> removed_;
};

struct RrtSettings {
    double step;  // the length of the longest edge (rad or m)
    std::int64_t max_nodes, max_samples;
};

// The search stops between two edges, for random numbers or for its caller to check the time; how often it stops does
// not change the result.
class RrtSearch {
public:
    enum class Event { kMet, kNeedsDraws, kSpent, kPaused };

    // `box` (2, dof) is the range of random samples. `manifold` may be null; the start and the goals satisfy it.
    RrtSearch(EdgeChecker& edges, std::span<const double> start, std::span<const double> goals,
              std::span<const double> box, const RrtSettings& settings, Manifold* manifold = nullptr);

    // Continue until the trees meet, the draws or a budget are used up, or the edges have taken `until` samples.
    Event grow(std::int64_t until);
    // Provide random numbers in [0, 1), dof + 2 for each random sample.
    void add_draws(std::span<const double> draws);

    Tree& tree(int index) { return trees_[index]; }
    const Tree& tree(int index) const { return trees_[index]; }
    // The node of each tree at which they met.
    int meeting(int tree) const { return meeting_[tree]; }
    std::size_t dof() const { return target_.size(); }
    std::int64_t samples() const { return samples_; }  // random samples so far
    double gap() const { return gap_; }                // smallest distance found between the nodes of both trees
    // The smallest distance between the remaining nodes of both trees.
    double distance_of_trees() const;
    void forget_gap() { gap_ = std::numeric_limits<double>::infinity(); }

private:
    enum class Phase { kSample, kExtend, kConnect };

    void begin_sample();
    void begin_connection();
    bool extend(const double* start, double left);
    void turn_to_other_tree(int reached);

    EdgeChecker& edges_;
    Manifold* manifold_;
    RrtSettings settings_;
    std::vector<int> direct_;  // the goals to which a connection is tried first, the nearest one last
    std::vector<double> box_, draws_;
    std::size_t used_draws_ = 0;
    Tree trees_[2];
    int meeting_[2] = {0, 0};
    Phase phase_ = Phase::kSample;
    int growing_ = 0;             // the tree that grows
    int from_ = 0;                // its node from which it grows
    std::vector<double> target_;  // towards which it grows
    std::vector<double> end_;     // of the edge that is checked
    std::int64_t samples_ = 0;
    double gap_ = std::numeric_limits<double>::infinity();
};

}  // namespace pinproof
