#include "algebra/singular_values.h"

#include <algorithm>
#include <cmath>

namespace pinproof {
namespace {

constexpr int kMostSweeps = 30;        // sweeps converge quadratically: six are the usual number
constexpr double kOrthogonal = 1e-15;  // rows count as orthogonal when their cosine is below this

// (x, y) becomes (cosine x - sine y, sine x + cosine y).
void rotate_pair(double& x, double& y, double cosine, double sine) {
    const double before = x;
    x = cosine * before - sine * y;
    y = sine * before + cosine * y;
}

}  // namespace

void SingularValues::decompose(const Jacobian& jacobian) {
    for (std::size_t k = 0; k < columns_; ++k)
        for (int i = 0; i < 3; ++i) {
            rows_[i * columns_ + k] = jacobian[k].linear[i];
            rows_[(i + 3) * columns_ + k] = jacobian[k].angular[i];
        }
    for (int i = 0; i < 6; ++i)
        for (int j = 0; j < 6; ++j) left_[i][j] = i == j ? 1.0 : 0.0;
    for (int sweep = 0; sweep < kMostSweeps; ++sweep) {
        bool rotated = false;
        for (int i = 0; i < 5; ++i)
            for (int j = i + 1; j < 6; ++j) rotated = rotate(i, j) || rotated;
        if (!rotated) break;
    }
    for (int i = 0; i < 6; ++i) {
        const double* row = rows_.data() + i * columns_;
        double total = 0.0;
        for (std::size_t k = 0; k < columns_; ++k) total += row[k] * row[k];
        values_[i] = std::sqrt(total);
    }
}

// Make rows i and j orthogonal; returns whether they were not.
bool SingularValues::rotate(int i, int j) {
    double *x = rows_.data() + i * columns_, *y = rows_.data() + j * columns_;
    double a = 0.0, b = 0.0, c = 0.0;
    for (std::size_t k = 0; k < columns_; ++k) {
        a += x[k] * x[k];
        b += y[k] * y[k];
        c += x[k] * y[k];
    }
    if (!(c * c > kOrthogonal * kOrthogonal * a * b)) return false;
    const double cotangent = (b - a) / (2.0 * c);  // of twice the angle
    const double tangent =
        (cotangent >= 0.0 ? 1.0 : -1.0) / (std::abs(cotangent) + std::sqrt(1.0 + cotangent * cotangent));
    const double cosine = 1.0 / std::sqrt(1.0 + tangent * tangent), sine = cosine * tangent;
    for (std::size_t k = 0; k < columns_; ++k) rotate_pair(x[k], y[k], cosine, sine);
    for (auto& row : left_) rotate_pair(row[i], row[j], cosine, sine);
    return true;
}

double SingularValues::largest() const { return *std::max_element(values_, values_ + 6); }

}  // namespace pinproof
