#include "algebra/eigenvalues.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace pinproof {
namespace {

constexpr int kN = kEigenRows;
constexpr double kEpsilon = std::numeric_limits<double>::epsilon();
constexpr int kMostIterations = 40;  // for one eigenvalue
constexpr int kExceptional = 10;     // after this many iterations, a shift that does not follow the matrix

// A complex number without the tests for infinity that the standard requires of std::complex.
struct Complex {
    double re = 0.0, im = 0.0;
};

Complex operator-(Complex a, Complex b) { return {a.re - b.re, a.im - b.im}; }
Complex operator*(Complex a, Complex b) { return {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re}; }
Complex& operator-=(Complex& a, Complex b) { return a = a - b; }
Complex& operator+=(Complex& a, Complex b) { return a = {a.re + b.re, a.im + b.im}; }
double size(double a) { return std::abs(a); }
double size(Complex a) { return std::abs(a.re) + std::abs(a.im); }
double squared(double a) { return a * a; }
double squared(Complex a) { return a.re * a.re + a.im * a.im; }
double inverse_of(double a) { return 1.0 / a; }
Complex inverse_of(Complex a) {
    const double s = 1.0 / squared(a);
    return {a.re * s, -a.im * s};
}
double conjugate(double a) { return a; }
Complex conjugate(Complex a) { return {a.re, -a.im}; }
void set(double& to, double value) { to = value; }
void set(Complex& to, double value) { to = {value, 0.0}; }
Complex scaled(Complex a, double s) { return {s * a.re, s * a.im}; }
double scaled(double a, double s) { return s * a; }

template <class Scalar>
void normalise(Scalar (&x)[kN]) {
    double total = 0.0;
    for (const Scalar& one : x) total += squared(one);
    const double s = 1.0 / std::sqrt(total);
    for (Scalar& one : x) one = scaled(one, s);
}

// P (H - value) = L U of a Hessenberg matrix: L has one multiplier per column, and P swaps adjacent rows.
template <class Scalar>
struct ShiftedFactors {
    Scalar u[kN][kN], multiplier[kN], inverse[kN];
    bool swapped[kN];

    ShiftedFactors(const EigenMatrix& h, Scalar value, double smallest) {
        for (int i = 0; i < kN; ++i)
            for (int j = std::max(i - 1, 0); j < kN; ++j) {
                set(u[i][j], h[i][j]);
                if (i == j) u[i][j] -= value;
            }
        for (int k = 0; k < kN; ++k) {
            if (k + 1 < kN) {
                swapped[k] = size(u[k + 1][k]) > size(u[k][k]);
                if (swapped[k])
                    for (int j = k; j < kN; ++j) std::swap(u[k][j], u[k + 1][j]);
            }
            if (size(u[k][k]) < smallest) set(u[k][k], smallest);
            inverse[k] = inverse_of(u[k][k]);
            if (k + 1 < kN) {
                multiplier[k] = u[k + 1][k] * inverse[k];
                for (int j = k + 1; j < kN; ++j) u[k + 1][j] -= multiplier[k] * u[k][j];
            }
        }
    }

    void solve_lower(Scalar (&x)[kN]) const {
        for (int k = 0; k + 1 < kN; ++k) {
            if (swapped[k]) std::swap(x[k], x[k + 1]);
            x[k + 1] -= multiplier[k] * x[k];
        }
    }
    void solve_upper(Scalar (&x)[kN]) const {
        for (int i = kN - 1; i >= 0; --i) {
            x[i] = x[i] * inverse[i];
            for (int k = 0; k < i; ++k) x[k] -= u[k][i] * x[i];
        }
    }
    // (H - value)^H y = x
    void solve_adjoint(Scalar (&x)[kN]) const {
        for (int i = 0; i < kN; ++i) {
            x[i] = x[i] * conjugate(inverse[i]);
            for (int k = i + 1; k < kN; ++k) x[k] -= conjugate(u[i][k]) * x[i];
        }
        for (int k = kN - 2; k >= 0; --k) {
            x[k] -= conjugate(multiplier[k]) * x[k + 1];
            if (swapped[k]) std::swap(x[k], x[k + 1]);
        }
    }
    void right_vector(Scalar (&x)[kN]) const {
        for (Scalar& one : x) set(one, 1.0);
        solve_upper(x);
        normalise(x);
        solve_lower(x);
        solve_upper(x);
        normalise(x);
    }
};

template <class Scalar>
double condition_of(const EigenMatrix& h, Scalar value, double smallest) {
    const ShiftedFactors<Scalar> factors(h, value, smallest);
    Scalar x[kN], y[kN], product;
    factors.right_vector(x);
    for (int i = 0; i < kN; ++i) y[i] = x[i];
    for (int round = 0; round < 2; ++round) {
        factors.solve_adjoint(y);
        normalise(y);
    }
    set(product, 0.0);
    for (int i = 0; i < kN; ++i) product += conjugate(y[i]) * x[i];
    return 1.0 / std::max(std::sqrt(squared(product)), kEpsilon);
}

}  // namespace

double HessenbergForm::norm() const {
    double total = 0.0;
    for (const auto& row : h_)
        for (double one : row) total += one * one;
    return std::sqrt(total);
}

void HessenbergForm::reduce(const EigenMatrix& matrix) {
    for (int i = 0; i < kN; ++i)
        for (int j = 0; j < kN; ++j) {
            h_[i][j] = matrix[i][j];
            reflector_[i][j] = 0.0;
        }
    for (int k = 0; k + 2 < kN; ++k) {
        double below = 0.0;
        for (int i = k + 2; i < kN; ++i) below += h_[i][k] * h_[i][k];
        if (below == 0.0) continue;
        const double head = h_[k + 1][k], length = std::sqrt(below + head * head);
        const double image = head > 0.0 ? -length : length;
        double* const v = reflector_[k];
        for (int i = k + 2; i < kN; ++i) v[i] = h_[i][k];
        v[k + 1] = head - image;
        // v scaled such that I - v v^T is the reflection
        const double scale = std::sqrt(2.0 / (below + v[k + 1] * v[k + 1]));
        for (int i = k + 1; i < kN; ++i) v[i] *= scale;
        double row[kN] = {};
        for (int i = k + 1; i < kN; ++i)
            for (int j = 0; j < kN; ++j) row[j] += v[i] * h_[i][j];
        for (int i = k + 1; i < kN; ++i)
            for (int j = 0; j < kN; ++j) h_[i][j] -= v[i] * row[j];
        for (int i = 0; i < kN; ++i) {
            double along = 0.0;
            for (int j = 0; j < kN; ++j) along += h_[i][j] * v[j];
            for (int j = 0; j < kN; ++j) h_[i][j] -= along * v[j];
        }
        for (int i = k + 2; i < kN; ++i) h_[i][k] = 0.0;
    }
}

bool HessenbergForm::eigenvalues(Eigenvalue (&values)[kEigenRows]) const {
    double h[kN][kN];
    for (int i = 0; i < kN; ++i)
        for (int j = 0; j < kN; ++j) h[i][j] = h_[i][j];
    double shifts = 0.0;  // the sum of exceptional shifts
    const double whole = norm();
    int last = kN - 1, iterations = 0;
    while (last >= 0) {
        int first = last;
        for (; first > 0; --first) {
            const double neighbours = std::abs(h[first - 1][first - 1]) + std::abs(h[first][first]);
            if (std::abs(h[first][first - 1]) <= kEpsilon * (neighbours == 0.0 ? whole : neighbours)) {
                h[first][first - 1] = 0.0;
                break;
            }
        }
        double x = h[last][last];
        if (first == last) {
            values[last] = {x + shifts, 0.0};
            --last;
            iterations = 0;
            continue;
        }
        double y = h[last - 1][last - 1], w = h[last][last - 1] * h[last - 1][last];
        if (first == last - 1) {
            const double p = 0.5 * (y - x), square = p * p + w, root = std::sqrt(std::abs(square));
            x += shifts;
            if (square >= 0.0) {
                const double z = p + (p >= 0.0 ? root : -root);
                values[last - 1] = {x + z, 0.0};
                values[last] = {z != 0.0 ? x - w / z : x + z, 0.0};
            } else {
                values[last - 1] = {x + p, root};
                values[last] = {x + p, -root};
            }
            last -= 2;
            iterations = 0;
            continue;
        }
        if (++iterations > kMostIterations) return false;
        if (iterations % kExceptional == 0) {
            shifts += x;
            for (int i = 0; i <= last; ++i) h[i][i] -= x;
            const double s = std::abs(h[last][last - 1]) + std::abs(h[last - 1][last - 2]);
            x = y = 0.75 * s;
            w = -0.4375 * s * s;
        }
        // The first column of (H - s_1)(H - s_2) for the eigenvalues s of the last block, from the row where two adjacent
        // subdiagonal entries are small.
        int m = last - 2;
        double p = 0.0, q = 0.0, r = 0.0;
        for (;; --m) {
            const double z = h[m][m], rr = x - z, s = y - z;
            p = (rr * s - w) / h[m + 1][m] + h[m][m + 1];
            q = h[m + 1][m + 1] - z - rr - s;
            r = h[m + 2][m + 1];
            const double scale = 1.0 / (std::abs(p) + std::abs(q) + std::abs(r));
            p *= scale;
            q *= scale;
            r *= scale;
            if (m == first) break;
            const double u = std::abs(h[m][m - 1]) * (std::abs(q) + std::abs(r));
            const double v = std::abs(p) * (std::abs(h[m - 1][m - 1]) + std::abs(z) + std::abs(h[m + 1][m + 1]));
            if (u <= kEpsilon * v) break;
        }
        for (int i = m + 2; i <= last; ++i) {
            h[i][i - 2] = 0.0;
            if (i > m + 2) h[i][i - 3] = 0.0;
        }
        for (int k = m; k < last; ++k) {
            const bool three = k + 1 < last;
            double scale = 1.0;
            if (k > m) {
                p = h[k][k - 1];
                q = h[k + 1][k - 1];
                r = three ? h[k + 2][k - 1] : 0.0;
                scale = std::abs(p) + std::abs(q) + std::abs(r);
                if (scale == 0.0) continue;
                p /= scale;
                q /= scale;
                r /= scale;
            }
            const double length = std::sqrt(p * p + q * q + r * r), s = p < 0.0 ? -length : length;
            if (k > m)
                h[k][k - 1] = -s * scale;
            else if (first != m)
                h[k][k - 1] = -h[k][k - 1];
            p += s;
            const double a = p / s, b = q / s, c = r / s, qp = q / p, rp = r / p;
            if (three) {
                for (int j = k; j <= last; ++j) {
                    const double t = h[k][j] + qp * h[k + 1][j] + rp * h[k + 2][j];
                    h[k][j] -= t * a;
                    h[k + 1][j] -= t * b;
                    h[k + 2][j] -= t * c;
                }
                const int bottom = std::min(last, k + 3);
                for (int i = first; i <= bottom; ++i) {
                    const double t = a * h[i][k] + b * h[i][k + 1] + c * h[i][k + 2];
                    h[i][k] -= t;
                    h[i][k + 1] -= t * qp;
                    h[i][k + 2] -= t * rp;
                }
            } else {
                for (int j = k; j <= last; ++j) {
                    const double t = h[k][j] + qp * h[k + 1][j];
                    h[k][j] -= t * a;
                    h[k + 1][j] -= t * b;
                }
                for (int i = first; i <= last; ++i) {
                    const double t = a * h[i][k] + b * h[i][k + 1];
                    h[i][k] -= t;
                    h[i][k + 1] -= t * qp;
                }
            }
        }
    }
    return true;
}

void HessenbergForm::eigenvector(double value, double (&vector)[kEigenRows]) const {
    const ShiftedFactors<double> factors(h_, value, kEpsilon * norm());
    factors.right_vector(vector);
    for (int k = kN - 3; k >= 0; --k) {
        double along = 0.0;
        for (int i = 0; i < kN; ++i) along += reflector_[k][i] * vector[i];
        for (int i = 0; i < kN; ++i) vector[i] -= along * reflector_[k][i];
    }
}

double HessenbergForm::condition(const Eigenvalue& value) const {
    const double smallest = kEpsilon * norm();
    if (value.imaginary == 0.0) return condition_of<double>(h_, value.real, smallest);
    return condition_of<Complex>(h_, Complex{value.real, value.imaginary}, smallest);
}

}  // namespace pinproof
