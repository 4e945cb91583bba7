// Tracking of a sequence of poses, cycle by cycle; each joint moves by at most what its speed limit allows.
//
// Each cycle minimises the squared residual |r|^2 in the box of all configurations that position and speed limits
// allow, by Gauss-Newton steps in that box. The box keeps the motion regular near a singularity: the tcp deviates in
// the singular direction, and returns as soon as the speeds suffice.
//
// If several solutions meet at a singularity, the choice is as follows:
//
// * A cycle starts at the extrapolated motion (kFading of it), if that is closer to the target than the current
//   configuration. A path through a singular configuration therefore continues smoothly, although one direction of
//   motion is singular. If the extrapolation does not lead to the target, the cycle is repeated from the current
//   configuration.
// * An arm that deviates and thereby crosses a singularity returns to its side where that is equally good: at the
//   boundary of the workspace, where elbow up and elbow down meet, both are. The elbow is therefore the same when the
//   target returns. The side is the sign of the determinant of the Jacobian; without a determinant (a redundant arm, or
//   task), the side is not guaranteed.
// * At rest at a saddle, where the gradient is zero although the target is not reached (it moves in a singular
//   direction), the arm tries a motion that does not change the residual at first order, in both senses, and uses it if
//   the tcp comes closer to the target.
#pragma once

#include <vector>

#include "ik/box_descent.h"
#include "ik/task.h"
#include "kinematics/chain.h"
#include "kinematics/joint_range.h"

namespace pinproof {

// The problem of a tracker.
struct TrackingTask {
    Chain chain;
    std::vector<double> lower, upper, speed;  // (n,) of the joints; the speed in rad/s or m/s
    Task task;
    Goal goal;  // its gain is per second
};

class Tracker {
  public:
    // The tracking task must exist as long as the tracker. q0 (n,) is within the limits.
    Tracker(const TrackingTask& tracking, std::vector<double> q0);

    // Track one pose in a cycle of this duration in seconds.
    void step(const Transform& base_from_target, double duration);

    const std::vector<double>& q() const { return q_; }

    // The side of a singularity: the sign of the determinant of the Jacobian.
    enum class Side { unknown, positive, negative, undefined };

    // All that a cycle leaves for the next one.
    struct State {
        std::vector<double> q, rate;
        Side side;
    };
    State state() const { return {q_, rate_, side_}; }
    void resume(const State& state);

  private:
    static Side opposite(Side side);

    double cycle();
    void move_for_goal(double duration);
    double leave_saddle(double squared);
    Side side_at(const std::vector<double>& q);
    double return_to_side(double squared);
    bool bend_to_side(double& squared);
    bool restart_on_side(double& squared);
    void lost_direction(const std::vector<double>& q);

    const TrackingTask& tracking_;
    BoxDescent descent_;
    std::vector<double> q_;      // the configuration; during a cycle, the current solution
    std::vector<double> began_;  // the configuration at the start of the cycle
    std::vector<double> rate_;   // of the last cycle, without the motion of the goal
    Side side_ = Side::unknown;  // to which a deviating arm belongs
    Goal goal_;                  // with the gain of a cycle
    GoalSteps goal_steps_;
    std::vector<double> best_, motion_, trial_;
    std::vector<double> determinant_;  // (n, n)
};

}  // namespace pinproof
