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

#include "geometry/lanes.h"
#include "geometry/sincos.h"

namespace pinproof {

inline constexpr int kDegree = 3;  // so that the coefficients fill one vector register

struct TaylorModel {
    Double4 c = {};  // the coefficients of the powers of u
    double radius = 0.0;

    TaylorModel() = default;
    explicit TaylorModel(double constant) : c{constant, 0.0, 0.0, 0.0} {}
    TaylorModel(Double4 coefficients, double radius) : c(coefficients), radius(radius) {}

    // A bound of |f|.
    double size() const { return sum_of_sizes(c) + radius; }

    static double sum_of_sizes(Double4 a) { return sum(a < 0.0 ? -a : a); }
};

inline TaylorModel operator+(const TaylorModel& a, const TaylorModel& b) {
    return {a.c + b.c, a.radius + b.radius};
}
inline TaylorModel operator-(const TaylorModel& a, const TaylorModel& b) {
    return {a.c - b.c, a.radius + b.radius};
}
inline TaylorModel operator*(double s, const TaylorModel& a) { return {s * a.c, std::abs(s) * a.radius}; }
inline TaylorModel operator*(const TaylorModel& a, const TaylorModel& b) {
    // Both rows of the product of two polynomials: the powers 0 to 3, and the powers 4 to 6, which enter the radius.
    const Double4 zero = {};
    const Double4 low = a.c[0] * b.c + a.c[1] * __builtin_shufflevector(b.c, zero, 4, 0, 1, 2) +
                        a.c[2] * __builtin_shufflevector(b.c, zero, 4, 4, 0, 1) +
                        a.c[3] * __builtin_shufflevector(b.c, zero, 4, 4, 4, 0);
    const Double4 high = a.c[1] * __builtin_shufflevector(b.c, zero, 3, 4, 4, 4) +
                         a.c[2] * __builtin_shufflevector(b.c, zero, 2, 3, 4, 4) +
                         a.c[3] * __builtin_shufflevector(b.c, zero, 1, 2, 3, 4);
    return {low, TaylorModel::sum_of_sizes(high) + a.size() * b.radius + TaylorModel::sum_of_sizes(b.c) * a.radius};
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
