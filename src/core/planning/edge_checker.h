// Checks of straight edges in joint space: by samples, which guide a search and prove nothing, and by proof.
//
// The distance between samples depends on the motion of the bodies and not of the joints: a wrist may rotate far
// between two samples. The end is checked first, then the middle, the quarters, and so on, so that contacts are found
// early.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "certificate/curve_proof.h"
#include "collision/near.h"
#include "dynamics/inverse_dynamics.h"

namespace pinproof {

inline constexpr double kUnitKnots[] = {0.0, 1.0};  // of a straight edge as a curve

// The Euclidean distance of two configurations (dof), squared.
inline double squared_distance(const double* a, const double* b, std::size_t dof) {
    double sum = 0.0;
    for (std::size_t j = 0; j < dof; ++j) sum += (b[j] - a[j]) * (b[j] - a[j]);
    return sum;
}

class EdgeChecker {
public:
    // Proofs are in `world`; samples, too, until set_steering. `resolution`: metres that bodies move between two
    // samples.
    EdgeChecker(std::shared_ptr<const World> world, double resolution);

    // Whether a world has the same numbers of joints and bodies, which samples in it require.
    bool has_bodies_of(const World& world) const;
    // Take samples in another world of these bodies, usually one with larger margins. `blocked`: its pairs that no joint moves are in
    // contact, so that no edge is free.
    void set_steering(std::shared_ptr<const World> world, bool blocked);
    double resolution() const { return resolution_; }
    void set_resolution(double resolution) { resolution_ = resolution; }
    // Only samples at which the torques that hold the arm at rest are within `limits` (dof; infinite for none) are free.
    // Proofs do not cover torques.
    void set_torque_limits(DynamicTree model, std::vector<double> limits);

    // Whether the samples after a (dof) up to and including b are free.
    bool samples_free(const double* a, const double* b);
    // Whether the points (count, dof) of a motion and the samples of the edges between them are free.
    bool points_free(std::span<const double> points);
    // Whether the edge is proven free; the proof is attempted if its samples are free.
    bool proven_free(const double* a, const double* b);
    // The same; of the samples only both ends are taken.
    bool proven_without_samples(const double* a, const double* b);
    bool curve_proven_free(const CurveView& curve);

    std::int64_t samples() const { return samples_; }
    std::size_t dof() const { return world_->space().tree.dof; }

private:
    // The torques from gravity at rest.
    struct Load {
        Load(DynamicTree model, std::vector<double> limits);
        bool is_held(const double* q);

        DynamicTree model;
        std::vector<double> limits;
        InverseDynamics<double> dynamics;  // refers to `model`
        std::vector<JointMotion<double>> motion;
        std::vector<double> of_motion, of_gravity;
    };

    bool is_sample_free(const double* q);
    bool proven_between(const double* a, const double* b);
    bool inner_samples_free(const double* a, const double* b);
    double motion(const double* a, const double* b) const;

    std::shared_ptr<const World> world_;
    CurveProof proof_;
    std::optional<Workspace> sampler_;
    std::unique_ptr<Load> load_;
    bool blocked_ = false;
    double resolution_;
    std::int64_t samples_ = 0;
    std::vector<double> q_, control_, no_tolerance_;
};

}  // namespace pinproof
