// The manipulability of an arm.
#pragma once

#include "kinematics/chain.h"

namespace pinproof {

// The logarithm of sqrt(det(J J^T + tiny I)); with fewer than 6 joints of J^T J in its place.
//
// Source: Yoshikawa (1985), "Manipulability of robotic mechanisms".
double log_manipulability(const Jacobian& jacobian);

}  // namespace pinproof
