#include "timing/timed_path.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "geometry/curve.h"

namespace pinproof {
namespace {

// Distance from a straight line (relative to the largest coordinate of a joint, at least 1 rad or m) at which a point
// counts as on it. It covers a few rounding errors, so that the image of the path does not change.
constexpr double kOnLine = 1e-13;

// Relative difference of the derivatives of two adjacent pieces below which they are equal.
constexpr double kSameTangent = 1e-6;

// The control points of the derivative of pieces (k, degree + 1, n) between knots.
std::vector<double> derivative(std::size_t joints, std::span<const double> knots, std::span<const double> control,
                               std::size_t degree) {
    const std::size_t pieces = knots.size() - 1;
    if (degree == 0) return std::vector<double>(pieces * joints, 0.0);
    std::vector<double> result(pieces * degree * joints);
    for (std::size_t k = 0; k < pieces; ++k) {
        const double width = knots[k + 1] - knots[k];
        const double factor = width > 0.0 ? static_cast<double>(degree) / width : 0.0;
        const double* from = &control[k * (degree + 1) * joints];
        double* to = &result[k * degree * joints];
        for (std::size_t i = 0; i < degree * joints; ++i) to[i] = (from[i + joints] - from[i]) * factor;
    }
    return result;
}

std::size_t degree_of(std::size_t joints, std::span<const double> knots, std::span<const double> control) {
    return control.size() / (joints * (knots.size() - 1)) - 1;
}

double largest(std::span<const double> values) {
    double most = 0.0;
    for (double value : values) most = std::max(most, std::abs(value));
    return most;
}

}  // namespace

TimedPath::TimedPath(std::size_t joints, std::span<const double> knots, std::span<const double> control,
                     std::span<const char> stops, const RateLimits& limits)
    : joints_(joints), degree_(degree_of(joints, knots, control)), knots_(knots.begin(), knots.end()) {
    // Scale s by the time at full speed plus the time to accelerate and brake once.
    const std::vector<double> slope = derivative(joints, knots, control, degree_);
    double at_full_speed = 0.0, at_full_acceleration = 0.0;
    const std::size_t row = slope.size() / pieces();
    for (std::size_t k = 0; k < pieces(); ++k) {
        double speed = 0.0, acceleration = 0.0;
        for (std::size_t i = 0; i < row; ++i) {
            speed = std::max(speed, std::abs(slope[k * row + i]) / limits.velocity[i % joints]);
            acceleration = std::max(acceleration, std::abs(slope[k * row + i]) / limits.acceleration[i % joints]);
        }
        at_full_speed += speed * (knots[k + 1] - knots[k]);
        at_full_acceleration += acceleration * (knots[k + 1] - knots[k]);
    }
    const double scale =
        (at_full_speed + 2.0 * std::sqrt(at_full_acceleration)) / (knots_.back() - knots_.front());
    const double first = knots_.front();
    for (double& knot : knots_) knot = (knot - first) * scale;

    control_[0].assign(control.begin(), control.end());
    for (std::size_t order = 1; order < 4; ++order)
        control_[order] =
            derivative(joints, knots_, control_[order - 1], degree_ >= order ? degree_ + 1 - order : std::size_t{0});

    std::vector<double> near(joints, 1.0);
    for (std::size_t i = 0; i < control.size(); ++i)
        near[i % joints] = std::max(near[i % joints], std::abs(control[i]));
    straight_.assign(pieces(), 1);
    for (std::size_t k = 0; k < pieces(); ++k) {
        const auto points = this->control(k);
        for (std::size_t i = 0; i < points.size(); ++i) {
            const std::size_t j = i % joints;
            const double last = static_cast<double>(std::max<std::size_t>(degree_, 1));
            const double share = static_cast<double>(i / joints) / last;
            const double line = points[j] * (1.0 - share) + points[degree_ * joints + j] * share;
            if (!(std::abs(points[i] - line) <= kOnLine * near[j])) straight_[k] = 0;
        }
    }
    stops_.assign(stops.begin(), stops.end());
    stops_.front() = stops_.back() = 1;
}

std::size_t TimedPath::piece_of(double s) const {
    const auto after = std::upper_bound(knots_.begin(), knots_.end(), s);
    const std::ptrdiff_t piece = after - knots_.begin() - 1;
    return static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(piece, 0, static_cast<std::ptrdiff_t>(pieces()) - 1));
}

std::span<const double> TimedPath::control(std::size_t piece, std::size_t order) const {
    const std::size_t points = degree_ >= order ? degree_ + 1 - order : 1, size = points * joints_;
    return {&control_[order][piece * size], size};
}

void TimedPath::evaluate(std::size_t piece, double s, std::size_t order, double* result) const {
    const auto points = control(piece, order);
    const double u = std::clamp((s - knots_[piece]) / (knots_[piece + 1] - knots_[piece]), 0.0, 1.0);
    const std::size_t count = points.size() / joints_;
    double row[kMaxDegree + 1];
    for (std::size_t j = 0; j < joints_; ++j) {
        for (std::size_t i = 0; i < count; ++i) row[i] = points[i * joints_ + j];
        result[j] = value_at({row, count}, u);
    }
}

double TimedPath::fourth(std::size_t piece) const {
    if (degree_ < 4) return 0.0;
    const auto points = control(piece, 3);
    const double factor = static_cast<double>(degree_ - 3) / (knots_[piece + 1] - knots_[piece]);
    double most = 0.0;
    for (std::size_t i = joints_; i < points.size(); ++i)
        most = std::max(most, std::abs(points[i] - points[i - joints_]) * factor);
    return most;
}

bool moves(std::size_t joints, std::span<const double> control) {
    for (std::size_t i = joints; i < control.size(); ++i)
        if (control[i] != control[i - joints]) return true;
    return false;
}

std::vector<char> tangent_jumps(std::size_t joints, std::span<const double> knots, std::span<const double> control) {
    const std::size_t degree = degree_of(joints, knots, control), row = degree * joints;
    const std::vector<double> slope = derivative(joints, knots, control, degree);
    std::vector<char> result(knots.size(), 0);
    for (std::size_t k = 1; k + 1 < knots.size(); ++k) {
        const double fastest = largest({&slope[(k - 1) * row], 2 * row});
        double gap = 0.0;
        for (std::size_t j = 0; j < joints; ++j)
            gap = std::max(gap, std::abs(slope[k * row + j] - slope[k * row - joints + j]));
        result[k] = gap > kSameTangent * fastest;
    }
    return result;
}

namespace {

// Whether the inner points lie on the segment from the first to the last point, in order.
bool straight(std::size_t joints, std::span<const double> q, std::span<const double> near) {
    const std::size_t count = q.size() / joints;
    const double *first = q.data(), *last = q.data() + (count - 1) * joints;
    double square = 0.0;
    for (std::size_t j = 0; j < joints; ++j) square += (last[j] - first[j]) * (last[j] - first[j]);
    square = std::max(square, std::numeric_limits<double>::min());
    double before = 0.0;
    for (std::size_t i = 0; i < count; ++i) {
        const double* point = first + i * joints;
        double s = 0.0;
        for (std::size_t j = 0; j < joints; ++j) s += (point[j] - first[j]) * (last[j] - first[j]);
        s /= square;
        if (i > 0 && !(s > before)) return false;
        before = s;
        for (std::size_t j = 0; j < joints; ++j)
            if (!(std::abs(first[j] + s * (last[j] - first[j]) - point[j]) <= kOnLine * near[j])) return false;
    }
    return true;
}

}  // namespace

std::vector<double> corners(std::size_t joints, std::span<const double> waypoints) {
    std::vector<double> q(waypoints.begin(), waypoints.begin() + static_cast<std::ptrdiff_t>(joints));
    for (std::size_t i = joints; i < waypoints.size(); i += joints)
        if (!std::equal(&waypoints[i], &waypoints[i] + joints, &waypoints[i - joints]))
            q.insert(q.end(), &waypoints[i], &waypoints[i] + joints);
    std::vector<double> near(joints, 1.0);
    for (std::size_t i = 0; i < q.size(); ++i) near[i % joints] = std::max(near[i % joints], std::abs(q[i]));
    const std::size_t count = q.size() / joints;
    std::vector<double> result(q.begin(), q.begin() + static_cast<std::ptrdiff_t>(joints));
    for (std::size_t first = 0; first + 1 < count;) {
        std::size_t last = first + 1;
        while (last + 1 < count && straight(joints, {&q[first * joints], (last + 2 - first) * joints}, near)) ++last;
        result.insert(result.end(), &q[last * joints], &q[last * joints] + joints);
        first = last;
    }
    return result;
}

}  // namespace pinproof
