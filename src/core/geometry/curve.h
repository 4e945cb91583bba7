// Polynomial curves in the Bernstein basis.
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>

namespace pinproof {

// Polynomial pieces in the Bernstein basis; the control points of piece i belong to the parameters knots[i] to
// knots[i+1].
struct CurveView {
    std::span<const double> knots;    // (pieces + 1)
    std::span<const double> control;  // (pieces, points, dof)
    std::size_t points, dof;          // points = degree + 1

    std::size_t pieces() const { return knots.size() - 1; }
    const double* piece(std::size_t i) const { return control.data() + i * points * dof; }
};

// Bisect a piece (points, dof) into two (de Casteljau). `left` may be the piece itself.
inline void halve(const double* control, std::size_t points, std::size_t dof, double* left, double* right) {
    std::copy_n(control, points * dof, right);
    for (std::size_t r = 0; r < points; ++r) {
        std::copy_n(right, dof, left + r * dof);
        for (std::size_t i = 0; i + 1 < points - r; ++i)
            for (std::size_t j = 0; j < dof; ++j)
                right[i * dof + j] = 0.5 * (right[i * dof + j] + right[(i + 1) * dof + j]);
    }
}

// The value at u of the polynomial with these coefficients, which are overwritten.
inline double value_at(std::span<double> coefficients, double u) {
    for (std::size_t last = coefficients.size() - 1; last > 0; --last)
        for (std::size_t i = 0; i < last; ++i) coefficients[i] = coefficients[i] * (1.0 - u) + coefficients[i + 1] * u;
    return coefficients[0];
}

}  // namespace pinproof
