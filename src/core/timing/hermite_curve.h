// The timed motion: Hermite pieces between points in time, with exact bounds of its derivatives.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "timing/timed_path.h"

namespace pinproof {

// Cubic pieces, or quintic ones if there are accelerations.
struct HermiteCurve {
    std::size_t joints = 0;
    std::vector<double> times;                    // (m)
    std::vector<double> q, velocity, acceleration;  // (m, n); `acceleration` is empty for cubic pieces
    std::vector<double> s, speed, second;         // (m) the path parameter and its derivatives at the points

    std::size_t pieces() const { return times.size() - 1; }
    bool quintic() const { return !acceleration.empty(); }
};

// For each piece, the factor by which it must be slowed down to satisfy the limits; 1 or less if it does. A factor f
// divides velocities by f, accelerations by f^2 and jerks by f^3. Extremes are exact up to 1e-12 of their size.
std::vector<double> excess(const HermiteCurve& curve, const RateLimits& limits);

// An upper bound of the deviation of a piece from the path, in any joint, or with `proven` false an estimate.
//
// On a piece, the motion q(u) is compared with path(s(u)), where s(u) is the polynomial with the values and derivatives
// of s at both ends of the piece. The difference is a polynomial of a known degree D. Its maximum is at most its maximum
// on m + 1 Chebyshev nodes, m > D, divided by cos(pi D / 2 m) (H. Ehlich, K. Zeller, "Schwankung von Polynomen zwischen
// Gitterpunkten", Mathematische Zeitschrift 86, 1964).
double deviation(const HermiteCurve& curve, const TimedPath& path, std::size_t piece, bool proven);

}  // namespace pinproof
