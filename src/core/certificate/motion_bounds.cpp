#include "certificate/motion_bounds.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "collision/boxes.h"

namespace pinproof {
namespace {

// The largest speed along u of a point of a body per rate of a joint.
double speed_along(const Joint& joint, const Transform& axis, const PlacedBody& body, const Shape& shape,
                   const Vec3& u) {
    const Vec3 w = axis.rotation.column(2);
    if (joint.prismatic) return std::abs(dot(u, w));
    const Vec3 g = cross(u, w);
    return std::abs(dot(g, body.centre - axis.translation)) + extent(body, shape, g);
}

}  // namespace

double extent(const PlacedBody& body, const Shape& shape, const Vec3& g) {
    const Vec3 local = transposed_times(body.root_from_body.rotation, g);
    const double box = half_extent(shape.half, local), ball = norm(g) * shape.ball;
    return box < ball ? box : ball;
}

JointSwing swing_of(bool prismatic, double multiplier, double delta, double extra) {
    JointSwing swing;
    swing.share = std::abs(multiplier);
    swing.angle = swing.share * (delta + extra);
    const double bare = swing.share * delta;
    if (prismatic) {
        swing.chord = swing.angle;
        swing.bend = 0.0;
        swing.bare_chord = bare;
        return swing;
    }
    const auto [sine, cosine] = sincos(0.5 * std::min(swing.angle, std::numbers::pi));
    const double sine_of_angle = swing.angle <= std::numbers::pi ? 2.0 * sine * cosine : std::sin(swing.angle);
    swing.chord = 2.0 * sine;
    swing.bend = swing.angle - sine_of_angle + 2.0 * sine * sine;  // 1 - cos x = 2 sin^2(x / 2)
    swing.bare_chord = extra == 0.0 ? swing.chord : 2.0 * std::sin(0.5 * std::min(bare, std::numbers::pi));
    return swing;
}

double radius_about(const Joint& joint, const Transform& axis, const PlacedBody& body, const Shape& shape) {
    if (joint.prismatic) return 1.0;
    return norm(cross(axis.rotation.column(2), body.centre - axis.translation)) + shape.ball;
}

MotionBounds::MotionBounds(const World& world)
    : world_(world),
      swings_(world.space().tree.joints.size()),
      radius_(world.space().robot.size() * swings_.size()),
      of_body_(world.space().robot.size()),
      remainder_of_(world.space().robot.size()),
      per_radius_(swings_.size()),
      inner_(swings_.size() + 1),
      needed_(world.space().robot.size()) {
    const JointTree& tree = world.space().tree;
    for (std::size_t body = 0; body < needed_.size(); ++body)
        for (int k = world.space().robot[body].joint; k != kRoot; k = tree.joints[k].parent)
            needed_[body].push_back(k);
    const auto need = [&](int body, int k) {
        std::vector<int>& known = needed_[static_cast<std::size_t>(body)];
        if (std::ranges::find(known, k) == known.end()) known.push_back(k);
    };
    for (const auto* listed : {&world.own, &world.table->still})
        for (int number : *listed) {
            const Pair& pair = world.pair(number);
            if (pair.with_obstacle) continue;
            for (int k : world.joints_between(pair)) {
                need(pair.a, k);
                need(pair.b, k);
            }
        }
}

void MotionBounds::set(const Placement& bodies, const double* delta, const double* extra) {
    const Geometry& space = world_.space();
    bodies_ = &bodies;
    extra_ = extra;
    for (std::size_t k = 0; k < swings_.size(); ++k) {
        const Joint& joint = space.tree.joints[k];
        swings_[k] = swing_of(joint, delta[joint.index], extra[joint.index]);
    }
    for (std::size_t body = 0; body < of_body_.size(); ++body) {
        const Shape& shape = space.shape(static_cast<int>(body));
        const PlacedBody& at = bodies[static_cast<int>(body)];
        for (int k : needed_[body])
            radius_[body * swings_.size() + k] = radius_about(space.tree.joints[k], bodies.joint(k), at, shape);
        Approach sum{0.0, 0.0, 0.0, 0};
        for (int k = space.robot[body].joint; k != kRoot; k = space.tree.joints[k].parent) {
            sum.add(radius(static_cast<int>(body), k), swings_[k]);
            ++sum.split;
        }
        of_body_[body] = sum;
    }
}

Approach MotionBounds::rough_between(const Pair& pair) const {
    const std::span<const int> path = world_.joints_between(pair);
    const int count = static_cast<int>(path.size());
    Approach sum{0.0, 0.0, 0.0, count};
    for (int k : path) sum.add(radius(pair.a, k), swings_[k]);
    Approach best = sum;
    for (int i = count - 1; i >= 0; --i) {  // Reassign joints one by one, beginning at b, from a to b.
        const int k = path[i];
        sum.add(radius(pair.b, k) - radius(pair.a, k), swings_[k]);
        sum.split = i;
        if (sum.distance < best.distance) best = sum;
    }
    return best;
}

double MotionBounds::radius_of_any(int body, int k) const {
    if (static_cast<std::size_t>(body) < of_body_.size()) return radius(body, k);
    return radius_about(world_.space().tree.joints[k], bodies_->joint(k), (*bodies_)[body], world_.shape(body));
}

// The remainder that a joint adds to a tight bound, per metre of the radius of a body about it, and its growth. `inner`
// has the sums of the chords and the shares of the joints between the separating link and this one.
MotionBounds::Simple MotionBounds::remainder_per_radius(const Joint& joint, const JointSwing& swing,
                                                        const Simple& inner) {
    const double chord = swing.chord, share = swing.share;
    Simple sum{swing.bend + inner.distance * chord,
               inner.growth * (chord + kGrowthRange * share) + (inner.distance + kGrowthRange * inner.growth) * share};
    if (!joint.prismatic)  // 1 - cos x + sin x, the derivative of the bend, is at most 2 x and below 2.42
        sum.growth += share * std::min(2.0 * (swing.angle + kGrowthRange * share), 2.42);
    return sum;
}

void MotionBounds::set_piece(const double* control, int points, const double* middle) {
    const JointTree& tree = world_.space().tree;
    straight_ = points <= 2;
    rows_ = straight_ ? 1 : points;
    displacements_.resize(rows_ * (swings_.size() + 1));
    for (int r = 0; r < rows_; ++r)
        for (int k = 0; k < static_cast<int>(swings_.size()); ++k) {
            const Joint& joint = tree.joints[k];
            const double angle = joint.multiplier * (control[r * tree.dof + joint.index] - middle[joint.index]);
            const Vec3 w = angle * bodies_->joint(k).rotation.column(2);
            Displacement sum = displacement(r, joint.parent);
            if (joint.prismatic) {
                sum.shift += w;
            } else {
                sum.turn += w;
                sum.shift -= cross(w, bodies_->joint(k).translation);
            }
            displacements_[r * (swings_.size() + 1) + k + 1] = sum;
        }
    // The remainders of bodies towards obstacles, per metre of their radius about each joint.
    for (int k = 0; k < static_cast<int>(swings_.size()); ++k) {
        const Joint& joint = tree.joints[k];
        const Simple inner = inner_[joint.parent + 1];
        per_radius_[k] = remainder_per_radius(joint, swings_[k], inner);
        per_radius_[k].distance += swings_[k].share * extra_[joint.index];
        per_radius_[k].growth += swings_[k].share;
        inner_[k + 1] = inner;
        if (!joint.prismatic) inner_[k + 1] = {inner.distance + swings_[k].chord, inner.growth + swings_[k].share};
    }
    for (std::size_t body = 0; body < remainder_of_.size(); ++body) {
        Simple sum{0.0, 0.0};
        for (int k = world_.space().robot[body].joint; k != kRoot; k = tree.joints[k].parent) {
            sum.distance += radius(static_cast<int>(body), k) * per_radius_[k].distance;
            sum.growth += radius(static_cast<int>(body), k) * per_radius_[k].growth;
        }
        remainder_of_[body] = sum;
    }
}

MotionBounds::Simple MotionBounds::nearly_tight_to_obstacles(int body, const Vec3& u) const {
    const Body& of = world_.space().robot[body];
    double most = 0.0;
    for (int r = 0; r < rows_; ++r) {
        const Displacement& moved = displacement(r, of.joint);
        const double along = dot(u, moved.of((*bodies_)[body].centre));
        most = std::max(most, (straight_ ? std::abs(along) : along) + extent((*bodies_)[body], *of.shape, cross(u, moved.turn)));
    }
    return {most + remainder_of_[body].distance, remainder_of_[body].growth};
}

double MotionBounds::first_order(const Pair& pair, int split, const Vec3& u) const {
    const Geometry& space = world_.space();
    const std::span<const int> path = world_.joints_between(pair);
    const int up = static_cast<int>(pair.up), count = static_cast<int>(path.size());
    // The joint that carries the link that separates the joints of a from those of b.
    int link = kRoot;
    if (split != up)
        link = split < up ? path[split] : path[split - 1];
    else if (count > 0)
        link = space.tree.joints[up > 0 ? path[up - 1] : path[0]].parent;
    const PlacedBody &a = (*bodies_)[pair.a], &b = (*bodies_)[pair.b];
    double most = 0.0;
    for (int r = 0; r < rows_; ++r) {
        // A point x of a body moves towards the other by `along` + g . (x - centre).
        double along = 0.0, reach = 0.0;
        if (split > 0) {
            const Displacement of_a = displacement(r, space.robot[pair.a].joint) - displacement(r, link);
            along += dot(u, of_a.of(a.centre));
            reach += extent(a, space.shape(pair.a), cross(u, of_a.turn));
        }
        if (split < count) {
            const Displacement of_b = displacement(r, (pair.with_obstacle ? kRoot : space.robot[pair.b].joint)) - displacement(r, link);
            along -= dot(u, of_b.of(b.centre));
            reach += extent(b, space.shape(pair.b), cross(u, of_b.turn));
        }
        most = std::max(most, (straight_ ? std::abs(along) : along) + reach);
    }
    return most;
}

MotionBounds::Simple MotionBounds::remainder(const Pair& pair, int split, const Vec3* u) const {
    const Geometry& space = world_.space();
    const std::span<const int> path = world_.joints_between(pair);
    Simple sum{0.0, 0.0};
    // From the separating link outwards, first to a, then to b.
    const auto add = [&](int body, int begin, int end, int step) {
        Simple inner{0.0, 0.0};  // of the joints between the separating link and this one
        for (int i = begin; i != end; i += step) {
            const int k = path[i];
            const Joint& joint = space.tree.joints[k];
            const JointSwing& swing = swings_[k];
            const double rate = radius_of_any(body, k);
            const double outward = u ? speed_along(joint, bodies_->joint(k), (*bodies_)[body], space.shape(body), *u) : rate;
            const Simple rest = remainder_per_radius(joint, swing, inner);
            sum.distance += rate * rest.distance + outward * swing.share * extra_[joint.index];
            sum.growth += rate * rest.growth + outward * swing.share;
            if (!joint.prismatic) inner = {inner.distance + swing.chord, inner.growth + swing.share};
        }
    };
    add(pair.a, split - 1, -1, -1);
    add(pair.b, split, static_cast<int>(path.size()), 1);
    return sum;
}

}  // namespace pinproof
