#include "timing/profile.h"

#include <algorithm>
#include <cmath>

namespace pinproof {
namespace {

// The duration, rounded up to nanoseconds; a longer duration does not increase any derivative.
double rounded_up(double duration) { return std::ceil(duration * kNano) / kNano; }

}  // namespace

Instant Phase::at(double time) const {
    const double t = time - begin, a = from.acceleration;
    return {from.s + (from.speed + (0.5 * a + (jerk / 6.0 + snap * t / 24.0) * t) * t) * t,
            from.speed + (a + (0.5 * jerk + snap * t / 6.0) * t) * t, a + (jerk + 0.5 * snap * t) * t};
}

void Profile::append(double duration, const Instant& from, std::size_t step, double jerk, double snap) {
    phases.push_back({this->duration(), duration, from, jerk, snap, step});
}

const Phase& Profile::phase_at(double time) const {
    const auto after = std::upper_bound(phases.begin(), phases.end(), time,
                                        [](double t, const Phase& phase) { return t < phase.begin; });
    return after == phases.begin() ? phases.front() : *(after - 1);
}

void append_trapezoid(Profile& profile, double first, double length, double start, double end, double speed,
                      double acceleration, std::size_t step) {
    const bool at_rest = start == 0.0 && end == 0.0;
    const double faster = std::max(start, end);
    acceleration = std::max(acceleration, std::abs(end - start) * (end + start) / (2.0 * length));  // against rounding
    double peak = std::min(speed, std::sqrt(acceleration * length + 0.5 * (start * start + end * end)));
    peak = std::max(faster, peak);
    double rise = (peak - start) / acceleration, fall = (peak - end) / acceleration;
    double cruise = (length - 0.5 * (start + peak) * rise - 0.5 * (peak + end) * fall) / peak;
    if (!(cruise >= kShortestPhase)) cruise = 0.0;
    if (at_rest) {  // A short phase has no longer neighbour to be merged with; its duration is increased.
        if (cruise == 0.0) peak = std::min(peak, length / kShortestPhase);
        rise = rounded_up(std::max(rise, kShortestPhase));
        fall = rounded_up(std::max(fall, kShortestPhase));
        cruise = rounded_up(cruise);
        peak = length / (0.5 * (rise + fall) + cruise);
    } else {
        const bool no_rise = rise < kShortestPhase, no_fall = fall < kShortestPhase;
        double before = no_rise ? start : peak, after = no_fall ? end : peak;  // speeds at both ends of the cruise
        if (cruise == 0.0 && no_rise && no_fall) cruise = 1.0;
        if (cruise == 0.0 && no_fall) before = end;
        if (cruise == 0.0 && no_rise) after = start;
        if (no_rise) rise = 0.0;
        if (no_fall) fall = 0.0;
        // The remaining phases are extended so that they cover the length.
        const double covered = 0.5 * ((start + before) * rise + (before + after) * cruise + (after + end) * fall);
        const double factor = length / covered;
        const double durations[3] = {rise * factor, cruise * factor, fall * factor};
        const double speeds[4] = {start, before, after, end};
        double s = first;
        for (std::size_t i = 0; i < 3; ++i) {
            if (!(durations[i] > 0.0)) continue;
            profile.append(durations[i], {s, speeds[i], (speeds[i + 1] - speeds[i]) / durations[i]}, step);
            s += 0.5 * (speeds[i] + speeds[i + 1]) * durations[i];
        }
        return;
    }
    profile.append(rise, {first, 0.0, peak / rise}, step);
    if (cruise > 0.0) profile.append(cruise, {first + 0.5 * peak * rise, peak, 0.0}, step);
    profile.append(fall, {first + peak * (0.5 * rise + cruise), peak, -peak / fall}, step);
}

void append_double_s(Profile& profile, double first, double length, double speed, double acceleration, double jerk,
                     std::size_t step) {
    // First with a cruise phase, where the peak speed is the limit; else the ramps cover the length.
    double edge = std::min(std::sqrt(speed / jerk), acceleration / jerk);
    double ramp = std::max(speed / acceleration - edge, 0.0);
    double cruise = length / speed - (2.0 * edge + ramp);
    if (cruise < kShortestEdge) {
        const double full = acceleration / jerk;  // the edge of a ramp that reaches the acceleration limit
        const double without = 0.5 * (std::sqrt(full * full + 4.0 * length / acceleration) - full) - full;
        edge = without > 0.0 ? full : std::cbrt(length / (2.0 * jerk));
        ramp = std::max(without, 0.0) + std::max(cruise, 0.0);
        cruise = 0.0;
    }
    // The duration of an omitted ramp is added to the edges. Longer phases reduce peak, acceleration and jerk.
    edge = std::max(ramp < kShortestEdge ? edge + ramp : edge, kShortestEdge);
    ramp = ramp < kShortestEdge ? 0.0 : ramp;
    edge = rounded_up(edge);
    ramp = rounded_up(ramp);
    cruise = rounded_up(cruise);
    const double peak = length / (2.0 * edge + ramp + cruise), used = peak / ((edge + ramp) * edge);
    const double durations[7] = {edge, ramp, edge, cruise, edge, ramp, edge};
    constexpr double kSigns[7] = {1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0};
    Instant at{first, 0.0, 0.0};
    for (std::size_t i = 0; i < 7; ++i) {
        if (!(durations[i] > 0.0)) continue;
        if (i == 3) at = {at.s, peak, 0.0};
        profile.append(durations[i], at, step, kSigns[i] * used);
        at = profile.phases.back().at(profile.duration());
    }
}

}  // namespace pinproof
