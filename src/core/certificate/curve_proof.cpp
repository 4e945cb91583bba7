#include "certificate/curve_proof.h"

#include <algorithm>
#include <cmath>

#include "collision/boxes.h"
#include "collision/cells.h"
#include "collision/mesh.h"

namespace pinproof {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Times their distance: the motion is not bounded closely if two bodies may approach each other by more.
constexpr double kHopeless = 4.0;

// Fraction of the clearance to prove: no pair is measured more accurately.
constexpr double kCoarse = 0.02;

// Fraction of a pair's clearance to which it is measured where only FREE or not is asked.
constexpr double kQuickShare = 0.1;

// Entries of the stack of intervals: 60 bisections reach the resolution of a double.
constexpr std::size_t kDepth = 192;

// Extend delta from the middle to all control points, and so to their curve.
void widen(const double* control, std::size_t points, const std::vector<double>& middle, std::vector<double>& delta) {
    const std::size_t dof = middle.size();
    for (std::size_t r = 0; r < points; ++r)
        for (std::size_t j = 0; j < dof; ++j) delta[j] = std::max(delta[j], std::abs(control[r * dof + j] - middle[j]));
}

// A unit vector that separates the boxes about two bodies, or one of them and the ball about the other; zeros if these
// contain each other's centres.
Vec3 direction_between_boxes(const PlacedBody& a, const Shape& shape_a, const PlacedBody& b, const Shape& shape_b) {
    const Vec3 between = b.centre - a.centre;
    const Vec3 out_of_a = beyond_box(transposed_times(a.root_from_body.rotation, between), shape_a.half);
    const Vec3 out_of_b = beyond_box(transposed_times(b.root_from_body.rotation, between), shape_b.half);
    const double from_a = norm(out_of_a), from_b = norm(out_of_b);
    const bool of_a = from_a - shape_b.ball > from_b - shape_a.ball;
    const double length = of_a ? from_a : from_b;
    if (!(length > 0.0)) return {};
    return (1.0 / length) * (of_a ? a.root_from_body.rotation * out_of_a : b.root_from_body.rotation * out_of_b);
}

}  // namespace

// The limits are those of the pairs that are proven so far, and `of_open` those of the pairs that stay open.
struct CurveProof::Summary : ProvenLimits {
    ProvenLimits of_open;
    bool all_pairs_open = false;     // instead of a list
    std::size_t list = 0, open = 0;  // where they are in lists_
    double step = 0.0;               // the largest approach that is due to the curve, not to tolerances
    double weakest = kInfinity;  // the smallest proven clearance beyond the margin
    int weakest_pair = -1;
    double weakest_distance = kInfinity;
    // The deepest contact at the middle.
    double depth = kInfinity;
    int contact = -1;
};

CurveProof::CurveProof(const World& world)
    : world_(world),
      bodies_(world.space()),
      bounds_(world),
      middle_(world.space().tree.dof),
      delta_(world.space().tree.dof),
      memory_of_pair_(world.size()) {
    stack_.reserve(kDepth);
}

ProofState CurveProof::run(const CurveView& curve, const ProofSettings& settings, const double* joint_tolerance,
                           const ProofState& known) {
    curve_ = curve;
    settings_ = settings;
    joint_tolerance_ = joint_tolerance;
    state_ = known;
    last_interval_ = 0;
    memory_.clear();
    std::ranges::fill(memory_of_pair_, -1);
    const std::size_t size = curve.points * curve.dof;
    parts_.resize(kDepth * size);
    part_.resize(size);
    halves_.resize(2 * size);
    stack_.clear();
    push({curve.knots.front(), curve.knots.back(), 0, curve.pieces(), 0, 0, true}, curve.piece(0));
    while (!stack_.empty()) {
        Interval interval = stack_.back();
        std::copy_n(part(stack_.size() - 1), size, part_.data());
        stack_.pop_back();
        const double* control = part_.data();
        const Middle middle = place_middle(interval, control);
        Summary sum{state_};
        ++state_.intervals;
        if (is_wide(interval)) {
            find_contact(sum);
        } else {
            if (interval.all_pairs) list_pairs(interval);
            judge_pairs(interval, sum);
        }
        state_.include(sum);
        if (sum.contact >= 0) {
            state_.contact = FoundContact{middle.time, sum.contact, middle_};
            stack_.clear();
        }
        if (sum.all_pairs_open)
            bisect(interval, middle, sum);
        else if (sum.open == 0)
            continue;
        else if (is_bisected(sum))
            bisect(interval, middle, sum);
        else if (!decide(interval, sum))
            break;
    }
    return std::move(state_);
}

// Whether an interval with open pairs is bisected.
bool CurveProof::is_bisected(const Summary& sum) const {
    return !(sum.step < settings_.tolerance) && state_.intervals < settings_.max_intervals && stack_.size() + 2 <= kDepth;
}

// What is known of a pair. Few pairs of a world with thousands of obstacles are measured.
CurveProof::PairMemory& CurveProof::memory_of(int pair) {
    int& index = memory_of_pair_[pair];
    if (index < 0) {
        index = static_cast<int>(memory_.size());
        memory_.emplace_back();
    }
    return memory_[index];
}

// The distance (m) at which a pair with this margin is dropped.
double CurveProof::goal(double margin) const {
    return std::isfinite(state_.spare) ? margin + settings_.goal_share * std::max(state_.spare, 0.0) : margin;
}

// A distance (m) that is proven of a pair beyond this is not the smallest one.
double CurveProof::clear(int k, const Summary& sum) const {
    const double moved = world_.pair(k).with_obstacle ? settings_.obstacle_tolerance : 0.0;
    const double smallest = settings_.wants_tubes ? std::min(sum.proven + moved, state_.observed) : -kInfinity;
    return std::max(goal(world_.margin(k)), smallest);
}

void CurveProof::push(const Interval& interval, const double* control) {
    std::copy_n(control, curve_.points * curve_.dof, part(stack_.size()));
    stack_.push_back(interval);
}

// Place the bodies at the middle of an interval, and bound their motion in it.
CurveProof::Middle CurveProof::place_middle(const Interval& interval, const double* control) {
    Middle middle;
    std::ranges::fill(delta_, 0.0);
    if (is_single_piece(interval)) {
        middle = {0.5 * (interval.start + interval.end), interval.first_piece};
        double* left = halves_.data();
        double* right = left + curve_.points * curve_.dof;
        halve(control, curve_.points, curve_.dof, left, right);
        std::copy_n(right, curve_.dof, middle_.data());
        widen(control, curve_.points, middle_, delta_);
    } else {
        middle.piece = (interval.first_piece + interval.end_piece) / 2;
        middle.time = curve_.knots[middle.piece];
        std::copy_n(curve_.piece(middle.piece), curve_.dof, middle_.data());
        for (std::size_t i = interval.first_piece; i < interval.end_piece; ++i)
            widen(curve_.piece(i), curve_.points, middle_, delta_);
    }
    bodies_.set(middle_.data());
    bounds_.set(bodies_, delta_.data(), joint_tolerance_);
    if (is_single_piece(interval)) bounds_.set_piece(control, static_cast<int>(curve_.points), middle_.data());
    return middle;
}

// Whether the bodies move so far in an interval of several pieces that only contact is searched for: it is certain to be
// bisected, and its halves list their pairs themselves.
bool CurveProof::is_wide(const Interval& interval) const {
    if (is_single_piece(interval) || !interval.all_pairs || settings_.record) return false;
    if (state_.intervals >= settings_.max_intervals || stack_.size() + 2 > kDepth) return false;
    const double near = world_.widest_margin + (std::isfinite(state_.spare) ? std::max(state_.spare, 0.0) : 0.0);
    return std::ranges::any_of(world_.table->around, [&](int body) {
        return bounds_.rough_to_obstacles(body).distance > kHopeless * near + settings_.tolerance;
    });
}

// Find the deepest contact at the middle of an interval.
void CurveProof::find_contact(Summary& sum) {
    sum.all_pairs_open = true;
    const Geometry& space = world_.space();
    const auto check = [&](int k) {
        const Pair& pair = world_.pair(k);
        std::optional<Transform> a_from_b;
        const double margin = world_.margin(k), apart = margin + space.rounding;
        if (separation_of_bounds(bodies_[pair.a], space.shape(pair.a), bodies_[pair.b], space.shape(pair.b), apart,
                                 a_from_b) > apart)
            return;
        const DistanceBounds bounds =
            bound_distance(space.shape(pair.a), space.shape(pair.b), *a_from_b,
                           {.above = margin, .below = margin}, memory_of(k).separation);
        note_distance(k, bounds.upper, sum);
    };
    for (int k : world_.own) check(k);
    const Obstacles& obstacles = *space.obstacles;
    for (int body : world_.table->around)
        obstacles.visit(
            [&](int row) {
                const double gap = norm(beyond_box(bodies_[body].centre, obstacles.nodes[row].box)) - space.shape(body).ball;
                return gap > world_.widest_margin + space.rounding;
            },
            [&](int obstacle) {
                if (const int k = world_.pair_with_obstacle(body, obstacle); k >= 0) check(k);
                return false;
            });
}

// A distance (m) of a pair at the middle, or an upper bound of it.
void CurveProof::note_distance(int k, double distance, Summary& sum) {
    const double beyond = distance - world_.margin(k);
    state_.observed = std::min(state_.observed, distance);
    state_.spare = std::min(state_.spare, beyond);
    if (beyond <= 0.0 && beyond < sum.depth) {
        sum.depth = beyond;
        sum.contact = k;
    }
}

// List all moving pairs, except obstacles that the tree of their boxes proves to be far; the nodes of these are in far_.
// With evidence, each pair is listed.
void CurveProof::list_pairs(Interval& interval) {
    const Geometry& space = world_.space();
    lists_.resize(interval.list);
    lists_.insert(lists_.end(), world_.own.begin(), world_.own.end());
    const double level = goal(world_.widest_margin);
    for (int body : world_.table->around)
        space.obstacles->visit(
            [&](int row) {
                if (settings_.record) return false;
                const FarNode far = bound_node(body, row, level, is_single_piece(interval));
                if (far.certain > level && settings_.wants_tubes) far_.push_back(far);
                return far.certain > level;
            },
            [&](int obstacle) {
                if (const int k = world_.pair_with_obstacle(body, obstacle); k >= 0) lists_.push_back(k);
                return false;
            });
    interval.pairs = lists_.size() - interval.list;
}

// What is proven of a body and all obstacles in a node, by the rough bound, or, if that is not beyond `level`, along the
// direction between them.
CurveProof::FarNode CurveProof::bound_node(int body, int row, double level, bool single) const {
    const Geometry& space = world_.space();
    const Shape& shape = space.shape(body);
    const Vec3 centre = bodies_[body].centre, out = beyond_box(centre, space.obstacles->nodes[row].box);
    const double length = norm(out);
    const Approach& rough = bounds_.rough_to_obstacles(body);
    FarNode far{body, row, length - shape.ball, 0.0, rough.growth, kInfinity};
    far.certain = far.gap - rough.distance - space.rounding;
    if (far.certain > level || !single || !(length - space.rounding > level)) return far;
    const Vec3 u = (-1.0 / length) * out;
    const double gap = length - extent(bodies_[body], shape, u);
    if (!(gap - space.rounding > level)) return far;
    const MotionBounds::Simple approach = bounds_.nearly_tight_to_obstacles(body, u);
    const double certain = gap - approach.distance - space.rounding;
    if (certain > far.certain) far = {body, row, gap, certain, approach.growth, kGrowthRange};
    return far;
}

// Whether what is proven of a pair or a node beyond its margin changes none of the smallest distances and tolerances.
bool CurveProof::is_clear(const FarNode& far, double clear, double margin, bool with_obstacle, const Summary& sum) const {
    if (!(far.certain > clear)) return false;
    if (!settings_.wants_tubes) return true;
    const double slack = far.certain - margin;
    return far.gap - margin >= state_.spare && (!with_obstacle || slack >= sum.obstacle_tube) &&
           sum.joint_tube <= far.growth_range && slack >= far.growth * sum.joint_tube;
}

// Judge each pair of an interval; those that stay open follow its list.
void CurveProof::judge_pairs(const Interval& interval, Summary& sum) {
    sum.list = interval.list + interval.pairs;
    for (std::size_t i = interval.list; i < sum.list; ++i) judge(lists_[i], interval, sum);
    // Nodes that were left out are divided as far as they could have the smallest distance.
    const double margin = world_.widest_margin;
    while (!far_.empty()) {
        const FarNode far = far_.back();
        far_.pop_back();
        const double smallest = std::min(sum.proven + settings_.obstacle_tolerance, state_.observed);
        const double clear = std::max(goal(margin), smallest);
        if (is_clear(far, clear, margin, true, sum)) continue;
        const ObstacleNode& node = world_.space().obstacles->nodes[far.row];
        if (node.obstacle < 0) {
            const int second = world_.space().obstacles->nodes[far.row + 1].skip;
            for (int row : {second, far.row + 1})
                far_.push_back(bound_node(far.body, row, clear, is_single_piece(interval)));
        } else if (const int k = world_.pair_with_obstacle(far.body, node.obstacle); k >= 0) {
            judge(k, interval, sum);
        }
    }
}

// Whether a pair is proven apart in an interval along a direction, by the boxes about its bodies, and so clearly that
// it changes none of the smallest distances and tolerances that are known.
bool CurveProof::is_clearly_apart(int k, const Approach& rough, const Summary& sum) const {
    if (settings_.record) return false;
    const Geometry& space = world_.space();
    const Pair& pair = world_.pair(k);
    const PlacedBody &a = bodies_[pair.a], &b = bodies_[pair.b];
    const Shape &shape_a = space.shape(pair.a), &shape_b = space.shape(pair.b);
    const Vec3 u = direction_between_boxes(a, shape_a, b, shape_b);
    const double gap = dot(u, b.centre - a.centre) - extent(a, shape_a, u) - extent(b, shape_b, u);
    const double clear = this->clear(k, sum);
    if (!(gap - space.rounding > clear)) return false;
    const MotionBounds::Simple approach = bounds_.nearly_tight(pair, rough.split, u);
    const double certain = gap - approach.distance - space.rounding;
    return is_clear({0, 0, gap, certain, approach.growth, kGrowthRange}, clear, world_.margin(k), pair.with_obstacle, sum);
}

// Replace the bound of an approach by the tight one along a direction, if that is smaller.
bool CurveProof::tighten(const Pair& pair, const Vec3& direction, Approach& approach) const {
    const double tight = bounds_.tight(pair, approach.split, direction);
    if (!(tight < approach.distance)) return false;
    approach.distance = tight;
    if (settings_.wants_tubes) approach.growth = bounds_.growth(pair, approach.split, direction);
    return true;
}

void CurveProof::PartBounds::add(double distance, const Approach& of_part, double range, double slack) {
    if (of_part.growth > 0.0) tube = std::min({tube, range, slack / of_part.growth});
    if (distance - of_part.distance < lower - approach) {
        lower = distance;
        approach = of_part.distance;
    }
}

// The weakest bounds over the boxes of a body of cells, each of which is bounded as a body of its own.
CurveProof::PartBounds CurveProof::bound_cells(int k, const Transform& a_from_b, const Approach& rough,
                                               const DistanceQuery& query) const {
    const Pair& pair = world_.pair(k);
    const double margin = world_.margin(k);
    const Shape &a = world_.shape(pair.a), &b = world_.shape(pair.b);
    PartBounds worst{kInfinity, kInfinity, rough.distance, kInfinity};
    const auto add = [&](double lower, const Approach& approach, double range) {
        worst.add(lower, approach, range, lower - approach.distance - world_.space().rounding - margin);
    };
    visit_cells(
        *b.cells, BesideCells(a, a_from_b), [&] { return query.above; },
        [&](std::int32_t i) {
            const CellBox& box = b.cells->boxes[i];
            Separation separation;
            separation.direction = a_from_b * box.centre - a.centre;
            const DistanceBounds bounds = bound_distance(a, shape_of(box), a_from_b, query, separation);
            worst.upper = std::min(worst.upper, bounds.upper);
            Approach approach = rough;
            const bool may_tighten = a.kind == ShapeKind::kConvex && !(bounds.lower > query.above) &&
                                     bounds.upper > margin;
            const Vec3 direction = bodies_[pair.a].root_from_body.rotation * separation.direction;
            const bool tight = may_tighten && tighten(pair, direction, approach);
            add(bounds.lower, approach, tight ? kGrowthRange : kInfinity);
            return worst.upper <= margin;
        },
        [&](double gap) { add(gap, rough, kInfinity); });
    return worst;
}

// The weakest bounds over the triangles of meshes, each of which is bounded along the direction that separates it.
class CurveProof::Parts : public PartsQuestion {
public:
    Parts(const CurveProof& proof, int k, const Approach& rough, const Vec3& direction)
        : proof_(proof),
          pair_(proof.world_.pair(k)),
          apart_(proof.world_.margin(k) + proof.world_.space().rounding),
          goal_(proof.goal(proof.world_.margin(k)) + proof.world_.space().rounding),
          rough_(rough) {
        choose(direction);
    }

    bool leave(double gap, double along) override {
        // The better of both bounds, if it suffices
        const bool is_along = along - tight_.distance > gap - rough_.distance;
        const double certain = is_along ? along - tight_.distance : gap - rough_.distance;
        if (!(certain > goal_)) return false;
        add(is_along ? along : gap, is_along);
        return true;
    }

    bool measured(const DistanceBounds& bounds, const Vec3& direction) override {
        choose(direction);
        add(bounds.lower, true);
        return bounds.lower - tight_.distance > apart_;
    }

    PartBounds weakest{kInfinity, kInfinity, 0.0, kInfinity};

private:
    void choose(const Vec3& direction) {
        tight_ = rough_;
        const Vec3 u = proof_.bodies_[pair_.a].root_from_body.rotation * direction;
        tightened_ = squared_norm(u) > 0.0 && proof_.tighten(pair_, u, tight_);
    }

    void add(double distance, bool along) {
        const Approach& approach = along ? tight_ : rough_;
        const double range = along && tightened_ ? kGrowthRange : kInfinity;
        weakest.add(distance, approach, range, distance - approach.distance - apart_);
    }

    const CurveProof& proof_;
    const Pair& pair_;
    const double apart_, goal_;
    const Approach rough_;
    Approach tight_;  // along the direction that was measured last
    bool tightened_ = false;
};

// Whether meshes are not proven apart only because the tolerances of the joints, which a bisection leaves as they are,
// are counted as if they moved the bodies along one line.
bool CurveProof::is_due_to_tolerances(const Pair& pair, double lower, const Approach& rough, double goal) const {
    const auto is_half_space = [&](int body) { return world_.shape(body).kind == ShapeKind::kHalfSpace; };
    const double due = rough.distance - rough.bare, spare = lower - world_.space().rounding - goal;
    return !settings_.record && due > 0.0 && spare > 0.0 && spare <= due && !is_half_space(pair.a) && !is_half_space(pair.b);
}

// Judge a pair in an interval.
void CurveProof::judge(int k, const Interval& interval, Summary& sum) {
    const Geometry& space = world_.space();
    const Pair& pair = world_.pair(k);
    const double margin = world_.margin(k), goal = this->goal(margin);
    Approach approach = bounds_.rough(pair);
    double growth_range = kInfinity;
    const double enough = clear(k, sum) + approach.distance + space.rounding;
    const PlacedBody &a = bodies_[pair.a], &b = bodies_[pair.b];
    const Shape &shape_a = space.shape(pair.a), &shape_b = space.shape(pair.b);
    // If bodies move by far more than their distance, or another pair requires that the interval is bisected, only
    // contact at this configuration is checked by a measurement. Tolerances are not smaller in the halves.
    const double before = memory_of_pair_[k] < 0 ? kInfinity : memory_[memory_of_pair_[k]].distance;
    const bool hopeless = !is_single_piece(interval) || approach.bare > kHopeless * std::max(before, goal) ||
                          (sum.open > 0 && is_bisected(sum));
    std::optional<Transform> a_from_b;
    double lower = norm(b.centre - a.centre) - shape_a.ball - shape_b.ball;
    if (!(lower > enough)) {
        if (is_single_piece(interval) && is_clearly_apart(k, approach, sum)) return;
        lower = separation_of_bounds(a, shape_a, b, shape_b, enough, a_from_b);
    }
    double distance = kInfinity;
    Vec3 direction;
    if (!(lower > (hopeless ? margin + space.rounding : enough))) {
        PairMemory& memory = memory_of(k);
        const bool quick = settings_.goal_share == 0.0;
        const DistanceQuery query{.above = hopeless ? margin : enough,
                                  .below = margin,
                                  .precision = std::max(kDistancePrecision, kCoarse * (goal - margin)),
                                  .share = quick ? kQuickShare : 0.0};
        if (shape_b.cells && !hopeless) {
            const PartBounds bounds = bound_cells(k, *a_from_b, approach, query);
            lower = bounds.lower;
            distance = bounds.upper;
            approach.distance = bounds.approach;
            approach.growth = 0.0;
            growth_range = bounds.tube;
        } else {
            const DistanceBounds bounds = bound_distance(shape_a, shape_b, *a_from_b, query, memory.separation);
            lower = bounds.lower;
            distance = bounds.upper;
            if (!hopeless && world_.is_convex(pair) && !(lower > enough) && distance > margin) {
                direction = a.root_from_body.rotation * memory.separation.direction;
                if (tighten(pair, direction, approach)) growth_range = kGrowthRange;
            } else if (!hopeless && is_due_to_tolerances(pair, lower, approach, goal) && distance > margin) {
                Parts parts(*this, k, approach, memory.separation.direction);
                if (visit_parts(shape_a, shape_b, *a_from_b, query, memory.separation.direction, parts)) {
                    lower = parts.weakest.lower;
                    approach.distance = parts.weakest.approach;
                    approach.growth = 0.0;
                    growth_range = parts.weakest.tube;
                }
            }
        }
        if (distance < kInfinity) memory.distance = distance;
        note_distance(k, distance, sum);
    }
    const double moved = pair.with_obstacle ? settings_.obstacle_tolerance : 0.0;
    const double certain = lower - approach.distance - space.rounding;
    const double slack = certain - margin;
    const double tube = approach.growth > 0.0 ? std::min(growth_range, slack / approach.growth) : growth_range;
    const ProvenLimits limits{certain - moved, tube, pair.with_obstacle ? slack : kInfinity};
    if (settings_.record && slack > 0.0)
        state_.evidence.push_back({interval.start, interval.end, k, certain, direction});
    if (certain > goal) {
        sum.include(limits);
        return;
    }
    if (sum.list + sum.open == lists_.size()) lists_.emplace_back();
    lists_[sum.list + sum.open++] = k;
    sum.step = std::max(sum.step, approach.bare);
    sum.of_open.include(limits);
    if (!(slack >= sum.weakest)) {
        sum.weakest = std::isnan(slack) ? -kInfinity : slack;  // NaN proves nothing, whichever pair comes after it.
        sum.weakest_pair = k;
        sum.weakest_distance = distance;
    }
}

// End the work on an interval with open pairs that is not bisected. False: the proof ends.
bool CurveProof::decide(const Interval& interval, const Summary& sum) {
    if (sum.weakest > 0.0) {  // Less than the fraction that was requested, but proven.
        state_.include(sum.of_open);
        return true;
    }
    if (!state_.open) {
        state_.open = OpenSpan{interval.start, interval.end, sum.weakest_pair, sum.weakest_distance};
        // More than max_intervals makes no difference, and their sum could overflow.
        last_interval_ = state_.intervals + std::min(settings_.look_ahead, settings_.max_intervals);
    }
    if (state_.contact || state_.intervals >= std::min(last_interval_, settings_.max_intervals)) return false;
    if (interval.start < interval.end) {
        // A contact that begins here is found at the end of the interval, or shortly after it.
        const std::size_t last = interval.end_piece - 1, dof = curve_.dof;
        const double* end = (is_single_piece(interval) ? part_.data() : curve_.piece(last)) + (curve_.points - 1) * dof;
        for (std::size_t r = 0; r < curve_.points; ++r) std::copy_n(end, dof, halves_.data() + r * dof);
        push({interval.end, interval.end, last, last + 1, sum.list, sum.open, false}, halves_.data());
    }
    return true;
}

// Pass the open pairs of an interval to its halves; only what comes before a contact matters.
void CurveProof::bisect(const Interval& interval, const Middle& middle, const Summary& sum) {
    const std::size_t size = curve_.points * curve_.dof;
    const bool single = is_single_piece(interval);
    const bool all = sum.all_pairs_open;
    const std::size_t list = all ? interval.list : sum.list;
    Interval left{interval.start, middle.time, interval.first_piece, single ? interval.end_piece : middle.piece, list,
                  sum.open, all};
    Interval right{middle.time, interval.end, middle.piece, interval.end_piece, list, sum.open, all};
    if (sum.contact < 0) push(right, single ? halves_.data() + size : curve_.piece(right.first_piece));
    push(left, single ? halves_.data() : curve_.piece(left.first_piece));
}

}  // namespace pinproof
