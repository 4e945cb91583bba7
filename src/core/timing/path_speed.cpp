#include "timing/path_speed.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace pinproof {
namespace {

// Relative to x: a Newton step that is at most this has converged.
constexpr double kRounding = 1e-12;

// A bound of u (1/s^2, with s approximately in seconds) beyond all practical values; it keeps quotients finite.
constexpr double kFar = 1e30;

// Factor of the largest possible u up to which a limit may lie outside and still counts as a limit of u. A limit beyond
// depends on x only, up to the relative error 1 / kBeyond: its quotients would have errors of the size of all others.
constexpr double kBeyond = 1e10;

// Maximum number of Newton steps; it exceeds the number of limits on one step.
constexpr int kMostSteps = 200;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// An interval [low, high] of u, and the derivatives of its ends in x.
struct Interval {
    double low, high, low_slope, high_slope;
};

// A range of x at the node after a step.
struct Range {
    double least, most;
};

// The bound of u on step i beyond which a limit does not restrict it: |u| <= max(x, next x) / (2 h).
double far_of(const SpeedProblem& problem, std::size_t i, const Range& next) {
    const double most = kBeyond * std::max(problem.ceiling[i], next.most) / (2.0 * problem.step[i]);
    return most > 0.0 ? std::min(most, kFar) : kFar;
}

// The interval of u that the limits on step i permit at x.
Interval permitted(const SpeedProblem& problem, std::size_t i, double x, const Range& next) {
    const double twice = 2.0 * problem.step[i], far = far_of(problem, i, next);
    Interval u{(next.least - x) / twice, (next.most - x) / twice, -1.0 / twice, -1.0 / twice};
    for (std::size_t side = 0; side < 2; ++side)
        for (std::size_t j = 0; j < problem.rows; ++j) {
            // |p u + r x + g| <= a at this node; at the next one x has grown by 2 h u.
            const std::size_t entry = (2 * i + side) * problem.rows + j;
            const double r = problem.beta[entry], g = problem.gamma[entry], a = problem.bound[entry];
            const double p = problem.alpha[entry] + static_cast<double>(side) * twice * r;
            if (std::abs(p) * far <= a) continue;  // see largest_without_slope()
            const double middle = -(r * x + g) / p, half = a / std::abs(p);
            if (middle + half < u.high) {
                u.high = middle + half;
                u.high_slope = -r / p;
            }
            if (middle - half > u.low) {
                u.low = middle - half;
                u.low_slope = -r / p;
            }
        }
    return u;
}

// The largest x within the limits that do not restrict any practical u, because their joints hardly move along the path.
double largest_without_slope(const SpeedProblem& problem, std::size_t i, const Range& next) {
    const double far = far_of(problem, i, next);
    double x = std::numeric_limits<double>::infinity();
    for (std::size_t side = 0; side < 2; ++side)
        for (std::size_t j = 0; j < problem.rows; ++j) {
            const std::size_t entry = (2 * i + side) * problem.rows + j;
            const double r = problem.beta[entry], g = problem.gamma[entry], a = problem.bound[entry];
            const double p = problem.alpha[entry] + static_cast<double>(side) * 2.0 * problem.step[i] * r;
            if (r != 0.0 && std::abs(p) * far <= a) x = std::min(x, (a - (r > 0.0 ? g : -g)) / std::abs(r));
        }
    return x;
}

// The first x from the given one down (or up) at which some u leads to the range; NaN without one.
double first_feasible(const SpeedProblem& problem, std::size_t i, double x, const Range& next, bool down) {
    const double most = largest_without_slope(problem, i, next);
    if (down) x = std::min(x, most);
    for (int round = 0; round < kMostSteps; ++round) {
        const Interval u = permitted(problem, i, x, next);
        const double width = u.high - u.low, tilt = u.high_slope - u.low_slope;
        if (width >= 0.0) return x <= most ? std::max(x, 0.0) : kNan;
        if (!(down ? tilt < 0.0 : tilt > 0.0)) return kNan;  // Farther along, the interval is even smaller.
        const double before = x;
        x -= width / tilt;
        if (std::abs(x - before) <= kRounding * std::abs(before)) return x <= most ? std::max(x, 0.0) : kNan;
    }
    return kNan;
}

}  // namespace

std::optional<std::size_t> fastest_speeds(const SpeedProblem& problem, std::span<double> x) {
    const std::size_t last = problem.steps();
    if (!(problem.end <= problem.ceiling[last] * (1.0 + kRounding))) return last;
    // Backwards: the range [lowest, x] at each node from which the rest of the path is feasible.
    std::vector<double> lowest(last + 1);
    lowest[last] = x[last] = problem.end;
    for (std::size_t i = last; i-- > 0;) {
        const Range next{lowest[i + 1], x[i + 1]};
        x[i] = first_feasible(problem, i, problem.ceiling[i], next, true);
        if (!(x[i] >= 0.0)) return i;
        lowest[i] = 0.0;
        if (lowest[i + 1] > 0.0) {
            lowest[i] = first_feasible(problem, i, 0.0, next, false);
            if (!(lowest[i] <= x[i])) return i;
        }
    }
    if (!(lowest[0] * (1.0 - kRounding) <= problem.start && problem.start <= x[0] * (1.0 + kRounding))) return 0;
    // Forwards: the largest u on each step.
    x[0] = problem.start;
    for (std::size_t i = 0; i < last; ++i) {
        const Interval u = permitted(problem, i, x[i], {lowest[i + 1], x[i + 1]});
        const double chosen = u.high >= u.low ? u.high : 0.5 * (u.low + u.high);
        x[i + 1] = std::min(std::max(x[i] + 2.0 * problem.step[i] * chosen, lowest[i + 1]), x[i + 1]);
    }
    return std::nullopt;
}

}  // namespace pinproof
