// Starts and restarts of descents for any number of targets; the same search as in pinproof.ik.loop.
//
// The first attempt starts at the caller's configuration. Each other attempt starts at the configuration closest in
// pose to the target that has not been tried: once among the seeds and the flips of the first result (one joint
// mirrored about the middle of its range: the other elbow or wrist), then among the seeds alone. A Newton-like descent
// that starts close to its target usually converges to it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "common/threads.h"
#include "ik/clik_lanes.h"
#include "ik/descent.h"

namespace pinproof {

struct World;

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
    bool fulfils = false;                    // the task within the limits, by forward kinematics after the loop
    long long iterations = 0, attempts = 0;  // for this target
};

// The attempts for one target after another: where each starts, and what its result means. Solver and seeds must exist
// as long as the search.
class Search {
  public:
    // The number of seeds must not be zero.
    Search(const IkSolver& solver, const Seeds& seeds, const Goal& goal);

    // The best failed attempt is continued until its squared residual decreases by less than 1e-6 of it in 20 steps.
    static constexpr Stall kPolish{1.0 - 1e-6, 20};

    // Begin with a target and q0 (n,), within or outside the limits.
    void begin(const Transform& base_from_target, const double* q0);

    // Look for the next solution: make attempts until one satisfies the task, or until there are `count` for this
    // target; then, if `polish`, refine the best of this call.
    void look_for_next(long long count, bool polish);

    // Prepare the next attempt; returns whether there is one.
    bool prepare();

    // Of the attempt that has been prepared.
    const Transform& target_from_base() const { return target_from_base_; }
    const Goal& goal() const { return goal_; }
    const Stall& stall() const { return stall_; }
    std::vector<double>& q() { return q_; }  // its start, to be replaced by its result

    // Take note of the result of the attempt.
    void finish(const Progress& progress);

    // The result of the call. It is overwritten by the next one.
    const Candidate& conclude();

  private:
    void flip_or_seed();
    void take_seed();

    const IkSolver& solver_;
    const Seeds& seeds_;
    Goal goal_;
    std::optional<Posture> posture_;       // made for the first flips
    Transform target_, target_from_base_;  // base_from_target and its inverse
    std::vector<double> q0_, q_, best_, flipped_;
    std::vector<float> distances_;  // of the seeds from the target
    Candidate found_;

    // Of the current call.
    enum class State { attempts, polish, finished };
    State state_ = State::finished;
    long long count_ = 0;
    bool polish_ = false;
    double nearest_ = 0.0;  // the smallest squared residual of a failed attempt
    Stall stall_ = kPolish;
};

// Makes the attempts of searches for one solver, which must exist as long as the engine.
class SearchEngine {
  public:
    explicit SearchEngine(const IkSolver& solver);

    // The next solution of a search, see Search::look_for_next.
    const Candidate& next(Search& search, long long count, bool polish) {
        search.look_for_next(count, polish);
        return make_attempts(search);
    }

    // Take rows until there are no more. `begin(search, row)` begins the search of a row and looks for its first
    // solution; `proceed(search, candidate, row)` receives each result and looks for another one, or returns false.
    // `searches` has one search for each lane.
    template <class Begin, class Proceed>
    void solve_rows(std::vector<Search>& searches, Rows& rows, Begin begin, Proceed proceed);

  private:
    const Candidate& make_attempts(Search& search);

    std::variant<std::monostate, ClikLanes, Descent> descents_;  // ClikLanes for Clik, Descent for the other methods
};

// The results of N targets, by rows.
struct BatchResults {
    double* q;                                   // (N, n)
    double *position_error, *orientation_error;  // (N,) in m and rad
    bool* fulfils;                               // (N,) the task, and free of contact if that was required
    std::int64_t *iterations, *attempts;         // (N,)
    std::int64_t* refusals;                      // (N,) solutions in contact
};

// Solve for `rows` targets, homogeneous matrices (N, 4, 4), from q0 (N, n). With a world, which must have as many joint
// values, the search of a row continues until a solution is free of contact in it; if none is, the first solution is
// the result. A result depends neither on the number of threads nor on the other targets.
void solve_batch(const IkSolver& solver, const Seeds& seeds, const Goal& goal, const double* targets, const double* q0,
                 std::size_t rows, long long count, const std::shared_ptr<const World>& world, std::size_t threads,
                 const BatchResults& out);

}  // namespace pinproof
