// The fastest speeds along a path with limits of jerk: a third-order problem, solved by an interior-point method.
//
// With x = s'^2 and a = s'' = x'/2 (the prime of x is its derivative in s), s''' = a' s', so that a limit of jerk is
//     |q' a' + 3 q'' a + q''' x| <= J / sqrt(x).
// The left side is linear in x, a and a'. The right side is convex in x; its tangent at the current solution is below
// it, so that the linear program with the tangent only permits motions that satisfy the limit. Minimising the time
// with tangents that follow the solution converges to a local optimum. The same reformulation is the basis of
// Y. Wang, C. Hu, Y. Li, J. Yu, J. Yan, Y. Liang, Z. Jin, "Online time-optimal trajectory planning along parametric
// toolpaths with strict constraint satisfaction and certifiable feasibility guarantee", 2024, and of its successors.
//
// On each step s''' is constant, which the speeds at the nodes represent exactly: with the duration h of a step,
//     v1 - v0 = h (a0 + a1) / 2,    length = h (v0 + v1) / 2 - (a1 - a0) h^2 / 12,
// hence x1 - x0 = (a0 + a1) w with the effective width w = length + (a1 - a0) h^2 / 12. For given widths, x is a
// quadratic spline over them. Its B-spline coefficients c are the unknowns; the widths follow the solution. At rest this
// is exact too, where x grows with the power 4/3 of s and a polynomial in s would not leave the rest.
//
// x and a at the ends of step k depend on c[k], c[k + 1] and c[k + 2] only, so that the Newton systems of the primal-dual
// interior-point method (S. Mehrotra, "On the implementation of a primal-dual interior point method", SIAM J. Optim.
// 2(4), 1992) have five diagonals.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace pinproof {

// The steps between two stops and the limits at both ends of each step.
struct JerkProblem {
    std::size_t joints, rows;
    std::span<const double> step;                       // (N) lengths of the steps, above 0; N >= 4
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
    double excess = 0.0;           // largest violation of a limit, relative to it
    int rounds = 0;
};

// Improve x (N + 1), an estimate of the solution.
JerkSolution fastest_with_jerk(const JerkProblem& problem, std::span<const double> x);

}  // namespace pinproof
