// The fastest speeds along a path: time-optimal path parametrisation by reachability analysis.
//
// H. Pham, Q.-C. Pham, "A new approach to time-optimal path parameterization based on reachability analysis", IEEE T-RO
// 34(3), 2018. With x = s'^2 and u = s'' constant between the nodes of a grid, x grows by 2 h u over a step of length
// h, and q'' = q'(s) u + q''(s) x is linear in both. The backward pass computes the interval of x at each node from
// which the rest of the path is feasible; the forward pass computes the largest u that stays within those intervals.
// Limits are imposed at both ends of a step with the u of that step (their "interpolation scheme").
//
// The authors solve a linear program per step. With two variables a simpler method suffices: at a given x every limit
// permits an interval of u; the width of their intersection is concave in x, and Newton's method on it converges from
// outside to the last feasible x in at most as many iterations as there are limits.
#pragma once

#include <cstddef>
#include <optional>
#include <span>

namespace pinproof {

// The steps between the nodes of a grid over the parameter s of a path, and the limits on them. At both ends of a step,
// |alpha u + beta x + gamma| <= bound for each row; the ends of two steps that meet may differ.
struct SpeedProblem {
    std::size_t rows;
    std::span<const double> alpha, beta, gamma, bound;  // (N, 2, rows)
    std::span<const double> step;                       // (N) lengths of the steps, above 0
    std::span<const double>
        ceiling;  // (N + 1) largest x at the nodes, for the limits of speed; 0 where the motion must stop
    double start, end;  // x at the first node and at the last one

    std::size_t steps() const { return step.size(); }
};

// Find x = s'^2 (N + 1) at every node, as large as can be. Returns the node from which the path cannot be driven, if
// any: the last one if `end` is above its ceiling, the first one if `start` cannot be braked to what follows.
std::optional<std::size_t> fastest_speeds(const SpeedProblem& problem, std::span<double> x);

}  // namespace pinproof
