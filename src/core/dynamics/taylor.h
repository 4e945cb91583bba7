// Taylor models: polynomials of one variable with a bound of their error, for ranges that hold between samples.
//
// A model encloses a function f on [-1, 1] by a polynomial p of degree D and a radius r: |f(u) - p(u)| <= r for all u in
// [-1, 1]. Sums, products, sine and cosine of enclosed functions are enclosed again: the terms of a product above degree
// D and the remainders of the series enter the radius. The bound of a function on a piece of a curve is then that of a
// polynomial, whose coefficients in the basis of Bernstein enclose it, plus the radius. Unlike with intervals, quantities
// that depend on the same variable cancel, and the radius decreases with the power D + 1 of the length of the piece.
//
// K. Makino, M. Berz (2003), "Taylor models and other validated functional inclusion methods", International Journal of
// Pure and Applied Mathematics 4(4). Rounding errors of the coefficients are not part of the radius; they are below the
// relative tolerance of all limits (RATE_TOLERANCE of pinproof.motion.limits, 1e-9).
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

#include "geometry/sincos.h"

namespace pinproof {

inline constexpr int kDegree = 3;

struct TaylorModel {
    std::array<double, kDegree + 1> c{};  // of the powers of u
    double radius = 0.0;

    TaylorModel() = default;
    explicit TaylorModel(double constant) { c[0] = constant; }

    // A bound of |f|.
    double size() const {
        double sum = radius;
        for (double each : c) sum += std::abs(each);
        return sum;
    }
};

inline TaylorModel operator+(const TaylorModel& a, const TaylorModel& b) {
    TaylorModel sum;
    for (int i = 0; i <= kDegree; ++i) sum.c[i] = a.c[i] + b.c[i];
    sum.radius = a.radius + b.radius;
    return sum;
}
inline TaylorModel operator-(const TaylorModel& a, const TaylorModel& b) {
    TaylorModel difference;
    for (int i = 0; i <= kDegree; ++i) difference.c[i] = a.c[i] - b.c[i];
    difference.radius = a.radius + b.radius;
    return difference;
}
inline TaylorModel operator*(double s, const TaylorModel& a) {
    TaylorModel product;
    for (int i = 0; i <= kDegree; ++i) product.c[i] = s * a.c[i];
    product.radius = std::abs(s) * a.radius;
    return product;
}
inline TaylorModel operator*(const TaylorModel& a, const TaylorModel& b) {
    TaylorModel product;
    double high[kDegree] = {};  // the coefficients above the degree D
    for (int i = 0; i <= kDegree; ++i)
        for (int j = 0; j <= kDegree; ++j) {
            if (i + j <= kDegree)
                product.c[i + j] += a.c[i] * b.c[j];
            else
                high[i + j - kDegree - 1] += a.c[i] * b.c[j];
        }
    double rest = 0.0, size_a = 0.0, size_b = 0.0;
    for (double each : high) rest += std::abs(each);
    for (int i = 0; i <= kDegree; ++i) {
        size_a += std::abs(a.c[i]);
        size_b += std::abs(b.c[i]);
    }
    product.radius = rest + (size_a + a.radius) * b.radius + size_b * a.radius;
    return product;
}
inline TaylorModel& operator+=(TaylorModel& a, const TaylorModel& b) { return a = a + b; }
inline TaylorModel operator-(const TaylorModel& a) { return -1.0 * a; }

// Sine and cosine. With x = m + d, where m is the constant of the model, both follow from sin d and cos d, whose series
// are cut after the third power of d: |sin d - d + d^3 / 6| <= |d|^5 / 120 and 0 <= cos d - 1 + d^2 / 2 <= d^4 / 24.
inline void sine_cosine(const TaylorModel& x, TaylorModel& sine, TaylorModel& cosine) {
    TaylorModel d = x;
    d.c[0] = 0.0;
    const double most = d.size(), square = most * most;
    const TaylorModel d2 = d * d;
    TaylorModel sin_d = d - (1.0 / 6.0) * (d2 * d);
    sin_d.radius += most * square * square / 120.0;
    TaylorModel cos_d = -0.5 * d2;
    const double half = square * square / 48.0;
    cos_d.c[0] += 1.0 + half;
    cos_d.radius += half;
    const auto [s, c] = sincos_of_any(x.c[0]);
    sine = s * cos_d + c * sin_d;
    cosine = c * cos_d - s * sin_d;
}
inline void sine_cosine(double x, double& sine, double& cosine) {
    const auto [s, c] = sincos_of_any(x);
    sine = s;
    cosine = c;
}

// The coefficients of a polynomial on [-1, 1] in the basis of Bernstein (Farouki 2012): the first and the last one are
// its values at the ends, and its range is within theirs.
using Bernstein = std::array<double, kDegree + 1>;
Bernstein bernstein_of(const TaylorModel& a);

// The largest degree of the pieces of a curve.
inline constexpr std::size_t kMaxCurveDegree = 7;

// The model of a polynomial with `points` Bernstein coefficients that are `stride` apart; at most kMaxCurveDegree + 1.
TaylorModel model_of(const double* coefficients, std::size_t points, std::size_t stride);

}  // namespace pinproof
