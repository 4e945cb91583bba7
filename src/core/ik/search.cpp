#include "ik/search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "collision/near.h"
#include "geometry/rotations.h"

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

// The smallest of each of 16 interleaved parts in one loop that is vectorised, then the index of the smallest of all.
std::size_t index_of_smallest(const std::vector<float>& distances) {
    constexpr std::size_t parts = 16;
    float smallest[parts];
    std::fill(smallest, smallest + parts, std::numeric_limits<float>::infinity());
    for (std::size_t first = 0; first + parts <= distances.size(); first += parts)
        for (std::size_t i = 0; i < parts; ++i)
            smallest[i] = distances[first + i] < smallest[i] ? distances[first + i] : smallest[i];
    float least = *std::min_element(smallest, smallest + parts);
    for (std::size_t i = distances.size() / parts * parts; i < distances.size(); ++i)
        least = std::min(least, distances[i]);
    const auto found = std::find(distances.begin(), distances.end(), least);
    return found == distances.end() ? 0 : static_cast<std::size_t>(found - distances.begin());
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
        const Vec3& p = pose.translation;
        const Quaternion r = quaternion_of(pose.rotation);
        const double entries[] = {p.x, p.y, p.z, r.x, r.y, r.z, r.w};
        for (int i = 0; i < 7; ++i) poses_[i][k] = static_cast<float>(entries[i]);
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
    const Vec3& t = base_from_target.translation;
    const Quaternion r = quaternion_of(base_from_target.rotation);
    const float distance = static_cast<float>(weight.distance), spin = static_cast<float>(weight.spin);
    const float x = static_cast<float>(t.x), y = static_cast<float>(t.y), z = static_cast<float>(t.z);
    const float a = static_cast<float>(r.x), b = static_cast<float>(r.y), c = static_cast<float>(r.z),
                d = static_cast<float>(r.w);
    const float *xs = poses_[0].data(), *ys = poses_[1].data(), *zs = poses_[2].data();
    const float *as = poses_[3].data(), *bs = poses_[4].data(), *cs = poses_[5].data(), *ds = poses_[6].data();
    out.resize(size());
    float* __restrict__ to = out.data();
    for (std::size_t k = 0; k < out.size(); ++k) {
        const float dx = xs[k] - x, dy = ys[k] - y, dz = zs[k] - z;
        const float cosine = as[k] * a + bs[k] * b + cs[k] * c + ds[k] * d;  // of half the angle between them
        to[k] = distance * (dx * dx + dy * dy + dz * dz) - spin * (4.0f * cosine * cosine - 1.0f);
    }
}

Search::Search(const IkSolver& solver, const Seeds& seeds, const Goal& goal)
    : solver_(solver), seeds_(seeds), goal_(goal) {}

void Search::begin(const Transform& base_from_target, const double* q0) {
    target_ = base_from_target;
    target_from_base_ = inverse(base_from_target);
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

void Search::look_for_next(long long count, bool polish) {
    state_ = State::attempts;
    count_ = count;
    polish_ = polish;
    nearest_ = std::numeric_limits<double>::infinity();
}

bool Search::prepare() {
    if (state_ == State::attempts && found_.attempts < count_) {
        if (found_.attempts == 1) flip_or_seed();
        if (found_.attempts > 1) take_seed();
        stall_ = solver_.stall;
        return true;
    }
    if (state_ != State::attempts) return false;
    if (nearest_ < std::numeric_limits<double>::infinity()) q_ = best_;
    state_ = polish_ ? State::polish : State::finished;
    stall_ = kPolish;
    return polish_;
}

void Search::finish(const Progress& progress) {
    found_.iterations += progress.iterations;
    if (state_ == State::polish) {
        state_ = State::finished;
        return;
    }
    ++found_.attempts;
    if (progress.reached) {
        state_ = State::finished;
    } else if (progress.squared_residual < nearest_) {
        nearest_ = progress.squared_residual;
        best_ = q_;
    }
}

// The closest of the flips of q and of the seeds; a joint without a range is mirrored about zero.
void Search::flip_or_seed() {
    if (!posture_) posture_.emplace(solver_.chain);
    seeds_.measure(solver_.task, target_, distances_);
    const Seeds::Weights weight = seeds_.weights(solver_.task);
    const Frame start = frame_of(target_from_base_);
    double least = distances_[index_of_smallest(distances_)];
    std::size_t best = q_.size();
    flipped_ = q_;
    for (std::size_t i = 0; i < q_.size(); ++i) {
        flipped_[i] = mirrored(solver_.ranges[i], q_[i]);
        posture_->evaluate(solver_.chain, start, flipped_.data());
        flipped_[i] = q_[i];
        const Frame& tcp = posture_->tcp();
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

SearchEngine::SearchEngine(const IkSolver& solver) {
    if (std::holds_alternative<ClikStep>(solver.rule))
        descents_.emplace<ClikLanes>(solver);
    else
        descents_.emplace<Descent>(solver);
}

const Candidate& SearchEngine::make_attempts(Search& search) {
    while (search.prepare()) {
        if (ClikLanes* lanes = std::get_if<ClikLanes>(&descents_)) {
            lanes->start(0, search.target_from_base(), search.goal(), search.stall(), search.q());
            while (!lanes->ended(0)) lanes->advance();
            search.finish(lanes->take(0, search.q()));
        } else {
            Descent& descent = std::get<Descent>(descents_);
            search.finish(descent.run(frame_of(search.target_from_base()), search.goal(), search.stall(), search.q()));
        }
    }
    return search.conclude();
}

template <class Begin, class Proceed>
void SearchEngine::solve_rows(std::vector<Search>& searches, Rows& rows, Begin begin, Proceed proceed) {
    ClikLanes* lanes = std::get_if<ClikLanes>(&descents_);
    if (!lanes) {
        for (std::size_t row; rows.take(row);) {
            begin(searches[0], row);
            while (proceed(searches[0], make_attempts(searches[0]), row)) {
            }
        }
        return;
    }
    // Each lane works on a row of its own, and takes the next one when it has finished.
    std::array<std::size_t, kLanes> row_of;
    const auto take_row = [&](int lane) {
        if (!rows.take(row_of[lane])) return false;
        begin(searches[lane], row_of[lane]);
        return true;
    };
    // Start the next attempt in a lane, if necessary for the next row; returns whether there is one.
    const auto start_attempt = [&](int lane) {
        Search& search = searches[lane];
        while (!search.prepare())
            if (!proceed(search, search.conclude(), row_of[lane]) && !take_row(lane)) return false;
        lanes->start(lane, search.target_from_base(), search.goal(), search.stall(), search.q());
        return true;
    };
    int busy = 0;
    for (int lane = 0; lane < kLanes; ++lane) busy += take_row(lane) && start_attempt(lane);
    while (busy > 0) {
        lanes->advance();
        for (int lane = 0; lane < kLanes; ++lane) {
            if (!lanes->ended(lane)) continue;
            searches[lane].finish(lanes->take(lane, searches[lane].q()));
            busy -= !start_attempt(lane);
        }
    }
}

void solve_batch(const IkSolver& solver, const Seeds& seeds, const Goal& goal, const double* targets, const double* q0,
                 std::size_t rows, long long count, const std::shared_ptr<const World>& world, std::size_t threads,
                 const BatchResults& out) {
    const std::size_t n = solver.chain.dof;
    const auto begin = [&](Search& search, std::size_t row) {
        out.refusals[row] = 0;
        search.begin(read_transform(targets + 16 * row), q0 + n * row);
        search.look_for_next(count, true);
    };
    const auto record = [&](const Candidate& found, bool is_free, std::size_t row) {
        const bool accepted = found.fulfils && is_free;
        // If no solution is accepted, the result is the first that was refused, otherwise the last candidate.
        if (accepted || out.refusals[row] == 0) {
            std::copy(found.q.begin(), found.q.end(), out.q + n * row);
            out.position_error[row] = found.error.position;
            out.orientation_error[row] = found.error.orientation;
        }
        out.fulfils[row] = accepted;
        out.iterations[row] = found.iterations;
        out.attempts[row] = found.attempts;
        out.refusals[row] += found.fulfils && !is_free;
    };
    share_rows(rows, threads, [&] {
        std::optional<Workspace> bodies;
        if (world) bodies.emplace(world);
        return [&, engine = SearchEngine(solver), searches = std::vector<Search>(kLanes, Search(solver, seeds, goal)),
                bodies = std::move(bodies)](Rows& all) mutable {
            engine.solve_rows(searches, all, begin, [&](Search& search, const Candidate& found, std::size_t row) {
                const bool is_free =
                    !bodies || !found.fulfils || (bodies->place_at(found.q.data()) && !bodies->any_contact());
                record(found, is_free, row);
                if (out.fulfils[row] || found.attempts >= count) return false;
                search.look_for_next(count, out.refusals[row] == 0);
                return true;
            });
        };
    });
}

}  // namespace pinproof
