#include "planning/route_follower.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "geometry/curve.h"
#include "geometry/rotations.h"

namespace pinproof {
namespace {

// The rotation by `share` of a rotation vector.
Mat3 rotation_by(const Vec3& vector, double share) {
    const double angle = norm(vector);
    if (!(angle > 0.0)) return {};
    return rotation_about((1.0 / angle) * vector, std::sin(angle * share), std::cos(angle * share));
}

}  // namespace

RouteSegment RouteSegment::between(const Transform& first, const Transform& last) {
    const Vec3 translation = last.translation - first.translation;
    const Vec3 rotation = rotation_vector(transposed_times(first.rotation, last.rotation));
    const double length = std::hypot(norm(translation), kLever * norm(rotation));
    if (!(length > kMinLength)) return {{}, {}, 0.0};
    return {(1.0 / length) * translation, (1.0 / length) * rotation, length};
}

// The largest coefficient of the derivative, and of the second one, bounds them.
RoutePiece::Derivatives RoutePiece::derivatives() const {
    constexpr double n = kCoefficients - 1;
    const auto largest = [](const auto& c) {
        double speed = 0.0, acceleration = 0.0;
        for (std::size_t i = 0; i + 1 < c.size(); ++i) speed = std::max(speed, std::abs(c[i + 1] - c[i]));
        for (std::size_t i = 0; i + 2 < c.size(); ++i)
            acceleration = std::max(acceleration, std::abs(c[i + 2] - 2.0 * c[i + 1] + c[i]));
        return std::pair{n * speed, n * (n - 1.0) * acceleration};
    };
    const auto [speed_in, acceleration_in] = largest(a);
    const auto [speed_out, acceleration_out] = largest(b);
    const double turn_in = speed_in * norm(into.rotation), turn_out = speed_out * norm(out.rotation);
    const double width = end - start;
    return {(acceleration_in * norm(into.translation) + acceleration_out * norm(out.translation)) / (width * width),
            (turn_in + turn_out) / width,
            (acceleration_in * norm(into.rotation) + acceleration_out * norm(out.rotation) + turn_in * turn_out) /
                (width * width)};
}

Transform RoutePiece::at(double u) const {
    auto before = a, after = b;
    const double back = value_at(before, u), on = value_at(after, u);
    return {pose.rotation * (rotation_by(into.rotation, -back) * rotation_by(out.rotation, on)),
            pose.translation - back * into.translation + on * out.translation};
}

const RoutePiece& Route::piece_at(double s) const {
    const auto next = std::upper_bound(pieces.begin() + 1, pieces.end(), s,
                                       [](double at, const RoutePiece& piece) { return at < piece.start; });
    return *(next - 1);
}

Route Route::of(std::vector<RoutePiece> pieces) {
    double length = 0.0, passed = 0.0;
    for (const RoutePiece& piece : pieces) length += piece.width;
    for (std::size_t i = 0; i < pieces.size(); ++i) {
        const double count = static_cast<double>(pieces.size());
        pieces[i].start = i == 0 ? 0.0 : pieces[i - 1].end;
        passed += pieces[i].width;
        pieces[i].end = length > 0.0 ? passed / length : static_cast<double>(i + 1) / count;
    }
    pieces.back().end = 1.0;
    return {std::move(pieces)};
}

Route Route::straight(const Transform& first, const Transform& last) {
    const RouteSegment segment = RouteSegment::between(first, last);
    RoutePiece piece{first, segment, segment, {}, {}, segment.length};
    for (std::size_t i = 0; i < piece.b.size(); ++i)
        piece.b[i] = segment.length * static_cast<double>(i) / static_cast<double>(piece.b.size() - 1);
    return of({piece});
}

Transform Route::pose(double s) const {
    const RoutePiece& piece = piece_at(s);
    const double width = piece.end - piece.start;
    return piece.at(width > 0.0 ? std::clamp((s - piece.start) / width, 0.0, 1.0) : 0.0);
}

namespace {

// Maximum number of rounds in which the spacing of the poses is reduced.
constexpr int kMaxRounds = 16;

// Fraction of the initial spacing below which no piece is subdivided. A faster change counts as a jump.
constexpr double kMinSpacing = 1.0 / 64;

// rad or m: excess over a joint limit that is attributed to floating-point errors.
constexpr double kRounding = 1e-9;

// rad or m: the reduction of the limits in a second attempt; it exceeds the overshoot of a spline.
constexpr double kLimitGuard = 2e-3;

// The least number of pieces of a route: a spline through fewer poses is only a parabola.
constexpr double kMinPieces = 3.0;

// Number of parts into which the piece is divided in which the route becomes unreachable, to locate the end.
constexpr int kEndParts = 8;

// Fraction of the maximum step from which a joint counts as limited by it.
constexpr double kFullStep = 1.0 - 1e-6;

// Fraction of the allowed deviation that the term h^2 / 8 sup |D''| may take. It determines the number of samples.
constexpr double kSamplingShare = 0.1;

// Minimum and maximum number of sampling steps on a piece. A piece that requires more must be subdivided.
constexpr double kMinSamples = 3.0, kMaxSamples = 4096.0;

// Control points of a cubic piece.
constexpr std::size_t kCubic = 4;

using Flags = std::vector<bool>;

// The knots with the selected pieces divided into equal parts.
std::vector<double> subdivided(const std::vector<double>& knots, const Flags& which, int parts) {
    std::vector<double> out{knots.front()};
    for (std::size_t i = 0; i + 1 < knots.size(); ++i) {
        if (which[i])
            for (int k = 1; k < parts; ++k)
                out.push_back(knots[i] + (knots[i + 1] - knots[i]) * (static_cast<double>(k) / parts));
        out.push_back(knots[i + 1]);
    }
    return out;
}

// (k - 1, 4, n) the control points of the pieces between points with given slopes.
std::vector<double> hermite(std::span<const double> knots, std::span<const double> q, std::span<const double> slopes,
                            std::size_t n) {
    const std::size_t pieces = knots.size() - 1;
    std::vector<double> control(pieces * kCubic * n);
    for (std::size_t i = 0; i < pieces; ++i) {
        const double third = (knots[i + 1] - knots[i]) / 3.0;
        double* out = control.data() + i * kCubic * n;
        for (std::size_t j = 0; j < n; ++j) {
            const std::size_t left = i * n + j, right = left + n;
            out[j] = q[left];
            out[n + j] = q[left] + third * slopes[left];
            out[2 * n + j] = q[right] - third * slopes[right];
            out[3 * n + j] = q[right];
        }
    }
    return control;
}

}  // namespace

std::vector<double> spline_slopes(std::span<const double> knots, std::span<const double> points, std::size_t n) {
    const std::size_t k = knots.size();
    std::vector<double> slopes(k * n);
    if (k < 2) return slopes;
    std::vector<double> h(k - 1);
    for (std::size_t i = 0; i + 1 < k; ++i) h[i] = knots[i + 1] - knots[i];
    const auto mean = [&](std::size_t i, std::size_t j) { return (points[(i + 1) * n + j] - points[i * n + j]) / h[i]; };
    if (k <= 3) {
        for (std::size_t j = 0; j < n; ++j) {
            const double first = mean(0, j);
            const double middle = k == 2 ? first : (h[0] * mean(1, j) + h[1] * first) / (h[0] + h[1]);
            slopes[j] = 2.0 * first - middle;
            slopes[n + j] = middle;
            if (k == 3) slopes[2 * n + j] = 2.0 * mean(1, j) - middle;
        }
        return slopes;
    }
    // The tridiagonal system, by elimination without pivoting: after the first row, which is subtracted from the
    // second, every row is diagonally dominant, and the last diagonal is positive.
    std::vector<double> above(k);  // the entry right of the diagonal divided by the diagonal
    const auto row = [&](std::size_t i, double below, double diagonal, double next, auto right_side) {
        const double pivot = diagonal - (i == 0 ? 0.0 : below * above[i - 1]);
        above[i] = next / pivot;
        for (std::size_t j = 0; j < n; ++j)
            slopes[i * n + j] = (right_side(j) - (i == 0 ? 0.0 : below * slopes[(i - 1) * n + j])) / pivot;
    };
    const double both = h[0] + h[1], last = h[k - 3] + h[k - 2];
    row(0, 0.0, h[1], both, [&](std::size_t j) {
        return ((h[0] + 2.0 * both) * h[1] * mean(0, j) + h[0] * h[0] * mean(1, j)) / both;
    });
    for (std::size_t i = 1; i + 1 < k; ++i)
        row(i, h[i], 2.0 * (h[i - 1] + h[i]), h[i - 1],
            [&](std::size_t j) { return 3.0 * (h[i] * mean(i - 1, j) + h[i - 1] * mean(i, j)); });
    row(k - 1, last, h[k - 3], 0.0, [&](std::size_t j) {
        return (h[k - 2] * h[k - 2] * mean(k - 3, j) + (2.0 * last + h[k - 2]) * h[k - 3] * mean(k - 2, j)) / last;
    });
    for (std::size_t i = k - 1; i-- > 0;)
        for (std::size_t j = 0; j < n; ++j) slopes[i * n + j] -= above[i] * slopes[(i + 1) * n + j];
    return slopes;
}

// Poses that are solved one after another, up to the first that cannot be reached although no joint was limited by its
// step; the rest of q and limited is then undefined.
struct RouteFollower::Tracked {
    std::vector<double> q;   // (k, n), with the first configuration
    Flags limited;           // (k - 1) the pieces in which a joint moved by the maximum step
    std::size_t unreached;   // the first piece whose end is not reached; k - 1 if all are
    std::vector<Tracker::State> states;  // at the knots that were reached

    // Solve the poses at the knots after number `begin`; those up to it were solved before, with the same knots.
    void solve(Tracker& tracker, const TrackingTask& tracking, const Route& route, std::span<const double> knots,
               std::size_t begin) {
        const std::size_t pieces = knots.size() - 1, n = tracker.q().size();
        tracker.resume(states[begin]);
        states.resize(begin + 1);
        limited.resize(begin);
        limited.resize(pieces, false);
        q.resize((pieces + 1) * n);
        unreached = pieces;
        for (std::size_t i = begin; i < pieces; ++i) {
            const Transform target = route.pose(knots[i + 1]);
            tracker.step(target, 1.0);
            const double *before = q.data() + i * n, *after = tracker.q().data();
            std::copy_n(after, n, q.data() + (i + 1) * n);
            for (std::size_t j = 0; j < n; ++j)
                if (std::abs(after[j] - before[j]) / tracking.speed[j] >= kFullStep) limited[i] = true;
            if (unreached < pieces) continue;
            if (!fulfils(tracking.task, measure(tracking.task, target, forward_kinematics(tracking.chain, after)))) {
                unreached = i;
                if (!limited[i]) break;
            } else {
                states.push_back(tracker.state());
            }
        }
    }
};

RouteFollower::RouteFollower(TrackingTask tracking, const FollowerSettings& settings)
    : tracking_(std::move(tracking)), settings_(settings) {
    const Task& task = tracking_.task;
    position_ = task.positions > 0;
    for (int axis = 0; axis < 3; ++axis)
        if (task.angles == 3 || (task.angles == 2 && task.mask.angular[axis] == 0.0)) columns_.push_back(axis);
    scale_ = task.angles == 3 ? std::numbers::sqrt2 : 1.0;
}

std::size_t RouteFollower::outside(std::span<const double> q) const {
    for (std::size_t j = 0; j < dof(); ++j)
        if (!(q[j] >= tracking_.lower[j] - kRounding && q[j] <= tracking_.upper[j] + kRounding)) return j;
    return dof();
}

JointCurve RouteFollower::follow(const Route& route, const std::vector<double>& first) const {
    const std::vector<double> knots = first_knots(route);
    JointCurve curve = follow_within(tracking_, route, knots, first);
    const bool leaves_limits = curve.stop == RouteStop::kDeviation && std::ranges::max(curve.outside) > kRounding;
    if (!leaves_limits || dof() <= static_cast<std::size_t>(tracking_.task.positions + tracking_.task.angles))
        return curve;
    TrackingTask inside = tracking_;
    for (std::size_t j = 0; j < dof(); ++j) {
        const double guard = std::min(kLimitGuard, 0.25 * (inside.upper[j] - inside.lower[j]));
        inside.lower[j] = std::min(inside.lower[j] + guard, first[j]);
        inside.upper[j] = std::max(inside.upper[j] - guard, first[j]);
    }
    JointCurve second = follow_within(inside, route, knots, first);
    return second.knots.back() > curve.knots.back() ? second : curve;
}

// The borders of the pieces and parameters between them, such that none of the intervals exceeds the steps.
std::vector<double> RouteFollower::first_knots(const Route& route) const {
    const double least = kMinPieces / static_cast<double>(route.pieces.size());
    std::vector<double> knots;
    for (const RoutePiece& piece : route.pieces) {
        const RouteSegment& along = piece.out;
        const double steps = std::ceil(along.length * std::max(norm(along.translation) / settings_.translation_step,
                                                               norm(along.rotation) / settings_.rotation_step));
        const double share = along.length > 0.0 ? piece.width / along.length : 0.0;
        const double count = std::ceil(std::max({steps * share, least, 1.0}));
        for (double k = 0.0; k < count; k += 1.0) knots.push_back(piece.start + k * ((piece.end - piece.start) / count));
    }
    knots.push_back(1.0);
    return knots;
}

JointCurve RouteFollower::follow_within(const TrackingTask& tracking, const Route& route, std::vector<double> knots,
                                        const std::vector<double>& first) const {
    const std::size_t n = dof();
    double spacing = 0.0;
    for (std::size_t i = 0; i + 1 < knots.size(); ++i) spacing = std::max(spacing, knots[i + 1] - knots[i]);
    JointCurve curve;
    Tracker tracker(tracking, first);
    Tracked tracked{first, {}, 0, {tracker.state()}};
    std::size_t solved = 0;  // the number of the knot up to which poses are solved
    for (int round = 1; knots.size() > 1; ++round) {
        const std::size_t pieces = knots.size() - 1;
        const auto wide = [&](std::size_t i) {
            return round <= kMaxRounds && knots[i + 1] - knots[i] > kMinSpacing * spacing;
        };
        tracked.solve(tracker, tracking, route, knots, solved);
        if (const std::size_t at = tracked.unreached; at < pieces) {
            solved = at;
            Flags which(pieces);
            if (wide(at) && tracked.limited[at]) {
                for (std::size_t i = at; i < pieces; ++i) which[i] = tracked.limited[i] && wide(i);
                knots = subdivided(knots, which, 2);
            } else if (wide(at)) {
                which[at] = true;
                knots = subdivided(knots, which, kEndParts);
            } else {
                curve.stop = RouteStop::kPose;
                curve.at = knots[at + 1];
                const double* q = tracked.q.data() + at * n;
                curve.before.assign(q, q + n);
                curve.reached.assign(q + n, q + 2 * n);
                curve.lower = tracking.lower;
                curve.upper = tracking.upper;
                curve.spacing = spacing;
                knots.resize(settings_.only_complete ? 1 : at + 1);
            }
            continue;
        }
        std::vector<double> slopes = spline_slopes(knots, tracked.q, n);
        const std::vector<double> control = hermite(knots, tracked.q, slopes, n);
        const std::vector<RouteDeviation> off = deviations(route, knots, control);
        std::vector<double> outside(pieces * n, -std::numeric_limits<double>::infinity());
        Flags bad(pieces);
        std::size_t worst = pieces;  // the first bad piece
        for (std::size_t i = pieces; i-- > 0;) {
            bad[i] = !(off[i].position <= settings_.deviation && off[i].orientation <= settings_.rotation_deviation);
            for (std::size_t r = 0; r < kCubic; ++r)
                for (std::size_t j = 0; j < n; ++j) {
                    const double q = control[(i * kCubic + r) * n + j];
                    outside[i * n + j] = 
                        std::max({outside[i * n + j], tracking_.lower[j] - q, q - tracking_.upper[j]});
                }
            for (std::size_t j = 0; j < n; ++j)
                if (outside[i * n + j] > kRounding) bad[i] = true;
            if (bad[i]) worst = i;
        }
        if (worst == pieces) {
            for (const RouteDeviation& each : off) {
                curve.deviation = std::max(curve.deviation, each.position);
                curve.rotation_deviation = std::max(curve.rotation_deviation, each.orientation);
            }
            curve.knots = std::move(knots);
            curve.q = std::move(tracked.q);
            curve.slopes = std::move(slopes);
            return curve;
        }
        solved = worst;
        if (wide(worst)) {
            for (std::size_t i = 0; i < pieces; ++i) bad[i] = bad[i] && wide(i);
            knots = subdivided(knots, bad, 2);
        } else {
            curve.stop = RouteStop::kDeviation;
            curve.deviation_there = off[worst].position;
            curve.rotation_deviation_there = off[worst].orientation;
            curve.outside.assign(outside.begin() + worst * n, outside.begin() + (worst + 1) * n);
            knots.resize(settings_.only_complete ? 1 : worst + 1);
        }
    }
    curve.knots = {knots.front()};
    curve.q = first;
    curve.slopes.assign(n, 0.0);
    return curve;
}

// How far the tcp is at most from the origin of each joint, 1 for a prismatic joint.
std::vector<double> RouteFollower::levers(std::span<const double> control) const {
    const Chain& chain = tracking_.chain;
    const std::size_t n = dof(), m = chain.joints.size();
    std::vector<double> reached(n, 0.0), out(m);
    for (std::size_t i = 0; i < control.size(); ++i) reached[i % n] = std::max(reached[i % n], std::abs(control[i]));
    double lever = norm(chain.tool.translation);
    for (std::size_t k = m; k-- > 0;) {
        const Joint& joint = chain.joints[k];
        out[k] = joint.prismatic ? 1.0 : lever;
        if (joint.prismatic) lever += std::abs(joint.multiplier) * reached[joint.index] + std::abs(joint.offset);
        lever += norm(joint.before.translation);
    }
    return out;
}

// |D| of position and of orientation at a configuration.
RouteDeviation RouteFollower::difference(const Route& route, double s, const double* q) const {
    const Transform wanted = route.pose(s), actual = forward_kinematics(tracking_.chain, q);
    double square = 0.0;
    for (int axis : columns_) square += squared_norm(actual.rotation.column(axis) - wanted.rotation.column(axis));
    return {norm(actual.translation - wanted.translation), std::sqrt(square)};
}

std::vector<RouteDeviation> RouteFollower::deviations(const Route& route, std::span<const double> knots,
                                                      std::span<const double> control) const {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    const Chain& chain = tracking_.chain;
    const std::size_t n = dof(), pieces = knots.size() - 1;
    const std::vector<double> lever = levers(control);
    const double chord = 2.0 * scale_ * std::sin(std::min(settings_.rotation_deviation, std::numbers::pi) / 2.0);
    std::vector<RouteDeviation> out(pieces);
    std::vector<double> rate(n), second(n), q(n);
    RouteDeviation here = difference(route, knots[0], control.data());  // at the end of the last piece
    for (std::size_t i = 0; i < pieces; ++i) {
        const double width = knots[i + 1] - knots[i];
        const double* c = control.data() + i * kCubic * n;
        for (std::size_t j = 0; j < n; ++j) {
            const double d0 = c[n + j] - c[j], d1 = c[2 * n + j] - c[n + j], d2 = c[3 * n + j] - c[2 * n + j];
            rate[j] = 3.0 / width * std::max({std::abs(d0), std::abs(d1), std::abs(d2)});
            second[j] = 6.0 / (width * width) * std::max(std::abs(d1 - d0), std::abs(d2 - d1));
        }
        double linear = 0.0, turning = 0.0, change = 0.0;
        for (std::size_t k = 0; k < chain.joints.size(); ++k) {
            const Joint& joint = chain.joints[k];
            const double share = std::abs(joint.multiplier);
            const double speed = share * rate[joint.index], bend = share * second[joint.index];
            const double turn = joint.prismatic ? 0.0 : speed;
            linear += lever[k] * bend + lever[k] * speed * (turn + 2.0 * turning);
            change += (joint.prismatic ? 0.0 : bend) + turn * turning;
            turning += turn;
        }
        const RoutePiece::Derivatives wanted = route.piece_at(0.5 * (knots[i] + knots[i + 1])).derivatives();
        linear += wanted.acceleration;
        const double angular =
            scale_ * (change + turning * turning + wanted.turn_change + wanted.turn * wanted.turn);
        double steps = 0.0;
        if (position_) steps = width * std::sqrt(linear / (8.0 * kSamplingShare * settings_.deviation));
        if (!columns_.empty()) steps = std::max(steps, width * std::sqrt(angular / (8.0 * kSamplingShare * chord)));
        const bool skipped = !(steps <= kMaxSamples);
        const double count = skipped ? kMinSamples : std::clamp(std::ceil(steps), kMinSamples, kMaxSamples);
        RouteDeviation most = here;
        for (double sample = 1.0; sample <= count; sample += 1.0) {
            const bool at_end = sample == count;
            const double u = sample / count;
            for (std::size_t j = 0; j < n; ++j) {
                double p[kCubic] = {c[j], c[n + j], c[2 * n + j], c[3 * n + j]};
                q[j] = value_at(p, u);
            }
            here = difference(route, at_end ? knots[i + 1] : knots[i] + width * u, q.data());
            most = {std::max(most.position, here.position), std::max(most.orientation, here.orientation)};
        }
        const double h = width / count, remainder = h * h / 8.0;
        most.position += remainder * linear;
        most.orientation =
            2.0 * std::asin(std::min((most.orientation + remainder * angular) / (2.0 * scale_), 1.0));
        if (!position_) most.position = 0.0;
        if (columns_.empty()) most.orientation = 0.0;
        out[i] = skipped ? RouteDeviation{infinity, infinity} : most;
    }
    return out;
}

}  // namespace pinproof
