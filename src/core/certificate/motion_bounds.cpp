#include "certificate/motion_bounds.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace pinproof {
namespace {

// The largest g . x over the points x of a body about its centre, by its box or by its ball.
double extent(const PlacedBody& body, const Shape& shape, const Vec3& g) {
    const Vec3 local = transposed_times(body.root_from_body.rotation, g);
    const double box =
        std::abs(local.x) * shape.half.x + std::abs(local.y) * shape.half.y + std::abs(local.z) * shape.half.z;
    const double ball = norm(g) * shape.ball;
    return box < ball ? box : ball;
}

// The largest speed along u of a point of a body per rate of a joint.
double speed_along(const Joint& joint, const Transform& axis, const PlacedBody& body, const Shape& shape,
                   const Vec3& u) {
    const Vec3 w = axis.rotation.column(2);
    if (joint.prismatic) return std::abs(dot(u, w));
    const Vec3 g = cross(u, w);
    return std::abs(dot(g, body.centre - axis.translation)) + extent(body, shape, g);
}

}  // namespace

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
      radius_(world.space().robot_bodies * swings_.size()),
      of_body_(world.space().robot_bodies),
      needed_(world.space().robot_bodies) {
    const JointTree& tree = world.space().tree;
    for (std::size_t body = 0; body < needed_.size(); ++body)
        for (int k = world.space().bodies[body].joint; k != kRoot; k = tree.joints[k].parent)
            needed_[body].push_back(k);
    const auto need = [&](int body, int k) {
        std::vector<int>& known = needed_[static_cast<std::size_t>(body)];
        if (std::ranges::find(known, k) == known.end()) known.push_back(k);
    };
    for (const auto* listed : {&world.own, &world.still})
        for (int number : *listed) {
            const Pair& pair = world.pairs[static_cast<std::size_t>(number)];
            if (pair.with_obstacle) continue;
            for (int k : world.joints_between(pair)) {
                need(pair.a, k);
                need(pair.b, k);
            }
        }
}

void MotionBounds::set(std::span<const Transform> joints, std::span<const PlacedBody> bodies, const double* delta,
                       const double* extra) {
    const Geometry& space = world_.space();
    axes_ = joints;
    bodies_ = bodies;
    extra_ = extra;
    for (std::size_t k = 0; k < swings_.size(); ++k) {
        const Joint& joint = space.tree.joints[k];
        swings_[k] = swing_of(joint, delta[joint.index], extra[joint.index]);
    }
    for (std::size_t body = 0; body < of_body_.size(); ++body) {
        const Shape& shape = space.shape(static_cast<int>(body));
        for (int k : needed_[body])
            radius_[body * swings_.size() + k] = radius_about(space.tree.joints[k], joints[k], bodies[body], shape);
        Approach sum{0.0, 0.0, 0.0, 0};
        for (int k = space.bodies[body].joint; k != kRoot; k = space.tree.joints[k].parent) {
            const double rho = radius(static_cast<int>(body), k);
            sum.distance += rho * swings_[k].chord;
            sum.growth += rho * swings_[k].share;
            sum.bare += rho * swings_[k].bare_chord;
            ++sum.split;
        }
        of_body_[body] = sum;
    }
}

Approach MotionBounds::rough_between(const Pair& pair) const {
    const std::span<const int> path = world_.joints_between(pair);
    const int count = static_cast<int>(path.size());
    Approach sum{0.0, 0.0, 0.0, count};
    for (int k : path) {
        const double rho = radius(pair.a, k);
        sum.distance += rho * swings_[k].chord;
        sum.growth += rho * swings_[k].share;
        sum.bare += rho * swings_[k].bare_chord;
    }
    Approach best = sum;
    for (int i = count - 1; i >= 0; --i) {  // Reassign joints one by one, beginning at b, from a to b.
        const int k = path[i];
        const double less = radius(pair.b, k) - radius(pair.a, k);
        sum.distance += less * swings_[k].chord;
        sum.growth += less * swings_[k].share;
        sum.bare += less * swings_[k].bare_chord;
        sum.split = i;
        if (sum.distance < best.distance) best = sum;
    }
    return best;
}

double MotionBounds::radius_of_any(int body, int k) const {
    if (static_cast<std::size_t>(body) < of_body_.size()) return radius(body, k);
    return radius_about(world_.space().tree.joints[k], axes_[k], bodies_[body], world_.shape(body));
}

template <bool wants_growth>
Approach MotionBounds::tight(const Pair& pair, int split, const Vec3& u, const double* control, int points,
                             const double* middle) const {
    const Geometry& space = world_.space();
    const std::vector<Joint>& joints = space.tree.joints;
    const std::size_t dof = space.tree.dof;
    const std::span<const int> path = world_.joints_between(pair);
    const int count = static_cast<int>(path.size()), up = static_cast<int>(pair.up);
    const PlacedBody &a = bodies_[pair.a], &b = bodies_[pair.b];
    const Shape &shape_a = space.shape(pair.a), &shape_b = space.shape(pair.b);
    const bool straight = points <= 2;  // A straight piece is symmetric about its middle: one end suffices.
    double first_order = 0.0;
    for (int r = 0; r < (straight ? 1 : points); ++r) {
        // The motion of a point x of a body towards the other is `along` + g . (x - centre).
        double along = 0.0;
        Vec3 of_a, of_b;
        for (int i = 0; i < count; ++i) {
            const Joint& joint = joints[path[i]];
            const Transform& axis = axes_[path[i]];
            double angle = joint.multiplier * (control[r * dof + joint.index] - middle[joint.index]);
            if (i < up) angle = -angle;
            const Vec3 w = axis.rotation.column(2);
            if (joint.prismatic) {
                along += angle * dot(u, w);
                continue;
            }
            const Vec3 g = angle * cross(u, w);
            if (i < split) {
                along += dot(g, a.centre - axis.translation);
                of_a += g;
            } else {
                along += dot(g, b.centre - axis.translation);
                of_b += g;
            }
        }
        double towards = straight ? std::abs(along) : -along;
        if (split > 0) towards += extent(a, shape_a, of_a);
        if (split < count) towards += extent(b, shape_b, of_b);
        first_order = std::max(first_order, towards);
    }
    Approach sum{first_order, 0.0, 0.0, split};
    // From the separating link outwards, first to a, then to b.
    const auto add_remainders = [&](int body, const PlacedBody& at, const Shape& shape, int begin, int end, int step) {
        double turned = 0.0, shares = 0.0;  // sums over the joints between the separating link and this one
        for (int i = begin; i != end; i += step) {
            const int k = path[i];
            const Joint& joint = joints[k];
            const JointSwing& swing = swings_[k];
            const double rate = radius_of_any(body, k), extra = extra_[joint.index];
            sum.distance += rate * (swing.bend + turned * swing.chord);
            if (wants_growth || extra != 0.0) {
                const double outward = speed_along(joint, axes_[k], at, shape, u);
                sum.distance += outward * swing.share * extra;
                sum.growth += outward * swing.share + rate * (shares * (swing.chord + kGrowthRange * swing.share) +
                                                              (turned + kGrowthRange * shares) * swing.share);
                if (!joint.prismatic)  // 1 - cos x + sin x, the derivative of the bend, is at most 2 x and below 2.42
                    sum.growth += rate * swing.share * std::min(2.0 * (swing.angle + kGrowthRange * swing.share), 2.42);
            }
            if (!joint.prismatic) {
                turned += swing.chord;
                shares += swing.share;
            }
        }
    };
    add_remainders(pair.a, a, shape_a, split - 1, -1, -1);
    add_remainders(pair.b, b, shape_b, split, count, 1);
    return sum;
}

template Approach MotionBounds::tight<true>(const Pair&, int, const Vec3&, const double*, int, const double*) const;
template Approach MotionBounds::tight<false>(const Pair&, int, const Vec3&, const double*, int, const double*) const;

}  // namespace pinproof
