// Distances in the loop of an arm and its target: the constraints of the proof that a pose is out of reach.
//
// The arm and the target close a loop: link 0 (the base), joints 1 to n, and link n, which the target G = base_from_tcp
// ties to the base. A point on the axis of joint k is fixed on links k-1 and k; a point where consecutive axes meet is
// fixed on all links between. For two such points P and Q the distance |PQ| is a function of the joints on either arc
// of the loop between them, and both values must agree. For one point, the arc that leads around the loop back to it
// has length 0. These are the closure equations in distances of Porta, Ros, Thomas, Torras (2005), "A branch-and-prune
// solver for distance constraints", IEEE Transactions on Robotics 21(2).
#pragma once

#include <vector>

#include "geometry/vectors.h"
#include "kinematics/chain.h"

namespace pinproof {

// A set of positions: all points within `radius` of `centre`.
struct Ball {
    Vec3 centre;
    double radius = 0.0;
};

// A point that is fixed on the links `first` to `last`, up to `error` (m), with its coordinates in each of their frames.
// The frame of link k is that behind joint k; that of link 0 is the base.
struct LoopPoint {
    int first, last;
    std::vector<Vec3> at;
    double error;

    Vec3 on(int link) const { return at[link - first]; }
};

// A part of the loop: from the point `start` on a link, through joints in ascending order, to the point `end`.
struct Arc {
    Vec3 start, end;
    std::vector<int> joints;
    int joints_before_target = -1;  // the target is passed after this many of the joints; -1: not passed
};

// The distance between the ends of both arcs is equal, up to `error`.
struct LoopConstraint {
    Arc inner, outer;
    double error;
    int points[2];

    int joint_count() const { return static_cast<int>(inner.joints.size() + outer.joints.size()); }
};

// The points and constraints of a chain without mimic joints, those with the fewest joints first.
struct LoopDistances {
    std::vector<LoopPoint> points;
    std::vector<LoopConstraint> constraints;
    double size;  // m: the length of the chain
};

LoopDistances loop_distances(const Chain& chain);

}  // namespace pinproof
