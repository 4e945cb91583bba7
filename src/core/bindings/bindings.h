// One function for each subject that adds its classes and functions to the module pinproof._core.
#pragma once

#include <nanobind/nanobind.h>

namespace pinproof {

void bind_closed_form(nanobind::module_& module);
void bind_kinematics(nanobind::module_& module);
void bind_ik(nanobind::module_& module);
void bind_tracking(nanobind::module_& module);
void bind_collision(nanobind::module_& module);
void bind_certificate(nanobind::module_& module);
void bind_planning(nanobind::module_& module);
void bind_tours(nanobind::module_& module);
void bind_timing(nanobind::module_& module);
void bind_dynamics(nanobind::module_& module);
void bind_reach(nanobind::module_& module);
void bind_occupancy(nanobind::module_& module);

}  // namespace pinproof
