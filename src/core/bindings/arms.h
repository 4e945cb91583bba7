// What the bindings of arms share: Jacobians as (6, n) arrays, and goals.
#pragma once

#include <optional>

#include "bindings/arrays.h"
#include "ik/task.h"
#include "kinematics/chain.h"

namespace pinproof {

NewArray jacobian_array(const Jacobian& columns);
Jacobian read_jacobian(const char* name, const Matrix& matrix);

// A goal, which must suit the arm; without one, the goal that does not exist.
Goal goal_for(const std::optional<Goal>& goal, std::size_t dof);

}  // namespace pinproof
