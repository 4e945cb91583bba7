// The best sequence of configurations through the rungs of a ladder graph, one for each rung.
//
// A rung holds the configurations with which an arm can reach one pose: all branches of its inverse kinematics, windings,
// rotations of the tool about its axis, and values of redundant joints. An edge connects configurations of consecutive rungs
// if no joint moves farther than the reach of this pair of rungs. Its cost is
//
//     time * max(least, max_j r_j) + travel * sum_j r_j + effort * sum_j r_j^2 / duration,     r_j = |dq_j| / speed_j
//
// with the seconds r_j that joint j takes at full speed. Dynamic programming over the rungs finds the optimum over all
// sequences. Only configurations within reach in two joints, those that exclude the most, are compared in the others, and
// only if the cost up to them does not exceed one that is known.
//
// Source: S. Edwards, J. Meyer (2014), "Descartes: a path planning library for semi-constrained trajectories", ROSCon.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <unordered_set>
#include <vector>

namespace pinproof {

struct LadderCosts {
    double time, travel, effort;
};

struct LadderGraph {
    std::size_t dof;
    std::vector<std::size_t> first;  // (R + 1) number of the first node of each rung, and the number of all nodes
    std::vector<double> q;           // (N, dof)
    std::vector<double> cost;        // (N) of each node
    std::vector<double> period;      // (dof) of joints whose values are compared modulo it; 0 for the others
    std::vector<double> speed;       // (dof)
    std::vector<double> reach;       // (R - 1, dof) the largest step of each joint between consecutive rungs
    std::vector<double> least;       // (R - 1) s
    std::vector<double> duration;    // (R - 1) s, above 0
    LadderCosts weights;
};

// The cheapest sequence from one rung to the farthest that can be reached.
struct LadderCourse {
    double cost = 0.0;
    std::vector<std::int64_t> nodes;      // one of each rung, from the first one; empty if that has none
    std::vector<std::int64_t> reachable;  // the nodes of the last of these rungs that can be reached
    std::vector<LadderCourse> others;     // the cheapest to other nodes of the last rung, in the order of their costs
};

class Ladder {
public:
    explicit Ladder(LadderGraph graph) : graph_(std::move(graph)) {}

    // Among sequences of equal cost, the one with the lowest numbers, compared from the last rung backward. The last nodes
    // of the others, at most ``others`` of them, differ by more than ``apart`` in two joints.
    LadderCourse solve(std::size_t from, std::size_t to, std::size_t others = 0, double apart = 0.0) const;

    // Remove the edge between two nodes.
    void remove(std::size_t node, std::size_t next) { removed_.insert(key(node, next)); }

    std::size_t rungs() const { return graph_.first.size() - 1; }
    std::size_t size() const { return graph_.first.back(); }

private:
    std::size_t key(std::size_t node, std::size_t next) const { return node * size() + next; }
    double step(const double* from, const double* to, std::size_t joint) const;
    std::array<std::size_t, 2> sharpest(std::size_t rung, std::span<const std::size_t> nodes) const;
    double wrapped(std::size_t node, std::size_t joint) const;
    std::array<std::array<double, 2>, 2> windows(double value, double reach, double period) const;

    LadderGraph graph_;
    std::unordered_set<std::size_t> removed_;
};

}  // namespace pinproof
