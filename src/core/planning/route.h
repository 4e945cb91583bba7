// The route of the tcp in space: straight segments between poses, with optionally rounded corners.
//
// On every piece, with a local parameter u from 0 to 1, the pose is
//
//     position     c - a(u) t + b(u) t'
//     orientation  C exp(-a(u) w) exp(b(u) w')
//
// where (c, C) is a pose, (t, w) the direction of the incoming segment and (t', w') that of the outgoing one, each a
// translation in the base frame and a rotation vector in the tcp frame. On a segment, a = 0 and b is linear.
#pragma once

#include <array>
#include <vector>

#include "geometry/vectors.h"

namespace pinproof {

struct RouteDirection {
    Vec3 translation, rotation;
};

struct RoutePiece {
    static constexpr std::size_t kCoefficients = 6;

    Transform pose;
    RouteDirection into, out;
    std::array<double, kCoefficients> a, b;  // in the Bernstein basis
    double start, end;                       // parameters of the route
    // The sizes of the derivatives by the parameter of the route are at most these:
    double acceleration;       // of the position
    double turn, turn_change;  // of the angular velocity, and of its derivative

    Transform at(double u) const;
};

struct Route {
    std::vector<RoutePiece> pieces;  // at least one; they follow one another

    const RoutePiece& piece_at(double s) const;
    Transform pose(double s) const;
};

}  // namespace pinproof
