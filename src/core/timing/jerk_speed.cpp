#include "timing/jerk_speed.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "geometry/double4.h"

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

// x and a at both ends of a step, or coefficients of them.
struct Ends {
    double x0 = 0.0, a0 = 0.0, x1 = 0.0, a1 = 0.0;
};

inline Double4 spread(double value) { return Double4{value, value, value, value}; }

inline Double4 magnitude(Double4 v) { return v < 0.0 ? -v : v; }

inline Double4 larger(Double4 u, Double4 v) { return u > v ? u : v; }

inline double largest(Double4 v) { return std::max(std::max(v[0], v[1]), std::max(v[2], v[3])); }

// A slack variable and its dual, with their changes.
struct Slack {
    Double4 slack, dual, dslack, ddual, product;
};

// Four limits |value| <= limit on one side of a step, scaled to limit = 1. Missing limits repeat another one.
struct Limits {
    std::size_t step;
    bool end;   // of the end of the step, else of its beginning
    bool jerk;  // or |alpha a + beta x + gamma| <= bound
    Double4 first, second, third;        // jerk: slope, 3 curvature, third derivative, each / J; else alpha, beta, gamma / bound
    Double4 x0, a0, x1, a1, value;       // the value and its coefficients
    Slack upper, lower;                  // value + slack = 1 and -value + slack = 1
};

// The limits of speed on a coefficient: c / most + slack = 1.
struct Ceiling {
    double most = 1.0, slack = 1.0, dual = 0.0, dslack = 0.0, ddual = 0.0, product = 0.0;
};

class Solver {
  public:
    Solver(const JerkProblem& problem, std::span<const double> x);

    JerkSolution solve();

  private:
    void add_limits(std::size_t k, bool end);
    bool repeated(std::size_t k) const;
    void expand();
    void follow();
    void evaluate();
    void start();
    double duration() const;
    double complementarity(double primal, double dual) const;
    double violation() const;
    std::array<double, 2> tangent(std::size_t k) const;
    void assemble(double target, bool with_matrix, bool corrected);
    void scatter(std::size_t k, const double (&hessian)[4][4], const double (&gradient)[4], bool with_matrix);
    bool factorise();
    void substitute();
    struct Lengths {
        double primal, dual;
    };
    Lengths directions(double target, bool corrected);
    bool newton(double gap);

    const JerkProblem& p_;
    std::size_t n_;
    std::vector<Limits> limits_;     // ordered by steps
    std::vector<Ceiling> ceilings_;  // (n + 2) of the free coefficients
    std::vector<double> width_, mean_;              // (n) of the steps: effective widths, and (v0 + v1) / 2
    std::vector<double> c_, dc_;                    // (n + 2); the free ones are 2 .. n - 1
    std::vector<double> x_, a_, v_, dx_, da_;       // (n + 1)
    std::vector<std::array<double, 3>> matrix_;     // (n + 2) the diagonal and the two above it
    std::vector<double> right_;                     // (n + 2)
};

Solver::Solver(const JerkProblem& problem, std::span<const double> x)
    : p_(problem),
      n_(problem.steps()),
      ceilings_(n_ + 2),
      width_(problem.step.begin(), problem.step.end()),
      mean_(n_),
      c_(n_ + 2),
      dc_(n_ + 2),
      x_(n_ + 1),
      a_(n_ + 1),
      v_(n_ + 1),
      dx_(n_ + 1),
      da_(n_ + 1),
      matrix_(n_ + 2),
      right_(n_ + 2) {
    if (p_.start == 0.0) width_.front() *= 1.5;
    if (p_.end == 0.0) width_.back() *= 1.5;
    c_[0] = c_[1] = p_.start;
    c_[n_] = c_[n_ + 1] = p_.end;
    // A coefficient belongs to the middle of a step. Limits on x at the nodes would permit oscillations between them.
    for (std::size_t i = 2; i < n_; ++i) {
        c_[i] = 0.5 * (x[i - 1] + x[i]);
        ceilings_[i].most = 0.5 * (p_.ceiling[i - 1] + p_.ceiling[i]);
    }
    for (std::size_t k = 0; k < n_; ++k) {
        add_limits(k, false);
        add_limits(k, true);
    }
}

// Whether the limits of s'' and s'^2 at the end of a step are those at the beginning of the next one.
bool Solver::repeated(std::size_t k) const {
    if (k + 1 == n_) return true;  // x and a are fixed there
    const std::size_t before = (2 * k + 1) * p_.rows, after = before + p_.rows;
    double most = 0.0, difference = 0.0;
    for (std::size_t r = 0; r < p_.rows; ++r)
        for (const auto* values : {&p_.alpha, &p_.beta, &p_.gamma}) {
            const double u = (*values)[before + r] / p_.bound[before + r], w = (*values)[after + r] / p_.bound[after + r];
            most = std::max(most, std::abs(u));
            difference = std::max(difference, std::abs(u - w));
        }
    return difference <= kSame * most;
}

void Solver::add_limits(std::size_t k, bool end) {
    const std::size_t side = 2 * k + (end ? 1 : 0);
    struct Row {
        double first, second, third;
    };
    std::vector<Row> rows;
    const auto add = [&](bool jerk) {
        if (p_.uniform[k]) {  // only the joint with the tightest limit matters
            const auto tightest = std::max_element(rows.begin(), rows.end(), [](const Row& u, const Row& w) {
                return std::abs(u.first) < std::abs(w.first);
            });
            rows = {*tightest};
        }
        for (std::size_t i = 0; i < rows.size(); i += 4) {
            Limits limits{};
            limits.step = k;
            limits.end = end;
            limits.jerk = jerk;
            for (std::size_t lane = 0; lane < 4; ++lane) {
                const Row& row = rows[std::min(i + lane, rows.size() - 1)];
                limits.first[lane] = row.first;
                limits.second[lane] = row.second;
                limits.third[lane] = row.third;
            }
            limits_.push_back(limits);
        }
    };
    for (std::size_t j = 0; j < p_.joints; ++j) {
        const double scale = 1.0 / p_.jerk[k * p_.joints + j];
        const std::size_t i = side * p_.joints + j;
        rows.push_back({p_.slope[i] * scale, 3.0 * p_.curvature[i] * scale, p_.third[i] * scale});
    }
    if (!(p_.uniform[k] && end)) add(true);  // with constant slope, both sides are equal
    if (end ? repeated(k) : k == 0) return;
    rows.clear();
    for (std::size_t i = side * p_.rows; i < (side + 1) * p_.rows; ++i) {
        const double scale = 1.0 / std::max(p_.bound[i], 1e-300);
        rows.push_back({p_.alpha[i] * scale, p_.beta[i] * scale, p_.gamma[i] * scale});
    }
    add(false);
}

// x, a and the speeds from the coefficients and the widths.
void Solver::expand() {
    for (std::size_t k = 0; k <= n_; ++k) {
        const double before = k > 0 ? width_[k - 1] : 0.0, after = k < n_ ? width_[k] : 0.0;
        a_[k] = (c_[k + 1] - c_[k]) / (before + after);
        x_[k] = std::max(c_[k] + a_[k] * before, 0.0);
        v_[k] = std::sqrt(x_[k]);
    }
    for (std::size_t k = 0; k < n_; ++k) mean_[k] = 0.5 * (v_[k] + v_[k + 1]);
}

// Let the widths follow the solution.
void Solver::follow() {
    expand();
    for (std::size_t k = 0; k < n_; ++k) {
        const double h = width_[k] / mean_[k], length = p_.step[k];
        width_[k] = length + std::clamp((a_[k + 1] - a_[k]) * h * h / 12.0, -0.4 * length, 0.6 * length);
    }
    expand();
}

double Solver::duration() const {
    double total = 0.0;
    for (std::size_t k = 0; k < n_; ++k) total += width_[k] / mean_[k];
    return total;
}

// The values of all limits and their coefficients. A limit of jerk is divided by the mean speed of the step:
// |q' (a1 - a0) / w + (3 q'' a + q''' x) v / mean| <= J / mean, where v is the speed at the end in question.
void Solver::evaluate() {
    for (Limits& l : limits_) {
        const std::size_t k = l.step;
        const Double4 zero{};
        Double4 x = l.second, a = l.first;  // the coefficients of x and a at the end in question
        l.a0 = l.a1 = zero;
        if (l.jerk) {
            const double speed = v_[k + (l.end ? 1 : 0)];
            x = l.third * speed;
            a = l.second * speed;
            l.a1 = l.first * (mean_[k] / width_[k]);
            l.a0 = -l.a1;
        }
        l.x0 = l.end ? zero : x;
        l.x1 = l.end ? x : zero;
        if (l.end)
            l.a1 += a;
        else
            l.a0 += a;
        l.value = l.x0 * x_[k] + l.a0 * a_[k] + l.x1 * x_[k + 1] + l.a1 * a_[k + 1];
        if (!l.jerk) l.value += l.third;
    }
}

void Solver::start() {
    const double target = duration() / static_cast<double>(8 * limits_.size() + n_);
    for (Limits& l : limits_) {
        l.upper.slack = larger(1.0 - l.value, spread(kFirstSlack));
        l.lower.slack = larger(1.0 + l.value, spread(kFirstSlack));
        for (Slack* s : {&l.upper, &l.lower}) s->dual = target / s->slack;
    }
    for (std::size_t i = 2; i < n_; ++i) {
        Ceiling& ceiling = ceilings_[i];
        ceiling.slack = std::max(1.0 - c_[i] / ceiling.most, kFirstSlack);
        ceiling.dual = target / ceiling.slack;
    }
}

// The sum of complementarity products after steps of these lengths.
double Solver::complementarity(double primal, double dual) const {
    Double4 lanes{};
    for (const Limits& l : limits_)
        for (const Slack* s : {&l.upper, &l.lower})
            lanes += (s->slack + primal * s->dslack) * (s->dual + dual * s->ddual);
    double total = sum(lanes);
    for (std::size_t i = 2; i < n_; ++i)
        total += (ceilings_[i].slack + primal * ceilings_[i].dslack) * (ceilings_[i].dual + dual * ceilings_[i].ddual);
    return total;
}

double Solver::violation() const {
    Double4 most = spread(1.0);
    for (const Limits& l : limits_) most = larger(most, magnitude(l.value));
    double result = largest(most);
    for (std::size_t i = 2; i < n_; ++i) result = std::max(result, c_[i] / ceilings_[i].most);
    return result - 1.0;
}

// The derivative of the logarithm of the mean speed in x0 and x1: the relative decrease of the limit J / mean.
std::array<double, 2> Solver::tangent(std::size_t k) const {
    return {v_[k] > 0.0 ? 0.25 / (v_[k] * mean_[k]) : 0.0, v_[k + 1] > 0.0 ? 0.25 / (v_[k + 1] * mean_[k]) : 0.0};
}

// The Newton system for complementarity products `target`, corrected by the products of the predicted changes.
void Solver::assemble(double target, bool with_matrix, bool corrected) {
    if (with_matrix) std::fill(matrix_.begin(), matrix_.end(), std::array<double, 3>{});
    std::fill(right_.begin(), right_.end(), 0.0);
    std::size_t next = 0;
    for (std::size_t k = 0; k < n_; ++k) {
        double hessian[4][4] = {}, gradient[4] = {};  // in x0, a0, x1, a1
        // The duration w / mean of the step.
        const double h = width_[k] / mean_[k];
        const double slope[2] = {v_[k] > 0.0 ? 0.25 / v_[k] : 0.0, v_[k + 1] > 0.0 ? 0.25 / v_[k + 1] : 0.0};  // of mean
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
                Double4 products = spread(target);
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
        scatter(k, hessian, gradient, with_matrix);
    }
    for (std::size_t i = 2; i < n_; ++i) {
        const Ceiling& ceiling = ceilings_[i];
        const double residual = c_[i] / ceiling.most + ceiling.slack - 1.0, ratio = ceiling.dual / ceiling.slack;
        const double products = target - (corrected ? ceiling.product : 0.0);
        right_[i] -= (products / ceiling.slack + ratio * residual) / ceiling.most;
        if (with_matrix) matrix_[i][0] += ratio / (ceiling.most * ceiling.most);
    }
}

// Add a Hessian (upper triangle) and a gradient in x0, a0, x1, a1 of a step to the system of the coefficients.
void Solver::scatter(std::size_t k, const double (&hessian)[4][4], const double (&gradient)[4], bool with_matrix) {
    const double before = k > 0 ? width_[k - 1] : 0.0, here = width_[k], after = k + 1 < n_ ? width_[k + 1] : 0.0;
    const double first = 1.0 / (before + here), second = 1.0 / (here + after);
    const double w[4][3] = {{here * first, before * first, 0.0},
                            {-first, first, 0.0},
                            {0.0, after * second, here * second},
                            {0.0, -second, second}};
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t l = 0; l < 4; ++l) right_[k + i] -= w[l][i] * gradient[l];
    if (!with_matrix) return;
    double product[4][3] = {};  // hessian w
    for (std::size_t l = 0; l < 4; ++l)
        for (std::size_t m = 0; m < 4; ++m)
            for (std::size_t j = 0; j < 3; ++j) product[l][j] += hessian[std::min(l, m)][std::max(l, m)] * w[m][j];
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = i; j < 3; ++j)
            for (std::size_t l = 0; l < 4; ++l) matrix_[k + i][j - i] += w[l][i] * product[l][j];
}

// Cholesky factorisation of the matrix of the free coefficients, in place. False if it is not positive definite.
bool Solver::factorise() {
    for (std::size_t i = 2; i < n_; ++i) {
        auto& row = matrix_[i];
        if (i >= 3) row[0] -= matrix_[i - 1][1] * matrix_[i - 1][1];
        if (i >= 4) row[0] -= matrix_[i - 2][2] * matrix_[i - 2][2];
        if (!(row[0] > 0.0) || !std::isfinite(row[0])) return false;
        row[0] = std::sqrt(row[0]);
        if (i >= 3) row[1] -= matrix_[i - 1][1] * matrix_[i - 1][2];
        row[1] /= row[0];
        row[2] /= row[0];
    }
    return true;
}

// The changes of the coefficients, and of x and a.
void Solver::substitute() {
    for (std::size_t i = 2; i < n_; ++i) {
        double rest = right_[i];
        if (i >= 3) rest -= matrix_[i - 1][1] * dc_[i - 1];
        if (i >= 4) rest -= matrix_[i - 2][2] * dc_[i - 2];
        dc_[i] = rest / matrix_[i][0];
    }
    for (std::size_t i = n_; i-- > 2;) {
        double rest = dc_[i];
        if (i + 1 < n_) rest -= matrix_[i][1] * dc_[i + 1];
        if (i + 2 < n_) rest -= matrix_[i][2] * dc_[i + 2];
        dc_[i] = rest / matrix_[i][0];
    }
    for (std::size_t k = 0; k <= n_; ++k) {
        const double before = k > 0 ? width_[k - 1] : 0.0, after = k < n_ ? width_[k] : 0.0;
        da_[k] = (dc_[k + 1] - dc_[k]) / (before + after);
        dx_[k] = dc_[k] + da_[k] * before;
    }
}

// The changes of slacks and duals, and the largest steps (up to 1) after which they are not negative.
Solver::Lengths Solver::directions(double target, bool corrected) {
    Double4 primal = spread(1.0), dual = spread(1.0);  // reciprocals of the step lengths
    for (Limits& l : limits_) {
        const std::size_t k = l.step;
        const Double4 change = l.x0 * dx_[k] + l.a0 * da_[k] + l.x1 * dx_[k + 1] + l.a1 * da_[k + 1];
        double decrease = 0.0;
        if (l.jerk) {
            const auto p = tangent(k);
            decrease = p[0] * dx_[k] + p[1] * dx_[k + 1];
        }
        const auto move = [&](Slack& s, Double4 value, Double4 step) {
            Double4 products = spread(target);
            if (corrected) products -= s.product;
            s.dslack = 1.0 - value - s.slack - step;
            s.ddual = (products - s.dual * s.dslack) / s.slack - s.dual;
            primal = larger(primal, -s.dslack / s.slack);
            dual = larger(dual, -s.ddual / s.dual);
        };
        move(l.upper, l.value, change + decrease);
        move(l.lower, -l.value, decrease - change);
    }
    double most_primal = largest(primal), most_dual = largest(dual);
    for (std::size_t i = 2; i < n_; ++i) {
        Ceiling& c = ceilings_[i];
        const double products = target - (corrected ? c.product : 0.0);
        c.dslack = 1.0 - (c_[i] + dc_[i]) / c.most - c.slack;
        c.ddual = (products - c.dual * c.dslack) / c.slack - c.dual;
        most_primal = std::max(most_primal, -c.dslack / c.slack);
        most_dual = std::max(most_dual, -c.ddual / c.dual);
    }
    return {1.0 / most_primal, 1.0 / most_dual};
}

// One predictor-corrector step. False if the matrix is not positive definite.
bool Solver::newton(double gap) {
    assemble(0.0, true, false);
    if (!factorise()) return false;
    substitute();
    const Lengths affine = directions(0.0, false);
    const double ratio = complementarity(affine.primal, affine.dual) / gap;
    const double centring = std::clamp(ratio * ratio * ratio, 1e-4, 0.9);
    const double target = centring * gap / static_cast<double>(8 * limits_.size() + n_ - 2);
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
    for (std::size_t i = 2; i < n_; ++i) c_[i] += primal * dc_[i];
    for (Limits& l : limits_)
        for (Slack* s : {&l.upper, &l.lower}) {
            s->slack += primal * s->dslack;
            s->dual += dual * s->ddual;
        }
    for (std::size_t i = 2; i < n_; ++i) {
        ceilings_[i].slack += primal * ceilings_[i].dslack;
        ceilings_[i].dual += dual * ceilings_[i].ddual;
    }
    return true;
}

JerkSolution Solver::solve() {
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
    for (std::size_t k = 0; k < n_; ++k) result.duration.push_back(width_[k] / mean_[k]);
    return result;
}

}  // namespace

JerkSolution fastest_with_jerk(const JerkProblem& problem, std::span<const double> x) {
    return Solver(problem, x).solve();
}

}  // namespace pinproof
