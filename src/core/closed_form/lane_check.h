// Forward kinematics of several configurations at once, one per lane, so that every step is a vector instruction.
//
// It verifies the closed forms: it evaluates the arm's own chain and shares no code with them.
#pragma once

#include "kinematics/chain.h"

namespace pinproof {

inline constexpr int kWideLanes = 8;
inline constexpr int kMostJoints = 8;  // of an arm with a closed form

// Configurations, one per lane; every lane must hold finite numbers.
struct LaneConfigurations {
    alignas(64) double q[kMostJoints][kWideLanes] = {};
};

struct LaneErrors {
    alignas(64) double distance[kWideLanes], angle[kWideLanes];  // m, rad
};

// How far the tcp is from the target at each configuration.
LaneErrors check_lanes(const Chain& chain, const Transform& target, const LaneConfigurations& configurations);

}  // namespace pinproof
