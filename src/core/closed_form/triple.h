// The triple: three consecutive joints whose common motion W is known.
//
// Their lines are f, g, l (first, middle, last). Three conditions determine the joints, in this order:
//
// 1. the middle from what the first cannot change, linear in its state: spherical: h_f . R_g h_l = h_f . R_W h_l;
//    planar, with r = E_g o_l, the distance of r from the first line, or, if the first is prismatic along d, its height
//    over d: |r - o_f| = |W o_l - o_f|, (n x d) . r = (n x d) . W o_l;
// 2. the first joint by rotating (or moving) R_g h_l to R_W h_l, or r to W o_l;
// 3. the last joint by the remaining motion of a direction e perpendicular to its line, R_g^T R_f^T R_W e.
//
// If the vector in 2 is parallel to the line (a straight wrist; a folded elbow), the first joint is free, and 3
// compensates for its value. A planar triple whose last joint is prismatic is reversed, W^-1 = E_l^-1 E_g^-1 E_f^-1, if
// its first one is revolute; if that is prismatic too, the middle joint is the rotation of W, and the others share its
// translation.
#pragma once

#include "closed_form/outer_joints.h"

namespace pinproof {

// A configuration of all six joints of the loop.
struct LoopSolution {
    JointState state[6];
    unsigned free = 0, assumed = 0;  // as in OuterSolution
    SolutionNumber number;
    double error = 0.0;  // of the joints (rad, or lengths of the arm) due to the tolerances
};

// A list without allocation.
struct LoopSolutions {
    static constexpr int kMost = 2 * OuterSolutions::kMost;

    int count = 0;
    LoopSolution solution[kMost];
    bool undecided = false, doubtful = false;  // as in OuterSolutions
};

// Add all solutions of the triple for a solution of the outer joints.
void solve_triple(const Loop& loop, const LoopTolerances& tolerances, const OuterSolution& outer, bool assume_free,
                  LoopSolutions& out);

}  // namespace pinproof
