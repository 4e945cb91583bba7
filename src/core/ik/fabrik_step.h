// The step of FABRIK: one pass over the links from the target to the base, and one back (docs/mathematics.md, "FABRIK").
//
// All quantities are in the axes of the target, with the arm at q. Link k is between hinge k - 1 and hinge k; the last
// one carries the tcp. A pass computes the motion of each link, a rigid transform.
//
// * Backward: M of the last link brings the tcp to the target. Each previous link follows its hinge with the next one,
//   M_below = M_above X with X about (or along) that hinge, chosen such that M_below is close to the identity.
// * Forward: N of the base is the identity; N_above = N_below X, with X chosen such that N_above is close to M_above.
//
// The distance of two motions is measured with a weight at two points of the link's other hinge, kHingeHalfLength to
// both sides of its origin, and at the end of the remaining arm (the tcp, or the base), moved as one rigid body.
//
// Measured success rates for positions (to 1e-4 m, from the middle of the limits, seven arms): 0 to 76 % with hinges
// only; 78 to 95 % with the tcp in the forward passes; 97 to 99.9 % with alternating passes of two kinds and unequal
// lengths; 99.5 to 100 % with the bending of arms in deadlock.
#pragma once

#include <vector>

#include "geometry/vectors.h"
#include "ik/step_rules.h"
#include "ik/task.h"
#include "kinematics/chain.h"
#include "kinematics/joint_range.h"

namespace pinproof {

struct Hinge {
    Vec3 origin, direction;
    bool prismatic = false;
};

struct FabrikStep {
    ClikStep end;             // near the target
    double squared_handover;  // the squared residual below which the step of Clik is used; 0: never

    // m, from the origin of a hinge to the two points that represent its direction: the weight of a radian.
    static constexpr double kHingeHalfLength = 0.17;

    // Weight of the hinges relative to the tcp, in passes that preserve the shape of the arm (for a position, and with
    // an orientation) and in passes that reach for the target. The passes alternate, because each kind stalls in
    // different cases. All constants were chosen by experiments on seven arms.
    static constexpr double kHold = 0.03, kHoldPosed = 1.0, kReach = 0.001;

    // The fraction of a pass that is applied. Passes of one kind converge slowly along a valley; unequal lengths avoid
    // that.
    static constexpr double kRelaxHold = 0.8, kRelaxReach = 1.6;

    // The weight of the base in backward passes.
    static constexpr double kBase = 0.1;

    // For a position, the last link is moved to the target and rotated by this fraction of the angle that would point
    // it at the previous position of its hinge. With 1 this is the original FABRIK; with 0 the orientation of the tcp
    // is kept.
    static constexpr double kAim = 0.3;

    // If the residual has not decreased enough for this number of passes, the arm is in deadlock: at a limit, or
    // straight. Each joint is then moved by this fraction of its range (at most of 2 pi) towards the middle of the
    // range; if that is not sufficient, by twice as much, and so on.
    static constexpr int kWait = 30;
    static constexpr double kBend = 0.2;

    // rad or m: a pass that moves no joint by more is a deadlock.
    static constexpr double kStill = 1e-9;

    // m^2; a hinge whose sums are smaller is not rotated, because the angle is undetermined.
    static constexpr double kTiny = 1e-12;
};

// The passes of one arm, which has no mimic joints.
class FabrikPasses {
  public:
    explicit FabrikPasses(std::size_t count) : hinges_(count), moved_(count + 1) {}

    // The step from q (n,), within the limits. The posture is that of q, from the target. `waited` is the number of
    // steps since the last sufficient decrease of the residual.
    void step(const Chain& chain, const std::vector<JointRange>& ranges, const Task& task, const Posture& posture,
              const double* q, int iteration, int waited, std::vector<double>& out);

  private:
    struct Pass;
    Transform last_link(const Task& task) const;
    void backward(const Pass& pass);
    void forward(const Pass& pass, std::vector<double>& out);

    std::vector<Hinge> hinges_;
    Transform tcp_;
    std::vector<Transform> moved_;  // the motion of each link, from the base to the last one
};

}  // namespace pinproof
