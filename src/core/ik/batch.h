// The search for many targets.
#pragma once

#include <cstddef>
#include <cstdint>

#include "ik/search.h"

namespace pinproof {

// The results of N targets, by rows.
struct BatchResults {
    double* q;                                   // (N, n)
    double *position_error, *orientation_error;  // (N,) in m and rad
    bool* fulfils;                               // (N,)
    std::int64_t *iterations, *attempts;         // (N,)
};

// Solve for `rows` targets, homogeneous matrices (N, 4, 4), from q0 (N, n). A result depends neither on the number of
// threads nor on the other targets.
void solve_batch(const IkSolver& solver, const Seeds& seeds, const Goal& goal, const double* targets, const double* q0,
                 std::size_t rows, long long count, std::size_t threads, const BatchResults& out);

}  // namespace pinproof
