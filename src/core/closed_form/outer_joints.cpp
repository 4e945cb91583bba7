#include "closed_form/outer_joints.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace pinproof {
namespace {

// A 2 x 2 matrix whose determinant is smaller than this fraction of its squared size is treated as singular. The error
// is removed by refinement; a quartic would lose as much accuracy by rounding, which grows with the inverse square.
constexpr double kSeparable = 1e-5;

// m = k is considered satisfied up to this; refinement and forward kinematics decide afterwards.
constexpr double kSameDirection = 1e-4;

constexpr double kExact = 1e-14;        // residual of the two equations that needs no refinement
constexpr int kRefinements = 4;         // Newton steps
constexpr double kLongestStep = 0.3;    // rad, or lengths of the arm, of such a step
constexpr double kZeroQuartic = 1e-30;  // largest value of a scaled quartic that is zero everywhere
constexpr double kAtInfinity = 1e-9;    // a prismatic joint further away (its inverse) is no solution
constexpr double kNoShare = 1e-9;       // a smaller factor of the second equation in a combination is zero

// A 2 x 2 matrix.
struct Mat2 {
    double m[2][2] = {};

    double determinant() const { return m[0][0] * m[1][1] - m[0][1] * m[1][0]; }
    double squared_size() const {
        return m[0][0] * m[0][0] + m[0][1] * m[0][1] + m[1][0] * m[1][0] + m[1][1] * m[1][1];
    }
    double row_times(int i, const JointState& s) const { return m[i][0] * s.first + m[i][1] * s.second; }
    // |determinant| relative to the squared size; 0 for a zero matrix.
    double regularity() const {
        const double size = squared_size();
        return size > kFree * kFree ? std::abs(determinant()) / size : 0.0;
    }
};

// One of the two unknowns, c or a.
struct Unknown {
    bool prismatic;
    int line;  // its index in the loop
};

// Two equations F s(x) + G s(y) + k = 0.
struct Equations {
    Mat2 f, g;
    double k[2];
    Unknown x, y;

    // Equation i states that h . m(x) = h . k(y), for the curves of both joints.
    void equate_along(int i, const Vec3& h, const Curve& m, const Curve& k_of_y) {
        f.m[i][0] = dot(h, m.first);
        f.m[i][1] = dot(h, m.second);
        g.m[i][0] = -dot(h, k_of_y.first);
        g.m[i][1] = -dot(h, k_of_y.second);
        k[i] = dot(h, m.centre) - dot(h, k_of_y.centre);
    }
    double residual(int i, const JointState& sx, const JointState& sy) const {
        return f.row_times(i, sx) + g.row_times(i, sy) + k[i];
    }
};

// The equations, and the curves m(x) of c and k(y) of a that they intersect.
struct Problem {
    Equations equations;
    Curve of_c, of_a;
};

Problem planar_problem(const Loop& loop) {
    const Line &a = loop.line[Loop::kA], &b = loop.line[Loop::kB], &c = loop.line[Loop::kC];
    const Vec3 &n = loop.normal, &moved_n = loop.moved_normal;
    const Curve m = direction_curve(c, Sense::forward, moved_n), k = direction_curve(a, Sense::backward, n);
    Equations e{{}, {}, {}, {c.prismatic, Loop::kC}, {a.prismatic, Loop::kA}};
    if (b.prismatic) {
        e.f.m[0][0] = dot(a.direction, m.first);
        e.f.m[0][1] = dot(a.direction, m.second);
        e.k[0] = dot(a.direction, m.centre) - dot(a.direction, n);
        e.g.m[1][0] = dot(c.direction, k.first);
        e.g.m[1][1] = dot(c.direction, k.second);
        e.k[1] = dot(c.direction, k.centre) - dot(c.direction, moved_n);
        return {e, m, k};
    }
    e.equate_along(0, b.direction, m, k);

    const Vec3 arm = b.point - a.point, lever = c.point - b.point;
    e.k[1] = -dot(n, loop.point);
    if (a.prismatic) {
        e.g.m[1][0] = dot(n, a.direction);
        e.k[1] += dot(n, b.point);
    } else {
        e.g.m[1][0] = dot(k.first, arm);
        e.g.m[1][1] = dot(k.second, arm);
        e.k[1] += dot(k.centre, arm) + dot(n, a.point);
    }
    if (c.prismatic) {
        e.f.m[1][0] = dot(moved_n, c.direction);
        e.k[1] += dot(moved_n, loop.moved_point - b.point);
    } else {
        e.f.m[1][0] = dot(m.first, lever);
        e.f.m[1][1] = dot(m.second, lever);
        e.k[1] += dot(m.centre, lever) + dot(moved_n, loop.moved_point - c.point);
    }
    return {e, m, k};
}

Problem spherical_problem(const Loop& loop) {
    const Line &a = loop.line[Loop::kA], &b = loop.line[Loop::kB], &c = loop.line[Loop::kC];
    Curve m = point_curve(c, Sense::forward, loop.moved_point), k = point_curve(a, Sense::backward, loop.point);
    Equations e{{}, {}, {}, {c.prismatic, Loop::kC}, {a.prismatic, Loop::kA}};
    if (b.prismatic) {
        const Vec3 along = unit_perpendicular(b.direction);
        e.equate_along(0, along, m, k);
        e.equate_along(1, cross(b.direction, along), m, k);
        return {e, m, k};
    }
    m.centre -= b.point;
    k.centre -= b.point;
    e.equate_along(0, b.direction, m, k);
    // |centre + first s_1 + second s_2|^2 with |first| = |second| and first . second = 0 on a circle; s_2 = s_1^2 on a line
    e.f.m[1][0] = 2.0 * dot(m.centre, m.first);
    e.f.m[1][1] = c.prismatic ? 1.0 : 2.0 * dot(m.centre, m.second);
    e.g.m[1][0] = -2.0 * dot(k.centre, k.first);
    e.g.m[1][1] = a.prismatic ? -1.0 : -2.0 * dot(k.centre, k.second);
    e.k[1] = squared_norm(m.centre) - squared_norm(k.centre) + (c.prismatic ? 0.0 : squared_norm(m.first)) -
             (a.prismatic ? 0.0 : squared_norm(k.first));
    return {e, m, k};
}

// A solution of the two equations.
struct Pair {
    JointState x, y;
    ErrorBound x_error, y_error;
    unsigned free = 0, assumed = 0;
    int root = 0;
};

struct Pairs {
    int count = 0;
    Pair pair[OuterSolutions::kMost];

    void add(const Pair& one) { pair[count++] = one; }
};

// A factor for each of the two equations.
struct Combination {
    double u0, u1;

    double of(double first, double second) const { return u0 * first + u1 * second; }
    double of(const Mat2& matrix, int column) const { return of(matrix.m[0][column], matrix.m[1][column]); }
    Combination perpendicular() const { return {-u1, u0}; }
};

// The combination of the equations in which G is largest; the one perpendicular to it contains x only.
Combination dominant_combination(const Equations& e) {
    const auto& g = e.g.m;
    const auto& f = e.f.m;
    Combination u;
    if (e.g.squared_size() > kFree * kFree) {
        const double left = g[0][0] * g[0][0] + g[1][0] * g[1][0], right = g[0][1] * g[0][1] + g[1][1] * g[1][1];
        u = left >= right ? Combination{g[0][0], g[1][0]} : Combination{g[0][1], g[1][1]};
    } else {
        const double left = f[0][0] * f[0][0] + f[1][0] * f[1][0], right = f[0][1] * f[0][1] + f[1][1] * f[1][1];
        u = left >= right ? Combination{-f[1][0], f[0][0]} : Combination{-f[1][1], f[0][1]};
    }
    const double size = std::sqrt(u.u0 * u.u0 + u.u1 * u.u1);
    return size > 0.0 ? Combination{u.u0 / size, u.u1 / size} : Combination{1.0, 0.0};
}

// What a solution of x implies for the equation of y: a more accurate discriminant, and the errors of that equation.
struct Conditioning {
    double square = std::numeric_limits<double>::quiet_NaN();
    ErrorBound error;
};

// If the equation of y is h_b . k = h_b . m alone, for unit vectors m and k.
Conditioning directions_only(const Loop& loop, const Curve& of_x, bool x_is_c, const JointState& x,
                             const ErrorBound& error, const ErrorBound& x_error) {
    const Line& b = loop.line[Loop::kB];
    const Vec3 known = of_x.at(x);
    const Vec3& rotating = x_is_c ? loop.normal : loop.moved_normal;
    const Vec3& axis = loop.line[x_is_c ? Loop::kA : Loop::kC].direction;
    const double alpha = dot(b.direction, axis), beta = dot(axis, rotating);
    const double across2 = squared_norm(across(known, b.direction)), part = std::sqrt(across2);
    const double tilt = std::abs(std::abs(alpha) - std::abs(beta));
    const double rounding = error.rounding + x_error.rounding, tolerance = error.tolerance + x_error.tolerance;
    return {gram_determinant(alpha, beta, dot(b.direction, known), across2),
            {error.rounding * tilt + (part + rounding) * rounding,
             error.tolerance * tilt + (part + tolerance) * tolerance}};
}

// Solutions where one combination of the equations contains x only: G is (nearly) singular.
Pairs solve_separately(const Loop& loop, const Equations& e, const Curve& of_x, const LoopTolerances& tolerances,
                       bool assume_free, bool& undecided) {
    const ErrorBound& error = tolerances.error;
    const Line &x_line = loop.line[e.x.line], &y_line = loop.line[e.y.line];
    const Combination u = dominant_combination(e), v = u.perpendicular();
    const double left_out = e.g.regularity() * std::sqrt(e.g.squared_size());  // the part of y, if not exactly singular
    const LinearEquation of_x_only{v.of(e.f, 0), v.of(e.f, 1), v.of(e.k[0], e.k[1]), e.x.prismatic};
    const double near = std::max(tolerances.border, kNear * (error.tolerance + left_out));

    Roots xs = solve(of_x_only, {.border = near, .spread = tolerances.spread});
    const unsigned x_free = xs.every_value ? 1u << e.x.line : 0u;
    if (xs.every_value) xs = {1, false, {reference_state(x_line), {}}};

    Pairs found;
    for (int i = 0; i < xs.count; ++i) {
        const JointState& x = xs.state[i];
        const ErrorBound x_error =
            x_free ? ErrorBound{} : root_error(of_x_only, x, {error.rounding, error.tolerance + left_out});
        const JointState dx = derivative(x, e.x.prismatic);
        const double growth = std::abs(u.of(e.f.row_times(0, dx), e.f.row_times(1, dx)));
        Conditioning y_conditioning;
        y_conditioning.error = {error.rounding + (growth + x_error.rounding) * x_error.rounding,
                                error.tolerance + (growth + x_error.tolerance) * x_error.tolerance};
        const double y_near = std::max(tolerances.border, kNear * (y_conditioning.error.tolerance + left_out));
        if (loop.planar && !loop.line[Loop::kB].prismatic && !e.y.prismatic && std::abs(u.u1) < kNoShare)
            y_conditioning = directions_only(loop, of_x, e.x.line == Loop::kC, x, error, x_error);

        const LinearEquation of_y{u.of(e.g, 0), u.of(e.g, 1),
                                  u.of(e.f.row_times(0, x) + e.k[0], e.f.row_times(1, x) + e.k[1]), e.y.prismatic};
        const double unsure =
            kUncertain * (error.rounding + growth * x_error.rounding + x_error.rounding * x_error.rounding);
        const double largest = of_y.largest_coefficient();
        double free = kFree;
        if (unsure > kFree && largest < unsure && largest >= 0.7 * kFree) {
            undecided = true;
            if (assume_free) free = 2.0 * unsure;
        }
        Roots ys = solve(of_y, {y_near, tolerances.spread, free, y_conditioning.square});
        const unsigned y_free = ys.every_value ? 1u << e.y.line : 0u;
        if (ys.every_value) ys = {1, false, {reference_state(y_line), {}}};
        for (int j = 0; j < ys.count; ++j) {
            Pair pair{x, ys.state[j], x_error, {}, x_free | y_free, 0u, 2 * i + j};
            if (y_free && free != kFree) pair.assumed = pair.free;
            if (!y_free) pair.y_error = root_error(of_y, pair.y, y_conditioning.error);
            found.add(pair);
        }
    }
    return found;
}

// The quadratic form c[0] w^2 + c[1] t w + c[2] t^2 in the homogeneous half-angle tangent t / w of a joint.
struct Form {
    double c[3];

    double at(double t, double w) const { return c[0] * w * w + c[1] * t * w + c[2] * t * t; }
    // The same form in coordinates (t', w') with t = t' cosine + w' sine, w = w' cosine - t' sine.
    Form rotated(double sine, double cosine) const {
        return {{c[0] * cosine * cosine + c[1] * sine * cosine + c[2] * sine * sine,
                 2.0 * (c[2] - c[0]) * sine * cosine + c[1] * (cosine * cosine - sine * sine),
                 c[0] * sine * sine - c[1] * sine * cosine + c[2] * cosine * cosine}};
    }
};

// p + q s_1 + r s_2 times the common denominator of the state s.
Form form_of(double p, double q, double r, bool prismatic) {
    return prismatic ? Form{{p, q, r}} : Form{{p + q, 2.0 * r, p - q}};
}

// Solutions by a quartic where G is invertible: det(G) s(y) = -(P, Q), both linear in s(x). Returns false if the quartic
// is zero, so that every value is a root.
//
// As forms of degree 2 in (t, w), s(x) = (w^2 - t^2, 2 t w) / (w^2 + t^2) or (t w, t^2) / w^2. The forms are rotated such
// that no root is near infinity: to the point, among several, where the quartic is largest.
bool solve_by_quartic(const Equations& e, double nearly, Pairs& found) {
    const auto& f = e.f.m;
    const auto& g = e.g.m;
    double det = e.g.determinant();
    double p[3] = {g[1][1] * e.k[0] - g[0][1] * e.k[1], g[1][1] * f[0][0] - g[0][1] * f[1][0],
                   g[1][1] * f[0][1] - g[0][1] * f[1][1]};
    double q[3] = {g[0][0] * e.k[1] - g[1][0] * e.k[0], g[0][0] * f[1][0] - g[1][0] * f[0][0],
                   g[0][0] * f[1][1] - g[1][0] * f[0][1]};
    const double scale = 1.0 / std::max({std::abs(det), std::abs(p[0]) + std::abs(p[1]), std::abs(p[2]),
                                         std::abs(q[0]) + std::abs(q[1]), std::abs(q[2])});
    det *= scale;
    for (int i = 0; i < 3; ++i) {
        p[i] *= scale;
        q[i] *= scale;
    }
    Form P = form_of(p[0], p[1], p[2], e.x.prismatic), Q = form_of(q[0], q[1], q[2], e.x.prismatic);
    Form D = form_of(1.0, 0.0, 0.0, e.x.prismatic);  // the common denominator

    constexpr int directions = 7;
    double best = -1.0, cosine = 1.0, sine = 0.0;
    for (int i = 0; i < directions; ++i) {
        const auto [s, c] = sincos(0.2 + i * (std::numbers::pi / directions));
        const double at_p = P.at(-c, s), at_q = Q.at(-c, s), at_d = D.at(-c, s);
        const double value = std::abs(e.y.prismatic ? at_p * at_p + det * at_q * at_d
                                                    : at_p * at_p + at_q * at_q - det * det * at_d * at_d);
        if (value > best) {
            best = value;
            cosine = c;
            sine = s;
        }
    }
    if (best < kZeroQuartic) return false;
    P = P.rotated(sine, cosine);
    Q = Q.rotated(sine, cosine);
    D = D.rotated(sine, cosine);
    double quartic[5] = {};
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            quartic[i + j] += P.c[i] * P.c[j] + (e.y.prismatic ? det * Q.c[i] * D.c[j]
                                                               : Q.c[i] * Q.c[j] - det * det * D.c[i] * D.c[j]);

    const QuarticRoots roots = quartic_roots(quartic, nearly);
    for (int i = 0; i < roots.count; ++i) {
        const double t = roots.value[i] * cosine + sine, w = -roots.value[i] * sine + cosine;
        JointState x;
        if (e.x.prismatic) {
            if (std::abs(w) < kAtInfinity * std::abs(t)) continue;
            x = prismatic_state(t / w);
        } else {
            const double size = 1.0 / (t * t + w * w);
            x = {(w * w - t * t) * size, 2.0 * t * w * size};
        }
        JointState y{-(p[0] + p[1] * x.first + p[2] * x.second) / det,
                     -(q[0] + q[1] * x.first + q[2] * x.second) / det};
        if (e.y.prismatic) {
            y = prismatic_state(y.first);
        } else {
            const double size = std::sqrt(y.first * y.first + y.second * y.second);
            y = size > 0.0 ? JointState{y.first / size, y.second / size} : JointState{};
        }
        Pair pair{x, y, {}, {}, 0u, 0u, found.count};
        found.add(pair);
    }
    return true;
}

// The derivatives of the two equations by the values of x and y.
struct Derivatives {
    double a, b, c, d;  // row by row

    Derivatives(const Equations& e, const JointState& x, const JointState& y) {
        const JointState dx = derivative(x, e.x.prismatic), dy = derivative(y, e.y.prismatic);
        a = e.f.row_times(0, dx);
        b = e.g.row_times(0, dy);
        c = e.f.row_times(1, dx);
        d = e.g.row_times(1, dy);
    }
    double determinant() const { return a * d - b * c; }
};

// Newton's steps on the two equations, while they reduce the residual.
void refine(const Equations& e, Pair& pair) {
    JointState x = pair.x, y = pair.y;
    double last = std::numeric_limits<double>::infinity();
    for (int step = 0; step <= kRefinements; ++step) {
        const double r0 = e.residual(0, x, y), r1 = e.residual(1, x, y);
        const double size = std::abs(r0) + std::abs(r1);
        if (!(size < last)) return;
        pair.x = x;
        pair.y = y;
        last = size;
        const Derivatives by(e, x, y);
        const double det = by.determinant();
        if (size < kExact || std::abs(det) < kExact) return;
        const double dx = (by.b * r1 - by.d * r0) / det, dy = (by.c * r0 - by.a * r1) / det;
        if (std::abs(dx) + std::abs(dy) > kLongestStep) return;
        x = advanced(x, e.x.prismatic, dx);
        y = advanced(y, e.y.prismatic, dy);
    }
}

// The errors where both equations contain both unknowns, also if one hardly does, from the inverse of their Jacobian. Up
// to four roots may coincide, which an error d moves by d^(1/4).
//
// The Jacobian of the true root differs from that of the computed one by their distance r, which matters where a column
// is smaller than r: both unknowns may be double roots at once.
void estimate_errors(const Equations& e, const ErrorBound& error, Pair& pair) {
    const Derivatives by(e, pair.x, pair.y);
    const double det = std::abs(by.determinant());
    const double of_x = std::abs(by.b) + std::abs(by.d), of_y = std::abs(by.a) + std::abs(by.c);
    const auto estimate = [&](double d, double& x, double& y) {
        const double root = std::sqrt(d), size = of_x + of_y + root;
        const double per_cofactor = d / std::max(det, size * root * std::sqrt(root));  // d^(3/4)
        const double r = std::min(1.0, size * per_cofactor);
        x = std::min(r, (of_x + r) * per_cofactor);
        y = std::min(r, (of_y + r) * per_cofactor);
    };
    estimate(error.rounding, pair.x_error.rounding, pair.y_error.rounding);
    estimate(error.tolerance, pair.x_error.tolerance, pair.y_error.tolerance);
}

// The state of b for given c and a, and the result; nothing is added if b cannot bring the curves together.
class MiddleJoint {
  public:
    MiddleJoint(const Loop& loop, const Problem& problem, const LoopTolerances& tolerances, bool assume_free)
        : loop_(loop),
          problem_(problem),
          error_(tolerances.error),
          assume_free_(assume_free),
          lever_c_(norm(problem.of_c.first)),
          lever_a_(norm(problem.of_a.first)) {}

    void add(const Pair& pair, bool x_is_c, OuterSolutions& out) const {
        OuterSolution one;
        one.c = x_is_c ? pair.x : pair.y;
        one.a = x_is_c ? pair.y : pair.x;
        one.free = pair.free;
        one.assumed = pair.assumed;
        one.root = pair.root;
        const ErrorBound &c_error = x_is_c ? pair.x_error : pair.y_error, &a_error = x_is_c ? pair.y_error : pair.x_error;
        const Vec3 m = problem_.of_c.at(one.c), k = problem_.of_a.at(one.a);
        ErrorBound b_error;
        if (!loop_.line[Loop::kB].prismatic) {
            rotate(m, k, c_error, a_error, one, b_error, out);
        } else if (!loop_.planar) {
            one.b = prismatic_state(dot(loop_.line[Loop::kB].direction, k - m));
        } else {
            constexpr unsigned outer = 1u << Loop::kA | 1u << Loop::kC;
            if ((one.free & outer) == outer) follow(m, one);
            if (!translate_in_plane(m, problem_.of_a.at(one.a), c_error, a_error, one, b_error, out)) return;
        }
        one.error = {error_.rounding + c_error.rounding + a_error.rounding + b_error.rounding,
                     error_.tolerance + c_error.tolerance + a_error.tolerance + b_error.tolerance};
        out.add(one);
    }

  private:
    void rotate(const Vec3& m, const Vec3& k, const ErrorBound& c_error, const ErrorBound& a_error, OuterSolution& one,
                ErrorBound& b_error, OuterSolutions& out) const {
        const Line& b = loop_.line[Loop::kB];
        const Alignment alignment = align(b.direction, m, k);
        one.b = alignment.state;
        const double short2 = std::min(squared_norm(across(m, b.direction)), squared_norm(across(k, b.direction)));
        const double off = error_.rounding + lever_c_ * c_error.rounding + lever_a_ * a_error.rounding;
        if (alignment.size < kFree * kFree || short2 < kFree * kFree) {
            one.b = reference_state(b);
            one.free |= 1u << Loop::kB;
        } else if (short2 < (kUncertain * off) * (kUncertain * off)) {
            out.undecided = true;
            b_error = {1.0, 1.0};
            if (assume_free_) {
                one.b = reference_state(b);
                one.free |= 1u << Loop::kB;
                one.assumed |= 1u << Loop::kB;
                b_error = {};
            }
        } else {
            const double inverse = 1.0 / std::sqrt(short2);
            const double tolerance =
                error_.tolerance + lever_c_ * c_error.tolerance + lever_a_ * a_error.tolerance;
            b_error = {off * inverse, std::min(1.0, tolerance * inverse)};
        }
    }

    // Joints a and c are parallel at this target, so that one of them may have any value: a follows c.
    void follow(const Vec3& m, OuterSolution& one) const {
        one.a = align(loop_.line[Loop::kA].direction, m, loop_.normal).state;
        one.free &= ~(1u << Loop::kA);
        one.assumed &= ~(1u << Loop::kA);
    }

    bool translate_in_plane(const Vec3& m, const Vec3& k, const ErrorBound& c_error, const ErrorBound& a_error,
                            OuterSolution& one, ErrorBound& b_error, OuterSolutions& out) const {
        const Line &a = loop_.line[Loop::kA], &b = loop_.line[Loop::kB], &c = loop_.line[Loop::kC];
        const double rounding = c_error.rounding + a_error.rounding, tolerance = c_error.tolerance + a_error.tolerance;
        const double same = std::max(kSameDirection, kNear * (error_.tolerance + tolerance));
        if (squared_norm(m - k) > same * same) {
            out.doubtful |= one.free != 0u;
            return false;
        }
        const double tilt = dot(k, b.direction);
        if (std::abs(tilt) < std::max(kFree, kUncertain * rounding)) {
            out.doubtful = true;  // the joint moves in the plane of the triple: free, which is not supported
            return false;
        }
        b_error = {rounding / std::abs(tilt), tolerance / std::abs(tilt)};
        const double height = dot(loop_.normal, a.point - loop_.point) - dot(k, a.point) + dot(m, c.point) +
                              dot(loop_.moved_normal, loop_.moved_point - c.point);
        one.b = prismatic_state(-height / tilt);
        return true;
    }

    const Loop& loop_;
    const Problem& problem_;
    const ErrorBound& error_;
    bool assume_free_;
    double lever_c_, lever_a_;
};

// Exchange the unknowns if G is then closer to singular than F (or, where neither is, further from it).
void order_unknowns(Equations& e) {
    const double f = e.f.regularity(), g = e.g.regularity();
    if (std::min(f, g) < kSeparable ? f < g : f > g) {
        std::swap(e.f, e.g);
        std::swap(e.x, e.y);
    }
}

}  // namespace

OuterSolutions solve_outer_joints(const Loop& loop, const LoopTolerances& tolerances, bool assume_free) {
    Problem problem = loop.planar ? planar_problem(loop) : spherical_problem(loop);
    Equations& e = problem.equations;
    order_unknowns(e);
    const bool x_is_c = e.x.line == Loop::kC;
    const double regularity = e.g.regularity();

    OuterSolutions out;
    Pairs pairs;
    if (regularity < kSeparable) {
        pairs = solve_separately(loop, e, x_is_c ? problem.of_c : problem.of_a, tolerances, assume_free, out.undecided);
    } else {
        out.by_quartic = true;
        out.doubtful = !solve_by_quartic(e, std::sqrt(std::max(tolerances.spread, kNear * tolerances.error.tolerance)),
                                         pairs);
    }
    const MiddleJoint middle(loop, problem, tolerances, assume_free);
    for (int i = 0; i < pairs.count; ++i) {
        Pair& pair = pairs.pair[i];
        if (regularity >= kExact) {
            if (!pair.assumed) refine(e, pair);
            estimate_errors(e, tolerances.error, pair);
        }
        middle.add(pair, x_is_c, out);
    }
    return out;
}

}  // namespace pinproof
