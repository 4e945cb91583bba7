// The configurations of a loop of six joints with two or three prismatic ones, in general position.
//
// Prismatic joints do not change rotations, so the loop E_1 ... E_6 = G determines those of the revolute joints alone.
//
// Three revolute joints A, B, C: R_A R_B R_C = R_G gives h_A . R_B h_C = h_A . R_G h_C, linear in (cos, sin) of joint B.
//
// Four revolute joints A, B, C, D: with w = R_G h_D,
//
//     (1)  R_A R_B h_C . w = h_C . h_D,
//
// linear in the state of joint A and in that of joint B. The joints C and D need not be known: every vector v of the link
// between them is a combination of h_C, h_D and h_C x h_D, and becomes the same combination of k = R_A R_B h_C, w and k x w.
// So the translation X of the loop without the prismatic joints, and the directions U, V in which these move it, depend on
// joints A and B alone, and
//
//     (2)  det(X, U, V) = 0.
//
// At a given value of joint B, (1) has two roots for joint A. With A cos a + B sin a = C for (1), the product of (2) at both
// roots, times A^2 + B^2, is a trigonometric polynomial of degree 4 in joint B: up to eight configurations. It is sampled at
// 16 values; the Fourier coefficients above the fourth are zero but for rounding, and measure the error of the others. In
// z = exp(i q_B), a configuration is a root on the unit circle. Smith's discs around the approximate roots contain all roots,
// and decide which of them are not on the circle.
//
// Sources: Raghavan and Roth (1993) for the number of configurations; Aberth (1973) for the iteration; Smith (1970), "Error
// bounds for zeros of a polynomial based upon Gerschgorin's theorems".
#pragma once

#include "closed_form/elimination.h"

namespace pinproof {

// Whether these lines are solved here: two or three of them are prismatic.
bool is_prismatic_loop(const LoopLine (&lines)[6]);

// As solve_by_elimination.
void solve_prismatic_loop(const LoopLine (&lines)[6], const Transform& g, const Cut& cut, double nearly_real,
                          EliminationResult& out);

}  // namespace pinproof
