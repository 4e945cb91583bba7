#include "reach/loop_distances.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace pinproof {
namespace {

// Fraction of the chain's length: axes closer than this share a point, whose error the bounds contain.
constexpr double kMeets = 1e-4;

// Fraction of the chain's length: points of one axis that are closer together than this count as one.
constexpr double kDistinct = 0.02;

// Fraction of the chain's length: the distance of an additional point on an axis.
constexpr double kAlong = 0.3;

// Sine of an angle: axes with a smaller one are parallel.
constexpr double kParallel = 1e-3;

double length_of(const Chain& chain) {
    double length = norm(chain.tool.translation);
    for (const Joint& joint : chain.joints) length += norm(joint.before.translation);
    return std::max(length, 1e-3);
}

// The heights on the axis (z) of joint k that are closest to the axis of another joint, whose origin and direction are
// given in the frame of the axis; nothing for parallel axes.
bool nearest_height(const Vec3& origin, const Vec3& direction, double& height) {
    const double across = direction.x * direction.x + direction.y * direction.y;
    if (across < kParallel * kParallel) return false;
    // Minimise over both axes: (origin + t direction) is closest to z at t = -(o.xy . d.xy) / |d.xy|^2.
    const double t = -(origin.x * direction.x + origin.y * direction.y) / across;
    height = origin.z + t * direction.z;
    return true;
}

// The point at a height on the axis of joint k (from 1), extended to all neighbouring links on which it is fixed.
LoopPoint point_on_axis(const Chain& chain, int k, double height, double size) {
    const int n = static_cast<int>(chain.joints.size());
    const Vec3 own{0.0, 0.0, height};
    LoopPoint point{k - 1, k, {chain.joints[k - 1].before * own, own}, 0.0};
    const auto off_axis = [](const Vec3& p) { return std::hypot(p.x, p.y); };
    while (point.last < n) {
        const Joint& next = chain.joints[point.last];
        const Vec3 moved = inverse(next.before) * point.at.back();
        if (next.prismatic || off_axis(moved) > kMeets * size) break;
        point.error += off_axis(moved);
        point.at.push_back({0.0, 0.0, moved.z});
        ++point.last;
    }
    while (point.first > 0) {
        const Joint& previous = chain.joints[point.first - 1];
        const Vec3 here = point.at.front();
        if (previous.prismatic || off_axis(here) > kMeets * size) break;
        point.error += off_axis(here);
        point.at.insert(point.at.begin(), previous.before * Vec3{0.0, 0.0, here.z});
        --point.first;
    }
    return point;
}

bool same_point(const LoopPoint& a, const LoopPoint& b, double size) {
    const int link = std::max(a.first, b.first);
    return link <= std::min(a.last, b.last) && norm(a.on(link) - b.on(link)) < kDistinct * size;
}

// At least two points on the axis of joint k: those closest to the neighbouring axes, and one at a distance.
void add_points_of_axis(const Chain& chain, int k, double size, std::vector<LoopPoint>& points) {
    const int n = static_cast<int>(chain.joints.size());
    std::vector<double> heights;
    double height;
    if (k < n) {
        const Transform next = chain.joints[k].before;
        if (nearest_height(next.translation, next.rotation.column(2), height)) heights.push_back(height);
    }
    if (k > 1) {
        const Transform previous = inverse(chain.joints[k - 1].before);
        if (nearest_height(previous.translation, previous.rotation.column(2), height)) heights.push_back(height);
    }
    if (heights.empty()) heights.push_back(0.0);
    if (*std::max_element(heights.begin(), heights.end()) - *std::min_element(heights.begin(), heights.end()) <
        kAlong / 3 * size)
        heights.push_back(heights.front() + kAlong * size);
    for (double each : heights) {
        LoopPoint point = point_on_axis(chain, k, each, size);
        // Of several names of one point, the one that is fixed on the most links is kept.
        auto known = std::find_if(points.begin(), points.end(),
                                  [&](const LoopPoint& other) { return same_point(point, other, size); });
        if (known == points.end())
            points.push_back(std::move(point));
        else if (point.last - point.first > known->last - known->first)
            *known = std::move(point);
    }
}

// From point p up to point q; the joints between the links on which they are fixed.
Arc inner_arc(const LoopPoint& p, const LoopPoint& q) {
    const int shared = std::max(p.first, q.first);
    if (q.first <= p.last) return {p.on(shared), q.on(shared), {}, -1};
    Arc arc{p.on(p.last), q.on(q.first), std::vector<int>(q.first - p.last), -1};
    std::iota(arc.joints.begin(), arc.joints.end(), p.last);  // joints are counted from 0 in arcs
    return arc;
}

// From point q up through the target and on to point p.
Arc outer_arc(const LoopPoint& p, const LoopPoint& q, int n) {
    Arc arc{q.on(q.last), p.on(p.first), {}, n - q.last};
    for (int joint = q.last; joint < n; ++joint) arc.joints.push_back(joint);
    for (int joint = 0; joint < p.first; ++joint) arc.joints.push_back(joint);
    return arc;
}

}  // namespace

LoopDistances loop_distances(const Chain& chain) {
    LoopDistances loop{{}, {}, length_of(chain)};
    const int n = static_cast<int>(chain.joints.size());
    for (int k = 1; k <= n; ++k)
        if (!chain.joints[k - 1].prismatic) add_points_of_axis(chain, k, loop.size, loop.points);
    // Three points of the tcp and one of the base, so that prismatic joints and single axes are determined too.
    for (const Vec3& offset : {Vec3{}, Vec3{kAlong, 0.0, 0.0}, Vec3{0.0, kAlong, 0.0}})
        loop.points.push_back({n, n, {chain.tool * (loop.size * offset)}, 0.0});
    loop.points.push_back({0, 0, {Vec3{}}, 0.0});

    const int count = static_cast<int>(loop.points.size());
    for (int i = 0; i < count; ++i)
        for (int j = 0; j < count; ++j) {
            const LoopPoint &p = loop.points[i], &q = loop.points[j];
            if (p.first > q.first || p.last > q.last || (i > j && p.first == q.first && p.last == q.last)) continue;
            loop.constraints.push_back({inner_arc(p, q), outer_arc(p, q, n), p.error + q.error, {i, j}});
        }
    std::stable_sort(loop.constraints.begin(), loop.constraints.end(),
                     [](const LoopConstraint& a, const LoopConstraint& b) { return a.joint_count() < b.joint_count(); });
    return loop;
}

}  // namespace pinproof
