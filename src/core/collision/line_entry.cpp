#include "collision/line_entry.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace pinproof {
namespace {

// Sine of an angle: a line that meets a plane at less is parallel to it.
constexpr double kParallel = 1e-12;

// A line may pass outside of a triangle by this share of its size, so that rounding lets none pass between two triangles.
constexpr double kEdge = 1e-12;

// A point by its coordinates across the lines, and along them.
struct AcrossLines {
    double x, y, z;
};

}  // namespace

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

}  // namespace pinproof
