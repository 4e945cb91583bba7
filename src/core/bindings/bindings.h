// One function for each subject that adds its classes and functions to the module pinproof._core.
#pragma once

#include <nanobind/nanobind.h>

namespace pinproof {

void bind_kinematics(nanobind::module_& module);

}  // namespace pinproof
