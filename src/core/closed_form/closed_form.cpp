#include "closed_form/closed_form.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <numbers>

#include "geometry/sincos.h"
#include "kinematics/joint_range.h"

namespace pinproof {
namespace {

constexpr double kRigid = 1e-6;         // as spatial.RIGID_TOLERANCE
constexpr double kOrthonormal = 1e-14;  // deviation of R R^T from I that is rounding

constexpr double kGoodEnough = 1e-10;  // m or rad: a branch with a larger error is refined on the true chain

// Rad or m. A branch of an arm that deviates from the ideal is not refined if it is further outside; else kAtLimit.
constexpr double kNearLimits = 0.5;

// Rad or m. Branches that differ by less in every joint are the same, separated by rounding of a double root.
constexpr double kSameBranch = 1e-6;

// Of the smallest singular value of the Jacobian, relative to the arm's size and the square root of the spread: below,
// the deviation from the ideal may have moved two branches far apart, or removed one of them.
constexpr double kNearlySingular = 0.5;

// Rad, or lengths of the arm. The largest error of a joint, due to the tolerances, with which completeness is claimed.
constexpr double kUndetermined = 1.0;

// As above (m), for arms that are solved by elimination; and the number of cuts whose starts are refined.
constexpr double kSingularStart = 0.02;
constexpr int kMostStartCuts = 2, kMostCuts = 4;

// Lengths of the arm and rad: changes of the target that separate multiple eigenvalues.
constexpr double kBeside[] = {1e-5, 1e-3};

constexpr double kAstray = 0.05;  // m: a branch with a larger error after refinement is not close to any solution

// Rad or m along the weakest motion. Newton's method converges to the closest solution; these starts are a few times
// further apart.
constexpr double kTwinOffsets[] = {0.004, -0.004, 0.02, -0.02, 0.08, -0.08, 0.25, -0.25, 0.6, -0.6};

// Whether no number is larger than the bound, and none is NaN.
bool all_within(std::initializer_list<double> numbers, double bound) {
    return std::all_of(numbers.begin(), numbers.end(), [bound](double x) { return std::abs(x) <= bound; });
}

Line line_of(const PlannedJoint& joint) { return {joint.direction, joint.point, joint.prismatic, 0.0}; }

// The motion of a joint from zero to a value, with lengths relative to the size of the arm.
Transform motion_of(const PlannedJoint& joint, double value, double size) {
    return motion_of(LoopLine{joint.direction, joint.point, joint.prismatic}, joint.prismatic ? value / size : value);
}

// The motions of the first locked joints for their values, from those of none of them to those of all.
struct LockedMotions {
    Transform of_first[kMostLocked + 1];

    LockedMotions(const ArmPlan& plan, const std::vector<PlannedJoint>& joints, const double* values) {
        for (std::size_t i = 0; i < plan.locked.size(); ++i)
            of_first[i + 1] = of_first[i] * motion_of(joints[plan.locked[i]], values[i], plan.size);
    }
};

// Whether joint k is the next of the locked ones, of which `passed` come before it; then it is passed.
bool pass_locked(const ArmPlan& plan, int k, std::size_t& passed) {
    if (passed == plan.locked.size() || plan.locked[passed] != k) return false;
    ++passed;
    return true;
}

// The true lines of the six joints that are not locked, the joint of each, and the motion of the locked ones.
Transform true_lines(const ArmPlan& plan, const double* locked_values, LoopLine (&lines)[6], int (&source)[6]) {
    const LockedMotions motions(plan, plan.true_joints, locked_values);
    std::size_t passed = 0;
    for (int k = 0, row = 0; k < static_cast<int>(plan.true_joints.size()); ++k) {
        if (pass_locked(plan, k, passed)) continue;
        const PlannedJoint& joint = plan.true_joints[k];
        const Transform& moved = motions.of_first[passed];
        source[row] = k;
        lines[row++] = passed > 0 ? LoopLine{moved.rotation * joint.direction, moved * joint.point, joint.prismatic}
                                  : LoopLine{joint.direction, joint.point, joint.prismatic};
    }
    return motions.of_first[passed];
}

// Uniform numbers in [-1, 1) (Knuth's MMIX generator), the same on every computer.
class Uniform {
  public:
    double operator()() {
        state_ = 6364136223846793005u * state_ + 1442695040888963407u;
        return static_cast<double>(state_ >> 11) * 0x1p-52 - 1.0;
    }

  private:
    std::uint64_t state_ = 1;
};

constexpr int kTrials = 24;

}  // namespace

void prepare_cuts(ArmPlan& plan) {
    std::vector<LoopTrial> trials(kTrials);
    Uniform uniform;
    for (LoopTrial& trial : trials) {
        double values[kMostLocked];
        for (std::size_t i = 0; i < plan.locked.size(); ++i)
            values[i] = uniform() * (plan.true_joints[plan.locked[i]].prismatic ? plan.size : std::numbers::pi);
        int source[6];
        true_lines(plan, values, trial.lines, source);
        for (double& one : trial.q) one = uniform() * std::numbers::pi;
    }
    plan.cuts = choose_cuts(trials);
}

std::optional<Transform> rigid_transform(const double* matrix) {
    Vec3 row[3];
    for (int i = 0; i < 3; ++i) row[i] = {matrix[4 * i], matrix[4 * i + 1], matrix[4 * i + 2]};
    const Vec3 translation{matrix[3], matrix[7], matrix[11]};
    // Newton's iteration for the polar factor: each step squares the error.
    for (int step = 0; step < 3; ++step) {
        const double g00 = dot(row[0], row[0]), g11 = dot(row[1], row[1]), g22 = dot(row[2], row[2]);
        const double g01 = dot(row[0], row[1]), g02 = dot(row[0], row[2]), g12 = dot(row[1], row[2]);
        const auto deviation = {g00 - 1.0, g11 - 1.0, g22 - 1.0, g01, g02, g12};
        if (step == 0) {
            const bool right_handed = dot(row[0], cross(row[1], row[2])) > 0.0;
            if (!right_handed || !all_within(deviation, kRigid) ||
                !all_within({matrix[12], matrix[13], matrix[14], matrix[15] - 1.0}, kRigid) ||
                !std::isfinite(std::abs(translation.x) + std::abs(translation.y) + std::abs(translation.z)))
                return std::nullopt;
        }
        if (all_within(deviation, kOrthonormal)) break;
        const double h0 = 1.5 - 0.5 * g00, h1 = 1.5 - 0.5 * g11, h2 = 1.5 - 0.5 * g22;
        const Vec3 old[3] = {row[0], row[1], row[2]};
        row[0] = h0 * old[0] - (0.5 * g01) * old[1] - (0.5 * g02) * old[2];
        row[1] = h1 * old[1] - (0.5 * g01) * old[0] - (0.5 * g12) * old[2];
        row[2] = h2 * old[2] - (0.5 * g02) * old[0] - (0.5 * g12) * old[1];
    }
    Transform pose;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) pose.rotation.m[i][j] = row[i][j];
    pose.translation = translation;
    return pose;
}

// The six lines of the loop for the present target: the triple, then a, b, c; those before the triple are transformed by
// G^-1. Locked joints move the part of the chain after them.
void ClosedFormSolver::close_loop() {
    const LockedMotions motions(plan_, plan_.joints, locked_values_);
    Transform target = target_;
    target.translation = (1.0 / plan_.size) * target.translation;
    loop_.rest = target * inverse(motions.of_first[plan_.locked.size()] * plan_.tool);
    joints_ = &plan_.joints;
    deviates_ = plan_.deviates();
    loop_.planar = plan_.planar;
    loop_.reversed = plan_.reversed;
    const Transform rest_inverse = inverse(loop_.rest);

    int six = 0;
    std::size_t passed = 0;
    for (int k = 0; k < static_cast<int>(plan_.joints.size()); ++k) {
        if (pass_locked(plan_, k, passed)) continue;
        const PlannedJoint& joint = plan_.joints[k];
        Line line = line_of(joint);
        const Transform& moved = motions.of_first[passed];
        if (passed > 0) line = {moved.rotation * line.direction, moved * line.point, line.prismatic, 0.0};
        const int in_triple = six - plan_.first_of_triple;
        if (in_triple == plan_.normal) {
            loop_.normal = line.direction;
            loop_.point = line.point;
        }
        int row = (in_triple + 6) % 6;
        if (in_triple < 0) {
            line.direction = rest_inverse.rotation * line.direction;
            line.point = rest_inverse * line.point;
        } else if (plan_.reversed && row < 3) {
            row = 2 - row;
            line.direction = -line.direction;
        }
        if (!joint.is_virtual()) line.reference = reference_[joint.index] / (joint.prismatic ? plan_.size : 1.0);
        loop_.line[row] = line;
        source_[row] = k;
        ++six;
    }
    loop_.moved_point = rest_inverse * loop_.point;
    loop_.moved_normal = rest_inverse.rotation * loop_.normal;
    loop_.perpendicular = unit_perpendicular(loop_.probed().direction);
}

bool ClosedFormSolver::solve(const double* target, const double* reference, const double* locked_values, Branches& out) {
    const std::optional<Transform> rigid = rigid_transform(target);
    if (!rigid) return false;
    target_ = *rigid;
    reference_ = reference;
    locked_values_ = locked_values;
    tolerances_ = {plan_.border, plan_.spread, {plan_.rounding, plan_.equation_tolerance}};
    freed_ = with_free_ = with_branch_ = 0;
    outer_undecided_ = false;
    solutions_.undecided = solutions_.doubtful = false;
    out.count = out.failed = out.outside = 0;
    out.free_joints = out.unresolved = 0;
    out.by_quartic = out.doubtful = false;
    if (!plan_.cuts.empty() && solve_generally(out)) return true;
    if (!plan_.has_triple()) {
        out.doubtful = true;
        return true;
    }

    close_loop();
    solve_loop(false, false, out);
    if (outer_undecided_ || solutions_.undecided) {
        // If rounding does not decide whether joints are free, also with them free; these solutions count only if
        // forward kinematics confirms them. Families come first: other solutions may be members of them.
        if (plan_.cuts.empty()) out.count = 0;
        if (outer_undecided_) solve_loop(true, true, out);
        if (solutions_.undecided) solve_loop(false, true, out);
        if (outer_undecided_ && solutions_.undecided) solve_loop(true, false, out);
        solve_loop(false, false, out);
    }
    out.doubtful |= plan_.deviates();
    out.free_joints = indices_of(freed_);
    out.unresolved = with_free_ & ~with_branch_;
    return true;
}

// The indices in q of a set of lines.
unsigned ClosedFormSolver::indices_of(unsigned lines) const {
    unsigned indices = 0;
    for (int row = 0; lines >> row; ++row)
        if (lines >> row & 1u && !plan_.joints[source_[row]].is_virtual())
            indices |= 1u << plan_.joints[source_[row]].index;
    return indices;
}

// Solve with joints that depend on an uncertain vector free, outside the triple or in it, and consider all solutions.
void ClosedFormSolver::solve_loop(bool outer_free, bool triple_free, Branches& out) {
    const OuterSolutions outer = solve_outer_joints(loop_, tolerances_, outer_free);
    outer_undecided_ |= outer.undecided;
    out.by_quartic |= outer.by_quartic;
    solutions_.count = 0;
    solutions_.doubtful = outer.doubtful;
    for (int i = 0; i < outer.count; ++i) {
        const OuterSolution& one = outer.solution[i];
        freed_ |= one.free;
        const int before = solutions_.count;
        solve_triple(loop_, tolerances_, one, triple_free, solutions_);
        if (solutions_.count == before && one.free)
            for (int root = 0; root < 2; ++root)
                with_free_ |= SolutionNumber{2 * one.root + root, one.assumed != 0, false}.bit();
    }
    out.doubtful |= solutions_.doubtful;

    const bool free_case = outer_free || triple_free;
    consider_all(out);
    if (!free_case) out.failed = failed_here_;
    out.outside = std::max(out.outside, outside_here_);
}

// Consider all of solutions_.
void ClosedFormSolver::consider_all(Branches& out) {
    failed_here_ = outside_here_ = 0;
    for (int first = 0; first < solutions_.count; first += kWideLanes) {
        const int count = std::min(kWideLanes, solutions_.count - first);
        to_values(first, count);
        const LaneErrors errors = check_lanes(plan_.chain, target_, configurations_);
        for (int lane = 0; lane < count; ++lane) consider(first + lane, lane, errors, out);
    }
}

// Solve the true lines by elimination. Returns whether all configurations are found; otherwise `out` contains some.
//
// A further cut of the loop is solved if one does not account for all eigenvalues, and, as a second proof, if there is no
// branch. If no cut does, configurations may share the value of joint 3: targets beside the given one separate them.
bool ClosedFormSolver::solve_generally(Branches& out) {
    joints_ = &plan_.true_joints;
    deviates_ = false;
    LoopLine lines[6];
    const Transform after_locked = true_lines(plan_, locked_values_, lines, source_);
    Transform target = target_;
    target.translation = (1.0 / plan_.size) * target.translation;
    const Transform rest = target * inverse(after_locked * plan_.tool);
    LoopRoots roots;
    int existing[kMostCuts], solved = 0;
    // The number of cuts that prove the roots to be all.
    const auto proofs = [&] {
        return std::count_if(existing, existing + solved, [&](int most) { return roots.all_of(most); });
    };
    const auto proven = [&] {
        if (proofs() == 0) return false;
        consider_roots(roots, out);
        return out.count > 0 || proofs() > 1;
    };
    const int count = std::min(static_cast<int>(plan_.cuts.size()), kMostCuts);
    while (solved < count) {
        const int most = general_.solve(lines, rest, plan_.cuts[solved], roots);
        existing[solved++] = most;
        if (proven()) return out.failed == 0 && !out.doubtful;
    }
    for (const double amount : kBeside)
        for (int k = 0; k < std::min(count, kMostStartCuts); ++k) {
            general_.solve_beside(lines, rest, plan_.cuts[k], amount, roots);
            if (proven()) return out.failed == 0 && !out.doubtful;
        }
    consider_roots(roots, out);
    consider_starts(lines, rest, out);
    consider_starts(lines, beside(rest, kBeside[1]), out);
    return false;
}

// Further branches at targets where eigenvalues are not accounted for, usually because solutions nearly meet there: the
// damped method refines all starts, and their second solutions. The reference is a start as well.
void ClosedFormSolver::consider_starts(const LoopLine (&lines)[6], const Transform& rest, Branches& out) {
    Branch nearest{};
    std::copy_n(reference_, plan_.dof(), nearest.q);
    set_locked(nearest.q);
    refine_and_keep(nearest, out);
    int cuts = 0;
    for (const Cut& cut : plan_.cuts) {
        const EliminationResult& found = general_.starts(lines, rest, cut);
        for (int i = 0; i < found.count; ++i) {
            Branch branch;
            set_locked(branch.q);
            for (int row = 0; row < 6; ++row) {
                const PlannedJoint& joint = plan_.true_joints[source_[row]];
                if (!joint.is_virtual()) branch.q[joint.index] = found.start[i][row] * (joint.prismatic ? plan_.size : 1.0);
            }
            branch.free_joints = 0u;
            branch.number = {};
            if (refine_and_keep(branch, out) && plan_.locked.empty()) consider_twins(branch, kSingularStart, out);
        }
        if (++cuts == kMostStartCuts) break;
    }
}

// Set the locked joints of a configuration to their values.
void ClosedFormSolver::set_locked(double* q) const {
    for (std::size_t i = 0; i < plan_.locked.size(); ++i) q[plan_.joints[plan_.locked[i]].index] = locked_values_[i];
}

// The branches among the configurations of the loop.
void ClosedFormSolver::consider_roots(const LoopRoots& roots, Branches& out) {
    solutions_.count = roots.count;
    const double tolerance = std::max(plan_.position_tolerance / plan_.size, plan_.orientation_tolerance);
    for (int i = 0; i < roots.count; ++i) {
        const LoopRoot& root = roots.root[i];
        LoopSolution& solution = solutions_.solution[i];
        solution = {};
        for (int row = 0; row < 6; ++row) {
            if (plan_.true_joints[source_[row]].prismatic) {
                solution.state[row] = prismatic_state(root.q[row]);
                continue;
            }
            const auto [sine, cosine] = sincos(root.q[row]);
            solution.state[row] = {cosine, sine};
        }
        solution.number.root = i;
        solution.error = tolerance / std::max(root.weakest, tolerance);
    }
    out.count = 0;
    consider_all(out);
    out.failed = failed_here_;
    out.outside = outside_here_;
}

// The values of all joints for some solutions, one in each lane.
void ClosedFormSolver::to_values(int first, int count) {
    for (int b = 0; b < kWideLanes; ++b) {
        outside_[b] = 0.0;
        at_zero_[b] = b < count;
    }
    for (int row = 0; row < 6; ++row) {
        const PlannedJoint& joint = (*joints_)[source_[row]];
        // One lane for each solution, the rest as the last one; loops over all lanes are vectorised.
        alignas(64) double value[kWideLanes], first_of_state[kWideLanes], second_of_state[kWideLanes];
        for (int b = 0; b < kWideLanes; ++b) {
            const JointState& state = solutions_.solution[first + std::min(b, count - 1)].state[row];
            first_of_state[b] = state.first;
            second_of_state[b] = state.second;
        }
        if (joint.prismatic) {
            for (int b = 0; b < kWideLanes; ++b) value[b] = plan_.size * first_of_state[b];
        } else {
            for (int b = 0; b < kWideLanes; ++b) value[b] = angle_of(second_of_state[b], first_of_state[b]);
        }
        if (joint.is_virtual()) {
            for (int b = 0; b < count; ++b)
                at_zero_[b] &= std::abs(value[b]) <=
                               plan_.virtual_tolerance + kNear * solutions_.solution[first + b].error;
            continue;
        }
        double* const q = configurations_.q[joint.index];
        if (joint.prismatic) {
            std::copy(value, value + kWideLanes, q);
        } else {
            const double reference = reference_[joint.index];
            for (int b = 0; b < kWideLanes; ++b)
                q[b] = nearest_winding(value[b], joint.lower, joint.upper, kLimitSlack, reference);
        }
        for (int b = 0; b < kWideLanes; ++b)
            outside_[b] = std::max(outside_[b], std::max(joint.lower - q[b], q[b] - joint.upper));
    }
    for (std::size_t i = 0; i < plan_.locked.size(); ++i) {
        const PlannedJoint& joint = plan_.joints[plan_.locked[i]];
        const double value = locked_values_[i], beyond = std::max(joint.lower - value, value - joint.upper);
        for (int b = 0; b < kWideLanes; ++b) {
            configurations_.q[joint.index][b] = value;
            outside_[b] = std::max(outside_[b], beyond);
        }
    }
}

// Verify a solution, refine it where necessary, and keep it if it is a branch.
void ClosedFormSolver::consider(int index, int lane, const LaneErrors& errors, Branches& out) {
    const LoopSolution& solution = solutions_.solution[index];
    const unsigned free_joints = indices_of(solution.free), held = indices_of(solution.assumed & solution.free);
    freed_ |= solution.free;
    if (solution.free) with_free_ |= solution.number.bit();
    if (free_joints & (free_joints - 1)) out.doubtful = true;  // a family with two parameters; reported ones have one
    if (!at_zero_[lane]) return;
    // The tolerances leave a joint undetermined, although it is not free: other configurations may be solutions too.
    if (solution.error > kUndetermined && !solution.free) out.doubtful = true;

    const double at_limit = std::min(
        std::max(kAtLimit, kNear * solution.error * std::max(plan_.size, 1.0)), kNearLimits);
    double outside = outside_[lane];
    if (outside > (deviates_ ? kNearLimits : at_limit)) {
        ++outside_here_;
        return;
    }
    Branch branch;
    for (std::size_t j = 0; j < plan_.dof(); ++j) branch.q[j] = configurations_.q[j][lane];
    branch.distance = errors.distance[lane];
    branch.angle = errors.angle[lane];
    branch.free_joints = free_joints;
    branch.number = solution.number;
    if (branch.distance > kGoodEnough || branch.angle > kGoodEnough || !(outside <= 0.0)) {
        const Refined refined = refinement_.refine(target_, reference_, at_limit, held, branch.q);
        branch.distance = refined.distance;
        branch.angle = refined.angle;
        outside = refined.outside;
    }
    bool added = false;
    if (outside > 0.0) {
        // A configuration within the tolerances may satisfy the limits if this one nearly does.
        ++(outside <= at_limit ? failed_here_ : outside_here_);
    } else if (!(branch.distance <= plan_.position_tolerance && branch.angle <= plan_.orientation_tolerance)) {
        ++failed_here_;
    } else if (held == 0 || std::max(branch.distance, branch.angle) <= kGoodEnough) {
        added = keep(branch, out);
        if (free_joints) with_branch_ |= solution.number.bit();
    }
    if (deviates_ && plan_.locked.empty() && (added || outside > 0.0 || branch.distance < kAstray))
        consider_twins(branch, kNearlySingular * std::sqrt(plan_.spread) * plan_.size, out);
}

// Second solutions close to a first one, for an arm that deviates from the ideal: if two branches nearly meet, a
// deviation moves them far.
//
// Two branches of six joints meet where the Jacobian J is singular; near there both are along the joint motion v that J
// maps nearly to zero. Their distance is proportional to the square root of the deviation of the arm from one at which
// they meet: for a calibrated arm they may be far from those of the ideal arm, or only one of them may exist. Starts of
// Newton's method are therefore distributed along v. Completeness is not claimed for arms that need this.
void ClosedFormSolver::consider_twins(const Branch& near, double nearly_singular, Branches& out) {
    double motion[kMostJoints];
    if (refinement_.weakest_motion(near.q, motion) > nearly_singular) return;
    for (const double offset : kTwinOffsets) {
        Branch twin = near;
        twin.free_joints = 0;
        for (std::size_t j = 0; j < plan_.dof(); ++j) twin.q[j] = near.q[j] + offset * motion[j];
        refine_and_keep(twin, out);
    }
}

// Refine a configuration on the true chain, and keep it if it is a branch. Returns whether it was kept.
bool ClosedFormSolver::refine_and_keep(Branch& branch, Branches& out) {
    const Refined refined = refinement_.refine(target_, reference_, kAtLimit, 0u, branch.q);
    branch.distance = refined.distance;
    branch.angle = refined.angle;
    return refined.outside <= 0.0 && branch.distance <= plan_.position_tolerance &&
           branch.angle <= plan_.orientation_tolerance && keep(branch, out);
}

// Append a branch unless it is there already. Returns whether it was appended.
bool ClosedFormSolver::keep(const Branch& branch, Branches& out) {
    const int n = static_cast<int>(plan_.dof());
    for (int i = 0; i < out.count; ++i)
        if (same_configuration(branch.q, out.branch[i].q, n, kSameBranch)) return false;
    if (out.count == Branches::kMost) {
        out.doubtful = true;
        return false;
    }
    out.branch[out.count++] = branch;
    return true;
}

}  // namespace pinproof
