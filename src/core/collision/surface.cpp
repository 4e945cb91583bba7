#include "collision/surface.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
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

// Sine of an angle: a line that meets a plane at less is parallel to it.
constexpr double kParallel = 1e-12;

// A line may pass outside of a triangle by this share of its size, so that rounding lets none pass between two triangles.
constexpr double kEdge = 1e-12;

// A point by its coordinates across the lines, and along them.
struct AcrossLines {
    double x, y, z;
};

// A plane is not reached along a direction whose slope towards it is at most this.
constexpr double kLeastSlope = 1e-9;

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

void enter_triangles(std::span<const double> triangles, std::span<const double> origins, const Vec3& direction,
                     std::span<const double> start, std::span<double> depth, std::span<Vec3> normals) {
    const Vec3 size{std::abs(direction.x), std::abs(direction.y), std::abs(direction.z)};
    const bool least_x = size.x <= size.y && size.x <= size.z, least_y = !least_x && size.y <= size.z;
    const Vec3 other = cross(direction, {least_x ? 1.0 : 0.0, least_y ? 1.0 : 0.0, least_x || least_y ? 0.0 : 1.0});
    const Vec3 first = (1.0 / norm(other)) * other, second = cross(direction, first);
    const auto project = [&](const double* p) {
        const Vec3 point{p[0], p[1], p[2]};
        return AcrossLines{dot(point, first), dot(point, second), dot(point, direction)};
    };
    // The lines in the order of one coordinate, so that each triangle is compared with few of them.
    struct Line {
        AcrossLines at;
        std::size_t index;
    };
    std::vector<Line> lines;
    for (std::size_t i = 0; i < depth.size(); ++i) lines.push_back({project(&origins[3 * i]), i});
    const auto x_of = [](const Line& line) { return line.at.x; };
    std::ranges::sort(lines, {}, x_of);
    std::ranges::fill(depth, std::numeric_limits<double>::infinity());
    std::ranges::fill(normals, Vec3{});
    for (std::size_t t = 0; t < triangles.size(); t += 9) {
        const double* p = &triangles[t];
        const AcrossLines a = project(p), b = project(p + 3), c = project(p + 6);
        const Vec3 e{p[3] - p[0], p[4] - p[1], p[5] - p[2]}, f{p[6] - p[0], p[7] - p[1], p[8] - p[2]};
        const Vec3 across = cross(e, f), normal = (1.0 / norm(across)) * across;
        const double facing = dot(normal, direction);
        if (!(std::abs(facing) > kParallel)) continue;
        // Barycentric coordinates in the plane across the lines.
        const double ex = b.x - a.x, ey = b.y - a.y, fx = c.x - a.x, fy = c.y - a.y, area = ex * fy - ey * fx;
        const double more = kEdge * (std::abs(ex) + std::abs(ey) + std::abs(fx) + std::abs(fy));
        const double last = std::max({a.x, b.x, c.x}) + more;
        const double low = std::min({a.y, b.y, c.y}) - more, high = std::max({a.y, b.y, c.y}) + more;
        auto line = std::ranges::lower_bound(lines, std::min({a.x, b.x, c.x}) - more, {}, x_of);
        for (; line != lines.end() && line->at.x <= last; ++line) {
            if (line->at.y < low || line->at.y > high) continue;
            const double x = line->at.x - a.x, y = line->at.y - a.y;
            const double u = (x * fy - y * fx) / area, v = (ex * y - ey * x) / area;
            const double z = a.z + u * (b.z - a.z) + v * (c.z - a.z) - line->at.z;
            const std::size_t i = line->index;
            if (!(u >= -kEdge && v >= -kEdge && u + v <= 1.0 + kEdge && z >= start[i] && z < depth[i])) continue;
            depth[i] = z;
            normals[i] = facing > 0.0 ? -normal : normal;
        }
    }
}

double hull_space(std::span<const FacePlane> planes, const Vec3& point, const Vec3& direction, double enough) {
    double least = std::numeric_limits<double>::infinity();
    for (const FacePlane& plane : planes) {
        const double slope = dot(plane.normal, direction);
        const double height = std::max(-(dot(plane.normal, point) + plane.offset), 0.0);
        // height / slope < least, without a division
        if (slope <= kLeastSlope || height >= least * slope) continue;
        least = height / slope;
        if (least <= enough) break;
    }
    return least;
}

}  // namespace pinproof
