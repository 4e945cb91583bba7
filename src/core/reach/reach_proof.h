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

// The proof for one chain, with its working memory; one for each thread.
class ReachProver {
  public:
    // The limits must be finite; the range of a revolute joint is at most a full rotation.
    ReachProver(const Chain& chain, const LoopDistances& loop, const double* lower, const double* upper);

    // `base_from_tcp` must be rigid.
    ReachProof prove(const Transform& base_from_tcp, const ReachSettings& settings);

    // For tests: whether every box on the path of the search to a solution q (n,) keeps it, for as many boxes as the
    // budget permits. A sound search never excludes a solution.
    bool keeps(const Transform& base_from_tcp, const double* q, const ReachSettings& settings);

  private:
    struct JointValue {
        double middle, half_width;
        double cosine, sine;  // of the middle
        double inwards, radius;  // the arc about the middle: its ball has `inwards` and `radius` times the arc's radius
    };
    struct Range {
        double lower, upper;
    };
    struct ArcBalls;

    void set_joint(int joint);
    Ball up(int joint, const Ball& ball) const;
    Ball rotated_back(int joint, const Ball& ball) const;
    Ball down(int joint, const Ball& ball) const;
    Ball through_target(const Transform& pose, const Vec3& tcp, const Ball& ball) const;
    void evaluate(const Arc& arc, double error, ArcBalls& balls) const;
    Range distance(const Arc& arc, const ArcBalls& balls) const;
    bool contract(const LoopConstraint& constraint, int number);
    bool project(int joint, const Ball& before, const Ball& after, const Range& distance, int number);
    bool narrow(int joint, double lower, double upper, int number);
    bool propagate(bool first);
    Ball carried(const Overlap& overlap, bool through_target) const;
    bool overlaps_everywhere();
    void start(const Transform& base_from_tcp, const ReachSettings& settings);
    void open(const JointBox& box, int divided);
    double place_to_split(int joint) const;
    int joint_to_split() const;

    const Chain& chain_;
    const LoopDistances& loop_;
    int n_;
    double rounding_;  // m: allowance for rounding in distances
    JointBox limits_;
    std::vector<Transform> up_;  // the inverse of `before` of each joint

    Transform base_from_last_, last_from_base_, target_;
    ReachSettings settings_;
    ReachProof* proof_ = nullptr;

    JointBox box_;
    JointValue value_[kMostProofJoints];
    std::int64_t changed_[kMostProofJoints];  // the number of the evaluation that changed the joint last
    std::vector<std::int64_t> evaluated_;     // the last evaluation of each constraint
    std::int64_t clock_ = 0;                  // the number of the present evaluation
    double influence_[kMostProofJoints];
    struct Gap {
        double width = 0.0, middle = 0.0;
    };
    Gap gap_[kMostProofJoints];

    std::vector<Transform> box_from_link_;  // of each overlap
    std::vector<int> overlap_order_;        // the overlap that excluded a box last comes first
    double overlap_share_ = 0.0;      // the best quotient of a depth at the middle of the box and the depth required
    double overlap_effect_[kMostProofJoints];  // the part of each joint in the motion of its ball
};

}  // namespace pinproof
