#include "collision/near.h"

#include <algorithm>
#include <utility>

#include "collision/boxes.h"
#include "collision/cells.h"

namespace pinproof {
double separation_of_bounds(const PlacedBody& a, const Shape& shape_a, const PlacedBody& b, const Shape& shape_b,
                            double enough, std::optional<Transform>& a_from_b) {
    const Vec3 between = b.centre - a.centre;
    double gap = norm(between) - shape_a.ball - shape_b.ball;
    if (gap > enough) return gap;
    const Vec3 offset = transposed_times(a.root_from_body.rotation, between);
    gap = std::max(gap, point_to_box(offset, shape_a.half) - shape_b.ball);
    if (gap > enough) return gap;
    const Vec3 offset_b = transposed_times(b.root_from_body.rotation, between);
    gap = std::max(gap, point_to_box(offset_b, shape_b.half) - shape_a.ball);
    if (gap > enough) return gap;
    a_from_b = relative(a.root_from_body, b.root_from_body);
    return std::max(gap, gap_of_faces(a_from_b->rotation, offset, shape_a.half, shape_b.half));
}

Workspace::Workspace(std::shared_ptr<const World> world) : world_(std::move(world)), bodies_(world_->space()) {
    likely_.fill(-1);
    const Pages<ObstacleNode>& nodes = world_->space().obstacles->nodes;
    if (nodes.size() > 2 * kMostInRow) return;  // leaves are half of the nodes
    for (std::size_t row = 0, i = 0; row < nodes.size(); ++row) {
        if (nodes[row].obstacle < 0) continue;
        const int lane = static_cast<int>(i++ % kLanes);
        if (lane == 0) four_.emplace_back().obstacles.fill(-1);
        four_.back().low.set(lane, nodes[row].low);
        four_.back().high.set(lane, nodes[row].high);
        four_.back().obstacles[lane] = nodes[row].obstacle;
    }
}

// Pass the obstacles, with lower bounds (m) of their distance from a body, to `visit(gap, obstacle)`, until it returns
// true; `visit(gap, -1)` states whether nothing within a node of the tree at that distance is to be visited.
template <class Visit>
bool Workspace::visit_obstacles(int body, Visit visit) const {
    const Vec3 centre = bodies_[body].centre;
    const double ball = world_->shape(body).ball;
    for (const FourBoxes& boxes : four_) {
        Lanes total = {};
        const auto add = [&](double x, Lanes low, Lanes high) {
            const Lanes out = lanes_max(lanes_max(low - x, x - high), Lanes{});
            total += out * out;
        };
        add(centre.x, boxes.low.x, boxes.high.x);
        add(centre.y, boxes.low.y, boxes.high.y);
        add(centre.z, boxes.low.z, boxes.high.z);
        const Lanes gap = lanes_sqrt(total) - ball;
        for (int lane = 0; lane < kLanes && boxes.obstacles[lane] >= 0; ++lane)
            if (!visit(gap[lane], -1) && visit(gap[lane], boxes.obstacles[lane])) return true;
    }
    if (!four_.empty()) return false;
    const Pages<ObstacleNode>& nodes = world_->space().obstacles->nodes;
    for (std::size_t row = 0; row < nodes.size();) {
        const ObstacleNode& node = nodes[row];
        const double gap = ball_to_node(centre, ball, node);
        const bool beyond = visit(gap, -1);
        row = beyond ? static_cast<std::size_t>(node.skip) : row + 1;
        if (!beyond && node.obstacle >= 0 && visit(gap, node.obstacle)) return true;
    }
    return false;
}

namespace {

// The questions. Each states beyond which distance a pair is decided, when the bounds of a distance suffice, and what
// follows from bounds that do not exceed that distance.

struct AnyContact {
    static constexpr bool kStopsAtContact = true;
    static double limit(const World& world, int k) { return world.margin(k) + world.space().rounding; }
    static double limit_around(const World& world) { return world.widest_margin + world.space().rounding; }
    static double below(const World& world, int k) { return world.margin(k); }
    static bool contact(int, const DistanceBounds&) { return true; }
};

struct AllContacts : AnyContact {
    static constexpr bool kStopsAtContact = false;
};

struct SmallestDistance {
    static constexpr bool kStopsAtContact = false;
    Nearest nearest;

    double limit(const World&, int) const { return nearest.upper; }
    double limit_around(const World&) const { return nearest.upper; }
    static double below(const World&, int) { return -1.0; }
    bool contact(int pair, const DistanceBounds& bounds) {
        if (bounds.upper < nearest.upper) {
            nearest.upper = bounds.upper;
            nearest.pair = pair;
        }
        if (!(bounds.lower > 0.0)) return true;
        nearest.lower = std::min(nearest.lower, bounds.lower);
        return false;
    }
};

}  // namespace

// Judge a pair that balls and boxes did not decide; whether the question is answered.
template <class Question>
bool Workspace::judge(int k, std::optional<Transform>& a_from_b, Question& question) {
    const Pair& pair = world_->pair(k);
    if (!a_from_b) a_from_b = relative(bodies_[pair.a].root_from_body, bodies_[pair.b].root_from_body);
    Separation separation;
    separation.direction = world_->first_direction(pair);
    // The search begins between the boxes, because the frames of bodies may be far from them. Where distances are
    // returned, it begins as those of certificates do.
    if (Question::kStopsAtContact && !(squared_norm(separation.direction) > 0.0))
        separation.direction = transposed_times(bodies_[pair.a].root_from_body.rotation,
                                                bodies_[pair.b].centre - bodies_[pair.a].centre);
    const double limit = question.limit(*world_, k);
    const DistanceBounds bounds = bound_distance(world_->shape(pair.a), world_->shape(pair.b), *a_from_b,
                                                 {.above = limit, .below = question.below(*world_, k)}, separation);
    if (bounds.lower > limit || !question.contact(k, bounds)) return false;
    contacts_.push_back(k);
    return Question::kStopsAtContact;
}

template <class Question>
bool Workspace::ask(Question& question) {
    const World& world = *world_;
    const Geometry& space = world.space();
    contacts_.clear();
    std::optional<Transform> a_from_b;
    const auto decided = [&](int a, int b, double limit) {
        // Most pairs are decided by their balls, without a root.
        const Shape &shape_a = space.shape(a), &shape_b = space.shape(b);
        const PlacedBody &at_a = bodies_[a], &at_b = bodies_[b];
        const double reach = shape_a.ball + shape_b.ball + limit;
        if (squared_norm(at_b.centre - at_a.centre) > reach * reach) return true;
        a_from_b.reset();
        return separation_of_bounds(at_a, shape_a, at_b, shape_b, limit, a_from_b) > limit;
    };
    if constexpr (Question::kStopsAtContact) {
        for (std::size_t i = 0; i < kLikely; ++i) {
            const int k = likely_[i];
            if (k < 0) continue;
            const Pair& pair = world.pair(k);
            if (!decided(pair.a, pair.b, question.limit(world, k)) && judge(k, a_from_b, question)) {
                if (i > 0) std::swap(likely_[i], likely_[i - 1]);  // Pairs often in contact move to the front.
                return true;
            }
        }
    }
    if (world.uses_obstacles) {
        const int robot = static_cast<int>(space.robot.size());
        for (int body : world.table->around) {
            const bool answered = visit_obstacles(body, [&](double gap, int obstacle) {
                const double limit = question.limit_around(world);
                if (obstacle < 0) return gap > limit;
                const int k = world.pair_with_obstacle(body, obstacle);
                if (k < 0 || decided(body, robot + obstacle, limit) || !judge(k, a_from_b, question)) return false;
                likely_[kLikely - 1] = k;
                return true;
            });
            if (answered) return true;
        }
    }
    for (int k : world.own) {
        const Pair& pair = world.pair(k);
        if (decided(pair.a, pair.b, question.limit(world, k))) continue;
        if (judge(k, a_from_b, question)) {
            likely_[kLikely - 1] = k;
            return true;
        }
    }
    return false;
}

bool Workspace::any_contact() {
    AnyContact question;
    return ask(question);
}

void Workspace::find_contacts() {
    AllContacts question;
    ask(question);
}

Nearest Workspace::find_nearest() {
    SmallestDistance question;
    ask(question);
    return question.nearest;
}

Measured Workspace::measure(int k) const {
    const Pair& pair = world_->pair(k);
    const Shape &a = world_->shape(pair.a), &b = world_->shape(pair.b);
    const Transform& root_from_a = bodies_[pair.a].root_from_body;
    Separation separation;
    separation.direction = world_->first_direction(pair);
    Measured measured;
    measured.bounds = bound_distance(a, b, relative(root_from_a, bodies_[pair.b].root_from_body), {}, separation);
    const Witnesses local = witnesses(a, b, separation);
    measured.points = {root_from_a * local.of_a, root_from_a * local.of_b};
    measured.normal = root_from_a.rotation * separation.direction;
    return measured;
}

std::vector<int> Workspace::overlapping_boxes(int k) const {
    const Pair& pair = world_->pair(k);
    const Shape &a = world_->shape(pair.a), &b = world_->shape(pair.b);
    std::vector<int> found;
    if (!b.cells) return found;
    const Transform a_from_b = relative(bodies_[pair.a].root_from_body, bodies_[pair.b].root_from_body);
    visit_cells(
        *b.cells, BesideCells(a, a_from_b), [] { return 0.0; },
        [&](std::int32_t i) {
            Separation separation;
            separation.direction = a_from_b * b.cells->boxes[i].centre - a.centre;
            const DistanceQuery query{.above = 0.0, .below = 0.0};
            if (!(bound_distance(a, shape_of(b.cells->boxes[i]), a_from_b, query, separation).lower > 0.0))
                found.push_back(i);
            return false;
        },
        [](double) {});
    return found;
}

}  // namespace pinproof
