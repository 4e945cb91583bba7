#include "certificate/separation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <optional>
#include <ranges>
#include <unordered_map>
#include <utility>

#include "collision/mesh.h"
#include "collision/near.h"

namespace pinproof {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();

// Directions that differ by less are equal.
constexpr double kSameDirection = 1e-9;

// Tolerance of the length of a measured direction.
constexpr double kUnit = 1e-6;

// Largest number of different normals of facets that are tried.
constexpr std::size_t kMostNormals = 200;

// Number of failed directions after which no more are tried for one pair.
constexpr std::size_t kMostFailures = 24;

// Largest number of facets whose direction of penetration is measured.
constexpr std::size_t kMostUnclear = 1000;

// Append a direction unless it is in the list.
void append_new(std::vector<Vec3>& directions, const Vec3& d) {
    const auto same = [&](const Vec3& other) {
        const Vec3 e = other - d;
        return std::max({std::abs(e.x), std::abs(e.y), std::abs(e.z)}) < kSameDirection;
    };
    if (std::ranges::none_of(directions, same)) directions.push_back(d);
}

void append_units(std::vector<Vec3>& directions, std::span<const Vec3> more) {
    for (const Vec3& d : more)
        if (const double length = norm(d); std::abs(length - 1.0) < kUnit) append_new(directions, (1.0 / length) * d);
}

// Pass the facets of a mesh to `visit`, except those in the boxes that `skip` excludes.
template <class Skip, class Visit>
void visit_facets(const TriangleMesh& mesh, Skip skip, Visit visit) {
    std::vector<int> nodes{0};
    while (!nodes.empty()) {
        const int here = nodes.back();
        const BoxNode& node = mesh.tree.nodes[here];
        nodes.pop_back();
        if (skip(node)) continue;
        if (node.count == 0) nodes.insert(nodes.end(), {node.second_child, here + 1});
        for (int facet = node.first; facet < node.first + node.count; ++facet) visit(facet);
    }
}

}  // namespace

std::vector<Vec3> ClosePair::directions() const {
    const Mat3& axes = other.root_from_body.rotation;
    if (obstacle.kind == ShapeKind::kHalfSpace) return {axes.column(2)};
    std::vector<Vec3> tried{{0.0, 0.0, 1.0}};
    for (double sign : {1.0, -1.0})
        for (int i = 0; i < 3; ++i) append_new(tried, sign * axes.column(i));
    return tried;
}

double ClosePair::lowest(const Vec3& normal) const { return -extent(*hull, body.root_from_body, -normal); }

double ClosePair::top(int facet, const Vec3& normal) const {
    const Vec3 local = transposed_times(other.root_from_body.rotation, normal);
    return dot(normal, other.root_from_body.translation) + dot(support(obstacle.mesh->triangles[facet], local), local);
}

Vec3 ClosePair::normal_of(int facet) const {
    const auto& [a, b, c] = obstacle.mesh->triangles[facet].corners;
    const Vec3 across = cross(b - a, c - a);
    const double length = norm(across);
    return length == 0.0 ? Vec3{0.0, 0.0, 1.0} : other.root_from_body.rotation * ((1.0 / length) * across);
}

std::vector<int> ClosePair::near_facets(std::span<const Vec3> tried, double reach) const {
    // In the frame of the mesh, where the boxes of its tree are: the directions, and the extent along each that only
    // facets within reach have.
    std::vector<std::pair<Vec3, double>> levels;
    const auto add = [&](const Vec3& d) {
        const double from_mesh = lowest(d) - dot(d, other.root_from_body.translation);
        levels.emplace_back(transposed_times(other.root_from_body.rotation, d), from_mesh - reach);
    };
    for (int i = 0; i < 3; ++i)
        for (double sign : {1.0, -1.0}) add(sign * body.root_from_body.rotation.column(i));
    std::ranges::for_each(tried, add);
    const std::vector<Triangle>& facets = obstacle.mesh->triangles;
    std::vector<int> found;
    const auto apart = [&](const BoxNode& node) {
        return std::ranges::any_of(levels, [&](const auto& level) {
            return level.second > dot(level.first, node.centre) + half_extent(node.half, level.first);
        });
    };
    visit_facets(*obstacle.mesh, apart, [&](int facet) {
        for (const auto& [d, level] : levels)
            if (level > dot(support(facets[facet], d), d)) return;
        const Vec3 normal = normal_of(facet);
        const double level = dot(normal, other.root_from_body * facets[facet].corners[0]);
        if (std::max(lowest(normal) - level, lowest(-normal) + level) <= reach) found.push_back(facet);
    });
    std::ranges::sort(found);
    return found;
}

void ClosePair::append_normals(std::span<const int> facets, std::vector<Vec3>& directions) const {
    // The different normals, by their first facet; if there are too many, the most frequent ones.
    struct Normal {
        std::array<double, 3> key;
        Vec3 direction;
        std::size_t first, count;
    };
    std::vector<Normal> normals, different;
    for (int facet : facets) {
        const Vec3 n = normal_of(facet);
        const auto rounded = [](double x) { return std::nearbyint(x / kSameDirection); };
        normals.push_back({{rounded(n.x), rounded(n.y), rounded(n.z)}, n, normals.size(), 1});
    }
    std::ranges::stable_sort(normals, {}, &Normal::key);
    for (const Normal& normal : normals)
        if (!different.empty() && different.back().key == normal.key)
            ++different.back().count;
        else
            different.push_back(normal);
    std::ranges::stable_sort(different, std::greater(), &Normal::count);
    different.resize(std::min(different.size(), kMostNormals));
    std::ranges::sort(different, {}, &Normal::first);
    for (double sign : {1.0, -1.0})
        for (const Normal& normal : different) append_new(directions, sign * normal.direction);
}

std::vector<Vec3> ClosePair::directions_to_facets(double reach) const {
    std::vector<Vec3> tried = directions(), found;
    const std::vector<int> near = near_facets(tried, reach);
    append_normals(near, tried);
    for (int facet : near)
        found.push_back(
            -*std::ranges::max_element(tried, {}, [&](const Vec3& d) { return lowest(d) - top(facet, d); }));
    return found;
}

std::shared_ptr<const Shape> hull_of(const std::shared_ptr<const Shape>& shape) {
    if (shape->kind != ShapeKind::kMesh) return shape;
    std::vector<std::array<double, 3>> corners;
    for (const Triangle& triangle : shape->mesh->triangles)
        for (const Vec3& p : triangle.corners) corners.push_back({p.x, p.y, p.z});
    std::ranges::sort(corners);
    const auto repeated = std::ranges::unique(corners);
    corners.erase(repeated.begin(), repeated.end());
    const std::vector<double> discs(corners.size(), 0.0);
    return std::make_shared<Shape>(make_shape(ShapeKind::kConvex, {corners[0].data(), 3 * corners.size()}, discs, 0.0,
                                              {}, shape->centre - shape->half, shape->centre + shape->half));
}

namespace {

// The separations of pairs along one curve.
class Separator {
  public:
    Separator(const World& world, const CurveView& curve, const SeparationSettings& settings)
        : world_(world), curve_(curve), settings_(settings), bodies_(world.space()) {
        bodies_.set(curve.piece(0));
    }

    PairSeparation separate(int k, std::span<const Vec3> more) {
        const Pair& pair = world_.pair(k);
        const PlacedBody &body = bodies_[pair.a], &other = bodies_[pair.b];
        const Shape &shape = world_.shape(pair.a), &obstacle = world_.shape(pair.b);
        PairSeparation found;
        const double enough = required(k) + settings_.near;
        std::optional<Transform> body_from_other;
        found.far = separation_of_bounds(body, shape, other, obstacle, enough, body_from_other) > enough;
        if (found.far) return found;
        Separation nearest;
        nearest.direction = world_.first_direction(pair);
        const double distance = bound_distance(shape, obstacle, *body_from_other, {}, nearest).lower;
        found.far = distance > enough;
        if (found.far) return found;
        auto& hull = hulls_[pair.a];
        if (hull == nullptr) hull = hull_of(world_.space().robot[pair.a].shape);
        const ClosePair close{body, other, hull, obstacle};
        std::vector<Vec3> tried = close.directions();
        found.overlaps = !(distance > 0.0);
        if (obstacle.kind != ShapeKind::kHalfSpace) {
            if (!found.overlaps) append_units(tried, std::array{-(body.root_from_body.rotation * nearest.direction)});
            if (obstacle.kind == ShapeKind::kConvex) append_units(tried, more);
        }
        if (obstacle.kind == ShapeKind::kMesh)
            leave_facets(k, close, std::move(tried), more, found);
        else
            leave_convex(k, close, tried, found);
        return found;
    }

  private:
    SeparatingGroup follow(int pair, const ClosePair& close, const Vec3& normal, double level, double gap) {
        Departure departure(world_.geometry, world_.pair(pair).a, close.hull, normal, level);
        SeparatingGroup group{normal, level, gap, 0.0, {}, {}};
        group.proof = departure.follow(curve_, required(pair), settings_.tolerance, settings_.max_intervals);
        group.slack = group.proof.gap - required(pair);
        return group;
    }

    void leave_convex(int pair, const ClosePair& close, std::span<const Vec3> tried, PairSeparation& found) {
        std::vector<double> levels, gaps;
        for (const Vec3& d : tried) {
            levels.push_back(extent(close.obstacle, close.other.root_from_body, d));
            gaps.push_back(close.lowest(d) - levels.back());
        }
        const double rounding = world_.space().rounding;
        found.gap = std::ranges::max(gaps);
        if (found.gap - settings_.displaced < -settings_.deepest) return;
        // The first of those with the largest gap up to rounding, then the others.
        std::vector<std::size_t> order(tried.size());
        std::iota(order.begin(), order.end(), std::size_t{0});
        const auto first = std::ranges::find_if(gaps, [&](double gap) { return gap >= found.gap - rounding; });
        std::rotate(order.begin(), order.begin() + (first - gaps.begin()), order.begin() + (first - gaps.begin()) + 1);
        std::ranges::stable_sort(order.begin() + 1, order.end(), [&](auto i, auto j) { return gaps[i] > gaps[j]; });
        for (std::size_t k : order) {
            if (gaps[k] < std::min(found.gap, 0.0) - rounding) continue;
            SeparatingGroup group = follow(pair, close, tried[k], levels[k], gaps[k]);
            const bool separates = group.proof.until < kNever;
            // Without a direction that separates them, that with the longest span in which the body does not approach.
            if (separates || found.groups.empty() || group.proof.end > found.groups[0].proof.end)
                found.groups.assign(1, std::move(group));
            if (separates) return;
        }
    }

    void leave_facets(int pair, const ClosePair& close, std::vector<Vec3> tried, std::span<const Vec3> more,
                      PairSeparation& found) {
        const double rounding = world_.space().rounding, least = settings_.displaced - settings_.deepest;
        const std::vector<int> near = close.near_facets(tried, required(pair) + settings_.near);
        found.gap = kNever;
        if (near.empty()) return;
        close.append_normals(near, tried);
        append_units(tried, more);
        // The extents of the facets along each direction, their gaps, and the largest gap of each facet.
        const std::size_t count = near.size();
        std::vector<double> tops, gaps, best(count, -kNever);
        for (const Vec3& d : tried) {
            const double low = close.lowest(d);
            for (std::size_t f = 0; f < count; ++f) {
                tops.push_back(close.top(near[f], d));
                gaps.push_back(low - tops.back());
                best[f] = std::max(best[f], gaps.back());
            }
        }
        found.gap = std::ranges::min(best);
        if (world_.shape(world_.pair(pair).a).kind == ShapeKind::kConvex) {
            std::vector<std::size_t> unclear;
            for (std::size_t f = 0; f < count; ++f)
                if (best[f] < -rounding) unclear.push_back(f);
            std::ranges::stable_sort(unclear, {}, [&](std::size_t f) { return best[f]; });
            for (std::size_t f : std::span(unclear).first(std::min(unclear.size(), kMostUnclear)))
                found.unclear.push_back(near[f]);
        }
        // The overlap never exceeds that at the start, which is that of the deepest facet that is not too deep.
        std::vector<char> due(count);
        double depth = 0.0;
        for (std::size_t f = 0; f < count; ++f) {
            due[f] = best[f] >= least;
            if (due[f]) depth = std::max(depth, -best[f]);
        }
        const auto serves = [&](std::size_t d, std::size_t f) {
            return due[f] && gaps[d * count + f] >= -depth - rounding;
        };
        const auto group_of = [&](std::size_t d) {
            double level = -kNever, gap = kNever;
            for (std::size_t f = 0; f < count; ++f) {
                if (!serves(d, f)) continue;
                level = std::max(level, tops[d * count + f]);
                gap = std::min(gap, gaps[d * count + f]);
            }
            return follow(pair, close, tried[d], level, gap);
        };
        const auto take = [&](std::size_t d, SeparatingGroup group) {
            for (std::size_t f = 0; f < count; ++f) {
                if (!serves(d, f)) continue;
                group.facets.push_back(near[f]);
                due[f] = 0;
            }
            if (!group.facets.empty()) found.groups.push_back(std::move(group));
        };
        // The direction that serves the most facets comes first. One along which the body does not separate is kept for the
        // facets that no other direction serves.
        std::vector<std::pair<std::size_t, double>> failed;  // and the end of its proof
        while (failed.size() < kMostFailures) {
            std::size_t chosen = 0, most = 0;
            for (std::size_t d = 0; d < tried.size(); ++d) {
                if (std::ranges::find(failed, d, &std::pair<std::size_t, double>::first) != failed.end()) continue;
                std::size_t served = 0;
                for (std::size_t f = 0; f < count; ++f) served += serves(d, f) ? 1 : 0;
                if (served > most) {
                    most = served;
                    chosen = d;
                }
            }
            if (most == 0) break;
            SeparatingGroup group = group_of(chosen);
            if (group.proof.until == kNever)
                failed.emplace_back(chosen, group.proof.end);
            else
                take(chosen, std::move(group));
        }
        std::ranges::stable_sort(failed, std::greater(), &std::pair<std::size_t, double>::second);
        for (const auto& [d, end] : failed)
            if (std::ranges::any_of(std::views::iota(std::size_t{0}, count),
                                    [&](std::size_t f) { return serves(d, f); }))
                take(d, group_of(d));
        // Extend each group by the facets with no larger extent along its direction.
        std::vector<char> grouped(close.obstacle.mesh->triangles.size());
        for (const SeparatingGroup& group : found.groups)
            for (int facet : group.facets) grouped[facet] = 1;
        found.complete = std::ranges::all_of(near, [&](int facet) { return grouped[facet]; });
        for (SeparatingGroup& group : found.groups) {
            const Transform& at = close.other.root_from_body;
            const Vec3 axis = transposed_times(at.rotation, group.normal);
            const double level = group.level - dot(group.normal, at.translation);
            const auto above = [&](const BoxNode& node) {
                return dot(axis, node.centre) - half_extent(node.half, axis) > level;
            };
            visit_facets(*close.obstacle.mesh, above, [&](int facet) {
                if (close.top(facet, group.normal) <= group.level && !std::exchange(grouped[facet], 1))
                    group.facets.push_back(facet);
            });
            std::ranges::sort(group.facets);
        }
        for (std::size_t facet = 0; facet < grouped.size(); ++facet)
            if (!grouped[facet] && !found.groups.empty()) found.rest.push_back(static_cast<int>(facet));
    }

    double required(int pair) const {
        return world_.margin(pair) + settings_.displaced + 2.0 * world_.space().rounding;
    }

    const World& world_;
    CurveView curve_;
    SeparationSettings settings_;
    Placement bodies_;  // at the start
    std::unordered_map<int, std::shared_ptr<const Shape>> hulls_;
};

}  // namespace

std::vector<PairSeparation> separate(const World& world, const CurveView& curve, const SeparationSettings& settings,
                                     std::span<const int> pairs, std::span<const Vec3> more) {
    Separator separator(world, curve, settings);
    std::vector<PairSeparation> found;
    for (int pair : pairs) found.push_back(separator.separate(pair, more));
    return found;
}

}  // namespace pinproof
