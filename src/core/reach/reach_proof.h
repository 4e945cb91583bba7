// Distances in the loop of an arm and its target: the constraints of the proof that a pose is out of reach.
//
// The arm and the target close a loop: link 0 (the base), joints 1 to n, and link n, which the target G = base_from_tcp
// ties to the base. A point on the axis of joint k is fixed on links k-1 and k; a point where consecutive axes meet is
// fixed on all links between. For two such points P and Q the distance |PQ| is a function of the joints on either arc
// of the loop between them, and both values must agree. For one point, the arc that leads around the loop back to it
// has length 0. These are the closure equations in distances of Porta, Ros, Thomas, Torras (2005), "A branch-and-prune
// solver for distance constraints", IEEE Transactions on Robotics 21(2).
#pragma once

#include <cstdint>
#include <vector>

#include "geometry/vectors.h"
#include "kinematics/chain.h"

namespace pinproof {

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

// Branch and prune over the joint ranges: a proof that no configuration within the limits reaches a pose.

// The most joints of a chain; boxes have a fixed size.
inline constexpr int kMostProofJoints = 12;

// A box of joint values.
struct JointBox {
    double lower[kMostProofJoints], upper[kMostProofJoints];
};

// A test of a collision: a ball inside a body on one link, and a box with rounded edges inside a body on another link.
// Configurations at which they overlap are in collision. Link k is behind joint k; link 0 is the base.
struct Overlap {
    int ball_link;
    Vec3 centre;  // of the ball, on its link
    double ball_radius;
    int box_link;
    Transform link_from_box;
    Vec3 half;          // half sides of the box; zeros: a ball
    double box_radius;  // of the ball that is added to the box
};

// A step of the proof. The steps are the nodes of a tree of boxes in the order of a depth-first search: each divides or
// excludes the present box. The numbers of overlaps follow those of the constraints.
struct ReachStep {
    enum Kind : std::int32_t {
        kSplit,      // at `value` of `joint`; the lower half comes next, then the upper one
        kCutLower,   // the part with the joint below `value` violates the constraint; the rest remains
        kCutUpper,   // the same above `value`
        kExcluded,   // the whole box violates the constraint
    };
    Kind kind;
    std::int32_t joint, constraint;
    double value;
    // The evaluation of the constraint: several cuts may follow from one, for the box as it was before the first.
    std::int64_t evaluation = -1;
};

enum class ReachOutcome { kExcluded, kUndecided };

struct ReachSettings {
    double position_tolerance, orientation_tolerance;  // m, rad
    std::int64_t budget;                               // largest number of boxes
    bool record;                                       // whether the steps are recorded
    std::vector<Overlap> overlaps = {};                // configurations with one of these are excluded too
};

struct ReachProof {
    ReachOutcome outcome = ReachOutcome::kUndecided;
    std::int64_t boxes = 0;         // that were examined
    std::vector<ReachStep> steps;
    std::vector<char> used;         // whether each overlap excluded a box
    std::vector<double> remaining;  // undecided: the middle of the box that could not be excluded (n,)
    double width = 0.0;             // undecided: its largest width
};

// A chain whose poses are proven out of reach: its limits are finite, and the range of a revolute joint is at most a full
// rotation.
struct ReachArm {
    Chain chain;
    JointBox limits;
    LoopDistances loop;
};

// `base_from_tcp` must be rigid.
ReachProof prove_out_of_reach(const ReachArm& arm, const Transform& base_from_tcp, const ReachSettings& settings);

// For tests: whether every box on the path of the search to a solution q (n,) keeps it, for as many boxes as the budget
// permits. A sound search never excludes a solution.
bool search_keeps(const ReachArm& arm, const Transform& base_from_tcp, const double* q, const ReachSettings& settings);

}  // namespace pinproof
