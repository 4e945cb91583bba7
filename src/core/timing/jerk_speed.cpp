#include "timing/jerk_speed.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace pinproof {
namespace {

// Maximum number of Newton steps.
constexpr int kRounds = 60;

// Sum of complementarity products, relative to the duration, at which the solution is accurate enough.
constexpr double kGap = 5e-4;

// Largest violation of a limit, relative to it, of an accurate solution; the verification of the motion follows.
constexpr double kViolation = 1e-5;

// Fraction of the distance to the boundary of the feasible set that a step may take.
constexpr double kFraction = 0.95;

// Largest factor by which x may decrease and increase in one step, so that tangents remain useful.
constexpr double kShrink = 0.2, kGrow = 6.0;

// x and a at both ends of a step.
using Local = std::array<double, 4>;  // x0, a0, x1, a1

class Solver {
  public:
    Solver(const JerkProblem& problem, std::span<const double> x)
        : p_(problem),
          n_(problem.steps()),
          pairs_(2 * n_ * (problem.joints + problem.rows)),
          width_(problem.step.begin(), problem.step.end()),
          c_(n_ + 2),
          dc_(n_ + 2),
          x_(n_ + 1),
          a_(n_ + 1),
          v_(n_ + 1),
          mean_(n_),
          diagonal_(3 * (n_ + 2)),
          right_(n_ + 2),
          ceiling_(n_ + 2),
          ceiling_slack_(n_ + 2),
          ceiling_dual_(n_ + 2) {
        if (p_.start == 0.0) width_.front() *= 1.5;
        if (p_.end == 0.0) width_.back() *= 1.5;
        for (std::size_t i = 2; i < n_; ++i) c_[i] = 0.5 * (x[i - 1] + x[i]);
        // A coefficient belongs to the middle of a step. Limits on x at the nodes would permit oscillations between them.
        for (std::size_t i = 2; i < n_; ++i) ceiling_[i] = 0.5 * (p_.ceiling[i - 1] + p_.ceiling[i]);
        c_[0] = c_[1] = p_.start;
        c_[n_] = c_[n_ + 1] = p_.end;
        for (auto* side : {&slack_[0], &slack_[1], &dual_[0], &dual_[1]}) side->resize(pairs_);
        value_.resize(pairs_);
        change_.resize(pairs_);
    }

    JerkSolution solve() {
        follow();
        evaluate();
        initialise();
        JerkSolution result;
        for (; result.rounds < kRounds; ++result.rounds) {
            const double gap = complementarity();
            if (gap <= kGap * duration() && violation() <= kViolation) break;
            if (!newton(gap)) break;
            follow();
            evaluate();
        }
        for (int i = 0; i < 30; ++i) follow();
        evaluate();
        result.excess = violation();
        result.x = x_;
        result.a = a_;
        result.duration.resize(n_);
        for (std::size_t k = 0; k < n_; ++k) result.duration[k] = width_[k] / mean_[k];
        return result;
    }

  private:
    // x, a and the speeds from the coefficients and the widths.
    void expand() {
        for (std::size_t k = 0; k <= n_; ++k) {
            const double before = k > 0 ? width_[k - 1] : 0.0, after = k < n_ ? width_[k] : 0.0;
            a_[k] = (c_[k + 1] - c_[k]) / (before + after);
            x_[k] = std::max(c_[k] + a_[k] * before, 0.0);
            v_[k] = std::sqrt(x_[k]);
        }
        for (std::size_t k = 0; k < n_; ++k) mean_[k] = 0.5 * (v_[k] + v_[k + 1]);
    }

    // Let the widths follow the solution.
    void follow() {
        expand();
        for (std::size_t k = 0; k < n_; ++k) {
            const double h = width_[k] / mean_[k], length = p_.step[k];
            width_[k] = length + std::clamp((a_[k + 1] - a_[k]) * h * h / 12.0, -0.4 * length, 0.6 * length);
        }
        expand();
    }

    double duration() const {
        double total = 0.0;
        for (std::size_t k = 0; k < n_; ++k) total += width_[k] / mean_[k];
        return total;
    }

    // x0, a0, x1, a1 of a step as functions of its three coefficients.
    std::array<std::array<double, 3>, 4> weights(std::size_t k) const {
        const double before = k > 0 ? width_[k - 1] : 0.0, here = width_[k], after = k + 1 < n_ ? width_[k + 1] : 0.0;
        const double first = 1.0 / (before + here), second = 1.0 / (here + after);
        return {{{here * first, before * first, 0.0},
                 {-first, first, 0.0},
                 {0.0, after * second, here * second},
                 {0.0, -second, second}}};
    }


    // The derivative of the logarithm of the mean speed in x0 and x1: the decrease of the limit J / speed.
    std::array<double, 2> tangent(std::size_t k) const {
        return {v_[k] > 0.0 ? 0.25 / (v_[k] * mean_[k]) : 0.0, v_[k + 1] > 0.0 ? 0.25 / (v_[k + 1] * mean_[k]) : 0.0};
    }

    std::size_t pair(std::size_t k, std::size_t side, std::size_t row) const {
        return (2 * k + side) * (p_.joints + p_.rows) + row;
    }

    // The gradient of a pair's value in (x0, a0, x1, a1).
    Local jerk_gradient(std::size_t k, std::size_t side, std::size_t j) const {
        const std::size_t entry = (2 * k + side) * p_.joints + j;
        const double scale = mean_[k] / p_.jerk[k * p_.joints + j], rise = p_.slope[entry] * scale / width_[k];
        const double ratio = v_[k + side] / mean_[k] * scale;
        Local g{0.0, -rise, 0.0, rise};
        g[2 * side] += ratio * p_.third[entry];
        g[2 * side + 1] += 3.0 * ratio * p_.curvature[entry];
        return g;
    }

    Local rate_gradient(std::size_t k, std::size_t side, std::size_t r) const {
        const std::size_t entry = (2 * k + side) * p_.rows + r;
        const double scale = 1.0 / std::max(p_.bound[entry], 1e-300);
        Local g{};
        g[2 * side] = p_.beta[entry] * scale;
        g[2 * side + 1] = p_.alpha[entry] * scale;
        return g;
    }

    double offset(std::size_t k, std::size_t side, std::size_t r) const {
        const std::size_t entry = (2 * k + side) * p_.rows + r;
        return p_.gamma[entry] / std::max(p_.bound[entry], 1e-300);
    }

    Local local(const std::vector<double>& x, const std::vector<double>& a, std::size_t k) const {
        return {x[k], a[k], x[k + 1], a[k + 1]};
    }

    static double dot(const Local& u, const Local& w) { return u[0] * w[0] + u[1] * w[1] + u[2] * w[2] + u[3] * w[3]; }

    // The values of all pairs.
    void evaluate() {
        for (std::size_t k = 0; k < n_; ++k) {
            const Local at = local(x_, a_, k);
            for (std::size_t side = 0; side < 2; ++side) {
                for (std::size_t j = 0; j < p_.joints; ++j)
                    value_[pair(k, side, j)] = dot(jerk_gradient(k, side, j), at);
                for (std::size_t r = 0; r < p_.rows; ++r)
                    value_[pair(k, side, p_.joints + r)] = dot(rate_gradient(k, side, r), at) + offset(k, side, r);
            }
        }
    }

    void initialise() {
        const double target = duration() / static_cast<double>(2 * pairs_);
        for (std::size_t i = 0; i < pairs_; ++i)
            for (std::size_t sign = 0; sign < 2; ++sign) {
                slack_[sign][i] = std::max(1.0 - (sign ? -value_[i] : value_[i]), 0.3);
                dual_[sign][i] = target / slack_[sign][i];
            }
        for (std::size_t i = 2; i < n_; ++i) {
            ceiling_slack_[i] = std::max(1.0 - c_[i] / ceiling_[i], 0.1);
            ceiling_dual_[i] = target / ceiling_slack_[i];
        }
    }

    double complementarity() const {
        double sum = 0.0;
        for (std::size_t sign = 0; sign < 2; ++sign)
            for (std::size_t i = 0; i < pairs_; ++i) sum += slack_[sign][i] * dual_[sign][i];
        for (std::size_t i = 2; i < n_; ++i) sum += ceiling_slack_[i] * ceiling_dual_[i];
        return sum;
    }

    double violation() const {
        double most = 0.0;
        for (double value : value_) most = std::max(most, std::abs(value) - 1.0);
        for (std::size_t i = 2; i < n_; ++i) most = std::max(most, c_[i] / ceiling_[i] - 1.0);
        return most;
    }

    // Visit each inequality: f(sign, pair, gradient in the local variables of step k, k).
    template <class Visit>
    void visit(const Visit& f) const {
        for (std::size_t k = 0; k < n_; ++k) {
            const auto decrease = tangent(k);
            for (std::size_t side = 0; side < 2; ++side) {
                for (std::size_t j = 0; j < p_.joints; ++j) {
                    const Local g = jerk_gradient(k, side, j);
                    f(std::size_t{0}, pair(k, side, j), Local{g[0] + decrease[0], g[1], g[2] + decrease[1], g[3]}, k);
                    f(std::size_t{1}, pair(k, side, j), Local{decrease[0] - g[0], -g[1], decrease[1] - g[2], -g[3]}, k);
                }
                for (std::size_t r = 0; r < p_.rows; ++r) {
                    const Local g = rate_gradient(k, side, r);
                    f(std::size_t{0}, pair(k, side, p_.joints + r), g, k);
                    f(std::size_t{1}, pair(k, side, p_.joints + r), Local{-g[0], -g[1], -g[2], -g[3]}, k);
                }
            }
        }
    }

    // The residual of an inequality: value + slack - 1.
    double residual(std::size_t sign, std::size_t i) const {
        return (sign ? -value_[i] : value_[i]) + slack_[sign][i] - 1.0;
    }

    double ceiling_residual(std::size_t i) const { return c_[i] / ceiling_[i] + ceiling_slack_[i] - 1.0; }

    // Add a local Hessian (upper triangle) and gradient to the banded system.
    void scatter(std::size_t k, const double (&hessian)[4][4], const Local& gradient) {
        const auto w = weights(k);
        for (std::size_t i = 0; i < 3; ++i) {
            double g = 0.0;
            for (std::size_t l = 0; l < 4; ++l) g += w[l][i] * gradient[l];
            right_[k + i] -= g;
            for (std::size_t j = i; j < 3; ++j) {
                double sum = 0.0;
                for (std::size_t l = 0; l < 4; ++l)
                    for (std::size_t m = 0; m < 4; ++m) sum += w[l][i] * w[m][j] * hessian[std::min(l, m)][std::max(l, m)];
                diagonal_[3 * (k + i) + (j - i)] += sum;
            }
        }
    }

    // The Newton system for complementarity products `target` minus `correction` per inequality.
    template <class Correction>
    void assemble(bool with_matrix, double target, const Correction& correction) {
        if (with_matrix) std::fill(diagonal_.begin(), diagonal_.end(), 0.0);
        std::fill(right_.begin(), right_.end(), 0.0);
        double hessian[4][4] = {};
        Local gradient{};
        std::size_t current = 0;
        const auto flush = [&](std::size_t k) {
            objective(k, hessian, gradient);
            if (!with_matrix)
                for (auto& row : hessian) std::fill(row, row + 4, 0.0);
            scatter(k, hessian, gradient);
            for (auto& row : hessian) std::fill(row, row + 4, 0.0);
            gradient = {};
        };
        visit([&](std::size_t sign, std::size_t i, const Local& g, std::size_t k) {
            if (k != current) {
                flush(current);
                current = k;
            }
            const double inverse = 1.0 / slack_[sign][i], ratio = dual_[sign][i] * inverse;
            const double weight = (target - correction(sign, i)) * inverse + ratio * residual(sign, i);
            for (std::size_t l = 0; l < 4; ++l) {
                gradient[l] += weight * g[l];
                if (with_matrix)
                    for (std::size_t m = l; m < 4; ++m) hessian[l][m] += ratio * g[l] * g[m];
            }
        });
        flush(current);
        for (std::size_t i = 2; i < n_; ++i) {
            const double inverse = 1.0 / ceiling_[i], ratio = ceiling_dual_[i] / ceiling_slack_[i];
            if (with_matrix) diagonal_[3 * i] += ratio * inverse * inverse;
            right_[i] -= inverse * ((target - correction(2, i)) / ceiling_slack_[i] + ratio * ceiling_residual(i));
        }
    }

    // Add the duration w / mean of a step, with mean = (sqrt(x0) + sqrt(x1)) / 2.
    void objective(std::size_t k, double (&hessian)[4][4], Local& gradient) const {
        const double h = width_[k] / mean_[k];
        double slope[2];  // d mean / d x
        for (std::size_t side = 0; side < 2; ++side) slope[side] = v_[k + side] > 0.0 ? 0.25 / v_[k + side] : 0.0;
        for (std::size_t side = 0; side < 2; ++side) {
            gradient[2 * side] -= h / mean_[k] * slope[side];
            hessian[2 * side][2 * side] += 2.0 * h / (mean_[k] * mean_[k]) * slope[side] * slope[side];
            if (v_[k + side] > 0.0)
                hessian[2 * side][2 * side] += h / mean_[k] * 0.125 / (v_[k + side] * x_[k + side]);
        }
        hessian[0][2] += 2.0 * h / (mean_[k] * mean_[k]) * slope[0] * slope[1];
    }

    // Cholesky factorisation of the matrix of the free coefficients 2 .. n - 1, in place.
    bool factorise() {
        for (std::size_t i = 2; i < n_; ++i) {
            double* row = &diagonal_[3 * i];
            double pivot = row[0];
            if (i >= 3) pivot -= square(diagonal_[3 * (i - 1) + 1]);
            if (i >= 4) pivot -= square(diagonal_[3 * (i - 2) + 2]);
            if (!(pivot > 0.0) || !std::isfinite(pivot)) return false;
            row[0] = std::sqrt(pivot);
            if (i >= 3) row[1] -= diagonal_[3 * (i - 1) + 1] * diagonal_[3 * (i - 1) + 2];
            row[1] = i + 1 < n_ ? row[1] / row[0] : 0.0;
            row[2] = i + 2 < n_ ? row[2] / row[0] : 0.0;
        }
        return true;
    }

    static double square(double t) { return t * t; }

    // The change of the coefficients, and of x, a and the values.
    void substitute() {
        std::fill(dc_.begin(), dc_.end(), 0.0);
        for (std::size_t i = 2; i < n_; ++i) {
            double sum = right_[i];
            if (i >= 3) sum -= diagonal_[3 * (i - 1) + 1] * dc_[i - 1];
            if (i >= 4) sum -= diagonal_[3 * (i - 2) + 2] * dc_[i - 2];
            dc_[i] = sum / diagonal_[3 * i];
        }
        for (std::size_t i = n_; i-- > 2;) {
            double sum = dc_[i];
            if (i + 1 < n_) sum -= diagonal_[3 * i + 1] * dc_[i + 1];
            if (i + 2 < n_) sum -= diagonal_[3 * i + 2] * dc_[i + 2];
            dc_[i] = sum / diagonal_[3 * i];
        }
        dx_.resize(n_ + 1);
        da_.resize(n_ + 1);
        for (std::size_t k = 0; k <= n_; ++k) {
            const double before = k > 0 ? width_[k - 1] : 0.0, after = k < n_ ? width_[k] : 0.0;
            da_[k] = (dc_[k + 1] - dc_[k]) / (before + after);
            dx_[k] = dc_[k] + da_[k] * before;
        }
    }

    struct Lengths {
        double primal = 1.0, dual = 1.0;
    };

    // The changes of slacks and duals, and the largest steps within the positive orthant.
    template <class Correction>
    Lengths directions(double target, const Correction& correction) {
        Lengths lengths;
        for (auto* v : {&dslack_[0], &dslack_[1], &ddual_[0], &ddual_[1]}) v->resize(pairs_);
        dceiling_slack_.resize(n_ + 2);
        dceiling_dual_.resize(n_ + 2);
        std::size_t current = n_;
        Local change{};
        const auto limit = [&](double value, double step, double& length) {
            if (step < 0.0 && -step * length > value) length = -value / step;
        };
        visit([&](std::size_t sign, std::size_t i, const Local& g, std::size_t k) {
            if (k != current) {
                change = local(dx_, da_, k);
                current = k;
            }
            const double slack = slack_[sign][i], dual = dual_[sign][i];
            const double dslack = -residual(sign, i) - dot(g, change);
            const double ddual = (target - correction(sign, i) - dual * dslack) / slack - dual;
            dslack_[sign][i] = dslack;
            ddual_[sign][i] = ddual;
            limit(slack, dslack, lengths.primal);
            limit(dual, ddual, lengths.dual);
        });
        for (std::size_t i = 2; i < n_; ++i) {
            const double slack = ceiling_slack_[i], dual = ceiling_dual_[i];
            dceiling_slack_[i] = -ceiling_residual(i) - dc_[i] / ceiling_[i];
            dceiling_dual_[i] = (target - correction(2, i) - dual * dceiling_slack_[i]) / slack - dual;
            limit(slack, dceiling_slack_[i], lengths.primal);
            limit(dual, dceiling_dual_[i], lengths.dual);
        }
        return lengths;
    }

    // The sum of complementarity products after a step.
    double after(const Lengths& lengths) const {
        double sum = 0.0;
        for (std::size_t sign = 0; sign < 2; ++sign)
            for (std::size_t i = 0; i < pairs_; ++i)
                sum += (slack_[sign][i] + lengths.primal * dslack_[sign][i]) *
                       (dual_[sign][i] + lengths.dual * ddual_[sign][i]);
        for (std::size_t i = 2; i < n_; ++i)
            sum += (ceiling_slack_[i] + lengths.primal * dceiling_slack_[i]) *
                   (ceiling_dual_[i] + lengths.dual * dceiling_dual_[i]);
        return sum;
    }

    // One predictor-corrector step. False if the matrix is not positive definite.
    bool newton(double gap) {
        const double count = static_cast<double>(2 * pairs_ + n_ - 2);
        assemble(true, 0.0, [](std::size_t, std::size_t) { return 0.0; });
        if (!factorise()) return false;
        substitute();
        const Lengths affine = directions(0.0, [](std::size_t, std::size_t) { return 0.0; });
        const double ratio = after(affine) / gap, centring = std::clamp(ratio * ratio * ratio, 1e-4, 0.9);
        const double target = centring * gap / count;
        products_[0].resize(pairs_);
        products_[1].resize(pairs_);
        ceiling_product_.resize(n_ + 2);
        for (std::size_t sign = 0; sign < 2; ++sign)
            for (std::size_t i = 0; i < pairs_; ++i) products_[sign][i] = dslack_[sign][i] * ddual_[sign][i];
        for (std::size_t i = 2; i < n_; ++i) ceiling_product_[i] = dceiling_slack_[i] * dceiling_dual_[i];
        const auto correction = [&](std::size_t kind, std::size_t i) {
            return kind == 2 ? ceiling_product_[i] : products_[kind][i];
        };
        assemble(false, target, correction);
        substitute();
        Lengths lengths = directions(target, correction);
        lengths.primal = std::min(1.0, kFraction * lengths.primal);
        lengths.dual = std::min(1.0, kFraction * lengths.dual);
        for (std::size_t k = 1; k < n_; ++k) {
            if (lengths.primal * dx_[k] < (kShrink - 1.0) * x_[k]) lengths.primal = (kShrink - 1.0) * x_[k] / dx_[k];
            if (lengths.primal * dx_[k] > (kGrow - 1.0) * x_[k]) lengths.primal = (kGrow - 1.0) * x_[k] / dx_[k];
        }
        for (std::size_t i = 2; i < n_; ++i) c_[i] += lengths.primal * dc_[i];
        for (std::size_t sign = 0; sign < 2; ++sign)
            for (std::size_t i = 0; i < pairs_; ++i) {
                slack_[sign][i] += lengths.primal * dslack_[sign][i];
                dual_[sign][i] += lengths.dual * ddual_[sign][i];
            }
        for (std::size_t i = 2; i < n_; ++i) {
            ceiling_slack_[i] += lengths.primal * dceiling_slack_[i];
            ceiling_dual_[i] += lengths.dual * dceiling_dual_[i];
        }
        return true;
    }

    const JerkProblem& p_;
    std::size_t n_, pairs_;
    std::vector<double> width_, c_, dc_, x_, a_, v_, mean_, dx_, da_, value_, change_;
    std::vector<double> diagonal_, right_;  // (n + 2, 3): the diagonal and the two above it
    std::vector<double> slack_[2], dual_[2], dslack_[2], ddual_[2], products_[2];
    std::vector<double> ceiling_, ceiling_slack_, ceiling_dual_, dceiling_slack_, dceiling_dual_, ceiling_product_;
};

}  // namespace

JerkSolution fastest_with_jerk(const JerkProblem& problem, std::span<const double> x) {
    return Solver(problem, x).solve();
}

}  // namespace pinproof
