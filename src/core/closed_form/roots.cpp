#include "closed_form/roots.h"

#include <algorithm>
#include <cmath>
#include <complex>

namespace pinproof {
namespace {

// A root of a quartic with a smaller imaginary part may be real: rounding (1e-16) separates double roots by its square
// root (1e-8), fourfold ones by 1e-4. Forward kinematics verifies the result.
constexpr double kNearlyReal = 1e-3;

constexpr int kMostRounds = 60;        // of Aberth's iteration
constexpr double kConverged = 1e-15;   // relative to the root
constexpr double kSameRoot = 1e-12;    // imaginary part, relative to the root, below which a root is real

Roots one_root(const JointState& state) { return {1, false, {state, state}}; }

Roots solve_prismatic(const LinearEquation& e, const RootSettings& settings) {
    if (std::abs(e.b) < kFree) {
        if (std::abs(e.a) < settings.free) return {0, std::abs(e.c) <= settings.border, {}};
        return one_root(prismatic_state(-e.c / e.a));
    }
    const double half = -0.5 * e.a / e.b;
    const double square = half * half - e.c / e.b;
    if (square < 0.0 && -square * std::abs(e.b) > settings.border) return {};
    const double apart = std::sqrt(std::max(square, settings.spread));
    if (apart == 0.0) return one_root(prismatic_state(half));
    return {2, false, {prismatic_state(half + apart), prismatic_state(half - apart)}};
}

Roots solve_revolute(const LinearEquation& e, const RootSettings& settings) {
    const double rho2 = e.a * e.a + e.b * e.b, rho = std::sqrt(rho2);
    if (rho < settings.free) return {0, std::abs(e.c) <= settings.border + settings.free, {}};
    const double w2 = std::isnan(settings.square) ? rho2 - e.c * e.c : settings.square;
    if (w2 < 0.0 && std::abs(e.c) - rho > settings.border) return {};
    const double w = std::sqrt(std::max(w2, settings.spread * rho2));
    double inverse = 1.0 / rho2;
    if (std::abs(e.c) > rho || settings.spread > 0.0)  // outside the circle: moved back onto it
        inverse = 1.0 / std::sqrt(rho2 * (e.c * e.c + w * w));
    const JointState first{(-e.a * e.c - e.b * w) * inverse, (-e.b * e.c + e.a * w) * inverse};
    const JointState second{(-e.a * e.c + e.b * w) * inverse, (-e.b * e.c - e.a * w) * inverse};
    return {w == 0.0 ? 1 : 2, false, {first, second}};
}

double error_of(double slope, double curvature, double error) {
    return error / std::max({slope, std::sqrt(error * curvature), error});
}

using Complex = std::complex<double>;

// Products and quotients without the special cases for infinities of std::complex.
Complex times(const Complex& a, const Complex& b) {
    return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
}
Complex over(const Complex& a, const Complex& b) {
    const double size = 1.0 / (b.real() * b.real() + b.imag() * b.imag());
    return {(a.real() * b.real() + a.imag() * b.imag()) * size, (a.imag() * b.real() - a.real() * b.imag()) * size};
}

}  // namespace

Roots solve(const LinearEquation& equation, const RootSettings& settings) {
    return equation.prismatic ? solve_prismatic(equation, settings) : solve_revolute(equation, settings);
}

ErrorBound root_error(const LinearEquation& e, const JointState& root, const ErrorBound& of_c) {
    double slope, curvature;
    if (e.prismatic) {
        slope = std::abs(e.a + 2.0 * e.b * root.first);
        curvature = std::abs(e.b);
    } else {
        slope = std::abs(e.b * root.first - e.a * root.second);
        curvature = std::sqrt(e.a * e.a + e.b * e.b);
    }
    if (slope * slope >= of_c.tolerance * curvature && slope > of_c.tolerance && of_c.tolerance >= of_c.rounding)
        return {of_c.rounding / slope, of_c.tolerance / slope};
    return {error_of(slope, curvature, of_c.rounding), error_of(slope, curvature, of_c.tolerance)};
}

QuarticRoots quartic_roots(const double (&a)[5], double nearly) {
    const double b0 = a[0] / a[4], b1 = a[1] / a[4], b2 = a[2] / a[4], b3 = a[3] / a[4];
    const double radius = 0.5 + std::max({std::abs(b3), std::sqrt(std::abs(b2)), std::cbrt(std::abs(b1)),
                                          std::sqrt(std::sqrt(std::abs(b0)))});
    const double centre = -0.25 * b3;
    Complex z[4] = {{radius + centre, 0.35 * radius},
                    {-0.4 * radius + centre, radius},
                    {-radius + centre, -0.3 * radius},
                    {0.45 * radius + centre, -radius}};
    for (int round = 0; round < kMostRounds; ++round) {
        double largest = 0.0;
        for (int i = 0; i < 4; ++i) {
            const Complex value = times(times(times(z[i] + b3, z[i]) + b2, z[i]) + b1, z[i]) + b0;
            if (value == 0.0) continue;
            const Complex slope = times(times(4.0 * z[i] + 3.0 * b3, z[i]) + 2.0 * b2, z[i]) + b1;
            Complex others = 0.0;
            for (int k = 0; k < 4; ++k)
                if (k != i && z[k] != z[i]) others += over(1.0, z[i] - z[k]);
            const Complex below = slope - times(value, others);
            const Complex step = below != 0.0 ? over(value, below) : Complex(1e-3, 1e-3);
            z[i] -= step;
            largest = std::max(largest, std::abs(step) / (1.0 + std::abs(z[i])));
        }
        if (largest < kConverged) break;
    }
    QuarticRoots found;
    for (const Complex& root : z) {
        const double size = 1.0 + std::abs(root), height = std::abs(root.imag());
        if (height >= std::max(kNearlyReal, nearly) * size) continue;
        found.value[found.count++] = root.real() + root.imag();  // a pair has candidates on both sides
        if (height > kSameRoot * size && height < kNearlyReal * size) found.value[found.count++] = root.real();
    }
    std::sort(found.value, found.value + found.count);
    return found;
}

}  // namespace pinproof
