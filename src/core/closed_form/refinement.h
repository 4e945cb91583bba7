// Newton's method on the true chain, for branches of an ideal arm that is close to the true one.
#pragma once

#include "closed_form/arm_plan.h"

namespace pinproof {

// Rad or m. Where two branches meet, rounding (1e-16) moves joints by its square root (1e-8), where several meet by more.
inline constexpr double kAtLimit = 1e-5;

// Rad or m. A joint that exceeds its limit by at most this, due to rounding, is moved to the limit.
inline constexpr double kLimitSlack = 1e-9;

using JointArray = double[kMostJoints];

struct Refined {
    double distance, angle;  // m, rad: the error at the refined configuration
    double outside;          // rad or m: the largest violation of a limit
};

// Working memory, reused so that nothing is allocated for a branch.
class Refinement {
  public:
    explicit Refinement(const ArmPlan& plan);

    // Refine q in place.
    //
    // Steps are J^T (J J^T + damping)^-1 times the residual in the axes of the target, as long as they reduce it. A joint
    // that exceeds a limit by less than the slack is moved to it. If it exceeds it by less than `at_limit`, the other
    // joints compensate: at a singular target rounding moves a joint by that much. The joints in the set `held` keep
    // their values.
    Refined refine(const Transform& target, const double* reference, double at_limit, unsigned held, double* q);

    // The unit joint motion (n,) that moves the tcp least at q, and the size of that motion of the tcp (m and rad), for
    // six joints, by inverse iteration on J^T J. Infinite if not exactly six joints move.
    double weakest_motion(const double* q, double* motion);

  private:
    // The tcp in the axes of the target.
    struct Residual {
        Twist twist;
        double distance, sine, cosine;

        double squared() const { return distance * distance + sine * sine; }
        double angle() const;
    };

    Residual residual_at(const double* q);
    void iterate(unsigned held, double* q, double* best, Refined& result);

    const ArmPlan& plan_;
    Frame target_from_base_;
    Posture posture_;
    Jacobian jacobian_;
};

}  // namespace pinproof
