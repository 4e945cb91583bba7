// The singular value decomposition of a (6, n) Jacobian.
#pragma once

#include <cstddef>
#include <vector>

#include "kinematics/chain.h"

namespace pinproof {

// J = left diag(values) right, by one-sided Jacobi rotations. The values are not sorted.
//
// Source: Hestenes (1958), "Inversion of matrices by biorthogonalization and related results": rotations of pairs of
// rows of J make all rows orthogonal; then their lengths are the singular values, the unit rows the right singular
// vectors, and the product of the rotations the left ones.
class SingularValues {
  public:
    explicit SingularValues(std::size_t columns) : columns_(columns), rows_(6 * columns) {}

    void decompose(const Jacobian& jacobian);

    double value(int i) const { return values_[i]; }
    double largest() const;

    // Left singular vector i.
    Twist left(int i) const {
        return {Double4{left_[0][i], left_[1][i], left_[2][i], 0.0},
                Double4{left_[3][i], left_[4][i], left_[5][i], 0.0}};
    }

    // Right singular vector i (n,) times its value.
    const double* scaled_right(int i) const { return rows_.data() + i * columns_; }

  private:
    bool rotate(int i, int j);

    std::size_t columns_;
    std::vector<double> rows_;
    double left_[6][6], values_[6];
};

}  // namespace pinproof
