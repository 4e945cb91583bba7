// Newton's method on the loop of six joints.
#pragma once

#include "geometry/vectors.h"

namespace pinproof {

// A line about which a joint rotates, or along which it moves; lengths relative to the size of the arm.
struct LoopLine {
    Vec3 direction, point;
    bool prismatic = false;
};

Transform motion_of(const LoopLine& line, double value);

struct PolishedLoop {
    double residual;  // lengths of the arm and rad
    double weakest;   // the smallest pivot of the Jacobian at the solution: 0 where it is singular
};

// Move q to the solution of E_0(q_0) ... E_5(q_5) = g that is closest to it.
PolishedLoop polish_loop(const LoopLine (&lines)[6], const Transform& g, double (&q)[6]);

}  // namespace pinproof
