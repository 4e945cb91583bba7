// The path to be timed: polynomial pieces q(s) in the Bernstein basis, and where the motion must stop.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace pinproof {

// Limits of the joints (n); no jerk limit if `jerk` is empty.
struct RateLimits {
    std::vector<double> velocity, acceleration, jerk;

    bool smooth() const { return !jerk.empty(); }
};

// Pieces over the parameter s, which is scaled to be similar to the time in seconds.
class TimedPath {
  public:
    static constexpr std::size_t kMaxDegree = 15;

    // Control points (k, degree + 1, n) of pieces between knots (k + 1). The motion stops at knots whose flag (k + 1)
    // is set, and at both ends.
    TimedPath(std::size_t joints, std::span<const double> knots, std::span<const double> control,
              std::span<const char> stops, const RateLimits& limits);

    std::size_t joints() const { return joints_; }
    std::size_t pieces() const { return knots_.size() - 1; }
    std::size_t degree() const { return degree_; }
    const std::vector<double>& knots() const { return knots_; }
    bool straight(std::size_t piece) const { return straight_[piece]; }  // a line with constant derivative
    bool stops(std::size_t knot) const { return stops_[knot]; }          // true at both ends too

    // The piece that contains s; at a knot the later one.
    std::size_t piece_of(double s) const;

    // A derivative (n) of order 0 to 3 on a piece, to which s is clipped.
    void evaluate(std::size_t piece, double s, std::size_t order, double* result) const;

    // The control points (degree + 1 - order, n) of a derivative of order 0 to 3 on a piece.
    std::span<const double> control(std::size_t piece, std::size_t order = 0) const;

    // The largest magnitude of the control points of the fourth derivative of a piece: a bound of that derivative.
    double fourth(std::size_t piece) const;

  private:
    std::size_t joints_, degree_;
    std::vector<double> knots_;
    std::vector<double> control_[4];
    std::vector<char> straight_, stops_;
};

// Whether the control points of a curve differ from each other in any joint.
bool moves(std::size_t joints, std::span<const double> control);

// The flags (k + 1) of the knots at which the tangents of two pieces differ.
std::vector<char> tangent_jumps(std::size_t joints, std::span<const double> knots, std::span<const double> control);

// The waypoints (m, n) at which a motion along a polyline must stop, without repeated ones and those on straight lines.
std::vector<double> corners(std::size_t joints, std::span<const double> waypoints);

}  // namespace pinproof
