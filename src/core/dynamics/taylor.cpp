#include "dynamics/taylor.h"

namespace pinproof {
namespace {

using Square = std::array<std::array<double, kMaxCurveDegree + 1>, kMaxCurveDegree + 1>;

constexpr double binomial(std::size_t n, std::size_t k) {
    double value = 1.0;
    for (std::size_t i = 0; i < k; ++i) value = value * static_cast<double>(n - i) / static_cast<double>(i + 1);
    return value;
}

// entry[i][k] is the coefficient of u^k of the Bernstein polynomial B_i of degree n at (1 + u) / 2, which is
// binomial(n, i) (1 + u)^i (1 - u)^(n - i) / 2^n.
constexpr Square powers_of_bernstein(std::size_t n) {
    Square entry{};
    for (std::size_t i = 0; i <= n; ++i)
        for (std::size_t a = 0; a <= i; ++a)
            for (std::size_t b = 0; b <= n - i; ++b)
                entry[i][a + b] += binomial(n, i) * binomial(i, a) * binomial(n - i, b) * (b % 2 ? -1.0 : 1.0) /
                                   static_cast<double>(std::size_t{1} << n);
    return entry;
}

constexpr auto all_powers() {
    std::array<Square, kMaxCurveDegree + 1> of_degree{};
    for (std::size_t n = 0; n <= kMaxCurveDegree; ++n) of_degree[n] = powers_of_bernstein(n);
    return of_degree;
}
constexpr auto kPowers = all_powers();

// entry[k][i] is the Bernstein coefficient i of u^k for the degree D. With u = 2 t - 1, u^k is the sum over j of
// binomial(k, j) 2^j (-1)^(k - j) t^j, and coefficient i of t^j is binomial(i, j) / binomial(D, j).
constexpr Square bernstein_of_powers() {
    Square entry{};
    for (std::size_t k = 0; k <= kDegree; ++k)
        for (std::size_t i = 0; i <= kDegree; ++i)
            for (std::size_t j = 0; j <= k && j <= i; ++j)
                entry[k][i] += binomial(k, j) * static_cast<double>(std::size_t{1} << j) *
                               ((k - j) % 2 ? -1.0 : 1.0) * binomial(i, j) / binomial(kDegree, j);
    return entry;
}
constexpr Square kBernstein = bernstein_of_powers();

}  // namespace

Bernstein bernstein_of(const TaylorModel& a) {
    Bernstein coefficients{};
    for (std::size_t k = 0; k <= kDegree; ++k)
        for (std::size_t i = 0; i <= kDegree; ++i) coefficients[i] += kBernstein[k][i] * a.c[k];
    return coefficients;
}

TaylorModel model_of(const double* coefficients, std::size_t points, std::size_t stride) {
    const Square& powers = kPowers[points - 1];
    TaylorModel model;
    for (std::size_t k = 0; k < points; ++k) {
        double value = 0.0;
        for (std::size_t i = 0; i < points; ++i) value += powers[i][k] * coefficients[i * stride];
        if (k <= kDegree)
            model.c[k] = value;
        else
            model.radius += std::abs(value);
    }
    return model;
}

}  // namespace pinproof
