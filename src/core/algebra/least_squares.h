// Symmetric positive definite 6 x 6 systems of damped least squares.
#pragma once

#include <cmath>

#include "kinematics/chain.h"

namespace pinproof {

// The lower triangle of a symmetric 6 x 6 matrix.
struct Symmetric6 {
    double m[6][6];
};

// A A^T of A, given by its columns.
inline Symmetric6 gram(const Jacobian& columns) {
    Double4 linear[3] = {}, mixed[3] = {}, angular[3] = {};
    for (const Twist& a : columns)
        for (int i = 0; i < 3; ++i) {
            linear[i] += a.linear[i] * a.linear;
            mixed[i] += a.angular[i] * a.linear;
            angular[i] += a.angular[i] * a.angular;
        }
    Symmetric6 square;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            square.m[i][j] = linear[i][j];
            square.m[i + 3][j] = mixed[i][j];
            square.m[i + 3][j + 3] = angular[i][j];
        }
    return square;
}

// The factors L D L^T of a symmetric positive definite 6 x 6 matrix, with a unit lower triangle L and a diagonal D. Number
// is a double, or several of them in lanes.
template <class Number>
class Ldlt6 {
  public:
    // Factorise `square + shift I`, of which the lower triangle is read. Returns whether all pivots are positive, in each
    // lane; if not, nothing else may be used.
    auto factorise(const Number (&square)[6][6], Number shift) {
        auto positive = shift == shift;
#pragma GCC unroll 6
        for (int i = 0; i < 6; ++i) {
            Number pivot = square[i][i] + shift;
#pragma GCC unroll 6
            for (int j = 0; j < i; ++j) {
                Number total = square[i][j];  // becomes L_ij D_j
#pragma GCC unroll 6
                for (int k = 0; k < j; ++k) total -= scaled_[i][k] * lower_[j][k];
                scaled_[i][j] = total;
                lower_[i][j] = total * inverse_[j];
                pivot -= total * lower_[i][j];
            }
            positive &= pivot > 0.0;
            inverse_[i] = 1.0 / pivot;
        }
        return positive;
    }

    // Replaces x by the solution y of (L D L^T) y = x.
    void solve(Number (&x)[6]) const {
#pragma GCC unroll 6
        for (int i = 1; i < 6; ++i)
#pragma GCC unroll 6
            for (int k = 0; k < i; ++k) x[i] -= lower_[i][k] * x[k];
#pragma GCC unroll 6
        for (int i = 0; i < 6; ++i) x[i] *= inverse_[i];
#pragma GCC unroll 6
        for (int i = 4; i >= 0; --i)
#pragma GCC unroll 6
            for (int k = i + 1; k < 6; ++k) x[i] -= lower_[k][i] * x[k];
    }

    // The diagonal of D^-1.
    const Number (&inverse_pivots() const)[6] { return inverse_; }

  private:
    Number lower_[6][6], scaled_[6][6], inverse_[6];
};

// Solutions of (A A^T + shift I) x = b.
class Factor6 {
  public:
    // Returns whether all pivots are positive; if not, nothing else may be used.
    bool factorise(const Symmetric6& square, double shift) { return factors_.factorise(square.m, shift); }

    Twist solve(const Twist& right) const {
        double x[6] = {right.linear[0],  right.linear[1],  right.linear[2],
                       right.angular[0], right.angular[1], right.angular[2]};
        factors_.solve(x);
        return {Double4{x[0], x[1], x[2], 0.0}, Double4{x[3], x[4], x[5], 0.0}};
    }

    double log_determinant() const {
        double total = 0.0;
        for (double inverse : factors_.inverse_pivots()) total -= std::log(inverse);
        return total;
    }

  private:
    Ldlt6<double> factors_;
};

}  // namespace pinproof
