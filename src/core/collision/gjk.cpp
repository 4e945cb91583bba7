#include "collision/gjk.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "collision/cells.h"
#include "collision/mesh.h"

namespace pinproof {
namespace {

// Maximum number of iterations, after which the current bounds are returned; polytopes need 4 to 8, discs edge on edge
// up to 30.
constexpr int kIterations = 64;

// Fraction of |v|^2 by which an iteration must improve; smaller improvements are rounding errors.
constexpr double kStill = 1e-15;

// The height of a tetrahedron below this fraction of the size of its sides is a rounding error.
constexpr double kFlat = 1e-12;

// Largest deviation of the sum of the weights from 1; for a simplex so flat that it is exceeded, the iteration ends.
constexpr double kWhole = 1e-9;

// Metres. A point of B - A this close to the origin is evidence of overlap: placements are not known more accurately.
constexpr double kOverlap = 1e-12;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Barycentric {
    double a, b, c;
};

// Weights of the point of the segment closest to the origin.
std::pair<double, double> closest_on_segment(const Vec3& a, const Vec3& b) {
    const Vec3 edge = b - a;
    const double t = std::min(std::max(-dot(a, edge) / dot(edge, edge), 0.0), 1.0);
    return {1.0 - t, t};
}

// Weights of the point of the triangle closest to the origin (Ericson, 5.1.5).
Barycentric closest_on_triangle(const Vec3& a, const Vec3& b, const Vec3& c) {
    const Vec3 ab = b - a, ac = c - a;
    const double d1 = -dot(ab, a), d2 = -dot(ac, a);
    if (d1 <= 0.0 && d2 <= 0.0) return {1.0, 0.0, 0.0};
    const double d3 = -dot(ab, b), d4 = -dot(ac, b);
    if (d3 >= 0.0 && d4 <= d3) return {0.0, 1.0, 0.0};
    const double vc = d1 * d4 - d3 * d2;
    if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) {
        const double v = d1 / (d1 - d3);
        return {1.0 - v, v, 0.0};
    }
    const double d5 = -dot(ab, c), d6 = -dot(ac, c);
    if (d6 >= 0.0 && d5 <= d6) return {0.0, 0.0, 1.0};
    const double vb = d5 * d2 - d1 * d6;
    if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) {
        const double w = d2 / (d2 - d6);
        return {1.0 - w, 0.0, w};
    }
    const double va = d3 * d6 - d5 * d4;
    if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
        const double w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return {0.0, 1.0 - w, w};
    }
    const double total = va + vb + vc;
    return {va / total, vb / total, vc / total};
}

bool same(const Vec3& a, const Vec3& b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

// Weights of the point of a tetrahedron closest to the origin: on the closest face that it is beyond, or inside. For a
// flat tetrahedron every face is tried, so that a volume that is due to rounding decides nothing.
void weigh_tetrahedron(Simplex& simplex) {
    Simplex::Vertex* v = simplex.vertices;
    double best = kInfinity, share[4], found[4] = {};
    bool inside = true;
    for (int m = 0; m < 4; ++m) {  // The face opposite to vertex m.
        const int i = (m + 1) % 4, j = (m + 2) % 4, k = (m + 3) % 4;
        const Vec3 &a = v[i].difference, &b = v[j].difference, &c = v[k].difference;
        const Vec3 ab = b - a, ac = c - a, normal = cross(ab, ac);
        const double origin = -dot(normal, a), height = dot(normal, v[m].difference - a);
        share[m] = origin / height;
        const double thin = kFlat * (size_1(ab) + size_1(ac)) * size_1(normal);
        if (origin * height > 0.0 && std::abs(height) > thin) continue;
        inside = false;
        const Barycentric w = closest_on_triangle(a, b, c);
        const double distance = squared_norm(w.a * a + w.b * b + w.c * c);
        if (distance < best) {
            best = distance;
            found[m] = 0.0;
            found[i] = w.a;
            found[j] = w.b;
            found[k] = w.c;
        }
    }
    if (inside) {
        const double total = share[0] + share[1] + share[2] + share[3];
        for (int m = 0; m < 4; ++m) found[m] = share[m] / total;
    }
    for (int m = 0; m < 4; ++m) v[m].weight = found[m];
}

// Compute the weights of the point of the simplex closest to the origin; keep the vertices with nonzero weights.
void weigh(Simplex& simplex) {
    Simplex::Vertex* v = simplex.vertices;
    switch (simplex.size) {
        case 1:
            v[0].weight = 1.0;
            return;
        case 2:
            std::tie(v[0].weight, v[1].weight) = closest_on_segment(v[0].difference, v[1].difference);
            break;
        case 3: {
            const Barycentric w = closest_on_triangle(v[0].difference, v[1].difference, v[2].difference);
            v[0].weight = w.a;
            v[1].weight = w.b;
            v[2].weight = w.c;
            break;
        }
        default:
            weigh_tetrahedron(simplex);
    }
    int kept = 0;
    for (int i = 0; i < simplex.size; ++i)
        if (v[i].weight > 0.0) {
            if (kept < i) v[kept] = v[i];
            ++kept;
        }
    simplex.size = kept;
}

// The point of the simplex closest to the origin. False if the simplex is so flat that its weights are meaningless:
// then a single vertex remains, which is a convex combination too.
bool move_to_nearest(Simplex& simplex, Vec3& nearest) {
    weigh(simplex);
    double total = 0.0;
    for (int i = 0; i < simplex.size; ++i) total += simplex.vertices[i].weight;
    const bool whole = std::abs(total - 1.0) <= kWhole;
    if (!whole) {
        simplex.size = 1;
        simplex.vertices[0].weight = 1.0;
    }
    nearest = simplex.vertices[0].weight * simplex.vertices[0].difference;
    for (int i = 1; i < simplex.size; ++i) nearest += simplex.vertices[i].weight * simplex.vertices[i].difference;
    return whole;
}

// bound_distance for body a and the half-space below the plane through b's x and y, from one support point.
template <class A>
DistanceBounds above_plane(const A& a, const Transform& a_from_b, Separation& separation) {
    const Vec3 u = -a_from_b.rotation.column(2);
    const Vec3 point = support(a, u);
    double gap = dot(u, a_from_b.translation - point);
    const Vec3 foot = point + gap * u;
    separation.direction = u;
    separation.simplex.size = 1;
    separation.simplex.vertices[0] = {gap * u, point, transposed_times(a_from_b.rotation, foot - a_from_b.translation),
                                      1.0};
    gap -= a.radius;
    if (std::isnan(gap)) return {-kInfinity, kInfinity};
    return {gap, gap > kOverlap ? gap : 0.0};
}

// Place up to three of the first `count` vertices for the present placement of b, without those that equal `except`.
void place_again(Simplex& simplex, int count, const Transform& a_from_b, const Vec3& except) {
    simplex.size = 0;
    for (int i = 0; i < std::min(count, 3); ++i) {
        Simplex::Vertex vertex = simplex.vertices[i];
        vertex.difference = a_from_b * vertex.of_b - vertex.of_a;
        if (!same(vertex.difference, except)) simplex.vertices[simplex.size++] = vertex;
    }
}

// bound_distance for two bodies with support functions.
template <class A, class B>
DistanceBounds iterate(const A& a, const B& b, const Transform& a_from_b, const DistanceQuery& query,
                       Separation& separation) {
    const double grown = a.radius + b.radius;
    Simplex& simplex = separation.simplex;
    Vec3 v = separation.direction;
    if (!(squared_norm(v) > 0.0)) v = a_from_b.translation;
    if (!(squared_norm(v) > 0.0)) v = {1.0, 0.0, 0.0};
    double vv = kInfinity, lower = -kInfinity;
    bool converged = false;
    int known = simplex.size;  // vertices of an earlier query, which are placed again if the direction does not suffice
    simplex.size = 0;
    for (int iteration = 0; iteration < kIterations; ++iteration) {
        const Vec3 u = (1.0 / norm(v)) * v;
        const Vec3 of_a = support(a, u);
        const Vec3 of_b = support(b, transposed_times(a_from_b.rotation, -u));
        const Vec3 difference = a_from_b * of_b - of_a;
        const double gap = dot(u, difference);
        if (gap > lower) {
            lower = gap;
            separation.direction = u;
            if (lower - grown > query.above) break;
        }
        if (converged) break;  // The gap along the last direction completes the lower bound.
        if (simplex.size > 0) {
            const double upper = std::sqrt(vv);
            if (upper - lower <= std::max(query.precision, query.share * (upper - grown - query.below))) break;
        }
        bool again = false;
        for (int i = 0; i < simplex.size; ++i) again = again || same(simplex.vertices[i].difference, difference);
        if (again) break;  // No point is closer in that direction: the iteration has converged.
        const int earlier = std::exchange(known, 0);
        if (earlier > 0) place_again(simplex, earlier, a_from_b, difference);
        simplex.vertices[simplex.size++] = {difference, of_a, of_b, 0.0};
        const double before = vv;
        bool whole = move_to_nearest(simplex, v);
        if (!whole && earlier > 0) {  // The earlier simplex has become flat: begin again without it.
            simplex.size = 1;
            simplex.vertices[0] = {difference, of_a, of_b, 1.0};
            v = difference;
            whole = true;
        }
        vv = squared_norm(v);
        if (!whole || simplex.size == 4 || std::sqrt(vv) - grown <= query.below || !(vv > kOverlap * kOverlap)) break;
        converged = !(vv < before * (1.0 - kStill));
    }
    if (known > 0) simplex.size = known;  // The direction sufficed.
    const double upper = std::sqrt(vv) - grown;
    if (std::isnan(upper)) {  // Overflow: the bounds carry no information.
        simplex.size = 0;
        return {-kInfinity, kInfinity};
    }
    return {lower - grown, upper > kOverlap ? upper : 0.0};
}

}  // namespace

DistanceBounds bound_distance(const Shape& a, const Shape& b, const Transform& a_from_b, const DistanceQuery& query,
                              Separation& separation) {
    if (b.kind == ShapeKind::kCells) return bound_cell_distance(a, b, a_from_b, query, separation);
    if (a.kind == ShapeKind::kMesh || b.kind == ShapeKind::kMesh)
        return bound_mesh_distance(a, b, a_from_b, query, separation);
    if (b.kind == ShapeKind::kHalfSpace) return above_plane(a, a_from_b, separation);
    return iterate(a, b, a_from_b, query, separation);
}

DistanceBounds bound_distance(const Triangle& a, const Shape& b, const Transform& a_from_b, const DistanceQuery& query,
                              Separation& separation) {
    if (b.kind == ShapeKind::kHalfSpace) return above_plane(a, a_from_b, separation);
    return iterate(a, b, a_from_b, query, separation);
}

DistanceBounds bound_distance(const Shape& a, const Triangle& b, const Transform& a_from_b, const DistanceQuery& query,
                              Separation& separation) {
    return iterate(a, b, a_from_b, query, separation);
}

DistanceBounds bound_distance(const Triangle& a, const Triangle& b, const Transform& a_from_b,
                              const DistanceQuery& query, Separation& separation) {
    return iterate(a, b, a_from_b, query, separation);
}

Witnesses witnesses(const Shape& a, const Shape& b, const Separation& separation) {
    Witnesses points;
    for (int i = 0; i < separation.simplex.size; ++i) {
        const Simplex::Vertex& vertex = separation.simplex.vertices[i];
        points.of_a += vertex.weight * vertex.of_a;
        points.of_b += vertex.weight * (vertex.difference + vertex.of_a);
    }
    points.of_a += a.radius * separation.direction;
    points.of_b -= b.radius * separation.direction;
    return points;
}

}  // namespace pinproof
