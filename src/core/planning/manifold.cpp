#include "planning/manifold.h"

#include <algorithm>
#include <cmath>

namespace pinproof {
namespace {

// Share of the tolerance to which steps are projected, so that the straight edges between them and the splines through
// them have the rest for their deviation.
constexpr double kInside = 0.5;

// Newton steps. A projection from a step of 0.5 rad takes 2 to 5.
constexpr int kMostIterations = 40;

// rad or m: the largest change of a joint in one Newton step, within which the linearisation is useful.
constexpr double kMostChange = 0.3;

// Damping of the Newton step, relative to the largest diagonal element of the system.
constexpr double kDamping = 1e-8;

// Fraction of a wanted error to which the projection aims, so that it also ends where the error decreases slowly.
constexpr double kAim = 0.9;

// A step whose edge cannot be proven is halved, at most this often.
constexpr int kMostHalvings = 7;

// Steps whose projection deviates sideways, after which no shorter one is tried: their direction does not depend on
// the length.
constexpr int kMostAside = 2;

// Fraction of a step by which the distance to the target must decrease. The projection may turn a step aside.
constexpr double kLeastProgress = 0.1;

// A projection that moves a step by more than this multiple of its length leads somewhere else.
constexpr double kMostDetour = 2.0;

// Most steps of one connection.
constexpr int kMostSteps = 400;

double distance(const double* a, const double* b, std::size_t n) { return std::sqrt(squared_distance(a, b, n)); }

}  // namespace

Manifold::Manifold(std::vector<ConstrainedTcp> tcps, std::vector<double> lower, std::vector<double> upper)
    : tcps_(std::move(tcps)),
      lower_(std::move(lower)),
      upper_(std::move(upper)),
      no_tolerance_(lower_.size(), 0.0),
      control_(2 * lower_.size()),
      step_(lower_.size()),
      fixed_(lower_.size()) {}

std::size_t Manifold::size() const {
    std::size_t count = 0;
    for (const ConstrainedTcp& tcp : tcps_) count += tcp.size();
    return count;
}

void Manifold::errors(const double* q, double* found) {
    for (ConstrainedTcp& tcp : tcps_) {
        tcp.place(q);
        for (std::size_t i = 0; i < tcp.size(); ++i) *found++ = tcp.error(i);
    }
}

// Whether every error is at most this share of its tolerance.
bool Manifold::within(const double* q, double share) {
    bool inside = true;
    for (ConstrainedTcp& tcp : tcps_) {
        tcp.place(q);
        for (std::size_t i = 0; i < tcp.size(); ++i) inside = inside && tcp.error(i) <= share * tcp.tolerance(i);
    }
    return inside;
}

// The least-squares step of the equations, without the joints that are fixed. Returns false if it does not exist.
bool Manifold::solve(std::vector<double>& step) {
    const std::size_t rows = equations_.size(), n = dof();
    gram_.assign(rows * rows, 0.0);
    right_.resize(rows);
    double largest = 0.0;
    for (std::size_t r = 0; r < rows; ++r) {
        right_[r] = equations_[r].right;
        for (std::size_t s = 0; s <= r; ++s) {
            double sum = 0.0;
            for (std::size_t j = 0; j < n; ++j)
                if (!fixed_[j]) sum += equations_[r].row[j] * equations_[s].row[j];
            gram_[r * rows + s] = sum;
        }
        largest = std::max(largest, gram_[r * rows + r]);
    }
    if (!(largest > 0.0)) return false;
    for (std::size_t r = 0; r < rows; ++r) {  // Cholesky factors in place, and forward substitution.
        gram_[r * rows + r] += kDamping * largest;
        for (std::size_t s = 0; s <= r; ++s) {
            double sum = gram_[r * rows + s];
            for (std::size_t k = 0; k < s; ++k) sum -= gram_[r * rows + k] * gram_[s * rows + k];
            if (s < r) {
                gram_[r * rows + s] = sum / gram_[s * rows + s];
            } else {
                if (!(sum > 0.0)) return false;
                gram_[r * rows + r] = std::sqrt(sum);
            }
        }
        for (std::size_t k = 0; k < r; ++k) right_[r] -= gram_[r * rows + k] * right_[k];
        right_[r] /= gram_[r * rows + r];
    }
    for (std::size_t r = rows; r-- > 0;) {
        for (std::size_t k = r + 1; k < rows; ++k) right_[r] -= gram_[k * rows + r] * right_[k];
        right_[r] /= gram_[r * rows + r];
    }
    for (std::size_t j = 0; j < n; ++j) {
        step[j] = 0.0;
        if (fixed_[j]) continue;
        for (std::size_t r = 0; r < rows; ++r) step[j] += equations_[r].row[j] * right_[r];
    }
    return true;
}

bool Manifold::project(double* q, double share) {
    const std::size_t n = dof();
    for (std::size_t j = 0; j < n; ++j) q[j] = std::clamp(q[j], lower_[j], upper_[j]);
    for (int iteration = 0; iteration < kMostIterations; ++iteration) {
        if (within(q, share)) return true;
        equations_.clear();
        for (const ConstrainedTcp& tcp : tcps_)  // placed at q
            for (std::size_t i = 0; i < tcp.size(); ++i)
                tcp.append_equations(i, kAim * share * tcp.tolerance(i), equations_);
        std::fill(fixed_.begin(), fixed_.end(), false);
        // A joint at its limit that would leave it is fixed, and the step is computed again.
        for (std::size_t pass = 0; pass <= n; ++pass) {
            if (!solve(step_)) return false;
            bool changed = false;
            for (std::size_t j = 0; j < n; ++j) {
                const bool leaves = (q[j] <= lower_[j] && step_[j] < 0.0) || (q[j] >= upper_[j] && step_[j] > 0.0);
                if (!fixed_[j] && leaves) fixed_[j] = changed = true;
            }
            if (!changed) break;
        }
        double most = 0.0;
        for (std::size_t j = 0; j < n; ++j) most = std::max(most, std::abs(step_[j]));
        if (!(most > 0.0)) return false;
        const double scale = std::min(1.0, kMostChange / most);
        for (std::size_t j = 0; j < n; ++j) q[j] = std::clamp(q[j] + scale * step_[j], lower_[j], upper_[j]);
    }
    return false;
}

bool Manifold::edge_proven(const double* a, const double* b) {
    std::copy_n(a, dof(), control_.data());
    std::copy_n(b, dof(), control_.data() + dof());
    const CurveView edge{kUnitKnots, control_, 2, dof()};
    const ConstraintSettings settings{.resolution = 1e-5, .max_intervals = 500};
    for (ConstrainedTcp& tcp : tcps_)
        for (std::size_t i = 0; i < tcp.size(); ++i)
            if (!prove_constraint(tcp, i, edge, settings, no_tolerance_.data()).satisfied()) return false;
    return true;
}

bool Manifold::step(const double* from, const double* target, double length, double* end) {
    const std::size_t n = dof();
    const double left = distance(from, target, n);
    if (!(left > 0.0)) return false;
    double reach = std::min(length, left);
    int aside = 0;
    for (int halving = 0; halving <= kMostHalvings && aside < kMostAside; ++halving, reach *= 0.5) {
        const bool whole = reach >= left;
        for (std::size_t j = 0; j < n; ++j) end[j] = whole ? target[j] : from[j] + (target[j] - from[j]) * reach / left;
        if (!whole || !contains(target)) {
            const bool near = project(end, kInside) && distance(from, end, n) <= kMostDetour * reach;
            if (!near || distance(end, target, n) > left - kLeastProgress * reach) {
                ++aside;
                continue;
            }
        }
        if (edge_proven(from, end)) return true;
    }
    return false;
}

bool Manifold::connect(EdgeChecker& edges, const double* a, const double* b, double length, double most,
                       std::vector<double>& path) {
    const std::size_t n = dof();
    std::vector<double> here(a, a + n), next(n);
    double total = 0.0;
    for (int steps = 0; steps < kMostSteps; ++steps) {
        if (std::equal(here.begin(), here.end(), b)) return true;
        if (!step(here.data(), b, length, next.data())) return false;
        total += distance(here.data(), next.data(), n);
        if (total + distance(next.data(), b, n) > most) return false;
        if (!edges.samples_free(here.data(), next.data())) return false;
        path.insert(path.end(), next.begin(), next.end());
        here = next;
    }
    return false;
}

}  // namespace pinproof
