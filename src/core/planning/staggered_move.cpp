#include "planning/staggered_move.h"

#include <algorithm>
#include <cmath>

namespace pinproof {
namespace {

// Durations that are tried for each goal, as multiples of the least one.
constexpr double kLevels[] = {1.0, 1.03, 1.08, 1.16, 1.3};

// Shares of the motions in which all joints begin late, begin early, or take the whole duration.
constexpr double kAllLate = 0.08, kAllEarly = 0.12, kAllSlow = 0.16;

// Share of the motions without detours, and share of the joints that make one in the others.
constexpr double kWithoutDetour = 0.6, kDetours = 0.3;

// Largest distance (rad or m) of a detour beyond the start and the goal.
constexpr double kViaReach = 0.6;

// Number of times that the duration of a free motion is reduced towards the least one.
constexpr int kTightenings = 4;

// Largest number of samples of a motion; longer ones are sampled more coarsely.
constexpr double kMostMoveSamples = 4096.0;

// Shares of the duration at which a motion is checked first.
constexpr double kFirstShares[] = {0.5, 0.75, 0.25, 0.875, 0.625, 0.375, 0.125};

// A share of the time to spare: none, all of it, or a random share.
double some_of(double spare, double choice, double share) {
    return choice < 1.0 / 3.0 ? 0.0 : choice < 2.0 / 3.0 ? spare : share * spare;
}

}  // namespace

Instant RestMove::at(double time) const {
    if (!profile || time <= begin) return {from, 0.0, 0.0};
    const double t = std::min((time - begin) / stretch, profile->duration());
    if (time >= end()) {
        const Instant last = profile->phases.back().at(profile->duration());
        return {from + sign * last.s, 0.0, 0.0};
    }
    const Instant here = profile->phase_at(t).at(t);
    return {from + sign * here.s, sign * here.speed / stretch, sign * here.acceleration / (stretch * stretch)};
}

Instant StaggeredMove::at(std::size_t joint, double time) const {
    const std::vector<RestMove>& moves = joints[joint];
    return (moves.size() > 1 && time >= moves[1].begin ? moves[1] : moves[0]).at(time);
}

std::vector<double> StaggeredMove::phase_ends() const {
    std::vector<double> times;
    for (const auto& moves : joints)
        for (const RestMove& move : moves) {
            if (!move.profile) continue;
            for (const Phase& phase : move.profile->phases) times.push_back(move.begin + move.stretch * phase.begin);
            times.push_back(move.end());
        }
    std::ranges::sort(times);
    return times;
}

StaggeredSearch::StaggeredSearch(EdgeChecker& edges, std::span<const double> start, std::span<const double> goals,
                                 std::span<const double> lower, std::span<const double> upper, RateLimits rates,
                                 double sample_time)
    : edges_(edges),
      start_(start.begin(), start.end()),
      goals_(goals.begin(), goals.end()),
      lower_(lower.begin(), lower.end()),
      upper_(upper.begin(), upper.end()),
      rates_(std::move(rates)),
      sample_time_(sample_time),
      profiles_(goals.size() / start.size()) {}

std::shared_ptr<const Profile> StaggeredSearch::profile(std::size_t joint, double distance) const {
    if (distance == 0.0) return nullptr;
    auto made = std::make_shared<Profile>();
    const double speed = rates_.velocity[joint], acceleration = rates_.acceleration[joint];
    if (rates_.jerk.empty())
        append_trapezoid(*made, 0.0, std::abs(distance), 0.0, 0.0, speed, acceleration, 0);
    else
        append_double_s(*made, 0.0, std::abs(distance), speed, acceleration, rates_.jerk[joint], 0);
    return made;
}

const std::vector<std::shared_ptr<const Profile>>& StaggeredSearch::profiles_to(std::size_t goal) {
    auto& found = profiles_[goal];
    if (found.empty())
        for (std::size_t j = 0; j < start_.size(); ++j)
            found.push_back(profile(j, goals_[goal * start_.size() + j] - start_[j]));
    return found;
}

double StaggeredSearch::least_duration(std::size_t goal) {
    double least = 0.0;
    for (const auto& each : profiles_to(goal)) least = std::max(least, each ? each->duration() : 0.0);
    return least;
}

// All durations below a limit in which a goal may be reached, ascending.
std::vector<StaggeredSearch::Aim> StaggeredSearch::aims(double below) {
    std::vector<Aim> found;
    for (std::size_t goal = 0; goal < profiles_.size(); ++goal) {
        const double least = least_duration(goal);
        for (double level : kLevels)
            if (least > 0.0 && level * least < below) found.push_back({goal, level * least});
    }
    std::ranges::stable_sort(found, {}, &Aim::duration);
    return found;
}

std::optional<StaggeredMove> StaggeredSearch::run(double below, std::span<const double> draws) {
    const std::vector<Aim> all = aims(below);
    std::optional<StaggeredMove> best;
    std::size_t count = all.size(), next = 0;  // aims that are shorter than the best motion, and the next of them
    const std::size_t each = draws_per_motion();
    for (std::size_t row = 0; row + each <= draws.size() && count > 0; row += each) {
        StaggeredMove move = described(all[next], draws.data() + row);
        if (is_free(move)) {
            best = shortened(std::move(move), draws.data() + row);
            while (count > 0 && all[count - 1].duration >= best->duration) --count;
            next = 0;
        } else {
            next = (next + 1) % count;
        }
    }
    return best;
}

// The free motion, or a shorter one that the same draws describe.
StaggeredMove StaggeredSearch::shortened(StaggeredMove move, const double* draws) {
    double low = least_duration(move.goal);
    for (int i = 0; i < kTightenings && move.duration > low; ++i) {
        StaggeredMove shorter = described({move.goal, i == 0 ? low : 0.5 * (low + move.duration)}, draws);
        if (is_free(shorter))
            move = std::move(shorter);
        else
            low = shorter.duration;
    }
    return move;
}

StaggeredMove StaggeredSearch::described(const Aim& aim, const double* draws) {
    StaggeredMove move{aim.goal, aim.duration, {}};
    const double kind = draws[0];
    const bool detours = kind > kAllSlow && draws[1] >= kWithoutDetour;
    for (std::size_t j = 0; j < start_.size(); ++j) {
        const double* own = draws + 2 + kDrawsPerJoint * j;
        std::optional<std::vector<RestMove>> away;
        if (detours && own[0] < kDetours) away = detour(aim, j, own + 1);
        move.joints.push_back(away ? *away : direct(aim, j, own + 1, kind));
    }
    return move;
}

std::vector<RestMove> StaggeredSearch::direct(const Aim& aim, std::size_t joint, const double* draws, double kind) {
    const auto& profile = profiles_to(aim.goal)[joint];
    RestMove move{start_[joint], 1.0, profile, 0.0, 1.0};
    if (!profile) return {move};
    move.sign = goals_[aim.goal * start_.size() + joint] < start_[joint] ? -1.0 : 1.0;
    const double least = profile->duration(), spare = aim.duration - least;
    if (kind < kAllLate) {
        move.begin = spare;
    } else if (kind >= kAllEarly && kind < kAllSlow) {
        move.stretch = aim.duration / least;
    } else if (kind >= kAllSlow) {
        move.begin = some_of(spare, draws[0], draws[1]);
        const double more = spare - move.begin;
        move.stretch = 1.0 + (draws[2] < 0.5 ? 0.0 : draws[2] < 0.8 ? more : draws[3] * more) / least;
    }
    return {move};
}

// Two moves, by way of a random position; none if the time does not suffice.
std::optional<std::vector<RestMove>> StaggeredSearch::detour(const Aim& aim, std::size_t joint,
                                                             const double* draws) const {
    const double from = start_[joint], to = goals_[aim.goal * start_.size() + joint];
    const double low = std::max(std::min(from, to) - kViaReach, lower_[joint]);
    const double high = std::min(std::max(from, to) + kViaReach, upper_[joint]);
    const double via = low + draws[4] * (high - low);
    std::vector<RestMove> moves{{from, via < from ? -1.0 : 1.0, profile(joint, via - from), 0.0, 1.0},
                                {via, to < via ? -1.0 : 1.0, profile(joint, to - via), 0.0, 1.0}};
    const double spare = aim.duration - (moves[0].end() + moves[1].end());
    if (spare < 0.0) return std::nullopt;
    const double before = draws[0] < 0.5 ? 0.0 : draws[1] * spare;
    const double between = some_of(spare - before, draws[2], draws[3]);
    moves[0].begin = before;
    moves[1].begin = moves[0].end() + between;
    return moves;
}

// Most motions are not free, usually near the contact of the previous one or at one of few samples.
bool StaggeredSearch::is_free(const StaggeredMove& move) {
    ++tried_;
    points_.resize(start_.size());
    for (std::size_t k = 0; k <= std::size(kFirstShares); ++k) {
        const double share = k == 0 ? latest_contact_ : kFirstShares[k - 1];
        place(move, share * move.duration, points_.data());
        if (!edges_.points_free(points_)) {
            latest_contact_ = share;
            return false;
        }
    }
    const auto steps = static_cast<std::size_t>(std::clamp(std::ceil(move.duration / sample_time_), 2.0, kMostMoveSamples));
    points_.resize((steps + 1) * start_.size());
    for (std::size_t i = 0; i <= steps; ++i)
        place(move, move.duration * static_cast<double>(i) / static_cast<double>(steps), &points_[i * start_.size()]);
    return edges_.points_free(points_);
}

void StaggeredSearch::place(const StaggeredMove& move, double time, double* q) const {
    for (std::size_t j = 0; j < start_.size(); ++j) q[j] = move.at(j, time).s;
}

}  // namespace pinproof
