#include "ik/clik_lanes.h"

#include <algorithm>
#include <cmath>
#include <variant>

#include "algebra/least_squares.h"
#include "geometry/rotations.h"
#include "geometry/sincos.h"

namespace pinproof {

// The factors of A A^T + shift I for A given by its columns, in each lane.
class ClikLanes::Factor {
  public:
    explicit Factor(const std::vector<LaneTwist>& columns) {
        add_products<0, 4>(columns);
        add_products<4, 6>(columns);
    }

    // Returns in which lanes all pivots are positive; in the others, nothing else may be used.
    LaneMask factorise(Lanes shift) { return factors_.factorise(square_, shift); }

    LaneTwist solve(const LaneTwist& right) const {
        Lanes x[6] = {right.linear.x,  right.linear.y,  right.linear.z,
                      right.angular.x, right.angular.y, right.angular.z};
        factors_.solve(x);
        return {{x[0], x[1], x[2]}, {x[3], x[4], x[5]}};
    }

  private:
    // The rows from `first` to `last` of A A^T, few enough that the sums stay in registers.
    template <int first, int last>
    void add_products(const std::vector<LaneTwist>& columns) {
        Lanes sums[last - first][last] = {};
        for (const LaneTwist& column : columns) {
            const Lanes a[6] = {column.linear.x,  column.linear.y,  column.linear.z,
                                column.angular.x, column.angular.y, column.angular.z};
#pragma GCC unroll 6
            for (int i = first; i < last; ++i)
#pragma GCC unroll 6
                for (int j = 0; j <= i; ++j) sums[i - first][j] += a[i] * a[j];
        }
#pragma GCC unroll 6
        for (int i = first; i < last; ++i)
#pragma GCC unroll 6
            for (int j = 0; j <= i; ++j) square_[i][j] = sums[i - first][j];
    }

    Lanes square_[6][6];
    Ldlt6<Lanes> factors_;
};

ClikLanes::ClikLanes(const IkSolver& solver)
    : solver_(solver),
      damping_(std::get<ClikStep>(solver.rule).damping),
      q_(solver.chain.dof),
      best_(solver.chain.dof),
      values_(kLanes * solver.chain.joints.size()),
      sines_(values_.size()),
      cosines_(values_.size()),
      axes_(solver.chain.joints.size()),
      jacobian_(solver.chain.dof),
      step_(solver.chain.dof),
      fixed_(solver.chain.dof),
      held_(solver.chain.dof) {
    for (int lane = 0; lane < kLanes; ++lane) start_.set(lane, Transform{});
}

void ClikLanes::start(int lane, const Transform& target_from_base, const Goal& goal, const Stall& stall,
                      const std::vector<double>& q) {
    start_.set(lane, target_from_base);
    for (std::size_t i = 0; i < q.size(); ++i) best_[i][lane] = q_[i][lane] = q[i];
    LaneDescent& descent = descents_[lane];
    descent.state = State::running;
    descent.progress = Progress{};
    descent.stall = stall;
    descent.goal = &goal;
    if (goal.exists() && !goal_steps_) goal_steps_.emplace(solver_.chain);
}

Progress ClikLanes::take(int lane, std::vector<double>& q) {
    descents_[lane].state = State::idle;
    for (std::size_t i = 0; i < q.size(); ++i) q[i] = best_[i][lane];
    return descents_[lane].progress;
}

void ClikLanes::advance() {
    evaluate();
    compute_residual();
    observe();
    compute_jacobian();
    apply_task();
    compute_goal_steps();
    bounded_step();
    move();
}

// Forward kinematics from the target, see Posture.
void ClikLanes::evaluate() {
    const Chain& chain = solver_.chain;
    for (std::size_t k = 0; k < chain.joints.size(); ++k) {
        const Joint& joint = chain.joints[k];
        store_lanes(joint.multiplier * q_[joint.index] + joint.offset, &values_[kLanes * k]);
    }
    sincos_of_each(values_.data(), sines_.data(), cosines_.data(), values_.size());
    LaneFrame frame = start_;
    for (std::size_t k = 0; k < chain.joints.size(); ++k) {
        frame = frame * chain.joints[k].before;
        axes_[k] = {frame.origin, frame.z};
        pinproof::move(frame, chain.joints[k].prismatic, load_lanes(&values_[kLanes * k]), load_lanes(&sines_[kLanes * k]),
                       load_lanes(&cosines_[kLanes * k]));
    }
    tcp_ = frame * chain.tool;
}

// See Task::residual.
void ClikLanes::compute_residual() {
    const Twist& mask = solver_.task.mask;
    const LaneVec3 rotation = rotation_vectors();
    residual_.linear = {mask.linear[0] * tcp_.origin.x, mask.linear[1] * tcp_.origin.y, mask.linear[2] * tcp_.origin.z};
    residual_.angular = {mask.angular[0] * rotation.x, mask.angular[1] * rotation.y, mask.angular[2] * rotation.z};
    squared_ = dot(residual_, residual_);
}

// See rotation_vector, to which the lanes near half a turn are left.
LaneVec3 ClikLanes::rotation_vectors() const {
    const LaneVec3 v = 0.5 * LaneVec3{tcp_.y.z - tcp_.z.y, tcp_.z.x - tcp_.x.z, tcp_.x.y - tcp_.y.x};
    const Lanes cosine = 0.5 * (tcp_.x.x + tcp_.y.y + tcp_.z.z - 1.0);
    const Lanes sine = lanes_sqrt(dot(v, v));
    Lanes angle;
    for (int lane = 0; lane < kLanes; ++lane) angle[lane] = angle_of(sine[lane], cosine[lane]);
    const Lanes factor = sine > kSmallSine ? angle / sine : all_lanes(1.0);
    LaneVec3 rotation = factor * v;
    const LaneMask half_turn = cosine < kNearHalfTurn;
    if (any(half_turn))
        for (int lane = 0; lane < kLanes; ++lane)
            if (half_turn[lane]) rotation.set(lane, rotation_vector(tcp_.rotation(lane)));
    return rotation;
}

// End the descents that have reached their target or stalled.
void ClikLanes::observe() {
    const Task& task = solver_.task;
    const Lanes position = dot(residual_.linear, residual_.linear);
    const Lanes angle = dot(residual_.angular, residual_.angular);
    const LaneMask reached = (position <= task.position_tolerance * task.position_tolerance) &
                             (angle <= task.orientation_tolerance * task.orientation_tolerance);
    for (int lane = 0; lane < kLanes; ++lane) {
        LaneDescent& descent = descents_[lane];
        descent.here = false;
        if (descent.state != State::running) continue;
        const auto [next, best] = descent.progress.observe(reached[lane] != 0, squared_[lane], descent.goal->exists(),
                                                           descent.stall, solver_.max_iterations);
        if (best)
            for (std::size_t i = 0; i < q_.size(); ++i) best_[i][lane] = q_[i][lane];
        if (next == Progress::Next::stop)
            descent.state = State::ended;
        else
            descent.here = reached[lane] != 0;
    }
    for (int lane = 0; lane < kLanes; ++lane) running_[lane] = descents_[lane].state == State::running ? -1 : 0;
}

// See Posture::jacobian.
void ClikLanes::compute_jacobian() {
    const Chain& chain = solver_.chain;
    std::fill(jacobian_.begin(), jacobian_.end(), LaneTwist{});
    for (std::size_t k = 0; k < chain.joints.size(); ++k) {
        const Joint& joint = chain.joints[k];
        LaneTwist& column = jacobian_[joint.index];
        const LaneVec3 direction = joint.multiplier * axes_[k].direction;
        if (joint.prismatic)
            column.linear = column.linear + direction;
        else
            column = column + LaneTwist{cross(direction, tcp_.origin - axes_[k].origin), direction};
    }
}

// See Task::apply.
void ClikLanes::apply_task() {
    const Task& task = solver_.task;
    if (task.positions == 3 && task.angles == 3) return;
    if (task.angles == 1 || task.angles == 2) {
        const LaneVec3 v = rotation_vectors();
        const Lanes square = dot(v, v);
        Lanes c;
        for (int lane = 0; lane < kLanes; ++lane) c[lane] = left_jacobian_coefficient(square[lane]);
        for (LaneTwist& column : jacobian_) {
            const LaneVec3 w = column.angular;
            column.angular = w - 0.5 * cross(v, w) + c * (dot(v, w) * v - square * w);
        }
    }
    for (LaneTwist& column : jacobian_) {
        column.linear = {task.mask.linear[0] * column.linear.x, task.mask.linear[1] * column.linear.y,
                         task.mask.linear[2] * column.linear.z};
        column.angular = {task.mask.angular[0] * column.angular.x, task.mask.angular[1] * column.angular.y,
                          task.mask.angular[2] * column.angular.z};
    }
}

// The steps of the goals of satisfied tasks, into the fixed part of the step.
void ClikLanes::compute_goal_steps() {
    std::fill(fixed_.begin(), fixed_.end(), Lanes{});
    if (!goal_steps_) return;
    std::vector<double> q(q_.size());
    for (int lane = 0; lane < kLanes; ++lane) {
        if (!descents_[lane].here) continue;
        for (std::size_t i = 0; i < q.size(); ++i) q[i] = q_[i][lane];
        const std::vector<double>& step = goal_steps_->at(*descents_[lane].goal, q.data());
        for (std::size_t i = 0; i < q.size(); ++i) fixed_[i][lane] = step[i];
    }
}

// The step of the rule within the limits (active set), added to the step of a goal, see Descent::bounded_step.
void ClikLanes::bounded_step() {
    const Lanes saturation = all_lanes(IkSolver::kSaturation * IkSolver::kSaturation);
    const LaneMask saturated = squared_ > saturation;
    const Lanes share = saturated ? lanes_sqrt(saturation / squared_) : all_lanes(1.0);
    LaneTwist pull = share * residual_;
    Lanes damping;
    for (int lane = 0; lane < kLanes; ++lane) damping[lane] = 0.5 * descents_[lane].progress.growth * damping_;
    damping = damping * dot(pull, pull) + ClikStep::kSmallestDamping;
    for (std::size_t i = 0; i < q_.size(); ++i) {
        held_[i] = LaneMask{};
        pull = pull + fixed_[i] * jacobian_[i];
    }
    for (LaneMask again = running_; any(again);) {
        rule_step(damping, pull);
        again = LaneMask{};
        for (std::size_t i = 0; i < q_.size(); ++i) {
            const JointRange& range = solver_.ranges[i];
            step_[i] = held_[i] ? fixed_[i] : step_[i] + fixed_[i];
            const Lanes there = q_[i] + step_[i];
            const Lanes low = all_lanes(range.stop_lower()), high = all_lanes(range.stop_upper());
            const LaneMask outside = ((there < low) | (there > high)) & ~held_[i] & running_;
            if (!any(outside)) continue;
            again |= outside;
            held_[i] |= outside;
            const Lanes moved = lanes_min(lanes_max(there, low), high) - q_[i];
            const Lanes more = outside ? moved - fixed_[i] : Lanes{};
            pull = pull + more * jacobian_[i];
            fixed_[i] = outside ? moved : fixed_[i];
            jacobian_[i] = (outside ? Lanes{} : all_lanes(1.0)) * jacobian_[i];
        }
    }
}

// The step of Clik, see ClikStep, with no joint moving by more than the longest step.
//
// It is shortened before the limits are applied: a very long step would hold joints at limits unnecessarily.
void ClikLanes::rule_step(Lanes damping, const LaneTwist& pull) {
    Factor factor(jacobian_);
    Lanes largest = {};
    for (int growths = 0; growths < ClikStep::kMostGrowths; ++growths) {
        const LaneMask exists = factor.factorise(damping);
        const LaneTwist x = factor.solve(pull);
        largest = Lanes{};
        for (std::size_t i = 0; i < step_.size(); ++i) {
            const Lanes step = -dot(jacobian_[i], x);
            step_[i] = exists ? step : step_[i];
            largest = lanes_max(largest, lanes_abs(step_[i]));
        }
        // Lanes in which the step is short enough repeat it.
        const LaneMask too_long = ~(exists & (largest <= solver_.max_step));
        if (!any(too_long & running_)) return;
        damping = too_long ? ClikStep::kGrowth * damping : damping;
    }
    const LaneMask too_long = largest > solver_.max_step;
    const Lanes share = too_long ? solver_.max_step / largest : all_lanes(1.0);
    for (Lanes& step : step_) step *= share;
}

// Apply the step, unless it ends the descent.
void ClikLanes::move() {
    Lanes largest = {};
    for (const Lanes& step : step_) largest = lanes_max(largest, lanes_abs(step));
    const Lanes share = largest > solver_.max_step ? solver_.max_step / largest : all_lanes(1.0);
    for (int lane = 0; lane < kLanes; ++lane) {
        LaneDescent& descent = descents_[lane];
        if (descent.state != State::running) continue;
        const double smallest = descent.here ? IkSolver::kGoalConverged : IkSolver::kSmallestStep;
        if (largest[lane] <= smallest)
            descent.state = State::ended;
        else
            ++descent.progress.iterations;
    }
    for (std::size_t i = 0; i < q_.size(); ++i) {
        const JointRange& range = solver_.ranges[i];
        const Lanes lower = all_lanes(range.lower), upper = all_lanes(range.upper);
        Lanes there = q_[i] + share * step_[i];
        if (range.wraps) {
            there += there > upper ? all_lanes(-kTurn) : there < lower ? all_lanes(kTurn) : Lanes{};
        }
        q_[i] = lanes_min(lanes_max(there, lower), upper);
    }
}

}  // namespace pinproof
