#include "reach/reach_proof.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace pinproof {
namespace {

// Fraction of the chain's length: axes closer than this share a point, whose error the bounds contain.
constexpr double kMeets = 1e-4;

// Fraction of the chain's length: points of one axis that are closer together than this count as one.
constexpr double kDistinct = 0.02;

// Fraction of the chain's length: the distance of an additional point on an axis.
constexpr double kAlong = 0.3;

// Sine of an angle: axes with a smaller one are parallel.
constexpr double kParallel = 1e-3;

double length_of(const Chain& chain) {
    double length = norm(chain.tool.translation);
    for (const Joint& joint : chain.joints) length += norm(joint.before.translation);
    return std::max(length, 1e-3);
}

// The heights on the axis (z) of joint k that are closest to the axis of another joint, whose origin and direction are
// given in the frame of the axis; nothing for parallel axes.
bool nearest_height(const Vec3& origin, const Vec3& direction, double& height) {
    const double across = direction.x * direction.x + direction.y * direction.y;
    if (across < kParallel * kParallel) return false;
    // Minimise over both axes: (origin + t direction) is closest to z at t = -(o.xy . d.xy) / |d.xy|^2.
    const double t = -(origin.x * direction.x + origin.y * direction.y) / across;
    height = origin.z + t * direction.z;
    return true;
}

// The point at a height on the axis of joint k (from 1), extended to all neighbouring links on which it is fixed.
LoopPoint point_on_axis(const Chain& chain, int k, double height, double size) {
    const int n = static_cast<int>(chain.joints.size());
    const Vec3 own{0.0, 0.0, height};
    LoopPoint point{k - 1, k, {chain.joints[k - 1].before * own, own}, 0.0};
    const auto off_axis = [](const Vec3& p) { return std::hypot(p.x, p.y); };
    while (point.last < n) {
        const Joint& next = chain.joints[point.last];
        const Vec3 moved = inverse(next.before) * point.at.back();
        if (next.prismatic || off_axis(moved) > kMeets * size) break;
        point.error += off_axis(moved);
        point.at.push_back({0.0, 0.0, moved.z});
        ++point.last;
    }
    while (point.first > 0) {
        const Joint& previous = chain.joints[point.first - 1];
        const Vec3 here = point.at.front();
        if (previous.prismatic || off_axis(here) > kMeets * size) break;
        point.error += off_axis(here);
        point.at.insert(point.at.begin(), previous.before * Vec3{0.0, 0.0, here.z});
        --point.first;
    }
    return point;
}

bool same_point(const LoopPoint& a, const LoopPoint& b, double size) {
    const int link = std::max(a.first, b.first);
    return link <= std::min(a.last, b.last) && norm(a.on(link) - b.on(link)) < kDistinct * size;
}

// At least two points on the axis of joint k: those closest to the neighbouring axes, and one at a distance.
void add_points_of_axis(const Chain& chain, int k, double size, std::vector<LoopPoint>& points) {
    const int n = static_cast<int>(chain.joints.size());
    std::vector<double> heights;
    double height;
    if (k < n) {
        const Transform next = chain.joints[k].before;
        if (nearest_height(next.translation, next.rotation.column(2), height)) heights.push_back(height);
    }
    if (k > 1) {
        const Transform previous = inverse(chain.joints[k - 1].before);
        if (nearest_height(previous.translation, previous.rotation.column(2), height)) heights.push_back(height);
    }
    if (heights.empty()) heights.push_back(0.0);
    if (*std::max_element(heights.begin(), heights.end()) - *std::min_element(heights.begin(), heights.end()) <
        kAlong / 3 * size)
        heights.push_back(heights.front() + kAlong * size);
    for (double each : heights) {
        LoopPoint point = point_on_axis(chain, k, each, size);
        // Of several names of one point, the one that is fixed on the most links is kept.
        auto known = std::find_if(points.begin(), points.end(),
                                  [&](const LoopPoint& other) { return same_point(point, other, size); });
        if (known == points.end())
            points.push_back(std::move(point));
        else if (point.last - point.first > known->last - known->first)
            *known = std::move(point);
    }
}

// From point p up to point q; the joints between the links on which they are fixed.
Arc inner_arc(const LoopPoint& p, const LoopPoint& q) {
    const int shared = std::max(p.first, q.first);
    if (q.first <= p.last) return {p.on(shared), q.on(shared), {}, -1};
    Arc arc{p.on(p.last), q.on(q.first), std::vector<int>(q.first - p.last), -1};
    std::iota(arc.joints.begin(), arc.joints.end(), p.last);  // joints are counted from 0 in arcs
    return arc;
}

// From point q up through the target and on to point p.
Arc outer_arc(const LoopPoint& p, const LoopPoint& q, int n) {
    Arc arc{q.on(q.last), p.on(p.first), {}, n - q.last};
    for (int joint = q.last; joint < n; ++joint) arc.joints.push_back(joint);
    for (int joint = 0; joint < p.first; ++joint) arc.joints.push_back(joint);
    return arc;
}

}  // namespace

LoopDistances loop_distances(const Chain& chain) {
    LoopDistances loop{{}, {}, length_of(chain)};
    const int n = static_cast<int>(chain.joints.size());
    for (int k = 1; k <= n; ++k)
        if (!chain.joints[k - 1].prismatic) add_points_of_axis(chain, k, loop.size, loop.points);
    // Three points of the tcp and one of the base, so that prismatic joints and single axes are determined too.
    for (const Vec3& offset : {Vec3{}, Vec3{kAlong, 0.0, 0.0}, Vec3{0.0, kAlong, 0.0}})
        loop.points.push_back({n, n, {chain.tool * (loop.size * offset)}, 0.0});
    loop.points.push_back({0, 0, {Vec3{}}, 0.0});

    const int count = static_cast<int>(loop.points.size());
    for (int i = 0; i < count; ++i)
        for (int j = 0; j < count; ++j) {
            const LoopPoint &p = loop.points[i], &q = loop.points[j];
            if (p.first > q.first || p.last > q.last || (i > j && p.first == q.first && p.last == q.last)) continue;
            loop.constraints.push_back({inner_arc(p, q), outer_arc(p, q, n), p.error + q.error, {i, j}});
        }
    std::stable_sort(
        loop.constraints.begin(), loop.constraints.end(),
        [](const LoopConstraint& a, const LoopConstraint& b) { return a.joint_count() < b.joint_count(); });
    return loop;
}

namespace {

constexpr double kPi = 3.14159265358979323846;

// Fraction of the chain's length by which every distance is widened. A distance is computed with fewer than 1000
// operations on numbers up to this length, whose rounding is below 1e-15 of it each.
constexpr double kRounding = 1e-11;

// The same for squared distances, as a fraction of the squared length.
constexpr double kSquareRounding = 1e-13;

// Rad: allowance for rounding of inverse cosines and arc tangents.
constexpr double kAngleRounding = 1e-12;

// Rad, or fraction of the chain's length: joints whose half width is larger are wide. A constraint with more than
// kMostWide of them hardly excludes anything and is not evaluated.
constexpr double kWide = 0.35;
constexpr int kMostWide = 2;

// Rad, or fraction of the chain's length: if the joint with the largest influence is narrower than this, and another one
// is wider by more than the factor kMuchWider, the latter is divided.
constexpr double kNarrow = 0.1;
constexpr double kMuchWider = 3.0;

// A contraction by a smaller part of the range does not trigger another evaluation of the other constraints.
constexpr double kWorthwhile = 0.1;

// Most passes over all constraints for one box.
constexpr int kPasses = 3;

// Rad or m: a box of this half width is not divided further, because constraints hold to about this accuracy.
constexpr double kSmallest = 1e-7;

// An overlap at the middle of the box whose depth is at least this part of the radius that encloses its ball is proven
// soon: the box is divided for it.
constexpr double kDeepEnough = 0.2;

// A gap of at least this part of the range is where a box is divided.
constexpr double kWorthyGap = 0.2;

// A set of positions: all points within `radius` of `centre`.
struct Ball {
    Vec3 centre;
    double radius = 0.0;
};

// The proof for one chain, with its working memory.
class ReachProver {
  public:
    explicit ReachProver(const ReachArm& arm)
        : chain_(arm.chain),
          loop_(arm.loop),
          n_(static_cast<int>(arm.chain.joints.size())),
          rounding_(kRounding * arm.loop.size),
          limits_(arm.limits),
          evaluated_(arm.loop.constraints.size()) {
        for (const Joint& joint : chain_.joints) up_.push_back(inverse(joint.before));
    }

    ReachProof prove(const Transform& base_from_tcp, const ReachSettings& settings) {
        struct Open {
            JointBox box;
            int divided;
        };
        ReachProof proof;
        proof_ = &proof;
        proof.used.resize(settings.overlaps.size());
        start(base_from_tcp, settings);
        std::vector<Open> waiting{{limits_, -1}};
        while (!waiting.empty()) {
            open(waiting.back().box, waiting.back().divided);
            waiting.pop_back();
            ++proof.boxes;
            if (!propagate(proof.boxes == 1) || overlaps_everywhere()) continue;
            const int joint = joint_to_split();
            if (joint < 0 || proof.boxes >= settings.budget) {
                for (int k = 0; k < n_; ++k) {
                    proof.remaining.push_back(value_[k].middle);
                    proof.width = std::max(proof.width, 2.0 * value_[k].half_width);
                }
                return proof;
            }
            const double at = place_to_split(joint);
            if (settings.record) proof.steps.push_back({ReachStep::kSplit, joint, -1, at, -1});
            Open half{box_, joint};
            half.box.lower[joint] = at;
            waiting.push_back(half);
            half.box = box_;
            half.box.upper[joint] = at;
            waiting.push_back(half);
        }
        proof.outcome = ReachOutcome::kExcluded;
        return proof;
    }

    bool keeps(const Transform& base_from_tcp, const double* q, const ReachSettings& settings) {
        ReachProof unused;
        proof_ = &unused;
        start(base_from_tcp, settings);
        JointBox box = limits_;
        int divided = -1;
        for (std::int64_t boxes = 0; boxes < settings.budget; ++boxes) {
            open(box, divided);
            if (!propagate(boxes == 0)) return false;
            for (int k = 0; k < n_; ++k)
                if (q[k] < box_.lower[k] || q[k] > box_.upper[k]) return false;
            divided = joint_to_split();
            if (divided < 0) return true;
            const double at = place_to_split(divided);
            box = box_;
            (q[divided] <= at ? box.upper : box.lower)[divided] = at;
        }
        return true;
    }

  private:
    struct JointValue {
        double middle, half_width;
        double cosine, sine;     // of the middle
        double inwards, radius;  // the arc about the middle: its ball has `inwards` and `radius` times the arc's radius
    };
    struct Range {
        double lower, upper;
    };
    struct ArcBalls {
        Ball before[kMostProofJoints];  // the start, moved to the frame of each joint before its own motion
        Ball after[kMostProofJoints];   // the end, moved to the frame behind each joint
        Ball start, end;                // without joints: both in the same frame
        int widest = -1;                // the joint (index in the arc) with the largest effect
        double slack = 0.0;             // sum of the effects
        double effect[kMostProofJoints];
    };

    void set_joint(int joint) {
        JointValue& value = value_[joint];
        value.middle = 0.5 * (box_.lower[joint] + box_.upper[joint]);
        value.half_width = 0.5 * (box_.upper[joint] - box_.lower[joint]) + kAngleRounding;
        if (chain_.joints[joint].prismatic) return;
        value.cosine = std::cos(value.middle);
        value.sine = std::sin(value.middle);
        // The smallest ball around an arc of radius rho and half width w is centred at rho cos w on the bisector and has
        // the radius rho sin w; for more than half a circle it is that of the circle.
        const bool half_circle = value.half_width >= 0.5 * kPi;
        value.inwards = half_circle ? 0.0 : std::cos(value.half_width);
        value.radius = half_circle ? 1.0 : std::sin(value.half_width);
    }

    Ball up(int joint, const Ball& ball) const { return {up_[joint] * ball.centre, ball.radius}; }

    Ball rotated_back(int joint, const Ball& ball) const {
        const JointValue& value = value_[joint];
        const Vec3& p = ball.centre;
        if (chain_.joints[joint].prismatic) return {{p.x, p.y, p.z - value.middle}, ball.radius + value.half_width};
        const double c = value.inwards * value.cosine, s = value.inwards * value.sine;
        return {{c * p.x + s * p.y, c * p.y - s * p.x, p.z}, ball.radius + value.radius * std::hypot(p.x, p.y)};
    }

    Ball down(int joint, const Ball& ball) const {
        const JointValue& value = value_[joint];
        const Vec3& p = ball.centre;
        if (chain_.joints[joint].prismatic)
            return {chain_.joints[joint].before * Vec3{p.x, p.y, p.z + value.middle}, ball.radius + value.half_width};
        const double c = value.inwards * value.cosine, s = value.inwards * value.sine;
        return {chain_.joints[joint].before * Vec3{c * p.x - s * p.y, c * p.y + s * p.x, p.z},
                ball.radius + value.radius * std::sqrt(p.x * p.x + p.y * p.y)};
    }

    // The pose of the tcp may deviate by the tolerances: a point moves by at most the position tolerance plus its distance
    // from the tcp times the orientation tolerance.
    Ball through_target(const Transform& pose, const Vec3& tcp, const Ball& ball) const {
        const double arm = norm(ball.centre - tcp) + ball.radius;
        return {pose * ball.centre, ball.radius + settings_.position_tolerance + settings_.orientation_tolerance * arm};
    }

    void evaluate(const Arc& arc, double error, ArcBalls& balls) const {
        const int count = static_cast<int>(arc.joints.size());
        Ball ball{arc.start, error};
        for (int i = 0; i < count; ++i) {
            if (i == arc.joints_before_target) ball = through_target(base_from_last_, chain_.tool.translation, ball);
            const int joint = arc.joints[i];
            balls.before[i] = up(joint, ball);
            ball = rotated_back(joint, balls.before[i]);
        }
        if (count == arc.joints_before_target) ball = through_target(base_from_last_, chain_.tool.translation, ball);
        balls.start = ball;

        ball = {arc.end, 0.0};
        balls.end = ball;
        balls.slack = 0.0;
        balls.widest = -1;
        for (int i = count - 1; i >= 0; --i) {
            if (i + 1 == arc.joints_before_target) ball = through_target(last_from_base_, target_.translation, ball);
            const int joint = arc.joints[i];
            balls.after[i] = ball;
            const double width = std::min(value_[joint].half_width, 0.5 * kPi);
            const Vec3& p = ball.centre;
            balls.effect[i] = chain_.joints[joint].prismatic
                                  ? width
                                  : width * std::min(std::sqrt(p.x * p.x + p.y * p.y) + ball.radius,
                                                     std::hypot(balls.before[i].centre.x, balls.before[i].centre.y) +
                                                         balls.before[i].radius);
            balls.slack += balls.effect[i];
            if (balls.widest < 0 || balls.effect[i] > balls.effect[balls.widest]) balls.widest = i;
            if (i > 0) ball = down(joint, ball);
        }
    }

    // The squared distance of a point that a revolute joint rotates from another one: sum - twice cos(angle - offset), with
    // the angle from the middle of the range of the joint, and the offset of (along, across).
    struct RotatedDistance {
        double sum, twice, along, across;
    };
    static RotatedDistance rotated_distance(const JointValue& value, const Vec3& a, const Vec3& b) {
        const double dz = a.z - b.z, x = value.cosine * a.x + value.sine * a.y, y = value.cosine * a.y - value.sine * a.x;
        const double along = x * b.x + y * b.y, across = y * b.x - x * b.y;
        return {dz * dz + x * x + y * y + b.x * b.x + b.y * b.y, 2.0 * std::sqrt(along * along + across * across), along,
                across};
    }

    // The range of the distance between the ends of an arc, with the widest joint exact and the others enclosed in balls.
    Range distance(const Arc& arc, const ArcBalls& balls) const {
        if (arc.joints.empty()) {
            const double d = norm(balls.start.centre - balls.end.centre), r = balls.start.radius + balls.end.radius;
            return {d - r - rounding_, d + r + rounding_};
        }
        const int joint = arc.joints[balls.widest];
        const Ball &a = balls.before[balls.widest], &b = balls.after[balls.widest];
        const JointValue& value = value_[joint];
        const double r = a.radius + b.radius + rounding_;
        const double dz = a.centre.z - b.centre.z;
        double least, most;
        if (chain_.joints[joint].prismatic) {
            const double dx = a.centre.x - b.centre.x, dy = a.centre.y - b.centre.y, across = dx * dx + dy * dy;
            const double low = std::abs(dz - value.middle) - value.half_width;
            const double high = std::abs(dz - value.middle) + value.half_width;
            least = across + (low > 0.0 ? low * low : 0.0);
            most = across + high * high;
        } else {
            const auto [sum, twice, along, across] = rotated_distance(value, a.centre, b.centre);
            const double angle = std::abs(std::atan2(across, along));
            const double near = angle - value.half_width - kAngleRounding,
                         far = angle + value.half_width + kAngleRounding;
            least = sum - twice * (near <= 0.0 ? 1.0 : std::cos(near));
            most = sum - twice * (far >= kPi ? -1.0 : std::cos(far));
        }
        const double square = kSquareRounding * (loop_.size * loop_.size + most);
        return {std::sqrt(std::max(least - square, 0.0)) - r, std::sqrt(most + square) + r};
    }

    // Apply one constraint to the box. Returns false if it excludes the box.
    bool contract(const LoopConstraint& constraint, int number) {
        ArcBalls inner, outer;
        evaluate(constraint.inner, constraint.error, inner);
        evaluate(constraint.outer, constraint.error, outer);
        const Range here = distance(constraint.inner, inner), there = distance(constraint.outer, outer);
        if (here.lower > there.upper || there.lower > here.upper) {
            if (settings_.record) proof_->steps.push_back({ReachStep::kExcluded, -1, number, 0.0, clock_});
            return false;
        }
        const double slack = inner.slack + outer.slack + 1e-3 * loop_.size;
        const auto apply = [&](const Arc& arc, const ArcBalls& balls, const Range& other) {
            for (int i = 0; i < static_cast<int>(arc.joints.size()); ++i) {
                influence_[arc.joints[i]] += balls.effect[i] / (slack * slack);
                if (!project(arc.joints[i], balls.before[i], balls.after[i], other, number)) return false;
            }
            return true;
        };
        return apply(constraint.inner, inner, there) && apply(constraint.outer, outer, here);
    }

    // Reduce the range of a joint to the values for which the distance between a ball before its motion and one behind it
    // is in the given range. Returns false if there are none.
    bool project(int joint, const Ball& a, const Ball& b, const Range& distance, int number) {
        const JointValue value = value_[joint];
        const double r = a.radius + b.radius + rounding_;
        const double low = std::max(distance.lower - r, 0.0), high = distance.upper + r;
        const double dz = a.centre.z - b.centre.z;
        const double infinity = std::numeric_limits<double>::infinity();
        if (chain_.joints[joint].prismatic) {
            // (dz - q)^2 = d^2 - across.
            const double dx = a.centre.x - b.centre.x, dy = a.centre.y - b.centre.y, across = dx * dx + dy * dy;
            const double square = kSquareRounding * (loop_.size * loop_.size + across + dz * dz + high * high);
            const double most = high * high - across + square;
            if (most < 0.0) return narrow(joint, infinity, -infinity, number);
            const double least = std::sqrt(std::max(low * low - across - square, 0.0)) - rounding_;
            const double reach = std::sqrt(most) + rounding_;
            double lower = infinity, upper = -infinity;
            for (const Range& part : {Range{dz - reach, dz - least}, Range{dz + least, dz + reach}}) {
                const double from = std::max(part.lower, box_.lower[joint]),
                             to = std::min(part.upper, box_.upper[joint]);
                if (from > to) continue;
                lower = std::min(lower, from);
                upper = std::max(upper, to);
            }
            return narrow(joint, lower, upper, number);
        }
        const auto [sum, twice, along, across] = rotated_distance(value, a.centre, b.centre);
        const double square = kSquareRounding * (loop_.size * loop_.size + sum + high * high);
        // sum - twice cos(angle - offset) = d^2.
        const double at_least = sum - high * high - square, at_most = sum - low * low + square;
        if (at_least > twice || at_most < -twice) return narrow(joint, infinity, -infinity, number);
        if (at_least <= -twice && at_most >= twice) return true;
        const double nearest = at_most >= twice ? 0.0 : std::acos(at_most / twice) - kAngleRounding;
        const double farthest = at_least <= -twice ? kPi : std::acos(at_least / twice) + kAngleRounding;
        const double angle = std::atan2(across, along);
        const double w = value.half_width;
        double lower = infinity, upper = -infinity;
        Range parts[6];
        int count = 0;
        for (const double turn : {-2.0 * kPi, 0.0, 2.0 * kPi})
            for (const Range& part :
                 {Range{angle - farthest, angle - nearest}, Range{angle + nearest, angle + farthest}}) {
                const double from = std::max(part.lower + turn - kAngleRounding, -w);
                const double to = std::min(part.upper + turn + kAngleRounding, w);
                if (from > to) continue;
                parts[count++] = {from, to};
                lower = std::min(lower, from);
                upper = std::max(upper, to);
            }
        if (count >= 2) {
            for (int i = 1; i < count; ++i)
                for (int k = i; k > 0 && parts[k].lower < parts[k - 1].lower; --k) std::swap(parts[k], parts[k - 1]);
            double end = parts[0].upper;
            for (int i = 1; i < count; ++i) {
                if (parts[i].lower - end > gap_[joint].width)
                    gap_[joint] = {parts[i].lower - end, value.middle + 0.5 * (end + parts[i].lower)};
                end = std::max(end, parts[i].upper);
            }
        }
        return narrow(joint, value.middle + lower - kAngleRounding, value.middle + upper + kAngleRounding, number);
    }

    // Reduce the range of a joint to [lower, upper], and record what is cut off. Returns false if nothing remains.
    bool narrow(int joint, double lower, double upper, int number) {
        double &low = box_.lower[joint], &high = box_.upper[joint];
        if (!(lower <= upper) || lower > high || upper < low) {
            if (settings_.record) proof_->steps.push_back({ReachStep::kExcluded, -1, number, 0.0, clock_});
            return false;
        }
        const double before = high - low;
        const double cut = 1e-3 * before;  // smaller cuts are not worth a step
        bool cut_any = false;
        if (lower > low + cut) {
            low = lower;
            cut_any = true;
            if (settings_.record) proof_->steps.push_back({ReachStep::kCutLower, joint, number, lower, clock_});
        }
        if (upper < high - cut) {
            high = upper;
            cut_any = true;
            if (settings_.record) proof_->steps.push_back({ReachStep::kCutUpper, joint, number, upper, clock_});
        }
        if (cut_any) {
            set_joint(joint);
            if (high - low < (1.0 - kWorthwhile) * before) changed_[joint] = clock_;
        }
        return true;
    }

    // Contract the box by the constraints until they have little effect. Returns false if it is excluded.
    bool propagate(bool first) {
        std::fill_n(influence_, n_, 0.0);
        std::fill_n(gap_, n_, Gap{});
        for (int pass = 0; pass < kPasses; ++pass) {
            bool any = false;
            for (int number = 0; number < static_cast<int>(loop_.constraints.size()); ++number) {
                const LoopConstraint& constraint = loop_.constraints[number];
                int wide = 0;
                bool stale = false;
                for (const Arc* arc : {&constraint.inner, &constraint.outer})
                    for (int joint : arc->joints) {
                        wide += value_[joint].half_width > kWide * (chain_.joints[joint].prismatic ? loop_.size : 1.0);
                        stale |= changed_[joint] > evaluated_[number];
                    }
                if (!stale || (wide > kMostWide && !(first && pass == 0))) continue;
                ++clock_;
                evaluated_[number] = clock_;
                any = true;
                if (!contract(constraint, number)) return false;
            }
            if (!any) break;
        }
        return true;
    }

    // The ball of an overlap over the box, on the link of its box: along the joints between the links, or through the target.
    Ball carried(const Overlap& overlap, bool through) const {
        Ball ball{overlap.centre, 0.0};
        const int from = overlap.ball_link, to = overlap.box_link;
        const auto ascend = [&](int first, int last) {
            for (int joint = first; joint < last; ++joint) ball = rotated_back(joint, this->up(joint, ball));
        };
        const auto descend = [&](int first, int last) {
            for (int joint = first - 1; joint >= last; --joint) ball = down(joint, ball);
        };
        if (!through) {
            ascend(from, to);
            descend(from, to);
        } else if (from >= to) {
            ascend(from, n_);
            ball = through_target(base_from_last_, chain_.tool.translation, ball);
            ascend(0, to);
        } else {
            descend(from, 0);
            ball = through_target(last_from_base_, target_.translation, ball);
            descend(n_, to);
        }
        return ball;
    }

    // Whether the ball and the box of one overlap share a point at every configuration of the box at which the tcp is at the
    // target. A ball with the centre c and the radius s reaches a box at the signed distance d from c if d < s; the centre is
    // enclosed in a ball with the radius r, so that d + r < s is sufficient.
    bool overlaps_everywhere() {
        overlap_share_ = 0.0;
        const int first = static_cast<int>(loop_.constraints.size());
        const Overlap* last = nullptr;
        Ball carried_balls[2];
        for (std::size_t i = 0; i < overlap_order_.size(); ++i) {
            const int number = overlap_order_[i];
            const Overlap& overlap = settings_.overlaps[number];
            // Most overlaps have the ball of the previous one.
            if (last == nullptr || last->ball_link != overlap.ball_link || last->box_link != overlap.box_link ||
                squared_norm(last->centre - overlap.centre) != 0.0)
                for (const bool through : {false, true}) carried_balls[through] = carried(overlap, through);
            last = &overlap;
            for (const bool through : {false, true}) {
                const Ball& ball = carried_balls[through];
                const Vec3 p = box_from_link_[number] * ball.centre;
                double inside = -std::numeric_limits<double>::infinity(), outside = 0.0;
                for (int axis = 0; axis < 3; ++axis) {
                    const double beyond = std::abs(p[axis]) - overlap.half[axis];
                    inside = std::max(inside, beyond);
                    outside += beyond > 0.0 ? beyond * beyond : 0.0;
                }
                const double signed_distance = (inside > 0.0 ? std::sqrt(outside) : inside) - overlap.box_radius;
                const double depth = overlap.ball_radius - signed_distance - rounding_;
                if (depth > ball.radius) {
                    std::rotate(overlap_order_.begin(), overlap_order_.begin() + i, overlap_order_.begin() + i + 1);
                    proof_->used[number] = 1;
                    if (settings_.record)
                        proof_->steps.push_back({ReachStep::kExcluded, -1, first + number, 0.0, ++clock_});
                    return true;
                }
                if (depth <= 0.0 || depth / ball.radius <= overlap_share_) continue;
                overlap_share_ = depth / ball.radius;
                const int low = std::min(overlap.ball_link, overlap.box_link);
                const int high = std::max(overlap.ball_link, overlap.box_link);
                for (int k = 0; k < n_; ++k) {
                    const bool between = k >= low && k < high;
                    overlap_effect_[k] = between != through ? value_[k].half_width : 0.0;
                }
            }
        }
        return false;
    }

    void start(const Transform& base_from_tcp, const ReachSettings& settings) {
        settings_ = settings;
        target_ = base_from_tcp;
        base_from_last_ = base_from_tcp * inverse(chain_.tool);
        last_from_base_ = inverse(base_from_last_);
        overlap_order_.resize(settings.overlaps.size());
        box_from_link_.clear();
        for (const Overlap& overlap : settings.overlaps) box_from_link_.push_back(inverse(overlap.link_from_box));
        std::iota(overlap_order_.begin(), overlap_order_.end(), 0);
        overlap_share_ = 0.0;
    }

    // Make a box the present one. `divided` is the joint whose range was divided last; -1: none.
    void open(const JointBox& box, int divided) {
        box_ = box;
        ++clock_;
        for (int k = 0; k < n_; ++k) {
            set_joint(k);
            // Constraints without the divided joint had no more effect on the larger box.
            changed_[k] = divided < 0 || k == divided ? clock_ : -1;
        }
    }

    double place_to_split(int joint) const {
        const Gap& gap = gap_[joint];
        const double low = box_.lower[joint], high = box_.upper[joint];
        return gap.width > kWorthyGap * (high - low) && gap.middle > low && gap.middle < high ? gap.middle
                                                                                              : value_[joint].middle;
    }

    int joint_to_split() const {
        int best = 0;
        if (overlap_share_ > kDeepEnough) {
            for (int k = 1; k < n_; ++k)
                if (overlap_effect_[k] > overlap_effect_[best]) best = k;
            if (overlap_effect_[best] > kSmallest) return best;
            best = 0;
        }
        int widest = 0;
        double most = -1.0, widths[kMostProofJoints];
        for (int k = 0; k < n_; ++k) {
            widths[k] = value_[k].half_width / (chain_.joints[k].prismatic ? loop_.size : 1.0);
            const double score = widths[k] > kSmallest ? influence_[k] + 1e-9 * widths[k] : -1.0;
            if (score > most) {
                most = score;
                best = k;
            }
            if (widths[k] > widths[widest]) widest = k;
        }
        if (most < 0.0) return -1;
        // Constraints with many wide joints are not evaluated, so that those joints have no influence. They are divided once
        // dividing the others has little effect.
        return widths[best] < kNarrow && widths[widest] > kMuchWider * widths[best] ? widest : best;
    }

    const Chain& chain_;
    const LoopDistances& loop_;
    int n_;
    double rounding_;  // m: allowance for rounding in distances
    const JointBox& limits_;
    std::vector<Transform> up_;  // the inverse of `before` of each joint

    Transform base_from_last_, last_from_base_, target_;
    ReachSettings settings_;
    ReachProof* proof_ = nullptr;

    JointBox box_;
    JointValue value_[kMostProofJoints];
    std::int64_t changed_[kMostProofJoints];  // the number of the evaluation that changed the joint last
    std::vector<std::int64_t> evaluated_;     // the last evaluation of each constraint
    std::int64_t clock_ = 0;                  // the number of the present evaluation
    double influence_[kMostProofJoints];
    struct Gap {
        double width = 0.0, middle = 0.0;
    };
    Gap gap_[kMostProofJoints];

    std::vector<Transform> box_from_link_;  // of each overlap
    std::vector<int> overlap_order_;        // the overlap that excluded a box last comes first
    double overlap_share_ = 0.0;  // the best quotient of a depth at the middle of the box and the depth required
    double overlap_effect_[kMostProofJoints];  // the part of each joint in the motion of its ball
};

}  // namespace

ReachProof prove_out_of_reach(const ReachArm& arm, const Transform& base_from_tcp, const ReachSettings& settings) {
    return ReachProver(arm).prove(base_from_tcp, settings);
}

bool search_keeps(const ReachArm& arm, const Transform& base_from_tcp, const double* q, const ReachSettings& settings) {
    return ReachProver(arm).keeps(base_from_tcp, q, settings);
}

}  // namespace pinproof
