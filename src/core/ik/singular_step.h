// The steps of PseudoInverse and DampedLeastSquares, from singular values.
#pragma once

#include <vector>

#include "algebra/singular_values.h"
#include "kinematics/chain.h"

namespace pinproof {

struct SingularStep {
    double cutoff;   // singular values up to this fraction of the largest are treated as zero
    double damping;  // the largest lambda, for a residual of norm 1; 0 for the pseudo-inverse
    double region;   // the singular value below which the step is damped

    // An entry or a singular value of a Jacobian below this (m or rad) is due to rounding.
    static constexpr double kNothing = 1e-12;

    // step = -A^T (A A^T + lambda^2 I)^-1 pull. With the smallest singular value s within the rank of A,
    // lambda^2 = damping^2 |pull| (1 - (s / region)^2) for s below `region`, else 0.
    void operator()(const Twist& pull, const Jacobian& jacobian, SingularValues& decomposition,
                    std::vector<double>& step) const;
};

}  // namespace pinproof
