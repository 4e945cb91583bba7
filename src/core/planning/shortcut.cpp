#include "planning/shortcut.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace pinproof {
namespace {

// Fraction of the path length (Euclidean). A change that saves less does not justify its checks.
constexpr double kMinGain = 2e-3;

// The same for the moves that tighten a path, and the maximum number of passes of these.
constexpr double kTightGain = 2e-4;
constexpr int kTightPasses = 6;

// Smallest square that is divided by.
constexpr double kTiny = std::numeric_limits<double>::min();

// Number of consecutive random shortcuts without gain after which no more are tried.
constexpr int kPatience = 8;

// Number of passes over the waypoints before and after the random shortcuts.
constexpr int kPassesBefore = 1, kPassesAfter = 2;

// Number of orthonormal bases along whose vectors waypoints are moved.
constexpr int kBases = 3;

double distance(const std::vector<double>& a, const std::vector<double>& b) {
    return std::sqrt(squared_distance(a.data(), b.data(), a.size()));
}

// a + share (b - a)
std::vector<double> between(const std::vector<double>& a, const std::vector<double>& b, double share) {
    std::vector<double> q(a.size());
    for (std::size_t j = 0; j < a.size(); ++j) q[j] = a[j] + (b[j] - a[j]) * share;
    return q;
}

// The lengths of a path up to each waypoint.
std::vector<double> lengths_along(const std::vector<std::vector<double>>& path) {
    std::vector<double> at{0.0};
    for (std::size_t i = 0; i + 1 < path.size(); ++i) at.push_back(at.back() + distance(path[i], path[i + 1]));
    return at;
}

// A path of straight edges. Each operation keeps its ends, does not make it longer, and adds only edges that are free.
class PathShortener {
  public:
    // `path` (waypoints, dof). Added edges are proven free or, without `proofs`, only their samples are free.
    PathShortener(EdgeChecker& edges, std::span<const double> path, bool proofs) : edges_(edges), proofs_(proofs) {
        for (std::size_t i = 0; i < path.size(); i += edges.dof()) {
            Waypoint q(path.begin() + static_cast<std::ptrdiff_t>(i),
                       path.begin() + static_cast<std::ptrdiff_t>(i + edges.dof()));
            if (path_.empty() || q != path_.back()) path_.push_back(std::move(q));
        }
        given_ = path_;
        low_ = high_ = path_.front();
        for (const Waypoint& q : path_)
            for (std::size_t j = 0; j < q.size(); ++j) {
                low_[j] = std::min(low_[j], q[j]);
                high_[j] = std::max(high_[j], q[j]);
            }
    }

    // All operations; without draws only the first, and the last if the path is tightened.
    void run(std::span<const double> draws, bool tighten) {
        connect_farthest();
        if (!draws.empty()) {
            move_waypoints(kPassesBefore, kMinGain);
            random_shortcuts(draws);
            move_waypoints(kPassesAfter, kMinGain);
        }
        if (tighten) move_waypoints(kTightPasses, kTightGain);
    }

    // Whether every edge that is not one of the given path is proven free.
    bool added_edges_proven() const {
        for (std::size_t i = 0; i + 1 < path_.size(); ++i) {
            const auto here = std::ranges::search(given_, std::span(path_).subspan(i, 2));
            if (here.empty() && !edges_.proven_free(path_[i].data(), path_[i + 1].data())) return false;
        }
        return true;
    }

    // Connect each kept waypoint to the farthest later waypoint that a free edge reaches.
    void connect_farthest() {
        for (std::size_t first = 0; first + 2 < path_.size(); ++first)
            for (std::size_t last = path_.size() - 1; last > first + 1; --last)
                if (free(path_[first], path_[last])) {
                    path_.erase(path_.begin() + static_cast<std::ptrdiff_t>(first + 1),
                                path_.begin() + static_cast<std::ptrdiff_t>(last));
                    break;
                }
    }

    // Connect random points of different edges; `draws` are two numbers in [0, 1) for each attempt. Ends after some
    // attempts in a row without gain.
    void random_shortcuts(std::span<const double> draws) {
        int failures = 0;
        for (std::size_t i = 0; i + 1 < draws.size() && path_.size() > 2 && failures < kPatience; i += 2)
            failures = random_shortcut(draws[i], draws[i + 1]) ? 0 : failures + 1;
    }

    // Remove each waypoint for which the edge between its neighbours is free, and move the others towards that edge, in
    // passes along the vectors of different bases. Ends early after passes along all bases without a gain.
    void move_waypoints(int passes, double min_gain) {
        for (int pass = 0, idle = 0; pass < passes && idle < kBases; ++pass) {
            ++idle;
            for (std::size_t i = 1; i + 1 < path_.size(); ++i) {
                if (free(path_[i - 1], path_[i + 1])) {
                    path_.erase(path_.begin() + static_cast<std::ptrdiff_t>(i));
                    i = std::max<std::size_t>(i, 2) - 2;
                    idle = 0;
                } else if (move_waypoint(i, pass % kBases, min_gain)) {
                    idle = 0;
                }
            }
        }
    }

    // (waypoints, dof) without waypoints that equal their predecessor
    std::vector<double> path() const {
        std::vector<double> all;
        for (std::size_t i = 0; i < path_.size(); ++i)
            if (i == 0 || path_[i] != path_[i - 1]) all.insert(all.end(), path_[i].begin(), path_[i].end());
        return all;
    }

  private:
    using Waypoint = std::vector<double>;

    bool free(const Waypoint& a, const Waypoint& b) {
        return proofs_ ? edges_.proven_free(a.data(), b.data()) : edges_.samples_free(a.data(), b.data());
    }

    bool random_shortcut(double first_draw, double last_draw) {
        const std::vector<double> at = lengths_along(path_);
        const double first = std::min(first_draw, last_draw) * at.back(),
                     last = std::max(first_draw, last_draw) * at.back();
        const auto edge_of = [&](double length) {
            const auto next = std::upper_bound(at.begin(), at.end() - 1, length);
            return static_cast<std::size_t>(next - at.begin()) - 1;
        };
        const std::size_t i = edge_of(first), k = edge_of(last);
        if (i == k) return false;
        const Waypoint a = between(path_[i], path_[i + 1], (first - at[i]) / (at[i + 1] - at[i]));
        const Waypoint b = between(path_[k], path_[k + 1], (last - at[k]) / (at[k + 1] - at[k]));
        const double gain = (last - first) - distance(a, b);
        if (gain <= kMinGain * at.back() || !free(a, b)) return false;
        path_.erase(path_.begin() + static_cast<std::ptrdiff_t>(i + 1),
                    path_.begin() + static_cast<std::ptrdiff_t>(k + 1));
        path_.insert(path_.begin() + static_cast<std::ptrdiff_t>(i + 1), {a, b});
        return true;
    }

    // Move a waypoint towards the straight line between its neighbours, or half as far, along one vector of an orthonormal
    // basis at a time, in the order of the length that they save. Where the line is blocked, few of the vectors lead into
    // the obstacle. Basis 0 is that of the joints, and the others are its reflections I - 2 v v^T / n, where the elements
    // of v are 1, or 1 and -1 in turn: a waypoint in contact that no single joint can move may slide along the contact.
    // Joints stay in the range of the given path, and so in their limits. Returns whether the waypoint moved.
    bool move_waypoint(std::size_t i, int basis, double min_gain) {
        const Waypoint &before = path_[i - 1], &after = path_[i + 1];
        Waypoint& here = path_[i];
        const std::size_t dof = here.size();
        double product = 0.0, square = 0.0;
        for (std::size_t j = 0; j < dof; ++j) {
            product += (here[j] - before[j]) * (after[j] - before[j]);
            square += (after[j] - before[j]) * (after[j] - before[j]);
        }
        const Waypoint foot = between(before, after, std::clamp(product / std::max(square, kTiny), 0.0, 1.0));
        const auto v = [&](std::size_t j) { return basis == 0 ? 0.0 : basis == 2 && j % 2 == 1 ? -1.0 : 1.0; };
        const double scale = 2.0 / static_cast<double>(dof);
        // The waypoint moved by a share of the step to the foot along vector k
        const auto moved = [&](std::size_t k, double share) {
            double along = 0.0;
            for (std::size_t j = 0; j < dof; ++j) along -= scale * v(k) * v(j) * (foot[j] - here[j]);
            along = (along + foot[k] - here[k]) * share;
            Waypoint q = here;
            for (std::size_t j = 0; j < dof; ++j)
                q[j] = std::clamp(q[j] + along * ((j == k ? 1.0 : 0.0) - scale * v(k) * v(j)), low_[j], high_[j]);
            return q;
        };
        const auto gain = [&](const Waypoint& q) {
            return distance(before, here) + distance(here, after) - distance(before, q) - distance(q, after);
        };
        std::vector<std::pair<double, std::size_t>> order;
        for (std::size_t k = 0; k < dof; ++k) order.emplace_back(-gain(moved(k, 1.0)), k);
        std::ranges::sort(order);
        const double wanted = min_gain * lengths_along(path_).back();
        bool changed = false;
        for (const auto& [_, k] : order)
            for (const double share : {1.0, 0.5}) {
                Waypoint q = moved(k, share);
                if (gain(q) <= wanted) break;
                if (!free(before, q) || !free(q, after)) continue;
                here = std::move(q);
                changed = true;
                break;
            }
        return changed;
    }

    EdgeChecker& edges_;
    bool proofs_;
    std::vector<Waypoint> path_, given_;
    Waypoint low_, high_;  // the range of the given path
};

}  // namespace

std::vector<double> shortened_path(EdgeChecker& edges, std::span<const double> path, std::span<const double> draws,
                                   bool tighten) {
    const double resolution = edges.resolution();
    for (const double tried : {resolution, resolution / 2}) {
        edges.set_resolution(tried);
        PathShortener quick(edges, path, false);
        quick.run(draws, tighten);
        const bool proven = quick.added_edges_proven();
        edges.set_resolution(resolution);
        if (proven) return quick.path();
    }
    PathShortener proven(edges, path, true);
    proven.run(draws, tighten);
    return proven.path();
}

}  // namespace pinproof
