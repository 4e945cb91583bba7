// The path parameter s over time, in phases in which s''' is linear.
#pragma once

#include <cstddef>
#include <vector>

namespace pinproof {

inline constexpr double kNano = 1e9;  // nanoseconds in a second

// Shortest phase (s); a shorter one is merged with its neighbour. Otherwise rounding could leave phases of nanoseconds,
// which amplify the rounding of positions by 6 / h^2 to accelerations above any limit.
constexpr double kShortestPhase = 1e-5;

// Shortest phase (s) with a jerk limit, where the rounding of positions is amplified by 60 / h^3.
constexpr double kShortestEdge = 1e-4;

// The values of s and its derivatives.
struct Instant {
    double s = 0.0, speed = 0.0, acceleration = 0.0;
};

// A phase from the values at its beginning. It lies on one step of the grid.
struct Phase {
    double begin, duration;
    Instant from;
    double jerk, snap;  // s''' at the beginning and its derivative
    std::size_t step;

    Instant at(double time) const;  // since the beginning of the profile
    double end() const { return begin + duration; }
};

// Consecutive phases, and those phases (by index) that begin at rest or at the beginning.
struct Profile {
    std::vector<Phase> phases;
    std::vector<std::size_t> runs;

    double duration() const { return phases.empty() ? 0.0 : phases.back().end(); }

    // Append a phase after the last one.
    void append(double duration, const Instant& from, std::size_t step, double jerk = 0.0, double snap = 0.0);

    // The phase at a time; at the end of a phase the next one.
    const Phase& phase_at(double time) const;
};

// The fastest motion over a length between two speeds, with limits of speed and acceleration: rise, cruise and fall (L.
// Biagiotti, C. Melchiorri, "Trajectory Planning for Automatic Machines and Robots", 2008, section 3.2). Phases below
// kShortestPhase are merged. From rest to rest durations are whole nanoseconds.
void append_trapezoid(Profile& profile, double first, double length, double start, double end, double speed,
                      double acceleration, std::size_t step);

// The fastest motion from rest to rest with limits of speed, acceleration and jerk (section 3.4): up to seven phases,
// of whole nanoseconds.
void append_double_s(Profile& profile, double first, double length, double speed, double acceleration, double jerk,
                     std::size_t step);

}  // namespace pinproof
