#include "ik/step_rules.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "algebra/least_squares.h"

namespace pinproof {

void ClikStep::operator()(double growth, double longest, double squared_residual, const Twist& pull,
                          const Jacobian& jacobian, std::vector<double>& step) const {
    double shift = 0.5 * growth * damping * squared_residual + kSmallestDamping;
    const Symmetric6 square = gram(jacobian);
    Factor6 factor;
    for (int growths = 0; growths < kMostGrowths; ++growths, shift *= kGrowth) {
        if (!factor.factorise(square, shift)) continue;
        const Twist x = factor.solve(pull);
        double largest = 0.0;
        for (std::size_t i = 0; i < jacobian.size(); ++i) {
            step[i] = -dot(jacobian[i], x);
            largest = std::max(largest, std::abs(step[i]));
        }
        if (largest <= longest) return;
    }
}

namespace {

// The smallest singular value within the rank, given the rows that the task omits and the columns that are held.
double smallest_within_rank(const Jacobian& jacobian, const SingularValues& decomposition) {
    Twist rows;  // the largest entry of each row
    int columns = 0;
    for (const Twist& column : jacobian) {
        double largest = 0.0;
        for (int i = 0; i < 3; ++i) {
            rows.linear[i] = std::max(rows.linear[i], std::abs(column.linear[i]));
            rows.angular[i] = std::max(rows.angular[i], std::abs(column.angular[i]));
            largest = std::max({largest, std::abs(column.linear[i]), std::abs(column.angular[i])});
        }
        columns += largest > SingularStep::kNothing;
    }
    int rank = 0;
    for (int i = 0; i < 3; ++i)
        rank += (rows.linear[i] > SingularStep::kNothing) + (rows.angular[i] > SingularStep::kNothing);
    rank = std::min(rank, columns);
    if (rank == 0) return 0.0;
    double values[6];
    for (int i = 0; i < 6; ++i) values[i] = decomposition.value(i);
    std::sort(values, values + 6, std::greater<>());
    return values[rank - 1];
}

}  // namespace

void SingularStep::operator()(const Twist& pull, const Jacobian& jacobian, SingularValues& decomposition,
                              std::vector<double>& step) const {
    decomposition.decompose(jacobian);
    double squared_damping = 0.0;
    if (damping > 0.0) {
        const double share = smallest_within_rank(jacobian, decomposition) / region;
        if (share < 1.0) squared_damping = damping * damping * std::sqrt(squared_norm(pull)) * (1.0 - share * share);
    }
    const double zero = std::max(cutoff * decomposition.largest(), kNothing);
    std::fill(step.begin(), step.end(), 0.0);
    for (int i = 0; i < 6; ++i) {
        const double value = decomposition.value(i);
        if (value <= zero) continue;
        const double along = dot(decomposition.left(i), pull) / (value * value + squared_damping);
        const double* right = decomposition.scaled_right(i);
        for (std::size_t j = 0; j < step.size(); ++j) step[j] -= right[j] * along;
    }
}

}  // namespace pinproof
