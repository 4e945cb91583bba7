#include "planning/ladder.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace pinproof {
namespace {

// Number of nodes of each of two rungs that are compared to choose the joint by which the others are excluded.
constexpr std::size_t kSampled = 24;

constexpr double kUnreached = std::numeric_limits<double>::infinity();

}  // namespace

// The step of a joint; of a periodic one, the shortest.
double Ladder::step(const double* from, const double* to, std::size_t joint) const {
    const double difference = to[joint] - from[joint], period = graph_.period[joint];
    return period > 0.0 ? difference - period * std::floor(difference / period + 0.5) : difference;
}

// The joint in which the fewest pairs of sampled nodes of a rung and the next one are within reach.
std::size_t Ladder::sharpest(std::size_t rung, std::span<const std::size_t> nodes) const {
    const std::size_t n = graph_.dof, begin = graph_.first[rung + 1], count = graph_.first[rung + 2] - begin;
    std::vector<std::size_t> within(n);
    const std::size_t stride = std::max<std::size_t>(nodes.size() / kSampled, 1);
    const std::size_t next_stride = std::max<std::size_t>(count / kSampled, 1);
    for (std::size_t u = 0; u < nodes.size(); u += stride)
        for (std::size_t v = 0; v < count; v += next_stride)
            for (std::size_t j = 0; j < n; ++j)
                within[j] += std::abs(step(&graph_.q[nodes[u] * n], &graph_.q[(begin + v) * n], j)) <=
                             graph_.reach[rung * n + j];
    return static_cast<std::size_t>(std::ranges::min_element(within) - within.begin());
}

LadderCourse Ladder::solve(std::size_t from, std::size_t to) const {
    const std::size_t n = graph_.dof, base = graph_.first[from];
    const auto& first = graph_.first;
    std::vector<double> best(first[to + 1] - base, kUnreached);
    std::vector<std::size_t> before(best.size());
    std::vector<std::size_t> nodes(first[from + 1] - base);
    for (std::size_t u = 0; u < nodes.size(); ++u) {
        nodes[u] = base + u;
        best[u] = graph_.cost[base + u];
    }
    std::size_t last = from;
    std::vector<std::pair<double, std::size_t>> sorted;
    std::vector<double> packed;
    for (std::size_t rung = from; rung < to && !nodes.empty(); ++rung) {
        // The reachable nodes of this rung, sorted by the value of one joint
        const std::size_t axis = sharpest(rung, nodes);
        const double period = graph_.period[axis];
        const double* reach = &graph_.reach[rung * n];
        const auto value = [&](std::size_t node) {
            const double q = graph_.q[node * n + axis];
            return period > 0.0 ? q - period * std::floor(q / period) : q;
        };
        sorted.clear();
        for (std::size_t node : nodes) sorted.emplace_back(value(node), node);
        std::ranges::sort(sorted);
        packed.resize(sorted.size() * n);
        for (std::size_t u = 0; u < sorted.size(); ++u)
            std::copy_n(&graph_.q[sorted[u].second * n], n, &packed[u * n]);
        // The best predecessor of each node of the next rung
        std::vector<std::size_t> reached;
        for (std::size_t v = first[rung + 1]; v < first[rung + 2]; ++v) {
            const double* there = &graph_.q[v * n];
            double least = kUnreached;
            std::size_t source = 0;
            const auto compare = [&](double low, double high) {
                auto u = static_cast<std::size_t>(
                    std::ranges::lower_bound(sorted, std::pair{low, std::size_t{0}}) - sorted.begin());
                for (; u < sorted.size() && sorted[u].first <= high; ++u) {
                    const double* here = &packed[u * n];
                    double most = 0.0, travel = 0.0, effort = 0.0;
                    bool within = true;
                    for (std::size_t j = 0; j < n; ++j) {
                        const double distance = std::abs(step(here, there, j));
                        if (!(distance <= reach[j])) {
                            within = false;
                            break;
                        }
                        const double seconds = distance / graph_.speed[j];
                        most = std::max(most, seconds);
                        travel += seconds;
                        effort += seconds * seconds;
                    }
                    if (!within) continue;
                    const std::size_t node = sorted[u].second;
                    const double cost = best[node - base] +
                                        graph_.weights.time * std::max(most, graph_.least[rung]) +
                                        graph_.weights.travel * travel +
                                        graph_.weights.effort * effort / graph_.duration[rung];
                    if (cost > least || (cost == least && node > source)) continue;
                    if (!removed_.empty() && removed_.contains(key(node, v))) continue;
                    least = cost;
                    source = node;
                }
            };
            const double key = value(v), width = reach[axis];
            if (period > 0.0 && 2.0 * width >= period) {
                compare(-kUnreached, kUnreached);
            } else {
                // Values next to the two ends of the period are close to each other; rounding must not exclude a node.
                const double slack = 1e-12 * std::max(1.0, std::abs(key));
                const double low = key - width - slack, high = key + width + slack;
                compare(low, high);
                if (period > 0.0 && low < 0.0) compare(low + period, kUnreached);
                if (period > 0.0 && high > period) compare(-kUnreached, high - period);
            }
            if (least == kUnreached) continue;
            best[v - base] = least + graph_.cost[v];
            before[v - base] = source;
            reached.push_back(v);
        }
        if (reached.empty()) break;
        nodes = std::move(reached);
        last = rung + 1;
    }
    // The cheapest node of the last rung, and the way back
    LadderCourse course;
    if (nodes.empty()) return course;
    std::size_t node = *std::ranges::min_element(nodes, {}, [&](std::size_t u) { return best[u - base]; });
    course.cost = best[node - base];
    course.nodes.resize(last - from + 1);
    for (std::size_t rung = last;; --rung) {
        course.nodes[rung - from] = static_cast<std::int64_t>(node);
        if (rung == from) break;
        node = before[node - base];
    }
    course.reachable.assign(nodes.begin(), nodes.end());
    return course;
}

}  // namespace pinproof
