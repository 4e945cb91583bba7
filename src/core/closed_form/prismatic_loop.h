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

#include <complex>

#include "closed_form/elimination.h"

namespace pinproof {

class PrismaticLoop {
  public:
    // Whether these lines are solved here: two or three of them are prismatic.
    static bool applies(const LoopLine (&lines)[6]);

    // As Elimination::solve.
    void solve(const LoopLine (&lines)[6], const Transform& g, const Cut& cut, double nearly_real,
               EliminationResult& out);

  private:
    static constexpr int kDegree = 4, kMostRoots = 2 * kDegree, kSamples = 16;
    using Complex = std::complex<double>;

    // A vector of the link between joints C and D by its components along h_C, h_D and h_C x h_D.
    struct Components {
        double c, d, normal;
    };

    // (1) at a value of joint B: cosine cos a + sine sin a = constant; and (2) by the multiples of a, 1, cos, sin, cos 2a,
    // sin 2a.
    struct FirstJoint {
        double cosine, sine, constant;
        double determinant[5];

        double size2() const { return cosine * cosine + sine * sine; }
        double discriminant() const { return size2() - constant * constant; }
        double determinant_at(double a) const;
        double product_of_determinants() const;
    };

    bool prepare();
    Components components(const Vec3& v) const;
    FirstJoint first_joint(double b) const;
    double determinant(const Mat3& first, const Mat3& second) const;
    bool expand(bool shifted);
    bool find_roots();
    void classify(double nearly_real, EliminationResult& out);
    void start_from_second(double b, EliminationResult& out) const;
    void solve_three(double nearly_real, EliminationResult& out);
    void complete(double (&value)[6], EliminationResult& out) const;

    CutLoop cut_;
    int revolute_[4], prismatic_[3], revolute_count_, prismatic_count_;
    Vec3 w_, normal_;
    double normal2_;
    Components offset_;               // from the point of joint C to that of joint D
    Vec3 target_;                     // G o_D
    Components direction_in_link_[2]; // of a prismatic joint between C and D
    Complex coefficient_[kMostRoots + 1];
    Complex root_[kMostRoots];
    int roots_;                       // that are not at 0 or infinity
    double noise_;                    // of each coefficient
};

}  // namespace pinproof
