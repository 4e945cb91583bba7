// The proof that a whole curve is free of collisions: intervals in path order, bisected until every pair is decided.
//
// In each interval, the distance of every pair at the middle is compared with an upper bound of the approach of the
// pair within the interval (motion_bounds.h). Pairs that are proven apart are dropped; the others are passed to both
// halves. A contact at a middle ends the search to its right; the search to its left continues until everything before
// the contact is proven or the tolerance is reached.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "certificate/motion_bounds.h"
#include "collision/near.h"
#include "collision/world.h"
#include "geometry/curve.h"

namespace pinproof {

struct ProofSettings {
    double tolerance = 1e-4;            // m; an interval in which bodies move less is not bisected further
    std::int64_t max_intervals = 2000;  // after which the rest of the curve is undecided
    double obstacle_tolerance = 0.0;    // m; allowed displacement of obstacles, included in the margins of their pairs
    double goal_share = 0.0;            // a pair is dropped once this share of the smallest clearance found is proven
    std::int64_t look_ahead = 0;        // intervals to check for a contact after an undecided span
    bool wants_tubes = false;           // compute the clearance, and by how much joints and obstacles could deviate
    bool record = false;                // store the evidence of each pair in each interval
};

// What is proven of one pair in one interval.
struct Evidence {
    double start, end;
    int pair;
    double distance;  // m
    Vec3 direction;   // in the root frame; zeros: by balls and boxes
};

struct FoundContact {
    double time;
    int pair;
    std::vector<double> q;
};

struct OpenSpan {
    double start, end;
    int pair;         // the least proven one
    double distance;  // m; infinity if it was not measured
};

// The smallest values that are proven over some pairs and intervals.
struct ProvenLimits {
    static constexpr double kInfinity = std::numeric_limits<double>::infinity();

    double proven = kInfinity;         // the smallest proven distance (m)
    double joint_tube = kInfinity;     // by how much each joint could deviate with the proof still valid (rad or m)
    double obstacle_tube = kInfinity;  // the same for obstacles (m)

    void include(const ProvenLimits& other) {
        proven = std::min(proven, other.proven);
        joint_tube = std::min(joint_tube, other.joint_tube);
        obstacle_tube = std::min(obstacle_tube, other.obstacle_tube);
    }
};

struct ProofState : ProvenLimits {
    std::int64_t intervals = 0;
    double observed = kInfinity;       // the smallest distance (m) found
    double spare = kInfinity;          // the smallest difference (m) of distance and margin found
    std::optional<FoundContact> contact;
    std::optional<OpenSpan> open;  // the first undecided span
    std::vector<Evidence> evidence;

    bool free() const { return !contact && !open; }
};

// Proofs in one world, one after the other. No proof depends on an earlier one.
class CurveProof {
public:
    explicit CurveProof(const World& world);

    // Prove a curve, or find a contact. The distances in `known` are those that the caller found before, such as at the
    // ends of the curve and of the pairs that no joint moves.
    ProofState run(const CurveView& curve, const ProofSettings& settings, const double* joint_tolerance,
                   const ProofState& known = {});

private:
    // A part of the curve that is to be proven, and its pairs.
    struct Interval {
        double start, end;
        std::size_t first_piece, end_piece;  // more than one piece, or a part of a single one
        std::size_t list;                    // the beginning of its pairs in lists_
        std::size_t pairs;                   // their number
        bool all_pairs;                      // instead of a list
    };
    // The middle of an interval, about which it is judged.
    struct Middle {
        double time;
        std::size_t piece;  // at which several pieces are divided
    };
    // What an earlier interval of this proof found out about a pair.
    struct PairMemory {
        Separation separation;
        double distance = std::numeric_limits<double>::infinity();
    };
    // What is proven of a body and all obstacles in a node, or of a pair.
    struct FarNode {
        int body, row;        // of the tree of obstacles
        double gap, certain;  // m; at the middle and in the interval
        double growth, growth_range;
    };
    // Bounds (m) of the distance of two bodies whose parts are bounded one by one, and of the approach to the part of
    // the lower bound; the tolerance of joints that all parts allow.
    struct PartBounds {
        double upper, lower, approach, tube;

        // Add a part that is beyond its margin by `slack`, and whose approach grows as stated up to a range.
        void add(double distance, const Approach& of_part, double range, double slack);
    };
    class Parts;
    // Sums over the pairs of one interval.
    struct Summary;

    bool is_single_piece(const Interval& interval) const { return interval.end_piece - interval.first_piece == 1; }
    double* part(std::size_t depth) { return parts_.data() + depth * curve_.points * curve_.dof; }
    double goal(double margin) const;
    double clear(int pair, const Summary& sum) const;
    PairMemory& memory_of(int pair);

    Middle place_middle(const Interval& interval, const double* part);
    void list_pairs(Interval& interval);
    void judge_pairs(const Interval& interval, Summary& sum);
    void judge(int pair, const Interval& interval, Summary& sum);
    bool is_wide(const Interval& interval) const;
    void find_contact(Summary& sum);
    void note_distance(int pair, double distance, Summary& sum);
    FarNode bound_node(int body, int row, double level, bool single) const;
    bool is_clear(const FarNode& far, double clear, double margin, bool with_obstacle, const Summary& sum) const;
    bool tighten(const Pair& pair, const Vec3& direction, Approach& approach) const;
    PartBounds bound_cells(int pair, const Transform& a_from_b, const Approach& rough,
                           const DistanceQuery& query) const;
    bool is_due_to_tolerances(const Pair& pair, double lower, const Approach& rough, double goal) const;
    bool is_clearly_apart(int pair, const Approach& rough, const Summary& sum) const;
    bool is_bisected(const Summary& sum) const;
    bool decide(const Interval& interval, const Summary& sum);
    void bisect(const Interval& interval, const Middle& middle, const Summary& sum);
    void push(const Interval& interval, const double* part);

    const World& world_;
    CurveView curve_{};
    ProofSettings settings_;
    const double* joint_tolerance_ = nullptr;
    ProofState state_;
    std::int64_t last_interval_ = 0;  // until which a contact is searched for after an undecided span

    Placement bodies_;
    MotionBounds bounds_;
    std::vector<double> middle_, delta_;
    std::vector<Interval> stack_;
    std::vector<double> parts_;   // (depth, points, dof) the control points of the intervals on the stack
    std::vector<double> part_;    // of the interval in work
    std::vector<double> halves_;  // (2, points, dof) of its halves
    std::vector<FarNode> far_;    // what the list of an interval leaves out
    std::vector<int> lists_;      // the pairs of all intervals on the stack
    std::vector<PairMemory> memory_;
    std::vector<int> memory_of_pair_;  // the index of each pair in memory_; -1: none
};

}  // namespace pinproof
