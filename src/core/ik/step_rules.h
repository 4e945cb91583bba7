// The steps of Clik (damped by the error, and further until the step fits the bound), and those of PseudoInverse and
// DampedLeastSquares, from singular values.
#pragma once

#include <vector>

#include "algebra/singular_values.h"
#include "kinematics/chain.h"

namespace pinproof {

struct ClikStep {
    double damping;

    // Added to the damping, so that the matrix is positive definite if the error is zero. At a residual of 1e-6 from a
    // singular target the relevant singular value is about 1e-3; its square is far larger than this.
    static constexpr double kSmallestDamping = 1e-10;

    // Factor by which the damping grows while a step is too long, and after each step that increased the error; and the
    // factor of that growth after each step that decreased the error.
    static constexpr double kGrowth = 4.0, kRelief = 0.5;

    // 4^20 is 1e12, which is sufficient for any step at a singularity.
    static constexpr int kMostGrowths = 20;

    // step = -A^T (A A^T + lambda I)^-1 pull with lambda = growth damping/2 squared_residual, multiplied by kGrowth
    // until no joint moves by more than `longest`.
    void operator()(double growth, double longest, double squared_residual, const Twist& pull, const Jacobian& jacobian,
                    std::vector<double>& step) const;
};

// The steps of PseudoInverse and DampedLeastSquares, from singular values.
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
