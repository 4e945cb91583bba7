#include "timing/time_path.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

#include "timing/jerk_speed.h"
#include "timing/path_speed.h"
#include "timing/profile.h"

namespace pinproof {
namespace {

// Number of steps at which the subdivision ends. A motion usually has some tens of steps.
constexpr std::size_t kMaxSteps = 4000;

// Step, as a fraction of the path, below which a step is not subdivided.
constexpr double kShortestStep = 1e-7;

// Largest number of verifications.
constexpr int kMostRounds = 40;

// Number of rounds in which single steps are slowed down. Later the whole run is slowed down, which converges.
constexpr int kLocalRounds = 8;

// Number of rounds in which steps are subdivided where s'' changes, and the excess above which they are subdivided.
constexpr int kCoarseRounds = 3;
constexpr double kSubdivideAbove = 1.01;

// Largest number of parts of a step in one round.
constexpr std::size_t kMaxParts = 4;

// Fraction of the total time that a step may lose before it is subdivided. The estimate is eight times too large.
constexpr double kMaxLoss = 2e-3;

// Without a jerk limit: numbers of steps of the first grid on a bent piece, at least and at most; the least number on
// all bent pieces together (a single step that begins and ends at rest would not move). With constraints, which may vary
// along a piece: the least number on one of few pieces, on one of many, and their number up to which these are few.
constexpr std::size_t kBentSteps = 2, kMaxBentSteps = 64, kLeastBentSteps = 80;
constexpr std::size_t kConstrainedSteps = 16, kOfManySteps = 4, kFewPieces = 125;

// Factor of the deviation that the first grid allows for: 8 between a varying and a constant speed, and 8 for finer
// steps, with which limits at the nodes lose less than 0.5 % of the duration.
constexpr double kSpeedChange = 64.0;

// With a jerk limit: numbers of steps of a run, first for an estimate of the speeds, then for two solutions with jerk
// limits, each on a grid that is uniform in the time of the one before.
constexpr std::size_t kEstimateSteps = 8, kCoarseSteps = 40, kFineSteps = 100;

// Least numbers of steps of a straight and of a bent piece.
constexpr std::size_t kStraightPieceSteps = 3, kBentPieceSteps = 3;

// Shortest time (s) between two points with a jerk limit, or 1 % of a short motion, because rounding is amplified by
// 60 / h^3.
constexpr double kShortestSmooth = 2e-3;

// Upper bound of the limits of s, which are otherwise infinite where joints do not move.
constexpr double kLargest = 1e150;

// With a jerk limit: the least estimate of x, relative to the largest one, and the Newton steps to the time at a node.
constexpr double kLeastEstimate = 1e-6;
constexpr int kNewtonSteps = 20;

// Excess of a solution above which the given speeds at the ends are not possible.
constexpr double kUnsolved = 1e-2;

// Excess up to which the whole run is slowed down, in the round of this index and, with the last one, in later rounds.
// Without a jerk limit, single steps are slowed down first; with one, each further solution takes longer.
constexpr double kSlight[] = {1.0, 1.001, 1.001, 1.003, 1.003, 1.01};
constexpr double kSlightWithJerk[] = {1.0005, 1.002, 1.002, 1.002, 1.01};

struct Step {
    double begin, end;
    std::size_t piece;
    double slowdown = 1.0;  // factor by which it is slower than the limits permit at the nodes
};

// A step in equal parts; fewer if they would be shorter than rounding.
std::vector<Step> divided(const Step& step, std::size_t parts) {
    std::vector<Step> result;
    Step part = step;
    for (std::size_t i = 1; i <= parts; ++i) {
        const double share = static_cast<double>(i) / static_cast<double>(parts);
        part.end = i == parts ? step.end : step.begin * (1.0 - share) + step.end * share;
        if (part.end > part.begin) result.push_back(part);
        part.begin = part.end;
    }
    return result;
}

// The limit of a derivative of s if the joints move by `slope` per s.
double least(std::span<const double> limit, const double* slope) {
    double result = kLargest;
    for (std::size_t j = 0; j < limit.size(); ++j)
        if (std::abs(slope[j]) > 0.0) result = std::min(result, limit[j] / std::abs(slope[j]));
    return result;
}

// Derivatives of the path and limits at both ends of steps.
struct StepLimits {
    std::size_t rows = 0;
    std::vector<double> slope, curvature, third;    // (N, 2, n)
    std::vector<double> alpha, beta, gamma, bound;  // (N, 2, rows)
    std::vector<double> length;                     // (N)
    std::vector<double> ceiling;                    // (N + 1) largest s'^2
    std::vector<double> jerk;                       // (N, n)
    std::vector<char> uniform;                      // (N)
};

class Timing {
  public:
    explicit Timing(const TimingTask& task)
        : task_(task),
          path_(task.path),
          n_(task.path.joints()),
          start_(along(0, path_.knots().front(), task.start_velocity)),
          end_(along(path_.pieces() - 1, path_.knots().back(), task.end_velocity)) {
        std::size_t run = 0;
        for (std::size_t k = 0; k < path_.pieces(); ++k) {
            if (k > 0 && path_.stops(k)) ++run;
            run_.push_back(run);
        }
        run_slowdown_.assign(run + 1, 1.0);
        solutions_.resize(run + 1);
    }

    TimedMotion solve() {
        TimedMotion result;
        if (!smooth()) steps_ = first_grid();
        std::optional<TimingStatus> failed = smooth() ? first_profile_with_jerk_limit() : profile_without_jerk_limit();
        for (;; ++result.rounds) {
            result.duration = profile_.duration();
            if (!failed && !(result.duration <= task_.longest)) {
                // Slowing down cannot help where the speed at an end, which stays, exceeds a limit together with the bend.
                const bool by_ends = result.rounds > 0 && (start_ > 0.0 || end_ > 0.0);
                failed = by_ends ? TimingStatus::ends_unreachable : TimingStatus::too_long;
            }
            if (failed) {
                result.status = *failed;
                return result;
            }
            result.curve = points();
            const bool verified = verify(result.curve);
            const bool coarse =
                result.rounds < kCoarseRounds && std::find(coarse_.begin(), coarse_.end(), 1) != coarse_.end();
            result.deviation = deviation_;
            result.excess = excess_;
            if (verified && !coarse) break;
            if (result.rounds == kMostRounds) {
                result.status = deviation_ > task_.image_tolerance ? TimingStatus::deviates : TimingStatus::exceeds;
                return result;
            }
            adapt(result.curve, result.rounds);
            failed = smooth() ? profile_with_jerk_limit() : profile_without_jerk_limit();
        }
        result.status = TimingStatus::timed;
        return result;
    }

  private:
    bool smooth() const { return task_.limits.smooth(); }

    // Whether the limits are constant along a piece, so that a closed form exists.
    bool uniform(std::size_t piece) const { return path_.straight(piece) && !task_.rows; }

    // The speed s' that corresponds to a velocity along the tangent at an end of the path.
    double along(std::size_t piece, double s, const std::vector<double>& velocity) const {
        std::vector<double> slope(n_);
        path_.evaluate(piece, s, 1, slope.data());
        double product = 0.0, square = 0.0;
        for (std::size_t j = 0; j < n_; ++j) {
            product += velocity[j] * slope[j];
            square += slope[j] * slope[j];
        }
        return product == 0.0 ? 0.0 : product / square;
    }

    bool stops_at(double s) const {
        const std::size_t piece = path_.piece_of(s);
        return s == path_.knots()[piece] && path_.stops(piece);
    }

    Step whole(std::size_t piece) const { return {path_.knots()[piece], path_.knots()[piece + 1], piece}; }

    // A straight piece is one step. A bent piece has the number of steps with which cubic Hermite pieces follow it at a
    // constant speed: they deviate from a function by h^4 / 384 times its fourth derivative (P. J. Davis, "Interpolation
    // and Approximation", 1975, section 3.5).
    std::vector<Step> first_grid() const {
        std::size_t bent = 0;
        for (std::size_t k = 0; k < path_.pieces(); ++k) bent += !uniform(k);
        std::vector<Step> steps;
        for (std::size_t k = 0; k < path_.pieces(); ++k) {
            std::size_t count = 1;
            if (!uniform(k)) {
                const double width = path_.knots()[k + 1] - path_.knots()[k];
                const double expected = kSpeedChange * path_.fourth(k) * std::pow(width, 4) / 384.0;
                const double wanted = std::ceil(std::pow(expected / task_.image_tolerance, 0.25));
                const double most = static_cast<double>(kMaxBentSteps);
                count = wanted < most ? static_cast<std::size_t>(std::max(wanted, 1.0)) : kMaxBentSteps;
                count =
                    std::max({count, kBentSteps,
                              task_.rows ? std::clamp(kConstrainedSteps * kFewPieces / bent, kOfManySteps, kConstrainedSteps)
                                         : (kLeastBentSteps + bent - 1) / bent});
            }
            const auto parts = divided(whole(k), count);
            steps.insert(steps.end(), parts.begin(), parts.end());
        }
        return steps;
    }

    StepLimits limits_of(std::span<const Step> steps) const {
        StepLimits limits;
        const std::size_t count = steps.size();
        limits.slope.resize(2 * count * n_);
        limits.curvature.resize(2 * count * n_);
        if (smooth()) limits.third.resize(2 * count * n_);
        limits.ceiling.assign(count + 1, std::numeric_limits<double>::infinity());
        std::vector<double> q(task_.rows ? 2 * count * n_ : 0);
        for (std::size_t i = 0; i < count; ++i) {
            const Step& step = steps[i];
            limits.length.push_back(step.end - step.begin);
            limits.uniform.push_back(uniform(step.piece));
            for (std::size_t side = 0; side < 2; ++side) {
                const std::size_t entry = (2 * i + side) * n_;
                const double s = side ? step.end : step.begin;
                path_.evaluate(step.piece, s, 1, &limits.slope[entry]);
                if (!path_.straight(step.piece)) {
                    path_.evaluate(step.piece, s, 2, &limits.curvature[entry]);
                    if (smooth()) path_.evaluate(step.piece, s, 3, &limits.third[entry]);
                }
                if (task_.rows) path_.evaluate(step.piece, s, 0, &q[entry]);
                const double speed = least(task_.limits.velocity, &limits.slope[entry]) / step.slowdown;
                double& ceiling = limits.ceiling[i + side];
                ceiling = std::min(ceiling, speed * speed);
            }
            if (stops_at(step.begin)) limits.ceiling[i] = 0.0;
        }
        ConstraintRows more;
        if (task_.rows) more = task_.rows(q, limits.slope, limits.curvature);
        limits.rows = n_ + more.rows;
        for (std::size_t i = 0; i < 2 * count; ++i) {
            const double slow = steps[i / 2].slowdown, square = slow * slow;
            for (std::size_t j = 0; j < n_; ++j) {
                limits.alpha.push_back(limits.slope[i * n_ + j]);
                limits.beta.push_back(limits.curvature[i * n_ + j]);
                limits.gamma.push_back(0.0);
                limits.bound.push_back(task_.limits.acceleration[j] / square);
            }
            double& ceiling = limits.ceiling[(i + 1) / 2];
            for (std::size_t r = i * more.rows; r < (i + 1) * more.rows; ++r) {
                if (more.alpha[r] == 0.0 && more.beta[r] != 0.0) {  // a limit of speed
                    const double margin = more.bound[r] - std::copysign(more.gamma[r], more.gamma[r] * more.beta[r]);
                    ceiling = std::min(ceiling, margin / std::abs(more.beta[r]) / square);
                }
                limits.alpha.push_back(more.alpha[r] * square);
                limits.beta.push_back(more.beta[r] * square);
                limits.gamma.push_back(more.gamma[r]);
                limits.bound.push_back(more.bound[r]);
            }
        }
        limits.ceiling.front() = start_ * start_;
        limits.ceiling.back() = end_ * end_;
        if (smooth())
            for (const Step& step : steps)
                for (double limit : task_.limits.jerk)
                    limits.jerk.push_back(limit / (step.slowdown * step.slowdown * step.slowdown));
        return limits;
    }

    // The fastest speeds without a jerk limit.
    std::optional<TimingStatus> fastest(std::span<const Step> steps, const StepLimits& limits,
                                        std::vector<double>& x) const {
        const SpeedProblem problem{limits.rows,   limits.alpha,   limits.beta,     limits.gamma, limits.bound,
                                   limits.length, limits.ceiling, start_ * start_, end_ * end_};
        x.assign(steps.size() + 1, 0.0);
        const auto stuck = fastest_speeds(problem, x);
        if (!stuck) return std::nullopt;
        if (*stuck == steps.size() && end_ > 0.0) return TimingStatus::end_too_fast;
        return start_ > 0.0 || end_ > 0.0 ? TimingStatus::ends_unreachable : TimingStatus::not_smooth;
    }

    std::optional<TimingStatus> profile_without_jerk_limit() {
        const StepLimits limits = limits_of(steps_);
        std::vector<double> x;
        if (const auto failed = fastest(steps_, limits, x)) return failed;
        profile_ = {};
        for (std::size_t i = 0; i < steps_.size(); ++i) {
            const Step& step = steps_[i];
            if (i == 0 || stops_at(step.begin)) profile_.runs.push_back(profile_.phases.size());
            const double before = std::sqrt(x[i]), after = std::sqrt(x[i + 1]), length = step.end - step.begin;
            if (uniform(step.piece)) {
                const double* slope = &limits.slope[2 * i * n_];
                const double speed = least(task_.limits.velocity, slope) / step.slowdown;
                const double acceleration = least(task_.limits.acceleration, slope) / (step.slowdown * step.slowdown);
                append_trapezoid(profile_, step.begin, length, before, after, speed, acceleration, i);
            } else {
                const double duration = 2.0 * length / (before + after);
                if (!(duration < std::numeric_limits<double>::infinity())) return TimingStatus::not_smooth;
                profile_.append(duration, {step.begin, before, (after - before) / duration}, i);
            }
        }
        mark_coarse(x);
        return std::nullopt;
    }

    std::optional<TimingStatus> first_profile_with_jerk_limit() {
        steps_.clear();
        for (std::size_t k = 0; k < path_.pieces(); ++k) {
            const bool alone = path_.stops(k) && path_.stops(k + 1) && closed_form(k, k);
            const auto parts = divided(whole(k), alone ? 1 : kEstimateSteps);
            steps_.insert(steps_.end(), parts.begin(), parts.end());
        }
        std::vector<double> x;
        if (const auto failed = fastest(steps_, limits_of(steps_), x)) return failed;
        profile_ = {};
        for (std::size_t i = 0; i < steps_.size(); ++i) {
            if (i == 0 || stops_at(steps_[i].begin)) profile_.runs.push_back(profile_.phases.size());
            const double before = std::sqrt(x[i]), after = std::sqrt(x[i + 1]);
            const double length = steps_[i].end - steps_[i].begin;
            const bool alone = x[i] == 0.0 && x[i + 1] == 0.0;  // a straight segment, timed in closed form
            const double duration = alone && uniform(steps_[i].piece) ? length : 2.0 * length / (before + after);
            if (!(duration < std::numeric_limits<double>::infinity())) return TimingStatus::not_smooth;
            profile_.append(duration, {steps_[i].begin, before, (after - before) / duration}, i);
        }
        for (std::size_t count : {kCoarseSteps, kFineSteps}) {
            steps_ = uniform_in_time(count);
            solutions_.assign(solutions_.size(), {});
            if (const auto failed = profile_with_jerk_limit()) return failed;
        }
        return std::nullopt;
    }

    // s'^2 of the present profile at the nodes of the steps (N + 1), an estimate from which a solution starts.
    std::vector<double> squared_speeds() const {
        std::vector<double> estimate{start_ * start_};
        std::size_t phase = 0;
        for (const Step& step : steps_) {  // s'^2 at the end of each step
            while (phase + 1 < profile_.phases.size() && profile_.phases[phase + 1].from.s <= step.end) ++phase;
            const Phase& p = profile_.phases[phase];
            // The time at which the phase reaches the node, by Newton's method.
            double t = p.begin;
            for (int i = 0; i < kNewtonSteps; ++i) {
                const Instant at = p.at(t);
                if (!(at.speed > 0.0)) {
                    t += 0.5 * (p.end() - t);
                    continue;
                }
                t = std::clamp(t + (step.end - at.s) / at.speed, p.begin, p.end());
            }
            const double speed = p.at(t).speed;
            estimate.push_back(speed * speed);
        }
        const double most = *std::max_element(estimate.begin(), estimate.end());
        for (double& x : estimate) x = std::max(x, kLeastEstimate * most);
        return estimate;
    }

    // The fastest motion on the steps; the solution starts from the present profile.
    std::optional<TimingStatus> profile_with_jerk_limit() {
        const StepLimits limits = limits_of(steps_);
        const std::vector<double> estimate = squared_speeds();
        profile_ = {};
        for (std::size_t first = 0; first < steps_.size();) {
            std::size_t last = first;  // after the run
            do ++last;
            while (last < steps_.size() && !stops_at(steps_[last].begin));
            profile_.runs.push_back(profile_.phases.size());
            if (const auto failed = append_run(limits, estimate, first, last)) return failed;
            first = last;
        }
        coarse_.assign(steps_.size(), 0);
        return std::nullopt;
    }

    // Append the phases of the steps of a run.
    std::optional<TimingStatus> append_run(const StepLimits& limits, const std::vector<double>& estimate,
                                           std::size_t first, std::size_t last) {
        const std::size_t count = last - first, piece = steps_[first].piece;
        if (count == 1 && closed_form(piece, piece)) {
            const double* slope = &limits.slope[2 * first * n_];
            const double slow = steps_[first].slowdown * run_slowdown_[run_[piece]];
            append_double_s(profile_, steps_[first].begin, steps_[first].end - steps_[first].begin,
                            least(task_.limits.velocity, slope) / slow,
                            least(task_.limits.acceleration, slope) / (slow * slow),
                            least(task_.limits.jerk, slope) / (slow * slow * slow), first);
            return std::nullopt;
        }
        const auto part = [&](const std::vector<double>& values, std::size_t width) {
            return std::span<const double>(values).subspan(first * width, count * width);
        };
        const JerkProblem problem{n_,
                                  limits.rows,
                                  part(limits.length, 1),
                                  std::span<const char>(limits.uniform).subspan(first, count),
                                  std::span<const double>(limits.ceiling).subspan(first, count + 1),
                                  part(limits.alpha, 2 * limits.rows),
                                  part(limits.beta, 2 * limits.rows),
                                  part(limits.gamma, 2 * limits.rows),
                                  part(limits.bound, 2 * limits.rows),
                                  part(limits.slope, 2 * n_),
                                  part(limits.curvature, 2 * n_),
                                  part(limits.third, 2 * n_),
                                  part(limits.jerk, n_),
                                  first == 0 ? start_ * start_ : 0.0,
                                  last == steps_.size() ? end_ * end_ : 0.0};
        JerkSolution& solution = solutions_[run_[piece]];
        if (solution.duration.empty())
            solution = fastest_with_jerk(problem, std::span<const double>(estimate).subspan(first, count + 1));
        const bool from_rest = problem.start == 0.0 && problem.end == 0.0;
        if (!from_rest && !(solution.excess < kUnsolved)) return TimingStatus::ends_unreachable;
        double slow = run_slowdown_[run_[piece]], total = 0.0;
        for (double h : solution.duration) total += h;
        if (!(total < std::numeric_limits<double>::infinity())) return TimingStatus::not_smooth;
        if (from_rest) slow *= std::ceil(total * slow * kNano) / (total * slow * kNano);
        for (std::size_t i = 0; i < count; ++i) {
            const double h = solution.duration[i], square = slow * slow;
            profile_.append(
                h * slow, {steps_[first + i].begin, std::sqrt(solution.x[i]) / slow, solution.a[i] / square}, first + i,
                solution.first[i] / (square * slow), (solution.last[i] - solution.first[i]) / (h * square * square));
        }
        return std::nullopt;
    }

    // Whether the pieces from `first` to `last` are one straight segment from rest to rest.
    bool closed_form(std::size_t first, std::size_t last) const {
        return first == last && uniform(first) && (first > 0 || start_ == 0.0) &&
               (last + 1 < path_.pieces() || end_ == 0.0);
    }

    // Steps that are uniform in the time of the profile on each piece, about `count` in each run.
    std::vector<Step> uniform_in_time(std::size_t count) const {
        std::vector<Step> result;
        std::size_t phase = 0;
        for (std::size_t first = 0; first < path_.pieces();) {
            std::size_t last = first;
            while (last + 1 < path_.pieces() && !path_.stops(last + 1)) ++last;
            if (closed_form(first, last)) {
                result.push_back({path_.knots()[first], path_.knots()[first + 1], first});
                while (phase < profile_.phases.size() && steps_[profile_.phases[phase].step].piece == first) ++phase;
                first = last + 1;
                continue;
            }
            std::size_t end = phase;
            std::vector<double> times{profile_.phases[phase].begin};
            for (std::size_t k = first; k <= last; ++k) {
                while (end < profile_.phases.size() && steps_[profile_.phases[end].step].piece == k) ++end;
                times.push_back(profile_.phases[end - 1].end());
            }
            const double total = times.back() - times.front();
            for (std::size_t k = first; k <= last; ++k) {
                const double begin = times[k - first], duration = times[k + 1 - first] - begin;
                const double wanted = static_cast<double>(count) * duration / total;
                std::size_t parts = path_.straight(k) ? kStraightPieceSteps : kBentPieceSteps;
                if (first == last) parts = std::max<std::size_t>(parts, 8);
                parts = std::max(parts, static_cast<std::size_t>(std::ceil(wanted)));
                double s = path_.knots()[k];
                for (std::size_t i = 1; i <= parts; ++i) {
                    const double time = begin + duration * static_cast<double>(i) / static_cast<double>(parts);
                    double next = i == parts ? path_.knots()[k + 1] : profile_.phase_at(time).at(time).s;
                    if (!(next > s) || !(next < path_.knots()[k + 1] || i == parts)) continue;
                    result.push_back({s, next, k});
                    s = next;
                }
            }
            phase = end;
            first = last + 1;
        }
        return result;
    }

    // The trajectory points: the ends of the phases, at whole nanoseconds, with a gap between them.
    HermiteCurve points() const {
        const auto& phases = profile_.phases;
        const double total = profile_.duration();
        const double gap = smooth() ? std::max(kShortestEdge, std::min(kShortestSmooth, 0.01 * total)) : kShortestPhase;
        // Ends and stops are always points.
        std::vector<char> needed(phases.size() + 1, 0);
        for (std::size_t i : profile_.runs) needed[i] = 1;
        needed.back() = 1;
        const auto time_of = [&](std::size_t i) { return i < phases.size() ? phases[i].begin : total; };
        std::vector<std::size_t> kept;
        for (std::size_t i = 0; i <= phases.size(); ++i) {
            while (needed[i] && !kept.empty() && time_of(i) - time_of(kept.back()) < gap && !needed[kept.back()])
                kept.pop_back();
            if (needed[i] || kept.empty() || time_of(i) - time_of(kept.back()) >= gap) kept.push_back(i);
        }
        HermiteCurve curve;
        curve.joints = n_;
        std::int64_t before = -1;
        std::vector<double> row(n_), other(n_);
        for (std::size_t i : kept) {
            const double time = time_of(i);
            std::int64_t count = std::llrint(time * kNano);
            if (i == phases.size()) count = std::max(count, static_cast<std::int64_t>(std::ceil(time * kNano)));
            count = std::max(count, before + 1);
            before = count;
            const double rounded = static_cast<double>(count) / kNano;
            const Phase& phase = phases[std::min(i, phases.size() - 1)];
            Instant at = i == phases.size() ? phase.at(total) : phase.at(rounded);
            if (i < phases.size() && rounded < phase.begin && i > 0) at = phases[i - 1].at(rounded);
            const bool first = i == 0, last = i == phases.size();
            const double knot = last ? path_.knots().back() : steps_[phase.step].begin;
            if (needed[i]) at = {knot, first ? start_ : last ? end_ : 0.0, 0.0};
            at.s = std::clamp(at.s, path_.knots().front(), path_.knots().back());
            at.speed = std::max(at.speed, 0.0);
            curve.times.push_back(rounded);
            curve.s.push_back(at.s);
            curve.speed.push_back(at.speed);
            curve.second.push_back(at.acceleration);
            const std::size_t piece = path_.piece_of(at.s);
            path_.evaluate(piece, at.s, 0, row.data());
            curve.q.insert(curve.q.end(), row.begin(), row.end());
            std::vector<double> slope(n_);
            path_.evaluate(piece, at.s, 1, slope.data());
            for (std::size_t j = 0; j < n_; ++j)
                curve.velocity.push_back(first  ? task_.start_velocity[j]
                                         : last ? task_.end_velocity[j]
                                                : slope[j] * at.speed);
            if (!smooth()) continue;
            // At a knot the second derivative is the mean of both sides; rounding the time moves s by up to a nanosecond.
            path_.evaluate(piece, at.s, 2, row.data());
            const double near = 2.0 * at.speed / kNano;
            if (piece > 0 && at.s - path_.knots()[piece] <= near) {
                path_.evaluate(piece - 1, path_.knots()[piece], 2, other.data());
                for (std::size_t j = 0; j < n_; ++j) row[j] = 0.5 * (row[j] + other[j]);
            } else if (piece + 1 < path_.pieces() && path_.knots()[piece + 1] - at.s <= near) {
                path_.evaluate(piece + 1, path_.knots()[piece + 1], 2, other.data());
                for (std::size_t j = 0; j < n_; ++j) row[j] = 0.5 * (row[j] + other[j]);
            }
            for (std::size_t j = 0; j < n_; ++j)
                curve.acceleration.push_back(slope[j] * at.acceleration + row[j] * at.speed * at.speed);
        }
        return curve;
    }

    // Mark the steps on both sides of a node at which the jump of s'' loses time. If the jump took place up to one step (h
    // seconds) earlier or later, the speed would differ by up to h times the jump.
    void mark_coarse(std::span<const double> x) {
        coarse_.assign(steps_.size(), 0);
        std::vector<double> speed(x.size()), h(steps_.size());
        for (std::size_t i = 0; i < x.size(); ++i) speed[i] = std::sqrt(x[i]);
        double total = 0.0;
        for (std::size_t i = 0; i < h.size(); ++i) {
            h[i] = 2.0 * (steps_[i].end - steps_[i].begin) / std::max(speed[i] + speed[i + 1], 1e-30);
            total += h[i];
        }
        for (std::size_t i = 1; i < h.size(); ++i) {
            const double before = (speed[i] - speed[i - 1]) / h[i - 1], after = (speed[i + 1] - speed[i]) / h[i];
            const double jump = std::abs(after - before), shorter = std::min(h[i - 1], h[i]);
            if (!(jump * shorter * shorter > kMaxLoss * total * std::max(speed[i], jump * shorter))) continue;
            for (std::size_t k : {i - 1, i}) coarse_[k] = !uniform(steps_[k].piece);
        }
    }

    std::size_t step_of(double s) const {
        const auto after = std::upper_bound(steps_.begin(), steps_.end(), s,
                                            [](double t, const Step& step) { return t < step.begin; });
        return after == steps_.begin() ? 0 : static_cast<std::size_t>(after - steps_.begin() - 1);
    }

    bool too_fast(double excess) const { return !(excess <= 1.0 + task_.rate_tolerance / 3.0); }  // true for NaN

    // Measure the excess and the deviation of each piece. True if the motion is within limits and tolerance.
    bool verify(const HermiteCurve& curve) {
        over_ = excess(curve, task_.limits);
        if (task_.excess) {
            const std::vector<double> more = task_.excess(curve);
            for (std::size_t i = 0; i < over_.size(); ++i)
                over_[i] = std::isnan(more[i]) ? more[i] : std::max(over_[i], more[i]);
        }
        excess_ = 0.0;
        for (double value : over_) excess_ = value > excess_ || std::isnan(value) ? value : excess_;
        away_.assign(curve.pieces(), 0.0);
        const auto measure = [&](bool proven) {
            deviation_ = 0.0;
            for (std::size_t i = 0; i < away_.size(); ++i) {
                const double middle = 0.5 * (curve.s[i] + curve.s[i + 1]);
                if (!path_.straight(path_.piece_of(middle))) away_[i] = deviation(curve, path_, i, proven);
                deviation_ = std::max(deviation_, away_[i]);
            }
            return deviation_ <= task_.image_tolerance;
        };
        return measure(false) && !too_fast(excess_) && measure(true);  // the bound takes longer than the estimate
    }

    // The number of parts into which a step is to be divided.
    std::size_t parts_of(std::size_t k, double excess, double away, int round) const {
        const Step& step = steps_[k];
        if (uniform(step.piece) || step.end - step.begin < kShortestStep * path_.knots().back()) return 1;
        double parts = 1.0;
        if (away > task_.image_tolerance)  // the deviation of a Hermite piece decreases with h^6 or h^4
            parts = std::ceil(1.1 * std::pow(away / task_.image_tolerance, smooth() ? 1.0 / 6.0 : 0.25));
        if (round < kCoarseRounds && !smooth()) {
            if (coarse_[k]) parts = std::max(parts, 3.0);
            if (excess > kSubdivideAbove) parts = std::max(parts, 2.0);
        }
        return static_cast<std::size_t>(std::min(parts, static_cast<double>(kMaxParts)));
    }

    // Slow down steps or runs that exceed a limit, and subdivide steps that deviate or are coarse.
    void adapt(const HermiteCurve& curve, int round) {
        std::vector<double> step_excess(steps_.size()), step_away(steps_.size()), run_excess(run_.back() + 1);
        for (std::size_t i = 0; i < over_.size(); ++i) {
            const std::size_t k = step_of(0.5 * (curve.s[i] + curve.s[i + 1]));
            step_excess[k] = std::max(step_excess[k], over_[i]);
            step_away[k] = std::max(step_away[k], away_[i]);
            double& worst = run_excess[run_[steps_[k].piece]];
            worst = std::max(worst, over_[i]);
        }
        // The factor grows with the rounds: a factor of the size of rounding errors might not converge.
        const double grown = 1.0 + task_.rate_tolerance * std::pow(2.0, round);
        const auto of_round = [&](std::span<const double> values) {
            return values[std::min(static_cast<std::size_t>(round), values.size() - 1)];
        };
        const double slight = smooth() ? of_round(kSlightWithJerk) : of_round(kSlight);
        const auto together = [&](std::size_t run) { return run_excess[run] <= slight || round >= kLocalRounds; };
        // With a jerk limit, a run from rest to rest is slowed down without another solution.
        const auto scaled = [&](std::size_t run) {
            return smooth() && !(run == 0 && start_ > 0.0) && !(run == run_.back() && end_ > 0.0);
        };
        std::vector<Step> next;
        for (std::size_t k = 0; k < steps_.size(); ++k) {
            const std::size_t run = run_[steps_[k].piece], count = parts_of(k, step_excess[k], step_away[k], round);
            double factor = 1.0;
            if (!together(run) && too_fast(step_excess[k]))  // the excess decreases with the square of the step
                factor = 1.0 + (step_excess[k] * grown - 1.0) / static_cast<double>(count * count);
            else if (together(run) && !scaled(run) && too_fast(run_excess[run]))
                factor = run_excess[run] * grown;
            if (factor > 1.0 || count > 1) solutions_[run] = {};
            steps_[k].slowdown *= factor;
            for (const Step& part : divided(steps_[k], count)) next.push_back(part);
        }
        if (next.size() <= kMaxSteps) steps_ = std::move(next);
        for (std::size_t run = 0; run < run_excess.size(); ++run)
            if (together(run) && scaled(run) && too_fast(run_excess[run]))
                run_slowdown_[run] *= run_excess[run] * grown;
    }

    const TimingTask& task_;
    const TimedPath& path_;
    std::size_t n_;
    double start_, end_;            // s' at both ends
    std::vector<std::size_t> run_;  // (pieces) number of stops before a piece
    std::vector<Step> steps_;
    std::vector<char> coarse_;  // (N) steps that should be subdivided, because s'' changes within them
    Profile profile_;
    // With a jerk limit, for each run: the solution on its steps, empty if they have changed, and the factor by which a
    // run from rest to rest is slower than it.
    std::vector<JerkSolution> solutions_;
    std::vector<double> run_slowdown_;
    std::vector<double> over_, away_;        // of each piece of the motion: factor over the limits, and deviation
    double deviation_ = 0.0, excess_ = 0.0;  // their largest values
};

}  // namespace

TimedMotion time_path(const TimingTask& task) { return Timing(task).solve(); }

}  // namespace pinproof
