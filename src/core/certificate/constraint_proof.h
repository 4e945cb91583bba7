// The proof that a whole curve satisfies a constraint: intervals in path order, bisected until each is decided.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "certificate/curve_proof.h"
#include "certificate/path_constraint.h"

namespace pinproof {

struct ConstraintSettings {
    double resolution = 1e-6;           // rad or m; an interval with less motion is not bisected further
    std::int64_t max_intervals = 2000;  // after which the rest of the curve is undecided
    double goal_share = 0.0;            // prove this share of the difference of the tolerance and the largest error found
    std::int64_t look_ahead = 0;        // intervals to check for a violation after an undecided span
    bool record = false;                // store the proven intervals
};

struct FoundViolation {
    double time, error;
    std::vector<double> q;
};

struct UndecidedConstraint {
    double start, end, error;  // error: the largest found there (rad or m)
};

struct ProvenInterval {
    double start, end;
};

struct ConstraintState {
    std::int64_t intervals = 0;
    double observed = 0.0;  // the largest error found (rad or m)
    double proven = 0.0;    // the largest bound of the error on the proven intervals
    std::optional<FoundViolation> violation;
    std::optional<UndecidedConstraint> open;  // the first undecided span
    std::vector<ProvenInterval> evidence;

    bool satisfied() const { return !violation && !open; }
};

// Prove constraint i on a curve, or find a violation, the first one up to the resolution.
ConstraintState prove_constraint(ConstrainedTcp& tcp, std::size_t i, const CurveView& curve,
                                 const ConstraintSettings& settings, const double* joint_tolerance);

}  // namespace pinproof
