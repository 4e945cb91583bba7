// An arm prepared for the closed form: which three joints form the triple, its lines in ideal geometry, and the cuts of its
// loop for the general elimination.
#pragma once

#include <vector>

#include "closed_form/elimination.h"
#include "closed_form/lane_check.h"
#include "closed_form/line.h"
#include "closed_form/roots.h"
#include "kinematics/chain.h"

namespace pinproof {

inline constexpr int kMostLocked = 2;

// A joint of the ideal arm at zero, with lengths relative to the size of the arm.
struct PlannedJoint {
    Vec3 direction, point;
    bool prismatic;
    int index;  // in q; -1: a virtual joint, which must be zero
    double lower, upper;

    bool is_virtual() const { return index < 0; }
};

// The axes of the ideal arm meet or are parallel exactly. If those of the true arm do not, the solutions of the ideal
// arm are the starts of Newton's method on the true chain.
struct ArmPlan {
    Chain chain;                       // the true arm
    double size;                       // m: the length of the arm
    std::vector<PlannedJoint> joints;  // six, and the locked ones
    Transform tool;                    // of the ideal arm at zero, lengths relative to the size
    int first_of_triple;               // 0 to 3, among the six joints that are not locked; -1: no triple
    bool planar, reversed;
    int normal;  // the revolute joint of the triple whose direction is the normal: 0 to 2
    std::vector<int> locked;  // indices into joints, ascending: one of seven joints, two of eight

    double border, spread, rounding;  // see LoopTolerances
    // For the general elimination, if it is used: the joints with their true lines, in the same order.
    std::vector<PlannedJoint> true_joints;

    double position_tolerance = 0.0, orientation_tolerance = 0.0;  // m, rad: of an answer
    double virtual_tolerance = 0.0;                                // rad or m: largest value of a virtual joint
    double equation_tolerance = 0.0;                               // see LoopTolerances
    std::vector<Cut> cuts;                                         // of the loop, best first

    std::size_t dof() const { return chain.dof; }
    // The locked joints as a set of indices in q.
    unsigned locked_in_q() const {
        unsigned set = 0;
        for (const int k : locked) set |= 1u << joints[k].index;
        return set;
    }
    // Whether the true arm deviates from the ideal one, so that solutions are refined.
    bool deviates() const { return spread > 0.0; }
    bool has_triple() const { return first_of_triple >= 0; }
};

}  // namespace pinproof
