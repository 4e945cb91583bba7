// The Python module pinproof._core.
#include <nanobind/nanobind.h>

#if defined(__x86_64__)
#include <cpuid.h>
#endif

#include <stdexcept>

#include "source_hash.h"

namespace pinproof {

// Each adds the classes and functions of a subject to the module.
void bind_arms(nanobind::module_& module);
void bind_closed_form(nanobind::module_& module);
void bind_collision(nanobind::module_& module);
void bind_certificate(nanobind::module_& module);
void bind_timing(nanobind::module_& module);
void bind_planning(nanobind::module_& module);
void bind_reach(nanobind::module_& module);
void bind_web(nanobind::module_& module);

}  // namespace pinproof

namespace {

// This file is compiled for every x86-64 processor, the rest of the core for x86-64-v3, except in the second module of a
// wheel (PINPROOF_BASELINE). The instruction CPUID is read directly, because not every compiler's library implements
// __builtin_cpu_supports.
#if defined(__x86_64__) && !defined(PINPROOF_BASELINE)
bool has_x86_64_v3() {
    unsigned a = 0, b = 0, c = 0, d = 0;
    if (!__get_cpuid(1, &a, &b, &c, &d)) return false;
    const bool fma = c & bit_FMA, saves_registers = c & bit_OSXSAVE;
    if (!fma || !saves_registers || !__get_cpuid_count(7, 0, &a, &b, &c, &d)) return false;
    const bool avx2 = b & bit_AVX2, bmi2 = b & bit_BMI2;
    unsigned low = 0, high = 0;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    constexpr unsigned wide_registers = 6;  // the operating system preserves the registers of SSE and AVX
    return avx2 && bmi2 && (low & wide_registers) == wide_registers;
}
#endif

void require_processor() {
#if defined(__x86_64__) && !defined(PINPROOF_BASELINE)
    if (!has_x86_64_v3())
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
    using namespace pinproof;
    for (auto* bind :
         {bind_arms, bind_closed_form, bind_collision, bind_certificate, bind_timing, bind_planning, bind_reach, bind_web})
        bind(module);
}
