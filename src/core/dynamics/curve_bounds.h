// Bounds of torques and of the motion of the tool over a timed curve, which hold between samples.
//
// Every piece of the curve is a polynomial in time. Torques and tool motion on it are Taylor models (taylor.h), whose
// range is at most that of their Bernstein coefficients, enlarged by the radius. The coefficients at the ends of a piece
// are values of the curve up to the radius, so that both sides of the result are known; a piece whose bound exceeds what
// is enough, and the largest value found, by more than kSlack is bisected.
//
// A trajectory that is slowed down by the factor f keeps its path, so that the torque of the motion is divided by f^2,
// while that of gravity remains. With the torques d of the motion and g of gravity and the limit T,
//
//     |d / f^2 + g| <= T  if and only if  f^2 >= max(d / (T - g), -d / (T + g), 0) ,  provided that |g| < T .
//
// On a piece, d <= F (T - g) holds everywhere if it holds for the Bernstein coefficients, d_i <= F (T - g_i), so that F
// is bounded by the largest quotient of coefficients. Where |g| >= T the arm cannot be held at rest: f is infinite.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "dynamics/grip.h"
#include "dynamics/inverse_dynamics.h"

namespace pinproof {

// Relative difference between the bound of a piece and a value that occurs on it, above which the piece is bisected.
inline constexpr double kSlack = 2e-4;
inline constexpr double kGripSlack = 1e-3;  // for shares of a grip, which are known to kShareTolerance

// Largest number of parts of one piece. The bound of a part that is not bisected any more is valid, but less tight.
inline constexpr std::size_t kMaxParts = 4096;

// A curve in joint space, piece by piece: Bernstein coefficients of the position and its derivatives in time.
struct TimedCurve {
    std::size_t pieces, dof;
    std::array<std::size_t, 3> points;              // number of coefficients per piece and joint
    std::array<std::span<const double>, 3> control;  // (pieces, points, dof) of position, velocity and acceleration
};

// The factor by which each piece must be slowed down to keep the torque limits (dof; infinite for none), at least 0;
// infinite if a joint cannot carry the arm at rest.
void torque_stretch(const DynamicTree& model, const TimedCurve& curve, std::span<const double> limits,
                    std::span<double> stretch);

// Limits of the tool: linear and angular speed (m/s, rad/s), linear and angular acceleration; infinite for none.
using ToolRates = std::array<double, 4>;

void tool_stretch(const DynamicTree& model, const TimedCurve& curve, const ToolRates& limits, std::span<double> stretch);

// A bound of the largest magnitude of a quantity, and where a value within kSlack of it occurs: a piece and a fraction.
struct Peak {
    double bound = 0.0, attained = 0.0;
    std::size_t piece = 0;
    double fraction = 0.0;
};

std::vector<Peak> torque_peaks(const DynamicTree& model, const TimedCurve& curve);
std::vector<Peak> tool_peaks(const DynamicTree& model, const TimedCurve& curve);

// The same for the load of the body of the tool joint on a grip: the factors, at least 1, and the largest share.
void grip_stretch(const DynamicTree& model, const TimedCurve& curve, const Grip& grip, std::span<double> stretch);
Peak grip_peak(const DynamicTree& model, const TimedCurve& curve, const Grip& grip);

}  // namespace pinproof
