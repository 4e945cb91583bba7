// The fastest speeds along a path with limits of jerk: a third-order problem, solved by an interior-point method.
//
// With x = s'^2 and a = s'' = x'/2 (the prime of x is its derivative in s), s''' = a' s', so that a limit of jerk is
//     |q' a' + 3 q'' a + q''' x| <= J / sqrt(x).
// The left side is linear in x, a and a'. The right side is convex in x; its tangent at the current solution is below
// it, so that a linear program with the tangent only permits motions that satisfy the limit. Minimising the time with
// tangents that follow the solution converges to a local optimum. The same reformulation is used by COPP (Y. Wang, S.
// He, S. Lin, C. Hu, https://copp.pro).
//
// On each step s''' is linear in time. With the duration h and the values j0 and j1 of s''' at both ends,
//     v1 - v0 = h (a0 + a1) / 2 - (j1 - j0) h^2 / 12,    length = h (v0 + v1) / 2 - (a1 - a0) h^2 / 12,
// hence with the effective width w = h (v0 + v1) / 2 = length + (a1 - a0) h^2 / 12 and the mean speed m = w / h,
//     j0 / m = 3 (x1 - x0) / w^2 - (4 a0 + 2 a1) / w,    j1 / m = -3 (x1 - x0) / w^2 + (2 a0 + 4 a1) / w.
// For given widths, everything is linear in x and a at the nodes, which are the unknowns: x is a cubic Hermite curve
// over the widths. The widths follow the solution. At rest this is exact too, where x grows with the power 4/3 of s and
// a polynomial in s would not leave the rest.
//
// The values at a node occur together with those of its neighbours only, so that the Newton systems of the primal-dual
// interior-point method (S. Mehrotra, "On the implementation of a primal-dual interior point method", SIAM J. Optim.
// 2(4), 1992) have seven diagonals.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace pinproof {

// The steps between two stops and the limits at both ends of each step.
struct JerkProblem {
    std::size_t joints, rows;
    std::span<const double> step;                       // (N) lengths of the steps, above 0; N >= 2
    std::span<const char> uniform;                      // (N) lines along which the limits are constant
    std::span<const double> ceiling;                    // (N + 1) largest x at the nodes
    std::span<const double> alpha, beta, gamma, bound;  // (N, 2, rows) |alpha a + beta x + gamma| <= bound
    std::span<const double> slope, curvature, third;    // (N, 2, joints) derivatives of the path in s
    std::span<const double> jerk;                       // (N, joints) limits
    double start, end;                                  // x at both ends, where a = 0

    std::size_t steps() const { return step.size(); }
};

// The motion at the nodes.
struct JerkSolution {
    std::vector<double> x, a;      // (N + 1)
    std::vector<double> duration;  // (N) of the steps
    std::vector<double> first, last;  // (N) s''' at both ends of the steps
    double excess = 0.0;           // largest violation of a limit, relative to it
    int rounds = 0;                // Newton steps
};

// Improve x (N + 1), an estimate of the solution.
JerkSolution fastest_with_jerk(const JerkProblem& problem, std::span<const double> x);

}  // namespace pinproof
