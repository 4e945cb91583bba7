#include "planning/ladder.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace pinproof {
namespace {

// Number of nodes of each of two rungs that are compared to choose the joint by which the others are excluded.
constexpr std::size_t kSampled = 24;

// Largest number of cells of the values of a joint, and their smallest size (rad or m).
constexpr double kCells = 4096.0, kSmallest = 1e-9;

constexpr double kUnreached = std::numeric_limits<double>::infinity();

}  // namespace

// The step of a joint; of a periodic one, the shortest.
double Ladder::step(const double* from, const double* to, std::size_t joint) const {
    const double difference = to[joint] - from[joint], period = graph_.period[joint];
    if (!(std::abs(difference) > 0.5 * period) || period == 0.0) return difference;
    return difference - period * std::floor(difference / period + 0.5);
}

// The joint in which the fewest pairs of sampled nodes of a rung and the next one are within reach, and the one in which
// the fewest of these are; twice the same of an arm with one joint.
std::array<std::size_t, 2> Ladder::sharpest(std::size_t rung, std::span<const std::size_t> nodes) const {
    const std::size_t n = graph_.dof, begin = graph_.first[rung + 1], count = graph_.first[rung + 2] - begin;
    std::vector<std::size_t> within(n * n);  // the pairs that are within reach in two joints, in one on the diagonal
    std::vector<bool> near(n);
    const std::size_t stride = std::max<std::size_t>(nodes.size() / kSampled, 1);
    const std::size_t next_stride = std::max<std::size_t>(count / kSampled, 1);
    for (std::size_t u = 0; u < nodes.size(); u += stride)
        for (std::size_t v = 0; v < count; v += next_stride) {
            for (std::size_t j = 0; j < n; ++j)
                near[j] = std::abs(step(&graph_.q[nodes[u] * n], &graph_.q[(begin + v) * n], j)) <=
                          graph_.reach[rung * n + j];
            for (std::size_t i = 0; i < n; ++i)
                for (std::size_t j = 0; near[i] && j < n; ++j) within[i * n + j] += near[j];
        }
    std::size_t one = 0;
    for (std::size_t j = 1; j < n; ++j)
        if (within[j * n + j] < within[one * n + one]) one = j;
    std::size_t other = n > 1 && one == 0 ? 1 : 0;
    for (std::size_t j = other + 1; j < n; ++j)
        if (j != one && within[one * n + j] < within[one * n + other]) other = j;
    return {one, other};
}

// The value of a joint; of a periodic one, from 0 to its period.
double Ladder::wrapped(std::size_t node, std::size_t joint) const {
    const double q = graph_.q[node * graph_.dof + joint], period = graph_.period[joint];
    return period > 0.0 ? q - period * std::floor(q / period) : q;
}

// The two intervals, of which the second may be empty, of the wrapped values that are within reach of one.
std::array<std::array<double, 2>, 2> Ladder::windows(double value, double reach, double period) const {
    if (period > 0.0 && 2.0 * reach >= period) return {{{-kUnreached, kUnreached}, {1.0, -1.0}}};
    // Values next to the two ends of the period are close to each other; rounding must not exclude a node.
    const double slack = 1e-12 * std::max(1.0, std::abs(value));
    const double low = value - reach - slack, high = value + reach + slack;
    if (period > 0.0 && low < 0.0) return {{{low, high}, {low + period, kUnreached}}};
    if (period > 0.0 && high > period) return {{{low, high}, {-kUnreached, high - period}}};
    return {{{low, high}, {1.0, -1.0}}};
}

LadderCourse Ladder::solve(std::size_t from, std::size_t to, std::size_t others, double apart) const {
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
    struct Placed {
        std::size_t cell;  // of the value of the first joint
        double value;      // of the second joint
        std::size_t node;
        auto operator<=>(const Placed&) const = default;
    };
    std::vector<Placed> sorted;
    std::vector<std::size_t> begins;
    std::vector<double> packed, bounds;
    for (std::size_t rung = from; rung < to && !nodes.empty(); ++rung) {
        // The reachable nodes of this rung, in cells of the values of one joint, and sorted by another joint in each cell
        const auto [axis, other] = sharpest(rung, nodes);
        const double* reach = &graph_.reach[rung * n];
        double lowest = kUnreached, highest = -kUnreached;
        for (std::size_t node : nodes) {
            lowest = std::min(lowest, wrapped(node, axis));
            highest = std::max(highest, wrapped(node, axis));
        }
        const double width = std::max({0.5 * reach[axis], (highest - lowest) / kCells, kSmallest});
        const auto cell_of = [&](double value) {  // never decreases with the value
            return static_cast<std::size_t>((std::clamp(value, lowest, highest) - lowest) / width);
        };
        sorted.clear();
        for (std::size_t node : nodes) sorted.push_back({cell_of(wrapped(node, axis)), wrapped(node, other), node});
        std::ranges::sort(sorted);
        begins.assign(cell_of(highest) + 2, sorted.size());
        for (std::size_t u = sorted.size(); u-- > 0;) begins[sorted[u].cell] = u;
        for (std::size_t cell = begins.size() - 1; cell-- > 0;) begins[cell] = std::min(begins[cell], begins[cell + 1]);
        packed.resize(sorted.size() * n);
        for (std::size_t u = 0; u < sorted.size(); ++u)
            std::copy_n(&graph_.q[sorted[u].node * n], n, &packed[u * n]);
        // The cost through each node, with the least of an edge. Sums of numbers that are not negative never decrease,
        // nor do they after rounding, so that nodes with a larger bound than a known cost need no comparison.
        const double least_time = graph_.weights.time * graph_.least[rung];
        bounds.resize(sorted.size());
        for (std::size_t u = 0; u < sorted.size(); ++u) bounds[u] = best[sorted[u].node - base] + least_time;
        // The best predecessor of each node of the next rung. That of the node before is often close to it, and is
        // compared first, so that most others are excluded by their bound.
        std::vector<std::size_t> reached;
        std::size_t likely = 0;
        for (std::size_t v = first[rung + 1]; v < first[rung + 2]; ++v) {
            const double* there = &graph_.q[v * n];
            double least = kUnreached;
            std::size_t source = 0, at = likely;
            const auto consider = [&](std::size_t u) {
                const double* here = &packed[u * n];
                double most = 0.0, travel = 0.0, effort = 0.0;
                for (std::size_t j = 0; j < n; ++j) {
                    const double distance = std::abs(step(here, there, j));
                    if (!(distance <= reach[j])) return;
                    const double seconds = distance / graph_.speed[j];
                    most = std::max(most, seconds);
                    travel += seconds;
                    effort += seconds * seconds;
                }
                const std::size_t node = sorted[u].node;
                const double cost = best[node - base] +
                                    graph_.weights.time * std::max(most, graph_.least[rung]) +
                                    graph_.weights.travel * travel +
                                    graph_.weights.effort * effort / graph_.duration[rung];
                if (cost > least || (cost == least && node > source)) return;
                if (!removed_.empty() && removed_.contains(key(node, v))) return;
                least = cost;
                source = node;
                at = u;
            };
            consider(likely);
            const auto inner = windows(wrapped(v, other), reach[other], graph_.period[other]);
            for (const auto& [low, high] : windows(wrapped(v, axis), reach[axis], graph_.period[axis])) {
                if (low > high || high < lowest || low > highest) continue;
                for (std::size_t cell = cell_of(low), last_cell = cell_of(high); cell <= last_cell; ++cell) {
                    const auto first_in = sorted.begin() + static_cast<std::ptrdiff_t>(begins[cell]);
                    const auto last_in = sorted.begin() + static_cast<std::ptrdiff_t>(begins[cell + 1]);
                    for (const auto& [from_value, to_value] : inner) {
                        if (from_value > to_value) continue;
                        auto u = std::ranges::lower_bound(first_in, last_in, from_value, {}, &Placed::value);
                        for (; u != last_in && u->value <= to_value; ++u) {
                            const auto at_u = static_cast<std::size_t>(u - sorted.begin());
                            if (!(bounds[at_u] > least)) consider(at_u);
                        }
                    }
                }
            }
            if (least == kUnreached) continue;
            best[v - base] = least + graph_.cost[v];
            before[v - base] = source;
            likely = at;
            reached.push_back(v);
        }
        if (reached.empty()) break;
        nodes = std::move(reached);
        last = rung + 1;
    }
    // The cheapest node of the last rung, and the way back
    LadderCourse course;
    if (nodes.empty()) return course;
    const auto back_from = [&](std::size_t node, LadderCourse& found) {
        found.cost = best[node - base];
        found.nodes.resize(last - from + 1);
        for (std::size_t rung = last;; --rung) {
            found.nodes[rung - from] = static_cast<std::int64_t>(node);
            if (rung == from) break;
            node = before[node - base];
        }
    };
    const auto cost_to = [&](std::size_t u) { return best[u - base]; };
    course.reachable.assign(nodes.begin(), nodes.end());
    if (others == 0) {
        back_from(*std::ranges::min_element(nodes, {}, cost_to), course);
        return course;
    }
    // The cheapest of the last nodes, of those that are not close to a cheaper one
    std::ranges::stable_sort(nodes, {}, cost_to);
    std::vector<std::size_t> ends;
    for (std::size_t end : nodes) {
        const bool near = std::ranges::any_of(ends, [&](std::size_t other) {
            std::size_t far = 0;
            for (std::size_t j = 0; j < n; ++j)
                far += std::abs(step(&graph_.q[end * n], &graph_.q[other * n], j)) > apart;
            return far < 2;  // one joint alone turns the tool about its axis
        });
        if (near) continue;
        back_from(end, ends.empty() ? course : course.others.emplace_back());
        ends.push_back(end);
        if (course.others.size() == others) break;
    }
    return course;
}

}  // namespace pinproof
