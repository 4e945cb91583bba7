// The three joints outside the triple: the intersection of two curves.
//
// The loop of six joints, cut at one joint, is W^-1 = E_a E_b E_c G^-1, where W is the motion of the triple (three
// consecutive joints), a, b, c are the joints that follow it in the loop, and E_a is the motion of joint a from zero. The
// lines of joints before the triple are transformed by G^-1, so that the position of the triple in the chain does not
// matter. A triple has an invariant, which gives two equations in the states of c (x) and a (y) without b:
//
// Spherical (invariant point O): E_b E_c p = E_a^-1 O with p = G^-1 O. Joint b must bring the curves m(x) = E_c p and
// k(y) = E_a^-1 O together. If b is revolute about h through o, this is possible if h . m = h . k and |m - o|^2 =
// |k - o|^2; if it is prismatic along h, if m - k has no component perpendicular to h.
//
// Planar (invariant direction n, and heights along n): R_b m = k with m(x) = R_c n', k(y) = R_a^T n, n' = R_G^T n, which
// is possible for a revolute b if h . m = h . k. The height of E_a E_b E_c p over a point p_0, expressed by k and m,
//
//     n . o_a + k . (o_b - o_a) + m . (o_c - o_b) + n' . (p - o_c) = n . p_0,
//
// is linear as well; a prismatic joint adds its translation times n . h. (If b itself is prismatic, it preserves
// directions: h_a . m = h_a . n and h_c . k = h_c . n' are necessary, m = k is checked for their solutions, and the
// height gives its translation.)
//
// Each of these equations is F s(x) + G s(y) + k = 0, linear in the state s of a joint. (For a prismatic joint, |m|^2 is
// quadratic: s contains its square.) If a combination of the two does not contain one unknown, it gives two roots of the
// other, as for most industrial arms. Otherwise s(y) = -G^-1 (F s(x) + k) must be a state, cos^2 + sin^2 = 1, which is a
// quartic in the half-angle tangent of x; its solutions are refined on the two equations.
//
// Sources: Pieper (1968), "The kinematics of manipulators under computer control"; Paden (1986), subproblems; Elias and
// Wen (2022), "IK-Geo: Unified robot inverse kinematics using subproblem decomposition", for the same decomposition by
// geometry.
#pragma once

#include "closed_form/line.h"
#include "closed_form/roots.h"

namespace pinproof {

// The six lines of the loop: the triple (first, middle, last), then a, b, c. Sets of joints are bits of these indices.
struct Loop {
    static constexpr int kFirst = 0, kMiddle = 1, kLast = 2, kA = 3, kB = 4, kC = 5;

    Line line[6];
    bool planar;
    Vec3 point, moved_point;    // O, or a point of the plane: before and after G^-1
    Vec3 normal, moved_normal;  // n of a planar triple, likewise
    bool reversed;              // the triple is solved from its last joint
    Transform rest;             // G
    Vec3 perpendicular;         // unit, to the probed line

    // The first and the last joint of the triple are prismatic: the middle one is the rotation of W.
    bool between_prismatic() const { return line[kFirst].prismatic && line[kLast].prismatic; }
    // The line of the triple whose motion by W is computed.
    const Line& probed() const { return line[between_prismatic() ? kMiddle : kLast]; }
};

struct LoopTolerances {
    double border;     // an equation that fails to have a root by less is tried as a double root
    double spread;     // see RootSettings
    ErrorBound error;  // the change of an equation by rounding, and by the tolerances of the answer
};

// An equation without a root is treated as having a double root if it fails by less than this multiple of the change
// that the tolerances permit.
inline constexpr double kNear = 4.0;

// The number of a solution: which combination of roots it is, and whether joints are free only because the direction of
// an uncertain vector was ignored. It identifies the same solution at neighbouring values of a free joint.
struct SolutionNumber {
    int root = 0;               // 0 to 15
    bool outer_assumed = false;   // such a joint is outside the triple
    bool triple_assumed = false;  // or one of the triple

    int code() const { return root + (outer_assumed ? 16 : 0) + (triple_assumed ? 32 : 0); }
    // Its bit in a set of solutions.
    unsigned bit() const { return 1u << (root + (outer_assumed || triple_assumed ? 16 : 0)); }
};

// A solution for the joints outside the triple.
struct OuterSolution {
    JointState a, b, c;
    unsigned free = 0;     // joints that are free
    unsigned assumed = 0;  // those of them that are free only because an uncertain vector was treated as zero
    int root = 0;          // 0 to 7
    ErrorBound error;      // of the rotation about all three joints
};

struct OuterSolutions {
    static constexpr int kMost = 8;  // four of a quartic, each of which may be a double root with two candidates

    int count = 0;
    OuterSolution solution[kMost];
    bool by_quartic = false;
    bool undecided = false;  // rounding may have decided whether a joint is free
    bool doubtful = false;   // a case was omitted, or is not supported

    void add(const OuterSolution& one) { solution[count++] = one; }
};

// With `assume_free`, joints that depend on the direction of an uncertain vector are free; otherwise only those that
// depend on a zero vector.
OuterSolutions solve_outer_joints(const Loop& loop, const LoopTolerances& tolerances, bool assume_free);

// w^2 (see roots.h) of the equation h . R b = height for a unit vector b that rotates about g, with alpha = h . g and
// beta = b . g: (1 - alpha^2)(1 - beta^2) - (height - alpha beta)^2, a Gram determinant.
//
// If the desired vector, a unit vector of that height, is close to h, this loses half the digits; `across2`, the square
// of its component perpendicular to h, does not: 1 - height^2 = across2.
inline double gram_determinant(double alpha, double beta, double height, double across2) {
    if (height >= 0.0)
        return across2 * (1.0 - 2.0 * alpha * beta / (1.0 + height)) - (alpha - beta) * (alpha - beta);
    return across2 * (1.0 + 2.0 * alpha * beta / (1.0 - height)) - (alpha + beta) * (alpha + beta);
}

}  // namespace pinproof
