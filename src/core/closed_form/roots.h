// Roots of equations that are linear in the state of a joint, and of quartic polynomials.
//
// With rho^2 = A^2 + B^2 and w^2 = rho^2 - C^2, the equation A cos q + B sin q + C = 0 of a revolute joint has the roots
//
//     (cos q, sin q) = (-A C -+ B w, -B C +- A w) / rho^2.
//
// If w^2 is slightly below zero, the equation fails by |C| - rho; up to a given border the state is kept as a double
// root, and forward kinematics decides.
#pragma once

#include <algorithm>
#include <limits>

#include "closed_form/line.h"

namespace pinproof {

// In lengths of the arm. A vector shorter than this does not determine a joint: the joint is free. The error of a branch
// with any value of such a joint is below this.
inline constexpr double kFree = 1e-10;

// The error of the coefficients of an equation before any joint is known, in lengths of the arm.
inline constexpr double kRounding = 1e-15;

// A vector shorter than this multiple of its error has no certain direction: the joint that depends on it may be free.
// Otherwise that joint is known to about 0.01 rad.
inline constexpr double kUncertain = 100.0;

// How much a result may be off: due to rounding, and due to the tolerances of the answer.
struct ErrorBound {
    double rounding = 0.0, tolerance = 0.0;
};

// a * state.first + b * state.second + c = 0 for the state of one joint.
struct LinearEquation {
    double a, b, c;
    bool prismatic;

    double largest_coefficient() const { return std::max(std::abs(a), std::abs(b)); }
};

struct RootSettings {
    double border;        // an equation that fails to have a root by less has the closest state as a root
    double spread;        // in w^2: distance of the two states returned for a double root, as starts of a refinement
    double free = kFree;  // every value is a root if a and b are smaller
    // w^2, if it is known more accurately than from the coefficients.
    double square = std::numeric_limits<double>::quiet_NaN();
};

struct Roots {
    int count = 0;
    bool every_value = false;  // the joint is free; then count is 0
    JointState state[2];
};

Roots solve(const LinearEquation& equation, const RootSettings& settings);

// The error (rad, or lengths of the arm) of a root, if c has the given error. 1 or more: the joint is undetermined.
//
// An error d of an equation with slope s and curvature k moves a simple root by d / s, a double root by sqrt(d / k).
ErrorBound root_error(const LinearEquation& equation, const JointState& root, const ErrorBound& of_c);

// The real roots of a quartic polynomial, with up to two candidates for a double root.
struct QuarticRoots {
    int count = 0;
    double value[8];
};

// The real roots of a[0] + ... + a[4] t^4 = 0, sorted; a[4] must not be small.
//
// All four complex roots are computed at once by Aberth's iteration (1973, "Iteration methods for finding all zeros of a
// polynomial simultaneously"), which needs no initial guess. A complex pair with small imaginary parts (relative to its
// size, at most `nearly` or 1e-3) counts as two roots that nearly meet: candidates on both sides of them, and the
// middle, in case rounding separated a double root.
QuarticRoots quartic_roots(const double (&a)[5], double nearly);

}  // namespace pinproof
