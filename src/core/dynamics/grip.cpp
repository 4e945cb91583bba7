#include "dynamics/grip.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

namespace pinproof {
namespace {

// The cost of a unit wrench along an axis before its share is known, times the sum of the forces. A grip whose share is
// above a hundredth of it is considered not to transmit this wrench.
constexpr double kUnknown = 1e7;

// Largest number of pivots for one wrench. The bound after them is valid, but less tight.
constexpr int kMaxPivots = 400;

// Smallest entry of a column that may leave the basis.
constexpr double kPivot = 1e-11;

// Smallest square of the share of a vector across a normal whose direction is known.
constexpr double kAcross = 1e-16;

// By this share of its bound by the axes a wrench is displaced, because a basis is degenerate for wrenches in a plane of
// symmetry. What a displacement may change is added to the bound.
constexpr double kDisplaced = 1e-7;
// Where the axes bound the share by much more than it is, what the displacement may change is not small beside the share.
// It is then found again with this displacement, from the basis of the first.
constexpr double kDisplacedLess = 1e-11;
constexpr double kRounded = 1e-5;  // share above which the basis is not used again
constexpr Wrench kIrregular = {0.61, -0.87, 0.43, -0.53, 0.97, 0.71};

// The section of W is cut off at so many times the extent of its axes.
constexpr double kFarthest = 30.0;

double dot(const Wrench& a, const Wrench& b) { return std::inner_product(a.begin(), a.end(), b.begin(), 0.0); }

Wrench along(const Wrench& g, double s, const Wrench& d) {
    Wrench sum;
    for (std::size_t k = 0; k < 6; ++k) sum[k] = g[k] + s * d[k];
    return sum;
}

void add(Wrench& to, double share, const Vec3& force, const Vec3& at) {
    const Vec3 moment = cross(at, force);
    for (int k = 0; k < 3; ++k) {
        to[static_cast<std::size_t>(k)] += share * force[k];
        to[static_cast<std::size_t>(k) + 3] += share * moment[k];
    }
}

}  // namespace

Grip::Grip(const std::vector<GripContact>& contacts) {
    // The centre of all points, and their mean distance from it
    double count = 0.0, total = 0.0;
    const auto each_point = [&](auto visit) {
        for (const GripContact& contact : contacts)
            for (std::size_t k = 0; k < contact.points.size(); k += 3)
                visit(Vec3{contact.points[k], contact.points[k + 1], contact.points[k + 2]});
    };
    each_point([&](const Vec3& point) { centre_ += point, count += 1.0; });
    centre_ = (1.0 / count) * centre_;
    each_point([&](const Vec3& point) { length_ += norm(point - centre_) / count; });
    length_ = std::max(length_, 1e-6);
    for (const GripContact& contact : contacts) {
        const std::size_t points = contact.points.size() / 3, distributions = contact.distributions.size() / points;
        Contact own{std::vector<LaneVec3>((points + 3) / 4), std::vector<Lanes>((points + 3) / 4 * distributions),
                    contact.normal, (contact.pulls ? 2.0 : 1.0) * contact.force, contact.friction, distributions};
        for (std::size_t k = 0; k < points; ++k) {
            const double* at = contact.points.data() + 3 * k;
            const Vec3 point = (1.0 / length_) * (Vec3{at[0], at[1], at[2]} - centre_);
            own.points[k / 4].set(static_cast<int>(k % 4), point);
            for (std::size_t d = 0; d < distributions; ++d)
                own.shares[k / 4 * distributions + d][k % 4] = contact.distributions[d * points + k];
            if (contact.pulls) add(offset_, -contact.force * contact.distributions[k], contact.normal, point);
        }
        total += own.most;
        contacts_.push_back(std::move(own));
    }
    // The shares of the axes; first they are only known to be at most kUnknown, if the grip transmits them at all
    for (auto& both : axes_) both.fill(kUnknown / total);
    std::array<std::array<double, 2>, 6> found{};
    double most = 0.0, rest = 0.0;
    for (std::size_t k = 0; k < 6; ++k)
        for (std::size_t side = 0; side < 2; ++side) {
            ShareOfGrip share(*this);
            Wrench unit{};
            unit[k] = side == 0 ? 1.0 : -1.0;
            Wrench displaced = unit;
            for (std::size_t i = 0; i < 6; ++i) displaced[i] += 1e-3 * kDisplaced * kIrregular[i];
            share.solve(displaced, kDisplaced);
            found[k][side] = dot(share.cost_, share.shares_);
            most = std::max(most, found[k][side]);
            double error = 0.0;
            for (std::size_t i = 0; i < 6; ++i) {
                double left = unit[i];
                for (std::size_t j = 0; j < 6; ++j) left -= share.shares_[j] * share.columns_[j][i];
                error += std::abs(left);
            }
            rest = std::max(rest, error);
        }
    // The share of an axis is at most that of the displaced one and those of the rest, each at most the largest
    for (std::size_t k = 0; k < 6; ++k)
        for (std::size_t side = 0; side < 2; ++side) axes_[k][side] = found[k][side] + rest * most / (1.0 - rest);
    complete_ = most * total < 0.01 * kUnknown;
}

double Grip::support(const Wrench& a, Wrench& at) const {
    at = offset_;
    double value = dot(a, offset_);
    thread_local std::vector<LaneVec3> across;
    thread_local std::vector<Lanes> sizes, totals;
    for (const Contact& contact : contacts_) {
        // The best value of a unit normal force at each point; u is the velocity of the point of a body that moves with a
        const Vec3 n = contact.normal;
        across.resize(contact.points.size()), sizes.resize(contact.points.size());
        totals.assign(contact.distributions, Lanes{});
        for (std::size_t k = 0; k < contact.points.size(); ++k) {
            const auto& [x, y, z] = contact.points[k];
            const Lanes ux = a[0] + a[4] * z - a[5] * y, uy = a[1] + a[5] * x - a[3] * z, uz = a[2] + a[3] * y - a[4] * x;
            const Lanes along = ux * n.x + uy * n.y + uz * n.z;
            across[k] = {ux - along * n.x, uy - along * n.y, uz - along * n.z};
            const auto& t = across[k];
            // where only rounding is left across the normal, its direction is unknown, and no friction is needed
            const Lanes square = t.x * t.x + t.y * t.y + t.z * t.z;
            sizes[k] = square > kAcross * (square + along * along) ? lanes_sqrt(square) : Lanes{};
            const Lanes values = along + contact.friction * sizes[k];
            const Lanes* shares = contact.shares.data() + k * contact.distributions;
            for (std::size_t d = 0; d < contact.distributions; ++d) totals[d] += values * shares[d];
        }
        // The best distribution
        std::size_t best = 0;
        double most = 0.0;
        for (std::size_t d = 0; d < contact.distributions; ++d)
            if (const double total = sum(totals[d]); total > most) most = total, best = d;
        if (!(most > 0.0)) continue;
        value += contact.most * most;
        Lanes fx{}, fy{}, fz{}, mx{}, my{}, mz{};
        for (std::size_t k = 0; k < contact.points.size(); ++k) {
            const auto& [x, y, z] = contact.points[k];
            const Lanes share = contact.most * contact.shares[k * contact.distributions + best];
            const Lanes slip = sizes[k] > 0.0 ? contact.friction * share / sizes[k] : Lanes{};
            const Lanes gx = slip * across[k].x + share * n.x, gy = slip * across[k].y + share * n.y,
                        gz = slip * across[k].z + share * n.z;
            fx += gx, fy += gy, fz += gz;
            mx += y * gz - z * gy, my += z * gx - x * gz, mz += x * gy - y * gx;
        }
        const Wrench own = {sum(fx), sum(fy), sum(fz), sum(mx), sum(my), sum(mz)};
        for (std::size_t i = 0; i < 6; ++i) at[i] += own[i];
    }
    return value;
}

Wrench Grip::local(const Wrench& w) const {
    const Vec3 moment = Vec3{w[3], w[4], w[5]} - cross(centre_, Vec3{w[0], w[1], w[2]});
    return {w[0], w[1], w[2], moment.x / length_, moment.y / length_, moment.z / length_};
}

Wrench Grip::local_error(const Wrench& e) const {
    const double x = std::abs(centre_.x), y = std::abs(centre_.y), z = std::abs(centre_.z);
    return {e[0], e[1], e[2], (e[3] + y * e[2] + z * e[1]) / length_, (e[4] + z * e[0] + x * e[2]) / length_,
            (e[5] + x * e[1] + y * e[0]) / length_};
}

double Grip::share_of_error(const Wrench& error) const {
    double share = 0.0;
    for (std::size_t k = 0; k < 6; ++k) share += error[k] * std::max(axes_[k][0], axes_[k][1]);
    return share;
}

double ShareOfGrip::operator()(const Wrench& wrench) {
    const double share = solve(wrench, kDisplaced);
    return error_ > kShareTolerance * share ? std::min(solve(wrench, kDisplacedLess), share) : share;
}

double ShareOfGrip::solve(const Wrench& wrench, double displaced) {
    // The wrench is displaced a little, see kDisplaced
    double bound = 0.0;
    for (std::size_t k = 0; k < 6; ++k) bound += std::abs(wrench[k]) * axis(k, wrench[k]);
    if (bound == 0.0) return error_ = 0.0;
    Wrench w = wrench;
    for (std::size_t k = 0; k < 6; ++k) w[k] += displaced * bound * kIrregular[k] / axis(k, kIrregular[k]);
    // The basis of the last wrench, or that of the axes. A column of which a negative share would be needed is reversed;
    // the axes bound what that costs
    for (std::size_t i = 0; i < 6; ++i) {
        if (!started_) {
            columns_[i] = inverse_[i] = {};
            columns_[i][i] = inverse_[i][i] = 1.0;
            cost_[i] = axis(i, 1.0);
        }
        shares_[i] = dot(inverse_[i], w);
        if (shares_[i] >= 0.0) continue;
        shares_[i] = -shares_[i];
        cost_[i] = 0.0;
        for (std::size_t k = 0; k < 6; ++k) {
            columns_[i][k] = -columns_[i][k], inverse_[i][k] = -inverse_[i][k];
            cost_[i] += std::abs(columns_[i][k]) * axis(k, columns_[i][k]);
        }
    }
    for (int pivots = 0; pivots < kMaxPivots; ++pivots) {
        Wrench dual{}, column;
        for (std::size_t i = 0; i < 6; ++i)
            for (std::size_t k = 0; k < 6; ++k) dual[k] += cost_[i] * inverse_[i][k];
        if ((grip_.support(dual, column) - dot(dual, from_)) * (1.0 - kShareTolerance) <= 1.0) break;
        for (std::size_t k = 0; k < 6; ++k) column[k] -= from_[k];
        // The column enters, and the one whose share becomes 0 first leaves
        Wrench entries;
        std::size_t out = 6;
        double step = std::numeric_limits<double>::infinity();
        for (std::size_t i = 0; i < 6; ++i) {
            entries[i] = dot(inverse_[i], column);
            if (entries[i] > kPivot && shares_[i] < step * entries[i]) step = shares_[i] / entries[i], out = i;
        }
        if (out == 6) break;
        for (std::size_t k = 0; k < 6; ++k) inverse_[out][k] /= entries[out];
        for (std::size_t i = 0; i < 6; ++i) {
            if (i == out) continue;
            for (std::size_t k = 0; k < 6; ++k) inverse_[i][k] -= entries[i] * inverse_[out][k];
            shares_[i] = std::max(shares_[i] - step * entries[i], 0.0);
        }
        shares_[out] = step, columns_[out] = column, cost_[out] = 1.0;
    }
    // What the basis does not represent, by rounding and the displacement, is bounded by the axes
    Wrench rest = wrench;
    for (std::size_t j = 0; j < 6; ++j)
        for (std::size_t k = 0; k < 6; ++k) rest[k] -= shares_[j] * columns_[j][k];
    for (double& each : rest) each = std::abs(each);
    error_ = axes_ * grip_.share_of_error(rest);
    started_ = error_ < kRounded * bound;
    return dot(cost_, shares_) + error_;
}

double ShareOfGrip::reach(const Wrench& g, const Wrench& d, double kept) {
    if ((*this)(along(g, 1.0, d)) <= kept) return 1.0;
    // Less than is kept, so that the share at the end is at most that, whichever basis it is computed from
    const double aim = (1.0 - 2.0 * kShareTolerance) * kept, at_rest = (*this)(g);
    if (!(aim > 0.0) || !(at_rest < aim)) return 0.0;
    const Wrench none{}, from = along(none, 1.0 / aim, g);
    const double share = (*this)(from);
    return share < 1.0 ? std::min(aim / ShareOfGrip(grip_, from, share)(d), 1.0) : 0.0;
}

Section section_of(const Grip& grip, ShareOfGrip& share, const Wrench& alpha, const Wrench& beta, const Wrench& gamma) {
    Section section;
    section.at_rest = share(gamma);
    if (!(section.at_rest < 1.0)) return section;
    // Rays in the half plane s'^2 >= 0, in units in which both axes are of similar extent, cut the section at points of W
    ShareOfGrip beyond(grip, gamma, section.at_rest);
    const double unit_x = 1.0 / std::max(beyond(alpha), 1e-9), unit_y = 1.0 / std::max(beyond(beta), 1e-9);
    std::array<std::array<double, 2>, kChords + 1> points;
    for (std::size_t k = 0; k <= kChords; ++k) {
        const double angle = std::numbers::pi * static_cast<double>(k) / static_cast<double>(kChords);
        const double x = unit_x * std::cos(angle), y = k == 0 || k == kChords ? 0.0 : unit_y * std::sin(angle);
        Wrench ray;
        for (std::size_t i = 0; i < 6; ++i) ray[i] = x * alpha[i] + y * beta[i];
        const double s = 1.0 / std::max(beyond(ray), 1.0 / kFarthest);
        points[k] = {s * x, s * y};
    }
    for (std::size_t k = 0; k < kChords; ++k) {
        const auto [x0, y0] = points[k];
        const auto [x1, y1] = points[k + 1];
        const double level = x0 * y1 - x1 * y0;
        section.rows[k] = {(y1 - y0) / level, (x0 - x1) / level};
        for (const auto& [x, y] : points)
            section.below[k] = std::max(section.below[k], -section.rows[k][0] * x - section.rows[k][1] * y);
    }
    return section;
}

}  // namespace pinproof
