// The configurations of six joints in general position, as the eigenvalues of a matrix of 16 rows.
//
// The loop E_1 ... E_6 = G of motions about six lines is cut at the last joint. A point p of its line and its direction h
// are not moved by E_6, so that
//
//     E_3 E_4 E_5 (p, h) = E_2^-1 E_1^-1 G (p, h) = (p', h').
//
// Besides the six coordinates of p' and h', the eight numbers p'.p', p'.h', p' x h' and (p'.p') h' - 2 (p'.h') p' are
// linear in (1, cos, sin) of each joint on both sides as well (Raghavan and Roth 1993). The right sides contain eight
// products of the states of joints 1 and 2; Gauss-Jordan elimination with full pivoting leaves six equations in joints 3
// to 5. In the half-angle tangents x of joint 4 and y of joint 5, these and their multiples by x are 12 homogeneous
// linear equations A(q_3) v = 0 in the powers v = x^a y^b, a < 4, b < 3.
//
// Joint 3 rotates the four vectors about the z axis of a frame on its line, and the two scalars not at all. With
// z = exp(i (q_3 - t_0)), and bars for complex conjugates,
//
//     A = A_0 + (z - 1) P W + (1/z - 1) bar(P W),
//
// where W (8 x 12) contains w = x + i y of the four vectors. This has 16 roots other than z = 0 and infinity. Raghavan
// and Roth compute 24 eigenvalues, of which 8 belong to these two. Here they do not occur: with t = tan((q_3 - t_0) / 2)
// and a = W v / (1 - i t), A v = 0 becomes A_0 v = 4 t Im(P a), and so
//
//     (1 / t) a = i a + 4 W A_0^-1 Im(P a),
//
// a real eigenvalue problem of 16 rows in the real and imaginary parts of a. It requires only that A is regular at t_0,
// which may be chosen. Joints 4 and 5 follow from v, joints 1 and 2 from the eliminated products, joint 6 from the
// remaining rotation. Every real configuration is an eigenvector with a real eigenvalue, and multiple solutions are
// multiple eigenvalues: if all 16 eigenvalues are known to be complex or to belong to a solution, no solution is missing.
//
// One of joints 1, 2, 4 and 5 may be prismatic. The functions are then linear in (1, d, d^2) of its value d, which takes the
// place of (1, cos, sin), and of the powers of x or y. With two prismatic joints, A is singular everywhere
// (prismatic_loop.h).
//
// Sources: Raghavan and Roth (1993), "Inverse kinematics of the general 6R manipulator and related linkages"; Manocha and
// Canny (1994), "Efficient inverse kinematics for general 6R manipulators", for eigenvalues instead of a determinant.
#pragma once

#include <limits>

#include "algebra/eigenvalues.h"
#include "geometry/rotations.h"

namespace pinproof {

// A line about which a joint rotates, or along which it moves; lengths relative to the size of the arm.
struct LoopLine {
    Vec3 direction, point;
    bool prismatic = false;
};

inline Transform motion_of(const LoopLine& line, double value) {
    return motion_of_joint(line.direction, line.point, line.prismatic, value);
}

struct PolishedLoop {
    double residual;  // lengths of the arm and rad
    double weakest;   // the smallest pivot of the Jacobian at the solution: 0 where it is singular
};

// Move q to the solution of E_0(q_0) ... E_5(q_5) = g that is closest to it.
PolishedLoop polish_loop(const LoopLine (&lines)[6], const Transform& g, double (&q)[6]);
// Where the loop is cut: the joint that takes the place of joint 6, and the direction of the loop.
struct Cut {
    int dropped;
    bool reversed;
    bool shifted = false;  // with other values of t_0: another matrix for the same equations
};

// A loop that is cut: E_0 ... E_5 = loop for its lines, and the joint of the arm that each of them belongs to.
struct CutLoop {
    LoopLine line[6];
    int source[6];
    Transform loop;
};

CutLoop cut_loop(const LoopLine (&lines)[6], const Transform& g, const Cut& cut);

// Rad. Eigenvalues with a smaller imaginary part (of q_3) may be a double root separated by rounding, and are tried as
// starts of Newton's method; at targets that are singular in several ways, also those up to the second value.
inline constexpr double kNearlyReal = 1e-3, kPerhapsReal = 0.3;

inline constexpr double kEpsilon = std::numeric_limits<double>::epsilon();

// Lengths of the arm, and above every angle: a prismatic joint further away is no solution.
inline constexpr double kFarthest = 1e6;

// Configurations near the real eigenvalues.
struct EliminationResult {
    static constexpr int kMost = kEigenRows;

    int count = 0;
    double start[kMost][6];  // the values of the joints, in the order of the lines
    // The number of configurations at most: eigenvalues, or roots, less those that are complex in spite of rounding.
    int existing = 0;
    // False if the equations are singular for this target, or the result is too inaccurate.
    bool usable = false;
};

// Solve E_0 ... E_5 = g for the motions about six lines.
void solve_by_elimination(const LoopLine (&lines)[6], const Transform& g, const Cut& cut, double nearly_real,
                          EliminationResult& out);

}  // namespace pinproof
