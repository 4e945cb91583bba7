#include "collision/near.h"

#include <algorithm>
#include <utility>

#include "collision/boxes.h"
#include "collision/cells.h"
#include "collision/mesh.h"

namespace pinproof {
double separation_of_bounds(const PlacedBody& a, const Shape& shape_a, const PlacedBody& b, const Shape& shape_b,
                            double enough, std::optional<Transform>& a_from_b) {
    // Roots are computed only where the bound is returned.
    const auto exceeds = [](double squared, double reach) { return squared > reach * reach; };
    const Vec3 between = b.centre - a.centre;
    const double of_balls = squared_norm(between), balls = shape_a.ball + shape_b.ball;
    if (exceeds(of_balls, balls + enough)) return std::sqrt(of_balls) - balls;
    const Vec3 offset = transposed_times(a.root_from_body.rotation, between);
    const double to_a = squared_point_to_box(offset, shape_a.half);
    if (exceeds(to_a, shape_b.ball + enough)) return std::sqrt(to_a) - shape_b.ball;
    const Vec3 offset_b = transposed_times(b.root_from_body.rotation, between);
    const double to_b = squared_point_to_box(offset_b, shape_b.half);
    if (exceeds(to_b, shape_a.ball + enough)) return std::sqrt(to_b) - shape_a.ball;
    a_from_b = relative(a.root_from_body, b.root_from_body);
    const double faces = gap_of_faces(a_from_b->rotation, offset, shape_a.half, shape_b.half);
    if (faces > enough) return faces;
    return std::max({std::sqrt(of_balls) - balls, std::sqrt(to_a) - shape_b.ball, std::sqrt(to_b) - shape_a.ball, faces});
}

Workspace::Workspace(std::shared_ptr<const World> world) : world_(std::move(world)), bodies_(world_->space()) {
    likely_.fill(-1);
    for (int k : world_->own) {
        const Pair& pair = world_->pair(k);
        const double balls = world_->shape(pair.a).ball + world_->shape(pair.b).ball;
        const double reach = balls + world_->margin(k) + world_->space().rounding;
        own_.push_back({pair.a, pair.b, balls, reach * reach});
    }
    const Pages<ObstacleNode>& nodes = world_->space().obstacles->nodes;
    if (nodes.size() > 2 * kMostInRow) return;  // leaves are half of the nodes
    for (std::size_t row = 0, i = 0; row < nodes.size(); ++row) {
        if (nodes[row].obstacle < 0) continue;
        const int lane = static_cast<int>(i++ % kLanes);
        if (lane == 0) four_.emplace_back().obstacles.fill(-1);
        four_.back().low.set(lane, nodes[row].box.low);
        four_.back().high.set(lane, nodes[row].box.high);
        four_.back().obstacles[lane] = nodes[row].obstacle;
    }
}

// Pass the obstacles whose boxes are within `limit()` (m) of the ball of a body to `visit(obstacle)`, until it returns
// true.
template <class Limit, class Visit>
bool Workspace::visit_obstacles(int body, Limit limit, Visit visit) const {
    const Vec3 centre = bodies_.of_robot(body).centre;
    const double ball = world_->shape(body).ball;
    const auto squared_reach = [&] {
        const double reach = ball + limit();
        return reach * reach;
    };
    for (const FourBoxes& boxes : four_) {
        Lanes total = {};
        const auto add = [&](double x, Lanes low, Lanes high) {
            const Lanes out = lanes_max(lanes_max(low - x, x - high), Lanes{});
            total += out * out;
        };
        add(centre.x, boxes.low.x, boxes.high.x);
        add(centre.y, boxes.low.y, boxes.high.y);
        add(centre.z, boxes.low.z, boxes.high.z);
        if (!any(~(total > squared_reach()))) continue;
        for (int lane = 0; lane < kLanes && boxes.obstacles[lane] >= 0; ++lane)
            if (!(total[lane] > squared_reach()) && visit(boxes.obstacles[lane])) return true;
    }
    if (!four_.empty()) return false;
    const Obstacles& obstacles = *world_->space().obstacles;
    return obstacles.visit(
        [&](int row) { return squared_norm(beyond_box(centre, obstacles.nodes[row].box)) > squared_reach(); }, visit);
}

namespace {

// The questions. Each states beyond which distance a pair is decided, when the bounds of a distance suffice, and what
// follows from bounds that do not exceed that distance.

struct AnyContact {
    static constexpr bool kStopsAtContact = true, kAsksForContact = true;
    static double limit(const World& world, int k) { return world.margin(k) + world.space().rounding; }
    static double limit_around(const World& world) { return world.widest_margin + world.space().rounding; }
    static double below(const World& world, int k) { return world.margin(k); }
    static bool contact(int, const DistanceBounds&) { return true; }
};

struct AllContacts : AnyContact {
    static constexpr bool kStopsAtContact = false;
};

struct SmallestDistance {
    static constexpr bool kStopsAtContact = false, kAsksForContact = false;
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

// The direction along which two bodies are most likely apart: the normal, at the offset of their boxes, of the ellipsoid
// with the matrix (A^2 + R B^2 R^T)^-1, where A and B have the half sides of the boxes. For bodies that are long or flat
// it is much closer to the separating direction than the offset itself.
Vec3 likely_direction(const Shape& a, const Shape& b, const Transform& a_from_b) {
    const Vec3 offset = a_from_b * b.centre - a.centre;
    double m[3][3] = {};
    for (int i = 0; i < 3; ++i) {
        m[i][i] = a.half[i] * a.half[i];
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 3; ++k)
                m[i][j] += a_from_b.rotation.m[i][k] * a_from_b.rotation.m[j][k] * b.half[k] * b.half[k];
    }
    // The inverse of a symmetric matrix by its adjugate.
    const double xx = m[1][1] * m[2][2] - m[1][2] * m[1][2], xy = m[0][2] * m[1][2] - m[0][1] * m[2][2];
    const double xz = m[0][1] * m[1][2] - m[0][2] * m[1][1], yy = m[0][0] * m[2][2] - m[0][2] * m[0][2];
    const double yz = m[0][1] * m[0][2] - m[0][0] * m[1][2], zz = m[0][0] * m[1][1] - m[0][1] * m[0][1];
    const double determinant = m[0][0] * xx + m[0][1] * xy + m[0][2] * xz;
    if (!(determinant > 0.0)) return offset;  // flat boxes
    const double x = offset.x / determinant, y = offset.y / determinant, z = offset.z / determinant;
    return {xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z};
}

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
        separation.direction = likely_direction(world_->shape(pair.a), world_->shape(pair.b), *a_from_b);
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
    const auto answers = [&](int k, double limit) {
        const Pair& pair = world.pair(k);
        const Shape &a = space.shape(pair.a), &b = space.shape(pair.b);
        a_from_b.reset();
        return !(separation_of_bounds(bodies_[pair.a], a, bodies_[pair.b], b, limit, a_from_b) > limit) &&
               judge(k, a_from_b, question);
    };
    if constexpr (Question::kStopsAtContact) {
        for (std::size_t i = 0; i < kLikely; ++i) {
            const int k = likely_[i];
            if (k < 0 || !answers(k, question.limit(world, k))) continue;
            if (i > 0) std::swap(likely_[i], likely_[i - 1]);  // Pairs often in contact move to the front.
            return true;
        }
    }
    // Whether an answer is found by a pair that was not asked already.
    const auto answers_now = [&](int k, double limit) {
        if constexpr (Question::kStopsAtContact)
            if (std::ranges::find(likely_, k) != likely_.end()) return false;
        if (!answers(k, limit)) return false;
        likely_[kLikely - 1] = k;
        return true;
    };
    if (world.uses_obstacles) {
        for (int body : world.table->around) {
            const auto limit = [&] { return question.limit_around(world); };
            const bool answered = visit_obstacles(body, limit, [&](int obstacle) {
                const int k = world.pair_with_obstacle(body, obstacle);
                return k >= 0 && answers_now(k, limit());
            });
            if (answered) return true;
        }
    }
    for (std::size_t i = 0; i < world.own.size(); ++i) {
        // Most pairs are decided by their balls, without a root.
        const auto& [a, b, balls, squared_reach] = own_[i];
        const double squared = squared_norm(bodies_[b].centre - bodies_.of_robot(a).centre);  // b: of a still pair, an obstacle too
        if (Question::kAsksForContact && squared > squared_reach) continue;
        const double limit = question.limit(world, world.own[i]), reach = balls + limit;
        if (squared > reach * reach) continue;
        if (answers_now(world.own[i], limit)) return true;
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
    const auto closest = [](const Shape& shape, int i) {
        return shape.kind == ShapeKind::kMesh && i >= 0 ? &shape.mesh->triangles[i] : nullptr;
    };
    measured.triangles = {closest(a, separation.of_a), closest(b, separation.of_b)};
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
