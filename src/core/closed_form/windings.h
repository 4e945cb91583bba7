// Full rotations of revolute joints.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

namespace pinproof {

inline constexpr double kFullRotation = 2.0 * std::numbers::pi;

// value + 2 pi k closest to the reference, within [lower - slack, upper + slack] if possible.
inline double nearest_winding(double value, double lower, double upper, double slack, double reference) {
    const double fewest = std::ceil((lower - slack - value) / kFullRotation);
    const double most = std::floor((upper + slack - value) / kFullRotation);
    const double rotations = std::min(std::max(std::floor((reference - value) / kFullRotation + 0.5), fewest), most);
    const double above = value + fewest * kFullRotation - upper, below = lower - value - most * kFullRotation;
    return value + (fewest > most && above < below ? fewest : rotations) * kFullRotation;
}

}  // namespace pinproof
