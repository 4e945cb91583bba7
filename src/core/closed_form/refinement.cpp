#include "closed_form/refinement.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "algebra/least_squares.h"
#include "kinematics/joint_range.h"

namespace pinproof {
namespace {

constexpr int kMostSteps = 60;

// Added to J J^T. Near a singular target the singular direction has no residual, and the others are not affected.
constexpr double kSmallestDamping = 1e-13, kLargestDamping = 1e-4;

// Factors of the damping after a step that increased the error, or decreased it.
constexpr double kGrowth = 8.0, kRelief = 0.25;

// The residual (m and rad) is converged; or too small for further steps with more damping.
constexpr double kConverged = 1e-14, kRoundingLevel = 1e-11;

// At most this many consecutive steps may reduce the squared residual by less than this factor: there is no solution.
constexpr double kSlow = 0.5;
constexpr int kPatience = 3;

constexpr double kLongestStep = 0.3;  // rad or m

constexpr double kShift = 1e-12;   // added to J^T J, so that it is invertible if it is singular
constexpr int kInverseRounds = 3;  // of the inverse iteration

constexpr double kInfinity = std::numeric_limits<double>::infinity();

bool contains(unsigned set, int index) { return set >> index & 1u; }

}  // namespace

Refinement::Refinement(const ArmPlan& plan) : plan_(plan), posture_(plan.chain), jacobian_(plan.dof()) {}

double Refinement::Residual::angle() const { return std::atan2(sine, cosine); }

Refinement::Residual Refinement::residual_at(const double* q) {
    posture_.evaluate(plan_.chain, target_from_base_, q);
    const Frame& tcp = posture_.tcp();
    // The rotation vector for small angles: half of the vector of R - R^T.
    const Double4 turn = {0.5 * (tcp.y[2] - tcp.z[1]), 0.5 * (tcp.z[0] - tcp.x[2]), 0.5 * (tcp.x[1] - tcp.y[0]), 0.0};
    return {{tcp.origin, turn},
            std::sqrt(dot(tcp.origin, tcp.origin)),
            std::sqrt(dot(turn, turn)),
            0.5 * (tcp.x[0] + tcp.y[1] + tcp.z[2] - 1.0)};
}

void Refinement::iterate(unsigned held, double* q, double* best, Refined& result) {
    const int n = static_cast<int>(plan_.dof());
    // The deviation of an exact arm with a triple is rounding: one or two steps remove it, or none does.
    const int patience = plan_.deviates() || !plan_.cuts.empty() ? kPatience : 0;
    double least = kInfinity, growth = 1.0;
    int slow_steps = 0;
    Twist best_residual;
    Symmetric6 square;
    Factor6 factor;
    for (int step = 0; step < kMostSteps; ++step) {
        const Residual residual = residual_at(q);
        if (residual.cosine < 0.0) return;
        const double left = residual.squared();
        if (left < least) {
            slow_steps = left > kSlow * least ? slow_steps + 1 : 0;
            least = left;
            result.distance = residual.distance;
            result.angle = residual.angle();
            growth = std::max(growth * kRelief, 1.0);
            std::copy(q, q + n, best);
            if (left < kConverged * kConverged || slow_steps > patience) return;
            best_residual = residual.twist;
            posture_.jacobian(plan_.chain, jacobian_);
            for (int j = 0; j < n; ++j)
                if (contains(held, j)) jacobian_[j] = {};
            square = gram(jacobian_);
        } else {
            if (!(least >= kRoundingLevel * kRoundingLevel) || patience == 0) return;
            growth *= kGrowth;
        }
        if (!factor.factorise(square, growth * std::clamp(least, kSmallestDamping, kLargestDamping))) return;
        const Twist weights = factor.solve(best_residual);
        double move[kMostJoints], longest = 0.0;
        for (int j = 0; j < n; ++j) {
            move[j] = dot(jacobian_[j], weights);
            longest = std::max(longest, std::abs(move[j]));
        }
        const double share = longest > 0.0 ? std::min(1.0, kLongestStep / longest) : 1.0;
        for (int j = 0; j < n; ++j) q[j] = best[j] - share * move[j];
    }
}

Refined Refinement::refine(const Transform& target, const double* reference, double at_limit, unsigned held, double* q) {
    const int n = static_cast<int>(plan_.dof());
    const unsigned locked = plan_.locked_in_q();
    target_from_base_ = frame_of(inverse(target));
    held |= locked;

    Refined result{kInfinity, kInfinity, kInfinity};
    double best[kMostJoints];
    std::copy(q, q + n, best);
    bool clipped = false;
    for (int attempt = 0; attempt < 2; ++attempt) {
        iterate(held, q, best, result);
        result.outside = 0.0;
        clipped = false;
        bool retry = false;
        for (const PlannedJoint& joint : plan_.joints) {
            if (joint.is_virtual()) continue;
            const int j = joint.index;
            const double value = joint.prismatic || contains(locked, j)
                                     ? best[j]
                                     : nearest_winding(best[j], joint.lower, joint.upper, kLimitSlack, reference[j]);
            const double inside = std::min(std::max(value, joint.lower), joint.upper);
            const double beyond = std::abs(value - inside);
            if (beyond > kLimitSlack) {
                result.outside = std::max(result.outside, beyond);
                if (attempt == 0 && !contains(held, j) && beyond <= at_limit) {
                    held |= 1u << j;
                    retry = true;
                }
            }
            clipped = clipped || inside != value;
            q[j] = inside;
        }
        if (!retry || result.outside > at_limit) break;
    }
    if (clipped) {
        const Residual residual = residual_at(q);
        result.distance = residual.distance;
        result.angle = residual.angle();
    }
    return result;
}

double Refinement::weakest_motion(const double* q, double* motion) {
    const int n = static_cast<int>(plan_.dof());
    const unsigned locked = plan_.locked_in_q();
    if (n - static_cast<int>(plan_.locked.size()) != 6) return kInfinity;
    posture_.evaluate(plan_.chain, Frame{}, q);
    posture_.jacobian(plan_.chain, jacobian_);
    int moving[6], count = 0;
    for (int j = 0; j < n; ++j)
        if (!contains(locked, j)) moving[count++] = j;
    Symmetric6 square;
    for (int i = 0; i < 6; ++i)
        for (int j = 0; j <= i; ++j) square.m[i][j] = dot(jacobian_[moving[i]], jacobian_[moving[j]]);
    Factor6 factor;
    if (!factor.factorise(square, kShift)) return kInfinity;
    Twist v{{1.0, 0.9, 0.8, 0.0}, {0.7, 0.6, 0.5, 0.0}};  // six numbers, one for each moving joint
    double size = 1.0;
    for (int round = 0; round < kInverseRounds; ++round) {
        v = factor.solve(v);
        size = std::sqrt(squared_norm(v));
        v = (1.0 / size) * v;
    }
    std::fill(motion, motion + n, 0.0);
    for (int i = 0; i < 6; ++i) motion[moving[i]] = i < 3 ? v.linear[i] : v.angular[i - 3];
    return 1.0 / std::sqrt(size);
}

}  // namespace pinproof
