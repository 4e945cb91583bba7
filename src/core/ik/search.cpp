#include "ik/search.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace pinproof {
namespace {

// The distance of a seed that has been tried.
constexpr float kUsed = 1e30f;

// Values of q0 beyond a limit by less than this (rad or m) are set to the limit; rounding by adding 2 pi, by converting
// from degrees and in files with 10 digits is smaller.
constexpr double kAtLimit = 1e-9;

double mirrored(const JointRange& range, double value) {
    return range.finite() ? range.lower + range.upper - value : -value;
}

std::size_t index_of_smallest(const std::vector<float>& distances) {
    return static_cast<std::size_t>(std::min_element(distances.begin(), distances.end()) - distances.begin());
}

}  // namespace

Seeds::Seeds(const Chain& chain, const double* configurations, std::size_t count)
    : dof_(chain.dof), configurations_(configurations, configurations + count * chain.dof) {
    for (auto& entries : poses_) entries.resize(count);
    Posture posture(chain);
    Vec3 total, total_of_squares;
    for (std::size_t k = 0; k < count; ++k) {
        posture.evaluate(chain, Frame{}, configuration(k));
        const Transform pose = transform_of(posture.tcp());
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) poses_[4 * i + j][k] = static_cast<float>(pose.rotation.m[i][j]);
            poses_[4 * i + 3][k] = static_cast<float>(pose.translation[i]);
        }
        const Vec3& p = pose.translation;
        total += p;
        total_of_squares += Vec3{p.x * p.x, p.y * p.y, p.z * p.z};
    }
    const Vec3 mean = (1.0 / static_cast<double>(count)) * total;
    const double squares = total_of_squares.x + total_of_squares.y + total_of_squares.z;
    spin_weight_ = kSpinWeight * (squares / static_cast<double>(count) - squared_norm(mean));
}

Seeds::Weights Seeds::weights(const Task& task) const {
    if (task.positions == 0) return {0.0, 1.0};
    return {1.0, task.angles == 3 ? spin_weight_ : 0.0};
}

void Seeds::measure(const Task& task, const Transform& base_from_target, std::vector<float>& out) const {
    const Weights weight = weights(task);
    const float distance = static_cast<float>(weight.distance), spin = static_cast<float>(weight.spin);
    float r[3][3], p[3];
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) r[i][j] = static_cast<float>(base_from_target.rotation.m[i][j]);
        p[i] = static_cast<float>(base_from_target.translation[i]);
    }
    const float* e[12];
    for (int i = 0; i < 12; ++i) e[i] = poses_[i].data();
    out.resize(size());
    float* __restrict__ to = out.data();
    for (std::size_t k = 0; k < out.size(); ++k) {
        const float dx = e[3][k] - p[0], dy = e[7][k] - p[1], dz = e[11][k] - p[2];
        const float trace = e[0][k] * r[0][0] + e[1][k] * r[0][1] + e[2][k] * r[0][2] + e[4][k] * r[1][0] +
                            e[5][k] * r[1][1] + e[6][k] * r[1][2] + e[8][k] * r[2][0] + e[9][k] * r[2][1] +
                            e[10][k] * r[2][2];
        to[k] = distance * (dx * dx + dy * dy + dz * dz) - spin * trace;
    }
}

Search::Search(const IkSolver& solver, const Seeds& seeds, const Goal& goal)
    : solver_(solver), seeds_(seeds), goal_(goal), descent_(solver), flipped_(solver.chain.dof) {}

void Search::begin(const Transform& base_from_target, const double* q0) {
    target_ = base_from_target;
    target_from_base_ = frame_of(inverse(base_from_target));
    q0_.assign(q0, q0 + solver_.chain.dof);
    q_.resize(q0_.size());
    for (std::size_t i = 0; i < q0_.size(); ++i) {
        const JointRange& range = solver_.ranges[i];
        if (const double clipped = range.clipped(q0_[i]); std::abs(q0_[i] - clipped) < kAtLimit) q0_[i] = clipped;
        q_[i] = range.clipped(range.nearest_winding(q0_[i], q0_[i]));
    }
    if (goal_.kind == Goal::Kind::near) goal_.posture = q_;
    found_.iterations = found_.attempts = 0;
}

const Candidate& Search::next(long long count, bool polish) {
    double nearest = std::numeric_limits<double>::infinity();
    while (found_.attempts < count) {
        if (found_.attempts == 1) flip_or_seed();
        if (found_.attempts > 1) take_seed();
        const Descent::Result result = descent_.run(target_from_base_, goal_, solver_.stall, q_);
        ++found_.attempts;
        found_.iterations += result.iterations;
        if (result.reached) return conclude();
        if (result.squared_residual < nearest) {
            nearest = result.squared_residual;
            best_ = q_;
        }
    }
    if (nearest < std::numeric_limits<double>::infinity()) q_ = best_;
    if (polish) found_.iterations += descent_.run(target_from_base_, goal_, kPolish, q_).iterations;
    return conclude();
}

// The closest of the flips of q and of the seeds; a joint without a range is mirrored about zero.
void Search::flip_or_seed() {
    seeds_.measure(solver_.task, target_, distances_);
    const Seeds::Weights weight = seeds_.weights(solver_.task);
    double least = distances_[index_of_smallest(distances_)];
    std::size_t best = q_.size();
    flipped_ = q_;
    for (std::size_t i = 0; i < q_.size(); ++i) {
        flipped_[i] = mirrored(solver_.ranges[i], q_[i]);
        const Frame& tcp = descent_.look(target_from_base_, flipped_.data());
        flipped_[i] = q_[i];
        const double trace = tcp.x[0] + tcp.y[1] + tcp.z[2];
        const double distance = weight.distance * dot(tcp.origin, tcp.origin) - weight.spin * trace;
        if (distance < least) {
            least = distance;
            best = i;
        }
    }
    if (best == q_.size())
        take_seed();
    else
        q_[best] = mirrored(solver_.ranges[best], q_[best]);
}

// The closest seed that has not been tried.
void Search::take_seed() {
    const std::size_t best = index_of_smallest(distances_);
    distances_[best] = kUsed;
    std::copy_n(seeds_.configuration(best), q_.size(), q_.begin());
}

// The result, shifted by 2 pi to be closest to q0, with its errors.
const Candidate& Search::conclude() {
    found_.q.resize(q_.size());
    found_.fulfils = true;
    for (std::size_t i = 0; i < q_.size(); ++i) {
        found_.q[i] = solver_.ranges[i].nearest_winding(q_[i], q0_[i]);
        found_.fulfils = found_.fulfils && solver_.ranges[i].contains(found_.q[i]);
    }
    found_.error = measure(solver_.task, target_, forward_kinematics(solver_.chain, found_.q.data()));
    found_.fulfils = found_.fulfils && fulfils(solver_.task, found_.error);
    return found_;
}

}  // namespace pinproof
