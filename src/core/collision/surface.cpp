#include "collision/surface.h"

#include <algorithm>
#include <bit>
#include <numeric>
#include <tuple>

namespace pinproof {
namespace {

// The finalizer of MurmurHash3 (A. Appleby): every bit of the key changes half the bits of the result.
std::uint64_t mixed(std::uint64_t key) {
    key = (key ^ (key >> 33)) * 0xff51afd7ed558ccdULL;
    key = (key ^ (key >> 33)) * 0xc4ceb9fe1a85ec53ULL;
    return key ^ (key >> 33);
}

// Items with equal keys have one number. `equal(i)` compares the item with that of number i.
class Table {
public:
    explicit Table(std::size_t items) : slots_(std::bit_ceil(2 * items + 1), -1) {}

    // The number of an equal item, or `fresh` if there is none.
    template <class Equal>
    std::int64_t find(std::uint64_t hash, std::int64_t fresh, Equal equal) {
        const std::size_t mask = slots_.size() - 1;
        std::size_t slot = hash & mask;
        while (slots_[slot] >= 0 && !equal(slots_[slot])) slot = (slot + 1) & mask;
        if (slots_[slot] < 0) slots_[slot] = static_cast<std::int32_t>(fresh);
        return slots_[slot];
    }

private:
    std::vector<std::int32_t> slots_;
};

// An edge from its vertex with the smaller number to the other one, and the triangles that have it.
struct Edge {
    std::int64_t low, high;
    std::int32_t triangles = 0, direction = 0;  // their number; how many more of them run from low to high
    std::int32_t first = -1, second = -1;
};

}  // namespace

std::vector<std::int64_t> first_equal_points(std::span<const double> points) {
    std::vector<std::int64_t> first(points.size() / 3);
    Table table(first.size());
    for (std::size_t i = 0; i < first.size(); ++i) {
        const double* p = &points[3 * i];
        std::uint64_t hash = 0;
        for (int k = 0; k < 3; ++k) hash = mixed(hash ^ std::bit_cast<std::uint64_t>(p[k] + 0.0));  // -0 is equal to 0
        first[i] = table.find(hash, static_cast<std::int64_t>(i), [&](std::int64_t j) {
            return std::equal(p, p + 3, &points[3 * static_cast<std::size_t>(j)]);
        });
    }
    return first;
}

SurfaceParts surface_parts(std::span<const std::int64_t> triangles) {
    const std::size_t count = triangles.size() / 3;
    std::vector<Edge> edges;
    edges.reserve(triangles.size() / 2 + 1);
    std::vector<std::int32_t> edge_of(triangles.size());
    Table table(triangles.size());
    for (std::size_t h = 0; h < triangles.size(); ++h) {
        const std::int64_t from = triangles[h], to = triangles[h % 3 == 2 ? h - 2 : h + 1];
        const auto [low, high] = std::minmax(from, to);
        const auto found = table.find(mixed(mixed(static_cast<std::uint64_t>(low)) ^ static_cast<std::uint64_t>(high)),
                                      static_cast<std::int64_t>(edges.size()),
                                      [&](std::int64_t e) { return edges[e].low == low && edges[e].high == high; });
        if (found == static_cast<std::int64_t>(edges.size())) edges.push_back({low, high});
        Edge& edge = edges[found];
        (edge.triangles == 0 ? edge.first : edge.second) = static_cast<std::int32_t>(h / 3);
        ++edge.triangles;
        edge.direction += from < to ? 1 : -1;
        edge_of[h] = static_cast<std::int32_t>(found);
    }
    // Of two joined parts, the one whose first triangle comes later becomes a part of the other.
    std::vector<std::int64_t> first(count);
    std::iota(first.begin(), first.end(), 0);
    const auto root = [&](std::int64_t i) {
        while (first[i] != i) i = first[i] = first[first[i]];
        return i;
    };
    const auto joins = [](const Edge& edge) { return edge.triangles == 2 && edge.direction == 0; };
    for (const Edge& edge : edges) {
        if (!joins(edge)) continue;
        const auto [low, high] = std::minmax({root(edge.first), root(edge.second)});
        first[high] = low;
    }
    SurfaceParts parts{std::vector<std::int64_t>(count), count > 0};
    std::int64_t number = 0;
    for (std::size_t i = 0; i < count; ++i) {
        const std::int64_t at = root(static_cast<std::int64_t>(i));
        parts.part_of[i] = at == static_cast<std::int64_t>(i) ? number++ : parts.part_of[at];
    }
    // Of other edges, each part must have exactly two triangles.
    std::vector<std::tuple<std::int32_t, std::int64_t, int>> others;  // edge, part, direction
    for (std::size_t h = 0; h < triangles.size(); ++h)
        if (!joins(edges[edge_of[h]]))
            others.emplace_back(edge_of[h], parts.part_of[h / 3],
                                triangles[h] < triangles[h % 3 == 2 ? h - 2 : h + 1] ? 1 : -1);
    std::ranges::sort(others);
    for (std::size_t i = 0; i < others.size(); i += 2) {
        const auto same = [&](std::size_t j) {
            return j < others.size() && std::get<0>(others[j]) == std::get<0>(others[i]) &&
                   std::get<1>(others[j]) == std::get<1>(others[i]);
        };
        if (!same(i + 1) || same(i + 2) || std::get<2>(others[i]) + std::get<2>(others[i + 1]) != 0) parts.closed = false;
    }
    return parts;
}

}  // namespace pinproof
