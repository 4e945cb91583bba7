#include "planning/shortcut.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace pinproof {
namespace {

// Fraction of the path length (Euclidean). A change that saves less does not justify its checks.
constexpr double kMinGain = 2e-3;

// Smallest square that is divided by.
constexpr double kTiny = std::numeric_limits<double>::min();

// Number of consecutive random shortcuts without gain after which no more are tried.
constexpr int kPatience = 8;

// Number of passes over the waypoints before and after the random shortcuts.
constexpr int kPasses = 2;

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
    }

    // All operations, or without draws only the first.
    void run(std::span<const double> draws) {
        connect_farthest();
        if (draws.empty()) return;
        move_waypoints();
        random_shortcuts(draws);
        move_waypoints();
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

    // Remove each waypoint for which the edge between its neighbours is free, and move the joints of the others towards
    // that edge. A waypoint is tried again if it or a neighbour has moved.
    void move_waypoints() {
        std::vector<char> moved(path_.size(), 1);
        for (int pass = 0; pass < kPasses; ++pass) {
            std::vector<char> before = std::exchange(moved, std::vector<char>(path_.size(), 0));
            for (std::size_t i = 1; i + 1 < path_.size(); ++i) {
                if (!(before[i - 1] || before[i] || before[i + 1] || moved[i - 1])) continue;
                if (free(path_[i - 1], path_[i + 1])) {
                    for (auto* flags : {&before, &moved}) flags->erase(flags->begin() + static_cast<std::ptrdiff_t>(i));
                    path_.erase(path_.begin() + static_cast<std::ptrdiff_t>(i));
                    before[i - 1] = 1;  // It has a new neighbour.
                    i = std::max<std::size_t>(i, 2) - 2;
                } else {
                    moved[i] = move_joints(i);
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

    // Move single joints of a waypoint to the straight line between its neighbours, or half as far, in the order of
    // the length that they save. Where the line is blocked, few of the joints are the reason. Returns whether one moved.
    bool move_joints(std::size_t i) {
        const Waypoint &before = path_[i - 1], &after = path_[i + 1];
        Waypoint& here = path_[i];
        double product = 0.0, square = 0.0;
        for (std::size_t j = 0; j < here.size(); ++j) {
            product += (here[j] - before[j]) * (after[j] - before[j]);
            square += (after[j] - before[j]) * (after[j] - before[j]);
        }
        const Waypoint foot = between(before, after, std::clamp(product / std::max(square, kTiny), 0.0, 1.0));
        const auto moved_joint = [&](std::size_t j, double share) {
            Waypoint q = here;
            q[j] += (foot[j] - q[j]) * share;
            return q;
        };
        const auto gain = [&](const Waypoint& q) {
            return distance(before, here) + distance(here, after) - distance(before, q) - distance(q, after);
        };
        std::vector<std::pair<double, std::size_t>> order;
        for (std::size_t j = 0; j < here.size(); ++j) order.emplace_back(-gain(moved_joint(j, 1.0)), j);
        std::ranges::sort(order);
        const double min_gain = kMinGain * lengths_along(path_).back();
        bool moved = false;
        for (const auto& [_, j] : order)
            for (const double share : {1.0, 0.5}) {
                Waypoint q = moved_joint(j, share);
                if (gain(q) <= min_gain) break;
                if (!free(before, q) || !free(q, after)) continue;
                here = std::move(q);
                moved = true;
                break;
            }
        return moved;
    }

    EdgeChecker& edges_;
    bool proofs_;
    std::vector<Waypoint> path_, given_;
};

}  // namespace

std::vector<double> shortened_path(EdgeChecker& edges, std::span<const double> path, std::span<const double> draws) {
    const double resolution = edges.resolution();
    for (const double tried : {resolution, resolution / 2}) {
        edges.set_resolution(tried);
        PathShortener quick(edges, path, false);
        quick.run(draws);
        const bool proven = quick.added_edges_proven();
        edges.set_resolution(resolution);
        if (proven) return quick.path();
    }
    PathShortener proven(edges, path, true);
    proven.run(draws);
    return proven.path();
}

}  // namespace pinproof
