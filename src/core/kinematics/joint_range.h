// The limits of a joint, and the choice among the angles q + 2 pi k that have the same pose.
//
// A revolute joint with a range of more than 2 pi (those of the UR5 have 4 pi) reaches the same pose at several angles.
// Angles are not wrapped to (-pi, pi], which would discard valid solutions (the sixth joint of the Panda has the range
// [-0.018, 3.752]). Among the angles within the limits, the one closest to a reference is chosen.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace pinproof {

inline constexpr double kTurn = 2.0 * std::numbers::pi;

struct JointRange {
    double lower, upper;  // rad or m
    bool periodic;        // q and q + 2 pi have the same pose of every link
    bool wraps;           // periodic with a range of at least 2 pi: beyond a limit, a descent continues 2 pi away

    // The limits that stop a descent.
    double stop_lower() const { return wraps ? -std::numeric_limits<double>::infinity() : lower; }
    double stop_upper() const { return wraps ? std::numeric_limits<double>::infinity() : upper; }

    bool contains(double value) const { return lower <= value && value <= upper; }
    double clipped(double value) const { return std::min(std::max(value, lower), upper); }
    double stopped(double value) const { return std::min(std::max(value, stop_lower()), stop_upper()); }
    bool finite() const { return upper - lower < std::numeric_limits<double>::infinity(); }

    // The value within the limits: shifted by 2 pi if the range permits, else clipped (which only removes rounding).
    double inside(double value) const {
        if (wraps) value += value > upper ? -kTurn : value < lower ? kTurn : 0.0;
        return clipped(value);
    }

    // The value shifted by multiples of 2 pi within the limits such that it is closest to the reference.
    double nearest_winding(double value, double reference) const {
        if (!periodic || (contains(value) && std::abs(reference - value) <= std::numbers::pi)) return value;
        const double fewest = std::ceil((lower - value) / kTurn), most = std::floor((upper - value) / kTurn);
        const double turns = std::min(std::max(std::nearbyint((reference - value) / kTurn), fewest), most);
        // Only rounding is clipped here: a shifted angle may exceed a limit that is a multiple of 2 pi by one bit.
        return turns == 0.0 ? value : clipped(value + turns * kTurn);
    }
};

// Whether two configurations are the same, up to full rotations of revolute joints. A prismatic joint whose values differ by
// a multiple of 2 pi lengths of the arm is taken as different because the others are.
inline bool same_configuration(const double* a, const double* b, int joints, double tolerance) {
    for (int k = 0; k < joints; ++k) {
        const double gap = std::abs(a[k] - b[k]);
        if (gap > tolerance && std::abs(gap - kTurn * std::floor(gap / kTurn + 0.5)) > tolerance) return false;
    }
    return true;
}

// value + 2 pi k closest to the reference, within [lower - slack, upper + slack] if possible.
inline double nearest_winding(double value, double lower, double upper, double slack, double reference) {
    const double fewest = std::ceil((lower - slack - value) / kTurn);
    const double most = std::floor((upper + slack - value) / kTurn);
    const double rotations = std::min(std::max(std::floor((reference - value) / kTurn + 0.5), fewest), most);
    const double above = value + fewest * kTurn - upper, below = lower - value - most * kTurn;
    return value + (fewest > most && above < below ? fewest : rotations) * kTurn;
}

}  // namespace pinproof
