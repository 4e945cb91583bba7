// All configurations of an arm for a pose, in closed form or by the general elimination.
#pragma once

#include <optional>

#include "closed_form/arm_plan.h"
#include "closed_form/general_loop.h"
#include "closed_form/refinement.h"
#include "closed_form/triple.h"

namespace pinproof {

// One configuration. Every one is verified by forward kinematics of the true chain and is within the limits.
struct Branch {
    double q[kMostJoints];
    double distance, angle;  // m, rad: its error by forward kinematics
    unsigned free_joints;    // set of indices in q: free to move at this target
    SolutionNumber number;
};

// What is known of all solutions for a target.
struct BranchSummary {
    unsigned free_joints = 0;  // all joints that are free in some solution, also one without a branch
    int failed = 0;            // solutions that forward kinematics did not confirm
    int outside = 0;           // solutions outside the limits
    bool by_quartic = false;
    bool doubtful = false;    // a case was omitted, or is not supported
    unsigned unresolved = 0;  // solutions (SolutionNumber::bit) with a free joint that have no branch for its given value

    // Whether the branches are proven to be all solutions of an exact arm, and no joint is free.
    bool all_known() const { return free_joints == 0 && failed == 0 && !doubtful && unresolved == 0; }
};

struct Branches : BranchSummary {
    // Most poses have up to 8; if rounding does not decide whether a joint is free, both cases are included.
    static constexpr int kMost = 24;

    int count = 0;
    Branch branch[kMost];
};

// The solver with its working memory; one for each thread.
class ClosedFormSolver {
  public:
    explicit ClosedFormSolver(const ArmPlan& plan) : plan_(plan), refinement_(plan) {}

    // The distinct branches for a homogeneous matrix (16 numbers, row by row). Free joints keep their value in the
    // reference (n,), and revolute joints are shifted by full rotations to be closest to it. Returns false if the matrix
    // is not rigid.
    bool solve(const double* target, const double* reference, const double* locked_values, Branches& out);

  private:
    bool solve_generally(Branches& out);
    void consider_roots(const LoopRoots& roots, Branches& out);
    void consider_starts(const LoopLine (&lines)[6], const Transform& rest, Branches& out);
    void consider_all(Branches& out);
    void close_loop();
    void set_locked(double* q) const;
    void solve_loop(bool outer_free, bool triple_free, Branches& out);
    void to_values(int first, int count);
    void consider(int index, int lane, const LaneErrors& errors, Branches& out);
    void consider_twins(const Branch& near, double nearly_singular, Branches& out);
    bool refine_and_keep(Branch& branch, Branches& out);
    bool keep(const Branch& branch, Branches& out);
    unsigned indices_of(unsigned joints) const;

    const ArmPlan& plan_;
    Refinement refinement_;

    // For the present pose.
    Transform target_;
    const double* reference_ = nullptr;
    const double* locked_values_ = nullptr;
    Loop loop_;
    int source_[6];  // the joint of the plan for each line of the loop
    const std::vector<PlannedJoint>* joints_ = nullptr;  // of the plan, that source_ refers to
    bool deviates_ = false;                               // whether the lines deviate from the true ones
    LoopTolerances tolerances_;
    GeneralLoop general_;
    LoopSolutions solutions_;
    LaneConfigurations configurations_;
    double outside_[kWideLanes];  // largest violation of a limit
    bool at_zero_[kWideLanes];    // whether the virtual joints are at zero
    bool outer_undecided_ = false;
    unsigned freed_ = 0;          // lines
    unsigned with_free_ = 0, with_branch_ = 0;  // sets of solutions with a free joint
    int failed_here_ = 0, outside_here_ = 0;
};

// The closest rotation to a nearly rigid matrix; none if it is not rigid up to 1e-6.
std::optional<Transform> rigid_transform(const double* matrix);

// Choose the cuts of the loop for the general elimination; none are left if it fails for this arm.
void prepare_cuts(ArmPlan& plan);

}  // namespace pinproof
