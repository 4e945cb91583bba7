// Starts and restarts of descents for any number of targets; the same search as in pinproof.ik.loop.
//
// The first attempt starts at the caller's configuration. Each other attempt starts at the configuration closest in
// pose to the target that has not been tried: once among the seeds and the flips of the first result (one joint
// mirrored about the middle of its range: the other elbow or wrist), then among the seeds alone. A Newton-like descent
// that starts close to its target usually converges to it.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "ik/descent.h"

namespace pinproof {

// A low-discrepancy set of configurations within the limits, with their poses.
class Seeds {
  public:
    // The rows of `configurations` (count, n).
    Seeds(const Chain& chain, const double* configurations, std::size_t count);

    // Weight of the rotation in the distance between poses, in units of the variance (m^2) of the positions.
    static constexpr double kSpinWeight = 0.4;

    struct Weights {
        double distance, spin;
    };
    // The weights of the squared distance and of the trace of the rotation for a task.
    Weights weights(const Task& task) const;

    // The distance in pose of each seed from a target, into `out` (count,). Only comparisons of distances have a
    // meaning.
    void measure(const Task& task, const Transform& base_from_target, std::vector<float>& out) const;

    std::size_t size() const { return poses_[0].size(); }
    std::size_t dof() const { return dof_; }
    const double* configuration(std::size_t i) const { return configurations_.data() + i * dof_; }

  private:
    std::size_t dof_;
    std::vector<double> configurations_;
    std::array<std::vector<float>, 7> poses_;  // x, y, z and the quaternion (x, y, z, w)
    double spin_weight_;
};

// The result of a series of attempts.
struct Candidate {
    std::vector<double> q;  // a solution, or the configuration with the smallest residual
    PoseError error;
    bool fulfils;                    // the task within the limits, by forward kinematics after the loop
    long long iterations = 0, attempts = 0;  // for this target
};

// The attempts for one target after another. Solver and seeds must exist as long as the search.
class Search {
  public:
    // The number of seeds must not be zero.
    Search(const IkSolver& solver, const Seeds& seeds, const Goal& goal);

    // The best failed attempt is continued until its squared residual decreases by less than 1e-6 of it in 20 steps.
    static constexpr Stall kPolish{1.0 - 1e-6, 20};

    // Begin with a target and q0 (n,), within or outside the limits.
    void begin(const Transform& base_from_target, const double* q0);

    // Make attempts until one satisfies the task, or until there are `count` for this target; then, if `polish`, refine
    // the best of this call. The result is overwritten by the next call.
    const Candidate& next(long long count, bool polish);

  private:
    void flip_or_seed();
    void take_seed();
    const Candidate& conclude();

    const IkSolver& solver_;
    const Seeds& seeds_;
    Goal goal_;
    Descent descent_;
    Transform target_;  // base_from_target
    Frame target_from_base_;
    std::vector<double> q0_, q_, best_, flipped_;
    std::vector<float> distances_;  // of the seeds from the target
    Candidate found_;
};

}  // namespace pinproof
