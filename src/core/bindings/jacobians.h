// Jacobians as (6, n) arrays.
#pragma once

#include "bindings/arrays.h"
#include "kinematics/chain.h"

namespace pinproof {

nb::object jacobian_array(const Jacobian& columns);
Jacobian read_jacobian(const Matrix& matrix);

}  // namespace pinproof
