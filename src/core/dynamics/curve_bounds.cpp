#include "dynamics/curve_bounds.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "geometry/curve.h"

namespace pinproof {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Fraction of the largest peak of all quantities below which a peak is not refined.
constexpr double kNegligible = 1e-6;

// An upper bound of a quantity on a part of a curve, and the largest value that it has at the ends of the part.
struct Range {
    double upper = 0.0, at_begin = 0.0, at_end = 0.0;

    double attained() const { return std::max(at_begin, at_end); }
};

// Of a quantity whose model has overflowed: infinity and NaN have no other bound.
constexpr Range kUnbounded{kInfinity, 0.0, 0.0};

void include(Range& range, const Range& other) {
    range.upper = std::max(range.upper, other.upper);
    range.at_begin = std::max(range.at_begin, other.at_begin);
    range.at_end = std::max(range.at_end, other.at_end);
}

// Part of a piece: its coefficients and its ends as fractions of the piece.
struct Part {
    std::array<std::vector<double>, 3> control;
    double begin = 0.0, end = 1.0;
};

Part whole(const TimedCurve& curve, std::size_t piece) {
    Part part;
    for (std::size_t order = 0; order < 3; ++order) {
        const std::size_t size = curve.points[order] * curve.dof;
        const auto from = curve.control[order].subspan(piece * size, size);
        part.control[order].assign(from.begin(), from.end());
    }
    return part;
}

// Both halves of a part.
void bisect(const TimedCurve& curve, Part& part, Part& right) {
    for (std::size_t order = 0; order < 3; ++order) {
        double* left = part.control[order].data();
        right.control[order].resize(part.control[order].size());
        halve(left, curve.points[order], curve.dof, left, right.control[order].data());
    }
    right.end = part.end;
    right.begin = part.end = 0.5 * (part.begin + part.end);
}

// The algorithm, driven along parts of a curve.
class AlongCurve {
  public:
    AlongCurve(const DynamicTree& model, const TimedCurve& curve)
        : curve_(curve), dynamics_(model), motion_(curve.dof), of_motion_(curve.dof), of_gravity_(curve.dof) {}

    InverseDynamics<TaylorModel>& drive(const Part& part) {
        for (std::size_t j = 0; j < curve_.dof; ++j)
            motion_[j] = {model_of(part.control[0].data() + j, curve_.points[0], curve_.dof),
                          model_of(part.control[1].data() + j, curve_.points[1], curve_.dof),
                          model_of(part.control[2].data() + j, curve_.points[2], curve_.dof)};
        dynamics_.move(motion_);
        return dynamics_;
    }

    void torques(const Part& part) { drive(part).torques(of_motion_, of_gravity_); }

    const TaylorModel& of_motion(std::size_t j) const { return of_motion_[j]; }
    const TaylorModel& of_gravity(std::size_t j) const { return of_gravity_[j]; }

  private:
    const TimedCurve& curve_;
    InverseDynamics<TaylorModel> dynamics_;
    std::vector<JointMotion<TaylorModel>> motion_;
    std::vector<TaylorModel> of_motion_, of_gravity_;
};

// The range of max(d / (T - g), -d / (T + g), 0).
Range quotient(const TaylorModel& of_motion, const TaylorModel& of_gravity, double limit) {
    const Bernstein d = bernstein_of(of_motion), g = bernstein_of(of_gravity);
    const double rd = of_motion.radius, rg = of_gravity.radius;
    if (!std::isfinite(of_motion.size() + of_gravity.size())) return kUnbounded;
    Range range;
    for (double sign : {1.0, -1.0}) {
        const auto at = [&](std::size_t i, double more) {  // more = 1: at most, -1: at least
            const double left = limit - sign * g[i] - more * rg;
            const double part = sign * d[i] + more * rd;
            if (left <= 0.0) return kInfinity;
            return std::max(part / left, 0.0);
        };
        Range side{0.0, at(0, -1.0), at(kDegree, -1.0)};
        for (std::size_t i = 0; i <= kDegree; ++i) side.upper = std::max(side.upper, at(i, 1.0));
        include(range, side);
    }
    return range;
}

// The range of |f|.
Range magnitude(const TaylorModel& f) {
    if (!std::isfinite(f.size())) return kUnbounded;
    const Bernstein coefficients = bernstein_of(f);
    double upper = 0.0;
    for (double each : coefficients) upper = std::max(upper, std::abs(each));
    return {upper + f.radius, std::max(std::abs(coefficients[0]) - f.radius, 0.0),
            std::max(std::abs(coefficients[kDegree]) - f.radius, 0.0)};
}

Range mapped(const Range& range, double (*function)(double)) {
    return {function(range.upper), function(range.at_begin), function(range.at_end)};
}
double square_root(double x) { return std::sqrt(x); }

// The range of the length of a vector. Its square is 0 or more, also where its model is below.
Range length(const Vector3<TaylorModel>& v) {
    const TaylorModel square = squared_norm(v);
    if (!std::isfinite(square.size())) return kUnbounded;
    const Bernstein coefficients = bernstein_of(square);
    double upper = 0.0;
    for (double each : coefficients) upper = std::max(upper, each);
    return mapped({upper + square.radius, std::max(coefficients[0] - square.radius, 0.0),
                   std::max(coefficients[kDegree] - square.radius, 0.0)},
                  square_root);
}

std::array<Range, 4> tool_ranges(AlongCurve& along, const Part& part) {
    const ToolMotion<TaylorModel> tool = along.drive(part).tool();
    return {length(tool.linear_velocity), length(tool.angular_velocity), length(tool.linear_acceleration),
            length(tool.angular_acceleration)};
}

// The load on a grip, in the coordinates of the grip: the coefficients of its parts from the motion and from gravity, and
// the shares of their radii.
struct LoadOnPart {
    std::array<Wrench, kDegree + 1> of_motion, of_gravity;
    double motion_error, gravity_error;
};

LoadOnPart load_on(const Grip& grip, AlongCurve& along, const Part& part) {
    LoadOnPart found;
    const auto load = along.drive(part).load_of_tool();
    const auto read = [&](const Vector3<TaylorModel>& force, const Vector3<TaylorModel>& moment, auto& coefficients,
                          double& error) {
        const std::array models{&force.x, &force.y, &force.z, &moment.x, &moment.y, &moment.z};
        std::array<Wrench, kDegree + 1> wrenches;
        Wrench radii;
        for (std::size_t k = 0; k < 6; ++k) {
            const Bernstein own = bernstein_of(*models[k]);
            for (std::size_t i = 0; i <= kDegree; ++i) wrenches[i][k] = own[i];
            radii[k] = models[k]->radius;
        }
        for (std::size_t i = 0; i <= kDegree; ++i) coefficients[i] = grip.local(wrenches[i]);
        error = grip.share_of_error(grip.local_error(radii));
    };
    read(load.force, load.moment, found.of_motion, found.motion_error);
    read(load.weight, load.weight_moment, found.of_gravity, found.gravity_error);
    return found;
}

// Visit the parts of a piece, of which those for which `visit(part, may_bisect)` returns true are bisected.
template <class Visit>
void refine(const TimedCurve& curve, std::size_t piece, Visit visit) {
    std::vector<Part> waiting{whole(curve, piece)};
    for (std::size_t parts = 0; !waiting.empty(); ++parts) {
        Part part = std::move(waiting.back());
        waiting.pop_back();
        if (!visit(part, parts < kMaxParts)) continue;
        Part right;
        bisect(curve, part, right);
        waiting.push_back(std::move(right));
        waiting.push_back(std::move(part));
    }
}

// The bound on one piece of a quantity that `range_of(part)` encloses, refined down to `enough`.
template <class RangeOf>
double bound_on_piece(const TimedCurve& curve, std::size_t piece, double enough, RangeOf range_of,
                      double slack = kSlack) {
    double bound = 0.0, seen = 0.0;
    refine(curve, piece, [&](const Part& part, bool may_bisect) {
        if (seen == kInfinity) return false;
        const Range range = range_of(part);
        seen = std::max(seen, range.attained());
        if (may_bisect && seen < kInfinity && !(range.upper <= std::max(enough, seen * (1.0 + slack)))) return true;
        bound = std::max(bound, range.upper);
        return false;
    });
    return seen == kInfinity ? kInfinity : bound;
}

// The peaks over the curve of the quantities that `ranges_of(part, ranges)` encloses.
template <class RangesOf>
std::vector<Peak> peaks_of(const TimedCurve& curve, std::size_t quantities, RangesOf ranges_of,
                           double slack = kSlack) {
    std::vector<Peak> peaks(quantities);
    std::vector<Range> ranges(quantities);
    const auto evaluate = [&](const Part& part, std::size_t piece) {
        ranges_of(part, ranges);
        for (std::size_t i = 0; i < quantities; ++i) {
            const bool at_end = ranges[i].at_end > ranges[i].at_begin;
            if (!(ranges[i].attained() > peaks[i].attained)) continue;
            peaks[i].attained = ranges[i].attained();
            peaks[i].piece = piece;
            peaks[i].fraction = at_end ? part.end : part.begin;
        }
    };
    // First all pieces as they are, so that the largest values are known before any piece is bisected.
    for (std::size_t piece = 0; piece < curve.pieces; ++piece) evaluate(whole(curve, piece), piece);
    double most = 0.0;
    for (const Peak& peak : peaks) most = std::max(most, peak.attained);
    for (std::size_t piece = 0; piece < curve.pieces; ++piece)
        refine(curve, piece, [&](const Part& part, bool may_bisect) {
            evaluate(part, piece);
            for (std::size_t i = 0; i < quantities && may_bisect; ++i)
                if (ranges[i].upper > std::max(peaks[i].attained * (1.0 + slack), kNegligible * most)) return true;
            for (std::size_t i = 0; i < quantities; ++i) peaks[i].bound = std::max(peaks[i].bound, ranges[i].upper);
            return false;
        });
    return peaks;
}

}  // namespace

void torque_stretch(const DynamicTree& model, const TimedCurve& curve, std::span<const double> limits,
                    std::span<double> stretch) {
    AlongCurve along(model, curve);
    for (std::size_t piece = 0; piece < curve.pieces; ++piece)
        stretch[piece] = std::sqrt(bound_on_piece(curve, piece, 1.0, [&](const Part& part) {
            along.torques(part);
            Range range;
            for (std::size_t j = 0; j < curve.dof; ++j)
                include(range, quotient(along.of_motion(j), along.of_gravity(j), limits[j]));
            return range;
        }));
}

void tool_stretch(const DynamicTree& model, const TimedCurve& curve, const ToolRates& limits, std::span<double> stretch) {
    AlongCurve along(model, curve);
    for (std::size_t piece = 0; piece < curve.pieces; ++piece)
        stretch[piece] = bound_on_piece(curve, piece, 1.0, [&](const Part& part) {
            const std::array<Range, 4> rates = tool_ranges(along, part);
            Range range;
            for (std::size_t i = 0; i < rates.size(); ++i) {
                const double limit = limits[i];
                const Range share{rates[i].upper / limit, rates[i].at_begin / limit, rates[i].at_end / limit};
                include(range, i < 2 ? share : mapped(share, square_root));
            }
            return range;
        });
}

std::vector<Peak> torque_peaks(const DynamicTree& model, const TimedCurve& curve) {
    AlongCurve along(model, curve);
    return peaks_of(curve, curve.dof, [&](const Part& part, std::vector<Range>& ranges) {
        along.torques(part);
        for (std::size_t j = 0; j < curve.dof; ++j) ranges[j] = magnitude(along.of_motion(j) + along.of_gravity(j));
    });
}

std::vector<Peak> tool_peaks(const DynamicTree& model, const TimedCurve& curve) {
    AlongCurve along(model, curve);
    return peaks_of(curve, 4, [&](const Part& part, std::vector<Range>& ranges) {
        const std::array<Range, 4> rates = tool_ranges(along, part);
        std::copy(rates.begin(), rates.end(), ranges.begin());
    });
}

void grip_stretch(const DynamicTree& model, const TimedCurve& curve, const Grip& grip, std::span<double> stretch) {
    AlongCurve along(model, curve);
    ShareOfGrip share(grip);
    const auto square = [&](const LoadOnPart& load, std::size_t i, bool with_error) {
        const double error = with_error ? load.gravity_error + load.motion_error : 0.0;
        const double reach = share.reach(load.of_gravity[i], load.of_motion[i], 1.0 - error);
        return 1.0 / reach;  // infinite if the grip does not carry the part at rest
    };
    for (std::size_t piece = 0; piece < curve.pieces; ++piece)
        stretch[piece] = std::sqrt(bound_on_piece(
            curve, piece, 1.0,
            [&](const Part& part) {
                const LoadOnPart load = load_on(grip, along, part);
                if (!std::isfinite(load.motion_error + load.gravity_error)) return kUnbounded;
                Range range{0.0, square(load, 0, false), square(load, kDegree, false)};
                for (std::size_t i = 0; i <= kDegree; ++i) range.upper = std::max(range.upper, square(load, i, true));
                return range;
            },
            kGripSlack));
}

Peak grip_peak(const DynamicTree& model, const TimedCurve& curve, const Grip& grip) {
    AlongCurve along(model, curve);
    ShareOfGrip share(grip);
    return peaks_of(
        curve, 1,
        [&](const Part& part, std::vector<Range>& ranges) {
            const LoadOnPart load = load_on(grip, along, part);
            const double error = load.motion_error + load.gravity_error;
            if (!std::isfinite(error)) return void(ranges[0] = kUnbounded);
            std::array<double, kDegree + 1> shares;
            for (std::size_t i = 0; i <= kDegree; ++i) {
                Wrench sum = load.of_motion[i];
                for (std::size_t k = 0; k < 6; ++k) sum[k] += load.of_gravity[i][k];
                shares[i] = share(sum);
            }
            ranges[0] = {*std::max_element(shares.begin(), shares.end()) + error, std::max(shares.front() - error, 0.0),
                         std::max(shares.back() - error, 0.0)};
        },
        kGripSlack)[0];
}

}  // namespace pinproof
