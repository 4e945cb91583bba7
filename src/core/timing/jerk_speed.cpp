#include "timing/jerk_speed.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "geometry/lanes.h"

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

// Largest factors by which x may decrease and increase in one step, so that tangents remain useful.
constexpr double kShrink = 0.2, kGrow = 6.0;

// Least slack of a limit at the first estimate, relative to the limit.
constexpr double kFirstSlack = 0.3;

// Rounds in which the widths follow the final solution; each one reduces their error by more than half.
constexpr int kWidthRounds = 40;

// Relative difference below which the limits on both sides of a node are equal.
constexpr double kSame = 1e-6;

inline double largest(Double4 v) { return std::max(std::max(v[0], v[1]), std::max(v[2], v[3])); }

// A slack variable and its dual, with their changes.
struct Slack {
    Double4 slack, dual, dslack, ddual, product;
};

enum class Place { begin, middle, end };

// Four limits |value| <= limit at a place on a step, scaled to limit = 1. Missing limits repeat another one.
struct Limits {
    std::size_t step;
    Place place;
    bool jerk;  // or |alpha a + beta x + gamma| <= bound
    // For jerk: slope, 3 curvature and third derivative, each divided by J; else alpha, beta and gamma by the bound.
    Double4 first, second, third;
    Double4 x0, a0, x1, a1, value;  // the value and its coefficients
    Slack upper, lower;             // value + slack = 1 and -value + slack = 1
};

// A limit of speed on a step: value / most + slack = 1, where the value is x at the beginning or one of the inner
// control points of x in the Bernstein basis, x0 + 2/3 w a0 and x1 - 2/3 w a1. Since x is inside the hull of its
// control points, there are no oscillations between the nodes.
struct Ceiling {
    std::size_t step;
    enum Kind { node, first, second } kind;
    double most, slack = 1.0, dual = 0.0, dslack = 0.0, ddual = 0.0, product = 0.0;
};

class Solver {
  public:
    Solver(const JerkProblem& problem, std::span<const double> x)
        : p_(problem),
          n_(problem.steps()),
          width_(problem.step.begin(), problem.step.end()),
          mean_(n_),
          x_(x.begin(), x.end()),
          a_(n_ + 1),
          v_(n_ + 1),
          dx_(n_ + 1),
          da_(n_ + 1),
          matrix_(2 * n_ + 2),
          right_(2 * n_ + 2) {
        if (p_.start == 0.0) width_.front() *= 1.5;
        if (p_.end == 0.0) width_.back() *= 1.5;
        x_.front() = p_.start;
        x_.back() = p_.end;
        for (std::size_t k = 1; k < n_; ++k) a_[k] = 0.5 * (x_[k + 1] - x_[k - 1]) / (width_[k - 1] + width_[k]);
        for (std::size_t k = 0; k < n_; ++k) {
            add_jerk_limits(k, 0);
            add_jerk_limits(k, 1);
            if (k > 0) add_rate_limits(k, Place::begin);
            add_rate_limits(k, Place::middle);
            if (!repeated(k)) add_rate_limits(k, Place::end);
            // The ceilings at both ends of the problem are those of a stop or of a given speed.
            const double begin = p_.ceiling[k > 0 ? k : 1], end = p_.ceiling[k + 1 < n_ ? k + 1 : k];
            if (k > 0) ceilings_.push_back({k, Ceiling::node, begin});
            if (k > 0) ceilings_.push_back({k, Ceiling::first, (2.0 * begin + end) / 3.0});
            if (k + 1 < n_) ceilings_.push_back({k, Ceiling::second, (begin + 2.0 * end) / 3.0});
        }
    }

    JerkSolution solve() {
        follow();
        evaluate();
        start();
        JerkSolution result;
        for (; result.rounds < kRounds; ++result.rounds) {
            const double gap = complementarity(0.0, 0.0);
            if (gap <= kGap * duration() && violation() <= kViolation) break;
            if (!newton(gap)) break;
            follow();
            evaluate();
        }
        for (int i = 0; i < kWidthRounds; ++i) follow();
        evaluate();
        result.excess = violation();
        result.x = x_;
        result.a = a_;
        for (std::size_t k = 0; k < n_; ++k) {
            const double w = width_[k], rise = 3.0 * (x_[k + 1] - x_[k]) / w;
            result.duration.push_back(w / mean_[k]);
            result.first.push_back((rise - 4.0 * a_[k] - 2.0 * a_[k + 1]) * mean_[k] / w);
            result.last.push_back((2.0 * a_[k] + 4.0 * a_[k + 1] - rise) * mean_[k] / w);
        }
        return result;
    }

  private:
    struct Row {
        double first, second, third;
    };

    void add_jerk_limits(std::size_t k, std::size_t side) {
        std::vector<Row> rows;
        for (std::size_t j = 0; j < p_.joints; ++j) {
            const double scale = 1.0 / p_.jerk[k * p_.joints + j];
            const std::size_t i = (2 * k + side) * p_.joints + j;
            rows.push_back({p_.slope[i] * scale, 3.0 * p_.curvature[i] * scale, p_.third[i] * scale});
        }
        add(k, side ? Place::end : Place::begin, true, std::move(rows));
    }

    // The limits in the middle of a step are the means of those at its ends.
    void add_rate_limits(std::size_t k, Place place) {
        std::vector<Row> rows;
        const std::size_t begin = 2 * k * p_.rows, end = begin + p_.rows;
        const double share = place == Place::begin ? 0.0 : place == Place::end ? 1.0 : 0.5;
        for (std::size_t r = 0; r < p_.rows; ++r) {
            const auto mean = [&](std::span<const double> values) {
                return (1.0 - share) * values[begin + r] + share * values[end + r];
            };
            const double scale = 1.0 / std::max(mean(p_.bound), 1e-300);
            rows.push_back({mean(p_.alpha) * scale, mean(p_.beta) * scale, mean(p_.gamma) * scale});
        }
        add(k, place, false, std::move(rows));
    }

    void add(std::size_t k, Place place, bool jerk, std::vector<Row> rows) {
        if (p_.uniform[k]) {  // only the joint with the tightest limit matters
            const auto tightest = std::max_element(rows.begin(), rows.end(), [](const Row& u, const Row& w) {
                return std::abs(u.first) < std::abs(w.first);
            });
            rows = {*tightest};
        }
        for (std::size_t i = 0; i < rows.size(); i += 4) {
            Limits limits{};
            limits.step = k;
            limits.place = place;
            limits.jerk = jerk;
            for (std::size_t lane = 0; lane < 4; ++lane) {
                const Row& row = rows[std::min(i + lane, rows.size() - 1)];
                limits.first[lane] = row.first;
                limits.second[lane] = row.second;
                limits.third[lane] = row.third;
            }
            limits_.push_back(limits);
        }
    }

    // Whether the limits of s'' and s'^2 at the end of a step are those at the beginning of the next one.
    bool repeated(std::size_t k) const {
        if (k + 1 == n_) return true;  // x and a are fixed there
        const std::size_t before = (2 * k + 1) * p_.rows, after = before + p_.rows;
        double most = 0.0, difference = 0.0;
        for (std::size_t r = 0; r < p_.rows; ++r)
            for (const auto* values : {&p_.alpha, &p_.beta, &p_.gamma}) {
                const double u = (*values)[before + r] / p_.bound[before + r];
                const double w = (*values)[after + r] / p_.bound[after + r];
                most = std::max(most, std::abs(u));
                difference = std::max(difference, std::abs(u - w));
            }
        return difference <= kSame * most;
    }

    // Let the widths follow the solution.
    void follow() {
        for (std::size_t k = 0; k <= n_; ++k) v_[k] = std::sqrt(x_[k]);
        for (std::size_t k = 0; k < n_; ++k) {
            mean_[k] = 0.5 * (v_[k] + v_[k + 1]);
            const double h = width_[k] / mean_[k], length = p_.step[k];
            width_[k] = length + std::clamp((a_[k + 1] - a_[k]) * h * h / 12.0, -0.4 * length, 0.6 * length);
        }
    }

    // The values of all limits and their coefficients. A limit of jerk is divided by the mean speed of the step:
    // |q' j / mean + (3 q'' a + q''' x) v / mean| <= J / mean, where j = s''' and the speed v belong to an end.
    void evaluate() {
        for (Limits& l : limits_) {
            const std::size_t k = l.step;
            const double w = width_[k];
            l.x0 = l.a0 = l.x1 = l.a1 = Double4{};
            if (l.jerk) {
                const bool end = l.place == Place::end;
                const double rise = mean_[k] / w, speed = v_[k + (end ? 1 : 0)];
                l.x1 = l.first * ((end ? -3.0 : 3.0) * rise / w);
                l.x0 = -l.x1;
                l.a0 = l.first * ((end ? 2.0 : -4.0) * rise);
                l.a1 = l.first * ((end ? 4.0 : -2.0) * rise);
                (end ? l.x1 : l.x0) += l.third * speed;
                (end ? l.a1 : l.a0) += l.second * speed;
            } else if (l.place == Place::middle) {
                // x = (x0 + x1) / 2 + (a0 - a1) w / 4 and a = 3 (x1 - x0) / (4 w) - (a0 + a1) / 4
                l.x1 = 0.5 * l.second + l.first * (0.75 / w);
                l.x0 = 0.5 * l.second - l.first * (0.75 / w);
                l.a0 = l.second * (0.25 * w) - 0.25 * l.first;
                l.a1 = l.second * (-0.25 * w) - 0.25 * l.first;
            } else {
                const bool end = l.place == Place::end;
                (end ? l.x1 : l.x0) = l.second;
                (end ? l.a1 : l.a0) = l.first;
            }
            l.value = l.x0 * x_[k] + l.a0 * a_[k] + l.x1 * x_[k + 1] + l.a1 * a_[k + 1];
            if (!l.jerk) l.value += l.third;
        }
    }

    // The coefficients of x0, a0, x1 and a1 in the value that a ceiling limits.
    std::array<double, 4> coefficients(const Ceiling& ceiling) const {
        const double scale = 1.0 / ceiling.most, rise = 2.0 / 3.0 * width_[ceiling.step] * scale;
        if (ceiling.kind == Ceiling::node) return {scale, 0.0, 0.0, 0.0};
        if (ceiling.kind == Ceiling::first) return {scale, rise, 0.0, 0.0};
        return {0.0, 0.0, scale, -rise};
    }

    double value(const Ceiling& ceiling, const std::vector<double>& x, const std::vector<double>& a) const {
        const auto c = coefficients(ceiling);
        const std::size_t k = ceiling.step;
        return c[0] * x[k] + c[1] * a[k] + c[2] * x[k + 1] + c[3] * a[k + 1];
    }

    void start() {
        const double target = duration() / static_cast<double>(8 * limits_.size() + ceilings_.size());
        for (Limits& l : limits_) {
            l.upper.slack = lanes_max(1.0 - l.value, all_lanes(kFirstSlack));
            l.lower.slack = lanes_max(1.0 + l.value, all_lanes(kFirstSlack));
            for (Slack* s : {&l.upper, &l.lower}) s->dual = target / s->slack;
        }
        for (Ceiling& ceiling : ceilings_) {
            ceiling.slack = std::max(1.0 - value(ceiling, x_, a_), kFirstSlack);
            ceiling.dual = target / ceiling.slack;
        }
    }

    double duration() const {
        double total = 0.0;
        for (std::size_t k = 0; k < n_; ++k) total += width_[k] / mean_[k];
        return total;
    }

    // The sum of complementarity products after steps of these lengths.
    double complementarity(double primal, double dual) const {
        Double4 lanes{};
        for (const Limits& l : limits_)
            for (const Slack* s : {&l.upper, &l.lower})
                lanes += (s->slack + primal * s->dslack) * (s->dual + dual * s->ddual);
        double total = sum(lanes);
        for (const Ceiling& c : ceilings_) total += (c.slack + primal * c.dslack) * (c.dual + dual * c.ddual);
        return total;
    }

    double violation() const {
        Double4 most = all_lanes(1.0);
        for (const Limits& l : limits_) most = lanes_max(most, lanes_abs(l.value));
        double result = largest(most);
        for (const Ceiling& ceiling : ceilings_) result = std::max(result, value(ceiling, x_, a_));
        return result - 1.0;
    }

    // The derivative of the logarithm of the mean speed in x0 and x1: the relative decrease of the limit J / mean.
    std::array<double, 2> tangent(std::size_t k) const {
        return {v_[k] > 0.0 ? 0.25 / (v_[k] * mean_[k]) : 0.0, v_[k + 1] > 0.0 ? 0.25 / (v_[k + 1] * mean_[k]) : 0.0};
    }

    // The Newton system for complementarity products `target`, corrected by the products of the predicted changes.
    void assemble(double target, bool with_matrix, bool corrected) {
        if (with_matrix) std::fill(matrix_.begin(), matrix_.end(), std::array<double, 4>{});
        std::fill(right_.begin(), right_.end(), 0.0);
        std::size_t next = 0, next_ceiling = 0;
        for (std::size_t k = 0; k < n_; ++k) {
            double hessian[4][4] = {}, gradient[4] = {};  // in x0, a0, x1, a1
            // The duration w / mean of the step.
            const double h = width_[k] / mean_[k];
            double slope[2];  // of the mean speed in x0 and x1
            for (std::size_t side = 0; side < 2; ++side) slope[side] = v_[k + side] > 0.0 ? 0.25 / v_[k + side] : 0.0;
            for (std::size_t side = 0; side < 2; ++side) {
                gradient[2 * side] = -h / mean_[k] * slope[side];
                hessian[2 * side][2 * side] = 2.0 * h / (mean_[k] * mean_[k]) * slope[side] * slope[side];
                if (slope[side] > 0.0) hessian[2 * side][2 * side] += 0.5 * h / mean_[k] * slope[side] / x_[k + side];
            }
            hessian[0][2] = 2.0 * h / (mean_[k] * mean_[k]) * slope[0] * slope[1];
            // The limits: with the gradient g of the value and the decrease p of the limit, (g + p) and (p - g).
            const auto decrease = tangent(k);
            for (; next < limits_.size() && limits_[next].step == k; ++next) {
                const Limits& l = limits_[next];
                const auto weight = [&](const Slack& s, Double4 value) {
                    Double4 products = all_lanes(target);
                    if (corrected) products -= s.product;
                    return (products + s.dual * (value + s.slack - 1.0)) / s.slack;
                };
                const Double4 up = weight(l.upper, l.value), down = weight(l.lower, -l.value), net = up - down;
                const Double4* const g[4] = {&l.x0, &l.a0, &l.x1, &l.a1};
                for (std::size_t i = 0; i < 4; ++i) gradient[i] += sum(net * *g[i]);
                const double both = l.jerk ? sum(up + down) : 0.0;
                gradient[0] += both * decrease[0];
                gradient[2] += both * decrease[1];
                if (!with_matrix) continue;
                const Double4 upper = l.upper.dual / l.upper.slack, lower = l.lower.dual / l.lower.slack;
                const Double4 stiffness = upper + lower, skew = upper - lower;
                for (std::size_t i = 0; i < 4; ++i) {
                    const Double4 row = stiffness * *g[i];
                    for (std::size_t j = i; j < 4; ++j) hessian[i][j] += sum(row * *g[j]);
                }
                if (!l.jerk) continue;
                const double p[4] = {decrease[0], 0.0, decrease[1], 0.0}, total = sum(stiffness);
                double mixed[4];
                for (std::size_t i = 0; i < 4; ++i) mixed[i] = sum(skew * *g[i]);
                for (std::size_t i = 0; i < 4; ++i)
                    for (std::size_t j = i; j < 4; ++j)
                        hessian[i][j] += total * p[i] * p[j] + mixed[i] * p[j] + p[i] * mixed[j];
            }
            for (; next_ceiling < ceilings_.size() && ceilings_[next_ceiling].step == k; ++next_ceiling) {
                const Ceiling& ceiling = ceilings_[next_ceiling];
                const auto g = coefficients(ceiling);
                const double residual = value(ceiling, x_, a_) + ceiling.slack - 1.0,
                             ratio = ceiling.dual / ceiling.slack;
                const double products = target - (corrected ? ceiling.product : 0.0);
                for (std::size_t i = 0; i < 4; ++i) {
                    gradient[i] += g[i] * (products / ceiling.slack + ratio * residual);
                    for (std::size_t j = i; j < 4; ++j) hessian[i][j] += ratio * g[i] * g[j];
                }
            }
            for (std::size_t i = 0; i < 4; ++i) {
                right_[2 * k + i] -= gradient[i];
                for (std::size_t j = i; j < 4 && with_matrix; ++j) matrix_[2 * k + i][j - i] += hessian[i][j];
            }
        }
    }

    // Cholesky factorisation of the matrix of the free values, in place. False if it is not positive definite.
    bool factorise() {
        const std::size_t last = 2 * n_;
        for (std::size_t i = 2; i < last; ++i) {
            auto& row = matrix_[i];
            for (std::size_t before = 1; before <= 3 && i >= before + 2; ++before) {
                const auto& other = matrix_[i - before];
                for (std::size_t j = 0; j + before <= 3; ++j) row[j] -= other[before] * other[before + j];
            }
            if (!(row[0] > 0.0) || !std::isfinite(row[0])) return false;
            row[0] = std::sqrt(row[0]);
            for (std::size_t j = 1; j <= 3; ++j) row[j] /= row[0];
        }
        return true;
    }

    // The changes of x and a.
    void substitute() {
        const std::size_t last = 2 * n_;
        for (std::size_t i = 2; i < last; ++i) {
            for (std::size_t before = 1; before <= 3 && i >= before + 2; ++before)
                right_[i] -= matrix_[i - before][before] * right_[i - before];
            right_[i] /= matrix_[i][0];
        }
        for (std::size_t i = last; i-- > 2;) {
            for (std::size_t after = 1; after <= 3 && i + after < last; ++after)
                right_[i] -= matrix_[i][after] * right_[i + after];
            right_[i] /= matrix_[i][0];
        }
        for (std::size_t k = 1; k < n_; ++k) {
            dx_[k] = right_[2 * k];
            da_[k] = right_[2 * k + 1];
        }
    }

    struct Lengths {
        double primal, dual;
    };

    // The changes of slacks and duals, and the largest steps (up to 1) after which they are not negative.
    Lengths directions(double target, bool corrected) {
        Double4 primal = all_lanes(1.0), dual = all_lanes(1.0);  // reciprocals of the step lengths
        for (Limits& l : limits_) {
            const std::size_t k = l.step;
            const Double4 change = l.x0 * dx_[k] + l.a0 * da_[k] + l.x1 * dx_[k + 1] + l.a1 * da_[k + 1];
            double decrease = 0.0;
            if (l.jerk) {
                const auto p = tangent(k);
                decrease = p[0] * dx_[k] + p[1] * dx_[k + 1];
            }
            const auto move = [&](Slack& s, Double4 value, Double4 step) {
                Double4 products = all_lanes(target);
                if (corrected) products -= s.product;
                s.dslack = 1.0 - value - s.slack - step;
                s.ddual = (products - s.dual * s.dslack) / s.slack - s.dual;
                primal = lanes_max(primal, -s.dslack / s.slack);
                dual = lanes_max(dual, -s.ddual / s.dual);
            };
            move(l.upper, l.value, change + decrease);
            move(l.lower, -l.value, decrease - change);
        }
        double most_primal = largest(primal), most_dual = largest(dual);
        for (Ceiling& c : ceilings_) {
            const double products = target - (corrected ? c.product : 0.0);
            c.dslack = 1.0 - value(c, x_, a_) - value(c, dx_, da_) - c.slack;
            c.ddual = (products - c.dual * c.dslack) / c.slack - c.dual;
            most_primal = std::max(most_primal, -c.dslack / c.slack);
            most_dual = std::max(most_dual, -c.ddual / c.dual);
        }
        return {1.0 / most_primal, 1.0 / most_dual};
    }

    // One predictor-corrector step. False if the matrix is not positive definite.
    bool newton(double gap) {
        assemble(0.0, true, false);
        if (!factorise()) return false;
        substitute();
        const Lengths affine = directions(0.0, false);
        const double ratio = complementarity(affine.primal, affine.dual) / gap;
        const double centring = std::clamp(ratio * ratio * ratio, 1e-4, 0.9);
        const double target = centring * gap / static_cast<double>(8 * limits_.size() + ceilings_.size());
        for (Limits& l : limits_)
            for (Slack* s : {&l.upper, &l.lower}) s->product = s->dslack * s->ddual;
        for (Ceiling& ceiling : ceilings_) ceiling.product = ceiling.dslack * ceiling.ddual;
        assemble(target, false, true);
        substitute();
        Lengths lengths = directions(target, true);
        double primal = std::min(1.0, kFraction * lengths.primal);
        const double dual = std::min(1.0, kFraction * lengths.dual);
        for (std::size_t k = 1; k < n_; ++k) {
            if (primal * dx_[k] < (kShrink - 1.0) * x_[k]) primal = (kShrink - 1.0) * x_[k] / dx_[k];
            if (primal * dx_[k] > (kGrow - 1.0) * x_[k]) primal = (kGrow - 1.0) * x_[k] / dx_[k];
        }
        for (std::size_t k = 1; k < n_; ++k) {
            x_[k] += primal * dx_[k];
            a_[k] += primal * da_[k];
        }
        for (Limits& l : limits_)
            for (Slack* s : {&l.upper, &l.lower}) {
                s->slack += primal * s->dslack;
                s->dual += dual * s->ddual;
            }
        for (Ceiling& ceiling : ceilings_) {
            ceiling.slack += primal * ceiling.dslack;
            ceiling.dual += dual * ceiling.ddual;
        }
        return true;
    }

    const JerkProblem& p_;
    std::size_t n_;
    std::vector<Limits> limits_;                 // ordered by steps
    std::vector<Ceiling> ceilings_;              // ordered by steps
    std::vector<double> width_, mean_;           // (n) of the steps: effective widths, and (v0 + v1) / 2
    std::vector<double> x_, a_, v_, dx_, da_;    // (n + 1); those at both ends are fixed
    std::vector<std::array<double, 4>> matrix_;  // (2 n + 2) the diagonal and the three above it
    std::vector<double> right_;                  // (2 n + 2)
};

}  // namespace

JerkSolution fastest_with_jerk(const JerkProblem& problem, std::span<const double> x) {
    return Solver(problem, x).solve();
}

}  // namespace pinproof
