// Time parametrisation: the fastest motion along a path within limits, verified between its points.
//
// The limits are imposed at the nodes of a grid, and a Hermite curve through points of the path deviates from the path.
// Therefore every motion is verified between its points too: steps that exceed a limit are slowed down, and steps that
// deviate from the path are subdivided, until both conditions hold.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "timing/hermite_curve.h"
#include "timing/timed_path.h"

namespace pinproof {

// Limits |alpha s'' + beta s'^2 + gamma| <= bound at points of the path, (N, rows) each.
struct ConstraintRows {
    std::size_t rows = 0;
    std::vector<double> alpha, beta, gamma, bound;
};

struct TimingTask {
    const TimedPath& path;
    const RateLimits& limits;
    std::vector<double> start_velocity, end_velocity;  // (n)
    double image_tolerance;                            // largest deviation from the path, in any joint
    double rate_tolerance;                             // relative excess over a limit that is attributed to rounding
    double longest;                                    // longest duration (s)
    // Further limits at points: configurations, first and second derivatives (N, n). Empty without such limits.
    std::function<ConstraintRows(std::span<const double>, std::span<const double>, std::span<const double>)> rows;
    // For each piece of a motion, the factor by which it must be slowed down to satisfy the further limits.
    std::function<std::vector<double>(const HermiteCurve&)> excess;
};

enum class TimingStatus {
    timed,
    end_too_fast,      // end_velocity exceeds the limits at the end of the path
    ends_unreachable,  // start_velocity or end_velocity is not possible within the limits on this path
    not_smooth,        // no speeds within the limits exist on the grid
    too_long,          // the duration exceeds `longest`
    deviates,          // no grid brings the motion within the image tolerance
    exceeds,           // no slowdown satisfies the limits
};

struct TimedMotion {
    TimingStatus status;
    HermiteCurve curve;
    double duration = 0.0;   // s, also if it is too long
    double deviation = 0.0;  // from the path, an upper bound
    double excess = 0.0;     // largest factor over a limit
    int rounds = 0;          // verifications
};

TimedMotion time_path(const TimingTask& task);

}  // namespace pinproof
