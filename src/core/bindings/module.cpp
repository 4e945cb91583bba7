// The Python module pinproof._core.
#include <nanobind/nanobind.h>

#include <stdexcept>

#include "bindings/bindings.h"
#include "source_hash.h"

namespace {

// This file is compiled for every x86-64 processor, the rest of the core for x86-64-v3.
void require_processor() {
#if defined(__x86_64__)
    __builtin_cpu_init();
    if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma") || !__builtin_cpu_supports("bmi2"))
        throw nanobind::import_error("pinproof needs a processor with AVX2, FMA and BMI2 (x86-64-v3: Intel since "
                                     "Haswell, AMD since Excavator)");
#endif
}

}  // namespace

NB_MODULE(_core, module) {
    require_processor();
    module.doc() = "The compiled core of pinproof. It is internal: use the package's public functions.";
    // Python does not destroy cached arms and checkers when it ends; nanobind would report each of them.
    nanobind::set_leak_warnings(false);
    module.attr("SOURCE_HASH") = PINPROOF_SOURCE_HASH;
    pinproof::bind_kinematics(module);
    pinproof::bind_closed_form(module);
    pinproof::bind_ik(module);
    pinproof::bind_tracking(module);
    pinproof::bind_collision(module);
    pinproof::bind_certificate(module);
    pinproof::bind_planning(module);
    pinproof::bind_timing(module);
    pinproof::bind_dynamics(module);
}
