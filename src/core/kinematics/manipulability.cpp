#include "kinematics/manipulability.h"

#include <cmath>

#include "algebra/least_squares.h"

namespace pinproof {
namespace {

// Added to the squares of the singular values, so that the logarithm is finite at singularities.
constexpr double kTiny = 1e-14;

// J^T J of fewer than 6 columns, completed by ones on the diagonal.
Symmetric6 inner_products(const Jacobian& columns) {
    Symmetric6 square;
    const int count = static_cast<int>(columns.size());
    for (int i = 0; i < 6; ++i)
        for (int j = 0; j <= i; ++j) square.m[i][j] = i < count ? dot(columns[i], columns[j]) : i == j ? 1.0 : 0.0;
    return square;
}

}  // namespace

double log_manipulability(const Jacobian& jacobian) {
    Factor6 factor;
    if (!factor.factorise(jacobian.size() < 6 ? inner_products(jacobian) : gram(jacobian), kTiny))
        return std::log(kTiny);
    return 0.5 * factor.log_determinant();
}

}  // namespace pinproof
