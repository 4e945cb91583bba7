// Newton's method on the loop of six revolute joints.
#pragma once

#include "geometry/vectors.h"

namespace pinproof {

// A line about which a joint rotates; lengths relative to the size of the arm.
struct RevoluteLine {
    Vec3 direction, point;
};

struct PolishedLoop {
    double residual;  // lengths of the arm and rad
    double weakest;   // the smallest pivot of the Jacobian at the solution: 0 where it is singular
};

// Move q to the solution of E_0(q_0) ... E_5(q_5) = g that is closest to it.
PolishedLoop polish_loop(const RevoluteLine (&lines)[6], const Transform& g, double (&q)[6]);

}  // namespace pinproof
