#include "collision/near.h"

#include <algorithm>
#include <utility>

#include "collision/boxes.h"

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

Workspace::Workspace(std::shared_ptr<const World> world)
    : world_(std::move(world)), joints_(world_->space().tree.joints.size()), bodies_(world_->space().at_rest) {
    contacts_.reserve(world_->pairs.size());
    likely_.fill(-1);
}

namespace {

// The questions. Each states beyond which distance a pair is decided, when the bounds of a distance suffice, and what
// follows from bounds that do not exceed that distance.

struct AnyContact {
    static constexpr bool kStopsAtContact = true;
    static double limit(const Pair& pair, double rounding) { return pair.margin + rounding; }
    static double limit_around(const World& world) { return world.widest_margin + world.space().rounding; }
    static double below(const Pair& pair) { return pair.margin; }
    static bool contact(int, const DistanceBounds&) { return true; }
};

struct AllContacts : AnyContact {
    static constexpr bool kStopsAtContact = false;
};

struct SmallestDistance {
    static constexpr bool kStopsAtContact = false;
    Nearest nearest;

    double limit(const Pair&, double) const { return nearest.upper; }
    double limit_around(const World&) const { return nearest.upper; }
    static double below(const Pair&) { return -1.0; }
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
    const Pair& pair = world_->pairs[k];
    if (!a_from_b) a_from_b = relative(bodies_[pair.a].root_from_body, bodies_[pair.b].root_from_body);
    Separation separation;
    separation.direction = pair.first_direction;
    const double limit = question.limit(pair, world_->space().rounding);
    const DistanceBounds bounds = bound_distance(world_->shape(pair.a), world_->shape(pair.b), *a_from_b,
                                                 {.above = limit, .below = question.below(pair)}, separation);
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
        a_from_b.reset();
        return separation_of_bounds(bodies_[a], space.shape(a), bodies_[b], space.shape(b), limit, a_from_b) > limit;
    };
    if constexpr (Question::kStopsAtContact) {
        for (std::size_t i = 0; i < kLikely; ++i) {
            const int k = likely_[i];
            if (k < 0) continue;
            const Pair& pair = world.pairs[k];
            if (!decided(pair.a, pair.b, question.limit(pair, space.rounding)) && judge(k, a_from_b, question)) {
                if (i > 0) std::swap(likely_[i], likely_[i - 1]);  // Pairs often in contact move to the front.
                return true;
            }
        }
    }
    if (world.uses_obstacles) {
        for (int body : world.around) {
            const Vec3 centre = bodies_[body].centre;
            const double ball = space.shape(body).ball;
            for (int row = 0; row < static_cast<int>(space.obstacles.size());) {
                const ObstacleNode& node = space.obstacles[row];
                const double limit = question.limit_around(world);
                if (ball_to_node(centre, ball, node) > limit) {
                    row = node.skip;
                    continue;
                }
                ++row;
                if (node.body < 0) continue;
                const int k = world.pair_with_obstacle(body, node.body);
                if (k < 0 || decided(body, node.body, limit)) continue;
                if (judge(k, a_from_b, question)) {
                    likely_[kLikely - 1] = k;
                    return true;
                }
            }
        }
    }
    for (int k : world.own) {
        const Pair& pair = world.pairs[k];
        if (decided(pair.a, pair.b, question.limit(pair, space.rounding))) continue;
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
    const Pair& pair = world_->pairs[k];
    const Shape &a = world_->shape(pair.a), &b = world_->shape(pair.b);
    const Transform& root_from_a = bodies_[pair.a].root_from_body;
    Separation separation;
    separation.direction = pair.first_direction;
    Measured measured;
    measured.bounds = bound_distance(a, b, relative(root_from_a, bodies_[pair.b].root_from_body), {}, separation);
    const Witnesses local = witnesses(a, b, separation);
    measured.points = {root_from_a * local.of_a, root_from_a * local.of_b};
    measured.normal = root_from_a.rotation * separation.direction;
    return measured;
}

}  // namespace pinproof
