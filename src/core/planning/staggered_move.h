// Motions from rest to rest in which every joint chooses when it moves.
//
// The duration of a motion to a goal is at least that of its slowest joint. The other joints have time to spare: they
// may begin late, end early, move slowly, or move away and return. Each choice is another path with the same duration,
// so that a search over these choices finds motions around obstacles that are as fast as motions without obstacles.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "planning/edge_checker.h"
#include "timing/profile.h"
#include "timing/timed_path.h"

namespace pinproof {

// The move of one joint from rest to rest, slowed down by `stretch`.
struct RestMove {
    double from = 0.0, sign = 1.0;
    std::shared_ptr<const Profile> profile;  // over the distance; none if the joint does not move
    double begin = 0.0, stretch = 1.0;

    double end() const { return profile ? begin + stretch * profile->duration() : begin; }
    Instant at(double time) const;
};

// One or two moves of each joint.
struct StaggeredMove {
    std::size_t goal = 0;
    double duration = 0.0;
    std::vector<std::vector<RestMove>> joints;

    Instant at(std::size_t joint, double time) const;
    // The times at which a phase of a joint begins or ends.
    std::vector<double> phase_ends() const;
};

class StaggeredSearch {
public:
    // From `start` (dof) to `goals` (count, dof). Motions are sampled at most `sample_time` (s) apart.
    StaggeredSearch(EdgeChecker& edges, std::span<const double> start, std::span<const double> goals,
                    std::span<const double> lower, std::span<const double> upper, RateLimits rates,
                    double sample_time);

    // The fastest of the motions that the draws describe, shorter than `below` (s) and free at samples. `draws` are
    // draws_per_motion() numbers in [0, 1) for each motion.
    std::optional<StaggeredMove> run(double below, std::span<const double> draws);

    std::size_t draws_per_motion() const { return 2 + kDrawsPerJoint * start_.size(); }
    std::size_t tried() const { return tried_; }

private:
    static constexpr std::size_t kDrawsPerJoint = 6;

    // A duration in which a goal is to be reached.
    struct Aim {
        std::size_t goal;
        double duration;
    };

    std::shared_ptr<const Profile> profile(std::size_t joint, double distance) const;
    const std::vector<std::shared_ptr<const Profile>>& profiles_to(std::size_t goal);
    std::vector<Aim> aims(double below);
    StaggeredMove described(const Aim& aim, const double* draws);
    std::vector<RestMove> direct(const Aim& aim, std::size_t joint, const double* draws, double kind);
    std::optional<std::vector<RestMove>> detour(const Aim& aim, std::size_t joint, const double* draws) const;
    StaggeredMove shortened(StaggeredMove move, const double* draws);
    double least_duration(std::size_t goal);
    bool is_free(const StaggeredMove& move);
    void place(const StaggeredMove& move, double time, double* q) const;

    EdgeChecker& edges_;
    std::vector<double> start_, goals_, lower_, upper_;
    RateLimits rates_;
    double sample_time_;
    std::vector<std::vector<std::shared_ptr<const Profile>>> profiles_;  // by goal and joint
    std::vector<double> points_;
    double latest_contact_ = 0.5;  // share of the duration at which the latest motion that is not free was in contact
    std::size_t tried_ = 0;
};

}  // namespace pinproof
