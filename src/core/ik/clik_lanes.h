// Descents of Clik for up to four targets at once, one in each lane of a vector register.
//
// The steps of one descent depend on each other through long chains of operations: sines and cosines, the product of
// the joint transforms, the factors of a 6 x 6 matrix. A processor core is mostly idle during such a chain, and four
// descents in lanes take hardly longer than one. The result of a lane does not depend on the others, so that a single
// target, which uses one lane, has the same result as in a batch.
#pragma once

#include <optional>
#include <vector>

#include "geometry/lanes.h"
#include "ik/ik_solver.h"
#include "ik/task.h"
#include "kinematics/chain.h"

namespace pinproof {

class ClikLanes {
  public:
    // The solver, whose rule is a ClikStep, must exist as long as the lanes.
    explicit ClikLanes(const IkSolver& solver);

    // Start a descent from q (n,) in an idle lane. The goal must exist until it has ended.
    void start(int lane, const Transform& target_from_base, const Goal& goal, const Stall& stall,
               const std::vector<double>& q);

    // Advance each descent by one step.
    void advance();

    bool ended(int lane) const { return descents_[lane].state == State::ended; }

    // The result of a descent that has ended: the best q (n,), and its progress. The lane becomes idle.
    Progress take(int lane, std::vector<double>& q);

  private:
    enum class State { idle, running, ended };

    struct LaneDescent {
        State state = State::idle;
        Progress progress;
        Stall stall = {};
        const Goal* goal = nullptr;
        bool here = false;  // the task is satisfied at the current q
    };

    // Residuals, twists or columns of Jacobians.
    struct LaneTwist {
        LaneVec3 linear, angular;

        friend LaneTwist operator+(const LaneTwist& a, const LaneTwist& b) {
            return {a.linear + b.linear, a.angular + b.angular};
        }
        friend LaneTwist operator*(Lanes s, const LaneTwist& a) { return {s * a.linear, s * a.angular}; }
        friend Lanes dot(const LaneTwist& a, const LaneTwist& b) {
            return dot(a.linear, b.linear) + dot(a.angular, b.angular);
        }
    };
    class Factor;

    void evaluate();
    void compute_residual();
    LaneVec3 rotation_vectors() const;
    void observe();
    void compute_jacobian();
    void apply_task();
    void compute_goal_steps();
    void bounded_step();
    void rule_step(Lanes damping, const LaneTwist& pull);
    void move();

    const IkSolver& solver_;
    const double damping_;
    LaneDescent descents_[kLanes];
    LaneMask running_ = {};  // the lanes whose descent takes a step
    LaneFrame start_;        // target_from_base
    std::vector<Lanes> q_, best_;
    std::vector<double> values_, sines_, cosines_;  // of the joints: kLanes numbers for each
    struct Axis {
        LaneVec3 origin, direction;
    };
    std::vector<Axis> axes_;
    LaneFrame tcp_;  // target_from_tcp
    LaneTwist residual_;
    Lanes squared_ = {};
    std::vector<LaneTwist> jacobian_;
    std::vector<Lanes> step_, fixed_;
    std::vector<LaneMask> held_;
    std::optional<GoalSteps> goal_steps_;  // made for the first goal
};

}  // namespace pinproof
