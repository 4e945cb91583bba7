#include "timing/hermite_curve.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>

#include "geometry/curve.h"

namespace pinproof {
namespace {

// Error of an extremum, relative to the largest coefficient: far above the rounding of averages, far below the
// tolerance of every limit.
constexpr double kExtreme = 1e-12;

using Quintic = std::array<double, 6>;  // control points of up to degree 5

// The largest value of a polynomial, at most kExtreme of its size too large, if it exceeds `enough`; otherwise a bound
// that does not. A piece is inside the hull of its control points, which subdivision tightens.
double largest_value(const Quintic& control, std::size_t degree, double seen, double slack, int depth) {
    double hull = control[0];
    for (std::size_t i = 1; i <= degree; ++i) hull = std::max(hull, control[i]);
    seen = std::max({seen, control[0], control[degree]});
    if (hull <= seen + slack || depth == 0) return std::max(hull, seen);
    Quintic left{}, right{};
    halve(control.data(), degree + 1, 1, left.data(), right.data());
    seen = std::max(seen, left[degree]);
    const double first = largest_value(left, degree, seen, slack, depth - 1);
    return largest_value(right, degree, std::max(seen, first), slack, depth - 1);
}

// The largest magnitude, or a bound that is at most `enough`.
double magnitude(const Quintic& control, std::size_t degree, double enough) {
    double hull = 0.0;
    for (std::size_t i = 0; i <= degree; ++i) hull = std::max(hull, std::abs(control[i]));
    if (hull <= enough) return hull;
    if (!std::isfinite(hull)) return hull;
    Quintic negative{};
    for (std::size_t i = 0; i <= degree; ++i) negative[i] = -control[i];
    const double most = largest_value(control, degree, 0.0, kExtreme * hull, 60);
    return largest_value(negative, degree, most, kExtreme * hull, 60);
}

// The control points of the derivative of one joint on a piece. The middle one follows from the mean slope, because
// differences of inner control points would amplify their rounding.
std::size_t slope_of(const HermiteCurve& curve, std::size_t piece, std::size_t j, double width, Quintic& slope) {
    const std::size_t a = piece * curve.joints + j, b = a + curve.joints;
    const double mean = (curve.q[b] - curve.q[a]) / width, before = curve.velocity[a], after = curve.velocity[b];
    if (!curve.quintic()) {
        slope = {before, 3.0 * mean - before - after, after};
        return 2;
    }
    const double left = before + 0.25 * width * curve.acceleration[a];
    const double right = after - 0.25 * width * curve.acceleration[b];
    slope = {before, left, 5.0 * mean - before - left - right - after, right, after};
    return 4;
}

// The control points of a Hermite piece from values, slopes and second derivatives at both ends.
Quintic hermite(double width, double q0, double q1, double v0, double v1, const double* a0, const double* a1) {
    if (!a0) return {q0, q0 + width / 3.0 * v0, q1 - width / 3.0 * v1, q1};
    const double fifth = width / 5.0, square = width * width / 20.0;
    return {q0,
            q0 + fifth * v0,
            q0 + (2.0 * fifth * v0 + square * *a0),
            q1 - (2.0 * fifth * v1 - square * *a1),
            q1 - fifth * v1,
            q1};
}

constexpr std::size_t kMaxOrder = 16;

// The Bernstein basis at u.
void bernstein(double u, std::size_t degree, double* basis) {
    basis[0] = 1.0;
    for (std::size_t r = 1; r <= degree; ++r) {
        basis[r] = basis[r - 1] * u;
        for (std::size_t i = r - 1; i > 0; --i) basis[i] = basis[i] * (1.0 - u) + basis[i - 1] * u;
        basis[0] *= 1.0 - u;
    }
}

}  // namespace

std::vector<double> excess(const HermiteCurve& curve, const RateLimits& limits) {
    std::vector<double> result(curve.pieces(), 0.0);
    for (std::size_t k = 0; k < curve.pieces(); ++k) {
        const double width = curve.times[k + 1] - curve.times[k];
        double factor = 0.0;
        const auto raise = [&](double share) { factor = share > factor || std::isnan(share) ? share : factor; };
        for (std::size_t j = 0; j < curve.joints; ++j) {
            Quintic control{};
            std::size_t degree = slope_of(curve, k, j, width, control);
            raise(magnitude(control, degree, limits.velocity[j]) / limits.velocity[j]);
            const auto differentiate = [&] {
                for (std::size_t i = 0; i < degree; ++i)
                    control[i] = (control[i + 1] - control[i]) * (static_cast<double>(degree) / width);
                --degree;
            };
            differentiate();
            raise(std::sqrt(magnitude(control, degree, limits.acceleration[j]) / limits.acceleration[j]));
            if (limits.smooth()) {
                differentiate();
                raise(std::cbrt(magnitude(control, degree, limits.jerk[j]) / limits.jerk[j]));
            }
        }
        result[k] = factor;
    }
    return result;
}

double deviation(const HermiteCurve& curve, const TimedPath& path, std::size_t piece, bool proven) {
    const std::size_t n = curve.joints, order = curve.quintic() ? 5 : 3, total = order * path.degree();
    const std::size_t count = proven ? (3 * total + 1) / 2 : 4;
    const double factor = proven ? 1.0 / std::cos(std::numbers::pi * static_cast<double>(total) /
                                                  static_cast<double>(2 * count))
                                 : 1.0;
    const double width = curve.times[piece + 1] - curve.times[piece];
    const auto second = [&](const std::vector<double>& values, std::size_t i) {
        return curve.quintic() ? &values[i] : nullptr;
    };
    const Quintic along = hermite(width, curve.s[piece], curve.s[piece + 1], curve.speed[piece], curve.speed[piece + 1],
                                  second(curve.second, piece), second(curve.second, piece + 1));
    std::vector<Quintic> control(n);
    for (std::size_t j = 0; j < n; ++j) {
        const std::size_t a = piece * n + j, b = a + n;
        control[j] = hermite(width, curve.q[a], curve.q[b], curve.velocity[a], curve.velocity[b],
                             second(curve.acceleration, a), second(curve.acceleration, b));
    }
    double most = 0.0, basis[kMaxOrder + 1], on_path[kMaxOrder + 1];
    for (std::size_t i = 1; i < count; ++i) {
        const double u =
            0.5 - 0.5 * std::cos(std::numbers::pi * static_cast<double>(i) / static_cast<double>(count));
        bernstein(u, order, basis);
        double s = 0.0;
        for (std::size_t r = 0; r <= order; ++r) s += basis[r] * along[r];
        // A piece may contain a knot near one end, where points are merged: the piece of the path is that of s.
        const std::size_t part = path.piece_of(s);
        const double begin = path.knots()[part], local = (s - begin) / (path.knots()[part + 1] - begin);
        bernstein(std::clamp(local, 0.0, 1.0), path.degree(), on_path);
        const auto points = path.control(part);
        for (std::size_t j = 0; j < n; ++j) {
            double difference = 0.0;
            for (std::size_t r = 0; r <= order; ++r) difference += basis[r] * control[j][r];
            for (std::size_t r = 0; r <= path.degree(); ++r) difference -= on_path[r] * points[r * n + j];
            most = std::max(most, std::abs(difference));
        }
    }
    return factor * most;
}

}  // namespace pinproof
